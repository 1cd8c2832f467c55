//! The budgets: how a host-memory budget is split, and one meter that everything which holds brick bytes charges.
//!
//! All host buffers come in sizes known at the start (a worker's scratch, a core with its share of shells, a padded brick), so
//! the split is in whole buffers and the limit holds by construction; the meter shows what is in use and its peak, and asserts the limit
//! in debug builds. GPU memory is `slots * padded bytes`, taken once.

use crate::slot_contents::SlotContents;
use crate::upload_budget::UploadLimits;
use brickyard_volume::numbers::mebibytes;
use brickyard_volume::sampling::MAX_REACH;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Where cuts are made, and from what.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Planning {
    /// Cuts are made within the frame, each anew: for pictures that are waited for. The same view always has the same cut,
    /// whatever was seen before it.
    #[default]
    Inline,
    /// Cuts are made on a thread of their own, each from the last one: for a moving camera. A frame may draw the cut of an earlier view.
    Thread,
}

/// What a pager may use, and how it works.
#[derive(Clone, Debug, PartialEq)]
pub struct PagerConfig {
    /// Slots of the atlas, shared by all of the pager's volumes.
    pub slots: u32,
    /// Voxels copied from neighbours on each side of a brick: 1 for trilinear samples, 2 for tricubic ones.
    pub apron: u32,
    /// Layers of gradient nodes outside of a brick's core; 0 for no gradients at all. A brick's gradients are put behind its voxels.
    pub gradient_layers: u32,
    /// The most host memory, in bytes, for the RAM brick cache, bricks in flight, padded bricks waiting for upload, and the pager's tables.
    pub host_bytes: u64,
    /// What the slots of each volume hold; [`SlotContents::Codes`] for volumes past the end of the list.
    pub contents: Vec<SlotContents>,
    /// Whether decoded bricks stay in host memory as long as there is room, for when they are wanted again. Otherwise a brick that has been uploaded, and is not wanted for
    /// its neighbours any more, makes room for the next one: memory is what one pass over the view takes.
    pub keeps_decoded: bool,
    /// Decoding threads of each volume; fewer are started where the host budget cannot feed them.
    pub workers: u32,
    /// Whether cuts are made within the frame or on a thread of their own.
    pub planning: Planning,
    /// Whether to fetch bricks that the next views may want.
    pub prefetch: bool,
    /// Limits for one frame's uploads; `None` where frames may wait (rendering offline).
    pub uploads: Option<UploadLimits>,
    /// How long a finer brick takes to fade in where a coarser one was drawn. With `None` it is drawn at once, so that the same view is
    /// always the same picture.
    pub fade: Option<Duration>,
}

impl PagerConfig {
    /// What the slots of each volume hold, however many volumes there are.
    pub(crate) fn contents_of_all(&self) -> impl Iterator<Item = &SlotContents> {
        self.contents.iter().chain(std::iter::repeat(&SlotContents::Codes))
    }
}

/// Why a pager cannot start.
#[derive(Debug, thiserror::Error)]
pub enum PagerError {
    /// The host budget cannot hold what it takes to decode one brick.
    #[error("{} of host memory are too few: at least {} are needed to decode one brick", mebibytes(*given), mebibytes(*least))]
    HostMemory {
        /// The budget given, in bytes.
        given: u64,
        /// The least budget that works, in bytes.
        least: u64,
    },
    /// There are fewer slots than bricks that must always be resident.
    #[error("there are slots for {given} bricks: at least {least} ({}) are needed", mebibytes(*least_bytes))]
    Slots {
        /// The number of slots given.
        given: u32,
        /// The least number of slots that works.
        least: u64,
        /// The bytes that the least number of slots takes.
        least_bytes: u64,
    },
    /// The apron does not fit the bricks.
    #[error(
        "an apron of {apron} voxels does not fit bricks of {edge}: expected 1 to {MAX_REACH}, and no more than the brick's edge"
    )]
    Apron {
        /// The width of the apron given, in voxels.
        apron: u32,
        /// The edge of the bricks' cores, in voxels.
        edge: u32,
    },
    /// The gradients do not fit the bricks.
    #[error(
        "stored gradients need bricks of an even edge with an apron of {least} voxels: these have an edge of {edge} and an apron of {apron}"
    )]
    Gradients {
        /// The width of the apron given, in voxels.
        apron: u32,
        /// The narrowest apron that works, in voxels.
        least: u32,
        /// The edge of the bricks' cores, in voxels.
        edge: u32,
    },
    /// A thread could not be started.
    #[error("cannot start a thread: {0}")]
    Thread(#[from] std::io::Error),
}

/// A meter of the bytes of host memory in use and of their peak, with a limit that debug builds assert.
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

/// Sizes, in bytes, of the buffers that a host budget is split into.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BufferSizes {
    /// Bytes that the source, its pages of occupancy and those of hashes take, whatever is read.
    pub(crate) fixed: u64,
    /// Bytes that a worker needs to make codes of voxels.
    pub(crate) scratch: u64,
    /// Bytes of a cached core and its share of the shells.
    pub(crate) core: u64,
    /// Bytes of a padded brick.
    pub(crate) padded: u64,
}

/// How a host budget is split, in whole buffers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct HostSplit {
    pub(crate) workers: u32,
    /// The number of padded bricks that may be assembled, wait for upload, or be in the last frame's hands at the same time.
    pub(crate) staged: usize,
    /// The number of cores in the RAM cache, each with its share of the shells, those being decoded included.
    pub(crate) cores: usize,
}

/// Bytes that the slot table, the cuts, the plan and the draw list take for each slot, rounded up: all are linear in the slots. Most
/// of it goes to up to four cuts (drawn, last, being made, foreseen) with about two nodes of 88 bytes for a cell. While time steps are played, a cut
/// has half of the cells, and those of the coming steps together as many as there are slots, before and after they are made anew. Up to two bricks
/// are known to be in a slot, at 120 bytes, and the slot's content at 100.
pub(crate) const TABLE_BYTES_PER_SLOT: u64 = 1280;

/// Padded bricks in flight at most: more only delays what a newer plan wants.
pub(crate) const MAX_STAGED: u64 = 256;

/// The least host budget that works, in bytes: what one worker needs at the same time, and what is there without a worker.
pub(crate) fn least_host(BufferSizes { fixed, scratch, core, padded }: BufferSizes) -> u64 {
    fixed + scratch + core + padded
}

/// Splits a host budget: at most an eighth for padded bricks, unless one for each worker takes more, and the rest for cores. Every worker
/// needs its scratch, a core and a padded brick at the same time, so there are fewer workers where the budget cannot feed them all.
///
/// # Errors
/// If the budget cannot feed one worker.
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
