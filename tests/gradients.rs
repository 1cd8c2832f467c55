//! Transfer functions of value and gradient, end to end: pictures follow formulas, by every method, step, spacing and level, with and without
//! skipping.

use brickyard::volume::{
    Camera, Extent, Filter, Geometry, Gradient, LevelPolicy, Lighting, LightingModel, Method, Picture, Projection,
    Region, Sampling, Scene, Shape, TransferFunction, Voxel,
};
use brickyard_tests::{
    FunctionSource, TestStore, WAYS, assert_same, oracle, session, session_without_skipping, settled,
};
use glam::DVec3;

const SIZE: (u32, u32) = (33, 25);

fn region(shape: Shape, value: [f64; 2], gradient: [f64; 2], opacity: f64) -> Region {
    Region { shape, value, gradient, color: [1.0, 0.5, 0.25], opacity }
}

/// An even slope has one gradient everywhere, so a function of it is a homogeneous medium: Beer-Lambert's opacity.
#[test]
fn an_even_slope_is_beer_lambert_by_its_gradient() {
    let spacing = DVec3::new(1.0, 0.5, 2.0);
    // World units; 16-bit codes, so that a voxel's rounding changes the gradient little.
    let slope = DVec3::new(150.0, -80.0, 60.0);
    let extent = Extent::new(72, 96, 64);
    let geometry = Geometry { spacing, ..Geometry::default() };
    let source = FunctionSource::new(extent, geometry.clone(), |_, _, v| {
        let world = (DVec3::from_array(v.map(f64::from)) + 0.5) * spacing;
        u16::from_f64_rounded(20000.0 + slope.dot(world))
    });
    let steepness = slope.length();
    let white = TransferFunction { color: vec![[0.0, 1.0, 0.5, 0.25]], ..TransferFunction::default() };
    let everywhere = [0.0, 60000.0];
    let functions = [
        TransferFunction {
            opacity: vec![[0.0, 0.4]],
            gradient_opacity: vec![[0.0, 0.0], [0.5 * steepness, 0.1], [1.5 * steepness, 0.4]],
            ..white.clone()
        },
        TransferFunction {
            regions: vec![region(Shape::Rectangle, everywhere, [0.9 * steepness, 1.1 * steepness], 0.1)],
            ..white.clone()
        },
        // Two in one place, passing 0.9 of the light per unit distance.
        TransferFunction {
            opacity: vec![[0.0, 0.04]],
            regions: vec![region(Shape::Rectangle, everywhere, [0.0, 2.0 * steepness], 1.0 - 0.9 / 0.96)],
            ..white
        },
    ];
    // The middle of the volume, away from its faces, where voxels are repeated and the slope is zero.
    let (low, high) = geometry.world_box(extent);
    let [from, to] = [low.lerp(high, 0.4), low.lerp(high, 0.6)];
    let alpha = 1.0 - 0.9f64.powf(to.y - from.y);
    let expected = Picture::quantise([1.0, 0.5, 0.25].map(|c| (c * alpha) as f32));
    let camera = Camera {
        eye: (low + high) * 0.5 - DVec3::Y * 90.0,
        target: (low + high) * 0.5,
        up: DVec3::Z,
        projection: Projection::Orthographic { height: 0.35 * (to.z - from.z) },
    };
    let test = TestStore::pack(&source, 16);
    for (i, transfer) in functions.into_iter().enumerate() {
        for (method, filter, gradient, step, level) in [
            (Method::Udvr, Filter::Trilinear, Gradient::Central, 0.3, 0),
            (Method::Udvr, Filter::Tricubic, Gradient::Sobel, 1.0, 1),
            (Method::Lvs, Filter::Trilinear, Gradient::Central, 1.0, 0),
            (Method::Cvs, Filter::Trilinear, Gradient::Sobel, 0.7, 1),
            (Method::Asm, Filter::Trilinear, Gradient::Central, 2.0, 0),
            (Method::Udvr, Filter::Trilinear, Gradient::Stored, 1.0, 0),
            (Method::Lvs, Filter::Trilinear, Gradient::Stored, 0.6, 1),
        ] {
            let scene = Scene {
                camera: Some(camera),
                sampling: Sampling { method, filter, ..Sampling::default() },
                lighting: Lighting { gradient, ..Lighting::default() },
                step,
                level: LevelPolicy::Locked(level),
                clip: Some([from, to]),
                ..Scene::of(transfer.clone())
            };
            for way in WAYS {
                let Some(mut session) = session(&test.store, way) else { continue };
                let (picture, _) = settled(&mut session, &scene, SIZE);
                for pixel in &picture.rgb {
                    let off = (0..3).map(|k| pixel[k].abs_diff(expected[k])).max();
                    let what = format!("function {i} {method:?} {filter:?} {step} level {level} {way:?}");
                    assert!(off <= Some(1), "{what}: {pixel:?}, expected {expected:?}");
                }
            }
        }
    }
}

/// A ball with a rim, in flat surroundings: by value alone its inside would hide the rim's far half.
fn ball() -> TestStore {
    let extent = Extent::new(60, 56, 64);
    let centre = DVec3::new(30.0, 27.0, 33.0);
    let value = move |v: [u32; 3]| {
        let distance = (DVec3::from_array(v.map(f64::from)) - centre).length();
        u8::from_f64_rounded((120.0 - 20.0 * (distance - 18.0)).clamp(30.0, 210.0))
    };
    TestStore::pack(&FunctionSource::new(extent, Geometry::default(), move |_, _, v| value(v)), 16)
}

fn scene_of(transfer: TransferFunction) -> Scene {
    let camera = Camera::looking_at_box(Geometry::default().world_box(Extent::new(60, 56, 64))).orbited(25.0);
    Scene { camera: Some(camera), level: LevelPolicy::Locked(0), ..Scene::of(transfer) }
}

/// Functions visible only on steep parts: by a factor, and by regions of every shape.
fn steep() -> Vec<TransferFunction> {
    let flat =
        TransferFunction { color: vec![[30.0, 0.1, 0.4, 1.0], [210.0, 1.0, 0.6, 0.2]], ..TransferFunction::default() };
    let by_region =
        |shape| TransferFunction { regions: vec![region(shape, [60.0, 190.0], [6.0, 26.0], 0.4)], ..flat.clone() };
    vec![
        TransferFunction {
            opacity: vec![[30.0, 0.3]],
            gradient_opacity: vec![[4.0, 0.0], [16.0, 1.0]],
            ..flat.clone()
        },
        by_region(Shape::Rectangle),
        by_region(Shape::Gaussian),
        by_region(Shape::Triangle),
    ]
}

#[test]
fn a_rim_is_shown_and_what_is_flat_is_skipped_or_not_alike() {
    let test = ball();
    for (i, transfer) in steep().into_iter().enumerate() {
        // A rectangle ends abruptly, where a rounded gradient decides; smooth ones equal the oracle's to the last code.
        let is_smooth = i == 0 || i == 2;
        for lighting in [Lighting::default(), Lighting { model: LightingModel::BlinnPhong, ..Lighting::default() }] {
            let scene = Scene { lighting, ..scene_of(transfer.clone()) };
            let expected = oracle(&test.store, &scene, SIZE);
            for way in WAYS {
                let Some(mut session) = session(&test.store, way) else { continue };
                let (picture, _) = settled(&mut session, &scene, SIZE);
                let what = format!("function {i} {way:?}");
                let difference = picture.difference(&expected);
                if is_smooth {
                    assert_same(&picture, &expected, &what);
                } else {
                    assert!(difference.psnr_db > 40.0, "{what}: {difference:?}");
                }
                let Some(mut session) = session_without_skipping(&test.store, way) else { continue };
                let (found, _) = settled(&mut session, &scene, SIZE);
                assert!(found.difference(&picture).max <= 1, "{what}: skipping shows");
                // The corner looks past the ball, through coloured flat voxels.
                assert_eq!(picture.pixel(0, 0), [0; 3], "{what}");
                assert_ne!(picture.pixel(SIZE.0 / 2, SIZE.1 / 2), [0; 3], "{what}");
            }
        }
    }
}

/// In a session of live scenes, with projections, only fog depends on gradients.
#[test]
fn other_modes_take_the_colours_alone() {
    use brickyard::volume::Mode;
    let test = ball();
    let by_gradient = steep().swap_remove(0);
    let by_value = TransferFunction { gradient_opacity: Vec::new(), ..by_gradient.clone() };
    for mode in [Mode::Mip, Mode::Average] {
        let [steep, plain] = [by_gradient.clone(), by_value.clone()].map(|t| Scene { mode, ..scene_of(t) });
        for way in WAYS {
            let Some(mut session) = session(&test.store, way) else {
                continue;
            };
            let [found, expected] = [&steep, &plain].map(|scene| settled(&mut session, scene, SIZE).0);
            assert!(found == expected, "{mode:?} {way:?}");
        }
    }
}

/// Codes over a channel stretched by one voxel are too coarse for its gradients, whatever the window: functions of the gradient, and light under a
/// function of equal values, give the same picture as without that voxel.
#[test]
fn gradients_beside_an_outlier_are_those_without_it() {
    let ramp = |has_outlier: bool| {
        let value = move |_, _, v: [u32; 3]| match v {
            [31, 31, 31] if has_outlier => 1e9,
            [x, ..] => 0.01 * x as f32,
        };
        TestStore::pack(&FunctionSource::new(Extent::new(32, 32, 32), Geometry::default(), value), 16)
    };
    let [plain, wild] = [false, true].map(ramp);
    let even = TransferFunction {
        color: vec![[0.0, 1.0, 1.0, 1.0]],
        opacity: vec![[0.0, 0.1]],
        unit_distance: 1.0,
        ..TransferFunction::default()
    };
    let steep = TransferFunction { gradient_opacity: vec![[0.0, 0.0], [0.0099, 0.0], [0.00991, 1.0]], ..even.clone() };
    let target = DVec3::splat(15.5);
    let projection = Projection::Orthographic { height: 32.0 };
    let camera = Camera { eye: target + DVec3::new(30.0, 2.0, 80.0), target, up: DVec3::Y, projection };
    for way in WAYS {
        let (Some(mut of_plain), Some(mut of_wild)) = (session(&plain.store, way), session(&wild.store, way)) else {
            continue;
        };
        for gradient in Gradient::ALL {
            for (transfer, model) in [(&steep, LightingModel::None), (&even, LightingModel::Phong)] {
                let lamp = DVec3::new(900.0, 500.0, 700.0);
                let lights = if model == LightingModel::None { Vec::new() } else { vec![lamp] };
                let lighting = Lighting { model, gradient, lights };
                let scene = Scene { camera: Some(camera), lighting, ..Scene::of(transfer.clone()) };
                let [expected, found] =
                    [&mut of_plain, &mut of_wild].map(|session| settled(session, &scene, (16, 16)).0);
                let middle = expected.rgb[8 * 16 + 8];
                assert!(middle[0] > 100, "{way:?}, {gradient:?}, {model:?}: {middle:?}");
                let off = expected.rgb.iter().zip(&found.rgb).filter(|(a, b)| a[0].abs_diff(b[0]) > 2).count();
                // Of 256, those that look through the one voxel and its neighbours.
                assert!(off <= 12, "{way:?}, {gradient:?}, {model:?}: {off} pixels");
            }
        }
    }
}

/// A function of the gradient shows slopes of less than a 65,535th of the channel's values per voxel.
#[test]
fn gradients_slighter_than_codes_are_seen() {
    let ramp = |_, _, [x, _, z]: [u32; 3]| if z < 4 { 1000.0 } else { 0.01 * x as f32 };
    let test = TestStore::pack(&FunctionSource::new(Extent::new(32, 32, 32), Geometry::default(), ramp), 16);
    let steep = TransferFunction {
        color: vec![[0.0, 1.0, 1.0, 1.0]],
        opacity: vec![[0.0, 0.1]],
        gradient_opacity: vec![[0.0, 0.0], [0.008, 0.0], [0.009, 1.0]],
        unit_distance: 1.0,
        ..TransferFunction::default()
    };
    let target = DVec3::splat(15.5);
    let projection = Projection::Orthographic { height: 32.0 };
    let camera = Camera { eye: target + DVec3::new(30.0, 2.0, 80.0), target, up: DVec3::Y, projection };
    for gradient in Gradient::ALL {
        let lighting = Lighting { gradient, ..Lighting::default() };
        let scene = Scene { camera: Some(camera), lighting, ..Scene::of(steep.clone()) };
        let expected = oracle(&test.store, &scene, (16, 16));
        assert!(expected.rgb[8 * 16 + 8][0] > 100);
        for way in WAYS {
            let Some(mut session) = session(&test.store, way) else { continue };
            let most = settled(&mut session, &scene, (16, 16)).0.difference(&expected).max;
            // The slab's own gradients are some 50,000 times as steep.
            assert!(most <= 2, "{way:?}, {gradient:?}: {most}");
        }
    }
}

/// A gradient just across the view has two equally near sides: all renderers light the same one. Off the axes, rounding picks either.
#[test]
fn gradients_across_the_view_are_lit_alike() {
    let ramp = |_, _, [x, y, z]: [u32; 3]| (10 + x + 2 * y + 3 * z) as u8;
    let test = TestStore::pack(&FunctionSource::new(Extent::new(32, 32, 32), Geometry::default(), ramp), 16);
    let even = TransferFunction {
        color: vec![[0.0, 1.0, 1.0, 1.0]],
        opacity: vec![[0.0, 0.1]],
        unit_distance: 1.0,
        ..TransferFunction::default()
    };
    let target = DVec3::splat(15.5);
    let projection = Projection::Orthographic { height: 32.0 };
    let camera = Camera { eye: target + 50.0 * DVec3::new(1.0, 1.0, -1.0), target, up: DVec3::Y, projection };
    for lamp in [1.0, -1.0].map(|side| target + 900.0 * DVec3::new(side, 2.0 * side, 3.0 * side - 0.1)) {
        for model in [LightingModel::Phong, LightingModel::BlinnPhong, LightingModel::Tone] {
            let lighting = Lighting { model, lights: vec![lamp], ..Lighting::default() };
            let scene = Scene { camera: Some(camera), lighting, ..Scene::of(even.clone()) };
            let expected = oracle(&test.store, &scene, (16, 16));
            for way in WAYS {
                let Some(mut session) = session(&test.store, way) else { continue };
                let (found, _) = settled(&mut session, &scene, (16, 16));
                let most = found.difference(&expected).max;
                assert!(most <= 1, "{way:?}, {model:?}, {lamp}: {most}");
            }
        }
    }
}

/// Kept slots of a narrower window are lit like those of the look alone: a slope too slight for codes is flat in both.
#[test]
fn slots_that_are_kept_are_lit_like_fresh_ones() {
    let ramp = |_, _, [x, _, z]: [u32; 3]| if z < 4 { 1.0 } else { 5e-8 * x as f32 };
    let test = TestStore::pack(&FunctionSource::new(Extent::new(32, 32, 32), Geometry::default(), ramp), 16);
    let target = DVec3::splat(15.5);
    let projection = Projection::Orthographic { height: 32.0 };
    let camera = Camera { eye: target + DVec3::new(30.0, 2.0, 80.0), target, up: DVec3::Y, projection };
    let scene = |window: f64, gradient| {
        let transfer = TransferFunction {
            color: vec![[0.0, 1.0, 1.0, 1.0], [window, 0.0, 0.0, 1.0]],
            opacity: vec![[0.0, 0.1]],
            unit_distance: 1.0,
            ..TransferFunction::default()
        };
        let lighting = Lighting { model: LightingModel::Phong, gradient, ..Lighting::default() };
        Scene { camera: Some(camera), lighting, ..Scene::of(transfer) }
    };
    for (way, gradient) in WAYS.into_iter().flat_map(|way| [Gradient::Central, Gradient::Sobel].map(|g| (way, g))) {
        let Some(mut session) = session(&test.store, way) else { continue };
        let [narrow, wide] = [0.001, 0.01].map(|window| scene(window, gradient));
        let (found, _) = settled(&mut session, &narrow, (16, 16));
        assert!(found.difference(&oracle(&test.store, &narrow, (16, 16))).max <= 1, "{way:?}, {gradient:?}: narrow");
        let (found, _) = settled(&mut session, &wide, (16, 16));
        let most = found.difference(&oracle(&test.store, &wide, (16, 16))).max;
        assert!(most <= 1, "{way:?}, {gradient:?}: {most}");
    }
}
