//! The header of a legacy VTK file of structured points (`.vtk`), versions 1 to 5: its grid, and all its arrays, found by
//! walking over their bytes or words to the file's end. So a wrong size of one is noticed before anything is read.

use super::arrays::{Array, Of, Place, Role, Words, decoded_name};
use super::grid::{Grid, Points, UPRIGHT_DIRECTION, sizes_of};
use super::tags::shown;
use crate::element::Element;
use crate::error::{ImportError, Result};
use brickyard_volume::VoxelType;
use std::fs::File;
use std::io::{BufRead, BufReader, Read};
use std::path::Path;

/// Start of every legacy file.
pub(super) const MAGIC: &[u8] = b"# vtk DataFile";

/// Most bytes of a line or word, and most arrays.
const LONGEST_LINE: usize = 4096;
const MOST_ARRAYS: usize = 65536;
const RESAMPLE: &str = "resample it to an image, as ParaView's filter Resample To Image does, and save it as .vti";

/// A file's header.
pub(super) struct Legacy {
    pub(super) grid: Grid,
    pub(super) arrays: Vec<Array>,
    /// The field `TimeValue` or `TIME`, of one value.
    pub(super) time: Option<Array>,
}

/// Reads a file's header.
pub(super) fn read(path: &Path) -> Result<Legacy> {
    let file = File::open(path).map_err(ImportError::io(path))?;
    let bytes = file.metadata().map_err(ImportError::io(path))?.len();
    let file = BufReader::with_capacity(1 << 16, file);
    let mut text = Text { file, at: 0, bytes, path };
    let is_binary = text.begin()?;
    let mut walk = Walk {
        text,
        is_binary,
        points: None,
        spacing: None,
        origin: [0.0; 3],
        of: None,
        arrays: Vec::new(),
        time: None,
    };
    while walk.section()? {}
    let points = walk.points.ok_or_else(|| walk.text.invalid("has no DIMENSIONS; write the file again"))?;
    let grid = Grid { points, spacing: walk.spacing, origin: walk.origin, direction: UPRIGHT_DIRECTION };
    Ok(Legacy { grid, arrays: walk.arrays, time: walk.time })
}

/// A file's text, and the place in it.
struct Text<'a> {
    file: BufReader<File>,
    at: u64,
    bytes: u64,
    path: &'a Path,
}

impl Text<'_> {
    fn invalid(&self, problem: impl Into<String>) -> ImportError {
        ImportError::invalid(self.path, problem)
    }

    fn cut_short(&self) -> ImportError {
        self.invalid("cut short: ends within its header; fetch the file again")
    }

    fn byte(&mut self) -> Result<Option<u8>> {
        let byte = self.file.fill_buf().map_err(ImportError::io(self.path))?.first().copied();
        if byte.is_some() {
            self.file.consume(1);
            self.at += 1;
        }
        Ok(byte)
    }

    /// The rest of the line, without its end.
    fn line(&mut self) -> Result<String> {
        let mut line = Vec::new();
        while let Some(byte) = self.byte()?.filter(|byte| *byte != b'\n') {
            line.push(byte);
            if line.len() > LONGEST_LINE {
                return Err(self.invalid(format!("a line of more than {LONGEST_LINE} bytes; write the file again")));
            }
        }
        Ok(String::from_utf8_lossy(&line).trim().to_owned())
    }

    /// The next word; `None` at the end. The whitespace after it is left.
    fn word(&mut self) -> Result<Option<String>> {
        let mut word = Vec::new();
        while let Some(byte) = self.file.fill_buf().map_err(ImportError::io(self.path))?.first().copied() {
            if byte.is_ascii_whitespace() && !word.is_empty() {
                break;
            }
            self.file.consume(1);
            self.at += 1;
            if !byte.is_ascii_whitespace() {
                word.push(byte);
            }
            if word.len() > LONGEST_LINE {
                return Err(self.invalid(format!("a word of more than {LONGEST_LINE} bytes; write the file again")));
            }
        }
        Ok((!word.is_empty()).then(|| String::from_utf8_lossy(&word).into_owned()))
    }

    fn need(&mut self) -> Result<String> {
        self.word()?.ok_or_else(|| self.cut_short())
    }

    fn number<T: std::str::FromStr>(&mut self, what: &str) -> Result<T> {
        let word = self.need()?;
        word.parse().map_err(|_| self.invalid(format!("{what} is '{}', expected a number", shown(&word))))
    }

    fn numbers<T: std::str::FromStr + Copy + Default, const N: usize>(&mut self, what: &str) -> Result<[T; N]> {
        let mut numbers = [T::default(); N];
        for number in &mut numbers {
            *number = self.number(what)?;
        }
        Ok(numbers)
    }

    fn skip_bytes(&mut self, count: u64, what: &str) -> Result<()> {
        let end = self.at.checked_add(count).filter(|end| *end <= self.bytes);
        let Some(end) = end else {
            let (at, found) = (self.at, self.bytes);
            return Err(self.invalid(format!(
                "cut short: the array {what} implies {count} bytes from byte {at}, expected {} bytes, found {found}",
                at.saturating_add(count)
            )));
        };
        let by = i64::try_from(count).map_err(|_| self.cut_short())?;
        self.file.seek_relative(by).map_err(ImportError::io(self.path))?;
        self.at = end;
        Ok(())
    }

    /// Passes over lines of any length.
    fn skip_lines(&mut self, count: u64, what: &str) -> Result<()> {
        for found in 0..count {
            let mut is_empty = true;
            loop {
                let buffer = self.file.fill_buf().map_err(ImportError::io(self.path))?;
                let end = buffer.iter().position(|byte| *byte == b'\n');
                let length = end.map_or(buffer.len(), |end| end + 1);
                self.file.consume(length);
                self.at += length as u64;
                is_empty &= length == 0;
                if end.is_some() || length == 0 {
                    break;
                }
            }
            if is_empty {
                return Err(self.invalid(format!("cut short: the array {what} implies {count} lines, found {found}")));
            }
        }
        Ok(())
    }

    /// Passes over texts behind their lengths, big-endian numbers of 1, 2, 4 or 8 bytes by their first two bits.
    fn skip_texts(&mut self, count: u64, what: &str) -> Result<()> {
        for _ in 0..count {
            let first = self.byte()?.ok_or_else(|| self.cut_short())?;
            let more = match first >> 6 {
                3 => 0,
                2 => 1,
                1 => 3,
                _ => 7,
            };
            let mut length = u64::from(first & 0x3f);
            for _ in 0..more {
                length = length << 8 | u64::from(self.byte()?.ok_or_else(|| self.cut_short())?);
            }
            self.skip_bytes(length, what)?;
        }
        Ok(())
    }

    fn skip_words(&mut self, count: u64, what: &str) -> Result<()> {
        for found in 0..count {
            if self.word()?.is_none() {
                return Err(self.invalid(format!("cut short: the array {what} implies {count} numbers, found {found}")));
            }
        }
        Ok(())
    }

    /// Reads the three lines before the data set. Returns whether it is binary.
    fn begin(&mut self) -> Result<bool> {
        let mut magic = [0; MAGIC.len()];
        let is_magic = self.file.read_exact(&mut magic).is_ok() && magic == *MAGIC;
        if !is_magic {
            return Err(self.invalid("not a VTK file: it starts neither with # vtk DataFile nor with <VTKFile>"));
        }
        self.at = MAGIC.len() as u64;
        let version = self.line()?;
        let number = version.strip_prefix("Version").map(str::trim).unwrap_or_default();
        if !matches!(number.split('.').next(), Some("1" | "2" | "3" | "4" | "5")) {
            let feature = format!("'{}' of legacy VTK files", shown(&version));
            return Err(ImportError::unsupported_but(self.path, feature, "versions 1 to 5 are read"));
        }
        self.line()?;
        match self.need()?.to_ascii_uppercase().as_str() {
            "BINARY" => Ok(true),
            "ASCII" => Ok(false),
            other => Err(self.invalid(format!("its third line is '{}', expected ASCII or BINARY", shown(other)))),
        }
    }
}

struct Walk<'a> {
    text: Text<'a>,
    is_binary: bool,
    points: Option<Points>,
    spacing: Option<[f64; 3]>,
    origin: [f64; 3],
    /// The kind of the arrays to come, and their number of values; `None` for fields of the file.
    of: Option<(Of, u64)>,
    arrays: Vec<Array>,
    time: Option<Array>,
}

impl Walk<'_> {
    /// Reads a keyword and all it rules; false at the file's end.
    fn section(&mut self) -> Result<bool> {
        let Some(word) = self.text.word()? else { return Ok(false) };
        match word.to_ascii_uppercase().as_str() {
            "DATASET" => self.dataset()?,
            "DIMENSIONS" => {
                let sizes: [i64; 3] = self.text.numbers("DIMENSIONS")?;
                let [x, y, z] = sizes.map(|size| size.saturating_sub(1));
                self.points = Some(Points([0, x, 0, y, 0, z]));
            }
            "EXTENT" => self.points = Some(Points(self.text.numbers("EXTENT")?)),
            "SPACING" | "ASPECT_RATIO" => self.spacing = Some(self.text.numbers("SPACING")?),
            "ORIGIN" => self.origin = self.text.numbers("ORIGIN")?,
            "POINT_DATA" => self.data(Of::Points)?,
            "CELL_DATA" => self.data(Of::Cells)?,
            "METADATA" => self.metadata()?,
            "FIELD" => self.field()?,
            "LOOKUP_TABLE" => self.lookup_table()?,
            "SCALARS" => self.scalars()?,
            "COLOR_SCALARS" => self.color_scalars()?,
            "VECTORS" | "NORMALS" => self.attribute(3, Role::Plain)?,
            "TENSORS" => self.attribute(9, Role::Tensors)?,
            "TENSORS6" => self.attribute(6, Role::Tensors)?,
            "GLOBAL_IDS" | "PEDIGREE_IDS" | "EDGE_FLAGS" => self.attribute(1, Role::Plain)?,
            "TEXTURE_COORDINATES" => self.texture_coordinates()?,
            word => {
                let (word, at) = (shown(word), self.text.at);
                let problem = format!(
                    "'{word}' before byte {at} is no keyword of structured points: the file is damaged, or a size \
                     before it is wrong (long is taken as 8 bytes)"
                );
                return Err(self.text.invalid(problem));
            }
        }
        Ok(true)
    }

    fn dataset(&mut self) -> Result<()> {
        let kind = self.text.need()?;
        if kind.eq_ignore_ascii_case("STRUCTURED_POINTS") {
            return Ok(());
        }
        let feature = format!("a VTK file of DATASET {}", shown(&kind));
        Err(ImportError::unsupported_but(self.text.path, feature, RESAMPLE))
    }

    fn data(&mut self, of: Of) -> Result<()> {
        let count: u64 = self.text.number("a number of values")?;
        let points = self.points.ok_or_else(|| self.text.invalid("has values before its DIMENSIONS"))?;
        let sizes = sizes_of(points.counts(self.text.path)?, of).map(u64::from);
        let expected = sizes.into_iter().try_fold(1, u64::checked_mul);
        if expected != Some(count) {
            let (name, [x, y, z]) = (if of == Of::Points { "POINT_DATA" } else { "CELL_DATA" }, sizes);
            return Err(self.text.invalid(format!("{name} {count}, but DIMENSIONS give {x} x {y} x {z}")));
        }
        self.of = Some((of, count));
        Ok(())
    }

    /// Reads lines up to an empty one, with names of the last array's components among them.
    fn metadata(&mut self) -> Result<()> {
        self.text.line()?;
        let (mut names, mut are_names) = (Vec::new(), false);
        loop {
            let line = self.text.line()?;
            if line.is_empty() {
                break;
            }
            if line == "COMPONENT_NAMES" {
                are_names = true;
            } else if line.starts_with("INFORMATION") || names.len() == MOST_ARRAYS {
                are_names = false;
            } else if are_names {
                names.push(Some(decoded_name(&line)));
            }
        }
        if let Some(array) = self.arrays.last_mut().filter(|array| array.components as usize == names.len()) {
            array.component_names = names;
        }
        Ok(())
    }

    /// Reads `SCALARS name type [components]`, and the lookup table's name on the next line.
    fn scalars(&mut self) -> Result<()> {
        let (name, line) = (self.text.need()?, self.text.line()?);
        let mut words = line.split_ascii_whitespace();
        let kind = words.next().unwrap_or_default().to_owned();
        let components = match words.next().map(str::parse) {
            None => 1,
            Some(Ok(components)) => components,
            Some(Err(_)) => return Err(self.text.invalid(format!("'SCALARS {name} {}' is no array", shown(&line)))),
        };
        let table = self.text.need()?;
        if !table.eq_ignore_ascii_case("LOOKUP_TABLE") {
            let problem = format!("'{}' after SCALARS {}, expected LOOKUP_TABLE", shown(&table), shown(&name));
            return Err(self.text.invalid(problem));
        }
        self.text.need()?;
        let role = if self.has_scalars() { Role::Plain } else { Role::Scalars };
        self.array(&name, &kind, components, role)
    }

    /// Whether the points, or the cells, have their scalars.
    fn has_scalars(&self) -> bool {
        let is_of = |array: &Array| self.of.is_some_and(|(of, _)| array.of == of);
        self.arrays.iter().any(|array| is_of(array) && matches!(array.role, Role::Scalars | Role::Colors))
    }

    fn color_scalars(&mut self) -> Result<()> {
        let (name, components) = (self.text.need()?, self.text.number("COLOR_SCALARS")?);
        self.array(&name, "unsigned_char", components, Role::Colors)
    }

    fn attribute(&mut self, components: u32, role: Role) -> Result<()> {
        let (name, kind) = (self.text.need()?, self.text.need()?);
        self.array(&name, &kind, components, role)
    }

    fn texture_coordinates(&mut self) -> Result<()> {
        let (name, components, kind) = (self.text.need()?, self.text.number("TEXTURE_COORDINATES")?, self.text.need()?);
        self.array(&name, &kind, components, Role::Plain)
    }

    fn lookup_table(&mut self) -> Result<()> {
        let (name, count): (String, u64) = (self.text.need()?, self.text.number("LOOKUP_TABLE")?);
        self.text.line()?;
        match self.is_binary {
            true => self.text.skip_bytes(count.saturating_mul(4), &name),
            false => self.text.skip_words(count.saturating_mul(4), &name),
        }
    }

    /// Reads `FIELD name count`, and its arrays.
    fn field(&mut self) -> Result<()> {
        self.text.need()?;
        let count: u64 = self.text.number("FIELD")?;
        for _ in 0..count {
            let mut name = self.text.need()?;
            if name.eq_ignore_ascii_case("METADATA") {
                self.metadata()?;
                name = self.text.need()?;
            }
            let (components, found): (u32, u64) = (self.text.number(&name)?, self.text.number(&name)?);
            let kind = self.text.need()?;
            match self.of {
                Some((_, expected)) if found == expected => self.array(&name, &kind, components, Role::Plain)?,
                Some((_, expected)) => {
                    let problem = format!("the array {} has {found} values, expected {expected}", shown(&name));
                    return Err(self.text.invalid(problem));
                }
                None => {
                    let array = self.walked(&name, &kind, components, Role::Plain, (Of::Points, found))?;
                    let is_time = matches!(&*array.name, "TimeValue" | "TIME") && (components, found) == (1, 1);
                    self.time = self.time.take().or(is_time.then_some(array));
                }
            }
        }
        Ok(())
    }

    /// Adds the array whose numbers start on the next line.
    fn array(&mut self, name: &str, kind: &str, components: u32, role: Role) -> Result<()> {
        let Some(of) = self.of else {
            return Err(self.text.invalid(format!("has the array {} before POINT_DATA", shown(name))));
        };
        let array = self.walked(name, kind, components, role, of)?;
        self.arrays.push(array);
        match self.arrays.len() > MOST_ARRAYS {
            true => Err(self.text.invalid(format!("more than {MOST_ARRAYS} arrays"))),
            false => Ok(()),
        }
    }

    /// Describes an array and passes over its numbers.
    fn walked(&mut self, name: &str, kind: &str, components: u32, role: Role, (of, count): (Of, u64)) -> Result<Array> {
        self.text.line()?;
        let at = self.text.at;
        let lower = kind.to_ascii_lowercase();
        let numbers = count.saturating_mul(components.into());
        let element = element_of(&lower);
        let style = if role == Role::Colors { Words::Colors } else { Words::Legacy };
        let place = if self.is_binary { Place::Plain(at) } else { Place::Words { at, style } };
        match (self.is_binary, &*lower, element) {
            (true, "string" | "utf8_string", _) => self.text.skip_texts(numbers, name)?,
            // A variant is a line also in binary files.
            (_, "string" | "utf8_string" | "variant", _) => self.text.skip_lines(numbers, name)?,
            (true, _, Some(element)) => {
                self.text.skip_bytes(numbers.saturating_mul(element.bytes() as u64), name)?;
            }
            (true, "bit", None) => self.text.skip_bytes(numbers.div_ceil(8), name)?,
            (false, _, _) => self.text.skip_words(numbers, name)?,
            (true, _, None) => {
                let (feature, name) = (format!("an array of {}", shown(kind)), shown(name));
                let advice = format!("write the file without the array {name}");
                return Err(ImportError::unsupported_but(self.text.path, feature, &advice));
            }
        }
        let (name, kind, component_names) = (decoded_name(name), kind.to_owned(), Vec::new());
        Ok(Array { name, of, role, kind, element, components, component_names, place: Ok(place) })
    }
}

/// The element of a legacy type; `None` for types that are not read.
fn element_of(kind: &str) -> Option<Element> {
    Some(match kind {
        "char" | "signed_char" => Element::Voxel(VoxelType::I8),
        "unsigned_char" => Element::Voxel(VoxelType::U8),
        "short" => Element::Voxel(VoxelType::I16),
        "unsigned_short" => Element::Voxel(VoxelType::U16),
        // Ids are written as 32 bits, whatever they are in memory.
        "int" | "vtkidtype" => Element::Voxel(VoxelType::I32),
        "unsigned_int" => Element::Voxel(VoxelType::U32),
        // As on Unix: with 4 bytes, as on Windows, no keyword would follow the array.
        "long" | "vtktypeint64" => Element::I64,
        "unsigned_long" | "vtktypeuint64" => Element::U64,
        "float" => Element::Voxel(VoxelType::F32),
        "double" => Element::F64,
        _ => return None,
    })
}
