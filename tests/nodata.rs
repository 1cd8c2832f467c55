//! Integers that mark voxels without data: left out of pictures by every renderer, of slices, and of the command's output.

use brickyard::volume::{Camera, Extent, Geometry, LevelPolicy, Mode, Projection, Scene, TransferFunction, Voxel};
use brickyard_tests::{
    FunctionSource, Sandbox, TestStore, WAYS, assert_same, leave_out, oracle, read_png, session, settled,
};
use glam::DVec3;

const SIZE: (u32, u32) = (80, 60);
const EXTENT: Extent = Extent::new(44, 37, 41);

/// Whether a voxel is in the shell or in one of the holes: curved, inside bricks and across them.
fn is_hole([x, y, z]: [u32; 3]) -> bool {
    let p = DVec3::new(x as f64, y as f64, z as f64);
    let is_shell = (p - DVec3::new(21.3, 18.1, 20.2)).length() > 17.4;
    is_shell || (p - DVec3::new(14.7, 16.2, 22.9)).length() < 6.3 || (x * 7 + y * 13 + z * 5).is_multiple_of(43)
}

/// Waves in 0..=1.
fn waves([x, y, z]: [u32; 3]) -> f64 {
    let [u, v, w] = [x, y, z].map(f64::from);
    0.5 + 0.25 * (0.31 * u + 0.11 * v).sin() + 0.25 * (0.23 * v - 0.17 * w).cos()
}

fn scene(mode: Mode, level: LevelPolicy, (low, high): (f64, f64)) -> Scene {
    let at = |t: f64| low + t * (high - low);
    let transfer = TransferFunction {
        color: vec![[at(0.0), 0.1, 0.2, 0.9], [at(0.5), 0.2, 0.9, 0.3], [at(1.0), 1.0, 0.6, 0.1]],
        opacity: vec![[at(0.0), 0.02], [at(1.0), 0.3]],
        unit_distance: 2.0,
        ..TransferFunction::default()
    };
    // Along no axis and through no faces of voxels: a sample with exactly half its weight in valid corners falls to either side by
    // rounding.
    let camera = Camera {
        eye: DVec3::new(83.1, -47.7, 66.3),
        target: DVec3::new(21.4, 18.3, 19.8),
        up: DVec3::Z,
        projection: Projection::Perspective { fov_y_deg: 33.0 },
    };
    Scene { camera: Some(camera), mode, level, background: [0.1, 0.05, 0.2], ..Scene::of(transfer) }
}

/// Compares every way to draw a volume of integers with the oracle's picture, which itself equals that of floats with NaN in the
/// holes.
fn check<T: Voxel>(nodata: T, (low, high): (f64, f64), modes: &[Mode]) {
    let value = move |v| T::from_f64_rounded(low + (high - low) * waves(v));
    let of_holes = move |v| if is_hole(v) { nodata } else { value(v) };
    let source = FunctionSource::new(EXTENT, Geometry::default(), move |_, _, v| of_holes(v)).without(nodata.to_f64());
    let test = TestStore::pack(&source, 16);
    let of_nan = move |v| if is_hole(v) { f32::NAN } else { value(v).to_f64() as f32 };
    let floats = TestStore::pack(&FunctionSource::new(EXTENT, Geometry::default(), move |_, _, v| of_nan(v)), 16);
    for &mode in modes {
        for level in [0, 1] {
            let scene = scene(mode, LevelPolicy::Locked(level), (low, high));
            let what = format!("{} {mode:?} level {level}", T::TYPE);
            let expected = oracle(&test.store, &scene, SIZE);
            if level == 0 {
                assert_same(&expected, &oracle(&floats.store, &scene, SIZE), &format!("{what}, as floats"));
            }
            for way in WAYS {
                let Some(mut session) = session(&test.store, way) else { continue };
                let (picture, stats) = settled(&mut session, &scene, SIZE);
                assert!(!stats.memory_bound && stats.bricks.failed == 0, "{what}: {stats:?}");
                assert_same(&picture, &expected, &format!("{what}, {way:?}"));
            }
        }
    }
}

#[test]
fn every_renderer_leaves_out_voxels_without_data() {
    check(255u8, (0.0, 250.0), &[Mode::Dvr, Mode::Mip, Mode::MinIp, Mode::Average]);
    // A value among the others, where 8 bits have no spare code.
    check(100u8, (0.0, 255.0), &[Mode::Dvr, Mode::Mip]);
    check(-2000i16, (-1000.0, 3000.0), &[Mode::Dvr, Mode::MinIp]);
    check(0u16, (500.0, 65535.0), &[Mode::Dvr, Mode::Average]);
    check(-9999i32, (-5000.0, 900_000.0), &[Mode::Dvr, Mode::Mip]);
}

/// Slots hold bricks of any channel: if one has no spare code in 8 bits, all take 16.
#[test]
fn channels_share_slots() {
    let sandbox = Sandbox::default();
    let voxel =
        |c: u32, v: [u32; 3]| if is_hole(v) { 7 } else { (waves(v) * if c == 0 { 100.0 } else { 255.0 }) as u8 };
    let Extent { x, y, z } = EXTENT;
    let of_channel = |c| (0..z).flat_map(move |z| (0..y).flat_map(move |y| (0..x).map(move |x| voxel(c, [x, y, z]))));
    sandbox.write("a.raw", (0..2).flat_map(of_channel).collect::<Vec<u8>>());
    let flags = "--dtype u8 --channels 2 --axes czyx --brick 16 --shard 32 --nodata 7 --progress none";
    sandbox.run_ok(&format!("pack a.raw a.zarr --shape {x},{y},{z} {flags}"));
    let mut expected = None;
    for way in ["--compositor reference", "--backend cpu", "--backend gpu", "--backend gpu --compositor sorted"] {
        let view = "--eye 83.1,-47.7,66.3 --target 21.4,18.3,19.8 --size 80x60 --level 0 --background 0.1,0.05,0.2";
        let (code, _, stderr) = sandbox.run(&format!("render a.zarr -o a.png --overwrite {view} {way}"));
        if code == 1 && stderr.contains("--backend cpu") {
            leave_out("gpu", stderr);
            continue;
        }
        assert_eq!(code, 0, "{way}: {stderr}");
        let picture = read_png(&sandbox.path("a.png"));
        assert_same(&picture, expected.get_or_insert_with(|| picture.clone()), way);
    }
}

/// 24^3 voxels of i16: a ramp, in a shell of -2000 three voxels thick, with one such voxel in the middle.
fn padded_ct(sandbox: &Sandbox) -> Vec<u8> {
    let is_inside = |v: [i16; 3]| v.iter().all(|n| (3..21).contains(n)) && v != [12; 3];
    let voxel = |v: [i16; 3]| if is_inside(v) { -100 + 10 * v[0] + v[1] } else { -2000 };
    let voxels = (0..24i16).flat_map(|z| (0..24).flat_map(move |y| (0..24).map(move |x| [x, y, z])));
    let bytes: Vec<u8> = voxels.flat_map(|v| voxel(v).to_le_bytes()).collect();
    sandbox.write("ct.raw", &bytes);
    bytes
}

const PACK: &str = "pack ct.raw ct.zarr --shape 24,24,24 --dtype i16 --brick 8 --shard 16 --progress none";

#[test]
fn slices_have_background_where_there_are_no_data() {
    let sandbox = Sandbox::default();
    padded_ct(&sandbox);
    sandbox.run_ok(&format!("{PACK} --nodata -2000"));
    for way in ["--compositor reference", "--backend cpu"] {
        sandbox.run_ok(&format!(
            "render ct.zarr -o s.png --overwrite --slice z=15 --size 48x48 --background 0,0.2,1 {way}"
        ));
        let picture = read_png(&sandbox.path("s.png"));
        for (i, &pixel) in picture.rgb.iter().enumerate() {
            let [x, y] = [i % 48 / 2, i / 48 / 2];
            let is_far = [x, y].iter().any(|n| !(2..22).contains(n));
            let is_inside = [x, y].iter().all(|n| (4..20).contains(n));
            let is_gray = pixel[0] == pixel[1] && pixel[1] == pixel[2];
            assert!(!is_far || pixel == [0, 51, 255], "{way} {x} {y}: {pixel:?}");
            assert!(!is_inside || is_gray, "{way} {x} {y}: {pixel:?}");
        }
    }
}

#[test]
fn the_command_says_what_holds_no_data() {
    let sandbox = Sandbox::default();
    let voxels = padded_ct(&sandbox);
    let missing = 24u64.pow(3) - 18u64.pow(3) + 1;
    let (code, _, stderr) = sandbox.run(&format!("{PACK} --nodata -2000"));
    assert!(code == 0 && stderr.contains(&format!("{missing} voxels of -2000, no data")), "{code}: {stderr}");
    sandbox.run_ok("verify ct.zarr --progress none");
    let text = sandbox.run_ok("info ct.zarr");
    assert!(text.contains(&format!("no data: -2000, {missing} voxels (57.8 %)")), "{text}");
    assert!(text.contains("values -67 to 120"), "{text}");
    let info = sandbox.json("info ct.zarr --json");
    let channel = &info["store"]["channels"][0];
    assert_eq!((&info["store"]["nodata"], &channel["nodata"]), (&(-2000).into(), &missing.into()));
    assert_eq!(channel["count"], 24u64.pow(3) - missing);
    assert!(sandbox.run_ok("probe ct.zarr 12,12,12 --voxel").contains("channel 0: no data"));
    assert!(sandbox.run_ok("probe ct.zarr 13,12,12 --voxel").contains("channel 0: 42"));
    assert_eq!(sandbox.json("probe ct.zarr 12,12,12 --voxel --json")["channels"][0]["value"], serde_json::Value::Null);
    sandbox.run_ok("export ct.zarr back.raw");
    assert!(sandbox.read("back.raw") == voxels, "the store keeps the value");
    // Another value is another pack.
    assert!(sandbox.run_ok(&format!("{PACK} --nodata -2000 --resume")).is_empty());
    for other in ["", "--nodata 0", "--nodata none"] {
        let (code, _, stderr) = sandbox.run(&format!("{PACK} --resume {other}"));
        assert!(code == 2 && stderr.contains("other settings"), "{other}: exit {code}: {stderr}");
    }
}

#[test]
fn floats_without_data_become_nan() {
    let sandbox = Sandbox::default();
    let values: Vec<f32> = (0..1000).map(|i| if i % 4 == 0 { -9999.9 } else { i as f32 }).collect();
    sandbox.write("a.raw", values.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>());
    // The nearest f32.
    sandbox.run_ok("pack a.raw a.zarr --shape 10,10,10 --dtype f32 --nodata -9999.9 --progress none");
    let info = sandbox.json("info a.zarr --json");
    let channel = &info["store"]["channels"][0];
    assert_eq!(
        (&channel["nan"], &channel["count"], &channel["range"]),
        (&250.into(), &750.into(), &serde_json::json!([1.0, 999.0]))
    );
    assert!(sandbox.run_ok("probe a.zarr 4,0,0 --voxel").contains("no data"));
    sandbox.run_ok("verify a.zarr --progress none");
}
