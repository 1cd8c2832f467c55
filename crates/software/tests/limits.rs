//! The CPU renderer's own properties: hard budgets, and pictures independent of threads. The conformance suite
//! (`tests/conformance`) covers the pictures' contents.

use brickyard_pager::{DrawCell, DrawList, Layer, PixelShare, Slot, VolumeNeeds};
use brickyard_software::{SoftwareError, SoftwareOptions, SoftwareRenderer};
use brickyard_volume::*;
use glam::DVec3;

const EDGE: u32 = 32;
const BRICKS: Needs = Needs { apron: 2, ..Needs::PLAIN };

fn needs(edge: u32, voxel_type: VoxelType) -> VolumeNeeds {
    let encoding = SlotEncoding::new(voxel_type, (0.0, 255.0), false);
    VolumeNeeds { encoding, edge, levels: 2, bricks: BRICKS, least_slots: 2, most_slots: 9 }
}

const SIZE_PX: [u32; 2] = [120, 100];

fn options(memory_bytes: u64, threads: usize) -> SoftwareOptions {
    SoftwareOptions { memory_bytes, max_picture_px: SIZE_PX, threads, skips_empty: true }
}

/// Of three volumes whose bricks share no slots.
#[test]
fn budgets_are_shared_and_hard() {
    let needs =
        [(16, VoxelType::U8), (12, VoxelType::U16), (24, VoxelType::F32)].map(|(edge, voxel)| needs(edge, voxel));
    let with = |bytes| SoftwareRenderer::new(&needs, &options(bytes, 2));
    let Err(SoftwareError::Budget { least_bytes, .. }) = with(1000) else { panic!("1000 bytes cannot be enough") };
    assert!(with(least_bytes - 1).is_err());
    let least = with(least_bytes).expect("the least works");
    assert!((0..3).all(|volume| least.slots(volume) == 2) && least.bytes() == least_bytes);
    let more = with(least_bytes + 300_000).expect("more works");
    assert!((0..3).all(|volume| more.slots(volume) > 2) && more.bytes() <= least_bytes + 300_000);
    let all = with(1 << 30).expect("all works");
    assert!((0..3).all(|volume| all.slots(volume) == needs[volume].most_slots));
}

/// A brick of waves with its apron.
fn brick() -> Vec<u8> {
    let along = || (0..EDGE + 2 * BRICKS.apron).map(f64::from);
    let value = |[x, y, z]: [f64; 3]| (127.0 + 120.0 * (x * 0.3).sin() * (y * 0.2 + z * 0.1).cos()) as u8;
    along().flat_map(|z| along().flat_map(move |y| along().map(move |x| value([x, y, z])))).collect()
}

/// The picture and the marks of `layers` layers of one brick, all turned but the first.
fn draw(mode: Mode, layers: usize, threads: usize, size_px: [u32; 2]) -> (Picture, Option<Vec<f32>>) {
    let needs = vec![needs(EDGE, VoxelType::U8); layers];
    let pyramid = Pyramid::new(Extent::new(EDGE, EDGE, EDGE), [1.0; 3], EDGE);
    let options = SoftwareOptions { max_picture_px: size_px, ..options(1 << 30, threads) };
    let mut renderer = SoftwareRenderer::new(&needs, &options).expect("a gibibyte is enough");
    renderer.upload(0, Slot(0), brick().into()).expect("the slot is there");
    let id = BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::default() };
    let region = pyramid.brick_box_voxel(id.level, id.index);
    let cell = DrawCell { cell: id, region, pixels: PixelShare::ALL, brick: id, slot: Slot(0), rank: 0 };
    let list = DrawList { cells: vec![cell] };
    let transfer = TransferFunction {
        color: vec![[0.0, 0.1, 0.2, 0.9], [255.0, 0.4, 0.6, 0.1]],
        opacity: vec![[90.0, 0.0], [200.0, 0.4]],
        ..TransferFunction::default()
    };
    let projection = Projection::Perspective { fov_y_deg: 40.0 };
    let (eye, target) = (DVec3::new(-30.0, -25.0, 50.0), DVec3::splat(16.0));
    let rays = Camera { eye, target, up: DVec3::Z, projection }.rays(size_px[0], size_px[1]).expect("a camera");
    let shown = if mode == Mode::Isosurface { vec![Isosurface::at(140.0)] } else { Vec::new() };
    let turned = Placement::from_text("0.8 -0.6 0 12  0.6 0.8 0 -9  0 0 1.1 1").expect("a map");
    let frame = |layer: usize| {
        VolumeFrame::alone(FrameSettings {
            rays,
            lattice: Lattice::uniform(0.7, 0),
            geometry: Geometry::default(),
            placement: if layer == 0 { Placement::default() } else { turned },
            encoding: needs[layer].encoding,
            table: TransferTable::new(&transfer, &needs[layer].encoding).into(),
            mode,
            surfaces: Surface::all(&shown, &transfer, &needs[layer].encoding),
            sampling: Sampling::default(),
            lighting: Lighting::default(),
            background: [0.1, 0.2, 0.35],
            clip: None,
            meshes: Vec::new(),
            caps: false,
            keeps_extremes: false,
        })
    };
    let frames: Vec<VolumeFrame> = (0..layers).map(frame).collect();
    let layer = |(volume, frame)| Layer { volume, frame, pyramid: &pyramid, draw: &list, cut: 0 };
    let picture = renderer.render(&frames.iter().enumerate().map(layer).collect::<Vec<_>>(), None).expect("a picture");
    (picture, renderer.visibility(0).map(<[f32]>::to_vec))
}

#[test]
fn the_picture_does_not_depend_on_threads() {
    for mode in Mode::ALL {
        for layers in [1, 2] {
            let one = draw(mode, layers, 1, SIZE_PX);
            let colors: std::collections::BTreeSet<_> = one.0.rgb.iter().collect();
            assert!(colors.len() > 60, "{mode:?}: a flat picture proves nothing");
            assert_eq!(one, draw(mode, layers, 3, SIZE_PX), "{mode:?}, {layers} layers");
        }
    }
}

/// Splits of a large picture pile up on the stacks of many threads, which once overflowed.
#[test]
fn many_threads_draw_a_large_picture() {
    for layers in [1, 2] {
        let size_px = [1024, 768];
        let one = draw(Mode::Dvr, layers, 1, size_px);
        assert!(one == draw(Mode::Dvr, layers, 24, size_px), "{layers} layers");
    }
}

/// Foreign inputs are errors, and the renderer goes on.
#[test]
fn what_does_not_belong_together_is_an_error() {
    let own = [needs(EDGE, VoxelType::U8)];
    let mut renderer = SoftwareRenderer::new(&own, &options(1 << 30, 1)).expect("a gibibyte is enough");
    let said = |error: Option<SoftwareError>| error.map(|error| error.to_string()).unwrap_or_default();
    assert!(said(SoftwareRenderer::new(&[], &options(1 << 30, 1)).err()).contains("no layer"));
    let narrow = VolumeNeeds { bricks: Needs { apron: 0, ..BRICKS }, ..own[0] };
    assert!(said(SoftwareRenderer::new(&[narrow], &options(1 << 30, 1)).err()).contains("an apron of 0"));
    assert!(said(renderer.upload(1, Slot(0), brick().into()).err()).contains("a brick of layer 1"));
    let beyond = Slot(renderer.slots(0));
    assert!(said(renderer.upload(0, beyond, brick().into()).err()).contains("for slot"));
    assert!(said(renderer.upload(0, Slot(0), brick()[1..].into()).err()).contains("for slot 0"));
    assert!(said(renderer.render(&[], None).err()).contains("layers []"));

    let pyramid = Pyramid::new(Extent::new(EDGE, EDGE, EDGE), [1.0; 3], EDGE);
    let id = BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::default() };
    let region = pyramid.brick_box_voxel(id.level, id.index);
    let cell = DrawCell { cell: id, region, pixels: PixelShare::ALL, brick: id, slot: Slot(0), rank: 0 };
    let (list, coarse) = (DrawList { cells: vec![cell] }, Pyramid::new(Extent::new(EDGE, EDGE, EDGE), [1.0; 3], 16));
    let frame = |width, encoding, filter| {
        let camera = Camera::looking_at_box((DVec3::ZERO, DVec3::splat(f64::from(EDGE))));
        VolumeFrame::alone(FrameSettings {
            rays: camera.rays(width, 50).expect("a camera"),
            lattice: Lattice::uniform(0.7, 0),
            geometry: Geometry::default(),
            placement: Placement::default(),
            encoding,
            table: TransferTable::new(&TransferFunction::default(), &encoding).into(),
            mode: Mode::Dvr,
            surfaces: Vec::new(),
            sampling: Sampling { filter, ..Sampling::default() },
            lighting: Lighting::default(),
            background: [0.0; 3],
            clip: None,
            meshes: Vec::new(),
            caps: false,
            keeps_extremes: false,
        })
    };
    let (plain, encoding) = (Filter::Trilinear, own[0].encoding);
    let wide = SlotEncoding::new(VoxelType::U16, (0.0, 255.0), false);
    let mut drawn = |volume, frame: VolumeFrame, pyramid: &Pyramid| {
        said(renderer.render(&[Layer { volume, frame: &frame, pyramid, draw: &list, cut: 0 }], None).err())
    };
    assert!(drawn(0, frame(60, encoding, plain), &pyramid).contains("slot 0, which holds no brick"));
    assert!(drawn(1, frame(60, encoding, plain), &pyramid).contains("layers [1]"));
    assert!(drawn(0, frame(60, wide, plain), &pyramid).contains("it was made for"));
    assert!(drawn(0, frame(60, encoding, plain), &coarse).contains("in bricks of 16"));
    assert!(drawn(0, frame(5000, encoding, plain), &pyramid).contains("a picture of 5000x50 pixels"));
    assert!(drawn(0, frame(60, encoding, Filter::Tricubic), &pyramid).contains("its bricks have"));
    renderer.upload(0, Slot(0), brick().into()).expect("the slot is there");
    let frame = frame(60, encoding, plain);
    renderer
        .render(&[Layer { volume: 0, frame: &frame, pyramid: &pyramid, draw: &list, cut: 0 }], None)
        .expect("a picture");
}
