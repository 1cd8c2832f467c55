//! The files of an export: checked before, under temporary names in the same folder while they are written, and at their own names once complete.
//! Existing files are replaced only if the caller says so; folders and devices never are.

use crate::error::ExportError;
use crate::folder::{PREFIX, create_folder, keep_folder, remove_left};
use crate::format::Format;
use crate::metaimage::data_beside;
use crate::pvd::{folder_beside, is_step_of};
use crate::raw::text_beside;
use crate::vti::is_of_this_program;
use brickyard_import::unfinished::{OutputFolder, file_for};
use brickyard_store::check_outside;
use std::io::{Error, ErrorKind, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// A file or folder, and the text beside it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Target {
    pub(crate) data: PathBuf,
    /// Whether the data is a folder of files, which the text lists.
    is_series: bool,
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
        let plain = Self { data: output.into(), text: None, is_series: false };
        match format {
            Format::Raw => Self { text: Some(text_beside(output)), ..plain },
            // Without its last slash, by which a file would be no folder, and nothing there.
            Format::Png | Format::Zarr => Self { data: output.components().collect(), ..plain },
            Format::MetaHeader => Self { data: data_beside(output), text: Some(output.into()), ..plain },
            Format::Pvd => Self { data: folder_beside(output), text: Some(output.into()), is_series: true },
            _ => plain,
        }
    }

    /// Checks whether both may be written.
    ///
    /// # Errors
    /// If something is there and may not be replaced, or a place is inside a store.
    pub(crate) fn check(&self, overwrite: bool) -> Result<(), ExportError> {
        self.text.iter().try_for_each(|path| check(path, overwrite))?;
        if self.is_series {
            return self.check_series(overwrite);
        }
        check(&self.data, overwrite)?;
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
        let file = written(path, text)?;
        if overwrite {
            remove_old(path)?;
        }
        persist(data, &self.data, overwrite)?;
        persist(file, path, overwrite).inspect_err(|_| {
            // Half an output is none.
            let _ = std::fs::remove_file(&self.data);
        })
    }

    /// Checks whether the folder of a series may be written: nothing is there, or steps written by this program alone, to be replaced.
    fn check_series(&self, overwrite: bool) -> Result<(), ExportError> {
        check_outside(&self.data)?;
        let io = ExportError::io(&self.data);
        let Ok(found) = self.data.symlink_metadata() else { return Ok(()) };
        if !overwrite {
            return Err(ExportError::Exists { path: self.data.clone() });
        }
        if !found.is_dir() {
            return Err(io(Error::other("is not a folder of steps, and is never replaced")));
        }
        for entry in std::fs::read_dir(&self.data).map_err(&io)? {
            let entry = entry.map_err(&io)?;
            let is_named = entry.file_name().to_str().is_some_and(|name| is_step_of(&self.data, name));
            let is_file = entry.file_type().map_err(&io)?.is_file();
            if !(is_named && is_file && is_of_this_program(&entry.path()).map_err(&io)?) {
                let problem = "is no step of a series written by this program: its folder is never replaced; move it away, or \
                               choose another name";
                return Err(ExportError::unfit(&entry.path(), problem));
            }
        }
        Ok(())
    }

    /// Gives a complete folder of files and their text their names: the text last, and an old one goes first, as it would list other files.
    pub(crate) fn keep_series(&self, folder: OutputFolder, text: &[u8], overwrite: bool) -> Result<(), ExportError> {
        let Some(path) = &self.text else { return keep_folder(folder, &self.data) };
        let file = written(path, text)?;
        let mut old = None;
        if overwrite {
            // Seen again: others may have put files there.
            self.check_series(overwrite)?;
            remove_old(path)?;
            if self.data.symlink_metadata().is_ok() {
                let aside = create_folder(&self.data)?;
                std::fs::rename(&self.data, aside.path()).map_err(ExportError::io(&self.data))?;
                old = Some(aside.keep());
            }
        }
        keep_folder(folder, &self.data).inspect_err(|_| {
            let _ = old.as_ref().map(|old| std::fs::rename(old, &self.data));
        })?;
        old.iter().for_each(|old| remove_left(old));
        persist(file, path, overwrite).inspect_err(|_| {
            // Half an output is none.
            remove_left(&self.data);
        })
    }
}

/// Writes a text under a temporary name.
fn written(path: &Path, text: &[u8]) -> Result<NamedTempFile, ExportError> {
    let io = ExportError::io(path);
    let mut file = file_for(path, PREFIX).map_err(&io)?;
    file.write_all(text).and_then(|()| file.as_file().sync_all()).map_err(&io)?;
    Ok(file)
}

/// Deletes a text, if it is there.
fn remove_old(text: &Path) -> Result<(), ExportError> {
    match std::fs::remove_file(text) {
        Err(error) if error.kind() != ErrorKind::NotFound => Err(ExportError::io(text)(error)),
        _ => Ok(()),
    }
}

/// Checks whether a file, or a folder, may be written.
///
/// # Errors
/// If something is there and may not be replaced, or the place is inside a store.
pub(crate) fn check(path: &Path, overwrite: bool) -> Result<(), ExportError> {
    check_outside(path)?;
    match path.symlink_metadata() {
        Ok(_) if !overwrite => return Err(ExportError::Exists { path: path.into() }),
        // Too long a name, for one: better told before the work.
        Err(error) if error.kind() != ErrorKind::NotFound => return Err(ExportError::io(path)(error)),
        _ => {}
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
