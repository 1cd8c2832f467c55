//! NRRD of teem, versions 1 to 5, with data behind the header or in files of their own: `.nrrd` and `.nhdr`.
//!
//! The header is text of bounded length; a plain array is mapped where it lies, others pass through a scratch file (see `data_files`).

mod header;
mod kinds;
mod placement;
mod segments;
#[cfg(test)]
mod tests;

use crate::error::Result;
use crate::note::Note;
use crate::options::OpenOptions;
use crate::raw::{ArrayLayout, RawSource, identity};
use crate::source::SourceInfo;
use crate::stamp::Stamp;
use header::Header;
use kinds::Axes;
use std::path::Path;

pub(crate) const MAGIC: &[u8] = b"NRRD00";

/// Opens a NRRD file, or a header of data files.
pub(crate) fn open(path: &Path, options: &OpenOptions) -> Result<RawSource> {
    let stamp = Stamp::of(path)?;
    let header = Header::read(path)?;
    let sizes = header.sizes()?;
    let mut notes = Vec::new();
    let axes = Axes::of(&header, &sizes, &mut notes)?;
    let (order, arranged) = axes.arranged();
    let mut array = ArrayLayout { sizes: arranged, axes: order, decode: header.decode()?, offset: 0 };
    let files = header.data_files(&sizes)?;
    let stamps = files.stamps(path)?;
    let body = files.body(path, &mut array, &mut notes)?;
    let paths: Vec<&Path> = [path].into_iter().chain(files.paths.iter().map(|file| &**file)).collect();
    let mut info = SourceInfo { identity: identity("nrrd", &paths)?, channel_looks: axes.looks(), ..array.info() };
    placement::place(&header, &axes, &mut info, &mut notes)?;
    note_quantized(&header, &mut notes);
    notes.extend(header.segments.note(info.channels));
    for name in header.unknown() {
        notes.push(Note::warning(format!("The header's field '{name}' is none of NRRD's: it is left out.")));
    }
    info.notes.append(&mut notes);
    info.kind = header.segments.kind(info.voxel_type);
    let options = &options.heeding(info.kind);
    if let Some(unit) = header.get("sampleunits").map(|unit| unit.trim_matches('"')).filter(|unit| *unit != "???") {
        info.set_value_unit(unit, "sample units");
    }
    let source = body.source(array, info, options)?;
    stamp.check(path)?;
    files.check_unchanged(&stamps)?;
    Ok(source)
}

/// The format keeps the range of values from before their quantization, to which no reader returns by itself.
fn note_quantized(header: &Header, notes: &mut Vec<Note>) {
    if let (Some(min), Some(max)) = (header.get("oldmin"), header.get("oldmax")) {
        notes
            .push(Note::new(format!("Values were quantized from a range of {min} to {max}; they are read as stored.")));
    }
}
