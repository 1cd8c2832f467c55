//! Binary little-endian PLY, with coordinates of 32 bits, or of 64 where these are too coarse. Costs 12 or 24 bytes a vertex and 13 a triangle, which wait
//! in a file of their own until all vertices are there.

use crate::error::MeshError;
use crate::format::{Format, Head, Place, Scratch, Triangle};
use crate::stl::single;
use glam::DVec3;
use std::io::{BufWriter, Seek, SeekFrom, Write};
use std::path::Path;
use tempfile::NamedTempFile;

pub(crate) struct Ply {
    place: Place,
    head: Head,
    file: BufWriter<NamedTempFile>,
    faces: Scratch,
    vertices: u64,
    triangles: u64,
}

/// Most decimal digits of a count.
const COUNT_DIGITS: usize = 20;

impl Ply {
    pub(crate) fn begin(output: &Path, head: &Head) -> Result<Self, MeshError> {
        let place = Place { output: output.into() };
        let (mut file, faces) = (place.file()?, place.scratch()?);
        // Counts are not known yet: the header's length is, since a comment takes up the room left by them.
        let text = header(head, 0, 0);
        file.write_all(text.as_bytes()).map_err(|error| place.io(error))?;
        Ok(Self { place, head: head.clone(), file, faces, vertices: 0, triangles: 0 })
    }
}

fn header(head: &Head, vertices: u64, triangles: u64) -> String {
    let kind = if head.is_single { "float" } else { "double" };
    let remarks: String = head.remarks.iter().map(|remark| format!("comment {remark}\n")).collect();
    let room = " ".repeat(2 * COUNT_DIGITS - vertices.to_string().len() - triangles.to_string().len());
    format!(
        "ply\nformat binary_little_endian 1.0\ncomment brickyard{room}\n{remarks}element vertex {vertices}\n\
         property {kind} x\nproperty {kind} y\nproperty {kind} z\nelement face {triangles}\n\
         property list uchar int vertex_indices\nend_header\n"
    )
}

impl Format for Ply {
    fn begin(&mut self, _: &str) -> Result<(), MeshError> {
        Ok(())
    }

    fn vertex(&mut self, place: DVec3) -> Result<(), MeshError> {
        self.vertices += 1;
        let written = match self.head.is_single {
            true => self.file.write_all(&single(place.as_vec3())),
            false => place.to_array().iter().try_for_each(|part| self.file.write_all(&part.to_le_bytes())),
        };
        written.map_err(|error| self.place.io(error))
    }

    fn triangle(&mut self, triangle: &Triangle) -> Result<(), MeshError> {
        self.triangles += 1;
        let mut bytes = [3; 13];
        for (bytes, vertex) in bytes[1..].chunks_exact_mut(4).zip(triangle.vertices) {
            let vertex = i32::try_from(vertex).map_err(|_| MeshError::TooLarge {
                path: self.place.output.clone(),
                limit: ".ply numbers its vertices in 32 bits with a sign",
                advice: "Write .obj, or take a coarser level or a box",
            })?;
            bytes.copy_from_slice(&vertex.to_le_bytes());
        }
        self.faces.file.write_all(&bytes).map_err(|error| self.place.io(error))
    }

    fn end(&mut self) -> Result<(), MeshError> {
        Ok(())
    }

    fn finish(mut self: Box<Self>) -> Result<NamedTempFile, MeshError> {
        let text = header(&self.head, self.vertices, self.triangles);
        let joined = self.faces.drain(&mut self.file);
        let headed = joined.and_then(|()| self.file.seek(SeekFrom::Start(0)));
        headed.and_then(|_| self.file.write_all(text.as_bytes())).map_err(|error| self.place.io(error))?;
        self.place.finish(self.file)
    }
}
