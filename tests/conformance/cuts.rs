//! Cut faces: just behind a clip plane or a side of the clip box the cut's normal lights instead of the opened field's gradient, and opened
//! isosurfaces are capped.

use crate::list::finest;
use crate::scenery::{
    SMALL, is_hole, lightings, look, noise, overview, parallel, range, tinted, u8_codes, uneven, waves, wide_codes,
};
use crate::shot::{Shot, pixels_off};
use crate::stage::{ALL, COMPUTE, CPU, MOST, RAYCAST, Stage};
use crate::volume::Volume;
use brickyard::volume::*;
use glam::DVec3;

fn noisy() -> Volume {
    Volume::new(SMALL, 16, uneven(), u8_codes(), |p| (40.0 + 170.0 * noise(p)).round())
}

/// A world position in a volume, in shares of its box.
fn at(volume: &Volume, share: DVec3) -> DVec3 {
    let (low, high) = volume.geometry.world_box(volume.pyramid.levels()[0].extent);
    low + (high - low) * share
}

fn cut(volume: &Volume, share: f64, normal: DVec3) -> ClipPlane {
    ClipPlane { point: at(volume, DVec3::splat(share)), normal }
}

/// Opaque noise of one colour, cut askew: every pixel has a plane's colour, whatever the noise.
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
                // The place of the first sample, at most 0.2 behind the cut: no lamp is near enough for this to matter.
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

/// Translucent noise, where normals of cut and field mix.
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
            // A ray that enters by an edge has one of two faces, by rounding.
            shot.agree(&mut stage, ways, 1, &format!("{method:?}, lighting {lighting}, cut {}", i / 4));
        }
    }
}

/// Caps of one opaque surface and of several translucent ones, alone and in fog, in bricks wholly inside surfaces and others.
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
            // Rays that graze a surface, or enter by an edge of two cuts.
            shot(true).agree(&mut stage, &MOST, 3, &what);
            let open = shot(false).oracle(&[volume]);
            let capped = pixels_off(&open, &shot(true).oracle(&[volume]));
            assert!(capped > 10, "{what}: {capped} pixels of caps");
        }
    }
}

/// A cut behind the eye lights nothing, wherever the lattice begins.
#[test]
fn a_cut_behind_the_eye_does_not_light() {
    let volume = Volume::new(SMALL, 16, Geometry::default(), u8_codes(), |p| 90.0 + 2.0 * p.x + p.y);
    let transfer = tinted((0.0, 255.0));
    let eye = at(&volume, DVec3::splat(0.4));
    let rays = look(eye, eye + DVec3::Y * 30.0, 50.0).rays(22, 18).expect("a camera");
    let plane = ClipPlane { point: eye - DVec3::Y * 0.4, normal: DVec3::Y };
    let (_, high) = volume.geometry.world_box(volume.pyramid.levels()[0].extent);
    let boxed = Clip::new(Some([eye - DVec3::Y * 0.4 - DVec3::new(90.0, 0.0, 90.0), high]), &[]);
    let clips = [Clip::new(None, &[plane]), boxed].map(|clip| Some(clip.expect("a cut")));
    let mut stage = Stage::exact(&[&volume]);
    for (step, jitter) in [(0.8, Jitter::Blue), (2.6, Jitter::White(5)), (2.6, Jitter::Blue)] {
        let frame = |clip: &Option<Clip>| FrameSettings {
            sampling: Sampling { jitter, ..Sampling::default() },
            lighting: lightings()[3].clone(),
            clip: clip.clone(),
            ..volume.frame(rays, &transfer, Lattice::uniform(step, 0))
        };
        let open = frame(&None);
        let expected = Shot::new(&open, finest(&volume, &open), &transfer).oracle(&[&volume]);
        for clip in &clips {
            let frame = frame(clip);
            let shot = Shot::new(&frame, finest(&volume, &frame), &transfer);
            let what = format!("step {step}, {jitter:?}, {clip:?}");
            assert!(shot.oracle(&[&volume]).difference(&expected).max <= 1, "the oracle, {what}");
            shot.agree_with(&expected, &mut stage, &ALL, 0, &what);
        }
    }
}

/// Segments of several voxels, partly cut off: the rest is lit at its middle.
#[test]
fn expressions_behind_a_cut_are_lit_where_they_are_seen() {
    let volume = noisy();
    let text = Expression::parse("a", 1).expect("an expression");
    let opaque = TransferFunction {
        color: vec![[0.0, 0.8, 0.6, 0.3]],
        opacity: vec![[0.0, 0.9]],
        ..TransferFunction::default()
    };
    let combination = Combination::new(text, opaque);
    let transfers = [combination.of_volume(0, &[[0.0, 255.0]])];
    let mut stage = Stage::exact(&[&volume]);
    for (share, normal) in [(0.45, DVec3::new(0.9, 0.6, -0.5)), (0.55, DVec3::new(0.4, 0.8, -1.0))] {
        for step in [0.7, 2.6] {
            let clip = Clip::new(None, &[cut(&volume, share, normal)]).expect("a cut");
            let frame = FrameSettings {
                lighting: lightings()[3].clone(),
                clip: Some(clip),
                ..volume.frame(overview(&volume, Filter::Trilinear), &transfers[0], Lattice::uniform(step, 0))
            };
            let shot = Shot::new(&frame, finest(&volume, &frame), &transfers[0]);
            let shot = Shot { combination: Some(&combination), ..shot };
            shot.agree(&mut stage, &MOST, 1, &format!("step {step}, cut {normal}"));
        }
    }
}

/// Two overlapping layers, cut by one plane, the second on its own grid: everything begins on the cut at one distance, despite rounding. Of two
/// caps the first layer's is seen, and a cap comes before opaque fog of either layer.
#[test]
fn caps_are_in_the_order_of_layers_and_before_fog() {
    let ball = |centre: DVec3| {
        Volume::new(SMALL, 16, Geometry::default(), u8_codes(), move |p| 230.0 - 9.0 * (p - centre).length())
    };
    let middle = DVec3::from_array(SMALL.map(f64::from)) * 0.5;
    let volumes = [ball(middle - DVec3::X * 3.0), ball(middle + DVec3::X * 3.0)];
    let colors = [[1.0, 0.1, 0.1], [0.1, 0.3, 1.0]];
    let fog = |[r, g, b]: [f64; 3], opacity: f64| TransferFunction {
        color: vec![[0.0, r, g, b]],
        opacity: vec![[0.0, opacity]],
        ..TransferFunction::default()
    };
    let turned = Placement::from_text("0.985 -0.174 0 4.5  0.174 0.985 0 -3.8  0 0 1 0").expect("a map");
    let plane = ClipPlane { point: middle - 0.5, normal: DVec3::new(0.3, 1.0, -0.2) };
    let rays = look(middle + DVec3::new(-6.0, -70.0, 20.0), middle, 30.0).rays(44, 36).expect("a camera");
    // The layer of opaque fog, and the layer seen in the middle row.
    for (opaque, seen) in [(None, 0), (Some(0), 1), (Some(1), 0)] {
        let transfers = [0, 1].map(|i| fog(colors[i], if opaque == Some(i) { 1.0 } else { 0.0 }));
        let frame = |i: usize| {
            let surface = [Isosurface { value: 130.0, color: Some(colors[i]), opacity: 1.0 }];
            let surfaces = Surface::all(&surface, &transfers[i], &volumes[i].encoding);
            let settings = FrameSettings {
                mode: if opaque.is_some() { Mode::Dvr } else { Mode::Isosurface },
                caps: true,
                surfaces: if opaque == Some(i) { vec![] } else { surfaces },
                placement: [Placement::default(), turned][i],
                ..volumes[i].frame(rays, &transfers[i], Lattice::uniform(0.7, 0))
            };
            let clip = Clip::new(None, &[plane]).expect("a cut");
            let clip = Clip::in_volume(Some(&clip), &settings.placement, None).expect("a cut");
            VolumeFrame { settings: FrameSettings { clip, ..settings }, blend: Blend::Mix, opacity: 1.0 }
        };
        let frames = vec![frame(0), frame(1)];
        let lists = (0..2).map(|i| finest(&volumes[i], &frames[i].settings)).collect();
        let shot = Shot { frames, lists, transfers: transfers.iter().collect(), combination: None, is_apart: false };
        let all = [&volumes[0], &volumes[1]];
        let mut stage = Stage::with_room(&all, [shot.needs()]);
        let changes = |row: &[[u8; 3]]| {
            row.windows(2).filter(|pair| (pair[0][0] > pair[0][2]) != (pair[1][0] > pair[1][2])).count()
        };
        let expected = shot.oracle(&all);
        let what = format!("opaque fog of layer {opaque:?}");
        assert!(expected.rgb.chunks_exact(44).all(|row| changes(row) <= 4), "{what}: of one piece each");
        let [r, _, b] = expected.rgb[18 * 44 + 22];
        assert_eq!(usize::from(b > r), seen, "{what}: in the middle both are cut");
        // Rays that graze a solid.
        shot.agree(&mut stage, &[CPU, RAYCAST, COMPUTE], 4, &what);
    }
}
