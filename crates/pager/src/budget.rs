//! The budgets: how a host-memory budget is split, and one meter that everything which holds brick bytes charges.
//!
//! All host buffers come in sizes known at the start (a worker's scratch, a core with its share of shells, a padded brick), so
//! the split is in whole buffers and the limit holds by construction; the meter shows what is in use and its peak, and asserts the limit
//! in debug builds. GPU memory is `slots * padded bytes`, taken once.

use crate::planner::Planning;
use crate::upload_budget::UploadLimits;
use brickyard_volume::sampling::MAX_REACH;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// What a pager may use.
#[derive(Clone, Debug, PartialEq)]
pub struct PagerConfig {
    /// Slots of the atlas.
    pub slots: u32,
    /// Voxels copied from neighbours on each side of a brick: 1 for trilinear samples, 2 for tricubic ones.
    pub apron: u32,
    /// Layers of stored gradients outside of a brick, which are put behind its voxels; 0 for no gradients.
    pub gradient_layers: u32,
    /// Limit for the RAM brick cache, bricks in flight, padded bricks waiting for upload, and the pager's tables.
    pub host_bytes: u64,
    /// Decoding threads of each volume; fewer are started where the host budget cannot feed them.
    pub workers: u32,
    /// Where cuts are made.
    pub planning: Planning,
    /// Whether to fetch bricks that the next views may want.
    pub prefetch: bool,
    /// Limits for one frame's uploads; `None` where frames may wait (rendering offline).
    pub uploads: Option<UploadLimits>,
    /// How long a finer brick takes to fade in where a coarser one was drawn; `None` for at once, so that the same view is
    /// always the same picture.
    pub fade: Option<Duration>,
}

/// Why a pager cannot start.
#[derive(Debug, thiserror::Error)]
pub enum PagerError {
    /// The host budget cannot hold one brick on its way.
    #[error("{given} bytes of host memory are too few: at least {least} are needed to decode one brick")]
    HostMemory {
        /// The budget.
        given: u64,
        /// The least that works.
        least: u64,
    },
    /// There are fewer slots than bricks that must always be resident.
    #[error("there are slots for {given} bricks: at least {least} ({least_bytes} bytes) are needed")]
    Slots {
        /// Slots given.
        given: u32,
        /// The least that works.
        least: u64,
        /// The least number of slots, in bytes.
        least_bytes: u64,
    },
    /// The apron does not fit the bricks.
    #[error(
        "an apron of {apron} voxels does not fit bricks of {edge}: expected 1 to {MAX_REACH}, and no more than the brick's edge"
    )]
    Apron {
        /// The apron given.
        apron: u32,
        /// The bricks' edge.
        edge: u32,
    },
    /// The gradients do not fit the bricks.
    #[error(
        "stored gradients need bricks of an even edge with an apron of {least} voxels: these have an edge of {edge} and an apron of {apron}"
    )]
    Gradients {
        /// The apron given.
        apron: u32,
        /// The narrowest that works.
        least: u32,
        /// The bricks' edge.
        edge: u32,
    },
    /// A thread could not be started.
    #[error("cannot start a thread: {0}")]
    Thread(#[from] std::io::Error),
}

/// Bytes in use, their peak, and the limit.
#[derive(Debug)]
pub(crate) struct Meter {
    limit: u64,
    used: AtomicU64,
    peak: AtomicU64,
}

impl Meter {
    pub(crate) fn new(limit: u64) -> Self {
        Self { limit, used: AtomicU64::new(0), peak: AtomicU64::new(0) }
    }

    pub(crate) fn charge(&self, bytes: u64) {
        let used = self.used.fetch_add(bytes, Ordering::Relaxed) + bytes;
        self.peak.fetch_max(used, Ordering::Relaxed);
        debug_assert!(used <= self.limit, "{used} bytes in use of {}", self.limit);
    }

    pub(crate) fn release(&self, bytes: u64) {
        self.used.fetch_sub(bytes, Ordering::Relaxed);
    }

    pub(crate) fn used(&self) -> u64 {
        self.used.load(Ordering::Relaxed)
    }

    pub(crate) fn peak(&self) -> u64 {
        self.peak.load(Ordering::Relaxed)
    }
}

/// Sizes of the buffers a budget is split into.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BufferSizes {
    /// What the source and its pages of occupancy take, whatever is read.
    pub(crate) fixed: u64,
    /// What a worker needs to decode, besides the core's own buffer.
    pub(crate) scratch: u64,
    /// Codes of a cached core and its share of the shells.
    pub(crate) core: u64,
    /// Codes of a padded brick.
    pub(crate) padded: u64,
}

/// A host budget in whole buffers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct HostSplit {
    pub(crate) workers: u32,
    /// Padded bricks being assembled, waiting for upload, or in the last frame's hands.
    pub(crate) staged: usize,
    /// Cores in the RAM cache, each with its share of the shells, those being decoded included.
    pub(crate) cores: usize,
}

/// What the slot table, the cuts, the plan and the draw list take for a slot, rounded up: each is linear in the slots. Most
/// of it are up to four cuts (drawn, last, being made, foreseen) with about two nodes of 88 bytes for a cell.
pub(crate) const TABLE_BYTES_PER_SLOT: u64 = 1024;

/// Padded bricks in flight at most: more only delays what a newer plan wants.
const MAX_STAGED: u64 = 256;

/// What a worker needs at the same time, and what is there without one.
pub(crate) fn least_host(BufferSizes { fixed, scratch, core, padded }: BufferSizes) -> u64 {
    fixed + scratch + core + padded
}

/// Splits the budget: at most an eighth for padded bricks, the rest for cores. Every worker needs its scratch, a core and a
/// padded brick at the same time.
pub(crate) fn split_host(host_bytes: u64, workers: u32, sizes: BufferSizes) -> Result<HostSplit, PagerError> {
    let BufferSizes { fixed, scratch, core, padded } = sizes;
    let per_worker = scratch + core + padded;
    let free = host_bytes.saturating_sub(fixed);
    let workers = (workers.max(1) as u64).min(free / per_worker);
    if workers == 0 {
        return Err(PagerError::HostMemory { given: host_bytes, least: least_host(sizes) });
    }
    let free = free - workers * scratch;
    let staged = (free / 8 / padded).clamp(workers, MAX_STAGED.max(workers));
    let cores = (free - staged * padded) / core;
    Ok(HostSplit { workers: workers as u32, staged: staged as usize, cores: cores as usize })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn a_split_is_within_the_budget_and_feeds_every_worker(
            host_bytes in 0u64..1 << 24, workers in 0u32..20,
            fixed in 0u64..1 << 16, scratch in 0u64..1 << 16, core in 1u64..1 << 16, rim in 1u64..1 << 12,
        ) {
            let sizes = BufferSizes { fixed, scratch, core, padded: core + rim };
            match split_host(host_bytes, workers, sizes) {
                Ok(split) => {
                    let HostSplit { workers: n, staged, cores } = split;
                    prop_assert!(n >= 1 && n <= workers.max(1) && staged >= n as usize && cores >= n as usize);
                    let bytes = fixed + n as u64 * scratch + staged as u64 * sizes.padded + cores as u64 * core;
                    prop_assert!(bytes <= host_bytes);
                }
                Err(PagerError::HostMemory { least, .. }) => {
                    prop_assert!(host_bytes < least);
                    prop_assert!(split_host(least, workers, sizes).is_ok());
                }
                Err(err) => prop_assert!(false, "{err}"),
            }
        }
    }
}
