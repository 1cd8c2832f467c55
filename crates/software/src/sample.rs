//! Trilinear samples of a padded brick, many at a time.
//!
//! Samples go in packets of 8, one vector, and packets in chunks of 4: each step is done for the whole chunk before the
//! next one, so that the processor has four independent packets to work on while it waits for memory and arithmetic.
//!
//! Neighbours along x are read together, so a sample costs four reads. Codes stay codes (as `f32`, counted from the
//! transfer table's first), and numbers of f32 slots become codes after interpolation; invalid ones are 0 and so drop
//! out of the weighted sum, and only the sum of weights accounts for them. If all 8-bit codes are valid, neighbours
//! along x are weighted as whole numbers of 15 bits, one instruction for the eight pairs of a packet: exact to 1/256 of
//! a code.
//!
//! Everything here is `#[inline(always)]` and free of closures but those of [`Unit::call`], to be compiled for the
//! vector unit of its final function: one for a chunk and one for a packet, for each width of codes, shared by all
//! modes.

use crate::packet::{LANES, PACKETS, Packet};
use crate::row::Row;
use crate::steps::Places;
use crate::unit::Unit;
use brickyard_volume::SlotEncoding;
use brickyard_volume::slot_encoding::LEAST_SLOT;
use glam::Vec4;

/// Up to four packets of samples along a ray, near to far, and scratch space for them (kept, as clearing it takes
/// time).
pub(crate) struct SampleChunk {
    pub(crate) packets: usize,
    /// The number of samples, if all of them are whole steps of one zone; else 0.
    pub(crate) whole_steps: usize,
    pub(crate) zone: usize,
    /// Each sample's place, in segments from the middle of the stretch's first one.
    pub(crate) along: [Packet; PACKETS],
    /// Each sample's weight: its segment's length in unit distances; 0 if there is no sample.
    pub(crate) weight: [Packet; PACKETS],
    pub(crate) code: [Packet; PACKETS],
    /// The voxel below each sample, and the fractions towards the next along each axis.
    voxel: [[i32; LANES]; PACKETS],
    fraction: [[Packet; 3]; PACKETS],
    /// The samples' places in the table of whole steps, or of depths.
    pub(crate) places: [Places; PACKETS],
    /// The transfer table's colour and opacity for each sample.
    pub(crate) entry: [[Vec4; LANES]; PACKETS],
    pub(crate) alpha: [Packet; PACKETS],
    /// The share of light transmitted by each sample.
    pub(crate) passed: [Packet; PACKETS],
    pub(crate) media: Row,
}

impl SampleChunk {
    pub(crate) const EMPTY: Self = Self {
        packets: 0,
        whole_steps: 0,
        zone: 0,
        along: [[0.0; LANES]; PACKETS],
        weight: [[0.0; LANES]; PACKETS],
        code: [[0.0; LANES]; PACKETS],
        voxel: [[0; LANES]; PACKETS],
        fraction: [[[0.0; LANES]; 3]; PACKETS],
        places: [Places::EMPTY; PACKETS],
        entry: [[Vec4::ZERO; LANES]; PACKETS],
        alpha: [[0.0; LANES]; PACKETS],
        passed: [[0.0; LANES]; PACKETS],
        media: Vec::new(),
    };
}

/// Voxels along the edge of the smallest brick with two voxels on each side of a place.
const LEAST_PADDED: usize = 4;

/// All packets of a chunk, a bit for each.
pub(crate) const ALL_PACKETS: u32 = (1 << PACKETS) - 1;

/// The memory layout of a code, or of the number in an f32 slot, and whether voxels may have no value.
pub(crate) trait Code {
    const BYTES: usize;
    /// Whether voxels may have no value.
    const INVALID: bool;
    /// The greatest code; samples of f32 slots may have any.
    const MAX: u32;
    /// Whether slots hold numbers that are not codes yet.
    const IS_FLOAT: bool = false;
    /// Two neighbouring codes, the first in the low bits: no wider than they are, so that vectors of them are assembled
    /// straight from memory.
    type Pair: Copy + Default;

    /// Reads the codes at `at` and next to it.
    ///
    /// # Safety
    /// `2 * BYTES` bytes can be read at `at`.
    unsafe fn pair(at: *const u8) -> Self::Pair;

    fn near(pair: Self::Pair) -> f32;

    fn far(pair: Self::Pair) -> f32;

    /// The voxel's number for interpolation, counted from the table's first, and whether the voxel has a value; the
    /// number is 0 if it has none.
    #[inline(always)]
    fn part(code: f32, map: &CodeMap) -> (f32, bool) {
        let is_valid = !Self::INVALID || code != 0.0;
        (if is_valid { code - map.first } else { 0.0 }, is_valid)
    }

    /// Interpolates a pair with values, counted from the table's first: `t` from the first to the second.
    #[inline(always)]
    fn mixed(pair: Self::Pair, t: f32, map: &CodeMap) -> f32 {
        mix(Self::near(pair) - map.first, Self::far(pair) - map.first, t)
    }
}

/// The map from numbers in slots to codes counted from the transfer table's first.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CodeMap {
    /// The number of the table's first code.
    pub(crate) first: f32,
    /// Codes per number; 1 if slots hold codes.
    pub(crate) per_number: f32,
    /// The greatest distinguished difference from the first number.
    pub(crate) farthest: f32,
}

impl CodeMap {
    pub(crate) fn of(encoding: &SlotEncoding) -> Self {
        Self {
            first: encoding.first_slot(),
            per_number: encoding.codes_per_slot() as f32,
            farthest: encoding.farthest_slots(),
        }
    }

    /// The code at an interpolated difference from the first number.
    #[inline(always)]
    pub(crate) fn code(&self, difference: f32) -> f32 {
        let near = if difference < self.farthest { difference } else { self.farthest };
        let near = if near > -self.farthest { near } else { -self.farthest };
        near * self.per_number
    }
}

pub(crate) struct Code8<const INVALID: bool>;

pub(crate) struct Code16<const INVALID: bool>;

/// Voxels of f32 slots always count as possibly without a value: testing one costs little beside the fetch.
pub(crate) struct Float32;

impl<const INVALID: bool> Code for Code8<INVALID> {
    const BYTES: usize = 1;
    const INVALID: bool = INVALID;
    const MAX: u32 = 0xff;
    type Pair = u16;

    #[inline(always)]
    unsafe fn pair(at: *const u8) -> u16 {
        // SAFETY: the caller promises two bytes; no alignment is needed.
        u16::from_le(unsafe { at.cast::<u16>().read_unaligned() })
    }

    #[inline(always)]
    fn near(pair: u16) -> f32 {
        (pair & 0xff) as i32 as f32
    }

    #[inline(always)]
    fn far(pair: u16) -> f32 {
        (pair >> 8) as i32 as f32
    }
}

impl<const INVALID: bool> Code for Code16<INVALID> {
    const BYTES: usize = 2;
    const INVALID: bool = INVALID;
    const MAX: u32 = 0xffff;
    type Pair = u32;

    #[inline(always)]
    unsafe fn pair(at: *const u8) -> u32 {
        // SAFETY: the caller promises four bytes; no alignment is needed.
        u32::from_le(unsafe { at.cast::<u32>().read_unaligned() })
    }

    #[inline(always)]
    fn near(pair: u32) -> f32 {
        (pair & 0xffff) as i32 as f32
    }

    #[inline(always)]
    fn far(pair: u32) -> f32 {
        (pair >> 16) as i32 as f32
    }

    /// As exact and fast as if codes were counted from 0: the subtraction replaces a conversion. The float with a code
    /// as its last bits is that code plus 2^23.
    #[inline(always)]
    fn mixed(pair: u32, t: f32, map: &CodeMap) -> f32 {
        const SHIFT: f32 = (1 << 23) as f32;
        let (near, far) = (pair & 0xffff, pair >> 16);
        let counted = f32::from_bits(SHIFT.to_bits() | near) - (SHIFT + map.first);
        counted + t * (far as i32 - near as i32) as f32
    }
}

impl Code for Float32 {
    const BYTES: usize = 4;
    const INVALID: bool = true;
    const MAX: u32 = 0xffff;
    const IS_FLOAT: bool = true;
    type Pair = u64;

    #[inline(always)]
    unsafe fn pair(at: *const u8) -> u64 {
        // SAFETY: the caller promises eight bytes; no alignment is needed.
        u64::from_le(unsafe { at.cast::<u64>().read_unaligned() })
    }

    #[inline(always)]
    fn near(pair: u64) -> f32 {
        f32::from_bits(pair as u32)
    }

    #[inline(always)]
    fn far(pair: u64) -> f32 {
        f32::from_bits((pair >> 32) as u32)
    }

    /// Differences of near numbers are exact, so numbers far from zero are interpolated as exactly as near ones.
    #[inline(always)]
    fn part(number: f32, map: &CodeMap) -> (f32, bool) {
        let is_valid = number > LEAST_SLOT;
        (if is_valid { number - map.first } else { 0.0 }, is_valid)
    }
}

/// The voxel grid of padded bricks of one size.
#[derive(Clone, Copy)]
pub(crate) struct Grid {
    padded: usize,
    /// The greatest coordinate: the last cell of eight voxels, just short of its far corner.
    limit: f32,
}

impl Grid {
    #[inline(always)]
    pub(crate) fn new(padded: u32) -> Self {
        assert!(padded >= 2, "not a padded brick");
        Self { padded: padded as usize, limit: (padded as f32 - 1.0).next_down() }
    }

    /// Finds the voxels of a chunk's samples, at the slot coordinates `origin + along * step`, and the fractions
    /// towards the next voxels.
    #[inline(always)]
    pub(crate) fn locate(&self, origin: [f32; 3], step: [f32; 3], chunk: &mut SampleChunk) {
        for p in 0..chunk.packets.min(PACKETS) {
            // Straight into the chunk: arrays returned by `voxels` would take a detour.
            let mut voxel = [0i32; LANES];
            for a in [2, 1, 0] {
                for i in 0..LANES {
                    let (whole, fraction) = self.split::<0>(origin[a] + chunk.along[p][i] * step[a]);
                    chunk.fraction[p][a][i] = fraction;
                    voxel[i] = voxel[i] * self.padded as i32 + whole;
                }
            }
            chunk.voxel[p] = voxel;
        }
    }

    /// The voxels below eight slot coordinates, given axis by axis, and the fractions towards the next. Coordinates are
    /// clamped into the brick, at least `MARGIN` voxels inside: whole parts are from `MARGIN` to `padded - 2 - MARGIN`.
    #[inline(always)]
    fn voxels<const MARGIN: u8>(&self, points: &[Packet; 3]) -> ([i32; LANES], [Packet; 3]) {
        let (mut voxel, mut fraction) = ([0i32; LANES], [[0.0f32; LANES]; 3]);
        for a in [2, 1, 0] {
            for i in 0..LANES {
                let whole;
                (whole, fraction[a][i]) = self.split::<MARGIN>(points[a][i]);
                voxel[i] = voxel[i] * self.padded as i32 + whole;
            }
        }
        (voxel, fraction)
    }

    #[inline(always)]
    fn split<const MARGIN: u8>(&self, v: f32) -> (i32, f32) {
        let (low, high) = (MARGIN as f32, self.limit - MARGIN as f32);
        // Written so that NaN ends up inside, too.
        let v = if v > low { v } else { low };
        let v = if v < high { v } else { high };
        // SAFETY: 0 <= v <= limit < 2^31.
        let whole = unsafe { v.to_int_unchecked::<i32>() };
        (whole, v - whole as f32)
    }
}

/// A padded brick, ready to sample.
#[derive(Clone, Copy)]
pub(crate) struct Brick<'a> {
    pub(crate) codes: &'a [u8],
    grid: Grid,
    pub(crate) map: CodeMap,
}

impl<'a> Brick<'a> {
    #[inline(always)]
    pub(crate) fn new<C: Code>(codes: &'a [u8], padded: u32, map: CodeMap) -> Self {
        let (n, grid) = (padded as usize, Grid::new(padded));
        assert!(codes.len() == n * n * n * C::BYTES, "not a padded brick");
        Self { codes, grid, map }
    }

    /// Voxels along the padded brick's edge.
    #[inline(always)]
    pub(crate) fn padded(&self) -> usize {
        self.grid.padded
    }

    /// The voxels below eight slot coordinates, each with a lower neighbour and two upper ones along each axis, and the
    /// coordinates' fractions towards the next.
    #[inline(always)]
    pub(crate) fn voxels_around(&self, points: &[Packet; 3]) -> ([i32; LANES], [Packet; 3]) {
        assert!(self.grid.padded >= LEAST_PADDED, "no voxels to take differences of");
        self.grid.voxels::<1>(points)
    }

    /// Fills in the codes of a chunk's samples, at the slot coordinates `origin + along * step` (voxel centres at whole
    /// numbers). If voxels may have no value, code 0 is left out, and a sample weighs nothing if less than half of its
    /// voxels' weight is valid.
    #[inline(always)]
    pub(crate) fn sample<C: Code, U: Unit>(&self, origin: [f32; 3], step: [f32; 3], chunk: &mut SampleChunk) {
        U::call(
            (&origin, &step),
            #[inline(always)]
            move |(origin, step)| {
                self.grid.locate(*origin, *step, chunk);
                // SAFETY: the samples have been found in this brick.
                unsafe { self.sample_located::<C, U>(ALL_PACKETS, chunk) };
            },
        );
    }

    /// Samples like [`Brick::sample`], but only these packets (a bit for each), already located.
    ///
    /// # Safety
    /// [`Grid::locate`] has located the samples in a brick as large as this one.
    #[inline(always)]
    pub(crate) unsafe fn sample_located<C: Code, U: Unit>(&self, packets: u32, chunk: &mut SampleChunk) {
        for p in 0..chunk.packets.min(PACKETS) {
            if packets & 1 << p == 0 {
                continue;
            }
            let (voxel, fraction, weight) = (&chunk.voxel[p], &chunk.fraction[p], &mut chunk.weight[p]);
            // SAFETY: by the caller's promise every coordinate's whole part is at most padded - 2.
            chunk.code[p] = unsafe { self.interpolated::<C, U>(voxel, fraction, weight) };
        }
    }

    /// Returns the codes at eight slot coordinates, given axis by axis. The weights of those without a value become 0.
    #[inline(always)]
    pub(crate) fn sample_points<C: Code, U: Unit>(&self, points: &[Packet; 3], weight: &mut Packet) -> Packet {
        U::call(
            (points, weight),
            #[inline(always)]
            move |(points, weight)| {
                let (voxel, fraction) = self.grid.voxels::<0>(points);
                // SAFETY: every coordinate's whole part is at most padded - 2.
                unsafe { self.interpolated::<C, U>(&voxel, &fraction, weight) }
            },
        )
    }

    /// The codes at the given voxels and fractions towards their upper neighbours.
    ///
    /// # Safety
    /// Every index is that of a voxel with an upper neighbour along each axis.
    #[inline(always)]
    unsafe fn interpolated<C: Code, U: Unit>(
        &self,
        voxel: &[i32; LANES],
        fraction: &[Packet; 3],
        weight: &mut Packet,
    ) -> Packet {
        // SAFETY: the caller's promise.
        unsafe {
            if C::BYTES == 1 && !C::INVALID {
                self.interpolate_bytes::<U>(voxel, fraction)
            } else {
                self.interpolate::<C>(voxel, fraction, weight)
            }
        }
    }

    /// [`Brick::interpolated`] for valid 8-bit codes.
    ///
    /// # Safety
    /// Every index is that of a voxel with an upper neighbour along each axis, in a brick of 8-bit codes.
    #[inline(always)]
    unsafe fn interpolate_bytes<U: Unit>(&self, voxel: &[i32; LANES], t: &[Packet; 3]) -> Packet {
        const WHOLE: i32 = i16::MAX as i32;
        // The near code's weight in the low half, the far one's in the high half.
        let mut weights = [0i32; LANES];
        for i in 0..LANES {
            // SAFETY: fractions are from 0 to 1.
            let far = unsafe { (t[0][i] * WHOLE as f32 + 0.5).to_int_unchecked::<i32>() };
            weights[i] = (far << 16) + (WHOLE - far);
        }
        let (row, slice) = (self.grid.padded, self.grid.padded * self.grid.padded);
        let at = self.codes.as_ptr();
        // SAFETY: by the caller's promise these voxels and their neighbours along x are inside the brick, whose length
        // was checked on creation.
        let line = unsafe {
            [
                weighted_pairs::<U>(at, voxel, &weights),
                weighted_pairs::<U>(at.add(row), voxel, &weights),
                weighted_pairs::<U>(at.add(slice), voxel, &weights),
                weighted_pairs::<U>(at.add(slice + row), voxel, &weights),
            ]
        };
        let plane = [mix_packets(&line[0], &line[1], &t[1]), mix_packets(&line[2], &line[3], &t[1])];
        let mut code = mix_packets(&plane[0], &plane[1], &t[2]);
        for i in 0..LANES {
            code[i] = code[i] * (1.0 / WHOLE as f32) - self.map.first;
        }
        code
    }

    /// [`Brick::interpolated`] for all others.
    ///
    /// # Safety
    /// Every index is that of a voxel with an upper neighbour along each axis.
    #[inline(always)]
    unsafe fn interpolate<C: Code>(&self, index: &[i32; LANES], t: &[Packet; 3], weight: &mut Packet) -> Packet {
        let row = self.grid.padded;
        let mut plane = [[0.0f32; LANES]; 2];
        let mut plane_valid = [[0.0f32; LANES]; 2];
        for z in 0..2 {
            let mut line = [[0.0f32; LANES]; 2];
            let mut line_valid = [[0.0f32; LANES]; 2];
            for y in 0..2 {
                let mut pair = [C::Pair::default(); LANES];
                for i in 0..LANES {
                    let voxel = index[i] as usize + (z * row + y) * row;
                    // SAFETY: by the caller's promise voxel and its neighbour along x are inside the brick, whose
                    // length was checked on creation.
                    pair[i] = unsafe { C::pair(self.codes.as_ptr().add(voxel * C::BYTES)) };
                }
                for i in 0..LANES {
                    if !C::INVALID {
                        line[y][i] = C::mixed(pair[i], t[0][i], &self.map);
                        continue;
                    }
                    let (near, has_near) = C::part(C::near(pair[i]), &self.map);
                    let (far, has_far) = C::part(C::far(pair[i]), &self.map);
                    line[y][i] = mix(near, far, t[0][i]);
                    line_valid[y][i] = mix(has_near as u8 as f32, has_far as u8 as f32, t[0][i]);
                }
            }
            plane[z] = mix_packets(&line[0], &line[1], &t[1]);
            if C::INVALID {
                plane_valid[z] = mix_packets(&line_valid[0], &line_valid[1], &t[1]);
            }
        }
        let mut code = mix_packets(&plane[0], &plane[1], &t[2]);
        if C::INVALID {
            let valid = mix_packets(&plane_valid[0], &plane_valid[1], &t[2]);
            for i in 0..LANES {
                let enough = valid[i] >= 0.5;
                // Rounding may carry the quotient a hair past the greatest code.
                let (mean, most) = (code[i] / if enough { valid[i] } else { 1.0 }, C::MAX as f32 - self.map.first);
                code[i] = if C::IS_FLOAT || mean < most { mean } else { most };
                weight[i] = if enough { weight[i] } else { 0.0 };
            }
        }
        if C::IS_FLOAT {
            for i in 0..LANES {
                code[i] = self.map.code(code[i]);
            }
        }
        code
    }
}

/// The two bytes at each of the eight places, weighted by the low and the high half of its weights and added up.
///
/// # Safety
/// Two bytes can be read at every place; the halves are not negative.
#[inline(always)]
unsafe fn weighted_pairs<U: Unit>(at: *const u8, places: &[i32; LANES], weights: &[i32; LANES]) -> Packet {
    let mut pairs = [0u16; LANES];
    for i in 0..LANES {
        // SAFETY: the caller's promise.
        pairs[i] = unsafe { Code8::<false>::pair(at.add(places[i] as usize)) };
    }
    #[cfg(target_arch = "x86_64")]
    if U::AVX2 {
        // SAFETY: the machine has AVX2; all vectors are loaded from and stored to arrays of their size.
        return unsafe { weighted_pairs_avx2(&pairs, weights) };
    }
    let mut sums = [0.0; LANES];
    for i in 0..LANES {
        let [near, far] = pairs[i].to_le_bytes().map(i32::from);
        sums[i] = (near * (weights[i] & 0xffff) + far * (weights[i] >> 16)) as f32;
    }
    sums
}

/// The arithmetic of [`weighted_pairs`]; inlined into a function with AVX2.
///
/// # Safety
/// The machine has AVX2.
#[cfg(target_arch = "x86_64")]
#[inline(always)]
unsafe fn weighted_pairs_avx2(pairs: &[u16; LANES], weights: &[i32; LANES]) -> Packet {
    use std::arch::x86_64::{
        _mm_loadu_si128, _mm256_cvtepi32_ps, _mm256_cvtepu8_epi16, _mm256_loadu_si256, _mm256_madd_epi16,
        _mm256_storeu_ps,
    };
    let mut sums = [0.0; LANES];
    // SAFETY: the caller's promise; the arrays are as long as the vectors.
    unsafe {
        let codes = _mm256_cvtepu8_epi16(_mm_loadu_si128(pairs.as_ptr().cast()));
        let products = _mm256_madd_epi16(codes, _mm256_loadu_si256(weights.as_ptr().cast()));
        _mm256_storeu_ps(sums.as_mut_ptr(), _mm256_cvtepi32_ps(products));
    }
    sums
}

/// Interpolates between two numbers, `t` from the first to the second.
#[inline(always)]
pub(crate) fn mix(a: f32, b: f32, t: f32) -> f32 {
    a + t * (b - a)
}

#[inline(always)]
pub(crate) fn mix_packets(a: &Packet, b: &Packet, t: &Packet) -> Packet {
    let mut out = [0.0; LANES];
    for i in 0..LANES {
        out[i] = mix(a[i], b[i], t[i]);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::unit::Portable;
    use brickyard_volume::slot_encoding::INVALID_SLOT;

    const CODES: CodeMap = CodeMap { first: 0.0, per_number: 1.0, farthest: f32::MAX };

    fn sample<C: Code>(brick: &Brick<'_>, x: Packet, y: f32, z: f32) -> (Packet, Packet) {
        let packet = [x; PACKETS];
        let mut chunk =
            SampleChunk { packets: PACKETS, along: packet, weight: [[2.0; LANES]; PACKETS], ..SampleChunk::EMPTY };
        brick.sample::<C, Portable>([0.0, y, z], [1.0, 0.0, 0.0], &mut chunk);
        assert!(chunk.code.iter().all(|c| *c == chunk.code[0]), "packets must not differ");
        (chunk.code[0], chunk.weight[0])
    }

    #[test]
    fn a_trilinear_function_is_sampled_exactly_and_clamped_outside() {
        let n = 5;
        let value = |i: usize| ((i % n) * 100 + (i / n % n) * 1000 + (i / n / n) * 7000) as u16;
        let codes: Vec<u8> = (0..n * n * n).flat_map(|i| value(i).to_le_bytes()).collect();
        let brick = Brick::new::<Code16<false>>(&codes, n as u32, CODES);
        let x = [0.0, 0.5, 3.25, 4.0, -9.0, 1e9, f32::NAN, 2.0];
        let clamp = |v: f32| if v > 0.0 { v.min(4.0) } else { 0.0 };
        for (y, z) in [(0.0, 2.5), (1.5, 4.0), (3.99, 0.01), (-1e9, 1e9), (f32::INFINITY, f32::NEG_INFINITY)] {
            let (code, weight) = sample::<Code16<false>>(&brick, x, y, z);
            assert_eq!(weight, [2.0; LANES]);
            for i in 0..LANES {
                // A NaN distance spoils all three coordinates, but reads no memory outside.
                let inside = clamp(x[i]) * 100.0 + clamp(y) * 1000.0 + clamp(z) * 7000.0;
                let expected = if x[i].is_nan() { 0.0 } else { inside };
                // The limit is short of the far corner by 2^-22.
                assert!((code[i] - expected).abs() < 0.02, "{i} {y} {z}: {} {expected}", code[i]);
            }
        }
    }

    #[test]
    fn bytes_are_sampled_to_a_part_of_a_code() {
        let n = 4;
        let value = |i: usize| ((i % n) * 50 + (i / n % n) * 20 + (i / n / n) * 10) as u8;
        let codes: Vec<u8> = (0..n * n * n).map(value).collect();
        let brick = Brick::new::<Code8<false>>(&codes, n as u32, CODES);
        let x = [0.0, 0.5, 1.0 / 3.0, 0.999_999, 1.77, 2.25, 2.999_99, 3.0];
        for (y, z) in [(0.0, 2.5), (1.1, 3.0), (2.99, 0.01)] {
            let (code, _) = sample::<Code8<false>>(&brick, x, y, z);
            for i in 0..LANES {
                let expected = x[i] * 50.0 + y * 20.0 + z * 10.0;
                // The weight is off by 2^-16 at most, the difference along x is 50.
                assert!((code[i] - expected).abs() < 1e-3, "{i} {y} {z}: {} {expected}", code[i]);
            }
        }
    }

    #[test]
    fn invalid_corners_are_left_out() {
        // x = 0 is invalid, x = 1 holds 200.
        let codes = [0, 200, 0, 200, 0, 200, 0, 200];
        let brick = Brick::new::<Code8<true>>(&codes, 2, CODES);
        let x = [0.0, 0.25, 0.49, 0.51, 0.75, 0.9, 0.95, 1.0];
        let (code, weight) = sample::<Code8<true>>(&brick, x, 0.3, 0.6);
        assert_eq!(weight, [0.0, 0.0, 0.0, 2.0, 2.0, 2.0, 2.0, 2.0]);
        assert!(code[3..].iter().all(|c| (c - 200.0).abs() < 1e-3), "{code:?}");
    }

    /// In f32 a 16-bit code has 8 fractional bits; few codes less one of them have 20.
    #[test]
    fn codes_are_counted_from_the_table_s_first() {
        let map = CodeMap { first: 40_000.0, ..CODES };
        let row = [0u16, 40_001, 40_002, 65_535];
        let wide: Vec<u8> = (0..64).flat_map(|i| row[i % 4].to_le_bytes()).collect();
        let x = [0.0, 0.75, 1.0, 1.0 + 1.0 / 1024.0, 1.25, 1.5, 2.0, 3.0];
        let (all, _) = sample::<Code16<false>>(&Brick::new::<Code16<false>>(&wide, 4, map), x, 1.3, 0.6);
        let expected = [-40_000.0, 1.0 - 0.25 * 40_001.0, 1.0, 1.0 + 1.0 / 1024.0, 1.25, 1.5, 2.0, 25_535.0];
        for (found, expected) in all.iter().zip(expected) {
            assert!((found - expected).abs() <= 1e-6 * expected.abs(), "{all:?}");
        }
        let (valid, weight) = sample::<Code16<true>>(&Brick::new::<Code16<true>>(&wide, 4, map), x, 1.3, 0.6);
        assert_eq!((weight[0], valid[1], valid[3]), (0.0, 1.0, all[3]), "{valid:?}");
        let bytes: Vec<u8> = (0..64).map(|i| [100, 101, 102, 0][i % 4]).collect();
        let (codes, _) = sample::<Code8<false>>(
            &Brick::new::<Code8<false>>(&bytes, 4, CodeMap { first: 100.0, ..CODES }),
            [0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 3.0],
            1.3,
            0.6,
        );
        for (found, expected) in codes.iter().zip([0.0, 0.25, 0.5, 1.0, 1.5, 2.0, -100.0, -100.0]) {
            assert!((found - expected).abs() < 2e-2 * expected.abs().clamp(1e-2, 1.0), "{codes:?}");
        }
    }

    #[test]
    fn numbers_become_codes_of_any_size() {
        // x = 0 has no value, x = 1 holds 1e6, and x = 2 one more; beyond is an outlier.
        let row = [INVALID_SLOT, 1e6, 1_000_001.0, 1e9];
        let numbers: Vec<u8> = (0..64).flat_map(|i| row[i % 4].to_le_bytes()).collect();
        let map = CodeMap { first: 999_999.0, per_number: 64.0, farthest: 1e4 };
        let brick = Brick::new::<Float32>(&numbers, 4, map);
        let x = [0.25, 0.75, 1.0, 1.25, 1.5, 2.0, 2.0, 2.5];
        let (code, weight) = sample::<Float32>(&brick, x, 0.3, 1.6);
        assert_eq!(weight, [0.0, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0, 2.0]);
        for (found, expected) in code[1..].iter().zip([64.0f32, 64.0, 80.0, 96.0, 128.0, 128.0, 64e4]) {
            assert!((found - expected).abs() <= 1e-5 * expected, "{code:?}");
        }
    }
}
