//! What can go wrong on the GPU, by what the caller can do about it.

/// An error of the GPU backend.
#[derive(Clone, Debug, thiserror::Error, PartialEq)]
pub enum GpuError {
    /// No adapter of the kind asked for: use the CPU backend.
    #[error("no {wanted} found{seen}: install a Vulkan driver (mesa-vulkan-drivers for a software one)")]
    NoAdapter {
        /// The kind asked for.
        wanted: &'static str,
        /// The adapters there are, for the message; empty if none.
        seen: String,
    },
    /// The adapter would not give a device.
    #[error("{adapter} gives no device: {reason}")]
    Device {
        /// The adapter's name.
        adapter: String,
        /// The driver's words.
        reason: String,
    },
    /// The budget cannot hold the picture and a few bricks.
    #[error(
        "{given_bytes} bytes of GPU memory are too few: pictures of {width_px}x{height_px} pixels with bricks of {slot_edge}^3 texels \
         need at least {least_bytes}"
    )]
    Budget {
        /// What was given.
        given_bytes: u64,
        /// The least that works.
        least_bytes: u64,
        /// Picture width.
        width_px: u32,
        /// Picture height.
        height_px: u32,
        /// Padded brick edge.
        slot_edge: u32,
    },
    /// The meshes are larger than what a shader can see.
    #[error(
        "the meshes take {bytes} bytes, and a shader sees {limit_bytes} here: leave out some of their vertices, or draw on the CPU"
    )]
    Meshes {
        /// What their vertices or triangles take.
        bytes: u64,
        /// What a shader sees of a buffer.
        limit_bytes: u64,
    },
    /// Shaders see fewer textures than there are volumes.
    #[error(
        "the {volumes} volumes of one picture need {needed} textures, and this GPU's shaders see {limit}: show fewer, or draw on the CPU"
    )]
    Textures {
        /// Volumes asked for.
        volumes: usize,
        /// Textures they need: one each, and another one where there are stored gradients.
        needed: usize,
        /// Textures there are.
        limit: u32,
    },
    /// The picture is larger than the adapter's textures, or than this renderer was made for.
    #[error("a picture of {width_px}x{height_px} pixels is too large: at most {limit_width_px}x{limit_height_px} here")]
    PictureTooLarge {
        /// Width asked for.
        width_px: u32,
        /// Height asked for.
        height_px: u32,
        /// Greatest width.
        limit_width_px: u32,
        /// Greatest height.
        limit_height_px: u32,
    },
    /// The driver ran out of memory below the budget: lower the budget.
    #[error("the GPU has no room for {label} ({requested_bytes} bytes)")]
    OutOfMemory {
        /// What was being made.
        label: String,
        /// Its size.
        requested_bytes: u64,
    },
    /// The device is gone; everything on it too: see [`GpuRenderer::renew`](crate::GpuRenderer::renew).
    #[error("the GPU device was lost: {0}")]
    DeviceLost(String),
    /// The GPU refused a command.
    #[error("the GPU reported an error: {0}")]
    Refused(String),
    /// A brick, table or encoding that is not what this renderer was made for.
    #[error("{0}")]
    Mismatch(String),
}
