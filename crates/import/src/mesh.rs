//! Readers of triangle meshes: STL, PLY, OBJ and glTF, by extension.
//!
//! A file is read whole and becomes one [`Mesh`] in the world: parts are joined, and polygons cut into triangles about their first
//! corner. Vertex colours are read (PLY, OBJ, glTF; in glTF times the material's), textures are not. Reading takes the memory of the
//! file and the mesh together.

mod gltf;
mod obj;
mod ply;
mod stl;

use crate::error::{ImportError, Result};
use brickyard_volume::mesh::PLAIN_COLOR;
use brickyard_volume::{Mesh, MeshError};
use std::path::Path;

/// Put before a text by some editors.
const BYTE_ORDER_MARK: &[u8] = "\u{feff}".as_bytes();

/// Reads the triangle mesh in an STL, PLY, OBJ or glTF file.
///
/// # Errors
/// If the file cannot be read, its extension is not a mesh format's, it is damaged or cut short, it has no triangle, a triangle
/// names a vertex that does not exist, or a vertex is not finite.
pub fn read_mesh(path: &Path) -> Result<Mesh, ImportError> {
    let extension = path.extension().unwrap_or_default().to_string_lossy().to_lowercase();
    let read: fn(&Path, Vec<u8>) -> Result<Parts> = match extension.as_str() {
        "stl" => stl::read,
        "ply" => ply::read,
        "obj" => obj::read,
        "gltf" | "glb" => gltf::read,
        _ => {
            let problem = format!("'.{extension}' is not a mesh format: expected .stl, .ply, .obj, .gltf or .glb");
            return Err(ImportError::invalid(path, problem));
        }
    };
    let mut bytes = read_file(path)?;
    if bytes.starts_with(BYTE_ORDER_MARK) {
        bytes.drain(..BYTE_ORDER_MARK.len());
    }
    read(path, bytes)?.mesh().map_err(|error| ImportError::invalid(path, error.to_string()))
}

/// Reads a regular file. Devices and pipes are refused: their end cannot be known beforehand.
fn read_file(path: &Path) -> Result<Vec<u8>> {
    if !std::fs::metadata(path).map_err(ImportError::io(path))?.is_file() {
        return Err(ImportError::invalid(path, "expected a regular file"));
    }
    std::fs::read(path).map_err(ImportError::io(path))
}

/// A reader's output. Normals and colours end with the last vertex that has one.
#[derive(Debug, Default)]
struct Parts {
    positions: Vec<[f32; 3]>,
    triangles: Vec<[u32; 3]>,
    normals: Vec<[f32; 3]>,
    colors: Vec<[u8; 3]>,
}

impl Parts {
    /// Appends a part whose triangles count from its own first vertex. If only other parts have normals or colours, its normals
    /// become those of its triangles, and its colour the default.
    fn join(&mut self, part: Parts) {
        let before = self.positions.len();
        let moved = |i: u32| u32::try_from(before).ok().and_then(|before| i.checked_add(before)).unwrap_or(u32::MAX);
        self.triangles.extend(part.triangles.into_iter().map(|corners| corners.map(moved)));
        self.positions.extend(part.positions);
        if !part.normals.is_empty() {
            self.normals.resize(before, [0.0; 3]);
            self.normals.extend(part.normals);
        }
        if !part.colors.is_empty() {
            self.colors.resize(before, plain());
            self.colors.extend(part.colors);
        }
    }

    fn polygon(&mut self, corners: &[u32]) {
        self.triangles.extend(corners.windows(2).skip(1).map(|pair| [corners[0], pair[0], pair[1]]));
    }

    fn mesh(mut self) -> Result<Mesh, MeshError> {
        let vertices = self.positions.len();
        if !self.normals.is_empty() {
            self.normals.resize(vertices, [0.0; 3]);
        }
        if !self.colors.is_empty() {
            self.colors.resize(vertices, plain());
        }
        Mesh::new(self.positions, self.triangles, self.normals, self.colors)
    }
}

fn plain() -> [u8; 3] {
    PLAIN_COLOR.map(code)
}

/// A colour component as a code.
fn code(component: f64) -> u8 {
    (component.clamp(0.0, 1.0) * 255.0).round() as u8
}

#[cfg(test)]
mod tests;
