//! BMP pictures of OS/2 and Windows, uncompressed: palettes of 1, 4 and 8 bits, and colours of 24 and 32, the last row first or last. Rows are
//! read one at a time.

use super::header::{Channels, Header, PictureFormat};
use super::rows::{Palette, Pixels, Rectangle, Row};
use crate::error::{ImportError, Result};
use crate::format::PictureKind;
use std::fs::File;
use std::io::{BufReader, ErrorKind, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// Bytes of the file's header, before the picture's, and of the longest of these, with masks behind it.
const FILE_HEADER: usize = 14;
const MOST_HEADER_BYTES: u64 = 14 + 124 + 16;
/// Length of OS/2's header, with 16-bit sizes and colours of three bytes; and of its second one, with compressions of its own.
const OS2: u32 = 12;
const OS2_SECOND: u32 = 64;
/// Compressions.
const NONE: u32 = 0;
const MASKS: u32 = 3;
const MASKS_WITH_ALPHA: u32 = 6;
/// Compressions which are refused, by their number.
const NOT_READ: [(u32, &str); 7] =
    [(1, "RLE8"), (2, "RLE4"), (4, "JPEG"), (5, "PNG"), (11, "CMYK"), (12, "CMYK RLE8"), (13, "CMYK RLE4")];
/// OS/2's own compressions.
const NOT_READ_OS2: [(u32, &str); 4] = [(1, "RLE8"), (2, "RLE4"), (3, "Huffman 1D"), (4, "RLE24")];
const ADVICE: &str = "write it as PNG";
const FILE_BUFFER: usize = 1 << 16;
/// An inch in metres, the unit of the header.
const INCH: f64 = 0.0254;

/// A BMP picture, open before its pixels.
pub(super) struct OpenBmp {
    pub(super) header: Header,
    path: PathBuf,
    file: BufReader<File>,
    pixels: Pixels,
    /// Bytes before the first row, and of a row.
    start: u64,
    row_bytes: u64,
    is_top_down: bool,
}

impl OpenBmp {
    /// Opens a picture, and reads its header. `are_labels`: the indices into a palette are read, not its colours.
    ///
    /// # Errors
    /// If it is cut short, damaged or compressed.
    pub(super) fn open(path: &Path, are_labels: bool) -> Result<Self> {
        let file = File::open(path).map_err(ImportError::io(path))?;
        let found = file.metadata().map_err(ImportError::io(path))?.len();
        let mut file = BufReader::with_capacity(FILE_BUFFER, file);
        let mut start = Vec::new();
        file.by_ref().take(MOST_HEADER_BYTES).read_to_end(&mut start).map_err(ImportError::io(path))?;
        if PictureKind::of_start(&start) != Some(PictureKind::Bmp) {
            let problem = "does not start as a BMP picture: give it the name of its format, or fetch it again";
            return Err(ImportError::invalid(path, problem));
        }
        let fields = Fields::of(&start).ok_or_else(|| {
            ImportError::invalid(
                path,
                format!("cut short: expected a header, found {found} bytes; fetch the file again"),
            )
        })?;
        let order = fields.order(path)?;
        if u64::from(fields.start) < FILE_HEADER as u64 + u64::from(fields.version) {
            let problem = format!("its pixels start at byte {}, within the header; fetch the file again", fields.start);
            return Err(ImportError::invalid(path, problem));
        }
        let Fields { width, height, bits, .. } = fields;
        let is_indexed = bits <= 8;
        let palette = match is_indexed && !are_labels {
            true => Some(Palette::new(fields.colours(path, &mut file)?)),
            false => None,
        };
        let mut header = match (is_indexed, order.len()) {
            (true, _) => Header::of_palette(path, [width, height], palette.as_ref())?,
            (false, 3) => Header::new(path, PictureFormat { width, height, bits: 8, channels: Channels::Rgb })?,
            (false, _) => Header::new(path, PictureFormat { width, height, bits: 8, channels: Channels::RgbAlpha })?,
        };
        header.set_density(fields.density, "meter", INCH);
        let row_bytes = (u64::from(width) * u64::from(bits)).div_ceil(32) * 4;
        // Some writers leave out the padding of the last row.
        let padding = row_bytes - (u64::from(width) * u64::from(bits)).div_ceil(8);
        let expected = u64::from(fields.start) + row_bytes * u64::from(height) - padding;
        if found < expected {
            let missing = expected - found;
            let problem = format!(
                "cut short: the header implies {expected} bytes ({width}x{height} pixels of {bits} bits, from byte {}), found {found} ({missing} missing); fetch the file again",
                fields.start
            );
            return Err(ImportError::invalid(path, problem));
        }
        header.reader_bytes = FILE_BUFFER as u64 + row_bytes;
        let (bits, samples) = if is_indexed { (bits, 1) } else { (8, bits as usize / 8) };
        let (start, is_top_down) = (fields.start.into(), fields.is_top_down);
        let pixels = Pixels { bits, samples, order, palette };
        Ok(Self { header, path: path.to_owned(), file, pixels, start, row_bytes, is_top_down })
    }

    /// Reads the rows of a rectangle.
    ///
    /// # Errors
    /// If the disk fails, or a pixel has no colour in the palette.
    pub(super) fn read(self, rectangle: &mut Rectangle<'_>) -> Result<()> {
        let Self { header, path, mut file, pixels, start, row_bytes, is_top_down } = self;
        let PictureFormat { width, height, .. } = header.format;
        let used = (u64::from(width) * pixels.samples as u64 * u64::from(pixels.bits)).div_ceil(8);
        let mut row = vec![0; used as usize];
        for y in rectangle.rows() {
            let number = if is_top_down { y } else { height - 1 - y };
            file.seek(SeekFrom::Start(start + u64::from(number) * row_bytes)).map_err(ImportError::io(&path))?;
            file.read_exact(&mut row).map_err(ImportError::io(&path))?;
            let taken = rectangle.take(&pixels, Row { y, first: 0, step: 1, bytes: &row });
            taken.map_err(|problem| ImportError::invalid(&path, format!("{problem}; write the picture again")))?;
        }
        Ok(())
    }
}

/// Fields of a header.
struct Fields {
    version: u32,
    width: u32,
    height: u32,
    is_top_down: bool,
    bits: u32,
    compression: u32,
    /// Pixels per metre.
    density: [u32; 2],
    /// Colours of the palette; 0 for all.
    colours: u32,
    /// Bits of red, green, blue and alpha in a pixel.
    masks: [u32; 4],
    /// Bytes before the pixels.
    start: u32,
}

impl Fields {
    /// Reads the fields; `None` if the header is cut short.
    fn of(bytes: &[u8]) -> Option<Self> {
        let at = |place| number(bytes, place);
        let (version, start) = (at(FILE_HEADER)?, at(10)?);
        if version == OS2 {
            let [size, depth] = [at(18)?, at(22)?];
            return Some(Self {
                version,
                width: size & 0xffff,
                height: size >> 16,
                is_top_down: false,
                bits: depth >> 16,
                compression: NONE,
                density: [0; 2],
                colours: 0,
                masks: [0; 4],
                start,
            });
        }
        let height = at(22)? as i32;
        let compression = at(30)?;
        let has_alpha = version >= 56 || compression == MASKS_WITH_ALPHA;
        let has_masks = compression == MASKS || compression == MASKS_WITH_ALPHA;
        let mask = |i: usize| if has_masks { at(54 + 4 * i) } else { Some(0) };
        Some(Self {
            version,
            // A negative width becomes one which no file holds.
            width: at(18)?,
            height: height.unsigned_abs(),
            is_top_down: height < 0,
            bits: at(26)? >> 16,
            compression,
            density: [at(38)?, at(42)?].map(|count| i32::try_from(count).map_or(0, i32::unsigned_abs)),
            colours: at(46)?,
            masks: [mask(0)?, mask(1)?, mask(2)?, if has_alpha { mask(3)? } else { 0 }],
            start,
        })
    }

    /// The byte of each channel in a pixel: blue is the first unless masks say otherwise.
    fn order(&self, path: &Path) -> Result<Vec<usize>> {
        let refuse = |what: String| Err(ImportError::unsupported_but(path, what, ADVICE));
        let not_read = if self.version == OS2_SECOND { &NOT_READ_OS2[..] } else { &NOT_READ[..] };
        if let Some((_, name)) = not_read.iter().find(|(number, _)| *number == self.compression) {
            return refuse(format!("a BMP picture compressed as {name}"));
        }
        match (self.bits, self.compression) {
            (1 | 4 | 8, NONE) => Ok(vec![0]),
            (24 | 32, NONE) => Ok(vec![2, 1, 0]),
            (32, MASKS | MASKS_WITH_ALPHA) => {
                let alpha = usize::from(self.masks[3] != 0);
                let byte_of = |mask: &u32| (0..4).find(|byte| *mask == 0xff << (8 * byte));
                let order: Option<Vec<usize>> = self.masks[..3 + alpha].iter().map(byte_of).collect();
                order.map_or_else(
                    || {
                        let [r, g, b, a] = self.masks.map(|mask| format!("{mask:08x}"));
                        refuse(format!("a BMP picture with the bit masks {r}, {g}, {b}, {a}"))
                    },
                    Ok,
                )
            }
            (bits, NONE | MASKS | MASKS_WITH_ALPHA) => refuse(format!("a BMP picture of {bits} bits a pixel")),
            (_, compression) => refuse(format!("a BMP picture of the compression {compression}")),
        }
    }

    /// Reads the palette, behind the header.
    fn colours(&self, path: &Path, file: &mut BufReader<File>) -> Result<Vec<[u8; 3]>> {
        let most = 1u32 << self.bits;
        // Further colours have no index.
        let count = if self.colours == 0 { most } else { self.colours.min(most) };
        let width = if self.version == OS2 { 3 } else { 4 };
        let at = FILE_HEADER as u64 + u64::from(self.version);
        // The pixels may follow fewer colours than the depth allows.
        let room = u64::from(self.start).saturating_sub(at) / width;
        let count = if self.colours == 0 { u64::from(count).min(room) } else { u64::from(count) };
        let mut bytes = vec![0; (count * width) as usize];
        let read = file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(&mut bytes));
        read.map_err(|error| match error.kind() {
            ErrorKind::UnexpectedEof => ImportError::invalid(
                path,
                format!("cut short: expected {count} colours of a palette; fetch the file again"),
            ),
            _ => ImportError::io(path)(error),
        })?;
        Ok(bytes.chunks_exact(width as usize).map(|colour| [colour[2], colour[1], colour[0]]).collect())
    }
}

/// A little-endian number.
fn number(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}
