//! Parts of boxes: blocks, pieces to read at once, the rest without another box, and places counted from a box's corner. Costs a few numbers a box.

use crate::source::Access;
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

/// Parts of a box, at most `steps` voxels along each axis, x fastest.
pub(crate) fn blocks(region: VoxelBox, steps: [u32; 3]) -> impl Iterator<Item = VoxelBox> + use<> {
    let (low, high) = (region.min.to_array(), region.max.to_array());
    let along = move |axis: usize| {
        let step = steps[axis];
        (low[axis]..high[axis]).step_by(step as usize).map(move |at| (at, at.saturating_add(step).min(high[axis])))
    };
    along(2)
        .flat_map(move |z| along(1).flat_map(move |y| along(0).map(move |x| (x, y, z))))
        .map(|(x, y, z): ((u32, u32), (u32, u32), (u32, u32))| VoxelBox::new([x.0, y.0, z.0], [x.1, y.1, z.1]))
}

/// The largest parts of a box to read at once, of `most` voxels or of a plane: planes, rows or parts of rows. They follow each other in memory, as
/// each is whole along all axes but its slowest.
pub(crate) fn pieces(region: VoxelBox, access: Access, most: u64) -> impl Iterator<Item = VoxelBox> + use<> {
    let extent = region.extent();
    let x = u64::from(extent.x).min(most);
    let y = u64::from(extent.y).min(most / x).max(1);
    let z = u64::from(extent.z).min(most / (x * y)).max(1);
    // Rows of several planes are never read together, so that pieces stay in order.
    let z = if y < u64::from(extent.y) { 1 } else { z as u32 };
    let steps = match access {
        // A plane in parts would be decoded for each.
        Access::Planes => [extent.x, extent.y, z],
        Access::Box => [x as u32, y as u32, z],
    };
    blocks(region, steps)
}
