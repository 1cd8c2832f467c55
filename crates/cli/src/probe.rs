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
use brickyard::volume::units::{name_in_unit, with_unit};
use brickyard::volume::{VoxelType, counted};
use brickyard_measure::curve_plot::{self, Line};
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
    #[serde(flatten)]
    units: Units<'a>,
    channels: Vec<Value<'a>>,
}

/// The units of places.
#[derive(Clone, Copy, Serialize)]
struct Units<'a> {
    /// Unit of `world`.
    unit: Option<&'a str>,
    /// Units of x, y and z of `world` where these are not one unit of length; an unknown one is empty.
    #[serde(skip_serializing_if = "Option::is_none")]
    axis_units: Option<&'a [String; 3]>,
}

impl<'a> Units<'a> {
    fn of(store: &'a Store) -> Self {
        let geometry = store.geometry();
        match store.info().orientation {
            Some(_) => Self { unit: Some("millimeter"), axis_units: None },
            None => Self { unit: geometry.unit.as_deref(), axis_units: geometry.axis_units.as_ref() },
        }
    }

    /// A place with its units.
    fn place(&self, world: DVec3) -> String {
        let [x, y, z] = world.to_array().map(short);
        match self.axis_units {
            Some([of_x, of_y, of_z]) => {
                let [x, y, z] = [(x, of_x), (y, of_y), (z, of_z)].map(|(at, unit)| format!("{at} {unit}"));
                [x.trim_end(), y.trim_end(), z.trim_end()].join(", ")
            }
            None => format!("{x},{y},{z} {}", self.unit.unwrap_or("(no unit)")),
        }
    }
}

#[derive(Serialize)]
struct Value<'a> {
    name: Option<&'a str>,
    /// Unit of `value`.
    #[serde(skip_serializing_if = "Option::is_none")]
    unit: Option<&'a str>,
    /// `null` where there is no value.
    value: Option<f64>,
}

/// The output of `probe --json` for several time steps.
#[derive(Serialize)]
struct FoundCurve<'a> {
    voxel: [u32; 3],
    world: [f64; 3],
    #[serde(flatten)]
    units: Units<'a>,
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
    /// Unit of `values`.
    #[serde(skip_serializing_if = "Option::is_none")]
    unit: Option<&'a str>,
    /// One for each step; `null` where there is no value.
    values: Vec<Option<f64>>,
}

/// Runs `probe`.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(arguments: &ProbeArguments) -> Result<(), Failure> {
    let store = Arc::new(store_errors::open(&arguments.store)?);
    let units = Units::of(&store);
    let steps = arguments.time.steps(store.times())?;
    if let (StepRange::One(step), None, false) = (&arguments.time, &arguments.plot, arguments.csv) {
        return print_probe(arguments, &store, look(arguments, &store, *step)?, units);
    }
    if let Some(path) = &arguments.plot {
        may_write_file(path, arguments.overwrite)?;
    }
    let voxel = look(arguments, &store, steps[0])?.voxel;
    let curve = curve(&VolumeSource::of_store(&store), &steps, voxel).map_err(Failure::bad_input)?;
    if let Some(path) = &arguments.plot {
        let lines = lines(&store);
        curve_plot::write(path, &curve, store.time_axis(), &lines).map_err(Failure::failed)?;
        say!("{}: {} of voxel {}", path.display(), counted(steps.len() as u64, "step"), triple(voxel));
    }
    if arguments.json {
        print_json(&describe(&curve, &store, units))
    } else if arguments.csv {
        print_line(&csv(&curve, &store))
    } else if arguments.plot.is_none() {
        print_curve(&curve, &store, units)
    } else {
        Ok(())
    }
}

fn print_probe(arguments: &ProbeArguments, store: &Store, found: Probe, units: Units<'_>) -> Result<(), Failure> {
    let names = store.channel_displays().iter().map(|display| (display.name.as_deref(), display.unit.as_deref()));
    if arguments.json {
        let value = |((name, unit), value): (_, &f64)| Value { name, unit, value: value.is_finite().then_some(*value) };
        let channels = names.zip(&found.values).map(value).collect();
        return print_json(&Found { voxel: found.voxel, world: found.world.to_array(), units, channels });
    }
    print_line(&place(found.voxel, found.world, units))?;
    for (channel, ((name, unit), value)) in names.zip(&found.values).enumerate() {
        let name = name.map_or_else(String::new, |name| format!(" '{name}'"));
        print_line(&format!("  channel {channel}{name}: {}", in_words(*value, unit, store)))?;
    }
    Ok(())
}

fn print_curve(curve: &Curve, store: &Store, units: Units<'_>) -> Result<(), Failure> {
    print_line(&place(curve.voxel, curve.world, units))?;
    for (i, step) in curve.steps.iter().enumerate() {
        let time = store.time_axis().map_or_else(String::new, |axis| format!(" ({})", axis.in_words(axis.at(*step))));
        let values = curve.values.iter().zip(store.channel_displays());
        let values = values.map(|(values, display)| in_words(values[i], display.unit.as_deref(), store));
        let values: Vec<String> = values.collect();
        print_line(&format!("  step {step}{time}: {}", values.join(", ")))?;
    }
    Ok(())
}

fn describe<'a>(curve: &'a Curve, store: &'a Store, units: Units<'a>) -> FoundCurve<'a> {
    let axis = store.time_axis();
    let value = |value: &f64| value.is_finite().then_some(*value);
    let names = store.channel_displays().iter().map(|display| (display.name.as_deref(), display.unit.as_deref()));
    let of_channel =
        |((name, unit), values): (_, &Vec<f64>)| Values { name, unit, values: values.iter().map(value).collect() };
    FoundCurve {
        voxel: curve.voxel,
        world: curve.world.to_array(),
        units,
        steps: &curve.steps,
        times: axis.map(|axis| curve.steps.iter().map(|step| axis.at(*step)).collect()),
        time_unit: axis.and_then(|axis| axis.unit.as_deref()),
        channels: names.zip(&curve.values).map(of_channel).collect(),
    }
}

/// Formats a row for each step: its number, its time, empty if unknown, and each channel's value, empty if there is
/// none.
fn csv(curve: &Curve, store: &Store) -> String {
    let names = lines(store).into_iter().map(|line| name_in_unit(&line.name, line.unit.as_deref()));
    let head = ["step".into(), "time".into()].into_iter().chain(names).map(|name| quoted(&name));
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

fn lines(store: &Store) -> Vec<Line> {
    let line = |(channel, display): (usize, &brickyard::store::ChannelDisplay)| Line {
        name: display.name.clone().unwrap_or_else(|| format!("channel {channel}")),
        unit: display.unit.clone(),
    };
    store.channel_displays().iter().enumerate().map(line).collect()
}

fn in_words(value: f64, unit: Option<&str>, store: &Store) -> String {
    if value.is_nan() {
        return "no data".into();
    }
    with_unit(&exact(value, store.voxel_type() == VoxelType::F32), unit)
}

fn place(voxel: [u32; 3], world: DVec3, units: Units<'_>) -> String {
    format!("voxel {}, centre at {}", triple(voxel), units.place(world))
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
