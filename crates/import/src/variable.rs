//! Datasets named in the path of an input, as `file.h5::/entry/data`.

use crate::error::{ImportError, Result};
use crate::options::OpenOptions;
use std::path::{Path, PathBuf};

const MARK: &str = "::";

/// Separates the name of a dataset from the paths of inputs, into the options. A file of the whole name is that file.
///
/// # Errors
/// If two names differ: several inputs are steps of one dataset.
pub(crate) fn split_variable(inputs: &[PathBuf], options: &OpenOptions) -> Result<(Vec<PathBuf>, OpenOptions)> {
    let mut options = options.clone();
    let mut paths = Vec::with_capacity(inputs.len());
    for input in inputs {
        let Some((path, name)) = split(input) else {
            paths.push(input.clone());
            continue;
        };
        if let Some(other) = options.variable.as_ref().filter(|other| **other != name) {
            let problem = format!("names the dataset {name}, but {other} is named, too; name one with `variable`");
            return Err(ImportError::options(input, problem));
        }
        options.variable = Some(name);
        paths.push(path);
    }
    Ok((paths, options))
}

/// The path and the dataset of an input; `None` without the mark, and for a file that bears it.
fn split(input: &Path) -> Option<(PathBuf, String)> {
    let (path, name) = input.to_str()?.rsplit_once(MARK)?;
    let is_named = !path.is_empty() && !name.trim_matches('/').is_empty();
    (is_named && input.symlink_metadata().is_err()).then(|| (path.into(), name.into()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::temp_file;

    #[test]
    fn names_of_datasets_leave_the_path() {
        let plain = OpenOptions::default();
        let split = |names: &[&str], options: &OpenOptions| {
            let inputs: Vec<PathBuf> = names.iter().map(PathBuf::from).collect();
            split_variable(&inputs, options)
                .map(|(paths, options)| (paths, options.variable))
                .map_err(|e| e.to_string())
        };
        let named = |paths: &[&str], name: Option<&str>| {
            Ok((paths.iter().map(PathBuf::from).collect(), name.map(str::to_owned)))
        };
        assert_eq!(split(&["a.h5::/b/c"], &plain), named(&["a.h5"], Some("/b/c")));
        assert_eq!(split(&["a.h5::b", "c.h5::b"], &plain), named(&["a.h5", "c.h5"], Some("b")));
        for whole in ["a.h5", "a.h5::", "::b", "a.h5::/"] {
            assert_eq!(split(&[whole], &plain), named(&[whole], None));
        }
        assert!(split(&["a.h5::b", "c.h5::d"], &plain).unwrap_err().contains("`variable`"));
        let told = OpenOptions { variable: Some("x".into()), ..plain.clone() };
        assert!(split(&["a.h5::b"], &told).is_err());
        let (_folder, path) = temp_file("a::b", b"1");
        assert_eq!(split_variable(std::slice::from_ref(&path), &plain).unwrap(), (vec![path], plain));
    }
}
