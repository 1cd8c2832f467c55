//! What every reader of a foreign format offers: a description, and the voxels of any box.

use crate::axes::Sizes;
use crate::error::ImportError;
use crate::note::Note;
use crate::step_time::StepTime;
use brickyard_volume::{ChannelLook, Extent, Geometry, Orientation, TimeAxis, VoxelBox, VoxelType};

/// What a source says of itself before any voxel is read.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceInfo {
    /// Number of voxels along x, y, z of one volume.
    pub extent: Extent,
    /// Number of channels, at least 1.
    pub channels: u32,
    /// Number of time steps, at least 1.
    pub times: u32,
    /// When the time steps were taken; `None` where nothing is known of that.
    pub time: Option<TimeAxis>,
    /// Voxel type that [`Source::read_box`] delivers.
    pub voxel_type: VoxelType,
    /// Spacing, origin and unit, as far as the format has them.
    pub geometry: Geometry,
    /// Whether the spacing is known, from the format or from the caller. If not, the volume is uncalibrated.
    pub calibrated: bool,
    /// Whether the caller says where the volume lies: the default origin is meant then, too.
    pub says_origin: bool,
    /// How the volume lies in a patient, where the format says it.
    pub orientation: Option<Orientation>,
    /// How each channel looks, where the format says it; empty, or one for each channel.
    pub channel_looks: Vec<ChannelLook>,
    /// The value of voxels that hold no data, as [`Source::read_box`] delivers them; `None` if no value says so. Their type holds
    /// it.
    pub nodata: Option<f64>,
    /// Whether the source knows which of its voxels hold no data: those of floats are NaN, and another number that is [`nodata`](Self::nodata), or
    /// was that of another source, is a value.
    pub knows_nodata: bool,
    /// What identifies the input for `--resume`: names, sizes and modification times of files, or a generator's settings.
    pub identity: String,
    /// What the user should know, one sentence each.
    pub notes: Vec<Note>,
}

impl SourceInfo {
    /// A description with sizes and voxel type, a default geometry, and no identity or notes.
    pub(crate) fn plain(sizes: Sizes, voxel_type: VoxelType) -> Self {
        Self {
            extent: sizes.extent,
            channels: sizes.channels,
            times: sizes.times,
            time: None,
            voxel_type,
            geometry: Geometry::default(),
            calibrated: false,
            says_origin: false,
            orientation: None,
            channel_looks: Vec::new(),
            nodata: None,
            knows_nodata: false,
            identity: String::new(),
            notes: Vec::new(),
        }
    }

    /// Takes the value that a file has, under this name, for voxels that hold no data. One that no voxel can be is left out, with a
    /// note; NaN and infinities hold no data anyway.
    pub(crate) fn set_nodata(&mut self, value: f64, name: &str) {
        // As the voxels are, which may have been narrowed.
        let narrowed = if self.voxel_type.is_float() { f64::from(value as f32) } else { value };
        // Whoever says that such a value means no data says that no other one does.
        self.knows_nodata = !self.voxel_type.holds(narrowed);
        if self.voxel_type.holds(narrowed) {
            let value = narrowed;
            self.nodata = Some(value);
            let what = if self.voxel_type.is_float() { "they become NaN" } else { "they are left out" };
            let note = format!("Voxels of {value} hold no data, as the file says ({name}): {what}.");
            self.notes.push(Note::new(note));
        } else if value.is_finite() {
            let voxel_type = self.voxel_type;
            let what = match voxel_type.is_float() {
                true => "f32 has none, and what is infinite has no data anyway".into(),
                false => format!("no {voxel_type} voxel can be that"),
            };
            let value = if value.abs() < 1e15 { value.to_string() } else { format!("{value:e}") };
            let warning = format!("Voxels of {value} hold no data, as the file says ({name}): {what}.");
            self.notes.push(Note::warning(warning));
        }
    }

    /// The value that has to be looked for among the voxels: floats of a source that knows its own are NaN already.
    pub fn sought_nodata(&self) -> Option<f64> {
        self.nodata.filter(|_| !(self.knows_nodata && self.voxel_type.is_float()))
    }

    /// Checks the arguments of [`Source::read_box`], and panics as that method documents.
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
    /// Reading a box costs the box's own bytes, whatever its shape.
    Box,
    /// Reading any part of a z plane decodes the whole plane, so each plane is best asked for once.
    Planes,
}

/// The voxels of a box that a source lends from memory: little-endian, without gaps along x, not aligned.
#[derive(Clone, Copy)]
pub struct Lent<'a> {
    /// The bytes from the first voxel of the box on; what follows its last voxel is not part of it.
    pub bytes: &'a [u8],
    /// Bytes from one row to the next along y.
    pub row_bytes: usize,
    /// Bytes from one slice to the next along z.
    pub slice_bytes: usize,
}

/// A volume, time series or multi-channel set that can be read box by box. Calls may come from many threads at once.
pub trait Source: Send + Sync {
    /// The description of the source: sizes, voxel type and geometry.
    fn info(&self) -> &SourceInfo;

    /// How the source's boxes are best asked for: [`Access::Box`] unless a source says otherwise.
    fn access(&self) -> Access {
        Access::Box
    }

    /// Most memory in bytes that one thread takes while it reads a box, besides the buffer that it fills.
    fn reader_bytes(&self) -> u64 {
        0
    }

    /// Memory in bytes that the source takes as long as it is open, where that grows with the number of its files.
    fn held_bytes(&self) -> u64 {
        0
    }

    /// Most bytes of scratch files that the source keeps at a time.
    fn scratch_bytes(&self) -> u64 {
        0
    }

    /// Times that a source of one time step has in it; none unless its format keeps them.
    fn step_time(&self) -> StepTime {
        StepTime::default()
    }

    /// Fills `out` with the box's voxels, little-endian, x fastest.
    ///
    /// # Errors
    /// If reading or decoding fails. The error names the file and the place.
    ///
    /// # Panics
    /// If there is no such time step or channel, the box is empty or leaves the extent, or `out` is not exactly the
    /// box's bytes.
    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError>;

    /// Lends the voxels of a box to `take`, without a copy, and returns true. Returns false, and does not call `take`, unless they lie in
    /// memory as [`Source::read_box`] would deliver them.
    ///
    /// # Errors
    /// As for [`Source::read_box`]. `take` may have been called: a file may be cut short or written to while it is read, and what was taken
    /// is then not to be believed.
    fn lend(
        &self,
        _time: u32,
        _channel: u32,
        _region: VoxelBox,
        _take: &mut dyn FnMut(Lent<'_>),
    ) -> Result<bool, ImportError> {
        Ok(false)
    }

    /// Hints that a box will be read soon, so that the source may fetch it ahead.
    fn announce(&self, _time: u32, _channel: u32, _region: VoxelBox) {}

    /// Returns the value of all voxels of a box if the source knows, without reading the box, that they are equal.
    /// `None` says nothing.
    fn constant_in(&self, _time: u32, _channel: u32, _region: VoxelBox) -> Option<f64> {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::Extent;

    /// Voxels of 64 bits are narrowed, and so is the value of those that hold no data.
    #[test]
    fn no_data_is_narrowed_as_voxels_are() {
        let nodata_of = |voxel_type, value| {
            let sizes = Sizes { extent: Extent::new(2, 2, 2), channels: 1, times: 1 };
            let mut info = SourceInfo::plain(sizes, voxel_type);
            info.set_nodata(value, "missing_value");
            info.nodata
        };
        assert_eq!(nodata_of(VoxelType::F32, -9999.1), Some(f64::from(-9999.1f32)));
        assert_eq!(nodata_of(VoxelType::I16, -9999.0), Some(-9999.0));
        assert_eq!(nodata_of(VoxelType::I16, -9999.1), None);
        // The least f32 in fewer digits, and what is none.
        assert_eq!(nodata_of(VoxelType::F32, -3.4028235e38), Some(f64::from(f32::MIN)));
        assert_eq!(nodata_of(VoxelType::F32, -3.5e38), None);
    }
}
