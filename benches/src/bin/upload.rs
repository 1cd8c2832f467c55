//! Uploads of padded bricks: to the CPU backend's slots (which scan every code for macro-cells), and to the GPU's atlas for either
//! compositor, if there is an adapter.
//!
//! ```text
//! cargo run --release -p brickyard-benches --bin upload -- --bricks 256
//! ```
//!
//! The bricks are noise, so that uniformity speeds nothing up. GPU uploads continue beside the loop, but at most two batches, so a rate
//! over many batches is the throughput. Prints a Markdown table, medians over repetitions.

use brickyard_benches::{Timing, markdown, median, time};
use brickyard_pager::{Slot, VolumeNeeds};
use brickyard_render::{Compositor, GpuError, GpuOptions, GpuRenderer};
use brickyard_software::{SoftwareOptions, SoftwareRenderer};
use brickyard_volume::{Needs, SlotEncoding, VoxelType};
use clap::Parser;
use std::sync::Arc;

/// Padded bricks into slots of either backend
#[derive(Parser)]
struct Arguments {
    /// Bricks uploaded in a repetition
    #[arg(long, default_value_t = 256)]
    bricks: u32,
    #[arg(long, default_value_t = 5)]
    repetitions: usize,
}

const EDGE: u32 = 64;
const PICTURE_PX: (u32, u32) = (512, 512);
const MEMORY_BYTES: u64 = 256 << 20;

/// A destination of uploads.
enum Slots {
    Cpu(Box<SoftwareRenderer>),
    Gpu(Box<GpuRenderer>),
}

impl Slots {
    /// Every available backend and compositor.
    fn all(encoding: SlotEncoding) -> Result<Vec<(String, Self)>, String> {
        let needs = VolumeNeeds {
            encoding,
            edge: EDGE,
            levels: 16,
            bricks: Needs::PLAIN,
            least_slots: 2,
            most_slots: u32::MAX,
        };
        let max_picture_px = PICTURE_PX.into();
        let options = SoftwareOptions { memory_bytes: MEMORY_BYTES, max_picture_px, threads: 1, skips_empty: true };
        let cpu = SoftwareRenderer::new(&[needs], &options);
        let mut all = vec![("cpu".into(), Self::Cpu(Box::new(cpu.map_err(|error| error.to_string())?)))];
        for compositor in [Compositor::Sorted, Compositor::Raycast] {
            let options = GpuOptions { compositor, ..Default::default() };
            match GpuRenderer::new(&options, &[needs], MEMORY_BYTES, PICTURE_PX) {
                Ok(gpu) => all.push((format!("gpu, {}", compositor.name()), Self::Gpu(Box::new(gpu)))),
                Err(GpuError::NoAdapter { .. }) => eprintln!("no graphics adapter: the GPU backend is left out"),
                Err(error) => return Err(error.to_string()),
            }
        }
        Ok(all)
    }

    fn count(&self) -> u32 {
        match self {
            Self::Cpu(renderer) => renderer.slots(0),
            Self::Gpu(renderer) => renderer.slots(0),
        }
    }

    fn upload(&mut self, slot: Slot, codes: &Arc<[u8]>) -> Result<(), String> {
        match self {
            Self::Cpu(renderer) => drop(renderer.upload(0, slot, codes.clone()).map_err(|error| error.to_string())?),
            Self::Gpu(renderer) => renderer.upload(0, slot, codes).map_err(|error| error.to_string())?,
        }
        Ok(())
    }
}

/// Padded bricks of noise, eight in turn: more than a core's own caches hold.
fn noise(code_bytes: usize) -> Vec<Arc<[u8]>> {
    let mut state = 1u64;
    let mut next = || {
        state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
        (state >> 56) as u8
    };
    let bytes = ((EDGE + 2 * Needs::PLAIN.apron) as usize).pow(3) * code_bytes;
    (0..8).map(|_| (0..bytes).map(|_| next()).collect()).collect()
}

fn main() -> Result<(), String> {
    let arguments = Arguments::parse();
    let mut rows = Vec::new();
    for voxel_type in [VoxelType::U8, VoxelType::U16] {
        let encoding = SlotEncoding::new(voxel_type, (0.0, 1.0), false);
        let bricks = noise(encoding.format.bytes());
        let mut backends = Slots::all(encoding)?;
        let mut timings: Vec<Vec<Timing>> = vec![Vec::new(); backends.len()];
        for _ in 0..arguments.repetitions {
            for ((_, slots), timings) in backends.iter_mut().zip(&mut timings) {
                let count = slots.count();
                let (timing, result) = time(|| {
                    (0..arguments.bricks)
                        .try_for_each(|i| slots.upload(Slot(i % count), &bricks[i as usize % bricks.len()]))
                });
                result?;
                timings.push(timing);
            }
        }
        for ((name, _), timings) in backends.iter().zip(&timings) {
            let n = arguments.bricks as f64;
            let wall_s = median(timings.iter().map(|t| t.wall_s)) / n;
            let cpu_s = median(timings.iter().map(|t| t.cpu_s)) / n;
            let mib = bricks[0].len() as f64 / (1 << 20) as f64;
            rows.push(vec![
                voxel_type.to_string(),
                name.clone(),
                format!("{:.0}", 1.0 / wall_s),
                format!("{:.0}", mib / wall_s),
                format!("{:.0}", cpu_s * 1e6),
            ]);
        }
    }
    println!("{}", markdown(&["codes", "into", "bricks/s", "MiB/s", "CPU µs a brick"], &rows));
    Ok(())
}
