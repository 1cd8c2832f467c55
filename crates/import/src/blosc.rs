//! The Blosc-1 container: blocks of streams, of one compressor, of shuffled elements. Read here for the filter of HDF5 and for bricks of
//! stores; the shuffle goes both ways. Costs a buffer of one block.
//!
//! ```text
//! 0  format version 2 | 1  codec version | 2  flags | 3  typesize | 4  nbytes u32 | 8  blocksize u32 | 12  cbytes u32
//! 16 start of each block u32 ...        each block: one stream, or one per byte of the type ("split"):
//!                                       length u32, then the compressor's bytes, or uncompressed ones if the length is full
//! ```

/// Bytes before the starts of blocks.
pub const HEADER_BYTES: usize = 16;
/// The format's version.
pub const VERSION: u8 = 2;
/// Flag of shuffled bytes.
pub const BYTE_SHUFFLE: u8 = 0x01;
/// Flag of bytes without compression.
pub const STORED: u8 = 0x02;
const BIT_SHUFFLE: u8 = 0x04;
/// Flag of blocks of one stream.
pub const NOT_SPLIT: u8 = 0x10;
/// c-blosc does not split wider types, or streams shorter than this.
const MAX_SPLITS: usize = 16;
const MIN_STREAM_BYTES: usize = 128;

/// Numbers of the compressors.
pub const BLOSCLZ: u8 = 0;
/// LZ4, of any level.
pub const LZ4: u8 = 1;
/// zlib, with its header.
pub const ZLIB: u8 = 3;
/// Zstandard.
pub const ZSTD: u8 = 4;

/// Why a container cannot be decoded.
#[derive(Debug, PartialEq)]
pub enum Failure<E> {
    /// It holds another number of bytes.
    Length {
        /// Bytes to be decoded.
        expected: u64,
        /// Bytes announced by the container.
        found: u64,
    },
    /// It contradicts itself.
    Malformed(&'static str),
    /// A format of another version.
    Version(u8),
    /// A stream cannot be decoded.
    Stream(E),
}

/// The name of a compressor.
pub fn name_of(compressor: u8) -> &'static str {
    let names = ["blosclz", "lz4", "snappy", "zlib", "zstd"];
    names.get(usize::from(compressor)).unwrap_or(&"an unknown compressor")
}

/// Bytes that a container announces; `None` if it is shorter than its header.
pub fn decoded_bytes(container: &[u8]) -> Option<usize> {
    read_u32(container.get(..HEADER_BYTES)?, 4)
}

/// Decodes a container of exactly `out.len()` bytes into `out`. `stream` decodes a stream of a compressor to exactly the length of its
/// buffer. `shuffled` is working memory.
///
/// # Errors
/// If the container is damaged, of another version or length, or `stream` fails.
pub fn decode<E>(
    container: &[u8],
    out: &mut [u8],
    shuffled: &mut Vec<u8>,
    mut stream: impl FnMut(u8, &[u8], &mut [u8]) -> Result<(), E>,
) -> Result<(), Failure<E>> {
    let header = Header::parse(container, out.len())?;
    let body = &container[..header.container_bytes];
    if header.flags & STORED != 0 {
        let stored = body.get(HEADER_BYTES..HEADER_BYTES + out.len());
        out.copy_from_slice(stored.ok_or(Failure::Malformed("stored bytes cut short"))?);
        return Ok(());
    }
    let compressor = header.flags >> 5;
    decode_blocks(&header, body, shuffled, out, &mut |coded, part| stream(compressor, coded, part))
}

struct Header {
    flags: u8,
    typesize: usize,
    block_bytes: usize,
    container_bytes: usize,
}

impl Header {
    fn parse<E>(container: &[u8], expected_bytes: usize) -> Result<Self, Failure<E>> {
        let head = container.get(..HEADER_BYTES).ok_or(Failure::Malformed("container shorter than its header"))?;
        let (version, flags, typesize) = (head[0], head[2], head[3] as usize);
        let [data_bytes, block_bytes, container_bytes] = [4, 8, 12].map(|at| read_u32(head, at).unwrap_or(0));
        if version != VERSION {
            return Err(Failure::Version(version));
        }
        if data_bytes != expected_bytes {
            return Err(Failure::Length { expected: expected_bytes as u64, found: data_bytes as u64 });
        }
        if container_bytes > container.len() || typesize == 0 || (data_bytes > 0 && block_bytes == 0) {
            return Err(Failure::Malformed("header contradicts itself"));
        }
        Ok(Self { flags, typesize, block_bytes, container_bytes })
    }
}

/// Decodes one stream to a length.
type Stream<'a, E> = dyn FnMut(&[u8], &mut [u8]) -> Result<(), E> + 'a;

/// Undoes a shuffle of elements of some bytes, from one buffer into another.
type Unshuffle = fn(usize, &[u8], &mut [u8]);

fn decode_blocks<E>(
    header: &Header,
    body: &[u8],
    shuffled: &mut Vec<u8>,
    out: &mut [u8],
    stream: &mut Stream<'_, E>,
) -> Result<(), Failure<E>> {
    let unshuffled: Option<Unshuffle> = if header.flags & BYTE_SHUFFLE != 0 && header.typesize > 1 {
        Some(unshuffle)
    } else if header.flags & BIT_SHUFFLE != 0 && header.block_bytes >= header.typesize {
        Some(unshuffle_bits)
    } else {
        None
    };
    for (i, block) in out.chunks_mut(header.block_bytes.max(1)).enumerate() {
        let start = read_u32(body, HEADER_BYTES + 4 * i).ok_or(Failure::Malformed("block starts cut short"))?;
        // The last block, if shorter, is never split.
        let split = header.flags & NOT_SPLIT == 0
            && header.typesize <= MAX_SPLITS
            && header.block_bytes / header.typesize >= MIN_STREAM_BYTES
            && block.len() == header.block_bytes;
        let streams = if split { header.typesize } else { 1 };
        let Some(unshuffled) = unshuffled else {
            decode_streams(body, start, streams, block, stream)?;
            continue;
        };
        shuffled.resize(block.len(), 0);
        decode_streams(body, start, streams, shuffled, stream)?;
        unshuffled(header.typesize, shuffled, block);
    }
    Ok(())
}

fn decode_streams<E>(
    body: &[u8],
    mut at: usize,
    streams: usize,
    out: &mut [u8],
    stream: &mut Stream<'_, E>,
) -> Result<(), Failure<E>> {
    let stream_bytes = out.len() / streams;
    if stream_bytes * streams != out.len() {
        return Err(Failure::Malformed("block does not divide into streams"));
    }
    for part in out.chunks_mut(stream_bytes.max(1)) {
        let length = read_u32(body, at).ok_or(Failure::Malformed("stream length outside the container"))?;
        let data = body.get(at + 4..).and_then(|d| d.get(..length)).ok_or(Failure::Malformed("stream cut short"))?;
        if length == part.len() {
            part.copy_from_slice(data);
        } else {
            stream(data, part).map_err(Failure::Stream)?;
        }
        at += 4 + length;
    }
    Ok(())
}

fn read_u32(bytes: &[u8], at: usize) -> Option<usize> {
    let four = bytes.get(at..)?.first_chunk::<4>()?;
    Some(u32::from_le_bytes(*four) as usize)
}

/// Writes the first bytes of all elements to `out`, then their second bytes, and so on. Bytes past the last whole
/// element stay in place.
pub fn shuffle(typesize: usize, data: &[u8], out: &mut [u8]) {
    let count = data.len() / typesize;
    let (body, rest) = data.split_at(count * typesize);
    let (planes, out_rest) = out.split_at_mut(count * typesize);
    match typesize {
        2 => wide::split_2(body, planes),
        4 => wide::split_4(body, planes),
        _ => {
            for (k, plane) in planes.chunks_exact_mut(count.max(1)).enumerate() {
                plane.iter_mut().zip(body.chunks_exact(typesize)).for_each(|(p, v)| *p = v[k]);
            }
        }
    }
    out_rest.copy_from_slice(rest);
}

/// Puts bytes back of which the first ones of all elements come first, then their second ones, and so on. Bytes past the last whole
/// element stay in place.
pub fn unshuffle(typesize: usize, data: &[u8], out: &mut [u8]) {
    let count = data.len() / typesize;
    let (planes, rest) = data.split_at(count * typesize);
    let (body, out_rest) = out.split_at_mut(count * typesize);
    match typesize {
        2 => wide::join_2(planes, body),
        4 => wide::join_4(planes, body),
        _ => {
            for (k, plane) in planes.chunks_exact(count.max(1)).enumerate() {
                body.chunks_exact_mut(typesize).zip(plane).for_each(|(v, p)| v[k] = *p);
            }
        }
    }
    out_rest.copy_from_slice(rest);
}

/// Loops for 2 and 4 bytes that compile to vector shifts; also compiled for AVX2, used if available.
mod wide {
    macro_rules! dispatched {
        ($(#[$doc:meta])* $name:ident, $from:ident, $to:ident, $body:block) => {
            $(#[$doc])*
            pub(super) fn $name($from: &[u8], $to: &mut [u8]) {
                #[cfg(target_arch = "x86_64")]
                if std::arch::is_x86_feature_detected!("avx2") {
                    #[target_feature(enable = "avx2")]
                    fn avx2($from: &[u8], $to: &mut [u8]) $body
                    // SAFETY: the processor has the feature.
                    return unsafe { avx2($from, $to) };
                }
                $body
            }
        };
    }

    dispatched!(split_2, data, planes, {
        let (low, high) = planes.split_at_mut(data.len() / 2);
        for ((v, l), h) in data.as_chunks::<2>().0.iter().zip(low).zip(high) {
            [*l, *h] = *v;
        }
    });
    dispatched!(split_4, data, planes, {
        let (ab, cd) = planes.split_at_mut(data.len() / 2);
        let ((a, b), (c, d)) = (ab.split_at_mut(data.len() / 4), cd.split_at_mut(data.len() / 4));
        for ((((v, a), b), c), d) in data.as_chunks::<4>().0.iter().zip(a).zip(b).zip(c).zip(d) {
            let v = u32::from_le_bytes(*v);
            (*a, *b, *c, *d) = (v as u8, (v >> 8) as u8, (v >> 16) as u8, (v >> 24) as u8);
        }
    });
    dispatched!(join_2, planes, data, {
        let (low, high) = planes.split_at(data.len() / 2);
        for ((v, &l), &h) in data.as_chunks_mut::<2>().0.iter_mut().zip(low).zip(high) {
            *v = (l as u16 | (h as u16) << 8).to_le_bytes();
        }
    });
    dispatched!(join_4, planes, data, {
        let (ab, cd) = planes.split_at(data.len() / 2);
        let ((a, b), (c, d)) = (ab.split_at(ab.len() / 2), cd.split_at(cd.len() / 2));
        for ((((v, &a), &b), &c), &d) in data.as_chunks_mut::<4>().0.iter_mut().zip(a).zip(b).zip(c).zip(d) {
            *v = (a as u32 | (b as u32) << 8 | (c as u32) << 16 | (d as u32) << 24).to_le_bytes();
        }
    });
}

/// Undoes Blosc's bit shuffle: row `b` of `8 * typesize` holds bit `b` of all elements, eight to a byte. It applies
/// only to multiples of eight elements; other blocks are stored unshuffled.
fn unshuffle_bits(typesize: usize, data: &[u8], out: &mut [u8]) {
    let count = data.len() / typesize;
    out.copy_from_slice(data);
    if !count.is_multiple_of(8) || count == 0 {
        return;
    }
    let bytes = count * typesize;
    join_bits(typesize, &data[..bytes], &mut out[..bytes]);
}

/// Puts bits back: `bits` holds bit 0 of byte 0 of all elements, then bit 1, ..., then those of byte 1. Elements are a multiple of eight.
pub(crate) fn join_bits(typesize: usize, bits: &[u8], out: &mut [u8]) {
    let row = out.len() / typesize / 8;
    if row == 0 {
        return;
    }
    for (byte, rows) in bits.chunks_exact(8 * row).take(typesize).enumerate() {
        for (group, elements) in out.chunks_exact_mut(8 * typesize).enumerate() {
            let eight = transposed(std::array::from_fn(|bit| rows[bit * row + group]));
            for (element, part) in elements.chunks_exact_mut(typesize).zip(eight) {
                element[byte] = part;
            }
        }
    }
}

/// Transposes 8 rows of 8 bits, in three steps of exchanged blocks.
fn transposed(rows: [u8; 8]) -> [u8; 8] {
    let mut bits = u64::from_le_bytes(rows);
    for (shift, mask) in [(7, 0x00aa_00aa_00aa_00aa), (14, 0x0000_cccc_0000_cccc), (28, 0x0000_0000_f0f0_f0f0)] {
        let swap = (bits ^ bits >> shift) & mask;
        bits ^= swap ^ swap << shift;
    }
    bits.to_le_bytes()
}
