//! The draw list: what is drawn for the cut now, back to front.
//!
//! Each visible cell is drawn with its own brick or with its nearest resident ancestor, restricted to the cell's box. One pass
//! down the cut's tree finds all of them: one look-up a node.

use crate::cut::{Cut, Node};
use crate::sight::Sight;
use brickyard_volume::{BrickId, Pyramid, VoxelBox};

/// A place for one padded brick in the atlas.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Slot(pub u32);

/// One cell of the cut and the resident brick that stands for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DrawCell {
    /// The cell: a brick's place in the octree.
    pub cell: BrickId,
    /// The cell's half-open box in level-0 voxels: where this entry draws.
    pub region: VoxelBox,
    /// The brick whose voxels are drawn: the cell's own, or its nearest resident ancestor.
    pub brick: BrickId,
    /// Where that brick is.
    pub slot: Slot,
}

/// Cells in back-to-front order, disjoint, covering what of the volume is visible and not empty.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DrawList {
    /// Back to front.
    pub cells: Vec<DrawCell>,
}

impl DrawList {
    /// What a view sees of a cut, given what stands for its nodes. Cells for which nothing is resident (before the first
    /// brick of a volume has arrived, or where a whole line of ancestors cannot be read) are left out.
    pub(crate) fn new(pyramid: &Pyramid, cut: &Cut, sight: &Sight, stand_ins: &StandIns) -> Self {
        let draw = |&position: &u32| {
            let (stand_in, slot) = stand_ins.of(position)?;
            let (cell, brick) = (cut.id(position), cut.id(stand_in));
            Some(DrawCell { cell, region: pyramid.brick_box_voxel(cell.level, cell.index), brick, slot })
        };
        Self { cells: sight.cells.iter().filter_map(draw).collect() }
    }
}

/// Which nodes of a cut are resident, and the nearest that is on the way up from each.
#[derive(Clone, Debug)]
pub(crate) struct StandIns {
    own: Vec<Option<Slot>>,
    /// Positions; [`NONE`] where nothing is resident.
    nearest: Vec<u32>,
}

const NONE: u32 = u32::MAX;

impl StandIns {
    /// Looks up the nodes that `concerns` us; the others count as absent.
    pub(crate) fn new(cut: &Cut, concerns: impl Fn(&Node) -> bool, slot_of: impl Fn(BrickId) -> Option<Slot>) -> Self {
        let mut own = Vec::with_capacity(cut.nodes.len());
        let mut nearest: Vec<u32> = Vec::with_capacity(cut.nodes.len());
        for (node, position) in cut.nodes.iter().zip(0..) {
            let slot = if concerns(node) { slot_of(cut.id(position)) } else { None };
            // A root's parent is itself: not in the list yet.
            let inherited = nearest.get(node.parent as usize).copied().unwrap_or(NONE);
            nearest.push(if slot.is_some() { position } else { inherited });
            own.push(slot);
        }
        Self { own, nearest }
    }

    pub(crate) fn is_resident(&self, position: u32) -> bool {
        self.own[position as usize].is_some()
    }

    /// The nearest resident node on the way up from this one, and its slot.
    pub(crate) fn of(&self, position: u32) -> Option<(u32, Slot)> {
        let nearest = self.nearest[position as usize];
        self.own.get(nearest as usize).copied().flatten().map(|slot| (nearest, slot))
    }
}
