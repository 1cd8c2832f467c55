//! Reading a brick store, beside the bare codec on the same bytes, in one run.
//!
//! ```text
//! bare codec   encoded bricks held in RAM, plain Zstandard (and unshuffling): the yardstick
//! read_core    Store::read_core of the same bricks
//! padded       PaddedReader with an apron of 1 through a RAM cache of 256 MiB, in a sweep along a Morton curve
//! boxes        Store::read_box of random brick-sized boxes, on the brick grid and off it
//! ```
//!
//! Bricks are the stored ones of level 0, along a Morton curve. The curve is cut into four slices, and all cases work on a
//! slice before any goes on to the next: a machine of varying speed varies alike for all of them.
//!
//! Everything is read once before the clock starts: the page cache is warm, the RAM caches' buffers are allocated (they hold
//! the end of the last sweep, useless at the start of the next in a larger volume), and the decoded bytes have been
//! compared. Prints a Markdown table, then one line of JSON.

use brickyard_benches::bare::EncodedBricks;
use brickyard_benches::boxes::{Placement, random_box};
use brickyard_benches::{Timing, in_parallel, markdown, median, time};
use brickyard_import::{SynthKind, SynthSource};
use brickyard_pager::{BrickSource, PaddedReader, RamCache};
use brickyard_store::Store;
use brickyard_store::pack::{PackOptions, pack};
use brickyard_volume::{BrickId, BrickIndex, Extent, Level, VoxelBox, VoxelType};
use clap::Parser;
use serde_json::{Value, json};
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use std::sync::Arc;

const APRON: u32 = 1;
const CACHE_BYTES: u64 = 256 << 20;
const SLICES: usize = 4;

/// Reading a brick store, beside the bare codec on the same bytes
#[derive(Parser)]
struct Arguments {
    /// A packed store [default: a synthetic scan, made once under target/bench]
    store: Option<PathBuf>,
    /// Voxels along each axis of the synthetic scan
    #[arg(long, default_value_t = 1024)]
    extent: u32,
    /// Voxel type of the synthetic scan: u8 or u16
    #[arg(long, default_value = "u8")]
    dtype: VoxelType,
    /// Repetitions of every measurement
    #[arg(long, default_value_t = 5)]
    repetitions: usize,
    /// Most bricks, along the curve
    #[arg(long, default_value_t = 4096)]
    bricks: usize,
    /// Random boxes
    #[arg(long, default_value_t = 512)]
    boxes: usize,
    /// Seed of the random boxes
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Only the random boxes, for a comparison with other readers
    #[arg(long)]
    boxes_only: bool,
}

fn main() -> ExitCode {
    match run(&Arguments::parse()) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("read: {error}");
            ExitCode::FAILURE
        }
    }
}

fn run(arguments: &Arguments) -> Result<(), String> {
    let path = match &arguments.store {
        Some(path) => path.clone(),
        None => synthetic(arguments.extent, arguments.dtype)?,
    };
    let bench = Bench::new(Store::open(path).map_err(text)?, arguments)?;
    let boxes_crc32 = bench.check()?;
    let cases: Vec<Case> = cases().into_iter().filter(|c| c.task.is_box() || !arguments.boxes_only).collect();
    let mut rounds = Vec::new();
    for _ in 0..arguments.repetitions.max(1) {
        rounds.push(bench.round(&cases)?);
    }
    let results: Vec<Value> = (0..cases.len()).map(|i| bench.result(&cases, &rounds, i)).collect();
    bench.print(&results);
    let info = bench.store.info();
    println!(
        "{}",
        json!({
            "store": bench.store.path(), "dtype": info.voxel_type.name(), "codec": info.codec.to_string(),
            "edge": info.edge, "bricks": bench.ids.len(), "encoded_bytes": bench.encoded.encoded_bytes(),
            "boxes": arguments.boxes, "seed": arguments.seed, "boxes_crc32": boxes_crc32,
            "repetitions": rounds.len(), "cases": results,
        })
    );
    Ok(())
}

/// The measured operations.
#[derive(Clone, Copy, PartialEq)]
enum Task {
    Bare,
    Core,
    Padded,
    Boxes(Placement),
}

impl Task {
    fn is_box(self) -> bool {
        matches!(self, Self::Boxes(_))
    }

    fn name(self) -> &'static str {
        match self {
            Self::Bare => "bare codec",
            Self::Core => "read_core",
            Self::Padded => "padded",
            Self::Boxes(Placement::Aligned) => "boxes aligned",
            Self::Boxes(Placement::Offset) => "boxes offset",
        }
    }
}

struct Case {
    task: Task,
    threads: usize,
    /// Least wall rate, as a multiple of the bare codec's with one thread.
    goal: Option<f64>,
}

fn cases() -> Vec<Case> {
    let case = |task, threads, goal| Case { task, threads, goal };
    let mut cases = vec![
        case(Task::Bare, 1, None),
        case(Task::Core, 1, Some(0.9)),
        case(Task::Padded, 1, Some(0.6)),
        case(Task::Bare, 2, None),
        case(Task::Core, 2, Some(0.9 * 1.8)),
        case(Task::Padded, 2, None),
    ];
    for placement in [Placement::Aligned, Placement::Offset] {
        cases.extend([1, 2].map(|threads| case(Task::Boxes(placement), threads, None)));
    }
    cases
}

/// One case in one round.
#[derive(Clone, Copy)]
struct Sample {
    timing: Timing,
    /// Delivered bricks or boxes.
    items: usize,
    /// Cores decoded for them by the RAM cache.
    decoded: u64,
}

struct Bench {
    store: Arc<Store>,
    ids: Vec<BrickId>,
    encoded: EncodedBricks,
    /// For the sweeps with one thread and with two.
    caches: [Arc<RamCache>; 2],
    boxes: usize,
    seed: u64,
}

impl Bench {
    fn new(store: Store, arguments: &Arguments) -> Result<Self, String> {
        let edge = store.info().edge;
        if store.pyramid().level(Level(0)).extent.to_array().iter().any(|&n| n < edge) {
            return Err(format!("{}: every axis must have at least {edge} voxels", store.path().display()));
        }
        let ids = morton(&store, if arguments.boxes_only { 0 } else { arguments.bricks })?;
        let encoded = EncodedBricks::load(&store, &ids)?;
        let store = Arc::new(store);
        let cache = || {
            let source: Arc<dyn BrickSource> = store.clone();
            RamCache::new(source, APRON, CACHE_BYTES).map(Arc::new).map_err(text)
        };
        let caches = [cache()?, cache()?];
        Ok(Self { store, ids, encoded, caches, boxes: arguments.boxes, seed: arguments.seed })
    }

    fn box_of(&self, i: usize, placement: Placement) -> VoxelBox {
        let extent = self.store.pyramid().level(Level(0)).extent;
        random_box(self.seed, i as u64, extent, self.store.info().edge, placement)
    }

    fn read_box(&self, region: VoxelBox, out: &mut [u8]) -> Result<(), String> {
        self.store.read_box(0, 0, Level(0), region, out).map_err(text)
    }

    /// Reads everything once: the bare codec and the store must agree on every brick. Returns the CRC-32 of the bytes of all
    /// boxes, first aligned, then offset.
    fn check(&self) -> Result<u32, String> {
        let mut decoder = self.encoded.decoder();
        let (mut bare, mut core) = (vec![0; self.store.core_bytes()], vec![0; self.store.core_bytes()]);
        for (i, &id) in self.ids.iter().enumerate() {
            decoder.decode(i, &mut bare)?;
            self.store.read_core(id, &mut core).map_err(text)?;
            if bare != core {
                return Err(format!("{id}: the store and the bare codec disagree"));
            }
        }
        for threads in [1, 2] {
            self.run(&Case { task: Task::Padded, threads, goal: None }, 0..self.ids.len())?;
        }
        let mut crc = flate2::Crc::new();
        for placement in [Placement::Aligned, Placement::Offset] {
            for i in 0..self.boxes {
                self.read_box(self.box_of(i, placement), &mut core)?;
                crc.update(&core);
            }
        }
        Ok(crc.sum())
    }

    /// Runs every case once.
    fn round(&self, cases: &[Case]) -> Result<Vec<Sample>, String> {
        let none = Sample { timing: Timing { wall_s: 0.0, cpu_s: 0.0 }, items: 0, decoded: 0 };
        let mut samples = vec![none; cases.len()];
        for slice in 0..SLICES {
            for (case, sample) in cases.iter().zip(&mut samples) {
                let items = if case.task.is_box() { self.boxes } else { self.ids.len() };
                let range = items * slice / SLICES..items * (slice + 1) / SLICES;
                let cache = &self.caches[case.threads - 1];
                let decoded = cache.counters().decoded;
                let (timing, result) = time(|| self.run(case, range.clone()));
                result?;
                sample.timing.wall_s += timing.wall_s;
                sample.timing.cpu_s += timing.cpu_s;
                sample.items += range.len();
                sample.decoded += cache.counters().decoded - decoded;
            }
        }
        Ok(samples)
    }

    /// Reads these bricks or boxes.
    fn run(&self, case: &Case, range: Range<usize>) -> Result<(), String> {
        let (first, count, threads) = (range.start, range.len(), case.threads);
        let buffer = || vec![0; self.store.core_bytes()];
        match case.task {
            Task::Bare => in_parallel(threads, count, || {
                let (mut decoder, mut out) = (self.encoded.decoder(), buffer());
                move |i| decoder.decode(first + i, &mut out)
            }),
            Task::Core => in_parallel(threads, count, || {
                let mut out = buffer();
                move |i| self.store.read_core(self.ids[first + i], &mut out).map_err(text)
            }),
            Task::Padded => in_parallel(threads, count, || {
                let mut reader = PaddedReader::new(self.caches[threads - 1].clone());
                let mut out = vec![0; reader.padded_bytes()];
                move |i| reader.read(self.ids[first + i], &mut out).map_err(text)
            }),
            Task::Boxes(placement) => in_parallel(threads, count, || {
                let mut out = buffer();
                move |i| self.read_box(self.box_of(first + i, placement), &mut out)
            }),
        }
    }

    /// Medians over the rounds; ratios are taken within each round, against the bare codec with one thread.
    fn result(&self, cases: &[Case], rounds: &[Vec<Sample>], i: usize) -> Value {
        let case = &cases[i];
        let bare = cases.iter().position(|c| c.task == Task::Bare && c.threads == 1);
        let rate = |round: &Vec<Sample>, i: usize, seconds: fn(Timing) -> f64| {
            round[i].items as f64 / seconds(round[i].timing).max(1e-9)
        };
        let over_rounds = |of: &dyn Fn(&Vec<Sample>) -> f64| median(rounds.iter().map(of));
        let ratio = |seconds: fn(Timing) -> f64| {
            bare.map(|bare| over_rounds(&|round| rate(round, i, seconds) / rate(round, bare, seconds)))
        };
        json!({
            "task": case.task.name(),
            "threads": case.threads,
            "per_s": over_rounds(&|round| rate(round, i, |t| t.wall_s)),
            "per_cpu_s": over_rounds(&|round| rate(round, i, |t| t.cpu_s)),
            "of_bare": ratio(|t| t.wall_s),
            "of_bare_cpu": ratio(|t| t.cpu_s),
            "goal": case.goal,
            "decoded_per_brick": (case.task == Task::Padded).then(|| rounds[0][i].decoded as f64 / self.ids.len() as f64),
        })
    }

    fn print(&self, results: &[Value]) {
        let info = self.store.info();
        let extent = self.store.pyramid().level(Level(0)).extent;
        println!("{extent} {} {}, bricks of {}^3, warm page cache\n", info.voxel_type, info.codec, info.edge);
        let number = |v: &Value, digits: usize| v.as_f64().map_or(String::new(), |v| format!("{v:.digits$}"));
        let row = |r: &Value| {
            vec![
                r["task"].as_str().unwrap_or_default().to_string(),
                r["threads"].to_string(),
                number(&r["per_s"], 0),
                number(&r["per_cpu_s"], 0),
                number(&r["of_bare"], 2),
                number(&r["goal"], 2),
                number(&r["of_bare_cpu"], 2),
                number(&r["decoded_per_brick"], 2),
            ]
        };
        let head = ["", "threads", "per s", "per CPU s", "of bare", "goal", "of bare, CPU", "decodes per brick"];
        println!("{}", markdown(&head, &results.iter().map(row).collect::<Vec<_>>()));
    }
}

/// The first stored bricks of level 0 along a Morton curve.
fn morton(store: &Store, count: usize) -> Result<Vec<BrickId>, String> {
    let grid = store.pyramid().level(Level(0)).bricks;
    let mut ids = Vec::new();
    for z in 0..grid.z {
        for y in 0..grid.y {
            for x in 0..grid.x {
                ids.push(BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(x, y, z) });
            }
        }
    }
    ids.sort_by_key(|id| {
        let [x, y, z] = id.index.to_array().map(spread);
        x | y << 1 | z << 2
    });
    let mut stored = Vec::new();
    for id in ids {
        if stored.len() < count && store.is_stored(id).map_err(text)? {
            stored.push(id);
        }
    }
    Ok(stored)
}

/// Moves every bit to three times its place.
fn spread(n: u32) -> u128 {
    (0..32).map(|bit| (n as u128 >> bit & 1) << (3 * bit)).sum()
}

/// A packed scan of `extent`^3 voxels, created if missing.
fn synthetic(extent: u32, voxel_type: VoxelType) -> Result<PathBuf, String> {
    let path = Path::new("target/bench").join(format!("ct-{extent}-{voxel_type}.zarr"));
    if !path.join("zarr.json").exists() {
        eprintln!("packing {}", path.display());
        std::fs::create_dir_all("target/bench").map_err(|e| format!("target/bench: {e}"))?;
        let extent = Extent::new(extent, extent, extent);
        let source = SynthSource::new(SynthKind::Ct, extent, voxel_type, 1, 1).map_err(text)?;
        pack(&source, &path, &PackOptions::new(voxel_type), &()).map_err(text)?;
    }
    Ok(path)
}

fn text(error: impl std::fmt::Display) -> String {
    error.to_string()
}
