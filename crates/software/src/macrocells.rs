//! What a ray meets of a brick's macro-cells ([`brickyard_volume::macrocells`]): which of them can be seen, asked for blocks
//! of samples.
//!
//! A block is as many neighbouring samples of a ray as reach no farther than a cell's edge: half an edge about their middle.
//! So all of them are in the 2x2x2 cells around the *corner* of cells that is nearest to the middle, and one look-up, of
//! what those eight cells have together, tells whether the block can be seen. (Walking from cell to cell along the ray
//! asks more exactly, but three times as often, and which plane comes next is not for a processor to guess: it took a
//! quarter of a picture's time.)

use crate::sample::{CHUNK, LANES};
use brickyard_volume::macrocells::{CELL_EDGE, MacroCells, NONE, per_axis};

/// Corners of a brick's macro-cells along an axis.
pub(crate) const fn corners_per_axis(edge: usize) -> usize {
    per_axis(edge) + 1
}

/// Corners of a brick's macro-cells.
pub(crate) const fn corners(edge: usize) -> usize {
    corners_per_axis(edge).pow(3)
}

/// The codes that the cells around each corner can have together, x fastest.
pub(crate) fn ranges_around_corners(cells: &MacroCells, edge: usize) -> Box<[[u16; 2]]> {
    around_corners(cells.ranges().iter().copied(), edge, NONE, |[a, b], [c, d]| [a.min(c), b.max(d)])
}

/// Joins what the cells around each corner have, axis by axis: every pass makes the array's fastest axis one longer and then
/// the slowest.
fn around_corners<T: Copy>(
    cells: impl Iterator<Item = T>,
    edge: usize,
    none: T,
    join: impl Fn(T, T) -> T + Copy,
) -> Box<[T]> {
    let (n, corners) = (per_axis(edge), corners_per_axis(edge));
    let mut from: Vec<T> = cells.collect();
    for _ in 0..3 {
        let rows = from.len() / n;
        let mut to = vec![none; rows * corners];
        for (row, line) in from.chunks_exact(n).enumerate() {
            to[row] = line[0];
            for x in 1..n {
                to[x * rows + row] = join(line[x - 1], line[x]);
            }
            to[n * rows + row] = line[n - 1];
        }
        from = to;
    }
    from.into()
}

/// Which macro-cells of a brick can be seen.
pub(crate) enum Mask {
    None,
    All,
    /// Whether any cell around a corner can.
    Some(Box<[bool]>),
}

impl Mask {
    /// The cells for which `is_visible`.
    pub(crate) fn new(cells: &MacroCells, edge: usize, is_visible: impl Fn([u16; 2]) -> bool) -> Self {
        let visible: Vec<bool> = cells.ranges().iter().map(|&range| is_visible(range)).collect();
        match visible.iter().filter(|&&v| v).count() {
            0 => Self::None,
            n if n == visible.len() => Self::All,
            _ => Self::Some(around_corners(visible.into_iter(), edge, false, |a, b| a | b)),
        }
    }
}

/// A ray's way through a brick, block by block: the samples at `origin + i * step` (slot coordinates) for `i` from 0 to
/// `count`.
pub(crate) struct Blocks {
    /// The middle of the first block and from one block to the next, in cells from the core's low corner, and half a cell
    /// more, so that the whole part is the nearest corner.
    middle: [f32; 3],
    stride: [f32; 3],
    /// Samples in a block.
    length: i32,
    corners: i32,
    count: i32,
    next: i32,
    /// The corners of the blocks from the last multiple of [`LANES`] blocks on.
    corner: [i32; LANES],
    in_row: usize,
}

impl Blocks {
    #[inline(always)]
    pub(crate) fn new(origin: [f32; 3], step: [f32; 3], count: i32, edge: u32, apron: u32) -> Self {
        let corners = corners_per_axis(edge as usize) as i32;
        let mut longest = 0.0f32;
        for a in 0..3 {
            longest = if step[a].abs() > longest { step[a].abs() } else { longest };
        }
        // One sample is a block however long the steps.
        let most = CELL_EDGE as f32 / longest;
        let length = if most < CHUNK as f32 { most as i32 + 1 } else { CHUNK as i32 };
        // Whole packets.
        let length = if length > LANES as i32 { length & -(LANES as i32) } else { length };
        let (mut middle, mut stride) = ([0.0; 3], [0.0; 3]);
        for a in 0..3 {
            let from_core = origin[a] + 0.5 * (length - 1) as f32 * step[a] - (apron as f32 - 0.5);
            middle[a] = from_core * (1.0 / CELL_EDGE as f32) + 0.5;
            stride[a] = step[a] * (length as f32 / CELL_EDGE as f32);
        }
        Self { middle, stride, length, corners, count, next: 0, corner: [0; LANES], in_row: LANES }
    }

    /// The next block: the corner around which it is, its first sample and one past its last.
    #[inline(always)]
    pub(crate) fn next(&mut self) -> Option<(usize, i32, i32)> {
        if self.next >= self.count {
            return None;
        }
        if self.in_row == LANES {
            self.find_corners();
            self.in_row = 0;
        }
        let corner = self.corner[self.in_row] as usize;
        let first = self.next;
        self.in_row += 1;
        self.next += self.length;
        Some((corner, first, if self.next < self.count { self.next } else { self.count }))
    }

    #[inline(always)]
    fn find_corners(&mut self) {
        let last = (self.corners - 1) as f32;
        let mut corner = [0i32; LANES];
        for a in [2, 1, 0] {
            for i in 0..LANES {
                let v = self.middle[a] + i as f32 * self.stride[a];
                // Written so that NaN, too, ends up inside. The last block's middle may be outside.
                let v = if v > 0.0 { v } else { 0.0 };
                let v = if v < last { v } else { last };
                // SAFETY: 0 <= v <= last < 2^31.
                corner[i] = corner[i] * self.corners + unsafe { v.to_int_unchecked::<i32>() };
            }
            self.middle[a] += LANES as f32 * self.stride[a];
        }
        self.corner = corner;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::SlotFormat;
    use proptest::prelude::*;

    proptest! {
        /// Whatever samples a block has, their eight voxels are in the range around its corner; and every sample has one block.
        #[test]
        fn a_samples_voxels_are_in_its_blocks_range(
            codes in prop::collection::vec(prop::sample::select(vec![0u8, 1, 7, 200, 255]), 20 * 20 * 20),
            origin in prop::array::uniform3(0.5f32..17.5), far in prop::array::uniform3(0.5f32..17.5), count in 1i32..90,
            has_invalid in any::<bool>(), flat in prop::option::of(0usize..3),
        ) {
            let (edge, apron, padded) = (17, 1, 19);
            let codes = &codes[..padded * padded * padded];
            let cells = MacroCells::new(codes, SlotFormat::U8, has_invalid, edge, apron);
            let ranges = ranges_around_corners(&cells, edge);
            let mut step: [f32; 3] = std::array::from_fn(|a| (far[a] - origin[a]) / count as f32);
            if let Some(axis) = flat {
                step[axis] = 0.0;
            }
            let mut blocks = Blocks::new(origin, step, count, edge as u32, apron as u32);
            let mut expected = 0;
            while let Some((corner, first, last)) = blocks.next() {
                prop_assert_eq!(first, expected);
                prop_assert!(first < last);
                expected = last;
                let [low, high] = ranges[corner];
                for i in first..last {
                    let at: [usize; 3] = std::array::from_fn(|a| ((origin[a] + i as f32 * step[a]) as usize).min(padded - 2));
                    for neighbour in 0..8 {
                        let [x, y, z] = std::array::from_fn(|a| at[a] + (neighbour >> a & 1));
                        let code = codes[(z * padded + y) * padded + x] as u16;
                        prop_assert!((low <= code && code <= high) || has_invalid && code == 0, "{at:?} {corner}");
                    }
                }
            }
            prop_assert_eq!(expected, count);
        }
    }

    #[test]
    fn corners_have_what_the_cells_around_them_have() {
        // Three cells along each axis, told apart by the bits of a number; one of them can be seen.
        let n = 3;
        for seen in 0..n * n * n {
            let at = [seen % n, seen / n % n, seen / n / n];
            let found = around_corners((0..n * n * n).map(|i| i == seen), n * CELL_EDGE, false, |a, b| a | b);
            assert_eq!(found.len(), corners(n * CELL_EDGE));
            for (i, &found) in found.iter().enumerate() {
                let corner = [i % 4, i / 4 % 4, i / 16];
                let touches = (0..3).all(|a| corner[a] == at[a] || corner[a] == at[a] + 1);
                assert_eq!(found, touches, "{seen} {corner:?}");
            }
        }
    }

    #[test]
    fn masks_tell_all_and_none_apart() {
        let mut codes = vec![0; 10 * 10 * 10 * 2];
        let cells = |codes: &[u8]| MacroCells::new(codes, SlotFormat::U16, true, 8, 1);
        assert!(matches!(Mask::new(&cells(&codes), 8, |range| range != NONE), Mask::None));
        codes[777 * 2 + 1] = 3;
        assert!(matches!(Mask::new(&cells(&codes), 8, |[low, _]| low == 768), Mask::All));
    }
}
