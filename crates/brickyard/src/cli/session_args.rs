//! What the commands that open a session have in common: which backend, and how many threads.

use brickyard::backend::BackendChoice;
use clap::ValueEnum;

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

/// The threads asked for, at least one; all processors unless told.
pub(crate) fn threads(asked: Option<usize>) -> usize {
    asked.unwrap_or_else(processors).max(1)
}

/// Processors that this process may use.
pub(crate) fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}
