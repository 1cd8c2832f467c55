//! MRC2014 files and CCP4 maps, both byte orders, also compressed by gzip: `.mrc`, `.mrcs`, `.map`, `.ccp4`, and IMOD's `.rec`, `.st`, `.ali`.
//!
//! A header of 1024 bytes and an extended one stand before a plain array, which is read through [`RawSource`], after unpacking if need be.

mod header;
mod nibbles;
mod placement;
#[cfg(test)]
mod tests;

use crate::body::Body;
use crate::error::{ImportError, Result};
use crate::files::first_bytes;
use crate::looks;
use crate::options::OpenOptions;
use crate::raw::{RawSource, identity};
use crate::source::SourceInfo;
use crate::stamp::Stamp;
use header::{HEADER_BYTES, Header};
use nibbles::Nibbles;
use std::io::Read;
use std::path::Path;

/// Names of files that may lack the magic bytes; others of these names exist.
const NAMES: [&str; 7] = [".mrc", ".mrcs", ".map", ".ccp4", ".rec", ".st", ".ali"];

/// Opens an MRC file.
pub(crate) fn open(path: &Path, options: &OpenOptions) -> Result<RawSource> {
    let stamp = Stamp::of(path)?;
    let header = Header::read(&start_of(path)?, path)?;
    let mut notes = header.notes;
    let mut info = SourceInfo { identity: identity("mrc", &[path])?, ..header.array.info() };
    info.channel_looks = match info.channels {
        2 => looks::named(&looks::COMPLEX),
        3 => looks::colors(info.voxel_type, 3),
        _ => Vec::new(),
    };
    placement::place(&header.fields, &mut info, &mut notes);
    info.notes = notes;
    let mut body = Body::open(path)?;
    if let Some(columns) = header.fields.packed_columns() {
        let coded_bytes = std::fs::metadata(path).map_err(ImportError::io(path))?.len();
        let stream = Box::new(Nibbles::new(body.reader()?, header.array.offset, columns));
        body = Body::Coded { path: path.to_owned(), coded_bytes, stream };
    }
    let source = body.source(header.array, info, options)?;
    stamp.check(path)?;
    Ok(source)
}

/// Whether a file is of this format by its magic bytes.
pub(crate) fn has_magic(path: &Path) -> Result<bool> {
    Ok(Header::has_magic(&start_of(path)?))
}

/// Whether a file is of this format by its name (in lower case), and by a header that makes sense.
pub(crate) fn is_named(path: &Path, name: &str) -> Result<bool> {
    let name = name.strip_suffix(".gz").unwrap_or(name);
    Ok(NAMES.iter().any(|end| name.ends_with(end)) && Header::makes_sense(&start_of(path)?))
}

/// The header's bytes, unpacked; fewer if the file is cut short or its compressed data are damaged.
fn start_of(path: &Path) -> Result<Vec<u8>> {
    let plain = first_bytes(path, HEADER_BYTES)?;
    if !plain.starts_with(&[0x1f, 0x8b]) {
        return Ok(plain);
    }
    let body = Body::open(path)?;
    let mut start = Vec::with_capacity(HEADER_BYTES);
    // Damage is reported by whoever needs the bytes behind it.
    let _ = body.reader()?.take(HEADER_BYTES as u64).read_to_end(&mut start);
    Ok(start)
}
