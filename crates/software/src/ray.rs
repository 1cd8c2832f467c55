//! Rays in voxel space, and the assignment of their segments to cells.
//!
//! A segment belongs to the cell whose half-open box holds its midpoint. This is decided along the ray: the distance to
//! a plane is computed the same way for all cells, and grows with the plane. So on each axis the cells' stretches
//! follow one another without gap or overlap, and each segment belongs to exactly one cell, however numbers are
//! rounded.

use crate::frame::{Cell, Frame};
use crate::macrocells::Reach;
use crate::ticks::Ticks;
use brickyard_volume::{CutFace, Lattice};
use glam::{DVec3, Vec4};

/// The share of light below which a ray ends: everything behind could add at most 1/4096 of a channel, a sixteenth of a
/// step of an 8-bit picture.
pub(crate) const FAINTEST: f32 = 1.0 / 4096.0;

/// The rank of a place without a value.
pub(crate) const NO_RANK: i32 = -1;

/// A ray on its way through the cells.
#[derive(Clone, Copy)]
pub(crate) struct Ray {
    pub(crate) origin: [f64; 3],
    /// Voxels per world unit, in voxel space.
    pub(crate) direction: [f64; 3],
    /// World units per voxel.
    inverse: [f64; 3],
    /// The distance of the eye; with a shifted lattice the ray begins behind it.
    pub(crate) eye: f64,
    t_in: f64,
    t_out: f64,
    /// The tick of the ray's first segment; `end` is one past the last.
    pub(crate) first: u32,
    pub(crate) end: u32,
    /// One past the last segment taken so far; equal to `end` once the ray is finished.
    pub(crate) cursor: u32,
    /// The sum of the ray's samples, with a meaning for each mode: see [`Accumulate`](crate::modes::Accumulate).
    pub(crate) sum: Vec4,
    pub(crate) past: Past,
}

/// A ray's state in relation to a layer's surfaces.
#[derive(Clone, Copy)]
pub(crate) struct Past {
    /// The tick of the segment behind the last one searched for a surface.
    pub(crate) reached: u32,
    /// The number of surfaces the ray is past; [`NO_RANK`] if unknown.
    pub(crate) rank: i32,
}

impl Past {
    pub(crate) const NONE: Self = Self { reached: 0, rank: NO_RANK };
}

impl Ray {
    /// A ray that never meets the volume.
    pub(crate) const EMPTY: Self = Self {
        origin: [0.0; 3],
        direction: [0.0; 3],
        inverse: [0.0; 3],
        eye: 0.0,
        t_in: 0.0,
        t_out: 0.0,
        first: 0,
        end: 0,
        cursor: 0,
        sum: Vec4::ZERO,
        past: Past::NONE,
    };

    /// Casts the ray through a pixel's centre, between these distances. It has no segments if it misses the volume
    /// there.
    pub(crate) fn new(frame: &Frame<'_>, x: u32, y: u32, sum: Vec4, limits: [f64; 2]) -> Self {
        let mut ray = Self { sum, ..Self::aim(frame, x, y) };
        ray.set_out(&frame.ticks, frame.shift(x, y, ray.t_in), limits);
        ray
    }

    /// The ray through a pixel's centre, before it [sets out](Self::set_out).
    pub(crate) fn aim(frame: &Frame<'_>, x: u32, y: u32) -> Self {
        let settings = frame.settings;
        let own = settings.placement.volume_ray(&settings.rays.ray(x as f64 + 0.5, y as f64 + 0.5));
        let origin = settings.geometry.voxel_from_world(own.origin).to_array();
        let direction = (own.direction / settings.geometry.spacing).to_array();
        let mut ray = Self { origin, direction, ..Self::EMPTY };
        let (mut t_in, mut t_out) = (0.0f64, f64::INFINITY);
        for a in 0..3 {
            ray.inverse[a] = inverse_or_huge(direction[a]);
            let (low, high) = (frame.shown_low[a], frame.shown_high[a]);
            let (enter, leave) = if direction[a] < 0.0 { (high, low) } else { (low, high) };
            t_in = t_in.max((enter - origin[a]) * ray.inverse[a]);
            t_out = t_out.min((leave - origin[a]) * ray.inverse[a]);
            if direction[a] == 0.0 && !(low <= origin[a] && origin[a] < high) {
                t_out = 0.0;
            }
        }
        (ray.t_in, ray.t_out) = match &settings.clip {
            Some(clip) => clip.shorten(&own, (t_in, t_out)),
            None => (t_in, t_out),
        };
        ray
    }

    /// The ray's origin and unit direction in the scene's world.
    #[inline(always)]
    pub(crate) fn in_world(&self, frame: &Frame<'_>) -> (DVec3, DVec3) {
        let (geometry, placement) = (&frame.settings.geometry, &frame.settings.placement);
        let eye = placement.world_from_volume(geometry.world_from_voxel(DVec3::from_array(self.origin)));
        (eye, placement.world_vector(DVec3::from_array(self.direction) * geometry.spacing))
    }

    /// The cut through which the ray enters the shown part, and the voxels it descends below the cut per unit of
    /// distance, of so many per level-0 voxel; `None` without a cut.
    #[inline(always)]
    pub(crate) fn cut(&self, frame: &Frame<'_>, voxels: [f64; 3]) -> Option<(CutFace, f64)> {
        frame.settings.clip.as_ref()?;
        let [origin, direction] = [self.origin, self.direction].map(DVec3::from_array);
        let cut = frame.settings.cut_face(frame.extent, origin, direction, self.eye)?;
        Some((cut, cut.voxels_per_distance(direction, DVec3::from_array(voxels).recip())))
    }

    /// The distance of the ray's entry into the shown part of the volume, if any.
    pub(crate) fn entry(&self) -> Option<f64> {
        (self.t_in < self.t_out).then_some(self.t_in)
    }

    /// The ray's shown stretch, from and to; empty if it never is.
    pub(crate) fn stretch(&self) -> [f64; 2] {
        [self.t_in, self.t_out]
    }

    /// Finds the ray's segments between these distances, along a lattice shifted towards the eye by `shift`. Lattice
    /// and ray then start that far behind the eye.
    #[inline(always)]
    pub(crate) fn set_out(&mut self, ticks: &Ticks, shift: f64, limits: [f64; 2]) {
        let (t_in, t_out) = (self.t_in.max(limits[0]), self.t_out.min(limits[1]));
        if t_in < t_out {
            (self.t_in, self.t_out) = (t_in + shift, t_out + shift);
            self.eye = shift;
            (0..3).for_each(|a| self.origin[a] -= self.direction[a] * shift);
            self.first = ticks.about(self.t_in);
            self.end = ticks.about(self.t_out);
            while self.end < Lattice::NEVER && self.end as f64 * ticks.step < self.t_out {
                self.end = ticks.next(self.end);
            }
            self.cursor = self.first;
        }
    }

    /// The start and end of the segment at a tick. The first and last are cut where the ray enters and leaves the
    /// volume.
    #[inline(always)]
    pub(crate) fn ends(&self, ticks: &Ticks, tick: u32) -> (f64, f64) {
        let (start, end) = (tick as i32 as f64 * ticks.step, ticks.next(tick) as i32 as f64 * ticks.step);
        let start = if start > self.t_in { start } else { self.t_in };
        let end = if end < self.t_out { end } else { self.t_out };
        (start, end)
    }

    /// The distance of the midpoint, and the length, of the segment at a tick.
    #[inline(always)]
    pub(crate) fn segment(&self, ticks: &Ticks, tick: u32) -> (f64, f64) {
        let (start, end) = self.ends(ticks, tick);
        (0.5 * (start + end), end - start)
    }

    /// The cell's run of segments from the cursor on, if any: its first tick, and one past the last. With
    /// [`Reach::Beyond`] a cell also takes other cells' segments that extend more than half a voxel into it.
    #[inline(always)]
    pub(crate) fn run(&self, ticks: &Ticks, cell: &Cell<'_>, reach: Reach) -> Option<(u32, u32)> {
        // Midpoints in [near, far) are inside.
        let (mut near, mut far) = (self.t_in, self.t_out);
        for a in 0..3 {
            let down = self.direction[a] < 0.0;
            let (enter, leave) = if down { (cell.high[a], cell.low[a]) } else { (cell.low[a], cell.high[a]) };
            let n = self.crossing(a, enter, down);
            let f = self.crossing(a, leave, down);
            near = if n > near { n } else { near };
            far = if f < far { f } else { far };
        }
        if near >= far {
            return None;
        }
        if reach == Reach::Beyond {
            let overhang = self.overhang(ticks, cell, far);
            (near, far) = (near - overhang, far + overhang);
        }
        // Cells follow one another: mostly the next segment is the first.
        let mut first = self.cursor;
        if self.segment(ticks, first).0 < near {
            let about = ticks.about(near);
            first = if about > first { about } else { first };
            first = if self.segment(ticks, first).0 < near { ticks.next(first) } else { first };
        }
        let about = ticks.about(far);
        let mut last = if about > first { about } else { first };
        last = if self.segment(ticks, last).0 < far { ticks.next(last) } else { last };
        last = if last < self.end { last } else { self.end };
        (first < last).then_some((first, last))
    }

    /// How far a neighbour's segment may reach into the cell, less half a voxel, about distance `t`. 0 if voxels are no
    /// shorter than segments: a brick's ranges of codes hold for half a voxel around it.
    #[inline(always)]
    fn overhang(&self, ticks: &Ticks, cell: &Cell<'_>, t: f64) -> f64 {
        let mut voxels = 0.0f64;
        for a in 0..3 {
            let along = (self.direction[a] * cell.scale[a]).abs();
            voxels = if along > voxels { along } else { voxels };
        }
        let half = |zone: usize| 0.5 * ticks.step * (1u32 << zone) as f64;
        if half(ticks.zones - 1) * voxels <= 0.5 {
            return 0.0;
        }
        (half(ticks.zone(ticks.about(t))) - 0.5 / voxels).max(0.0)
    }

    /// The least distance at which the ray has passed the plane. Boxes hold their lower planes but not their upper
    /// ones, so downwards it is the next number after the crossing (NaN for infinite planes, never picked by a
    /// comparison; irrelevant for crossings behind the eye).
    #[inline(always)]
    fn crossing(&self, axis: usize, plane: f64, down: bool) -> f64 {
        let t = (plane - self.origin[axis]) * self.inverse[axis];
        f64::from_bits(t.to_bits() + down as u64)
    }
}

/// `1 / d`, or where useless a number so large that a plane is crossed either at once or never; finite, so that no
/// product with a distance of zero is NaN.
fn inverse_or_huge(d: f64) -> f64 {
    const HUGE: f64 = 1e300;
    if d.abs() > 1.0 / HUGE {
        1.0 / d
    } else if d < 0.0 {
        -HUGE
    } else {
        HUGE
    }
}
