//! Stereo pictures end to end: both eyes equal the oracle in every layout and way to draw, and share resident bricks.

use brickyard::offline::render_settled;
use brickyard::session::{ResolvedScene, Session, SessionOptions};
use brickyard::stats::RenderStats;
use brickyard::volume::{
    Camera, Extent, Geometry, LevelPolicy, Mode, Picture, Projection, Scene, Stereo, StereoLayout, TransferFunction,
};
use brickyard_tests::{
    FunctionSource, Sandbox, TestStore, WAYS, assert_same, assert_same_surface, in_mode, leave_out, open_session,
    options, oracle, read_png, session, settled,
};
use glam::DVec3;
use std::collections::HashSet;
use std::time::{Duration, Instant};

const SIZE: (u32, u32) = (96, 76);
const EXTENT: Extent = Extent::new(61, 53, 67);

fn geometry() -> Geometry {
    Geometry { spacing: DVec3::new(0.5, 0.8, 1.1), ..Geometry::default() }
}

/// Waves with a hollow: surfaces, and empty bricks.
fn store(edge: u32) -> TestStore {
    TestStore::pack(
        &FunctionSource::new(EXTENT, geometry(), |_, _, [x, y, z]: [u32; 3]| {
            let [x, y, z] = [x, y, z].map(f64::from);
            let value = 0.55 + 0.25 * (0.31 * x + 0.11 * y).sin() + 0.2 * (0.23 * y - 0.17 * z).cos();
            if x + y + z < 60.0 { 0 } else { (value * 255.0) as u8 }
        }),
        edge,
    )
}

fn scene(camera: Camera, stereo: Option<Stereo>) -> Scene {
    let transfer = TransferFunction {
        color: vec![[0.0, 0.1, 0.2, 0.9], [128.0, 0.2, 0.9, 0.3], [255.0, 1.0, 0.6, 0.1]],
        opacity: vec![[60.0, 0.0], [140.0, 0.06], [255.0, 0.4]],
        unit_distance: 1.0,
        ..TransferFunction::default()
    };
    Scene { camera: Some(camera), stereo, background: [0.1, 0.0, 0.2], ..Scene::of(transfer) }
}

/// Cameras outside the volume and inside, and eyes far enough apart to reveal off-axis errors.
fn cameras() -> Vec<(&'static str, Camera, f64)> {
    let (low, high) = geometry().world_box(EXTENT);
    let at = |x: f64, y: f64, z: f64| low + (high - low) * DVec3::new(x, y, z);
    let perspective = Projection::Perspective { fov_y_deg: 40.0 };
    let orthographic = Projection::Orthographic { height: (high - low).length() };
    let camera = |eye, projection| Camera { eye, target: at(0.5, 0.5, 0.5), up: DVec3::Z, projection };
    vec![
        ("outside", camera(at(1.9, -1.2, 1.4), perspective), 0.3),
        ("orthographic", camera(at(-1.0, 2.0, 0.9), orthographic), 0.3),
        ("orthographic along an axis", camera(at(0.5, 3.0, 0.5), orthographic), 0.3),
        ("inside", camera(at(0.31, 0.42, 0.57), perspective), 1.0),
    ]
}

fn stereo(camera: &Camera, layout: StereoLayout, separation: f64) -> Stereo {
    let distance = (camera.target - camera.eye).length();
    Stereo { eye_separation: Some(separation * distance), ..Stereo::new(layout) }
}

#[test]
fn both_eyes_equal_the_oracle_in_every_way() {
    let test = store(16);
    for (name, camera, separation) in cameras() {
        for mode in [Mode::Dvr, Mode::Mip, Mode::Isosurface] {
            let stereo = Some(stereo(&camera, StereoLayout::SideBySide, separation));
            let scene = in_mode(scene(camera, stereo), mode, 110.0);
            let expected = oracle(&test.store, &scene, SIZE);
            assert_eq!((expected.width, expected.height), SIZE);
            let eye = |first: usize| expected.rgb.chunks_exact(48).skip(first).step_by(2).flatten().collect::<Vec<_>>();
            let differing = eye(0).iter().zip(eye(1)).filter(|(a, b)| **a != *b).count();
            assert!(differing > 400, "{name}, {mode:?}: the eyes see the same");
            for way in WAYS {
                let Some(mut session) = session(&test.store, way) else { continue };
                let (picture, stats) = settled(&mut session, &scene, SIZE);
                assert!(!stats.memory_bound && stats.bricks.failed == 0, "{stats:?}");
                let same = if mode == Mode::Isosurface { assert_same_surface } else { assert_same };
                same(&picture, &expected, &format!("{name}, {mode:?}, {way:?}"));
            }
        }
    }
}

#[test]
fn eyes_in_one_place_see_what_one_eye_sees() {
    let test = store(16);
    for (name, camera, _) in cameras() {
        for way in WAYS {
            let Some(mut session) = session(&test.store, way) else { continue };
            let mono = session.resolve(&scene(camera, None), SIZE).expect("the scene is possible");
            let mut pair = ResolvedScene { stereo: Some(StereoLayout::TopBottom), ..mono.clone() };
            let layer = &mut pair.layers[0];
            let mut right = layer.frames[0].clone();
            right.settings.rays = right.settings.rays.from_aside(0.0, 9.0);
            layer.view.other_eye = Some(right.settings.rays);
            layer.frames.push(right);
            let one = picture(&mut session, &mono).0;
            let two = picture(&mut session, &pair).0;
            assert_eq!(two.rgb, [&one.rgb[..], &one.rgb[..]].concat(), "{name}, {way:?}");
        }
    }
}

fn picture(session: &mut Session, scene: &ResolvedScene) -> (Picture, RenderStats) {
    let mut stats = RenderStats::default();
    let picture = render_settled(session, scene, Duration::from_secs(60), Instant::now(), &mut stats, &mut Vec::new());
    (picture.expect("the picture settles"), stats)
}

/// Bricks seen by both eyes are uploaded once: the pair takes the union of the two eyes' bricks.
#[test]
fn one_residency_set_serves_both_eyes() {
    let test = store(8);
    let (low, high) = geometry().world_box(EXTENT);
    let camera = Camera::looking_at_box((low, high));
    // The volume extends beyond the picture on all sides.
    let projection = Projection::Perspective { fov_y_deg: 15.0 };
    let near = Camera { eye: camera.eye.midpoint(camera.target), projection, ..camera };
    let stereo = stereo(&near, StereoLayout::Anaglyph, 0.1);
    let pair = Scene { level: LevelPolicy::Locked(0), ..scene(near, Some(stereo)) };
    for way in WAYS {
        let Some(both) = session(&test.store, way) else { continue };
        let uploads = |mut session: Session, resolved: &ResolvedScene| {
            let stats = picture(&mut session, resolved).1;
            let own: HashSet<_> = session.draw_lists().flat_map(|list| &list.cells).map(|cell| cell.brick).collect();
            (stats.bricks.uploaded, own)
        };
        let resolved = both.resolve(&pair, SIZE).expect("the scene is possible");
        let (uploaded, drawn) = uploads(both, &resolved);
        let view = &resolved.layers[0].view;
        let [left, right] = [view.clone(), view.from_other_eye()].map(|view| {
            let mut alone = ResolvedScene { stereo: None, ..resolved.clone() };
            let layer = &mut alone.layers[0];
            layer.frames.truncate(1);
            layer.frames[0].settings.rays = view.rays;
            layer.view = brickyard::pager::View { other_eye: None, ..view };
            uploads(session(&test.store, way).expect("the same backend"), &alone)
        });
        assert_eq!(drawn, left.1.union(&right.1).copied().collect(), "{way:?}");
        assert!(left.1 != right.1, "{way:?}: each eye sees bricks that the other does not, at the picture's sides");
        let alone = left.0.max(right.0);
        // Only a border at two sides is seen by a single eye, for eyes three times as far apart as by default; and the number
        // of stand-ins for missing bricks varies.
        assert!(uploaded * 100 <= alone * 115, "{way:?}: {uploaded} against {alone}");
    }
}

/// The command: every layout, in passes too, equals the oracle's for the same scene file.
#[test]
fn the_command_makes_every_layout() {
    let sandbox = Sandbox::default();
    sandbox.run_ok("synth ct ct.zarr --shape 48,40,44 --brick 16 --shard 32 --progress none");
    let flags = "--size 64x48 --transfer ct-skin --lighting none --aa 1 --overwrite";
    let render = |output: &str, more: &str| {
        sandbox.run_ok(&format!("render ct.zarr -o {output} {flags} {more}"));
        read_png(&sandbox.path(output))
    };
    for layout in ["side-by-side", "top-bottom", "anaglyph", "interlaced"] {
        let json = format!(r#"{{"stereo": {{"layout": "{layout}", "eye_separation": 12, "convergence": 150}}}}"#);
        sandbox.write("scene.json", json);
        let stereo = "--scene scene.json";
        let expected = render("r.png", &format!("{stereo} --compositor reference"));
        assert_eq!((expected.width, expected.height), (64, 48));
        assert_same(&render("o.png", stereo), &expected, layout);
        // A flag with the layout keeps the file's lengths.
        let other = format!("{stereo} --stereo {layout} --compositor reference");
        assert_eq!(render("o.png", &other), expected, "{layout}");
        let (code, _, stderr) = sandbox.run(&format!("render ct.zarr -o o.png {flags} {stereo} --exact --backend gpu"));
        if code == 0 {
            assert_same(&read_png(&sandbox.path("o.png")), &expected, &format!("{layout}, in passes"));
        } else {
            assert!(stderr.to_lowercase().contains("adapter"), "{stderr}");
            leave_out("gpu", stderr);
        }
    }
}

/// A moving camera, with feedback from both eyes: it comes to rest, and both eyes equal an offline pair's.
#[test]
fn live_pairs_settle() {
    let test = store(16);
    for way in WAYS {
        let options = SessionOptions { live: true, ..options(way, 256 << 20, 256 << 20) };
        let Some(mut session) = open_session(&test.store, options) else { continue };
        let (_, camera, separation) = cameras()[0];
        let scene_at = |turn_deg: f64| {
            let camera = camera.orbited(turn_deg);
            let stereo = Some(stereo(&camera, StereoLayout::Interlaced, separation));
            // Otherwise hysteresis may keep finer bricks than the oracle's.
            Scene { level: LevelPolicy::Locked(0), ..scene(camera, stereo) }
        };
        for turn_deg in [0.0, 3.0, 6.0] {
            let frame = session.step(&scene_at(turn_deg), SIZE).expect("a step");
            session.draw(&frame).expect("a picture");
        }
        let (picture, _) = settled(&mut session, &scene_at(9.0), SIZE);
        assert_same(&picture, &oracle(&test.store, &scene_at(9.0), SIZE), &format!("{way:?}"));
    }
}
