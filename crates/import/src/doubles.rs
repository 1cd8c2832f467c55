//! Duplicates in a list: one file under two names, the halves of one NIfTI image, slices of one DICOM series. Each would become
//! one of two equal steps. Costs one file-system query per file, and the header of each DICOM file.

use crate::error::ImportError;
use crate::{dicom, nifti};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::path::{Path, PathBuf};

/// Identity of a file or folder under any name.
#[derive(PartialEq, Eq, Hash)]
enum FileId {
    /// Device, and number on it.
    #[cfg(unix)]
    Node { device: u64, inode: u64 },
    /// The path, where nothing better is known.
    Path(PathBuf),
}

impl FileId {
    fn of(path: &Path) -> Self {
        #[cfg(unix)]
        if let Ok(data) = std::fs::metadata(path) {
            use std::os::unix::fs::MetadataExt;
            return Self::Node { device: data.dev(), inode: data.ino() };
        }
        // Files that cannot be examined are reported on opening.
        let known = path.canonicalize().or_else(|_| std::path::absolute(path));
        Self::Path(known.unwrap_or_else(|_| path.to_owned()))
    }

    fn of_parent(path: &Path) -> Self {
        Self::of(path.parent().filter(|parent| !parent.as_os_str().is_empty()).unwrap_or(Path::new(".")))
    }
}

/// Refuses a file listed twice, under one name or several. `way_on` is the message's alternative to naming it once.
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
            // A half may be repeated on purpose, as with `--order given`.
            Entry::Occupied(first) if FileId::of(first.get()) != FileId::of(path) => {
                let problem = format!(
                    "is half of the same image as {}: name one of the two, which opens both",
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

/// Refuses several DICOM slices of one series: each stands for the whole series in its folder.
pub(crate) fn check_series<'a>(paths: impl IntoIterator<Item = &'a PathBuf>) -> Result<(), ImportError> {
    let mut seen: HashMap<(FileId, String), &Path> = HashMap::new();
    for path in paths {
        // Unreadable headers are reported on opening.
        let Ok(Some(series)) = dicom::series_of(path) else { continue };
        match seen.entry((FileId::of_parent(path), series)) {
            Entry::Occupied(first) if FileId::of(first.get()) != FileId::of(path) => {
                let problem = format!(
                    "is a slice of the same series as {}, and each stands for the whole series: name one file of a \
                     series, or its folder, for each step",
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

/// Refuses files inside folders of the same list.
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
