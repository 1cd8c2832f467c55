//! The draw list: what is drawn for the cut now, back to front.
//!
//! Each cell is drawn with its own brick or with its nearest resident ancestor, restricted to the cell's box. One pass down
//! the cut's tree finds all of them: one look-up a node.

use crate::cut::Cut;
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
    /// The draw list of a cut, given where bricks are resident. Cells for which nothing is resident (before the first
    /// brick of a volume has arrived, or where a whole line of ancestors cannot be read) are left out.
    pub(crate) fn new(pyramid: &Pyramid, cut: &Cut, slot_of: impl Fn(BrickId) -> Option<Slot>) -> Self {
        let mut stand_ins: Vec<Option<(BrickId, Slot)>> = Vec::with_capacity(cut.nodes.len());
        for (position, node) in cut.nodes.iter().enumerate() {
            let id = cut.id(position as u32);
            // A root's parent is itself: not in the list yet.
            let inherited = stand_ins.get(node.parent as usize).copied().flatten();
            stand_ins.push(slot_of(id).map(|slot| (id, slot)).or(inherited));
        }
        let draw = |&position: &u32| {
            let (brick, slot) = stand_ins[position as usize]?;
            let cell = cut.id(position);
            Some(DrawCell { cell, region: pyramid.brick_box_voxel(cell.level, cell.index), brick, slot })
        };
        Self { cells: cut.cells.iter().filter_map(draw).collect() }
    }
}
