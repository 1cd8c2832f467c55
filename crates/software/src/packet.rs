//! The numbers of samples taken at a time, and arithmetic on as many.

/// Samples in a packet.
pub(crate) const LANES: usize = 8;

/// Packets in a chunk.
pub(crate) const PACKETS: usize = 4;

/// Samples in a chunk.
pub(crate) const CHUNK: usize = LANES * PACKETS;

/// One number per sample of a packet.
pub(crate) type Packet = [f32; LANES];

/// The points `origin + along * step`, axis by axis.
#[inline(always)]
pub(crate) fn points(origin: [f32; 3], step: [f32; 3], along: &Packet) -> [Packet; 3] {
    let mut points = [[0.0; LANES]; 3];
    for a in 0..3 {
        for i in 0..LANES {
            points[a][i] = origin[a] + along[i] * step[a];
        }
    }
    points
}

/// Adding and subtracting it rounds to a whole number, which is then also in its low bits.
const ROUND: f32 = 12_582_912.0;

/// Logarithms to base 2 of positive numbers; useless for others. The next term of the series would be 2e-8.
#[inline(always)]
pub(crate) fn log2<const N: usize>(x: &[f32; N]) -> [f32; N] {
    use std::f32::consts::{LOG2_E, SQRT_2};
    const HALF_ROOT: i32 = (SQRT_2 * 0.5).to_bits() as i32;
    let mut log2 = [0.0; N];
    for i in 0..N {
        // x = 2^e * m with m in [sqrt(1/2), sqrt(2)); log2 m = 2 / ln 2 * atanh(s), |s| < 0.172.
        let bits = x[i].to_bits() as i32;
        let e = (bits - HALF_ROOT) >> 23;
        let m = f32::from_bits((bits - (e << 23)) as u32);
        let s = (m - 1.0) / (m + 1.0);
        let s2 = s * s;
        let series = (1.0 + s2 * (1.0 / 3.0)) + (s2 * s2) * (0.2 + s2 * (1.0 / 7.0));
        log2[i] = e as f32 + (2.0 * LOG2_E * s) * series;
    }
    log2
}

/// 2 to the power of each number, for finite powers; exactly 1 for 0, and 2^-126 for numbers below -126. The next term
/// of the series would be 1e-7.
#[inline(always)]
pub(crate) fn exp2<const N: usize>(y: &[f32; N]) -> [f32; N] {
    let mut powers = [0.0; N];
    for i in 0..N {
        // 2^y = 2^n * e^f with |f| < 0.347.
        let y = if y[i] > -126.0 { y[i] } else { -126.0 };
        let n = y + ROUND;
        let f = (y - (n - ROUND)) * std::f32::consts::LN_2;
        let f2 = f * f;
        let power =
            (1.0 + f) + f2 * ((0.5 + f * (1.0 / 6.0)) + f2 * ((1.0 / 24.0 + f * (1.0 / 120.0)) + f2 * (1.0 / 720.0)));
        let n = (n.to_bits() as i32) - (ROUND.to_bits() as i32);
        powers[i] = f32::from_bits((power.to_bits() as i32 + (n << 23)) as u32);
    }
    powers
}
