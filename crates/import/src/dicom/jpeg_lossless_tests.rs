//! Lossless JPEG streams of all kinds that the library misreads.

use super::tests::{Written, voxels};
use crate::error::ImportError;
use crate::open::open;
use crate::options::OpenOptions;
use dicom_dictionary_std::{tags, uids};

/// A writer of lossless JPEG (process 14, predictor 1: the pixel to the left).
#[derive(Clone, Copy)]
pub(super) struct Lossless {
    pub(super) bits: u8,
    pub(super) columns: u16,
    /// Bits cut off from each number.
    pub(super) shift: u8,
    /// Rows from one restart to the next; 0 without.
    pub(super) rows_to_restart: u16,
}

impl Lossless {
    pub(super) fn packed(self, pixels: &[u16]) -> Vec<u8> {
        let Self { bits, columns, shift, rows_to_restart } = self;
        let columns_here = usize::from(columns);
        let rows = (pixels.len() / columns_here) as u16;
        let [r, c] = [rows.to_be_bytes(), columns.to_be_bytes()];
        let mut out = vec![0xff, 0xd8];
        if rows_to_restart > 0 {
            let interval = (columns * rows_to_restart).to_be_bytes();
            out.extend([0xff, 0xdd, 0, 4, interval[0], interval[1]]);
        }
        out.extend([0xff, 0xc3, 0, 11, bits, r[0], r[1], c[0], c[1], 1, 1, 0x11, 0]);
        // One table: sixteen lengths of difference, each with a code of five bits, its own number.
        out.extend([0xff, 0xc4, 0, 35, 0, 0, 0, 0, 0, 16, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        out.extend(0..16);
        out.extend([0xff, 0xda, 0, 8, 1, 1, 0, 1, 0, shift]);
        let part = if rows_to_restart > 0 { columns_here * usize::from(rows_to_restart) } else { pixels.len() };
        for (number, pixels) in pixels.chunks(part).enumerate() {
            if number > 0 {
                out.extend([0xff, 0xd0 + (number as u8 - 1) % 8]);
            }
            let kept: Vec<i32> = pixels.iter().map(|pixel| i32::from(pixel >> shift)).collect();
            let mut coded = String::new();
            for (i, pixel) in kept.iter().enumerate() {
                let predicted = match (i, i % columns_here) {
                    (0, _) => 1 << (bits - shift - 1),
                    (_, 0) => kept[i - columns_here],
                    _ => kept[i - 1],
                };
                // Of numbers of 16 bits, as they wrap around.
                let difference = i32::from((pixel - predicted) as i16);
                let length = 32 - difference.unsigned_abs().leading_zeros() as usize;
                coded += &format!("{length:05b}");
                let code = if difference < 0 { difference - 1 } else { difference };
                coded += &format!("{code:032b}")[32 - length..];
            }
            for byte in coded.as_bytes().chunks(8) {
                // Filled up with ones; a byte of ones is followed by one of zeros.
                let text = format!("{:1<8}", std::str::from_utf8(byte).unwrap());
                let byte = u8::from_str_radix(&text, 2).unwrap();
                out.push(byte);
                if byte == 0xff {
                    out.push(0);
                }
            }
        }
        out.extend([0xff, 0xd9]);
        out
    }
}

/// Reads a picture of 4 x 3 pixels.
fn decoded(stream: Vec<u8>, bits: u8) -> Result<Vec<f64>, ImportError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    let mut slice = Written::slice(0.0, 0);
    slice.number(tags::BITS_STORED, bits.into()).number(tags::HIGH_BIT, u16::from(bits) - 1);
    slice.number(tags::BITS_ALLOCATED, if bits > 8 { 16 } else { 8 });
    slice.fragments(vec![stream]).save(&path, uids::JPEG_LOSSLESS);
    let source = open(&[path], &OpenOptions::default())?;
    let bytes = 12 * source.info().voxel_type.bytes();
    source.read_box(0, 0, source.info().extent.full_box(), &mut vec![0; bytes])?;
    Ok(voxels(&*source))
}

#[test]
fn restarts_and_point_transforms_give_the_same_numbers() {
    for bits in [16, 12, 8, 7, 6] {
        for (shift, rows_to_restart) in [(0, 0), (0, 1), (0, 2), (0, 3), (0, 9), (1, 0), (2, 1)] {
            let most = (1u32 << bits) - 1;
            let pixels: Vec<u16> = (1..13).map(|i| ((i * 7919 + i * i * 31) & most) as u16 >> shift << shift).collect();
            let stream = Lossless { bits, columns: 4, shift, rows_to_restart }.packed(&pixels);
            let expected: Vec<f64> = pixels.iter().map(|pixel| f64::from(*pixel)).collect();
            assert_eq!(decoded(stream, bits).unwrap(), expected, "{bits} bits, {shift}, {rows_to_restart}");
        }
    }
}

#[test]
fn lost_and_misplaced_restarts_are_refused() {
    let pixels: Vec<u16> = (0..12).collect();
    let stream = Lossless { bits: 12, columns: 4, shift: 0, rows_to_restart: 1 }.packed(&pixels);
    let refusal = |stream: &[u8]| decoded(stream.to_vec(), 12).unwrap_err().to_string();
    let at = stream.windows(2).position(|pair| pair == [0xff, 0xd1]).unwrap();
    let lost = [&stream[..at], &stream[at + 2..]].concat();
    let message = refusal(&lost);
    assert!(message.contains("expected 3 parts between restarts, found 2"), "{message}");
    let mut misplaced = stream.clone();
    misplaced[7] = 3;
    let message = refusal(&misplaced);
    assert!(message.contains("at the ends of rows of 4, found 3"), "{message}");
    let mut shifted = stream.clone();
    let scan = stream.windows(2).position(|pair| pair == [0xff, 0xda]).unwrap();
    shifted[scan + 9] = 15;
    let message = refusal(&shifted);
    assert!(message.contains("of which 15 are cut off"), "{message}");
    for cut in 0..stream.len() {
        assert!(decoded(stream[..cut].to_vec(), 12).is_err(), "{cut}");
    }
}
