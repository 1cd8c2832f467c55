//! Cores of bricks read by picks: an LRU within a byte limit, since most picks are near the previous one.

use crate::session::volume_source::VolumeSource;
use crate::window::probe::read_core;
use brickyard_pager::{BrickError, BrickSource};
use brickyard_volume::BrickId;
use lru::LruCache;
use std::sync::{Arc, Weak};

/// Decoded cores of some volumes' bricks, in one time step.
pub(super) struct Cores {
    most_bytes: u64,
    pub(super) bytes: u64,
    /// Keyed by the volume's place and the brick; in the volumes' own voxel types.
    held: LruCache<(usize, BrickId), Arc<[u8]>>,
    /// The volumes of the cores.
    volumes: Vec<Weak<dyn BrickSource>>,
    time: u32,
    /// Bricks decoded so far.
    pub(super) decoded: u64,
}

impl Cores {
    pub(super) fn new(most_bytes: u64) -> Self {
        let (held, volumes) = (LruCache::unbounded(), Vec::new());
        Self { most_bytes, bytes: 0, held, volumes, time: 0, decoded: 0 }
    }

    /// Switches to these volumes and this time step, dropping the cores of others.
    pub(super) fn turn_to(&mut self, volumes: &[VolumeSource], time: u32) {
        let is_same = |(held, volume): (&Weak<dyn BrickSource>, &VolumeSource)| {
            held.upgrade().is_some_and(|held| Arc::ptr_eq(&held, &volume.source))
        };
        let are_same = self.volumes.len() == volumes.len() && self.volumes.iter().zip(volumes).all(is_same);
        if !are_same || self.time != time {
            self.held.clear();
            self.bytes = 0;
            self.volumes = volumes.iter().map(|volume| Arc::downgrade(&volume.source)).collect();
            self.time = time;
        }
    }

    /// Returns a brick's core, decoding it unless held.
    pub(super) fn read(
        &mut self,
        volume: usize,
        source: &dyn BrickSource,
        id: BrickId,
    ) -> Result<Arc<[u8]>, BrickError> {
        if let Some(core) = self.held.get(&(volume, id)) {
            return Ok(core.clone());
        }
        let core = read_core(source, id)?;
        self.decoded += 1;
        self.bytes += core.len() as u64;
        self.held.put((volume, id), core.clone());
        // The latest one stays, however large it is.
        while self.bytes > self.most_bytes && self.held.len() > 1 {
            let (_, oldest) = self.held.pop_lru().expect("there are several");
            self.bytes -= oldest.len() as u64;
        }
        Ok(core)
    }
}
