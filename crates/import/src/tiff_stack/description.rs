//! What ImageJ and OME-XML write into the image description of the first page: the order of pages, spacing, unit, and what
//! stored numbers stand for.
//!
//! Both are read tolerantly, as text: anything not understood leaves the pages as a plain stack along z, and a note.

use super::calibration::Calibration;
use crate::axes::{Axis, Sizes};
use crate::element::{Element, Scale};
use crate::options::NoData;
use crate::source::SourceInfo;
use brickyard_volume::{ChannelLook, Extent, TimeAxis, time_unit};
use glam::DVec3;

/// Everything that is taken from a TIFF file's image description.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Description {
    pub(super) declared: Option<Declared>,
    /// Names or numbers of the images that OME-XML describes; empty unless there are several.
    pub(super) images: Vec<String>,
    spacing: Option<[f64; 3]>,
    /// UDUNITS name.
    unit: Option<&'static str>,
    /// When the time steps were taken.
    time: Option<TimeAxis>,
    /// How stored numbers become values; `None` if they are the values.
    pub(super) calibration: Option<Calibration>,
    /// The stored number of pixels without data, which GDAL keeps in a tag of its own.
    pub(super) nodata: Option<f64>,
    /// How the channels look, as far as is said.
    pub(super) channel_looks: Vec<ChannelLook>,
    notes: Vec<String>,
}

/// The arrangement of pages that a description declares.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Declared {
    /// The axes along which pages follow one another (t, c, z), slowest first.
    pub(super) page_axes: Vec<Axis>,
    pub(super) z: u32,
    pub(super) channels: u32,
    pub(super) times: u32,
    /// Whether all planes may lie behind a single directory, as in ImageJ's stacks over 4 GiB.
    pub(super) in_one_directory: bool,
    /// Whether `channels` counts the samples within a page.
    counts_samples: bool,
}

impl Declared {
    pub(super) fn planes(&self) -> u64 {
        (self.z as u64).saturating_mul(self.channels as u64).saturating_mul(self.times as u64)
    }

    pub(super) fn sizes(&self, width: u32, height: u32) -> Sizes {
        Sizes { extent: Extent::new(width, height, self.z), channels: self.channels, times: self.times }
    }

    /// Returns the sizes in pages: samples within a page do not count as channels. `None` if the samples of a page do
    /// not divide the number of channels.
    pub(super) fn page_sizes(&self, samples: u16) -> Option<Sizes> {
        let mut sizes = self.sizes(1, 1);
        if self.counts_samples {
            if !sizes.channels.is_multiple_of(samples as u32) {
                return None;
            }
            sizes.channels /= samples as u32;
        }
        Some(sizes)
    }
}

impl Description {
    /// Parses the text of an image description. `resolution` is pixels per unit along x and y, which ImageJ keeps in
    /// the page's tags.
    pub(super) fn parse(text: &str, resolution: Option<(f64, f64)>) -> Self {
        if text.starts_with("ImageJ=") {
            return Self::parse_imagej(text, resolution);
        }
        match StartTag::find(text, "Pixels") {
            Some(pixels) if text.trim_start().starts_with('<') => Self::parse_ome(text, &pixels),
            _ => Self::default(),
        }
    }

    /// ImageJ: lines of `key=value`; pages run through channels first, then slices, then frames.
    fn parse_imagej(text: &str, resolution: Option<(f64, f64)>) -> Self {
        let value = |key: &str| text.lines().find_map(|l| l.strip_prefix(key)?.strip_prefix('=')).map(str::trim);
        let count = |key| value(key).and_then(|v| v.parse::<u32>().ok());
        let images = count("images").unwrap_or(1);
        let (channels, frames) = (count("channels").unwrap_or(1), count("frames").unwrap_or(1));
        let others = channels.saturating_mul(frames);
        let slices = count("slices").unwrap_or(if others == 1 { images } else { 1 });
        let mut description = Self {
            declared: Some(Declared {
                page_axes: vec![Axis::T, Axis::Z, Axis::C],
                z: slices,
                channels,
                times: frames,
                in_one_directory: true,
                counts_samples: false,
            }),
            calibration: Calibration::parse(value),
            channel_looks: display_range(value).into_iter().collect(),
            ..Self::default()
        };
        let depth =
            value("spacing").and_then(|v| v.parse::<f64>().ok()).map(f64::abs).filter(|s| *s > 0.0 && s.is_finite());
        let unit = value("unit").filter(|u| !u.starts_with("pixel"));
        description.set_unit(unit);
        if unit.is_some() || depth.is_some() {
            // Without a unit the resolution is a printer's, not the data's.
            let size = |r: f64| if unit.is_some() && r > 0.0 { 1.0 / r } else { 1.0 };
            let (x, y) = resolution.unwrap_or((1.0, 1.0));
            description.spacing = Some([size(x), size(y), depth.unwrap_or(1.0)]);
        }
        let interval = value("finterval").and_then(|v| v.parse::<f64>().ok()).filter(|step| *step != 0.0);
        if let Some(step) = interval.filter(|_| frames > 1) {
            let unit = value("tunit").unwrap_or("s");
            let axis = TimeAxis { step, ..TimeAxis::default() };
            description.set_time(axis, unit, frames);
        }
        description
    }

    /// OME-XML: the first image's `Pixels`.
    fn parse_ome(text: &str, pixels: &StartTag) -> Self {
        let mut description = Self {
            declared: declared_by_ome(text, pixels),
            images: images_of_ome(text),
            channel_looks: channels_of_ome(text),
            ..Self::default()
        };
        if description.declared.is_none() {
            let note = "The OME-XML description does not say how pages are arranged; they are taken along z.";
            description.notes.push(note.into());
        }
        let sizes = ['X', 'Y', 'Z'].map(|axis| {
            let size = pixels.number::<f64>(&format!("PhysicalSize{axis}")).filter(|s| *s > 0.0 && s.is_finite())?;
            let unit = pixels.attribute(&format!("PhysicalSize{axis}Unit")).unwrap_or("µm");
            Some((size, unit))
        });
        if let [Some((x, unit)), y, z] = sizes {
            description.set_unit(Some(unit));
            // Every axis may have a unit of its own; all are told in that of x. A missing y is x's.
            let metres = |name: &str| unit_of(name).map(|u| u.1);
            let in_x = |size: Option<(f64, &str)>| {
                let (size, own) = size?;
                if own == unit { Some(size) } else { Some(size * metres(own)? / metres(unit)?) }
            };
            description.spacing = Some([x, in_x(y).unwrap_or(x), in_x(z).unwrap_or(1.0)]);
            if z.is_none() && description.declared.as_ref().is_some_and(|d| d.z > 1) {
                description.notes.push("The description gives no spacing along z; 1 is taken.".into());
            }
        }
        let times = description.declared.as_ref().map_or(1, |declared| declared.times);
        if times > 1 {
            description.set_time_of_ome(text, pixels, times);
        }
        description
    }

    /// OME-XML: the increment, or else when the first plane of each step was taken, if every step has one.
    fn set_time_of_ome(&mut self, text: &str, pixels: &StartTag, times: u32) {
        if let Some(step) = pixels.number::<f64>("TimeIncrement") {
            let unit = pixels.attribute("TimeIncrementUnit").unwrap_or("s");
            return self.set_time(TimeAxis { step, ..TimeAxis::default() }, unit, times);
        }
        let first =
            |plane: &StartTag| ["TheZ", "TheC"].iter().all(|place| plane.number::<u32>(place).unwrap_or(0) == 0);
        let mut stamps: Vec<(u32, f64)> = Vec::new();
        let mut unit = "s";
        for plane in StartTag::all(text, "Plane").filter(first) {
            if let Some(stamp) = plane.number("TheT").zip(plane.number("DeltaT")) {
                stamps.push(stamp);
                unit = plane.attribute("DeltaTUnit").unwrap_or("s");
            }
        }
        stamps.sort_by_key(|(step, _)| *step);
        if !stamps.iter().map(|(step, _)| *step).eq(0..times) {
            return;
        }
        match TimeAxis::of_stamps(stamps.into_iter().map(|(_, stamp)| stamp).collect(), None) {
            Ok(axis) => self.set_time(axis, unit, times),
            Err(problem) => self.notes.push(format!("The description's times are left out: {problem}.")),
        }
    }

    /// Takes a time axis, as far as it can be one of `times` steps.
    fn set_time(&mut self, axis: TimeAxis, unit: &str, times: u32) {
        match axis.check(times) {
            Ok(()) => {
                let known = time_unit(unit).map(str::to_owned);
                if known.is_err() {
                    self.notes.push(format!("The unit of time '{unit}' is not known; times are kept without a unit."));
                }
                self.time = Some(TimeAxis { unit: known.ok(), ..axis });
            }
            Err(problem) => self.notes.push(format!("The description's times are left out: {problem}.")),
        }
    }

    fn set_unit(&mut self, name: Option<&str>) {
        let Some(name) = name else { return };
        match unit_of(name) {
            Some((unit, _)) => self.unit = Some(unit),
            None => self.notes.push(format!("The unit '{name}' is not known; lengths are kept without a unit.")),
        }
    }

    /// Returns how stored numbers are scaled to values (`None` if they are not), and a note for the user if there is
    /// something to say.
    pub(super) fn scale(&self, element: Element, samples: u16) -> (Option<Scale>, Option<String>) {
        self.calibration.as_ref().map_or((None, None), |c| c.scale(element, samples))
    }

    /// Tells `info` which voxels hold no data, unless the user says it. `scale` is what makes stored numbers voxels.
    pub(super) fn mark(&self, info: &mut SourceInfo, scale: Option<Scale>, nodata: NoData) {
        let of_file = self.nodata.filter(|_| nodata == NoData::OfFile);
        let value = of_file.map(|stored| scale.map_or(stored, |scale| stored * scale.slope + scale.intercept));
        if let Some(value) = value {
            info.set_nodata(value, "GDAL_NODATA");
        }
    }

    /// Adds the spacing, unit and notes of the description to `info`.
    pub(super) fn place(&self, info: &mut SourceInfo) {
        if let Some(spacing) = self.spacing {
            info.geometry.spacing = DVec3::from_array(spacing);
            info.calibrated = true;
        }
        info.geometry.unit = self.unit.map(str::to_owned);
        // Times of some other number of steps are of something else.
        if self.declared.as_ref().is_some_and(|declared| declared.times == info.times) {
            info.time.clone_from(&self.time);
        }
        // Looks of some other number of channels are of something else.
        if self.channel_looks.len() == info.channels as usize {
            info.channel_looks.clone_from(&self.channel_looks);
        }
        info.notes.extend(self.notes.iter().cloned());
    }
}

/// The images that the text tells of, where there are several.
fn images_of_ome(text: &str) -> Vec<String> {
    let names: Vec<String> = StartTag::all(text, "Image")
        .enumerate()
        .map(|(i, image)| image.attribute("Name").map_or_else(|| format!("number {i}"), |name| format!("'{name}'")))
        .collect();
    if names.len() > 1 { names } else { Vec::new() }
}

/// The look of an image of one channel, by ImageJ's display range.
fn display_range<'a>(value: impl Fn(&str) -> Option<&'a str>) -> Option<ChannelLook> {
    let number = |key| value(key)?.parse::<f64>().ok().filter(|number| number.is_finite());
    let (low, high) = number("min").zip(number("max"))?;
    (low < high).then(|| ChannelLook { window: Some([low, high]), ..ChannelLook::default() })
}

/// Names and colours of the channels of the first image, one for each sample of a pixel; none where the text is not whole.
fn channels_of_ome(text: &str) -> Vec<ChannelLook> {
    let Ok(document) = roxmltree::Document::parse(text) else { return Vec::new() };
    let Some(pixels) = document.descendants().find(|node| node.tag_name().name() == "Pixels") else {
        return Vec::new();
    };
    let channels = pixels.children().filter(|node| node.tag_name().name() == "Channel");
    let looks = channels.flat_map(|channel| {
        let samples = channel.attribute("SamplesPerPixel").and_then(|n| n.parse().ok()).unwrap_or(1);
        let name = channel.attribute("Name").map(str::trim).filter(|name| !name.is_empty());
        // Red, green, blue and opacity, a byte each, as one signed number.
        let color = channel.attribute("Color").and_then(|color| color.trim().parse::<i64>().ok()).map(|color| {
            let [red, green, blue, _] = (color as u32).to_be_bytes();
            [red, green, blue]
        });
        let look = ChannelLook { name: name.map(str::to_owned), color, window: None };
        // The samples of one channel are those of a photograph, whatever its own name and colour.
        if samples == 1 { vec![look] } else { vec![ChannelLook::default(); samples.min(16)] }
    });
    looks.collect()
}

fn declared_by_ome(text: &str, pixels: &StartTag) -> Option<Declared> {
    // Fastest first, x and y always leading.
    let order = pixels.attribute("DimensionOrder")?.strip_prefix("XY")?;
    let axis = |letter| match letter {
        'Z' => Some(Axis::Z),
        'C' => Some(Axis::C),
        'T' => Some(Axis::T),
        _ => None,
    };
    let page_axes: Vec<Axis> = order.chars().rev().map(axis).collect::<Option<_>>()?;
    let has = |axis| page_axes.contains(&axis);
    if page_axes.len() != 3 || !has(Axis::Z) || !has(Axis::C) || !has(Axis::T) {
        return None;
    }
    let size = |name| pixels.number::<u32>(name).filter(|&n| n > 0);
    let declared = Declared {
        page_axes,
        z: size("SizeZ")?,
        channels: size("SizeC")?,
        times: size("SizeT")?,
        in_one_directory: false,
        counts_samples: true,
    };
    pages_follow_order(text, &declared).then_some(declared)
}

/// Whether the `TiffData` elements that name a directory name the one that the dimension order implies.
fn pages_follow_order(text: &str, declared: &Declared) -> bool {
    let samples = StartTag::find(text, "Channel").and_then(|c| c.number("SamplesPerPixel")).unwrap_or(1).max(1);
    let channels = (declared.channels / samples).max(1) as u64;
    StartTag::all(text, "TiffData").all(|data| {
        let Some(directory) = data.number::<u64>("IFD") else { return true };
        let first = |name| data.number::<u32>(name).unwrap_or(0) as u64;
        let page = declared.page_axes.iter().fold(0u64, |page, axis| {
            let (size, i) = match axis {
                Axis::C => (channels, first("FirstC") / samples as u64),
                Axis::T => (declared.times as u64, first("FirstT")),
                _ => (declared.z as u64, first("FirstZ")),
            };
            page.saturating_mul(size).saturating_add(i)
        });
        page == directory
    })
}

/// UDUNITS name and length in metres of a unit as ImageJ and OME-XML write it.
fn unit_of(name: &str) -> Option<(&'static str, f64)> {
    Some(match name {
        "nm" | "nanometer" | "nanometre" => ("nanometer", 1e-9),
        "um" | "µm" | "μm" | "\\u00B5m" | "\\u00b5m" | "&#181;m" | "&#xB5;m" | "&#xb5;m" | "&#956;m" | "&#x3BC;m"
        | "micron" | "microns" | "micrometer" | "micrometre" => ("micrometer", 1e-6),
        "mm" | "millimeter" | "millimetre" => ("millimeter", 1e-3),
        "cm" | "centimeter" | "centimetre" => ("centimeter", 1e-2),
        "m" | "meter" | "metre" => ("meter", 1.0),
        "Å" | "A" | "angstrom" => ("angstrom", 1e-10),
        "in" | "inch" => ("inch", 0.0254),
        _ => return None,
    })
}

/// The inside of one XML start tag.
struct StartTag<'a>(&'a str);

impl<'a> StartTag<'a> {
    fn find(text: &'a str, name: &str) -> Option<Self> {
        Self::all(text, name).next()
    }

    /// Start tags of this name, with or without a namespace prefix.
    fn all(text: &'a str, name: &str) -> impl Iterator<Item = Self> {
        text.split('<').skip(1).filter_map(move |tag| {
            let inside = tag.split('>').next()?;
            let (found, attributes) = inside.split_once(char::is_whitespace)?;
            let local = found.rsplit(':').next()?;
            (local == name).then_some(Self(attributes))
        })
    }

    fn attribute(&self, name: &str) -> Option<&'a str> {
        let mut rest = self.0;
        loop {
            let (key, after) = rest.split_once('=')?;
            let after = after.trim_start();
            let quote = after.chars().next().filter(|c| matches!(c, '"' | '\''))?;
            let (value, next) = after[1..].split_once(quote)?;
            if key.trim() == name {
                return Some(value);
            }
            rest = next;
        }
    }

    fn number<T: std::str::FromStr>(&self, name: &str) -> Option<T> {
        self.attribute(name)?.trim().parse().ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn imagej_hyperstacks_run_through_channels_first() {
        let text =
            "ImageJ=1.53t\nimages=24\nchannels=2\nslices=4\nframes=3\nhyperstack=true\nspacing=2.5\nunit=\\u00B5m\n";
        let d = Description::parse(text, Some((4.0, 2.0)));
        let declared = d.declared.unwrap();
        assert_eq!(declared.page_axes, [Axis::T, Axis::Z, Axis::C]);
        assert_eq!((declared.z, declared.channels, declared.times, declared.planes()), (4, 2, 3, 24));
        assert_eq!((d.spacing, d.unit), (Some([0.25, 0.5, 2.5]), Some("micrometer")));
    }

    #[test]
    fn imagej_without_a_unit_ignores_the_printers_resolution() {
        let d = Description::parse("ImageJ=1.4\nimages=5\nspacing=-3\n", Some((72.0, 72.0)));
        assert_eq!((d.spacing, d.unit, d.declared.unwrap().z), (Some([1.0, 1.0, 3.0]), None, 5));
        assert_eq!(Description::parse("ImageJ=1.4\nimages=5\nunit=pixel\n", Some((72.0, 72.0))).spacing, None);
        for spacing in ["inf", "-Infinity", "NaN", "0"] {
            let text = format!("ImageJ=1.4\nimages=5\nspacing={spacing}\n");
            assert_eq!(Description::parse(&text, None).spacing, None, "{spacing}");
        }
        let odd = Description::parse("ImageJ=1.4\nimages=5\nunit=furlong\n", None);
        assert!(odd.notes[0].contains("furlong"));
    }

    const OME: &str = r#"<?xml version="1.0"?><!-- a > b --><OME xmlns="x"><Image ID="Image:0"><ome:Pixels ID="Pixels:0"
        DimensionOrder="XYZCT" SizeX = "7" SizeY="5" SizeZ="4" SizeC="2" SizeT='3' Type="uint16" PhysicalSizeX="0.5"
        PhysicalSizeY="500" PhysicalSizeYUnit="nm" PhysicalSizeZ="2"><Channel ID="c" SamplesPerPixel="1"/>TIFFDATA"#;

    #[test]
    fn ome_xml_gives_order_and_sizes() {
        let d = Description::parse(&OME.replace("TIFFDATA", r#"<TiffData IFD="4" FirstC="1" PlaneCount="1"/>"#), None);
        let declared = d.declared.unwrap();
        assert_eq!(declared.page_axes, [Axis::T, Axis::C, Axis::Z]);
        assert_eq!((declared.z, declared.channels, declared.times), (4, 2, 3));
        let spacing = d.spacing.unwrap();
        assert!((spacing[1] - 0.5).abs() < 1e-12, "{spacing:?}");
        assert_eq!((spacing[0], spacing[2], d.unit), (0.5, 2.0, Some("micrometer")));
    }

    #[test]
    fn ome_xml_gives_names_and_colours_of_channels() {
        let text = OME.replace("ome:Pixels", "Pixels").replace(
            "TIFFDATA",
            r#"<Channel ID="d" Name="A &amp; &#181;&lt;" Color="-16776961"/></Pixels></Image>
            <Image><Pixels><Channel Name="x"/></Pixels></Image></OME>"#,
        );
        let named = ChannelLook { name: Some("A & µ<".into()), color: Some([255, 0, 0]), window: None };
        assert_eq!(Description::parse(&text, None).channel_looks, [ChannelLook::default(), named]);
        assert_eq!(Description::parse(&text[..text.len() - 3], None).channel_looks, [], "not whole");
    }

    #[test]
    fn frames_are_taken_when_the_description_says() {
        let of = |text: &str| Description::parse(text, None);
        let axis = |step, unit: &str| Some(TimeAxis { step, unit: Some(unit.into()), ..TimeAxis::default() });
        let imagej = "ImageJ=1.53\nimages=6\nframes=3\nslices=2\n";
        assert_eq!(of(&format!("{imagej}finterval=0.25\n")).time, axis(0.25, "second"));
        assert_eq!(of(&format!("{imagej}finterval=0.25\ntunit=min\n")).time, axis(0.25, "minute"));
        assert_eq!((of(imagej).time, of(&format!("{imagej}finterval=0\n")).time), (None, None));
        assert_eq!(of("ImageJ=1.53\nimages=6\nfinterval=0.25\n").time, None);
        let bad = of(&format!("{imagej}finterval=-2\n"));
        assert!(bad.time.is_none() && bad.notes[0].contains("found -2"), "{:?}", bad.notes);
        let odd = of(&format!("{imagej}finterval=2\ntunit=moon\n"));
        assert!(odd.time.is_some_and(|axis| axis.unit.is_none()) && odd.notes[0].contains("'moon'"), "{:?}", odd.notes);

        let ome = OME.replace("PhysicalSizeX", r#"TimeIncrement="40" TimeIncrementUnit="ms" PhysicalSizeX"#);
        assert_eq!(of(&ome).time, axis(40.0, "millisecond"));
        let planes = |stamps: [f64; 3]| {
            let plane = |(t, stamp)| {
                format!(
                    r#"<Plane TheT="{t}" TheZ="0" TheC="0" DeltaT="{stamp}"/><Plane TheT="{t}" TheZ="1" DeltaT="77"/>"#
                )
            };
            OME.replace("TIFFDATA", &(0..3).zip(stamps).map(plane).collect::<String>())
        };
        assert_eq!(of(&planes([0.0, 1.5, 3.0])).time, axis(1.5, "second"));
        let irregular = of(&planes([1.0, 1.5, 9.0])).time.unwrap();
        assert_eq!((irregular.stamps, irregular.unit.as_deref()), (vec![1.0, 1.5, 9.0], Some("second")));
        let back = of(&planes([1.0, 0.5, 9.0]));
        assert!(back.time.is_none() && back.notes[0].contains("0.5 of step 1 after 1 of step 0"), "{:?}", back.notes);
        assert_eq!(of(OME).time, None);
    }

    #[test]
    fn imagej_gives_the_display_range_of_one_channel() {
        let looks = |text: &str| Description::parse(text, None).channel_looks;
        assert_eq!(looks("ImageJ=1.53\nimages=4\nmin=-2.5\nmax=900\n")[0].window, Some([-2.5, 900.0]));
        assert_eq!(looks("ImageJ=1.53\nimages=4\nmin=7\nmax=7\n"), []);
    }

    #[test]
    fn ome_xml_that_reorders_pages_is_not_believed() {
        let d = Description::parse(&OME.replace("TIFFDATA", r#"<TiffData IFD="3" FirstC="1"/>"#), None);
        assert_eq!(d.declared, None);
        assert!(d.notes[0].contains("along z"));
    }

    #[test]
    fn several_images_are_told() {
        let text = OME.replace("TIFFDATA", r#"</ome:Pixels></Image><Image ID="i" Name="overview"><Pixels/></Image>"#);
        assert_eq!(Description::parse(&text, None).images, ["number 0", "'overview'"]);
        assert!(Description::parse(OME, None).images.is_empty());
    }

    #[test]
    fn other_text_means_nothing() {
        for text in ["", "a plain remark", "<svg></svg>", "<Pixels", "<Pixels SizeX=>", "<Pixels SizeX=\"3"] {
            assert_eq!(Description::parse(text, None).declared, None, "{text}");
        }
    }
}
