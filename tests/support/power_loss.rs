//! Possible contents of a disk after a power loss: a file system with synced and unsynced changes kept apart.
//!
//! Its input is the record of a run. Any write to a file since its last sync may be lost, or leave a hole where it would have
//! extended the file. Any change of names in a folder since its last sync may be lost; a rename is one change. POSIX promises no
//! more, and every file system preserves more.

use crate::Random;
use crate::faults::Call;
use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

/// Unsynced changes lost with the power.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Lost {
    /// Nothing: the process was killed, and the power is on.
    Nothing,
    /// All unsynced changes.
    Everything,
    /// Written bytes, but not the new lengths of files, which are padded with zeros. Changes of names last.
    Bytes,
    /// Changes of names. The bytes of files last.
    Names,
    /// Each change at random, and a write may leave zeros. The number is the seed.
    Some(u64),
}

type Id = usize;

enum Change {
    Write { at: usize, bytes: Vec<u8> },
    Length(usize),
}

#[derive(Default)]
struct Inode {
    is_folder: bool,
    /// The durable bytes of a file.
    bytes: Vec<u8>,
    names: BTreeMap<String, Id>,
    /// The names in a folder in the running system.
    names_now: BTreeMap<String, Id>,
    changes: Vec<Change>,
}

/// One change of names: each folder and name with its new target, `None` for nothing.
struct Naming(Vec<(Id, String, Option<Id>)>);

impl Naming {
    fn touches(&self, folders: &[Id]) -> bool {
        self.0.iter().any(|(folder, ..)| folders.contains(folder))
    }
}

/// A disk after a record of calls: synced and unsynced changes.
pub struct Disk {
    inodes: Vec<Inode>,
    /// The unsynced changes of names, in order.
    namings: Vec<Naming>,
}

/// Files and folders by path: a file has its bytes, a folder `None`.
pub type Tree = BTreeMap<PathBuf, Option<Vec<u8>>>;

const ROOT: Id = 0;

/// The flag `O_CREAT` of Linux's `open`.
const CREATE: i64 = 0o100;
/// The flag `O_TRUNC` of Linux's `open`.
const TRUNCATE: i64 = 0o1000;
/// The flag `RENAME_EXCHANGE` of Linux's `renameat2`.
const EXCHANGE: i64 = 2;
/// The number of a sync of the whole file system.
const WHOLE: i64 = 1;
/// The record's number for a link, in place of a rename's flags: a second name for the same file.
const LINK: i64 = -1;

impl Disk {
    /// Creates a disk with these files and folders, all synced.
    pub fn new(tree: &Tree) -> Self {
        let root = Inode { is_folder: true, ..Inode::default() };
        let mut disk = Self { inodes: vec![root], namings: Vec::new() };
        for (path, bytes) in tree {
            let made: PathBuf = path.parent().into_iter().flat_map(Path::components).collect();
            let mut folder = ROOT;
            for name in parts(&made) {
                folder =
                    disk.inodes[folder].names_now.get(&name).copied().unwrap_or_else(|| disk.make(folder, &name, true));
            }
            let Some(name) = path.file_name() else { continue };
            let name = name.to_string_lossy();
            if !disk.inodes[folder].names_now.contains_key(&*name) {
                let id = disk.make(folder, &name, bytes.is_none());
                disk.inodes[id].bytes = bytes.clone().unwrap_or_default();
            }
        }
        for inode in &mut disk.inodes {
            inode.names = inode.names_now.clone();
        }
        disk.namings.clear();
        disk
    }

    /// Applies a recorded call. Returns `false` if it changes nothing: it failed, or only reads.
    pub fn follow(&mut self, call: &Call) -> bool {
        if call.result < 0 {
            return false;
        }
        let length = call.number.max(0) as usize;
        match (call.name.as_str(), &call.to) {
            ("open", _) => self.open(&call.path, call.number),
            ("write", _) => self.change(&call.path, Change::Write { at: length, bytes: call.bytes.clone() }),
            ("truncate", _) => self.change(&call.path, Change::Length(length)),
            ("mkdir", _) => self.place(&call.path).map(|(folder, name)| self.make(folder, &name, true)).is_some(),
            ("unlink", _) => self.name(&call.path, None),
            ("sync", _) if call.number == WHOLE => self.sync_all(),
            ("sync", _) => self.sync(&call.path),
            ("rename", Some(to)) => self.rename(&call.path, to, call.number),
            _ => false,
        }
    }

    fn open(&mut self, path: &Path, flags: i64) -> bool {
        match self.find(path) {
            Some(_) if flags & TRUNCATE != 0 => self.change(path, Change::Length(0)),
            None if flags & CREATE != 0 => {
                let Some((folder, name)) = self.place(path) else { return false };
                self.make(folder, &name, false);
                true
            }
            _ => false,
        }
    }

    fn rename(&mut self, from: &Path, to: &Path, flags: i64) -> bool {
        let (Some(moved), Some((from_folder, from_name)), Some((to_folder, to_name))) =
            (self.find(from), self.place(from), self.place(to))
        else {
            return false;
        };
        let back = match flags {
            LINK => Some(moved),
            EXCHANGE => self.find(to),
            _ => None,
        };
        self.naming(Naming(vec![(from_folder, from_name, back), (to_folder, to_name, Some(moved))]));
        true
    }

    fn sync_all(&mut self) -> bool {
        for inode in &mut self.inodes {
            inode.bytes = inode.content(|_| Fate::Lasts);
            inode.changes.clear();
            inode.names = inode.names_now.clone();
        }
        self.namings.clear();
        true
    }

    fn sync(&mut self, path: &Path) -> bool {
        let Some(id) = self.find(path) else { return false };
        if !self.inodes[id].is_folder {
            self.inodes[id].bytes = self.inodes[id].content(|_| Fate::Lasts);
            self.inodes[id].changes.clear();
            return true;
        }
        // A rename ties the folder's changes to those of other folders, which are synced too, with their predecessors.
        let mut folders = vec![id];
        let mut lasting = vec![false; self.namings.len()];
        for (naming, lasts) in self.namings.iter().zip(&mut lasting).rev() {
            if naming.touches(&folders) {
                *lasts = true;
                folders.extend(naming.0.iter().map(|(folder, ..)| *folder));
            }
        }
        let mut lasting = lasting.into_iter();
        let (now, later) = std::mem::take(&mut self.namings).into_iter().partition(|_| lasting.next() == Some(true));
        self.namings = later;
        let now: Vec<Naming> = now;
        for (folder, name, id) in now.into_iter().flat_map(|naming| naming.0) {
            set(&mut self.inodes[folder].names, name, id);
        }
        true
    }

    /// The files and folders on the disk after the power returns.
    pub fn after_power_loss(&self, lost: Lost) -> Tree {
        let mut random = Random(if let Lost::Some(seed) = lost { seed } else { 0 });
        let mut names: Vec<BTreeMap<String, Id>> = self.inodes.iter().map(|inode| inode.names.clone()).collect();
        for naming in &self.namings {
            let lasts = match lost {
                Lost::Nothing | Lost::Bytes => true,
                Lost::Everything | Lost::Names => false,
                Lost::Some(_) => random.bits().is_multiple_of(2),
            };
            for (folder, name, id) in naming.0.iter().filter(|_| lasts) {
                set(&mut names[*folder], name.clone(), *id);
            }
        }
        let mut fate = |_: &Change| match lost {
            Lost::Nothing | Lost::Names => Fate::Lasts,
            Lost::Everything => Fate::Lost,
            Lost::Bytes => Fate::Hole,
            Lost::Some(_) => [Fate::Lasts, Fate::Lost, Fate::Hole][random.bits() as usize % 3],
        };
        let content: Vec<Vec<u8>> = self.inodes.iter().map(|inode| inode.content(&mut fate)).collect();
        let mut tree = Tree::new();
        let mut folders = vec![(PathBuf::new(), ROOT)];
        while let Some((path, folder)) = folders.pop() {
            for (name, &id) in &names[folder] {
                let path = path.join(name);
                if self.inodes[id].is_folder {
                    tree.insert(path.clone(), None);
                    folders.push((path, id));
                } else {
                    tree.insert(path, Some(content[id].clone()));
                }
            }
        }
        tree
    }

    fn make(&mut self, folder: Id, name: &str, is_folder: bool) -> Id {
        self.inodes.push(Inode { is_folder, ..Inode::default() });
        let id = self.inodes.len() - 1;
        self.naming(Naming(vec![(folder, name.to_owned(), Some(id))]));
        id
    }

    fn name(&mut self, path: &Path, id: Option<Id>) -> bool {
        let Some((folder, name)) = self.place(path).filter(|_| self.find(path).is_some()) else { return false };
        self.naming(Naming(vec![(folder, name, id)]));
        true
    }

    fn naming(&mut self, naming: Naming) {
        for (folder, name, id) in &naming.0 {
            set(&mut self.inodes[*folder].names_now, name.clone(), *id);
        }
        self.namings.push(naming);
    }

    fn change(&mut self, path: &Path, change: Change) -> bool {
        let Some(id) = self.find(path) else { return false };
        self.inodes[id].changes.push(change);
        true
    }

    /// The folder of a path's last name, and that name; `None` if there is no such folder.
    fn place(&self, path: &Path) -> Option<(Id, String)> {
        let folder = self.find(path.parent()?)?;
        Some((folder, path.file_name()?.to_string_lossy().into_owned()))
    }

    fn find(&self, path: &Path) -> Option<Id> {
        parts(path).try_fold(ROOT, |folder, name| self.inodes[folder].names_now.get(&name).copied())
    }
}

#[derive(Clone, Copy, PartialEq)]
enum Fate {
    Lasts,
    /// The change never happened.
    Lost,
    /// The bytes of the change are lost, but not the file's new length, padded with zeros.
    Hole,
}

impl Inode {
    fn content(&self, mut fate: impl FnMut(&Change) -> Fate) -> Vec<u8> {
        let mut content = self.bytes.clone();
        for change in &self.changes {
            let fate = fate(change);
            match change {
                _ if fate == Fate::Lost => {}
                Change::Length(length) => content.resize(*length, 0),
                Change::Write { at, bytes } => {
                    content.resize(content.len().max(at + bytes.len()), 0);
                    if fate == Fate::Lasts {
                        content[*at..at + bytes.len()].copy_from_slice(bytes);
                    }
                }
            }
        }
        content
    }
}

fn set(names: &mut BTreeMap<String, Id>, name: String, id: Option<Id>) {
    match id {
        Some(id) => drop(names.insert(name, id)),
        None => drop(names.remove(&name)),
    }
}

fn parts(path: &Path) -> impl Iterator<Item = String> {
    path.components().filter_map(|part| match part {
        Component::Normal(name) => Some(name.to_string_lossy().into_owned()),
        _ => None,
    })
}

/// Reads a folder with all its content, keyed by relative path.
///
/// # Panics
/// If a file or folder cannot be read.
pub fn read_tree(folder: &Path) -> Tree {
    let mut tree = Tree::new();
    let mut folders = vec![PathBuf::new()];
    while let Some(next) = folders.pop() {
        let entries = std::fs::read_dir(folder.join(&next)).expect("the folder can be listed");
        for entry in entries {
            let entry = entry.expect("the folder can be listed");
            let path = next.join(entry.file_name());
            if entry.path().is_dir() {
                folders.push(path.clone());
                tree.insert(path, None);
            } else {
                tree.insert(path, Some(std::fs::read(entry.path()).expect("the file can be read")));
            }
        }
    }
    tree
}

/// Makes a folder hold exactly these files and folders; removes others.
///
/// # Panics
/// If a file or folder cannot be removed or written.
pub fn write_tree(folder: &Path, tree: &Tree) {
    if folder.exists() {
        std::fs::remove_dir_all(folder).expect("the folder is ours");
    }
    std::fs::create_dir_all(folder).expect("the folder is ours");
    // A folder comes before its content.
    for (path, bytes) in tree {
        let path = folder.join(path);
        match bytes {
            None => std::fs::create_dir_all(path).expect("the folder is ours"),
            Some(bytes) => std::fs::write(path, bytes).expect("the folder is ours"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn call(name: &str, path: &str, to: Option<&str>, number: i64, bytes: &str) -> Call {
        let (path, to) = (path.into(), to.map(Into::into));
        Call { name: name.into(), result: 0, number, path, to, bytes: bytes.into() }
    }

    fn shown(tree: &Tree) -> Vec<String> {
        tree.iter().map(|(p, b)| format!("{} {:?}", p.display(), b.as_deref().map(String::from_utf8_lossy))).collect()
    }

    #[test]
    fn only_what_was_synced_is_sure_to_last() {
        let mut disk = Disk::new(&Tree::from([("old".into(), Some(b"1".to_vec()))]));
        let calls = [
            call("mkdir", "d", None, 0, ""),
            call("open", "d/a.tmp", None, CREATE, ""),
            call("write", "d/a.tmp", None, 0, "abc"),
            call("sync", "d/a.tmp", None, 0, ""),
            call("rename", "d/a.tmp", Some("d/a"), 0, ""),
            call("write", "d/a", None, 3, "de"),
        ];
        assert!(calls.iter().all(|call| disk.follow(call)));
        let after = |disk: &Disk, lost| shown(&disk.after_power_loss(lost));
        assert_eq!(after(&disk, Lost::Everything), ["old Some(\"1\")"]);
        assert_eq!(after(&disk, Lost::Nothing), ["d None", "d/a Some(\"abcde\")", "old Some(\"1\")"]);
        assert_eq!(after(&disk, Lost::Bytes), ["d None", "d/a Some(\"abc\\0\\0\")", "old Some(\"1\")"]);
        disk.follow(&call("sync", "", None, 0, ""));
        assert_eq!(after(&disk, Lost::Everything), ["d None", "old Some(\"1\")"]);
        disk.follow(&call("sync", "d", None, 0, ""));
        assert_eq!(after(&disk, Lost::Everything), ["d None", "d/a Some(\"abc\")", "old Some(\"1\")"]);
        disk.follow(&call("rename", "d", Some("old"), EXCHANGE, ""));
        assert_eq!(after(&disk, Lost::Nothing), ["d Some(\"1\")", "old None", "old/a Some(\"abcde\")"]);
        disk.follow(&call("unlink", "d", None, 0, ""));
        assert_eq!(after(&disk, Lost::Nothing), ["old None", "old/a Some(\"abcde\")"]);
        assert_eq!(after(&disk, Lost::Everything), ["d None", "d/a Some(\"abc\")", "old Some(\"1\")"]);
    }
}
