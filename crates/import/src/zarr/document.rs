//! JSON documents of Zarr nodes, read up to a limit, and their fields. A message names the file and the place in it.

use crate::error::{ImportError, Result};
use crate::stamp::Stamp;
use brickyard_objects::{Object, Version, at};
use serde::de::{Deserializer, IgnoredAny, MapAccess, Visitor};
use serde_json::{Map, Value};
use std::fs::File;
use std::io::{ErrorKind, Read};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Most bytes of a document: ten times the consolidated metadata of a plate of a thousand images.
const MOST_BYTES: u64 = 32 << 20;

/// Copies of all documents below a group: see `gathered.rs`.
pub(super) const CONSOLIDATED: &str = "consolidated_metadata";

/// Most characters of a value in a message.
const MOST_SHOWN: usize = 60;

/// A document, and the state of its file before it was read.
pub(super) struct Document {
    pub(super) path: PathBuf,
    pub(super) fields: Map<String, Value>,
    pub(super) stamp: Stamp,
}

impl Document {
    /// Reads a document; `None` if there is no such file.
    pub(super) fn read(path: PathBuf) -> Result<Option<Self>> {
        if let Some(place) = at(&path).map_err(ImportError::io(&path))? {
            let object = place.document(MOST_BYTES).map_err(ImportError::io(&path))?;
            return object.map(|object| Self::parsed(path, &object.bytes, Stamp::NONE)).transpose();
        }
        // Looked at first: a pipe of that name would wait for its writer.
        let metadata = match std::fs::metadata(&path) {
            Ok(metadata) if metadata.is_file() => metadata,
            Ok(_) => return Ok(None),
            Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => return Ok(None),
            Err(error) => return Err(ImportError::io(&path)(error)),
        };
        let file = File::open(&path).map_err(ImportError::io(&path))?;
        let mut bytes = Vec::new();
        file.take(MOST_BYTES + 1).read_to_end(&mut bytes).map_err(ImportError::io(&path))?;
        if bytes.len() as u64 > MOST_BYTES {
            return Err(ImportError::unsupported(&path, format!("a document of more than {} MiB", MOST_BYTES >> 20)));
        }
        Self::parsed(path, &bytes, Stamp::in_metadata(&metadata)).map(Some)
    }

    fn parsed(path: PathBuf, bytes: &[u8], stamp: Stamp) -> Result<Self> {
        let fields = parse(bytes).map_err(|error| {
            let problem = format!("damaged: this document of Zarr is no JSON object: {error}; fetch or write it again");
            ImportError::invalid(&path, problem)
        })?;
        Ok(Self { path, fields, stamp })
    }

    /// Whether a document is there. One at an address that cannot be looked at is none.
    pub(super) fn is_there(path: &Path) -> bool {
        match at(path) {
            Ok(Some(place)) => place.document(MOST_BYTES).is_ok_and(|document| document.is_some()),
            _ => path.is_file(),
        }
    }

    /// The text of a document at an address, and its state; `None` of others, and without one.
    pub(super) fn object(path: &Path) -> Option<Arc<Object>> {
        at(path).ok()??.document(MOST_BYTES).ok()?
    }

    /// Takes a document at an address as read, absent without text, in the state of the one that tells of it.
    pub(super) fn know(path: &Path, text: Option<Vec<u8>>, teller: &Version) {
        if let Ok(Some(place)) = at(path) {
            place.know(text, teller);
        }
    }

    /// Reads documents in a folder at an address all at once, ahead of [`Document::read`].
    pub(super) fn look_ahead(folder: &Path, names: &[String]) {
        if let Ok(Some(place)) = at(folder) {
            place.look_ahead(names, MOST_BYTES);
        }
    }

    /// The document's outermost fields.
    pub(super) fn root(&self) -> Fields<'_> {
        Fields { path: &self.path, place: String::new(), map: Some(&self.fields) }
    }

    /// The node's attributes in a field of the document.
    pub(super) fn take_attributes(&mut self) -> Result<Map<String, Value>> {
        match self.fields.remove("attributes") {
            None | Some(Value::Null) => Ok(Map::new()),
            Some(Value::Object(attributes)) => Ok(attributes),
            Some(other) => Err(self.root().damaged("attributes", "an object", &other)),
        }
    }
}

/// Parses an object, without consolidated metadata. Bare `NaN` and `Infinity`, as Python writes them, become texts.
fn parse(bytes: &[u8]) -> serde_json::Result<Map<String, Value>> {
    let parsed = |bytes: &[u8]| {
        let mut json = serde_json::Deserializer::from_slice(bytes);
        let fields = json.deserialize_map(Outermost)?;
        json.end().map(|()| fields)
    };
    parsed(bytes).or_else(|error| parsed(&quoted(bytes)).map_err(|_| error))
}

/// The fields of an object but one.
struct Outermost;

impl<'de> Visitor<'de> for Outermost {
    type Value = Map<String, Value>;

    fn expecting(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        formatter.write_str("an object")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut access: A) -> Result<Self::Value, A::Error> {
        let mut fields = Map::new();
        while let Some(key) = access.next_key::<String>()? {
            if key == CONSOLIDATED {
                access.next_value::<IgnoredAny>()?;
            } else {
                fields.insert(key, access.next_value()?);
            }
        }
        Ok(fields)
    }
}

/// Puts bare words for numbers, outside of texts, in quotes.
fn quoted(bytes: &[u8]) -> Vec<u8> {
    const WORDS: [&[u8]; 3] = [b"-Infinity", b"Infinity", b"NaN"];
    let (mut quoted, mut rest, mut in_text) = (Vec::with_capacity(bytes.len() + 64), bytes, false);
    while let Some((&byte, after)) = rest.split_first() {
        if in_text && byte == b'\\' {
            let (pair, after) = rest.split_at(rest.len().min(2));
            quoted.extend_from_slice(pair);
            rest = after;
        } else if let Some(word) = WORDS.iter().find(|word| !in_text && rest.starts_with(word)) {
            quoted.extend([b"\"", *word, b"\""].concat());
            rest = &rest[word.len()..];
        } else {
            in_text ^= byte == b'"';
            quoted.push(byte);
            rest = after;
        }
    }
    quoted
}

/// Fields of an object in a document.
#[derive(Clone)]
pub(super) struct Fields<'a> {
    path: &'a Path,
    /// The object's place in the document, with a dot behind it; empty for the outermost.
    place: String,
    /// `None` for an object left out.
    map: Option<&'a Map<String, Value>>,
}

/// A name, and its settings.
pub(super) struct Named<'a> {
    pub(super) name: &'a str,
    pub(super) settings: Fields<'a>,
}

impl<'a> Fields<'a> {
    pub(super) fn keys(&self) -> impl Iterator<Item = (&'a String, &'a Value)> + use<'a> {
        self.map.into_iter().flatten()
    }

    /// A field's value; `None` for null too.
    pub(super) fn get(&self, key: &str) -> Option<&'a Value> {
        self.map?.get(key).filter(|value| !value.is_null())
    }

    pub(super) fn needed(&self, key: &str) -> Result<&'a Value> {
        self.get(key).ok_or_else(|| {
            let problem = format!("damaged: {}{key} is missing; fetch or write the document again", self.place);
            ImportError::invalid(self.path, problem)
        })
    }

    /// The error of a field with another value than expected.
    pub(super) fn damaged(&self, key: &str, expected: &str, found: &Value) -> ImportError {
        let mut shown: String = found.to_string().chars().take(MOST_SHOWN + 1).collect();
        if shown.chars().count() > MOST_SHOWN {
            shown.truncate(shown.char_indices().nth(MOST_SHOWN).map_or(0, |(at, _)| at));
            shown.push_str("...");
        }
        let Self { path, place, .. } = self;
        let problem = format!("damaged: {place}{key}: expected {expected}, found {shown}; fetch or write it again");
        ImportError::invalid(path, problem)
    }

    /// The error of a valid value that is not read.
    pub(super) fn unsupported(&self, feature: String, advice: &str) -> ImportError {
        ImportError::unsupported_but(self.path, feature, advice)
    }

    /// Lengths along axes.
    pub(super) fn lengths(&self, key: &str) -> Result<Vec<u64>> {
        let value = self.needed(key)?;
        let lengths = value.as_array().and_then(|list| list.iter().map(length).collect::<Option<Vec<u64>>>());
        lengths.ok_or_else(|| self.damaged(key, "a list of lengths", value))
    }

    /// One of some texts; `None` if the field is left out.
    pub(super) fn one_of<T: Copy>(&self, key: &str, known: &[(&str, T)]) -> Result<Option<T>> {
        let Some(value) = self.get(key) else { return Ok(None) };
        let found = known.iter().find(|(text, _)| value.as_str() == Some(text)).map(|(_, meaning)| *meaning);
        let names = || known.iter().map(|(text, _)| format!("\"{text}\"")).collect::<Vec<_>>().join(" or ");
        found.map(Some).ok_or_else(|| self.damaged(key, &names(), value))
    }

    /// The members of a list; empty if the field is left out.
    pub(super) fn list(&self, key: &str) -> Result<&'a [Value]> {
        match self.get(key) {
            None => Ok(&[]),
            Some(Value::Array(list)) => Ok(list),
            Some(other) => Err(self.damaged(key, "a list", other)),
        }
    }

    /// An object in this one.
    pub(super) fn object(&self, key: &str, value: &'a Value) -> Result<Self> {
        let map = value.as_object().ok_or_else(|| self.damaged(key, "an object", value))?;
        Ok(Self { path: self.path, place: format!("{}{key}.", self.place), map: Some(map) })
    }

    /// An extension of version 3: a name alone, or an object of a name and its configuration.
    pub(super) fn named(&self, key: &str, value: &'a Value) -> Result<Named<'a>> {
        let nothing = Self { path: self.path, place: format!("{}{key}.", self.place), map: None };
        if let Some(name) = value.as_str() {
            return Ok(Named { name, settings: nothing });
        }
        let object = self.object(key, value)?;
        let name = object.needed("name")?;
        let name = name.as_str().ok_or_else(|| object.damaged("name", "a text", name))?;
        let settings = object.get("configuration").map(|settings| object.object("configuration", settings));
        Ok(Named { name, settings: settings.transpose()?.unwrap_or(nothing) })
    }

    /// A coder of version 2: an object of a name, called `id`, and its settings.
    pub(super) fn identified(&self, key: &str, value: &'a Value) -> Result<Named<'a>> {
        let settings = self.object(key, value)?;
        let name = settings.needed("id")?;
        let name = name.as_str().ok_or_else(|| settings.damaged("id", "a text", name))?;
        Ok(Named { name, settings })
    }
}

/// A length; floats without a fraction, which some programs write, are lengths too.
fn length(value: &Value) -> Option<u64> {
    let whole = |n: &f64| n.fract() == 0.0 && (0.0..9e15).contains(n);
    value.as_u64().or_else(|| value.as_f64().filter(whole).map(|n| n as u64))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::temp_file;
    use serde_json::json;

    #[test]
    fn numbers_of_python_are_texts() {
        let fields = parse(br#"{"a": NaN, "b": [-Infinity, Infinity], "c": "NaN \" NaN", "d": "\\"}"#).unwrap();
        let expected = json!({ "a": "NaN", "b": ["-Infinity", "Infinity"], "c": "NaN \" NaN", "d": "\\" });
        assert_eq!(Value::Object(fields), expected);
        for damaged in [&b"{\"a\": NaN"[..], b"[]", b"{} {}", b"", b"\"\\", b"{\"a\": nan}"] {
            assert!(parse(damaged).is_err(), "{damaged:?}");
        }
    }

    #[test]
    fn consolidated_metadata_are_passed_over() {
        let fields = parse(br#"{"consolidated_metadata": {"metadata": {"a": [1, {}]}}, "zarr_format": 3}"#).unwrap();
        assert_eq!(Value::Object(fields), json!({ "zarr_format": 3 }));
    }

    #[test]
    fn messages_name_file_place_and_value() {
        let (_folder, path) = temp_file("zarr.json", br#"{"a": {"b": ["x", 2]}}"#);
        let document = Document::read(path).unwrap().unwrap();
        let root = document.root();
        let inner = root.object("a", root.needed("a").unwrap()).unwrap();
        let message = inner.lengths("b").unwrap_err().to_string();
        assert!(message.contains("zarr.json: damaged: a.b: expected a list of lengths, found [\"x\",2];"), "{message}");
        assert!(inner.needed("c").unwrap_err().to_string().contains("a.c is missing"));
        let long = Value::String("é".repeat(100));
        assert!(root.damaged("a", "b", &long).to_string().contains(&format!("\"{}...;", "é".repeat(MOST_SHOWN - 1))));
    }
}
