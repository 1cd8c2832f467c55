//! The window and its files, on its own display (Xvfb): volumes and meshes are added, a scene file brings its volumes, an empty window opens some,
//! voxels and meshes are exported and metadata edited like by the command.

use brickyard::volume::{Extent, Geometry};
#[cfg(target_os = "linux")]
use brickyard_tests::faults::harm;
use brickyard_tests::{Display, FunctionSource, Sandbox, TestStore, read_png};
use serde_json::{Value, json};

fn store(edge: u32) -> TestStore {
    let value = |[x, y, z]: [u32; 3]| (x * 7 + y * 13 + z * 29) as u8;
    let extent = Extent::new(edge, edge - 7, edge - 4);
    TestStore::pack(&FunctionSource::series(extent, Geometry::default(), 2, 1, move |_, _, v| value(v)), 16)
}

/// Plays a script in a window drawn by the CPU. Returns the exit code and the messages.
fn play_to_end(display: &Display, sandbox: &Sandbox, arguments: &[&str], script: &str) -> (Option<i32>, String) {
    sandbox.write("script.txt", script);
    let arguments = [arguments, &["--backend", "cpu", "--size", "900x600", "--script", "script.txt"]].concat();
    let ended = display.view(sandbox.path(".").as_path(), &arguments).output().expect("it runs");
    (ended.status.code(), String::from_utf8_lossy(&ended.stderr).into_owned())
}

/// Plays a script without failure.
fn play(display: &Display, sandbox: &Sandbox, arguments: &[&str], script: &str) {
    let (code, said) = play_to_end(display, sandbox, arguments, script);
    assert!(code == Some(0), "{code:?}: {said}");
}

fn document(sandbox: &Sandbox, name: &str) -> Value {
    serde_json::from_slice(&sandbox.read(name)).expect("a document")
}

#[test]
fn an_export_is_what_the_command_exports_of_the_clip_box() {
    let (Some(display), test, sandbox) = (Display::start(), store(40), Sandbox::in_memory()) else { return };
    let path = test.path().display().to_string();
    // Voxel 0 is centred in the world's origin.
    let script = "0 set time 1\n0 set clip [[2.5, 3.9, -9], [30.5, 17.2, 29.5]]\n\
        0 set layers.0.crop [[0, 0, 2], [40, 33, 99]]\n0 export box.npy\nsettled export box.raw\nsettled quit\n";
    play(&display, &sandbox, &[&path], script);
    for name in ["box.npy", "box.raw"] {
        sandbox.run_ok(&format!("export {path} expected-{name} --time 1 --roi 3:31,4:18,2:30"));
        assert!(sandbox.read(name) == sandbox.read(format!("expected-{name}")), "{name} is another box");
    }
}

#[test]
fn volumes_and_meshes_are_added_and_a_scene_file_brings_them() {
    let (Some(display), sandbox) = (Display::start(), Sandbox::in_memory()) else { return };
    let (first, second) = (store(40), store(30));
    let [a, b] = [&first, &second].map(|store| store.path().display().to_string());
    sandbox.write("part.obj", "v 0 0 0\nv 9 0 0\nv 0 9 0\nf 1 2 3\n");
    let script = format!(
        "0 set layers.0.window [40, 210]\n0 add {}\nsettled save-scene added.json\nsettled undo\nsettled undo\n\
        settled save-scene undone.json\nsettled quit\n",
        json!([b, "part.obj"])
    );
    play(&display, &sandbox, &[&a], &script);
    let added = document(&sandbox, "added.json");
    assert_eq!(added["window"]["volumes"], json!([a, b]));
    let layers = added["layers"].as_array().expect("layers");
    assert_eq!((layers.len(), &layers[0]["window"], &layers[1]["source"]), (2, &json!([40.0, 210.0]), &json!(1)));
    assert!(added["meshes"][0]["path"].as_str().is_some_and(|path| path.ends_with("/part.obj")));
    let undone = document(&sandbox, "undone.json");
    assert_eq!((&undone["layers"].as_array().map(Vec::len), &undone["meshes"]), (&Some(1), &json!([])));
    // Without paths the scene's own volumes are opened.
    play(&display, &sandbox, &["--scene", "added.json"], "settled save-scene again.json\nsettled quit\n");
    let again = document(&sandbox, "again.json");
    assert_eq!((&again["layers"], &again["window"]["volumes"]), (&added["layers"], &added["window"]["volumes"]));
}

#[test]
fn an_empty_window_opens_what_it_is_told_to() {
    let (Some(display), test, sandbox) = (Display::start(), store(40), Sandbox::in_memory()) else { return };
    let path = test.path().display().to_string();
    let script = format!(
        "settled screenshot empty.png\n0 add {path}\nsettled save-scene opened.json\n\
        settled save-picture 320x200 picture.png\nsettled quit\n"
    );
    play(&display, &sandbox, &[], &script);
    let opened = document(&sandbox, "opened.json");
    assert_eq!((&opened["window"]["volumes"], opened["layers"].as_array().map(Vec::len)), (&json!([path]), Some(1)));
    let picture = read_png(&sandbox.path("picture.png"));
    assert_eq!((picture.width, picture.height), (320, 200));
    assert!(picture.rgb.iter().any(|pixel| *pixel != picture.rgb[0]), "the volume is not in it");
    assert!(sandbox.path("empty.png").exists());
    let (code, _, said) = brickyard_tests::run(&["view", "--mode", "mip"]);
    assert!(code == 2 && said.contains("name the volumes"), "{code}: {said}");
}

#[test]
fn a_file_that_does_not_open_is_named_once() {
    let (Some(display), test, sandbox) = (Display::start(), store(40), Sandbox::in_memory()) else { return };
    let path = test.path().display().to_string();
    let script = format!("0 open {}\nsettled quit\n", json!([path, "no-such.zarr"]));
    let (code, said) = play_to_end(&display, &sandbox, &[], &script);
    let is_told = said.contains("no-such.zarr: No such file") && !said.contains("no-such.zarr: no-such.zarr");
    assert!(code == Some(1) && is_told, "{code:?}: {said}");
}

/// All files below a folder, with their content.
#[cfg(target_os = "linux")]
fn files(folder: &std::path::Path) -> Vec<(std::path::PathBuf, Vec<u8>)> {
    let entries = std::fs::read_dir(folder).expect("a folder").map(|entry| entry.expect("an entry").path());
    let mut found: Vec<_> = entries
        .flat_map(
            |path| if path.is_dir() { files(&path) } else { vec![(path.clone(), std::fs::read(&path).expect("read"))] },
        )
        .collect();
    found.sort();
    found
}

#[cfg(target_os = "linux")]
#[test]
fn a_full_disk_is_said_and_leaves_what_was_there() {
    let (Some(display), test, sandbox) = (Display::start(), store(40), Sandbox::in_memory()) else { return };
    let path = test.path().display().to_string();
    let under = sandbox.path("").canonicalize().expect("the sandbox is there");
    let names = ["scene.json", "picture.png", "screen.png"];
    names.iter().for_each(|name| sandbox.write(name, "what was there"));
    sandbox.write("scan.raw", vec![7; 30 * 20 * 10]);
    let commands = [
        ("save-scene scene.json", "scene.json"),
        ("save-picture picture.png", "picture.png"),
        ("screenshot screen.png", "screen.png"),
        ("export box.npy", "box.npy"),
        ("open scan.raw", "scan"),
    ];
    let script = |name: &str| format!("{name}.txt");
    commands
        .iter()
        .for_each(|(command, name)| sandbox.write(script(name), format!("settled {command}\nsettled quit\n")));
    let before = files(&under);
    for (command, name) in commands {
        let (script, like) = (script(name), ["--shape", "30,20,10", "--dtype", "u8"]);
        let mut view = display.view(&under, &[&path, "--backend", "cpu", "--script", &script]);
        harm(view.args(like), &under, "write 1+ ENOSPC");
        let ended = view.output().expect("it runs");
        let said = String::from_utf8_lossy(&ended.stderr).into_owned();
        let is_told = |line: &str| line.contains(name) && line.contains("No space left on device");
        assert!(ended.status.code() == Some(1) && said.lines().any(is_told), "{command}: {:?}: {said}", ended.status);
    }
    // The folder of the unfinished pack is resumed the next time.
    let after: Vec<_> = files(&under).into_iter().filter(|(path, _)| !path.starts_with(under.join("cache"))).collect();
    let name = |files: &[(std::path::PathBuf, _)]| files.iter().map(|(path, _)| path.clone()).collect::<Vec<_>>();
    assert!(after == before, "{:?} instead of {:?}", name(&after), name(&before));
}

#[cfg(target_os = "linux")]
#[test]
fn a_state_that_cannot_be_kept_leaves_the_one_before() {
    let (Some(display), test, sandbox) = (Display::start(), store(40), Sandbox::in_memory()) else { return };
    let path = test.path().display().to_string();
    let under = sandbox.path("").canonicalize().expect("the sandbox is there");
    let run = |key: &str, rule: &str| {
        let mut view = display.view(&under, &[&path, "--backend", "cpu"]);
        harm(&mut view, &under, rule);
        let window = view.stderr(std::process::Stdio::piped()).spawn().expect("it runs");
        display.focus();
        // The window is visible some frames before it has the keyboard.
        display.input(&format!("sleep 0.5 key {key} sleep 0.5 key ctrl+q"));
        let ended = window.wait_with_output().expect("it ends");
        assert!(ended.status.success());
        String::from_utf8_lossy(&ended.stderr).into_owned()
    };
    run("alt+2", "");
    let windows = under.join("state/brickyard/windows");
    let kept = files(&windows);
    assert!(!kept.is_empty(), "nothing is kept");
    let said = run("alt+3", "write 1+ ENOSPC windows/");
    assert!(said.contains("cannot be kept") && said.contains("No space left on device"), "{said}");
    assert!(files(&windows) == kept, "another state is kept");
}

#[test]
fn a_file_opens_with_what_is_said_of_it() {
    let (Some(display), sandbox) = (Display::start(), Sandbox::in_memory()) else { return };
    let values: Vec<u8> = (0..20 * 16 * 12u32).map(|i| (i % 7) as u8).collect();
    std::fs::write(sandbox.path("labels.raw"), values).expect("written");
    let said = json!({
        "path": "labels.raw", "shape": [20, 16, 12], "voxel_type": "u8", "labels": true,
        "spacing": [0.5, 0.5, 2.0], "unit": "micrometer",
    });
    let (code, asked) = play_to_end(&display, &sandbox, &[], "0 open labels.raw\nsettled quit\n");
    assert!(code == Some(1) && asked.contains("labels.raw"), "{code:?}: {asked}");
    let wrong = json!({"path": "labels.raw", "shape": [3, 3, 3], "voxel_type": "u8"});
    let script = format!("0 open-as {wrong}\nsettled save-scene wrong.json\nsettled quit\n");
    let (code, refused) = play_to_end(&display, &sandbox, &[], &script);
    assert!(
        code == Some(1) && refused.contains("line 1") && !sandbox.path("wrong.json").exists(),
        "{code:?}: {refused}"
    );
    play(&display, &sandbox, &[], &format!("0 open-as {said}\nsettled save-scene opened.json\nsettled quit\n"));
    let opened = document(&sandbox, "opened.json");
    assert!(opened["window"]["volumes"][0].as_str().is_some_and(|path| path.ends_with("labels.raw")), "{opened}");
    let target = opened["camera"]["target"].clone();
    // The first voxel's centre is the origin: 20 x 16 x 12 voxels of 0.5 x 0.5 x 2.
    assert_eq!(target, json!([4.75, 3.75, 11.0]));
}

/// Whether each edge of a binary STL file's triangles has as many triangles in one direction as in the other.
fn is_closed(stl: &[u8]) -> bool {
    let mut edges = std::collections::HashMap::<[[u8; 12]; 2], i64>::new();
    for triangle in stl[84..].chunks_exact(50) {
        let corner = |i: usize| <[u8; 12]>::try_from(&triangle[12 + 12 * i..24 + 12 * i]).expect("three numbers");
        for [a, b] in [[0, 1], [1, 2], [2, 0]].map(|edge| edge.map(corner)) {
            *edges.entry([a, b]).or_default() += 1;
            *edges.entry([b, a]).or_default() -= 1;
        }
    }
    !edges.is_empty() && edges.values().all(|balance| *balance == 0)
}

#[test]
fn scripts_make_meshes_and_edit() {
    let (Some(display), test, sandbox) = (Display::start(), store(40), Sandbox::in_memory()) else { return };
    let path = test.path().display().to_string();
    let script = "0 set clip [[2.5, 3.9, -9], [30.5, 17.2, 29.5]]\n0 mesh isovalue=120 level=1 smooth=3 part.obj\n\
        settled mesh isovalue=120.5 part.stl\nsettled export level=1 steps=0-1 part.npy\nsettled export level=1 replace=yes part.npy\n\
        settled edit {\"unit\": \"mm\", \"channel_names\": {\"0\": \"DAPI\"}}\nsettled save-scene kept.json\nsettled quit\n";
    play(&display, &sandbox, &[&path], script);
    sandbox.run_ok(&format!("mesh {path} expected.obj --isovalue 120 --level 1 --smooth 3 --roi 1:16,2:9,0:15"));
    sandbox.run_ok(&format!("export {path} expected.npy --level 1 --roi 1:16,2:9,0:15"));
    assert!(sandbox.read("part.npy") == sandbox.read("expected.npy"), "another box");
    let lines = |name: &str| {
        let text = String::from_utf8(sandbox.read(name)).expect("text");
        // The unit was edited between.
        text.lines().filter(|line| !line.starts_with('#')).map(str::to_owned).collect::<Vec<_>>()
    };
    assert!(lines("part.obj") == lines("expected.obj"), "another surface");
    let mesh = sandbox.read("part.stl");
    assert!(is_closed(&mesh) && !is_closed(&mesh[..mesh.len() - 50]), "it is open, or a missing triangle is not seen");
    // Another unit or name is no other place.
    assert_eq!(document(&sandbox, "kept.json")["clip"], json!([[2.5, 3.9, -9.0], [30.5, 17.2, 29.5]]));
    let said = sandbox.run_ok(&format!("info {path} --json"));
    assert!(said.contains("millimeter") && said.contains("DAPI"), "{said}");
    for (command, why) in [
        ("mesh isovalue=1e9 high.stl", "no surface at 1000000000"),
        ("mesh label=3 part.stl", "holds no labels"),
        ("export part.npy", "exists already"),
        ("edit {\"spacing\": [1, 0, 1]}", "spacing"),
        ("edit {\"unit\": \"mm\"}", "nothing to change"),
    ] {
        let (code, said) = play_to_end(&display, &sandbox, &[&path], &format!("0 {command}\nsettled quit\n"));
        assert!(code == Some(1) && said.contains(why) && said.contains("line 1"), "{command}: {code:?}: {said}");
    }
}
