//! Narrow windows over wide channels of 32-bit types: outliers, integers beyond 16 bits, values at their type's limits. Every way to draw
//! reaches the picture of the oracle, which reads unencoded voxels; and a dragged window uploads nothing again.

use brickyard::import::Source;
use brickyard::oracle::render_reference;
use brickyard::session::{SessionOptions, VolumeSource, resolve};
use brickyard::store::Store;
use brickyard::volume::{
    Camera, Extent, Filter, Geometry, Isosurface, LevelPolicy, Lighting, LightingModel, Method, Mode, Picture,
    Sampling, Scene, SceneExpression, SceneLayer, Slice, SlotFormat, TransferFunction, Voxel,
};
use brickyard_pager::Status;
use brickyard_tests::{
    FunctionSource, TestStore, WAYS, assert_same, assert_same_surface, open_session_of, options, oracle, session,
    settled,
};
use glam::DVec3;
use std::time::{Duration, Instant};

const SIZE: (u32, u32) = (61, 47);
const EXTENT: Extent = Extent::new(40, 33, 36);

/// Waves without symmetry, from 0 to 1.
fn waves([x, y, z]: [u32; 3]) -> f64 {
    let [u, v, w] = [x, y, z].map(f64::from);
    0.5 + 0.2 * (0.31 * u + 0.17 * v).sin() + 0.2 * (0.29 * v - 0.18 * w).cos() + 0.1 * (0.4 * w).sin()
}

/// Places of the outliers, a great one and a small one.
const GREAT: [u32; 3] = [11, 9, 20];
const SMALL: [u32; 3] = [30, 21, 7];

fn pack<T: Voxel>(value: impl Fn([u32; 3]) -> T + Send + Sync) -> TestStore {
    TestStore::pack(&FunctionSource::new(EXTENT, Geometry::default(), |_, _, v| value(v)) as &dyn Source, 16)
}

/// Waves from 0 to 1 between a billion and minus a billion.
fn with_outliers(v: [u32; 3]) -> f32 {
    match v {
        GREAT => 1e9,
        SMALL => -1e9,
        _ => waves(v) as f32,
    }
}

/// A volume, and its window.
struct Subject {
    name: &'static str,
    test: TestStore,
    window: [f64; 2],
}

fn subjects() -> Vec<Subject> {
    let of = |name, test, window| Subject { name, test, window };
    // Labels of two kinds beside one of nearly the greatest value.
    let label = |v| match v {
        GREAT => 4_000_000_000,
        _ => 70_000 + (waves(v) > 0.5) as u32,
    };
    let least = |v| if v == GREAT { i32::MAX } else { i32::MIN + (20.0 * waves(v)) as i32 };
    let greatest = |v| if v == GREAT { i32::MIN } else { i32::MAX - (20.0 * waves(v)) as i32 };
    let holes = |v: [u32; 3]| match v {
        [_, 10..14, 12..20] | [3, 4, 5] => f32::NAN,
        _ => with_outliers(v),
    };
    // Like netCDF's fill value for missing measurements.
    let fill = |v: [u32; 3]| if v[0] < 30 { waves(v) as f32 } else { 9.969_21e36 };
    let both_ways = |v: [u32; 3]| match v[1] {
        9 => 2_000_000_000,
        21 => -1_000_000_000,
        _ => (20.0 * waves(v)) as i32,
    };
    vec![
        of("a fill", pack(fill), [0.2, 0.8]),
        of("integers both ways", pack(both_ways), [0.0, 20.0]),
        of("outliers", pack(with_outliers), [0.2, 0.8]),
        of("labels", pack(label), [69_999.5, 70_001.5]),
        of("the least integers", pack(least), [i32::MIN as f64, i32::MIN as f64 + 20.0]),
        of("the greatest integers", pack(greatest), [i32::MAX as f64 - 20.0, i32::MAX as f64]),
        of("holes", pack(holes), [0.2, 0.8]),
    ]
}

/// Clear below the window, and half opaque above.
fn ramp([low, high]: [f64; 2]) -> TransferFunction {
    let at = |t: f64| low + t * (high - low);
    TransferFunction {
        color: vec![[low, 0.9, 0.1, 0.2], [at(0.5), 0.1, 1.0, 0.3], [high, 0.2, 0.3, 1.0]],
        opacity: vec![[low, 0.0], [at(0.4), 0.15], [at(0.7), 0.05], [high, 0.5]],
        unit_distance: 4.0,
        ..TransferFunction::default()
    }
}

fn camera() -> Camera {
    Camera::looking_at_box(Geometry::default().world_box(EXTENT)).orbited(25.0)
}

/// Fog, plain, lit, of other methods and through splines; projections; surfaces, alone and in fog; and slices.
fn scenes(source: usize, window: [f64; 2]) -> Vec<(&'static str, Scene)> {
    let [low, high] = window;
    let layer = SceneLayer { source: Some(source), ..ramp(window).into() };
    let fog = Scene {
        camera: Some(camera()),
        layers: vec![layer.clone()],
        level: LevelPolicy::Locked(0),
        ..Scene::default()
    };
    let in_mode = |mode| Scene { mode, ..fog.clone() };
    let sampled = |method, filter| Scene { sampling: Sampling { method, filter, ..fog.sampling }, ..fog.clone() };
    let slight = [0.1, 0.6].map(|part| part * (high - low));
    let flat = TransferFunction { gradient_opacity: vec![[slight[0], 1.0], [slight[1], 0.0]], ..ramp(window) };
    let by_gradient = vec![SceneLayer { source: Some(source), ..flat.into() }];
    let lit = Lighting { model: LightingModel::Phong, ..Lighting::default() };
    let surfaces = vec![Isosurface { opacity: 0.5, ..Isosurface::at(0.5 * (low + high)) }, Isosurface::at(high)];
    let cut = vec![SceneLayer { isosurfaces: surfaces, ..layer.clone() }];
    let alone = vec![SceneLayer { isosurfaces: vec![Isosurface::at(0.5 * (low + high))], ..layer }];
    let slice = Slice { point: DVec3::new(20.0, 16.0, 13.3), normal: DVec3::new(0.1, 0.2, 1.0), thickness: 0.0 };
    vec![
        ("fog", fog.clone()),
        ("what is flat", Scene { layers: by_gradient, ..fog.clone() }),
        ("lit fog", Scene { lighting: lit, ..fog.clone() }),
        ("pre-integrated", sampled(Method::Plvs, Filter::Trilinear)),
        ("splines", sampled(Method::Udvr, Filter::Tricubic)),
        ("a maximum", in_mode(Mode::Mip)),
        ("a minimum", in_mode(Mode::MinIp)),
        ("a mean", in_mode(Mode::Average)),
        ("a surface", Scene { layers: alone, ..in_mode(Mode::Isosurface) }),
        ("surfaces in fog", Scene { layers: cut, ..fog.clone() }),
        ("a slice", Scene { slice: Some(slice), ..in_mode(Mode::Average) }),
    ]
}

fn assert_alike(found: &Picture, expected: &Picture, has_surfaces: bool, what: &str) {
    match has_surfaces {
        true => assert_same_surface(found, expected, what),
        false => assert_same(found, expected, what),
    }
}

#[test]
fn narrow_windows_over_wide_channels_are_the_oracle_s() {
    let subjects = subjects();
    let volumes: Vec<VolumeSource> =
        subjects.iter().map(|subject| VolumeSource::of_store(&subject.test.store)).collect();
    let stores: Vec<&Store> = subjects.iter().map(|subject| &*subject.test.store).collect();
    let mut shots = Vec::new();
    for (i, subject) in subjects.iter().enumerate() {
        for (look, scene) in scenes(i, subject.window) {
            let resolved = resolve(&volumes, &scene, SIZE).expect("a possible scene");
            let encoding = resolved.layers[0].frames[0].settings.encoding;
            assert_eq!(encoding.format, SlotFormat::F32, "{}", subject.name);
            let expected = render_reference(&stores, &resolved, 1 << 30).expect("the levels");
            shots.push((format!("{}, {look}", subject.name), scene, expected));
        }
    }
    for way in WAYS {
        let Some(mut session) = open_session_of(volumes.clone(), options(way, 64 << 20, 64 << 20)) else { continue };
        for (what, scene, expected) in &shots {
            let (found, _) = settled(&mut session, scene, SIZE);
            let has_surfaces = !scene.layers[0].isosurfaces.is_empty();
            assert_alike(&found, expected, has_surfaces, &format!("{what}, {way:?}"));
        }
    }
}

/// A surface around an outlier, far from the fog's window, leaves the fog unchanged.
#[test]
fn surfaces_far_from_the_fog_s_window_leave_it_as_it_is() {
    let test = pack(with_outliers);
    let volumes = [VolumeSource::of_store(&test.store)];
    let (_, fog) = scenes(0, [0.2, 0.8]).swap_remove(0);
    let shot = |isovalue: f64| {
        let mut scene = fog.clone();
        scene.layers[0].isosurfaces = vec![Isosurface { opacity: 0.5, ..Isosurface::at(isovalue) }];
        let resolved = resolve(&volumes, &scene, SIZE).expect("a possible scene");
        let expected = render_reference(&[&*test.store], &resolved, 1 << 30).expect("the levels");
        (isovalue, scene, expected)
    };
    let shots = [1e4, 1e6, -1e5].map(shot);
    for way in WAYS {
        let Some(mut session) = session(&test.store, way) else { continue };
        for (isovalue, scene, expected) in &shots {
            let (found, _) = settled(&mut session, scene, SIZE);
            assert_same_surface(&found, expected, &format!("{isovalue}, {way:?}"));
        }
    }
}

/// Each pixel of a slice has its voxel's own colour, by arithmetic alone.
#[test]
fn a_slice_of_labels_has_their_own_colours() {
    let label = |v: [u32; 3]| if v == [39, 32, 35] { 4_000_000_000 } else { 70_000 + (v[0] / 3 + v[1] / 4) % 2 };
    let test = pack(label);
    let colors = [[69_999.0, 1.0, 0.0, 0.0], [70_000.0, 1.0, 0.0, 0.0], [70_001.0, 0.0, 0.0, 1.0]];
    let transfer = TransferFunction { color: colors.to_vec(), ..ramp([69_999.0, 70_001.0]) };
    let (mode, slice) = (Mode::Average, Some(Slice::across(2, 12.0)));
    let scene = Scene { mode, slice, level: LevelPolicy::Locked(0), ..Scene::of(transfer) };
    for way in WAYS {
        let Some(mut session) = session(&test.store, way) else { continue };
        let (picture, _) = settled(&mut session, &scene, (EXTENT.x, EXTENT.y));
        for (x, y) in (0..EXTENT.y).flat_map(|y| (0..EXTENT.x).map(move |x| (x, y))) {
            let expected = if label([x, y, 12]) == 70_000 { [255, 0, 0] } else { [0, 0, 255] };
            assert_eq!(picture.pixel(x, y), expected, "{way:?} {x} {y}");
        }
    }
}

/// A window dragged over a far wider channel, then stretched: slots change once, when floats replace codes.
#[test]
fn a_window_that_is_dragged_uploads_nothing_again() {
    let test = pack(with_outliers);
    // Every value is visible, so every brick is wanted.
    let scene = |low: f64, width: f64| {
        let mut transfer = ramp([low, low + width]);
        transfer.opacity[0][1] = 0.02;
        Scene { camera: Some(camera()), level: LevelPolicy::Locked(0), ..Scene::of(transfer) }
    };
    for way in [WAYS[1], WAYS[3]] {
        let Some(mut session) = session(&test.store, way) else { continue };
        let wide = scene(-1e9, 2e9);
        let (_, first) = settled(&mut session, &wide, SIZE);
        let (_, narrow) = settled(&mut session, &scene(0.2, 0.6), SIZE);
        assert!(narrow.bricks.uploaded > first.bricks.uploaded, "{way:?}: codes are uploaded again as floats");
        assert_eq!(narrow.bytes.decoded, first.bytes.decoded, "{way:?}: floats are made of the voxels in memory");
        for i in 0..200 {
            let t = i as f64 / 200.0;
            let edited = scene(if i < 100 { 2.0 * t - 0.5 } else { 1e8 * t * t }, 0.6 * (1.0 + 3.0 * t));
            let (picture, after) = settled(&mut session, &edited, SIZE);
            assert_eq!(after.bricks.uploaded, narrow.bricks.uploaded, "{way:?} {i}");
            assert_eq!(after.bytes.decoded, narrow.bytes.decoded, "{way:?} {i}");
            if i % 25 == 0 && i < 100 {
                assert_same(&picture, &oracle(&test.store, &edited, SIZE), &format!("{way:?} {i}"));
            }
        }
    }
}

/// In a live session a drag is drawn from existing codes. At rest, floats replace them invisibly: the previous picture stays until the new
/// one is whole.
#[test]
fn slots_change_after_a_drag_behind_the_picture_before() {
    let value = |v| match v {
        GREAT => 1e3,
        SMALL => -1e3,
        _ => waves(v) as f32,
    };
    let test = pack(value);
    let scene = |low: f64, width: f64| Scene {
        camera: Some(camera()),
        level: LevelPolicy::Locked(0),
        ..Scene::of(ramp([low, low + width]))
    };
    for way in [WAYS[1], WAYS[3]] {
        let options = SessionOptions { live: true, ..options(way, 64 << 20, 64 << 20) };
        let Some(mut session) = open_session_of(vec![VolumeSource::of_store(&test.store)], options) else { continue };
        let mut step = |scene: &Scene| {
            session.wait(Duration::from_millis(5));
            let frame = session.step(scene, SIZE).expect("a step");
            (session.draw(&frame).expect("a picture"), frame.status)
        };
        let settle = |scene: &Scene, step: &mut dyn FnMut(&Scene) -> (Picture, Status)| {
            let begun = Instant::now();
            let mut pictures = Vec::new();
            loop {
                let (picture, status) = step(scene);
                pictures.push(picture);
                if status.settled {
                    return (pictures, status.counters);
                }
                assert!(begun.elapsed() < Duration::from_secs(60), "{status:?}");
            }
        };
        let (_, wide) = settle(&scene(-1e3, 2e3), &mut step);
        let mut dragged = None;
        for i in 0..20 {
            let (picture, status) = step(&scene(0.2 - 0.005 * i as f64, 0.6));
            assert_eq!(status.counters.uploaded, wide.uploaded, "{way:?} {i}: nothing changes during a drag");
            assert!(!status.settled, "{way:?} {i}: the picture is not what it will be");
            dragged = Some(picture);
        }
        let last = scene(0.2 - 0.005 * 19.0, 0.6);
        let (before, expected) = (dragged.expect("a picture"), oracle(&test.store, &last, SIZE));
        let apart = before.rgb.iter().flatten().zip(expected.rgb.iter().flatten()).map(|(a, b)| a.abs_diff(*b));
        let apart = apart.max().unwrap_or(0);
        // A code is a twentieth of the window.
        assert!((3..100).contains(&apart), "{way:?}: the drag was drawn from codes, off by {apart}");
        let (pictures, floats) = settle(&last, &mut step);
        let (found, meanwhile) = pictures.split_last().expect("a picture");
        assert!(floats.uploaded > wide.uploaded && floats.bytes_decoded == wide.bytes_decoded, "{way:?}: {floats:?}");
        assert_same(found, &expected, &format!("{way:?}"));
        let is_whole = |picture: &&Picture| picture.rgb == before.rgb || picture.rgb == found.rgb;
        let half_made = meanwhile.iter().filter(|picture| !is_whole(picture)).count();
        assert!(half_made == 0 && meanwhile.iter().any(|picture| picture.rgb == before.rgb), "{way:?}: {half_made}");
        // Back to a wide window: codes again, once.
        let (pictures, codes) = settle(&scene(-1e3, 2e3), &mut step);
        assert!(codes.uploaded > floats.uploaded && codes.bytes_decoded == wide.bytes_decoded, "{way:?}: {codes:?}");
        assert_same(pictures.last().expect("a picture"), &oracle(&test.store, &scene(-1e3, 2e3), SIZE), "codes");
    }
}

/// Constants of any size look alike through their windows.
#[test]
fn constants_of_any_size_are_the_oracle_s() {
    for value in [0.0f32, 1.0, -70_000.25, 1e9, 1e30] {
        let test = pack(|_| value);
        for mode in [Mode::Dvr, Mode::Mip, Mode::Average] {
            let layers = vec![SceneLayer::default()];
            let scene = Scene { camera: Some(camera()), mode, layers, ..Scene::default() };
            let expected = oracle(&test.store, &scene, SIZE);
            for way in WAYS {
                let Some(mut session) = session(&test.store, way) else { continue };
                let (found, _) = settled(&mut session, &scene, SIZE);
                assert_same(&found, &expected, &format!("{value} {mode:?} {way:?}"));
            }
        }
    }
}

/// An expression's inputs from a channel with outliers are equally exact.
#[test]
fn expressions_read_values_as_they_are() {
    let (first, second) =
        (pack(with_outliers), pack(|v| 100 * (v[0] / 8) as i32 - if v == SMALL { i32::MAX } else { 0 }));
    let volumes = vec![VolumeSource::of_store(&first.store), VolumeSource::of_store(&second.store)];
    let look = SceneExpression { transfer: Some(ramp([0.2, 4.2]).into()), ..String::from("a + b / 100").into() };
    let layers = [0, 1].map(|source| SceneLayer { source: Some(source), ..SceneLayer::default() }).to_vec();
    let fog = Scene { camera: Some(camera()), level: LevelPolicy::Locked(0), layers, ..Scene::default() };
    let fog = Scene { expression: Some(look), ..fog };
    let lit = Scene { lighting: Lighting { model: LightingModel::Phong, ..Lighting::default() }, ..fog.clone() };
    for (name, scene) in [("plain", fog), ("lit", lit)] {
        let resolved = resolve(&volumes, &scene, SIZE).expect("a possible scene");
        let expected = render_reference(&[&first.store, &second.store], &resolved, 1 << 30).expect("the levels");
        for way in WAYS {
            let Some(mut session) = open_session_of(volumes.clone(), options(way, 64 << 20, 64 << 20)) else {
                continue;
            };
            let (found, _) = settled(&mut session, &scene, SIZE);
            assert_same(&found, &expected, &format!("{name} {way:?}"));
        }
    }
}

/// Volumes of different slots in one picture: codes of 8 and 16 bits, and floats.
#[test]
fn floats_and_codes_are_drawn_together() {
    let bytes = pack(|v| (255.0 * waves([v[1], v[2], v[0]])) as u8);
    let floats = pack(with_outliers);
    let words = pack(|v| (60_000.0 * waves([v[2], v[0], v[1]])) as u16);
    let tests = [&bytes, &floats, &words];
    let volumes: Vec<VolumeSource> = tests.iter().map(|test| VolumeSource::of_store(&test.store)).collect();
    let stores: Vec<&Store> = tests.iter().map(|test| &*test.store).collect();
    let windows = [[60.0, 200.0], [0.2, 0.8], [9_000.0, 50_000.0]];
    let layer = |(i, window): (usize, [f64; 2])| SceneLayer { source: Some(i), ..ramp(window).into() };
    let layers: Vec<SceneLayer> = windows.into_iter().enumerate().map(layer).collect();
    for mode in [Mode::Dvr, Mode::Average] {
        let (camera, layers) = (Some(camera()), layers.clone());
        let scene = Scene { camera, mode, layers, level: LevelPolicy::Locked(0), ..Scene::default() };
        let resolved = resolve(&volumes, &scene, SIZE).expect("a possible scene");
        let expected = render_reference(&stores, &resolved, 1 << 30).expect("the levels");
        for way in &WAYS[1..] {
            let Some(mut session) = open_session_of(volumes.clone(), options(*way, 64 << 20, 64 << 20)) else {
                continue;
            };
            let (found, _) = settled(&mut session, &scene, SIZE);
            assert_same(&found, &expected, &format!("{mode:?} {way:?}"));
        }
    }
}
