//! Encoded chunks of a store at an address, fetched ahead of the reads that need them. Those fetched last stay, up to a limit in bytes; a read of a chunk
//! under way waits for it.

use crate::layout::ShardId;
use lru::LruCache;
use std::collections::HashSet;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

/// Most bytes of chunks kept.
pub(crate) const MOST_BYTES: u64 = 64 << 20;

/// Room to fetch bricks ahead of those who read them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FetchRoom {
    /// Bricks to fetch now, at most.
    pub bricks: usize,
    /// Bricks fetched before they are read, at most.
    pub ahead: usize,
}

/// A chunk by its shard, and its first byte there.
pub(crate) type ChunkPlace = (ShardId, u64);

/// The chunks fetched and under way.
#[derive(Default)]
pub(crate) struct Arrived {
    state: Mutex<State>,
    changed: Condvar,
}

struct State {
    chunks: LruCache<ChunkPlace, Arc<[u8]>>,
    bytes: u64,
    under_way: HashSet<ChunkPlace>,
}

impl Default for State {
    fn default() -> Self {
        Self { chunks: LruCache::unbounded(), bytes: 0, under_way: HashSet::new() }
    }
}

/// Chunks being fetched; no longer so when dropped, whatever became of them.
pub(crate) struct UnderWay<'a> {
    arrived: &'a Arrived,
    places: Vec<ChunkPlace>,
}

impl Arrived {
    /// Begins to fetch those of some chunks that nobody has or fetches.
    pub(crate) fn begin(&self, places: impl Iterator<Item = ChunkPlace>) -> UnderWay<'_> {
        let mut state = self.lock();
        let State { chunks, under_way, .. } = &mut *state;
        let places = places.filter(|place| !chunks.contains(place) && under_way.insert(*place)).collect();
        UnderWay { arrived: self, places }
    }

    /// A chunk fetched before, after a wait if it is under way; `None` if it is neither.
    pub(crate) fn take(&self, place: ChunkPlace) -> Option<Arc<[u8]>> {
        let state = self.lock();
        let waited = self.changed.wait_while(state, |state| state.under_way.contains(&place));
        waited.unwrap_or_else(PoisonError::into_inner).chunks.get(&place).cloned()
    }

    /// Forgets a chunk: its bytes are damaged.
    pub(crate) fn forget(&self, place: ChunkPlace) {
        let mut state = self.lock();
        if let Some(chunk) = state.chunks.pop(&place) {
            state.bytes -= chunk.len() as u64;
        }
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl UnderWay<'_> {
    /// The chunks to be fetched.
    pub(crate) fn places(&self) -> &[ChunkPlace] {
        &self.places
    }

    /// Takes further chunks along, if nobody has or fetches any of them.
    pub(crate) fn takes_along(&mut self, places: &[ChunkPlace]) -> bool {
        let mut state = self.arrived.lock();
        let State { chunks, under_way, .. } = &mut *state;
        let are_free = places.iter().all(|place| !chunks.contains(place) && !under_way.contains(place));
        if are_free {
            under_way.extend(places);
            self.places.extend(places);
        }
        are_free
    }

    /// Keeps the chunks, one for each place.
    pub(crate) fn arrive(&self, chunks: Vec<Vec<u8>>) {
        let mut state = self.arrived.lock();
        for (place, chunk) in self.places.iter().zip(chunks) {
            state.bytes += chunk.len() as u64;
            state.chunks.put(*place, chunk.into());
        }
        while state.bytes > MOST_BYTES {
            let Some((_, chunk)) = state.chunks.pop_lru() else { break };
            state.bytes -= chunk.len() as u64;
        }
    }
}

impl Drop for UnderWay<'_> {
    fn drop(&mut self) {
        let mut state = self.arrived.lock();
        state.under_way.retain(|place| !self.places.contains(place));
        self.arrived.changed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::Level;

    fn place(offset: u64) -> ChunkPlace {
        (ShardId { group: 0, channel: 0, level: Level(0), z: 0, y: 0, x: 0 }, offset)
    }

    #[test]
    fn a_chunk_is_fetched_once_and_waited_for() {
        let arrived = Arrived::default();
        let first = arrived.begin([0, 1].map(place).into_iter());
        let second = arrived.begin([1, 2].map(place).into_iter());
        assert_eq!((first.places(), second.places()), (&[place(0), place(1)][..], &[place(2)][..]));
        std::thread::scope(|scope| {
            let waits = scope.spawn(|| arrived.take(place(1)));
            first.arrive(vec![vec![0; 3], vec![1; 4]]);
            drop(first);
            assert_eq!(*waits.join().unwrap().unwrap(), [1; 4]);
        });
        drop(second);
        assert!(arrived.take(place(2)).is_none(), "its fetch failed");
        arrived.forget(place(0));
        assert!(arrived.take(place(0)).is_none() && arrived.begin([place(0)].into_iter()).places().len() == 1);
    }

    #[test]
    fn bytes_are_bounded() {
        let arrived = Arrived::default();
        for offset in 0..10 {
            arrived.begin([place(offset)].into_iter()).arrive(vec![vec![0; MOST_BYTES as usize / 4]]);
        }
        let kept: Vec<u64> = (0..10).filter(|offset| arrived.take(place(*offset)).is_some()).collect();
        assert_eq!(kept, [6, 7, 8, 9]);
    }
}
