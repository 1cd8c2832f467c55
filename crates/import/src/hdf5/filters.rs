//! Filters of chunks, undone one by one: the parser's own (deflate, shuffle, Fletcher-32, szip, n-bit, scale-offset), and LZF, LZ4,
//! bitshuffle, Zstandard and Blosc here. No stage may grow beyond a bound. Costs one copy of the chunk per filter.

use crate::blosc;
use crate::inflate;
use hdf5_reader::FilterRegistry;
use hdf5_reader::filters::{FILTER_FLETCHER32, FILTER_SHUFFLE, fletcher32, shuffle};
use hdf5_reader::messages::filter_pipeline::FilterDescription;

const LZF: u16 = 32000;
const LZ4: u16 = 32004;
const BLOSC: u16 = 32001;
const BITSHUFFLE: u16 = 32008;
const ZSTD: u16 = 32015;

/// Filters undone by the parser.
const OF_PARSER: [u16; 6] = [1, 2, 3, 4, 5, 6];

/// Registered filters, for messages.
const NAMES: &[(u16, &str)] = &[
    (257, "user-defined"),
    (305, "LZO"),
    (307, "bzip2"),
    (32002, "MAFISC"),
    (32003, "Snappy"),
    (32005, "APAX"),
    (32006, "CBF"),
    (32007, "JPEG-XR"),
    (32009, "SPDP"),
    (32010, "LPC-Rice"),
    (32011, "CCSDS-123"),
    (32012, "JPEG-LS"),
    (32013, "ZFP"),
    (32014, "fpzip"),
    (32016, "B3D, of the B³D plugin"),
    (32017, "SZ"),
    (32018, "FCIDECOMP"),
    (32019, "JPEG"),
    (32020, "VBZ"),
    (32021, "FAPEC"),
    (32022, "BitGroom"),
    (32023, "Granular BitRound"),
    (32024, "SZ3"),
    (32025, "Delta-Rice"),
    (32026, "Blosc2"),
    (32027, "FLAC"),
    (32028, "H5Z-SPERR"),
    (32029, "TERSE/PROLIX"),
    (32030, "FFMPEG"),
    (32031, "JPEG 2000 by HDF5 plugin"),
];

/// Bytes of a bitshuffle block of unsaid size, and its least number of elements.
const BITSHUFFLE_BLOCK: usize = 8192;
const BITSHUFFLE_LEAST: usize = 128;

/// Most filters of a pipeline, by the format.
const MOST_FILTERS: usize = 32;

/// Refuses a pipeline with a filter that cannot be undone; the error names it.
pub(super) fn check(filters: &[FilterDescription]) -> Result<(), String> {
    if filters.len() > MOST_FILTERS {
        return Err(format!("a pipeline of {} filters", filters.len()));
    }
    // A setting tells Blosc's compressor, of which Snappy is the fourth.
    if filters.iter().any(|filter| filter.id == BLOSC && filter.client_data.get(6) == Some(&3)) {
        return Err(format!("the filter {BLOSC} (Blosc with Snappy)"));
    }
    let is_known = |id: u16| OF_PARSER.contains(&id) || [LZF, LZ4, BLOSC, BITSHUFFLE, ZSTD].contains(&id);
    let Some(filter) = filters.iter().find(|filter| !is_known(filter.id)) else { return Ok(()) };
    let of_table = NAMES.iter().find(|(id, _)| *id == filter.id).map(|(_, name)| *name);
    Err(match of_table.or(filter.name.as_deref().map(str::trim).filter(|name| !name.is_empty())) {
        Some(name) => format!("the filter {} ({name})", filter.id),
        None => format!("the filter {}", filter.id),
    })
}

/// Undoes a chunk's filters, but those of the mask, to exactly `expected` bytes.
pub(super) fn undo(
    stored: &[u8],
    filters: &[FilterDescription],
    mask: u32,
    element_bytes: usize,
    expected: usize,
) -> Result<Vec<u8>, String> {
    let parser = FilterRegistry::new();
    // Coded bytes between two stages may be a little longer than plain ones.
    let bound = expected.saturating_add(expected / 8).saturating_add(4096);
    let mut decoded: Option<Vec<u8>> = None;
    for (place, filter) in filters.iter().enumerate().rev() {
        if mask.checked_shr(place as u32).unwrap_or(0) & 1 == 1 {
            continue;
        }
        let input = decoded.as_deref().unwrap_or(stored);
        let output = match filter.id {
            FILTER_SHUFFLE => {
                let size = filter.client_data.first().map_or(element_bytes, |size| *size as usize);
                if size == 0 { input.to_vec() } else { shuffle::unshuffle(input, size) }
            }
            FILTER_FLETCHER32 => fletcher32::verify_and_strip(input).map_err(|error| error.to_string())?,
            LZF => lzf(input, bound).ok_or("damaged LZF data")?,
            // The parser reads chunks of one block alone.
            LZ4 => lz4(input, bound).ok_or("damaged LZ4 data")?,
            BLOSC => of_blosc(input, bound)?,
            BITSHUFFLE => bitshuffle(input, &filter.client_data, bound).ok_or("damaged bitshuffle data")?,
            ZSTD => zstd::bulk::decompress(input, bound).map_err(|error| format!("damaged Zstandard data: {error}"))?,
            _ => {
                let output = parser.apply_with_limit(filter, input, element_bytes, Some(bound));
                output.map_err(|error| error.to_string())?
            }
        };
        decoded = Some(output);
    }
    let decoded = decoded.unwrap_or_else(|| stored.to_vec());
    match decoded.len() == expected {
        true => Ok(decoded),
        false => Err(format!("expected {expected} bytes decoded, found {}", decoded.len())),
    }
}

/// Undoes LZF: runs of bytes, and references back.
fn lzf(input: &[u8], bound: usize) -> Option<Vec<u8>> {
    let mut output: Vec<u8> = Vec::new();
    let mut rest = input;
    while let Some((&control, after)) = rest.split_first() {
        rest = after;
        if control < 32 {
            let (run, after) = rest.split_at_checked(usize::from(control) + 1)?;
            output.extend_from_slice(run);
            rest = after;
        } else {
            let mut length = usize::from(control >> 5) + 2;
            if control >> 5 == 7 {
                let (&more, after) = rest.split_first()?;
                length += usize::from(more);
                rest = after;
            }
            let (&low, after) = rest.split_first()?;
            rest = after;
            let back = (usize::from(control & 31) << 8 | usize::from(low)) + 1;
            let start = output.len().checked_sub(back)?;
            // A reference may reach into its own output.
            for at in start..start + length {
                output.push(*output.get(at)?);
            }
        }
        if output.len() > bound {
            return None;
        }
    }
    Some(output)
}

/// Undoes LZ4: after the chunk's size and a block's, the blocks, each behind its coded size. One that is not smaller is plain.
fn lz4(input: &[u8], bound: usize) -> Option<Vec<u8>> {
    let (total, rest) = input.split_at_checked(8)?;
    let (block, mut rest) = rest.split_at_checked(4)?;
    let total = usize::try_from(u64::from_be_bytes(total.try_into().ok()?)).ok().filter(|total| *total <= bound)?;
    let block = u32::from_be_bytes(block.try_into().ok()?) as usize;
    let mut output = vec![0; total];
    for part in output.chunks_mut(block.max(1)) {
        let (length, after) = rest.split_at_checked(4)?;
        let length = u32::from_be_bytes(length.try_into().ok()?) as usize;
        let (coded, after) = after.split_at_checked(length)?;
        rest = after;
        if coded.len() == part.len() {
            part.copy_from_slice(coded);
        } else if lz4_flex::block::decompress_into(coded, part).ok()? != part.len() {
            return None;
        }
    }
    Some(output)
}

/// Decodes a Blosc container.
fn of_blosc(input: &[u8], bound: usize) -> Result<Vec<u8>, String> {
    let total = blosc::decoded_bytes(input).filter(|total| *total <= bound).ok_or("damaged Blosc data")?;
    let mut output = vec![0; total];
    inflate::blosc(input, &mut output)?;
    Ok(output)
}

/// Undoes bitshuffle, and LZ4 (2) or Zstandard (3) of its blocks.
fn bitshuffle(input: &[u8], settings: &[u32], bound: usize) -> Option<Vec<u8>> {
    let number = |at: usize| settings.get(at).map_or(0, |n| *n as usize);
    let (size, codec) = (number(2), number(4));
    if size == 0 || size > 1 << 16 || !matches!(codec, 0 | 2 | 3) {
        return None;
    }
    let (total, block, mut rest) = if codec == 0 {
        (input.len(), number(3), input)
    } else {
        let total = usize::try_from(u64::from_be_bytes(input.get(..8)?.try_into().ok()?)).ok()?;
        let block = u32::from_be_bytes(input.get(8..12)?.try_into().ok()?) as usize;
        (total, block / size, &input[12..])
    };
    let block = match block {
        0 => (BITSHUFFLE_BLOCK / size / 8 * 8).max(BITSHUFFLE_LEAST),
        block => block,
    };
    if total > bound || block % 8 != 0 {
        return None;
    }
    let mut output = vec![0; total];
    // Elements after the last multiple of 8 are left as they are.
    let shuffled = total / size / 8 * 8 * size;
    let (blocks, tail) = output.split_at_mut(shuffled);
    let mut buffer = Vec::new();
    for part in blocks.chunks_mut(block.checked_mul(size)?) {
        let bits = if codec == 0 {
            let (bits, after) = rest.split_at_checked(part.len())?;
            rest = after;
            bits
        } else {
            let (length, after) = rest.split_at_checked(4)?;
            let length = u32::from_be_bytes(length.try_into().ok()?) as usize;
            let (coded, after) = after.split_at_checked(length)?;
            rest = after;
            buffer.resize(part.len(), 0);
            let decoded = match codec {
                2 => lz4_flex::block::decompress_into(coded, &mut buffer).ok()?,
                _ => zstd::bulk::decompress_to_buffer(coded, &mut buffer[..]).ok()?,
            };
            if decoded != part.len() {
                return None;
            }
            &buffer[..]
        };
        blosc::join_bits(size, bits, part);
    }
    tail.copy_from_slice(rest.get(..tail.len())?);
    Some(output)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn filter(id: u16, client_data: &[u32]) -> FilterDescription {
        FilterDescription { id, name: None, client_data: client_data.to_vec() }
    }

    #[test]
    fn unknown_filters_are_named() {
        assert_eq!(check(&[filter(1, &[]), filter(32008, &[])]), Ok(()));
        assert_eq!(check(&[filter(32026, &[])]).unwrap_err(), "the filter 32026 (Blosc2)");
        let named = FilterDescription { name: Some("mine".into()), ..filter(40000, &[]) };
        assert_eq!(check(&[named]).unwrap_err(), "the filter 40000 (mine)");
        assert_eq!(check(&[filter(40001, &[])]).unwrap_err(), "the filter 40001");
        assert!(check(&[filter(32001, &[2, 2, 4, 99, 5, 1, 3])]).unwrap_err().contains("Snappy"));
        assert_eq!(check(&[filter(32001, &[2, 2, 4, 99, 5, 1, 4])]), Ok(()));
        assert!(check(&vec![filter(1, &[]); 33]).is_err());
    }

    #[test]
    fn lzf_copies_runs_and_references() {
        // "abc", then 5 bytes from 3 back: "abcab"; then 9 + 1 more by a long reference of 1 back.
        let coded = [2, b'a', b'b', b'c', 3 << 5, 2, 7 << 5, 1, 0];
        assert_eq!(lzf(&coded, 100).unwrap(), b"abcabcabbbbbbbbbbb"[..].to_vec());
        assert_eq!(lzf(&coded, 10), None);
        for length in [3, 5, 7, 8] {
            assert_eq!(lzf(&coded[..length], 100), None, "{length}");
        }
        assert_eq!(lzf(&[1 << 5, 0], 9), None, "before the start");
    }

    #[test]
    fn blocks_of_lz4_follow_one_another() {
        let coded = lz4_flex::block::compress(&[7; 40]);
        let size = |n: usize| (n as u32).to_be_bytes();
        let head = [&90u64.to_be_bytes()[..], &size(40)].concat();
        let blocks = [&size(coded.len())[..], &coded, &size(40), &[8; 40], &size(10), &[9; 10]].concat();
        let whole = [head.clone(), blocks].concat();
        let expected = [vec![7; 40], vec![8; 40], vec![9; 10]].concat();
        assert_eq!(undo(&whole, &[filter(LZ4, &[40])], 0, 1, 90), Ok(expected));
        for length in 0..whole.len() {
            assert_eq!(lz4(&whole[..length], 90), None, "{length}");
        }
        assert_eq!(lz4(&whole, 89), None, "beyond the bound");
    }

    #[test]
    fn bits_are_put_back() {
        // Eight elements of one byte, of which element 3 is 0b101: bits 0 and 2 at place 3.
        let mut bits = [0; 8];
        (bits[0], bits[2]) = (1 << 3, 1 << 3);
        let plain = bitshuffle(&[&bits[..], &[77]].concat(), &[0, 2, 1, 0, 0], 100).unwrap();
        assert_eq!(plain, [0, 0, 0, 5, 0, 0, 0, 0, 77]);
        let coded = zstd::bulk::compress(&bits, 1).unwrap();
        let head = [&9u64.to_be_bytes()[..], &128u32.to_be_bytes(), &(coded.len() as u32).to_be_bytes()].concat();
        let whole = [&head[..], &coded, &[77]].concat();
        assert_eq!(bitshuffle(&whole, &[0, 2, 1, 0, 3], 100).unwrap(), plain);
        assert_eq!(bitshuffle(&whole[..whole.len() - 1], &[0, 2, 1, 0, 3], 100), None);
        assert_eq!(bitshuffle(&whole, &[0, 2, 1, 0, 3], 8), None);
    }

    /// Made by c-blosc through hdf5plugin: split streams of shuffled bytes, and bits of a number that is no multiple of eight.
    #[test]
    fn containers_of_blosc_are_decoded() {
        let expected: Vec<u8> = (0..300u16).flat_map(|i| (i / 9 * 3).to_le_bytes()).collect();
        let blosclz = "020101025802000058020000b90000001400000090000000230000000060030003c0000006c0000009c000000cc000000fc00000\
            12c0000015c0000018c000001bc000001ec0000021c0000024c0000027c000002ac000002dc0000030c0000033c0000036c0000039c000003cc00\
            0003fc0000042c0000045c0000048c000004bc000004ec0000051c0000054c0000057c000005ac000005dc0000b6060606060606060606363630d\
            0000002300000000e0ff1d0302000000";
        let lz4 = "020124025802000058020000b5000000140000004d0000001d0001001d0302001d0602001d0902001d0c02001d0f02001d1202001d1502\
            001d1802001d1b02001d1e02001d2102001d2402001d2702001d2a02001d2d0200c03000300030003000300030004c00000020300002001d33020\
            01d3602001d3902001d3c02001d3f02001d4202001d4502001d4802001d4b02001d4e02001d5102001d5402001d5702001d5a02001d5d02001d60\
            020060630063006300";
        let zlib = "02016102580200005802000077000000140000004e000000785e35c1e10683600000c018314644448c88888888111123c6181131e27b\
            ff77e84f771745971b31771e24a464e4143c29a9a86968e9e81978313231f366e1c3971f2b1b3b7f0e420827fd2938da0d000000785e63601805c\
            40200012c0001";
        let settings = filter(BLOSC, &[2, 2, 2, 600, 5, 1, 0]);
        for hex in [blosclz, lz4, zlib] {
            let container: Vec<u8> =
                (0..hex.len()).step_by(2).map(|i| u8::from_str_radix(&hex[i..i + 2], 16).unwrap()).collect();
            let undone = |bytes: &[u8], expected| undo(bytes, std::slice::from_ref(&settings), 0, 2, expected);
            assert_eq!(undone(&container, 600), Ok(expected.clone()));
            assert!(undone(&container, 598).unwrap_err().contains("expected 598 bytes decoded, found 600"));
            for length in 0..container.len() {
                assert!(undone(&container[..length], 600).is_err(), "{length}");
            }
            // A container of more bytes than a chunk may have.
            let huge = [&container[..4], &[255, 255, 255, 127], &container[8..]].concat();
            assert_eq!(undone(&huge, 600).unwrap_err(), "damaged Blosc data");
            let snappy = [&container[..2], &[2 << 5], &container[3..]].concat();
            assert_eq!(undone(&snappy, 600).unwrap_err(), "Blosc with snappy is not supported");
        }
    }

    proptest! {
        #[test]
        fn damaged_chunks_do_not_panic(
            bytes in prop::collection::vec(any::<u8>(), 0..200),
            id in prop::sample::select(vec![1u16, 2, 3, 4, 5, 6, 32000, 32001, 32004, 32008, 32015]),
            settings in prop::collection::vec(0u32..40, 0..22),
            expected in 0usize..300,
        ) {
            let _ = undo(&bytes, &[filter(id, &settings)], 0, 2, expected);
        }
    }
}
