//! Stand-ins for readers left out of this build: they recognise their files, and refuse them.

use crate::error::{ImportError, Result};
#[cfg(not(feature = "vtk"))]
use crate::format::Format;
use crate::options::OpenOptions;
#[cfg(not(feature = "vtk"))]
use crate::series::StepFile;
use crate::source::Source;
use std::path::{Path, PathBuf};

#[cfg(not(feature = "dicom"))]
pub(crate) mod dicom {
    use super::*;

    fn refuse(path: &Path) -> ImportError {
        ImportError::unsupported_but(path, "DICOM", "this program was built without the feature `dicom`")
    }

    pub(crate) fn open_file(path: &Path, _: &OpenOptions) -> Result<Box<dyn Source>> {
        Err(refuse(path))
    }

    pub(crate) fn series_of(_: &Path) -> Result<Option<String>> {
        Ok(None)
    }

    pub(crate) fn open_series(paths: &[PathBuf], _: bool, _: &OpenOptions) -> Result<Box<dyn Source>> {
        Err(refuse(paths.first().map_or(Path::new("input"), PathBuf::as_path)))
    }
}

#[cfg(not(feature = "npz"))]
pub(crate) mod npz {
    use super::*;
    use crate::raw::RawSource;

    pub(crate) fn is_npz(_: &Path, name: &str, _: &[u8]) -> Result<bool> {
        Ok(name.ends_with(".npz"))
    }

    pub(crate) fn open(path: &Path, _: &OpenOptions) -> Result<RawSource> {
        Err(ImportError::unsupported_but(path, ".npz", "this program was built without the feature `npz`"))
    }
}

#[cfg(not(feature = "hdf5"))]
pub(crate) mod hdf5 {
    use super::*;

    pub(crate) fn is_hdf5(path: &Path) -> Result<bool> {
        Ok(crate::files::first_bytes(path, 8)? == b"\x89HDF\r\n\x1a\n")
    }

    pub(crate) fn is_spim_data(_: &Path) -> Result<bool> {
        Ok(false)
    }

    pub(crate) fn open_spim_data(path: &Path, options: &OpenOptions) -> Result<Box<dyn Source>> {
        open(path, options)
    }

    pub(crate) fn open(path: &Path, _: &OpenOptions) -> Result<Box<dyn Source>> {
        Err(ImportError::unsupported_but(path, "HDF5", "this program was built without the feature `hdf5`"))
    }
}

#[cfg(not(feature = "tiff"))]
pub(crate) mod tiff_stack {
    use super::*;

    fn refuse(path: &Path) -> ImportError {
        ImportError::unsupported_but(path, "TIFF", "this program was built without the feature `tiff`")
    }

    pub(crate) fn has_several_planes(path: &Path, _: &OpenOptions) -> Result<bool> {
        Err(refuse(path))
    }

    pub(crate) fn is_whole_set(_: &[PathBuf]) -> Result<bool> {
        Ok(false)
    }

    pub(crate) fn is_companion(_: &Path) -> Result<bool> {
        Ok(false)
    }

    pub(crate) fn open_file(path: &Path, _: &OpenOptions, _: bool) -> Result<Box<dyn Source>> {
        Err(refuse(path))
    }

    pub(crate) fn open_planes(paths: &[PathBuf], _: &OpenOptions) -> Result<Box<dyn Source>> {
        Err(refuse(paths.first().map_or(Path::new("input"), PathBuf::as_path)))
    }
}

#[cfg(not(feature = "pictures"))]
pub(crate) mod pictures {
    use super::*;
    use crate::format::PictureKind;

    pub(crate) fn open(paths: &[PathBuf], _: PictureKind, _: &OpenOptions) -> Result<Box<dyn Source>> {
        let path = paths.first().map_or(Path::new("input"), PathBuf::as_path);
        let advice = "this program was built without the feature `pictures`";
        Err(ImportError::unsupported_but(path, "a picture", advice))
    }
}

#[cfg(not(feature = "vtk"))]
pub(crate) mod vtk {
    use super::*;

    fn refuse(path: &Path) -> ImportError {
        ImportError::unsupported_but(path, "VTK", "this program was built without the feature `vtk`")
    }

    pub(crate) fn format_of(path: &Path) -> Result<Option<Format>> {
        let start = crate::files::first_bytes(path, 14)?;
        let is_vtk = [&b"# vtk DataFile"[..], b"<VTKFile"].iter().any(|magic| start.starts_with(magic));
        Ok(is_vtk.then_some(Format::Vtk))
    }

    pub(crate) fn open(path: &Path, _: &OpenOptions) -> Result<Box<dyn Source>> {
        Err(refuse(path))
    }

    pub(crate) fn check(path: &Path, _: &OpenOptions) -> Result<StepFile> {
        Err(refuse(path))
    }

    pub(crate) fn open_collection(path: &Path, _: &OpenOptions) -> Result<Box<dyn Source>> {
        Err(refuse(path))
    }
}

#[cfg(not(feature = "zarr"))]
/// Stands in for the reader of Zarr.
pub mod zarr {
    use super::*;
    use crate::image::Image;
    use std::path::PathBuf;

    /// Documents that an opening of a folder looks at first: those of a store of brickyard's.
    pub fn first_documents() -> Vec<String> {
        ["zarr.json", "0/zarr.json"].map(String::from).into()
    }

    /// `None`: no folder counts as one of Zarr.
    pub fn zarr_folder(_: &Path) -> Option<PathBuf> {
        None
    }

    /// Refuses the image.
    ///
    /// # Errors
    /// Always.
    pub fn open_image(path: &Path) -> Result<Image> {
        Err(ImportError::unsupported_but(path, "Zarr", "this program was built without the feature `zarr`"))
    }

    /// An image or array to be chosen: none is listed.
    pub struct Choice {
        /// The path that names it.
        pub path: PathBuf,
        /// Its description.
        pub words: String,
    }

    /// Lists nothing.
    ///
    /// # Errors
    /// Never.
    pub fn choices(_: &Path) -> Result<Vec<Choice>> {
        Ok(Vec::new())
    }

    pub(crate) fn is_zarr(folder: &Path) -> bool {
        ["zarr.json", ".zgroup", ".zarray"].iter().any(|name| folder.join(name).is_file())
    }

    pub(crate) fn open(path: &Path, _: &OpenOptions) -> Result<Box<dyn Source>> {
        Err(ImportError::unsupported_but(path, "Zarr", "this program was built without the feature `zarr`"))
    }
}
