//! Sampling error, from pictures of one view that differ only in their jitter.
//!
//! A pixel's error is the variance of its colour over the pictures: changes under jitter are undersampled detail. Errors common
//! to all pictures only appear against the truth. Pixels that show the background in every picture are left out: with them, the
//! figure would depend on the camera's distance. Pictures have 8 bits a channel, so rounding alone makes an error of up to 1/4,
//! which is 54 dB; higher qualities cannot be distinguished.

use brickyard::volume::Picture;
use brickyard::volume::transfer::lab;

/// Colour space in which errors are computed, on the scale of 8-bit codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ColorSpace {
    /// Red, green and blue as displayed, 0 to 255.
    Rgb,
    /// Luma and two colour differences (ITU-R BT.601, full range).
    YCbCr,
    /// Hue, saturation and lightness as a place in a double cone, with grays on the axis and hues around it: plain numbers for
    /// hue and saturation jump for nearly gray colours.
    Hsl,
}

impl ColorSpace {
    /// Returns a colour's components in this space.
    pub fn of(self, rgb: [u8; 3]) -> [f64; 3] {
        let [r, g, b] = rgb.map(f64::from);
        match self {
            Self::Rgb => [r, g, b],
            Self::YCbCr => {
                let y = 0.299 * r + 0.587 * g + 0.114 * b;
                [y, (b - y) / 1.772, (r - y) / 1.402]
            }
            Self::Hsl => {
                let (low, high) = (r.min(g).min(b), r.max(g).max(b));
                let chroma = high - low;
                let sextant = match chroma {
                    0.0 => 0.0,
                    _ if high == r => (g - b) / chroma,
                    _ if high == g => 2.0 + (b - r) / chroma,
                    _ => 4.0 + (r - g) / chroma,
                };
                let hue = sextant * std::f64::consts::FRAC_PI_3;
                [chroma * hue.cos(), chroma * hue.sin(), 0.5 * (low + high)]
            }
        }
    }
}

/// Least CIELAB distance at which two adjacent colours can be told apart (Mahy, Van Eycken and Oosterlinck, "Evaluation of
/// uniform color spaces developed after the adoption of CIELAB and CIELUV", 1994).
pub const NOTICED: f64 = 2.3;

/// Returns the ratio of the greatest signal (255) to a mean square error, dB; infinite without error.
pub fn psnr_db(mean_square: f64) -> f64 {
    10.0 * (255.0 * 255.0 / mean_square).log10()
}

/// Pictures of one view that differ only in their jitter, and the background colour.
pub struct Series {
    pictures: Vec<Picture>,
    background: [u8; 3],
}

/// Reference picture: the mean of a series, not rounded.
pub struct Truth {
    rgb: Vec<[f64; 3]>,
    is_shown: Vec<bool>,
}

impl Series {
    /// Creates a series with the colour behind the volume.
    ///
    /// # Panics
    /// If there are fewer than two pictures, or their sizes differ.
    pub fn new(pictures: Vec<Picture>, background: [u8; 3]) -> Self {
        assert!(pictures.len() > 1, "a variance takes two pictures");
        let size = |picture: &Picture| (picture.width, picture.height, picture.rgb.len());
        assert!(pictures.iter().all(|picture| size(picture) == size(&pictures[0])), "sizes differ");
        Self { pictures, background }
    }

    fn pixels(&self) -> usize {
        self.pictures[0].rgb.len()
    }

    fn is_shown(&self, pixel: usize) -> bool {
        self.pictures.iter().any(|picture| picture.rgb[pixel] != self.background)
    }

    /// Number of pixels that show the volume in any picture.
    pub fn shown(&self) -> usize {
        (0..self.pixels()).filter(|&pixel| self.is_shown(pixel)).count()
    }

    /// Each pixel's error: the variance of its colour over the pictures, averaged over components. `None` for background.
    pub fn variances(&self, space: ColorSpace) -> Vec<Option<f64>> {
        let variance = |pixel| {
            let colors = || self.pictures.iter().map(|picture| space.of(picture.rgb[pixel]));
            let n = self.pictures.len() as f64;
            let one = |k: usize| {
                let mean = colors().map(|color| color[k]).sum::<f64>() / n;
                colors().map(|color| (color[k] - mean).powi(2)).sum::<f64>() / (n - 1.0)
            };
            (one(0) + one(1) + one(2)) / 3.0
        };
        (0..self.pixels()).map(|pixel| self.is_shown(pixel).then(|| variance(pixel))).collect()
    }

    /// Signal-to-noise ratio for the mean of all pixels' errors, dB.
    pub fn psnr_db(&self, space: ColorSpace) -> f64 {
        psnr_db(mean(self.variances(space).into_iter().flatten()))
    }

    /// Signal-to-noise ratio for the mean square difference from the truth, dB, over the pixels in which either shows the
    /// volume.
    ///
    /// # Panics
    /// If the truth has another number of pixels.
    pub fn psnr_against_db(&self, truth: &Truth) -> f64 {
        assert_eq!(truth.rgb.len(), self.pixels(), "sizes differ");
        let square = |pixel: usize| {
            let squares = self.pictures.iter().flat_map(|picture| {
                let off = |k: usize| (picture.rgb[pixel][k] as f64 - truth.rgb[pixel][k]).powi(2);
                [off(0), off(1), off(2)]
            });
            mean(squares)
        };
        let shown = (0..self.pixels()).filter(|&pixel| truth.is_shown[pixel] || self.is_shown(pixel));
        psnr_db(mean(shown.map(square)))
    }

    /// Fraction of pixels with a colour difference from the truth above [`NOTICED`], where either shows the volume.
    ///
    /// # Panics
    /// If the truth has another number of pixels.
    pub fn noticed(&self, truth: &Truth) -> f64 {
        assert_eq!(truth.rgb.len(), self.pixels(), "sizes differ");
        let color = |rgb: [f64; 3]| lab(rgb.map(|v| v / 255.0));
        let share = |pixel: usize| {
            let [l, a, b] = color(truth.rgb[pixel]);
            let is_noticed = |picture: &Picture| {
                let other = color(picture.rgb[pixel].map(f64::from));
                let square = (other[0] - l).powi(2) + (other[1] - a).powi(2) + (other[2] - b).powi(2);
                square > NOTICED * NOTICED
            };
            mean(self.pictures.iter().map(|picture| is_noticed(picture) as u8 as f64))
        };
        mean((0..self.pixels()).filter(|&pixel| truth.is_shown[pixel] || self.is_shown(pixel)).map(share))
    }

    /// The mean picture.
    pub fn mean(&self) -> Truth {
        let color = |pixel: usize| {
            [0, 1, 2].map(|k| mean(self.pictures.iter().map(move |picture| picture.rgb[pixel][k] as f64)))
        };
        Truth {
            rgb: (0..self.pixels()).map(color).collect(),
            is_shown: (0..self.pixels()).map(|pixel| self.is_shown(pixel)).collect(),
        }
    }

    /// Picture of the pixels' signal-to-noise ratios. `color` maps a ratio in dB to a colour; background is black.
    pub fn map(&self, color: impl Fn(f64) -> [f64; 3]) -> Picture {
        let pixel = |variance| Picture::quantise(color(psnr_db(variance)).map(|c| c as f32));
        let variances = self.variances(ColorSpace::Rgb).into_iter();
        let rgb = variances.map(|variance| variance.map_or([0; 3], pixel)).collect();
        Picture { rgb, ..self.pictures[0] }
    }
}

/// Mean of the values; 0 if there are none.
fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (count, sum) = values.fold((0usize, 0.0), |(count, sum), value| (count + 1, sum + value));
    if count == 0 { 0.0 } else { sum / count as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn picture(rgb: &[[u8; 3]]) -> Picture {
        Picture { width: rgb.len() as u32, height: 1, rgb: rgb.to_vec() }
    }

    #[test]
    fn variances_are_those_of_the_values() {
        // Red 10, 20, 60: about 30, squares 400 + 100 + 900 over two. Green 4, 4, 7: variance 3. Blue never changes.
        let pixels = [[10, 4, 9], [20, 4, 9], [60, 7, 9]];
        let series = Series::new(pixels.map(|pixel| picture(&[pixel])).to_vec(), [0; 3]);
        assert_eq!(series.variances(ColorSpace::Rgb), [Some((700.0 + 3.0) / 3.0)]);
        assert!((series.psnr_db(ColorSpace::Rgb) - 10.0 * (65025.0f64 * 3.0 / 703.0).log10()).abs() < 1e-12);
        // Grays: luma alone changes, and so does lightness.
        let grays = Series::new([10u8, 40].map(|v| picture(&[[v; 3]])).to_vec(), [0; 3]);
        for space in [ColorSpace::YCbCr, ColorSpace::Hsl] {
            let found = grays.variances(space)[0].unwrap();
            assert!((found - 450.0 / 3.0).abs() < 1e-9, "{space:?}: {found}");
        }
    }

    #[test]
    fn colours_have_their_places() {
        assert_eq!(ColorSpace::YCbCr.of([255; 3]).map(f64::round), [255.0, 0.0, 0.0]);
        let close = |rgb, expected: [f64; 3]| {
            let found = ColorSpace::Hsl.of(rgb);
            assert!((0..3).all(|k| (found[k] - expected[k]).abs() < 1e-9), "{rgb:?}: {found:?}");
        };
        let height = 255.0 * 0.75f64.sqrt();
        close([255, 0, 0], [255.0, 0.0, 127.5]);
        close([0, 255, 0], [-127.5, height, 127.5]);
        close([0, 0, 255], [-127.5, -height, 127.5]);
        close([255; 3], [0.0, 0.0, 255.0]);
        // Hues just before and just behind red are close.
        let (a, b) = (ColorSpace::Hsl.of([255, 0, 1]), ColorSpace::Hsl.of([255, 1, 0]));
        assert!((0..3).all(|k| (a[k] - b[k]).abs() < 3.0));
    }

    #[test]
    fn background_does_not_count() {
        let with = |background: usize| {
            let row = |v: u8| [vec![[v; 3]; 5], vec![[7, 8, 9]; background]].concat();
            Series::new([100, 110, 95].map(|v| picture(&row(v))).to_vec(), [7, 8, 9])
        };
        let (near, far) = (with(3), with(300));
        assert_eq!((near.shown(), far.shown()), (5, 5));
        assert_eq!(near.psnr_db(ColorSpace::Rgb), far.psnr_db(ColorSpace::Rgb));
        assert_eq!(near.psnr_against_db(&near.mean()), far.psnr_against_db(&far.mean()));
        assert_eq!(far.variances(ColorSpace::Rgb)[5], None);
        // A pixel that shows the volume in one of the pictures does.
        let mut pictures = near.pictures;
        pictures[1].rgb[6] = [0; 3];
        assert_eq!(Series::new(pictures, [7, 8, 9]).shown(), 6);
    }

    #[test]
    fn the_truth_tells_what_all_pictures_have_wrong() {
        let series = |v: [u8; 2]| Series::new(v.map(|v| picture(&[[v; 3]])).to_vec(), [0; 3]);
        let truth = series([100, 101]).mean();
        // 10 off, give or take 2; and the variance of two values 4 apart.
        let found = series([108, 112]);
        assert!((found.psnr_against_db(&truth) - psnr_db((7.5f64.powi(2) + 11.5f64.powi(2)) / 2.0)).abs() < 1e-12);
        assert!((found.psnr_db(ColorSpace::Rgb) - psnr_db(8.0)).abs() < 1e-12);
        assert_eq!(series([50, 50]).psnr_db(ColorSpace::Rgb), f64::INFINITY);
    }

    #[test]
    fn small_distances_are_not_noticed() {
        let series = |v: [u8; 2]| Series::new(v.map(|v| picture(&[[v; 3], [v + 60; 3]])).to_vec(), [0; 3]);
        let truth = series([100, 100]).mean();
        // A step of gray is about 0.4 in lightness here: three are not seen, twelve are.
        assert_eq!([[100, 103], [100, 112], [112, 112]].map(|v| series(v).noticed(&truth)), [0.0, 0.5, 1.0]);
    }

    #[test]
    fn maps_show_each_pixels_ratio() {
        let series = Series::new([[[10; 3], [5; 3]], [[20; 3], [5; 3]]].map(|row| picture(&row)).to_vec(), [5; 3]);
        let expected = psnr_db(50.0);
        let map = series.map(|db| [(db == expected) as u32 as f64; 3]);
        assert_eq!(map.rgb, [[255; 3], [0; 3]]);
    }
}
