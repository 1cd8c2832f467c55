//! The open folder of a store: files are opened by their names inside of it, through one descriptor, so that all of them are of one store,
//! whatever comes to stand under its path meanwhile. Costs a descriptor for each open store.

use crate::data_file::{open_at, read_at_most};
use crate::error::{OpenError, ReadError};
use rustix::fs::{CWD, Mode, OFlags, openat};
use std::fs::File;
use std::io::{Error, ErrorKind};
use std::os::fd::{AsRawFd, OwnedFd};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Bytes of a metadata document at most.
const MOST_DOCUMENT_BYTES: u64 = 64 << 20;

/// How a folder is opened: as a place alone, which takes no permission to list it, where there is such a thing.
#[cfg(target_os = "linux")]
const PLACE: OFlags = OFlags::PATH;
#[cfg(not(target_os = "linux"))]
const PLACE: OFlags = OFlags::RDONLY;

/// The folder of a store that is read.
pub(crate) struct Folder {
    path: PathBuf,
    dir: OwnedFd,
}

impl Folder {
    /// Opens a folder.
    pub(crate) fn open(path: &Path) -> std::io::Result<Self> {
        let flags = PLACE | OFlags::DIRECTORY | OFlags::CLOEXEC;
        Ok(Self { path: path.into(), dir: openat(CWD, path, flags, Mode::empty())? })
    }

    /// The path by which the folder was opened: what messages name.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Opens the file, or the folder, of a path inside of the folder to read it. Pipes, devices and sockets are refused: they may never answer.
    pub(crate) fn file(&self, path: &Path) -> std::io::Result<File> {
        let name = path.strip_prefix(&self.path).map_err(|_| Error::from(ErrorKind::InvalidInput))?;
        open_at(&self.dir, name)
    }

    /// A path by which a path inside of the folder is reached through the descriptor, whatever its own path leads to; the path itself where there is
    /// none, or it is not inside.
    pub(crate) fn through(&self, path: &Path) -> PathBuf {
        let own = Path::new("/proc/self/fd").join(self.dir.as_raw_fd().to_string());
        match path.strip_prefix(&self.path) {
            Ok(inside) if own.exists() => own.join(inside),
            _ => path.into(),
        }
    }

    /// Reads the bytes of a metadata document of at most 64 MiB.
    pub(crate) fn document(&self, path: &Path) -> Result<Vec<u8>, OpenError> {
        read_at_most(self.file(path), MOST_DOCUMENT_BYTES).map_err(|error| match self.is_lost(&error) {
            true => OpenError::Replaced { store: self.path.clone() },
            false => OpenError::Io { path: path.into(), error },
        })
    }

    /// The error for a file that could not be opened or read.
    pub(crate) fn unreadable(&self, path: &Path, error: Error) -> ReadError {
        match self.is_lost(&error) {
            true => ReadError::Replaced { store: self.path.clone() },
            false => ReadError::Io { path: path.into(), error },
        }
    }

    /// Whether a file is missing since the whole folder was deleted, or moved and deleted there.
    fn is_lost(&self, error: &Error) -> bool {
        error.kind() == ErrorKind::NotFound && self.is_replaced()
    }

    /// Whether the path leads elsewhere now, or nowhere: the folder was moved, deleted, or replaced by another one.
    pub(crate) fn is_replaced(&self) -> bool {
        let named = match std::fs::metadata(&self.path) {
            Ok(named) => named,
            Err(error) => return error.kind() == ErrorKind::NotFound,
        };
        rustix::fs::fstat(&self.dir).is_ok_and(|own| (own.st_dev, own.st_ino) != (named.dev(), named.ino()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::Store;

    #[test]
    fn pipes_in_the_places_of_files_are_refused_at_once() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("zarr.json");
        rustix::fs::mkfifoat(CWD, &path, Mode::from_raw_mode(0o600)).unwrap();
        let message = Store::open(dir.path()).err().unwrap().to_string();
        assert!(message.contains("zarr.json") && message.contains("is no file of data"), "{message}");
    }

    #[test]
    fn a_folder_is_reached_wherever_it_is_moved() {
        let dir = tempfile::tempdir().unwrap();
        let [path, moved, other] = ["a", "b", "c"].map(|name| dir.path().join(name));
        std::fs::create_dir(&path).unwrap();
        let folder = Folder::open(&path).unwrap();
        std::fs::rename(&path, &moved).unwrap();
        std::fs::write(folder.through(&path.join("x")), "x").unwrap();
        assert!(moved.join("x").exists() && !path.exists());
        assert_eq!(folder.through(&other), other);
    }
}
