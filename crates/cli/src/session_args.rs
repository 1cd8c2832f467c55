//! Common flags of the commands with a session: backend, compositor, memory, threads.

use super::named::Named;
use super::{heading, values};
use brickyard::backend::{BackendChoice, CompositorChoice};
use brickyard::session::SessionOptions;
use clap::Args;
use std::num::NonZeroUsize;

pub(crate) const BACKENDS: Named<BackendChoice> =
    Named(&[("auto", BackendChoice::Auto, ""), ("gpu", BackendChoice::Gpu, ""), ("cpu", BackendChoice::Cpu, "")]);

pub(crate) const COMPOSITORS: Named<CompositorChoice> = Named(&[
    ("auto", CompositorChoice::Auto, ""),
    ("sorted", CompositorChoice::Sorted, ""),
    ("raycast", CompositorChoice::Raycast, ""),
    ("compute", CompositorChoice::Compute, ""),
]);

/// Limits of a session that draws settled or shown pictures.
#[derive(Args)]
pub(crate) struct SessionLimits {
    /// Hard limit of brick slots, tables, targets and staging, wherever they are [default: 1GiB of a GPU's memory, or a
    /// quarter of the machine's if the CPU draws]
    #[arg(help_heading = heading::DRAWING, long, visible_alias = "cpu-memory", value_name = "BYTES", value_parser = values::bytes)]
    gpu_memory: Option<u64>,
    /// Hard limit of decoded bricks and scratch
    #[arg(help_heading = heading::DRAWING, long, value_name = "BYTES", default_value = "2GiB", value_parser = values::bytes)]
    pub(crate) host_memory: u64,
    /// Threads for decoding and for the CPU backend [default: all]
    #[arg(help_heading = heading::DRAWING, short = 'j', long, value_parser = values::threads)]
    threads: Option<NonZeroUsize>,
}

impl SessionLimits {
    /// Returns the options of a session within these limits. Unless the memory of bricks is given, that of a GPU and
    /// main memory in its place have each their own default.
    pub(crate) fn options(&self) -> SessionOptions {
        const GPU_BYTES: u64 = 1 << 30;
        let defaults = SessionOptions::default();
        SessionOptions {
            gpu_memory_bytes: self.gpu_memory.unwrap_or(GPU_BYTES),
            cpu_memory_bytes: self.gpu_memory.unwrap_or(defaults.cpu_memory_bytes),
            host_memory_bytes: self.host_memory,
            threads: threads(self.threads),
            ..defaults
        }
    }
}

/// The requested threads, or else all processors.
pub(crate) fn threads(asked: Option<NonZeroUsize>) -> usize {
    asked.map_or_else(processors, NonZeroUsize::get)
}

pub(crate) fn processors() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}
