//! The interface of every reader: a description, and the voxels of any box.

use crate::axes::Sizes;
use crate::error::ImportError;
use crate::labels::SaidKind;
use crate::note::{Note, Setting};
use crate::step_time::StepTime;
use brickyard_volume::numbers::exact;
use brickyard_volume::units::{axis_unit, free_unit};
use brickyard_volume::{ChannelLook, Extent, Geometry, Orientation, PlacementError, TimeAxis, VoxelBox, VoxelType};
use glam::DVec3;
use std::ops::Range;

/// Description of a source, available before any voxel is read.
#[derive(Clone, Debug, PartialEq)]
pub struct SourceInfo {
    /// Number of voxels along x, y, z of one volume.
    pub extent: Extent,
    /// Number of channels, at least 1.
    pub channels: u32,
    /// Number of time steps, at least 1.
    pub times: u32,
    /// Times of the steps; `None` if unknown.
    pub time: Option<TimeAxis>,
    /// Voxel type delivered by [`Source::read_box`].
    pub voxel_type: VoxelType,
    /// Kind of the voxels by the file's own word, whatever the caller says.
    pub kind: SaidKind,
    /// Spacing, origin and units, as far as the format has them.
    pub geometry: Geometry,
    /// Whether the spacing is known, from the format or the caller. If not, the volume is uncalibrated.
    pub calibrated: bool,
    /// Whether the caller gives the volume's position: the default origin is then meant as well.
    pub says_origin: bool,
    /// Axes along which the voxels come in the reverse order of the file's, as its coordinates descend: x, y, z.
    pub turned: [bool; 3],
    /// The caller's flip, by which the voxels were put in reverse order besides; `None` if nothing was said of it.
    pub flip: Option<[bool; 3]>,
    /// Orientation of the volume in a patient, if the format has one.
    pub orientation: Option<Orientation>,
    /// Looks of the channels, from the format; empty, or one per channel.
    pub channel_looks: Vec<ChannelLook>,
    /// Value of voxels without data, as delivered by [`Source::read_box`]; `None` if there is no such value. It fits the voxel type.
    pub nodata: Option<f64>,
    /// Whether the source itself marks voxels without data: floats are NaN there, and a number equal to [`nodata`](Self::nodata), or to another
    /// source's, is a value.
    pub knows_nodata: bool,
    /// Identity of the input for `--resume`: names, sizes and modification times of files, or a generator's settings.
    pub identity: String,
    /// Remarks for the user, one sentence each.
    pub notes: Vec<Note>,
}

impl SourceInfo {
    /// Creates a description from sizes and voxel type, with a default geometry and without identity or notes.
    pub(crate) fn plain(sizes: Sizes, voxel_type: VoxelType) -> Self {
        Self { channels: sizes.channels, times: sizes.times, ..Self::of_volume(sizes.extent, voxel_type) }
    }

    /// Creates a description of one channel and time step, uncalibrated, with a default geometry and without identity or notes.
    pub fn of_volume(extent: Extent, voxel_type: VoxelType) -> Self {
        Self {
            extent,
            channels: 1,
            times: 1,
            time: None,
            voxel_type,
            kind: SaidKind::Unsaid,
            geometry: Geometry::default(),
            calibrated: false,
            says_origin: false,
            turned: [false; 3],
            flip: None,
            orientation: None,
            channel_looks: Vec::new(),
            nodata: None,
            knows_nodata: false,
            identity: String::new(),
            notes: Vec::new(),
        }
    }

    /// Moves the origin and the orientation to the voxel at `first`, from which each axis goes on as before, or backwards where `sign` is -1.
    ///
    /// # Errors
    /// If the resulting orientation is not usable.
    pub(crate) fn reorient(&mut self, sign: DVec3, first: DVec3) -> Result<(), PlacementError> {
        let moved = self.geometry.origin + first * self.geometry.spacing;
        let Some(old) = self.orientation else {
            self.geometry.origin = moved;
            return Ok(());
        };
        let new = old.strided(sign, first)?;
        // Readers of upright volumes, and callers, give the first voxel's place in the patient; other origins are the volume's own.
        let is_in_patient = new.is_upright() || self.geometry.origin == old.first_centre();
        if is_in_patient {
            self.geometry.origin = new.first_centre();
        } else if sign == DVec3::ONE {
            self.geometry.origin = moved;
        }
        self.orientation = Some(new);
        Ok(())
    }

    /// Whether the source says where its voxels are.
    pub(crate) fn has_place(&self) -> bool {
        let Geometry { spacing, origin, .. } = Geometry::default();
        let differs = self.geometry.spacing != spacing || self.geometry.origin != origin;
        self.calibrated || self.says_origin || self.orientation.is_some() || differs
    }

    /// A value as the voxels are, possibly narrowed.
    pub(crate) fn narrowed(&self, value: f64) -> f64 {
        if self.voxel_type.is_float() { f64::from(value as f32) } else { value }
    }

    /// The looks of all channels, added if there were none.
    pub(crate) fn looks_of_all(&mut self) -> &mut [ChannelLook] {
        self.channel_looks.resize(self.channels as usize, ChannelLook::default());
        &mut self.channel_looks
    }

    /// Takes the file's unit of all values, called `name` there. One that cannot be kept is left out, with a warning.
    pub(crate) fn set_value_unit(&mut self, unit: &str, name: &str) {
        match free_unit(unit) {
            Ok(unit) => self.looks_of_all().iter_mut().for_each(|look| look.unit = Some(unit.to_owned())),
            Err(_) if unit.trim().is_empty() => {}
            Err(problem) => {
                let note =
                    format!("The file's unit of values ({name}) is left out: {problem}; `value_unit` gives one.");
                self.notes.push(Note::warning(note).settled_by(Setting::ValueUnit));
            }
        }
    }

    /// Takes the file's units of x, y and z, in which spacing and origin are; empty ones are unknown. Lengths are converted to the first
    /// one's unit. Ones that cannot be kept are left out, with a warning.
    pub(crate) fn take_axis_units(&mut self, units: [&str; 3]) {
        let mut kept = units;
        for (axis, unit) in ["x", "y", "z"].into_iter().zip(&mut kept) {
            if let Err(problem) = axis_unit(unit) {
                let note = format!("The unit of {axis} is left out: {problem}; `unit` gives one.");
                self.notes.push(Note::warning(note).settled_by(Setting::Unit));
                *unit = "";
            }
        }
        self.geometry.take_units(kept);
        if let Some(units) = self.geometry.units_in_words().filter(|_| self.geometry.axis_units.is_some()) {
            let how = if self.geometry.has_unlike_axes() { "no distances across them" } else { "no lengths" };
            let note = format!("Positions along x, y, z are in {units}: {how}.");
            self.notes.push(Note::new(note).settled_by(Setting::Unit));
        }
    }

    /// Sets the file's no-data value, called `name` there. A value outside the voxel type is dropped, with a note; NaN and infinities hold no
    /// data anyway.
    pub(crate) fn set_nodata(&mut self, value: f64, name: &str) {
        let narrowed = self.narrowed(value);
        // Any no-data value, even an impossible one, means all other values are data.
        self.knows_nodata = !self.voxel_type.holds(narrowed);
        let (voxel_type, is_float) = (self.voxel_type, self.voxel_type.is_float());
        let note = |value: &str, what: &str| {
            format!("Voxels of {value} hold no data, according to the file ({name}): {what}.")
        };
        if voxel_type.holds(narrowed) {
            self.nodata = Some(narrowed);
            let what = if is_float { "they become NaN" } else { "they are left out" };
            self.notes.push(Note::new(note(&exact(narrowed, is_float), what)).settled_by(Setting::NoData));
        } else if value.is_finite() {
            let what = match is_float {
                true => "f32 cannot hold it, and infinite values hold no data anyway",
                false => &format!("no {voxel_type} voxel can have this value"),
            };
            self.notes.push(Note::warning(note(&exact(value, false), what)).settled_by(Setting::NoData));
        }
    }

    /// The no-data value to look for among the voxels: none in floats of a source with its own marks, which are NaN already.
    pub fn sought_nodata(&self) -> Option<f64> {
        self.nodata.filter(|_| !(self.knows_nodata && self.voxel_type.is_float()))
    }

    /// Checks the arguments of [`Source::read_box`], and panics as documented there.
    pub(crate) fn check_box(&self, time: u32, channel: u32, region: VoxelBox, out: &[u8]) {
        assert!(time < self.times && channel < self.channels, "no t{time} c{channel} in the source");
        let inside = self.extent.full_box().intersect(region) == region && !region.is_empty();
        assert!(inside, "box {region:?} leaves the extent {}", self.extent);
        let bytes = region.extent().volume() * self.voxel_type.bytes() as u64;
        assert_eq!(out.len() as u64, bytes, "the buffer is not the box's size");
    }
}

/// Preferred shape of the requested boxes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Access {
    /// A box costs its own bytes, whatever its shape.
    Box,
    /// Any part of a z plane decodes the whole plane, so each plane is best requested once.
    Planes,
}

/// Slices of a box lent from memory: little-endian, without gaps along x, not aligned.
#[derive(Clone)]
pub struct Lent<'a> {
    /// The slices, counted from the box's first.
    pub slices: Range<usize>,
    /// Bytes from the first voxel of these slices on; those after the last voxel are not part of them.
    pub bytes: &'a [u8],
    /// Bytes from one row to the next along y.
    pub row_bytes: usize,
    /// Bytes from one slice to the next along z.
    pub slice_bytes: usize,
}

/// Receiver of lent voxels.
pub(crate) type Take<'a> = &'a mut dyn FnMut(Lent<'_>);

/// A volume, time series or multi-channel set, readable box by box. Calls may come from many threads at once.
pub trait Source: Send + Sync {
    /// Description of the source: sizes, voxel type and geometry.
    fn info(&self) -> &SourceInfo;

    /// The source from which an adapter reads; its access, memory, scratch files and stored times are the adapter's by default.
    fn beneath(&self) -> Option<&dyn Source> {
        None
    }

    /// Preferred shape of the requested boxes, [`Access::Box`] by default.
    fn access(&self) -> Access {
        self.beneath().map_or(Access::Box, |source| source.access())
    }

    /// Voxels of the smallest piece decoded alone; `None` if a box costs its own bytes, or nothing is known.
    fn piece(&self) -> Option<Extent> {
        self.beneath().and_then(|source| source.piece())
    }

    /// Most memory in bytes of one thread reading a box, besides the filled buffer.
    fn reader_bytes(&self) -> u64 {
        self.beneath().map_or(0, |source| source.reader_bytes())
    }

    /// Memory in bytes of the open source, where it grows with the number of files.
    fn held_bytes(&self) -> u64 {
        self.beneath().map_or(0, |source| source.held_bytes())
    }

    /// Bounds the decoded chunks kept for the boxes beside them, of an image's levels together: the fewest that reading needs are kept at least. Without
    /// effect where none are kept.
    fn keep_at_most(&self, bytes: u64) {
        if let Some(source) = self.beneath() {
            source.keep_at_most(bytes);
        }
    }

    /// Most bytes of scratch files held at a time.
    fn scratch_bytes(&self) -> u64 {
        self.beneath().map_or(0, |source| source.scratch_bytes())
    }

    /// Times stored in a source of one time step; none unless the format has them.
    fn step_time(&self) -> StepTime {
        self.beneath().map_or_else(StepTime::default, |source| source.step_time())
    }

    /// Fills `out` with the box's voxels, little-endian, x fastest.
    ///
    /// # Errors
    /// If reading or decoding fails. The error names the file and the place.
    ///
    /// # Panics
    /// If there is no such time step or channel, the box is empty or leaves the extent, or `out` is not exactly the box's size.
    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError>;

    /// Reads and decodes the [pieces](Source::piece) of a box at an address, to be kept for reads that follow soon: none of them twice. Without effect
    /// where no pieces are kept.
    ///
    /// # Errors
    /// As for [`Source::read_box`].
    ///
    /// # Panics
    /// If there is no such time step or channel, or the box leaves the extent.
    fn fetch_box(&self, _time: u32, _channel: u32, _region: VoxelBox) -> Result<(), ImportError> {
        Ok(())
    }

    /// Lends the voxels of a box to `take`, all at once or some slices at a time, ascending, and returns true. Returns false, without calling
    /// `take`, unless that is cheaper than [`Source::read_box`] and a copy.
    ///
    /// # Errors
    /// As for [`Source::read_box`]. `take` may have seen a file cut short or written to during the read: discard its result.
    fn lend(&self, _time: u32, _channel: u32, _region: VoxelBox, _take: Take<'_>) -> Result<bool, ImportError> {
        Ok(false)
    }

    /// Hints at an upcoming read of a box, so the source may fetch it ahead.
    fn announce(&self, _time: u32, _channel: u32, _region: VoxelBox) {}

    /// Returns the common value of all voxels of a box, if known to be equal without reading it. `None` means unknown.
    fn constant_in(&self, _time: u32, _channel: u32, _region: VoxelBox) -> Option<f64> {
        None
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::Extent;

    /// 64-bit voxels are narrowed, and so is the no-data value.
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
        // The least f32 in fewer digits, and a number below it.
        assert_eq!(nodata_of(VoxelType::F32, -3.4028235e38), Some(f64::from(f32::MIN)));
        assert_eq!(nodata_of(VoxelType::F32, -3.5e38), None);
    }

    #[test]
    fn the_note_on_no_data_is_short() {
        let note_of = |voxel_type, value| {
            let sizes = Sizes { extent: Extent::new(2, 2, 2), channels: 1, times: 1 };
            let mut info = SourceInfo::plain(sizes, voxel_type);
            info.set_nodata(value, "_FillValue");
            info.notes[0].to_string()
        };
        assert!(note_of(VoxelType::F32, f64::from(9.96921e36f32)).starts_with("Voxels of 9.96921e36 hold"));
        assert!(note_of(VoxelType::F32, -9999.9).starts_with("Voxels of -9999.9 hold"));
        assert!(note_of(VoxelType::I32, -2147483647.0).starts_with("Voxels of -2147483647 hold"));
        assert!(note_of(VoxelType::U8, 9.969209968386869e36).starts_with("Voxels of 9.969209968386869e36 hold"));
    }
}
