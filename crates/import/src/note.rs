//! A remark of a reader on its source, for the user. Costs nothing but its words.

use std::ops::Deref;

/// A sentence that a user should know: routine, such as the order of files, or a warning of what may be wrong, such as values that were rounded.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    text: String,
    is_warning: bool,
}

impl Note {
    /// A routine remark.
    pub(crate) fn new(text: impl Into<String>) -> Self {
        Self { text: text.into(), is_warning: false }
    }

    /// A warning of what may be wrong.
    pub(crate) fn warning(text: impl Into<String>) -> Self {
        Self { text: text.into(), is_warning: true }
    }

    /// The same remark behind its subject.
    pub(crate) fn about(self, subject: &str) -> Self {
        Self { text: format!("{subject}{}", self.text), ..self }
    }

    /// Whether something may be wrong.
    pub fn is_warning(&self) -> bool {
        self.is_warning
    }
}

impl Deref for Note {
    type Target = str;

    fn deref(&self) -> &str {
        &self.text
    }
}
