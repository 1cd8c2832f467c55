//! The renderer's options.

/// Resources and settings of a [`SoftwareRenderer`](crate::SoftwareRenderer), fixed for its life.
#[derive(Clone, Copy, Debug)]
pub struct SoftwareOptions {
    /// The memory budget for slots and everything else of the renderer, in bytes.
    pub memory_bytes: u64,
    /// Width and height of the largest picture, in pixels.
    pub max_picture_px: [u32; 2],
    /// The number of drawing threads; 0 counts as 1.
    pub threads: usize,
    /// Whether rays skip empty space. If not, pictures are the same but take longer.
    pub skips_empty: bool,
}
