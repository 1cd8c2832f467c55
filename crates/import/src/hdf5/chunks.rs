//! Chunks of a dataset: where they lie in the file, and the voxels of a box from them. The index is read once, when the dataset is opened,
//! and costs 24 bytes per chunk; a decoded chunk is kept for its neighbours in a cache.

use super::filters;
use crate::chunk_grid::{place_of, step, strides};
use crate::element::Decode;
use crate::error::{ImportError, Result};
use crate::mapped::MappedFile;
use hdf5_reader::cache::{ChunkCache, ChunkKey};
use hdf5_reader::error::Error;
use hdf5_reader::messages::filter_pipeline::FilterDescription;
use std::sync::Arc;

/// Most bytes of one decoded chunk.
pub(super) const MOST_CHUNK_BYTES: usize = 1 << 30;

/// Most chunks of a dataset: some terabytes of usual ones.
pub(super) const MOST_CHUNKS: u64 = 1 << 23;

/// Place of a chunk in the file.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct StoredChunk {
    /// Number of the chunk in the grid, the last axis fastest.
    pub(super) number: u64,
    /// First byte in the file.
    pub(super) start: u64,
    pub(super) bytes: u32,
    /// Filters left out for this chunk, a bit each.
    pub(super) mask: u32,
}

/// The chunks of one dataset.
pub(super) struct Chunks {
    /// Elements along each axis, slowest first.
    pub(super) shape: Vec<u64>,
    /// Elements of a chunk along each axis.
    pub(super) chunk: Vec<u64>,
    pub(super) element_bytes: usize,
    /// Element of chunks that were never written.
    pub(super) fill: Vec<u8>,
    pub(super) filters: Vec<FilterDescription>,
    /// Written chunks, by ascending number.
    pub(super) stored: Vec<StoredChunk>,
    /// Number of the dataset in its source, for the cache.
    pub(super) id: u64,
    /// All elements, where they are known already, as one chunk.
    pub(super) known: Option<Arc<Vec<u8>>>,
}

/// A box of a dataset to be decoded into voxels.
pub(super) struct Wanted<'a> {
    /// First elements, and ends, along each axis.
    pub(super) from: &'a [u64],
    pub(super) to: &'a [u64],
    /// Bytes between neighbours in the output along each axis.
    pub(super) strides: &'a [usize],
    pub(super) decode: Decode,
    /// Bytes of an element before the wanted number.
    pub(super) offset: usize,
}

impl Chunks {
    /// Number of chunks along each axis.
    pub(super) fn grid(&self) -> Vec<u64> {
        self.shape.iter().zip(&self.chunk).map(|(size, chunk)| size.div_ceil(*chunk)).collect()
    }

    /// Bytes of a decoded chunk.
    pub(super) fn chunk_bytes(&self) -> usize {
        self.chunk.iter().product::<u64>() as usize * self.element_bytes
    }

    /// Whether chunks are missing from the file: their elements have the fill value.
    pub(super) fn has_gaps(&self) -> bool {
        self.known.is_none() && (self.stored.len() as u64) < self.grid().iter().product()
    }

    /// Leaves out elements beyond `shape`, and chunks wholly beyond it. Not for elements in one chunk known already.
    pub(super) fn clip(&mut self, shape: &[u64]) {
        let before = self.grid();
        self.shape = shape.to_vec();
        let after = self.grid();
        self.stored.retain_mut(|stored| {
            let place = place_of(stored.number, &before);
            stored.number = place.iter().zip(&after).fold(0, |number, (at, count)| number * count + at);
            place.iter().zip(&after).all(|(at, count)| at < count)
        });
    }

    /// Decodes a box into `out`, chunk by chunk.
    pub(super) fn read(
        &self,
        file: &MappedFile,
        cache: &ChunkCache,
        wanted: &Wanted<'_>,
        out: &mut [u8],
    ) -> Result<(), String> {
        let first: Vec<u64> = wanted.from.iter().zip(&self.chunk).map(|(from, chunk)| from / chunk).collect();
        let last: Vec<u64> = wanted.to.iter().zip(&self.chunk).map(|(to, chunk)| (to - 1) / chunk).collect();
        let mut place = first.clone();
        loop {
            let chunk = self.load(file, cache, &place)?;
            self.copy(chunk.as_ref().map(|bytes| &bytes[..]), &place, wanted, out);
            if !step(&mut place, &first, &last) {
                return Ok(());
            }
        }
    }

    /// Passes all numbers of the dataset to `see`, in lines; those never written once.
    pub(super) fn each(
        &self,
        file: &MappedFile,
        mut see: impl FnMut(&[u8]) -> Result<()>,
        fail: impl Fn(String) -> ImportError,
    ) -> Result<()> {
        if let Some(known) = &self.known {
            return see(known);
        }
        if self.has_gaps() {
            see(&self.fill)?;
        }
        let grid = self.grid();
        let strides = strides(&self.chunk, self.element_bytes);
        let axes = self.shape.len();
        for stored in &self.stored {
            let place = place_of(stored.number, &grid);
            let chunk = self.decode(file, stored).map_err(&fail)?;
            // Elements of an edge chunk beyond the dataset are none of its values.
            let counts: Vec<u64> =
                (0..axes).map(|a| self.chunk[a].min(self.shape[a] - place[a] * self.chunk[a]) - 1).collect();
            let zeros = vec![0; axes];
            let mut at = zeros.clone();
            let mut ends = counts.clone();
            ends[axes - 1] = 0;
            loop {
                let start: usize = (0..axes).map(|a| at[a] as usize * strides[a]).sum();
                see(&chunk[start..][..(counts[axes - 1] as usize + 1) * self.element_bytes])?;
                if !step(&mut at, &zeros, &ends) {
                    break;
                }
            }
        }
        Ok(())
    }

    /// All elements of a dataset along one axis.
    pub(super) fn line(&self, file: &MappedFile) -> Result<Vec<u8>, String> {
        if let Some(known) = &self.known {
            return Ok(known.to_vec());
        }
        let mut line = self.fill.repeat(self.shape.iter().product::<u64>() as usize);
        for stored in &self.stored {
            let chunk = self.decode(file, stored)?;
            let rest = line.get_mut(stored.number as usize * chunk.len()..).unwrap_or_default();
            let count = rest.len().min(chunk.len());
            rest[..count].copy_from_slice(&chunk[..count]);
        }
        Ok(line)
    }

    /// The decoded chunk at a place of the grid; `None` if it was never written.
    fn load(&self, file: &MappedFile, cache: &ChunkCache, place: &[u64]) -> Result<Option<Arc<Vec<u8>>>, String> {
        if let Some(known) = &self.known {
            return Ok(Some(known.clone()));
        }
        let number = place.iter().zip(self.grid()).fold(0, |number, (at, count)| number * count + at);
        let Ok(at) = self.stored.binary_search_by_key(&number, |stored| stored.number) else { return Ok(None) };
        let key = ChunkKey { dataset_addr: self.id, chunk_offsets: std::iter::once(number).collect() };
        let load = || self.decode(file, &self.stored[at]).map_err(Error::Other);
        cache.get_or_insert_with(key, load).map(Some).map_err(|error| match error {
            Error::Other(problem) => problem,
            other => other.to_string(),
        })
    }

    fn decode(&self, file: &MappedFile, stored: &StoredChunk) -> Result<Vec<u8>, String> {
        let range = stored.start as usize..stored.start as usize + stored.bytes as usize;
        let lies =
            || format!("cut short: a chunk lies at {} to {}, found {} bytes", range.start, range.end, file.len());
        let bytes = file.get(range.clone()).ok_or_else(lies)?;
        file.advise(range.clone());
        let decoded = filters::undo(bytes, &self.filters, stored.mask, self.element_bytes, self.chunk_bytes());
        decoded.map_err(|problem| format!("the chunk at byte {}: {problem}", range.start))
    }

    /// Decodes the part of a chunk inside the box.
    fn copy(&self, chunk: Option<&[u8]>, place: &[u64], wanted: &Wanted<'_>, out: &mut [u8]) {
        let axes = self.shape.len();
        let strides = strides(&self.chunk, self.element_bytes);
        let (mut counts, mut from, mut to) = (vec![0; axes], wanted.offset, 0);
        for a in 0..axes {
            let start = place[a] * self.chunk[a];
            let low = wanted.from[a].max(start);
            counts[a] = wanted.to[a].min(start + self.chunk[a]) - low;
            from += (low - start) as usize * strides[a];
            to += (low - wanted.from[a]) as usize * wanted.strides[a];
        }
        // Lines along the last axis of several elements, which lie closest in the file.
        let line = (0..axes).rev().find(|a| counts[*a] > 1).unwrap_or(axes - 1);
        let count = counts[line] as usize;
        let zeros = vec![0; axes];
        let mut ends: Vec<u64> = counts.iter().map(|count| count - 1).collect();
        ends[line] = 0;
        let mut at = zeros.clone();
        loop {
            let sum = |strides: &[usize]| (0..axes).map(|a| at[a] as usize * strides[a]).sum::<usize>();
            let dst = &mut out[to + sum(wanted.strides)..];
            let (src, stride) = match chunk {
                Some(bytes) => (&bytes[from + sum(&strides)..], strides[line]),
                None => (&self.fill[wanted.offset..], 0),
            };
            wanted.decode.line(src, stride, dst, wanted.strides[line], count);
            if !step(&mut at, &zeros, &ends) {
                return;
            }
        }
    }
}
