//! A file in a zip archive: where it lies, and its bytes.

use super::Archive;
use crate::error::{ImportError, Result};
use flate2::Crc;
use flate2::bufread::DeflateDecoder;
use std::fs::File;
use std::io::{BufReader, Error, ErrorKind, Read, Seek, SeekFrom};
use std::path::Path;
use zip::CompressionMethod;

const ADVICE: &str = "write it with numpy.savez or numpy.savez_compressed";

pub(super) struct Member {
    pub(super) name: String,
    /// Bytes when inflated, by the archive.
    pub(super) bytes: u64,
    /// Bytes in the archive.
    pub(super) stored_bytes: u64,
    start: u64,
    is_stored: bool,
    checksum: u32,
}

impl Member {
    pub(super) fn of(path: &Path, archive: &mut Archive, number: usize) -> Result<Self> {
        let damaged = |problem: String| {
            ImportError::invalid(path, format!("damaged zip archive: {problem}; fetch the file again"))
        };
        let file = archive.by_index_raw(number).map_err(|error| damaged(error.to_string()))?;
        let name = String::from_utf8_lossy(file.name_raw()).chars().filter(|c| !c.is_control()).collect();
        if file.encrypted() {
            return Err(ImportError::unsupported_but(path, format!("the encrypted file {name}"), ADVICE));
        }
        let is_stored = match file.compression() {
            CompressionMethod::STORE => true,
            CompressionMethod::DEFLATE => false,
            method => {
                let feature = format!("{name}, compressed by {},", name_of(method));
                return Err(ImportError::unsupported_but(path, feature, ADVICE));
            }
        };
        let start = file.data_start().ok_or_else(|| damaged(format!("{name} has no place")))?;
        let (bytes, stored_bytes, checksum) = (file.size(), file.compressed_size(), file.crc32());
        if is_stored && bytes != stored_bytes {
            return Err(damaged(format!("{name} has {bytes} bytes, but {stored_bytes} are stored")));
        }
        let length = std::fs::metadata(path).map_err(ImportError::io(path))?.len();
        if start.checked_add(stored_bytes).is_none_or(|end| end > length) {
            return Err(damaged(format!("{name} has {stored_bytes} bytes from byte {start} on, of {length} in all")));
        }
        Ok(Self { name, bytes, stored_bytes, start, is_stored, checksum })
    }

    /// Place of a file that lies in the archive as it is.
    pub(super) fn stored_at(&self) -> Option<u64> {
        self.is_stored.then_some(self.start)
    }

    /// The file's bytes; its length and checksum are verified at the end of compressed ones.
    pub(super) fn reader(&self, path: &Path) -> Result<Box<dyn Read>> {
        let mut file = File::open(path).map_err(ImportError::io(path))?;
        file.seek(SeekFrom::Start(self.start)).map_err(ImportError::io(path))?;
        let coded = BufReader::with_capacity(1 << 18, file.take(self.stored_bytes));
        Ok(match self.is_stored {
            true => Box::new(coded),
            false => Box::new(Verified {
                inflated: DeflateDecoder::new(coded),
                crc: Crc::new(),
                count: 0,
                bytes: self.bytes,
                checksum: self.checksum,
            }),
        })
    }
}

fn name_of(method: CompressionMethod) -> String {
    match method {
        CompressionMethod::BZIP2 => "bzip2".into(),
        CompressionMethod::LZMA => "LZMA".into(),
        CompressionMethod::ZSTD => "Zstandard".into(),
        CompressionMethod::XZ => "xz".into(),
        method => format!("another method ({method:?})"),
    }
}

/// Inflated bytes that end in an error unless they are as many as the archive says, with its checksum.
struct Verified<R> {
    inflated: R,
    crc: Crc,
    count: u64,
    bytes: u64,
    checksum: u32,
}

impl<R: Read> Read for Verified<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let count = self.inflated.read(buffer)?;
        self.crc.update(&buffer[..count]);
        self.count += count as u64;
        let is_end = count == 0 && !buffer.is_empty();
        let problem = match () {
            () if self.count > self.bytes => format!("more than the {} bytes that the archive says", self.bytes),
            () if is_end && self.count < self.bytes => format!("{} of {} bytes", self.count, self.bytes),
            () if is_end && self.crc.sum() != self.checksum => "the checksum differs".into(),
            () => return Ok(count),
        };
        Err(Error::new(ErrorKind::InvalidData, problem))
    }
}
