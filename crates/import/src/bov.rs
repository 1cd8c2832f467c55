//! VisIt's brick of values: a short text, `.bov`, with the layout of a raw file beside it, which is read through [`RawSource`], after
//! unpacking if it is compressed by gzip.

#[cfg(test)]
mod tests;

use crate::axes::{Axis, AxisOrder, Sizes};
use crate::body::Body;
use crate::element::{Decode, Element, Endian};
use crate::error::{ImportError, Result};
use crate::files::{first_bytes, folder_of};
use crate::looks;
use crate::note::Note;
use crate::options::OpenOptions;
use crate::raw::{ArrayLayout, RawSource, identity};
use crate::sidecar::{check_raw, numbers, text_of};
use crate::source::SourceInfo;
use crate::stamp::Stamp;
use crate::step_time::{StepTime, TimeSpan};
use brickyard_volume::{Extent, VoxelType};
use glam::DVec3;
use std::path::{Path, PathBuf};

/// Bytes searched for the line that names the raw file.
const LOOKED_AT: usize = 1024;
const RAW: &str = "pass the raw file with `shape` and `voxel_type`";

/// Keys that change nothing in the voxels, or nothing if they say this.
const IDLE: [(&str, Option<&str>); 8] = [
    ("HAS_BOUNDARY", Some("false")),
    ("DIVIDE_BRICK", Some("false")),
    ("VARIABLE_BRICK_MIN", None),
    ("VARIABLE_BRICK_MAX", None),
    ("VARIABLE_MIN", None),
    ("VARIABLE_MAX", None),
    ("VARIABLE_PALETTE_MIN", None),
    ("VARIABLE_PALETTE_MAX", None),
];

/// Opens a raw file by its description.
pub(crate) fn open(path: &Path, options: &OpenOptions) -> Result<RawSource> {
    let text = text_of(path, "BOV header")?;
    let header = Header { keys: keys_of(&text), path };
    let raw = header.raw_file()?;
    check_raw(path, &raw)?;
    let stamps = [Stamp::of(path)?, Stamp::of(&raw)?];
    let array = header.array()?;
    let mut info = SourceInfo { identity: identity("bov", &[path, &raw])?, ..array.info() };
    header.describe(&mut info)?;
    let source = Body::open(&raw)?.source(array, info, options)?;
    stamps[0].check(path)?;
    stamps[1].check(&raw)?;
    Ok(source.at(header.step_time()?))
}

/// Whether a text is such a description: a line names its raw file.
pub(crate) fn is_bov(path: &Path) -> Result<bool> {
    let start = first_bytes(path, LOOKED_AT)?;
    Ok(start.split(|&byte| byte == b'\n').any(|line| line.trim_ascii_start().starts_with(b"DATA_FILE:")))
}

/// Keys and values, one pair a line. Words of a key may be apart.
fn keys_of(text: &str) -> Vec<(String, &str)> {
    let lines = text.lines().map(str::trim).filter(|line| !line.starts_with('#'));
    let pairs = lines.filter_map(|line| line.split_once(':'));
    pairs
        .map(|(key, value)| {
            let key = key.split_whitespace().collect::<Vec<_>>().join("_").to_ascii_uppercase();
            (key, value.trim().trim_matches('"'))
        })
        .collect()
}

struct Header<'a> {
    keys: Vec<(String, &'a str)>,
    path: &'a Path,
}

impl<'a> Header<'a> {
    /// The value of a key; of several the last, as in VisIt.
    fn value(&self, key: &str) -> Option<&'a str> {
        self.keys.iter().rev().find(|(k, _)| k == key).map(|(_, value)| *value).filter(|value| !value.is_empty())
    }

    fn needed(&self, key: &str) -> Result<&'a str> {
        self.value(key).ok_or_else(|| {
            ImportError::invalid(self.path, format!("has no {key}, which a BOV header needs; write it into the text"))
        })
    }

    fn wrong(&self, key: &str, value: &str, expected: &str) -> ImportError {
        ImportError::invalid(self.path, format!("{key} is '{value}', expected {expected}; correct the text"))
    }

    fn refused(&self, feature: String) -> ImportError {
        ImportError::unsupported_but(self.path, feature, RAW)
    }

    fn three(&self, key: &str, default: f64) -> Result<DVec3> {
        let Some(value) = self.value(key) else { return Ok(DVec3::splat(default)) };
        let three = numbers::<f64>(value).and_then(|n| <[f64; 3]>::try_from(n).ok()).map(DVec3::from_array);
        three.filter(|n| n.is_finite()).ok_or_else(|| self.wrong(key, value, "three numbers"))
    }

    fn raw_file(&self) -> Result<PathBuf> {
        let name = self.needed("DATA_FILE")?;
        if name.contains('%') {
            return Err(self.refused(format!("a DATA_FILE of several files ({name})")));
        }
        Ok(folder_of(self.path).join(name))
    }

    fn array(&self) -> Result<ArrayLayout> {
        self.check_understood()?;
        let (text, expected) = (self.needed("DATA_SIZE")?, "three counts above 0");
        let size = numbers::<u32>(text).and_then(|n| <[u32; 3]>::try_from(n).ok()).filter(|n| !n.contains(&0));
        let size = size.ok_or_else(|| self.wrong("DATA_SIZE", text, expected))?;
        if let Some(bricklets) = self.value("DATA_BRICKLETS").filter(|text| numbers(text) != Some(size.to_vec())) {
            return Err(self.refused(format!("DATA_BRICKLETS {bricklets} unlike DATA_SIZE")));
        }
        let mut axes = vec![Axis::Z, Axis::Y, Axis::X];
        let channels = self.components()?;
        if channels > 1 {
            axes.push(Axis::C);
        }
        let offset = self
            .value("BYTE_OFFSET")
            .map_or(Ok(0), |text| text.parse().map_err(|_| self.wrong("BYTE_OFFSET", text, "a count of bytes")))?;
        Ok(ArrayLayout {
            sizes: Sizes { extent: Extent::new(size[0], size[1], size[2]), channels, times: 1 },
            axes: AxisOrder::of(&axes),
            decode: Decode { element: self.element()?, endian: self.endian()?, scale: None },
            offset,
        })
    }

    /// Refuses keys that would give other voxels, in other places.
    fn check_understood(&self) -> Result<()> {
        for (key, value) in self.keys.iter().filter(|(_, value)| !value.is_empty()) {
            let idle = IDLE.iter().find(|(k, _)| k == key);
            let known = [
                "TIME",
                "DATA_FILE",
                "DATA_SIZE",
                "DATA_FORMAT",
                "DATA_COMPONENTS",
                "DATA_BRICKLETS",
                "VARIABLE",
                "DATA_ENDIAN",
                "CENTERING",
                "BRICK_ORIGIN",
                "BRICK_SIZE",
                "BYTE_OFFSET",
            ];
            let is_idle = idle.is_some_and(|(_, only)| only.is_none_or(|only| value.eq_ignore_ascii_case(only)));
            if !is_idle && !known.contains(&key.as_str()) {
                return Err(self.refused(format!("{key} {value}")));
            }
        }
        Ok(())
    }

    fn components(&self) -> Result<u32> {
        let Some(text) = self.value("DATA_COMPONENTS") else { return Ok(1) };
        if text.eq_ignore_ascii_case("COMPLEX") {
            return Ok(2);
        }
        let count = text.parse().ok().filter(|&n| n > 0);
        count.ok_or_else(|| self.wrong("DATA_COMPONENTS", text, "a count above 0, or COMPLEX"))
    }

    fn element(&self) -> Result<Element> {
        let text = self.needed("DATA_FORMAT")?;
        let is = |start: &str| text.get(..start.len()).is_some_and(|t| t.eq_ignore_ascii_case(start));
        // VisIt compares the first letters alone, for plurals.
        match () {
            () if is("BYTE") || is("CHAR") => {
                let scaled = ["VARIABLE_PALETTE_MIN", "VARIABLE_PALETTE_MAX", "VARIABLE_MIN", "VARIABLE_MAX"];
                match scaled.iter().find(|key| self.value(key).is_some()) {
                    Some(key) => Err(self.refused(format!("{key} of BYTE data, which scales them,"))),
                    None => Ok(Element::Voxel(VoxelType::U8)),
                }
            }
            () if is("SHORT") => Ok(Element::Voxel(VoxelType::I16)),
            () if is("INT") => Ok(Element::Voxel(VoxelType::I32)),
            () if is("FLOAT") || is("REAL") => Ok(Element::Voxel(VoxelType::F32)),
            () if is("DOUBLE") => Ok(Element::F64),
            () => Err(self.refused(format!("DATA_FORMAT {text}"))),
        }
    }

    /// VisIt takes the order of the machine it runs on where none is said; few of them are big-endian.
    fn endian(&self) -> Result<Endian> {
        match self.value("DATA_ENDIAN").map(str::to_ascii_uppercase).as_deref() {
            None | Some("LITTLE") => Ok(Endian::Little),
            Some("BIG") => Ok(Endian::Big),
            Some(text) => Err(self.wrong("DATA_ENDIAN", text, "LITTLE or BIG")),
        }
    }

    /// Fills in geometry and channels. The brick reaches from the first to the last value if these lie on its nodes; else each value is in
    /// the middle of its zone.
    fn describe(&self, info: &mut SourceInfo) -> Result<()> {
        info.channel_looks = match (self.value("VARIABLE"), info.channels) {
            (_, 2) => looks::named(&looks::COMPLEX),
            (_, 3) => looks::named(&["x", "y", "z"]),
            (Some(name), 1) => looks::named(&[name]),
            _ => Vec::new(),
        };
        if self.value("DATA_ENDIAN").is_none() && info.voxel_type.bytes() > 1 {
            info.notes.push(Note::warning("The header has no DATA_ENDIAN: numbers are read as little-endian."));
        }
        let size = self.three("BRICK_SIZE", 0.0)?;
        info.geometry.origin = self.three("BRICK_ORIGIN", 0.0)?;
        if size.min_element() <= 0.0 {
            if let Some(text) = self.value("BRICK_SIZE") {
                return Err(self.wrong("BRICK_SIZE", text, "three sizes above 0"));
            }
            return Ok(());
        }
        let counts = DVec3::from_array(info.extent.to_array().map(f64::from));
        info.calibrated = true;
        match self.value("CENTERING").map(str::to_ascii_lowercase).as_deref() {
            Some("zonal") => {
                info.geometry.spacing = size / counts;
                info.geometry.origin += info.geometry.spacing / 2.0;
            }
            // As in VisIt, where none is said.
            None | Some("nodal") => info.geometry.spacing = size / (counts - 1.0).max(DVec3::ONE),
            Some(text) => return Err(self.wrong("CENTERING", text, "zonal or nodal")),
        }
        if self.value("CENTERING").is_none() {
            info.notes.push(Note::warning("The header has no CENTERING: values are taken as nodal, as VisIt does."));
        }
        Ok(())
    }

    fn step_time(&self) -> Result<StepTime> {
        let Some(text) = self.value("TIME") else { return Ok(StepTime::default()) };
        let number = text.parse().ok().filter(|n: &f64| n.is_finite());
        let number = number.ok_or_else(|| self.wrong("TIME", text, "a number"))?;
        Ok(StepTime { stamp: Some(TimeSpan { number, unit: None, since: None }), ..StepTime::default() })
    }
}
