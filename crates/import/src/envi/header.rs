//! The fields of an ENVI header, checked.

use crate::axes::{Axis, AxisOrder, Sizes};
use crate::element::{Decode, Element, Endian};
use crate::error::{ImportError, Result};
use crate::note::{Note, Setting};
use crate::raw::ArrayLayout;
use crate::sidecar::numbers;
use crate::source::SourceInfo;
use brickyard_volume::{Extent, VoxelType, counted};
use glam::DVec3;
use std::path::Path;

const NODATA: &str = "data ignore value";
const ADVICE: &str = "write it as an ENVI standard file, or pass the raw file with `shape` and `voxel_type`";

/// Fields that would change the values; they are left out, with a note.
const GAINS: [&str; 3] = ["data gain values", "data offset values", "reflectance scale factor"];

/// Keys, in lower case, and values of a header.
pub(super) struct Header<'a> {
    keys: Vec<(String, String)>,
    path: &'a Path,
}

impl<'a> Header<'a> {
    /// Reads the lines behind the first: a key, `=`, and a value, which may go on over several lines within braces.
    pub(super) fn of(text: &str, path: &'a Path) -> Result<Self> {
        let mut keys = Vec::new();
        let mut lines = text.lines().skip(1).filter(|line| !line.trim_start().starts_with(';'));
        while let Some(line) = lines.next() {
            let Some((key, value)) = line.split_once('=') else { continue };
            let key = key.split_whitespace().collect::<Vec<_>>().join(" ").to_ascii_lowercase();
            let mut value = value.trim().to_owned();
            if value.starts_with('{') {
                while !value.contains('}') {
                    let Some(more) = lines.next() else {
                        let problem = format!("cut short: the braces of '{key}' do not end; fetch the header again");
                        return Err(ImportError::invalid(path, problem));
                    };
                    value.push('\n');
                    value += more.trim();
                }
                value = value[1..].split('}').next().unwrap_or_default().trim().to_owned();
            }
            keys.push((key, value));
        }
        Ok(Self { keys, path })
    }

    fn value(&self, key: &str) -> Option<&str> {
        self.keys
            .iter()
            .rev()
            .find(|(k, _)| k == key)
            .map(|(_, value)| value.as_str())
            .filter(|value| !value.is_empty())
    }

    fn number(&self, key: &str) -> Result<Option<u64>> {
        let Some(text) = self.value(key) else { return Ok(None) };
        text.parse().map(Some).map_err(|_| self.wrong(key, text, "a whole number"))
    }

    fn needed(&self, key: &str) -> Result<u64> {
        self.number(key)?.ok_or_else(|| {
            ImportError::invalid(
                self.path,
                format!("has no '{key}', which an ENVI header needs; write it into the text"),
            )
        })
    }

    fn wrong(&self, key: &str, value: &str, expected: &str) -> ImportError {
        ImportError::invalid(self.path, format!("'{key}' is '{value}', expected {expected}; correct the header"))
    }

    fn refused(&self, feature: String) -> ImportError {
        ImportError::unsupported_but(self.path, feature, ADVICE)
    }

    pub(super) fn array(&self) -> Result<ArrayLayout> {
        self.check_kind()?;
        let count = |key: &str| -> Result<u32> {
            let n = self.needed(key)?;
            u32::try_from(n).ok().filter(|&n| n > 0).ok_or_else(|| self.wrong(key, &n.to_string(), "a count above 0"))
        };
        let bands = if self.value("bands").is_some() { count("bands")? } else { 1 };
        let (element, channels) = self.element()?;
        let mut axes = match self.value("interleave").map(str::to_ascii_lowercase).as_deref() {
            Some("bsq") => vec![Axis::Z, Axis::Y, Axis::X],
            Some("bil") => vec![Axis::Y, Axis::Z, Axis::X],
            Some("bip") => vec![Axis::Y, Axis::X, Axis::Z],
            None if bands == 1 => vec![Axis::Z, Axis::Y, Axis::X],
            other => return Err(self.wrong("interleave", other.unwrap_or_default(), "bsq, bil or bip")),
        };
        if channels > 1 {
            axes.push(Axis::C);
        }
        let endian = match self.number("byte order")? {
            Some(0) => Endian::Little,
            Some(1) => Endian::Big,
            None if element.bytes() == 1 => Endian::Little,
            other => {
                let found = other.map_or(String::new(), |n| n.to_string());
                return Err(self.wrong("byte order", &found, "0 for little-endian or 1 for big-endian"));
            }
        };
        Ok(ArrayLayout {
            sizes: Sizes { extent: Extent::new(count("samples")?, count("lines")?, bands), channels, times: 1 },
            axes: AxisOrder::of(&axes),
            decode: Decode { element, endian, scale: None },
            offset: self.number("header offset")?.unwrap_or(0),
        })
    }

    /// Refuses files whose bytes lie otherwise than an array's.
    fn check_kind(&self) -> Result<()> {
        if let Some(kind) = self.value("file type") {
            let is_raw = ["envi standard", "envi classification", "envi spectral library", "envi"];
            if !is_raw.contains(&kind.to_ascii_lowercase().as_str()) {
                return Err(self.refused(format!("the file type '{kind}'")));
            }
        }
        for key in ["major frame offsets", "minor frame offsets"] {
            let Some(text) = self.value(key) else { continue };
            if numbers::<u64>(text).is_none_or(|offsets| offsets.iter().any(|&n| n != 0)) {
                return Err(self.refused(format!("'{key}' {{{text}}}")));
            }
        }
        Ok(())
    }

    /// The stored number, and how many are in a voxel.
    fn element(&self) -> Result<(Element, u32)> {
        use VoxelType::*;
        let of = |voxel_type| Ok((Element::Voxel(voxel_type), 1));
        match self.needed("data type")? {
            1 => of(U8),
            2 => of(I16),
            3 => of(I32),
            4 => of(F32),
            5 => Ok((Element::F64, 1)),
            6 => Ok((Element::Voxel(F32), 2)),
            9 => Ok((Element::F64, 2)),
            12 => of(U16),
            13 => of(U32),
            14 => Ok((Element::I64, 1)),
            15 => Ok((Element::U64, 1)),
            code => Err(self.refused(format!("data type {code}"))),
        }
    }

    /// The value for no data.
    pub(super) fn nodata(&self) -> Result<Option<f64>> {
        let Some(text) = self.value(NODATA) else { return Ok(None) };
        text.parse().map(Some).map_err(|_| self.wrong(NODATA, text, "a number"))
    }

    /// Fills in spacing and the value for no data, and adds notes on all that is left out.
    pub(super) fn describe(&self, info: &mut SourceInfo) -> Result<()> {
        let bands = info.extent.z;
        if bands > 1 {
            let what = if self.value("wavelength").is_some() { "; their wavelengths are left out" } else { "" };
            let bands = counted(bands.into(), "band");
            info.notes.push(Note::new(format!("The {bands} are the slices along z, 1 apart{what}.")));
        }
        for key in GAINS {
            if self.value(key).is_some() {
                info.notes.push(Note::warning(format!("'{key}' is not applied: values are as stored.")));
            }
        }
        if let Some(value) = self.nodata()? {
            info.set_nodata(value, NODATA);
        }
        let Some((sizes, unit)) = self.pixel_size() else { return Ok(()) };
        match (sizes, unit) {
            (Some([x, y]), Some(unit)) => {
                info.geometry.spacing = DVec3::new(x, y, 1.0);
                info.geometry.unit = Some(unit.into());
                info.calibrated = true;
                info.notes.push(Note::new("Only the size of pixels is kept of the place on the ground (map info)."));
            }
            _ => info.notes.push(
                Note::warning("The size of pixels (map info, pixel size) has no known length: it is left out.")
                    .settled_by(Setting::Spacing),
            ),
        }
        Ok(())
    }

    /// Sizes of a pixel along x and y, if they are valid, and their unit, if it is a known length; `None` if the header has neither.
    fn pixel_size(&self) -> Option<(Option<[f64; 2]>, Option<&'static str>)> {
        let (text, is_map) = match (self.value("pixel size"), self.value("map info")) {
            (Some(text), _) => (text, false),
            (None, Some(text)) => (text, true),
            (None, None) => return None,
        };
        let parts: Vec<&str> = text.split(',').map(str::trim).collect();
        // Name of the projection, reference pixel x and y, its easting and northing, then the sizes.
        let first = if is_map { 5 } else { 0 };
        let size = |i: usize| parts.get(i)?.parse().ok().filter(|n: &f64| *n > 0.0 && n.is_finite());
        let sizes = size(first).zip(size(first + 1)).map(|(x, y)| [x, y]);
        let unit = parts.iter().find_map(|part| {
            let (key, unit) = part.split_once('=')?;
            key.trim().eq_ignore_ascii_case("units").then(|| unit.trim().to_ascii_lowercase())
        });
        let unit = match unit.as_deref() {
            Some("meters" | "metres" | "meter" | "m") => Some("meter"),
            Some("km" | "kilometers") => Some("kilometer"),
            Some("mm" | "millimeters") => Some("millimeter"),
            Some("feet" | "ft") => Some("foot"),
            // Metres by default, but for projections in degrees.
            None if is_map && parts.first().is_some_and(|name| name.eq_ignore_ascii_case("UTM")) => Some("meter"),
            _ => None,
        };
        Some((sizes, unit))
    }
}
