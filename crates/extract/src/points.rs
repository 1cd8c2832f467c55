//! Voxels around a block, with the part of them that a request covers.

use brickyard_volume::VoxelBox;

/// Most voxels along a row: the bits of its masks.
pub(crate) const MOST_POINTS: usize = 128;

/// A box of voxels, x fastest; it may reach past the requested region.
pub(crate) struct Points<T> {
    /// The first voxel, `[x, y, z]`.
    pub(crate) corner: [i64; 3],
    /// Voxels along each axis.
    pub(crate) size: [usize; 3],
    /// The values; zeros outside of the region.
    pub(crate) values: Vec<T>,
    /// The region within the box, from its first voxel.
    covered: [std::ops::Range<usize>; 3],
}

impl<T: bytemuck::Zeroable + Copy> Points<T> {
    /// The voxels from `first` to `last`, both included, without values yet.
    pub(crate) fn new(first: [i64; 3], last: [i64; 3], region: VoxelBox) -> Self {
        let size: [usize; 3] = std::array::from_fn(|a| (last[a] - first[a] + 1) as usize);
        let (min, max) = (region.min.to_array(), region.max.to_array());
        let covered = std::array::from_fn(|a| {
            let within = |voxel: u32| (i64::from(voxel) - first[a]).clamp(0, size[a] as i64) as usize;
            within(min[a])..within(max[a])
        });
        Self { corner: first, size, values: vec![T::zeroed(); size.iter().product()], covered }
    }

    /// The covered voxels as a box of the level; `None` if there are none.
    pub(crate) fn covered_box(&self) -> Option<VoxelBox> {
        if self.covered.iter().any(|range| range.is_empty()) {
            return None;
        }
        let at = |a: usize, within: usize| (self.corner[a] + within as i64) as u32;
        let min = std::array::from_fn(|a| at(a, self.covered[a].start));
        Some(VoxelBox::new(min, std::array::from_fn(|a| at(a, self.covered[a].end))))
    }

    /// Whether the region covers the whole box.
    pub(crate) fn is_covered(&self) -> bool {
        (0..3).all(|a| self.covered[a] == (0..self.size[a]))
    }

    /// Whether the region covers the voxel.
    pub(crate) fn covers(&self, [x, y, z]: [usize; 3]) -> bool {
        self.covered[0].contains(&x) && self.covered[1].contains(&y) && self.covered[2].contains(&z)
    }

    /// Position of a row's first value.
    pub(crate) fn row(&self, y: usize, z: usize) -> usize {
        (z * self.size[1] + y) * self.size[0]
    }

    /// The covered voxels of each row that fulfil `is_it`, as masks; rows follow one another like the values.
    pub(crate) fn masks(&self, is_it: impl Fn(T) -> bool) -> Vec<u128> {
        let mut masks = vec![0; self.size[1] * self.size[2]];
        for z in self.covered[2].clone() {
            for y in self.covered[1].clone() {
                let row = self.row(y, z);
                let bit = |mask: u128, x: usize| mask | u128::from(is_it(self.values[row + x])) << x;
                masks[z * self.size[1] + y] = self.covered[0].clone().fold(0, bit);
            }
        }
        masks
    }
}

/// The lowest `count` bits.
pub(crate) fn lowest(count: usize) -> u128 {
    if count < MOST_POINTS { (1 << count) - 1 } else { u128::MAX }
}

/// The positions of the bits of a mask, ascending.
pub(crate) fn bits(mut mask: u128) -> impl Iterator<Item = usize> {
    std::iter::from_fn(move || {
        let at = mask.trailing_zeros();
        mask &= mask.wrapping_sub(1);
        (at < u128::BITS).then_some(at as usize)
    })
}
