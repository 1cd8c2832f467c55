//! DICOM file detection by first bytes, since names are unreliable. Old files, and those sent over networks, have no preamble, and often no
//! first group.

use crate::batches::{self, MOST_THREADS};
use crate::error::{ImportError, Result};
use crate::files::{first_bytes, is_file, listed};
use std::path::{Path, PathBuf};

/// Byte of the mark `DICM`, after a preamble of any content.
const MAGIC_AT: usize = 128;
/// Byte of the first group, after the mark `DICM`.
const BODY_AT: usize = 132;
const MAGIC: &[u8] = b"DICM";

/// Number of first bytes needed by [`is_dicom`].
pub(crate) const MAGIC_BYTES: usize = BODY_AT;

/// First elements of files without a preamble, with their representations: of the file meta group, or of the data set's first group.
const FIRST: &[(&[u8; 4], &[u8; 2])] = &[
    (b"\x02\0\0\0", b"UL"),
    (b"\x08\0\0\0", b"UL"),
    (b"\x08\0\x01\0", b"UL"),
    (b"\x08\0\x05\0", b"CS"),
    (b"\x08\0\x08\0", b"CS"),
    (b"\x08\0\x12\0", b"DA"),
    (b"\x08\0\x16\0", b"UI"),
    (b"\x08\0\x18\0", b"UI"),
];

/// Greatest length of such an element.
const LONGEST_FIRST: u32 = 256;

pub(crate) fn is_dicom(start: &[u8]) -> bool {
    first_group_at(start).is_some()
}

/// Returns the byte of the first group in a file starting with these bytes; `None` unless it is a DICOM file.
pub(crate) fn first_group_at(start: &[u8]) -> Option<usize> {
    if start.get(MAGIC_AT..BODY_AT) == Some(MAGIC) {
        return Some(BODY_AT);
    }
    let (tag, rest) = start.split_first_chunk()?;
    let length = rest.first_chunk()?;
    // Without a representation the length has four bytes.
    let is_brief = || (0..=LONGEST_FIRST).contains(&u32::from_le_bytes(*length)) && length[0] % 2 == 0;
    let is_first = |(first, vr): &(&[u8; 4], &[u8; 2])| *first == tag && (length.starts_with(*vr) || is_brief());
    FIRST.iter().any(is_first).then_some(0)
}

fn is_named_so(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    ["dcm", "dicom", "ima"].iter().any(|known| extension == *known)
}

/// Lists the DICOM files of a folder, sorted by path, without hidden ones.
///
/// # Errors
/// If the folder cannot be read, or files that are DICOM's only in name lie beside real ones.
pub(crate) fn files_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let (mut paths, mut unknown) = (Vec::new(), None);
    let look = |path: &PathBuf| match is_file(path)? {
        true => first_bytes(path, MAGIC_BYTES).map(|start| Some(is_dicom(&start))),
        false => Ok(None),
    };
    batches::each(&listed(folder)?, MOST_THREADS, look, |path, found| {
        match found? {
            Some(true) => paths.push(path.clone()),
            Some(false) if unknown.is_none() && is_named_so(path) => unknown = Some(path.clone()),
            _ => {}
        }
        Ok::<_, ImportError>(())
    })?;
    // It may be a slice of their series.
    if let Some(path) = unknown.filter(|_| !paths.is_empty()) {
        let problem =
            "not a DICOM file, unlike its name and the files beside it: fetch it again, or take it out of the folder";
        return Err(ImportError::invalid(&path, problem));
    }
    paths.sort();
    Ok(paths)
}
