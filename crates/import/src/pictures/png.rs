//! PNG pictures on the `png` crate, of every depth and colour type, interlaced or not. Rows are decoded one at a time, so a picture takes little
//! memory; every checksum counts.

use super::header::{Channels, Header, PictureFormat};
use super::rows::{Palette, Pixels, Rectangle, Row};
use crate::error::{ImportError, Result};
use png::{ColorType, DecodeOptions, Decoder, DecodingError, Limits, Reader, Unit};
use std::fs::File;
use std::io::{BufReader, ErrorKind};
use std::path::{Path, PathBuf};

/// Memory of a decoder besides its rows, and how many of these it holds: compressed data, the window of their decoder, the row before, and copies.
const DECODER_BYTES: u64 = 512 << 10;
const ROWS_HELD: u64 = 4;
/// Most bytes of a chunk, besides a row.
const MOST_CHUNK_BYTES: usize = 64 << 20;
/// Bytes which one byte of Deflate can become, at most.
const BEST_RATIO: u64 = 1032;
const FILE_BUFFER: usize = 1 << 16;
/// An inch in metres, the unit of pHYs.
const INCH: f64 = 0.0254;
/// First column and row of each pass of an interlaced picture, and the steps to the next.
const PASSES: [[u32; 4]; 7] =
    [[0, 0, 8, 8], [4, 0, 8, 8], [0, 4, 4, 8], [2, 0, 4, 4], [0, 2, 2, 4], [1, 0, 2, 2], [0, 1, 1, 2]];
/// The whole picture, as a pass.
const WHOLE: [[u32; 4]; 1] = [[0, 0, 1, 1]];

/// A PNG picture, open before its pixels.
pub(super) struct OpenPng {
    pub(super) header: Header,
    path: PathBuf,
    reader: Reader<BufReader<File>>,
    pixels: Pixels,
}

impl OpenPng {
    /// Opens a picture, and reads its header. `are_labels`: the indices into a palette are read, not its colours.
    ///
    /// # Errors
    /// If it is damaged, or animated.
    pub(super) fn open(path: &Path, are_labels: bool) -> Result<Self> {
        let file = File::open(path).map_err(ImportError::io(path))?;
        let file_bytes = file.metadata().map_err(ImportError::io(path))?.len();
        let mut options = DecodeOptions::default();
        options.set_ignore_checksums(false);
        options.set_skip_ancillary_crc_failures(false);
        options.set_ignore_text_chunk(true);
        options.set_ignore_iccp_chunk(true);
        let mut decoder = Decoder::new_with_options(BufReader::with_capacity(FILE_BUFFER, file), options);
        let refuse = |error| refusal(path, error);
        let info = decoder.read_header_info().map_err(refuse)?;
        let row_bytes = info.raw_row_length() as u64;
        // No row, nor picture, can be longer than its file allows.
        let (bytes, most) = (row_bytes.saturating_mul(info.height.into()), file_bytes.saturating_mul(BEST_RATIO));
        if bytes > most {
            let problem = format!(
                "cut short: its {}x{} pixels take {bytes} bytes, expected at least {} bytes of file, found {file_bytes}; fetch the file again",
                info.width,
                info.height,
                bytes.div_ceil(BEST_RATIO)
            );
            return Err(ImportError::invalid(path, problem));
        }
        let bytes = usize::try_from(row_bytes).unwrap_or(usize::MAX).saturating_mul(ROWS_HELD as usize);
        decoder.set_limits(Limits { bytes: bytes.saturating_add(MOST_CHUNK_BYTES) });
        let reader = decoder.read_info().map_err(refuse)?;
        let (mut header, pixels) = header_of(path, &reader, are_labels)?;
        header.reader_bytes = DECODER_BYTES + FILE_BUFFER as u64 + ROWS_HELD * row_bytes;
        Ok(Self { header, path: path.to_owned(), reader, pixels })
    }

    /// Decodes the picture into a rectangle, to its end: the last checksum counts for all.
    ///
    /// # Errors
    /// If it is damaged or cut short.
    pub(super) fn read(self, rectangle: &mut Rectangle<'_>) -> Result<()> {
        let Self { path, mut reader, pixels, .. } = self;
        let info = reader.info();
        let (width, height) = (info.width, info.height);
        let passes = if info.interlaced { &PASSES[..] } else { &WHOLE[..] };
        let passes = passes.iter().filter(|[x, y, ..]| *x < width && *y < height);
        let rows = passes
            .flat_map(|&[first, top, step, down]| (top..height).step_by(down as usize).map(move |y| (y, first, step)));
        for (y, first, step) in rows {
            let row = reader.next_row().map_err(|error| refusal(&path, error))?;
            let bytes = row.as_ref().map_or(&[][..], |row| row.data());
            let taken = rectangle.take(&pixels, Row { y, first, step, bytes });
            taken.map_err(|problem| ImportError::invalid(&path, format!("{problem}; write the picture again")))?;
        }
        // Past the last row, the compressed data and the file have checksums.
        let rest = reader.next_row().map(|_| ());
        rest.and_then(|()| reader.finish()).map_err(|error| refusal(&path, error))
    }
}

/// Describes a picture by the chunks before its pixels.
fn header_of(path: &Path, reader: &Reader<BufReader<File>>, are_labels: bool) -> Result<(Header, Pixels)> {
    let info = reader.info();
    if info.animation_control.is_some() || info.frame_control.is_some() {
        let advice = "write its frames as pictures of their own";
        return Err(ImportError::unsupported_but(path, "an animated PNG picture (APNG)", advice));
    }
    let bits = info.bit_depth as u32;
    let (width, height) = (info.width, info.height);
    let plain = |channels| Header::new(path, PictureFormat { width, height, bits, channels });
    let (mut header, palette) = match info.color_type {
        ColorType::Grayscale => (plain(Channels::Gray)?, None),
        ColorType::GrayscaleAlpha => (plain(Channels::GrayAlpha)?, None),
        ColorType::Rgb => (plain(Channels::Rgb)?, None),
        ColorType::Rgba => (plain(Channels::RgbAlpha)?, None),
        ColorType::Indexed => {
            let colours = info.palette.as_deref().unwrap_or_default().as_chunks::<3>().0.to_vec();
            let palette = (!are_labels).then(|| Palette::new(colours));
            (Header::of_palette(path, [width, height], palette.as_ref())?, palette)
        }
    };
    if info.trns.is_some() {
        header.warn("Transparency of single colours (tRNS) is left out: all pixels hold data.");
    }
    if let Some(used) = info.sbit.as_deref().filter(|used| used.iter().any(|&used| u32::from(used) < bits)) {
        let used: Vec<String> = used.iter().map(u8::to_string).collect();
        let used = used.join(", ");
        header.note(format!("Of {bits} bits of a number, {used} are significant (sBIT): numbers are read as stored."));
    }
    if let Some(size) = info.pixel_dims.filter(|size| size.unit == Unit::Meter) {
        header.set_density([size.xppu, size.yppu], "meter", INCH);
    }
    if let Some(data) = info.exif_metadata.as_deref() {
        header.check_turn(data);
    }
    let samples = info.color_type.samples();
    Ok((header, Pixels { bits, samples, order: (0..samples).collect(), palette }))
}

fn refusal(path: &Path, error: DecodingError) -> ImportError {
    let problem = match error {
        DecodingError::IoError(error) if error.kind() == ErrorKind::UnexpectedEof => {
            let bytes = std::fs::metadata(path).map_or(0, |file| file.len());
            format!(
                "cut short: expected pixels and an end (IEND), found the file's end after {bytes} bytes; fetch the file again"
            )
        }
        // Damaged compressed data, too, are an error of this kind.
        DecodingError::IoError(error) if error.raw_os_error().is_some() => return ImportError::io(path)(error),
        DecodingError::LimitsExceeded => {
            let problem = "a chunk or a row is too large to be read; write the picture again";
            return ImportError::invalid(path, problem);
        }
        error => format!("cannot be decoded as PNG: {error}; fetch the file again"),
    };
    ImportError::invalid(path, problem)
}
