//! Decoders of compressed bytes for HDF5's filters and Zarr's codecs. Each fills a buffer to its very end or fails, so a damaged length
//! allocates nothing. Costs a buffer of one block for Blosc.

use crate::blosc;
use crate::blosclz;
use crate::gzip::GzipMembers;
use std::io::Read;

/// Decodes a Blosc container of exactly the buffer's length.
///
/// # Errors
/// If it is damaged, of another length, or of an unknown compressor or version.
pub(crate) fn blosc(container: &[u8], out: &mut [u8]) -> Result<(), String> {
    let mut zstd = None;
    let decoded = blosc::decode(container, out, &mut Vec::new(), |compressor, coded, part| {
        let count = match compressor {
            blosc::BLOSCLZ => blosclz::decode(coded, part),
            blosc::LZ4 => lz4_flex::block::decompress_into(coded, part).ok(),
            blosc::ZLIB => zlib(coded, part).ok().map(|()| part.len()),
            blosc::ZSTD => zstd_stream(&mut zstd, coded, part),
            other => return Err(format!("Blosc with {} is not supported", blosc::name_of(other))),
        };
        match count == Some(part.len()) {
            true => Ok(()),
            false => Err(format!("damaged {} data of Blosc", blosc::name_of(compressor))),
        }
    });
    match decoded {
        Ok(()) => Ok(()),
        Err(blosc::Failure::Stream(problem)) => Err(problem),
        Err(blosc::Failure::Version(version)) => Err(format!("Blosc's format {version} is not supported")),
        Err(blosc::Failure::Length { expected, found }) => Err(length_differs(expected, found)),
        Err(blosc::Failure::Malformed(problem)) => Err(format!("damaged Blosc data: {problem}")),
    }
}

/// Decodes a stream of a container, of which all share a context.
fn zstd_stream(
    context: &mut Option<zstd::bulk::Decompressor<'static>>,
    coded: &[u8],
    part: &mut [u8],
) -> Option<usize> {
    if context.is_none() {
        *context = zstd::bulk::Decompressor::new().ok();
    }
    context.as_mut()?.decompress_to_buffer(coded, part).ok()
}

/// Decodes one or several Zstandard frames.
pub(crate) fn zstd(frames: &[u8], out: &mut [u8]) -> Result<(), String> {
    let found = zstd::bulk::decompress_to_buffer(frames, out);
    let found = found.map_err(|error| format!("damaged Zstandard data, or more than expected: {error}"))?;
    whole(found, out)
}

/// Inflates a zlib stream.
pub(crate) fn zlib(coded: &[u8], out: &mut [u8]) -> Result<(), String> {
    let mut inflate = flate2::Decompress::new(true);
    // Once more after a full buffer, for the checksum.
    let mut status = inflate.decompress(coded, out, flate2::FlushDecompress::Finish);
    if inflate.total_out() == out.len() as u64 && matches!(status, Ok(flate2::Status::Ok | flate2::Status::BufError)) {
        let rest = &coded[inflate.total_in() as usize..];
        status = inflate.decompress(rest, &mut [0], flate2::FlushDecompress::Finish);
    }
    if inflate.total_out() > out.len() as u64 {
        return Err(length_differs(out.len() as u64, inflate.total_out()));
    }
    match status {
        Ok(flate2::Status::StreamEnd) => whole(inflate.total_out() as usize, out),
        Ok(_) => Err("damaged zlib data: cut short".into()),
        Err(error) => Err(format!("damaged zlib data: {error}")),
    }
}

/// Inflates the members of a gzip file.
pub(crate) fn gzip(members: &[u8], out: &mut [u8]) -> Result<(), String> {
    let mut inflated = GzipMembers::new(members);
    let damaged = |error: std::io::Error| format!("damaged gzip data: {error}");
    let mut found = 0;
    while found < out.len() {
        match inflated.read(&mut out[found..]).map_err(damaged)? {
            0 => return whole(found, out),
            count => found += count,
        }
    }
    // The end is read too: checksums are before it.
    match inflated.read(&mut [0]).map_err(damaged)? {
        0 => Ok(()),
        _ => Err(format!("expected {} bytes decoded, found more", out.len())),
    }
}

/// Decodes a block of LZ4 without a header.
pub(crate) fn lz4(block: &[u8], out: &mut [u8]) -> Result<(), String> {
    let found = lz4_flex::block::decompress_into(block, out);
    whole(found.map_err(|error| format!("damaged LZ4 data: {error}"))?, out)
}

fn whole(found: usize, out: &[u8]) -> Result<(), String> {
    match found == out.len() {
        true => Ok(()),
        false => Err(length_differs(out.len() as u64, found as u64)),
    }
}

/// Message on another number of decoded bytes.
pub(crate) fn length_differs(expected: u64, found: u64) -> String {
    format!("expected {expected} bytes decoded, found {found}")
}

#[cfg(test)]
mod tests {
    use super::*;
    use flate2::Compression;
    use std::io::Write;

    type Decoder = fn(&[u8], &mut [u8]) -> Result<(), String>;

    /// Every decoder takes its own data to exactly their length: cut data, and other lengths, are errors.
    #[test]
    fn buffers_are_filled_to_their_end_or_not_at_all() {
        let plain: Vec<u8> = (0..3000u32).map(|i| (i / 7 * 31) as u8).collect();
        let mut zlib_stream = flate2::write::ZlibEncoder::new(Vec::new(), Compression::fast());
        let mut gzip_stream = flate2::write::GzEncoder::new(Vec::new(), Compression::fast());
        zlib_stream.write_all(&plain).unwrap();
        gzip_stream.write_all(&plain).unwrap();
        let coded: [(Vec<u8>, Decoder); 4] = [
            (zlib_stream.finish().unwrap(), zlib),
            (gzip_stream.finish().unwrap(), gzip),
            (zstd::bulk::compress(&plain, 1).unwrap(), super::zstd),
            (lz4_flex::block::compress(&plain), lz4),
        ];
        for (n, (coded, decode)) in coded.iter().enumerate() {
            let mut out = vec![0; plain.len()];
            assert_eq!(decode(coded, &mut out), Ok(()), "{n}");
            assert_eq!(out, plain, "{n}");
            assert!(decode(coded, &mut vec![0; plain.len() - 1]).is_err(), "{n}");
            assert!(decode(coded, &mut vec![0; plain.len() + 1]).is_err(), "{n}");
            for length in 0..coded.len() {
                assert!(decode(&coded[..length], &mut out).is_err(), "{n} {length}");
            }
        }
    }

    #[test]
    fn several_frames_and_members_are_one() {
        let [one, two] = [b"one ", b"two."].map(|text| zstd::bulk::compress(text, 1).unwrap());
        let mut out = [0; 8];
        super::zstd(&[one, two].concat(), &mut out).unwrap();
        assert_eq!(&out, b"one two.");
    }
}
