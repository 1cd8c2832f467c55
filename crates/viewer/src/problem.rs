//! What has gone wrong, which the window says until it is over, something else is said, or the user puts it away.

/// Something that has gone wrong.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Problem {
    pub(crate) text: String,
    pub(crate) about: About,
}

/// What a problem is about, with which it is over.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum About {
    /// The picture: until one can be drawn.
    Picture,
    /// The scene, or an edit of it: until there is another edit.
    Scene,
    /// Files, devices and the like: until it is put away.
    Work,
}

impl Problem {
    pub(crate) fn new(about: About, text: impl Into<String>) -> Self {
        Self { text: text.into(), about }
    }
}
