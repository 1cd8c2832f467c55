use super::*;
use crate::testing::{alone_with, is_warned, memory_taken, said};

/// Bits of entropy-coded data, with stuffing.
#[derive(Default)]
struct Bits {
    bytes: Vec<u8>,
    held: u32,
    count: u32,
}

impl Bits {
    fn put(&mut self, value: u32, count: u32) {
        for i in (0..count).rev() {
            self.held = self.held << 1 | (value >> i & 1);
            self.count += 1;
            if self.count == 8 {
                self.bytes.push(self.held as u8);
                if self.held as u8 == 0xff {
                    self.bytes.push(0);
                }
                (self.held, self.count) = (0, 0);
            }
        }
    }
}

pub(super) fn segment(marker: u8, data: &[u8]) -> Vec<u8> {
    [&[0xff, marker], &(data.len() as u16 + 2).to_be_bytes()[..], data].concat()
}

/// A picture of blocks of 8 by 8 equal pixels, one number of each component for each block. Steps of quantization are 8, so that the
/// coefficient of a block's mean is that mean.
pub(super) struct Blocks<'a> {
    pub(super) frame: u8,
    pub(super) precision: u8,
    pub(super) size: [u16; 2],
    pub(super) ids: &'a [u8],
    /// Segments before the picture's own.
    pub(super) segments: Vec<u8>,
    pub(super) means: &'a [u8],
}

impl Blocks<'_> {
    pub(super) fn file(&self) -> Vec<u8> {
        let count = self.ids.len() as u8;
        let [width, height] = self.size;
        let frame = [&[self.precision], &height.to_be_bytes()[..], &width.to_be_bytes(), &[count]].concat();
        let frame = [frame, self.ids.iter().flat_map(|&id| [id, 0x11, 0]).collect()].concat();
        let scan = [vec![count], self.ids.iter().flat_map(|&id| [id, 0]).collect(), vec![0, 63, 0]].concat();
        // Codes of four bits for the magnitudes 0 to 11 of means, and one of one bit for the end of a block.
        let means = [&[0x00][..], &[0, 0, 0, 12], &[0; 12], &(0..12).collect::<Vec<u8>>()].concat();
        let ends = [&[0x10][..], &[1], &[0; 15], &[0]].concat();
        let steps = [vec![0], vec![8; 64]].concat();
        let mut bits = Bits::default();
        let mut before = vec![128i32; self.ids.len()];
        for pixel in self.means.chunks(self.ids.len()) {
            for (mean, before) in pixel.iter().zip(&mut before) {
                let step = i32::from(*mean) - *before;
                *before = i32::from(*mean);
                let magnitude = 32 - step.unsigned_abs().leading_zeros();
                bits.put(magnitude, 4);
                bits.put((if step < 0 { step - 1 } else { step }) as u32 & ((1 << magnitude) - 1), magnitude);
                bits.put(0, 1);
            }
        }
        bits.put(0x7f, 7);
        [
            &[0xff, 0xd8][..],
            &self.segments,
            &segment(0xdb, &steps),
            &segment(self.frame, &frame),
            &segment(0xc4, &means),
            &segment(0xc4, &ends),
            &segment(0xda, &scan),
            &bits.bytes,
            &[0xff, 0xd9],
        ]
        .concat()
    }
}

pub(super) const GRAY: Blocks<'static> =
    Blocks { frame: 0xc0, precision: 8, size: [13, 9], ids: &[1], segments: Vec::new(), means: &[10, 200, 255, 0] };

/// The number of each pixel's block.
fn blocks_of(size: [u16; 2]) -> impl Iterator<Item = usize> {
    let [width, height] = size.map(usize::from);
    (0..width * height).map(move |i| i / width / 8 * width.div_ceil(8) + i % width / 8)
}

#[test]
fn gray_pixels_are_those_of_their_blocks() {
    for frame in [0xc0, 0xc1] {
        let (_folder, source) = opened("a.jpg", Blocks { frame, ..GRAY }.file());
        let info = source.info();
        assert_eq!((info.extent.to_array(), info.channels), ([13, 9, 1], 1));
        let expected: Vec<u8> = blocks_of(GRAY.size).map(|block| GRAY.means[block]).collect();
        assert_eq!(first_channel(&*source), expected);
        assert!(said(&info.notes).contains("note: JPEG is lossy") && info.channel_looks.is_empty());
    }
}

/// BT.601, as JFIF says; Adobe's marker or the components' names may say that they are red, green and blue already.
#[test]
fn colours_become_red_green_and_blue() {
    let means = [76, 85, 255, 150, 44, 21, 29, 255, 107, 128, 128, 128];
    let converted = [[254, 0, 0], [0, 255, 1], [0, 0, 254], [128; 3]];
    let as_they_are = [[76, 85, 255], [150, 44, 21], [29, 255, 107], [128; 3]];
    let adobe = |transform| segment(0xee, &[&b"Adobe\0\x64\0\0\0\0"[..], &[transform]].concat());
    for (ids, segments, expected) in [
        (&[1, 2, 3][..], vec![], converted),
        (&[1, 2, 3], segment(0xe0, b"JFIF\0\x01\x02\0\0\x01\0\x01\0\0"), converted),
        (&[1, 2, 3], adobe(1), converted),
        (&[0, 1, 2], adobe(0), as_they_are),
        (b"RGB", vec![], as_they_are),
    ] {
        let file = Blocks { ids, segments, means: &means, ..GRAY }.file();
        let (_folder, source) = opened("a.jpg", file);
        assert_eq!(source.info().channels, 3);
        for channel in 0..3 {
            let found = channel_of(&*source, channel).unwrap();
            for (found, block) in found.into_iter().zip(blocks_of(GRAY.size)) {
                let expected = expected[block][channel as usize];
                assert!(found.abs_diff(expected) <= 1, "{ids:?}: found {found}, expected {expected}");
            }
        }
        let looks: Vec<_> = source.info().channel_looks.iter().map(|look| look.name.as_deref().unwrap()).collect();
        assert_eq!(looks, ["red", "green", "blue"]);
    }
}

#[test]
fn density_is_a_spacing_and_exif_a_warning() {
    let of = |unit, x: u16, y: u16| {
        let data = [&b"JFIF\0\x01\x02"[..], &[unit], &x.to_be_bytes(), &y.to_be_bytes(), &[0, 0]].concat();
        opened("a.jpg", Blocks { segments: segment(0xe0, &data), ..GRAY }.file())
    };
    for (unit, x, y, expected) in [(1, 300, 200, "inch"), (2, 10, 20, "centimeter")] {
        let (_folder, source) = of(unit, x, y);
        let geometry = &source.info().geometry;
        assert!(source.info().calibrated && geometry.unit.as_deref() == Some(expected));
        assert_eq!(geometry.spacing.to_array(), [1.0 / f64::from(x), 1.0 / f64::from(y), 1.0 / f64::from(x)]);
    }
    for (unit, x, y) in [(0, 3, 4), (1, 72, 72), (2, 28, 0), (1, 96, 96), (2, 1, 1)] {
        let (_folder, source) = of(unit, x, y);
        assert!(!source.info().calibrated, "{unit} {x} {y}");
    }
    let exif = segment(0xe1, b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x03\0\0");
    let more = segment(0xe2, b"MPF\0MM\0*");
    let (_folder, source) = opened("a.jpg", Blocks { segments: [exif, more].concat(), ..GRAY }.file());
    let said = said(&source.info().notes);
    assert!(is_warned(&said, "Orientation 3") && is_warned(&said, "further pictures (MPF)"), "{said}");
}

#[test]
fn other_kinds_are_named() {
    for (blocks, words) in [
        (Blocks { frame: 0xc3, ..GRAY }, "lossless JPEG is not supported; write it as PNG"),
        (Blocks { frame: 0xc9, ..GRAY }, "arithmetic-coded JPEG"),
        (Blocks { frame: 0xca, ..GRAY }, "arithmetic-coded JPEG"),
        (Blocks { frame: 0xc5, ..GRAY }, "hierarchical JPEG"),
        (Blocks { frame: 0xc1, precision: 12, ..GRAY }, "12-bit JPEG"),
        (Blocks { size: [8, 0], ..GRAY }, "JPEG without a height (DNL)"),
        (Blocks { size: [0, 8], ..GRAY }, "a picture of 0x8 pixels"),
        (Blocks { ids: &[1, 2, 3, 4], ..GRAY }, "CMYK JPEG (Adobe)"),
        (Blocks { ids: &[1, 2], ..GRAY }, "JPEG of 2 components"),
        (Blocks { size: [60000, 60000], ..GRAY }, "cut short: its 60000x60000 pixels take 56250000 blocks"),
    ] {
        let message = refusal("a.jpg", &blocks.file());
        assert!(message.contains(words), "{message}");
    }
    let labels = OpenOptions { are_labels: Some(true), ..OpenOptions::default() };
    let message = refusal_with("a.jpg", &GRAY.file(), &labels);
    assert!(message.contains("JPEG of labels is not supported; it changes numbers"), "{message}");
    assert!(refusal("a.jpg", &[7; 99]).contains("does not start as a JPEG picture"));
    assert!(refusal("a.jpg", &[0xff, 0xd8, 0xff, 0xd9]).contains("ends before its pixels"));
}

/// Decoding takes at most the memory that is said: less where the decoder's threads keep up with one another.
#[cfg(target_os = "linux")]
#[test]
fn a_large_picture_takes_at_most_the_memory_it_says() {
    const SIZE: u16 = 8192;
    let large = alone_with("pictures::tests::jpeg::a_large_picture_takes_at_most_the_memory_it_says", |path| {
        let means: Vec<u8> = (0..1 << 20).map(|i| (i % 251) as u8).collect();
        std::fs::write(path, Blocks { size: [SIZE, SIZE], means: &means, ..GRAY }.file()).unwrap();
    });
    let Some(path) = large else { return };
    let plane_bytes = u64::from(SIZE).pow(2);
    let mut plane = vec![1; plane_bytes as usize];
    let (taken, source) = memory_taken(|| {
        let source = open(&[path], &OpenOptions::default()).unwrap();
        source.read_box(0, 0, source.info().extent.full_box(), &mut plane).unwrap();
        source
    });
    let said = source.reader_bytes();
    assert!((plane_bytes..=said + (3 << 20)).contains(&taken), "took {taken}, said {said}");
    assert!(said < 4 * plane_bytes + (1 << 20), "said {said}");
}
