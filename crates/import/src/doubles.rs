//! Duplicates in a list: one file under two names, the halves of one NIfTI image, slices of one DICOM series. Each would become
//! one of two equal steps. Costs a file-system query per file, and the header of each DICOM file.

use crate::error::{ImportError, Result};
use crate::files::folder_of;
use crate::{dicom, nifti};
use std::collections::HashMap;
use std::hash::Hash;
use std::path::{Display, Path, PathBuf};

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
        Self::of(folder_of(path))
    }
}

/// Refuses a file listed twice, under one name or several. `way_on` is the message's alternative to naming it once.
pub(crate) fn check_named_once(paths: &[PathBuf], way_on: &str) -> Result<()> {
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
pub(crate) fn check_pairs<'a>(paths: impl IntoIterator<Item = &'a PathBuf>) -> Result<()> {
    let image = |path: &Path| Some(FileId::of(&nifti::pair_of(path).0));
    check_apart(paths, image, |first| {
        format!("is half of the same image as {first}: name one of the two, which opens both")
    })
}

/// Refuses several DICOM slices of one series: each stands for the whole series in its folder.
pub(crate) fn check_series<'a>(paths: impl IntoIterator<Item = &'a PathBuf>) -> Result<()> {
    // Unreadable headers are reported on opening.
    let series = |path: &Path| Some((FileId::of_parent(path), dicom::series_of(path).ok().flatten()?));
    check_apart(paths, series, |first| {
        format!(
            "is a slice of the same series as {first}, and each stands for the whole series: name one file of a \
             series, or its folder, for each step"
        )
    })
}

/// Refuses different files with one key; those without any are passed over. The same file may be repeated on purpose, as with
/// `--order given`.
fn check_apart<'a, K: Eq + Hash>(
    paths: impl IntoIterator<Item = &'a PathBuf>,
    key: impl Fn(&Path) -> Option<K>,
    problem: impl Fn(Display<'_>) -> String,
) -> Result<()> {
    let mut seen: HashMap<K, &Path> = HashMap::new();
    for path in paths {
        let Some(key) = key(path) else { continue };
        let first = *seen.entry(key).or_insert(path);
        if first != path && FileId::of(first) != FileId::of(path) {
            return Err(ImportError::options(path, problem(first.display())));
        }
    }
    Ok(())
}

/// Refuses files inside folders of the same list.
pub(crate) fn check_folders(paths: &[PathBuf]) -> Result<()> {
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
