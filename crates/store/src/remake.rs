//! A finished store made again beside itself: files of level 0 that stay, and the rest by the code of packing.
//!
//! Files that stay are shared by hard links where the file system has these. At the end the names are exchanged, in one
//! step where the file system can, and the former store is deleted: at any moment there is the former store or the new
//! one. What a stopped run leaves is removed by the next writer (`output::end_edit`). Costs a reading of level 0, once.

use crate::downsample::Reductions;
use crate::error::{OpenError, ReadError};
use crate::foreign::state_of_files;
use crate::held::HoldError;
use crate::kind::Kind;
use crate::layout::ShardId;
use crate::metadata::{StoreInfo, document_bytes};
use crate::pack::cascade::{Pass, Stop};
use crate::pack::disk::{Disk, DiskError, Part};
use crate::pack::output::{self, OF_EDIT, Output};
use crate::pack::plan::{PackPlan, Stage, plan_last};
use crate::pack::{Exists, PackError, PackOptions, Progress, cure, run_passes};
use crate::shard::Fingerprint;
use crate::side::array_documents;
use crate::stats::ChannelTotals;
use crate::store::Store;
use brickyard_import::Source;
use brickyard_volume::Level;
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Why a store was not made again, or, for [`RemakeError::Unsynced`], the failure afterwards.
#[derive(Debug, thiserror::Error)]
pub enum RemakeError {
    /// No store can be opened there.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// Another process writes to the store, it is not writable, or memory is too little.
    #[error(transparent)]
    Pack(#[from] PackError),
    /// The store is being packed, or about to be replaced by an unfinished pack.
    #[error("{path}: is an unfinished pack; finish it with `resume`, and then start over")]
    Unfinished {
        /// The directory of the unfinished pack: the store, or its replacement.
        path: PathBuf,
    },
    /// The root document, or that of array 0, is not as it was written.
    #[error(
        "{path}: was changed since it was packed or edited last, or is damaged: {change}; undo this change, and start \
         over, or pack the store again"
    )]
    Altered {
        /// The document.
        path: PathBuf,
        /// The first difference.
        change: String,
    },
    /// A change to the file system failed. The store is as before.
    #[error("{path}: {error}; {store} is unchanged: {} and start over", cure(error, None))]
    Unchanged {
        /// The file being written.
        path: PathBuf,
        /// The operating system's error.
        #[source]
        error: std::io::Error,
        /// The store.
        store: PathBuf,
    },
    /// Level 0 cannot be read. The store is as before.
    #[error("{store}: its coarser levels cannot be made again: {problem}; the store is unchanged")]
    Levels {
        /// The store.
        store: PathBuf,
        /// The reason.
        problem: String,
    },
    /// Another program wrote to the store meanwhile. It stays, with what was written.
    #[error(
        "{store}: another program wrote into it meanwhile; it is as that program left it: start over when none writes"
    )]
    Written {
        /// The store.
        store: PathBuf,
    },
    /// A voxel is between two labels. The store is as before.
    #[error("{store}: the voxel {voxel}, and labels are whole numbers; the store is unchanged")]
    Fraction {
        /// The store.
        store: PathBuf,
        /// The voxel's place and value.
        voxel: String,
    },
    /// [`Progress::is_cancelled`](crate::Progress::is_cancelled) stopped the work. The store is as before.
    #[error("{store}: stopped; the store is unchanged")]
    Cancelled {
        /// The store.
        store: PathBuf,
    },
    /// The store is made again, and visibly so, but a power failure may still undo it.
    #[error("{store}: is made again, but a power failure may still undo it: {error}; start over to make it last")]
    Unsynced {
        /// The store.
        store: PathBuf,
        /// The operating system's error.
        #[source]
        error: std::io::Error,
    },
}

impl From<HoldError> for RemakeError {
    fn from(error: HoldError) -> Self {
        match error {
            HoldError::Open(error) => error.into(),
            HoldError::Pack(error) => error.into(),
            HoldError::Unfinished { path, .. } => Self::Unfinished { path },
        }
    }
}

/// Resources and observer of the work.
#[derive(Clone, Copy)]
pub(crate) struct Work<'a> {
    pub(crate) memory_bytes: u64,
    pub(crate) threads: usize,
    pub(crate) progress: &'a dyn Progress,
}

/// The files of level 0 that stay.
pub(crate) enum Kept {
    /// All, with side data.
    All,
    /// The array's document and these shards of its cores, with their present fingerprints.
    Shards(Vec<(ShardId, Fingerprint)>),
}

/// The documents of a store made again: its settings, and the bytes of the root document.
pub(crate) struct Documents {
    pub(crate) info: StoreInfo,
    pub(crate) root: Vec<u8>,
}

/// A store to be made again.
pub(crate) struct Remake<'a> {
    store: &'a Store,
    /// The state of level 0's files when the work was planned.
    state: u64,
    source: &'a dyn Source,
    options: PackOptions,
    plan: PackPlan,
    settings: Value,
}

impl<'a> Remake<'a> {
    /// Plans a store of the voxels of `source`, laid out like `store`, whose level 0 they are. `purpose` tells the work in the journal.
    ///
    /// # Errors
    /// If the memory is too little, or level 0 cannot be looked at.
    pub(crate) fn new(
        store: &'a Store,
        source: &'a dyn Source,
        purpose: &str,
        downsample: Reductions,
        kind: Kind,
        work: Work,
    ) -> Result<Self, PackError> {
        let stored = store.info();
        let options = PackOptions {
            edge: stored.edge,
            shard_edge: stored.shard,
            shard_times: stored.shard_times,
            codec: stored.codec,
            downsample,
            kind,
            name: None,
            aprons: stored.aprons,
            ngff: None,
            memory_bytes: work.memory_bytes,
            threads: work.threads,
            exists: Exists::Overwrite,
        };
        let plan = plan_last(source, &options, store.layout())?;
        let state = state_of_level_0(store)?;
        Ok(Self { store, state, source, options, plan, settings: json!({ OF_EDIT: purpose, "kind": kind }) })
    }

    /// Refuses a store that another program wrote to since the work was planned.
    fn refuse_written(&self) -> Result<(), RemakeError> {
        let dir = self.store.path();
        let document = self.store.folder().document(&dir.join("zarr.json"))?;
        if !self.store.was_opened_with(&document) || state_of_level_0(self.store)? != self.state {
            return Err(RemakeError::Written { store: dir.into() });
        }
        Ok(())
    }

    /// Bricks of all levels.
    pub(crate) fn brick_count(&self) -> u64 {
        self.plan.brick_count()
    }

    /// Makes all checks of [`Remake::run`], and changes nothing.
    pub(crate) fn rehearse(&self) -> Result<(), PackError> {
        output::rehearse(&Disk::default(), self.store.path(), Exists::Overwrite, &self.settings, &self.plan).map(drop)
    }

    /// Makes the store, and replaces the former one by it. `documents` takes the folder beside and the totals of the channels; of kept side data there are none.
    pub(crate) fn run(
        &self,
        disk: &Disk,
        progress: &dyn Progress,
        kept: &Kept,
        documents: impl FnOnce(&Path, &[ChannelTotals]) -> Result<Documents, RemakeError>,
    ) -> Result<(), RemakeError> {
        let dir = self.store.path();
        let unchanged = |error| match error {
            PackError::Io { path, error } => RemakeError::Unchanged { path, error, store: dir.into() },
            error => error.into(),
        };
        let started = Output::start(disk, dir, Exists::Overwrite, &self.settings, &self.plan).map_err(unchanged)?;
        let Some(mut output) = started else { return Err(self.store.replaced().into()) };
        let made = self.make(disk, &mut output, progress, kept, documents);
        // As late as can be: what is written until the names are exchanged goes with the former store.
        if let Err(error) = made.and_then(|()| self.refuse_written()) {
            // Otherwise the next writer does it.
            let _ = output.abandon(disk);
            return Err(error);
        }
        output.finish(disk).map_err(|error| {
            // Nothing is there between two renames, which the next writer completes.
            let is_former = std::fs::read(dir.join("zarr.json")).is_ok_and(|text| self.store.was_opened_with(&text));
            if is_former {
                // Otherwise the next writer does it.
                let _ = output::end_edit(disk, dir);
            }
            match error {
                PackError::Io { error, .. } if !is_former => RemakeError::Unsynced { store: dir.into(), error },
                error => unchanged(error),
            }
        })
    }

    /// Makes the new store in its folder beside the former one, both locked.
    fn make(
        &self,
        disk: &Disk,
        output: &mut Output,
        progress: &dyn Progress,
        kept: &Kept,
        documents: impl FnOnce(&Path, &[ChannelTotals]) -> Result<Documents, RemakeError>,
    ) -> Result<(), RemakeError> {
        let Self { store, source, options, plan, .. } = self;
        let dir = store.path();
        let is_same = store.was_opened_with(&store.folder().document(&dir.join("zarr.json"))?);
        if store.folder().is_replaced() || !is_same || output.dir == dir {
            return Err(store.replaced().into());
        }
        let unchanged =
            |DiskError { path, error }: DiskError| RemakeError::Unchanged { path, error, store: dir.into() };
        let barred = |error: ReadError| RemakeError::Levels { store: dir.into(), problem: error.to_string() };
        match kept {
            Kept::All => {
                share(disk, &dir.join("0"), &output.dir.join("0")).map_err(unchanged)?;
                for chunks in store.chunks() {
                    for shard in chunks.layout().shards(Level(0)) {
                        output.journal.adopt(chunks.layout(), shard, chunks.fingerprint(shard).map_err(barred)?);
                    }
                }
            }
            Kept::Shards(shards) => {
                let chunks = store.cores();
                let paths = shards.iter().map(|(shard, _)| chunks.path(*shard)).chain([dir.join("0/zarr.json")]);
                for path in paths {
                    let new = output.dir.join(path.strip_prefix(dir).unwrap_or(&path));
                    disk.create_parent(&new).and_then(|()| disk.link(&path, &new)).map_err(unchanged)?;
                }
                shards.iter().for_each(|(shard, found)| output.journal.adopt(chunks.layout(), *shard, *found));
            }
        }
        let Output { dir: new, journal, .. } = output;
        take_mode(dir, new).map_err(unchanged)?;
        let pass = Pass { source: *source, store: new, options, plan, disk, progress };
        let totals = (0..store.channels()).map(|_| ChannelTotals::new(store.voxel_type())).collect();
        let passed = run_passes(&pass, journal, totals).map_err(|(stop, _)| match stop {
            Stop::Disk(error) => unchanged(error),
            Stop::Cancelled => RemakeError::Cancelled { store: dir.into() },
            Stop::Source(error) => RemakeError::Levels { store: dir.into(), problem: error.to_string() },
            Stop::Fraction(fraction) => RemakeError::Fraction { store: dir.into(), voxel: fraction.to_string() },
            Stop::ReadBack(error) => barred(error),
            Stop::Threads(problem) => PackError::Threads(problem).into(),
            Stop::Panic(words) => {
                RemakeError::Levels { store: dir.into(), problem: format!("this program's fault: {words}") }
            }
        })?;
        let Documents { info, root } = documents(new, &passed.channels)?;
        let finest = new.join("0/zarr.json");
        let write = || {
            let first = Level(u8::from(matches!(kept, Kept::All)));
            for Stage { layout, level, .. } in plan.stages.iter().filter(|stage| stage.level >= first) {
                let documents = array_documents(new, layout, *level, &info);
                for (path, document) in documents.iter().filter(|(path, _)| *path != finest) {
                    disk.write_early(path, &document_bytes(document))?;
                }
            }
            disk.sync_parts(new, [Part::Tree(new)])?;
            disk.write(&new.join("zarr.json"), &root)?;
            disk.sync_dir(new)
        };
        write().map_err(unchanged)
    }
}

/// The state of level 0's files.
fn state_of_level_0(store: &Store) -> Result<u64, PackError> {
    let path = store.path().join("0");
    state_of_files(&path).map_err(|error| PackError::Io { path, error })
}

/// Gives a folder the permissions of another one: whoever may not enter the former store may not enter the new one.
fn take_mode(from: &Path, to: &Path) -> Result<(), DiskError> {
    let taken = std::fs::metadata(from).and_then(|from| std::fs::set_permissions(to, from.permissions()));
    taken.map_err(|error| DiskError { path: to.into(), error })
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
