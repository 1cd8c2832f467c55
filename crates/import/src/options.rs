//! What the user says of an input, where a file does not say it or says it wrong.

use crate::axes::AxisOrder;
use crate::element::Endian;
use crate::error::ImportError;
use crate::source::SourceInfo;
use brickyard_volume::{Extent, VoxelType};
use glam::DVec3;
use std::path::{Path, PathBuf};

/// How several files are put in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileOrder {
    /// The order in which the files are given.
    Given,
    /// The order of the numbers in the files' names, whether or not these count the files without gaps.
    Natural,
}

/// What becomes of slices that are missing between those of a DICOM series.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Gaps {
    /// A series with missing slices is an error.
    #[default]
    Refuse,
    /// Their places are left, and hold no data.
    Blank,
}

/// How the other steps of a series hold their voxels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldAs {
    /// Their type.
    pub voxel_type: VoxelType,
    /// The value of voxels that hold no data, if there is one.
    pub nodata: Option<f64>,
}

/// Which voxels of an input hold no data.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum NoData {
    /// Voxels of the value that the file says hold no data, if it says one.
    #[default]
    OfFile,
    /// All voxels hold data, whatever the file says.
    None,
    /// Voxels of this value hold no data, whatever the file says. It is one of the values that voxels are given, after the file's own scaling.
    Value(f64),
}

/// What the caller says about an input. Every field is optional, but a raw file needs `shape` and `voxel_type`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenOptions {
    /// Number of voxels along x, y, z of a raw file. If it is given, any file is read as raw.
    pub shape: Option<Extent>,
    /// Voxel type of a raw file.
    pub voxel_type: Option<VoxelType>,
    /// Byte order of a raw file.
    pub endian: Endian,
    /// Bytes before the first voxel of a raw file.
    pub offset: u64,
    /// Number of channels in a raw file (1 by default), or in a TIFF file whose `axes` are given.
    pub channels: Option<u32>,
    /// Number of time steps in a raw file (1 by default), or in a TIFF file whose `axes` are given.
    pub times: Option<u32>,
    /// Order of the axes, slowest first, in place of what the file or the format says. NIfTI and DICOM files
    /// have one of their own.
    pub axes: Option<AxisOrder>,
    /// Whether the input is one of several, each a time step of its own. `order` is then the order of these, and of the files in a folder
    /// where it is natural; and a file of a set, which would stand for all of them, is an error.
    pub is_step: bool,
    /// How several files are put in order. `None` keeps the order of a list that is neither alphabetical nor natural.
    /// Other lists, and folders, are sorted by the numbers in the files' names, which must count the files without
    /// gaps. For DICOM files it must be `None`.
    pub order: Option<FileOrder>,
    /// Distance between voxel centres along x, y, z, in place of the file's; every one must be above 0. DICOM slices
    /// are then taken as evenly spaced, with a note if their positions are not, unless `gaps` leaves the places of missing ones.
    pub spacing: Option<DVec3>,
    /// What becomes of missing slices of a DICOM series.
    pub gaps: Gaps,
    /// How the steps before hold their voxels. Those of DICOM, whose type and blanks follow from the data, are held alike where that is possible.
    pub held_as: Option<HeldAs>,
    /// Position of the first voxel's centre in place of the file's.
    pub origin: Option<DVec3>,
    /// UDUNITS name of the unit of length (`micrometer`), in place of the file's.
    pub unit: Option<String>,
    /// The time from one step to the next in place of the file's, where steps are evenly spaced; above 0.
    pub time_step: Option<f64>,
    /// The unit of time in place of the file's: a name of OME-Zarr's (`second`) or its symbol (`s`).
    pub time_unit: Option<String>,
    /// A file with the time of each step, where they are not evenly spaced: one number a line, ascending.
    pub time_stamps: Option<PathBuf>,
    /// Which voxels hold no data. The voxels' type must hold the value.
    pub nodata: NoData,
    /// Whether values that a voxel cannot hold may be rounded, clamped or become infinite: 64-bit numbers, and scaled
    /// numbers beyond f32. Otherwise the first such value is an error. Never of labels.
    pub allow_lossy: bool,
    /// Whether the voxels are labels: a value that a voxel cannot hold is an error then, since another would be another label.
    pub are_labels: bool,
    /// Whether somebody has opened the same files before with these options: they are not read again for values that a voxel cannot hold,
    /// and no note is made of these.
    pub is_looked_at: bool,
    /// Folder in which compressed inputs are inflated; `None` is the system's temporary directory.
    pub scratch_dir: Option<PathBuf>,
}

impl OpenOptions {
    /// Puts the user's spacing, origin and unit in place of the file's.
    pub(crate) fn override_geometry(&self, info: &mut SourceInfo, path: &Path) -> Result<(), ImportError> {
        if let Some(spacing) = self.spacing {
            if !(spacing.min_element() > 0.0 && spacing.is_finite()) {
                return Err(ImportError::options(path, format!("`spacing` {spacing}: every spacing must be above 0")));
            }
            let stretch = spacing / info.geometry.spacing;
            info.geometry.spacing = spacing;
            info.calibrated = true;
            if let Some(orientation) = &mut info.orientation {
                *orientation = orientation.stretched(stretch).map_err(|error| {
                    ImportError::options(path, format!("`spacing` {spacing}: with the header's orientation, {error}"))
                })?;
            }
        }
        if let Some(origin) = self.origin {
            if !origin.is_finite() {
                return Err(ImportError::options(path, format!("`origin` {origin}: not a position")));
            }
            (info.geometry.origin, info.says_origin) = (origin, true);
            info.orientation = info.orientation.map(|orientation| orientation.moved_to(origin));
        }
        if let Some(unit) = &self.unit {
            info.geometry.unit = Some(unit.clone());
        }
        Ok(())
    }
}
