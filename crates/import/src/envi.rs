//! ENVI headers: a text, `.hdr`, with the layout of a raw file beside it, which is read through [`RawSource`], after unpacking if it is
//! compressed by gzip. Bands become slices along z.

mod header;
#[cfg(test)]
mod tests;

use crate::body::Body;
use crate::direct::direct;
use crate::error::{ImportError, Result};
use crate::files::name_of;
use crate::looks;
use crate::note::Note;
use crate::options::OpenOptions;
use crate::raw::{RawSource, identity};
use crate::sidecar::{check_raw, text_of};
use crate::source::SourceInfo;
use crate::stamp::Stamp;
use header::Header;
use std::path::{Path, PathBuf};

/// Ends of the raw file's name in place of `.hdr`; first the name without any.
const ENDS: [&str; 8] = ["", ".img", ".dat", ".raw", ".bsq", ".bil", ".bip", ".bin"];

/// Opens a raw file by its header.
pub(crate) fn open(path: &Path, options: &OpenOptions) -> Result<RawSource> {
    let text = text_of(path, "ENVI header")?;
    let raw = raw_file_of(path)?;
    check_raw(path, &raw)?;
    let stamps = [Stamp::of(path)?, Stamp::of(&raw)?];
    let header = Header::of(&text, path)?;
    let mut array = header.array()?;
    array.decode = direct(array.decode, header.nodata()?, options);
    let mut info = SourceInfo { identity: identity("envi", &[path, &raw])?, ..array.info() };
    if info.channels == 2 {
        info.channel_looks = looks::named(&looks::COMPLEX);
    }
    header.describe(&mut info)?;
    info.notes.push(Note::new(format!("Described by the ENVI header {}.", name_of(path))));
    let source = Body::open(&raw)?.source(array, info, options)?;
    stamps[0].check(path)?;
    stamps[1].check(&raw)?;
    Ok(source)
}

/// Whether a text is such a header, by its first word.
pub(crate) fn is_envi(start: &[u8]) -> bool {
    let start = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(start);
    start.get(..4).is_some_and(|word| word.eq_ignore_ascii_case(b"ENVI"))
}

/// The raw file of a header: of its name, without `.hdr` or with another end. If several exist, no rule says which is meant.
fn raw_file_of(path: &Path) -> Result<PathBuf> {
    let name = name_of(path);
    let base = match name.to_ascii_lowercase().strip_suffix(".hdr") {
        Some(base) => name.get(..base.len()).unwrap_or(&name).to_owned(),
        None => return Err(ImportError::invalid(path, "an ENVI header under another name than .hdr: rename it")),
    };
    let cases = |end: &str| [end.to_owned(), end.to_ascii_uppercase()];
    let mut found: Vec<PathBuf> = Vec::new();
    for end in ENDS.iter().flat_map(|end| cases(end)) {
        let raw = path.with_file_name(format!("{base}{end}"));
        // Some systems ignore the case of names.
        let is_known = found.iter().any(|other| same_file(other, &raw));
        if raw.is_file() && !is_known {
            found.push(raw);
        }
    }
    match &found[..] {
        [raw] => Ok(raw.clone()),
        [] => {
            let problem =
                format!("its raw file is missing: expected {base}, or {base}.img, .dat, .raw and others, beside it");
            Err(ImportError::invalid(path, problem))
        }
        [first, second, ..] => {
            let [first, second] = [first, second].map(|raw| name_of(raw));
            Err(ImportError::invalid(
                path,
                format!("may describe {first} or {second}: keep only one of them beside it"),
            ))
        }
    }
}

fn same_file(a: &Path, b: &Path) -> bool {
    a == b || a.canonicalize().ok().is_some_and(|a| b.canonicalize().ok() == Some(a))
}
