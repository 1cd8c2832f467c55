//! The journal of an unfinished pack: its settings, then one line per finished shard.
//!
//! ```text
//! {"replaces": null, "settings": {...}, "shards": 24}
//! 1234567 89abcdef 0/c/0/0/0          length, checksum of the index, path below the store; "0 00000000 path" if all fill
//! ```
//!
//! A line counts only if it is complete and the shard's file exists with this length and checksum: so lines and renames
//! may reach the disk in any order. Only the holder of the directory's lock touches it.
//!
//! If the file system is synced as a whole, shards are synced every few seconds and at the end of a pass, not one by
//! one. Lines starting with a blank record this: after `unsynced`, lines count only if `synced` follows. So a kill or
//! power failure costs a few seconds.
//!
//! `replaces` is the settings' fingerprint of the finished store to be replaced, if any.

use crate::data_file::open_file;
use crate::data_file::read_at_most;
use crate::layout::{JOURNAL_NAME, Layout, ShardId};
use crate::pack::PackError;
use crate::pack::disk::{Disk, DiskError, temporary};
use crate::pack::shards::Finished;
use crate::shard::Fingerprint;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::HashMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

pub(crate) struct Journal<'a> {
    disk: &'a Disk,
    /// The store's folder.
    store: PathBuf,
    /// `None` if nothing is recorded.
    file: Option<File>,
    head: Head,
    /// Shards finished by earlier runs, by path below the store.
    finished: HashMap<PathBuf, Fingerprint>,
    /// Time of the first recorded shard that may not be durable; `None` if all are.
    unsynced_since: Option<Instant>,
}

/// Longest wait of shards for a sync.
const SYNC_INTERVAL: Duration = Duration::from_secs(5);

/// A journal's first line.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct Head {
    pub(crate) replaces: Option<String>,
    pub(crate) settings: Value,
    pub(crate) shards: u64,
}

impl Head {
    /// Reads the head of a directory's journal; empty if there is no journal, or its first line is not a head.
    ///
    /// # Errors
    /// If the journal exists but cannot be read.
    pub(crate) fn of(store: &Path) -> Result<Self, PackError> {
        let (path, mut line) = (store.join(JOURNAL_NAME), Vec::new());
        let file = open_file(&path);
        let read = file.and_then(|file| BufReader::new(file).take(MOST_HEAD_BYTES).read_until(b'\n', &mut line));
        match read {
            Ok(_) => Ok(serde_json::from_slice(&line).unwrap_or_default()),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Self::default()),
            Err(error) => Err(PackError::Io { path, error }),
        }
    }
}

impl Head {
    /// Checks that the pack in a directory has these settings.
    ///
    /// # Errors
    /// If it has other data or settings.
    pub(crate) fn may_resume(&self, store: &Path, settings: &Value) -> Result<(), PackError> {
        difference(&self.settings, settings)
            .map_or(Ok(()), |difference| Err(PackError::Mismatch { store: store.into(), difference }))
    }
}

/// A head has some hundred bytes and the source's name.
const MOST_HEAD_BYTES: u64 = 16 << 20;

/// A shard's line: two numbers and a path of numbers.
const MOST_LINE_BYTES: u64 = 128;

impl<'a> Journal<'a> {
    /// A journal without records, for an appended step, which is remade after an interruption.
    pub(crate) fn none(disk: &'a Disk, store: &Path) -> Self {
        Self::new(disk, store, None, Head::default())
    }

    fn new(disk: &'a Disk, store: &Path, file: Option<File>, head: Head) -> Self {
        Self { disk, store: store.into(), file, head, finished: HashMap::new(), unsynced_since: None }
    }

    fn path(&self) -> PathBuf {
        self.store.join(JOURNAL_NAME)
    }

    /// Starts a journal in a store directory, replacing any existing one.
    pub(crate) fn create(disk: &'a Disk, store: &Path, head: Head) -> Result<Self, DiskError> {
        let path = store.join(JOURNAL_NAME);
        disk.write(&path, format!("{}\n{}", json!(head), first_line(disk)).as_bytes())?;
        disk.sync_dir(store)?;
        Ok(Self::new(disk, store, Some(disk.reopen(&path)?), head))
    }

    /// Opens the journal of an unfinished pack, and reads its head.
    pub(crate) fn open(disk: &'a Disk, store: &Path) -> Result<Self, PackError> {
        let file = disk.reopen(&store.join(JOURNAL_NAME))?;
        Ok(Self::new(disk, store, Some(file), Head::of(store)?))
    }

    /// The settings' fingerprint of the store to be replaced, if any.
    pub(crate) fn replaces(&self) -> Option<&str> {
        self.head.replaces.as_deref()
    }

    /// Reads the finished shards, and continues at the journal's end. Shards that differ from their records are
    /// unfinished.
    ///
    /// # Errors
    /// If the pack has other data or settings, or the journal cannot be read or written.
    pub(crate) fn resume(&mut self, settings: &Value) -> Result<(), PackError> {
        self.head.may_resume(&self.store, settings)?;
        let most = MOST_HEAD_BYTES + MOST_LINE_BYTES.saturating_mul(self.head.shards);
        let text = read_at_most(open_file(&self.path()), most);
        let text = text.map_err(|error| PackError::Io { path: self.path(), error })?;
        let text = String::from_utf8_lossy(&text);
        let lines = text.split_once('\n').map_or("", |(_, lines)| lines);
        let complete = lines.rfind('\n').map_or(0, |end| end + 1);
        self.finished = believed(&self.store, &lines[..complete]);
        if complete < lines.len() {
            // Ends a torn last line, in a way no shard's line ends, so the next one starts afresh.
            self.append(b" torn\n")?;
        }
        self.append(first_line(self.disk).as_bytes())?;
        // Must precede any shard's line, which would otherwise count as synced.
        Ok(self.file.as_ref().map_or(Ok(()), |file| self.disk.sync(&self.path(), file))?)
    }

    /// Takes a shard for one finished by an earlier run, without a record.
    pub(crate) fn adopt(&mut self, layout: &Layout, shard: ShardId, fingerprint: Fingerprint) {
        self.finished.insert(layout.shard_path(Path::new(""), shard), fingerprint);
    }

    /// The fingerprint of a shard finished by an earlier run, if any.
    pub(crate) fn finished(&self, layout: &Layout, shard: ShardId) -> Option<Fingerprint> {
        self.finished.get(&layout.shard_path(Path::new(""), shard)).copied()
    }

    /// Number of shards finished by earlier runs.
    pub(crate) fn finished_count(&self) -> u64 {
        self.finished.len() as u64
    }

    /// Renames a finished shard of this layout to its final name and records it: synced by itself first, or
    /// later with all others if the disk syncs as one. Returns `false` if an earlier run did.
    pub(crate) fn settle(&mut self, layout: &Layout, shard: &Finished) -> Result<bool, DiskError> {
        if shard.done_before {
            return Ok(false);
        }
        if shard.fingerprint.has_file() {
            let path = layout.shard_path(&self.store, shard.id);
            if !self.disk.syncs_as_one() {
                let temporary = temporary(&path);
                let file = self.disk.reopen(&temporary)?;
                self.disk.sync(&temporary, &file)?;
            }
            self.disk.name(&path)?;
        }
        let Fingerprint { file_bytes, index_crc } = shard.fingerprint;
        let path = layout.shard_path(Path::new(""), shard.id);
        self.append(format!("{file_bytes} {index_crc:08x} {}\n", path.display()).as_bytes())?;
        let since = *self.unsynced_since.get_or_insert_with(Instant::now);
        if since.elapsed() >= SYNC_INTERVAL {
            self.sync()?;
        }
        Ok(true)
    }

    /// Makes the recorded shards durable, unless they are synced one by one.
    pub(crate) fn sync(&mut self) -> Result<(), DiskError> {
        if self.file.is_some() && self.disk.syncs_as_one() && self.unsynced_since.take().is_some() {
            self.disk.sync_parts(&self.store, [])?;
            self.append(b" synced\n")?;
        }
        Ok(())
    }

    fn append(&mut self, bytes: &[u8]) -> Result<(), DiskError> {
        let path = self.path();
        self.file.as_mut().map_or(Ok(()), |file| self.disk.append(&path, file, bytes))
    }
}

/// The line before shards synced together; empty if each is synced before it is recorded.
fn first_line(disk: &Disk) -> &'static str {
    if disk.syncs_as_one() { " unsynced\n" } else { "" }
}

/// The shards in these lines with durable files.
fn believed(store: &Path, lines: &str) -> HashMap<PathBuf, Fingerprint> {
    let (mut believed, mut noted) = (HashMap::new(), Vec::new());
    // Without a mark, each was synced.
    let mut lasts = true;
    for line in lines.lines() {
        match line {
            " unsynced" | " synced" => {
                let noted = noted.drain(..);
                if lasts || line == " synced" {
                    believed.extend(noted);
                }
                lasts = false;
            }
            line => noted.extend(parse(store, line)),
        }
    }
    believed.extend(noted.into_iter().filter(|_| lasts));
    believed
}

fn parse(store: &Path, line: &str) -> Option<(PathBuf, Fingerprint)> {
    let mut words = line.splitn(3, ' ');
    let file_bytes = words.next()?.parse().ok()?;
    let index_crc = u64::from_str_radix(words.next()?, 16).ok()?;
    let path = PathBuf::from(words.next()?);
    let fingerprint = Fingerprint { file_bytes, index_crc };
    (!fingerprint.has_file() || on_disk(&store.join(&path)) == Some(fingerprint)).then_some((path, fingerprint))
}

/// The fingerprint of a shard's file; `None` if it cannot be read.
pub(crate) fn on_disk(path: &Path) -> Option<Fingerprint> {
    let mut file = open_file(path).ok()?;
    let file_bytes = file.metadata().ok()?.len();
    let mut crc = [0; 4];
    file.seek(SeekFrom::End(-4)).ok()?;
    file.read_exact(&mut crc).ok()?;
    Some(Fingerprint { file_bytes, index_crc: u32::from_le_bytes(crc) as u64 })
}

/// The first differing setting, in words.
fn difference(then: &Value, now: &Value) -> Option<String> {
    let (Some(then), Some(now)) = (then.as_object(), now.as_object()) else {
        return Some("its journal cannot be read".into());
    };
    let names = now.keys().chain(then.keys());
    let value = |of: &serde_json::Map<String, Value>, name| of.get(name).cloned().unwrap_or_default();
    let mut pairs = names.map(|name| (name, value(then, name), value(now, name)));
    pairs.find(|(_, then, now)| then != now).map(|(name, then, now)| format!("{name} was {then}, now {now}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_first_line_beyond_all_bounds_is_no_head() {
        let store = tempfile::tempdir().unwrap();
        for (blanks, expected) in [(100, 7), (MOST_HEAD_BYTES as usize, 0)] {
            let line = format!(r#"{{"replaces": null, "settings": {{}}, "shards": 7{}}}"#, " ".repeat(blanks));
            std::fs::write(store.path().join(JOURNAL_NAME), line + "\n").unwrap();
            assert_eq!(Head::of(store.path()).unwrap().shards, expected);
        }
    }

    #[test]
    fn only_what_lasts_is_believed() {
        let names = |lines: &[&str]| {
            let lines = lines.iter().map(|line| match *line {
                "unsynced" | "synced" => format!(" {line}\n"),
                // All fill: there is no file to check.
                name => format!("0 00000000 {name}\n"),
            });
            let found = believed(Path::new("/nowhere"), &lines.collect::<String>());
            let mut names: Vec<_> = found.keys().map(|path| path.to_str().unwrap().to_owned()).collect();
            names.sort();
            names.join(" ")
        };
        assert_eq!(names(&["a", "b"]), "a b", "synced one by one");
        assert_eq!(names(&["unsynced", "a"]), "");
        assert_eq!(names(&["unsynced", "a", "synced", "b"]), "a");
        assert_eq!(names(&["a", "unsynced", "b", "unsynced", "c", "synced"]), "a c");
        assert_eq!(names(&["unsynced", "a", "synced", "unsynced", "b"]), "a");
    }
}
