//! The draw list: what is drawn for the cut now, back to front.
//!
//! Each visible cell is drawn with its own brick or with its nearest resident ancestor, restricted to the cell's box. One pass
//! down the cut's tree finds all of them: one look-up a node. A brick that [fades in](crate::fade) shares its cell with what it
//! takes the place of: of the pixels, each of the two has some.

use crate::cut::{Cut, NodeId};
use crate::dither::PixelShare;
use crate::fade::Fading;
use crate::visible_cells::{Ranked, VisibleCells};
use brickyard_volume::{BrickId, Pyramid, VoxelBox};
use rustc_hash::FxHashMap;

/// A place for one padded brick in the atlas.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Slot(pub u32);

/// A cell of the cut, and a resident brick that is drawn for it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DrawCell {
    /// The cell: a brick's place in the octree.
    pub cell: BrickId,
    /// The cell's half-open box in level-0 voxels: where this entry draws.
    pub region: VoxelBox,
    /// The pixels that this entry draws: all, unless a brick fades in.
    pub pixels: PixelShare,
    /// The brick whose voxels are drawn: the cell's own, or its nearest resident ancestor.
    pub brick: BrickId,
    /// The slot that holds `brick`.
    pub slot: Slot,
    /// The cell's place, back to front, among all cells of its cut that are in sight. Where several volumes share a cut, their entries for
    /// the same cell have the same rank.
    pub rank: u32,
}

/// What is drawn of a volume now: cells in back-to-front order, disjoint, covering all of the volume that is visible and not empty. The
/// list is empty until the volume's coarsest bricks have come. A cell in which a brick fades in has two entries, one after the other:
/// first the brick that gives way, then the new one. Between them the two entries draw every pixel once.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct DrawList {
    /// The list's entries, back to front.
    pub cells: Vec<DrawCell>,
}

impl DrawList {
    /// The draw list for what a view sees of a cut, given the resident bricks that stand for its nodes. Cells for which nothing is resident (a
    /// whole line of ancestors cannot be read) are left out. `fading` says which brick, in which slot, a brick that fades in replaces; it is
    /// given the brick and how many more entries than cells the list has so far.
    pub(crate) fn new(
        pyramid: &Pyramid,
        cut: &Cut,
        sight: &VisibleCells,
        stand_ins: &StandIns,
        mut fading: impl FnMut(BrickId, usize) -> Option<(Fading, Slot)>,
    ) -> Self {
        let (mut cells, mut pairs) = (Vec::with_capacity(sight.cells.len()), 0);
        for &Ranked { cell, rank } in &sight.cells {
            let Some((stand_in, slot)) = stand_ins.of(cell) else { continue };
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

    /// This list's entries with their cells in another order.
    pub(crate) fn reordered(&self, cut: &Cut, order: &[Ranked]) -> Self {
        let entries: FxHashMap<BrickId, &[DrawCell]> =
            self.cells.chunk_by(|a, b| a.cell == b.cell).map(|entries| (entries[0].cell, entries)).collect();
        let ranked = order.iter().filter_map(|ranked| Some((ranked.rank, *entries.get(&cut.id(ranked.cell))?)));
        let cells = ranked.flat_map(|(rank, cells)| cells.iter().map(move |cell| DrawCell { rank, ..*cell }));
        Self { cells: cells.collect() }
    }

    /// Whether any brick of the list fades in.
    pub(crate) fn is_fading(&self) -> bool {
        self.cells.iter().any(|cell| cell.pixels != PixelShare::ALL)
    }
}

/// Which nodes of a cut are resident, and for each node the nearest resident one on the way up.
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

    /// The nearest resident node on the way up from this node, which may be itself, and its slot; `None` if there is none.
    pub(crate) fn of(&self, node: NodeId) -> Option<(NodeId, Slot)> {
        let nearest = self.nearest[node.index()]?;
        self.own[nearest.index()].map(|slot| (nearest, slot))
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
