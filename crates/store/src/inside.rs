//! Paths inside stores: for reading, errors name the intended store; for writing, they are refused to outsiders.

use crate::error::{OpenError, UnfitOutput};
use crate::folder::Folder;
use crate::json::read_json;
use crate::metadata::parse_info;
use brickyard_objects::is_address;
use std::path::{Component, Path, PathBuf};

/// Replaces the error for a path inside a store by one naming the store.
pub(crate) fn explained(error: OpenError, path: &Path) -> OpenError {
    // At an address each folder above costs a round trip.
    if is_address(path) {
        return error;
    }
    let leads_up = path.components().any(|part| part == Component::ParentDir);
    let place = if leads_up { located(path) } else { path.into() };
    match holder(&place) {
        Some(store) => OpenError::Inside { what: what(&place, store), path: path.into(), store: store.into() },
        None => error,
    }
}

/// Checks that a path to be written is on disk and outside every store. Stores with foreign files cannot be replaced,
/// since those are never deleted.
///
/// # Errors
/// If a folder above the path is a store, or the path is an address.
pub fn check_outside(path: &Path) -> Result<(), UnfitOutput> {
    check_on_disk(path)?;
    match holder(&located(path)) {
        Some(store) => Err(UnfitOutput::InsideStore { path: path.into(), store: store.into() }),
        None => Ok(()),
    }
}

/// Checks that a path to be written is no address.
pub(crate) fn check_on_disk(path: &Path) -> Result<(), UnfitOutput> {
    if is_address(path) { Err(UnfitOutput::Address { path: path.into() }) } else { Ok(()) }
}

/// Whether a path lies in a store of brickyard's.
pub(crate) fn is_inside(path: &Path) -> bool {
    !is_address(path) && holder(&located(path)).is_some()
}

/// Resolves links and `..` in a path that may not exist yet.
pub(crate) fn located(path: &Path) -> PathBuf {
    let Some(name) = path.file_name() else { return path.canonicalize().unwrap_or_else(|_| path.into()) };
    let folder = named(path.parent().unwrap_or(Path::new("")));
    match folder.canonicalize() {
        Ok(folder) => folder.join(name),
        // Not created yet.
        Err(_) if folder != path => located(folder).join(name),
        Err(_) => path.into(),
    }
}

/// The nearest store among the folders above a path.
fn holder(path: &Path) -> Option<&Path> {
    // The first is the path itself.
    path.ancestors().skip(1).map(named).find(|folder| is_store(folder))
}

/// A folder under an openable name: the working directory has none as the ancestor of a relative path.
pub(crate) fn named(folder: &Path) -> &Path {
    if folder.as_os_str().is_empty() { Path::new(".") } else { folder }
}

fn is_store(folder: &Path) -> bool {
    let document = folder.join("zarr.json");
    let root = Folder::open(folder).ok().and_then(|folder| read_json(&folder, &document).ok());
    root.is_some_and(|root| parse_info(&document, &root).is_ok())
}

/// A description of a path inside a store.
fn what(path: &Path, store: &Path) -> String {
    // Nothing to strip if the store is `.`, since the path does not name it.
    let inside = path.strip_prefix(store).unwrap_or(path);
    let mut names = inside.iter().map(|name| name.to_string_lossy());
    let first = names.next().unwrap_or_default();
    let is_level = first.chars().all(|c| c.is_ascii_digit()) && store.join(&*first).is_dir();
    match (path.exists(), is_level, names.next()) {
        (true, true, None) => format!("is level {first}"),
        (true, true, Some(_)) => format!("is a part of level {first}"),
        (true, false, _) => "is a part".into(),
        (false, ..) => "is no part".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::check_outside;
    use crate::store::Store;
    use crate::test_store::{TestStore, bumps};

    #[test]
    fn what_is_inside_of_a_store_names_the_store() {
        let folder = tempfile::tempdir().unwrap();
        let store = folder.path().join("scan.zarr");
        std::fs::create_dir(&store).unwrap();
        TestStore::default().write(&store, bumps);
        for (part, words) in [
            ("0", "is level 0 of"),
            ("1/", "is level 1 of"),
            ("0/zarr.json", "is a part of level 0 of"),
            ("0/.brickyard/ranges", "is a part of level 0 of"),
            ("zarr.json", "is a part of"),
            ("s0", "is no part of"),
            ("99", "is no part of"),
        ] {
            let path = store.join(part);
            let message = Store::open(&path).err().unwrap().to_string();
            let (path, store) = (path.display(), store.display());
            assert_eq!(message, format!("{path}: {words} {store}: pass {store}"));
        }
        for (name, is_outside) in [("0/a.npy", false), ("a.zarr", false), ("", true)] {
            assert_eq!(check_outside(&store.join(name)).is_ok(), is_outside, "{name}");
        }
        assert!(check_outside(&folder.path().join("a.npy")).is_ok());
        // Through a link, up again, and in a missing folder.
        std::os::unix::fs::symlink(store.join("0"), folder.path().join("link")).unwrap();
        for (name, is_outside) in [
            ("link/a.npy", false),
            ("scan.zarr/../a.npy", true),
            ("scan.zarr/0/../b/c/a.npy", false),
            ("b/c/a.npy", true),
        ] {
            assert_eq!(check_outside(&folder.path().join(name)).is_ok(), is_outside, "{name}");
        }
        let beside = Store::open(folder.path().join("scan.zar")).err().unwrap().to_string();
        assert!(!beside.contains("give"), "{beside}");
    }
}
