//! Turbulence: octaves of lattice noise under quadratic B-splines, smooth in every direction and cheap along rows.
//!
//! For a box the lattice is blended along z once a plane and along y once a row; along x each lattice cell is then a
//! parabola, evaluated over the cell's voxels in a plain loop.

use super::{centre, mix};
use brickyard_volume::{Extent, VoxelBox};
use std::ops::Range;

/// Lattice nodes along an axis; coarse octaves never reach its end, fine ones repeat.
const LATTICE: usize = 64;
/// Cells of the coarsest octave along an axis.
const COARSEST_CELLS: f64 = 3.0;
/// Least voxels in a cell: finer octaves would alias.
const LEAST_CELL_VOXELS: f64 = 6.0;
/// Amplitude of the coarsest octave: with [`PERSISTENCE`] the sum has a standard deviation near 0.9.
const AMPLITUDE: f64 = 3.2;
/// Amplitude of an octave over that of the next coarser one: 2^-0.8.
const PERSISTENCE: f64 = 0.574_349_177_498_517_4;

/// The noise field of a seed.
pub(super) struct Turbulence {
    /// Random nodes in -1..1, x fastest.
    lattice: Vec<f32>,
    octaves: Vec<Octave>,
}

struct Octave {
    cells: f64,
    amplitude: f32,
    /// The octave's start in the lattice.
    shift: [i64; 3],
}

impl Turbulence {
    pub(super) fn new(seed: u64, extent: Extent) -> Self {
        let key = mix(seed);
        let lattice =
            (0..LATTICE.pow(3) as u64).map(|i| (mix(key ^ i) >> 40) as f32 / (1 << 23) as f32 - 1.0).collect();
        let longest = extent.to_array().into_iter().max().unwrap_or(1) as f64;
        let mut octaves = Vec::new();
        let (mut cells, mut amplitude) = (COARSEST_CELLS, AMPLITUDE);
        while octaves.is_empty() || cells * LEAST_CELL_VOXELS <= longest {
            let shift = mix(key ^ u64::MAX ^ octaves.len() as u64);
            octaves.push(Octave {
                cells,
                amplitude: amplitude as f32,
                shift: [shift, shift >> 16, shift >> 32].map(|s| (s % LATTICE as u64) as i64),
            });
            cells *= 2.0;
            amplitude *= PERSISTENCE;
        }
        Self { lattice, octaves }
    }

    /// Prepares the rows of a box. `drift` moves the field, in lengths of the unit cube; each octave moves 0.35 times
    /// `drift` farther than the next coarser one.
    pub(super) fn rows(&self, extent: Extent, region: VoxelBox, drift: [f64; 3]) -> TurbulenceRows<'_> {
        let octaves = self.octaves.iter().enumerate().map(|(i, octave)| {
            let hastened = drift.map(|d| d * (1.0 + 0.35 * i as f64));
            OctaveRows::new(octave, extent, region, hastened)
        });
        TurbulenceRows { lattice: &self.lattice, octaves: octaves.collect(), z: None }
    }
}

/// Computes the noise field along the rows of one box.
pub(super) struct TurbulenceRows<'a> {
    lattice: &'a [f32],
    octaves: Vec<OctaveRows>,
    /// The plane of the blended octaves.
    z: Option<u32>,
}

impl TurbulenceRows<'_> {
    /// Fills `out[voxels]` with the field along the row `y`, `z` of the volume.
    pub(super) fn row(&mut self, y: u32, z: u32, voxels: Range<usize>, out: &mut [f32]) {
        if self.z != Some(z) {
            self.octaves.iter_mut().for_each(|o| o.blend_plane(self.lattice, z));
            self.z = Some(z);
        }
        out[voxels.clone()].fill(0.0);
        self.octaves.iter_mut().for_each(|o| o.add_row(y, voxels.clone(), out));
    }
}

/// Cells of one octave along one axis, as far as the box reaches: position `u` has cell `floor(u)`.
struct AxisCells {
    scale: f64,
    shift: f64,
    n: u32,
    /// Cell of the first voxel, less one: the first node needed.
    first_node: i64,
    nodes: usize,
}

impl AxisCells {
    fn new(octave: &Octave, axis: usize, n: u32, lo: u32, hi: u32, drift: f64) -> Self {
        let mut cells = Self {
            scale: octave.cells,
            shift: octave.shift[axis] as f64 - drift * octave.cells,
            n,
            first_node: 0,
            nodes: 0,
        };
        cells.first_node = cells.at(lo).0 - 1;
        cells.nodes = (cells.at(hi - 1).0 + 2 - cells.first_node) as usize;
        cells
    }

    /// The cell of a voxel and the voxel's place in it.
    fn at(&self, i: u32) -> (i64, f32) {
        let u = centre(i, self.n) * self.scale + self.shift;
        let cell = u.floor();
        (cell as i64, (u - cell) as f32)
    }

    /// The first of the three nodes around a voxel, from `first_node`, and their weights.
    fn taps(&self, i: u32) -> (usize, [f32; 3]) {
        let (cell, t) = self.at(i);
        let s = 1.0 - t;
        ((cell - 1 - self.first_node) as usize, [0.5 * s * s, 0.5 + t * s, 0.5 * t * t])
    }

    fn lattice_index(&self, node: usize) -> usize {
        (self.first_node + node as i64).rem_euclid(LATTICE as i64) as usize
    }
}

struct OctaveRows {
    amplitude: f32,
    axes: [AxisCells; 3],
    /// Nodes of the box blended along z: y rows of x nodes.
    plane: Vec<f32>,
    /// One row of x nodes blended along y too.
    nodes: Vec<f32>,
    /// Place in its cell of every x voxel of the box.
    places: Vec<f32>,
    /// First voxel of each cell along x, relative to the box, and the end.
    starts: Vec<usize>,
}

impl OctaveRows {
    fn new(octave: &Octave, extent: Extent, region: VoxelBox, drift: [f64; 3]) -> Self {
        let (n, lo, hi) = (extent.to_array(), region.min.to_array(), region.max.to_array());
        let axes = std::array::from_fn(|a| AxisCells::new(octave, a, n[a], lo[a], hi[a], drift[a]));
        let x: &AxisCells = &axes[0];
        let mut starts = vec![0; x.nodes - 1];
        let mut places = Vec::with_capacity((hi[0] - lo[0]) as usize);
        for i in lo[0]..hi[0] {
            let (cell, place) = x.at(i);
            places.push(place);
            starts[(cell - x.first_node) as usize] = places.len();
        }
        // Until now each entry was the end of the cell before it; cells without a voxel are empty.
        for c in 1..starts.len() {
            starts[c] = starts[c].max(starts[c - 1]);
        }
        let (plane, nodes) = (vec![0.0; x.nodes * axes[1].nodes], vec![0.0; x.nodes]);
        Self { amplitude: octave.amplitude, axes, plane, nodes, places, starts }
    }

    fn blend_plane(&mut self, lattice: &[f32], z: u32) {
        let [x, y, zs] = &self.axes;
        let (first, weights) = zs.taps(z);
        let slices = std::array::from_fn::<_, 3, _>(|k| zs.lattice_index(first + k) * LATTICE * LATTICE);
        for row in 0..y.nodes {
            let line = y.lattice_index(row) * LATTICE;
            for node in 0..x.nodes {
                let i = line + x.lattice_index(node);
                let value = |k: usize| lattice[slices[k] + i] * weights[k];
                self.plane[row * x.nodes + node] = (value(0) + value(1) + value(2)) * self.amplitude;
            }
        }
    }

    fn add_row(&mut self, y: u32, range: Range<usize>, out: &mut [f32]) {
        let [x, ys, _] = &self.axes;
        let (first, [w0, w1, w2]) = ys.taps(y);
        let rows = &self.plane[first * x.nodes..][..3 * x.nodes];
        let (a, rest) = rows.split_at(x.nodes);
        let (b, c) = rest.split_at(x.nodes);
        for (node, ((a, b), c)) in self.nodes.iter_mut().zip(a.iter().zip(b).zip(c)) {
            *node = a * w0 + b * w1 + c * w2;
        }
        let cells = self.starts.partition_point(|&s| s <= range.start).saturating_sub(1)..self.starts.len() - 1;
        for (cell, taps) in cells.clone().zip(self.nodes[cells.start..].windows(3)) {
            let voxels = self.starts[cell].max(range.start)..self.starts[cell + 1].min(range.end);
            if voxels.is_empty() {
                break;
            }
            // The B-spline over this cell as a parabola in the place t: c0 + c1 t + c2 t^2.
            let c0 = 0.5 * (taps[0] + taps[1]);
            let c1 = taps[1] - taps[0];
            let c2 = 0.5 * (taps[0] + taps[2]) - taps[1];
            for (o, t) in out[voxels.clone()].iter_mut().zip(&self.places[voxels]) {
                *o += (c2 * t + c1) * t + c0;
            }
        }
    }
}

/// The kind `turbulence`: the field around the middle of the range.
pub(super) fn haze(noise: &Turbulence, extent: Extent, region: VoxelBox) -> impl FnMut(u32, u32, &mut [f32]) {
    let mut noise = noise.rows(extent, region, [0.0; 3]);
    move |y, z, units| {
        noise.row(y, z, 0..units.len(), units);
        for u in units {
            *u = 128.0 + 45.0 * *u;
        }
    }
}
