//! Common flags of the commands with a session: the backend, and the number of threads.

use super::named::Named;
use brickyard::backend::{BackendChoice, CompositorChoice};
use brickyard::session::SessionOptions;
use std::num::NonZeroUsize;

/// The backends by their names.
pub(crate) const BACKENDS: Named<BackendChoice> =
    Named(&[("auto", BackendChoice::Auto, ""), ("gpu", BackendChoice::Gpu, ""), ("cpu", BackendChoice::Cpu, "")]);

/// The compositors by their names.
pub(crate) const COMPOSITORS: Named<CompositorChoice> = Named(&[
    ("auto", CompositorChoice::Auto, ""),
    ("sorted", CompositorChoice::Sorted, ""),
    ("raycast", CompositorChoice::Raycast, ""),
    ("compute", CompositorChoice::Compute, ""),
]);

/// Returns the requested threads; by default all processors.
pub(crate) fn threads(asked: Option<NonZeroUsize>) -> usize {
    asked.map_or_else(processors, NonZeroUsize::get)
}

/// Returns bytes of a GPU's memory, and of main memory in its place if the CPU draws: the requested ones, or each
/// default.
pub(crate) fn backend_memory(asked: Option<u64>) -> (u64, u64) {
    const GPU_BYTES: u64 = 1 << 30;
    (asked.unwrap_or(GPU_BYTES), asked.unwrap_or_else(|| SessionOptions::default().cpu_memory_bytes))
}

/// Processors available to this process.
pub(crate) fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}
