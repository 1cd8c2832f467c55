//! The RAM brick cache: decoded cores as slot codes, least recently used first out, within a fixed number of buffers.
//!
//! It reads through: a core that is not there is decoded by the caller's thread, and others who want the same core wait
//! for it, so no core is decoded twice at a time. All buffers have one size and are used again, so a decode allocates nothing
//! once the cache is full. A buffer counts from its allocation on, whoever holds it. Callers hold one core at a time: then as
//! many buffers as threads are enough. Cores that could not be read are remembered, and logged once.

use crate::budget::{Meter, PagerError};
use crate::layout::Layout;
use crate::source::{BrickError, BrickSource};
use brickyard_volume::{BrickId, SlotEncoding, VoxelType};
use lru::LruCache;
use std::collections::{HashMap, HashSet};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

/// Decoded cores of one source.
pub struct RamCache {
    source: Arc<dyn BrickSource>,
    encoding: SlotEncoding,
    layout: Layout,
    capacity: usize,
    meter: Arc<Meter>,
    inner: Mutex<Inner>,
    /// A decode has ended.
    decoded: Condvar,
}

struct Inner {
    cores: LruCache<BrickId, Arc<[u8]>>,
    failed: HashMap<BrickId, BrickError>,
    decoding: HashSet<BrickId>,
    /// Buffers allocated, in whatever hands.
    allocated: usize,
    free: Vec<Arc<[u8]>>,
    counters: DecodeCounters,
}

/// What a cache has decoded so far.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct DecodeCounters {
    /// Cores decoded, with repeats.
    pub decoded: u64,
    /// Bytes of voxels that came out.
    pub bytes_decoded: u64,
    /// Cores that could not be read, each counted once.
    pub failed: u64,
}

impl RamCache {
    /// A cache of at most `bytes` for the cores of `source`, from which bricks with this apron are to be assembled.
    ///
    /// # Errors
    /// If not one core fits, or the apron is wider than a brick.
    pub fn new(source: Arc<dyn BrickSource>, apron: u32, bytes: u64) -> Result<Self, PagerError> {
        let layout = layout_of(&*source, apron)?;
        let core = layout.cached_bytes() as u64;
        match bytes / core {
            0 => Err(PagerError::HostMemory { given: bytes, least: core }),
            cores => Ok(Self::with_meter(source, layout, cores as usize, Arc::new(Meter::new(bytes)))),
        }
    }

    pub(crate) fn with_meter(source: Arc<dyn BrickSource>, layout: Layout, capacity: usize, meter: Arc<Meter>) -> Self {
        let inner = Inner {
            cores: LruCache::unbounded(),
            failed: HashMap::new(),
            decoding: HashSet::new(),
            allocated: 0,
            free: Vec::new(),
            counters: DecodeCounters::default(),
        };
        let encoding = encoding_of(&*source);
        Self { source, encoding, layout, capacity, meter, inner: Mutex::new(inner), decoded: Condvar::new() }
    }

    /// Where the cores come from.
    pub fn source(&self) -> &Arc<dyn BrickSource> {
        &self.source
    }

    /// How voxels become the codes that the cache holds.
    pub fn encoding(&self) -> SlotEncoding {
        self.encoding
    }

    /// What has been decoded so far.
    pub fn counters(&self) -> DecodeCounters {
        self.lock().counters
    }

    pub(crate) fn layout(&self) -> Layout {
        self.layout
    }

    /// Bytes of the buffer that a thread needs to decode: a core of voxels where these are not codes already.
    pub(crate) fn scratch_bytes(&self) -> usize {
        scratch_bytes(&*self.source, &self.encoding) as usize
    }

    /// The cached core of a brick (see [`Layout`]), decoded if need be. To be dropped before asking for another.
    pub(crate) fn core(&self, id: BrickId, scratch: &mut [u8]) -> Result<Arc<[u8]>, BrickError> {
        let mut inner = self.lock();
        loop {
            if let Some(core) = inner.cores.get(&id) {
                return Ok(core.clone());
            }
            if let Some(err) = inner.failed.get(&id) {
                return Err(err.clone());
            }
            if inner.decoding.insert(id) {
                break;
            }
            inner = self.decoded.wait(inner).unwrap_or_else(PoisonError::into_inner);
        }
        let mut buffer = self.buffer(inner);
        let result = self.decode(id, scratch, &mut buffer);
        let mut inner = self.lock();
        inner.decoding.remove(&id);
        self.decoded.notify_all();
        match result {
            Ok(()) => {
                inner.counters.decoded += 1;
                inner.counters.bytes_decoded += voxel_bytes(&*self.source);
                inner.cores.put(id, buffer.clone());
                Ok(buffer)
            }
            Err(err) => {
                tracing::warn!("{err}; a coarser brick stands in");
                inner.counters.failed += 1;
                inner.free.push(buffer);
                inner.failed.insert(id, err.clone());
                Err(err)
            }
        }
    }

    /// A buffer that nobody else holds: a new one within the budget, or the least recently used core's.
    fn buffer<'a>(&'a self, mut inner: MutexGuard<'a, Inner>) -> Arc<[u8]> {
        let bytes = self.layout.cached_bytes();
        loop {
            if let Some(buffer) = inner.free.pop() {
                return buffer;
            }
            if inner.allocated < self.capacity {
                inner.allocated += 1;
                self.meter.charge(bytes as u64);
                drop(inner);
                return zeroed(bytes);
            }
            // A core in use is passed over: reusing its buffer must wait until its holder is done.
            let mut old_first = inner.cores.iter().rev();
            let victim = old_first.find(|(_, core)| Arc::strong_count(core) == 1).map(|(id, _)| *id);
            if let Some(buffer) = victim.and_then(|id| inner.cores.pop(&id)) {
                return buffer;
            }
            // Only where more threads than buffers share the cache. Dropping a core wakes nobody: look again soon.
            let soon = Duration::from_millis(1);
            inner = self.decoded.wait_timeout(inner, soon).unwrap_or_else(PoisonError::into_inner).0;
        }
    }

    fn decode(&self, id: BrickId, scratch: &mut [u8], buffer: &mut Arc<[u8]>) -> Result<(), BrickError> {
        // A buffer from `buffer` has one holder, so nothing is ever copied here.
        let cached = Arc::make_mut(buffer);
        // A panic in a codec costs one brick, not a worker and everyone who waits for it.
        let decode = AssertUnwindSafe(|| {
            let codes = &mut cached[..self.layout.core_bytes()];
            if is_identity(&self.encoding) {
                self.source.read_core(id, codes)?;
            } else {
                self.source.read_core(id, scratch)?;
                self.encoding.encode(scratch, codes);
            }
            self.layout.copy_columns(cached);
            Ok(())
        });
        let panicked = |_| Err(BrickError { id, reason: "the decoder panicked".into() });
        catch_unwind(decode).unwrap_or_else(panicked)
    }

    fn lock(&self) -> MutexGuard<'_, Inner> {
        // Nothing that can panic runs under the lock but allocation; the state is whole at every step.
        self.inner.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The encoding of a source's slots.
pub(crate) fn encoding_of(source: &dyn BrickSource) -> SlotEncoding {
    SlotEncoding::new(source.voxel_type(), source.value_range(), source.has_non_finite())
}

/// The layout of a source's bricks.
pub(crate) fn layout_of(source: &dyn BrickSource, apron: u32) -> Result<Layout, PagerError> {
    let edge = source.pyramid().edge();
    if !(1..=2).contains(&apron) || apron > edge {
        return Err(PagerError::Apron { apron, edge });
    }
    Ok(Layout::new(edge, apron, &encoding_of(source)))
}

/// Bytes of a decoding thread's scratch.
pub(crate) fn scratch_bytes(source: &dyn BrickSource, encoding: &SlotEncoding) -> u64 {
    if is_identity(encoding) { 0 } else { voxel_bytes(source) }
}

fn voxel_bytes(source: &dyn BrickSource) -> u64 {
    (source.pyramid().edge() as u64).pow(3) * source.voxel_type().bytes() as u64
}

fn is_identity(encoding: &SlotEncoding) -> bool {
    matches!(encoding.voxel_type, VoxelType::U8 | VoxelType::U16)
}

/// A buffer of zeros that one holder may write.
pub(crate) fn zeroed(bytes: usize) -> Arc<[u8]> {
    std::iter::repeat_n(0, bytes).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::test_source::TestSource;
    use brickyard_volume::{BrickIndex, Level};

    /// Bytes of a cached core: 8^3 voxels and two sides of 8^2.
    const CORE: u64 = 640;

    fn brick(x: u32) -> BrickId {
        BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(x, 0, 0) }
    }

    #[test]
    fn the_least_recently_used_core_makes_room() {
        let cache = RamCache::new(Arc::new(TestSource::cube(64)), 1, 2 * CORE).unwrap();
        for (x, decoded) in [(0, 1), (1, 2), (0, 2), (2, 3), (0, 3), (1, 4)] {
            cache.core(brick(x), &mut []).unwrap();
            assert_eq!(cache.counters().decoded, decoded, "after {x}");
        }
        assert_eq!(cache.meter.peak(), 2 * CORE);
    }

    #[test]
    fn a_core_in_use_is_not_overwritten() {
        let cache = RamCache::new(Arc::new(TestSource::cube(64)), 1, 2 * CORE).unwrap();
        let held = cache.core(brick(0), &mut []).unwrap();
        let before = held.to_vec();
        for x in 1..8 {
            cache.core(brick(x), &mut []).unwrap();
        }
        assert_eq!(*held, *before);
    }

    #[test]
    fn failures_and_panics_are_remembered() {
        let mut source = TestSource::cube(64);
        source.failing.insert(brick(1));
        source.panicking.insert(brick(2));
        let cache = RamCache::new(Arc::new(source), 1, CORE).unwrap();
        for _ in 0..2 {
            assert!(cache.core(brick(1), &mut []).is_err());
            assert!(cache.core(brick(2), &mut []).unwrap_err().reason.contains("panicked"));
        }
        cache.core(brick(3), &mut []).unwrap();
        assert_eq!(cache.counters(), DecodeCounters { decoded: 1, bytes_decoded: 512, failed: 2 });
        assert!(matches!(
            RamCache::new(cache.source().clone(), 1, CORE - 1),
            Err(PagerError::HostMemory { least: CORE, .. })
        ));
    }

    #[test]
    fn threads_that_want_one_core_decode_it_once() {
        let source = Arc::new(TestSource::cube(64));
        let cache = RamCache::new(source, 1, 64 * CORE).unwrap();
        std::thread::scope(|scope| {
            for _ in 0..4 {
                scope.spawn(|| (0..8).for_each(|x| drop(cache.core(brick(x), &mut []).unwrap())));
            }
        });
        assert_eq!(cache.counters().decoded, 8);
    }
}
