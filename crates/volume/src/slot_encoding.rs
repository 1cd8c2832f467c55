//! Slot codes: the map from voxel values to slots' 8- or 16-bit codes, in RAM and on the GPU, or to 32-bit floats.
//!
//! 8- and 16-bit types keep every value (signed ones are biased). 32-bit integers and floats are quantised to 16 bits over the channel's value
//! range, with an error of at most range / 131,068; or, where this is too coarse for the look, held as 32-bit floats
//! ([`float_slots`](crate::float_slots)). In stores with NaN or infinities, code 0 is reserved for them and means *invalid*: not drawn, and
//! left out of interpolation.
//!
//! Where an integer value marks missing measurements, code 0 stands for it. The other values of 8- and 16-bit types are kept exactly, from
//! code 1 for the channel's least value on: in 16 bits where 8 have no code to spare. Only a 16-bit channel using both ends of its type is
//! quantised.

use crate::voxel_type::{Voxel, VoxelType};
use crate::with_voxel_type;

/// The format of a voxel in a slot.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum SlotFormat {
    /// One byte a voxel.
    U8,
    /// Two bytes a voxel, little-endian.
    U16,
    /// A 32-bit float a voxel, little-endian: not a code, but mapped to one as it is read.
    F32,
}

impl SlotFormat {
    /// Bytes of one code.
    pub const fn bytes(self) -> usize {
        match self {
            Self::U8 => 1,
            Self::U16 => 2,
            Self::F32 => 4,
        }
    }

    /// The greatest code: the transfer table's last entry. Samples of f32 slots have codes of any size; past the ends of the table they are as
    /// good as those at the ends.
    pub const fn max_code(self) -> u32 {
        match self {
            Self::U8 => 255,
            Self::U16 | Self::F32 => 65535,
        }
    }
}

/// The range of unknown codes: codes may be past its ends, too.
pub const ANYTHING: [u16; 2] = [0, u16::MAX];

/// Number of an f32 slot without a value.
pub const INVALID_SLOT: f32 = -3e38;

/// Threshold between [`INVALID_SLOT`] and the greater numbers of f32 slots with a value.
pub const LEAST_SLOT: f32 = -2e38;

/// The greatest magnitude of an f32 slot with a value, so that no difference overflows.
pub(crate) const MOST: f64 = 1e38;

/// Parameters of f32 slots, besides the values themselves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FloatSlots {
    /// The value held as 0.
    pub base: f64,
    /// Difference of values stored as [`SCALE`](crate::gradients::SCALE) in gradients.
    pub unit: f64,
    /// The least and the greatest value, to which others are clamped.
    pub limits: [f64; 2],
}

/// The map between values and codes: `value = low + code / max_code * (high - low)`. Slots hold the codes or, in f32 slots, numbers
/// independent of `low` and `high`. The transfer table covers all codes or, for a narrow window, a few ([`float_slots`](crate::float_slots)).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SlotEncoding {
    /// The codes' voxel type.
    pub voxel_type: VoxelType,
    /// Width of the codes.
    pub format: SlotFormat,
    /// Value of code 0.
    pub low: f64,
    /// Value of the greatest code.
    pub high: f64,
    /// Whether there are voxels without a value: code 0 means *invalid* instead of `low`, and so does [`INVALID_SLOT`] in f32 slots.
    pub has_invalid: bool,
    /// Parameters of f32 slots; `None` where slots hold codes.
    pub floats: Option<FloatSlots>,
    /// The integer value of voxels without data, with code 0; `None` if there is none.
    pub nodata: Option<f64>,
    /// Whether values are labels: a place has its voxel's label, and labels are not interpolated.
    pub is_labels: bool,
    /// Whether codes are [`LabelCodes`](crate::LabelCodes) of the layer's look, for labels further apart than 16 bits reach.
    /// [`value`](Self::value) does not decode them.
    pub is_hashed: bool,
    /// The codes of the transfer table's first and last entry.
    pub table_codes: [u16; 2],
    /// Codes from the channel's least value to its greatest.
    pub spread_codes: f64,
    /// Data units per code of sufficient slots, where finer f32 slots are kept instead; else 0.
    pub enough_width: f64,
}

/// An encoding of measurements without missing data, as a base for others.
const PLAIN: SlotEncoding = SlotEncoding {
    voxel_type: VoxelType::U8,
    format: SlotFormat::U8,
    low: 0.0,
    high: 255.0,
    has_invalid: false,
    floats: None,
    nodata: None,
    is_labels: false,
    is_hashed: false,
    table_codes: [0, 255],
    spread_codes: 255.0,
    enough_width: 0.0,
};

impl SlotEncoding {
    /// Returns the encoding for a store of `voxel_type` with valid values in `range`, and others not finite if `has_non_finite`.
    pub fn new(voxel_type: VoxelType, range: (f64, f64), has_non_finite: bool) -> Self {
        let format = if voxel_type.bytes() == 1 { SlotFormat::U8 } else { SlotFormat::U16 };
        if voxel_type.bytes() <= 2 {
            let (low, high) = voxel_type.limits();
            let spread_codes = (range.1 - range.0).clamp(0.0, high - low);
            return Self { voxel_type, format, low, high, spread_codes, ..PLAIN }.with_whole_table();
        }
        Self::quantised(voxel_type, range, has_non_finite)
    }

    /// Returns the encoding by 16-bit codes spread over a range.
    fn quantised(voxel_type: VoxelType, range: (f64, f64), has_invalid: bool) -> Self {
        // A single value gets a range, whatever its size, in which its neighbours differ from it.
        let (low, high) = if range.1 > range.0 { range } else { (range.0, range.0 + range.0.abs().max(1.0)) };
        // With code 0 taken, `range.0` is code 1.
        let low = if has_invalid { low - (high - low) / 65534.0 } else { low };
        Self { voxel_type, format: SlotFormat::U16, low, high, has_invalid, ..PLAIN }.with_whole_spread()
    }

    /// Returns the encoding for a store of integers of `voxel_type` with valid values in `range`, and `nodata` for voxels without data.
    pub fn without(voxel_type: VoxelType, range: (f64, f64), nodata: f64) -> Self {
        let codes = range.1 - range.0 + 1.0;
        let format = if voxel_type.bytes() == 1 && codes <= 255.0 { SlotFormat::U8 } else { SlotFormat::U16 };
        if voxel_type.bytes() <= 2 && codes <= format.max_code() as f64 {
            let low = range.0 - 1.0;
            let high = low + format.max_code() as f64;
            let spread_codes = codes - 1.0;
            let has_invalid = true;
            return Self { voxel_type, format, low, high, has_invalid, nodata: Some(nodata), spread_codes, ..PLAIN }
                .with_whole_table();
        }
        Self { nodata: Some(nodata), ..Self::quantised(voxel_type, range, true) }
    }

    /// Returns the encoding of labels in `range`: a code for each if 65,536 codes suffice from the least to the greatest, else
    /// [`LabelCodes`](crate::LabelCodes). Voxels of the value `nodata` have no label, nor have others if `has_non_finite`.
    pub fn of_labels(voxel_type: VoxelType, range: (f64, f64), has_non_finite: bool, nodata: Option<f64>) -> Self {
        let has_invalid = has_non_finite || nodata.is_some();
        let plain = Self { is_labels: true, ..Self::new(voxel_type, range, false) };
        if voxel_type.bytes() <= 2 && !has_invalid {
            return plain;
        }
        let (format, low) = (SlotFormat::U16, range.0.floor() - f64::from(u8::from(has_invalid)));
        if range.1 - low <= f64::from(u16::MAX) {
            return Self { format, low, high: low + f64::from(u16::MAX), has_invalid, nodata, ..plain }
                .with_whole_spread();
        }
        Self { format, low: 0.0, high: f64::from(u16::MAX), nodata, is_hashed: true, ..plain }.with_whole_spread()
    }

    /// With a transfer table over all codes.
    fn with_whole_table(self) -> Self {
        Self { table_codes: [0, self.format.max_code() as u16], ..self }
    }

    /// With a transfer table over all codes, for a channel that uses them all.
    pub(crate) fn with_whole_spread(self) -> Self {
        Self { spread_codes: f64::from(self.format.max_code()), enough_width: 0.0, ..self.with_whole_table() }
    }

    /// Whether codes are the voxels' own bytes, so that encoding only copies.
    pub fn is_identity(&self) -> bool {
        !self.has_invalid && matches!(self.voxel_type, VoxelType::U8 | VoxelType::U16)
    }

    /// Data units per code.
    pub fn code_width(&self) -> f64 {
        (self.high - self.low) / self.format.max_code() as f64
    }

    /// The value of a normalised code (`code / max_code`, interpolated or not).
    pub fn value(&self, unorm: f64) -> f64 {
        self.low + unorm * (self.high - self.low)
    }

    /// The normalised code of a value: below 0 or above 1 outside the encoding's range.
    pub fn unorm(&self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }

    /// Whether the transfer table covers all codes.
    pub fn has_whole_table(&self) -> bool {
        self.table_codes == [0, self.format.max_code() as u16]
    }

    /// The code of the transfer table's first entry. Renderers count codes from it: near it they are exact in f32.
    pub fn first_code(&self) -> f64 {
        f64::from(self.table_codes[0])
    }

    /// Codes from the transfer table's first entry to its last.
    pub fn span_codes(&self) -> f64 {
        f64::from(self.table_codes[1] - self.table_codes[0])
    }

    /// A value in codes from the transfer table's first entry.
    pub fn code(&self, value: f64) -> f64 {
        self.unorm(value) * f64::from(self.format.max_code()) - self.first_code()
    }

    /// The value of a code, counted from the transfer table's first entry.
    pub fn value_of_code(&self, code: f64) -> f64 {
        self.value((code + self.first_code()) / f64::from(self.format.max_code()))
    }

    /// Position of a value in the transfer table: 0 at the first entry, 1 at the last.
    pub fn place(&self, value: f64) -> f64 {
        self.code(value) / self.span_codes()
    }

    /// The values of the transfer table's first and last entry.
    pub fn table_values(&self) -> [f64; 2] {
        [self.value_of_code(0.0), self.value_of_code(self.span_codes())]
    }

    /// Encodes little-endian voxels into slots' `codes`. Costs a copy for unsigned 8- and 16-bit data.
    ///
    /// # Panics
    /// If the two lengths do not hold the same number of voxels, or codes depend on a look.
    pub fn encode(&self, voxels: &[u8], codes: &mut [u8]) {
        assert!(!self.is_hashed, "codes by looks are made by LabelCodes");
        assert_eq!(voxels.len() / self.voxel_type.bytes(), codes.len() / self.format.bytes());
        match self.voxel_type {
            voxel_type if self.nodata.is_some() && self.format != SlotFormat::F32 => {
                with_voxel_type!(voxel_type, T => self.encode_marked::<T>(voxels, codes))
            }
            VoxelType::U8 | VoxelType::U16 => codes.copy_from_slice(voxels),
            VoxelType::I8 => codes.iter_mut().zip(voxels).for_each(|(c, v)| *c = v ^ 0x80),
            VoxelType::I16 => {
                for (c, v) in codes.chunks_exact_mut(2).zip(voxels.chunks_exact(2)) {
                    c.copy_from_slice(&[v[0], v[1] ^ 0x80]);
                }
            }
            VoxelType::U32 | VoxelType::I32 | VoxelType::F32 => {
                with_voxel_type!(self.voxel_type, T => match self.format {
                    SlotFormat::F32 => self.subtract_base::<T>(voxels, codes),
                    SlotFormat::U8 | SlotFormat::U16 => self.quantise::<T>(voxels, codes),
                });
            }
        }
    }

    fn quantise<T: Voxel>(&self, voxels: &[u8], codes: &mut [u8]) {
        let first = self.has_invalid as u32 as f64;
        let scale = self.format.max_code() as f64 / (self.high - self.low);
        for (c, v) in codes.as_chunks_mut().0.iter_mut().zip(voxels.chunks_exact(size_of::<T>())) {
            let v: T = bytemuck::pod_read_unaligned(v);
            let code = nearest_code(((v.to_f64() - self.low) * scale).max(first).min(65535.0));
            *c = if v.is_valid() { code.to_le_bytes() } else { [0; 2] };
        }
    }

    /// Encodes voxels, those without data as code 0.
    fn encode_marked<T: Voxel>(&self, voxels: &[u8], codes: &mut [u8]) {
        let nodata = self.nodata.map(T::from_f64_rounded);
        let most = self.format.max_code() as f64;
        let scale = most / (self.high - self.low);
        let code = |v: &[u8]| {
            let v: T = bytemuck::pod_read_unaligned(v);
            let code = nearest_code(((v.to_f64() - self.low) * scale).max(1.0).min(most));
            if Some(v) == nodata { 0 } else { code }
        };
        let voxels = voxels.chunks_exact(size_of::<T>());
        match self.format {
            SlotFormat::U8 => codes.iter_mut().zip(voxels).for_each(|(c, v)| *c = code(v) as u8),
            SlotFormat::U16 | SlotFormat::F32 => {
                codes.as_chunks_mut().0.iter_mut().zip(voxels).for_each(|(c, v)| *c = code(v).to_le_bytes());
            }
        }
    }

    fn subtract_base<T: Voxel>(&self, voxels: &[u8], slots: &mut [u8]) {
        let nodata = self.nodata.map(T::from_f64_rounded);
        let (base, [least, greatest]) = self.floats.map_or((0.0, [-MOST, MOST]), |floats| (floats.base, floats.limits));
        for (slot, v) in slots.chunks_exact_mut(4).zip(voxels.chunks_exact(size_of::<T>())) {
            let v: T = bytemuck::pod_read_unaligned(v);
            let number = || (v.to_f64().clamp(least, greatest) - base) as f32;
            let number = if v.is_valid() && Some(v) != nodata { number() } else { INVALID_SLOT };
            slot.copy_from_slice(&number.to_le_bytes());
        }
    }
}

/// The code nearest to a number from 0 to 65535, rounding ties to even: the last bits of the number added to 2^52, where neighbours are 1
/// apart. Several times as fast as rounding and conversion, which are calls for unknown instruction sets.
fn nearest_code(number: f64) -> u16 {
    const TWO_TO_52: f64 = (1u64 << 52) as f64;
    (number + TWO_TO_52).to_bits() as u16
}

#[cfg(test)]
mod tests {
    use super::*;

    fn round_trip(encoding: &SlotEncoding, voxels: &[u8]) -> Vec<f64> {
        let n = voxels.len() / encoding.voxel_type.bytes();
        let mut codes = vec![0; n * encoding.format.bytes()];
        encoding.encode(voxels, &mut codes);
        let max = encoding.format.max_code() as f64;
        let code = |i: usize| match encoding.format {
            SlotFormat::U8 => codes[i] as f64,
            SlotFormat::U16 | SlotFormat::F32 => u16::from_le_bytes([codes[2 * i], codes[2 * i + 1]]) as f64,
        };
        (0..n).map(|i| encoding.value(code(i) / max)).collect()
    }

    #[test]
    fn narrow_types_are_exact_at_every_value() {
        let all8: Vec<u8> = (0..=255).collect();
        let all16: Vec<u8> = (0..=65535u16).flat_map(u16::to_le_bytes).collect();
        for t in [VoxelType::U8, VoxelType::I8, VoxelType::U16, VoxelType::I16] {
            let bytes = if t.bytes() == 1 { &all8 } else { &all16 };
            let back = round_trip(&SlotEncoding::new(t, (0.0, 1.0), false), bytes);
            for (i, v) in back.into_iter().enumerate() {
                assert!((v - t.read(bytes, i)).abs() < 1e-9, "{t} {i}: {v}");
            }
        }
    }

    #[test]
    fn codes_are_rounded_to_the_nearest_and_to_even() {
        for i in 0..=4 * 65535u32 {
            let number = f64::from(i) / 4.0;
            assert_eq!(f64::from(nearest_code(number)), number.round_ties_even(), "{number}");
        }
    }

    #[test]
    fn floats_keep_their_range_and_mark_nan() {
        let values = [-2.0f32, 0.0, 5.0, f32::NAN, f32::INFINITY];
        let bytes: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let encoding = SlotEncoding::new(VoxelType::F32, (-2.0, 5.0), true);
        let mut codes = [0; 10];
        encoding.encode(&bytes, &mut codes);
        let code = |i: usize| u16::from_le_bytes([codes[2 * i], codes[2 * i + 1]]);
        assert_eq!([code(0), code(2), code(3), code(4)], [1, 65535, 0, 0]);
        let back = round_trip(&encoding, &bytes[..12]);
        for (v, b) in values.iter().zip(back) {
            assert!((*v as f64 - b).abs() <= 7.0 / 131_068.0 * 1.001);
        }
    }

    /// Checks the code and the value of every voxel of a type, given its least and greatest valid value.
    fn codes_without(t: VoxelType, range: (f64, f64), nodata: f64, values: &[f64]) -> SlotFormat {
        let encoding = SlotEncoding::without(t, range, nodata);
        for &value in values {
            let voxel = with_voxel_type!(t, T => bytemuck::bytes_of(&T::from_f64_rounded(value)).to_vec());
            let mut code = [0; 2];
            encoding.encode(&voxel, &mut code[..encoding.format.bytes()]);
            let code = u16::from_le_bytes(code);
            assert_eq!(code == 0, value == nodata, "{t} {value}");
            let found = encoding.value(code as f64 / encoding.format.max_code() as f64);
            let tolerance = if t.bytes() <= 2 && range.1 - range.0 < 65535.0 { 1e-7 } else { encoding.code_width() };
            assert!(code == 0 || (found - value).abs() <= tolerance, "{t} {value}: {found}");
        }
        encoding.format
    }

    #[test]
    fn values_beside_that_for_no_data_keep_codes_of_their_own() {
        let all = |low: i32, high: i32| (low..=high).map(f64::from).collect::<Vec<_>>();
        let (bytes, shorts) = (all(0, 255), all(-32768, 32767));
        assert_eq!(codes_without(VoxelType::U8, (0.0, 254.0), 255.0, &bytes), SlotFormat::U8);
        assert_eq!(codes_without(VoxelType::U8, (1.0, 255.0), 0.0, &bytes), SlotFormat::U8);
        // In the middle, with both ends in use, one code more is needed than 8 bits have.
        assert_eq!(codes_without(VoxelType::U8, (0.0, 255.0), 7.0, &bytes), SlotFormat::U16);
        assert_eq!(codes_without(VoxelType::I8, (-128.0, 127.0), 0.0, &all(-128, 127)), SlotFormat::U16);
        assert_eq!(codes_without(VoxelType::I16, (-32767.0, 32767.0), -32768.0, &shorts), SlotFormat::U16);
        assert_eq!(codes_without(VoxelType::I16, (-32768.0, 32767.0), -2000.0, &shorts), SlotFormat::U16);
        codes_without(VoxelType::I32, (-2e9, 2e9), -9999.0, &[-2e9, -9999.0, 0.0, 1.0, 2e9]);
        for t in [VoxelType::U8, VoxelType::I16, VoxelType::I32] {
            codes_without(t, (0.0, 0.0), 9.0, &[9.0, 0.0]);
            codes_without(t, (7.0, 7.0), 9.0, &[9.0, 7.0]);
        }
    }

    #[test]
    fn labels_have_a_code_each_or_are_hashed() {
        let near = SlotEncoding::of_labels(VoxelType::U32, (70_000.0, 70_900.0), false, None);
        let labels = [70_000u32, 70_001, 70_900];
        let bytes: Vec<u8> = labels.iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(round_trip(&near, &bytes), labels.map(f64::from));
        assert!(near.is_labels && !near.is_hashed);
        let gaps = SlotEncoding::of_labels(VoxelType::F32, (-3.0, 9.0), true, None);
        let bytes: Vec<u8> = [-3.0f32, 9.0].iter().flat_map(|v| v.to_le_bytes()).collect();
        assert_eq!(round_trip(&gaps, &bytes), [-3.0, 9.0]);
        assert!(SlotEncoding::of_labels(VoxelType::U32, (0.0, 4e9), false, None).is_hashed);
        let bytes = SlotEncoding::of_labels(VoxelType::U8, (1.0, 3.0), false, None);
        assert_eq!((bytes.low, bytes.high, bytes.is_hashed), (0.0, 255.0, false));
        let marked = SlotEncoding::of_labels(VoxelType::U8, (0.0, 254.0), false, Some(255.0));
        assert_eq!((round_trip(&marked, &[0, 7, 254]), marked.has_invalid), (vec![0.0, 7.0, 254.0], true));
        assert!(SlotEncoding::of_labels(VoxelType::I16, (-32768.0, 32767.0), false, Some(3.0)).is_hashed);
    }

    #[test]
    fn a_constant_volume_has_an_encoding() {
        let encoding = SlotEncoding::new(VoxelType::U32, (7.0, 7.0), false);
        assert_eq!(round_trip(&encoding, &7u32.to_le_bytes()), [7.0]);
        for value in [0.0f32, -5.0, 1e-40, 1e30, f32::MAX, f32::MIN] {
            for has_non_finite in [false, true] {
                let encoding = SlotEncoding::new(VoxelType::F32, (value as f64, value as f64), has_non_finite);
                let [found] = round_trip(&encoding, &value.to_le_bytes())[..] else { unreachable!() };
                // The code comes from sums of numbers this large.
                assert!((found - value as f64).abs() <= 1e-9 * value.abs().max(1.0) as f64, "{value}: {found}");
            }
        }
    }
}
