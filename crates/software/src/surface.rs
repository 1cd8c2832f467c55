//! One opaque isosurface: a ray's first crossing of the isovalue, and the colour there. The rule is
//! [`brickyard_volume::surface`]'s.
//!
//! The ends of segments are sampled in packets of eight; their inside bits, shifted by one, reveal changes of side.
//! Only there the crossing is located, with a packet for each round, and lit, with a packet for the gradient. Blocks of
//! macro-cells on one side are skipped: the ray is on the same side before and behind them. (Not if voxels may have no
//! value: then the ray determines its side anew.)

use crate::frame::{Cell, Frame, INSIDE, OUTSIDE};
use crate::macrocells::{Coverage, Mask, Reach};
use crate::modes::Accumulate;
use crate::packet::{LANES, Packet, points};
use crate::ray::Ray;
use crate::sample::{Code, SampleChunk};
use crate::stretch::{March, Stretch};
use crate::unit::Unit;
use brickyard_volume::lighting::headlight;
use brickyard_volume::surface::{FLAT_SHARE, PARTS, ROUNDS};
use glam::{Vec3, Vec4};
use std::ops::Range;

/// A path's crossing of a surface.
#[derive(Clone, Copy)]
pub(crate) struct Crossing {
    pub(crate) surface: usize,
    pub(crate) along: f32,
    /// Whether it is a cap on the cut through which the ray enters.
    pub(crate) is_cap: bool,
}

/// Packets of ends sampled together: more wait less for one another, but more of them lie behind the surface.
const TOGETHER: usize = 2;

const _: () = assert!(PARTS == LANES, "a round is a packet");

/// A ray's first isosurface, opaque. Before it, the ray's sum is the ray's side, two unused numbers, and 1 for all of
/// the light; behind it, the surface's colour and 0.
pub(crate) struct Isosurface;

impl Accumulate for Isosurface {
    const REACH: Reach = Reach::Beyond;

    #[inline(always)]
    fn coverage(cell: &Cell<'_>, ray: &Ray) -> Coverage {
        match cell.mask {
            // On the other side than the previous brick: the surface is their common face.
            Mask::None if ray.sum.x * cell.side < 0.0 => Coverage::All,
            _ => cell.mask.coverage(),
        }
    }

    #[inline(always)]
    fn take<C: Code, U: Unit>(march: &March<'_>, ray: &mut Ray, chunk: &mut SampleChunk, segments: Range<i32>) {
        let stretch = march.stretch;
        let ticks = &march.frame.ticks;
        let [low, high] = stretch.sampleable(march.frame.edge + 2 * march.frame.apron);
        let inside = |along: f32| {
            if along < low {
                low
            } else if along > high {
                high
            } else {
                along
            }
        };
        let first = stretch.tick(segments.start);
        if C::INVALID && march.frame.settings.encoding.has_invalid && ray.past.reached != first {
            ray.sum.x = 0.0;
        }
        if ray.sum.x == 0.0 {
            let start = inside(stretch.along(ray.ends(ticks, first).0));
            let line = Line { march, threshold: march.frame.thresholds[0] };
            ray.sum.x = line.side::<C, U>(start);
            if ray.sum.x == INSIDE && march.is_capped(ray, first) {
                ray.sum = line.cap(ray).extend(0.0);
                return;
            }
        }
        let mut done = segments.start;
        while done < segments.end {
            let left = segments.end - done;
            chunk.packets = (left.min((TOGETHER * LANES) as i32) as usize).div_ceil(LANES);
            for p in 0..chunk.packets.min(TOGETHER) {
                for i in 0..LANES {
                    let lane = (p * LANES + i) as i32;
                    chunk.along[p][i] = inside((done + lane) as f32 + 0.5);
                    chunk.weight[p][i] = if lane < left { 1.0 } else { 0.0 };
                }
            }
            let last = (left - 1) as usize;
            if stretch.end == ray.end && segments.end == stretch.count && last < TOGETHER * LANES {
                let (_, end) = ray.ends(ticks, stretch.tick(stretch.count - 1));
                chunk.along[last / LANES][last % LANES] = inside(stretch.along(end));
            }
            march.brick.read::<C, U>(march.frame.reading, stretch.origin, stretch.step, chunk);
            for p in 0..chunk.packets.min(TOGETHER) {
                let lanes = left - (p * LANES) as i32;
                let Some(i) =
                    crossing(march.frame.thresholds[0], &mut ray.sum.x, &chunk.code[p], &chunk.weight[p], lanes)
                else {
                    continue;
                };
                let segment = done + (p * LANES + i) as i32;
                let from = inside(stretch.along(ray.ends(ticks, stretch.tick(segment)).0));
                let end = [chunk.along[p][i], chunk.code[p][i]];
                let line = Line { march, threshold: march.frame.thresholds[0] };
                let hit = line.locate::<C, U>(from, end);
                ray.sum = line.lit::<C, U>(ray, hit).extend(0.0);
                return;
            }
            done += (TOGETHER * LANES) as i32;
        }
        ray.past.reached = stretch.tick(segments.end);
    }

    #[inline(always)]
    fn is_final(_: &Frame<'_>, sum: Vec4) -> bool {
        sum.w == 0.0
    }

    fn seen(_: &Frame<'_>, sum: Vec4) -> Vec4 {
        // Before the surface the sum is no colour.
        if sum.w == 0.0 { sum } else { Vec4::W }
    }
}

/// The first of a packet of `count` ends (or more than fit) on another side than the one before it; `side` is the one
/// before the first, and becomes that of the last. Ends without weight are on no side.
#[inline(always)]
fn crossing(threshold: f32, side: &mut f32, code: &Packet, weight: &Packet, count: i32) -> Option<usize> {
    let (mut inside, mut known) = (0u32, 0u32);
    for i in 0..LANES {
        inside |= ((code[i] >= threshold) as u32) << i;
        known |= ((weight[i] > 0.0) as u32) << i;
    }
    let before = inside << 1 | (*side > 0.0) as u32;
    let known_before = known << 1 | (*side != 0.0) as u32;
    let crossed = (inside ^ before) & known & known_before;
    let last = if count < LANES as i32 { count - 1 } else { LANES as i32 - 1 };
    let of_last = if inside >> last & 1 == 1 { INSIDE } else { OUTSIDE };
    *side = if known >> last & 1 == 1 { of_last } else { 0.0 };
    (crossed != 0).then(|| crossed.trailing_zeros() as usize)
}

/// A ray's way through a brick, searched for a surface. Places along it are counted in segments from the middle of the
/// stretch's first.
pub(crate) struct Line<'a> {
    pub(crate) march: &'a March<'a>,
    /// The surface's threshold, in codes.
    pub(crate) threshold: f32,
}

impl Line<'_> {
    /// The side of a place; 0 if it has no value.
    #[inline(always)]
    fn side<C: Code, U: Unit>(&self, along: f32) -> f32 {
        let (code, weight) = self.sample::<C, U>(&[along; LANES]);
        match weight[0] > 0.0 {
            true if code[0] >= self.threshold => INSIDE,
            true => OUTSIDE,
            false => 0.0,
        }
    }

    /// Locates the surface between the places `from` and `to`; `to` is behind it and given with its code.
    #[inline(always)]
    pub(crate) fn locate<C: Code, U: Unit>(&self, mut from: f32, [mut to, mut to_code]: [f32; 2]) -> f32 {
        let threshold = self.threshold;
        let is_inside = to_code >= threshold;
        // The place behind is the surface, if the one in front turns out to have no value.
        let mut from_code = to_code;
        for _ in 0..ROUNDS {
            let part = (to - from) * (1.0 / PARTS as f32);
            let mut along = [0.0; LANES];
            for i in 0..LANES {
                along[i] = from + i as f32 * part;
            }
            let (code, weight) = self.sample::<C, U>(&along);
            let mut past = 1 << LANES;
            for i in 0..LANES {
                past |= ((((code[i] >= threshold) == is_inside) & (weight[i] > 0.0)) as u32) << i;
            }
            let first = past.trailing_zeros() as usize;
            if first == 0 {
                // The previous brick saw it on the other side here.
                return from;
            }
            if first < LANES {
                (to, to_code) = (along[first], code[first]);
            }
            from = along[first - 1];
            from_code = if weight[first - 1] > 0.0 { code[first - 1] } else { to_code };
        }
        let share = (threshold - from_code) / (to_code - from_code);
        if to_code == from_code { to } else { from + (to - from) * share.clamp(0.0, 1.0) }
    }

    /// The colour of a cap on the cut through which the ray enters.
    #[inline(never)]
    fn cap(&self, ray: &Ray) -> Vec3 {
        let (_, direction) = ray.in_world(self.march.frame);
        let cosine = self.march.cut(ray).map(|(cut, _)| cut.normal.dot(direction));
        let (own, white) = headlight(cosine);
        Vec3::from(self.march.frame.settings.surfaces[0].color) * own as f32 + Vec3::splat(white as f32)
    }

    #[inline(always)]
    fn lit<C: Code, U: Unit>(&self, ray: &Ray, along: f32) -> Vec3 {
        let March { frame, cell, brick, stretch: &Stretch { origin, step, .. } } = *self.march;
        let (mut points, mut weight) = ([[0.0; LANES]; 3], [1.0; LANES]);
        // A voxel to each side along each axis, or as far as the brick goes.
        let far = (frame.edge + 2 * frame.apron - 1) as f32;
        for a in 0..3 {
            let at = (origin[a] + along * step[a]).clamp(0.0, far);
            points[a] = [at; LANES];
            (points[a][2 * a], points[a][2 * a + 1]) = ((at + 1.0).min(far), (at - 1.0).max(0.0));
        }
        let mut code = brick.read_points::<C, U>(frame.reading.of_gradients(), &points, &mut weight);
        let spacing = frame.settings.geometry.spacing.to_array();
        let (mut differences, mut gradient, mut direction) = (Vec3::ZERO, Vec3::ZERO, Vec3::ZERO);
        for i in 0..LANES {
            code[i] = if weight[i] > 0.0 { code[i] } else { self.threshold };
        }
        for a in 0..3 {
            let distance = points[a][2 * a] - points[a][2 * a + 1];
            differences[a] = (code[2 * a] - code[2 * a + 1]) * (2.0 / distance);
            gradient[a] = differences[a] * (cell.scale[a] / spacing[a]) as f32;
            direction[a] = (ray.direction[a] * spacing[a]) as f32;
        }
        let is_flat = differences.length() < (FLAT_SHARE as f32 * self.threshold.abs()).max(frame.flat_codes);
        let (own, white) = headlight((!is_flat).then(|| (gradient.dot(direction) / gradient.length()) as f64));
        Vec3::from(frame.settings.surfaces[0].color) * own as f32 + Vec3::splat(white as f32)
    }

    /// The codes at these places, and weights of 0 where values are missing.
    #[inline(always)]
    fn sample<C: Code, U: Unit>(&self, along: &Packet) -> (Packet, Packet) {
        let Stretch { origin, step, .. } = *self.march.stretch;
        let (points, mut weight) = (points(origin, step, along), [1.0; LANES]);
        let code = self.march.brick.read_points::<C, U>(self.march.frame.reading, &points, &mut weight);
        (code, weight)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_change_of_sides_is_found() {
        let find = |codes: [i32; LANES], mut side: f32, count| {
            let weight = codes.map(|code| (code >= 0) as u8 as f32);
            let found = crossing(5.0, &mut side, &codes.map(|code| code as f32), &weight, count);
            (found, side)
        };
        let none = -1;
        assert_eq!(find([1, 2, 3, 4, 4, 4, 4, 4], OUTSIDE, 8), (None, OUTSIDE));
        assert_eq!(find([1, 2, 3, 4, 5, 6, 1, 9], OUTSIDE, 9), (Some(4), INSIDE));
        assert_eq!(find([5, 6, 6, 6, 6, 4, 4, 4], INSIDE, 8), (Some(5), OUTSIDE));
        assert_eq!(find([5, 6, 6, 6, 6, 6, 6, 6], OUTSIDE, 8), (Some(0), INSIDE));
        assert_eq!(find([5, 6, 6, 6, 6, 6, 6, 6], 0.0, 8), (None, INSIDE));
        // Lanes behind the last one weigh nothing; nor do places without a value, on whose far side nothing is known.
        assert_eq!(find([1, 1, none, none, none, none, none, none], OUTSIDE, 2), (None, OUTSIDE));
        assert_eq!(find([1, none, 7, 7, 4, none, none, none], OUTSIDE, 5), (Some(4), OUTSIDE));
        assert_eq!(find([1, none, 7, 7, 7, 7, 7, none], OUTSIDE, 8), (None, 0.0));
    }
}
