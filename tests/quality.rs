//! `brickyard quality`: its output, figures behaving like sampling errors, and refusals.

use brickyard_tests::Sandbox;
use serde_json::Value;

const FEW: &str = "--size 96x96 --methods udvr,pdvr --filters trilinear --lightings none --frames 6 -j 2";

/// Two layers thinner than a voxel, which plain samples miss.
const LAYERS: &str = r#"{ "color": [[0, 0.2, 0.5, 1.0], [255, 1.0, 0.8, 0.5]],
    "opacity": [[92, 0], [100, 0.4], [108, 0], [128, 0], [136, 0.7], [144, 0]], "unit_distance": 1.0 }"#;

fn with_store() -> Sandbox {
    let sandbox = Sandbox::default();
    sandbox.run_ok("synth marschner-lobb ml.zarr --shape 48,48,48 --progress none");
    sandbox
}

fn rows(sandbox: &Sandbox, folder: &str) -> Vec<Value> {
    let table: Value = serde_json::from_slice(&sandbox.read(format!("{folder}/quality.json"))).expect("a table");
    table["rows"].as_array().expect("rows").clone()
}

fn number(row: &Value, field: &str) -> f64 {
    row[field].as_f64().unwrap_or_else(|| panic!("{field} of {row}"))
}

#[test]
fn more_samples_are_better_and_everything_is_written() {
    let sandbox = with_store();
    sandbox.write("layers.json", LAYERS);
    let flags = "--samples-per-voxel 0.5,1,2 --transfer layers.json";
    let printed = sandbox.run_ok(&format!("quality ml.zarr -o q {FEW} {flags}"));
    let rows = rows(&sandbox, "q");
    assert_eq!(rows.len(), 6);
    for of_method in rows.chunks(3) {
        for field in ["rgb_db", "ycbcr_db", "hsl_db", "truth_db"] {
            let db: Vec<f64> = of_method.iter().map(|row| number(row, field)).collect();
            // Twice as many samples at least halve the error, 6 dB, once they hit every layer; with fewer, half of that.
            assert!(db[0] + 3.0 < db[1] && db[1] + 3.0 < db[2], "{field}: {db:?}");
        }
        assert!(number(&of_method[0], "cpu_ms") > 0.0);
    }
    assert!(number(&rows[3], "rgb_db") > number(&rows[0], "rgb_db"), "pre-integrated is better than plain");
    for file in ["psnr-trilinear-none-udvr-0.5.png", "psnr-trilinear-none-pdvr-2.png"] {
        assert_eq!(&sandbox.read(format!("q/{file}"))[1..4], b"PNG");
    }
    for file in ["curves.svg", "curves-truth.svg"] {
        let text = String::from_utf8(sandbox.read(format!("q/{file}"))).expect("text");
        assert!(text.contains("<svg") && text.contains("pdvr"));
    }
    assert!(printed.contains("| trilinear | none | pdvr | 2 |") && printed.contains("| The paper |"), "{printed}");
}

#[test]
fn functions_of_value_and_gradient_are_measured_by_what_can_show_them() {
    let sandbox = with_store();
    let flags = "--size 24x24 --filters trilinear --lightings none --frames 3 --samples-per-voxel 1,2 --gradient-opacity 1:0,9:1";
    sandbox.run_ok(&format!("quality ml.zarr -o q {flags}"));
    let rows = rows(&sandbox, "q");
    let names: Vec<_> = rows.iter().step_by(2).map(|row| row["method"].clone()).collect();
    assert_eq!(names, ["udvr", "lvs", "cvs", "asm"]);
    for of_method in rows.chunks(2) {
        let [once, twice] = [0, 1].map(|i| number(&of_method[i], "truth_db"));
        assert!(once > 15.0 && twice > once, "{} and {}", of_method[0], of_method[1]);
    }
}

#[test]
fn the_distance_of_the_camera_hardly_matters() {
    let sandbox = with_store();
    let mut found = Vec::new();
    for (folder, eye) in [("near", "-90,24,24"), ("far", "-204,24,24")] {
        let view = format!("--eye {eye} --target 24,24,24");
        sandbox.run_ok(&format!("quality ml.zarr -o {folder} {FEW} {view} --samples-per-voxel 1"));
        found.push(rows(&sandbox, folder).swap_remove(0));
    }
    let pixels = number(&found[0], "pixels") / number(&found[1], "pixels");
    assert!(pixels > 3.0, "{pixels}");
    // The whole picture's figure would differ by 10 log 4 = 6 dB.
    let apart = number(&found[0], "rgb_db") - number(&found[1], "rgb_db");
    assert!(apart.abs() < 2.0, "{apart} dB");
}

#[test]
fn what_cannot_be_measured_is_refused() {
    let sandbox = with_store();
    std::fs::create_dir(sandbox.path("full")).expect("the sandbox is writable");
    sandbox.write("full/file", "");
    sandbox.write("file", "");
    for (flags, words) in [
        ("-o q --frames 0", "0 is not in 2"),
        ("-o q --frames 1", "1 is not in 2"),
        ("-o q --virtual-samples 0", "0 is not in 1"),
        ("-o q --virtual-samples 3,17", "17 is not in 1"),
        ("-o q --samples-per-voxel 0", "positive"),
        ("-o q --samples-per-voxel=-1", "positive"),
        ("-o q --samples-per-voxel 2,1", "rising"),
        ("-o q --methods best", "best"),
        ("-o q --methods udvr,plvs --gradient-opacity 1:0,9:1", "plvs is pre-integrated"),
        ("-o q --mode mip", "direct volume rendering"),
        ("-o q --stereo anaglyph", "--stereo"),
        // A survey's own settings, which a flag would appear to change.
        ("-o q --method pdvr", "unexpected argument '--method'"),
        ("-o q --filter tricubic", "unexpected argument '--filter'"),
        ("-o q --lighting phong", "unexpected argument '--lighting'"),
        ("-o q --jitter blue", "unexpected argument '--jitter'"),
        ("-o q --step 2", "unexpected argument '--step'"),
        ("-o q --level 1", "unexpected argument '--level'"),
        ("-o full", "not empty"),
        ("-o file", "expected a folder"),
    ] {
        let (code, _, stderr) = sandbox.run(&format!("quality ml.zarr {flags}"));
        assert_eq!(code, 2, "{flags}: {stderr}");
        assert!(stderr.contains(words), "{flags}: {stderr}");
        assert!(!sandbox.path("q").exists(), "{flags}");
    }
}
