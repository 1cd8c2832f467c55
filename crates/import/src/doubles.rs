//! Files of a list that are one: the same file under two names, the halves of one NIfTI image, slices of one DICOM series. Each
//! would be a step of its own, equal to another. Looking costs one question to the file system for each file, and the header of each
//! DICOM file.

use crate::error::ImportError;
use crate::{dicom, nifti};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::path::{Path, PathBuf};

/// A file or folder, whatever it is called.
#[derive(PartialEq, Eq, Hash)]
enum FileId {
    /// Its device, and its number there.
    #[cfg(unix)]
    Node { device: u64, inode: u64 },
    /// Its path, where there is no more to know.
    Path(PathBuf),
}

impl FileId {
    fn of(path: &Path) -> Self {
        #[cfg(unix)]
        if let Ok(data) = std::fs::metadata(path) {
            use std::os::unix::fs::MetadataExt;
            return Self::Node { device: data.dev(), inode: data.ino() };
        }
        // A file that cannot be asked for is told when it is opened.
        let known = path.canonicalize().or_else(|_| std::path::absolute(path));
        Self::Path(known.unwrap_or_else(|_| path.to_owned()))
    }

    /// The folder that a file is looked for in.
    fn of_parent(path: &Path) -> Self {
        Self::of(path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new(".")))
    }
}

/// Refuses a file that is there twice, under one name or several. `way_on` says what else to do than to name it once.
pub(crate) fn check_named_once(paths: &[PathBuf], way_on: &str) -> Result<(), ImportError> {
    let mut seen: HashMap<FileId, &Path> = HashMap::new();
    for path in paths {
        if let Some(first) = seen.insert(FileId::of(path), path) {
            let other = if first == path { String::new() } else { format!(", and is {}, too", first.display()) };
            return Err(ImportError::options(path, format!("is named twice{other}: name it once{way_on}")));
        }
    }
    Ok(())
}

/// Refuses both halves of a pair of `.hdr` and `.img`: either stands for the whole image.
pub(crate) fn check_pairs<'a>(paths: impl IntoIterator<Item = &'a PathBuf>) -> Result<(), ImportError> {
    let mut seen: HashMap<FileId, &Path> = HashMap::new();
    for path in paths {
        match seen.entry(FileId::of(&nifti::pair_of(path).0)) {
            // A user may name one half twice on purpose, as with `--order given`.
            Entry::Occupied(first) if FileId::of(first.get()) != FileId::of(path) => {
                let problem = format!(
                    "is half of an image, of which {} is the other: name one of the two, which opens both",
                    first.get().display()
                );
                return Err(ImportError::options(path, problem));
            }
            Entry::Occupied(_) => {}
            Entry::Vacant(place) => _ = place.insert(path),
        }
    }
    Ok(())
}

/// Refuses DICOM files that are slices of one series, of which each stands for all that are in its folder.
pub(crate) fn check_series<'a>(paths: impl IntoIterator<Item = &'a PathBuf>) -> Result<(), ImportError> {
    let mut seen: HashMap<(FileId, String), &Path> = HashMap::new();
    for path in paths {
        // A header that cannot be read is told when the file is opened.
        let Ok(Some(series)) = dicom::series_of(path) else { continue };
        match seen.entry((FileId::of_parent(path), series)) {
            Entry::Occupied(first) if FileId::of(first.get()) != FileId::of(path) => {
                let problem = format!(
                    "is a slice of the series that {} is of, and each stands for the whole series: name one file of a series, or its folder, \
                     for each step",
                    first.get().display()
                );
                return Err(ImportError::options(path, problem));
            }
            Entry::Occupied(_) => {}
            Entry::Vacant(place) => _ = place.insert(path),
        }
    }
    Ok(())
}

/// Refuses a file in a folder that is named, too.
pub(crate) fn check_folders(paths: &[PathBuf]) -> Result<(), ImportError> {
    let folders: HashMap<FileId, &Path> =
        paths.iter().filter(|path| path.is_dir()).map(|path| (FileId::of(path), path.as_path())).collect();
    if folders.is_empty() {
        return Ok(());
    }
    for path in paths.iter().filter(|path| !path.is_dir()) {
        if let Some(folder) = folders.get(&FileId::of_parent(path)) {
            let problem = format!("lies in {}, which is named, too: name one of the two", folder.display());
            return Err(ImportError::options(path, problem));
        }
    }
    Ok(())
}
