//! What the renderer reports about the cells that it has drawn: with how much light rays entered them.

#[allow(dead_code, reason = "the oracle is for pictures")]
mod bricks;

use bricks::Volume;
use brickyard_volume::*;
use glam::DVec3;

/// Bricks of 16^3, four of them one behind the other along z, and so many codes: 0 shows nothing, 100 lets half of the light
/// through in 16 voxels, 200 lets nothing through.
const EDGE: f64 = 16.0;
const HALF: f64 = 100.0;
const OPAQUE: f64 = 200.0;

/// What the cells report, from the first along z to the last, seen from in front of the first.
fn visibility(codes: [f64; 4], mode: Mode, aside: f64) -> Option<Vec<f32>> {
    let encoding = SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false);
    // Between codes that differ samples have codes in between: the step to the next brick's code is inside its own.
    let code = |p: DVec3| codes[((p.z / EDGE) as usize).min(3)];
    let volume = Volume::new(Extent::new(16, 16, 64), DVec3::ONE, 16, encoding, code);
    let transfer = TransferFunction {
        color: vec![[0.0, 1.0, 1.0, 1.0]],
        opacity: vec![[0.0, 0.0], [99.0, 0.0], [100.0, 0.5], [199.0, 0.5], [200.0, 1.0]],
        unit_distance: EDGE,
        ..TransferFunction::default()
    };
    let eye = DVec3::new(7.5 + aside, 7.5, -20.0);
    let projection = Projection::Orthographic { height: 8.0 };
    let camera = Camera { eye, target: eye + DVec3::Z, up: DVec3::Y, projection };
    let frame = FrameSettings {
        rays: camera.rays(20, 20).unwrap(),
        lattice: Lattice::uniform(0.5, 0),
        geometry: Geometry::default(),
        placement: Placement::default(),
        encoding,
        table: TransferTable::new(&transfer, &encoding).into(),
        mode,
        surfaces: match mode {
            Mode::Isosurface => vec![Surface { threshold: 150.0, color: [1.0; 3], opacity: 1.0 }],
            _ => Vec::new(),
        },
        sampling: Sampling::default(),
        lighting: Lighting::default(),
        background: [0.0; 3],
        clip: None,
        meshes: Vec::new(),
    };
    let cut = volume.cut(&frame.rays, &frame.geometry, &|_, _| true);
    let (mut renderer, list) = volume.load(&cut, &frame, 2);
    assert_eq!(renderer.visibility(0), None, "nothing has been drawn yet");
    volume.draw(&mut renderer, &frame, &list);
    let found = renderer.visibility(0)?;
    assert_eq!(found.len(), list.cells.len());
    let mut by_z: Vec<(u32, f32)> = list.cells.iter().zip(found).map(|(c, &v)| (c.region.min.z, v)).collect();
    by_z.sort_by_key(|&(z, _)| z);
    Some(by_z.into_iter().map(|(_, v)| v).collect())
}

#[test]
fn an_opaque_slab_hides_what_is_behind() {
    assert_eq!(visibility([OPAQUE, OPAQUE, HALF, 0.0], Mode::Dvr, 0.0).unwrap(), [1.0, 0.0, 0.0, 0.0]);
    // Also what is empty, and an empty one in front hides nothing.
    assert_eq!(visibility([0.0, OPAQUE, 0.0, OPAQUE], Mode::Dvr, 0.0).unwrap(), [1.0, 1.0, 0.0, 0.0]);
}

#[test]
fn a_half_transparent_slab_halves_the_light() {
    let found = visibility([HALF, HALF, HALF, OPAQUE], Mode::Dvr, 0.0).unwrap();
    for (found, expected) in found.iter().zip([1.0, 0.5, 0.25, 0.125]) {
        // The table's error of a step, 32 times a brick.
        assert!((found - expected).abs() < 1e-4, "{found} {expected}");
    }
}

#[test]
fn a_surface_hides_what_is_behind() {
    // The value passes 150 a quarter of a voxel inside of the first brick of 200.
    assert_eq!(visibility([0.0, 0.0, OPAQUE, 0.0], Mode::Isosurface, 0.0).unwrap(), [1.0, 1.0, 1.0, 0.0]);
    assert_eq!(visibility([OPAQUE, OPAQUE, OPAQUE, HALF], Mode::Isosurface, 0.0).unwrap(), [1.0; 4]);
}

#[test]
fn out_of_view_is_out_of_light_and_projections_report_nothing() {
    assert_eq!(visibility([HALF; 4], Mode::Dvr, 100.0).unwrap(), [0.0; 4]);
    for mode in [Mode::Mip, Mode::MinIp, Mode::Average] {
        assert_eq!(visibility([HALF; 4], mode, 0.0), None);
    }
}
