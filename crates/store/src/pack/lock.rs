//! The lock of a directory that is packed into: of any number of packs, in one process, on one machine or on several, one
//! has it, and the others learn who.
//!
//! It is a file in the directory, locked whole, that names its holder once that one has decided to pack. The lock is `flock`'s,
//! which the kernel gives back when a process ends, however it ends; on NFS, Linux makes it a lock of the server's, as the file is open for
//! writing. Where the kernel cannot lock, packing is refused.
//!
//! The file goes with the lock, so one may get the lock of a file that has lost its name meanwhile, while another file has
//! the name. Such a file is known by its number, and by a mark: clients of NFS remember names for a while, but read a file's
//! bytes anew once they have its lock.

use crate::data_file::{open_file, read_at_most};
use crate::layout::LOCK_NAME;
use crate::pack::PackError;
use crate::pack::disk::{Disk, DiskError};
use rustix::fs::OFlags;
use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::os::unix::fs::{FileExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// How long to wait for one who has the lock to say that it packs, or to leave.
const PATIENCE: Duration = Duration::from_secs(5);
const PAUSE: Duration = Duration::from_millis(20);

/// What stands in a lock file whose name is gone.
const LEFT: &[u8] = b"left";

/// The process that packs into a directory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Holder {
    /// The id of the process.
    pub pid: u32,
    /// The name of the machine that the process runs on.
    pub host: String,
}

impl std::fmt::Display for Holder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "process {} on {}", self.pid, self.host)
    }
}

impl Holder {
    fn myself() -> Self {
        Self { pid: std::process::id(), host: host() }
    }

    fn read(path: &Path) -> Option<Self> {
        let text = String::from_utf8(read_at_most(open_file(path), 1 << 10).ok()?).ok()?;
        let (pid, host) = text.strip_suffix('\n')?.split_once(' ')?;
        Some(Self { pid: pid.parse().ok()?, host: host.into() })
    }

    /// Whether it may still be there. What a killed process wrote stays until the next one has the lock.
    fn may_live(&self) -> bool {
        let pid = i32::try_from(self.pid).ok().and_then(rustix::process::Pid::from_raw);
        let gone = |pid| rustix::process::test_kill_process(pid) == Err(rustix::io::Errno::SRCH);
        self.host != host() || !pid.is_some_and(gone)
    }
}

fn host() -> String {
    rustix::system::uname().nodename().to_string_lossy().into_owned()
}

/// A directory's lock, which is given back when it is dropped.
pub(crate) struct DirLock {
    dir: PathBuf,
    file: File,
    /// The directory was made for a lock, and goes with it while it is empty.
    made_dir: bool,
}

enum Attempt {
    Taken(DirLock),
    /// Someone has it.
    Held(Option<Holder>),
    /// Something went away meanwhile: try again.
    Gone,
}

impl DirLock {
    /// Takes the lock of a directory, which is made if it is not there.
    ///
    /// # Errors
    /// If another pack has the lock, the file system does not lock files, or the lock file cannot be made: where nothing may be written, for one.
    pub(crate) fn take(disk: &Disk, dir: &Path) -> Result<Self, PackError> {
        let (started, mut seen) = (Instant::now(), None);
        loop {
            let holder = match Self::attempt(disk, dir)? {
                Attempt::Taken(lock) => return Ok(lock),
                Attempt::Held(holder) => holder,
                Attempt::Gone => None,
            };
            let is_sure = holder.as_ref().is_some_and(Holder::may_live) && holder == seen;
            if is_sure || started.elapsed() > PATIENCE {
                return Err(PackError::Busy { store: dir.into(), holder });
            }
            seen = holder;
            std::thread::sleep(PAUSE);
        }
    }

    fn attempt(disk: &Disk, dir: &Path) -> Result<Attempt, PackError> {
        let made_dir = !dir.exists();
        if made_dir {
            disk.create_dir_all(dir)?;
        }
        let path = dir.join(LOCK_NAME);
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false);
        // A link would lead to somebody's file, which would be emptied.
        let file = match options.custom_flags(OFlags::NOFOLLOW.bits() as i32).open(&path) {
            Ok(file) => file,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Attempt::Gone),
            Err(error)
                if matches!(error.kind(), io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem) =>
            {
                return Err(PackError::ReadOnly { path: dir.into(), error });
            }
            Err(error) => return Err(PackError::Io { path, error }),
        };
        // What another name of the same file leads to would be overwritten.
        if file.metadata().is_ok_and(|found| found.nlink() > 1) {
            let error = io::Error::other("has other names, as hard links have: delete this one, which is a lock's");
            return Err(PackError::Io { path, error });
        }
        disk.meanwhile("the lock file is open");
        match file.try_lock() {
            Ok(()) if !is_named(&file, &path) || is_left(&file) => return Ok(Attempt::Gone),
            Ok(()) => {}
            // Opened again to be read: a client of NFS then asks the server.
            Err(TryLockError::WouldBlock) => return Ok(Attempt::Held(Holder::read(&path))),
            Err(TryLockError::Error(error)) => {
                // Nobody can have a lock here: what was made for it goes.
                let _ = std::fs::remove_file(&path);
                let _ = if made_dir { std::fs::remove_dir(dir) } else { Ok(()) };
                return Err(PackError::NoLock { path: dir.into(), error });
            }
        }
        file.set_len(0).map_err(|error| PackError::Io { path, error })?;
        Ok(Attempt::Taken(Self { dir: dir.into(), file, made_dir }))
    }

    /// Writes this process's name into the lock file, for others that ask for the lock.
    pub(crate) fn declare(&self, disk: &Disk) -> Result<(), DiskError> {
        let Holder { pid, host } = Holder::myself();
        let path = self.dir.join(LOCK_NAME);
        match self.file.write_all_at(format!("{pid} {host}\n").as_bytes(), 0) {
            Ok(()) => disk.sync(&path, &self.file),
            Err(error) => Err(DiskError { path, error }),
        }
    }

    /// Makes the lock remove its directory, if it is empty, when it is dropped: for a directory that nobody but packs
    /// makes. Of several packs that come together one makes it, and another one may be the last to leave.
    pub(crate) fn takes_dir_along(&mut self) {
        self.made_dir = true;
    }

    /// Looks for the lock's directory under these names, one of which it may have got.
    pub(crate) fn moved_to_one_of(&mut self, names: &[&Path]) {
        if let Some(dir) = names.iter().find(|dir| is_named(&self.file, &dir.join(LOCK_NAME))) {
            self.moved(dir);
        }
    }

    /// Tells the lock that its directory is called `dir` now, and is to stay when the lock is dropped.
    pub(crate) fn moved(&mut self, dir: &Path) {
        self.dir = dir.into();
        self.made_dir = false;
    }
}

impl Drop for DirLock {
    fn drop(&mut self) {
        let path = self.dir.join(LOCK_NAME);
        // First the name and then the mark: a marked file is never found under its name. What fails leaves a file that
        // nobody has locked.
        if is_named(&self.file, &path) && std::fs::remove_file(&path).is_ok() {
            let _ = self.file.set_len(0).and_then(|()| self.file.write_all_at(LEFT, 0));
        }
        if self.made_dir {
            let _ = std::fs::remove_dir(&self.dir);
        }
    }
}

/// Whether this is the file that has the name.
fn is_named(file: &File, path: &Path) -> bool {
    let number = |file: std::fs::Metadata| (file.dev(), file.ino());
    let named = std::fs::symlink_metadata(path).map(number).ok();
    named.is_some() && named == file.metadata().map(number).ok()
}

fn is_left(file: &File) -> bool {
    let mut found = [0; LEFT.len()];
    file.read_exact_at(&mut found, 0).is_ok() && found == LEFT
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_has_another_name_is_no_lock() {
        let dir = tempfile::tempdir().unwrap();
        let (store, other) = (dir.path().join("s.zarr"), dir.path().join("other"));
        std::fs::create_dir(&store).unwrap();
        std::fs::write(&other, "precious").unwrap();
        std::fs::hard_link(&other, store.join(LOCK_NAME)).unwrap();
        let message = DirLock::take(&Disk::default(), &store).err().unwrap().to_string();
        assert!(message.contains(LOCK_NAME) && message.contains("hard links"), "{message}");
        assert_eq!(std::fs::read(&other).unwrap(), b"precious");
    }
}
