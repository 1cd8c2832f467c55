//! Decoded chunks and indexes of shards, kept for the boxes beside them within so many bytes: those of one array, or of all levels of an image together.
//! Those used last stay.

use crate::error::{ImportError, Result};
use hdf5_reader::cache::{ChunkCache, ChunkKey};
use hdf5_reader::error::Error;
use std::collections::VecDeque;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError, RwLock, RwLockWriteGuard};

/// Bytes kept, unless told otherwise.
const BYTES: u64 = 128 << 20;

/// Slots of the cache, whose limit are bytes.
const SLOTS: usize = 1 << 16;

/// Chunks and indexes that stay where the bytes kept become more or fewer: those of a sample, which a picture needs next.
const STAY: usize = 64;

/// A kind of bytes kept of an array.
#[derive(Clone, Copy)]
pub(super) enum Kind {
    Chunk,
    Index,
}

/// Bytes that arrays need in memory.
#[derive(Clone, Copy, Default)]
pub(super) struct Needs {
    /// For two chunks.
    pub(super) least: u64,
    /// For all of them.
    pub(super) most: u64,
}

/// One array's part of the chunks kept. A clone shares them.
#[derive(Clone, Default)]
pub(crate) struct KeptChunks {
    shared: Arc<RwLock<Shared>>,
    array: u64,
}

/// The chunks of all arrays.
struct Shared {
    cache: Arc<ChunkCache>,
    arrays: u64,
    needs: Needs,
    wanted_bytes: u64,
    /// Loaded last, the latest at the end.
    loaded: Mutex<VecDeque<ChunkKey>>,
}

impl Default for Shared {
    fn default() -> Self {
        Self {
            cache: Arc::new(ChunkCache::new(0, 1)),
            arrays: 0,
            needs: Needs::default(),
            wanted_bytes: BYTES,
            loaded: Mutex::default(),
        }
    }
}

impl Shared {
    /// The bytes wanted, within the arrays' needs.
    fn bytes(&self) -> usize {
        let bytes = self.wanted_bytes.max(self.needs.least).min(self.needs.most);
        usize::try_from(bytes).unwrap_or(usize::MAX)
    }

    /// The chunks loaded last, as far as they are kept, in a cache of the size wanted now.
    fn resize(&mut self) {
        let cache = ChunkCache::new(self.bytes(), SLOTS);
        for key in self.loaded().iter() {
            if let Some(kept) = self.cache.get(key) {
                cache.insert(key.clone(), Vec::clone(&kept));
            }
        }
        self.cache = Arc::new(cache);
    }

    fn loaded(&self) -> MutexGuard<'_, VecDeque<ChunkKey>> {
        self.loaded.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn is_of_size(&self) -> bool {
        self.bytes() == self.cache.capacity_bytes()
    }
}

impl KeptChunks {
    /// A further array's part of the same chunks.
    pub(super) fn with_array(&self, Needs { least, most }: Needs) -> Self {
        let mut shared = self.write();
        let array = shared.arrays;
        shared.arrays += 1;
        shared.needs = Needs { least: shared.needs.least.max(least), most: shared.needs.most.saturating_add(most) };
        Self { shared: self.shared.clone(), array }
    }

    /// Keeps so many bytes from the next look on: two chunks of each array at least, and all at most. If that is another number, only the
    /// chunks loaded last stay.
    pub(super) fn keep_at_most(&self, bytes: u64) {
        self.write().wanted_bytes = bytes;
    }

    /// Most bytes kept.
    pub(super) fn bytes(&self) -> u64 {
        self.shared.read().unwrap_or_else(PoisonError::into_inner).bytes() as u64
    }

    /// The chunk or index at a place, if it is kept.
    pub(super) fn get(&self, kind: Kind, place: &[u64]) -> Option<Arc<Vec<u8>>> {
        self.cache().get(&self.key(kind, place))
    }

    /// The chunk or index at a place of the array at `path`, kept or loaded now. Threads in need of the same one load it once.
    ///
    /// # Errors
    /// If it cannot be loaded.
    pub(super) fn get_or_load(
        &self,
        path: &Path,
        kind: Kind,
        place: &[u64],
        load: impl FnOnce() -> Result<Vec<u8>>,
    ) -> Result<Arc<Vec<u8>>> {
        let mut failure = None;
        let kept = self.cache().get_or_insert_with(self.key(kind, place), || {
            let loaded = load().map_err(|error| {
                failure = Some(error);
                Error::Other(String::new())
            })?;
            self.note_loaded(self.key(kind, place));
            Ok(loaded)
        });
        kept.map_err(|error| failure.unwrap_or_else(|| ImportError::invalid(path, error.to_string())))
    }

    fn note_loaded(&self, key: ChunkKey) {
        let shared = self.shared.read().unwrap_or_else(PoisonError::into_inner);
        let mut loaded = shared.loaded();
        loaded.push_back(key);
        if loaded.len() > STAY {
            loaded.pop_front();
        }
    }

    fn key(&self, kind: Kind, place: &[u64]) -> ChunkKey {
        ChunkKey { dataset_addr: 2 * self.array + kind as u64, chunk_offsets: place.iter().copied().collect() }
    }

    fn cache(&self) -> Arc<ChunkCache> {
        let shared = self.shared.read().unwrap_or_else(PoisonError::into_inner);
        if shared.is_of_size() {
            return shared.cache.clone();
        }
        drop(shared);
        let mut shared = self.write();
        if !shared.is_of_size() {
            shared.resize();
        }
        shared.cache.clone()
    }

    fn write(&self) -> RwLockWriteGuard<'_, Shared> {
        self.shared.write().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn load(kept: &KeptChunks, place: u64, bytes: usize) -> Arc<Vec<u8>> {
        kept.get_or_load(Path::new("a"), Kind::Chunk, &[place], || Ok(vec![place as u8; bytes])).unwrap()
    }

    #[test]
    fn arrays_share_one_bound() {
        let image = KeptChunks::default();
        let arrays = [1, 2, 3].map(|_| image.with_array(Needs { least: 200, most: 1000 }));
        assert_eq!(arrays[0].bytes(), 3000, "no more than all chunks");
        arrays[1].keep_at_most(500);
        assert!(arrays.iter().all(|array| array.bytes() == 500));
        arrays[2].keep_at_most(10);
        assert_eq!(arrays[0].bytes(), 200, "two chunks at least");
        arrays[0].keep_at_most(500);
        for place in 0..10 {
            arrays.iter().for_each(|array| drop(load(array, place, 100)));
        }
        let kept = arrays.iter().map(|array| (0..10).filter(|at| array.get(Kind::Chunk, &[*at]).is_some()).count());
        assert_eq!(kept.sum::<usize>(), 5);
    }

    #[test]
    fn chunks_loaded_last_stay_where_the_bound_changes() {
        let kept = KeptChunks::default().with_array(Needs { least: 200, most: 100_000 });
        (0..100).for_each(|place| drop(load(&kept, place, 100)));
        kept.keep_at_most(50_000);
        let stay =
            |kept: &KeptChunks| (0..100).filter(|at| kept.get(Kind::Chunk, &[*at]).is_some()).collect::<Vec<_>>();
        assert_eq!(stay(&kept), (100 - STAY as u64..100).collect::<Vec<_>>());
        kept.keep_at_most(300);
        assert_eq!(stay(&kept), [97, 98, 99]);
    }

    #[test]
    fn places_of_other_arrays_and_kinds_are_others() {
        let image = KeptChunks::default();
        let [a, b] = [1, 2].map(|_| image.with_array(Needs { least: 10, most: 1000 }));
        assert_eq!(*load(&a, 7, 5), [7; 5]);
        assert!(b.get(Kind::Chunk, &[7]).is_none() && a.get(Kind::Index, &[7]).is_none());
        let failed =
            b.get_or_load(Path::new("a"), Kind::Chunk, &[7], || Err(ImportError::invalid(Path::new("b"), "x")));
        assert!(failed.unwrap_err().to_string().contains("b: x"));
        assert_eq!(*load(&b, 7, 3), [7; 3], "a failure is not kept");
    }
}
