//! Where a dataset's elements lie: in one piece, in its header, or in chunks, whose index is read here whole.

use super::chunks::{Chunks, MOST_CHUNK_BYTES, MOST_CHUNKS, StoredChunk};
use super::file::File;
use super::filters;
use super::types::Stored;
use crate::error::{ImportError, Result};
use hdf5_reader::Dataset;
use hdf5_reader::btree_v1::{BTreeV1Key, collect_btree_v1_leaves_storage};
use hdf5_reader::chunk_index::{
    ChunkEntry, collect_implicit_chunk_entries, collect_v2_chunk_entries_storage, single_chunk_entry,
};
use hdf5_reader::error::Error;
use hdf5_reader::extensible_array::collect_extensible_array_chunk_entries_storage;
use hdf5_reader::fixed_array::collect_fixed_array_chunk_entries_storage;
use hdf5_reader::io::Cursor;
use hdf5_reader::messages::HdfMessage;
use hdf5_reader::messages::filter_pipeline::FilterDescription;
use hdf5_reader::messages::layout::{ChunkIndexing, DataLayout};
use std::sync::Arc;

const REWRITE: &str = "write it anew, as h5repack or h5py do";

/// Bytes of an object header searched for its layout message.
const HEADER_BYTES: usize = 1 << 16;

/// Edge of a chunk standing for a piece that was never written.
const BLANK_EDGE: u64 = 64;

/// Elements of a dataset.
pub(super) enum Elements {
    /// In one piece, from this byte of the file.
    Piece(u64),
    /// In chunks; those in the header are one.
    Chunks(Chunks),
}

/// Messages of a dataset's header.
struct Header {
    layout: DataLayout,
    filters: Vec<FilterDescription>,
    fill: Vec<u8>,
}

/// Finds a dataset's elements. `what` names it in messages.
pub(super) fn elements_of(file: &File, set: &Dataset, stored: &Stored, what: &str, id: u64) -> Result<Elements> {
    let header = header_of(file, set, stored, what)?;
    let shape = set.shape().to_vec();
    let blank = |fill: Vec<u8>| Chunks {
        chunk: shape.iter().map(|size| (*size).clamp(1, BLANK_EDGE)).collect(),
        shape: shape.clone(),
        element_bytes: stored.bytes,
        fill,
        filters: Vec::new(),
        stored: Vec::new(),
        id,
        known: None,
    };
    let offset_bytes = file.hdf.superblock().offset_size;
    Ok(match header.layout {
        DataLayout::Compact { data } => {
            let expected = shape.iter().try_fold(stored.bytes as u64, |n, size| n.checked_mul(*size));
            if expected != Some(data.len() as u64) {
                return Err(file.damaged(what, &format!("its header holds {} bytes of it", data.len())));
            }
            Elements::Chunks(Chunks { chunk: shape.clone(), known: Some(Arc::new(data)), ..blank(header.fill) })
        }
        DataLayout::Contiguous { address, .. } if Cursor::is_undefined_offset(address, offset_bytes) => {
            Elements::Chunks(blank(header.fill))
        }
        DataLayout::Contiguous { address, .. } => Elements::Piece(address.saturating_add(file.base())),
        DataLayout::Chunked { address, .. } if Cursor::is_undefined_offset(address, offset_bytes) => {
            Elements::Chunks(blank(header.fill))
        }
        DataLayout::Chunked { address, chunk_indexing, .. } => {
            let dims = set.chunks().unwrap_or_default();
            let chunks = Chunks {
                chunk: dims.iter().map(|n| u64::from(*n)).collect(),
                filters: header.filters,
                ..blank(header.fill)
            };
            check_chunks(file, set, &chunks, what)?;
            filters::check(&chunks.filters)
                .map_err(|filter| ImportError::unsupported_but(&file.path, format!("{filter} of {what}"), REWRITE))?;
            let entries = entries_of(file, set, &chunks, address, chunk_indexing.as_ref(), &dims);
            let entries = entries.map_err(|error| file.refusal(what, &error))?;
            let stored = stored_chunks(file, &chunks, entries, what)?;
            Elements::Chunks(Chunks { stored, ..chunks })
        }
    })
}

fn header_of(file: &File, set: &Dataset, stored: &Stored, what: &str) -> Result<Header> {
    let header = file.hdf.get_or_parse_header(set.address()).map_err(|error| file.refusal(what, &error))?;
    let (mut layout, mut filters, mut fill) = (None, Vec::new(), None);
    for message in &header.messages {
        match message {
            HdfMessage::DataLayout(found) => layout = Some(found.layout.clone()),
            HdfMessage::FilterPipeline(found) => filters = found.filters.clone(),
            HdfMessage::FillValue(found) => fill = found.value.clone().or(fill),
            HdfMessage::ExternalFiles(_) => {
                let feature = format!("{what}, whose data lie in external files,");
                return Err(ImportError::unsupported_but(&file.path, feature, REWRITE));
            }
            _ => {}
        }
    }
    let layout = layout.ok_or_else(|| file.damaged(what, "it has no layout"))?;
    let fill = fill.unwrap_or_else(|| vec![0; stored.bytes]);
    match fill.len() == stored.bytes {
        true => Ok(Header { layout, filters, fill }),
        false => Err(file.damaged(what, &format!("its fill value has {} bytes", fill.len()))),
    }
}

/// Checks the shape of chunks before anything is allocated for them.
fn check_chunks(file: &File, set: &Dataset, chunks: &Chunks, what: &str) -> Result<()> {
    if chunks.chunk.len() != chunks.shape.len() || chunks.chunk.contains(&0) {
        return Err(file.damaged(what, &format!("its chunks are {:?}", chunks.chunk)));
    }
    let elements = chunks.chunk.iter().try_fold(chunks.element_bytes as u64, |n, size| n.checked_mul(*size));
    if elements.is_none_or(|bytes| bytes > MOST_CHUNK_BYTES as u64) {
        let feature = format!("{what} in chunks of {:?} elements (1 GiB is the most)", chunks.chunk);
        return Err(ImportError::unsupported_but(&file.path, feature, REWRITE));
    }
    let count = chunks.grid().iter().try_fold(1u64, |n, count| n.checked_mul(*count));
    if count.is_none_or(|count| count > MOST_CHUNKS) {
        let feature = format!("{what} in more than {MOST_CHUNKS} chunks, {:?} elements each,", chunks.chunk);
        return Err(ImportError::unsupported_but(&file.path, feature, REWRITE));
    }
    let is_even = chunks.shape.iter().zip(&chunks.chunk).all(|(size, chunk)| size % chunk == 0);
    if !is_even && !chunks.filters.is_empty() && leaves_edges(file, set, &chunks.chunk) {
        let feature = format!("{what}, whose chunks at the edges are not filtered,");
        return Err(ImportError::unsupported_but(&file.path, feature, REWRITE));
    }
    Ok(())
}

/// Whether the layout message says so: the parser passes over this bit, and would undo filters that were never applied.
fn leaves_edges(file: &File, set: &Dataset, chunk: &[u64]) -> bool {
    let storage = file.hdf.storage();
    let length = storage.len().saturating_sub(set.address()).min(HEADER_BYTES as u64) as usize;
    let Ok(bytes) = storage.read_range(set.address(), length) else { return false };
    bytes.windows(5).enumerate().any(|(at, start)| {
        let &[4 | 5, 2, flags, axes, width @ 1..=8] = start else { return false };
        let sizes = || {
            bytes.get(at + 5..)?.chunks_exact(width.into()).take(chunk.len()).map(little).collect::<Option<Vec<_>>>()
        };
        flags & 1 == 1 && usize::from(axes) == chunk.len() + 1 && sizes().is_some_and(|sizes| sizes == chunk)
    })
}

fn little(bytes: &[u8]) -> Option<u64> {
    let mut number = [0; 8];
    number.get_mut(..bytes.len())?.copy_from_slice(bytes);
    Some(u64::from_le_bytes(number))
}

/// Reads the whole index.
fn entries_of(
    file: &File,
    set: &Dataset,
    chunks: &Chunks,
    address: u64,
    indexing: Option<&ChunkIndexing>,
    dims: &[u32],
) -> Result<Vec<ChunkEntry>, Error> {
    let (storage, superblock) = (file.hdf.storage(), file.hdf.superblock());
    let (offset, length) = (superblock.offset_size, superblock.length_size);
    let axes = dims.len() as u32;
    let most = set.max_dims().filter(|most| most.len() == dims.len());
    // Arrays of chunks are laid out for the largest extent that the dataset may have.
    let whole = most.filter(|most| !most.contains(&u64::MAX)).unwrap_or(&chunks.shape);
    match indexing {
        None => collect_btree_v1_leaves_storage(storage, address, offset, length, Some(axes), dims, None)?
            .into_iter()
            .map(|(key, address)| match key {
                BTreeV1Key::RawData { chunk_size, filter_mask, offsets } => Ok(ChunkEntry {
                    address,
                    size: chunk_size.into(),
                    filter_mask,
                    offsets: offsets.into_iter().take(dims.len()).collect(),
                }),
                BTreeV1Key::Group { .. } => Err(Error::InvalidData("an index of groups in place of chunks".into())),
            })
            .collect(),
        Some(ChunkIndexing::SingleChunk { filtered_size, filters }) => {
            Ok(vec![single_chunk_entry(address, *filtered_size, *filters, dims.len())])
        }
        Some(ChunkIndexing::Implicit) => {
            collect_implicit_chunk_entries(address, whole, dims, chunks.element_bytes, None, storage.len())
        }
        Some(ChunkIndexing::FixedArray { .. }) => {
            collect_fixed_array_chunk_entries_storage(storage, address, offset, length, whole, dims, None)
        }
        Some(ChunkIndexing::ExtensibleArray { .. }) => collect_extensible_array_chunk_entries_storage(
            storage,
            address,
            offset,
            length,
            &chunks.shape,
            set.max_dims(),
            dims,
            None,
        ),
        Some(ChunkIndexing::BTreeV2) => {
            collect_v2_chunk_entries_storage(storage, address, offset, length, axes, dims, None)
        }
    }
}

/// Chunks of the grid by their numbers. Those outside were left behind when the dataset shrank.
fn stored_chunks(file: &File, chunks: &Chunks, entries: Vec<ChunkEntry>, what: &str) -> Result<Vec<StoredChunk>> {
    let (grid, whole, length) = (chunks.grid(), chunks.chunk_bytes() as u64, file.map.len() as u64);
    let mut stored = Vec::with_capacity(entries.len());
    for entry in entries {
        let off =
            || file.damaged(what, &format!("a chunk lies at {:?} of chunks of {:?}", entry.offsets, chunks.chunk));
        if entry.offsets.len() != grid.len() || entry.offsets.iter().zip(&chunks.chunk).any(|(at, size)| at % size != 0)
        {
            return Err(off());
        }
        let place: Vec<u64> = entry.offsets.iter().zip(&chunks.chunk).map(|(at, size)| at / size).collect();
        if place.iter().zip(&grid).any(|(at, count)| at >= count) {
            continue;
        }
        let bytes = if entry.size == 0 { whole } else { entry.size };
        let start = entry.address.checked_add(file.base());
        let end = start.and_then(|start| start.checked_add(bytes));
        let (Some(start), Some(end)) = (start, end) else { return Err(off()) };
        if end > length {
            let problem = format!("cut short: expected at least {end} bytes for {what}, found {length}");
            return Err(ImportError::invalid(&file.path, problem));
        }
        let Ok(bytes) = u32::try_from(bytes) else { return Err(off()) };
        let number = place.iter().zip(&grid).fold(0, |number, (at, count)| number * count + at);
        stored.push(StoredChunk { number, start, bytes, mask: entry.filter_mask });
    }
    stored.sort_unstable_by_key(|chunk| chunk.number);
    match stored.windows(2).any(|pair| pair[0].number == pair[1].number) {
        true => Err(file.damaged(what, "a chunk lies in two places")),
        false => Ok(stored),
    }
}
