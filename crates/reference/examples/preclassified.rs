//! Thin layers in a volume classified before and after interpolation: one picture of both, side by side.
//!
//! The volume holds distances from its centre; the transfer function shows some of them, each as a thin translucent
//! shell. On the left it was applied to the voxels, and colour and opacity (premultiplied: the better way) were
//! interpolated, as with an RGBA texture; on the right values were interpolated, and the function applied to samples.
//! Half of the ball is cut away.
//!
//! ```text
//! cargo run --release -p brickyard-reference --example preclassified -- docs/images/classification.png
//! ```
//!
//! Prints how far each is from the picture of the exact distances, without interpolation.

use brickyard_reference::{Array, ReferenceVolume, one_level, render};
use brickyard_volume::{
    Camera, Clip, Extent, Filter, FrameSettings, Geometry, Lattice, Lighting, Mode, Picture, Placement, Projection,
    Pyramid, Sampling, SlotEncoding, TransferFunction, TransferTable, VolumeFrame, VoxelType,
};
use glam::DVec3;
use std::path::Path;

/// Voxels along each axis.
const EDGE: u32 = 64;
/// Pixels along each side of one picture.
const SIZE_PX: u32 = 384;
/// Step, voxels: small enough never to step over shells of half a voxel.
const STEP: f64 = 0.05;

/// Premultiplied colour and opacity over one voxel at a place; all zero for emptiness.
type Classified = [f64; 4];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).ok_or("expected a path to write a PNG to")?;
    let transfer = shells();
    let frame = frame(&transfer)?;
    let pyramid = Pyramid::new(Extent::new(EDGE, EDGE, EDGE), [1.0; 3], EDGE);
    let grid = &pyramid.levels()[0];
    let centre_of = |index: [u32; 3]| DVec3::from_array(index.map(f64::from)) + 0.5;

    let values = [Array::from_fn(grid, |index| distance(centre_of(index)))];
    let after =
        |at: DVec3| values[0].sample(at, Filter::Trilinear).map_or([0.0; 4], |value| classify(&transfer, value));
    let channels: [Array; 4] =
        std::array::from_fn(|k| Array::from_fn(grid, |index| classify(&transfer, distance(centre_of(index)))[k]));
    let before = |at: DVec3| std::array::from_fn(|k| channels[k].sample(at, Filter::Trilinear).unwrap_or(0.0));
    let exact = |at: DVec3| classify(&transfer, distance(at));
    let [before, after, exact] = [picture(&frame, &before), picture(&frame, &after), picture(&frame, &exact)];

    let volume = ReferenceVolume { levels: &values, level_at: &one_level(0), transfer: &transfer };
    let oracle = render(&[VolumeFrame::alone(frame.clone())], &[volume], None);
    let difference = after.difference(&oracle);
    if difference.max > 1 {
        return Err(format!("this program's pictures are not the reference renderer's: {difference:?}").into());
    }
    for (name, picture) in [("before", &before), ("after", &after)] {
        println!("classified {name} interpolation: PSNR {:.1} dB", picture.difference(&exact).psnr_db);
    }
    write(Path::new(&path), &before, &after)
}

/// The data: distance from the centre, voxels.
fn distance(at: DVec3) -> f64 {
    (at - EDGE as f64 / 2.0).length()
}

/// Six shells of 0.8 voxels.
fn shells() -> TransferFunction {
    let half = 0.4;
    let shell = |i: usize| 9.0 + 4.0 * i as f64;
    let colors = [
        [1.0, 0.95, 0.85],
        [0.95, 0.30, 0.20],
        [1.0, 0.75, 0.20],
        [0.35, 0.80, 0.40],
        [0.25, 0.60, 0.95],
        [0.7, 0.5, 0.9],
    ];
    let color = |(i, [r, g, b]): (usize, [f64; 3])| [[shell(i) - 2.0, r, g, b], [shell(i) + 1.999, r, g, b]];
    let opacity =
        |i: usize| [(-half, 0.0), (-half, 0.5), (half, 0.5), (half, 0.0)].map(|(d, alpha)| [shell(i) + d, alpha]);
    TransferFunction {
        color: colors.into_iter().enumerate().flat_map(color).collect(),
        opacity: (0..colors.len()).flat_map(opacity).collect(),
        unit_distance: 1.0,
        ..TransferFunction::default()
    }
}

fn frame(transfer: &TransferFunction) -> Result<FrameSettings, Box<dyn std::error::Error>> {
    let geometry = Geometry { origin: DVec3::splat(0.5), ..Geometry::default() };
    let edge = EDGE as f64;
    let middle = DVec3::splat(edge / 2.0);
    let camera = Camera {
        eye: middle + DVec3::new(0.45, -1.0, 0.4) * edge * 2.0,
        target: middle,
        up: DVec3::Z,
        projection: Projection::Perspective { fov_y_deg: 24.0 },
    };
    let encoding = SlotEncoding::new(VoxelType::U8, (0.0, 255.0), false);
    Ok(FrameSettings {
        rays: camera.rays(SIZE_PX, SIZE_PX)?,
        lattice: Lattice::uniform(STEP, 0),
        geometry,
        placement: Placement::default(),
        encoding,
        table: TransferTable::new(transfer, &encoding).into(),
        mode: Mode::Dvr,
        surfaces: Vec::new(),
        sampling: Sampling::default(),
        lighting: Lighting::default(),
        background: [0.0; 3],
        clip: Some(Clip::new(Some([DVec3::new(0.0, edge / 2.0, 0.0), DVec3::splat(edge)]), &[])?),
        meshes: Vec::new(),
        caps: false,
        keeps_extremes: false,
    })
}

fn classify(transfer: &TransferFunction, value: f64) -> Classified {
    let ([r, g, b], alpha) = (transfer.rgb(value), transfer.alpha(value));
    [r * alpha, g * alpha, b * alpha, alpha]
}

/// Composites front to back along every ray, by the frame's lattice.
fn picture(frame: &FrameSettings, classified: &dyn Fn(DVec3) -> Classified) -> Picture {
    let (low, high) = frame.shown_box(Extent::new(EDGE, EDGE, EDGE));
    let mut rgb = Vec::new();
    for y in 0..SIZE_PX {
        for x in 0..SIZE_PX {
            let ray = frame.rays.ray(x as f64 + 0.5, y as f64 + 0.5);
            let (origin, direction) = (frame.geometry.voxel_from_world(ray.origin), ray.direction);
            let (a, b) = ((low - origin) / direction, (high - origin) / direction);
            let (t_in, t_out) = (a.min(b).max_element().max(0.0), a.max(b).min_element());
            let (mut color, mut light) = ([0.0; 3], 1.0);
            if t_in < t_out {
                for segment in frame.lattice.segments(t_in, t_out) {
                    let [r, g, b, alpha] = classified(origin + direction * segment.middle());
                    if alpha > 0.0 {
                        let collected = 1.0 - (1.0 - alpha).powf(segment.length());
                        let share = light * collected / alpha;
                        [r, g, b].iter().zip(&mut color).for_each(|(c, sum)| *sum += share * c);
                        light *= 1.0 - collected;
                    }
                }
            }
            rgb.push(Picture::quantise(color.map(|c| c as f32)));
        }
    }
    Picture { width: SIZE_PX, height: SIZE_PX, rgb }
}

/// Writes two pictures side by side, with a line of gray between.
fn write(path: &Path, left: &Picture, right: &Picture) -> Result<(), Box<dyn std::error::Error>> {
    let rows = left.rgb.chunks(SIZE_PX as usize).zip(right.rgb.chunks(SIZE_PX as usize));
    let bytes: Vec<u8> =
        rows.flat_map(|(left, right)| left.iter().chain([&[96; 3]; 4]).chain(right)).flatten().copied().collect();
    let mut encoder = png::Encoder::new(std::fs::File::create(path)?, 2 * SIZE_PX + 4, SIZE_PX);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(png::Compression::High);
    encoder.write_header()?.write_image_data(&bytes)?;
    Ok(())
}
