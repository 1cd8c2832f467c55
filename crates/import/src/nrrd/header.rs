//! The text before or beside the data: fields by their names, and the data files.

use super::segments::Segments;
use crate::data_files::{Coding, DataFiles, Start, beside};
use crate::element::{Decode, Element, Endian};
use crate::error::{ImportError, Result};
use crate::header_lines::{HeaderLines, counted_names};
use crate::step_time::moment_in;
use brickyard_volume::{VoxelType, counted};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Way on from what is refused.
pub(super) const SAVE: &str = "save it again with raw or gzip encoding (unu save, 3D Slicer)";

/// Names of types, as in C, and their numbers.
const TYPES: &[(&[&str], Element)] = &[
    (&["signed char", "int8", "int8_t"], Element::Voxel(VoxelType::I8)),
    (&["uchar", "unsigned char", "uint8", "uint8_t"], Element::Voxel(VoxelType::U8)),
    (&["short", "short int", "signed short", "signed short int", "int16", "int16_t"], Element::Voxel(VoxelType::I16)),
    (&["ushort", "unsigned short", "unsigned short int", "uint16", "uint16_t"], Element::Voxel(VoxelType::U16)),
    (&["int", "signed int", "int32", "int32_t"], Element::Voxel(VoxelType::I32)),
    (&["uint", "unsigned int", "uint32", "uint32_t"], Element::Voxel(VoxelType::U32)),
    (
        &["longlong", "long long", "long long int", "signed long long", "signed long long int", "int64", "int64_t"],
        Element::I64,
    ),
    (&["ulonglong", "unsigned long long", "unsigned long long int", "uint64", "uint64_t"], Element::U64),
    (&["float"], Element::Voxel(VoxelType::F32)),
    (&["double"], Element::F64),
];

/// Fields of the format, without blanks.
const KNOWN: &[&str] = &[
    "axismaxs",
    "axismins",
    "blocksize",
    "byteskip",
    "centerings",
    "content",
    "datafile",
    "dimension",
    "encoding",
    "endian",
    "kinds",
    "labels",
    "lineskip",
    "max",
    "measurementframe",
    "min",
    "number",
    "oldmax",
    "oldmin",
    "sampleunits",
    "sizes",
    "space",
    "spacedimension",
    "spacedirections",
    "spaceorigin",
    "spaceunits",
    "spacings",
    "thicknesses",
    "type",
    "units",
];

/// A header's fields.
pub(super) struct Header {
    path: PathBuf,
    /// Names in lower case without blanks, and values.
    fields: BTreeMap<String, String>,
    pub(super) segments: Segments,
    /// The moment from which times count, of the key `time_since`, which exports write.
    pub(super) since: Option<String>,
    /// Names of data files in lines of their own.
    listed: Vec<String>,
    /// Bytes up to the first one behind the header; `None` if the file ends with it.
    end: Option<u64>,
}

impl Header {
    pub(super) fn read(path: &Path) -> Result<Self> {
        let mut lines = HeaderLines::open(path)?;
        let magic = lines.next()?.unwrap_or_default();
        if !matches!(&*magic, "NRRD0001" | "NRRD0002" | "NRRD0003" | "NRRD0004" | "NRRD0005" | "NRRD00.01") {
            let found: String = magic.chars().take(20).collect();
            return Err(ImportError::unsupported_but(
                path,
                format!("the NRRD version '{found}' (1 to 5 are read)"),
                SAVE,
            ));
        }
        let path = path.to_owned();
        let (fields, segments) = (BTreeMap::new(), Segments::default());
        let mut header = Self { path, fields, segments, since: None, listed: Vec::new(), end: None };
        while let Some(line) = lines.next()? {
            if line.is_empty() {
                header.end = Some(lines.bytes());
                break;
            }
            header.add(&line)?;
            if header.get("datafile").is_some_and(|value| value.split_whitespace().next() == Some("LIST")) {
                header.listed = lines.names()?;
                break;
            }
        }
        Ok(header)
    }

    /// Adds a line's field. Comments say nothing of the array, and keys with values nothing but its segments and the moment of its times.
    fn add(&mut self, line: &str) -> Result<()> {
        if line.starts_with('#') {
            return Ok(());
        }
        let parts = line.split_once(':').filter(|(name, _)| !name.trim().is_empty());
        let Some((name, value)) = parts else {
            let start: String = line.chars().take(40).collect();
            let problem = format!("its header has a line without a field, '{start}': expected 'field: value'");
            return Err(self.invalid(problem));
        };
        if let Some(value) = value.strip_prefix('=') {
            self.segments.add(name.trim(), value.trim());
            if name.trim() == "time_since" {
                self.since = moment_in(value);
            }
            return Ok(());
        }
        let name: String = name.to_lowercase().split_whitespace().collect();
        // A key may have a colon, too.
        if line.contains(":=") && !KNOWN.contains(&&*name) {
            return Ok(());
        }
        let name = if name == "centers" { "centerings".into() } else { name };
        if self.get(&name).is_some() {
            return Err(self.invalid(format!("its header has the field '{name}' twice: leave one")));
        }
        self.fields.insert(name, value.trim().to_owned());
        Ok(())
    }

    pub(super) fn get(&self, name: &str) -> Option<&str> {
        self.fields.get(name).map(String::as_str)
    }

    pub(super) fn invalid(&self, problem: impl Into<String>) -> ImportError {
        ImportError::invalid(&self.path, problem)
    }

    pub(super) fn unsupported(&self, feature: impl Into<String>, advice: &str) -> ImportError {
        ImportError::unsupported_but(&self.path, feature, advice)
    }

    /// Names of fields that the format does not have: a misspelt one says nothing.
    pub(super) fn unknown(&self) -> Vec<&str> {
        let names = self.fields.keys().map(String::as_str);
        names.filter(|name| !KNOWN.contains(name)).collect()
    }

    /// A field's value, or an error about it.
    pub(super) fn not_valid(&self, name: &str) -> ImportError {
        match self.get(name) {
            Some(value) => {
                let start: String = value.chars().take(80).collect();
                self.invalid(format!("its header has no valid '{name}': found '{start}'"))
            }
            None => self.invalid(format!("its header lacks the field '{name}'")),
        }
    }

    fn whole(&self, name: &str) -> Result<Option<i64>> {
        self.get(name).map(|value| value.parse().map_err(|_| self.not_valid(name))).transpose()
    }

    /// Sizes of the axes, fastest first.
    pub(super) fn sizes(&self) -> Result<Vec<u32>> {
        let dimension = self.whole("dimension")?.ok_or_else(|| self.not_valid("dimension"))?;
        if !(2..=5).contains(&dimension) {
            return Err(self.unsupported(format!("dimension {dimension} (2 to 5 are read)"), "slice it (unu slice)"));
        }
        let words = self.words("sizes")?.ok_or_else(|| self.not_valid("sizes"))?;
        let sizes: Option<Vec<u32>> = words.iter().map(|word| word.parse().ok().filter(|n| *n > 0)).collect();
        sizes.filter(|sizes| sizes.len() as i64 == dimension).ok_or_else(|| self.not_valid("sizes"))
    }

    /// A field's words: one for each axis, where there is a dimension.
    pub(super) fn words(&self, name: &str) -> Result<Option<Vec<&str>>> {
        let Some(value) = self.get(name) else { return Ok(None) };
        let words: Vec<&str> = value.split_whitespace().collect();
        let is_right = self.whole("dimension")? == Some(words.len() as i64);
        if is_right { Ok(Some(words)) } else { Err(self.not_valid(name)) }
    }

    /// A number for each axis.
    pub(super) fn numbers(&self, name: &str) -> Result<Option<Vec<f64>>> {
        let Some(words) = self.words(name)? else { return Ok(None) };
        let numbers: Option<Vec<f64>> = words.iter().map(|word| word.parse().ok()).collect();
        numbers.map(Some).ok_or_else(|| self.not_valid(name))
    }

    /// Texts in double quotes.
    pub(super) fn quoted(&self, name: &str) -> Result<Option<Vec<String>>> {
        let Some(mut rest) = self.get(name) else { return Ok(None) };
        let mut texts = Vec::new();
        while let Some((_, after)) = rest.split_once('"') {
            let (text, behind) = after.split_once('"').ok_or_else(|| self.not_valid(name))?;
            texts.push(text.trim().to_owned());
            rest = behind;
        }
        Ok(Some(texts))
    }

    /// Vectors in parentheses, or `none`.
    pub(super) fn vectors(&self, name: &str) -> Result<Option<Vec<Option<Vec<f64>>>>> {
        let Some(value) = self.get(name) else { return Ok(None) };
        let (mut rest, mut vectors) = (value.trim(), Vec::new());
        while !rest.is_empty() {
            let (vector, behind) = match rest.strip_prefix('(') {
                Some(inside) => {
                    let (numbers, behind) = inside.split_once(')').ok_or_else(|| self.not_valid(name))?;
                    let numbers: Option<Vec<f64>> = numbers.split(',').map(|n| n.trim().parse().ok()).collect();
                    let numbers = numbers.ok_or_else(|| self.not_valid(name))?;
                    // Some writers have no other word for an axis outside space.
                    let is_none = numbers.iter().all(|n| n.is_nan());
                    ((!is_none).then_some(numbers), behind)
                }
                None => match rest.get(..4).filter(|word| word.eq_ignore_ascii_case("none")) {
                    Some(_) => (None, &rest[4..]),
                    None => return Err(self.not_valid(name)),
                },
            };
            vectors.push(vector);
            rest = behind.trim_start();
        }
        Ok(Some(vectors))
    }

    /// Stored numbers, in the header's words.
    pub(super) fn decode(&self) -> Result<Decode> {
        let value = self.get("type").ok_or_else(|| self.not_valid("type"))?;
        let name = value.to_lowercase().split_whitespace().collect::<Vec<_>>().join(" ");
        let Some((_, element)) = TYPES.iter().find(|(names, _)| names.contains(&&*name)) else {
            return Err(self.unsupported(format!("type {name}"), "integers of 8 to 64 bits, float and double are read"));
        };
        let endian = match self.get("endian").map(str::to_lowercase).as_deref() {
            Some("little") => Endian::Little,
            Some("big") => Endian::Big,
            None if element.bytes() == 1 => Endian::Little,
            _ => return Err(self.not_valid("endian")),
        };
        Ok(Decode { element: *element, endian, scale: None })
    }

    /// The files with the voxels of an array of these sizes.
    pub(super) fn data_files(&self, sizes: &[u32]) -> Result<DataFiles> {
        let encoding = self.get("encoding").ok_or_else(|| self.not_valid("encoding"))?;
        let coding = match &*encoding.to_lowercase() {
            "raw" => Coding::Plain,
            "gzip" | "gz" => Coding::Gzip,
            other => return Err(self.unsupported(format!("encoding {other}"), SAVE)),
        };
        let paths = self.paths(sizes)?;
        let is_attached = self.get("datafile").is_none();
        let bytes = match (is_attached, self.end) {
            (false, _) => 0,
            (true, Some(end)) => end,
            (true, None) => {
                return Err(
                    self.invalid("cut short: neither an empty line and voxels nor a 'data file' follow its header")
                );
            }
        };
        let lines = self.whole("lineskip")?.unwrap_or(0);
        let lines = u64::try_from(lines).map_err(|_| self.not_valid("lineskip"))?;
        let skip = self.whole("byteskip")?.unwrap_or(0);
        if skip < -1 || skip == -1 && coding != Coding::Plain {
            return Err(self.unsupported(format!("byte skip {skip} with encoding {encoding}"), SAVE));
        }
        let start = Start { bytes, lines, decoded: u64::try_from(skip).unwrap_or(0), is_last: skip == -1 };
        Ok(DataFiles { paths, coding, start })
    }

    fn paths(&self, sizes: &[u32]) -> Result<Vec<PathBuf>> {
        let Some(value) = self.get("datafile") else { return Ok(vec![self.path.clone()]) };
        let words: Vec<&str> = value.split_whitespace().collect();
        let names = match words[..] {
            [] => return Err(self.not_valid("datafile")),
            ["LIST", ref rest @ ..] => {
                self.check_count(self.listed.len(), rest, sizes)?;
                self.listed.clone()
            }
            [pattern, first, last, step, ref rest @ ..] if pattern.contains('%') => {
                let names = counted_names(pattern, [first, last, step]).ok_or_else(|| self.not_valid("datafile"))?;
                self.check_count(names.len(), rest, sizes)?;
                names
            }
            _ => vec![value.to_owned()],
        };
        Ok(names.iter().map(|name| beside(&self.path, name)).collect())
    }

    /// Checks the number of files, each with `subdim` of the array's axes: all but the slowest unless told otherwise.
    fn check_count(&self, found: usize, subdim: &[&str], sizes: &[u32]) -> Result<()> {
        let subdim = match subdim {
            [] => sizes.len() - 1,
            [one] => {
                one.parse().ok().filter(|n| (1..=sizes.len()).contains(n)).ok_or_else(|| self.not_valid("datafile"))?
            }
            _ => return Err(self.not_valid("datafile")),
        };
        let slower = sizes.get(subdim..).unwrap_or_default();
        let expected = slower.iter().fold(1u64, |n, size| n.saturating_mul((*size).into()));
        let slabs = sizes.last().is_some_and(|last| found > 0 && (*last as usize).is_multiple_of(found));
        if found as u64 == expected || slower.is_empty() && slabs {
            return Ok(());
        }
        Err(self.invalid(format!(
            "its header names {} of {} each, but sizes {sizes:?} need {expected}",
            counted(found as u64, "data file"),
            counted(subdim as u64, "axis")
        )))
    }
}
