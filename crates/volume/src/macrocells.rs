//! Macro-cells: a brick's core in boxes of 8^3 voxels, each with the least and greatest code of samples in it, so that rays skip invisible cells;
//! and the ranges of codes shown by a transfer table.
//!
//! Cells are made once as a brick arrives (0.1 to 0.2 ms for 64^3 on one core), and matched with the transfer table for every frame, so an edit of
//! the transfer function reloads nothing. A cell's range covers half a voxel more than its box on each side: rounding in a traversal never hides a
//! sample.

use crate::sampling::Needs;
use crate::slot_encoding::SlotFormat;
use crate::transfer::TransferTable;
use std::ops::Range;

/// Voxels along a macro-cell's edge: smaller cells skip more, but a ray crosses more of them.
pub const CELL_EDGE: usize = 8;

/// The ranges of one brick's macro-cells.
#[derive(Debug)]
pub struct MacroCells {
    /// Least and greatest valid code, x fastest; the least past the greatest where no voxel is valid.
    ranges: Box<[[u16; 2]]>,
    /// The joint range of all cells.
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

/// Bytes of the macro-cells of a brick's core of `edge` voxels.
pub const fn bytes(edge: usize) -> usize {
    per_axis(edge).pow(3) * size_of::<[u16; 2]>()
}

impl MacroCells {
    /// Builds the macro-cells of a padded brick: `(edge + 2 * apron)^3` codes, with the apron in `needs`, at least as wide as its filter's
    /// [taps](crate::Filter::taps). Code 0 is no value if `has_invalid`. Ranges of f32 slots are unknown.
    pub fn new(codes: &[u8], format: SlotFormat, has_invalid: bool, edge: usize, needs: Needs) -> Self {
        match format {
            SlotFormat::U8 => Self::of::<u8>(codes, has_invalid, edge, needs),
            SlotFormat::U16 => Self::of::<u16>(codes.as_chunks().0, has_invalid, edge, needs),
            // Their codes depend on the window, which may change by the next frame.
            SlotFormat::F32 => Self::of_anything(format, edge),
        }
    }

    fn of<C: Code>(codes: &[C::Bytes], has_invalid: bool, edge: usize, Needs { apron, filter, .. }: Needs) -> Self {
        let (apron, taps) = (apron as usize, filter.taps() as usize);
        let (padded, cells) = (edge + 2 * apron, per_axis(edge));
        // The voxels touched by samples of cell `i` along an axis: the core's, and one or two more on each side.
        let reach = |i: usize| i * CELL_EDGE + apron - taps..((i + 1) * CELL_EDGE + apron + taps).min(padded);
        // Joined along y in every slice, then along z, both by whole rows; along x at the end.
        let mut slices = Ranges::<C>::new(padded * cells * padded);
        for z in 0..padded {
            for y in 0..cells {
                let lines = &codes[(z * padded + reach(y).start) * padded..(z * padded + reach(y).end) * padded];
                slices.row((z * cells + y) * padded, padded).fold_codes(lines, has_invalid);
            }
        }
        let mut row = Ranges::<C>::new(padded);
        let mut ranges = Vec::with_capacity(cells.pow(3));
        for z in 0..cells {
            for y in 0..cells {
                let starts = reach(z).map(|slice| (slice * cells + y) * padded);
                row.row(0, padded).fold_rows(&slices, starts);
                ranges.extend((0..cells).map(|x| row.range(reach(x))));
            }
        }
        let whole = ranges.iter().copied().fold(NONE, join);
        Self { ranges: ranges.into(), whole }
    }

    /// Returns the macro-cells of a brick with unknown contents: a ray skips none of them.
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

/// The least and greatest codes at a number of places; the least past the greatest where no voxel is valid.
struct Ranges<C> {
    low: Vec<C>,
    high: Vec<C>,
}

impl<C: Code> Ranges<C> {
    fn new(length: usize) -> Self {
        Self { low: vec![C::MAX; length], high: vec![C::ZERO; length] }
    }

    fn row(&mut self, start: usize, length: usize) -> Row<'_, C> {
        Row { low: &mut self.low[start..][..length], high: &mut self.high[start..][..length] }
    }

    /// The joint range of some places.
    fn range(&self, places: Range<usize>) -> [u16; 2] {
        let low = self.low[places.clone()].iter().fold(C::MAX, |a, &b| a.min(b));
        let high = self.high[places].iter().fold(C::ZERO, |a, &b| a.max(b));
        if low > high { NONE } else { [low.into(), high.into()] }
    }
}

/// A row of ranges, to be filled column by column from rows of the same length.
struct Row<'a, C> {
    low: &'a mut [C],
    high: &'a mut [C],
}

/// Columns folded together, in registers from the first row to the last.
const LANES: usize = 16;

impl<C: Code> Row<'_, C> {
    /// Folds the columns of these rows of codes.
    fn fold_codes(&mut self, codes: &[C::Bytes], has_invalid: bool) {
        match (self.low.len() < LANES, has_invalid) {
            (true, _) => self.fold(|columns: &mut Columns<C, 1>, at, length| {
                codes.chunks_exact(length).for_each(|row| columns.add(&row[at..], has_invalid));
            }),
            // The flag is a constant in each.
            (false, true) => self.fold(|columns: &mut Columns<C, LANES>, at, length| {
                codes.chunks_exact(length).for_each(|row| columns.add(&row[at..], true));
            }),
            (false, false) => self.fold(|columns: &mut Columns<C, LANES>, at, length| {
                codes.chunks_exact(length).for_each(|row| columns.add(&row[at..], false));
            }),
        }
    }

    /// Folds the columns of the rows of ranges that start at these places.
    fn fold_rows(&mut self, ranges: &Ranges<C>, starts: impl Iterator<Item = usize> + Clone) {
        let Ranges { low, high } = ranges;
        match self.low.len() < LANES {
            true => self.fold(|columns: &mut Columns<C, 1>, at, _| {
                starts.clone().for_each(|start| columns.join(&low[start + at..], &high[start + at..]));
            }),
            false => self.fold(|columns: &mut Columns<C, LANES>, at, _| {
                starts.clone().for_each(|start| columns.join(&low[start + at..], &high[start + at..]));
            }),
        }
    }

    /// Fills the row by `N` columns at a time; the last ones overlap if its length is no multiple. `fold` gets the place of the first column and
    /// the row's length.
    #[inline(always)]
    fn fold<const N: usize>(&mut self, fold: impl Fn(&mut Columns<C, N>, usize, usize)) {
        let length = self.low.len();
        for at in (0..length).step_by(N).map(|at| at.min(length - N)) {
            let mut columns = Columns { low: [C::MAX; N], high: [C::ZERO; N] };
            fold(&mut columns, at, length);
            self.low[at..at + N].copy_from_slice(&columns.low);
            self.high[at..at + N].copy_from_slice(&columns.high);
        }
    }
}

/// The least and greatest codes of some columns.
struct Columns<C, const N: usize> {
    low: [C; N],
    high: [C; N],
}

impl<C: Code, const N: usize> Columns<C, N> {
    /// Adds the first `N` of these codes.
    #[inline(always)]
    fn add(&mut self, codes: &[C::Bytes], has_invalid: bool) {
        let codes = &codes[..N];
        for i in 0..N {
            let code = C::of(codes[i]);
            // An invalid code 0 must not count as the least; as the greatest it changes nothing.
            let least = if has_invalid && code == C::ZERO { C::MAX } else { code };
            self.low[i] = self.low[i].min(least);
            self.high[i] = self.high[i].max(code);
        }
    }

    /// Adds the first `N` of these ranges.
    #[inline(always)]
    fn join(&mut self, low: &[C], high: &[C]) {
        let (low, high) = (&low[..N], &high[..N]);
        for i in 0..N {
            self.low[i] = self.low[i].min(low[i]);
            self.high[i] = self.high[i].max(high[i]);
        }
    }
}

/// Prefix counts of a transfer table's places with opacity: two look-ups decide about a range of codes. A place is a code, or all the entries
/// between two codes.
#[derive(Clone, Debug)]
pub struct OpaqueCodes {
    before: Vec<u32>,
    first_code: u16,
    places_per_code: u16,
}

impl OpaqueCodes {
    /// Counts the places of a transfer table with opacity.
    pub fn new(table: &TransferTable) -> Self {
        let per_code = table.entries_per_code;
        let is_seen = |entries: &[[f32; 4]]| entries.iter().any(|entry| entry[3] > 0.0);
        let count = |before: &mut u32, is_seen: bool| {
            *before += u32::from(is_seen);
            Some(*before)
        };
        let places = table.entries.chunks(per_code).flat_map(|code| {
            let (at, between) = code.split_at(1);
            [Some(is_seen(at)), (!between.is_empty()).then(|| is_seen(between))]
        });
        let before = [0].into_iter().chain(places.flatten().scan(0, count)).collect();
        Self { before, first_code: table.first_code, places_per_code: per_code.min(2) as u16 }
    }

    /// The greatest length of [`before`](Self::before), for slots of a format.
    pub const fn most(format: SlotFormat) -> usize {
        // A whole 16-bit table has no entries between codes; one over less than half of the codes may have.
        let codes = format.max_code() as usize + 2;
        if let SlotFormat::U8 = format { 2 * codes } else { codes }
    }

    /// Whether a sample with a code from `low` to `high` may have opacity; false for an empty range.
    #[inline]
    pub fn any(&self, range @ [low, high]: [u16; 2]) -> bool {
        low <= high && self.count(range.map(|code| self.place(code))) > 0
    }

    /// Whether all codes from `low` to `high`, and places between them, have opacity; false for an empty range.
    #[inline]
    pub fn all(&self, range @ [low, high]: [u16; 2]) -> bool {
        let places @ [first, last] = range.map(|code| self.place(code));
        low <= high && self.count(places) as usize == last - first + 1
    }

    /// The number of places with opacity before each place, and at the end their total.
    pub fn before(&self) -> &[u32] {
        &self.before
    }

    /// Places from one code to the next: 1 or 2.
    pub fn places_per_code(&self) -> u16 {
        self.places_per_code
    }

    /// The place of a code, or of the table's nearest one.
    fn place(&self, code: u16) -> usize {
        let place = usize::from(code.saturating_sub(self.first_code)) * usize::from(self.places_per_code);
        place.min(self.before.len() - 2)
    }

    fn count(&self, [first, last]: [usize; 2]) -> u32 {
        self.before[last + 1] - self.before[first]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::float_slots::{KeptSlots, Window};
    use crate::mode::Mode;
    use crate::slot_encoding::SlotEncoding;
    use crate::transfer::TransferFunction;
    use crate::voxel_type::VoxelType;
    use proptest::prelude::*;

    #[test]
    fn ranges_hold_the_valid_codes() {
        let mut codes = vec![0; 10 * 10 * 10 * 2];
        let cells = |codes: &[u8]| MacroCells::new(codes, SlotFormat::U16, true, 8, Needs::PLAIN);
        assert_eq!(cells(&codes).whole(), NONE);
        codes[777 * 2 + 1] = 3;
        assert_eq!(cells(&codes).whole(), [768, 768]);
        assert_eq!(MacroCells::new(&codes, SlotFormat::U16, false, 8, Needs::PLAIN).ranges(), [[0, 768]]);
    }

    proptest! {
        /// A cell has the range of the voxels touched by samples in it, one by one.
        #[test]
        fn a_range_is_that_of_the_cells_voxels_and_those_next_to_it(
            edge in prop::sample::select(vec![1usize, 4, 8, 14, 16, 20, 32]), apron in 1u32..4, has_invalid: bool, is_wide: bool,
            seed: u64, share_of_zeros in 0u64..4,
        ) {
            let (padded, bytes) = (edge + 2 * apron as usize, 1 + is_wide as usize);
            let mut state = seed | 1;
            let mut random = || {
                state ^= state << 13;
                state ^= state >> 7;
                state ^= state << 17;
                state
            };
            let code = |random: u64| if random >> 60 < 5 * share_of_zeros { 0 } else { (random >> 20) as u16 };
            let voxels: Vec<[u8; 2]> = (0..padded.pow(3)).map(|_| code(random()).to_le_bytes()).collect();
            let codes: Vec<u8> = voxels.iter().flat_map(|voxel| &voxel[..bytes]).copied().collect();
            let format = if is_wide { SlotFormat::U16 } else { SlotFormat::U8 };
            let needs = Needs { apron, ..Needs::PLAIN };
            let cells = MacroCells::new(&codes, format, has_invalid, edge, needs);
            let reach = |i: usize| {
                let first = i * CELL_EDGE + apron as usize;
                first - 1..(first + CELL_EDGE + 1).min(padded)
            };
            let along = per_axis(edge);
            for (cell, &range) in cells.ranges().iter().enumerate() {
                let [x, y, z] = [1, along, along * along].map(|stride| reach(cell / stride % along));
                let places = z.flat_map(|z| y.clone().flat_map({ let x = x.clone(); move |y| x.clone().map(move |x| [x, y, z]) }));
                let code = |[x, y, z]: [usize; 3]| {
                    let at = ((z * padded + y) * padded + x) * bytes;
                    codes[at..at + bytes].iter().rev().fold(0, |code, &byte| code << 8 | byte as u16)
                };
                let valid = places.map(code).filter(|&code| !has_invalid || code > 0);
                prop_assert_eq!(range, valid.fold(NONE, |[a, b], code| [a.min(code), b.max(code)]));
            }
        }
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

    /// Between codes 41 and 42 there is a shell, and past 43 everything is seen.
    #[test]
    fn opacity_between_codes_is_that_of_ranges_across_it() {
        let transfer = TransferFunction {
            opacity: vec![[41.25, 0.0], [41.5, 0.5], [41.75, 0.0], [43.0, 0.0], [43.25, 0.5]],
            ..TransferFunction::default()
        };
        let encoding = SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false);
        let encoding = encoding.for_window(Window::new(&transfer, &[], Mode::Dvr), KeptSlots::default());
        let opaque = OpaqueCodes::new(&TransferTable::new(&transfer, &encoding));
        assert_eq!((encoding.table_codes, opaque.places_per_code()), ([40, 45], 2));
        for (range, is_seen) in [
            ([0, 41], false),
            ([41, 41], false),
            ([41, 42], true),
            ([0, 255], true),
            ([42, 43], false),
            ([43, 44], true),
            ([44, 44], true),
            ([44, 255], true),
            ([200, 255], true),
            (NONE, false),
        ] {
            assert_eq!(opaque.any(range), is_seen, "{range:?}");
        }
        assert!(opaque.all([44, 255]) && !opaque.all([41, 255]));
        assert!(opaque.before().len() <= OpaqueCodes::most(SlotFormat::U8));
    }
}
