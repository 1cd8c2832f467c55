//! Errors of repairs.

use crate::error::{OpenError, ReadError};
use crate::held::HoldError;
use crate::pack::{PackError, cure};
use brickyard_import::ImportError;
use std::path::PathBuf;

/// Why a store was not repaired, or only in part. It is never worse than before.
#[derive(Debug, thiserror::Error)]
pub enum RepairError {
    /// No store can be opened there, or its root document is lost, from which all others follow.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// Another process writes to the store, or it is not writable.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// The store is being packed, or about to be replaced by an unfinished pack.
    #[error("{path}: is an unfinished pack; finish it with `resume`, which repairs it, too")]
    Unfinished {
        /// The directory of the unfinished pack: the store, or its replacement.
        path: PathBuf,
    },
    /// The source is not the one of the store. No voxel was written.
    #[error(
        "{store}: is not made from this source: {what}; give the input it was packed from, with the same flags; no voxel was \
         written"
    )]
    Unlike {
        /// The store.
        store: PathBuf,
        /// The first difference.
        what: String,
    },
    /// The source's voxels cannot be compared with any sound brick. No voxel was written.
    #[error("{store}: {what} of its bricks is left to compare the source with; pack the store again")]
    Unvouched {
        /// The store.
        store: PathBuf,
        /// The missing evidence.
        what: &'static str,
    },
    /// The source could not be read. No voxel was written.
    #[error("{0}; no voxel was repaired")]
    Source(#[from] ImportError),
    /// The process lacks permission or resources to read some of the store, which is no store fault.
    #[error("{0}: not repaired")]
    Barred(#[source] ReadError),
    /// The allowed memory is below the minimum.
    #[error(
        "`memory` {given} MiB is too little: repairing this store needs at least {needed} MiB",
        given = given_bytes >> 20, needed = needed_bytes.div_ceil(1 << 20)
    )]
    Memory {
        /// The least memory for repairing this store, in bytes.
        needed_bytes: u64,
        /// The allowed memory, in bytes.
        given_bytes: u64,
    },
    /// A change to the file system failed. Files repaired so far stay, and the others are as before.
    #[error("{path}: {error}; {done} files of {store} are repaired: {} and repair it again", cure(error, None))]
    Incomplete {
        /// The file being written.
        path: PathBuf,
        /// The operating system's error.
        #[source]
        error: std::io::Error,
        /// The store.
        store: PathBuf,
        /// Number of repaired files.
        done: usize,
    },
    /// The progress callback cancelled the repair. Files repaired so far stay, and the others are as before.
    #[error("{store}: stopped; {done} files are repaired: the same repair goes on")]
    Cancelled {
        /// The store.
        store: PathBuf,
        /// Number of repaired files.
        done: usize,
    },
    /// The worker threads could not be started.
    #[error("cannot start worker threads: {0}")]
    Threads(String),
}

impl From<HoldError> for RepairError {
    fn from(error: HoldError) -> Self {
        match error {
            HoldError::Open(error) => error.into(),
            HoldError::Pack(error) => error.into(),
            HoldError::Unfinished { path, .. } => Self::Unfinished { path },
        }
    }
}
