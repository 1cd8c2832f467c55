//! Changes in an open session: the transfer function, the camera, an unreadable brick. Every way to draw reaches the same
//! picture, and fetches no more than necessary.

use brickyard::backend::BackendChoice;
use brickyard::oracle::render_reference;
use brickyard::pager::{BrickError, BrickSource};
use brickyard::session::{Session, SessionError, SessionOptions, VolumeSource};
use brickyard::store::{Downsample, IoMode, PackOptions, Store};
use brickyard::volume::{
    BrickId, Camera, Extent, Filter, Geometry, LevelPolicy, Lighting, LightingModel, Method, Mode, Picture, Pyramid,
    Sampling, Scene, SceneLayer, TransferFunction, Voxel, VoxelType,
};
use brickyard_tests::{
    FunctionSource, Random, TestStore, WAYS, assert_same, open_session_of, options, oracle, read_png, session,
    session_within, settled,
};
use glam::DVec3;
use std::sync::Arc;
use std::time::Duration;

const SIZE: (u32, u32) = (97, 75);
const EXTENT: Extent = Extent::new(90, 77, 83);

/// Waves without a flat part, from 0 to 255.
fn waves([x, y, z]: [u32; 3]) -> u8 {
    let [u, v, w] = [x, y, z].map(f64::from);
    u8::from_f64_rounded(127.0 + 60.0 * (0.11 * u + 0.07 * v).sin() + 60.0 * (0.09 * v - 0.08 * w).cos())
}

fn store() -> TestStore {
    TestStore::pack(&FunctionSource::new(EXTENT, Geometry::default(), |_, _, v| waves(v)), 16)
}

/// Every value is visible, so every brick is wanted.
fn transfer(red: f64, opacity: f64) -> TransferFunction {
    TransferFunction {
        color: vec![[0.0, red, 0.1, 0.4], [255.0, 0.9, 1.0 - red, 0.2]],
        opacity: vec![[0.0, 0.2 * opacity], [255.0, opacity]],
        unit_distance: 4.0,
        ..TransferFunction::default()
    }
}

fn camera(turn_deg: f64) -> Camera {
    let (low, high) = Geometry::default().world_box(EXTENT);
    Camera::looking_at_box((low, high)).orbited(turn_deg)
}

fn scene(transfer: TransferFunction, turn_deg: f64) -> Scene {
    Scene { camera: Some(camera(turn_deg)), level: LevelPolicy::Locked(0), ..Scene::of(transfer) }
}

#[test]
fn an_edit_of_the_transfer_function_uploads_nothing() {
    let test = store();
    for way in WAYS {
        let Some(mut session) = session(&test.store, way) else { continue };
        let (_, before) = settled(&mut session, &scene(transfer(0.9, 0.3), 20.0), SIZE);
        for (red, opacity) in [(0.2, 0.02), (0.7, 0.9)] {
            let edited = scene(transfer(red, opacity), 20.0);
            // Like a caller that goes on drawing meanwhile; the next test's edits are not prepared.
            session.prepare(&transfer(red, opacity));
            while !session.is_prepared(&transfer(red, opacity)) {
                std::thread::sleep(Duration::from_millis(1));
            }
            let (picture, after) = settled(&mut session, &edited, SIZE);
            assert_same(&picture, &oracle(&test.store, &edited, SIZE), &format!("{way:?} at {opacity}"));
            assert_eq!(after.bricks.uploaded, before.bricks.uploaded, "{way:?} at {opacity}");
            assert_eq!(after.bytes.decoded, before.bytes.decoded, "{way:?} at {opacity}");
        }
    }
}

/// Nor does one by gradients, nor one of values alone after it.
#[test]
fn an_edit_by_gradient_uploads_nothing() {
    let test = store();
    let by_gradient =
        |steepest: f64| TransferFunction { gradient_opacity: vec![[2.0, 0.0], [steepest, 1.0]], ..transfer(0.4, 0.6) };
    let first = scene(by_gradient(8.0), 20.0);
    for way in WAYS {
        let Some(mut session) = session(&test.store, way) else { continue };
        let (shown, before) = settled(&mut session, &first, SIZE);
        for transfer in [by_gradient(20.0), transfer(0.7, 0.9), by_gradient(12.0)] {
            let edited = scene(transfer, 20.0);
            let (picture, after) = settled(&mut session, &edited, SIZE);
            assert_same(&picture, &oracle(&test.store, &edited, SIZE), &format!("{way:?}"));
            assert_ne!(picture, shown, "{way:?}");
            assert_eq!(after.bricks.uploaded, before.bricks.uploaded, "{way:?}");
            assert_eq!(after.bytes.decoded, before.bytes.decoded, "{way:?}");
        }
    }
}

/// Light, splines, pre-integration, another size, another mode and another layer: slots and tables are recreated for each, and
/// bricks in main memory are not decoded again.
#[test]
fn scenes_that_ask_for_more_go_on_with_what_is_decoded() {
    let test = store();
    let volumes = || vec![VolumeSource::of_store(&test.store); 2];
    let plain = scene(transfer(0.9, 0.3), 20.0);
    let sampled = |method, filter| Scene { sampling: Sampling { method, filter, ..plain.sampling }, ..plain.clone() };
    let lit = Lighting { model: LightingModel::Phong, ..Lighting::default() };
    let [first, second] = [0, 0].map(|source| SceneLayer { source: Some(source), ..plain.layers[0].clone() });
    let scenes = [
        ("plain", plain.clone(), SIZE),
        ("larger", plain.clone(), (120, 80)),
        ("splines", sampled(Method::Udvr, Filter::Tricubic), SIZE),
        ("lit", Scene { lighting: lit, ..plain.clone() }, SIZE),
        ("pre-integrated", sampled(Method::Plvs, Filter::Trilinear), SIZE),
        ("a projection", Scene { mode: Mode::Average, ..plain.clone() }, SIZE),
        ("two layers", Scene { layers: vec![first, second], ..plain.clone() }, SIZE),
        ("plain again", plain.clone(), SIZE),
    ];
    // The slots of `compute` are those of `raycast`.
    for (way, live) in [(WAYS[0], false), (WAYS[1], true), (WAYS[3], false), (WAYS[3], true)] {
        let options = SessionOptions { live, ..options(way, 64 << 20, 64 << 20) };
        let Some(mut session) = open_session_of(volumes(), options) else { continue };
        let (mut decoded, mut uploaded, mut superseded) = (0, 0, None);
        for (what, scene, size_px) in &scenes {
            let what = format!("{what}, {way:?}, live: {live}");
            let (picture, stats) = settled(&mut session, scene, *size_px);
            let resolved = session.resolve(scene, *size_px).expect("it was drawn");
            let expected = render_reference(&[&test.store, &test.store], &resolved, 1 << 30).expect("the levels");
            assert!(picture.difference(&expected).max <= 2, "{what}: {:?}", picture.difference(&expected));
            assert!(stats.gpu_bytes_peak <= 64 << 20 && stats.host_bytes_peak <= 64 << 20, "{what}: {stats:?}");
            // The second layer has its own cache.
            let most = if scene.layers.len() == 2 || decoded == 0 { 2 << 20 } else { decoded };
            assert!(stats.bytes.decoded <= most, "{what}: {} bytes after {decoded}", stats.bytes.decoded);
            assert!(stats.bricks.uploaded >= uploaded, "{what}: counts go on");
            (decoded, uploaded) = (stats.bytes.decoded, stats.bricks.uploaded);
            let frame = session.step(scene, *size_px).expect("a step");
            if let Some(earlier) = superseded.replace(frame) {
                let drawn = session.draw(&earlier);
                assert!(matches!(drawn, Err(SessionError::Superseded)), "{what}: an earlier step's frame is drawn");
            }
        }
    }
}

/// A maximum projection uses maxima, as in the command, and fog after it means.
#[test]
fn modes_are_drawn_from_the_pyramids_that_suit_them() {
    // Of eight voxels one is four times as bright.
    let spiky = |_, _, v: [u32; 3]| if v.iter().all(|i| i % 2 == 0) { waves(v) } else { waves(v) / 4 };
    let source = FunctionSource::new(EXTENT, Geometry::default(), spiky);
    let downsample = "mean,max".parse().expect("two pyramids");
    let options = PackOptions { edge: 16, downsample, ..PackOptions::new(VoxelType::U8) };
    let test = TestStore::pack_with(&source, options);
    let opened = SessionOptions { backend: BackendChoice::Cpu, ..SessionOptions::default() };
    let mut session = Session::open(test.path(), opened).expect("the store opens");
    let fog = Scene { level: LevelPolicy::Locked(1), ..scene(transfer(0.9, 0.3), 20.0) };
    let maximum = Store::open_reduced(test.path(), Downsample::Max, IoMode::default()).expect("the other pyramid");
    let maximum = Arc::new(maximum);
    for (mode, store) in [(Mode::Dvr, &test.store), (Mode::Mip, &maximum), (Mode::Dvr, &test.store)] {
        let scene = Scene { mode, ..fog.clone() };
        let rendered = session.render(&scene, SIZE).expect("a picture");
        assert_same(&rendered.picture, &oracle(store, &scene, SIZE), &format!("{mode:?}"));
    }
    let maxima = oracle(&maximum, &Scene { mode: Mode::Mip, ..fog.clone() }, SIZE);
    let means = oracle(&test.store, &Scene { mode: Mode::Mip, ..fog }, SIZE);
    assert!(maxima.difference(&means).max > 5, "the pyramids look alike");
}

/// Voxels computed by a program, without a file.
struct Computed {
    pyramid: Pyramid,
    geometry: Geometry,
}

impl BrickSource for Computed {
    fn pyramid(&self) -> &Pyramid {
        &self.pyramid
    }
    fn geometry(&self) -> &Geometry {
        &self.geometry
    }
    fn voxel_type(&self) -> VoxelType {
        VoxelType::U8
    }
    fn value_range(&self) -> (f64, f64) {
        (0.0, 255.0)
    }
    fn read_core(&self, id: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
        let factor = self.pyramid.level(id.level).factor;
        for (voxel, place) in out.iter_mut().zip(self.pyramid.core_voxels(id.index)) {
            *voxel = waves(std::array::from_fn(|axis| place[axis] * factor[axis]));
        }
        Ok(())
    }
}

#[test]
fn a_program_s_own_bricks_are_drawn_as_a_store_s() {
    let test = store();
    let computed = Computed { pyramid: test.store.pyramid().clone(), geometry: Geometry::default() };
    let volume = VolumeSource::new(Arc::new(computed));
    let scene = scene(transfer(0.9, 0.3), 20.0);
    let expected = oracle(&test.store, &scene, SIZE);
    for way in WAYS {
        let options = options(way, 64 << 20, 64 << 20);
        let Some(mut session) = open_session_of(vec![volume.clone()], options) else { continue };
        let rendered = session.render(&scene, SIZE).expect("a picture");
        assert_same(&rendered.picture, &expected, &format!("{way:?}"));
        let file = test.path().with_file_name("computed.png");
        rendered.save(&file).expect("it is written");
        assert_eq!(read_png(&file), rendered.picture);
    }
}

/// By whatever route a view is reached, its settled picture equals that of a session that never saw another.
#[test]
fn a_view_after_a_flight_equals_the_oracle() {
    let test = store();
    let (low, high) = Geometry::default().world_box(EXTENT);
    for way in WAYS {
        let Some(mut session) = session_within(&test.store, way, 8 << 20, 4 << 20) else { continue };
        let (mut random, mut was_covered) = (Random(3), false);
        let place = |random: &mut Random, reach: f64| {
            let unit = DVec3::new(random.unit(), random.unit(), random.unit()) - 0.5;
            (low + high) * 0.5 + unit * (high - low) * reach
        };
        for _ in 0..3 {
            for _ in 0..20 {
                let (eye, target) = (place(&mut random, 3.0), place(&mut random, 0.5));
                let camera = Camera { eye, target, ..camera(0.0) };
                let scene = Scene { camera: Some(camera), ..Scene::of(transfer(0.5, 0.2)) };
                let frame = session.step(&scene, SIZE).expect("a frame");
                session.draw(&frame).expect("a picture");
                assert!(frame.status.covered || !was_covered, "{way:?}: a hole");
                was_covered = frame.status.covered;
            }
            let eye = (low + high) * 0.5 + DVec3::new(150.0, -120.0, 90.0) * (1.0 + random.unit());
            let camera = Camera { eye, target: (low + high) * 0.5, ..camera(0.0) };
            let rest = Scene { camera: Some(camera), ..Scene::of(transfer(0.5, 0.2)) };
            let (picture, stats) = settled(&mut session, &rest, SIZE);
            assert!(!stats.memory_bound, "{stats:?}");
            assert_same(&picture, &oracle(&test.store, &rest, SIZE), &format!("{way:?}"));
        }
    }
}

/// Damages one encoded brick of level 0.
fn damage(test: &TestStore) {
    let path = test.path().join("0/c/0/0/0");
    let mut bytes = std::fs::read(&path).expect("a shard");
    // Bricks lie back to back from the start; the middle of the data is inside one of them.
    let middle = bytes.len() / 2;
    bytes[middle] ^= 0x10;
    std::fs::write(&path, bytes).expect("the shard is ours");
}

#[test]
fn a_damaged_brick_shows_its_ancestor_everywhere_alike() {
    let whole = store();
    let damaged = store();
    damage(&damaged);
    let damaged_store = Arc::new(Store::open(damaged.path()).expect("it opens"));
    for mode in [Mode::Dvr, Mode::Mip, Mode::MinIp, Mode::Average] {
        let scene = Scene { mode, ..scene(transfer(0.6, 0.1), 20.0) };
        let sound = oracle(&whole.store, &scene, SIZE);
        let mut first: Option<Picture> = None;
        for way in WAYS {
            let Some(mut session) = session(&damaged_store, way) else { continue };
            let (picture, stats) = settled(&mut session, &scene, SIZE);
            assert_eq!(stats.bricks.failed, 1, "{way:?}: {stats:?}");
            assert!(stats.completeness < 1.0, "{way:?}: {stats:?}");
            // One brick in 150 is drawn a level coarser where the waves are smooth: 72 to 82 dB; the GPU's table has colours of
            // 10 and 11 bits, whose rounding alone leaves 64 dB.
            let difference = picture.difference(&sound);
            assert!(difference.psnr_db > 62.0 && difference.max > 0, "{way:?} {mode:?}: {difference:?}");
            assert_same(&picture, first.get_or_insert_with(|| picture.clone()), &format!("{way:?} {mode:?}"));
        }
    }
}
