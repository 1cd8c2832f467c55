//! Voxels with a store's integer for *no data*: left out of levels, ranges and statistics, like NaN among floats.
//!
//! Other kernels keep their speed: this code works on the voxels in between, or box by box, and only in bricks with
//! no-data voxels.

use crate::downsample::{Downsample, Reduce, Reduction, mode};
use crate::stats::{Counter, Measure, Range, Tally};

/// Whether any voxel is `nodata`. Tests whole rows, which the compiler vectorises.
#[inline(always)]
pub(crate) fn is_in<T: PartialEq + Copy>(voxels: &[T], nodata: T) -> bool {
    voxels.chunks(1024).any(|row| row.iter().fold(false, |found, &v| found | (v == nodata)))
}

/// The range of the valid voxels other than `nodata`.
pub(crate) fn range<T: Measure>(voxels: &[T], nodata: Option<T>) -> Range<T> {
    let Some(nodata) = nodata else { return T::range(voxels) };
    voxels.split(|&v| v == nodata).fold(T::EMPTY, |range, part| range.join(T::range(part)))
}

/// Counts and sums the voxels other than `nodata`, and tallies the `nodata` ones.
#[inline(always)]
pub(crate) fn count<T: Measure>(voxels: &[T], nodata: Option<T>, counter: &mut Counter, tally: &mut Tally) {
    match nodata {
        Some(nodata) => count_others(voxels, nodata, counter, tally),
        None => {
            T::count(voxels, counter);
            T::tally(voxels, tally);
        }
    }
}

/// Like [`count`], with a value. A separate function, since it slows down the loop for bricks without such voxels.
#[inline(never)]
fn count_others<T: Measure>(voxels: &[T], nodata: T, counter: &mut Counter, tally: &mut Tally) {
    let mut rest = voxels.len();
    for part in voxels.split(|&v| v == nodata).filter(|part| !part.is_empty()) {
        T::count(part, counter);
        T::tally(part, tally);
        rest -= part.len();
    }
    tally.nodata += rest as u64;
}

/// Like [`downsample`](crate::downsample::downsample), but skips `nodata` voxels: a coarse voxel is `nodata` only if
/// all of its finer ones are.
pub(crate) fn downsample<T: Reduce>(reduction: Reduction, core: &[T], nodata: T, out: &mut [T]) {
    let Reduction { method, edge, shape, factor } = reduction;
    let mut out = out.iter_mut();
    for z in (0..shape[2]).step_by(factor[2]) {
        for y in (0..shape[1]).step_by(factor[1]) {
            for x in (0..shape[0]).step_by(factor[0]) {
                let (mut valid, mut count) = ([T::default(); 8], 0);
                for row in 0..factor[1] * factor[2] {
                    let start = ((z + row / factor[1]) * edge + y + row % factor[1]) * edge + x;
                    for &voxel in &core[start..start + factor[0]] {
                        valid[count] = voxel;
                        count += (voxel != nodata) as usize;
                    }
                }
                let Some(out) = out.next() else { return };
                *out = reduced(method, &valid[..count], nodata);
            }
        }
    }
}

/// One coarse voxel from the finer ones with data; `nodata` if there are none.
#[inline(always)]
fn reduced<T: Reduce>(method: Downsample, valid: &[T], nodata: T) -> T {
    let Some((&first, rest)) = valid.split_first() else { return nodata };
    match method {
        Downsample::Mean => mean(valid, nodata),
        Downsample::Max => rest.iter().fold(first, |a, &b| T::greater(a, b)),
        Downsample::Min => rest.iter().fold(first, |a, &b| T::lesser(a, b)),
        Downsample::Mode => mode(valid),
        Downsample::Nearest => first,
    }
}

/// The mean, rounded to nearest with ties to even. If that is `nodata` despite data, the adjacent whole number on the
/// mean's side, or above if the mean equals it.
#[inline(always)]
fn mean<T: Reduce>(valid: &[T], nodata: T) -> T {
    // At most eight integers of 32 bits: the sum is exact, and the quotient's error is far below the distance of any
    // two means.
    let mean = valid.iter().map(|v| v.to_f64()).sum::<f64>() / valid.len() as f64;
    let rounded = T::from_f64_rounded(mean);
    if rounded != nodata {
        return rounded;
    }
    // Some valid voxel lies on that side of `nodata`, so the type has a number there.
    T::from_f64_rounded(nodata.to_f64() + if mean >= nodata.to_f64() { 1.0 } else { -1.0 })
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::Voxel;
    use proptest::prelude::*;

    fn one<T: Reduce>(method: Downsample, voxels: [T; 8], nodata: T) -> T {
        let mut out = [T::default()];
        let reduction = Reduction { method, edge: 2, shape: [2; 3], factor: [2; 3] };
        downsample(reduction, &voxels, nodata, &mut out);
        out[0]
    }

    #[test]
    fn a_coarse_voxel_is_nodata_only_if_all_finer_ones_are() {
        for method in Downsample::ALL {
            assert_eq!(one(method, [-2000i16; 8], -2000), -2000, "{method:?}");
            let mut voxels = [-2000i16; 8];
            voxels[6] = 31;
            assert_eq!(one(method, voxels, -2000), 31, "{method:?}");
        }
        let some = [9u8, 9, 4, 7, 9, 9, 4, 6];
        assert_eq!(Downsample::ALL.map(|method| one(method, some, 9)), [5, 7, 4, 4, 4]);
    }

    #[test]
    fn a_mean_is_never_nodata() {
        // The mean is on the value, just below it, and just above it; each end of the type has only one side.
        assert_eq!(one(Downsample::Mean, [-1i8, 1, 0, 0, 0, 0, 0, 0], 0), 1);
        assert_eq!(one(Downsample::Mean, [-2i8, 1, 1, -1, 0, 0, 0, 0], 0), -1);
        assert_eq!(one(Downsample::Mean, [2i8, -1, -1, 1, 0, 0, 0, 0], 0), 1);
        assert_eq!(one(Downsample::Mean, [254u8, 255, 255, 255, 255, 255, 255, 255], 255), 254);
        assert_eq!(one(Downsample::Mean, [i32::MIN, i32::MIN + 2, 0, 0, 0, 0, 0, 0], 0), i32::MIN + 1);
    }

    proptest! {
        #[test]
        fn without_such_voxels_kernels_agree(
            values in prop::collection::vec(any::<u32>(), 64), shape in prop::array::uniform3(1usize..=2),
            factor in prop::array::uniform3(1usize..=2),
        ) {
            fn check<T: Reduce + std::fmt::Debug>(core: &[T], nodata: T, shape: [usize; 3], factor: [usize; 3]) {
                let shape = std::array::from_fn(|a| shape[a] * factor[a]);
                for method in Downsample::ALL {
                    let mut found = vec![T::default(); (0..3).map(|a| shape[a] / factor[a]).product()];
                    let mut expected = found.clone();
                    let reduction = Reduction { method, edge: 4, shape, factor };
                    downsample(reduction, core, nodata, &mut found);
                    crate::downsample::downsample(reduction, core, &mut expected);
                    assert_eq!(found, expected, "{method:?}");
                }
            }
            // Values far enough below the greatest for no mean to reach it.
            check(&values.iter().map(|v| (v % 255) as u8).collect::<Vec<_>>(), 255, shape, factor);
            check(&values.iter().map(|v| (v % 65535) as i32 as i16 & 0x7ffe).collect::<Vec<_>>(), i16::MAX, shape, factor);
            check(&values.iter().map(|v| v >> 1).collect::<Vec<u32>>(), u32::MAX, shape, factor);
        }

        #[test]
        fn ranges_and_counts_leave_them_out(values in prop::collection::vec(-3i32..4, 0..40), nodata in -3i32..4) {
            let valid: Vec<i32> = values.iter().copied().filter(|v| *v != nodata).collect();
            prop_assert_eq!(range(&values, Some(nodata)), i32::range(&valid));
            prop_assert_eq!(is_in(&values, nodata), valid.len() < values.len());
            let (mut counter, mut tally) = (Counter::new(i32::TYPE), Tally::default());
            count(&values, Some(nodata), &mut counter, &mut tally);
            prop_assert_eq!(tally.nodata, (values.len() - valid.len()) as u64);
            prop_assert_eq!(tally.sum, valid.iter().sum::<i32>() as f64);
        }
    }
}
