//! Damage of a store: shards that are missing or do not decode to the recorded hashes, and unreadable pages of side
//! data.

use crate::chunks::Chunks;
use crate::error::ReadError;
use crate::layout::ShardId;
use crate::shard::Fingerprint;
use crate::side::{SideArray, core_hash};
use crate::store::Store;
use brickyard_import::is_of_process;
use brickyard_volume::{BrickId, Level, PageId};
use rayon::prelude::*;
use std::io::ErrorKind;

/// One array of shards: a level's cores or aprons.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ArrayId {
    /// Whether it belongs to the second pyramid.
    pub(super) is_second: bool,
    pub(super) level: Level,
    pub(super) are_aprons: bool,
}

/// Damage of one array.
pub(super) struct Damage {
    pub(super) array: ArrayId,
    /// Shards to be made again, in order.
    pub(super) shards: Vec<ShardId>,
    /// Unreadable pages of fingerprints.
    pub(super) fingerprints: Vec<PageId>,
    /// Unreadable pages of ranges and of hashes; of cores.
    pub(super) ranges: Vec<PageId>,
    pub(super) hashes: Vec<PageId>,
}

impl Damage {
    pub(super) fn is_none(&self) -> bool {
        self.shards.is_empty() && self.fingerprints.is_empty() && self.ranges.is_empty() && self.hashes.is_empty()
    }
}

/// An error's report, unless it is of the process: such errors end a repair.
pub(super) fn of_store<T>(read: Result<T, ReadError>) -> Result<Option<T>, ReadError> {
    match read {
        Ok(value) => Ok(Some(value)),
        Err(ReadError::Io { path, error }) if is_of_process(&error) => Err(ReadError::Io { path, error }),
        Err(error @ ReadError::Replaced { .. }) => Err(error),
        Err(_) => Ok(None),
    }
}

/// Recorded hashes of cores: the last page used.
#[derive(Default)]
pub(super) struct Hashes(Option<(PageId, Option<Vec<u128>>)>);

impl Hashes {
    /// A core's hash; `None` if its page is unreadable.
    pub(super) fn of(&mut self, store: &Store, id: BrickId) -> Result<Option<u128>, ReadError> {
        let (page, place) = store.pyramid().page_of(id);
        let hashes = match self.0.take() {
            Some((of, hashes)) if of == page => hashes,
            _ => of_store(store.read_hashes(page))?,
        };
        let hash = hashes.as_ref().map(|hashes| hashes[place]);
        self.0 = Some((page, hashes));
        Ok(hash)
    }
}

/// The pages of an array of side data.
fn pages(array: &SideArray, level: Level) -> impl ParallelIterator<Item = PageId> + '_ {
    (0..array.page_count()).into_par_iter().map(move |i| array.page_at(level, i))
}

/// The unreadable pages of an array.
fn lost_pages(store: &Store, array: &SideArray, level: Level) -> Result<Vec<PageId>, ReadError> {
    let read = |page| Ok(of_store(array.read_page(store.folder(), page))?.is_none().then_some(page));
    let found: Vec<Option<PageId>> = pages(array, level).map(read).collect::<Result<_, ReadError>>()?;
    Ok(found.into_iter().flatten().collect())
}

/// Examines one array, and for cores the level's side data. The rest of its shards is left out once `goes_on` is false.
pub(super) fn survey(
    store: &Store,
    chunks: &Chunks,
    array: ArrayId,
    goes_on: &(dyn Fn() -> bool + Sync),
) -> Result<Damage, ReadError> {
    let ArrayId { level, are_aprons, .. } = array;
    let of_chunks = SideArray::fingerprints(store.path(), chunks.layout(), level);
    let [ranges, hashes] = match are_aprons {
        true => Default::default(),
        false => {
            let ranges = SideArray::ranges(store.path(), store.layout(), level, store.voxel_type());
            let hashes = SideArray::hashes(store.path(), store.layout(), level);
            [lost_pages(store, &ranges, level)?, lost_pages(store, &hashes, level)?]
        }
    };
    let shards = (0..chunks.layout().level_shards(level)).into_par_iter().map(|i| chunks.layout().shard_at(level, i));
    let examined = shards.map_init(
        || Examiner { store, chunks, are_aprons, hashes: Hashes::default(), chunk: vec![0; chunks.chunk_bytes()] },
        |examiner, id| Ok((goes_on() && !examiner.is_sound(id)?).then_some(id)),
    );
    let damaged: Vec<Option<ShardId>> = examined.collect::<Result<_, ReadError>>()?;
    let fingerprints = lost_pages(store, &of_chunks, level)?;
    Ok(Damage { array, shards: damaged.into_iter().flatten().collect(), fingerprints, ranges, hashes })
}

/// The fingerprint of a shard by the side data; `None` if their page is unreadable.
pub(super) fn recorded(chunks: &Chunks, id: ShardId) -> Result<Option<Fingerprint>, ReadError> {
    of_store(chunks.fingerprint(id))
}

/// The fingerprint of a shard by its file, which may be damaged.
pub(super) fn of_file(store: &Store, chunks: &Chunks, id: ShardId) -> Result<Option<Fingerprint>, ReadError> {
    let path = chunks.path(id);
    let read = || -> std::io::Result<Fingerprint> {
        use std::os::unix::fs::FileExt;
        let file = store.folder().file(&path)?;
        let file_bytes = file.metadata()?.len();
        let mut crc = [0; 4];
        file.read_exact_at(&mut crc, file_bytes.saturating_sub(4))?;
        Ok(Fingerprint { file_bytes, index_crc: u32::from_le_bytes(crc).into() })
    };
    match read() {
        Err(error) if error.kind() == ErrorKind::NotFound => Ok(Some(Fingerprint::default())),
        read => of_store(read.map_err(|error| store.folder().unreadable(&path, error))),
    }
}

/// One thread's examination of shards.
struct Examiner<'a> {
    store: &'a Store,
    chunks: &'a Chunks,
    are_aprons: bool,
    hashes: Hashes,
    chunk: Vec<u8>,
}

impl Examiner<'_> {
    /// Whether a shard is as recorded, and its bricks are, too.
    fn is_sound(&mut self, id: ShardId) -> Result<bool, ReadError> {
        let known = recorded(self.chunks, id)?;
        let Some(fingerprint) = known.map_or_else(|| of_file(self.store, self.chunks, id), |known| Ok(Some(known)))?
        else {
            return Ok(false);
        };
        let shard = match fingerprint.has_file() {
            // A file too many would be read by other programs.
            false if self.chunks.has_file(id) => return Ok(false),
            // Nothing tells whether there was one.
            false if known.is_none() && self.are_aprons => return Ok(false),
            false => None,
            true => match of_store(self.chunks.open_as(id, fingerprint))? {
                Some(shard) if shard.overlap().is_ok_and(|overlap| overlap.is_none()) => Some(shard),
                _ => return Ok(false),
            },
        };
        let layout = self.chunks.layout();
        for (slot, brick) in
            (0..layout.shard_slots(id.level)).filter_map(|slot| Some((slot, layout.brick_at(id, slot)?)))
        {
            let read = shard.as_ref().map(|shard| self.chunks.read_in(shard, slot, brick, &mut self.chunk));
            match read.map(of_store).transpose()? {
                Some(None) => return Ok(false),
                Some(Some(())) => {}
                None => self.chunk.fill(0),
            }
            if self.are_aprons {
                continue;
            }
            match self.hashes.of(self.store, brick)? {
                Some(hash) if hash != core_hash(&self.chunk) => return Ok(false),
                None if known.is_none() && !fingerprint.has_file() => return Ok(false),
                _ => {}
            }
        }
        Ok(true)
    }
}
