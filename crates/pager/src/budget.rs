//! Budgets: the split of a host-memory budget, and one meter for all holders of brick bytes.
//!
//! All host buffers have sizes known at the start (a worker's scratch, a core with its share of shells, a padded brick), so the split is in
//! whole buffers and the limit holds by construction. The meter shows use and peak, and asserts the limit in debug builds. GPU memory is
//! `slots * padded bytes`, allocated once.

use crate::slot_contents::SlotContents;
use crate::source::BrickSource;
use crate::upload_budget::UploadLimits;
use brickyard_volume::numbers::mebibytes;
use brickyard_volume::sampling::MAX_REACH;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// Where cuts are made, and from what.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Planning {
    /// Within the frame, each cut from scratch: for offline pictures. Equal views have equal cuts, whatever came before.
    #[default]
    Inline,
    /// On a separate thread, each cut from the last one: for a moving camera. A frame may draw an earlier view's cut.
    Thread,
}

/// Resources and settings of a pager.
#[derive(Clone, Debug, PartialEq)]
pub struct PagerConfig {
    /// Slots of the atlas, shared by all volumes.
    pub slots: u32,
    /// Width of the apron, in voxels: 1 for trilinear samples, 2 for tricubic ones.
    pub apron: u32,
    /// Layers of gradient nodes outside of a brick's core; 0 for no gradients. They follow the brick's voxels.
    pub gradient_layers: u32,
    /// Most host memory, in bytes, for the RAM cache, bricks in flight or waiting for upload, and the pager's tables.
    pub host_bytes: u64,
    /// Slot contents of each volume; [`SlotContents::Codes`] past the end of the list.
    pub contents: Vec<SlotContents>,
    /// Whether decoded bricks stay in host memory for reuse while there is room. Otherwise bricks no longer needed for uploads or
    /// neighbours make room for the next, and memory is limited to the needs of one pass over the view.
    pub keeps_decoded: bool,
    /// Decoding threads per volume; fewer where the host budget cannot feed them.
    pub workers: u32,
    /// Whether cuts are made within the frame or on a separate thread.
    pub planning: Planning,
    /// Whether to prefetch bricks for the next views.
    pub prefetch: bool,
    /// Limits on one frame's uploads; `None` if frames may wait (offline rendering).
    pub uploads: Option<UploadLimits>,
    /// Time in which a finer brick replaces a coarser one. `None` draws it at once, so equal views give equal pictures.
    pub fade: Option<Duration>,
}

impl PagerConfig {
    pub(crate) fn contents_of_all(&self) -> impl Iterator<Item = &SlotContents> {
        self.contents.iter().chain(std::iter::repeat(&SlotContents::Codes))
    }
}

/// Error from starting a pager.
#[derive(Debug, thiserror::Error)]
pub enum PagerError {
    /// The host budget is too small to decode one brick.
    #[error("{} of host memory are too few: at least {} are needed to decode one brick", mebibytes(*given), mebibytes(*least))]
    HostMemory {
        /// The given budget in bytes.
        given: u64,
        /// The least sufficient budget in bytes.
        least: u64,
    },
    /// There are fewer slots than bricks that must always be resident.
    #[error("there are slots for {given} bricks: at least {least} ({}) are needed", mebibytes(*least_bytes))]
    Slots {
        /// The given number of slots.
        given: u32,
        /// The least sufficient number of slots.
        least: u64,
        /// Bytes of the least sufficient slots.
        least_bytes: u64,
    },
    /// The apron does not fit the bricks.
    #[error(
        "an apron of {apron} voxels does not fit bricks of {edge}: expected 1 to {MAX_REACH}, and no more than the brick's edge"
    )]
    Apron {
        /// The given width of the apron, in voxels.
        apron: u32,
        /// Edge of the bricks' cores, in voxels.
        edge: u32,
    },
    /// The gradients do not fit the bricks.
    #[error(
        "stored gradients need bricks of an even edge with an apron of {least} voxels: these have an edge of {edge} and an apron of {apron}"
    )]
    Gradients {
        /// The given width of the apron, in voxels.
        apron: u32,
        /// The narrowest sufficient apron, in voxels.
        least: u32,
        /// Edge of the bricks' cores, in voxels.
        edge: u32,
    },
    /// A thread could not be started.
    #[error("cannot start a thread: {0}")]
    Thread(#[from] std::io::Error),
}

/// Meter of used and peak host memory in bytes, with a limit asserted in debug builds.
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

/// Buffer sizes for the split of a host budget, in bytes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct BufferSizes {
    /// Fixed part: the source, its occupancy pages and its hash pages.
    pub(crate) fixed: u64,
    /// Scratch of a worker for encoding voxels.
    pub(crate) scratch: u64,
    /// A cached core and its share of the shells.
    pub(crate) core: u64,
    /// A padded brick.
    pub(crate) padded: u64,
}

/// Split of a host budget, in whole buffers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct HostSplit {
    pub(crate) workers: u32,
    /// Most padded bricks in assembly, waiting for upload, or held by the last frame, in total.
    pub(crate) staged: usize,
    /// Cores in the RAM cache with their shares of the shells, including those being decoded.
    pub(crate) cores: usize,
}

/// Bytes per slot of the slot table, the cuts, the plan and the draw list, rounded up; all are linear in the slots. Most are in up to four
/// cuts (drawn, last, being made, predicted), with about two nodes of 88 bytes per cell. During playback, a cut has half of the cells, and
/// the coming steps' cuts together as many as there are slots, before and after they are remade. Up to two bricks are recorded per slot, at
/// 120 bytes, and the slot's content at 100.
pub(crate) const TABLE_BYTES_PER_SLOT: u64 = 1280;

/// Most padded bricks in flight: more would only delay the bricks of a newer plan.
pub(crate) const MAX_STAGED: u64 = 256;

/// Least sufficient host budget in bytes: the fixed part, and the simultaneous needs of one worker.
pub(crate) fn least_host(BufferSizes { fixed, scratch, core, padded }: BufferSizes) -> u64 {
    fixed + scratch + core + padded
}

/// Lets a source keep decoded chunks in a quarter of what a host budget leaves beside the least, and returns the sizes then. `sizes` counts what the
/// source keeps at most. The least is counted with as little kept as reading allows, so a budget of it suffices.
pub(crate) fn fit(source: &dyn BrickSource, host_bytes: u64, sizes: impl Fn() -> BufferSizes) -> BufferSizes {
    source.keep_at_most(0);
    let left = host_bytes.saturating_sub(least_host(sizes()));
    source.keep_at_most(left / 4);
    sizes()
}

/// Splits a host budget: at most an eighth for padded bricks, but one per worker, and the rest for cores. Every worker needs its scratch, a
/// core and a padded brick at once, so small budgets get fewer workers.
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
