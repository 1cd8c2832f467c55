//! Maps of a series' files, kept while boxes are read from them: a box of 64 slices lies in as many files, and its neighbours in the same ones.
//!
//! Cost: one map a file and layer of bricks. Address space alone counts against the bound: the pages are the system's cache.

use super::header::Header;
use crate::error::Result;
use crate::mapped::MappedFile;
use lru::LruCache;
use std::num::NonZeroUsize;
use std::sync::{Arc, Mutex, PoisonError};

/// Most maps kept: slices of two layers of the largest common bricks, 128 voxels.
const MOST_MAPS: NonZeroUsize = NonZeroUsize::new(256).unwrap();

/// Least recently used maps, by the file's index in its series.
pub(super) struct Maps(Mutex<LruCache<usize, Arc<MappedFile>>>);

impl Maps {
    pub(super) fn new() -> Self {
        Self(Mutex::new(LruCache::new(MOST_MAPS)))
    }

    /// The map of a file, unchanged since its header was read.
    ///
    /// # Errors
    /// If the file cannot be mapped, or has changed.
    pub(super) fn of(&self, file: usize, header: &Header) -> Result<Arc<MappedFile>> {
        let mut maps = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(map) = maps.get(&file) {
            return Ok(map.clone());
        }
        let map = Arc::new(header.map()?);
        // The evicted map is unmapped after the lock.
        let _evicted = maps.push(file, map.clone());
        drop(maps);
        Ok(map)
    }
}
