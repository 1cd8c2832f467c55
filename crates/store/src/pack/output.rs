//! Where a pack goes: whether it may, where it is made, and how it comes to stand under its final name.

use crate::layout::JOURNAL_NAME;
use crate::pack::disk::{Disk, DiskError};
use crate::pack::journal::Journal;
use crate::pack::{Exists, PackError, fingerprint};
use serde_json::Value;
use std::io;
use std::path::{Path, PathBuf};

/// A directory that is being packed into.
pub(crate) struct Output {
    /// Where the store is made.
    pub(crate) dir: PathBuf,
    pub(crate) journal: Journal,
    /// The finished store that it will replace.
    replaces: Option<PathBuf>,
}

/// What is to be done.
pub(crate) enum Start {
    /// Nothing: the very store is there.
    Complete,
    Pack(Output),
}

/// What stands under a name.
#[derive(PartialEq)]
enum Found {
    /// Nothing, or an empty directory.
    Free,
    Unfinished,
    /// A finished store, with its settings' fingerprint.
    Store(String),
    Other,
}

impl Output {
    /// Prepares the directory as `exists` says, and locks it.
    pub(crate) fn start(
        disk: &Disk,
        store: &Path,
        exists: Exists,
        settings: &Value,
        shards: u64,
    ) -> Result<Start, PackError> {
        let found = find(store)?;
        let beside = beside(store);
        let is_store = matches!(found, Found::Store(_));
        let (dir, resume) = match (exists, &found) {
            (_, Found::Other) => return Err(PackError::NotOurs { path: store.into() }),
            (_, Found::Free) => (store.to_path_buf(), false),
            (Exists::Refuse, _) => {
                return Err(PackError::Exists { path: store.into(), unfinished: found == Found::Unfinished });
            }
            (Exists::Resume, Found::Unfinished) => (store.to_path_buf(), true),
            (Exists::Resume, Found::Store(_)) if find(&beside)? == Found::Unfinished => (beside, true),
            (Exists::Resume, Found::Store(theirs)) if *theirs == fingerprint(settings) => return Ok(Start::Complete),
            (Exists::Resume, Found::Store(_)) => {
                let difference = "it is finished, and was packed from other data or with other settings".into();
                return Err(PackError::Mismatch { store: store.into(), difference });
            }
            (Exists::Overwrite, Found::Unfinished) => (store.to_path_buf(), false),
            (Exists::Overwrite, Found::Store(_)) => (beside, false),
        };
        let replaces = (dir != store && is_store).then(|| store.to_path_buf());
        let journal = if resume {
            let mut journal = Journal::open(disk, &dir)?;
            lock(&journal, &dir)?;
            journal.resume(disk, &dir, settings)?;
            journal
        } else {
            clear(disk, &dir)?;
            disk.create_dir_all(&dir)?;
            let journal = Journal::create(disk, &dir, settings, shards)?;
            lock(&journal, &dir)?;
            journal
        };
        Ok(Start::Pack(Self { dir, journal, replaces }))
    }

    /// The store is written: puts it in the place of the one it replaces, and takes the journal away.
    ///
    /// The journal goes after the exchange, so that a pack stopped between the two is finished by the next `--resume`.
    pub(crate) fn finish(self, disk: &Disk) -> Result<(), DiskError> {
        let Some(store) = self.replaces else {
            disk.remove_file(&self.dir.join(JOURNAL_NAME))?;
            return disk.sync_dir(&self.dir);
        };
        let old = disk.replace(&self.dir, &store)?;
        disk.sync_dir(parent(&store))?;
        disk.remove_file(&store.join(JOURNAL_NAME))?;
        disk.sync_dir(&store)?;
        disk.remove_dir_all(&old)
    }
}

fn lock(journal: &Journal, dir: &Path) -> Result<(), PackError> {
    journal.lock().map_err(|error| match error.kind() {
        io::ErrorKind::WouldBlock => PackError::Busy { store: dir.into() },
        _ => PackError::Io { path: dir.into(), error },
    })
}

/// Removes what an earlier pack left, unless it is still at work.
fn clear(disk: &Disk, dir: &Path) -> Result<(), PackError> {
    match find(dir)? {
        Found::Free => return Ok(()),
        Found::Other => return Err(PackError::NotOurs { path: dir.into() }),
        Found::Unfinished => lock(&Journal::open(disk, dir)?, dir)?,
        // The old store of an overwrite that was stopped before it removed it.
        Found::Store(_) => {}
    }
    Ok(disk.remove_dir_all(dir)?)
}

fn find(path: &Path) -> Result<Found, PackError> {
    let io = |error| PackError::Io { path: path.into(), error };
    let mut entries = match std::fs::read_dir(path) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Found::Free),
        Err(error) if error.kind() == io::ErrorKind::NotADirectory => return Ok(Found::Other),
        Err(error) => return Err(io(error)),
    };
    if path.join(JOURNAL_NAME).exists() {
        return Ok(Found::Unfinished);
    }
    if let Ok(root) = crate::side::read_json(&path.join("zarr.json")) {
        let ours = &root["attributes"]["brickyard"];
        let fingerprint = ours["settings_fingerprint"].as_str().unwrap_or_default();
        return Ok(if ours.is_null() { Found::Other } else { Found::Store(fingerprint.into()) });
    }
    // A pack that was killed while it made its journal leaves the journal's temporary file.
    let only_ours = entries.all(|e| e.is_ok_and(|e| e.file_name().to_string_lossy().starts_with(JOURNAL_NAME)));
    Ok(if only_ours { Found::Free } else { Found::Other })
}

/// Where the successor of a finished store is made.
fn beside(store: &Path) -> PathBuf {
    let mut name = store.components().as_path().as_os_str().to_owned();
    name.push(".packing");
    name.into()
}

fn parent(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Makes the names of all files below a directory last.
pub(crate) fn sync_tree(disk: &Disk, dir: &Path) -> Result<(), DiskError> {
    let io = |error| DiskError { path: dir.into(), error };
    for entry in std::fs::read_dir(dir).map_err(io)? {
        let entry = entry.map_err(io)?;
        if entry.file_type().map_err(io)?.is_dir() {
            sync_tree(disk, &entry.path())?;
        }
    }
    disk.sync_dir(dir)
}
