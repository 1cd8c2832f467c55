//! The files written by packing in a store's directory, and in that of an export as Zarr 2. Nothing else is ever deleted:
//! foreign files prevent replacing the directory.

use crate::downsample::Downsample;
use crate::layout::{COUNTS_NAME, JOURNAL_NAME, LABELS_NAME, LOCK_NAME, SIDE_NAME};
use crate::pack::disk::{Disk, DiskError, temporary};
use std::fs::DirEntry;
use std::io;
use std::path::{Path, PathBuf};

/// The arrays beside each level, including those of stores of format 1 (`minmax`, `occupancy`), which may be
/// overwritten.
const SIDE_ARRAYS: [&str; 6] = ["ranges", "hashes", "shards", "aprons", "minmax", "occupancy"];

/// A folder of a store or export, by its permitted content.
#[derive(Clone, Copy)]
pub(crate) enum Folder {
    /// Levels and the root document.
    Store,
    /// The folder of an image's labels. With anything in it, it is someone's; a pack killed at its start leaves it empty.
    Labels,
    /// Levels and root documents of Zarr 2.
    OldGroup,
    /// An array of Zarr 2: documents and chunks.
    OldArray,
    /// An array: a document, chunks and side data.
    Array,
    /// Chunks or folders of chunks, by number.
    Chunks,
    /// Arrays.
    Side,
}

impl Folder {
    fn may_hold_file(self, name: &str) -> bool {
        let whole = name.strip_suffix(".tmp").unwrap_or(name);
        match self {
            Self::Store => ["zarr.json", JOURNAL_NAME].contains(&whole) || name == LOCK_NAME,
            Self::Array => whole == "zarr.json",
            Self::OldGroup => [".zgroup", ".zattrs"].contains(&whole) || name == LOCK_NAME,
            Self::OldArray => [".zarray", ".zattrs"].contains(&whole),
            Self::Chunks => is_number(whole),
            Self::Side | Self::Labels => false,
        }
    }

    /// The kind of a subfolder with this name.
    fn inner(self, name: &str) -> Option<Self> {
        let is_side = || SIDE_ARRAYS.contains(&name) || Downsample::ALL.iter().any(|method| method.name() == name);
        match self {
            Self::Store if name == LABELS_NAME => Some(Self::Labels),
            Self::Store => is_number(name).then_some(Self::Array),
            Self::Labels => None,
            Self::Array if name == "c" => Some(Self::Chunks),
            Self::Array => (name == SIDE_NAME).then_some(Self::Side),
            Self::OldGroup => is_number(name).then_some(Self::OldArray),
            Self::OldArray => is_number(name).then_some(Self::Chunks),
            Self::Chunks => is_number(name).then_some(Self::Chunks),
            Self::Side if name == COUNTS_NAME => Some(Self::Chunks),
            Self::Side => is_side().then_some(Self::Array),
        }
    }
}

/// Whether it is a number in canonical form.
pub(crate) fn is_number(name: &str) -> bool {
    name.parse::<u32>().is_ok_and(|n| n.to_string() == name)
}

/// The kind of a folder's entry.
enum Entry {
    File,
    Folder(Folder),
    Foreign,
}

fn classify(folder: Folder, entry: &DirEntry) -> io::Result<Entry> {
    let (kind, name) = (entry.file_type()?, entry.file_name());
    let name = name.to_string_lossy();
    Ok(if kind.is_dir() {
        folder.inner(&name).map_or(Entry::Foreign, Entry::Folder)
    } else if kind.is_file() && folder.may_hold_file(&name) {
        Entry::File
    } else {
        Entry::Foreign
    })
}

/// Finds a foreign entry in a store's directory, if any.
pub(crate) fn find_foreign(store: &Path) -> io::Result<Option<PathBuf>> {
    find_foreign_in(Folder::Store, store)
}

/// Finds a foreign entry in a folder, if any.
pub(crate) fn find_foreign_in(folder: Folder, dir: &Path) -> io::Result<Option<PathBuf>> {
    for entry in std::fs::read_dir(dir)? {
        let entry = entry?;
        let found = match classify(folder, &entry)? {
            Entry::File => None,
            Entry::Folder(inner) => find_foreign_in(inner, &entry.path())?,
            Entry::Foreign => Some(entry.path()),
        };
        if found.is_some() {
            return Ok(found);
        }
    }
    Ok(None)
}

/// Deletes packing's files in a store's directory, except its journal and lock. Folders with anything else stay.
///
/// # Errors
/// If something cannot be deleted.
pub(crate) fn remove(disk: &Disk, store: &Path) -> Result<(), DiskError> {
    // From the first moment on this is no longer a store.
    for name in [store.join("zarr.json"), temporary(&store.join("zarr.json"))] {
        remove_file(disk, &name)?;
    }
    disk.sync_dir(store)?;
    remove_in(disk, Folder::Store, store).map(drop)
}

/// Deletes the chunks in a folder, if it exists, and the folder unless it holds something else.
///
/// # Errors
/// If something cannot be deleted.
pub(crate) fn remove_chunks(disk: &Disk, dir: &Path) -> Result<(), DiskError> {
    match dir.try_exists() {
        Ok(false) => Ok(()),
        Ok(true) => match remove_in(disk, Folder::Chunks, dir)? {
            true => disk.remove_dir(dir),
            false => Ok(()),
        },
        Err(error) => Err(DiskError { path: dir.into(), error }),
    }
}

/// Deletes the folder's own files, except a journal and a lock. Returns whether it is now empty.
///
/// # Errors
/// If something cannot be deleted.
pub(crate) fn remove_in(disk: &Disk, folder: Folder, dir: &Path) -> Result<bool, DiskError> {
    let io = |error| DiskError { path: dir.into(), error };
    let mut is_empty = true;
    for entry in std::fs::read_dir(dir).map_err(io)? {
        let entry = entry.map_err(io)?;
        let path = entry.path();
        match classify(folder, &entry).map_err(io)? {
            Entry::File if entry.file_name() == JOURNAL_NAME || entry.file_name() == LOCK_NAME => is_empty = false,
            Entry::File => remove_file(disk, &path)?,
            Entry::Folder(inner) if remove_in(disk, inner, &path)? => disk.remove_dir(&path)?,
            Entry::Folder(_) | Entry::Foreign => is_empty = false,
        }
    }
    Ok(is_empty)
}

/// Deletes a file if it exists.
pub(crate) fn remove_file(disk: &Disk, path: &Path) -> Result<(), DiskError> {
    match disk.remove_file(path) {
        Err(DiskError { error, .. }) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        other => other,
    }
}
