//! The library's examples, run like a newcomer's: users copy them.

use brickyard::volume::{Extent, Geometry, Picture};
use brickyard_tests::{FunctionSource, Sandbox, TestStore, assert_same, command, program, read_png};
use std::process::Command;

fn example(name: &str, arguments: &[&str], sandbox: &Sandbox) -> String {
    run(program(&format!("examples/{name}")).args(arguments), sandbox)
}

/// The output of a successful program.
fn run(program: &mut Command, sandbox: &Sandbox) -> String {
    let output = program.current_dir(sandbox.path("")).output().expect("the program starts");
    assert!(output.status.success(), "{program:?}: {}", String::from_utf8_lossy(&output.stderr));
    String::from_utf8(output.stdout).expect("text")
}

/// The number of a picture's colours.
fn colors(picture: &Picture) -> usize {
    picture.rgb.iter().collect::<std::collections::BTreeSet<_>>().len()
}

#[test]
fn the_examples_show_what_the_command_shows() {
    let sandbox = Sandbox::default();
    let ball = |centre: f64| {
        move |_, _, v: [u32; 3]| {
            let squares = v.map(|i| (f64::from(i) - centre).powi(2));
            (255.0 - 5.0 * squares.iter().sum::<f64>().sqrt()).max(0.0) as u8
        }
    };
    let extent = Extent::new(60, 60, 60);
    let stores =
        [25.0, 40.0].map(|at| TestStore::pack(&FunctionSource::new(extent, Geometry::default(), ball(at)), 16));
    let paths = stores.each_ref().map(|store| store.path().display().to_string());
    example("render", &[&paths[0], "render.png"], &sandbox);
    run(command().args(["render", &paths[0], "--size", "640x480", "-o", "command.png"]), &sandbox);
    let rendered = read_png(&sandbox.path("render.png"));
    assert_eq!(rendered, read_png(&sandbox.path("command.png")));
    assert!(colors(&rendered) > 50, "a flat picture");
    let frames = example("fly", &[&paths[0], "fly.png"], &sandbox);
    assert_eq!(frames.lines().count(), 36, "{frames}");
    assert!(colors(&read_png(&sandbox.path("fly.png"))) > 50, "a flat picture");
    example("layers", &[&paths[0], &paths[1], "layers.png"], &sandbox);
    let layered = read_png(&sandbox.path("layers.png"));
    assert!(layered.rgb.iter().any(|[r, g, _]| u32::from(*g) > 2 * u32::from(*r) && *g > 20), "nothing glows green");
}

#[test]
fn bricks_of_its_own_cost_what_the_picture_shows() {
    let sandbox = Sandbox::default();
    let said = example("own_bricks", &["gyroid.png"], &sandbox);
    let computed = said.split(' ').nth(1).and_then(|mib| mib.parse::<u64>().ok());
    assert!(computed.is_some_and(|mib| mib < 1000) && said.contains("of 64 GiB"), "{said}");
    let alone = read_png(&sandbox.path("gyroid.png"));
    assert!(colors(&alone) > 50, "a flat picture");
    // The same on the program's own device, beside its triangles.
    let said = example("embed", &["embed.png", "1"], &sandbox);
    assert!(said.contains("waited for the GPU in these calls: at most 0.0 ms"), "{said}");
    let beside = read_png(&sandbox.path("embed.png"));
    let rows = beside.rgb.chunks_exact(beside.width as usize);
    let rgb = rows.flat_map(|row| &row[..alone.width as usize]).copied().collect();
    assert_same(&Picture { rgb, ..alone.clone() }, &alone, "embedded");
    assert!(beside.rgb.contains(&[255, 128, 0]), "no triangles");
}
