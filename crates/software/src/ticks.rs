//! The sampling lattice prepared for per-ray work: its zones, and the segment at a tick or a distance.

use brickyard_volume::Lattice;
use brickyard_volume::lattice::MAX_ZONES;

/// A sampling lattice, prepared for work per ray.
pub(crate) struct Ticks {
    /// The world length of a tick: the lattice's finest step.
    pub(crate) step: f64,
    per_world: f64,
    /// One past the last zone is [`Lattice::NEVER`].
    starts: [u32; MAX_ZONES + 1],
    /// The number of zones within reach of rays.
    pub(crate) zones: usize,
}

impl Ticks {
    pub(crate) fn new(lattice: &Lattice) -> Self {
        let mut starts = [Lattice::NEVER; MAX_ZONES + 1];
        starts[..MAX_ZONES].copy_from_slice(&lattice.zone_starts);
        let zones = (1..MAX_ZONES).take_while(|&z| starts[z] < Lattice::NEVER).count() + 1;
        Self { step: lattice.step, per_world: 1.0 / lattice.step, starts, zones }
    }

    #[inline(always)]
    pub(crate) fn zone(&self, tick: u32) -> usize {
        if self.zones == 1 { 0 } else { self.search_zone(tick) }
    }

    /// Not inlined: the compiler would compare all zones ahead of every calling loop.
    #[inline(never)]
    fn search_zone(&self, tick: u32) -> usize {
        let mut zone = 0;
        while zone + 1 < self.zones && self.starts[zone + 1] <= tick {
            zone += 1;
        }
        zone
    }

    #[inline(always)]
    pub(crate) fn zone_end(&self, zone: usize) -> u32 {
        self.starts[zone + 1]
    }

    #[inline(always)]
    pub(crate) fn next(&self, tick: u32) -> u32 {
        tick + (1 << self.zone(tick))
    }

    #[inline(always)]
    fn aligned(&self, tick: u32) -> u32 {
        let zone = self.zone(tick);
        tick >> zone << zone
    }

    /// The first tick of the segment that holds the distance `t`, or, by rounding, of one next to it.
    #[inline(always)]
    pub(crate) fn about(&self, t: f64) -> u32 {
        let tick = t * self.per_world;
        let tick = if tick < Lattice::NEVER as f64 { tick } else { Lattice::NEVER as f64 };
        let tick = if tick > 0.0 { tick } else { 0.0 };
        // SAFETY: 0 <= tick <= 2^30, even if t is NaN.
        let tick = unsafe { tick.to_int_unchecked::<i32>() as u32 };
        self.aligned(tick)
    }
}
