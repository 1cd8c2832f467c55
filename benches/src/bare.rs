//! The bare codec: a store's encoded bricks in RAM, decoded by plain Zstandard. The yardstick for all readers: no file, no
//! index, no checksum, no cache.

use brickyard_store::shard::{ShardIndex, index_bytes};
use brickyard_store::{BrickCodec, Codec, ShardError, ShardId, Store};
use brickyard_volume::BrickId;
use std::ops::Range;

/// Checksum length of each brick.
const CRC_BYTES: usize = 4;

/// Encoded bricks of one store.
pub struct EncodedBricks {
    codec: Codec,
    voxel_bytes: usize,
    core_bytes: usize,
    bytes: Vec<u8>,
    bricks: Vec<Payload>,
}

/// A brick's place in the bytes.
enum Payload {
    /// Uncompressed.
    Stored(Range<usize>),
    /// A Zstandard frame.
    Frame(Range<usize>),
}

impl EncodedBricks {
    /// Copies the bricks' bytes into RAM.
    ///
    /// # Errors
    /// If a shard cannot be read, or a brick is not stored.
    pub fn load(store: &Store, ids: &[BrickId]) -> Result<Self, String> {
        let info = store.info();
        let mut bytes = Vec::new();
        let mut bricks = Vec::new();
        let codec = info.codec.for_voxel_type(info.voxel_type);
        let place = |i: usize| store.layout().shard_of(ids[i]);
        let mut order: Vec<usize> = (0..ids.len()).collect();
        order.sort_by_key(|&i| place(i));
        for of_one_shard in order.chunk_by(|&a, &b| place(a).0 == place(b).0) {
            let shard = Shard::read(store, place(of_one_shard[0]).0)?;
            for &i in of_one_shard {
                let range = shard.index().and_then(|index| index.range(place(i).1)).map_err(|e| e.to_string())?;
                let range = range.ok_or_else(|| format!("{} is not stored", ids[i]))?;
                let encoded = &shard.file[range.as_range()];
                let start = bytes.len();
                bytes.extend_from_slice(&encoded[..encoded.len() - CRC_BYTES]);
                bricks.push((i, payload(codec, encoded, start..bytes.len())));
            }
        }
        bricks.sort_by_key(|b| b.0);
        let bricks = bricks.into_iter().map(|b| b.1).collect();
        let voxel_bytes = info.voxel_type.bytes();
        Ok(Self { codec, voxel_bytes, core_bytes: store.core_bytes(), bytes, bricks })
    }

    /// Number of bricks.
    pub fn len(&self) -> usize {
        self.bricks.len()
    }

    /// Whether there are no bricks.
    pub fn is_empty(&self) -> bool {
        self.bricks.is_empty()
    }

    /// Encoded bytes of all bricks.
    pub fn encoded_bytes(&self) -> usize {
        self.bytes.len()
    }

    /// Creates a decoder for one thread.
    pub fn decoder(&self) -> BareDecoder<'_> {
        BareDecoder { bricks: self, zstd: zstd::bulk::Decompressor::default(), shuffled: vec![0; self.core_bytes] }
    }
}

/// The payload of an encoded brick, with its bytes copied to `at`.
fn payload(codec: Codec, encoded: &[u8], at: Range<usize>) -> Payload {
    match codec {
        Codec::None => Payload::Stored(at),
        Codec::Zstd(_) => Payload::Frame(at),
        // One block with one stream, as from the store's writer: see `brickyard_store::blosc`.
        Codec::ShuffleZstd(_) if encoded[2] & 0x02 != 0 => Payload::Stored(at.start + 16..at.end),
        Codec::ShuffleZstd(_) => Payload::Frame(at.start + 24..at.end),
    }
}

/// One thread's decoder.
pub struct BareDecoder<'a> {
    bricks: &'a EncodedBricks,
    zstd: zstd::bulk::Decompressor<'static>,
    shuffled: Vec<u8>,
}

impl BareDecoder<'_> {
    /// Decodes brick `i` into `out`.
    ///
    /// # Errors
    /// If the brick is damaged.
    pub fn decode(&mut self, i: usize, out: &mut [u8]) -> Result<(), String> {
        let EncodedBricks { codec, voxel_bytes, bytes, bricks, .. } = self.bricks;
        let frame = match &bricks[i] {
            Payload::Stored(range) => {
                out.copy_from_slice(&bytes[range.clone()]);
                return Ok(());
            }
            Payload::Frame(range) => &bytes[range.clone()],
        };
        let shuffled = matches!(codec, Codec::ShuffleZstd(_));
        let target = if shuffled { &mut self.shuffled[..] } else { &mut *out };
        let length = self.zstd.decompress_to_buffer(frame, target).map_err(|e| format!("brick {i}: zstd: {e}"))?;
        if length != target.len() {
            return Err(format!("brick {i}: expected {} bytes, found {length}", target.len()));
        }
        match voxel_bytes {
            2 if shuffled => unshuffle::<2>(&self.shuffled, out),
            4 if shuffled => unshuffle::<4>(&self.shuffled, out),
            _ => {}
        }
        Ok(())
    }
}

/// Rebuilds voxels from the planes of their first bytes, second bytes, ...
fn unshuffle<const N: usize>(planes: &[u8], out: &mut [u8]) {
    let voxels = out.as_chunks_mut::<N>().0;
    let count = voxels.len();
    let planes: [&[u8]; N] = std::array::from_fn(|k| &planes[k * count..][..count]);
    for i in 0..count {
        voxels[i] = std::array::from_fn(|k| planes[k][i]);
    }
}

struct Shard {
    file: Vec<u8>,
    bricks: usize,
    /// The greatest length of an encoded brick.
    cap: u64,
}

impl Shard {
    fn read(store: &Store, id: ShardId) -> Result<Self, String> {
        let path = store.layout().shard_path(store.path(), id);
        let fail = |error: &dyn std::fmt::Display| format!("{}: {error}", path.display());
        let file = std::fs::read(&path).map_err(|e| fail(&e))?;
        let bricks = store.layout().shard_slots(id.level);
        let cap = BrickCodec::new(store.info().codec, store.voxel_type(), store.info().edge).encoded_cap();
        let shard = Self { file, bricks, cap };
        shard.index().and_then(|index| index.check()).map_err(|e| fail(&e))?;
        Ok(shard)
    }

    fn index(&self) -> Result<ShardIndex<'_>, ShardError> {
        let tail = &self.file[self.file.len().saturating_sub(index_bytes(self.bricks))..];
        ShardIndex::new(tail, self.file.len() as u64, self.bricks, self.cap)
    }
}
