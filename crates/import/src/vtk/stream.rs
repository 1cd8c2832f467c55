//! Bytes of a coded array, in sequence: from base64, out of compressed blocks, or from numbers in words.
//!
//! Sizes of blocks are read side by side with the blocks, so memory is bounded by one LZ4 block, or by small buffers. The
//! sizes in a header must agree with the grid before anything is decoded.

use super::arrays::{Coding, Compressor, Words};
use crate::element::Element;
use brickyard_volume::{VoxelType, with_voxel_type};
use flate2::read::ZlibDecoder;
use std::fs::File;
use std::io::{BufRead, BufReader, Error, ErrorKind, Read, Result, Seek, SeekFrom};
use std::path::Path;

/// Most bytes of an LZ4 block, which is held whole. VTK's own have 32 KiB.
const LARGEST_LZ4_BLOCK: u64 = 256 << 20;
/// Most characters of a number in words.
const LONGEST_WORD: usize = 512;

/// Most distance of 255 times a fraction of 6 digits from a byte; other fractions stand for no byte.
const EXACT_COLOR: f64 = 1e-3;

fn bad(problem: impl Into<String>) -> Error {
    Error::new(ErrorKind::InvalidData, problem.into())
}

fn file_at(path: &Path, at: u64) -> Result<BufReader<File>> {
    let mut file = File::open(path)?;
    file.seek(SeekFrom::Start(at))?;
    Ok(BufReader::with_capacity(1 << 16, file))
}

fn bytes_at(path: &Path, at: u64, is_base64: bool) -> Result<Box<dyn Read>> {
    let file = file_at(path, at)?;
    Ok(if is_base64 { Box::new(Base64 { text: file, ready: Vec::with_capacity(3) }) } else { Box::new(file) })
}

/// Opens an array behind a header of its sizes, at a place in a file. `expected` is the array's bytes.
///
/// # Errors
/// If the header is cut short, or tells of other bytes than expected.
pub(super) fn headed(path: &Path, at: u64, coding: Coding, expected: u64) -> Result<Box<dyn Read>> {
    let mut sizes = Sizes { bytes: bytes_at(path, at, coding.is_base64)?, coding };
    let Some(compressor) = coding.compressor else {
        let found = sizes.next()?;
        check_bytes(u128::from(found), expected)?;
        return Ok(Box::new(sizes.bytes.take(expected)));
    };
    let [blocks, block_bytes, last_bytes] = [sizes.next()?, sizes.next()?, sizes.next()?];
    let [count, whole] = [u128::from(blocks), u128::from(block_bytes)];
    let total = match last_bytes {
        0 => count * whole,
        last => count.saturating_sub(1) * whole + u128::from(last),
    };
    check_bytes(if blocks == 0 { 0 } else { total }, expected)?;
    if compressor == Compressor::Lz4 && block_bytes.max(last_bytes) > LARGEST_LZ4_BLOCK {
        let most = LARGEST_LZ4_BLOCK >> 20;
        return Err(bad(format!(
            "blocks of {block_bytes} bytes, expected at most {most} MiB with vtkLZ4DataCompressor"
        )));
    }
    let mut data = bytes_at(path, at, coding.is_base64)?;
    let header_bytes = u128::from(blocks) * coding.size_bytes as u128 + 3 * coding.size_bytes as u128;
    let header_bytes = u64::try_from(header_bytes).map_err(|_| bad(format!("{blocks} blocks")))?;
    if std::io::copy(&mut (&mut data).take(header_bytes), &mut std::io::sink())? < header_bytes {
        return Err(bad(format!("cut short within the sizes of {blocks} blocks")));
    }
    let last_bytes = if last_bytes == 0 { block_bytes } else { last_bytes };
    Ok(Box::new(Blocks { sizes, left: blocks, block_bytes, last_bytes, compressor, state: State::Between(data) }))
}

/// Opens bytes that lie in a file as they are.
pub(super) fn plain(path: &Path, at: u64, bytes: u64) -> Result<Box<dyn Read>> {
    Ok(Box::new(file_at(path, at)?.take(bytes)))
}

fn check_bytes(found: u128, expected: u64) -> Result<()> {
    if found == u128::from(expected) {
        return Ok(());
    }
    Err(bad(format!("the array has {found} bytes by its own header, expected {expected} of the grid and type")))
}

/// Numbers of an array's header.
struct Sizes {
    bytes: Box<dyn Read>,
    coding: Coding,
}

impl Sizes {
    fn next(&mut self) -> Result<u64> {
        let (mut number, size) = ([0; 8], self.coding.size_bytes.min(8));
        if self.coding.is_big {
            self.bytes.read_exact(&mut number[8 - size..])?;
            Ok(u64::from_be_bytes(number))
        } else {
            self.bytes.read_exact(&mut number[..size])?;
            Ok(u64::from_le_bytes(number))
        }
    }
}

/// Blocks compressed one by one.
struct Blocks {
    sizes: Sizes,
    /// Blocks not begun.
    left: u64,
    block_bytes: u64,
    last_bytes: u64,
    compressor: Compressor,
    state: State,
}

enum State {
    Between(Box<dyn Read>),
    /// A block under way, and its bytes to come.
    Zlib(Box<ZlibDecoder<std::io::Take<Box<dyn Read>>>>, u64),
    Lz4(std::io::Cursor<Vec<u8>>, Box<dyn Read>),
    Failed,
}

impl Blocks {
    fn begin(&mut self, mut data: Box<dyn Read>) -> Result<State> {
        let packed = self.sizes.next()?;
        self.left -= 1;
        let whole = if self.left == 0 { self.last_bytes } else { self.block_bytes };
        match self.compressor {
            Compressor::Zlib => Ok(State::Zlib(Box::new(ZlibDecoder::new(data.take(packed))), whole)),
            Compressor::Lz4 => {
                // LZ4 adds at most 1 byte to 255, and 16.
                if packed > whole + whole / 255 + 16 {
                    return Err(bad(format!("an LZ4 block of {packed} bytes for {whole}")));
                }
                let mut block = Vec::new();
                (&mut data).take(packed).read_to_end(&mut block)?;
                // Nor does it shrink more than 255 times.
                if (block.len() as u64) < packed || whole > packed.saturating_mul(255) {
                    return Err(bad(format!("an LZ4 block of {} bytes, expected {packed} for {whole}", block.len())));
                }
                let mut out = vec![0; whole as usize];
                let found = lz4_flex::block::decompress_into(&block, &mut out);
                match found {
                    Ok(found) if found as u64 == whole => Ok(State::Lz4(std::io::Cursor::new(out), data)),
                    Ok(found) => Err(bad(format!("an LZ4 block holds {found} bytes, expected {whole}"))),
                    Err(error) => Err(bad(format!("an LZ4 block: {error}"))),
                }
            }
        }
    }

    /// Reads of the state's block; with nothing read, the next state.
    fn step(&mut self, state: State, out: &mut [u8]) -> Result<(usize, State)> {
        match state {
            State::Between(data) => Ok((0, self.begin(data)?)),
            State::Lz4(mut block, data) => match block.read(out)? {
                0 => Ok((0, State::Between(data))),
                n => Ok((n, State::Lz4(block, data))),
            },
            State::Zlib(mut block, left) => match block.read(out)? as u64 {
                0 if left > 0 => Err(bad(format!("a zlib block ends {left} bytes early"))),
                0 => {
                    let mut data = block.into_inner();
                    std::io::copy(&mut data, &mut std::io::sink())?;
                    Ok((0, State::Between(data.into_inner())))
                }
                n if n > left => Err(bad(format!("a zlib block holds {} bytes too many", n - left))),
                n => Ok((n as usize, State::Zlib(block, left - n))),
            },
            State::Failed => Err(bad("failed before")),
        }
    }
}

impl Read for Blocks {
    fn read(&mut self, out: &mut [u8]) -> Result<usize> {
        while !out.is_empty() {
            if self.left == 0 && matches!(self.state, State::Between(_)) {
                break;
            }
            let state = std::mem::replace(&mut self.state, State::Failed);
            let (count, state) = self.step(state, out)?;
            self.state = state;
            if count > 0 {
                return Ok(count);
            }
        }
        Ok(0)
    }
}

/// Bytes of base64 text up to a tag. Several encodings may follow one another, each with its own padding.
struct Base64<R> {
    text: R,
    /// Decoded bytes to be read, the last one first.
    ready: Vec<u8>,
}

impl<R: BufRead> Base64<R> {
    /// Decodes the next four characters; false at the text's end.
    fn group(&mut self) -> Result<bool> {
        let (mut bits, mut count, mut padding) = (0u32, 0, 0);
        while count < 4 {
            let byte = self.text.fill_buf()?.first().copied();
            let value = match byte {
                None | Some(b'<') if count == 0 => return Ok(false),
                None | Some(b'<') => return Err(bad("base64 text cut short")),
                Some(b' ' | b'\t' | b'\r' | b'\n') => {
                    self.text.consume(1);
                    continue;
                }
                Some(b'=') if count >= 2 => {
                    padding += 1;
                    0
                }
                Some(byte) => match (value_of(byte), padding) {
                    (Some(value), 0) => value,
                    _ => return Err(bad(format!("'{}' in base64 text", byte.escape_ascii()))),
                },
            };
            self.text.consume(1);
            bits = bits << 6 | value;
            count += 1;
        }
        let [_, bytes @ ..] = bits.to_be_bytes();
        self.ready.extend(bytes[..3 - padding].iter().rev());
        Ok(true)
    }
}

fn value_of(byte: u8) -> Option<u32> {
    let value = match byte {
        b'A'..=b'Z' => byte - b'A',
        b'a'..=b'z' => byte - b'a' + 26,
        b'0'..=b'9' => byte - b'0' + 52,
        b'+' => 62,
        b'/' => 63,
        _ => return None,
    };
    Some(value.into())
}

impl<R: BufRead> Read for Base64<R> {
    fn read(&mut self, out: &mut [u8]) -> Result<usize> {
        let mut count = 0;
        while count < out.len() {
            match self.ready.pop() {
                Some(byte) => {
                    out[count] = byte;
                    count += 1;
                }
                None if self.group()? => {}
                None => break,
            }
        }
        Ok(count)
    }
}

/// Opens `count` numbers in words, as little-endian bytes. In XML, a tag must follow.
pub(super) fn words(path: &Path, at: u64, element: Element, count: u64, style: Words) -> Result<Box<dyn Read>> {
    let text = file_at(path, at)?;
    Ok(Box::new(Numbers { text, element, count, read: 0, style, ready: Vec::with_capacity(8) }))
}

struct Numbers<R> {
    text: R,
    element: Element,
    count: u64,
    read: u64,
    style: Words,
    /// Bytes of the last number to be read, the last one first.
    ready: Vec<u8>,
}

impl<R: BufRead> Numbers<R> {
    /// Reads the next number; false after the last one.
    fn number(&mut self) -> Result<bool> {
        if self.read == self.count && self.style != Words::Xml {
            return Ok(false);
        }
        let word = next_word(&mut self.text, LONGEST_WORD)?;
        if word.is_empty() && self.read < self.count {
            return Err(bad(format!("{} numbers, expected {}", self.read, self.count)));
        }
        if word.is_empty() {
            return Ok(false);
        }
        if self.read == self.count {
            return Err(bad(format!("more than {} numbers", self.count)));
        }
        let found = std::str::from_utf8(&word).ok().and_then(|word| parsed(self.element, self.style, word));
        let found = found.ok_or_else(|| {
            let (element, word) = (self.element.name(), word.escape_ascii());
            bad(format!("'{word}' as number {} of type {element}", self.read))
        })?;
        self.ready.extend(found.iter().rev());
        self.read += 1;
        Ok(true)
    }
}

/// The next word, empty at a tag or the text's end; an error for longer ones.
pub(super) fn next_word(text: &mut impl BufRead, longest: usize) -> Result<Vec<u8>> {
    let mut word = Vec::new();
    loop {
        let Some(byte) = text.fill_buf()?.first().copied() else { return Ok(word) };
        match byte {
            b'<' => return Ok(word),
            byte if byte.is_ascii_whitespace() && word.is_empty() => {}
            byte if byte.is_ascii_whitespace() => return Ok(word),
            _ if word.len() == longest => return Err(bad(format!("a word of more than {longest} characters"))),
            byte => word.push(byte),
        }
        text.consume(1);
    }
}

/// Little-endian bytes of a number in words.
fn parsed(element: Element, style: Words, word: &str) -> Option<Vec<u8>> {
    Some(match element {
        Element::Voxel(VoxelType::U8) if style == Words::Colors => {
            let scaled = word.parse::<f64>().ok()? * 255.0;
            let byte = scaled.round();
            let is_byte = (0.0..=255.0).contains(&byte) && (scaled - byte).abs() <= EXACT_COLOR;
            is_byte.then_some(vec![byte as u8])?
        }
        Element::Voxel(VoxelType::I8) if style == Words::Legacy => {
            let byte = word.parse::<i16>().ok()?;
            (-128..=255).contains(&byte).then_some(vec![byte as u8])?
        }
        Element::Voxel(voxel_type) => {
            with_voxel_type!(voxel_type, T => word.parse::<T>().ok()?.to_le_bytes().to_vec())
        }
        Element::F64 => word.parse::<f64>().ok()?.to_le_bytes().to_vec(),
        Element::I64 => word.parse::<i64>().ok()?.to_le_bytes().to_vec(),
        Element::U64 => word.parse::<u64>().ok()?.to_le_bytes().to_vec(),
        Element::F16 => return None,
    })
}

impl<R: BufRead> Read for Numbers<R> {
    fn read(&mut self, out: &mut [u8]) -> Result<usize> {
        let mut count = 0;
        while count < out.len() {
            match self.ready.pop() {
                Some(byte) => {
                    out[count] = byte;
                    count += 1;
                }
                None if self.number()? => {}
                None => break,
            }
        }
        Ok(count)
    }
}

/// The element of an XML type; `None` for types that are not read.
pub(super) fn element_of_xml(kind: &str) -> Option<Element> {
    Some(match kind {
        "Int8" => Element::Voxel(VoxelType::I8),
        "UInt8" => Element::Voxel(VoxelType::U8),
        "Int16" => Element::Voxel(VoxelType::I16),
        "UInt16" => Element::Voxel(VoxelType::U16),
        "Int32" => Element::Voxel(VoxelType::I32),
        "UInt32" => Element::Voxel(VoxelType::U32),
        "Int64" => Element::I64,
        "UInt64" => Element::U64,
        "Float32" => Element::Voxel(VoxelType::F32),
        "Float64" => Element::F64,
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::temp_file;

    fn base64(text: &str) -> Result<Vec<u8>> {
        let mut out = Vec::new();
        Base64 { text: text.as_bytes(), ready: Vec::new() }.read_to_end(&mut out).map(|_| out)
    }

    #[test]
    fn base64_goes_on_after_padding_and_ends_at_a_tag() {
        assert_eq!(base64("TWFu").unwrap(), b"Man");
        assert_eq!(base64(" TW E=\r\n T\tQ==TWFu <DataArray").unwrap(), b"MaMMan");
        for bad in ["TWF", "TW=u", "T===", "TW!u", "=AAA"] {
            assert!(base64(bad).is_err(), "{bad}");
        }
    }

    fn read(text: &str, element: Element, count: u64, style: Words) -> Result<Vec<u8>> {
        let (_folder, path) = temp_file("a", text.as_bytes());
        let mut out = Vec::new();
        words(&path, 1, element, count, style)?.read_to_end(&mut out).map(|_| out)
    }

    #[test]
    fn words_are_the_nearest_numbers_and_all_of_them() {
        let [i8, f32] = [Element::Voxel(VoxelType::I8), Element::Voxel(VoxelType::F32)];
        assert_eq!(read("> -128\n 127 <", i8, 2, Words::Xml).unwrap(), [128, 127]);
        assert_eq!(read("> 1 2 3", i8, 2, Words::Legacy).unwrap(), [1, 2]);
        let floats = [0.1f32, f32::INFINITY, 1e-40].map(f32::to_le_bytes).concat();
        assert_eq!(read(">0.1 inf 1e-40</", f32, 3, Words::Xml).unwrap(), floats);
        assert_eq!(read("> -9223372036854775808", Element::I64, 1, Words::Xml).unwrap(), i64::MIN.to_le_bytes());
        assert_eq!(read("> 234 -22 255", i8, 3, Words::Legacy).unwrap(), [234, 234, 255]);
        assert!(read("> 256", i8, 1, Words::Legacy).is_err());
        let colors = read(">0.00392157 1 0.917647 0.498039", Element::Voxel(VoxelType::U8), 4, Words::Colors);
        assert_eq!(colors.unwrap(), [1, 255, 234, 127]);
        assert!(read(">0.5", Element::Voxel(VoxelType::U8), 1, Words::Colors).is_err());
        assert!(f32::from_le_bytes(read("> -nan", f32, 1, Words::Xml).unwrap().try_into().unwrap()).is_nan());
        for (text, words) in [("> 128", "'128'"), ("> 1.5", "'1.5'"), ("> 1 2 <", "more than 1"), ("> <", "0 numbers")]
        {
            let message = read(text, i8, 1, Words::Xml).unwrap_err().to_string();
            assert!(message.contains(words), "{message}");
        }
        assert!(read(&format!("> {}", "1".repeat(999)), f32, 1, Words::Xml).is_err());
    }

    fn zlib(bytes: &[u8]) -> Vec<u8> {
        let mut out = Vec::new();
        flate2::read::ZlibEncoder::new(bytes, flate2::Compression::fast()).read_to_end(&mut out).unwrap();
        out
    }

    const RAW: Coding = Coding { is_base64: false, is_big: false, size_bytes: 4, compressor: Some(Compressor::Zlib) };

    /// Reads blocks behind a header of these numbers.
    fn unpack(coding: Coding, header: &[u32], blocks: &[Vec<u8>], expected: u64) -> Result<Vec<u8>> {
        let header: Vec<u8> = match (coding.is_big, coding.size_bytes) {
            (false, 4) => header.iter().flat_map(|n| n.to_le_bytes()).collect(),
            (true, 4) => header.iter().flat_map(|n| n.to_be_bytes()).collect(),
            (false, _) => header.iter().flat_map(|n| u64::from(*n).to_le_bytes()).collect(),
            (true, _) => header.iter().flat_map(|n| u64::from(*n).to_be_bytes()).collect(),
        };
        let (_folder, path) = temp_file("a", &[b"_", &header[..], &blocks.concat(), b"more"].concat());
        let mut out = Vec::new();
        headed(&path, 1, coding, expected)?.read_to_end(&mut out).map(|_| out)
    }

    #[test]
    fn blocks_are_joined_and_sizes_must_agree() {
        let bytes: Vec<u8> = (0..=250).collect();
        for (is_big, size_bytes) in [(false, 4), (true, 4), (false, 8), (true, 8)] {
            let coding = Coding { is_big, size_bytes, ..RAW };
            for (compressor, pack) in [
                (Compressor::Zlib, &zlib as &dyn Fn(&[u8]) -> Vec<u8>),
                (Compressor::Lz4, &|bytes: &[u8]| lz4_flex::block::compress(bytes)),
            ] {
                let coding = Coding { compressor: Some(compressor), ..coding };
                let blocks: Vec<Vec<u8>> = bytes.chunks(100).map(pack).collect();
                let sizes: Vec<u32> = blocks.iter().map(|block| block.len() as u32).collect();
                let header = [&[3, 100, 51][..], &sizes].concat();
                assert_eq!(unpack(coding, &header, &blocks, 251).unwrap(), bytes);
                // Without a partial block, its size is 0.
                assert_eq!(
                    unpack(coding, &[&[2, 100, 0], &sizes[..2]].concat(), &blocks[..2], 200).unwrap(),
                    bytes[..200]
                );
                assert!(unpack(coding, &header, &blocks, 250).unwrap_err().to_string().contains("251 bytes"));
                assert!(unpack(coding, &[&[3, 99, 53][..], &sizes].concat(), &blocks, 251).is_err());
                assert!(unpack(coding, &header, &blocks[..2], 251).is_err());
                assert!(unpack(coding, &header[..5], &[], 251).is_err());
            }
        }
        let plain = Coding { compressor: None, ..RAW };
        assert_eq!(unpack(plain, &[4], &[b"abcd".to_vec()], 4).unwrap(), b"abcd");
        assert!(unpack(plain, &[5], &[b"abcd".to_vec()], 4).unwrap_err().to_string().contains("5 bytes"));
    }

    /// Sizes of exabytes in a header cost an error.
    #[test]
    fn hostile_sizes_take_no_memory() {
        let most = u32::MAX;
        for compressor in [Compressor::Zlib, Compressor::Lz4] {
            let coding = Coding { compressor: Some(compressor), ..RAW };
            let huge = u64::from(most) * u64::from(most);
            for header in [[most, most, 0, 1], [1, most, 0, most], [most, 1, 0, 9], [0, 0, 0, 0]] {
                for expected in [u64::from(most), huge, 24] {
                    assert!(unpack(coding, &header, &[], expected).is_err());
                }
            }
        }
        let coding = Coding { compressor: Some(Compressor::Lz4), ..RAW };
        assert!(unpack(coding, &[1, 200 << 20, 0, 9], &[vec![0; 9]], 200 << 20).is_err());
    }
}
