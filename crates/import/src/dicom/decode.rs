//! Decoders of separately packed frames: run-length, JPEG and JPEG 2000. Errors omit the file.

use super::jpeg_lossless::Stream;
use super::pixels::{MOST_JPEG_2000_BITS, PixelFormat, Samples};
use crate::element::Endian;
use hayro_jpeg2000::{DecodeSettings, DecoderContext, Image};
use jpeg_decoder::{CodingProcess, PixelFormat as JpegFormat};

/// Decodes a run-length encoded frame: a table of offsets, then one plane for each byte of a number, the highest byte
/// first.
pub(super) fn rle(bytes: &[u8], format: &PixelFormat) -> Result<Samples, String> {
    let (words, _) = bytes.as_chunks::<4>();
    let word = |i: usize| words.get(i).map_or(0, |w| u32::from_le_bytes(*w) as usize);
    if words.len() < 16 || word(0) != format.width {
        return Err(format!("expected {} planes of bytes, found {}", format.width, word(0)));
    }
    let pixels = format.pixels() as usize;
    let mut decoded = vec![0; pixels * format.width];
    for plane in 0..format.width {
        let end = if plane + 1 < format.width { word(plane + 2) } else { bytes.len() };
        let runs = bytes.get(word(plane + 1)..end).ok_or("a plane lies past its end")?;
        let found = unpack_runs(runs, decoded[plane..].iter_mut().step_by(format.width));
        if found < pixels {
            return Err(format!("expected {pixels} pixels, found {found}"));
        }
    }
    Ok(Samples::decoded(decoded, format.width, Endian::Big))
}

/// Unpacks runs (PackBits) until either side ends; returns the number of unpacked bytes.
fn unpack_runs<'a>(mut runs: &[u8], mut out: impl Iterator<Item = &'a mut u8>) -> usize {
    let mut count = 0;
    while let [head, rest @ ..] = runs {
        let head = *head as i8;
        let (values, repeat, used) = match head {
            0.. => (&rest[..rest.len().min(head as usize + 1)], 1, head as usize + 1),
            -128 => (&rest[..0], 0, 0),
            _ => (&rest[..rest.len().min(1)], 1 - head as isize, 1),
        };
        for value in values {
            for _ in 0..repeat {
                let Some(place) = out.next() else { return count };
                *place = *value;
                count += 1;
            }
        }
        runs = &rest[used.min(rest.len())..];
    }
    count
}

/// Decodes a JPEG frame, baseline or lossless.
pub(super) fn jpeg(bytes: &[u8], format: &PixelFormat) -> Result<Samples, String> {
    if let Some(stream) = Stream::of(bytes) {
        return stream.decode(format);
    }
    let mut decoder = jpeg_decoder::Decoder::new(bytes);
    decoder.set_max_decoding_buffer_size(format.pixels() as usize * 4);
    decoder.read_info().map_err(|e| e.to_string())?;
    let info = decoder.info().ok_or("no image in it")?;
    let found = [u32::from(info.width), u32::from(info.height)];
    let width = match info.pixel_format {
        JpegFormat::L8 => 1,
        JpegFormat::L16 => 2,
        colour => return Err(format!("expected one grey value a pixel, found {colour:?}")),
    };
    format.check_decoded(found, width)?;
    let mut bytes = decoder.decode().map_err(|e| e.to_string())?;
    if bytes.len() as u64 != format.pixels() * width as u64 {
        return Err(format!("expected {} bytes of pixels, found {}", format.pixels() * width as u64, bytes.len()));
    }
    // The decoder keeps lossy numbers within eight bits; fewer may be stored.
    if info.coding_process != CodingProcess::Lossless && width == 1 {
        bytes.iter_mut().for_each(|b| *b = format.clamped((*b).into(), false) as u8);
    }
    Ok(Samples::decoded(bytes, width, Endian::native()))
}

/// Decodes a JPEG 2000 frame, lossless or lossy. A truncated stream is an error, because the decoder would invent the
/// rest.
pub(super) fn jpeg_2000(bytes: &[u8], format: &PixelFormat) -> Result<Samples, String> {
    let settings = DecodeSettings { strict: true, ..DecodeSettings::default() };
    let image = Image::new(bytes, &settings).map_err(|e| e.to_string())?;
    let bits = image.original_bit_depth() as u32;
    format.check_decoded([image.width(), image.height()], bits.div_ceil(8) as usize)?;
    if bits > MOST_JPEG_2000_BITS {
        return Err(format!("numbers of {bits} bits in JPEG 2000, of which {MOST_JPEG_2000_BITS} are read exactly"));
    }
    let mut context = DecoderContext::default();
    let decoded = image.decode(&mut context).map_err(|e| e.to_string())?;
    let [plane] = decoded.components() else {
        return Err(format!("expected one grey value a pixel, found {}", decoded.components().len()));
    };
    if plane.samples().len() as u64 != format.pixels() {
        return Err(format!("expected {} pixels, found {}", format.pixels(), plane.samples().len()));
    }
    // The decoder treats all numbers as unsigned, and shifts them up by half their range.
    let signed = is_signed_jpeg_2000(bytes);
    let moved = if signed { 1i64 << (bits - 1) } else { 0 };
    let mut out = Vec::with_capacity(plane.samples().len() * format.width);
    for sample in plane.samples() {
        // Lossy numbers may leave their range: the stream's, and the stored range in the header.
        let number = (sample.round() as i64).clamp(0, (1 << bits) - 1) - moved;
        out.extend_from_slice(&format.clamped(number, signed).to_le_bytes()[..format.width]);
    }
    Ok(Samples::decoded(out, format.width, Endian::Little))
}

/// Whether the first component is signed: the highest bit of `Ssiz`, 42 bytes after the start of the codestream.
fn is_signed_jpeg_2000(bytes: &[u8]) -> bool {
    let start = bytes.windows(4).position(|w| w == [0xff, 0x4f, 0xff, 0x51]);
    start.and_then(|start| bytes.get(start + 42)).is_some_and(|size| size & 0x80 != 0)
}
