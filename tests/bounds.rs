//! Numbers at the limits of scenes: every renderer draws them like the oracle. Numbers beyond are refused (`tests/bad_input.rs`).

use brickyard::volume::{
    Camera, Extent, Geometry, Mode, Placement, Projection, Scene, SceneLayer, Slice, Stereo, StereoLayout,
    TransferFunction,
};
use brickyard_tests::{FunctionSource, TestStore, oracle, sessions, settled};
use glam::DVec3;

const SIZE: (u32, u32) = (24, 18);
const EXTENT: Extent = Extent::new(24, 20, 22);

fn fog(unit_distance: f64) -> TransferFunction {
    TransferFunction {
        color: vec![[0.0, 0.9, 0.1, 0.4], [255.0, 0.3, 0.8, 0.2]],
        opacity: vec![[0.0, 0.05], [255.0, 0.4]],
        unit_distance,
        ..TransferFunction::default()
    }
}

/// Fog seen from afar, filling the picture.
fn from(distance: f64) -> Scene {
    let (low, high) = Geometry::default().world_box(EXTENT);
    let target = (low + high) * 0.5;
    let fov_y_deg = 2.0 * (14.0 / distance).atan().to_degrees();
    let eye = target + DVec3::new(0.3, -0.9, 0.3).normalize() * distance;
    let camera = Camera { eye, target, up: DVec3::Z, projection: Projection::Perspective { fov_y_deg } };
    Scene { camera: Some(camera), ..Scene::of(fog(8.0)) }
}

fn with_projection(projection: Projection) -> Scene {
    let near = from(60.0);
    Scene { camera: near.camera.map(|camera| Camera { projection, ..camera }), ..near }
}

#[test]
fn pictures_agree_at_the_ends_of_what_numbers_may_be() {
    let value = |[x, y, z]: [u32; 3]| {
        let [u, v, w] = [x, y, z].map(f64::from);
        (127.0 + 60.0 * (0.41 * u + 0.37 * v).sin() + 60.0 * (0.39 * v - 0.38 * w).cos()) as u8
    };
    let test = TestStore::pack(&FunctionSource::new(EXTENT, Geometry::default(), move |_, _, v| value(v)), 16);
    let near = from(60.0);
    let of = |layer: SceneLayer| Scene { layers: vec![layer], ..near.clone() };
    let placed = |text: &str| Placement::from_text(text).expect("a map");
    let window = |window| of(SceneLayer { window: Some(window), ..SceneLayer::default() });
    let slab = |thickness| Slice { point: DVec3::splat(9.0), normal: DVec3::NEG_Y, thickness };
    let stereo =
        |eye_separation, convergence| Stereo { eye_separation, convergence, ..Stereo::new(StereoLayout::TopBottom) };
    let scaled = |scale: f64| {
        let map = placed(&format!("{scale} 0 0 0  0 {scale} 0 0  0 0 {scale} 0"));
        let layer =
            SceneLayer { world_from_volume: map, transfer: Some(fog(8.0 * scale).into()), ..SceneLayer::default() };
        let camera =
            near.camera.map(|camera| Camera { eye: camera.eye * scale, target: camera.target * scale, ..camera });
        Scene { camera, ..of(layer) }
    };
    let moved = |by: f64| {
        let map = placed(&format!("1 0 0 {by}  0 1 0 0  0 0 1 0"));
        let layer = SceneLayer { world_from_volume: map, transfer: Some(fog(8.0).into()), ..SceneLayer::default() };
        let by = DVec3::X * by;
        let camera = near.camera.map(|camera| Camera { eye: camera.eye + by, target: camera.target + by, ..camera });
        Scene { camera, ..of(layer) }
    };
    let scenes = [
        ("the least step", Scene { step: 0.005, ..near.clone() }),
        ("the greatest step", Scene { step: 16.0, ..near.clone() }),
        ("a projection by the greatest step", Scene { step: 16.0, mode: Mode::Mip, ..near.clone() }),
        ("the farthest eye", from(1e5)),
        (
            "the farthest eye of parallel rays",
            Scene {
                camera: with_projection(Projection::Orthographic { height: 30.0 })
                    .camera
                    .map(|camera| Camera { eye: from(1e5).camera.expect("one").eye, ..camera }),
                ..near.clone()
            },
        ),
        ("the least field of view", with_projection(Projection::Perspective { fov_y_deg: 0.001 })),
        ("nearly the greatest field of view", with_projection(Projection::Perspective { fov_y_deg: 179.0 })),
        ("the least height", with_projection(Projection::Orthographic { height: 0.001 })),
        ("a great height", with_projection(Projection::Orthographic { height: 1e30 })),
        ("a tiny pixel error", Scene { pixel_error: 1e-300, ..near.clone() }),
        ("a huge pixel error", Scene { pixel_error: 1e300, ..near.clone() }),
        ("the window of all floats", window([-3e38, 3e38])),
        ("a window beyond all floats", window([1e300, 2e300])),
        (
            "a slab of any thickness",
            Scene { slice: Some(slab(1e300)), mode: Mode::Average, camera: None, ..near.clone() },
        ),
        (
            "a slab as thin as can be",
            Scene { slice: Some(slab(1e-300)), mode: Mode::Mip, camera: None, ..near.clone() },
        ),
        (
            "a box as large as can be",
            Scene { clip: Some([DVec3::splat(-1e300), DVec3::new(1e300, 9.0, 1e300)]), ..near.clone() },
        ),
        ("a tiny unit distance", of(fog(1e-300).into())),
        ("a huge unit distance", of(fog(1e300).into())),
        ("eyes side by side", Scene { stereo: Some(stereo(Some(1e-300), None)), ..near.clone() }),
        ("eyes far apart", Scene { stereo: Some(stereo(Some(1e4), None)), ..near.clone() }),
        ("a screen before the eyes", Scene { stereo: Some(stereo(None, Some(1e-300))), ..near.clone() }),
        ("huge voxels", scaled(1e15)),
        ("tiny voxels", scaled(1e-15)),
        ("far from the origin", moved(1e11)),
    ];
    for (way, mut session) in sessions(&test.store) {
        for (what, scene) in &scenes {
            let (picture, _) = settled(&mut session, scene, SIZE);
            let found = picture.difference(&oracle(&test.store, scene, SIZE));
            assert!(found.max <= 1 || found.psnr_db >= 50.0, "{what}, {way:?}: {found:?}");
        }
    }
}

#[test]
fn a_picture_without_pixels_is_refused() {
    let test = TestStore::pack(&FunctionSource::new(EXTENT, Geometry::default(), |_, _, [x, ..]| x as u8), 16);
    for (_, mut session) in sessions(&test.store) {
        for size in [(0, 18), (24, 0)] {
            let said = session.render(&from(60.0), size).expect_err("no picture").to_string();
            assert!(said.contains(&format!("{}x{} pixels: expected at least one", size.0, size.1)), "{said}");
        }
    }
}
