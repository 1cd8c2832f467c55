//! The command among other programs: pipes for its results, and interrupts.

use crate::bad_input::nifti_header;
use brickyard_tests::{Sandbox, tree, tree_difference};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// A view of the store `a.zarr`, at its finest level.
const VIEW: &str = "--eye 300,200,200 --target 48,48,48 --level 0 --size 64x64 --backend cpu";

/// A store of 6x6x6 bricks in shards of 2x2x2, for separate parts of a test.
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
        // It includes log lines.
        assert!(!line.contains("a.png") || stderr.contains("WARN"), "{stderr}");
    }
}

/// A colour edited by another program is no damage; an invalid one is.
#[test]
fn edited_looks_are_noted_and_sound() {
    let sandbox = with_store();
    let root = sandbox.path("a.zarr/zarr.json");
    let packed = std::fs::read_to_string(&root).expect("it is packed");
    for (color, expected, said) in [
        (
            "00FF00",
            0,
            "note: a.zarr/zarr.json: attributes.ome.omero.channels[0].color: \"00FF00\", packed as \"FFFFFF\"",
        ),
        ("green", 5, "error: a.zarr: 1 problem"),
    ] {
        let edited = packed.replace("\"color\": \"FFFFFF\"", &format!("\"color\": \"{color}\""));
        assert_ne!(edited, packed);
        std::fs::write(&root, edited).expect("it is ours");
        let (code, stdout, stderr) = sandbox.run("verify a.zarr --progress none");
        assert!(code == expected && stderr.starts_with(said), "exit {code}: {stdout}{stderr}");
        let (_, json, _) = sandbox.run("verify a.zarr --progress none --json");
        let report: serde_json::Value = serde_json::from_str(&json).expect("JSON");
        let count = |name: &str| report[name].as_array().expect("a list").len();
        assert_eq!([count("edits"), count("problems")], if expected == 0 { [1, 0] } else { [0, 1] });
    }
}

/// Remarks on a file are routine; warnings are not.
#[test]
fn packing_and_appending_say_what_is_routine() {
    let sandbox = Sandbox::default();
    let more = [nifti_header(&[4, 4, 4], 2, 8), vec![7; 64], vec![1; 3]].concat();
    sandbox.write("a.nii", &more);
    for line in ["pack a.nii o.zarr", "append s.zarr a.nii", "append s.zarr a.nii"] {
        let (code, _, said) = sandbox.run(&format!("{line} --progress none"));
        assert!(code == 0 && said.contains("warning: 3 bytes after the voxels are ignored"), "{line}: {code}: {said}");
        assert_eq!(said.matches("warning:").count(), 1, "{line}: {said}");
    }
    assert!(sandbox.run_ok("verify o.zarr --progress none").contains("1 brick in 1 shard is sound"));
}

/// Channels have the same names in all commands.
#[test]
fn channels_are_exported_by_number_or_name() {
    let sandbox = Sandbox::in_memory();
    let text =
        "{\"shape\": [2, 2, 2], \"dtype\": \"u8\", \"channels\": 3, \"channel_names\": [\"DAPI\", \"actin\", \"2\"]}";
    sandbox.write("a.raw", [[1; 8], [2; 8], [3; 8]].concat());
    sandbox.write("a.raw.json", text.as_bytes());
    sandbox.run_ok("pack a.raw a.zarr --progress none");
    for (channel, value) in
        [("", 1), ("--channel 1", 2), ("--channel actin", 2), ("--channel dapi", 1), ("--channel 2", 3)]
    {
        sandbox.run_ok(&format!("export a.zarr o.raw --overwrite --progress none {channel}"));
        assert_eq!(sandbox.read("o.raw"), [value; 8], "{channel}");
    }
    let (code, _, said) = sandbox.run("export a.zarr no.raw --channel actn");
    assert!(code == 2 && said.contains("no channel 'actn', did you mean 'actin'?"), "{code}: {said}");
    assert!(!sandbox.path("no.raw").exists());
}

/// A plan alone leaves nothing behind, and is refused like its pack; a store is compared with its input afterwards.
#[test]
fn a_pack_is_planned_and_compared() {
    let sandbox = Sandbox::in_memory();
    sandbox.write("a.raw", (0..8 * 6 * 4 * 3).map(|i| (1 + i % 250) as u8).collect::<Vec<u8>>());
    let raw = "pack a.raw a.zarr --shape 8,6,4 --dtype u8 --times 3 --progress none";
    let line = format!("{raw} --roi 1:7,0:5,1:4 --flip x --time 0:3:2 --to-dtype u16 --name wing");
    let said = sandbox.run_ok(&format!("{line} --dry-run"));
    assert!(said.starts_with("packing t2 z3 y5 x6 of u16, uncalibrated: at most "), "{said}");
    let plan = json(&sandbox.run_ok(&format!("{line} --dry-run --json")));
    assert_eq!(
        (&plan["extent"], &plan["times"], &plan["seconds"]),
        (&serde_json::json!([6, 5, 3]), &2.into(), &serde_json::Value::Null)
    );
    assert!(!sandbox.path("a.zarr").exists());
    let verified = sandbox.run_ok(&format!("{line} --verify"));
    assert!(verified.contains("sound") && verified.ends_with("equal to the input, voxel by voxel\n"), "{verified}");
    // A clamped input is equal to its conversion, not to itself.
    let clamped = (0..8 * 6 * 4 * 3).filter(|i| 1 + i % 250 > 127).count();
    let verified = sandbox.run_ok(&raw.replace("a.zarr", "c.zarr --to-dtype i8 --allow-lossy --verify"));
    let words = format!("equal to the converted input ({clamped} values rounded or clamped), voxel by voxel\n");
    assert!(verified.ends_with(&words), "{verified}");
    assert!(sandbox.run_ok("info a.zarr").starts_with("a.zarr: u16 volume 'wing', axes tzyx"));
    sandbox.run_ok("export a.zarr b.raw --time 1 --progress none");
    let voxel = |x: usize, y: usize, z: usize| (1 + (x + 8 * (y + 6 * (z + 4 * 2))) % 250) as u8;
    let expected: Vec<u8> = (0..6 * 5 * 3).flat_map(|i| [voxel(6 - i % 6, i / 6 % 5, 1 + i / 30), 0]).collect();
    assert_eq!(sandbox.read("b.raw"), expected);
    // The same refusals, with the same codes.
    for flags in [
        "",
        "--overwrite --memory 1MiB",
        "--resume --roi 0:1,0:1,0:1",
        "--roi 0:9,0:6,0:4",
        "--overwrite --to-dtype i8",
    ] {
        let [(code, _, planned), (packed_code, _, packed)] =
            [" --dry-run", ""].map(|dry| sandbox.run(&format!("{raw} {flags}{dry}")));
        assert_eq!((code, packed_code, planned), (2, 2, packed), "{flags}");
    }
    for (path, mut bytes) in tree(&sandbox.path("a.zarr/0/c")) {
        bytes[3] ^= 1;
        sandbox.write(Path::new("a.zarr/0/c").join(path), bytes);
    }
    let (code, _, said) = sandbox.run(&format!("{line} --resume --verify"));
    assert_eq!(code, 5, "{said}");
}

/// A full destination is named.
#[cfg(target_os = "linux")]
#[test]
fn a_full_standard_output_is_named() {
    let sandbox = with_store();
    let full = std::fs::File::options().write(true).open("/dev/full").expect("Linux has it");
    let output = sandbox.command().args(["info", "a.zarr"]).stdout(full).output().expect("it runs");
    let said = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.code() == Some(1) && said.contains("standard output:"), "{:?}: {said}", output.status);
}

/// For any number of damaged bricks: rendering names a few, `verify` all of them, and the last line gives the count.
#[test]
fn damage_is_summed_up_in_a_line() {
    let sandbox = with_store();
    damage(&sandbox);
    let (code, stdout, stderr) = sandbox.run("verify a.zarr --progress none");
    assert_eq!(code, 5, "{stderr}");
    let count = stdout.lines().count();
    assert!(count > 100 && stdout.lines().all(|line| line.contains("level 0 brick")), "{stdout}");
    let found = format!("error: a.zarr: {count} of 288 bricks are damaged, in level 0, time step 0, channel 0");
    assert_eq!(stderr, found + "; `verify --repair INPUT` makes damaged files again\n");
    let (code, _, stderr) = sandbox.run("probe a.zarr 1,1,1");
    assert!(code == 3 && stderr.matches("level 0 brick").count() == 1, "exit {code}: {stderr}");
    let (code, _, stderr) = sandbox.run(&format!("render a.zarr -o a.png {VIEW}"));
    assert_eq!(code, 0, "{stderr}");
    assert_eq!(stderr.lines().filter(|line| line.contains("a coarser brick stands in")).count(), 3, "{stderr}");
    assert_eq!(stderr.lines().filter(|line| line.contains("bricks could not be read")).count(), 1, "{stderr}");
    // The exit code serves those who reject such a picture.
    let drawn = sandbox.read("a.png");
    let (code, _, stderr) = sandbox.run(&format!("render a.zarr -o strict.png {VIEW} --strict"));
    assert!(code == 5 && stderr.contains("--strict"), "exit {code}: {stderr}");
    assert!(sandbox.read("strict.png") == drawn, "the picture is written all the same");
}

#[test]
fn a_picture_goes_into_a_pipe() {
    let sandbox = with_store();
    let said = sandbox.run(&format!("render a.zarr -o a.png {VIEW}")).2;
    assert!(said.contains("wrote a.png"), "{said}");
    let line = format!("render a.zarr -o - {VIEW}");
    let output = sandbox.command().args(line.split_whitespace()).output().expect("the command starts");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(output.stdout == sandbox.read("a.png") && !sandbox.path("-").exists());
    for (flags, said) in [("--stats -", "a picture or the statistics"), ("--orbit 3", "one picture, not 3")] {
        let (code, stdout, stderr) = sandbox.run(&format!("{line} {flags}"));
        assert!(code == 2 && stdout.is_empty() && stderr.contains(said), "{flags}: {code}: {stderr}");
    }
}

/// A pack of 294 shards, taking about a second.
const PACK: &str = "pack in.raw b.zarr --shape 256,256,128 --dtype u16 --brick 16 --shard 32 --progress none -j 2";

/// Runs a line of arguments, presses Ctrl-C once `is_time`, and returns the exit code and the messages.
fn stopped(sandbox: &Sandbox, line: &str, is_time: impl Fn() -> bool) -> (Option<i32>, String) {
    stopped_reading(Stdio::null(), sandbox, line, is_time)
}

/// As [`stopped`], with a standard input.
fn stopped_reading(input: Stdio, sandbox: &Sandbox, line: &str, is_time: impl Fn() -> bool) -> (Option<i32>, String) {
    let mut command = sandbox.command();
    let child = command.args(line.split_whitespace()).stdin(input).stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
    let child = child.expect("the command starts");
    let started = Instant::now();
    while !is_time() {
        assert!(started.elapsed() < Duration::from_secs(60), "it is not time in a minute");
        std::thread::sleep(Duration::from_millis(1));
    }
    let killed = Command::new("kill").args(["-INT", &child.id().to_string()]).status().expect("kill runs");
    assert!(killed.success(), "it ended before it could be stopped");
    let output = child.wait_with_output().expect("a child");
    (output.status.code(), String::from_utf8_lossy(&output.stderr).into_owned())
}

fn with_input(name: &str) -> Sandbox {
    let sandbox = Sandbox::in_memory();
    sandbox.run_ok(&format!("synth turbulence {name} --shape 256,256,128 --dtype u16 --progress none"));
    sandbox
}

#[test]
fn a_pack_that_is_stopped_goes_on_to_the_same_store() {
    let sandbox = with_input("in.raw");
    sandbox.run_ok(PACK);
    let whole = tree(&sandbox.path("b.zarr"));
    let journal = |store: &str| std::fs::read_to_string(sandbox.path(store).join(".brickyard-journal"));
    // Anew, and replacing the whole store.
    for (flags, made_in) in [("", "b.zarr"), (" --overwrite", "b.zarr.packing")] {
        if flags.is_empty() {
            std::fs::remove_dir_all(sandbox.path("b.zarr")).expect("it is there");
        }
        let has_shards = || journal(made_in).is_ok_and(|text| text.lines().count() > 3);
        let (code, said) = stopped(&sandbox, &format!("{PACK}{flags}"), has_shards);
        assert_eq!(code, Some(130), "{said}");
        for words in ["b.zarr: stopped; ", " of 332 shards are complete", "--resume"] {
            assert!(said.contains(words), "{words:?} is not in: {said}");
        }
        let lines = journal(made_in).expect("an unfinished pack");
        // One of them is the head. Lines that begin with a blank are about others.
        let finished = lines.lines().filter(|line| !line.starts_with(' ')).count() - 1;
        assert!(said.contains(&format!("stopped; {finished} of")), "{finished}: {said}");
        sandbox.run_ok(&format!("{PACK} --resume"));
        let difference = tree_difference(&tree(&sandbox.path("b.zarr")), &whole);
        assert!(difference.is_empty(), "{difference:?}");
        assert!(!sandbox.path("b.zarr.packing").exists());
    }
}

/// No later command can go on with a stream.
#[test]
fn a_pack_of_a_stream_that_is_stopped_starts_anew() {
    let sandbox = with_input("in.raw");
    let input = std::fs::File::open(sandbox.path("in.raw")).expect("it is there");
    let has_shards = || {
        let journal = std::fs::read_to_string(sandbox.path("b.zarr/.brickyard-journal"));
        journal.is_ok_and(|text| text.lines().count() > 3)
    };
    let line = PACK.replace("in.raw", "-");
    let (code, said) = stopped_reading(input.into(), &sandbox, &line, has_shards);
    assert_eq!(code, Some(130), "{said}");
    assert!(said.contains("b.zarr: stopped; ") && said.contains("a stream cannot be read again"), "{said}");
    assert!(said.contains("--overwrite") && !said.contains("--resume"), "{said}");
    sandbox.run_ok(&format!("{PACK} --overwrite"));
}

#[test]
fn steps_that_are_whole_stay_when_an_append_is_stopped() {
    let sandbox = with_input("in.raw");
    let append = |store: &str, files: &str| {
        format!("append {store} {files} --shape 256,256,128 --dtype u16 --brick 16 --shard 32 --progress none -j 2")
    };
    sandbox.run_ok(&append("whole.zarr", "in.raw in.raw --order given"));
    sandbox.run_ok(&append("c.zarr", "in.raw"));
    let begins = || sandbox.path("c.zarr/0/c/1").exists();
    let (code, said) = stopped(&sandbox, &append("c.zarr", "in.raw"), begins);
    assert_eq!(code, Some(130), "{said}");
    assert!(said.contains("in.raw: stopped; c.zarr has 1 time step: "), "{said}");
    sandbox.run_ok(&append("c.zarr", "in.raw"));
    let difference = tree_difference(&tree(&sandbox.path("c.zarr")), &tree(&sandbox.path("whole.zarr")));
    assert!(difference.is_empty(), "{difference:?}");
}

#[test]
fn an_export_that_is_stopped_leaves_nothing() {
    let sandbox = with_input("in.zarr --steps 4 --brick 16 --shard 32");
    let begins = || std::fs::read_dir(sandbox.path("")).expect("a folder").count() > 1;
    let (code, said) = stopped(&sandbox, "export in.zarr d.raw --time all --progress none", begins);
    assert_eq!(code, Some(130), "{said}");
    assert!(said.contains("d.raw: cancelled; nothing was written there"), "{said}");
    assert_eq!(std::fs::read_dir(sandbox.path("")).expect("a folder").count(), 1);
}

#[test]
fn a_mesh_that_is_stopped_leaves_nothing() {
    let sandbox = with_input("in.zarr --brick 16 --shard 32");
    let begins = || std::fs::read_dir(sandbox.path("")).expect("a folder").count() > 1;
    let (code, said) = stopped(&sandbox, "mesh in.zarr a.stl --isovalue 30000 --smooth 20 --progress none", begins);
    assert_eq!(code, Some(130), "{said}");
    assert!(said.contains("a.stl: cancelled; nothing was written there"), "{said}");
    assert_eq!(std::fs::read_dir(sandbox.path("")).expect("a folder").count(), 1);
}

/// All shards of level 0 are damaged: those made so far go if the repair is stopped before the first gets its name.
#[test]
fn a_repair_that_is_stopped_leaves_no_file_half_made_and_goes_on() {
    let sandbox = with_input("in.raw");
    sandbox.run_ok(PACK);
    let whole = tree(&sandbox.path("b.zarr"));
    for (path, mut bytes) in tree(&sandbox.path("b.zarr/0/c")) {
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
        sandbox.write(Path::new("b.zarr/0/c").join(path), bytes);
    }
    let damaged = tree(&sandbox.path("b.zarr"));
    let repair = "verify b.zarr --repair in.raw --shape 256,256,128 --dtype u16 --progress none";
    // The first file under a temporary name.
    let files = || tree(&sandbox.path("b.zarr/0/c")).len();
    let shards = files();
    let (code, said) = stopped(&sandbox, repair, || files() > shards);
    assert_eq!(code, Some(130), "{said}");
    assert!(said.contains("b.zarr: stopped; 0 files are repaired: the same repair goes on"), "{said}");
    let difference = tree_difference(&tree(&sandbox.path("b.zarr")), &damaged);
    assert!(difference.is_empty(), "{difference:?}");
    sandbox.run_ok(repair);
    let difference = tree_difference(&tree(&sandbox.path("b.zarr")), &whole);
    assert!(difference.is_empty(), "{difference:?}");
}
