//! Common flags of the commands with a session: the backend, and the number of threads.

use super::named::Named;
use brickyard::backend::{BackendChoice, CompositorChoice};
use brickyard::session::SessionOptions;
use std::num::NonZeroUsize;

pub(crate) const BACKENDS: Named<BackendChoice> =
    Named(&[("auto", BackendChoice::Auto, ""), ("gpu", BackendChoice::Gpu, ""), ("cpu", BackendChoice::Cpu, "")]);

pub(crate) const COMPOSITORS: Named<CompositorChoice> = Named(&[
    ("auto", CompositorChoice::Auto, ""),
    ("sorted", CompositorChoice::Sorted, ""),
    ("raycast", CompositorChoice::Raycast, ""),
    ("compute", CompositorChoice::Compute, ""),
]);

/// The requested threads, or else all processors.
pub(crate) fn threads(asked: Option<NonZeroUsize>) -> usize {
    asked.map_or_else(processors, NonZeroUsize::get)
}

/// Returns bytes of a GPU's memory, and of main memory in its place if the CPU draws: the requested ones, or each
/// default.
pub(crate) fn backend_memory(asked: Option<u64>) -> (u64, u64) {
    const GPU_BYTES: u64 = 1 << 30;
    (asked.unwrap_or(GPU_BYTES), asked.unwrap_or_else(|| SessionOptions::default().cpu_memory_bytes))
}

pub(crate) fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}
