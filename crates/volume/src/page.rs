//! A page: the bricks of one time step, channel and level whose side data are stored, read and forgotten together.
//!
//! A page holds a box of up to 16³ bricks. So side data are read on demand, take the same memory for any volume,
//! and grow by whole pages as time steps are added. Arithmetic only.

use crate::pyramid::Pyramid;
use crate::space::{BrickId, BrickIndex, Extent, Level, VoxelBox};
use serde::{Deserialize, Serialize};

/// The most bricks along a page's edge.
pub const PAGE_EDGE_BRICKS: u32 = 16;

/// The key of one page.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
pub struct PageId {
    /// Time step of the page's bricks, from 0.
    pub time: u32,
    /// Channel of the page's bricks, from 0.
    pub channel: u32,
    /// Level of the page's bricks.
    pub level: Level,
    /// Place in the level's grid of pages along z.
    pub z: u32,
    /// Place in the level's grid of pages along y.
    pub y: u32,
    /// Place in the level's grid of pages along x.
    pub x: u32,
}

impl std::fmt::Display for PageId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { time, channel, level, z, y, x } = self;
        write!(f, "t{time} c{channel} level {level} page ({x},{y},{z})")
    }
}

/// Division of a grid of cells (bricks, or shards) into pages.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Paging {
    grid: Extent,
    page: Extent,
}

impl Paging {
    /// Divides a grid of cells into pages.
    pub fn new(grid: Extent) -> Self {
        Self { grid, page: Extent::from_array(grid.to_array().map(|n| n.min(PAGE_EDGE_BRICKS))) }
    }

    /// Cells of a page along each axis; pages at the far faces may reach past the grid.
    pub fn page_extent(self) -> Extent {
        self.page
    }

    /// Number of pages along each axis.
    pub fn page_grid(self) -> Extent {
        let (grid, page) = (self.grid.to_array(), self.page.to_array());
        Extent::from_array(std::array::from_fn(|a| grid[a].div_ceil(page[a])))
    }

    /// Cells of a page, including those past the grid.
    pub fn page_cells(self) -> usize {
        self.page.volume() as usize
    }

    /// Returns the page `[x, y, z]` of a cell, and the cell's row-major place in it.
    pub fn locate(self, cell: [u32; 3]) -> ([u32; 3], usize) {
        let page = self.page.to_array();
        let place = self.page.linear(std::array::from_fn(|a| cell[a] % page[a]));
        (std::array::from_fn(|a| cell[a] / page[a]), place as usize)
    }

    /// The cells of a page inside the grid.
    pub fn cells(self, page: [u32; 3]) -> VoxelBox {
        let size = self.page.to_array();
        let min: [u32; 3] = std::array::from_fn(|a| page[a].saturating_mul(size[a]));
        VoxelBox::new(min, std::array::from_fn(|a| min[a].saturating_add(size[a]))).intersect(self.grid.full_box())
    }
}

impl Pyramid {
    /// Division of a level's bricks into pages.
    pub fn paging(&self, level: Level) -> Paging {
        Paging::new(self.level(level).bricks)
    }

    /// The page of a brick, and the brick's place in it.
    pub fn page_of(&self, id: BrickId) -> (PageId, usize) {
        let ([x, y, z], place) = self.paging(id.level).locate(id.index.to_array());
        (PageId { time: id.time, channel: id.channel, level: id.level, z, y, x }, place)
    }

    /// Iterates over the bricks of a page in memory order, each with its place in the page.
    pub fn bricks_of_page(&self, page: PageId) -> impl Iterator<Item = (BrickId, usize)> + use<> {
        let paging = self.paging(page.level);
        let PageId { time, channel, level, z, y, x } = page;
        paging.cells([x, y, z]).voxels().map(move |cell| {
            let index = BrickIndex::from_array(cell);
            (BrickId { time, channel, level, index }, paging.locate(cell).1)
        })
    }

    /// Number of pages of all levels of one time step and channel.
    pub fn page_count(&self) -> u64 {
        self.levels().iter().map(|level| Paging::new(level.bricks).page_grid().volume()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_brick_has_one_place_in_one_page() {
        let pyramid = Pyramid::new(Extent::new(300, 37, 130), [1.0; 3], 8);
        let mut pages = 0;
        for level in 0..pyramid.levels().len() {
            let level = Level(level as u8);
            let (grid, paging) = (pyramid.level(level).bricks, pyramid.paging(level));
            let mut seen = 0;
            for page in 0..paging.page_grid().volume() {
                let (n, page) = (paging.page_grid(), page as u32);
                let id = PageId { time: 1, channel: 2, level, z: page / n.x / n.y, y: page / n.x % n.y, x: page % n.x };
                let mut last = None;
                for (brick, place) in pyramid.bricks_of_page(id) {
                    assert_eq!(pyramid.page_of(brick), (id, place));
                    assert!(place < paging.page_cells() && last < Some(place));
                    last = Some(place);
                    seen += 1;
                }
                pages += 1;
            }
            assert_eq!(seen, grid.volume());
        }
        assert_eq!(pages, pyramid.page_count());
        // 38 x 5 x 17 bricks in pages of 16 x 5 x 16.
        assert_eq!(pyramid.paging(Level(0)).page_grid(), Extent::new(3, 1, 2));
    }
}
