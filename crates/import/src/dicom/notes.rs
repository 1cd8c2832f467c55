//! Notes on a series' values, padding, and bytes behind its pixels.

use super::frames::Frames;
use super::header::Header;
use super::pixels::Meaning;
use super::stack::Slice;
use crate::files::name_of;
use crate::note::Note;
use crate::options::NoData;
use brickyard_volume::{VoxelType, counted};
use dicom_dictionary_std::tags;

pub(super) fn notes_on_values(files: &[(Header, Frames)], slices: &[Slice], voxel_type: VoxelType) -> Vec<Note> {
    let mut notes = Vec::new();
    let first = slices[0].meaning;
    let Meaning { slope, intercept, .. } = first;
    if slices.iter().any(|slice| (slice.meaning.slope, slice.meaning.intercept) != (slope, intercept)) {
        let note = format!("Values are scaled and shifted by each slice's own numbers, and held as {voxel_type}.");
        notes.push(Note::new(note));
    } else if (slope, intercept) != (1.0, 0.0) {
        notes.push(Note::new(format!(
            "Values are scaled by {slope} and shifted by {intercept}, as the header says, and held as {voxel_type}."
        )));
    }
    let is_stored = slices.iter().all(|slice| (slice.meaning.slope, slice.meaning.intercept) == (1.0, 0.0));
    if is_stored && files.iter().any(|(header, _)| header.has_real_world) {
        notes.push(Note::warning("Values are as stored: the header's real-world values of them are not applied."));
    }
    let is_long = |frames: &Frames| frames.format.width == 4 && !frames.format.is_float;
    if voxel_type.is_float() && files.iter().any(|(_, frames)| is_long(frames)) {
        notes.push(Note::warning("32-bit numbers are rounded to the 24 bits of f32."));
    }
    if let Some([least, greatest]) = slices.iter().find_map(|slice| slice.meaning.padding) {
        let what = match first.nodata(voxel_type) {
            Some(value) => format!("become {value}, which means no data"),
            None if voxel_type.is_float() => "become NaN".into(),
            None => "do not occur".into(),
        };
        let others =
            slices.iter().filter_map(|slice| slice.meaning.padding).any(|padding| padding != [least, greatest]);
        let others = if others { " (other values in some slices)" } else { "" };
        let note = format!("Stored values {least} to {greatest}{others} are padding: they {what}.");
        notes.push(Note::new(note));
    }
    let inverted = |(header, _): &(Header, Frames)| {
        header.text(tags::PHOTOMETRIC_INTERPRETATION).is_some_and(|text| text == "MONOCHROME1")
    };
    if files.iter().any(inverted) {
        notes.push(Note::new(
            "Small values are meant to be shown bright (MONOCHROME1); the values are kept as they are.",
        ));
    }
    notes
}

/// Notes bytes after the pixels, besides one that makes their number even.
pub(super) fn note_on_rest(files: &[(Header, Frames)]) -> Option<Note> {
    let mut others = files.iter().filter(|(_, frames)| frames.spare_bytes > 1);
    let (header, frames) = others.next()?;
    let (bytes, name) = (frames.spare_bytes, name_of(&header.path));
    let others = match others.count() as u64 {
        0 => String::new(),
        count => format!(", and those of {} more", counted(count, "file")),
    };
    Some(Note::warning(format!(
        "{bytes} bytes after the pixels of {name}{others} are left out: NumberOfFrames, or the size of pictures, may say too little."
    )))
}

/// Notes padding values outside the pixels' range.
pub(super) fn note_on_padding(files: &[(Header, Frames)], slices: &[Slice], nodata: NoData) -> Option<Note> {
    let is_left_out = |slice: &&Slice| {
        let (header, frames) = &files[slice.file];
        let is_integer = !frames.format.is_float && slice.meaning.padding.is_none();
        nodata == NoData::OfFile && is_integer && header.has_padding()
    };
    let slice = slices.iter().find(is_left_out)?;
    let (header, frames) = &files[slice.file];
    let value = header.number(tags::PIXEL_PADDING_VALUE)?;
    let [least, greatest] = frames.format.limits();
    let name = name_of(&header.path);
    Some(Note::warning(format!(
        "The padding value {value} of {name} is outside of its pixels' range, {least} to {greatest}: no voxel is left \
         out."
    )))
}
