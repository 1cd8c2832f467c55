//! Pixel format: the storage of numbers, and their conversion to voxels.

use super::header::Header;
use crate::element::Endian;
use crate::error::{ImportError, Result};
use crate::mapped::MappedFile;
use brickyard_volume::{VoxelBox, VoxelType, with_voxel_type};
use dicom_dictionary_std::tags;
use std::ops::{Deref, Range};
use std::path::Path;
use std::sync::Arc;

/// Most bits of an exactly decoded JPEG 2000 pixel. The decoder computes in f32, with integers up to 24 bits, and
/// coefficients have a few bits more than pixels.
pub(super) const MOST_JPEG_2000_BITS: u32 = 16;

/// The stored form of a pixel's number.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct PixelFormat {
    pub(super) columns: u32,
    pub(super) rows: u32,
    /// Bytes of a stored number: 1, 2 or 4, of floats 4 or 8.
    pub(super) width: usize,
    /// Whether numbers are floats (Float Pixel Data, Double Float Pixel Data); the fields below are for integers.
    pub(super) is_float: bool,
    bits: u32,
    /// Bits below the number within its bytes.
    shift: u32,
    signed: bool,
}

impl PixelFormat {
    /// Reads the pixel format from a header and checks it.
    pub(super) fn of(header: &Header) -> Result<Self> {
        let path = header.path.as_path();
        let need = |tag, name: &str| {
            header.number(tag).ok_or_else(|| {
                let problem = "is missing: the layout of its pixels is not known; write the file again";
                ImportError::invalid(path, format!("{name} {tag} {problem}"))
            })
        };
        let samples = header.number(tags::SAMPLES_PER_PIXEL).unwrap_or(1.0);
        let photometric = header.text(tags::PHOTOMETRIC_INTERPRETATION).unwrap_or_default();
        // Numbers of a palette are labels.
        let is_label = photometric == "PALETTE COLOR" && header.text(tags::SEGMENTATION_TYPE).is_some();
        if samples != 1.0 || !(is_label || photometric.is_empty() || photometric.starts_with("MONOCHROME")) {
            let feature = format!(
                "a colour image ({photometric}, {samples} samples a pixel; expected MONOCHROME1 or MONOCHROME2 with 1)"
            );
            let advice = "export it as a gray image to TIFF or .npy, and pack that";
            return Err(ImportError::unsupported_but(path, feature, advice));
        }
        let [rows, columns] = [need(tags::ROWS, "Rows")?, need(tags::COLUMNS, "Columns")?];
        let allocated = need(tags::BITS_ALLOCATED, "BitsAllocated")?;
        let floats = header.pixels.and_then(|pixels| match pixels.tag {
            tags::FLOAT_PIXEL_DATA => Some(32.0),
            tags::DOUBLE_FLOAT_PIXEL_DATA => Some(64.0),
            _ => None,
        });
        if let Some(expected) = floats.filter(|expected| *expected != allocated) {
            let problem = format!("BitsAllocated is {allocated}, but its pixels are floats of {expected} bits");
            return Err(ImportError::invalid(path, problem));
        }
        let is_float = floats.is_some();
        let stored = header.number(tags::BITS_STORED).unwrap_or(allocated);
        let high = header.number(tags::HIGH_BIT).unwrap_or(stored - 1.0);
        if !is_float && ![8.0, 16.0, 32.0].contains(&allocated) {
            let feature = format!("{allocated} bits a pixel");
            return Err(ImportError::unsupported_but(path, feature, "8, 16 and 32 are read"));
        }
        if ![rows, columns].iter().all(|n| (1.0..=65535.0).contains(n)) {
            let problem = format!("is {columns} x {rows} pixels: every axis needs 1 to 65535");
            return Err(ImportError::invalid(path, problem));
        }
        let is_held = stored >= 1.0 && high + 1.0 >= stored && high < allocated;
        if !(is_float || is_held) {
            let problem = format!("BitsStored {stored} and HighBit {high} do not fit into BitsAllocated {allocated}");
            return Err(ImportError::invalid(path, problem));
        }
        Ok(Self {
            columns: columns as u32,
            rows: rows as u32,
            width: allocated as usize / 8,
            is_float,
            bits: if is_float { 32 } else { stored as u32 },
            shift: if is_float { 0 } else { (high + 1.0 - stored) as u32 },
            signed: header.number(tags::PIXEL_REPRESENTATION) == Some(1.0),
        })
    }

    /// Refuses JPEG and JPEG 2000 formats that their decoders would misread.
    pub(super) fn check_codec(&self, path: &Path, is_jpeg_2000: bool) -> Result<()> {
        if self.shift > 0 {
            return Err(ImportError::unsupported(path, "JPEG pixels whose HighBit is not BitsStored - 1"));
        }
        if is_jpeg_2000 && self.bits > MOST_JPEG_2000_BITS {
            let feature = format!("JPEG 2000 of {} bits a pixel", self.bits);
            return Err(ImportError::unsupported_but(path, feature, "up to 16 are read; decompress it first"));
        }
        Ok(())
    }

    pub(super) fn pixels(&self) -> u64 {
        self.columns as u64 * self.rows as u64
    }

    /// Refuses a decoded frame whose size differs from the header's, or with more bytes per pixel than the header
    /// allocates.
    pub(super) fn check_decoded(&self, found: [u32; 2], width: usize) -> Result<(), String> {
        if found == [self.columns, self.rows] && (1..=self.width).contains(&width) {
            return Ok(());
        }
        Err(format!(
            "expected {} x {} pixels of at most {} bytes, found {} x {} of {width}",
            self.columns, self.rows, self.width, found[0], found[1]
        ))
    }

    /// Least and greatest storable number.
    pub(super) fn limits(&self) -> [i64; 2] {
        if self.signed { [-(1 << (self.bits - 1)), (1 << (self.bits - 1)) - 1] } else { [0, (1 << self.bits) - 1] }
    }

    /// Clamps a decoded number to [`PixelFormat::limits`]. If only one of stream (`signed`) and header is signed, only
    /// the bits have a meaning, and the number is returned unchanged.
    pub(super) fn clamped(&self, n: i64, signed: bool) -> i64 {
        let [least, greatest] = self.limits();
        if signed == self.signed && self.shift == 0 { n.clamp(least, greatest) } else { n }
    }

    /// Converts a number of the header written as unsigned to signed, if the pixels are signed.
    pub(super) fn wrapped(&self, n: i64) -> i64 {
        let past = n > self.limits()[1] && self.signed;
        if past { n - (1 << (8 * self.width)) } else { n }
    }

    /// The number in the bits of a pixel.
    #[inline(always)]
    fn number(&self, raw: u32) -> i64 {
        let unused = 32 - self.bits;
        let high = (raw >> self.shift) << unused;
        if self.signed { ((high as i32) >> unused) as i64 } else { (high >> unused) as i64 }
    }
}

/// Bytes of a frame: decoded, or where they lie in the file.
pub(super) enum Bytes {
    Decoded(Vec<u8>),
    Mapped { file: Arc<MappedFile>, range: Range<usize> },
}

impl Deref for Bytes {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        match self {
            Self::Decoded(bytes) => bytes,
            Self::Mapped { file, range } => &file[range.clone()],
        }
    }
}

/// The stored numbers of a decoded frame, one for each pixel.
pub(super) struct Samples {
    pub(super) bytes: Bytes,
    /// Bytes of one number.
    pub(super) width: usize,
    pub(super) endian: Endian,
}

/// Meaning of a frame's stored numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Meaning {
    pub(super) slope: f64,
    pub(super) intercept: f64,
    /// Least and greatest stored number of padding; `None` without padding. Padding becomes NaN in float voxels,
    /// otherwise the value of the least of these numbers.
    pub(super) padding: Option<[i64; 2]>,
    /// Least and greatest number of padding among floats, which becomes NaN.
    pub(super) float_padding: Option<[f64; 2]>,
}

impl Samples {
    /// Samples of `width` bytes in memory.
    pub(super) fn decoded(bytes: Vec<u8>, width: usize, endian: Endian) -> Self {
        Self { bytes: Bytes::Decoded(bytes), width, endian }
    }

    /// Checks that the numbers taken so far are the file's.
    pub(super) fn confirm(&self) -> Result<()> {
        if let Bytes::Mapped { file, .. } = &self.bytes { file.confirm() } else { Ok(()) }
    }

    /// Has the system fetch the frame ahead of its reading.
    pub(super) fn advise(&self) {
        if let Bytes::Mapped { file, range } = &self.bytes {
            file.advise(range.clone());
        }
    }

    /// Least and greatest number of the frame; all padding counts as its least.
    pub(super) fn range(&self, format: &PixelFormat, padding: Option<[i64; 2]>) -> [i64; 2] {
        let mut row = vec![0; format.columns as usize * VoxelType::I32.bytes()];
        let plain = Meaning { padding, ..Meaning::PLAIN };
        (0..format.rows).fold([i64::MAX, i64::MIN], |range, y| {
            let region = VoxelBox::new([0, y, 0], [format.columns, y + 1, 1]);
            self.deliver(format, &plain, VoxelType::I32, region, &mut row);
            let numbers = row.as_chunks::<4>().0.iter().map(|v| i64::from(i32::from_le_bytes(*v)));
            numbers.fold(range, |[a, b], n| [a.min(n), b.max(n)])
        })
    }

    /// Fills `out` with the voxels in the x, y rectangle of `region`.
    pub(super) fn deliver(
        &self,
        format: &PixelFormat,
        meaning: &Meaning,
        voxel_type: VoxelType,
        region: VoxelBox,
        out: &mut [u8],
    ) {
        let row_bytes = region.extent().x as usize * voxel_type.bytes();
        if format.is_float {
            return self.deliver_floats(format, meaning, region, out);
        }
        let number = |raw: u32| format.number(raw);
        for (y, row) in (region.min.y..).zip(out.chunks_exact_mut(row_bytes)) {
            let first = (y as usize * format.columns as usize + region.min.x as usize) * self.width;
            let numbers = &self.bytes[first..first + region.extent().x as usize * self.width];
            match (self.width, self.endian) {
                (1, _) => meaning.row(numbers, |[b]: [u8; 1]| number(b as u32), voxel_type, row),
                (2, Endian::Little) => meaning.row(numbers, |b| number(u16::from_le_bytes(b) as u32), voxel_type, row),
                (2, Endian::Big) => meaning.row(numbers, |b| number(u16::from_be_bytes(b) as u32), voxel_type, row),
                (_, Endian::Little) => meaning.row(numbers, |b| number(u32::from_le_bytes(b)), voxel_type, row),
                (_, Endian::Big) => meaning.row(numbers, |b| number(u32::from_be_bytes(b)), voxel_type, row),
            }
        }
    }
}

impl Samples {
    /// Fills `out` with floats; padding becomes NaN.
    fn deliver_floats(&self, format: &PixelFormat, meaning: &Meaning, region: VoxelBox, out: &mut [u8]) {
        let row = region.extent().x as usize;
        let is_padding =
            |value: f64| meaning.float_padding.is_some_and(|[least, greatest]| (least..=greatest).contains(&value));
        let held = |value: f64| if is_padding(value) { f32::NAN } else { value as f32 }.to_le_bytes();
        for (y, out) in (region.min.y..).zip(out.chunks_exact_mut(row * VoxelType::F32.bytes())) {
            let first = (y as usize * format.columns as usize + region.min.x as usize) * self.width;
            let numbers = &self.bytes[first..first + row * self.width];
            let (out, _) = out.as_chunks_mut::<4>();
            if self.width == 4 {
                for (out, bytes) in out.iter_mut().zip(numbers.as_chunks::<4>().0) {
                    let number = if self.endian == Endian::Big {
                        f32::from_be_bytes(*bytes)
                    } else {
                        f32::from_le_bytes(*bytes)
                    };
                    *out = held(number.into());
                }
            } else {
                for (out, bytes) in out.iter_mut().zip(numbers.as_chunks::<8>().0) {
                    let number = if self.endian == Endian::Big {
                        f64::from_be_bytes(*bytes)
                    } else {
                        f64::from_le_bytes(*bytes)
                    };
                    *out = held(number);
                }
            }
        }
    }
}

impl Meaning {
    /// Stored numbers are the values.
    pub(super) const PLAIN: Self = Self { slope: 1.0, intercept: 0.0, padding: None, float_padding: None };

    #[inline]
    pub(super) fn value(&self, n: i64) -> f64 {
        n as f64 * self.slope + self.intercept
    }

    /// Whether whole numbers remain whole.
    pub(super) fn is_whole(&self) -> bool {
        [self.slope, self.intercept].iter().all(|n| *n == n.trunc() && n.abs() < 1e9)
    }

    /// The padding value of integer voxels of this type; `None` without padding, and for floats, whose padding is NaN.
    pub(super) fn nodata(&self, voxel_type: VoxelType) -> Option<f64> {
        let [least, _] = self.padding.filter(|_| !voxel_type.is_float())?;
        Some(self.value(least)).filter(|&value| voxel_type.holds(value))
    }

    /// Converts a row of stored numbers of `N` bytes to voxels.
    #[inline]
    fn row<const N: usize>(&self, src: &[u8], stored: impl Fn([u8; N]) -> i64, voxel_type: VoxelType, out: &mut [u8]) {
        let (src, _) = src.as_chunks::<N>();
        let value = |n: i64| self.value(n);
        if let (VoxelType::F32, Some([least, greatest])) = (voxel_type, self.padding) {
            let (out, _) = out.as_chunks_mut::<4>();
            for (out, bytes) in out.iter_mut().zip(src) {
                let n = stored(*bytes);
                let voxel = if (least..=greatest).contains(&n) { f32::NAN } else { value(n) as f32 };
                *out = voxel.to_le_bytes();
            }
            return;
        }
        let [least, greatest] = self.padding.unwrap_or([i64::MAX, i64::MIN]);
        let padded = |bytes| {
            let n = stored(bytes);
            if (least..=greatest).contains(&n) { least } else { n }
        };
        with_voxel_type!(voxel_type, T => {
            let (out, _) = out.as_chunks_mut::<{ size_of::<T>() }>();
            if N < 4 && self.is_whole() && !voxel_type.is_float() {
                // The value modulo 2^32 is the value, in a type that fits it.
                let (slope, intercept) = (self.slope as i32, self.intercept as i32);
                let [least, greatest] = [least, greatest].map(|n| n.clamp(i32::MIN.into(), i32::MAX.into()) as i32);
                let pairs = out.iter_mut().zip(src);
                // Loops of their own, of which the first two are several times as fast as the last.
                match (self.padding, slope) {
                    (None, 1) => pairs.for_each(|(out, bytes)| {
                        *out = ((stored(*bytes) as i32).wrapping_add(intercept) as T).to_le_bytes();
                    }),
                    (None, _) => pairs.for_each(|(out, bytes)| {
                        let n = stored(*bytes) as i32;
                        *out = (n.wrapping_mul(slope).wrapping_add(intercept) as T).to_le_bytes();
                    }),
                    (Some(_), _) => pairs.for_each(|(out, bytes)| {
                        let n = stored(*bytes) as i32;
                        let n = if (least <= n) & (n <= greatest) { least } else { n };
                        *out = (n.wrapping_mul(slope).wrapping_add(intercept) as T).to_le_bytes();
                    }),
                }
                return;
            }
            for (out, bytes) in out.iter_mut().zip(src) {
                // Exact for integers: the chosen type fits all values.
                *out = (value(padded(*bytes)) as T).to_le_bytes();
            }
        });
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Voxels of whole values are the formula's, for any bits, padding and type.
        #[test]
        fn whole_values_are_exact(
            (bits, shift) in (1u32..=16).prop_flat_map(|bits| (Just(bits), 0..=16 - bits)),
            signed: bool,
            (slope, intercept) in (-3i32..=9, -40_000i32..=40_000),
            padding in prop::option::of((-300i64..300, 0i64..100)),
            raw in prop::collection::vec(any::<u16>(), 8),
        ) {
            let format = PixelFormat { columns: 8, rows: 1, width: 2, is_float: false, bits, shift, signed };
            let padding = padding.map(|(least, more)| [least, least + more]);
            let meaning = Meaning { slope: slope.into(), intercept: intercept.into(), padding, float_padding: None };
            let number = |raw: u16| {
                let n = i64::from(raw >> shift) & ((1 << bits) - 1);
                let n = if signed && n >> (bits - 1) == 1 { n - (1 << bits) } else { n };
                padding.filter(|[least, greatest]| (*least..=*greatest).contains(&n)).map_or(n, |[least, _]| least)
            };
            let expected: Vec<i64> = raw.iter().map(|&raw| number(raw) * i64::from(slope) + i64::from(intercept)).collect();
            let bytes: Vec<u8> = raw.iter().flat_map(|raw| raw.to_le_bytes()).collect();
            let samples = Samples::decoded(bytes, 2, Endian::Little);
            for voxel_type in VoxelType::ALL.into_iter().filter(|t| !t.is_float()) {
                if !expected.iter().all(|&value| voxel_type.holds(value as f64)) {
                    continue;
                }
                let mut out = vec![0; 8 * voxel_type.bytes()];
                samples.deliver(&format, &meaning, voxel_type, VoxelBox::new([0; 3], [8, 1, 1]), &mut out);
                with_voxel_type!(voxel_type, T => {
                    let voxels = out.as_chunks::<{ size_of::<T>() }>().0.iter().map(|v| T::from_le_bytes(*v) as i64);
                    prop_assert_eq!(voxels.collect::<Vec<_>>(), expected.clone());
                });
            }
        }
    }
}
