//! Reading of chunks' files. There may be millions, so none is looked at before it is needed: a file, or a folder without the file, that
//! changed after the array was opened is an error, as is one that changes while it is read.

use crate::error::{ImportError, Result};
use crate::stamp::Stamp;
use std::fs::{File, Metadata};
use std::io::{ErrorKind, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Files of an array's chunks, as they were when it was opened.
#[derive(Clone, Copy, Debug)]
pub(super) struct ChunkFiles {
    opened: SystemTime,
}

/// A chunk's file, open.
pub(super) struct ChunkFile {
    pub(super) path: PathBuf,
    file: File,
    stamp: Stamp,
    modified: Option<SystemTime>,
}

impl ChunkFiles {
    pub(super) fn from_now_on() -> Self {
        Self { opened: SystemTime::now() }
    }

    /// Opens a chunk's file; `None` if it was never written. `folder` is the array's.
    ///
    /// # Errors
    /// If it is no file, was written to after the array was opened, or is missing from a folder that changed since.
    pub(super) fn open(&self, folder: &Path, path: PathBuf) -> Result<Option<ChunkFile>> {
        let metadata = match std::fs::metadata(&path) {
            Ok(metadata) => metadata,
            Err(error) if error.kind() == ErrorKind::NotFound => {
                return self.confirm_gap(folder, &path).map(|()| None);
            }
            Err(error) => return Err(ImportError::io(&path)(error)),
        };
        if !metadata.is_file() {
            return Err(ImportError::invalid(
                &path,
                "expected a chunk's file, found a folder or device; fetch it again",
            ));
        }
        self.check_age(&path, &metadata)?;
        let file = File::open(&path).map_err(ImportError::io(&path))?;
        Ok(Some(ChunkFile { path, file, stamp: Stamp::in_metadata(&metadata), modified: metadata.modified().ok() }))
    }

    /// Checks that the nearest folder above a missing file is as old as the array: otherwise the file may have been deleted meanwhile.
    fn confirm_gap(&self, folder: &Path, path: &Path) -> Result<()> {
        for above in path.ancestors().skip(1) {
            match std::fs::metadata(above) {
                Ok(metadata) => return self.check_age(above, &metadata),
                Err(error) if error.kind() == ErrorKind::NotFound && above != folder => {}
                Err(error) => return Err(ImportError::io(above)(error)),
            }
        }
        Ok(())
    }

    /// Refuses files changed after the array was opened. A time yet to come is a clock's mistake, and tells nothing.
    fn check_age(&self, path: &Path, metadata: &Metadata) -> Result<()> {
        let Ok(modified) = metadata.modified() else { return Ok(()) };
        match self.opened < modified && modified <= SystemTime::now() {
            false => Ok(()),
            true => Err(ImportError::invalid(
                path,
                "changed while the array was read; start over when no program writes to it",
            )),
        }
    }
}

impl ChunkFile {
    /// Bytes of the file.
    pub(super) fn bytes(&self) -> u64 {
        self.stamp.bytes
    }

    /// Numbers that differ for another file at this path, or new contents: size and time.
    pub(super) fn state(&self) -> [u64; 2] {
        let age = self.modified.and_then(|time| time.duration_since(SystemTime::UNIX_EPOCH).ok());
        [self.stamp.bytes, age.map_or(0, |age| age.as_nanos() as u64)]
    }

    /// Fills a buffer from a place in the file.
    ///
    /// # Errors
    /// If the file ends before, or changed.
    pub(super) fn read(&mut self, start: u64, out: &mut [u8]) -> Result<()> {
        let read = self.file.seek(SeekFrom::Start(start)).and_then(|_| self.file.read_exact(out));
        read.map_err(|error| match error.kind() {
            ErrorKind::UnexpectedEof => self.damaged(&format!("cut short: expected {} bytes at {start}", out.len())),
            _ => ImportError::io(&self.path)(error),
        })?;
        let found = Stamp::in_metadata(&self.file.metadata().map_err(ImportError::io(&self.path))?);
        if found == self.stamp {
            return Ok(());
        }
        Err(ImportError::invalid(&self.path, "changed while it was read; start over when no program writes to it"))
    }

    pub(super) fn damaged(&self, problem: &str) -> ImportError {
        ImportError::invalid(&self.path, format!("{problem}; fetch or write the file again"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn message(result: Result<Option<ChunkFile>>) -> String {
        result.err().unwrap().to_string()
    }

    #[test]
    fn files_changed_after_the_opening_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("0");
        std::fs::write(&path, b"abcdef").unwrap();
        let now = ChunkFiles::from_now_on();
        let mut chunk = now.open(folder.path(), path.clone()).unwrap().unwrap();
        let mut out = [0; 2];
        chunk.read(3, &mut out).unwrap();
        assert_eq!((&out, chunk.bytes()), (b"de", 6));
        assert!(chunk.read(5, &mut out).unwrap_err().to_string().contains("cut short"));
        let earlier = ChunkFiles { opened: SystemTime::now() - Duration::from_secs(60) };
        assert!(message(earlier.open(folder.path(), path.clone())).contains("changed while the array was read"));
        // A clock's mistake.
        let file = File::options().write(true).open(&path).unwrap();
        file.set_modified(SystemTime::now() + Duration::from_secs(3600)).unwrap();
        assert!(earlier.open(folder.path(), path.clone()).is_ok());
        // Written to between opening and reading.
        let mut chunk = now.open(folder.path(), path.clone()).unwrap().unwrap();
        std::fs::write(&path, b"abcdefg").unwrap();
        assert!(chunk.read(0, &mut out).unwrap_err().to_string().contains("changed while it was read"));
    }

    #[test]
    fn a_missing_file_is_a_gap_only_in_an_old_folder() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("c/0/1");
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        assert!(ChunkFiles::from_now_on().open(folder.path(), path.clone()).unwrap().is_none());
        let earlier = ChunkFiles { opened: SystemTime::now() - Duration::from_secs(60) };
        assert!(message(earlier.open(folder.path(), path.clone())).contains("c/0: changed"));
        // Of folders that are missing too, the nearest one tells.
        let deep = folder.path().join("c/7/8/9");
        assert!(message(earlier.open(folder.path(), deep.clone())).contains("/c: changed"));
        std::fs::remove_dir_all(folder.path()).unwrap();
        assert!(ChunkFiles::from_now_on().open(folder.path(), deep).is_err(), "the array itself is gone");
        assert!(message(ChunkFiles::from_now_on().open(Path::new("/"), "/dev".into())).contains("found a folder"));
    }
}
