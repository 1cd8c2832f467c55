//! Nodes of a hierarchy: a folder with a document is a group or an array. Documents of version 3 win over those of version 2 beside them.

use super::array::{Array, Opening};
use super::document::Document;
pub(crate) use super::layout::ZarrVersion;
use super::{v2, v3};
use crate::error::Result;
use serde_json::{Map, Value};
use std::path::{Path, PathBuf};

/// A group, with its attributes as found.
#[derive(Debug)]
pub(crate) struct Group {
    path: PathBuf,
    version: ZarrVersion,
    attributes: Map<String, Value>,
}

impl Group {
    /// The group's folder.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn version(&self) -> ZarrVersion {
        self.version
    }

    pub(crate) fn attributes(&self) -> &Map<String, Value> {
        &self.attributes
    }
}

/// A group or an array.
#[derive(Debug)]
#[expect(clippy::large_enum_variant, reason = "one is made for each opened folder, and taken apart at once")]
pub(crate) enum Node {
    Group(Group),
    Array(Array),
}

/// Opens the node in a folder; `None` if there is no Zarr document.
///
/// # Errors
/// If a document is damaged, or tells of anything unsupported.
pub(crate) fn open_node(path: &Path) -> Result<Option<Node>> {
    let folder = path.to_owned();
    if let Some(mut document) = Document::read(path.join("zarr.json"))? {
        let (version, is_array) = (ZarrVersion::V3, v3::is_array(&document)?);
        let attributes = document.take_attributes()?;
        if !is_array {
            return Ok(Some(Node::Group(Group { path: folder, version, attributes })));
        }
        let layout = v3::layout(&document)?;
        let array = Array::new(Opening { folder, version, attributes, layout, document })?;
        return Ok(Some(Node::Array(array)));
    }
    let version = ZarrVersion::V2;
    let attributes = || {
        let document = Document::read(path.join(".zattrs"))?;
        Ok(document.map_or_else(Map::new, |document| document.fields))
    };
    if let Some(document) = Document::read(path.join(".zarray"))? {
        let layout = v2::layout(&document)?;
        let array = Array::new(Opening { folder, version, attributes: attributes()?, layout, document })?;
        return Ok(Some(Node::Array(array)));
    }
    match Document::read(path.join(".zgroup"))? {
        Some(_) => Ok(Some(Node::Group(Group { path: folder, version, attributes: attributes()? }))),
        None => Ok(None),
    }
}
