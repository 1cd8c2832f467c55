//! Keys of chunks: the path of a chunk's file in the array's folder, by its place in the grid.

use crate::error::{ImportError, Result};
use brickyard_objects::is_address;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// How places become keys.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Keys {
    /// Whether keys begin with `c`, by version 3's own way.
    pub(super) has_prefix: bool,
    /// Between indices: a slash makes folders.
    pub(super) separator: char,
}

impl Keys {
    /// The path of the chunk at a place, slowest axis first.
    pub(super) fn path(self, folder: &Path, place: &[u64]) -> PathBuf {
        let mut parts: Vec<String> = place.iter().map(u64::to_string).collect();
        if self.has_prefix {
            parts.insert(0, "c".into());
        }
        if parts.is_empty() {
            // The only chunk of an array without axes.
            parts.push("0".into());
        }
        folder.join(parts.join(&self.separator.to_string()))
    }

    /// Whether any file in the folder is a chunk of a grid. Ends with the first.
    ///
    /// # Errors
    /// If a folder cannot be listed.
    pub(super) fn any_in(self, folder: &Path, grid: &[u64]) -> Result<bool> {
        // A server need not list its objects.
        if is_address(folder) {
            return Ok(true);
        }
        if grid.is_empty() {
            return Ok(self.path(folder, grid).is_file());
        }
        match self.separator {
            '/' => any_below(&if self.has_prefix { folder.join("c") } else { folder.to_owned() }, grid),
            _ => any_entry(folder, &mut |name, path| {
                let name = if self.has_prefix { name.strip_prefix("c.") } else { Some(name) };
                let indices = || name.map(|name| name.split(self.separator).collect::<Vec<_>>()).unwrap_or_default();
                Ok(are_in(&indices(), grid) && path.is_file())
            }),
        }
    }
}

/// Whether a folder has a chunk some folders down: one for each axis but the last.
fn any_below(folder: &Path, grid: &[u64]) -> Result<bool> {
    any_entry(folder, &mut |name, path| match (are_in(&[name], &grid[..1]), grid.len()) {
        (false, _) => Ok(false),
        (true, 1) => Ok(path.is_file()),
        (true, _) => any_below(path, &grid[1..]),
    })
}

fn any_entry(folder: &Path, is_chunk: &mut dyn FnMut(&str, &Path) -> Result<bool>) -> Result<bool> {
    let entries = match std::fs::read_dir(folder) {
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => return Ok(false),
        entries => entries.map_err(ImportError::io(folder))?,
    };
    for entry in entries {
        let entry = entry.map_err(ImportError::io(folder))?;
        if entry.file_name().to_str().is_some_and(|name| name.starts_with(|c: char| c == 'c' || c.is_ascii_digit()))
            && is_chunk(&entry.file_name().to_string_lossy(), &entry.path())?
        {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Whether texts are a place in a grid, without leading zeros.
fn are_in(indices: &[&str], grid: &[u64]) -> bool {
    let is_in = |(text, count): (&&str, &u64)| text.parse().is_ok_and(|n: u64| n < *count && n.to_string() == **text);
    indices.len() == grid.len() && indices.iter().zip(grid).all(is_in)
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [Keys; 4] = [
        Keys { has_prefix: true, separator: '/' },
        Keys { has_prefix: true, separator: '.' },
        Keys { has_prefix: false, separator: '/' },
        Keys { has_prefix: false, separator: '.' },
    ];

    #[test]
    fn keys_are_those_of_the_specifications() {
        let said = |place: &[u64]| ALL.map(|keys| keys.path(Path::new("a"), place).to_string_lossy().into_owned());
        assert_eq!(said(&[1, 23, 45]), ["a/c/1/23/45", "a/c.1.23.45", "a/1/23/45", "a/1.23.45"]);
        assert_eq!(said(&[7]), ["a/c/7", "a/c.7", "a/7", "a/7"]);
        assert_eq!(said(&[]), ["a/c", "a/c", "a/0", "a/0"]);
    }

    #[test]
    fn a_chunk_is_found_among_other_files() {
        for keys in ALL {
            for place in [&[1, 2, 0][..], &[4], &[]] {
                let folder = tempfile::tempdir().unwrap();
                let grid: Vec<u64> = place.iter().map(|n| n + 1).collect();
                assert!(!keys.any_in(&folder.path().join("none"), &grid).unwrap());
                for other in ["zarr.json", "00", "9", "1.2", "1.02.0", "x.1.2.0"] {
                    std::fs::write(folder.path().join(other), b"").unwrap();
                }
                let chunk = keys.path(folder.path(), place);
                let is_taken = chunk.parent() != Some(folder.path()) && !keys.has_prefix;
                std::fs::create_dir_all(chunk.parent().unwrap()).unwrap();
                assert!(!keys.any_in(folder.path(), &grid).unwrap(), "{keys:?} {place:?} {is_taken}");
                std::fs::write(&chunk, b"").unwrap();
                assert!(keys.any_in(folder.path(), &grid).unwrap(), "{keys:?} {place:?}");
                if !grid.is_empty() {
                    let smaller: Vec<u64> = place.iter().map(|n| (*n).max(1)).collect();
                    let is_outside = place.iter().zip(&smaller).any(|(n, count)| n >= count);
                    assert_eq!(keys.any_in(folder.path(), &smaller).unwrap(), !is_outside, "{keys:?} {place:?}");
                }
            }
        }
    }
}
