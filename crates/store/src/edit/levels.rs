//! Coarser levels of an image made again for labels, in a store that replaces the former one.
//!
//! The code of packing makes it beside the former store, from the voxels of level 0. Their files are shared, by hard
//! links where the file system has these, so they are decoded once and stay as they are, with their side data and
//! statistics. The root document is the former one with the edit. At the end the names are exchanged, in one step where
//! the file system can, and the former store is deleted: at any moment there is the former store or the new one. What a
//! stopped edit leaves is removed by the next writer (`output::end_edit`).

use super::{Edit, EditError, EditReport, Edited};
use crate::downsample::Downsample;
use crate::kind::Kind;
use crate::level_source::LevelSource;
use crate::metadata::{document_bytes, parse_info};
use crate::pack::cascade::{Pass, Stop};
use crate::pack::disk::{Disk, DiskError, Part};
use crate::pack::output::{self, OF_EDIT, Output};
use crate::pack::plan::{PackPlan, Stage, plan_last};
use crate::pack::{Exists, PackError, PackOptions, Progress, run_passes};
use crate::side::array_documents;
use crate::stats::ChannelTotals;
use crate::store::Store;
use brickyard_import::SourceInfo;
use brickyard_volume::Level;
use serde_json::{Value, json};
use std::path::Path;
use std::sync::Arc;

/// Resources and observer of making levels.
pub(super) struct Work<'a> {
    pub(super) memory_bytes: u64,
    pub(super) threads: usize,
    pub(super) progress: &'a dyn Progress,
}

/// Whether a store's coarser levels mix labels.
pub(super) fn are_mixed(store: &Store) -> bool {
    let methods = store.info().downsample;
    [Some(methods.main()), methods.second()].contains(&Some(Downsample::Mean))
}

/// An edit with its levels, before anything is made.
struct Planned {
    source: LevelSource,
    options: PackOptions,
    plan: PackPlan,
    edited: Edited,
}

impl Planned {
    fn new(dir: &Path, edit: &Edit, work: &Work) -> Result<Self, EditError> {
        let store = Store::open_own(dir)?;
        let edited = Edited::of(store.folder(), edit)?;
        let stored = store.info();
        let options = PackOptions {
            edge: stored.edge,
            shard_edge: stored.shard,
            shard_times: stored.shard_times,
            codec: stored.codec,
            downsample: Downsample::Mode.into(),
            kind: Kind::Labels,
            name: None,
            aprons: stored.aprons,
            ngff: None,
            memory_bytes: work.memory_bytes,
            threads: work.threads,
            exists: Exists::Overwrite,
        };
        let nodata = stored.nodata.map(|nodata| nodata as f64);
        let info = SourceInfo { nodata, ..edited.info.clone() };
        let source = LevelSource::new(Arc::new(store), Level(0), info);
        let plan = plan_last(&source, &options, source.store().layout())?;
        Ok(Self { source, options, plan, edited })
    }
}

fn settings() -> Value {
    json!({ OF_EDIT: "levels", "kind": Kind::Labels })
}

/// Makes all checks of [`remake`], and changes nothing.
pub(super) fn rehearse(dir: &Path, edit: &Edit, work: &Work) -> Result<EditReport, EditError> {
    let Planned { plan, edited, .. } = Planned::new(dir, edit, work)?;
    output::rehearse(&Disk::default(), dir, Exists::Overwrite, &settings(), &plan)?;
    Ok(edited.report(dir))
}

/// Edits a store to one of labels with new coarser levels.
pub(super) fn remake(disk: &Disk, dir: &Path, edit: &Edit, work: &Work) -> Result<EditReport, EditError> {
    let planned = Planned::new(dir, edit, work)?;
    let unchanged = |error| match error {
        PackError::Io { path, error } => EditError::Unchanged { path, error, store: dir.into() },
        error => error.into(),
    };
    let started = Output::start(disk, dir, Exists::Overwrite, &settings(), &planned.plan).map_err(unchanged)?;
    let Some(mut output) = started else { return Err(planned.source.store().replaced().into()) };
    if let Err(error) = planned.make(disk, dir, &mut output, work) {
        // Otherwise the next writer does it.
        let _ = output.abandon(disk);
        return Err(error);
    }
    output.finish(disk).map_err(|error| {
        // Nothing is there between two renames, which the next writer completes.
        let is_edited = !dir.exists() || Store::open_own(dir).is_ok_and(|store| store.info().kind == Kind::Labels);
        match error {
            PackError::Io { error, .. } if is_edited => EditError::Unsynced { store: dir.into(), error },
            error => unchanged(error),
        }
    })?;
    Ok(planned.edited.report(dir))
}

impl Planned {
    /// Makes the new store in its folder beside the former one, both locked.
    fn make(&self, disk: &Disk, dir: &Path, output: &mut Output, work: &Work) -> Result<(), EditError> {
        let Self { source, options, plan, edited } = self;
        let store = source.store();
        let root_path = store.path().join("zarr.json");
        let is_same = store.was_opened_with(&store.folder().document(&root_path)?);
        if store.folder().is_replaced() || !is_same || output.dir == dir {
            return Err(store.replaced().into());
        }
        let unchanged = |DiskError { path, error }: DiskError| EditError::Unchanged { path, error, store: dir.into() };
        let barred =
            |error: crate::error::ReadError| EditError::Levels { store: dir.into(), problem: error.to_string() };
        share(disk, &dir.join("0"), &output.dir.join("0")).map_err(unchanged)?;
        for chunks in store.chunks() {
            for shard in chunks.layout().shards(Level(0)) {
                output.journal.adopt(chunks.layout(), shard, chunks.fingerprint(shard).map_err(barred)?);
            }
        }
        let Output { dir: new, journal, .. } = output;
        let pass = Pass { source, store: new, options, plan, disk, progress: work.progress };
        let totals = (0..store.channels()).map(|_| ChannelTotals::new(store.voxel_type())).collect();
        run_passes(&pass, journal, totals).map_err(|(stop, _)| match stop {
            Stop::Disk(error) => unchanged(error),
            Stop::Cancelled => EditError::Cancelled { store: dir.into() },
            Stop::Source(error) => EditError::Levels { store: dir.into(), problem: error.to_string() },
            Stop::ReadBack(error) => barred(error),
            Stop::Threads(problem) => PackError::Threads(problem).into(),
            Stop::Panic(words) => {
                EditError::Levels { store: dir.into(), problem: format!("this program's fault: {words}") }
            }
        })?;
        let info = parse_info(&root_path, &edited.root.document)?;
        let write = || {
            for Stage { layout, level, .. } in plan.stages.iter().filter(|stage| stage.level > Level(0)) {
                for (path, document) in array_documents(new, layout, *level, &info) {
                    disk.write_early(&path, &document_bytes(&document))?;
                }
            }
            disk.sync_parts(new, [Part::Tree(new)])?;
            disk.write(&new.join("zarr.json"), &edited.text)?;
            disk.sync_dir(new)
        };
        write().map_err(unchanged)
    }
}

/// Gives all files of a folder a second name in another one.
fn share(disk: &Disk, from: &Path, to: &Path) -> Result<(), DiskError> {
    let io = |error| DiskError { path: from.into(), error };
    disk.create_dir_all(to)?;
    for entry in std::fs::read_dir(from).map_err(io)? {
        let entry = entry.map_err(io)?;
        let (path, new) = (entry.path(), to.join(entry.file_name()));
        match entry.file_type().map_err(io)? {
            kind if kind.is_dir() => share(disk, &path, &new)?,
            _ if path.extension().is_some_and(|extension| extension == "tmp") => {}
            _ => disk.link(&path, &new)?,
        }
    }
    Ok(())
}
