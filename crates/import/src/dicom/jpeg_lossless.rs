//! Lossless JPEG streams that the library would decode to other numbers, without an error: those with restarts, after which prediction starts
//! anew, those with a point transform, whose numbers are halved, and those of fewer than eight bits.
//!
//! A stream is taken apart at its restarts, and each part is decoded as a picture of its own; the bits cut off are put back as zeros.

use super::pixels::{PixelFormat, Samples};
use crate::element::Endian;
use std::ops::Range;

/// Markers.
const START: [u8; 2] = [0xff, 0xd8];
const END: [u8; 2] = [0xff, 0xd9];
const TABLES: u8 = 0xc4;
const LOSSLESS: u8 = 0xc3;
const SCAN: u8 = 0xda;
const RESTART_INTERVAL: u8 = 0xdd;
const RESTARTS: Range<u8> = 0xd0..0xd8;

/// Least bits of a number that the library decodes.
const LEAST_BITS: u8 = 2;

/// A stream of one component, taken apart.
pub(super) struct Stream<'a> {
    /// Markers up to the pixels, without a restart interval and a point transform.
    head: Vec<u8>,
    /// Byte of the precision in the head; the height follows.
    frame_at: usize,
    bits: u8,
    rows: u16,
    columns: u16,
    /// Pixels from one restart to the next; 0 without.
    interval: u16,
    /// Bits cut off from each number.
    shift: u8,
    pixels: &'a [u8],
}

impl<'a> Stream<'a> {
    /// Takes a stream apart; `None` if the library decodes it as it is, or reports what is wrong.
    pub(super) fn of(bytes: &'a [u8]) -> Option<Self> {
        let mut stream = Self {
            head: START.to_vec(),
            frame_at: 0,
            bits: 0,
            rows: 0,
            columns: 0,
            interval: 0,
            shift: 0,
            pixels: &[],
        };
        let mut at = START.len();
        loop {
            let &[0xff, marker, high, low] = bytes.get(at..)?.first_chunk()? else { return None };
            if marker == 0xff {
                at += 1;
                continue;
            }
            let end = at + 2 + usize::from(u16::from_be_bytes([high, low]));
            let segment = bytes.get(at + 4..end)?;
            match (marker, segment) {
                (LOSSLESS, &[bits, h1, h0, w1, w0, 1, ..]) => {
                    stream.frame_at = stream.head.len() + 4;
                    stream.bits = bits;
                    (stream.rows, stream.columns) = (u16::from_be_bytes([h1, h0]), u16::from_be_bytes([w1, w0]));
                }
                (RESTART_INTERVAL, &[high, low]) => stream.interval = u16::from_be_bytes([high, low]),
                (SCAN, &[1, .., approximation]) => stream.shift = approximation & 0xf,
                // Another process, or several components.
                (0xc0..=0xcf, _) if marker != TABLES => return None,
                (SCAN | RESTART_INTERVAL, _) => return None,
                _ => {}
            }
            if [LOSSLESS, TABLES, SCAN].contains(&marker) {
                stream.head.extend_from_slice(&bytes[at..end]);
            }
            at = end;
            if marker == SCAN {
                break;
            }
        }
        stream.pixels = &bytes[at..];
        let is_odd = stream.interval > 0 || stream.shift > 0 || stream.bits < 8;
        (is_odd && stream.frame_at > 0 && stream.rows > 0 && stream.columns > 0).then_some(stream)
    }

    /// Decodes the numbers.
    pub(super) fn decode(mut self, format: &PixelFormat) -> Result<Samples, String> {
        let width = if self.bits > 8 { 2 } else { 1 };
        format.check_decoded([self.columns.into(), self.rows.into()], width)?;
        let Some(bits) = self.bits.checked_sub(self.shift).filter(|bits| *bits >= LEAST_BITS) else {
            return Err(format!("numbers of {} bits, of which {} are cut off", self.bits, self.shift));
        };
        let columns = usize::from(self.columns);
        let rows_in_part = match usize::from(self.interval) {
            0 => usize::from(self.rows),
            interval if interval.is_multiple_of(columns) => interval / columns,
            interval => return Err(format!("expected restarts at the ends of rows of {columns}, found {interval}")),
        };
        let parts = parts(self.pixels).ok_or("its pixels have no end (EOI)")?;
        let expected = usize::from(self.rows).div_ceil(rows_in_part);
        if parts.len() != expected {
            return Err(format!("expected {expected} parts between restarts, found {}", parts.len()));
        }
        self.head[self.frame_at] = bits;
        // The point transform, in the last byte before the pixels.
        if let Some(last) = self.head.last_mut() {
            *last &= 0xf0;
        }
        let mut out = Vec::with_capacity(usize::from(self.rows) * columns * width);
        for (i, part) in parts.into_iter().enumerate() {
            let rows = rows_in_part.min(usize::from(self.rows) - i * rows_in_part);
            self.head[self.frame_at + 1..self.frame_at + 3].copy_from_slice(&(rows as u16).to_be_bytes());
            let picture = [&self.head, part, &END].concat();
            let mut decoder = jpeg_decoder::Decoder::new(&picture[..]);
            let decoded = decoder.decode().map_err(|error| error.to_string())?;
            let put = |number: u16| out.extend_from_slice(&(number << self.shift).to_le_bytes()[..width]);
            match decoded.len() / (rows * columns) {
                1 => decoded.iter().map(|byte| u16::from(*byte)).for_each(put),
                _ => decoded.as_chunks().0.iter().map(|bytes| u16::from_ne_bytes(*bytes)).for_each(put),
            }
        }
        let expected = usize::from(self.rows) * columns * width;
        if out.len() != expected {
            return Err(format!("expected {expected} bytes of pixels, found {}", out.len()));
        }
        Ok(Samples::decoded(out, width, Endian::Little))
    }
}

/// Coded pixels between restarts, up to the next other marker; `None` without one.
fn parts(pixels: &[u8]) -> Option<Vec<&[u8]>> {
    let (mut parts, mut start, mut at) = (Vec::new(), 0, 0);
    while let Some(&[a, b]) = pixels.get(at..).and_then(|rest| rest.first_chunk()) {
        match (a, b) {
            // A byte of ones among the pixels is followed by one of zeros.
            (0xff, 0) => at += 2,
            (0xff, marker) if RESTARTS.contains(&marker) => {
                parts.push(&pixels[start..at]);
                at += 2;
                start = at;
            }
            (0xff, marker) if marker != 0xff => {
                parts.push(&pixels[start..at]);
                return Some(parts);
            }
            _ => at += 1,
        }
    }
    None
}
