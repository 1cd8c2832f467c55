//! Files that are there whole or not at all: written under a temporary name beside the place they go to, then renamed.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::Path;

/// Writes a file by `write`. What was at `path` before stays until all of it is written, and if anything fails.
///
/// # Errors
/// If the path has no file name, the file cannot be written, or `write` fails.
pub(crate) fn write_whole<E: From<io::Error>>(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<(), E>,
) -> Result<(), E> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
    let name = path.file_name().ok_or_else(|| io::Error::other("not a file name"))?;
    let temporary = folder.join(format!(".{}.{}.tmp", name.to_string_lossy(), std::process::id()));
    let written = (|| {
        let mut file = BufWriter::new(File::create(&temporary)?);
        write(&mut file)?;
        file.flush()?;
        std::fs::rename(&temporary, path)?;
        Ok(())
    })();
    written.inspect_err(|_| {
        // It may not be there.
        let _ = std::fs::remove_file(&temporary);
    })
}
