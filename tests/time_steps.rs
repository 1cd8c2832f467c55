//! Several time steps at once, by the command: a voxel's curve as text, JSON, CSV and a plot, and exports of a range of steps.

use brickyard_tests::{Sandbox, read_png};

const EXTENT: [u16; 3] = [9, 8, 7];
const STEPS: u16 = 6;

/// Each voxel's value says its step and its place.
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

/// A store `flow.zarr` whose steps are half a second apart.
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
    // One step is told as it always was.
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
        // Each is what its step and camera show by themselves: a third of the orbit later, two steps later.
        sandbox.run_ok(&format!("render flow.zarr -o one.png --overwrite --time {} --orbit 3 {scene}", 2 * i + 1));
        assert_eq!(a, read_png(&sandbox.path(format!("one_00{i}.png"))), "picture {i}");
    }
    assert!(!sandbox.path("a_003.png").exists());
    let brightest = |i| read_png(&sandbox.path(format!("a_00{i}.png"))).rgb.into_iter().map(|rgb| rgb[0]).max();
    assert!(brightest(0) < brightest(1) && brightest(1) < brightest(2));
}
