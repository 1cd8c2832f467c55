//! Macro-cells: a brick's core in boxes of 8^3 voxels, each with the least and greatest code that a sample in it can have,
//! so that a ray skips what cannot be seen; and which ranges of codes a transfer table shows.
//!
//! Cells are made once when a brick arrives (0.1 to 0.2 ms for 64^3 on one core); what they mean for a picture is asked anew for every
//! frame, so an edit of the transfer function reloads nothing. A cell's range covers half a voxel more than its box on each
//! side: rounding in a traversal never hides a sample.

use crate::sampling::Needs;
use crate::slot_encoding::SlotFormat;
use crate::transfer::TransferTable;

/// Voxels along a macro-cell's edge: smaller ones skip more, but a ray crosses more of them.
pub const CELL_EDGE: usize = 8;

/// The ranges of one brick's macro-cells.
#[derive(Debug)]
pub struct MacroCells {
    /// Least and greatest valid code, x fastest; the least past the greatest where no voxel is valid.
    ranges: Box<[[u16; 2]]>,
    /// The range of all cells together.
    whole: [u16; 2],
}

/// The range of a cell without a valid voxel: its least code is past its greatest.
pub const NONE: [u16; 2] = [u16::MAX, 0];

fn join([a, b]: [u16; 2], [c, d]: [u16; 2]) -> [u16; 2] {
    [a.min(c), b.max(d)]
}

/// Macro-cells along the edge of a brick's core of `edge` voxels.
pub const fn per_axis(edge: usize) -> usize {
    edge.div_ceil(CELL_EDGE)
}

/// Bytes that the macro-cells of a brick's core of `edge` voxels take.
pub const fn bytes(edge: usize) -> usize {
    per_axis(edge).pow(3) * size_of::<[u16; 2]>()
}

impl MacroCells {
    /// The macro-cells of a padded brick: `(edge + 2 * apron)^3` codes, where `needs` says the apron, which must not be narrower than
    /// its filter's [taps](crate::Filter::taps). Code 0 is no value if `has_invalid`. Of f32 slots nothing is known.
    pub fn new(codes: &[u8], format: SlotFormat, has_invalid: bool, edge: usize, needs: Needs) -> Self {
        match format {
            SlotFormat::U8 => Self::of::<u8>(codes, has_invalid, edge, needs),
            SlotFormat::U16 => Self::of::<u16>(codes.as_chunks().0, has_invalid, edge, needs),
            // Their codes go with the window that is looked at, which may be another one by the next frame.
            SlotFormat::F32 => Self::of_anything(format, edge),
        }
    }

    fn of<C: Code>(codes: &[C::Bytes], has_invalid: bool, edge: usize, Needs { apron, filter, .. }: Needs) -> Self {
        let (apron, taps) = (apron as usize, filter.taps() as usize);
        let (padded, cells) = (edge + 2 * apron, per_axis(edge));
        // The voxels that samples of cell `i` touch along an axis: the core's, and one or two more on each side.
        let reach = |i: usize| i * CELL_EDGE + apron - taps..((i + 1) * CELL_EDGE + apron + taps).min(padded);
        let mut rows = RowRanges::<C>::new(padded);
        // Joined along y in every slice, then along z, both by whole rows; along x at the end.
        let mut slices = vec![[C::MAX, C::ZERO]; padded * cells * padded];
        for z in 0..padded {
            for y in 0..cells {
                rows.clear();
                for line in reach(y) {
                    let start = (z * padded + line) * padded;
                    rows.add(&codes[start..start + padded], has_invalid);
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

    /// The macro-cells of a brick of which nothing is known: a ray skips none of them.
    pub fn of_anything(format: SlotFormat, edge: usize) -> Self {
        let whole = [0, format.max_code() as u16];
        Self { ranges: vec![whole; per_axis(edge).pow(3)].into(), whole }
    }

    /// The `[least, greatest]` code of each cell, x fastest; [`NONE`] where no voxel is valid.
    pub fn ranges(&self) -> &[[u16; 2]] {
        &self.ranges
    }

    /// The `[least, greatest]` code of a cell, by its position in [`MacroCells::ranges`]; [`NONE`] where no voxel is valid.
    #[inline(always)]
    pub fn range(&self, cell: usize) -> [u16; 2] {
        self.ranges[cell]
    }

    /// The `[least, greatest]` code of the whole brick; [`NONE`] where no voxel is valid.
    #[inline(always)]
    pub fn whole(&self) -> [u16; 2] {
        self.whole
    }
}

/// A code as it lies in a brick: narrow ones are compared in twice as many lanes.
trait Code: Copy + Ord + Into<u16> {
    type Bytes: Copy;
    const ZERO: Self;
    const MAX: Self;
    fn of(bytes: Self::Bytes) -> Self;
}

impl Code for u8 {
    type Bytes = u8;
    const ZERO: Self = 0;
    const MAX: Self = u8::MAX;
    fn of(bytes: u8) -> Self {
        bytes
    }
}

impl Code for u16 {
    type Bytes = [u8; 2];
    const ZERO: Self = 0;
    const MAX: Self = u16::MAX;
    fn of(bytes: [u8; 2]) -> Self {
        u16::from_le_bytes(bytes)
    }
}

/// Least and greatest codes of rows, column by column.
struct RowRanges<C> {
    low: Vec<C>,
    high: Vec<C>,
}

impl<C: Code> RowRanges<C> {
    fn new(length: usize) -> Self {
        Self { low: vec![C::MAX; length], high: vec![C::ZERO; length] }
    }

    fn clear(&mut self) {
        self.low.fill(C::MAX);
        self.high.fill(C::ZERO);
    }

    fn at(&self, x: usize) -> [u16; 2] {
        let (low, high) = (self.low[x], self.high[x]);
        if low > high { NONE } else { [low.into(), high.into()] }
    }

    fn add(&mut self, codes: &[C::Bytes], has_invalid: bool) {
        for ((low, high), &code) in self.low.iter_mut().zip(&mut self.high).zip(codes) {
            let code = C::of(code);
            // Code 0 then counts as the greatest of the least, and as the least of the greatest anyway.
            let least = if has_invalid && code == C::ZERO { C::MAX } else { code };
            *low = (*low).min(least);
            *high = (*high).max(code);
        }
    }

    fn join(&mut self, ranges: &[[C; 2]]) {
        for ((low, high), range) in self.low.iter_mut().zip(&mut self.high).zip(ranges) {
            *low = (*low).min(range[0]);
            *high = (*high).max(range[1]);
        }
    }

    fn store(&self, ranges: &mut [[C; 2]]) {
        for ((range, low), high) in ranges.iter_mut().zip(&self.low).zip(&self.high) {
            *range = [*low, *high];
        }
    }
}

/// How many table entries before each code have opacity. Two look-ups tell what a range of codes can show.
#[derive(Clone, Debug)]
pub struct OpaqueCodes {
    before: Vec<u32>,
}

impl OpaqueCodes {
    /// Counts the entries of a transfer table that have opacity.
    pub fn new(table: &TransferTable) -> Self {
        let count = |before: &mut u32, entry: Option<&[f32; 4]>| {
            let at = *before;
            *before += entry.is_some_and(|e| e[3] > 0.0) as u32;
            Some(at)
        };
        Self { before: table.entries.iter().map(Some).chain([None]).scan(0, count).collect() }
    }

    /// Whether a sample with a code from `low` to `high` may have opacity; false for an empty range.
    #[inline]
    pub fn any(&self, [low, high]: [u16; 2]) -> bool {
        low <= high && self.count([low, high]) > 0
    }

    /// Whether the table entries of all codes from `low` to `high` have opacity; false for an empty range.
    #[inline]
    pub fn all(&self, [low, high]: [u16; 2]) -> bool {
        low <= high && self.count([low, high]) == high as u32 - low as u32 + 1
    }

    /// For each code the number of entries before it that have opacity, and at the end the number of all.
    pub fn before(&self) -> &[u32] {
        &self.before
    }

    fn count(&self, [low, high]: [u16; 2]) -> u32 {
        self.before[high as usize + 1] - self.before[low as usize]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ranges_hold_the_valid_codes() {
        let mut codes = vec![0; 10 * 10 * 10 * 2];
        let cells = |codes: &[u8]| MacroCells::new(codes, SlotFormat::U16, true, 8, Needs::PLAIN);
        assert_eq!(cells(&codes).whole(), NONE);
        codes[777 * 2 + 1] = 3;
        assert_eq!(cells(&codes).whole(), [768, 768]);
        assert_eq!(MacroCells::new(&codes, SlotFormat::U16, false, 8, Needs::PLAIN).ranges(), [[0, 768]]);
    }

    #[test]
    fn opacity_of_ranges_is_that_of_their_entries() {
        let alpha = [0.0, 0.0, 0.5, 0.1, 0.0, 0.2, 0.0];
        let entries = alpha.map(|a| [1.0, 1.0, 1.0, a]).to_vec();
        let opaque = OpaqueCodes::new(&TransferTable::from_entries(entries, 1.0));
        for low in 0..7u16 {
            for high in 0..7u16 {
                let within = alpha.get(low as usize..=high as usize).unwrap_or(&[]);
                assert_eq!(opaque.any([low, high]), within.iter().any(|&a| a > 0.0), "{low} {high}");
                assert_eq!(opaque.all([low, high]), low <= high && within.iter().all(|&a| a > 0.0), "{low} {high}");
            }
        }
        assert!(!opaque.any(NONE) && !opaque.all(NONE));
    }
}
