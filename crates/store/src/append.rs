//! Appending: time steps, for instance from a running simulation, join a store while others read it.
//!
//! Each step is packed by the pass for whole stores (`pack/cascade.rs`), as the last step of the store: its files have
//! its number in each array, and only documents change. So an append costs the packing of one step, whatever their
//! number.
//!
//! The *commit* of a step is the order in which it becomes part of the store:
//!
//! 1. Its shards and pages of side data, the value counts of all steps (`counts.rs`) and the documents under temporary
//!    names are written and synced, together if the file system can;
//! 2. each array's document gains the step, coarse levels first, level 0 last, and is synced;
//! 3. the root document counts it, with the times and statistics of all steps, and in metadata consolidated there by
//!    other programs.
//!
//! This program reads only the steps counted by the root document. After an earlier kill, the next opening of an
//! [`Appender`] rolls back the uncounted step's files and documents before writing anything. Documents are replaced in
//! one step.
//!
//! A step is part of the store once its root document has its name. A failure to sync the name afterwards reports both
//! ([`AppendError::Appended`]), and the next opening of an [`Appender`] syncs it first.
//!
//! A packed store counts its steps from its first commit on, before any array gains a step, and their values before
//! that.

mod documents;
mod error;
mod step;
#[cfg(test)]
mod tests;

pub use error::AppendError;

use crate::counts::{Counts, count_store};
use crate::error::{OpenError, ReadError};
use crate::folder::Folder;
use crate::held::{Held, HoldError, find_finished, unfinished};
use crate::json::read_json;
use crate::metadata::{ChannelStatistics, StoreInfo, document_bytes, root_document};
use crate::ngff::Root;
use crate::pack::cascade::{Pass, Stop, Stopped};
use crate::pack::disk::{Disk, DiskError, Part, temporary};
use crate::pack::journal::Journal;
use crate::pack::plan::plan_last;
use crate::pack::{Exists, PackError, PackOptions, Progress, ours, output, pack_on, pool, run_passes, tell};
use crate::shard_file::IoMode;
use crate::stats::ChannelTotals;
use crate::store::Store;
use brickyard_import::{Source, axes_in_words};
use brickyard_volume::{TimeAxis, with_voxel_type};
pub(crate) use documents::{FOREIGN_STEPS, foreign_steps, stale_groups, update_root};
use documents::{array_dirs, update_consolidated};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use step::{check_nodata, first_step, next_axis, next_step, own_time};

/// Resources for appending.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AppendOptions {
    /// Most anonymous memory for appending, in bytes.
    pub memory_bytes: u64,
    /// Worker threads, at least 1. Reading whole planes and writing files use further threads.
    pub threads: usize,
}

/// 2 GiB of memory, and one thread per processor.
impl Default for AppendOptions {
    fn default() -> Self {
        Self { memory_bytes: 2 << 30, threads: std::thread::available_parallelism().map_or(1, usize::from) }
    }
}

/// Outcome of appending a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AppendReport {
    /// The step's number.
    pub step: u32,
    /// Bytes written to shards.
    pub written_bytes: u64,
    /// NaN and infinite voxels in the step's level 0.
    pub non_finite: u64,
    /// No-data integers in the step's level 0.
    pub nodata: u64,
}

/// Exclusive writer of time steps to a store. While it exists, no one else, in this process or another, can pack or
/// append; reading is allowed.
pub struct Appender {
    disk: Disk,
    folder: Arc<Folder>,
    options: AppendOptions,
    times: u32,
    _held: Held,
}

fn can_grow(store: &Store) -> Result<(), AppendError> {
    let steps = store.layout().shard_times;
    let path = || store.path().to_owned();
    match store.can_grow() {
        true => Ok(()),
        false if steps > 1 => Err(AppendError::Grouped { store: path(), steps }),
        false => Err(AppendError::NoTime { store: path() }),
    }
}

impl Appender {
    /// Opens a store for appending, and rolls back an interrupted append.
    ///
    /// # Errors
    /// If the store is missing, unfinished, without a time axis, not writable, or has another writer.
    pub fn open(store: &Path, options: AppendOptions) -> Result<Self, AppendError> {
        Self::open_on(Disk::default(), store, options)
    }

    /// Packs the first step of a new store, and opens it to append more. The step's time is `stamp`, or the source's;
    /// if neither is known, steps are counted. An interrupted first step is resumed; if only its very end was missing,
    /// a different source is the next step.
    ///
    /// # Errors
    /// If a finished store exists, as for packing with [`Exists::Resume`], or, as [`AppendError::Appended`], as for
    /// [`Appender::open`].
    pub fn create(
        store: &Path,
        source: &dyn Source,
        stamp: Option<f64>,
        options: &PackOptions,
        progress: &dyn Progress,
    ) -> Result<Self, AppendError> {
        Self::create_on(Disk::default(), store, source, stamp, options, progress)
    }

    fn create_on(
        disk: Disk,
        store: &Path,
        source: &dyn Source,
        stamp: Option<f64>,
        options: &PackOptions,
        progress: &dyn Progress,
    ) -> Result<Self, AppendError> {
        let first = first_step(source, stamp)?;
        let options = PackOptions { exists: Exists::Resume, ..options.clone() };
        let resources = AppendOptions { memory_bytes: options.memory_bytes, threads: options.threads };
        match pack_on(&disk, &first, store, &options, progress) {
            Ok(report) if report.was_complete => {
                return Err(PackError::Exists { path: store.into(), unfinished: false }.into());
            }
            Ok(_) => {}
            Err(error @ PackError::Incomplete { .. }) if is_finished(store) => {
                return Err(AppendError::of_first(error).after(store, 0));
            }
            Err(PackError::Mismatch { .. }) if output::end(&disk, store)? => {
                let mut appender = Self::open_on(disk, store, resources)?;
                return appender.append(source, stamp, progress).map(|_| appender);
            }
            Err(error) => return Err(AppendError::of_first(error)),
        }
        Self::open_on(disk, store, resources).map_err(|error| error.after(store, 0))
    }

    fn open_on(disk: Disk, store: &Path, options: AppendOptions) -> Result<Self, AppendError> {
        let dir = find_finished(&disk, store)?;
        can_grow(&Store::open_own(&dir)?)?;
        let held = Held::take(&disk, &dir)?;
        let mut appender = Self { disk, folder: held.folder.clone(), options, times: 0, _held: held };
        appender.take_back().map_err(|error| appender.stopped(error))?;
        can_grow(&appender.open_store()?)?;
        Ok(appender)
    }

    /// Number of time steps in the store.
    pub fn times(&self) -> u32 {
        self.times
    }

    /// The directory of the store.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Appends the only step of a source, taken at `stamp`. By default, the source's own time counts if it starts
    /// elsewhere than the store's; otherwise steps continue evenly. On return, the step survives a crash.
    ///
    /// # Errors
    /// If the step does not fit the store, its time is not after the last one's, or the source or the disk fails. The
    /// store then keeps its steps ([`Appender::times`]), and the same step can be appended again. Except with
    /// [`AppendError::Appended`]: then the step is part of the store and must not be appended again, but may not
    /// survive a power failure.
    pub fn append(
        &mut self,
        source: &dyn Source,
        stamp: Option<f64>,
        progress: &dyn Progress,
    ) -> Result<AppendReport, AppendError> {
        let before = self.times;
        let appended = self.take_back().and_then(|()| self.append_next(source, stamp, progress));
        appended.map_err(|error| {
            // If the rollback fails now, it is repeated before the next step.
            let _ = self.take_back();
            let error = if self.folder.is_replaced() { self.folder.replaced().into() } else { self.stopped(error) };
            if self.times > before { error.after(self.path(), before) } else { error }
        })
    }

    fn append_next(
        &mut self,
        source: &dyn Source,
        stamp: Option<f64>,
        progress: &dyn Progress,
    ) -> Result<AppendReport, Failed> {
        let store = self.open_store()?;
        let step = next_step(source, &store)?;
        let own = own_time(&store, source).filter(|_| stamp.is_none() && source.info().time.is_none());
        let time = next_axis(&store, source.info().time.as_ref(), stamp.or(own.as_ref().and_then(|own| own.0)))?;
        let options = self.pack_options(store.info());
        let times = store.times().checked_add(1).ok_or_else(|| too_many(&store))?;
        let plan = plan_last(&step, &options, &store.layout().with_times(times))?;
        let counted = self.counted(&store, progress)?;
        let before = counted.clone();
        let (non_finite, nodata) = left_out(&before);
        tell(source.info(), progress);
        own.into_iter().for_each(|(_, note)| progress.note(&note));
        if let Some(flip) = source.info().flip.filter(|flip| *flip != store.info().flipped) {
            let [own, ours] = [flip, store.info().flipped].map(|flip| match axes_in_words(flip) {
                none if none.is_empty() => "no axis".to_owned(),
                axes => axes,
            });
            progress.note(&format!("The step is flipped along {own}, the store's first along {ours}."));
        }
        progress.planned(&plan);
        let pass =
            Pass { source: &step, store: self.path(), options: &options, plan: &plan, disk: &self.disk, progress };
        let passed = run_passes(&pass, &mut Journal::none(&self.disk, self.path()), counted)?;
        check_nodata(source.info(), &store, left_out(&passed.channels).1 - nodata)?;
        self.commit(times, time, &before, &passed.channels)?;
        for group in stale_groups(self.path()) {
            let what = "holds a copy of this store's metadata without the new step: consolidate it anew";
            progress.warn(&format!("{}: {what} (zarr.consolidate_metadata)", group.display()));
        }
        let after = left_out(&passed.channels);
        Ok(AppendReport {
            step: times - 1,
            written_bytes: passed.written_bytes,
            non_finite: after.0 - non_finite,
            nodata: after.1 - nodata,
        })
    }

    /// Refuses a change based on a replaced store.
    fn refuse_replaced(&self) -> Result<(), OpenError> {
        if self.folder.is_replaced() { Err(self.folder.replaced()) } else { Ok(()) }
    }

    /// Opens the store, including a second pyramid's documents.
    fn open_store(&self) -> Result<Store, OpenError> {
        let store = Store::open_view(&self.folder, IoMode::default(), None)?;
        if let Some(method) = store.info().downsample.second() {
            store.reduced(method)?;
        }
        Ok(store)
    }

    /// The options the store was packed with.
    fn pack_options(&self, info: &StoreInfo) -> PackOptions {
        PackOptions {
            edge: info.edge,
            shard_edge: info.shard,
            shard_times: 1,
            codec: info.codec,
            downsample: info.downsample,
            kind: info.kind,
            name: info.name.clone(),
            aprons: info.aprons,
            ngff: None,
            memory_bytes: self.options.memory_bytes,
            threads: self.options.threads,
            exists: Exists::Resume,
        }
    }

    /// The store's value counts, read or counted once over all steps.
    fn counted(&self, store: &Store, progress: &dyn Progress) -> Result<Vec<ChannelTotals>, Failed> {
        let counts = Counts::of(store);
        if let Some(kept) = counts.read(store, store.times())? {
            check_counts(store, &counts, &kept)?;
            return Ok(kept);
        }
        if store.times() > 1 {
            let what = "has no counts of its values yet: the values of all steps are counted once";
            progress.warn(&format!("{}: {what}", self.path().display()));
        }
        let pool = pool(self.options.threads).map_err(PackError::Threads)?;
        let count = || with_voxel_type!(store.voxel_type(), T => count_store::<T>(store));
        Ok(pool.install(count)?)
    }

    /// Makes the last of `times` steps, with existing files, part of the store. `before` and `after` are the counts
    /// without and with it.
    fn commit(
        &mut self,
        times: u32,
        time: Option<TimeAxis>,
        before: &[ChannelTotals],
        after: &[ChannelTotals],
    ) -> Result<(), Failed> {
        self.refuse_replaced()?;
        let root_path = self.path().join("zarr.json");
        let text = self.folder.document(&root_path)?;
        let mut root = Root::parse(&root_path, &text)?;
        // Others may have edited it meanwhile.
        let store = Store::open_with_root(&self.folder, IoMode::default(), None, &text)?;
        let info = store.info();
        let first = times - 1;
        if store.times() != first {
            let expected = format!("{first}, as before the step was packed");
            return Err(OpenError::invalid(&root_path, "attributes.brickyard.times", expected, store.times()).into());
        }
        let counts = Counts::of(&store);
        counts.write(&self.disk, times, after)?;
        let dirs = array_dirs(&store);
        let of_step = dirs.iter().map(|dir| chunks_of(dir, first)).filter(|chunks| chunks.exists());
        let of_step: Vec<PathBuf> = of_step.collect();
        let written = |info: &StoreInfo| root_document(store.layout(), store.geometry(), info);
        let counting = StoreInfo { times: Some(store.times()), ..info.clone() };
        if info.times.is_none() {
            counts.write(&self.disk, first, before)?;
            self.sync(&counts, &of_step, &dirs)?;
            update_root(&written(info), &written(&counting), &mut root.document);
            self.write_synced(&root_path, &root.bytes(&root_path)?)?;
        }
        for dir in &dirs {
            let (path, document) = with_steps(&self.folder, dir, times)?;
            self.disk.prepare(&path, &document_bytes(&document))?;
        }
        self.sync(&counts, &of_step, &dirs)?;
        for dir in &dirs {
            self.disk.name(&dir.join("zarr.json"))?;
        }
        let grown = StoreInfo { times: Some(times), time, channels: statistics(info, before, after), ..info.clone() };
        update_root(&written(&counting), &written(&grown), &mut root.document);
        update_consolidated(self.path(), &dirs, times, &mut root.document);
        self.disk.prepare(&root_path, &root.bytes(&root_path)?)?;
        self.disk.sync_parts(self.path(), dirs.iter().map(|dir| Part::Folder(dir)))?;
        self.disk.name(&root_path)?;
        self.times = times;
        self.disk.sync_dir(self.path())?;
        Ok(counts.keep_only(&self.disk, times)?)
    }

    /// Makes a step's chunks and counts durable, and their names in the array folders.
    fn sync(&self, counts: &Counts, of_step: &[PathBuf], dirs: &[PathBuf]) -> Result<(), DiskError> {
        let chunks = of_step.iter().flat_map(|chunks| [Part::Tree(chunks), Part::Folder(output::parent(chunks))]);
        let counts = [Part::Tree(counts.folder()), Part::Folder(output::parent(counts.folder()))];
        let dirs = dirs.iter().map(|dir| Part::Folder(dir));
        self.disk.sync_parts(self.path(), chunks.chain(counts).chain(dirs))
    }

    fn write_synced(&self, path: &Path, text: &[u8]) -> Result<(), DiskError> {
        self.disk.write(path, text)?;
        self.disk.sync_dir(output::parent(path))
    }

    /// Rolls back an interrupted append in reverse commit order, and sets the number of steps.
    fn take_back(&mut self) -> Result<(), Failed> {
        self.refuse_replaced()?;
        let store = self.open_store()?;
        self.times = store.times();
        self.refuse_foreign_steps(&store)?;
        // Counts of fewer steps go only once the document with the present number is durable.
        self.disk.sync_dir(self.path())?;
        let dirs = array_dirs(&store);
        for dir in dirs.iter().rev() {
            let document = read_json(&self.folder, &dir.join("zarr.json"))?;
            if document["shape"][0] != json!(self.times) && store.info().times.is_some() {
                let (path, document) = with_steps(&self.folder, dir, self.times)?;
                self.write_synced(&path, &document_bytes(&document))?;
            }
        }
        for dir in &dirs {
            let left = chunks_of(dir, self.times);
            if left.try_exists().map_err(|error| DiskError { path: left.clone(), error })? {
                ours::remove_chunks(&self.disk, &left)?;
                // Without stored chunks there is no folder to sync.
                self.disk.sync_dir(output::parent(&left))?;
            }
            ours::remove_file(&self.disk, &temporary(&dir.join("zarr.json")))?;
        }
        ours::remove_file(&self.disk, &temporary(&self.path().join("zarr.json")))?;
        // An uncounted store's counts may be incomplete.
        let counted = store.info().times.unwrap_or(0);
        Ok(Counts::of(&store).keep_only(&self.disk, counted)?)
    }

    /// Refuses a store with steps appended by another program, which would be deleted.
    fn refuse_foreign_steps(&self, store: &Store) -> Result<(), OpenError> {
        let Some((path, found)) = foreign_steps(store)? else { return Ok(()) };
        let expected = format!("{}, as in the root document: {FOREIGN_STEPS}", self.times);
        Err(OpenError::invalid(&path, "shape[0]", expected, found))
    }

    fn stopped(&self, failed: Failed) -> AppendError {
        let (store, times) = (self.path().to_path_buf(), self.times);
        match failed {
            Failed::Append(error) => *error,
            Failed::Stop(Stop::Disk(DiskError { path, error })) => {
                AppendError::Incomplete { path, error, store, times }
            }
            Failed::Stop(Stop::Source(error)) => AppendError::Source { error, store, times },
            Failed::Stop(Stop::Fraction(fraction)) => PackError::from(fraction).into(),
            Failed::Stop(Stop::Panic(words)) => AppendError::Panic { words, store, times },
            Failed::Stop(Stop::Cancelled) => AppendError::Cancelled { store, times },
            Failed::Stop(Stop::ReadBack(error)) => AppendError::Read(error),
            Failed::Stop(Stop::Threads(problem)) => PackError::Threads(problem).into(),
        }
    }
}

/// An array's document with `times` steps, and its path.
fn with_steps(folder: &Folder, dir: &Path, times: u32) -> Result<(PathBuf, Value), OpenError> {
    let path = dir.join("zarr.json");
    let mut document = read_json(folder, &path)?;
    let Some(steps) = document.pointer_mut("/shape/0") else {
        return Err(OpenError::invalid(&path, "shape", "a list of numbers", &document["shape"]));
    };
    *steps = json!(times);
    Ok((path, document))
}

/// Cause of an interrupted append, before the resulting number of steps is known.
enum Failed {
    Append(Box<AppendError>),
    Stop(Stop),
}

impl<E: Into<AppendError>> From<E> for Failed {
    fn from(error: E) -> Self {
        Self::Append(Box::new(error.into()))
    }
}

impl From<HoldError> for AppendError {
    fn from(error: HoldError) -> Self {
        match error {
            HoldError::Open(error) => error.into(),
            HoldError::Pack(error) => error.into(),
            HoldError::Unfinished { path, replaces } => Self::Unfinished { path, replaces },
        }
    }
}

impl From<DiskError> for Failed {
    fn from(error: DiskError) -> Self {
        Self::Stop(Stop::Disk(error))
    }
}

impl From<Stopped> for Failed {
    fn from((stop, _): Stopped) -> Self {
        Self::Stop(stop)
    }
}

/// Whether a directory has a finished store, without opening files, which may have just failed.
fn is_finished(store: &Path) -> bool {
    unfinished(store).is_ok_and(|found| found.is_none()) && store.join("zarr.json").exists()
}

/// Checks counts against the voxel numbers in the root document.
fn check_counts(store: &Store, counts: &Counts, kept: &[ChannelTotals]) -> Result<(), ReadError> {
    for (of_root, kept) in store.info().channels.iter().zip(kept.iter().map(ChannelTotals::finish)) {
        let numbers = |channel: &ChannelStatistics| format!("{} values, {:?}", channel.count, channel.range);
        if numbers(of_root) != numbers(&kept) {
            let [expected, found] = [of_root, &kept].map(numbers);
            let what = format!("expected {expected}, as in the root document, found {found}; {}", counts.cure());
            return Err(ReadError::CorruptPage { path: counts.dir(store.times()), what });
        }
    }
    Ok(())
}

/// Numbers of voxels over all channels: NaN or infinite, and no-data integers.
fn left_out(channels: &[ChannelTotals]) -> (u64, u64) {
    (channels.iter().map(ChannelTotals::non_finite).sum(), channels.iter().map(ChannelTotals::nodata).sum())
}

fn too_many(store: &Store) -> AppendError {
    let (expected, found) = (format!("fewer than {} steps", u32::MAX), store.times().to_string());
    PackError::Unfit { what: "shape is", found, expected, cure: "begin another store" }.into()
}

fn chunks_of(dir: &Path, step: u32) -> PathBuf {
    dir.join("c").join(step.to_string())
}

/// The statistics of all steps. Windows given by a source stay; others follow from the values.
fn statistics(info: &StoreInfo, before: &[ChannelTotals], after: &[ChannelTotals]) -> Vec<ChannelStatistics> {
    let before = before.iter().map(|before| before.finish().window);
    let grown = after.iter().map(ChannelTotals::finish).zip(&info.channels).zip(before);
    grown.map(|((grown, channel), usual)| grown.with_looks_of(channel, usual)).collect()
}
