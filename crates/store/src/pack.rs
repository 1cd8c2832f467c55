//! Packing: any [`Source`] becomes a brick store in one streaming pass.
//!
//! Bricks are read directly from sources with box access. Each yields its encoded core, its ranges (including those of
//! parts shared with each neighbour), and its part of the next level, stored in one layer of the level's *window*;
//! level 0 feeds both pyramids if there are two. So all levels cascade from data at hand, and memory is independent of
//! the volume: windows too large for it are rings in a scratch file. `pack/plan.rs` has the formula.
//!
//! A second pass (`pack/aprons.rs`) makes aprons, if stored, from the output of the first.
//!
//! Results pass through one sequence in brick order: regardless of threads, memory and interruptions, the same source
//! and settings give byte-identical stores.
//!
//! No unfinished file ever has a final name, except after a power failure during a pack. Shards are written under a
//! temporary name, renamed, synced every few seconds (one by one if a file system cannot be synced as a whole), and
//! recorded in `STORE/.brickyard-journal`. The root `zarr.json`, written last, completes the store; then the journal is
//! removed. After a kill at any moment, [`Exists::Resume`] rereads the source for statistics and coarser levels, but
//! neither encodes nor writes existing shards. Only a finished store replaces a finished one: [`Exists::Overwrite`]
//! packs into `STORE.packing` and swaps the two in one step at the end.

pub(crate) mod aprons;
pub(crate) mod brick;
pub(crate) mod cascade;
pub(crate) mod disk;
mod estimate;
pub(crate) mod image_labels;
pub(crate) mod journal;
pub(crate) mod lock;
pub(crate) mod ours;
pub(crate) mod output;
mod parts;
pub(crate) mod plan;
mod sequence;
pub(crate) mod shards;
mod shells;
mod side_pages;
#[cfg(test)]
pub(crate) mod tests;
mod window;

pub use estimate::estimate;
pub use lock::Holder;
pub use plan::{PackPlan, plan};

use crate::codec::Codec;
use crate::downsample::Reductions;
use crate::error::{ReadError, UnfitOutput};
use crate::layout::{DEFAULT_SHARD_EDGE, check_edges};
use crate::metadata::{Kind, StoreInfo, document_bytes, root_document};
use crate::ngff::{Ngff, Root};
use crate::side::array_documents;
use crate::stats::ChannelTotals;
use crate::version::FORMAT_VERSION;
use brickyard_import::{ImportError, Source, SourceInfo};
use brickyard_volume::{Apron, DEFAULT_BRICK_EDGE, MAX_APRON, VoxelType, with_voxel_type};
use cascade::{Pass, Passed, Reached, Stop, Stopped};
use disk::{Disk, Part};
use image_labels::{ImageLabels, TO_IMAGE, unlisted_reason};
use journal::Journal;
use output::Output;
use plan::Stage;
use serde_json::{Value, json};
use std::io::ErrorKind;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

/// Longest name of a volume.
const MOST_NAME_BYTES: usize = 1024;

/// Policy for an existing output.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Exists {
    /// Fail, leaving the output unchanged.
    #[default]
    Refuse,
    /// Finish a pack of the same source and settings, or start one.
    Resume,
    /// Replace the output, if it is a store or an unfinished pack.
    Overwrite,
}

/// The settings of a pack.
#[derive(Clone, Debug, PartialEq)]
pub struct PackOptions {
    /// Voxels along the edge of a brick's core: a power of two from 8 to 256.
    pub edge: u32,
    /// Most voxels along a shard's edge: a multiple of `edge`, at most
    /// [`MAX_SHARD_EDGE`](crate::layout::MAX_SHARD_EDGE). Larger shards mean fewer files.
    pub shard_edge: u32,
    /// Time steps per shard, at least 1; capped at all. More steps mean fewer files, with equal bricks of a shard's
    /// steps stored once, but a resumed pack restarts at the first step of a shard, and appending requires repacking.
    pub shard_times: u32,
    /// Compression of bricks. zstd 3 gives 3 % smaller stores than zstd 1 in twice the time.
    pub codec: Codec,
    /// Reduction methods: see [`Reductions::default_for`] a kind.
    pub downsample: Reductions,
    /// The meaning of the values.
    pub kind: Kind,
    /// The volume's name in the store's OME-Zarr metadata; `None` writes none.
    pub name: Option<String>,
    /// Width of the stored aprons in voxels, at most [`MAX_APRON`]; 0 stores none.
    pub aprons: u32,
    /// Version of OME-Zarr of the store's metadata. `None` is that of the image for labels inside one, that of a store or
    /// unfinished pack which is there, otherwise 0.5.
    pub ngff: Option<Ngff>,
    /// Most anonymous memory for the pack, in bytes.
    pub memory_bytes: u64,
    /// Worker threads, at least 1. Reading whole planes and writing files use further threads.
    pub threads: usize,
    /// Policy for an existing output.
    pub exists: Exists,
}

impl PackOptions {
    /// Defaults for a voxel type: bricks of 64 and shards of 512 voxels along an edge, 2 GiB of memory, one thread per
    /// processor.
    pub fn new(voxel_type: VoxelType) -> Self {
        Self {
            edge: DEFAULT_BRICK_EDGE,
            shard_edge: DEFAULT_SHARD_EDGE,
            shard_times: 1,
            codec: Codec::default_for(voxel_type),
            downsample: Reductions::default_for(Kind::Image),
            kind: Kind::Image,
            name: None,
            aprons: 0,
            ngff: None,
            memory_bytes: 2 << 30,
            threads: std::thread::available_parallelism().map_or(1, usize::from),
            exists: Exists::Refuse,
        }
    }

    pub(crate) fn apron(&self) -> Option<Apron> {
        (self.aprons > 0).then_some(Apron { edge: self.edge, width: self.aprons })
    }

    fn check(&self) -> Result<(), PackError> {
        let problem = if let Err((field, expected)) = check_edges(self.edge, self.shard_edge) {
            let (option, found) = if field == "edge" { ("edge", self.edge) } else { ("shard_edge", self.shard_edge) };
            format!("`{option}` {found}: expected {expected}")
        } else if self.aprons > MAX_APRON {
            format!("`aprons` {}: expected 1 or {MAX_APRON} voxels", self.aprons)
        } else if let Err(problem) = self.codec.to_string().parse::<Codec>() {
            format!("`codec` {}: {problem}", self.codec)
        } else if let Some(Err(expected)) = self.name.as_deref().map(check_name) {
            format!("`name`: {expected}")
        } else if self.shard_times == 0 {
            "`shard_times` 0: expected at least one time step".into()
        } else if self.threads == 0 {
            "`threads` 0: expected at least one thread".into()
        } else {
            return Ok(());
        };
        Err(PackError::Options(problem))
    }
}

/// Checks a name of a volume or channel; fails with the expectation.
pub(crate) fn check_name(name: &str) -> Result<(), String> {
    match name.trim().is_empty() || name.len() > MOST_NAME_BYTES || name.contains(char::is_control) {
        true => Err(format!("expected 1 to {MOST_NAME_BYTES} bytes of text in one line")),
        false => Ok(()),
    }
}

/// Receives the progress of a pack. Methods may be called from any thread.
pub trait Progress: Sync {
    /// Called once with the plan, before any voxel is read; not if the store was already complete.
    fn planned(&self, _plan: &PackPlan) {}
    /// Called with a routine remark, in one sentence.
    fn note(&self, _message: &str) {}
    /// Called with a warning, in one sentence.
    fn warn(&self, _message: &str) {}
    /// Called as level-0 bricks are packed, with `done` of `total` voxels of all time steps and channels.
    fn advanced(&self, _done: u64, _total: u64) {}
    /// Called in the second pass, if any, with `done` of `total` uncompressed bytes of aprons.
    fn aprons(&self, _done: u64, _total: u64) {}
    /// Whether to stop the pack, with [`PackError::Cancelled`]. Called before each brick and plane read, so it must be
    /// fast.
    fn is_cancelled(&self) -> bool {
        false
    }
}

/// Ignores all progress.
impl Progress for () {}

/// Outcome of a pack.
#[derive(Clone, Debug, PartialEq)]
pub struct PackReport {
    /// The plan of the pack.
    pub plan: PackPlan,
    /// Shards in the store, including those without a file (all fill).
    pub shards: u64,
    /// Shards finished by earlier, interrupted runs.
    pub shards_resumed: u64,
    /// Bytes written to shards in this run.
    pub written_bytes: u64,
    /// NaN and infinite voxels in level 0; 0 if `was_complete`.
    pub non_finite: u64,
    /// No-data integers in level 0; 0 if `was_complete`.
    pub nodata: u64,
    /// Whether nothing was done, since a finished store from the same source and settings existed.
    pub was_complete: bool,
}

/// Why a pack failed.
#[derive(Debug, thiserror::Error)]
pub enum PackError {
    /// An option is out of range, or contradicts another one.
    #[error("{0}")]
    Options(String),
    /// The allowed memory is below the pack's minimum.
    #[error(
        "`memory` {given} MiB is too little: this needs at least {needed} MiB; allow more{advice}",
        given = given_bytes >> 20, needed = needed_bytes.div_ceil(1 << 20)
    )]
    Memory {
        /// The least memory for the pack, in bytes.
        needed_bytes: u64,
        /// The allowed memory, in bytes.
        given_bytes: u64,
        /// Other options within the allowed memory, in words; empty if there are none.
        advice: String,
    },
    /// The disk has less room than the pack's scratch files, which are always written in full.
    #[error(
        "{path}: {free} MiB are free, but packing needs {needed} MiB of scratch there: make room, choose another output, or \
         allow more `memory`", free = free_bytes >> 20, needed = needed_bytes.div_ceil(1 << 20), path = path.display()
    )]
    NoRoom {
        /// The directory of the store.
        path: PathBuf,
        /// Bytes needed for scratch files.
        needed_bytes: u64,
        /// Free bytes.
        free_bytes: u64,
    },
    /// The input has a property no store can hold.
    #[error("the input's {what} {found}: expected {expected}; {cure}")]
    Unfit {
        /// The property of the input.
        what: &'static str,
        /// The input's value.
        found: String,
        /// The values a store can hold.
        expected: String,
        /// The user's remedy.
        cure: &'static str,
    },
    /// The output exists, and [`Exists::Refuse`] was chosen.
    #[error("{path}: exists already{}; choose another name, or pass {}", if *unfinished { " (an unfinished pack)" } else { "" },
        if *unfinished { "`resume` to finish it or `overwrite` to start over" } else { "`overwrite` to replace it" })]
    Exists {
        /// The output's path.
        path: PathBuf,
        /// Whether the output is an unfinished pack.
        unfinished: bool,
    },
    /// The output would lie inside another store.
    #[error(transparent)]
    Inside(#[from] UnfitOutput),
    /// The output lies among an image's labels, and cannot be one of them.
    #[error("{path}: {problem}")]
    Labels {
        /// The output's path.
        path: PathBuf,
        /// The reason, with the remedy.
        problem: String,
    },
    /// The output exists, but is nothing replaceable by packing.
    #[error(
        "{path}: is neither a brick store nor an unfinished pack, and is left alone; choose another name, or \
         remove it"
    )]
    NotOurs {
        /// The output's path.
        path: PathBuf,
    },
    /// The existing pack was made from other data or with other settings.
    #[error("{store}: cannot be resumed: {difference}; use the same input and settings, or `overwrite` to start over")]
    Mismatch {
        /// The store.
        store: PathBuf,
        /// The difference, in words, such as a setting's values then and now.
        difference: String,
    },
    /// Overwriting would delete foreign files.
    #[error(
        "{store}: cannot be replaced: {found} is not part of the store, and replacing would delete it; move it away, or choose \
         another name"
    )]
    Foreign {
        /// The store.
        store: PathBuf,
        /// A file or folder inside the store not written by packing.
        found: PathBuf,
    },
    /// The name `STORE.packing`, needed to replace a finished store, is taken.
    #[error("{path}: is in the way: replacing {store} needs this name; move it away, or choose another output")]
    InTheWay {
        /// The occupied path, `STORE.packing`.
        path: PathBuf,
        /// The store to replace.
        store: PathBuf,
    },
    /// Another pack is running on the same output.
    #[error(
        "{store}: another process packs into it{}; wait for it, or stop it",
        holder.as_ref().map_or(String::new(), |holder| format!(" ({holder})"))
    )]
    Busy {
        /// The directory of the other pack.
        store: PathBuf,
        /// The process of the other pack, if known.
        holder: Option<Holder>,
    },
    /// The file system does not lock files, so a concurrent pack would go unnoticed.
    #[error(
        "{path}: {error}: this file system cannot lock files, so another pack into the same store would go unnoticed; \
         pack to a local disk or to NFS, and move the store from there"
    )]
    NoLock {
        /// The intended place of the store.
        path: PathBuf,
        /// The operating system's error.
        #[source]
        error: std::io::Error,
    },
    /// [`Progress::is_cancelled`] stopped the pack. Finished shards stay; without any, nothing does. No unfinished file has a final name.
    #[error("cancelled; {}", of_cancelled(*done, *total, store))]
    Cancelled {
        /// The unfinished store.
        store: PathBuf,
        /// Number of finished shards.
        done: u64,
        /// Number of shards in all.
        total: u64,
    },
    /// The source failed midway. Finished shards stay; without any, nothing does.
    #[error("{error}{}", of_finished(*done, *total, store))]
    Source {
        /// The source's error.
        #[source]
        error: ImportError,
        /// The unfinished store.
        store: PathBuf,
        /// Number of finished shards.
        done: u64,
        /// Number of shards in all.
        total: u64,
    },
    /// A write failed midway, usually from a full disk. Finished shards stay; no unfinished file has a final name.
    #[error(
        "{path}: {error}; {done} of {total} shards of {store} are finished: {cure} and run again with `resume`",
        cure = cure(error, Some(*needed_bytes))
    )]
    Incomplete {
        /// The file being written.
        path: PathBuf,
        /// The operating system's error.
        #[source]
        error: std::io::Error,
        /// The unfinished store.
        store: PathBuf,
        /// Number of finished shards.
        done: u64,
        /// Number of shards in all.
        total: u64,
        /// Estimate of the bytes still to be written.
        needed_bytes: u64,
    },
    /// Freshly written data are unreadable.
    #[error("{error}; this pack has just written it: check the disk of {store} and start over with `overwrite`")]
    ReadBack {
        /// The read error.
        #[source]
        error: ReadError,
        /// The store.
        store: PathBuf,
    },
    /// A thread of the packer, or of the source, panicked.
    #[error(
        "this program (or the reader of the input) has a fault: {words:?}; {done} of {total} shards of {store} are finished, \
         and `resume` goes on; please report this"
    )]
    Panic {
        /// The panic's message.
        words: String,
        /// The unfinished store.
        store: PathBuf,
        /// Number of finished shards.
        done: u64,
        /// Number of shards in all.
        total: u64,
    },
    /// The directory is not writable, by its permissions or on a read-only file system.
    #[error("{path}: cannot be written: {error}")]
    ReadOnly {
        /// The directory.
        path: PathBuf,
        /// The operating system's error.
        #[source]
        error: std::io::Error,
    },
    /// The operating system refused an operation before this run packed anything.
    #[error("{path}: {error}")]
    Io {
        /// The file or directory.
        path: PathBuf,
        /// The operating system's error.
        #[source]
        error: std::io::Error,
    },
    /// The worker threads could not be started.
    #[error("cannot start worker threads: {0}; use fewer `threads`")]
    Threads(String),
}

/// The end of the message about a cancelled pack.
fn of_cancelled(done: u64, total: u64, store: &Path) -> String {
    let store = store.display();
    match done {
        0 => format!("no shard of {store} was finished, and nothing is left"),
        _ => format!("{done} of {total} shards of {store} are finished, and `resume` goes on"),
    }
}

/// The end of the message about a failed source.
fn of_finished(done: u64, total: u64, store: &Path) -> String {
    if done == 0 {
        return String::new();
    }
    let store = store.display();
    format!("; {done} of {total} shards of {store} are finished: correct the input and run again with `resume`")
}

/// The user's remedy for a failed write, with the bytes still to be written, if known.
pub(crate) fn cure(error: &std::io::Error, needed_bytes: Option<u64>) -> String {
    let more = needed_bytes.map(|bytes| format!(" (about {} MiB more)", bytes.div_ceil(1 << 20)));
    match error.kind() {
        ErrorKind::StorageFull | ErrorKind::QuotaExceeded => format!("make room{}", more.unwrap_or_default()),
        ErrorKind::FileTooLarge => "raise the limit of file sizes (`ulimit -f`)".into(),
        _ => "see to that".into(),
    }
}

/// Packs a source into a store.
///
/// # Errors
/// If the options or the output do not allow it, the source fails, the disk fails or is full, or `progress` cancels.
/// Finished work can be resumed.
pub fn pack(
    source: &dyn Source,
    store: &Path,
    options: &PackOptions,
    progress: &dyn Progress,
) -> Result<PackReport, PackError> {
    pack_on(&Disk::default(), source, store, options, progress)
}

pub(crate) fn pack_on(
    disk: &Disk,
    source: &dyn Source,
    store: &Path,
    options: &PackOptions,
    progress: &dyn Progress,
) -> Result<PackReport, PackError> {
    let plan = plan(source, options)?;
    let ngff = output::version_for(store, options.ngff)?;
    let options = &PackOptions { ngff: Some(ngff), ..options.clone() };
    let settings = settings(source, options);
    let shards = plan.shard_count();
    let unchanged = PackReport {
        plan: plan.clone(),
        shards,
        shards_resumed: shards,
        written_bytes: 0,
        non_finite: 0,
        nodata: 0,
        was_complete: true,
    };
    let start = Output::start(disk, store, options.exists, &settings, &plan).map_err(|error| match error {
        PackError::Io { path, error } if matches!(error.kind(), ErrorKind::StorageFull | ErrorKind::FileTooLarge) => {
            let nothing = Reached::new(0, 0, 0, plan.output_bytes_at_most);
            stopped(Stop::Disk(disk::DiskError { path, error }), &nothing, store, shards)
        }
        other => other,
    });
    let Some(mut output) = start? else {
        output::check_version(store, ngff)?;
        return Ok(unchanged);
    };
    announce(source.info(), &output.dir, &plan, progress);
    let shards_resumed = output.journal.finished_count();
    let pass = Pass { source, store: &output.dir, options, plan: &plan, disk, progress };
    let totals = (0..source.info().channels).map(|_| ChannelTotals::new(source.info().voxel_type)).collect();
    let passed = run_passes(&pass, &mut output.journal, totals);
    let passed = match passed {
        Ok(passed) => passed,
        Err((stop, reached)) => {
            let error = stopped(stop, &reached, &output.dir, shards);
            let is_hopeless = matches!(
                error,
                PackError::Source { done: 0, .. } | PackError::Cancelled { done: 0, .. } | PackError::Unfit { .. }
            );
            if is_hopeless {
                // Nothing is worth resuming. A failed deletion leaves an unfinished pack, as other failures do.
                let _ = output.abandon(disk);
            }
            return Err(error);
        }
    };
    let non_finite = passed.channels.iter().map(ChannelTotals::non_finite).sum();
    let nodata = passed.channels.iter().map(ChannelTotals::nodata).sum();
    let written_bytes = passed.written_bytes;
    let finished = write_metadata(&pass, &settings, passed);
    let dir = output.dir.clone();
    let finished = finished.and_then(|()| output.finish(disk));
    finished.map_err(|error| match error {
        PackError::Io { path, error } => {
            let needed_bytes = plan.brick_count() * 24;
            PackError::Incomplete { path, error, store: dir, done: shards, total: shards, needed_bytes }
        }
        other => other,
    })?;
    Ok(PackReport { shards_resumed, written_bytes, non_finite, nodata, was_complete: false, ..unchanged })
}

/// Makes all checks before a pack, and reports its remarks and plan to `progress`, like [`pack`], which it then leaves undone: no file or
/// folder is created or changed. Returns the plan; `None` if a finished store from the same source and settings exists, to resume.
///
/// # Errors
/// If [`pack`] would fail before its first voxel.
pub fn rehearse(
    source: &dyn Source,
    store: &Path,
    options: &PackOptions,
    progress: &dyn Progress,
) -> Result<Option<PackPlan>, PackError> {
    let plan = plan(source, options)?;
    let ngff = output::version_for(store, options.ngff)?;
    let settings = settings(source, &PackOptions { ngff: Some(ngff), ..options.clone() });
    let Some(dir) = output::rehearse(&Disk::default(), store, options.exists, &settings, &plan)? else {
        output::check_version(store, ngff)?;
        return Ok(None);
    };
    announce(source.info(), &dir, &plan, progress);
    Ok(Some(plan))
}

/// Reports the source's remarks, possible problems of the directory, and the plan.
fn announce(source: &SourceInfo, dir: &Path, plan: &PackPlan, progress: &dyn Progress) {
    tell(source, progress);
    if let Ok(Some(labels)) = ImageLabels::around(dir) {
        labels.remarks(source).iter().for_each(|remark| progress.note(remark));
    }
    unlisted_reason(dir).iter().for_each(|reason| progress.warn(reason));
    warn_of_space(dir, plan, progress);
    if disk::may_be_local(disk::nearest(dir)) {
        let what = "its file system may lock files on this machine only: let no other machine pack into it";
        progress.warn(&format!("{}: {what}", dir.display()));
    }
    progress.planned(plan);
}

/// Packs the plan's time steps: cores and coarser levels, then aprons if they are stored. Adds the voxels to the
/// channels' totals.
pub(crate) fn run_passes(pass: &Pass, journal: &mut Journal, channels: Vec<ChannelTotals>) -> Result<Passed, Stopped> {
    let mut passed = with_voxel_type!(pass.source.info().voxel_type, T => pass.run::<T>(journal, channels))?;
    if let Some(apron) = pass.options.apron() {
        let nothing = Reached::new(pass.plan.core_shard_count(), 0, 0, pass.plan.apron_bytes);
        let run = AssertUnwindSafe(|| pass.run_aprons(apron, journal));
        passed.written_bytes += catch_unwind(run).unwrap_or_else(|panic| Err((Stop::panic(panic), nothing)))?;
    }
    Ok(passed)
}

/// Starts this many worker threads; fails with the reason in words.
pub(crate) fn pool(threads: usize) -> Result<rayon::ThreadPool, String> {
    rayon::ThreadPoolBuilder::new().num_threads(threads).build().map_err(|error| error.to_string())
}

/// The setting of the version of OME-Zarr, if it is not 0.5.
const OF_VERSION: &str = "ngff";

/// The settings that determine a store's bytes.
fn settings(source: &dyn Source, options: &PackOptions) -> Value {
    let info = source.info();
    let mut settings = json!({
        "source": info.identity,
        "extent": info.extent.to_array(),
        "times": info.times,
        "channels": info.channels,
        "voxel_type": info.voxel_type,
        "geometry": info.geometry,
        "orientation": info.orientation,
        "channel_looks": info.channel_looks,
        "spacing_given": info.calibrated,
        "brick": options.edge,
        "shard": options.shard_edge,
        "codec": options.codec.for_voxel_type(info.voxel_type),
        "downsample": options.downsample,
        "kind": options.kind,
        "aprons": options.aprons,
        "format": FORMAT_VERSION,
    });
    // Fingerprints of packs without these values must not change.
    if let Some(nodata) = info.nodata {
        settings["nodata"] = json!(nodata);
    }
    if let Some(time) = &info.time {
        settings["time"] = json!(time);
    }
    if let Some(name) = &options.name {
        settings["name"] = json!(name);
    }
    let shard_times = options.shard_times.min(info.times);
    if shard_times > 1 {
        settings["shard_times"] = json!(shard_times);
    }
    if let Some(ngff @ Ngff::V06) = options.ngff {
        settings[OF_VERSION] = json!(ngff.name());
    }
    settings
}

/// Identifies a source and its pack settings: the resulting store's [`StoreInfo::settings_fingerprint`].
pub fn settings_fingerprint(source: &dyn Source, options: &PackOptions) -> String {
    fingerprint(&settings(source, options))
}

fn fingerprint(settings: &Value) -> String {
    let mut settings = settings.clone();
    // The version of the metadata can change without a pack.
    if let Some(settings) = settings.as_object_mut() {
        settings.remove(OF_VERSION);
    }
    format!("{:016x}", xxhash_rust::xxh3::xxh3_64(settings.to_string().as_bytes()))
}

fn stopped(stop: Stop, reached: &Reached, store: &Path, total: u64) -> PackError {
    let (store, done) = (store.to_path_buf(), reached.shards);
    match stop {
        Stop::Threads(problem) => PackError::Threads(problem),
        Stop::Cancelled => PackError::Cancelled { store, done, total },
        Stop::Source(error) => PackError::Source { error, store, done, total },
        Stop::Fraction(fraction) => fraction.into(),
        Stop::ReadBack(error) => PackError::ReadBack { error, store },
        Stop::Panic(words) => PackError::Panic { words, store, done, total },
        Stop::Disk(disk::DiskError { path, error }) => {
            PackError::Incomplete { path, error, store, done, total, needed_bytes: reached.needed_bytes }
        }
    }
}

/// Reports the source's remarks, warnings last, for single-line displays.
pub(crate) fn tell(source: &SourceInfo, progress: &dyn Progress) {
    let (warnings, notes): (Vec<_>, Vec<_>) = source.notes.iter().partition(|note| note.is_warning());
    notes.into_iter().for_each(|note| progress.note(note));
    warnings.into_iter().for_each(|warning| progress.warn(warning));
}

fn warn_of_space(dir: &Path, plan: &PackPlan, progress: &dyn Progress) {
    let Some(free) = disk::free_bytes(dir) else { return };
    let worst = plan.output_bytes_at_most.saturating_add(plan.scratch_bytes);
    if free < worst {
        progress.warn(&format!(
            "{}: {} MiB are free; if the data do not compress, the store needs {} MiB",
            dir.display(),
            free >> 20,
            worst.div_ceil(1 << 20)
        ));
    }
}

/// Writes all documents, the root's last.
fn write_metadata(pass: &Pass, settings: &Value, passed: Passed) -> Result<(), PackError> {
    let Pass { source, store, options, plan, disk, .. } = *pass;
    let (info, layout) = (source.info(), &plan.layout);
    let mut channels: Vec<_> = passed.channels.iter().map(ChannelTotals::finish).collect();
    channels.iter_mut().zip(&info.channel_looks).for_each(|(channel, look)| channel.take_look(look));
    let store_info = StoreInfo {
        version: FORMAT_VERSION,
        name: options.name.clone(),
        edge: options.edge,
        shard: options.shard_edge,
        shard_times: layout.shard_times,
        voxel_type: info.voxel_type,
        codec: options.codec.for_voxel_type(info.voxel_type),
        downsample: options.downsample,
        kind: options.kind,
        image_label: options.kind == Kind::Labels,
        nodata: info.nodata.filter(|_| !info.voxel_type.is_float()).map(|nodata| nodata as i64),
        blanked: info.nodata.filter(|_| info.voxel_type.is_float()),
        aprons: options.aprons,
        spacing: info.geometry.spacing.to_array(),
        axis_units: info.geometry.axis_units.clone(),
        calibrated: info.calibrated,
        orientation: info.orientation,
        turned: info.turned,
        flipped: info.flip.unwrap_or_default(),
        time: info.time.clone(),
        times: None,
        channels,
        source: info.identity.clone(),
        settings_fingerprint: fingerprint(settings),
        complete: true,
    };
    for Stage { layout, level, .. } in &plan.stages {
        for (path, document) in array_documents(store, layout, *level, &store_info) {
            disk.write_early(&path, &document_bytes(&document))?;
        }
    }
    disk.sync_parts(store, [Part::Tree(store)])?;
    let mut root = root_document(layout, &info.geometry, &store_info);
    if options.kind == Kind::Labels && ImageLabels::around(store)?.is_some() {
        root["attributes"]["ome"]["image-label"]["source"] = json!({ "image": TO_IMAGE });
    }
    let path = store.join("zarr.json");
    // The plan has checked the orientation, so this cannot fail.
    let text = Root::new(root, options.ngff.unwrap_or_default())
        .bytes(&path)
        .map_err(|error| PackError::Options(error.to_string()))?;
    disk.write(&path, &text)?;
    Ok(disk.sync_dir(store)?)
}
