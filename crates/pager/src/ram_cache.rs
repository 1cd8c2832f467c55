//! RAM cache of decoded cores, as voxels of the source, and of the shells from which neighbours copy their aprons, in a fixed number of
//! buffers.
//!
//! Missing cores are decoded on the caller's thread. Other threads in need of the same brick first decode their remaining ones and then
//! wait, so no core is decoded twice at a time. A decode yields a core and its shell (see [`Layout`]). A padded brick takes its own part
//! from the core and all others from shells: the core may go once its brick is assembled, while its far smaller shell stays for the
//! neighbours. Each kind has a shelf (see [`Shelf`] for the eviction order). With stored aprons, a decode yields a core and its apron,
//! there are no shells, and one entry holds everything for its padded brick.
//!
//! Where the source keeps hashes, cores equal in several time steps are kept and decoded once (`sameness.rs`). No thread waits while
//! holding a buffer, so one buffer of each kind suffices for any number of threads. Unreadable cores are remembered, logged once, and
//! retried if the reason may pass (`retry.rs`). Looking up all cached parts of a padded brick costs one lock.

use crate::apron_copy::copy_shell;
use crate::budget::{Meter, PagerError};
use crate::buffer_lru::Shelf;
use crate::layout::Layout;
use crate::neighbourhood::Part;
use crate::retry::{Failure, Failures};
use crate::sameness::{Content, CoreHashes, CoreKey};
use crate::slot_contents::SlotContents;
use crate::source::{BrickError, BrickSource, caught};
use crate::status::Counters;
use brickyard_volume::BrickId;
use rustc_hash::FxHashSet;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Host-memory cache of one source's decoded bricks.
pub struct RamCache {
    source: Arc<dyn BrickSource>,
    /// Bytes read by the source before.
    bytes_read_before: u64,
    pub(crate) layout: Layout,
    /// Contents of the padded bricks' slots.
    pub(crate) contents: SlotContents,
    /// Hashes for finding equal cores of several time steps; `None` if not compared.
    hashes: Option<CoreHashes>,
    inner: Mutex<Inner>,
    /// Notified when a brick is made.
    made: Condvar,
}

struct Inner {
    cores: Shelf,
    shells: Shelf,
    failures: Failures,
    /// Bricks whose stored aprons could not be read.
    failed_aprons: FxHashSet<CoreKey>,
    has_shells: bool,
    /// Bricks with a core or shell in the making.
    making: FxHashSet<CoreKey>,
    counters: DecodeCounters,
}

/// Decoded cores of one source, to be reused by another cache: see [`Pager::into_cores`](crate::Pager::into_cores).
pub struct KeptCores {
    source: Arc<dyn BrickSource>,
    /// Width of the aprons behind the cores in voxels; 0 if there are none.
    stored_apron: usize,
    /// The most recently used first.
    cores: Vec<(CoreKey, Arc<[u8]>)>,
}

/// A brick in the making, in buffers not yet shared.
struct Making {
    core: Arc<[u8]>,
    /// Whether only the shell is missing from the cache.
    is_cached: bool,
    /// `None` if cached, or without shells.
    shell: Option<Arc<[u8]>>,
}

/// A part of a padded brick, and its lender.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wanted {
    pub(crate) part: Part,
    lender: BrickId,
    key: CoreKey,
}

/// A core with its stored apron.
pub(crate) struct Whole {
    /// Voxels of the core, then of the apron.
    pub(crate) voxels: Arc<[u8]>,
    pub(crate) has_apron: bool,
}

/// Decoding counts of a cache.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DecodeCounters {
    /// Decoded cores, repeats included.
    pub decoded: u64,
    /// Bytes of decoded voxels, stored aprons included.
    pub bytes_decoded: u64,
    /// Unreadable cores and stored aprons, each counted once.
    pub failed: u64,
}

impl RamCache {
    /// Creates a cache of at most `bytes` for the cores of `source`, to assemble bricks with this apron.
    ///
    /// # Errors
    /// If not even one core fits, or the apron does not fit the bricks (see [`PagerError::Apron`]).
    pub fn new(source: Arc<dyn BrickSource>, apron: u32, bytes: u64) -> Result<Self, PagerError> {
        let layout = Layout::new(&*source, apron, 0, &SlotContents::Codes)?;
        let core = layout.cached_bytes() as u64;
        match bytes / core {
            0 => Err(PagerError::HostMemory { given: bytes, least: core }),
            cores => {
                let meter = Arc::new(Meter::new(bytes));
                Ok(Self::with_meter(source, layout, SlotContents::Codes, cores as usize, true, meter))
            }
        }
    }

    /// Creates a cache for `cores` cores of padded bricks; `keeps_done` retains finished ones while there is room.
    pub(crate) fn with_meter(
        source: Arc<dyn BrickSource>,
        layout: Layout,
        contents: SlotContents,
        cores: usize,
        keeps_done: bool,
        meter: Arc<Meter>,
    ) -> Self {
        let inner = Inner {
            cores: Shelf::new(layout.entry_bytes(), cores, keeps_done, meter.clone()),
            shells: Shelf::new(layout.shell_bytes(), layout.shells(cores), keeps_done, meter),
            failures: Failures::default(),
            failed_aprons: FxHashSet::default(),
            has_shells: !layout.has_stored(),
            making: FxHashSet::default(),
            counters: DecodeCounters::default(),
        };
        let (bytes_read_before, inner) = (source.bytes_read(), Mutex::new(inner));
        Self { source, bytes_read_before, layout, contents, hashes: None, inner, made: Condvar::new() }
    }

    /// Keeps cores that several time steps share once, with at most `kept_bytes` of hash pages.
    pub(crate) fn comparing(self, kept_bytes: u64) -> Self {
        Self { hashes: CoreHashes::new(&self.source, kept_bytes), ..self }
    }

    /// Content of a padded brick, for finding equal ones of other time steps; `None` if unknown.
    pub(crate) fn content(&self, id: BrickId) -> Option<Content> {
        self.hashes.as_ref()?.of_padded(id)
    }

    /// Cache key of a core. A stored apron belongs to the core, but consists of the neighbours' voxels.
    fn key(&self, id: BrickId) -> CoreKey {
        let hash = self.hashes.as_ref().and_then(|hashes| match self.layout.has_stored() {
            true => hashes.of_padded(id).map(|content| content.hash),
            false => hashes.of_core(id),
        });
        CoreKey::new(id, hash)
    }

    /// The cached cores, except those with an unreadable stored apron. To be called once no thread reads through the cache any more.
    pub(crate) fn kept_cores(&self) -> KeptCores {
        let inner = self.lock();
        let is_whole = |(key, _): &(CoreKey, &Arc<[u8]>)| !inner.failed_aprons.contains(key);
        let cores = inner.cores.entries().filter(is_whole).map(|(key, voxels)| (key, voxels.clone())).collect();
        KeptCores { source: self.source.clone(), stored_apron: self.layout.stored, cores }
    }

    /// Takes over another cache's cores, the most recently used as far as there is room. Drops the others, and all cores of another source
    /// or with other stored aprons.
    pub(crate) fn adopt(&self, kept: KeptCores) {
        if !kept.is_of(&self.source) || kept.stored_apron != self.layout.stored {
            return;
        }
        let mut inner = self.lock();
        let count = inner.cores.room().min(kept.cores.len());
        for (key, voxels) in kept.cores.into_iter().take(count).rev() {
            inner.cores.adopt(key, voxels, Part::OWN.bit());
        }
    }

    /// The source of the cores.
    pub fn source(&self) -> &Arc<dyn BrickSource> {
        &self.source
    }

    /// Counts of decodes and failures so far.
    pub fn counters(&self) -> DecodeCounters {
        self.lock().counters
    }

    /// Totals since the cache's creation, with the bytes read by its source for anybody.
    pub(crate) fn totals(&self) -> Counters {
        let DecodeCounters { decoded, bytes_decoded, failed } = self.counters();
        let bytes_read = self.source.bytes_read() - self.bytes_read_before;
        Counters { decoded, bytes_read, bytes_decoded, failed, ..Counters::default() }
    }

    pub(crate) fn wanted(&self, part: Part, lender: BrickId) -> Wanted {
        Wanted { part, lender, key: self.key(lender) }
    }

    /// Whether a brick's core is decoded.
    pub(crate) fn holds(&self, id: BrickId) -> bool {
        self.lock().take(Part::OWN, self.key(id)).is_some()
    }

    /// Cached voxels for each part of a padded brick, by part number: its own core, or a neighbour's shell. `None` if not cached or not
    /// requested. Drop the voxels before requesting more.
    pub(crate) fn cached(&self, wanted: &[Wanted]) -> [Option<Arc<[u8]>>; Part::COUNT] {
        let mut inner = self.lock();
        let mut voxels = [const { None }; Part::COUNT];
        for &Wanted { part, key, .. } in wanted {
            voxels[part.number()] = inner.take(part, key);
        }
        voxels
    }

    /// Returns voxels for one of the parts, and its index in `wanted`: the first cached part, or else the first that no thread is decoding,
    /// which is then decoded. Threads with common neighbours thus share the work, and wait only when everything left is being decoded. Drop
    /// the voxels before requesting others.
    ///
    /// # Panics
    /// If `wanted` is empty.
    pub(crate) fn one_of(&self, wanted: &[Wanted]) -> (usize, Result<Arc<[u8]>, Failure>) {
        assert!(!wanted.is_empty(), "nothing is wanted");
        let mut inner = self.lock();
        // The thread's own product first: another thread may need its buffers.
        let mut made = None;
        loop {
            for i in made.into_iter().chain(0..wanted.len()) {
                let Wanted { part, lender, key } = wanted[i];
                if let Some(voxels) = inner.take(part, key) {
                    return (i, Ok(voxels));
                }
                if let Some(failure) = inner.failures.of(lender) {
                    return (i, Err(failure));
                }
            }
            let started = wanted.iter().enumerate().find_map(|(i, wanted)| Some((i, inner.start(wanted.key)?)));
            inner = match started {
                Some((i, making)) => {
                    drop(inner);
                    made = Some(i);
                    self.make(wanted[i].lender, wanted[i].key, making)
                }
                None => self.wait(inner),
            };
        }
    }

    /// A core with its stored apron, decoded if needed. Drop it before requesting another.
    pub(crate) fn whole(&self, id: BrickId) -> Result<Whole, Failure> {
        let wanted = self.wanted(Part::OWN, id);
        let voxels = self.one_of(&[wanted]).1?;
        Ok(Whole { voxels, has_apron: !self.lock().failed_aprons.contains(&wanted.key) })
    }

    /// Grants one more try to bricks that failed for passing reasons, and returns them.
    pub(crate) fn renew_failures(&self) -> Vec<BrickId> {
        self.lock().failures.renew()
    }

    /// Decodes a claimed brick, and caches it or the failure.
    fn make(&self, id: BrickId, key: CoreKey, mut making: Making) -> MutexGuard<'_, Inner> {
        let result = self.fill(id, &mut making);
        let lent = Part::lent_by(id.index, self.source.pyramid().level(id.level).bricks);
        let mut inner = self.lock();
        inner.making.remove(&key);
        // A core whose apron may yet be read is not accepted without it.
        let result = match result {
            Ok(Some(Err(err))) if !inner.failures.is_last_try(id, &err) => Err(err),
            other => other,
        };
        match result {
            Ok(apron) => {
                inner.failures.remove(id);
                if !making.is_cached {
                    inner.counters.decoded += 1;
                    inner.counters.bytes_decoded += self.layout.core_bytes() as u64;
                    inner.cores.put(key, making.core, Part::OWN.bit());
                }
                if let Some(shell) = making.shell {
                    inner.shells.put(key, shell, lent);
                }
                inner.note_apron(key, apron, self.layout.stored_apron_bytes() as u64);
            }
            Err(err) => {
                inner.give_back(making);
                let message = format!("{err}; a coarser brick stands in");
                if inner.failures.add(id, err) {
                    inner.note_failure(&message);
                }
            }
        }
        self.made.notify_all();
        inner
    }

    /// Decodes the core and cuts its shell, as far as needed. Returns the result for any stored apron.
    fn fill(&self, id: BrickId, making: &mut Making) -> Result<Option<Result<(), BrickError>>, BrickError> {
        let mut stored = None;
        // Buffers of a shelf have one holder, so nothing is ever copied here.
        if !making.is_cached {
            let (core, apron) = Arc::make_mut(&mut making.core).split_at_mut(self.layout.core_bytes());
            caught(id, "the decoder", || self.source.read_core(id, core))?;
            stored = (!apron.is_empty()).then(|| caught(id, "the decoder", || self.source.read_apron(id, apron)));
        }
        if let Some(shell) = &mut making.shell {
            copy_shell(&self.layout, &making.core, Arc::make_mut(shell));
        }
        Ok(stored)
    }

    fn wait<'a>(&self, inner: MutexGuard<'a, Inner>) -> MutexGuard<'a, Inner> {
        // With all buffers in use, dropping one wakes no thread: look again soon.
        let soon = Duration::from_millis(1);
        self.made.wait_timeout(inner, soon).unwrap_or_else(PoisonError::into_inner).0
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        // Only allocation can panic under the lock, and the state is consistent at every step.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl KeptCores {
    pub(crate) fn is_of(&self, source: &Arc<dyn BrickSource>) -> bool {
        Arc::ptr_eq(&self.source, source)
    }
}

/// Unreadable bricks logged as warnings. A damaged file has thousands; their count is reported with the picture.
const NAMED: u64 = 3;

impl Inner {
    fn note_failure(&mut self, message: &str) {
        if self.counters.failed < NAMED {
            tracing::warn!("{message}");
        } else {
            tracing::debug!("{message}");
        }
        self.counters.failed += 1;
    }

    fn note_apron(&mut self, key: CoreKey, apron: Option<Result<(), BrickError>>, bytes: u64) {
        match apron {
            Some(Ok(())) => {
                self.counters.bytes_decoded += bytes;
                self.failed_aprons.remove(&key);
            }
            Some(Err(err)) if self.failed_aprons.insert(key) => {
                self.note_failure(&format!("apron of {err}; the neighbours' own voxels stand in"));
            }
            _ => {}
        }
    }

    fn take(&mut self, part: Part, lender: CoreKey) -> Option<Arc<[u8]>> {
        let shelf = if part == Part::OWN { &mut self.cores } else { &mut self.shells };
        shelf.take(lender, part.bit())
    }

    /// Claims a brick and buffers for its missing parts; `None` while another thread holds these.
    fn start(&mut self, key: CoreKey) -> Option<Making> {
        if self.making.contains(&key) {
            return None;
        }
        let cached = self.cores.peek(key).cloned();
        let is_cached = cached.is_some();
        let core = cached.or_else(|| self.cores.buffer())?;
        let mut making = Making { core, is_cached, shell: None };
        if self.has_shells && self.shells.peek(key).is_none() {
            making.shell = self.shells.buffer();
            if making.shell.is_none() {
                self.give_back(making);
                return None;
            }
        }
        self.making.insert(key);
        Some(making)
    }

    fn give_back(&mut self, making: Making) {
        if !making.is_cached {
            self.cores.give_back(making.core);
        }
        if let Some(shell) = making.shell {
            self.shells.give_back(shell);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_source::TestSource;
    use brickyard_volume::{BrickIndex, Extent, Level, Pyramid, VoxelType};

    /// Bytes of a cached core: 8^3 voxels and four shells of six sides of 8^2.
    const CORE: u64 = 512 + 4 * 384;

    /// The part lent to the next brick along x.
    const NEXT: Part = Part { side: [0, 1, 1] };

    fn brick(x: u32) -> BrickId {
        BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(x, 0, 0) }
    }

    impl RamCache {
        /// Voxels for one part, decoded if needed. Drop them before requesting others.
        fn part(&self, part: Part, lender: BrickId) -> Result<Arc<[u8]>, Failure> {
            self.one_of(&[self.wanted(part, lender)]).1
        }
    }

    fn cache(cores: u64) -> RamCache {
        RamCache::new(Arc::new(TestSource::cube(64)), 1, cores * CORE).unwrap()
    }

    fn own(cache: &RamCache, x: u32) -> Arc<[u8]> {
        cache.part(Part::OWN, brick(x)).unwrap()
    }

    #[test]
    fn the_least_recently_used_core_makes_room() {
        let cache = cache(2);
        for (x, decoded) in [(0, 1), (1, 2), (0, 2), (2, 3), (0, 3), (1, 4)] {
            own(&cache, x);
            assert_eq!(cache.counters().decoded, decoded, "after {x}");
        }
    }

    #[test]
    fn a_core_goes_once_its_brick_has_taken_it_and_its_shell_stays() {
        let cache = cache(2);
        cache.part(NEXT, brick(0)).unwrap();
        for x in 1..4 {
            own(&cache, x);
        }
        assert_eq!(cache.counters().decoded, 4);
        // The core of brick 0 was never taken; of the others only the shells are left.
        own(&cache, 0);
        (0..4).for_each(|x| drop(cache.part(NEXT, brick(x)).unwrap()));
        assert_eq!(cache.counters().decoded, 4);
        own(&cache, 1);
        assert_eq!(cache.counters().decoded, 5);
    }

    #[test]
    fn a_shell_goes_once_all_neighbours_have_taken_their_parts() {
        let row = TestSource::new(Pyramid::new(Extent::new(64, 8, 8), [1.0; 3], 8), [1.0; 3], VoxelType::U8);
        let cache = RamCache::new(Arc::new(row), 1, CORE).unwrap();
        let previous = Part { side: [2, 1, 1] };
        for (part, x) in [(NEXT, 3), (NEXT, 2), (NEXT, 1), (previous, 1), (NEXT, 4), (NEXT, 5)] {
            cache.part(part, brick(x)).unwrap();
        }
        let cached: Vec<u32> =
            (0..8).filter(|&x| cache.lock().shells.peek(CoreKey::new(brick(x), None)).is_some()).collect();
        assert_eq!(cached, [2, 3, 4, 5]);
    }

    #[test]
    fn a_shell_is_made_again_from_a_cached_core() {
        let cache = cache(2);
        let before = cache.part(NEXT, brick(0)).unwrap().to_vec();
        let core = own(&cache, 0);
        // Eight shells fit: these evict the shell of brick 0, whose core is held.
        for i in 1..9 {
            let id = BrickId { index: BrickIndex::new(i % 8, i / 8, 0), ..brick(0) };
            cache.part(Part::OWN, id).unwrap();
        }
        drop(core);
        assert!(cache.lock().shells.peek(CoreKey::new(brick(0), None)).is_none());
        let decoded = cache.counters().decoded;
        assert_eq!(cache.part(NEXT, brick(0)).unwrap()[..], before);
        assert_eq!(cache.counters().decoded, decoded);
    }

    #[test]
    fn codes_in_use_are_not_overwritten() {
        let cache = cache(2);
        let held = [own(&cache, 0), cache.part(NEXT, brick(0)).unwrap()];
        let before = held.each_ref().map(|codes| codes.to_vec());
        for x in 1..8 {
            own(&cache, x);
            (0..4).for_each(|y| {
                let id = BrickId { index: BrickIndex::new(x, y, 0), ..brick(0) };
                drop(cache.part(NEXT, id).unwrap());
            });
        }
        assert_eq!(held.each_ref().map(|codes| codes.to_vec()), before);
    }

    #[test]
    fn failures_and_panics_are_remembered() {
        let mut source = TestSource::cube(64);
        source.failing.insert(brick(1));
        source.panicking.insert(brick(2));
        let cache = RamCache::new(Arc::new(source), 1, CORE).unwrap();
        for part in [Part::OWN, NEXT] {
            assert!(cache.part(part, brick(1)).is_err());
            assert!(cache.part(part, brick(2)).unwrap_err().error.reason.contains("panicked"));
        }
        own(&cache, 3);
        assert_eq!(cache.counters(), DecodeCounters { decoded: 1, bytes_decoded: 512, failed: 2 });
        assert!(matches!(
            RamCache::new(cache.source().clone(), 1, CORE - 1),
            Err(PagerError::HostMemory { least: CORE, .. })
        ));
    }

    #[test]
    fn threads_that_want_one_brick_decode_it_once() {
        let cache = cache(64);
        std::thread::scope(|scope| {
            for part in [Part::OWN, NEXT, Part::OWN, NEXT] {
                let cache = &cache;
                scope.spawn(move || (0..8).for_each(|x| drop(cache.part(part, brick(x)).unwrap())));
            }
        });
        assert_eq!(cache.counters().decoded, 8);
    }
}
