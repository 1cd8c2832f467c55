//! A reader's remark on its source, for the user. Costs only its text.

use std::ops::Deref;

/// A sentence for the user: routine, such as the order of files, or a warning, such as rounded values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    text: String,
    is_warning: bool,
}

impl Note {
    /// Creates a routine remark.
    pub(crate) fn new(text: impl Into<String>) -> Self {
        Self { text: text.into(), is_warning: false }
    }

    pub(crate) fn warning(text: impl Into<String>) -> Self {
        Self { text: text.into(), is_warning: true }
    }

    /// Prefixes the remark with its subject.
    pub(crate) fn about(self, subject: &str) -> Self {
        Self { text: format!("{subject}{}", self.text), ..self }
    }

    /// Whether the note warns of a possible problem.
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
