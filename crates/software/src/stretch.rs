//! A part of a ray's way through one cell, inside one zone: its samples are equally spaced.

use crate::frame::{Cell, Frame};
use crate::macrocells::{Blocks, Reach, block_length};
use crate::packet::{CHUNK, LANES, PACKETS};
use crate::ray::{NO_RANK, Ray};
use crate::sample::{Brick, Code, SampleChunk};
use crate::unit::Unit;
use brickyard_volume::CutFace;
use brickyard_volume::macrocells::CELL_EDGE;
use glam::{DVec3, Mat3};
use std::ops::Range;

/// A stretch of a ray through a frame's cell, and the cell's brick.
pub(crate) struct March<'a> {
    pub(crate) frame: &'a Frame<'a>,
    pub(crate) cell: &'a Cell<'a>,
    pub(crate) brick: Brick<'a>,
    pub(crate) stretch: &'a Stretch,
}

impl March<'_> {
    /// Whether the ray enters at the segment at tick `first`, through a cut that caps surfaces.
    #[inline(always)]
    pub(crate) fn is_capped(&self, ray: &Ray, first: u32) -> bool {
        let settings = self.frame.settings;
        if !settings.caps || first != ray.first {
            return false;
        }
        let (start, _) = ray.ends(&self.frame.ticks, first);
        let [origin, direction] = [ray.origin, ray.direction].map(DVec3::from_array);
        settings.cap(self.frame.extent, origin, direction, ray.eye, start).is_some()
    }

    /// Samples these segments in their middles, or as many of them as a chunk holds.
    #[inline(always)]
    pub(crate) fn sample<C: Code, U: Unit>(&self, ray: &Ray, chunk: &mut SampleChunk, segments: Range<i32>) {
        let Stretch { origin, step, .. } = *self.stretch;
        self.stretch.place_samples(self.frame, ray, chunk, segments, C::INVALID);
        self.brick.read::<C, U>(self.frame.reading, origin, step, chunk);
    }

    /// The map from differences of codes across two voxels to the scene's gradient, of any length; and the least
    /// difference that is not flat.
    #[inline(always)]
    pub(crate) fn slopes(&self) -> (Mat3, f32) {
        (self.cell.world_from_differences, self.frame.flat_codes)
    }

    /// The cut through which a ray enters the shown part, and the voxels of the cell's level it descends below the cut
    /// per unit of distance; `None` without a cut.
    #[inline(always)]
    pub(crate) fn cut(&self, ray: &Ray) -> Option<(CutFace, f64)> {
        ray.cut(self.frame, self.cell.scale)
    }
}

/// A part of a ray's run through a cell, inside one zone: its samples are equally spaced and, except for the ray's
/// first and last, equally long.
#[derive(Clone, Copy)]
pub(crate) struct Stretch {
    pub(crate) ray: usize,
    /// The tick of the first segment; `end` is one past the last.
    pub(crate) start: u32,
    pub(crate) end: u32,
    pub(crate) zone: usize,
    pub(crate) count: i32,
    /// The number of samples in a block.
    pub(crate) block: i32,
    /// Whether each block may be visible, a bit for each.
    pub(crate) seen: u64,
    /// The world length of a whole segment.
    pub(crate) length: f64,
    /// The distance along the ray of the first segment's middle, as if uncut.
    pub(crate) middle: f64,
    /// The slot coordinates of the first sample. Counted from there, f32 is accurate to a ten-thousandth of a voxel.
    pub(crate) origin: [f32; 3],
    /// The step in slot coordinates from one sample to the next.
    pub(crate) step: [f32; 3],
}

impl Stretch {
    pub(crate) const EMPTY: Self = Self {
        ray: 0,
        start: 0,
        end: 0,
        zone: 0,
        count: 0,
        block: 0,
        seen: 0,
        length: 0.0,
        middle: 0.0,
        origin: [0.0; 3],
        step: [0.0; 3],
    };

    /// The stretch of the segments from the tick `start` on, up to `last`, or the end of the zone, or as many blocks as
    /// there are bits in `seen`. All blocks count as seen. `place` is the ray's place in the tile.
    #[inline(always)]
    pub(crate) fn new(
        frame: &Frame<'_>,
        cell: &Cell<'_>,
        ray: &Ray,
        place: usize,
        start: u32,
        last: u32,
        reach: Reach,
    ) -> Self {
        let ticks = &frame.ticks;
        let zone = ticks.zone(start);
        let zone_end = ticks.zone_end(zone);
        let length = ticks.step * (1i32 << zone) as f64;
        let middle = start as i32 as f64 * ticks.step + 0.5 * length;
        let (mut origin, mut step) = ([0.0f32; 3], [0.0f32; 3]);
        for a in 0..3 {
            let voxel = ray.origin[a] + ray.direction[a] * middle;
            origin[a] = (cell.offset[a] + cell.scale[a] * voxel) as f32;
            step[a] = (cell.scale[a] * ray.direction[a] * length) as f32;
        }
        let block = block_length(step, reach);
        let end = if last < zone_end { last } else { zone_end };
        let count = ((end - start) >> zone) as i32;
        let most = block.saturating_mul(u64::BITS as i32);
        let (end, count) = if count <= most { (end, count) } else { (start + ((most as u32) << zone), most) };
        Self { ray: place, start, end, zone, count, block, seen: u64::MAX, length, middle, origin, step }
    }

    #[inline(always)]
    pub(crate) fn blocks(&self, frame: &Frame<'_>, reach: Reach) -> Blocks {
        Blocks::new(self.origin, self.step, self.block, reach, frame.edge, frame.apron)
    }

    /// Records that a ray searches these segments for surfaces. If `has_invalid`, a ray that skipped segments before
    /// them loses its rank, as voxels there may have had no value.
    #[inline(always)]
    pub(crate) fn reach(&self, ray: &mut Ray, segments: &Range<i32>, has_invalid: bool) {
        if has_invalid && ray.past.reached != self.tick(segments.start) {
            ray.past.rank = NO_RANK;
        }
        ray.past.reached = self.tick(segments.end);
    }

    /// The tick of a segment.
    #[inline(always)]
    pub(crate) fn tick(&self, segment: i32) -> u32 {
        self.start + ((segment as u32) << self.zone)
    }

    /// The place of a distance along the stretch, in segments from the middle of the first.
    #[inline(always)]
    pub(crate) fn along(&self, t: f64) -> f32 {
        ((t - self.middle) / self.length) as f32
    }

    /// The segments of the first neighbouring blocks in `seen`, which are removed from it; `None` if `seen` is empty.
    #[inline(always)]
    pub(crate) fn next_seen(&self, seen: &mut u64) -> Option<Range<i32>> {
        if *seen == 0 {
            return None;
        }
        let from = seen.trailing_zeros();
        // Blocks are examined in eights: those past the last one do not exist.
        if from as i32 * self.block >= self.count {
            return None;
        }
        let to = from + (*seen >> from).trailing_ones();
        *seen = seen.checked_shr(to).unwrap_or(0).checked_shl(to).unwrap_or(0);
        let last = (to as i32).saturating_mul(self.block);
        Some(from as i32 * self.block..if last < self.count { last } else { self.count })
    }

    /// The blocks, a bit for each, not fully covered by the macro-cells' ranges when whole segments count: those that
    /// may reach out of the brick by more than half a voxel, and all blocks if a segment may pass through a whole
    /// macro-cell.
    #[inline(always)]
    pub(crate) fn uncovered(&self) -> u64 {
        let longest = longest(self.step);
        if longest <= 1.0 {
            return 0;
        }
        if longest > CELL_EDGE as f32 {
            return u64::MAX;
        }
        1 | 1 << ((self.count - 1) / self.block)
    }

    /// The places along the stretch between which the brick can be sampled, in segments from the middle of the first.
    /// Infinite if segments are no longer than a voxel, as they never reach out of the brick.
    #[inline(always)]
    pub(crate) fn sampleable(&self, padded: u32) -> [f32; 2] {
        let (mut low, mut high) = (f32::NEG_INFINITY, f32::INFINITY);
        if longest(self.step) > 1.0 {
            for a in 0..3 {
                if self.step[a] != 0.0 {
                    let enter = -self.origin[a] / self.step[a];
                    let leave = ((padded - 1) as f32 - self.origin[a]) / self.step[a];
                    (low, high) = (low.max(enter.min(leave)), high.min(enter.max(leave)));
                }
            }
        }
        [low, high]
    }

    #[inline(always)]
    pub(crate) fn weight(&self, frame: &Frame<'_>) -> f32 {
        (self.length * frame.per_unit) as f32
    }

    /// Places the samples of these segments in a chunk, or of as many of them as it holds. They never count as whole
    /// steps if voxels may have no value.
    #[inline(always)]
    pub(crate) fn place_samples(
        &self,
        frame: &Frame<'_>,
        ray: &Ray,
        chunk: &mut SampleChunk,
        Range { start: done, end: to }: Range<i32>,
        has_invalid: bool,
    ) {
        let full = self.weight(frame);
        let left = to - done;
        chunk.packets = (left.min(CHUNK as i32) as usize).div_ceil(LANES);
        for p in 0..chunk.packets.min(PACKETS) {
            for i in 0..LANES {
                let lane = (p * LANES + i) as i32;
                chunk.along[p][i] = (done + lane) as f32;
                chunk.weight[p][i] = if lane < left { full } else { 0.0 };
            }
        }
        let cut_first = self.start == ray.first && done == 0;
        let cut_last = self.end == ray.end && to == self.count && left <= CHUNK as i32;
        let all_whole = !has_invalid && !cut_first && !cut_last;
        chunk.whole_steps = if all_whole { left.min(CHUNK as i32) as usize } else { 0 };
        chunk.zone = self.zone;
        for (is_cut, lane) in [(cut_first, 0), (cut_last, left - 1)] {
            if is_cut {
                let (middle, length) = ray.segment(&frame.ticks, self.tick(done + lane));
                let (p, i) = (lane as usize / LANES, lane as usize % LANES);
                chunk.along[p][i] = self.along(middle);
                chunk.weight[p][i] = (length.max(0.0) * frame.per_unit) as f32;
            }
        }
    }
}

#[inline(always)]
fn longest(step: [f32; 3]) -> f32 {
    step[0].abs().max(step[1].abs()).max(step[2].abs())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_past_the_last_one_are_none() {
        // Three blocks; the last has four segments.
        let stretch = Stretch { count: 20, block: 8, ..Stretch::EMPTY };
        assert_eq!(stretch.next_seen(&mut 0b1010_1000), None);
        let mut seen = 0b1110_0110;
        assert_eq!(stretch.next_seen(&mut seen), Some(8..20));
        assert_eq!(stretch.next_seen(&mut seen), None);
    }
}
