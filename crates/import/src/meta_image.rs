//! MetaImage of ITK, with data behind the header (`.mha`) or in files of their own (`.mhd`).
//!
//! The header is text of bounded length; a plain array is mapped where it lies, others pass through a scratch file (see `data_files`).

mod header;
mod placement;
#[cfg(test)]
mod tests;

use crate::element::{Decode, Element, Scale};
use crate::error::Result;
use crate::note::Note;
use crate::options::OpenOptions;
use crate::raw::{RawSource, identity};
use crate::source::SourceInfo;
use crate::stamp::Stamp;
use brickyard_volume::VoxelType;
use header::Header;
use std::path::Path;

/// Keys that may begin a header.
const FIRST_KEYS: [&str; 3] = ["ObjectType", "NDims", "ObjectSubType"];

/// Whether a file starts like a header.
pub(crate) fn is_header(start: &[u8]) -> bool {
    let is_key = |key: &str| {
        let rest = start.strip_prefix(key.as_bytes()).map(<[u8]>::trim_ascii_start);
        rest.is_some_and(|rest| rest.starts_with(b"=") || rest.starts_with(b":"))
    };
    FIRST_KEYS.iter().any(|key| is_key(key))
}

/// Opens a MetaImage by its header.
pub(crate) fn open(path: &Path, options: &OpenOptions) -> Result<RawSource> {
    let stamp = Stamp::of(path)?;
    let header = Header::read(path)?;
    let mut array = header.array()?;
    let files = header.data_files()?;
    let stamps = files.stamps(path)?;
    let mut notes = Vec::new();
    let body = files.body(path, &mut array, &mut notes)?;
    note_decoding(&header, array.decode, &mut notes);
    let paths: Vec<&Path> = [path].into_iter().chain(files.paths.iter().map(|file| &**file)).collect();
    let mut info = SourceInfo { identity: identity("meta image", &paths)?, ..array.info() };
    placement::place(&header, &mut info, &mut notes)?;
    info.notes = notes;
    let source = body.source(array, info, options)?;
    stamp.check(path)?;
    files.check_unchanged(&stamps)?;
    Ok(source)
}

fn note_decoding(header: &Header, decode: Decode, notes: &mut Vec<Note>) {
    if decode.element.bytes() > 1 && header.lacks_order() {
        notes.push(Note::warning("The header has no ElementByteOrderMSB: little-endian voxels are taken, as in ITK."));
    }
    let kinds = header.get("Kinds").filter(|kinds| kinds.split_whitespace().any(|kind| kind != "domain"));
    notes.extend(kinds.map(|kinds| Note::warning(format!("Kinds = {kinds} is left out: the axes are x, y and z."))));
    let Some(Scale { slope, intercept, to, .. }) = decode.scale else { return };
    let scaled = format!(
        "Values are scaled by {slope} and shifted by {intercept} (ElementToIntensityFunction), and held as {to}"
    );
    notes.push(match decode.element {
        Element::Voxel(VoxelType::I32 | VoxelType::U32) => Note::warning(format!("{scaled}, rounded to 24 bits.")),
        _ => Note::new(format!("{scaled}.")),
    });
}
