//! `brickyard bench`: measured flights over stores and playbacks of their time steps, as tables.

use super::bench_play::{self, PlayArguments, mib, three};
use super::named::Named;
use super::output::{is_stdout, may_write_data, write_json};
use super::sampling_args::SamplingArguments;
use super::scene_args::SceneArguments;
use super::session_args::{BACKENDS, COMPOSITORS, threads};
use super::session_errors::session_failure;
use super::{Failure, heading, print_json, print_line, store_errors, values};
use brickyard::backend::{BackendChoice, CompositorChoice};
use brickyard::session::SessionOptions;
use brickyard_measure::flight::{FlightError, FlightPlan, FlightReport, fly, forget_pages};
use brickyard_measure::playing::{PlayPlan, PlayReport, play};
use brickyard_measure::scenario::Scenario;
use clap::Args;
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
    /// Fly over all stores in one picture, instead of one after the other
    #[arg(help_heading = heading::MEASURED, long)]
    together: bool,
    /// Flights to measure, or `play` or `scrub` for time steps
    #[arg(help_heading = heading::MEASURED, long, value_parser = SCENARIOS, value_delimiter = ',', default_value = "orbit,fly,zoom,sweep")]
    scenario: Vec<Played>,
    #[command(flatten)]
    play: PlayArguments,
    /// Frames of a flight
    #[arg(help_heading = heading::MEASURED, long, default_value_t = 120, value_parser = clap::value_parser!(u32).range(1..))]
    frames: u32,
    /// Read from the disk: drop the stores from the kernel's page cache before every flight
    #[arg(help_heading = heading::MEASURED, long)]
    cold: bool,
    /// Time limit of a moving camera's frame, met by fewer pixels and longer steps [default: none, and every frame is
    /// exact]
    #[arg(help_heading = heading::DRAWING, long, value_name = "MS", value_parser = clap::value_parser!(u32).range(1..))]
    frame_goal: Option<u32>,
    /// Also read and sample empty space, to measure the gain of skipping it
    #[arg(help_heading = heading::DRAWING, long)]
    no_skipping: bool,
    /// Seed of the random flight
    #[arg(help_heading = heading::MEASURED, long, default_value_t = 1)]
    seed: u64,
    /// Picture size in pixels
    #[arg(help_heading = heading::OUTPUT, long, value_name = "WxH", default_value = "512x512", value_parser = values::size_px)]
    size: (u32, u32),
    #[command(flatten)]
    scene: SceneArguments,
    #[command(flatten)]
    sampling: SamplingArguments,
    /// Where to render; auto is a hardware GPU if there is one, else the CPU
    #[arg(help_heading = heading::DRAWING, long, value_parser = BACKENDS, default_value = "auto")]
    backend: BackendChoice,
    /// How to render; auto is the faster one by measurement here
    #[arg(help_heading = heading::DRAWING, long, value_parser = COMPOSITORS, default_value = "auto")]
    compositor: CompositorChoice,
    /// Hard limit of brick slots, tables, targets and staging
    #[arg(help_heading = heading::DRAWING, long, visible_alias = "cpu-memory", value_name = "BYTES", default_value = "256MiB", value_parser = values::bytes)]
    gpu_memory: u64,
    /// Hard limit of decoded bricks and scratch
    #[arg(help_heading = heading::DRAWING, long, value_name = "BYTES", default_value = "512MiB", value_parser = values::bytes)]
    host_memory: u64,
    /// Threads for decoding and for the CPU backend [default: all]
    #[arg(help_heading = heading::DRAWING, short = 'j', long, value_parser = values::threads)]
    threads: Option<NonZeroUsize>,
    /// Print JSON
    #[arg(help_heading = heading::OUTPUT, long)]
    json: bool,
    /// Also write the measurements (JSON); - is standard output, in place of the table
    #[arg(help_heading = heading::OUTPUT, long, value_name = "stats.json")]
    stats: Option<PathBuf>,
    /// Replace existing statistics
    #[arg(help_heading = heading::OUTPUT, long, requires = "stats")]
    overwrite: bool,
}

/// A measured course of frames.
#[derive(Clone, Copy)]
enum Played {
    Flight(Scenario),
    /// Consecutive time steps.
    Steps,
    /// Jumps from time step to time step.
    Jumps,
}

const SCENARIOS: Named<Played> = Named(&[
    ("still", Played::Flight(Scenario::Still), ""),
    ("orbit", Played::Flight(Scenario::Orbit), ""),
    ("fly", Played::Flight(Scenario::Fly), ""),
    ("zoom", Played::Flight(Scenario::Zoom), ""),
    ("sweep", Played::Flight(Scenario::Sweep), ""),
    ("random", Played::Flight(Scenario::Random), ""),
    ("play", Played::Steps, "Play the time steps"),
    ("scrub", Played::Jumps, "Jump from time step to time step"),
]);

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
    report: Report,
}

#[derive(Serialize)]
#[serde(untagged)]
enum Report {
    Flight(FlightReport),
    Play {
        scenario: &'static str,
        /// Requested steps per second; `None` for jumps.
        rate: Option<f64>,
        #[serde(flatten)]
        report: PlayReport,
    },
}

/// Runs `bench`.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(arguments: &BenchArguments) -> Result<(), Failure> {
    let stats = arguments.stats.as_deref();
    let to_stdout = stats.is_some_and(is_stdout);
    if let Some(path) = stats {
        may_write_data(path, arguments.overwrite)?;
    }
    let mut rows = Vec::new();
    let mut head = "";
    let paths: Vec<&Path> = arguments.stores.iter().map(PathBuf::as_path).collect();
    for stores in paths.chunks(if arguments.together { paths.len() } else { 1 }) {
        for &scenario in &arguments.scenario {
            let (extents, report) = measured(arguments, stores, scenario)?;
            let BenchArguments { cold, size: size_px, gpu_memory, host_memory, .. } = *arguments;
            let row = Row { stores, extents, size_px, gpu_memory, host_memory, cold, report };
            if !arguments.json && !to_stdout {
                let own_head = if matches!(row.report, Report::Flight(_)) { HEAD } else { bench_play::HEAD };
                if head != own_head {
                    print_line(own_head)?;
                    head = own_head;
                }
                print_line(&line(&row))?;
            }
            rows.push(row);
        }
    }
    if let Some(path) = stats {
        write_json(path, &rows)?;
    }
    if arguments.json && !to_stdout { print_json(&rows) } else { Ok(()) }
}

fn measured(arguments: &BenchArguments, paths: &[&Path], scenario: Played) -> Result<(Vec<[u32; 3]>, Report), Failure> {
    // Opened once before the clock starts: for the scene, and so a store that does not open is reported as usual.
    let volumes = store_errors::open_volumes(paths)?;
    let extents = volumes.iter().map(|volume| volume.source.pyramid().levels()[0].extent.to_array()).collect();
    if !matches!(scenario, Played::Flight(_)) && volumes.iter().all(|volume| volume.source.times() == 1) {
        let problem = "one time step cannot be played: leave play and scrub out of --scenario";
        return Err(Failure::usage(format!("{}: {problem}", paths[0].display())));
    }
    let scene = arguments.sampling.of(arguments.scene.scene_of_one_step(&volumes, arguments.size)?);
    drop(volumes);
    for path in paths.iter().filter(|_| arguments.cold) {
        forget_pages(path).map_err(|error| Failure::failed(format!("{}: {error}", path.display())))?;
    }
    let options = SessionOptions {
        backend: arguments.backend,
        compositor: arguments.compositor,
        gpu_memory_bytes: arguments.gpu_memory,
        cpu_memory_bytes: arguments.gpu_memory,
        host_memory_bytes: arguments.host_memory,
        threads: threads(arguments.threads),
        skips_empty: !arguments.no_skipping,
        live: true,
        ..SessionOptions::default()
    };
    let frame_goal = arguments.frame_goal.map(|ms| Duration::from_millis(ms.into()));
    let (scene, size_px) = (&scene, arguments.size);
    let report = match scenario {
        Played::Flight(scenario) => {
            let (frames, seed) = (arguments.frames, arguments.seed);
            fly(paths, &FlightPlan { scenario, scene, frames, size_px, seed, frame_goal }, &options).map(Report::Flight)
        }
        Played::Steps | Played::Jumps => {
            let PlayArguments { steps, no_drawing, .. } = arguments.play;
            let playback = matches!(scenario, Played::Steps).then(|| arguments.play.playback());
            let plan = PlayPlan { scene, playback, steps, size_px, draws: !no_drawing, frame_goal };
            let rate = playback.map(|playback| playback.steps_per_second);
            let name = if playback.is_some() { "play" } else { "scrub" };
            play(paths, &plan, &options).map(|report| Report::Play { scenario: name, rate, report })
        }
    };
    let report = report.map_err(|error| match error {
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
    let names: Vec<_> = row.stores.iter().map(|path| path.file_name().unwrap_or_default().to_string_lossy()).collect();
    let stores = names.join(" + ");
    let cold = if row.cold { ", cold" } else { "" };
    let report = match &row.report {
        Report::Flight(report) => report,
        Report::Play { scenario, report, .. } => {
            return bench_play::line(&stores, &format!("{scenario}{cold}"), report);
        }
    };
    let share = |part: u64, whole: u64| if whole == 0 { 0.0 } else { part as f64 / whole as f64 };
    let FlightReport { open_ms, first_picture_ms, settled_ms, settle_after_ms, frame_ms, bricks, bytes, .. } = report;
    let FlightReport { uncovered_frames, frames_over_budget, .. } = report;
    let (scenario, frames) = (report.scenario.name(), three([frame_ms.p50, frame_ms.p95, frame_ms.p99]));
    let (quality, complete) = (report.quality * 100.0, report.completeness * 100.0);
    let traffic = three([bytes.read, bytes.decoded, bytes.uploaded].map(mib));
    let decoded = share(report.bricks_decoded, bricks.uploaded);
    let again = share(bricks.reuploaded, bricks.uploaded) * 100.0;
    let memory = three([report.gpu_bytes_peak, report.host_bytes_peak, report.anonymous_peak].map(mib));
    format!(
        "| {stores} | {scenario}{cold} | {open_ms:.1} | {first_picture_ms:.0} | {settled_ms:.0} | {frames} | \
         {quality:.0} % | {settle_after_ms:.0} | {complete:.1} % | {traffic} | {decoded:.2} | {again:.1} % | {memory} | \
         {uncovered_frames}, {frames_over_budget} |"
    )
}
