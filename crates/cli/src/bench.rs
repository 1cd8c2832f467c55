//! `brickyard bench`: measured flights over stores, as a table.

use super::failure::Failure;
use super::sampling_args::SamplingArguments;
use super::scene_args::SceneArguments;
use super::session_args::{BackendArgument, threads};
use super::session_errors::session_failure;
use super::{print_json, print_line, store_errors, values};
use brickyard::backend::CompositorChoice;
use brickyard::flight::{FlightError, FlightPlan, FlightReport, fly, forget_pages};
use brickyard::scenario::Scenario;
use brickyard::session::SessionOptions;
use clap::{Args, ValueEnum};
use serde::Serialize;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// `brickyard bench STORE...`
#[derive(Args)]
pub(crate) struct BenchArguments {
    /// The stores
    #[arg(required = true)]
    stores: Vec<PathBuf>,
    /// Fly over all stores in one picture, not over one after the other
    #[arg(long)]
    together: bool,
    /// What to fly
    #[arg(long, value_delimiter = ',', default_value = "orbit,fly,zoom,sweep")]
    scenario: Vec<ScenarioArgument>,
    /// Frames of a flight
    #[arg(long, default_value_t = 120, value_parser = clap::value_parser!(u32).range(1..))]
    frames: u32,
    /// Read from the disk: the kernel is asked to forget the stores before every flight
    #[arg(long)]
    cold: bool,
    /// How long a frame of a moving camera may take: fewer pixels and longer steps keep to it. Without, every frame is exact
    #[arg(long, value_name = "MS", value_parser = clap::value_parser!(u32).range(1..))]
    frame_goal: Option<u32>,
    /// Read and sample what shows nothing, too: what skipping it gains is the difference
    #[arg(long)]
    no_skipping: bool,
    /// Seed of the random flight
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Picture size in pixels
    #[arg(long, value_name = "WxH", default_value = "512x512", value_parser = values::size_px)]
    size: (u32, u32),
    #[command(flatten)]
    scene: SceneArguments,
    #[command(flatten)]
    sampling: SamplingArguments,
    /// Where to render; auto takes a hardware GPU if there is one, else the CPU
    #[arg(long, value_enum, default_value_t = BackendArgument::Auto)]
    backend: BackendArgument,
    /// How to render; auto takes what measured faster here
    #[arg(long, value_enum, default_value_t = CompositorArgument::Auto)]
    compositor: CompositorArgument,
    /// Hard limit of brick slots, tables, targets and staging
    #[arg(long, value_name = "BYTES", default_value = "256MiB", value_parser = values::bytes)]
    gpu_memory: u64,
    /// Hard limit of decoded bricks and scratch
    #[arg(long, value_name = "BYTES", default_value = "512MiB", value_parser = values::bytes)]
    host_memory: u64,
    /// Threads for decoding and for the CPU backend [default: all]
    #[arg(short = 'j', long)]
    threads: Option<NonZeroUsize>,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

#[derive(Clone, Copy, ValueEnum)]
enum CompositorArgument {
    Auto,
    Sorted,
    Raycast,
    Compute,
}

#[derive(Clone, Copy, ValueEnum)]
enum ScenarioArgument {
    Still,
    Orbit,
    Fly,
    Zoom,
    Sweep,
    Random,
}

#[derive(Serialize)]
struct Row<'a> {
    stores: &'a [&'a Path],
    /// Voxels along x, y and z, store by store.
    extents: Vec<[u32; 3]>,
    size_px: (u32, u32),
    gpu_memory: u64,
    host_memory: u64,
    cold: bool,
    #[serde(flatten)]
    report: FlightReport,
}

/// Runs `bench`.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(arguments: &BenchArguments) -> Result<(), Failure> {
    let mut rows = Vec::new();
    if !arguments.json {
        print_line(HEAD)?;
    }
    let paths: Vec<&Path> = arguments.stores.iter().map(PathBuf::as_path).collect();
    for stores in paths.chunks(if arguments.together { paths.len() } else { 1 }) {
        for &scenario in &arguments.scenario {
            let (extents, report) = flight(arguments, stores, scenario.into())?;
            let BenchArguments { cold, size: size_px, gpu_memory, host_memory, .. } = *arguments;
            let row = Row { stores, extents, size_px, gpu_memory, host_memory, cold, report };
            if !arguments.json {
                print_line(&line(&row))?;
            }
            rows.push(row);
        }
    }
    if arguments.json { print_json(&rows) } else { Ok(()) }
}

fn flight(
    arguments: &BenchArguments,
    paths: &[&Path],
    scenario: Scenario,
) -> Result<(Vec<[u32; 3]>, FlightReport), Failure> {
    // Opened once before the clock starts: for the scene, and so that a store that does not open says so as elsewhere.
    let volumes = store_errors::open_volumes(paths)?;
    let extents = volumes.iter().map(|volume| volume.source.pyramid().levels()[0].extent.to_array()).collect();
    let scene = arguments.sampling.of(arguments.scene.scene(&volumes, arguments.size)?);
    drop(volumes);
    for path in paths.iter().filter(|_| arguments.cold) {
        forget_pages(path).map_err(|error| Failure::failed(format!("{}: {error}", path.display())))?;
    }
    let options = SessionOptions {
        backend: arguments.backend.into(),
        compositor: match arguments.compositor {
            CompositorArgument::Auto => CompositorChoice::Auto,
            CompositorArgument::Sorted => CompositorChoice::Sorted,
            CompositorArgument::Raycast => CompositorChoice::Raycast,
            CompositorArgument::Compute => CompositorChoice::Compute,
        },
        gpu_memory_bytes: arguments.gpu_memory,
        host_memory_bytes: arguments.host_memory,
        threads: threads(arguments.threads),
        skips_empty: !arguments.no_skipping,
        live: true,
    };
    let plan = FlightPlan {
        scenario,
        scene: &scene,
        frames: arguments.frames,
        size_px: arguments.size,
        seed: arguments.seed,
        frame_goal: arguments.frame_goal.map(|ms| Duration::from_millis(ms.into())),
    };
    let report = fly(paths, &plan, &options).map_err(|error| match error {
        FlightError::Session(error) => session_failure(error),
        FlightError::Open(_) | FlightError::NotSettled(_) => Failure::failed(error),
    })?;
    Ok((extents, report))
}

const HEAD: &str = "\
| stores | scenario | open ms | first picture ms | settled ms | frame ms p50 / p95 / p99 | quality | settles after ms | complete | \
read / decoded / uploaded MiB | decoded per upload | uploaded again | backend / host / anonymous MiB | uncovered, over budget |
| --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- | --- |";

fn line(row: &Row<'_>) -> String {
    let r = &row.report;
    let mib = |bytes: u64| bytes as f64 / (1 << 20) as f64;
    let share = |part: u64, whole: u64| if whole == 0 { 0.0 } else { part as f64 / whole as f64 };
    let names: Vec<_> = row.stores.iter().map(|path| path.file_name().unwrap_or_default().to_string_lossy()).collect();
    let stores = names.join(" + ");
    format!(
        "| {stores} | {}{} | {:.1} | {:.0} | {:.0} | {:.0} / {:.0} / {:.0} | {:.0} % | {:.0} | {:.1} % | {:.0} / {:.0} / {:.0} | {:.2} | \
         {:.1} % | {:.0} / {:.0} / {:.0} | {}, {} |",
        r.scenario.name(),
        if row.cold { ", cold" } else { "" },
        r.open_ms,
        r.first_picture_ms,
        r.settled_ms,
        r.frame_ms.p50,
        r.frame_ms.p95,
        r.frame_ms.p99,
        r.quality * 100.0,
        r.settle_after_ms,
        r.completeness * 100.0,
        mib(r.bytes.read),
        mib(r.bytes.decoded),
        mib(r.bytes.uploaded),
        share(r.bricks_decoded, r.bricks.uploaded),
        share(r.bricks.reuploaded, r.bricks.uploaded) * 100.0,
        mib(r.gpu_bytes_peak),
        mib(r.host_bytes_peak),
        mib(r.anonymous_peak),
        r.uncovered_frames,
        r.frames_over_budget,
    )
}

impl From<ScenarioArgument> for Scenario {
    fn from(scenario: ScenarioArgument) -> Self {
        match scenario {
            ScenarioArgument::Still => Self::Still,
            ScenarioArgument::Orbit => Self::Orbit,
            ScenarioArgument::Fly => Self::Fly,
            ScenarioArgument::Zoom => Self::Zoom,
            ScenarioArgument::Sweep => Self::Sweep,
            ScenarioArgument::Random => Self::Random,
        }
    }
}
