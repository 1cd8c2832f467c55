//! An open shard: its checked index, and its bytes, mapped or read at offsets.

use crate::error::{CodecError, ReadError, ShardError};
use crate::folder::Folder;
use crate::ranged_file::RangedFile;
use crate::shard::{BrickRange, Fingerprint, ShardIndex, index_bytes};
use brickyard_filemap::GuardedMap;
use brickyard_volume::BrickId;
use std::path::Path;

/// I/O method for shard files.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum IoMode {
    /// Memory mapping: no copy, and read-ahead as advised. If a mapped file is truncated or its disk fails, reading its
    /// bricks gives errors.
    #[default]
    Mmap,
    /// Reads at offsets: slower, but safe on network file systems.
    Pread,
}

/// Most bytes of a shard at an address that is read whole when it is opened: those of coarse levels, which are needed first.
const SMALL_BYTES: u64 = 128 << 10;

/// An open shard whose length and index match the packed ones.
pub(crate) struct ShardFile {
    body: Body,
    /// A copy, so reads use the checked index whatever happens to the file.
    index: Box<[u8]>,
    file_bytes: u64,
    /// The greatest length of an encoded brick.
    cap: u64,
}

/// The source of a shard's bytes.
enum Body {
    Mapped(GuardedMap),
    File(RangedFile),
}

impl ShardFile {
    /// Opens an existing shard. `bricks` is the number of its index entries, `cap` the greatest length of an encoded
    /// brick. Of a small one at an address, or one looked at ahead, all bytes are read at once, and returned; of others none.
    pub(crate) fn open(
        folder: &Folder,
        path: &Path,
        fingerprint: Fingerprint,
        bricks: usize,
        cap: u64,
        mode: IoMode,
    ) -> Result<(Self, Vec<u8>), ReadError> {
        let io = |error: std::io::Error| match error.kind() {
            std::io::ErrorKind::NotFound if !folder.is_replaced() => ReadError::MissingShard { path: path.into() },
            _ => folder.unreadable(path, error),
        };
        let rewritten = |what, expected, found| ReadError::Rewritten { path: path.into(), what, expected, found };
        let check_bytes = |found| match found == fingerprint.file_bytes {
            true => Ok(found),
            false => Err(rewritten("bytes", fingerprint.file_bytes, found)),
        };
        let index_bytes = index_bytes(bricks) as u64;
        let mut whole = Vec::new();
        let (body, index, file_bytes) = if mode == IoMode::Mmap && !folder.is_remote() {
            let file = folder.file(path).map_err(io)?;
            let file_bytes = check_bytes(file.metadata().map_err(io)?.len())?;
            let map = GuardedMap::new(&file).map_err(io)?;
            let index = map[map.len().saturating_sub(index_bytes as usize)..].into();
            (Body::Mapped(map), index, file_bytes)
        } else {
            let is_small = folder.is_remote() && fingerprint.file_bytes <= SMALL_BYTES;
            let end_bytes = if is_small { fingerprint.file_bytes.max(index_bytes) } else { index_bytes };
            let (file, end) = RangedFile::open(folder, path, end_bytes).map_err(io)?;
            let file_bytes = check_bytes(file.bytes())?;
            let index = end[end.len().saturating_sub(index_bytes as usize)..].into();
            if folder.is_remote() && end.len() as u64 == file_bytes {
                whole = end.into();
            }
            (Body::File(file), index, file_bytes)
        };
        let shard = Self { body, index, file_bytes, cap };
        let checked = ShardIndex::new(&shard.index, file_bytes, bricks, cap);
        let checked = checked.and_then(|index| index.check().map(|()| index.crc()));
        if shard.lost() {
            return Err(io(std::io::Error::other("its index could not be read; check its disk")));
        }
        let crc = checked.map_err(|error| ReadError::CorruptIndex { path: path.into(), error })?;
        if crc as u64 != fingerprint.index_crc {
            return Err(rewritten("index checksum", fingerprint.index_crc, crc.into()));
        }
        Ok((shard, whole))
    }

    /// The range in the file of index entry `slot`; `None` if the brick is not stored.
    pub(crate) fn range(&self, slot: usize) -> Result<Option<BrickRange>, ShardError> {
        self.index()?.range(slot)
    }

    /// The index entries of two bricks with some but not all bytes in common; `None` if there are none.
    pub(crate) fn overlap(&self) -> Result<Option<(usize, usize)>, ShardError> {
        Ok(self.index()?.overlap())
    }

    /// The chunks that lie wholly within some bytes, in order; none if the index is unreadable.
    pub(crate) fn ranges_within(&self, bytes: std::ops::Range<u64>) -> Vec<BrickRange> {
        let ranges = (0..self.index.len() / 16).filter_map(|slot| self.range(slot).ok().flatten());
        let mut within: Vec<BrickRange> =
            ranges.filter(|range| bytes.start <= range.offset && range.offset + range.length <= bytes.end).collect();
        within.sort_unstable_by_key(|range| range.offset);
        within.dedup_by_key(|range| range.offset);
        within
    }

    fn index(&self) -> Result<ShardIndex<'_>, ShardError> {
        ShardIndex::new(&self.index, self.file_bytes, self.index.len() / 16, self.cap)
    }

    /// A brick's encoded bytes, borrowed from the map or read into `buffer`.
    pub(crate) fn bytes<'a>(&'a self, range: BrickRange, buffer: &'a mut Vec<u8>) -> std::io::Result<&'a [u8]> {
        match &self.body {
            // The range was checked against the mapped length.
            Body::Mapped(map) => Ok(&map[range.as_range()]),
            Body::File(file) => {
                buffer.resize(range.length as usize, 0);
                file.read_exact_at(buffer, range.offset)?;
                Ok(buffer)
            }
        }
    }

    /// Fetches ranges of a file at an address, neighbouring ones at once.
    pub(crate) fn fetch(&self, ranges: &[BrickRange]) -> std::io::Result<Vec<Vec<u8>>> {
        match &self.body {
            Body::Mapped(_) => Err(std::io::ErrorKind::Unsupported.into()),
            Body::File(file) => file.read_ranges(ranges.iter().map(|range| range.offset..range.offset + range.length)),
        }
    }

    /// Whether some mapped bytes were unreadable.
    fn lost(&self) -> bool {
        matches!(&self.body, Body::Mapped(map) if map.lost())
    }

    /// Requests read-ahead of a range of bytes, if the file is mapped. A refusal costs speed only.
    pub(crate) fn advise(&self, range: std::ops::Range<usize>) {
        if let Body::Mapped(map) = &self.body {
            map.advise(range);
        }
    }

    /// Diagnoses a brick of this shard that failed to decode: the file was truncated or its disk failed after opening,
    /// or else the brick is damaged.
    pub(crate) fn unreadable(&self, folder: &Folder, path: &Path, id: BrickId, error: CodecError) -> ReadError {
        let path = path.to_path_buf();
        let (expected, found) =
            (self.file_bytes, folder.file(&path).and_then(|file| file.metadata()).map(|file| file.len()));
        match found {
            Ok(found) if found != expected => ReadError::Rewritten { path, what: "bytes", expected, found },
            _ if self.lost() => {
                let error =
                    std::io::Error::other(format!("{id}: the file could be opened but not read; check its disk"));
                ReadError::Io { path, error }
            }
            _ => ReadError::CorruptBrick { path, id, error },
        }
    }
}
