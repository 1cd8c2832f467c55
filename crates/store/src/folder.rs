//! The open folder of a store, on disk or at an address. Files on disk are opened by name through one descriptor, so all belong to one store even if its
//! path changes hands. Costs a descriptor per open store on disk.

use crate::data_file::{open_at, read_at_most};
use crate::error::{OpenError, ReadError};
use brickyard_objects::{Fault, Place, at};
use rustix::fs::{CWD, Mode, OFlags, openat};
use std::fs::File;
use std::io::{Error, ErrorKind};
use std::os::fd::{AsRawFd, OwnedFd};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

pub(crate) const MOST_DOCUMENT_BYTES: u64 = 64 << 20;

/// Flags for opening a folder: as a bare location if supported, which needs no permission to list it.
#[cfg(target_os = "linux")]
const PLACE: OFlags = OFlags::PATH;
#[cfg(not(target_os = "linux"))]
const PLACE: OFlags = OFlags::RDONLY;

/// The folder of a store open for reading.
pub(crate) struct Folder {
    path: PathBuf,
    dir: Dir,
}

/// Where a folder is.
enum Dir {
    Disk(OwnedFd),
    Remote(Place),
}

impl Folder {
    pub(crate) fn open(path: &Path) -> std::io::Result<Self> {
        let dir = match at(path)? {
            Some(place) => Dir::Remote(place),
            None => {
                let flags = PLACE | OFlags::DIRECTORY | OFlags::CLOEXEC;
                Dir::Disk(openat(CWD, path, flags, Mode::empty())?)
            }
        };
        Ok(Self { path: path.into(), dir })
    }

    /// The path given on opening, as used in messages.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Opens a file or folder inside for reading. Refuses pipes, devices and sockets, which may block forever; and files at an address, which are
    /// [read](Folder::read), or by ranges at their [place](Folder::place).
    pub(crate) fn file(&self, path: &Path) -> std::io::Result<File> {
        match &self.dir {
            Dir::Disk(dir) => open_at(dir, self.inside(path)?),
            Dir::Remote(_) => Err(Fault::Unsupported("only files on disk can be opened here".into()).into()),
        }
    }

    /// Whether the folder is at an address.
    pub(crate) fn is_remote(&self) -> bool {
        matches!(self.dir, Dir::Remote(_))
    }

    /// The place of a file inside, if the folder is at an address.
    pub(crate) fn place(&self, path: &Path) -> std::io::Result<Option<Place>> {
        match &self.dir {
            Dir::Disk(_) => Ok(None),
            Dir::Remote(place) => Ok(Some(place.join(&self.inside(path)?.to_string_lossy()))),
        }
    }

    /// Reads a file inside of at most so many bytes.
    pub(crate) fn read(&self, path: &Path, most_bytes: u64) -> std::io::Result<Vec<u8>> {
        match self.place(path)? {
            None => read_at_most(self.file(path), most_bytes),
            Some(place) => place.whole(most_bytes)?.map(|object| object.bytes).ok_or_else(|| Fault::Absent.into()),
        }
    }

    /// Forgets what is kept on this machine's disk of a file at an address: it is damaged. Returns whether the file may be read again.
    pub(crate) fn forget(&self, path: &Path) -> bool {
        let Ok(Some(place)) = self.place(path) else { return false };
        place.forget();
        true
    }

    fn inside<'a>(&self, path: &'a Path) -> std::io::Result<&'a Path> {
        path.strip_prefix(&self.path).map_err(|_| Error::from(ErrorKind::InvalidInput))
    }

    /// A path through the descriptor to the same place, wherever the given path now leads; the path itself if that is
    /// impossible, or it lies outside.
    pub(crate) fn through(&self, path: &Path) -> PathBuf {
        let Dir::Disk(dir) = &self.dir else { return path.into() };
        let own = Path::new("/proc/self/fd").join(dir.as_raw_fd().to_string());
        match path.strip_prefix(&self.path) {
            Ok(inside) if own.exists() => own.join(inside),
            _ => path.into(),
        }
    }

    /// Reads a metadata document of at most 64 MiB.
    pub(crate) fn document(&self, path: &Path) -> Result<Vec<u8>, OpenError> {
        let read = match self.place(path) {
            Ok(Some(place)) => place
                .document(MOST_DOCUMENT_BYTES)
                .and_then(|document| Ok(document.ok_or(Fault::Absent)?.bytes.clone())),
            Ok(None) => self.read(path, MOST_DOCUMENT_BYTES),
            Err(error) => Err(error),
        };
        read.map_err(|error| self.unreadable_document(path, error))
    }

    /// Reads files at an address all at once, ahead of the first reading of each.
    pub(crate) fn look_ahead(&self, paths: &[PathBuf]) {
        if let Dir::Remote(place) = &self.dir {
            let inside = paths.iter().filter_map(|path| self.inside(path).ok());
            let names: Vec<String> = inside.map(|path| path.to_string_lossy().into_owned()).collect();
            place.look_ahead(&names, MOST_DOCUMENT_BYTES);
        }
    }

    /// Forgets documents read of late at an address: the store changed.
    pub(crate) fn look_again(&self) {
        if let Dir::Remote(place) = &self.dir {
            place.look_again();
        }
    }

    /// Whether any of some files is there.
    pub(crate) fn has_any(&self, paths: &[PathBuf]) -> Result<bool, OpenError> {
        let Dir::Remote(_) = &self.dir else { return Ok(paths.iter().any(|path| path.exists())) };
        for path in paths {
            match self.document(path) {
                Ok(_) => return Ok(true),
                Err(OpenError::Io { error, .. }) if error.kind() == ErrorKind::NotFound => {}
                Err(error) => return Err(error),
            }
        }
        Ok(false)
    }

    fn unreadable_document(&self, path: &Path, error: Error) -> OpenError {
        match self.is_lost(&error) {
            true => self.replaced(),
            false => OpenError::Io { path: path.into(), error },
        }
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
        let Dir::Disk(dir) = &self.dir else { return false };
        let named = match std::fs::metadata(&self.path) {
            Ok(named) => named,
            Err(error) => return error.kind() == ErrorKind::NotFound,
        };
        rustix::fs::fstat(dir).is_ok_and(|own| (own.st_dev, own.st_ino) != (named.dev(), named.ino()))
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
