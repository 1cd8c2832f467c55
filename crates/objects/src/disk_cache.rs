//! Parts of objects on this machine's disk, kept over sessions and shared by processes: a file for each part, by host, name and place.
//!
//! A file holds its part's key, the object's state and a checksum, and gets its name when it is whole: a killed process leaves at most a temporary file.
//! The parts used least recently go when all take more than the limit. Failures cost requests alone; after one to write, a process writes no more.
//! Costs a look at all files before the first write, and after each [`SHARE`]th of the limit written.

use crate::objects::{Object, Version};
use std::fs::{self, DirBuilder, File};
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, SystemTime};
use xxhash_rust::xxh3::{xxh3_64, xxh3_128};

/// First line of a file.
const FORMAT: &str = "brickyard object 1";

/// Folder of all objects in the user's cache folder.
const FOLDER: &str = "objects";

const TEMPORARY: &str = ".new-";

/// Bytes of the checksum at a file's end.
const CHECK_BYTES: usize = 8;

/// Most bytes of a file: no object is kept that is larger.
const MOST_FILE_BYTES: u64 = 1 << 30;

/// A process looks at all files when it begins to write another such part of the limit, and writes on meanwhile. Up to eight processes keep the limit
/// together: two parts for each are left free.
const SHARE: u64 = 64;

/// A part's last use is noted again after so long.
const NOTED_FOR: Duration = Duration::from_secs(600);

/// A temporary file of this age is a killed process's.
const ABANDONED_AFTER: Duration = Duration::from_secs(3600);

/// The parts kept of one host or bucket, among those of all.
pub(crate) struct DiskCache {
    /// Folder of all hosts' parts.
    folder: PathBuf,
    host: String,
    most_bytes: u64,
    room: Mutex<Room>,
    has_failed: AtomicBool,
}

/// Bytes that may be written before the next look at all files, and the last such look.
#[derive(Default)]
struct Room {
    bytes: u64,
    look: Option<JoinHandle<()>>,
}

/// A part of an object: its name there, and which bytes.
#[derive(Clone, Debug)]
pub(crate) struct Part<'a> {
    pub(crate) name: &'a str,
    pub(crate) place: String,
}

impl DiskCache {
    /// The parts of a host in a user's cache folder, at most so many bytes of all hosts.
    pub(crate) fn new(cache_folder: &Path, host: &str, most_bytes: u64) -> Self {
        let (folder, host) = (cache_folder.join(FOLDER), host.to_owned());
        Self { folder, host, most_bytes, room: Mutex::default(), has_failed: AtomicBool::new(false) }
    }

    /// Looks at all files, if none of this process did: the limit may be lower than the last one.
    pub(crate) fn look_once(&self) {
        let mut room = self.room.lock().unwrap_or_else(PoisonError::into_inner);
        if room.look.is_none() {
            self.look(&mut room);
        }
    }

    /// Begins to make room, after the last time has ended.
    fn look(&self, room: &mut Room) {
        if let Some(look) = room.look.take() {
            drop(look.join());
        }
        let (folder, most_bytes) = (self.folder.clone(), self.most_bytes / SHARE * (SHARE - 16));
        room.look = Some(thread::spawn(move || trim(&folder, most_bytes)));
    }

    /// A part kept before, with the object's state then; `None` if there is none, or a damaged one.
    pub(crate) fn read(&self, part: &Part<'_>) -> Option<Object> {
        let path = self.path(part);
        // A pipe or device would never end.
        let is_plausible = |file: &fs::Metadata| file.is_file() && file.len() <= MOST_FILE_BYTES;
        fs::symlink_metadata(&path).ok().filter(is_plausible)?;
        let mut bytes = fs::read(&path).ok()?;
        let (content, check) = bytes.split_last_chunk::<CHECK_BYTES>()?;
        if u64::from_le_bytes(*check) != xxh3_64(content) {
            return None;
        }
        let key = self.key(part);
        let rest = content.strip_prefix(key.as_bytes())?;
        let end = rest.iter().position(|byte| *byte == b'\n')?;
        let (size, tag) = std::str::from_utf8(&rest[..end]).ok()?.split_once(' ')?;
        let tag = Some(tag).filter(|tag| !tag.is_empty()).map(str::to_owned);
        let version = Version { bytes: size.parse().ok()?, tag, is_settled: true };
        let start = key.len() + end + 1;
        bytes.truncate(bytes.len() - CHECK_BYTES);
        bytes.drain(..start);
        note_use(&path);
        Some(Object { bytes, version })
    }

    /// Keeps a part.
    pub(crate) fn write(&self, part: &Part<'_>, version: &Version, bytes: &[u8]) {
        let is_told = version.is_settled && version.tag.as_ref().is_some_and(|tag| !tag.contains('\n'));
        if !is_told || bytes.len() as u64 > MOST_FILE_BYTES / 2 || self.has_failed.load(Ordering::Relaxed) {
            return;
        }
        let head = format!("{}{} {}\n", self.key(part), version.bytes, version.tag.as_deref().unwrap_or_default());
        let file_bytes = on_disk((head.len() + bytes.len() + CHECK_BYTES) as u64);
        if !self.has_room(file_bytes) {
            return;
        }
        if let Err(error) = write(&self.path(part), head.as_bytes(), bytes)
            && !self.has_failed.swap(true, Ordering::Relaxed)
        {
            tracing::warn!(%error, folder = %self.folder.display(), "nothing more is kept on disk of objects at addresses");
        }
    }

    /// Forgets all parts of an object.
    pub(crate) fn forget(&self, name: &str) {
        let path = self.path(&Part { name, place: String::new() });
        let (Some(folder), Some(start)) = (path.parent(), path.file_name().and_then(|name| name.to_str())) else {
            return;
        };
        for file in entries(folder) {
            if file.file_name().and_then(|name| name.to_str()).is_some_and(|name| name.starts_with(start)) {
                drop(fs::remove_file(file));
            }
        }
    }

    /// Identifies a part in its file.
    fn key(&self, Part { name, place }: &Part<'_>) -> String {
        format!("{FORMAT}\n{}\n{name}\n{place}\n", self.host)
    }

    fn path(&self, Part { name, place }: &Part<'_>) -> PathBuf {
        let hash = format!("{:032x}", xxh3_128(format!("{}\n{name}", self.host).as_bytes()));
        self.folder.join(&hash[..2]).join(format!("{}.{place}", &hash[2..]))
    }

    /// Whether so many bytes may be written now.
    fn has_room(&self, bytes: u64) -> bool {
        if bytes > self.most_bytes / 8 {
            return false;
        }
        let mut room = self.room.lock().unwrap_or_else(PoisonError::into_inner);
        if room.bytes < bytes {
            self.look(&mut room);
            room.bytes = (self.most_bytes / SHARE).max(bytes);
        }
        room.bytes -= bytes;
        true
    }
}

fn write(path: &Path, head: &[u8], bytes: &[u8]) -> io::Result<()> {
    let folder = path.parent().ok_or(io::ErrorKind::InvalidInput)?;
    let mut builder = DirBuilder::new();
    builder.recursive(true);
    // Objects of private buckets are nobody else's on this machine.
    #[cfg(unix)]
    std::os::unix::fs::DirBuilderExt::mode(&mut builder, 0o700);
    builder.create(folder)?;
    let mut content = Vec::with_capacity(head.len() + bytes.len() + CHECK_BYTES);
    content.extend_from_slice(head);
    content.extend_from_slice(bytes);
    content.extend_from_slice(&xxh3_64(&content).to_le_bytes());
    let mut file = tempfile::Builder::new().prefix(TEMPORARY).tempfile_in(folder)?;
    file.write_all(&content)?;
    file.persist(path).map_err(|error| error.error)?;
    Ok(())
}

/// Notes a part's use in its file's time, unless that was done of late.
fn note_use(path: &Path) {
    let noted = || {
        let file = File::options().append(true).open(path)?;
        if age(&file.metadata()?) > NOTED_FOR { file.set_modified(SystemTime::now()) } else { Ok(()) }
    };
    let _: io::Result<()> = noted();
}

/// Bytes that a file takes on disk, in blocks of 4 KiB.
fn on_disk(bytes: u64) -> u64 {
    bytes.next_multiple_of(4096)
}

fn age(metadata: &fs::Metadata) -> Duration {
    metadata.modified().ok().and_then(|modified| modified.elapsed().ok()).unwrap_or_default()
}

fn entries(folder: &Path) -> impl Iterator<Item = PathBuf> {
    fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path())
}

/// All files of parts, whole or not: by their names, in folders of their own. Links are nobody's to follow.
fn files(folder: &Path) -> impl Iterator<Item = (PathBuf, fs::Metadata)> {
    let name = |path: &Path| path.file_name().and_then(|name| name.to_str()).unwrap_or_default().to_owned();
    let is_hash = |text: &str, digits: usize| text.len() == digits && text.bytes().all(|byte| byte.is_ascii_hexdigit());
    let is_folder = |path: &PathBuf| fs::symlink_metadata(path).is_ok_and(|found| found.is_dir());
    let folders = entries(folder).filter(move |path| is_hash(&name(path), 2) && is_folder(path));
    let is_own = move |path: &PathBuf| {
        let name = name(path);
        name.starts_with(TEMPORARY) || name.split_once('.').is_some_and(|(hash, _)| is_hash(hash, 30))
    };
    let files = folders.flat_map(|inner| entries(&inner).collect::<Vec<_>>()).filter(is_own);
    files.filter_map(|path| fs::symlink_metadata(&path).ok().filter(fs::Metadata::is_file).map(|file| (path, file)))
}

/// Deletes the parts used least recently until at most so many bytes are left, and what killed processes left behind.
fn trim(folder: &Path, most_bytes: u64) {
    let is_temporary =
        |path: &Path| path.file_name().and_then(|name| name.to_str()).is_some_and(|n| n.starts_with(TEMPORARY));
    let mut kept: Vec<(SystemTime, u64, PathBuf)> = Vec::new();
    for (path, file) in files(folder) {
        if is_temporary(&path) && age(&file) > ABANDONED_AFTER {
            drop(fs::remove_file(path));
        } else {
            kept.push((file.modified().unwrap_or(SystemTime::UNIX_EPOCH), on_disk(file.len()), path));
        }
    }
    let mut total: u64 = kept.iter().map(|(_, bytes, _)| bytes).sum();
    if total <= most_bytes {
        return;
    }
    kept.sort_unstable();
    // More than needed: the next look is as long.
    for (_, bytes, path) in kept {
        if total <= most_bytes / 8 * 7 {
            break;
        }
        if fs::remove_file(path).is_ok() {
            total -= bytes;
        }
    }
}

/// The parts kept of all hosts.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Kept {
    /// Files.
    pub files: u64,
    /// Bytes that they take on disk.
    pub bytes: u64,
}

/// Counts the parts kept in a user's cache folder.
pub fn kept(cache_folder: &Path) -> Kept {
    let add = |kept: Kept, (_, file): (PathBuf, fs::Metadata)| Kept {
        files: kept.files + 1,
        bytes: kept.bytes + on_disk(file.len()),
    };
    files(&cache_folder.join(FOLDER)).fold(Kept::default(), add)
}

/// Deletes all parts kept in a user's cache folder.
///
/// # Errors
/// If the system refuses to delete a file.
pub fn clear(cache_folder: &Path) -> io::Result<Kept> {
    let mut cleared = Kept::default();
    for (path, file) in files(&cache_folder.join(FOLDER)) {
        match fs::remove_file(path) {
            Ok(()) => cleared = Kept { files: cleared.files + 1, bytes: cleared.bytes + on_disk(file.len()) },
            Err(error) if error.kind() == io::ErrorKind::NotFound => {}
            Err(error) => return Err(error),
        }
    }
    Ok(cleared)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn version(tag: &str) -> Version {
        Version { bytes: 1000, tag: Some(tag.into()), is_settled: true }
    }

    fn part(place: u64) -> Part<'static> {
        Part { name: "a/b", place: place.to_string() }
    }

    fn is_kept(cache: &DiskCache, place: u64) -> bool {
        cache.read(&part(place)).is_some()
    }

    #[test]
    fn parts_come_back_with_their_state_and_damaged_ones_do_not() {
        let folder = tempfile::tempdir().unwrap();
        let cache = DiskCache::new(folder.path(), "http://a", 1 << 20);
        cache.write(&part(0), &version("\"x y\""), b"brick");
        let again = DiskCache::new(folder.path(), "http://a", 1 << 20);
        let read = again.read(&part(0)).unwrap();
        assert_eq!((&read.bytes[..], read.version), (&b"brick"[..], version("\"x y\"")));
        assert!(DiskCache::new(folder.path(), "http://b", 1 << 20).read(&part(0)).is_none(), "another host's");
        assert!(!is_kept(&cache, 1));
        cache.write(&part(1), &Version { tag: None, ..version("") }, b"brick");
        cache.write(&part(1), &Version { is_settled: false, ..version("x") }, b"brick");
        assert!(!is_kept(&cache, 1), "its state cannot be told");
        let (path, _) = files(&folder.path().join(FOLDER)).next().unwrap();
        let sound = fs::read(&path).unwrap();
        for i in 0..sound.len() {
            let mut flipped = sound.clone();
            flipped[i] ^= 4;
            for damaged in [&flipped[..], &sound[..i]] {
                fs::write(&path, damaged).unwrap();
                assert!(!is_kept(&cache, 0), "{i}");
            }
        }
    }

    #[test]
    fn an_object_is_forgotten_with_all_its_parts() {
        let folder = tempfile::tempdir().unwrap();
        let cache = DiskCache::new(folder.path(), "http://a", 1 << 20);
        let other = Part { name: "a/c", place: "0".into() };
        for part in [&part(0), &part(1), &other] {
            cache.write(part, &version("x"), b"brick");
        }
        cache.forget("a/b");
        assert!(!is_kept(&cache, 0) && !is_kept(&cache, 1) && cache.read(&other).is_some());
        // Nobody else's files are counted or cleared, and no link is followed.
        let (objects, elsewhere) = (folder.path().join(FOLDER), tempfile::tempdir().unwrap());
        let others =
            [elsewhere.path().join(format!("{:030}.whole", 0)), objects.join("mine"), objects.join("zz.whole")];
        others.iter().for_each(|path| fs::write(path, "stays").unwrap());
        #[cfg(unix)]
        std::os::unix::fs::symlink(elsewhere.path(), objects.join("00")).unwrap();
        assert_eq!(kept(folder.path()).files, 1);
        assert_eq!(clear(folder.path()).unwrap().files, 1);
        assert!(others.iter().all(|path| path.exists()));
        assert_eq!(kept(folder.path()), Kept::default());
    }

    #[test]
    fn the_limit_holds_and_parts_used_least_recently_go_first() {
        let folder = tempfile::tempdir().unwrap();
        let cache = DiskCache::new(folder.path(), "http://a", 200_000);
        let aged = |place: u64, minutes: u64| {
            let file = File::options().append(true).open(cache.path(&part(place))).unwrap();
            file.set_modified(SystemTime::now() - Duration::from_secs(60 * minutes)).unwrap();
        };
        for place in 0..30 {
            cache.write(&part(place), &version("x"), &[7; 4000]);
            aged(place, 1000 - place);
        }
        assert!(is_kept(&cache, 0), "read, thus used");
        for place in 30..45 {
            cache.write(&part(place), &version("x"), &[7; 4000]);
            assert!(kept(folder.path()).bytes <= 200_000);
        }
        assert!(is_kept(&cache, 0) && !is_kept(&cache, 1) && is_kept(&cache, 44));
        cache.write(&part(99), &version("x"), &[7; 30_000]);
        assert!(!is_kept(&cache, 99), "too large a share");
    }

    #[test]
    fn many_writers_leave_whole_parts_within_the_limit() {
        let folder = tempfile::tempdir().unwrap();
        std::thread::scope(|scope| {
            for writer in 0..8u64 {
                let folder = &folder;
                scope.spawn(move || {
                    let cache = DiskCache::new(folder.path(), "http://a", 300_000);
                    for place in 0..200 {
                        let place = (place * 7 + writer) % 100;
                        cache.write(&part(place), &version("x"), &[place as u8; 3000]);
                        if let Some(read) = cache.read(&part(place)) {
                            assert!(read.bytes == [place as u8; 3000]);
                        }
                    }
                });
            }
        });
        assert!(kept(folder.path()).bytes <= 300_000, "{:?}", kept(folder.path()));
    }

    #[test]
    fn an_unwritable_folder_is_tried_once() {
        let folder = tempfile::tempdir().unwrap();
        fs::write(folder.path().join(FOLDER), "no folder").unwrap();
        let cache = DiskCache::new(folder.path(), "http://a", 1 << 20);
        cache.write(&part(0), &version("x"), b"brick");
        assert!(!is_kept(&cache, 0) && cache.has_failed.load(Ordering::Relaxed));
    }
}
