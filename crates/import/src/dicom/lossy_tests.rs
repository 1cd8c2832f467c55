//! Lossy pictures: numbers outside the stored range are clamped, at both ends, never wrapped.
//!
//! All are 16 x 16 pixels in squares of 4, of the least and the greatest number of 7 to 16 bits, packed so strongly that
//! decoded numbers overshoot both ends: by OpenJPEG, irreversibly, and by libjpeg.

use super::tests::{Written, voxels};
use crate::error::ImportError;
use crate::open::open;
use crate::options::OpenOptions;
use base64::Engine;
use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};

const LOSSY_8: &str = "\
    /0//UQApAAAAAAAQAAAAEAAAAAAAAAAAAAAAEAAAABAAAAAAAAAAAAABBwEB/1IADgECAAEAAQQEAACIiP9cAAtCSCRX01fTV2L/ZAAlAAFDcm\
    VhdGVkIGJ5IE9wZW5KUEVHIHZlcnNpb24gMi41LjT/kAAKAAAAAABjAAH/k98agBXYl5+ONnhkwEXHzhMq6zcKFTUM2DYuNZNOYMFyeIMQzTpl\
    xrRloKHHGxx0KkAXBRm5hcN1FjUWOaSsDBoV4oJLEkMfLD5N9zYV2Kk9VOS2d5r/2Q==";
const LOSSY_12: &str = "\
    /0//UQApAAAAAAAQAAAAEAAAAAAAAAAAAAAAEAAAABAAAAAAAAAAAAABCwEB/1IADgECAAEAAQQEAACIiP9cAAtCaCR303fTd2L/ZAAlAAFDcm\
    VhdGVkIGJ5IE9wZW5KUEVHIHZlcnNpb24gMi41LjT/kAAKAAAAAABjAAH/k98agBXYl5+ONnhkwEXHzhMq6zcKFTUM2DYuNZNOYMFyeIMQzTpl\
    xrRloKHHGxx0KkAXBRm5hcN1FjUWOaSsDBoV4oJLEkMfLD5N9zYV2Kk9VOS2d5r/2Q==";
const LOSSY_16: &str = "\
    /0//UQApAAAAAAAQAAAAEAAAAAAAAAAAAAAAEAAAABAAAAAAAAAAAAABDwEB/1IADgECAAEAAQQEAACIiP9cAAtCiCSX05fTl2L/ZAAlAAFDcm\
    VhdGVkIGJ5IE9wZW5KUEVHIHZlcnNpb24gMi41LjT/kAAKAAAAAABjAAH/k98agBXYl5+ONnhkwEXHzhMq6zcKFTUM2DYuNZNOYMFyeIMQzTpl\
    xrRloKHHGxx0KkAXBRm5hcN1FjUWOaSsDBoV4oJLEkMfLD5N9zYV2Kk9VOS2d5r/2Q==";
const LOSSY_12_IN_16: &str = "\
    /0//UQApAAAAAAAQAAAAEAAAAAAAAAAAAAAAEAAAABAAAAAAAAAAAAABDwEB/1IADgECAAEAAQQEAACIiP9cAAtCiCSX05fTl2L/ZAAlAAFDcm\
    VhdGVkIGJ5IE9wZW5KUEVHIHZlcnNpb24gMi41LjT/kAAKAAAAAABsAAH/k995gBYA/3zp6xMTfAHCYt+b9VgC4NhKXko5xhiVaJIpkTpG6Qql\
    mUxGCAipbvkmFhfFvcBxsBx0AqQXBRm5hcN1FjUWOaSsDBoV4oJLEkMfLD5N9zYV2Kk9VOS2d5r/2Q==";
const BASELINE_7: &str = "\
    /9j/4AAQSkZJRgABAQAAAQABAAD/2wBDAA0JCgsKCA0LCgsODg0PEyAVExISEyccHhcgLikxMC4pLSwzOko+MzZGNywtQFdBRkxOUlNSMj5aYV\
    pQYEpRUk//wAALCAAQABABAREA/8QAFQABAQAAAAAAAAAAAAAAAAAAAAb/xAAdEAABAgcAAAAAAAAAAAAAAAASABEUMjZkgpGh/9oACAEBAAA/\
    AJelbqKwEdvNxKVuorAR283EpW6isBHbzcSlbqKwEdvNxf/Z";

/// Storage of pixels.
#[derive(Clone, Copy)]
struct Stored {
    bits: u16,
    signed: bool,
    intercept: i32,
}

fn stream(text: &str) -> Vec<u8> {
    base64::engine::general_purpose::STANDARD.decode(text).unwrap()
}

fn decoded(stream: &[u8], syntax: &str, stored: Stored) -> Result<Vec<f64>, ImportError> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a");
    let mut slice = Written::slice(0.0, 0);
    let numbers = [
        (tags::ROWS, 16),
        (tags::COLUMNS, 16),
        (tags::BITS_ALLOCATED, if stored.bits > 8 { 16 } else { 8 }),
        (tags::BITS_STORED, stored.bits),
        (tags::HIGH_BIT, stored.bits - 1),
        (tags::PIXEL_REPRESENTATION, stored.signed.into()),
    ];
    for (tag, number) in numbers {
        slice.number(tag, number);
    }
    slice.text(tags::RESCALE_SLOPE, VR::DS, "1");
    slice.text(tags::RESCALE_INTERCEPT, VR::DS, &stored.intercept.to_string());
    // Fragments have an even number of bytes.
    let padding = vec![0; stream.len() % 2];
    slice.fragments(vec![[stream, &padding].concat()]).save(&path, syntax);
    let source = open(&[path], &OpenOptions::default())?;
    let bytes = source.info().extent.volume() as usize * source.info().voxel_type.bytes();
    source.read_box(0, 0, source.info().extent.full_box(), &mut vec![0; bytes])?;
    Ok(voxels(&*source))
}

/// Checks that every pixel is near its original, and that both ends occur.
#[track_caller]
fn assert_squares(found: &[f64], stored: Stored) {
    let range = f64::from((1u32 << stored.bits) - 1);
    let least = if stored.signed { -(range + 1.0) / 2.0 } else { 0.0 } + f64::from(stored.intercept);
    let greatest = least + range;
    for (i, value) in found.iter().enumerate() {
        let is_low = (i % 16 / 4 + i / 64).is_multiple_of(2);
        let expected = if is_low { least } else { greatest };
        // OpenJPEG's own decoder is wrong by at most 0.16 of the range.
        assert!((value - expected).abs() <= 0.2 * range, "pixel {i}: {value} for {expected}");
        assert!((least..=greatest).contains(value), "pixel {i}: {value}");
    }
    let ends = [least, greatest].map(|end| found.iter().filter(|v| **v == end).count());
    assert!(ends[0] >= 10 && ends[1] >= 10, "{ends:?} pixels are at the ends");
}

#[test]
fn lossy_jpeg_2000_is_clamped_at_both_ends() {
    for (text, bits) in [(LOSSY_8, 8), (LOSSY_12, 12), (LOSSY_16, 16), (LOSSY_12_IN_16, 12)] {
        for (signed, intercept) in [(false, 0), (false, -1024), (true, 0), (true, -1024)] {
            let mut stream = stream(text);
            if signed && text == LOSSY_12_IN_16 {
                continue;
            }
            if signed {
                // The numbers after the shift by half their range are the same.
                let start = stream.windows(4).position(|w| w == [0xff, 0x4f, 0xff, 0x51]).unwrap();
                stream[start + 42] |= 0x80;
            }
            let stored = Stored { bits, signed, intercept };
            assert_squares(&decoded(&stream, uids::JPEG2000, stored).unwrap(), stored);
        }
    }
}

#[test]
fn lossy_jpeg_of_fewer_than_eight_bits_is_clamped() {
    let stored = Stored { bits: 7, signed: false, intercept: 0 };
    assert_squares(&decoded(&stream(BASELINE_7), uids::JPEG_BASELINE8_BIT, stored).unwrap(), stored);
}

#[test]
fn jpeg_2000_that_is_cut_short_is_refused() {
    let whole = stream(LOSSY_12);
    let stored = Stored { bits: 12, signed: false, intercept: 0 };
    for length in 1..whole.len() {
        assert!(decoded(&whole[..length], uids::JPEG2000, stored).is_err(), "{length} of {} bytes", whole.len());
    }
}
