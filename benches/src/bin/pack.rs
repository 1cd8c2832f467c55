//! The cost of packing beyond compression: CPU and wall time of `pack`, over those of one bare compression pass over
//! the same level-0 bricks with the same codec, measured in one run; and the peak of anonymous memory.
//!
//! ```text
//! cargo run --release -p brickyard-benches --bin pack -- FILE X,Y,Z DTYPE [CODEC] [MEMORY_MIB] [THREADS]
//! ```
//!
//! The bare pass gathers 64 bricks at a time (untimed) and then encodes them (timed), for pure compression time. The
//! store is written beside the file and removed.

use brickyard_benches::{Timing, in_parallel, time};
use brickyard_import::{RawLayout, RawSource, Source};
use brickyard_store::{BrickCodec, Codec, PackOptions, Scratch, pack};
use brickyard_volume::{BrickIndex, Extent, Level, Pyramid, VoxelType};
use std::error::Error;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

fn main() -> Result<(), Box<dyn Error>> {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let [file, shape, dtype, rest @ ..] = &args[..] else {
        return Err("usage: pack FILE X,Y,Z DTYPE [CODEC] [MEMORY_MIB] [THREADS]".into());
    };
    let shape = shape.split(',').map(str::parse).collect::<Result<Vec<u32>, _>>()?;
    let shape: [u32; 3] = shape.try_into().map_err(|_| "the shape is X,Y,Z")?;
    let voxel_type: VoxelType = dtype.parse()?;
    let mut options = PackOptions::new(voxel_type);
    if let Some(codec) = rest.first() {
        options.codec = codec.parse::<Codec>()?;
    }
    if let Some(mib) = rest.get(1) {
        options.memory_bytes = mib.parse::<u64>()? << 20;
    }
    if let Some(threads) = rest.get(2) {
        options.threads = threads.parse()?;
    }
    let path = PathBuf::from(file);
    let source = RawSource::open(&path, &RawLayout::new(Extent::from_array(shape), voxel_type))?;

    let base = anonymous_kib();
    let packing = |threads| -> Result<_, Box<dyn Error>> {
        let store = path.with_extension("bench.zarr");
        let _ = std::fs::remove_dir_all(&store);
        let options = PackOptions { threads, ..options.clone() };
        let (result, peak_kib, cost) = with_peak(|| pack(&source, &store, &options, &()));
        std::fs::remove_dir_all(&store)?;
        Ok((result?, peak_kib, cost))
    };
    // Once untimed, for the page cache and first-run allocations.
    packing(options.threads)?;
    println!("{file} {shape:?} {voxel_type} {} --memory {} MiB", options.codec, options.memory_bytes >> 20);
    let mut counts = vec![1, options.threads];
    counts.dedup();
    for threads in counts {
        let bare = bare_pass(&source, &options, threads)?;
        let (report, peak_kib, cost) = packing(threads)?;
        println!(
            "{threads} threads: bare CPU {:.2} s, wall {:.2} s; pack CPU {:.2} s, wall {:.2} s; ratio of CPU {:.2}, of wall \
             {:.2}; {} MiB written",
            bare.cpu_s,
            bare.wall_s,
            cost.cpu_s,
            cost.wall_s,
            cost.cpu_s / bare.cpu_s,
            cost.wall_s / bare.wall_s,
            report.written_bytes >> 20,
        );
        println!(
            "  anonymous memory: peak {} MiB (before {}), planned {} MiB, scratch {} MiB",
            peak_kib >> 10,
            base >> 10,
            report.plan.memory_bytes >> 20,
            report.plan.scratch_bytes >> 20
        );
    }
    Ok(())
}

/// Encodes every whole level-0 brick, and nothing else.
fn bare_pass(source: &dyn Source, options: &PackOptions, threads: usize) -> Result<Timing, Box<dyn Error>> {
    let info = source.info();
    let pyramid = Pyramid::new(info.extent, [1.0; 3], options.edge);
    let codec = BrickCodec::new(options.codec, info.voxel_type, options.edge);
    let grid = pyramid.levels()[0].bricks;
    let indices: Vec<BrickIndex> = (0..grid.z)
        .flat_map(|z| (0..grid.y).flat_map(move |y| (0..grid.x).map(move |x| BrickIndex::new(x, y, z))))
        .filter(|&index| pyramid.brick_box(Level(0), index).extent().volume() == (options.edge as u64).pow(3))
        .collect();
    let mut bricks = vec![vec![0; codec.core_bytes()]; 64];
    let mut total = Timing { wall_s: 0.0, cpu_s: 0.0 };
    for batch in indices.chunks(bricks.len()) {
        for (&index, core) in batch.iter().zip(&mut bricks) {
            source.read_box(0, 0, pyramid.brick_box(Level(0), index), core)?;
        }
        let encode = || {
            let (mut scratch, mut encoded) = (Scratch::default(), Vec::new());
            let (bricks, codec) = (&bricks, &codec);
            move |i: usize| {
                encoded.clear();
                codec.encode(&mut scratch, &bricks[i], &mut encoded);
                Ok::<_, std::convert::Infallible>(())
            }
        };
        let (timing, result) = time(|| in_parallel(threads, batch.len(), encode));
        result?;
        total = Timing { wall_s: total.wall_s + timing.wall_s, cpu_s: total.cpu_s + timing.cpu_s };
    }
    Ok(total)
}

/// Runs `work` and samples the process's anonymous memory every millisecond.
fn with_peak<R>(work: impl FnOnce() -> R) -> (R, u64, Timing) {
    let (done, peak) = (AtomicBool::new(false), AtomicU64::new(0));
    let (cost, result) = std::thread::scope(|scope| {
        scope.spawn(|| {
            while !done.load(Ordering::Relaxed) {
                peak.fetch_max(anonymous_kib(), Ordering::Relaxed);
                std::thread::sleep(Duration::from_millis(5));
            }
        });
        let result = time(work);
        done.store(true, Ordering::Relaxed);
        result
    });
    (result, peak.into_inner(), cost)
}

fn anonymous_kib() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("RssAnon:"));
    line.and_then(|value| value.trim().trim_end_matches(" kB").parse().ok()).unwrap_or(0)
}
