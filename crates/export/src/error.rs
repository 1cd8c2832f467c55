//! Errors of exports, grouped by the caller's remedy.

use brickyard_import::ImportError;
use brickyard_store::{PackError, ReadError, UnfitOutput};
use std::path::{Path, PathBuf};

/// Ends of names with a format, for messages.
const NAMES: &str = ".zarr, .nii, .nii.gz, .nrrd, .seg.nrrd, .mha, .mhd, .vti, .pvd, .tif, .ome.tif, .npy, .raw or, for a folder of PNG planes, /";

/// Why an export failed. Afterwards no new file has the output's name.
#[derive(Debug, thiserror::Error)]
pub enum ExportError {
    /// The output exists, and must not be replaced.
    #[error("{path}: exists already; choose another name or pass `overwrite`")]
    Exists {
        /// The output's path.
        path: PathBuf,
    },
    /// The output would lie inside a store.
    #[error(transparent)]
    Inside(#[from] UnfitOutput),
    /// The output's name belongs to no supported format.
    #[error("{path}: cannot export to this name; choose one ending in {names}", names = NAMES)]
    Extension {
        /// The output's path.
        path: PathBuf,
    },
    /// The format cannot hold the voxels.
    #[error("{path}: {problem}")]
    Unfit {
        /// The output's path.
        path: PathBuf,
        /// The limit of the format, and a remedy.
        problem: String,
    },
    /// The store lacks the level, time step, channel or box.
    #[error("{what} {found} is outside the store: expected {expected}")]
    Outside {
        /// The invalid part: level, time step, channel or box.
        what: &'static str,
        /// The requested value.
        found: String,
        /// The store's own value.
        expected: String,
    },
    /// The progress callback cancelled the export.
    #[error("{path}: cancelled; nothing was written there")]
    Cancelled {
        /// The output's path.
        path: PathBuf,
    },
    /// The allowed memory is below the minimum for one thread.
    #[error(
        "`memory` {given} MiB is too little: this export needs at least {needed} MiB",
        given = given_bytes >> 20, needed = needed_bytes.div_ceil(1 << 20)
    )]
    Memory {
        /// The least memory for the export, in bytes.
        needed_bytes: u64,
        /// The allowed memory, in bytes.
        given_bytes: u64,
    },
    /// The worker threads could not be started.
    #[error("cannot start worker threads: {0}")]
    Threads(String),
    /// A brick could not be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// An OME-Zarr could not be packed.
    #[error(transparent)]
    Pack(PackError),
    /// A source other than a store could not be read.
    #[error(transparent)]
    Source(ImportError),
    /// The operating system could not write the output.
    #[error("{path}: {error}")]
    Io {
        /// The output's path.
        path: PathBuf,
        /// The operating system's error.
        #[source]
        error: std::io::Error,
    },
}

impl ExportError {
    /// Wraps an I/O error with its file, for `map_err`.
    pub(crate) fn io(path: &Path) -> impl Fn(std::io::Error) -> Self + '_ {
        move |error| Self::Io { path: path.into(), error }
    }

    pub(crate) fn unfit(path: &Path, problem: impl Into<String>) -> Self {
        Self::Unfit { path: path.into(), problem: problem.into() }
    }
}

/// A store's own errors are told apart from a file's.
impl From<ImportError> for ExportError {
    fn from(error: ImportError) -> Self {
        match error {
            ImportError::Other(error) => match error.downcast::<ReadError>() {
                Ok(error) => Self::Read(*error),
                Err(error) => Self::Source(ImportError::Other(error)),
            },
            error => Self::Source(error),
        }
    }
}
