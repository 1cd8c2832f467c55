//! What a session may use.

use brickyard_volume::Needs;

/// Which backend to use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum BackendChoice {
    /// The GPU if there is a real one, else the CPU.
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
    /// What measures fastest over all scenes: `raycast`, on the GPU and on the CPU.
    #[default]
    Auto,
    /// Bricks back to front, blended; GPU only.
    Sorted,
    /// A ray per pixel, front to back.
    Raycast,
    /// The same rays by compute shaders; GPU only.
    Compute,
}

/// What a session may use.
#[derive(Clone, Copy, Debug)]
pub struct SessionOptions {
    /// Which backend.
    pub backend: BackendChoice,
    /// Which compositor.
    pub compositor: CompositorChoice,
    /// Hard limit of the backend's memory, bytes.
    pub gpu_memory_bytes: u64,
    /// Hard limit of decoded bricks, staging and scratch, bytes.
    pub host_memory_bytes: u64,
    /// What the scenes to come need of bricks: [`Scene::needs`](brickyard_volume::Scene::needs) says it. Scenes with no greater
    /// needs may be shown.
    pub bricks: Needs,
    /// Decode workers, and threads of the CPU backend.
    pub threads: usize,
    /// The largest picture to be rendered, pixels.
    pub max_size_px: (u32, u32),
    /// Whether what shows nothing is neither read nor sampled: always, but to measure what that gains.
    pub leaps: bool,
    /// Whether the camera moves in real time: then no step waits, bricks are fetched ahead, each step's uploads are limited, and
    /// finer bricks fade in. Otherwise all that a view wants is taken as it comes, and the same views give the same plans.
    pub live: bool,
}
