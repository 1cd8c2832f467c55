//! The bricks that are wanted of a volume, by name and by view.

use crate::cut::Cut;
use brickyard_volume::{BrickId, Pyramid};

/// A brick of one of the volumes that share the slots, with the volume's index among them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub(crate) struct VolumeBrick {
    pub(crate) volume: usize,
    pub(crate) id: BrickId,
}

/// The bricks of a volume that a view wants.
#[derive(Clone, Copy)]
pub(crate) struct Goal<'a> {
    pub(crate) pyramid: &'a Pyramid,
    pub(crate) cut: &'a Cut,
    /// The volume's coarsest bricks, without which nothing is drawn.
    pub(crate) roots: &'a [BrickId],
}
