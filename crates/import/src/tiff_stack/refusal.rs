//! Conversion of the library's errors to this crate's, with the file's content and advice.

use crate::error::ImportError;
use std::path::Path;
use tiff::tags::{PhotometricInterpretation, SampleFormat};
use tiff::{ColorType, TiffError, TiffFormatError, TiffUnsupportedError};

/// Advice for unsupported kinds of pixels.
pub(super) const AS_NUMBERS: &str = "write its pixels again as numbers of 8, 16, 32 or 64 bits: one a pixel, or red, \
                                    green and blue (tiff2rgba, ImageMagick)";

/// Advice for a palette: labels often have one.
const AS_INDICES: &str = "write its indices as plain numbers: in Fiji choose the lookup table Grays and save it again, in Python \
                          tifffile.imwrite(OUT, tifffile.imread(IN))";

/// Whether a read error is the file's fault: it refers to a place beyond its end.
pub(super) fn is_damage(error: &std::io::Error) -> bool {
    use std::io::ErrorKind::{InvalidInput, UnexpectedEof};
    matches!(error.kind(), UnexpectedEof | InvalidInput)
}

/// Converts the library's error, after failing at `what`.
pub(super) fn refusal(path: &Path, what: &str, error: TiffError) -> ImportError {
    let invalid = |problem: &str| ImportError::invalid(path, format!("{what}: {problem}"));
    match error {
        TiffError::UnsupportedError(e) => {
            let is_palette =
                matches!(e, TiffUnsupportedError::InterpretationWithBits(PhotometricInterpretation::RGBPalette, _));
            let advice = if is_palette { AS_INDICES } else { AS_NUMBERS };
            ImportError::unsupported_but(path, format!("{what}: {}", feature_of(e)), advice)
        }
        TiffError::FormatError(TiffFormatError::InconsistentSizesEncountered) => invalid(
            "the number of strips, tiles or samples in its directory does not match its sizes (pages of several \
             slices, by ImageDepth, are not supported: write a page for each); tiffcp may write it anew",
        ),
        TiffError::FormatError(TiffFormatError::StripTileTagConflict) => invalid(
            "its directory lacks the offsets or the lengths of strips or tiles, or has both strips and tiles; tiffcp \
             may write it anew",
        ),
        TiffError::FormatError(TiffFormatError::CycleInOffsets) => {
            invalid("its directories form a loop; `tiffcp IN,0 OUT` writes the first page anew")
        }
        TiffError::IoError(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => invalid("the file is cut short"),
        // The system's report of a seek to before the start or past all numbers.
        TiffError::IoError(e) if e.kind() == std::io::ErrorKind::InvalidInput => {
            invalid("it has an impossible offset, so its directory is damaged; fetch the file again")
        }
        TiffError::IoError(e) => ImportError::io(path)(e),
        e => invalid(&e.to_string()),
    }
}

/// Converts the library's error about a strip or tile whose bytes are all present: unless it is the system's, these bytes are damaged.
pub(super) fn not_decoded(path: &Path, index: u32, error: TiffError) -> ImportError {
    let what = format!("strip or tile {index} cannot be decoded");
    let damaged = |problem: &str| ImportError::invalid(path, format!("{what}: {problem}; fetch the file again"));
    match error {
        TiffError::IoError(e) if e.kind() == std::io::ErrorKind::UnexpectedEof => {
            damaged("its data end before its pixels do")
        }
        TiffError::IoError(e) if e.raw_os_error().is_none() => damaged(&format!("its data are damaged ({e})")),
        TiffError::FormatError(e @ TiffFormatError::CompressedDataCorrupt(_)) => damaged(&e.to_string()),
        e => refusal(path, &what, e),
    }
}

/// The kind of a page's samples, in words after their number of bits.
pub(super) fn kind_of(color: ColorType, format: SampleFormat) -> String {
    let number = match format {
        SampleFormat::Uint => "unsigned integers",
        SampleFormat::Int => "signed integers",
        SampleFormat::IEEEFP => "floats",
        _ => "samples of an unknown format",
    };
    let of = match color {
        ColorType::Gray(_) => "one a pixel".into(),
        ColorType::GrayA(_) => "grey and transparency".into(),
        ColorType::RGB(_) => "red, green and blue".into(),
        ColorType::RGBA(_) => "red, green, blue and transparency".into(),
        ColorType::Palette(_) => "indices of a palette".into(),
        ColorType::CMYK(_) | ColorType::CMYKA(_) => "CMYK".into(),
        ColorType::YCbCr(_) => "YCbCr".into(),
        ColorType::Lab(_) => "CIE L*a*b*".into(),
        ColorType::Multiband { num_samples, .. } => format!("{num_samples} a pixel"),
        _ => "colours of an unknown kind".into(),
    };
    format!("{number} ({of})")
}

/// An unsupported feature of the library, in plain words.
fn feature_of(error: TiffUnsupportedError) -> String {
    use PhotometricInterpretation as P;
    match error {
        TiffUnsupportedError::InterpretationWithBits(P::RGBPalette, _) => "a palette of colours".into(),
        TiffUnsupportedError::InterpretationWithBits(P::TransparencyMask, _) => "a mask of transparency".into(),
        TiffUnsupportedError::InterpretationWithBits(kind, bits) => {
            format!("{kind:?} of {} samples a pixel, {} bits each,", bits.len(), bits.first().unwrap_or(&0))
        }
        TiffUnsupportedError::UnknownInterpretation => "a missing or non-standard PhotometricInterpretation".into(),
        // The library calls them samples a pixel.
        TiffUnsupportedError::UnsupportedSampleDepth(bits) => format!("numbers of {bits} bits"),
        TiffUnsupportedError::UnsupportedSampleFormat(formats) => match formats[..] {
            [SampleFormat::Unknown(5 | 6), ..] => "complex numbers".into(),
            [SampleFormat::Unknown(format), ..] => format!("samples of a non-standard format ({format})"),
            _ => "samples of different formats".into(),
        },
        TiffUnsupportedError::InconsistentBitsPerSample(bits) => format!("samples of different widths ({bits:?} bits)"),
        TiffUnsupportedError::ChromaSubsampling => "YCbCr with chroma subsampling".into(),
        other => other.to_string().trim_end_matches(" is unsupported").to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn kinds_of_pixels_are_in_words() {
        let kinds = [
            (ColorType::Gray(12), SampleFormat::Uint, "unsigned integers (one a pixel)"),
            (ColorType::CMYK(8), SampleFormat::Int, "signed integers (CMYK)"),
            (ColorType::Multiband { bit_depth: 24, num_samples: 5 }, SampleFormat::IEEEFP, "floats (5 a pixel)"),
        ];
        for (color, format, words) in kinds {
            assert_eq!(kind_of(color, format), words);
        }
    }
}
