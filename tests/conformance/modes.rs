//! Every mode from all sides, by codes of every kind.

use crate::list::finest;
use crate::scenery::{float_slots, parallel, scaled, tinted, u8_codes, uneven, views, vivid, waves, wavy, wild};
use crate::shot::{Shot, assert_close};
use crate::stage::{ALL, CPU, MOST, Stage, Way};
use crate::volume::Volume;
use brickyard::volume::*;
use glam::DVec3;

const U8: (f64, f64) = (0.0, 255.0);

/// Rounding decides whether a ray that grazes a surface hits it: this many pixels may be off.
fn grazing(mode: Mode, rays: &ViewRays) -> usize {
    if mode == Mode::Isosurface { (2 * rays.width * rays.height / 1000) as usize } else { 0 }
}

/// These modes from these views, with all bricks resident.
fn agree(
    stage: &mut Stage<'_>,
    ways: &[Way],
    views: &[(&'static str, ViewRays)],
    modes: &[Mode],
    transfer: &TransferFunction,
    lattice: &dyn Fn(&ViewRays) -> Lattice,
) {
    let volume = stage.volumes[0];
    for (name, rays) in views {
        for &mode in modes {
            let frame = volume.frame_in(mode, *rays, transfer, lattice(rays));
            let shot = Shot::new(&frame, finest(volume, &frame), transfer);
            shot.agree(stage, ways, grazing(mode, rays), &format!("{name}, {mode:?}"));
        }
    }
}

fn short(_: &ViewRays) -> Lattice {
    Lattice::uniform(0.7, 0)
}

#[test]
fn every_mode_and_view_matches_the_oracle() {
    let volume = wavy([45, 37, 52], 16);
    let views = views(&volume);
    let mut stage = Stage::exact(&[&volume]);
    agree(&mut stage, &ALL, &views[..2], &Mode::ALL, &vivid(U8), &short);
    agree(&mut stage, &MOST, &views[2..], &Mode::ALL, &vivid(U8), &short);
}

#[test]
fn steps_that_grow_with_distance_match_the_oracle() {
    let volume = wavy([45, 37, 52], 16);
    let growing = |rays: &ViewRays| Lattice::for_view(0.4, 0.8, rays, 0.5, 5);
    let mut stage = Stage::exact(&[&volume]);
    agree(&mut stage, &MOST, &views(&volume), &[Mode::Dvr, Mode::Isosurface], &vivid(U8), &growing);
}

/// A volume may use 3,000 of 65,536 codes: then table look-ups must resolve fractions of a code.
#[test]
fn sixteen_bits_and_floats_match_the_oracle() {
    let wide = SlotEncoding::new(VoxelType::I16, (0.0, 0.0), false);
    let volume = Volume::new([40, 40, 40], 32, uneven(), wide, |p| 3000.0 * waves(p) - 1000.0);
    let (transfer, all) = (vivid((-1000.0, 2000.0)), views(&volume));
    let mut stage = Stage::exact(&[&volume]);
    agree(&mut stage, &MOST, &all, &[Mode::Dvr, Mode::Mip, Mode::Isosurface], &transfer, &short);
    agree(&mut stage, &[CPU], &all[..1], &[Mode::MinIp, Mode::Average], &transfer, &short);
    let float = SlotEncoding::new(VoxelType::F32, (0.0, 1e-3), false);
    let volume = Volume::new([40, 40, 40], 32, uneven(), float, |p| 1e-3 * waves(p));
    let mut stage = Stage::exact(&[&volume]);
    let modes = [Mode::Dvr, Mode::Average, Mode::Isosurface];
    agree(&mut stage, &MOST, &all, &modes, &vivid((0.0, 1e-3)), &short);
}

/// Values past both ends of the table, with outliers, and integers without an f32.
#[test]
fn f32_slots_match_the_oracle() {
    let floats = SlotEncoding { has_invalid: false, ..float_slots() };
    let volume = Volume::new([40, 40, 40], 16, uneven(), floats, wild(floats));
    let (transfer, all) = (vivid((floats.low, floats.high)), views(&volume));
    let mut stage = Stage::exact(&[&volume]);
    agree(&mut stage, &ALL, &all[..2], &Mode::ALL, &transfer, &short);
    agree(&mut stage, &MOST, &all[2..], &Mode::ALL, &transfer, &short);
    for (voxel_type, low) in [(VoxelType::U32, 4294967000.0), (VoxelType::I32, -2147483648.0)] {
        let whole = SlotEncoding::new(voxel_type, voxel_type.limits(), false);
        let encoding = whole.for_window(Some(Window::of([low, low + 290.0])), KeptSlots::default());
        let volume = Volume::new([40, 40, 40], 32, uneven(), encoding, |p| (low + 290.0 * waves(p)).round());
        let mut stage = Stage::exact(&[&volume]);
        let transfer = tinted((low, low + 290.0));
        agree(&mut stage, &MOST, &all[..1], &[Mode::Dvr, Mode::Average, Mode::Isosurface], &transfer, &short);
    }
}

#[test]
fn invalid_voxels_match_the_oracle() {
    let encoding = SlotEncoding::new(VoxelType::F32, (0.0, 10.0), true);
    let holes = |p: DVec3| {
        let [x, y, z] = p.as_uvec3().to_array();
        let is_hole = (p - DVec3::new(20.0, 15.0, 25.0)).length() < 11.0 || (x * 7 + y * 13 + z * 5).is_multiple_of(31);
        if is_hole { f64::NAN } else { 10.0 * waves(p) }
    };
    let volume = Volume::new([45, 37, 52], 16, uneven(), encoding, holes);
    // A sample with exactly half its weight in valid corners falls to either side by rounding: rays along an axis through voxel faces meet
    // whole lines of such samples. Those views are left out.
    let mut views = views(&volume);
    views.retain(|(name, _)| !["axis", "grazing", "edges"].iter().any(|along| name.contains(along)));
    agree(&mut Stage::exact(&[&volume]), &MOST, &views, &Mode::ALL, &tinted((0.0, 10.0)), &short);
    let nothing = Volume::new([9, 9, 9], 16, uneven(), encoding, |_| f64::NAN);
    let (mut stage, transfer) = (Stage::exact(&[&nothing]), tinted((0.0, 10.0)));
    for mode in Mode::ALL {
        let frame = nothing.frame_in(mode, views[0].1, &transfer, Lattice::uniform(0.7, 0));
        let shot = Shot::new(&frame, finest(&nothing, &frame), &transfer);
        for picture in MOST.iter().filter_map(|&way| shot.render(&mut stage, way)) {
            assert!(picture.rgb.iter().all(|&p| p == Picture::quantise(frame.background)), "{mode:?}");
        }
    }
}

/// Pixels are one voxel wide, and an even number of them is centred on a brick boundary, then half a pixel off it: rays between bricks, along
/// voxel centres, and along voxel faces.
#[test]
fn orthographic_rays_along_an_axis_have_zero_components() {
    let volume = Volume::new([40, 33, 35], 16, Geometry::default(), u8_codes(), scaled(u8_codes(), waves));
    let mut views = Vec::new();
    for target in [0.0, 0.25, 0.5].map(|shift| DVec3::splat(15.5 + shift)) {
        for (axis, up) in [(DVec3::X, DVec3::Z), (DVec3::Y, DVec3::X), (DVec3::Z, DVec3::Y), (-DVec3::X, DVec3::Y)] {
            let camera = Camera { up, ..parallel(target - axis * 60.0, target, 40.0) };
            views.push(("along an axis", camera.rays(40, 40).expect("a camera")));
        }
    }
    agree(&mut Stage::exact(&[&volume]), &[CPU], &views, &Mode::ALL, &vivid(U8), &short);
}

#[test]
fn anisotropic_odd_volumes_match_the_oracle() {
    let geometry =
        Geometry { spacing: DVec3::new(0.5, 0.7, 2.1), origin: DVec3::new(-3.0, 100.0, 7.0), ..Geometry::default() };
    for depth in [13, 1] {
        let extent = [51, 37, depth];
        let volume = Volume::new(extent, 8, geometry.clone(), u8_codes(), scaled(u8_codes(), waves));
        let camera = Camera::looking_at_box(geometry.world_box(Extent::from_array([51, 37, 13])));
        let views = [("from outside", camera.rays(40, 33).expect("a camera"))];
        agree(&mut Stage::exact(&[&volume]), &MOST, &views, &Mode::ALL, &vivid(U8), &|_| Lattice::uniform(0.35, 0));
    }
}

#[test]
fn the_brick_size_does_not_show() {
    let volumes = [64, 8, 16, 32].map(|edge| wavy([61, 64, 57], edge));
    let mut stages = volumes.each_ref().map(|volume| Stage::exact(&[volume]));
    let transfer = vivid(U8);
    for (name, rays) in views(&volumes[0]) {
        for mode in Mode::ALL {
            for way in MOST {
                let mut whole = None;
                for stage in &mut stages {
                    let volume = stage.volumes[0];
                    let frame = volume.frame_in(mode, rays, &transfer, Lattice::uniform(0.5, 0));
                    let shot = Shot::new(&frame, finest(volume, &frame), &transfer);
                    let Some(found) = shot.render(stage, way) else { continue };
                    let whole = whole.get_or_insert_with(|| found.clone());
                    let what = format!("bricks of {}, {name}, {mode:?}, {way:?}", volume.pyramid.edge());
                    assert_close(&found, whole, grazing(mode, &rays), &what);
                    // Positions are rounded relative to other bricks, to 2^-18 of a voxel: rarely to one step of the picture.
                    let noise = found.difference(whole).psnr_db;
                    assert!(mode == Mode::Isosurface || noise > 60.0, "{what}: {noise} dB");
                }
            }
        }
    }
}
