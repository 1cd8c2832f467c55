//! The kind `ct`: a tube wall, a ball of shells with a dense core, a turbulent matrix with dense veins, air, and detector
//! noise over everything.

use super::turbulence::{Turbulence, TurbulenceRows};
use super::{centre, mix, round_bits, smoothstep};
use brickyard_volume::{Extent, VoxelBox};
use std::ops::Range;
use std::sync::LazyLock;

/// Entries of the radial table, over radii `0..1`; beyond is air.
const TABLE: usize = 2048;
/// Half the width of a shell's soft edge.
const EDGE: f64 = 0.008;
const AIR: f64 = 12.0;
const MATRIX: f64 = 58.0;
const WALL: f64 = 82.0;
/// Inner and outer radius of the tube's wall.
const WALL_RADII: (f64, f64) = (0.86, 0.93);
/// Distance of the tube's ends from the middle along z.
const WALL_END: f64 = 0.96;
/// Shift of the shells, outwards or inwards, per unit of turbulence, and the turbulence of the greatest shift.
const WARP: f32 = 0.05;
const MOST_WARP: f32 = 3.0;
/// Radius of the outermost shell under the greatest shift: beyond is air.
const REACH: f64 = 0.70 + EDGE + 0.15;
/// Standard deviation of the detector's noise, in units.
const NOISE: f64 = 3.0;

/// Material at a radius, before and under turbulence.
#[derive(Clone, Copy)]
struct Material {
    base: f32,
    /// Units per unit of turbulence.
    amplitude: f32,
    /// Units added where turbulence is high.
    vein: f32,
}

static MATERIALS: LazyLock<Vec<Material>> = LazyLock::new(|| {
    let material = |i: usize| {
        let r = i as f64 / TABLE as f64;
        let below = |edge: f64| 1.0 - smoothstep(edge - EDGE, edge + EDGE, r);
        let band = |lo: f64, hi: f64| below(hi) * (1.0 - below(lo));
        let inside = below(0.70);
        let base = AIR
            + (MATRIX - AIR) * inside
            + (205.0 - MATRIX) * below(0.20)
            + (150.0 - MATRIX) * band(0.38, 0.44)
            + (118.0 - MATRIX) * band(0.60, 0.66);
        let vein = 150.0 * inside * (1.0 - smoothstep(0.56, 0.60, r));
        Material { base: base as f32, amplitude: (26.0 * inside) as f32, vein: vein as f32 }
    };
    (0..TABLE).map(material).collect()
});

pub(super) struct Ct<'a> {
    noise: TurbulenceRows<'a>,
    seed: u64,
    extent: Extent,
    first_x: u32,
    materials: &'static [Material],
    /// Position of the box's voxels along x in -1..1, squared.
    x_squares: Vec<f32>,
    /// Table index of every voxel of the row.
    radii: Vec<u32>,
    /// Random numbers, one a voxel, from the start of the first voxel's block.
    randoms: Vec<[u32; BLOCK]>,
}

impl<'a> Ct<'a> {
    pub(super) fn new(noise: &'a Turbulence, seed: u64, extent: Extent, region: VoxelBox) -> Self {
        let (lo, hi) = (region.min.x, region.max.x);
        Self {
            noise: noise.rows(extent, region, [0.0; 3]),
            seed: mix(!seed),
            extent,
            first_x: lo,
            materials: &MATERIALS,
            x_squares: (lo..hi).map(|i| (signed(i, extent.x) * signed(i, extent.x)) as f32).collect(),
            radii: vec![0; (hi - lo) as usize],
            randoms: vec![[0; BLOCK]; (hi as usize).div_ceil(BLOCK) - lo as usize / BLOCK],
        }
    }

    /// Voxels of the row that may be other than air.
    fn ball(&self, yz_square: f64) -> Range<usize> {
        voxels_within((REACH * REACH - yz_square).max(0.0).sqrt(), self.first_x, self.extent.x, self.radii.len())
    }

    /// Turns turbulence into material.
    fn fill_ball(&mut self, yz_square: f32, ball: Range<usize>, units: &mut [f32]) {
        let last = (TABLE - 1) as f32;
        let (radii, units) = (&mut self.radii[ball.clone()], &mut units[ball.clone()]);
        for ((i, x), t) in radii.iter_mut().zip(&self.x_squares[ball]).zip(units.iter()) {
            let r = (x + yz_square).sqrt() + WARP * t.clamp(-MOST_WARP, MOST_WARP);
            *i = round_bits((r * TABLE as f32).clamp(0.0, last)) & (TABLE as u32 - 1);
        }
        let materials: &[Material] = &self.materials[..TABLE];
        for (i, u) in radii.iter().zip(units) {
            let m = &materials[*i as usize % TABLE];
            let t = *u;
            *u = m.base + m.amplitude * t + m.vein * ((t - 0.55) * 4.0).clamp(0.0, 1.0);
        }
    }

    fn add_wall(&self, y: u32, z: u32, units: &mut [f32]) {
        let (y, z) = (signed(y, self.extent.y), signed(z, self.extent.z));
        if z.abs() >= WALL_END || y.abs() >= WALL_RADII.1 {
            return;
        }
        let within = |radius: f64| {
            let half = (radius * radius - y * y).max(0.0).sqrt();
            voxels_within(half, self.first_x, self.extent.x, units.len())
        };
        let (all, hole) = (within(WALL_RADII.1), within(WALL_RADII.0));
        // The estimates are a voxel too wide, so the hole is shrunk; the formula below is zero outside the wall.
        let hole = (hole.start + 3).min(hole.end)..hole.end.saturating_sub(3);
        let sides = if hole.is_empty() { [all, 0..0] } else { [all.start..hole.start, hole.end..all.end] };
        for i in sides.into_iter().flatten() {
            let x = signed(self.first_x + i as u32, self.extent.x);
            let r = (x * x + y * y).sqrt();
            let wall = smoothstep(0.86, 0.87, r) * (1.0 - smoothstep(0.92, 0.93, r));
            units[i] += (wall * (WALL - AIR)) as f32;
        }
    }

    /// Adds triangular noise: the sum of two 16-bit numbers of one 32-bit random.
    fn add_noise(&mut self, y: u32, z: u32, units: &mut [f32]) {
        let key = mix(self.seed ^ (z as u64) << 32 ^ y as u64);
        let first = self.first_x as usize / BLOCK;
        for (i, block) in self.randoms.iter_mut().enumerate() {
            fill_random(key ^ (first + i) as u64, block);
        }
        // The sum of two uniform 16-bit numbers has a standard deviation of 26755.
        let scale = (NOISE / 26755.0) as f32;
        let randoms = &self.randoms.as_flattened()[self.first_x as usize % BLOCK..];
        for (u, random) in units.iter_mut().zip(randoms) {
            let sum = ((random & 0xffff) + (random >> 16)) as i32 - 65535;
            *u += sum as f32 * scale;
        }
    }

    pub(super) fn row(&mut self, y: u32, z: u32, units: &mut [f32]) {
        let (v, w) = (signed(y, self.extent.y), signed(z, self.extent.z));
        let yz_square = v * v + w * w;
        let ball = self.ball(yz_square);
        units.fill(AIR as f32);
        if !ball.is_empty() {
            self.noise.row(y, z, ball.clone(), units);
            self.fill_ball(yz_square as f32, ball, units);
        }
        self.add_wall(y, z, units);
        self.add_noise(y, z, units);
    }
}

/// Voxels, among the box's `count` from `first`, with centres in `-half..half` (and up to two more).
fn voxels_within(half: f64, first: u32, n: u32, count: usize) -> Range<usize> {
    let voxel = |x: f64| (x + 1.0) * 0.5 * n as f64 - first as f64;
    if half <= 0.0 {
        return 0..0;
    }
    let (start, end) = ((voxel(-half) - 1.0).max(0.0) as usize, (voxel(half) + 1.0).max(0.0) as usize);
    start.min(count)..end.min(count)
}

/// Voxels along x whose noise is made at once.
const BLOCK: usize = 128;

/// Fills a block from a key: eight xorshift generators side by side, which vectorise, unlike a hash per voxel.
fn fill_random(key: u64, block: &mut [u32; BLOCK]) {
    const LANES: usize = 8;
    let mut states: [u64; LANES] = std::array::from_fn(|lane| mix(mix(key) ^ lane as u64) | 1);
    for chunk in block.as_chunks_mut::<{ 2 * LANES }>().0 {
        for (state, pair) in states.iter_mut().zip(chunk.as_chunks_mut::<2>().0) {
            *state ^= *state << 13;
            *state ^= *state >> 7;
            *state ^= *state << 17;
            *pair = [*state as u32, (*state >> 32) as u32];
        }
    }
}

/// Centre of voxel `i` of `n` in -1..1.
fn signed(i: u32, n: u32) -> f64 {
    2.0 * centre(i, n) - 1.0
}
