//! The journal of an unfinished pack: what is packed how, then one line per finished shard.
//!
//! ```text
//! {"replaces": null, "settings": {...}, "shards": 24}
//! 1234567 89abcdef 0/c/0/0/0          length, checksum of the index, path below the store; "0 00000000 path" if all fill
//! ```
//!
//! A line is believed only if it is complete and the shard's file is there with that length and checksum: so lines and
//! renames may reach the disk in any order, and the journal is never synced. Only who has the directory's lock touches it.
//!
//! `replaces` is the settings' fingerprint of the finished store whose place the pack is to take, if there is one.

use crate::layout::{JOURNAL_NAME, Layout, ShardId};
use crate::pack::PackError;
use crate::pack::disk::{Disk, DiskError};
use crate::shard::Fingerprint;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use std::collections::HashMap;
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

pub(crate) struct Journal {
    path: PathBuf,
    /// `None` where nothing is noted.
    file: Option<File>,
    head: Head,
    /// Shards finished by earlier runs, by path below the store.
    finished: HashMap<PathBuf, Fingerprint>,
}

/// A journal's first line.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub(crate) struct Head {
    pub(crate) replaces: Option<String>,
    pub(crate) settings: Value,
    pub(crate) shards: u64,
}

impl Head {
    /// Reads the head of the journal in a directory. It is empty if there is no journal, or if the journal's first line
    /// is not a head.
    ///
    /// # Errors
    /// If the journal is there and cannot be read.
    pub(crate) fn of(store: &Path) -> Result<Self, PackError> {
        let (path, mut line) = (store.join(JOURNAL_NAME), Vec::new());
        let file = File::open(&path);
        let read = file.and_then(|file| BufReader::new(file).take(MOST_HEAD_BYTES).read_until(b'\n', &mut line));
        match read {
            Ok(_) => Ok(serde_json::from_slice(&line).unwrap_or_default()),
            Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(Self::default()),
            Err(error) => Err(PackError::Io { path, error }),
        }
    }
}

/// A head is some hundred bytes and the source's name.
const MOST_HEAD_BYTES: u64 = 16 << 20;

impl Journal {
    /// A journal that notes nothing: of a step that is appended, which is made anew where it was cut off.
    pub(crate) fn none() -> Self {
        Self { path: PathBuf::new(), file: None, head: Head::default(), finished: HashMap::new() }
    }

    /// Starts a journal in a store directory, and replaces the journal that is there, if any.
    pub(crate) fn create(disk: &Disk, store: &Path, head: Head) -> Result<Self, DiskError> {
        let path = store.join(JOURNAL_NAME);
        disk.write(&path, format!("{}\n", json!(head)).as_bytes())?;
        disk.sync_dir(store)?;
        Ok(Self { file: Some(disk.reopen(&path)?), path, head, finished: HashMap::new() })
    }

    /// Opens the journal of an unfinished pack, and reads its head.
    pub(crate) fn open(disk: &Disk, store: &Path) -> Result<Self, PackError> {
        let path = store.join(JOURNAL_NAME);
        Ok(Self { file: Some(disk.reopen(&path)?), path, head: Head::of(store)?, finished: HashMap::new() })
    }

    /// The settings' fingerprint of the finished store that the pack is to replace; `None` if it replaces none.
    pub(crate) fn replaces(&self) -> Option<&str> {
        self.head.replaces.as_deref()
    }

    /// Reads which shards are finished, and goes on where the journal ends. A shard whose file is not as the journal
    /// says counts as unfinished.
    ///
    /// # Errors
    /// If the pack was one of other data or with other settings, or the journal cannot be read or written.
    pub(crate) fn resume(&mut self, disk: &Disk, store: &Path, settings: &Value) -> Result<(), PackError> {
        let text = std::fs::read(&self.path).map_err(|error| PackError::Io { path: self.path.clone(), error })?;
        let text = String::from_utf8_lossy(&text);
        let lines = text.split_once('\n').map_or("", |(_, lines)| lines);
        if let Some(difference) = difference(&self.head.settings, settings) {
            return Err(PackError::Mismatch { store: store.into(), difference });
        }
        let complete = lines.rfind('\n').map_or(0, |end| end + 1);
        self.finished = lines[..complete].lines().filter_map(|line| parse(store, line)).collect();
        if complete < lines.len() {
            // A torn last line: end it, so that the next one starts afresh, in a way that no shard's line ends.
            self.append(disk, b" torn\n")?;
        }
        Ok(())
    }

    /// The fingerprint of a shard that an earlier run finished; `None` if no run did.
    pub(crate) fn finished(&self, layout: &Layout, shard: ShardId) -> Option<Fingerprint> {
        self.finished.get(&layout.shard_path(Path::new(""), shard)).copied()
    }

    /// How many shards earlier runs finished.
    pub(crate) fn finished_count(&self) -> u64 {
        self.finished.len() as u64
    }

    /// Notes a finished shard, whose file is at `path` below the store.
    pub(crate) fn add(&mut self, disk: &Disk, path: &Path, fingerprint: Fingerprint) -> Result<(), DiskError> {
        let Fingerprint { file_bytes, index_crc } = fingerprint;
        let line = format!("{file_bytes} {index_crc:08x} {}\n", path.display());
        self.append(disk, line.as_bytes())
    }

    fn append(&mut self, disk: &Disk, bytes: &[u8]) -> Result<(), DiskError> {
        self.file.as_mut().map_or(Ok(()), |file| disk.append(&self.path, file, bytes))
    }
}

fn parse(store: &Path, line: &str) -> Option<(PathBuf, Fingerprint)> {
    let mut words = line.splitn(3, ' ');
    let file_bytes = words.next()?.parse().ok()?;
    let index_crc = u64::from_str_radix(words.next()?, 16).ok()?;
    let path = PathBuf::from(words.next()?);
    let fingerprint = Fingerprint { file_bytes, index_crc };
    (!fingerprint.has_file() || on_disk(&store.join(&path)) == Some(fingerprint)).then_some((path, fingerprint))
}

/// The fingerprint of a shard's file.
fn on_disk(path: &Path) -> Option<Fingerprint> {
    let mut file = File::open(path).ok()?;
    let file_bytes = file.metadata().ok()?.len();
    let mut crc = [0; 4];
    file.seek(SeekFrom::End(-4)).ok()?;
    file.read_exact(&mut crc).ok()?;
    Some(Fingerprint { file_bytes, index_crc: u32::from_le_bytes(crc) as u64 })
}

/// The first setting that differs, in words.
fn difference(then: &Value, now: &Value) -> Option<String> {
    let (Some(then), Some(now)) = (then.as_object(), now.as_object()) else {
        return Some("its journal cannot be read".into());
    };
    let names = now.keys().chain(then.keys());
    let value = |of: &serde_json::Map<String, Value>, name| of.get(name).cloned().unwrap_or_default();
    let mut pairs = names.map(|name| (name, value(then, name), value(now, name)));
    pairs.find(|(_, then, now)| then != now).map(|(name, then, now)| format!("{name} was {then}, now {now}"))
}
