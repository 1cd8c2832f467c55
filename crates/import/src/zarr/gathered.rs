//! Documents of all nodes below a group, gathered in one: `.zmetadata` of Zarr 2, and `consolidated_metadata` in the `zarr.json` of Zarr 3. At an address
//! they are taken for the documents themselves, as zarr-python takes them, which saves a round trip or more; what a node lacks there is absent. On disk
//! each document is read where it is.
//!
//! Costs parsing a document of at most [`MOST_BYTES`]; a larger one is passed over.

use super::document::{CONSOLIDATED, Document};
use super::paths::inside;
use brickyard_objects::Version;
use serde_json::{Map, Value};
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// Most bytes of a document: those of a plate of a hundred images.
const MOST_BYTES: usize = 4 << 20;

/// The documents gathered in a folder, by their paths, or the nodes'.
enum Gathered {
    V2(Map<String, Value>),
    V3(Map<String, Value>),
}

impl Gathered {
    /// Those of a folder at an address. Damaged ones are passed over: the documents themselves are still there.
    fn of(folder: &Path) -> Option<(Self, Version)> {
        let read = |name: &str| {
            let object = Document::object(&folder.join(name)).filter(|object| object.bytes.len() <= MOST_BYTES)?;
            Some((serde_json::from_slice::<Value>(&object.bytes).ok()?, object.version.clone()))
        };
        let members = |value: &mut Value| Some(std::mem::take(value.get_mut("metadata")?.as_object_mut()?));
        // Documents of Zarr 3 come before those of Zarr 2.
        let is_v3 = Document::is_there(&folder.join("zarr.json"));
        let (mut root, teller) = read(if is_v3 { "zarr.json" } else { ".zmetadata" })?;
        let gathered = match is_v3 {
            true => Self::V3(members(root.get_mut(CONSOLIDATED)?)?),
            false => Self::V2(members(&mut root)?),
        };
        Some((gathered, teller))
    }
}

/// The documents gathered in a folder at an address become known.
pub(super) fn know(folder: &Path) {
    match Gathered::of(folder) {
        Some((Gathered::V2(documents), teller)) => know_documents(folder, &documents, &teller),
        Some((Gathered::V3(nodes), teller)) => know_nodes(folder, nodes, &teller),
        None => {}
    }
}

/// Paths of the nodes below a folder at an address, if they are gathered there: web servers keep no list of folders.
pub(super) fn nodes(folder: &Path) -> Option<BTreeSet<PathBuf>> {
    let node = |path: &str| inside(path).ok();
    let nodes: BTreeSet<PathBuf> = match Gathered::of(folder)?.0 {
        Gathered::V2(documents) => documents.keys().filter_map(|path| node(path.rsplit_once('/')?.0)).collect(),
        Gathered::V3(nodes) => nodes.keys().filter_map(|path| node(path)).collect(),
    };
    Some(nodes).filter(|nodes| !nodes.is_empty())
}

/// Nodes of Zarr 3 by their paths. An empty map of their own, as zarr-python writes into groups below, tells nothing.
fn know_nodes(folder: &Path, nodes: Map<String, Value>, teller: &Version) {
    for (path, mut node) in nodes {
        let Ok(path) = inside(&path) else { continue };
        let is_node = node["zarr_format"] == 3 && node["node_type"].is_string();
        node.as_object_mut().map(|node| node.remove(CONSOLIDATED));
        if let Some(text) = serde_json::to_vec(&node).ok().filter(|_| is_node && path.file_name().is_some()) {
            Document::know(&folder.join(path).join("zarr.json"), Some(text), teller);
        }
    }
}

/// Documents of Zarr 2 by their paths. An array without attributes there has none; a group without, whose attributes tell of images, is asked.
fn know_documents(folder: &Path, documents: &Map<String, Value>, teller: &Version) {
    let mut nodes: BTreeMap<PathBuf, Vec<&str>> = BTreeMap::new();
    for (path, document) in documents {
        let Some((node, name @ (".zarray" | ".zgroup" | ".zattrs"))) = path.rsplit_once('/') else { continue };
        let Ok(node) = inside(node) else { continue };
        if node.file_name().is_some()
            && document.is_object()
            && let Ok(text) = serde_json::to_vec(document)
        {
            Document::know(&folder.join(&node).join(name), Some(text), teller);
            nodes.entry(node).or_default().push(name);
        }
    }
    for (node, told) in nodes.into_iter().filter(|(_, told)| *told != [".zattrs"]) {
        let is_absent = |name: &&str| !told.contains(name) && (*name != ".zattrs" || told.contains(&".zarray"));
        for name in ["zarr.json", ".zarray", ".zgroup", ".zattrs"].into_iter().filter(is_absent) {
            Document::know(&folder.join(&node).join(name), None, teller);
        }
    }
}
