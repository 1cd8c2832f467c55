//! OME-TIFF: the pages of `tiff.rs`, with OME-XML in the first one. Channels have names and colours, lengths and times units; a place is not written,
//! as the schema has one of the microscope's stage alone.

use crate::error::ExportError;
use crate::facts::{Fact, moment};
use crate::frame::{Frame, length_unit};
use crate::plan::{Body, Plan};
use crate::tiff::{Tags, arrange, nodata_field};
use crate::volume::Volume;
use crate::xml::escaped;
use brickyard_volume::units::LengthUnit;
use brickyard_volume::{TimeAxis, VoxelType, time_symbol};
use std::fmt::Write;

/// Most steps with times of their own: each has a line.
const MOST_STAMPS: u32 = 1 << 20;
/// Most channels: each has a line.
const MOST_CHANNELS: u32 = 1 << 16;

pub(crate) fn plan(volume: &Volume) -> Result<Plan, ExportError> {
    let info = volume.info;
    if info.channels > MOST_CHANNELS {
        let problem =
            format!("OME-TIFF is written with {MOST_CHANNELS} channels at most, not {}: choose fewer", info.channels);
        return Err(ExportError::unfit(volume.output, problem));
    }
    let times = Times::of(volume);
    let mut kept = vec![Fact::ChannelNames, Fact::ChannelColors, Fact::NoData, Fact::Name];
    if info.geometry.axis_units.is_none() {
        kept.extend([Fact::Spacing, Fact::LengthUnit]);
    }
    if times.is_some() {
        kept.extend([Fact::Times, Fact::StepTime, Fact::TimeUnit]);
        kept.extend(moment(volume).map(|_| Fact::Since));
    }
    let description = xml(volume, times.as_ref());
    let tags = Tags { resolution: [(1, 1); 2], description, first: nodata_field(volume).into_iter().collect() };
    let body = Body::Flat(arrange(volume, tags)?.layout);
    Ok(Plan::new(volume, "OME-TIFF", &kept, body).noted(Frame::of(info).contradiction(info)))
}

/// Times as OME has them, which has no times without a unit.
struct Times<'a> {
    axis: &'a TimeAxis,
    unit: &'a str,
    /// Whether the steps are evenly spaced from 0 on.
    is_plain: bool,
}

impl<'a> Times<'a> {
    fn of(volume: &Volume<'a>) -> Option<Self> {
        let axis = volume.info.time.as_ref()?;
        let unit = match axis.unit.as_deref()? {
            "microsecond" => "\u{b5}s",
            other => time_symbol(other),
        };
        let is_plain = axis.stamps.is_empty() && axis.start == 0.0 && volume.info.times > 1;
        (is_plain || volume.info.times <= MOST_STAMPS).then_some(Self { axis, unit, is_plain })
    }
}

fn xml(volume: &Volume, times: Option<&Times>) -> String {
    let info = volume.info;
    let [x, y, z] = info.extent.to_array();
    let (c, t) = (info.channels, info.times);
    let name = volume.name.map_or(String::new(), |name| format!(" Name=\"{}\"", escaped(name)));
    let mut text = format!(
        "<?xml version=\"1.0\" encoding=\"UTF-8\"?>\n\
         <OME xmlns=\"http://www.openmicroscopy.org/Schemas/OME/2016-06\" \
         xmlns:xsi=\"http://www.w3.org/2001/XMLSchema-instance\" \
         xsi:schemaLocation=\"http://www.openmicroscopy.org/Schemas/OME/2016-06 \
         http://www.openmicroscopy.org/Schemas/OME/2016-06/ome.xsd\" Creator=\"brickyard\">\n\
         <Image ID=\"Image:0\"{name}>\n\
         <Pixels ID=\"Pixels:0\" DimensionOrder=\"XYCZT\" Type=\"{kind}\" BigEndian=\"false\" SizeX=\"{x}\" SizeY=\"{y}\" \
         SizeZ=\"{z}\" SizeC=\"{c}\" SizeT=\"{t}\"",
        kind = type_of(info.voxel_type),
    );
    let mut put = |part: String| write!(text, "{part}").expect("a string takes all");
    if info.calibrated && info.geometry.axis_units.is_none() {
        let frame = Frame::of(info);
        let (unit, spacing) = lengths(volume, frame.spacing.to_array());
        for (axis, size) in ["X", "Y", "Z"].into_iter().zip(spacing) {
            put(format!(" PhysicalSize{axis}=\"{size}\" PhysicalSize{axis}Unit=\"{unit}\""));
        }
    }
    if let Some(Times { axis, unit, .. }) = times.filter(|times| times.is_plain) {
        put(format!(" TimeIncrement=\"{}\" TimeIncrementUnit=\"{unit}\"", axis.step));
    }
    put(">\n".into());
    for channel in 0..c {
        let look = info.channel_looks.get(channel as usize).cloned().unwrap_or_default();
        let name = look.name.map_or(String::new(), |name| format!(" Name=\"{}\"", escaped(&name)));
        // Red, green, blue and opacity, a byte each, as one signed number.
        let number = |[red, green, blue]: [u8; 3]| i32::from_be_bytes([red, green, blue, 255]);
        let color = look.color.map_or(String::new(), |color| format!(" Color=\"{}\"", number(color)));
        put(format!("<Channel ID=\"Channel:0:{channel}\" SamplesPerPixel=\"1\"{name}{color}/>\n"));
    }
    let planes = u64::from(c) * u64::from(z) * u64::from(t);
    put(format!("<TiffData IFD=\"0\" PlaneCount=\"{planes}\"/>\n"));
    if let Some(Times { axis, unit, .. }) = times.filter(|times| !times.is_plain) {
        for step in 0..t {
            let time = axis.at(step);
            put(format!("<Plane TheZ=\"0\" TheC=\"0\" TheT=\"{step}\" DeltaT=\"{time}\" DeltaTUnit=\"{unit}\"/>\n"));
        }
    }
    // The schema has no place for the moment from which times count, but an annotation.
    let since = times.and_then(|_| moment(volume));
    let (reference, annotation) = since.map_or_else(Default::default, |since| {
        let map = format!("<Value><M K=\"time_since\">{since}</M></Value>");
        let annotation = format!("<MapAnnotation ID=\"Annotation:0\" Namespace=\"brickyard\">{map}</MapAnnotation>");
        let reference = "<AnnotationRef ID=\"Annotation:0\"/>\n".to_owned();
        (reference, format!("<StructuredAnnotations>\n{annotation}\n</StructuredAnnotations>\n"))
    });
    put(format!("</Pixels>\n{reference}</Image>\n{annotation}</OME>\n"));
    text
}

/// OME's symbol of the unit of lengths, and lengths in it; those of unknown units are of no world.
fn lengths(volume: &Volume, lengths: [f64; 3]) -> (&'static str, [f64; 3]) {
    let Some(own) = length_unit(volume.info) else { return ("reference frame", lengths) };
    let symbol = match own.name {
        "inch" => "in",
        "foot" => "ft",
        "yard" => "yd",
        "mile" => "mi",
        "parsec" => "pc",
        "decimeter" => "dm",
        "hectometer" => "hm",
        "angstrom" | "picometer" | "nanometer" | "micrometer" | "millimeter" | "centimeter" | "meter" | "kilometer" => {
            own.symbol()
        }
        _ => {
            let metre = LengthUnit::named("meter").unwrap_or(own);
            return ("m", lengths.map(|length| own.convert(length, metre)));
        }
    };
    (symbol, lengths)
}

fn type_of(voxel_type: VoxelType) -> &'static str {
    match voxel_type {
        VoxelType::F32 => "float",
        whole => whole.zarr_name(),
    }
}
