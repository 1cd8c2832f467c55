//! Documents of both versions, there and back, with the content of other programs.

use super::*;
use crate::metadata::root_document;
use crate::store::Store;
use crate::test_store::{TestStore, bumps};
use brickyard_volume::Orientation;
use proptest::prelude::*;
use serde_json::Map;
use std::sync::OnceLock;

const PATH: &str = "a/zarr.json";

fn to(ngff: Ngff, document: &Value) -> Value {
    in_version(Path::new(PATH), document, ngff).unwrap()
}

fn refusal(ngff: Ngff, document: &Value) -> String {
    in_version(Path::new(PATH), document, ngff).unwrap_err().to_string()
}

/// The root document of a store with two channels and three steps, and perhaps an orientation.
fn root(is_oriented: bool) -> Value {
    static ROOTS: OnceLock<[Value; 2]> = OnceLock::new();
    ROOTS.get_or_init(|| [false, true].map(made))[usize::from(is_oriented)].clone()
}

fn made(is_oriented: bool) -> Value {
    let dir = tempfile::tempdir().unwrap();
    let test = TestStore { times: 3, channels: 2, ..TestStore::default() };
    test.write(dir.path(), bumps);
    let store = Store::open(dir.path()).unwrap();
    let rows = [[0.0, -0.5, 0.0, 10.0], [0.25, 0.0, 0.0, -4.0], [0.0, 0.0, 2.0, 3.0]];
    let orientation = is_oriented.then(|| Orientation::new(rows).unwrap());
    let info = crate::metadata::StoreInfo { orientation, ..store.info().clone() };
    root_document(store.layout(), store.geometry(), &info)
}

fn multiscale(document: &Value) -> &Value {
    &document["attributes"]["ome"]["multiscales"][0]
}

fn edit(document: &Value, change: impl FnOnce(&mut Value)) -> Value {
    let mut new = document.clone();
    change(&mut new["attributes"]["ome"]["multiscales"][0]);
    new
}

#[test]
fn a_document_is_the_same_after_both_conversions() {
    for is_oriented in [false, true] {
        let old = root(is_oriented);
        let new = to(Ngff::V06, &old);
        assert_eq!(Ngff::of(&new), Some(Ngff::V06));
        assert_eq!(new["attributes"]["brickyard"], old["attributes"]["brickyard"]);
        assert_eq!(document_bytes(&to(Ngff::V05, &new)), document_bytes(&old));
        assert_eq!(to(Ngff::V06, &new), new);
        assert_eq!(to(Ngff::V05, &old), old);
        let of = multiscale(&new);
        assert!(of.get("axes").is_none());
        assert_eq!(of["coordinateSystems"].as_array().unwrap().len(), 1 + usize::from(is_oriented));
        let Some(one) = of["datasets"][1]["coordinateTransformations"].as_array() else { panic!() };
        let [one] = &one[..] else { panic!("{one:?}") };
        assert_eq!(one["input"], json!({ "path": "1" }));
        assert_eq!(one["output"], json!({ "name": "physical" }));
        assert_eq!(one["transformations"], multiscale(&old)["datasets"][1]["coordinateTransformations"]);
        assert_eq!(of.get("coordinateTransformations").is_some(), is_oriented);
    }
}

/// The matrix takes spacing and origin away, and then applies the orientation; z, y, x are the last axes.
#[test]
fn an_orientation_is_a_matrix_to_the_patient() {
    let document = to(Ngff::V06, &root(true));
    let matrix = &multiscale(&document)["coordinateTransformations"][0];
    assert_eq!([&matrix["input"]["name"], &matrix["output"]["name"]], [&json!("physical"), &json!("patient")]);
    let rows: Vec<Vec<f64>> = serde_json::from_value(matrix["affine"].clone()).unwrap();
    // Spacing 1 and origin (-3, 0.1, 100), in micrometres: the orientation's numbers become millimetres.
    let at = |index: [f64; 3]| {
        let [x, y, z] = index;
        let from = [0.0, 1.0, z + 100.0, y + 0.1, x - 3.0, 1.0];
        rows[2..].iter().map(|row| row.iter().zip(from).map(|(a, b)| a * b).sum::<f64>()).collect::<Vec<f64>>()
    };
    for [x, y, z] in [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 7.0, 0.0], [2.0, 3.0, 5.0]] {
        let expected = [2.0 * z + 3.0, 0.25 * x - 4.0, -0.5 * y + 10.0].map(|place| place / 1000.0);
        for (found, expected) in at([x, y, z]).into_iter().zip(expected) {
            assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        }
    }
    let axes = &multiscale(&document)["coordinateSystems"][1]["axes"];
    assert_eq!(
        axes[4],
        json!({ "name": "x", "type": "space", "unit": "millimeter",
        "orientation": { "type": "anatomical", "value": "left-to-right" } })
    );
}

fn foreign() -> impl Strategy<Value = Map<String, Value>> {
    let leaf = prop_oneof![
        Just(json!(null)),
        any::<bool>().prop_map(Value::from),
        any::<i64>().prop_map(Value::from),
        any::<f64>().prop_filter("JSON has no others", |f| f.is_finite()).prop_map(Value::from),
        "[a-z]{0,4}".prop_map(Value::from)
    ];
    let value = leaf.prop_recursive(2, 8, 3, |inner| {
        prop_oneof![
            prop::collection::vec(inner.clone(), 0..3).prop_map(Value::from),
            prop::collection::btree_map("[a-z]{1,3}", inner, 0..3).prop_map(|map| json!(map)),
        ]
    });
    // No key of the specification begins so.
    prop::collection::btree_map("x_[a-z]{1,3}", value, 0..3).prop_map(|map| map.into_iter().collect())
}

fn add(place: &mut Value, keys: &Map<String, Value>) {
    place.as_object_mut().unwrap().extend(keys.clone());
}

proptest! {
    #[test]
    fn keys_of_others_survive_both_conversions(keys in prop::collection::vec(foreign(), 7), is_oriented: bool) {
        let mut old = root(is_oriented);
        add(&mut old, &keys[0]);
        add(&mut old["attributes"], &keys[1]);
        add(&mut old["attributes"]["ome"], &keys[2]);
        add(&mut old["attributes"]["ome"]["omero"], &keys[3]);
        let old = edit(&old, |of| {
            add(of, &keys[4]);
            add(&mut of["axes"][2], &keys[5]);
            add(&mut of["datasets"][1], &keys[6]);
            add(&mut of["datasets"][0]["coordinateTransformations"][0], &keys[5]);
        });
        let new = to(Ngff::V06, &old);
        prop_assert_eq!(&document_bytes(&to(Ngff::V05, &new)), &document_bytes(&old));
        // Others' content of 0.6 comes back from 0.5, too.
        let new = edit(&new, |of| {
            add(&mut of["coordinateSystems"][0], &keys[0]);
            add(&mut of["datasets"][1]["coordinateTransformations"][0], &keys[1]);
            let theirs = json!({ "name": "theirs", "axes": [] });
            of["coordinateSystems"].as_array_mut().unwrap().push(theirs);
            let to_theirs = json!({ "type": "bijection", "input": { "name": "physical" }, "output": { "name": "theirs" } });
            match of["coordinateTransformations"].as_array_mut() {
                Some(list) => list.push(to_theirs),
                None => of["coordinateTransformations"] = json!([to_theirs]),
            }
        });
        let back = to(Ngff::V05, &new);
        prop_assert_eq!(document_bytes(&to(Ngff::V06, &back)), document_bytes(&new));
    }
}

/// A document of 0.6 as others may write it: another name, other kinds of transformations.
#[test]
fn what_others_write_of_0_6_is_understood() {
    let numbers = |number: f64| vec![number; 5];
    let step = |kind: &str, number: f64| json!({ "type": kind, kind: numbers(number) });
    let identity = json!({ "type": "identity" });
    for (one, scale, translation) in [
        (step("scale", 2.0), 2.0, 0.0),
        (step("translation", 3.0), 1.0, 3.0),
        (identity.clone(), 1.0, 0.0),
        (json!({ "type": "sequence", "transformations": [step("translation", 3.0), step("scale", 2.0)] }), 2.0, 6.0),
        (
            json!({ "type": "sequence", "transformations": [step("scale", 2.0), identity, step("scale", 4.0)] }),
            8.0,
            0.0,
        ),
        (json!({ "type": "sequence", "transformations": [] }), 1.0, 0.0),
    ] {
        let document = edit(&to(Ngff::V06, &root(false)), |of| {
            of["coordinateSystems"][0]["name"] = json!("intrinsic");
            for k in 0..of["datasets"].as_array().unwrap().len() {
                let mut one = one.clone();
                one["input"] = json!({ "path": k.to_string() });
                one["output"] = json!({ "name": "intrinsic" });
                of["datasets"][k]["coordinateTransformations"] = json!([one]);
            }
        });
        let found = to(Ngff::V05, &document);
        let expected = json!([step("scale", scale), step("translation", translation)]);
        assert_eq!(multiscale(&found)["datasets"][0]["coordinateTransformations"], expected, "{one}");
        let again = to(Ngff::V06, &found);
        assert_eq!(multiscale(&again)["coordinateSystems"][0]["name"], "intrinsic");
        assert_eq!(multiscale(&again)["datasets"][1]["coordinateTransformations"][0]["output"]["name"], "intrinsic");
    }
}

#[test]
fn what_is_not_understood_is_refused_by_its_field() {
    let sound = to(Ngff::V06, &root(true));
    let affine =
        json!([{ "type": "affine", "input": { "path": "1" }, "output": { "name": "physical" }, "affine": [] }]);
    for (pointer, value, words) in [
        ("/datasets/1/coordinateTransformations", affine, "datasets[1].coordinateTransformations[0]"),
        ("/datasets/1/coordinateTransformations", json!([]), "datasets[1].coordinateTransformations"),
        ("/datasets/1/coordinateTransformations", json!(3), "datasets[1].coordinateTransformations"),
        (
            "/datasets/1/coordinateTransformations/0/output/name",
            json!("patient"),
            "datasets[1].coordinateTransformations[0].output.name",
        ),
        ("/datasets/0/coordinateTransformations/0/output/name", json!("none"), "coordinateSystems"),
        (
            "/datasets/0/coordinateTransformations/0/input",
            json!("0"),
            "datasets[0].coordinateTransformations[0].input.path",
        ),
        (
            "/datasets/1/coordinateTransformations/0/transformations/0/scale",
            json!([1, 2]),
            "datasets[1].coordinateTransformations[0]",
        ),
        (
            "/datasets/1/coordinateTransformations/0/transformations/0/scale/3",
            json!("1"),
            "datasets[1].coordinateTransformations[0]",
        ),
        (
            "/datasets/1/coordinateTransformations/0/transformations/0",
            json!({ "type": "sequence", "transformations": [] }),
            "datasets[1]",
        ),
        ("/coordinateSystems", json!("physical"), "coordinateSystems"),
        ("/coordinateSystems/0/axes", json!(null), "axes of \"physical\""),
        ("/coordinateTransformations", json!({}), "coordinateTransformations"),
        ("/datasets", json!([]), "coordinateSystems"),
    ] {
        let bad = edit(&sound, |of| *of.pointer_mut(pointer).unwrap() = value.clone());
        let message = refusal(Ngff::V05, &bad);
        let field = format!("attributes.ome.multiscales[0].{words}");
        let is_named =
            message.contains(PATH) && message.contains(words) && message.contains("attributes.ome.multiscales[0].");
        assert!(is_named, "{pointer} {value}: expected {field} in {message}");
    }
    let sound = root(false);
    for (pointer, value, words) in [
        ("/coordinateTransformations", json!([{ "type": "identity" }]), "coordinateTransformations"),
        ("/coordinateSystems", json!([]), "coordinateSystems"),
        (
            "/datasets/1/coordinateTransformations",
            json!([{ "type": "scale", "path": "s" }]),
            "datasets[1].coordinateTransformations",
        ),
    ] {
        let bad = edit(&sound, |of| match of.pointer_mut(pointer) {
            Some(place) => *place = value,
            None => of[&pointer[1..]] = value,
        });
        let message = refusal(Ngff::V06, &bad);
        assert!(message.contains(words), "{pointer}: {message}");
    }
    let mut clash = to(Ngff::V06, &root(false));
    clash["attributes"]["ome"]["multiscales"][0]["coordinateSystems"]
        .as_array_mut()
        .unwrap()
        .push(json!({ "name": "patient" }));
    let mut clash = to(Ngff::V05, &clash);
    clash["attributes"]["brickyard"]["orientation"] = root(true)["attributes"]["brickyard"]["orientation"].clone();
    assert!(refusal(Ngff::V06, &clash).contains("patient"));
}

#[test]
fn a_changed_system_of_the_patient_is_found() {
    let parsed = |document: &Value| Root::parse(Path::new(PATH), &document_bytes(document)).unwrap();
    let change = |document: &Value| parsed(document).patient_change(Path::new(PATH));
    let sound = to(Ngff::V06, &root(true));
    assert_eq!(change(&sound), None);
    assert_eq!([false, true].map(|is_oriented| change(&root(is_oriented))), [None, None]);
    assert_eq!(change(&to(Ngff::V06, &root(false))), None);
    for (pointer, value) in [
        ("/coordinateTransformations/0/affine/3/3", json!(0.3)),
        ("/coordinateTransformations/0/affine/3", json!([])),
        ("/coordinateSystems/1/axes/2/unit", json!("meter")),
        ("/coordinateSystems/1/name", json!("other")),
        ("/coordinateTransformations", json!([])),
    ] {
        let bad = edit(&sound, |of| *of.pointer_mut(pointer).unwrap() = value);
        let message = change(&bad).unwrap_or_default();
        assert!(message.contains("patient"), "{pointer}: {message}");
    }
}

#[test]
fn versions_have_names() {
    for ngff in Ngff::ALL {
        assert_eq!(ngff.name().parse(), Ok(ngff));
    }
    let message = "0.4".parse::<Ngff>().unwrap_err();
    assert!(message.contains("0.4") && message.contains("0.5 or 0.6"), "{message}");
}
