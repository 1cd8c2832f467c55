//! Shards: files of inner chunks, each coded alone, behind or before an index of their places. The index costs 16 bytes for each inner chunk.

use super::chunk_file::ChunkFile;
use super::codecs::checked;
use crate::element::Endian;
use crate::error::Result;

const ENTRY_BYTES: u64 = 16;
const CRC_BYTES: u64 = 4;

/// Most bytes of an index: sixteen million inner chunks.
const MOST_INDEX_BYTES: u64 = 256 << 20;

/// Where a shard has its index, and how it is written.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Shard {
    /// The array's axes in the order of the index, slowest first.
    pub(super) order: Vec<usize>,
    pub(super) is_at_start: bool,
    pub(super) endian: Endian,
    /// Whether a crc32c is behind the entries.
    pub(super) has_checksum: bool,
}

impl Shard {
    /// Bytes of the index of so many inner chunks; `None` for too many.
    pub(super) fn index_bytes(&self, chunks: u64) -> Option<u64> {
        let entries = chunks.checked_mul(ENTRY_BYTES)?;
        let bytes = entries + if self.has_checksum { CRC_BYTES } else { 0 };
        (bytes <= MOST_INDEX_BYTES).then_some(bytes)
    }

    /// Reads a shard's index, of some bytes.
    pub(super) fn read_index(&self, file: &mut ChunkFile, bytes: u64) -> Result<Vec<u8>> {
        let Some(last) = file.bytes().checked_sub(bytes) else {
            let problem = format!("cut short: expected an index of {bytes} bytes, found {} in all", file.bytes());
            return Err(file.damaged(&problem));
        };
        let mut index = vec![0; bytes as usize];
        file.read(if self.is_at_start { 0 } else { last }, &mut index)?;
        if self.has_checksum {
            let entries = checked(&index).map_err(|problem| file.damaged(&format!("the shard's index: {problem}")))?;
            index.truncate(entries.len());
        }
        Ok(index)
    }

    /// Number of an inner chunk in the index, by its place in the shard.
    pub(super) fn number_of(&self, place: &[u64], counts: &[u64]) -> u64 {
        self.order.iter().fold(0, |number, axis| number * counts[*axis] + place[*axis])
    }

    /// First byte and length of an inner chunk; `None` if it was never written.
    pub(super) fn entry(&self, index: &[u8], number: u64) -> Option<[u64; 2]> {
        let entry = index.as_chunks::<8>().0.get(2 * number as usize..)?;
        let [start, bytes] = [entry.first()?, entry.get(1)?].map(|word| match self.endian {
            Endian::Little => u64::from_le_bytes(*word),
            Endian::Big => u64::from_be_bytes(*word),
        });
        ([start, bytes] != [u64::MAX; 2]).then_some([start, bytes])
    }
}
