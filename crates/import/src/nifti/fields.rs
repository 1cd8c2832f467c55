//! The fields of NIfTI headers, where they lie in either version.

use crate::element::Endian;
use std::ops::Range;

/// Header fields as stored in the file, as far as a volume needs them.
pub(super) struct Fields {
    pub(super) dim: [i64; 8],
    pub(super) datatype: i16,
    pub(super) intent_code: i32,
    pub(super) bitpix: i16,
    /// First the handedness factor (the sign of the third axis), then the voxel sizes along x, y, z, and the distance from one time step to
    /// the next, or along whatever else the fourth axis is.
    pub(super) pixdim: [f64; 5],
    pub(super) time_start: f64,
    pub(super) vox_offset: f64,
    pub(super) slope: f64,
    pub(super) intercept: f64,
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

/// Numbers at byte positions of a header of checked length.
pub(super) struct Bytes<'a> {
    pub(super) bytes: &'a [u8],
    pub(super) endian: Endian,
    /// Whether it is of NIfTI-2.
    pub(super) two: bool,
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

    pub(super) fn at_text(&self, range: Range<usize>) -> &[u8] {
        &self.bytes[range]
    }

    pub(super) fn i16(&self, offset: usize) -> i16 {
        i16::from_le_bytes(self.at(offset))
    }

    pub(super) fn i32(&self, offset: usize) -> i32 {
        i32::from_le_bytes(self.at(offset))
    }

    fn i64(&self, offset: usize) -> i64 {
        i64::from_le_bytes(self.at(offset))
    }

    /// Reads an f32 exactly, for computing voxels.
    pub(super) fn exact_f32(&self, offset: usize) -> f64 {
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
    pub(super) fn fields(&self) -> Fields {
        let two = self.two;
        let code = |one, at| if two { self.i32(at) } else { self.i16(one).into() };
        let exact = |one, at| if two { self.f64(at) } else { self.exact_f32(one) };
        let number = |one, at, i| if two { self.f64(at + 8 * i) } else { self.f32(one + 4 * i) };
        Fields {
            dim: std::array::from_fn(|i| if two { self.i64(16 + 8 * i) } else { self.i16(40 + 2 * i).into() }),
            datatype: self.i16(if two { 12 } else { 70 }),
            intent_code: code(68, 504),
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
