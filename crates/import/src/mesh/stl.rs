//! STL, binary or text. Vertices in the same place are merged; stored normals are dropped, being those of the
//! triangles anyway.

use super::Parts;
use crate::error::{ImportError, Result};
use std::io::Cursor;
use std::path::Path;

/// Bytes before the triangles, and of a triangle, in a binary file.
const HEADER: usize = 84;
const TRIANGLE: usize = 50;

pub(super) fn read(path: &Path, mut bytes: Vec<u8>) -> Result<Parts> {
    let is_text = bytes.starts_with(b"solid");
    match binary_len(&bytes) {
        // Many programs write binary files that begin like text: then only the size decides.
        Some(len) if len == bytes.len() as u64 => bytes[..5].fill(b' '),
        _ if is_text => {
            if bytes.get(5) != Some(&b' ') {
                // A solid without a name.
                bytes.insert(5, b' ');
            }
        }
        Some(len) if len < bytes.len() as u64 => {}
        Some(len) => {
            let (triangles, found) = ((len - HEADER as u64) / TRIANGLE as u64, bytes.len());
            let problem = format!("{triangles} triangles take {len} bytes, and the file has {found}: it is cut short");
            return Err(ImportError::invalid(path, problem));
        }
        None => {
            let problem = format!("{} bytes: expected an STL file, of at least {HEADER}", bytes.len());
            return Err(ImportError::invalid(path, problem));
        }
    }
    let found = stl_io::read_stl(&mut Cursor::new(bytes))
        .map_err(|error| ImportError::invalid(path, format!("expected an STL file: {error}")))?;
    // Indices past 2^32 become an invalid one: such a mesh is refused as too large.
    let index = |i: usize| u32::try_from(i).unwrap_or(u32::MAX);
    Ok(Parts {
        positions: found.vertices.iter().map(|vertex| vertex.0).collect(),
        triangles: found.faces.iter().map(|face| face.vertices.map(index)).collect(),
        ..Parts::default()
    })
}

/// Length of a binary file with this start.
fn binary_len(bytes: &[u8]) -> Option<u64> {
    let count = bytes.get(HEADER - 4..HEADER)?.try_into().ok().map(u32::from_le_bytes)?;
    Some(HEADER as u64 + count as u64 * TRIANGLE as u64)
}
