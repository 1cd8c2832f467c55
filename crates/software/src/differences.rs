//! Differences of a padded brick's codes, linearly filtered, at eight places at a time: central ones, and the
//! separate samples of every operator; Sobel's shared ones are in `sobel`.
//!
//! The six places a voxel away from a place lie in the 32 voxels around it, many of them shared: they are read once,
//! two neighbours along x at a time, and the differences are interpolated like values. So a gradient costs 16 reads
//! instead of the 24 of six separate samples, and wastes no lane. If one of a packet's voxels has no value, or a number
//! too far off to be a code, six samples are taken after all.

use crate::gradients::Gradients;
use crate::packet::{LANES, Packet};
use crate::sample::{Brick, Code, mix, mix_packets};
use crate::stretch::March;
use crate::unit::Unit;
use brickyard_volume::Gradient;
use brickyard_volume::lighting::SMOOTH;

/// A sample taken by an operator: its place, in voxels from the operator's, and the share of its code in the difference
/// along each axis.
#[derive(Clone, Copy)]
pub(crate) struct Tap {
    pub(crate) offset: [f32; 3],
    pub(crate) share: [f32; 3],
}

/// The taps of central differences.
pub(crate) const CENTRAL: [Tap; 6] = taps([0.0, 1.0, 0.0]);

/// The taps of the Sobel operator.
pub(crate) const SOBEL: [Tap; 26] = taps(SMOOTH);

/// The places about a centre with a share in differences that are smoothed like this across their axis.
const fn taps<const N: usize>(smooth: [f64; 3]) -> [Tap; N] {
    let mut taps = [Tap { offset: [0.0; 3], share: [0.0; 3] }; N];
    let (mut place, mut found) = (0, 0);
    while place < 27 {
        let at = [place % 3, place / 3 % 3, place / 9];
        let (mut tap, mut a) = (Tap { offset: [0.0; 3], share: [0.0; 3] }, 0);
        while a < 3 {
            tap.offset[a] = at[a] as f32 - 1.0;
            tap.share[a] = tap.offset[a] * (smooth[at[(a + 1) % 3]] * smooth[at[(a + 2) % 3]]) as f32;
            a += 1;
        }
        if tap.share[0] != 0.0 || tap.share[1] != 0.0 || tap.share[2] != 0.0 {
            taps[found] = tap;
            found += 1;
        }
        place += 1;
    }
    assert!(found == N, "taps left out");
    taps
}

impl Brick<'_> {
    /// Computes differences of codes across two voxels along each axis, at eight slot coordinates, given axis by axis.
    /// Places less than a voxel from the padded brick's faces are moved inwards. The middle's code replaces missing
    /// values.
    #[inline(always)]
    pub(crate) fn central_differences<C: Code, U: Unit>(&self, points: &[Packet; 3], middle: &Packet) -> [Packet; 3] {
        let (voxel, t) = self.voxels_around(points);
        // SAFETY: such are the returned voxels.
        let (differences, odd) = unsafe { self.shared_differences::<C>(&voxel, &t) };
        if C::INVALID && odd > 0.0 {
            return self.sampled_differences::<C, U, _>(&CENTRAL, points, middle);
        }
        differences
    }

    /// [`Brick::central_differences`] at the given voxels and fractions towards their upper neighbours. Also returns
    /// how many of the voxels read are no codes, if voxels may have no value; if any are, the differences are useless.
    ///
    /// # Safety
    /// Every index is that of a voxel with a lower neighbour and two upper ones along each axis.
    #[inline(always)]
    unsafe fn shared_differences<C: Code>(&self, voxel: &[i32; LANES], t: &[Packet; 3]) -> ([Packet; 3], f32) {
        let (row, slice) = (self.padded() as isize, (self.padded() * self.padded()) as isize);
        // By z, then by y: the four lines through the eight voxels around each place.
        let (mut line, mut along) = ([[[0.0; LANES]; 2]; 2], [[[0.0; LANES]; 2]; 2]);
        // Those before and behind them along y, by z and side; and along z, by side and y.
        let (mut beside_y, mut beside_z) = ([[[0.0; LANES]; 2]; 2], [[[0.0; LANES]; 2]; 2]);
        let mut odd = [0.0; LANES];
        for k in 0..2 {
            for y in 0..2 {
                let at = k as isize * slice + y as isize * row;
                // SAFETY: by the caller's promise these voxels and their neighbours are inside the brick.
                unsafe {
                    self.line_and_difference::<C>(voxel, at, &t[0], [&mut line[k][y], &mut along[k][y]], &mut odd);
                };
            }
            for side in 0..2 {
                let far = 3 * side as isize - 1;
                let [at_y, at_z] = [k as isize * slice + far * row, far * slice + k as isize * row];
                // SAFETY: the same.
                unsafe {
                    self.line::<C>(voxel, at_y, &t[0], &mut beside_y[k][side], &mut odd);
                    self.line::<C>(voxel, at_z, &t[0], &mut beside_z[side][k], &mut odd);
                }
            }
        }
        let mut differences = [[0.0; LANES]; 3];
        let [mut near, mut far] = [[0.0; LANES]; 2];
        for i in 0..LANES {
            near[i] = mix(along[0][0][i], along[0][1][i], t[1][i]);
            far[i] = mix(along[1][0][i], along[1][1][i], t[1][i]);
        }
        differences[0] = mix_packets(&near, &far, &t[2]);
        for i in 0..LANES {
            near[i] = mix(line[0][1][i] - beside_y[0][0][i], beside_y[0][1][i] - line[0][0][i], t[1][i]);
            far[i] = mix(line[1][1][i] - beside_y[1][0][i], beside_y[1][1][i] - line[1][0][i], t[1][i]);
        }
        differences[1] = mix_packets(&near, &far, &t[2]);
        for i in 0..LANES {
            near[i] = mix(line[1][0][i] - beside_z[0][0][i], line[1][1][i] - beside_z[0][1][i], t[1][i]);
            far[i] = mix(beside_z[1][0][i] - line[0][0][i], beside_z[1][1][i] - line[0][1][i], t[1][i]);
        }
        differences[2] = mix_packets(&near, &far, &t[2]);
        self.scale_to_codes::<C>(&mut differences);
        let mut sum = 0.0;
        for i in 0..LANES {
            sum += odd[i];
        }
        (differences, sum)
    }

    #[inline(always)]
    pub(crate) fn scale_to_codes<C: Code>(&self, differences: &mut [Packet; 3]) {
        if C::IS_FLOAT {
            for axis in differences {
                for i in 0..LANES {
                    axis[i] *= self.map.per_number;
                }
            }
        }
    }

    /// The numbers, interpolated along x, on the line `at` voxels from the given ones.
    ///
    /// # Safety
    /// The voxels there and their upper neighbours are inside the brick.
    #[inline(always)]
    unsafe fn line<C: Code>(&self, voxel: &[i32; LANES], at: isize, t: &Packet, mixed: &mut Packet, odd: &mut Packet) {
        let [mut near, mut far] = [[0.0; LANES]; 2];
        // SAFETY: the caller's promise.
        unsafe { self.pairs::<C>(voxel, at, [&mut near, &mut far], odd) };
        for i in 0..LANES {
            mixed[i] = mix(near[i], far[i], t[i]);
        }
    }

    /// The numbers of [`Brick::line`], and their differences along x.
    ///
    /// # Safety
    /// The voxels there have a lower neighbour and two upper ones inside the brick.
    #[inline(always)]
    unsafe fn line_and_difference<C: Code>(
        &self,
        voxel: &[i32; LANES],
        at: isize,
        t: &Packet,
        [mixed, differences]: [&mut Packet; 2],
        odd: &mut Packet,
    ) {
        let [mut a, mut b, mut c, mut d] = [[0.0; LANES]; 4];
        // SAFETY: the caller's promise.
        unsafe {
            self.pairs::<C>(voxel, at - 1, [&mut a, &mut b], odd);
            self.pairs::<C>(voxel, at + 1, [&mut c, &mut d], odd);
        }
        for i in 0..LANES {
            mixed[i] = mix(b[i], c[i], t[i]);
            differences[i] = mix(c[i] - a[i], d[i] - b[i], t[i]);
        }
    }

    /// The numbers of the voxels at offset `at` from the given ones, and of their upper neighbours. `odd` counts
    /// those that are no codes, if voxels may have no value.
    ///
    /// # Safety
    /// All these voxels are inside the brick.
    #[inline(always)]
    pub(crate) unsafe fn pairs<C: Code>(
        &self,
        voxel: &[i32; LANES],
        at: isize,
        [near, far]: [&mut Packet; 2],
        odd: &mut Packet,
    ) {
        let (first, map) = (self.codes.as_ptr(), &self.map);
        let mut pair = [C::Pair::default(); LANES];
        for i in 0..LANES {
            // SAFETY: the caller's promise; the brick's length was checked on creation.
            pair[i] = unsafe { C::pair(first.offset((voxel[i] as isize + at) * C::BYTES as isize)) };
        }
        for i in 0..LANES {
            let (a, has_a) = C::part(C::near(pair[i]), map);
            let (b, has_b) = C::part(C::far(pair[i]), map);
            (near[i], far[i]) = (a, b);
            if C::INVALID {
                let is_near = !C::IS_FLOAT | ((a.abs() < map.farthest) & (b.abs() < map.farthest));
                odd[i] += if has_a & has_b & is_near { 0.0 } else { 1.0 };
            }
        }
    }

    /// The differences by a sample of each tap of an operator. Not inlined: it is large and rarely needed.
    #[inline(always)]
    pub(crate) fn sampled_differences<C: Code, U: Unit, const N: usize>(
        &self,
        taps: &[Tap; N],
        points: &[Packet; 3],
        middle: &Packet,
    ) -> [Packet; 3] {
        U::call(
            (points, middle),
            #[inline(always)]
            move |(points, middle)| {
                let mut differences = [[0.0; LANES]; 3];
                for Tap { offset, share } in taps {
                    let (mut places, mut weight) = (*points, [1.0; LANES]);
                    for a in 0..3 {
                        for i in 0..LANES {
                            places[a][i] += offset[a];
                        }
                    }
                    let codes = self.sample_points::<C, U>(&places, &mut weight);
                    for a in 0..3 {
                        for i in 0..LANES {
                            differences[a][i] += share[a] * if weight[i] > 0.0 { codes[i] } else { middle[i] };
                        }
                    }
                }
                differences
            },
        )
    }
}

impl March<'_> {
    /// Computes the differences of the frame's operator across two voxels along each axis, at eight slot coordinates
    /// with these codes. Also returns the codes whose rounding affects them: none for stored gradients.
    #[inline(always)]
    pub(crate) fn differences<C: Code, U: Unit>(&self, points: &[Packet; 3], code: &Packet) -> ([Packet; 3], Packet) {
        match self.frame.settings.lighting.gradient {
            Gradient::Central => (self.brick.central_differences::<C, U>(points, code), *code),
            Gradient::Sobel => (self.brick.sobel_differences::<C, U>(points, code), *code),
            Gradient::Stored => {
                let stored = Gradients::new(self.cell.brick.gradients(), self.frame.gradients, self.frame.apron);
                (stored.packet::<U>(points, self.frame.gradient_scale), [0.0; LANES])
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sample::{Code8, Code16, CodeMap, Float32};
    use crate::unit::Portable;
    use brickyard_volume::slot_encoding::INVALID_SLOT;

    const PADDED: usize = 7;

    fn both_ways<C: Code>(
        brick: &Brick<'_>,
        is_sobel: bool,
        points: &[Packet; 3],
        middle: &Packet,
    ) -> [[Packet; 3]; 2] {
        if is_sobel {
            let expected = brick.sampled_differences::<C, Portable, _>(&SOBEL, points, middle);
            [brick.sobel_differences::<C, Portable>(points, middle), expected]
        } else {
            let expected = brick.sampled_differences::<C, Portable, _>(&CENTRAL, points, middle);
            [brick.central_differences::<C, Portable>(points, middle), expected]
        }
    }

    /// Compares differences from shared voxels and from samples, of noise, all over a brick.
    fn both<C: Code>() {
        let map = CodeMap { first: 0.0, per_number: 1.0, farthest: f32::MAX };
        let mut state = 7u32;
        let mut noise = || {
            state = state.wrapping_mul(1664525).wrapping_add(1013904223);
            state >> 16
        };
        // No code is 0, which would mean no value.
        let codes: Vec<u8> = (0..PADDED.pow(3) * C::BYTES).map(|_| 1 + (noise() % 255) as u8).collect();
        let brick = Brick::new::<C>(&codes, PADDED as u32, map);
        let mut worst = 0.0f32;
        for _ in 0..500 {
            let mut points = [[0.0; LANES]; 3];
            points.as_flattened_mut().iter_mut().for_each(|v| *v = 1.0 + noise() as f32 / 65535.0 * 3.99);
            for is_sobel in [false, true] {
                let [found, expected] = both_ways::<C>(&brick, is_sobel, &points, &[0.0; LANES]);
                for (found, expected) in found.as_flattened().iter().zip(expected.as_flattened()) {
                    worst = worst.max((found - expected).abs());
                }
            }
        }
        // Samples of bytes have weights of 15 bits: each is off by at most 2^-8 of a code.
        let rounding = if C::BYTES == 1 { 2.0 / 256.0 } else { 1e-7 * 65535.0 * 8.0 };
        assert!(worst < rounding, "{worst}");
    }

    #[test]
    fn shared_voxels_give_the_differences_of_samples() {
        both::<Code8<false>>();
        both::<Code8<true>>();
        both::<Code16<false>>();
        both::<Code16<true>>();
    }

    #[test]
    fn voxels_without_a_value_are_left_out_as_by_samples() {
        let map = CodeMap { first: 1e6, per_number: 64.0, farthest: 900.0 };
        let mut state = 9u32;
        let mut noise = || {
            state = state.wrapping_mul(1664525).wrapping_add(1013904223);
            state >> 16
        };
        let mut different = [0; 2];
        // From no voxel without a value to many of them; the second kind is too far off to be a code.
        for share in 0..100 {
            let mut number = || match noise() % 1000 {
                odd if odd < share => [INVALID_SLOT, 1e9][(odd % 2) as usize],
                _ => 1e6 + (noise() % 800) as f32,
            };
            let numbers: Vec<u8> = (0..PADDED.pow(3)).flat_map(|_| number().to_le_bytes()).collect();
            let brick = Brick::new::<Float32>(&numbers, PADDED as u32, map);
            let mut points = [[0.0; LANES]; 3];
            points.as_flattened_mut().iter_mut().for_each(|v| *v = 1.0 + noise() as f32 / 65535.0 * 3.99);
            for (is_sobel, different) in [false, true].into_iter().zip(&mut different) {
                let [found, expected] = both_ways::<Float32>(&brick, is_sobel, &points, &[100.0; LANES]);
                *different += (found != expected) as u32;
                for (found, expected) in found.as_flattened().iter().zip(expected.as_flattened()) {
                    // Numbers of up to 800 are interpolated to within 2^-14 of one, and are 64 codes each.
                    assert!(
                        (found - expected).abs() < 64.0 * 8.0 * 800.0 * f32::EPSILON,
                        "{share}: {found} {expected}"
                    );
                }
            }
        }
        assert!(different.iter().all(|count| (1..50).contains(count)), "voxels were shared in {different:?} of 100");
    }

    #[test]
    fn places_outside_are_moved_in() {
        let map = CodeMap { first: 0.0, per_number: 1.0, farthest: f32::MAX };
        let codes: Vec<u8> = (0..PADDED.pow(3)).map(|i| (i % PADDED * 9 + i / PADDED % PADDED * 4) as u8).collect();
        let brick = Brick::new::<Code8<false>>(&codes, PADDED as u32, map);
        let far = [-1e9, f32::NAN, 0.0, 0.5, 6.0, 1e9, f32::INFINITY, f32::NEG_INFINITY];
        let rounding = 1e-3;
        for is_sobel in [false, true] {
            let [found, _] = both_ways::<Code8<false>>(&brick, is_sobel, &[far; 3], &[0.0; LANES]);
            for (found, expected) in found.iter().zip([18.0, 8.0, 0.0]) {
                assert!(found.iter().all(|v| (v - expected).abs() < rounding), "{found:?}");
            }
        }
    }
}
