//! Writer of a stage's bricks, in order, to shard files: appended under a temporary name, finished with an index,
//! renamed by a separate thread, and recorded in the journal.
//!
//! A shard of several layers of bricks, or time steps, stays open in memory (its index so far), not as a file: one file
//! per stage is open at a time.
//!
//! In shards of several time steps, equal bricks are stored once, with a shared range in the index. Hashes find them;
//! reading the file confirms them.

use crate::layout::{Layout, ShardId};
use crate::pack::disk::{Disk, DiskError, temporary};
use crate::shard::{BrickRange, Fingerprint, encode_index, index_bytes};
use brickyard_volume::{BrickId, Level};
use std::collections::HashMap;
use std::fs::File;
use std::io;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};

/// A shard with all bricks appended, before [`Journal::settle`](crate::pack::journal::Journal::settle) makes it
/// durable.
pub(crate) struct Finished {
    pub(crate) id: ShardId,
    pub(crate) fingerprint: Fingerprint,
    /// Made by an earlier run: nothing to do.
    pub(crate) done_before: bool,
}

/// The stored form of a brick.
#[derive(Clone, Copy)]
pub(crate) struct Encoded<'a> {
    pub(crate) bytes: &'a [u8],
    /// The hash of the decoded bytes.
    pub(crate) hash: u128,
}

/// Memory of a level's open shard, in bytes.
pub(crate) fn open_bytes(layout: &Layout, level: Level) -> u64 {
    let slots = layout.shard_slots(level) as u64;
    let known = if layout.shard_times > 1 { table_bytes(slots) } else { 0 };
    slots * size_of::<Option<BrickRange>>() as u64 + known
}

/// Additional memory of a level's shard while it is finished, one at a time: its index, in bytes.
pub(crate) fn finishing_bytes(layout: &Layout, level: Level) -> u64 {
    index_bytes(layout.shard_slots(level)) as u64
}

/// Most bytes of a [`Known`] for `bricks` bricks: a power of two of places, at least an eighth free, with a byte each.
fn table_bytes(bricks: u64) -> u64 {
    let places = (bricks * 8 / 7 + 1).next_power_of_two().max(16);
    places * (size_of::<(u64, u32)>() as u64 + 1) + 64
}

/// The first index entry for each content, by half of the content's hash.
type Known = HashMap<u64, u32>;

struct OpenShard {
    ranges: Vec<Option<BrickRange>>,
    length: u64,
    /// Bricks inside the grid still to come.
    missing: usize,
    done_before: Option<Fingerprint>,
    /// `None` in a shard of one time step: each brick has bytes of its own.
    known: Option<Known>,
}

impl OpenShard {
    fn new(layout: &Layout, id: ShardId, done_before: Option<Fingerprint>) -> Self {
        let slots = layout.shard_slots(id.level);
        let stored = if done_before.is_some() { 0 } else { slots };
        Self {
            ranges: vec![None; stored],
            length: 0,
            missing: (0..slots).filter(|&slot| layout.brick_at(id, slot).is_some()).count(),
            done_before,
            known: (layout.shard_times > 1).then(|| Known::with_capacity(stored)),
        }
    }

    /// The range of equally long bytes from a brick with the same hash, if any.
    fn candidate(&self, encoded: Encoded) -> Option<BrickRange> {
        let slot = *self.known.as_ref()?.get(&(encoded.hash as u64))?;
        self.ranges[slot as usize].filter(|range| range.length == encoded.bytes.len() as u64)
    }
}

pub(crate) struct ShardWriter<'a> {
    disk: &'a Disk,
    store: &'a Path,
    layout: &'a Layout,
    open: HashMap<ShardId, OpenShard>,
    /// The file of the last brick.
    file: Option<(ShardId, PathBuf, File)>,
    /// Bytes appended to shard files, including indexes.
    pub(crate) written_bytes: u64,
}

impl<'a> ShardWriter<'a> {
    pub(crate) fn new(disk: &'a Disk, store: &'a Path, layout: &'a Layout) -> Self {
        Self { disk, store, layout, open: HashMap::new(), file: None, written_bytes: 0 }
    }

    /// Adds the next brick's encoded bytes, or `None` if it is all fill or its shard is `done_before`. Returns the
    /// shard after its last brick. After an error the shard is lost.
    pub(crate) fn add(
        &mut self,
        id: BrickId,
        encoded: Option<Encoded>,
        done_before: impl FnOnce(ShardId) -> Option<Fingerprint>,
    ) -> Result<Option<Finished>, DiskError> {
        let (shard_id, slot) = self.layout.shard_of(id);
        let open = self.open.remove(&shard_id);
        let mut shard = open.unwrap_or_else(|| OpenShard::new(self.layout, shard_id, done_before(shard_id)));
        shard.missing -= 1;
        if let Some(encoded) = encoded.filter(|_| shard.done_before.is_none()) {
            let range = match self.find(shard_id, &shard, encoded)? {
                Some(range) => range,
                None => self.put(shard_id, &mut shard, slot, encoded)?,
            };
            shard.ranges[slot] = Some(range);
        }
        if shard.missing == 0 {
            return self.finish(shard_id, shard).map(Some);
        }
        self.open.insert(shard_id, shard);
        Ok(None)
    }

    /// The existing range of a brick's bytes in its shard, if any.
    fn find(&mut self, id: ShardId, shard: &OpenShard, encoded: Encoded) -> Result<Option<BrickRange>, DiskError> {
        let Some(range) = shard.candidate(encoded) else { return Ok(None) };
        let (path, file) = self.file(id, false)?;
        let is_same = holds(file, range.offset, encoded.bytes);
        let is_same = is_same.map_err(|error| DiskError { path: path.clone(), error })?;
        Ok(is_same.then_some(range))
    }

    /// Appends the bytes of the brick of entry `slot`. Returns their range.
    fn put(
        &mut self,
        id: ShardId,
        shard: &mut OpenShard,
        slot: usize,
        encoded: Encoded,
    ) -> Result<BrickRange, DiskError> {
        let range = BrickRange { offset: shard.length, length: encoded.bytes.len() as u64 };
        self.append(id, shard.length == 0, encoded.bytes)?;
        shard.length += range.length;
        if let Some(known) = &mut shard.known {
            known.entry(encoded.hash as u64).or_insert(slot as u32);
        }
        Ok(range)
    }

    fn finish(&mut self, id: ShardId, shard: OpenShard) -> Result<Finished, DiskError> {
        if let Some(fingerprint) = shard.done_before {
            return Ok(Finished { id, fingerprint, done_before: true });
        }
        if shard.length == 0 {
            return Ok(Finished { id, fingerprint: Fingerprint::default(), done_before: false });
        }
        let (index, crc) = encode_index(&shard.ranges);
        self.append(id, false, &index)?;
        self.file = None;
        let file_bytes = shard.length + index.len() as u64;
        Ok(Finished { id, fingerprint: Fingerprint { file_bytes, index_crc: crc as u64 }, done_before: false })
    }

    fn append(&mut self, id: ShardId, is_first: bool, bytes: &[u8]) -> Result<(), DiskError> {
        let disk = self.disk;
        let (path, file) = self.file(id, is_first)?;
        disk.append(path, file, bytes)?;
        self.written_bytes += bytes.len() as u64;
        Ok(())
    }

    /// A shard's file under its temporary name, opened if needed; created anew if `is_first`.
    fn file(&mut self, id: ShardId, is_first: bool) -> Result<(&PathBuf, &mut File), DiskError> {
        let is_open = self.file.as_ref().is_some_and(|(open, ..)| *open == id);
        let (_, path, file) = match self.file.take() {
            Some(open) if is_open => self.file.insert(open),
            _ => {
                let path = temporary(&self.layout.shard_path(self.store, id));
                let file = if is_first {
                    // Only the first shard of a row finds its directory missing.
                    self.disk.create_parent(&path)?;
                    self.disk.create(&path)?
                } else {
                    self.disk.reopen(&path)?
                };
                self.file.insert((id, path, file))
            }
        };
        Ok((path, file))
    }
}

/// Whether a file has these bytes at an offset.
fn holds(file: &File, offset: u64, bytes: &[u8]) -> io::Result<bool> {
    let mut buffer = [0; 16 << 10];
    let mut at = offset;
    for piece in bytes.chunks(buffer.len()) {
        let found = &mut buffer[..piece.len()];
        file.read_exact_at(found, at)?;
        if found != piece {
            return Ok(false);
        }
        at += piece.len() as u64;
    }
    Ok(true)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tables_are_no_larger_than_is_said() {
        for bricks in (0..5000).chain([7 << 13, (7 << 13) + 1, 1 << 20]) {
            let table = Known::with_capacity(bricks as usize);
            // An eighth of the places stays free, of few places one.
            let places = (table.capacity() as u64 * 8 / 7).next_power_of_two();
            let bytes = places * (size_of::<(u64, u32)>() as u64 + 1);
            assert!(bytes <= table_bytes(bricks) && table_bytes(bricks) <= 40 * bricks + 400, "{bricks}: {bytes}");
        }
    }
}
