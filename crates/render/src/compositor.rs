//! The available compositors.

/// How the samples of a frame are gathered. All compositors take the same samples and produce the same picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Compositor {
    /// Draws cells as boxes, back to front, and blends them.
    Sorted,
    /// Casts a ray per pixel, front to back, with early ray termination and empty-space skipping.
    #[default]
    Raycast,
    /// Casts the same rays as [`Compositor::Raycast`], in a compute shader instead of a fragment shader.
    Compute,
}

impl Compositor {
    /// The other one of `sorted` and `raycast`; `None` for `compute`.
    pub(crate) fn other(self) -> Option<Self> {
        match self {
            Self::Sorted => Some(Self::Raycast),
            Self::Raycast => Some(Self::Sorted),
            Self::Compute => None,
        }
    }

    /// The compositor's name: `sorted`, `raycast` or `compute`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sorted => "sorted",
            Self::Raycast => "raycast",
            Self::Compute => "compute",
        }
    }
}
