//! File-system changes of packing, except the lock's (`lock.rs`): one place for paths in errors, syncs, tests' injected
//! failures, and the rule that nothing outside a store changes.

use crate::folder::Folder;
use crate::inside::named;
#[cfg(test)]
use crate::pack::tests::trial::Trial;
use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

/// Whether other machines may use a directory without seeing its lock: true on FUSE, 9P, AFS and Coda. The servers of
/// NFS and SMB keep locks.
pub(crate) fn may_be_local(dir: &Path) -> bool {
    // FUSE (sshfs and others), 9P, AFS, Coda.
    const KINDS: [u64; 4] = [0x6573_5546, 0x0102_1997, 0x5346_414f, 0x7375_7245];
    cfg!(target_os = "linux") && rustix::fs::statfs(dir).is_ok_and(|fs| KINDS.contains(&(fs.f_type as u64)))
}

/// A directory itself, or its nearest ancestor that exists.
pub(crate) fn nearest(dir: &Path) -> &Path {
    dir.ancestors().map(named).find(|dir| dir.exists()).unwrap_or(dir)
}

/// Missing directories down to `dir`, deepest first.
pub(crate) fn missing(dir: &Path) -> Vec<PathBuf> {
    dir.ancestors().take_while(|dir| !dir.as_os_str().is_empty() && !dir.exists()).map(Path::to_path_buf).collect()
}

/// Free bytes for a directory, which may not exist yet; `None` if unknown.
pub(crate) fn free_bytes(dir: &Path) -> Option<u64> {
    let disk = rustix::fs::statvfs(nearest(dir)).ok()?;
    Some(disk.f_bavail.saturating_mul(disk.f_frsize))
}

/// A failed change to the file system, and its path.
#[derive(Debug)]
pub(crate) struct DiskError {
    pub(crate) path: PathBuf,
    pub(crate) error: io::Error,
}

type Result<T> = std::result::Result<T, DiskError>;

/// The file system as packing sees it.
#[derive(Default)]
pub(crate) struct Disk {
    pub(crate) home: OnceLock<Home>,
    /// The store's folder, if open: receives all changes inside its path, wherever the path leads.
    pub(crate) open: OnceLock<Arc<Folder>>,
    /// Observations and faults of a test.
    #[cfg(test)]
    pub(crate) trial: Trial,
}

/// The location of a store.
pub(crate) struct Home {
    /// The folder around the store. Below it no change follows a symbolic link.
    folder: PathBuf,
    /// Whether one call syncs the whole file system.
    syncs_as_one: bool,
}

impl Disk {
    /// Sets the present or future location of the store. Changes are then refused where a symbolic link in the store,
    /// or beside it under one of its names, would redirect them.
    pub(crate) fn work_at(&self, store: &Path) {
        let folder = store.parent().unwrap_or(Path::new(""));
        let made = folder.ancestors().map(named).find(|folder| folder.exists());
        // A server's own disks learn of single files at most.
        let syncs_as_one = tells_of_lost_writes() && made.is_some_and(|folder| !may_be_local(folder));
        #[cfg(test)]
        let syncs_as_one = syncs_as_one && !self.trial.syncs_each;
        let _ = self.home.set(Home { folder: folder.into(), syncs_as_one });
    }

    /// Whether [`Disk::sync_parts`] syncs files together, rather than each write.
    pub(crate) fn syncs_as_one(&self) -> bool {
        self.home.get().is_some_and(|home| home.syncs_as_one)
    }

    /// Redirects all further changes inside a store's path to this folder.
    pub(crate) fn work_in(&self, folder: Arc<Folder>) {
        let _ = self.open.set(folder);
    }

    /// The effective path of a change.
    fn at(&self, path: &Path) -> PathBuf {
        self.open.get().map_or_else(|| path.into(), |folder| folder.through(path))
    }

    fn check_links(&self, path: &Path) -> io::Result<()> {
        // The open folder itself is no link.
        let above = self.open.get().map(|folder| folder.path()).filter(|store| path.starts_with(store));
        let Some(mut at) = above.or(self.home.get().map(|home| &*home.folder)).map(Path::to_path_buf) else {
            return Ok(());
        };
        for name in path.strip_prefix(&at).unwrap_or(Path::new("")) {
            at.push(name);
            match std::fs::symlink_metadata(self.at(&at)) {
                Ok(found) if found.is_symlink() => {
                    let what =
                        "is a symbolic link, and nothing is written or deleted through links; move it out of the store";
                    return Err(io::Error::other(format!("{} {what}", at.display())));
                }
                Ok(_) => {}
                Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(()),
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    /// Marks a moment of possible interference by another pack. In tests, runs its registered action, once.
    pub(crate) fn meanwhile(&self, _moment: &'static str) {
        #[cfg(test)]
        self.trial.meanwhile(_moment);
    }

    /// Before a change: tests record it, and may make it fail.
    fn step(&self, _what: &'static str, _path: &Path) -> io::Result<()> {
        #[cfg(test)]
        self.trial.step(_what, _path)?;
        Ok(())
    }

    fn run<T>(&self, what: &'static str, path: &Path, change: impl FnOnce() -> io::Result<T>) -> Result<T> {
        self.step(what, path).and_then(|()| change()).map_err(|error| DiskError { path: path.into(), error })
    }

    /// Makes a change at a path free of links. `change` receives the effective path.
    fn run_at<T>(&self, what: &'static str, path: &Path, change: impl FnOnce(&Path) -> io::Result<T>) -> Result<T> {
        self.run(what, path, || self.check_links(path).and_then(|()| change(&self.at(path))))
    }

    pub(crate) fn create_dir_all(&self, path: &Path) -> Result<()> {
        self.run_at("create_dir_all", path, |at| std::fs::create_dir_all(at))
    }

    /// Creates a file's folder if needed.
    pub(crate) fn create_parent(&self, path: &Path) -> Result<()> {
        let missing = path.parent().filter(|parent| !self.at(parent).exists());
        missing.map_or(Ok(()), |parent| self.create_dir_all(parent))
    }

    /// Creates an empty file, replacing an existing one, for writing and reading. Other names of the old file keep its
    /// content.
    pub(crate) fn create(&self, path: &Path) -> Result<File> {
        let new = |at: &Path| File::options().read(true).write(true).create_new(true).open(at);
        self.run_at("create", path, |at| match new(at) {
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {
                std::fs::remove_file(at)?;
                new(at)
            }
            made => made,
        })
    }

    /// Opens a file for appending and reading.
    pub(crate) fn reopen(&self, path: &Path) -> Result<File> {
        self.run_at("reopen", path, |at| File::options().read(true).append(true).open(at))
    }

    pub(crate) fn append(&self, path: &Path, file: &mut File, bytes: &[u8]) -> Result<()> {
        #[cfg(test)]
        self.trial.tear(file, bytes);
        self.run("append", path, || file.write_all(bytes))
    }

    pub(crate) fn sync(&self, path: &Path, file: &File) -> Result<()> {
        // Tests kill processes, not power: they count syncs without waiting for the disk.
        self.run("sync", path, || if cfg!(test) { Ok(()) } else { file.sync_data() })
    }

    /// Syncs a directory, so its renames and new files survive a crash.
    pub(crate) fn sync_dir(&self, path: &Path) -> Result<()> {
        self.run("sync_dir", path, || if cfg!(test) { Ok(()) } else { File::open(self.at(path))?.sync_all() })
    }

    pub(crate) fn rename(&self, from: &Path, to: &Path) -> Result<()> {
        self.run_at("rename", to, |at| self.check_links(from).and_then(|()| std::fs::rename(self.at(from), at)))
    }

    /// Gives a file a second name; where the file system cannot, makes a copy that lasts.
    pub(crate) fn link(&self, from: &Path, to: &Path) -> Result<()> {
        use io::ErrorKind::{CrossesDevices, PermissionDenied, TooManyLinks, Unsupported};
        self.run_at("link", to, |at| {
            self.check_links(from)?;
            match std::fs::hard_link(self.at(from), at) {
                Err(error)
                    if matches!(error.kind(), CrossesDevices | PermissionDenied | TooManyLinks | Unsupported) =>
                {
                    std::fs::copy(self.at(from), at)?;
                    File::open(at)?.sync_all()
                }
                linked => linked,
            }
        })
    }

    /// Renames a directory to a free name, or over an empty directory. Waits up to half a second for others to remove
    /// recent content.
    pub(crate) fn rename_dir(&self, from: &Path, to: &Path) -> Result<()> {
        self.run_at("rename_dir", to, |at| {
            self.check_links(from)?;
            patiently(|| std::fs::rename(self.at(from), at))
        })
    }

    /// Exchanges the names of two directories in one step. Returns `false` if the file system cannot, or a name is
    /// free.
    pub(crate) fn exchange(&self, a: &Path, b: &Path) -> Result<bool> {
        use rustix::fs::{CWD, RenameFlags, renameat_with};
        use rustix::io::Errno;
        #[cfg(test)]
        if self.trial.cannot_exchange {
            return Ok(false);
        }
        self.run_at("exchange", b, |b| match renameat_with(CWD, self.at(a), CWD, b, RenameFlags::EXCHANGE) {
            Ok(()) => Ok(true),
            Err(Errno::INVAL | Errno::NOSYS | Errno::OPNOTSUPP | Errno::NOENT) => Ok(false),
            Err(error) => Err(error.into()),
        })
    }

    pub(crate) fn remove_file(&self, path: &Path) -> Result<()> {
        self.run_at("remove_file", path, |at| std::fs::remove_file(at))
    }

    /// Removes an empty directory. Waits up to half a second for others to remove brief content (a lock).
    pub(crate) fn remove_dir(&self, path: &Path) -> Result<()> {
        self.run_at("remove_dir", path, |at| patiently(|| std::fs::remove_dir(at)))
    }

    /// Writes a small file. Its name holds the old content, the new content, or no file, never a part.
    pub(crate) fn write(&self, path: &Path, bytes: &[u8]) -> Result<()> {
        let written = self.fill(path, bytes).and_then(|(temporary, file)| self.sync(&temporary, &file));
        written.inspect_err(|_| {
            // On a full disk nothing half-written stays.
            let _ = self.remove_file(&temporary(path));
        })?;
        self.name(path)
    }

    /// Writes a small file under its temporary name, durable after [`Disk::sync_parts`].
    pub(crate) fn prepare(&self, path: &Path, bytes: &[u8]) -> Result<()> {
        let (temporary, file) = self.fill(path, bytes)?;
        if self.syncs_as_one() { Ok(()) } else { self.sync(&temporary, &file) }
    }

    /// Writes a file under its temporary name; returns name and file.
    fn fill(&self, path: &Path, bytes: &[u8]) -> Result<(PathBuf, File)> {
        let temporary = temporary(path);
        let mut file = self.create(&temporary)?;
        self.append(&temporary, &mut file, bytes)?;
        Ok((temporary, file))
    }

    /// Renames a prepared file to its final name.
    pub(crate) fn name(&self, path: &Path) -> Result<()> {
        self.rename(&temporary(path), path)
    }

    /// Writes a small file nobody reads before [`Disk::sync_parts`], creating its folder if needed: until then a power
    /// failure may truncate it.
    pub(crate) fn write_early(&self, path: &Path, bytes: &[u8]) -> Result<()> {
        self.create_parent(path)?;
        self.prepare(path, bytes)?;
        self.name(path)
    }

    /// Makes everything written in a store durable: by one call with a single wait for the disk if the file system can,
    /// otherwise by syncing these folders and trees.
    pub(crate) fn sync_parts<'a>(&self, store: &Path, parts: impl IntoIterator<Item = Part<'a>>) -> Result<()> {
        if self.syncs_as_one() {
            return self.run("sync_all", store, || if cfg!(test) { Ok(()) } else { sync_file_system(&self.at(store)) });
        }
        parts.into_iter().try_for_each(|part| match part {
            Part::Tree(folder) => self.sync_tree(folder),
            Part::Folder(folder) => self.sync_dir(folder),
        })
    }

    /// Syncs a folder and all below it, so the names of all files survive a crash.
    fn sync_tree(&self, folder: &Path) -> Result<()> {
        let io = |error| DiskError { path: folder.into(), error };
        for entry in std::fs::read_dir(self.at(folder)).map_err(io)? {
            let entry = entry.map_err(io)?;
            if entry.file_type().map_err(io)?.is_dir() {
                self.sync_tree(&folder.join(entry.file_name()))?;
            }
        }
        self.sync_dir(folder)
    }
}

/// A part of a store to be made durable.
pub(crate) enum Part<'a> {
    /// A folder, with everything below it.
    Tree(&'a Path),
    /// The names in a folder.
    Folder(&'a Path),
}

/// Whether syncing a file system reports failed writes: on Linux since 5.8.
fn tells_of_lost_writes() -> bool {
    let system = rustix::system::uname();
    let release = system.release().to_string_lossy();
    let mut numbers = release.split(|c: char| !c.is_ascii_digit()).map(|number| number.parse::<u32>().unwrap_or(0));
    cfg!(target_os = "linux") && (numbers.next(), numbers.next()) >= (Some(5), Some(8))
}

/// Syncs the file system of a folder: everybody's writes, but mostly the pack's.
#[cfg(target_os = "linux")]
fn sync_file_system(folder: &Path) -> io::Result<()> {
    Ok(rustix::fs::syncfs(File::open(folder)?)?)
}

#[cfg(not(target_os = "linux"))]
fn sync_file_system(_: &Path) -> io::Result<()> {
    Err(io::ErrorKind::Unsupported.into())
}

/// Retries for half a second while a directory is not empty.
fn patiently(mut change: impl FnMut() -> io::Result<()>) -> io::Result<()> {
    for _ in 0..50 {
        match change() {
            Err(error) if error.kind() == io::ErrorKind::DirectoryNotEmpty => {}
            other => return other,
        }
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    change()
}

/// The name of a file until it is complete.
pub(crate) fn temporary(path: &Path) -> PathBuf {
    with_suffix(path, ".tmp")
}

pub(crate) fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    name.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_made_anew_and_no_other_name_of_the_old_one_changes() {
        let dir = tempfile::tempdir().unwrap();
        let [path, other] = ["a", "other"].map(|name| dir.path().join(name));
        std::fs::write(&other, "precious").unwrap();
        std::fs::hard_link(&other, &path).unwrap();
        Disk::default().write(&path, b"new").unwrap();
        std::fs::hard_link(&other, temporary(&path)).unwrap();
        Disk::default().write(&path, b"newer").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"newer");
        assert_eq!(std::fs::read(&other).unwrap(), b"precious");
    }
}
