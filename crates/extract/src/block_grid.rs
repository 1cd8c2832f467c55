//! Blocks of cells: the units of work, in their order.
//!
//! Places count voxels of the level. Cell `c` lies between the centres of voxels `c` and `c + 1`, so a box of voxels `[min, max)` has the cells
//! `[min - 1, max)`: the outermost ones reach a voxel past it, where nothing is, and close the surface.

use brickyard_volume::VoxelBox;

/// Cells along the edge of a block.
pub(crate) const BLOCK_CELLS: i64 = 32;

/// Blocks along the edge of a tile. Tiles are of the size of common bricks, so that a decoded brick is used up at once.
const TILE_BLOCKS: i64 = 2;

/// A block's position, `[z, y, x]`: sorted as the slowest axis.
pub(crate) type BlockIndex = [u32; 3];

/// The blocks of a box of voxels.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BlockGrid {
    /// The first block's corner.
    corner: [i64; 3],
    /// The first cell.
    first: [i64; 3],
    /// The end of the cells, excluded.
    end: [i64; 3],
}

/// A box of cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Block {
    pub(crate) index: BlockIndex,
    /// The first cell, `[x, y, z]`.
    pub(crate) first: [i64; 3],
    /// The end of the cells, excluded.
    pub(crate) end: [i64; 3],
}

impl BlockGrid {
    /// The blocks of a part of `whole`: those of the whole that it touches, cut off at its sides.
    pub(crate) fn of(part: VoxelBox, whole: VoxelBox) -> Self {
        let [origin, first] = [whole, part].map(|region| region.min.to_array().map(|v| i64::from(v) - 1));
        let corner = std::array::from_fn(|a| first[a] - (first[a] - origin[a]).rem_euclid(BLOCK_CELLS));
        Self { corner, first, end: part.max.to_array().map(i64::from) }
    }

    /// All blocks, tile by tile. A block's predecessors along each axis come before it.
    pub(crate) fn blocks(self) -> impl Iterator<Item = Block> {
        let blocks: [i64; 3] = std::array::from_fn(|a| (self.end[a] - self.corner[a] + BLOCK_CELLS - 1) / BLOCK_CELLS);
        let tiles = [2, 1, 0].map(|a| (blocks[a] + TILE_BLOCKS - 1) / TILE_BLOCKS);
        let within = move |tile: i64, a: usize| tile * TILE_BLOCKS..((tile + 1) * TILE_BLOCKS).min(blocks[a]);
        grid(tiles.map(|n| 0..n))
            .flat_map(move |[z, y, x]| grid([within(z, 2), within(y, 1), within(x, 0)]))
            .map(move |place| self.block(place))
    }

    fn block(self, [z, y, x]: [i64; 3]) -> Block {
        let place = [x, y, z];
        let corner: [i64; 3] = std::array::from_fn(|a| self.corner[a] + BLOCK_CELLS * place[a]);
        let first = std::array::from_fn(|a| self.first[a].max(corner[a]));
        let end = std::array::from_fn(|a| self.end[a].min(corner[a] + BLOCK_CELLS));
        // A level has less than 2^32 voxels along an axis.
        Block { index: [z, y, x].map(|i| i as u32), first, end }
    }
}

/// All places of a grid, the last axis fastest.
fn grid([z, y, x]: [std::ops::Range<i64>; 3]) -> impl Iterator<Item = [i64; 3]> {
    z.flat_map(move |k| {
        let x = x.clone();
        y.clone().flat_map(move |j| x.clone().map(move |i| [k, j, i]))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    #[test]
    fn blocks_share_out_the_cells_and_follow_their_predecessors() {
        let part = VoxelBox::new([5, 0, 7], [5 + 100, 31, 7 + 65]);
        let (mut seen, mut cells) = (HashSet::new(), 0);
        for block in BlockGrid::of(part, part).blocks() {
            for a in 0..3 {
                if let Some(before) = block.index[a].checked_sub(1) {
                    let mut index = block.index;
                    index[a] = before;
                    assert!(seen.contains(&index), "{block:?}");
                }
            }
            assert!(seen.insert(block.index));
            cells += (0..3).map(|a| block.end[a] - block.first[a]).product::<i64>();
        }
        assert_eq!(cells, 101 * 32 * 66);
        // Blocks of the whole, wherever the part begins: the first one from cell 2 + 32 on.
        let blocks: Vec<Block> = BlockGrid::of(part, VoxelBox::new([3, 0, 7], [900, 900, 900])).blocks().collect();
        assert_eq!((blocks[0].first, blocks[0].end), ([4, -1, 6], [34, 31, 38]));
        assert_eq!(blocks.iter().map(|b| (0..3).map(|a| b.end[a] - b.first[a]).product::<i64>()).sum::<i64>(), cells);
    }
}
