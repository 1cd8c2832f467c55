//! What the commands that open a session have in common: which backend, and how many threads.

use brickyard::backend::BackendChoice;
use brickyard::session::SessionOptions;
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

/// Bytes of a GPU's memory, and of main memory in its place if the CPU draws: those asked for, or what suits each.
pub(crate) fn backend_memory(asked: Option<u64>) -> (u64, u64) {
    const GPU_BYTES: u64 = 1 << 30;
    (asked.unwrap_or(GPU_BYTES), asked.unwrap_or_else(|| SessionOptions::default().cpu_memory_bytes))
}

/// Processors that this process may use.
pub(crate) fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}
