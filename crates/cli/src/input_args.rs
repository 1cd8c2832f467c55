//! Properties of foreign files that the files lack, or that the user knows better: flags shared by the commands that
//! read them.

use super::named::Named;
use super::step_range::StepRange;
use super::{Failure, heading, values};
use brickyard::import::{
    ArrayPlace, AxisOrder, ChannelArray, ChannelChoice, Element, Endian, FileOrder, Gaps, NoData, OpenOptions,
};
use brickyard::volume::{Extent, VoxelBox, VoxelType};
use clap::Args;
use glam::DVec3;
use std::path::PathBuf;

/// Options for reading foreign files.
#[derive(Args)]
pub(crate) struct InputArguments {
    /// Voxels along each axis, for raw input
    #[arg(help_heading = heading::RAW, long, value_name = "X,Y,Z", value_parser = values::extent)]
    shape: Option<Extent>,
    /// Voxel type, for raw input: u8, i8, u16, i16, u32, i32, f32; or f16, i64, u64, f64, which are held in 32 bits
    #[arg(help_heading = heading::RAW, long)]
    dtype: Option<Element>,
    /// Byte order, for raw input
    #[arg(help_heading = heading::RAW, long, value_parser = ENDIANS, default_value = "little")]
    endian: Endian,
    /// Bytes to skip at the start, for raw input; if given, also 0, bytes behind the voxels are left out, too [default: 0]
    #[arg(help_heading = heading::RAW, long, value_name = "BYTES")]
    offset: Option<u64>,
    /// Bytes from a time step to the next, for raw input with something between steps [default: as long as a step]
    #[arg(help_heading = heading::RAW, long, value_name = "BYTES")]
    step_bytes: Option<u64>,
    /// Bytes from a channel to the next, for raw input with something between channels [default: as long as a channel]
    #[arg(help_heading = heading::RAW, long, value_name = "BYTES")]
    channel_bytes: Option<u64>,
    /// Axis letters of the input's array, slowest first, e.g. tczyx [default: the file's; tczyx of raw input]
    #[arg(help_heading = heading::INPUT, long)]
    axes: Option<AxisOrder>,
    /// Array or dataset to read, from a file of several, also as FILE::NAME; several, separated by commas, are channels.
    /// Without an input, NAME=FILE for each channel, also NAME=FILE::PATH. A series, stack or segment of DICOM
    /// [default: the file's own choice, or its only one]
    #[arg(help_heading = heading::INPUT, long, value_name = "NAME[,NAME...]|NAME=FILE")]
    variable: Vec<String>,
    /// One channel of several, by name or number; or made of all: their magnitude, or the phase of complex numbers
    /// [default: every channel]
    #[arg(help_heading = heading::INPUT, long, value_name = "NAME|magnitude|phase")]
    component: Option<String>,
    /// Time steps in the file, for raw input with a t axis [default: 1]
    #[arg(help_heading = heading::RAW, long)]
    times: Option<u32>,
    /// Channels in the file, for raw input with a c axis [default: 1]
    #[arg(help_heading = heading::RAW, long)]
    channels: Option<u32>,
    /// Order of several files: as given, or by the numbers in their names, whatever these count [default: a list's own,
    /// unless a shell expanded it from a pattern; otherwise by number, if the numbers have no gaps and count one thing]
    #[arg(help_heading = heading::INPUT, long, value_parser = ORDERS)]
    order: Option<FileOrder>,
    /// Missing slices of a DICOM series: refuse them, or leave their places blank, without data
    #[arg(help_heading = heading::INPUT, long, value_parser = GAPS, default_value = "refuse")]
    gaps: Gaps,
    /// World distance between voxel centres; DICOM slices are taken as evenly spaced [default: the file's, or 1,1,1]
    #[arg(help_heading = heading::INPUT, long, value_name = "X,Y,Z", value_parser = values::spacing)]
    spacing: Option<DVec3>,
    /// World position of the first voxel's centre [default: the file's, or 0,0,0]
    #[arg(help_heading = heading::INPUT, long, value_name = "X,Y,Z", value_parser = values::vec3, allow_hyphen_values = true)]
    origin: Option<DVec3>,
    /// World unit: nm, um, mm, cm, m, or a UDUNITS name; or those of x, y and z, as degree,degree,hPa: lengths are
    /// converted to the first one's [default: the file's]
    #[arg(help_heading = heading::INPUT, long, value_name = "UNIT[,UNIT,UNIT]")]
    unit: Option<String>,
    /// Unit of the values of all channels, such as HU [default: the file's]
    #[arg(help_heading = heading::INPUT, long, value_name = "UNIT")]
    value_unit: Option<String>,
    /// Time from one step to the next, for evenly spaced steps [default: the file's]
    #[arg(help_heading = heading::INPUT, long, value_name = "TIME", value_parser = values::positive, allow_negative_numbers = true, conflicts_with = "time_stamps")]
    time_step: Option<f64>,
    /// Unit of time: s, ms, us, ns, min, h, d, or a UDUNITS name [default: the file's]
    #[arg(help_heading = heading::INPUT, long, value_name = "UNIT")]
    time_unit: Option<String>,
    /// File with the time of each step, for unevenly spaced steps: one number per line, ascending [default: the files'
    /// own times]
    #[arg(help_heading = heading::INPUT, long, value_name = "FILE")]
    time_stamps: Option<PathBuf>,
    /// Value of voxels without data, such as -9999: these are not drawn, averaged or counted; none for a file whose own
    /// value (DICOM's padding, GDAL's tag in TIFF) is data [default: the file's]
    #[arg(help_heading = heading::INPUT, long, value_name = "VALUE|none", value_parser = values::nodata, allow_hyphen_values = true)]
    nodata: Option<NoData>,
    /// Box to take, in voxels of the input, ends excluded; it keeps its place in the world [default: all]
    #[arg(help_heading = heading::INPUT, long, value_name = "x0:x1,y0:y1,z0:z1", value_parser = values::voxel_box)]
    roi: Option<VoxelBox>,
    /// Axes along which to reverse the voxels' order: the object is mirrored in its place; with an orientation (NIfTI,
    /// DICOM) each voxel keeps its place in the patient instead. none appends a file as it is to a store packed with a
    /// flip [default: none]
    #[arg(help_heading = heading::INPUT, long, value_name = "AXIS[,AXIS]|none", value_parser = values::flip)]
    flip: Option<[bool; 3]>,
    /// Channels to take, in this order, by number (from 0) or name [default: all]
    #[arg(help_heading = heading::INPUT, long, value_name = "CHANNEL,...", value_delimiter = ',')]
    take_channel: Vec<ChannelChoice>,
    /// Time steps to take, N, A:B or A:B:S (B excluded), with their times [default: all]
    #[arg(help_heading = heading::INPUT, long, value_name = "N|A:B[:S]")]
    take_time: Option<StepRange>,
    /// Voxel type to convert to; values stay the same numbers, none is rescaled [default: the input's]
    #[arg(help_heading = heading::INPUT, long, value_name = "DTYPE")]
    to_dtype: Option<VoxelType>,
    /// Accept numbers that the voxel type cannot hold (64-bit ones, and those of --to-dtype), rounded and clamped;
    /// losses are counted. Never for labels, which would become others
    #[arg(help_heading = heading::INPUT, long)]
    allow_lossy: bool,
    /// Folder for scratch files of inputs without random access [default: the system's for temporary files]
    #[arg(help_heading = heading::WORK, long, value_name = "FOLDER")]
    scratch: Option<PathBuf>,
}

const ENDIANS: Named<Endian> = Named(&[("little", Endian::Little, ""), ("big", Endian::Big, "")]);
const ORDERS: Named<FileOrder> = Named(&[("given", FileOrder::Given, ""), ("natural", FileOrder::Natural, "")]);
const GAPS: Named<Gaps> = Named(&[("refuse", Gaps::Refuse, ""), ("blank", Gaps::Blank, "")]);

impl InputArguments {
    /// The options for these inputs. Without any, the first file of `--variable NAME=FILE` becomes one, standing for all
    /// channels.
    ///
    /// # Errors
    /// Exit code 2 for a malformed `--variable`.
    pub(crate) fn options(self, inputs: &mut Vec<PathBuf>) -> Result<OpenOptions, Failure> {
        let (variable, channel_arrays) =
            arrays_of(&self.variable, inputs).map_err(|problem| Failure::usage(format!("--variable {problem}")))?;
        Ok(OpenOptions {
            shape: self.shape,
            voxel_type: self.dtype,
            endian: self.endian,
            offset: self.offset,
            step_bytes: self.step_bytes,
            channel_bytes: self.channel_bytes,
            axes: self.axes,
            variable,
            channel_arrays,
            component: self.component,
            times: self.times,
            channels: self.channels,
            order: self.order,
            gaps: self.gaps,
            spacing: self.spacing,
            origin: self.origin,
            unit: self.unit,
            value_unit: self.value_unit,
            time_step: self.time_step,
            time_unit: self.time_unit,
            time_stamps: self.time_stamps,
            nodata: self.nodata.unwrap_or_default(),
            roi: self.roi,
            flip: self.flip,
            take_channel: self.take_channel,
            take_time: self.take_time.as_ref().map(StepRange::choice),
            to_voxel_type: self.to_dtype,
            allow_lossy: self.allow_lossy,
            scratch_dir: self.scratch,
            ..OpenOptions::default()
        })
    }
}

/// The array that `--variable` names, or those that become channels: of the inputs, or of files of their own, the first of
/// which becomes the input.
fn arrays_of(variable: &[String], inputs: &mut Vec<PathBuf>) -> Result<(Option<String>, Vec<ChannelArray>), String> {
    match variable {
        [] => Ok((None, Vec::new())),
        texts if inputs.is_empty() => {
            let arrays = texts.iter().map(|text| ChannelArray::of_file(text)).collect::<Result<Vec<_>, _>>()?;
            if let Some(ChannelArray { place: ArrayPlace::File(file), .. }) = arrays.first() {
                inputs.push(file.clone());
            }
            Ok((None, arrays))
        }
        [one] if !one.contains(',') => Ok((Some(one.clone()), Vec::new())),
        texts => Ok((None, ChannelArray::of_input(texts)?)),
    }
}
