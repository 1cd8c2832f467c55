//! The kinds with a formula: marschner-lobb, spheres, sparse, ramp.

use super::{SPARSE_LAST_UNITS, centre, uniform};
use brickyard_volume::{Extent, VoxelBox};
use glam::DVec3;
use std::f64::consts::PI;

/// Frequency and amplitude of Marschner and Lobb's signal (IEEE Visualization 1994).
const ML_FREQUENCY: f64 = 6.0;
const ML_ALPHA: f64 = 0.25;

/// Returns the Marschner-Lobb signal at a position in the unit cube, in units of 0 to 255.
pub(super) fn marschner_lobb_at(p: DVec3) -> f64 {
    let [x, y, z] = (2.0 * p - 1.0).to_array();
    ml_ripple(x, y) + ml_depth(z)
}

fn ml_ripple(x: f64, y: f64) -> f64 {
    let r = (x * x + y * y).sqrt();
    let rho = (2.0 * PI * ML_FREQUENCY * (PI * r / 2.0).cos()).cos();
    255.0 * ML_ALPHA * (1.0 + rho) / (2.0 * (1.0 + ML_ALPHA))
}

fn ml_depth(z: f64) -> f64 {
    255.0 * (1.0 - (PI * z / 2.0).sin()) / (2.0 * (1.0 + ML_ALPHA))
}

/// Rows of the Marschner-Lobb signal: the same ripple in every plane, plus a value depending on z alone.
pub(super) fn marschner_lobb_rows(extent: Extent, region: VoxelBox) -> impl FnMut(u32, u32, &mut [f32]) {
    // Ripple of the rows so far, kept from plane to plane.
    let mut ripple: Vec<f32> = Vec::new();
    move |y, z, units| {
        let start = (y - region.min.y) as usize * units.len();
        if ripple.len() == start {
            let v = 2.0 * centre(y, extent.y) - 1.0;
            let u = |i: usize| 2.0 * centre(region.min.x + i as u32, extent.x) - 1.0;
            ripple.extend((0..units.len()).map(|i| ml_ripple(u(i), v) as f32));
        }
        let depth = ml_depth(2.0 * centre(z, extent.z) - 1.0) as f32;
        for (o, r) in units.iter_mut().zip(&ripple[start..]) {
            *o = r + depth;
        }
    }
}

/// Returns the ramp along the main diagonal at a position in the unit cube, in units of 0 to 255.
pub(super) fn ramp_at(p: DVec3) -> f64 {
    255.0 * (p.x + p.y + p.z) / 3.0
}

pub(super) fn ramp_rows(extent: Extent, region: VoxelBox) -> impl FnMut(u32, u32, &mut [f32]) {
    move |y, z, units| {
        let (py, pz) = (centre(y, extent.y), centre(z, extent.z));
        for (i, u) in (region.min.x..).zip(units) {
            *u = ramp_at(DVec3::new(centre(i, extent.x), py, pz)) as f32;
        }
    }
}

/// A solid sphere with a soft rim, in the caller's space.
#[derive(Clone, Copy)]
struct Ball {
    centre: DVec3,
    radius: f64,
    /// Half the width of the rim.
    rim: f64,
    units: f64,
}

impl Ball {
    fn at(&self, p: DVec3) -> f64 {
        let depth = self.radius - p.distance(self.centre);
        self.units * (0.5 + 0.5 * depth / self.rim).clamp(0.0, 1.0)
    }

    /// Distance from the centre beyond which the ball is zero.
    fn reach(&self) -> f64 {
        self.radius + self.rim
    }

    /// Whether the closed box from `lo` to `hi` is out of reach.
    fn misses(&self, lo: DVec3, hi: DVec3) -> bool {
        self.centre.distance(self.centre.clamp(lo, hi)) > self.reach()
    }
}

/// Paints the balls that intersect a box, row by row. Where several overlap, the greatest value counts.
struct BallRows {
    balls: Vec<Ball>,
    /// Ball space from voxel space.
    scale: DVec3,
    min_x: u32,
}

impl BallRows {
    fn new(balls: &[Ball], scale: DVec3, region: VoxelBox) -> Self {
        let (lo, hi) = (corner(region.min.to_array()) * scale, corner(region.max.to_array()) * scale);
        let balls = balls.iter().filter(|b| !b.misses(lo, hi)).copied().collect();
        Self { balls, scale, min_x: region.min.x }
    }

    fn row(&self, y: u32, z: u32, units: &mut [f32]) {
        units.fill(0.0);
        for ball in &self.balls {
            let mut p = DVec3::new(0.0, y as f64 + 0.5, z as f64 + 0.5) * self.scale;
            let (dy, dz) = (p.y - ball.centre.y, p.z - ball.centre.z);
            let half = ball.reach().powi(2) - dy * dy - dz * dz;
            if half <= 0.0 {
                continue;
            }
            let voxel = |x: f64| (x / self.scale.x - self.min_x as f64).max(0.0) as usize;
            let first = voxel(ball.centre.x - half.sqrt()).saturating_sub(1).min(units.len());
            let end = voxel(ball.centre.x + half.sqrt()).saturating_add(2).min(units.len());
            for (i, u) in units.iter_mut().enumerate().take(end).skip(first) {
                p.x = ((self.min_x as usize + i) as f64 + 0.5) * self.scale.x;
                *u = u.max(ball.at(p) as f32);
            }
        }
    }
}

fn corner(a: [u32; 3]) -> DVec3 {
    DVec3::from_array(a.map(f64::from))
}

/// The kind `spheres`: a dozen balls in the unit cube.
pub(super) struct Spheres(Vec<Ball>);

impl Spheres {
    pub(super) fn new(seed: u64) -> Self {
        let ball = |i: u64| {
            let random = |j: u64| uniform(seed, i * 8 + j);
            let radius = 0.04 + 0.11 * random(3);
            let place = |j: u64| radius + 0.02 + (1.0 - 2.0 * radius - 0.04) * random(j);
            let centre = DVec3::new(place(0), place(1), place(2));
            Ball { centre, radius, rim: 0.006, units: 60.0 + 190.0 * i as f64 / 11.0 }
        };
        Self((0..12).map(ball).collect())
    }

    pub(super) fn at(&self, p: DVec3) -> f64 {
        self.0.iter().map(|b| b.at(p)).fold(0.0, f64::max)
    }

    fn in_box(&self, extent: Extent, region: VoxelBox) -> BallRows {
        BallRows::new(&self.0, corner(extent.to_array()).recip(), region)
    }

    pub(super) fn rows(&self, extent: Extent, region: VoxelBox) -> impl FnMut(u32, u32, &mut [f32]) {
        let balls = self.in_box(extent, region);
        move |y, z, units| balls.row(y, z, units)
    }

    pub(super) fn is_zero_in(&self, extent: Extent, region: VoxelBox) -> bool {
        self.in_box(extent, region).balls.is_empty()
    }
}

/// The kind `sparse`: a few balls with radii of 6 to 32 voxels at any extent, smaller only where an axis is short.
pub(super) struct Sparse {
    balls: Vec<Ball>,
    extent: Extent,
}

impl Sparse {
    pub(super) fn new(seed: u64, extent: Extent) -> Self {
        let n = corner(extent.to_array());
        let most = n.min_element() * 0.25;
        let ball = |i: u64| {
            let random = |j: u64| uniform(seed, i * 8 + j);
            let radius = (6.0 + 26.0 * random(3)).min(most);
            let centre = DVec3::new(random(0), random(1), random(2)) * n;
            Ball { centre, radius, rim: 0.75, units: 80.0 + 15.0 * i as f64 }
        };
        Self { balls: (0..8).map(ball).collect(), extent }
    }

    fn last(&self) -> [u32; 3] {
        self.extent.to_array().map(|n| n - 1)
    }

    pub(super) fn at(&self, position: DVec3) -> f64 {
        if position.floor() == corner(self.last()) {
            return SPARSE_LAST_UNITS;
        }
        self.balls.iter().map(|b| b.at(position)).fold(0.0, f64::max)
    }

    pub(super) fn is_zero_in(&self, region: VoxelBox) -> bool {
        region.max.to_array() != self.extent.to_array()
            && BallRows::new(&self.balls, DVec3::ONE, region).balls.is_empty()
    }

    pub(super) fn rows(&self, region: VoxelBox) -> impl FnMut(u32, u32, &mut [f32]) {
        let (balls, last) = (BallRows::new(&self.balls, DVec3::ONE, region), self.last());
        move |y, z, units| {
            balls.row(y, z, units);
            if [region.max.x - 1, y, z] == last
                && let Some(u) = units.last_mut()
            {
                *u = SPARSE_LAST_UNITS as f32;
            }
        }
    }
}
