//! One TIFF file being decoded: its pages' format, the check that their data exist, and rectangles of samples.

use super::description::Description;
use crate::element::{Decode, Element, Endian};
use crate::error::ImportError;
use crate::stamp::Stamp;
use brickyard_volume::{VoxelBox, VoxelType};
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};
use tiff::TiffError;
use tiff::decoder::{ChunkType, Decoder, DecodingSampleType, Limits};
use tiff::tags::{ByteOrder, Tag};

/// Most bytes of a description that are read; OME-XML of large plates reaches tens of megabytes.
const LONGEST_DESCRIPTION: u64 = 256 << 20;

/// Most memory for the values of one tag: 8 million strips.
const MOST_TAG_BYTES: usize = 256 << 20;

/// No compression reaches this ratio: a strip that claims more is a damaged header, not something to allocate.
const ABSURD_RATIO: u64 = 1 << 16;

/// Values of the tag Compression.
const JPEG: u16 = 7;
const ZSTD: u16 = 50000;
/// What a Zstandard decoder keeps of its output at most, by default.
const MOST_ZSTD_WINDOW: u64 = 128 << 20;
/// A strip's or tile's offset and length.
const CHUNK_PLACE_BYTES: u64 = 16;

/// What all pages of a stack must agree in.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct PageFormat {
    pub(super) width: u32,
    pub(super) height: u32,
    pub(super) element: Element,
    /// Samples per pixel.
    pub(super) samples: u16,
    /// Whether the samples of a pixel lie in planes of their own.
    planar: bool,
    /// The decoder inverts such images for display; data want the stored values.
    white_is_zero: bool,
}

impl std::fmt::Display for PageFormat {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{} {}", self.width, self.height, self.element.name())?;
        if self.samples > 1 {
            write!(f, " with {} samples a pixel", self.samples)?;
        }
        if self.white_is_zero {
            write!(f, " (white is zero)")?;
        }
        Ok(())
    }
}

/// A file and the decoder at one of its pages.
pub(super) struct OpenTiff {
    path: PathBuf,
    decoder: Decoder<BufReader<File>>,
    /// Of the file when it was opened.
    pub(super) stamp: Stamp,
    /// The decoded strip or tile.
    chunk: Vec<u8>,
}

impl OpenTiff {
    pub(super) fn open(path: &Path) -> Result<Self, ImportError> {
        let file = File::open(path).map_err(ImportError::io(path))?;
        let stamp = Stamp::in_metadata(&file.metadata().map_err(ImportError::io(path))?);
        let decoder = Decoder::new(BufReader::new(file)).map_err(|e| refusal(path, "cannot be read", e))?;
        let decoder = decoder.with_limits(limits(stamp.bytes()));
        Ok(Self { path: path.to_owned(), decoder, stamp, chunk: Vec::new() })
    }

    pub(super) fn has_more_pages(&self) -> bool {
        self.decoder.more_images()
    }

    /// Goes on to the page with this number, counted from 1.
    pub(super) fn next_page(&mut self, number: u32) -> Result<(), ImportError> {
        self.decoder.next_image().map_err(|e| refusal(&self.path, &format!("page {number} cannot be read"), e))
    }

    /// Goes to a page counted from 0.
    pub(super) fn seek(&mut self, page: u32) -> Result<(), ImportError> {
        let seek = self.decoder.seek_to_image(page as usize);
        seek.map_err(|e| refusal(&self.path, &format!("page {} cannot be read", page + 1), e))
    }

    /// What the image description and the resolution say.
    pub(super) fn description(&mut self) -> Description {
        let resolution = self.resolution();
        let mut tags = self.decoder.image_ifd();
        let length = tags
            .find_entry(Tag::ImageDescription)
            .map_or(0, |e| e.count().min(LONGEST_DESCRIPTION).min(self.stamp.bytes()));
        let mut bytes = vec![0; length as usize];
        // A description that cannot be read is no reason to refuse the voxels.
        let read = tags.find_tag_bytes(Tag::ImageDescription, &mut bytes, 0).ok().flatten().unwrap_or(0);
        bytes.truncate(read);
        let text = match std::str::from_utf8(&bytes) {
            Ok(text) => text.to_owned(),
            // ImageJ writes Latin-1, whose bytes are the first 256 code points.
            Err(_) => bytes.iter().map(|&b| b as char).collect(),
        };
        Description::parse(text.trim_end_matches('\0'), resolution)
    }

    /// Pixels per unit along x and y.
    fn resolution(&mut self) -> Option<(f64, f64)> {
        use tiff::decoder::ifd::Value;
        let mut read = |tag| {
            let value = self.decoder.find_tag(tag).ok()??;
            if let Value::Rational(n, d) = value { (d > 0).then(|| n as f64 / d as f64) } else { None }
        };
        Some((read(Tag::XResolution)?, read(Tag::YResolution)?))
    }

    pub(super) fn format(&mut self) -> Result<PageFormat, ImportError> {
        let path = self.path.clone();
        let refuse = |e| refusal(&path, "unsupported page", e);
        let (width, height) = self.decoder.dimensions().map_err(refuse)?;
        let color = self.decoder.colortype().map_err(refuse)?;
        let layout = self.decoder.image_chunk_buffer_layout(0).map_err(refuse)?;
        let unsupported =
            || ImportError::unsupported(&path, format!("pixel type {color:?}, {:?}", layout.sample_format));
        let bits = color.bit_depth() as usize;
        let element =
            layout.sample_type.and_then(element_of).filter(|e| e.bytes() * 8 == bits).ok_or_else(unsupported)?;
        let tag = |decoder: &mut Decoder<_>, tag| decoder.find_tag_unsigned::<u16>(tag).map_err(refuse);
        let white_is_zero = match tag(&mut self.decoder, Tag::PhotometricInterpretation)? {
            Some(1 | 2) => false,
            // Undone by inverting once more; not exact for floats.
            Some(0) if !matches!(element, Element::Voxel(VoxelType::F32) | Element::F64) => true,
            _ => return Err(unsupported()),
        };
        let file_bytes = self.stamp.bytes();
        if layout.len as u64 > file_bytes.saturating_mul(ABSURD_RATIO) {
            let problem = format!(
                "claims strips or tiles of {} bytes in a file of {file_bytes}: the header is damaged",
                layout.len
            );
            return Err(ImportError::invalid(&path, problem));
        }
        let planar = tag(&mut self.decoder, Tag::PlanarConfiguration)? == Some(2);
        Ok(PageFormat { width, height, element, samples: color.num_samples(), planar, white_is_zero })
    }

    /// Memory that decoding a strip or tile of the page takes: what comes out, what the decompressor keeps, and the lists of places.
    pub(super) fn reader_bytes(&mut self, format: &PageFormat) -> Result<u64, ImportError> {
        let path = self.path.clone();
        let refuse = |e| refusal(&path, "unsupported page", e);
        let decoded = self.decoder.image_chunk_buffer_layout(0).map_err(refuse)?.len as u64;
        let kept = match self.decoder.find_tag_unsigned::<u16>(Tag::Compression).map_err(refuse)? {
            // Both of it and of what it is made from.
            Some(JPEG) => decoded.saturating_mul(2),
            Some(ZSTD) => decoded.min(MOST_ZSTD_WINDOW),
            _ => 0,
        };
        let (width, height) = self.decoder.chunk_dimensions();
        let chunks = format.width.div_ceil(width.max(1)) as u64 * format.height.div_ceil(height.max(1)) as u64;
        let planes = if format.planar { format.samples as u64 } else { 1 };
        Ok(decoded.saturating_add(kept).saturating_add(chunks.saturating_mul(planes * CHUNK_PLACE_BYTES)))
    }

    /// Gives up the memory of the last strip or tile.
    pub(super) fn rest(mut self) -> Self {
        self.chunk = Vec::new();
        self
    }

    /// Checks that all strips or tiles of the page lie inside the file.
    pub(super) fn check_data(&mut self, path: &Path, number: u32) -> Result<(), ImportError> {
        let mut numbers = |tag| {
            let list = self.decoder.find_tag_unsigned_vec::<u64>(tag);
            list.map(Option::unwrap_or_default).map_err(|e| refusal(path, &format!("page {number}"), e))
        };
        let tags = [(Tag::StripOffsets, Tag::StripByteCounts), (Tag::TileOffsets, Tag::TileByteCounts)];
        for (offsets, counts) in tags {
            let ends = numbers(offsets)?.into_iter().zip(numbers(counts)?).map(|(o, n)| o.saturating_add(n));
            let end = ends.max().unwrap_or(0);
            let found = self.stamp.bytes();
            if end > found {
                let problem = format!(
                    "cut short: the data of page {number} reach to byte {end}, found {found} ({} missing)",
                    end - found
                );
                return Err(ImportError::invalid(path, problem));
            }
        }
        Ok(())
    }

    /// Where the data of a page start that lie uncompressed in one piece, and their byte order.
    pub(super) fn contiguous_start(&mut self, path: &Path, format: &PageFormat) -> Result<(u64, Endian), ImportError> {
        let refuse = |e| refusal(path, "cannot be read", e);
        let compression = self.decoder.find_tag_unsigned::<u16>(Tag::Compression).map_err(refuse)?.unwrap_or(1);
        let offsets = self.decoder.find_tag_unsigned_vec::<u64>(Tag::StripOffsets).map_err(refuse)?.unwrap_or_default();
        let (Some(&start), 1, 1) = (offsets.first(), compression, format.samples) else {
            let feature = "a stack in one directory that is compressed, tiled or coloured";
            return Err(ImportError::unsupported(path, feature));
        };
        let endian = match self.decoder.byte_order() {
            ByteOrder::LittleEndian => Endian::Little,
            ByteOrder::BigEndian => Endian::Big,
        };
        Ok((start, endian))
    }

    /// Fills `out` with one sample of the pixels in the x, y rectangle of `region`, from the page where the decoder
    /// stands.
    pub(super) fn read_rectangle(
        &mut self,
        format: &PageFormat,
        sample: u32,
        decode: Decode,
        region: VoxelBox,
        out: &mut [u8],
    ) -> Result<(), ImportError> {
        let (chunk_width, chunk_height) = match self.decoder.get_chunk_type() {
            ChunkType::Strip => (format.width, self.decoder.chunk_dimensions().1.min(format.height)),
            ChunkType::Tile => self.decoder.chunk_dimensions(),
        };
        let (across, down) = (format.width.div_ceil(chunk_width), format.height.div_ceil(chunk_height));
        let plane = if format.planar { sample * across * down } else { 0 };
        for row in region.min.y / chunk_height..=(region.max.y - 1) / chunk_height {
            for column in region.min.x / chunk_width..=(region.max.x - 1) / chunk_width {
                let corner = [column * chunk_width, row * chunk_height];
                let stride = self.decode_chunk(plane + row * across + column, format)?;
                let chunk = VoxelBox::new(
                    [corner[0], corner[1], region.min.z],
                    [
                        corner[0].saturating_add(chunk_width).min(format.width),
                        corner[1].saturating_add(chunk_height).min(format.height),
                        region.max.z,
                    ],
                );
                self.copy(format, if format.planar { 0 } else { sample }, decode, stride, chunk, region, out);
            }
        }
        Ok(())
    }

    /// Decodes a strip or tile into the buffer; returns the bytes from one of its rows to the next.
    fn decode_chunk(&mut self, index: u32, format: &PageFormat) -> Result<usize, ImportError> {
        let Self { path, decoder, chunk, .. } = self;
        let layout = decoder.image_chunk_buffer_layout(index);
        let layout = layout.map_err(|e| refusal(path, &format!("strip or tile {index}"), e))?;
        chunk.resize(layout.len, 0);
        decoder
            .read_chunk_bytes(index, chunk)
            .map_err(|e| refusal(path, &format!("strip or tile {index} cannot be decoded"), e))?;
        if format.white_is_zero {
            chunk.iter_mut().for_each(|b| *b = !*b);
        }
        Ok(layout.row_stride.map_or(layout.len, usize::from))
    }

    /// Copies what `region` has of the decoded chunk.
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

/// A plane may well be larger than the library's default limits, but nothing can be larger than the file, and a damaged
/// length must not become an allocation.
fn limits(file_bytes: u64) -> Limits {
    let bytes = usize::try_from(file_bytes).unwrap_or(usize::MAX);
    let mut limits = Limits::unlimited();
    limits.intermediate_buffer_size = bytes;
    limits.ifd_value_size = bytes.min(MOST_TAG_BYTES);
    // Despite its name, of what is used here it bounds only the values of a tag, 32 bytes each.
    limits.decoding_buffer_size = bytes.saturating_mul(32).min(MOST_TAG_BYTES);
    limits
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
        S::F16 => return None,
    })
}

/// What the library says, as this crate's error.
fn refusal(path: &Path, what: &str, error: TiffError) -> ImportError {
    match error {
        TiffError::UnsupportedError(e) => ImportError::unsupported(path, format!("{what}: {e}")),
        TiffError::IoError(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => {
            ImportError::invalid(path, format!("{what}: the file is cut short"))
        }
        TiffError::IoError(e) => ImportError::io(path)(e),
        e => ImportError::invalid(path, format!("{what}: {e}")),
    }
}
