//! `brickyard info`: the contents of a store.

use super::say::say;
use super::values::{self, short};
use super::{Failure, heading, print_json, print_line, store_errors};
use brickyard::store::{ChannelDisplay, Kind, Ngff, ReadError, Store};
use brickyard::volume::channel::hex;
use brickyard::volume::numbers::{exact, significant, to_place};
use brickyard::volume::{Level, Side, TimeAxis, VoxelType, counted};
use clap::Args;
use glam::DVec3;
use serde::Serialize;
use std::path::PathBuf;

/// `brickyard info STORE`
#[derive(Args)]
pub(crate) struct InfoArguments {
    /// The store
    store: PathBuf,
    /// Print JSON
    #[arg(help_heading = heading::OUTPUT, long)]
    json: bool,
}

/// The output of `info --json`.
#[derive(Serialize)]
struct Info<'a> {
    path: &'a std::path::Path,
    axes: String,
    times: u32,
    /// Times of the time steps.
    time_axis: Option<&'a TimeAxis>,
    channels: u32,
    voxel_type: &'a str,
    /// Version of OME-Zarr.
    #[serde(skip_serializing_if = "Option::is_none")]
    ngff: Option<&'static str>,
    spacing: [f64; 3],
    origin: [f64; 3],
    unit: Option<&'a str>,
    /// Units of x, y and z where these are not one unit of length; an unknown one is empty.
    #[serde(skip_serializing_if = "Option::is_none")]
    axis_units: Option<&'a [String; 3]>,
    calibrated: bool,
    levels: Vec<LevelInfo>,
    /// Bytes of the files of stored aprons, those of the main pyramid.
    apron_bytes: u64,
    /// The display of each channel.
    displays: &'a [ChannelDisplay],
    /// Whether it is another program's image, drawn where it lies.
    foreign: bool,
    /// Whether the statistics are of all voxels, not of a sample.
    exact_statistics: bool,
    /// Names of the image's labels, stores in its folder `labels`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    labels: Vec<String>,
    store: &'a brickyard::store::StoreInfo,
}

#[derive(Serialize)]
struct LevelInfo {
    /// `[x, y, z]` voxels.
    extent: [u32; 3],
    /// World distance of voxel centres.
    spacing: [f64; 3],
    /// World position of the first voxel's centre.
    origin: [f64; 3],
    /// Bricks of one time step and channel.
    bricks: u64,
    /// `[x, y, z]` voxels of a chunk of another program's array; absent where the level is made, and in stores of brickyard's.
    #[serde(skip_serializing_if = "Option::is_none")]
    chunk: Option<[u32; 3]>,
}

/// Runs `info`.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(arguments: &InfoArguments) -> Result<(), Failure> {
    let store = store_errors::open(&arguments.store)?;
    let info = describe(&arguments.store, &store).map_err(|error| store_errors::read_failure(&error))?;
    if arguments.json {
        return print_json(&info);
    }
    print_line(&text(&info, &store))
}

fn describe<'a>(path: &'a std::path::Path, store: &'a Store) -> Result<Info<'a>, ReadError> {
    let geometry = store.geometry();
    let level = |(k, l): (usize, &brickyard::volume::LevelGrid)| {
        let (spacing, origin) = geometry.level_placement(l.factor);
        LevelInfo {
            extent: l.extent.to_array(),
            spacing: spacing.to_array(),
            origin: origin.to_array(),
            bricks: l.bricks.volume(),
            chunk: store.foreign_chunk(Level(k as u8)).map(|chunk| chunk.to_array()),
        }
    };
    Ok(Info {
        path,
        axes: store.layout().axes().concat(),
        times: store.times(),
        time_axis: store.time_axis(),
        channels: store.channels(),
        voxel_type: store.voxel_type().name(),
        ngff: store.ngff().map(Ngff::name),
        spacing: geometry.spacing.to_array(),
        origin: geometry.origin.to_array(),
        unit: geometry.unit.as_deref(),
        axis_units: geometry.axis_units.as_ref(),
        calibrated: store.info().calibrated,
        levels: store.pyramid().levels().iter().enumerate().map(level).collect(),
        apron_bytes: store.apron_file_bytes()?,
        displays: store.channel_displays(),
        foreign: store.is_foreign(),
        exact_statistics: store.has_exact_statistics(),
        labels: store.label_names().unwrap_or_else(|error| {
            say!("warning: {error}; its labels are not shown");
            Vec::new()
        }),
        store: store.info(),
    })
}

fn text(info: &Info<'_>, store: &Store) -> String {
    let unit = store.geometry().units_in_words();
    let without = match (info.calibrated, info.store.orientation.is_some()) {
        (true, true) => "no unit given: taken as millimeter",
        (true, false) => "no unit given",
        (false, _) => "uncalibrated",
    };
    let unit = unit.unwrap_or_else(|| without.into());
    let name = named(info.store.name.as_deref());
    let mut lines = vec![
        format!("{}: {} volume{name}, axes {}", info.path.display(), info.voxel_type, info.axes),
        format!("  {}, {}", time_steps(store), counted(info.channels.into(), "channel")),
        format!("  spacing {} ({unit}), first voxel centre at {}", triple(info.spacing), triple(info.origin)),
        orientation(store),
        bricks(store),
    ];
    if let Some(ngff) = store.ngff().filter(|ngff| *ngff != Ngff::default()) {
        lines.push(format!("  metadata of OME-Zarr {ngff}"));
    }
    let is_labels = info.store.kind == Kind::Labels;
    if is_labels && !store.label_colors().is_empty() {
        lines.push(format!("  {} with colors of their own", counted(store.label_colors().len() as u64, "label")));
    }
    let sampled = if info.exact_statistics { "" } else { ", of a sample" };
    for (c, channel) in info.store.channels.iter().enumerate() {
        if is_labels {
            let name = named(store.channel_displays()[c].name.as_deref());
            lines.push(format!(
                "  channel {c}{name}: labels from {} to {}{sampled}",
                channel.range[0], channel.range[1]
            ));
            continue;
        }
        let (look, window) = (look(&store.channel_displays()[c]), store.default_window(c as u32));
        let values = statistics(channel.range, channel.mean, window, store.voxel_type());
        let unit = channel.unit.as_ref().map_or_else(String::new, |unit| format!(" in {unit}"));
        let not_finite = channel.nan + channel.pos_inf + channel.neg_inf;
        lines.push(format!("  channel {c}{look}{unit}: {values}, {not_finite} not finite{sampled}"));
    }
    lines.extend(no_data(store));
    for (l, level) in info.levels.iter().enumerate() {
        let [x, y, z] = level.extent;
        let bytes = store.pyramid().level(Level(l as u8)).extent.volume() * store.voxel_type().bytes() as u64;
        let (bricks, raw, spacing) =
            (counted(level.bricks, "brick"), values::human_bytes(bytes), triple(level.spacing));
        let from = match level.chunk {
            Some([x, y, z]) => format!(", chunks of {x} x {y} x {z}"),
            None if info.foreign => ", made from the finer level".into(),
            None => String::new(),
        };
        lines.push(format!("  level {l}: {x} x {y} x {z} voxels, {bricks}, {raw} raw, spacing {spacing}{from}"));
    }
    if let Some(apron) = store.apron() {
        let bytes = values::human_bytes(info.apron_bytes);
        lines.push(format!(
            "  aprons of {} stored, {bytes} in the main pyramid's files",
            counted(apron.width.into(), "voxel")
        ));
    }
    if let Some(second) = info.store.downsample.second() {
        let (main, second) = (info.store.downsample.main().name(), second.name());
        lines.push(format!("  levels 1 and up twice: by {main}, and by {second} (K/.brickyard/{second})"));
    }
    if !info.labels.is_empty() {
        lines.push(format!("  labels, in labels/: {}", info.labels.join(", ")));
    }
    lines.join("\n")
}

/// Describes the bricks and their encoding.
fn bricks(store: &Store) -> String {
    let edge = store.pyramid().edge();
    match store.is_foreign() {
        true => format!("  another program's image, read where it lies in bricks of {edge} voxels"),
        false => format!("  bricks of {edge} voxels, codec {}", store.info().codec),
    }
}

/// Describes a channel's least, greatest and mean value and its window. The mean is precise to a ten thousandth of
/// their range, however small and far from 0 the range is.
fn statistics([low, high]: [f64; 2], mean: f64, window: (f64, f64), voxel_type: VoxelType) -> String {
    let value = |value: f64| exact(value, voxel_type == VoxelType::F32);
    let mean = if low < high { to_place(mean, (high - low).log10().floor() as i32 - 4) } else { value(mean) };
    format!("values {} to {}, mean {mean}, window {} to {}", value(low), value(high), value(window.0), value(window.1))
}

/// Describes the number of time steps and their times.
fn time_steps(store: &Store) -> String {
    let count = counted(store.times().into(), "time step");
    store.time_axis().map_or(count.clone(), |axis| format!("{count}, {}", axis.describe()))
}

/// Describes the value and number of voxels without data; `None` without such a value.
fn no_data(store: &Store) -> Option<String> {
    let info = store.info();
    let value = info.nodata?;
    if !store.has_exact_statistics() {
        return Some(format!("  no data: {value}"));
    }
    let voxels =
        store.pyramid().levels()[0].extent.volume() as f64 * f64::from(store.times()) * f64::from(store.channels());
    let count = info.channels.iter().map(|channel| channel.nodata).sum::<u64>();
    Some(format!("  no data: {value}, {} ({:.1} %)", counted(count, "voxel"), 100.0 * count as f64 / voxels))
}

fn named(name: Option<&str>) -> String {
    name.map_or_else(String::new, |name| format!(" '{name}'"))
}

fn look(display: &ChannelDisplay) -> String {
    let name = named(display.name.as_deref());
    let color = if display.color == [255; 3] { String::new() } else { format!(" {}", hex(display.color)) };
    let hidden = if display.is_visible { "" } else { " hidden" };
    [name, color, hidden.into()].concat()
}

fn orientation(store: &Store) -> String {
    let (placement, geometry) = (store.placement(), store.geometry());
    let Some(orientation) = &store.info().orientation else {
        return "  orientation not known: the world's axes are the volume's own".into();
    };
    let towards = [0, 1, 2].map(|axis| Side::of(orientation.step(axis)).name());
    let code = orientation.code();
    let first = placement.world_from_volume(geometry.world_from_voxel(DVec3::splat(0.5)));
    let [x, y, z] = first.to_array().map(short);
    format!(
        "  in a patient: axes run to {code} (x nearest to {}, y to {}, z to {}), first voxel centre at {x} x {y} x {z} mm right, front, head",
        towards[0], towards[1], towards[2]
    )
}

/// Formats each number with as many digits as it takes to read back the same.
fn triple(numbers: [f64; 3]) -> String {
    numbers.map(|number| significant(number, 9)).join(" x ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statistics_have_the_digits_that_tell() {
        let small = [-5.995_736e-7f32, 1.338_123e-6].map(f64::from);
        assert_eq!(
            statistics(small, 4.834_123e-7, (f64::from(-3.97e-7f32), 1e-6), VoxelType::F32),
            "values -5.995736e-7 to 1.338123e-6, mean 4.834e-7, window -3.97e-7 to 1e-6"
        );
        assert_eq!(
            statistics([999_998_000.0, 1_000_002_000.0], 1_000_000_000.26, (1e9, 1_000_001_408.0), VoxelType::U32),
            "values 999998000 to 1000002000, mean 1000000000.3, window 1e9 to 1000001408"
        );
        let constant = statistics([7.0, 7.0], 7.0, (6.5, 7.5), VoxelType::U8);
        assert_eq!(constant, "values 7 to 7, mean 7, window 6.5 to 7.5");
    }

    #[test]
    fn placements_have_no_digits_of_rounding() {
        assert_eq!(triple([0.5, 2.0, 1e-7]), "0.5 x 2 x 1e-7");
        assert_eq!(triple([0.1 + 0.2, -12.25, 1e6]), "0.3 x -12.25 x 1000000");
        assert_eq!(triple([0.806_532_712_900_734_2, 1.0, 3.0]), "0.806532713 x 1 x 3");
    }
}
