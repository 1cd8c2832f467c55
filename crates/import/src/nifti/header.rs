//! The two NIfTI headers as one struct, with every field checked.

use crate::axes::{Axis, AxisOrder, Sizes};
use crate::element::{Decode, Element, Endian, Scale};
use crate::error::{ImportError, Result};
use crate::raw::ArrayLayout;
use brickyard_volume::{Extent, VoxelType};
use std::io::Read;
use std::path::Path;

/// A checked NIfTI-1 or NIfTI-2 header.
pub(super) struct Header {
    pub(super) single_file: bool,
    /// The voxels in the body's file.
    pub(super) array: ArrayLayout,
    pub(super) fields: Fields,
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
        let single_file = match (magic, two) {
            (b"n+1\0", false) | (b"n+2\0", true) => true,
            (b"ni1\0", false) | (b"ni2\0", true) => false,
            (_, false) => {
                let advice = "convert it to NIfTI, as fslchfiletype or 3D Slicer do";
                return Err(ImportError::unsupported_but(path, "an ANALYZE 7.5 header (no NIfTI magic)", advice));
            }
            (_, true) => return Err(ImportError::invalid(path, "a 540-byte header without the NIfTI-2 magic")),
        };
        let fields = Bytes { bytes: &bytes, endian, two }.fields();
        fields.checked(endian, single_file, needed as u64).map_err(|refusal| match refusal {
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

/// Header fields as stored in the file, as far as a volume needs them.
pub(super) struct Fields {
    dim: [i64; 8],
    datatype: i16,
    bitpix: i16,
    /// First the handedness factor (the sign of the third axis), then the voxel sizes along x, y, z, and the distance from one time step to
    /// the next, or along whatever else the fourth axis is.
    pub(super) pixdim: [f64; 5],
    pub(super) time_start: f64,
    vox_offset: f64,
    slope: f64,
    intercept: f64,
    /// Unit of length (1 metre, 2 millimetre, 3 micrometre), plus that of the fourth axis (8 second, 16 millisecond, 24 microsecond; greater
    /// ones are no times).
    pub(super) xyzt_units: u8,
    pub(super) qform_code: i32,
    pub(super) sform_code: i32,
    /// Components b, c, d of the rotation quaternion of the qform.
    pub(super) quaternion: [f64; 3],
    pub(super) qoffset: [f64; 3],
    /// Rows of the affine matrix of the sform.
    pub(super) srow: [[f64; 4]; 3],
}

impl Fields {
    fn checked(self, endian: Endian, single_file: bool, header_bytes: u64) -> Result<Header, Refusal> {
        let (sizes, element) = (self.sizes()?, self.element()?);
        let offset = self.body_offset(single_file, header_bytes)?;
        let decode = Decode { element, endian, scale: self.scale()? };
        // The fifth dimension, read as channels, is the slowest.
        let axes = AxisOrder::of(&[Axis::C, Axis::T, Axis::Z, Axis::Y, Axis::X]);
        Ok(Header { single_file, array: ArrayLayout { sizes, axes, decode, offset }, fields: self })
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

    fn element(&self) -> Result<Element, Refusal> {
        let element = match self.datatype {
            2 => Element::Voxel(VoxelType::U8),
            4 => Element::Voxel(VoxelType::I16),
            8 => Element::Voxel(VoxelType::I32),
            16 => Element::Voxel(VoxelType::F32),
            64 => Element::F64,
            256 => Element::Voxel(VoxelType::I8),
            512 => Element::Voxel(VoxelType::U16),
            768 => Element::Voxel(VoxelType::U32),
            1024 => Element::I64,
            1280 => Element::U64,
            code => {
                let name = match code {
                    1 => "bits",
                    32 | 1792 | 2048 => "complex numbers",
                    128 => "RGB colours",
                    2304 => "RGBA colours",
                    1536 => "128-bit floats",
                    _ => "unknown",
                };
                return Err(Refusal::Unsupported(format!("datatype {code} ({name})")));
            }
        };
        let (name, bits, bitpix) = (element.name(), element.bytes() * 8, self.bitpix);
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
        Ok(Some(Scale { slope, intercept, to: VoxelType::F32 }))
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

/// Numbers at byte positions of a header of checked length.
struct Bytes<'a> {
    bytes: &'a [u8],
    endian: Endian,
    /// Whether it is of NIfTI-2.
    two: bool,
}

impl Bytes<'_> {
    fn at<const N: usize>(&self, offset: usize) -> [u8; N] {
        let mut bytes = [0; N];
        bytes.copy_from_slice(&self.bytes[offset..offset + N]);
        if self.endian == Endian::Big {
            bytes.reverse();
        }
        bytes
    }

    fn i16(&self, offset: usize) -> i16 {
        i16::from_le_bytes(self.at(offset))
    }

    fn i32(&self, offset: usize) -> i32 {
        i32::from_le_bytes(self.at(offset))
    }

    fn i64(&self, offset: usize) -> i64 {
        i64::from_le_bytes(self.at(offset))
    }

    /// Reads an f32 exactly, for computing voxels.
    fn exact_f32(&self, offset: usize) -> f64 {
        f32::from_le_bytes(self.at(offset)) as f64
    }

    /// Reads an f32 as the shortest decimal that identifies it: 0.1 mm stays 0.1 instead of 0.10000000149.
    fn f32(&self, offset: usize) -> f64 {
        let value = f32::from_le_bytes(self.at(offset));
        value.to_string().parse().unwrap_or(value as f64)
    }

    fn f64(&self, offset: usize) -> f64 {
        f64::from_le_bytes(self.at(offset))
    }

    /// Reads every field, given with its bytes in NIfTI-1 and in NIfTI-2.
    fn fields(&self) -> Fields {
        let two = self.two;
        let code = |one, at| if two { self.i32(at) } else { self.i16(one).into() };
        let exact = |one, at| if two { self.f64(at) } else { self.exact_f32(one) };
        let number = |one, at, i| if two { self.f64(at + 8 * i) } else { self.f32(one + 4 * i) };
        Fields {
            dim: std::array::from_fn(|i| if two { self.i64(16 + 8 * i) } else { self.i16(40 + 2 * i).into() }),
            datatype: self.i16(if two { 12 } else { 70 }),
            bitpix: self.i16(if two { 14 } else { 72 }),
            pixdim: std::array::from_fn(|i| number(76, 104, i)),
            time_start: number(136, 216, 0),
            vox_offset: if two { self.i64(168) as f64 } else { self.f32(108) },
            slope: exact(112, 176),
            intercept: exact(116, 184),
            xyzt_units: if two { (self.i32(500) & 0xff) as u8 } else { self.bytes[123] },
            qform_code: code(252, 344),
            sform_code: code(254, 348),
            quaternion: std::array::from_fn(|i| number(256, 352, i)),
            qoffset: std::array::from_fn(|i| number(268, 376, i)),
            srow: std::array::from_fn(|row| std::array::from_fn(|i| number(280, 400, 4 * row + i))),
        }
    }
}
