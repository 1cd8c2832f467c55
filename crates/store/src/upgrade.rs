//! Change of a finished store's version of OME-Zarr, both ways: of its root document, and of those of its labels, for an
//! image and its labels have one version.
//!
//! All documents are made, checked and written under temporary names before the first gets its own; the image's comes
//! last. So a fault leaves all in the former version, but for a kill or a power failure among the renames, which may
//! leave labels in the new one: the same upgrade goes on from there. Each document is replaced in one step, under the
//! locks of the store and of its labels. No array is read; the cost is that of a few small documents.

mod error;
#[cfg(test)]
mod tests;

pub use error::UpgradeError;

use crate::append::stale_groups;
use crate::error::OpenError;
use crate::folder::Folder;
use crate::held::{Held, find_finished, unfinished};
use crate::json::read_json;
use crate::layout::LABELS_NAME;
use crate::metadata::document_bytes;
use crate::ngff::{Ngff, Root, gathered_in_version};
use crate::pack::disk::{Disk, DiskError, temporary};
use crate::pack::image_labels::ImageLabels;
use crate::pack::lock::{self, DirLock};
use crate::pack::{PackError, ours};
use crate::shard_file::IoMode;
use crate::store::{Store, open_folder};
use serde_json::{Value, json};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Outcome of an upgrade.
#[derive(Clone, Debug, PartialEq)]
pub struct UpgradeReport {
    /// The changed documents, the store's own last; none if all were of the version.
    pub changed: Vec<PathBuf>,
    /// Root documents of surrounding groups, in which another program gathered the former documents.
    pub stale_groups: Vec<PathBuf>,
}

/// Gives a store, and its labels, metadata of a version of OME-Zarr, durably.
///
/// # Errors
/// If the store is missing, unfinished, in use by another writer or not writable, if it is among the labels of an image
/// of another version, if a document says what the version cannot, or if the disk fails. Except for
/// [`UpgradeError::Partly`] and [`UpgradeError::Unsynced`], all is then unchanged.
pub fn upgrade(store: &Path, to: Ngff) -> Result<UpgradeReport, UpgradeError> {
    upgrade_on(&Disk::default(), store, to)
}

/// Makes all checks of [`upgrade`], and changes nothing.
///
/// # Errors
/// If [`upgrade`] would fail before its first change.
pub fn rehearse_upgrade(store: &Path, to: Ngff) -> Result<UpgradeReport, UpgradeError> {
    let dir = find_store(&Disk::default(), store, to)?;
    for place in std::iter::once(dir.clone()).chain(label_dirs(&dir)?) {
        if let Some(holder) = lock::holder_of(&place) {
            return Err(PackError::Busy { store: place, holder: Some(holder) }.into());
        }
    }
    let changes = Changes::of(&open_folder(&dir)?, to)?;
    Ok(changes.report(&dir))
}

fn upgrade_on(disk: &Disk, store: &Path, to: Ngff) -> Result<UpgradeReport, UpgradeError> {
    let dir = find_store(disk, store, to)?;
    let held = Held::take(disk, &dir)?;
    let labels = dir.join(LABELS_NAME);
    let places = label_dirs(&dir)?;
    let mut locks = Vec::new();
    for place in places.first().map(|_| &labels).into_iter().chain(&places) {
        let lock = DirLock::take(disk, place)?;
        lock.declare(disk).map_err(PackError::from)?;
        locks.push(lock);
    }
    let changes = Changes::of(&held.folder, to)?;
    let unsynced = |DiskError { error, .. }: DiskError| UpgradeError::Unsynced { store: dir.clone(), to, error };
    if let Some(failed) = changes.put(disk, &held, to) {
        return Err(failed);
    }
    // Also of documents replaced by an earlier upgrade, reported as not durable.
    std::iter::once(&dir)
        .chain(&places)
        .chain(places.first().map(|_| &labels))
        .try_for_each(|place| disk.sync_dir(place))
        .map_err(unsynced)?;
    Ok(changes.report(&dir))
}

/// The directory of a finished store that may get a version.
fn find_store(disk: &Disk, store: &Path, to: Ngff) -> Result<PathBuf, UpgradeError> {
    let dir = find_finished(disk, store)?;
    // A lock would make the folder of a store that is missing.
    Store::open_own(&dir)?;
    if let Some(labels) = ImageLabels::around(&dir).map_err(PackError::from)? {
        labels.ngff(Some(to))?;
    }
    Ok(dir)
}

/// The folders of groups among an image's labels, in order.
fn label_dirs(image: &Path) -> Result<Vec<PathBuf>, UpgradeError> {
    let labels = image.join(LABELS_NAME);
    let io = |error| PackError::Io { path: labels.clone(), error };
    let entries = match std::fs::read_dir(&labels) {
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => return Ok(Vec::new()),
        entries => entries.map_err(io)?,
    };
    let mut dirs = Vec::new();
    for entry in entries {
        let path = entry.map_err(io)?.path();
        if !path.join("zarr.json").is_file() {
            if let Some(unfinished) = unfinished(&path)? {
                return Err(unfinished.into());
            }
            continue;
        }
        if path.is_symlink() {
            let problem = "is a symbolic link, and nothing is changed through links: move it out of the image, and \
                           upgrade what it leads to by itself";
            return Err(UpgradeError::Label { path, problem });
        }
        if let Some(unfinished) = unfinished(&path)? {
            return Err(unfinished.into());
        }
        dirs.push(path);
    }
    dirs.sort();
    Ok(dirs)
}

/// The documents of a store and its labels that change, in the order of their replacement.
struct Changes(Vec<(PathBuf, Vec<u8>)>);

impl Changes {
    fn of(folder: &Folder, to: Ngff) -> Result<Self, UpgradeError> {
        let dir = folder.path();
        let mut changes = Vec::new();
        for label in label_dirs(dir)? {
            let path = label.join("zarr.json");
            let found = read_json(folder, &path)?;
            if found["attributes"]["ome"]["multiscales"][0].is_object() {
                changes.extend(changed(&label, found, to)?);
            }
        }
        let list = dir.join(LABELS_NAME).join("zarr.json");
        match read_json(folder, &list) {
            Ok(found) if Ngff::of(&found).is_some_and(|ngff| ngff != to) => {
                let mut new = gathered_in_version(&list, &found, to)?;
                new["attributes"]["ome"]["version"] = json!(to.name());
                changes.push((list, document_bytes(&new)));
            }
            Err(OpenError::Io { error, .. })
                if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {}
            found => drop(found?),
        }
        changes.extend(changed(dir, read_json(folder, &dir.join("zarr.json"))?, to)?);
        Ok(Self(changes))
    }

    fn report(self, store: &Path) -> UpgradeReport {
        let stale_groups = if self.0.is_empty() { Vec::new() } else { stale_groups(store) };
        UpgradeReport { changed: self.0.into_iter().map(|(path, _)| path).collect(), stale_groups }
    }

    /// Replaces the documents. Returns the failure, if any.
    fn put(&self, disk: &Disk, held: &Held, to: Ngff) -> Option<UpgradeError> {
        let store = || held.folder.path().to_path_buf();
        let prepare = || {
            self.0.iter().try_for_each(|(path, text)| disk.prepare(path, text))?;
            if self.0.is_empty() { Ok(()) } else { disk.sync_parts(&store(), []) }
        };
        let mut done = 0;
        let failed = match prepare() {
            Err(error) => error,
            Ok(()) if held.folder.is_replaced() => return Some(held.folder.replaced().into()),
            Ok(()) => loop {
                let (path, _) = self.0.get(done)?;
                match disk.name(path) {
                    Ok(()) => done += 1,
                    Err(error) => break error,
                }
            },
        };
        // Left-overs are harmless: the next change of a document replaces them.
        self.0[done..].iter().for_each(|(path, _)| drop(ours::remove_file(disk, &temporary(path))));
        let DiskError { path, error } = failed;
        Some(match done {
            0 => UpgradeError::Unchanged { path, error, store: store() },
            _ => UpgradeError::Partly { path, error, store: store(), to },
        })
    }
}

/// The changed document of an image or its labels, checked if it is a store's; `None` if it has the version.
fn changed(dir: &Path, found: Value, to: Ngff) -> Result<Option<(PathBuf, Vec<u8>)>, UpgradeError> {
    let path = dir.join("zarr.json");
    if Ngff::of(&found) == Some(to) {
        return Ok(None);
    }
    if Ngff::of(&found).is_none() {
        let version = &found["attributes"]["ome"]["version"];
        return Err(OpenError::invalid(&path, "attributes.ome.version", "\"0.5\" or \"0.6\"", version).into());
    }
    let text = document_bytes(&gathered_in_version(&path, &found, to)?);
    if !found["attributes"]["brickyard"].is_null() {
        if let Some(change) = Root::parse(&path, &document_bytes(&found))?.patient_change(&path) {
            return Err(UpgradeError::Altered { path, change });
        }
        Store::open_with_root(&Arc::new(open_folder(dir)?), IoMode::default(), None, &text)?;
    }
    Ok(Some((path, text)))
}
