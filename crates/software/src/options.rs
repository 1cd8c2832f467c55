//! What a renderer may use.

/// What a [`SoftwareRenderer`](crate::SoftwareRenderer) may use, and how it draws; fixed for the renderer's life.
#[derive(Clone, Copy, Debug)]
pub struct SoftwareOptions {
    /// The most memory, in bytes, that the slots and everything else of the renderer may take.
    pub memory_bytes: u64,
    /// Width and height of the largest picture, in pixels.
    pub max_picture_px: [u32; 2],
    /// The number of threads that draw; 0 counts as 1.
    pub threads: usize,
    /// Whether rays skip space that shows nothing. If not, pictures are the same but take longer.
    pub skips_empty: bool,
}
