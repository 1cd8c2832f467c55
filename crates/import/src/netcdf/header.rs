//! The header of a classic NetCDF file: dimensions, attributes, and variables with their places. Costs some hundred bytes per entry;
//! values of attributes stay in the file until they are asked for.

use crate::cf;
use crate::element::{Element, Endian};
use brickyard_volume::VoxelType;
use std::ops::Range;

/// Most bytes of a header.
const MOST_HEADER_BYTES: usize = 16 << 20;

/// Most numbers taken from an attribute.
const MOST_NUMBERS: usize = 1 << 16;

const DIMENSIONS: u32 = 10;
const VARIABLES: u32 = 11;
const ATTRIBUTES: u32 = 12;

/// A type of NetCDF's, by its number in the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    Text,
    Number(Element),
}

impl Kind {
    fn of(number: u32, is_cdf5: bool) -> Option<Self> {
        use VoxelType::*;
        Some(match number {
            1 => Self::Number(Element::Voxel(I8)),
            2 => Self::Text,
            3 => Self::Number(Element::Voxel(I16)),
            4 => Self::Number(Element::Voxel(I32)),
            5 => Self::Number(Element::Voxel(F32)),
            6 => Self::Number(Element::F64),
            7 if is_cdf5 => Self::Number(Element::Voxel(U8)),
            8 if is_cdf5 => Self::Number(Element::Voxel(U16)),
            9 if is_cdf5 => Self::Number(Element::Voxel(U32)),
            10 if is_cdf5 => Self::Number(Element::I64),
            11 if is_cdf5 => Self::Number(Element::U64),
            _ => return None,
        })
    }

    fn bytes(self) -> usize {
        match self {
            Self::Text => 1,
            Self::Number(element) => element.bytes(),
        }
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Text => "characters",
            Self::Number(element) => element.name(),
        }
    }
}

struct Dimension {
    name: String,
    /// Elements along it; `None` for the record dimension.
    size: Option<u64>,
}

/// An attribute, whose values lie in the file.
struct Attribute {
    name: String,
    kind: Kind,
    values: Range<usize>,
}

pub(super) struct Variable {
    pub(super) name: String,
    /// Numbers of its dimensions, slowest first.
    dims: Vec<usize>,
    pub(super) shape: Vec<u64>,
    pub(super) kind: Kind,
    /// Whether its slowest dimension counts records.
    pub(super) is_record: bool,
    /// Its first byte in the file.
    pub(super) begin: u64,
    /// Its bytes, or those of one record, without padding.
    pub(super) bytes: u64,
    attributes: Vec<Attribute>,
}

/// The header, and the file's bytes.
pub(super) struct Header<'a> {
    file: &'a [u8],
    dimensions: Vec<Dimension>,
    pub(super) variables: Vec<Variable>,
    /// Bytes from one record to the next.
    pub(super) record_bytes: u64,
    /// Bytes of the header itself.
    pub(super) bytes: u64,
    /// Whether the number of records was counted by the file's size.
    pub(super) is_streamed: bool,
}

/// Attributes with the file of their values.
pub(super) struct Told<'a> {
    file: &'a [u8],
    attributes: &'a [Attribute],
}

impl cf::Attributes for Told<'_> {
    fn has(&self, name: &str) -> bool {
        self.attributes.iter().any(|attribute| attribute.name == name)
    }

    fn text(&self, name: &str) -> Option<String> {
        let found = self.attributes.iter().find(|attribute| attribute.name == name && attribute.kind == Kind::Text)?;
        let text = String::from_utf8_lossy(self.file.get(found.values.clone())?);
        let text = text.trim_matches(|c: char| c == '\0' || c.is_whitespace());
        (!text.is_empty()).then(|| text.to_owned())
    }

    fn numbers(&self, name: &str) -> Option<Vec<f64>> {
        let found = self.attributes.iter().find(|attribute| attribute.name == name)?;
        let Kind::Number(element) = found.kind else { return None };
        let values = self.file.get(found.values.clone())?;
        let values = values.get(..values.len().min(MOST_NUMBERS * element.bytes()))?;
        Some(element.numbers(Endian::Big, values)).filter(|numbers| !numbers.is_empty())
    }
}

impl<'a> Header<'a> {
    /// Parses the header at the start of a file. The error says what is wrong with it.
    pub(super) fn parse(file: &'a [u8]) -> Result<Self, String> {
        let version = *file.get(3).ok_or_else(cut)?;
        let mut words = Words {
            bytes: file,
            at: 4,
            count_bytes: if version == 5 { 8 } else { 4 },
            place_bytes: if version == 1 { 4 } else { 8 },
            is_cdf5: version == 5,
        };
        let records = words.count()?;
        let is_streamed = records == if version == 5 { u64::MAX } else { u64::from(u32::MAX) };
        let dimensions = words.list(DIMENSIONS, Words::dimension)?;
        if dimensions.iter().filter(|dimension| dimension.size.is_none()).count() > 1 {
            return Err("damaged: it has two dimensions of records".into());
        }
        // Those of the whole file.
        words.list(ATTRIBUTES, Words::attribute)?;
        let mut variables = words.list(VARIABLES, |words| words.variable(&dimensions))?;
        let of_records: Vec<&Variable> = variables.iter().filter(|variable| variable.is_record).collect();
        let padded = |bytes: u64| bytes.checked_next_multiple_of(4);
        let record_bytes = match &of_records[..] {
            // A single variable of records is not padded.
            [only] => Some(only.bytes),
            several => several.iter().try_fold(0, |sum: u64, variable| sum.checked_add(padded(variable.bytes)?)),
        };
        let record_bytes = record_bytes.ok_or("damaged: a record has more than 2^64 bytes")?;
        let records = match of_records.iter().map(|variable| variable.begin).min() {
            Some(begin) if is_streamed && record_bytes > 0 => (file.len() as u64).saturating_sub(begin) / record_bytes,
            _ if is_streamed => 0,
            _ => records,
        };
        for variable in variables.iter_mut().filter(|variable| variable.is_record) {
            variable.shape[0] = records;
        }
        let bytes = words.at as u64;
        Ok(Self { file, dimensions, variables, record_bytes, bytes, is_streamed })
    }

    pub(super) fn attributes_of(&self, variable: &'a Variable) -> Told<'a> {
        Told { file: self.file, attributes: &variable.attributes }
    }

    /// Names of a variable's dimensions, slowest first.
    pub(super) fn dims_of(&self, variable: &Variable) -> impl Iterator<Item = &str> {
        variable.dims.iter().map(|number| &*self.dimensions[*number].name)
    }

    pub(super) fn variable(&self, name: &str) -> Option<&Variable> {
        self.variables.iter().find(|variable| variable.name == name)
    }

    /// The place after a variable's last byte; `None` beyond 2^64.
    pub(super) fn end_of(&self, variable: &Variable) -> Option<u64> {
        let last = match (variable.is_record, variable.shape.first()) {
            (true, Some(records)) => records.saturating_sub(1).checked_mul(self.record_bytes)?,
            _ => 0,
        };
        variable.begin.checked_add(last)?.checked_add(variable.bytes)
    }

    /// All numbers of a variable; `None` if it has none, more than `most`, or reaches beyond the file.
    pub(super) fn numbers_of(&self, variable: &Variable, most: u64) -> Option<Vec<f64>> {
        let Kind::Number(element) = variable.kind else { return None };
        let count = variable.shape.iter().try_fold(1u64, |n, size| n.checked_mul(*size))?;
        if count == 0 || count > most || self.end_of(variable)? > self.file.len() as u64 {
            return None;
        }
        let records = if variable.is_record { variable.shape[0] } else { 1 };
        let mut numbers = Vec::new();
        for record in 0..records {
            let start = usize::try_from(variable.begin + record * self.record_bytes).ok()?;
            let bytes = self.file.get(start..)?.get(..usize::try_from(variable.bytes).ok()?)?;
            numbers.extend(element.numbers(Endian::Big, bytes));
        }
        Some(numbers)
    }
}

fn cut() -> String {
    "cut short: ends within its header; fetch the file again".into()
}

/// The header's words in sequence, big endian.
struct Words<'a> {
    bytes: &'a [u8],
    at: usize,
    /// Bytes of a count, and of a variable's place.
    count_bytes: usize,
    place_bytes: usize,
    is_cdf5: bool,
}

impl<'a> Words<'a> {
    /// The next bytes, and padding to a multiple of four.
    fn take(&mut self, count: u64) -> Result<Range<usize>, String> {
        let padded = count.checked_next_multiple_of(4).and_then(|count| usize::try_from(count).ok());
        let end = padded.and_then(|padded| self.at.checked_add(padded)).ok_or_else(cut)?;
        if end > self.bytes.len() {
            return Err(cut());
        }
        if end > MOST_HEADER_BYTES {
            return Err(format!(
                "has a header of more than {} MiB, longer than any valid one",
                MOST_HEADER_BYTES >> 20
            ));
        }
        let range = self.at..self.at + count as usize;
        self.at = end;
        Ok(range)
    }

    fn number(&mut self, bytes: usize) -> Result<u64, String> {
        let range = self.take(bytes as u64)?;
        Ok(self.bytes[range].iter().fold(0, |number, byte| number << 8 | u64::from(*byte)))
    }

    fn word(&mut self) -> Result<u32, String> {
        Ok(self.number(4)? as u32)
    }

    fn count(&mut self) -> Result<u64, String> {
        self.number(self.count_bytes)
    }

    fn name(&mut self) -> Result<String, String> {
        let length = self.count()?;
        let range = self.take(length)?;
        Ok(String::from_utf8_lossy(&self.bytes[range]).into_owned())
    }

    fn kind(&mut self) -> Result<Kind, String> {
        let number = self.word()?;
        Kind::of(number, self.is_cdf5)
            .ok_or_else(|| format!("damaged: a type of number {number}; fetch the file again"))
    }

    /// Entries behind their tag and count.
    fn list<T>(&mut self, tag: u32, mut entry: impl FnMut(&mut Self) -> Result<T, String>) -> Result<Vec<T>, String> {
        let (found, count) = (self.word()?, self.count()?);
        if found != tag && (found, count) != (0, 0) {
            return Err(format!("damaged: a list starts with {found} in place of {tag}; fetch the file again"));
        }
        // Each entry has some bytes, so the file's end stops a count that is too large.
        let mut entries = Vec::new();
        for _ in 0..count {
            entries.push(entry(self)?);
        }
        Ok(entries)
    }

    fn dimension(&mut self) -> Result<Dimension, String> {
        let (name, size) = (self.name()?, self.count()?);
        Ok(Dimension { name, size: (size > 0).then_some(size) })
    }

    fn attribute(&mut self) -> Result<Attribute, String> {
        let (name, kind, count) = (self.name()?, self.kind()?, self.count()?);
        let values = self.take(count.checked_mul(kind.bytes() as u64).ok_or_else(cut)?)?;
        Ok(Attribute { name, kind, values })
    }

    fn variable(&mut self, dimensions: &[Dimension]) -> Result<Variable, String> {
        let (name, count) = (self.name()?, self.count()?);
        let (mut dims, mut shape, mut is_record) = (Vec::new(), Vec::new(), false);
        for place in 0..count {
            let number = self.count()?;
            let found = usize::try_from(number).ok().and_then(|number| Some((number, dimensions.get(number)?)));
            let (number, dimension) =
                found.ok_or_else(|| format!("damaged: {name} has dimension {number}, of {}", dimensions.len()))?;
            if dimension.size.is_none() && place > 0 {
                return Err(format!("damaged: {name} counts records along an inner dimension"));
            }
            is_record |= dimension.size.is_none();
            dims.push(number);
            shape.push(dimension.size.unwrap_or(0));
        }
        let attributes = self.list(ATTRIBUTES, Self::attribute)?;
        let kind = self.kind()?;
        // The size told here is wrong for large variables.
        self.count()?;
        let begin = self.number(self.place_bytes)?;
        let inner = shape.iter().skip(usize::from(is_record));
        let bytes = inner.clone().try_fold(kind.bytes() as u64, |n, size| n.checked_mul(*size));
        let bytes = bytes.ok_or_else(|| format!("damaged: {name} has more than 2^64 bytes"))?;
        Ok(Variable { name, dims, shape, kind, is_record, begin, bytes, attributes })
    }
}
