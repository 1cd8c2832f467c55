//! Files before their format is known.

use crate::error::ImportError;
use std::io::Read;
use std::path::Path;

/// A file's first bytes, so many or all of it.
pub(crate) fn first_bytes(path: &Path, count: usize) -> Result<Vec<u8>, ImportError> {
    let mut start = Vec::new();
    let file = std::fs::File::open(path).map_err(ImportError::io(path))?;
    file.take(count as u64).read_to_end(&mut start).map_err(ImportError::io(path))?;
    Ok(start)
}

/// Whether a name in a folder is a file's. Where that cannot be known, leaving it out could leave out a slice.
pub(crate) fn is_file(path: &Path) -> Result<bool, ImportError> {
    Ok(std::fs::metadata(path).map_err(ImportError::io(path))?.is_file())
}
