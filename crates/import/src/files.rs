//! Files before their format is known.

use crate::error::ImportError;
use std::io::Read;
use std::path::Path;

/// Reads the first `count` bytes of a file, or all of a shorter one.
pub(crate) fn first_bytes(path: &Path, count: usize) -> Result<Vec<u8>, ImportError> {
    let mut start = Vec::new();
    let file = std::fs::File::open(path).map_err(ImportError::io(path))?;
    file.take(count as u64).read_to_end(&mut start).map_err(ImportError::io(path))?;
    Ok(start)
}

/// Whether a path is a regular file. Failing to examine it is an error: skipping it could skip a slice.
pub(crate) fn is_file(path: &Path) -> Result<bool, ImportError> {
    Ok(std::fs::metadata(path).map_err(ImportError::io(path))?.is_file())
}
