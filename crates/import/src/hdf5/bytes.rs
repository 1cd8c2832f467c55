//! A file's bytes for the parser of its structures: mapped, so that they cost nothing, and metered, since damaged structures can refer to
//! one another without end.

use crate::mapped::MappedFile;
use hdf5_reader::error::{Error, Result};
use hdf5_reader::{Storage, StorageBuffer};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

/// Bytes read more often than the whole file before the structures count as circular, and the cost of each read.
const SLACK_BYTES: u64 = 256 << 20;
const READ_BYTES: u64 = 64;

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
}

impl Bytes {
    pub(super) fn new(file: Arc<MappedFile>) -> Self {
        let left = (file.len() as u64).saturating_mul(4).saturating_add(SLACK_BYTES);
        Self { owner: Arc::new(Owner(file)), left: AtomicU64::new(left) }
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
        StorageBuffer::from_shared_owner(self.owner.clone(), start, len)
    }
}
