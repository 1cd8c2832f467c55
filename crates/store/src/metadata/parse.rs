//! Reading of documents, checked field by field.

use super::{ChannelDisplay, FORMAT_VERSION, StoreInfo};
use crate::error::OpenError;
use crate::json::not_json;
use crate::layout::{Layout, check_shard_bricks, check_size};
use brickyard_volume::{Extent, Geometry, LabelColor, Level, Placement, Pyramid, channel};
use glam::DVec3;
use serde_json::{Value, json};
use std::collections::BTreeMap;
use std::path::Path;

/// Compares an array document with the expected one; an error names the first differing field. In a store with appended
/// steps an array `may_be_longer`: an interrupted append may have added some.
pub(crate) fn check_array(path: &Path, expected: &Value, found: &Value, may_be_longer: bool) -> Result<(), OpenError> {
    const FIELDS: [&str; 8] =
        ["zarr_format", "node_type", "shape", "data_type", "chunk_grid", "chunk_key_encoding", "fill_value", "codecs"];
    for field in FIELDS {
        let (want, have) = (&expected[field], &found[field]);
        // 0 and 0.0 are the same fill value.
        let same = want == have || (want.as_f64().is_some() && want.as_f64() == have.as_f64());
        let or_more = may_be_longer && field == "shape";
        if !(same || or_more && is_longer(want, have)) {
            let or_more = if or_more { ", or a greater first number" } else { "" };
            return Err(OpenError::invalid(path, field, format!("{want}{or_more}"), have));
        }
    }
    Ok(())
}

/// Whether a shape has at least the expected number of time steps, its first axis, and is the same otherwise.
fn is_longer(expected: &Value, found: &Value) -> bool {
    let times_and_rest = |shape: &Value| {
        let (times, rest) = shape.as_array()?.split_first()?;
        Some((times.as_u64(), rest.to_vec()))
    };
    let (Some(expected), Some(found)) = (times_and_rest(expected), times_and_rest(found)) else { return false };
    expected.1 == found.1 && expected.0 <= found.0
}

/// The remedy for a store written by another program, which is only read.
pub(crate) const OTHERS_STORE: &str =
    "it is drawn and exported where it lies; 'brickyard pack INPUT STORE' makes a store of it";

/// Refuses another program's root document.
pub(crate) fn check_own(path: &Path, root: &Value) -> Result<(), OpenError> {
    if !root["attributes"]["brickyard"].is_null() {
        return Ok(());
    }
    let feature = "a Zarr without brickyard's side data".into();
    Err(OpenError::Unsupported { path: path.into(), feature, advice: OTHERS_STORE })
}

/// Reads settings and statistics from the root document.
pub(crate) fn parse_info(path: &Path, root: &Value) -> Result<StoreInfo, OpenError> {
    check_own(path, root)?;
    let attributes = &root["attributes"];
    let ours = &attributes["brickyard"];
    match ours["version"].as_u64() {
        Some(version) if version == u64::from(FORMAT_VERSION) => {}
        Some(version) if version < u64::from(FORMAT_VERSION) => {
            let store = path.parent().unwrap_or(path).to_path_buf();
            let source = ours["source"].as_str().unwrap_or("its source").to_owned();
            return Err(OpenError::OldFormat { store, version, source_name: source });
        }
        _ => {
            let feature = format!("store format version {} (this program reads {FORMAT_VERSION})", ours["version"]);
            let advice = "open it with a later version of brickyard";
            return Err(OpenError::Unsupported { path: path.into(), feature, advice });
        }
    }
    serde_json::from_value(ours.clone())
        .map_err(|error| OpenError::invalid(path, "attributes.brickyard", "the settings of a store", not_json(&error)))
}

/// Derives the layout from level 0's shape and the settings, and checks both.
pub(crate) fn parse_layout(
    root_path: &Path,
    root: &Value,
    level_path: &Path,
    level_0: &Value,
    info: &StoreInfo,
) -> Result<Layout, OpenError> {
    let names: Vec<&str> = match root["attributes"]["ome"]["multiscales"][0]["axes"].as_array() {
        Some(axes) => axes.iter().filter_map(|a| a["name"].as_str()).collect(),
        None => Vec::new(),
    };
    if !matches!(names[..], ["z", "y", "x"] | ["c", "z", "y", "x"] | ["t", "z", "y", "x"] | ["t", "c", "z", "y", "x"]) {
        let field = "attributes.ome.multiscales[0].axes";
        return Err(OpenError::invalid(root_path, field, "names [t,] [c,] z, y, x", format!("{names:?}")));
    }
    let shape: Option<Vec<u32>> = serde_json::from_value(level_0["shape"].clone()).ok();
    let Some(shape) = shape.filter(|s| s.len() == names.len() && s.iter().all(|&n| n > 0)) else {
        let expected = format!("{} positive integers below 2^32", names.len());
        return Err(OpenError::invalid(level_path, "shape", expected, &level_0["shape"]));
    };
    let size = |name: &str| names.iter().position(|n| *n == name).map_or(1, |i| shape[i]);
    let times = committed_times(root_path, info, &names, level_path, size("t"))?;
    let channels = size("c");
    let extent = Extent::new(size("x"), size("y"), size("z"));
    if let Err((field, expected)) = check_size(extent, times, channels) {
        return Err(OpenError::invalid(level_path, field, expected, &level_0["shape"]));
    }
    info.check(root_path, channels)?;
    let pyramid = Pyramid::new(extent, info.spacing, info.edge);
    let layout = Layout::new(pyramid, times, channels, info.shard).with_shard_times(info.shard_times);
    let unfit = |field: &str, expected| {
        let found = if field == "shard" { info.shard } else { info.shard_times };
        OpenError::invalid(root_path, format!("attributes.brickyard.{field}"), expected, found)
    };
    if layout.shard_times != info.shard_times {
        return Err(unfit("shard_times", format!("1 to {times}, the number of time steps")));
    }
    check_shard_bricks(&layout).map_err(|(field, expected)| unfit(field, expected))?;
    Ok(if names[0] == "t" { layout.with_time() } else { layout })
}

/// The root document's number of time steps, if given, otherwise level 0's.
fn committed_times(
    root_path: &Path,
    info: &StoreInfo,
    axes: &[&str],
    level_path: &Path,
    times_of_level: u32,
) -> Result<u32, OpenError> {
    let Some(times) = info.times else { return Ok(times_of_level) };
    if axes[0] != "t" || times == 0 {
        let expected = if times == 0 { "at least 1" } else { "none without an axis t" };
        return Err(OpenError::invalid(root_path, "attributes.brickyard.times", expected, times));
    }
    if times_of_level < times {
        let expected = format!("at least {times} time steps, by attributes.brickyard.times of the root document");
        return Err(OpenError::invalid(level_path, "shape", expected, times_of_level));
    }
    Ok(times)
}

/// Reads the placement from the pyramid's multiscale, and checks every level's against level 0's.
pub(crate) fn parse_geometry(
    path: &Path,
    root: &Value,
    layout: &Layout,
    info: &StoreInfo,
) -> Result<Geometry, OpenError> {
    let owner = if layout.second().is_some() { "brickyard" } else { "ome" };
    let multiscale = &root["attributes"][owner]["multiscales"][0];
    let field = |k: usize, what: &str| format!("attributes.{owner}.multiscales[0].datasets[{k}]{what}");
    let datasets = multiscale["datasets"].as_array().map_or(&[][..], |d| d);
    let levels = layout.pyramid.levels();
    if datasets.len() != levels.len() {
        let field = format!("attributes.{owner}.multiscales[0].datasets");
        return Err(OpenError::invalid(path, field, format!("{} levels", levels.len()), datasets.len()));
    }
    let mut placements = Vec::new();
    for (k, dataset) in datasets.iter().enumerate() {
        let expected = layout.level_path(Level(k as u8));
        if dataset["path"] != json!(expected) {
            return Err(OpenError::invalid(path, field(k, ".path"), expected, &dataset["path"]));
        }
        let axes = layout.axes().len();
        let transforms = &dataset["coordinateTransformations"];
        let scale = spatial(transforms, "scale", axes).filter(|s| s.min_element() > 0.0);
        let Some((scale, translation)) = scale.zip(spatial(transforms, "translation", axes)) else {
            let expected = format!("a positive scale and a translation of {axes} numbers");
            return Err(OpenError::invalid(path, field(k, ".coordinateTransformations"), expected, transforms));
        };
        placements.push((scale, translation));
    }
    let (unit, axis_units) = spatial_units(&multiscale["axes"], info);
    let geometry = Geometry { spacing: placements[0].0, origin: placements[0].1, unit, axis_units };
    for (k, (level, found)) in levels.iter().zip(&placements).enumerate() {
        let expected = geometry.level_placement(level.factor);
        // Written in full precision; another tool may have rounded to about seven digits.
        let tolerance = expected.0.max_element() * 1e-5 + geometry.origin.abs().max_element() * 1e-6;
        let near = |a: DVec3, b: DVec3| (a - b).abs().max_element() <= tolerance;
        if !(near(expected.0, found.0) && near(expected.1, found.1)) {
            let show = |(s, t): &(DVec3, DVec3)| format!("scale {s} and translation {t} (x, y, z)");
            let field = field(k, ".coordinateTransformations");
            return Err(OpenError::invalid(path, field, show(&expected), show(found)));
        }
    }
    Ok(geometry)
}

/// Reads level 0's placement, without a look at the levels.
pub(crate) fn parse_unchecked_geometry(path: &Path, root: &Value, info: &StoreInfo) -> Result<Geometry, OpenError> {
    let multiscale = &root["attributes"]["ome"]["multiscales"][0];
    let axes = multiscale["axes"].as_array().map_or(0, Vec::len);
    let transforms = &multiscale["datasets"][0]["coordinateTransformations"];
    let placed = spatial(transforms, "scale", axes).zip(spatial(transforms, "translation", axes));
    let Some((spacing, origin)) = placed else {
        let field = "attributes.ome.multiscales[0].datasets[0].coordinateTransformations";
        return Err(OpenError::invalid(
            path,
            field,
            format!("a scale and a translation of {axes} numbers"),
            transforms,
        ));
    };
    let (unit, axis_units) = spatial_units(&multiscale["axes"], info);
    Ok(Geometry { spacing, origin, unit, axis_units })
}

/// The unit of all axes of space, or the units of x, y and z. Lengths are OME-Zarr's, whose edits count.
fn spatial_units(axes: &Value, info: &StoreInfo) -> (Option<String>, Option<[String; 3]>) {
    let axes = axes.as_array().map_or(&[][..], |axes| axes);
    let said = [1, 2, 3].map(|from_end| axes.get(axes.len().checked_sub(from_end)?)?["unit"].as_str());
    match (&info.axis_units, said) {
        (Some(ours), _) => {
            let unit = |axis: usize| said[axis].map_or_else(|| ours[axis].clone(), str::to_owned);
            (None, Some([0, 1, 2].map(unit)))
        }
        (None, [Some(x), Some(y), Some(z)]) if x != y || x != z => (None, Some([x, y, z].map(str::to_owned))),
        (None, [x, ..]) => (x.map(str::to_owned), None),
    }
}

/// Displays from the store's OME metadata, editable by other tools, with unusable entries replaced by the packed ones.
pub(crate) fn parse_displays(root: &Value, info: &StoreInfo) -> Vec<ChannelDisplay> {
    let display = |(i, packed): (usize, ChannelDisplay)| {
        let said = &root["attributes"]["ome"]["omero"]["channels"][i];
        let end = |name: &str| said["window"][name].as_f64().filter(|value| value.is_finite());
        let window = end("start").zip(end("end")).filter(|(start, end)| start <= end);
        let label = said["label"].as_str().map(str::trim).filter(|label| !label.is_empty());
        ChannelDisplay {
            name: label.map(str::to_owned).or_else(|| info.channels[i].name.clone()),
            color: said["color"].as_str().and_then(channel::from_hex).unwrap_or(packed.color),
            window: window.unwrap_or(packed.window),
            is_visible: said["active"].as_bool().unwrap_or(packed.is_visible),
            unit: packed.unit,
        }
    };
    ChannelDisplay::of_channels(&info.channels).into_iter().enumerate().map(display).collect()
}

/// Label colours from the store's OME metadata, sorted by label; the last entry wins, unusable ones are dropped.
pub(crate) fn parse_label_colors(root: &Value) -> Vec<LabelColor> {
    let said = root["attributes"]["ome"]["image-label"]["colors"].as_array();
    let color = |entry: &Value| {
        let rgba: Vec<u64> = entry["rgba"].as_array()?.iter().filter_map(Value::as_u64).collect();
        let &[r, g, b, _] = &rgba[..] else { return None };
        let is_color = [r, g, b].iter().all(|&part| part <= 255);
        let color = [r, g, b].map(|part| part as f64 / 255.0);
        is_color.then_some((entry["label-value"].as_i64()?, color))
    };
    let colors: BTreeMap<i64, [f64; 3]> = said.into_iter().flatten().filter_map(color).collect();
    colors.into_iter().map(|(label, color)| LabelColor { label, color }).collect()
}

/// The placement from the volume's own world of spacing and origin to the patient's, if the store has an orientation.
pub(crate) fn parse_placement(path: &Path, info: &StoreInfo, geometry: &Geometry) -> Result<Placement, OpenError> {
    let Some(orientation) = &info.orientation else { return Ok(Placement::default()) };
    let field = "attributes.brickyard.orientation";
    let bad = |error| OpenError::invalid(path, field, "an invertible map, together with the spacing", error);
    orientation.placement(geometry).map_err(bad)
}

/// The x, y and z of the first transformation of this kind.
fn spatial(transforms: &Value, kind: &str, axes: usize) -> Option<DVec3> {
    let transform = transforms.as_array()?.iter().find(|t| t["type"] == kind)?;
    let numbers: Vec<f64> = transform[kind].as_array()?.iter().filter_map(Value::as_f64).collect();
    let [.., z, y, x] = numbers[..] else { return None };
    let v = DVec3::new(x, y, z);
    (numbers.len() == axes && v.is_finite()).then_some(v)
}
