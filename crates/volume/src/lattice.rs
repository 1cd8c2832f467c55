//! The sampling lattice: the samples of every ray, the same for all renderers and any cut of space into bricks.
//!
//! A ray's stretch `[t_in, t_out)` inside the volume's box is cut at the multiples of a step anchored at the eye (`t = 0`). Each piece, a *segment*,
//! is sampled once, at its midpoint, and weighted by its true length; it belongs to the brick whose half-open box holds the midpoint. The step
//! doubles with distance: in *zone* `z` it is `2^z` finest steps. A zone starts where a pixel has grown to the voxel size of level `z` (times the
//! requested pixel error), rounded up to a multiple of its step, so the lattices nest. Zones depend on the distance alone, not on resident bricks or
//! the cut, so segments partition every ray exactly: a constant medium has the same opacity under any cut, and all renderers agree bit for bit but
//! for rounding. [Jitter](crate::jitter) moves a ray's whole lattice.

use crate::camera::ViewRays;
use crate::jitter::STEPS;

/// The most zones of a lattice: one for each of the levels 0 to 15.
pub const MAX_ZONES: usize = 16;

/// A sampling lattice: the finest step and the start of each zone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lattice {
    /// World length of the finest step.
    pub step: f64,
    /// First tick (in finest steps from the eye) of each zone, ascending; zone `z`'s is a multiple of `2^z`.
    pub zone_starts: [u32; MAX_ZONES],
    /// Shift of every ray's ticks towards the eye, in units of `1 / STEPS` of its first segment ([`STEPS`]). Pictures of a view with `n` phases at
    /// even parts of a segment are together as good as one with steps `n` times shorter.
    pub phase: u8,
}

/// One sample's stretch of a ray, in world distance from the eye.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Segment {
    /// World distance of the segment's start from the eye.
    pub start: f64,
    /// World distance of the segment's end from the eye; more than `start`.
    pub end: f64,
}

impl Segment {
    /// World distance of the sample from the eye: the segment's middle.
    pub fn middle(&self) -> f64 {
        0.5 * (self.start + self.end)
    }

    /// World length of the segment, the weight of its sample.
    pub fn length(&self) -> f64 {
        self.end - self.start
    }
}

impl Lattice {
    /// The first tick of an unreachable zone.
    pub const NEVER: u32 = 1 << 30;

    /// Returns a lattice with one zone everywhere, as for a locked level. `step` is the world length of the finest step.
    pub fn uniform(step: f64, zone: usize) -> Self {
        Self { step, zone_starts: std::array::from_fn(|z| if z <= zone { 0 } else { Self::NEVER }), phase: 0 }
    }

    /// Returns a lattice with zones by the size of a pixel: at most `levels` of them, where level 0 has voxels of `voxel_size` world units and a
    /// voxel may cover `pixel_error` pixels. `step` is the world length of the finest step.
    pub fn for_view(step: f64, voxel_size: f64, rays: &ViewRays, pixel_error: f64, levels: usize) -> Self {
        let zone_starts = std::array::from_fn(|z| {
            let level_voxel = voxel_size * (1u64 << z) as f64;
            if z == 0 {
                0
            } else if z >= levels {
                Self::NEVER
            } else if rays.orthographic {
                if rays.pixel_size(0.0) * pixel_error >= level_voxel { 0 } else { Self::NEVER }
            } else {
                let t = level_voxel / (rays.pixel_size(1.0) * pixel_error);
                let multiple = (1u64 << z) as f64;
                ((t / step / multiple).ceil() * multiple).min(Self::NEVER as f64) as u32
            }
        });
        Self { step, zone_starts, phase: 0 }
    }

    /// Returns this lattice with steps `times` as long (1 or more). Zones start at the same place, or up to one of their own steps later.
    pub fn with_longer_steps(&self, times: f64) -> Self {
        let zone_starts = std::array::from_fn(|z| {
            let start = self.zone_starts[z];
            let multiple = 1u32 << z;
            if start >= Self::NEVER { start } else { ((start as f64 / times).ceil() as u32).next_multiple_of(multiple) }
        });
        Self { step: self.step * times, zone_starts, phase: self.phase }
    }

    /// The zone of a tick; ticks count finest steps from the eye.
    pub fn zone(&self, tick: u32) -> usize {
        (1..MAX_ZONES).take_while(|&z| self.zone_starts[z] <= tick).last().unwrap_or(0)
    }

    /// World shift of a ray's ticks towards the eye by a [share](crate::Jitter::share) of a segment and the lattice's phase; the ray enters the
    /// volume at distance `t_in`.
    pub fn shift(&self, share: f64, t_in: f64) -> f64 {
        let share = (share + f64::from(self.phase) / f64::from(STEPS)).fract();
        if share == 0.0 {
            return 0.0;
        }
        share * self.step * (1u32 << self.zone(self.tick_at(t_in))) as f64
    }

    /// Greatest half length of a segment beginning before the world distance `t` from the eye.
    pub fn reach(&self, t: f64) -> f64 {
        0.5 * self.step * (1u32 << self.zone(self.tick_at(t))) as f64
    }

    fn tick_at(&self, t: f64) -> u32 {
        (t / self.step).min(Self::NEVER as f64) as u32
    }

    /// Iterates over the segments of a ray inside the volume's box for `[t_in, t_out)`, near to far.
    pub fn segments(&self, t_in: f64, t_out: f64) -> impl Iterator<Item = Segment> {
        let t_in = t_in.max(0.0);
        let first = self.tick_at(t_in);
        let mut tick = first >> self.zone(first) << self.zone(first);
        std::iter::from_fn(move || {
            loop {
                let next = tick + (1 << self.zone(tick));
                let start = (tick as f64 * self.step).max(t_in);
                let end = (next as f64 * self.step).min(t_out);
                if start >= t_out || tick >= Self::NEVER {
                    return None;
                }
                tick = next;
                if end > start {
                    return Some(Segment { start, end });
                }
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::{Camera, Projection};
    use glam::DVec3;
    use proptest::prelude::*;

    #[test]
    fn longer_steps_keep_the_zones() {
        let lattice = Lattice::for_view(0.5, 1.0, &view(40.0), 1.0, 6);
        assert_eq!(lattice.with_longer_steps(1.0), lattice);
        for times in [1.3, 2.0, 3.7] {
            let longer = lattice.with_longer_steps(times);
            assert_eq!(longer.step, lattice.step * times);
            for z in 0..MAX_ZONES {
                let (old, new) = (lattice.zone_starts[z], longer.zone_starts[z]);
                assert_eq!((old >= Lattice::NEVER, new % (1 << z)), (new >= Lattice::NEVER, 0), "{z}");
                let late = new as f64 * longer.step - old as f64 * lattice.step;
                assert!(
                    old >= Lattice::NEVER || (-1e-9..=longer.step * (2u32 << z) as f64).contains(&late),
                    "{z}: {late}"
                );
            }
        }
    }

    fn view(fov_y_deg: f64) -> ViewRays {
        let projection = Projection::Perspective { fov_y_deg };
        Camera { eye: DVec3::ZERO, target: DVec3::X, up: DVec3::Z, projection }.rays(512, 512).unwrap()
    }

    #[test]
    fn zones_start_where_pixels_reach_the_level() {
        let rays = view(30.0);
        let lattice = Lattice::for_view(0.5, 1.0, &rays, 1.0, 4);
        for z in 1..4 {
            let t = lattice.zone_starts[z] as f64 * 0.5;
            assert_eq!(lattice.zone_starts[z] % (1 << z), 0);
            assert!(rays.pixel_size(t) >= (1 << z) as f64);
            assert!(rays.pixel_size(t - 0.5 * (1 << z) as f64) < (1 << z) as f64);
        }
        assert_eq!(lattice.zone_starts[4], Lattice::NEVER);
    }

    #[test]
    fn an_orthographic_lattice_has_one_zone() {
        let projection = Projection::Orthographic { height: 512.0 * 5.0 };
        let rays = Camera { eye: DVec3::ZERO, target: DVec3::X, up: DVec3::Z, projection }.rays(512, 512).unwrap();
        let lattice = Lattice::for_view(1.0, 1.0, &rays, 1.0, 6);
        assert_eq!([lattice.zone(0), lattice.zone(1 << 20)], [2, 2]);
    }

    proptest! {
        #[test]
        fn segments_partition_the_ray(
            step in 0.05f64..3.0, fov in 5.0f64..90.0, error in 0.5f64..4.0, t_in in 0.0f64..3000.0, depth in 0.0f64..800.0,
        ) {
            let lattice = Lattice::for_view(step, 1.0, &view(fov), error, 8);
            let t_out = t_in + depth;
            let mut at = t_in;
            for s in lattice.segments(t_in, t_out) {
                prop_assert!((s.start - at).abs() < 1e-9, "gap or overlap at {at}: {s:?}");
                prop_assert!(s.length() <= step * (1u32 << lattice.zone((s.middle() / step) as u32)) as f64 * (1.0 + 1e-9));
                at = s.end;
            }
            prop_assert!((at - t_out).abs() < 1e-9 || depth == 0.0);
        }
    }

    #[test]
    fn a_shift_is_the_share_of_the_first_segment() {
        let lattice =
            Lattice { zone_starts: std::array::from_fn(|z| [0, 8, 16, Lattice::NEVER][z.min(3)]), step: 0.5, phase: 0 };
        for (t_in, stride) in [(0.0, 1.0), (3.9, 1.0), (4.0, 2.0), (7.9, 2.0), (100.0, 4.0)] {
            assert_eq!(lattice.shift(0.25, t_in), 0.25 * 0.5 * stride, "{t_in}");
            assert_eq!(lattice.shift(0.0, t_in), 0.0);
        }
    }
}
