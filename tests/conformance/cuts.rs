//! Cut faces: just behind a clip plane or a side of the clip box the cut's normal lights, not the gradient of what it lays open, and isosurfaces
//! that it opens are capped.

use crate::list::finest;
use crate::scenery::{
    SMALL, is_hole, lightings, noise, overview, parallel, range, tinted, u8_codes, uneven, waves, wide_codes,
};
use crate::shot::{Shot, pixels_off};
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

/// Caps of one opaque surface and of several translucent ones, alone and in fog, in bricks that lie wholly inside of surfaces and in others.
#[test]
fn caps_match_the_oracle() {
    let of = |encoding: SlotEncoding| {
        let (low, high) = range(&encoding);
        let field = move |p: DVec3| low + (high - low) * waves(p * 0.6);
        let value = move |p: DVec3| if encoding.has_invalid && is_hole(p) { f64::NAN } else { field(p) };
        Volume::new(SMALL, 8, uneven(), encoding, value)
    };
    let (low, high) = (DVec3::new(0.2, 0.1, 0.3), DVec3::new(0.8, 0.9, 0.7));
    let (white, blue) = ([0.9, 0.9, 0.8], [0.3, 0.4, 1.0]);
    for volume in &[of(u8_codes()), of(wide_codes())] {
        let (encoding, transfer) = (&volume.encoding, tinted(range(&volume.encoding)));
        let surface = |share: f64, color: [f64; 3], opacity: f64| {
            let value = encoding.low + share * (encoding.high - encoding.low);
            Isosurface { value, color: Some(color), opacity }
        };
        let boxed = Clip::new(Some([at(volume, low), at(volume, high)]), &[]);
        let plane = cut(volume, 0.45, DVec3::new(0.9, 0.6, -0.5));
        let cuts = [boxed, Clip::new(None, &[plane])].map(|clip| clip.expect("a cut"));
        let solid = Surface::all(&[surface(0.35, white, 1.0)], &transfer, encoding);
        let nested = Surface::all(&[surface(0.35, blue, 0.4), surface(0.6, white, 0.7)], &transfer, encoding);
        let mut stage = Stage::with_room(
            &[volume],
            [3, 0].map(|lighting| {
                let lighting = lightings()[lighting].clone();
                let frame = volume.frame(overview(volume, Filter::Trilinear), &transfer, Lattice::uniform(0.7, 0));
                FrameSettings { surfaces: nested.clone(), lighting, ..frame }.needs()
            }),
        );
        for (i, (clip, (mode, surfaces, lighting))) in cuts
            .iter()
            .flat_map(|clip| {
                [
                    (Mode::Isosurface, &solid, 0),
                    (Mode::Isosurface, &solid, 3),
                    (Mode::Isosurface, &nested, 0),
                    (Mode::Dvr, &nested, 0),
                    (Mode::Dvr, &nested, 3),
                ]
                .map(|look| (clip, look))
            })
            .enumerate()
        {
            let frame = |caps| FrameSettings {
                mode,
                caps,
                surfaces: surfaces.clone(),
                lighting: lightings()[lighting].clone(),
                clip: Some(clip.clone()),
                ..volume.frame(overview(volume, Filter::Trilinear), &transfer, Lattice::uniform(0.7, 0))
            };
            let shot = |caps| Shot::new(&frame(caps), finest(volume, &frame(caps)), &transfer);
            let what = format!("{mode:?}, {} surfaces, cut {}, {:?}", surfaces.len(), i / 5, encoding.voxel_type);
            // Rays that graze a surface, and those that enter by an edge of two cuts.
            shot(true).agree(&mut stage, &MOST, 3, &what);
            let open = shot(false).oracle(&[volume]);
            let capped = pixels_off(&open, &shot(true).oracle(&[volume]));
            assert!(capped > 10, "{what}: {capped} pixels of caps");
        }
    }
}
