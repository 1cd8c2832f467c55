//! Binary STL: triangles by their corners. Costs 50 bytes a triangle.

use crate::error::MeshError;
use crate::format::{Format, Head, Place, Triangle};
use glam::{DVec3, Vec3};
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::Path;
use tempfile::NamedTempFile;

/// Bytes of the text at the start.
const TEXT_BYTES: usize = 80;

pub(crate) struct Stl {
    place: Place,
    file: BufWriter<NamedTempFile>,
    triangles: u32,
}

impl Stl {
    pub(crate) fn begin(output: &Path, head: &Head) -> Result<Self, MeshError> {
        let place = Place { output: output.into() };
        let mut file = place.file()?;
        // A text that begins with "solid" is taken for the format's other form.
        let mut text = format!("brickyard {}", head.remarks.join(" ")).into_bytes();
        text.resize(TEXT_BYTES, b' ');
        file.write_all(&text).and_then(|()| file.write_all(&[0; 4])).map_err(|error| place.io(error))?;
        Ok(Self { place, file, triangles: 0 })
    }
}

impl Format for Stl {
    fn begin(&mut self, _: &str) -> Result<(), MeshError> {
        Ok(())
    }

    fn vertex(&mut self, _: DVec3) -> Result<(), MeshError> {
        Ok(())
    }

    fn triangle(&mut self, triangle: &Triangle) -> Result<(), MeshError> {
        self.triangles = self.triangles.checked_add(1).ok_or_else(|| MeshError::TooLarge {
            path: self.place.output.clone(),
            limit: ".stl counts its triangles in 32 bits",
            advice: "Write .obj, or take a coarser level or a box",
        })?;
        let [a, b, c] = triangle.places;
        let normal = (b - a).cross(c - a).normalize_or_zero().as_vec3();
        let mut bytes = [0; 50];
        for (bytes, vector) in bytes.chunks_exact_mut(12).zip([normal, a.as_vec3(), b.as_vec3(), c.as_vec3()]) {
            bytes.copy_from_slice(&single(vector));
        }
        self.file.write_all(&bytes).map_err(|error| self.place.io(error))
    }

    fn end(&mut self) -> Result<(), MeshError> {
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<NamedTempFile, MeshError> {
        let count = self.triangles.to_le_bytes();
        let counted = self.file.seek(SeekFrom::Start(TEXT_BYTES as u64)).and_then(|_| self.file.write_all(&count));
        counted.map_err(|error| self.place.io(error))?;
        self.place.finish(self.file)
    }
}

/// A vector's little-endian bytes.
pub(crate) fn single(vector: Vec3) -> [u8; 12] {
    let mut bytes = [0; 12];
    for (bytes, part) in bytes.chunks_exact_mut(4).zip(vector.to_array()) {
        bytes.copy_from_slice(&part.to_le_bytes());
    }
    bytes
}
