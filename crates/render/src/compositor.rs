//! The ways to gather samples.

/// How the samples of a frame are gathered. All take the same samples and make the same picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Compositor {
    /// Cells as boxes, back to front, blended.
    Sorted,
    /// A ray per pixel, front to back, with early termination and skips what shows nothing.
    #[default]
    Raycast,
    /// The same rays, cast by a compute shader instead of a fragment shader.
    Compute,
}

impl Compositor {
    /// `sorted`, `raycast` or `compute`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sorted => "sorted",
            Self::Raycast => "raycast",
            Self::Compute => "compute",
        }
    }
}
