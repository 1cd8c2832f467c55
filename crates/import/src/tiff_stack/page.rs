//! Page decoder of one TIFF file: page formats, checks of their data, and rectangles of samples.

use super::indices::{self, PageBytes};
use super::jpeg;
use super::lzw::{self, Predictor, Rows};
use super::refusal::{AS_NUMBERS, is_damage, kind_of, not_decoded, refusal};
use super::turn::Turn;
use crate::element::{Decode, Element, Endian};
use crate::error::{ImportError, Result};
use crate::stamp::Stamp;
use brickyard_volume::{VoxelBox, VoxelType};
use std::fs::File;
use std::io::{ErrorKind, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};
use tiff::decoder::{ChunkType, Decoder, DecodingSampleType, Limits};
use tiff::tags::{ByteOrder, Tag};
use tiff::{ColorType, TiffError, TiffResult};

/// Most memory for the values of one tag: 8 million strips.
const MOST_TAG_BYTES: usize = 256 << 20;

/// Compression ratio beyond all methods: a strip above it has a damaged header and must not cause an allocation.
const ABSURD_RATIO: u64 = 1 << 16;

/// Supported compressions, by their number in a file, and the names of others.
const READ: [u16; 7] = [1, LZW, JPEG, 8, 32773, 32946, ZSTD];
const LZW: u16 = 5;
const JPEG: u16 = 7;
const ZSTD: u16 = 50000;
const NOT_READ: [(u16, &str); 14] = [
    (2, "CCITT RLE"),
    (3, "CCITT fax 3"),
    (4, "CCITT fax 4"),
    (6, "JPEG of before 1995"),
    (32809, "ThunderScan"),
    (33003, "JPEG 2000 (Aperio)"),
    (33005, "JPEG 2000 (Aperio)"),
    (34677, "SGI log"),
    (34712, "JPEG 2000"),
    (34887, "LERC"),
    (34892, "lossy JPEG of a DNG"),
    (34925, "LZMA"),
    (50001, "WebP"),
    (50002, "JPEG XL"),
];
/// Most output kept by a Zstandard decoder, by default.
const MOST_ZSTD_WINDOW: u64 = 128 << 20;
/// Offset and length of a strip or tile.
const CHUNK_PLACE_BYTES: u64 = 16;

/// Bits of NewSubfileType for a smaller copy of another page, or a mask.
const COPY_OR_MASK: u32 = 1 | 4;
/// Bytes of a strip or tile searched for its JPEG header.
const JPEG_HEADER_BYTES: u64 = 64 << 10;

/// Places of damage in messages.
const PAGE: &str = "a page";
const FILE: &str = "cannot be read";

/// Slices of a page and of a tile, which are not in the standard.
const IMAGE_DEPTH: Tag = Tag::Unknown(32997);
const TILE_DEPTH: Tag = Tag::Unknown(32998);

/// Format of a page, common to all pages of a stack.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct PageFormat {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) element: Element,
    /// Samples per pixel.
    pub(super) samples: u16,
    /// Whether the samples of a pixel lie in planes of their own.
    pub(super) planar: bool,
    /// Whether the least value is white: the decoder inverts such images for display, but the stored values are needed.
    pub(super) white_is_zero: bool,
    /// Whether the first three samples are red, green and blue.
    pub(super) is_rgb: bool,
    /// Whether pixels are indices into a palette of colours.
    pub(super) is_palette: bool,
    /// Turn from stored to shown rows and columns. Width and height are as stored.
    pub(super) turn: Turn,
}

impl PageFormat {
    /// Shown size in pixels along x and y.
    pub(super) fn shown_size(&self) -> [u32; 2] {
        self.turn.meant([self.width, self.height])
    }
}

impl std::fmt::Display for PageFormat {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{} {}", self.width, self.height, self.element.name())?;
        if self.samples > 1 {
            write!(f, " with {} samples a pixel", self.samples)?;
        }
        if self.is_palette {
            write!(f, " (indices into a palette)")?;
        }
        if self.white_is_zero {
            write!(f, " (white is zero)")?;
        }
        if !self.turn.is_none() {
            write!(f, " (of another Orientation than 1)")?;
        }
        Ok(())
    }
}

/// An open TIFF file with a decoder at one of its pages.
pub(super) struct OpenTiff {
    pub(super) path: PathBuf,
    pub(super) decoder: Decoder<PageBytes>,
    /// The current page, from 0, and whether it holds indices into a palette.
    page: u32,
    is_palette: bool,
    pub(super) stamp: Stamp,
    packing: Packing,
    /// The decoded strip or tile.
    chunk: Vec<u8>,
    /// Its whole rows, where they are wider than needed; and packed bytes.
    scratch: [Vec<u8>; 2],
}

/// Packing of a page's strips or tiles, and the places of those not left to the library.
enum Packing {
    /// Not yet examined.
    Unknown,
    Library,
    Lzw {
        offsets: Vec<u64>,
        counts: Vec<u64>,
        predictor: Predictor,
    },
}

impl OpenTiff {
    pub(super) fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(ImportError::io(path))?;
        let stamp = Stamp::in_metadata(&file.metadata().map_err(ImportError::io(path))?);
        let decoder = Decoder::new(PageBytes::new(file)).map_err(|e| refusal(path, "cannot be read", e))?;
        let decoder = decoder.with_limits(limits(stamp.bytes));
        let mut tiff = Self {
            path: path.to_owned(),
            decoder,
            page: 0,
            is_palette: false,
            stamp,
            packing: Packing::Unknown,
            chunk: Vec::new(),
            scratch: Default::default(),
        };
        tiff.arrive(0, Ok(()))?;
        Ok(tiff)
    }

    /// Records the decoder's current page, counted from 0, after a move to it.
    fn arrive(&mut self, page: u32, moved: TiffResult<()>) -> Result<()> {
        (self.packing, self.page) = (Packing::Unknown, page);
        let is_palette = moved.and_then(|()| indices::as_numbers(&mut self.decoder, page));
        self.is_palette =
            is_palette.map_err(|e| refusal(&self.path, &format!("page {} cannot be read", page + 1), e))?;
        Ok(())
    }

    /// The number in a tag of the current page. `what` is read, for messages.
    fn number<T: TryFrom<u64>>(&mut self, tag: Tag, what: &str) -> Result<Option<T>> {
        self.decoder.find_tag_unsigned(tag).map_err(|e| refusal(&self.path, what, e))
    }

    /// The numbers in a tag of the current page; empty if it has none.
    fn numbers(&mut self, tag: Tag, what: &str) -> Result<Vec<u64>> {
        let numbers = self.decoder.find_tag_unsigned_vec(tag).map_err(|e| refusal(&self.path, what, e))?;
        Ok(numbers.unwrap_or_default())
    }

    pub(super) fn has_more_pages(&self) -> bool {
        self.decoder.more_images()
    }

    /// Whether the page is a smaller copy of another (an overview, a thumbnail) or a mask.
    pub(super) fn is_copy_or_mask(&mut self) -> Result<bool> {
        let kind = self.decoder.find_tag_unsigned::<u32>(Tag::NewSubfileType);
        Ok(said(&self.path, kind)?.is_some_and(|kind| kind & COPY_OR_MASK != 0))
    }

    /// The size of the page if it is half as large as one of this format, or smaller.
    pub(super) fn small_size(&mut self, format: &PageFormat) -> Result<Option<(u32, u32)>> {
        let (width, height) = self.decoder.dimensions().map_err(|e| refusal(&self.path, PAGE, e))?;
        let is_small = width <= format.width.div_ceil(2) && height <= format.height.div_ceil(2);
        Ok((is_small && (width, height) != (format.width, format.height)).then_some((width, height)))
    }

    /// Moves the decoder to the next page.
    pub(super) fn next_page(&mut self) -> Result<()> {
        self.decoder.inner().as_it_is();
        let moved = self.decoder.next_image();
        self.arrive(self.page + 1, moved)
    }

    /// Moves the decoder to a page, counted from 0.
    pub(super) fn seek(&mut self, page: u32) -> Result<()> {
        self.decoder.inner().as_it_is();
        let moved = self.decoder.seek_to_image(page as usize);
        self.arrive(page, moved)
    }

    pub(super) fn format(&mut self) -> Result<PageFormat> {
        let path = self.path.clone();
        let refuse = |e| refusal(&path, PAGE, e);
        self.check_packing()?;
        let (width, height) = self.decoder.dimensions().map_err(refuse)?;
        let color = self.decoder.colortype().map_err(refuse)?;
        let samples = color.num_samples();
        let layout = self.decoder.image_chunk_buffer_layout(0).map_err(refuse)?;
        let unsupported = || {
            let feature = format!("a page of {}-bit {}", color.bit_depth(), kind_of(color, layout.sample_format));
            ImportError::unsupported_but(&path, feature, AS_NUMBERS)
        };
        let bits = color.bit_depth() as usize;
        let element =
            layout.sample_type.and_then(element_of).filter(|e| e.bytes() * 8 == bits).ok_or_else(unsupported)?;
        let white_is_zero = match self.number::<u16>(Tag::PhotometricInterpretation, PAGE)? {
            Some(1 | 2) => false,
            // Undone by a second inversion; the library inverts unsigned integers, one a pixel.
            Some(0) if is_unsigned(element) && samples == 1 => true,
            Some(0) => {
                let feature = format!("{} of which the least is white (PhotometricInterpretation 0)", element.name());
                let advice = "write it again with the least black (MINISBLACK)";
                return Err(ImportError::unsupported_but(&path, feature, advice));
            }
            _ => return Err(unsupported()),
        };
        let (claimed, file_bytes) = (layout.len as u64, self.stamp.bytes);
        if claimed > file_bytes.saturating_mul(ABSURD_RATIO) {
            let problem =
                format!("claims strips or tiles of {claimed} bytes in a file of {file_bytes}: the header is damaged");
            return Err(ImportError::invalid(&path, problem));
        }
        self.check_depth()?;
        let stored = self.number::<u16>(Tag::SamplesPerPixel, PAGE)?.unwrap_or(1);
        if stored != samples {
            let feature = format!("a page of {stored} samples a pixel, of which only {samples} have a known meaning,");
            let advice = "write it again with one sample a pixel, or as red, green and blue";
            return Err(ImportError::unsupported_but(&path, feature, advice));
        }
        let is_float = matches!(element, Element::Voxel(VoxelType::F32) | Element::F16 | Element::F64);
        if self.number::<u16>(Tag::Predictor, PAGE)? == Some(3) && !is_float {
            return Err(ImportError::unsupported(&path, "a floating-point predictor of integers"));
        }
        let planar = self.number::<u16>(Tag::PlanarConfiguration, PAGE)? == Some(2);
        let is_rgb = matches!(color, ColorType::RGB(_) | ColorType::RGBA(_));
        let turn = self.turn()?;
        let is_palette = self.is_palette;
        Ok(PageFormat { width, height, element, samples, planar, white_is_zero, is_rgb, is_palette, turn })
    }

    fn turn(&mut self) -> Result<Turn> {
        let value = self.number::<u16>(Tag::Orientation, PAGE)?.unwrap_or(1);
        Turn::of_orientation(value).ok_or_else(|| {
            let advice = "write it again with one from 1 to 8 (tiffset -s Orientation 1)";
            ImportError::unsupported_but(&self.path, format!("an Orientation of {value}"), advice)
        })
    }

    /// Memory in bytes for decoding a strip or tile of the page: decoded pixels, decompressor, and lists of offsets and lengths.
    pub(super) fn reader_bytes(&mut self, format: &PageFormat) -> Result<u64> {
        let layout = self.decoder.image_chunk_buffer_layout(0);
        let decoded = layout.map_err(|e| refusal(&self.path, PAGE, e))?.len as u64;
        let kept = match self.number::<u16>(Tag::Compression, PAGE)? {
            // Output and input together.
            Some(JPEG) => decoded.saturating_mul(2),
            Some(ZSTD) => decoded.min(MOST_ZSTD_WINDOW),
            // Its rows, and packed bytes, limited by the file's size.
            Some(LZW) => decoded.saturating_add(self.stamp.bytes.min(decoded.saturating_mul(2))),
            _ => 0,
        };
        let (width, height) = self.decoder.chunk_dimensions();
        let chunks = format.width.div_ceil(width.max(1)) as u64 * format.height.div_ceil(height.max(1)) as u64;
        let planes = if format.planar { format.samples as u64 } else { 1 };
        // A plane before it is turned, of voxels of four bytes at most.
        let turned = if format.turn.is_none() { 0 } else { 4 * format.width as u64 * format.height as u64 };
        let decoded = decoded.saturating_add(turned);
        Ok(decoded.saturating_add(kept).saturating_add(chunks.saturating_mul(planes * CHUNK_PLACE_BYTES)))
    }

    /// Frees the memory of the last strip or tile.
    pub(super) fn rest(mut self) -> Self {
        self.chunk = Vec::new();
        self.scratch = Default::default();
        self
    }

    /// Refuses packings that the library would refuse only on reading, or misread.
    fn check_packing(&mut self) -> Result<()> {
        let code = self.number::<u16>(Tag::Compression, PAGE)?.unwrap_or(1);
        if !READ.contains(&code) {
            let name = NOT_READ.iter().find(|(c, _)| *c == code).map_or("unknown", |(_, name)| name);
            let advice = "write it again with another: none, LZW, Deflate, PackBits, JPEG and Zstandard are read";
            let feature = format!("compression {code} ({name})");
            return Err(ImportError::unsupported_but(&self.path, feature, advice));
        }
        if self.number::<u16>(Tag::FillOrder, PAGE)? == Some(2) {
            let advice = "write it again with the highest first (tiffcp -f msb2lsb)";
            return Err(ImportError::unsupported_but(&self.path, "a FillOrder of the lowest bit first", advice));
        }
        Ok(())
    }

    /// Refuses pages with a third dimension: the library ignores it, and would read the first slice.
    fn check_depth(&mut self) -> Result<()> {
        for tag in [IMAGE_DEPTH, TILE_DEPTH] {
            let depth = self.number::<u64>(tag, PAGE)?.unwrap_or(1);
            if depth > 1 {
                let feature = format!("a page of {depth} slices (ImageDepth)");
                return Err(ImportError::unsupported_but(&self.path, feature, "write it again with a page for each"));
            }
        }
        Ok(())
    }

    /// Checks the strips or tiles of the page: they must lie inside the file, not be empty, and hold all their pixels if
    /// uncompressed. `number` is the page's number, counted from 1, for messages.
    pub(super) fn check_data(&mut self, number: u32) -> Result<()> {
        let page = format!("page {number}");
        let plain = self.plain_chunk()?;
        let is_jpeg = self.number::<u16>(Tag::Compression, &page)? == Some(JPEG);
        for (tag, counts) in [(Tag::StripOffsets, Tag::StripByteCounts), (Tag::TileOffsets, Tag::TileByteCounts)] {
            let (offsets, counts) = (self.numbers(tag, &page)?, self.numbers(counts, &page)?);
            if let (true, Some(&at), Some(&count)) = (is_jpeg, offsets.first(), counts.first()) {
                self.check_jpeg(at, count)?;
            }
            let (path, found) = (&self.path, self.stamp.bytes);
            for (i, (offset, count)) in offsets.into_iter().zip(counts).enumerate() {
                if count == 0 {
                    let feature = format!("an empty strip or tile, as number {i} of page {number} is (a sparse file)");
                    let advice = "write it again with all its pixels";
                    return Err(ImportError::unsupported_but(path, feature, advice));
                }
                let end = offset.saturating_add(count);
                if let Some(needed) = plain.as_ref().map(|chunk| chunk.bytes(i as u64))
                    && (count < needed || end > found && offset.saturating_add(needed) <= found)
                {
                    let problem = format!(
                        "strip or tile {i} of page {number} is not compressed, and its pixels take {needed} bytes, but \
                         its directory has {count}; tiffcp writes the file anew"
                    );
                    return Err(ImportError::invalid(path, problem));
                }
                if end > found {
                    let missing = end - found;
                    let problem = format!(
                        "cut short: the data of page {number} reach to byte {end}, found {found} ({missing} missing)"
                    );
                    return Err(ImportError::invalid(path, problem));
                }
            }
        }
        Ok(())
    }

    /// Refuses JPEG kinds that the library mistakes for damage, by the head of a strip or tile.
    fn check_jpeg(&mut self, at: u64, count: u64) -> Result<()> {
        let mut head = Vec::new();
        let file = self.decoder.inner();
        let read = file
            .seek(SeekFrom::Start(at))
            .and_then(|_| file.by_ref().take(count.min(JPEG_HEADER_BYTES)).read_to_end(&mut head));
        read.map_err(ImportError::io(&self.path))?;
        let Some(kind) = jpeg::kind_not_read(&head) else { return Ok(()) };
        let advice =
            "write it again with another compression: none, LZW, Deflate, PackBits, Zstandard, or the usual JPEG";
        Err(ImportError::unsupported_but(&self.path, format!("{kind} JPEG"), advice))
    }

    /// Strips or tiles of a page of uncompressed pixels.
    fn plain_chunk(&mut self) -> Result<Option<PlainChunk>> {
        if self.number::<u64>(Tag::Compression, FILE)?.unwrap_or(1) != 1 {
            return Ok(None);
        }
        let planar = self.number::<u64>(Tag::PlanarConfiguration, FILE)? == Some(2);
        let refuse = |e| refusal(&self.path, FILE, e);
        let (_, height) = self.decoder.dimensions().map_err(refuse)?;
        let color = self.decoder.colortype().map_err(refuse)?;
        let (width, rows) = self.decoder.chunk_dimensions();
        let samples = if planar { 1 } else { color.num_samples() as u64 };
        let height = matches!(self.decoder.get_chunk_type(), ChunkType::Strip).then_some(height as u64);
        let row_bytes = (width as u64 * samples).saturating_mul(color.bit_depth() as u64) / 8;
        Ok(Some(PlainChunk { row_bytes, rows: rows.max(1) as u64, height }))
    }

    /// Returns the first byte of the page's data, and their byte order, for a page followed by other planes without a directory.
    ///
    /// # Errors
    /// If the page is compressed, tiled, turned, or in strips with gaps.
    pub(super) fn contiguous_start(&mut self, format: &PageFormat) -> Result<(u64, Endian)> {
        let compression = self.number::<u16>(Tag::Compression, FILE)?.unwrap_or(1);
        let (offsets, counts) = (self.numbers(Tag::StripOffsets, FILE)?, self.numbers(Tag::StripByteCounts, FILE)?);
        let (Some(&start), 1, true) = (offsets.first(), compression, format.turn.is_none()) else {
            let feature = "a compressed or tiled stack in one directory, or one of another Orientation than 1,";
            return Err(ImportError::unsupported(&self.path, feature));
        };
        let ends = offsets.iter().zip(&counts).map(|(offset, count)| offset.saturating_add(*count));
        if offsets.iter().skip(1).zip(ends).any(|(next, end)| *next != end) {
            let feature = "a stack in one directory with gaps between its strips";
            let advice = "write it again with a directory for each plane";
            return Err(ImportError::unsupported_but(&self.path, feature, advice));
        }
        Ok((start, self.endian()))
    }

    /// Fills `out` with the voxels in the x, y rectangle of `region`: one sample of each pixel of the current page.
    pub(super) fn read_rectangle(
        &mut self,
        format: &PageFormat,
        sample: u32,
        decode: Decode,
        region: VoxelBox,
        out: &mut [u8],
    ) -> Result<()> {
        if format.turn.is_none() {
            return self.read_stored(format, sample, decode, region, out);
        }
        let mut stored = vec![0; out.len()];
        self.read_stored(format, sample, decode, format.turn.stored(region, format.shown_size()), &mut stored)?;
        let size = [region.extent().x, region.extent().y];
        format.turn.turn(&stored, size, decode.voxel_type().bytes(), out);
        Ok(())
    }

    /// Like [`Self::read_rectangle`], for a region as stored.
    fn read_stored(
        &mut self,
        format: &PageFormat,
        sample: u32,
        decode: Decode,
        region: VoxelBox,
        out: &mut [u8],
    ) -> Result<()> {
        let (chunk_width, chunk_height) = self.chunk_size(format);
        let (across, down) = self.chunks(format);
        let plane = if format.planar { sample * across * down } else { 0 };
        let is_in_place = (format.planar || format.samples == 1) && decode.is_copy();
        for row in region.min.y / chunk_height..=(region.max.y - 1) / chunk_height {
            for column in region.min.x / chunk_width..=(region.max.x - 1) / chunk_width {
                let corner = [column * chunk_width, row * chunk_height];
                let chunk = VoxelBox::new(
                    [corner[0], corner[1], region.min.z],
                    [
                        corner[0].saturating_add(chunk_width).min(format.width),
                        corner[1].saturating_add(chunk_height).min(format.height),
                        region.max.z,
                    ],
                );
                let index = plane + row * across + column;
                let size = self.decoded_size(index)?;
                let rows = whole_rows(chunk, region, decode.voxel_type().bytes());
                match rows.filter(|rows| is_in_place && rows.len() == size.bytes) {
                    Some(rows) => self.decode_into(index, format, size, &mut out[rows])?,
                    None => {
                        self.decode_chunk(index, format)?;
                        self.copy(
                            format,
                            if format.planar { 0 } else { sample },
                            decode,
                            size.row_bytes,
                            chunk,
                            region,
                            out,
                        );
                    }
                }
            }
        }
        Ok(())
    }

    fn decoded_size(&mut self, index: u32) -> Result<DecodedSize> {
        let layout = self.decoder.image_chunk_buffer_layout(index);
        let layout = layout.map_err(|e| refusal(&self.path, &format!("strip or tile {index}"), e))?;
        Ok(DecodedSize { bytes: layout.len, row_bytes: layout.row_stride.map_or(layout.len, usize::from) })
    }

    /// Decodes a strip or tile into the buffer.
    fn decode_chunk(&mut self, index: u32, format: &PageFormat) -> Result<()> {
        let size = self.decoded_size(index)?;
        let mut chunk = std::mem::take(&mut self.chunk);
        chunk.resize(size.bytes, 0);
        let decoded = self.decode_into(index, format, size, &mut chunk);
        self.chunk = chunk;
        decoded
    }

    /// Decodes a strip or tile into `chunk`, of its size.
    fn decode_into(&mut self, index: u32, format: &PageFormat, size: DecodedSize, chunk: &mut [u8]) -> Result<()> {
        if let Packing::Unknown = self.packing {
            self.packing = self.find_packing()?;
        }
        if let Packing::Lzw { .. } = self.packing {
            return self.decode_lzw(index, format, size.row_bytes, chunk);
        }
        let Self { path, decoder, .. } = self;
        decoder.read_chunk_bytes(index, chunk).map_err(|e| not_decoded(path, index, e))?;
        if format.white_is_zero {
            chunk.iter_mut().for_each(|b| *b = !*b);
        }
        Ok(())
    }

    /// Decodes an LZW strip or tile into `chunk`, with rows of `stride` bytes.
    fn decode_lzw(&mut self, index: u32, format: &PageFormat, stride: usize, chunk: &mut [u8]) -> Result<()> {
        let damaged = |path: &Path, problem: String| {
            let problem = format!("strip or tile {index} cannot be decoded: {problem}; fetch the file again");
            ImportError::invalid(path, problem)
        };
        let endian = self.endian();
        let (data_width, rows) = self.decoder.chunk_data_dimensions(index);
        let chunk_width = self.decoder.chunk_dimensions().0.max(data_width);
        let Self { path, decoder, stamp, packing, scratch: [unpacked, packed], .. } = self;
        let Packing::Lzw { offsets, counts, predictor } = packing else { return Ok(()) };
        let place = offsets.get(index as usize).zip(counts.get(index as usize));
        let place = place.filter(|(at, count)| at.checked_add(**count).is_some_and(|end| end <= stamp.bytes));
        let Some((&at, &count)) = place else { return Err(damaged(path, "it lies outside of the file".into())) };
        let samples = if format.planar { 1 } else { format.samples as usize };
        let width = format.element.bytes();
        let row = u128::from(chunk_width) * (samples * width) as u128;
        if row * u128::from(rows) > u128::from(count) * u128::from(lzw::BEST_RATIO) {
            return Err(damaged(path, format!("{count} bytes cannot hold {rows} rows of {row}")));
        }
        // Further bytes are not part of the rows: a code takes at most 12 bits, and yields a byte at least.
        packed.resize(count.min(2 * row as u64 * u64::from(rows) + 64) as usize, 0);
        let file = decoder.inner();
        file.seek(SeekFrom::Start(at)).and_then(|_| file.read_exact(packed)).map_err(ImportError::io(path))?;

        let rows_of = Rows { predictor: *predictor, endian, width, samples, bytes: row as usize };
        // Rows of a tile may continue past the image.
        unpacked.resize(if rows_of.bytes == stride { 0 } else { rows_of.bytes * rows as usize }, 0);
        let whole = if rows_of.bytes == stride { &mut *chunk } else { &mut unpacked[..] };
        lzw::unpack(packed, whole).map_err(|problem| damaged(path, problem))?;
        lzw::undo(whole, rows_of);
        if rows_of.bytes != stride {
            for (row, whole) in chunk.chunks_exact_mut(stride).zip(unpacked.chunks_exact(rows_of.bytes)) {
                row.copy_from_slice(&whole[..stride]);
            }
        }
        Ok(())
    }

    fn find_packing(&mut self) -> Result<Packing> {
        if self.number::<u16>(Tag::Compression, PAGE)? != Some(LZW) {
            return Ok(Packing::Library);
        }
        let (offsets, counts) = match self.decoder.get_chunk_type() {
            ChunkType::Strip => (Tag::StripOffsets, Tag::StripByteCounts),
            ChunkType::Tile => (Tag::TileOffsets, Tag::TileByteCounts),
        };
        let (offsets, counts) = (self.numbers(offsets, PAGE)?, self.numbers(counts, PAGE)?);
        let predictor = match self.number::<u16>(Tag::Predictor, PAGE)? {
            Some(2) => Predictor::Horizontal,
            Some(3) => Predictor::Floats,
            _ => Predictor::None,
        };
        Ok(Packing::Lzw { offsets, counts, predictor })
    }

    fn endian(&self) -> Endian {
        match self.decoder.byte_order() {
            ByteOrder::LittleEndian => Endian::Little,
            ByteOrder::BigEndian => Endian::Big,
        }
    }

    /// Calls `see` with the decoded samples of every strip or tile of the current page, in this machine's byte order.
    pub(super) fn each_chunk(&mut self, format: &PageFormat, mut see: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let (across, down) = self.chunks(format);
        let planes = if format.planar { format.samples as u32 } else { 1 };
        for index in 0..planes * across * down {
            self.decode_chunk(index, format)?;
            see(&self.chunk)?;
        }
        Ok(())
    }

    fn chunk_size(&self, format: &PageFormat) -> (u32, u32) {
        match self.decoder.get_chunk_type() {
            ChunkType::Strip => (format.width, self.decoder.chunk_dimensions().1.min(format.height)),
            ChunkType::Tile => self.decoder.chunk_dimensions(),
        }
    }

    /// Strips or tiles of a plane along x and y.
    fn chunks(&self, format: &PageFormat) -> (u32, u32) {
        let (width, height) = self.chunk_size(format);
        (format.width.div_ceil(width), format.height.div_ceil(height))
    }

    /// Copies the part of the decoded chunk in `region`.
    #[allow(clippy::too_many_arguments, reason = "two rectangles and their layouts")]
    fn copy(
        &self,
        format: &PageFormat,
        sample: u32,
        decode: Decode,
        stride: usize,
        chunk: VoxelBox,
        region: VoxelBox,
        out: &mut [u8],
    ) {
        let samples = if format.planar { 1 } else { format.samples as usize };
        let (element, voxel) = (decode.element.bytes(), decode.voxel_type().bytes());
        let pixel = element * samples;
        let both = chunk.intersect(region);
        let width = both.extent().x as usize;
        for y in both.min.y..both.max.y {
            let from = (y - chunk.min.y) as usize * stride
                + (both.min.x - chunk.min.x) as usize * pixel
                + sample as usize * element;
            let to = (y - region.min.y) as usize * region.extent().x as usize + (both.min.x - region.min.x) as usize;
            decode.line(&self.chunk[from..], pixel, &mut out[to * voxel..], voxel, width);
        }
    }
}

/// A plane may be larger than the library's default limits, but nothing can be larger than the file, and a damaged length must not
/// become an allocation.
fn limits(file_bytes: u64) -> Limits {
    let bytes = usize::try_from(file_bytes).unwrap_or(usize::MAX);
    let mut limits = Limits::unlimited();
    limits.intermediate_buffer_size = bytes;
    limits.ifd_value_size = bytes.min(MOST_TAG_BYTES);
    // Despite its name, it bounds only the values of a tag here, 32 bytes each.
    limits.decoding_buffer_size = bytes.saturating_mul(32).min(MOST_TAG_BYTES);
    limits
}

fn is_unsigned(element: Element) -> bool {
    matches!(element, Element::Voxel(VoxelType::U8 | VoxelType::U16 | VoxelType::U32) | Element::U64)
}

/// Size of a decoded strip or tile.
#[derive(Clone, Copy)]
struct DecodedSize {
    bytes: usize,
    /// From one row to the next.
    row_bytes: usize,
}

/// The place of a strip's rows in the voxels of `region`, if it is of whole rows there.
fn whole_rows(strip: VoxelBox, region: VoxelBox, voxel_bytes: usize) -> Option<Range<usize>> {
    let is_whole = strip.min.x == region.min.x && strip.max.x == region.max.x;
    let is_within = strip.min.y >= region.min.y && strip.max.y <= region.max.y;
    let row_bytes = region.extent().x as usize * voxel_bytes;
    (is_whole && is_within)
        .then(|| (strip.min.y - region.min.y) as usize * row_bytes..(strip.max.y - region.min.y) as usize * row_bytes)
}

/// A strip or tile of uncompressed pixels.
struct PlainChunk {
    row_bytes: u64,
    rows: u64,
    /// Rows of the page, where the last strip ends; tiles are whole.
    height: Option<u64>,
}

impl PlainChunk {
    /// Bytes of the pixels in the strip or tile of this index; strips of further samples follow those of the first.
    fn bytes(&self, index: u64) -> u64 {
        let rows = self.height.map_or(self.rows, |height| {
            let strip = index % height.div_ceil(self.rows).max(1);
            (height - strip * self.rows).min(self.rows)
        });
        self.row_bytes.saturating_mul(rows)
    }
}

fn element_of(sample: DecodingSampleType) -> Option<Element> {
    use DecodingSampleType as S;
    Some(match sample {
        S::U8 => Element::Voxel(VoxelType::U8),
        S::I8 => Element::Voxel(VoxelType::I8),
        S::U16 => Element::Voxel(VoxelType::U16),
        S::I16 => Element::Voxel(VoxelType::I16),
        S::U32 => Element::Voxel(VoxelType::U32),
        S::I32 => Element::Voxel(VoxelType::I32),
        S::F32 => Element::Voxel(VoxelType::F32),
        S::U64 => Element::U64,
        S::I64 => Element::I64,
        S::F64 => Element::F64,
        S::F16 => Element::F16,
    })
}

/// An optional tag's value: `None` if missing or damaged. But a disk error is returned, since the tag may define the values.
pub(super) fn said<T>(path: &Path, read: Result<Option<T>, TiffError>) -> Result<Option<T>> {
    match read {
        Err(TiffError::IoError(error)) if !is_damage(&error) => Err(ImportError::io(path)(error)),
        // Without its scale or description, a cut file would have other values.
        Err(TiffError::IoError(error)) if error.kind() == ErrorKind::UnexpectedEof => {
            let problem = "cut short: the value of a tag lies past the file's end; fetch the file again";
            Err(ImportError::invalid(path, problem))
        }
        read => Ok(read.ok().flatten()),
    }
}
