//! What a session may use.

use crate::memory::available_bytes;

/// Which backend draws.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BackendChoice {
    /// The GPU if there is one that is not a software rasteriser, else the CPU.
    #[default]
    Auto,
    /// Any GPU adapter, a software one too.
    Gpu,
    /// The CPU.
    Cpu,
}

/// How a backend is to gather samples into a picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum CompositorChoice {
    /// The compositor that is fastest over all scenes by measurement: `raycast`, on the GPU and on the CPU.
    #[default]
    Auto,
    /// Bricks back to front, blended; GPU only.
    Sorted,
    /// A ray per pixel, front to back.
    Raycast,
    /// Casts the same rays as [`CompositorChoice::Raycast`] in compute shaders; GPU only.
    Compute,
}

/// The choices and limits of a session. The default suits the machine: all of its processors, a quarter of its memory (or of what the process's control
/// group may use) for decoded bricks, and as much for those that the CPU draws; of a GPU's memory, at most 1 GiB.
///
/// ```
/// use brickyard::session::SessionOptions;
///
/// let options = SessionOptions { host_memory_bytes: 256 << 20, live: true, ..SessionOptions::default() };
/// assert!(options.threads >= 1 && options.gpu_memory_bytes <= 1 << 30);
/// ```
#[derive(Clone, Copy, Debug)]
pub struct SessionOptions {
    /// Which backend draws.
    pub backend: BackendChoice,
    /// Which compositor gathers samples.
    pub compositor: CompositorChoice,
    /// Hard limit of the GPU's memory, bytes: slots, tables, targets and staging.
    pub gpu_memory_bytes: u64,
    /// Hard limit of what the CPU backend takes in their place, bytes.
    pub cpu_memory_bytes: u64,
    /// Hard limit of decoded bricks, staging and scratch, bytes.
    pub host_memory_bytes: u64,
    /// Number of threads that decode bricks, and of threads of the CPU backend.
    pub threads: usize,
    /// Whether bricks that show nothing are not read, and empty space is not sampled. Turn it off only to measure what
    /// it gains.
    pub skips_empty: bool,
    /// Whether decoded bricks stay in host memory as long as there is room, for views that want them again. False suits a single picture: it takes less memory.
    pub keeps_decoded: bool,
    /// True for a window, false for single pictures. A live session's camera moves in real time: no step waits, bricks are fetched ahead of
    /// the view, each step's uploads are limited, and finer bricks fade in. Any other session takes all bricks of a view as they come, and the
    /// same views give the same plans.
    pub live: bool,
}

/// The GPU's memory, unless the machine has less to give: GPUs do not tell how much they have.
const GPU_MEMORY_BYTES: u64 = 1 << 30;

/// What decoded bricks may take where the system does not tell how much memory there is.
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
