//! JPEG pictures on the `jpeg-decoder` crate: gray, or colours that become red, green and blue; baseline and progressive. A picture is decoded in
//! memory. Its numbers are libjpeg's within 1 of 255 if gray, and within 6 in colours, mostly 1: decoders round differently. Colours stored at half
//! the width of at most four pixels are further off, since libjpeg does not interpolate those.

use super::header::{Channels, Header, PictureFormat};
use super::rows::{Pixels, Rectangle, Row};
use crate::error::{ImportError, Result};
use jpeg_decoder::{Decoder, Error};
use std::fs::File;
use std::io::{BufReader, ErrorKind, Read, Seek};
use std::path::{Path, PathBuf};

const FILE_BUFFER: usize = 1 << 16;
/// Memory of a decoder besides pixels: tables, and stacks of its threads.
const DECODER_BYTES: u64 = 512 << 10;
/// Blocks of pixels which one byte can hold, at most: each takes a bit or more, in the first scan of a progressive picture.
const MOST_BLOCKS_PER_BYTE: u64 = 8;
/// Pixels of a block along x and y.
const BLOCK: u64 = 8;
const ADVICE: &str = "write it as PNG";
/// Inches in the units of JFIF: of an inch, and of a centimetre.
const CM_PER_INCH: f64 = 2.54;

/// Markers.
const START: u8 = 0xd8;
const END: u8 = 0xd9;
const SCAN: u8 = 0xda;
const APP0: u8 = 0xe0;
const APP1: u8 = 0xe1;
const APP2: u8 = 0xe2;

/// A JPEG picture, open before its pixels.
pub(super) struct OpenJpeg {
    pub(super) header: Header,
    path: PathBuf,
    file: BufReader<File>,
}

impl OpenJpeg {
    /// Opens a picture, and reads its header.
    ///
    /// # Errors
    /// If it is damaged or cut short, of another kind, or holds labels, which the coding would change.
    pub(super) fn open(path: &Path, are_labels: bool) -> Result<Self> {
        let file = File::open(path).map_err(ImportError::io(path))?;
        let file_bytes = file.metadata().map_err(ImportError::io(path))?.len();
        let mut file = BufReader::with_capacity(FILE_BUFFER, file);
        let segments = Segments::read(&mut file).map_err(|failure| failure.of(path))?;
        let frame = segments.frame.as_ref().ok_or_else(|| Failure::Damaged("holds no picture".into()).of(path))?;
        frame.check(path)?;
        if are_labels {
            let advice = "it changes numbers, so labels would become others: write them as PNG";
            return Err(ImportError::unsupported_but(path, "JPEG of labels", advice));
        }
        let blocks: u64 = frame.blocks();
        if blocks > file_bytes.saturating_mul(MOST_BLOCKS_PER_BYTE) {
            let problem = format!(
                "cut short: its {}x{} pixels take {blocks} blocks, expected at least {} bytes, found {file_bytes}; fetch the file again",
                frame.width,
                frame.height,
                blocks / MOST_BLOCKS_PER_BYTE
            );
            return Err(ImportError::invalid(path, problem));
        }
        let channels = if frame.components.len() == 1 { Channels::Gray } else { Channels::Rgb };
        let (width, height) = (frame.width.into(), frame.height.into());
        let mut header = Header::new(path, PictureFormat { width, height, bits: 8, channels })?;
        header.note("JPEG is lossy: the numbers are near those of the original picture, not equal to them.".into());
        segments.describe(&mut header);
        // Planes of components; their coefficients, on their way to slower threads, and if progressive, all held before that; and the picture.
        let planes = blocks * BLOCK * BLOCK;
        let coefficients = if frame.is_progressive() { 4 * planes } else { 2 * planes };
        let pixels = u64::from(width) * u64::from(height) * frame.components.len() as u64;
        header.reader_bytes = DECODER_BYTES + FILE_BUFFER as u64 + planes + coefficients + pixels;
        file.rewind().map_err(ImportError::io(path))?;
        Ok(Self { header, path: path.to_owned(), file })
    }

    /// Decodes the picture, and takes the pixels in a rectangle.
    ///
    /// # Errors
    /// If it is damaged or cut short.
    pub(super) fn read(self, rectangle: &mut Rectangle<'_>) -> Result<()> {
        let Self { header, path, file } = self;
        let PictureFormat { width, height, .. } = header.format;
        let samples = header.format.channels() as usize;
        let row_bytes = width as usize * samples;
        let expected = row_bytes * height as usize;
        let mut decoder = Decoder::new(file);
        decoder.set_max_decoding_buffer_size(expected);
        let decoded = decoder.decode().map_err(|error| refusal(&path, error))?;
        if decoded.len() != expected {
            let problem = format!("damaged: expected {expected} bytes of pixels, found {}", decoded.len());
            return Err(ImportError::invalid(&path, format!("{problem}; fetch the file again")));
        }
        let pixels = Pixels { bits: 8, samples, order: vec![0, 1, 2], palette: None };
        for (y, bytes) in (0..height).zip(decoded.chunks_exact(row_bytes)) {
            let taken = rectangle.take(&pixels, Row { y, first: 0, step: 1, bytes });
            taken.map_err(|problem| ImportError::invalid(&path, problem))?;
        }
        Ok(())
    }
}

/// Why the markers cannot be read.
enum Failure {
    Disk(std::io::Error),
    Damaged(String),
}

impl From<std::io::Error> for Failure {
    fn from(error: std::io::Error) -> Self {
        match error.kind() {
            ErrorKind::UnexpectedEof => Self::Damaged("cut short: expected pixels, found the file's end".into()),
            _ => Self::Disk(error),
        }
    }
}

impl Failure {
    fn of(self, path: &Path) -> ImportError {
        match self {
            Self::Disk(error) => ImportError::io(path)(error),
            Self::Damaged(problem) => ImportError::invalid(path, format!("{problem}; fetch the file again")),
        }
    }
}

/// The header of a picture's pixels.
struct Frame {
    /// The marker, which gives the kind.
    marker: u8,
    precision: u8,
    width: u16,
    height: u16,
    /// Horizontal and vertical sampling factors.
    components: Vec<[u8; 2]>,
}

impl Frame {
    fn read(marker: u8, segment: &[u8]) -> Result<Self, Failure> {
        let damaged = || Failure::Damaged("the header of its pixels (SOF) is damaged".into());
        let [precision, h1, h0, w1, w0, count, components @ ..] = segment else { return Err(damaged()) };
        let components: Vec<[u8; 2]> =
            components.as_chunks::<3>().0.iter().map(|[_, factors, _]| [factors >> 4, factors & 15]).collect();
        let are_factors = components.iter().flatten().all(|factor| (1..=4).contains(factor));
        if components.len() != usize::from(*count) || components.is_empty() || !are_factors {
            return Err(damaged());
        }
        let [height, width] = [[*h1, *h0], [*w1, *w0]].map(u16::from_be_bytes);
        Ok(Self { marker, precision: *precision, width, height, components })
    }

    fn is_progressive(&self) -> bool {
        self.marker == 0xc2
    }

    /// Refuses kinds which are not read, by their names.
    fn check(&self, path: &Path) -> Result<()> {
        let kind = match (self.marker, self.components.len()) {
            (0xc3, _) => "lossless JPEG".into(),
            (0xc9.., _) => "arithmetic-coded JPEG".into(),
            (0xc5.., _) => "hierarchical JPEG".into(),
            _ if self.precision != 8 => format!("{}-bit JPEG", self.precision),
            (_, 1 | 3) if self.height == 0 => "JPEG without a height (DNL)".into(),
            (_, 1 | 3) => return Ok(()),
            (_, 4) => "CMYK JPEG (Adobe)".into(),
            (_, count) => format!("JPEG of {count} components"),
        };
        Err(ImportError::unsupported_but(path, kind, ADVICE))
    }

    /// Blocks of all components, each padded to whole units.
    fn blocks(&self) -> u64 {
        let most = |i: usize| self.components.iter().map(|factors| u64::from(factors[i])).max().unwrap_or(1);
        let units = |size: u16, factor: u64| u64::from(size).div_ceil(BLOCK * factor);
        let units = units(self.width, most(0)) * units(self.height, most(1));
        let in_unit: u64 = self.components.iter().map(|[h, v]| u64::from(*h) * u64::from(*v)).sum();
        units * in_unit
    }
}

/// Segments before the pixels, as far as they matter.
#[derive(Default)]
struct Segments {
    frame: Option<Frame>,
    jfif: Vec<u8>,
    exif: Vec<u8>,
    has_more_pictures: bool,
}

impl Segments {
    /// Reads the segments up to the first scan.
    fn read(file: &mut BufReader<File>) -> Result<Self, Failure> {
        let mut found = Self::default();
        if byte(file)? != 0xff || byte(file)? != START {
            return Err(Failure::Damaged("does not start as a JPEG picture: give it the name of its format".into()));
        }
        loop {
            let marker = next_marker(file)?;
            match marker {
                SCAN => return Ok(found),
                END => return Err(Failure::Damaged("ends before its pixels".into())),
                0x01 | 0xd0..=0xd7 => continue,
                _ => {}
            }
            let length = u16::from_be_bytes([byte(file)?, byte(file)?]);
            let Some(length) = length.checked_sub(2) else {
                return Err(Failure::Damaged("a segment is damaged".into()));
            };
            let is_frame = matches!(marker, 0xc0..=0xcf) && !matches!(marker, 0xc4 | 0xc8 | 0xcc);
            if !is_frame && !matches!(marker, APP0..=APP2) {
                file.seek_relative(length.into())?;
                continue;
            }
            let mut segment = vec![0; length.into()];
            file.read_exact(&mut segment)?;
            match marker {
                APP0 if segment.starts_with(b"JFIF\0") => found.jfif = segment,
                APP1 if segment.starts_with(b"Exif\0\0") => found.exif = segment.split_off(6),
                APP2 if segment.starts_with(b"MPF\0") => found.has_more_pictures = true,
                _ if is_frame && found.frame.is_none() => found.frame = Some(Frame::read(marker, &segment)?),
                _ => {}
            }
        }
    }

    /// Adds the size of pixels, and remarks, to the header.
    fn describe(&self, header: &mut Header) {
        if let [_, _, _, _, _, _, _, unit, x1, x0, y1, y0, ..] = self.jfif[..] {
            let density = [[x1, x0], [y1, y0]].map(|bytes| u16::from_be_bytes(bytes).into());
            match unit {
                1 => header.set_density(density, "inch", 1.0),
                2 => header.set_density(density, "centimeter", CM_PER_INCH),
                _ => {}
            }
        }
        header.check_turn(&self.exif);
        if self.has_more_pictures {
            header.warn("The file holds further pictures (MPF): the first is read.");
        }
    }
}

fn byte(file: &mut BufReader<File>) -> Result<u8, Failure> {
    let mut byte = [0];
    file.read_exact(&mut byte)?;
    Ok(byte[0])
}

/// The next marker. Fill bytes may come before it.
fn next_marker(file: &mut BufReader<File>) -> Result<u8, Failure> {
    if byte(file)? != 0xff {
        return Err(Failure::Damaged("expected a marker between its segments, found other bytes".into()));
    }
    loop {
        match byte(file)? {
            0xff => {}
            marker => return Ok(marker),
        }
    }
}

fn refusal(path: &Path, error: Error) -> ImportError {
    let problem = match error {
        Error::Io(error) if error.kind() == ErrorKind::UnexpectedEof => {
            let bytes = std::fs::metadata(path).map_or(0, |file| file.len());
            format!("cut short: expected pixels and an end (EOI), found the file's end after {bytes} bytes")
        }
        Error::Io(error) => return ImportError::io(path)(error),
        Error::Unsupported(feature) => {
            return ImportError::unsupported_but(path, format!("a JPEG picture with {feature:?}"), ADVICE);
        }
        error => format!("cannot be decoded as JPEG: {error}"),
    };
    ImportError::invalid(path, format!("{problem}; fetch the file again"))
}
