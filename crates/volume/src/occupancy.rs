//! Occupancy: a brick's visible values in 64 bins, as one `u64`, so that "is this brick empty under this transfer
//! function?" is one AND.
//!
//! A mask is safe under interpolation: for every 2x2x2 neighbourhood of voxels within reach of a trilinear sample in the
//! brick (apron included), all bins between its least and greatest value are set. Bins 0 and 63 are open ended, so any
//! value has a bin.

use crate::transfer::TransferFunction;
use serde::{Deserialize, Serialize};

/// A brick's set of value bins: one bit for each of 64 bins.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub struct Occupancy(pub u64);

impl Occupancy {
    /// No bin: there is no valid voxel at all.
    pub const NONE: Self = Self(0);
    /// All bins, for unknown contents.
    pub const ALL: Self = Self(u64::MAX);

    /// The union of two sets.
    pub const fn union(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }

    /// All bins from `first` to `last` inclusive, where `first <= last < 64`.
    pub const fn span(first: u32, last: u32) -> Self {
        Self((u64::MAX >> (63 - (last - first))) << first)
    }

    /// Whether two sets have a bin in common.
    pub const fn meets(self, other: Self) -> bool {
        self.0 & other.0 != 0
    }
}

/// The map from values to the 64 bins: `bin(v) = clamp(floor((v - low) / width), 0, 63)`.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct OccupancyBins {
    /// Value at the lower edge of bin 0, in data units; lesser values are in bin 0, too.
    pub low: f64,
    /// Width of a bin in data units; positive.
    pub width: f64,
}

impl OccupancyBins {
    /// The number of bins.
    pub const COUNT: u32 = 64;

    /// Returns bins of equal width over `[low, high]`. The width is 1 where the range is empty or not finite.
    pub fn over(low: f64, high: f64) -> Self {
        let width = (high - low) / Self::COUNT as f64;
        Self { low, width: if width > 0.0 && width.is_finite() { width } else { 1.0 } }
    }

    /// The bin of a value, 0 to 63; the value must not be NaN.
    pub fn bin(&self, value: f64) -> u32 {
        ((value - self.low) / self.width).floor().clamp(0.0, 63.0) as u32
    }

    /// The bins of all values in `[low, high]`.
    pub fn mask(&self, low: f64, high: f64) -> Occupancy {
        Occupancy::span(self.bin(low), self.bin(high))
    }

    /// The bins with any opacity under the transfer function. `slack` (data units) widens every bin on both sides by the
    /// error of quantisation and table lookup.
    pub fn opaque(&self, transfer: &TransferFunction, slack: f64) -> Occupancy {
        let mut mask = 0;
        for bin in 0..Self::COUNT {
            let low = if bin == 0 { f64::NEG_INFINITY } else { self.low + bin as f64 * self.width - slack };
            let high = if bin == 63 { f64::INFINITY } else { self.low + (bin + 1) as f64 * self.width + slack };
            mask |= ((transfer.max_alpha(low, high) > 0.0) as u64) << bin;
        }
        Occupancy(mask)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transfer::{Region, Shape};
    use proptest::prelude::*;

    #[test]
    fn spans_reach_both_ends() {
        assert_eq!(Occupancy::span(0, 63), Occupancy::ALL);
        assert_eq!(Occupancy::span(63, 63).0, 1 << 63);
        assert_eq!(Occupancy::span(2, 4).0, 0b11100);
    }

    #[test]
    fn degenerate_ranges_have_bins() {
        let bins = OccupancyBins::over(7.0, 7.0);
        assert_eq!(bins.bin(7.0), 0);
        assert_eq!(bins.bin(f64::INFINITY), 63);
    }

    proptest! {
        /// Culling relies on this: a value with opacity is in an opaque bin.
        #[test]
        fn no_opaque_value_is_in_an_empty_bin(
            knots in prop::collection::vec((0.0f64..100.0, prop::sample::select(vec![0.0, 0.0, 0.3, 1.0])), 1..6),
            low in -20.0f64..50.0, range in 0.1f64..120.0, value in -50.0f64..150.0,
            factor in prop::sample::select(vec![0.0, 0.5]), side in 0.0f64..100.0, gradient in 0.0f64..9.0,
        ) {
            let mut knots = knots;
            knots.sort_by(|a, b| a.0.total_cmp(&b.0));
            let opacity = knots.iter().map(|&(v, a)| [v, a]).collect();
            let region = Region { shape: Shape::Rectangle, value: [side, side + 5.0], gradient: [2.0, 6.0], color: [1.0; 3], opacity: 0.5 };
            let of_values = TransferFunction { opacity, ..TransferFunction::default() };
            let factors = vec![[0.0, factor], [5.0, 0.0]];
            let of_both = TransferFunction { gradient_opacity: factors, regions: vec![region], ..of_values.clone() };
            let bins = OccupancyBins::over(low, low + range);
            for (tf, alpha) in [(&of_values, of_values.alpha(value)), (&of_both, of_both.at(value, gradient)[3])] {
                if alpha > 0.0 {
                    prop_assert!(bins.opaque(tf, 0.0).meets(bins.mask(value, value)));
                }
                prop_assert!(alpha <= tf.max_alpha(value, value) + 1e-12);
            }
        }
    }
}
