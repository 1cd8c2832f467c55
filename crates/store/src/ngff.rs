//! The versions of OME-Zarr (by the specification's name, NGFF) of a store's root document.
//!
//! All code thinks in 0.5, whose form [`Root`] gives to a document of either version; only writing gives it its own one
//! again. The two differ in `attributes.ome` (`ngff/multiscale.rs`); `attributes.brickyard`, its checksum included, is
//! of the form of 0.5 in both. An orientation is a coordinate system more in 0.6 (`ngff/patient.rs`), made anew by each
//! writing. Costs nothing beside the document itself.

mod multiscale;
mod patient;
#[cfg(test)]
mod tests;

use crate::error::OpenError;
use crate::folder::Folder;
use crate::json::parse_json;
use crate::metadata::{check_own, document_bytes};
use multiscale::Strange;
use patient::Patient;
use serde_json::{Value, json};
use std::path::Path;
use std::str::FromStr;

/// A version of OME-Zarr for stores.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Ngff {
    /// 0.5: read by most programs.
    #[default]
    V05,
    /// 0.6: named coordinate systems, with a patient's.
    V06,
}

impl Ngff {
    /// All versions.
    pub const ALL: [Self; 2] = [Self::V05, Self::V06];

    /// The version's number.
    pub const fn name(self) -> &'static str {
        match self {
            Self::V05 => "0.5",
            Self::V06 => "0.6",
        }
    }

    /// The version of a group's document; `None` if it is another one.
    pub(crate) fn of(document: &Value) -> Option<Self> {
        let version = &document["attributes"]["ome"]["version"];
        Self::ALL.into_iter().find(|known| *version == known.name())
    }
}

impl std::fmt::Display for Ngff {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for Ngff {
    type Err = String;

    fn from_str(name: &str) -> Result<Self, String> {
        let known = || format!("unknown version '{name}' of a store's OME-Zarr: expected 0.5 or 0.6");
        Self::ALL.into_iter().find(|version| version.name() == name).ok_or_else(known)
    }
}

/// A store's root document in the form of 0.5, and the version in which it is kept.
#[derive(Clone, Debug)]
pub(crate) struct Root {
    pub(crate) document: Value,
    pub(crate) ngff: Ngff,
    /// The patient's system as found.
    patient: Option<Value>,
}

impl Root {
    /// A new document, of the form of 0.5, to be kept in a version.
    pub(crate) fn new(document: Value, ngff: Ngff) -> Self {
        Self { document, ngff, patient: None }
    }

    /// Reads the document in a store's folder.
    ///
    /// # Errors
    /// If it is unreadable, or says something of a level's place which is not known here.
    pub(crate) fn read(folder: &Folder, path: &Path) -> Result<Self, OpenError> {
        Self::parse(path, &folder.document(path)?)
    }

    /// Parses the document read from `path`.
    ///
    /// # Errors
    /// As for [`Root::read`].
    pub(crate) fn parse(path: &Path, text: &[u8]) -> Result<Self, OpenError> {
        let found = parse_json(path, text)?;
        // Another program's may say what a conversion refuses.
        check_own(path, &found)?;
        match Ngff::of(&found) {
            Some(ngff @ Ngff::V06) => {
                let document = in_version(path, &found, Ngff::V05)?;
                Ok(Self { document, ngff, patient: Some(patient::found(&found)) })
            }
            // Other versions are refused for what they lack.
            _ => Ok(Self::new(found, Ngff::V05)),
        }
    }

    /// The file content, in the document's own version.
    ///
    /// # Errors
    /// If the version cannot say what is in the document. `path` is the document's, for the message.
    pub(crate) fn bytes(&self, path: &Path) -> Result<Vec<u8>, OpenError> {
        Ok(document_bytes(&in_version(path, &self.document, self.ngff)?))
    }

    /// The first change of the patient's system as found, since it was written; `None` if there is none.
    pub(crate) fn patient_change(&self, path: &Path) -> Option<String> {
        let expected = match Patient::of(path, &self.document) {
            Ok(patient) => patient?.document(axes_of(&self.document)),
            Err(error) => return Some(error.to_string()),
        };
        patient::difference(&expected, self.patient.as_ref()?)
    }
}

fn axes_of(document: &Value) -> &Value {
    &document["attributes"]["ome"]["multiscales"][0]["axes"]
}

/// A group's document in another version; the same if it has this one.
///
/// # Errors
/// If it is of neither version, or says of a level's place what the other version cannot.
pub(crate) fn in_version(path: &Path, document: &Value, ngff: Ngff) -> Result<Value, OpenError> {
    if Ngff::of(document) == Some(ngff) {
        return Ok(document.clone());
    }
    let patient = Patient::of(path, document);
    let patient = if ngff == Ngff::V06 { patient? } else { None };
    let ours = &document["attributes"]["brickyard"];
    let has_patient = !ours["orientation"].is_null();
    let mut new = document.clone();
    let Some(ome) = new.pointer_mut("/attributes/ome").and_then(Value::as_object_mut) else { return Ok(new) };
    for (i, multiscale) in ome.get_mut("multiscales").and_then(Value::as_array_mut).into_iter().flatten().enumerate() {
        let is_ours = i == 0 && !ours.is_null();
        let converted = match ngff {
            Ngff::V05 => multiscale::to_0_5(multiscale, is_ours, is_ours && has_patient),
            Ngff::V06 => multiscale::to_0_6(multiscale, patient.as_ref().filter(|_| is_ours)),
        };
        *multiscale = converted.map_err(|Strange { field, expected, found }| {
            OpenError::invalid(path, format!("attributes.ome.multiscales[{i}].{field}"), expected, found)
        })?;
    }
    ome.insert("version".into(), json!(ngff.name()));
    Ok(new)
}

/// A group's document in another version, with the copies of other groups' documents gathered in it
/// (`consolidated_metadata`).
///
/// # Errors
/// As for [`in_version`].
pub(crate) fn gathered_in_version(path: &Path, document: &Value, ngff: Ngff) -> Result<Value, OpenError> {
    let mut new = in_version(path, document, ngff)?;
    let copies = new.pointer_mut("/consolidated_metadata/metadata").and_then(Value::as_object_mut);
    for copy in copies.into_iter().flat_map(|copies| copies.values_mut()).filter(|copy| Ngff::of(copy).is_some()) {
        *copy = in_version(path, copy, ngff)?;
    }
    Ok(new)
}
