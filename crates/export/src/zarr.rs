//! OME-Zarr: a folder of arrays, one for each level. `pack` writes the exported part as a store, which is OME-Zarr 0.5 or 0.6, under a temporary name: coarser
//! levels, windows and memory are its work. For 0.6 the side data go, with their part of the root document; for 0.4 its bricks become the chunk files
//! of Zarr 2, with about as many bytes on the disk again until it is complete.

mod chunk_files;
mod documents;

use crate::budget::pool;
use crate::error::ExportError;
use crate::facts::{Fact, lost_in_words};
use crate::folder::create_folder;
use crate::job::Job;
use crate::ngff::Ngff;
use crate::plan::{Body, Plan};
use crate::volume::Volume;
use brickyard_store::metadata::document_bytes;
use brickyard_store::{Destination, PackError, PackOptions, Reductions, Store, pack};
use brickyard_volume::Level;
use chunk_files::write_chunk_files;
use documents::{Labels, in_version_0_4, in_version_0_6};
use serde_json::Value;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};

/// Plans a folder of a version.
pub(crate) fn plan(volume: &Volume, version: Ngff) -> Plan {
    let info = volume.info;
    let mut kept =
        vec![Fact::Spacing, Fact::Origin, Fact::StepTime, Fact::TimeUnit, Fact::NoData, Fact::Labels, Fact::Name];
    // Other units than of length are no units of OME-Zarr's axes of space.
    if info.geometry.axis_units.is_none() {
        kept.push(Fact::LengthUnit);
    }
    if info.time.as_ref().is_none_or(|time| time.stamps.is_empty()) {
        kept.push(Fact::Times);
    }
    // Labels have no channels to show.
    if !volume.is_labels {
        kept.extend([Fact::ChannelNames, Fact::ChannelColors]);
    }
    if version == Ngff::V06 {
        kept.push(Fact::Orientation);
    }
    let mut notes = Vec::new();
    if let Some(lost) = lost_in_words(volume, &kept) {
        let whose = if version == Ngff::V05 { "only brickyard reads it there" } else { "left out" };
        notes.push(format!("OME-Zarr {} cannot keep {lost}: {whose}.", version.name()));
    }
    if !kept.contains(&Fact::Times) {
        notes.push("Steps of OME-Zarr are even: the scale of t is their median difference.".into());
    }
    if version != Ngff::V06 && info.orientation.is_some() {
        notes.push("`ngff` 0.6 keeps the orientation, for programs that read this version.".into());
    }
    Plan { body: Body::Zarr(version), text: None, notes }
}

/// A folder to be written.
pub(crate) struct Written<'a> {
    /// The store whose part is exported.
    pub(crate) store: &'a Store,
    pub(crate) version: Ngff,
    pub(crate) place: &'a Destination,
}

/// Writes the folder.
///
/// # Errors
/// If the memory is too little, a brick cannot be read, a file cannot be written, or the export is cancelled.
pub(crate) fn write(job: &Job, written: &Written) -> Result<(), ExportError> {
    let &Written { store, version, place } = written;
    let folder = create_folder(place.path())?;
    let packed = folder.path().join("packed");
    let options = pack_options(job, written);
    let watch = Watch { job, share: if version == Ngff::V04 { 2 } else { 1 }, is_cancelled: AtomicBool::new(false) };
    let report = pack(job.source, &packed, &options, &watch);
    report.map_err(|error| of_pack(job.output, error))?;
    // Nobody asks after the last brick.
    watch.check()?;
    let labels = Labels::of(store);
    let new = match version {
        Ngff::V05 => {
            if let Some(labels) = labels {
                let mut root = read(job, &packed.join("zarr.json"))?;
                root["attributes"]["ome"]["image-label"] = labels.part();
                save(job, &packed.join("zarr.json"), &root)?;
            }
            packed
        }
        Ngff::V06 => {
            let stored = reopened(&packed)?;
            for k in 0..stored.pyramid().levels().len() {
                let side = stored.layout().side_dir(&packed, Level(k as u8));
                std::fs::remove_dir_all(side).map_err(ExportError::io(job.output))?;
            }
            let root = in_version_0_6(&read(job, &packed.join("zarr.json"))?, labels.as_ref());
            save(job, &packed.join("zarr.json"), &root)?;
            packed
        }
        Ngff::V04 => {
            let new = folder.path().join("chunks");
            let stored = reopened(&packed)?;
            let threads = chunk_files::threads(job, &stored, options.threads);
            pool(threads)?.install(|| write_chunk_files(job, &stored, &new))?;
            let root = in_version_0_4(&read(job, &packed.join("zarr.json"))?, labels.as_ref());
            for k in 0..stored.pyramid().levels().len() {
                let level = Level(k as u8).to_string();
                let array = read(job, &packed.join(&level).join("zarr.json"))?;
                documents::of_old_array(&array).save(&new.join(level)).map_err(ExportError::io(job.output))?;
            }
            root.save(&new).map_err(ExportError::io(job.output))?;
            new
        }
    };
    place.put(&new).map_err(|error| of_pack(job.output, error))?;
    if version == Ngff::V04 {
        // A failure leaves a folder with a temporary name, and a whole export.
        let _ = std::fs::remove_dir_all(folder.path().join("packed"));
    }
    // Not with what is in it: others may have put files into a replaced folder at the last moment.
    let _ = std::fs::remove_dir(folder.keep());
    Ok(())
}

/// Settings of the pack: the store's own, and as many threads as the memory holds.
fn pack_options(job: &Job, written: &Written) -> PackOptions {
    let stored = written.store.info();
    let info = job.source.info();
    // A second pyramid is for this program.
    let downsample = match written.version {
        Ngff::V05 => stored.downsample,
        _ => Reductions::from(stored.downsample.main()),
    };
    let of_threads = |threads| PackOptions {
        edge: stored.edge,
        downsample,
        kind: stored.kind,
        name: stored.name.clone(),
        ngff: Some(if written.version == Ngff::V06 { brickyard_store::Ngff::V06 } else { brickyard_store::Ngff::V05 }),
        memory_bytes: job.memory_bytes,
        threads,
        ..PackOptions::new(info.voxel_type)
    };
    let fits = |options: &PackOptions| brickyard_store::plan(job.source, options).is_ok();
    // One thread's pack tells the least memory.
    (1..=rayon::current_num_threads()).rev().map(of_threads).find(fits).unwrap_or_else(|| of_threads(1))
}

/// Passes a pack's progress on as a part of the export's.
struct Watch<'a> {
    job: &'a Job<'a>,
    /// The pack is the first of so many equal parts of the work.
    share: u64,
    is_cancelled: AtomicBool,
}

impl Watch<'_> {
    fn check(&self) -> Result<(), ExportError> {
        match self.is_cancelled.load(Ordering::Relaxed) {
            true => Err(ExportError::Cancelled { path: self.job.output.into() }),
            false => Ok(()),
        }
    }
}

impl brickyard_store::Progress for Watch<'_> {
    fn advanced(&self, done: u64, _: u64) {
        let bytes = done * self.job.source.info().voxel_type.bytes() as u64;
        if self.job.reach(bytes / self.share).is_err() {
            self.is_cancelled.store(true, Ordering::Relaxed);
        }
    }

    fn is_cancelled(&self) -> bool {
        self.is_cancelled.load(Ordering::Relaxed)
    }
}

/// A pack's error as one of the export: nothing remains to be resumed.
pub(crate) fn of_pack(output: &Path, error: PackError) -> ExportError {
    match error {
        PackError::Memory { needed_bytes, given_bytes, .. } => ExportError::Memory { needed_bytes, given_bytes },
        PackError::Exists { unfinished: false, .. } => ExportError::Exists { path: output.into() },
        PackError::Exists { unfinished: true, .. } => ExportError::unfit(
            output,
            "an unfinished pack is there, or waits for its place: choose another name, or finish it",
        ),
        PackError::NotOurs { .. } => {
            let problem = "is neither a store nor an OME-Zarr exported by this program, and is never replaced: choose another name";
            ExportError::unfit(output, problem)
        }
        PackError::Inside(error) => ExportError::Inside(error),
        PackError::Cancelled { .. } => ExportError::Cancelled { path: output.into() },
        PackError::Source { error, .. } => error.into(),
        PackError::ReadBack { error, .. } => ExportError::Read(error),
        PackError::Threads(problem) => ExportError::Threads(problem),
        PackError::Panic { words, .. } => {
            let problem = format!("this program has a fault: {words:?}; please report this");
            ExportError::io(output)(std::io::Error::other(problem))
        }
        PackError::Incomplete { error, .. }
        | PackError::ReadOnly { error, .. }
        | PackError::NoLock { error, .. }
        | PackError::Io { error, .. } => ExportError::io(output)(error),
        error => ExportError::Pack(error),
    }
}

/// The store that was just packed.
fn reopened(packed: &Path) -> Result<Store, ExportError> {
    Store::open(packed).map_err(|error| ExportError::Source(brickyard_import::ImportError::Other(Box::new(error))))
}

fn read(job: &Job, path: &Path) -> Result<Value, ExportError> {
    let text = std::fs::read(path).map_err(ExportError::io(job.output))?;
    serde_json::from_slice(&text).map_err(|error| ExportError::io(job.output)(error.into()))
}

fn save(job: &Job, path: &Path, document: &Value) -> Result<(), ExportError> {
    std::fs::write(path, document_bytes(document)).map_err(ExportError::io(job.output))
}

#[cfg(test)]
mod tests;
