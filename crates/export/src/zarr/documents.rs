//! The documents of OME-Zarr 0.4 and 0.6, from those which the store writes.

use super::chunk_files::ZLIB_LEVEL;
use brickyard_store::metadata::document_bytes;
use brickyard_store::{Kind, Store, creator};
use serde_json::{Value, json};
use std::path::Path;

/// The mark of a label image, with its colours.
pub(super) struct Labels {
    part: Value,
}

impl Labels {
    /// The mark for a store's values, if they are labels.
    pub(super) fn of(store: &Store) -> Option<Self> {
        (store.info().kind == Kind::Labels).then(|| {
            let byte = |part: f64| (part * 255.0).round() as u8;
            let colors = store.label_colors().iter().map(|look| {
                let [red, green, blue] = look.color.map(byte);
                json!({ "label-value": look.label, "rgba": [red, green, blue, 255] })
            });
            let colors: Vec<Value> = colors.collect();
            // An empty list is against the specification.
            let part = if colors.is_empty() { json!({}) } else { json!({ "colors": colors }) };
            Self { part }
        })
    }

    /// The value of `image-label`.
    pub(super) fn part(&self) -> Value {
        self.part.clone()
    }
}

/// Documents of a folder of Zarr 2.
pub(super) struct OldDocuments {
    /// Name and content of the group's or array's own.
    own: (&'static str, Value),
    attributes: Value,
}

impl OldDocuments {
    /// Writes both into a folder.
    pub(super) fn save(&self, folder: &Path) -> std::io::Result<()> {
        let (name, document) = &self.own;
        std::fs::write(folder.join(name), document_bytes(document))?;
        std::fs::write(folder.join(".zattrs"), document_bytes(&self.attributes))
    }
}

/// The root group's documents of 0.4, from its document of 0.5.
pub(super) fn in_version_0_4(root: &Value, labels: Option<&Labels>) -> OldDocuments {
    let ome = &root["attributes"]["ome"];
    let mut multiscales = ome["multiscales"].clone();
    multiscales[0]["version"] = json!("0.4");
    let mut attributes = json!({ "multiscales": multiscales, "_creator": creator() });
    if let Some(omero) = ome.get("omero") {
        attributes["omero"] = omero.clone();
        attributes["omero"]["version"] = json!("0.4");
    }
    if let Some(labels) = labels {
        attributes["image-label"] = labels.part();
        attributes["image-label"]["version"] = json!("0.4");
    }
    OldDocuments { own: (".zgroup", json!({ "zarr_format": 2 })), attributes }
}

/// An array's documents of Zarr 2, from its document of Zarr 3: chunks are the shards' inner ones.
pub(super) fn of_old_array(array: &Value) -> OldDocuments {
    let mut attributes = array["attributes"].clone();
    // As xarray names dimensions in Zarr 2.
    attributes["_ARRAY_DIMENSIONS"] = array["dimension_names"].clone();
    let dtype = match array["data_type"].as_str() {
        Some("uint8") => "|u1",
        Some("int8") => "|i1",
        Some("uint16") => "<u2",
        Some("int16") => "<i2",
        Some("uint32") => "<u4",
        Some("int32") => "<i4",
        _ => "<f4",
    };
    let document = json!({
        "zarr_format": 2,
        "shape": array["shape"],
        "chunks": array["codecs"][0]["configuration"]["chunk_shape"],
        "dtype": dtype,
        "compressor": { "id": "zlib", "level": ZLIB_LEVEL },
        "fill_value": array["fill_value"],
        "order": "C",
        "filters": null,
        "dimension_separator": "/",
    });
    OldDocuments { own: (".zarray", document), attributes }
}

/// The root group's document of 0.6 for others, from that of a store of 0.6.
pub(super) fn in_version_0_6(root: &Value, labels: Option<&Labels>) -> Value {
    let mut ome = root["attributes"]["ome"].clone();
    if let Some(labels) = labels {
        ome["image-label"] = labels.part();
    }
    json!({ "zarr_format": 3, "node_type": "group", "attributes": { "ome": ome, "_creator": creator() } })
}
