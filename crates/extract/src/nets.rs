//! A block's part of a label's border: surface nets (Gibson, 1998) over all labels at once.
//!
//! Each cell with unlike corners has one vertex, shared by all its labels, and each edge of voxels between unlike labels one face, through the vertices of
//! the four cells around it. So neighbours have the very same vertices and triangles at their common border, turned round, also when each is extracted
//! for itself. Smoothing moves a vertex towards the mean of its neighbours, but never out of its cell.
//!
//! Where four voxels around a face meet crosswise, four faces of one label would share an edge. One diagonal is therefore *joined*: the two faces at one
//! corner of the other one turn aside over a vertex in the middle, and each edge has two triangles in every label's mesh.

use crate::block_grid::Block;
use crate::numbering::Class;
use crate::patch::{Patch, PatchVertex};
use crate::points::Points;
use crate::world::World;
use brickyard_volume::Voxel;
use brickyard_volume::labels::label_of;
use glam::DVec3;

/// The border of one label.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Nets {
    pub(crate) label: i64,
    pub(crate) nodata: Option<f64>,
    pub(crate) smoothing: u32,
}

/// Everything without a label.
const OUTSIDE: i64 = i64::MIN;

/// Farthest from a cell's centre that smoothing moves its vertex along an axis, in voxels; less than half, so vertices of two cells never meet.
const MOST_MOVE: f64 = 0.5 - 1.0 / 1024.0;

/// The part of the way to the neighbours' mean taken by each iteration.
const RELAXATION: f64 = 0.5;

/// Distance of a turn from the middle between its cells' vertices, along both axes of the face, in voxels.
const TURN: f64 = 0.125;

/// No vertex.
const NONE: u32 = u32::MAX;

/// The labels around a block, and the vertices of its cells.
struct Lattice<'a> {
    block: &'a Block,
    /// The first voxel, which is also the first cell.
    corner: [i64; 3],
    size: [usize; 3],
    steps: [usize; 3],
    labels: Vec<i64>,
    /// Places of cells' vertices, in voxels; empty without smoothing.
    moved: Vec<DVec3>,
    /// Positions among `moved` by cell.
    active: Vec<u32>,
}

impl Nets {
    /// The first and the last voxel needed for a block: its faces need the cells before it, too.
    pub(crate) fn span(&self, block: &Block) -> [[i64; 3]; 2] {
        let reach = i64::from(self.smoothing);
        [block.first.map(|v| v - 1 - reach), block.end.map(|v| v + reach)]
    }

    /// Extracts a block's part from the voxels of its [`span`](Self::span).
    pub(crate) fn patch<T: Voxel>(&self, block: &Block, points: &Points<T>, world: &World) -> Patch {
        let label = |(i, value): (usize, &T)| {
            let x = i % points.size[0];
            let (y, z) = (i / points.size[0] % points.size[1], i / points.size[0] / points.size[1]);
            let value = value.to_f64();
            let is_known = points.covers([x, y, z]) && self.nodata != Some(value);
            label_of(value).filter(|_| is_known).unwrap_or(OUTSIDE)
        };
        let labels: Vec<i64> = points.values.iter().enumerate().map(label).collect();
        if !labels.contains(&self.label) {
            return Patch::default();
        }
        let [nx, ny, _] = points.size;
        let mut lattice = Lattice {
            block,
            corner: points.corner,
            size: points.size,
            steps: [1, nx, nx * ny],
            labels,
            moved: Vec::new(),
            active: Vec::new(),
        };
        if self.smoothing > 0 {
            lattice.relax(self.smoothing);
        }
        lattice.patch(self.label, world)
    }
}

impl Lattice<'_> {
    /// The position of a voxel or cell.
    fn at(&self, place: [i64; 3]) -> usize {
        (0..3).map(|a| (place[a] - self.corner[a]) as usize * self.steps[a]).sum()
    }

    fn corners(&self, cell: usize) -> [i64; 8] {
        std::array::from_fn(|i| {
            self.labels[cell + (0..3).filter(|a| i >> a & 1 > 0).map(|a| self.steps[a]).sum::<usize>()]
        })
    }

    /// The labels around a cell's lower face across an axis, in a circle: at (0, 0), (1, 0), (1, 1) and (0, 1) of the two following axes.
    fn face(&self, cell: usize, axis: usize) -> [i64; 4] {
        let [u, v] = [1, 2].map(|k| self.steps[(axis + k) % 3]);
        [0, u, u + v, v].map(|step| self.labels[cell + step])
    }

    /// Moves the vertices of all cells with unlike corners.
    fn relax(&mut self, iterations: u32) {
        let cells = self.size.map(|n| n - 1);
        self.active = vec![NONE; self.labels.len()];
        let (mut centres, mut positions) = (Vec::new(), Vec::new());
        for z in 0..cells[2] {
            for y in 0..cells[1] {
                for x in 0..cells[0] {
                    let cell = x + y * self.steps[1] + z * self.steps[2];
                    let corners = self.corners(cell);
                    if corners.iter().any(|label| *label != corners[0]) {
                        self.active[cell] = centres.len() as u32;
                        let place: [i64; 3] = std::array::from_fn(|a| self.corner[a] + [x, y, z][a] as i64);
                        centres.push(centre(place));
                        positions.push((cell, [x, y, z]));
                    }
                }
            }
        }
        let neighbours: Vec<[u32; 6]> =
            positions.iter().map(|(cell, place)| self.neighbours(*cell, *place, cells)).collect();
        self.moved = centres.clone();
        let mut before = centres.clone();
        for _ in 0..iterations {
            std::mem::swap(&mut before, &mut self.moved);
            for (i, around) in neighbours.iter().enumerate() {
                let around = around.iter().filter(|other| **other != NONE);
                let (sum, count) =
                    around.fold((DVec3::ZERO, 0.0), |(sum, count), other| (sum + before[*other as usize], count + 1.0));
                let wanted = if count > 0.0 { before[i] + RELAXATION * (sum / count - before[i]) } else { before[i] };
                self.moved[i] = wanted.clamp(centres[i] - MOST_MOVE, centres[i] + MOST_MOVE);
            }
        }
    }

    /// The cells across faces with unlike corners.
    fn neighbours(&self, cell: usize, place: [usize; 3], cells: [usize; 3]) -> [u32; 6] {
        std::array::from_fn(|i| {
            let (axis, is_next) = (i / 2, i % 2 > 0);
            let end = if is_next { cells[axis] - 1 } else { 0 };
            if place[axis] == end {
                return NONE;
            }
            let upper = if is_next { cell + self.steps[axis] } else { cell };
            let around = self.face(upper, axis);
            let is_crossed = around.iter().any(|label| *label != around[0]);
            if is_crossed { self.active[if is_next { upper } else { cell - self.steps[axis] }] } else { NONE }
        })
    }

    /// A cell's vertex, in voxels.
    fn vertex(&self, cell: [i64; 3]) -> DVec3 {
        if self.moved.is_empty() { centre(cell) } else { self.moved[self.active[self.at(cell)] as usize] }
    }

    fn patch(&self, label: i64, world: &World) -> Patch {
        let mut patch = Patch::default();
        let ids = self.place_vertices(label, world, &mut patch);
        for place in places(self.block.first, self.block.end) {
            let at = self.at(place);
            for axis in 0..3 {
                let [from, to] = [self.labels[at], self.labels[at + self.steps[axis]]];
                if (from == label) == (to == label) {
                    continue;
                }
                let around = self.around(place, axis);
                let around: Vec<u32> = around.into_iter().flatten().map(|(cell, kind)| ids[4 * cell + kind]).collect();
                let turns_round = (from == label) == world.mirrors;
                let first_turn = around.len() > 4;
                let triangle = |[a, b, c]: [u32; 3]| if turns_round { [a, c, b] } else { [a, b, c] };
                if first_turn {
                    patch
                        .triangles
                        .extend((1..around.len() - 1).map(|k| triangle([around[0], around[k], around[k + 1]])));
                } else {
                    let apart = |i: usize, j: usize| {
                        let [a, b] = [i, j].map(|k| patch.vertices[around[k] as usize].place);
                        a.distance_squared(b)
                    };
                    let first = usize::from(apart(1, 3) < apart(0, 2));
                    let corner = |k: usize| around[(first + k) % 4];
                    let split = [[corner(0), corner(1), corner(2)], [corner(0), corner(2), corner(3)]];
                    patch.triangles.extend(split.map(triangle));
                }
                patch.sheets.resize(patch.triangles.len(), if from == label { to } else { from });
            }
        }
        patch
    }

    /// The vertices around the edge from a voxel along an axis, anticlockwise from its far end; a turn, if there is one, first. Each is a cell and its
    /// kind: 0 for the cell's own vertex, else one more than the axis across which it turns.
    fn around(&self, place: [i64; 3], axis: usize) -> [Option<(usize, usize)>; 8] {
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let at = self.at(place);
        let (before_u, before_v) = (at - self.steps[u], at - self.steps[v]);
        let cells = [before_u - self.steps[v], before_v, at, before_u];
        // Between each cell and the next: the cell whose lower face it is, and the axis across it.
        let faces = [(before_v, u), (at, v), (at, u), (before_u, v)];
        let mut found = [None; 8];
        for (k, (cell, (upper, across))) in cells.into_iter().zip(faces).enumerate() {
            found[2 * k] = Some((cell, 0));
            let far = at + self.steps[axis];
            let is_turned = self.turn(upper, across).is_some_and(|(corner, _)| corner == at || corner == far);
            found[2 * k + 1] = is_turned.then_some((upper, 1 + across));
        }
        if let Some(turn) = (0..4).find(|k| found[2 * k + 1].is_some()) {
            found.rotate_left(2 * turn + 1);
        }
        found
    }

    /// The voxel towards which faces turn aside at a cell's lower face, and the direction from the face's middle in voxels; `None` unless the labels
    /// meet crosswise there.
    fn turn(&self, cell: usize, axis: usize) -> Option<(usize, DVec3)> {
        let labels = self.face(cell, axis);
        let corner = crosswise(labels)?;
        let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
        let [at_u, at_v] = [usize::from(corner == 1 || corner == 2), usize::from(corner >= 2)];
        let side = |at: usize| if at > 0 { TURN } else { -TURN };
        let direction = DVec3::AXES[u] * side(at_u) + DVec3::AXES[v] * side(at_v);
        Some((cell + at_u * self.steps[u] + at_v * self.steps[v], direction))
    }

    /// Places the vertices of a label's border. Returns them by cell and kind.
    fn place_vertices(&self, label: i64, world: &World, patch: &mut Patch) -> Vec<u32> {
        let before = self.block.first.map(|v| v - 1);
        let last = self.block.end.map(|v| v - 1);
        let mut ids = vec![NONE; 4 * self.labels.len()];
        for place in places(before, self.block.end) {
            let cell = self.at(place);
            let corners = self.corners(cell);
            if corners.iter().all(|corner| *corner == label) || !corners.contains(&label) {
                continue;
            }
            let class = Class::of(place, before, last, None);
            let vertex = self.vertex(place);
            let is_disc = is_disc(corners);
            let mut push = |kind: usize, place: DVec3, rank: u32| {
                ids[4 * cell + kind] = patch.vertices.len() as u32;
                patch.vertices.push(PatchVertex {
                    place: world.place(place),
                    class,
                    rank,
                    is_fixed: kind > 0 || !is_disc,
                });
            };
            push(0, vertex, patch.ranks.next(class));
            for axis in 0..3 {
                let Some((corner, direction)) = self.turn(cell, axis) else { continue };
                // The corner's neighbours have one label.
                let joined = self.face(cell, axis).into_iter().find(|other| *other != self.labels[corner]);
                if self.labels[corner] != label && joined != Some(label) {
                    continue;
                }
                let rank = patch.ranks.next(class);
                // In the layer before, the cell beyond may not be there, nor is the vertex needed.
                if place[axis] >= self.block.first[axis] {
                    let mut beyond = place;
                    beyond[axis] -= 1;
                    push(1 + axis, 0.5 * (vertex + self.vertex(beyond)) + direction, rank);
                }
            }
        }
        ids
    }
}

/// The corner whose faces turn aside, of four labels in a circle; `None` unless they meet crosswise.
fn crosswise([a, b, c, d]: [i64; 4]) -> Option<usize> {
    let is_first = a == c && a != b && a != d;
    let is_second = b == d && b != a && b != c;
    match (is_first, is_second) {
        (false, false) => None,
        // The lesser label is joined, so the background and everything outside are.
        (true, true) => Some(usize::from(a < b)),
        (is_first, _) => Some(usize::from(is_first)),
    }
}

/// Whether the border within a cell is a single disc between two labels: both are connected along the cell's edges.
fn is_disc(corners: [i64; 8]) -> bool {
    let mask = (0..8).filter(|i| corners[*i] == corners[0]).fold(0u8, |mask, i| mask | 1 << i);
    let Some(other) = corners.iter().find(|label| **label != corners[0]) else { return false };
    let are_two = corners.iter().all(|label| *label == corners[0] || label == other);
    are_two && is_connected(mask) && is_connected(!mask)
}

/// Whether some corners of a cell, as a mask, are connected by its edges.
fn is_connected(corners: u8) -> bool {
    // The corners at the lower ends of each axis.
    let lower = [(1, 0x55u8), (2, 0x33), (4, 0x0f)];
    let mut reached = corners & corners.wrapping_neg();
    loop {
        let grown =
            lower.iter().fold(reached, |all, (shift, lower)| all | (all & lower) << shift | all >> shift & lower)
                & corners;
        if grown == reached {
            return reached == corners;
        }
        reached = grown;
    }
}

fn centre(cell: [i64; 3]) -> DVec3 {
    DVec3::from_array(cell.map(|v| v as f64 + 0.5))
}

/// All places of a box, x fastest.
fn places(first: [i64; 3], end: [i64; 3]) -> impl Iterator<Item = [i64; 3]> {
    (first[2]..end[2])
        .flat_map(move |z| (first[1]..end[1]).flat_map(move |y| (first[0]..end[0]).map(move |x| [x, y, z])))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_that_meet_crosswise_turn_aside_at_one_corner() {
        let cases = [
            ([5, 0, 5, 0], Some(0)),
            ([0, 5, 0, 5], Some(1)),
            ([5, 0, 5, 7], Some(1)),
            ([0, 5, 7, 5], Some(0)),
            ([5, 5, 0, 0], None),
            ([5, 0, 7, 3], None),
            ([5, 5, 0, 5], None),
        ];
        for (labels, expected) in cases {
            assert_eq!(crosswise(labels), expected, "{labels:?}");
        }
        // The corner beside is of the joined label.
        assert_eq!(crosswise([OUTSIDE, 5, OUTSIDE, 5]), Some(1));
    }
}
