//! LZW strips and tiles, which the `tiff` crate reports as cut short where a row ends within a code's string; and the
//! predictors between packed bytes and samples.
//!
//! As in libtiff, a chunk ends with its last byte, with or without an end code.

use crate::element::Endian;
use weezl::decode::{Configuration, Decoder};
use weezl::{BitOrder, LzwStatus};

/// Upper bound on the ratio of unpacked to packed bytes: a code of 9 to 12 bits expands to less than 4096 bytes.
pub(super) const BEST_RATIO: u64 = 4096;

/// Transformation of a row's bytes before packing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Predictor {
    None,
    /// Each number is the difference from the same sample of the pixel before.
    Horizontal,
    /// The bytes of a row of floats are sorted by significance, the highest first, and stored as differences.
    Floats,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Rows {
    pub(super) predictor: Predictor,
    pub(super) endian: Endian,
    /// Bytes of a number.
    pub(super) width: usize,
    /// Numbers of a pixel that lie side by side.
    pub(super) samples: usize,
    /// Bytes of an unpacked row, including a tile's part past the image.
    pub(super) bytes: usize,
}

/// Unpacks LZW data into `out` until it is full. The error gives the number of bytes if too few.
pub(super) fn unpack(packed: &[u8], out: &mut [u8]) -> Result<(), String> {
    let mut decoder = decoder_of(packed);
    let (mut from, mut to) = (0, 0);
    while to < out.len() {
        let result = decoder.decode_bytes(&packed[from..], &mut out[to..]);
        from += result.consumed_in;
        to += result.consumed_out;
        let stuck = result.consumed_in == 0 && result.consumed_out == 0;
        match result.status {
            Ok(LzwStatus::Ok) if !stuck => {}
            _ if to >= out.len() => {}
            Ok(_) => return Err(format!("its {} packed bytes hold {to} of {} bytes", packed.len(), out.len())),
            Err(error) => return Err(format!("{error}, after {to} of {} bytes", out.len())),
        }
    }
    Ok(())
}

/// Streams from before TIFF 5.0 have reversed bits, and codes that grow one number later.
fn decoder_of(packed: &[u8]) -> Decoder {
    // Starts with the clear code, 256 in nine bits.
    let configuration = match packed {
        [0, second, ..] if second & 1 == 1 => Configuration::new(BitOrder::Lsb, 8),
        _ => Configuration::with_tiff_size_switch(BitOrder::Msb, 8),
    };
    configuration.with_yield_on_full_buffer(true).build()
}

/// Undoes the predictor of consecutive unpacked rows, and converts their numbers to this machine's byte order.
pub(super) fn undo(bytes: &mut [u8], rows: Rows) {
    for row in bytes.chunks_exact_mut(rows.bytes) {
        if rows.predictor != Predictor::Floats && rows.endian != Endian::native() {
            row.chunks_exact_mut(rows.width).for_each(<[u8]>::reverse);
        }
        match (rows.predictor, rows.width) {
            (Predictor::None, _) => {}
            (Predictor::Horizontal, 1) => add_up(row, rows.samples, |a: [u8; 1], b| [a[0].wrapping_add(b[0])]),
            (Predictor::Horizontal, 2) => add_up(row, rows.samples, |a, b| {
                u16::from_ne_bytes(a).wrapping_add(u16::from_ne_bytes(b)).to_ne_bytes()
            }),
            (Predictor::Horizontal, 4) => add_up(row, rows.samples, |a, b| {
                u32::from_ne_bytes(a).wrapping_add(u32::from_ne_bytes(b)).to_ne_bytes()
            }),
            (Predictor::Horizontal, _) => add_up(row, rows.samples, |a, b| {
                u64::from_ne_bytes(a).wrapping_add(u64::from_ne_bytes(b)).to_ne_bytes()
            }),
            (Predictor::Floats, width) => {
                add_up(row, rows.samples, |a: [u8; 1], b| [a[0].wrapping_add(b[0])]);
                let sorted = row.to_vec();
                let count = row.len() / width;
                for (i, number) in row.chunks_exact_mut(width).enumerate() {
                    for (weight, byte) in number.iter_mut().enumerate() {
                        *byte = sorted[weight * count + i];
                    }
                    if Endian::native() == Endian::Little {
                        number.reverse();
                    }
                }
            }
        }
    }
}

/// Adds to each number the one `stride` before it.
fn add_up<const N: usize>(row: &mut [u8], stride: usize, add: impl Fn([u8; N], [u8; N]) -> [u8; N]) {
    let (numbers, _) = row.as_chunks_mut::<N>();
    for i in stride..numbers.len() {
        numbers[i] = add(numbers[i], numbers[i - stride]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use weezl::encode::Encoder;

    /// Bytes that compress more or less well: runs, ramps and noise of few or many values.
    fn bytes() -> impl Strategy<Value = Vec<u8>> {
        let piece = (any::<u8>(), 1..2000usize, 0..4u8, any::<u64>()).prop_map(|(value, count, kind, seed)| {
            (0..count as u64).map(move |i| match kind {
                0 => value,
                1 => value.wrapping_add(i as u8),
                2 => value ^ ((seed.wrapping_add(i).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 61) as u8),
                _ => (seed.wrapping_add(i).wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 56) as u8,
            })
        });
        prop::collection::vec(piece, 1..8).prop_map(|pieces| pieces.into_iter().flatten().collect())
    }

    proptest! {
        #![proptest_config(crate::testing::cases(300))]

        #[test]
        fn whatever_is_packed_is_unpacked(bytes in bytes(), wanted in any::<prop::sample::Index>(), rest in 0..3usize) {
            let mut packed = Encoder::with_tiff_size_switch(BitOrder::Msb, 8).encode(&bytes).unwrap();
            let old = Encoder::new(BitOrder::Lsb, 8).encode(&bytes).unwrap();
            // A tile's rows past the image are unwanted, and bytes after the end are ignored.
            let mut out = vec![0; wanted.index(bytes.len()) + 1];
            packed.extend(vec![0x55; rest]);
            for packed in [&packed, &old] {
                out.fill(0);
                prop_assert_eq!(unpack(packed, &mut out), Ok(()));
                prop_assert!(out == bytes[..out.len()]);
            }
            let mut more = vec![0; bytes.len() + 1];
            prop_assert!(unpack(&packed, &mut more).is_err());
            // Some writers omit the end code, so more is cut off: data, too.
            let shorter = &packed[..packed.len() - rest - 1];
            prop_assert!(unpack(&shorter[..shorter.len().saturating_sub(3)], &mut more).is_err());
        }

        #[test]
        fn damage_ends(damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..5), bytes in bytes()) {
            let mut packed = Encoder::with_tiff_size_switch(BitOrder::Msb, 8).encode(&bytes).unwrap();
            for (place, value) in damage {
                let place = place.index(packed.len());
                packed[place] = value;
            }
            let _ = unpack(&packed, &mut vec![0; bytes.len()]);
        }
    }

    #[test]
    fn an_end_without_its_code_is_an_end() {
        // Literals of nine bits: to clear, 1, 2, 3; and nothing more.
        let codes = [256u64, 1, 2, 3].iter().fold(0u64, |bits, code| bits << 9 | code) << 28;
        let packed = codes.to_be_bytes();
        let mut out = [0; 3];
        assert_eq!(unpack(&packed[..5], &mut out), Ok(()));
        assert_eq!(out, [1, 2, 3]);
        assert!(unpack(&packed[..4], &mut out).unwrap_err().contains("2 of 3 bytes"));
    }
}
