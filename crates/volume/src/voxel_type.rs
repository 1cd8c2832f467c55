//! The seven voxel types of stores, and the generic view of their little-endian bytes.

use serde::{Deserialize, Serialize};

/// The type of one voxel, little-endian in files and memory.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum VoxelType {
    /// 8-bit unsigned.
    U8,
    /// 8-bit signed.
    I8,
    /// 16-bit unsigned.
    U16,
    /// 16-bit signed.
    I16,
    /// 32-bit unsigned.
    U32,
    /// 32-bit signed.
    I32,
    /// 32-bit IEEE float.
    F32,
}

impl VoxelType {
    /// All types, narrow to wide.
    pub const ALL: [VoxelType; 7] = [Self::U8, Self::I8, Self::U16, Self::I16, Self::U32, Self::I32, Self::F32];

    /// Bytes of one voxel.
    pub const fn bytes(self) -> usize {
        with_voxel_type!(self, T => size_of::<T>())
    }

    /// This project's name and Zarr's.
    const fn names(self) -> (&'static str, &'static str) {
        match self {
            Self::U8 => ("u8", "uint8"),
            Self::I8 => ("i8", "int8"),
            Self::U16 => ("u16", "uint16"),
            Self::I16 => ("i16", "int16"),
            Self::U32 => ("u32", "uint32"),
            Self::I32 => ("i32", "int32"),
            Self::F32 => ("f32", "float32"),
        }
    }

    /// The name on the command line and in `--json`: `u8`, `i16`, `f32`, ...
    pub const fn name(self) -> &'static str {
        self.names().0
    }

    /// The Zarr v3 `data_type` name.
    pub const fn zarr_name(self) -> &'static str {
        self.names().1
    }

    /// The type of this Zarr v3 name, if it is one of the seven.
    pub fn from_zarr_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|t| t.zarr_name() == name)
    }

    /// Whether values are floating point (and so may be NaN or infinite).
    pub const fn is_float(self) -> bool {
        matches!(self, Self::F32)
    }

    /// Least and greatest representable finite value.
    pub fn limits(self) -> (f64, f64) {
        with_voxel_type!(self, T => (T::MIN as f64, T::MAX as f64))
    }

    /// Whether a voxel of the type can hold the value: a whole number within the limits of an integer type; any finite
    /// number within those of a float, to be rounded to the nearest.
    pub fn holds(self, value: f64) -> bool {
        let (low, high) = self.limits();
        (low..=high).contains(&value) && (self.is_float() || value.fract() == 0.0)
    }

    /// Decodes the voxel at `index` of little-endian `bytes`.
    ///
    /// # Panics
    /// If `bytes` is too short.
    pub fn read(self, bytes: &[u8], index: usize) -> f64 {
        fn at<T: Voxel>(bytes: &[u8], index: usize) -> f64 {
            let start = index * size_of::<T>();
            bytemuck::pod_read_unaligned::<T>(&bytes[start..start + size_of::<T>()]).to_f64()
        }
        with_voxel_type!(self, T => at::<T>(bytes, index))
    }
}

impl std::str::FromStr for VoxelType {
    type Err = String;

    /// Accepts this project's names (`u16`), NumPy's and Zarr's (`uint16`, `float32`) and `float`.
    fn from_str(s: &str) -> Result<Self, String> {
        let s = s.to_ascii_lowercase();
        Self::ALL
            .into_iter()
            .find(|t| t.name() == s || t.zarr_name() == s)
            .or((s == "float").then_some(Self::F32))
            .ok_or_else(|| format!("unknown dtype '{s}': expected one of u8, i8, u16, i16, u32, i32, f32"))
    }
}

impl std::fmt::Display for VoxelType {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

/// A Rust type of one of the [`VoxelType`]s.
pub trait Voxel: bytemuck::Pod + PartialOrd + Send + Sync + 'static {
    /// The [`VoxelType`] of this Rust type.
    const TYPE: VoxelType;
    /// Converts the voxel's value exactly.
    fn to_f64(self) -> f64;
    /// The nearest representable value (ties to even), saturating at the type's limits; a float NaN stays NaN, an
    /// integer one becomes 0.
    fn from_f64_rounded(value: f64) -> Self;
    /// Whether the value counts in statistics and is drawn: everything but NaN and the infinities.
    fn is_valid(self) -> bool;
}

macro_rules! integer_voxel {
    ($($t:ty => $tag:ident),*) => {$(
        impl Voxel for $t {
            const TYPE: VoxelType = VoxelType::$tag;
            #[inline]
            fn to_f64(self) -> f64 { self as f64 }
            #[inline]
            fn from_f64_rounded(value: f64) -> Self { value.round_ties_even() as $t }
            #[inline]
            fn is_valid(self) -> bool { true }
        }
    )*};
}
integer_voxel!(u8 => U8, i8 => I8, u16 => U16, i16 => I16, u32 => U32, i32 => I32);

impl Voxel for f32 {
    const TYPE: VoxelType = VoxelType::F32;
    #[inline]
    fn to_f64(self) -> f64 {
        self as f64
    }
    #[inline]
    fn from_f64_rounded(value: f64) -> Self {
        value as f32
    }
    #[inline]
    fn is_valid(self) -> bool {
        self.is_finite()
    }
}

/// Runs an expression with `$T` bound to the Rust type of a [`VoxelType`] value: the only conversion of run-time types
/// to compile-time ones.
#[macro_export]
macro_rules! with_voxel_type {
    ($tag:expr, $T:ident => $body:expr) => {
        $crate::with_voxel_type!($tag, $T => $body, U8 u8, I8 i8, U16 u16, I16 i16, U32 u32, I32 i32, F32 f32)
    };
    ($tag:expr, $T:ident => $body:expr, $($variant:ident $rust:ty),*) => {
        match $tag {
            $($crate::VoxelType::$variant => {
                type $T = $rust;
                $body
            })*
        }
    };
}
use with_voxel_type;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_round_trip() {
        for t in VoxelType::ALL {
            assert_eq!(t.name().parse::<VoxelType>(), Ok(t));
            assert_eq!(VoxelType::from_zarr_name(t.zarr_name()), Some(t));
        }
        assert!("u64".parse::<VoxelType>().unwrap_err().contains("u64"));
    }

    #[test]
    fn reads_every_type_at_its_limits() {
        assert_eq!(VoxelType::I16.read(&[1, 0, 0, 0x80], 1), -32768.0);
        assert_eq!(VoxelType::U32.read(&u32::MAX.to_le_bytes(), 0), u32::MAX as f64);
        assert!(VoxelType::F32.read(&f32::NAN.to_le_bytes(), 0).is_nan());
    }

    #[test]
    fn a_type_holds_what_its_voxels_can_be() {
        let held = |t: VoxelType, values: [f64; 4]| values.map(|v| t.holds(v));
        assert_eq!(held(VoxelType::U8, [0.0, 255.0, 256.0, -1.0]), [true, true, false, false]);
        assert_eq!(held(VoxelType::I32, [-2147483648.0, 0.5, 2147483648.0, f64::NAN]), [true, false, false, false]);
        assert_eq!(held(VoxelType::F32, [0.1, -1e38, 1e39, f64::INFINITY]), [true, true, false, false]);
    }

    #[test]
    fn rounds_ties_to_even_and_saturates() {
        assert_eq!([0.5, 1.5, 2.5, 254.5, 300.0, -3.0].map(u8::from_f64_rounded), [0, 2, 2, 254, 255, 0]);
        assert_eq!([-0.5, -1.5, -129.0].map(i8::from_f64_rounded), [0, -2, -128]);
    }
}
