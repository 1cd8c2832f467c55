//! The open folder of a store. Files are opened by name through one descriptor, so all belong to one store even if its
//! path changes hands. Costs a descriptor per open store.

use crate::data_file::{open_at, read_at_most};
use crate::error::{OpenError, ReadError};
use rustix::fs::{CWD, Mode, OFlags, openat};
use std::fs::File;
use std::io::{Error, ErrorKind};
use std::os::fd::{AsRawFd, OwnedFd};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

const MOST_DOCUMENT_BYTES: u64 = 64 << 20;

/// Flags for opening a folder: as a bare location if supported, which needs no permission to list it.
#[cfg(target_os = "linux")]
const PLACE: OFlags = OFlags::PATH;
#[cfg(not(target_os = "linux"))]
const PLACE: OFlags = OFlags::RDONLY;

/// The folder of a store open for reading.
pub(crate) struct Folder {
    path: PathBuf,
    dir: OwnedFd,
}

impl Folder {
    pub(crate) fn open(path: &Path) -> std::io::Result<Self> {
        let flags = PLACE | OFlags::DIRECTORY | OFlags::CLOEXEC;
        Ok(Self { path: path.into(), dir: openat(CWD, path, flags, Mode::empty())? })
    }

    /// The path given on opening, as used in messages.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Opens a file or folder inside for reading. Refuses pipes, devices and sockets, which may block forever.
    pub(crate) fn file(&self, path: &Path) -> std::io::Result<File> {
        let name = path.strip_prefix(&self.path).map_err(|_| Error::from(ErrorKind::InvalidInput))?;
        open_at(&self.dir, name)
    }

    /// A path through the descriptor to the same place, wherever the given path now leads; the path itself if that is
    /// impossible, or it lies outside.
    pub(crate) fn through(&self, path: &Path) -> PathBuf {
        let own = Path::new("/proc/self/fd").join(self.dir.as_raw_fd().to_string());
        match path.strip_prefix(&self.path) {
            Ok(inside) if own.exists() => own.join(inside),
            _ => path.into(),
        }
    }

    /// Reads a metadata document of at most 64 MiB.
    pub(crate) fn document(&self, path: &Path) -> Result<Vec<u8>, OpenError> {
        read_at_most(self.file(path), MOST_DOCUMENT_BYTES).map_err(|error| match self.is_lost(&error) {
            true => self.replaced(),
            false => OpenError::Io { path: path.into(), error },
        })
    }

    /// The error for a store gone from its path.
    pub(crate) fn replaced(&self) -> OpenError {
        OpenError::Replaced { store: self.path.clone() }
    }

    /// The error for a file that failed to open or read.
    pub(crate) fn unreadable(&self, path: &Path, error: Error) -> ReadError {
        match self.is_lost(&error) {
            true => ReadError::Replaced { store: self.path.clone() },
            false => ReadError::Io { path: path.into(), error },
        }
    }

    /// Whether a file is missing because the whole folder was deleted, perhaps after a move.
    fn is_lost(&self, error: &Error) -> bool {
        error.kind() == ErrorKind::NotFound && self.is_replaced()
    }

    /// Whether the path now leads elsewhere or nowhere: the folder was moved, deleted or replaced.
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
        assert!(message.contains("zarr.json") && message.contains("is not a regular file"), "{message}");
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
