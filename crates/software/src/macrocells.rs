//! Macro-cells: a brick's core in boxes of 8^3 voxels, each with the least and greatest code that a sample in it can have,
//! so that a ray leaps over what cannot be seen.
//!
//! Made once when a brick arrives (about 30 us for 64^3); what they mean for a picture is asked anew for every frame, so
//! an edit of the transfer function reloads nothing. A cell's range covers half a voxel more than its box on each side:
//! rounding in the traversal never hides a sample.

use brickyard_volume::SlotFormat;

/// Voxels along a macro-cell's edge: smaller ones leap over more, but a ray crosses more of them.
pub(crate) const CELL_EDGE: usize = 8;

/// The ranges of one brick's macro-cells.
#[derive(Debug)]
pub(crate) struct MacroCells {
    /// Least and greatest valid code, x fastest; the least past the greatest where no voxel is valid.
    ranges: Box<[[u16; 2]]>,
    /// Of all cells together.
    whole: [u16; 2],
}

const NONE: [u16; 2] = [u16::MAX, 0];

fn join([a, b]: [u16; 2], [c, d]: [u16; 2]) -> [u16; 2] {
    [a.min(c), b.max(d)]
}

/// Macro-cells along a brick's edge.
pub(crate) const fn per_axis(edge: usize) -> usize {
    edge.div_ceil(CELL_EDGE)
}

/// Bytes that a brick's macro-cells take.
pub(crate) const fn bytes(edge: usize) -> usize {
    per_axis(edge).pow(3) * size_of::<[u16; 2]>()
}

impl MacroCells {
    /// Those of a padded brick: `(edge + 2 * apron)^3` codes; code 0 is no value if `has_invalid`.
    pub(crate) fn new(codes: &[u8], format: SlotFormat, has_invalid: bool, edge: usize, apron: usize) -> Self {
        let (padded, cells) = (edge + 2 * apron, per_axis(edge));
        // The voxels that samples of cell `i` touch along an axis: the core's, and one more on each side.
        let reach = |i: usize| i * CELL_EDGE + apron - 1..((i + 1) * CELL_EDGE + apron + 1).min(padded);
        let mut rows = RowRanges::new(padded);
        // Joined along y in every slice, then along z, both by whole rows; along x at the end.
        let mut slices = vec![NONE; padded * cells * padded];
        for z in 0..padded {
            for y in 0..cells {
                rows.clear();
                for line in reach(y) {
                    let start = (z * padded + line) * padded * format.bytes();
                    rows.add(&codes[start..start + padded * format.bytes()], format, has_invalid);
                }
                rows.store(&mut slices[(z * cells + y) * padded..][..padded]);
            }
        }
        let mut ranges = Vec::with_capacity(cells.pow(3));
        for z in 0..cells {
            for y in 0..cells {
                rows.clear();
                reach(z).for_each(|slice| rows.join(&slices[(slice * cells + y) * padded..][..padded]));
                ranges.extend((0..cells).map(|x| reach(x).map(|x| rows.at(x)).fold(NONE, join)));
            }
        }
        let whole = ranges.iter().copied().fold(NONE, join);
        Self { ranges: ranges.into(), whole }
    }

    /// The range of a cell.
    #[inline(always)]
    pub(crate) fn range(&self, cell: usize) -> [u16; 2] {
        self.ranges[cell]
    }

    /// The range of the whole brick.
    pub(crate) fn whole(&self) -> [u16; 2] {
        self.whole
    }

    /// The cells for which `is_visible`.
    pub(crate) fn mask(&self, is_visible: impl Fn([u16; 2]) -> bool) -> Mask {
        let word = |ranges: &[[u16; 2]]| {
            let bits = ranges.iter().enumerate().map(|(i, &range)| (is_visible(range) as u64) << i);
            bits.fold(0, |word, bit| word | bit)
        };
        let words: Box<[u64]> = self.ranges.chunks(64).map(word).collect();
        match words.iter().map(|w| w.count_ones() as usize).sum() {
            0 => Mask::None,
            n if n == self.ranges.len() => Mask::All,
            _ => Mask::Some(words),
        }
    }
}

/// Which macro-cells of a brick can be seen.
pub(crate) enum Mask {
    None,
    All,
    /// A bit per cell.
    Some(Box<[u64]>),
}

/// Codes of rows, column by column.
struct RowRanges {
    low: Vec<u16>,
    high: Vec<u16>,
}

impl RowRanges {
    fn new(length: usize) -> Self {
        Self { low: vec![0; length], high: vec![0; length] }
    }

    fn clear(&mut self) {
        self.low.fill(NONE[0]);
        self.high.fill(NONE[1]);
    }

    fn at(&self, x: usize) -> [u16; 2] {
        [self.low[x], self.high[x]]
    }

    fn add(&mut self, codes: &[u8], format: SlotFormat, has_invalid: bool) {
        match format {
            SlotFormat::U8 => self.add_codes(codes.iter().map(|&code| code as u16), has_invalid),
            SlotFormat::U16 => {
                self.add_codes(codes.as_chunks::<2>().0.iter().map(|&code| u16::from_le_bytes(code)), has_invalid);
            }
        }
    }

    #[inline(always)]
    fn add_codes(&mut self, codes: impl Iterator<Item = u16>, has_invalid: bool) {
        for ((low, high), code) in self.low.iter_mut().zip(&mut self.high).zip(codes) {
            // Code 0 then counts as the greatest of the least, and as the least of the greatest anyway.
            let least = if has_invalid && code == 0 { u16::MAX } else { code };
            *low = (*low).min(least);
            *high = (*high).max(code);
        }
    }

    fn join(&mut self, ranges: &[[u16; 2]]) {
        for ((low, high), range) in self.low.iter_mut().zip(&mut self.high).zip(ranges) {
            *low = (*low).min(range[0]);
            *high = (*high).max(range[1]);
        }
    }

    fn store(&self, ranges: &mut [[u16; 2]]) {
        for ((range, low), high) in ranges.iter_mut().zip(&self.low).zip(&self.high) {
            *range = [*low, *high];
        }
    }
}

/// A ray's way through the macro-cells of a brick, in samples: those at `origin + i * step` (slot coordinates) for `i` from
/// 0 to `count` fall into stretches, one per cell.
pub(crate) struct Traversal {
    cells: i32,
    cell: [i32; 3],
    direction: [i32; 3],
    /// The sample, as a real number, where the ray leaves the cell along each axis, and from one cell to the next.
    leave: [f32; 3],
    per_cell: [f32; 3],
    count: i32,
    next: i32,
}

impl Traversal {
    #[inline(always)]
    pub(crate) fn new(origin: [f32; 3], step: [f32; 3], count: i32, edge: u32, apron: u32) -> Self {
        let cells = per_axis(edge as usize) as i32;
        let (mut cell, mut direction) = ([0; 3], [0; 3]);
        let (mut leave, mut per_cell) = ([f32::INFINITY; 3], [0.0; 3]);
        for a in 0..3 {
            let at = (origin[a] - (apron as f32 - 0.5)) * (1.0 / CELL_EDGE as f32);
            cell[a] = (at as i32).clamp(0, cells - 1);
            if step[a] != 0.0 {
                direction[a] = if step[a] > 0.0 { 1 } else { -1 };
                let rate = CELL_EDGE as f32 / step[a];
                leave[a] = ((cell[a] + (step[a] > 0.0) as i32) as f32 - at) * rate;
                per_cell[a] = rate.abs();
            }
        }
        Self { cells, cell, direction, leave, per_cell, count, next: 0 }
    }

    /// The next stretch: its cell, its first sample and one past its last (there may be none in between).
    #[inline(always)]
    pub(crate) fn next(&mut self) -> Option<(usize, i32, i32)> {
        if self.next >= self.count {
            return None;
        }
        let cell = ((self.cell[2] * self.cells + self.cell[1]) * self.cells + self.cell[0]) as usize;
        let axis = match self.leave {
            [x, y, z] if x <= y && x <= z => 0,
            [_, y, z] if y <= z => 1,
            _ => 2,
        };
        let first = self.next;
        let ahead = self.cell[axis] + self.direction[axis];
        // Past the brick's last cell rounding may have left a sample or two; casts saturate.
        let last = if (0..self.cells).contains(&ahead) {
            (self.leave[axis].ceil() as i32).clamp(first, self.count)
        } else {
            self.count
        };
        self.cell[axis] = ahead;
        self.leave[axis] += self.per_cell[axis];
        self.next = last;
        Some((cell, first, last))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Whatever samples a traversal gives a cell, their eight voxels are in its range; and every sample has one cell.
        #[test]
        fn a_samples_voxels_are_in_its_cells_range(
            codes in prop::collection::vec(prop::sample::select(vec![0u8, 1, 7, 200, 255]), 20 * 20 * 20),
            origin in prop::array::uniform3(0.5f32..17.5), far in prop::array::uniform3(0.5f32..17.5), count in 1i32..90,
            has_invalid in any::<bool>(), flat in prop::option::of(0usize..3),
        ) {
            let (edge, apron, padded) = (17, 1, 19);
            let codes = &codes[..padded * padded * padded];
            let cells = MacroCells::new(codes, SlotFormat::U8, has_invalid, edge, apron);
            let mut step: [f32; 3] = std::array::from_fn(|a| (far[a] - origin[a]) / count as f32);
            if let Some(axis) = flat {
                step[axis] = 0.0;
            }
            let mut traversal = Traversal::new(origin, step, count, edge as u32, apron as u32);
            let mut expected = 0;
            while let Some((cell, first, last)) = traversal.next() {
                prop_assert_eq!(first, expected);
                expected = last;
                let [low, high] = cells.range(cell);
                for i in first..last {
                    let at: [usize; 3] = std::array::from_fn(|a| ((origin[a] + i as f32 * step[a]) as usize).min(padded - 2));
                    for corner in 0..8 {
                        let [x, y, z] = std::array::from_fn(|a| at[a] + (corner >> a & 1));
                        let code = codes[(z * padded + y) * padded + x] as u16;
                        prop_assert!((low <= code && code <= high) || has_invalid && code == 0, "{at:?} {cell}");
                    }
                }
            }
            prop_assert_eq!(expected, count);
        }
    }

    #[test]
    fn masks_tell_all_and_none_apart() {
        let mut codes = vec![0; 10 * 10 * 10 * 2];
        let cells = |codes: &[u8]| MacroCells::new(codes, SlotFormat::U16, true, 8, 1);
        assert!(matches!(cells(&codes).mask(|range| range != NONE), Mask::None));
        assert_eq!(cells(&codes).whole(), NONE);
        codes[777 * 2 + 1] = 3;
        assert_eq!(cells(&codes).whole(), [768, 768]);
        assert!(matches!(cells(&codes).mask(|[low, _]| low == 768), Mask::All));
    }
}
