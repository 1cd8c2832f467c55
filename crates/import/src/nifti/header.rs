//! The two NIfTI headers, and ANALYZE's, as one struct, with every field checked.

use super::analyze::Analyze;
use super::fields::{Bytes, Fields};
use crate::axes::{Axis, AxisOrder, Sizes};
use crate::element::{Decode, Element, Endian, Scale};
use crate::error::{ImportError, Result};
use crate::looks::COMPLEX;
use crate::raw::ArrayLayout;
use brickyard_volume::{Extent, VoxelType};
use std::io::Read;
use std::path::Path;

/// Datatypes of colours.
const RGB: i16 = 128;
const RGBA: i16 = 2304;

/// Datatypes of complex numbers, of 32-bit and 64-bit floats.
const COMPLEX64: i16 = 32;
const COMPLEX128: i16 = 1792;

/// A checked NIfTI-1 or NIfTI-2 header.
pub(super) struct Header {
    pub(super) single_file: bool,
    /// The voxels in the body's file.
    pub(super) array: ArrayLayout,
    pub(super) fields: Fields,
    pub(super) analyze: Option<Analyze>,
}

impl Header {
    pub(super) fn read(stream: &mut impl Read, path: &Path) -> Result<Self> {
        let mut bytes = Vec::with_capacity(540);
        stream.take(540).read_to_end(&mut bytes).map_err(|error| {
            ImportError::invalid(path, format!("compressed data cut short or damaged inside the header: {error}"))
        })?;
        let size = bytes.first_chunk::<4>().copied().unwrap_or_default();
        let (endian, two) = match (i32::from_le_bytes(size), i32::from_be_bytes(size)) {
            (348, _) => (Endian::Little, false),
            (_, 348) => (Endian::Big, false),
            (540, _) => (Endian::Little, true),
            (_, 540) => (Endian::Big, true),
            _ => return Err(ImportError::invalid(path, "not a NIfTI file: it starts with neither 348 nor 540")),
        };
        let needed = if two { 540 } else { 348 };
        if bytes.len() < needed {
            let problem = format!("cut short: a NIfTI header has {needed} bytes, found {}", bytes.len());
            return Err(ImportError::invalid(path, problem));
        }
        let magic: &[u8] = if two { &bytes[4..8] } else { &bytes[344..348] };
        let (single_file, is_analyze) = match (magic, two) {
            (b"n+1\0", false) | (b"n+2\0", true) => (true, false),
            (b"ni1\0", false) | (b"ni2\0", true) => (false, false),
            ([b'n', b'+' | b'i', ..], false) => {
                return Err(ImportError::invalid(path, "a 348-byte header with a damaged NIfTI magic"));
            }
            (_, false) => (false, true),
            (_, true) => return Err(ImportError::invalid(path, "a 540-byte header without the NIfTI-2 magic")),
        };
        let bytes = Bytes { bytes: &bytes, endian, two };
        let mut fields = bytes.fields();
        let analyze = is_analyze.then(|| Analyze::of(&bytes, &mut fields));
        if is_analyze && fields.colors().is_some() {
            let feature = "colours in ANALYZE 7.5, whose parts some programs put in planes of their own,";
            return Err(ImportError::unsupported_but(path, feature, "convert it to NIfTI, as nibabel does"));
        }
        let checked = fields.checked(endian, single_file, needed as u64).map(|header| Self { analyze, ..header });
        checked.map_err(|refusal| match refusal {
            Refusal::Invalid(problem) => ImportError::invalid(path, problem),
            Refusal::Unsupported(feature) => {
                let advice = "write it again as plain numbers in up to five dimensions (nibabel, fslsplit)";
                ImportError::unsupported_but(path, feature, advice)
            }
        })
    }
}

enum Refusal {
    Invalid(String),
    Unsupported(String),
}

impl Fields {
    fn checked(self, endian: Endian, single_file: bool, header_bytes: u64) -> Result<Header, Refusal> {
        let (mut sizes, element) = (self.sizes()?, self.element()?);
        let offset = self.body_offset(single_file, header_bytes)?;
        // By the standard, colours are not scaled.
        let scale = if self.colors().is_some() { None } else { self.scale()? };
        if self.is_complex() && scale.is_some_and(|scale| scale.intercept != 0.0) {
            let intercept = self.intercept;
            // nibabel shifts the real part alone.
            return Err(Refusal::Unsupported(format!("complex numbers with a shift (scl_inter {intercept})")));
        }
        let decode = Decode { element, endian, scale };
        // The fifth dimension, read as channels, is the slowest; the parts of a colour or complex number lie side by side.
        let mut axes = AxisOrder::of(&[Axis::C, Axis::T, Axis::Z, Axis::Y, Axis::X]);
        if let Some(parts) = self.parts() {
            if sizes.channels > 1 {
                let what = if self.is_complex() { "complex numbers" } else { "colours" };
                return Err(Refusal::Unsupported(format!("{what} along a fifth dimension ({})", sizes.channels)));
            }
            sizes.channels = parts;
            axes = AxisOrder::of(&[Axis::T, Axis::Z, Axis::Y, Axis::X, Axis::C]);
        }
        Ok(Header { single_file, array: ArrayLayout { sizes, axes, decode, offset }, fields: self, analyze: None })
    }

    fn sizes(&self) -> Result<Sizes, Refusal> {
        let count = self.dim[0];
        if !(1..=7).contains(&count) {
            return Err(Refusal::Invalid(format!("claims {count} dimensions; NIfTI has 1 to 7")));
        }
        let mut sizes = [1u32; 7];
        for (size, &dim) in sizes.iter_mut().zip(&self.dim[1..=count as usize]) {
            *size = u32::try_from(dim).ok().filter(|&n| n > 0).ok_or_else(|| {
                Refusal::Invalid(format!("dimensions {:?}: every one must be 1 or more", &self.dim[1..=count as usize]))
            })?;
        }
        let [x, y, z, times, channels, rest @ ..] = sizes;
        if rest != [1, 1] {
            return Err(Refusal::Unsupported(format!("a sixth or seventh dimension ({rest:?})")));
        }
        Ok(Sizes { extent: Extent::new(x, y, z), channels, times })
    }

    /// Parts of each colour, if voxels are colours.
    pub(super) fn colors(&self) -> Option<u32> {
        match self.datatype {
            RGB => Some(3),
            RGBA => Some(4),
            _ => None,
        }
    }

    pub(super) fn is_complex(&self) -> bool {
        matches!(self.datatype, COMPLEX64 | COMPLEX128)
    }

    /// Numbers of a voxel, if it has several.
    fn parts(&self) -> Option<u32> {
        if self.is_complex() { Some(COMPLEX.len() as u32) } else { self.colors() }
    }

    fn element(&self) -> Result<Element, Refusal> {
        let element = match self.datatype {
            2 | RGB | RGBA => Element::Voxel(VoxelType::U8),
            4 => Element::Voxel(VoxelType::I16),
            8 => Element::Voxel(VoxelType::I32),
            16 | COMPLEX64 => Element::Voxel(VoxelType::F32),
            64 | COMPLEX128 => Element::F64,
            256 => Element::Voxel(VoxelType::I8),
            512 => Element::Voxel(VoxelType::U16),
            768 => Element::Voxel(VoxelType::U32),
            1024 => Element::I64,
            1280 => Element::U64,
            code => {
                let name = match code {
                    1 => "bits",
                    2048 => "complex numbers of 128-bit floats",
                    1536 => "128-bit floats",
                    _ => "unknown",
                };
                return Err(Refusal::Unsupported(format!("datatype {code} ({name})")));
            }
        };
        let parts = self.parts().unwrap_or(1) as usize;
        let (name, bits, bitpix) = (element.name(), element.bytes() * 8 * parts, self.bitpix);
        let name = if parts > 1 { format!("{parts} x {name}") } else { name.into() };
        if bitpix as usize != bits {
            return Err(Refusal::Invalid(format!("datatype {name} has {bits} bits, but bitpix says {bitpix}")));
        }
        Ok(element)
    }

    /// A slope of 0 means none, by the standard, and so does NaN, as written by nibabel.
    fn scale(&self) -> Result<Option<Scale>, Refusal> {
        let Self { slope, intercept, .. } = *self;
        if slope == 0.0 || slope.is_nan() || (slope, intercept) == (1.0, 0.0) {
            return Ok(None);
        }
        if !(slope.is_finite() && intercept.is_finite()) {
            return Err(Refusal::Invalid(format!(
                "its scl_slope is {slope} and its scl_inter {intercept}: expected finite numbers, or a slope of 0 for \
                 no scaling; write the header again"
            )));
        }
        Ok(Some(Scale::new(slope, intercept, VoxelType::F32)))
    }

    fn body_offset(&self, single_file: bool, header_bytes: u64) -> Result<u64, Refusal> {
        let least = if single_file { header_bytes + 4 } else { 0 };
        let offset = self.vox_offset;
        // Some writers leave 0: voxels then follow the header and its four extension bytes.
        if offset == 0.0 {
            return Ok(least);
        }
        let sound = offset.fract() == 0.0 && offset >= if single_file { header_bytes as f64 } else { 0.0 };
        if !sound || offset > i64::MAX as f64 / 2.0 {
            return Err(Refusal::Invalid(format!("declares voxels from byte {offset} on; expected {least} or more")));
        }
        Ok(offset as u64)
    }
}
