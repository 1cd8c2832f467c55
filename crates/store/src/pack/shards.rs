//! Writes a stage's bricks, in their order, to their shards' files: appended under a temporary name as they come, finished
//! with an index, synced and renamed by a thread of its own, then noted in the journal.
//!
//! A shard that spans several layers of bricks stays open as a place in memory (its index so far), not as a file: one
//! file a stage is open at a time.

use crate::layout::{Layout, ShardId};
use crate::pack::disk::{Disk, DiskError, temporary};
use crate::pack::journal::Journal;
use crate::shard::{BrickRange, Fingerprint, encode_index};
use brickyard_volume::BrickId;
use std::collections::HashMap;
use std::fs::File;
use std::path::{Path, PathBuf};

/// A shard whose bricks have all been appended, before [`settle`] makes it durable.
pub(crate) struct Finished {
    pub(crate) id: ShardId,
    pub(crate) fingerprint: Fingerprint,
    /// An earlier run made it: nothing to do.
    done_before: bool,
}

/// Bytes kept in memory per brick of a shard that is being written.
pub(crate) const OPEN_BYTES_PER_BRICK: usize = size_of::<Option<BrickRange>>();

struct OpenShard {
    ranges: Vec<Option<BrickRange>>,
    length: u64,
    /// Bricks inside the grid that are still to come.
    missing: usize,
    done_before: Option<Fingerprint>,
}

pub(crate) struct ShardWriter<'a> {
    disk: &'a Disk,
    store: &'a Path,
    layout: &'a Layout,
    open: HashMap<ShardId, OpenShard>,
    /// The file that the last brick went to.
    file: Option<(ShardId, PathBuf, File)>,
    /// Bytes that were appended to shard files, indexes included.
    pub(crate) written_bytes: u64,
}

impl<'a> ShardWriter<'a> {
    pub(crate) fn new(disk: &'a Disk, store: &'a Path, layout: &'a Layout) -> Self {
        Self { disk, store, layout, open: HashMap::new(), file: None, written_bytes: 0 }
    }

    /// Adds the next brick: its encoded bytes, or `None` if it is all fill or its shard is `done_before`. Returns the
    /// shard if this was its last brick; `None` if not.
    pub(crate) fn add(
        &mut self,
        id: BrickId,
        encoded: Option<&[u8]>,
        done_before: impl FnOnce(ShardId) -> Option<Fingerprint>,
    ) -> Result<Option<Finished>, DiskError> {
        let (shard_id, slot) = self.layout.shard_of(id);
        let layout = self.layout;
        let shard = self.open.entry(shard_id).or_insert_with(|| {
            let slots = layout.shard_bricks(shard_id.level).volume() as usize;
            OpenShard {
                ranges: vec![None; slots],
                length: 0,
                missing: (0..slots).filter(|&slot| layout.brick_at(shard_id, slot).is_some()).count(),
                done_before: done_before(shard_id),
            }
        });
        shard.missing -= 1;
        let is_last = shard.missing == 0;
        if let Some(encoded) = encoded.filter(|_| shard.done_before.is_none()) {
            shard.ranges[slot] = Some(BrickRange { offset: shard.length, length: encoded.len() as u64 });
            let is_first = shard.length == 0;
            shard.length += encoded.len() as u64;
            self.append(shard_id, is_first, encoded)?;
        }
        if !is_last {
            return Ok(None);
        }
        match self.open.remove(&shard_id) {
            Some(shard) => self.finish(shard_id, shard).map(Some),
            None => Ok(None),
        }
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
        if self.file.as_ref().is_none_or(|(open, ..)| *open != id) {
            let path = temporary(&self.layout.shard_path(self.store, id));
            let file = if is_first {
                // Only the first shard of a row finds its directory missing.
                let parent = path.parent().filter(|parent| !parent.exists());
                parent.map_or(Ok(()), |parent| self.disk.create_dir_all(parent))?;
                self.disk.create(&path)?
            } else {
                self.disk.reopen(&path)?
            };
            self.file = Some((id, path, file));
        }
        if let Some((_, path, file)) = &mut self.file {
            self.disk.append(path, file, bytes)?;
        }
        self.written_bytes += bytes.len() as u64;
        Ok(())
    }
}

/// Makes a finished shard durable: syncs it, renames it, and notes it in the journal. Returns false if an earlier run
/// did that.
pub(crate) fn settle(
    disk: &Disk,
    store: &Path,
    layout: &Layout,
    journal: &mut Journal,
    shard: &Finished,
) -> Result<bool, DiskError> {
    if shard.done_before {
        return Ok(false);
    }
    if shard.fingerprint.has_file() {
        let path = layout.shard_path(store, shard.id);
        let temporary = temporary(&path);
        let file = disk.reopen(&temporary)?;
        disk.sync(&temporary, &file)?;
        disk.rename(&temporary, &path)?;
    }
    journal.add(disk, &layout.shard_path(Path::new(""), shard.id), shard.fingerprint)?;
    Ok(true)
}
