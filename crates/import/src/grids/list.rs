//! The text of a list of grids: JSON with the files, each in the fields of the text beside a raw file, and a value for no data. Costs the text.

use crate::error::{ImportError, Result};
use crate::files::{first_bytes, folder_of, name_of};
use crate::options::{HeldAs, NoData, OpenOptions};
use crate::pipe::is_pipe;
use crate::raw_text::{Fields, is_text, mistake};
use crate::sidecar::text_of;
use crate::source::Source;
use crate::stamp::Stamp;
use serde::de::{Error, IgnoredAny, SeqAccess, Visitor};
use serde::{Deserialize, Deserializer};
use std::path::{Path, PathBuf};

/// Most grids of a list: all are open at once.
const MOST_GRIDS: usize = 1024;

/// The text in words.
const LIST: &str = "list of grids";

/// Bytes in which a text of JSON begins.
const START_BYTES: usize = 64;

/// A list, and its state when it was read.
pub(crate) struct GridList {
    pub(crate) path: PathBuf,
    pub(super) nodata: Option<f64>,
    pub(crate) entries: Vec<Entry>,
    stamp: Stamp,
}

/// A grid as the list names it.
pub(crate) struct Entry {
    fields: Fields,
    /// The grid's name: its file as listed.
    pub(super) name: String,
    /// The grid's file or files, maybe with an array's name.
    pub(crate) input: PathBuf,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Text {
    #[serde(deserialize_with = "at_most")]
    grids: Vec<Fields>,
    nodata: Option<f64>,
}

/// Whether a file is such a list: JSON by its name, with `grids` in it.
///
/// # Errors
/// If it cannot be read.
pub(crate) fn is_list(path: &Path) -> Result<bool> {
    #[derive(Deserialize)]
    struct Keys {
        grids: Option<IgnoredAny>,
    }
    let name = name_of(path).to_ascii_lowercase();
    // A pipe can be read once only.
    if !path.is_file() || !is_text(&name, &first_bytes(path, START_BYTES)?) {
        return Ok(false);
    }
    let text = text_of(path, "description of raw files or grids")?;
    Ok(match serde_json::from_str::<Keys>(&text) {
        Ok(keys) => keys.grids.is_some(),
        Err(_) => text.contains("\"grids\""),
    })
}

impl GridList {
    /// Reads a list.
    ///
    /// # Errors
    /// If the text is none, or names no file.
    pub(crate) fn read(path: &Path) -> Result<Self> {
        let stamp = Stamp::of(path)?;
        let text = text_of(path, LIST)?;
        let Text { grids, nodata } = serde_json::from_str(&text).map_err(|error| mistake(path, LIST, &error, ""))?;
        if grids.is_empty() {
            return Err(ImportError::invalid(path, "lists no grid: name a file for each"));
        }
        let entry = |(number, fields)| Entry::new(path, number, fields);
        let entries = (1..).zip(grids).map(entry).collect::<Result<_>>()?;
        Ok(Self { path: path.to_owned(), nodata, entries, stamp })
    }

    /// Checks that the text is still the one read.
    pub(crate) fn check(&self) -> Result<()> {
        self.stamp.check(&self.path)
    }

    /// The options that open an entry: its own, and of the caller's those which hold for every grid. The result's place, unit, times and
    /// part are the caller's later.
    pub(crate) fn options(&self, entry: &Entry, caller: &OpenOptions) -> Result<OpenOptions> {
        let own = entry.fields.options(&self.path)?;
        let nodata = match (caller.nodata, entry.fields.nodata) {
            (NoData::OfFile, Some(value)) => NoData::Value(value),
            (said, _) => said,
        };
        Ok(OpenOptions {
            variable: caller.variable.clone(),
            is_step: caller.is_step,
            order: caller.order,
            gaps: caller.gaps,
            // Grids have places of their own.
            held_as: caller.held_as.map(|held| HeldAs { turned: [false; 3], ..held }),
            to_voxel_type: caller.to_voxel_type,
            nodata,
            allow_lossy: caller.allow_lossy,
            are_labels: caller.are_labels,
            is_looked_at: caller.is_looked_at,
            scratch_dir: caller.scratch_dir.clone(),
            ..own
        })
    }
}

impl Entry {
    fn new(list: &Path, number: usize, fields: Fields) -> Result<Self> {
        let Some(file) = &fields.file else {
            let problem = format!("grid {number} has no \"file\": write the name of its file into the list");
            return Err(ImportError::invalid(list, problem));
        };
        if let Some(field) = fields.of_whole() {
            let problem = format!(
                "grid {number}, {}, has \"{field}\", which is for a whole volume: leave it out",
                file.display()
            );
            return Err(ImportError::invalid(list, problem));
        }
        let input = folder_of(list).join(file);
        if is_pipe(&input) {
            let problem = format!("grid {number}, {}, is a pipe: write it to a file first", input.display());
            return Err(ImportError::invalid(list, problem));
        }
        Ok(Self { name: file.display().to_string(), fields, input })
    }

    /// Gives the grid's channels the names in the list, if it has any.
    pub(super) fn named(&self, list: &Path, source: Box<dyn Source>) -> Result<Box<dyn Source>> {
        if self.fields.channel_names.is_none() {
            return Ok(source);
        }
        let mut info = source.info().clone();
        let named = self.fields.looks(list, info.channels)?;
        info.looks_of_all().iter_mut().zip(named).for_each(|(look, named)| look.name = named.name);
        Ok(Box::new(crate::described::Described { info, source, first: 0 }))
    }
}

/// Reads grids up to [`MOST_GRIDS`]: a short text could fill the memory with empty ones.
fn at_most<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<Fields>, D::Error> {
    struct Some;
    impl<'de> Visitor<'de> for Some {
        type Value = Vec<Fields>;

        fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            f.write_str("a list of grids, as in [{\"file\": \"coarse.nc::/T\"}, {\"file\": \"fine.nc::/T\"}]")
        }

        fn visit_seq<A: SeqAccess<'de>>(self, mut grids: A) -> Result<Vec<Fields>, A::Error> {
            let mut all = Vec::new();
            loop {
                // Lists written by programs are one line.
                let of_grid = |error| A::Error::custom(format!("grid {}: {error}", all.len() + 1));
                let Option::Some(fields) = grids.next_element().map_err(of_grid)? else { return Ok(all) };
                if all.len() == MOST_GRIDS {
                    return Err(A::Error::custom(format!(
                        "{MOST_GRIDS} grids are the most of a list: join patches first"
                    )));
                }
                all.push(fields);
            }
        }
    }
    deserializer.deserialize_seq(Some)
}
