//! A mesh file in any format, written in one pass: objects one after another, of each its vertices and triangles as they come.
//!
//! The file has a temporary name in its folder until complete; parts whose place is known late wait in nameless files beside it.

use crate::error::MeshError;
use brickyard_import::temporary::unnamed_in;
use brickyard_import::unfinished::file_for;
use glam::DVec3;
use std::fs::File;
use std::io::{self, BufWriter, Seek, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Bytes of a file's buffer.
pub(crate) const BUFFER_BYTES: usize = 1 << 20;

/// A triangle: its vertices' numbers in the object, and their places.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Triangle {
    pub(crate) vertices: [u64; 3],
    pub(crate) places: [DVec3; 3],
}

/// A file being written.
pub(crate) trait Format: Send {
    /// Begins an object with this name.
    ///
    /// # Errors
    /// If the file cannot be written.
    fn begin(&mut self, name: &str) -> Result<(), MeshError>;

    /// Adds the object's next vertex.
    ///
    /// # Errors
    /// If the file cannot be written, or the format holds no more.
    fn vertex(&mut self, place: DVec3) -> Result<(), MeshError>;

    /// Adds a triangle of vertices that the object has.
    ///
    /// # Errors
    /// If the file cannot be written, or the format holds no more.
    fn triangle(&mut self, triangle: &Triangle) -> Result<(), MeshError>;

    /// Ends the object.
    ///
    /// # Errors
    /// If the file cannot be written.
    fn end(&mut self) -> Result<(), MeshError>;

    /// Completes the file.
    ///
    /// # Errors
    /// If it cannot be written.
    fn finish(self: Box<Self>) -> Result<NamedTempFile, MeshError>;
}

/// Facts for the head of a file.
#[derive(Clone, Debug)]
pub(crate) struct Head {
    /// Lines about coordinates.
    pub(crate) remarks: Vec<String>,
    /// Whether 32 bits suffice for coordinates.
    pub(crate) is_single: bool,
}

/// The output's files and errors.
#[derive(Clone, Debug)]
pub(crate) struct Place {
    pub(crate) output: PathBuf,
}

impl Place {
    pub(crate) fn io(&self, error: io::Error) -> MeshError {
        MeshError::Io { path: self.output.clone(), error }
    }

    fn folder(&self) -> &Path {
        self.output.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."))
    }

    /// The file to become the output.
    ///
    /// # Errors
    /// If the system refuses it.
    pub(crate) fn file(&self) -> Result<BufWriter<NamedTempFile>, MeshError> {
        let file = file_for(&self.output, ".brickyard-mesh").map_err(|error| self.io(error))?;
        Ok(BufWriter::with_capacity(BUFFER_BYTES, file))
    }

    /// A file for what comes later in the output.
    ///
    /// # Errors
    /// If the system refuses it.
    pub(crate) fn scratch(&self) -> Result<Scratch, MeshError> {
        let file = unnamed_in(self.folder()).map_err(|error| self.io(error))?;
        Ok(Scratch { file: BufWriter::with_capacity(BUFFER_BYTES, file) })
    }

    /// Completes the file to become the output.
    ///
    /// # Errors
    /// If it cannot be written.
    pub(crate) fn finish(&self, file: BufWriter<NamedTempFile>) -> Result<NamedTempFile, MeshError> {
        file.into_inner().map_err(|error| self.io(error.into_error()))
    }
}

/// Bytes waiting for their place in the output.
pub(crate) struct Scratch {
    pub(crate) file: BufWriter<File>,
}

impl Scratch {
    /// Moves the bytes so far to another file.
    ///
    /// # Errors
    /// If one of both files fails.
    pub(crate) fn drain(&mut self, to: &mut impl Write) -> io::Result<()> {
        self.file.rewind()?;
        io::copy(self.file.get_mut(), to)?;
        self.file.rewind()?;
        self.file.get_ref().set_len(0)
    }
}
