//! Arrays listed in a VTK file, the choice of one by name, and the names of its components as channels.

use crate::element::Element;
use crate::error::{ImportError, Result};
use crate::note::Note;
use brickyard_volume::{ChannelLook, VoxelType, counted};
use std::path::Path;

/// Arrays named in messages; the others are counted.
const MOST_NAMED: usize = 40;
/// Marks of VTK for points and cells not to be shown.
const GHOSTS: &str = "vtkGhostType";

/// Whether values are at the grid's points or in its cells.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Of {
    Points,
    Cells,
}

impl Of {
    /// The XML format's word.
    fn name(self) -> &'static str {
        match self {
            Self::Points => "PointData",
            Self::Cells => "CellData",
        }
    }
}

/// Meaning of an array's components.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Role {
    Plain,
    /// The values shown unless others are asked for.
    Scalars,
    Colors,
    Tensors,
}

/// Where and how an array's numbers lie in its file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Place {
    /// As they are, from this byte on.
    Plain(u64),
    /// As words, from this byte on.
    Words { at: u64, style: Words },
    /// After a header of sizes, from this byte on.
    Headed { at: u64, coding: Coding },
}

/// Numbers in words.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Words {
    /// Up to a tag.
    Xml,
    /// With signed bytes also as unsigned ones, as VTK writes them.
    Legacy,
    /// Bytes as fractions of 255, as VTK writes scalars of unsigned bytes.
    Colors,
}

/// Coding of arrays behind headers of their sizes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Coding {
    pub(super) is_base64: bool,
    pub(super) is_big: bool,
    /// Bytes of a number of the header: 4 or 8.
    pub(super) size_bytes: usize,
    pub(super) compressor: Option<Compressor>,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Compressor {
    Zlib,
    Lz4,
}

/// An array's description.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Array {
    pub(super) name: String,
    pub(super) of: Of,
    pub(super) role: Role,
    /// The file's word for the type.
    pub(super) kind: String,
    /// `None` for types that are not read.
    pub(super) element: Option<Element>,
    pub(super) components: u32,
    /// Names of components, where the file has them.
    pub(super) component_names: Vec<Option<String>>,
    /// Why it cannot be read, if so.
    pub(super) place: Result<Place, String>,
}

impl Array {
    fn described(&self) -> String {
        let components = counted(self.components.into(), "component");
        format!("{}/{} ({}, {components})", self.of.name(), self.name, self.kind)
    }

    /// Looks of the channels: the file's names, or those of vectors and colours.
    pub(super) fn looks(&self) -> Vec<ChannelLook> {
        let look = |name: &str, color| ChannelLook { name: Some(name.into()), color, window: None, unit: None };
        let count = self.components as usize;
        if count > 1 && count == self.component_names.len() && self.component_names.iter().any(Option::is_some) {
            let named =
                |name: &Option<String>| ChannelLook { name: name.clone(), color: None, window: None, unit: None };
            return self.component_names.iter().map(named).collect();
        }
        let colors = [("red", [255, 0, 0]), ("green", [0, 255, 0]), ("blue", [0, 0, 255]), ("opacity", [0; 3])];
        // VTK itself shows 3 or 4 unsigned bytes as a colour.
        let is_color = self.role == Role::Colors
            || self.role == Role::Scalars && self.element == Some(Element::Voxel(VoxelType::U8));
        match count {
            3 | 4 if is_color => colors[..count].iter().map(|(name, color)| look(name, Some(*color))).collect(),
            3 => ["x", "y", "z"].map(|name| look(name, None)).to_vec(),
            6 if self.role == Role::Tensors => {
                ["xx", "yy", "zz", "xy", "yz", "xz"].map(|name| look(name, None)).to_vec()
            }
            9 if self.role == Role::Tensors => {
                ["xx", "xy", "xz", "yx", "yy", "yz", "zx", "zy", "zz"].map(|name| look(name, None)).to_vec()
            }
            _ => Vec::new(),
        }
    }
}

/// Chooses the array called `variable`, otherwise the scalars or the only one. Notes tell of others, and of ghosts.
pub(super) fn choose<'a>(arrays: &'a [Array], variable: Option<&str>, path: &Path) -> Result<(&'a Array, Vec<Note>)> {
    let (ghosts, shown): (Vec<&Array>, Vec<&Array>) = arrays.iter().partition(|array| array.name == GHOSTS);
    let Some(variable) = variable else {
        let mut notes = Vec::new();
        let chosen = match shown[..] {
            [] => return Err(ImportError::unsupported_but(path, "a grid without arrays", "write it with its values")),
            [one] => one,
            _ => {
                let scalars = shown.iter().find(|array| matches!(array.role, Role::Scalars | Role::Colors));
                let numbers: Vec<&Array> = shown.iter().copied().filter(|array| array.element.is_some()).collect();
                let others_than =
                    |one: &Array| list(&shown.iter().copied().filter(|array| *array != one).collect::<Vec<_>>());
                match (scalars, &numbers[..]) {
                    (Some(scalars), _) => {
                        let (scalars_are, others) = (scalars.described(), others_than(scalars));
                        notes.push(Note::new(format!(
                            "The file's scalars {scalars_are} are read; `variable` chooses another array: {others}."
                        )));
                        *scalars
                    }
                    (None, [one]) => {
                        let (array, others) = (one.described(), others_than(one));
                        notes.push(Note::new(format!(
                            "The array {array} is read, the only one of numbers; others: {others}."
                        )));
                        *one
                    }
                    (None, _) => {
                        let problem = format!(
                            "holds several arrays, and names none of them as its scalars: {}; choose one with `variable`",
                            list(&shown)
                        );
                        return Err(ImportError::options(path, problem));
                    }
                }
            }
        };
        if ghosts.iter().any(|array| array.of == chosen.of) {
            notes.push(Note::warning(format!(
                "{GHOSTS} marks points or cells to be hidden: they are read like others."
            )));
        }
        return Ok((chosen, notes));
    };
    let is_meant = |array: &&Array| {
        let path_of = variable.strip_prefix(array.of.name()).and_then(|rest| rest.strip_prefix('/'));
        array.name == variable || path_of == Some(&*array.name)
    };
    let meant: Vec<&Array> = arrays.iter().filter(is_meant).collect();
    match meant[..] {
        [one] => Ok((one, Vec::new())),
        [] => {
            let all: Vec<&Array> = arrays.iter().collect();
            let problem = format!("`variable` {variable}: no such array; it holds {}", list(&all));
            Err(ImportError::options(path, problem))
        }
        _ => {
            let problem =
                format!("`variable` {variable}: it holds several of this name: {}; name one whole", list(&meant));
            Err(ImportError::options(path, problem))
        }
    }
}

fn list(arrays: &[&Array]) -> String {
    let mut names: Vec<String> = arrays.iter().take(MOST_NAMED).map(|array| array.described()).collect();
    if arrays.len() > MOST_NAMED {
        names.push(format!("{} more", arrays.len() - MOST_NAMED));
    }
    if names.is_empty() { "none".into() } else { names.join(", ") }
}

/// A name without the percent codes of legacy files.
pub(super) fn decoded_name(name: &str) -> String {
    let (bytes, mut out, mut i) = (name.as_bytes(), Vec::new(), 0);
    while let Some(&byte) = bytes.get(i) {
        let code = name.get(i + 1..i + 3).filter(|_| byte == b'%').and_then(|hex| u8::from_str_radix(hex, 16).ok());
        out.push(code.unwrap_or(byte));
        i += if code.is_some() { 3 } else { 1 };
    }
    String::from_utf8_lossy(&out).into_owned()
}
