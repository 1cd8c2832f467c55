//! Random boxes of one brick's size. Box `i` of a seed is a simple formula, so that other readers can use the same boxes:
//!
//! ```text
//! mix(k)    = SplitMix64: z = seed + (k + 1) * 0x9E3779B97F4A7C15; z = (z ^ z >> 30) * 0xBF58476D1CE4E5B9;
//!             z = (z ^ z >> 27) * 0x94D049BB133111EB; z ^ z >> 31                                          (modulo 2^64)
//! corner[a] = mix(3 i + a) mod (extent[a] - edge + 1)         a = 0, 1, 2 for x, y, z
//! aligned   = the corner moved down to a multiple of the edge
//! ```

use brickyard_volume::{Extent, VoxelBox};

/// Placement of the boxes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Placement {
    /// On the brick grid: one brick each.
    Aligned,
    /// At any voxel: up to eight bricks each.
    Offset,
}

/// Box `i` of `edge`^3 voxels inside the extent, which is at least `edge` along every axis.
pub fn random_box(seed: u64, i: u64, extent: Extent, edge: u32, placement: Placement) -> VoxelBox {
    let n = extent.to_array();
    let corner = std::array::from_fn(|a| {
        let at = (mix(seed, 3 * i + a as u64) % (n[a] - edge + 1) as u64) as u32;
        if placement == Placement::Aligned { at / edge * edge } else { at }
    });
    VoxelBox::new(corner, corner.map(|c| c + edge))
}

fn mix(seed: u64, k: u64) -> u64 {
    let z = seed.wrapping_add((k + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15));
    let z = (z ^ z >> 30).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ z >> 27).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ z >> 31
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The first numbers of SplitMix64 with seed 1234567, as printed by its author's C program.
    #[test]
    fn the_formula_is_splitmix64() {
        assert_eq!([0, 1, 2].map(|k| mix(1234567, k)), [6457827717110365317, 3203168211198807973, 9817491932198370423]);
    }

    #[test]
    fn boxes_stay_inside() {
        let extent = Extent::new(64, 100, 129);
        for i in 0..1000 {
            for placement in [Placement::Aligned, Placement::Offset] {
                let region = random_box(1, i, extent, 64, placement);
                assert_eq!(region.intersect(extent.full_box()), region);
                assert_eq!(region.extent(), Extent::new(64, 64, 64));
            }
        }
    }
}
