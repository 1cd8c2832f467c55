//! Renderers' reports on drawn cells: the light with which rays entered them.

use crate::list::finest;
use crate::scenery::{parallel, u8_codes};
use crate::shot::Shot;
use crate::stage::{ALL, CPU, SORTED, Stage};
use crate::volume::Volume;
use brickyard::volume::*;
use glam::DVec3;

/// Bricks of 16^3, five behind each other along z, two by two, and their codes: 0 is invisible, 100 halves the light in 16 voxels, 200
/// is opaque.
const EDGE: f64 = 16.0;
const HALF: f64 = 100.0;
const OPAQUE: f64 = 200.0;

fn column(codes: [f64; 5]) -> Volume {
    // Between different codes samples have codes in between: the step to the next brick's code is inside its own.
    let code = |p: DVec3| codes[((p.z / EDGE) as usize).min(4)];
    Volume::new([32, 32, 80], 16, Geometry::default(), u8_codes(), code)
}

/// Expects these reports from bricks entered in front of the first by rays `aside` from the middle.
fn check(codes: [f64; 5], mode: Mode, aside: f64, expected: Option<[f32; 5]>) {
    let volume = column(codes);
    let transfer = TransferFunction {
        color: vec![[0.0, 1.0, 1.0, 1.0]],
        opacity: vec![[0.0, 0.0], [99.0, 0.0], [100.0, 0.5], [199.0, 0.5], [200.0, 1.0]],
        unit_distance: EDGE,
        ..TransferFunction::default()
    };
    let eye = DVec3::new(15.5 + aside, 15.5, -20.0);
    let camera = Camera { up: DVec3::Y, ..parallel(eye, eye + DVec3::Z, 12.0) };
    let plain = volume.frame(camera.rays(20, 20).expect("a camera"), &transfer, Lattice::uniform(0.5, 0));
    let surfaces = match mode {
        Mode::Isosurface => vec![Surface { threshold: 150.0, color: [1.0; 3], opacity: 1.0 }],
        _ => Vec::new(),
    };
    let shot = FrameSettings { mode, surfaces, ..plain };
    let shot = Shot::new(&shot, finest(&volume, &shot), &transfer);
    let mut stage = Stage::exact(&[&volume]);
    for way in ALL {
        let Some(renderer) = stage.renderer(way, &shot.needs()) else { continue };
        assert_eq!(renderer.visibility(0), None, "{way:?}: nothing has been drawn yet");
        shot.render(&mut stage, way);
        let found = stage.renderer(way, &shot.needs()).and_then(|renderer| renderer.visibility(0));
        // Cells of `sorted` are independent of one another.
        let (Some(expected), Some(found)) = (expected.filter(|_| way != SORTED), found) else {
            assert!(found.is_none() && (expected.is_none() || way == SORTED), "{way:?} {mode:?}: {found:?}");
            continue;
        };
        assert_eq!(found.len(), 20);
        // On a GPU rounded up to a step of the scale; the table's error of a step, 32 times a brick.
        let step = if way == CPU { 0.0 } else { 1.0 / 255.0 };
        for (cell, &found) in shot.lists[0].cells.iter().zip(found) {
            let expected = expected[cell.cell.index.z as usize];
            let is_close = (-1e-4..step + 1e-4).contains(&(found - expected));
            assert!(is_close, "{way:?} {mode:?} {codes:?}: {:?} {found} {expected}", cell.cell);
        }
    }
}

#[test]
fn an_opaque_slab_hides_what_is_behind() {
    check([OPAQUE, OPAQUE, HALF, 0.0, OPAQUE], Mode::Dvr, 0.0, Some([1.0, 0.0, 0.0, 0.0, 0.0]));
    // Empty bricks report too, and an empty one in front hides nothing.
    check([0.0, OPAQUE, 0.0, OPAQUE, 0.0], Mode::Dvr, 0.0, Some([1.0, 1.0, 0.0, 0.0, 0.0]));
    check([0.0; 5], Mode::Dvr, 0.0, Some([1.0; 5]));
}

#[test]
fn a_half_transparent_slab_halves_the_light() {
    check([HALF, HALF, HALF, OPAQUE, 0.0], Mode::Dvr, 0.0, Some([1.0, 0.5, 0.25, 0.125, 0.0]));
}

#[test]
fn a_surface_hides_what_is_behind() {
    // The value passes 150 a quarter of a voxel inside the first brick of 200.
    check([0.0, 0.0, OPAQUE, 0.0, 0.0], Mode::Isosurface, 0.0, Some([1.0, 1.0, 1.0, 0.0, 0.0]));
    check([OPAQUE, OPAQUE, OPAQUE, OPAQUE, HALF], Mode::Isosurface, 0.0, Some([1.0; 5]));
}

#[test]
fn out_of_view_is_out_of_light_and_projections_report_nothing() {
    check([HALF; 5], Mode::Dvr, 100.0, Some([0.0; 5]));
    for mode in [Mode::Mip, Mode::MinIp, Mode::Average] {
        check([HALF; 5], mode, 0.0, None);
    }
}
