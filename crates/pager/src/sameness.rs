//! Equal bricks of several time steps, found by the source's hashes of its cores. Unchanged bricks are neither decoded nor uploaded again.
//!
//! Two cores are equal if their hashes are; two padded bricks if their own and all neighbours' hashes are, since aprons come from
//! neighbours. Each step has its own hashes, independent of the steps between: playing on, back or round and jumping cost the same.
//! Workers compare before reading a brick; pages of hashes are read then, and kept within a budget. A brick with an unreadable or missing
//! hash differs from all others. Costs about 2 us per brick, and a page of hashes for each step and level.

use crate::draw_list::Slot;
use crate::neighbourhood::Part;
use crate::source::BrickSource;
use brickyard_volume::{BrickId, Level, PageId};
use lru::LruCache;
use rustc_hash::FxHashMap;
use std::num::NonZeroUsize;
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};
use xxhash_rust::xxh3::Xxh3Default;

/// Content of a padded brick, whatever its time step; equal contents are equal voxel by voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Content {
    /// The brick, in step 0.
    pub(crate) id: BrickId,
    pub(crate) hash: u128,
}

/// Cache key of a core: its brick, with the hash, if known, in place of the time step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct CoreKey {
    id: BrickId,
    hash: Option<u128>,
}

impl CoreKey {
    /// Key of a brick; in step 0 if the hash is known, else in its own.
    pub(crate) fn new(id: BrickId, hash: Option<u128>) -> Self {
        Self { id: if hash.is_some() { BrickId { time: 0, ..id } } else { id }, hash }
    }
}

/// Core hashes of a source, read page by page.
pub(crate) struct CoreHashes {
    source: Arc<dyn BrickSource>,
    /// The most recently used pages, each read once, by its first user; only others in need of the same page wait.
    pages: Mutex<LruCache<PageId, Arc<OnceLock<HashPage>>>>,
}

/// Hashes of a page; `None` if unreadable.
type HashPage = Option<Arc<[u128]>>;

/// Most bytes of a page of a source's hashes.
fn page_bytes(source: &dyn BrickSource) -> u64 {
    let levels = (0..source.pyramid().levels().len()).map(|level| Level(level as u8));
    let cells = levels.map(|level| source.pyramid().paging(level).page_cells()).max().unwrap_or(0);
    cells as u64 * size_of::<u128>() as u64 + 128
}

/// Whether bricks of several time steps of a source can be found equal.
fn can_be_same(source: &dyn BrickSource) -> bool {
    source.times() > 1 && source.keeps_hashes()
}

/// Bytes of a host budget for hash pages: a 64th of it, at least 64 pages; 0 if there is nothing to compare.
pub(crate) fn kept_hash_bytes(source: &dyn BrickSource, host_bytes: u64) -> u64 {
    const LEAST_PAGES: u64 = 64;
    if !can_be_same(source) {
        return 0;
    }
    let all = source.pyramid().page_count().saturating_mul(source.times() as u64 * source.channels() as u64);
    let page = page_bytes(source);
    (host_bytes / 64).max(LEAST_PAGES.min(all) * page).min(all.saturating_mul(page))
}

impl CoreHashes {
    /// Hashes of a source, with `kept_bytes` of pages, or one page if that is more; `None` if there is nothing to compare.
    pub(crate) fn new(source: &Arc<dyn BrickSource>, kept_bytes: u64) -> Option<Self> {
        let capacity = NonZeroUsize::new((kept_bytes / page_bytes(&**source)) as usize).unwrap_or(NonZeroUsize::MIN);
        can_be_same(&**source).then(|| Self { source: source.clone(), pages: Mutex::new(LruCache::new(capacity)) })
    }

    pub(crate) fn of_core(&self, id: BrickId) -> Option<u128> {
        self.all_of(std::iter::once(id), |hash| hash)
    }

    /// Content of a padded brick; `None` if unknown. At a level's faces a brick has fewer neighbours, but the same ones in all time steps.
    pub(crate) fn of_padded(&self, id: BrickId) -> Option<Content> {
        let grid = self.source.pyramid().level(id.level).bricks;
        let bricks = Part::lenders(id.index, grid).map(|index| BrickId { index, ..id });
        let mut hasher = Xxh3Default::new();
        self.all_of(bricks, |hash| hasher.update(&hash.to_le_bytes()))?;
        Some(Content { id: BrickId { time: 0, ..id }, hash: hasher.digest128() })
    }

    /// Passes the hashes of bricks to `tell`. Returns its last result; `None` at the first unknown hash.
    fn all_of<T>(&self, bricks: impl Iterator<Item = BrickId>, mut tell: impl FnMut(u128) -> T) -> Option<T> {
        let mut last = None;
        let mut kept: Option<(PageId, Arc<OnceLock<HashPage>>)> = None;
        for id in bricks {
            let (page, place) = self.source.pyramid().page_of(id);
            let (_, hashes) = match &kept {
                Some(kept) if kept.0 == page => kept,
                _ => kept.insert((page, self.page(page))),
            };
            last = Some(tell(*hashes.get_or_init(|| self.read(page)).as_ref()?.get(place)?));
        }
        last
    }

    /// A page, read or not.
    fn page(&self, page: PageId) -> Arc<OnceLock<HashPage>> {
        self.pages.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(page, Arc::default).clone()
    }

    fn read(&self, page: PageId) -> Option<Arc<[u128]>> {
        let read = self.source.read_hashes(page);
        read.inspect_err(|error| tracing::debug!(%error, "all bricks count as changed")).ok().map(Arc::from)
    }
}

/// Contents of a volume's slots, written as slots are filled, and read by the workers.
#[derive(Default)]
pub(crate) struct SlotsByContent(Mutex<FxHashMap<Content, Slot>>);

impl SlotsByContent {
    pub(crate) fn lock(&self) -> MutexGuard<'_, FxHashMap<Content, Slot>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
