//! A value of a JSON document with its place, which errors name. Costs a text for each step into the document.

use super::node::{Group, ZarrVersion};
use crate::error::{ImportError, Result};
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};

/// Most letters of a value shown in an error.
const MOST_SHOWN: usize = 60;

/// A value that is not null.
#[derive(Clone)]
pub(super) struct Field<'a> {
    file: &'a Path,
    /// Keys and numbers from the document's root on: `multiscales[0].axes`.
    at: String,
    value: &'a Value,
}

impl<'a> Field<'a> {
    /// A member of an object, called `name` from the document's root on.
    pub(super) fn new(file: &'a Path, at: String, value: &'a Value) -> Self {
        Self { file, at, value }
    }

    /// The file of the document.
    pub(super) fn file(&self) -> &'a Path {
        self.file
    }

    /// Place in the document.
    pub(super) fn at(&self) -> &str {
        &self.at
    }

    /// The member of this name; `None` if there is none, or null.
    pub(super) fn get(&self, name: &str) -> Option<Self> {
        let value = self.value.get(name).filter(|value| !value.is_null())?;
        Some(Self { at: format!("{}.{name}", self.at), value, ..*self })
    }

    /// The member of this name.
    ///
    /// # Errors
    /// If there is none.
    pub(super) fn need(&self, name: &str, expected: &str) -> Result<Self> {
        self.get(name).ok_or_else(|| {
            let problem = format!("{}.{name}: is missing, expected {expected}", self.at);
            ImportError::invalid(self.file, problem)
        })
    }

    /// The items of a list.
    ///
    /// # Errors
    /// If it is none.
    pub(super) fn items(&self, expected: &str) -> Result<Vec<Self>> {
        let items = self.value.as_array().ok_or_else(|| self.invalid(expected))?;
        let item = |(i, value)| Self { at: format!("{}[{i}]", self.at), value, ..*self };
        Ok(items.iter().enumerate().map(item).collect())
    }

    /// The text; `None` if it is another value.
    pub(super) fn as_text(&self) -> Option<&'a str> {
        self.value.as_str()
    }

    /// The members; `None` if it is no object.
    pub(super) fn as_object(&self) -> Option<&'a Map<String, Value>> {
        self.value.as_object()
    }

    pub(super) fn is_list(&self) -> bool {
        self.value.is_array()
    }

    /// The text.
    ///
    /// # Errors
    /// If it is none.
    pub(super) fn text(&self, expected: &str) -> Result<&'a str> {
        self.as_text().ok_or_else(|| self.invalid(expected))
    }

    /// True or false; `None` if it is another value.
    pub(super) fn as_bool(&self) -> Option<bool> {
        self.value.as_bool()
    }

    /// The whole number from 0 on; `None` if it is another value.
    pub(super) fn as_whole(&self) -> Option<u64> {
        self.value.as_u64()
    }

    /// A finite number; `None` if it is another value.
    pub(super) fn as_number(&self) -> Option<f64> {
        self.value.as_f64().filter(|number| number.is_finite())
    }

    /// `count` finite numbers, or any count for `None`.
    ///
    /// # Errors
    /// If it is no list of these.
    pub(super) fn numbers(&self, count: Option<usize>) -> Result<Vec<f64>> {
        let expected = count.map_or("numbers".into(), |count| format!("{count} numbers, one for each axis"));
        let items = self.items(&expected)?;
        let numbers: Option<Vec<f64>> = items.iter().map(Self::as_number).collect();
        numbers
            .filter(|numbers| count.is_none_or(|count| numbers.len() == count))
            .ok_or_else(|| self.invalid(&expected))
    }

    /// The error about a value of another kind.
    pub(super) fn invalid(&self, expected: &str) -> ImportError {
        let mut found = self.value.to_string();
        if let Some((end, _)) = found.char_indices().nth(MOST_SHOWN) {
            found.truncate(end);
            found += "...";
        }
        ImportError::invalid(self.file, format!("{}: expected {expected}, found {found}", self.at))
    }
}

/// The members of a group's OME-Zarr metadata: in `ome` from 0.5 on, beside others before.
pub(super) struct Ome<'a> {
    file: PathBuf,
    start: &'static str,
    members: &'a Map<String, Value>,
}

impl<'a> Ome<'a> {
    pub(super) fn of(group: &'a Group) -> Self {
        let attributes = group.attributes();
        let file = attributes_file(group.path(), group.version());
        let is_new = matches!(group.version(), ZarrVersion::V3);
        match attributes.get("ome").and_then(Value::as_object) {
            Some(members) if is_new => Self { file, start: "attributes.ome.", members },
            Some(members) => Self { file, start: "ome.", members },
            None => Self { file, start: if is_new { "attributes." } else { "" }, members: attributes },
        }
    }

    /// Members of a document at this place, for tests.
    #[cfg(test)]
    pub(super) fn in_test(members: &'a Value) -> Self {
        Self { file: "zarr.json".into(), start: "attributes.ome.", members: members.as_object().unwrap() }
    }

    /// The member of this name; `None` if there is none, or null.
    pub(super) fn get(&self, name: &str) -> Option<Field<'_>> {
        let value = self.members.get(name).filter(|value| !value.is_null())?;
        Some(Field::new(&self.file, format!("{}{name}", self.start), value))
    }
}

/// The file of a node's attributes.
pub(super) fn attributes_file(folder: &Path, version: ZarrVersion) -> PathBuf {
    folder.join(match version {
        ZarrVersion::V2 => ".zattrs",
        ZarrVersion::V3 => "zarr.json",
    })
}
