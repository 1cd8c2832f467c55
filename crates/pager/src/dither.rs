//! Pixel shares: a brick fading in is drawn in some pixels, its predecessor in the others.

/// Evenly spread pixels of the picture: those with a [threshold](PixelShare::threshold) in `from..to`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelShare {
    /// Least threshold of the share's pixels.
    pub from: u8,
    /// One past the greatest threshold of the share's pixels, at most [`PixelShare::THRESHOLDS`].
    pub to: u8,
}

impl PixelShare {
    /// Number of thresholds, each with an equal share of the pixels.
    pub const THRESHOLDS: u8 = 64;
    /// All pixels.
    pub const ALL: Self = Self { from: 0, to: Self::THRESHOLDS };

    /// A pixel's threshold, less than [`PixelShare::THRESHOLDS`], by Bayer's matrix of 8 by 8. Computed in integers, so it is the same in
    /// all renderers; `dither` in dither.wgsl is its twin.
    #[inline(always)]
    pub fn threshold(x: u32, y: u32) -> u8 {
        let z = x ^ y;
        ((z & 1) << 5 | (y & 1) << 4 | (z & 2) << 2 | (y & 2) << 1 | (z & 4) >> 1 | (y & 4) >> 2) as u8
    }

    /// Whether a pixel belongs to this share.
    #[inline(always)]
    pub fn hold(self, x: u32, y: u32) -> bool {
        (self.from..self.to).contains(&Self::threshold(x, y))
    }
}
