//! Errors of edits.

use crate::error::OpenError;
use crate::held::HoldError;
use crate::pack::{PackError, cure};
use crate::remake::RemakeError;
use brickyard_import::ImportError;
use std::path::PathBuf;

/// Why a store was not edited, or, for [`EditError::Unsynced`], the failure afterwards.
#[derive(Debug, thiserror::Error)]
pub enum EditError {
    /// No store can be opened there.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// Another process writes to the store, it is not writable, or no store can hold the new values.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// A new value is impossible, or does not fit the store.
    #[error(transparent)]
    Unfit(#[from] ImportError),
    /// The store is being packed, or about to be replaced by an unfinished pack.
    #[error("{path}: is an unfinished pack; finish it with `resume`, and then edit")]
    Unfinished {
        /// The directory of the unfinished pack: the store, or its replacement.
        path: PathBuf,
    },
    /// The root document is not as it was written: an edit would vouch for a change that may be damage.
    #[error(
        "{path}: was changed since it was packed or edited last, or is damaged: {change}; undo this change, and then edit, \
         or pack the store again"
    )]
    Altered {
        /// The root document.
        path: PathBuf,
        /// The first difference.
        change: String,
    },
    /// The store has all of these values already.
    #[error("{store}: has these values already: nothing to change")]
    Nothing {
        /// The store.
        store: PathBuf,
    },
    /// A change to the file system failed. The store is as before.
    #[error("{path}: {error}; {store} is unchanged: {} and edit again", cure(error, None))]
    Unchanged {
        /// The file being written.
        path: PathBuf,
        /// The operating system's error.
        #[source]
        error: std::io::Error,
        /// The store.
        store: PathBuf,
    },
    /// The coarser levels of labels are not made.
    #[error(transparent)]
    Levels(Box<RemakeError>),
    /// The store is edited, but not listed among its image's labels.
    #[error("{store}: is edited, but not listed among the labels of its image: {error}; edit again to list it")]
    Unlisted {
        /// The store.
        store: PathBuf,
        /// The reason.
        #[source]
        error: Box<PackError>,
    },
    /// The store is edited, and visibly so, but a power failure may still undo it.
    #[error("{store}: is edited, but a power failure may still undo it: {error}; edit again to make it last")]
    Unsynced {
        /// The store.
        store: PathBuf,
        /// The operating system's error.
        #[source]
        error: std::io::Error,
    },
}

impl From<RemakeError> for EditError {
    fn from(error: RemakeError) -> Self {
        Self::Levels(Box::new(error))
    }
}

impl From<HoldError> for EditError {
    fn from(error: HoldError) -> Self {
        match error {
            HoldError::Open(error) => error.into(),
            HoldError::Pack(error) => error.into(),
            HoldError::Unfinished { path, .. } => Self::Unfinished { path },
        }
    }
}
