//! Several volumes in one picture, against the oracle: of unlike grids, types and places, with crops, clips and both ways to blend.
//!
//! The tolerance is that of one volume (`pictures.rs`), for the same reasons.

#[allow(dead_code, reason = "other tests draw single volumes with it")]
mod bricks;
#[path = "../../../tests/support/looks.rs"]
mod looks;

use bricks::{CutCell, Volume, renderer};
use brickyard_pager::{DrawCell, DrawList, Layer, Pixels, Slot, VolumeNeeds};
use brickyard_reference::{ReferenceVolume, render};
use brickyard_software::{SoftwareError, SoftwareOptions, SoftwareRenderer};
use brickyard_volume::*;
use glam::DVec3;
use looks::{Look, PLAIN, camera, looks, surface};
use std::sync::Arc;

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
    /// Which cut its cells are of, and which of these: cells that are split, and finest cells drawn by coarser bricks or by none.
    cut: u32,
    is_split: fn(BrickIndex) -> bool,
    is_coarse: fn(BrickIndex) -> bool,
    is_left_out: fn(BrickIndex) -> bool,
}

impl Member {
    /// One that stands where its store says, of a cut of its own with the finest bricks.
    fn new(volume: Volume, transfer: TransferFunction, cut: u32) -> Self {
        Self {
            volume,
            geometry: Geometry::default(),
            placement: Placement::default(),
            transfer,
            blend: Blend::Mix,
            crop: None,
            surfaces: Vec::new(),
            cut,
            is_split: |_| true,
            is_coarse: |_| false,
            is_left_out: |_| false,
        }
    }
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
            crop: Some([DVec3::new(4.2, -9.0, 3.0), DVec3::new(99.0, 33.3, 31.5)]),
            surfaces: vec![surface(160.0, 0.4), surface(90.0, 0.2)],
            ..Member::new(plain, ramp((0.0, 255.0), [[0.9, 0.1, 0.2], [0.2, 0.3, 1.0]], 0.4), 0)
        },
        Member {
            geometry: Geometry { spacing, origin: DVec3::new(-3.0, 2.0, 1.0), unit: None },
            placement: Placement::from_text("0.9 -0.5 0.1 12  0.4 1.1 0 -3  0 0.3 1.2 2").expect("a map"),
            ..Member::new(askew, ramp((0.0, 65535.0), [[0.1, 0.9, 0.2], [0.9, 0.9, 0.1]], 0.6), 1)
        },
        Member {
            geometry: Geometry { spacing: DVec3::splat(1.7), origin: DVec3::splat(2.0), unit: None },
            placement: Placement::from_text("0 -1 0 38  1 0 0 -4  0 0 0.8 5").expect("a map"),
            blend: Blend::Add,
            surfaces: vec![surface(0.1, 0.7)],
            ..Member::new(holed, ramp((-1.0, 1.0), [[0.1, 0.1, 0.9], [0.0, 0.9, 0.9]], 0.2), 2)
        },
    ]
}

/// Three channels of one image, of other types, that share a cut: cells of two levels, some of them drawn by coarser bricks, and those
/// left out in which the last channel, which glows, has no value.
fn channels() -> Vec<Member> {
    let spacing = DVec3::new(1.0, 0.8, 1.1);
    let channel = |encoding, value: &dyn Fn(DVec3) -> f64, transfer| {
        let volume = Volume::new(Extent::new(37, 41, 33), spacing, 16, encoding, value);
        Member {
            geometry: Geometry { spacing, origin: DVec3::new(-3.0, 2.0, 1.0), unit: None },
            placement: Placement::from_text("0.9 -0.5 0.1 12  0.4 1.1 0 -3  0 0.3 1.2 2").expect("a map"),
            crop: Some([DVec3::new(-1.2, -9.0, 3.0), DVec3::new(99.0, 28.3, 31.5)]),
            is_split: |index| index.x + index.y != 1,
            ..Member::new(volume, transfer, 5)
        }
    };
    let u8_codes = SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false);
    let u16_codes = SlotEncoding::new(VoxelType::U16, (0.0, 65535.0), false);
    let f32_codes = SlotEncoding::new(VoxelType::F32, (-1.0, 1.0), true);
    let holes = |p: DVec3| if p.x > 32.0 || (p.y + p.z) % 11.0 < 2.0 { f64::NAN } else { 2.0 * wave(p * 0.7) - 1.0 };
    vec![
        Member {
            surfaces: vec![surface(160.0, 0.4), surface(90.0, 0.2)],
            is_coarse: |index| index.y == 1,
            ..channel(u8_codes, &|p| 255.0 * wave(p), ramp((0.0, 255.0), [[0.9, 0.1, 0.2], [0.2, 0.3, 1.0]], 0.4))
        },
        channel(u16_codes, &|p| 65535.0 * wave(p * 1.3), ramp((0.0, 65535.0), [[0.1, 0.9, 0.2], [0.9, 0.9, 0.1]], 0.6)),
        Member {
            blend: Blend::Add,
            surfaces: vec![surface(0.1, 0.7)],
            is_left_out: |index| index.x == 2,
            ..channel(f32_codes, &holes, ramp((-1.0, 1.0), [[0.1, 0.1, 0.9], [0.0, 0.9, 0.9]], 0.2))
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
        let Member { volume, geometry, placement, transfer, blend, crop, surfaces, .. } = member;
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

/// The cells of a volume, back to front as the rays, in its own world, meet them.
fn cut(member: &Member, rays: &ViewRays) -> Vec<CutCell> {
    let Member { volume, geometry, placement, .. } = member;
    let own = ViewRays {
        eye: placement.volume_from_world(rays.eye),
        forward: placement.volume_vector(rays.middle()),
        ..*rays
    };
    let mut cells = volume.cut(&own, geometry, &|level, index| level.0 > 1 || (member.is_split)(index));
    for cell in cells.iter_mut().filter(|cell| cell.level.0 == 0 && (member.is_coarse)(cell.index)) {
        cell.drawn = Level(1);
    }
    cells
}

/// The padded bricks of a volume, slot by slot, and its draw list.
fn load(member: &Member, frame: &VolumeFrame) -> (Vec<Arc<[u8]>>, DrawList) {
    let settings = &frame.settings;
    let (bricks, mut list) = member.volume.bricks(&cut(member, &settings.rays), &settings.needs());
    list.cells.retain(|entry| entry.cell.level.0 > 0 || !(member.is_left_out)(entry.cell.index));
    (bricks, list)
}

/// Gives every other finest cell two entries: its pixels are some of one and some of the other. Both draw the same brick.
fn fade_in(list: &mut DrawList) {
    let pair = |entry: &DrawCell| match entry.cell.level.0 == 0 && entry.cell.index.z != 1 {
        true => vec![
            DrawCell { pixels: Pixels { from: 20, ..Pixels::ALL }, ..*entry },
            DrawCell { pixels: Pixels { to: 20, ..Pixels::ALL }, ..*entry },
        ],
        false => vec![*entry],
    };
    list.cells = list.cells.iter().flat_map(pair).collect();
}

fn draw(members: &[Member], frames: &[VolumeFrame], combination: Option<&Combination>, threads: usize) -> Picture {
    let loaded: Vec<_> = members.iter().zip(frames).map(|(member, frame)| load(member, frame)).collect();
    draw_loaded(members, frames, &loaded, combination, threads).1
}

fn draw_loaded(
    members: &[Member],
    frames: &[VolumeFrame],
    loaded: &[(Vec<Arc<[u8]>>, DrawList)],
    combination: Option<&Combination>,
    threads: usize,
) -> (SoftwareRenderer, Picture) {
    let needs = members.iter().zip(frames).map(|(member, frame)| member.volume.needs(&frame.settings.needs()));
    let mut renderer = renderer(&needs.collect::<Vec<_>>(), &frames[0].settings.rays, threads);
    for (layer, (bricks, _)) in loaded.iter().enumerate() {
        for (slot, codes) in bricks.iter().enumerate() {
            renderer.upload(layer, Slot(slot as u32), codes.clone());
        }
    }
    let layers = members.iter().zip(frames).zip(loaded).enumerate();
    let layers: Vec<Layer<'_>> = layers
        .map(|(volume, ((member, frame), (_, draw)))| Layer {
            volume,
            frame,
            pyramid: &member.volume.pyramid,
            draw,
            cut: member.cut,
        })
        .collect();
    let picture = renderer.render(&layers, combination);
    (renderer, picture)
}

fn oracle(members: &[Member], frames: &[VolumeFrame], look: &Look, combination: Option<&Combination>) -> Picture {
    let rays = &frames[0].settings.rays;
    let levels: Vec<_> = members.iter().map(|member| member.volume.level_at(&cut(member, rays))).collect();
    let shown = |member: &Member| look.transfer(&member.transfer, &member.volume.encoding);
    let transfers: Vec<TransferFunction> = members.iter().map(shown).collect();
    let mut volumes = Vec::new();
    for ((member, transfer), level_at) in members.iter().zip(&transfers).zip(&levels) {
        volumes.push(ReferenceVolume { levels: &member.volume.levels, level_at, transfer });
    }
    render(frames, &volumes, combination)
}

#[test]
fn volumes_of_unlike_grids_match_the_oracle() {
    match_the_oracle(&members());
}

#[test]
fn channels_of_one_image_match_the_oracle() {
    match_the_oracle(&channels());
}

fn match_the_oracle(members: &[Member]) {
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
            let frames = frames(members, &camera, step, filter, clip, look);
            (draw(members, &frames, None, threads), frames)
        };
        let (found, frames) = drawn(&look, 2);
        let expected = oracle(members, &frames, &look, None);
        let is_off = |(a, b): &(&[u8; 3], &[u8; 3])| (0..3).any(|k| a[k].abs_diff(b[k]) > TOLERANCE);
        let off = found.rgb.iter().zip(&expected.rgb).filter(is_off).count();
        // Rays that graze a surface pass it or do not as is rounded.
        let grazing = if look.has_surfaces { 2 } else { 0 };
        // Stored gradients are half floats: where they all but cancel out, rounding decides where they point.
        let rounded = if look.lighting.gradient == Gradient::Stored { 3 } else { 0 };
        // Where half of a place's weight has no value, rounding decides whether it shows.
        let half_valid = 1;
        if off > grazing + rounded + half_valid {
            problems.push(format!("{look:?} {camera:?}: {off} pixels, {:?}", found.difference(&expected)));
        }
        let shown = found.rgb.iter().filter(|&&p| p != Picture::quantise(frames[0].settings.background)).count();
        assert!(shown > 60, "{shown} pixels prove nothing");
        assert_eq!(drawn(&look, 1).0, found, "the number of threads shows");
        let is_method_alone =
            look.lighting.model == LightingModel::None && !look.has_surfaces && look.mode == Mode::Dvr;
        let is_plain = is_method_alone && !look.is_by_gradient;
        let shown = found.difference(&drawn(&PLAIN, 2).0).max;
        if !is_plain && shown <= 2 {
            problems.push(format!("{look:?} shows by {shown} only"));
        }
    }
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}

/// Channels that share a cut and the same with cuts of their own, in fog, by another method, with surfaces in it and alone: pictures and
/// visibility are alike, also while bricks fade in.
#[test]
fn a_shared_cut_does_not_show() {
    let mut members = channels();
    let camera = camera(false, [-40.0, -25.0, 60.0]);
    let sampling = Sampling { method: Method::Pcvs, jitter: Jitter::Blue, ..PLAIN.sampling };
    for look in [
        PLAIN,
        Look { sampling, ..PLAIN },
        Look { has_surfaces: true, ..PLAIN },
        Look { mode: Mode::Isosurface, has_surfaces: true, has_meshes: true, ..PLAIN },
    ] {
        let frames = frames(&members, &camera, 0.4, Filter::Trilinear, None, &look);
        let mut loaded: Vec<_> = members.iter().zip(&frames).map(|(member, frame)| load(member, frame)).collect();
        fade_in(&mut loaded[1].1);
        let mut drawn = |cuts: [u32; 3]| {
            members.iter_mut().zip(cuts).for_each(|(member, cut)| member.cut = cut);
            let (renderer, picture) = draw_loaded(&members, &frames, &loaded, None, 2);
            (picture, [0, 1, 2].map(|layer| renderer.visibility(layer).expect("light").to_vec()))
        };
        let ((shared, light), (apart, light_apart)) = (drawn([5; 3]), drawn([5, 6, 7]));
        let difference = shared.difference(&apart);
        assert!(difference.max <= 2 * TOLERANCE, "{look:?}: {difference:?}");
        for (light, apart) in light.iter().flatten().zip(light_apart.iter().flatten()) {
            assert!((light - apart).abs() < 0.01, "{look:?}: {light} {apart}");
        }
        assert!(light[0].iter().any(|&light| light > 0.0 && light < 0.9), "light that nothing dims proves nothing");
    }
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
