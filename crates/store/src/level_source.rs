//! A level of an open store as a [`Source`], under a description of the caller's. A read costs the bricks of its box.

use crate::store::Store;
use brickyard_import::{ImportError, Source, SourceInfo};
use brickyard_volume::{Level, VoxelBox};
use std::sync::Arc;

/// A level of an open store.
pub struct LevelSource {
    store: Arc<Store>,
    level: Level,
    info: SourceInfo,
}

impl LevelSource {
    /// Creates a source of a level, which `info` describes.
    pub fn new(store: Arc<Store>, level: Level, info: SourceInfo) -> Self {
        Self { store, level, info }
    }

    pub(crate) fn store(&self) -> &Store {
        &self.store
    }
}

impl Source for LevelSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    /// An encoded, a shuffled and a decoded brick.
    fn reader_bytes(&self) -> u64 {
        3 * self.store.core_bytes() as u64
    }

    fn held_bytes(&self) -> u64 {
        self.store.cache_bytes()
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        let read = self.store.read_box(time, channel, self.level, region, out);
        read.map_err(|error| ImportError::Other(Box::new(error)))
    }
}
