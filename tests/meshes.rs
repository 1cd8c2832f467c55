//! Triangle meshes in one picture with the volume, end to end: against the oracle in all modes and ways to draw, for any bricks, and
//! against formulas.
//!
//! A GPU assigns a pixel's centre to a triangle on a raster of 256ths of a pixel, and by other rules than the oracle. So pixels are
//! left out where the oracle hits other triangles a 50th of a pixel to a side.

use brickyard::backend::{BackendChoice, BackendError, CompositorChoice};
use brickyard::exact::{ExactPictureError, ExactRenderer};
use brickyard::render::GpuError;
use brickyard::session::SessionError;
use brickyard::stats::RenderStats;
use brickyard::store::Store;
use brickyard::volume::{
    Camera, Extent, FrameSettings, Geometry, LevelPolicy, Lighting, LightingModel, Mesh, MeshLook, Method, Mode,
    Picture, Projection, Sampling, Scene, Stereo, StereoLayout, TransferFunction, Voxel,
};
use brickyard_pager::encoding_of;
use brickyard_tests::{
    FunctionSource, TestStore, WAYS, in_mode, leave_out, open_session, options, oracle, resolved, session, settled,
};
use glam::DVec3;
use std::sync::Arc;
use std::time::{Duration, Instant};

const SIZE: (u32, u32) = (64, 50);

/// A mesh of these triangles, by their vertices.
fn mesh(positions: Vec<DVec3>, triangles: Vec<[u32; 3]>) -> Mesh {
    let positions = positions.iter().map(|p| p.as_vec3().to_array()).collect();
    Mesh::new(positions, triangles, vec![], vec![]).expect("a mesh")
}

fn quad(centre: DVec3, right: DVec3, up: DVec3) -> Mesh {
    let corners = [-right - up, right - up, right + up, up - right];
    mesh(corners.map(|corner| centre + corner).to_vec(), vec![[0, 1, 2], [0, 2, 3]])
}

/// A sphere of few triangles, with normals and colours, for a round look with distinct sides.
fn sphere(centre: DVec3, radius: DVec3) -> Mesh {
    const AROUND: u32 = 14;
    const DOWN: u32 = 7;
    let (mut positions, mut normals, mut colors, mut triangles) = (vec![], vec![], vec![], vec![]);
    for j in 0..=DOWN {
        for i in 0..AROUND {
            let (across, down) = (i as f64 / AROUND as f64, j as f64 / DOWN as f64);
            let (around, polar) = (std::f64::consts::TAU * across, std::f64::consts::PI * down);
            let n = DVec3::new(polar.sin() * around.cos(), polar.sin() * around.sin(), polar.cos());
            positions.push((centre + n * radius).as_vec3().to_array());
            normals.push((n / radius).as_vec3().to_array());
            colors.push([(255.0 * down) as u8, 200, (255.0 * across) as u8]);
        }
    }
    for j in 0..DOWN {
        for i in 0..AROUND {
            let at = |i: u32, j: u32| j * AROUND + i % AROUND;
            triangles.extend([[at(i, j), at(i + 1, j), at(i, j + 1)], [at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)]]);
        }
    }
    Mesh::new(positions, triangles, normals, colors).expect("a mesh")
}

fn look(mesh: Mesh, color: Option<[f64; 3]>, opacity: f64) -> MeshLook {
    MeshLook { color, opacity, mesh: Some(Arc::new(mesh)), ..MeshLook::new("made.here") }
}

fn transfer(unit_distance: f64) -> TransferFunction {
    TransferFunction {
        color: vec![[0.0, 0.1, 0.2, 0.9], [128.0, 0.2, 0.9, 0.3], [255.0, 1.0, 0.6, 0.1]],
        opacity: vec![[50.0, 0.0], [128.0, 0.06], [255.0, 0.3]],
        unit_distance,
        ..TransferFunction::default()
    }
}

/// A volume of this brick edge and unequal spacing, its world box, and a scene to start from.
fn volume(edge: u32) -> (TestStore, (DVec3, DVec3), Scene) {
    let extent = Extent::new(61, 53, 67);
    let geometry =
        Geometry { spacing: DVec3::new(0.5, 0.8, 1.1), origin: DVec3::new(100.0, -7.0, 3.0), ..Geometry::default() };
    let value = |[x, y, z]: [u32; 3]| {
        let [x, y, z] = [x, y, z].map(f64::from);
        0.5 + 0.25 * (0.21 * x + 0.07 * y).sin() + 0.25 * (0.17 * y - 0.13 * z).cos()
    };
    let code = move |v| u8::from_f64_rounded(value(v) * 255.0);
    let test = TestStore::pack(&FunctionSource::new(extent, geometry.clone(), move |_, _, v| code(v)), edge);
    let transfer = transfer(geometry.voxel_size(extent) * 2.0);
    (test, geometry.world_box(extent), Scene { background: [0.1, 0.05, 0.2], ..Scene::of(transfer) })
}

fn perspective(eye: DVec3, target: DVec3) -> Camera {
    Camera { eye, target, up: DVec3::Z, projection: Projection::Perspective { fov_y_deg: 40.0 } }
}

/// From outside, parallel, and from inside volume and meshes.
fn views((low, high): (DVec3, DVec3)) -> [(&'static str, Camera); 3] {
    let (centre, size) = ((low + high) * 0.5, high - low);
    let at = |x: f64, y: f64, z: f64| low + size * DVec3::new(x, y, z);
    let projection = Projection::Orthographic { height: size.length() * 0.9 };
    [
        ("outside", perspective(at(1.9, -1.2, 1.4), centre)),
        ("orthographic", Camera { projection, ..perspective(at(-1.0, 2.0, 0.9), centre) }),
        ("inside", perspective(at(0.46, 0.42, 0.57), at(0.9, 0.8, 0.3))),
    ]
}

/// Meshes that cross one another and the volume's faces, reach behind the eye, and stand outside.
fn crowd((low, high): (DVec3, DVec3), [ball, sheet, other]: [f64; 3]) -> Vec<MeshLook> {
    let size = high - low;
    let at = |x: f64, y: f64, z: f64| low + size * DVec3::new(x, y, z);
    vec![
        look(sphere(at(0.5, 0.5, 0.5), size * 0.37), None, ball),
        look(
            quad(at(0.5, 0.45, 0.5), size * DVec3::new(0.7, 0.2, 0.1), size * DVec3::new(-0.1, 0.3, 0.8)),
            None,
            sheet,
        ),
        look(
            quad(at(0.45, 0.5, 0.55), size * DVec3::new(0.6, -0.3, 0.2), size * DVec3::new(0.2, 0.2, -0.5)),
            Some([0.9, 0.3, 0.1]),
            other,
        ),
        MeshLook { lit: false, ..look(sphere(at(0.75, 0.3, 0.8), size * 0.13), Some([0.2, 0.9, 0.4]), 1.0) },
        look(sphere(at(1.2, 0.1, 0.2), size * 0.2), None, other),
    ]
}

fn frame_of(store: &Arc<Store>, scene: &Scene, size_px: (u32, u32)) -> FrameSettings {
    resolved(store, scene, size_px).layers.remove(0).frames.remove(0).settings
}

/// Whether a pixel's centre is at least a 50th of a pixel from all edges.
fn is_clear(frame: &FrameSettings, x: u32, y: u32) -> bool {
    let met = |dx: f64, dy: f64| -> Vec<u32> {
        let ray = frame.rays.ray(x as f64 + 0.5 + dx, y as f64 + 0.5 + dy);
        brickyard::reference::layers(frame, &ray).iter().map(|layer| layer.number).collect()
    };
    let here = met(0.0, 0.0);
    [(-0.02, -0.02), (0.02, -0.02), (-0.02, 0.02), (0.02, 0.02)].into_iter().all(|(dx, dy)| met(dx, dy) == here)
}

/// Asserts equal pictures except at edges, and, for surfaces, except for three pixels in a thousand, where rounding decides whether
/// a grazing ray hits.
fn assert_alike(found: &Picture, expected: &Picture, frame: &FrameSettings, what: &str) {
    let pixels = || (0..frame.rays.height).flat_map(|y| (0..frame.rays.width).map(move |x| (x, y)));
    let all = expected.rgb.len();
    let (mut left_out, mut off, mut most) = (0, 0, 0);
    for (x, y) in pixels() {
        let (a, b) = (found.pixel(x, y), expected.pixel(x, y));
        let difference = (0..3).map(|k| a[k].abs_diff(b[k])).max().unwrap_or(0);
        if difference > 1 && !is_clear(frame, x, y) {
            left_out += 1;
        } else {
            off += (difference > 1) as usize;
            most = most.max(difference);
        }
    }
    let allowed = if frame.mode == Mode::Isosurface { all * 3 / 1000 } else { 0 };
    assert!(off <= allowed, "{what}: {off} pixels are off, by up to {most}");
    // A 25th of a pixel about each edge: too few to hide a mistake.
    assert!(left_out * 100 <= 2 * all, "{what}: {left_out} pixels at edges");
    let colors: std::collections::BTreeSet<_> = expected.rgb.iter().collect();
    assert!(colors.len() > 50, "{what}: a flat picture proves nothing");
}

fn check(store: &Arc<Store>, scenes: &[(String, Scene)], size_px: (u32, u32)) {
    let expected: Vec<Picture> = scenes.iter().map(|(_, scene)| oracle(store, scene, size_px)).collect();
    for way in WAYS {
        let Some(mut session) = session(store, way) else { continue };
        for ((name, scene), expected) in scenes.iter().zip(&expected) {
            let frame = frame_of(store, scene, size_px);
            let (picture, _) = settled(&mut session, scene, size_px);
            assert_alike(&picture, expected, &frame, &format!("{:?}, {name}, {way:?}", scene.mode));
        }
    }
}

#[test]
fn opaque_meshes_equal_the_oracle_in_all_modes_and_bricks() {
    // Bricks of 16, of 64, and one brick.
    for edge in [16, 64, 128] {
        let (test, world, scene) = volume(edge);
        let mut scenes = Vec::new();
        for mode in Mode::ALL {
            for (view, camera) in views(world) {
                let meshes = crowd(world, [1.0; 3]);
                let scene = in_mode(Scene { camera: Some(camera), meshes, ..scene.clone() }, mode, 140.0);
                scenes.push((format!("{view}, bricks of {edge}"), scene));
            }
        }
        // One size of brick shows all views, the others one.
        scenes.retain(|(name, _)| edge == 16 || name.starts_with("outside"));
        check(&test.store, &scenes, SIZE);
    }
}

#[test]
fn translucent_meshes_equal_the_oracle_whatever_the_bricks() {
    for edge in [16, 64, 128] {
        let (test, world, scene) = volume(edge);
        let mut scenes = Vec::new();
        for (view, camera) in views(world) {
            let scene = Scene { camera: Some(camera), ..scene.clone() };
            let crowd = |opacities| crowd(world, opacities);
            let surface = in_mode(scene.clone(), Mode::Isosurface, 140.0);
            scenes.push((format!("{view}, fog"), Scene { meshes: crowd([0.4, 0.7, 0.25]), ..scene.clone() }));
            scenes.push((format!("{view}, surface"), Scene { meshes: crowd([0.4, 0.7, 0.25]), ..surface }));
            scenes.push((format!("{view}, some opaque"), Scene { meshes: crowd([0.5, 1.0, 0.5]), ..scene.clone() }));
            // A method that takes segments from end to end, and as far as the next ones.
            let sampling = Sampling { method: Method::Pcvs, ..Sampling::default() };
            let lighting = Lighting { model: LightingModel::BlinnPhong, ..Lighting::default() };
            let lit = Scene { sampling, lighting, meshes: crowd([0.5, 0.5, 1.0]), ..scene };
            scenes.push((format!("{view}, lit"), lit));
        }
        scenes.retain(|(name, _)| edge == 16 || name.starts_with("outside"));
        check(&test.store, &scenes, SIZE);
    }
}

#[test]
fn both_eyes_see_meshes_where_they_are() {
    let (test, world, scene) = volume(16);
    let [(_, camera), (_, parallel), _] = views(world);
    for camera in [camera, parallel] {
        let meshes = crowd(world, [0.4, 1.0, 0.25]);
        let scene = Scene { camera: Some(camera), meshes, ..scene.clone() };
        let stereo = Some(Stereo::new(StereoLayout::SideBySide));
        let both = Scene { stereo, ..scene.clone() };
        let resolved = resolved(&test.store, &both, SIZE);
        let [left, right] = &resolved.layers[0].frames[..] else { panic!("two eyes") };
        let expected = oracle(&test.store, &both, SIZE);
        for way in WAYS {
            let Some(mut session) = session(&test.store, way) else { continue };
            let (picture, _) = settled(&mut session, &both, SIZE);
            for (frame, first) in [(&left.settings, 0), (&right.settings, SIZE.0 / 2)] {
                let half = |picture: &Picture| Picture {
                    width: SIZE.0 / 2,
                    height: SIZE.1,
                    rgb: (0..SIZE.1)
                        .flat_map(|y| (0..SIZE.0 / 2).map(move |x| (x, y)))
                        .map(|(x, y)| picture.pixel(first + x, y))
                        .collect(),
                };
                assert_alike(&half(&picture), &half(&expected), frame, &format!("{way:?} from {first}"));
            }
        }
    }
}

/// Walls across a uniform fog: each pixel has a formula.
#[test]
fn layers_in_fog_are_as_deep_as_they_should_be() {
    let extent = Extent::new(40, 40, 40);
    let test = TestStore::pack(&FunctionSource::new(extent, Geometry::default(), |_, _, _| 100u8), 16);
    let fog = DVec3::new(1.0, 0.5, 0.0);
    let transfer = TransferFunction {
        color: vec![[0.0, 1.0, 0.5, 0.0]],
        opacity: vec![[0.0, 0.05]],
        unit_distance: 1.0,
        ..TransferFunction::default()
    };
    let background = DVec3::new(0.1, 0.2, 0.3);
    // Two crossing in the middle of the picture, one right behind another, two at one place, and an opaque one.
    let wall = |x: f64, slope: f64, color: [f64; 3], opacity: f64| {
        let (right, up) = (DVec3::new(slope, 1.0, 0.0), DVec3::Z);
        let mesh = quad(DVec3::new(x, 20.0, 20.0), right * 90.0, up * 90.0);
        (DVec3::X * x, DVec3::new(1.0, -slope, 0.0), MeshLook { lit: false, ..look(mesh, Some(color), opacity) })
    };
    let walls = [
        wall(12.0, 0.4, [0.0, 0.0, 1.0], 0.5),
        wall(12.0, -0.4, [0.0, 1.0, 0.0], 0.4),
        wall(25.0, 0.0, [1.0, 0.0, 1.0], 0.3),
        wall(25.0, 0.0, [0.0, 1.0, 1.0], 0.6),
        wall(25.5, 0.0, [1.0, 1.0, 1.0], 0.2),
        wall(33.0, 0.2, [0.3, 0.3, 0.3], 1.0),
    ];
    for count in [2, 5, 6] {
        let scene = Scene {
            camera: Some(perspective(DVec3::new(-45.0, 21.3, 19.1), DVec3::splat(20.0))),
            background: background.to_array(),
            meshes: walls[..count].iter().map(|(_, _, look)| look.clone()).collect(),
            level: LevelPolicy::Locked(0),
            ..Scene::of(transfer.clone())
        };
        let frame = frame_of(&test.store, &scene, SIZE);
        let (low, high) = frame.geometry.world_box(extent);
        let expected = |x: u32, y: u32| {
            let ray = frame.rays.ray(x as f64 + 0.5, y as f64 + 0.5);
            let (a, b) = ((low - ray.origin) / ray.direction, (high - ray.origin) / ray.direction);
            let (enter, leave) = (a.min(b).max_element(), a.max(b).min_element().max(a.min(b).max_element()));
            let through = |near: f64, far: f64, behind: DVec3| {
                let length = (far.min(leave) - near.max(enter)).max(0.0);
                fog.lerp(behind, 0.95f64.powf(length))
            };
            let mut layers: Vec<(f64, usize)> = (0..count)
                .map(|i| {
                    let (point, normal, _) = &walls[i];
                    let point = *point + DVec3::new(0.0, 20.0, 20.0);
                    ((point - ray.origin).dot(*normal) / ray.direction.dot(*normal), i)
                })
                .collect();
            layers.sort_by(|a, b| a.partial_cmp(b).expect("numbers"));
            let (mut color, mut far) = (background, f64::INFINITY);
            for (t, i) in layers.into_iter().rev() {
                let look = &walls[i].2;
                color = through(t, far, color).lerp(look.color.expect("a colour").into(), look.opacity);
                far = t;
            }
            Picture::quantise(through(0.0, far, color).as_vec3().to_array())
        };
        for way in WAYS {
            let Some(mut session) = session(&test.store, way) else { continue };
            let (picture, _) = settled(&mut session, &scene, SIZE);
            for (x, y) in (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y))) {
                let (found, expected) = (picture.pixel(x, y), expected(x, y));
                let is_same = (0..3).all(|k| found[k].abs_diff(expected[k]) <= 1);
                assert!(is_same, "{count} walls, {way:?}, {x},{y}: {found:?} {expected:?}");
            }
        }
    }
}

#[test]
fn a_lost_device_gets_its_meshes_back() {
    let (test, world, scene) = volume(16);
    let scene = Scene { camera: Some(views(world)[0].1), meshes: crowd(world, [0.4, 1.0, 0.25]), ..scene };
    for way in WAYS {
        let Some(mut session) = session(&test.store, way) else { continue };
        let (before, _) = settled(&mut session, &scene, SIZE);
        if way.0 == BackendChoice::Cpu {
            continue;
        }
        let frame = session.step(&scene, SIZE).expect("the scene is possible");
        session.backend().expect("it has drawn").destroy_device();
        let anew = session.draw(&frame).expect("drawn anew");
        // Bricks may be in other slots, where coordinates are rounded differently.
        assert!(anew.difference(&before).max <= 1, "{way:?}");
        // Other meshes, none, and the first again.
        let fewer = Scene { meshes: scene.meshes[1..3].to_vec(), ..scene.clone() };
        let frame = frame_of(&test.store, &fewer, SIZE);
        let (picture, _) = settled(&mut session, &fewer, SIZE);
        assert_alike(&picture, &oracle(&test.store, &fewer, SIZE), &frame, &format!("fewer, {way:?}"));
        let (none, _) = settled(&mut session, &Scene { meshes: vec![], ..scene.clone() }, SIZE);
        assert!(none.difference(&before).max > 50);
        let (again, stats) = settled(&mut session, &scene, SIZE);
        assert!(again.difference(&before).max <= 1 && stats.device_losses == 1, "{way:?}: {stats:?}");
    }
}

#[test]
fn exact_pictures_have_meshes_too() {
    // For half of the 79 bricks, or fewer.
    const BYTES: u64 = 840 << 10;
    let (test, world, scene) = volume(16);
    let meshes = crowd(world, [0.4, 1.0, 0.25]);
    let scene = Scene { camera: Some(views(world)[0].1), meshes, level: LevelPolicy::Locked(0), ..scene };
    let way = (BackendChoice::Gpu, CompositorChoice::Sorted);
    let options = options(way, BYTES, 4 << 20);
    let mut exact =
        match ExactRenderer::new(test.store.clone(), encoding_of(&*test.store, 0), scene.needs(), SIZE, &options) {
            Ok(exact) => exact,
            Err(ExactPictureError::Backend(BackendError::Gpu(error @ GpuError::NoAdapter { .. }))) => {
                return leave_out("gpu", error);
            }
            Err(error) => panic!("{error}"),
        };
    let resolved = resolved(&test.store, &scene, SIZE);
    for is_lost in [false, true] {
        if is_lost {
            exact.renderer().destroy_device();
        }
        let mut stats = RenderStats::default();
        let picture = exact.render(&resolved, Duration::from_secs(60), Instant::now(), &mut stats).expect("a picture");
        assert!(stats.passes >= Some(10) && stats.gpu_bytes_peak <= BYTES, "several lists and slabs: {stats:?}");
        assert_alike(&picture, &oracle(&test.store, &scene, SIZE), &resolved.layers[0].frames[0].settings, "exact");
    }
}

#[test]
fn budgets_pay_for_meshes_that_come_and_go() {
    let (test, world, scene) = volume(16);
    let scene = Scene { camera: Some(views(world)[0].1), meshes: crowd(world, [1.0; 3]), ..scene };
    let bare = Scene { meshes: vec![], ..scene.clone() };
    for way in WAYS {
        let Some(mut session) = session(&test.store, way) else { continue };
        let mut drawn = |scene: &Scene| {
            let (picture, _) = settled(&mut session, scene, SIZE);
            let frame = frame_of(&test.store, scene, SIZE);
            assert_alike(&picture, &oracle(&test.store, scene, SIZE), &frame, &format!("{way:?}"));
            let backend = session.backend().expect("it has drawn");
            (backend.bytes(), backend.slots(0))
        };
        let [without, with, again] = [&bare, &scene, &bare].map(&mut drawn);
        // On a GPU there are slots for all bricks, and meshes take extra memory; on the CPU they take slots.
        let is_paid = with.0 > without.0 + 20_000 || with.1 < without.1;
        assert!(is_paid && with.0 <= 256 << 20, "{way:?}: {with:?} and {without:?}");
        assert_eq!(with, again, "the room stays");
    }
    let small = options(WAYS[3], 1 << 30, scene.needs().meshes.bytes());
    let mut session = open_session(&test.store, small).expect("the CPU is there");
    let refused = session.step(&scene, SIZE).err();
    assert!(matches!(refused, Some(SessionError::Pager(_))), "{refused:?}");
}
