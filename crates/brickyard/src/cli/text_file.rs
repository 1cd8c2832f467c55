//! Files of text that users write: scenes, paths, transfer functions, matrices.

use super::failure::Failure;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Most bytes of such a file. Once it is read, JSON takes twenty times its size and more; a path of 80,000 cameras fits.
const MOST_BYTES: u64 = 16 << 20;

/// The text in a file.
pub(super) fn read_text(path: &Path) -> Result<String, Failure> {
    let bad = |problem: String| Failure::bad_input(format!("{}: {problem}", path.display()));
    let mut bytes = Vec::new();
    let file = File::open(path).map_err(|error| bad(error.to_string()))?;
    // A pipe does not tell its length before.
    file.take(MOST_BYTES + 1).read_to_end(&mut bytes).map_err(|error| bad(error.to_string()))?;
    if bytes.len() as u64 > MOST_BYTES {
        return Err(bad(format!("expected at most {} MiB of text, found more", MOST_BYTES >> 20)));
    }
    String::from_utf8(bytes).map_err(|error| bad(error.to_string()))
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
        assert!(read_text(&path).unwrap_err().message.contains("at most 16 MiB of text"));
        assert!(read_text(&folder.path().join("none")).unwrap_err().message.contains("none: "));
        if cfg!(unix) {
            assert!(read_text(Path::new("/dev/zero")).unwrap_err().message.contains("at most 16 MiB"));
        }
    }
}
