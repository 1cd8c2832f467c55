//! The draw list: what is drawn for the cut now, back to front.

use brickyard_volume::{BrickId, VoxelBox};

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
