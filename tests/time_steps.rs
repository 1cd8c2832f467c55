//! Several time steps at once, by the command: a voxel's curve as text, JSON, CSV and a plot, and exports of a range of steps.

use brickyard_tests::{Sandbox, read_png};
use std::io::Write;
use std::process::{Command, Stdio};

const EXTENT: [u16; 3] = [9, 8, 7];
const STEPS: u16 = 6;

/// A voxel's value: its step and its place.
fn value(step: u16, [x, y, z]: [u16; 3]) -> u16 {
    step * 1000 + (z * EXTENT[1] + y) * EXTENT[0] + x
}

/// The bytes of some steps, one after another, of a box given as ranges along x, y and z.
fn bytes(steps: &[u16], [xs, ys, zs]: [std::ops::Range<u16>; 3]) -> Vec<u8> {
    let mut bytes = Vec::new();
    for &step in steps {
        for z in zs.clone() {
            for y in ys.clone() {
                bytes.extend(xs.clone().flat_map(|x| value(step, [x, y, z]).to_le_bytes()));
            }
        }
    }
    bytes
}

/// A store `flow.zarr` with steps half a second apart.
fn packed() -> Sandbox {
    let sandbox = Sandbox::default();
    let steps: Vec<u16> = (0..STEPS).collect();
    sandbox.write("flow.raw", bytes(&steps, EXTENT.map(|voxels| 0..voxels)));
    sandbox.run_ok(
        "pack flow.raw flow.zarr --shape 9,8,7 --dtype u16 --axes tzyx --times 6 --brick 16 --time-step 0.5 --time-unit s --progress none",
    );
    sandbox
}

#[test]
fn a_curve_has_each_steps_value() {
    let sandbox = packed();
    let expected = |steps: &[u16]| -> Vec<f64> { steps.iter().map(|step| value(*step, [4, 5, 6]).into()).collect() };
    for (range, steps) in [("all", &[0, 1, 2, 3, 4, 5][..]), ("1:6:2", &[1, 3, 5]), ("4:", &[4, 5]), ("2:3", &[2])] {
        let found = sandbox.json(&format!("probe flow.zarr 4,5,6 --voxel --time {range} --json"));
        assert_eq!(found["steps"], serde_json::json!(steps));
        assert_eq!(found["channels"][0]["values"], serde_json::json!(expected(steps)));
        let times: Vec<f64> = steps.iter().map(|step| f64::from(*step) * 0.5).collect();
        assert_eq!((&found["times"], &found["time_unit"]), (&serde_json::json!(times), &"second".into()));
    }
    let csv = sandbox.run_ok("probe flow.zarr 4,5,6 --voxel --time 2:4 --csv");
    assert_eq!(csv, format!("step,time,channel 0\n2,1,{}\n3,1.5,{}\n", value(2, [4, 5, 6]), value(3, [4, 5, 6])));
    let text = sandbox.run_ok("probe flow.zarr 4,5,6 --voxel --time 2:4");
    assert!(text.contains("voxel 4,5,6") && text.contains(&format!(": {}", value(3, [4, 5, 6]))), "{text}");
    // A single step has the usual output.
    let one = sandbox.json("probe flow.zarr 4,5,6 --voxel --time 3 --json");
    assert_eq!(one["channels"][0]["value"], f64::from(value(3, [4, 5, 6])));
}

#[test]
fn a_plot_is_not_replaced_unless_told() {
    let sandbox = packed();
    sandbox.run_ok("probe flow.zarr 4,5,6 --voxel --time all --plot curve.svg");
    let plot = String::from_utf8(sandbox.read("curve.svg")).unwrap();
    assert!(plot.contains("voxel 4,5,6") && plot.contains("time, s"), "{plot}");
    assert_eq!(plot.matches("<circle").count(), usize::from(STEPS));
    let again = "probe flow.zarr 1,1,1 --voxel --time all --plot curve.svg";
    let (code, _, stderr) = sandbox.run(again);
    assert!(code == 2 && stderr.contains("curve.svg"), "{code}: {stderr}");
    assert_eq!(sandbox.read("curve.svg"), plot.as_bytes());
    sandbox.run_ok(&format!("{again} --overwrite"));
    assert!(String::from_utf8(sandbox.read("curve.svg")).unwrap().contains("voxel 1,1,1"));
}

#[test]
fn steps_are_exported_one_after_another() {
    let sandbox = packed();
    sandbox.run_ok("export flow.zarr all.raw --time all --progress none");
    assert!(sandbox.read("all.raw") == sandbox.read("flow.raw"));
    let roi = [2..9, 0..5, 3..4];
    sandbox.run_ok("export flow.zarr some.raw --time 1:6:2 --roi 2:9,0:5,3:4 --progress none");
    assert!(sandbox.read("some.raw") == bytes(&[1, 3, 5], roi));
    // An array with an axis of time reads back as the same series, and one step as a volume.
    for (time, axes, steps) in [("0:6", "tzyx", &[0, 1, 2, 3, 4, 5][..]), ("4", "zyx", &[4])] {
        sandbox.run_ok(&format!("export flow.zarr a.npy --time {time} --overwrite --progress none"));
        sandbox.run_ok(&format!("pack a.npy back.zarr --axes {axes} --overwrite --progress none"));
        sandbox.run_ok("export back.zarr back.raw --time all --overwrite --progress none");
        assert!(sandbox.read("back.raw") == bytes(steps, EXTENT.map(|voxels| 0..voxels)), "{time}");
    }
}

#[test]
fn pictures_of_steps_are_numbered_and_the_same_each_time() {
    let sandbox = packed();
    let scene = "--mode mip --window 0:6000 --backend cpu --size 24x24";
    for run in ["a", "b"] {
        sandbox.run_ok(&format!("render flow.zarr -o {run}.png --time 1:6:2 --orbit 2 {scene}"));
    }
    for i in 0..3 {
        let [a, b] = ["a", "b"].map(|run| read_png(&sandbox.path(format!("{run}_00{i}.png"))));
        assert_eq!(a, b, "picture {i}");
        // Each equals its step and camera by themselves: a third of the orbit later, two steps later.
        sandbox.run_ok(&format!("render flow.zarr -o one.png --overwrite --time {} --orbit 3 {scene}", 2 * i + 1));
        assert_eq!(a, read_png(&sandbox.path(format!("one_00{i}.png"))), "picture {i}");
    }
    assert!(!sandbox.path("a_003.png").exists());
    let brightest = |i| read_png(&sandbox.path(format!("a_00{i}.png"))).rgb.into_iter().map(|rgb| rgb[0]).max();
    assert!(brightest(0) < brightest(1) && brightest(1) < brightest(2));
}

/// A store replaced while its steps are drawn: pictures of the old one, then an end, and none of the new.
#[test]
fn steps_of_a_store_that_is_replaced_are_not_mixed_with_the_other_s() {
    const TIMES: usize = 60;
    let sandbox = Sandbox::in_memory();
    let flags = format!("--shape 24,24,24 --dtype u8 --times {TIMES} --brick 8 --progress none");
    for (name, value) in [("old.raw", 50u8), ("new.raw", 200)] {
        sandbox.write(name, vec![value; 24 * 24 * 24 * TIMES]);
    }
    sandbox.run_ok(&format!("pack old.raw s.zarr {flags}"));
    std::fs::create_dir(sandbox.path("p")).expect("the sandbox is writable");
    let line = "render s.zarr --mode mip --window=0,255 --time all --backend cpu --size 64x64 -o p/o.png";
    let render = sandbox.command().args(line.split(' ')).stderr(Stdio::piped()).spawn().expect("the command starts");
    let pictures = || {
        let entries = std::fs::read_dir(sandbox.path("p")).expect("it is there");
        entries.map(|entry| entry.expect("it is there").path()).filter(|path| path.extension() == Some("png".as_ref()))
    };
    while pictures().count() < 3 {
        std::thread::sleep(std::time::Duration::from_millis(1));
    }
    let signal = |name: &str| {
        let sent = Command::new("kill").args([name, &render.id().to_string()]).status();
        assert!(sent.expect("kill starts").success(), "the command is over before its store is replaced");
    };
    signal("-STOP");
    sandbox.run_ok(&format!("pack new.raw s.zarr --overwrite {flags}"));
    signal("-CONT");
    let output = render.wait_with_output().expect("the command ends");
    let said = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.code() == Some(3) && said.contains("s.zarr: was replaced"), "{:?}: {said}", output.status);
    assert!(pictures().count() < TIMES);
    for path in pictures() {
        let greatest = read_png(&path).rgb.into_iter().flatten().max();
        assert!(greatest.is_some_and(|gray| gray.abs_diff(50) <= 1), "{}: {greatest:?}", path.display());
    }
}

/// Runs the command in the sandbox with a limit of 64 open files; returns its standard error.
fn run_with_few_files(sandbox: &Sandbox, line: &str) -> String {
    let program = sandbox.command().get_program().to_owned();
    let mut shell = Command::new("sh");
    shell.args(["-c", "ulimit -n 64 && exec \"$0\" \"$@\""]).arg(program).args(line.split_whitespace());
    let output = shell.current_dir(sandbox.path("")).output().expect("a shell");
    let stderr = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{line}: {stderr}");
    stderr
}

#[test]
fn a_series_may_have_more_files_than_the_process() {
    const MANY: u16 = 300;
    let sandbox = Sandbox::default();
    for step in 0..MANY {
        sandbox.write(format!("s_{step}.raw"), [step; 4 * 3 * 2].map(u16::to_le_bytes).as_flattened());
    }
    run_with_few_files(&sandbox, "pack s_*.raw s.zarr --shape 4,3,2 --dtype u16 --brick 8 --progress none");
    sandbox.run_ok("export s.zarr all.raw --time all --progress none");
    let expected: Vec<u8> = (0..MANY).flat_map(|step| [step; 24]).flat_map(u16::to_le_bytes).collect();
    assert!(sandbox.read("all.raw") == expected);
    // Several steps in a shard.
    let line = "pack s_*.raw t.zarr --shape 4,3,2 --dtype u16 --brick 8 --shard-time 50 --progress none";
    run_with_few_files(&sandbox, line);
    sandbox.run_ok("export t.zarr all.raw --time all --overwrite --progress none");
    assert!(sandbox.read("all.raw") == expected);
}

#[test]
fn compressed_steps_take_the_scratch_space_of_two() {
    const MANY: u8 = 9;
    let sandbox = Sandbox::default();
    let voxels = 64 * 64 * 64;
    for step in 0..MANY {
        let mut file = vec![0; 352];
        file[..4].copy_from_slice(&348i32.to_le_bytes());
        [3u16, 64, 64, 64]
            .iter()
            .enumerate()
            .for_each(|(i, n)| file[40 + 2 * i..][..2].copy_from_slice(&n.to_le_bytes()));
        (file[70], file[72]) = (2, 8);
        (1..4).for_each(|i| file[76 + 4 * i..][..4].copy_from_slice(&1f32.to_le_bytes()));
        file[344..348].copy_from_slice(b"n+1\0");
        file.resize(352 + voxels, step + 1);
        let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
        gzip.write_all(&file).expect("memory");
        sandbox.write(format!("s_{step}.nii.gz"), gzip.finish().expect("memory"));
    }
    let said = run_with_few_files(&sandbox, "pack s_*.nii.gz s.zarr --brick 32 --progress none");
    let scratch = 2 * (352 + voxels);
    assert!(said.contains(&format!("{:.1} KiB of scratch", scratch as f64 / 1024.0)), "{said}");
    sandbox.run_ok("export s.zarr all.raw --time all --progress none");
    let expected: Vec<u8> = (1..=MANY).flat_map(|step| vec![step; voxels]).collect();
    assert!(sandbox.read("all.raw") == expected);
}
