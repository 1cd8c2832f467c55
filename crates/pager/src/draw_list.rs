//! The draw list: the resident bricks drawn for a cut, back to front.
//!
//! Each visible cell is drawn with its own brick or its nearest resident ancestor, restricted to the cell's box. One pass down the cut's
//! tree finds them, with one look-up per node. A brick [fading in](crate::fade) shares its cell's pixels with the brick it replaces.

use crate::cut::{Cut, NodeId};
use crate::dither::PixelShare;
use crate::fade::Fading;
use crate::visible_cells::{Ranked, VisibleCells};
use brickyard_volume::{BrickId, Pyramid, VoxelBox};
use rustc_hash::FxHashMap;

/// Place of one padded brick in the atlas.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Slot(pub u32);

/// A cell of the cut, and the resident brick drawn for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DrawCell {
    /// The cell: a brick's place in the octree.
    pub cell: BrickId,
    /// The cell's half-open box in level-0 voxels, the limits of the entry.
    pub region: VoxelBox,
    /// Pixels of this entry: all, unless a brick fades in.
    pub pixels: PixelShare,
    /// The drawn brick: the cell's own, or its nearest resident ancestor.
    pub brick: BrickId,
    /// Slot of `brick`.
    pub slot: Slot,
    /// Back-to-front position among all visible cells of the cut. Volumes sharing a cut have equal ranks for equal cells.
    pub rank: u32,
}

/// Drawn bricks of a volume: disjoint cells, back to front, covering everything visible and not empty. Empty until the volume's coarsest
/// bricks arrive. A cell with a fading brick has two consecutive entries: first the outgoing brick, then the new one, which together draw
/// every pixel once.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DrawList {
    /// Entries, back to front.
    pub cells: Vec<DrawCell>,
}

impl DrawList {
    /// Draw list of a cut's visible cells, given its nodes' resident stand-ins. Cells without any (a whole line of unreadable ancestors)
    /// are left out. `fading` receives a brick and the surplus of entries over cells so far, and returns the replaced brick of a fade and
    /// its slot.
    pub(crate) fn new(
        pyramid: &Pyramid,
        cut: &Cut,
        sight: &VisibleCells,
        stand_ins: &StandIns,
        mut fading: impl FnMut(BrickId, usize) -> Option<(Fading, Slot)>,
    ) -> Self {
        let (mut cells, mut pairs) = (Vec::with_capacity(sight.cells.len()), 0);
        for &Ranked { cell, rank } in &sight.cells {
            let Some(stand_in) = stand_ins.of(cell) else { continue };
            let Some(slot) = stand_ins.own[stand_in.index()] else { continue };
            let (cell, brick) = (cut.id(cell), cut.id(stand_in));
            let region = pyramid.brick_box_voxel(cell.level, cell.index);
            let mut own = DrawCell { cell, region, pixels: PixelShare::ALL, brick, slot, rank };
            if let Some((Fading { before, share }, slot)) = fading(brick, pairs) {
                cells.push(DrawCell {
                    pixels: PixelShare { from: share, ..PixelShare::ALL },
                    brick: before,
                    slot,
                    ..own
                });
                own.pixels.to = share;
                pairs += 1;
            }
            cells.push(own);
        }
        Self { cells }
    }

    pub(crate) fn reordered(&self, cut: &Cut, order: &[Ranked]) -> Self {
        let entries: FxHashMap<BrickId, &[DrawCell]> =
            self.cells.chunk_by(|a, b| a.cell == b.cell).map(|entries| (entries[0].cell, entries)).collect();
        let ranked = order.iter().filter_map(|ranked| Some((ranked.rank, *entries.get(&cut.id(ranked.cell))?)));
        let cells = ranked.flat_map(|(rank, cells)| cells.iter().map(move |cell| DrawCell { rank, ..*cell }));
        Self { cells: cells.collect() }
    }

    pub(crate) fn is_fading(&self) -> bool {
        self.cells.iter().any(|cell| cell.pixels != PixelShare::ALL)
    }
}

/// Resident nodes of a cut, and the nearest resident ancestor of each node.
#[derive(Clone, Debug)]
pub(crate) struct StandIns {
    own: Vec<Option<Slot>>,
    nearest: Vec<Option<NodeId>>,
}

impl StandIns {
    /// Looks up the nodes for which `concerns` is true; the others count as absent.
    pub(crate) fn new(cut: &Cut, concerns: impl Fn(NodeId) -> bool, slot_of: impl Fn(BrickId) -> Option<Slot>) -> Self {
        let mut own = Vec::with_capacity(cut.nodes.len());
        let mut nearest: Vec<Option<NodeId>> = Vec::with_capacity(cut.nodes.len());
        for node in cut.ids() {
            let slot = if concerns(node) { slot_of(cut.id(node)) } else { None };
            // A root's parent is itself: not in the list yet.
            let inherited = nearest.get(cut[node].parent.index()).copied().flatten();
            nearest.push(if slot.is_some() { Some(node) } else { inherited });
            own.push(slot);
        }
        Self { own, nearest }
    }

    pub(crate) fn is_resident(&self, node: NodeId) -> bool {
        self.own[node.index()].is_some()
    }

    /// Nearest resident node on the path to the root, itself included; `None` if there is none.
    pub(crate) fn of(&self, node: NodeId) -> Option<NodeId> {
        self.nearest[node.index()]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thresholds_are_spread_evenly() {
        let of = |n: u32| (0..n).flat_map(move |y| (0..n).map(move |x| PixelShare::threshold(x + 40, y + 24)));
        let mut all: Vec<u8> = of(8).collect();
        all.sort_unstable();
        assert!(all.into_iter().eq(0..PixelShare::THRESHOLDS), "each once in 8 by 8");
        // Each quarter of them once in 2 by 2.
        assert_eq!(of(2).map(|threshold| threshold / 16).collect::<Vec<_>>(), [0, 2, 3, 1]);
        let half = PixelShare { from: 0, to: 32 };
        assert!((0..8).all(|i| half.hold(i, i) && !half.hold(i, i + 1)), "a chequered half");
    }
}
