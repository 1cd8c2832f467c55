//! Wanted bricks of a volume, by name and by view.

use crate::cut::Cut;
use brickyard_volume::{BrickId, Pyramid};

/// A brick, and the index of its volume among those sharing slots.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct VolumeBrick {
    pub(crate) volume: usize,
    pub(crate) id: BrickId,
}

/// A view's wanted bricks of one volume.
#[derive(Clone, Copy)]
pub(crate) struct Goal<'a> {
    pub(crate) pyramid: &'a Pyramid,
    pub(crate) cut: &'a Cut,
    /// The volume's coarsest bricks, without which nothing is drawn.
    pub(crate) roots: &'a [BrickId],
}
