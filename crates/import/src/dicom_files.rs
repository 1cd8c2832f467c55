//! Which files are DICOM's: told by their first bytes, for names say nothing.

use crate::error::ImportError;
use crate::files::{first_bytes, is_file};
use std::path::{Path, PathBuf};

/// Byte at which the mark `DICM` stands, after a preamble of any content.
const MAGIC_AT: usize = 128;
/// Byte at which the data begin, after the mark `DICM`.
pub(crate) const BODY_AT: usize = 132;
const MAGIC: &[u8] = b"DICM";

/// Number of first bytes that [`is_dicom`] needs.
pub(crate) const MAGIC_BYTES: usize = BODY_AT;

/// Whether a file that starts with these bytes is a DICOM file.
pub(crate) fn is_dicom(start: &[u8]) -> bool {
    start.get(MAGIC_AT..BODY_AT) == Some(MAGIC)
}

/// Lists the DICOM files of a folder, sorted by path, without hidden ones.
pub(crate) fn files_in(folder: &Path) -> Result<Vec<PathBuf>, ImportError> {
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(ImportError::io(folder))? {
        let path = entry.map_err(ImportError::io(folder))?.path();
        let hidden = path.file_name().is_some_and(|n| n.to_string_lossy().starts_with('.'));
        if !hidden && is_file(&path)? && is_dicom(&first_bytes(&path, MAGIC_BYTES)?) {
            paths.push(path);
        }
    }
    paths.sort();
    Ok(paths)
}
