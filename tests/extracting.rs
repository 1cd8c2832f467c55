//! Meshes by the command: exit codes, messages, and what they leave behind.

use brickyard_tests::Sandbox;

/// A ramp of bytes along x, and labels 0, 5 and 9 in thirds of it.
fn sandbox() -> Sandbox {
    let sandbox = Sandbox::default();
    let of_each = |value: fn(u8) -> u8| -> Vec<u8> { (0..30 * 20 * 20u32).map(|i| value((i % 30) as u8)).collect() };
    sandbox.write("ramp.raw", of_each(|x| x));
    sandbox.write("labels.raw", of_each(|x| [0, 5, 9][usize::from(x / 10)]));
    let raw = "--shape 30,20,20 --dtype u8 --brick 8 --shard 16 --spacing 0.5,1,2 --unit mm --progress none";
    sandbox.run_ok(&format!("pack ramp.raw ramp.zarr {raw}"));
    sandbox.run_ok(&format!("pack labels.raw labels.zarr {raw} --kind labels"));
    sandbox
}

#[test]
fn the_findings_are_printed_and_the_file_is_shown_in_a_scene() {
    let sandbox = sandbox();
    let found = sandbox.json("mesh ramp.zarr ramp.stl --isovalue 14.5 --json --progress none");
    let object = &found["objects"][0];
    // From 14.5 to the volume's end at 29.5, in a box whose edges are cut off.
    let volume = object["volume"].as_f64().expect("a number");
    assert!((volume / (15.0 * 0.5 * 20.0 * 20.0 * 2.0) - 1.0).abs() < 0.01 && found["unit"] == "millimeter", "{found}");
    let triangles = object["triangles"].as_u64().expect("a number");
    assert_eq!(sandbox.read("ramp.stl").len() as u64, 84 + 50 * triangles);
    sandbox.run_ok("render ramp.zarr -o a.png --size 32x32 --backend cpu --mesh ramp.stl");
    let found = sandbox.json("mesh labels.zarr labels.glb --label all --json --progress none");
    let labels: Vec<_> = found["objects"].as_array().expect("a list").iter().map(|object| &object["label"]).collect();
    assert_eq!(labels, [5, 9]);
    for object in found["objects"].as_array().expect("a list") {
        assert!((object["volume"].as_f64().expect("a number") - 4000.0).abs() < 1e-6, "{found}");
    }
}

#[test]
fn refusals_have_their_exit_codes_and_leave_nothing() {
    let sandbox = sandbox();
    sandbox.write("mine.ply", "mine");
    let before = std::fs::read_dir(sandbox.path("")).expect("a folder").count();
    for (line, code, word) in [
        ("ramp.zarr a.ply", 2, "--isovalue"),
        ("ramp.zarr a.ply --isovalue 3 --label 5", 2, "--label"),
        ("ramp.zarr a.ply --isovalue nan", 2, "finite"),
        ("ramp.zarr a.ply --isovalue 30", 2, "from 0 to 29"),
        ("ramp.zarr a.ply --isovalue 3 --memory 1MiB", 2, "--memory 1 MiB is too little"),
        ("ramp.zarr a.ply --isovalue 3 --roi 0:31,0:1,0:1", 2, "box 0:31,0:1,0:1 is outside"),
        ("ramp.zarr a.ply --isovalue 3 --smooth 21", 2, "at most 20"),
        ("ramp.zarr a.off --isovalue 3", 2, ".stl, .ply, .obj or .glb"),
        ("ramp.zarr no/a.ply --isovalue 3", 2, "there is no folder"),
        ("ramp.zarr ramp.zarr/a.ply --isovalue 3", 2, "ramp.zarr"),
        ("ramp.zarr mine.ply --isovalue 3", 2, "--overwrite"),
        ("ramp.zarr a.ply --label 5", 2, "--kind labels"),
        ("labels.zarr a.ply --isovalue 3", 2, "choose a label"),
        ("labels.zarr a.ply --label 6", 2, "did you mean 5 or 9?"),
        ("labels.zarr a.ply --label 9 --roi 0:10,0:10,0:10", 2, "in this box"),
        ("labels.zarr a.ply --label all", 2, ".obj or .glb"),
        ("labels.zarr a.ply --label some", 2, "or all"),
        ("none.zarr a.ply --isovalue 3", 3, "none.zarr"),
    ] {
        let (found, _, said) = sandbox.run(&format!("mesh {line} --progress none"));
        assert!(found == code && said.contains(word), "{line}: {found}, {said}");
    }
    std::fs::remove_file(sandbox.path("ramp.zarr/0/c/0/0/0")).expect("a shard");
    let (code, _, said) = sandbox.run("mesh ramp.zarr a.ply --isovalue 3 --progress none");
    assert!(code == 3 && said.contains("missing shard"), "{said}");
    assert_eq!(std::fs::read_dir(sandbox.path("")).expect("a folder").count(), before);
    assert_eq!(sandbox.read("mine.ply"), b"mine");
}
