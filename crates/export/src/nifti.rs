//! NIfTI in one file: the matrix as sform, and as qform where the axes are at right angles; NIfTI-2 where an axis is too long for NIfTI-1, or 32-bit
//! numbers too coarse for the place. Axes are x, y, z, time, channels; the format's units are metre, millimetre and micrometre, so that other lengths
//! become millimetres. A volume without an orientation is placed with x to the right, y to the front and z to the head; one without a known spacing
//! is not placed.

use crate::facts::Fact;
use crate::frame::{Frame, length_unit};
use crate::plan::{Body, Layout, Plan};
use crate::volume::Volume;
use brickyard_volume::units::LengthUnit;
use brickyard_volume::{Orientation, TimeAxis, VoxelType, time_unit_s};

/// `NIFTI_INTENT_LABEL`.
const INTENT_LABEL: i32 = 1002;
/// Codes of a place in the scanner, and of one by other means.
const SCANNER: i32 = 1;
const ALIGNED: i32 = 2;
/// Code of an unknown unit of length.
const NO_UNIT: u8 = 0;
/// Bytes of the text of description, with a zero at its end.
const LONGEST_NAME: usize = 80;
/// The longest axis of NIfTI-1.
const LONGEST: u32 = i16::MAX as u32;

pub(crate) fn plan(volume: &Volume, is_compressed: bool) -> Plan {
    let info = volume.info;
    let (unit, to_unit) = unit_of(volume);
    let frame = Frame::of(info);
    let time = times_of(volume);
    let header = Header { volume, frame: frame.scaled(to_unit), unit, time: time.as_ref() };
    let sizes = [info.extent.x, info.extent.y, info.extent.z, info.times, info.channels];
    let is_two = sizes.iter().any(|size| *size > LONGEST) || !header.fits_f32();
    let bytes = if is_two { header.two() } else { header.one() };
    let body = match is_compressed {
        true => Body::Gzip(bytes),
        false => Body::Flat(by_channels(bytes, volume)),
    };
    let mut kept = vec![Fact::Spacing, Fact::Orientation];
    if header.intent() == INTENT_LABEL {
        kept.push(Fact::Labels);
    }
    if volume.name.is_some_and(|name| name.len() < LONGEST_NAME) {
        kept.push(Fact::Name);
    }
    if info.calibrated {
        kept.push(Fact::Origin);
    }
    if unit != NO_UNIT {
        kept.push(Fact::LengthUnit);
    }
    if time.is_some() {
        kept.extend([Fact::Times, Fact::TimeUnit]);
    }
    let mut notes: Vec<String> = frame.contradiction(info).into_iter().collect();
    if info.calibrated && info.orientation.is_none() {
        notes.push("NIfTI places every volume in a patient: x, y, z are written as right, front, head.".into());
    }
    if is_two {
        notes.push("The file is NIfTI-2: its place, or an axis, is beyond NIfTI-1.".into());
    }
    Plan::new(volume, "NIfTI", &kept, body).noted(notes)
}

/// Planes in NIfTI's order: steps, then channels.
fn by_channels(head: Vec<u8>, volume: &Volume) -> Layout {
    let (bytes, times) = (volume.bytes(), u64::from(volume.info.times));
    Layout { step_bytes: bytes, channel_bytes: bytes.saturating_mul(times), ..Layout::after(head, volume) }
}

/// The code of the file's unit of length, and the conversion to it. An unknown spacing, which is written as 1, is no millimetre.
fn unit_of(volume: &Volume) -> (u8, Box<dyn Fn(f64) -> f64>) {
    let same: Box<dyn Fn(f64) -> f64> = Box::new(|length| length);
    let Some(own) = length_unit(volume.info).filter(|_| volume.is_placed()) else { return (NO_UNIT, same) };
    match own.name {
        "meter" => (1, same),
        "millimeter" => (2, same),
        "micrometer" => (3, same),
        _ => {
            let millimetre = LengthUnit::named("millimeter").unwrap_or(own);
            (2, Box::new(move |length| own.convert(length, millimetre)))
        }
    }
}

/// Times as the format has them: evenly spaced, in seconds, milliseconds or microseconds; `None` for others, and for a single step.
fn times_of(volume: &Volume) -> Option<TimeAxis> {
    let axis = volume.info.time.clone().filter(|axis| volume.info.times > 1 && axis.stamps.is_empty())?;
    match axis.unit.as_deref() {
        None | Some("second" | "millisecond" | "microsecond") => Some(axis),
        Some(other) => {
            let seconds = time_unit_s(other)?;
            let unit = Some("second".into());
            Some(TimeAxis { start: axis.start * seconds, step: axis.step * seconds, unit, ..TimeAxis::default() })
        }
    }
}

/// The fields of a header.
struct Header<'a> {
    volume: &'a Volume<'a>,
    frame: Frame,
    /// The code of the unit of length.
    unit: u8,
    time: Option<&'a TimeAxis>,
}

/// Bytes of a header at their places.
struct Bytes(Vec<u8>);

impl Bytes {
    fn put<const N: usize>(&mut self, at: usize, bytes: [u8; N]) {
        self.0[at..at + N].copy_from_slice(&bytes);
    }

    /// Numbers one after another.
    fn all<const N: usize>(&mut self, at: usize, numbers: impl IntoIterator<Item = [u8; N]>) {
        numbers.into_iter().enumerate().for_each(|(i, bytes)| self.put(at + i * N, bytes));
    }

    /// A text, cut to leave a zero at its end.
    fn text(&mut self, at: usize, text: &str, length: usize) {
        let end = text.floor_char_boundary(length - 1);
        self.0[at..at + end].copy_from_slice(&text.as_bytes()[..end]);
    }
}

impl Header<'_> {
    /// Whether 32-bit numbers hold the place of every voxel to a hundredth of its size.
    fn fits_f32(&self) -> bool {
        let rounded = self.frame.rows().map(|row| row.map(|number| f64::from(number as f32)));
        let maps = [self.frame.rows(), rounded].map(Orientation::new);
        match maps {
            [Ok(exact), Ok(rounded)] => exact.agrees(&rounded, self.volume.info.extent),
            _ => false,
        }
    }

    /// Numbers of the axes, then their sizes.
    fn dim(&self) -> [u32; 8] {
        let info = self.volume.info;
        let count = if info.channels > 1 { 5 } else { 3 + u32::from(info.times > 1) };
        [count, info.extent.x, info.extent.y, info.extent.z, info.times, info.channels, 1, 1]
    }

    fn datatype(&self) -> i16 {
        match self.volume.info.voxel_type {
            VoxelType::U8 => 2,
            VoxelType::I16 => 4,
            VoxelType::I32 => 8,
            VoxelType::F32 => 16,
            VoxelType::I8 => 256,
            VoxelType::U16 => 512,
            VoxelType::U32 => 768,
        }
    }

    fn bitpix(&self) -> i16 {
        self.volume.info.voxel_type.bytes() as i16 * 8
    }

    fn intent(&self) -> i32 {
        if self.volume.is_labels && !self.volume.info.voxel_type.is_float() { INTENT_LABEL } else { 0 }
    }

    /// The handedness of the qform, the spacing, the time step, and ones.
    fn pixdim(&self) -> [f64; 8] {
        let is_mirrored = self.frame.rotation().is_some_and(|(_, is_mirrored)| is_mirrored);
        let spacing = self.frame.spacing;
        let step = self.time.map_or(1.0, |time| time.step);
        [if is_mirrored { -1.0 } else { 1.0 }, spacing.x, spacing.y, spacing.z, step, 1.0, 1.0, 1.0]
    }

    fn units(&self) -> u8 {
        let of_time = match self.time.and_then(|time| time.unit.as_deref()) {
            Some("second") => 8,
            Some("millisecond") => 16,
            Some("microsecond") => 24,
            _ => 0,
        };
        self.unit + of_time
    }

    /// Codes of qform and sform, and the components b, c, d of the rotation.
    fn forms(&self) -> ([i32; 2], [f64; 3]) {
        let info = self.volume.info;
        let code = match (info.orientation, info.calibrated) {
            (Some(_), _) => SCANNER,
            (None, true) => ALIGNED,
            (None, false) => return ([0; 2], [0.0; 3]),
        };
        match self.frame.rotation() {
            // The first component is taken as positive.
            Some((turn, _)) => {
                let sign = if turn.w < 0.0 { -1.0 } else { 1.0 };
                ([code; 2], [turn.x, turn.y, turn.z].map(|part| part * sign))
            }
            None => ([0, code], [0.0; 3]),
        }
    }

    fn window(&self) -> [f64; 2] {
        let looks = &self.volume.info.channel_looks;
        let window = if looks.len() == 1 { looks[0].window } else { None };
        window.map_or([0.0; 2], |[low, high]| [high, low])
    }

    fn one(&self) -> Vec<u8> {
        let mut bytes = Bytes(vec![0; 352]);
        let number = |number: f64| (number as f32).to_le_bytes();
        let ([qform, sform], rotation) = self.forms();
        bytes.put(0, 348i32.to_le_bytes());
        bytes.put(38, *b"r");
        bytes.all(40, self.dim().map(|size| (size as i16).to_le_bytes()));
        bytes.put(68, (self.intent() as i16).to_le_bytes());
        bytes.put(70, self.datatype().to_le_bytes());
        bytes.put(72, self.bitpix().to_le_bytes());
        bytes.all(76, self.pixdim().map(number));
        // Where the voxels begin, and a scale of one.
        bytes.all(108, [352.0, 1.0, 0.0].map(number));
        bytes.put(123, [self.units()]);
        bytes.all(124, self.window().map(number));
        bytes.put(136, number(self.time.map_or(0.0, |time| time.start)));
        bytes.text(148, self.volume.name.unwrap_or(""), LONGEST_NAME);
        bytes.all(252, [qform, sform].map(|code| (code as i16).to_le_bytes()));
        bytes.all(256, rotation.map(number));
        bytes.all(268, self.frame.first.to_array().map(number));
        bytes.all(280, self.frame.rows().into_iter().flatten().map(number));
        bytes.put(344, *b"n+1\0");
        bytes.0
    }

    fn two(&self) -> Vec<u8> {
        let mut bytes = Bytes(vec![0; 544]);
        let ([qform, sform], rotation) = self.forms();
        bytes.put(0, 540i32.to_le_bytes());
        bytes.put(4, *b"n+2\0\r\n\x1a\n");
        bytes.put(12, self.datatype().to_le_bytes());
        bytes.put(14, self.bitpix().to_le_bytes());
        bytes.all(16, self.dim().map(|size| i64::from(size).to_le_bytes()));
        bytes.all(104, self.pixdim().map(f64::to_le_bytes));
        bytes.put(168, 544i64.to_le_bytes());
        bytes.all(176, [1.0, 0.0].map(f64::to_le_bytes));
        bytes.all(192, self.window().map(f64::to_le_bytes));
        bytes.put(216, self.time.map_or(0.0, |time| time.start).to_le_bytes());
        bytes.text(240, self.volume.name.unwrap_or(""), LONGEST_NAME);
        bytes.all(344, [qform, sform].map(i32::to_le_bytes));
        bytes.all(352, rotation.map(f64::to_le_bytes));
        bytes.all(376, self.frame.first.to_array().map(f64::to_le_bytes));
        bytes.all(400, self.frame.rows().into_iter().flatten().map(f64::to_le_bytes));
        bytes.put(500, i32::from(self.units()).to_le_bytes());
        bytes.put(504, self.intent().to_le_bytes());
        bytes.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{info, volume};
    use brickyard_volume::Extent;
    use glam::DVec3;

    fn head(info: &brickyard_import::SourceInfo) -> Vec<u8> {
        match plan(&volume(info), true).body {
            Body::Gzip(head) => head,
            _ => panic!("it is compressed"),
        }
    }

    #[test]
    fn long_axes_and_far_places_need_the_second_version() {
        let mut info = info();
        info.calibrated = true;
        assert_eq!(head(&info)[..2], [92, 1]);
        info.extent = Extent::new(1 << 15, 2, 2);
        let long = head(&info);
        assert_eq!((&long[..8], long.len()), (&b"\x1c\x02\0\0n+2\0"[..], 544));
        assert_eq!(i64::from_le_bytes(long[24..32].try_into().unwrap()), 1 << 15);
        info.extent = Extent::new(2, 2, 2);
        info.geometry.origin = DVec3::new(1e6, 0.0, 0.0);
        assert_eq!(head(&info).len(), 352);
        info.geometry.spacing = DVec3::splat(0.3);
        info.geometry.origin.x = 1e6 + 0.03;
        assert_eq!(head(&info).len(), 544);
    }

    /// Sheared axes have no rotation, but a matrix; names end before the field does.
    #[test]
    fn sheared_axes_have_an_sform_alone() {
        let mut info = info();
        let rows = [[1.0, 0.5, 0.0, 3.0], [0.0, 1.0, 0.0, 4.0], [0.0, 0.0, 1.0, 5.0]];
        info.orientation = Some(Orientation::new(rows).unwrap());
        info.calibrated = true;
        let name = "\u{e4}".repeat(60);
        let head = match plan(&Volume { name: Some(&name), ..volume(&info) }, true).body {
            Body::Gzip(head) => head,
            _ => panic!("it is compressed"),
        };
        assert_eq!(head[252..256], [0, 0, 1, 0]);
        assert_eq!(&head[148..228], [&name.as_bytes()[..78], &[0, 0]].concat());
    }
}
