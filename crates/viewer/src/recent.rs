//! Recently opened paths, newest first: a list in a JSON file of the user's. Costs reading or writing a small file.

use crate::keeping::{make_folder_of, write_json};
use brickyard::addresses::is_address;
use brickyard::text_file::read_text;
use std::path::{Path, PathBuf};

/// Most paths kept.
const MOST: usize = 20;

/// The stores, files and folders opened last.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Recent {
    /// The file of the list; `None` keeps nothing.
    file: Option<PathBuf>,
    paths: Vec<PathBuf>,
}

impl Recent {
    /// Reads the list from a file. A missing file, or one with other contents, is an empty list, which will overwrite it in time.
    pub(crate) fn read(file: Option<PathBuf>) -> Self {
        let text = file.as_deref().and_then(|file| read_text(file).ok());
        let mut paths: Vec<PathBuf> = text.and_then(|text| serde_json::from_str(&text).ok()).unwrap_or_default();
        paths.truncate(MOST);
        Self { file, paths }
    }

    /// The paths and addresses, newest first. Some may be gone: see [`Path::exists`].
    pub(crate) fn paths(&self) -> &[PathBuf] {
        &self.paths
    }

    /// Puts a path first, and writes the list.
    ///
    /// # Errors
    /// If the list cannot be written. The path is in the list all the same.
    pub(crate) fn add(&mut self, path: &Path) -> Result<(), String> {
        let absolute = || std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
        let path = if is_address(path) { path.to_owned() } else { absolute() };
        self.paths.retain(|other| *other != path);
        self.paths.insert(0, path);
        self.paths.truncate(MOST);
        let Some(file) = &self.file else { return Ok(()) };
        make_folder_of(file)?;
        write_json(file, &self.paths)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_newest_are_first_once_and_kept() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("state/recent.json");
        let mut recent = Recent::read(Some(file.clone()));
        for i in (0..30).chain([25]) {
            recent.add(Path::new(&format!("/scans/{i}.nii"))).unwrap();
        }
        let first: Vec<_> = recent.paths()[..3].iter().map(|path| path.to_str().unwrap()).collect();
        assert_eq!((first, recent.paths().len()), (vec!["/scans/25.nii", "/scans/29.nii", "/scans/28.nii"], MOST));
        assert_eq!(Recent::read(Some(file.clone())), recent);
        std::fs::write(&file, "not a list").unwrap();
        assert!(Recent::read(Some(file)).paths().is_empty());
    }

    #[test]
    fn paths_are_kept_for_any_working_folder() {
        let mut recent = Recent::read(None);
        recent.add(Path::new("scan.nii")).unwrap();
        assert_eq!(recent.paths()[0], std::env::current_dir().unwrap().join("scan.nii"));
        recent.add(Path::new("https://a.org/b.zarr")).unwrap();
        assert_eq!(recent.paths()[0], Path::new("https://a.org/b.zarr"));
    }
}
