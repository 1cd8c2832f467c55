//! Errors on the GPU, by the caller's remedy.
use brickyard_volume::numbers::mebibytes;

/// An error of the GPU backend.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum GpuError {
    /// No adapter of the requested kind: use the CPU backend.
    #[error("no {wanted} found{seen}: install a Vulkan driver (mesa-vulkan-drivers for a software one)")]
    NoAdapter {
        /// The requested kind of adapter.
        wanted: &'static str,
        /// The available adapters, for the message; empty if none.
        seen: String,
    },
    /// The adapter provides no device, or one with too low limits.
    #[error("{adapter} provides no device: {reason}")]
    Device {
        /// The adapter's name.
        adapter: String,
        /// The driver's message, or the insufficient limits.
        reason: String,
    },
    /// The budget cannot hold the picture and a few bricks.
    #[error(
        "{} of GPU memory are too few: pictures of {width_px}x{height_px} pixels with bricks of {slot_edge}^3 texels need at least {}",
        mebibytes(*given_bytes), mebibytes(*least_bytes)
    )]
    Budget {
        /// The given budget, bytes.
        given_bytes: u64,
        /// The least sufficient budget, bytes.
        least_bytes: u64,
        /// Width of the picture, pixels.
        width_px: u32,
        /// Height of the picture, pixels.
        height_px: u32,
        /// Texels along the edge of a padded brick.
        slot_edge: u32,
    },
    /// The meshes take a larger buffer than shaders can see.
    #[error(
        "the meshes take {bytes} bytes, of at most {limit_bytes} for shaders here: simplify them, or draw on the CPU"
    )]
    Meshes {
        /// The largest buffer of the meshes, of vertices or of triangles, bytes.
        bytes: u64,
        /// The largest buffer visible to a shader, bytes.
        limit_bytes: u64,
    },
    /// The picture's volumes need more textures than a shader can see.
    #[error(
        "the {volumes} volumes of one picture need {needed} textures, of at most {limit} on this GPU: show fewer, or \
         draw on the CPU"
    )]
    Textures {
        /// Number of volumes in the picture.
        volumes: usize,
        /// Number of textures needed: one for each pool of slots, two with stored gradients, and three more with
        /// meshes.
        needed: usize,
        /// Number of textures visible to a shader.
        limit: u32,
    },
    /// A volume has 16-bit labels, and the device's filterable textures have fewer bits.
    #[error("this GPU has no 16-bit textures, which labels of more than 8 bits need: draw on the CPU")]
    Labels,
    /// The picture exceeds the adapter's textures or this renderer's maximum size.
    #[error("a picture of {width_px}x{height_px} pixels is too large: at most {limit_width_px}x{limit_height_px} here")]
    PictureTooLarge {
        /// Requested width, pixels.
        width_px: u32,
        /// Requested height, pixels.
        height_px: u32,
        /// Largest width, pixels.
        limit_width_px: u32,
        /// Largest height, pixels.
        limit_height_px: u32,
    },
    /// The driver ran out of memory below the budget: lower the budget.
    #[error("the GPU has no room for {label} ({})", mebibytes(*requested_bytes))]
    OutOfMemory {
        /// The failed allocation.
        label: String,
        /// Size of the allocation, bytes.
        requested_bytes: u64,
    },
    /// The device was lost, with everything on it: see [`GpuRenderer::renew`](crate::GpuRenderer::renew).
    #[error("the GPU device was lost: {0}")]
    DeviceLost(String),
    /// A picture was not finished in the allowed time: see [`GpuRenderer::draw_until`](crate::GpuRenderer::draw_until).
    #[error("the picture was not drawn in the time allowed")]
    TooLong,
    /// The GPU or its driver refused a command.
    #[error("the GPU reported an error: {0}")]
    Refused(String),
    /// A frame, brick, list or setting does not suit this renderer.
    #[error("{0}")]
    Mismatch(String),
}
