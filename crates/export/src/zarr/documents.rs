//! The documents of OME-Zarr 0.4 and 0.6, from those of 0.5 as the store writes them.

use super::chunk_files::ZLIB_LEVEL;
use brickyard_store::metadata::document_bytes;
use brickyard_store::{Kind, Store, creator};
use serde_json::{Map, Value, json};
use std::path::Path;

/// Name of the system of spacing and origin.
const PHYSICAL: &str = "physical";
/// Name of the system of a patient.
const PATIENT: &str = "patient";

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

/// The root group's document of 0.6, from that of 0.5. `placement` maps x, y, z to millimetres to the right, front and head.
pub(super) fn in_version_0_6(root: &Value, labels: Option<&Labels>, placement: Option<[[f64; 4]; 3]>) -> Value {
    let old = &root["attributes"]["ome"];
    let from = &old["multiscales"][0];
    let axes = from["axes"].as_array().cloned().unwrap_or_default();
    let datasets = from["datasets"].as_array().into_iter().flatten().map(|dataset| {
        json!({
            "path": dataset["path"],
            "coordinateTransformations": [{
                "type": "sequence",
                "input": { "path": dataset["path"] },
                "output": { "name": PHYSICAL },
                "transformations": dataset["coordinateTransformations"],
            }],
        })
    });
    let mut multiscale = json!({
        "type": from["type"],
        "coordinateSystems": [{ "name": PHYSICAL, "axes": axes }],
        "datasets": datasets.collect::<Vec<Value>>(),
    });
    if let Some(name) = from.get("name") {
        multiscale["name"] = name.clone();
    }
    if let Some(rows) = placement {
        let patient = json!({ "name": PATIENT, "axes": axes.iter().map(of_patient).collect::<Vec<Value>>() });
        multiscale["coordinateSystems"] = json!([multiscale["coordinateSystems"][0], patient]);
        multiscale["coordinateTransformations"] = json!([{
            "type": "affine",
            "input": { "name": PHYSICAL },
            "output": { "name": PATIENT },
            "affine": affine(axes.len(), rows),
        }]);
    }
    let mut ome = Map::new();
    ome.insert("version".into(), json!("0.6"));
    ome.insert("multiscales".into(), json!([multiscale]));
    if let Some(omero) = old.get("omero") {
        ome.insert("omero".into(), omero.clone());
    }
    if let Some(labels) = labels {
        ome.insert("image-label".into(), labels.part());
    }
    json!({ "zarr_format": 3, "node_type": "group", "attributes": { "ome": ome, "_creator": creator() } })
}

/// An axis in the system of a patient. Directions of x, y, z are told as in RFC 4, which readers of 0.6 may ignore.
fn of_patient(axis: &Value) -> Value {
    let towards = match axis["name"].as_str() {
        Some("x") => "left-to-right",
        Some("y") => "posterior-to-anterior",
        Some("z") => "inferior-to-superior",
        _ => return axis.clone(),
    };
    let orientation = json!({ "type": "anatomical", "value": towards });
    json!({ "name": axis["name"], "type": "space", "unit": "millimeter", "orientation": orientation })
}

/// The matrix over all axes, of which z, y, x are the last: a row for each, with the offset at its end.
fn affine(axes: usize, rows: [[f64; 4]; 3]) -> Vec<Vec<f64>> {
    let others = axes.saturating_sub(3);
    let row = |i: usize| -> Vec<f64> {
        let mut row = vec![0.0; axes + 1];
        if i < others {
            row[i] = 1.0;
            return row;
        }
        let from = rows[2 - (i - others)];
        for (place, of_axis) in row[others..].iter_mut().zip([from[2], from[1], from[0], from[3]]) {
            *place = of_axis;
        }
        row
    };
    (0..axes).map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_matrix_of_x_y_z_becomes_one_of_all_axes_in_their_order() {
        let rows = [[1.0, 2.0, 3.0, 4.0], [5.0, 6.0, 7.0, 8.0], [9.0, 10.0, 11.0, 12.0]];
        assert_eq!(
            affine(4, rows),
            [
                [1.0, 0.0, 0.0, 0.0, 0.0],
                [0.0, 11.0, 10.0, 9.0, 12.0],
                [0.0, 7.0, 6.0, 5.0, 8.0],
                [0.0, 3.0, 2.0, 1.0, 4.0],
            ]
        );
    }
}
