//! Jitter: moves each ray's lattice towards the eye by a share of its first segment, different for each pixel. Without it all rays
//! are sampled at the same distances, which shows as rings; with it the rings become noise. The spread of pictures with different
//! noise measures the sampling error without an exact picture.
//!
//! The ticks of a ray are then at `(k - share * 2^z) * step`, where `z` is the zone of the first tick without jitter: still a
//! partition of the ray. Renderers equivalently move the ray's origin back and count distances from there. Shares are multiples of
//! 1/256 computed from integers, and so the same everywhere.

use serde::{Deserialize, Serialize};
use std::sync::LazyLock;

/// Kinds of jitter.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Jitter {
    /// No jitter.
    #[default]
    None,
    /// A pseudo-random share for each pixel. The number is the seed: another one gives other shares.
    White(u32),
    /// Shares from a blue-noise mask, with unlike neighbours for the eye to average: the best for a single picture.
    Blue,
}

/// Pixels along an edge of the mask of [`Jitter::Blue`], which repeats over the picture.
pub const BLUE_EDGE: usize = 32;

/// Number of a jitter's possible shares: multiples of `1 / STEPS`.
pub const STEPS: u32 = 256;

/// A jitter mask: the pixels' shares in units of `1 / STEPS`, row by row.
pub type Mask = [u8; BLUE_EDGE * BLUE_EDGE];

impl Jitter {
    /// Shift of the lattice of pixel `(x, y)`'s ray towards the eye, in segments; at least 0 and less than 1.
    #[inline]
    pub fn share(self, x: u32, y: u32) -> f64 {
        let steps = match self {
            Self::None => 0,
            Self::White(seed) => mix(x.wrapping_add(mix(y.wrapping_add(mix(seed))))) >> 24,
            Self::Blue => blue_mask()[y as usize % BLUE_EDGE * BLUE_EDGE + x as usize % BLUE_EDGE] as u32,
        };
        steps as f64 / STEPS as f64
    }
}

/// A permutation of all numbers with every output bit dependent on every input bit (Wellons, Prospecting for hash functions, 2018:
/// lowbias32).
fn mix(mut n: u32) -> u32 {
    n = (n ^ n >> 16).wrapping_mul(0x7feb_352d);
    n = (n ^ n >> 15).wrapping_mul(0x846c_a68b);
    n ^ n >> 16
}

/// The mask of [`Jitter::Blue`], made once.
pub fn blue_mask() -> &'static Mask {
    static MASK: LazyLock<Mask> = LazyLock::new(void_and_cluster);
    &MASK
}

const PLACES: usize = BLUE_EDGE * BLUE_EDGE;

/// Builds the mask by the method of Ulichney (The void-and-cluster method for dither array generation, 1993): takes pixels one by
/// one, each farthest from those taken before. Some milliseconds.
fn void_and_cluster() -> Mask {
    let mut pattern = Pattern::new();
    let first: Vec<usize> = (0..PLACES).filter(|&place| mix(place as u32) < u32::MAX / 10).collect();
    first.iter().for_each(|&place| pattern.flip(place));
    // The first ones change places until they are even.
    loop {
        let crowded = pattern.most_crowded();
        pattern.flip(crowded);
        let empty = pattern.emptiest();
        pattern.flip(empty);
        if empty == crowded {
            break;
        }
    }
    let mut ranks = [0; PLACES];
    let even = pattern.clone();
    for rank in (0..first.len()).rev() {
        let place = pattern.most_crowded();
        pattern.flip(place);
        ranks[place] = rank;
    }
    pattern = even;
    for rank in first.len()..PLACES {
        let place = pattern.emptiest();
        pattern.flip(place);
        ranks[place] = rank;
    }
    ranks.map(|rank| (rank * STEPS as usize / PLACES) as u8)
}

/// Taken pixels, and the crowding at each: in integers, so that the order of sums does not matter.
#[derive(Clone)]
struct Pattern {
    is_taken: [bool; PLACES],
    crowd: [u32; PLACES],
    /// Contribution of a pixel to one at this distance to the right and below, around the edges.
    kernel: [u32; PLACES],
}

impl Pattern {
    fn new() -> Self {
        /// Ulichney's, in pixels.
        const WIDTH: f64 = 1.5;
        let around = |n: usize| n.min(BLUE_EDGE - n) as f64;
        let kernel = std::array::from_fn(|place| {
            let (x, y) = (around(place % BLUE_EDGE), around(place / BLUE_EDGE));
            (65536.0 * (-(x * x + y * y) / (2.0 * WIDTH * WIDTH)).exp()).round() as u32
        });
        Self { is_taken: [false; PLACES], crowd: [0; PLACES], kernel }
    }

    /// Takes a free pixel, or frees a taken one.
    fn flip(&mut self, place: usize) {
        self.is_taken[place] ^= true;
        let change = if self.is_taken[place] { u32::wrapping_add } else { u32::wrapping_sub };
        let (x, y) = (place % BLUE_EDGE, place / BLUE_EDGE);
        for (i, crowd) in self.crowd.iter_mut().enumerate() {
            let right = (i + BLUE_EDGE - x) % BLUE_EDGE;
            let below = (i / BLUE_EDGE + BLUE_EDGE - y) % BLUE_EDGE;
            *crowd = change(*crowd, self.kernel[below * BLUE_EDGE + right]);
        }
    }

    fn most_crowded(&self) -> usize {
        let taken = (0..PLACES).filter(|&place| self.is_taken[place]);
        taken.max_by_key(|&place| self.crowd[place]).unwrap_or(0)
    }

    fn emptiest(&self) -> usize {
        let free = (0..PLACES).filter(|&place| !self.is_taken[place]);
        free.min_by_key(|&place| self.crowd[place]).unwrap_or(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The variance of the means of 4 x 4 pixels, over that of independent ones.
    fn coarse_share(jitter: Jitter) -> f64 {
        let mean = |block: u32| {
            let (x0, y0) = (block % 8 * 4, block / 8 * 4);
            (0..16).map(|i| jitter.share(x0 + i % 4, y0 + i / 4) - 0.5).sum::<f64>() / 16.0
        };
        let variance = (0..64).map(|block| mean(block).powi(2)).sum::<f64>() / 64.0;
        variance / (1.0 / 12.0 / 16.0)
    }

    #[test]
    fn a_blue_mask_has_all_steps_alike_and_little_that_is_coarse() {
        let mut counts = [0; STEPS as usize];
        blue_mask().iter().for_each(|&step| counts[step as usize] += 1);
        assert_eq!(counts, [PLACES / STEPS as usize; STEPS as usize]);
        // 64 blocks: a share of 1 give or take a sixth.
        let (blue, white) = (coarse_share(Jitter::Blue), coarse_share(Jitter::White(3)));
        assert!(blue < 0.25 && (0.5..1.6).contains(&white), "{blue} {white}");
        assert_eq!(Jitter::Blue.share(5, 7), Jitter::Blue.share(37, 71), "it repeats");
    }

    #[test]
    fn white_jitter_is_even_and_another_for_every_pixel_and_seed() {
        let shares = |seed: u32| (0..4096).map(move |i| Jitter::White(seed).share(i % 64, i / 64));
        for seed in [0, 1, 77] {
            let mean = shares(seed).sum::<f64>() / 4096.0;
            // Four standard deviations of the mean of 4096 even numbers.
            assert!((mean - 0.498).abs() < 4.0 * (1.0f64 / 12.0 / 4096.0).sqrt(), "{seed}: {mean}");
            assert!(shares(seed).all(|share| (0.0..1.0).contains(&share)));
            let same = shares(seed).zip(shares(seed + 1)).filter(|(a, b)| a == b).count();
            // 16 are expected.
            assert!(same < 40, "{seed}: {same}");
        }
        let transposed =
            (0..4096).filter(|i| Jitter::White(0).share(i % 64, i / 64) == Jitter::White(0).share(i / 64, i % 64));
        assert!(transposed.count() < 64 + 50, "rows are not columns");
    }

    #[test]
    fn without_jitter_nothing_moves() {
        assert_eq!(Jitter::None.share(3, 4), 0.0);
    }
}
