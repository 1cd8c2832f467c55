//! The lock of a pack directory: of any number of packs, in one process, on one machine or on several, one holds it,
//! and the others learn the holder.
//!
//! It is a file in the directory, locked as a whole; it names the holder once the latter decides to pack. The lock is
//! `flock`'s, released by the kernel however a process ends; on NFS, Linux makes it a server lock, as the file is open
//! for writing. If the kernel cannot lock, packing is refused.
//!
//! The file goes with the lock, so a process may lock a file that has lost its name to another. Such a file is
//! recognized by its inode number, and by a mark: NFS clients cache names for a while, but reread a file's bytes once
//! they have its lock.

use crate::data_file::{open_file, read_at_most};
use crate::layout::LOCK_NAME;
use crate::pack::PackError;
use crate::pack::disk::{Disk, DiskError, missing};
use rustix::fs::OFlags;
use std::fs::{File, OpenOptions, TryLockError};
use std::io;
use std::os::unix::fs::{FileExt, MetadataExt, OpenOptionsExt};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// Longest wait for a lock holder to declare itself or leave.
const PATIENCE: Duration = Duration::from_secs(5);
const PAUSE: Duration = Duration::from_millis(20);

/// Content of a lock file without a name.
const LEFT: &[u8] = b"left";

/// The process packing into a directory.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Holder {
    /// The id of the process.
    pub pid: u32,
    /// The name of the process's machine.
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

    /// Whether it may still exist. A killed process's entry stays until the next lock.
    fn may_live(&self) -> bool {
        let pid = i32::try_from(self.pid).ok().and_then(rustix::process::Pid::from_raw);
        let gone = |pid| rustix::process::test_kill_process(pid) == Err(rustix::io::Errno::SRCH);
        self.host != host() || !pid.is_some_and(gone)
    }
}

fn host() -> String {
    rustix::system::uname().nodename().to_string_lossy().into_owned()
}

/// The process packing into a directory; `None` if there is none, or it is unknown. Changes nothing.
pub(crate) fn holder_of(dir: &Path) -> Option<Holder> {
    let path = dir.join(LOCK_NAME);
    let holder = Holder::read(&path).filter(Holder::may_live)?;
    // Given back at once: a pack that starts meanwhile tries again.
    let file = open_file(&path).ok()?;
    matches!(file.try_lock_shared(), Err(TryLockError::WouldBlock)).then_some(holder)
}

/// A directory's lock, released on drop.
pub(crate) struct DirLock {
    dir: PathBuf,
    file: File,
    made: MadeFolders,
}

/// Folders made for a lock, deepest first. They go with it as far as they are empty.
struct MadeFolders(Vec<PathBuf>);

impl MadeFolders {
    /// Makes a directory, and those around it, as far as they are missing.
    fn down_to(disk: &Disk, dir: &Path) -> Result<Self, DiskError> {
        // Known before the first is made: of several, only some may be.
        let made = Self(missing(dir));
        if !made.0.is_empty() {
            disk.create_dir_all(dir)?;
        }
        Ok(made)
    }
}

impl Drop for MadeFolders {
    fn drop(&mut self) {
        for dir in &self.0 {
            match std::fs::remove_dir(dir) {
                Err(error) if error.kind() != io::ErrorKind::NotFound => return,
                _ => {}
            }
        }
    }
}

impl DirLock {
    /// Takes the lock of a directory, created if missing, with those around it.
    ///
    /// # Errors
    /// If another pack has the lock, the file system does not lock files, or the lock file cannot be made, for instance
    /// in a read-only place.
    pub(crate) fn take(disk: &Disk, dir: &Path) -> Result<Self, PackError> {
        let (started, mut seen) = (Instant::now(), None);
        loop {
            let holder = match Self::attempt(disk, dir)? {
                Ok(lock) => return Ok(lock),
                Err(holder) => holder,
            };
            let is_sure = holder.as_ref().is_some_and(Holder::may_live) && holder == seen;
            if is_sure || started.elapsed() > PATIENCE {
                return Err(PackError::Busy { store: dir.into(), holder });
            }
            seen = holder;
            std::thread::sleep(PAUSE);
        }
    }

    /// Takes the lock, or tells its holder, unknown if something vanished meanwhile.
    fn attempt(disk: &Disk, dir: &Path) -> Result<Result<Self, Option<Holder>>, PackError> {
        let made = MadeFolders::down_to(disk, dir)?;
        let path = dir.join(LOCK_NAME);
        let mut options = OpenOptions::new();
        options.read(true).write(true).create(true).truncate(false);
        // A foreign file behind a link would be truncated.
        let file = match options.custom_flags(OFlags::NOFOLLOW.bits() as i32).open(&path) {
            Ok(file) => file,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Err(None)),
            Err(error)
                if matches!(error.kind(), io::ErrorKind::PermissionDenied | io::ErrorKind::ReadOnlyFilesystem) =>
            {
                return Err(PackError::ReadOnly { path: dir.into(), error });
            }
            Err(error) => return Err(PackError::Io { path, error }),
        };
        // A hard-linked file would be overwritten under its other name.
        if file.metadata().is_ok_and(|found| found.nlink() > 1) {
            let error = io::Error::other("is a hard link to another file: delete this one, which is only a lock");
            return Err(PackError::Io { path, error });
        }
        disk.meanwhile("the lock file is open");
        match file.try_lock() {
            Ok(()) if !is_named(&file, &path) || is_left(&file) => return Ok(Err(None)),
            Ok(()) => {}
            // Reopened for reading: an NFS client then consults the server.
            Err(TryLockError::WouldBlock) => return Ok(Err(Holder::read(&path))),
            Err(TryLockError::Error(error)) => {
                // Nobody can have a lock here: the file goes, too.
                let _ = std::fs::remove_file(&path);
                return Err(PackError::NoLock { path: dir.into(), error });
            }
        }
        file.set_len(0).map_err(|error| PackError::Io { path, error })?;
        Ok(Ok(Self { dir: dir.into(), file, made }))
    }

    /// Writes this process's name into the lock file, for others waiting for the lock.
    pub(crate) fn declare(&self, disk: &Disk) -> Result<(), DiskError> {
        let Holder { pid, host } = Holder::myself();
        let path = self.dir.join(LOCK_NAME);
        match self.file.write_all_at(format!("{pid} {host}\n").as_bytes(), 0) {
            Ok(()) => disk.sync(&path, &self.file),
            Err(error) => Err(DiskError { path, error }),
        }
    }

    /// Makes the lock remove its directory on drop if empty: for a directory made only by packs. Of several
    /// simultaneous packs one makes it, and another may be the last to leave.
    pub(crate) fn takes_dir_along(&mut self) {
        self.made.0 = vec![self.dir.clone()];
    }

    /// Looks for the lock's directory under its possible new names.
    pub(crate) fn moved_to_one_of(&mut self, names: &[&Path]) {
        if let Some(dir) = names.iter().find(|dir| is_named(&self.file, &dir.join(LOCK_NAME))) {
            self.moved(dir);
        }
    }

    /// Sets the lock's directory, which then outlives the lock.
    pub(crate) fn moved(&mut self, dir: &Path) {
        self.dir = dir.into();
        self.made.0.clear();
    }
}

impl Drop for DirLock {
    fn drop(&mut self) {
        let path = self.dir.join(LOCK_NAME);
        // First the name and then the mark, so a marked file is never found under its name. A failure leaves an
        // unlocked file.
        if is_named(&self.file, &path) && std::fs::remove_file(&path).is_ok() {
            let _ = self.file.set_len(0).and_then(|()| self.file.write_all_at(LEFT, 0));
        }
    }
}

/// Whether `path` names this file.
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
        assert!(message.contains(LOCK_NAME) && message.contains("a hard link"), "{message}");
        assert_eq!(std::fs::read(&other).unwrap(), b"precious");
    }
}
