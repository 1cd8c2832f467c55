//! The command among other programs: pipes that its results go into, and hands that stop it.

use brickyard_tests::{Sandbox, tree};
use std::path::Path;

/// A view of the store `a.zarr`, at its finest level.
const VIEW: &str = "--eye 300,200,200 --target 48,48,48 --level 0 --size 64x64 --backend cpu";

/// A store of 6x6x6 bricks in shards of 2x2x2, to which each part of a test's own is done.
fn with_store() -> Sandbox {
    let sandbox = Sandbox::in_memory();
    sandbox.run_ok("synth ct a.zarr --shape 96,96,96 --brick 16 --shard 32 --progress none");
    sandbox
}

/// Damages the bricks of `a.zarr` at level 0.
fn damage(sandbox: &Sandbox) {
    for (path, mut bytes) in tree(&sandbox.path("a.zarr/0/c")) {
        let data = bytes.len().saturating_sub(200);
        bytes[..data].iter_mut().step_by(300).for_each(|byte| *byte ^= 1);
        sandbox.write(Path::new("a.zarr/0/c").join(path), bytes);
    }
}

fn json(text: &str) -> serde_json::Value {
    serde_json::from_str(text).unwrap_or_else(|error| panic!("{error}: {text}"))
}

#[test]
fn data_on_standard_output_are_alone_there() {
    let sandbox = with_store();
    let quality = "quality a.zarr -o quality --size 16x16 --samples-per-voxel 1 --methods udvr --filters trilinear --lightings none --frames 2 \
                   --json";
    let bench = "bench a.zarr --scenario still --frames 2 --size 32x32 --backend cpu";
    for line in [
        "info a.zarr --json",
        "probe a.zarr 40,40,40 --json",
        "verify a.zarr --json --progress plain",
        &format!("{bench} --json"),
        &format!("{bench} --stats -"),
        &format!("{bench} --json --stats -"),
        &format!("render a.zarr -o a.png {VIEW} --stats -"),
        quality,
    ] {
        json(&sandbox.run_ok(&format!("-v {line}")));
    }
    assert_eq!(json(&String::from_utf8(sandbox.read("quality/quality.json")).unwrap())["frames"], 2);
    assert!(!sandbox.path("-").exists(), "a file of that name");
}

#[test]
fn nothing_is_coloured_in_pipes() {
    let sandbox = with_store();
    damage(&sandbox);
    for line in [&format!("render a.zarr -o a.png {VIEW}"), "-v export a.zarr a.raw", "render --help", "pack --no-such"]
    {
        let (_, stdout, stderr) = sandbox.run(line);
        assert!(!stdout.contains('\u{1b}') && !stderr.contains('\u{1b}'), "{line}: {stdout:?}{stderr:?}");
        // What the log says is among it.
        assert!(!line.contains("a.png") || stderr.contains("WARN"), "{stderr}");
    }
}

/// However many bricks are damaged: a few are named where a picture is drawn, all of them by `verify`, and the last line has their number.
#[test]
fn damage_is_summed_up_in_a_line() {
    let sandbox = with_store();
    damage(&sandbox);
    let (code, stdout, stderr) = sandbox.run("verify a.zarr --progress none");
    assert_eq!(code, 5, "{stderr}");
    let count = stdout.lines().count();
    assert!(count > 100 && stdout.lines().all(|line| line.contains("level 0 brick")), "{stdout}");
    assert_eq!(
        stderr,
        format!("error: a.zarr: {count} of 252 bricks are damaged, in level 0, time step 0, channel 0\n")
    );
    let (code, _, stderr) = sandbox.run(&format!("render a.zarr -o a.png {VIEW}"));
    assert_eq!(code, 0, "{stderr}");
    assert_eq!(stderr.lines().filter(|line| line.contains("a coarser brick stands in")).count(), 3, "{stderr}");
    assert_eq!(stderr.lines().filter(|line| line.contains("bricks could not be read")).count(), 1, "{stderr}");
}
