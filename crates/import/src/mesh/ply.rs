//! PLY, text or binary of either byte order: elements `vertex` and `face`; others are skipped.

use super::{Parts, code};
use crate::error::{ImportError, Result};
use ply_rs_bw::parser::{ParseError, Parser, Reader};
use ply_rs_bw::ply::{ElementDef, Header, PropertyAccess, PropertyAccessResult};
use std::io::Cursor;
use std::path::Path;

pub(super) fn read(path: &Path, bytes: Vec<u8>) -> Result<Parts> {
    let bad = |error: ParseError| {
        // The library shows the whole line, which may be the whole file.
        let text: String = error.to_string().split('\n').next().unwrap_or_default().chars().take(200).collect();
        ImportError::invalid(path, format!("expected a PLY file: {text}"))
    };
    let mut reader = Reader::new(Cursor::new(bytes));
    let header = Parser::<Skipped>::new().read_header(&mut reader).map_err(bad)?;
    let mut parts = Parts::default();
    for element in header.elements.values() {
        if element.properties.is_empty() && element.count > 0 {
            // A file of no size could declare any number of these.
            return Err(ImportError::invalid(path, format!("its elements '{}' have no properties", element.name)));
        }
        match element.name.as_str() {
            "vertex" => vertices(&mut reader, &header, element, &mut parts).map_err(bad)?,
            "face" => {
                for face in elements::<Face>(&mut reader, &header, element).map_err(bad)? {
                    if face.is_bad {
                        let problem = "a face names a vertex below 0";
                        return Err(ImportError::invalid(path, problem));
                    }
                    parts.polygon(&face.corners);
                }
            }
            _ => drop(elements::<Skipped>(&mut reader, &header, element).map_err(bad)?),
        }
    }
    for (name, properties) in [("vertex", &["x", "y", "z"][..]), ("face", &[])] {
        let Some(element) = header.elements.get(name) else {
            let problem = format!("the file has no element '{name}': expected vertices and faces");
            return Err(ImportError::invalid(path, problem));
        };
        if let Some(missing) = properties.iter().find(|&&p| !element.properties.contains_key(p)) {
            return Err(ImportError::invalid(path, format!("its vertices have no property '{missing}'")));
        }
    }
    Ok(parts)
}

fn elements<E: PropertyAccess>(
    reader: &mut Reader<Cursor<Vec<u8>>>,
    header: &Header,
    element: &ElementDef,
) -> Result<Vec<E>, ParseError> {
    Parser::<E>::new().read_payload_for_element(reader, element, header)
}

fn vertices(
    reader: &mut Reader<Cursor<Vec<u8>>>,
    header: &Header,
    element: &ElementDef,
    parts: &mut Parts,
) -> Result<(), ParseError> {
    let all = elements::<Vertex>(reader, header, element)?;
    let has = |names: [&str; 3]| names.iter().all(|&name| element.properties.contains_key(name));
    let singles = |v: [f64; 3]| v.map(|x| x as f32);
    parts.positions = all.iter().map(|vertex| singles(vertex.position)).collect();
    if has(["nx", "ny", "nz"]) {
        parts.normals = all.iter().map(|vertex| singles(vertex.normal)).collect();
    }
    if has(["red", "green", "blue"]) {
        parts.colors = all.iter().map(|vertex| vertex.color.map(code)).collect();
    }
    Ok(())
}

struct Vertex {
    position: [f64; 3],
    normal: [f64; 3],
    color: [f64; 3],
}

impl Vertex {
    /// Sets a property. Integer colours are shares of their type's greatest value.
    fn set(&mut self, name: &str, value: f64, greatest: f64) -> PropertyAccessResult {
        let (part, axis) = match name {
            "x" => (&mut self.position, 0),
            "y" => (&mut self.position, 1),
            "z" => (&mut self.position, 2),
            "nx" => (&mut self.normal, 0),
            "ny" => (&mut self.normal, 1),
            "nz" => (&mut self.normal, 2),
            "red" => (&mut self.color, 0),
            "green" => (&mut self.color, 1),
            "blue" => (&mut self.color, 2),
            _ => return PropertyAccessResult::Ignored,
        };
        let is_color = matches!(name, "red" | "green" | "blue");
        part[axis] = if is_color { value / greatest } else { value };
        PropertyAccessResult::Set
    }
}

impl PropertyAccess for Vertex {
    fn new() -> Self {
        Self { position: [0.0; 3], normal: [0.0; 3], color: [0.0; 3] }
    }
    fn set_char(&mut self, name: &str, value: i8) -> PropertyAccessResult {
        self.set(name, value.into(), i8::MAX.into())
    }
    fn set_uchar(&mut self, name: &str, value: u8) -> PropertyAccessResult {
        self.set(name, value.into(), u8::MAX.into())
    }
    fn set_short(&mut self, name: &str, value: i16) -> PropertyAccessResult {
        self.set(name, value.into(), i16::MAX.into())
    }
    fn set_ushort(&mut self, name: &str, value: u16) -> PropertyAccessResult {
        self.set(name, value.into(), u16::MAX.into())
    }
    fn set_int(&mut self, name: &str, value: i32) -> PropertyAccessResult {
        self.set(name, value.into(), i32::MAX.into())
    }
    fn set_uint(&mut self, name: &str, value: u32) -> PropertyAccessResult {
        self.set(name, value.into(), u32::MAX.into())
    }
    fn set_float(&mut self, name: &str, value: f32) -> PropertyAccessResult {
        self.set(name, value.into(), 1.0)
    }
    fn set_double(&mut self, name: &str, value: f64) -> PropertyAccessResult {
        self.set(name, value, 1.0)
    }
}

struct Face {
    corners: Vec<u32>,
    is_bad: bool,
}

impl Face {
    fn set<T: TryInto<u32>>(&mut self, name: &str, values: Vec<T>) -> PropertyAccessResult {
        if !matches!(name, "vertex_indices" | "vertex_index") {
            return PropertyAccessResult::Ignored;
        }
        self.corners =
            values.into_iter().filter_map(|value| value.try_into().map_err(|_| self.is_bad = true).ok()).collect();
        PropertyAccessResult::Set
    }
}

impl PropertyAccess for Face {
    fn new() -> Self {
        Self { corners: Vec::new(), is_bad: false }
    }
    fn set_list_char(&mut self, name: &str, values: Vec<i8>) -> PropertyAccessResult {
        self.set(name, values)
    }
    fn set_list_uchar(&mut self, name: &str, values: Vec<u8>) -> PropertyAccessResult {
        self.set(name, values)
    }
    fn set_list_short(&mut self, name: &str, values: Vec<i16>) -> PropertyAccessResult {
        self.set(name, values)
    }
    fn set_list_ushort(&mut self, name: &str, values: Vec<u16>) -> PropertyAccessResult {
        self.set(name, values)
    }
    fn set_list_int(&mut self, name: &str, values: Vec<i32>) -> PropertyAccessResult {
        self.set(name, values)
    }
    fn set_list_uint(&mut self, name: &str, values: Vec<u32>) -> PropertyAccessResult {
        self.set(name, values)
    }
}

/// An ignored element.
struct Skipped;

impl PropertyAccess for Skipped {
    fn new() -> Self {
        Self
    }
}
