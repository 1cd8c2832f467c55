//! The destination of a pack: permission, working directory, and the move to the final name.
//!
//! | existing output | working directory |
//! | --- | --- |
//! | nothing, or an unfinished pack | in place |
//! | a finished store | `STORE.packing` beside it; at the end the two are exchanged, and the old one is deleted |
//!
//! A directory is changed only under its lock (`lock.rs`), and also the replaced store's. Observations from before
//! locking are repeated. The journal marks a pack beside a store, unlike a store that happens to have such a name.
//!
//! The journal goes last: a pack stopped between exchange and end is an unfinished one under the final name, whose
//! journal identifies the old store beside it. Without exchange of names (NFS) there is a moment without a store under
//! the final name: meanwhile the pack beside it counts.

use crate::error::OpenError;
use crate::folder::Folder;
use crate::inside::{check_on_disk, check_outside, named};
use crate::json::read_json;
use crate::layout::{JOURNAL_NAME, LOCK_NAME};
use crate::ngff::Ngff;
use crate::pack::disk::{Disk, DiskError, free_bytes, missing, nearest, temporary, with_suffix};
use crate::pack::image_labels::ImageLabels;
use crate::pack::journal::{Head, Journal};
use crate::pack::lock::{self, DirLock};
use crate::pack::plan::PackPlan;
use crate::pack::{Exists, OF_VERSION, PackError, fingerprint, ours};
use rustix::fs::Access;
use serde_json::Value;
use std::ffi::OsString;
use std::io;
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// Most changes of the directory during inspection.
const MOST_CHANGES: u32 = 100;

/// A running pack's directory, journal and lock.
pub(crate) struct Output<'a> {
    /// The working directory of the store.
    pub(crate) dir: PathBuf,
    /// Its final path.
    store: PathBuf,
    pub(crate) journal: Journal<'a>,
    lock: DirLock,
    /// The lock of the store to be replaced, against appends.
    replaced: Option<DirLock>,
}

/// Content under a name.
#[derive(PartialEq)]
enum Found {
    /// Nothing, or only traces of a pack stopped before its start.
    Free,
    Unfinished {
        /// Made beside the store to be replaced.
        replaces: bool,
        /// The store is finished; only cleanup remains.
        is_whole: bool,
    },
    /// A finished store, with its settings' fingerprint.
    Store(String),
    Other,
}

/// An action on the output's directories.
#[derive(Clone, Copy, PartialEq)]
enum Step {
    /// Report an unfinished pack.
    Refuse,
    /// Start in a free directory.
    New,
    /// Start over on an unfinished pack.
    Again,
    Resume,
    /// Delete the remains beside a whole store, and look again.
    Tidy,
}

impl<'a> Output<'a> {
    /// Prepares and locks the output directory by the policy `exists`. Returns `None` if there is nothing to resume,
    /// since a finished store with these settings exists.
    pub(crate) fn start(
        disk: &'a Disk,
        store: &Path,
        exists: Exists,
        settings: &Value,
        plan: &PackPlan,
    ) -> Result<Option<Self>, PackError> {
        let store = resolve(store)?;
        check_place(&store, settings)?;
        check_room(&store, plan)?;
        disk.work_at(&store);
        let made = missing(&store);
        for _ in 0..MOST_CHANGES {
            let Some((step, dir)) = decide(disk, &store, exists, settings)? else {
                if is_there(&store.join(LOCK_NAME))? {
                    // Left by a pack killed as its last step; a live holder keeps it.
                    drop(DirLock::take(disk, &store));
                }
                list_labels(disk, &store)?;
                return Ok(None);
            };
            disk.meanwhile("it is decided");
            let mut lock = DirLock::take(disk, &dir)?;
            if dir != store {
                lock.takes_dir_along();
            }
            let replaced = (dir != store && is_there(&store)?).then(|| DirLock::take(disk, &store)).transpose()?;
            if decide(disk, &store, exists, settings)? != Some((step, dir.clone())) {
                continue;
            }
            if let Some(journal) = prepare(disk, &store, &dir, step, &lock, settings, plan.shard_count())? {
                made.iter().try_for_each(|dir| disk.sync_dir(parent(dir)))?;
                if let Some(replaced) = &replaced {
                    replaced.declare(disk)?;
                }
                return Ok(Some(Self { dir, store, journal, lock, replaced }));
            }
        }
        Err(PackError::Busy { store, holder: None })
    }

    /// Deletes everything written so far, and the directories that this pack made.
    ///
    /// # Errors
    /// If something cannot be deleted.
    pub(crate) fn abandon(self, disk: &Disk) -> Result<(), DiskError> {
        ours::remove(disk, &self.dir)?;
        // Last, so that until then it is an unfinished pack.
        ours::remove_file(disk, &self.dir.join(JOURNAL_NAME))
    }

    /// Moves the written store to its final place, deletes the store it replaces, and removes the journal.
    pub(crate) fn finish(mut self, disk: &Disk) -> Result<(), PackError> {
        if self.dir != self.store {
            refuse_foreign(&self.store)?;
            let exchanged = exchange(disk, &self.dir, &self.store);
            if let Some(mut replaced) = self.replaced.take() {
                replaced.moved_to_one_of(&[&self.dir, &aside(&self.store)]);
            }
            exchanged?;
            disk.meanwhile("the names are exchanged");
            self.lock.moved(&self.store);
        }
        tidy(disk, &self.store, self.journal.replaces())
    }
}

/// Makes the checks of [`Output::start`] without a lock or any change. Returns the working directory; `None` if a finished store with these
/// settings exists.
pub(crate) fn rehearse(
    disk: &Disk,
    store: &Path,
    exists: Exists,
    settings: &Value,
    plan: &PackPlan,
) -> Result<Option<PathBuf>, PackError> {
    let store = resolve(store)?;
    check_place(&store, settings)?;
    check_room(&store, plan)?;
    let Some((step, dir)) = decide(disk, &store, exists, settings)? else { return Ok(None) };
    for dir in [&dir, &store] {
        if let Some(holder) = lock::holder_of(dir) {
            return Err(PackError::Busy { store: dir.clone(), holder: Some(holder) });
        }
    }
    may_take(&store, &dir, step)?;
    if step == Step::Resume {
        Head::of(&dir)?.may_resume(&dir, settings)?;
    }
    // A pack would find out by creating its folder.
    let place = nearest(&dir);
    rustix::fs::access(place, Access::WRITE_OK | Access::EXEC_OK)
        .map_err(|error| PackError::ReadOnly { path: place.into(), error: error.into() })?;
    Ok(Some(dir))
}

/// Refuses a place inside another store, except for labels among those of an image.
fn check_place(store: &Path, settings: &Value) -> Result<(), PackError> {
    match ImageLabels::around(store)? {
        Some(labels) => labels.check(serde_json::from_value(settings["kind"].clone()).unwrap_or_default()),
        None => Ok(check_outside(store)?),
    }
}

/// Lists a whole store among its image's labels, if it is one of them.
fn list_labels(disk: &Disk, store: &Path) -> Result<(), PackError> {
    match ImageLabels::around(store)? {
        Some(labels) => labels.list(disk),
        None => Ok(()),
    }
}

/// Refuses a disk without room for the files that are always written in full.
fn check_room(store: &Path, plan: &PackPlan) -> Result<(), PackError> {
    let needed_bytes = plan.scratch_bytes;
    match free_bytes(store) {
        Some(free_bytes) if free_bytes < needed_bytes => {
            Err(PackError::NoRoom { path: store.into(), needed_bytes, free_bytes })
        }
        _ => Ok(()),
    }
}

/// Refuses a step that would report an unfinished pack, or delete others' files.
fn may_take(store: &Path, dir: &Path, step: Step) -> Result<(), PackError> {
    match step {
        Step::Refuse => Err(PackError::Exists { path: dir.into(), unfinished: true }),
        Step::Tidy | Step::Resume => Ok(()),
        Step::New | Step::Again if dir != store => refuse_foreign(store).and_then(|()| refuse_foreign(dir)),
        Step::New | Step::Again => refuse_foreign(dir),
    }
}

/// Prepares the locked directory; `None` if it must be inspected again.
fn prepare<'a>(
    disk: &'a Disk,
    store: &Path,
    dir: &Path,
    step: Step,
    lock: &DirLock,
    settings: &Value,
    shards: u64,
) -> Result<Option<Journal<'a>>, PackError> {
    let replaces = match find(store)? {
        Found::Store(theirs) if dir != store => Some(theirs),
        // The store is gone, or not back from the exchange: the replacement target stays the same.
        _ if dir != store => Head::of(dir)?.replaces,
        _ => None,
    };
    may_take(store, dir, step)?;
    match step {
        Step::Tidy => {
            lock.declare(disk)?;
            tidy(disk, store, Head::of(dir)?.replaces.as_deref())?;
            return Ok(None);
        }
        Step::Resume => {
            let mut journal = Journal::open(disk, dir)?;
            journal.resume(settings)?;
            lock.declare(disk)?;
            return Ok(Some(journal));
        }
        Step::Refuse | Step::New | Step::Again => {}
    }
    lock.declare(disk)?;
    // The old journal stays until replaced, so this never looks like a store.
    ours::remove(disk, dir)?;
    Ok(Some(Journal::create(disk, dir, Head { replaces, settings: settings.clone(), shards })?))
}

/// The action and its directory; `None` if the requested store already exists.
fn decide(disk: &Disk, store: &Path, exists: Exists, settings: &Value) -> Result<Option<(Step, PathBuf)>, PackError> {
    let beside = with_suffix(store, ".packing");
    let [found_beside, found] = find_both(disk, [&beside, store])?;
    let is_pending = matches!(found_beside, Found::Unfinished { replaces: true, .. });
    let mismatch = |difference: &str| PackError::Mismatch { store: store.into(), difference: difference.into() };
    let (step, is_beside) = match (exists, found) {
        (_, Found::Other) => return Err(PackError::NotOurs { path: store.into() }),
        (_, Found::Free) if !is_pending => (Step::New, false),
        (Exists::Refuse, Found::Store(_)) => {
            return Err(PackError::Exists { path: store.into(), unfinished: false });
        }
        (Exists::Refuse, found) => (Step::Refuse, found == Found::Free),
        (Exists::Resume, Found::Unfinished { .. }) => (Step::Resume, false),
        (Exists::Resume, _) if is_pending => (Step::Resume, true),
        (Exists::Resume, Found::Store(theirs)) if theirs == fingerprint(settings) => return Ok(None),
        (Exists::Resume, _) => {
            return Err(mismatch("it is finished, from other data or with other settings"));
        }
        (Exists::Overwrite, Found::Unfinished { is_whole: true, .. }) => (Step::Tidy, false),
        (Exists::Overwrite, Found::Unfinished { .. }) => (Step::Again, false),
        (Exists::Overwrite, _) if is_pending => (Step::Again, true),
        (Exists::Overwrite, _) if found_beside == Found::Free => (Step::New, true),
        (Exists::Overwrite, _) => return Err(PackError::InTheWay { path: beside, store: store.into() }),
    };
    Ok(Some((step, if is_beside { beside } else { store.into() })))
}

/// Content under two names that others may exchange at any moment. A single look may mix both sides of an exchange; two
/// equal looks, at the same directories, are consistent.
fn find_both(disk: &Disk, paths: [&Path; 2]) -> Result<[Found; 2], PackError> {
    let mut last = None;
    for _ in 0..MOST_CHANGES {
        let first = (number(paths[0]), find(paths[0])?);
        disk.meanwhile("one of two names was looked at");
        let now = [first, (number(paths[1]), find(paths[1])?)];
        if last.as_ref() == Some(&now) {
            return Ok(now.map(|(_, found)| found));
        }
        last = Some(now);
    }
    Err(PackError::Busy { store: paths[1].into(), holder: None })
}

/// The identity of a named directory, if seen.
fn number(path: &Path) -> Option<(u64, u64)> {
    std::fs::metadata(path).map(|dir| (dir.dev(), dir.ino())).ok()
}

/// Swaps the new store with the old one, if any.
fn exchange(disk: &Disk, new: &Path, store: &Path) -> Result<(), PackError> {
    if !disk.exchange(new, store)? {
        let aside = aside(store);
        if is_there(store)? {
            disk.rename(store, &aside)?;
        }
        disk.rename_dir(new, store)?;
    }
    Ok(())
}

/// Ends a pack whose store has its final name: lists it among its image's labels, deletes the replaced store, then the
/// journal.
fn tidy(disk: &Disk, store: &Path, replaces: Option<&str>) -> Result<(), PackError> {
    // The new store's name must be durable before the old store goes.
    disk.sync_dir(parent(store))?;
    list_labels(disk, store)?;
    if let Some(replaced) = replaces {
        let (old, aside) = (with_suffix(store, ".packing"), aside(store));
        if !is_there(&old)? && is_store(&aside, replaced)? {
            disk.rename(&aside, &old)?;
        }
        // Its root document goes first. A different root document means a newcomer's store.
        let names = ["zarr.json", JOURNAL_NAME].map(|name| old.join(name));
        let is_begun = is_there(&old)? && !is_there(&names[0])? && !is_there(&names[1])?;
        if is_store(&old, replaced)? || is_begun {
            // Someone may have locked the old store under its former name, which no longer leads to the lock file.
            let lock = DirLock::take(disk, &old)?;
            ours::remove(disk, &old)?;
            drop(lock);
            // Passing packs remove it themselves if they are the last to leave.
            match disk.remove_dir(&old) {
                Err(gone) if gone.error.kind() == io::ErrorKind::NotFound => {}
                other => other?,
            }
            // Must precede the journal's removal, after which nobody would clean up.
            disk.sync_dir(parent(store))?;
        }
    }
    disk.remove_file(&store.join(JOURNAL_NAME))?;
    Ok(disk.sync_dir(store)?)
}

/// Ends the pack of a whole store. Returns whether there was one.
pub(crate) fn end(disk: &Disk, store: &Path) -> Result<bool, PackError> {
    let dir = resolve(store)?;
    let is_whole = || find(&dir).map(|found| matches!(found, Found::Unfinished { is_whole: true, .. }));
    if !is_whole()? {
        return Ok(false);
    }
    let lock = DirLock::take(disk, &dir)?;
    // Checked again: another process may have been packing until now.
    if is_whole()? {
        lock.declare(disk)?;
        tidy(disk, &dir, Head::of(&dir)?.replaces.as_deref())?;
    }
    Ok(true)
}

/// The setting of journals of edits, which make a store from the one it replaces.
pub(crate) const OF_EDIT: &str = "edit";

/// Ends a stopped edit of a store's levels: an edited store is cleaned up, and the beginnings of one are deleted.
pub(crate) fn end_edit(disk: &Disk, dir: &Path) -> Result<(), PackError> {
    let is_of_edit = |path: &Path| match path.join(JOURNAL_NAME).is_file() {
        true => Head::of(path).map(|head| !head.settings[OF_EDIT].is_null()),
        false => Ok(false),
    };
    if is_of_edit(dir)? {
        end(disk, dir)?;
    }
    let beside = with_suffix(dir, ".packing");
    if !is_of_edit(&beside)? {
        return Ok(());
    }
    let mut lock = DirLock::take(disk, &beside)?;
    // Checked again: another process may have been at it until now.
    if !is_of_edit(&beside)? {
        return Ok(());
    }
    lock.declare(disk)?;
    let is_whole = matches!(find(&beside)?, Found::Unfinished { is_whole: true, .. });
    if is_there(dir)? || !is_whole {
        lock.takes_dir_along();
        ours::remove(disk, &beside)?;
        return Ok(ours::remove_file(disk, &beside.join(JOURNAL_NAME))?);
    }
    // Between two renames, where names cannot be exchanged: the edited store is whole.
    disk.rename_dir(&beside, dir)?;
    lock.moved(dir);
    tidy(disk, dir, Head::of(dir)?.replaces.as_deref())
}

/// The version of a pack's store: the one asked for, or that of the image around it, of what is there, or 0.5.
///
/// # Errors
/// If the image has another one, or what is there cannot be read.
pub(crate) fn version_for(store: &Path, asked: Option<Ngff>) -> Result<Ngff, PackError> {
    let store = resolve(store)?;
    if let Some(labels) = ImageLabels::around(&store)? {
        return labels.ngff(asked);
    }
    if let Some(asked) = asked {
        return Ok(asked);
    }
    for dir in [&with_suffix(&store, ".packing"), &store] {
        if dir.join(JOURNAL_NAME).is_file() {
            let settings = Head::of(dir)?.settings;
            return Ok(Ngff::ALL.into_iter().find(|ngff| settings[OF_VERSION] == ngff.name()).unwrap_or_default());
        }
    }
    Ok(version_at(&store).unwrap_or_default())
}

/// Refuses a finished store of another version.
pub(crate) fn check_version(store: &Path, ngff: Ngff) -> Result<(), PackError> {
    match version_at(store).filter(|found| *found != ngff) {
        Some(found) => {
            let difference = format!("it is finished, in OME-Zarr {found} (`upgrade` changes that without a pack)");
            Err(PackError::Mismatch { store: store.into(), difference })
        }
        None => Ok(()),
    }
}

/// The version of a finished store, if there is one.
fn version_at(store: &Path) -> Option<Ngff> {
    let root = read_json(&Folder::open(store).ok()?, &store.join("zarr.json")).ok()?;
    Ngff::of(&root).filter(|_| !root["attributes"]["brickyard"].is_null())
}

fn is_store(path: &Path, with: &str) -> Result<bool, PackError> {
    Ok(matches!(find(path)?, Found::Store(found) if found == with))
}

/// Whether a name is taken. Unreadable entries are not considered absent.
pub(crate) fn is_there(path: &Path) -> Result<bool, PackError> {
    path.try_exists().map_err(|error| PackError::Io { path: path.into(), error })
}

fn refuse_foreign(store: &Path) -> Result<(), PackError> {
    match ours::find_foreign(store) {
        Ok(None) => Ok(()),
        Ok(Some(found)) => Err(PackError::Foreign { store: store.into(), found }),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
        Err(error) => Err(PackError::Io { path: store.into(), error }),
    }
}

fn find(path: &Path) -> Result<Found, PackError> {
    let io = |error| PackError::Io { path: path.into(), error };
    let entries = match std::fs::read_dir(path) {
        Ok(entries) => entries,
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Found::Free),
        Err(error) if error.kind() == io::ErrorKind::NotADirectory => return Ok(Found::Other),
        Err(error) => return Err(io(error)),
    };
    let names = entries.map(|e| e.map(|e| e.file_name())).collect::<io::Result<Vec<OsString>>>().map_err(io)?;
    let folder = match Folder::open(path) {
        // Moved or deleted since.
        Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Found::Free),
        folder => folder.map_err(io)?,
    };
    let ours = match read_json(&folder, &path.join("zarr.json")) {
        Ok(root) => Some(root["attributes"]["brickyard"].clone()).filter(|ours| !ours.is_null()),
        // An unreadable document may belong to a whole store.
        Err(OpenError::Io { path, error }) if error.kind() != io::ErrorKind::NotFound => {
            return Err(PackError::Io { path, error });
        }
        Err(_) => None,
    };
    if names.iter().any(|name| name == JOURNAL_NAME) {
        return Ok(Found::Unfinished { replaces: Head::of(path)?.replaces.is_some(), is_whole: ours.is_some() });
    }
    if let Some(ours) = ours {
        return Ok(Found::Store(ours["settings_fingerprint"].as_str().unwrap_or_default().into()));
    }
    // Traces of a pack killed while creating its journal.
    let traces = [LOCK_NAME.into(), temporary(Path::new(JOURNAL_NAME)).into_os_string()];
    Ok(if names.iter().all(|name| traces.contains(name)) { Found::Free } else { Found::Other })
}

/// Resolves a directory to a path without links and with a name, to allow others beside it.
pub(crate) fn resolve(store: &Path) -> Result<PathBuf, PackError> {
    check_on_disk(store)?;
    // Without a trailing slash, which would follow a link.
    let store = store.components().as_path();
    let is_link = std::fs::symlink_metadata(store).is_ok_and(|file| file.is_symlink());
    if !is_link && store.file_name().is_some() {
        return Ok(store.into());
    }
    match store.canonicalize() {
        Ok(target) => Ok(target),
        Err(error) => Err(PackError::Io { path: store.into(), error }),
    }
}

/// The place of a store between two renames.
pub(crate) fn aside(store: &Path) -> PathBuf {
    with_suffix(store, ".replaced")
}

pub(crate) fn parent(path: &Path) -> &Path {
    path.parent().map_or(Path::new("."), named)
}
