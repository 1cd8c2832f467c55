//! Surfaces: translucent and opaque, in several kinds of fog and alone, in their places and nowhere else.

use crate::list::finest;
use crate::scenery::{
    SMALL, float_slots, is_hole, lightings, look, overview, parallel, range, steep, tinted, u8_codes, uneven, vivid,
    waves, wide_codes, wild,
};
use crate::shot::{Shot, pixels_off};
use crate::stage::{CPU, MOST, RAYCAST, Stage};
use crate::volume::Volume;
use brickyard::volume::*;
use glam::DVec3;

/// A faint surface, an invisible one, and one that hides everything behind it.
fn surfaces(encoding: &SlotEncoding) -> Vec<Surface> {
    let at = |code: f64| encoding.low + code / 255.0 * (encoding.high - encoding.low);
    let faint = Isosurface { value: at(105.0), color: Some([0.2, 1.0, 0.4]), opacity: 0.3 };
    let half = Isosurface { value: at(150.5), color: None, opacity: 0.5 };
    let solid = Isosurface { value: at(205.0), color: Some([1.0, 0.9, 0.2]), opacity: 1.0 };
    Surface::all(&[solid, faint, half], &tinted(range(encoding)), encoding)
}

/// Mode, whether opacities depend on gradients, method and lighting.
type Look = (Mode, bool, Method, usize);

/// Looks for all renderers.
const LOOKS: [Look; 11] = [
    (Mode::Isosurface, false, Method::Udvr, 0),
    (Mode::Isosurface, true, Method::Udvr, 4),
    (Mode::Isosurface, false, Method::Udvr, 5),
    (Mode::Dvr, false, Method::Udvr, 0),
    (Mode::Dvr, false, Method::Udvr, 5),
    (Mode::Dvr, false, Method::Plvs, 1),
    (Mode::Dvr, false, Method::Pcvs, 0),
    (Mode::Dvr, false, Method::Asm, 7),
    (Mode::Dvr, true, Method::Udvr, 0),
    (Mode::Dvr, true, Method::Udvr, 5),
    (Mode::Dvr, true, Method::Lvs, 1),
];

/// Further looks for the CPU.
const MORE_LOOKS: [Look; 5] = [
    (Mode::Dvr, false, Method::Udvr, 2),
    (Mode::Dvr, false, Method::Plvs, 3),
    (Mode::Dvr, false, Method::Pcvs, 1),
    (Mode::Dvr, false, Method::Asm, 5),
    (Mode::Dvr, true, Method::Cvs, 3),
];

/// In bricks of 16, and on the CPU in turn in those of other sizes too.
fn agree(encoding: SlotEncoding, filter: Filter, on_gpu: bool) {
    let (low, high) = range(&encoding);
    let value = |p: DVec3| match encoding.floats {
        _ if encoding.has_invalid && is_hole(p) => f64::NAN,
        Some(_) => wild(encoding)(p),
        None => low + (high - low) * waves(p),
    };
    let volumes = [16, 64, 8, 32].map(|edge| Volume::new(SMALL, edge, uneven(), encoding, value));
    let transfers = [tinted(range(&encoding)), steep(range(&encoding))];
    let frame = |&(mode, is_steep, method, lighting): &Look| {
        let plain =
            volumes[0].frame(overview(&volumes[0], filter), &transfers[is_steep as usize], Lattice::uniform(0.7, 0));
        let sampling = Sampling { method, filter, ..Sampling::default() };
        FrameSettings {
            mode,
            sampling,
            lighting: lightings()[lighting].clone(),
            surfaces: surfaces(&encoding),
            ..plain
        }
    };
    let needs = LOOKS.iter().map(|look| frame(look).needs());
    let mut stages = volumes.each_ref().map(|volume| Stage::with_room(&[volume], needs.clone()));
    let mut pictures = std::collections::BTreeSet::new();
    for (i, look) in LOOKS.iter().chain(&MORE_LOOKS).enumerate() {
        let frame = frame(look);
        let shot = |volume| Shot::new(&frame, finest(volume, &frame), &transfers[look.1 as usize]);
        let expected = shot(&volumes[0]).oracle(&[&volumes[0]]);
        let is_for_all = on_gpu && i < LOOKS.len();
        let is_whole = is_for_all && filter == Filter::Trilinear && !encoding.has_invalid;
        for (volume, ways) in [
            (0, if is_for_all { &MOST[..] } else { &[CPU] }),
            (1, if is_whole { &MOST[1..] } else { &[] }),
            (1 + i % 3, &[CPU]),
        ] {
            let what = format!("{look:?}, {filter:?} in {}", volumes[volume].pyramid.edge());
            // Rounding decides where a ray grazes a surface, or a place has just half of its weight.
            shot(&volumes[volume]).agree_with(&expected, &mut stages[volume], ways, 2, &what);
        }
        assert!(pictures.insert(expected.rgb), "{look:?} shows the same as another");
    }
}

#[test]
fn surfaces_in_fog_and_alone_match_the_oracle() {
    agree(u8_codes(), Filter::Trilinear, true);
}

#[test]
fn surfaces_match_the_oracle_with_splines() {
    agree(u8_codes(), Filter::Tricubic, true);
}

#[test]
fn surfaces_match_the_oracle_with_steps() {
    agree(u8_codes(), Filter::Nearest, true);
}

#[test]
fn surfaces_of_what_has_holes_match_the_oracle() {
    agree(wide_codes(), Filter::Nearest, false);
    agree(wide_codes(), Filter::Trilinear, true);
    agree(wide_codes(), Filter::Tricubic, false);
}

#[test]
fn surfaces_in_f32_slots_match_the_oracle() {
    agree(float_slots(), Filter::Nearest, false);
    agree(float_slots(), Filter::Trilinear, true);
    agree(float_slots(), Filter::Tricubic, false);
}

/// A ball, with only the bricks on its surface resident. Whatever the step, every ray longer inside than two steps hits it. (Between voxels
/// the ball is up to 0.02 thinner; half a chord of 1 is that deep.)
#[test]
fn surfaces_have_no_pinholes() {
    let (n, radius) = (64, 23.4);
    let centre = DVec3::splat(0.5 * n as f64 + 0.3);
    let encoding = SlotEncoding::new(VoxelType::U16, (0.0, 1.0), false);
    let value = |p: DVec3| 30000.0 - 500.0 * (p - centre).length();
    let volume = Volume::new([n; 3], 16, Geometry::default(), encoding, value);
    let isovalue = 30000.0 - 500.0 * radius;
    let transfer = vivid((0.0, 65535.0));
    let mut stage = Stage::exact(&[&volume]);
    for (step, tilt) in [(0.3, 0.1), (1.0, 0.0), (1.0, 0.3), (1.9, 0.2), (3.0, 0.1)] {
        // Voxel (i, j, k) has its centre there in the world, and half a voxel higher in voxel space.
        let target = centre - 0.5;
        let eye = target + DVec3::new(-90.0, 40.0 * tilt, 60.0 * tilt);
        let rays = parallel(eye, target, 60.0).rays(160, 160).expect("a camera");
        let surfaces = vec![Surface { threshold: isovalue, color: [1.0; 3], opacity: 1.0 }];
        let plain = volume.frame(rays, &transfer, Lattice::uniform(step, 0));
        let frame = FrameSettings { mode: Mode::Isosurface, surfaces, ..plain };
        let mut shot = Shot::new(&frame, finest(&volume, &frame), &transfer);
        let expected = shot.oracle(&[&volume]);
        let all = shot.lists[0].cells.len();
        shot.lists[0].cells.retain(|c| {
            let low = DVec3::from_array(c.cell.index.to_array().map(|i| 16.0 * i as f64)) - centre - 0.5;
            let high = low + 17.0;
            let nearest = low.max(-high).max(DVec3::ZERO).length();
            nearest < radius && low.abs().max(high.abs()).length() > radius
        });
        assert!(shot.lists[0].cells.len() < all);
        for way in [CPU, RAYCAST] {
            let Some(found) = shot.render(&mut stage, way) else { continue };
            let mut met = 0;
            for (x, y) in (0..160).flat_map(|y| (0..160).map(move |x| (x, y))) {
                let ray = frame.rays.ray(x as f64 + 0.5, y as f64 + 0.5);
                let to = target - ray.origin;
                let distance = (to - ray.direction * to.dot(ray.direction)).length();
                if radius.powi(2) - distance.powi(2) > step.powi(2) + 1.0 {
                    met += 1;
                    let background = Picture::quantise(frame.background);
                    assert_ne!(found.pixel(x, y), background, "{way:?}, step {step}: a hole at {x}, {y}");
                }
            }
            assert!(met > 8000, "{met}");
            let off = pixels_off(&found, &expected);
            // Steps longer than voxels reach so far out of a brick that gradients there are one-sided.
            assert!(off <= if step > 1.0 { 200 } else { 0 }, "{way:?}, step {step}, tilt {tilt}: {off} pixels");
        }
    }
}

/// Rays skip surface-free parts of a brick, and resume on the right side of the surface.
#[test]
fn surfaces_are_not_met_where_there_are_none() {
    let wave = |p: DVec3| {
        let p = p - 0.5;
        255.0 * (0.5 + 0.25 * (0.31 * p.x + 0.17 * p.y).sin() + 0.24 * (0.23 * p.y - 0.27 * p.z).cos())
    };
    let geometry = Geometry { spacing: DVec3::new(1.0, 1.2, 0.9), ..Geometry::default() };
    let volume = Volume::new([60, 49, 65], 16, geometry, u8_codes(), wave);
    let transfer = vivid((0.0, 255.0));
    let mut stage = Stage::exact(&[&volume]);
    for eye in [[132.6, -78.2, 168.4], [-90.0, 120.0, 90.0], [30.0, -150.0, -60.0]] {
        let rays = look(DVec3::from_array(eye), DVec3::new(29.5, 28.8, 28.8), 22.0).rays(120, 96).expect("a camera");
        for threshold in [186.0, 110.0] {
            let surfaces = vec![Surface { threshold, color: [1.0; 3], opacity: 1.0 }];
            let plain = volume.frame(rays, &transfer, Lattice::uniform(0.9, 0));
            let frame = FrameSettings { mode: Mode::Isosurface, surfaces, ..plain };
            let shot = Shot::new(&frame, finest(&volume, &frame), &transfer);
            // Rays that graze the surface.
            shot.agree(&mut stage, &[CPU, RAYCAST], 4, &format!("{threshold} from {eye:?}"));
        }
    }
}

/// Cells also search the segment before their own, partly in their apron: a ray inside only in that part hits nothing.
#[test]
fn cells_meet_no_surface_that_segments_pass_over() {
    let centre = DVec3::new(3.5, 5.0, 6.5);
    let ball = |p: DVec3| if (p - 0.5 - centre).length() < 2.8 { 255.0 } else { 0.0 };
    let volume = Volume::new([7, 10, 13], 8, Geometry::default(), u8_codes(), ball);
    let transfer = vivid((0.0, 255.0));
    let mut stage = Stage::exact(&[&volume]);
    let mut met = 0;
    for eye in [[-14.0, -16.0, 19.0], [22.0, -9.0, -12.0], [4.0, 30.0, 8.0], [-20.0, 8.0, 2.0]] {
        let rays = look(DVec3::from_array(eye), centre, 40.0).rays(120, 96).expect("a camera");
        let surfaces = vec![Surface { threshold: 229.5, color: [1.0; 3], opacity: 1.0 }];
        let plain = volume.frame(rays, &transfer, Lattice::uniform(1.0, 0));
        let frame = FrameSettings { mode: Mode::Isosurface, surfaces, ..plain };
        let shot = Shot::new(&frame, finest(&volume, &frame), &transfer);
        met +=
            shot.oracle(&[&volume]).rgb.iter().filter(|pixel| **pixel != Picture::quantise(frame.background)).count();
        shot.agree(&mut stage, &MOST, 0, &format!("from {eye:?}"));
    }
    assert!(met > 1000, "{met} pixels");
}

/// A slanted plane through bricks of 8; only bricks on it or half a voxel beside are resident. Its crossing may lie in a segment of an absent
/// cell: the cell into which the segment reaches takes it.
#[test]
fn long_steps_miss_no_plane() {
    let (n, edge) = (32, 8.0);
    let (centre, normal) = (DVec3::splat(0.5 * n as f64), DVec3::new(1.0, 0.13, 0.21));
    let encoding = SlotEncoding::new(VoxelType::U16, (0.0, 1.0), false);
    let height = |p: DVec3| (p - centre).dot(normal);
    let volume = Volume::new([n; 3], edge as u32, Geometry::default(), encoding, |p| 30000.0 + 500.0 * height(p));
    let transfer = vivid((0.0, 65535.0));
    let mut stage = Stage::exact(&[&volume]);
    let target = centre - 0.5;
    let rays = parallel(target - DVec3::new(60.0, 2.0, 3.0), target, 20.0).rays(60, 60).expect("a camera");
    let surfaces = vec![Surface { threshold: 30000.0, color: [1.0; 3], opacity: 1.0 }];
    for step in [1.7, 2.3, 3.1, 4.9] {
        let plain = volume.frame(rays, &transfer, Lattice::uniform(step, 0));
        let frame = FrameSettings { mode: Mode::Isosurface, surfaces: surfaces.clone(), ..plain };
        let mut shot = Shot::new(&frame, finest(&volume, &frame), &transfer);
        shot.lists[0].cells.retain(|c| {
            let low = DVec3::from_array(c.cell.index.to_array().map(|i| edge * i as f64)) - 0.5;
            height(low) < 0.0 && height(low + edge + 1.0) > 0.0
        });
        for way in MOST {
            let Some(found) = shot.render(&mut stage, way) else { continue };
            let missed = found.rgb.iter().filter(|&&p| p == Picture::quantise(frame.background)).count();
            assert_eq!(missed, 0, "{way:?}, step {step}");
        }
    }
}

/// Where all voxels equal the isovalue, rounding makes no speckles.
#[test]
fn a_plateau_at_the_isovalue_is_inside() {
    let value = |p: DVec3| if p.x < 17.0 { 60.0 } else { 90.0 };
    let volume = Volume::new([40; 3], 16, Geometry::default(), u8_codes(), value);
    let (transfer, mut stage) = (vivid((0.0, 255.0)), Stage::exact(&[&volume]));
    // From inside the plateau only its end is hit.
    for (target, is_met) in [([39.0, 21.0, 19.0], false), ([0.0, 21.0, 19.0], true)] {
        let rays = look(DVec3::new(30.0, 20.0, 20.0), target.into(), 45.0).rays(40, 33).expect("a camera");
        let surfaces = Surface::all(&[Isosurface::at(90.0)], &transfer, &volume.encoding);
        let plain = volume.frame(rays, &transfer, Lattice::uniform(0.7, 0));
        let frame = FrameSettings { mode: Mode::Isosurface, surfaces, ..plain };
        for way in MOST {
            let shot = Shot::new(&frame, finest(&volume, &frame), &transfer);
            let Some(picture) = shot.render(&mut stage, way) else { continue };
            let met = picture.rgb.iter().filter(|&&p| p != Picture::quantise(frame.background)).count();
            assert_eq!(met, if is_met { picture.rgb.len() } else { 0 }, "{way:?}");
        }
    }
}
