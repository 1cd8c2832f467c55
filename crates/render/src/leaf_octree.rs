//! The octree over a draw list, in which a ray looks up a point's brick or the extent of empty space around it.
//!
//! A page table of all bricks would grow with the volume; this grows with the cut. It holds one word per node in groups
//! of eight children, 32 bytes for each split node, and is rebuilt for every frame: about 50 ns per cell and level. In
//! projections, bricks with an invisible code range get no leaf. In direct volume rendering they keep theirs, so that
//! rays can mark them as reached.

use crate::atlas::{AtlasPlan, texel_placement};
use brickyard_pager::{DrawCell, DrawList, Slot};
use brickyard_shaders::{HALVES_X, LEAF, NO_RANGES, RayBrick};
use brickyard_volume::{Mode, OpaqueCodes, Pyramid};

/// Children of a node, whether it halves three axes or fewer.
pub(crate) const GROUP: usize = 8;

/// Criteria for a brick's leaf and for the use of its macro-cells.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Visibility<'a> {
    pub(crate) mode: Mode,
    pub(crate) has_invalid: bool,
    pub(crate) opaque: &'a OpaqueCodes,
    pub(crate) skips_empty: bool,
}

impl Visibility<'_> {
    /// Whether the brick deserves a leaf.
    fn any(&self, [low, high]: [u16; 2]) -> bool {
        !self.mode.is_projection() || low <= high
    }

    /// Whether no macro-cell of a brick with these codes is worth skipping.
    fn all(&self, range: [u16; 2]) -> bool {
        match self.mode {
            // Isosurface rays check every macro-cell.
            Mode::Isosurface => false,
            _ if !self.skips_empty => true,
            Mode::Dvr => self.opaque.all(range),
            _ if self.mode.extreme().is_some() => false,
            _ => !self.has_invalid,
        }
    }
}

/// Locations of bricks in the atlas and in the buffer of macro-cells.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Slots<'a> {
    pub(crate) atlas: &'a AtlasPlan,
    pub(crate) apron: u32,
    pub(crate) macro_cells: u32,
    /// The code range of each slot's brick.
    pub(crate) ranges: &'a [[u16; 2]],
}

/// The octree over a draw list: its nodes, root first, and the bricks of its leaves.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Tree {
    pub(crate) nodes: Vec<u32>,
    pub(crate) bricks: Vec<RayBrick>,
}

impl Tree {
    pub(crate) fn new(pyramid: &Pyramid, draw: &DrawList, visibility: &Visibility<'_>, slots: &Slots<'_>) -> Self {
        let splits = splits(pyramid);
        let mut tree = Self { nodes: vec![LEAF; GROUP], bricks: Vec::with_capacity(draw.cells.len()) };
        let range = |entry: &DrawCell| slots.ranges[entry.slot.0 as usize];
        // Front to back, so that bricks met in succession by rays are neighbours in memory.
        for entries in draw.cells.chunk_by(|a, b| a.cell == b.cell).rev() {
            if entries.iter().any(|entry| visibility.any(range(entry))) {
                let cell = entries[0].cell;
                let depth = splits.len() - cell.level.index();
                let leaf = tree.leaf(&splits[..depth], cell.index.to_array());
                tree.nodes[leaf] = LEAF | (tree.bricks.len() + 1) as u32;
                // While a brick fades in, it comes first, followed by the one it replaces.
                let bricks = entries.iter().rev().map(|e| ray_brick(e, pyramid, slots, visibility.all(range(e))));
                tree.bricks.extend(bricks);
            }
        }
        tree
    }

    /// The node of the cell with this index after these splits; creates missing nodes on the way.
    fn leaf(&mut self, splits: &[[bool; 3]], index: [u32; 3]) -> usize {
        let mut left: [u32; 3] = std::array::from_fn(|a| splits.iter().filter(|halves| halves[a]).count() as u32);
        let mut at = 0;
        for halves in splits {
            if self.nodes[at] & LEAF != 0 {
                debug_assert_eq!(self.nodes[at], LEAF, "cells of a draw list are disjoint");
                let axes = (0..3).map(|a| (halves[a] as u32 * HALVES_X) << a).sum::<u32>();
                self.nodes[at] = (self.nodes.len() / GROUP) as u32 | axes;
                self.nodes.extend([LEAF; GROUP]);
            }
            let mut child = 0;
            for a in (0..3).filter(|&a| halves[a]) {
                left[a] -= 1;
                child |= (index[a] >> left[a] & 1) << a;
            }
            at = (self.nodes[at] & (HALVES_X - 1)) as usize * GROUP + child as usize;
        }
        at
    }
}

/// Returns which axes each level of the octree halves, from the root down to level 0. A pyramid with several bricks in
/// its coarsest level gets further octree levels above it.
pub(crate) fn splits(pyramid: &Pyramid) -> Vec<[bool; 3]> {
    let levels = pyramid.levels();
    let grid = levels[levels.len() - 1].bricks.to_array();
    let above = grid.map(|n| n.next_power_of_two().trailing_zeros()).into_iter().max().unwrap_or(0);
    let joined = (0..above).rev().map(|k| grid.map(|n| n > 1 << k));
    let halved = levels.windows(2).rev().map(|w| std::array::from_fn(|a| w[1].factor[a] > w[0].factor[a]));
    joined.chain(halved).collect()
}

/// Returns the size of the octree's root in level-0 voxels.
pub(crate) fn root_size(pyramid: &Pyramid) -> [u32; 3] {
    let coarsest = pyramid.level(pyramid.coarsest());
    let bricks = coarsest.bricks.to_array();
    std::array::from_fn(|a| bricks[a].next_power_of_two() * pyramid.edge() * coarsest.factor[a])
}

fn ray_brick(cell: &DrawCell, pyramid: &Pyramid, slots: &Slots<'_>, is_all_seen: bool) -> RayBrick {
    let Slot(slot) = cell.slot;
    let (texel_scale, texel_offset) = texel_placement(cell, pyramid, slots.atlas, slots.apron);
    let factor = pyramid.level(cell.brick.level).factor;
    let index = cell.brick.index.to_array();
    let [low, high] = slots.ranges[slot as usize];
    RayBrick {
        texel_scale,
        first_range: if is_all_seen { NO_RANGES } else { slot * slots.macro_cells },
        texel_offset,
        range: pack_range([low, high]),
        low: std::array::from_fn(|a| (index[a] as u64 * pyramid.edge() as u64 * factor[a] as u64) as f32),
        pixels_to: cell.pixels.to as u32,
    }
}

/// Packs a range of codes for shaders: the least code in the low 16 bits, the greatest in the high ones.
pub(crate) fn pack_range([low, high]: [u16; 2]) -> u32 {
    low as u32 | (high as u32) << 16
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_pager::PixelShare;
    use brickyard_volume::{BrickId, BrickIndex, Extent, Level, TransferTable, macrocells};

    fn table(alpha: impl Fn(usize) -> f32) -> OpaqueCodes {
        let entries = (0..256).map(|i| [1.0, 1.0, 1.0, alpha(i)]).collect();
        OpaqueCodes::new(&TransferTable::from_entries(entries, 1.0))
    }

    /// The twin of `find_place` in tree.wgsl: the leaf's box and number.
    fn find(tree: &Tree, root: [u32; 3], point: [u32; 3]) -> ([u32; 3], [u32; 3], u32) {
        let (mut low, mut size, mut word) = ([0; 3], root, tree.nodes[0]);
        while word & LEAF == 0 {
            let mut child = 0;
            for a in 0..3 {
                if word >> (28 + a) & 1 != 0 {
                    size[a] /= 2;
                    if point[a] >= low[a] + size[a] {
                        low[a] += size[a];
                        child |= 1 << a;
                    }
                }
            }
            word = tree.nodes[(word & (HALVES_X - 1)) as usize * GROUP + child];
        }
        (low, size, word & !LEAF)
    }

    /// All cells of a level, except for some split once more and some left out.
    fn list(pyramid: &Pyramid, level: Level) -> DrawList {
        let grid = pyramid.level(level).bricks;
        let mut cells = Vec::new();
        let mut push = |level: Level, index: BrickIndex| {
            let id = BrickId { time: 0, channel: 0, level, index };
            let slot = Slot(cells.len() as u32);
            let region = pyramid.brick_box_voxel(level, index);
            cells.push(DrawCell { cell: id, region, pixels: PixelShare::ALL, brick: id, slot, rank: 0 });
        };
        for i in 0..grid.volume() as u32 {
            let index = BrickIndex::new(i % grid.x, i / grid.x % grid.y, i / grid.x / grid.y);
            match (index.x + 2 * index.y + index.z) % 3 {
                0 => push(level, index),
                1 => pyramid.children(level, index).for_each(|child| push(Level(level.0 - 1), child)),
                _ => {}
            }
        }
        DrawList { cells }
    }

    #[test]
    fn every_voxel_finds_its_cell_and_no_other() {
        let own = Pyramid::new(Extent::new(83, 61, 30), [1.0, 1.0, 2.0], 8);
        let levels: Vec<_> = own.levels()[..3].iter().map(|l| (l.extent, l.factor)).collect();
        // The coarsest level of the second pyramid has several bricks.
        for (pyramid, level) in [(own, Level(2)), (Pyramid::from_levels(&levels, 8), Level(2))] {
            let list = list(&pyramid, level);
            let ranges = vec![[1, 9]; list.cells.len()];
            let atlas = AtlasPlan::new(10, 1000, 1 << 30, 2048, list.cells.len() as u32).unwrap();
            let slots = Slots { atlas: &atlas, apron: 1, macro_cells: 1, ranges: &ranges };
            let opaque = table(|_| 1.0);
            let tree = Tree::new(
                &pyramid,
                &list,
                &Visibility { mode: Mode::Dvr, has_invalid: false, opaque: &opaque, skips_empty: true },
                &slots,
            );
            assert!(tree.nodes.len() / GROUP <= 1 + list.cells.len() * splits(&pyramid).len());
            assert_eq!(pyramid.octree_levels() as usize, 1 + splits(&pyramid).len(), "what renderers make room for");
            let n = pyramid.levels()[0].extent;
            let mut empty = 0;
            for i in (0..n.volume()).step_by(7) {
                let v = [i % n.x as u64, i / n.x as u64 % n.y as u64, i / (n.x as u64 * n.y as u64)].map(|v| v as u32);
                let holds = |c: &DrawCell| {
                    (0..3).all(|a| (c.region.min.to_array()[a]..c.region.max.to_array()[a]).contains(&v[a]))
                };
                let (low, size, number) = find(&tree, root_size(&pyramid), v);
                match list.cells.iter().position(holds) {
                    Some(cell) => {
                        let place = list.cells.len() - cell;
                        assert_eq!(number as usize, place, "{v:?}");
                        let region = list.cells[cell].region;
                        assert_eq!(low, region.min.to_array());
                        let high: [u32; 3] = std::array::from_fn(|a| (low[a] + size[a]).min(n.to_array()[a]));
                        assert_eq!(high, region.max.to_array());
                        assert_eq!(tree.bricks[place - 1].low, low.map(|v| v as f32));
                    }
                    None => {
                        empty += 1;
                        assert_eq!(number, 0, "{v:?}");
                        let meets = |c: &DrawCell| {
                            (0..3).all(|a| {
                                c.region.min.to_array()[a] < low[a] + size[a] && low[a] < c.region.max.to_array()[a]
                            })
                        };
                        assert!(!list.cells.iter().any(meets), "an empty leaf covers nothing that is drawn");
                    }
                }
            }
            assert!(empty > 0);
        }
    }

    #[test]
    fn what_shows_nothing_is_left_out_and_what_shows_all_is_not_looked_into() {
        let pyramid = Pyramid::new(Extent::new(16, 16, 16), [1.0; 3], 8);
        let cells: Vec<_> = pyramid
            .children(Level(1), BrickIndex::default())
            .zip(0..)
            .map(|(index, slot)| {
                let brick = BrickId { time: 0, channel: 0, level: Level(0), index };
                let region = pyramid.brick_box_voxel(brick.level, index);
                DrawCell { cell: brick, region, pixels: PixelShare::ALL, brick, slot: Slot(slot), rank: slot }
            })
            .collect();
        let list = DrawList { cells };
        let none = brickyard_volume::macrocells::NONE;
        let ranges = [[0, 9], [0, 10], [5, 30], [10, 30], [20, 31], [40, 90], none, [15, 15]];
        let atlas = AtlasPlan::new(10, 1000, 1 << 30, 2048, 8).unwrap();
        let slots = Slots { atlas: &atlas, apron: 1, macro_cells: 4, ranges: &ranges };
        let opaque = table(|i| (10..=30).contains(&i) as u8 as f32);
        let firsts = |mode, has_invalid| {
            let tree = Tree::new(
                &pyramid,
                &list,
                &Visibility { mode, has_invalid, opaque: &opaque, skips_empty: true },
                &slots,
            );
            tree.bricks.iter().rev().map(|b| b.first_range).collect::<Vec<_>>()
        };
        assert_eq!(firsts(Mode::Dvr, false), [0, 4, 8, NO_RANGES, 16, 20, 24, NO_RANGES]);
        assert_eq!(firsts(Mode::Mip, false), [0, 4, 8, 12, 16, 20, 28]);
        assert_eq!(firsts(Mode::Average, false), [NO_RANGES; 7]);
        assert_eq!(firsts(Mode::Average, true), [0, 4, 8, 12, 16, 20, 28]);
    }

    #[test]
    fn the_leaf_of_a_brick_that_fades_in_names_it_and_what_it_takes_the_place_of_follows() {
        let pyramid = Pyramid::new(Extent::new(16, 16, 16), [1.0; 3], 8);
        let entry = |x, level, slot, from, to| {
            let cell = BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(x, 0, 0) };
            let index = pyramid.ancestor(Level(0), cell.index, Level(level));
            let brick = BrickId { level: Level(level), index, ..cell };
            let region = pyramid.brick_box_voxel(cell.level, cell.index);
            DrawCell { cell, region, pixels: PixelShare { from, to }, brick, slot: Slot(slot), rank: slot }
        };
        // Far away the one fades in; nearer, the other is whole.
        let list = DrawList { cells: vec![entry(1, 1, 0, 20, 64), entry(1, 0, 1, 0, 20), entry(0, 0, 2, 0, 64)] };
        let atlas = AtlasPlan::new(10, 1000, 1 << 30, 2048, 3).unwrap();
        let opaque = table(|_| 1.0);
        // In a maximum projection a brick without values gets no leaf of its own, but keeps its place in a pair.
        for (mode, of_ancestor) in [(Mode::Dvr, [0, 9]), (Mode::Mip, [0, 9]), (Mode::Mip, macrocells::NONE)] {
            let ranges = [of_ancestor, [1, 2], [3, 4]];
            let slots = Slots { atlas: &atlas, apron: 1, macro_cells: 1, ranges: &ranges };
            let visibility = Visibility { mode, has_invalid: false, opaque: &opaque, skips_empty: true };
            let tree = Tree::new(&pyramid, &list, &visibility, &slots);
            let number = |x| find(&tree, root_size(&pyramid), [x, 0, 0]).2;
            assert_eq!((number(0), number(9)), (1, 2));
            assert_eq!(tree.bricks.iter().map(|b| b.pixels_to).collect::<Vec<_>>(), [64, 20, 64]);
            let expected = [[3, 4], [1, 2], of_ancestor].map(pack_range);
            assert_eq!(tree.bricks.iter().map(|b| b.range).collect::<Vec<_>>(), expected);
        }
    }
}
