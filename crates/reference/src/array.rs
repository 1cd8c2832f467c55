//! Levels as whole arrays: values at points, and coarser levels as means of finer ones.

use brickyard_volume::{Extent, Filter, LevelGrid, Pyramid, Voxel, VoxelType, sampling, with_voxel_type};
use glam::DVec3;

/// One level as a whole array of data values; NaN marks invalid voxels.
#[derive(Clone, Debug)]
pub struct Array {
    /// Voxels along each axis.
    pub extent: Extent,
    /// Level-0 voxels per voxel of this level, along each axis.
    pub factor: [u32; 3],
    /// `extent.volume()` values, x fastest.
    pub values: Vec<f64>,
}

impl Array {
    /// Builds a level from a function of its integer voxel coordinates.
    pub fn from_fn(grid: &LevelGrid, value: impl Fn([u32; 3]) -> f64) -> Self {
        let LevelGrid { extent, factor, .. } = *grid;
        let mut values = Vec::with_capacity(extent.volume() as usize);
        values.extend(extent.full_box().voxels().map(value));
        Self { extent, factor, values }
    }

    /// Builds a level from its little-endian voxels, x fastest. Infinite values and voxels of the value `nodata` are
    /// invalid too, and become NaN.
    ///
    /// # Panics
    /// If `bytes` does not hold exactly the voxels of the level.
    pub fn from_bytes(grid: &LevelGrid, voxel_type: VoxelType, nodata: Option<f64>, bytes: &[u8]) -> Self {
        fn decode<T: Voxel>(bytes: &[u8], nodata: Option<f64>) -> Vec<f64> {
            let is_valid = |v: T| v.is_valid() && nodata != Some(v.to_f64());
            let value = |v: T| if is_valid(v) { v.to_f64() } else { f64::NAN };
            bytes.chunks_exact(size_of::<T>()).map(|b| value(bytemuck::pod_read_unaligned(b))).collect()
        }
        let values = with_voxel_type!(voxel_type, T => decode::<T>(bytes, nodata));
        assert_eq!(values.len() as u64, grid.extent.volume(), "bytes do not fill the level");
        Self { extent: grid.extent, factor: grid.factor, values }
    }

    /// The voxel at an index; past a face, the outermost voxel.
    fn voxel(&self, index: [i64; 3]) -> f64 {
        let n = self.extent.to_array();
        let inside = std::array::from_fn(|a| index[a].clamp(0, n[a] as i64 - 1) as u32);
        self.values[self.extent.linear(inside) as usize]
    }

    /// Differences of the values across two voxels along each axis at a point, interpolated between nodes in the middle
    /// of eight voxels each: see [`gradients`](brickyard_volume::gradients).
    pub(crate) fn stored_differences(&self, point: DVec3) -> DVec3 {
        let p = DVec3::from_array(std::array::from_fn(|a| (point[a] / self.factor[a] as f64 - 1.0) / 2.0));
        let (base, t) = (p.floor(), p - p.floor());
        let mut sum = DVec3::ZERO;
        for corner in (0..8).map(|i| [i & 1, i >> 1 & 1, i >> 2].map(f64::from)) {
            let weight: f64 = (0..3).map(|a| if corner[a] > 0.0 { t[a] } else { 1.0 - t[a] }).product();
            let node = base + DVec3::from_array(corner);
            sum += weight * self.node_differences(node.as_i64vec3().to_array());
        }
        sum
    }

    /// The differences at a node: the means of its eight voxels' known differences, and 0 where none is known.
    fn node_differences(&self, node: [i64; 3]) -> DVec3 {
        let last = self.extent.to_array().map(|n| n as i64 - 1);
        let low: [i64; 3] = std::array::from_fn(|a| (2 * node[a]).min(last[a] - 1).max(0));
        let along = |a: usize| {
            let pairs = (0..8i64).map(|i| [i & 1, i >> 1 & 1, i >> 2]).filter(|corner| corner[a] == 0);
            let difference = |corner: [i64; 3]| {
                let near: [i64; 3] = std::array::from_fn(|k| low[k] + corner[k]);
                let mut far = near;
                far[a] += 1;
                self.voxel(far) - self.voxel(near)
            };
            let known = pairs.map(difference).filter(|d| d.is_finite());
            let (sum, count) = known.fold((0.0, 0), |(sum, count), d| (sum + d, count + 1));
            2.0 * sum / count.max(1) as f64
        };
        DVec3::new(along(0), along(1), along(2))
    }

    /// Returns the value of the voxel around a point of voxel space (level-0 voxels). `None` if the voxel is invalid.
    /// Past a face, the last voxels repeat.
    pub fn nearest(&self, point: DVec3) -> Option<f64> {
        let index = std::array::from_fn(|a| (point[a] / self.factor[a] as f64).floor() as i64);
        Some(self.voxel(index)).filter(|value| value.is_finite())
    }

    /// Returns a label's indicator at a point of voxel space: the field that is 1 in voxels of that label and 0 in all
    /// others, filtered linearly.
    pub fn indicator(&self, point: DVec3, label: f64) -> f64 {
        let p = DVec3::from_array(std::array::from_fn(|a| point[a] / self.factor[a] as f64 - 0.5));
        let (base, t) = (p.floor(), p - p.floor());
        let share = |corner: [i64; 3]| {
            let weight: f64 = (0..3).map(|a| if corner[a] == 1 { t[a] } else { 1.0 - t[a] }).product();
            let voxel = self.voxel(std::array::from_fn(|a| base[a] as i64 + corner[a]));
            if voxel == label { weight } else { 0.0 }
        };
        (0..8).map(|i| share([i & 1, i >> 1 & 1, i >> 2])).sum()
    }

    /// The valid values of the voxels touched by a box about a point of voxel space (level-0 voxels); `half` is from
    /// the point to the box's faces, in voxels of the level. Past a face, the last voxels repeat.
    pub(crate) fn touched(&self, point: DVec3, half: [f64; 3]) -> impl Iterator<Item = f64> {
        let along = |a: usize| {
            let middle = point[a] / self.factor[a] as f64;
            (middle - half[a]).floor() as i64..=(middle + half[a]).floor() as i64
        };
        let [x, y, z] = [0, 1, 2].map(along);
        let places = z.flat_map(move |z| {
            let x = x.clone();
            y.clone().flat_map(move |y| x.clone().map(move |x| [x, y, z]))
        });
        places.map(|place| self.voxel(place)).filter(|value| value.is_finite())
    }

    /// Returns the filtered value at a point of voxel space (level-0 voxels). Invalid voxels are left out; `None` if
    /// they hold more than half the weight. Past a face, the last voxels repeat.
    pub fn sample(&self, point: DVec3, filter: Filter) -> Option<f64> {
        if filter == Filter::Nearest {
            return self.nearest(point);
        }
        let p: [f64; 3] = std::array::from_fn(|a| point[a] / self.factor[a] as f64 - 0.5);
        let base = p.map(|v| v.floor());
        // From one voxel below the place to two above it.
        let weights: [[f64; 4]; 3] = std::array::from_fn(|a| match p[a] - base[a] {
            t if filter == Filter::Tricubic => sampling::b_spline(t),
            t => [0.0, 1.0 - t, t, 0.0],
        });
        // Their offsets among the values; past a face the last one is replicated.
        let n = self.extent.to_array().map(|n| n as i64);
        let strides = [1, n[0], n[0] * n[1]];
        let offsets: [[i64; 4]; 3] = std::array::from_fn(|a| {
            std::array::from_fn(|i| (base[a] as i64 + i as i64 - 1).clamp(0, n[a] - 1) * strides[a])
        });
        // The two or four of them with a weight.
        let taps = match filter {
            Filter::Nearest | Filter::Trilinear => 1..3,
            Filter::Tricubic => 0..4,
        };
        // Summed relative to the first value: equal values give exactly that value.
        let (mut middle, mut sum, mut weight) = (None, 0.0, 0.0);
        for (z, y) in taps.clone().flat_map(|z| taps.clone().map(move |y| (z, y))) {
            for x in taps.clone() {
                let w = weights[0][x] * weights[1][y] * weights[2][z];
                let value = self.values[(offsets[0][x] + offsets[1][y] + offsets[2][z]) as usize];
                if value.is_finite() {
                    sum += w * (value - *middle.get_or_insert(value));
                    weight += w;
                }
            }
        }
        middle.filter(|_| weight >= 0.5).map(|middle| middle + sum / weight)
    }
}

/// Returns a function for [`ReferenceVolume::level_at`](crate::ReferenceVolume::level_at) with the same level
/// everywhere.
pub fn one_level(level: usize) -> impl Fn(DVec3) -> usize {
    move |_| level
}

/// Builds all levels of a volume from its level 0: each voxel is the mean of the valid finer voxels in its box, in f64
/// and unrounded; NaN where there are none.
pub fn mean_levels(pyramid: &Pyramid, finest: Array) -> Vec<Array> {
    let mut levels = vec![finest];
    for grid in &pyramid.levels()[1..] {
        let fine = &levels[levels.len() - 1];
        let step: [u32; 3] = std::array::from_fn(|a| grid.factor[a] / fine.factor[a]);
        let n = fine.extent.to_array();
        let coarse = Array::from_fn(grid, |index| {
            let (mut sum, mut count) = (0.0, 0);
            for corner in 0..8u32 {
                let bit: [u32; 3] = std::array::from_fn(|a| corner >> a & 1);
                let at: [u32; 3] = std::array::from_fn(|a| index[a] * step[a] + bit[a]);
                if (0..3).any(|a| bit[a] >= step[a] || at[a] >= n[a]) {
                    continue;
                }
                let value = fine.values[fine.extent.linear(at) as usize];
                if value.is_finite() {
                    sum += value;
                    count += 1;
                }
            }
            if count > 0 { sum / count as f64 } else { f64::NAN }
        });
        levels.push(coarse);
    }
    levels
}
