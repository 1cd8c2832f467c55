//! Output files: never overwritten without being told, and refused before the work, not after it.

use super::failure::Failure;
use std::path::Path;

/// Whether a file may be written here.
///
/// # Errors
/// Exit code 2 if something is there and may not be replaced; a folder never is.
pub(crate) fn may_write(path: &Path, overwrite: bool) -> Result<(), Failure> {
    // A link that leads nowhere is something too.
    let Ok(found) = path.symlink_metadata() else { return Ok(()) };
    let (what, advice) = match (found.is_dir(), overwrite) {
        (true, _) => ("is a folder, and is left alone", "choose another name"),
        (false, false) => ("exists already", "choose another name, or pass --overwrite to replace it"),
        (false, true) => return Ok(()),
    };
    Err(Failure::usage(format!("{}: {what}; {advice}", path.display())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_there_stays_unless_told_and_folders_always() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        std::fs::write(path("file"), "").unwrap();
        std::fs::create_dir(path("folder")).unwrap();
        std::os::unix::fs::symlink("nowhere", path("link")).unwrap();
        for (name, without, with) in
            [("new", true, true), ("file", false, true), ("link", false, true), ("folder", false, false)]
        {
            assert_eq!(may_write(&path(name), false).is_ok(), without, "{name}");
            assert_eq!(may_write(&path(name), true).is_ok(), with, "{name}, --overwrite");
        }
    }
}
