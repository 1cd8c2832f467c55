//! How a ray's samples become a pixel: one type per mode.
//!
//! A sample's weight is its segment's length in unit distances; samples that do not exist have weight 0. As in `sample`,
//! everything is inlined and free of closures.

use crate::frame::{Cell, Frame};
use crate::macrocells::{Coverage, Reach};
use crate::packet::{LANES, PACKETS, Packet};
use crate::ray::Ray;
use crate::sample::{Chunk, Code, Unit};
use crate::steps::StepTable;
use crate::tile::{March, Stretch};
use glam::{Vec4, Vec4Swizzles};
use std::ops::Range;

/// A mode.
pub(crate) trait Blend {
    /// A ray's sum before its first sample.
    const START: Vec4;

    /// Whether the order of samples matters. Where it does not, the most promising bricks come first.
    const FRONT_TO_BACK: bool;

    /// Whether a segment is looked at in its middle or from end to end.
    const REACH: Reach = Reach::Middles;

    /// Whether what is in front takes light from what is behind; the sum's last component then is the light left.
    const OCCLUDES: bool = false;

    /// How much of a brick can change the sum: what its mask says, where that does not depend on the sum.
    #[inline(always)]
    fn coverage(cell: &Cell<'_>, _: &Ray) -> Coverage {
        cell.mask.coverage()
    }

    /// In which boxes of macro-cells samples can change the sum: a bit for each.
    ///
    /// # Safety
    /// The brick has these boxes.
    #[inline(always)]
    unsafe fn sees(cell: &Cell<'_>, boxes: &[i32; LANES], _: Vec4) -> u64 {
        // SAFETY: the caller's promise.
        unsafe { cell.mask.seen(boxes) }
    }

    /// Takes the segments `from..to` of a stretch, or fewer if nothing behind those can be seen.
    fn take<C: Code, U: Unit, const INVALID: bool>(
        march: &March<'_>,
        stretch: &Stretch,
        ray: &mut Ray,
        chunk: &mut Chunk,
        segments: Range<i32>,
    );

    /// Whether no further sample can be seen.
    fn is_final<C: Code>(sum: Vec4) -> bool;

    /// What is seen: premultiplied colour, and how much light passes.
    fn seen<C: Code>(frame: &Frame<'_>, sum: Vec4) -> Vec4;
}

/// A mode that samples segments in their middles.
pub(crate) trait Sum: Blend {
    /// Adds a chunk of samples.
    fn add<C: Code>(frame: &Frame<'_>, sum: Vec4, chunk: &mut Chunk) -> Vec4;
}

/// Emission and absorption: the sum is premultiplied colour and transmittance.
pub(crate) struct Dvr;

/// A ray ends where less light than this passes: all that is behind could add 1/4096 of a channel, a sixteenth of one
/// step of an 8-bit picture.
pub(crate) const FAINTEST: f32 = 1.0 / 4096.0;

impl Dvr {
    #[inline(always)]
    fn add_whole_steps(table: &StepTable<'_>, sum: Vec4, chunk: &mut Chunk) -> Vec4 {
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
}

impl Blend for Dvr {
    const START: Vec4 = Vec4::W;
    const FRONT_TO_BACK: bool = true;
    const OCCLUDES: bool = true;

    #[inline(always)]
    fn take<C: Code, U: Unit, const INVALID: bool>(
        march: &March<'_>,
        stretch: &Stretch,
        ray: &mut Ray,
        chunk: &mut Chunk,
        segments: Range<i32>,
    ) {
        stretch.add::<C, Self, U, INVALID>(march, ray, chunk, segments);
    }

    #[inline(always)]
    fn is_final<C: Code>(sum: Vec4) -> bool {
        sum.w < FAINTEST
    }

    fn seen<C: Code>(_: &Frame<'_>, sum: Vec4) -> Vec4 {
        sum
    }
}

impl Sum for Dvr {
    #[inline(always)]
    fn add<C: Code>(frame: &Frame<'_>, sum: Vec4, chunk: &mut Chunk) -> Vec4 {
        if C::BYTES == 1
            && chunk.whole_steps > 0
            && let Some(table) = frame.steps.zone(chunk.zone)
        {
            return Self::add_whole_steps(&table, sum, chunk);
        }
        let entries = Entries::of(frame);
        let packets = chunk.packets.min(PACKETS);
        let mut seen = [false; PACKETS];
        for p in 0..packets {
            let position = entries.positions(frame, &chunk.code[p]);
            seen[p] = frame.shows(&position);
            if seen[p] {
                for i in 0..LANES {
                    let entry = entries.lookup(position[i]);
                    chunk.entry[p][i] = entry;
                    chunk.alpha[p][i] = entry.w;
                }
            }
        }
        for p in (0..packets).step_by(2) {
            if seen[p] || seen[p + 1] {
                [chunk.passed[p], chunk.passed[p + 1]] =
                    transmitted([&chunk.alpha[p], &chunk.alpha[p + 1]], [&chunk.weight[p], &chunk.weight[p + 1]]);
            }
        }
        let (mut color, mut transmittance) = (sum, sum.w);
        for p in 0..packets {
            if seen[p] {
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

/// The transfer table, for quick look-up.
pub(crate) struct Entries<'a> {
    entries: &'a [[f32; 4]],
    /// The greatest position: short of the last entry, so that there is one to its right.
    limit: f32,
}

impl<'a> Entries<'a> {
    #[inline(always)]
    pub(crate) fn of(frame: &Frame<'a>) -> Self {
        let entries = &frame.settings.table.entries[..];
        assert!(entries.len() >= 2 && entries.len() <= 1 << 24);
        Self { entries, limit: ((entries.len() - 1) as i32 as f32).next_down() }
    }

    /// Where the codes are in the table.
    #[inline(always)]
    fn positions(&self, frame: &Frame<'_>, code: &Packet) -> Packet {
        let mut position = [0.0f32; LANES];
        for i in 0..LANES {
            position[i] = code[i] * frame.positions_per_code;
        }
        position
    }

    /// [`brickyard_volume::TransferTable::lookup`] at a position in entries.
    #[inline(always)]
    pub(crate) fn lookup(&self, position: f32) -> Vec4 {
        // Written so that NaN, too, ends up inside.
        let position = if position > 0.0 { position } else { 0.0 };
        let position = if position < self.limit { position } else { self.limit };
        // SAFETY: 0 <= position <= limit < 2^24.
        let index = unsafe { position.to_int_unchecked::<i32>() };
        // SAFETY: limit is less than the last index, so its whole part is at most the last but one.
        let [a, b] =
            unsafe { [self.entries.get_unchecked(index as usize), self.entries.get_unchecked(index as usize + 1)] };
        let (a, b) = (Vec4::from_array(*a), Vec4::from_array(*b));
        a + (b - a) * (position - index as f32)
    }
}

/// The greatest code; negative before the first sample.
pub(crate) struct Mip;

impl Blend for Mip {
    const START: Vec4 = Vec4::NEG_ONE;
    const FRONT_TO_BACK: bool = false;

    #[inline(always)]
    fn coverage(cell: &Cell<'_>, ray: &Ray) -> Coverage {
        let [low, high] = cell.brick.cells.whole();
        if low > high || high as f32 <= ray.sum.x { Coverage::None } else { Coverage::Some }
    }

    #[inline(always)]
    unsafe fn sees(cell: &Cell<'_>, boxes: &[i32; LANES], sum: Vec4) -> u64 {
        let mut bits = 0;
        for i in 0..LANES {
            // SAFETY: the caller's promise; there is an extreme for every box.
            let greatest = unsafe { *cell.extremes.get_unchecked(boxes[i] as usize) };
            bits |= ((greatest as f32 > sum.x) as u64) << i;
        }
        bits
    }

    #[inline(always)]
    fn take<C: Code, U: Unit, const INVALID: bool>(
        march: &March<'_>,
        stretch: &Stretch,
        ray: &mut Ray,
        chunk: &mut Chunk,
        segments: Range<i32>,
    ) {
        stretch.add::<C, Self, U, INVALID>(march, ray, chunk, segments);
    }

    #[inline(always)]
    fn is_final<C: Code>(sum: Vec4) -> bool {
        sum.x >= C::MAX as f32
    }

    fn seen<C: Code>(frame: &Frame<'_>, sum: Vec4) -> Vec4 {
        opaque::<C>(frame, (sum.x >= 0.0).then_some(sum.x))
    }
}

impl Sum for Mip {
    #[inline(always)]
    fn add<C: Code>(_: &Frame<'_>, mut sum: Vec4, chunk: &mut Chunk) -> Vec4 {
        let mut best = Self::START;
        for p in 0..chunk.packets.min(PACKETS) {
            let (code, weight) = (quarters(&chunk.code[p]), quarters(&chunk.weight[p]));
            for q in 0..LANES / 4 {
                best = best.max(Vec4::select(weight[q].cmpgt(Vec4::ZERO), code[q], Self::START));
            }
        }
        sum.x = sum.x.max(best.max_element());
        sum
    }
}

/// The least code; past the greatest before the first sample.
pub(crate) struct MinIp;

impl Blend for MinIp {
    const START: Vec4 = Vec4::MAX;
    const FRONT_TO_BACK: bool = false;

    #[inline(always)]
    fn coverage(cell: &Cell<'_>, ray: &Ray) -> Coverage {
        let [low, high] = cell.brick.cells.whole();
        if low > high || low as f32 >= ray.sum.x { Coverage::None } else { Coverage::Some }
    }

    #[inline(always)]
    unsafe fn sees(cell: &Cell<'_>, boxes: &[i32; LANES], sum: Vec4) -> u64 {
        let mut bits = 0;
        for i in 0..LANES {
            // SAFETY: the caller's promise; there is an extreme for every box.
            let least = unsafe { *cell.extremes.get_unchecked(boxes[i] as usize) };
            bits |= (((least as f32) < sum.x) as u64) << i;
        }
        bits
    }

    #[inline(always)]
    fn take<C: Code, U: Unit, const INVALID: bool>(
        march: &March<'_>,
        stretch: &Stretch,
        ray: &mut Ray,
        chunk: &mut Chunk,
        segments: Range<i32>,
    ) {
        stretch.add::<C, Self, U, INVALID>(march, ray, chunk, segments);
    }

    #[inline(always)]
    fn is_final<C: Code>(sum: Vec4) -> bool {
        sum.x <= 0.0
    }

    fn seen<C: Code>(frame: &Frame<'_>, sum: Vec4) -> Vec4 {
        opaque::<C>(frame, (sum.x < f32::MAX).then_some(sum.x))
    }
}

impl Sum for MinIp {
    #[inline(always)]
    fn add<C: Code>(_: &Frame<'_>, mut sum: Vec4, chunk: &mut Chunk) -> Vec4 {
        let mut best = Self::START;
        for p in 0..chunk.packets.min(PACKETS) {
            let (code, weight) = (quarters(&chunk.code[p]), quarters(&chunk.weight[p]));
            for q in 0..LANES / 4 {
                best = best.min(Vec4::select(weight[q].cmpgt(Vec4::ZERO), code[q], Self::START));
            }
        }
        sum.x = sum.x.min(best.min_element());
        sum
    }
}

/// The weighted mean: the sum is that of weighted codes, then that of weights.
pub(crate) struct Average;

impl Blend for Average {
    const START: Vec4 = Vec4::ZERO;
    const FRONT_TO_BACK: bool = true;

    #[inline(always)]
    fn take<C: Code, U: Unit, const INVALID: bool>(
        march: &March<'_>,
        stretch: &Stretch,
        ray: &mut Ray,
        chunk: &mut Chunk,
        segments: Range<i32>,
    ) {
        stretch.add::<C, Self, U, INVALID>(march, ray, chunk, segments);
    }

    #[inline(always)]
    fn is_final<C: Code>(_: Vec4) -> bool {
        false
    }

    fn seen<C: Code>(frame: &Frame<'_>, sum: Vec4) -> Vec4 {
        opaque::<C>(frame, (sum.y > 0.0).then(|| sum.x / sum.y))
    }
}

impl Sum for Average {
    #[inline(always)]
    fn add<C: Code>(_: &Frame<'_>, mut sum: Vec4, chunk: &mut Chunk) -> Vec4 {
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
}

/// A packet as vectors of four.
#[inline(always)]
fn quarters(packet: &Packet) -> [Vec4; LANES / 4] {
    let mut out = [Vec4::ZERO; LANES / 4];
    for i in 0..LANES / 4 {
        out[i] = Vec4::new(packet[4 * i], packet[4 * i + 1], packet[4 * i + 2], packet[4 * i + 3]);
    }
    out
}

/// What of the background passes premultiplied colour.
pub(crate) fn over_background(frame: &Frame<'_>, sum: Vec4) -> [f32; 3] {
    let background = frame.settings.background;
    std::array::from_fn(|k| sum[k] + sum.w * background[k])
}

/// The table's colour at a code, opaque; nothing where there is none.
fn opaque<C: Code>(frame: &Frame<'_>, code: Option<f32>) -> Vec4 {
    match code {
        Some(code) => Vec4::from_array(frame.settings.table.lookup(code / C::MAX as f32)).with_w(0.0),
        None => Vec4::W,
    }
}

/// `(1 - alpha)^weight`: logarithm and exponential by polynomials, good to 4e-7 for weights up to 1. Weight 0 passes
/// everything exactly, alpha 1 nothing. Two packets at a time: one alone would mostly wait for its own last result.
#[inline(always)]
fn transmitted(alpha: [&Packet; 2], weight: [&Packet; 2]) -> [Packet; 2] {
    use std::f32::consts::{LN_2, LOG2_E, SQRT_2};
    /// Adding and subtracting it rounds to a whole number, which is then also in its low bits.
    const ROUND: f32 = 12_582_912.0;
    const HALF_ROOT: i32 = (SQRT_2 * 0.5).to_bits() as i32;
    const TWO: usize = 2 * LANES;
    let (mut x, mut w, mut passed) = ([0.0f32; TWO], [0.0f32; TWO], [0.0f32; TWO]);
    for i in 0..LANES {
        (x[i], x[i + LANES]) = (1.0 - alpha[0][i], 1.0 - alpha[1][i]);
        (w[i], w[i + LANES]) = (weight[0][i], weight[1][i]);
    }
    for i in 0..TWO {
        // x = 2^e * m with m in [sqrt(1/2), sqrt(2)); log2 m = 2 / ln 2 * atanh(s), |s| < 0.172: the next term is 2e-8.
        let bits = x[i].to_bits() as i32;
        let e = (bits - HALF_ROOT) >> 23;
        let m = f32::from_bits((bits - (e << 23)) as u32);
        let s = (m - 1.0) / (m + 1.0);
        let s2 = s * s;
        let series = (1.0 + s2 * (1.0 / 3.0)) + (s2 * s2) * (0.2 + s2 * (1.0 / 7.0));
        let log2 = e as f32 + (2.0 * LOG2_E * s) * series;
        // 2^y = 2^n * e^f with |f| < 0.347: the next term is 1e-7.
        let y = w[i] * log2;
        let y = if y > -126.0 { y } else { -126.0 };
        let n = y + ROUND;
        let f = (y - (n - ROUND)) * LN_2;
        let f2 = f * f;
        let power =
            (1.0 + f) + f2 * ((0.5 + f * (1.0 / 6.0)) + f2 * ((1.0 / 24.0 + f * (1.0 / 120.0)) + f2 * (1.0 / 720.0)));
        let n = (n.to_bits() as i32) - (ROUND.to_bits() as i32);
        let value = f32::from_bits((power.to_bits() as i32 + (n << 23)) as u32);
        passed[i] = if (x[i] <= 0.0) & (w[i] > 0.0) { 0.0 } else { value };
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
            // Thousands of samples in a row then stay a tenth of a picture's step from the exact product.
            assert!(worst < 4e-7, "{weight}: {worst}");
        }
        let (alpha, weight) = ([0.0, 1.0, 1.0, 0.5, 0.0, 0.0, 0.0, 0.0], [3.0, 1e-3, 0.0, 0.0, 0.0, 1.0, 9.0, 0.1]);
        let [ends, _] = transmitted([&alpha; 2], [&weight; 2]);
        assert_eq!(ends, [1.0, 0.0, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0]);
    }
}
