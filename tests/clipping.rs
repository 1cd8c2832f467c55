//! Clip planes and slices end to end: against the oracle in all modes and ways to draw, and against formulas; hidden parts are not read.

use brickyard::session::VolumeSource;
use brickyard::store::Store;
use brickyard::volume::lighting::headlight;
use brickyard::volume::{
    Camera, ClipPlane, Extent, Geometry, Isosurface, LevelPolicy, Mode, Picture, Projection, Ray, Scene, SceneLayer,
    Slice, TransferFunction, Voxel,
};
use brickyard_tests::{
    FunctionSource, Sandbox, TestStore, WAYS, assert_same, assert_same_surface, in_mode, oracle, read_png, session,
    settled,
};
use glam::DVec3;
use std::sync::Arc;

const SIZE: (u32, u32) = (64, 50);

/// Shells around the centre on a slope, in 0..=1.
fn shells(extent: Extent, [x, y, z]: [u32; 3]) -> f64 {
    let n = extent.to_array().map(f64::from);
    let p = [x as f64 / n[0] - 0.5, y as f64 / n[1] - 0.5, z as f64 / n[2] - 0.5];
    let r = (p[0] * p[0] + p[1] * p[1] + p[2] * p[2]).sqrt() + 0.02 * (20.0 * p[0]).sin() * (17.0 * p[1]).cos();
    if r > 0.6 { 0.0 } else { 0.45 + 0.4 * (24.0 * r).cos() + 0.15 * p[0] + 0.1 * p[2] }
}

fn transfer(unit_distance: f64) -> TransferFunction {
    TransferFunction {
        color: vec![[0.0, 0.1, 0.2, 0.9], [128.0, 0.2, 0.9, 0.3], [230.0, 1.0, 0.6, 0.1], [255.0, 1.0, 1.0, 1.0]],
        opacity: vec![[38.0, 0.0], [128.0, 0.06], [204.0, 0.25], [255.0, 0.5]],
        unit_distance,
        ..TransferFunction::default()
    }
}

/// Values as shades of gray.
fn gray() -> TransferFunction {
    let color = vec![[0.0, 0.0, 0.0, 0.0], [255.0, 1.0, 1.0, 1.0]];
    TransferFunction { color, opacity: vec![[0.0, 1.0]], unit_distance: 1.0, ..TransferFunction::default() }
}

fn perspective(eye: DVec3, target: DVec3) -> Camera {
    Camera { eye, target, up: DVec3::Z, projection: Projection::Perspective { fov_y_deg: 40.0 } }
}

fn plane(point: DVec3, normal: [f64; 3]) -> ClipPlane {
    ClipPlane { point, normal: normal.into() }
}

/// A volume with bricks of 16 and unequal spacing, its world box, and a scene to start from.
fn volume() -> (TestStore, (DVec3, DVec3), Scene) {
    let extent = Extent::new(61, 53, 67);
    let geometry = Geometry { spacing: DVec3::new(0.5, 0.8, 1.1), ..Geometry::default() };
    let value = |v| u8::from_f64_rounded(shells(extent, v) * 255.0);
    let test = TestStore::pack(&FunctionSource::new(extent, geometry.clone(), |_, _, v| value(v)), 16);
    let transfer = transfer(geometry.voxel_size(extent) * 2.0);
    let scene = Scene { background: [0.1, 0.05, 0.2], ..Scene::of(transfer) };
    (test, geometry.world_box(extent), scene)
}

/// Checks that the settled pictures of scenes of one mode equal the oracle's, by every way to draw.
fn check(store: &Arc<Store>, scenes: &[(String, Scene)]) {
    let mode = scenes[0].1.mode;
    let expected: Vec<Picture> = scenes.iter().map(|(_, scene)| oracle(store, scene, SIZE)).collect();
    for way in WAYS {
        let Some(mut session) = session(store, way) else { continue };
        for ((name, scene), expected) in scenes.iter().zip(&expected) {
            let (picture, _) = settled(&mut session, scene, SIZE);
            let same = if mode == Mode::Isosurface { assert_same_surface } else { assert_same };
            same(&picture, expected, &format!("{mode:?}, {name}, {way:?}"));
        }
    }
}

#[test]
fn planes_equal_the_oracle_in_all_modes() {
    let (test, (low, high), scene) = volume();
    let (centre, size) = ((low + high) * 0.5, high - low);
    let at = |x: f64, y: f64, z: f64| low + size * DVec3::new(x, y, z);
    let ortho = Projection::Orthographic { height: size.length() * 0.8 };
    let outside = perspective(at(1.9, -1.2, 1.4), centre);
    let inside = perspective(at(0.31, 0.42, 0.57), at(0.9, 0.8, 0.3));
    let views = [
        ("outside", outside),
        ("orthographic", Camera { projection: ortho, ..perspective(at(-1.0, 2.0, 0.9), centre) }),
        // The eye and its surroundings are cut away.
        ("inside", inside),
    ];
    let six =
        [[1.0, 0.3, 0.0], [-1.0, 0.2, 0.1], [0.2, 1.0, -0.3], [0.0, -1.0, 0.4], [0.3, 0.1, 1.0], [0.1, 0.2, -1.0]];
    let six = six.map(|normal| plane(centre - DVec3::from_array(normal) * size * 0.27, normal));
    let sets = [
        ("one plane", vec![plane(at(0.55, 0.5, 0.5), [0.8, 0.5, -0.4])]),
        ("three planes", vec![six[0], six[3], plane(at(0.5, 0.5, 0.61), [0.0, 0.0, -3.0])]),
        ("six planes", six.to_vec()),
    ];
    for mode in Mode::ALL {
        let scene = |camera: Camera, clip_planes: &[ClipPlane]| {
            let (camera, clip_planes) = (Some(camera), clip_planes.to_vec());
            in_mode(Scene { camera, clip_planes, ..scene.clone() }, mode, 110.0)
        };
        let mut scenes = Vec::new();
        for (view, camera) in views {
            for (set, planes) in &sets {
                scenes.push((format!("{view}, {set}"), scene(camera, planes)));
            }
            // It halves the picture, but passes through the centre of no pixel.
            let rays = camera.rays(SIZE.0, SIZE.1).expect("a camera");
            let across = rays.right.normalize() * 0.91 + rays.up.normalize() * 0.37;
            let through = plane(camera.eye, across.to_array());
            scenes.push((format!("{view}, a plane through the eye"), scene(camera, &[through])));
        }
        // Rays neither enter nor leave parallel planes.
        let along_y = Camera { projection: ortho, ..perspective(at(0.5, -1.0, 0.5), centre) };
        let beside = [plane(at(0.43, 0.5, 0.5), [1.0, 0.0, 0.0]), plane(at(0.5, 0.5, 0.71), [0.0, 0.0, -1.0])];
        scenes.push(("planes beside the rays".into(), scene(along_y, &beside)));
        // Together with a box.
        let clip = Some([at(0.1, -1.0, 0.3), at(0.8, 0.9, 2.0)]);
        scenes.push(("a box too".into(), Scene { clip, ..scene(outside, &sets[0].1) }));
        check(&test.store, &scenes);
    }
}

/// A solid ball in bricks of 16, most of them wholly inside its surface: a cut through it is capped from edge to edge, in one colour, and left
/// open on request. Only bricks next to the cut or the surface are read.
#[test]
fn a_cut_through_a_solid_is_capped_everywhere() {
    let (n, radius) = (96, 40.0);
    let centre = DVec3::splat(0.5 * f64::from(n) - 0.5);
    let value = |_, _, v: [u32; 3]| {
        let from = DVec3::from_array(v.map(f64::from)) - centre;
        (128.0 + 8.0 * (radius - from.length())).clamp(0.0, 255.0) as u8
    };
    let test = TestStore::pack(&FunctionSource::new(Extent::new(n, n, n), Geometry::default(), value), 16);
    let normal = DVec3::new(1.0, 0.2, 0.1).normalize();
    let camera = Camera {
        projection: Projection::Orthographic { height: 40.0 },
        ..perspective(centre - normal * 200.0, centre)
    };
    let surface = Isosurface { color: Some([0.8, 0.6, 0.2]), ..Isosurface::at(128.0) };
    let layer = SceneLayer { isosurfaces: vec![surface], ..gray().into() };
    let solid = Scene {
        camera: Some(camera),
        mode: Mode::Isosurface,
        clip_planes: vec![plane(centre, normal.to_array())],
        level: LevelPolicy::Locked(0),
        layers: vec![layer],
        ..Scene::default()
    };
    // It faces the light at the eye.
    let (own, white) = headlight(Some(1.0));
    let lit = Picture::quantise([0.8, 0.6, 0.2].map(|channel| (channel * own + white) as f32));
    for way in WAYS {
        let Some(mut session) = session(&test.store, way) else { continue };
        let (capped, stats) = settled(&mut session, &solid, SIZE);
        let off = capped.rgb.iter().find(|pixel| (0..3).any(|k| pixel[k].abs_diff(lit[k]) > 1));
        assert_eq!(off, None, "{way:?}: expected {lit:?}");
        let open = Scene { caps: Some(false), ..solid.clone() };
        let (open, _) = settled(&mut session, &open, SIZE);
        assert_ne!(open, capped, "{way:?}");
        // Of 108 on the inner side.
        assert!(stats.bricks.wanted < 90, "{way:?}: {:?}", stats.bricks);
    }
}

/// The segment behind a cut belongs to the brick of its middle, which the cut may miss by half a segment.
#[test]
fn caps_just_behind_a_border_of_bricks_are_seen() {
    // Borders of bricks are at 15.5, 31.5 and 47.5; all bricks are inside the surface.
    let volume = FunctionSource::new(Extent::new(64, 64, 64), Geometry::default(), |_, _, _| 200u8);
    let test = TestStore::pack(&volume, 16);
    let surface = Isosurface { color: Some([0.8, 0.6, 0.2]), ..Isosurface::at(100.0) };
    let glass = Isosurface { color: Some([0.2, 0.6, 0.8]), opacity: 0.5, ..Isosurface::at(150.0) };
    let (own, white) = headlight(Some(1.0));
    let lit = Picture::quantise([0.8, 0.6, 0.2].map(|channel| (channel * own + white) as f32));
    for way in WAYS {
        let Some(mut session) = session(&test.store, way) else { continue };
        for (at, step) in [(31.5137, 1.0), (15.9, 1.0), (32.9, 4.0)] {
            let target = DVec3::new(31.0, 30.0, at);
            let camera = Camera {
                projection: Projection::Orthographic { height: 20.0 },
                up: DVec3::Y,
                ..perspective(target + DVec3::Z * 150.0, target)
            };
            let scene = |isosurfaces| Scene {
                camera: Some(camera),
                mode: Mode::Isosurface,
                clip_planes: vec![plane(target, [0.0, 0.0, -1.0])],
                layers: vec![SceneLayer { isosurfaces, ..gray().into() }],
                step,
                ..Scene::default()
            };
            let (capped, _) = settled(&mut session, &scene(vec![surface]), SIZE);
            let off = capped.rgb.iter().filter(|pixel| (0..3).any(|k| pixel[k].abs_diff(lit[k]) > 1)).count();
            assert_eq!(off, 0, "{way:?}, {at}");
            let layered = scene(vec![surface, glass]);
            let (found, _) = settled(&mut session, &layered, SIZE);
            let most = found.difference(&oracle(&test.store, &layered, SIZE)).max;
            assert!(most <= 1, "{way:?}, {at}, two surfaces: {most}");
        }
    }
}

#[test]
fn what_planes_leave_nothing_of_is_the_background() {
    let (test, (low, high), scene) = volume();
    let centre = (low + high) * 0.5;
    let planes = [
        vec![plane(centre, [1.0, 0.0, 0.5]), plane(centre - DVec3::X * 0.5, [-1.0, 0.0, -0.5])],
        vec![plane(high + 0.1, [1.0, 1.0, 1.0])],
    ];
    for mode in Mode::ALL {
        for way in WAYS {
            let Some(mut session) = session(&test.store, way) else { continue };
            for clip_planes in planes.clone() {
                let scene = in_mode(Scene { clip_planes, ..scene.clone() }, mode, 110.0);
                let (picture, stats) = settled(&mut session, &scene, SIZE);
                let background = Picture::quantise(scene.background.map(|c| c as f32));
                assert!(picture.rgb.iter().all(|p| *p == background), "{mode:?} {way:?}");
                // Bricks on both of two planes are wanted, although nothing lies between.
                let wanted = stats.bricks.wanted;
                assert!(scene.clip_planes.len() > 1 || wanted == 0, "{mode:?} {way:?}: {wanted} bricks");
            }
        }
    }
}

/// A ray's length inside a box and on the inner sides of planes.
fn length_inside(ray: &Ray, (low, high): (DVec3, DVec3), planes: &[ClipPlane]) -> f64 {
    let faces = DVec3::AXES.into_iter().flat_map(|n| [(low, n), (high, -n)]);
    let planes = planes.iter().map(|plane| (plane.point, plane.normal));
    let (mut from, mut to) = (0.0f64, f64::INFINITY);
    for (point, normal) in faces.chain(planes) {
        let t = normal.dot(point - ray.origin) / normal.dot(ray.direction);
        if normal.dot(ray.direction) > 0.0 { from = from.max(t) } else { to = to.min(t) }
    }
    (to - from).max(0.0)
}

/// A constant medium cut by oblique planes has Beer-Lambert's opacity over exactly the remaining length.
#[test]
fn a_constant_medium_cut_obliquely_is_beer_lambert() {
    let extent = Extent::new(70, 70, 70);
    let geometry = Geometry { spacing: DVec3::splat(0.5), ..Geometry::default() };
    let test = TestStore::pack(&FunctionSource::new(extent, geometry.clone(), |_, _, _| 100u8), 16);
    let alpha = 0.05;
    let transfer = TransferFunction {
        color: vec![[0.0, 1.0, 0.5, 0.25]],
        opacity: vec![[0.0, alpha]],
        unit_distance: 1.0,
        ..TransferFunction::default()
    };
    let world = geometry.world_box(extent);
    let centre = (world.0 + world.1) * 0.5;
    let planes = vec![plane(centre + 2.0, [0.4, -0.7, 0.5]), plane(centre + DVec3::Y * 4.0, [-0.9, 0.1, 0.35])];
    let view = perspective(centre + DVec3::new(31.0, -55.0, 24.0), centre);
    for (step, projection) in [(0.7, view.projection), (3.0, Projection::Orthographic { height: 40.0 })] {
        let camera = Camera { projection, ..view };
        let rays = camera.rays(SIZE.0, SIZE.1).expect("a camera");
        let scene = Scene { camera: Some(camera), step, clip_planes: planes.clone(), ..Scene::of(transfer.clone()) };
        for way in WAYS {
            let Some(mut session) = session(&test.store, way) else { continue };
            let (picture, _) = settled(&mut session, &scene, SIZE);
            let mut cut = 0;
            for (x, y) in (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y))) {
                let ray = rays.ray(x as f64 + 0.5, y as f64 + 0.5);
                let length = length_inside(&ray, world, &planes);
                cut += (0.0 < length && length < length_inside(&ray, world, &[])) as u32;
                let opacity = 1.0 - (1.0 - alpha).powf(length);
                let expected = Picture::quantise([1.0, 0.5, 0.25].map(|c| (c * opacity) as f32));
                // One code: rounding may meet an edge between two.
                let close = (0..3).all(|k| picture.pixel(x, y)[k].abs_diff(expected[k]) <= 1);
                assert!(close, "{way:?} {x} {y}: {:?}, expected {expected:?}", picture.pixel(x, y));
            }
            assert!(cut > 500, "planes cut few rays: {cut}");
        }
    }
}

/// Slices of a volume whose values go up and down along x by 31 per voxel, 8192 voxels long.
mod ramp {
    use super::*;

    pub(super) const EXTENT: Extent = Extent::new(8192, 40, 24);

    pub(super) fn voxel(x: u32) -> u8 {
        (x % 16).abs_diff(8) as u8 * 31
    }

    /// The value at a world place.
    pub(super) fn value(x: f64) -> f64 {
        let x = x.clamp(0.0, EXTENT.x as f64 - 1.0);
        let (below, above) = (voxel(x.floor() as u32), voxel(x.ceil() as u32));
        below as f64 + (above as f64 - below as f64) * x.fract()
    }

    pub(super) fn store() -> TestStore {
        TestStore::pack(&FunctionSource::new(EXTENT, Geometry::default(), |_, _, [x, ..]| voxel(x)), 16)
    }
}

/// Thin slices equal the trilinear value where the ray meets the plane, to 1/255: also 8192 voxels away from zero, on borders of voxels and
/// bricks, and on the volume's faces; beside it they are empty.
#[test]
fn thin_slices_are_the_values_on_the_plane() {
    let test = ramp::store();
    let world = Geometry::default().world_box(ramp::EXTENT);
    let scene = |slice: Slice, camera: Option<Camera>| Scene {
        camera,
        slice: Some(slice),
        mode: Mode::Average,
        level: LevelPolicy::Locked(0),
        background: [1.0, 0.0, 0.0],
        ..Scene::of(gray())
    };
    // Brick borders are at 15.5, 4095.5 and 8175.5, kinks at multiples of 8.
    let across = [
        -0.49,
        0.0,
        12.34,
        15.5,
        4095.5,
        4095.5 - 1e-3,
        4095.5 + 1e-3,
        4096.0,
        8175.5 - 0.02,
        8175.5,
        8175.5 + 1e-4,
        8175.5 - 1e-4,
        8180.25,
        8183.5,
        8187.73,
        8191.49,
    ];
    let mut scenes: Vec<Scene> = across.map(|x| scene(Slice::across(0, x), None)).into();
    // Seen along y, with x at full precision across the picture; obliquely; with rays that meet.
    let place = DVec3::new(8180.0, 12.0, 12.0);
    let near = |slice: Slice| Camera {
        target: place,
        eye: place + slice.normal * 30.0,
        projection: Projection::Orthographic { height: 20.0 },
        ..slice.camera(world, slice.image_up(), SIZE)
    };
    // From afar the slab is thicker, and its two sides are harder to distinguish.
    for normal in [[0.0, -1.0, 0.0], [0.3, -1.0, 0.2], [1.0, 0.4, -0.3]] {
        let slice = Slice { point: place, normal: DVec3::from_array(normal), thickness: 0.0 };
        scenes.push(scene(slice, Some(near(slice))));
        let eye = place + slice.normal.normalize() * 5000.0;
        scenes.push(scene(slice, Some(Camera { eye, ..near(slice) })));
        let aside = slice.normal * 20.0 + DVec3::new(8.0, -12.0, 9.0);
        scenes.push(scene(slice, Some(perspective(place + aside, place))));
    }
    let outside = [-0.6, 8191.6, 1e5].map(|x| scene(Slice::across(0, x), None));
    for way in WAYS {
        let Some(mut session) = session(&test.store, way) else { continue };
        for scene in &scenes {
            let slice = scene.slice.expect("a slice");
            let camera = scene.camera_for(&[VolumeSource::of_store(&test.store).place()], SIZE).expect("a camera");
            let rays = camera.rays(SIZE.0, SIZE.1).expect("a camera");
            let (picture, _) = settled(&mut session, scene, SIZE);
            let mut met = 0;
            for (x, y) in (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y))) {
                let ray = rays.ray(x as f64 + 0.5, y as f64 + 0.5);
                let t = slice.normal.dot(slice.point - ray.origin) / slice.normal.dot(ray.direction);
                let point = ray.origin + ray.direction * t;
                // The slab is thicker than zero: near the faces it is neither.
                let inside = (point - world.0).min(world.1 - point).min_element();
                let expected = match inside {
                    _ if t > 0.0 && inside > 0.005 => [ramp::value(point.x).round() as u8; 3],
                    _ if t < 0.0 || inside < -0.2 => [255, 0, 0],
                    _ => continue,
                };
                met += (inside > 0.0) as u32;
                let close = (0..3).all(|k| picture.pixel(x, y)[k].abs_diff(expected[k]) <= 1);
                let found = picture.pixel(x, y);
                assert!(close, "{way:?} {slice:?} {x} {y}: {found:?}, expected {expected:?} at {point}");
            }
            assert!(met > 1000, "{slice:?}: {met} pixels");
        }
        for scene in &outside {
            let (picture, _) = settled(&mut session, scene, SIZE);
            assert!(picture.rgb.iter().all(|p| *p == [255, 0, 0]), "{way:?} {:?}", scene.slice);
        }
    }
}

#[test]
fn slices_and_slabs_equal_the_oracle() {
    let (test, (low, high), scene) = volume();
    let centre = (low + high) * 0.5;
    let oblique = Slice { point: centre, normal: DVec3::new(0.5, -0.7, 0.6), thickness: 0.0 };
    let slices = [
        ("across x", Slice::across(0, centre.x * 1.1)),
        ("across y", Slice { thickness: 0.8 * 16.0, ..Slice::across(1, centre.y) }),
        ("oblique", oblique),
        ("an oblique slab", Slice { thickness: 9.0, ..oblique }),
    ];
    for mode in [Mode::Average, Mode::Mip, Mode::MinIp] {
        let mut scenes = Vec::new();
        for (name, slice) in slices {
            let scene = Scene { slice: Some(slice), mode, ..scene.clone() };
            let camera = Some(perspective(centre + DVec3::new(25.0, -70.0, 41.0), centre));
            // A plane may cut off a slice, too.
            let clip_planes = vec![plane(centre + DVec3::X, [-0.9, 0.3, 0.3])];
            scenes.push((format!("{name}, from aside"), Scene { camera, ..scene.clone() }));
            scenes.push((format!("{name}, cut off"), Scene { clip_planes, ..scene.clone() }));
            scenes.push((name.into(), scene));
        }
        check(&test.store, &scenes);
    }
}

/// Only bricks left by a plane are read, and only those that meet a slice.
#[test]
fn bricks_out_of_sight_are_not_uploaded() {
    let extent = Extent::new(128, 128, 128);
    let test =
        TestStore::pack(&FunctionSource::new(extent, Geometry::default(), |_, _, [x, y, z]| (x + y + z) as u8), 16);
    let middle = DVec3::splat(63.5);
    let scene = |mode| Scene { mode, level: LevelPolicy::Locked(0), ..Scene::of(gray()) };
    let slice = |slice| Scene { slice: Some(slice), ..scene(Mode::Average) };
    // Those with i + j + k up to 3, and up to 1 and 0.
    let corner = vec![plane(DVec3::splat(20.0), [-1.0, -1.0, -1.0])];
    // Of 8 x 8 x 8 bricks; on the way down from the coarsest level those of 4, 2 and 1 per axis may come, too.
    let layer = 64 + 16 + 4 + 1;
    // Voxel coordinates on the plane add up to 193.5: they pass the brick (i, j, k) if i + j + k is 10, 11 or 12, coarser ones if it is
    // 4, 5 or 6, and 1, 2 or 3.
    let oblique = Slice { point: middle + 0.5, normal: DVec3::ONE, thickness: 0.0 };
    let passed = [48 + 48 + 46, 12 + 12 + 10, 3 + 3 + 1, 1];
    let cases = [
        ("a layer", slice(Slice::across(2, 50.2)), 64, layer),
        ("two layers where they meet", slice(Slice::across(1, 47.5)), 128, 2 * 64 + 16 + 4 + 1),
        ("a slab within a layer", slice(Slice { thickness: 15.0, ..Slice::across(0, 55.5) }), 64, layer),
        ("an oblique slice", slice(oblique), passed[0], passed.iter().sum()),
        ("a corner", Scene { clip_planes: corner, ..scene(Mode::Average) }, 20, 20 + 4 + 1 + 1),
    ];
    for way in WAYS {
        for (name, scene, least, most) in &cases {
            let Some(mut session) = session(&test.store, way) else { continue };
            let (_, stats) = settled(&mut session, scene, SIZE);
            let uploaded = stats.bricks.uploaded;
            assert!((*least..=*most).contains(&uploaded), "{way:?} {name}: {uploaded} of {least} to {most}");
        }
    }
}

#[test]
fn the_command_clips_and_slices() {
    let sandbox = Sandbox::default();
    let ramp: Vec<u8> = (0..32 * 20 * 24).map(|i| (i % 32) as u8 * 8).collect();
    sandbox.write("ramp.raw", ramp);
    sandbox.write("gray.json", serde_json::to_string(&gray()).expect("JSON"));
    sandbox.run_ok("pack ramp.raw a.zarr --shape 32,20,24 --dtype u8 --brick 16 --progress none");
    let picture = |flags: &str| {
        sandbox.run_ok(&format!(
            "render a.zarr -o o.png --overwrite --backend cpu --size 64x40 --transfer gray.json --background 1,0,0 {flags}"
        ));
        read_png(&sandbox.path("o.png"))
    };
    // Two pixels to a voxel, as stored: x to the right.
    let z = picture("--slice z=3.25");
    for (column, expected) in [(0, 0), (1, 2), (2, 6), (33, 130), (63, 248)] {
        assert_eq!(z.pixel(column, 17), [expected; 3], "column {column}");
    }
    assert_eq!(picture("--slice x=10.5").pixel(32, 20), [84; 3]);
    assert_eq!(picture("--slice 10.5,0,0:1,0,0"), picture("--slice x=10.5"));
    assert_eq!(picture("--slice x=10.5 --thickness 6").pixel(32, 20), [84; 3], "the mean");
    // From 7.5 to 13.5, except half a step.
    let highest = picture("--slice x=10.5 --thickness 6 --mode mip --step 0.1").pixel(32, 20)[0];
    let lowest = picture("--slice x=10.5 --thickness 6 --mode minip --step 0.1").pixel(32, 20)[0];
    assert!(highest.abs_diff(108) <= 1 && lowest.abs_diff(60) <= 1, "{lowest} to {highest}");
    // A scene file is equivalent to flags, and a picture contains its scene.
    sandbox.write(
        "scene.json",
        r#"{"mode": "average", "slice": {"point": [10.5, 0, 0], "normal": [1, 0, 0], "thickness": 6}, "clip_planes":
            [{"point": [0, 9.5, 0], "normal": [0, 1, 0]}]}"#,
    );
    let cut = picture("--scene scene.json");
    assert_eq!(cut, picture("--slice x=10.5 --thickness 6 --clip-plane 0,9.5,0:0,1,0"));
    let above = picture("--slice x=10.5 --clip-plane 0,9.5,0:0,1,0 --clip-plane 0,0,11.5:0,0,1");
    let red = [255, 0, 0];
    // y to the right and z upwards: one plane leaves the right half, the other the upper one.
    assert_eq!([above.pixel(24, 10), above.pixel(40, 10), above.pixel(40, 30)], [red, [84; 3], red]);
}
