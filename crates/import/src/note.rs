//! A reader's remark on its source, for the user. Costs only its text.

use std::ops::Deref;

/// A sentence for the user: routine, such as the order of files, or a warning, such as rounded values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    text: String,
    is_warning: bool,
    /// Whether it tells the file's value for no data, which a caller's replaces.
    is_on_nodata: bool,
}

impl Note {
    /// Creates a routine remark.
    pub(crate) fn new(text: impl Into<String>) -> Self {
        Self { text: text.into(), is_warning: false, is_on_nodata: false }
    }

    pub(crate) fn warning(text: impl Into<String>) -> Self {
        Self { text: text.into(), is_warning: true, is_on_nodata: false }
    }

    /// Marks a remark on the file's value for no data.
    pub(crate) fn on_nodata(self) -> Self {
        Self { is_on_nodata: true, ..self }
    }

    pub(crate) fn is_on_nodata(&self) -> bool {
        self.is_on_nodata
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
