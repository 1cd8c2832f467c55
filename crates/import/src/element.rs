//! Stored numbers, and their conversion line by line to little-endian voxels: copied, byte-swapped, widened, narrowed
//! or scaled. Contiguous lines of the native order cost one `memcpy`.

use brickyard_volume::{VoxelType, with_voxel_type};
use half::f16;

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

/// Type of a number in a file: a voxel type, a type widened to one, or a wider type to be narrowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Element {
    /// A voxel type.
    Voxel(VoxelType),
    /// 16-bit float, widened to f32 without loss.
    F16,
    /// 64-bit integer, narrowed to i32.
    I64,
    /// 64-bit integer without a sign, narrowed to u32.
    U64,
    /// 64-bit float, narrowed to f32.
    F64,
}

impl From<VoxelType> for Element {
    fn from(voxel_type: VoxelType) -> Self {
        Self::Voxel(voxel_type)
    }
}

impl std::str::FromStr for Element {
    type Err = String;

    /// Accepts the names of voxel types, and of the others those of this project (`i64`), NumPy and Zarr (`int64`, `float16`).
    fn from_str(s: &str) -> Result<Self, String> {
        match s.to_ascii_lowercase().as_str() {
            "f16" | "float16" => Ok(Self::F16),
            "i64" | "int64" => Ok(Self::I64),
            "u64" | "uint64" => Ok(Self::U64),
            "f64" | "float64" | "double" => Ok(Self::F64),
            _ => s.parse().map(Self::Voxel).map_err(|problem: String| format!("{problem}, f16, i64, u64, f64")),
        }
    }
}

impl std::fmt::Display for Element {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl Element {
    /// All types, narrower ones first.
    pub(crate) fn all() -> impl Iterator<Item = Self> {
        VoxelType::ALL.into_iter().map(Self::Voxel).chain([Self::F16, Self::I64, Self::U64, Self::F64])
    }

    pub(crate) fn bytes(self) -> usize {
        match self {
            Self::Voxel(t) => t.bytes(),
            Self::F16 => 2,
            _ => 8,
        }
    }

    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Voxel(t) => t.name(),
            Self::F16 => "f16",
            Self::I64 => "i64",
            Self::U64 => "u64",
            Self::F64 => "f64",
        }
    }

    /// Voxel type of unscaled numbers of this type.
    pub(crate) fn voxel_type(self) -> VoxelType {
        match self {
            Self::Voxel(t) => t,
            Self::I64 => VoxelType::I32,
            Self::U64 => VoxelType::U32,
            Self::F16 | Self::F64 => VoxelType::F32,
        }
    }

    /// Stored numbers as f64; 64-bit integers are rounded.
    pub(crate) fn numbers(self, endian: Endian, bytes: &[u8]) -> Vec<f64> {
        let ordered = bytes.chunks_exact(self.bytes()).map(|number| {
            let mut little = [0; 8];
            little[..number.len()].copy_from_slice(number);
            if endian == Endian::Big {
                little[..number.len()].reverse();
            }
            little
        });
        let value = |little: [u8; 8]| match self {
            Self::Voxel(voxel_type) => voxel_type.read(&little, 0),
            Self::F16 => f16::from_le_bytes([little[0], little[1]]).to_f64(),
            Self::I64 => i64::from_le_bytes(little) as f64,
            Self::U64 => u64::from_le_bytes(little) as f64,
            Self::F64 => f64::from_le_bytes(little),
        };
        ordered.map(value).collect()
    }

    /// Least and greatest number of this type; for floats the finite ones.
    pub(crate) fn limits(self) -> [f64; 2] {
        match self {
            Self::Voxel(t) => with_voxel_type!(t, T => [T::MIN as f64, T::MAX as f64]),
            Self::F16 => [f16::MIN.to_f64(), f16::MAX.to_f64()],
            Self::I64 => [i64::MIN as f64, i64::MAX as f64],
            Self::U64 => [0.0, u64::MAX as f64],
            Self::F64 => [f64::MIN, f64::MAX],
        }
    }
}

/// A linear map of stored numbers to values, `stored * slope + intercept`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Scale {
    pub(crate) slope: f64,
    pub(crate) intercept: f64,
    /// Voxel type of the values: f32, or an integer type holding them all; of 64-bit numbers also another one, to which they are rounded and
    /// clamped.
    pub(crate) to: VoxelType,
    /// Value for no data of 64-bit numbers in an integer type, which NaN and infinities become.
    pub(crate) nodata: Option<f64>,
    /// Stored number that becomes NaN in f32, and the value for no data in an integer type.
    pub(crate) absent: Option<f64>,
}

impl Scale {
    /// Creates a scale of all stored numbers.
    pub(crate) fn new(slope: f64, intercept: f64, to: VoxelType) -> Self {
        Self { slope, intercept, to, nodata: None, absent: None }
    }

    /// The value of a stored number.
    pub(crate) fn value(&self, stored: f64) -> f64 {
        if Some(stored) == self.absent { f64::NAN } else { stored * self.slope + self.intercept }
    }

    /// Creates the scale for numbers of a type; `None` if it would change nothing. Integers stay integers if slope and
    /// intercept are integers and a type holds every value.
    pub(crate) fn exact(element: Element, slope: f64, intercept: f64) -> Option<Self> {
        let [a, b] = element.limits().map(|n| n * slope + intercept);
        let is_integer = |n: f64| n == n.trunc() && n.abs() < 1e9;
        let are_floats = matches!(element, Element::Voxel(VoxelType::F32) | Element::F16 | Element::F64);
        let to = if !are_floats && is_integer(slope) && is_integer(intercept) {
            smallest_type(a.min(b), a.max(b))
        } else {
            VoxelType::F32
        };
        ((slope, intercept) != (1.0, 0.0)).then_some(Self::new(slope, intercept, to))
    }

    /// Whether voxels without data become NaN.
    pub(crate) fn makes_nan(&self) -> bool {
        self.absent.is_some() && self.to.is_float()
    }

    /// Whether values are the stored numbers.
    fn is_identity(&self) -> bool {
        (self.slope, self.intercept) == (1.0, 0.0)
    }

    /// The value of a 64-bit number as the voxel type holds it, but for its limits.
    fn rounded(&self, value: f64) -> f64 {
        match () {
            () if self.to.is_float() => value,
            () if value.is_finite() => value.round_ties_even(),
            () => self.nodata.unwrap_or_default(),
        }
    }
}

/// The smallest integer type holding both numbers; f32 if there is none.
pub(crate) fn smallest_type(least: f64, greatest: f64) -> VoxelType {
    use VoxelType::*;
    let holds = |t: &VoxelType| {
        let [lo, hi] = Element::Voxel(*t).limits();
        lo <= least && greatest <= hi
    };
    [U8, I8, U16, I16, U32, I32].into_iter().find(holds).unwrap_or(F32)
}

/// The smallest type that holds all values of some: of integers an integer, and f32 beside floats. `None` if there is none.
pub(crate) fn common_type(types: impl IntoIterator<Item = VoxelType>) -> Option<VoxelType> {
    let (mut least, mut greatest, mut has_floats) = (0.0f64, 0.0f64, false);
    for own in types {
        let [low, high] = Element::Voxel(own).limits();
        (least, greatest) = (least.min(low), greatest.max(high));
        has_floats |= own.is_float();
    }
    Some(smallest_type(least, greatest)).filter(|to| has_floats || !to.is_float())
}

/// Conversion of a stored number to a voxel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Decode {
    pub(crate) element: Element,
    pub(crate) endian: Endian,
    pub(crate) scale: Option<Scale>,
}

impl Decode {
    pub(crate) fn voxel_type(&self) -> VoxelType {
        self.scale.map_or(self.element.voxel_type(), |scale| scale.to)
    }

    /// Decodes `count` numbers that start every `src_stride` bytes to voxels that start every `dst_stride` bytes.
    pub(crate) fn line(&self, src: &[u8], src_stride: usize, dst: &mut [u8], dst_stride: usize, count: usize) {
        /// One stored type: its bytes in either order, then unchanged (`$voxel`) or scaled (from its `$wide`, to `$held`).
        macro_rules! decode {
            ($t:ty, $number:ident => $voxel:expr, $wide:expr) => {
                decode!($t, self.scale, $number => $voxel, $wide, |_: Scale, value: f64| value)
            };
            ($t:ty, $scale:expr, $number:ident => $voxel:expr, $wide:expr, $held:expr) => {{
                let (little, big) = (<$t>::from_le_bytes, <$t>::from_be_bytes);
                let plain = |$number: $t| $voxel.to_le_bytes();
                let wide = |$number: $t| -> f64 { $wide };
                match (self.endian, $scale) {
                    (Endian::Little, None) => map_line(src, src_stride, dst, dst_stride, count, |b| plain(little(b))),
                    (Endian::Big, None) => map_line(src, src_stride, dst, dst_stride, count, |b| plain(big(b))),
                    (endian, Some(s)) => with_voxel_type!(s.to, Out => {
                        let scaled = |n: $t| ($held(s, s.value(wide(n))) as Out).to_le_bytes();
                        match endian {
                            Endian::Little => {
                                map_line(src, src_stride, dst, dst_stride, count, |b| scaled(little(b)))
                            }
                            Endian::Big => map_line(src, src_stride, dst, dst_stride, count, |b| scaled(big(b))),
                        }
                    }),
                }
            }};
        }
        let contiguous = src_stride == self.element.bytes() && dst_stride == src_stride;
        let held = |scale: Scale, value: f64| scale.rounded(value);
        match self.element {
            _ if contiguous && self.is_copy() => {
                dst[..count * dst_stride].copy_from_slice(&src[..count * src_stride]);
            }
            Element::Voxel(voxel_type) => with_voxel_type!(voxel_type, T => decode!(T, v => v, v as f64)),
            Element::F16 => decode!(f16, v => v.to_f32(), v.to_f64()),
            // Rounded once, not as f64 before.
            Element::I64 if self.is_integer_as_float() => decode!(i64, None::<Scale>, v => v as f32, v as f64, held),
            Element::U64 if self.is_integer_as_float() => decode!(u64, None::<Scale>, v => v as f32, v as f64, held),
            Element::I64 => {
                decode!(i64, self.scale, v => v.clamp(i32::MIN as i64, i32::MAX as i64) as i32, v as f64, held)
            }
            Element::U64 => decode!(u64, self.scale, v => v.min(u32::MAX as u64) as u32, v as f64, held),
            Element::F64 => decode!(f64, self.scale, v => (v as f32), v, held),
        }
    }

    fn is_integer_as_float(&self) -> bool {
        self.scale.is_some_and(|scale| scale.to.is_float() && scale.is_identity())
    }

    /// Whether decoding is a plain copy.
    pub(crate) fn is_copy(&self) -> bool {
        let is_little = self.endian == Endian::Little || self.element.bytes() == 1;
        matches!(self.element, Element::Voxel(_)) && self.scale.is_none() && is_little
    }
}

/// Applies `f` to `count` numbers of `N` bytes, giving voxels of `M` bytes. The contiguous case has its own loop,
/// which vectorises.
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
    fn names_of_types_are_read_back() {
        for element in Element::all() {
            assert_eq!(element.to_string().parse(), Ok(element));
        }
        assert_eq!(
            ["float64", "Double", "INT64"].map(str::parse),
            [Ok(Element::F64), Ok(Element::F64), Ok(Element::I64)]
        );
        assert_eq!("float".parse(), Ok(Element::Voxel(VoxelType::F32)));
        assert!("f128".parse::<Element>().unwrap_err().contains("f32, f16, i64"));
    }

    #[test]
    fn numbers_of_either_order_are_read() {
        assert_eq!(Element::I64.numbers(Endian::Big, &(-5i64).to_be_bytes()), [-5.0]);
        assert_eq!(Element::F16.numbers(Endian::Little, &[0, 0x3c, 0, 0xc0]), [1.0, -2.0]);
        assert_eq!(Element::Voxel(VoxelType::U16).numbers(Endian::Big, &[1, 2, 9]), [258.0]);
    }

    #[test]
    fn wide_types_narrow_and_clamp() {
        let bytes: Vec<u8> = [i64::MIN, -5, 1 << 40].iter().flat_map(|v| v.to_be_bytes()).collect();
        assert_eq!(decode(Element::I64, Endian::Big, None, &bytes), [i32::MIN as f64, -5.0, i32::MAX as f64]);
        let bytes: Vec<u8> = [9u64, u64::MAX].iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(decode(Element::U64, Endian::Little, None, &bytes), [9.0, u32::MAX as f64]);
        assert_eq!(decode(Element::F64, Endian::Little, None, &0.1f64.to_le_bytes()), [0.1f32 as f64]);
    }

    #[test]
    fn wide_numbers_go_straight_to_a_told_type() {
        let to = |to, nodata| Some(Scale { nodata, ..Scale::new(1.0, 0.0, to) });
        let bytes: Vec<u8> = [3_000_000_000i64, -7, i64::MAX].iter().flat_map(|v| v.to_be_bytes()).collect();
        let found = |voxel_type| decode(Element::I64, Endian::Big, to(voxel_type, None), &bytes);
        assert_eq!(found(VoxelType::U32), [3e9, 0.0, 4294967295.0]);
        assert_eq!(found(VoxelType::I8), [127.0, -7.0, 127.0]);
        // Just above half a step of f32: as f64 it lies on the half, and would go to the even number below.
        let above = (1u64 << 60) + (1 << 36) + 1;
        let found = decode(Element::U64, Endian::Little, to(VoxelType::F32, None), &above.to_le_bytes());
        assert_eq!(found, [((1u64 << 60) + (1 << 37)) as f64]);
        let values = [2.5, 3.5, 2.5 + 1e-9, -1e300, f64::NAN, f64::NEG_INFINITY];
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let found = decode(Element::F64, Endian::Little, to(VoxelType::U16, Some(9.0)), &bytes);
        assert_eq!(found, [2.0, 4.0, 3.0, 0.0, 9.0, 9.0]);
    }

    #[test]
    fn halves_are_widened_exactly() {
        for bits in 0..=u16::MAX {
            let half = f16::from_bits(bits);
            for (endian, bytes) in [(Endian::Little, bits.to_le_bytes()), (Endian::Big, bits.to_be_bytes())] {
                let [found] = decode(Element::F16, endian, None, &bytes)[..] else { unreachable!() };
                assert!(found == half.to_f64() || found.is_nan() && half.is_nan(), "{bits:x}: {found}");
            }
        }
    }

    #[test]
    fn integers_scaled_by_integers_stay_integers_where_a_type_holds_them() {
        use VoxelType::*;
        let to = |t, slope, intercept| Scale::exact(Element::Voxel(t), slope, intercept).map(|s| s.to);
        assert_eq!(to(U16, 1.0, -32768.0), Some(I16));
        assert_eq!(to(I16, 1.0, 32768.0), Some(U16));
        assert_eq!(to(U8, -1.0, 0.0), Some(I16));
        assert_eq!(to(U16, 1.0, -32769.0), Some(I32));
        assert_eq!(to(U32, 1.0, -1.0), Some(F32));
        assert_eq!(to(U8, 0.5, 0.0), Some(F32));
        assert_eq!(to(F32, 2.0, 0.0), Some(F32));
        assert_eq!(to(U8, 1.0, 0.0), None);
        let scale = Scale::exact(Element::Voxel(U16), 1.0, -32768.0);
        let bytes: Vec<u8> = [0u16, 31768, 65535].iter().flat_map(|n| n.to_be_bytes()).collect();
        assert_eq!(decode(Element::Voxel(U16), Endian::Big, scale, &bytes), [-32768.0, -1000.0, 32767.0]);
    }

    #[test]
    fn scaled_values_become_floats() {
        let scale = Some(Scale::new(0.5, -1024.0, VoxelType::F32));
        assert_eq!(decode(Element::Voxel(VoxelType::U8), Endian::Little, scale, &[0, 255]), [-1024.0, -896.5]);
        assert_eq!(decode(Element::Voxel(VoxelType::I16), Endian::Big, scale, &[0xff, 0xfe]), [-1025.0]);
        // A number next to that for no data is a value, also where f32 cannot tell the two apart.
        let absent = Scale { absent: Some(2147483647.0), ..Scale::new(1e-4, 0.0, VoxelType::F32) };
        let bytes: Vec<u8> = [i32::MAX, i32::MAX - 1].iter().flat_map(|n| n.to_le_bytes()).collect();
        let found = decode(Element::Voxel(VoxelType::I32), Endian::Little, Some(absent), &bytes);
        assert!(found[0].is_nan() && found[1] == f64::from(214_748.36_f32), "{found:?}");
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
