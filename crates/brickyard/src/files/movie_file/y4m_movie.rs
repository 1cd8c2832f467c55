//! YUV4MPEG2 movies: a header line, then each picture's planes, uncompressed.
//!
//! Colour planes have full resolution (4:4:4), since thin coloured structures in dark volumes lose their colour at half
//! of it. They are BT.709 of limited range, as players expect: black is 16, white 235. The round trip is off by at most
//! 2 of 255.

use super::PictureRate;
use brickyard_volume::Picture;
use std::io::{self, Write};

pub(super) struct Y4mMovie<W> {
    file: W,
    planes: [Vec<u8>; 3],
}

impl<W: Write> Y4mMovie<W> {
    pub(super) fn new(mut file: W, (width, height): (u32, u32), rate: PictureRate) -> io::Result<Self> {
        let (pictures, seconds) = rate.ratio();
        // Parameters with X are extensions. The range's is ffmpeg's; the matrix has no known one, so the last is for
        // human readers.
        let parameters = "Ip A1:1 C444 XYSCSS=444 XCOLORRANGE=LIMITED XMATRIX=BT709";
        writeln!(file, "YUV4MPEG2 W{width} H{height} F{pictures}:{seconds} {parameters}")?;
        Ok(Self { file, planes: Default::default() })
    }

    pub(super) fn push(&mut self, picture: &Picture) -> io::Result<()> {
        self.planes.iter_mut().for_each(Vec::clear);
        for &rgb in &picture.rgb {
            for (plane, value) in self.planes.iter_mut().zip(limited_bt709(rgb)) {
                plane.push(value);
            }
        }
        self.file.write_all(b"FRAME\n")?;
        self.planes.iter().try_for_each(|plane| self.file.write_all(plane))
    }

    /// Flushes and returns the writer.
    pub(super) fn finish(mut self) -> io::Result<W> {
        self.file.flush()?;
        Ok(self.file)
    }
}

/// Converts a colour to Y, Cb and Cr by ITU-R BT.709: Y from 16 to 235, the others from 16 to 240 with 128 for gray.
fn limited_bt709(rgb: [u8; 3]) -> [u8; 3] {
    let [r, g, b] = rgb.map(|value| f64::from(value) / 255.0);
    let luma = 0.2126 * r + 0.7152 * g + 0.0722 * b;
    let [blue, red] = [(b - luma) / 1.8556, (r - luma) / 1.5748];
    [16.0 + 219.0 * luma, 128.0 + 224.0 * blue, 128.0 + 224.0 * red].map(|value| value.round() as u8)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The inverse, by BT.709's own equations.
    fn rgb([y, cb, cr]: [u8; 3]) -> [f64; 3] {
        let luma = (f64::from(y) - 16.0) / 219.0;
        let [blue, red] = [cb, cr].map(|value| (f64::from(value) - 128.0) / 224.0);
        let (r, b) = (luma + 1.5748 * red, luma + 1.8556 * blue);
        let g = (luma - 0.2126 * r - 0.0722 * b) / 0.7152;
        [r, g, b].map(|value| (value * 255.0).round().clamp(0.0, 255.0))
    }

    #[test]
    fn known_colours_have_known_codes() {
        for (rgb, codes) in [
            ([0, 0, 0], [16, 128, 128]),
            ([255, 255, 255], [235, 128, 128]),
            ([255, 0, 0], [63, 102, 240]),
            ([0, 255, 0], [173, 42, 26]),
            ([0, 0, 255], [32, 240, 118]),
        ] {
            assert_eq!(limited_bt709(rgb), codes, "{rgb:?}");
        }
    }

    #[test]
    fn colours_come_back_within_two() {
        for code in (0..1 << 24).step_by(5) {
            let [r, g, b, _] = u32::to_le_bytes(code);
            let found = rgb(limited_bt709([r, g, b]));
            for (found, expected) in found.into_iter().zip([r, g, b]) {
                assert!((found - f64::from(expected)).abs() <= 2.0, "{r} {g} {b}: {found}");
            }
        }
    }

    #[test]
    fn planes_follow_one_another() {
        let picture = Picture { width: 2, height: 1, rgb: vec![[255, 255, 255], [255, 0, 0]] };
        let mut movie = Y4mMovie::new(Vec::new(), (2, 1), "12.5".parse().unwrap()).unwrap();
        movie.push(&picture).unwrap();
        movie.push(&picture).unwrap();
        let bytes = movie.finish().unwrap();
        let head = b"YUV4MPEG2 W2 H1 F25:2 Ip A1:1 C444 XYSCSS=444 XCOLORRANGE=LIMITED XMATRIX=BT709\n";
        let frame = [&b"FRAME\n"[..], &[235, 63, 128, 102, 128, 240]].concat();
        assert_eq!(bytes, [&head[..], &frame, &frame].concat());
    }
}
