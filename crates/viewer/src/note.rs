//! Notes of the window, which nobody has to answer: of work done, until the next command, and remarks, which expire.

use std::time::{Duration, Instant};

/// Lifetime of a remark.
const PASSING: Duration = Duration::from_secs(5);

/// A message, until the next command at most.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Note {
    pub(crate) text: String,
    /// The time of expiry; `None` is the next command.
    end: Option<Instant>,
}

impl Note {
    /// A note on completed work, or a notice.
    pub(crate) fn new(text: impl Into<String>) -> Self {
        Self { text: text.into(), end: None }
    }

    /// A remark on the last command.
    pub(crate) fn passing(text: impl Into<String>) -> Self {
        Self { text: text.into(), end: Some(Instant::now() + PASSING) }
    }

    /// Remaining lifetime; `None` is until the next command.
    pub(crate) fn left(&self) -> Option<Duration> {
        self.end.map(|end| end.saturating_duration_since(Instant::now()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn remarks_pass_and_what_is_done_stays() {
        assert_eq!(Note::new("wrote a.png").left(), None);
        let mut remark = Note::passing("there is nothing to undo");
        assert!(remark.left().is_some_and(|left| left > Duration::ZERO && left <= PASSING));
        remark.end = remark.end.map(|end| end - PASSING);
        assert_eq!(remark.left(), Some(Duration::ZERO));
    }
}
