//! `brickyard probe`: the values of all channels at one place.

use super::failure::Failure;
use super::values::{self, short};
use super::{print_json, print_line, store_errors};
use brickyard::probe::{Probe, probe, probe_voxel};
use brickyard::session::VolumeSource;
use brickyard::store::Store;
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
    /// The place in the world: of a patient to the right, front and head in millimetres, else by spacing and origin
    #[arg(value_name = "X,Y,Z", value_parser = values::vec3, allow_hyphen_values = true)]
    place: DVec3,
    /// The place is a voxel of level 0, counted from 0
    #[arg(long)]
    voxel: bool,
    /// Time step
    #[arg(long, default_value_t = 0)]
    time: u32,
    /// Print JSON
    #[arg(long)]
    json: bool,
}

/// What `probe --json` prints.
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

/// Runs `probe`.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(arguments: &ProbeArguments) -> Result<(), Failure> {
    let store = Arc::new(store_errors::open(&arguments.store)?);
    let found = look(arguments, &store)?;
    let unit = match store.info().orientation {
        Some(_) => Some("millimeter"),
        None => store.geometry().unit.as_deref(),
    };
    let names = store.channel_displays().iter().map(|display| display.name.as_deref());
    if arguments.json {
        let value = |(name, value): (_, &f64)| Value { name, value: value.is_finite().then_some(*value) };
        let channels = names.zip(&found.values).map(value).collect();
        return print_json(&Found { voxel: found.voxel, world: found.world.to_array(), unit, channels });
    }
    let [[x, y, z], [i, j, k]] = [found.world.to_array().map(short), found.voxel.map(|v| v.to_string())];
    print_line(&format!("voxel {i},{j},{k}, centre at {x},{y},{z} {}", unit.unwrap_or("(no unit)")))?;
    for (channel, (name, value)) in names.zip(&found.values).enumerate() {
        let name = name.map_or_else(String::new, |name| format!(" '{name}'"));
        let value = if value.is_nan() { "no data".into() } else { value.to_string() };
        print_line(&format!("  channel {channel}{name}: {value}"))?;
    }
    Ok(())
}

fn look(arguments: &ProbeArguments, store: &Arc<Store>) -> Result<Probe, Failure> {
    let volume = VolumeSource::of_store(store);
    let (time, times) = (arguments.time, store.times());
    if time >= times {
        return Err(Failure::usage(format!("--time {time}: the store has {times} time steps, numbered from 0")));
    }
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
        let [place, low, high] = [arguments.place, low, high].map(|p| format!("{},{},{}", p.x, p.y, p.z));
        Failure::usage(format!("{place} is outside of the volume, which is in the box from {low} to {high}"))
    })
}
