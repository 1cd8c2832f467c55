//! The documents behind a source's description, and their state when it was opened. Costs a look at each file.

use super::array::Array;
use super::document::Document;
use super::field::attributes_file;
use super::node::{Group, ZarrVersion};
use crate::axes::Axis;
use crate::error::Result;
use crate::raw::identity;
use crate::stamp::Stamp;
use std::path::PathBuf;

/// Files, and their sizes and times.
pub(super) struct Documents {
    files: Vec<(PathBuf, Stamp)>,
}

impl Documents {
    /// The documents of an array, and of the group of its image.
    ///
    /// # Errors
    /// If one cannot be looked at.
    pub(super) fn of(group: Option<&Group>, array: &Array) -> Result<Self> {
        let of_group = group.map(|group| attributes_file(group.path(), group.version()));
        let own: &[&str] = match array.version() {
            ZarrVersion::V3 => &["zarr.json"],
            ZarrVersion::V2 => &[".zarray", ".zattrs"],
        };
        let paths = of_group.into_iter().chain(own.iter().map(|name| array.path().join(name)));
        let files = paths.filter(|path| Document::is_there(path)).map(|path| Ok((path.clone(), Stamp::of(&path)?)));
        Ok(Self { files: files.collect::<Result<_>>()? })
    }

    /// The identity of an array read with these letters.
    ///
    /// # Errors
    /// As for [`Documents::of`].
    pub(super) fn identity(&self, letters: &[Option<Axis>]) -> Result<String> {
        let letters: String = letters.iter().map(|axis| axis.map_or('-', Axis::letter)).collect();
        let paths: Vec<&PathBuf> = self.files.iter().map(|(path, _)| path).collect();
        identity(&format!("zarr {letters}"), &paths)
    }

    /// Checks that they are as they were.
    ///
    /// # Errors
    /// If one is not.
    pub(super) fn check(&self) -> Result<()> {
        self.files.iter().try_for_each(|(path, stamp)| stamp.check(path))
    }
}
