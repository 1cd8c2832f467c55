use super::*;
use crate::testing::{Field, alone_with, assert_boxes, is_warned, memory_taken, said};
use brickyard_volume::VoxelType;
use flate2::Compression;
use flate2::write::ZlibEncoder;
use std::io::Write;

/// Colour types of the specification.
const GRAY: u8 = 0;
const RGB: u8 = 2;
const PALETTE: u8 = 3;
const GRAY_ALPHA: u8 = 4;
const RGBA: u8 = 6;
/// Adam7: column and row of the first pixel, and the steps.
const ADAM7: [[usize; 4]; 7] =
    [[0, 0, 8, 8], [4, 0, 8, 8], [0, 4, 4, 8], [2, 0, 4, 4], [0, 2, 2, 4], [1, 0, 2, 2], [0, 1, 1, 2]];

pub(super) fn chunk(kind: &[u8; 4], data: &[u8]) -> Vec<u8> {
    let mut crc = flate2::Crc::new();
    crc.update(kind);
    crc.update(data);
    [&(data.len() as u32).to_be_bytes(), &kind[..], data, &crc.sum().to_be_bytes()].concat()
}

/// A picture by its numbers, row by row, the samples of a pixel side by side.
pub(super) struct Picture<'a> {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) bits: u8,
    pub(super) colour: u8,
    pub(super) is_interlaced: bool,
    /// Chunks before the pixels.
    pub(super) chunks: Vec<u8>,
    pub(super) numbers: &'a [u16],
}

impl Picture<'_> {
    pub(super) fn file(&self) -> Vec<u8> {
        let samples = match self.colour {
            RGB => 3,
            GRAY_ALPHA => 2,
            RGBA => 4,
            _ => 1,
        };
        let passes = if self.is_interlaced { &ADAM7[..] } else { &[[0, 0, 1, 1]] };
        let mut rows = Vec::new();
        for &[x0, y0, dx, dy] in passes {
            if x0 >= self.width {
                continue;
            }
            for y in (y0..self.height).step_by(dy) {
                let pixels = (x0..self.width).step_by(dx).map(|x| (y * self.width + x) * samples);
                let numbers: Vec<u16> = pixels.flat_map(|at| self.numbers[at..at + samples].to_vec()).collect();
                rows.push(0);
                rows.extend(packed(&numbers, self.bits));
            }
        }
        let mut packer = ZlibEncoder::new(Vec::new(), Compression::fast());
        packer.write_all(&rows).unwrap();
        let mut header = [(self.width as u32).to_be_bytes(), (self.height as u32).to_be_bytes()].concat();
        header.extend([self.bits, self.colour, 0, 0, self.is_interlaced.into()]);
        let pixels = chunk(b"IDAT", &packer.finish().unwrap());
        [b"\x89PNG\r\n\x1a\n", &chunk(b"IHDR", &header)[..], &self.chunks, &pixels, &chunk(b"IEND", b"")].concat()
    }
}

/// Numbers of this many bits, the highest bits of a byte first.
fn packed(numbers: &[u16], bits: u8) -> Vec<u8> {
    if bits == 16 {
        return numbers.iter().flat_map(|n| n.to_be_bytes()).collect();
    }
    let per_byte = 8 / usize::from(bits);
    let byte = |some: &[u16]| (0..per_byte).fold(0u32, |b, i| b << bits | u32::from(some.get(i).copied().unwrap_or(0)));
    numbers.chunks(per_byte).map(|some| byte(some) as u8).collect()
}

/// A gray picture of 8 bits.
pub(super) fn gray(width: usize, height: usize, numbers: &[u16], chunks: &[u8]) -> Vec<u8> {
    Picture { width, height, bits: 8, colour: GRAY, is_interlaced: false, chunks: chunks.to_vec(), numbers }.file()
}

/// Files of a field's planes.
pub(super) fn planes(field: Field, colour: u8, is_interlaced: bool) -> Vec<(String, Vec<u8>)> {
    let [x, y, z, ..] = field.sizes.map(|n| n as usize);
    let bits = 8 * field.voxel_type.bytes() as u8;
    let bytes = field.bytes("zyxc", false);
    let numbers: Vec<u16> = match bits {
        8 => bytes.iter().map(|&b| b.into()).collect(),
        _ => bytes.as_chunks::<2>().0.iter().map(|b| u16::from_le_bytes(*b)).collect(),
    };
    let plane = |(i, numbers): (usize, &[u16])| {
        let picture = Picture { width: x, height: y, bits, colour, is_interlaced, chunks: Vec::new(), numbers };
        (format!("p{i}.png"), picture.file())
    };
    numbers.chunks(numbers.len() / z).enumerate().map(plane).collect()
}

#[test]
fn samples_of_8_and_16_bits_in_all_colours() {
    for (colour, channels) in [(GRAY, 1), (RGB, 3), (GRAY_ALPHA, 2), (RGBA, 4)] {
        for voxel_type in [VoxelType::U8, VoxelType::U16] {
            for (is_interlaced, x, y) in [(false, 7, 5), (true, 7, 5), (true, 19, 11), (true, 1, 9), (true, 3, 1)] {
                let field = Field { sizes: [x, y, 3, channels, 1], voxel_type };
                let files = planes(field, colour, is_interlaced);
                let files: Vec<(&str, Vec<u8>)> = files.iter().map(|(name, file)| (&name[..], file.clone())).collect();
                let (_folder, source) = opened_as(&files, &OpenOptions::default()).unwrap();
                assert_boxes(&*source, field);
                let names: Vec<_> = source.info().channel_looks.iter().map(|look| look.name.clone().unwrap()).collect();
                let expected: &[&str] = match colour {
                    GRAY => &[],
                    RGB => &["red", "green", "blue"],
                    GRAY_ALPHA => &["gray", "alpha"],
                    _ => &["red", "green", "blue", "alpha"],
                };
                assert_eq!(names, expected);
                let said = said(&source.info().notes);
                assert_eq!(said.contains("channel alpha"), matches!(colour, GRAY_ALPHA | RGBA), "{said}");
                assert!(!source.info().calibrated);
            }
        }
    }
    let (_folder, rgb) =
        opened("a.png", planes(Field { sizes: [2, 2, 1, 3, 1], voxel_type: VoxelType::U16 }, RGB, false).remove(0).1);
    let looks: Vec<_> = rgb.info().channel_looks.iter().map(|look| (look.color, look.window)).collect();
    let whole = Some([0.0, 65535.0]);
    assert_eq!(looks, [(Some([255, 0, 0]), whole), (Some([0, 255, 0]), whole), (Some([0, 0, 255]), whole)]);
}

#[test]
fn numbers_of_few_bits_are_read_as_stored() {
    for bits in [1, 2, 4] {
        for (width, is_interlaced) in [(1, false), (7, false), (8, false), (17, false), (17, true), (5, true)] {
            let numbers: Vec<u16> = (0..width * 9).map(|i| (i * 7 + i / 5) as u16 % (1 << bits)).collect();
            let picture =
                Picture { width, height: 9, bits, colour: GRAY, is_interlaced, chunks: Vec::new(), numbers: &numbers };
            let (_folder, source) = opened("a.png", picture.file());
            assert_eq!(first_channel(&*source), numbers.iter().map(|&n| n as u8).collect::<Vec<_>>(), "{bits} {width}");
            let words = format!("the numbers 0 to {} are read as stored", (1 << bits) - 1);
            assert!(said(&source.info().notes).contains(&words));
        }
    }
}

fn indexed(colours: &[u8], bits: u8, numbers: &[u16]) -> Vec<u8> {
    let chunks = chunk(b"PLTE", colours);
    Picture { width: 3, height: 2, bits, colour: PALETTE, is_interlaced: false, chunks, numbers }.file()
}

#[test]
fn palettes_are_colours_or_grays_or_labels() {
    let numbers = [0, 1, 2, 2, 1, 0];
    let coloured = [10, 20, 30, 40, 40, 40, 7, 8, 9];
    for bits in [2, 4, 8] {
        let (_folder, source) = opened("a.png", indexed(&coloured, bits, &numbers));
        let channels = [0, 1, 2].map(|c| channel_of(&*source, c).unwrap());
        assert_eq!(channels, [[10, 40, 7, 7, 40, 10], [20, 40, 8, 8, 40, 20], [30, 40, 9, 9, 40, 30]]);
        assert!(said(&source.info().notes).contains("its colours are read, not the indices"));
        let (_folder, source) = opened("a.png", indexed(&[9, 9, 9, 5, 5, 5, 200, 200, 200], bits, &numbers));
        assert_eq!((source.info().channels, first_channel(&*source)), (1, vec![9, 5, 200, 200, 5, 9]));
        assert!(said(&source.info().notes).contains("its grays are read, not the indices"));
        let labels = OpenOptions { are_labels: Some(true), ..OpenOptions::default() };
        // Optimizers shrink each picture to the bits it needs.
        let other = indexed(&coloured, 8, &numbers);
        let files = [("p1.png", indexed(&coloured, bits, &numbers)), ("p2.png", other)];
        let (_folder, source) = opened_as(&files, &labels).unwrap();
        assert_eq!((source.info().channels, first_channel(&*source)), (1, vec![0, 1, 2, 2, 1, 0, 0, 1, 2, 2, 1, 0]));
        assert!(said(&source.info().notes).contains("the indices are the labels"));
    }
    let message = refusal("a.png", &indexed(&coloured, 2, &[0, 1, 2, 2, 3, 0]));
    assert!(message.contains("the pixel at 1,1 has colour 3 of a palette of 3"), "{message}");
}

#[test]
fn chunks_about_meaning_are_remarks() {
    let of = |kind, data: &[u8]| opened("a.png", gray(2, 1, &[1, 2], &chunk(kind, data)));
    let (_folder, plain) = of(b"gAMA", &45455u32.to_be_bytes());
    assert_eq!((first_channel(&*plain), said(&plain.info().notes)), (vec![1, 2], String::new()));
    let (_folder, clear) = of(b"tRNS", &[0, 1]);
    assert_eq!(first_channel(&*clear), [1, 2]);
    assert!(is_warned(&said(&clear.info().notes), "(tRNS) is left out"));
    let (_folder, few) = of(b"sBIT", &[5]);
    assert!(said(&few.info().notes).contains("Of 8 bits of a number, 5 are significant"));
    let (_folder, turned) = of(b"eXIf", b"MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0");
    assert!(is_warned(&said(&turned.info().notes), "(Orientation 6): it is read as stored"));
}

#[test]
fn pixels_per_metre_are_a_spacing() {
    let of = |x: u32, y: u32, unit: u8| {
        let data = [&x.to_be_bytes()[..], &y.to_be_bytes(), &[unit]].concat();
        opened("a.png", gray(2, 1, &[1, 2], &chunk(b"pHYs", &data)))
    };
    let (_folder, source) = of(2000, 4000, 1);
    let info = source.info();
    assert!(info.calibrated && info.geometry.unit.as_deref() == Some("meter"));
    assert_eq!(info.geometry.spacing.to_array(), [1.0 / 2000.0, 1.0 / 4000.0, 1.0 / 2000.0]);
    for (x, y, unit) in [(2000, 2000, 0), (0, 5, 1), (1, 1, 1)] {
        let (_folder, source) = of(x, y, unit);
        assert!(!source.info().calibrated && source.info().geometry.unit.is_none(), "{x} {y} {unit}");
    }
    for (pixels, dots) in [(2835, 72), (3780, 96)] {
        let (_folder, source) = of(pixels, pixels, 1);
        assert!(!source.info().calibrated);
        assert!(said(&source.info().notes).contains(&format!("{dots} pixels per inch")));
    }
}

#[test]
fn animations_are_refused() {
    let control = chunk(b"acTL", &[0, 0, 0, 2, 0, 0, 0, 0]);
    let message = refusal("a.png", &gray(2, 1, &[1, 2], &control));
    assert!(message.contains("an animated PNG picture (APNG) is not supported; write its frames"), "{message}");
}

/// A picture is decoded row by row.
#[cfg(target_os = "linux")]
#[test]
fn a_large_picture_takes_little_memory() {
    const SIZE: usize = 6000;
    let large = alone_with("pictures::tests::png::a_large_picture_takes_little_memory", |path| {
        let numbers: Vec<u16> = (0..SIZE * SIZE).map(|i| (i % 251) as u16).collect();
        std::fs::write(path, gray(SIZE, SIZE, &numbers, &[])).unwrap();
    });
    let Some(path) = large else { return };
    let mut plane = vec![1; SIZE * SIZE];
    let (taken, source) = memory_taken(|| {
        let source = open(&[path], &OpenOptions::default()).unwrap();
        source.read_box(0, 0, source.info().extent.full_box(), &mut plane).unwrap();
        source
    });
    let said = source.reader_bytes();
    assert!(taken <= said + (3 << 20) && said < 2 << 20, "took {taken}, said {said}");
    assert_eq!(plane[SIZE * SIZE - 1], ((SIZE * SIZE - 1) % 251) as u8);
}
