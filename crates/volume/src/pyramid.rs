//! The pyramid: the extents and factors of all levels, their brick grids, and the octree over the grids.
//!
//! Level `k + 1` halves an axis of level `k` only while its spacing is within sqrt(2) of the finest, so anisotropic data tend to isotropic;
//! an axis of one voxel is neither halved nor counted. The coarsest level is a single brick. Extents round up. All of this is arithmetic on
//! a short list: no per-brick memory.

use crate::space::{BrickIndex, Extent, Level, VoxelBox};

/// The grid of one level of a pyramid.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LevelGrid {
    /// Voxels of this level along each axis.
    pub extent: Extent,
    /// Level-0 voxels per voxel of this level, `[x, y, z]`; powers of two.
    pub factor: [u32; 3],
    /// Bricks of this level along each axis.
    pub bricks: Extent,
}

/// All levels of a volume and the octree over their bricks.
#[derive(Clone, Debug, PartialEq)]
pub struct Pyramid {
    edge: u32,
    levels: Vec<LevelGrid>,
}

impl Pyramid {
    /// Creates the pyramid of a volume of `extent` voxels with `spacing` (world units, `[x, y, z]`) and bricks of `edge`^3.
    ///
    /// # Panics
    /// If an axis of the extent or the edge is zero.
    pub fn new(extent: Extent, spacing: [f64; 3], edge: u32) -> Self {
        assert!(edge > 0 && extent.volume() > 0, "empty extent or brick");
        let mut shapes = vec![(extent, [1; 3])];
        while let Some(&(extent, factor)) = shapes.last() {
            let n = extent.to_array();
            if n.iter().all(|&n| n <= edge) {
                break;
            }
            let size: [f64; 3] = std::array::from_fn(|a| spacing[a].abs() * factor[a] as f64);
            let finest = (0..3).filter(|&a| n[a] > 1).map(|a| size[a]).fold(f64::INFINITY, f64::min);
            let halve: [bool; 3] =
                std::array::from_fn(|a| n[a] > 1 && size[a] <= finest * std::f64::consts::SQRT_2 * (1.0 + 1e-9));
            let next = std::array::from_fn(|a| if halve[a] { n[a].div_ceil(2) } else { n[a] });
            let factor = std::array::from_fn(|a| if halve[a] { factor[a] * 2 } else { factor[a] });
            shapes.push((Extent::from_array(next), factor));
        }
        Self::from_levels(&shapes, edge)
    }

    /// Creates a pyramid from known levels (a store's), finest first, as (extent, factor).
    ///
    /// # Panics
    /// If there is no level or the edge is zero.
    pub fn from_levels(levels: &[(Extent, [u32; 3])], edge: u32) -> Self {
        assert!(!levels.is_empty() && edge > 0, "no level");
        let grid = |&(extent, factor): &(Extent, [u32; 3])| LevelGrid {
            extent,
            factor,
            bricks: Extent::from_array(extent.to_array().map(|n| n.div_ceil(edge))),
        };
        Self { edge, levels: levels.iter().map(grid).collect() }
    }

    /// Voxels along the edge of a brick's core.
    pub fn edge(&self) -> u32 {
        self.edge
    }

    /// All levels, finest first.
    pub fn levels(&self) -> &[LevelGrid] {
        &self.levels
    }

    /// The grid of one level.
    ///
    /// # Panics
    /// If there is no such level.
    pub fn level(&self, level: Level) -> &LevelGrid {
        &self.levels[level.index()]
    }

    /// The coarsest level.
    pub fn coarsest(&self) -> Level {
        Level((self.levels.len() - 1) as u8)
    }

    /// Levels of the octree over the pyramid's bricks: the pyramid's own, and those above a coarsest level of several bricks, up to a single
    /// cell.
    pub fn octree_levels(&self) -> u32 {
        let widest = self.level(self.coarsest()).bricks.to_array().into_iter().fold(1, u32::max);
        self.levels.len() as u32 + widest.next_power_of_two().trailing_zeros()
    }

    /// Total number of bricks of all levels.
    pub fn brick_count(&self) -> u64 {
        self.levels.iter().map(|l| l.bricks.volume()).sum()
    }

    /// Whether level `level + 1` halves each axis; all false at the coarsest level.
    fn halved(&self, level: Level) -> [bool; 3] {
        match self.levels.get(level.index() + 1) {
            Some(coarse) => std::array::from_fn(|a| coarse.factor[a] > self.level(level).factor[a]),
            None => [false; 3],
        }
    }

    /// The next coarser level's brick around brick `index` of `level`; `None` at the coarsest level.
    pub fn parent(&self, level: Level, index: BrickIndex) -> Option<BrickIndex> {
        if level >= self.coarsest() {
            return None;
        }
        let halved = self.halved(level);
        let i = index.to_array();
        Some(BrickIndex::from_array(std::array::from_fn(|a| i[a] >> halved[a] as u32)))
    }

    /// The brick of coarser level `to` around brick `index` of level `from`.
    ///
    /// # Panics
    /// If `to` is finer than `from` or past the coarsest.
    pub fn ancestor(&self, from: Level, index: BrickIndex, to: Level) -> BrickIndex {
        let (fine, coarse) = (self.level(from).factor, self.level(to).factor);
        let i = index.to_array();
        BrickIndex::from_array(std::array::from_fn(|a| i[a] / (coarse[a] / fine[a])))
    }

    /// Iterates over the next finer level's bricks inside brick `index` of `level`, in memory order: 8, or fewer where only some axes are
    /// halved or the volume ends; none at level 0.
    pub fn children(&self, level: Level, index: BrickIndex) -> impl Iterator<Item = BrickIndex> + use<> {
        let finer = level.0.checked_sub(1).map(Level);
        let (halved, bricks) = match finer {
            Some(l) => (self.halved(l), self.level(l).bricks),
            None => ([false; 3], Extent::default()),
        };
        let i = index.to_array();
        (0..8u32).filter_map(move |octant| {
            let bit = [octant & 1, octant >> 1 & 1, octant >> 2 & 1];
            if (0..3).any(|a| bit[a] == 1 && !halved[a]) {
                return None;
            }
            let child = std::array::from_fn(|a| if halved[a] { i[a] * 2 + bit[a] } else { i[a] });
            bricks.contains(child).then_some(BrickIndex::from_array(child))
        })
    }

    /// Iterates over the positions of a brick's core voxels in its level, `[x, y, z]`, in the order of a core's bytes: x fastest, including
    /// positions past the level's end.
    pub fn core_voxels(&self, index: BrickIndex) -> impl Iterator<Item = [u32; 3]> + use<> {
        let first = index.to_array().map(|i| i * self.edge);
        VoxelBox::new(first, first.map(|n| n + self.edge)).voxels()
    }

    /// The brick's core in its own level's voxels, clipped to the level.
    pub fn brick_box(&self, level: Level, index: BrickIndex) -> VoxelBox {
        self.core_box(index, [1; 3], self.level(level).extent)
    }

    /// The brick's box in level-0 voxels, clipped to level 0 (whatever the rounding of coarser extents).
    pub fn brick_box_voxel(&self, level: Level, index: BrickIndex) -> VoxelBox {
        self.core_box(index, self.level(level).factor, self.levels[0].extent)
    }

    /// A brick's core in voxels `factor` times finer than its own, clipped to an extent.
    fn core_box(&self, index: BrickIndex, factor: [u32; 3], extent: Extent) -> VoxelBox {
        let (i, n) = (index.to_array(), extent.to_array());
        let corner = |d: u32| {
            std::array::from_fn(|a| ((i[a] + d) as u64 * self.edge as u64 * factor[a] as u64).min(n[a] as u64) as u32)
        };
        VoxelBox::new(corner(0), corner(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn shapes(p: &Pyramid) -> Vec<[u32; 3]> {
        p.levels().iter().map(|l| l.extent.to_array()).collect()
    }

    #[test]
    fn isotropic_levels_halve_until_one_brick() {
        let p = Pyramid::new(Extent::new(100, 37, 211), [1.0; 3], 64);
        assert_eq!(shapes(&p), [[100, 37, 211], [50, 19, 106], [25, 10, 53]]);
    }

    #[test]
    fn anisotropic_levels_tend_to_isotropic() {
        let p = Pyramid::new(Extent::new(512, 512, 100), [0.5, 0.5, 2.0], 64);
        assert_eq!(
            p.levels().iter().map(|l| l.factor).collect::<Vec<_>>(),
            [[1, 1, 1], [2, 2, 1], [4, 4, 1], [8, 8, 2]]
        );
    }

    #[test]
    fn core_voxels_are_in_the_order_of_a_core_s_bytes() {
        let p = Pyramid::new(Extent::new(5, 5, 5), [1.0; 3], 2);
        let voxels: Vec<_> = p.core_voxels(BrickIndex { x: 1, y: 0, z: 2 }).collect();
        let expected = [[2, 0, 4], [3, 0, 4], [2, 1, 4], [3, 1, 4], [2, 0, 5], [3, 0, 5], [2, 1, 5], [3, 1, 5]];
        assert_eq!(voxels, expected);
    }

    #[test]
    fn a_single_slice_stays_one() {
        let p = Pyramid::new(Extent::new(300, 200, 1), [1.0; 3], 64);
        assert_eq!(shapes(&p), [[300, 200, 1], [150, 100, 1], [75, 50, 1], [38, 25, 1]]);
    }

    proptest! {
        #[test]
        fn children_partition_the_parent(
            n in prop::array::uniform3(1u32..600), s in prop::array::uniform3(0.3f64..4.0), edge in prop::sample::select(vec![8u32, 16, 64]),
        ) {
            let p = Pyramid::new(Extent::from_array(n), s, edge);
            for l in 1..p.levels().len() {
                let level = Level(l as u8);
                let g = p.level(level).bricks;
                let mut seen = 0;
                for z in 0..g.z { for y in 0..g.y { for x in 0..g.x {
                    let index = BrickIndex::new(x, y, z);
                    let whole = p.brick_box_voxel(level, index).extent().volume();
                    let finer = Level(level.0 - 1);
                    let parts: u64 = p.children(level, index).map(|c| {
                        assert_eq!(p.parent(finer, c), Some(index));
                        assert_eq!(p.ancestor(finer, c, level), index);
                        seen += 1;
                        p.brick_box_voxel(finer, c).extent().volume()
                    }).sum();
                    prop_assert_eq!(whole, parts);
                }}}
                prop_assert_eq!(seen, p.level(Level(level.0 - 1)).bricks.volume());
            }
            prop_assert_eq!(p.level(p.coarsest()).bricks.volume(), 1);
        }
    }
}
