//! Which files are DICOM's: told by their first bytes, for names say nothing. Old files and those that networks pass on have no preamble, and often no
//! first group.

use crate::error::ImportError;
use crate::files::{first_bytes, is_file};
use std::path::{Path, PathBuf};

/// Byte at which the mark `DICM` stands, after a preamble of any content.
const MAGIC_AT: usize = 128;
/// Byte at which the first group begins, after the mark `DICM`.
const BODY_AT: usize = 132;
const MAGIC: &[u8] = b"DICM";

/// Number of first bytes that [`is_dicom`] needs.
pub(crate) const MAGIC_BYTES: usize = BODY_AT;

/// Elements that a file without a preamble begins with, and their representations: the group of what the file is, or the first one of the data set.
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

/// The greatest length of such an element.
const LONGEST_FIRST: u32 = 256;

/// Whether a file that starts with these bytes is a DICOM file.
pub(crate) fn is_dicom(start: &[u8]) -> bool {
    first_group_at(start).is_some()
}

/// The byte at which a DICOM file's first group begins, which starts with these bytes; `None` if it is none.
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

/// Whether a file's name says that it is a DICOM file.
fn is_named_so(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    ["dcm", "dicom", "ima"].iter().any(|known| extension == *known)
}

/// Lists the DICOM files of a folder, sorted by path, without hidden ones.
///
/// # Errors
/// If the folder cannot be read, or holds files of which the name alone says that they are DICOM's beside others that are.
pub(crate) fn files_in(folder: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let (mut paths, mut unknown) = (Vec::new(), None);
    for entry in std::fs::read_dir(folder).map_err(ImportError::io(folder))? {
        let path = entry.map_err(ImportError::io(folder))?.path();
        let hidden = path.file_name().is_some_and(|n| n.to_string_lossy().starts_with('.'));
        if hidden || !is_file(&path)? {
            continue;
        }
        match is_dicom(&first_bytes(&path, MAGIC_BYTES)?) {
            true => paths.push(path),
            false => unknown = unknown.or(is_named_so(&path).then_some(path)),
        }
    }
    // It may be a slice of them.
    if let Some(path) = unknown.filter(|_| !paths.is_empty()) {
        let problem = "no DICOM file, though its name says so and others beside it are: fetch it again, or take it out of the folder";
        return Err(ImportError::invalid(&path, problem));
    }
    paths.sort();
    Ok(paths)
}
