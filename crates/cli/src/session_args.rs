//! What the commands that open a session have in common: which backend, and how many threads.

use brickyard::backend::BackendChoice;
use clap::ValueEnum;
use std::num::NonZeroUsize;

/// [`BackendChoice`] on the command line.
#[derive(Clone, Copy, ValueEnum)]
pub(crate) enum BackendArgument {
    Auto,
    Gpu,
    Cpu,
}

impl From<BackendArgument> for BackendChoice {
    fn from(backend: BackendArgument) -> Self {
        match backend {
            BackendArgument::Auto => Self::Auto,
            BackendArgument::Gpu => Self::Gpu,
            BackendArgument::Cpu => Self::Cpu,
        }
    }
}

/// The threads asked for; all processors unless told.
pub(crate) fn threads(asked: Option<NonZeroUsize>) -> usize {
    asked.map_or_else(processors, NonZeroUsize::get)
}

/// Processors that this process may use.
pub(crate) fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}
