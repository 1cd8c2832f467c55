//! Supersampling: a pixel's colour is the mean of several rays' colours, for smooth edges. The rays pass the pixel at different places and are
//! sampled at different distances, so the mean has no rings either.
//!
//! A picture with `n` samples per pixel is the mean of `n` pictures of the whole view, each with all rays moved by the same part of a pixel, and the
//! lattice's ticks by the same part of a segment. It costs as many frames, and no more memory. Places are Hammersley's points: no two are in the same
//! of `n` columns or rows of a pixel.

use crate::picture::Picture;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Number of samples of a pixel: 1, 2, 4, 8 or 16.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "u32", into = "u32")]
pub struct PixelSamples(u8);

/// The number of samples is not 1, 2, 4, 8 or 16.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error("expected 1, 2, 4, 8 or 16 samples a pixel")]
pub struct PixelSamplesError;

/// One of the samples of every pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelSample {
    /// Place of its ray in the pixel: to the right of and below the centre, in pixels.
    pub offset_px: [f64; 2],
    /// Shift of its ticks towards the eye: the [phase](crate::Lattice::phase) of its lattice.
    pub phase: u8,
}

impl PixelSamples {
    /// One sample in the centre of each pixel: no supersampling.
    pub const ONE: Self = Self(1);
    /// Four samples: edges of five shades.
    pub const FOUR: Self = Self(4);

    /// The number of samples.
    pub fn count(self) -> usize {
        self.0.into()
    }

    /// Iterates over the samples of a pixel. Their mean place is the pixel's centre.
    pub fn samples(self) -> impl Iterator<Item = PixelSample> {
        let (count, digits) = (self.0, self.0.trailing_zeros());
        let centred = move |place: u8| (f64::from(place) + 0.5) / f64::from(count) - 0.5;
        (0..count).map(move |i| {
            // The number's binary digits in reverse.
            let row = if digits == 0 { 0 } else { i.reverse_bits() >> (u8::BITS - digits) };
            PixelSample { offset_px: [centred(i), centred(row)], phase: (u32::from(i) * 256 / u32::from(count)) as u8 }
        })
    }

    /// Averages the pictures drawn by `draw` for each sample.
    ///
    /// # Errors
    /// The first error of `draw`.
    pub fn picture<E>(self, mut draw: impl FnMut(PixelSample) -> Result<Picture, E>) -> Result<Picture, E> {
        let mut sum = PictureSum::default();
        for sample in self.samples() {
            sum.add(&draw(sample)?);
        }
        Ok(sum.mean())
    }
}

/// The sum of pictures of one size.
#[derive(Clone, Debug, Default)]
pub struct PictureSum {
    size_px: (u32, u32),
    count: u16,
    sums: Vec<[u16; 3]>,
}

impl PictureSum {
    /// Adds a picture; at most 256 in all.
    pub fn add(&mut self, picture: &Picture) {
        self.size_px = (picture.width, picture.height);
        self.count += 1;
        self.sums.resize(picture.rgb.len(), [0; 3]);
        for (sum, pixel) in self.sums.iter_mut().flatten().zip(picture.rgb.iter().flatten()) {
            *sum += u16::from(*pixel);
        }
    }

    /// The rounded mean of the added pictures; without pixels before the first.
    pub fn mean(&self) -> Picture {
        let (width, height) = self.size_px;
        let rounded = |sum: u16| ((sum + self.count / 2) / self.count) as u8;
        Picture { width, height, rgb: self.sums.iter().map(|sum| sum.map(rounded)).collect() }
    }
}

impl Default for PixelSamples {
    fn default() -> Self {
        Self::ONE
    }
}

impl TryFrom<u32> for PixelSamples {
    type Error = PixelSamplesError;

    fn try_from(count: u32) -> Result<Self, PixelSamplesError> {
        match count {
            1 | 2 | 4 | 8 | 16 => Ok(Self(count as u8)),
            _ => Err(PixelSamplesError),
        }
    }
}

impl From<PixelSamples> for u32 {
    fn from(samples: PixelSamples) -> Self {
        samples.0.into()
    }
}

impl FromStr for PixelSamples {
    type Err = PixelSamplesError;

    fn from_str(text: &str) -> Result<Self, PixelSamplesError> {
        text.parse::<u32>().map_err(|_| PixelSamplesError)?.try_into()
    }
}

impl fmt::Display for PixelSamples {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_share_no_column_or_row_and_divide_a_segment_evenly() {
        for count in [1, 2, 4, 8, 16u8] {
            let samples: Vec<_> = PixelSamples(count).samples().collect();
            for axis in 0..2 {
                let mut places: Vec<_> =
                    samples.iter().map(|s| ((s.offset_px[axis] + 0.5) * f64::from(count)).floor() as u8).collect();
                places.sort_unstable();
                assert_eq!(places, (0..count).collect::<Vec<_>>(), "{count}");
                assert!(samples.iter().map(|sample| sample.offset_px[axis]).sum::<f64>().abs() < 1e-12, "{count}");
            }
            let phases: Vec<_> = samples.iter().map(|sample| usize::from(sample.phase) * usize::from(count)).collect();
            assert_eq!(phases, (0..usize::from(count)).map(|i| i * 256).collect::<Vec<_>>());
        }
        let centre = PixelSample { offset_px: [0.0; 2], phase: 0 };
        assert_eq!(PixelSamples::ONE.samples().collect::<Vec<_>>(), [centre]);
    }

    #[test]
    fn a_picture_is_the_rounded_mean_of_its_samples() {
        let mut values = [1u8, 2, 2, 255].into_iter();
        let drawn = PixelSamples::FOUR.picture(|_| -> Result<_, ()> {
            let value = values.next().unwrap();
            Ok(Picture { width: 1, height: 1, rgb: vec![[value, 255, 0]] })
        });
        assert_eq!(drawn.unwrap().rgb, [[65, 255, 0]]);
        let mut left = 2;
        let failed = PixelSamples::FOUR.picture(|_| {
            left -= 1;
            if left == 0 { Err("no more") } else { Ok(Picture { width: 1, height: 1, rgb: vec![[0; 3]] }) }
        });
        assert_eq!(failed, Err("no more"));
    }

    #[test]
    fn other_numbers_of_samples_are_refused() {
        for count in ["0", "3", "32", "-1", "4.0", "many", ""] {
            assert_eq!(count.parse::<PixelSamples>(), Err(PixelSamplesError), "{count}");
        }
        assert_eq!("8".parse(), Ok(PixelSamples(8)));
        assert!(serde_json::from_str::<PixelSamples>("5").is_err());
        assert_eq!(serde_json::to_string(&PixelSamples(16)).unwrap(), "16");
    }
}
