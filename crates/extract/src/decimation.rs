//! Decimation of a mesh in pieces: of each block, then of larger cells shifted by half a block, so that the first borders are inside.
//!
//! Cells begin as large as blocks and join in octrees while a part of the surface fits a fixed weight, whatever the threads and the memory. Parts of
//! labels' borders towards different labels are decimated each for itself: so both labels of such a part get the same triangles.

use crate::block_grid::BLOCK_CELLS;
use crate::collapse::collapse;
use crate::patch::Patch;
use crate::piece::Piece;
use crate::world::World;
use brickyard_volume::VoxelBox;
use glam::DVec3;
use std::collections::BTreeMap;

/// Most triangles and covered points of joined cells.
pub(crate) const MOST_WEIGHT: u64 = 1 << 18;

/// Times that cells join by eight: up to 8 blocks along an axis.
const JOINS: u32 = 3;

/// Bits of a cell's place along an axis; the few cells further away count as one.
const AXIS_BITS: u32 = 21;

/// A part of a mesh, decimated by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Region {
    /// The label on the other side, of labels.
    pub(crate) sheet: i64,
    /// The cell, numbered so that those of a larger one follow one another (Morton, 1966).
    pub(crate) cell: u64,
}

/// How a mesh is decimated.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Decimation {
    world: World,
    /// Farthest of a removed vertex from the mesh, in the world.
    tolerance: f64,
    /// The first cell's corner, in voxels.
    corner: DVec3,
}

impl Decimation {
    /// A decimation within `tolerance_voxels` of the smallest edge of a voxel.
    pub(crate) fn new(world: World, region: VoxelBox, tolerance_voxels: f64) -> Self {
        let first = DVec3::from_array(region.min.to_array().map(|v| f64::from(v) - 1.0));
        let corner = first - 0.5 * BLOCK_CELLS as f64;
        Self { world, tolerance: tolerance_voxels * world.least_step, corner }
    }

    /// Decimates a block's patch. The vertices' ids are their places in the patch.
    pub(crate) fn of_patch(&self, patch: &Patch) -> Vec<(Region, Piece)> {
        let mut sheets = BTreeMap::<i64, Vec<[u32; 3]>>::new();
        for (i, triangle) in patch.triangles.iter().enumerate() {
            let sheet = patch.sheets.get(i).copied().unwrap_or_default();
            sheets.entry(sheet).or_default().push(*triangle);
        }
        let mut whole = Piece {
            ids: (0..patch.vertices.len() as u64).collect(),
            places: patch.vertices.iter().map(|vertex| vertex.place).collect(),
            is_fixed: patch.vertices.iter().map(|vertex| vertex.is_fixed).collect(),
            ..Piece::default()
        };
        let mut parts = Vec::new();
        for (sheet, triangles) in sheets {
            let count = triangles.len();
            whole.triangles = triangles;
            let of_sheet = whole.part((0..count).map(|triangle| (triangle, Vec::new())));
            let mut piece = collapse(of_sheet, self.tolerance);
            // The block's borders are free again.
            for (id, is_fixed) in piece.ids.iter().zip(&mut piece.is_fixed) {
                *is_fixed = patch.vertices[*id as usize].is_fixed;
            }
            let cells = piece.split(|place| self.cell(place));
            parts.extend(cells.into_iter().map(|(cell, piece)| (Region { sheet, cell }, piece)));
        }
        parts
    }

    /// Decimates the pieces of a region together. Fixed vertices of the result may be in others, too.
    pub(crate) fn of_region(&self, pieces: &[Piece]) -> Piece {
        collapse(Piece::join(pieces), self.tolerance)
    }

    fn cell(&self, place: DVec3) -> u64 {
        let index = (self.world.index(place) - self.corner) / BLOCK_CELLS as f64;
        let last = (1u64 << AXIS_BITS) - 1;
        let parts = index.to_array().map(|part| (part as u64).min(last));
        (0..AXIS_BITS).map(|bit| (0..3).map(|a| (parts[a] >> bit & 1) << (3 * bit + a as u32)).sum::<u64>()).sum()
    }
}

/// The lengths of runs of parts to decimate together, of regions ascending with the weight of each.
pub(crate) fn runs(parts: &[(Region, u64)]) -> Vec<usize> {
    let sheets = parts.chunk_by(|a, b| a.0.sheet == b.0.sheet);
    sheets.flat_map(|sheet| runs_of_cells(sheet, JOINS)).collect()
}

fn runs_of_cells(parts: &[(Region, u64)], joins: u32) -> Vec<usize> {
    let cell = |part: &(Region, u64)| part.0.cell >> (3 * joins);
    let mut lengths = Vec::new();
    for joined in parts.chunk_by(|a, b| cell(a) == cell(b)) {
        let weight: u64 = joined.iter().map(|(_, weight)| weight).sum();
        if weight <= MOST_WEIGHT {
            lengths.push(joined.len());
        } else if joins > 0 {
            lengths.extend(runs_of_cells(joined, joins - 1));
        } else {
            lengths.extend(joined.iter().map(|_| 1));
        }
    }
    lengths
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cells_join_as_long_as_they_are_light() {
        let parts = |sheet: i64, cells: &[(u64, u64)]| -> Vec<(Region, u64)> {
            cells.iter().map(|(cell, weight)| (Region { sheet, cell: *cell }, *weight)).collect()
        };
        let light = MOST_WEIGHT / 10;
        // Cells of one eightfold cell of the third order, and one of the next.
        assert_eq!(runs(&parts(0, &[(0, light), (0, light), (9, light), (511, light), (512, light)])), [4, 1]);
        // Another label's part is apart.
        let mut both = parts(0, &[(0, light)]);
        both.extend(parts(1, &[(0, light), (1, light)]));
        assert_eq!(runs(&both), [1, 2]);
        // Too heavy as a whole: the first eight cells are one part, the next ones another; a heavy cell falls apart into its pieces.
        let heavy = MOST_WEIGHT / 2;
        assert_eq!(runs(&parts(0, &[(0, heavy), (7, heavy), (8, light), (15, light), (64, light)])), [2, 2, 1]);
        assert_eq!(runs(&parts(0, &[(3, heavy), (3, heavy), (3, heavy), (4, light)])), [1, 1, 1, 1]);
    }
}
