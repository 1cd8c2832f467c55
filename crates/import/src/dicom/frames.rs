//! Frames of a file: their packing, places and decoding.
//!
//! Frames are read and decoded one by one, in the memory of one, however many the file holds.

use super::fragments::{Ranges, fragment_places, read_ranges};
use super::header::{EXPLICIT_BIG_ENDIAN, Header};
use super::mosaic::Mosaic;
use super::pixels::{Bytes, PixelFormat, Samples};
use super::{decode, dose, nuclear};
use crate::element::Endian;
use crate::error::{ImportError, Result};
use crate::mapped::MappedFile;
use brickyard_volume::{VoxelBox, counted};
use dicom_core::VR;
use dicom_dictionary_std::{tags, uids};
use std::path::Path;
use std::sync::Arc;

/// Supported transfer syntaxes, for the message about another one.
const READ: &str = "implicit and explicit little endian, explicit big endian, deflated, RLE, JPEG baseline, JPEG lossless and JPEG 2000";

/// Packing ratio beyond all codecs: a frame above it has a damaged header and must not cause an allocation.
const ABSURD_RATIO: u64 = 1 << 16;

/// Bytes per pixel taken by the decoders, coefficients and results together.
const JPEG_PIXEL_BYTES: u64 = 8;
const JPEG_2000_PIXEL_BYTES: u64 = 20;

/// The encoding of frames.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Packing {
    Native(Endian),
    /// The whole data set is deflated.
    Deflated,
    Encapsulated(Codec),
}

/// Packing of a single frame.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Codec {
    Rle,
    Jpeg,
    Jpeg2000,
}

impl Codec {
    /// First bytes of a frame, where they tell it: of JPEG, JPEG 2000's codestream and its file.
    fn starts(self) -> &'static [&'static [u8]] {
        match self {
            Self::Rle => &[],
            Self::Jpeg => &[b"\xff\xd8\xff"],
            Self::Jpeg2000 => &[b"\xff\x4f\xff\x51", b"\0\0\0\x0cjP  "],
        }
    }
}

/// Frames of one DICOM file: their storage and places. The slices of a mosaic are frames of one picture.
#[derive(Debug)]
pub(super) struct Frames {
    pub(super) format: PixelFormat,
    packing: Packing,
    /// Ranges of each frame in the file, or in its inflated data set.
    places: Vec<Ranges>,
    pub(super) mosaic: Option<Mosaic>,
    /// Bytes of native pixel data after the last frame.
    pub(super) spare_bytes: u64,
}

impl Frames {
    /// Finds the frames of a file by its header, and checks that the file holds them all.
    pub(super) fn find(header: &Header) -> Result<Self> {
        let path = header.path.as_path();
        let format = PixelFormat::of(header)?;
        let Some(pixels) = header.pixels else {
            let problem =
                "expected pixel data after the header, found the file's end: it is a header alone, or was cut there";
            return Err(ImportError::invalid(path, problem));
        };
        let mut packing = packing_of(header)?;
        if format.is_float && pixels.length.is_none() {
            let feature = format!("floating-point pixels in {}", header.syntax_name());
            return Err(ImportError::unsupported_but(path, feature, "decompress it, as gdcmconv --raw does"));
        }
        if let (Packing::Encapsulated(codec @ (Codec::Jpeg | Codec::Jpeg2000)), None) = (packing, pixels.length) {
            format.check_codec(path, codec == Codec::Jpeg2000)?;
        }
        let count = frame_count(header)?;
        // Before a place is stored for each.
        check_frames(header, count)?;
        let places = match (packing, pixels.length) {
            (Packing::Encapsulated(codec), None) => fragment_places(path, count, pixels.offset, codec.starts())?,
            (_, None) => {
                let problem = format!("is {}, but its pixels are encapsulated; write it again", header.syntax_name());
                return Err(ImportError::invalid(path, problem));
            }
            (Packing::Native(Endian::Big), _) if format.width == 1 && pixels.vr == VR::OW => {
                return Err(ImportError::unsupported(path, "8-bit pixels in 16-bit words of big-endian order"));
            }
            (Packing::Deflated, _) if count > 1 => {
                let advice = "inflate it first, as dcmconv +te does";
                return Err(ImportError::unsupported_but(path, "a deflated file of several frames", advice));
            }
            (Packing::Deflated, Some(length)) => {
                native_places(path, &format, count, pixels.offset, length, header.inflated_bytes)?
            }
            (_, Some(length)) => {
                // Some archives decompress pixels and keep the syntax's name.
                if let Packing::Encapsulated(_) = packing {
                    packing = Packing::Native(Endian::Little);
                }
                let end = std::fs::metadata(path).map_err(ImportError::io(path))?.len();
                native_places(path, &format, count, pixels.offset, length, end)?
            }
        };
        let mosaic = Mosaic::of(header)?;
        if mosaic.is_some() && places.len() > 1 {
            return Err(ImportError::unsupported(path, "a mosaic of several frames"));
        }
        header.confirm()?;
        let held: u64 = places.iter().flatten().map(|range| range.1).sum();
        let spare_bytes = pixels.length.map_or(0, |length| length.saturating_sub(held));
        Ok(Self { format, packing, places, mosaic, spare_bytes })
    }

    pub(super) fn count(&self) -> usize {
        self.mosaic.map_or(self.places.len(), |mosaic| mosaic.slices as usize)
    }

    /// Columns and rows of a frame.
    pub(super) fn size(&self) -> [u32; 2] {
        self.mosaic.map_or([self.format.columns, self.format.rows], |mosaic| [mosaic.columns, mosaic.rows])
    }

    /// A frame's box as a box of the picture read for it.
    pub(super) fn in_picture(&self, frame: usize, region: VoxelBox) -> VoxelBox {
        self.mosaic.map_or(region, |mosaic| mosaic.in_picture(frame as u32, region))
    }

    /// Most memory for reading one frame, in bytes: the packed frame and its decoder. Native frames are mapped.
    pub(super) fn reader_bytes(&self) -> u64 {
        let packed = |ranges: &Ranges| ranges.iter().map(|range| range.1).sum();
        let packed: u64 = self.places.iter().map(packed).max().unwrap_or(0);
        let per_pixel = match self.packing {
            Packing::Native(_) => return 0,
            Packing::Deflated => 0,
            Packing::Encapsulated(Codec::Rle) => self.format.width as u64,
            Packing::Encapsulated(Codec::Jpeg) => JPEG_PIXEL_BYTES,
            Packing::Encapsulated(Codec::Jpeg2000) => JPEG_2000_PIXEL_BYTES,
        };
        packed + self.format.pixels() * per_pixel
    }

    /// Byte order of numbers that are not compressed.
    pub(super) fn endian(&self) -> Endian {
        match self.packing {
            Packing::Native(endian) => endian,
            Packing::Deflated | Packing::Encapsulated(_) => Endian::Little,
        }
    }

    pub(super) fn held_bytes(&self) -> usize {
        let ranges: usize = self.places.iter().map(|ranges| size_of_val(&ranges[..])).sum();
        size_of_val(&self.places[..]) + ranges
    }

    /// Whether frames lie in the file as they are, so that any box of one is read alone.
    pub(super) fn are_native(&self) -> bool {
        matches!(self.packing, Packing::Native(_))
    }

    /// One native frame, or the picture containing it, in the file's map. [`Samples::confirm`] tells after the reading whether it was the file's.
    pub(super) fn view(&self, file: Arc<MappedFile>, frame: usize) -> Result<Samples> {
        let frame = if self.mosaic.is_some() { 0 } else { frame };
        let range =
            self.places[frame].first().map_or(0..0, |(first, length)| *first as usize..(first + length) as usize);
        if range.end > file.len() {
            return Err(ImportError::io(&file.path)(std::io::ErrorKind::UnexpectedEof.into()));
        }
        Ok(Samples { bytes: Bytes::Mapped { file, range }, width: self.format.width, endian: self.endian() })
    }

    /// Reads and decodes one frame, or the picture containing it. [`Samples::confirm`] tells afterwards whether they were the file's.
    pub(super) fn read(&self, header: &Header, frame: usize) -> Result<Samples> {
        if self.are_native() {
            return self.view(Arc::new(header.map()?), frame);
        }
        let path = header.path.as_path();
        let frame = if self.mosaic.is_some() { 0 } else { frame };
        let (width, endian) = (self.format.width, self.endian());
        let bytes = match (self.packing, &self.places[frame][..]) {
            (Packing::Deflated, &[(first, length), ..]) => header.read_inflated(first, length),
            (_, ranges) => read_ranges(path, ranges),
        };
        // The file is reopened for each frame: the bytes, or an error, count only if it is unchanged since its header was read.
        header.confirm()?;
        let bytes = bytes?;
        let refuse = |problem: String| {
            let problem = format!("frame {} cannot be decoded: {problem}; fetch the file again", frame + 1);
            ImportError::invalid(path, problem)
        };
        let expected = self.format.pixels() * width as u64;
        if expected / ABSURD_RATIO > bytes.len() as u64 {
            return Err(refuse(format!("{} bytes cannot hold {expected}", bytes.len())));
        }
        match self.packing {
            Packing::Native(_) | Packing::Deflated => Ok(Samples::decoded(bytes, width, endian)),
            Packing::Encapsulated(codec) => {
                let decode = match codec {
                    Codec::Rle => decode::rle,
                    Codec::Jpeg => decode::jpeg,
                    Codec::Jpeg2000 => decode::jpeg_2000,
                };
                decode(&bytes, &self.format).map_err(refuse)
            }
        }
    }
}

/// Checks that each frame of a file has a place.
pub(super) fn check_frames(header: &Header, count: u64) -> Result<()> {
    let placed = header.placed_frames() as u64;
    if count > 1 && nuclear::is_nuclear(header) {
        return nuclear::check(header, count);
    }
    if count > 1 && placed == 0 && !dose::places(header, count) {
        let feature =
            format!("a file of {count} frames without a place for each (no PerFrameFunctionalGroupsSequence)");
        let advice = "export the frames to TIFF or .npy, and pack these with `spacing`";
        return Err(ImportError::unsupported_but(&header.path, feature, advice));
    }
    if placed > 0 && placed != count {
        let problem =
            format!("declares {}, but gives positions for {placed}; write the file again", counted(count, "frame"));
        return Err(ImportError::invalid(&header.path, problem));
    }
    Ok(())
}

/// Number of frames by the header, 1 by default.
pub(super) fn frame_count(header: &Header) -> Result<u64> {
    let text = header.text(tags::NUMBER_OF_FRAMES).filter(|text| !text.is_empty());
    let Some(text) = text else { return Ok(1) };
    let count = text.parse::<f64>().ok().filter(|n| n.fract() == 0.0 && (1.0..=f64::from(u32::MAX)).contains(n));
    let problem = || format!("NumberOfFrames is '{text}', expected a whole number from 1 on");
    count.map(|n| n as u64).ok_or_else(|| ImportError::invalid(&header.path, problem()))
}

fn packing_of(header: &Header) -> Result<Packing> {
    Ok(match header.syntax.as_str() {
        uids::IMPLICIT_VR_LITTLE_ENDIAN | uids::EXPLICIT_VR_LITTLE_ENDIAN => Packing::Native(Endian::Little),
        EXPLICIT_BIG_ENDIAN => Packing::Native(Endian::Big),
        uids::DEFLATED_EXPLICIT_VR_LITTLE_ENDIAN => Packing::Deflated,
        uids::RLE_LOSSLESS => Packing::Encapsulated(Codec::Rle),
        uids::JPEG_BASELINE8_BIT | uids::JPEG_LOSSLESS | uids::JPEG_LOSSLESS_SV1 => Packing::Encapsulated(Codec::Jpeg),
        uids::JPEG2000_LOSSLESS | uids::JPEG2000 => Packing::Encapsulated(Codec::Jpeg2000),
        other => {
            let name = header.syntax_name();
            let tool = match other {
                uids::JPEGLS_LOSSLESS | uids::JPEGLS_NEAR_LOSSLESS => "gdcmconv --raw or dcmdjpls does",
                uids::HTJ2K | uids::HTJ2K_LOSSLESS | uids::HTJ2K_LOSSLESS_RPCL => {
                    "pydicom's decompress() does with pylibjpeg-openjpeg"
                }
                uids::JPEG_EXTENDED12_BIT => "gdcmconv --raw or dcmdjpeg does",
                _ => "gdcmconv --raw does",
            };
            let advice = format!("decompress it, as {tool}; {READ} are read");
            return Err(ImportError::unsupported_but(&header.path, format!("transfer syntax {name}"), &advice));
        }
    })
}

/// Places of contiguous frames in a file that ends at `end`.
fn native_places(
    path: &Path,
    format: &PixelFormat,
    count: u64,
    offset: u64,
    length: u64,
    end: u64,
) -> Result<Vec<Ranges>> {
    let frame = format.pixels() * format.width as u64;
    let expected = frame.saturating_mul(count);
    let found = length.min(end.saturating_sub(offset));
    if found < expected {
        let PixelFormat { columns, rows, width, .. } = format;
        let (frames, missing) = (counted(count, "frame"), expected - found);
        let problem = format!(
            "cut short: {frames} of {columns} x {rows} pixels of {width} bytes are {expected} bytes, found {found} \
             ({missing} missing); fetch the file again"
        );
        return Err(ImportError::invalid(path, problem));
    }
    Ok((0..count).map(|i| vec![(offset + i * frame, frame)]).collect())
}
