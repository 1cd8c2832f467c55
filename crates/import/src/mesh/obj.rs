//! Wavefront OBJ: all objects and groups of a file together. Colours are the vertices'; materials, in other files, are not read.

use super::{Parts, code};
use crate::error::{ImportError, Result};
use std::io::Cursor;
use std::path::Path;

pub(super) fn read(path: &Path, bytes: Vec<u8>) -> Result<Parts> {
    let options = tobj::LoadOptions { triangulate: true, single_index: true, ignore_points: true, ignore_lines: true };
    let no_materials = |_: &Path| Ok(Default::default());
    let (models, _) = tobj::load_obj_buf(&mut Cursor::new(bytes), &options, no_materials)
        .map_err(|error| ImportError::invalid(path, format!("expected an OBJ file: {error}")))?;
    let mut parts = Parts::default();
    for tobj::Model { mesh, .. } in models {
        let vectors = |all: &[f32]| -> Vec<[f32; 3]> { all.chunks_exact(3).map(|v| [v[0], v[1], v[2]]).collect() };
        let colors = vectors(&mesh.vertex_color).into_iter();
        parts.join(Parts {
            positions: vectors(&mesh.positions),
            triangles: mesh.indices.chunks_exact(3).map(|corners| [corners[0], corners[1], corners[2]]).collect(),
            normals: vectors(&mesh.normals),
            colors: colors.map(|color| color.map(|c| code(c.into()))).collect(),
        });
    }
    Ok(parts)
}
