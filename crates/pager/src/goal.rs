//! Wanted bricks of a volume, by name and by view.

use crate::cut::{Cut, NodeId};
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
}

impl<'a> Goal<'a> {
    /// The volume's coarsest bricks, without which nothing is drawn.
    pub(crate) fn roots(self) -> impl Iterator<Item = BrickId> + use<'a> {
        NodeId::range(NodeId(0), self.cut.roots).map(move |root| self.cut.id(root))
    }
}
