//! Files of side data: a page, or, if bricks' shards hold several time steps, as many steps' pages as a Zarr shard.
//!
//! A page is compressed by Zstandard and followed by its crc32c. A shard's pages lie back to back, equal ones once,
//! with the index at the end, as in brick shards. Reading one takes two reads, the first for the index: 16 bytes a
//! step.

use crate::error::ReadError;
use crate::folder::Folder;
use crate::ranged_file::RangedFile;
use crate::scratch::Scratch;
use crate::shard::{BrickRange, ShardIndex, encode_index, index_bytes};
use std::collections::HashMap;
use std::path::Path;

/// Compresses a page and appends its checksum.
pub(crate) fn encode(page: &[u8]) -> Vec<u8> {
    let mut encoded = Vec::new();
    Scratch::with(|scratch| scratch.compress(1, page, &mut encoded));
    let crc = crc32c::crc32c(&encoded);
    encoded.extend_from_slice(&crc.to_le_bytes());
    encoded
}

/// Joins encoded pages, one per time step, to a shard. `None` stands for a step past the last one.
pub(crate) fn join(pages: &[Option<Vec<u8>>]) -> Vec<u8> {
    let mut file = Vec::new();
    let mut known: HashMap<&[u8], BrickRange> = HashMap::new();
    let mut ranges = Vec::with_capacity(pages.len());
    for page in pages {
        ranges.push(page.as_deref().map(|page| {
            *known.entry(page).or_insert_with(|| {
                let range = BrickRange { offset: file.len() as u64, length: page.len() as u64 };
                file.extend_from_slice(page);
                range
            })
        }));
    }
    file.extend_from_slice(&encode_index(&ranges).0);
    file
}

/// Reads and decodes page `slot` of a file of `slots` pages, each of `page_bytes`. One that was damaged on its way from an address is read once more.
pub(crate) fn read(
    folder: &Folder,
    path: &Path,
    slot: usize,
    slots: usize,
    page_bytes: usize,
) -> Result<Vec<u8>, ReadError> {
    match read_once(folder, path, slot, slots, page_bytes) {
        Err(ReadError::CorruptPage { .. }) if folder.forget(path) => read_once(folder, path, slot, slots, page_bytes),
        read => read,
    }
}

fn read_once(folder: &Folder, path: &Path, slot: usize, slots: usize, page_bytes: usize) -> Result<Vec<u8>, ReadError> {
    let io = |error| folder.unreadable(path, error);
    let corrupt = |what: String| ReadError::CorruptPage { path: path.into(), what };
    let most = zstd::zstd_safe::compress_bound(page_bytes) as u64 + 4;
    let encoded = match slots {
        1 => folder.read(path, most).map_err(io)?,
        _ => {
            let (file, end) = RangedFile::open(folder, path, index_bytes(slots) as u64).map_err(io)?;
            let end = &end[end.len().saturating_sub(index_bytes(slots))..];
            let index = ShardIndex::new(end, file.bytes(), slots, most);
            let index = index.and_then(|index| index.check().map(|()| index));
            let range = index.and_then(|index| index.range(slot)).map_err(|error| corrupt(error.to_string()))?;
            let range = range.ok_or_else(|| corrupt(format!("it lacks page {slot}")))?;
            let mut encoded = vec![0; range.length as usize];
            file.read_exact_at(&mut encoded, range.offset).map_err(io)?;
            encoded
        }
    };
    decode(&encoded, page_bytes).map_err(corrupt)
}

/// The compressed frame of a file; fails unless it matches its checksum.
pub(crate) fn checked(encoded: &[u8]) -> Result<&[u8], String> {
    let (frame, crc) = encoded.split_last_chunk::<4>().ok_or("it is shorter than its checksum")?;
    let (stored, computed) = (u32::from_le_bytes(*crc), crc32c::crc32c(frame));
    if stored != computed {
        return Err(format!("checksum: stored {stored:08x}, computed {computed:08x}"));
    }
    Ok(frame)
}

/// Decodes a page; fails unless it has the expected length.
fn decode(encoded: &[u8], expected_bytes: usize) -> Result<Vec<u8>, String> {
    let frame = checked(encoded)?;
    let mut page = vec![0; expected_bytes];
    Scratch::with(|scratch| scratch.decompress(frame, &mut page)).map_err(|error| error.to_string())?;
    Ok(page)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pages_of_several_steps_are_read_from_one_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("0");
        let page = |i: u8| vec![i; 100];
        // The third step equals the first; there is no fifth.
        let pages = [Some(page(1)), Some(page(2)), Some(page(1)), Some(page(3)), None];
        let file = join(&pages.map(|page| page.map(|page| encode(&page))));
        let folder = Folder::open(dir.path()).unwrap();
        let page_of = |bytes: &[u8], slot| {
            std::fs::write(&path, bytes).unwrap();
            read(&folder, &path, slot, 5, 100)
        };
        for (slot, i) in [1, 2, 1, 3].into_iter().enumerate() {
            assert_eq!(page_of(&file, slot).unwrap(), page(i));
        }
        let once = [page(1), page(2), page(3)].iter().map(|page| encode(page).len()).sum::<usize>();
        assert_eq!(file.len(), once + index_bytes(5));
        assert!(page_of(&file, 4).unwrap_err().to_string().contains("lacks page 4"));
        // No damaged byte yields a wrong page, and a damaged index fails all pages.
        for at in 0..file.len() {
            let mut damaged = file.clone();
            damaged[at] ^= 0x10;
            for (slot, i) in [1, 2, 1, 3].into_iter().enumerate() {
                match page_of(&damaged, slot) {
                    Ok(read) => assert!(read == page(i) && at < once, "byte {at}, page {slot}"),
                    Err(error) => assert!(matches!(error, ReadError::CorruptPage { .. }), "byte {at}: {error}"),
                }
            }
        }
        for length in 0..file.len() {
            assert!(matches!(page_of(&file[..length], 0), Err(ReadError::CorruptPage { .. })), "{length} bytes");
        }
    }
}
