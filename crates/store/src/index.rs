//! The index of an image: exact statistics of its channels, the range of each brick, and its coarse levels.
//!
//! Of another program's image it is kept in the user's cache (`foreign/index.rs`). A store of brickyard's has it in itself; once another program wrote
//! into level 0, it is made again by the code of packing, in a store that replaces the former one ([`Remake`]). Shards of level 0 that are as recorded
//! stay; others are packed again from their voxels, as are those with padding, whose voxels no record covers. Costs a reading of level 0, once.

#[cfg(test)]
mod tests;

use crate::append::{AppendOptions, FOREIGN_STEPS, foreign_steps, update_root};
use crate::counts::Counts;
use crate::error::OpenError;
use crate::foreign::{self, ImageIndexError};
use crate::held::find_finished;
use crate::layout::{Layout, ShardId};
use crate::metadata::{ChannelStatistics, StoreInfo, root_document};
use crate::ngff::Root;
use crate::pack::Progress;
use crate::pack::disk::Disk;
use crate::pack::journal::on_disk;
use crate::remake::{Documents, Kept, Remake, RemakeError, Work};
use crate::shard::Fingerprint;
use crate::stats::ChannelTotals;
use crate::store::Store;
use crate::verify::documents::root_change;
use brickyard_import::zarr::open_image;
use brickyard_import::{Described, Source, SourceInfo};
use brickyard_volume::Level;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::SystemTime;

/// Why there is no index.
#[derive(Debug, thiserror::Error)]
pub enum IndexError {
    /// Another program's image is not indexed.
    #[error(transparent)]
    Image(#[from] ImageIndexError),
    /// A store of brickyard's is not indexed.
    #[error(transparent)]
    Store(#[from] RemakeError),
}

/// Outcome of an indexing.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct IndexReport {
    /// Bricks of all levels, time steps and channels.
    pub bricks: u64,
    /// Bytes of the index in the cache; 0 of a store of brickyard's.
    pub cache_bytes: u64,
    /// Shards of level 0 unlike their records; `None` of another program's image.
    pub shards: Option<ShardChanges>,
}

/// Shards of level 0 beside their records.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct ShardChanges {
    /// Shards in another file than was packed.
    pub changed: u64,
    /// Shards with a file where none was packed.
    pub added: u64,
    /// Shards without their file, which are now all fill.
    pub gone: u64,
}

/// Makes the index of another program's image, or makes that of a store of brickyard's again, within 2 GiB of memory, by all processors. `progress` is called with the
/// bricks done and all of them.
///
/// # Errors
/// If there is no such image, it is in use by another writer, it has too many bricks, one cannot be read, nothing can be kept, or `progress` breaks.
pub fn index(path: &Path, progress: impl Fn(u64, u64) -> ControlFlow<()> + Sync) -> Result<IndexReport, IndexError> {
    if foreign::is_foreign(path) {
        let (bricks, cache_bytes) = foreign::index(path, progress)?;
        return Ok(IndexReport { bricks, cache_bytes, shards: None });
    }
    Ok(index_own(&Disk::default(), path, &progress)?)
}

/// Makes the index of a store of brickyard's again.
pub(crate) fn index_own(
    disk: &Disk,
    path: &Path,
    progress: &(dyn Fn(u64, u64) -> ControlFlow<()> + Sync),
) -> Result<IndexReport, RemakeError> {
    let dir = find_finished(disk, path)?;
    let (shards, begun) = (dir.join("0/c"), SystemTime::now());
    let state = foreign::state_of_files(&shards, begun);
    let store = Store::open_own(&dir)?;
    let mut root = checked_root(&store)?;
    let voxels = level_0(&store)?;
    let AppendOptions { memory_bytes, threads } = AppendOptions::default();
    let methods = (store.info().downsample, store.info().kind);
    let remake = Remake::new(&store, &voxels, "index", methods, Work { memory_bytes, threads, progress: &() })?;
    let bricks = remake.brick_count();
    let (kept, changes) = survey(&store);
    let watch = Watch { progress, bricks, done: AtomicU64::new(0) };
    remake.run(disk, &watch, &Kept::Shards(kept), |new, totals| {
        if state.is_some() && foreign::state_of_files(&shards, begun) != state {
            let problem = "another program wrote into level 0 meanwhile".into();
            return Err(RemakeError::Levels { store: dir.clone(), problem });
        }
        if let Some(times) = store.info().times {
            let counts = Counts::in_folder(store.layout(), new);
            counts.write(disk, times, totals).map_err(crate::pack::PackError::from)?;
        }
        let info = StoreInfo { channels: statistics(store.info(), totals), ..store.info().clone() };
        let written = |info: &StoreInfo| root_document(store.layout(), store.geometry(), info);
        update_root(&written(store.info()), &written(&info), &mut root.document);
        let root = root.bytes(&dir.join("zarr.json"))?;
        Ok(Documents { info, root })
    })?;
    Ok(IndexReport { bricks, cache_bytes: 0, shards: Some(changes) })
}

/// The store's root document, if it is as written.
fn checked_root(store: &Store) -> Result<Root, RemakeError> {
    let path = store.path().join("zarr.json");
    let root = Root::read(store.folder(), &path)?;
    if let Some(change) = root_change(store, root.clone()) {
        return Err(RemakeError::Altered { path, change });
    }
    match foreign_steps(store)? {
        Some((path, found)) => {
            let expected = format!("{}, as in the root document: {FOREIGN_STEPS}", store.times());
            Err(OpenError::invalid(&path, "shape[0]", expected, found).into())
        }
        None => Ok(root),
    }
}

/// The voxels of level 0 as any reader of Zarr sees them, whatever the side data record.
fn level_0(store: &Store) -> Result<Described<Arc<dyn Source>>, OpenError> {
    let mut place = store.path().as_os_str().to_owned();
    place.push("::0");
    let source = open_image(&PathBuf::from(place))?.levels.swap_remove(0).source;
    let info = SourceInfo {
        times: store.times(),
        channels: store.channels(),
        geometry: store.geometry().clone(),
        nodata: store.info().nodata.map(|nodata| nodata as f64),
        ..SourceInfo::of_volume(store.pyramid().levels()[0].extent, store.voxel_type())
    };
    Ok(Described { info, source, first: 0 })
}

/// The shards of level 0 that stay, with their fingerprints, and the changes of the others.
fn survey(store: &Store) -> (Vec<(ShardId, Fingerprint)>, ShardChanges) {
    let (chunks, mut kept, mut changes) = (store.cores(), Vec::new(), ShardChanges::default());
    for shard in store.layout().shards(Level(0)) {
        let recorded = chunks.fingerprint(shard).ok().filter(|recorded| recorded.has_file());
        match (recorded, on_disk(&chunks.path(shard))) {
            (Some(recorded), Some(found)) if recorded == found => {
                if !is_padded(store.layout(), shard) {
                    kept.push((shard, found));
                }
            }
            (Some(_), Some(_)) => changes.changed += 1,
            (None, Some(_)) => changes.added += 1,
            (Some(_), None) => changes.gone += 1,
            (None, None) => {}
        }
    }
    (kept, changes)
}

/// Whether a shard has a brick that reaches past the volume.
fn is_padded(layout: &Layout, shard: ShardId) -> bool {
    let grid = layout.pyramid.level(shard.level);
    let (extent, bricks) = (grid.extent.to_array(), grid.bricks.to_array());
    let (place, of_shard) = ([shard.x, shard.y, shard.z], layout.shard_bricks(shard.level).to_array());
    (0..3).any(|axis| {
        let is_last = (place[axis] + 1) * of_shard[axis] >= bricks[axis];
        is_last && !extent[axis].is_multiple_of(layout.pyramid.edge())
    })
}

/// The statistics of the voxels found. Windows given by a source stay; others follow from the values.
fn statistics(info: &StoreInfo, totals: &[ChannelTotals]) -> Vec<ChannelStatistics> {
    let with_looks = |(found, former): (&ChannelTotals, &ChannelStatistics)| {
        let found = found.finish();
        let window = if former.window == former.usual_window() { found.window } else { former.window };
        let ChannelStatistics { name, color, unit, .. } = former.clone();
        ChannelStatistics { window, name, color, unit, ..found }
    };
    totals.iter().zip(&info.channels).map(with_looks).collect()
}

/// The caller's progress, in bricks.
struct Watch<'a> {
    progress: &'a (dyn Fn(u64, u64) -> ControlFlow<()> + Sync),
    bricks: u64,
    done: AtomicU64,
}

impl Progress for Watch<'_> {
    fn advanced(&self, done: u64, total: u64) {
        let share = done as f64 / total.max(1) as f64;
        self.done.store((share * self.bricks as f64) as u64, Ordering::Relaxed);
    }

    fn is_cancelled(&self) -> bool {
        // The coarser levels' last bricks, and the documents, are still to come.
        let done = self.done.load(Ordering::Relaxed).min(self.bricks.saturating_sub(1));
        (self.progress)(done, self.bricks).is_break()
    }
}
