//! VTK's image, `.vti`, of a time step: values at the points, each channel an array of its name, appended as they are. The place is the grid's
//! origin, spacing and direction.

use crate::error::ExportError;
use crate::facts::Fact;
use crate::frame::{Frame, words};
use crate::plan::{Body, Layout, Plan};
use crate::volume::Volume;
use crate::xml::escaped;
use brickyard_volume::VoxelType;
use glam::DVec3;
use std::collections::BTreeSet;
use std::fs::File;
use std::io::{self, Read};
use std::path::Path;

/// Bytes of an array's length, before it.
const LENGTH_BYTES: u64 = 8;
/// Most channels: each has a line in the header.
const MOST_CHANNELS: u32 = 1 << 16;
/// First lines, by which a file is known again.
const START: &str = "<?xml version=\"1.0\"?>\n<!-- Written by brickyard -->\n";
const END: &[u8] = b"\n  </AppendedData>\n</VTKFile>\n";

pub(crate) fn plan(volume: &Volume) -> Result<Plan, ExportError> {
    check_one_step(volume)?;
    check(volume)?;
    let body = Body::Flat(layout(volume, 0));
    Ok(Plan::new(volume, "A .vti file", &kept(volume), body).noted(contradiction(volume)))
}

/// Refuses several time steps.
fn check_one_step(volume: &Volume) -> Result<(), ExportError> {
    match volume.info.times {
        1 => Ok(()),
        times => {
            let problem = format!(
                "A .vti file holds one time step, not {times}: choose one with `time`, or a name ending in .pvd, .nrrd, .nii, .tif or .npy"
            );
            Err(ExportError::unfit(volume.output, problem))
        }
    }
}

/// Refuses a volume that is beyond the format.
pub(crate) fn check(volume: &Volume) -> Result<(), ExportError> {
    let info = volume.info;
    if info.channels > MOST_CHANNELS {
        let problem =
            format!("a .vti file holds {MOST_CHANNELS} channels at most, not {}: choose fewer", info.channels);
        return Err(ExportError::unfit(volume.output, problem));
    }
    if info.extent.to_array().iter().any(|size| *size > i32::MAX as u32) {
        return Err(ExportError::unfit(volume.output, "VTK counts 2,147,483,647 points along an axis: choose .nrrd"));
    }
    Ok(())
}

/// The facts of a step that its file keeps.
pub(crate) fn kept(volume: &Volume) -> Vec<Fact> {
    let mut kept = vec![Fact::Spacing, Fact::Orientation, Fact::StepTime, Fact::ChannelNames];
    if volume.info.calibrated {
        kept.push(Fact::Origin);
    }
    kept
}

/// A sentence on a place that is told in two ways.
pub(crate) fn contradiction(volume: &Volume) -> Option<String> {
    Frame::of(volume.info).contradiction(volume.info)
}

/// Whether a file is written here.
pub(crate) fn is_of_this_program(path: &Path) -> io::Result<bool> {
    let mut start = Vec::new();
    File::open(path)?.take(START.len() as u64).read_to_end(&mut start)?;
    Ok(start == START.as_bytes())
}

/// The file of a step.
pub(crate) fn layout(volume: &Volume, step: u32) -> Layout {
    let info = volume.info;
    let head = header(volume, &Frame::of(info), step);
    let bytes = volume.bytes();
    let channel_bytes = bytes.saturating_add(LENGTH_BYTES);
    let first = head.len() as u64;
    let lengths = (0..u64::from(info.channels)).map(|i| (first + i * channel_bytes, bytes.to_le_bytes().to_vec()));
    let end = (first + u64::from(info.channels) * channel_bytes, END.to_vec());
    let layout = Layout::after(head, volume);
    let others = lengths.chain([end]).collect();
    Layout { start: first + LENGTH_BYTES, channel_bytes, others, ..layout }
}

fn header(volume: &Volume, frame: &Frame, step: u32) -> Vec<u8> {
    let info = volume.info;
    let extent = info.extent.to_array().map(|size| format!("0 {}", size - 1)).join(" ");
    // Rows of a matrix whose columns are the directions.
    let [x, y, z] = frame.directions();
    let is_upright = [x, y, z] == [DVec3::X, DVec3::Y, DVec3::Z];
    let direction = words([0, 1, 2].into_iter().flat_map(|row| [x[row], y[row], z[row]]));
    let direction = if is_upright { String::new() } else { format!(" Direction=\"{direction}\"") };
    let (origin, spacing) = (words(frame.first.to_array()), words(frame.spacing.to_array()));
    // Readers take 1 where none is given.
    let place = if volume.is_placed() {
        format!(" Origin=\"{origin}\" Spacing=\"{spacing}\"{direction}")
    } else {
        String::new()
    };
    let names = names(volume);
    let kind = type_of(info.voxel_type);
    let bytes = volume.bytes().saturating_add(LENGTH_BYTES);
    let array = |(i, name): (u64, &String)| {
        let offset = i.saturating_mul(bytes);
        format!("        <DataArray type=\"{kind}\" Name=\"{name}\" format=\"appended\" offset=\"{offset}\"/>\n")
    };
    let arrays: String = (0..).zip(&names).map(array).collect();
    let time = info.time.as_ref().map_or(String::new(), |axis| {
        format!(
            "    <FieldData>\n      <DataArray type=\"Float64\" Name=\"TimeValue\" NumberOfTuples=\"1\" \
             format=\"ascii\">{}</DataArray>\n    </FieldData>\n",
            axis.at(step)
        )
    });
    let text = format!(
        "{START}\
         <VTKFile type=\"ImageData\" version=\"1.0\" byte_order=\"LittleEndian\" header_type=\"UInt64\">\n  \
         <ImageData WholeExtent=\"{extent}\"{place}>\n{time}    \
         <Piece Extent=\"{extent}\">\n      <PointData Scalars=\"{first}\">\n{arrays}      </PointData>\n    </Piece>\n  \
         </ImageData>\n  <AppendedData encoding=\"raw\">\n   _",
        first = names[0],
    );
    text.into_bytes()
}

/// Names of the arrays, each its own, as XML has them.
fn names(volume: &Volume) -> Vec<String> {
    let info = volume.info;
    let mut seen = BTreeSet::new();
    let name = |channel: usize| {
        let own = info.channel_looks.get(channel).and_then(|look| look.name.clone());
        let usual = if info.channels > 1 { format!("channel {channel}") } else { "values".into() };
        let own = escaped(&own.filter(|own| !own.trim().is_empty()).unwrap_or(usual));
        let unique = (2..).map(|n| format!("{own} {n}"));
        let unique = std::iter::once(own.clone()).chain(unique).find(|name| seen.insert(name.clone()));
        unique.unwrap_or(own)
    };
    (0..info.channels as usize).map(name).collect()
}

fn type_of(voxel_type: VoxelType) -> &'static str {
    match voxel_type {
        VoxelType::U8 => "UInt8",
        VoxelType::I8 => "Int8",
        VoxelType::U16 => "UInt16",
        VoxelType::I16 => "Int16",
        VoxelType::U32 => "UInt32",
        VoxelType::I32 => "Int32",
        VoxelType::F32 => "Float32",
    }
}
