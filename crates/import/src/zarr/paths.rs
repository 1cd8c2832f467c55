//! Paths within a store, by documents and callers: never absolute, nor out of the folder that they begin in. Costs nothing.

use std::path::{Component, Path, PathBuf};

/// A path from a folder of the store on. The error names what is not allowed.
pub(super) fn inside(path: &str) -> Result<PathBuf, &'static str> {
    let mut inside = PathBuf::new();
    for part in Path::new(path).components() {
        match part {
            Component::Normal(name) => inside.push(name),
            Component::CurDir => {}
            Component::ParentDir => return Err("a path without `..`"),
            Component::RootDir | Component::Prefix(_) => return Err("a path that is not absolute"),
        }
    }
    match inside.as_os_str().is_empty() || path.contains('\0') {
        true => Err("the path of a folder"),
        false => Ok(inside),
    }
}

/// A path with slashes, for messages and names.
pub(super) fn in_words(path: &Path) -> String {
    let parts: Vec<_> = path.iter().map(|part| part.to_string_lossy()).collect();
    parts.join("/")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_stay_inside() {
        for (path, expected) in [("0", Ok("0")), ("./scale0/image/", Ok("scale0/image"))] {
            assert_eq!(inside(path).map(|path| in_words(&path)), expected.map(str::to_owned), "{path}");
        }
        for (path, words) in [
            ("../a", "`..`"),
            ("a/../../b", "`..`"),
            ("/etc", "absolute"),
            ("a\0b", "folder"),
            ("", "folder"),
            ("./", "folder"),
        ] {
            assert!(inside(path).unwrap_err().contains(words), "{path}");
        }
    }
}
