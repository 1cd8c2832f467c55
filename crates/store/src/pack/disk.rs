//! Every change that packing makes to the file system goes through here, but for the lock's (`lock.rs`): one place for paths
//! in errors, syncs, and tests' injected failures.

use std::fs::File;
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// A change to the file system that failed, and its path.
#[derive(Debug)]
pub(crate) struct DiskError {
    pub(crate) path: PathBuf,
    pub(crate) error: io::Error,
}

type Result<T> = std::result::Result<T, DiskError>;

/// The file system as packing sees it.
#[derive(Default)]
pub(crate) struct Disk {
    /// Number of changes after which all further ones fail, as on a full disk or after a crash.
    #[cfg(test)]
    pub(crate) fuse: Option<std::sync::atomic::AtomicI64>,
    /// Whether a change panics where the fuse would make it fail.
    #[cfg(test)]
    pub(crate) panics: bool,
    /// The changes that were made, in order, each with its path.
    #[cfg(test)]
    pub(crate) log: std::sync::Mutex<Vec<(&'static str, PathBuf)>>,
    /// What other packs do, each with the moment at which they do it.
    #[cfg(test)]
    pub(crate) meanwhile: std::sync::Mutex<Vec<(&'static str, Meanwhile)>>,
    /// Whether names cannot be exchanged, as on NFS.
    #[cfg(test)]
    pub(crate) cannot_exchange: bool,
}

#[cfg(test)]
pub(crate) type Meanwhile = Box<dyn FnOnce() + Send>;

impl Disk {
    /// Marks a moment at which another pack may come between. In tests, what is registered for that moment runs, once.
    #[cfg(test)]
    pub(crate) fn meanwhile(&self, moment: &'static str) {
        let mut waiting = self.meanwhile.lock().unwrap();
        let now = waiting.iter().position(|(at, _)| *at == moment).map(|i| waiting.remove(i));
        drop(waiting);
        now.into_iter().for_each(|(_, others)| others());
    }

    #[cfg(not(test))]
    pub(crate) fn meanwhile(&self, _moment: &'static str) {}

    /// Before a change: tests note it, and let it fail.
    #[cfg(test)]
    fn step(&self, what: &'static str, path: &Path) -> io::Result<()> {
        if let Some(fuse) = &self.fuse
            && fuse.fetch_sub(1, std::sync::atomic::Ordering::SeqCst) <= 0
        {
            assert!(!self.panics, "a thread that changes files");
            return Err(io::ErrorKind::StorageFull.into());
        }
        self.log.lock().unwrap().push((what, path.into()));
        Ok(())
    }

    #[cfg(not(test))]
    fn step(&self, _what: &'static str, _path: &Path) -> io::Result<()> {
        Ok(())
    }

    fn run<T>(&self, what: &'static str, path: &Path, change: impl FnOnce() -> io::Result<T>) -> Result<T> {
        self.step(what, path).and_then(|()| change()).map_err(|error| DiskError { path: path.into(), error })
    }

    pub(crate) fn create_dir_all(&self, path: &Path) -> Result<()> {
        self.run("create_dir_all", path, || std::fs::create_dir_all(path))
    }

    /// Creates an empty file, or empties the one that is there, and opens it for writing and reading.
    pub(crate) fn create(&self, path: &Path) -> Result<File> {
        self.run("create", path, || File::options().read(true).write(true).create(true).truncate(true).open(path))
    }

    /// Opens a file to append to what is there, and to read it.
    pub(crate) fn reopen(&self, path: &Path) -> Result<File> {
        self.run("reopen", path, || File::options().read(true).append(true).open(path))
    }

    pub(crate) fn append(&self, path: &Path, file: &mut File, bytes: &[u8]) -> Result<()> {
        #[cfg(test)]
        if let Some(fuse) = &self.fuse
            && fuse.load(std::sync::atomic::Ordering::SeqCst) == 0
        {
            // The write that hits the end of the disk is torn.
            let _ = file.write_all(&bytes[..bytes.len() / 2]);
        }
        self.run("append", path, || file.write_all(bytes))
    }

    pub(crate) fn sync(&self, path: &Path, file: &File) -> Result<()> {
        // Tests end processes, not power: they count syncs without waiting for the disk.
        self.run("sync", path, || if cfg!(test) { Ok(()) } else { file.sync_data() })
    }

    /// Syncs a directory, so that renames and new files in it survive a crash.
    pub(crate) fn sync_dir(&self, path: &Path) -> Result<()> {
        self.run("sync_dir", path, || if cfg!(test) { Ok(()) } else { File::open(path)?.sync_all() })
    }

    pub(crate) fn rename(&self, from: &Path, to: &Path) -> Result<()> {
        self.run("rename", to, || std::fs::rename(from, to))
    }

    /// Renames a directory to a free name, or over an empty directory. If others have just put something into that
    /// directory, waits up to half a second for them to remove it.
    pub(crate) fn rename_dir(&self, from: &Path, to: &Path) -> Result<()> {
        self.run("rename_dir", to, || patiently(|| std::fs::rename(from, to)))
    }

    /// Exchanges the names of two directories in one step. Returns false where the file system cannot, or where one of
    /// the names is free.
    pub(crate) fn exchange(&self, a: &Path, b: &Path) -> Result<bool> {
        use rustix::fs::{CWD, RenameFlags, renameat_with};
        use rustix::io::Errno;
        #[cfg(test)]
        if self.cannot_exchange {
            return Ok(false);
        }
        self.run("exchange", b, || match renameat_with(CWD, a, CWD, b, RenameFlags::EXCHANGE) {
            Ok(()) => Ok(true),
            Err(Errno::INVAL | Errno::NOSYS | Errno::OPNOTSUPP | Errno::NOENT) => Ok(false),
            Err(error) => Err(error.into()),
        })
    }

    pub(crate) fn remove_file(&self, path: &Path) -> Result<()> {
        self.run("remove_file", path, || std::fs::remove_file(path))
    }

    /// Removes an empty directory. If others have put something there for a moment (a lock), waits up to half a second
    /// for them to remove it.
    pub(crate) fn remove_dir(&self, path: &Path) -> Result<()> {
        self.run("remove_dir", path, || patiently(|| std::fs::remove_dir(path)))
    }

    /// Writes a whole small file. Under its name there is the old content, the new content, or no file, but never a
    /// part.
    pub(crate) fn write(&self, path: &Path, bytes: &[u8]) -> Result<()> {
        let temporary = temporary(path);
        let mut file = self.create(&temporary)?;
        self.append(&temporary, &mut file, bytes)?;
        self.sync(&temporary, &file)?;
        self.rename(&temporary, path)
    }

    /// Writes a whole small file in a folder that may not be there yet.
    pub(crate) fn write_with_parents(&self, path: &Path, bytes: &[u8]) -> Result<()> {
        let missing = path.parent().filter(|parent| !parent.exists());
        missing.map_or(Ok(()), |parent| self.create_dir_all(parent))?;
        self.write(path, bytes)
    }
}

/// Tries for half a second as long as a directory is not empty.
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

/// The name under which a file is written until it is whole.
pub(crate) fn temporary(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".tmp");
    name.into()
}
