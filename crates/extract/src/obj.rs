//! Wavefront OBJ: text, an `o` line for each object. Coordinates have the digits that tell floats of 32 bits apart, or of 64 where these are too coarse.
//! An object's faces wait in a file of their own until its vertices are there.

use crate::error::MeshError;
use crate::format::{Format, Head, Place, Scratch, Triangle};
use glam::DVec3;
use std::io::{BufWriter, Write};
use std::path::Path;
use tempfile::NamedTempFile;

pub(crate) struct Obj {
    place: Place,
    is_single: bool,
    file: BufWriter<NamedTempFile>,
    faces: Scratch,
    /// Vertices of the objects before; the format numbers all of a file from 1.
    before: u64,
    vertices: u64,
}

impl Obj {
    pub(crate) fn begin(output: &Path, head: &Head) -> Result<Self, MeshError> {
        let place = Place { output: output.into() };
        let (mut file, faces) = (place.file()?, place.scratch()?);
        let mut lines = head.remarks.iter();
        let text = writeln!(file, "# brickyard").and_then(|()| lines.try_for_each(|line| writeln!(file, "# {line}")));
        text.map_err(|error| place.io(error))?;
        Ok(Self { place, is_single: head.is_single, file, faces, before: 0, vertices: 0 })
    }
}

impl Format for Obj {
    fn begin(&mut self, name: &str) -> Result<(), MeshError> {
        writeln!(self.file, "o {name}").map_err(|error| self.place.io(error))
    }

    fn vertex(&mut self, place: DVec3) -> Result<(), MeshError> {
        self.vertices += 1;
        let written = if self.is_single {
            let [x, y, z] = place.as_vec3().to_array();
            writeln!(self.file, "v {x} {y} {z}")
        } else {
            let [x, y, z] = place.to_array();
            writeln!(self.file, "v {x} {y} {z}")
        };
        written.map_err(|error| self.place.io(error))
    }

    fn triangle(&mut self, triangle: &Triangle) -> Result<(), MeshError> {
        let [a, b, c] = triangle.vertices.map(|vertex| self.before + vertex + 1);
        writeln!(self.faces.file, "f {a} {b} {c}").map_err(|error| self.place.io(error))
    }

    fn end(&mut self) -> Result<(), MeshError> {
        (self.before, self.vertices) = (self.before + self.vertices, 0);
        self.faces.drain(&mut self.file).map_err(|error| self.place.io(error))
    }

    fn finish(self: Box<Self>) -> Result<NamedTempFile, MeshError> {
        self.place.finish(self.file)
    }
}
