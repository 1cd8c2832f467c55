//! What every reader of a foreign format offers: a description, and the voxels of any box.

use crate::axes::Sizes;
use crate::error::ImportError;
use crate::mapped::MappedFile;
use brickyard_volume::{Extent, Geometry, Orientation, VoxelBox, VoxelType};

/// What a source says of itself before any voxel is read.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceInfo {
    /// Voxels of one volume.
    pub extent: Extent,
    /// Number of channels, at least 1.
    pub channels: u32,
    /// Number of time steps, at least 1.
    pub times: u32,
    /// Type of a voxel as delivered by [`Source::read_box`].
    pub voxel_type: VoxelType,
    /// Spacing, origin and unit, as far as the format has them.
    pub geometry: Geometry,
    /// Whether the format gave a spacing; without one the volume is uncalibrated.
    pub calibrated: bool,
    /// How the volume lies in a patient, where the format says it.
    pub orientation: Option<Orientation>,
    /// What identifies the input for `--resume`: names, sizes and modification times of files, or a generator's settings.
    pub identity: String,
    /// Things the user should know (trailing bytes, a narrowed type), one sentence each.
    pub notes: Vec<String>,
}

impl SourceInfo {
    /// Sizes and type, and nothing known of the place in the world.
    pub(crate) fn plain(sizes: Sizes, voxel_type: VoxelType) -> Self {
        Self {
            extent: sizes.extent,
            channels: sizes.channels,
            times: sizes.times,
            voxel_type,
            geometry: Geometry::default(),
            calibrated: false,
            orientation: None,
            identity: String::new(),
            notes: Vec::new(),
        }
    }

    /// Panics as [`Source::read_box`] promises.
    pub(crate) fn check_box(&self, time: u32, channel: u32, region: VoxelBox, out: &[u8]) {
        assert!(time < self.times && channel < self.channels, "no t{time} c{channel} in the source");
        let inside = self.extent.full_box().intersect(region) == region && !region.is_empty();
        assert!(inside, "box {region:?} leaves the extent {}", self.extent);
        let bytes = region.extent().volume() * self.voxel_type.bytes() as u64;
        assert_eq!(out.len() as u64, bytes, "the buffer is not the box's size");
    }
}

/// How boxes are best asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// Any box costs its own bytes.
    Box,
    /// Whole z planes are decoded whatever part of them is asked for: ask for each plane once.
    Planes,
}

/// Voxels in memory, little-endian, those of a row side by side. Nothing is aligned.
#[derive(Clone, Copy)]
pub struct Lent<'a> {
    /// From the first voxel of a box on.
    pub bytes: &'a [u8],
    /// From one row to the next along y.
    pub row_bytes: usize,
    /// From one slice to the next along z.
    pub slice_bytes: usize,
    /// The file they lie in, if it is one that others can change.
    file: Option<&'a MappedFile>,
}

impl<'a> Lent<'a> {
    /// Voxels in memory that is nobody else's.
    pub fn new(bytes: &'a [u8], row_bytes: usize, slice_bytes: usize) -> Self {
        Self { bytes, row_bytes, slice_bytes, file: None }
    }

    /// Voxels in a file.
    pub(crate) fn of_file(file: &'a MappedFile, start: usize, row_bytes: usize, slice_bytes: usize) -> Self {
        Self { bytes: &file[start..], row_bytes, slice_bytes, file: Some(file) }
    }

    /// Whether the voxels that were read so far can be believed. To be asked after they were copied: a file may be cut short or
    /// written to while it is read.
    ///
    /// # Errors
    /// Names the file and what has become of it.
    pub fn confirm(&self) -> Result<(), ImportError> {
        self.file.map_or(Ok(()), MappedFile::confirm)
    }
}

/// A readable volume, series or multi-channel set. Calls may come from many threads.
pub trait Source: Send + Sync {
    /// The description.
    fn info(&self) -> &SourceInfo;

    /// How boxes are best asked for.
    fn access(&self) -> Access {
        Access::Box
    }

    /// Memory that a thread takes, at most, while it reads a box, besides the buffer that it fills: what must be decoded at once.
    fn reader_bytes(&self) -> u64 {
        0
    }

    /// Fills `out` with the box's voxels, little-endian, x fastest.
    ///
    /// # Errors
    /// Names the file and the place where reading or decoding failed.
    ///
    /// # Panics
    /// If the box leaves the extent, or `out` is not exactly the box's bytes.
    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError>;

    /// The voxels of a box where they lie, if they lie in memory as [`Source::read_box`] would deliver them. Whoever has copied them
    /// asks [`Lent::confirm`] then.
    fn lend(&self, _time: u32, _channel: u32, _region: VoxelBox) -> Option<Lent<'_>> {
        None
    }

    /// Tells that a box will be read soon: a hint, which costs nothing where it does not help.
    fn announce(&self, _time: u32, _channel: u32, _region: VoxelBox) {}

    /// The value that every voxel of the box is known to have without reading it, if the source can tell cheaply.
    fn constant_in(&self, _time: u32, _channel: u32, _region: VoxelBox) -> Option<f64> {
        None
    }
}
