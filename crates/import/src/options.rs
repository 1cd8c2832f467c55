//! The caller's settings for an input, where its file lacks them or is wrong.

use crate::axes::AxisOrder;
use crate::choice::{ChannelChoice, StepChoice};
use crate::element::{Element, Endian};
use crate::error::{ImportError, Result};
use crate::labels::SaidKind;
use crate::note::{Note, Setting};
use crate::source::SourceInfo;
use brickyard_volume::units::free_unit;
use brickyard_volume::{Extent, VoxelBox, VoxelType};
use glam::DVec3;
use std::path::{Path, PathBuf};

/// How several files are put in order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileOrder {
    /// The order in which the files are given.
    Given,
    /// The order of the numbers in the files' names, with or without gaps.
    Natural,
}

/// Treatment of slices missing within a DICOM series.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Gaps {
    /// A series with missing slices is an error.
    #[default]
    Refuse,
    /// Missing slices become gaps without data.
    Blank,
}

/// Encoding of voxels in the other steps of a series.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HeldAs {
    /// Their type.
    pub voxel_type: VoxelType,
    /// The value of voxels without data, if any.
    pub nodata: Option<f64>,
    /// Axes along which they come in the reverse order of their files', as [`SourceInfo::turned`].
    pub turned: [bool; 3],
}

/// Which voxels of an input hold no data.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub enum NoData {
    /// Voxels of the file's no-data value, if it has one.
    #[default]
    OfFile,
    /// All voxels hold data, whatever the file says.
    None,
    /// Voxels of this value, after the file's own scaling, hold no data, whatever the file says.
    Value(f64),
}

/// An array that becomes channels beside others.
#[derive(Clone, Debug, PartialEq)]
pub struct ChannelArray {
    /// The channel's name; of an array with several channels, the start of their names.
    pub name: String,
    /// Where it is read.
    pub place: ArrayPlace,
}

/// The place of an array.
#[derive(Clone, Debug, PartialEq)]
pub enum ArrayPlace {
    /// In the input, under this name, as [`OpenOptions::variable`].
    Input(String),
    /// In a file of its own, also as `file.h5::/path`.
    File(PathBuf),
}

/// The caller's settings for an input. All are optional, except `shape` and `voxel_type` for raw files.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct OpenOptions {
    /// Number of voxels along x, y, z of a raw file. If given, any file is read as raw.
    pub shape: Option<Extent>,
    /// Type of a raw file's numbers: a voxel type, or one that is held in a voxel type.
    pub voxel_type: Option<Element>,
    /// Byte order of a raw file.
    pub endian: Endian,
    /// Bytes before the first voxel of a raw file, 0 by default. If given, bytes after its last voxel are ignored, with a note.
    pub offset: Option<u64>,
    /// Bytes from a time step to the next in a raw file whose steps lie apart.
    pub step_bytes: Option<u64>,
    /// Bytes from a channel to the next in a raw file whose channels lie apart.
    pub channel_bytes: Option<u64>,
    /// Number of channels in a raw file (1 by default), or in a TIFF file with given `axes`.
    pub channels: Option<u32>,
    /// Number of time steps in a raw file (1 by default), or in a TIFF file with given `axes`.
    pub times: Option<u32>,
    /// Order of the axes, slowest first, in place of the file's or format's: of raw files, .npy, .npz and TIFF.
    pub axes: Option<AxisOrder>,
    /// Name of the array to read, of a file with several; of DICOM, the series (number, UID or description), stack or segment.
    pub variable: Option<String>,
    /// Arrays to read as the channels of one volume, in place of one `variable`.
    pub channel_arrays: Vec<ChannelArray>,
    /// The only channel to read, by name or number, or one made of all: `magnitude`, or `phase` of complex numbers.
    pub component: Option<String>,
    /// Whether the input is one of several time steps. `order` is then the order of these, and also of the files in a folder if natural; a file
    /// standing for its whole set is an error.
    pub is_step: bool,
    /// Order of several files. `None` keeps a list's order if neither alphabetical nor natural. Other lists, and folders, are sorted by the
    /// numbers in the files' names, which must count the files without gaps. Must be `None` for DICOM files.
    pub order: Option<FileOrder>,
    /// Distance between voxel centres along x, y, z, in place of the file's; each above 0. DICOM slices are then taken as evenly spaced, with a
    /// note if their positions are not, unless `gaps` keeps missing ones' places.
    pub spacing: Option<DVec3>,
    /// Treatment of missing slices in a DICOM series.
    pub gaps: Gaps,
    /// Encoding of the steps before. DICOM steps, whose type and blanks depend on the data, adopt it if possible.
    pub held_as: Option<HeldAs>,
    /// Position of the first voxel's centre, in place of the file's.
    pub origin: Option<DVec3>,
    /// Unit of all axes, or of x, y and z with commas between, in place of the file's: of length by symbol or UDUNITS name (`micrometer`), which
    /// are converted to the first one's, or others, which are kept (`degree,degree,hPa`).
    pub unit: Option<String>,
    /// Unit of the values of all channels (`HU`), in place of the file's; see [`free_unit`].
    pub value_unit: Option<String>,
    /// Time from one step to the next, in place of the file's, for evenly spaced steps; above 0.
    pub time_step: Option<f64>,
    /// Unit of time, in place of the file's: a name of OME-Zarr's (`second`) or its symbol (`s`).
    pub time_unit: Option<String>,
    /// File with the time of each step, for unevenly spaced ones: one number a line, ascending.
    pub time_stamps: Option<PathBuf>,
    /// Which voxels hold no data. The voxels' type must hold the value.
    pub nodata: NoData,
    /// Box to take, in voxels of the input; `None` takes all. It keeps its place in the world.
    pub roi: Option<VoxelBox>,
    /// Whether voxels are put in reverse order along x, y, z. A volume with an orientation keeps every voxel's place in the patient; others are
    /// mirrored in their place. `None` leaves them as they are, like no axis; to a store packed with a flip, no step is appended so.
    pub flip: Option<[bool; 3]>,
    /// Channels to take, in this order; all if empty.
    pub take_channel: Vec<ChannelChoice>,
    /// Time steps to take, with their times; `None` takes all.
    pub take_time: Option<StepChoice>,
    /// Voxel type to convert to. Values stay the same numbers; others are lost only with `allow_lossy`.
    pub to_voxel_type: Option<VoxelType>,
    /// Whether values outside the voxel type may be rounded, clamped or become infinite: 64-bit numbers, scaled numbers beyond f32, and
    /// those of a conversion.
    /// Otherwise, and always in labels, the first such value is an error.
    pub allow_lossy: bool,
    /// Whether the voxels are labels: a value outside the voxel type is then an error, as it would become another label. `None` leaves it to
    /// the files' own word, which must be one if they are joined.
    pub are_labels: Option<bool>,
    /// Whether the same files were opened before with these options: the search for values outside the voxel type, and its note, are skipped.
    pub is_looked_at: bool,
    /// Folder for inflated copies of compressed inputs; `None` is the system's temporary directory.
    pub scratch_dir: Option<PathBuf>,
}

impl OpenOptions {
    /// The encoding of the steps before, for voxels that are not converted to it later.
    pub(crate) fn adopted(&self) -> Option<HeldAs> {
        self.held_as.filter(|_| self.to_voxel_type.is_none())
    }

    /// Whether a remark is stale, as the caller gives the setting that it is on.
    pub(crate) fn settle(&self, note: &Note) -> bool {
        note.setting().is_some_and(|setting| match setting {
            Setting::NoData => self.nodata != NoData::OfFile,
            Setting::Spacing => self.spacing.is_some(),
            Setting::Origin => self.origin.is_some(),
            Setting::Place => self.spacing.is_some() && self.origin.is_some(),
            Setting::Flip(axis) => self.flip.is_some_and(|flip| flip.get(axis) == Some(&true)),
            Setting::Unit => self.unit.is_some(),
            Setting::ValueUnit => self.value_unit.is_some(),
            Setting::Times => self.time_step.is_some() || self.time_stamps.is_some(),
            Setting::TimeUnit => self.time_unit.is_some(),
        })
    }

    /// Whether the voxels of a file are labels: by the caller's word, or else by the file's.
    pub(crate) fn take_labels(&self, said: SaidKind) -> bool {
        self.are_labels.unwrap_or(said.are_labels())
    }

    /// The options that read a file with this word.
    pub(crate) fn heeding(&self, said: SaidKind) -> Self {
        Self { are_labels: Some(self.take_labels(said)), ..self.clone() }
    }

    /// Replaces the file's spacing and origin with the user's.
    pub(crate) fn override_place(&self, info: &mut SourceInfo, path: &Path) -> Result<()> {
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
        Ok(())
    }

    /// Replaces the file's units with the user's: once, as lengths are converted.
    pub(crate) fn override_units(&self, info: &mut SourceInfo, path: &Path) -> Result<()> {
        if let Some(unit) = &self.unit {
            let units: Vec<&str> = unit.split(',').collect();
            let units = match units[..] {
                [one] => [one; 3],
                [x, y, z] => [x, y, z],
                _ => {
                    let problem = format!("`unit` {unit}: expected one, or those of x, y and z with commas between");
                    return Err(ImportError::options(path, problem));
                }
            };
            for unit in units {
                free_unit(unit).map_err(|problem| ImportError::options(path, format!("`unit` {unit:?}: {problem}")))?;
            }
            info.geometry.take_units(units);
            if info.orientation.is_some() && (info.geometry.unit.is_none() || units != [units[0]; 3]) {
                let problem = format!("`unit` {unit}: the file's orientation in a patient needs one unit of length");
                return Err(ImportError::options(path, problem));
            }
        }
        if let Some(unit) = &self.value_unit {
            let unit = free_unit(unit)
                .map_err(|problem| ImportError::options(path, format!("`value_unit` {unit:?}: {problem}")))?;
            if self.take_labels(info.kind) {
                return Err(ImportError::options(path, "`value_unit`: labels have no unit; leave it out"));
            }
            info.looks_of_all().iter_mut().for_each(|look| look.unit = Some(unit.to_owned()));
        }
        Ok(())
    }
}
