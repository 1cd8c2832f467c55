//! CPU milliseconds of a 512x512 picture of 256^3 voxels in bricks of 64^3 by each compositor, for several modes, on a
//! software rasteriser (Linux), and the GPU's own time (timestamps) if available; of one layer, and of three equal
//! channels relative to three times one: `cargo run -p brickyard-render --example gpu_speed -- [ONLY]`, where `ONLY` is
//! part of a case's name.
//!
//! Frames of all renderers take turns, so that other load affects all alike; the best of each counts.

#[path = "../../../tests/conformance/list.rs"]
#[allow(dead_code, reason = "tests draw in more ways with it")]
mod list;
#[path = "../../../tests/conformance/volume.rs"]
#[allow(dead_code, reason = "tests draw in more ways with it")]
mod volume;

use brickyard_pager::{DrawList, Layer};
use brickyard_render::{Compositor, GpuOptions, GpuRenderer};
use brickyard_volume::*;
use glam::DVec3;
use list::finest;
use volume::Volume;

const SIZE_PX: u32 = 512;
const FRAMES: u32 = 6;

fn main() {
    let encoding = SlotEncoding::new(VoxelType::U8, (0.0, 1.0), false);
    let cube = |f: fn(DVec3) -> f64| Volume::new([256; 3], 64, Geometry::default(), encoding, move |p| 255.0 * f(p));
    let only = std::env::args().nth(1);
    let wanted = |name: &str| only.as_ref().is_none_or(|only| name.contains(only));
    for (what, field, cases) in [
        (
            "shells",
            shells as fn(DVec3) -> f64,
            vec![
                ("opaque", Mode::Dvr, vec![[0.35, 0.0], [0.45, 0.7], [1.0, 0.9]]),
                ("fog", Mode::Dvr, vec![[0.0, 0.0005], [1.0, 0.01]]),
                ("thin", Mode::Dvr, vec![[0.60, 0.0], [0.62, 0.02], [0.64, 0.0]]),
                ("mip", Mode::Mip, vec![[0.0, 1.0]]),
                ("minip", Mode::MinIp, vec![[0.0, 1.0]]),
                ("average", Mode::Average, vec![[0.0, 1.0]]),
            ],
        ),
        (
            "vessels",
            vessels,
            vec![("sparse", Mode::Dvr, vec![[0.3, 0.0], [0.5, 0.05]]), ("sparse-mip", Mode::Mip, vec![])],
        ),
    ] {
        if !cases.iter().any(|(name, ..)| wanted(name)) {
            continue;
        }
        let volume = cube(field);
        for (name, mode, opacity) in cases.into_iter().filter(|(name, ..)| wanted(name)) {
            measure(&volume, &format!("{what} {name}"), mode, opacity);
        }
    }
}

/// A ball of shells around an off-centre core, between 0 and 1.
fn shells(p: DVec3) -> f64 {
    let r = (p - DVec3::new(120.0, 130.0, 125.0)).length() / 128.0;
    let ripple = 0.5 + 0.25 * (r * 25.0).cos() + 0.25 * (p.x * 0.11).sin() * (p.y * 0.13).sin() * (p.z * 0.09).sin();
    (ripple * (1.3 - r)).clamp(0.0, 1.0)
}

/// Four winding tubes of 3 voxels' radius in an empty cube: a hundredth of it.
fn vessels(p: DVec3) -> f64 {
    let tube = |phase: f64| {
        let centre = DVec3::new(
            128.0 + 90.0 * (p.z * 0.03 + phase).sin(),
            128.0 + 90.0 * (p.z * 0.021 + 2.0 * phase).cos(),
            p.z,
        );
        (1.5 - (p - centre).length() / 4.0).clamp(0.0, 1.0)
    };
    [0.0, 1.7, 3.1, 4.9].map(tube).into_iter().fold(0.0, f64::max)
}

fn measure(volume: &Volume, name: &str, mode: Mode, opacity: Vec<[f64; 2]>) {
    let value = |t: f64| 255.0 * t;
    let colors = [[0.0, 0.1, 0.1, 0.4], [0.5, 0.9, 0.4, 0.2], [1.0, 1.0, 1.0, 0.8]];
    let opacity = if opacity.is_empty() { vec![[0.0, 1.0]] } else { opacity };
    let transfer = TransferFunction {
        color: colors.map(|[t, r, g, b]| [value(t), r, g, b]).to_vec(),
        opacity: opacity.into_iter().map(|[t, a]| [value(t), a]).collect(),
        unit_distance: 1.25,
        ..TransferFunction::default()
    };
    let projection = Projection::Perspective { fov_y_deg: 24.0 };
    let camera = Camera::looking_at_box(volume.geometry.world_box(Extent::new(256, 256, 256)));
    let rays = Camera { projection, ..camera }.rays(SIZE_PX, SIZE_PX).expect("a camera");
    let frame = VolumeFrame::alone(volume.frame_in(mode, rays, &transfer, Lattice::uniform(1.0, 0)));
    let ways = [Compositor::Sorted, Compositor::Raycast].into_iter().flat_map(|way| [(way, 1), (way, 3)]);
    let mut stages: Vec<Stage> = ways.map(|(way, layers)| Stage::new(volume, &frame, way, layers)).collect();
    for _ in 0..FRAMES {
        stages.iter_mut().for_each(|stage| stage.draw(volume, &frame));
    }
    for [one, three] in stages.as_chunks().0 {
        println!(
            "{name}, {}: {} cells, {:.0} CPU-ms ({:.0} ms); three {:.0} CPU-ms ({:.0} ms), {:.2} times their sum",
            one.renderer.compositor().name(),
            one.list.cells.len(),
            one.best.0,
            one.best.1,
            three.best.0,
            three.best.1,
            three.best.0 / one.best.0 / 3.0
        );
    }
    let pictures = stages.as_chunks().0.iter().map(|[one, _]| one.picture.as_ref().expect("a picture"));
    let [sorted, raycast] = pictures.collect::<Vec<_>>()[..] else { return };
    println!("{name}: pictures within {}/255", sorted.difference(raycast).max);
}

/// A renderer of equal layers of one volume, and its best times so far.
struct Stage {
    renderer: GpuRenderer,
    layers: usize,
    list: DrawList,
    /// CPU milliseconds and those of the frame.
    best: (f64, f64),
    picture: Option<Picture>,
}

impl Stage {
    fn new(volume: &Volume, frame: &VolumeFrame, compositor: Compositor, layers: usize) -> Self {
        let (options, settings) = (GpuOptions { compositor, ..Default::default() }, &frame.settings);
        let bricks = Needs { apron: 2, ..Needs::PLAIN };
        let needs = vec![volume.needs(&bricks); layers];
        let mut renderer = GpuRenderer::new(&options, &needs, 256 << 20, (SIZE_PX, SIZE_PX)).expect("an adapter");
        let mut list = finest(volume, settings);
        for cell in &list.cells {
            renderer.upload(0, cell.slot, &volume.padded(cell.brick, &bricks)).expect("the slot is there");
        }
        if settings.mode == Mode::Dvr {
            cull(volume, &settings.table, &mut list);
        }
        Self { renderer, layers, list, best: (f64::INFINITY, f64::INFINITY), picture: None }
    }

    fn draw(&mut self, of: &Volume, frame: &VolumeFrame) {
        let layer = |volume| Layer { volume, frame, pyramid: &of.pyramid, draw: &self.list, cut: 0 };
        let layers: Vec<Layer<'_>> = (0..self.layers).map(layer).collect();
        let start = cpu_ms();
        self.picture = Some(self.renderer.render(&layers, None).expect("a picture"));
        self.best = (self.best.0.min(cpu_ms() - start), self.best.1.min(self.renderer.last_frame_ms()));
    }
}

/// Leaves out the same bricks as the cut: those without opacity.
fn cull(volume: &Volume, table: &TransferTable, list: &mut DrawList) {
    let level = &volume.levels[0];
    list.cells.retain(|cell| {
        let (low, high) = (cell.region.min.to_array(), cell.region.max.to_array());
        let mut voxels = (low[2]..high[2])
            .flat_map(|z| (low[1]..high[1]).map(move |y| (y, z)))
            .flat_map(|(y, z)| (low[0]..high[0]).map(move |x| [x, y, z]));
        voxels.any(|v| {
            let unorm = (level.values[level.extent.linear(v) as usize] - volume.encoding.low) / 255.0;
            table.lookup(unorm as f32)[3] > 0.0
        })
    });
}

/// CPU time of all threads of this process so far, from `/proc`.
fn cpu_ms() -> f64 {
    let threads = std::fs::read_dir("/proc/self/task").expect("Linux");
    let run_ns = threads.map(|thread| {
        let path = thread.expect("a thread").path().join("schedstat");
        let text = std::fs::read_to_string(path).expect("scheduler statistics");
        text.split_whitespace().next().and_then(|n| n.parse::<u64>().ok()).expect("a number")
    });
    run_ns.sum::<u64>() as f64 / 1e6
}
