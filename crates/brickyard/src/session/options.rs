//! Choices and limits of a session.

use crate::memory::available_bytes;

/// The choice of a backend.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BackendChoice {
    /// The GPU, unless there is none or only a software rasteriser; otherwise the CPU.
    #[default]
    Auto,
    /// Any GPU adapter, even a software one.
    Gpu,
    /// The CPU.
    Cpu,
}

/// The choice of a compositor, which gathers samples into a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CompositorChoice {
    /// `raycast`, the fastest by measurement on the CPU and on software rasterisers. A live session [on an application's
    /// hardware GPU](crate::session::Session::on_gpu) with timestamps begins with `sorted`, draws a few of its first
    /// frames by `raycast` as well, unseen, and keeps the faster one;
    /// [`Session::backend_line`](crate::session::Session::backend_line) then names it.
    #[default]
    Auto,
    /// Bricks back to front, blended; GPU only.
    Sorted,
    /// A ray per pixel, front to back.
    Raycast,
    /// Casts the same rays as [`CompositorChoice::Raycast`] in compute shaders; GPU only.
    Compute,
}

/// The choices and limits of a session. The default suits the machine: all of its processors, a quarter of its memory
/// (or of the process's control group) for decoded bricks, and as much for the CPU backend's; of a GPU's memory, at
/// most 1 GiB.
///
/// ```
/// use brickyard::session::SessionOptions;
///
/// let options = SessionOptions { host_memory_bytes: 256 << 20, live: true, ..SessionOptions::default() };
/// assert!(options.threads >= 1 && options.gpu_memory_bytes <= 1 << 30);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct SessionOptions {
    /// Choice of the backend.
    pub backend: BackendChoice,
    /// Choice of the compositor.
    pub compositor: CompositorChoice,
    /// Hard limit of the GPU's memory, bytes: slots, tables, targets and staging.
    pub gpu_memory_bytes: u64,
    /// Hard limit of the same memory of the CPU backend, bytes.
    pub cpu_memory_bytes: u64,
    /// Hard limit of decoded bricks, staging and scratch, bytes.
    pub host_memory_bytes: u64,
    /// Number of decoding threads, and of threads of the CPU backend.
    pub threads: usize,
    /// Whether to skip empty space, neither reading invisible bricks nor sampling there. Turn it off only to measure
    /// the gain.
    pub skips_empty: bool,
    /// Whether decoded bricks stay in host memory while there is room, for later views. False suits a single picture:
    /// it takes less memory.
    pub keeps_decoded: bool,
    /// True for a window, false for single pictures. A live session's camera moves in real time: no step waits, bricks
    /// are fetched ahead of the view, each step's uploads are limited, and finer bricks fade in. Any other session
    /// uploads all bricks of a view as they arrive, and equal views give equal plans.
    pub live: bool,
}

/// Default GPU memory in bytes, unless the machine has less: GPUs do not report their memory.
const GPU_MEMORY_BYTES: u64 = 1 << 30;

/// Default bytes for decoded bricks where the system does not report its memory.
const HOST_MEMORY_BYTES: u64 = 2 << 30;

impl Default for SessionOptions {
    fn default() -> Self {
        let share_bytes = available_bytes().map_or(HOST_MEMORY_BYTES, |bytes| bytes / 4);
        Self {
            backend: BackendChoice::Auto,
            compositor: CompositorChoice::Auto,
            gpu_memory_bytes: share_bytes.min(GPU_MEMORY_BYTES),
            cpu_memory_bytes: share_bytes,
            host_memory_bytes: share_bytes,
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            skips_empty: true,
            keeps_decoded: true,
            live: false,
        }
    }
}
