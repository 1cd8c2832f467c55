//! A block's part of an isosurface.
//!
//! A voxel is inside if its value is at least the isovalue; voxels without a value, and all outside of the region, are outside. A vertex stands where
//! the values along an edge reach the isovalue, by linear interpolation, at least [`LEAST_DISTANCE`] from either end; towards a voxel without a value in
//! the middle, on the border of the last voxel.

use crate::block_grid::Block;
use crate::cube::{TRIANGLES, edges};
use crate::numbering::{Class, Ranks};
use crate::patch::{Patch, PatchVertex};
use crate::points::{Points, bits, lowest};
use crate::smoothing::{reach_cells, smooth};
use crate::world::{LEAST_DISTANCE, World};
use brickyard_volume::Voxel;
use glam::DVec3;

/// An isosurface.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Isosurface {
    pub(crate) value: f64,
    pub(crate) nodata: Option<f64>,
    pub(crate) smoothing: u32,
}

/// No vertex.
const NONE: u32 = u32::MAX;

/// Vertices and triangles of a block and of the cells that its smoothing needs.
struct Wide {
    places: Vec<DVec3>,
    /// `None` for vertices outside of the block.
    classes: Vec<Option<(Class, u32)>>,
    triangles: Vec<[u32; 3]>,
    /// The positions of the block's own triangles.
    own: Vec<u32>,
    ranks: Ranks,
}

impl Isosurface {
    /// The first and the last voxel needed for a block.
    pub(crate) fn span(&self, block: &Block) -> [[i64; 3]; 2] {
        let reach = reach_cells(self.smoothing);
        [block.first.map(|v| v - reach), block.end.map(|v| v + reach)]
    }

    /// Extracts a block's part from the voxels of its [`span`](Self::span).
    pub(crate) fn patch<T: Voxel>(&self, block: &Block, points: &Points<T>, world: &World) -> Patch {
        let known = |value: T| value.is_valid() && self.nodata.is_none_or(|nodata| value.to_f64() != nodata);
        let known_rows = points.masks(known);
        let mut rows = points.masks(|value| value.to_f64() >= self.value);
        rows.iter_mut().zip(&known_rows).for_each(|(row, known)| *row &= known);
        let mut wide = self.march(block, points, &rows, &known_rows);
        if wide.own.is_empty() {
            return Patch::default();
        }
        smooth(&mut wide.places, &wide.triangles, self.smoothing);
        wide.patch(world)
    }

    fn march<T: Voxel>(&self, block: &Block, points: &Points<T>, rows: &[u128], known: &[u128]) -> Wide {
        let [nx, ny, nz] = points.size;
        let steps = [1, nx, nx * ny];
        let mut wide =
            Wide { places: vec![], classes: vec![], triangles: vec![], own: vec![], ranks: Ranks::default() };
        let mut ids = vec![NONE; 3 * points.values.len()];
        for z in 0..nz {
            for y in 0..ny {
                let row = rows[z * ny + y];
                let along_x = (row ^ row >> 1) & lowest(nx - 1);
                let along_y = if y + 1 < ny { row ^ rows[z * ny + y + 1] } else { 0 };
                let along_z = if z + 1 < nz { row ^ rows[(z + 1) * ny + y] } else { 0 };
                for x in bits(along_x | along_y | along_z) {
                    let at = points.row(y, z) + x;
                    for (axis, _) in
                        [along_x, along_y, along_z].iter().enumerate().filter(|(_, row)| **row >> x & 1 > 0)
                    {
                        ids[3 * at + axis] = wide.places.len() as u32;
                        let mut far = [x, y, z];
                        far[axis] += 1;
                        let is_known = |[x, y, z]: [usize; 3]| known[z * ny + y] >> x & 1 > 0;
                        let share = match is_known([x, y, z]) && is_known(far) {
                            true => self.share(points.values[at].to_f64(), points.values[at + steps[axis]].to_f64()),
                            false => 0.5,
                        };
                        let voxel: [i64; 3] = std::array::from_fn(|a| points.corner[a] + [x, y, z][a] as i64);
                        let place = DVec3::from_array(voxel.map(|v| v as f64)) + DVec3::AXES[axis] * share;
                        let is_own = (0..3).all(|a| {
                            let end = block.end[a] + i64::from(a != axis);
                            (block.first[a]..end).contains(&voxel[a])
                        });
                        let class = is_own.then(|| Class::of(voxel, block.first, block.end, Some(axis)));
                        wide.places.push(place);
                        wide.classes.push(class.map(|class| (class, wide.ranks.next(class))));
                    }
                }
            }
        }
        let offsets = edges().map(|edge| {
            let corner: usize = (0..3).filter(|a| edge.corner >> a & 1 > 0).map(|a| steps[a]).sum();
            3 * corner + usize::from(edge.axis)
        });
        let table = &*TRIANGLES;
        for z in 0..nz - 1 {
            for y in 0..ny - 1 {
                let around =
                    [rows[z * ny + y], rows[z * ny + y + 1], rows[(z + 1) * ny + y], rows[(z + 1) * ny + y + 1]];
                let any = around.iter().fold(0, |all, row| all | row);
                let all = around.iter().fold(u128::MAX, |all, row| all & row);
                for x in bits((any | any >> 1) & !(all & all >> 1) & lowest(nx - 1)) {
                    let pair = |i: usize| (around[i] >> x & 3) << (2 * i);
                    let inside = pair(0) | pair(1) | pair(2) | pair(3);
                    let at = 3 * (points.row(y, z) + x);
                    let is_own = (0..3).all(|a| {
                        let cell = points.corner[a] + [x, y, z][a] as i64;
                        (block.first[a]..block.end[a]).contains(&cell)
                    });
                    for triangle in &table[inside as usize] {
                        if is_own {
                            wide.own.push(wide.triangles.len() as u32);
                        }
                        wide.triangles.push(triangle.map(|edge| ids[at + offsets[usize::from(edge)]]));
                    }
                }
            }
        }
        wide
    }

    /// Where values along an edge reach the isovalue, in voxels from its first end.
    fn share(&self, from: f64, to: f64) -> f64 {
        ((self.value - from) / (to - from)).clamp(LEAST_DISTANCE, 1.0 - LEAST_DISTANCE)
    }
}

impl Wide {
    /// The block's own part, in the world.
    fn patch(self, world: &World) -> Patch {
        let mut kept = vec![NONE; self.places.len()];
        let mut patch = Patch { ranks: self.ranks, ..Patch::default() };
        for (i, (place, class)) in self.places.iter().zip(&self.classes).enumerate() {
            if let Some((class, rank)) = *class {
                kept[i] = patch.vertices.len() as u32;
                patch.vertices.push(PatchVertex { place: world.place(*place), class, rank, is_fixed: false });
            }
        }
        let own = self.own.iter().map(|i| self.triangles[*i as usize].map(|vertex| kept[vertex as usize]));
        patch.triangles = own.map(|[a, b, c]| if world.mirrors { [a, c, b] } else { [a, b, c] }).collect();
        patch
    }
}
