//! Fog with a result known without an oracle, or determined by the number of times each part of a ray is taken.

use crate::list::{OWN, finest, list};
use crate::scenery::{constant, look, u8_codes, vivid};
use crate::shot::{Shot, assert_close};
use crate::stage::{CPU, MOST, Stage};
use crate::volume::Volume;
use brickyard::volume::*;
use glam::DVec3;
use proptest::prelude::*;
use proptest::test_runner::TestRunner;
use std::cell::RefCell;

/// A cube of one code.
fn cube(n: u32, edge: u32, code: f64) -> Volume {
    Volume::new([n; 3], edge, Geometry::default(), u8_codes(), move |_| code)
}

/// A ray's stretch in a volume's box; reversed if it misses.
fn stretch(volume: &Volume, ray: &Ray) -> [f64; 2] {
    let (low, high) = volume.geometry.world_box(volume.pyramid.levels()[0].extent);
    let (a, b) = ((low - ray.origin) / ray.direction, (high - ray.origin) / ray.direction);
    [a.min(b).max_element().max(0.0), a.max(b).min_element()]
}

/// The picture of a coloured fog of constant medium.
fn beer_lambert(volume: &Volume, frame: &FrameSettings, transfer: &TransferFunction) -> Picture {
    let ([_, alpha], [_, r, g, b]) = (transfer.opacity[0], transfer.color[0]);
    let ViewRays { width, height, .. } = frame.rays;
    let pixel = |i: u32| {
        let [near, far] = stretch(volume, &frame.rays.ray((i % width) as f64 + 0.5, (i / width) as f64 + 0.5));
        let left = (1.0 - alpha).powf((far - near).max(0.0) / transfer.unit_distance);
        let color = [r, g, b].map(|c| c * (1.0 - left));
        Picture::quantise(std::array::from_fn(|k| color[k] as f32 + left as f32 * frame.background[k]))
    };
    Picture { width, height, rgb: (0..width * height).map(pixel).collect() }
}

#[test]
fn a_constant_medium_is_beer_lambert_whatever_steps_and_bricks() {
    // Thin, with alpha per step far below 1/255, and thick; 2,197 cells are more than one submission of `sorted`.
    let (large, small) = (&[0.31, 1.0, 2.7][..], &[0.23, 1.0, 3.7, 40.0, 1000.0][..]);
    for (n, edge, alpha, steps) in [
        (104, 32, 0.0025, large),
        (104, 8, 0.05, large),
        (104, 32, 0.9, large),
        (48, 8, 0.03, small),
        (48, 16, 0.03, small),
        (48, 48, 0.03, small),
    ] {
        let (volume, transfer) = (cube(n, edge, 100.0), constant(alpha, 1.0));
        let mut stage = Stage::exact(&[&volume]);
        let size = n as f64 / 104.0;
        for (eye, up) in [
            (DVec3::new(-150.0, -90.0, 130.0), DVec3::Z),
            (DVec3::new(31.0, 64.0, 40.0), DVec3::Z),
            (DVec3::new(52.0, 51.5, 500.0), DVec3::Y),
        ] {
            let camera = Camera { up, ..look(eye * size, DVec3::new(52.0, 51.5, 53.0) * size, 45.0) };
            for &step in steps {
                let frame = volume.frame(camera.rays(61, 61).expect("a camera"), &transfer, Lattice::uniform(step, 0));
                let expected = beer_lambert(&volume, &frame, &transfer);
                let shot = Shot::new(&frame, finest(&volume, &frame), &transfer);
                let what = format!("{n} in {edge}, alpha {alpha}, step {step}, eye {eye}");
                shot.agree_with(&expected, &mut stage, &MOST, 0, &what);
            }
        }
    }
}

#[test]
fn turning_the_camera_about_a_symmetric_volume_turns_the_picture() {
    let n = 40;
    let centre = DVec3::splat(n as f64 * 0.5);
    // Unchanged by a quarter turn about z, but different along x and the diagonals.
    let value = |p: DVec3| {
        let q = p - centre;
        let wave = (q.x * 0.5).cos() + (q.y * 0.5).cos() + 0.2 * (q.x * q.x * q.y * q.y * 0.001).sin();
        60.0 * (wave + 2.1 + 0.02 * q.z)
    };
    let volume = Volume::new([n; 3], 16, Geometry::default(), u8_codes(), value);
    let mut stage = Stage::exact(&[&volume]);
    let (transfer, target) = (vivid((0.0, 255.0)), centre - 0.5);
    let camera = |eye: DVec3, up| Camera { up, ..look(target + eye, target, 45.0) };
    for way in MOST {
        let mut render = |x, y, z, up| {
            let rays = camera(DVec3::new(x, y, z), up).rays(48, 48).expect("a camera");
            let frame = volume.frame(rays, &transfer, Lattice::uniform(0.7, 0));
            Shot::new(&frame, finest(&volume, &frame), &transfer).render(&mut stage, way)
        };
        let Some(front) = render(61.0, 13.0, 22.0, DVec3::Z) else { continue };
        let mut other = |x, y, z, up| render(x, y, z, up).expect("an adapter");
        assert_close(&front, &other(-13.0, 61.0, 22.0, DVec3::Z), 0, &format!("orbit, {way:?}"));
        assert!(front.difference(&other(13.0, 61.0, 22.0, DVec3::Z)).max > 20, "the view must matter");
        // From above, a camera rolled by a quarter turn sees the same picture, which turns with the volume; from aside, the
        // picture turns.
        let [upright, rolled] = [DVec3::Y, DVec3::X].map(|up| other(5.0, 3.0, 70.0, up));
        let [a, b] =
            [DVec3::Y, DVec3::X].map(|up| camera(DVec3::new(5.0, 3.0, 70.0), up).rays(48, 48).expect("a camera"));
        assert!(a.right.dot(b.up) > 0.99 * a.right.length_squared(), "up is where right was");
        let turned = (0..48).flat_map(|y| (0..48).map(move |x| (x, y))).map(|(x, y)| rolled.pixel(y, 47 - x));
        let turned = Picture { rgb: turned.collect(), ..rolled.clone() };
        // The two cameras' up axes are not quite a quarter turn apart (0.2 degrees): compare on average.
        assert!(upright.difference(&turned).psnr_db > 35.0, "{way:?}: {:?}", upright.difference(&turned));
        assert!(upright.difference(&rolled).psnr_db < 25.0, "the roll must matter: {:?}", upright.difference(&rolled));
    }
}

/// Whether a pixel's ray runs along an edge of the volume, where rounding alone decides on a hit.
fn grazes(frame: &FrameSettings, volume: &Volume, x: u32, y: u32) -> bool {
    let [near, far] = stretch(volume, &frame.rays.ray(x as f64 + 0.5, y as f64 + 0.5));
    (far - near).abs() < 1e-9
}

/// A medium with equal weight for all samples: any gap or double changes the colour.
#[test]
fn cells_partition_every_ray() {
    let volume = Volume::new([24, 17, 31], 8, Geometry::default(), u8_codes(), |_| 128.0);
    let grey = vec![[0.0; 4], [255.0, 1.0, 1.0, 1.0]];
    let transfer = TransferFunction { color: grey, ..constant(0.02, 1.0) };
    let stage = RefCell::new(Stage::exact(&[&volume]));
    let inputs = (
        prop::array::uniform3(-40i32..80),
        prop::array::uniform3(0i32..40),
        0.1f64..9.0,
        any::<bool>(),
        prop::sample::select(vec![0.01, 1.0, 4.0]),
        0u32..1000,
    );
    let mut runner =
        TestRunner::new(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() });
    let outcome = runner.run(&inputs, |(eye, toward, step, orthographic, pixel_error, seed)| {
        // Whole and half coordinates put rays along faces, edges and corners.
        let at = |v: [i32; 3]| DVec3::from_array(v.map(|c| c as f64 * 0.5));
        let mut camera = look(at(eye), at(toward), 45.0);
        if orthographic {
            camera.projection = Projection::Orthographic { height: 16.0 };
            camera.up = DVec3::X;
        }
        let Ok(rays) = camera.rays(16, 16) else { return Err(TestCaseError::reject("no direction")) };
        let hash = |id: BrickId| id.index.x * 7 + id.index.y * 13 + id.index.z * 29 + id.level.0 as u32 * 31 + seed;
        for mode in [Mode::Dvr, Mode::Average] {
            let lattice = Lattice::for_view(step, 1.0, &rays, pixel_error, volume.levels.len());
            let frame = FrameSettings { mode, ..volume.frame(rays, &transfer, lattice) };
            let list = list(&volume, &frame, &|id| hash(id).is_multiple_of(5), &|_| vec![OWN]);
            let shot = Shot::new(&frame, list, &transfer);
            let mut found = shot.render(&mut stage.borrow_mut(), CPU).expect("a processor");
            let expected = shot.oracle(&[&volume]);
            for (x, y) in (0..16).flat_map(|y| (0..16).map(move |x| (x, y))) {
                if grazes(&frame, &volume, x, y) {
                    found.rgb[(y * 16 + x) as usize] = expected.pixel(x, y);
                }
            }
            prop_assert!(found.difference(&expected).max <= 1, "{mode:?}: {:?}", found.difference(&expected));
        }
        Ok(())
    });
    outcome.unwrap_or_else(|error| panic!("{error}"));
}
