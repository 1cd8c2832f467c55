//! The 27 parts of a padded brick: its own core, and the apron parts lent by up to 26 neighbours.
//!
//! Along every axis a padded brick consists of the end of one neighbour, the brick itself, and the beginning of the other; a part is one
//! of the 27 combinations, named from the side of the brick taking it.

use crate::layout::Layout;
use brickyard_volume::{BrickIndex, Extent};
use std::ops::Range;

/// A part of a padded brick.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Part {
    /// Along each axis: 0 for the neighbour before, 1 for the brick itself, 2 for the neighbour after.
    pub(crate) side: [usize; 3],
}

impl Part {
    pub(crate) const COUNT: usize = 27;

    /// The brick's own core.
    pub(crate) const OWN: Self = Self { side: [1; 3] };

    /// All parts, the brick's own first.
    pub(crate) fn all() -> impl Iterator<Item = Self> {
        let sides = (0..Self::COUNT).map(|i| Self { side: [i % 3, i / 3 % 3, i / 9] });
        std::iter::once(Self::OWN).chain(sides.filter(|&part| part != Self::OWN))
    }

    /// All parts, in groups of three side by side along x.
    pub(crate) fn bars() -> impl Iterator<Item = [Self; 3]> {
        (0..9).map(|i| [0, 1, 2].map(|x| Self { side: [x, i % 3, i / 3] }))
    }

    /// The part's index in arrays over all parts.
    pub(crate) fn number(self) -> usize {
        let [x, y, z] = self.side;
        x + 3 * y + 9 * z
    }

    /// The set of this part alone, one bit of a set of parts.
    pub(crate) fn bit(self) -> u32 {
        1 << self.number()
    }

    /// The bricks of a grid that lend their parts to `taker`, itself first.
    pub(crate) fn lenders(taker: BrickIndex, grid: Extent) -> impl Iterator<Item = BrickIndex> {
        let (place, grid) = (taker.to_array(), grid.to_array());
        let has_lender = move |part: &Self| (0..3).all(|a| (1..=grid[a]).contains(&(place[a] + part.side[a] as u32)));
        Self::all().filter(has_lender).map(move |part| part.lender(taker))
    }

    /// The brick lending this part to `taker`; it must exist.
    pub(crate) fn lender(self, taker: BrickIndex) -> BrickIndex {
        let taker = taker.to_array();
        BrickIndex::from_array(std::array::from_fn(|a| taker[a] + self.side[a] as u32 - 1))
    }

    /// The set of parts taken from `lender` by its neighbours in a grid of bricks.
    pub(crate) fn lent_by(lender: BrickIndex, grid: Extent) -> u32 {
        let (lender, grid) = (lender.to_array(), grid.to_array());
        let has_taker = |side: [usize; 3]| (0..3).all(|a| (1..=grid[a]).contains(&(lender[a] + 2 - side[a] as u32)));
        let taken = Self::all().filter(|&part| part != Self::OWN && has_taker(part.side));
        taken.fold(0, |parts, part| parts | part.bit())
    }
}

/// Source and target of a run of core voxels in a padded brick, along one axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Span {
    pub(crate) from: usize,
    pub(crate) to: usize,
    pub(crate) len: usize,
}

impl Span {
    pub(crate) fn target(self) -> Range<usize> {
        self.to..self.to + self.len
    }
}

/// The three spans of a padded row along one axis: from the brick before, brick `index` itself and the brick after, on a level with
/// `extent` voxels along the axis.
pub(crate) fn spans(layout: &Layout, index: usize, extent: usize) -> [Span; 3] {
    let Layout { edge, apron, .. } = *layout;
    let start = index * edge;
    let before = if index > 0 { apron } else { 0 };
    let own = edge.min(extent - start);
    let after = apron.min(extent - start - own);
    [
        Span { from: edge - before, to: apron - before, len: before },
        Span { from: 0, to: apron, len: own },
        Span { from: 0, to: apron + own, len: after },
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_brick_lends_is_what_its_neighbours_take() {
        let grid = Extent::new(3, 1, 2);
        let bricks = || (0..6).map(|i| BrickIndex::new(i % 3, 0, i / 3));
        let inside = |at: [u32; 3]| (0..3).all(|a| at[a] < grid.to_array()[a]);
        for lender in bricks() {
            let mut taken = 0;
            for taker in bricks() {
                for part in Part::all().filter(|&part| part != Part::OWN) {
                    let at: [u32; 3] =
                        std::array::from_fn(|a| (taker.to_array()[a] + part.side[a] as u32).wrapping_sub(1));
                    if inside(at) && part.lender(taker) == lender {
                        taken |= part.bit();
                    }
                }
            }
            assert_eq!(Part::lent_by(lender, grid), taken, "{lender}");
        }
        let count = |lender, n| Part::lent_by(lender, Extent::new(n, n, n)).count_ones();
        assert_eq!((count(BrickIndex::new(1, 1, 1), 3), count(BrickIndex::new(0, 0, 0), 1)), (26, 0));
    }
}
