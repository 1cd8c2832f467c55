//! An image's folder in the user's cache: files by name, each checked, so the next opening need not make them again. Folders of the images used least
//! recently go first when all take more than [`MOST_KEPT_BYTES`].
//!
//! Whatever fails here costs time alone: what the file held is made again. Costs a file for each name, and a look at all files of the cache before the first write.

use brickyard_import::temporary::named_in;
use brickyard_objects::cache_folder;
use std::fs;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::SystemTime;
use xxhash_rust::xxh3::{xxh3_64, xxh3_128};

/// Most bytes of all images' files.
pub const MOST_KEPT_BYTES: u64 = 4 << 30;

/// A file whose time tells the last use of its folder.
const USED_NAME: &str = "used";

/// Bytes of a file's checksum, at its end.
const CHECK_BYTES: usize = 8;

/// The cache folder of one image.
pub(crate) struct Cache {
    /// `None` without a folder for caches.
    folder: Option<PathBuf>,
    most_bytes: u64,
    /// Bytes that may still be written; looked up before the first write.
    left_bytes: OnceLock<AtomicU64>,
    is_marked: OnceLock<()>,
    is_tidy: OnceLock<()>,
}

impl Cache {
    /// Finds the folder for the image with this identity, without making or reading it.
    pub(crate) fn of(identity: &str) -> Self {
        Self::within(cache_folder(), MOST_KEPT_BYTES, identity)
    }

    fn within(root: Option<PathBuf>, most_bytes: u64, identity: &str) -> Self {
        let name = format!("{:032x}", xxh3_128(identity.as_bytes()));
        Self {
            folder: root.map(|root| root.join(name)),
            most_bytes,
            left_bytes: OnceLock::new(),
            is_marked: OnceLock::new(),
            is_tidy: OnceLock::new(),
        }
    }

    /// Whether there is a folder for caches.
    pub(crate) fn is_there(&self) -> bool {
        self.folder.is_some()
    }

    /// The bytes written under a name; `None` if there are none, or damaged ones.
    pub(crate) fn read(&self, name: &str) -> Option<Vec<u8>> {
        let mut bytes = fs::read(self.folder.as_ref()?.join(name)).ok()?;
        let (content, check) = bytes.split_last_chunk::<CHECK_BYTES>()?;
        if u64::from_le_bytes(*check) != xxh3_64(content) {
            return None;
        }
        bytes.truncate(bytes.len() - CHECK_BYTES);
        if let Some(folder) = &self.folder {
            self.is_marked.get_or_init(|| drop(fs::write(folder.join(USED_NAME), [])));
        }
        Some(bytes)
    }

    /// Deletes the folders of former states of the image's files, once: nothing reads them again, and they take room.
    pub(crate) fn forget_states_but(&self, present: &str) {
        let Some(folder) = &self.folder else { return };
        self.is_tidy.get_or_init(|| {
            let entries = fs::read_dir(folder).into_iter().flatten().flatten();
            let folders = entries.filter(|entry| entry.file_type().is_ok_and(|kind| kind.is_dir()));
            for former in folders.filter(|entry| entry.file_name() != present) {
                drop(fs::remove_dir_all(former.path()));
            }
        });
    }

    /// Sets room for so many bytes aside, for [`Cache::write_reserved`]; false if there is none.
    pub(crate) fn reserve(&self, bytes: u64) -> bool {
        let Some(folder) = &self.folder else { return false };
        let left = self.left_bytes.get_or_init(|| AtomicU64::new(make_room(folder, self.most_bytes)));
        let needed = bytes + CHECK_BYTES as u64;
        left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(needed)).is_ok()
    }

    /// Writes bytes under a name, a file's or a folder's and a file's, if there is room. Returns whether they are there.
    pub(crate) fn write(&self, name: &str, bytes: &[u8]) -> bool {
        self.reserve(bytes.len() as u64) && self.write_reserved(name, bytes)
    }

    /// Writes bytes for which room was set aside. Returns whether they are there.
    pub(crate) fn write_reserved(&self, name: &str, bytes: &[u8]) -> bool {
        let Some(folder) = &self.folder else { return false };
        let path = folder.join(name);
        let written = write(folder, &path, bytes);
        if let Err(error) = &written {
            tracing::debug!(%error, path = %path.display(), "not kept in the cache");
        }
        written.is_ok()
    }
}

fn write(image: &Path, path: &Path, bytes: &[u8]) -> io::Result<()> {
    let folder = path.parent().unwrap_or(image);
    fs::create_dir_all(folder)?;
    fs::write(image.join(USED_NAME), [])?;
    let mut file = named_in(folder, ".", "")?;
    file.write_all(bytes)?;
    file.write_all(&xxh3_64(bytes).to_le_bytes())?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}

/// Deletes the folders of other images than `own`, least recently used first, if all take more than three quarters of `most_bytes`, until half of it is
/// free. Returns the bytes left.
fn make_room(own: &Path, most_bytes: u64) -> u64 {
    let mut images = own.parent().map_or_else(Vec::new, images_in);
    let mut total: u64 = images.iter().map(|(.., bytes)| bytes).sum();
    images.sort();
    let most = if total > most_bytes / 4 * 3 { most_bytes / 2 } else { most_bytes };
    for (_, folder, bytes) in images.iter().filter(|(_, folder, _)| folder != own) {
        if total > most && fs::remove_dir_all(folder).is_ok() {
            total -= bytes;
        }
    }
    most_bytes.saturating_sub(total)
}

/// Statistics and levels kept of other programs' images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct KeptImages {
    /// Images.
    pub images: u64,
    /// Bytes of their files.
    pub bytes: u64,
}

/// Counts the images in a user's cache folder.
pub fn kept_images(cache_folder: &Path) -> KeptImages {
    let images = images_in(cache_folder);
    KeptImages { images: images.len() as u64, bytes: images.iter().map(|(.., bytes)| bytes).sum() }
}

/// Deletes the images in a user's cache folder.
///
/// # Errors
/// If the system refuses to delete one.
pub fn clear_images(cache_folder: &Path) -> io::Result<KeptImages> {
    let mut cleared = KeptImages::default();
    for (_, folder, bytes) in images_in(cache_folder) {
        fs::remove_dir_all(folder)?;
        cleared = KeptImages { images: cleared.images + 1, bytes: cleared.bytes + bytes };
    }
    Ok(cleared)
}

/// Last use, folder and bytes of each image in the cache. Other things there are left alone.
fn images_in(root: &Path) -> Vec<(SystemTime, PathBuf, u64)> {
    let files_in = |folder: &Path| fs::read_dir(folder).into_iter().flatten().flatten().collect::<Vec<_>>();
    let image = |folder: PathBuf| {
        // A name as this file makes them: nobody else's folder is taken for one.
        let name = folder.file_name()?.to_str()?;
        if name.len() != 32 || !name.bytes().all(|digit| digit.is_ascii_hexdigit()) {
            return None;
        }
        let used = fs::metadata(folder.join(USED_NAME)).and_then(|used| used.modified()).ok()?;
        let files = files_in(&folder).into_iter().flat_map(|entry| {
            let inner = files_in(&entry.path());
            if inner.is_empty() { vec![entry] } else { inner }
        });
        let bytes = files.filter_map(|file| file.metadata().ok()).map(|file| file.len()).sum();
        Some((used, folder, bytes))
    };
    files_in(root).into_iter().filter_map(|entry| image(entry.path())).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::time::Duration;

    fn cache(root: &Path, most_bytes: u64, identity: &str) -> Cache {
        Cache::within(Some(root.into()), most_bytes, identity)
    }

    #[test]
    fn what_was_written_comes_back_and_damage_does_not() {
        let root = tempfile::tempdir().unwrap();
        let a = cache(root.path(), 1000, "a");
        assert!(a.read("1/0.0").is_none() && a.write("1/0.0", b"brick") && a.write("index", b""));
        assert_eq!(cache(root.path(), 1000, "a").read("1/0.0").unwrap(), b"brick");
        assert_eq!(a.read("index").unwrap(), b"");
        assert!(cache(root.path(), 1000, "b").read("1/0.0").is_none(), "another image's");
        let path = a.folder.as_ref().unwrap().join("1/0.0");
        let sound = fs::read(&path).unwrap();
        for damaged in [&sound[..sound.len() - 1], b"short", &[b"x", &sound[1..]].concat()] {
            fs::write(&path, damaged).unwrap();
            assert!(a.read("1/0.0").is_none());
        }
        assert!(!Cache::within(None, 1000, "a").write("1", b""));
    }

    #[test]
    fn images_used_least_recently_go_first_and_the_limit_holds() {
        let root = tempfile::tempdir().unwrap();
        fs::write(root.path().join("another's"), "stays").unwrap();
        for (name, minutes) in [("old", 1), ("new", 2)] {
            let image = cache(root.path(), 10_000, name);
            assert!((0..3).all(|i| image.write(&format!("1/{i}"), &[0; 992])));
            let used = fs::File::options().write(true).open(image.folder.unwrap().join(USED_NAME)).unwrap();
            used.set_modified(SystemTime::UNIX_EPOCH + Duration::from_secs(60 * minutes)).unwrap();
        }
        // 6,000 bytes are more than three quarters of 7,000: of the older image nothing stays.
        assert!(cache(root.path(), 7_000, "next").write("1", &[0; 992]));
        assert!(cache(root.path(), 7_000, "old").read("1/0").is_none());
        assert!(cache(root.path(), 7_000, "new").read("1/0").is_some());
        assert!(!cache(root.path(), 7_000, "next").write("2", &[0; 7_000]), "never more than the limit");
        let next = cache(root.path(), 7_000, "next");
        assert!(next.reserve(1_000) && !next.write("2", &[0; 2_000]) && next.write_reserved("2", &[0; 1_000]));
        assert!(root.path().join("another's").exists());
        let total: u64 = images_in(root.path()).iter().map(|(.., bytes)| bytes).sum();
        assert!(total <= 7_000, "{total}");
    }

    #[test]
    fn former_states_make_room() {
        let root = tempfile::tempdir().unwrap();
        let a = cache(root.path(), 3_000, "a");
        assert!(a.write("1/0", &[0; 1_000]) && a.write("index", b"i") && !a.write("2/0", &[0; 2_000]));
        let a = cache(root.path(), 3_000, "a");
        a.forget_states_but("2");
        assert!(a.write("2/0", &[0; 2_000]) && a.read("index").is_some() && a.read("1/0").is_none());
    }
}
