//! What a renderer may use.

/// What a renderer may use, and how it draws; fixed for its life.
#[derive(Clone, Copy, Debug)]
pub struct SoftwareOptions {
    /// The most that slots and everything else of the renderer may take.
    pub memory_bytes: u64,
    /// Width and height of the largest picture.
    pub max_picture_px: [u32; 2],
    /// Threads that draw; at least 1.
    pub threads: usize,
    /// Whether rays skip what shows nothing; without, pictures are the same and take longer.
    pub skips_empty: bool,
}
