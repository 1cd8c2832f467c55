//! Orientation: one object, sampled along the axes of several scanners, is one object in the patient's world, for every renderer.

use brickyard::backend::{BackendChoice, CompositorChoice};
use brickyard::session::{VolumeSource, resolve};
use brickyard::volume::{
    Camera, ClipPlane, Extent, Geometry, Lighting, LightingModel, Mode, Orientation, Picture, Projection, Scene,
    SceneLayer, Side, Slice, TransferFunction,
};
use brickyard_tests::{
    FunctionSource, TestStore, WAYS, assert_same, open_session_of, options, oracle, session, settled,
};
use glam::{DAffine3, DMat3, DQuat, DVec3};

const SIZE: (u32, u32) = (60, 50);

/// The middle of the object, millimetres to the patient's right, front and head.
const MIDDLE: DVec3 = DVec3::new(-12.0, 31.0, 7.0);

/// Half of each side of the box covered by every scan.
const REACH: f64 = 20.0;

/// A head unlike its mirror images: large in the middle, an ear on the left, a nose in front, a hat above.
fn object(place: DVec3) -> f64 {
    let blob = |at: [f64; 3], width: f64, height: f64| {
        height * (-(place - MIDDLE - DVec3::from_array(at)).length_squared() / (2.0 * width * width)).exp()
    };
    blob([0.0; 3], 5.0, 120.0)
        + blob([-10.0, 0.0, 0.0], 2.5, 200.0)
        + blob([0.0, 9.0, 1.0], 2.5, 150.0)
        + blob([1.0, 2.0, 10.0], 3.0, 90.0)
}

/// The scan with these axes and spacings, about the middle of the object.
fn scan(axes: [DVec3; 3], spacing: [f64; 3]) -> TestStore {
    let voxels = spacing.map(|s| (2.0 * REACH / s).round() as u32);
    let steps = DMat3::from_cols(axes[0] * spacing[0], axes[1] * spacing[1], axes[2] * spacing[2]);
    let half = DVec3::from_array(voxels.map(|n| f64::from(n - 1) / 2.0));
    let map = DAffine3 { matrix3: steps, translation: MIDDLE - steps * half };
    let rows = std::array::from_fn(|a| steps.row(a).extend(map.translation[a]).to_array());
    let value = move |_, _, v: [u32; 3]| object(map.transform_point3(DVec3::from_array(v.map(f64::from)))) as f32;
    let geometry = Geometry { spacing: spacing.into(), unit: Some("millimeter".into()), ..Geometry::default() };
    let source = FunctionSource::new(Extent::from_array(voxels), geometry, value);
    TestStore::pack(&source.oriented(Orientation::new(rows).expect("a map")), 16)
}

fn along(code: &str) -> [DVec3; 3] {
    let side = |letter| Side::ALL.into_iter().find(|side| side.letter() == letter).expect("a side");
    let axes: Vec<DVec3> = code.chars().map(|letter| side(letter).direction()).collect();
    [axes[0], axes[1], axes[2]]
}

/// The scans by name; the first is aligned with the world.
fn scans() -> Vec<(String, TestStore)> {
    let codes = ["RAS", "LAS", "LPS", "LIA", "PIR"];
    let upright = codes.map(|code| (code.to_string(), scan(along(code), [0.8; 3])));
    let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(0.3, -0.5, 0.2)));
    let oblique = ("oblique LPS".to_string(), scan(along("LPS").map(|axis| turn * axis), [0.8; 3]));
    upright.into_iter().chain([oblique]).collect()
}

fn camera() -> Camera {
    let eye = MIDDLE + DVec3::new(-40.0, 70.0, 35.0);
    Camera { eye, target: MIDDLE, up: DVec3::Z, projection: Projection::Perspective { fov_y_deg: 30.0 } }
}

fn fog() -> TransferFunction {
    TransferFunction {
        color: vec![[0.0, 0.0, 0.0, 0.0], [100.0, 0.9, 0.8, 0.2], [220.0, 1.0, 0.3, 0.1]],
        opacity: vec![[20.0, 0.0], [150.0, 0.6]],
        unit_distance: 4.0,
        ..TransferFunction::default()
    }
}

fn scene() -> Scene {
    let lighting = Lighting { model: LightingModel::Phong, ..Lighting::default() };
    Scene { camera: Some(camera()), lighting, ..Scene::of(fog()) }
}

fn mean_difference(a: &Picture, b: &Picture) -> f64 {
    let pairs = a.rgb.as_flattened().iter().zip(b.rgb.as_flattened());
    pairs.map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>() / (3 * a.rgb.len()) as f64
}

#[test]
fn one_object_looks_the_same_however_it_was_scanned() {
    let scans = scans();
    for way in WAYS {
        for scene in [scene(), Scene { mode: Mode::Mip, lighting: Lighting::default(), ..scene() }] {
            let mut first: Option<Picture> = None;
            for (name, test) in &scans {
                let Some(mut session) = session(&test.store, way) else { return };
                let (picture, _) = settled(&mut session, &scene, SIZE);
                let what = format!("{name} {way:?} {:?}", scene.mode);
                assert_same(&picture, &oracle(&test.store, &scene, SIZE), &what);
                let first = first.get_or_insert_with(|| picture.clone());
                // The scans have their voxels in different places: between them they differ by interpolation.
                let off = mean_difference(&picture, first);
                assert!(off < 1.5, "{what}: {off} levels off the upright scan");
            }
        }
    }
}

/// Centre of a picture's brightness, in pixels.
fn centroid(picture: &Picture) -> [f64; 2] {
    let mut sums = [0.0f64; 3];
    for (i, pixel) in (0u32..).zip(&picture.rgb) {
        let weight = f64::from(pixel[0].saturating_sub(100));
        let (x, y) = (f64::from(i % picture.width), f64::from(i / picture.width));
        sums = [sums[0] + weight * x, sums[1] + weight * y, sums[2] + weight];
    }
    [sums[0] / sums[2], sums[1] / sums[2]]
}

#[test]
fn scans_of_one_patient_meet() {
    let scans = scans();
    let volumes: Vec<_> = scans.iter().map(|(_, test)| VolumeSource::of_store(&test.store)).collect();
    let layers = vec![SceneLayer::default(); volumes.len()];
    let projected = Scene { mode: Mode::Mip, layers, ..scene() };
    let projected = Scene { lighting: Lighting::default(), ..projected };
    let way = (BackendChoice::Cpu, CompositorChoice::Raycast);
    let mut session = open_session_of(volumes, options(way, 256 << 20, 256 << 20)).expect("the CPU is always there");
    // A voxel is 0.8 mm; this is the size of a pixel at the middle.
    let rays = camera().rays(SIZE.0, SIZE.1).expect("a camera");
    let pixel_mm = 2.0 * rays.up.length() * (MIDDLE - rays.eye).length() / f64::from(SIZE.1);
    let only = |shown: usize| {
        let mut scene = projected.clone();
        (0..).zip(&mut scene.layers).for_each(|(i, layer)| layer.visible = i == shown);
        scene
    };
    let places: Vec<_> = (0..scans.len()).map(|i| centroid(&settled(&mut session, &only(i), SIZE).0)).collect();
    for ((name, _), place) in scans.iter().zip(&places) {
        let off_mm = (place[0] - places[0][0]).hypot(place[1] - places[0][1]) * pixel_mm;
        assert!(off_mm < 0.4, "{name}: {off_mm} mm off the upright scan");
    }
    // Drawn together they are in the same places as alone.
    let together = centroid(&settled(&mut session, &projected, SIZE).0);
    assert!((together[0] - places[0][0]).hypot(together[1] - places[0][1]) * pixel_mm < 0.4, "{together:?}");
}

/// The value of a slice's picture at a world position; its pixels are squares of `pixel_mm`.
fn shown(picture: &Picture, right: DVec3, up: DVec3, pixel_mm: f64, at: DVec3) -> f64 {
    let offset = at - MIDDLE;
    let x = f64::from(picture.width) / 2.0 + offset.dot(right) / pixel_mm;
    let y = f64::from(picture.height) / 2.0 - offset.dot(up) / pixel_mm;
    f64::from(picture.rgb[(y as usize) * picture.width as usize + x as usize][0])
}

#[test]
fn slices_of_a_patient_are_seen_as_radiologists_see_them() {
    let gray = TransferFunction {
        color: vec![[0.0, 0.0, 0.0, 0.0], [255.0, 1.0, 1.0, 1.0]],
        opacity: vec![[0.0, 1.0], [255.0, 1.0]],
        ..TransferFunction::default()
    };
    // Axis, right and up of the picture.
    let views = [(0, DVec3::NEG_Y, DVec3::Z), (1, DVec3::NEG_X, DVec3::Z), (2, DVec3::NEG_X, DVec3::Y)];
    let pixel_mm = 2.0 * REACH / 50.0;
    for (name, test) in scans().iter().filter(|(name, _)| !name.starts_with("oblique")) {
        for (axis, right, up) in views {
            let slice = Slice::of_patient(axis, MIDDLE[axis]);
            let scene = Scene { mode: Mode::Average, slice: Some(slice), ..Scene::of(gray.clone()) };
            let way = (BackendChoice::Cpu, CompositorChoice::Raycast);
            let mut session = session(&test.store, way).expect("the CPU is always there");
            let (picture, _) = settled(&mut session, &scene, (50, 50));
            for at in [
                [-10.0, 0.0, 0.0],
                [10.0, 0.0, 0.0],
                [0.0, 9.0, 1.0],
                [0.0, -9.0, 1.0],
                [1.0, 2.0, 10.0],
                [1.0, 2.0, -10.0],
            ] {
                let mut at = MIDDLE + DVec3::from_array(at);
                at[axis] = MIDDLE[axis];
                // A pixel is as large as a voxel, and its value changes by this much from side to side.
                let (found, expected) = (shown(&picture, right, up, pixel_mm, at), object(at));
                assert!((found - expected).abs() < 25.0, "{name} axis {axis} {at}: {found}, expected {expected}");
            }
        }
    }
}

#[test]
fn the_default_view_of_a_patient_is_from_the_front() {
    let test = scan(along("PIR"), [2.0; 3]);
    let volume = VolumeSource::of_store(&test.store);
    let scene = resolve(std::slice::from_ref(&volume), &Scene::default(), SIZE).expect("a scene");
    let from = scene.camera.eye - scene.camera.target;
    assert_eq!((Side::of(from), scene.camera.up), (Side::Anterior, DVec3::Z));
    let (low, high) = scene.world_box;
    assert!(
        (low - (MIDDLE - REACH)).abs().max_element() < 1e-9 && (high - (MIDDLE + REACH)).abs().max_element() < 1e-9
    );
}

#[test]
fn a_scan_askew_to_the_world_is_cut_by_every_plane() {
    let turn = DMat3::from_quat(DQuat::from_scaled_axis(DVec3::new(0.3, -0.5, 0.2)));
    let test = scan(along("LPS").map(|axis| turn * axis), [1.0; 3]);
    let corners =
        [[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0], [1.0, -1.0, 1.0], [1.0, 1.0, -1.0], [-1.0, -1.0, 1.0], [-1.0, 1.0, -1.0]];
    let plane = |corner: [f64; 3]| {
        let outwards = DVec3::from_array(corner);
        ClipPlane { point: MIDDLE + outwards * 6.0, normal: -outwards }
    };
    let scene = Scene {
        mode: Mode::Mip,
        lighting: Lighting::default(),
        slice: Some(Slice { point: MIDDLE, normal: DVec3::new(0.2, 1.0, 0.1), thickness: 14.0 }),
        // Only its low and high ends along z cut these parts: they are the last of all planes.
        clip: Some([MIDDLE - DVec3::new(11.0, 12.0, 2.0), MIDDLE + DVec3::new(12.0, 13.0, 3.0)]),
        clip_planes: corners.map(plane).to_vec(),
        ..scene()
    };
    let expected = oracle(&test.store, &scene, SIZE);
    assert_ne!(expected, oracle(&test.store, &Scene { clip: None, ..scene.clone() }, SIZE));
    for way in WAYS {
        let Some(mut session) = session(&test.store, way) else { return };
        assert_same(&settled(&mut session, &scene, SIZE).0, &expected, &format!("{way:?}"));
    }
}

/// A scan in micrometres is the same scan: the patient's world is in millimetres, and so are the distances of default looks.
#[test]
fn the_unit_of_a_file_does_not_show() {
    let in_unit = |unit: &str, per_mm: f64| {
        let steps = along("LPS").map(|axis| axis * 0.8 * per_mm);
        let matrix = DMat3::from_cols(steps[0], steps[1], steps[2]);
        let first = MIDDLE * per_mm - matrix * DVec3::splat(24.5);
        let rows = std::array::from_fn(|a| matrix.row(a).extend(first[a]).to_array());
        let geometry = Geometry { spacing: DVec3::splat(0.8 * per_mm), unit: Some(unit.into()), ..Geometry::default() };
        let value = |_, _, v: [u32; 3]| object(MIDDLE + (DVec3::from_array(v.map(f64::from)) - 24.5) * 0.8) as f32;
        let source = FunctionSource::new(Extent::new(50, 50, 50), geometry, value);
        TestStore::pack(&source.oriented(Orientation::new(rows).expect("a map")), 16)
    };
    let [mm, um] = [in_unit("millimeter", 1.0), in_unit("micrometer", 1000.0)];
    for way in [WAYS[1], WAYS[3]] {
        // Without a given look: the gray ramp and its distance are derived.
        let scene = Scene { camera: Some(camera()), ..Scene::default() };
        let [Some(mut first), Some(mut second)] = [&mm, &um].map(|test| session(&test.store, way)) else { return };
        let (expected, found) = (settled(&mut first, &scene, SIZE).0, settled(&mut second, &scene, SIZE).0);
        assert_same(&found, &expected, &format!("{way:?}"));
    }
}
