//! `brickyard pack`: foreign files into a brick store.

use super::failure::Failure;
use super::pack_settings::PackSettings;
use super::{store_errors, values};
use brickyard::import::{self, AxisOrder, Endian, FileOrder, NoData, OpenOptions};
use brickyard::volume::{Extent, VoxelType};
use clap::{Args, ValueEnum};
use glam::DVec3;
use std::path::PathBuf;

/// `brickyard pack INPUT... STORE`
#[derive(Args)]
pub(crate) struct PackArguments {
    /// Input files (or a folder of TIFF planes or DICOM slices), then the store to make; several inputs are time steps, or planes
    #[arg(required = true, num_args = 1.., value_name = "INPUT... STORE")]
    paths: Vec<PathBuf>,
    /// Voxels along each axis, for raw input
    #[arg(long, value_name = "X,Y,Z", value_parser = values::extent)]
    shape: Option<Extent>,
    /// Voxel type, for raw input: u8, i8, u16, i16, u32, i32, f32
    #[arg(long)]
    dtype: Option<VoxelType>,
    /// Byte order, for raw input
    #[arg(long, value_enum, default_value_t = EndianArgument::Little)]
    endian: EndianArgument,
    /// Bytes to skip at the start, for raw input
    #[arg(long, value_name = "BYTES", default_value_t = 0)]
    offset: u64,
    /// Axis letters of the input's array, slowest first, e.g. tczyx
    #[arg(long)]
    axes: Option<AxisOrder>,
    /// Time steps in the file, for raw input with a t axis
    #[arg(long)]
    times: Option<u32>,
    /// Channels in the file, for raw input with a c axis
    #[arg(long)]
    channels: Option<u32>,
    /// Order of several files: as given, or by the numbers in their names whatever these count [default: that of a list, unless a shell
    /// made it of a pattern; otherwise by their numbers, where these have no gaps and count one thing]
    #[arg(long, value_enum)]
    order: Option<OrderArgument>,
    /// World distance between voxel centres; overrides the file's
    #[arg(long, value_name = "X,Y,Z", value_parser = values::spacing)]
    spacing: Option<DVec3>,
    /// World position of the first voxel's centre; overrides the file's
    #[arg(long, value_name = "X,Y,Z", value_parser = values::vec3, allow_hyphen_values = true)]
    origin: Option<DVec3>,
    /// World unit: nm, um, mm, cm, m, or a UDUNITS name; overrides the file's
    #[arg(long)]
    unit: Option<String>,
    /// Value of voxels that hold no data, such as -9999: these are not drawn, averaged or counted; none for a file whose own value
    /// (DICOM's padding, GDAL's tag in TIFF) is data [default: the file's]
    #[arg(long, value_name = "VALUE|none", value_parser = values::nodata, allow_hyphen_values = true)]
    nodata: Option<NoData>,
    /// Accept 64-bit numbers that f32 or 32-bit integers do not hold as they are; what is lost is counted
    #[arg(long)]
    allow_lossy: bool,
    /// Folder for scratch files of inputs that cannot be sought in
    #[arg(long, value_name = "FOLDER")]
    scratch: Option<PathBuf>,
    #[command(flatten)]
    settings: PackSettings,
}

#[derive(Clone, Copy, ValueEnum)]
enum EndianArgument {
    Little,
    Big,
}

#[derive(Clone, Copy, ValueEnum)]
enum OrderArgument {
    Given,
    Natural,
}

/// Runs `pack`.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(mut arguments: PackArguments) -> Result<(), Failure> {
    let store = arguments.paths.pop().filter(|_| !arguments.paths.is_empty());
    let store =
        store.ok_or_else(|| Failure::usage("expected at least one input and the store to make: INPUT... STORE"))?;
    let options = OpenOptions {
        shape: arguments.shape,
        voxel_type: arguments.dtype,
        endian: match arguments.endian {
            EndianArgument::Little => Endian::Little,
            EndianArgument::Big => Endian::Big,
        },
        offset: arguments.offset,
        axes: arguments.axes,
        times: arguments.times,
        channels: arguments.channels,
        order: arguments.order.map(|order| match order {
            OrderArgument::Given => FileOrder::Given,
            OrderArgument::Natural => FileOrder::Natural,
        }),
        spacing: arguments.spacing,
        origin: arguments.origin,
        unit: arguments.unit.as_deref().map(unit_name),
        nodata: arguments.nodata.unwrap_or_default(),
        allow_lossy: arguments.allow_lossy,
        scratch_dir: arguments.scratch,
    };
    let source = import::open(&arguments.paths, &options).map_err(|error| store_errors::import_failure(&error))?;
    arguments.settings.pack(&*source, &store)
}

/// The UDUNITS name of a unit's symbol; other names pass unchanged.
fn unit_name(symbol: &str) -> String {
    match symbol {
        "nm" => "nanometer",
        "um" | "µm" => "micrometer",
        "mm" => "millimeter",
        "cm" => "centimeter",
        "m" => "meter",
        other => other,
    }
    .to_string()
}
