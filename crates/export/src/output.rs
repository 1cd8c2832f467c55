//! The files of an export: checked before, under temporary names in the same folder while they are written, and at their own names once complete.
//! Existing files are replaced only if the caller says so; folders and devices never are.

use crate::error::ExportError;
use crate::format::Format;
use crate::metaimage::data_beside;
use crate::raw::text_beside;
use brickyard_import::unfinished::{OutputFolder, file_for, folder_for};
use brickyard_store::{check_outside, remove_unfinished};
use std::io::{Error, ErrorKind, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// Start of temporary names.
const PREFIX: &str = ".brickyard-export";

/// A file, and the text beside it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Target {
    pub(crate) data: PathBuf,
    pub(crate) text: Option<PathBuf>,
}

/// The files, or the folder, of an export to this name; `None` if the name has no format.
pub fn paths_of(output: &Path) -> Option<Vec<PathBuf>> {
    let target = Target::of(Format::of(output)?, output);
    Some([target.data].into_iter().chain(target.text).collect())
}

impl Target {
    /// The files of an output.
    pub(crate) fn of(format: Format, output: &Path) -> Self {
        match format {
            Format::Raw => Self { data: output.into(), text: Some(text_beside(output)) },
            // Without its last slash, by which a file would be no folder, and nothing there.
            Format::Png | Format::Zarr => Self { data: output.components().collect(), text: None },
            Format::MetaHeader => Self { data: data_beside(output), text: Some(output.into()) },
            _ => Self { data: output.into(), text: None },
        }
    }

    /// Checks whether both may be written.
    ///
    /// # Errors
    /// If something is there and may not be replaced, or a place is inside a store.
    pub(crate) fn check(&self, overwrite: bool) -> Result<(), ExportError> {
        [&self.data].into_iter().chain(&self.text).try_for_each(|path| check(path, overwrite))?;
        // A header's file of voxels would also be described by a text that is there for another one.
        let foreign = text_beside(&self.data);
        if self.text.as_ref().is_some_and(|own| *own != foreign) && foreign.symlink_metadata().is_ok() {
            let problem =
                format!("describes other voxels of {}: choose another name, or remove it", self.data.display());
            return Err(ExportError::unfit(&foreign, problem));
        }
        Ok(())
    }

    /// Creates the data's file under a temporary name.
    pub(crate) fn create(&self) -> Result<NamedTempFile, ExportError> {
        file_for(&self.data, PREFIX).map_err(ExportError::io(&self.data))
    }

    /// Gives the complete files their names: the text last, and an old one goes first, as it would describe other voxels.
    pub(crate) fn keep(&self, data: NamedTempFile, text: Option<&[u8]>, overwrite: bool) -> Result<(), ExportError> {
        data.as_file().sync_all().map_err(ExportError::io(&self.data))?;
        let Some((path, text)) = self.text.as_ref().zip(text) else { return persist(data, &self.data, overwrite) };
        let io = ExportError::io(path);
        let mut file = file_for(path, PREFIX).map_err(&io)?;
        file.write_all(text).and_then(|()| file.as_file().sync_all()).map_err(&io)?;
        if overwrite {
            match std::fs::remove_file(path) {
                Err(error) if error.kind() != ErrorKind::NotFound => return Err(io(error)),
                _ => {}
            }
        }
        persist(data, &self.data, overwrite)?;
        persist(file, path, overwrite).inspect_err(|_| {
            // Half an output is none.
            let _ = std::fs::remove_file(&self.data);
        })
    }
}

/// Checks whether a file, or a folder, may be written.
///
/// # Errors
/// If something is there and may not be replaced, or the place is inside a store.
pub(crate) fn check(path: &Path, overwrite: bool) -> Result<(), ExportError> {
    check_outside(path)?;
    if !overwrite && path.symlink_metadata().is_ok() {
        return Err(ExportError::Exists { path: path.into() });
    }
    if std::fs::metadata(path).is_ok_and(|found| !found.is_file()) {
        return Err(ExportError::io(path)(Error::other("is not a regular file, and is never replaced")));
    }
    Ok(())
}

fn persist(file: NamedTempFile, path: &Path, overwrite: bool) -> Result<(), ExportError> {
    let persisted = if overwrite { file.persist(path) } else { file.persist_noclobber(path) };
    match persisted {
        Ok(_) => Ok(()),
        Err(error) if error.error.kind() == ErrorKind::AlreadyExists => Err(ExportError::Exists { path: path.into() }),
        Err(error) => Err(ExportError::io(path)(error.error)),
    }
}

/// Creates a folder under a temporary name beside a path.
pub(crate) fn create_folder(path: &Path) -> Result<OutputFolder, ExportError> {
    folder_for(path, PREFIX, remove_left).map_err(ExportError::io(path))
}

/// Deletes the folder that a killed export left, but for anything that no export puts there.
fn remove_left(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        match entry.file_type() {
            Ok(kind) if kind.is_dir() => remove_unfinished(&path),
            Ok(kind) if kind.is_file() && path.extension().is_some_and(|end| end == "png") => {
                let _ = std::fs::remove_file(&path);
            }
            _ => {}
        }
    }
    let _ = std::fs::remove_dir(folder);
}

/// Gives a complete folder its name. Another folder is never replaced, unless it is empty.
pub(crate) fn keep_folder(folder: OutputFolder, path: &Path) -> Result<(), ExportError> {
    match std::fs::rename(folder.path(), path) {
        Ok(()) => {
            // It has another name, so there is nothing to delete.
            let _ = folder.keep();
            Ok(())
        }
        Err(error) if matches!(error.kind(), ErrorKind::DirectoryNotEmpty | ErrorKind::NotADirectory) => {
            Err(ExportError::Exists { path: path.into() })
        }
        Err(error) => Err(ExportError::io(path)(error)),
    }
}
