//! A share of the picture's pixels: what a brick that fades in is drawn in, and the one before it in the others.

/// Some of the picture's pixels, spread evenly: those whose [threshold](PixelShare::threshold) is in `from..to`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PixelShare {
    /// The least threshold of the share's pixels.
    pub from: u8,
    /// One past the greatest threshold of the share's pixels, at most [`PixelShare::THRESHOLDS`].
    pub to: u8,
}

impl PixelShare {
    /// The number of thresholds. Every threshold has an equal share of the pixels.
    pub const THRESHOLDS: u8 = 64;
    /// The share of all pixels.
    pub const ALL: Self = Self { from: 0, to: Self::THRESHOLDS };

    /// A pixel's threshold, less than [`PixelShare::THRESHOLDS`], by Bayer's matrix of 8 by 8. It is computed in integers, so that it is the
    /// same in all renderers; `dither` in dither.wgsl is its twin.
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
