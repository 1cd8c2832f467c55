//! The last problem, shown until it is over, another message replaces it, or the user dismisses it.

/// A failure to report, and its subject.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Problem {
    pub(crate) text: String,
    pub(crate) about: About,
}

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

impl Problem {
    pub(crate) fn new(about: About, text: impl Into<String>) -> Self {
        Self { text: text.into(), about }
    }
}
