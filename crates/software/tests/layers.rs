//! Several volumes in one picture, against the oracle: of unlike grids, types and places, with crops, clips and both ways to blend.
//!
//! The tolerance is that of one volume (`pictures.rs`), for the same reasons.

#[allow(dead_code, reason = "other tests draw single volumes with it")]
mod bricks;
#[path = "../../../tests/support/looks.rs"]
mod looks;

use bricks::{CutCell, Volume, renderer};
use brickyard_pager::{DrawList, Layer, Slot, VolumeNeeds};
use brickyard_reference::{ReferenceVolume, one_level, render};
use brickyard_software::{SoftwareError, SoftwareOptions, SoftwareRenderer};
use brickyard_volume::*;
use glam::DVec3;
use looks::{Look, PLAIN, camera, looks, surface};

const TOLERANCE: u8 = 1;

/// A volume, where it is and how it looks.
struct Member {
    volume: Volume,
    geometry: Geometry,
    placement: Placement,
    transfer: TransferFunction,
    blend: Blend,
    crop: Option<[DVec3; 2]>,
    /// Its isosurfaces, where pictures have some.
    surfaces: Vec<Isosurface>,
}

fn wave(p: DVec3) -> f64 {
    let wave = (p.x * 0.31).sin() + (p.y * 0.23 + 1.0).sin() + (p.z * 0.37 + p.x * 0.1).cos();
    (wave / 6.0 + 0.5).clamp(0.0, 1.0)
}

fn ramp((low, high): (f64, f64), rgb: [[f64; 3]; 2], alpha: f64) -> TransferFunction {
    let at = |code: u32| low + code as f64 / 255.0 * (high - low);
    let color = |code: u32, [r, g, b]: [f64; 3]| [at(code), r, g, b];
    TransferFunction {
        color: vec![color(40, rgb[0]), color(220, rgb[1])],
        opacity: vec![[at(100), 0.0], [at(140), alpha], [at(180), 0.25 * alpha], [at(230), alpha]],
        unit_distance: 2.0,
        ..TransferFunction::default()
    }
}

/// Three volumes: 8 bits where its store says, 16 bits turned, leaning and stretched, floats with holes that glow.
fn members() -> Vec<Member> {
    let u8_codes = SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false);
    let u16_codes = SlotEncoding::new(VoxelType::U16, (0.0, 65535.0), false);
    let f32_codes = SlotEncoding::new(VoxelType::F32, (-1.0, 1.0), true);
    let plain = Volume::new(Extent::new(37, 41, 33), DVec3::ONE, 16, u8_codes, |p| 255.0 * wave(p));
    let spacing = DVec3::new(0.5, 0.8, 1.0);
    let askew = Volume::new(Extent::new(50, 30, 27), spacing, 12, u16_codes, |p| 65535.0 * wave(p * 1.3));
    let holes = |p: DVec3| if (p.x + p.y) % 9.0 < 2.0 { f64::NAN } else { 2.0 * wave(p * 0.7) - 1.0 };
    let holed = Volume::new(Extent::new(24, 24, 24), DVec3::splat(1.7), 16, f32_codes, holes);
    vec![
        Member {
            volume: plain,
            geometry: Geometry::default(),
            placement: Placement::default(),
            transfer: ramp((0.0, 255.0), [[0.9, 0.1, 0.2], [0.2, 0.3, 1.0]], 0.4),
            blend: Blend::Mix,
            crop: Some([DVec3::new(4.2, -9.0, 3.0), DVec3::new(99.0, 33.3, 31.5)]),
            surfaces: vec![surface(160.0, 0.4), surface(90.0, 0.2)],
        },
        Member {
            volume: askew,
            geometry: Geometry { spacing, origin: DVec3::new(-3.0, 2.0, 1.0), unit: None },
            placement: Placement::from_text("0.9 -0.5 0.1 12  0.4 1.1 0 -3  0 0.3 1.2 2").expect("a map"),
            transfer: ramp((0.0, 65535.0), [[0.1, 0.9, 0.2], [0.9, 0.9, 0.1]], 0.6),
            blend: Blend::Mix,
            crop: None,
            surfaces: Vec::new(),
        },
        Member {
            volume: holed,
            geometry: Geometry { spacing: DVec3::splat(1.7), origin: DVec3::splat(2.0), unit: None },
            placement: Placement::from_text("0 -1 0 38  1 0 0 -4  0 0 0.8 5").expect("a map"),
            transfer: ramp((-1.0, 1.0), [[0.1, 0.1, 0.9], [0.0, 0.9, 0.9]], 0.2),
            blend: Blend::Add,
            crop: None,
            surfaces: vec![surface(0.1, 0.7)],
        },
    ]
}

/// The frames of some members; `clip` is the scene's.
fn frames(
    members: &[Member],
    camera: &Camera,
    step: f64,
    filter: Filter,
    clip: Option<&Clip>,
    look: &Look,
) -> Vec<VolumeFrame> {
    let rays = camera.rays(30, 25).expect("a camera");
    let frame = |member: &Member| {
        let Member { volume, geometry, placement, transfer, blend, crop, surfaces } = member;
        let shown = if look.has_surfaces { &surfaces[..] } else { &[] };
        let transfer = &look.transfer(transfer, &volume.encoding);
        let settings = FrameSettings {
            rays,
            lattice: Lattice::for_view(step, 1.0, &rays, 0.01, 3),
            geometry: geometry.clone(),
            placement: *placement,
            encoding: volume.encoding,
            table: TransferTable::new(transfer, &volume.encoding).into(),
            mode: look.mode,
            surfaces: Surface::all(shown, transfer, &volume.encoding),
            meshes: look.meshes(),
            sampling: Sampling { filter, ..look.sampling },
            lighting: look.lighting.clone(),
            background: [0.1, 0.2, 0.35],
            clip: Clip::in_volume(clip, placement, *crop).expect("a crop"),
        };
        VolumeFrame { settings, blend: *blend, opacity: 1.0 }
    };
    members.iter().map(frame).collect()
}

/// The finest bricks of a volume, front to back as the rays, in its own world, meet them.
fn cut(member: &Member, rays: &ViewRays) -> Vec<CutCell> {
    let Member { volume, geometry, placement, .. } = member;
    let own = ViewRays {
        eye: placement.volume_from_world(rays.eye),
        forward: placement.volume_vector(rays.middle()),
        ..*rays
    };
    volume.cut(&own, geometry, &|_, _| true)
}

fn draw(members: &[Member], frames: &[VolumeFrame], combination: Option<&Combination>, threads: usize) -> Picture {
    let loaded: Vec<(Vec<_>, DrawList)> = members
        .iter()
        .zip(frames)
        .map(|(member, frame)| member.volume.bricks(&cut(member, &frame.settings.rays), &frame.settings.needs()))
        .collect();
    let needs = members.iter().zip(frames).map(|(member, frame)| member.volume.needs(&frame.settings.needs()));
    let mut renderer = renderer(&needs.collect::<Vec<_>>(), &frames[0].settings.rays, threads);
    for (layer, (bricks, _)) in loaded.iter().enumerate() {
        for (slot, codes) in bricks.iter().enumerate() {
            renderer.upload(layer, Slot(slot as u32), codes.clone());
        }
    }
    let layers = members.iter().zip(frames).zip(&loaded).enumerate();
    let layers: Vec<Layer<'_>> = layers
        .map(|(volume, ((member, frame), (_, draw)))| Layer {
            volume,
            frame,
            pyramid: &member.volume.pyramid,
            draw,
            cut: 0,
        })
        .collect();
    renderer.render(&layers, combination)
}

fn oracle(members: &[Member], frames: &[VolumeFrame], look: &Look, combination: Option<&Combination>) -> Picture {
    let level_at = one_level(0);
    let shown = |member: &Member| look.transfer(&member.transfer, &member.volume.encoding);
    let transfers: Vec<TransferFunction> = members.iter().map(shown).collect();
    let mut volumes = Vec::new();
    for (member, transfer) in members.iter().zip(&transfers) {
        volumes.push(ReferenceVolume { levels: &member.volume.levels, level_at: &level_at, transfer });
    }
    render(frames, &volumes, combination)
}

#[test]
fn volumes_of_unlike_grids_match_the_oracle() {
    let members = members();
    let clip = Clip::new(
        Some([DVec3::new(-2.0, 3.0, 0.0), DVec3::new(33.0, 40.0, 29.0)]),
        &[ClipPlane { point: DVec3::splat(20.0), normal: DVec3::new(-1.0, 0.4, -0.3) }],
    );
    let clip = clip.expect("a clip");
    let views = [
        (camera(false, [-40.0, -25.0, 60.0]), 0.7, Filter::Trilinear, None),
        (camera(false, [17.3, 16.1, 14.7]), 0.4, Filter::Trilinear, None),
        (camera(true, [70.0, 35.0, 20.0]), 1.0, Filter::Trilinear, Some(&clip)),
        (camera(false, [60.0, 50.0, -20.0]), 1.9, Filter::Tricubic, Some(&clip)),
    ];
    let mut problems = Vec::new();
    for (i, look) in looks().into_iter().enumerate() {
        // Each from another side.
        let (camera, step, filter, clip) = views[(i + i / 4) % 4];
        // Segments longer than a voxel reach out of bricks' aprons where methods look at their ends.
        let step = if look.sampling.method == Method::Udvr { step } else { f64::min(step, 0.4) };
        let drawn = |look: &Look, threads| {
            let frames = frames(&members, &camera, step, filter, clip, look);
            (draw(&members, &frames, None, threads), frames)
        };
        let (found, frames) = drawn(&look, 2);
        let expected = oracle(&members, &frames, &look, None);
        let is_off = |(a, b): &(&[u8; 3], &[u8; 3])| (0..3).any(|k| a[k].abs_diff(b[k]) > TOLERANCE);
        let off = found.rgb.iter().zip(&expected.rgb).filter(is_off).count();
        // Rays that graze a surface pass it or do not as is rounded.
        let grazing = if look.has_surfaces { 2 } else { 0 };
        // Stored gradients are half floats: where they all but cancel out, rounding decides where they point.
        let rounded = if look.lighting.gradient == Gradient::Stored { 3 } else { 0 };
        if off > grazing + rounded {
            problems.push(format!("{look:?} {camera:?}: {off} pixels, {:?}", found.difference(&expected)));
        }
        let shown = found.rgb.iter().filter(|&&p| p != Picture::quantise(frames[0].settings.background)).count();
        assert!(shown > 100, "{shown} pixels prove nothing");
        assert_eq!(drawn(&look, 1).0, found, "the number of threads shows");
        let is_method_alone =
            look.lighting.model == LightingModel::None && !look.has_surfaces && look.mode == Mode::Dvr;
        let is_plain = is_method_alone && !look.is_by_gradient;
        assert!(is_plain || found.difference(&drawn(&PLAIN, 2).0).max > 20, "{look:?} does not show");
    }
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}

#[test]
fn the_order_of_volumes_does_not_show() {
    let members = members();
    let mut frames = frames(&members, &camera(false, [-40.0, -25.0, 60.0]), 0.7, Filter::Trilinear, None, &PLAIN);
    let forward = draw(&members, &frames, None, 2);
    frames.reverse();
    let mut reversed = members;
    reversed.reverse();
    // Sums in another order round otherwise.
    assert!(draw(&reversed, &frames, None, 2).difference(&forward).max <= 1);
}

#[test]
fn budgets_are_shared_and_hard() {
    let members = members();
    let needs: Vec<VolumeNeeds> =
        members.iter().map(|member| VolumeNeeds { least_slots: 2, ..member.volume.needs(&Needs::PLAIN) }).collect();
    let with = |memory_bytes: u64| {
        SoftwareRenderer::new(
            &needs,
            &SoftwareOptions { memory_bytes, max_picture_px: [64, 64], threads: 2, leaps: true },
        )
    };
    let Err(SoftwareError::Budget { least_bytes, .. }) = with(1000) else { panic!("1000 bytes cannot be enough") };
    assert!(with(least_bytes - 1).is_err());
    let least = with(least_bytes).expect("the least works");
    assert!((0..3).all(|volume| least.slots(volume) == 2) && least.bytes() == least_bytes);
    let more = with(least_bytes + 300_000).expect("more works");
    assert!((0..3).all(|volume| more.slots(volume) > 2) && more.bytes() <= least_bytes + 300_000);
    let all = with(1 << 30).expect("all works");
    assert!((0..3).all(|volume| all.slots(volume) == needs[volume].most_slots));
}

/// Over three volumes; the second one is made of what some of them have not.
const EXPRESSIONS: [&str; 2] = [
    "default(a, 0) / 255 + default(b, 0) / 65535 * 0.5 + default(c, -1) * 0.1",
    "valid(a) && valid(b) ? max(a / 255, b / 65535) : default(c, -1) * 0.5 + 0.5",
];

#[test]
fn expressions_match_the_oracle() {
    for text in EXPRESSIONS {
        let transfer = ramp((0.0, 1.2), [[0.9, 0.1, 0.2], [0.2, 0.3, 1.0]], 0.5);
        let combination = Combination::new(Expression::parse(text, 3).expect("an expression"), transfer);
        let mut members = members();
        let windows = [[0.0, 255.0], [0.0, 65535.0], [-1.0, 1.0]];
        for (i, member) in members.iter_mut().enumerate() {
            member.transfer = combination.of_volume(i, &windows);
        }
        for (camera, step, filter) in [
            (camera(false, [-40.0, -25.0, 60.0]), 0.7, Filter::Trilinear),
            (camera(true, [70.0, 35.0, 20.0]), 1.3, Filter::Tricubic),
        ] {
            let frames = frames(&members, &camera, step, filter, None, &PLAIN);
            let found = draw(&members, &frames, Some(&combination), 2);
            let expected = oracle(&members, &frames, &PLAIN, Some(&combination));
            let is_off = |(a, b): &(&[u8; 3], &[u8; 3])| (0..3).any(|k| a[k].abs_diff(b[k]) > TOLERANCE);
            let off = found.rgb.iter().zip(&expected.rgb).filter(is_off).count();
            // Where half of a place's weight has no value, rounding decides which side of an expression is taken.
            assert!(off <= 3, "{text} {step}: {off} pixels");
            let shown = found.rgb.iter().filter(|&&p| p != Picture::quantise(frames[0].settings.background)).count();
            assert!(shown > 100, "{shown} pixels prove nothing");
        }
    }
}
