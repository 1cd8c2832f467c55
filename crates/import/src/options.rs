//! What the user says of an input, where a file does not say it or says it wrong.

use crate::axes::AxisOrder;
use crate::element::Endian;
use brickyard_volume::{Extent, VoxelType};
use glam::DVec3;
use std::path::PathBuf;

/// How several files are put in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileOrder {
    /// The files in the order in which they are given.
    Given,
    /// The files by the numbers in their names, whatever these count.
    Natural,
}

/// What the user says of the input. Everything is optional but for raw files, which need shape and type.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenOptions {
    /// Voxels along x, y, z of a raw file; makes any file be read as raw.
    pub shape: Option<Extent>,
    /// Voxel type of a raw file.
    pub voxel_type: Option<VoxelType>,
    /// Byte order of a raw file.
    pub endian: Endian,
    /// Bytes before the first voxel of a raw file.
    pub offset: u64,
    /// Number of channels of a raw file, or of a TIFF file whose `axes` are given.
    pub channels: Option<u32>,
    /// Number of time steps in a raw file, or in a TIFF file whose `axes` are given.
    pub times: Option<u32>,
    /// Order of the axes, slowest first, in place of what the file or the format says.
    pub axes: Option<AxisOrder>,
    /// The order of several files. By default that of a list, unless a shell made it of a pattern, and else that of the numbers in their
    /// names, where these count them one after another.
    pub order: Option<FileOrder>,
    /// Spacing in place of the file's.
    pub spacing: Option<DVec3>,
    /// Position of the first voxel's centre in place of the file's.
    pub origin: Option<DVec3>,
    /// UDUNITS name of the unit in place of the file's.
    pub unit: Option<String>,
    /// Whether 64-bit numbers may be narrowed to 32.
    pub allow_lossy: bool,
    /// Where compressed inputs are inflated; the system's temporary directory by default.
    pub scratch_dir: Option<PathBuf>,
}
