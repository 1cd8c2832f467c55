//! State of a file that is read more than once.

use crate::error::{ImportError, Result};
use brickyard_objects::is_address;
use std::fs::Metadata;
use std::path::Path;
use std::time::SystemTime;

/// Size and modification time of a file when it was opened. A source may read a file for days, and checks made at the
/// start hold only for this state. The inode number is left out, because some network file systems change it by
/// themselves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Stamp {
    pub(crate) bytes: u64,
    modified: Option<SystemTime>,
}

impl Stamp {
    /// Of objects at addresses, whose server answers for their state.
    pub(crate) const NONE: Self = Self { bytes: 0, modified: None };

    /// Returns the present state of the file at `path`.
    pub(crate) fn of(path: &Path) -> Result<Self> {
        if is_address(path) {
            return Ok(Self::NONE);
        }
        std::fs::metadata(path).map(|file| Self::in_metadata(&file)).map_err(ImportError::io(path))
    }

    pub(crate) fn in_metadata(file: &Metadata) -> Self {
        Self { bytes: file.len(), modified: file.modified().ok() }
    }

    /// Checks that the file at `path` still has this state. Call it *after* reading the bytes to be vouched for.
    ///
    /// # Errors
    /// If the file is gone, or was cut short, replaced or written to.
    pub(crate) fn check(&self, path: &Path) -> Result<()> {
        let found = Self::of(path)?;
        if found == *self {
            return Ok(());
        }
        let how = match found.bytes == self.bytes {
            true => "it was written to or replaced".into(),
            false => format!("expected {} bytes, as it had when it was opened, found {}", self.bytes, found.bytes),
        };
        let problem = format!("changed while it was read: {how}; start over when no program writes to it");
        Err(ImportError::invalid(path, problem))
    }
}
