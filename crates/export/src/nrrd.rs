//! NRRD with its voxels behind the header: the place as directions in a patient's left, back and head, or in a space without a name; axes with units
//! of their own by spacings and places instead. Axes are x, y, z, channels, time; the last two are left out where there is one.

use crate::error::ExportError;
use crate::facts::{Fact, moment, value_unit};
use crate::frame::{Frame, words};
use crate::plan::{Body, Layout, Plan};
use crate::segments::{self, Segment};
use crate::volume::Volume;
use brickyard_volume::units::unit_symbol;
use brickyard_volume::{VoxelType, time_symbol};
use glam::DVec3;
use std::fmt::Write;

pub(crate) fn plan(volume: &Volume) -> Plan {
    let info = volume.info;
    let is_segmentation = volume.is_labels && info.channels == 1 && info.times == 1;
    let way_on = "A name ending in .seg.nrrd keeps the labels, with their colours, for 3D Slicer.";
    plan_with(volume, None).noted(is_segmentation.then(|| way_on.to_owned()))
}

/// Plans a file of labels, with 3D Slicer's keys for each.
pub(crate) fn plan_segments(volume: &Volume) -> Plan {
    plan_with(volume, Some(volume.segments))
}

/// Refuses a volume that is no segmentation of one layer.
pub(crate) fn check_segments(volume: &Volume) -> Result<(), ExportError> {
    const FORMAT: &str = "A .seg.nrrd file";
    if !volume.is_labels {
        let problem =
            "a .seg.nrrd file holds labels, and the store is an image: choose .nrrd, or make it labels by `edit`";
        return Err(ExportError::unfit(volume.output, problem));
    }
    if volume.info.voxel_type.is_float() {
        // Fractions and NaN would be labels to whoever reads it.
        let problem =
            "a .seg.nrrd file holds whole numbers as labels, and the store's are floats: choose .nrrd, .nii or .raw";
        return Err(ExportError::unfit(volume.output, problem));
    }
    volume.check_one_channel(FORMAT)?;
    volume.check_one_step(FORMAT)
}

fn plan_with(volume: &Volume, segments: Option<&[Segment]>) -> Plan {
    let info = volume.info;
    let frame = Frame::of(info);
    let header = Header { segments, ..Header::of(volume, &frame) };
    let mut kept = vec![Fact::Spacing, Fact::LengthUnit, Fact::Orientation];
    if volume.is_placed() {
        kept.push(Fact::Origin);
    }
    if header.time.is_some() {
        kept.extend([Fact::Times, Fact::TimeUnit]);
    }
    if header.since().is_some() {
        kept.push(Fact::Since);
    }
    if header.sample_unit.is_some() {
        kept.push(Fact::ValueUnit);
    }
    if header.name.is_some() {
        kept.push(Fact::Name);
    }
    if segments.is_some() {
        kept.push(Fact::Labels);
    }
    let body = Body::Flat(Layout::after(header.text().into_bytes(), volume));
    Plan::new(volume, "NRRD", &kept, body).noted(frame.contradiction(info))
}

/// Time along its axis.
struct Time<'a> {
    start: f64,
    step: f64,
    unit: Option<&'a str>,
}

struct Header<'a> {
    volume: &'a Volume<'a>,
    frame: &'a Frame,
    time: Option<Time<'a>>,
    sample_unit: Option<&'a str>,
    name: Option<&'a str>,
    /// The labels, in a file of them.
    segments: Option<&'a [Segment]>,
}

impl<'a> Header<'a> {
    fn of(volume: &'a Volume<'a>, frame: &'a Frame) -> Self {
        let even = volume.info.time.as_ref().filter(|axis| volume.info.times > 1 && axis.stamps.is_empty());
        let time = even.map(|axis| Time {
            start: axis.start,
            step: axis.step,
            unit: axis.unit.as_deref().map(time_symbol).filter(|unit| is_quotable(unit)),
        });
        let sample_unit = value_unit(volume).filter(|unit| is_quotable(unit));
        // A name that would end the line, or begin another field, is left out.
        let name = volume.name.filter(|name| !name.contains(char::is_control) && name.trim() == *name);
        Self { volume, frame, time, sample_unit, name, segments: None }
    }

    /// The moment from which times count, for which the format has no field, but keys of anyone's.
    fn since(&self) -> Option<&str> {
        moment(self.volume).filter(|_| self.time.is_some())
    }

    /// Whether the place is given axis by axis: units of their own belong to no common space.
    fn is_by_axes(&self) -> bool {
        self.volume.info.geometry.axis_units.is_some()
    }

    /// Whether the place is given by directions and the first voxel's centre.
    fn has_frame(&self) -> bool {
        self.volume.is_placed() && !self.is_by_axes()
    }

    /// A word for each axis: three of space, then those of channels and of time, where there is more than one.
    fn per_axis(&self, space: [String; 3], channels: &str, time: &str) -> String {
        let info = self.volume.info;
        let outer = [(info.channels > 1, channels), (info.times > 1, time)];
        let outer = outer.into_iter().filter(|(is_there, _)| *is_there).map(|(_, word)| word.to_owned());
        space.into_iter().chain(outer).collect::<Vec<_>>().join(" ")
    }

    fn text(&self) -> String {
        let info = self.volume.info;
        let mut text = String::from("NRRD0005\n# Written by brickyard\n");
        let mut line = |field: &str, value: &str| writeln!(text, "{field}: {value}").expect("a string takes all");
        let each = |value: &dyn Fn(usize) -> String| [0, 1, 2].map(value);
        let sizes = info.extent.to_array();
        let has_frame = self.has_frame();
        line("type", type_of(info.voxel_type));
        let outer = u32::from(info.channels > 1) + u32::from(info.times > 1);
        line("dimension", &(3 + outer).to_string());
        if has_frame && info.orientation.is_some() {
            line("space", "left-posterior-superior");
        } else if has_frame {
            line("space dimension", "3");
        }
        let (channels, times) = (info.channels.to_string(), info.times.to_string());
        line("sizes", &self.per_axis(each(&|axis| sizes[axis].to_string()), &channels, &times));
        // Slicer's own segmentations have domains.
        let kind = if has_frame && self.segments.is_none() { "space" } else { "domain" };
        line("kinds", &self.per_axis(each(&|_| kind.into()), "list", "time"));
        if has_frame {
            let frame = if info.orientation.is_some() { self.frame.to_left_back_head() } else { *self.frame };
            line("space directions", &self.per_axis(frame.steps.map(vector), "none", "none"));
            line("space origin", &vector(frame.first));
            if let Some(unit) = info.geometry.unit.as_deref().map(symbol) {
                line("space units", &[unit; 3].map(|unit| format!("\"{unit}\"")).join(" "));
            }
        }
        self.by_axes(&mut line);
        if let Some(unit) = self.sample_unit {
            line("sample units", &format!("\"{unit}\""));
        }
        if let Some(name) = self.name {
            line("content", name);
        }
        line("endian", "little");
        line("encoding", "raw");
        let key = self.since().map_or(String::new(), |since| format!("time_since:={since}\n"));
        let segments = self.segments.map_or(String::new(), segments::keys);
        text + &key + &segments + "\n"
    }

    /// Fields of numbers for each axis: of space where it has no directions, and of time.
    fn by_axes(&self, line: &mut impl FnMut(&str, &str)) {
        let info = self.volume.info;
        if !self.is_by_axes() && self.time.is_none() {
            return;
        }
        let each = |value: &dyn Fn(usize) -> String, unknown: &str| {
            [0, 1, 2].map(|axis| if self.is_by_axes() { value(axis) } else { unknown.to_owned() })
        };
        let of_time =
            |value: &dyn Fn(&Time) -> f64| self.time.as_ref().map_or("nan".into(), |time| value(time).to_string());
        let (spacing, origin) = (info.geometry.spacing, info.geometry.origin);
        // A place means nothing without the distances from there.
        let known = |length: f64| if info.calibrated { length.to_string() } else { "nan".into() };
        let spacings = each(&|axis| known(spacing[axis]), "nan");
        line("spacings", &self.per_axis(spacings, "nan", &of_time(&|time| time.step)));
        // Samples at nodes: the least place is the first one's centre.
        let time = if self.time.is_some() { "node" } else { "???" };
        line("centerings", &self.per_axis(each(&|_| "node".into(), "???"), "???", time));
        let origins = each(&|axis| known(origin[axis]), "nan");
        line("axis mins", &self.per_axis(origins, "nan", &of_time(&|time| time.start)));
        let quoted = |unit: &str| format!("\"{unit}\"");
        let units =
            each(&|axis| quoted(info.geometry.axis_unit(axis).filter(|unit| is_quotable(unit)).unwrap_or("")), "\"\"");
        let of_time = self.time.as_ref().and_then(|time| time.unit).unwrap_or("");
        line("units", &self.per_axis(units, "\"\"", &quoted(of_time)));
    }
}

/// A unit's symbol in ASCII: some readers leave out other characters, and would take micrometres for metres.
fn symbol(unit: &str) -> &str {
    match unit {
        "micrometer" => "um",
        other if unit_symbol(other).is_ascii() => unit_symbol(other),
        other => other,
    }
}

/// Whether a text can stand in quotes.
fn is_quotable(text: &str) -> bool {
    !text.contains(['"', '\\']) && !text.contains(char::is_control)
}

fn vector(v: DVec3) -> String {
    format!("({})", words(v.to_array()).replace(' ', ","))
}

fn type_of(voxel_type: VoxelType) -> &'static str {
    match voxel_type {
        VoxelType::F32 => "float",
        whole => whole.zarr_name(),
    }
}
