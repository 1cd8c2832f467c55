//! Output files: never overwritten by default, and refused before the work, not after it; and notes on a picture.

use super::say::{self, say};
use super::{Failure, print_json};
use brickyard::export::{ExportError, Format, paths_of};
use brickyard::stats::RenderStats;
use brickyard::store::{Store, check_outside};
use brickyard::text_file::write_text;
use brickyard::volume::counted;
use brickyard::volume::numbers::significant;
use brickyard::volume::transfer::shown_window;
use brickyard::volume::units::with_unit;
use serde::Serialize;
use std::ffi::OsStr;
use std::path::Path;
use std::sync::Arc;

/// Whether a path is `-`, which stands for standard output of data.
pub(crate) fn is_stdout(path: &Path) -> bool {
    path == Path::new("-")
}

/// Checks whether a file may be written here.
///
/// # Errors
/// Exit code 2 if something is there and may not be replaced, as a folder or device never may, or if the path is inside
/// a store.
pub(crate) fn may_write(path: &Path, overwrite: bool) -> Result<(), Failure> {
    check_outside(path).map_err(Failure::usage)?;
    // A dangling link is something too.
    let Ok(found) = path.symlink_metadata() else { return Ok(()) };
    let is_no_file = path.metadata().is_ok_and(|found| !found.is_file());
    let (what, advice) = match (found.is_dir(), is_no_file, overwrite) {
        (true, ..) => ("is a folder, which is left alone", "choose another name"),
        (_, true, _) => ("is not a regular file, and is never replaced", "choose another name"),
        (_, _, false) => ("exists already", "choose another name, or pass --overwrite to replace it"),
        (_, _, true) => return Ok(()),
    };
    Err(Failure::usage(format!("{}: {what}; {advice}", path.display())))
}

/// Checks whether a picture may be written here: as [`may_write`], and it is a PNG file in an existing folder.
///
/// # Errors
/// Exit code 2 if not.
pub(crate) fn may_write_png(path: &Path, overwrite: bool) -> Result<(), Failure> {
    if !path.extension().is_some_and(|end| end.eq_ignore_ascii_case("png")) {
        let advice = "pictures are written as PNG: choose a name ending in .png";
        return Err(Failure::usage(format!("{}: {advice}", path.display())));
    }
    may_write_file(path, overwrite)
}

/// Checks whether voxels may be exported here: as [`may_write`], to all files of the name's format, in an existing folder.
///
/// # Errors
/// Exit code 2 if not.
pub(crate) fn may_write_array(path: &Path, overwrite: bool) -> Result<(), Failure> {
    if path.extension().is_some_and(|end| end.eq_ignore_ascii_case("png")) && Format::of(path).is_none() {
        let advice = "a PNG picture holds one plane: for a folder of planes, end the name in /";
        return Err(Failure::usage(format!("{}: {advice}", path.display())));
    }
    let files = paths_of(path).ok_or_else(|| Failure::usage(ExportError::Extension { path: path.into() }))?;
    let has_folder = matches!(Format::of(path), Some(Format::Zarr | Format::Pvd));
    files.iter().try_for_each(|file| match has_folder && file.is_dir() {
        // Whether it may be replaced is seen with its content.
        true => check_outside(file).map_err(Failure::usage),
        false => may_write_file(file, overwrite),
    })
}

/// Checks whether a mesh may be written here: as [`may_write`], and it is a file of a supported type, in an existing
/// folder.
///
/// # Errors
/// Exit code 2 if not.
pub(crate) fn may_write_mesh(path: &Path, overwrite: bool) -> Result<(), Failure> {
    let is_known =
        |found: &OsStr| ["stl", "ply", "obj", "glb"].iter().any(|extension| found.eq_ignore_ascii_case(extension));
    if !path.extension().is_some_and(is_known) {
        let advice = "meshes are written as .stl, .ply, .obj or .glb: choose a name ending in one of these";
        return Err(Failure::usage(format!("{}: {advice}", path.display())));
    }
    may_write_file(path, overwrite)
}

/// Checks whether a file may be written here: as [`may_write`], in an existing folder.
///
/// # Errors
/// Exit code 2 if not.
pub(crate) fn may_write_file(path: &Path, overwrite: bool) -> Result<(), Failure> {
    check_outside(path).map_err(Failure::usage)?;
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty());
    if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
        return Err(Failure::usage(format!("{}: there is no folder {}", path.display(), folder.display())));
    }
    may_write(path, overwrite)
}

/// Creates a folder for output, unless it exists.
///
/// # Errors
/// Exit code 2 if something else is there or the path is inside a store, 1 if it cannot be created.
pub(crate) fn make_folder(path: &Path) -> Result<(), Failure> {
    check_outside(&path.join("output")).map_err(Failure::usage)?;
    if path.is_dir() {
        return Ok(());
    }
    if path.symlink_metadata().is_ok() {
        return Err(Failure::usage(format!("{}: expected a folder, found something else", path.display())));
    }
    std::fs::create_dir_all(path).map_err(|error| Failure::failed(format!("{}: {error}", path.display())))
}

/// Checks whether data may be written here: as [`may_write_file`], and standard output always accepts them.
///
/// # Errors
/// Exit code 2 if not.
pub(crate) fn may_write_data(path: &Path, overwrite: bool) -> Result<(), Failure> {
    if is_stdout(path) { Ok(()) } else { may_write_file(path, overwrite) }
}

/// Writes a value to a file, or to standard output, as JSON.
///
/// # Errors
/// If it cannot be written.
pub(crate) fn write_json(path: &Path, value: &impl Serialize) -> Result<(), Failure> {
    if is_stdout(path) {
        return print_json(value);
    }
    let text = serde_json::to_string_pretty(value).map_err(Failure::failed)?;
    write_text(path, &(text + "\n")).map_err(Failure::failed)
}

/// Prints a note on a picture of a channel with a single value, or none. Missing stores and channels have no note.
pub(crate) fn note_window(store: Option<&Arc<Store>>, channel: u32) {
    let Some(store) = store else { return };
    let Some(of_channel) = store.info().channels.get(channel as usize) else { return };
    let (low, high) = store.default_window(channel);
    let path = store.path().display();
    let (of_all, cure) = match store.has_exact_statistics() {
        true => ("", ""),
        false => (" in a sample", "; `index` looks at all of them, --window sets another"),
    };
    if of_channel.count == 0 && of_all.is_empty() {
        say!("note: {path}: no voxel of channel {channel} has a value: there is nothing to show");
    } else if low >= high {
        let (from, to) = shown_window((low, high));
        let [low, from, to] = [low, from, to].map(|value| significant(value, 7));
        let unit = store.channel_displays()[channel as usize].unit.as_deref();
        let (low, to) = (with_unit(&low, unit), with_unit(&to, unit));
        say!(
            "note: {path}: every value{of_all} of channel {channel} is {low}: its window is set from {from} to {to}{cure}"
        );
    }
}

pub(crate) fn report(stats: &RenderStats) {
    if stats.memory_bound {
        let found = match stats.effective_pixel_error {
            Some(error) => format!("{error:.1} px of {:.1} px", stats.pixel_error),
            None => "the eye is inside a coarse brick".into(),
        };
        let flag = if stats.backend == "cpu" { "--cpu-memory" } else { "--gpu-memory" };
        say!("memory bound: {found}; the picture is complete but coarser than requested: raise {flag}");
    }
    if let Some(damage) = damage(stats) {
        say::error(format_args!("{damage}"));
    }
}

/// Describes the bricks that could not be read for the pictures, in a line; `None` if there are none.
pub(super) fn damage(stats: &RenderStats) -> Option<String> {
    let what = match (stats.bricks.failed, stats.bricks.unreadable) {
        (0, 0) => return None,
        (0, n) => format!("{} outside the picture, or aprons, could not be read", counted(n, "brick")),
        (1, _) => "1 brick could not be read and is drawn from a coarser level".into(),
        (n, _) => format!("{n} bricks could not be read and are drawn from coarser levels"),
    };
    Some(format!("{what}; `brickyard verify` lists them"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arrays_are_of_types_that_are_written_and_in_folders_that_there_are() {
        let folder = tempfile::tempdir().unwrap();
        let problem =
            |name: &str| may_write_array(&folder.path().join(name), false).err().map(|failure| failure.message);
        assert_eq!((problem("a.raw"), problem("a.NPY")), (None, None));
        assert_eq!((problem("a.nii.gz"), problem("a.mhd"), problem("planes/")), (None, None, None));
        for name in ["a.xyz", "a", "raw", "-"] {
            assert!(problem(name).unwrap().contains(".npy, .raw or"), "{name}");
        }
        assert!(problem("a.png").unwrap().contains("end the name in /"));
        std::fs::write(folder.path().join("b.raw"), "").unwrap();
        std::fs::write(folder.path().join("c.raw.json"), "").unwrap();
        for (name, there) in [("b.mhd", "b.raw"), ("c.raw", "c.raw.json")] {
            let found = problem(name).unwrap();
            assert!(found.contains(there) && found.contains("exists already"), "{found}");
        }
        assert!(problem("none/a.npy").unwrap().contains("there is no folder"));
    }

    #[test]
    fn what_is_there_stays_unless_told_and_folders_always() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("file"), "").unwrap();
        std::fs::create_dir(path("folder")).unwrap();
        std::os::unix::fs::symlink("nowhere", path("link")).unwrap();
        std::os::unix::fs::symlink("/dev/full", path("device")).unwrap();
        for (name, without, with) in [
            ("new", true, true),
            ("file", false, true),
            ("link", false, true),
            ("folder", false, false),
            ("device", false, false),
        ] {
            assert_eq!(may_write(&path(name), false).is_ok(), without, "{name}");
            assert_eq!(may_write(&path(name), true).is_ok(), with, "{name}, --overwrite");
        }
    }
}
