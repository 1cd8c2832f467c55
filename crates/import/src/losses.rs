//! Loss counter: values changed by conversion to voxels, over the whole input when it is opened. No loss goes unreported.
//!
//! Only inputs with possible losses are read for it: 64-bit ones, and those whose scaled numbers may leave f32.

use crate::direct::told_nodata;
use crate::element::{Decode, Element, Endian, Scale};
use crate::error::{ImportError, Result};
use crate::files::name_of;
use crate::note::Note;
use crate::options::OpenOptions;
use brickyard_volume::{VoxelType, counted, with_voxel_type};
use std::path::Path;

/// Counts the numbers of an input that do not fit its voxels.
pub(crate) struct Losses<'a> {
    path: &'a Path,
    /// Number of files before it.
    files_before: usize,
    first_path: &'a Path,
    decode: Decode,
    allowed: bool,
    /// Whether voxels are read where they lie, with nothing to allow.
    is_in_place: bool,
    /// Whether the numbers are labels, none of which may become another.
    are_labels: bool,
    /// The no-data value, from the file, the user or the steps before.
    nodata: Option<f64>,
    count: u64,
    /// Numbers clamped, or made infinite.
    beyond: u64,
    rounded: u64,
    /// A lost number, as stored in the file.
    example: Option<String>,
    /// Whether signed 64-bit labels were seen that fit only i32, and only u32.
    has_negative: bool,
    has_great: bool,
}

/// The effect of a conversion on a number.
#[derive(Clone, Copy, PartialEq)]
enum Fate {
    Kept,
    Rounded,
    Beyond,
}

impl Fate {
    fn of_integer(fits: bool) -> Self {
        if fits { Self::Kept } else { Self::Beyond }
    }

    /// Returns the fate of a number converted to f32. Rounding is a loss only with `is_wide`, for 64-bit numbers.
    fn of_float(stored: f64, value: f64, is_wide: bool) -> Self {
        let held = value as f32;
        match () {
            () if stored.is_finite() && !held.is_finite() => Self::Beyond,
            () if is_wide && !stored.is_nan() && f64::from(held) != value => Self::Rounded,
            () => Self::Kept,
        }
    }
}

impl<'a> Losses<'a> {
    /// Starts a count; `None` if decoding loses nothing, or its losses are known. Losses are counted where the options allow them; otherwise,
    /// and always for labels, the first one is an error. `nodata` is the file's no-data value.
    pub(crate) fn may_occur(
        path: &'a Path,
        decode: Decode,
        nodata: Option<f64>,
        options: &OpenOptions,
    ) -> Option<Self> {
        let are_labels = options.are_labels == Some(true);
        let [least, greatest] = decode.element.limits();
        let may = match (decode.element, decode.scale) {
            (Element::I64 | Element::U64 | Element::F64, _) => true,
            (Element::Voxel(VoxelType::U32 | VoxelType::I32), Some(scale)) if are_labels => scale.to == VoxelType::F32,
            (_, Some(scale)) if scale.to == VoxelType::F32 => {
                greatest.max(-least) * scale.slope.abs() + scale.intercept.abs() > f64::from(f32::MAX)
            }
            _ => false,
        };
        // Its stored number becomes NaN, so that no value can equal it.
        let is_marked = decode.scale.is_some_and(|scale| scale.absent.is_some());
        // The type of signed labels depends on all of them.
        let is_open = are_labels && (decode.element, decode.scale) == (Element::I64, None);
        (may && (is_open || !options.is_looked_at)).then_some(Self {
            path,
            files_before: 0,
            first_path: path,
            decode,
            allowed: options.allow_lossy && !are_labels,
            is_in_place: false,
            are_labels,
            nodata: told_nodata(nodata.filter(|_| !is_marked).or(decode.scale.and_then(|scale| scale.nodata)), options),
            count: 0,
            beyond: 0,
            rounded: 0,
            example: None,
            has_negative: false,
            has_great: is_open && options.held_as.is_some_and(|held| held.voxel_type == VoxelType::U32),
        })
    }

    /// For voxels read where they lie.
    pub(crate) fn in_place(self) -> Self {
        Self { is_in_place: true, ..self }
    }

    /// Decoding for the numbers seen: signed labels become unsigned if only u32 holds them.
    pub(crate) fn decode(&self) -> Decode {
        let unsigned = Scale::new(1.0, 0.0, VoxelType::U32);
        Decode { scale: if self.has_great { Some(unsigned) } else { self.decode.scale }, ..self.decode }
    }

    /// Labels below 0 and labels above the limit of i32 share no type.
    fn fate_of_label(&mut self, label: i64) -> Fate {
        let (is_negative, is_great) = (label < 0, label > i32::MAX.into());
        self.has_negative |= is_negative;
        self.has_great |= is_great;
        let fits = if is_great { u32::try_from(label).is_ok() } else { i32::try_from(label).is_ok() };
        Fate::of_integer(fits && !(self.has_negative && self.has_great))
    }

    pub(crate) fn next_file(&mut self, path: &'a Path) {
        self.path = path;
        self.files_before += 1;
    }

    /// Counts contiguous stored numbers and the lost ones among them. If losses are not allowed, the first one is an error.
    pub(crate) fn see(&mut self, bytes: &[u8]) -> Result<()> {
        let (slope, intercept) = self.decode.scale.map_or((1.0, 0.0), |s| (s.slope, s.intercept));
        let absent = self.decode.scale.and_then(|scale| scale.absent);
        let is_absent = |number: f64| absent == Some(number);
        macro_rules! each {
            ($t:ty, $n:ident => $fate:expr, $value:expr) => {{
                let (numbers, _) = bytes.as_chunks::<{ size_of::<$t>() }>();
                for bytes in numbers {
                    let $n = match self.decode.endian {
                        Endian::Little => <$t>::from_le_bytes(*bytes),
                        Endian::Big => <$t>::from_be_bytes(*bytes),
                    };
                    if is_absent($value) {
                        continue;
                    }
                    let fate = $fate;
                    if fate != Fate::Kept {
                        self.lose(fate, &$n, $value * slope + intercept)?;
                    }
                }
                self.count += numbers.len() as u64;
            }};
        }
        let scaled = |n: f64, is_wide| Fate::of_float(n, n * slope + intercept, is_wide);
        let to_integer = self.decode.scale.is_some_and(|scale| !scale.to.is_float());
        // Integers beyond the precision of f64 are rounded even before scaling.
        let is_exact = |n: i128| n as f64 as i128 == n;
        match (self.decode.element, self.decode.scale) {
            (Element::I64, None) if self.are_labels => each!(i64, n => self.fate_of_label(n), n as f64),
            (Element::I64, None) => each!(i64, n => Fate::of_integer(i32::try_from(n).is_ok()), n as f64),
            (Element::U64, None) => each!(u64, n => Fate::of_integer(u32::try_from(n).is_ok()), n as f64),
            (Element::I64, _) if to_integer => {
                each!(i64, n => self.fate_of_whole(&n, n as f64 * slope + intercept, is_exact(n.into()))?, n as f64)
            }
            (Element::U64, _) if to_integer => {
                each!(u64, n => self.fate_of_whole(&n, n as f64 * slope + intercept, is_exact(n.into()))?, n as f64)
            }
            (Element::F64, _) if to_integer => {
                each!(f64, n => self.fate_of_whole(&n, n * slope + intercept, true)?, n)
            }
            (Element::I64, _) => {
                each!(i64, n => self.fate_of_wide(&n, n as f64 * slope + intercept, is_exact(n.into()))?, n as f64)
            }
            (Element::U64, _) => {
                each!(u64, n => self.fate_of_wide(&n, n as f64 * slope + intercept, is_exact(n.into()))?, n as f64)
            }
            (Element::F64, _) => each!(f64, n => self.fate_of_f64(n, n * slope + intercept)?, n),
            (Element::F16, _) => each!(half::f16, n => scaled(n.to_f64(), false), n.to_f64()),
            // For images, the note on scaled 32-bit numbers covers their rounding; labels are checked one by one.
            (Element::Voxel(t), _) => {
                let is_wide = self.are_labels && t.bytes() == 4;
                with_voxel_type!(t, T => each!(T, n => scaled(n as f64, is_wide), n as f64))
            }
        }
        Ok(())
    }

    /// Returns the fate of a 64-bit float. A no-data number becomes NaN or infinite, which is no loss; no other number may become equal to its
    /// f32.
    fn fate_of_f64(&self, number: f64, value: f64) -> Result<Fate> {
        let (fate, held) = (Fate::of_float(number, value, true), value as f32);
        let Some(nodata) = self.nodata else { return Ok(fate) };
        let narrowed = nodata as f32;
        let is_told_from_0 = narrowed != 0.0 || nodata == 0.0;
        match () {
            () if is_told_from_0 && (value == nodata || value == f64::from(narrowed)) => Ok(Fate::Kept),
            () if value == nodata || narrowed.is_finite() && held == narrowed => {
                Err(self.beside_nodata(&number, nodata))
            }
            () => Ok(fate),
        }
    }

    /// Returns the fate of a 64-bit integer in f32. `is_exact`: it is `value`, unscaled, and not rounded to it.
    fn fate_of_wide(&self, number: &dyn std::fmt::Debug, value: f64, is_exact: bool) -> Result<Fate> {
        match self.fate_of_f64(value, value)? {
            Fate::Kept if is_exact => Ok(Fate::Kept),
            Fate::Kept => match self.nodata.filter(|nodata| *nodata as f32 == value as f32) {
                Some(nodata) => Err(self.beside_nodata(number, nodata)),
                None => Ok(Fate::Rounded),
            },
            fate => Ok(fate),
        }
    }

    /// Returns the fate of a 64-bit number in an integer type: the nearest, ties to even. NaN and infinities become the no-data value, which
    /// no other number may become.
    fn fate_of_whole(&self, number: &dyn std::fmt::Debug, value: f64, is_exact: bool) -> Result<Fate> {
        let voxel_type = self.decode.voxel_type();
        let (least, greatest) = voxel_type.limits();
        let nodata = self.nodata.filter(|nodata| voxel_type.holds(*nodata));
        if !value.is_finite() {
            return nodata.map(|_| Fate::Kept).ok_or_else(|| self.unmarked(number));
        }
        let whole = value.round_ties_even();
        let held = whole.clamp(least, greatest);
        // Beside a mark of the file's own, the value for no data of the steps before is a number.
        let is_mark = is_exact && self.decode.scale.is_none_or(|scale| scale.absent.is_none());
        match self.nodata {
            Some(nodata) if value == nodata && held == nodata && is_mark => Ok(Fate::Kept),
            Some(nodata) if value == nodata || held == nodata => Err(self.beside_nodata(number, nodata)),
            _ if held == value && is_exact => Ok(Fate::Kept),
            _ if held == whole => Ok(Fate::Rounded),
            _ => Ok(Fate::Beyond),
        }
    }

    fn unmarked(&self, number: &dyn std::fmt::Debug) -> ImportError {
        let (name, voxel_type) = (self.decode.element.name(), self.decode.voxel_type());
        let problem = format!(
            "voxels are {name}, and the value {number:?} is no data, for which {voxel_type} has no value; give one with \
             `nodata`, or convert to f32"
        );
        ImportError::options(self.path, problem)
    }

    fn beside_nodata(&self, number: &dyn std::fmt::Debug, nodata: f64) -> ImportError {
        let (name, voxel_type) = (self.decode.element.name(), self.decode().voxel_type());
        let problem = format!(
            "voxels are {name}, and the value {number:?} cannot be held in {voxel_type} beside {nodata:?}, which means no \
             data; write the file with values within {voxel_type}, or choose another no-data value with `nodata`"
        );
        ImportError::options(self.path, problem)
    }

    fn lose(&mut self, fate: Fate, number: &dyn std::fmt::Debug, value: f64) -> Result<()> {
        let voxel_type = self.decode().voxel_type();
        let (least, greatest) = voxel_type.limits();
        let becomes = |nodata: f64| value == nodata || value.clamp(least, greatest) == nodata;
        if let Some(nodata) = self.nodata.filter(|nodata| !voxel_type.is_float() && becomes(*nodata)) {
            return Err(self.beside_nodata(number, nodata));
        }
        if !self.allowed {
            let advice = match self.are_labels {
                true => "and rounded or clamped labels become others: number them anew from 1, as \
                         fastremap.renumber(array) does in Python, which also gives the table of old and new numbers"
                    .into(),
                false if self.is_in_place => {
                    format!(
                        "`brickyard pack` makes a store with such values {}, if losses are allowed",
                        self.what_becomes_of(fate)
                    )
                }
                false => format!("pass `allow_lossy` to have such values {}", self.what_becomes_of(fate)),
            };
            let (name, held_as) = (self.decode.element.name(), self.decode.voxel_type());
            let problem =
                format!("voxels are {name}, and the value {number:?} cannot be held as it is in {held_as}; {advice}");
            return Err(ImportError::options(self.path, problem));
        }
        match fate {
            Fate::Beyond => self.beyond += 1,
            _ => self.rounded += 1,
        }
        // An example beyond the range takes precedence over a rounded one.
        if self.example.is_none() || (fate == Fate::Beyond && self.beyond == 1) {
            self.example = Some(format!("{number:?}"));
        }
        Ok(())
    }

    fn what_becomes_of(&self, fate: Fate) -> &'static str {
        match (fate, self.decode.voxel_type()) {
            (Fate::Beyond, VoxelType::F32) => "infinite",
            (Fate::Beyond, _) => "clamped to its limits",
            _ => "rounded to the nearest",
        }
    }

    /// Returns a sentence with the number and kind of changed values.
    pub(crate) fn note(&self) -> Note {
        let (from, to) = (self.decode.element.name(), self.decode().voxel_type());
        let lost = [(self.beyond, Fate::Beyond), (self.rounded, Fate::Rounded)].into_iter().filter(|(n, _)| *n > 0);
        let lost: Vec<String> = lost.map(|(n, fate)| format!("{n} {}", self.what_becomes_of(fate))).collect();
        let Some(example) = &self.example else {
            return Note::new(format!("Voxels are {from} and are held as {to}: no value is changed."));
        };
        let mut name = name_of(self.first_path);
        if self.files_before > 0 {
            name += &format!(" and {} more", counted(self.files_before as u64, "file"));
        }
        let (values, lost) = (counted(self.count, "value"), lost.join(", "));
        let text =
            format!("Voxels are {from} and are held as {to}: of {values} in {name}, {lost} (such as {example}).");
        Note::of_changed(self.beyond.saturating_add(self.rounded), text)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::element::Scale;
    use crate::options::{HeldAs, NoData};

    fn census(element: Element, scale: Option<Scale>, bytes: &[u8], allow_lossy: bool) -> Result<String, String> {
        census_with(element, scale, bytes, &OpenOptions { allow_lossy, ..OpenOptions::default() })
    }

    fn census_with(
        element: Element,
        scale: Option<Scale>,
        bytes: &[u8],
        options: &OpenOptions,
    ) -> Result<String, String> {
        let decode = Decode { element, endian: Endian::Little, scale };
        let Some(mut losses) = Losses::may_occur(Path::new("folder/a.npy"), decode, None, options) else {
            return Ok("nothing".into());
        };
        losses.see(bytes).map_err(|e| e.to_string()).map(|()| losses.note().to_string())
    }

    fn f64s(values: &[f64]) -> Vec<u8> {
        values.iter().flat_map(|v| v.to_le_bytes()).collect()
    }

    fn i64s(values: &[i64]) -> Vec<u8> {
        values.iter().flat_map(|v| v.to_le_bytes()).collect()
    }

    #[test]
    fn wide_numbers_that_fit_are_kept_without_a_flag() {
        let fit = i64s(&[i32::MIN.into(), -1, 0, i32::MAX.into()]);
        assert!(census(Element::I64, None, &fit, false).unwrap().contains("no value is changed"));
        let fit: Vec<u8> = [0, u64::from(u32::MAX)].iter().flat_map(|v| v.to_le_bytes()).collect();
        assert!(census(Element::U64, None, &fit, false).is_ok());
        let fit = f64s(&[0.0, -0.5, 2f64.powi(100), f64::INFINITY, f64::NAN, 16777216.0]);
        let fit = [fit, f64s(&[f32::MAX.into(), f32::MIN_POSITIVE.into()])].concat();
        assert!(census(Element::F64, None, &fit, false).unwrap().contains("no value is changed"));
    }

    #[test]
    fn lost_numbers_are_refused_or_counted() {
        let refused = |element, bytes: &[u8], words: &[&str]| {
            let message = census(element, None, bytes, false).unwrap_err();
            words.iter().for_each(|w| assert!(message.contains(w), "{w}: {message}"));
        };
        let counted = |element, bytes: &[u8], words: &[&str]| {
            let note = census(element, None, bytes, true).unwrap();
            words.iter().for_each(|w| assert!(note.contains(w), "{w}: {note}"));
        };
        let beyond = i64s(&[1, i64::from(i32::MAX) + 1, 2, i64::from(i32::MIN) - 1, i64::MIN]);
        refused(Element::I64, &beyond, &["a.npy", "2147483648", "i32", "`allow_lossy`", "clamped"]);
        counted(Element::I64, &beyond, &["of 5 values in a.npy", "3 clamped to its limits", "2147483648"]);
        counted(Element::U64, &u64::MAX.to_le_bytes(), &["1 clamped", "18446744073709551615"]);
        let mixed = f64s(&[0.5, 0.1, 1e300, -1e39, f64::INFINITY, 3.4028235677973366e38]);
        refused(Element::F64, &mixed, &["0.1", "rounded to the nearest", "`allow_lossy`"]);
        // Half a step above the greatest f32 is the least that rounds to infinity.
        counted(Element::F64, &mixed, &["of 6 values", "3 infinite, 1 rounded", "such as 1e300"]);
    }

    /// A no-data number among floats is no loss, and no integer becomes one.
    #[test]
    fn no_data_is_neither_lost_nor_made() {
        let counted = |element, bytes: &[u8], nodata, options: &OpenOptions| {
            let decode = Decode { element, endian: Endian::Little, scale: None };
            let mut losses = Losses::may_occur(Path::new("a.tif"), decode, nodata, options).unwrap();
            losses.see(bytes).map_err(|error| error.to_string()).map(|()| losses.note().to_string())
        };
        let plain = OpenOptions::default();
        let lossy = OpenOptions { allow_lossy: true, ..OpenOptions::default() };
        for (marker, voxel) in [(f64::MIN, f64::MIN), (-9999.1, -9999.1), (-9999.1, f64::from(-9999.1f32))] {
            let voxels = f64s(&[0.0, 1.0, voxel]);
            let note = counted(Element::F64, &voxels, Some(marker), &plain).unwrap();
            assert!(note.contains("no value is changed"), "{note}");
            let kept = OpenOptions { nodata: NoData::None, ..plain.clone() };
            let is_wide = f64::from(voxel as f32) != voxel;
            assert_eq!(counted(Element::F64, &voxels, Some(marker), &kept).is_err(), is_wide);
        }
        // A value equal to it in f32, and 0 beside a value of nearly 0.
        for (marker, voxel) in [(0.1, 0.1 + 1e-12), (f64::MIN_POSITIVE, 0.0), (f64::MIN_POSITIVE, f64::MIN_POSITIVE)] {
            let message = counted(Element::F64, &f64s(&[5.0, voxel]), Some(marker), &lossy).unwrap_err();
            assert!(message.contains("beside"), "{message}");
        }
        // The no-data value of the steps before holds here, and no number becomes it.
        let before = |voxel_type, nodata| OpenOptions {
            held_as: Some(HeldAs { voxel_type, nodata: Some(nodata), turned: [false; 3] }),
            ..lossy.clone()
        };
        let of_integers = before(VoxelType::I32, i32::MAX.into());
        assert!(
            counted(Element::I64, &i64s(&[1 << 40]), None, &of_integers).unwrap_err().contains("beside 2147483647")
        );
        let of_floats = before(VoxelType::F32, f64::from(-9999.9f32));
        assert!(counted(Element::F64, &f64s(&[-9999.9001]), None, &of_floats).unwrap_err().contains("beside"));
        assert!(counted(Element::F64, &f64s(&[f64::from(-9999.9f32)]), None, &of_floats).is_ok());
        let beyond = counted(Element::F64, &f64s(&[-1e300]), Some(f64::from(f32::MIN)), &lossy).unwrap();
        assert!(beyond.contains("1 infinite"), "{beyond}");
        let clamped = OpenOptions { nodata: NoData::Value(i32::MAX.into()), ..lossy.clone() };
        let cases = [
            (i64s(&[0, i64::MIN]), Some(i64::MIN as f64), &lossy, "-9223372036854775808 cannot be held in i32"),
            (i64s(&[0, 1 << 40]), None, &clamped, "1099511627776 cannot be held in i32 beside 2147483647.0"),
        ];
        for (voxels, nodata, options, words) in cases {
            let message = counted(Element::I64, &voxels, nodata, options).unwrap_err();
            assert!(message.contains(words), "{message}");
        }
    }

    #[test]
    fn labels_are_never_merged_whatever_is_allowed() {
        let labels = |allow_lossy| OpenOptions { allow_lossy, are_labels: Some(true), ..OpenOptions::default() };
        let scaled = |slope| Some(Scale::new(slope, 0.0, VoxelType::F32));
        let i32s = |values: &[i32]| -> Vec<u8> { values.iter().flat_map(|v| v.to_le_bytes()).collect() };
        let long = Element::Voxel(VoxelType::I32);
        for (element, scale, bytes, label) in [
            (Element::U64, None, i64s(&[7, 1 << 40]), "1099511627776"),
            (Element::I64, None, i64s(&[-1, -(1 << 31) - 1]), "-2147483649"),
            (Element::F64, None, f64s(&[3.0, 16777217.0]), "16777217"),
            (long, scaled(0.5), i32s(&[16777217]), "16777217"),
        ] {
            for allow_lossy in [false, true] {
                let message = census_with(element, scale, &bytes, &labels(allow_lossy)).unwrap_err();
                assert!(message.contains(label) && message.contains("fastremap.renumber"), "{message}");
                assert!(!message.contains("allow_lossy"), "{message}");
            }
        }
        // Signed labels become unsigned where u32 holds all.
        let great = i64s(&[0, 1 << 31, i64::from(u32::MAX)]);
        assert!(census_with(Element::I64, None, &great, &labels(false)).unwrap().contains("held as u32: no value"));
        let again = OpenOptions { is_looked_at: true, ..labels(false) };
        assert!(census_with(Element::I64, None, &great, &again).unwrap().contains("held as u32"), "seen anew");
        // A store's later steps are held like the first.
        let held_as = Some(HeldAs { voxel_type: VoxelType::U32, nodata: None, turned: [false; 3] });
        let step = OpenOptions { held_as, ..labels(false) };
        assert!(census_with(Element::I64, None, &i64s(&[3]), &step).unwrap().contains("held as u32"));
        for labels_of in [[-1, 1 << 31], [1 << 31, -1], [0, 1 << 32]] {
            assert!(census_with(Element::I64, None, &i64s(&labels_of), &labels(true)).is_err(), "{labels_of:?}");
        }
        assert!(census(Element::I64, None, &great, false).unwrap_err().contains("2147483648"), "an image");
        // Labels that fit are read as usual; in an image such a number is rounded, and its note reports it.
        assert!(census_with(Element::I64, None, &i64s(&[-5, 0, 70000]), &labels(false)).is_ok());
        assert!(census_with(long, scaled(0.5), &i32s(&[1 << 25, 3]), &labels(false)).is_ok());
        // 2^53 + 1 is 2^53 as an f64.
        let merged = i64s(&[1 << 53, (1 << 53) + 1]);
        assert!(census_with(Element::I64, scaled(2.0), &merged, &labels(true)).is_err());
        assert!(census(Element::I64, scaled(2.0), &merged, false).is_err());
        assert!(census(Element::U64, scaled(2.0), &i64s(&[1 << 54]), false).is_ok());
        assert_eq!(census(long, scaled(0.5), &i32s(&[16777217]), false).unwrap(), "nothing");
    }

    #[test]
    fn scaled_numbers_that_leave_f32_are_refused_or_counted() {
        let scale = |slope| Some(Scale::new(slope, 0.0, VoxelType::F32));
        let bytes: Vec<u8> = [1.0f32, 3e38, f32::INFINITY, -2e38].iter().flat_map(|v| v.to_le_bytes()).collect();
        let float = Element::Voxel(VoxelType::F32);
        assert!(census(float, scale(2.0), &bytes, false).unwrap_err().contains("infinite"));
        assert!(census(float, scale(2.0), &bytes, true).unwrap().contains("of 4 values in a.npy, 2 infinite"));
        assert_eq!(census(float, scale(0.7), &bytes, false).unwrap(), "nothing");
        assert_eq!(census(Element::Voxel(VoxelType::U32), scale(1e6), &bytes, false).unwrap(), "nothing");
        assert!(census(Element::Voxel(VoxelType::U8), scale(1e37), &[1, 200], false).unwrap_err().contains("200"));
    }
}
