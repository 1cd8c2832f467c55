//! The data of a header in text: behind it or in files of their own, plain or compressed, several joined in one stream.
//!
//! A plain array in one file is mapped where it lies. Coded and joined ones pass through a scratch file, with one data file open at a time.

use crate::body::Body;
use crate::error::{ImportError, Result};
use crate::files::folder_of;
use crate::gzip::GzipMembers;
use crate::note::Note;
use crate::raw::ArrayLayout;
use crate::stamp::Stamp;
use brickyard_volume::counted;
use flate2::bufread::ZlibDecoder;
use std::fs::File;
use std::io::{self, BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Most data files of a header: more than any scanner has slices.
pub(crate) const MOST_FILES: usize = 1 << 20;

/// Buffer for reading a data file.
const BUFFER_BYTES: usize = 1 << 18;

/// Encoding of each data file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Coding {
    Plain,
    Gzip,
    /// Zlib or, by its first bytes, gzip.
    Zlib,
}

/// First byte of the data in each file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Start {
    /// Bytes in the file before anything else.
    pub(crate) bytes: u64,
    /// Lines skipped after those, in the file itself.
    pub(crate) lines: u64,
    /// Bytes skipped after those, once decoded.
    pub(crate) decoded: u64,
    /// Whether the data are the last bytes of the file, wherever they start.
    pub(crate) is_last: bool,
}

/// The data files of a header.
#[derive(Clone, Debug)]
pub(crate) struct DataFiles {
    /// Paths in the array's order: the header's own for data behind it.
    pub(crate) paths: Vec<PathBuf>,
    pub(crate) coding: Coding,
    pub(crate) start: Start,
}

impl DataFiles {
    /// Opens the data of an array, whose offset is set to them. Adds notes on bytes that are left out. Several files hold equal parts.
    ///
    /// # Errors
    /// If a file is missing, no regular file, or too short.
    pub(crate) fn body(&self, header: &Path, array: &mut ArrayLayout, notes: &mut Vec<Note>) -> Result<Body> {
        let bytes = array.body_bytes().map_err(|problem| ImportError::invalid(header, problem))?;
        let [path] = &self.paths[..] else { return self.joined(header, bytes, notes) };
        check_file(header, path)?;
        if self.coding == Coding::Plain {
            array.offset = self.first_byte(path, bytes)?;
            return Ok(Body::Plain { path: path.clone() });
        }
        array.offset = self.start.decoded;
        let coded_bytes = Stamp::of(path)?.bytes;
        Ok(Body::Coded { path: path.clone(), coded_bytes, stream: self.stream(path, bytes)? })
    }

    /// States of all files, to be checked once the data have been read.
    pub(crate) fn stamps(&self, header: &Path) -> Result<Vec<Stamp>> {
        let stamp = |path: &PathBuf| check_file(header, path).and_then(|()| Stamp::of(path));
        self.paths.iter().map(stamp).collect()
    }

    /// Checks that no file has changed since.
    pub(crate) fn check_unchanged(&self, stamps: &[Stamp]) -> Result<()> {
        self.paths.iter().zip(stamps).try_for_each(|(path, stamp)| stamp.check(path))
    }

    /// One stream of the data in all files, without the skipped bytes.
    fn joined(&self, header: &Path, bytes: u64, notes: &mut Vec<Note>) -> Result<Body> {
        let count = self.paths.len() as u64;
        let part_bytes = match bytes.checked_rem(count) {
            Some(0) => bytes / count,
            _ => {
                let problem = format!("{bytes} bytes of voxels cannot lie in {count} data files of equal size");
                return Err(ImportError::invalid(header, problem));
            }
        };
        let mut longer = 0;
        for path in &self.paths {
            check_file(header, path)?;
            if self.coding == Coding::Plain {
                let end = self.first_byte(path, part_bytes)?.saturating_add(part_bytes);
                let found = Stamp::of(path)?.bytes;
                if found < end {
                    let missing = end - found;
                    let problem =
                        format!("cut short: its header implies {end} bytes, found {found} ({missing} missing)");
                    return Err(ImportError::invalid(path, problem));
                }
                longer += u64::from(found > end);
            }
        }
        if longer > 0 {
            notes.push(Note::warning(format!(
                "Bytes after the voxels are ignored in {longer} of {}.",
                counted(count, "data file")
            )));
        }
        let stream = Joined { files: self.clone(), part_bytes, next: 0, part: None };
        Ok(Body::Joined { path: header.to_owned(), files: count, stream: Box::new(stream) })
    }

    /// Offset of plain data in their file.
    fn first_byte(&self, path: &Path, bytes: u64) -> Result<u64> {
        if self.start.is_last {
            let found = Stamp::of(path)?.bytes;
            return found.checked_sub(bytes).ok_or_else(|| {
                let missing = bytes - found;
                let problem = format!(
                    "cut short: expected {bytes} bytes of voxels at its end, found {found} bytes ({missing} missing)"
                );
                ImportError::invalid(path, problem)
            });
        }
        let at = match self.start.lines {
            0 => self.start.bytes,
            _ => self.opened(path)?.stream_position().map_err(ImportError::io(path))?,
        };
        Ok(at.saturating_add(self.start.decoded))
    }

    /// Opens a file behind the bytes and lines before its data.
    fn opened(&self, path: &Path) -> Result<BufReader<File>> {
        let file = File::open(path).map_err(ImportError::io(path))?;
        let mut file = BufReader::with_capacity(BUFFER_BYTES, file);
        file.seek(SeekFrom::Start(self.start.bytes)).map_err(ImportError::io(path))?;
        for line in 0..self.start.lines {
            if skip_line(&mut file).map_err(ImportError::io(path))? {
                continue;
            }
            let problem = format!("cut short: {} lines are to be skipped, found {line}", self.start.lines);
            return Err(ImportError::invalid(path, problem));
        }
        Ok(file)
    }

    /// Decoded bytes of a file; those to be skipped are among them. `bytes` is what follows these.
    fn stream(&self, path: &Path, bytes: u64) -> Result<Box<dyn Read>> {
        if self.start.is_last {
            let mut file = File::open(path).map_err(ImportError::io(path))?;
            file.seek(SeekFrom::Start(self.first_byte(path, bytes)?)).map_err(ImportError::io(path))?;
            return Ok(Box::new(file));
        }
        let mut file = self.opened(path)?;
        let start = file.fill_buf().map_err(ImportError::io(path))?;
        Ok(match self.coding {
            Coding::Plain => Box::new(file),
            Coding::Zlib if !start.starts_with(&[0x1f, 0x8b]) => Box::new(ZlibDecoder::new(file)),
            Coding::Gzip | Coding::Zlib => Box::new(GzipMembers::new(file)),
        })
    }
}

/// The path of a data file as a header names it: beside the header unless it is absolute.
pub(crate) fn beside(header: &Path, name: &str) -> PathBuf {
    folder_of(header).join(name)
}

/// Fills a number into a name with one `%d` or `%03d`, as printf does; `None` if the name has none or anything else behind a `%`.
pub(crate) fn numbered(pattern: &str, number: i64) -> Option<String> {
    let (before, rest) = pattern.split_once('%')?;
    let end = rest.find(|c: char| !c.is_ascii_digit())?;
    let (digits, after) = rest.split_at(end);
    let after = after.strip_prefix(['d', 'i', 'u'])?;
    if after.contains('%') {
        return None;
    }
    // Longer than any file's name.
    let width = if digits.is_empty() { 0 } else { digits.parse::<usize>().ok().filter(|n| *n < 256)? };
    let number = match digits.starts_with('0') {
        true => format!("{number:0width$}"),
        false => format!("{number:width$}"),
    };
    Some(format!("{before}{number}{after}"))
}

/// Refuses a data file that is missing, or none: a device has no end, and a pipe waits.
pub(crate) fn check_file(header: &Path, path: &Path) -> Result<()> {
    match std::fs::metadata(path) {
        Ok(data) if data.is_file() => Ok(()),
        Ok(_) => Err(ImportError::invalid(header, format!("its data file {} is no regular file", path.display()))),
        Err(error) if error.kind() == io::ErrorKind::NotFound => {
            let problem = format!("its data file {} is missing: put it there, or correct the header", path.display());
            Err(ImportError::invalid(header, problem))
        }
        Err(error) => Err(ImportError::io(path)(error)),
    }
}

/// Skips to behind the next line feed. Returns whether there was one.
fn skip_line(file: &mut impl BufRead) -> io::Result<bool> {
    loop {
        let bytes = file.fill_buf()?;
        let (count, is_found) = match bytes.iter().position(|byte| *byte == b'\n') {
            Some(at) => (at + 1, true),
            None => (bytes.len(), false),
        };
        file.consume(count);
        if is_found || count == 0 {
            return Ok(is_found);
        }
    }
}

/// The data of several files, one opened at a time.
struct Joined {
    files: DataFiles,
    part_bytes: u64,
    /// The file that is open, or is opened next.
    next: usize,
    part: Option<Part>,
}

/// An open file's decoded bytes, with the number that are left to deliver.
struct Part {
    stream: Box<dyn Read>,
    left: u64,
}

impl Joined {
    /// Opens a file, and skips the decoded bytes before its data.
    fn open(&self, path: &Path) -> io::Result<Part> {
        let mut stream =
            self.files.stream(path, self.part_bytes).map_err(|error| io::Error::other(error.to_string()))?;
        if !self.files.start.is_last {
            io::copy(&mut (&mut stream).take(self.files.start.decoded), &mut io::sink())?;
        }
        Ok(Part { stream, left: self.part_bytes })
    }
}

impl Read for Joined {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        if buffer.is_empty() {
            return Ok(0);
        }
        while let Some(path) = self.files.paths.get(self.next) {
            let about = |error: io::Error| io::Error::new(error.kind(), format!("{}: {error}", path.display()));
            let mut part = match self.part.take() {
                Some(part) => part,
                None => self.open(path).map_err(about)?,
            };
            let wanted = buffer.len().min(usize::try_from(part.left).unwrap_or(usize::MAX));
            if wanted == 0 {
                // The rest of a coded file holds its checksum.
                if self.files.coding != Coding::Plain {
                    io::copy(&mut part.stream, &mut io::sink()).map_err(about)?;
                }
                self.next += 1;
                continue;
            }
            let count = loop {
                match part.stream.read(&mut buffer[..wanted]) {
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                    result => break result.map_err(about)?,
                }
            };
            if count == 0 {
                let (bytes, left) = (self.part_bytes, part.left);
                let problem = format!("cut short: expected {}, {left} missing", counted(bytes, "byte"));
                return Err(about(io::Error::new(io::ErrorKind::UnexpectedEof, problem)));
            }
            part.left -= count as u64;
            self.part = Some(part);
            return Ok(count);
        }
        Ok(0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_filled_in_as_printf_does() {
        for (pattern, number, expected) in [
            ("a%03d.raw", 7, Some("a007.raw")),
            ("a%d", -2, Some("a-2")),
            ("%4d.raw", 12, Some("  12.raw")),
            ("%03d.raw", 12345, Some("12345.raw")),
            ("a.raw", 1, None),
            ("a%s.raw", 1, None),
            ("a%%.raw", 1, None),
            ("a%d%d", 1, None),
            ("a%999999999999d", 1, None),
            ("a%", 1, None),
        ] {
            assert_eq!(numbered(pattern, number).as_deref(), expected, "{pattern}");
        }
    }
}
