//! The chunks of one pyramid: its bricks' cores, or their aprons. Finds, checks and decodes them.
//!
//! A shard is mapped and its index checked when one of its chunks is first read; it stays mapped. A chunk is decoded from the
//! mapped slice straight into the caller's buffer: no copy of the file, no allocation. All methods may be called from many
//! threads.

use crate::codec::BrickCodec;
use crate::error::ReadError;
use crate::layout::{Layout, ShardId};
use crate::scratch::Scratch;
use crate::shard::{BrickRange, Fingerprint};
use crate::shard_file::{IoMode, OpenFiles, ShardFile};
use brickyard_volume::{BrickId, Level};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};

pub(crate) struct Chunks {
    store: PathBuf,
    layout: Layout,
    codec: BrickCodec,
    mode: IoMode,
    /// Per level, in the order of the side data.
    levels: Vec<Box<[Shard]>>,
    files: OpenFiles,
    bytes_read: AtomicU64,
}

struct Shard {
    fingerprint: Fingerprint,
    file: OnceLock<ShardFile>,
}

impl Chunks {
    /// Those of the store at `store`, where the fingerprints of each level's shards are these.
    pub(crate) fn new<'a>(
        store: &Path,
        layout: Layout,
        codec: BrickCodec,
        mode: IoMode,
        fingerprints: impl Iterator<Item = &'a [Fingerprint]>,
    ) -> Self {
        let shard = |&fingerprint: &Fingerprint| Shard { fingerprint, file: OnceLock::new() };
        let levels = fingerprints.map(|level| level.iter().map(shard).collect()).collect();
        let (files, bytes_read) = Default::default();
        Self { store: store.into(), layout, codec, mode, levels, files, bytes_read }
    }

    pub(crate) fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Bytes of a decoded chunk.
    pub(crate) fn chunk_bytes(&self) -> usize {
        self.codec.core_bytes()
    }

    /// Encoded bytes read so far, repeats and damaged ones included.
    pub(crate) fn bytes_read(&self) -> u64 {
        self.bytes_read.load(Ordering::Relaxed)
    }

    /// The files of a level.
    pub(crate) fn files(&self, level: Level) -> impl Iterator<Item = Fingerprint> {
        self.levels[level.index()].iter().map(|shard| shard.fingerprint).filter(|fingerprint| fingerprint.has_file())
    }

    /// Bytes of all files.
    pub(crate) fn file_bytes(&self) -> u64 {
        self.levels.iter().flatten().map(|shard| shard.fingerprint.file_bytes).sum()
    }

    /// Decodes a brick's chunk into `out`; all zero if it is not stored.
    pub(crate) fn read(&self, id: BrickId, out: &mut [u8]) -> Result<(), ReadError> {
        assert_eq!(out.len(), self.chunk_bytes());
        let Some((shard, range)) = self.locate(id)? else {
            out.fill(0);
            return Ok(());
        };
        self.bytes_read.fetch_add(range.length, Ordering::Relaxed);
        let path = || self.path(self.layout.shard_of(id).0);
        Scratch::with(|scratch| {
            let decoded = match shard.mapped(range) {
                Some(encoded) => self.codec.decode(scratch, encoded, out),
                None => {
                    let mut encoded = std::mem::take(&mut scratch.encoded);
                    let read = self.files.read(&path(), range, &mut encoded);
                    let decoded = read.map(|()| self.codec.decode(scratch, &encoded, out));
                    scratch.encoded = encoded;
                    decoded.map_err(|error| ReadError::Io { path: path(), error })?
                }
            };
            decoded.map_err(|error| shard.unreadable(&path(), id, error))
        })
    }

    /// Whether the brick has a chunk; one that has not is all zero.
    pub(crate) fn is_stored(&self, id: BrickId) -> Result<bool, ReadError> {
        Ok(self.locate(id)?.is_some())
    }

    /// Tells the kernel that these bricks' chunks are about to be read, so that it reads them ahead and together. Opens
    /// their shards if need be; what cannot be opened is left for [`Chunks::read`] to report.
    pub(crate) fn advise(&self, ids: &[BrickId]) {
        if self.mode != IoMode::Mmap {
            return;
        }
        const PAGE_BYTES: usize = 4096;
        let pages = |&id: &BrickId| {
            let (shard, slot) = self.layout.shard_of(id);
            let range = self.shard(shard).ok()??.index.range(slot)?.as_range();
            Some((shard, range.start / PAGE_BYTES * PAGE_BYTES, range.end))
        };
        let mut ranges: Vec<(ShardId, usize, usize)> =
            ids.iter().filter(|id| self.layout.contains(**id)).filter_map(pages).collect();
        ranges.sort_unstable();
        ranges.dedup_by(|next, last| {
            let joined = next.0 == last.0 && next.1 <= last.2.next_multiple_of(PAGE_BYTES);
            if joined {
                last.2 = last.2.max(next.2);
            }
            joined
        });
        for (id, start, end) in ranges {
            if let Ok(Some(shard)) = self.shard(id) {
                shard.advise(start..end);
            }
        }
    }

    /// The brick's shard and its chunk's place there; `None` if it is not stored.
    fn locate(&self, id: BrickId) -> Result<Option<(&ShardFile, BrickRange)>, ReadError> {
        assert!(self.layout.contains(id), "no such brick: {id}");
        let (shard, slot) = self.layout.shard_of(id);
        let shard = self.shard(shard)?;
        Ok(shard.and_then(|s| Some((s, s.index.range(slot)?))))
    }

    /// An open shard; `None` if it has no file. Failures are not kept: a file that comes back is read again.
    pub(crate) fn shard(&self, id: ShardId) -> Result<Option<&ShardFile>, ReadError> {
        let Shard { fingerprint, file } = &self.levels[id.level.index()][self.layout.shard_place(id)];
        if !fingerprint.has_file() {
            return Ok(None);
        }
        if let Some(shard) = file.get() {
            return Ok(Some(shard));
        }
        let bricks = self.layout.shard_bricks(id.level).volume() as usize;
        let shard = ShardFile::open(&self.path(id), *fingerprint, bricks, self.codec.encoded_cap(), self.mode)?;
        Ok(Some(file.get_or_init(|| shard)))
    }

    /// A shard's file.
    pub(crate) fn path(&self, id: ShardId) -> PathBuf {
        self.layout.shard_path(&self.store, id)
    }
}
