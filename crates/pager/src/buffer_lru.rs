//! Fixed-capacity LRU of equally sized buffers, keyed by core.
//!
//! Each entry records its untaken parts (see [`Part`](crate::neighbourhood::Part)). Without any it is *done*: a sweep over a volume will
//! not need it again. Done entries are evicted first, then the rest, the least recently used first in both. Entries in use are skipped, so
//! no held buffer is overwritten. Buffers are reused, so a full shelf no longer allocates; a buffer counts from its allocation on, whoever
//! holds it. Each call costs a hash lookup or two.

use crate::budget::Meter;
use crate::sameness::CoreKey;
use lru::LruCache;
use std::sync::Arc;

pub(crate) struct Shelf {
    buffer_bytes: usize,
    capacity: usize,
    /// Whether done entries stay while there is room.
    keeps_done: bool,
    meter: Arc<Meter>,
    /// Allocated buffers, wherever they are.
    allocated: usize,
    free: Vec<Arc<[u8]>>,
    entries: LruCache<CoreKey, Entry>,
    done: LruCache<CoreKey, ()>,
}

struct Entry {
    codes: Arc<[u8]>,
    untaken: u32,
}

impl Shelf {
    pub(crate) fn new(buffer_bytes: usize, capacity: usize, keeps_done: bool, meter: Arc<Meter>) -> Self {
        let (entries, done) = (LruCache::unbounded(), LruCache::unbounded());
        Self { buffer_bytes, capacity, keeps_done, meter, allocated: 0, free: Vec::new(), entries, done }
    }

    /// Returns a brick's codes, if present, and marks these parts of the brick as taken.
    pub(crate) fn take(&mut self, key: CoreKey, parts: u32) -> Option<Arc<[u8]>> {
        let entry = self.entries.get_mut(&key)?;
        entry.untaken &= !parts;
        if entry.untaken == 0 {
            self.done.put(key, ());
        }
        Some(entry.codes.clone())
    }

    /// Returns a brick's codes, if present, without counting as a use.
    pub(crate) fn peek(&self, key: CoreKey) -> Option<&Arc<[u8]>> {
        self.entries.peek(&key).map(|entry| &entry.codes)
    }

    /// Adds the codes of an absent brick; `parts` are still to be taken.
    pub(crate) fn put(&mut self, key: CoreKey, codes: Arc<[u8]>, parts: u32) {
        self.entries.put(key, Entry { codes, untaken: parts });
        if parts == 0 {
            self.done.put(key, ());
        }
    }

    /// Number of buffers that can still be allocated or adopted.
    pub(crate) fn room(&self) -> usize {
        self.capacity - self.allocated
    }

    /// Adds an entry from another shelf of the same buffer size; `parts` are still to be taken. Requires [room](Self::room).
    pub(crate) fn adopt(&mut self, key: CoreKey, codes: Arc<[u8]>, parts: u32) {
        debug_assert!(codes.len() == self.buffer_bytes && self.room() > 0);
        self.allocated += 1;
        self.meter.charge(self.buffer_bytes as u64);
        self.put(key, codes, parts);
    }

    /// All entries, the most recently used first.
    pub(crate) fn entries(&self) -> impl Iterator<Item = (CoreKey, &Arc<[u8]>)> {
        self.entries.iter().map(|(&key, entry)| (key, &entry.codes))
    }

    /// Returns a buffer with no other holder: a free one, a new one within capacity, or that of the next entry to evict. Without
    /// `keeps_done`, done entries are evicted before a new buffer is allocated. `None` if all buffers are in use.
    pub(crate) fn buffer(&mut self) -> Option<Arc<[u8]>> {
        if let Some(buffer) = self.free.pop() {
            return Some(buffer);
        }
        let has_room = self.allocated < self.capacity;
        let is_unused = |key: &&CoreKey| self.peek(**key).is_some_and(|codes| Arc::strong_count(codes) == 1);
        let mut done = self.done.iter().rev().map(|(key, ())| key).filter(|_| !has_room || !self.keeps_done);
        let mut others = self.entries.iter().rev().map(|(key, _)| key).filter(|_| !has_room);
        if let Some(&key) = done.find(is_unused).or_else(|| others.find(is_unused)) {
            self.done.pop(&key);
            return self.entries.pop(&key).map(|entry| entry.codes);
        }
        has_room.then(|| {
            self.allocated += 1;
            self.meter.charge(self.buffer_bytes as u64);
            zeroed(self.buffer_bytes)
        })
    }

    /// Takes back an unused buffer.
    pub(crate) fn give_back(&mut self, buffer: Arc<[u8]>) {
        self.free.push(buffer);
    }
}

/// A zeroed buffer with a single holder, who may write to it. Only writing touches its memory, so this is quick, even under a lock.
pub(crate) fn zeroed(bytes: usize) -> Arc<[u8]> {
    let buffer = Arc::new_zeroed_slice(bytes);
    // SAFETY: a byte of zero bits is a valid `u8`.
    unsafe { buffer.assume_init() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::{BrickId, BrickIndex, Level};

    fn brick(x: u32) -> CoreKey {
        CoreKey::new(BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(x, 0, 0) }, None)
    }

    /// A full shelf of bricks 0 to 3, each with two parts to take.
    fn shelf() -> (Shelf, Arc<Meter>) {
        let meter = Arc::new(Meter::new(40));
        let mut shelf = Shelf::new(10, 4, true, meter.clone());
        for x in 0..4 {
            let buffer = shelf.buffer().unwrap();
            shelf.put(brick(x), buffer, 0b11);
        }
        (shelf, meter)
    }

    /// The evicted bricks, in order.
    fn gone(shelf: &mut Shelf) -> Vec<u32> {
        let mut there: Vec<u32> = (0..4).filter(|&x| shelf.peek(brick(x)).is_some()).collect();
        let mut gone = Vec::new();
        while shelf.buffer().is_some() {
            let (left, went) = there.iter().partition(|&&x| shelf.peek(brick(x)).is_some());
            (there, gone) = (left, [gone, went].concat());
        }
        gone
    }

    #[test]
    fn the_done_go_first_and_the_held_stay() {
        let (mut shelf, _) = shelf();
        assert_eq!(gone(&mut shelf), [0, 1, 2, 3]);
        let (mut shelf, _) = self::shelf();
        for (x, parts) in [(3, 0b11), (0, 0b01), (1, 0b01), (1, 0b10), (2, 0b01), (2, 0b01)] {
            shelf.take(brick(x), parts).unwrap();
        }
        // Another use keeps a done entry longer, but not past the others.
        shelf.take(brick(3), 0b01).unwrap();
        let held = shelf.take(brick(0), 0b01).unwrap();
        assert_eq!(gone(&mut shelf), [1, 3, 2]);
        drop(held);
        assert_eq!(gone(&mut shelf), [0]);
    }

    #[test]
    fn a_sweep_over_a_shelf_that_keeps_nothing_takes_what_is_in_use() {
        for (keeps_done, expected) in [(false, 30), (true, 1000)] {
            let meter = Arc::new(Meter::new(1000));
            let mut shelf = Shelf::new(10, 100, keeps_done, meter.clone());
            for x in 0..100 {
                let buffer = shelf.buffer().unwrap();
                shelf.put(brick(x), buffer, 0b11);
                // The brick before the last has been taken whole.
                if x > 1 {
                    shelf.take(brick(x - 2), 0b11).unwrap();
                }
            }
            assert_eq!(meter.peak(), expected, "{keeps_done}");
            // Entries not yet done are still there.
            assert!(shelf.peek(brick(99)).is_some() && shelf.peek(brick(98)).is_some());
        }
    }

    #[test]
    fn buffers_are_charged_once_and_used_again() {
        let (mut shelf, meter) = shelf();
        let buffer = shelf.buffer().unwrap();
        let address = buffer.as_ptr();
        shelf.give_back(buffer);
        let again = shelf.buffer().unwrap();
        assert_eq!(again.as_ptr(), address);
        shelf.put(brick(9), again, 0);
        assert_eq!((meter.used(), meter.peak()), (40, 40));
        // An entry without parts to take is done from the start.
        assert_eq!(shelf.buffer().unwrap().as_ptr(), address);
    }
}
