//! The user's cache folder for this program.

use std::ffi::OsString;
use std::path::PathBuf;

/// The folder: `BRICKYARD_CACHE`, which may be empty for none; else `brickyard` in `XDG_CACHE_HOME` or `~/.cache`. `None` if there is none.
pub fn cache_folder() -> Option<PathBuf> {
    by(|name| std::env::var_os(name))
}

fn by(variable: impl Fn(&str) -> Option<OsString>) -> Option<PathBuf> {
    let folder = |name: &str| variable(name).map(PathBuf::from).filter(|path| path.is_absolute());
    match variable("BRICKYARD_CACHE") {
        Some(named) => Some(PathBuf::from(named)).filter(|path| !path.as_os_str().is_empty()),
        None => folder("XDG_CACHE_HOME")
            .or_else(|| folder("HOME").map(|home| home.join(".cache")))
            .map(|caches| caches.join("brickyard")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_environment_names_the_folder() {
        let of = |variables: &[(&str, &str)]| {
            let find = |name: &str| variables.iter().find(|(n, _)| *n == name).map(|(_, value)| OsString::from(value));
            by(find).map(|path| path.display().to_string())
        };
        assert_eq!(of(&[]), None);
        assert_eq!(of(&[("HOME", "/home/a")]).unwrap(), "/home/a/.cache/brickyard");
        assert_eq!(of(&[("HOME", "/home/a"), ("XDG_CACHE_HOME", "/c")]).unwrap(), "/c/brickyard");
        assert_eq!(of(&[("HOME", "/home/a"), ("BRICKYARD_CACHE", "")]), None);
        assert_eq!(of(&[("HOME", "/home/a"), ("BRICKYARD_CACHE", "here")]).unwrap(), "here");
    }
}
