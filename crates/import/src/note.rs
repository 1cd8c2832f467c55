//! A reader's remark on its source, for the user. Costs only its text.

use std::ops::Deref;

/// A sentence for the user: routine, such as the order of files, or a warning, such as rounded values.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Note {
    text: String,
    is_warning: bool,
    /// The caller's setting that replaces what it tells.
    settled_by: Option<Setting>,
    /// Values that a conversion has changed.
    changed: u64,
}

/// A setting of the caller that replaces a property of the file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Setting {
    NoData,
    Spacing,
    Origin,
    /// Spacing and origin.
    Place,
    /// The order of voxels along x, y or z.
    Flip(usize),
    Unit,
    ValueUnit,
    Times,
    TimeUnit,
}

impl Note {
    /// Creates a routine remark.
    pub fn new(text: impl Into<String>) -> Self {
        Self { text: text.into(), is_warning: false, settled_by: None, changed: 0 }
    }

    pub(crate) fn warning(text: impl Into<String>) -> Self {
        Self { is_warning: true, ..Self::new(text) }
    }

    /// A warning of values changed by a conversion.
    pub(crate) fn of_changed(changed: u64, text: impl Into<String>) -> Self {
        Self { changed, ..Self::warning(text) }
    }

    /// Marks a remark that is stale where the caller gives this setting.
    pub(crate) fn settled_by(self, setting: Setting) -> Self {
        Self { settled_by: Some(setting), ..self }
    }

    pub(crate) fn setting(&self) -> Option<Setting> {
        self.settled_by
    }

    /// Prefixes the remark with its subject.
    pub(crate) fn about(self, subject: &str) -> Self {
        Self { text: format!("{subject}{}", self.text), ..self }
    }

    /// Whether the note warns of a possible problem.
    pub fn is_warning(&self) -> bool {
        self.is_warning
    }

    /// The number of values that a conversion has changed, by this note: rounded, clamped or made infinite.
    pub fn changed(&self) -> u64 {
        self.changed
    }
}

impl Deref for Note {
    type Target = str;

    fn deref(&self) -> &str {
        &self.text
    }
}
