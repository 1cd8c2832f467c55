//! Errors of extraction.

use brickyard_store::{ReadError, UnfitOutput};
use std::path::PathBuf;

/// Why there is no mesh.
#[derive(Debug, thiserror::Error)]
pub enum MeshError {
    /// The output exists, and must not be replaced.
    #[error("{path}: exists already; choose another name or pass `overwrite`")]
    Exists {
        /// The output's path.
        path: PathBuf,
    },
    /// The output would lie inside a store.
    #[error(transparent)]
    Inside(#[from] UnfitOutput),
    /// The output's extension belongs to no supported format.
    #[error("{path}: cannot write a mesh to this extension; choose a name ending in .stl, .ply, .obj or .glb")]
    Extension {
        /// The output's path.
        path: PathBuf,
    },
    /// The request does not fit the store, its kind or the format; the text says why, and what does.
    #[error("{0}")]
    Unfit(String),
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
    /// There is no such surface; the text describes it, and what there is.
    #[error("{0}; nothing was written")]
    Empty(String),
    /// The mesh outgrows its format.
    #[error("{path}: the mesh outgrows its format: {limit}; nothing was written. {advice}")]
    TooLarge {
        /// The output's path.
        path: PathBuf,
        /// The format's limit.
        limit: &'static str,
        /// The way on.
        advice: &'static str,
    },
    /// The progress callback cancelled the work.
    #[error("{path}: cancelled; nothing was written there")]
    Cancelled {
        /// The output's path.
        path: PathBuf,
    },
    /// The allowed memory is below the minimum for one thread.
    #[error(
        "`memory` {given} MiB is too little: a mesh of this store with this smoothing needs at least {needed} MiB",
        given = given_bytes >> 20, needed = needed_bytes.div_ceil(1 << 20)
    )]
    Memory {
        /// The least memory, in bytes.
        needed_bytes: u64,
        /// The allowed memory, in bytes.
        given_bytes: u64,
    },
    /// Side data of the store contradict its voxels.
    #[error("the stored ranges of bricks contradict their voxels: verify the store")]
    Contradiction,
    /// The worker threads could not be started.
    #[error("cannot start worker threads: {0}")]
    Threads(String),
    /// A brick could not be read.
    #[error(transparent)]
    Read(#[from] ReadError),
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
