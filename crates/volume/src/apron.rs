//! The apron of a brick as one array: the voxels around its core, in stored order.
//!
//! ```text
//! low z, high z    padded x padded x width     the padded brick's whole z faces
//! low y, high y    padded x width x edge       its y faces between the z slabs
//! low x, high x    width x edge x edge         its x faces between the z and y slabs
//! ```
//!
//! Six consecutive slabs, each a box with x fastest. Every voxel of the padded brick lies in the core or in exactly one slab.
//! Slabs compress and copy better than rows with a hole. A voxel outside the level has the value of the nearest one inside.

use crate::space::VoxelBox;

/// Widest stored apron, in voxels: 1 for trilinear samples, 2 for gradients or tricubic ones. Rarer wider aprons are assembled
/// from neighbouring bricks.
pub const MAX_APRON: u32 = 2;

/// The shape of an apron around a brick's core.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Apron {
    /// Voxels along the core's edge.
    pub edge: u32,
    /// Width of the apron: voxels on each side of the core.
    pub width: u32,
}

impl Apron {
    /// Voxels along the padded brick's edge.
    pub const fn padded(self) -> u32 {
        self.edge + 2 * self.width
    }

    /// Number of voxels in the apron, without the core.
    pub const fn voxels(self) -> usize {
        (self.padded() as usize).pow(3) - (self.edge as usize).pow(3)
    }

    /// The six slabs in stored order, as boxes of the padded brick, whose first voxel is (0, 0, 0).
    pub const fn slabs(self) -> [VoxelBox; 6] {
        let (low, high, end) = (self.width, self.width + self.edge, self.padded());
        [
            VoxelBox::new([0, 0, 0], [end, end, low]),
            VoxelBox::new([0, 0, high], [end, end, end]),
            VoxelBox::new([0, 0, low], [end, low, high]),
            VoxelBox::new([0, high, low], [end, end, high]),
            VoxelBox::new([0, low, low], [low, high, high]),
            VoxelBox::new([high, low, low], [end, high, high]),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slabs_are_all_but_the_core_once() {
        for (edge, width) in [(8, 1), (8, 2), (64, 1), (1, 2)] {
            let apron = Apron { edge, width };
            let (core, end) = (VoxelBox::new([width; 3], [width + edge; 3]), apron.padded());
            let inside = |b: &VoxelBox, p: [u32; 3]| !b.intersect(VoxelBox::new(p, p.map(|v| v + 1))).is_empty();
            for i in 0..end.pow(3) {
                let p = [i % end, i / end % end, i / end / end];
                let count = apron.slabs().iter().filter(|slab| inside(slab, p)).count();
                assert_eq!(count + inside(&core, p) as usize, 1, "{apron:?} {p:?}");
            }
            let voxels: u64 = apron.slabs().iter().map(|slab| slab.extent().volume()).sum();
            assert_eq!(voxels as usize, apron.voxels());
        }
    }
}
