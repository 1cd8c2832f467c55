//! Reading of chunks' files. There may be millions, so none is looked at before it is needed: a file, or a folder without the file, that
//! changed after the array was opened is an error, as is one that changes while it is read. At an address a chunk's file costs a request, and a shard one
//! for its index.

use crate::error::{ImportError, Result};
use crate::stamp::Stamp;
use brickyard_objects::{Object, Place, Version, at};
use lru::LruCache;
use std::fs::{File, Metadata};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::{self, ErrorKind, Read, Seek, SeekFrom};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

/// Files of an array's chunks, as they were when it was opened.
pub(super) struct ChunkFiles {
    opened: SystemTime,
    /// Shards at an address, opened of late.
    shards: Mutex<LruCache<PathBuf, Arc<Shard>>>,
}

/// A chunk's file, open.
pub(super) struct ChunkFile {
    pub(super) path: PathBuf,
    body: Body,
}

/// Where a chunk's bytes are.
enum Body {
    Disk {
        file: File,
        stamp: Stamp,
        modified: Option<SystemTime>,
    },
    /// All of an object at an address.
    Read(Object),
    /// An object at an address, to be read by ranges.
    Ranged(Arc<Shard>),
}

/// A shard at an address: its place, and what was read of it on opening.
struct Shard {
    place: Place,
    version: Version,
    /// First byte of those read, and they, until the index is taken.
    read: Mutex<Option<(u64, Vec<u8>)>>,
}

/// The bytes of a file read on opening, at an address.
#[derive(Clone, Copy)]
pub(super) enum Opened {
    /// All, of at most so many.
    Whole(u64),
    /// So many first ones.
    Start(u64),
    /// So many last ones.
    End(u64),
}

/// Shards at an address kept open.
const MOST_SHARDS: NonZeroUsize = NonZeroUsize::new(256).unwrap();

/// Forgets what is kept on this machine's disk of a file at an address: it is damaged.
pub(super) fn forget(path: &Path) {
    if let Ok(Some(place)) = at(path) {
        place.forget();
    }
}

impl ChunkFiles {
    pub(super) fn from_now_on() -> Self {
        Self { opened: SystemTime::now(), shards: Mutex::new(LruCache::new(MOST_SHARDS)) }
    }

    /// Opens a chunk's file; `None` if it was never written. `folder` is the array's, `opened` the part read at once at an address.
    ///
    /// # Errors
    /// If it is no file, was written to after the array was opened, or is missing from a folder that changed since.
    pub(super) fn open(&self, folder: &Path, path: PathBuf, opened: Opened) -> Result<Option<ChunkFile>> {
        if let Some(place) = at(&path).map_err(ImportError::io(&path))? {
            let body = self.open_at(&path, place, opened).map_err(ImportError::io(&path))?;
            return Ok(body.map(|body| ChunkFile { path, body }));
        }
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
        let stamp = Stamp::in_metadata(&metadata);
        Ok(Some(ChunkFile { path, body: Body::Disk { file, stamp, modified: metadata.modified().ok() } }))
    }

    fn open_at(&self, path: &Path, place: Place, opened: Opened) -> io::Result<Option<Body>> {
        if let Opened::Whole(most_bytes) = opened {
            return Ok(place.whole(most_bytes)?.map(Body::Read));
        }
        let shards = || self.shards.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(shard) = shards().get(path) {
            return Ok(Some(Body::Ranged(shard.clone())));
        }
        let object = match opened {
            Opened::End(bytes) => place.tail(bytes)?,
            Opened::Whole(bytes) | Opened::Start(bytes) => place.head(bytes)?,
        };
        let Some(Object { bytes, version }) = object else { return Ok(None) };
        let first = if matches!(opened, Opened::End(_)) { version.bytes - bytes.len() as u64 } else { 0 };
        let shard = Arc::new(Shard { place, version, read: Mutex::new(Some((first, bytes))) });
        shards().put(path.to_owned(), shard.clone());
        Ok(Some(Body::Ranged(shard)))
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
        match &self.body {
            Body::Disk { stamp, .. } => stamp.bytes,
            Body::Read(object) => object.version.bytes,
            Body::Ranged(shard) => shard.version.bytes,
        }
    }

    /// Numbers that differ for another file at this path, or new contents: size, and time or tag.
    pub(super) fn state(&self) -> [u64; 2] {
        let of_tag = |version: &Version| {
            let mut hasher = DefaultHasher::new();
            version.tag.hash(&mut hasher);
            hasher.finish()
        };
        let second = match &self.body {
            Body::Disk { modified, .. } => {
                let age = modified.and_then(|time| time.duration_since(SystemTime::UNIX_EPOCH).ok());
                age.map_or(0, |age| age.as_nanos() as u64)
            }
            Body::Read(object) => of_tag(&object.version),
            Body::Ranged(shard) => of_tag(&shard.version),
        };
        [self.bytes(), second]
    }

    /// Fills a buffer from a place in the file.
    ///
    /// # Errors
    /// If the file ends before, or changed.
    pub(super) fn read(&mut self, start: u64, out: &mut [u8]) -> Result<()> {
        let short = format!("cut short: expected {} bytes at {start}", out.len());
        let (file, stamp) = match &mut self.body {
            Body::Disk { file, stamp, .. } => (file, *stamp),
            Body::Read(object) => {
                let found = object.bytes.get(start as usize..).and_then(|bytes| bytes.get(..out.len()));
                let Some(found) = found else { return Err(self.damaged(&short)) };
                out.copy_from_slice(found);
                return Ok(());
            }
            Body::Ranged(shard) => return shard.clone().read(start, out).map_err(ImportError::io(&self.path)),
        };
        let read = file.seek(SeekFrom::Start(start)).and_then(|_| file.read_exact(out));
        let found = file.metadata().map(|file| Stamp::in_metadata(&file));
        read.map_err(|error| match error.kind() {
            ErrorKind::UnexpectedEof => self.damaged(&short),
            _ => ImportError::io(&self.path)(error),
        })?;
        if found.map_err(ImportError::io(&self.path))? == stamp {
            return Ok(());
        }
        Err(ImportError::invalid(&self.path, "changed while it was read; start over when no program writes to it"))
    }

    pub(super) fn damaged(&self, problem: &str) -> ImportError {
        ImportError::invalid(&self.path, format!("{problem}; fetch or write the file again"))
    }
}

impl Shard {
    /// Fills a buffer from what was read on opening, else by a request.
    fn read(&self, start: u64, out: &mut [u8]) -> io::Result<()> {
        let mut read = self.read.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((first, bytes)) = read.take_if(|(first, bytes)| *first == start && bytes.len() == out.len()) {
            debug_assert_eq!(first, start);
            out.copy_from_slice(&bytes);
            return Ok(());
        }
        drop(read);
        out.copy_from_slice(&self.place.range(start..start + out.len() as u64, Some(&self.version))?);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    const ALL: Opened = Opened::Whole(u64::MAX);

    fn message(result: Result<Option<ChunkFile>>) -> String {
        result.err().unwrap().to_string()
    }

    #[test]
    fn files_changed_after_the_opening_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("0");
        std::fs::write(&path, b"abcdef").unwrap();
        let now = ChunkFiles::from_now_on();
        let mut chunk = now.open(folder.path(), path.clone(), ALL).unwrap().unwrap();
        let mut out = [0; 2];
        chunk.read(3, &mut out).unwrap();
        assert_eq!((&out, chunk.bytes()), (b"de", 6));
        assert!(chunk.read(5, &mut out).unwrap_err().to_string().contains("cut short"));
        let earlier = ChunkFiles { opened: SystemTime::now() - Duration::from_secs(60), ..ChunkFiles::from_now_on() };
        assert!(message(earlier.open(folder.path(), path.clone(), ALL)).contains("changed while the array was read"));
        // A clock's mistake.
        let file = File::options().write(true).open(&path).unwrap();
        file.set_modified(SystemTime::now() + Duration::from_secs(3600)).unwrap();
        assert!(earlier.open(folder.path(), path.clone(), ALL).is_ok());
        // Written to between opening and reading.
        let mut chunk = now.open(folder.path(), path.clone(), ALL).unwrap().unwrap();
        std::fs::write(&path, b"abcdefg").unwrap();
        assert!(chunk.read(0, &mut out).unwrap_err().to_string().contains("changed while it was read"));
    }

    #[test]
    fn a_missing_file_is_a_gap_only_in_an_old_folder() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("c/0/1");
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        assert!(ChunkFiles::from_now_on().open(folder.path(), path.clone(), ALL).unwrap().is_none());
        let earlier = ChunkFiles { opened: SystemTime::now() - Duration::from_secs(60), ..ChunkFiles::from_now_on() };
        assert!(message(earlier.open(folder.path(), path.clone(), ALL)).contains("c/0: changed"));
        // Of folders that are missing too, the nearest one tells.
        let deep = folder.path().join("c/7/8/9");
        assert!(message(earlier.open(folder.path(), deep.clone(), ALL)).contains("/c: changed"));
        std::fs::remove_dir_all(folder.path()).unwrap();
        assert!(ChunkFiles::from_now_on().open(folder.path(), deep, ALL).is_err(), "the array itself is gone");
        assert!(message(ChunkFiles::from_now_on().open(Path::new("/"), "/dev".into(), ALL)).contains("found a folder"));
    }
}
