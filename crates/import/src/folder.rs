//! File selection in a folder: those of its one format. Each is a time step, or a slice of a volume.

use crate::dicom_files;
use crate::error::{ImportError, Result};
use crate::files::{is_file, listed, name_of};
use crate::format::Format;
use crate::options::OpenOptions;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Lists the input files of a folder, in no order. Raw files do not identify themselves, so they count only with layout options, or
/// alone. `read` lists the readable formats, for messages.
///
/// # Errors
/// If the folder cannot be read, has no such files, or has those of several formats.
pub(crate) fn files_of(folder: &Path, options: &OpenOptions, read: &str) -> Result<Vec<PathBuf>> {
    let dicom = dicom_files::files_in(folder)?;
    let mut found: BTreeMap<Format, Vec<PathBuf>> = BTreeMap::new();
    for path in listed(folder)? {
        let Some(format) = Format::of_name(&path).filter(|_| dicom.binary_search(&path).is_err()) else { continue };
        if is_file(&path)? {
            found.entry(format).or_default().push(path);
        }
    }
    if !dicom.is_empty() {
        found.insert(Format::Dicom, dicom);
    }
    // Folders of scanners hold previews, and their slices, often without an extension, fit no pattern.
    if found.contains_key(&Format::Dicom) {
        found.retain(|format, _| !matches!(format, Format::Picture(_)));
    }
    if options.shape.is_none() && found.len() > 1 {
        found.remove(&Format::Raw);
    }
    let counts: Vec<String> =
        found.iter().map(|(format, files)| format!("{} {}", files.len(), format.name())).collect();
    match &counts[..] {
        [] => {
            let problem = match &folders_in(folder)?[..] {
                [] => format!("a folder without readable files; supported are: {read}"),
                [one] => format!("holds no readable file, but the folder {one}: pass that"),
                [first, .., last] => {
                    format!("holds no readable file, but folders, {first} to {last}: pass one of them")
                }
            };
            Err(ImportError::invalid(folder, problem))
        }
        [_] => Ok(found.into_values().flatten().collect()),
        [first @ .., last] => {
            let list = format!("{} and {last}", first.join(", "));
            let problem =
                format!("holds {list} files: choose one of them, or those of one format by a pattern of their names");
            Err(ImportError::options(folder, problem))
        }
    }
}

/// Names of a folder's visible subfolders, in order.
fn folders_in(folder: &Path) -> Result<Vec<String>> {
    let folders = listed(folder)?.into_iter().filter(|path| path.is_dir());
    let mut names: Vec<_> = folders.map(|path| name_of(&path)).collect();
    names.sort();
    Ok(names)
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
