//! The layout of an array, which both versions of documents tell: shape, chunks, element, the order of a chunk's elements, codecs and keys.

use super::codecs::Codecs;
use super::keys::Keys;
use super::shard::Shard;
use crate::element::{Element, Endian};

/// Most axes of an array.
pub(super) const MOST_AXES: usize = 64;

/// Most bytes of a decoded chunk, so that sums of a few fit 64 bits.
const MOST_CHUNK_BYTES: u64 = 1 << 48;

/// Version of a node's documents.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ZarrVersion {
    V2,
    V3,
}

/// Layout of an array. Lists have a member for each of the array's own axes, slowest first.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Layout {
    pub(super) shape: Vec<u64>,
    /// Elements of a chunk's file: of a chunk, or a shard.
    pub(super) file_shape: Vec<u64>,
    /// Elements of the smallest piece decoded alone: of a chunk, or an inner chunk of a shard.
    pub(super) chunk_shape: Vec<u64>,
    pub(super) element: Element,
    pub(super) endian: Endian,
    /// The little-endian element of chunks never written.
    pub(super) fill: Vec<u8>,
    /// The array's axes in the order of a decoded chunk's elements, slowest first.
    pub(super) order: Vec<usize>,
    /// Codecs of a chunk's bytes.
    pub(super) codecs: Codecs,
    pub(super) shard: Option<Shard>,
    pub(super) keys: Keys,
    pub(super) dimension_names: Vec<Option<String>>,
}

impl Layout {
    /// Refuses contradictions, and sizes beyond all bounds.
    pub(super) fn check(&self) -> Result<(), String> {
        let axes = self.shape.len();
        if axes > MOST_AXES {
            return Err(format!("an array of {axes} axes"));
        }
        for (name, lengths) in [("file", &self.file_shape), ("chunk", &self.chunk_shape)] {
            if lengths.len() != axes {
                return Err(format!("expected chunks of {axes} axes as the array has, found {}", lengths.len()));
            }
            if lengths.contains(&0) {
                return Err(format!("expected elements in each {name}, found the shape {lengths:?}"));
            }
        }
        if self.file_shape.iter().zip(&self.chunk_shape).any(|(file, chunk)| file % chunk != 0) {
            let [file, chunk] = [&self.file_shape, &self.chunk_shape];
            return Err(format!("expected shards of whole chunks, found shards of {file:?} and chunks of {chunk:?}"));
        }
        let bytes = product(&self.chunk_shape).and_then(|n| n.checked_mul(self.element.bytes() as u64));
        if bytes.is_none_or(|bytes| bytes > MOST_CHUNK_BYTES) {
            return Err(format!("chunks of {:?} elements are larger than any memory", self.chunk_shape));
        }
        let most = i64::MAX as u64;
        let bytes = product(&self.shape).and_then(|n| n.checked_mul(self.element.bytes() as u64));
        if bytes.is_none_or(|bytes| bytes > most) || self.shape.iter().any(|length| *length > most) {
            return Err(format!("an array of {:?} elements is larger than any disk", self.shape));
        }
        Ok(())
    }

    /// Bytes of a decoded chunk. Only of a checked layout.
    pub(super) fn chunk_bytes(&self) -> u64 {
        self.chunk_shape.iter().product::<u64>() * self.element.bytes() as u64
    }

    /// Number of files along each axis.
    pub(super) fn grid(&self) -> Vec<u64> {
        self.shape.iter().zip(&self.file_shape).map(|(size, chunk)| size.div_ceil(*chunk)).collect()
    }

    /// Bytes between neighbours of a decoded chunk along each of the array's axes.
    pub(super) fn chunk_strides(&self) -> Vec<usize> {
        let mut strides = vec![0; self.order.len()];
        let mut bytes = self.element.bytes();
        for axis in self.order.iter().rev() {
            strides[*axis] = bytes;
            bytes *= self.chunk_shape[*axis] as usize;
        }
        strides
    }

    /// Whether a decoded chunk's elements lie in C order.
    pub(super) fn is_plain(&self) -> bool {
        self.order.iter().enumerate().all(|(i, axis)| i == *axis)
    }
}

/// The product of some lengths, unless it is too large.
pub(super) fn product(lengths: &[u64]) -> Option<u64> {
    lengths.iter().try_fold(1u64, |product, n| product.checked_mul(*n))
}
