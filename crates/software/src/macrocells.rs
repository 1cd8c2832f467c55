//! The visibility of a brick's macro-cells ([`brickyard_volume::macrocells`]) along a ray, looked up for blocks of
//! samples.
//!
//! A block is a number of neighbouring samples of a ray, or whole segments where ends count, spanning at most a cell's
//! edge along each axis. So along an axis they are in one cell or in two: *span* `2 i` is cell `i`, span `2 i + 1` is
//! cells `i` and `i + 1`. The cells of each box of spans are joined once per frame, and one look-up then decides a
//! block's visibility. (Walking from cell to cell along the ray is more exact, but takes three times as many look-ups,
//! and the next plane is unpredictable for a processor: it took a quarter of a picture's time.)

use crate::packet::{LANES, Packet};
use brickyard_volume::macrocells::{CELL_EDGE, MacroCells, per_axis};

const fn spans_per_axis(edge: usize) -> usize {
    2 * per_axis(edge) - 1
}

/// The number of boxes of spans in a brick with this core edge.
pub(crate) const fn boxes(edge: usize) -> usize {
    spans_per_axis(edge).pow(3)
}

/// Joins the macro-cells of each box of a brick by `join`; x fastest.
pub(crate) fn over_boxes<T: Copy>(
    cells: impl Iterator<Item = T>,
    edge: usize,
    join: impl Fn(T, T) -> T + Copy,
) -> Box<[T]> {
    let (n, spans) = (per_axis(edge), spans_per_axis(edge));
    let mut from: Vec<T> = cells.collect();
    // Every pass turns the array's fastest axis from cells into spans and makes it the slowest.
    for _ in 0..3 {
        let rows = from.len() / n;
        let mut to = vec![from[0]; rows * spans];
        for (row, line) in from.chunks_exact(n).enumerate() {
            to[row] = line[0];
            for x in 1..n {
                to[(2 * x - 1) * rows + row] = join(line[x - 1], line[x]);
                to[2 * x * rows + row] = line[x];
            }
        }
        from = to;
    }
    from.into()
}

/// The visible part of a brick: none, some or all.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Coverage {
    None,
    /// Some macro-cells are visible: boxes must be tested.
    Some,
    All,
}

/// The visible macro-cells of a brick.
pub(crate) enum Mask {
    None,
    All,
    /// For each box, whether any of its cells is visible.
    Some(Box<[bool]>),
}

impl Mask {
    #[inline(always)]
    pub(crate) fn coverage(&self) -> Coverage {
        match self {
            Self::None => Coverage::None,
            Self::Some(_) => Coverage::Some,
            Self::All => Coverage::All,
        }
    }

    /// Returns which of these boxes are visible, a bit for each.
    ///
    /// # Safety
    /// The brick has these boxes.
    #[inline(always)]
    pub(crate) unsafe fn seen(&self, boxes: &[i32; LANES]) -> u64 {
        let seen = match self {
            Self::None => return 0,
            Self::Some(seen) => seen,
            Self::All => return u64::MAX,
        };
        let mut bits = 0;
        for i in 0..LANES {
            // SAFETY: the caller's promise; a mask has all boxes.
            bits |= (unsafe { *seen.get_unchecked(boxes[i] as usize) } as u64) << i;
        }
        bits
    }

    pub(crate) fn new(cells: &MacroCells, edge: usize, is_visible: impl Fn([u16; 2]) -> bool) -> Self {
        let visible: Vec<bool> = cells.ranges().iter().map(|&range| is_visible(range)).collect();
        match visible.iter().filter(|&&v| v).count() {
            0 => Self::None,
            n if n == visible.len() => Self::All,
            _ => Self::Some(over_boxes(visible.into_iter(), edge, |a, b| a | b)),
        }
    }
}

/// The part of its segments covered by a block of samples.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Reach {
    /// From the first segment's middle to the last segment's middle.
    Middles,
    /// All of its segments, from end to end.
    Ends,
    /// Like `Ends`; and a cell also takes segments of other cells reaching into it.
    Beyond,
}

/// The number of segments in a block, for segments of `step` voxels along each axis: at least one, and whole packets if
/// more than one packet.
#[inline(always)]
pub(crate) fn block_length(step: [f32; 3], reach: Reach) -> i32 {
    /// Upper bound, within the range of every counter.
    const MOST: f32 = (1 << 24) as f32;
    let mut longest = 0.0f32;
    for a in 0..3 {
        longest = if step[a].abs() > longest { step[a].abs() } else { longest };
    }
    let steps = CELL_EDGE as f32 / longest;
    let length = match reach {
        _ if steps >= MOST => MOST as i32,
        Reach::Middles => steps as i32 + 1,
        Reach::Ends | Reach::Beyond => (steps as i32).max(1),
    };
    if length > LANES as i32 { length & -(LANES as i32) } else { length }
}

/// A ray's way through a brick's macro-cells, block by block.
#[derive(Clone, Copy)]
pub(crate) struct Blocks {
    /// The middle of the first block, the distance between blocks, and half a block, in cells from the core's low
    /// corner.
    middle: [f32; 3],
    stride: [f32; 3],
    half: [f32; 3],
    spans: i32,
    /// Just short of the last cell's end.
    limit: f32,
}

impl Blocks {
    /// The blocks of `length` segments with their middles at `origin + i * step` (slot coordinates).
    #[inline(always)]
    pub(crate) fn new(origin: [f32; 3], step: [f32; 3], length: i32, reach: Reach, edge: u32, apron: u32) -> Self {
        const CELLS: f32 = 1.0 / CELL_EDGE as f32;
        let (mut middle, mut stride, mut half) = ([0.0; 3], [0.0; 3], [0.0; 3]);
        for a in 0..3 {
            let between = 0.5 * (length - 1) as f32 * step[a];
            middle[a] = (origin[a] + between - (apron as f32 - 0.5)) * CELLS;
            stride[a] = step[a] * (length as f32 * CELLS);
            half[a] = match reach {
                Reach::Middles => between.abs() * CELLS,
                Reach::Ends | Reach::Beyond => 0.5 * stride[a].abs(),
            };
        }
        let cells = per_axis(edge as usize) as f32;
        Self { middle, stride, half, spans: spans_per_axis(edge as usize) as i32, limit: cells.next_down() }
    }

    /// The boxes of the blocks from `first` on: indices less than [`boxes`] of the brick's edge.
    #[inline(always)]
    pub(crate) fn boxes(&self, first: i32, found: &mut [i32; LANES]) {
        const LANE: Packet = [1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0];
        let before = (first - 1) as f32;
        let mut place = [0i32; LANES];
        for a in [2, 1, 0] {
            for i in 0..LANES {
                let middle = self.middle[a] + (before + LANE[i]) * self.stride[a];
                let (low, high) = (middle - self.half[a], middle + self.half[a]);
                // Written so that NaN ends up inside, too. The last block may be outside.
                let low = if low > 0.0 { low } else { 0.0 };
                let low = if low < self.limit { low } else { self.limit };
                let high = if high > 0.0 { high } else { 0.0 };
                let high = if high < self.limit { high } else { self.limit };
                // SAFETY: both are at least 0 and less than the number of cells.
                let cells = unsafe { low.to_int_unchecked::<i32>() + high.to_int_unchecked::<i32>() };
                place[i] = place[i] * self.spans + cells;
            }
        }
        *found = place;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::macrocells::NONE;
    use brickyard_volume::{Needs, SlotFormat};
    use proptest::prelude::*;

    proptest! {
        /// For all samples of a block, their eight voxels are in its box's range.
        #[test]
        fn a_samples_voxels_are_in_its_blocks_range(
            codes in prop::collection::vec(prop::sample::select(vec![0u8, 1, 7, 200, 255]), 20 * 20 * 20),
            origin in prop::array::uniform3(0.5f32..17.5), far in prop::array::uniform3(0.5f32..17.5), count in 1i32..90,
            has_invalid in any::<bool>(), flat in prop::option::of(0usize..3), by_ends in any::<bool>(),
        ) {
            let reach = if by_ends { Reach::Ends } else { Reach::Middles };
            let (edge, apron, padded) = (17, 1, 19);
            let codes = &codes[..padded * padded * padded];
            let cells = MacroCells::new(codes, SlotFormat::U8, has_invalid, edge, Needs { apron, ..Needs::PLAIN });
            let join = |[a, b]: [u16; 2], [c, d]: [u16; 2]| [a.min(c), b.max(d)];
            let ranges = over_boxes(cells.ranges().iter().copied(), edge, join);
            let mut step: [f32; 3] = std::array::from_fn(|a| (far[a] - origin[a]) / count as f32);
            if let Some(axis) = flat {
                step[axis] = 0.0;
            }
            let length = block_length(step, reach);
            let blocks = Blocks::new(origin, step, length, reach, edge as u32, apron);
            // The examined offsets of a segment, from its middle.
            let offsets: &[f32] = if by_ends && step.iter().all(|s| s.abs() <= 8.0) { &[-0.5, 0.0, 0.5] } else { &[0.0] };
            for (i, offset) in (0..count).flat_map(|i| offsets.iter().map(move |&offset| (i, offset))) {
                let block = i / length;
                let mut boxes = [0; LANES];
                blocks.boxes(block - block % 3, &mut boxes);
                let place = boxes[(block % 3) as usize] as usize;
                let [low, high] = ranges[place];
                let at: [usize; 3] = std::array::from_fn(|a| {
                    // Places outside the core belong to the outermost cells, up to half a voxel away.
                    (origin[a] + (i as f32 + offset) * step[a]).clamp(0.5, 17.5) as usize
                });
                for neighbour in 0..8 {
                    let [x, y, z] = std::array::from_fn(|a| at[a] + (neighbour >> a & 1));
                    let code = codes[(z * padded + y) * padded + x] as u16;
                    prop_assert!((low <= code && code <= high) || has_invalid && code == 0, "{at:?} {place}");
                }
            }
        }
    }

    #[test]
    fn blocks_are_as_long_as_a_cells_edge_allows() {
        let lengths = |reach| {
            [9.0, 8.0, 3.0, 1.0, 0.9, 0.4, 0.1].map(|longest: f32| block_length([0.1 * longest, -longest, 0.0], reach))
        };
        assert_eq!(lengths(Reach::Middles), [1, 2, 3, 8, 8, 16, 80]);
        assert_eq!(lengths(Reach::Ends), [1, 1, 2, 8, 8, 16, 80]);
        assert_eq!([Reach::Middles, Reach::Ends].map(|reach| block_length([0.0; 3], reach)), [1 << 24; 2]);
    }

    #[test]
    fn boxes_have_what_their_cells_have() {
        // Three cells along each axis, one of them visible.
        let n = 3;
        for seen in 0..n * n * n {
            let at = [seen % n, seen / n % n, seen / n / n];
            let found = over_boxes((0..n * n * n).map(|i| i == seen), n * CELL_EDGE, |a, b| a | b);
            assert_eq!(found.len(), boxes(n * CELL_EDGE));
            for (i, &found) in found.iter().enumerate() {
                let span = [i % 5, i / 5 % 5, i / 25];
                let touches = (0..3).all(|a| span[a] / 2 == at[a] || span[a].div_ceil(2) == at[a]);
                assert_eq!(found, touches, "{seen} {span:?}");
            }
        }
        assert_eq!(*over_boxes([true].into_iter(), 5, |a, b| a | b), [true]);
    }

    #[test]
    fn masks_tell_all_and_none_apart() {
        let mut codes = vec![0; 10 * 10 * 10 * 2];
        let cells = |codes: &[u8]| MacroCells::new(codes, SlotFormat::U16, true, 8, Needs::PLAIN);
        assert!(matches!(Mask::new(&cells(&codes), 8, |range| range != NONE), Mask::None));
        codes[777 * 2 + 1] = 3;
        assert!(matches!(Mask::new(&cells(&codes), 8, |[low, _]| low == 768), Mask::All));
    }
}
