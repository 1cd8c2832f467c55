//! The choice of one array of a file with several: lists of them in messages.

use crate::error::ImportError;
use crate::files::name_of;
use brickyard_volume::counted;
use std::path::Path;

/// Most arrays listed in a message.
const MOST_SHOWN: usize = 30;

/// An array of a file, for messages.
pub(crate) struct Listed {
    /// Path or name in the file.
    pub(crate) path: String,
    pub(crate) shape: Vec<u64>,
    /// The type of its elements, in words.
    pub(crate) element: String,
}

impl Listed {
    pub(crate) fn describe(&self) -> String {
        let sizes: Vec<String> = self.shape.iter().map(u64::to_string).collect();
        let axes = if sizes.is_empty() { "one element".into() } else { sizes.join(" x ") };
        format!("{} ({axes}, {})", self.path, self.element)
    }
}

/// A path's last part.
pub(crate) fn last_of(path: &str) -> &str {
    path.rsplit('/').next().unwrap_or(path)
}

/// Whether a shape can be a volume's: 2 to 5 axes, none empty, at least two of them longer than 1.
pub(crate) fn is_shape_of_volume(shape: &[u64]) -> bool {
    (2..=5).contains(&shape.len()) && !shape.contains(&0) && shape.iter().filter(|size| **size > 1).count() >= 2
}

/// Paths, shapes and types of arrays.
pub(crate) fn listed(arrays: &[Listed]) -> String {
    let shown: Vec<String> = arrays.iter().take(MOST_SHOWN).map(Listed::describe).collect();
    let more = arrays.len().saturating_sub(MOST_SHOWN);
    match (shown.len(), more) {
        (0, _) => "none".into(),
        (_, 0) => shown.join(", "),
        _ => format!("{}, and {more} more", shown.join(", ")),
    }
}

/// The error about a name that no array bears. `rest` ends the list.
pub(crate) fn no_such(file: &Path, name: &str, mut arrays: Vec<Listed>, rest: &str) -> ImportError {
    let wanted = last_of(name.trim_matches('/')).to_lowercase();
    let is_near = |array: &Listed| {
        let found = last_of(&array.path).to_lowercase();
        found.contains(&wanted) || wanted.contains(&found)
    };
    let mut which = "are";
    if arrays.iter().any(is_near) {
        arrays.retain(is_near);
        which = "of like names are";
    }
    let problem = format!("`variable` {name}: no such dataset; datasets {which} {}{rest}", listed(&arrays));
    ImportError::options(file, problem)
}

/// The error about a name that several arrays bear.
pub(crate) fn ambiguous(file: &Path, name: &str, arrays: &[Listed]) -> ImportError {
    let problem = format!(
        "`variable` {name}: is the name of {}; name one by its whole path, as in {}",
        counted(arrays.len() as u64, "dataset"),
        with_paths(file, arrays)
    );
    ImportError::options(file, problem)
}

/// The error about a file of several volumes.
pub(crate) fn several(file: &Path, volumes: &[Listed], rest: &str) -> ImportError {
    let problem = format!(
        "holds {}; name one with `variable`, or in the path as {}{rest}",
        counted(volumes.len() as u64, "dataset"),
        with_paths(file, volumes)
    );
    ImportError::options(file, problem)
}

/// The file with the path of the first array, as an example, and all arrays.
fn with_paths(file: &Path, arrays: &[Listed]) -> String {
    let first = arrays.first().map_or("name", |first| &first.path);
    format!("{}::{first}: {}", name_of(file), listed(arrays))
}

/// The error about a file without a volume.
pub(crate) fn none(file: &Path, arrays: &[Listed], rest: &str) -> ImportError {
    let list = listed(arrays);
    ImportError::invalid(file, format!("holds no dataset of numbers along 2 to 5 axes; there are: {list}{rest}"))
}
