//! The index of an image: exact statistics of its channels, the range of each brick, and its coarse levels.
//!
//! The index of another program's image lies in the user's cache (`foreign/index.rs`), the index of a store of brickyard's in the store. Once another program
//! wrote into level 0, the code of packing makes a store anew, which replaces the former one ([`Remake`]). Shards of level 0 as recorded stay; others
//! are packed again from their voxels, and so are shards with padding, which no record covers. Costs a reading of level 0, once.

#[cfg(test)]
mod tests;

use crate::append::{AppendOptions, FOREIGN_STEPS, foreign_steps, update_root};
use crate::counts::Counts;
use crate::error::OpenError;
use crate::folder::Folder;
use crate::foreign::{self, ImageIndexError};
use crate::held::find_finished;
use crate::json::read_json;
use crate::layout::{Layout, ShardId};
use crate::metadata::{ChannelStatistics, StoreInfo, root_document, voxel_documents};
use crate::ngff::Root;
use crate::pack::disk::Disk;
use crate::pack::journal::on_disk;
use crate::pack::{PackError, Progress};
use crate::remake::{Documents, Kept, Remake, RemakeError, Work};
use crate::shard::Fingerprint;
use crate::side::SideArray;
use crate::stats::ChannelTotals;
use crate::store::Store;
use crate::verify::documents::{array_change, root_change};
use brickyard_import::zarr::open_image;
use brickyard_import::{Described, Source, SourceInfo};
use brickyard_volume::Level;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use xxhash_rust::xxh3::xxh3_64;

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
    /// Changes of level 0 since it was packed or indexed; `None` of another program's image.
    pub changes: Option<Changes>,
}

/// Changes of a store's level 0 since its records were made.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Changes {
    /// Bricks with other voxels, or without a readable record.
    pub bricks: u64,
    /// Shards without their file, whose bricks are now all fill.
    pub lost_shards: u64,
}

/// Makes the index of another program's image, or makes that of a store of brickyard's again, within 2 GiB of memory, by all processors. `progress` is called with the
/// bricks done and all of them.
///
/// # Errors
/// If there is no such image, it is in use by another writer, it has too many bricks, one cannot be read, nothing can be kept, or `progress` breaks.
pub fn index(path: &Path, progress: impl Fn(u64, u64) -> ControlFlow<()> + Sync) -> Result<IndexReport, IndexError> {
    if let Some(store) = foreign::folder_of_place(path).filter(|folder| foreign::is_own(folder)) {
        let what = format!("is a part of a store of brickyard's: index that, {}", store.display());
        return Err(RemakeError::Open(OpenError::Unfit { path: path.into(), what }).into());
    }
    if foreign::is_foreign(path) {
        let (bricks, cache_bytes) = foreign::index(path, progress)?;
        return Ok(IndexReport { bricks, cache_bytes, changes: None });
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
    let store = Store::open_own(&dir)?;
    let mut root = checked_root(&store)?;
    let voxels = level_0(&store)?;
    let AppendOptions { memory_bytes, threads } = AppendOptions::default();
    let StoreInfo { downsample, kind, .. } = *store.info();
    let work = Work { memory_bytes, threads, progress: &() };
    let remake = Remake::new(&store, &voxels, "index", downsample, kind, work)?;
    let bricks = remake.brick_count();
    let (kept, lost_shards) = survey(&store);
    let mut changes = Changes { bricks: 0, lost_shards };
    let watch = Watch { progress, bricks, done: AtomicU64::new(0) };
    remake.run(disk, &watch, &Kept::Shards(kept), |new, totals| {
        if let Some(times) = store.info().times {
            let counts = Counts::in_folder(store.layout(), new);
            counts.write(disk, times, totals).map_err(PackError::from)?;
        }
        changes.bricks = changed_bricks(&store, new)?;
        let mut info = StoreInfo { channels: statistics(store.info(), totals), ..store.info().clone() };
        if changes.bricks > 0 {
            // It no longer is what a pack with these settings makes.
            let former = format!("{} indexed", info.settings_fingerprint);
            info.settings_fingerprint = format!("{:016x}", xxh3_64(former.as_bytes()));
        }
        let written = |info: &StoreInfo| root_document(store.layout(), store.geometry(), info);
        update_root(&written(store.info()), &written(&info), &mut root.document);
        let root = root.bytes(&dir.join("zarr.json"))?;
        Ok(Documents { info, root })
    })?;
    Ok(IndexReport { bricks, cache_bytes: 0, changes: Some(changes) })
}

/// The store's root document, if it is as written.
fn checked_root(store: &Store) -> Result<Root, RemakeError> {
    let path = store.path().join("zarr.json");
    let root = Root::read(store.folder(), &path)?;
    if let Some(change) = root_change(store, root.clone()) {
        return Err(RemakeError::Altered { path, change });
    }
    // The array's own document stays, with what other programs added to it.
    for (path, expected) in voxel_documents(store.path(), store.layout(), Level(0), store.info()) {
        let found = read_json(store.folder(), &path)?;
        if let Some(change) = array_change(&expected, found, store.info().times) {
            return Err(RemakeError::Altered { path, change });
        }
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
        nodata: store.info().source_nodata(),
        ..SourceInfo::of_volume(store.pyramid().levels()[0].extent, store.voxel_type())
    };
    Ok(Described { info, source, first: 0 })
}

/// The shards of level 0 that stay, with their fingerprints, and the number of those whose file is lost.
fn survey(store: &Store) -> (Vec<(ShardId, Fingerprint)>, u64) {
    let (chunks, mut kept, mut lost) = (store.cores(), Vec::new(), 0);
    for shard in store.layout().shards(Level(0)) {
        let recorded = chunks.fingerprint(shard).ok().filter(|recorded| recorded.has_file());
        match (recorded, on_disk(&chunks.path(shard))) {
            // Steps of one shard share equal bricks, as packing finds them.
            (Some(recorded), Some(found))
                if recorded == found && !is_padded(store.layout(), shard) && store.layout().shard_times == 1 =>
            {
                kept.push((shard, found));
            }
            (Some(_), None) => lost += 1,
            _ => {}
        }
    }
    (kept, lost)
}

/// Bricks of level 0 whose hash is another one in the store made in the folder `new`.
fn changed_bricks(store: &Store, new: &Path) -> Result<u64, RemakeError> {
    let io = |error| PackError::Io { path: new.into(), error };
    let (layout, new_folder) = (store.layout(), Folder::open(new).map_err(io)?);
    let [former, made] = [store.path(), new].map(|path| SideArray::hashes(path, layout, Level(0)));
    let mut changed = 0;
    for page in (0..made.page_count()).map(|i| made.page_at(Level(0), i)) {
        let found =
            made.read_page(&new_folder, page).map_err(|error| PackError::ReadBack { error, store: new.into() })?;
        let recorded = former.read_page(store.folder(), page).unwrap_or_default();
        let hashes = found.chunks(size_of::<u128>()).enumerate();
        let is_same = |(i, hash): (usize, &[u8])| recorded.get(i * hash.len()..(i + 1) * hash.len()) == Some(hash);
        changed += hashes.filter(|hash| !is_same(*hash)).count() as u64;
    }
    Ok(changed)
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

/// The statistics of the voxels found, with the channels' looks.
fn statistics(info: &StoreInfo, totals: &[ChannelTotals]) -> Vec<ChannelStatistics> {
    let found = totals.iter().map(ChannelTotals::finish).zip(&info.channels);
    found.map(|(found, former)| found.with_looks_of(former, former.usual_window())).collect()
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
