//! Several volumes in one picture on a GPU, against the oracle: of unlike grids, types, levels and places, with crops, clips and both ways
//! to blend; and of one grid, the channels of one image.
//!
//! The tolerance is that of one volume (`pictures.rs`): 2/255.

#[allow(dead_code, reason = "other tests draw single volumes with it")]
mod bricks;
#[path = "../../../tests/support/looks.rs"]
mod looks;

use bricks::missing::leave_out;
use bricks::{Bricks, Into, MEMORY_BYTES};
use brickyard_pager::{DrawCell, DrawList, Layer, Pixels, VolumeNeeds};
use brickyard_reference::{ReferenceVolume, pixel};
use brickyard_render::{Compositor, GpuError, GpuOptions, GpuRenderer};
use brickyard_volume::*;
use glam::DVec3;
use looks::{Look, PLAIN, camera, looks, surface};

const TOLERANCE: u8 = 2;
const SIZE: (u32, u32) = (48, 40);

/// A volume, where it is and how it looks.
struct Member {
    bricks: Bricks,
    placement: Placement,
    transfer: TransferFunction,
    blend: Blend,
    crop: Option<[DVec3; 2]>,
    /// Its isosurfaces, where pictures have some.
    surfaces: Vec<Isosurface>,
}

fn wave(v: [u32; 3], scale: f64) -> f64 {
    let p = DVec3::from_array(v.map(f64::from)) * scale;
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

fn members() -> Vec<Member> {
    let u8_codes = SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false);
    let u16_codes = SlotEncoding::new(VoxelType::U16, (0.0, 65535.0), false);
    let f32_codes = SlotEncoding::new(VoxelType::F32, (-1.0, 1.0), true);
    let geometry =
        |spacing: [f64; 3], origin: [f64; 3]| Geometry { spacing: spacing.into(), origin: origin.into(), unit: None };
    let holes = |v: [u32; 3]| if (v[0] + v[1]) % 9 < 2 { f64::NAN } else { 2.0 * wave(v, 0.7) - 1.0 };
    vec![
        Member {
            bricks: Bricks::new([37, 41, 33], 16, Geometry::default(), u8_codes, |v| 255.0 * wave(v, 1.0)),
            placement: Placement::default(),
            transfer: ramp((0.0, 255.0), [[0.9, 0.1, 0.2], [0.2, 0.3, 1.0]], 0.4),
            blend: Blend::Mix,
            crop: Some([DVec3::new(4.2, -9.0, 3.0), DVec3::new(99.0, 33.3, 31.5)]),
            surfaces: vec![surface(160.0, 0.4), surface(90.0, 0.2)],
        },
        Member {
            bricks: Bricks::new([50, 30, 27], 12, geometry([0.5, 0.8, 1.0], [-3.0, 2.0, 1.0]), u16_codes, |v| {
                65535.0 * wave(v, 1.3)
            }),
            placement: Placement::from_text("0.9 -0.5 0.1 12  0.4 1.1 0 -3  0 0.3 1.2 2").expect("a map"),
            transfer: ramp((0.0, 65535.0), [[0.1, 0.9, 0.2], [0.9, 0.9, 0.1]], 0.6),
            blend: Blend::Mix,
            crop: None,
            surfaces: Vec::new(),
        },
        Member {
            bricks: Bricks::new([24; 3], 16, geometry([1.7; 3], [2.0; 3]), f32_codes, holes),
            placement: Placement::from_text("0 -1 0 38  1 0 0 -4  0 0 0.8 5").expect("a map"),
            transfer: ramp((-1.0, 1.0), [[0.1, 0.1, 0.9], [0.0, 0.9, 0.9]], 0.2),
            blend: Blend::Add,
            crop: None,
            surfaces: vec![surface(0.1, 0.7)],
        },
    ]
}

/// Channels of one image, of which two share slots; the second one has nothing where x is below 20.
fn channels() -> Vec<Member> {
    let codes = |voxel_type, window, has_invalid| SlotEncoding::new(voxel_type, window, has_invalid);
    let geometry = Geometry { spacing: DVec3::new(1.0, 0.9, 1.1), origin: DVec3::new(1.0, -2.0, 0.0), unit: None };
    let member = |encoding: SlotEncoding, rgb, alpha, f: &dyn Fn([u32; 3]) -> f64| Member {
        bricks: Bricks::new([37, 41, 33], 16, geometry.clone(), encoding, f),
        placement: Placement::default(),
        transfer: ramp((encoding.low, encoding.high), rgb, alpha),
        blend: Blend::Mix,
        crop: None,
        surfaces: Vec::new(),
    };
    let holes = |v: [u32; 3]| if (v[0] + v[1]) % 9 < 2 { f64::NAN } else { 2.0 * wave(v, 0.7) - 1.0 };
    let right = |[x, y, z]: [u32; 3]| if x < 20 { 0.0 } else { 255.0 * wave([y, z, x], 1.1) };
    let u8_codes = codes(VoxelType::U8, (0.0, 255.0), false);
    let all = |v| 255.0 * wave(v, 1.0);
    vec![
        Member {
            surfaces: vec![surface(160.0, 0.4), surface(90.0, 0.2)],
            ..member(u8_codes, [[0.9, 0.1, 0.2], [0.2, 0.3, 1.0]], 0.4, &all)
        },
        member(u8_codes, [[0.1, 0.9, 0.2], [0.9, 0.9, 0.1]], 0.6, &right),
        Member {
            blend: Blend::Add,
            surfaces: vec![surface(0.1, 0.7)],
            ..member(codes(VoxelType::F32, (-1.0, 1.0), true), [[0.1, 0.1, 0.9], [0.0, 0.9, 0.9]], 0.2, &holes)
        },
    ]
}

/// How channels are drawn in a cell: some with a coarser brick, some with one that fades in; no two of them alike.
fn entries(channel: usize, cell: BrickId) -> Vec<(u8, Pixels)> {
    let share = [20, 33, 50][channel];
    let fading = vec![(1, Pixels { from: share, ..Pixels::ALL }), (0, Pixels { to: share, ..Pixels::ALL })];
    let [x, y, z] = cell.index.to_array();
    let is_empty = channel == 1 && cell.level.0 == 0 && x == 0;
    match (x + 2 * y + 3 * z + channel as u32) % 4 {
        _ if is_empty => Vec::new(),
        0 | 1 => vec![(0, Pixels::ALL)],
        2 => vec![(1, Pixels::ALL)],
        _ => fading,
    }
}

/// Whether a brick of level 1 is drawn as it is, and not its children.
fn is_coarse(id: BrickId) -> bool {
    id.level == Level(1) && id.index.to_array().iter().sum::<u32>() % 3 == 1
}

impl Member {
    fn needs(&self) -> VolumeNeeds {
        VolumeNeeds {
            encoding: self.bricks.encoding,
            edge: self.bricks.pyramid.edge(),
            levels: self.bricks.pyramid.levels().len() as u32,
            bricks: self.bricks.needs,
            least_slots: 2,
            most_slots: 4 * self.bricks.pyramid.brick_count() as u32,
        }
    }
}

/// The frames of the members; `clip` is the scene's, zones begin where pixels are `pixel_error` voxels.
fn frames(
    members: &[Member],
    camera: &Camera,
    (step, pixel_error): (f64, f64),
    filter: Filter,
    clip: Option<&Clip>,
    look: &Look,
) -> Vec<VolumeFrame> {
    let rays = camera.rays(SIZE.0, SIZE.1).expect("a camera");
    let frame = |member: &Member| {
        let Member { bricks, placement, transfer, blend, crop, surfaces } = member;
        let shown = if look.has_surfaces { &surfaces[..] } else { &[] };
        let transfer = &look.transfer(transfer, &bricks.encoding);
        let settings = FrameSettings {
            rays,
            lattice: Lattice::for_view(step, 1.0, &rays, pixel_error, 3),
            geometry: bricks.geometry.clone(),
            placement: *placement,
            encoding: bricks.encoding,
            table: TransferTable::new(transfer, &bricks.encoding).into(),
            mode: look.mode,
            surfaces: Surface::all(shown, transfer, &bricks.encoding),
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

fn layers<'a>(members: &'a [Member], frames: &'a [VolumeFrame], draws: &'a [DrawList]) -> Vec<Layer<'a>> {
    let all = (0..).zip(members).zip(frames).zip(draws);
    let layer = |(((volume, member), frame), draw): (((usize, &'a Member), _), _)| Layer {
        volume,
        frame,
        pyramid: &member.bricks.pyramid,
        draw,
        cut: 0,
    };
    all.map(layer).collect()
}

/// A renderer; `None`, said loudly, where there is no adapter at all.
fn renderer(members: &[Member], compositor: Compositor, bytes: u64) -> Option<GpuRenderer> {
    let needs: Vec<VolumeNeeds> = members.iter().map(Member::needs).collect();
    let options = GpuOptions { compositor, ..GpuOptions::default() };
    match GpuRenderer::new(&options, &needs, bytes, SIZE) {
        Ok(renderer) => Some(renderer),
        Err(GpuError::NoAdapter { .. }) => {
            leave_out("gpu", "nothing of the GPU backend was tested here");
            None
        }
        Err(other) => panic!("{other}"),
    }
}

/// Which cells are not split, and with which bricks they are drawn in which pixels.
type Cells<'a> = (&'a dyn Fn(BrickId) -> bool, &'a dyn Fn(usize, BrickId) -> Vec<(u8, Pixels)>);

/// Each member's cells in the order of a view; their bricks uploaded, those of one member between those of the others where they share
/// slots.
fn draws(members: &[Member], renderer: &mut GpuRenderer, camera: &Camera, (stop, entries): Cells<'_>) -> Vec<DrawList> {
    let rays = camera.rays(SIZE.0, SIZE.1).expect("a camera");
    let draw = |(i, member): (usize, &Member)| {
        let into = Into { layer: i, first: i as u32, step: members.len() as u32 };
        member.bricks.draw_fading(renderer, into, &rays, stop, &|cell| entries(i, cell))
    };
    members.iter().enumerate().map(draw).collect()
}

/// Every cell with its own brick.
fn own(_: usize, _: BrickId) -> Vec<(u8, Pixels)> {
    vec![(0, Pixels::ALL)]
}

/// The level at which a member's list has a place in a pixel; where it has none there is nothing to see.
fn level_in(member: &Member, draw: &DrawList, point: DVec3, (x, y): (u32, u32)) -> usize {
    let extent = DVec3::from_array(member.bricks.pyramid.levels()[0].extent.to_array().map(f64::from));
    let voxel = point.clamp(DVec3::ZERO, extent - 0.5).as_uvec3().to_array();
    let holds = |cell: &&DrawCell| {
        let (low, high) = (cell.region.min.to_array(), cell.region.max.to_array());
        cell.pixels.hold(x, y) && (0..3).all(|a| low[a] <= voxel[a] && voxel[a] < high[a])
    };
    draw.cells.iter().find(holds).map_or(0, |cell| cell.brick.level.index())
}

/// The oracle's picture of the same bricks.
fn oracle(
    members: &[Member],
    frames: &[VolumeFrame],
    draws: &[DrawList],
    look: &Look,
    combination: Option<&Combination>,
) -> Picture {
    let shown = |member: &Member| look.transfer(&member.transfer, &member.bricks.encoding);
    let transfers: Vec<TransferFunction> = members.iter().map(shown).collect();
    let color = |at: (u32, u32)| {
        let level_at: Vec<_> =
            members.iter().zip(draws).map(|(member, draw)| move |point| level_in(member, draw, point, at)).collect();
        let mut volumes = Vec::new();
        for ((Member { bricks, .. }, level_at), transfer) in members.iter().zip(&level_at).zip(&transfers) {
            volumes.push(ReferenceVolume { levels: &bricks.levels, level_at, transfer });
        }
        Picture::quantise(pixel(frames, &volumes, combination, at.0, at.1).map(|c| c as f32))
    };
    let (width, height) = SIZE;
    let rgb = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(color).collect();
    Picture { width, height, rgb }
}

/// What any look and filter needs of bricks.
fn needs_of_all(members: &[Member]) -> Needs {
    let most = |a: Needs, b: Needs| Needs {
        apron: a.apron.max(b.apron),
        gradient_layers: a.gradient_layers.max(b.gradient_layers),
        filter: Filter::Tricubic,
        is_pre_integrated: true,
        has_grid: true,
        meshes: MeshRoom { meshes: 2, vertices: 8, triangles: 4 },
    };
    let all = |look: &Look| {
        let cubic = frames(members, &camera(true, [0.0; 3]), (0.7, 0.01), Filter::Tricubic, None, look);
        cubic.iter().map(|frame| frame.settings.needs()).reduce(most)
    };
    looks().iter().filter_map(all).reduce(most).expect("some looks")
}

/// How many pixels are further from what they should be than they may.
fn pixels_off(found: &Picture, expected: &Picture) -> usize {
    let is_off = |(a, b): &(&[u8; 3], &[u8; 3])| (0..3).any(|k| a[k].abs_diff(b[k]) > TOLERANCE);
    found.rgb.iter().zip(&expected.rgb).filter(is_off).count()
}

#[test]
fn volumes_of_unlike_grids_match_the_oracle() {
    let mut members = members();
    let views = [
        (camera(false, [-40.0, -25.0, 60.0]), (0.7, 0.01), Filter::Trilinear, false),
        (camera(false, [17.3, 16.1, 14.7]), (0.4, 1.0), Filter::Trilinear, false),
        (camera(true, [70.0, 35.0, 20.0]), (1.0, 0.01), Filter::Trilinear, true),
        (camera(false, [60.0, 50.0, -20.0]), (0.9, 1.0), Filter::Tricubic, true),
    ];
    let needs = needs_of_all(&members);
    members.iter_mut().for_each(|member| member.bricks.needs = needs);
    let clip = Clip::new(
        Some([DVec3::new(-2.0, 3.0, 0.0), DVec3::new(33.0, 40.0, 29.0)]),
        &[ClipPlane { point: DVec3::splat(20.0), normal: DVec3::new(-1.0, 0.4, -0.3) }],
    );
    let clip = clip.expect("a clip");
    let mut problems = Vec::new();
    for compositor in [Compositor::Raycast, Compositor::Compute, Compositor::Sorted] {
        let Some(mut renderer) = renderer(&members, compositor, MEMORY_BYTES) else { return };
        let draws = draws(&members, &mut renderer, &views[0].0, (&is_coarse, &own));
        for (i, look) in looks().into_iter().enumerate() {
            // A rasteriser in software takes seconds to compile a shader of several layers: by rays some of each kind, which are all tried on
            // the CPU; and without rays what needs no order.
            let is_taken = match compositor {
                Compositor::Raycast => i % 4 == 0 || look.mode.is_projection(),
                Compositor::Compute => i % 12 == 2,
                Compositor::Sorted => look.mode.is_projection(),
            };
            if !is_taken {
                continue;
            }
            let (camera, (step, pixel_error), filter, is_clipped) = views[(i + i / 4) % 4];
            // Segments longer than a voxel reach out of bricks' aprons where methods look at their ends.
            let step = if look.sampling.method == Method::Udvr { step } else { f64::min(step, 0.4) };
            let drawn = |look: &Look| {
                let clip = is_clipped.then_some(&clip);
                frames(&members, &camera, (step, pixel_error), filter, clip, look)
            };
            let frames = drawn(&look);
            let found = renderer.render(&layers(&members, &frames, &draws), None).expect("a picture");
            let expected = oracle(&members, &frames, &draws, &look, None);
            let off = pixels_off(&found, &expected);
            // Rays that graze a surface pass it or do not as is rounded.
            let grazing = if look.has_surfaces { 2 } else { 0 };
            if off > grazing {
                let difference = found.difference(&expected);
                problems
                    .push(format!("{compositor:?} {look:?} view {}: {off} pixels, {difference:?}", (i + i / 4) % 4));
            }
            let background = Picture::quantise(frames[0].settings.background);
            assert!(found.rgb.iter().filter(|&&p| p != background).count() > 200, "nothing in view proves nothing");
            let is_method_alone =
                look.lighting.model == LightingModel::None && !look.has_surfaces && look.mode == Mode::Dvr;
            let is_plain = compositor == Compositor::Sorted || is_method_alone && !look.is_by_gradient;
            if !is_plain {
                let plain = renderer.render(&layers(&members, &drawn(&PLAIN), &draws), None).expect("a picture");
                assert!(found.difference(&plain).max > 20, "{look:?} does not show");
            }
        }
    }
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}

#[test]
fn budgets_and_layers_are_checked() {
    let members = members();
    let needs: Vec<VolumeNeeds> = members.iter().map(Member::needs).collect();
    let with = |bytes| GpuRenderer::new(&GpuOptions::default(), &needs, bytes, SIZE);
    let least = match with(1000) {
        Err(GpuError::Budget { least_bytes, .. }) => least_bytes,
        Err(GpuError::NoAdapter { .. }) => return leave_out("gpu", "no budget was tried"),
        other => panic!("{other:?}"),
    };
    assert!(with(least - 1).is_err());
    let smallest = with(least).expect("the least works");
    assert!((0..3).all(|volume| smallest.slots(volume) == 2) && smallest.gpu_bytes() <= least);
    let Some(mut renderer) = renderer(&members, Compositor::Raycast, MEMORY_BYTES) else { return };
    assert!(renderer.gpu_bytes() <= MEMORY_BYTES);
    let camera = camera(false, [-40.0, -25.0, 60.0]);
    let draws = draws(&members, &mut renderer, &camera, (&is_coarse, &own));
    let frames = frames(&members, &camera, (0.7, 0.01), Filter::Trilinear, None, &PLAIN);
    assert!(matches!(renderer.render(&layers(&members, &frames, &draws)[..2], None), Err(GpuError::Mismatch(_))));
    let mut lit = frames.clone();
    lit[0].settings.lighting = looks()[1].lighting.clone();
    let combination = Combination::new(Expression::parse("a", 3).expect("an expression"), members[0].transfer.clone());
    let refused = renderer.render(&layers(&members, &lit, &draws), Some(&combination));
    assert!(matches!(refused, Err(GpuError::Mismatch(problem)) if problem.contains("gradient")));
}

/// Over three volumes; the second one is made of what some of them have not.
const EXPRESSIONS: [&str; 2] = [
    "default(a, 0) / 255 + default(b, 0) / 65535 * 0.5 + default(c, -1) * 0.1",
    "valid(a) && valid(b) ? max(a / 255, b / 65535) : default(c, -1) * 0.5 + 0.5",
];

#[test]
fn expressions_match_the_oracle() {
    let mut members = members();
    let Some(mut renderer) = renderer(&members, Compositor::Raycast, MEMORY_BYTES) else { return };
    let camera = camera(false, [-40.0, -25.0, 60.0]);
    let draws = draws(&members, &mut renderer, &camera, (&is_coarse, &own));
    for text in EXPRESSIONS {
        let transfer = ramp((0.0, 1.2), [[0.9, 0.1, 0.2], [0.2, 0.3, 1.0]], 0.5);
        let combination = Combination::new(Expression::parse(text, 3).expect("an expression"), transfer);
        let windows = [[0.0, 255.0], [0.0, 65535.0], [-1.0, 1.0]];
        for (i, member) in members.iter_mut().enumerate() {
            member.transfer = combination.of_volume(i, &windows);
        }
        let frames = frames(&members, &camera, (0.7, 0.01), Filter::Trilinear, None, &PLAIN);
        let found = renderer.render(&layers(&members, &frames, &draws), Some(&combination)).expect("a picture");
        let expected = oracle(&members, &frames, &draws, &PLAIN, Some(&combination));
        let off = pixels_off(&found, &expected);
        // Where half of a place's weight has no value, rounding decides which side of an expression is taken.
        assert!(off <= 3, "{text}: {off} pixels, {:?}", found.difference(&expected));
        let background = Picture::quantise(frames[0].settings.background);
        assert!(found.rgb.iter().filter(|&&p| p != background).count() > 200, "nothing in view proves nothing");
    }
}

/// Channels of one image, drawn from slots that they share, cell by cell with bricks of their own levels, fading on their own.
#[test]
fn channels_of_one_image_match_the_oracle() {
    let mut members = channels();
    let needs = needs_of_all(&members);
    members.iter_mut().for_each(|member| member.bricks.needs = needs);
    let views = [
        (camera(false, [-40.0, -25.0, 60.0]), 0.7),
        (camera(false, [17.3, 16.1, 14.7]), 0.4),
        (camera(true, [70.0, 35.0, 20.0]), 1.0),
    ];
    let mut problems = Vec::new();
    for compositor in [Compositor::Sorted, Compositor::Raycast] {
        let Some(mut renderer) = renderer(&members, compositor, MEMORY_BYTES) else { return };
        // Cell by cell fog and lit surfaces by every method, with meshes and without, opacities by gradients, and surfaces alone.
        let is_taken = |(i, look): &(usize, Look)| match compositor {
            Compositor::Sorted => {
                let is_of_method = look.sampling.method != Method::Udvr && look.lighting.model == LightingModel::Phong;
                is_of_method || [0, 4, 6, 12].contains(i) || look.mode == Mode::Isosurface && look.has_meshes
            }
            _ => [0, 7].contains(i),
        };
        for (i, look) in looks().into_iter().enumerate().filter(is_taken) {
            let (camera, step) = &views[i % 3];
            let step = if look.sampling.method == Method::Udvr { *step } else { f64::min(*step, 0.4) };
            // Cells do not know on which side of a surface a ray comes from bricks of another level.
            let is_even = compositor == Compositor::Sorted && look.has_surfaces;
            let cells: Cells<'_> = if is_even { (&|_| false, &own) } else { (&is_coarse, &entries) };
            let draws = draws(&members, &mut renderer, camera, cells);
            let frames = frames(&members, camera, (step, 0.01), Filter::Trilinear, None, &look);
            let found = renderer.render(&layers(&members, &frames, &draws), None).expect("a picture");
            let expected = oracle(&members, &frames, &draws, &look, None);
            let off = pixels_off(&found, &expected);
            // Rays that graze a surface pass it or do not as is rounded.
            let grazing = if look.has_surfaces { 2 } else { 0 };
            if off > grazing {
                problems.push(format!("{compositor:?} {look:?}: {off} pixels, {:?}", found.difference(&expected)));
            }
        }
    }
    assert!(problems.is_empty(), "{}", problems.join("\n"));
}
