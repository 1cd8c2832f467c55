//! Pictures end to end: pack, page, render on both backends with every compositor, and compare with the oracle, with formulas
//! and with symmetry.

use brickyard::session::Session;
use brickyard::store::Store;
use brickyard::volume::{
    Camera, Extent, Geometry, Gradient, LevelPolicy, Lighting, LightingModel, Mode, Picture, Projection, Scene,
    TransferFunction, Voxel,
};
use brickyard_tests::sample::sampled;
use brickyard_tests::{
    FunctionSource, TestStore, WAYS, Way, assert_same, assert_same_surface, in_mode, oracle, session, session_within,
    session_without_skipping, sessions, settled,
};
use glam::DVec3;
use std::sync::Arc;

const SIZE: (u32, u32) = (97, 75);

/// Shells around the centre with a wavy radius, in 0..=1: edges, thin layers and smooth parts.
fn shells(extent: Extent, [x, y, z]: [u32; 3]) -> f64 {
    let n = extent.to_array().map(f64::from);
    let p = [x as f64 / n[0] - 0.5, y as f64 / n[1] - 0.5, z as f64 / n[2] - 0.5];
    let r = (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt() + 0.02 * (20.0 * p[0]).sin() * (17.0 * p[1]).cos();
    if r > 0.52 { 0.0 } else { 0.5 + 0.5 * (28.0 * r).cos() }
}

/// Waves without a flat part, so that least, greatest and mean values along rays all vary, in 0..=1.
fn waves(extent: Extent, [x, y, z]: [u32; 3]) -> f64 {
    let [u, v, w] = [x, y, z].map(f64::from);
    let slope = u / extent.x as f64;
    0.5 + 0.2 * (0.31 * u + 0.11 * v).sin() + 0.15 * (0.23 * v - 0.17 * w).cos() + 0.15 * (2.0 * slope - 1.0)
}

fn transfer(low: f64, high: f64, unit_distance: f64) -> TransferFunction {
    let at = |t: f64| low + t * (high - low);
    TransferFunction {
        color: vec![
            [at(0.0), 0.1, 0.2, 0.9],
            [at(0.5), 0.2, 0.9, 0.3],
            [at(0.9), 1.0, 0.6, 0.1],
            [at(1.0), 1.0, 1.0, 1.0],
        ],
        opacity: vec![[at(0.15), 0.0], [at(0.5), 0.06], [at(0.8), 0.25], [at(1.0), 0.5]],
        unit_distance,
        ..TransferFunction::default()
    }
}

fn perspective(eye: DVec3, target: DVec3) -> Camera {
    Camera { eye, target, up: DVec3::Z, projection: Projection::Perspective { fov_y_deg: 40.0 } }
}

/// Cameras by their risks. `low` and `high` are the corners of the volume's world box.
fn cameras(low: DVec3, high: DVec3) -> Vec<(&'static str, Camera)> {
    let (centre, size) = ((low + high) * 0.5, high - low);
    let at = |x: f64, y: f64, z: f64| low + size * DVec3::new(x, y, z);
    let ortho = Projection::Orthographic { height: size.length() };
    vec![
        ("outside", perspective(at(1.9, -1.2, 1.4), centre)),
        ("orthographic", Camera { projection: ortho, ..perspective(at(-1.0, 2.0, 0.9), centre) }),
        ("orthographic along an axis", Camera { projection: ortho, ..perspective(at(0.5, 3.0, 0.5), centre) }),
        // Along a plane between bricks, and from a corner of one.
        ("grazing", perspective(at(-0.4, 0.25, 0.25), at(1.0, 0.25, 0.25))),
        ("grazing the top face", perspective(at(-0.5, 0.5, 1.0), at(1.0, 0.5, 0.97))),
        ("inside a brick", perspective(at(0.31, 0.42, 0.57), at(0.9, 0.8, 0.3))),
        ("inside, on a border between bricks", perspective(centre, at(0.2, 0.9, 0.6))),
    ]
}

/// A scene in a mode: these volumes have values, from 0 to 255, on both sides of the surface.
fn of_mode(mode: Mode, scene: Scene) -> Scene {
    in_mode(scene, mode, 110.0)
}

/// A store, and its sessions for every way to draw.
struct Subject {
    store: Arc<Store>,
    sessions: Vec<(Way, Session)>,
}

impl Subject {
    fn new(test: &TestStore) -> Self {
        Self { store: test.store.clone(), sessions: sessions(&test.store) }
    }

    /// Checks that every way's settled picture equals the oracle's.
    fn check(&mut self, scene: &Scene, what: &str) {
        let expected = oracle(&self.store, scene, SIZE);
        for (way, session) in &mut self.sessions {
            let (picture, stats) = settled(session, scene, SIZE);
            assert!(!stats.memory_bound && stats.bricks.failed == 0, "{what}: {stats:?}");
            let same = if scene.mode == Mode::Isosurface { assert_same_surface } else { assert_same };
            same(&picture, &expected, &format!("{what}, {way:?}"));
        }
    }
}

fn check_volume<T: Voxel>(
    extent: Extent,
    geometry: Geometry,
    value: impl Fn(f64) -> T + Send + Sync,
    window: (f64, f64),
) {
    let source = FunctionSource::new(extent, geometry.clone(), |_, _, v| value(shells(extent, v)));
    let test = TestStore::pack(&source, 16);
    let mut subject = Subject::new(&test);
    let (low, high) = geometry.world_box(extent);
    let transfer = transfer(window.0, window.1, geometry.voxel_size(extent) * 2.0);
    for (name, camera) in cameras(low, high) {
        let scene = Scene { camera: Some(camera), background: [0.1, 0.05, 0.2], ..Scene::of(transfer.clone()) };
        subject.check(&scene, &format!("{} {extent} {name}", T::TYPE));
        let surface = in_mode(scene, Mode::Isosurface, window.0 + 0.37 * (window.1 - window.0));
        subject.check(&surface, &format!("surface in {} {extent} {name}", T::TYPE));
    }
}

#[test]
fn dvr_and_surfaces_of_u8_equal_the_oracle_from_everywhere() {
    check_volume(Extent::new(61, 53, 67), Geometry::default(), |v| u8::from_f64_rounded(v * 255.0), (0.0, 255.0));
}

#[test]
fn dvr_and_surfaces_of_anisotropic_u16_equal_the_oracle_from_everywhere() {
    let geometry = Geometry {
        spacing: DVec3::new(0.5, 0.8, 2.1),
        origin: DVec3::new(-7.0, 3.0, 11.0),
        unit: Some("millimeter".into()),
        ..Geometry::default()
    };
    check_volume(Extent::new(70, 45, 21), geometry, |v| u16::from_f64_rounded(500.0 + v * 4095.0), (500.0, 4595.0));
}

#[test]
fn dvr_and_surfaces_of_signed_16_bit_equal_the_oracle() {
    check_volume(
        Extent::new(33, 48, 40),
        Geometry::default(),
        |v| i16::from_f64_rounded(v * 3000.0 - 1000.0),
        (-1000.0, 2000.0),
    );
}

#[test]
fn dvr_and_surfaces_of_floats_with_invalid_voxels_equal_the_oracle() {
    // Values above 0.97 are missing: the invalid regions have curved borders inside bricks and across them.
    let value = |v: f64| if v > 0.97 { f32::NAN } else { (v * 12.0 - 3.0) as f32 };
    check_volume(Extent::new(50, 41, 44), Geometry::default(), value, (-3.0, 9.0));
}

#[test]
fn all_modes_equal_the_oracle() {
    let extent = Extent::new(57, 64, 39);
    let source =
        FunctionSource::new(extent, Geometry::default(), |_, _, v| u8::from_f64_rounded(waves(extent, v) * 255.0));
    let test = TestStore::pack(&source, 16);
    let mut subject = Subject::new(&test);
    let (low, high) = Geometry::default().world_box(extent);
    for mode in Mode::ALL {
        for (name, camera) in cameras(low, high) {
            let scene = of_mode(mode, Scene { camera: Some(camera), ..Scene::of(transfer(0.0, 255.0, 2.0)) });
            subject.check(&scene, &format!("{mode:?} {name}"));
        }
    }
}

#[test]
fn every_level_lock_and_step_equals_the_oracle() {
    let extent = Extent::new(75, 50, 61);
    let source =
        FunctionSource::new(extent, Geometry::default(), |_, _, v| u8::from_f64_rounded(shells(extent, v) * 255.0));
    let test = TestStore::pack(&source, 16);
    let mut subject = Subject::new(&test);
    let (low, high) = Geometry::default().world_box(extent);
    let camera = Some(cameras(low, high)[0].1);
    for level in 0..test.store.pyramid().levels().len() as u8 {
        for step in [0.4, 1.0, 2.5] {
            let level_policy = LevelPolicy::Locked(level);
            let scene = Scene { camera, level: level_policy, step, ..Scene::of(transfer(0.0, 255.0, 2.0)) };
            subject.check(&scene, &format!("level {level} step {step}"));
            let surface = of_mode(Mode::Isosurface, scene);
            subject.check(&surface, &format!("surface, level {level} step {step}"));
        }
    }
}

/// A camera close to one corner of a long volume needs the finest level near and coarse ones far away.
#[test]
fn mixed_levels_in_one_view_equal_the_oracle() {
    let extent = Extent::new(520, 48, 48);
    let source = FunctionSource::new(extent, Geometry::default(), |_, _, [x, y, z]| {
        u8::from_f64_rounded(127.0 + 60.0 * (x as f64 * 0.21).sin() + 60.0 * ((y + z) as f64 * 0.17).cos())
    });
    let test = TestStore::pack(&source, 16);
    let mut subject = Subject::new(&test);
    let eye = DVec3::new(-6.0, 20.0, 30.0);
    for pixel_error in [1.0, 2.5] {
        let scene = Scene {
            camera: Some(perspective(eye, DVec3::new(520.0, 24.0, 20.0))),
            pixel_error,
            ..Scene::of(transfer(0.0, 255.0, 20.0))
        };
        for backend in WAYS {
            let Some(mut session) = session(&test.store, backend) else { continue };
            settled(&mut session, &scene, SIZE);
            let mut levels: Vec<u8> =
                session.draw_lists().flat_map(|list| &list.cells).map(|c| c.brick.level.0).collect();
            levels.sort_unstable();
            levels.dedup();
            assert!(levels.len() >= 3, "the view mixes levels: {levels:?}");
        }
        subject.check(&scene, &format!("mixed levels at {pixel_error} px"));
        let surface = of_mode(Mode::Isosurface, scene.clone());
        subject.check(&surface, &format!("surface of mixed levels at {pixel_error} px"));
        for i in sampled(&format!("gradients of mixed levels at {pixel_error} px"), Gradient::ALL.len(), 2) {
            let gradient = Gradient::ALL[i];
            let lighting = Lighting { model: LightingModel::BlinnPhong, gradient, ..Lighting::default() };
            let lit = Scene { lighting, ..scene.clone() };
            subject.check(&lit, &format!("mixed levels at {pixel_error} px, {gradient:?}"));
        }
    }
}

/// A clip box cuts through bricks and voxels; everything outside is neither shown nor read.
#[test]
fn skipping_changes_no_picture() {
    let extent = Extent::new(61, 53, 67);
    let geometry = Geometry { spacing: DVec3::new(0.5, 0.8, 1.1), ..Geometry::default() };
    let value = |v| u8::from_f64_rounded(shells(extent, v) * 255.0);
    let test = TestStore::pack(&FunctionSource::new(extent, geometry.clone(), |_, _, v| value(v)), 16);
    let (low, high) = geometry.world_box(extent);
    let (_, camera) = cameras(low, high).into_iter().next().expect("a camera");
    for mode in Mode::ALL {
        let transfer = transfer(140.0, 255.0, geometry.voxel_size(extent) * 2.0);
        let scene = of_mode(mode, Scene { camera: Some(camera), ..Scene::of(transfer) });
        let expected = oracle(&test.store, &scene, SIZE);
        for way in WAYS {
            let Some(mut with) = session(&test.store, way) else { continue };
            let (_, with) = settled(&mut with, &scene, SIZE);
            let mut without = session_without_skipping(&test.store, way).expect("the same backend");
            let (picture, without) = settled(&mut without, &scene, SIZE);
            assert_same(&picture, &expected, &format!("{mode:?} {way:?}"));
            // Invisible bricks are wanted only without skipping. (The number of stand-ins uploaded for them depends on the order
            // of arrival.)
            let (with, without) = (with.bricks.wanted, without.bricks.wanted);
            let leaves_out = matches!(mode, Mode::Dvr | Mode::Isosurface);
            assert!(if leaves_out { with < without } else { with == without }, "{mode:?} {way:?}: {with}, {without}");
        }
    }
}

#[test]
fn a_clip_box_equals_the_oracle() {
    let extent = Extent::new(61, 53, 67);
    let geometry = Geometry { spacing: DVec3::new(0.5, 0.8, 1.1), ..Geometry::default() };
    let value = |v| u8::from_f64_rounded(shells(extent, v) * 255.0);
    let test = TestStore::pack(&FunctionSource::new(extent, geometry.clone(), |_, _, v| value(v)), 16);
    let mut subject = Subject::new(&test);
    let (low, high) = geometry.world_box(extent);
    let at = |x: f64, y: f64, z: f64| low + (high - low) * DVec3::new(x, y, z);
    let clips = [
        // A corner is cut out; a slab thinner than a brick; a box beyond one side.
        [at(0.13, 0.0, 0.21), at(0.72, 1.0, 0.9)],
        [at(0.0, 0.4, 0.0), at(1.0, 0.47, 1.0)],
        [at(0.5, -3.0, -1.0), at(2.0, 0.61, 0.53)],
    ];
    for (name, camera) in cameras(low, high) {
        for (i, &clip) in clips.iter().enumerate() {
            for mode in [Mode::Dvr, Mode::Average, Mode::Isosurface] {
                let transfer = transfer(0.0, 255.0, geometry.voxel_size(extent) * 2.0);
                let (camera, clip) = (Some(camera), Some(clip));
                let scene = of_mode(mode, Scene { camera, clip, ..Scene::of(transfer) });
                let expected = oracle(&test.store, &scene, SIZE);
                if expected.rgb.iter().all(|p| *p == expected.rgb[0]) {
                    // This camera looks past the remaining part.
                    continue;
                }
                subject.check(&scene, &format!("{name}, clip box {i}, {mode:?}"));
            }
        }
    }
    let scene = |clip| Scene { clip, level: LevelPolicy::Locked(0), ..Scene::default() };
    for backend in WAYS {
        let wanted = |clip| {
            let mut session = session(&test.store, backend)?;
            Some(settled(&mut session, &scene(clip), SIZE).1.bricks.uploaded)
        };
        let Some(whole) = wanted(None) else { continue };
        let clipped = wanted(Some(clips[1])).expect("the same backend");
        assert!(clipped * 3 < whole, "{backend:?}: {clipped} of {whole} bricks");
    }
}

/// A constant medium has Beer-Lambert's opacity, for any step, bricks and levels.
#[test]
fn a_constant_medium_is_beer_lambert() {
    let extent = Extent::new(70, 70, 70);
    let geometry = Geometry { spacing: DVec3::splat(0.5), ..Geometry::default() };
    let source = FunctionSource::new(extent, geometry.clone(), |_, _, _| 100u8);
    let transfer = TransferFunction {
        color: vec![[0.0, 1.0, 0.5, 0.25]],
        opacity: vec![[0.0, 0.05]],
        unit_distance: 1.0,
        ..TransferFunction::default()
    };
    let (low, high) = geometry.world_box(extent);
    let centre = (low + high) * 0.5;
    let camera = Camera {
        projection: Projection::Orthographic { height: 20.0 },
        ..perspective(centre - DVec3::new(0.0, 60.0, 0.0), centre)
    };
    let alpha = 1.0 - 0.95f64.powf(35.0);
    let expected = Picture::quantise([1.0, 0.5, 0.25].map(|c| (c * alpha) as f32));
    for edge in [16, 64] {
        let test = TestStore::pack(&source, edge);
        let mut sessions = sessions(&test.store);
        for (step, level) in [
            (0.3, LevelPolicy::Auto),
            (1.0, LevelPolicy::Auto),
            (4.0, LevelPolicy::Locked(0)),
            (1.0, LevelPolicy::Locked(1)),
        ] {
            let scene = Scene { camera: Some(camera), step, level, ..Scene::of(transfer.clone()) };
            for (backend, session) in &mut sessions {
                let (picture, _) = settled(session, &scene, SIZE);
                for pixel in &picture.rgb {
                    for k in 0..3 {
                        // One code: the half-float accumulation and the 8-bit rounding may meet on an edge.
                        let close = pixel[k].abs_diff(expected[k]) <= 1;
                        assert!(
                            close,
                            "edge {edge} step {step} {level:?} {backend:?}: {pixel:?}, expected {expected:?}"
                        );
                    }
                }
            }
        }
    }
}

/// Bricks must be invisible: the same volume in bricks of 16, 32 and as one brick of 128.
#[test]
fn the_brick_size_does_not_show() {
    let extent = Extent::new(90, 77, 101);
    let source =
        FunctionSource::new(extent, Geometry::default(), |_, _, v| u8::from_f64_rounded(shells(extent, v) * 255.0));
    let stores = [16, 32, 128].map(|edge| TestStore::pack(&source, edge));
    let mut drawn = stores.each_ref().map(|test| sessions(&test.store));
    let (low, high) = Geometry::default().world_box(extent);
    for (name, camera) in cameras(low, high) {
        let scene =
            Scene { camera: Some(camera), level: LevelPolicy::Locked(0), ..Scene::of(transfer(0.0, 255.0, 2.0)) };
        let surface = of_mode(Mode::Isosurface, scene.clone());
        for scene in [&scene, &surface] {
            let pictures = drawn.each_mut().map(|sessions| {
                let picture = |(way, session): &mut (Way, Session)| (*way, settled(session, scene, SIZE).0);
                sessions.iter_mut().map(picture).collect::<Vec<_>>()
            });
            let same = if scene.mode == Mode::Isosurface { assert_same_surface } else { assert_same };
            let [small, medium, whole] = &pictures;
            for bricks in [small, medium] {
                for ((way, found), (_, whole)) in bricks.iter().zip(whole) {
                    same(found, whole, &format!("{:?} {name} {way:?}", scene.mode));
                }
            }
        }
    }
}

/// A camera turned by a right angle about a symmetric volume gives the turned picture.
#[test]
fn a_right_angle_turns_the_picture() {
    let n = 64u32;
    let extent = Extent::new(n, n, 48);
    let source = FunctionSource::new(extent, Geometry::default(), |_, _, [x, y, z]| {
        // Unchanged by (x, y) -> (y, -x) about the axis; asymmetric in z and not a body of revolution.
        let (u, v) = (x as f64 - 31.5, y as f64 - 31.5);
        let square = u.abs().max(v.abs()) + 0.3 * (u * v * 0.02).powi(2).cos() + z as f64 * 0.2;
        u8::from_f64_rounded(127.5 + 127.5 * (square * 0.4).sin())
    });
    let test = TestStore::pack(&source, 16);
    let centre = DVec3::new(31.5, 31.5, 23.5);
    let start = Camera { up: DVec3::Z, ..perspective(centre + DVec3::new(70.0, 33.0, 40.0), centre) };
    for backend in WAYS {
        let Some(mut session) = session(&test.store, backend) else { continue };
        let mut picture = |angle: f64| {
            let scene = Scene { camera: Some(start.orbited(angle)), ..Scene::of(transfer(0.0, 255.0, 3.0)) };
            settled(&mut session, &scene, SIZE).0
        };
        let first = picture(0.0);
        for angle in [90.0, 180.0, 270.0] {
            assert_same(&picture(angle), &first, &format!("{backend:?} turned by {angle}"));
        }
    }
}

/// A budget far too small for the view: the picture is coarser, complete, and reports it.
#[test]
fn a_tiny_budget_gives_a_complete_coarser_picture() {
    let extent = Extent::new(160, 160, 160);
    let source = FunctionSource::new(extent, Geometry::default(), |_, _, _| 200u8);
    let test = TestStore::pack(&source, 16);
    let (low, high) = Geometry::default().world_box(extent);
    let opaque = TransferFunction {
        color: vec![[0.0, 1.0, 1.0, 1.0]],
        opacity: vec![[0.0, 1.0]],
        unit_distance: 1.0,
        ..TransferFunction::default()
    };
    let camera = perspective((low + high) * 0.5 + DVec3::new(150.0, -190.0, 120.0), (low + high) * 0.5);
    let scene = Scene { camera: Some(camera), level: LevelPolicy::Locked(0), ..Scene::of(opaque) };
    let expected = oracle(&test.store, &scene, SIZE);
    for backend in WAYS {
        // A slot is 18^3 codes; 3 MiB have room for one or two hundred of the thousand bricks.
        let Some(mut session) = session_within(&test.store, backend, 3 << 20, 64 << 20) else { continue };
        let (picture, stats) = settled(&mut session, &scene, SIZE);
        assert!(stats.memory_bound && stats.effective_pixel_error > Some(0.0), "{stats:?}");
        assert!(stats.gpu_bytes_peak <= 3 << 20 && stats.host_bytes_peak <= 64 << 20, "{stats:?}");
        // A constant opaque body looks the same at every level: any hole would show.
        assert_same(&picture, &expected, &format!("{backend:?} within 3 MiB"));
    }
}
