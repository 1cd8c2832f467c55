//! The modes, which turn a ray's samples into a pixel: one type each.
//!
//! A sample's weight is its segment's length in unit distances; missing samples have weight 0. As in `sample`,
//! everything is inlined, for the vector unit of its final function.

use crate::boxes::Segments;
use crate::frame::{Cell, Frame};
use crate::lit;
use crate::macrocells::{Coverage, Reach};
use crate::packet::{CHUNK, LANES, PACKETS, Packet, exp2, log2};
use crate::ray::{FAINTEST, Ray};
use crate::reading::Reading;
use crate::sample::{Code, SampleChunk};
use crate::steps::StepTable;
use crate::stretch::March;
use crate::transfer_table::Entries;
use crate::unit::Unit;
use brickyard_volume::Extreme;
use glam::{Vec4, Vec4Swizzles};
use std::ops::Range;

/// A mode: how a ray's samples become a pixel. By default, light passes through a medium: a ray's sum is premultiplied
/// colour and transmittance.
pub(crate) trait Accumulate {
    /// A ray's sum before its first sample.
    const START: Vec4 = Vec4::W;

    /// The projected extreme; `None` if the mode projects none.
    const EXTREME: Option<Extreme> = None;

    /// Whether cells are taken front to back, and each segment once. If not, the order does not matter, and the most
    /// promising bricks come first.
    const FRONT_TO_BACK: bool = Self::EXTREME.is_none();

    /// Whether segments are examined in their middles or from end to end.
    const REACH: Reach = Reach::Middles;

    /// Whether nearer samples take light from farther ones. If so, the sum's last component is the remaining light.
    const OCCLUDES: bool = true;

    /// How much of a cell's brick can change a ray's sum. By default the coverage of the cell's mask, for all rays.
    #[inline(always)]
    fn coverage(cell: &Cell<'_>, _: &Ray) -> Coverage {
        cell.mask.coverage()
    }

    /// Returns the boxes of macro-cells whose samples can change the sum: a bit for each.
    ///
    /// # Safety
    /// The brick has these boxes.
    #[inline(always)]
    unsafe fn sees(cell: &Cell<'_>, boxes: &[i32; LANES], _: Vec4) -> u64 {
        // SAFETY: the caller's promise.
        unsafe { cell.mask.seen(boxes) }
    }

    /// Adds some segments of a stretch to the ray's sum, or fewer if nothing behind those is visible. By default they
    /// are sampled in their middles, a chunk at a time.
    #[inline(always)]
    fn take<C: Code, U: Unit>(march: &March<'_>, ray: &mut Ray, chunk: &mut SampleChunk, segments: Range<i32>) {
        let March { frame, cell, brick, stretch } = march;
        let mut done = segments.start;
        while done < segments.end && !Self::is_final(frame, ray.sum) {
            stretch.place_samples(frame, ray, chunk, done..segments.end, C::INVALID);
            match Self::EXTREME.zip(cell.box_reach) {
                Some((extreme, reach)) => {
                    let (origin, step, whole) = (stretch.origin, stretch.step, stretch.weight(frame));
                    brick.read_boxes::<C, U>(extreme, &Segments { origin, step, whole, reach }, chunk);
                }
                None => brick.read::<C, U>(frame.reading, stretch.origin, stretch.step, chunk),
            }
            ray.sum = Self::add::<C, U>(march, ray, chunk);
            done += CHUNK as i32;
        }
    }

    /// Returns a ray's sum with the samples of a chunk, for the default [`Accumulate::take`].
    #[inline(always)]
    fn add<C: Code, U: Unit>(_: &March<'_>, ray: &Ray, _: &mut SampleChunk) -> Vec4 {
        ray.sum
    }

    /// Whether no further sample can change the result of this sum.
    #[inline(always)]
    fn is_final(_: &Frame<'_>, sum: Vec4) -> bool {
        sum.w < FAINTEST
    }

    /// The result of a ray with this sum: premultiplied colour and transmitted light.
    fn seen(_: &Frame<'_>, sum: Vec4) -> Vec4 {
        sum
    }
}

/// The mode of emission and absorption, lit or not: a ray's sum is premultiplied colour and transmittance.
pub(crate) struct Dvr;

impl Dvr {
    #[inline(always)]
    fn add_whole_steps(table: &StepTable<'_>, sum: Vec4, chunk: &mut SampleChunk) -> Vec4 {
        let packets = chunk.packets.min(PACKETS);
        let mut shows = [false; PACKETS];
        for p in 0..packets {
            let count = chunk.whole_steps as i32 - (p * LANES) as i32;
            shows[p] = table.find(&chunk.code[p], count, &mut chunk.places[p]);
        }
        // Two by two, so that a sample need not wait for the one before it.
        let (mut near, mut far) = (sum, Vec4::ZERO);
        let mut light = Vec4::splat(sum.w);
        for p in 0..packets {
            if !shows[p] {
                continue;
            }
            for i in (0..LANES).step_by(2) {
                // SAFETY: the places have been found.
                let [a, b] = unsafe { [table.step(&chunk.places[p], i), table.step(&chunk.places[p], i + 1)] };
                near += a * light;
                far += b * (light * a.wwww());
                light *= a.wwww() * b.wwww();
            }
            if light.x < FAINTEST {
                break;
            }
        }
        (near + far).with_w(light.x)
    }

    /// Computes into `entry` the colour gained and light passed by each of a chunk's samples. Returns the visible
    /// packets, a bit for each.
    #[inline(always)]
    fn classify<C: Code>(frame: &Frame<'_>, chunk: &mut SampleChunk) -> u32 {
        let (packets, mut shows) = (chunk.packets.min(PACKETS), 0);
        if C::BYTES == 1
            && chunk.whole_steps > 0
            && let Some(table) = frame.steps.zone(chunk.zone)
        {
            for p in 0..packets {
                let count = chunk.whole_steps as i32 - (p * LANES) as i32;
                if table.find(&chunk.code[p], count, &mut chunk.places[p]) {
                    shows |= 1 << p;
                    for i in 0..LANES {
                        // SAFETY: the places have been found.
                        chunk.entry[p][i] = unsafe { table.step(&chunk.places[p], i) };
                    }
                }
            }
            return shows;
        }
        shows = Self::look_up(frame, chunk);
        for p in 0..packets {
            if shows & 1 << p != 0 {
                for i in 0..LANES {
                    let passed = chunk.passed[p][i];
                    chunk.entry[p][i] = (chunk.entry[p][i] * (1.0 - passed)).with_w(passed);
                }
            }
        }
        shows
    }

    /// Looks up into `entry` the straight colour and opacity of each of a chunk's samples, and into `passed` its
    /// transmitted light. Returns the visible packets, a bit for each; the others are left unset.
    #[inline(always)]
    fn look_up(frame: &Frame<'_>, chunk: &mut SampleChunk) -> u32 {
        let (entries, packets, mut shows) = (Entries::of(frame), chunk.packets.min(PACKETS), 0u32);
        for p in 0..packets {
            let mut position = chunk.code[p];
            for i in 0..LANES {
                position[i] *= frame.positions_per_code;
            }
            if frame.shows(&position) {
                shows |= 1 << p;
                for i in 0..LANES {
                    let entry = entries.lookup(position[i]);
                    chunk.entry[p][i] = entry;
                    chunk.alpha[p][i] = entry.w;
                }
            }
        }
        for p in (0..packets).step_by(2) {
            if shows >> p & 3 != 0 {
                [chunk.passed[p], chunk.passed[p + 1]] =
                    transmitted([&chunk.alpha[p], &chunk.alpha[p + 1]], [&chunk.weight[p], &chunk.weight[p + 1]]);
            }
        }
        shows
    }
}

impl Accumulate for Dvr {
    #[inline(always)]
    fn add<C: Code, U: Unit>(march: &March<'_>, ray: &Ray, chunk: &mut SampleChunk) -> Vec4 {
        let (frame, sum) = (march.frame, ray.sum);
        if frame.is_lit {
            let shows = Self::classify::<C>(frame, chunk);
            return if shows != 0 { lit::see::<C, U>(march, ray, chunk, shows) } else { sum };
        }
        if C::BYTES == 1
            && chunk.whole_steps > 0
            && let Some(table) = frame.steps.zone(chunk.zone)
        {
            return Self::add_whole_steps(&table, sum, chunk);
        }
        let shows = Self::look_up(frame, chunk);
        let (mut color, mut transmittance) = (sum, sum.w);
        for p in 0..chunk.packets.min(PACKETS) {
            if shows & 1 << p != 0 {
                for i in 0..LANES {
                    color += chunk.entry[p][i] * (transmittance * (1.0 - chunk.passed[p][i]));
                    transmittance *= chunk.passed[p][i];
                }
            }
        }
        color.w = transmittance;
        color
    }
}

/// Maximum and minimum projection: a ray's sum is the most extreme code so far. It begins beyond every code, so that
/// any sample beats it.
pub(crate) struct ExtremeProjection<const GREATEST: bool>;

pub(crate) type Mip = ExtremeProjection<true>;
pub(crate) type MinIp = ExtremeProjection<false>;

impl<const GREATEST: bool> ExtremeProjection<GREATEST> {
    /// Whether one code is more extreme than another.
    #[inline(always)]
    fn beats(code: f32, other: f32) -> bool {
        if GREATEST { code > other } else { code < other }
    }

    #[inline(always)]
    fn more_extreme(a: Vec4, b: Vec4) -> Vec4 {
        if GREATEST { a.max(b) } else { a.min(b) }
    }
}

impl<const GREATEST: bool> Accumulate for ExtremeProjection<GREATEST> {
    const START: Vec4 = if GREATEST { Vec4::NEG_ONE } else { Vec4::MAX };
    const EXTREME: Option<Extreme> = Some(if GREATEST { Extreme::Greatest } else { Extreme::Least });
    const OCCLUDES: bool = false;

    #[inline(always)]
    fn coverage(cell: &Cell<'_>, ray: &Ray) -> Coverage {
        let [low, high] = cell.whole;
        let extreme = if GREATEST { high } else { low };
        if low > high || !Self::beats(extreme, ray.sum.x) { Coverage::None } else { Coverage::Some }
    }

    #[inline(always)]
    unsafe fn sees(cell: &Cell<'_>, boxes: &[i32; LANES], sum: Vec4) -> u64 {
        let mut bits = 0;
        for i in 0..LANES {
            // SAFETY: the caller's promise; there is an extreme for every box.
            let extreme = unsafe { *cell.extremes.get_unchecked(boxes[i] as usize) };
            bits |= (Self::beats(extreme, sum.x) as u64) << i;
        }
        bits
    }

    #[inline(always)]
    fn add<C: Code, U: Unit>(march: &March<'_>, ray: &Ray, chunk: &mut SampleChunk) -> Vec4 {
        let (frame, mut sum) = (march.frame, ray.sum);
        // The greatest shown label; the least has no use.
        if GREATEST && frame.reading == Reading::Label {
            leave_out_hidden(frame, chunk);
        }
        let mut best = Self::START;
        for p in 0..chunk.packets.min(PACKETS) {
            let (code, weight) = (quarters(&chunk.code[p]), quarters(&chunk.weight[p]));
            for q in 0..LANES / 4 {
                let known = Vec4::select(weight[q].cmpgt(Vec4::ZERO), shown(frame, code[q]), Self::START);
                best = Self::more_extreme(best, known);
            }
        }
        let best = if GREATEST { best.max_element() } else { best.min_element() };
        sum.x = if Self::beats(best, sum.x) { best } else { sum.x };
        sum
    }

    #[inline(always)]
    fn is_final(frame: &Frame<'_>, sum: Vec4) -> bool {
        if GREATEST { sum.x >= frame.last_code } else { sum.x <= 0.0 }
    }

    fn seen(frame: &Frame<'_>, sum: Vec4) -> Vec4 {
        let is_any = if GREATEST { sum.x >= 0.0 } else { sum.x < f32::MAX };
        opaque(frame, is_any.then_some(sum.x))
    }
}

/// The mode of the weighted mean: a ray's sum is the sum of weighted codes, then the sum of weights.
pub(crate) struct Average;

impl Accumulate for Average {
    const START: Vec4 = Vec4::ZERO;
    const OCCLUDES: bool = false;

    #[inline(always)]
    fn add<C: Code, U: Unit>(_: &March<'_>, ray: &Ray, chunk: &mut SampleChunk) -> Vec4 {
        let mut sum = ray.sum;
        let (mut codes, mut weights) = (Vec4::ZERO, Vec4::ZERO);
        for p in 0..chunk.packets.min(PACKETS) {
            let (code, weight) = (quarters(&chunk.code[p]), quarters(&chunk.weight[p]));
            for q in 0..LANES / 4 {
                codes += code[q] * weight[q];
                weights += weight[q];
            }
        }
        sum.x += codes.element_sum();
        sum.y += weights.element_sum();
        sum
    }

    #[inline(always)]
    fn is_final(_: &Frame<'_>, _: Vec4) -> bool {
        false
    }

    fn seen(frame: &Frame<'_>, sum: Vec4) -> Vec4 {
        opaque(frame, (sum.y > 0.0).then(|| mean(sum)))
    }
}

/// The mean of a ray's sum, rounded to a whole code within rounding errors: the mean of voxels of one value is that
/// value.
fn mean(sum: Vec4) -> f32 {
    let mean = sum.x / sum.y;
    let whole = mean.round();
    if (mean - whole).abs() <= 4.0 * f32::EPSILON * whole.abs() { whole } else { mean }
}

/// Zeroes the weight of samples of hidden labels: they hide nothing.
#[inline(never)]
fn leave_out_hidden(frame: &Frame<'_>, chunk: &mut SampleChunk) {
    let entries = Entries::of(frame);
    for p in 0..chunk.packets.min(PACKETS) {
        for i in 0..LANES {
            if entries.lookup(chunk.code[p][i] * frame.positions_per_code).w <= 0.0 {
                chunk.weight[p][i] = 0.0;
            }
        }
    }
}

#[inline(always)]
fn quarters(packet: &Packet) -> [Vec4; LANES / 4] {
    let mut out = [Vec4::ZERO; LANES / 4];
    for i in 0..LANES / 4 {
        out[i] = Vec4::new(packet[4 * i], packet[4 * i + 1], packet[4 * i + 2], packet[4 * i + 3]);
    }
    out
}

/// Clamps codes to the table before an extreme is taken: beyond its ends, its end values apply.
#[inline(always)]
fn shown(frame: &Frame<'_>, codes: Vec4) -> Vec4 {
    codes.max(Vec4::ZERO).min(Vec4::splat(frame.last_code))
}

/// The table's colour at a code, opaque; nothing for `None`.
fn opaque(frame: &Frame<'_>, code: Option<f32>) -> Vec4 {
    match code {
        Some(code) => Vec4::from_array(frame.settings.table.lookup(code / frame.last_code)).with_w(0.0),
        None => Vec4::W,
    }
}

/// `(1 - alpha)^weight`: logarithm and exponential by polynomials, good to 4e-7 for weights up to 1. Weight 0 passes
/// everything exactly, alpha 1 nothing. Two packets at a time: one alone would mostly wait for its own last result.
#[inline(always)]
fn transmitted(alpha: [&Packet; 2], weight: [&Packet; 2]) -> [Packet; 2] {
    const TWO: usize = 2 * LANES;
    let (mut x, mut w, mut passed) = ([0.0f32; TWO], [0.0f32; TWO], [0.0f32; TWO]);
    for i in 0..LANES {
        (x[i], x[i + LANES]) = (1.0 - alpha[0][i], 1.0 - alpha[1][i]);
        (w[i], w[i + LANES]) = (weight[0][i], weight[1][i]);
    }
    let mut depth = log2(&x);
    for i in 0..TWO {
        depth[i] *= w[i];
    }
    let powers = exp2(&depth);
    for i in 0..TWO {
        passed[i] = if (x[i] <= 0.0) & (w[i] > 0.0) { 0.0 } else { powers[i] };
    }
    let mut out = [[0.0; LANES]; 2];
    for i in 0..LANES {
        (out[0][i], out[1][i]) = (passed[i], passed[i + LANES]);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn transmittance_is_the_power() {
        for weight in [0.0f32, 1e-6, 0.01, 0.3, 0.5, 1.0, 2.0, 7.5] {
            let mut worst = 0.0f64;
            for k in (0..=65536).step_by(8) {
                let alpha: Packet = std::array::from_fn(|i| (k + i) as f32 / 65543.0);
                let [found, twin] = transmitted([&alpha; 2], [&[weight; LANES]; 2]);
                assert_eq!(found, twin);
                for i in 0..LANES {
                    let exact = (1.0 - alpha[i] as f64).powf(weight as f64);
                    worst = worst.max((found[i] as f64 - exact).abs());
                }
            }
            // Thousands of samples in a row then stay within a tenth of a picture's step of the exact product.
            assert!(worst < 4e-7, "{weight}: {worst}");
        }
        let (alpha, weight) = ([0.0, 1.0, 1.0, 0.5, 0.0, 0.0, 0.0, 0.0], [3.0, 1e-3, 0.0, 0.0, 0.0, 1.0, 9.0, 0.1]);
        let [ends, _] = transmitted([&alpha; 2], [&weight; 2]);
        assert_eq!(ends, [1.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]);
    }
}
