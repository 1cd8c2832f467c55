use super::jpeg::{GRAY, segment};
use super::png::{Picture, chunk, gray};
use super::*;
use proptest::prelude::*;

/// A gray picture of few pixels, with remarks.
fn small_png() -> Vec<u8> {
    let numbers: Vec<u16> = (0..99).map(|i| i * 7 % 256).collect();
    gray(11, 9, &numbers, &chunk(b"pHYs", &[0, 0, 7, 0, 0, 0, 7, 0, 1]))
}

#[test]
fn every_damaged_byte_of_a_png_is_refused() {
    let file = small_png();
    for at in 0..file.len() {
        let mut damaged = file.clone();
        damaged[at] ^= 0x10;
        let message = refusal("a.png", &damaged);
        assert!(message.contains("a.png: "), "{at}: {message}");
    }
}

#[test]
fn files_cut_short_are_refused() {
    for (name, file) in [("a.png", small_png()), ("a.jpg", GRAY.file())] {
        for end in 1..file.len() {
            let message = refusal(name, &file[..end]);
            assert!(!message.contains("No such"), "{name} {end}: {message}");
        }
        for end in [file.len() - 3, file.len() - 10] {
            assert!(refusal(name, &file[..end]).contains("cut short"), "{name} {end}");
        }
    }
    let mut lost = small_png();
    // A checksum past the pixels: that of Deflate, and its chunk's made anew.
    let at = lost.windows(4).position(|word| word == b"IDAT").unwrap();
    let length = u32::from_be_bytes(*lost[at - 4..].first_chunk().unwrap()) as usize;
    let mut data = lost[at + 4..at + 4 + length].to_vec();
    *data.last_mut().unwrap() ^= 1;
    lost.splice(at - 4..at + 8 + length, chunk(b"IDAT", &data));
    assert!(refusal("a.png", &lost).contains("cannot be decoded as PNG"), "{}", refusal("a.png", &lost));
}

/// No header can ask for more memory than its file allows.
#[test]
fn sizes_that_no_file_can_hold_are_refused() {
    for size in [[u32::MAX >> 1; 2], [1, u32::MAX >> 1], [u32::MAX >> 1, 1]] {
        let mut file = small_png();
        let header = [&size[0].to_be_bytes()[..], &size[1].to_be_bytes(), &[8, 0, 0, 0, 0]].concat();
        file.splice(8..33, chunk(b"IHDR", &header));
        let message = refusal("a.png", &file);
        assert!(message.contains("cut short") || message.contains("cannot be decoded"), "{message}");
    }
}

fn samples() -> Vec<(&'static str, Vec<u8>)> {
    let numbers: Vec<u16> = (0..99 * 4).map(|i| i * 7 % 4).collect();
    let picture = |bits, colour, is_interlaced, chunks| {
        Picture { width: 11, height: 9, bits, colour, is_interlaced, chunks, numbers: &numbers }.file()
    };
    let exif = segment(0xe1, b"Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0");
    let mut bmp = [b"BM", &[0; 8][..], &[62, 0, 0, 0, 40, 0, 0, 0, 5, 0, 0, 0, 3, 0, 0, 0, 1, 0, 1, 0]].concat();
    bmp.resize(54 + 8 + 12, 3);
    bmp[30..54].fill(0);
    vec![
        ("a.png", small_png()),
        ("a.png", picture(16, 6, true, vec![])),
        ("a.png", picture(2, 3, true, chunk(b"PLTE", &[9; 12]))),
        ("a.jpg", super::jpeg::Blocks { segments: exif, ..GRAY }.file()),
        ("a.jpg", super::jpeg::Blocks { frame: 0xc2, ids: &[1, 2, 3], means: &[9; 12], ..GRAY }.file()),
        ("a.bmp", bmp),
    ]
}

proptest! {
    #![proptest_config(crate::testing::cases(300))]

    /// Damage leads to an error or other pixels, never to a panic.
    #[test]
    fn damaged_pictures_do_not_panic(
        damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        which in any::<prop::sample::Index>(),
        are_labels in any::<bool>(),
    ) {
        let samples = samples();
        let (name, mut bytes) = samples[which.index(samples.len())].clone();
        for (place, value) in damage {
            let place = place.index(bytes.len());
            bytes[place] = value;
        }
        if name == "a.png" {
            // Checksums would catch all of it.
            bytes = with_checksums(&bytes);
        }
        let (_folder, path) = temp_file(name, &bytes);
        let _ = read_all(&path, &OpenOptions { are_labels: Some(are_labels), ..OpenOptions::default() });
    }
}

/// Makes the checksums of chunks anew, as far as their lengths lead.
fn with_checksums(file: &[u8]) -> Vec<u8> {
    let (mut fixed, mut rest) = (file[..8].to_vec(), &file[8..]);
    while let Some((length, after)) = rest.split_first_chunk::<4>() {
        let length = u32::from_be_bytes(*length) as usize;
        let Some((kind, after)) = after.split_first_chunk::<4>().filter(|(_, after)| after.len() >= length + 4) else {
            break;
        };
        fixed.extend(chunk(kind, &after[..length]));
        rest = &after[length + 4..];
    }
    fixed.extend(rest);
    fixed
}
