//! The header of an image in VTK's XML format (`.vti`): its grid, pieces and arrays, from the tags before the appended
//! data, which are no XML. Costs one pass over the text before them.

use super::arrays::{Array, Coding, Compressor, Of, Place, Role, Words};
use super::grid::{Grid, Points, UPRIGHT_DIRECTION};
use super::stream::element_of_xml;
use super::tags::{Failure, Kind, Tag, Tags, shown};
use crate::error::{ImportError, Result};
use std::fs::File;
use std::io::{BufRead, BufReader, Seek, SeekFrom};
use std::path::Path;

/// Most pieces of a grid; each is mapped by itself.
const MOST_PIECES: usize = 512;
/// Most whitespace before the `_` of appended data.
const LONGEST_GAP: u64 = 4096;

const RESAMPLE: &str = "resample it to an image, as ParaView's filter Resample To Image does, and save it as .vti";

/// A piece of the grid, with its arrays.
pub(super) struct Piece {
    pub(super) points: Points,
    pub(super) arrays: Vec<Array>,
}

/// An image's header.
pub(super) struct Image {
    pub(super) grid: Grid,
    pub(super) pieces: Vec<Piece>,
    pub(super) is_big: bool,
    /// The field `TimeValue`, ParaView's time of the file.
    pub(super) time: Option<Array>,
}

/// Where an array is to be found.
enum Found {
    Inline { at: u64, is_base64: bool },
    Appended(u64),
}

/// Everything said by the tags so far.
struct Reading {
    size_bytes: usize,
    is_big: bool,
    compressor: Result<Option<Compressor>, String>,
    grid: Option<Grid>,
    pieces: Vec<(Points, Vec<(Array, Found)>)>,
    time: Option<(Array, Found)>,
    section: Option<Section>,
}

/// Arrays of points or cells, and the names of their scalars and tensors; or fields.
enum Section {
    Data { of: Of, scalars: Option<String>, tensors: Option<String> },
    Fields,
}

/// Reads an image's header.
pub(super) fn read(path: &Path) -> Result<Image> {
    let mut file = BufReader::with_capacity(1 << 16, File::open(path).map_err(ImportError::io(path))?);
    let mut tags = Tags::new(&mut file);
    let mut next = || tags.next().map_err(|failure| failure.of(path));
    let cut = || ImportError::invalid(path, "cut short: ends within its header; fetch the file again");
    let root = next()?.filter(|tag| tag.name == "VTKFile" && tag.kind == Kind::Start);
    let root =
        root.ok_or_else(|| ImportError::invalid(path, "not a VTK XML file: it does not start with <VTKFile>"))?;
    let mut reading = begin(&root, path)?;
    let appended = loop {
        let tag = next()?.ok_or_else(cut)?;
        match (&*tag.name, tag.kind) {
            ("VTKFile", Kind::End) => break None,
            ("AppendedData", Kind::Start) => break Some(tag),
            _ => reading.take(&tag, path)?,
        }
    };
    let appended = match appended {
        Some(tag) => {
            Some((underscore(&mut file, tag.end, path)?, tag.attribute("encoding").unwrap_or("base64") == "base64"))
        }
        None => None,
    };
    reading.end(appended, path)
}

/// The place after the `_` before appended data.
fn underscore(file: &mut BufReader<File>, at: u64, path: &Path) -> Result<u64> {
    let io = |error| ImportError::io(path)(error);
    file.seek(SeekFrom::Start(at)).map_err(io)?;
    for place in at..at + LONGEST_GAP {
        match file.fill_buf().map_err(io)?.first() {
            Some(b'_') => return Ok(place + 1),
            Some(byte) if byte.is_ascii_whitespace() => file.consume(1),
            _ => break,
        }
    }
    Err(ImportError::invalid(path, "its appended data do not start with _; write the file again"))
}

fn begin(root: &Tag, path: &Path) -> Result<Reading> {
    let kind = root.attribute("type").unwrap_or_default();
    match kind {
        "ImageData" => {}
        "PImageData" => {
            let advice = "convert it to one .vti file, as ParaView does by Save Data";
            return Err(ImportError::unsupported_but(path, "PImageData (.pvti, pieces in files of their own)", advice));
        }
        kind => {
            return Err(ImportError::unsupported_but(path, format!("a VTK XML file of {}", shown(kind)), RESAMPLE));
        }
    }
    let version = root.attribute("version").unwrap_or("0.1");
    if !matches!(version.split('.').next(), Some("0" | "1" | "2")) {
        let feature = format!("version {} of VTK's XML files", shown(version));
        return Err(ImportError::unsupported_but(path, feature, "versions 0.1 to 2 are read"));
    }
    let size_bytes = match root.attribute("header_type") {
        None | Some("UInt32") => 4,
        Some("UInt64") => 8,
        Some(other) => return Err(ImportError::unsupported(path, format!("header_type {}", shown(other)))),
    };
    let is_big = match root.attribute("byte_order") {
        Some("LittleEndian") => false,
        Some("BigEndian") => true,
        other => {
            let problem = format!("byte_order is {other:?}, expected LittleEndian or BigEndian");
            return Err(ImportError::invalid(path, problem));
        }
    };
    let compressor = match root.attribute("compressor") {
        None | Some("") => Ok(None),
        Some("vtkZLibDataCompressor") => Ok(Some(Compressor::Zlib)),
        Some("vtkLZ4DataCompressor") => Ok(Some(Compressor::Lz4)),
        // Arrays in words are read nevertheless.
        Some(other) => Err(format!("the compressor {}", shown(other))),
    };
    Ok(Reading { size_bytes, is_big, compressor, grid: None, pieces: Vec::new(), time: None, section: None })
}

impl Reading {
    fn take(&mut self, tag: &Tag, path: &Path) -> Result<()> {
        self.understand(tag).map_err(|failure| failure.of(path))?;
        match self.pieces.len() > MOST_PIECES {
            true => {
                Err(ImportError::unsupported_but(path, format!("more than {MOST_PIECES} pieces"), "write it whole"))
            }
            false => Ok(()),
        }
    }

    fn understand(&mut self, tag: &Tag) -> Result<(), Failure> {
        let of = if tag.name == "PointData" { Of::Points } else { Of::Cells };
        match (&*tag.name, tag.kind) {
            ("PointData" | "CellData" | "FieldData", Kind::End) => self.section = None,
            (_, Kind::End) => {}
            ("ImageData", _) => {
                self.grid = Some(Grid {
                    points: Points(required(tag, "WholeExtent")?),
                    spacing: tag.numbers("Spacing")?,
                    origin: tag.numbers("Origin")?.unwrap_or_default(),
                    direction: tag.numbers("Direction")?.unwrap_or(UPRIGHT_DIRECTION),
                });
            }
            ("Piece", _) => self.pieces.push((Points(required(tag, "Extent")?), Vec::new())),
            ("PointData" | "CellData", Kind::Start) => {
                let [scalars, tensors] = ["Scalars", "Tensors"].map(|name| tag.attribute(name).map(str::to_owned));
                self.section = Some(Section::Data { of, scalars, tensors });
            }
            ("FieldData", Kind::Start) => self.section = Some(Section::Fields),
            ("DataArray" | "Array", _) => self.array(tag)?,
            _ => {}
        }
        Ok(())
    }

    fn array(&mut self, tag: &Tag) -> Result<(), Failure> {
        let found = match tag.attribute("format") {
            Some("appended") => {
                let offset = tag.number("offset")?;
                Found::Appended(offset.ok_or_else(|| Failure::Meaning("an appended array has no offset".into()))?)
            }
            Some("ascii") | None => Found::Inline { at: tag.end, is_base64: false },
            Some("binary") => Found::Inline { at: tag.end, is_base64: true },
            Some(other) => return Err(Failure::Meaning(format!("an array has the unknown format '{}'", shown(other)))),
        };
        let name = tag.attribute("Name").unwrap_or("(no name)").to_owned();
        let (of, role) = match &self.section {
            Some(Section::Data { of, scalars, tensors }) => {
                let is = |role: &Option<String>| role.as_ref() == Some(&name);
                (
                    *of,
                    if is(scalars) {
                        Role::Scalars
                    } else if is(tensors) {
                        Role::Tensors
                    } else {
                        Role::Plain
                    },
                )
            }
            Some(Section::Fields) if name == "TimeValue" => (Of::Points, Role::Plain),
            _ => return Ok(()),
        };
        let kind = tag.attribute("type").unwrap_or_default().to_owned();
        let components = tag.number("NumberOfComponents")?.unwrap_or(1);
        if components == 0 {
            return Err(Failure::Meaning(format!("the array {} has no components", shown(&name))));
        }
        let component_name = |i: u32| tag.attribute(&format!("ComponentName{i}")).map(str::to_owned);
        // A tag has room for no more names.
        let component_names =
            if components <= 4096 { (0..components).map(component_name).collect() } else { Vec::new() };
        let element = element_of_xml(&kind);
        let place = Ok(Place::Plain(0));
        let array = Array { name, of, role, kind, element, components, component_names, place };
        match (&self.section, self.pieces.last_mut()) {
            (Some(Section::Fields), _) => self.time = Some((array, found)),
            (_, Some((_, arrays))) => arrays.push((array, found)),
            _ => {}
        }
        Ok(())
    }

    /// Completes the header with the place and coding of appended data.
    fn end(self, appended: Option<(u64, bool)>, path: &Path) -> Result<Image> {
        let Self { size_bytes, is_big, compressor, grid, pieces, time, .. } = self;
        let grid = grid.ok_or_else(|| ImportError::invalid(path, "has no <ImageData>; write the file again"))?;
        let headed = |at: u64, is_base64: bool| {
            let compressor = compressor.clone()?;
            Ok(Place::Headed { at, coding: Coding { is_base64, is_big, size_bytes, compressor } })
        };
        let placed = |(array, found): (Array, Found)| {
            let place = match found {
                Found::Inline { at, is_base64: true } => headed(at, true),
                Found::Inline { at, .. } => Ok(Place::Words { at, style: Words::Xml }),
                Found::Appended(offset) => match appended {
                    Some((start, is_base64)) => headed(start.saturating_add(offset), is_base64),
                    None => Err("an array whose appended data are missing".into()),
                },
            };
            Array { place, ..array }
        };
        let piece =
            |(points, arrays): (Points, Vec<_>)| Piece { points, arrays: arrays.into_iter().map(placed).collect() };
        Ok(Image { grid, pieces: pieces.into_iter().map(piece).collect(), is_big, time: time.map(placed) })
    }
}

fn required(tag: &Tag, name: &str) -> Result<[i64; 6], Failure> {
    tag.numbers(name)?.ok_or_else(|| Failure::Meaning(format!("<{}> has no {name}", shown(&tag.name))))
}
