//! Files before their format is known.

use crate::error::{ImportError, Result};
use std::io::Read;
use std::path::{Path, PathBuf};

/// Reads the first `count` bytes of a file, or all of a shorter one.
pub(crate) fn first_bytes(path: &Path, count: usize) -> Result<Vec<u8>> {
    // Room for all of a header's first bytes makes one call of it.
    let mut start = Vec::with_capacity(count.min(1 << 12));
    let file = std::fs::File::open(path).map_err(ImportError::io(path))?;
    file.take(count as u64).read_to_end(&mut start).map_err(ImportError::io(path))?;
    Ok(start)
}

/// Whether a path is a regular file. Failing to examine it is an error: skipping it could skip a slice.
pub(crate) fn is_file(path: &Path) -> Result<bool> {
    Ok(std::fs::metadata(path).map_err(ImportError::io(path))?.is_file())
}

/// The file's name, as in messages; empty if there is none.
pub(crate) fn name_of(path: &Path) -> String {
    path.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// The folder of a file, `.` for a bare name.
pub(crate) fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Paths of everything in a folder but hidden entries.
pub(crate) fn listed(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder).and_then(|entries| entries.collect::<Result<Vec<_>, _>>());
    let paths = entries.map_err(ImportError::io(folder))?.into_iter().map(|entry| entry.path());
    Ok(paths.filter(|path| !name_of(path).starts_with('.')).collect())
}
