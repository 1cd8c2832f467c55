//! Exclusive hold of a finished store, for changes in place: by appending, editing and repairing.

use crate::error::OpenError;
use crate::folder::Folder;
use crate::layout::JOURNAL_NAME;
use crate::pack::PackError;
use crate::pack::disk::{Disk, with_suffix};
use crate::pack::lock::DirLock;
use crate::pack::output;
use crate::store::open_folder;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Why a store cannot be held.
pub(crate) enum HoldError {
    Open(OpenError),
    /// Another process writes to the store, or it is not writable.
    Pack(PackError),
    /// The store is being packed, or about to be replaced by the unfinished pack at `path`.
    Unfinished {
        path: PathBuf,
        replaces: bool,
    },
}

impl<E: Into<PackError>> From<E> for HoldError {
    fn from(error: E) -> Self {
        Self::Pack(error.into())
    }
}

impl From<OpenError> for HoldError {
    fn from(error: OpenError) -> Self {
        Self::Open(error)
    }
}

/// A finished store under its lock. Until it is dropped, no one else, in this process or another, changes the store.
pub(crate) struct Held {
    /// The store's folder, which receives all changes.
    pub(crate) folder: Arc<Folder>,
    _lock: DirLock,
}

/// The directory of a store without an unfinished pack, also beside it. Ends a stopped edit of levels.
pub(crate) fn find_finished(disk: &Disk, store: &Path) -> Result<PathBuf, HoldError> {
    let dir = output::resolve(store)?;
    disk.work_at(&dir);
    output::end_edit(disk, &dir)?;
    if let Some(unfinished) = unfinished(&dir)? {
        // Report an active packer as such.
        let _free = DirLock::take(disk, &dir)?;
        return Err(unfinished);
    }
    Ok(dir)
}

impl Held {
    /// Takes the lock of an existing store's directory.
    pub(crate) fn take(disk: &Disk, dir: &Path) -> Result<Self, HoldError> {
        let lock = DirLock::take(disk, dir)?;
        // Checked again: another process may have been packing until now.
        if let Some(unfinished) = unfinished(dir)? {
            return Err(unfinished);
        }
        lock.declare(disk)?;
        let folder = Arc::new(open_folder(dir)?);
        disk.work_in(folder.clone());
        Ok(Self { folder, _lock: lock })
    }
}

/// The unfinished pack or replacement of a directory, if any.
pub(crate) fn unfinished(dir: &Path) -> Result<Option<HoldError>, PackError> {
    for (path, replaces) in [(dir.to_path_buf(), false), (with_suffix(dir, ".packing"), true)] {
        let journal = path.join(JOURNAL_NAME);
        match journal.try_exists() {
            Ok(false) => {}
            Ok(true) => return Ok(Some(HoldError::Unfinished { path, replaces })),
            Err(error) if error.kind() == ErrorKind::NotADirectory => {}
            Err(error) => return Err(PackError::Io { path: journal, error }),
        }
    }
    Ok(None)
}
