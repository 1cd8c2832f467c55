//! An open shard: its checked index, and its bytes, mapped or read at offsets.

use crate::error::{CodecError, ReadError};
use crate::shard::{BrickRange, Fingerprint, ShardIndex, index_bytes};
use brickyard_filemap::GuardedMap;
use brickyard_volume::BrickId;
use std::fs::File;
use std::os::unix::fs::FileExt;
use std::path::Path;
use std::sync::Mutex;

/// How shards are read.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum IoMode {
    /// Memory-mapped: no copy, and read-ahead as advised. Where a file is truncated or its disk fails meanwhile, its bricks are
    /// damaged.
    #[default]
    Mmap,
    /// Read at offsets: slower, but safe on network file systems.
    Pread,
}

/// One shard whose length and index are those that were packed.
pub(crate) struct ShardFile {
    pub(crate) index: ShardIndex,
    /// `None` in [`IoMode::Pread`].
    map: Option<GuardedMap>,
    file_bytes: u64,
}

impl ShardFile {
    /// Opens a shard that must exist. `bricks` is its number of index entries, `cap` an encoded brick's greatest length.
    pub(crate) fn open(
        path: &Path,
        fingerprint: Fingerprint,
        bricks: usize,
        cap: u64,
        mode: IoMode,
    ) -> Result<Self, ReadError> {
        let io = |error: std::io::Error| match error.kind() {
            std::io::ErrorKind::NotFound => ReadError::MissingShard { path: path.into() },
            _ => ReadError::Io { path: path.into(), error },
        };
        let file = File::open(path).map_err(io)?;
        let file_bytes = file.metadata().map_err(io)?.len();
        let rewritten = |what, expected, found| ReadError::Rewritten { path: path.into(), what, expected, found };
        if file_bytes != fingerprint.file_bytes {
            return Err(rewritten("bytes", fingerprint.file_bytes, file_bytes));
        }
        let tail_bytes = (index_bytes(bricks) as u64).min(file_bytes);
        let corrupt = |error| ReadError::CorruptIndex { path: path.into(), error };
        let (map, index) = match mode {
            IoMode::Mmap => {
                let map = GuardedMap::new(&file).map_err(io)?;
                let tail = map.len().checked_sub(tail_bytes as usize).map_or(&[][..], |start| &map[start..]);
                let index = ShardIndex::parse(tail, file_bytes, bricks, cap).map_err(corrupt)?;
                (Some(map), index)
            }
            IoMode::Pread => {
                let mut tail = vec![0; tail_bytes as usize];
                file.read_exact_at(&mut tail, file_bytes - tail_bytes).map_err(io)?;
                (None, ShardIndex::parse(&tail, file_bytes, bricks, cap).map_err(corrupt)?)
            }
        };
        if index.crc() as u64 != fingerprint.index_crc {
            return Err(rewritten("index checksum", fingerprint.index_crc, index.crc().into()));
        }
        Ok(Self { index, map, file_bytes })
    }

    /// The bytes of a brick, if the shard is mapped.
    pub(crate) fn mapped(&self, range: BrickRange) -> Option<&[u8]> {
        // The index was checked against the length that was mapped.
        self.map.as_ref().map(|map| &map[range.as_range()])
    }

    /// Asks the kernel to read a range of bytes ahead. A refusal costs speed only.
    pub(crate) fn advise(&self, range: std::ops::Range<usize>) {
        if let Some(map) = &self.map {
            map.advise(range);
        }
    }

    /// Why a brick of this shard does not decode: the file has been truncated or its disk has failed since it was opened,
    /// or else the brick is damaged.
    pub(crate) fn unreadable(&self, path: &Path, id: BrickId, error: CodecError) -> ReadError {
        let path = path.to_path_buf();
        let (expected, found) = (self.file_bytes, std::fs::metadata(&path).map(|file| file.len()));
        match found {
            Ok(found) if found != expected => ReadError::Rewritten { path, what: "bytes", expected, found },
            _ if self.map.as_ref().is_some_and(GuardedMap::lost) => {
                let error =
                    std::io::Error::other(format!("{id}: the file could be opened but not read; is its disk well?"));
                ReadError::Io { path, error }
            }
            _ => ReadError::CorruptBrick { path, id, error },
        }
    }
}

/// A few open files, for reading at offsets without opening a file per brick or holding thousands open.
#[derive(Default)]
pub(crate) struct OpenFiles(Mutex<Vec<(std::path::PathBuf, std::sync::Arc<File>)>>);

impl OpenFiles {
    const COUNT: usize = 64;

    /// Reads a brick's bytes into `buffer`.
    pub(crate) fn read(&self, path: &Path, range: BrickRange, buffer: &mut Vec<u8>) -> std::io::Result<()> {
        let file = self.get(path)?;
        buffer.resize(range.length as usize, 0);
        file.read_exact_at(buffer, range.offset)
    }

    /// The file, most recently used first; the least recently used one is dropped.
    fn get(&self, path: &Path) -> std::io::Result<std::sync::Arc<File>> {
        let mut files = self.0.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        match files.iter().position(|(p, _)| p == path) {
            Some(i) => files[..=i].rotate_right(1),
            None => {
                files.truncate(Self::COUNT - 1);
                files.insert(0, (path.into(), File::open(path)?.into()));
            }
        }
        Ok(files[0].1.clone())
    }
}
