//! The place of a folder that is written elsewhere first: a free name, or that of a store or an export as OME-Zarr, whose files are then deleted.
//! Anything else is left alone. Costs a sync of the new folder, and two renames.

use crate::error::OpenError;
use crate::folder::Folder as OpenFolder;
use crate::held::unfinished;
use crate::inside::check_outside;
use crate::json::read_json;
use crate::layout::{JOURNAL_NAME, LOCK_NAME};
use crate::pack::PackError;
use crate::pack::disk::{Disk, DiskError, Part};
use crate::pack::lock::DirLock;
use crate::pack::ours::{self, Folder};
use crate::pack::output::{aside, is_there, parent, resolve};
use serde_json::{Value, json};
use std::fs::File;
use std::io::{self, ErrorKind};
use std::path::{Path, PathBuf};

/// Name of this program in [`creator`].
const CREATOR: &str = "brickyard";

/// The attribute `_creator` of an exported group, by which its writer knows it again.
pub fn creator() -> Value {
    json!({ "name": CREATOR, "version": env!("CARGO_PKG_VERSION") })
}

/// A place for a folder.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Destination {
    path: PathBuf,
    overwrite: bool,
}

impl Destination {
    /// Checks a place.
    ///
    /// # Errors
    /// If it is inside a store, or something is there: anything without `overwrite`; with it, all but a store or export alone in its folder.
    pub fn new(path: &Path, overwrite: bool) -> Result<Self, PackError> {
        check_outside(path)?;
        // Without a last slash, which would follow a link.
        let name = path.components().as_path();
        if !overwrite && name.symlink_metadata().is_ok() {
            return Err(PackError::Exists { path: path.into(), unfinished: false });
        }
        let place = Self { path: resolve(path)?, overwrite };
        if is_there(&place.path)? {
            root_of(&place.path)?;
        }
        Ok(place)
    }

    /// The folder's path, without links.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Moves a complete folder of the same file system here, and deletes the one it replaces. Afterwards nothing has its old name, or, if others added
    /// files to the replaced folder meanwhile, these alone.
    ///
    /// # Errors
    /// If something that may not be replaced came here meanwhile, or a file cannot be synced, renamed or deleted.
    pub fn put(&self, new: &Path) -> Result<(), PackError> {
        self.put_on(&Disk::default(), new)
    }

    fn put_on(&self, disk: &Disk, new: &Path) -> Result<(), PackError> {
        disk.work_at(&self.path);
        if !disk.syncs_as_one() {
            sync_files(new).map_err(|error| PackError::Io { path: new.into(), error })?;
        }
        disk.sync_parts(new, [Part::Tree(new)])?;
        if self.overwrite && is_there(&self.path)? {
            self.replace(disk, new)?;
        } else {
            match disk.rename_dir(new, &self.path) {
                Err(DiskError { error, .. })
                    if matches!(error.kind(), ErrorKind::DirectoryNotEmpty | ErrorKind::NotADirectory) =>
                {
                    return Err(PackError::Exists { path: self.path.clone(), unfinished: false });
                }
                other => other?,
            }
        }
        Ok(disk.sync_dir(parent(&self.path))?)
    }

    fn replace(&self, disk: &Disk, new: &Path) -> Result<(), PackError> {
        // No lock is put into a folder of others.
        root_of(&self.path)?;
        let mut lock = DirLock::take(disk, &self.path)?;
        let root = root_of(&self.path)?;
        lock.declare(disk)?;
        let old = if disk.exchange(new, &self.path)? {
            new.to_path_buf()
        } else {
            let aside = aside(&self.path);
            disk.rename(&self.path, &aside)?;
            disk.rename_dir(new, &self.path).inspect_err(|_| {
                let _ = disk.rename(&aside, &self.path);
            })?;
            aside
        };
        lock.moved(&old);
        ours::remove_in(disk, root, &old)?;
        drop(lock);
        match disk.remove_dir(&old) {
            // Others' files came since the look at the folder.
            Err(DiskError { error, .. }) if error.kind() == ErrorKind::DirectoryNotEmpty => Ok(()),
            other => Ok(other?),
        }
    }
}

/// Deletes the store or export in a folder, finished or not, as far as it can; and the folder, unless others put something there.
pub fn remove_unfinished(folder: &Path) {
    let disk = Disk::default();
    for root in [Folder::Store, Folder::OldGroup] {
        let _ = ours::remove_in(&disk, root, folder);
    }
    for name in [JOURNAL_NAME, LOCK_NAME] {
        let _ = ours::remove_file(&disk, &folder.join(name));
    }
    let _ = std::fs::remove_dir(folder);
}

/// The kind of a folder that may be replaced.
fn root_of(path: &Path) -> Result<Folder, PackError> {
    if unfinished(path)?.is_some() {
        return Err(PackError::Exists { path: path.into(), unfinished: true });
    }
    let root = written_here(path)?.ok_or_else(|| PackError::NotOurs { path: path.into() })?;
    match ours::find_foreign_in(root, path) {
        Ok(None) => Ok(root),
        Ok(Some(found)) => Err(PackError::Foreign { store: path.into(), found }),
        Err(error) => Err(PackError::Io { path: path.into(), error }),
    }
}

/// The kind of a folder written by this program; `None` if it is another one's.
fn written_here(path: &Path) -> Result<Option<Folder>, PackError> {
    let folder = match OpenFolder::open(path) {
        Err(error) if error.kind() == ErrorKind::NotADirectory => return Ok(None),
        folder => folder.map_err(|error| PackError::Io { path: path.into(), error })?,
    };
    for (name, attributes, root) in [("zarr.json", "/attributes", Folder::Store), (".zattrs", "", Folder::OldGroup)] {
        let document = match read_json(&folder, &path.join(name)) {
            Ok(document) => document,
            Err(OpenError::Io { path, error }) if error.kind() != ErrorKind::NotFound => {
                return Err(PackError::Io { path, error });
            }
            Err(_) => continue,
        };
        let attributes = document.pointer(attributes).unwrap_or(&Value::Null);
        if !attributes["brickyard"].is_null() || attributes["_creator"]["name"] == CREATOR {
            return Ok(Some(root));
        }
    }
    Ok(None)
}

/// Syncs each file below a folder.
fn sync_files(folder: &Path) -> io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        match entry.file_type()?.is_dir() {
            true => sync_files(&entry.path())?,
            false => File::open(entry.path())?.sync_all()?,
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pack::tests::trial::Trial;
    use crate::test_store::{TestStore, bumps};

    /// A folder of Zarr 2 with a mark, or another's.
    fn old(path: &Path, name: &str) {
        std::fs::create_dir_all(path.join("0/0/1")).unwrap();
        std::fs::write(path.join(".zgroup"), r#"{"zarr_format":2}"#).unwrap();
        std::fs::write(path.join(".zattrs"), json!({ "_creator": { "name": name } }).to_string()).unwrap();
        for file in ["0/.zarray", "0/.zattrs", "0/0/1/2"] {
            std::fs::write(path.join(file), "{}").unwrap();
        }
    }

    fn new(folder: &Path) -> PathBuf {
        let new = folder.join("new");
        std::fs::create_dir(&new).unwrap();
        std::fs::write(new.join("a"), "new").unwrap();
        new
    }

    fn names(folder: &Path) -> Vec<PathBuf> {
        let mut names: Vec<_> = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()).collect();
        names.sort();
        names
    }

    #[test]
    fn a_free_name_is_taken_and_a_taken_one_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.zarr");
        Destination::new(&path, false).unwrap().put(&new(folder.path())).unwrap();
        assert_eq!(names(folder.path()), std::slice::from_ref(&path));
        assert!(matches!(Destination::new(&path, false), Err(PackError::Exists { unfinished: false, .. })));
        let late = Destination { path: path.clone(), overwrite: false };
        assert!(matches!(late.put(&new(folder.path())), Err(PackError::Exists { .. })));
        assert_eq!(std::fs::read(path.join("a")).unwrap(), b"new");
    }

    #[test]
    fn stores_and_exports_are_replaced() {
        for cannot_exchange in [false, true] {
            let folder = tempfile::tempdir().unwrap();
            let (store, export) = (folder.path().join("s.zarr"), folder.path().join("e.zarr"));
            std::fs::create_dir(&store).unwrap();
            TestStore::default().write(&store, bumps);
            old(&export, CREATOR);
            for path in [store, export] {
                let disk = Trial { cannot_exchange, ..Trial::default() }.disk();
                Destination::new(&path, true).unwrap().put_on(&disk, &new(folder.path())).unwrap();
                assert_eq!(names(&path), [path.join("a")]);
                std::fs::remove_dir_all(&path).unwrap();
            }
            assert_eq!(names(folder.path()), Vec::<PathBuf>::new());
        }
    }

    #[test]
    fn folders_of_others_and_their_files_stay() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.zarr");
        let refused = |is_expected: fn(&PackError) -> bool| {
            let before = names(&path);
            let late = Destination { path: path.clone(), overwrite: true };
            let new = new(folder.path());
            for error in [Destination::new(&path, true).map(drop).unwrap_err(), late.put(&new).unwrap_err()] {
                assert!(is_expected(&error), "{error}");
            }
            assert_eq!(names(&path), before);
            assert!(new.join("a").exists());
            std::fs::remove_dir_all(new).unwrap();
        };
        std::fs::create_dir(&path).unwrap();
        refused(|error| matches!(error, PackError::NotOurs { .. }));
        old(&path, "zarr-python");
        refused(|error| matches!(error, PackError::NotOurs { .. }));
        old(&path, CREATOR);
        for foreign in ["labels", "0/0/notes.txt", "zarr.json"] {
            std::fs::write(path.join(foreign), "{}").unwrap();
            refused(|error| matches!(error, PackError::Foreign { .. }));
            std::fs::remove_file(path.join(foreign)).unwrap();
        }
        std::fs::write(path.join(crate::layout::JOURNAL_NAME), "{}").unwrap();
        refused(|error| matches!(error, PackError::Exists { unfinished: true, .. }));
        std::fs::remove_dir_all(&path).unwrap();
        std::fs::write(&path, "a file").unwrap();
        let error = Destination::new(&path, true).unwrap_err();
        assert!(matches!(error, PackError::NotOurs { .. }), "{error}");
    }
}
