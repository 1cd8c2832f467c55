//! The chunks of one pyramid, cores or aprons: locates, checks and decodes them.
//!
//! The first read from a shard maps it and checks its index. The last [`MOST_OPEN`] shards used stay mapped, since a
//! process may have some 65,000 maps and a store more shards. Chunks are decoded from the map straight into the
//! caller's buffer: no copy of the file, no allocation. All methods are thread-safe.

use crate::arrived::{self, Arrived};
use crate::codec::BrickCodec;
use crate::error::ReadError;
use crate::folder::Folder;
use crate::layout::{Layout, ShardId};
use crate::mutex::lock;
use crate::scratch::Scratch;
use crate::shard::{BrickRange, Fingerprint, index_bytes};
use crate::shard_file::{IoMode, ShardFile};
use crate::side::SideArray;
use crate::turns::Turns;
use brickyard_volume::{BrickId, Level, PageId, Paging};
use lru::LruCache;
use std::collections::BTreeMap;
use std::io;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex};

const MOST_OPEN: usize = 512;

/// Most files open at a time without mapping: a process may have 1,024.
const MOST_FILES: usize = 64;

/// Most bytes of indexes of open shards; but at least two shards stay open.
const MOST_INDEX_BYTES: usize = 4 << 20;

/// Cached pages of fingerprints, of 64 KiB at most.
const KEPT_PAGES: usize = 16;

pub(crate) struct Chunks {
    folder: Arc<Folder>,
    layout: Layout,
    codec: BrickCodec,
    mode: IoMode,
    fingerprints: Mutex<LruCache<PageId, Arc<[Fingerprint]>>>,
    open: Mutex<LruCache<ShardId, Arc<ShardFile>>>,
    bytes_read: AtomicU64,
    /// Threads that open the same shard, or read the same page of fingerprints, at once.
    opening: Turns<ShardId>,
    paging: Turns<PageId>,
    /// Chunks fetched ahead; none of a store on disk.
    arrived: Option<Arrived>,
}

impl Chunks {
    /// Creates a reader for a store's chunks, without opening a file.
    pub(crate) fn new(folder: &Arc<Folder>, layout: Layout, codec: BrickCodec, mode: IoMode) -> Self {
        let open = Mutex::new(LruCache::new(most_open(&layout, mode)));
        let fingerprints = Mutex::new(LruCache::new(at_least_one(KEPT_PAGES)));
        let arrived = folder.is_remote().then(Arrived::default);
        let (folder, bytes_read, opening, paging) =
            (folder.clone(), AtomicU64::new(0), Turns::default(), Turns::default());
        Self { folder, layout, codec, mode, fingerprints, open, bytes_read, opening, paging, arrived }
    }

    pub(crate) fn layout(&self) -> &Layout {
        &self.layout
    }

    pub(crate) fn chunk_bytes(&self) -> usize {
        self.codec.core_bytes()
    }

    /// Encoded bytes read so far, repeats and damaged ones included.
    pub(crate) fn bytes_read(&self) -> u64 {
        self.bytes_read.load(Ordering::Relaxed)
    }

    pub(crate) fn cache_bytes(&self) -> u64 {
        let arrived = if self.arrived.is_some() { arrived::MOST_BYTES } else { 0 };
        arrived + cache_bytes(&self.layout, self.mode)
    }

    /// Fetches the encoded chunks of bricks of a store at an address, each once; returns their bytes. Failures are left for [`Chunks::read`] to report.
    pub(crate) fn fetch(&self, ids: &[BrickId]) -> u64 {
        let Some(arrived) = &self.arrived else { return 0 };
        let mut by_shard: BTreeMap<ShardId, Vec<usize>> = BTreeMap::new();
        for (shard, slot) in ids.iter().filter(|id| self.layout.contains(**id)).map(|id| self.layout.shard_of(*id)) {
            by_shard.entry(shard).or_default().push(slot);
        }
        let mut bytes = 0;
        for (id, slots) in by_shard {
            let Ok(Some(shard)) = self.shard(id) else { continue };
            match fetch_in(arrived, &shard, id, &slots) {
                Ok(fetched) => bytes += fetched,
                Err(error) => tracing::debug!(%error, path = %self.path(id).display(), "not fetched ahead"),
            }
        }
        bytes
    }

    pub(crate) fn fingerprint_pages(&self, level: Level) -> u64 {
        SideArray::fingerprints(self.folder.path(), &self.layout, level).page_count()
    }

    /// Number and total bytes of the shard files listed in a page of fingerprints.
    pub(crate) fn files_of_page(&self, level: Level, page: u64) -> Result<(u64, u64), ReadError> {
        let array = SideArray::fingerprints(self.folder.path(), &self.layout, level);
        // Past the grid a page holds zeros.
        let files = array.read_fingerprints(&self.folder, array.page_at(level, page))?;
        Ok(files.iter().filter(|f| f.has_file()).fold((0, 0), |(n, bytes), f| (n + 1, bytes + f.file_bytes)))
    }

    /// Decodes a brick's chunk into `out`. Absent chunks are all zero.
    pub(crate) fn read(&self, id: BrickId, out: &mut [u8]) -> Result<(), ReadError> {
        assert_eq!(out.len(), self.chunk_bytes());
        assert!(self.layout.contains(id), "no such brick: {id}");
        let (shard_id, slot) = self.layout.shard_of(id);
        let Some(shard) = self.shard(shard_id)? else {
            out.fill(0);
            return Ok(());
        };
        let read = self.read_in(&shard, slot, id, out);
        if read.is_err() {
            // The next attempt reopens the file and remaps any unreadable pages.
            lock(&self.open).pop(&shard_id);
        }
        read
    }

    pub(crate) fn is_stored(&self, id: BrickId) -> Result<bool, ReadError> {
        Ok(self.locate(id)?.is_some())
    }

    /// Requests read-ahead of these bricks' chunks, opening their shards if needed; failures are left for
    /// [`Chunks::read`] to report. At an address nothing is mapped, and to open a shard would keep the first brick waiting.
    pub(crate) fn advise(&self, ids: &[BrickId]) {
        if self.mode != IoMode::Mmap || self.arrived.is_some() {
            return;
        }
        const PAGE_BYTES: usize = 4096;
        let pages = |&id: &BrickId| {
            let range = self.locate(id).ok()??.1.as_range();
            Some((self.layout.shard_of(id).0, range.start / PAGE_BYTES * PAGE_BYTES, range.end))
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

    /// The brick's shard and its chunk's range there; `None` if it is not stored.
    fn locate(&self, id: BrickId) -> Result<Option<(Arc<ShardFile>, BrickRange)>, ReadError> {
        assert!(self.layout.contains(id), "no such brick: {id}");
        let (shard_id, slot) = self.layout.shard_of(id);
        let Some(shard) = self.shard(shard_id)? else { return Ok(None) };
        let corrupt = |error| ReadError::CorruptIndex { path: self.path(shard_id), error };
        let range = shard.range(slot).map_err(corrupt)?;
        Ok(range.map(|range| (shard, range)))
    }

    /// Returns the shard, opened if needed; `None` if it has no file. Failures are not cached: a restored file is read
    /// again.
    pub(crate) fn shard(&self, id: ShardId) -> Result<Option<Arc<ShardFile>>, ReadError> {
        let opened = || lock(&self.open).get(&id).cloned();
        if let Some(shard) = opened() {
            return Ok(Some(shard));
        }
        let fingerprint = self.fingerprint(id)?;
        if !fingerprint.has_file() {
            return Ok(None);
        }
        let _turn = self.opening.take(id);
        if let Some(shard) = opened() {
            return Ok(Some(shard));
        }
        let (shard, whole) = self.open_file(id, fingerprint)?;
        let shard = Arc::new(shard);
        if let Some(arrived) = &self.arrived {
            keep_all(arrived, &shard, id, &whole);
        }
        // An evicted shard is closed after its last reader, outside the lock.
        let _evicted = lock(&self.open).push(id, shard.clone());
        Ok(Some(shard))
    }

    /// Opens an existing shard with this fingerprint, whatever the side data record.
    pub(crate) fn open_as(&self, id: ShardId, fingerprint: Fingerprint) -> Result<ShardFile, ReadError> {
        Ok(self.open_file(id, fingerprint)?.0)
    }

    /// Opens a shard: see [`ShardFile::open`]. One whose index was damaged on its way from an address is opened once more.
    fn open_file(&self, id: ShardId, fingerprint: Fingerprint) -> Result<(ShardFile, Vec<u8>), ReadError> {
        let (slots, path) = (self.layout.shard_slots(id.level), self.path(id));
        let open = || ShardFile::open(&self.folder, &path, fingerprint, slots, self.codec.encoded_cap(), self.mode);
        match open() {
            Err(ReadError::CorruptIndex { .. } | ReadError::Rewritten { .. }) if self.folder.forget(&path) => open(),
            opened => opened,
        }
    }

    /// Decodes the chunk of index entry `slot`, brick `id`, of an open shard into `out`. Absent chunks are all zero.
    pub(crate) fn read_in(&self, shard: &ShardFile, slot: usize, id: BrickId, out: &mut [u8]) -> Result<(), ReadError> {
        let path = || self.path(self.layout.shard_of(id).0);
        let corrupt = |error| ReadError::CorruptIndex { path: path(), error };
        let Some(range) = shard.range(slot).map_err(corrupt)? else {
            out.fill(0);
            return Ok(());
        };
        self.bytes_read.fetch_add(range.length, Ordering::Relaxed);
        if let Some(arrived) = &self.arrived {
            return self.read_arrived(arrived, shard, (slot, range), id, out);
        }
        Scratch::with(|scratch| {
            let mut encoded = std::mem::take(&mut scratch.encoded);
            let bytes = shard.bytes(range, &mut encoded);
            let decoded = bytes.map(|bytes| self.codec.decode(scratch, bytes, out));
            scratch.encoded = encoded;
            decoded
                .map_err(|error| self.folder.unreadable(&path(), error))?
                .map_err(|error| shard.unreadable(&self.folder, &path(), id, error))
        })
    }

    /// Decodes a chunk of a store at an address, fetched unless it was before. One that was damaged on the way is fetched once more.
    fn read_arrived(
        &self,
        arrived: &Arrived,
        shard: &ShardFile,
        (slot, range): (usize, BrickRange),
        id: BrickId,
        out: &mut [u8],
    ) -> Result<(), ReadError> {
        let shard_id = self.layout.shard_of(id).0;
        let (place, path) = ((shard_id, range.offset), || self.path(shard_id));
        let mut has_failed = false;
        loop {
            let Some(chunk) = arrived.take(place) else {
                let fetched = fetch_in(arrived, shard, shard_id, &[slot]);
                fetched.map_err(|error| self.folder.unreadable(&path(), error))?;
                continue;
            };
            match Scratch::with(|scratch| self.codec.decode(scratch, &chunk, out)) {
                Ok(()) => return Ok(()),
                Err(error) if has_failed => return Err(shard.unreadable(&self.folder, &path(), id, error)),
                Err(_) => has_failed = true,
            }
            arrived.forget(place);
            self.folder.forget(&path());
        }
    }

    /// The codec of the chunks.
    pub(crate) fn codec(&self) -> &BrickCodec {
        &self.codec
    }

    pub(crate) fn fingerprint(&self, id: ShardId) -> Result<Fingerprint, ReadError> {
        let ([x, y, z], place) = Paging::new(self.layout.shard_grid(id.level)).locate([id.x, id.y, id.z]);
        let page = PageId { time: id.group, channel: id.channel, level: id.level, z, y, x };
        let kept = || lock(&self.fingerprints).get(&page).map(|kept| kept[place]);
        if let Some(kept) = kept() {
            return Ok(kept);
        }
        let _turn = self.paging.take(page);
        if let Some(kept) = kept() {
            return Ok(kept);
        }
        let array = SideArray::fingerprints(self.folder.path(), &self.layout, id.level);
        let read: Arc<[Fingerprint]> = array.read_fingerprints(&self.folder, page)?.into();
        lock(&self.fingerprints).put(page, read.clone());
        Ok(read[place])
    }

    /// Whether a shard's file exists, regardless of the side data.
    pub(crate) fn has_file(&self, id: ShardId) -> bool {
        self.folder.file(&self.path(id)).is_ok()
    }

    pub(crate) fn path(&self, id: ShardId) -> PathBuf {
        self.layout.shard_path(self.folder.path(), id)
    }
}

/// Fetches chunks of a shard at an address, by their entries of its index, unless they are here or under way. Chunks in small gaps between them are
/// taken along: a gap costs its bytes, and another request a turn. Returns the bytes.
fn fetch_in(arrived: &Arrived, shard: &ShardFile, id: ShardId, slots: &[usize]) -> io::Result<u64> {
    let mut wanted: Vec<BrickRange> = slots.iter().filter_map(|slot| shard.range(*slot).ok().flatten()).collect();
    wanted.sort_unstable_by_key(|range| range.offset);
    let mut under_way = arrived.begin(wanted.iter().map(|range| (id, range.offset)));
    wanted.retain(|range| under_way.places().contains(&(id, range.offset)));
    wanted.dedup_by_key(|range| range.offset);
    let mut along = Vec::new();
    for pair in wanted.windows(2) {
        let (end, next) = (pair[0].offset + pair[0].length, pair[1].offset);
        if end < next && next - end <= MOST_GAP_BYTES.max(pair[0].length / GAP_SHARE) {
            let between = shard.ranges_within(end..next);
            let places: Vec<_> = between.iter().map(|range| (id, range.offset)).collect();
            if under_way.takes_along(&places) {
                along.extend(between);
            }
        }
    }
    wanted.extend(along);
    let chunks = shard.fetch(&wanted)?;
    let bytes = chunks.iter().map(|chunk| chunk.len() as u64).sum();
    under_way.arrive(chunks);
    Ok(bytes)
}

/// Keeps all chunks of a shard of which every byte was read.
fn keep_all(arrived: &Arrived, shard: &ShardFile, id: ShardId, whole: &[u8]) {
    let ranges = shard.ranges_within(0..whole.len() as u64);
    let under_way = arrived.begin(ranges.iter().map(|range| (id, range.offset)));
    let chunk = |(_, offset): &(ShardId, u64)| {
        let range = ranges.iter().find(|range| range.offset == *offset);
        range.and_then(|range| whole.get(range.as_range())).unwrap_or_default().to_vec()
    };
    under_way.arrive(under_way.places().iter().map(chunk).collect());
}

/// Largest gap between two chunks that is read with them: so many bytes, or such a share of the chunk before it.
const MOST_GAP_BYTES: u64 = 8 << 10;
const GAP_SHARE: u64 = 4;

/// Bytes of an open shard besides its index, including the cache entry.
const SHARD_BYTES: u64 = 256;

/// Bytes of the index of a level-0 shard, the largest of all levels.
fn shard_index_bytes(layout: &Layout) -> usize {
    index_bytes(layout.shard_slots(Level(0)))
}

/// Most memory of open shards and cached pages, in bytes.
pub(crate) fn cache_bytes(layout: &Layout, mode: IoMode) -> u64 {
    let array = SideArray::fingerprints(Path::new(""), layout, Level(0));
    let levels = layout.pyramid.levels().len() as u64;
    let pages = (KEPT_PAGES as u64).min(array.page_count().saturating_mul(levels));
    let shards = (most_open(layout, mode).get() as u64).min(layout.shard_count());
    pages * array.page_bytes() as u64 + shards * (shard_index_bytes(layout) as u64 + SHARD_BYTES)
}

fn most_open(layout: &Layout, mode: IoMode) -> NonZeroUsize {
    let most = if mode == IoMode::Mmap { MOST_OPEN } else { MOST_FILES };
    at_least_one((MOST_INDEX_BYTES / shard_index_bytes(layout)).clamp(2, most))
}

fn at_least_one(n: usize) -> NonZeroUsize {
    NonZeroUsize::new(n).unwrap_or(NonZeroUsize::MIN)
}
