//! Errors of upgrades.

use crate::error::OpenError;
use crate::held::HoldError;
use crate::ngff::Ngff;
use crate::pack::{PackError, cure};
use std::path::PathBuf;

/// Why a store's version was not changed, or, for [`UpgradeError::Unsynced`], the failure afterwards.
#[derive(Debug, thiserror::Error)]
pub enum UpgradeError {
    /// No store can be opened there, or a document says what the version cannot.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// Another process writes to the store or its labels, they are not writable, or their image has another version.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// The store, or one of its labels, is being packed, or about to be replaced by an unfinished pack.
    #[error("{path}: is an unfinished pack; finish it with `resume`, and then upgrade")]
    Unfinished {
        /// The directory of the unfinished pack.
        path: PathBuf,
    },
    /// Something among the labels cannot be changed.
    #[error("{path}: {problem}")]
    Label {
        /// Its place.
        path: PathBuf,
        /// The reason, with the remedy.
        problem: &'static str,
    },
    /// The patient's system is not as it was written: the other version would lose the change.
    #[error("{path}: was changed since it was written, or is damaged: {change}; undo this change, and then upgrade")]
    Altered {
        /// The root document.
        path: PathBuf,
        /// The first difference.
        change: String,
    },
    /// A change to the file system failed. The store and its labels are as before.
    #[error("{path}: {error}; {store} is unchanged: {} and upgrade again", cure(error, None))]
    Unchanged {
        /// The file being written.
        path: PathBuf,
        /// The operating system's error.
        #[source]
        error: std::io::Error,
        /// The store.
        store: PathBuf,
    },
    /// A change to the file system failed after the first. Some labels have the new version, and the image has not.
    #[error(
        "{path}: {error}; some labels of {store} are OME-Zarr {to}, and the image is not yet: {} and upgrade again to go on",
        cure(error, None)
    )]
    Partly {
        /// The file being replaced.
        path: PathBuf,
        /// The operating system's error.
        #[source]
        error: std::io::Error,
        /// The store.
        store: PathBuf,
        /// The new version.
        to: Ngff,
    },
    /// All is changed, and visibly so, but a power failure may still undo it.
    #[error("{store}: is OME-Zarr {to}, but a power failure may still undo it: {error}; upgrade again to make it last")]
    Unsynced {
        /// The store.
        store: PathBuf,
        /// The new version.
        to: Ngff,
        /// The operating system's error.
        #[source]
        error: std::io::Error,
    },
}

impl From<HoldError> for UpgradeError {
    fn from(error: HoldError) -> Self {
        match error {
            HoldError::Open(error) => error.into(),
            HoldError::Pack(error) => error.into(),
            HoldError::Unfinished { path, .. } => Self::Unfinished { path },
        }
    }
}
