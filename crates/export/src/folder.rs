//! The folder of an export under a temporary name, which a kill may leave, until it is complete.

use crate::error::ExportError;
use brickyard_import::unfinished::{OutputFolder, folder_for};
use brickyard_store::remove_unfinished;
use std::io::ErrorKind;
use std::path::Path;

/// Start of temporary names.
pub(crate) const PREFIX: &str = ".brickyard-export";

/// Creates a folder under a temporary name beside a path.
pub(crate) fn create_folder(path: &Path) -> Result<OutputFolder, ExportError> {
    folder_for(path, PREFIX, remove_left).map_err(ExportError::io(path))
}

/// Deletes the folder that a killed export left, but for anything that no export puts there.
pub(crate) fn remove_left(folder: &Path) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        match entry.file_type() {
            Ok(kind) if kind.is_dir() => remove_unfinished(&path),
            Ok(kind) if kind.is_file() && path.extension().is_some_and(|end| end == "png" || end == "vti") => {
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
