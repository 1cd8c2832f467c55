//! The text before or beside the data: keys and values up to `ElementDataFile`, which ends it.

use crate::axes::{Axis, AxisOrder, Sizes};
use crate::data_files::{Coding, DataFiles, Start, beside};
use crate::element::{Decode, Element, Endian, Scale};
use crate::error::{ImportError, Result};
use crate::header_lines::{HeaderLines, counted_names};
use crate::raw::ArrayLayout;
use brickyard_volume::{VoxelType, counted};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

const SAVE: &str = "save it again as an uncompressed MetaImage of plain numbers (ITK, 3D Slicer)";

/// Types of elements. `MET_LONG` has four bytes on every system.
const TYPES: &[(&str, Element)] = &[
    ("MET_CHAR", Element::Voxel(VoxelType::I8)),
    ("MET_UCHAR", Element::Voxel(VoxelType::U8)),
    ("MET_SHORT", Element::Voxel(VoxelType::I16)),
    ("MET_USHORT", Element::Voxel(VoxelType::U16)),
    ("MET_INT", Element::Voxel(VoxelType::I32)),
    ("MET_UINT", Element::Voxel(VoxelType::U32)),
    ("MET_LONG", Element::Voxel(VoxelType::I32)),
    ("MET_ULONG", Element::Voxel(VoxelType::U32)),
    ("MET_LONG_LONG", Element::I64),
    ("MET_ULONG_LONG", Element::U64),
    ("MET_FLOAT", Element::Voxel(VoxelType::F32)),
    ("MET_DOUBLE", Element::F64),
];

/// A header's keys.
pub(super) struct Header {
    path: PathBuf,
    fields: BTreeMap<String, String>,
    /// Names of data files in lines of their own.
    listed: Vec<String>,
    /// Bytes up to the first one behind the header.
    end: u64,
}

impl Header {
    pub(super) fn read(path: &Path) -> Result<Self> {
        let mut lines = HeaderLines::open(path)?;
        let mut header = Self { path: path.to_owned(), fields: BTreeMap::new(), listed: Vec::new(), end: 0 };
        while let Some(line) = lines.next()? {
            if line.trim().is_empty() {
                continue;
            }
            // MetaIO takes either, whichever comes first.
            let Some((key, value)) = line.split_once(['=', ':']) else {
                let start: String = line.chars().take(40).collect();
                let problem = format!("its header has a line without a key, '{start}': expected 'Key = value'");
                return Err(header.invalid(problem));
            };
            let (key, value) = (key.trim(), value.trim());
            if header.get(key).is_some() {
                return Err(header.invalid(format!("its header has the key '{key}' twice: leave one")));
            }
            header.fields.insert(key.to_owned(), value.to_owned());
            if key == "ElementDataFile" {
                header.end = lines.bytes();
                if value.split_whitespace().next() == Some("LIST") {
                    header.listed = lines.names()?;
                }
                break;
            }
        }
        match header.get("ObjectType") {
            None | Some("Image") => Ok(header),
            Some(other) => Err(header.unsupported(format!("the ObjectType {other}"), "only images are read")),
        }
    }

    pub(super) fn get(&self, key: &str) -> Option<&str> {
        self.fields.get(key).map(String::as_str)
    }

    pub(super) fn invalid(&self, problem: impl Into<String>) -> ImportError {
        ImportError::invalid(&self.path, problem)
    }

    fn unsupported(&self, feature: impl Into<String>, advice: &str) -> ImportError {
        ImportError::unsupported_but(&self.path, feature, advice)
    }

    fn not_valid(&self, key: &str) -> ImportError {
        match self.get(key) {
            Some(value) => {
                let start: String = value.chars().take(80).collect();
                self.invalid(format!("its header has no valid '{key}': found '{start}'"))
            }
            None => self.invalid(format!("its header lacks the key '{key}'")),
        }
    }

    /// Number of axes.
    pub(super) fn dimensions(&self) -> Result<usize> {
        let count = self.get("NDims").ok_or_else(|| self.not_valid("NDims"))?;
        match count.parse::<usize>() {
            Ok(count @ 2..=4) => Ok(count),
            Ok(count) => Err(self.unsupported(format!("NDims = {count} (2 to 4 are read)"), SAVE)),
            Err(_) => Err(self.not_valid("NDims")),
        }
    }

    /// Numbers of a key, as many as told.
    pub(super) fn numbers(&self, key: &str, count: usize) -> Result<Option<Vec<f64>>> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let numbers: Option<Vec<f64>> = value.split_whitespace().map(|word| word.parse().ok()).collect();
        let is_right = |numbers: &Vec<f64>| numbers.len() == count && numbers.iter().all(|n| n.is_finite());
        numbers.filter(is_right).map(Some).ok_or_else(|| self.not_valid(key))
    }

    /// Numbers of one of several keys for the same thing, which must not differ.
    pub(super) fn numbers_of(&self, keys: &[&str], count: usize) -> Result<Option<Vec<f64>>> {
        let mut found: Option<(&str, Vec<f64>)> = None;
        for &key in keys {
            let Some(numbers) = self.numbers(key, count)? else { continue };
            match &found {
                Some((other, others)) if *others != numbers => {
                    return Err(self.invalid(format!("its header's '{other}' and '{key}' differ: leave one")));
                }
                Some(_) => {}
                None => found = Some((key, numbers)),
            }
        }
        Ok(found.map(|(_, numbers)| numbers))
    }

    fn number(&self, key: &str) -> Result<Option<f64>> {
        Ok(self.numbers(key, 1)?.and_then(|numbers| numbers.first().copied()))
    }

    /// A truth by its first letter, as in MetaIO.
    fn flag(&self, key: &str) -> Result<Option<bool>> {
        let Some(value) = self.get(key) else { return Ok(None) };
        match value.chars().next() {
            Some('T' | 't' | '1') => Ok(Some(true)),
            Some('F' | 'f' | '0') => Ok(Some(false)),
            _ => Err(self.not_valid(key)),
        }
    }

    fn sizes(&self) -> Result<Vec<u32>> {
        let value = self.get("DimSize").ok_or_else(|| self.not_valid("DimSize"))?;
        let sizes: Option<Vec<u32>> =
            value.split_whitespace().map(|word| word.parse().ok().filter(|n| *n > 0)).collect();
        let count = self.dimensions()?;
        sizes.filter(|sizes| sizes.len() == count).ok_or_else(|| self.not_valid("DimSize"))
    }

    /// The array: channels fastest, then x, y, z and, as a fourth dimension, time.
    pub(super) fn array(&self) -> Result<ArrayLayout> {
        let channels = match self.get("ElementNumberOfChannels") {
            None => 1,
            Some(count) => {
                count.parse::<u32>().ok().filter(|n| *n > 0).ok_or_else(|| self.not_valid("ElementNumberOfChannels"))?
            }
        };
        let mut sizes = self.sizes()?;
        sizes.insert(0, channels);
        sizes.reverse();
        let axes = &[Axis::T, Axis::Z, Axis::Y, Axis::X, Axis::C][5 - sizes.len()..];
        let sizes = Sizes::from_ordered(axes, &sizes);
        Ok(ArrayLayout { sizes, axes: AxisOrder::of(axes), decode: self.decode()?, offset: 0 })
    }

    fn decode(&self) -> Result<Decode> {
        let name = self.get("ElementType").ok_or_else(|| self.not_valid("ElementType"))?;
        let plain = name.strip_suffix("_ARRAY").unwrap_or(name);
        let Some((_, element)) = TYPES.iter().find(|(known, _)| *known == plain) else {
            let advice = "MET_CHAR to MET_ULONG_LONG, MET_FLOAT and MET_DOUBLE are read";
            return Err(self.unsupported(format!("ElementType {name}"), advice));
        };
        let [own, other] = [self.flag("ElementByteOrderMSB")?, self.flag("BinaryDataByteOrderMSB")?];
        if own.zip(other).is_some_and(|(own, other)| own != other) {
            let problem = "its header's 'ElementByteOrderMSB' and 'BinaryDataByteOrderMSB' differ: leave one";
            return Err(self.invalid(problem));
        }
        let endian = if own.or(other).unwrap_or(false) { Endian::Big } else { Endian::Little };
        let slope = self.number("ElementToIntensityFunctionSlope")?.unwrap_or(1.0);
        let intercept = self.number("ElementToIntensityFunctionOffset")?.unwrap_or(0.0);
        if slope == 0.0 {
            return Err(self.not_valid("ElementToIntensityFunctionSlope"));
        }
        let scale = ((slope, intercept) != (1.0, 0.0)).then_some(Scale::new(slope, intercept, VoxelType::F32));
        Ok(Decode { element: *element, endian, scale })
    }

    /// Whether the header leaves the byte order to the reader's system.
    pub(super) fn lacks_order(&self) -> bool {
        self.get("ElementByteOrderMSB").or(self.get("BinaryDataByteOrderMSB")).is_none()
    }

    /// The files with the voxels.
    pub(super) fn data_files(&self) -> Result<DataFiles> {
        let value = self.get("ElementDataFile").ok_or_else(|| self.not_valid("ElementDataFile"))?;
        if self.flag("BinaryData")? == Some(false) {
            return Err(self.unsupported("BinaryData = False", SAVE));
        }
        let paths = self.paths(value)?;
        let is_compressed = self.flag("CompressedData")?.unwrap_or(false);
        let coding = if is_compressed { Coding::Zlib } else { Coding::Plain };
        if is_compressed && paths.len() > 1 {
            return Err(self.unsupported("CompressedData in several data files", SAVE));
        }
        let own_end = if is_local(value) { self.end } else { 0 };
        let skip = match self.get("HeaderSize") {
            None => 0,
            Some(skip) => skip.parse::<i64>().map_err(|_| self.not_valid("HeaderSize"))?,
        };
        if skip < -1 || skip == -1 && is_compressed {
            return Err(self.unsupported(format!("HeaderSize = {skip} with CompressedData = {is_compressed}"), SAVE));
        }
        // MetaIO counts a size above 0 from the file's start, also where the header lies in it.
        let bytes = u64::try_from(skip).ok().filter(|skip| *skip > 0).unwrap_or(own_end);
        let start = Start { bytes, lines: 0, decoded: 0, is_last: skip == -1 };
        Ok(DataFiles { paths, coding, start })
    }

    fn paths(&self, value: &str) -> Result<Vec<PathBuf>> {
        let words: Vec<&str> = value.split_whitespace().collect();
        let names = match words[..] {
            [] => return Err(self.not_valid("ElementDataFile")),
            [one] if is_local(one) => return Ok(vec![self.path.clone()]),
            ["LIST", ref rest @ ..] => {
                self.check_count(self.listed.len(), rest)?;
                self.listed.clone()
            }
            [pattern, first, last, ref rest @ ..] if pattern.contains('%') && rest.len() < 2 => {
                let step = rest.first().copied().unwrap_or("1");
                let names = counted_names(pattern, [first, last, step]);
                let names = names.ok_or_else(|| self.not_valid("ElementDataFile"))?;
                self.check_count(names.len(), &[])?;
                names
            }
            _ => vec![value.to_owned()],
        };
        Ok(names.iter().map(|name| beside(&self.path, name)).collect())
    }

    /// Checks the number of files, each with `axes` of the array's: all but the last unless told otherwise.
    fn check_count(&self, found: usize, axes: &[&str]) -> Result<()> {
        let sizes = self.sizes()?;
        let axes = match axes {
            [] => sizes.len() - 1,
            [one] => match one.trim_end_matches(['D', 'd']).parse() {
                Ok(0) => sizes.len() - 1,
                Ok(count) if count <= sizes.len() => count,
                _ => return Err(self.not_valid("ElementDataFile")),
            },
            _ => return Err(self.not_valid("ElementDataFile")),
        };
        let expected =
            sizes.get(axes..).unwrap_or_default().iter().fold(1u64, |n, size| n.saturating_mul((*size).into()));
        if found as u64 == expected {
            return Ok(());
        }
        let [files, axes] = [(found, "data file"), (axes, "axis")].map(|(n, noun)| counted(n as u64, noun));
        let problem = format!("its header names {files} of {axes} each, but DimSize {sizes:?} needs {expected}");
        Err(self.invalid(problem))
    }
}

fn is_local(value: &str) -> bool {
    value.eq_ignore_ascii_case("local")
}
