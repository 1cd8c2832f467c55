//! Encoding of a brick's core: compression, then a crc32c over the compressed bytes.
//!
//! An encoded brick is a payload and its crc32c (little-endian), as in Zarr's codec `crc32c`. The payload is a
//! Zstandard frame, a Blosc container of byte-shuffled Zstandard (`blosc.rs`), or the core itself. Decoding checks the
//! checksum first, so any damaged byte is detected before decompression.
//!
//! Contexts and buffers are reused through [`Scratch`]: decoding does not allocate.

use crate::blosc;
use crate::error::CodecError;
use crate::scratch::Scratch;
use brickyard_volume::{Apron, VoxelType};
use serde::{Deserialize, Serialize};

const CRC_BYTES: usize = 4;

/// Compression of bricks: `zstd:N`, `shuffle-zstd:N` (N from 1 to 22) or `none`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub enum Codec {
    /// Zstandard at this level: the default for 8-bit voxels.
    Zstd(i32),
    /// Byte shuffle, then Zstandard at this level, as the standard `blosc` codec: the default for wider voxels.
    ShuffleZstd(i32),
    /// Uncompressed bytes.
    None,
}

impl Codec {
    /// The default codec for a voxel type.
    pub const fn default_for(voxel_type: VoxelType) -> Self {
        if voxel_type.bytes() == 1 { Self::Zstd(1) } else { Self::ShuffleZstd(1) }
    }

    /// The codec's effect on a voxel type: `ShuffleZstd` becomes `Zstd` for 8-bit voxels, with nothing to shuffle.
    pub const fn for_voxel_type(self, voxel_type: VoxelType) -> Self {
        match self {
            Self::ShuffleZstd(level) if voxel_type.bytes() == 1 => Self::Zstd(level),
            other => other,
        }
    }
}

impl std::str::FromStr for Codec {
    type Err = String;

    fn from_str(s: &str) -> Result<Self, String> {
        let level = |n: &str| n.parse().ok().filter(|n| (1..=22).contains(n));
        let codec = match s.split_once(':') {
            Some(("zstd", n)) => level(n).map(Self::Zstd),
            Some(("shuffle-zstd", n)) => level(n).map(Self::ShuffleZstd),
            None if s == "none" => Some(Self::None),
            _ => None,
        };
        codec.ok_or_else(|| format!("unknown codec '{s}': expected zstd:N, shuffle-zstd:N (N from 1 to 22) or none"))
    }
}

impl std::fmt::Display for Codec {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Zstd(level) => write!(f, "zstd:{level}"),
            Self::ShuffleZstd(level) => write!(f, "shuffle-zstd:{level}"),
            Self::None => f.write_str("none"),
        }
    }
}

impl TryFrom<String> for Codec {
    type Error = String;
    fn try_from(s: String) -> Result<Self, String> {
        s.parse()
    }
}

impl From<Codec> for String {
    fn from(codec: Codec) -> String {
        codec.to_string()
    }
}

/// The codec of a store's bricks: a [`Codec`] for cores or aprons of known size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BrickCodec {
    codec: Codec,
    typesize: usize,
    core_bytes: usize,
}

impl BrickCodec {
    /// The codec for cores of `edge`^3 voxels.
    pub fn new(codec: Codec, voxel_type: VoxelType, edge: u32) -> Self {
        Self::of_voxels(codec, voxel_type, (edge as usize).pow(3))
    }

    /// The codec for aprons of this shape; its methods then take aprons as cores.
    pub fn of_aprons(codec: Codec, voxel_type: VoxelType, apron: Apron) -> Self {
        Self::of_voxels(codec, voxel_type, apron.voxels())
    }

    fn of_voxels(codec: Codec, voxel_type: VoxelType, voxels: usize) -> Self {
        let typesize = voxel_type.bytes();
        Self { codec: codec.for_voxel_type(voxel_type), typesize, core_bytes: voxels * typesize }
    }

    /// Bytes of a decoded core.
    pub const fn core_bytes(&self) -> usize {
        self.core_bytes
    }

    /// Length limit of an encoded brick, in bytes.
    pub fn encoded_cap(&self) -> u64 {
        (zstd::zstd_safe::compress_bound(self.core_bytes) + blosc::OVERHEAD_BYTES + CRC_BYTES) as u64
    }

    /// Appends the encoded `core` to `out`. Equal cores give equal bytes.
    ///
    /// # Panics
    /// If `core` is not [`BrickCodec::core_bytes`] long.
    pub fn encode(&self, scratch: &mut Scratch, core: &[u8], out: &mut Vec<u8>) {
        assert_eq!(core.len(), self.core_bytes);
        let start = out.len();
        match self.codec {
            Codec::Zstd(level) => scratch.compress(level, core, out),
            Codec::ShuffleZstd(level) => blosc::encode(scratch, self.typesize, level, core, out),
            Codec::None => out.extend_from_slice(core),
        }
        let crc = crc32c::crc32c(&out[start..]);
        out.extend_from_slice(&crc.to_le_bytes());
    }

    /// Decodes an encoded brick into `out`.
    ///
    /// # Errors
    /// If the checksum does not match, the payload is foreign to the codec, or it does not decode to a core's length.
    ///
    /// # Panics
    /// If `out` is not [`BrickCodec::core_bytes`] long.
    pub fn decode(&self, scratch: &mut Scratch, encoded: &[u8], out: &mut [u8]) -> Result<(), CodecError> {
        assert_eq!(out.len(), self.core_bytes);
        let Some((payload, crc)) = encoded.split_last_chunk::<CRC_BYTES>() else {
            return Err(CodecError::Malformed(format!("{} bytes, not even a checksum", encoded.len())));
        };
        let (stored, computed) = (u32::from_le_bytes(*crc), crc32c::crc32c(payload));
        if stored != computed {
            return Err(CodecError::Checksum { stored, computed });
        }
        match self.codec {
            Codec::Zstd(_) => scratch.decompress(payload, out),
            Codec::ShuffleZstd(_) => blosc::decode(scratch, payload, out),
            Codec::None if payload.len() == out.len() => {
                out.copy_from_slice(payload);
                Ok(())
            }
            Codec::None => Err(CodecError::Length { expected: out.len() as u64, found: payload.len() as u64 }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CODECS: [Codec; 5] =
        [Codec::Zstd(1), Codec::Zstd(9), Codec::ShuffleZstd(1), Codec::ShuffleZstd(5), Codec::None];

    /// Smooth data with noise in the low bits, or pure noise (`noisy`).
    fn core(bytes: usize, noisy: bool) -> Vec<u8> {
        let mut state = 1u32;
        let noise = std::iter::repeat_with(move || {
            state = state.wrapping_mul(1664525).wrapping_add(1013904223);
            (state >> 24) as u8
        });
        noise.take(bytes).enumerate().map(|(i, n)| if noisy { n } else { (i / 64) as u8 ^ (n & 3) }).collect()
    }

    #[test]
    fn every_codec_and_type_round_trips() {
        let mut scratch = Scratch::default();
        for voxel_type in VoxelType::ALL {
            for codec in CODECS {
                for noisy in [false, true] {
                    let brick = BrickCodec::new(codec, voxel_type, 16);
                    let core = core(brick.core_bytes(), noisy);
                    let mut encoded = vec![7; 3];
                    brick.encode(&mut scratch, &core, &mut encoded);
                    assert_eq!(encoded[..3], [7; 3], "encoding appends");
                    assert!((encoded.len() - 3) as u64 <= brick.encoded_cap());
                    let mut decoded = vec![0; core.len()];
                    brick.decode(&mut scratch, &encoded[3..], &mut decoded).unwrap();
                    assert!(decoded == core, "{voxel_type} {codec}");
                }
            }
        }
    }

    #[test]
    fn any_damaged_byte_is_found() {
        let mut scratch = Scratch::default();
        for codec in CODECS {
            let brick = BrickCodec::new(codec, VoxelType::U16, 8);
            let mut encoded = Vec::new();
            brick.encode(&mut scratch, &core(brick.core_bytes(), false), &mut encoded);
            let mut out = vec![0; brick.core_bytes()];
            for i in 0..encoded.len() {
                encoded[i] ^= 0x40;
                let found = brick.decode(&mut scratch, &encoded, &mut out);
                assert!(matches!(found, Err(CodecError::Checksum { .. })), "{codec} byte {i}: {found:?}");
                encoded[i] ^= 0x40;
            }
            for n in 0..encoded.len() {
                assert!(brick.decode(&mut scratch, &encoded[..n], &mut out).is_err(), "{codec} cut to {n}");
            }
        }
    }

    /// Bad bytes with a sound checksum cannot make the decoder access memory out of bounds, or pass for a brick.
    #[test]
    fn hostile_payloads_are_errors() {
        let mut scratch = Scratch::default();
        let with_crc = |payload: &[u8]| [payload, &crc32c::crc32c(payload).to_le_bytes()].concat();
        for codec in CODECS {
            let brick = BrickCodec::new(codec, VoxelType::U16, 8);
            let mut encoded = Vec::new();
            let original = core(brick.core_bytes(), false);
            brick.encode(&mut scratch, &original, &mut encoded);
            encoded.truncate(encoded.len() - 4);
            let mut out = vec![0; brick.core_bytes()];
            for i in 0..encoded.len().min(64) {
                for value in [0, 1, 0x7f, 0x80, 0xff] {
                    let mut bad = encoded.clone();
                    bad[i] = value;
                    // Decoding to something is fine (the checksum matches); crashing is not.
                    let _ = brick.decode(&mut scratch, &with_crc(&bad), &mut out);
                }
            }
            for n in 0..encoded.len() {
                assert!(brick.decode(&mut scratch, &with_crc(&encoded[..n]), &mut out).is_err(), "{codec} {n}");
            }
            let larger = BrickCodec::new(codec, VoxelType::U16, 16);
            let mut big = Vec::new();
            larger.encode(&mut scratch, &core(larger.core_bytes(), false), &mut big);
            assert!(brick.decode(&mut scratch, &big, &mut out).is_err(), "{codec}: a larger brick");
        }
    }

    #[test]
    fn codec_names_round_trip() {
        for codec in CODECS {
            assert_eq!(codec.to_string().parse(), Ok(codec));
        }
        for bad in ["zstd", "zstd:0", "zstd:23", "lz4:1", "none:1", "zstd:x", ""] {
            assert!(bad.parse::<Codec>().unwrap_err().contains("zstd:N"), "{bad}");
        }
        assert_eq!(Codec::ShuffleZstd(3).for_voxel_type(VoxelType::U8), Codec::Zstd(3));
    }
}
