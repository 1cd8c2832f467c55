//! Unpacking of mode 101: two numbers of 4 bits in a byte, the first in its lower half, each row from a byte of its own on. A number becomes a
//! byte. Costs a pass over the file, into scratch space.

use std::io::{BufRead, BufReader, Read, Result};

/// A file's header as it is, then its numbers.
pub(super) struct Nibbles<R> {
    file: BufReader<R>,
    header_left: u64,
    /// Numbers of a row, and the place in it.
    columns: u32,
    column: u32,
    /// The upper half of the last byte, if it is the next number.
    upper: Option<u8>,
}

impl<R: Read> Nibbles<R> {
    pub(super) fn new(file: R, header_bytes: u64, columns: u32) -> Self {
        let file = BufReader::with_capacity(1 << 18, file);
        Self { file, header_left: header_bytes, columns, column: 0, upper: None }
    }

    /// Counts a number; whether its row goes on.
    fn step(&mut self) -> bool {
        self.column += 1;
        let goes_on = self.column < self.columns;
        if !goes_on {
            self.column = 0;
        }
        goes_on
    }
}

impl<R: Read> Read for Nibbles<R> {
    fn read(&mut self, out: &mut [u8]) -> Result<usize> {
        if self.header_left > 0 {
            let count = (&mut self.file).take(self.header_left).read(out)?;
            self.header_left -= count as u64;
            return Ok(count);
        }
        let mut count = 0;
        for number in out {
            *number = match self.upper.take() {
                Some(upper) => {
                    self.step();
                    upper
                }
                None => {
                    let Some(byte) = self.file.fill_buf()?.first().copied() else { break };
                    self.file.consume(1);
                    self.upper = self.step().then_some(byte >> 4);
                    byte & 15
                }
            };
            count += 1;
        }
        Ok(count)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_begin_with_the_lower_half_of_a_byte() {
        let unpacked = |columns, packed: &[u8]| {
            let mut out = Vec::new();
            Nibbles::new(packed, 2, columns).read_to_end(&mut out).unwrap();
            out
        };
        assert_eq!(unpacked(4, &[9, 99, 0x21, 0x43, 0xf0, 0x0e]), [9, 99, 1, 2, 3, 4, 0, 15, 14, 0]);
        assert_eq!(unpacked(3, &[9, 99, 0x21, 0xd3, 0xf0, 0xee]), [9, 99, 1, 2, 3, 0, 15, 14]);
        assert_eq!(unpacked(1, &[9, 99, 0x21, 0xd3]), [9, 99, 1, 3]);
        assert_eq!(unpacked(5, &[9]), [9]);
        // Whatever the size of a read.
        let mut file = Nibbles::new(&[7, 0x21, 0xd3, 0x54, 0xf6][..], 1, 3);
        let bytes: Vec<u8> = std::iter::from_fn(|| {
            let mut byte = [0];
            (file.read(&mut byte).unwrap() == 1).then_some(byte[0])
        })
        .collect();
        assert_eq!(bytes, [7, 1, 2, 3, 4, 5, 6]);
    }
}
