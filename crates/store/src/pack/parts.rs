//! Ranges of a brick's parts: of all its voxels, and of those within one-voxel reach of each of its 26 neighbours
//! (faces, edges, corners).
//!
//! Such a part is a neighbour's share of its apron. So the range of a brick *with* its surroundings joins its own with
//! its neighbours' parts, and no voxel is read twice or waits for the next slice.
//!
//! Rows fall into nine classes (first, inner, last along y and z); each keeps its least and greatest voxels by column.
//! Cost: one pass of two vector operations a voxel, about 15 us for 64^3.

use crate::downsample::MAX_EDGE;
use crate::stats::{Measure, Range};

/// A brick's ranges by direction: along each axis -1 (the first voxels), 0 (all voxels) or 1 (the last voxels).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Parts<T>([Range<T>; 27]);

/// All 27 directions, including (0, 0, 0) for the brick itself.
pub(crate) fn directions() -> impl Iterator<Item = [i32; 3]> {
    (0..27).map(|i| [i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1])
}

impl<T: Measure> Parts<T> {
    /// The parts of a brick whose parts all have the same range.
    pub(crate) fn uniform(range: Range<T>) -> Self {
        Self([range; 27])
    }

    pub(crate) fn whole(&self) -> Range<T> {
        self.toward([0; 3])
    }

    /// The range of the voxels touching the neighbour in direction `d`.
    pub(crate) fn toward(&self, d: [i32; 3]) -> Range<T> {
        self.0[place(d.map(|d| (d + 1) as usize))]
    }

    /// Measures the first `shape` voxels of an `edge`^3 core, whose rows are padded with their last voxel, without
    /// `nodata` voxels.
    #[inline(always)]
    pub(crate) fn of(core: &[T], edge: usize, shape: [usize; 3], nodata: Option<T>) -> Self {
        let classes = |n: usize| [0..1, 1..n.max(2) - 1, n - 1..n];
        let mut parts = [T::EMPTY; 27];
        for (z, slices) in classes(shape[2]).into_iter().enumerate() {
            for (y, rows) in classes(shape[1]).into_iter().enumerate() {
                let mut columns = Columns::empty();
                for slice in slices.clone() {
                    for row in rows.clone() {
                        let row = &core[(slice * edge + row) * edge..][..edge];
                        match nodata {
                            None => columns.add(row),
                            Some(nodata) => columns.add_without(row, nodata),
                        }
                    }
                }
                let along_x = [columns.at(0), columns.all(edge), columns.at(shape[0] - 1)];
                // A class belongs to the parts spanning all of y, all of z, or both; joining twice is harmless.
                for (z, y) in [(z, y), (z, ALL), (ALL, y), (ALL, ALL)] {
                    for (x, range) in along_x.into_iter().enumerate() {
                        let part = &mut parts[place([x, y, z])];
                        *part = part.join(range);
                    }
                }
            }
        }
        Self(parts)
    }
}

/// The middle class, and so a direction of 0.
const ALL: usize = 1;

const fn place([x, y, z]: [usize; 3]) -> usize {
    x + 3 * y + 9 * z
}

/// Least and greatest valid voxels, column by column.
struct Columns<T> {
    low: [T; MAX_EDGE],
    high: [T; MAX_EDGE],
}

impl<T: Measure> Columns<T> {
    fn empty() -> Self {
        Self { low: [T::EMPTY.low; MAX_EDGE], high: [T::EMPTY.high; MAX_EDGE] }
    }

    #[inline(always)]
    fn add(&mut self, row: &[T]) {
        for ((low, high), &v) in self.low.iter_mut().zip(&mut self.high).zip(row) {
            *low = T::lower(*low, v);
            *high = T::upper(*high, v);
        }
    }

    /// Adds a row without its `nodata` voxels. Not inlined, to leave the loop of [`Columns::add`] unaffected.
    #[inline(never)]
    fn add_without(&mut self, row: &[T], nodata: T) {
        for ((low, high), &v) in self.low.iter_mut().zip(&mut self.high).zip(row) {
            let (lower, upper) = (T::lower(*low, v), T::upper(*high, v));
            *low = if v == nodata { *low } else { lower };
            *high = if v == nodata { *high } else { upper };
        }
    }

    fn at(&self, x: usize) -> Range<T> {
        Range { low: self.low[x], high: self.high[x] }
    }

    fn all(&self, edge: usize) -> Range<T> {
        (0..edge).fold(T::EMPTY, |range, x| range.join(self.at(x)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Every part against a plain loop over its voxels.
    fn check<T: Measure + std::fmt::Debug>(shape: [usize; 3], value: impl Fn(usize) -> T, nodata: Option<T>) {
        const EDGE: usize = 8;
        let at = |p: [usize; 3]| value((p[2] * EDGE + p[1]) * EDGE + p[0]);
        // Only rows are padded: voxels past the shape along y and z must not matter.
        let core: Vec<T> =
            (0..EDGE.pow(3)).map(|i| at([(i % EDGE).min(shape[0] - 1), i / EDGE % EDGE, i / EDGE / EDGE])).collect();
        let parts = Parts::of(&core, EDGE, shape, nodata);
        for d in directions() {
            let along = |a: usize| match d[a] {
                -1 => 0..1,
                0 => 0..shape[a],
                _ => shape[a] - 1..shape[a],
            };
            let voxels = along(2).flat_map(|z| along(1).flat_map(move |y| along(0).map(move |x| at([x, y, z]))));
            let valid = voxels.filter(|v| Some(*v) != nodata);
            let expected = valid.fold(T::EMPTY, |range, v| range.join(T::range_of(v)));
            assert_eq!(parts.toward(d), expected, "{shape:?} {d:?}");
        }
    }

    proptest! {
        #[test]
        fn parts_are_the_ranges_of_their_voxels(
            shape in prop::array::uniform3(1usize..=8), values in prop::collection::vec(any::<u32>(), 512),
        ) {
            check(shape, |i| values[i] as u8, None);
            check(shape, |i| values[i] as i16, None);
            check(shape, |i| values[i] as i32, None);
            check(shape, |i| (values[i] % 3) as u8, Some(2));
            check(shape, |i| -((values[i] % 4) as i32), Some(-1));
            let special = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY];
            check(shape, |i| special.get(values[i] as usize % 5).copied().unwrap_or(values[i] as f32 - 2e9), None);
        }
    }
}
