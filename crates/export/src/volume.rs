//! A volume on its way into a file: its description, and how arrays of free shape show it. Costs nothing.

use crate::error::ExportError;
use crate::ngff::Ngff;
use crate::segments::Segment;
use brickyard_import::SourceInfo;
use std::path::Path;

/// A volume to be written.
#[derive(Clone, Copy)]
pub(crate) struct Volume<'a> {
    pub(crate) info: &'a SourceInfo,
    pub(crate) name: Option<&'a str>,
    pub(crate) is_labels: bool,
    /// The labels, where the format names them.
    pub(crate) segments: &'a [Segment],
    /// Whether arrays of free shape have an axis of channels, or of time, even of one.
    pub(crate) has_channel_axis: bool,
    pub(crate) has_time_axis: bool,
    /// The version of OME-Zarr.
    pub(crate) ngff: Ngff,
    /// The output, for messages and for names in it.
    pub(crate) output: &'a Path,
}

impl Volume<'_> {
    /// Whether the spacing is known, or the matrix in a patient.
    pub(crate) fn is_placed(&self) -> bool {
        self.info.calibrated || self.info.orientation.is_some()
    }

    /// Bytes of the voxels of one channel and step.
    pub(crate) fn bytes(&self) -> u64 {
        self.plane_bytes().saturating_mul(self.info.extent.z.into())
    }

    pub(crate) fn plane_bytes(&self) -> u64 {
        let (extent, voxel_bytes) = (self.info.extent, self.info.voxel_type.bytes() as u64);
        (u64::from(extent.x) * u64::from(extent.y)).saturating_mul(voxel_bytes)
    }

    /// Refuses several channels, in a format of one.
    pub(crate) fn check_one_channel(&self, format: &str) -> Result<(), ExportError> {
        self.check_one(self.info.channels, "channel", "`channel`", format)
    }

    /// Refuses several time steps, in a format of one.
    pub(crate) fn check_one_step(&self, format: &str) -> Result<(), ExportError> {
        self.check_one(self.info.times, "time step", "`time`", format)
    }

    fn check_one(&self, count: u32, what: &str, option: &str, format: &str) -> Result<(), ExportError> {
        if count == 1 {
            return Ok(());
        }
        let problem = format!(
            "{format} holds one {what}, not {count}: choose one with {option}, or a name ending in .nrrd, .nii, .tif or .npy"
        );
        Err(ExportError::unfit(self.output, problem))
    }
}
