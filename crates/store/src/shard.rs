//! The frame of a shard file: encoded bricks back to back, then the index, then the index's crc32c.
//!
//! The index is two little-endian u64 per brick, offset and length, row-major; both are 2^64 - 1 for an absent brick
//! (all fill value). Equal bricks may share a range. Nothing is trusted: the checksum is compared first, and every
//! range must lie before the index and within the length limit of encoded bricks.

use crate::error::ShardError;
use bytemuck::{Pod, Zeroable};

/// Marks an absent brick.
const EMPTY: u64 = u64::MAX;

/// Identifies the packed shard file. Both fields are zero without a file (all bricks empty).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Fingerprint {
    /// Length of the file in bytes.
    pub file_bytes: u64,
    /// The crc32c of the index, also the file's last four bytes.
    pub index_crc: u64,
}

impl Fingerprint {
    /// Whether the shard has a file.
    pub const fn has_file(self) -> bool {
        self.file_bytes != 0
    }
}

/// The range of an encoded brick in its shard file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BrickRange {
    /// Bytes from the start of the file to the brick.
    pub offset: u64,
    /// Length of the encoded brick in bytes.
    pub length: u64,
}

impl BrickRange {
    /// The range as byte indices into the whole file.
    pub fn as_range(self) -> std::ops::Range<usize> {
        self.offset as usize..(self.offset + self.length) as usize
    }
}

/// Bytes of a shard's index for `bricks` bricks, checksum included.
pub const fn index_bytes(bricks: usize) -> usize {
    bricks * 16 + 4
}

/// Encodes a shard's index. Returns its bytes, checksum included, and the checksum. `None` is an absent brick.
pub fn encode_index(ranges: &[Option<BrickRange>]) -> (Vec<u8>, u32) {
    let mut index = Vec::with_capacity(index_bytes(ranges.len()));
    for range in ranges {
        let range = range.unwrap_or(BrickRange { offset: EMPTY, length: EMPTY });
        index.extend_from_slice(&range.offset.to_le_bytes());
        index.extend_from_slice(&range.length.to_le_bytes());
    }
    let crc = crc32c::crc32c(&index);
    index.extend_from_slice(&crc.to_le_bytes());
    (index, crc)
}

/// The index of a shard, borrowed from the end of its file.
#[derive(Clone, Copy, Debug)]
pub struct ShardIndex<'a> {
    /// 16 bytes per brick, then the checksum.
    tail: &'a [u8],
    /// Bytes of the file before the index.
    data: u64,
    /// The greatest length of an encoded brick.
    cap: u64,
}

impl<'a> ShardIndex<'a> {
    /// Wraps `tail`, the last [`index_bytes`] of a file of `file_bytes`, as the index of `bricks` bricks, each at most
    /// `cap` bytes when encoded.
    ///
    /// # Errors
    /// If the file is too short for the index, or `tail` has another length.
    pub fn new(tail: &'a [u8], file_bytes: u64, bricks: usize, cap: u64) -> Result<Self, ShardError> {
        let expected = index_bytes(bricks) as u64;
        if file_bytes < expected || (tail.len() as u64) != expected {
            return Err(ShardError::TooShort { expected, found: file_bytes });
        }
        Ok(Self { tail, data: file_bytes - expected, cap })
    }

    /// Checks the checksum and every entry.
    ///
    /// # Errors
    /// If the checksum does not match, or a range leaves the data or is longer than an encoded brick can be.
    pub fn check(&self) -> Result<(), ShardError> {
        let (stored, computed) = (self.crc(), crc32c::crc32c(self.entries()));
        if stored != computed {
            return Err(ShardError::Checksum { stored, computed });
        }
        (0..self.bricks()).try_for_each(|slot| self.range(slot).map(drop))
    }

    /// The brick's range in the file; `None` if it is not stored.
    ///
    /// # Errors
    /// If the range leaves the data or is longer than an encoded brick can be, possibly after a change to a checked
    /// file.
    ///
    /// # Panics
    /// If there is no such entry.
    pub fn range(&self, slot: usize) -> Result<Option<BrickRange>, ShardError> {
        let number = |at: usize| u64::from_le_bytes(self.tail[at..at + 8].try_into().unwrap_or_default());
        assert!(slot < self.bricks(), "no such entry: {slot}");
        let (offset, length) = (number(slot * 16), number(slot * 16 + 8));
        if offset == EMPTY && length == EMPTY {
            return Ok(None);
        }
        let Self { data, cap, .. } = *self;
        match offset.checked_add(length) {
            Some(end) if end <= data && length <= cap => Ok(Some(BrickRange { offset, length })),
            _ => Err(ShardError::Range { slot, offset, length, data, cap }),
        }
    }

    /// The entries of two bricks with some but not all bytes in common, if any. Equal bricks may share all bytes.
    /// Invalid ranges are skipped.
    pub fn overlap(&self) -> Option<(usize, usize)> {
        let entry = |slot| self.range(slot).ok()?.map(|BrickRange { offset, length }| (offset, length, slot));
        let mut ranges: Vec<_> = (0..self.bricks()).filter_map(entry).collect();
        ranges.sort_unstable();
        ranges.dedup_by_key(|(offset, length, _)| (*offset, *length));
        let is_apart = |pair: &[(u64, u64, usize)]| pair[0].0 + pair[0].1 <= pair[1].0;
        // If each sorted range is clear of the next, all are disjoint.
        ranges.windows(2).find(|pair| !is_apart(pair)).map(|pair| (pair[0].2, pair[1].2))
    }

    /// Most memory of [`ShardIndex::overlap`] for `bricks` bricks, in bytes.
    pub const fn overlap_bytes(bricks: usize) -> u64 {
        bricks as u64 * size_of::<(u64, u64, usize)>() as u64
    }

    /// Number of entries, one per brick.
    pub fn bricks(&self) -> usize {
        self.entries().len() / 16
    }

    /// The stored checksum (crc32c) of the index.
    pub fn crc(&self) -> u32 {
        u32::from_le_bytes(self.tail[self.entries().len()..].try_into().unwrap_or_default())
    }

    fn entries(&self) -> &'a [u8] {
        &self.tail[..self.tail.len() - 4]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAP: u64 = 1000;

    fn parse(index: &[u8], data: u64, bricks: usize) -> Result<ShardIndex<'_>, ShardError> {
        let index = ShardIndex::new(index, data + index.len() as u64, bricks, CAP)?;
        index.check().map(|()| index)
    }

    fn one(offset: u64, length: u64) -> Vec<u8> {
        encode_index(&[Some(BrickRange { offset, length })]).0
    }

    #[test]
    fn indices_round_trip() {
        let ranges = [None, Some(BrickRange { offset: 0, length: 40 }), Some(BrickRange { offset: 40, length: 60 })];
        let (bytes, crc) = encode_index(&ranges);
        assert_eq!(bytes.len(), index_bytes(3));
        assert_eq!(bytes[bytes.len() - 4..], crc.to_le_bytes());
        let index = parse(&bytes, 100, 3).unwrap();
        let found: Vec<_> = (0..index.bricks()).map(|slot| index.range(slot).unwrap()).collect();
        assert_eq!((found, index.crc()), (ranges.to_vec(), crc));
        assert_eq!(index.range(2).unwrap().unwrap().as_range(), 40..100);
    }

    #[test]
    fn any_damaged_byte_is_found() {
        let (bytes, _) = encode_index(&[Some(BrickRange { offset: 3, length: 40 }), None]);
        for i in 0..bytes.len() {
            for bit in 0..8 {
                let mut bad = bytes.clone();
                bad[i] ^= 1 << bit;
                assert!(matches!(parse(&bad, 100, 2), Err(ShardError::Checksum { .. })), "byte {i} bit {bit}");
            }
        }
    }

    /// A matching checksum does not make an entry true.
    #[test]
    fn lying_entries_are_refused() {
        assert!(parse(&one(50, 50), 100, 1).is_ok());
        for (offset, length) in
            [(51, 50), (0, 101), (200, 1), (EMPTY, 1), (EMPTY - 1, EMPTY), (1, EMPTY), (0, EMPTY), (u64::MAX - 40, 50)]
        {
            let index = one(offset, length);
            let found = parse(&index, 100, 1);
            assert!(matches!(found, Err(ShardError::Range { .. })), "{offset} {length}: {found:?}");
        }
        let index = one(0, CAP + 1);
        let huge = parse(&index, 1 << 40, 1);
        assert!(matches!(huge, Err(ShardError::Range { .. })), "longer than any encoded brick");
    }

    #[test]
    fn ranges_may_be_shared_whole_but_not_in_part() {
        let overlap = |ranges: &[Option<(u64, u64)>]| {
            let range = |range: &Option<(u64, u64)>| range.map(|(offset, length)| BrickRange { offset, length });
            let (bytes, _) = encode_index(&ranges.iter().map(range).collect::<Vec<_>>());
            parse(&bytes, 300, ranges.len()).unwrap().overlap()
        };
        assert_eq!(overlap(&[]), None);
        assert_eq!(
            overlap(&[Some((0, 40)), None, Some((40, 60)), Some((0, 40)), Some((100, 1)), Some((40, 60))]),
            None
        );
        assert_eq!(overlap(&[Some((39, 60)), None, Some((0, 40)), Some((0, 40))]), Some((2, 0)));
        assert_eq!(overlap(&[Some((0, 40)), Some((0, 41))]), Some((0, 1)));
        assert_eq!(overlap(&[Some((10, 5)), Some((200, 5)), Some((0, 100))]), Some((2, 0)));
    }

    #[test]
    fn truncated_indices_are_refused() {
        let bytes = one(0, 1);
        for n in 0..bytes.len() {
            let found = ShardIndex::new(&bytes[..n], n as u64, 1, CAP);
            assert!(matches!(found, Err(ShardError::TooShort { .. })));
        }
    }
}
