//! The nearest filter: unchanged voxels, in every mode, by every way to draw, in every kind of slot; and slices of the plain data.

use brickyard::backend::BackendChoice;
use brickyard::session::{SessionError, VolumeSource};
use brickyard::volume::{
    Camera, ClipPlane, Extent, Filter, Geometry, Gradient, Isosurface, Jitter, LevelPolicy, Lighting, LightingModel,
    Method, Mode, Picture, Placement, Projection, Sampling, Scene, SceneExpression, SceneLayer, Slice, SlotFormat,
    TransferFunction, Voxel,
};
use brickyard_tests::sample::{draws, seed};
use brickyard_tests::{
    Expected, FunctionSource, TestStore, WAYS, assert_same, assert_same_surface, in_mode, off, open_session, options,
    oracle, resolved, session, settled,
};
use glam::DVec3;

const SIZE: (u32, u32) = (72, 60);
const EXTENT: Extent = Extent::new(37, 26, 21);

fn nearest() -> Sampling {
    Sampling { filter: Filter::Nearest, ..Sampling::default() }
}

/// A number from 0 to 1, unrelated to those of neighbouring voxels.
fn noise([x, y, z]: [u32; 3]) -> f64 {
    let mut hash =
        (x + 1).wrapping_mul(0x9e37_79b1) ^ (y + 1).wrapping_mul(0x85eb_ca77) ^ (z + 1).wrapping_mul(0xc2b2_ae3d);
    for _ in 0..2 {
        hash = (hash ^ (hash >> 15)).wrapping_mul(0x2c1b_3c6d);
    }
    f64::from(hash ^ (hash >> 16)) / f64::from(u32::MAX)
}

/// Waves without symmetry, from 0 to 1.
fn waves([x, y, z]: [u32; 3]) -> f64 {
    let [u, v, w] = [x, y, z].map(f64::from);
    0.5 + 0.2 * (0.71 * u + 0.47 * v).sin() + 0.2 * (0.59 * v - 0.68 * w).cos() + 0.1 * (0.9 * w).sin()
}

fn store<T: Voxel>(geometry: Geometry, value: impl Fn([u32; 3]) -> f64 + Send + Sync) -> TestStore {
    let source = FunctionSource::new(EXTENT, geometry, move |_, _, v| T::from_f64_rounded(value(v)));
    TestStore::pack(&source, 16)
}

/// Sliced data: the values of voxels, and windows.
struct Sliced<'a> {
    test: TestStore,
    value: &'a dyn Fn([u32; 3]) -> f64,
    /// Windows, each with the format of its slots.
    windows: &'a [([f64; 2], SlotFormat)],
}

/// The display code of a value in a window, before rounding.
fn display(value: f64, [low, high]: [f64; 2]) -> f64 {
    255.0 * ((value - low) / (high - low)).clamp(0.0, 1.0)
}

/// Asserts that a pixel is the display code of its voxel's value, rounded to the nearest. Within `tie` of the middle between two codes it may be
/// either, by single precision.
fn assert_rounded(found: [u8; 3], display: f64, tie: f64, what: &str) {
    let [down, up] = [display - tie, display + tie].map(|code| (code + 0.5).floor().clamp(0.0, 255.0) as u8);
    assert!(found.iter().all(|&code| code == down || code == up), "{what}: {found:?} for {display}");
}

/// Axes of slices, in the order of tests.
const AXES: [usize; 3] = [2, 1, 0];

fn geometry() -> Geometry {
    Geometry { spacing: DVec3::splat(0.7), origin: DVec3::new(3.1, -5.0, 11.7), ..Geometry::default() }
}

impl Sliced<'_> {
    /// The scene of the slice across an axis, at a voxel coordinate, with a gray ramp over a window.
    fn scene(&self, axis: usize, at: f64, window: [f64; 2], mode: Mode) -> Scene {
        let plane = geometry().world_from_voxel(DVec3::splat(at))[axis];
        let [low, high] = window;
        let gray = TransferFunction {
            color: vec![[low, 0.0, 0.0, 0.0], [high, 1.0, 1.0, 1.0]],
            opacity: vec![[low, 1.0]],
            ..TransferFunction::default()
        };
        let slice = Some(Slice::across(axis, plane));
        Scene { mode, slice, sampling: nearest(), level: LevelPolicy::Locked(0), ..Scene::of(gray) }
    }

    /// Checks slices through voxels' centres, through their faces, and in between, at one and at three by three pixels per voxel: every pixel is
    /// its voxel's.
    fn are_exact(&self, mode: Mode) {
        let n = EXTENT.to_array();
        for way in WAYS {
            let Some(mut session) = session(&self.test.store, way) else { continue };
            for (i, &(window, format)) in self.windows.iter().enumerate() {
                for axis in AXES {
                    // A brick's last voxel, its face, and a place behind; the volume's own first face.
                    for (k, at) in [15.5, 16.0, 16.3, 0.0, 7.99].into_iter().enumerate() {
                        let zoom = if (i + k) % 2 == 0 { 1 } else { 3 };
                        let [across, down] = [[1, 2], [0, 2], [0, 1]][axis].map(|a: usize| n[a]);
                        let scene = self.scene(axis, at, window, mode);
                        let size = (across * zoom, down * zoom);
                        let encoding = resolved(&self.test.store, &scene, size).layers[0].frames[0].settings.encoding;
                        assert_eq!(encoding.format, format);
                        let (picture, _) = settled(&mut session, &scene, size);
                        // Half a code's width, where codes are not the values themselves, and the tables' imprecision.
                        let coarse = if encoding.code_width() == 1.0 { 0.0 } else { 0.5 * encoding.code_width() };
                        let tie = 1e-3 + 255.0 * coarse / (window[1] - window[0]);
                        for (x, y) in (0..size.1).flat_map(|y| (0..size.0).map(move |x| (x, y))) {
                            let (u, v) = (x / zoom, y / zoom);
                            let plane = at as u32;
                            let voxel = match axis {
                                2 => [u, v, plane],
                                1 => [u, plane, down - 1 - v],
                                _ => [plane, u, down - 1 - v],
                            };
                            let what = format!("{way:?} {mode:?} {window:?}, axis {axis} at {at}: {voxel:?}");
                            assert_rounded(picture.pixel(x, y), display((self.value)(voxel), window), tie, &what);
                        }
                    }
                }
            }
        }
    }
}

#[test]
fn slices_of_8_bits_are_the_data() {
    let value = |v| (noise(v) * 255.0).round();
    let windows = [([0.0, 255.0], SlotFormat::U8), ([13.0, 114.0], SlotFormat::U8), ([99.5, 101.0], SlotFormat::U8)];
    let sliced = Sliced { test: store::<u8>(geometry(), value), value: &value, windows: &windows };
    [Mode::Average, Mode::Mip, Mode::MinIp].into_iter().for_each(|mode| sliced.are_exact(mode));
}

#[test]
fn slices_of_16_bits_are_the_data() {
    let value = |v| (noise(v) * 3000.0 - 1000.0).round();
    let windows =
        [([-160.0, 240.0], SlotFormat::U16), ([-1000.0, 2000.0], SlotFormat::U16), ([700.0, 711.0], SlotFormat::U16)];
    Sliced { test: store::<i16>(geometry(), value), value: &value, windows: &windows }.are_exact(Mode::Average);
    let value = |v| (noise(v) * 65_535.0).round();
    let windows = [([0.0, 65_535.0], SlotFormat::U16), ([65_000.0, 65_017.0], SlotFormat::U16)];
    Sliced { test: store::<u16>(geometry(), value), value: &value, windows: &windows }.are_exact(Mode::Average);
}

#[test]
fn slices_of_floats_are_the_data() {
    let value = |v: [u32; 3]| f64::from(if v == [5, 9, 16] { 1e6 } else { noise(v) as f32 });
    let windows = [([0.1, 0.9], SlotFormat::F32), ([0.501, 0.502], SlotFormat::F32), ([0.0, 1e6], SlotFormat::U16)];
    Sliced { test: store::<f32>(geometry(), value), value: &value, windows: &windows }.are_exact(Mode::Average);
}

/// A plane on the volume's last face has no voxel above it.
#[test]
fn above_the_last_face_there_is_nothing() {
    let value = |v| (noise(v) * 255.0).round();
    let sliced = Sliced { test: store::<u8>(geometry(), value), value: &value, windows: &[] };
    for way in WAYS {
        let Some(mut session) = session(&sliced.test.store, way) else { continue };
        let scene = sliced.scene(2, f64::from(EXTENT.z), [0.0, 255.0], Mode::Average);
        let (picture, _) = settled(&mut session, &scene, (37, 26));
        assert!(picture.rgb.iter().all(|pixel| *pixel == [0; 3]), "{way:?}");
    }
}

/// Voxels just behind a cut on their face are hidden: both on the cut and where rays leave by it.
#[test]
fn a_cut_on_a_face_of_voxels_hides_what_is_behind_it() {
    let opaque = TransferFunction {
        color: vec![[90.0, 0.0, 0.0, 0.0], [100.0, 1.0, 1.0, 1.0]],
        opacity: vec![[90.0, 0.0], [100.0, 1.0]],
        ..TransferFunction::default()
    };
    let (face, middle) = ([24.0, 16.0, 8.0], DVec3::new(18.5, 13.0, 10.5));
    for (axis, is_high) in (0..3).flat_map(|axis| [(axis, false), (axis, true)]) {
        let value = |v: [u32; 3]| if (f64::from(v[axis]) >= face[axis]) == is_high { 200.0 } else { 0.0 };
        let test = store::<u8>(Geometry::default(), value);
        let (mut low, mut high) = ([0.0; 3], EXTENT.to_array().map(f64::from));
        if is_high {
            high[axis] = face[axis]
        } else {
            low[axis] = face[axis]
        }
        let corners = [low, high].map(DVec3::from_array);
        let to_hidden = DVec3::AXES[axis] * if is_high { 1.0 } else { -1.0 };
        // In the world a voxel's centre is at whole numbers.
        let plane = ClipPlane { point: DVec3::from_array(face) - 0.5, normal: -to_hidden };
        let eye = middle + to_hidden * 70.0 + DVec3::new(17.0, -13.0, 11.0);
        let projection = Projection::Perspective { fov_y_deg: 40.0 };
        let up = if axis == 2 { DVec3::Y } else { DVec3::Z };
        let from = |eye| Some(Camera { eye, target: middle, up, projection });
        let open = Scene { camera: from(eye), background: [0.0; 3], sampling: nearest(), ..Scene::of(opaque.clone()) };
        let mut cropped = open.clone();
        cropped.layers[0].crop = Some(corners);
        let clipped = Scene { clip: Some(corners.map(|corner| corner - 0.5)), ..open.clone() };
        let cut = Scene { clip_planes: vec![plane], camera: from(middle - (eye - middle)), ..open.clone() };
        for way in WAYS {
            let Some(mut session) = session(&test.store, way) else { continue };
            let scenes = [(&cropped, Mode::Isosurface), (&clipped, Mode::Mip), (&cut, Mode::Isosurface)];
            for (i, (scene, mode)) in scenes.into_iter().chain([(&cut, Mode::Dvr), (&cropped, Mode::Dvr)]).enumerate() {
                let scene = in_mode(scene.clone(), mode, 100.0);
                let seen = |(picture, _): (Picture, _)| picture.rgb.iter().filter(|pixel| **pixel != [0; 3]).count();
                let found = seen(settled(&mut session, &scene, SIZE));
                assert_eq!(found, 0, "{way:?}, axis {axis}, {is_high}, scene {i}");
                let whole = Scene { clip: None, clip_planes: Vec::new(), ..scene };
                if i == 2 {
                    assert!(seen(settled(&mut session, &whole, SIZE)) > 300, "without the cut it is seen");
                }
            }
        }
    }
}

/// A slab between faces of voxels shows exactly the voxels between them, wherever segments begin: of stripes along z every other plane is black.
#[test]
fn a_thick_slice_between_faces_shows_no_voxel_behind_them() {
    let stripes = |_, _, [_, _, z]: [u32; 3]| (z % 2 * 255) as u8;
    let test = TestStore::pack(&FunctionSource::new(Extent::new(12, 12, 64), Geometry::default(), stripes), 16);
    for way in WAYS {
        let Some(mut session) = session(&test.store, way) else { continue };
        for (step, eye) in [(0.2, -60.7), (0.3, -69.2)] {
            for k in [8, 14, 20, 26, 32, 38, 50, 56] {
                let target = DVec3::new(5.5, 5.5, f64::from(k));
                let projection = Projection::Orthographic { height: 12.0 };
                let camera = Camera { eye: DVec3::new(5.5, 5.5, eye), target, up: DVec3::NEG_Y, projection };
                let color = vec![[0.0, 0.0, 0.0, 0.0], [255.0, 1.0, 1.0, 1.0]];
                let gray = TransferFunction { color, opacity: vec![[0.0, 1.0]], ..TransferFunction::default() };
                let slice = Some(Slice { thickness: 1.0, ..Slice::across(2, target.z) });
                let scene = Scene {
                    camera: Some(camera),
                    mode: Mode::Mip,
                    sampling: nearest(),
                    slice,
                    step,
                    ..Scene::of(gray)
                };
                let (picture, _) = settled(&mut session, &scene, (12, 12));
                let seen = picture.rgb.iter().filter(|pixel| **pixel != [0; 3]).count();
                assert_eq!(seen, 0, "{way:?}, step {step}, plane {k}");
            }
        }
    }
}

/// The gap between a cut and faces is invisible: a voxel between two cuts is as opaque as a whole one, from near and far, and thinner slabs are
/// not lost.
#[test]
fn a_thin_slab_keeps_its_opacity() {
    let test =
        TestStore::pack(&FunctionSource::new(Extent::new(2048, 16, 16), Geometry::default(), |_, _, _| 100u8), 16);
    let half = TransferFunction {
        color: vec![[0.0, 1.0, 1.0, 1.0]],
        opacity: vec![[0.0, 0.5]],
        unit_distance: 1.0,
        ..TransferFunction::default()
    };
    for way in WAYS {
        let Some(mut session) = session(&test.store, way) else { continue };
        // From 100,000 away, single precision moves points by a thirtieth of a voxel.
        for (distance, thickness) in [(40.0, 1.0), (100_000.0, 1.0), (40.0, 0.1)] {
            let target = DVec3::new(1023.5, 7.5, 7.5);
            let projection = Projection::Orthographic { height: 8.0 };
            let camera = Camera { eye: target + DVec3::Z * distance, target, up: DVec3::Y, projection };
            let sides = [1.0, -1.0].map(|side| ClipPlane {
                point: target + DVec3::Z * (0.5 * side * thickness + 1.0),
                normal: DVec3::Z * -side,
            });
            let transfer = TransferFunction { unit_distance: thickness, ..half.clone() };
            let mut cropped = Scene { camera: Some(camera), sampling: nearest(), step: 0.25, ..Scene::of(transfer) };
            cropped.layers[0].crop = Some([DVec3::new(1000.0, 0.0, 8.0), DVec3::new(1050.0, 16.0, 8.0 + thickness)]);
            let between = Scene { clip_planes: sides.to_vec(), ..cropped.clone() };
            let mut between = between;
            between.layers[0].crop = None;
            for scene in [cropped, between] {
                let (picture, _) = settled(&mut session, &scene, (8, 8));
                let expected = 255.0 * (1.0 - 0.5);
                // At most a hundredth of it is left out on each side: 1.8.
                let off = picture.rgb.iter().map(|pixel| (f64::from(pixel[0]) - expected).abs()).fold(0.0, f64::max);
                assert!(off <= 2.3, "{way:?}, {distance} off, {thickness} thick: {off}");
            }
        }
    }
}

/// A picture from near the volume, at an angle with no axis.
fn at_an_angle(transfer: TransferFunction) -> Scene {
    let camera = Camera {
        eye: DVec3::new(-25.0, -38.0, 61.0),
        target: DVec3::new(17.0, 13.0, 9.0),
        up: DVec3::Z,
        projection: Projection::Perspective { fov_y_deg: 32.0 },
    };
    Scene { camera: Some(camera), background: [0.1, 0.1, 0.15], sampling: nearest(), ..Scene::of(transfer) }
}

/// Clear below the window, and a quarter opaque above.
fn ramp([low, high]: [f64; 2]) -> TransferFunction {
    let at = |t: f64| low + t * (high - low);
    TransferFunction {
        color: vec![[low, 0.9, 0.1, 0.2], [at(0.5), 0.1, 1.0, 0.3], [high, 0.2, 0.3, 1.0]],
        opacity: vec![[low, 0.0], [at(0.3), 0.02], [high, 0.25]],
        unit_distance: 2.0,
        ..TransferFunction::default()
    }
}

/// Scenes of one layer, in a window.
fn scenes(window: [f64; 2]) -> Vec<(&'static str, Scene)> {
    let [low, high] = window;
    let fog = at_an_angle(ramp(window));
    let in_mode = |mode| Scene { mode, ..fog.clone() };
    let by = |sampling| Scene { sampling, ..fog.clone() };
    let lit = |gradient| Lighting { model: LightingModel::BlinnPhong, gradient, ..Lighting::default() };
    let surface = |value, opacity| Isosurface { opacity, ..Isosurface::at(value) };
    let with =
        |isosurfaces, mode| Scene { layers: vec![SceneLayer { isosurfaces, ..ramp(window).into() }], ..in_mode(mode) };
    let middle = 0.5 * (low + high);
    let steep = TransferFunction { gradient_opacity: vec![[0.0, 0.1], [0.1 * (high - low), 1.0]], ..ramp(window) };
    let slice = Slice { point: DVec3::new(17.3, 12.1, 9.7), normal: DVec3::new(0.3, -0.5, 0.8), thickness: 0.0 };
    let turned = Placement::from_text("0.8 -0.6 0 3  0.6 0.8 0.1 -5  0 0 1.1 3").expect("a map");
    vec![
        ("fog", fog.clone()),
        ("lit", Scene { lighting: lit(Gradient::Central), ..fog.clone() }),
        ("lit, Sobel", Scene { lighting: lit(Gradient::Sobel), ..fog.clone() }),
        ("lit, stored", Scene { lighting: lit(Gradient::Stored), ..fog.clone() }),
        ("by gradient", at_an_angle(steep)),
        ("adaptive", by(Sampling { method: Method::Asm, ..nearest() })),
        ("on lines", by(Sampling { method: Method::Lvs, ..nearest() })),
        ("pre-integrated", by(Sampling { method: Method::Pcvs, ..nearest() })),
        ("jittered", by(Sampling { jitter: Jitter::Blue, ..nearest() })),
        ("level 1", Scene { level: LevelPolicy::Locked(1), ..fog.clone() }),
        ("a maximum", in_mode(Mode::Mip)),
        ("a minimum", in_mode(Mode::MinIp)),
        ("a mean", in_mode(Mode::Average)),
        ("a slice", Scene { slice: Some(slice), ..in_mode(Mode::Average) }),
        ("a thick slice", Scene { slice: Some(Slice { thickness: 5.0, ..slice }), ..in_mode(Mode::Average) }),
        ("a surface", with(vec![surface(middle, 1.0)], Mode::Isosurface)),
        ("surfaces in fog", with(vec![surface(middle, 0.4), surface(0.2 * low + 0.8 * high, 0.8)], Mode::Dvr)),
        (
            "turned",
            Scene { layers: vec![SceneLayer { world_from_volume: turned, ..ramp(window).into() }], ..fog.clone() },
        ),
    ]
}

fn agree(test: &TestStore, window: [f64; 2], format: SlotFormat, has_holes: bool) {
    let expected = |scene: &Scene| oracle(&test.store, scene, SIZE);
    let open = |way| Some((way, open_session(&test.store, options(way, 64 << 20, 64 << 20))?));
    let mut sessions: Vec<_> = WAYS.into_iter().filter_map(open).collect();
    for (name, scene) in scenes(window) {
        let settings = resolved(&test.store, &scene, SIZE).layers[0].frames[0].settings.clone();
        // Gradients of 32-bit types are never coded.
        let is_coded = name != "by gradient" || settings.encoding.voxel_type.bytes() < 4;
        assert_eq!(settings.encoding.format, if is_coded { format } else { SlotFormat::F32 });
        let expected = Expected::new(&scene, &expected);
        let linear = Sampling { filter: Filter::Trilinear, ..scene.sampling };
        let linear = oracle(&test.store, &Scene { sampling: linear, ..scene.clone() }, SIZE);
        assert!(off(&expected.exact, &linear).len() * 20 > linear.rgb.len(), "{name}: steps are not seen");
        for (way, session) in &mut sessions {
            let what = format!("{way:?}, {name}, {format:?}");
            if !draws(&what, *way) {
                continue;
            }
            let (found, _) = settled(session, &scene, SIZE);
            let what = format!("{what}, seed {:x}", seed());
            // Rounding also decides whether a ray hits a surface at its edge, and whether half of a place's weight is valid, which affects
            // gradients.
            if !scene.layers[0].isosurfaces.is_empty() {
                assert_same_surface(&found, &expected.exact, &what);
            } else if has_holes && (scene.lighting != Lighting::default() || scene.is_by_gradient()) {
                assert_same(&found, &expected.exact, &what);
            } else {
                expected.assert_shown(&found, &what);
            }
        }
    }
}

fn uneven() -> Geometry {
    Geometry { spacing: DVec3::new(1.0, 1.25, 0.8), ..Geometry::default() }
}

#[test]
fn steps_of_8_bits_equal_the_oracle() {
    agree(&store::<u8>(uneven(), |v| waves(v) * 255.0), [60.0, 200.0], SlotFormat::U8, false);
}

#[test]
fn steps_of_16_bits_with_holes_equal_the_oracle() {
    let value = |_, _, v: [u32; 3]| if v[0] % 9 == 4 && v[2] > 8 { -32_768 } else { (waves(v) * 900.0) as i16 };
    let source = FunctionSource::new(EXTENT, uneven(), value).without(-32_768.0);
    agree(&TestStore::pack(&source, 16), [200.0, 700.0], SlotFormat::U16, true);
}

#[test]
fn steps_of_floats_equal_the_oracle() {
    let holes = |v: [u32; 3]| v[0] % 9 == 4 && v[2] > 8;
    let value = |v: [u32; 3]| if holes(v) { f64::NAN } else { waves(v) };
    agree(&store::<f32>(uneven(), value), [0.2, 0.8], SlotFormat::U16, true);
    let outliers = |v: [u32; 3]| if v == [11, 9, 13] { 1e9 } else { value(v) };
    agree(&store::<f32>(uneven(), outliers), [0.2, 0.8], SlotFormat::F32, true);
}

/// Integers read one by one are whole numbers, for comparison in expressions.
#[test]
fn expressions_compare_what_voxels_hold() {
    let test = store::<u8>(uneven(), |v| (waves(v) * 9.0).floor() * 23.0);
    let text = "a == 92 || a == 115 ? a : 0".to_string();
    let transfer = TransferFunction {
        color: vec![[0.0, 0.2, 0.9, 0.3], [92.0, 0.2, 0.9, 0.3], [115.0, 0.9, 0.2, 0.1]],
        opacity: vec![[0.0, 0.0], [91.0, 0.0], [92.0, 0.3]],
        ..TransferFunction::default()
    };
    let scene = Scene {
        layers: vec![SceneLayer::default()],
        expression: Some(SceneExpression { text, transfer: Some(transfer.clone().into()) }),
        ..at_an_angle(transfer)
    };
    let expected = |scene: &Scene| oracle(&test.store, scene, SIZE);
    let expected = Expected::new(&scene, &expected);
    for way in WAYS {
        let Some(mut session) = session(&test.store, way) else { continue };
        expected.assert_shown(&settled(&mut session, &scene, SIZE).0, &format!("{way:?}"));
    }
}

/// Whole numbers too great for single precision are distinguished on the CPU, and refused by GPUs.
#[test]
fn expressions_of_great_whole_numbers_are_exact_or_refused() {
    let test = store::<u32>(uneven(), |v| 4e9 + (waves(v) * 9.0).floor());
    let transfer = TransferFunction {
        color: vec![[0.0, 0.2, 0.9, 0.3]],
        opacity: vec![[0.0, 0.0], [1.0, 0.3]],
        ..TransferFunction::default()
    };
    for text in ["a == 4000000005", "(a - 4000000000) / 9"] {
        let scene = Scene {
            layers: vec![SceneLayer::default()],
            expression: Some(SceneExpression { text: text.into(), transfer: Some(transfer.clone().into()) }),
            ..at_an_angle(transfer.clone())
        };
        let expected = |scene: &Scene| oracle(&test.store, scene, SIZE);
        let expected = Expected::new(&scene, &expected);
        for way in WAYS {
            let Some(mut session) = session(&test.store, way) else { continue };
            if way.0 == BackendChoice::Cpu {
                expected.assert_shown(&settled(&mut session, &scene, SIZE).0, text);
            } else {
                let refused = session.step(&scene, SIZE);
                assert!(matches!(refused, Err(SessionError::Precision { .. })), "{way:?}, {text}");
            }
        }
    }
}

/// Bricks are the same for both filters, so that switching is immediate.
#[test]
fn a_change_of_filter_uploads_nothing() {
    let test = store::<u8>(uneven(), |v| waves(v) * 255.0);
    assert!(!VolumeSource::of_store(&test.store).source.is_labels());
    let steps = at_an_angle(ramp([60.0, 200.0]));
    let linear = Scene { sampling: Sampling::default(), ..steps.clone() };
    for way in [WAYS[1], WAYS[3]] {
        let Some(mut session) = session(&test.store, way) else { continue };
        let pictures = [&linear, &steps, &linear].map(|scene| settled(&mut session, scene, SIZE));
        let uploaded = pictures.each_ref().map(|(_, stats)| stats.bricks.uploaded);
        assert!(uploaded[0] > 0 && uploaded[1..] == [uploaded[0]; 2], "{way:?}: {uploaded:?}");
        let [first, second, third]: [Picture; 3] = pictures.map(|(picture, _)| picture);
        assert!(first == third && first != second, "{way:?}");
    }
}
