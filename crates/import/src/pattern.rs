//! Patterns of file names: `step_*.npy` and `step_??.npy`, or printf's `step_%04d.raw`. A shell expands only the first two, and only up to its
//! limit; here a folder may hold any number of files.

use crate::error::{ImportError, Result};
use crate::files::is_file;
use crate::zarr;
use std::path::{Path, PathBuf};

/// Most files listed in a message.
const MOST_SHOWN: usize = 3;

/// A file-name pattern with `*` and numbers.
#[derive(Debug, PartialEq)]
enum Pattern {
    /// With `*` for any text and `?` for any one character.
    Wild(Vec<char>),
    /// Text before a number, the number's least digits, and text after it.
    Numbered { before: String, digits: usize, after: String },
}

/// Lists the files that match a pattern, or where none does the folders of Zarr, in no order; `None` if the path is no pattern, or an existing file.
///
/// # Errors
/// If no file matches, the pattern is malformed, or its folder cannot be read.
pub(crate) fn expand(path: &Path) -> Result<Option<Vec<PathBuf>>> {
    let Some(name) = path.file_name().and_then(|name| name.to_str()) else { return Ok(None) };
    if path.symlink_metadata().is_ok() {
        return Ok(None);
    }
    let Some(pattern) = Pattern::of(name).map_err(|problem| ImportError::options(path, problem))? else {
        return Ok(None);
    };
    let parent = path.parent().filter(|parent| !parent.as_os_str().is_empty());
    let folder = parent.unwrap_or(Path::new("."));
    let (mut found, mut stores, mut others) = (Vec::new(), Vec::new(), Vec::new());
    for entry in std::fs::read_dir(folder).map_err(ImportError::io(folder))? {
        let name = entry.map_err(ImportError::io(folder))?.file_name();
        let file = parent.map_or_else(|| PathBuf::from(&name), |parent| parent.join(&name));
        let name = name.to_string_lossy();
        // As in a shell, hidden files need an explicit dot.
        let is_meant = pattern.fits(&name) && (!name.starts_with('.') || pattern.is_hidden());
        if is_meant && is_file(&file)? {
            found.push(file);
        } else if is_meant && zarr::is_zarr(&file) {
            stores.push(file);
        } else if !name.starts_with('.') {
            others.push(name.into_owned());
        }
    }
    // Beside files, a folder is some other program's output, or this one's.
    let found = if found.is_empty() { stores } else { found };
    match found.is_empty() {
        true => Err(ImportError::options(path, nothing_fits(folder, path, others))),
        false => Ok(Some(found)),
    }
}

/// Describes a folder without matching files, those with the same extension first.
fn nothing_fits(folder: &Path, pattern: &Path, mut others: Vec<String>) -> String {
    others.sort_by_key(|name| (Path::new(name).extension() != pattern.extension(), name.clone()));
    let more = if others.len() > MOST_SHOWN { ", ..." } else { "" };
    let there = match others.is_empty() {
        true => "nothing".into(),
        false => format!("{}{more}", others[..others.len().min(MOST_SHOWN)].join(", ")),
    };
    format!("no file matches this pattern: {} holds {there}", folder.display())
}

impl Pattern {
    /// Parses a name; `None` if it is plain.
    fn of(name: &str) -> Result<Option<Self>, String> {
        let numbered = numbered(name)?;
        let is_wild = name.contains(['*', '?']);
        match (numbered, is_wild) {
            (Some(_), true) => Err("is a pattern of two kinds: use either * and ?, or one number as %04d".into()),
            (None, true) => Ok(Some(Self::Wild(name.chars().collect()))),
            (numbered, false) => Ok(numbered),
        }
    }

    /// Whether the pattern matches hidden files.
    fn is_hidden(&self) -> bool {
        match self {
            Self::Wild(pattern) => pattern.first() == Some(&'.'),
            Self::Numbered { before, .. } => before.starts_with('.'),
        }
    }

    fn fits(&self, name: &str) -> bool {
        match self {
            Self::Wild(pattern) => is_like(pattern, &name.chars().collect::<Vec<_>>()),
            Self::Numbered { before, digits, after } => {
                let number = name.strip_prefix(&**before).and_then(|rest| rest.strip_suffix(&**after));
                number.is_some_and(|number| {
                    // Longer numbers have no leading zeros, as in printf.
                    let is_written = number.len() == *digits || number.len() > *digits && !number.starts_with('0');
                    is_written && number.bytes().all(|byte| byte.is_ascii_digit())
                })
            }
        }
    }
}

/// Parses the one number in a name, as printf has it: `%d`, `%04d`; `%4d` is refused, and `%%` is a percent sign.
fn numbered(name: &str) -> Result<Option<Pattern>, String> {
    // Text since the counter, if one was found, and else from the start on.
    let (mut before, mut text, mut digits) = (String::new(), String::new(), None);
    let mut rest = name;
    while let Some((plain, after)) = rest.split_once('%') {
        text += plain;
        if let Some(after) = after.strip_prefix('%') {
            text.push('%');
            rest = after;
            continue;
        }
        let end = after.bytes().take_while(u8::is_ascii_digit).count();
        let (width, after) = after.split_at(end);
        let Some(after) = after.strip_prefix('d').or_else(|| after.strip_prefix('u')) else {
            // A literal percent sign.
            text += &format!("%{width}");
            rest = after;
            continue;
        };
        if digits.is_some() {
            return Err("holds two counters: expected one, for the time step".into());
        }
        let least = match (width.strip_prefix('0'), width.is_empty()) {
            (Some(width), _) => width.parse::<usize>().ok().filter(|width| (1..=18).contains(width)),
            (None, true) => Some(1),
            (None, false) => None,
        };
        digits =
            Some(least.ok_or_else(|| format!("%{width}d: expected %d, or %01d to %018d with a number of digits"))?);
        before = std::mem::take(&mut text);
        rest = after;
    }
    text += rest;
    Ok(digits.map(|digits| Pattern::Numbered { before, digits, after: text }))
}

/// Whether a name matches a pattern of `*` and `?`. Each star takes as little as possible, and more only after a mismatch.
fn is_like(pattern: &[char], name: &[char]) -> bool {
    let (mut p, mut n) = (0, 0);
    // The last star's index, and where its match ends.
    let mut star: Option<(usize, usize)> = None;
    while n < name.len() {
        match pattern.get(p) {
            Some('*') => {
                star = Some((p, n));
                p += 1;
            }
            Some(c) if *c == '?' || *c == name[n] => (p, n) = (p + 1, n + 1),
            _ => {
                let Some((at, taken)) = star else { return false };
                star = Some((at, taken + 1));
                (p, n) = (at + 1, taken + 1);
            }
        }
    }
    pattern[p..].iter().all(|c| *c == '*')
}

#[cfg(test)]
mod tests {
    use super::*;

    fn fits(pattern: &str, name: &str) -> bool {
        Pattern::of(pattern).unwrap().unwrap().fits(name)
    }

    #[test]
    fn names_fit_as_in_a_shell_or_as_printf_writes_them() {
        for (pattern, name) in [
            ("step_*.npy", "step_1.npy"),
            ("step_*.npy", "step_.npy"),
            ("*", "a"),
            ("a*b*c", "abxbc"),
            ("a*", "a"),
            ("s??.raw", "s07.raw"),
            ("ä?*.x", "äöü.x"),
            ("s_%04d.raw", "s_0007.raw"),
            ("s_%04d.raw", "s_12345.raw"),
            ("s_%d.raw", "s_0.raw"),
            ("s_%d.raw", "s_12.raw"),
            ("100%%_%02d", "100%_07"),
        ] {
            assert!(fits(pattern, name), "{pattern} {name}");
        }
        for (pattern, name) in [
            ("step_*.npy", "step_1.npz"),
            ("step_*.npy", "xstep_1.npy"),
            ("a*b*c", "abxb"),
            ("s??.raw", "s7.raw"),
            ("s??.raw", "s007.raw"),
            ("s_%04d.raw", "s_007.raw"),
            ("s_%04d.raw", "s_00007.raw"),
            ("s_%04d.raw", "s_00a7.raw"),
            ("s_%d.raw", "s_07.raw"),
            ("s_%d.raw", "s_.raw"),
            ("aa%da", "aa"),
        ] {
            assert!(!fits(pattern, name), "{pattern} {name}");
        }
    }

    #[test]
    fn plain_names_are_no_patterns_and_odd_ones_are_refused() {
        for plain in ["a.npy", "100%.raw", "50%x", "%%d"] {
            assert_eq!(Pattern::of(plain), Ok(None), "{plain}");
        }
        assert!(Pattern::of("s_%d_%d.raw").unwrap_err().contains("two counters"));
        assert!(Pattern::of("s_%4d.raw").unwrap_err().contains("%4d: expected %d"));
        assert!(Pattern::of("s_%d_*.raw").unwrap_err().contains("two kinds"));
    }

    #[test]
    fn files_of_a_folder_are_found() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["s_1.npy", "s_2.npy", "t.npy", ".s_3.npy"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        std::fs::create_dir(folder.path().join("s_9.npy")).unwrap();
        let found = |pattern: &str| {
            let mut names = expand(&folder.path().join(pattern)).unwrap().unwrap();
            names.sort();
            names.iter().map(|path| path.file_name().unwrap().to_str().unwrap().to_owned()).collect::<Vec<_>>()
        };
        assert_eq!(found("s_*.npy"), ["s_1.npy", "s_2.npy"]);
        assert_eq!(found("*.npy"), ["s_1.npy", "s_2.npy", "t.npy"]);
        assert_eq!(found(".s_*"), [".s_3.npy"]);
        let message = expand(&folder.path().join("x_*.npy")).unwrap_err().to_string();
        assert!(
            message.contains("no file matches") && message.contains("holds s_1.npy, s_2.npy, s_9.npy, ..."),
            "{message}"
        );
        assert!(expand(&folder.path().join("no/x_*.npy")).unwrap_err().to_string().contains("No such file"));
        // An existing file is no pattern, whatever its name.
        std::fs::write(folder.path().join("odd*.npy"), "").unwrap();
        assert_eq!(expand(&folder.path().join("odd*.npy")).unwrap(), None);
    }
}
