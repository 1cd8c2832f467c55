//! Types for integer spaces: a level, a voxel, a brick, an extent and a box cannot be mixed up.
//!
//! Axis order is x, y, z everywhere in Rust; Zarr's z, y, x appears only where a store's metadata is written.

use serde::{Deserialize, Serialize};

/// A level of the pyramid; 0 is the finest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Level(pub u8);

impl Level {
    /// The level's position in a list of levels.
    pub const fn index(self) -> usize {
        self.0 as usize
    }
}

impl std::fmt::Display for Level {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.0)
    }
}

macro_rules! xyz {
    ($($(#[$doc:meta])* $name:ident)*) => {$(
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
        pub struct $name {
            /// Component along z, the slowest axis in memory (first, so that the derived order is memory order).
            pub z: u32,
            /// Component along y.
            pub y: u32,
            /// Component along x, the fastest axis in memory.
            pub x: u32,
        }

        impl $name {
            /// The value with these components along x, y and z.
            pub const fn new(x: u32, y: u32, z: u32) -> Self {
                Self { x, y, z }
            }
            /// The value with the components `[x, y, z]`.
            pub const fn from_array([x, y, z]: [u32; 3]) -> Self {
                Self { x, y, z }
            }
            /// The components as `[x, y, z]`.
            #[inline]
            pub const fn to_array(self) -> [u32; 3] {
                [self.x, self.y, self.z]
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                write!(f, "{},{},{}", self.x, self.y, self.z)
            }
        }
    )*};
}

xyz! {
    /// Counts along each axis (of voxels, or of bricks in a grid).
    Extent
    /// The position of a voxel in some level.
    VoxelIndex
    /// The position of a brick in some level's brick grid.
    BrickIndex
}

impl Extent {
    /// The number of voxels (or bricks). The product must not overflow: callers reject such extents with
    /// [`Extent::checked_volume`].
    pub const fn volume(self) -> u64 {
        self.x as u64 * self.y as u64 * self.z as u64
    }

    /// The number of voxels (or bricks), or `None` past 2^63 - 1, so it is also a valid file offset.
    pub fn checked_volume(self) -> Option<u64> {
        let product = self.x as u128 * self.y as u128 * self.z as u128;
        (product <= i64::MAX as u128).then_some(product as u64)
    }

    /// Row-major position (x fastest) of a cell.
    #[inline]
    pub const fn linear(self, [x, y, z]: [u32; 3]) -> u64 {
        (z as u64 * self.y as u64 + y as u64) * self.x as u64 + x as u64
    }

    /// Whether the cell `[x, y, z]` lies inside this extent.
    pub const fn contains(self, [x, y, z]: [u32; 3]) -> bool {
        x < self.x && y < self.y && z < self.z
    }

    /// The box of all cells of this extent.
    pub const fn full_box(self) -> VoxelBox {
        VoxelBox { min: VoxelIndex::new(0, 0, 0), max: VoxelIndex::new(self.x, self.y, self.z) }
    }
}

/// A half-open box of voxels, `min <= v < max`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
pub struct VoxelBox {
    /// First voxel inside.
    pub min: VoxelIndex,
    /// First voxel past the end on each axis.
    pub max: VoxelIndex,
}

impl VoxelBox {
    /// Creates the box between two corners `[x, y, z]`, the second exclusive.
    pub const fn new(min: [u32; 3], max: [u32; 3]) -> Self {
        Self { min: VoxelIndex::from_array(min), max: VoxelIndex::from_array(max) }
    }

    /// Voxels along each axis; zero where the box is empty.
    pub fn extent(self) -> Extent {
        let (lo, hi) = (self.min.to_array(), self.max.to_array());
        Extent::from_array(std::array::from_fn(|a| hi[a].saturating_sub(lo[a])))
    }

    /// Whether the box has no voxel.
    pub fn is_empty(self) -> bool {
        self.extent().volume() == 0
    }

    /// Iterates over the voxels `[x, y, z]` of the box in memory order: x fastest.
    pub fn voxels(self) -> impl Iterator<Item = [u32; 3]> {
        let Self { min, max } = self;
        let rows = (min.z..max.z).flat_map(move |z| (min.y..max.y).map(move |y| (y, z)));
        rows.flat_map(move |(y, z)| (min.x..max.x).map(move |x| [x, y, z]))
    }

    /// The voxels in both boxes.
    pub fn intersect(self, other: VoxelBox) -> VoxelBox {
        let pick = |a: VoxelIndex, b: VoxelIndex, f: fn(u32, u32) -> u32| {
            VoxelIndex::new(f(a.x, b.x), f(a.y, b.y), f(a.z, b.z))
        };
        let min = pick(self.min, other.min, u32::max);
        let max = pick(self.max, other.max, u32::min);
        Self { min, max: pick(max, min, u32::max) }
    }

    /// The smallest box around both.
    pub fn hull(self, other: VoxelBox) -> VoxelBox {
        let (min, max) =
            ([self.min, other.min].map(VoxelIndex::to_array), [self.max, other.max].map(VoxelIndex::to_array));
        VoxelBox::new(
            std::array::from_fn(|a| min[0][a].min(min[1][a])),
            std::array::from_fn(|a| max[0][a].max(max[1][a])),
        )
    }
}

/// The key of one brick. The derived order (time, channel, level, z, y, x) breaks every tie in the pager.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct BrickId {
    /// Time step of the brick, from 0.
    pub time: u32,
    /// Channel of the brick, from 0.
    pub channel: u32,
    /// Level of the brick.
    pub level: Level,
    /// Place of the brick in its level's brick grid.
    pub index: BrickIndex,
}

impl std::fmt::Display for BrickId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "t{} c{} level {} brick ({})", self.time, self.channel, self.level, self.index)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn linear_indices_pass_32_bits() {
        let e = Extent::new(4096, 4096, 4096);
        assert_eq!(e.linear([4095, 4095, 4095]), (1 << 36) - 1);
        assert_eq!(Extent::new(u32::MAX, u32::MAX, 2).checked_volume(), None);
        assert_eq!(Extent::new(1 << 21, 1 << 21, 1 << 20).checked_volume(), Some(1 << 62));
    }

    #[test]
    fn boxes_intersect_half_open() {
        let a = VoxelBox::new([0, 0, 0], [4, 4, 4]);
        assert!(a.intersect(VoxelBox::new([4, 0, 0], [8, 4, 4])).is_empty());
        assert_eq!(a.intersect(VoxelBox::new([3, 1, 2], [9, 2, 9])), VoxelBox::new([3, 1, 2], [4, 2, 4]));
    }

    #[test]
    fn brick_ids_order_by_time_channel_level_then_memory() {
        let id = |time, level, x, z| BrickId { time, channel: 0, level: Level(level), index: BrickIndex::new(x, 0, z) };
        let mut ids = vec![id(1, 0, 0, 0), id(0, 1, 0, 0), id(0, 0, 0, 1), id(0, 0, 5, 0)];
        ids.sort();
        assert_eq!(ids, [id(0, 0, 5, 0), id(0, 0, 0, 1), id(0, 1, 0, 0), id(1, 0, 0, 0)]);
    }
}
