//! The light of cut faces: just behind a clip plane or a side of the clip box the cut's normal lights, not the gradient of what it lays open.

use crate::list::finest;
use crate::scenery::{SMALL, lightings, noise, overview, parallel, tinted, u8_codes, uneven};
use crate::shot::Shot;
use crate::stage::{ALL, MOST, Stage};
use crate::volume::Volume;
use brickyard::volume::*;
use glam::DVec3;

fn noisy() -> Volume {
    Volume::new(SMALL, 16, uneven(), u8_codes(), |p| (40.0 + 170.0 * noise(p)).round())
}

/// A place of a volume in the world, in shares of its box.
fn at(volume: &Volume, share: DVec3) -> DVec3 {
    let (low, high) = volume.geometry.world_box(volume.pyramid.levels()[0].extent);
    low + (high - low) * share
}

fn cut(volume: &Volume, share: f64, normal: DVec3) -> ClipPlane {
    ClipPlane { point: at(volume, DVec3::splat(share)), normal }
}

/// Opaque noise of one colour, cut askew: every pixel has the colour of a plane, whatever the noise is.
#[test]
fn a_cut_through_opaque_noise_is_lit_as_a_plane() {
    let volume = noisy();
    let transfer = TransferFunction {
        color: vec![[0.0, 0.8, 0.6, 0.3]],
        opacity: vec![[0.0, 1.0]],
        ..TransferFunction::default()
    };
    let normal = DVec3::new(0.5, -0.3, -0.8).normalize();
    let centre = at(&volume, DVec3::splat(0.5));
    let camera = parallel(centre - DVec3::new(0.1, 0.2, -0.97) * 90.0, centre, 12.0);
    let rays = camera.rays(16, 12).expect("a view");
    let mut stage = Stage::exact(&[&volume]);
    for (number, lighting) in lightings().into_iter().enumerate().filter(|(_, l)| l.model != LightingModel::None) {
        for (face, clip) in [
            (normal, Clip::new(None, &[cut(&volume, 0.5, normal), cut(&volume, 0.9, normal)])),
            (DVec3::NEG_Z, Clip::new(Some([at(&volume, DVec3::ZERO), at(&volume, DVec3::new(1.0, 1.0, 0.6))]), &[])),
        ] {
            let frame = FrameSettings {
                lighting: lighting.clone(),
                clip: Some(clip.expect("a cut")),
                ..volume.frame(rays, &transfer, Lattice::uniform(0.4, 0))
            };
            let shot = Shot::new(&frame, finest(&volume, &frame), &transfer);
            let color = |x: u32, y: u32| {
                let ray = rays.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
                // The place is where the first sample is, at most 0.2 behind the cut: no lamp is so near that it matters.
                let point =
                    if face == normal { at(&volume, DVec3::splat(0.5)) } else { at(&volume, DVec3::splat(0.6)) };
                let place =
                    ray.origin + ray.direction * ((point - ray.origin).dot(face) / ray.direction.dot(face) + 0.1);
                let lit = lighting.shade(DVec3::new(0.8, 0.6, 0.3), Some(face), ray.direction, place);
                Picture::quantise(lit.to_array().map(|c| c as f32))
            };
            let rgb = (0..12).flat_map(|y| (0..16).map(move |x| (x, y))).map(|(x, y)| color(x, y)).collect();
            let expected = Picture { width: 16, height: 12, rgb };
            shot.agree_with(&expected, &mut stage, &ALL, 0, &format!("lighting {number}, {face}"));
            assert!(shot.oracle(&[&volume]).difference(&expected).max <= 1, "the oracle, lighting {number}, {face}");
        }
    }
}

/// In noise that is seen through, where normals of cut and field mix.
#[test]
fn cuts_through_noise_match_the_oracle() {
    let volume = noisy();
    let transfer = tinted((0.0, 255.0));
    let (low, high) = (DVec3::new(0.2, 0.1, 0.3), DVec3::new(0.8, 0.9, 0.7));
    let boxed = Clip::new(Some([at(&volume, low), at(&volume, high)]), &[]);
    let planes = [DVec3::new(0.4, 0.5, 1.0), DVec3::new(-0.7, 0.9, 0.2)].map(|normal| cut(&volume, 0.45, normal));
    let cuts = [boxed, Clip::new(None, &planes)].map(|clip| clip.expect("a cut"));
    let all = lightings();
    let mut stage = Stage::exact(&[&volume]);
    for (i, (clip, method)) in cuts
        .iter()
        .flat_map(|clip| [Method::Udvr, Method::Lvs, Method::Pcvs, Method::Asm].map(|method| (clip, method)))
        .enumerate()
    {
        for lighting in [1, 2, 3, 7] {
            let rays = overview(&volume, Filter::Trilinear);
            let sampling = Sampling { method, ..Sampling::default() };
            let frame = FrameSettings {
                sampling,
                lighting: all[lighting].clone(),
                clip: Some(clip.clone()),
                ..volume.frame(rays, &transfer, Lattice::uniform(0.7, 0))
            };
            let shot = Shot::new(&frame, finest(&volume, &frame), &transfer);
            let ways = if lighting == 1 + i % 2 { &MOST[..] } else { &MOST[..1] };
            // Where a ray enters by an edge, rounding decides which of two faces it is.
            shot.agree(&mut stage, ways, 1, &format!("{method:?}, lighting {lighting}, cut {}", i / 4));
        }
    }
}
