//! Bitmaps: frames of one bit a pixel, packed without gaps between rows or frames, the first pixel in the lowest bit. Read frame by frame.

use super::frames::{check_frames, frame_count};
use super::header::{EXPLICIT_BIG_ENDIAN, Header};
use crate::error::{ImportError, Result};
use brickyard_volume::{VoxelBox, counted};
use dicom_dictionary_std::tags;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};

/// Frames of one bit a pixel in a file.
#[derive(Debug)]
pub(super) struct Bits {
    columns: u32,
    rows: u32,
    count: u64,
    /// First byte of the pixels.
    offset: u64,
}

impl Bits {
    /// Finds the frames of a file by its header, and checks that the file holds them all.
    pub(super) fn find(header: &Header) -> Result<Self> {
        let path = header.path.as_path();
        let whole = |tag, name: &str| {
            let number = header.number(tag).filter(|n| n.fract() == 0.0 && (1.0..=65535.0).contains(n));
            let problem = || format!("{name} {tag} is missing or not a whole number from 1 on; write the file again");
            number.map(|n| n as u32).ok_or_else(|| ImportError::invalid(path, problem()))
        };
        let [rows, columns] = [whole(tags::ROWS, "Rows")?, whole(tags::COLUMNS, "Columns")?];
        let allocated = whole(tags::BITS_ALLOCATED, "BitsAllocated")?;
        if allocated != 1 {
            let problem = format!(
                "SegmentationType is BINARY, of 1 bit a pixel, and BitsAllocated {allocated}; write the file again"
            );
            return Err(ImportError::invalid(path, problem));
        }
        let pixels = header.pixels.filter(|pixels| pixels.tag == tags::PIXEL_DATA);
        let Some(pixels) = pixels else {
            return Err(ImportError::invalid(
                path,
                "expected pixel data after the header, found none; fetch the file again",
            ));
        };
        let (Some(length), false) = (pixels.length, header.is_deflated() || header.syntax == EXPLICIT_BIG_ENDIAN)
        else {
            let feature = format!("a bitmap in transfer syntax {}", header.syntax_name());
            return Err(ImportError::unsupported_but(
                path,
                feature,
                "decompress it, as gdcmconv --raw or dcmconv +te does",
            ));
        };
        let count = frame_count(header)?;
        check_frames(header, count)?;
        let end = std::fs::metadata(path).map_err(ImportError::io(path))?.len();
        let expected = (u64::from(rows) * u64::from(columns)).saturating_mul(count).div_ceil(8);
        let found = length.min(end.saturating_sub(pixels.offset));
        if found < expected {
            let problem = format!(
                "cut short: {} of {columns} x {rows} bits are {expected} bytes, found {found}; fetch the file again",
                counted(count, "frame")
            );
            return Err(ImportError::invalid(path, problem));
        }
        // As where each frame begins at a byte of its own, against the standard.
        if length > expected.next_multiple_of(2) {
            let problem = format!(
                "{} of {columns} x {rows} bits are {expected} bytes, found {length}: how frames are packed is not known; write \
                 it again",
                counted(count, "frame")
            );
            return Err(ImportError::invalid(path, problem));
        }
        header.confirm()?;
        Ok(Self { columns, rows, count, offset: pixels.offset })
    }

    pub(super) fn count(&self) -> usize {
        self.count as usize
    }

    /// Columns and rows of a frame.
    pub(super) fn size(&self) -> [u32; 2] {
        [self.columns, self.rows]
    }

    fn pixels(&self) -> u64 {
        u64::from(self.columns) * u64::from(self.rows)
    }

    /// Most memory for reading one frame, in bytes.
    pub(super) fn reader_bytes(&self) -> u64 {
        self.pixels().div_ceil(8) + 1
    }

    /// Reads a frame: bits from the lowest bit of the first byte on, zeros after the last.
    pub(super) fn read(&self, header: &Header, frame: usize) -> Result<Vec<u8>> {
        let path = header.path.as_path();
        let (first, pixels) = (frame as u64 * self.pixels(), self.pixels());
        let shift = first % 8;
        let mut bytes = vec![0; (shift + pixels).div_ceil(8) as usize];
        let read = File::open(path).and_then(|mut file| {
            file.seek(SeekFrom::Start(self.offset + first / 8))?;
            file.read_exact(&mut bytes)
        });
        // The bytes, or an error, count only if the file is unchanged since its header was read.
        header.confirm()?;
        read.map_err(ImportError::io(path))?;
        if shift > 0 {
            for i in 0..bytes.len() {
                let next = bytes.get(i + 1).copied().unwrap_or(0);
                bytes[i] = (bytes[i] >> shift) | (next << (8 - shift));
            }
        }
        bytes.truncate(pixels.div_ceil(8) as usize);
        if let Some(last) = bytes.last_mut().filter(|_| pixels % 8 > 0) {
            *last &= (1 << (pixels % 8)) - 1;
        }
        Ok(bytes)
    }

    /// Calls `set` with the index, within the x, y rectangle of `region`, of each set pixel of a frame.
    pub(super) fn each_set(&self, frame: &[u8], region: VoxelBox, mut set: impl FnMut(usize)) {
        let width = region.extent().x as usize;
        for (row, y) in (region.min.y..region.max.y).enumerate() {
            for (column, x) in (region.min.x..region.max.x).enumerate() {
                let pixel = y as usize * self.columns as usize + x as usize;
                if frame[pixel / 8] >> (pixel % 8) & 1 == 1 {
                    set(row * width + column);
                }
            }
        }
    }
}
