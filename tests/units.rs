//! Units of values and axes, from the command line into stores and out of every command that says values and places.

use brickyard_tests::Sandbox;
use serde_json::json;

const PACK: &str = "pack map.raw map.zarr --shape 6,5,4 --dtype u8 --spacing 0.5,0.5,25 --origin 10,60,100 --progress none \
                    --value-unit kg/m\u{b3}";

fn packed(units: &str) -> Sandbox {
    let sandbox = Sandbox::default();
    sandbox.write("map.raw", (0..120).collect::<Vec<u8>>());
    sandbox.run_ok(&format!("{PACK} --unit {units}"));
    sandbox.run_ok("verify map.zarr --progress none");
    sandbox
}

#[test]
fn unlike_axes_and_values_have_their_units_everywhere() {
    let sandbox = packed("degree,degree,hPa");
    let text = sandbox.run_ok("info map.zarr");
    assert!(text.contains("spacing 0.5 x 0.5 x 25 (degree, degree, hPa)"), "{text}");
    assert!(text.contains("channel 0 in kg/m\u{b3}: values 0 to 119"), "{text}");
    let info = sandbox.json("info map.zarr --json");
    let axes = json!(["degree", "degree", "hPa"]);
    assert_eq!((&info["unit"], &info["axis_units"]), (&json!(null), &axes));
    assert_eq!(info["store"]["channels"][0]["unit"], "kg/m\u{b3}");
    assert_eq!(info["displays"][0]["unit"], "kg/m\u{b3}");
    let text = sandbox.run_ok("probe map.zarr 1,0,2 --voxel");
    assert!(text.contains("centre at 10.5 degree, 60 degree, 150 hPa"), "{text}");
    assert!(text.contains("channel 0: 61 kg/m\u{b3}"), "{text}");
    let found = sandbox.json("probe map.zarr 1,0,2 --voxel --json");
    assert_eq!((&found["unit"], &found["axis_units"]), (&json!(null), &axes));
    assert_eq!(found["channels"][0], json!({ "name": null, "unit": "kg/m\u{b3}", "value": 61.0 }));
    assert!(sandbox.run_ok("probe map.zarr 1,0,2 --voxel --csv").starts_with("step,time,channel 0 (kg/m\u{b3})\n"));
    // OME-Zarr allows lengths alone along axes of space.
    let root = String::from_utf8(sandbox.read("map.zarr/zarr.json")).unwrap();
    let root: serde_json::Value = serde_json::from_str(&root).unwrap();
    let axes = root["attributes"]["ome"]["multiscales"][0]["axes"].as_array().unwrap().clone();
    assert!(axes.iter().all(|axis| axis.get("unit").is_none()), "{axes:?}");
}

#[test]
fn lengths_are_converted_to_one_unit() {
    let sandbox = packed("um,um,mm");
    let info = sandbox.json("info map.zarr --json");
    assert_eq!((&info["unit"], &info["axis_units"]), (&json!("micrometer"), &json!(null)));
    assert_eq!((&info["spacing"], &info["origin"]), (&json!([0.5, 0.5, 25000.0]), &json!([10.0, 60.0, 100000.0])));
    // The same pack again is the same store, and another unit another.
    assert!(sandbox.run_ok(&format!("{PACK} --unit um,um,mm --resume")).is_empty());
    let (code, _, stderr) = sandbox.run(&format!("{PACK} --unit um,um,m --resume"));
    assert!(code != 0 && stderr.contains("settings"), "{code}: {stderr}");
}

#[test]
fn bad_units_are_refused_with_the_flag() {
    let sandbox = packed("mm");
    for (flags, word) in [
        ("--unit mm,mm", "--unit"),
        ("--unit mm,,mm", "--unit"),
        ("--value-unit=", "--value-unit"),
        ("--kind labels --downsample mode --value-unit K", "labels have no unit"),
    ] {
        let (code, _, stderr) = sandbox.run(&format!("pack map.raw bad.zarr --shape 6,5,4 --dtype u8 {flags}"));
        assert!(code == 2 && stderr.contains(word), "{flags}: {code}: {stderr}");
    }
    let other = "append map.zarr map.raw --shape 6,5,4 --dtype u8 --spacing 0.5,0.5,25 --origin 10,60,100 --unit mm";
    let (code, _, stderr) = sandbox.run(&format!("{other} --value-unit K"));
    assert!(code != 0 && stderr.contains("unit of values is K") && stderr.contains("--value-unit"), "{code}: {stderr}");
}
