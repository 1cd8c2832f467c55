//! Repair of a store's damaged files from its source: only these are made again, by the code of packing, and so become
//! the packed ones byte for byte.
//!
//! Documents of arrays follow from the root document. A survey decodes every brick, compares its hash, and reads every
//! page of side data. Damaged shards of level 0 are made from boxes of the source, under temporary names; each brick
//! must have its recorded hash. Only when all are made do they get their names. Coarse shards are made from the level
//! below, and aprons and side data from the cores. So nothing is taken from another source, and at any moment each file
//! is the damaged one or the sound one.
//!
//! Where the hashes are lost, sound bricks beside the damage are compared with the source instead, before and after.
//!
//! Costs a decoding of the whole store, and the reading of damaged shards from the source. Memory is independent of the
//! store's size.

mod documents;
mod error;
mod from_source;
mod pages;
mod rebuild;
mod survey;
#[cfg(test)]
mod tests;

pub use error::RepairError;

use crate::chunks::Chunks;
use crate::counts::{Counts, count_store};
use crate::error::{OpenError, ReadError};
use crate::folder::Folder;
use crate::held::{Held, find_finished};
use crate::json::read_json;
use crate::layout::ShardId;
use crate::metadata::{StoreInfo, parse_info};
use crate::pack::brick::Workspace;
use crate::pack::cascade::shape;
use crate::pack::disk::{Disk, DiskError, Part, temporary};
use crate::pack::shards::Finished;
use crate::pack::{ours, output, pool};
use crate::shard::{Fingerprint, ShardIndex};
use crate::shard_file::IoMode;
use crate::side::PageFile;
use crate::stats::{ChannelTotals, Measure};
use crate::store::{Store, open_folder};
use crate::verify::VerifyProblem;
use brickyard_import::Source;
use brickyard_volume::{BrickId, Level, PageId, with_voxel_type};
use from_source::{Bricks, difference, is_stored, reading_bytes, sound_bricks};
use rebuild::{Fault, Maker, Voxels, bricks_in, discard};
use std::collections::HashMap;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use survey::{ArrayId, Damage, Hashes, recorded, survey};

/// Bricks compared with the source beside each damaged shard.
const SAMPLE: usize = 4;

/// The program, its stacks and allocator.
const PROGRAM_BYTES: u64 = 24 << 20;

/// Outcome of a repair.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct RepairReport {
    /// The files made again, in order.
    pub repaired: Vec<PathBuf>,
    /// Damaged files that could not be made again, and why.
    pub left: Vec<VerifyProblem>,
}

/// Repairs a store from the source it was packed from, within `memory_bytes`, on at most `threads` threads. Calls
/// `progress` with the damaged shards made so far and in total, both 0 until known; it may cancel.
/// [`verify`](crate::verify()) tells whether the store is then sound.
///
/// # Errors
/// If there is no store, it is in use by another writer, the source is not its own or cannot be read, the memory is too
/// little, the disk fails, or `progress` cancels. No file is then worse than before.
pub fn repair(
    path: &Path,
    source: &dyn Source,
    memory_bytes: u64,
    threads: usize,
    progress: impl Fn(u64, u64) -> ControlFlow<()> + Sync,
) -> Result<RepairReport, RepairError> {
    repair_on(&Disk::default(), path, source, Limits { memory_bytes, threads }, &Watch::new(&progress))
}

#[derive(Clone, Copy)]
struct Limits {
    memory_bytes: u64,
    threads: usize,
}

/// The caller's progress, which may cancel: once, and for good.
struct Watch<'a> {
    progress: &'a (dyn Fn(u64, u64) -> ControlFlow<()> + Sync),
    is_cancelled: AtomicBool,
}

impl<'a> Watch<'a> {
    fn new(progress: &'a (dyn Fn(u64, u64) -> ControlFlow<()> + Sync)) -> Self {
        Self { progress, is_cancelled: AtomicBool::new(false) }
    }

    /// Reports the damaged shards made so far and in total. Returns whether to continue.
    fn goes_on(&self, done: u64, total: u64) -> bool {
        if (self.progress)(done, total).is_break() {
            self.is_cancelled.store(true, Ordering::Relaxed);
        }
        !self.is_cancelled.load(Ordering::Relaxed)
    }
}

fn repair_on(
    disk: &Disk,
    path: &Path,
    source: &dyn Source,
    limits: Limits,
    watch: &Watch<'_>,
) -> Result<RepairReport, RepairError> {
    let dir = find_finished(disk, path)?;
    // A lock would make the folder of a store that is missing, and nothing can be made without the root document.
    recorded_settings(&dir)?;
    let held = Held::take(disk, &dir)?;
    let mut report = RepairReport::default();
    for (path, document) in documents::damaged(&held.folder, source.info())? {
        documents::write(disk, &path, &document).map_err(|error| incomplete(error, &dir, &report))?;
        report.repaired.push(path);
    }
    let views = views(&held.folder)?;
    if let Some(what) = difference(source.info(), &views[0]) {
        return Err(RepairError::Unlike { store: dir, what });
    }
    let threads = threads_within(&views, source, limits)?;
    let pool = pool(threads).map_err(RepairError::Threads)?;
    with_voxel_type!(views[0].voxel_type(), T => {
        let (maker, bricks) = (Maker::<T>::new(&views[0]), Bricks::<T>::new(source, views[0].info()));
        let folder = held.folder.clone();
        let (pool, made) = (&pool, HashMap::new());
        let mut repair = Repair { disk, folder, views, pool, maker, bricks, made, report, watch };
        repair.run()?;
        Ok(repair.report)
    })
}

/// The settings in a store's root document, even if other files are damaged.
///
/// # Errors
/// If there is no store, or this document is damaged.
pub fn recorded_settings(path: &Path) -> Result<StoreInfo, OpenError> {
    let root_path = path.join("zarr.json");
    let root = read_json(&open_folder(path)?, &root_path);
    root.and_then(|root| parse_info(&root_path, &root)).map_err(|error| match error {
        // It may be unfinished, or no store at all.
        OpenError::Io { .. } => Store::open_own(path).err().unwrap_or(error),
        error => error,
    })
}

fn incomplete(DiskError { path, error }: DiskError, store: &Path, report: &RepairReport) -> RepairError {
    RepairError::Incomplete { path, error, store: store.into(), done: report.repaired.len() }
}

/// The main pyramid, and the second one, if there is one.
fn views(folder: &Arc<Folder>) -> Result<Vec<Store>, OpenError> {
    let main = Store::open_view(folder, IoMode::default(), None)?;
    let second = main.info().downsample.second().map(|method| main.reduced(method)).transpose()?;
    Ok(std::iter::once(main).chain(second).collect())
}

/// The threads of the survey that fit into memory.
fn threads_within(views: &[Store], source: &dyn Source, limits: Limits) -> Result<usize, RepairError> {
    let store = &views[0];
    let (core_bytes, voxel_bytes) = (store.core_bytes() as u64, store.voxel_type().bytes());
    let slots = store.layout().shard_slots(Level(0));
    let making = Workspace::<u8>::bytes(store.pyramid().edge() as usize, voxel_bytes) as u64
        + 32 * core_bytes
        + 64 * slots as u64
        + reading_bytes(source, store);
    let counting = store.channels() as u64 * ChannelTotals::bytes(store.voxel_type());
    let fixed = PROGRAM_BYTES
        .saturating_add(views.iter().map(Store::cache_bytes).sum::<u64>())
        .saturating_add(making)
        .saturating_add(counting);
    // A brick: encoded, shuffled and decoded; a shard's index, and its ranges in order.
    let of_thread = 3 * core_bytes + 16 * slots as u64 + ShardIndex::overlap_bytes(slots);
    let needed_bytes = fixed.saturating_add(of_thread);
    match limits.memory_bytes.checked_sub(needed_bytes) {
        Some(left) => Ok(((1 + left / of_thread) as usize).min(limits.threads.max(1))),
        None => Err(RepairError::Memory { needed_bytes, given_bytes: limits.memory_bytes }),
    }
}

/// A repair under way.
struct Repair<'a, T> {
    disk: &'a Disk,
    folder: Arc<Folder>,
    views: Vec<Store>,
    pool: &'a rayon::ThreadPool,
    maker: Maker<T>,
    bricks: Bricks<'a, T>,
    /// Fingerprints of shards made again whose record is lost.
    made: HashMap<(bool, bool, ShardId), Fingerprint>,
    report: RepairReport,
    watch: &'a Watch<'a>,
}

impl<T: Measure> Repair<'_, T> {
    fn run(&mut self) -> Result<(), RepairError> {
        let found = self.arrays().into_iter().map(|array| self.survey(array)).collect::<Result<Vec<Damage>, _>>()?;
        if found.iter().any(|damage| !damage.is_none()) {
            self.make(&found)?;
        }
        self.recount()
    }

    /// All arrays: cores by level, of the main pyramid and then the second one's own, then aprons likewise.
    fn arrays(&self) -> Vec<ArrayId> {
        let has_aprons = self.views[0].apron().is_some();
        let mut arrays = Vec::new();
        for are_aprons in [false, true].into_iter().filter(|are| !are || has_aprons) {
            for (is_second, store) in [false, true].into_iter().zip(&self.views) {
                let levels = store.layout().levels().filter(|level| !is_second || *level > Level(0));
                arrays.extend(levels.map(|level| ArrayId { is_second, level, are_aprons }));
            }
        }
        arrays
    }

    fn survey(&self, array: ArrayId) -> Result<Damage, RepairError> {
        let store = self.store(array);
        let goes_on = || self.watch.goes_on(0, 0);
        let damage = self.pool.install(|| survey(store, chunks(store, array), array, &goes_on));
        self.go_on(0, 0)?;
        damage.map_err(RepairError::Barred)
    }

    /// Reports the damaged shards made so far and in total.
    ///
    /// # Errors
    /// If the repair is cancelled.
    fn go_on(&self, done: u64, total: u64) -> Result<(), RepairError> {
        if self.watch.goes_on(done, total) {
            return Ok(());
        }
        Err(RepairError::Cancelled { store: self.folder.path().into(), done: self.report.repaired.len() })
    }

    fn store(&self, array: ArrayId) -> &Store {
        &self.views[usize::from(array.is_second)]
    }

    fn make(&mut self, found: &[Damage]) -> Result<(), RepairError> {
        let total = found.iter().map(|damage| damage.shards.len() as u64).sum();
        let mut done = 0;
        self.vouch(found)?;
        for damage in found.iter().filter(|damage| !damage.array.are_aprons) {
            match damage.array.level {
                Level(0) => self.finest(damage, total)?,
                _ => self.coarse(damage, done, total)?,
            }
            done += damage.shards.len() as u64;
            self.go_on(done, total)?;
            self.fingerprints(damage)?;
        }
        for damage in found.iter().filter(|damage| !damage.array.are_aprons) {
            for &page in &damage.hashes {
                let file = pages::hashes(self.store(damage.array), page);
                self.put(damage.array, page, file)?;
            }
            for &page in &damage.ranges {
                let file = pages::ranges::<T>(self.store(damage.array), page);
                self.put(damage.array, page, file)?;
            }
        }
        for damage in found.iter().filter(|damage| damage.array.are_aprons) {
            for &id in &damage.shards {
                let store = &self.views[usize::from(damage.array.is_second)];
                let made = self.maker.aprons(self.disk, store, chunks(store, damage.array), id);
                self.settle_made(damage.array, id, made)?;
                done += 1;
                self.go_on(done, total)?;
            }
            self.fingerprints(damage)?;
        }
        Ok(())
    }

    /// Makes the damaged shards of level 0, all before the first gets its name.
    fn finest(&mut self, damage: &Damage, total: u64) -> Result<(), RepairError> {
        let mut finished = Vec::new();
        let store = &self.views[0];
        let layout = store.layout().clone();
        for &id in &damage.shards {
            let made = match self.maker.cores(self.disk, store, id, Voxels::OfSource(&mut self.bricks)) {
                Ok(made) => {
                    finished.push(made);
                    self.go_on(finished.len() as u64, total)
                }
                Err(fault) => Err(self.stopped(fault)),
            };
            if let Err(error) = made {
                finished.iter().for_each(|made: &Finished| discard(self.disk, store, &layout, made.id));
                return Err(error);
            }
        }
        if !damage.hashes.is_empty()
            && let Err(error) = self.compare(&damage.shards)
        {
            finished.iter().for_each(|made| discard(self.disk, &self.views[0], &layout, made.id));
            return Err(error);
        }
        for (i, made) in finished.iter().enumerate() {
            if let Err(error) = self.settle(damage.array, made) {
                finished[i..].iter().for_each(|made| discard(self.disk, &self.views[0], &layout, made.id));
                return Err(error);
            }
        }
        self.reopen()
    }

    fn coarse(&mut self, damage: &Damage, before: u64, total: u64) -> Result<(), RepairError> {
        for (done, &id) in (before..).zip(&damage.shards) {
            self.go_on(done, total)?;
            let store = &self.views[usize::from(damage.array.is_second)];
            let made = self.maker.cores(self.disk, store, id, Voxels::OfFinerLevel);
            self.settle_made(damage.array, id, made)?;
        }
        if damage.shards.is_empty() { Ok(()) } else { self.reopen() }
    }

    /// Settles a shard, or reports it as left if it cannot be made.
    fn settle_made(&mut self, array: ArrayId, id: ShardId, made: Result<Finished, Fault>) -> Result<(), RepairError> {
        match made {
            Ok(made) => self.settle(array, &made).inspect_err(|_| {
                let store = &self.views[usize::from(array.is_second)];
                discard(self.disk, store, chunks(store, array).layout(), id);
            }),
            Err(Fault::Lost(what)) => {
                let path = chunks(self.store(array), array).path(id);
                self.report.left.push(VerifyProblem { brick: None, path, what });
                Ok(())
            }
            Err(fault) => Err(self.stopped(fault)),
        }
    }

    /// Gives a made shard its name, if it is as recorded.
    fn settle(&mut self, array: ArrayId, made: &Finished) -> Result<(), RepairError> {
        let chunks = chunks(self.store(array), array);
        let (path, has_file) = (chunks.path(made.id), chunks.has_file(made.id));
        match recorded(chunks, made.id).map_err(RepairError::Barred)? {
            Some(recorded) if recorded != made.fingerprint => {
                discard(self.disk, self.store(array), chunks.layout(), made.id);
                let [expected, found] = [recorded, made.fingerprint].map(|fingerprint| fingerprint.file_bytes);
                let what = format!(
                    "holds the right voxels when made again, but in {found} bytes, where {expected} were packed: another \
                     version of the program compressed it; repair it with that one, or pack the store again"
                );
                self.report.left.push(VerifyProblem { brick: None, path, what });
                return Ok(());
            }
            Some(_) => {}
            None => drop(self.made.insert((array.is_second, array.are_aprons, made.id), made.fingerprint)),
        }
        if !made.fingerprint.has_file() && !has_file {
            return Ok(());
        }
        let placed = if made.fingerprint.has_file() { self.place(&path) } else { self.remove(&path) };
        placed.map_err(|error| incomplete(error, self.folder.path(), &self.report))?;
        self.report.repaired.push(path);
        Ok(())
    }

    /// Syncs a file under its temporary name, and names it.
    fn place(&self, path: &Path) -> Result<(), DiskError> {
        let temporary = temporary(path);
        let file = self.disk.reopen(&temporary)?;
        self.disk.sync(&temporary, &file)?;
        self.disk.name(path)?;
        self.sync_folders(path)
    }

    /// Removes the file of a shard that has none.
    fn remove(&self, path: &Path) -> Result<(), DiskError> {
        self.disk.remove_file(path)?;
        self.disk.sync_dir(output::parent(path))
    }

    /// Makes the names of a file and of its folders durable.
    fn sync_folders(&self, path: &Path) -> Result<(), DiskError> {
        let inside = path.ancestors().skip(1).take_while(|folder| folder.starts_with(self.folder.path()));
        inside.into_iter().try_for_each(|folder| self.disk.sync_dir(folder))
    }

    /// Makes an array's lost pages of fingerprints.
    fn fingerprints(&mut self, damage: &Damage) -> Result<(), RepairError> {
        let array = damage.array;
        let of_array = |(key, fingerprint): (&(bool, bool, ShardId), &Fingerprint)| {
            let is_own = (key.0, key.1, key.2.level) == (array.is_second, array.are_aprons, array.level);
            is_own.then_some((key.2, *fingerprint))
        };
        let made: HashMap<ShardId, Fingerprint> = self.made.iter().filter_map(of_array).collect();
        for &page in &damage.fingerprints {
            let store = self.store(array);
            let file = pages::fingerprints(store, chunks(store, array), page, &made);
            self.put(array, page, file)?;
        }
        if damage.fingerprints.is_empty() { Ok(()) } else { self.reopen() }
    }

    /// Writes a page of side data, or reports it as left.
    fn put(
        &mut self,
        array: ArrayId,
        page: PageId,
        file: Result<Option<PageFile>, ReadError>,
    ) -> Result<(), RepairError> {
        let Some((path, bytes)) = survey::of_store(file).map_err(RepairError::Barred)?.flatten() else {
            let what = format!(
                "page {},{},{} of step {} follows from files that cannot be read",
                page.x, page.y, page.z, page.time
            );
            let store = self.store(array);
            let path = chunks(store, array).layout().side_dir(store.path(), page.level);
            self.report.left.push(VerifyProblem { brick: None, path, what });
            return Ok(());
        };
        if self.report.repaired.contains(&path) {
            // It holds several steps.
            return Ok(());
        }
        let written = self.disk.create_parent(&path).and_then(|()| self.disk.write(&path, &bytes));
        let written = written.inspect_err(|_| drop(ours::remove_file(self.disk, &temporary(&path))));
        let written = written.and_then(|()| self.sync_folders(&path));
        written.map_err(|error| incomplete(error, self.folder.path(), &self.report))?;
        self.report.repaired.push(path);
        Ok(())
    }

    /// Compares the source with sound bricks beside each damaged shard of level 0; if there are none, with some others.
    fn vouch(&mut self, found: &[Damage]) -> Result<(), RepairError> {
        let finest = found.first().map_or(&[][..], |damage| &damage.shards);
        if !finest.is_empty() {
            return self.compare(finest);
        }
        self.compare(&[self.views[0].layout().shard_at(Level(0), 0)])
    }

    /// Compares the source with sound bricks beside these shards of level 0.
    ///
    /// # Errors
    /// If a brick differs, or a shard has neither hashes nor such a brick.
    fn compare(&mut self, shards: &[ShardId]) -> Result<(), RepairError> {
        let store = &self.views[0];
        let mut core = vec![0; store.core_bytes()];
        for &id in shards {
            let layout = store.layout();
            let bricks = bricks_in(layout, id);
            let Some(first) = (0..layout.shard_slots(id.level)).find_map(|slot| layout.brick_at(id, slot)) else {
                continue;
            };
            let sample = sound_bricks(store, first, bricks, SAMPLE);
            if sample.is_empty() {
                let mut hashes = Hashes::default();
                let mut all = (0..layout.shard_slots(id.level)).filter_map(|slot| layout.brick_at(id, slot));
                let mut is_recorded = |brick| Ok::<bool, ReadError>(hashes.of(store, brick)?.is_some());
                if !all.try_fold(true, |all, brick| Ok(all && is_recorded(brick)?)).map_err(RepairError::Barred)? {
                    let what = "neither a record nor a sound one";
                    return Err(RepairError::Unvouched { store: store.path().into(), what });
                }
            }
            for brick in sample {
                let region = store.pyramid().brick_box(Level(0), brick.index);
                self.bricks.read(&mut self.maker.workspace, brick, region, region)?;
                self.maker.workspace.digest(0, shape(region), false);
                is_stored(store, brick, &mut core).map_err(RepairError::Barred)?;
                if bytemuck::cast_slice::<T, u8>(self.maker.workspace.core(0)) != core {
                    return Err(self.unlike(brick));
                }
            }
        }
        Ok(())
    }

    fn unlike(&self, brick: BrickId) -> RepairError {
        let what = format!("it has other voxels in {brick}");
        RepairError::Unlike { store: self.folder.path().into(), what }
    }

    fn stopped(&self, fault: Fault) -> RepairError {
        match fault {
            Fault::Unlike(brick) => self.unlike(brick),
            Fault::Source(error) => error.into(),
            Fault::Barred(error) => RepairError::Barred(error),
            Fault::Disk(error) => incomplete(error, self.folder.path(), &self.report),
            Fault::Lost(what) => RepairError::Unlike { store: self.folder.path().into(), what },
        }
    }

    /// Counts the values of a store with appended steps anew, if their counts are damaged.
    fn recount(&mut self) -> Result<(), RepairError> {
        let store = &self.views[0];
        let Some(times) = store.info().times else { return Ok(()) };
        let counts = Counts::of(store);
        let read = survey::of_store(counts.read(store, times)).map_err(RepairError::Barred)?;
        if read.flatten().is_some() {
            return Ok(());
        }
        let counted = self.pool.install(|| count_store::<T>(store));
        let Some(counted) = survey::of_store(counted).map_err(RepairError::Barred)? else { return Ok(()) };
        let folder = output::parent(counts.folder());
        let written = counts.write(self.disk, times, &counted);
        let parts = [Part::Tree(counts.folder()), Part::Folder(folder)];
        let written = written.and_then(|()| self.disk.sync_parts(self.folder.path(), parts));
        written.map_err(|error| incomplete(error, self.folder.path(), &self.report))?;
        self.report.repaired.push(counts.dir(times));
        Ok(())
    }

    /// Opens the store anew: open shards and pages may be those from before.
    fn reopen(&mut self) -> Result<(), RepairError> {
        self.views = views(&self.folder)?;
        Ok(())
    }
}

/// The shards of an array.
fn chunks(store: &Store, array: ArrayId) -> &Chunks {
    store.aprons().filter(|_| array.are_aprons).unwrap_or(store.cores())
}
