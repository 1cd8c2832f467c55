//! File selection in a folder: those of its one format. Each is a time step, or a slice of a volume.

use crate::error::ImportError;
use crate::files::is_file;
use crate::options::OpenOptions;
use crate::{dicom_files, foreign};
use std::path::{Path, PathBuf};

/// Possible formats of a folder, as named in messages.
const KINDS: [&str; 5] = ["TIFF", "DICOM", ".npy", "NIfTI", "raw"];

const TIFF: usize = 0;
const DICOM: usize = 1;
const NPY: usize = 2;
const NIFTI: usize = 3;
const RAW: usize = 4;

/// Lists the input files of a folder, in no order. Raw files do not identify themselves, so they count only with layout options, or
/// alone. `read` lists the readable formats, for messages.
///
/// # Errors
/// If the folder cannot be read, has no such files, or has those of several formats.
pub(crate) fn files_of(folder: &Path, options: &OpenOptions, read: &str) -> Result<Vec<PathBuf>, ImportError> {
    let dicom = dicom_files::files_in(folder)?;
    let mut found: [Vec<PathBuf>; 5] = Default::default();
    for entry in std::fs::read_dir(folder).map_err(ImportError::io(folder))? {
        let path = entry.map_err(ImportError::io(folder))?.path();
        let hidden = path.file_name().is_some_and(|n| n.to_string_lossy().starts_with('.'));
        let Some(kind) = kind_by_name(&path).filter(|_| !hidden && !dicom.contains(&path)) else { continue };
        if is_file(&path)? {
            found[kind].push(path);
        }
    }
    found[DICOM] = dicom;
    if options.shape.is_none() && found[..RAW].iter().any(|files| !files.is_empty()) {
        found[RAW].clear();
    }
    let counts: Vec<String> = (0..KINDS.len())
        .filter(|kind| !found[*kind].is_empty())
        .map(|kind| format!("{} {}", found[kind].len(), KINDS[kind]))
        .collect();
    match &counts[..] {
        [] => {
            foreign::refuse_folder(folder)?;
            let problem = match &folders_in(folder)?[..] {
                [] => format!("a folder without readable files; supported are: {read}"),
                [one] => format!("holds no readable file, but the folder {one}: pass that"),
                [first, .., last] => {
                    format!("holds no readable file, but folders, {first} to {last}: pass one of them")
                }
            };
            Err(ImportError::invalid(folder, problem))
        }
        [_] => Ok(found.into_iter().flatten().collect()),
        [first @ .., last] => {
            let list = format!("{} and {last}", first.join(", "));
            let problem =
                format!("holds {list} files: choose one of them, or those of one format by a pattern of their names");
            Err(ImportError::options(folder, problem))
        }
    }
}

/// Names of a folder's visible subfolders, in order.
fn folders_in(folder: &Path) -> Result<Vec<String>, ImportError> {
    let entries = std::fs::read_dir(folder).map_err(ImportError::io(folder))?;
    let folders = entries.filter_map(Result::ok).filter(|entry| entry.path().is_dir());
    let mut names: Vec<_> = folders.map(|entry| entry.file_name().to_string_lossy().into_owned()).collect();
    names.retain(|name| !name.starts_with('.'));
    names.sort();
    Ok(names)
}

/// Format by the file's name; `None` if unknown, or if the file is the second of a pair.
fn kind_by_name(path: &Path) -> Option<usize> {
    let name = path.file_name()?.to_string_lossy().to_ascii_lowercase();
    let ends = |extensions: &[&str]| extensions.iter().any(|end| name.ends_with(end));
    if is_tiff_name(path) {
        return Some(TIFF);
    }
    match () {
        () if ends(&[".npy"]) => Some(NPY),
        () if ends(&[".nii", ".nii.gz", ".hdr", ".hdr.gz"]) => Some(NIFTI),
        () if ends(&[".raw", ".bin", ".dat"]) => Some(RAW),
        () => None,
    }
}

pub(crate) fn is_tiff_name(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    ["tif", "tiff", "btf", "tf8"].iter().any(|e| extension == *e)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn files(names: &[&str], options: &OpenOptions) -> Result<Vec<String>, String> {
        let folder = tempfile::tempdir().unwrap();
        for name in names {
            std::fs::write(folder.path().join(name), "x").unwrap();
        }
        let found = files_of(folder.path(), options, "things").map_err(|error| error.to_string())?;
        let mut names: Vec<_> =
            found.iter().map(|path| path.file_name().unwrap().to_str().unwrap().to_owned()).collect();
        names.sort();
        Ok(names)
    }

    #[test]
    fn the_one_format_of_a_folder_is_meant() {
        let none = OpenOptions::default();
        let told = OpenOptions { shape: Some(brickyard_volume::Extent::new(1, 1, 1)), ..none.clone() };
        let found = |names: &[&str], options: &OpenOptions| files(names, options).unwrap().join(" ");
        assert_eq!(found(&["s1.npy", "s2.npy", "notes.txt", ".s3.npy"], &none), "s1.npy s2.npy");
        assert_eq!(found(&["a.nii.gz", "b.nii", "c.hdr", "c.img", "c.json"], &none), "a.nii.gz b.nii c.hdr");
        assert_eq!(found(&["s1.raw", "s2.RAW", "s3.bin"], &none), "s1.raw s2.RAW s3.bin");
        // An unidentified file beside planes is ignored, unless options describe such files.
        assert_eq!(found(&["p1.tif", "p2.tif", "thumbs.dat"], &none), "p1.tif p2.tif");
        assert_eq!(found(&["s1.raw", "s2.raw"], &told), "s1.raw s2.raw");
        for (names, options, words) in [
            (&["a.npy", "b.npy", "c.tif"][..], &none, "holds 1 TIFF and 2 .npy files"),
            (&["a.npy", "b.nii", "c.tif"], &none, "holds 1 TIFF, 1 .npy and 1 NIfTI files"),
            (&["a.npy", "b.raw"], &told, "holds 1 .npy and 1 raw files"),
            (&["a.txt"], &none, "a folder without readable files; supported are: things"),
        ] {
            let message = files(names, options).unwrap_err();
            assert!(message.contains(words), "{message}");
        }
        let folder = tempfile::tempdir().unwrap();
        for (name, words) in
            [("b", "no readable file, but the folder b: pass that"), ("a", "but folders, a to b: pass one of them")]
        {
            std::fs::create_dir(folder.path().join(name)).unwrap();
            let message = files_of(folder.path(), &none, "things").unwrap_err().to_string();
            assert!(message.ends_with(words), "{message}");
        }
    }
}
