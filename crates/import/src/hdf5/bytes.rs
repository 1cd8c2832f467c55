//! A file's bytes for the parser of its structures: mapped, so that they cost nothing, and metered, since damaged structures can refer to
//! one another without end.

use crate::mapped::MappedFile;
use hdf5_reader::error::{Error, Result};
use hdf5_reader::{Storage, StorageBuffer};
use std::collections::BTreeMap;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, RwLock};

/// Bytes read more often than the whole file before the structures count as circular, and the cost of each read.
const SLACK_BYTES: u64 = 256 << 20;
const READ_BYTES: u64 = 64;
/// Most bytes held in place of the file's own.
const MOST_REPLACED_BYTES: usize = 64 << 20;

/// The mapped file as the owner of lent bytes.
struct Owner(Arc<MappedFile>);

impl AsRef<[u8]> for Owner {
    fn as_ref(&self) -> &[u8] {
        &self.0
    }
}

pub(super) struct Bytes {
    owner: Arc<Owner>,
    left: AtomicU64,
    /// Bytes read in place of the file's own, by their place; they do not overlap.
    replaced: RwLock<BTreeMap<u64, Vec<u8>>>,
}

impl Bytes {
    pub(super) fn new(file: Arc<MappedFile>) -> Self {
        let left = (file.len() as u64).saturating_mul(4).saturating_add(SLACK_BYTES);
        Self { owner: Arc::new(Owner(file)), left: AtomicU64::new(left), replaced: RwLock::default() }
    }

    /// Has the parser read these bytes from this place on.
    ///
    /// # Errors
    /// If some of the place is replaced already, or too much.
    pub(super) fn replace(&self, at: u64, bytes: Vec<u8>) -> Result<()> {
        let mut replaced = self.replaced.write().unwrap_or_else(|poisoned| poisoned.into_inner());
        let end = at.saturating_add(bytes.len() as u64);
        let before = replaced.range(..end).next_back().map(|(start, bytes)| start.saturating_add(bytes.len() as u64));
        let held: usize = replaced.values().map(Vec::len).sum();
        if before.is_some_and(|before| before > at) || held.saturating_add(bytes.len()) > MOST_REPLACED_BYTES {
            return Err(Error::InvalidData("headers of objects that overlap, or are too long".into()));
        }
        replaced.insert(at, bytes);
        Ok(())
    }

    /// The bytes of a range, where some are replaced.
    fn mended(&self, start: u64, own: &[u8]) -> Option<Vec<u8>> {
        let replaced = self.replaced.read().unwrap_or_else(|poisoned| poisoned.into_inner());
        let end = start.saturating_add(own.len() as u64);
        let mut mended = None;
        for (at, bytes) in replaced.range(..end).rev() {
            let (from, to) = ((*at).max(start), at.saturating_add(bytes.len() as u64).min(end));
            if from >= to {
                break;
            }
            let mended = mended.get_or_insert_with(|| own.to_vec());
            let (into, of, count) = ((from - start) as usize, (from - at) as usize, (to - from) as usize);
            mended[into..into + count].copy_from_slice(&bytes[of..of + count]);
        }
        mended
    }
}

impl Storage for Bytes {
    fn len(&self) -> u64 {
        self.owner.0.len() as u64
    }

    fn read_range(&self, offset: u64, len: usize) -> Result<StorageBuffer> {
        let cost = (len as u64).saturating_add(READ_BYTES);
        let pay = |left: u64| left.checked_sub(cost);
        if self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, pay).is_err() {
            return Err(Error::InvalidData("its structures refer to one another without end".into()));
        }
        let start = usize::try_from(offset).map_err(|_| Error::OffsetOutOfBounds(offset))?;
        let own = StorageBuffer::from_shared_owner(self.owner.clone(), start, len)?;
        Ok(self.mended(offset, &own).map_or(own, StorageBuffer::from_vec))
    }
}
