//! The messages of the window: the last problem, and a note, which nobody has to answer.

use eframe::egui;
use std::time::{Duration, Instant};

/// Lifetime of a remark.
const PASSING: Duration = Duration::from_secs(5);

/// Subject of a problem, which decides its end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum About {
    /// The picture: until one can be drawn.
    Picture,
    /// The scene, or an edit of it: until the next edit.
    Scene,
    /// Files, devices and the like: until dismissed.
    Work,
}

/// The messages of a window.
#[derive(Default)]
pub(crate) struct Messages {
    /// The last problem, until it is over, another message replaces it, or the user dismisses it.
    problem: Option<(About, String)>,
    /// The last problem in the log.
    logged: Option<(About, String)>,
    /// The note, and its expiry; `None` is the next command.
    note: Option<(String, Option<Instant>)>,
    /// The time since which a picture cannot be drawn, and the last reason.
    failing: Option<(Instant, String)>,
}

impl Messages {
    pub(crate) fn problem(&self) -> Option<&str> {
        self.problem.as_ref().map(|(_, text)| text.as_str())
    }

    pub(crate) fn note(&self) -> Option<&str> {
        self.note.as_ref().map(|(text, _)| text.as_str())
    }

    /// Shows a problem.
    pub(crate) fn say(&mut self, about: About, text: impl Into<String>) {
        self.problem = Some((about, text.into()));
    }

    /// Shows a warning about a new scene, if there is one, instead of the last problem.
    pub(crate) fn warn(&mut self, warning: Option<String>) {
        self.problem = warning.map(|text| (About::Scene, text));
    }

    /// Shows a note on completed work.
    pub(crate) fn note_done(&mut self, text: String) {
        self.dismiss();
        self.notice(text);
    }

    /// Shows a notice, beside any problem.
    pub(crate) fn notice(&mut self, text: String) {
        self.note = Some((text, None));
    }

    /// Shows a passing remark.
    pub(crate) fn remark(&mut self, text: impl Into<String>) {
        self.note = Some((text.into(), Some(Instant::now() + PASSING)));
    }

    /// Removes the note, as before a command.
    pub(crate) fn forget_note(&mut self) {
        self.note = None;
    }

    /// Removes a remark at the end of its time, requesting a repaint for it.
    pub(crate) fn end_remark(&mut self, egui: &egui::Context) {
        let Some((_, Some(end))) = self.note else { return };
        match end.saturating_duration_since(Instant::now()) {
            Duration::ZERO => self.note = None,
            left => egui.request_repaint_after(left),
        }
    }

    /// Removes the problem.
    pub(crate) fn dismiss(&mut self) {
        self.problem = None;
    }

    /// Removes the problem if this is its subject.
    pub(crate) fn end(&mut self, about: About) {
        self.problem.take_if(|(known, _)| *known == about);
    }

    /// Shows why a picture cannot be drawn.
    pub(crate) fn say_failing(&mut self, reason: String) {
        let since = self.failing.as_ref().map_or_else(Instant::now, |(since, _)| *since);
        self.failing = Some((since, reason.clone()));
        self.say(About::Picture, reason);
    }

    /// Records the end of a picture's failure.
    pub(crate) fn end_failing(&mut self) {
        self.failing = None;
        self.end(About::Picture);
    }

    /// The time since a picture cannot be drawn, and the last reason; `None` if all can.
    pub(crate) fn failing(&self) -> Option<(Duration, &str)> {
        self.failing.as_ref().map(|(since, reason)| (since.elapsed(), reason.as_str()))
    }

    /// Logs the current problem once.
    pub(crate) fn log(&mut self) {
        if self.logged != self.problem {
            self.logged.clone_from(&self.problem);
            self.problem().into_iter().for_each(|problem| tracing::info!("{problem}"));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn remarks_pass_and_what_is_done_stays() {
        let (egui, mut messages) = (egui::Context::default(), Messages::default());
        messages.note_done("wrote a.png".into());
        messages.end_remark(&egui);
        assert_eq!(messages.note(), Some("wrote a.png"));
        messages.remark("there is nothing to undo");
        messages.end_remark(&egui);
        assert_eq!(messages.note(), Some("there is nothing to undo"));
        messages.note = messages.note.map(|(text, end)| (text, end.map(|end| end - PASSING)));
        messages.end_remark(&egui);
        assert_eq!(messages.note(), None);
    }
}
