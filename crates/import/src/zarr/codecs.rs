//! Codecs of bytes, undone last to first from a chunk's file to its elements. The length of every stage is bounded before it is allocated, and
//! the last has exactly the chunk's length.

use super::delta;
use super::document::Named;
use crate::blosc;
use crate::element::{Element, Endian};
use crate::error::Result;
use crate::inflate;
use std::io::Read;

const CRC_BYTES: u64 = 4;

/// Bytes of a decoder's own state at most: Zstandard's tables, Deflate's window.
const STATE_BYTES: u64 = 512 << 10;

/// Most codecs of an array.
const MOST_CODECS: usize = 16;

/// A codec from bytes to bytes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Codec {
    Blosc,
    Crc32c,
    /// Differences of neighbours.
    Delta(Element, Endian),
    Gzip,
    /// LZ4 behind its decoded length, as numcodecs writes it.
    Lz4,
    /// The first bytes of all elements of a size, then their second ones.
    Shuffle(usize),
    Zlib,
    Zstd,
}

impl Codec {
    /// The codec of a name, of version 2 or 3; an error if there is none, or it has settings that cannot be read.
    pub(super) fn of(named: &Named<'_>) -> Result<Self> {
        let settings = &named.settings;
        Ok(match named.name.strip_prefix("numcodecs.").unwrap_or(named.name) {
            "blosc" => {
                let compressors = ["blosclz", "lz4", "lz4hc", "zlib", "zstd", "snappy"].map(|name| (name, name));
                if settings.one_of("cname", &compressors)? == Some("snappy") {
                    return Err(settings.unsupported("Blosc with Snappy".into(), WRITE_ANEW));
                }
                Self::Blosc
            }
            "crc32c" => {
                settings.one_of("location", &[("end", ())])?;
                Self::Crc32c
            }
            "gzip" => Self::Gzip,
            "lz4" => Self::Lz4,
            "shuffle" => {
                let size = settings.get("elementsize").map(|value| {
                    let size = value.as_u64().filter(|size| (1..=1 << 16).contains(size));
                    size.ok_or_else(|| settings.damaged("elementsize", "bytes of an element", value))
                });
                // The default of numcodecs.
                Self::Shuffle(size.transpose()?.unwrap_or(4) as usize)
            }
            "zlib" => Self::Zlib,
            "zstd" => Self::Zstd,
            _ => return Err(settings.unsupported(format!("the codec {:?}", named.name), WRITE_ANEW)),
        })
    }

    /// Most bytes that so many become when they are coded.
    fn coded_bytes(self, plain: u64) -> u64 {
        match self {
            Self::Crc32c => plain.saturating_add(CRC_BYTES),
            Self::Delta(..) | Self::Shuffle(_) => plain,
            // Incompressible data grow by less than a hundredth, with headers of blocks; an eighth more is no chunk of this length.
            Self::Blosc | Self::Gzip | Self::Lz4 | Self::Zlib | Self::Zstd => {
                plain.saturating_add(plain / 8).saturating_add(64 << 10)
            }
        }
    }

    /// Undoes a stage into exactly the buffer.
    fn undo_into(self, coded: &[u8], out: &mut [u8]) -> Result<(), String> {
        match self {
            Self::Blosc => inflate::blosc(coded, out),
            Self::Crc32c => copied(checked(coded)?, out),
            Self::Delta(element, endian) => {
                copied(coded, out)?;
                delta::undo(out, element, endian);
                Ok(())
            }
            Self::Gzip => inflate::gzip(coded, out),
            Self::Lz4 => {
                let (length, block) = lz4_parts(coded)?;
                match length == out.len() {
                    true => inflate::lz4(block, out),
                    false => Err(inflate::length_differs(out.len() as u64, length as u64)),
                }
            }
            Self::Shuffle(size) => {
                let same = coded.len() == out.len();
                same.then(|| blosc::unshuffle(size, coded, out))
                    .ok_or_else(|| inflate::length_differs(out.len() as u64, coded.len() as u64))
            }
            Self::Zlib => inflate::zlib(coded, out),
            Self::Zstd => inflate::zstd(coded, out),
        }
    }

    /// Undoes a stage of unknown length into at most `bound` bytes.
    fn undo(self, coded: &[u8], bound: u64) -> Result<Vec<u8>, String> {
        let length = match self {
            Self::Blosc => blosc::decoded_bytes(coded).ok_or("damaged Blosc data: cut short")?,
            Self::Crc32c => coded.len().saturating_sub(CRC_BYTES as usize),
            Self::Delta(..) | Self::Shuffle(_) => coded.len(),
            Self::Lz4 => lz4_parts(coded)?.0,
            // Not as a stream, whose window may be larger than the bound; nor to the length told, which is the first frame's alone.
            Self::Zstd => {
                let decoded = zstd::bulk::decompress(coded, bound as usize);
                return decoded.map_err(|error| format!("damaged Zstandard data, or more than expected: {error}"));
            }
            Self::Gzip => return read_all(crate::gzip::GzipMembers::new(coded), bound),
            Self::Zlib => return read_all(flate2::bufread::ZlibDecoder::new(coded), bound),
        };
        if length as u64 > bound {
            return Err(format!("expected at most {bound} bytes decoded, found {length}"));
        }
        let mut out = vec![0; length];
        self.undo_into(coded, &mut out).map(|()| out)
    }
}

pub(super) const WRITE_ANEW: &str = "write the array anew with Blosc, Zstandard, gzip or none, as zarr-python does";

/// Reads a stream to its end, unless it is longer than the bound.
fn read_all(stream: impl Read, bound: u64) -> Result<Vec<u8>, String> {
    // At once, since a growing buffer is copied into one of twice its length.
    let mut out = Vec::with_capacity(bound.saturating_add(1) as usize);
    stream.take(bound.saturating_add(1)).read_to_end(&mut out).map_err(|error| format!("damaged data: {error}"))?;
    match out.len() as u64 > bound {
        true => Err(format!("expected at most {bound} bytes decoded, found more")),
        false => Ok(out),
    }
}

fn copied(bytes: &[u8], out: &mut [u8]) -> Result<(), String> {
    if bytes.len() != out.len() {
        return Err(inflate::length_differs(out.len() as u64, bytes.len() as u64));
    }
    out.copy_from_slice(bytes);
    Ok(())
}

/// The bytes before their checksum.
pub(super) fn checked(coded: &[u8]) -> Result<&[u8], String> {
    let (bytes, stored) = coded.split_last_chunk::<4>().ok_or("cut short: shorter than its checksum")?;
    let (stored, found) = (u32::from_le_bytes(*stored), crc32c::crc32c(bytes));
    match stored == found {
        true => Ok(bytes),
        false => Err(format!("damaged: its crc32c is {stored:08x}, and {found:08x} of its bytes")),
    }
}

/// The decoded length, and the block behind it.
fn lz4_parts(coded: &[u8]) -> Result<(usize, &[u8]), String> {
    let (length, block) = coded.split_first_chunk::<4>().ok_or("damaged LZ4 data: cut short")?;
    Ok((u32::from_le_bytes(*length) as usize, block))
}

/// The codecs of an array, in the order in which they coded.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Codecs(Vec<Codec>);

impl Codecs {
    /// Collects codecs; `None` for more than any program writes.
    pub(super) fn new(codecs: Vec<Codec>) -> Option<Self> {
        (codecs.len() <= MOST_CODECS).then_some(Self(codecs))
    }

    /// Whether coded bytes are the plain ones.
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Fewest and most coded bytes of so many plain ones.
    pub(super) fn coded_bytes(&self, plain: u64) -> [u64; 2] {
        let most = self.0.iter().fold(plain, |bytes, codec| codec.coded_bytes(bytes));
        [if self.is_empty() { plain } else { 1 }, most]
    }

    /// Most bytes of memory beside the decoded chunk: coded bytes, the buffers of a stage, and a decoder's state.
    pub(super) fn memory_bytes(&self, plain: u64) -> u64 {
        let (mut bytes, mut most) = (plain, 0);
        for (i, codec) in self.0.iter().enumerate() {
            let coded = codec.coded_bytes(bytes);
            let decoded = if i == 0 { 0 } else { bytes };
            // Blosc shuffles in a block, which is the chunk at most.
            let block = if *codec == Codec::Blosc { bytes } else { 0 };
            most = most.max(coded.saturating_add(decoded).saturating_add(block).saturating_add(STATE_BYTES));
            bytes = coded;
        }
        most
    }

    /// Undoes all stages into exactly the buffer.
    pub(super) fn undo(&self, coded: Vec<u8>, out: &mut [u8]) -> Result<(), String> {
        let Some((first, others)) = self.0.split_first() else { return copied(&coded, out) };
        let mut bounds = vec![out.len() as u64];
        bounds.extend(self.0.iter().scan(out.len() as u64, |bytes, codec| {
            *bytes = codec.coded_bytes(*bytes);
            Some(*bytes)
        }));
        let mut coded = coded;
        for (codec, bound) in others.iter().zip(&bounds[1..]).rev() {
            coded = match codec {
                Codec::Crc32c => {
                    coded.truncate(checked(&coded)?.len());
                    coded
                }
                _ => codec.undo(&coded, *bound)?,
            };
        }
        first.undo_into(&coded, out)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::io::Write;

    const ALL: [Codec; 8] = [
        Codec::Blosc,
        Codec::Crc32c,
        Codec::Delta(Element::F16, Endian::Little),
        Codec::Gzip,
        Codec::Lz4,
        Codec::Shuffle(2),
        Codec::Zlib,
        Codec::Zstd,
    ];

    /// Codes bytes; differences are left as they are, as zeros but the first.
    fn coded(codec: Codec, plain: &[u8]) -> Vec<u8> {
        let bytes = plain.len() as u32;
        match codec {
            Codec::Blosc => {
                let head = [&[2, 1, blosc::STORED, 1][..], &bytes.to_le_bytes(), &bytes.to_le_bytes()].concat();
                [&head, &(bytes + 16).to_le_bytes()[..], plain].concat()
            }
            Codec::Crc32c => [plain, &crc32c::crc32c(plain).to_le_bytes()].concat(),
            Codec::Delta(..) => unreachable!(),
            Codec::Gzip => {
                let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
                encoder.write_all(plain).unwrap();
                encoder.finish().unwrap()
            }
            Codec::Lz4 => [&bytes.to_le_bytes()[..], &lz4_flex::block::compress(plain)].concat(),
            Codec::Shuffle(size) => {
                let mut out = vec![0; plain.len()];
                blosc::shuffle(size, plain, &mut out);
                out
            }
            Codec::Zlib => {
                let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::fast());
                encoder.write_all(plain).unwrap();
                encoder.finish().unwrap()
            }
            Codec::Zstd => {
                // Without the length, as streams are written.
                let mut encoder = zstd::stream::write::Encoder::new(Vec::new(), 1).unwrap();
                encoder.write_all(plain).unwrap();
                encoder.finish().unwrap()
            }
        }
    }

    fn some_codec() -> impl Strategy<Value = Codec> {
        prop::sample::select(ALL.into_iter().filter(|codec| !matches!(codec, Codec::Delta(..))).collect::<Vec<_>>())
    }

    proptest! {
        #![proptest_config(crate::testing::cases(300))]

        /// Any codecs in any order are undone, to the right length alone, within the bounds told.
        #[test]
        fn codecs_are_undone_in_reverse_order(
            codecs in prop::collection::vec(some_codec(), 0..4),
            plain in prop_oneof![prop::collection::vec(any::<u8>(), 1..500), prop::collection::vec(0u8..2, 1..5000)],
            cut in any::<prop::sample::Index>(),
        ) {
            let file = codecs.iter().fold(plain.clone(), |bytes, codec| coded(*codec, &bytes));
            let chain = Codecs::new(codecs.clone()).unwrap();
            let [least, most] = chain.coded_bytes(plain.len() as u64);
            prop_assert!((least..=most).contains(&(file.len() as u64)));
            let mut out = vec![0; plain.len()];
            prop_assert_eq!(chain.undo(file.clone(), &mut out), Ok(()));
            prop_assert_eq!(&out, &plain);
            for length in [plain.len() - 1, plain.len() + 1] {
                prop_assert!(chain.undo(file.clone(), &mut vec![0; length]).is_err());
            }
            let cut = cut.index(file.len());
            prop_assert!(chain.undo(file[..cut].to_vec(), &mut out).is_err(), "{} of {}", cut, file.len());
        }

        #[test]
        fn damaged_chunks_do_not_panic(
            codecs in prop::collection::vec(prop::sample::select(ALL.to_vec()), 0..4),
            bytes in prop::collection::vec(any::<u8>(), 0..200),
            expected in 0usize..300,
        ) {
            let _ = Codecs::new(codecs).unwrap().undo(bytes, &mut vec![0; expected]);
        }
    }

    #[test]
    fn a_wrong_checksum_is_an_error() {
        let chain = Codecs::new(vec![Codec::Crc32c]).unwrap();
        let file = coded(Codec::Crc32c, b"abc");
        assert_eq!(file, [b'a', b'b', b'c', 0xb7, 0x3f, 0x4b, 0x36]);
        let mut changed = file.clone();
        changed[1] ^= 1;
        let message = chain.undo(changed, &mut [0; 3]).unwrap_err();
        assert!(message.contains("its crc32c is 364b3fb7"), "{message}");
    }

    /// A length in a damaged stream allocates nothing.
    #[test]
    fn announced_lengths_are_bounded() {
        let chain = Codecs::new(vec![Codec::Zstd, Codec::Lz4]).unwrap();
        let message = chain.undo(vec![255, 255, 255, 255, 0], &mut [0; 9]).unwrap_err();
        assert!(message.contains("expected at most"), "{message}");
        let bomb = zstd::bulk::compress(&vec![0; 1 << 20], 1).unwrap();
        for codecs in [vec![Codec::Zstd], vec![Codec::Crc32c, Codec::Zstd]] {
            assert!(Codecs::new(codecs).unwrap().undo(bomb.clone(), &mut [0; 9]).is_err());
        }
    }
}
