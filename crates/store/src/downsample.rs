//! The downsampling kernels: 1 or 2 voxels per axis of a finer level become one.
//!
//! Integer means are exact sums in the next wider type, rounded to nearest with ties to even, so no bias builds up over
//! levels. Floats average the finite voxels in f64; with none, the result is NaN. Odd extents average the existing
//! voxels: callers replicate the last voxel, which preserves every mean, extreme and mode.
//!
//! Loops run over whole rows with plain arithmetic, so the compiler vectorises them for the caller's target features;
//! everything is `#[inline(always)]` for that reason. Mean of 64^3 u8: about 10 us with AVX2.

use crate::kind::Kind;
use brickyard_volume::Voxel;
use serde::{Deserialize, Serialize};

/// Reduction of the finer voxels in a box to a coarse voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Downsample {
    /// The arithmetic mean, for images.
    Mean,
    /// The greatest value: maximum projections stay exact at every level.
    Max,
    /// The least value.
    Min,
    /// The most frequent value, the least in a tie; for labels.
    Mode,
    /// The voxel at the lowest x, y and z, or the first valid one in that order, x fastest.
    Nearest,
}

impl Downsample {
    /// All downsampling methods.
    pub const ALL: [Self; 5] = [Self::Mean, Self::Max, Self::Min, Self::Mode, Self::Nearest];

    /// The method's name on the command line and in metadata.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Mean => "mean",
            Self::Max => "max",
            Self::Min => "min",
            Self::Mode => "mode",
            Self::Nearest => "nearest",
        }
    }
}

impl std::str::FromStr for Downsample {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        let known = || Self::ALL.map(Self::name).join(", ");
        Self::ALL
            .into_iter()
            .find(|d| d.name() == s)
            .ok_or_else(|| format!("unknown downsampling '{s}': expected one of {}", known()))
    }
}

/// One method for a store's coarser levels, or two (`mean,max`) for two pyramids that share level 0. The second costs a
/// pack an eighth more disk and a quarter more time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Reductions {
    main: Downsample,
    second: Option<Downsample>,
}

impl Reductions {
    /// The default for a kind: means and maxima for images, the most frequent value for labels.
    pub const fn default_for(kind: Kind) -> Self {
        match kind {
            Kind::Image => Self { main: Downsample::Mean, second: Some(Downsample::Max) },
            Kind::Labels => Self { main: Downsample::Mode, second: None },
        }
    }

    /// The method of the main pyramid, visible to every Zarr reader.
    pub const fn main(self) -> Downsample {
        self.main
    }

    /// The method of the second pyramid; `None` if there is only one pyramid.
    pub const fn second(self) -> Option<Downsample> {
        self.second
    }
}

impl From<Downsample> for Reductions {
    fn from(main: Downsample) -> Self {
        Self { main, second: None }
    }
}

impl std::str::FromStr for Reductions {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        let Some((main, second)) = s.split_once(',') else { return Ok(s.parse::<Downsample>()?.into()) };
        let (main, second) = (main.parse()?, second.parse()?);
        if main == second {
            return Err(format!(
                "'{s}' names one downsampling twice: expected one, or two different ones, e.g. mean,max"
            ));
        }
        Ok(Self { main, second: Some(second) })
    }
}

impl std::fmt::Display for Reductions {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.main.name())?;
        self.second.map_or(Ok(()), |second| write!(f, ",{}", second.name()))
    }
}

impl TryFrom<String> for Reductions {
    type Error = String;
    fn try_from(s: String) -> Result<Self, String> {
        s.parse()
    }
}

impl From<Reductions> for String {
    fn from(reductions: Reductions) -> String {
        reductions.to_string()
    }
}

/// A voxel type's arithmetic for [`downsample`].
pub(crate) trait Reduce: Voxel + Default {
    type Sum: Copy + Default;
    fn add(sum: Self::Sum, value: Self) -> Self::Sum;
    fn join(a: Self::Sum, b: Self::Sum) -> Self::Sum;
    /// The mean of `2^log2_count` voxels, given their sum.
    fn mean(sum: Self::Sum, log2_count: u32) -> Self;
    /// The greater voxel, or the only valid one.
    fn greater(a: Self, b: Self) -> Self;
    /// The lesser voxel, or the only valid one.
    fn lesser(a: Self, b: Self) -> Self;
}

macro_rules! integer_reduce {
    ($($t:ty => $sum:ty),*) => {$(
        impl Reduce for $t {
            type Sum = $sum;
            #[inline(always)]
            fn add(sum: $sum, value: Self) -> $sum { sum + value as $sum }
            #[inline(always)]
            fn join(a: $sum, b: $sum) -> $sum { a + b }
            #[inline(always)]
            fn mean(sum: $sum, log2_count: u32) -> Self {
                if log2_count == 0 {
                    return sum as Self;
                }
                // With q = floor(sum / n) and remainder r: q + 1 if r > n/2, or if r = n/2 and q is odd.
                let half_less_one = (1 << (log2_count - 1)) - 1;
                let odd = (sum >> log2_count) & 1;
                ((sum + half_less_one + odd) >> log2_count) as Self
            }
            #[inline(always)]
            fn greater(a: Self, b: Self) -> Self { a.max(b) }
            #[inline(always)]
            fn lesser(a: Self, b: Self) -> Self { a.min(b) }
        }
    )*};
}
integer_reduce!(u8 => u16, i8 => i16, u16 => u32, i16 => i32, u32 => u64, i32 => i64);

impl Reduce for f32 {
    /// Sum and count of the finite voxels.
    type Sum = (f64, f32);
    #[inline(always)]
    fn add((sum, count): (f64, f32), value: f32) -> (f64, f32) {
        let valid = value.is_finite();
        (sum + if valid { value as f64 } else { 0.0 }, count + if valid { 1.0 } else { 0.0 })
    }
    #[inline(always)]
    fn join(a: (f64, f32), b: (f64, f32)) -> (f64, f32) {
        (a.0 + b.0, a.1 + b.1)
    }
    /// The mean of the finite voxels, or one fixed NaN, so stores are independent of the processor.
    #[inline(always)]
    fn mean((sum, count): (f64, f32), _: u32) -> f32 {
        if count > 0.0 { (sum / count as f64) as f32 } else { f32::NAN }
    }
    #[inline(always)]
    fn greater(a: f32, b: f32) -> f32 {
        pick(a, b, a > b)
    }
    #[inline(always)]
    fn lesser(a: f32, b: f32) -> f32 {
        pick(a, b, a < b)
    }
}

/// `a` if it wins, but never a non-finite voxel over a finite one; NaN if neither is finite.
#[inline(always)]
fn pick(a: f32, b: f32, a_wins: bool) -> f32 {
    match (a.is_finite(), b.is_finite()) {
        (true, true) if a_wins => a,
        (true, false) => a,
        (_, true) => b,
        (false, false) => f32::NAN,
    }
}

/// The most voxels in a row of a brick.
pub(crate) const MAX_EDGE: usize = 256;

/// A reduction of the first `shape` voxels of an `edge`^3 brick, by `factor` along each axis: 1 or 2, a divisor of the
/// shape's.
#[derive(Clone, Copy)]
pub(crate) struct Reduction {
    pub(crate) method: Downsample,
    pub(crate) edge: usize,
    pub(crate) shape: [usize; 3],
    pub(crate) factor: [usize; 3],
}

/// Fills `out` (`shape / factor` voxels, packed, x fastest) from the brick `core`.
#[inline(always)]
pub(crate) fn downsample<T: Reduce>(reduction: Reduction, core: &[T], out: &mut [T]) {
    if reduction.factor[0] == 2 {
        by_rows::<T, 2>(reduction, core, out);
    } else {
        by_rows::<T, 1>(reduction, core, out);
    }
}

#[inline(always)]
fn by_rows<T: Reduce, const FX: usize>(reduction: Reduction, core: &[T], out: &mut [T]) {
    let Reduction { method, edge, shape, factor } = reduction;
    debug_assert!(edge <= MAX_EDGE && (0..3).all(|a| shape[a].is_multiple_of(factor[a])));
    let ([nx, ny, nz], [_, fy, fz]) = (shape, factor);
    let mut out_rows = out.chunks_exact_mut(nx / FX);
    for z in (0..nz).step_by(fz) {
        for y in (0..ny).step_by(fy) {
            let row = |i: usize| {
                let start = ((z + i / fy) * edge + y + i % fy) * edge;
                &core[start..start + nx]
            };
            let Some(out) = out_rows.next() else { return };
            match method {
                Downsample::Mean => mean_row::<T, FX>(row, fy * fz, out),
                Downsample::Max => extreme_row::<T, FX>(row, fy * fz, out, T::greater),
                Downsample::Min => extreme_row::<T, FX>(row, fy * fz, out, T::lesser),
                Downsample::Mode => mode_row::<T, FX>(row, fy * fz, out),
                Downsample::Nearest => nearest_row::<T, FX>(row, fy * fz, out),
            }
        }
    }
}

#[inline(always)]
fn mean_row<'a, T: Reduce, const FX: usize>(row: impl Fn(usize) -> &'a [T], rows: usize, out: &mut [T]) {
    let mut sums = [T::Sum::default(); MAX_EDGE];
    let sums = &mut sums[..out.len() * FX];
    for i in 0..rows {
        for (sum, &value) in sums.iter_mut().zip(row(i)) {
            *sum = T::add(*sum, value);
        }
    }
    let log2_count = (rows * FX).trailing_zeros();
    for (out, sums) in out.iter_mut().zip(sums.chunks_exact(FX)) {
        let sum = if FX == 2 { T::join(sums[0], sums[1]) } else { sums[0] };
        *out = T::mean(sum, log2_count);
    }
}

#[inline(always)]
fn extreme_row<'a, T: Reduce, const FX: usize>(
    row: impl Fn(usize) -> &'a [T],
    rows: usize,
    out: &mut [T],
    better: impl Fn(T, T) -> T,
) {
    let mut best = [T::default(); MAX_EDGE];
    let best = &mut best[..out.len() * FX];
    best.copy_from_slice(row(0));
    for i in 1..rows {
        for (best, &value) in best.iter_mut().zip(row(i)) {
            *best = better(*best, value);
        }
    }
    for (out, best) in out.iter_mut().zip(best.chunks_exact(FX)) {
        // A lone infinity must become NaN even with one row of one voxel: `better` of it with itself.
        *out = better(best[0], best[FX - 1]);
    }
}

#[inline(always)]
fn nearest_row<'a, T: Reduce, const FX: usize>(row: impl Fn(usize) -> &'a [T], rows: usize, out: &mut [T]) {
    for (x, (out, first)) in out.iter_mut().zip(row(0).chunks_exact(FX)).enumerate() {
        let valid = |i: usize| row(i)[x * FX..(x + 1) * FX].iter().copied().find(|v| v.is_valid());
        *out = if first[0].is_valid() {
            first[0]
        } else {
            (0..rows).find_map(valid).unwrap_or(T::greater(first[0], first[0]))
        };
    }
}

#[inline(always)]
fn mode_row<'a, T: Reduce, const FX: usize>(row: impl Fn(usize) -> &'a [T], rows: usize, out: &mut [T]) {
    for (x, out) in out.iter_mut().enumerate() {
        let mut values = [T::default(); 8];
        for i in 0..rows {
            values[i * FX..(i + 1) * FX].copy_from_slice(&row(i)[x * FX..(x + 1) * FX]);
        }
        *out = mode(&values[..rows * FX]);
    }
}

/// The most frequent valid voxel, the least in a tie; without any, two invalid ones combined: NaN.
pub(crate) fn mode<T: Reduce>(values: &[T]) -> T {
    if values.iter().all(|v| *v == values[0]) && values[0].is_valid() {
        return values[0];
    }
    let mut best: Option<(usize, T)> = None;
    for &value in values.iter().filter(|v| v.is_valid()) {
        let count = values.iter().filter(|v| **v == value).count();
        if best.is_none_or(|(most, least)| count > most || count == most && value < least) {
            best = Some((count, value));
        }
    }
    best.map_or(T::greater(values[0], values[0]), |(_, value)| value)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn run<T: Reduce>(method: Downsample, core: &[T], shape: [usize; 3], factor: [usize; 3]) -> Vec<T> {
        let mut out = vec![T::default(); (0..3).map(|a| shape[a] / factor[a]).product()];
        downsample(Reduction { method, edge: 4, shape, factor }, core, &mut out);
        out
    }

    /// One 2x2x2 box at the origin of a 4^3 brick.
    fn cube<T: Reduce>(values: [T; 8]) -> Vec<T> {
        let mut core = vec![T::default(); 64];
        for (i, v) in values.into_iter().enumerate() {
            core[(i >> 2) * 16 + (i >> 1 & 1) * 4 + (i & 1)] = v;
        }
        core
    }

    fn one<T: Reduce>(method: Downsample, values: [T; 8]) -> T {
        run(method, &cube(values), [2; 3], [2; 3])[0]
    }

    #[test]
    fn means_round_to_nearest_ties_to_even() {
        // Every sum of eight 8-bit voxels prone to wrong rounding, against f64.
        for sum in 0..=2040u32 {
            let base = (sum / 8) as u8;
            let values = std::array::from_fn(|i| base + (i < (sum % 8) as usize) as u8);
            assert_eq!(one(Downsample::Mean, values), (sum as f64 / 8.0).round_ties_even() as u8, "{sum}");
        }
        for sum in -1024..=1016i32 {
            let base = sum.div_euclid(8) as i8;
            let values = std::array::from_fn(|i| base + (i < sum.rem_euclid(8) as usize) as i8);
            assert_eq!(one(Downsample::Mean, values), (sum as f64 / 8.0).round_ties_even() as i8, "{sum}");
        }
        assert_eq!(one(Downsample::Mean, [u32::MAX; 8]), u32::MAX);
        assert_eq!(one(Downsample::Mean, [i32::MIN; 8]), i32::MIN);
    }

    #[test]
    fn factors_of_one_keep_their_axis() {
        let core: Vec<u8> = (0..64).collect();
        assert_eq!(run(Downsample::Mean, &core, [4, 2, 1], [1, 2, 1]), [2, 3, 4, 5]);
        assert_eq!(run(Downsample::Max, &core, [2, 1, 2], [1, 1, 2]), [16, 17]);
        assert_eq!(run(Downsample::Nearest, &core, [4, 4, 2], [2, 2, 2]), [0, 2, 8, 10]);
    }

    #[test]
    fn floats_use_what_is_finite() {
        let (nan, inf) = (f32::NAN, f32::INFINITY);
        let mixed = [1.0, nan, 2.0, inf, 6.0, -inf, nan, nan];
        assert_eq!(one(Downsample::Mean, mixed), 3.0);
        assert_eq!(one(Downsample::Max, mixed), 6.0);
        assert_eq!(one(Downsample::Min, mixed), 1.0);
        assert_eq!(one(Downsample::Mode, mixed), 1.0);
        assert_eq!(one(Downsample::Nearest, [nan, inf, nan, 5.0, 6.0, 1.0, nan, 2.0]), 5.0);
        for method in Downsample::ALL {
            assert!(one(method, [inf, nan, inf, -inf, nan, nan, inf, inf]).is_nan(), "{method:?}");
        }
    }

    #[test]
    fn one_method_or_two_that_differ() {
        for good in ["mean", "mean,max", "min,nearest"] {
            let reductions: Reductions = good.parse().unwrap();
            assert_eq!(reductions.to_string(), good);
            assert_eq!(serde_json::from_value::<Reductions>(serde_json::json!(good)).unwrap(), reductions);
        }
        let two: Reductions = "mean,max".parse().unwrap();
        assert_eq!((two.main(), two.second()), (Downsample::Mean, Some(Downsample::Max)));
        for bad in ["", "average", "mean,", "mean,mean", "mean,max,min", "mean, max"] {
            let error = bad.parse::<Reductions>().unwrap_err();
            assert!(error.contains("expected one"), "{bad}: {error}");
        }
    }

    #[test]
    fn mode_takes_the_most_frequent_then_the_least() {
        assert_eq!(one(Downsample::Mode, [7u16, 3, 3, 7, 9, 9, 9, 1]), 9);
        assert_eq!(one(Downsample::Mode, [7u16, 3, 3, 7, 9, 9, 1, 1]), 1);
    }
}
