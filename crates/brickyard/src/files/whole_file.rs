//! Files written whole or not at all: under a temporary name beside their final place, then renamed. The name is
//! random, and the file always new: nobody can plant a link there to have another file overwritten.

use brickyard_import::temporary::named_in;
use std::ffi::{OsStr, OsString};
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use tempfile::NamedTempFile;

/// A file in progress under a temporary name. Unless finished, it is removed, and an earlier file at its path stays.
pub(crate) struct WholeFile {
    file: BufWriter<NamedTempFile>,
    pub(crate) path: PathBuf,
}

impl WholeFile {
    /// Begins a file for `path`.
    ///
    /// # Errors
    /// If the path has no file name, something other than a file is there, or no file can be created in its folder.
    pub(crate) fn create(path: &Path) -> io::Result<Self> {
        if std::fs::metadata(path).is_ok_and(|found| !found.is_file()) {
            return Err(io::Error::other("is not a regular file, and is never replaced"));
        }
        let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty()).unwrap_or(Path::new("."));
        let name = path.file_name().ok_or_else(|| io::Error::other("not a file name"))?;
        // Identifies the owner, should the program be killed.
        let prefix: OsString = [OsStr::new("."), name, OsStr::new(".")].into_iter().collect();
        let file = named_in(folder, prefix, ".tmp")?;
        Ok(Self { file: BufWriter::new(file), path: path.to_path_buf() })
    }

    /// Flushes the file and gives it its name.
    ///
    /// # Errors
    /// If that fails.
    pub(crate) fn finish(self) -> io::Result<()> {
        let file = self.file.into_inner().map_err(io::IntoInnerError::into_error)?;
        file.persist(&self.path).map(drop).map_err(|error| error.error)
    }

    /// The temporary name, for another program to write to.
    #[cfg(feature = "movie")]
    pub(crate) fn temporary(&self) -> &Path {
        self.file.get_ref().path()
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

/// Writes a file by `write`. An earlier file at `path` stays until everything is written, and on any failure.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_is_there_whole_or_not_at_all() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        write_whole(&path, |file| file.write_all(b"first")).unwrap();
        let failed: io::Result<()> = write_whole(&path, |file| {
            file.write_all(b"second")?;
            Err(io::Error::other("no"))
        });
        assert!(failed.is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
        write_whole(&path, |file| file.write_all(b"third")).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"third");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "nothing is left behind");
        assert!(WholeFile::create(Path::new("/")).is_err());
        assert!(
            WholeFile::create(Path::new("/dev/null"))
                .is_err_and(|error| error.to_string().contains("is not a regular file"))
        );
    }

    /// Links under foreseeable names have no effect, and the file has the permissions of any new one.
    #[cfg(unix)]
    #[test]
    fn links_are_not_followed_and_permissions_are_those_of_new_files() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let [path, other, plain] = ["a.png", "other", "plain"].map(|name| folder.path().join(name));
        std::fs::write(&other, "precious").unwrap();
        let foreseen = format!(".a.png.{}.tmp", std::process::id());
        std::os::unix::fs::symlink(&other, folder.path().join(foreseen)).unwrap();
        write_whole(&path, |file| file.write_all(b"picture")).unwrap();
        assert_eq!(std::fs::read(&other).unwrap(), b"precious");
        assert!(path.symlink_metadata().unwrap().is_file());
        std::fs::write(&plain, "").unwrap();
        let mode = |path: &Path| path.metadata().unwrap().permissions().mode();
        assert_eq!(mode(&path), mode(&plain));
    }
}
