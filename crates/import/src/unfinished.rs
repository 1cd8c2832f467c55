//! Files and folders to become an output. They lie beside it, under names made from its own, and are locked while their process lives: so the next
//! output of the same name takes away those that killed processes left. Costs a look at the names in the folder.

use crate::files::folder_of;
use crate::temporary::{RANDOM_BYTES, named_in, without_path};
use std::ffi::OsStr;
use std::fs::File;
use std::io;
use std::os::unix::fs::{MetadataExt, OpenOptionsExt, PermissionsExt};
use std::path::{Path, PathBuf};
use tempfile::{Builder, NamedTempFile, TempDir};

/// Most attempts at a name, each of which another process may take for a left-over before it is locked.
const MOST_ATTEMPTS: u32 = 16;

/// A folder to become an output; removed unless it is kept.
pub struct OutputFolder {
    folder: TempDir,
    _lock: Option<File>,
}

impl OutputFolder {
    /// The folder's path so far.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }

    /// Leaves the folder where it is; returns its path.
    pub fn keep(self) -> PathBuf {
        self.folder.keep()
    }
}

/// Creates the file to become `output`, removed unless it is given a name. `start` begins its name until then.
///
/// # Errors
/// If the system refuses the file.
pub fn file_for(output: &Path, start: &str) -> io::Result<NamedTempFile> {
    let (folder, prefix) = (folder_of(output), prefix_of(output, start));
    left_in(folder, &prefix).filter(|left| left.is_file).for_each(|left| {
        let _ = std::fs::remove_file(&left.path);
    });
    held(|| {
        let file = named_in(folder, &prefix, "")?;
        Ok(match lock(file.as_file(), file.path()) {
            Lock::Held | Lock::Unknown => Some(file),
            Lock::Lost => None,
        })
    })
}

/// Creates the folder to become `output`. `start` begins its name until then; `remove` deletes a left-over with what such folders hold.
///
/// # Errors
/// If the system refuses the folder.
pub fn folder_for(output: &Path, start: &str, remove: impl Fn(&Path)) -> io::Result<OutputFolder> {
    let (around, prefix) = (folder_of(output), prefix_of(output, start));
    left_in(around, &prefix).filter(|left| !left.is_file).for_each(|left| remove(&left.path));
    let mut builder = Builder::new();
    builder.prefix(&prefix).rand_bytes(RANDOM_BYTES).permissions(std::fs::Permissions::from_mode(0o777));
    held(|| {
        let folder = builder.tempdir_in(around).map_err(without_path)?;
        let Ok(file) = File::open(folder.path()) else { return Ok(Some(OutputFolder { folder, _lock: None })) };
        Ok(match lock(&file, folder.path()) {
            Lock::Held => Some(OutputFolder { folder, _lock: Some(file) }),
            Lock::Unknown => Some(OutputFolder { folder, _lock: None }),
            Lock::Lost => None,
        })
    })
}

/// Makes something until it is held.
fn held<T>(mut make: impl FnMut() -> io::Result<Option<T>>) -> io::Result<T> {
    for _ in 0..MOST_ATTEMPTS {
        if let Some(made) = make()? {
            return Ok(made);
        }
    }
    Err(io::ErrorKind::ResourceBusy.into())
}

/// Beginning of the temporary names of an output. Of this machine: locks of others may be unknown here.
fn prefix_of(output: &Path, start: &str) -> String {
    let mut sum = flate2::Crc::new();
    sum.update(rustix::system::uname().nodename().to_bytes_with_nul());
    sum.update(output.file_name().unwrap_or_default().as_encoded_bytes());
    format!("{start}-{:08x}-", sum.sum())
}

/// A file or folder of a process that is no more, locked.
struct Left {
    path: PathBuf,
    is_file: bool,
    _lock: File,
}

/// The left-overs with these names. Whatever cannot be locked is none.
fn left_in(folder: &Path, prefix: &str) -> impl Iterator<Item = Left> {
    let is_ours = move |name: &OsStr| {
        let random = name.to_str().and_then(|name| name.strip_prefix(prefix));
        random.is_some_and(|random| random.len() == RANDOM_BYTES && random.bytes().all(|b| b.is_ascii_alphanumeric()))
    };
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
    entries.filter(move |entry| is_ours(&entry.file_name())).filter_map(|entry| {
        let kind = entry.file_type().ok().filter(|kind| kind.is_file() || kind.is_dir())?;
        let path = entry.path();
        let flags = rustix::fs::OFlags::NOFOLLOW.bits() as i32;
        // Network file systems lock only what is open for writing.
        let file = File::options().read(true).write(kind.is_file()).custom_flags(flags).open(&path).ok()?;
        let is_free = matches!(lock(&file, &path), Lock::Held);
        is_free.then_some(Left { path, is_file: kind.is_file(), _lock: file })
    })
}

/// Outcome of an attempt at a lock.
enum Lock {
    Held,
    /// Another process has it, or the file has lost its name.
    Lost,
    /// The file system does not lock, so nobody takes it for a left-over.
    Unknown,
}

fn lock(file: &File, path: &Path) -> Lock {
    let number = |found: std::fs::Metadata| (found.dev(), found.ino());
    match file.try_lock() {
        Ok(()) => {
            let named = std::fs::symlink_metadata(path).map(number).ok();
            match named.is_some() && named == file.metadata().map(number).ok() {
                true => Lock::Held,
                false => Lock::Lost,
            }
        }
        Err(std::fs::TryLockError::WouldBlock) => Lock::Lost,
        Err(std::fs::TryLockError::Error(_)) => Lock::Unknown,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Names in a folder.
    fn names(folder: &Path) -> Vec<String> {
        let names = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let mut names: Vec<String> = names.collect();
        names.sort();
        names
    }

    #[test]
    fn the_next_output_of_the_name_takes_left_overs_away() {
        let around = tempfile::tempdir().unwrap();
        let [output, other] = ["a.nii", "b.nii"].map(|name| around.path().join(name));
        // As after a kill: the lock is gone, and the name is not.
        let left = |output: &Path| file_for(output, ".start").unwrap().keep().map(drop).unwrap();
        left(&output);
        left(&other);
        let folder = folder_for(&output, ".start", |_| panic!("there is none")).unwrap().keep();
        std::fs::write(folder.join("plane"), "").unwrap();
        let prefix = prefix_of(&output, ".start");
        for name in [format!("{prefix}1234567"), format!("{prefix}12345-"), prefix.clone(), ".startAbCdEf".into()] {
            std::fs::write(around.path().join(name), "mine").unwrap();
        }
        std::os::unix::fs::symlink("b.nii", around.path().join(format!("{prefix}123456"))).unwrap();
        assert_eq!(names(around.path()).len(), 8);
        let file = file_for(&output, ".start").unwrap();
        // The other name's, the folder and what has no such name stay; one that is written to, as well.
        assert_eq!(names(around.path()).len(), 8);
        let second = file_for(&output, ".start").unwrap();
        assert!(file.path().exists() && second.path().exists());
        drop((file, second));
        let remove = |path: &Path| std::fs::remove_dir_all(path).unwrap();
        let held = folder_for(&output, ".start", remove).unwrap();
        assert!(!folder.exists());
        let third = folder_for(&output, ".start", |path| panic!("{} is in use", path.display())).unwrap();
        assert!(held.path().exists() && third.path().exists());
        drop((held, third));
        assert_eq!(names(around.path()).len(), 6, "{:?}", names(around.path()));
    }
}
