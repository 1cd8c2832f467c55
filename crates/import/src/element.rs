//! Numbers as files store them, and how a line of them becomes little-endian voxels: copied, byte-swapped, narrowed
//! or scaled. Contiguous lines of the native order cost one `memcpy`.

use crate::error::ImportError;
use brickyard_volume::{VoxelType, with_voxel_type};
use std::path::Path;

/// Byte order of stored numbers.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Endian {
    /// Least significant byte first.
    #[default]
    Little,
    /// Most significant byte first.
    Big,
}

impl Endian {
    /// That of this machine's memory.
    pub(crate) fn native() -> Self {
        if cfg!(target_endian = "little") { Self::Little } else { Self::Big }
    }
}

impl std::str::FromStr for Endian {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        match s.to_ascii_lowercase().as_str() {
            "little" | "le" => Ok(Self::Little),
            "big" | "be" => Ok(Self::Big),
            _ => Err(format!("unknown byte order '{s}': expected little or big")),
        }
    }
}

impl std::fmt::Display for Endian {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Little => "little",
            Self::Big => "big",
        })
    }
}

/// The type of a number in a file: a voxel type, or one of the wider ones that must be narrowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Element {
    Voxel(VoxelType),
    I64,
    U64,
    F64,
}

impl Element {
    pub(crate) fn bytes(self) -> usize {
        match self {
            Self::Voxel(t) => t.bytes(),
            _ => 8,
        }
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Voxel(t) => t.name(),
            Self::I64 => "i64",
            Self::U64 => "u64",
            Self::F64 => "f64",
        }
    }

    /// The voxel type that stands for it.
    pub(crate) fn voxel_type(self) -> VoxelType {
        match self {
            Self::Voxel(t) => t,
            Self::I64 => VoxelType::I32,
            Self::U64 => VoxelType::U32,
            Self::F64 => VoxelType::F32,
        }
    }

    /// Lets a narrowing pass only where the user allowed it; the note says what is lost.
    pub(crate) fn check_narrowing(self, path: &Path, allow_lossy: bool) -> Result<Option<String>, ImportError> {
        if let Self::Voxel(_) = self {
            return Ok(None);
        }
        let (from, to) = (self.name(), self.voxel_type());
        if !allow_lossy {
            return Err(ImportError::options(
                path,
                format!("voxels are {from}, which a store cannot hold; pass --allow-lossy to narrow them to {to}"),
            ));
        }
        let loss = match self {
            Self::F64 => "rounded to the nearest",
            _ => "values beyond its limits are clamped",
        };
        Ok(Some(format!("Voxels are {from} and are narrowed to {to} ({loss}).")))
    }
}

/// `value * slope + intercept`, as some formats ask for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Scale {
    pub(crate) slope: f64,
    pub(crate) intercept: f64,
}

/// How a stored number becomes a voxel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Decode {
    pub(crate) element: Element,
    pub(crate) endian: Endian,
    /// Scaled values are delivered as f32.
    pub(crate) scale: Option<Scale>,
}

impl Decode {
    /// The type that comes out.
    pub(crate) fn voxel_type(&self) -> VoxelType {
        if self.scale.is_some() { VoxelType::F32 } else { self.element.voxel_type() }
    }

    /// Decodes `count` numbers that start every `src_stride` bytes to voxels that start every `dst_stride` bytes.
    pub(crate) fn line(&self, src: &[u8], src_stride: usize, dst: &mut [u8], dst_stride: usize, count: usize) {
        /// One stored type: its bytes in either order, then as it is (`$voxel`) or scaled.
        macro_rules! decode {
            ($t:ty, $number:ident => $voxel:expr) => {{
                let plain = |$number: $t| $voxel.to_le_bytes();
                let scaled = |s: Scale| move |n: $t| ((n as f64 * s.slope + s.intercept) as f32).to_le_bytes();
                let (little, big) = (<$t>::from_le_bytes, <$t>::from_be_bytes);
                match (self.endian, self.scale) {
                    (Endian::Little, None) => map_line(src, src_stride, dst, dst_stride, count, |b| plain(little(b))),
                    (Endian::Big, None) => map_line(src, src_stride, dst, dst_stride, count, |b| plain(big(b))),
                    (Endian::Little, Some(s)) => {
                        map_line(src, src_stride, dst, dst_stride, count, |b| scaled(s)(little(b)))
                    }
                    (Endian::Big, Some(s)) => map_line(src, src_stride, dst, dst_stride, count, |b| scaled(s)(big(b))),
                }
            }};
        }
        let contiguous = src_stride == self.element.bytes() && dst_stride == src_stride;
        match self.element {
            _ if contiguous && self.is_copy() => {
                dst[..count * dst_stride].copy_from_slice(&src[..count * src_stride]);
            }
            Element::Voxel(voxel_type) => with_voxel_type!(voxel_type, T => decode!(T, v => v)),
            Element::I64 => decode!(i64, v => v.clamp(i32::MIN as i64, i32::MAX as i64) as i32),
            Element::U64 => decode!(u64, v => v.min(u32::MAX as u64) as u32),
            Element::F64 => decode!(f64, v => (v as f32)),
        }
    }

    /// Whether a number's bytes are its voxel's.
    pub(crate) fn is_copy(&self) -> bool {
        let is_little = self.endian == Endian::Little || self.element.bytes() == 1;
        matches!(self.element, Element::Voxel(_)) && self.scale.is_none() && is_little
    }
}

/// Applies `f` to `count` numbers of `N` bytes, giving voxels of `M` bytes. The contiguous case is its own loop so
/// that it vectorises.
#[inline]
fn map_line<const N: usize, const M: usize>(
    src: &[u8],
    src_stride: usize,
    dst: &mut [u8],
    dst_stride: usize,
    count: usize,
    f: impl Fn([u8; N]) -> [u8; M],
) {
    if src_stride == N && dst_stride == M {
        let (src, _) = src[..count * N].as_chunks::<N>();
        let (dst, _) = dst[..count * M].as_chunks_mut::<M>();
        for (d, s) in dst.iter_mut().zip(src) {
            *d = f(*s);
        }
        return;
    }
    for i in 0..count {
        let mut number = [0; N];
        number.copy_from_slice(&src[i * src_stride..][..N]);
        dst[i * dst_stride..][..M].copy_from_slice(&f(number));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decode(element: Element, endian: Endian, scale: Option<Scale>, src: &[u8]) -> Vec<f64> {
        let d = Decode { element, endian, scale };
        let (count, out) = (src.len() / element.bytes(), d.voxel_type());
        let mut dst = vec![0; count * out.bytes()];
        d.line(src, element.bytes(), &mut dst, out.bytes(), count);
        (0..count).map(|i| out.read(&dst, i)).collect()
    }

    #[test]
    fn big_endian_is_swapped() {
        let values = [-2.5f32, 1e-30, f32::MAX];
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_be_bytes()).collect();
        assert_eq!(decode(Element::Voxel(VoxelType::F32), Endian::Big, None, &bytes), values.map(f64::from));
        assert_eq!(decode(Element::Voxel(VoxelType::I16), Endian::Big, None, &[0x80, 0, 0, 7]), [-32768.0, 7.0]);
    }

    #[test]
    fn wide_types_narrow_and_clamp() {
        let bytes: Vec<u8> = [i64::MIN, -5, 1 << 40].iter().flat_map(|v| v.to_be_bytes()).collect();
        assert_eq!(decode(Element::I64, Endian::Big, None, &bytes), [i32::MIN as f64, -5.0, i32::MAX as f64]);
        let bytes: Vec<u8> = [9u64, u64::MAX].iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(decode(Element::U64, Endian::Little, None, &bytes), [9.0, u32::MAX as f64]);
        assert_eq!(decode(Element::F64, Endian::Little, None, &0.1f64.to_le_bytes()), [0.1f32 as f64]);
        let path = Path::new("a");
        assert!(Element::F64.check_narrowing(path, false).unwrap_err().to_string().contains("--allow-lossy"));
        assert!(Element::F64.check_narrowing(path, true).unwrap().unwrap().contains("f32"));
    }

    #[test]
    fn scaled_values_become_floats() {
        let scale = Some(Scale { slope: 0.5, intercept: -1024.0 });
        assert_eq!(decode(Element::Voxel(VoxelType::U8), Endian::Little, scale, &[0, 255]), [-1024.0, -896.5]);
        assert_eq!(decode(Element::Voxel(VoxelType::I16), Endian::Big, scale, &[0xff, 0xfe]), [-1025.0]);
    }

    #[test]
    fn strided_lines_gather_and_scatter() {
        let d = Decode { element: Element::Voxel(VoxelType::U16), endian: Endian::Little, scale: None };
        let src: Vec<u8> = (0..12).collect();
        let mut dst = [99; 12];
        d.line(&src, 6, &mut dst, 4, 2);
        assert_eq!(dst, [0, 1, 99, 99, 6, 7, 99, 99, 99, 99, 99, 99]);
    }
}
