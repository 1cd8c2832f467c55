//! `brickyard quality`: the quality and speed of sampling methods, measured on a store.

use super::advice::advised;
use super::output::{make_folder, write_json};
use super::sampling_args::{FILTERS, LIGHTINGS, METHODS};
use super::scene_args::SceneArguments;
use super::session_args::threads;
use super::session_errors::session_failure;
use super::{Failure, heading, print_json, print_line, store_errors, values};
use brickyard::backend::BackendChoice;
use brickyard::offline::OfflineError;
use brickyard::picture_file::write_png;
use brickyard::session::{SessionOptions, VolumeSource};
use brickyard::volume::sampling::{MOST_VIRTUAL_SAMPLES, VIRTUAL_SAMPLES};
use brickyard::volume::{Filter, LightingModel, Method, Mode, Scene, TransferFunction};
use brickyard_measure::survey::findings::{self, Estimator, Finding};
use brickyard_measure::survey::noise::Series;
use brickyard_measure::survey::{Row, SurveyError, SurveyPlan, plot, survey};
use clap::Args;
use serde::Serialize;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// `brickyard quality STORE -o FOLDER`
#[derive(Args)]
pub(crate) struct QualityArguments {
    /// The store
    store: PathBuf,
    /// Folder for table, curves and maps; created if missing
    #[arg(help_heading = heading::OUTPUT, short, long, value_name = "FOLDER")]
    output: PathBuf,
    /// Picture size in pixels
    #[arg(help_heading = heading::OUTPUT, long, value_name = "WxH", default_value = "512x512", value_parser = values::size_px)]
    size: (u32, u32),
    #[command(flatten)]
    scene: SceneArguments,
    /// Sampling rates: segments along a voxel
    #[arg(help_heading = heading::MEASURED, long, value_name = "N,...", value_delimiter = ',', default_value = "1,2,4,8", value_parser = values::positive)]
    samples_per_voxel: Vec<f64>,
    /// Sampling methods [default: all; for a transfer function of value and gradient, those without pre-integration]
    #[arg(help_heading = heading::MEASURED, long, value_parser = METHODS, value_delimiter = ',', value_name = "METHOD,...")]
    methods: Vec<Method>,
    /// Virtual samples of a segment, for methods with some
    #[arg(help_heading = heading::MEASURED, long, value_name = "N,...", value_delimiter = ',', default_values_t = [VIRTUAL_SAMPLES],
          value_parser = clap::value_parser!(u8).range(1..=MOST_VIRTUAL_SAMPLES as i64))]
    virtual_samples: Vec<u8>,
    /// Filters [default: trilinear,tricubic]
    #[arg(help_heading = heading::MEASURED, long, value_parser = FILTERS, value_delimiter = ',', value_name = "FILTER,...")]
    filters: Vec<Filter>,
    /// Lightings
    #[arg(help_heading = heading::MEASURED, long, value_parser = LIGHTINGS, value_delimiter = ',', value_name = "LIGHTING,...", default_value = "none,blinn-phong")]
    lightings: Vec<LightingModel>,
    /// Pictures of each series, each with its own jitter
    #[arg(help_heading = heading::MEASURED, long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(2..=1024))]
    frames: u32,
    /// Hard limit of brick slots, tables, targets and staging
    #[arg(help_heading = heading::DRAWING, long, visible_alias = "cpu-memory", value_name = "BYTES", default_value = "1GiB", value_parser = values::bytes)]
    gpu_memory: u64,
    /// Hard limit of decoded bricks and scratch
    #[arg(help_heading = heading::DRAWING, long, value_name = "BYTES", default_value = "2GiB", value_parser = values::bytes)]
    host_memory: u64,
    /// Threads [default: all]
    #[arg(help_heading = heading::DRAWING, short = 'j', long, value_parser = values::threads)]
    threads: Option<NonZeroUsize>,
    /// Give up on missing bricks after S seconds
    #[arg(help_heading = heading::DRAWING, long, value_name = "S", default_value = "600", value_parser = values::positive)]
    max_wait: f64,
    /// Print JSON, as in quality.json, in place of the tables
    #[arg(help_heading = heading::OUTPUT, long)]
    json: bool,
    /// Write into a folder even if it is not empty
    #[arg(help_heading = heading::OUTPUT, long)]
    overwrite: bool,
}

/// `quality.json`.
#[derive(Serialize)]
struct Table<'a> {
    store: &'a Path,
    size_px: (u32, u32),
    frames: u32,
    scene: Scene,
    rows: &'a [Row],
    findings: Vec<Finding>,
}

/// Runs `quality`.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(arguments: &QualityArguments) -> Result<(), Failure> {
    let volume = VolumeSource::of_store(&Arc::new(store_errors::open(&arguments.store)?));
    let scene = arguments.scene.scene_of_one_step(std::slice::from_ref(&volume), arguments.size)?;
    check(arguments, &scene)?;
    let plan = arguments.plan(&scene);
    make_empty_folder(&arguments.output, arguments.overwrite)?;
    let mut rows = Vec::new();
    let options = arguments.session_options();
    survey(&volume, &plan, &options, |row, series| {
        if !arguments.json {
            print_row(rows.is_empty(), &row)?;
        }
        write_map(&arguments.output, &row, series)?;
        rows.push(row);
        Ok::<_, Failure>(())
    })?;
    for (file, by) in [("curves.svg", Estimator::Variance), ("curves-truth.svg", Estimator::Truth)] {
        plot::write(&arguments.output.join(file), &rows, by).map_err(Failure::failed)?;
    }
    if !arguments.json {
        print_line("")?;
        print_line(findings::table(&rows).trim_end())?;
    }
    let findings = [Estimator::Variance, Estimator::Truth].into_iter().flat_map(|by| findings::findings(&rows, by));
    let table = Table {
        store: &arguments.store,
        size_px: arguments.size,
        frames: arguments.frames,
        findings: findings.collect(),
        rows: &rows,
        scene,
    };
    write_json(&arguments.output.join("quality.json"), &table)?;
    if arguments.json { print_json(&table) } else { Ok(()) }
}

fn check(arguments: &QualityArguments, scene: &Scene) -> Result<(), Failure> {
    if scene.mode != Mode::Dvr {
        let problem = format!("{:?}: methods are of direct volume rendering; leave --mode and --slice out", scene.mode);
        return Err(Failure::usage(problem));
    }
    if scene.stereo.is_some() {
        return Err(Failure::usage("a survey takes pictures of one eye: leave --stereo out"));
    }
    if scene.expression.is_some() {
        return Err(Failure::usage("a survey jitters layers, and expressions are not jittered: leave --expr out"));
    }
    let mut methods = arguments.methods.iter().copied();
    if let Some(method) = methods.find(|&method| !scene.takes(method)) {
        let problem = "is pre-integrated over values, but the transfer function depends on value and gradient";
        return Err(Failure::usage(format!("--methods: {} {problem}", findings::name(method))));
    }
    if arguments.samples_per_voxel.windows(2).any(|pair| pair[0] >= pair[1]) {
        return Err(Failure::usage("--samples-per-voxel: expected rising numbers, as in 1,2,4,8"));
    }
    Ok(())
}

impl QualityArguments {
    fn plan<'a>(&self, scene: &'a Scene) -> SurveyPlan<'a> {
        fn listed<T: PartialEq + Copy>(arguments: &[T], all: &[T]) -> Vec<T> {
            let mut list: Vec<T> = Vec::new();
            for item in arguments {
                if !list.contains(item) {
                    list.push(*item);
                }
            }
            if list.is_empty() { all.to_vec() } else { list }
        }
        let possible: Vec<Method> = Method::ALL.into_iter().filter(|&method| scene.takes(method)).collect();
        SurveyPlan {
            scene,
            size_px: self.size,
            methods: listed(&self.methods, &possible),
            virtual_samples: self.virtual_samples.clone(),
            // The paper's two: steps have nothing between samples for methods to find.
            filters: listed(&self.filters, &[Filter::Trilinear, Filter::Tricubic]),
            lightings: listed(&self.lightings, &[]),
            samples_per_voxel: self.samples_per_voxel.clone(),
            frames: self.frames,
            max_wait: Duration::from_secs_f64(self.max_wait.min(1e9)),
        }
    }

    fn session_options(&self) -> SessionOptions {
        SessionOptions {
            backend: BackendChoice::Cpu,
            gpu_memory_bytes: self.gpu_memory,
            cpu_memory_bytes: self.gpu_memory,
            host_memory_bytes: self.host_memory,
            threads: threads(self.threads),
            ..SessionOptions::default()
        }
    }
}

/// Creates a folder; an existing one must be empty, unless `overwrite`.
fn make_empty_folder(path: &Path, overwrite: bool) -> Result<(), Failure> {
    let fail = |error: std::io::Error| Failure::failed(format!("{}: {error}", path.display()));
    if !overwrite && path.is_dir() && path.read_dir().map_err(fail)?.next().is_some() {
        let problem = "is not empty; choose another folder, or pass --overwrite to write into this one";
        return Err(Failure::usage(format!("{}: {problem}", path.display())));
    }
    make_folder(path)
}

fn print_row(is_first: bool, row: &Row) -> Result<(), Failure> {
    if is_first {
        print_line(
            "| filter | lighting | method | samples a voxel | dB by variance: RGB / YCbCr / HSL | dB against the truth | \
             noticed | frame ms | processor ms |\n| --- | --- | --- | --- | --- | --- | --- | --- | --- |",
        )?;
    }
    let Row { samples_per_voxel, rgb_db, ycbcr_db, hsl_db, truth_db, frame_ms, cpu_ms, .. } = row;
    let (filter, lighting, method) = (FILTERS.name(&row.filter), LIGHTINGS.name(&row.lighting), way_name(row));
    print_line(&format!(
        "| {filter} | {lighting} | {method} | {samples_per_voxel} | {rgb_db:.1} / {ycbcr_db:.1} / {hsl_db:.1} | \
         {truth_db:.1} | {:.1} % | {frame_ms:.0} | {cpu_ms:.0} |",
        100.0 * row.noticed,
    ))
}

/// Returns the method, with its number of virtual samples unless it is the usual one.
fn way_name(row: &Row) -> String {
    let method = findings::name(row.method);
    match row.virtual_samples {
        Some(count) if !row.is_usual() => format!("{method}-{count}"),
        _ => method.to_string(),
    }
}

/// Writes a map from 10 dB, dark violet, to 50 dB, yellow.
fn write_map(folder: &Path, row: &Row, series: &Series) -> Result<(), Failure> {
    let colors = TransferFunction::preset("viridis", (10.0, 50.0), 1.0).map_err(Failure::failed)?;
    let map = series.map(|db| colors.rgb(db.min(1e3)));
    let (filter, lighting, method) = (FILTERS.name(&row.filter), LIGHTINGS.name(&row.lighting), way_name(row));
    let file = format!("psnr-{filter}-{lighting}-{method}-{}.png", row.samples_per_voxel);
    let notes = [
        ("Software", format!("brickyard {}", env!("CARGO_PKG_VERSION"))),
        ("Scale", "PSNR of each pixel: viridis from 10 dB to 50 dB, black where only background is seen".to_string()),
    ];
    write_png(&folder.join(file), &map, &notes).map_err(Failure::failed)
}

impl From<SurveyError> for Failure {
    fn from(error: SurveyError) -> Self {
        match error {
            SurveyError::Picture(OfflineError::Session(error)) => session_failure(error),
            SurveyError::Picture(_) => Self::failed(advised(&error)),
            SurveyError::Coarse { .. } => Self::usage(advised(&error)),
        }
    }
}
