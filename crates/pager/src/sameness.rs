//! Which bricks of a volume are the same in several time steps: by the hashes that the source keeps of its bricks' cores. What has not changed is neither
//! decoded nor uploaded again.
//!
//! A core is the same where its hash is; a padded brick where its own hash and those of all its neighbours are, since its apron is theirs. Hashes are
//! asked of the step itself: no step need be known for another one to be found equal to it, so playing on, back or round and jumping cost the
//! same. Workers ask, before they read a brick; pages of hashes are read then, and kept within a budget. A hash that cannot be read, or is not kept,
//! makes a brick differ from all others. Cost: about 2 us a brick, and a page of hashes for each step and level.

use crate::draw_list::Slot;
use crate::neighbourhood::Part;
use crate::source::BrickSource;
use brickyard_volume::{BrickId, BrickIndex, Level, PageId};
use lru::LruCache;
use rustc_hash::FxHashMap;
use std::num::NonZeroUsize;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};
use xxhash_rust::xxh3::Xxh3Default;

/// The content of a padded brick, whatever its time step: two bricks of one content are equal, voxel by voxel.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct Content {
    channel: u32,
    level: Level,
    index: BrickIndex,
    hash: u128,
}

/// The key of a core in the cache: its brick, in the time step 0 with its hash where that is known, else in its own step.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub(crate) struct CoreKey {
    id: BrickId,
    hash: Option<u128>,
}

impl Content {
    #[cfg(test)]
    pub(crate) fn for_test(id: BrickId, hash: u128) -> Self {
        Self { channel: id.channel, level: id.level, index: id.index, hash }
    }

    /// The hash of the voxels.
    pub(crate) fn hash(&self) -> u128 {
        self.hash
    }
}

impl CoreKey {
    /// The key of a brick whose hash is known, or is not.
    pub(crate) fn new(id: BrickId, hash: Option<u128>) -> Self {
        Self { id: if hash.is_some() { BrickId { time: 0, ..id } } else { id }, hash }
    }
}

/// The hashes of the cores of a source's bricks, read page by page.
pub(crate) struct CoreHashes {
    source: Arc<dyn BrickSource>,
    /// The pages that were used last. Each is read once, by who asks first; the others who want it wait for that, and nobody else does.
    pages: Mutex<LruCache<PageId, Arc<OnceLock<HashPage>>>>,
}

/// The hashes of a page; `None` if they cannot be read.
type HashPage = Option<Arc<[u128]>>;

/// Bytes of a page of a source's hashes, at most.
fn page_bytes(source: &dyn BrickSource) -> u64 {
    let levels = (0..source.pyramid().levels().len()).map(|level| Level(level as u8));
    let cells = levels.map(|level| source.pyramid().paging(level).page_cells()).max().unwrap_or(0);
    cells as u64 * size_of::<u128>() as u64 + 128
}

/// Whether bricks of several time steps of a source can be found equal.
fn can_be_same(source: &dyn BrickSource) -> bool {
    source.times() > 1 && source.keeps_hashes()
}

/// The bytes of a host budget in which pages of hashes are kept: a 64th of it, but room for 64 pages at least; none where there is nothing to compare.
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
    /// The hashes of a source of which `kept_bytes` of pages are kept, or one page if that is more; `None` where there is nothing to compare.
    pub(crate) fn new(source: &Arc<dyn BrickSource>, kept_bytes: u64) -> Option<Self> {
        let capacity = NonZeroUsize::new((kept_bytes / page_bytes(&**source)) as usize).unwrap_or(NonZeroUsize::MIN);
        can_be_same(&**source).then(|| Self { source: source.clone(), pages: Mutex::new(LruCache::new(capacity)) })
    }

    /// The hash of a brick's core; `None` if it is not known.
    pub(crate) fn of_core(&self, id: BrickId) -> Option<u128> {
        self.all_of(std::iter::once(id), |hash| hash)
    }

    /// Returns the content of a padded brick; `None` if it is not known. At the faces of its level a brick has fewer neighbours, and the same ones in all time steps.
    pub(crate) fn of_padded(&self, id: BrickId) -> Option<Content> {
        let grid = self.source.pyramid().level(id.level).bricks;
        let parts = Part::all().filter(|part| part.has_lender(id.index, grid));
        let bricks = parts.map(|part| BrickId { index: part.lender(id.index), ..id });
        let mut hasher = Xxh3Default::new();
        self.all_of(bricks, |hash| hasher.update(&hash.to_le_bytes()))?;
        let BrickId { channel, level, index, .. } = id;
        Some(Content { channel, level, index, hash: hasher.digest128() })
    }

    /// Tells the hashes of bricks one by one. Returns what was said of the last one; `None` as soon as a hash is not known.
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
        read.inspect_err(|error| tracing::debug!(%error, "bricks are taken for changed")).ok().map(Arc::from)
    }
}

/// The contents of a volume's slots: written by whoever fills the slots, and asked by the workers.
#[derive(Default)]
pub(crate) struct SlotsByContent {
    slots: Mutex<FxHashMap<Content, Slot>>,
}

impl SlotsByContent {
    /// The slot that holds a content.
    pub(crate) fn get(&self, content: &Content) -> Option<Slot> {
        self.slots.lock().unwrap_or_else(PoisonError::into_inner).get(content).copied()
    }

    /// Says which slot holds a content from now on.
    pub(crate) fn insert(&self, content: Content, slot: Slot) {
        self.slots.lock().unwrap_or_else(PoisonError::into_inner).insert(content, slot);
    }

    /// Says that no slot holds a content any more.
    pub(crate) fn remove(&self, content: &Content) {
        self.slots.lock().unwrap_or_else(PoisonError::into_inner).remove(content);
    }

    /// Says that the slots hold nothing.
    pub(crate) fn clear(&self) {
        self.slots.lock().unwrap_or_else(PoisonError::into_inner).clear();
    }
}
