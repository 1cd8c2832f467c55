//! Every change that packing makes to the file system goes through here: one place for paths in errors, syncs, and tests'
//! injected failures.

use std::fs::{File, OpenOptions};
use std::io::{self, Write};
use std::path::{Path, PathBuf};

/// A failed change and its path.
#[derive(Debug)]
pub(crate) struct DiskError {
    pub(crate) path: PathBuf,
    pub(crate) error: io::Error,
}

type Result<T> = std::result::Result<T, DiskError>;

/// The file system as packing sees it.
#[derive(Default)]
pub(crate) struct Disk {
    /// Changes until all further ones fail, as on a full disk or after a crash.
    #[cfg(test)]
    pub(crate) fuse: Option<std::sync::atomic::AtomicI64>,
}

impl Disk {
    fn step(&self) -> io::Result<()> {
        #[cfg(test)]
        if let Some(fuse) = &self.fuse
            && fuse.fetch_sub(1, std::sync::atomic::Ordering::SeqCst) <= 0
        {
            return Err(io::ErrorKind::StorageFull.into());
        }
        Ok(())
    }

    fn run<T>(&self, path: &Path, change: impl FnOnce() -> io::Result<T>) -> Result<T> {
        self.step().and_then(|()| change()).map_err(|error| DiskError { path: path.into(), error })
    }

    pub(crate) fn create_dir_all(&self, path: &Path) -> Result<()> {
        self.run(path, || std::fs::create_dir_all(path))
    }

    /// Opens for appending from nothing.
    pub(crate) fn create(&self, path: &Path) -> Result<File> {
        self.run(path, || File::create(path))
    }

    /// Opens to append to what is there.
    pub(crate) fn reopen(&self, path: &Path) -> Result<File> {
        self.run(path, || OpenOptions::new().append(true).open(path))
    }

    pub(crate) fn append(&self, path: &Path, file: &mut File, bytes: &[u8]) -> Result<()> {
        #[cfg(test)]
        if let Some(fuse) = &self.fuse
            && fuse.load(std::sync::atomic::Ordering::SeqCst) == 0
        {
            // The write that hits the end of the disk is torn.
            let _ = file.write_all(&bytes[..bytes.len() / 2]);
        }
        self.run(path, || file.write_all(bytes))
    }

    pub(crate) fn sync(&self, path: &Path, file: &File) -> Result<()> {
        // Tests end processes, not power: they count syncs without waiting for the disk.
        self.run(path, || if cfg!(test) { Ok(()) } else { file.sync_data() })
    }

    /// Makes renames and new files in a directory last.
    pub(crate) fn sync_dir(&self, path: &Path) -> Result<()> {
        self.run(path, || if cfg!(test) { Ok(()) } else { File::open(path)?.sync_all() })
    }

    pub(crate) fn rename(&self, from: &Path, to: &Path) -> Result<()> {
        self.run(to, || std::fs::rename(from, to))
    }

    /// Puts directory `new` in the place of `old`, in one step where the file system can exchange names. Returns where the
    /// old one is then.
    pub(crate) fn replace(&self, new: &Path, old: &Path) -> Result<PathBuf> {
        use rustix::fs::{CWD, RenameFlags, renameat_with};
        self.run(old, || match renameat_with(CWD, new, CWD, old, RenameFlags::EXCHANGE) {
            Ok(()) => Ok(new.into()),
            Err(rustix::io::Errno::INVAL | rustix::io::Errno::NOSYS | rustix::io::Errno::OPNOTSUPP) => {
                let mut aside = old.components().as_path().as_os_str().to_owned();
                aside.push(".replaced");
                std::fs::rename(old, &aside)?;
                std::fs::rename(new, old)?;
                Ok(aside.into())
            }
            Err(error) => Err(error.into()),
        })
    }

    pub(crate) fn remove_file(&self, path: &Path) -> Result<()> {
        self.run(path, || std::fs::remove_file(path))
    }

    pub(crate) fn remove_dir_all(&self, path: &Path) -> Result<()> {
        self.run(path, || std::fs::remove_dir_all(path))
    }

    /// Writes a whole small file: under its name there is the old content, the new, or none, never a part.
    pub(crate) fn write(&self, path: &Path, bytes: &[u8]) -> Result<()> {
        let temporary = temporary(path);
        let mut file = self.create(&temporary)?;
        self.append(&temporary, &mut file, bytes)?;
        self.sync(&temporary, &file)?;
        self.rename(&temporary, path)
    }

    /// The same in a folder that may not be there yet.
    pub(crate) fn write_with_parents(&self, path: &Path, bytes: &[u8]) -> Result<()> {
        let missing = path.parent().filter(|parent| !parent.exists());
        missing.map_or(Ok(()), |parent| self.create_dir_all(parent))?;
        self.write(path, bytes)
    }
}

/// The name under which a file is written until it is whole.
pub(crate) fn temporary(path: &Path) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(".tmp");
    name.into()
}
