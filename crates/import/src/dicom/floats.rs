//! Floating-point pixels (parametric maps): their padding, and the losses of 64-bit ones, for which opening reads all frames once.

use super::frames::Frames;
use super::header::Header;
use super::pixels::Meaning;
use super::stack::Slice;
use crate::element::{Decode, Element, Scale};
use crate::error::{ImportError, Result};
use crate::losses::Losses;
use crate::note::Note;
use crate::options::{NoData, OpenOptions};
use brickyard_volume::VoxelType;
use dicom_dictionary_std::tags;

/// The meaning of floats: they are values themselves.
///
/// # Errors
/// If the file scales them, which the standard does not foresee.
pub(super) fn meaning_of(header: &Header, frames: &Frames, frame: usize, nodata: NoData) -> Result<Meaning> {
    let is_plain = |tag, plain: &str| {
        let written = header.written(frame, tag);
        written.is_none_or(|text| text.parse::<f64>().ok() == plain.parse().ok())
    };
    if header.has_value_table || !is_plain(tags::RESCALE_SLOPE, "1") || !is_plain(tags::RESCALE_INTERCEPT, "0") {
        let feature = "floating-point pixels scaled once more (RescaleSlope, ModalityLUTSequence)";
        return Err(ImportError::unsupported_but(&header.path, feature, "write it again with its values"));
    }
    let [value, limit] = match frames.format.width {
        4 => [tags::FLOAT_PIXEL_PADDING_VALUE, tags::FLOAT_PIXEL_PADDING_RANGE_LIMIT],
        _ => [tags::DOUBLE_FLOAT_PIXEL_PADDING_VALUE, tags::DOUBLE_FLOAT_PIXEL_PADDING_RANGE_LIMIT],
    };
    let float_padding = header.number(value).filter(|_| nodata == NoData::OfFile).map(|value| {
        let limit = header.number(limit).unwrap_or(value);
        [value.min(limit), value.max(limit)]
    });
    Ok(Meaning { float_padding, ..Meaning::PLAIN })
}

/// Counts the values of 64-bit floats that f32 does not hold; a forbidden loss is an error.
pub(super) fn losses(files: &[(Header, Frames)], slices: &[Slice], options: &OpenOptions) -> Result<Vec<Note>> {
    let mut notes = Vec::new();
    for (file, (header, frames)) in files.iter().enumerate() {
        if !frames.format.is_float || frames.format.width != 8 {
            continue;
        }
        let own = || slices.iter().filter(|slice| slice.file == file);
        let Some(first) = own().next() else { continue };
        // A single number for padding is no value. Others of a range count, lest a value be lost.
        let absent = first.meaning.float_padding.filter(|[least, greatest]| least == greatest).map(|[value, _]| value);
        let scale = absent.map(|value| Scale { absent: Some(value), ..Scale::new(1.0, 0.0, VoxelType::F32) });
        let decode = Decode { element: Element::F64, endian: frames.endian(), scale };
        let Some(mut losses) = Losses::may_occur(&header.path, decode, None, options) else { continue };
        for slice in own() {
            let samples = frames.read(header, slice.frame)?;
            let seen = losses.see(&samples.bytes);
            // Even a lost value counts only if it is the file's.
            samples.confirm()?;
            seen?;
        }
        let note = losses.note();
        if !notes.contains(&note) {
            notes.push(note);
        }
    }
    Ok(notes)
}

/// A note on the padding of floats.
pub(super) fn note_on_padding(slices: &[Slice]) -> Option<Note> {
    let [least, greatest] = slices.iter().find_map(|slice| slice.meaning.float_padding)?;
    let which = if least == greatest { format!("of {least}") } else { format!("from {least} to {greatest}") };
    Some(Note::new(format!("Values {which} are padding: they become NaN.")))
}
