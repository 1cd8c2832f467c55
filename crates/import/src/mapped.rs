//! A file read through a map, with checks of its bytes' validity.

use crate::error::{ImportError, Result};
use crate::stamp::Stamp;
use brickyard_filemap::GuardedMap;
use std::fs::File;
use std::ops::{Deref, Range};
use std::path::{Path, PathBuf};

/// A memory-mapped file. Bytes lost by the file read as zeros, so call [`MappedFile::confirm`] after every read.
pub(crate) struct MappedFile {
    pub(crate) path: PathBuf,
    map: GuardedMap,
    /// The file's stamp when it was opened; `None` for a scratch file without a name, which nobody else can change.
    pub(crate) stamp: Option<Stamp>,
}

impl MappedFile {
    pub(crate) fn open(path: &Path) -> Result<Self> {
        let file = File::open(path).map_err(ImportError::io(path))?;
        // The stamp before the map, so that changes between the two are noticed.
        let stamp = Stamp::in_metadata(&file.metadata().map_err(ImportError::io(path))?);
        let map = GuardedMap::new(&file).map_err(ImportError::io(path))?;
        Ok(Self { path: path.to_owned(), map, stamp: Some(stamp) })
    }

    /// Maps an unnamed scratch file. `path` is its original, for messages.
    pub(crate) fn of_scratch(path: &Path, scratch: &File) -> Result<Self> {
        let map = GuardedMap::new(scratch).map_err(ImportError::io(path))?;
        Ok(Self { path: path.to_owned(), map, stamp: None })
    }

    /// Bytes of scratch space: none, unless this is a scratch file.
    pub(crate) fn scratch_bytes(&self) -> u64 {
        if self.stamp.is_some() { 0 } else { self.map.len() as u64 }
    }

    /// Checks that the bytes read so far are the file's.
    ///
    /// # Errors
    /// If the file has changed since it was opened, or its disk could not read all the requested bytes.
    pub(crate) fn confirm(&self) -> Result<()> {
        // A file cut short within a page reads as zeros to that page's end, without a fault.
        self.stamp.map_or(Ok(()), |stamp| stamp.check(&self.path))?;
        if self.map.lost() {
            let error = std::io::Error::other("the file could be opened but not read; check its disk");
            return Err(ImportError::Io { path: self.path.clone(), error });
        }
        Ok(())
    }

    pub(crate) fn advise(&self, range: Range<usize>) {
        self.map.advise(range);
    }
}

impl Deref for MappedFile {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        &self.map
    }
}
