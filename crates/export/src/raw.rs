//! Voxels alone, little-endian, x fastest, then y, z, channel, time; and a text beside them, by which `pack` reads them without flags.

use crate::error::ExportError;
use crate::facts::{Fact, moment, value_unit};
use crate::plan::{Body, Layout, Plan};
use crate::volume::Volume;
use serde_json::{Map, Value, json};
use std::path::{Path, PathBuf};

/// The text beside a raw file of this name.
pub(crate) fn text_beside(raw: &Path) -> PathBuf {
    let mut name = raw.as_os_str().to_owned();
    name.push(".json");
    name.into()
}

pub(crate) fn plan(volume: &Volume) -> Result<Plan, ExportError> {
    let mut kept = vec![
        Fact::Spacing,
        Fact::Origin,
        Fact::Orientation,
        Fact::Times,
        Fact::StepTime,
        Fact::TimeUnit,
        Fact::ChannelNames,
        Fact::NoData,
        Fact::Labels,
    ];
    if value_unit(volume).is_some() {
        kept.push(Fact::ValueUnit);
    }
    if unit(volume).is_some() {
        kept.push(Fact::LengthUnit);
    }
    if moment(volume).is_some() {
        kept.push(Fact::Since);
    }
    let text = text(volume)?;
    let plan = Plan::new(volume, "The text beside a .raw file", &kept, Body::Flat(Layout::after(Vec::new(), volume)));
    Ok(Plan { text: Some(text), ..plan })
}

/// The unit of lengths, or of each axis if all have one.
fn unit(volume: &Volume) -> Option<String> {
    let geometry = &volume.info.geometry;
    match &geometry.axis_units {
        Some(units) => units.iter().all(|unit| !unit.is_empty()).then(|| units.join(",")),
        None => geometry.unit.clone(),
    }
}

/// The fields of the text.
fn text(volume: &Volume) -> Result<Vec<u8>, ExportError> {
    let info = volume.info;
    let name = volume.output.file_name().and_then(|name| name.to_str());
    let name = name.ok_or_else(|| ExportError::unfit(volume.output, "the name is no text in UTF-8: choose another"))?;
    let mut fields = Map::new();
    let mut set = |key: &str, value: Value| drop(fields.insert(key.into(), value));
    set("file", json!(name));
    set("shape", json!(info.extent.to_array()));
    set("dtype", json!(info.voxel_type.name()));
    set("endian", json!("little"));
    set("axes", json!("tczyx"));
    set("times", json!(info.times));
    set("channels", json!(info.channels));
    if info.calibrated {
        set("spacing", json!(info.geometry.spacing.to_array()));
    }
    if info.geometry.origin.to_array() != [0.0; 3] {
        set("origin", json!(info.geometry.origin.to_array()));
    }
    if let Some(unit) = unit(volume) {
        set("unit", json!(unit));
    }
    if let Some(orientation) = &info.orientation {
        set("orientation", json!(orientation.rows()));
    }
    if info.channel_looks.iter().any(|look| look.name.is_some()) {
        let names = info.channel_looks.iter().map(|look| look.name.as_deref().unwrap_or(""));
        set("channel_names", names.collect());
    }
    if let Some(unit) = value_unit(volume) {
        set("value_unit", json!(unit));
    }
    if let Some(nodata) = info.nodata {
        set("nodata", json!(nodata));
    }
    if volume.is_labels {
        set("labels", json!(true));
    }
    if let Some(time) = &info.time {
        match (info.times, time.stamps.is_empty()) {
            (1, _) => set("time_start", json!(time.start)),
            (_, true) => {
                set("time_start", json!(time.start));
                set("time_step", json!(time.step));
            }
            (_, false) => set("time_stamps", json!(time.stamps)),
        }
        if let Some(unit) = &time.unit {
            set("time_unit", json!(unit));
        }
        if let Some(since) = moment(volume) {
            set("time_since", json!(since));
        }
    }
    Ok(format!("{:#}\n", Value::Object(fields)).into_bytes())
}
