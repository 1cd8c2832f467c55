//! TIFF bytes as shown to the library, which refuses palette indices: the current page's PhotometricInterpretation is replaced, so that its pixels
//! pass for numbers. Costs a comparison for each read.

use std::fs::File;
use std::io::{BufReader, Read, Result, Seek, SeekFrom};
use tiff::decoder::Decoder;
use tiff::tags::{ByteOrder, Tag};

/// PhotometricInterpretation of indices into a palette, and of numbers, the least being black.
const PALETTE: u16 = 3;
const BLACK_IS_ZERO: u16 = 1;

/// A file with two bytes replaced.
pub(super) struct PageBytes {
    file: BufReader<File>,
    at: u64,
    /// Position and replacement of these bytes.
    changed: Option<(u64, [u8; 2])>,
}

impl PageBytes {
    pub(super) fn new(file: File) -> Self {
        Self { file: BufReader::new(file), at: 0, changed: None }
    }

    /// Ends the replacement.
    pub(super) fn as_it_is(&mut self) {
        self.changed = None;
    }
}

impl Read for PageBytes {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        let count = self.file.read(buffer)?;
        if let Some((place, bytes)) = self.changed {
            for (place, byte) in (place..).zip(bytes) {
                let at = place.checked_sub(self.at).map(|at| at as usize).filter(|at| *at < count);
                at.into_iter().for_each(|at| buffer[at] = byte);
            }
        }
        self.at += count as u64;
        Ok(count)
    }
}

impl Seek for PageBytes {
    fn seek(&mut self, to: SeekFrom) -> Result<u64> {
        self.at = self.file.seek(to)?;
        Ok(self.at)
    }
}

/// Whether the decoder's current page holds indices into a palette; it is then read again, as numbers. `page` is its number, from 0.
pub(super) fn as_numbers(decoder: &mut Decoder<PageBytes>, page: u32) -> tiff::TiffResult<bool> {
    let kind = decoder.find_tag_unsigned::<u16>(Tag::PhotometricInterpretation);
    let Some(directory) = decoder.ifd_pointer().filter(|_| matches!(kind, Ok(Some(PALETTE)))) else {
        return Ok(false);
    };
    let Some(place) = place_of_kind(decoder, directory.0)? else { return Ok(false) };
    let bytes = match decoder.byte_order() {
        ByteOrder::LittleEndian => BLACK_IS_ZERO.to_le_bytes(),
        ByteOrder::BigEndian => BLACK_IS_ZERO.to_be_bytes(),
    };
    decoder.inner().changed = Some((place, bytes));
    decoder.seek_to_image(page as usize)?;
    Ok(true)
}

/// Position of a directory's PhotometricInterpretation, if that is a short number, as in the standard.
fn place_of_kind(decoder: &mut Decoder<PageBytes>, directory: u64) -> Result<Option<u64>> {
    const SHORT: u16 = 3;
    decoder.goto_offset_u64(2)?;
    // A BigTIFF has 43 there, and longer entries.
    let is_big = decoder.read_short()? == 43;
    decoder.goto_offset_u64(directory)?;
    let (count, first, entry, value) = match is_big {
        true => (decoder.read_long8()?, directory + 8, 20, 12),
        false => (u64::from(decoder.read_short()?), directory + 2, 12, 8),
    };
    for place in (0..count).map(|i| first + i * entry) {
        decoder.goto_offset_u64(place)?;
        if decoder.read_short()? == Tag::PhotometricInterpretation.to_u16() {
            return Ok((decoder.read_short()? == SHORT).then_some(place + value));
        }
    }
    Ok(None)
}
