//! Parts of boxes: the rest without another box, and places counted from a box's corner. Costs a few numbers a box.

use brickyard_volume::VoxelBox;

/// The rest of a box without a piece of it.
pub(crate) fn without(whole: VoxelBox, piece: VoxelBox) -> Vec<VoxelBox> {
    let shared = whole.intersect(piece);
    if shared.is_empty() {
        return vec![whole];
    }
    let (mut low, mut high) = (whole.min.to_array(), whole.max.to_array());
    let [from, to] = [shared.min.to_array(), shared.max.to_array()];
    let mut rest = Vec::new();
    for axis in 0..3 {
        let mut below = high;
        below[axis] = from[axis];
        rest.push(VoxelBox::new(low, below));
        let mut above = low;
        above[axis] = to[axis];
        rest.push(VoxelBox::new(above, high));
        (low[axis], high[axis]) = (from[axis], to[axis]);
    }
    rest.retain(|left| !left.is_empty());
    rest
}

/// A box of a whole, counted from a piece's first voxel.
pub(crate) fn inside(piece: VoxelBox, region: VoxelBox) -> VoxelBox {
    let [first, min, max] = [piece.min, region.min, region.max].map(|index| index.to_array());
    let moved = |corner: [u32; 3]| std::array::from_fn(|axis| corner[axis] - first[axis]);
    VoxelBox::new(moved(min), moved(max))
}
