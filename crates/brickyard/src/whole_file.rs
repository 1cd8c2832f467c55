//! Files that are there whole or not at all: written under a temporary name beside the place they go to, then renamed.

use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

/// A file that is being written under a temporary name. Unless it is finished, what was at its path before stays, and the temporary file goes.
pub(crate) struct WholeFile {
    file: BufWriter<File>,
    temporary: PathBuf,
    path: PathBuf,
    is_finished: bool,
}

impl WholeFile {
    /// Begins a file that goes to `path`.
    ///
    /// # Errors
    /// If the path has no file name, or no file can be made in its folder.
    pub(crate) fn create(path: &Path) -> io::Result<Self> {
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let name = path.file_name().ok_or_else(|| io::Error::other("not a file name"))?;
        let temporary = folder.join(format!(".{}.{}.tmp", name.to_string_lossy(), std::process::id()));
        let file = BufWriter::new(File::create(&temporary)?);
        Ok(Self { file, temporary, path: path.to_path_buf(), is_finished: false })
    }

    /// Writes out what is left and gives the file its name.
    ///
    /// # Errors
    /// If that fails.
    pub(crate) fn finish(mut self) -> io::Result<()> {
        self.file.flush()?;
        std::fs::rename(&self.temporary, &self.path)?;
        self.is_finished = true;
        Ok(())
    }

    /// The temporary name, for a program that writes the file.
    #[cfg(feature = "movie")]
    pub(crate) fn temporary(&self) -> &Path {
        &self.temporary
    }

    /// The path that the file goes to.
    #[cfg(feature = "movie")]
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }
}

impl Write for WholeFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Drop for WholeFile {
    fn drop(&mut self) {
        if !self.is_finished {
            // It may not be there.
            let _ = std::fs::remove_file(&self.temporary);
        }
    }
}

/// Writes a file by `write`. What was at `path` before stays until all of it is written, and if anything fails.
///
/// # Errors
/// If the path has no file name, the file cannot be written, or `write` fails.
pub(crate) fn write_whole<E: From<io::Error>>(
    path: &Path,
    write: impl FnOnce(&mut WholeFile) -> Result<(), E>,
) -> Result<(), E> {
    let mut file = WholeFile::create(path)?;
    write(&mut file)?;
    Ok(file.finish()?)
}
