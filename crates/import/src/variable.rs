//! Names of arrays: in the path of an input, as `file.h5::/entry/data`, and of several that become channels.

use crate::error::{ImportError, Result};
use crate::options::{ArrayPlace, ChannelArray, OpenOptions};
use brickyard_objects::is_address;
use std::path::{Path, PathBuf};

pub(crate) const MARK: &str = "::";

impl ChannelArray {
    /// Reads `NAME=FILE`, a channel's name and its file. The name ends at the first `=`; everything behind is the file's, or the array's within it
    /// (`u=run.h5::/a=b,c`).
    ///
    /// # Errors
    /// If there is no `=`, or nothing before or behind it.
    pub fn of_file(text: &str) -> Result<Self, String> {
        match text.split_once('=').map(|(name, file)| (name.trim(), file)) {
            Some((name, file)) if !name.is_empty() && !file.is_empty() => {
                Ok(Self { name: name.into(), place: ArrayPlace::File(file.into()) })
            }
            _ => Err(format!("'{text}': without an input, expected NAME=FILE, such as density=run.h5::/density")),
        }
    }

    /// Reads names of arrays of the input, each separated by commas from the next. Channels are called as the arrays, without the groups above them
    /// unless two would be alike.
    ///
    /// # Errors
    /// If a name is empty.
    pub fn of_input(texts: &[String]) -> Result<Vec<Self>, String> {
        let arrays: Vec<&str> = texts.iter().flat_map(|text| text.split(',')).map(str::trim).collect();
        if arrays.iter().any(|array| array.trim_matches('/').is_empty()) {
            let text = texts.join(",");
            return Err(format!(
                "'{text}': expected names between the commas; an array with a comma in its name is FILE::NAME"
            ));
        }
        let last = |array: &str| array.trim_end_matches('/').rsplit('/').next().unwrap_or(array).to_owned();
        let mut names: Vec<String> = arrays.iter().map(|array| last(array)).collect();
        names.sort_unstable();
        let are_unlike = names.windows(2).all(|pair| pair[0] != pair[1]);
        let name = |array: &str| if are_unlike { last(array) } else { array.to_owned() };
        let channels =
            arrays.into_iter().map(|array| Self { name: name(array), place: ArrayPlace::Input(array.into()) });
        Ok(channels.collect())
    }

    /// The inputs of the array, and the options that read it alone.
    pub(crate) fn opening(&self, inputs: &[PathBuf], options: &OpenOptions) -> (Vec<PathBuf>, OpenOptions) {
        let alone = OpenOptions { channel_arrays: Vec::new(), component: None, ..options.clone() };
        match &self.place {
            ArrayPlace::Input(array) => (inputs.to_vec(), OpenOptions { variable: Some(array.clone()), ..alone }),
            ArrayPlace::File(file) => (vec![file.clone()], alone),
        }
    }
}

/// Checks which inputs are given beside arrays of their own files: none, or the first of these files, which stands for all.
pub(crate) fn check_inputs(inputs: &[PathBuf], arrays: &[ChannelArray]) -> Result<()> {
    let is_other = |input: &PathBuf| !matches!(arrays.first().map(|first| &first.place), Some(ArrayPlace::File(file)) if file == input);
    let has_files = arrays.iter().any(|array| matches!(array.place, ArrayPlace::File(_)));
    match inputs.iter().find(|input| has_files && (is_other(input) || inputs.len() > 1)) {
        Some(other) => {
            let problem = "an input beside channels with files of their own: name it as one of these, too";
            Err(ImportError::options(other, problem))
        }
        None => Ok(()),
    }
}

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

/// A path without the name of a dataset, and the name, if there is one.
pub(crate) fn split_choice(path: &Path) -> (PathBuf, Option<String>) {
    split(path).map_or_else(|| (path.to_owned(), None), |(path, name)| (path, Some(name)))
}

/// The path and the dataset of an input; `None` without the mark, and for a file that bears it.
fn split(input: &Path) -> Option<(PathBuf, String)> {
    let (path, name) = input.to_str()?.rsplit_once(MARK)?;
    let is_named = !path.is_empty() && !name.trim_matches('/').is_empty();
    (is_named && (is_address(input) || input.symlink_metadata().is_err())).then(|| (path.into(), name.into()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::temp_file;

    fn of_input(texts: &[&str]) -> Result<Vec<(String, String)>, String> {
        let texts: Vec<String> = texts.iter().map(|text| (*text).into()).collect();
        let pair = |array: ChannelArray| match array.place {
            ArrayPlace::Input(place) => (array.name, place),
            ArrayPlace::File(file) => panic!("{}", file.display()),
        };
        ChannelArray::of_input(&texts).map(|arrays| arrays.into_iter().map(pair).collect())
    }

    #[test]
    fn arrays_of_one_input_are_named_as_they_are() {
        let pairs = |pairs: &[[&str; 2]]| Ok(pairs.iter().map(|[a, b]| ((*a).into(), (*b).into())).collect());
        assert_eq!(of_input(&["a,b"]), pairs(&[["a", "a"], ["b", "b"]]));
        assert_eq!(
            of_input(&["/x/u", " v=1 , CellData/w"]),
            pairs(&[["u", "/x/u"], ["v=1", "v=1"], ["w", "CellData/w"]])
        );
        assert_eq!(of_input(&["/x/u,/y/u"]), pairs(&[["/x/u", "/x/u"], ["/y/u", "/y/u"]]));
        for bad in ["a,", ",", "a,,b", "/"] {
            assert!(of_input(&[bad]).unwrap_err().contains("FILE::NAME"), "{bad}");
        }
    }

    #[test]
    fn files_of_channels_may_hold_any_sign() {
        let of = |text| ChannelArray::of_file(text).map(|array| (array.name, array.place));
        let file = |name: &str, path: &str| Ok((name.to_owned(), ArrayPlace::File(path.into())));
        assert_eq!(of("u=run.h5::/a=b,c"), file("u", "run.h5::/a=b,c"));
        assert_eq!(of(" u =a,b.npy"), file("u", "a,b.npy"));
        for bad in ["u", "=a.npy", "u=", ""] {
            assert!(of(bad).unwrap_err().contains("NAME=FILE"), "{bad}");
        }
    }

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
