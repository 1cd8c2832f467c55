//! MetaImage of one channel: `.mha` with its voxels behind the header, `.mhd` with them in a file beside it. The matrix and the offset are of a
//! patient's left, back and head; a volume without an orientation is placed with x to the right, y to the front and z to the head, and one without a
//! known spacing is not placed.

use crate::error::ExportError;
use crate::facts::Fact;
use crate::frame::{Frame, length_unit, words};
use crate::plan::{Body, Layout, Plan};
use crate::volume::Volume;
use brickyard_volume::VoxelType;
use brickyard_volume::units::LengthUnit;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// The file of voxels beside a header of this name.
pub(crate) fn data_beside(header: &Path) -> PathBuf {
    header.with_extension("raw")
}

/// Plans a file, or with `data` a header and its file of voxels.
pub(crate) fn plan(volume: &Volume, data: Option<&Path>) -> Result<Plan, ExportError> {
    volume.check_one_channel("MetaImage")?;
    let info = volume.info;
    let (unit, to_unit) = unit_of(volume);
    let own = Frame::of(info);
    let frame = own.scaled(to_unit);
    let text = match data {
        None => header(volume, &frame, unit, "LOCAL"),
        Some(data) => header(volume, &frame, unit, name_of(volume, data)?),
    };
    let mut kept = vec![Fact::Spacing, Fact::Orientation];
    if info.calibrated {
        kept.push(Fact::Origin);
    }
    if unit.is_some() {
        kept.push(Fact::LengthUnit);
    }
    if is_even(volume) {
        kept.push(Fact::Times);
    }
    let mut notes: Vec<String> = own.contradiction(info).into_iter().collect();
    if is_even(volume) && !volume.is_placed() {
        notes.push("MetaImage has no spacing of times without that of voxels, which is unknown: 1 is written.".into());
    }
    if info.calibrated && info.orientation.is_none() {
        notes.push("MetaImage places every volume in a patient: x, y, z are written as right, front, head.".into());
    }
    let (head, text) = if data.is_some() { (Vec::new(), Some(text)) } else { (text, None) };
    let plan = Plan::new(volume, "MetaImage", &kept, Body::Flat(Layout::after(head, volume))).noted(notes);
    Ok(Plan { text, ..plan })
}

/// The file of voxels as the header names it.
fn name_of<'a>(volume: &Volume, data: &'a Path) -> Result<&'a str, ExportError> {
    let name = data.file_name().and_then(|name| name.to_str());
    // MetaIO takes these words, a pattern and a list of blanks for something else.
    let is_plain = |name: &&str| {
        name.trim() == *name && !name.contains(['%', '\n', '\r']) && !["LOCAL.raw", "LIST.raw"].contains(name)
    };
    name.filter(is_plain).filter(|name| !name.contains(' ')).ok_or_else(|| {
        ExportError::unfit(
            volume.output,
            "a header cannot name its file of voxels: choose a name without blanks and %, or .mha",
        )
    })
}

/// MetaImage's word for the unit of length, and the conversion to it.
fn unit_of(volume: &Volume) -> (Option<&'static str>, Box<dyn Fn(f64) -> f64>) {
    let same: Box<dyn Fn(f64) -> f64> = Box::new(|length| length);
    let Some(own) = length_unit(volume.info) else { return (None, same) };
    match own.name {
        "micrometer" => (Some("um"), same),
        "millimeter" => (Some("mm"), same),
        "centimeter" => (Some("cm"), same),
        _ => {
            let millimetre = LengthUnit::named("millimeter").unwrap_or(own);
            (Some("mm"), Box::new(move |length| own.convert(length, millimetre)))
        }
    }
}

fn is_even(volume: &Volume) -> bool {
    volume.info.times > 1 && volume.info.time.as_ref().is_some_and(|axis| axis.stamps.is_empty())
}

fn header(volume: &Volume, frame: &Frame, unit: Option<&str>, data: &str) -> Vec<u8> {
    let info = volume.info;
    let has_time = info.times > 1;
    let (start, step) = match &info.time {
        Some(axis) if is_even(volume) => (axis.start, axis.step),
        _ => (0.0, 1.0),
    };
    let with_time = |space: [f64; 3], time: f64| words(space.into_iter().chain(has_time.then_some(time)));
    let mut text = String::new();
    let mut line = |key: &str, value: &str| writeln!(text, "{key} = {value}").expect("a string takes all");
    line("ObjectType", "Image");
    line("NDims", if has_time { "4" } else { "3" });
    line("BinaryData", "True");
    line("BinaryDataByteOrderMSB", "False");
    line("CompressedData", "False");
    if volume.is_placed() {
        let frame = frame.to_left_back_head();
        let mut matrix: Vec<String> = frame.directions().map(|axis| with_time(axis.to_array(), 0.0)).into();
        if has_time {
            matrix.push("0 0 0 1".into());
        }
        line("TransformMatrix", &matrix.join(" "));
        line("Offset", &with_time(frame.first.to_array(), start));
        line("CenterOfRotation", &with_time([0.0; 3], 0.0));
        line("ElementSpacing", &with_time(frame.spacing.to_array(), step));
    } else if is_even(volume) {
        line("Offset", &with_time([0.0; 3], start));
        line("ElementSpacing", &with_time([1.0; 3], step));
    }
    if let Some(unit) = unit.filter(|_| info.calibrated) {
        line("DistanceUnits", unit);
    }
    let [x, y, z] = info.extent.to_array();
    let times = if has_time { format!(" {}", info.times) } else { String::new() };
    line("DimSize", &format!("{x} {y} {z}{times}"));
    line("ElementType", type_of(info.voxel_type));
    line("ElementDataFile", data);
    text.into_bytes()
}

fn type_of(voxel_type: VoxelType) -> &'static str {
    match voxel_type {
        VoxelType::U8 => "MET_UCHAR",
        VoxelType::I8 => "MET_CHAR",
        VoxelType::U16 => "MET_USHORT",
        VoxelType::I16 => "MET_SHORT",
        VoxelType::U32 => "MET_UINT",
        VoxelType::I32 => "MET_INT",
        VoxelType::F32 => "MET_FLOAT",
    }
}
