//! ParaView's collections (`.pvd`): files of images with the time of each, as a list in ascending time. Memory grows with
//! the number of files by their paths.

use super::tags::{Failure, Kind, Tag, Tags, shown};
use crate::error::{ImportError, Result};
use crate::files::folder_of;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

/// A file of a collection.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Step {
    pub(super) time: Option<f64>,
    pub(super) path: PathBuf,
}

/// Reads a collection: its files in ascending time.
pub(super) fn read(path: &Path) -> Result<Vec<Step>> {
    let file = File::open(path).map_err(ImportError::io(path))?;
    let mut tags = Tags::new(BufReader::new(file));
    let (mut steps, mut is_whole) = (Vec::new(), false);
    while let Some(tag) = tags.next().map_err(|failure| failure.of(path))? {
        match (&*tag.name, tag.kind) {
            ("VTKFile", Kind::End) => is_whole = true,
            ("DataSet", Kind::Start | Kind::Empty) => steps.push(step(&tag, path)?),
            _ => {}
        }
    }
    if !is_whole {
        return Err(ImportError::invalid(path, "cut short: </VTKFile> is missing; fetch the file again"));
    }
    steps.sort_by(|a, b| a.time.unwrap_or_default().total_cmp(&b.time.unwrap_or_default()));
    if steps.is_empty() {
        return Err(ImportError::invalid(path, "a collection without files: no <DataSet> in it"));
    }
    if let Some([one, two]) =
        steps.array_windows().find(|[one, two]| one.time.unwrap_or_default() == two.time.unwrap_or_default())
    {
        let [time, one, two] = [one.time.unwrap_or_default().to_string(), name(one), name(two)];
        let problem =
            format!("names {one} and {two} for one time, {time}: keep one of the two, or pack the .vti files");
        return Err(ImportError::invalid(path, problem));
    }
    Ok(steps)
}

fn name(step: &Step) -> String {
    step.path.display().to_string()
}

fn step(tag: &Tag, path: &Path) -> Result<Step> {
    let invalid = |failure: Failure| failure.of(path);
    let time: Option<f64> = tag.number("timestep").map_err(invalid)?;
    if time.is_some_and(|time| !time.is_finite()) {
        return Err(ImportError::invalid(path, "has a timestep that is no finite number"));
    }
    // The parts of a set are pieces of one step.
    if tag.number::<i64>("part").map_err(invalid)?.is_some_and(|part| part != 0) {
        let advice = "write each step as one .vti file, as ParaView does with Merge Blocks";
        return Err(ImportError::unsupported_but(path, "a collection whose steps have a part above 0", advice));
    }
    let Some(file) = tag.attribute("file").filter(|file| !file.is_empty()) else {
        return Err(ImportError::invalid(path, "has a <DataSet> without a file"));
    };
    if file.contains('\0') {
        return Err(ImportError::invalid(path, format!("has a <DataSet> of the file '{}'", shown(file))));
    }
    // Paths from Windows.
    let portable = file.replace('\\', "/");
    let candidates = [folder_of(path).join(file), folder_of(path).join(portable)];
    let [as_is, other] = candidates;
    let path = if !as_is.exists() && other.exists() { other } else { as_is };
    Ok(Step { time, path })
}
