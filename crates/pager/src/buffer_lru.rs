//! A shelf of the RAM cache: buffers of one size under the keys of cores, at most so many, and which of them goes first.
//!
//! Each entry knows which of its parts (see [`Part`](crate::neighbourhood::Part)) nobody has taken yet. One whose parts have all
//! been taken is *done*: in a sweep over a volume nobody will ask for it again, so the done ones go first, the least
//! recently used before the others; then the rest, likewise. An entry that somebody holds is passed over, so nothing is
//! overwritten in use. Buffers are used again, so a shelf allocates nothing once it is full; a buffer counts from its
//! allocation on, whoever holds it. Cost: a hash lookup or two for each call.

use crate::budget::Meter;
use crate::sameness::CoreKey;
use lru::LruCache;
use std::sync::Arc;

pub(crate) struct Shelf {
    buffer_bytes: usize,
    capacity: usize,
    /// Whether done entries stay as long as there is room for others.
    keeps_done: bool,
    meter: Arc<Meter>,
    /// Buffers allocated, in whatever hands.
    allocated: usize,
    free: Vec<Arc<[u8]>>,
    entries: LruCache<CoreKey, Entry>,
    /// The entries that are done.
    done: LruCache<CoreKey, ()>,
}

struct Entry {
    codes: Arc<[u8]>,
    /// Parts that nobody has taken yet.
    untaken: u32,
}

impl Shelf {
    pub(crate) fn new(buffer_bytes: usize, (capacity, keeps_done): (usize, bool), meter: Arc<Meter>) -> Self {
        let (entries, done) = (LruCache::unbounded(), LruCache::unbounded());
        Self { buffer_bytes, capacity, keeps_done, meter, allocated: 0, free: Vec::new(), entries, done }
    }

    /// Returns a brick's codes, if they are on the shelf, and marks these parts of the brick as taken.
    pub(crate) fn take(&mut self, key: CoreKey, parts: u32) -> Option<Arc<[u8]>> {
        let entry = self.entries.get_mut(&key)?;
        entry.untaken &= !parts;
        if entry.untaken == 0 {
            self.done.put(key, ());
        }
        Some(entry.codes.clone())
    }

    /// Returns a brick's codes, if they are on the shelf, without counting this as a use.
    pub(crate) fn peek(&self, key: CoreKey) -> Option<&Arc<[u8]>> {
        self.entries.peek(&key).map(|entry| &entry.codes)
    }

    /// Adds the codes of a brick that is not on the shelf yet; these parts of it will be taken.
    pub(crate) fn put(&mut self, key: CoreKey, codes: Arc<[u8]>, parts: u32) {
        self.entries.put(key, Entry { codes, untaken: parts });
        if parts == 0 {
            self.done.put(key, ());
        }
    }

    /// The number of buffers that may still be allocated or adopted.
    pub(crate) fn room(&self) -> usize {
        self.capacity - self.allocated
    }

    /// Adds an entry of another shelf with buffers of the same size; these parts of it will be taken. There must be
    /// [room](Self::room).
    pub(crate) fn adopt(&mut self, key: CoreKey, codes: Arc<[u8]>, parts: u32) {
        debug_assert!(codes.len() == self.buffer_bytes && self.room() > 0);
        self.allocated += 1;
        self.meter.charge(self.buffer_bytes as u64);
        self.put(key, codes, parts);
    }

    /// All entries on the shelf, the most recently used first.
    pub(crate) fn entries(&self) -> impl Iterator<Item = (CoreKey, &Arc<[u8]>)> {
        self.entries.iter().map(|(&key, entry)| (key, &entry.codes))
    }

    /// A buffer that nobody else holds: a free one, a new one within the capacity, or the buffer of the entry that goes first, which
    /// is removed; where done entries do not stay, that of one of these before a new one. `None` if all buffers are in use.
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

    /// Takes back a buffer that was not put to use.
    pub(crate) fn give_back(&mut self, buffer: Arc<[u8]>) {
        self.free.push(buffer);
    }
}

/// A buffer of zeros with a single holder, who may write to it. Only writing touches its memory, so making one is quick, even under a lock.
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
        let mut shelf = Shelf::new(10, (4, true), meter.clone());
        for x in 0..4 {
            let buffer = shelf.buffer().unwrap();
            shelf.put(brick(x), buffer, 0b11);
        }
        (shelf, meter)
    }

    /// Who goes, in order.
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
        // Using a done one again keeps it longer, but not for longer than the others.
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
            let mut shelf = Shelf::new(10, (100, keeps_done), meter.clone());
            for x in 0..100 {
                let buffer = shelf.buffer().unwrap();
                shelf.put(brick(x), buffer, 0b11);
                // The brick before the last has been taken whole.
                if x > 1 {
                    shelf.take(brick(x - 2), 0b11).unwrap();
                }
            }
            assert_eq!(meter.peak(), expected, "{keeps_done}");
            // What is not done is still there.
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
        // Without parts to take an entry is done from the start.
        assert_eq!(shelf.buffer().unwrap().as_ptr(), address);
    }
}
