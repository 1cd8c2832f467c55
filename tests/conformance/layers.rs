//! Several layers in one picture: of different grids, types, levels and places, with crops, clips and both blends; the channels of one
//! image; and expressions over them.

use crate::list::{Entry, OWN, list};
use crate::looks::{Look, PLAIN, camera, looks, surface};
use crate::scenery::{u8_codes, waves};
use crate::shot::{Shot, assert_telling};
use crate::stage::{ALL, COMPUTE, CPU, MOST, RAYCAST, SORTED, Stage, Way};
use crate::volume::Volume;
use brickyard::pager::PixelShare;
use brickyard::volume::*;
use brickyard_tests::sample::sampled;
use glam::DVec3;

/// A volume, its place and its look.
struct Member {
    volume: Volume,
    placement: Placement,
    transfer: TransferFunction,
    blend: Blend,
    crop: Option<[DVec3; 2]>,
    /// Its isosurfaces, in pictures with surfaces.
    surfaces: Vec<Isosurface>,
}

impl Member {
    /// A mixing member in its own world.
    fn new(volume: Volume, rgb: [[f64; 3]; 2], alpha: f64) -> Self {
        let transfer = ramp((volume.encoding.low, volume.encoding.high), rgb, alpha);
        let (placement, crop, surfaces) = (Placement::default(), None, Vec::new());
        Self { volume, placement, transfer, blend: Blend::Mix, crop, surfaces }
    }
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

const RED: [[f64; 3]; 2] = [[0.9, 0.1, 0.2], [0.2, 0.3, 1.0]];
const GREEN: [[f64; 3]; 2] = [[0.1, 0.9, 0.2], [0.9, 0.9, 0.1]];
const BLUE: [[f64; 3]; 2] = [[0.1, 0.1, 0.9], [0.0, 0.9, 0.9]];

fn holes(p: DVec3) -> f64 {
    if (p.x + p.y) % 9.0 < 2.0 { f64::NAN } else { 2.0 * waves(p * 0.7) - 1.0 }
}

fn float_codes() -> SlotEncoding {
    SlotEncoding::new(VoxelType::F32, (-1.0, 1.0), true)
}

/// Three volumes: 8 bits at its store's place; 16 bits turned, sheared and stretched; and floats with holes, which adds light.
fn members() -> [Member; 3] {
    let u16_codes = SlotEncoding::new(VoxelType::U16, (0.0, 65535.0), false);
    let geometry = |spacing: [f64; 3], origin: [f64; 3]| Geometry {
        spacing: spacing.into(),
        origin: origin.into(),
        ..Geometry::default()
    };
    let plain = Volume::new([37, 41, 33], 16, Geometry::default(), u8_codes(), |p| 255.0 * waves(p));
    let askew = geometry([0.5, 0.8, 1.0], [-3.0, 2.0, 1.0]);
    let askew = Volume::new([50, 30, 27], 12, askew, u16_codes, |p| 65535.0 * waves(p * 1.3));
    let holed = Volume::new([24; 3], 16, geometry([1.7; 3], [2.0; 3]), float_codes(), holes);
    let map = |text| Placement::from_text(text).expect("a map");
    [
        Member {
            crop: Some([DVec3::new(4.2, -9.0, 3.0), DVec3::new(99.0, 33.3, 31.5)]),
            surfaces: vec![surface(160.0, 0.4), surface(90.0, 0.2)],
            ..Member::new(plain, RED, 0.4)
        },
        Member { placement: map("0.9 -0.5 0.1 12  0.4 1.1 0 -3  0 0.3 1.2 2"), ..Member::new(askew, GREEN, 0.6) },
        Member {
            placement: map("0 -1 0 38  1 0 0 -4  0 0 0.8 5"),
            blend: Blend::Add,
            surfaces: vec![surface(0.1, 0.7)],
            ..Member::new(holed, BLUE, 0.2)
        },
    ]
}

/// Channels of one image, two of them in shared slots; the second is empty below x = 20.
fn channels() -> [Member; 3] {
    let geometry =
        Geometry { spacing: DVec3::new(1.0, 0.9, 1.1), origin: DVec3::new(1.0, -2.0, 0.0), ..Geometry::default() };
    let right = |p: DVec3| if p.x < 20.0 { 0.0 } else { 255.0 * waves(DVec3::new(p.y, p.z, p.x) * 1.1) };
    let of = |encoding, f: &dyn Fn(DVec3) -> f64| Volume::new([37, 41, 33], 16, geometry.clone(), encoding, f);
    [
        Member {
            surfaces: vec![surface(160.0, 0.4), surface(90.0, 0.2)],
            ..Member::new(of(u8_codes(), &|p| 255.0 * waves(p)), RED, 0.4)
        },
        Member::new(of(u8_codes(), &right), GREEN, 0.6),
        Member {
            blend: Blend::Add,
            surfaces: vec![surface(0.1, 0.7)],
            ..Member::new(of(float_codes(), &holes), BLUE, 0.2)
        },
    ]
}

/// View and resolution of members.
#[derive(Clone, Copy)]
struct View<'a> {
    camera: Camera,
    step: f64,
    /// Voxels per pixel at which zones begin.
    pixel_error: f64,
    filter: Filter,
    /// The scene's clip.
    clip: Option<&'a Clip>,
}

/// The frames of the members under a look.
fn frames(members: &[Member], view: &View<'_>, look: &Look) -> Vec<VolumeFrame> {
    let rays = view.camera.rays(28, 24).expect("a camera");
    let frame = |member: &Member| {
        let Member { volume, placement, transfer, blend, crop, surfaces } = member;
        let shown = if look.has_surfaces { &surfaces[..] } else { &[] };
        let transfer = &look.transfer(transfer, &volume.encoding);
        // Segments longer than a voxel reach out of bricks' aprons if a method samples their ends.
        let step = if look.sampling.method == Method::Udvr { view.step } else { f64::min(view.step, 0.4) };
        let settings = FrameSettings {
            placement: *placement,
            mode: look.mode,
            surfaces: Surface::all(shown, transfer, &volume.encoding),
            meshes: look.meshes(),
            sampling: Sampling { filter: view.filter, ..look.sampling },
            lighting: look.lighting.clone(),
            clip: Clip::in_volume(view.clip, placement, *crop).expect("a crop"),
            caps: true,
            ..volume.frame(rays, transfer, Lattice::for_view(step, 1.0, &rays, view.pixel_error, 3))
        };
        VolumeFrame { settings, blend: *blend, opacity: 1.0 }
    };
    members.iter().map(frame).collect()
}

/// The predicate for unsplit cells, and each member's entries in a cell.
type Cells<'a> = (&'a dyn Fn(BrickId) -> bool, &'a dyn Fn(usize, BrickId) -> Vec<Entry>);

/// Whether a brick of level 1 is drawn itself instead of its children.
fn is_coarse(id: BrickId) -> bool {
    id.level == Level(1) && id.index.to_array().iter().sum::<u32>() % 3 == 1
}

/// Every cell with its own brick.
fn own(_: usize, _: BrickId) -> Vec<Entry> {
    vec![OWN]
}

/// A channel's entries in a cell: some with a coarser brick, some with a fading one; all channels differ.
fn entries(channel: usize, cell: BrickId) -> Vec<Entry> {
    let share = [20, 33, 50][channel];
    let [x, y, z] = cell.index.to_array();
    let is_empty = channel == 1 && cell.level.0 == 0 && x == 0;
    match (x + 2 * y + 3 * z + channel as u32) % 4 {
        _ if is_empty => Vec::new(),
        0 | 1 => vec![OWN],
        2 => vec![(1, PixelShare::ALL)],
        _ => vec![(1, PixelShare { from: share, ..PixelShare::ALL }), (0, PixelShare { to: share, ..PixelShare::ALL })],
    }
}

/// A picture of the members under a look.
fn shot<'a>(
    members: &[Member],
    frames: Vec<VolumeFrame>,
    transfers: &'a [TransferFunction],
    (stop, entries): Cells<'_>,
) -> Shot<'a> {
    let all = members.iter().zip(&frames).enumerate();
    let lists = all.map(|(i, (m, frame))| list(&m.volume, &frame.settings, stop, &|cell| entries(i, cell))).collect();
    Shot { frames, lists, transfers: transfers.iter().collect(), combination: None, is_apart: false }
}

fn transfers(members: &[Member], look: &Look) -> Vec<TransferFunction> {
    members.iter().map(|member| look.transfer(&member.transfer, &member.volume.encoding)).collect()
}

fn volumes(members: &[Member]) -> Vec<&Volume> {
    members.iter().map(|member| &member.volume).collect()
}

/// The number of pixels of a look that may be off: rounding decides whether a grazing ray passes a surface; stored gradients are half
/// floats, and where they nearly cancel, rounding decides their direction.
fn allowed(look: &Look) -> usize {
    2 * look.has_surfaces as usize + if look.lighting.gradient == Gradient::Stored { 3 } else { 0 }
}

/// Where half of a place's weight has no value, rounding decides its visibility.
const HALF_VALID: usize = 1;

#[test]
fn volumes_of_unlike_grids_match_the_oracle() {
    let members = members();
    let clip = Clip::new(
        Some([DVec3::new(-2.0, 3.0, 0.0), DVec3::new(33.0, 40.0, 29.0)]),
        &[ClipPlane { point: DVec3::splat(20.0), normal: DVec3::new(-1.0, 0.4, -0.3) }],
    );
    let clip = clip.expect("a clip");
    let view = |camera, step, pixel_error, filter, clip| View { camera, step, pixel_error, filter, clip };
    let views = [
        view(camera(false, [-40.0, -25.0, 60.0]), 0.7, 0.01, Filter::Trilinear, None),
        view(camera(false, [17.3, 16.1, 14.7]), 0.4, 1.0, Filter::Trilinear, None),
        view(camera(true, [70.0, 35.0, 20.0]), 1.0, 0.01, Filter::Trilinear, Some(&clip)),
        view(camera(false, [60.0, 50.0, -20.0]), 0.9, 1.0, Filter::Tricubic, Some(&clip)),
    ];
    // Each look from another side.
    let looks: Vec<(Look, &View<'_>)> =
        looks().into_iter().enumerate().map(|(i, look)| (look, &views[(i + i / 4) % 4])).collect();
    let needs = looks.iter().flat_map(|(look, view)| frames(&members, view, look)).map(|frame| frame.settings.needs());
    let mut stage = Stage::with_room(&volumes(&members), needs);
    for (i, (look, view)) in looks.iter().enumerate() {
        let what = format!("{look:?} from {:?}", view.camera.eye);
        // The CPU takes all; others take some of each kind by rays, and unordered ones without rays.
        let is_taken = |way: &Way| match *way {
            RAYCAST => i % 4 == 0 || look.mode.is_projection(),
            COMPUTE => i % 12 == 2,
            SORTED => look.mode.is_projection(),
            _ => true,
        };
        let ways: Vec<Way> = ALL.into_iter().filter(is_taken).collect();
        let transfer = transfers(&members, look);
        let shot = |look| shot(&members, frames(&members, view, look), &transfer, (&is_coarse, &own));
        let expected = shot(look).oracle(&stage.volumes);
        assert_telling(&expected, &what);
        shot(look).agree_with(&expected, &mut stage, &ways, allowed(look), &what);
        let is_method_alone =
            look.lighting.model == LightingModel::None && !look.has_surfaces && look.mode == Mode::Dvr;
        let plain = shot(&PLAIN).render(&mut stage, CPU).expect("a processor");
        let is_plain = is_method_alone && !look.is_by_gradient;
        assert!(is_plain || expected.difference(&plain).max > 20, "{what} does not show");
    }
}

/// Cell by cell with bricks of different levels and separate fades, from shared slots.
#[test]
fn channels_of_one_image_match_the_oracle() {
    let members = channels();
    let view = |camera, step| View { camera, step, pixel_error: 0.01, filter: Filter::Trilinear, clip: None };
    let views = [
        view(camera(false, [-40.0, -25.0, 60.0]), 0.7),
        view(camera(false, [17.3, 16.1, 14.7]), 0.4),
        view(camera(true, [70.0, 35.0, 20.0]), 1.0),
    ];
    let needs = looks().into_iter().flat_map(|look| frames(&members, &views[0], &look));
    let mut stage = Stage::with_room(&volumes(&members), needs.map(|frame| frame.settings.needs()));
    for (i, look) in looks().into_iter().enumerate() {
        // Without rays: fog and lit surfaces by every method, with meshes and without, opacities by gradients, and surfaces alone.
        let is_of_method = look.sampling.method != Method::Udvr && look.lighting.model == LightingModel::Phong;
        let is_sorted = is_of_method || [0, 4, 6, 12].contains(&i) || look.mode == Mode::Isosurface && look.has_meshes;
        // Cells of `sorted` do not have a ray's side of a surface from bricks of another level.
        let (even, mixed): (Cells<'_>, Cells<'_>) = ((&|_| false, &own), (&is_coarse, &entries));
        let (cells, ways): (Cells<'_>, &[Way]) = match i {
            0 => (mixed, &MOST),
            7 => (mixed, &[CPU, RAYCAST]),
            _ if is_sorted => (if look.has_surfaces { even } else { mixed }, &[CPU, SORTED]),
            _ if look.mode == Mode::Dvr => (mixed, &[CPU]),
            // The omitted cells have values visible in projections; `joins` tests those of one grid.
            _ => continue,
        };
        let transfer = transfers(&members, &look);
        let shot = shot(&members, frames(&members, &views[i % 3], &look), &transfer, cells);
        shot.agree(&mut stage, ways, allowed(&look) + HALF_VALID, &format!("{look:?}"));
    }
    // Channels with bricks of one level find their samples once for all.
    for view in &views {
        let transfer = transfers(&members, &PLAIN);
        let alike = shot(&members, frames(&members, view, &PLAIN), &transfer, (&is_coarse, &own));
        alike.agree(&mut stage, &[CPU], HALF_VALID, "bricks of one level");
    }
}

/// Channels with a shared cut and with separate cuts, in fog, by another method, with surfaces in it and alone: pictures and visibility
/// are alike, also during fades.
#[test]
fn a_shared_cut_does_not_show() {
    let members = channels();
    let camera = camera(false, [-40.0, -25.0, 60.0]);
    let view = View { camera, step: 0.4, pixel_error: 0.01, filter: Filter::Trilinear, clip: None };
    let sampling = Sampling { method: Method::Pcvs, jitter: Jitter::Blue, ..PLAIN.sampling };
    let mut stage = Stage::exact(&volumes(&members));
    let (mixed, alike): (Cells<'_>, Cells<'_>) = ((&is_coarse, &entries), (&is_coarse, &own));
    for (look, cells) in [
        (PLAIN, mixed),
        (PLAIN, alike),
        (Look { sampling, ..PLAIN }, mixed),
        (Look { has_surfaces: true, ..PLAIN }, mixed),
        (Look { mode: Mode::Isosurface, has_surfaces: true, has_meshes: true, ..PLAIN }, mixed),
    ] {
        let mut drawn = |is_apart| {
            let shot = shot(&members, frames(&members, &view, &look), &[], cells);
            let shot = Shot { is_apart, ..shot };
            let picture = shot.render(&mut stage, CPU).expect("a processor");
            let renderer = stage.renderer(CPU, &shot.needs()).expect("a processor");
            (picture, [0, 1, 2].map(|layer| renderer.visibility(layer).expect("light").to_vec()))
        };
        let ((shared, light), (apart, light_apart)) = (drawn(false), drawn(true));
        // Both equal the oracle's within a step.
        assert!(shared.difference(&apart).max <= 2, "{look:?}: {:?}", shared.difference(&apart));
        for (light, apart) in light.iter().flatten().zip(light_apart.iter().flatten()) {
            assert!((light - apart).abs() < 0.01, "{look:?}: {light} {apart}");
        }
        assert!(light[0].iter().any(|&light| light > 0.0 && light < 0.9), "light that nothing dims proves nothing");
    }
}

/// Over three volumes; the second fills in missing values of the others.
const EXPRESSIONS: [&str; 2] = [
    "default(a, 0) / 255 + default(b, 0) / 65535 * 0.5 + default(c, -1) * 0.1",
    "valid(a) && valid(b) ? max(a / 255, b / 65535) : default(c, -1) * 0.5 + 0.5",
];

#[test]
fn expressions_match_the_oracle() {
    let members = members();
    let mut stage = Stage::exact(&volumes(&members));
    let view = |camera, step, filter| View { camera, step, pixel_error: 0.01, filter, clip: None };
    for text in EXPRESSIONS {
        let combination =
            Combination::new(Expression::parse(text, 3).expect("an expression"), ramp((0.0, 1.2), RED, 0.5));
        let windows = [[0.0, 255.0], [0.0, 65535.0], [-1.0, 1.0]];
        let transfer: Vec<TransferFunction> = (0..3).map(|i| combination.of_volume(i, &windows)).collect();
        for (view, ways) in [
            (view(camera(false, [-40.0, -25.0, 60.0]), 0.7, Filter::Trilinear), &[CPU, RAYCAST][..]),
            (view(camera(true, [70.0, 35.0, 20.0]), 1.3, Filter::Tricubic), &[CPU]),
        ] {
            let mut frames = frames(&members, &view, &PLAIN);
            for ((frame, member), transfer) in frames.iter_mut().zip(&members).zip(&transfer) {
                frame.settings.table = TransferTable::new(transfer, &member.volume.encoding).into();
            }
            let shot = shot(&members, frames, &transfer, (&is_coarse, &own));
            let shot = Shot { combination: Some(&combination), ..shot };
            // Where half of a place's weight has no value, rounding decides the branch of an expression.
            shot.agree(&mut stage, ways, 3, text);
        }
    }
}

/// Numbers of layers without unrolled shader code.
const COUNTS: [usize; 3] = [5, 16, MAX_VOLUMES];

/// Layers of several types, places and crops, some with surfaces; and an expression over them. A run draws one of the numbers.
#[test]
fn many_layers_match_the_oracle() {
    let rgb = |i: usize| [RED, GREEN, BLUE][i % 3];
    let look = Look { has_surfaces: true, ..PLAIN };
    for count in sampled("many layers", COUNTS.len(), COUNTS.len()).into_iter().map(|i| COUNTS[i]) {
        let member = |i: usize| {
            let encoding = [u8_codes(), float_codes()][usize::from(i % 4 == 3)];
            let [low, high] = encoding.table_values();
            let shifted = move |p: DVec3| low + (high - low) * waves(p * (1.0 + 0.01 * i as f64));
            let geometry = Geometry { origin: DVec3::splat(0.2 * i as f64), ..Geometry::default() };
            let volume = Volume::new([20, 24, 18], 16, geometry, encoding, shifted);
            let crop = (i % 3 == 1).then(|| [DVec3::splat(2.2), DVec3::splat(15.0 + 0.1 * i as f64)]);
            let surfaces = if i % 5 == 2 { vec![surface(0.6 * high, 0.4)] } else { Vec::new() };
            let blend = if i % 4 == 1 { Blend::Add } else { Blend::Mix };
            Member { blend, crop, surfaces, ..Member::new(volume, rgb(i), 0.6 / count as f64) }
        };
        let members: Vec<Member> = (0..count).map(member).collect();
        let view = View {
            camera: camera(false, [-40.0, -25.0, 60.0]),
            step: 1.0,
            pixel_error: 0.01,
            filter: Filter::Trilinear,
            clip: None,
        };
        let mut stage = Stage::exact(&volumes(&members));
        let transfer = transfers(&members, &look);
        let all = shot(&members, frames(&members, &view, &look), &transfer, (&|_| false, &own));
        all.agree(&mut stage, &[CPU, RAYCAST], allowed(&look), &format!("{count} layers"));
        let letters = (0..count).map(|i| match i {
            0..26 => char::from(b'a' + i as u8).to_string(),
            _ => format!("v{i}"),
        });
        let text = letters.map(|letter| format!("default({letter}, 0)")).collect::<Vec<_>>().join(" + ");
        let combination = Combination::new(
            Expression::parse(&text, count).expect("an expression"),
            ramp((0.0, 150.0 * count as f64), GREEN, 0.5),
        );
        let windows: Vec<[f64; 2]> = members.iter().map(|member| member.volume.encoding.table_values()).collect();
        let transfer: Vec<TransferFunction> = (0..count).map(|i| combination.of_volume(i, &windows)).collect();
        let mut frames = frames(&members, &view, &PLAIN);
        for ((frame, member), transfer) in frames.iter_mut().zip(&members).zip(&transfer) {
            frame.settings.table = TransferTable::new(transfer, &member.volume.encoding).into();
        }
        let sum = shot(&members, frames, &transfer, (&|_| false, &own));
        let sum = Shot { combination: Some(&combination), ..sum };
        sum.agree(&mut stage, &[CPU, RAYCAST], 0, &format!("a sum of {count} layers"));
    }
}
