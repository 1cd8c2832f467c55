//! `brickyard probe`: the values of all channels at one place, at one time step or over several.

use super::output::may_write_file;
use super::say::say;
use super::step_range::StepRange;
use super::values::{self, short};
use super::{Failure, heading, print_json, print_line, store_errors};
use brickyard::curve::{Curve, curve};
use brickyard::probe::{Probe, probe, probe_voxel};
use brickyard::session::VolumeSource;
use brickyard::store::Store;
use brickyard::volume::numbers::{exact, significant};
use brickyard::volume::{VoxelType, counted};
use brickyard_measure::curve_plot;
use clap::Args;
use glam::DVec3;
use serde::Serialize;
use std::path::PathBuf;
use std::sync::Arc;

/// `brickyard probe STORE X,Y,Z`
#[derive(Args)]
pub(crate) struct ProbeArguments {
    /// The store
    store: PathBuf,
    /// The place in the world: millimetres to the right, front and head of a patient, else by spacing and origin
    #[arg(value_name = "X,Y,Z", value_parser = values::vec3, allow_hyphen_values = true)]
    place: DVec3,
    /// The place is a voxel of level 0, counted from 0
    #[arg(help_heading = heading::READ, long)]
    voxel: bool,
    /// Time step N; or a curve of several, A:B, A:B:S (B excluded) or all
    #[arg(help_heading = heading::READ, long, value_name = "N|A:B[:S]|all", default_value = "0", allow_negative_numbers = true)]
    time: StepRange,
    /// Print JSON
    #[arg(help_heading = heading::OUTPUT, long)]
    json: bool,
    /// Print comma-separated values, a row for each step
    #[arg(help_heading = heading::OUTPUT, long, conflicts_with = "json")]
    csv: bool,
    /// Draw the curve into an SVG file
    #[arg(help_heading = heading::OUTPUT, long, value_name = "FILE.svg")]
    plot: Option<PathBuf>,
    /// Replace an existing file
    #[arg(help_heading = heading::OUTPUT, long, requires = "plot")]
    overwrite: bool,
}

/// The output of `probe --json`.
#[derive(Serialize)]
struct Found<'a> {
    voxel: [u32; 3],
    world: [f64; 3],
    /// Unit of `world`.
    unit: Option<&'a str>,
    channels: Vec<Value<'a>>,
}

#[derive(Serialize)]
struct Value<'a> {
    name: Option<&'a str>,
    /// `null` where there is no value.
    value: Option<f64>,
}

/// The output of `probe --json` for several time steps.
#[derive(Serialize)]
struct FoundCurve<'a> {
    voxel: [u32; 3],
    world: [f64; 3],
    /// Unit of `world`.
    unit: Option<&'a str>,
    steps: &'a [u32],
    /// The time of each step; `null` if times are unknown.
    times: Option<Vec<f64>>,
    /// Unit of `times`.
    time_unit: Option<&'a str>,
    channels: Vec<Values<'a>>,
}

#[derive(Serialize)]
struct Values<'a> {
    name: Option<&'a str>,
    /// One for each step; `null` where there is no value.
    values: Vec<Option<f64>>,
}

/// Runs `probe`.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(arguments: &ProbeArguments) -> Result<(), Failure> {
    let store = Arc::new(store_errors::open(&arguments.store)?);
    let unit = match store.info().orientation {
        Some(_) => Some("millimeter"),
        None => store.geometry().unit.as_deref(),
    };
    let steps = arguments.time.steps(store.times())?;
    if let (StepRange::One(step), None, false) = (&arguments.time, &arguments.plot, arguments.csv) {
        return print_probe(arguments, &store, look(arguments, &store, *step)?, unit);
    }
    if let Some(path) = &arguments.plot {
        may_write_file(path, arguments.overwrite)?;
    }
    let voxel = look(arguments, &store, steps[0])?.voxel;
    let curve = curve(&VolumeSource::of_store(&store), &steps, voxel).map_err(Failure::bad_input)?;
    if let Some(path) = &arguments.plot {
        curve_plot::write(path, &curve, store.time_axis(), &channel_names(&store)).map_err(Failure::failed)?;
        say!("{}: {} of voxel {}", path.display(), counted(steps.len() as u64, "step"), triple(voxel));
    }
    if arguments.json {
        print_json(&describe(&curve, &store, unit))
    } else if arguments.csv {
        print_line(&csv(&curve, &store))
    } else if arguments.plot.is_none() {
        print_curve(&curve, &store, unit)
    } else {
        Ok(())
    }
}

fn print_probe(arguments: &ProbeArguments, store: &Store, found: Probe, unit: Option<&str>) -> Result<(), Failure> {
    let names = store.channel_displays().iter().map(|display| display.name.as_deref());
    if arguments.json {
        let value = |(name, value): (_, &f64)| Value { name, value: value.is_finite().then_some(*value) };
        let channels = names.zip(&found.values).map(value).collect();
        return print_json(&Found { voxel: found.voxel, world: found.world.to_array(), unit, channels });
    }
    print_line(&place(found.voxel, found.world, unit))?;
    for (channel, (name, value)) in names.zip(&found.values).enumerate() {
        let name = name.map_or_else(String::new, |name| format!(" '{name}'"));
        print_line(&format!("  channel {channel}{name}: {}", in_words(*value, store)))?;
    }
    Ok(())
}

fn print_curve(curve: &Curve, store: &Store, unit: Option<&str>) -> Result<(), Failure> {
    print_line(&place(curve.voxel, curve.world, unit))?;
    for (i, step) in curve.steps.iter().enumerate() {
        let time = store.time_axis().map_or_else(String::new, |axis| format!(" ({})", axis.in_words(axis.at(*step))));
        let values: Vec<String> = curve.values.iter().map(|values| in_words(values[i], store)).collect();
        print_line(&format!("  step {step}{time}: {}", values.join(", ")))?;
    }
    Ok(())
}

fn describe<'a>(curve: &'a Curve, store: &'a Store, unit: Option<&'a str>) -> FoundCurve<'a> {
    let axis = store.time_axis();
    let value = |value: &f64| value.is_finite().then_some(*value);
    let names = store.channel_displays().iter().map(|display| display.name.as_deref());
    let of_channel = |(name, values): (_, &Vec<f64>)| Values { name, values: values.iter().map(value).collect() };
    FoundCurve {
        voxel: curve.voxel,
        world: curve.world.to_array(),
        unit,
        steps: &curve.steps,
        times: axis.map(|axis| curve.steps.iter().map(|step| axis.at(*step)).collect()),
        time_unit: axis.and_then(|axis| axis.unit.as_deref()),
        channels: names.zip(&curve.values).map(of_channel).collect(),
    }
}

/// Formats a row for each step: its number, its time, empty if unknown, and each channel's value, empty if there is
/// none.
fn csv(curve: &Curve, store: &Store) -> String {
    let head = ["step".into(), "time".into()].into_iter().chain(channel_names(store)).map(|name| quoted(&name));
    let row = |(i, step): (usize, &u32)| {
        let time = store.time_axis().map_or_else(String::new, |axis| axis.at(*step).to_string());
        let value = |values: &Vec<f64>| if values[i].is_nan() { String::new() } else { values[i].to_string() };
        [step.to_string(), time].into_iter().chain(curve.values.iter().map(value)).collect::<Vec<_>>().join(",")
    };
    let rows = curve.steps.iter().enumerate().map(row);
    std::iter::once(head.collect::<Vec<_>>().join(",")).chain(rows).collect::<Vec<_>>().join("\n")
}

fn quoted(text: &str) -> String {
    if text.contains([',', '"', '\n', '\r']) { format!("\"{}\"", text.replace('"', "\"\"")) } else { text.to_owned() }
}

fn channel_names(store: &Store) -> Vec<String> {
    let name = |(channel, display): (usize, &brickyard::store::ChannelDisplay)| {
        display.name.clone().unwrap_or_else(|| format!("channel {channel}"))
    };
    store.channel_displays().iter().enumerate().map(name).collect()
}

fn in_words(value: f64, store: &Store) -> String {
    if value.is_nan() { "no data".into() } else { exact(value, store.voxel_type() == VoxelType::F32) }
}

fn place(voxel: [u32; 3], world: DVec3, unit: Option<&str>) -> String {
    let [x, y, z] = world.to_array().map(short);
    format!("voxel {}, centre at {x},{y},{z} {}", triple(voxel), unit.unwrap_or("(no unit)"))
}

fn triple([i, j, k]: [u32; 3]) -> String {
    format!("{i},{j},{k}")
}

/// Probes the requested place, at an existing step of the store.
fn look(arguments: &ProbeArguments, store: &Arc<Store>, time: u32) -> Result<Probe, Failure> {
    let volume = VolumeSource::of_store(store);
    let extent = store.pyramid().levels()[0].extent;
    if arguments.voxel {
        let voxel = arguments.place.to_array();
        let is_whole = voxel.iter().all(|v| v.fract() == 0.0 && (0.0..=f64::from(u32::MAX)).contains(v));
        let voxel = voxel.map(|v| v as u32);
        if !is_whole || !extent.contains(voxel) {
            let place = arguments.place;
            let problem =
                format!("no voxel {},{},{}: the volume has {extent}, numbered from 0", place.x, place.y, place.z);
            return Err(Failure::usage(problem));
        }
        return probe_voxel(&volume, time, voxel).map_err(Failure::bad_input);
    }
    probe(&volume, time, arguments.place).map_err(Failure::bad_input)?.ok_or_else(|| {
        let (low, high) = volume.place().placement.world_box(volume.place().own_box);
        let [place, low, high] =
            [arguments.place, low, high].map(|p| p.to_array().map(|c| significant(c, 8)).join(","));
        Failure::usage(format!("{place} is outside of the volume, which extends from {low} to {high}"))
    })
}
