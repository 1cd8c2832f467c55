//! Text files of users: scenes, camera paths, transfer functions, matrices. They are read whole, and refused above a
//! plausible size; they are written whole or not at all.

use crate::files::whole_file::write_whole;
use std::fs::File;
use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

/// The size limit of text files, bytes. Parsed JSON takes twenty times its size and more; a path of 80,000 cameras
/// fits.
pub const MOST_BYTES: u64 = 16 << 20;

/// Errors in reading or writing a text file. Each message begins with the file's path.
#[derive(Debug, thiserror::Error)]
pub enum TextError {
    /// The file does not open, or cannot be read to its end.
    #[error("{path}: {source}", path = path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        source: io::Error,
    },
    /// The file cannot be written.
    #[error("{path}: {source}", path = path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The operating system's error.
        source: io::Error,
    },
    /// The file has more than [`MOST_BYTES`].
    #[error("{path}: expected at most {most} MiB of text, found more", path = .0.display(), most = MOST_BYTES >> 20)]
    TooLarge(PathBuf),
    /// The file's bytes are not UTF-8.
    #[error("{path}: {source}", path = path.display())]
    NotText {
        /// The file.
        path: PathBuf,
        /// The position of the invalid bytes.
        source: std::string::FromUtf8Error,
    },
}

/// Reads a file or pipe of UTF-8 text, dropping a byte order mark.
///
/// # Errors
/// If the file cannot be read, is larger than [`MOST_BYTES`], or is not UTF-8.
pub fn read_text(path: &Path) -> Result<String, TextError> {
    let unreadable = |source| TextError::Read { path: path.into(), source };
    let mut bytes = Vec::new();
    // A pipe's length is unknown in advance.
    let file = File::open(path).map_err(unreadable)?;
    file.take(MOST_BYTES + 1).read_to_end(&mut bytes).map_err(unreadable)?;
    if bytes.len() as u64 > MOST_BYTES {
        return Err(TextError::TooLarge(path.into()));
    }
    // The byte order mark of Windows editors.
    if bytes.starts_with(b"\xef\xbb\xbf") {
        bytes.drain(..3);
    }
    String::from_utf8(bytes).map_err(|source| TextError::NotText { path: path.into(), source })
}

/// Writes a text file. An earlier file at `path` stays until everything is written, and on failure.
///
/// # Errors
/// If the file cannot be written.
pub fn write_text(path: &Path, text: &str) -> Result<(), TextError> {
    let written = write_whole(path, |file| file.write_all(text.as_bytes()));
    written.map_err(|source| TextError::Write { path: path.into(), source })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_text_than_a_user_writes_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("path.json");
        std::fs::write(&path, " ".repeat(MOST_BYTES as usize)).unwrap();
        assert_eq!(read_text(&path).unwrap().len() as u64, MOST_BYTES);
        std::fs::write(&path, "[".repeat(MOST_BYTES as usize + 1)).unwrap();
        assert!(read_text(&path).unwrap_err().to_string().contains("at most 16 MiB of text"));
        assert!(read_text(&folder.path().join("none")).unwrap_err().to_string().contains("none: "));
        std::fs::write(&path, b"\xef\xbb\xbf{}").unwrap();
        assert_eq!(read_text(&path).unwrap(), "{}");
        std::fs::write(&path, [b'a', 0xff]).unwrap();
        assert!(matches!(read_text(&path), Err(TextError::NotText { .. })));
        if cfg!(unix) {
            assert!(matches!(read_text(Path::new("/dev/zero")), Err(TextError::TooLarge(_))));
        }
    }
}
