//! CPU milliseconds and samples per CPU-second of a 512x512 picture of 256^3 voxels in bricks of 64^3, for several
//! modes, and the best wall time of a frame with one and with two threads; and of three channels, alternating with
//! their single pictures. The pictures go into a folder (Linux): `cargo run --release -p brickyard-software --example
//! cpu_speed -- FOLDER [ONLY]`, where `ONLY` is part of a case's name.

#[path = "../../../tests/conformance/list.rs"]
#[allow(dead_code, reason = "tests draw in more ways with it")]
mod list;
#[path = "../../../tests/conformance/volume.rs"]
#[allow(dead_code, reason = "tests draw in more ways with it")]
mod volume;

use brickyard_pager::{DrawList, Layer, Slot};
use brickyard_software::{SoftwareOptions, SoftwareRenderer};
use brickyard_volume::*;
use glam::DVec3;
use list::finest;
use std::time::Instant;
use volume::Volume;

const SIZE_PX: u32 = 512;
const FRAMES: u32 = 8;

fn main() -> std::io::Result<()> {
    let folder = std::path::PathBuf::from(std::env::args().nth(1).unwrap_or(".".to_string()));
    for voxel_type in [VoxelType::U8, VoxelType::U16] {
        let encoding = SlotEncoding::new(voxel_type, (0.0, 1.0), false);
        let channel = |i: usize| {
            let moved = DVec3::new(7.0, -5.0, 3.0) * i as f64;
            Volume::new([256; 3], 64, Geometry::default(), encoding, |p| encoding.value(shells(p + moved)))
        };
        let channels = [0, 1, 2].map(channel);
        for (name, mode, opacity) in [
            ("opaque", Mode::Dvr, vec![[0.35, 0.0], [0.45, 0.7], [1.0, 0.9]]),
            ("fog", Mode::Dvr, vec![[0.0, 0.0005], [1.0, 0.01]]),
            ("mip", Mode::Mip, vec![[0.0, 1.0]]),
            ("average", Mode::Average, vec![[0.0, 1.0]]),
            ("surface", Mode::Isosurface, vec![[0.0, 1.0]]),
        ] {
            if !std::env::args().nth(2).is_none_or(|only| format!("{voxel_type} {name}").contains(&only)) {
                continue;
            }
            let frames = channels.each_ref().map(|volume| frame(volume, mode, opacity.clone()));
            let samples = samples(&channels[0], &frames[0]);
            for threads in [1, 2] {
                let mut scene = Scene::new(&[(&channels[0], &frames[0])], threads);
                let (wall, cpu): (Vec<_>, Vec<_>) = (0..FRAMES).map(|_| scene.measure()).unzip();
                let (wall_ms, cpu_ms) = (least(&wall), least(&cpu));
                println!(
                    "{voxel_type} {name}, {threads} threads: {:.1} M samples, wall {wall_ms:.0} ms, CPU {cpu_ms:.0} ms: {:.0} M/s",
                    samples as f64 / 1e6,
                    samples as f64 / cpu_ms / 1e3
                );
                write_png(&folder.join(format!("{voxel_type}-{name}.png")), &scene.draw())?;
            }
            let layers: Vec<_> = channels.iter().zip(&frames).collect();
            let mut singly: Vec<Scene<'_>> = layers.iter().map(|layer| Scene::new(&[*layer], 1)).collect();
            let mut together = Scene::new(&layers, 1);
            let turn = |_| (singly.iter_mut().map(|scene| scene.measure().1).sum::<f64>(), together.measure().1);
            let turns: Vec<(f64, f64)> = (0..FRAMES).map(turn).collect();
            let mut ratios: Vec<f64> = turns.iter().map(|(singly, together)| together / singly).collect();
            ratios.sort_by(f64::total_cmp);
            let ratio = ratios[ratios.len() / 2];
            let together_ms = least(&turns.iter().map(|turn| turn.1).collect::<Vec<_>>());
            println!(
                "{voxel_type} {name}, three channels: CPU {together_ms:.0} ms, {ratio:.2} times the sum of their single pictures"
            );
            let picture = together.draw();
            write_png(&folder.join(format!("{voxel_type}-{name}-three.png")), &picture)?;
        }
    }
    Ok(())
}

/// A ball of shells around an off-centre core, between 0 and 1.
fn shells(p: DVec3) -> f64 {
    let r = (p - DVec3::new(120.0, 130.0, 125.0)).length() / 128.0;
    let ripple = 0.5 + 0.25 * (r * 25.0).cos() + 0.25 * (p.x * 0.11).sin() * (p.y * 0.13).sin() * (p.z * 0.09).sin();
    (ripple * (1.3 - r)).clamp(0.0, 1.0)
}

/// The whole volume in view, with samples a voxel apart.
fn frame(volume: &Volume, mode: Mode, opacity: Vec<[f64; 2]>) -> FrameSettings {
    let value = |t: f64| volume.encoding.value(t);
    let colors = [[0.0, 0.1, 0.1, 0.4], [0.5, 0.9, 0.4, 0.2], [1.0, 1.0, 1.0, 0.8]];
    let transfer = TransferFunction {
        color: colors.map(|[t, r, g, b]| [value(t), r, g, b]).to_vec(),
        opacity: opacity.into_iter().map(|[t, a]| [value(t), a]).collect(),
        unit_distance: 1.25,
        ..TransferFunction::default()
    };
    let camera = Camera::looking_at_box(volume.geometry.world_box(Extent::new(256, 256, 256)));
    let projection = Projection::Perspective { fov_y_deg: 24.0 };
    let rays = Camera { projection, ..camera }.rays(SIZE_PX, SIZE_PX).unwrap();
    let surfaces = match mode {
        Mode::Isosurface => Surface::all(&[Isosurface::at(value(0.4))], &transfer, &volume.encoding),
        _ => Vec::new(),
    };
    FrameSettings { mode, surfaces, background: [0.0; 3], ..volume.frame(rays, &transfer, Lattice::uniform(1.0, 0)) }
}

/// Layers drawn together.
struct Scene<'a> {
    renderer: SoftwareRenderer,
    volumes: Vec<&'a Volume>,
    drawn: Vec<(VolumeFrame, DrawList)>,
}

impl<'a> Scene<'a> {
    fn new(layers: &[(&'a Volume, &FrameSettings)], threads: usize) -> Self {
        let needs: Vec<_> = layers.iter().map(|(volume, frame)| volume.needs(&frame.needs())).collect();
        let options =
            SoftwareOptions { memory_bytes: 1 << 30, max_picture_px: [SIZE_PX, SIZE_PX], threads, skips_empty: true };
        let mut renderer = SoftwareRenderer::new(&needs, &options).expect("a gibibyte is enough");
        let mut drawn = Vec::new();
        for (layer, (volume, frame)) in layers.iter().enumerate() {
            let mut list = finest(volume, frame);
            // The layers' bricks alternate: they share slots.
            for cell in &mut list.cells {
                cell.slot = Slot(cell.slot.0 * layers.len() as u32 + layer as u32);
                renderer.upload(layer, cell.slot, volume.padded(cell.brick, &frame.needs())).expect("a slot");
            }
            drawn.push((VolumeFrame::alone((*frame).clone()), list));
        }
        Self { renderer, volumes: layers.iter().map(|layer| layer.0).collect(), drawn }
    }

    fn draw(&mut self) -> Picture {
        let layers: Vec<Layer<'_>> = (self.volumes.iter().zip(&self.drawn).enumerate())
            .map(|(i, (volume, (frame, draw)))| Layer { volume: i, frame, pyramid: &volume.pyramid, draw, cut: 0 })
            .collect();
        self.renderer.render(&layers, None).expect("a picture")
    }

    /// Draws the scene; returns wall and CPU time in milliseconds.
    fn measure(&mut self) -> (f64, f64) {
        let (start, cpu_start) = (Instant::now(), cpu_ms());
        self.draw();
        (start.elapsed().as_secs_f64() * 1e3, cpu_ms() - cpu_start)
    }
}

fn least(times: &[f64]) -> f64 {
    times.iter().copied().fold(f64::INFINITY, f64::min)
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

/// The samples of a frame: all of a ray's, up to early termination.
fn samples(volume: &Volume, frame: &FrameSettings) -> u64 {
    let mut count = 0;
    for (x, y) in (0..SIZE_PX).flat_map(|y| (0..SIZE_PX).map(move |x| (x, y))) {
        let ray = frame.rays.ray(x as f64 + 0.5, y as f64 + 0.5);
        let (low, high) = frame.geometry.world_box(volume.pyramid.levels()[0].extent);
        let (a, b) = ((low - ray.origin) / ray.direction, (high - ray.origin) / ray.direction);
        let (t_in, t_out) = (a.min(b).max_element(), a.max(b).min_element());
        let mut passed = 1.0;
        for s in frame.lattice.segments(t_in, t_out) {
            count += 1;
            if frame.mode == Mode::Dvr {
                let voxel = frame.geometry.voxel_from_world(ray.origin + ray.direction * s.middle());
                let nearest = voxel.to_array().map(|v| v as u32);
                let value = volume.levels[0].values[volume.levels[0].extent.linear(nearest) as usize];
                let unorm = (value - volume.encoding.low) / (volume.encoding.high - volume.encoding.low);
                let alpha = frame.table.lookup(unorm as f32)[3];
                passed *= (1.0 - alpha as f64).powf(s.length() / frame.table.unit_distance as f64);
                if passed < 1.0 / 4096.0 {
                    break;
                }
            }
        }
    }
    count
}

fn write_png(path: &std::path::Path, picture: &Picture) -> std::io::Result<()> {
    let mut encoder = png::Encoder::new(std::fs::File::create(path)?, picture.width, picture.height);
    encoder.set_color(png::ColorType::Rgb);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(picture.rgb.as_flattened())?;
    Ok(())
}
