//! Whole images and arrays, written here as the specifications show them, with one chunk for each array.

use super::open_image;
use crate::error::ImportError;
use crate::options::OpenOptions;
use crate::source::{Access, Source, SourceInfo};
use crate::testing::{Field, assert_boxes, said};
use brickyard_volume::{VoxelBox, VoxelType};
use glam::DVec3;
use proptest::prelude::*;
use serde_json::{Value, json};
use std::fs;
use std::path::{Path, PathBuf};

/// Writes a document, and the folders to it.
fn write(path: &Path, document: &Value) {
    fs::create_dir_all(path.parent().unwrap()).unwrap();
    fs::write(path, document.to_string()).unwrap();
}

fn group(folder: &Path, attributes: Value) {
    write(&folder.join("zarr.json"), &json!({ "zarr_format": 3, "node_type": "group", "attributes": attributes }));
}

fn old_group(folder: &Path, attributes: Value) {
    write(&folder.join(".zgroup"), &json!({ "zarr_format": 2 }));
    write(&folder.join(".zattrs"), &attributes);
}

fn shape_of(field: Field, axes: &str) -> Vec<u64> {
    axes.chars().map(|axis| u64::from(field.sizes["xyzct".find(axis).unwrap()])).collect()
}

/// Writes a field as one chunk of Zarr 3.
fn array(folder: &Path, field: Field, axes: &str, attributes: Value) {
    numbers(folder, &shape_of(field, axes), field.voxel_type.zarr_name(), &field.bytes(axes, false), attributes);
}

fn numbers(folder: &Path, shape: &[u64], data_type: &str, bytes: &[u8], attributes: Value) {
    write(
        &folder.join("zarr.json"),
        &json!({
            "zarr_format": 3, "node_type": "array", "shape": shape, "data_type": data_type,
            "chunk_grid": { "name": "regular", "configuration": { "chunk_shape": shape } },
            "chunk_key_encoding": { "name": "default", "configuration": { "separator": "/" } },
            "fill_value": 0, "codecs": [{ "name": "bytes", "configuration": { "endian": "little" } }], "attributes": attributes,
        }),
    );
    let chunk = shape.iter().fold(folder.join("c"), |path, _| path.join("0"));
    fs::create_dir_all(chunk.parent().unwrap()).unwrap();
    fs::write(chunk, bytes).unwrap();
}

/// Writes a field as one chunk of Zarr 2.
fn old_array(folder: &Path, field: Field, axes: &str, separator: &str) {
    let shape = shape_of(field, axes);
    let kind = match field.voxel_type {
        VoxelType::U8 => "|u1",
        VoxelType::U16 => "<u2",
        _ => "<f4",
    };
    write(
        &folder.join(".zarray"),
        &json!({
            "zarr_format": 2, "shape": shape, "chunks": shape, "dtype": kind, "compressor": null, "fill_value": 0, "order": "C",
            "filters": null, "dimension_separator": separator,
        }),
    );
    let chunk = folder.join(vec!["0"; shape.len()].join(separator));
    fs::create_dir_all(chunk.parent().unwrap()).unwrap();
    fs::write(chunk, field.bytes(axes, false)).unwrap();
}

fn axes(letters: &str, unit: Option<&str>) -> Value {
    let axis = |letter: char| {
        let kind = match letter {
            't' => "time",
            'c' => "channel",
            _ => "space",
        };
        match unit.filter(|_| kind == "space") {
            Some(unit) => json!({ "name": letter.to_string(), "type": kind, "unit": unit }),
            None => json!({ "name": letter.to_string(), "type": kind }),
        }
    };
    letters.chars().map(axis).collect()
}

/// An image of 0.5 with these scales, from the finest level on.
fn image(letters: &str, unit: Option<&str>, scales: &[Vec<f64>], offsets: &[Vec<f64>]) -> Value {
    let datasets = scales.iter().zip(offsets).enumerate().map(|(level, (scale, offset))| {
        json!({ "path": level.to_string(), "coordinateTransformations": [
            { "type": "scale", "scale": scale }, { "type": "translation", "translation": offset }
        ] })
    });
    json!({ "version": "0.5", "multiscales": [{ "axes": axes(letters, unit), "datasets": datasets.collect::<Value>() }] })
}

fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Source>, ImportError> {
    crate::open::open(&[path.to_owned()], options)
}

fn info(path: &Path) -> SourceInfo {
    open(path, &OpenOptions::default()).unwrap().info().clone()
}

fn named(path: &Path, name: &str) -> PathBuf {
    format!("{}::{name}", path.display()).into()
}

fn refusal(path: &Path) -> String {
    let error = open(path, &OpenOptions::default()).err().unwrap();
    let kind = if matches!(error, ImportError::Options { .. }) { "options" } else { "invalid" };
    format!("{kind} {error}")
}

const FIELD: Field = Field { sizes: [7, 5, 4, 2, 3], voxel_type: VoxelType::U16 };
const FLAT: Field = Field { sizes: [7, 5, 4, 1, 1], voxel_type: VoxelType::U16 };

#[test]
fn images_of_any_order_of_axes_are_read() {
    for letters in ["tczyx", "xyzct", "czytx", "yxczt", "ztcxy"] {
        let folder = tempfile::tempdir().unwrap();
        let scale: Vec<f64> =
            letters.chars().map(|axis| [0.5, 1.0, 2.0, 1.0, 10.0]["xyzct".find(axis).unwrap()]).collect();
        let offset: Vec<f64> =
            letters.chars().map(|axis| [3.0, 4.0, 5.0, 0.0, 60.0]["xyzct".find(axis).unwrap()]).collect();
        let mut ome = image(letters, Some("micrometer"), &[scale], &[offset]);
        ome["omero"] = json!({ "channels": [{ "label": "a", "color": "FF0000" }, { "label": "b" }] });
        group(folder.path(), json!({ "ome": ome }));
        array(&folder.path().join("0"), FIELD, letters, json!({}));
        let source = open(folder.path(), &OpenOptions::default()).unwrap();
        assert_boxes(&*source, FIELD);
        let info = source.info();
        assert_eq!(
            (info.geometry.spacing, info.geometry.origin),
            (DVec3::new(0.5, 1.0, 2.0), DVec3::new(3.0, 4.0, 5.0))
        );
        assert_eq!((info.geometry.unit.as_deref(), info.calibrated), (Some("micrometer"), true));
        let time = info.time.as_ref().unwrap();
        assert_eq!((time.start, time.step, time.unit.as_deref()), (60.0, 10.0, None));
        assert_eq!(
            (info.channel_looks[0].color, info.channel_looks[1].name.as_deref()),
            (Some([255, 0, 0]), Some("b"))
        );
        assert_eq!((info.notes.clone(), info.orientation), (Vec::new(), None), "{}", said(&info.notes));
    }
}

#[test]
fn versions_before_0_5_lie_in_zarr_2() {
    for (version, letters, separator) in
        [("0.1", "tczyx", "."), ("0.2", "tczyx", "/"), ("0.3", "zyx", "/"), ("0.4", "tczyx", "/")]
    {
        let folder = tempfile::tempdir().unwrap();
        let mut image = json!({ "version": version, "datasets": [{ "path": "0" }] });
        match version {
            "0.3" => image["axes"] = json!(["z", "y", "x"]),
            "0.4" => {
                image["axes"] = axes(letters, Some("nanometer"));
                image["datasets"][0]["coordinateTransformations"] =
                    json!([{ "type": "scale", "scale": [1, 1, 3, 2, 2] }]);
            }
            _ => {}
        }
        old_group(folder.path(), json!({ "multiscales": [image] }));
        let field = if letters == "zyx" { FLAT } else { FIELD };
        old_array(&folder.path().join("0"), field, letters, separator);
        let source = open(folder.path(), &OpenOptions::default()).unwrap();
        assert_boxes(&*source, field);
        assert_eq!(source.info().calibrated, version == "0.4");
        assert_eq!(said(&source.info().notes), "", "{version}");
    }
}

#[test]
fn a_scale_of_one_without_a_unit_is_no_calibration() {
    let folder = tempfile::tempdir().unwrap();
    array(&folder.path().join("0"), FLAT, "zyx", json!({}));
    for (scale, unit, calibrated) in
        [(1.0, None, false), (1.0, Some("micrometer"), true), (2.0, None, true), (1.0, Some("pixel"), false)]
    {
        group(folder.path(), json!({ "ome": image("zyx", unit, &[vec![scale; 3]], &[vec![0.0; 3]]) }));
        assert_eq!(info(folder.path()).calibrated, calibrated, "{scale} {unit:?}");
    }
    group(folder.path(), json!({ "ome": image("zyx", Some("mm"), &[vec![0.0, 1.0, 1.0]], &[vec![0.0; 3]]) }));
    let found = info(folder.path());
    assert!(said(&found.notes).contains("The scale along z is 0: 1 is taken.") && !found.calibrated);
}

/// Directions as RFC 4 tells them, a further system, and a transformation that turns the image.
#[test]
fn images_lie_in_a_body_as_the_document_tells() {
    let folder = tempfile::tempdir().unwrap();
    array(&folder.path().join("0"), FLAT, "zyx", json!({}));
    let mut ome = image("zyx", Some("millimeter"), &[vec![3.0, 2.0, 1.0]], &[vec![30.0, 20.0, 10.0]]);
    for (axis, way) in ["inferior-to-superior", "anterior-to-posterior", "right-to-left"].into_iter().enumerate() {
        ome["multiscales"][0]["axes"][axis]["orientation"] = json!({ "type": "anatomical", "value": way });
    }
    group(folder.path(), json!({ "ome": ome }));
    let rows = info(folder.path()).orientation.unwrap().rows();
    assert_eq!(rows, [[-1.0, 0.0, 0.0, -10.0], [0.0, -2.0, 0.0, -20.0], [0.0, 0.0, 3.0, 30.0]]);
    ome["multiscales"][0]["axes"][0]["orientation"]["value"] = json!("dorsal-to-ventral");
    group(folder.path(), json!({ "ome": ome }));
    let found = info(folder.path());
    assert!(found.orientation.is_none() && said(&found.notes).contains("anatomical orientations are left out"));

    // As this program exports it: a system of a patient in millimetres, of an image in micrometres.
    let system = |name: &str, axes: Value| json!({ "name": name, "axes": axes });
    let mut patient = axes("zyx", Some("millimeter"));
    for (axis, way) in ["inferior-to-superior", "posterior-to-anterior", "left-to-right"].into_iter().enumerate() {
        patient[axis]["orientation"] = json!({ "type": "anatomical", "value": way });
    }
    let to_patient = |name: &str, rows: Value| json!({ "type": "affine", "affine": rows, "input": { "name": "physical" }, "output": { "name": name } });
    let image_0_6 = |other: Value, transform: Value| {
        json!({ "ome": { "version": "0.6", "multiscales": [{
            "coordinateSystems": [system("physical", axes("zyx", Some("micrometer"))), other],
            "datasets": [{ "path": "0", "coordinateTransformations": [
                { "type": "scale", "scale": [3000, 2000, 1000], "input": { "path": "0" }, "output": { "name": "physical" } }
            ] }],
            "coordinateTransformations": [transform]
        }] } })
    };
    let turned = json!([[0.0, 0.0, 1e-3, 7.0], [0.0, 1e-3, 0.0, 8.0], [-1e-3, 0.0, 0.0, 9.0]]);
    group(folder.path(), image_0_6(system("patient", patient), to_patient("patient", turned.clone())));
    let found = info(folder.path());
    let rows = found.orientation.unwrap().rows();
    let expected = [[0.0, 0.0, -3000.0, 9000.0], [0.0, 2000.0, 0.0, 8000.0], [1000.0, 0.0, 0.0, 7000.0]];
    assert!(rows.iter().flatten().zip(expected.iter().flatten()).all(|(a, b)| (a - b).abs() < 1e-9), "{rows:?}");
    assert_eq!((found.geometry.spacing, said(&found.notes)), (DVec3::new(1000.0, 2000.0, 3000.0), String::new()));

    // Of no body, the turned one alone is taken.
    group(folder.path(), image_0_6(system("stage", axes("zyx", Some("millimeter"))), to_patient("stage", turned)));
    let found = info(folder.path());
    assert!(found.orientation.is_some() && said(&found.notes).contains("turned in the coordinate system \"stage\""));
    let moved = json!({ "type": "translation", "translation": [1, 2, 3], "input": { "name": "physical" }, "output": { "name": "stage" } });
    group(folder.path(), image_0_6(system("stage", axes("zyx", Some("micrometer"))), moved));
    let found = info(folder.path());
    assert!(
        found.orientation.is_none() && said(&found.notes).contains("Further coordinate systems are left out: stage.")
    );

    // A negative scale mirrors the image.
    group(
        folder.path(),
        json!({ "ome": image("zyx", Some("millimeter"), &[vec![3.0, 2.0, -1.0]], &[vec![0.0, 0.0, 6.0]]) }),
    );
    let found = info(folder.path());
    assert_eq!(found.orientation.unwrap().rows()[0], [-1.0, 0.0, 0.0, 6.0]);
    assert_eq!(found.geometry.spacing, DVec3::new(1.0, 2.0, 3.0));
}

#[test]
fn levels_have_their_places_in_the_finest() {
    let folder = tempfile::tempdir().unwrap();
    let fine = Field { sizes: [9, 5, 4, 1, 1], voxel_type: VoxelType::U8 };
    let coarse = Field { sizes: [4, 3, 4, 1, 1], voxel_type: VoxelType::U8 };
    array(&folder.path().join("0"), fine, "zyx", json!({}));
    array(&folder.path().join("1"), coarse, "zyx", json!({}));
    let scales = [vec![3.0, 0.5, 0.5], vec![3.0, 1.0, 1.0]];
    group(folder.path(), json!({ "ome": image("zyx", Some("um"), &scales, &[vec![1.0; 3], vec![1.0, 1.25, 1.25]]) }));
    let opened = open_image(folder.path()).unwrap();
    let levels = &opened.levels;
    assert_eq!([levels[0].factor, levels[1].factor], [DVec3::ONE, DVec3::new(2.0, 2.0, 1.0)]);
    assert_boxes(&*levels[0].source, fine);
    assert_boxes(&*levels[1].source, coarse);
    assert_eq!(levels[1].source.info().geometry.spacing, DVec3::new(1.0, 1.0, 3.0));
    // A level by its path, in the name or the folder, is calibrated as a level.
    for path in [named(folder.path(), "1"), folder.path().join("1")] {
        let source = open(&path, &OpenOptions::default()).unwrap();
        assert_boxes(&*source, coarse);
        assert_eq!(source.info().geometry.spacing, DVec3::new(1.0, 1.0, 3.0));
    }
    // Without a word of scales, sizes tell.
    group(
        folder.path(),
        json!({ "ome": { "version": "0.5", "multiscales": [
        { "axes": axes("zyx", None), "datasets": [{ "path": "0" }, { "path": "1" }] }
    ] } }),
    );
    let opened = open_image(folder.path()).unwrap();
    assert_eq!(opened.levels[1].factor, DVec3::new(2.0, 2.0, 1.0));
}

#[test]
fn labels_are_labels_and_told_beside_their_image() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    group(root, json!({ "ome": image("zyx", None, &[vec![1.0; 3]], &[vec![0.0; 3]]) }));
    array(&root.join("0"), FLAT, "zyx", json!({}));
    group(&root.join("labels"), json!({ "ome": { "version": "0.5", "labels": ["nuclei", "listed"] } }));
    let mut ome = image("zyx", None, &[vec![1.0; 3]], &[vec![0.0; 3]]);
    array(&root.join("labels/listed/0"), FLAT, "zyx", json!({}));
    group(&root.join("labels/listed"), json!({ "ome": ome }));
    ome["image-label"] =
        json!({ "colors": [{ "label-value": 1, "rgba": [255, 0, 0, 255] }], "properties": [{ "label-value": 1 }, {}] });
    group(&root.join("labels/nuclei"), json!({ "ome": ome }));
    array(&root.join("labels/nuclei/0"), FLAT, "zyx", json!({}));
    let found = info(root);
    assert!(!found.kind.are_labels());
    assert!(
        said(&found.notes).contains("The image's labels are volumes of their own: labels/nuclei, labels/listed (as ")
    );
    for path in
        [named(root, "labels/nuclei"), named(root, "/nuclei"), root.join("labels/nuclei"), named(root, "labels/listed")]
    {
        assert!(info(&path).kind.are_labels(), "{}", path.display());
    }
    assert!(
        said(&info(&named(root, "nuclei")).notes)
            .contains("Left out of the labels' description: 1 colour, the properties of 2 labels.")
    );
    // Drawn where it lies, it has its colours.
    let drawn = open_image(&named(root, "nuclei")).unwrap();
    let notes = said(&drawn.levels[0].source.info().notes);
    assert!(notes.contains("Left out of the labels' description: the properties of 2 labels."), "{notes}");
    assert_eq!(drawn.presentation.label_colors.len(), 1);
    let message = refusal(&named(root, "labels"));
    assert!(
        message.starts_with("options")
            && message.contains("holds 2 datasets")
            && message.contains("nuclei (4 x 5 x 7, u16)"),
        "{message}"
    );
    let message = refusal(&named(root, "labels/nucleus"));
    assert!(message.starts_with("options") && message.contains("no such dataset"), "{message}");
}

#[test]
fn levels_in_the_wrong_order_are_told() {
    let folder = tempfile::tempdir().unwrap();
    let coarse = Field { sizes: [4, 3, 2, 1, 1], ..FLAT };
    array(&folder.path().join("0"), coarse, "zyx", json!({}));
    array(&folder.path().join("1"), FLAT, "zyx", json!({}));
    group(
        folder.path(),
        json!({ "ome": image("zyx", None, &[vec![2.0; 3], vec![1.0; 3]], &[vec![0.0; 3], vec![0.0; 3]]) }),
    );
    assert!(said(&info(folder.path()).notes).contains("the level 1 has more voxels than the one read"));
    assert_eq!(said(&info(&named(folder.path(), "1")).notes), "");
    // A level that is not read may be missing.
    fs::remove_dir_all(folder.path().join("1")).unwrap();
    assert_boxes(&*open(folder.path(), &OpenOptions::default()).unwrap(), coarse);
    let opened = open_image(folder.path()).unwrap();
    assert_boxes(&*opened.levels[0].source, coarse);
    assert!(opened.levels.len() == 1 && said(&opened.levels[0].source.info().notes).contains("Level 1 is left out"));
}

/// Attributes of other programs that happen to bear the names of OME-Zarr's.
#[test]
fn groups_of_others_are_walked_whatever_their_attributes() {
    let folder = tempfile::tempdir().unwrap();
    for (name, value) in [("labels", json!("A")), ("labels", json!([1])), ("well", json!("A1")), ("plate", json!(7))] {
        group(folder.path(), json!({ name: value }));
        group(&folder.path().join("a"), json!({ "ome": image("zyx", None, &[vec![1.0; 3]], &[vec![0.0; 3]]) }));
        array(&folder.path().join("a/0"), FLAT, "zyx", json!({}));
        for path in [folder.path().to_owned(), folder.path().join("a")] {
            assert_boxes(&*open(&path, &OpenOptions::default()).unwrap(), FLAT);
        }
    }
}

#[test]
fn fields_of_plates_and_series_are_chosen() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let ome = json!({ "ome": image("zyx", Some("um"), &[vec![1.0; 3]], &[vec![0.0; 3]]) });
    let write_image = |at: &str| {
        group(&root.join(at), ome.clone());
        array(&root.join(at).join("0"), FLAT, "zyx", json!({}));
    };
    let well = |at: &str, fields: &[&str]| {
        let images: Value = fields.iter().map(|path| json!({ "path": path })).collect();
        group(&root.join(at), json!({ "ome": { "version": "0.5", "well": { "images": images } } }));
        fields.iter().for_each(|field| write_image(&format!("{at}/{field}")));
    };
    group(
        root,
        json!({ "ome": { "version": "0.5", "plate": { "wells": [
        { "path": "A/1", "rowIndex": 0, "columnIndex": 0 }, { "path": "B/12", "rowIndex": 1, "columnIndex": 1 }
    ] } } }),
    );
    // A field that is listed twice is one.
    well("A/1", &["0", "0"]);
    // A well that has not been written is passed over.
    let found = info(root);
    assert!(said(&found.notes).contains("A/1/0 is read, the only volume in "), "{}", said(&found.notes));
    well("B/12", &["0", "1"]);
    let message = refusal(root);
    assert!(
        message.starts_with("options") && message.contains("A/1/0 (4 x 5 x 7, u16), B/12/0 (4 x 5 x 7, u16), B/12/1"),
        "{message}"
    );
    assert_boxes(&*open(&named(root, "B/12/1"), &OpenOptions::default()).unwrap(), FLAT);
    assert!(refusal(&named(root, "B/12")).contains("holds 2 datasets"));
    let message = refusal(&named(root, "B/13/1"));
    assert!(message.contains("no such dataset; datasets of like names are B/12/1 (4 x 5 x 7, u16)"), "{message}");

    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    old_group(root, json!({ "bioformats2raw.layout": 3 }));
    for series in ["0", "1"] {
        group(&root.join(series), ome.clone());
        array(&root.join(series).join("0"), FLAT, "zyx", json!({}));
    }
    let message = refusal(root);
    assert!(message.contains("holds 2 datasets") && message.contains("::0: 0 (4 x 5 x 7, u16), 1 (4"), "{message}");
    assert_boxes(&*open(&named(root, "1"), &OpenOptions::default()).unwrap(), FLAT);
    assert_boxes(&*open(&named(root, "1/0"), &OpenOptions::default()).unwrap(), FLAT);
    old_group(&root.join("OME"), json!({ "series": ["1"] }));
    assert!(said(&info(root).notes).contains("1 is read, the only volume"));
    old_group(&root.join("OME"), json!({ "series": ["."] }));
    assert!(refusal(root).contains("series[0]: expected the path of a folder, found \".\""), "{}", refusal(root));
}

#[test]
fn a_place_in_a_scene_is_told_as_not_read() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    for tile in ["a", "b"] {
        group(&root.join(tile), json!({ "ome": image("zyx", Some("um"), &[vec![1.0; 3]], &[vec![0.0; 3]]) }));
        array(&root.join(tile).join("0"), FLAT, "zyx", json!({}));
    }
    let shift = json!({ "type": "translation", "translation": [0, 0, 300], "input": { "name": "physical", "path": "a" }, "output": { "name": "world" } });
    group(root, json!({ "ome": { "version": "0.6", "scene": { "coordinateTransformations": [shift] } } }));
    assert!(refusal(root).contains("holds 2 datasets"));
    for path in [named(root, "a"), root.join("a")] {
        let notes = said(&info(&path).notes);
        assert!(
            notes.contains(
                "The image's place in the scene around it (attributes.ome.scene.coordinateTransformations) is not read."
            ),
            "{notes}"
        );
    }
    assert_eq!(said(&info(&root.join("b")).notes), "");
}

/// As xarray writes a file of NetCDF.
#[test]
fn arrays_with_coordinates_are_placed_by_them() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    group(root, json!({}));
    let floats = |values: &[f64]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    let line = |name: &str, values: &[f64], attributes: Value| {
        numbers(&root.join(name), &[values.len() as u64], "float64", &floats(values), attributes);
        let path = root.join(name).join("zarr.json");
        let mut document: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
        document["dimension_names"] = json!([name]);
        write(&path, &document);
    };
    line("lon", &[10.0, 10.5, 11.0], json!({ "units": "degrees_east" }));
    line("lat", &[60.0, 59.0], json!({ "units": "degrees_north" }));
    line("plev", &[500.0], json!({ "units": "hPa" }));
    // -9999, as xarray writes it.
    let attributes = json!({ "units": "K", "_FillValue": "AAAAAICHw8A=" });
    numbers(&root.join("T"), &[1, 2, 3], "float64", &floats(&[1.0, 2.0, -9999.0, 4.0, 5.0, 6.0]), attributes);
    let path = root.join("T/zarr.json");
    let mut document: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    document["dimension_names"] = json!(["plev", "lat", "lon"]);
    write(&path, &document);
    let source = open(root, &OpenOptions::default()).unwrap();
    let info = source.info();
    assert_eq!((info.geometry.spacing.x, info.geometry.origin), (0.5, DVec3::new(10.0, 59.0, 500.0)));
    assert_eq!(
        (info.turned, info.nodata, info.channel_looks[0].unit.as_deref()),
        ([false, true, false], Some(-9999.0), Some("K"))
    );
    assert!(said(&info.notes).contains("T is read, the only volume in "), "{}", said(&info.notes));
    let mut out = vec![0; 6 * 4];
    source.read_box(0, 0, info.extent.full_box(), &mut out).unwrap();
    let found: Vec<f64> = (0..6).map(|i| VoxelType::F32.read(&out, i)).collect();
    assert_eq!(found, [4.0, 5.0, 6.0, 1.0, 2.0, -9999.0]);
}

#[test]
fn plain_arrays_need_names_or_axes_beyond_three() {
    let folder = tempfile::tempdir().unwrap();
    array(&folder.path().join("a"), FIELD, "ctzyx", json!({}));
    let path = folder.path().join("a");
    assert!(refusal(&path).contains("`axes`"));
    let told = OpenOptions { axes: Some("ctzyx".parse().unwrap()), ..OpenOptions::default() };
    assert_boxes(&*open(&path, &told).unwrap(), FIELD);
    old_array(&folder.path().join("b"), FLAT, "zyx", ".");
    assert_boxes(&*open(&folder.path().join("b"), &OpenOptions::default()).unwrap(), FLAT);
}

/// Written by this program: settings beside the metadata of OME-Zarr.
#[test]
fn a_store_s_own_settings_count() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    array(&root.join("0"), FIELD, "tczyx", json!({ "_FillValue": 7 }));
    array(&root.join("1"), FIELD, "tczyx", json!({ "_FillValue": 7 }));
    let ome = image(
        "tczyx",
        None,
        &[vec![1.0; 5], vec![1.0, 1.0, 2.0, 2.0, 2.0]],
        &[vec![0.0; 5], vec![0.0, 0.0, 0.5, 0.5, 0.5]],
    );
    let own = json!({
        "version": 2, "kind": "labels", "calibrated": true, "axis_units": ["degree", "degree", "hPa"], "times": 2,
        "orientation": [[0, 1, 0, 5], [1, 0, 0, 6], [0, 0, 1, 7]], "time": { "start": 0.0, "step": 1.0, "stamps": [0.0, 5.0] },
        "channels": [{ "unit": "K" }, {}],
    });
    let mut ome = ome;
    ome["omero"] = json!({ "channels": [{ "label": "channel 0" }, { "label": "edited" }] });
    group(root, json!({ "ome": ome, "brickyard": own }));
    let found = info(root);
    assert!(found.calibrated && found.kind.are_labels());
    assert_eq!((found.nodata, found.times, found.geometry.axis_unit(2)), (Some(7.0), 2, Some("hPa")));
    assert_eq!(found.time.unwrap().stamps, [0.0, 5.0]);
    assert_eq!((found.channel_looks[0].unit.as_deref(), found.channel_looks[1].unit.as_deref()), (Some("K"), None));
    assert_eq!(found.orientation.unwrap().first_centre(), DVec3::new(5.0, 6.0, 7.0));
    let coarse = info(&named(root, "1")).orientation.unwrap();
    assert_eq!((coarse.step(0), coarse.first_centre()), (DVec3::new(0.0, 2.0, 0.0), DVec3::new(5.5, 6.5, 7.5)));
    group(root, json!({ "ome": ome, "brickyard": { "version": 2, "kind": "image", "channels": [{}, {}] } }));
    let looks = info(root).channel_looks;
    assert_eq!((looks[0].name.as_deref(), looks[1].name.as_deref()), (None, Some("edited")));
}

#[test]
fn wide_numbers_are_looked_through_and_empty_arrays_told() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let whole = |values: &[i64]| values.iter().flat_map(|value| value.to_le_bytes()).collect::<Vec<u8>>();
    numbers(&root.join("a"), &[2, 3], "int64", &whole(&[1, 2, 3, 4, 5, -6]), json!({}));
    let source = open(&root.join("a"), &OpenOptions::default()).unwrap();
    assert!(said(&source.info().notes).contains("Voxels are i64 and are held as i32: no value is changed."));
    let mut out = vec![0; 4];
    source.read_box(0, 0, VoxelBox::new([2, 1, 0], [3, 2, 1]), &mut out).unwrap();
    assert_eq!(VoxelType::I32.read(&out, 0), -6.0);
    numbers(&root.join("b"), &[2, 3], "int64", &whole(&[1, 2, 3, 4, 5, 1 << 40]), json!({}));
    assert!(refusal(&root.join("b")).contains("the value 1099511627776 cannot be held"));
    fs::remove_dir_all(root.join("a/c")).unwrap();
    let notes = said(&info(&root.join("a")).notes);
    assert!(notes.contains("No chunk was found in ") && notes.contains("all voxels are the fill value, 0."), "{notes}");
}

#[test]
fn wide_chunks_of_single_planes_are_read_by_planes() {
    let folder = tempfile::tempdir().unwrap();
    array(folder.path(), FLAT, "zyx", json!({}));
    let path = folder.path().join("zarr.json");
    let mut document: Value = serde_json::from_slice(&fs::read(&path).unwrap()).unwrap();
    for (chunk, access) in [(json!([1, 5, 7]), Access::Planes), (json!([4, 2, 2]), Access::Box)] {
        document["chunk_grid"]["configuration"]["chunk_shape"] = chunk;
        write(&path, &document);
        assert_eq!(open(folder.path(), &OpenOptions::default()).unwrap().access(), access);
    }
}

#[test]
fn damage_and_paths_that_lead_out_have_their_places() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    array(&root.join("0"), FLAT, "zyx", json!({}));
    let ome = || image("zyx", None, &[vec![1.0; 3]], &[vec![0.0; 3]]);
    for (path, expected) in [
        ("../0", "expected a path without `..`, found \"../0\""),
        ("/etc", "expected a path that is not absolute, found \"/etc\""),
        ("9", "expected the path of an array in the image's folder, found \"9\""),
    ] {
        let mut ome = ome();
        ome["multiscales"][0]["datasets"][0]["path"] = json!(path);
        group(root, json!({ "ome": ome }));
        let message = refusal(root);
        let place = "zarr.json: attributes.ome.multiscales[0].datasets[0].path: ";
        assert!(message.starts_with("invalid") && message.contains(&format!("{place}{expected}")), "{message}");
    }
    group(root, json!({ "ome": image("tzyx", None, &[vec![1.0; 4]], &[vec![0.0; 4]]) }));
    assert!(refusal(root).contains("expected an array of as many axes as the image, 4, not of [4, 5, 7]"));
    group(root, json!({ "ome": ome() }));
    for name in ["../x", "/../x"] {
        assert!(refusal(&named(root, name)).contains("expected a path without `..`"));
    }
    let empty = tempfile::tempdir().unwrap();
    group(empty.path(), json!({}));
    assert!(refusal(empty.path()).contains("holds no dataset of numbers along 2 to 5 axes"));
}

#[test]
fn several_stores_are_steps() {
    let folder = tempfile::tempdir().unwrap();
    let paths: Vec<PathBuf> = (1..4).map(|step| folder.path().join(format!("t{step}.zarr"))).collect();
    let whole = Field { sizes: [7, 5, 4, 1, 3], ..FLAT };
    let bytes = whole.bytes("tzyx", false);
    for (path, step) in paths.iter().zip(bytes.chunks(bytes.len() / 3)) {
        group(path, json!({ "ome": image("zyx", Some("um"), &[vec![2.0; 3]], &[vec![0.0; 3]]) }));
        numbers(&path.join("0"), &[4, 5, 7], "uint16", step, json!({}));
    }
    let source = crate::open::open(&paths, &OpenOptions::default()).unwrap();
    assert_boxes(&*source, whole);
    assert_eq!(source.info().geometry.spacing, DVec3::splat(2.0));
    let pattern = folder.path().join("t*.zarr");
    assert_eq!(open(&pattern, &OpenOptions::default()).unwrap().info().times, 3);
}

/// Documents changed after opening are seen after the next box.
#[test]
fn documents_are_checked_after_reading() {
    let folder = tempfile::tempdir().unwrap();
    group(folder.path(), json!({ "ome": image("zyx", None, &[vec![1.0; 3]], &[vec![0.0; 3]]) }));
    array(&folder.path().join("0"), FLAT, "zyx", json!({}));
    let source = open(folder.path(), &OpenOptions::default()).unwrap();
    group(folder.path(), json!({ "ome": image("zyx", Some("um"), &[vec![1.0; 3]], &[vec![0.0; 3]]) }));
    let mut out = vec![0; 2];
    let read = source.read_box(0, 0, VoxelBox::new([0; 3], [1; 3]), &mut out);
    assert!(read.unwrap_err().to_string().contains("changed while it was read"));
}

proptest! {
    #![proptest_config(crate::testing::cases(200))]

    /// Damage leads to an error or wrong places, never to a panic.
    #[test]
    fn damaged_documents_do_not_panic(
        version in 0usize..3,
        damage in crate::testing::some_damage(),
        keys in prop::collection::vec((any::<prop::sample::Index>(), 0usize..6), 0..3),
    ) {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        array(&root.join("0"), FLAT, "zyx", json!({}));
        let mut ome = image("zyx", Some("millimeter"), &[vec![3.0, 2.0, 1.0]], &[vec![1.0; 3]]);
        ome["omero"] = json!({ "channels": [{ "label": "a", "color": "FF0000", "window": { "start": 0, "end": 5 } }] });
        if version > 0 {
            ome = json!({ "version": "0.6", "multiscales": [{
                "coordinateSystems": [{ "name": "p", "axes": axes("zyx", Some("um")) }, { "name": "q", "axes": axes("zyx", None) }],
                "datasets": [{ "path": "0", "coordinateTransformations": [
                    { "type": "sequence", "output": { "name": "p" }, "transformations": [
                        { "type": "scale", "scale": [1, 2, 3] }, { "type": "translation", "translation": [1, 2, 3] }
                    ] }
                ] }],
                "coordinateTransformations": [if version == 1 {
                    json!({ "type": "rotation", "rotation": [[0, -1, 0], [1, 0, 0], [0, 0, 1]], "input": { "name": "p" }, "output": { "name": "q" } })
                } else {
                    json!({ "type": "byDimension", "input": { "name": "q" }, "output": { "name": "p" }, "transformations": [
                        { "transformation": { "type": "mapAxis", "mapAxis": [1, 0] }, "inputAxes": [0, 2], "outputAxes": [1, 0] },
                        { "transformation": { "type": "scale", "scale": [-2] }, "inputAxes": [1], "outputAxes": [2] }
                    ] })
                }]
            }] });
        }
        let mut document = json!({ "zarr_format": 3, "node_type": "group", "attributes": { "ome": ome } });
        for (place, kind) in keys {
            let mut values = Vec::new();
            paths_in(&document, "", &mut values);
            let path = &values[place.index(values.len())];
            let new = [json!(null), json!(-1), json!(1e300), json!([]), json!({}), json!("x")][kind].clone();
            *document.pointer_mut(path).unwrap() = new;
        }
        let mut bytes = document.to_string().into_bytes();
        read_with(root, &bytes);
        crate::testing::spoil(&mut bytes, &damage);
        read_with(root, &bytes);
    }
}

/// Pointers to all values of a document.
fn paths_in(value: &Value, at: &str, found: &mut Vec<String>) {
    found.push(at.to_owned());
    match value {
        Value::Array(items) => {
            items.iter().enumerate().for_each(|(i, item)| paths_in(item, &format!("{at}/{i}"), found))
        }
        Value::Object(members) => {
            members.iter().for_each(|(name, item)| paths_in(item, &format!("{at}/{name}"), found))
        }
        _ => {}
    }
}

/// Reads a store with this document, if it can still be opened.
fn read_with(root: &Path, document: &[u8]) {
    fs::write(root.join("zarr.json"), document).unwrap();
    crate::testing::try_to_read(&[root.to_owned()]);
}
