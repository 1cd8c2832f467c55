//! Fetching of a store at an address ahead of the reads: who fetches, how much at a time, and how long it takes. The bytes wait in `arrived.rs`, or of another
//! program's image decoded among the chunks kept.

use super::{Bricks, Store};
use crate::arrived::{self, FetchRoom};
use brickyard_objects::{at, traffic};
use brickyard_volume::BrickId;
use std::time::Duration;

impl Store {
    /// Threads that may fetch bricks ahead of those who read them, whose latencies overlap; none for a store on disk.
    pub fn fetchers(&self) -> u32 {
        match &self.bricks {
            _ if !self.is_remote() => 0,
            Bricks::Own(_) => 16,
            Bricks::Foreign(foreign) => foreign.fetching().bricks as u32,
        }
    }

    /// Time until bricks of a store at an address are here, by the last requests: the shard's index, then its bytes. Zero on disk.
    pub fn latency(&self) -> Duration {
        if self.is_remote() { traffic().request_time * 2 } else { Duration::ZERO }
    }

    /// Fetches the encoded bytes of bricks of a store at an address, and of their aprons, or another program's chunks, for reads that follow soon. Waits
    /// for room on the link, then takes as many bricks as there is room for. Failures are left for the reads to report.
    pub fn fetch(&self, take: &mut dyn FnMut(FetchRoom) -> Vec<BrickId>) {
        let Ok(Some(place)) = at(self.path()) else { return };
        let link = place.objects.link();
        let admission = link.admit();
        let (bricks, bytes) = match &self.bricks {
            Bricks::Own(_) => {
                // Fetched bricks wait within half of the room for them.
                let ahead = (arrived::MOST_BYTES / 2 / link.brick_bytes().max(1)).clamp(8, 256) as usize;
                let ids = take(FetchRoom { bricks: admission.bricks, ahead });
                (ids.len(), self.chunks().map(|chunks| chunks.fetch(&ids)).sum())
            }
            Bricks::Foreign(foreign) => {
                let room = foreign.fetching();
                let ids = take(FetchRoom { bricks: 1, ..room });
                foreign.fetch(&ids);
                (ids.len(), link.answer_bytes() * ids.len() as u64)
            }
        };
        admission.fetched(bytes, bricks);
    }

    /// Whether more bytes are asked for at the store's address than a new plan had better wait for.
    pub fn is_backed_up(&self) -> bool {
        matches!(at(self.path()), Ok(Some(place)) if place.objects.link().is_backed_up())
    }
}
