//! Errors of appending.

use crate::error::{OpenError, ReadError};
use crate::pack::{PackError, cure};
use brickyard_import::ImportError;
use brickyard_volume::counted;
use std::path::{Path, PathBuf};

/// Why a step was not appended, or, for [`AppendError::Appended`], the failure afterwards. The store keeps its former
/// steps, whole; remains of an interrupted step go with the next append.
#[derive(Debug, thiserror::Error)]
pub enum AppendError {
    /// No store can be opened there.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// Options, memory or input do not allow it, another process writes to the store, or a new store's first step was
    /// not packed.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// The store is being packed, or about to be replaced by an unfinished pack.
    #[error("{path}: is an unfinished pack; finish it with `resume`, and then append")]
    Unfinished {
        /// The directory of the unfinished pack: the store, or its replacement.
        path: PathBuf,
        /// Whether the pack replaces the store. If not, packing the store's own source with
        /// [`Exists::Resume`](crate::Exists::Resume) finishes it, or the same call of
        /// [`Appender::create`](crate::Appender::create) that began it.
        replaces: bool,
    },
    /// The first step of a store was begun from another input, or with other settings.
    #[error(
        "{store}: its first step was begun differently: {difference}; append that step again to finish it, or remove \
         {store} to start over"
    )]
    Begun {
        /// The store.
        store: PathBuf,
        /// The difference, in words, such as a setting's values then and now.
        difference: String,
    },
    /// The store has a single volume, and no time axis for more.
    #[error("{store}: has no time axis, so no step can be appended; pack its first step anew, with `time_step`")]
    NoTime {
        /// The store.
        store: PathBuf,
    },
    /// The store's shards hold several time steps, only written together.
    #[error(
        "{store}: has {steps} time steps in a shard, so no step can be appended; pack it anew with `shard_times` 1"
    )]
    Grouped {
        /// The store.
        store: PathBuf,
        /// Number of time steps in a shard.
        steps: u32,
    },
    /// The source has several time steps, but steps are appended one at a time.
    #[error(
        "the input holds {times} time steps; expected one: steps are appended one at a time, each with `take_time`"
    )]
    Several {
        /// Number of time steps of the source.
        times: u32,
    },
    /// The step's volume differs from that of the store's steps.
    #[error(
        "step {step}: its {what} is {found}, but in {steps} of {store} it is {expected}",
        steps = if *step == 1 { "step 0".to_owned() } else { format!("steps 0 to {}", step - 1) }
    )]
    Mismatch {
        /// The store.
        store: PathBuf,
        /// The intended number of the step.
        step: u32,
        /// The difference, in a word or two.
        what: &'static str,
        /// The store's value.
        expected: String,
        /// The step's value.
        found: String,
    },
    /// The step's time is impossible or missing.
    #[error("step {step}: time: expected {expected}, found {found}")]
    Time {
        /// The intended number of the step.
        step: u32,
        /// The expected time.
        expected: String,
        /// The given time.
        found: String,
    },
    /// A part of the store needed for appending cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// [`Progress::is_cancelled`](crate::Progress::is_cancelled) stopped the append.
    #[error("cancelled; {store} has {}", steps(*times))]
    Cancelled {
        /// The store.
        store: PathBuf,
        /// Number of its steps.
        times: u32,
    },
    /// The source failed midway.
    #[error("{error}; {store} has {}: correct the input and append it again", steps(*times))]
    Source {
        /// The source's error.
        #[source]
        error: ImportError,
        /// The store.
        store: PathBuf,
        /// Number of its steps.
        times: u32,
    },
    /// A change to the file system failed, usually on a full disk.
    #[error(
        "{path}: {error}; {store} has {}: {} and go on with step {times}",
        steps(*times), cure(error, None)
    )]
    Incomplete {
        /// The file being written.
        path: PathBuf,
        /// The operating system's error.
        #[source]
        error: std::io::Error,
        /// The store.
        store: PathBuf,
        /// Number of its steps.
        times: u32,
    },
    /// A thread of the packer, or of the source, panicked.
    #[error(
        "this program (or the reader of the input) has a fault: {words:?}; {store} has {}; please report this",
        steps(*times)
    )]
    Panic {
        /// The panic's message.
        words: String,
        /// The store.
        store: PathBuf,
        /// Number of its steps.
        times: u32,
    },
    /// The step is part of the store and visible to all: it must not be appended again. A later operation failed. A
    /// power failure may take the step until an [`Appender`](crate::Appender) opens the store without an error.
    #[error("step {step} is in {store}: do not append it again; a power failure may still take it: {error}")]
    Appended {
        /// The store.
        store: PathBuf,
        /// The step's number.
        step: u32,
        /// The failure after the step became part of the store.
        #[source]
        error: Box<AppendError>,
    },
}

impl AppendError {
    /// The error of a failed first step, for a store that does not exist yet.
    pub(super) fn of_first(error: PackError) -> Self {
        match error {
            PackError::Incomplete { path, error, store, .. } => Self::Incomplete { path, error, store, times: 0 },
            PackError::Source { error, store, .. } => Self::Source { error, store, times: 0 },
            PackError::Cancelled { store, .. } => Self::Cancelled { store, times: 0 },
            PackError::Panic { words, store, .. } => Self::Panic { words, store, times: 0 },
            PackError::Mismatch { store, difference } => Self::Begun { store, difference },
            error => error.into(),
        }
    }

    /// The error for a failure after a step became part of a store.
    pub(super) fn after(self, store: &Path, step: u32) -> Self {
        Self::Appended { store: store.into(), step, error: self.into() }
    }
}

fn steps(times: u32) -> String {
    counted(times.into(), "time step")
}
