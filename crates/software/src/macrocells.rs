//! What a ray meets of a brick's macro-cells ([`brickyard_volume::macrocells`]): which of them can be seen, and in which
//! order the ray passes through them.

use brickyard_volume::macrocells::{CELL_EDGE, MacroCells, per_axis};

/// Which macro-cells of a brick can be seen.
pub(crate) enum Mask {
    None,
    All,
    /// A bit per cell.
    Some(Box<[u64]>),
}

impl Mask {
    /// The cells for which `is_visible`.
    pub(crate) fn new(cells: &MacroCells, is_visible: impl Fn([u16; 2]) -> bool) -> Self {
        let word = |ranges: &[[u16; 2]]| {
            let bits = ranges.iter().enumerate().map(|(i, &range)| (is_visible(range) as u64) << i);
            bits.fold(0, |word, bit| word | bit)
        };
        let words: Box<[u64]> = cells.ranges().chunks(64).map(word).collect();
        match words.iter().map(|w| w.count_ones() as usize).sum() {
            0 => Self::None,
            n if n == cells.ranges().len() => Self::All,
            _ => Self::Some(words),
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
    use brickyard_volume::SlotFormat;
    use brickyard_volume::macrocells::NONE;
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
        assert!(matches!(Mask::new(&cells(&codes), |range| range != NONE), Mask::None));
        codes[777 * 2 + 1] = 3;
        assert!(matches!(Mask::new(&cells(&codes), |[low, _]| low == 768), Mask::All));
    }
}
