//! OME-XML, read as a stream: the first image's `Pixels`, the map of its planes to pages, and the files of the pages.
//!
//! Only the needed parts are kept: a plane's place takes 28 bytes, and at most one tag, or one text between tags, is held at a time.
//! Elements count only in their places by the schema; comments, CDATA and annotations do not, but for the moment of times in the one that exports write.

#[cfg(test)]
mod tests;

use super::description::{Declared, Description, Ome, OmeSays};
use super::hyperstack::is_length;
use super::xml::{self, Failure, LONGEST_NAME, attribute, decoded, meaning, next_piece, number};
use crate::axes::Axis;
use crate::note::Note;
use crate::page_map::LISTED;
use crate::step_time::TimeSpan;
use brickyard_volume::ChannelLook;
use quick_xml::events::{BytesStart, Event};
use std::collections::HashMap;
use std::io::BufRead;

/// Deepest nesting of elements.
const DEEPEST: usize = 256;
/// Most elements: three for each plane are usual.
const MOST_ELEMENTS: u32 = 1 << 22;
/// Most elements kept of a kind: places of planes, and times.
const MOST_ENTRIES: usize = 1 << 20;
/// Most files of a set.
const MOST_PARTS: usize = 1 << 17;
/// Most channels with looks.
const MOST_LOOKS: usize = 4096;
/// Namespace of the annotation of exports, and its key of the moment from which times count.
const OWN_NAMESPACE: &str = "brickyard";
const SINCE_KEY: &str = "time_since";

/// The `Pixels` element of an image.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Pixels {
    /// Axes from plane to plane, slowest first.
    pub(super) axes: Vec<Axis>,
    /// Pixels of a plane along x and y.
    pub(super) plane: [u32; 2],
    /// Sizes along t, c and z. Channels count the samples of a pixel.
    pub(super) sizes: [u32; 3],
    pub(super) tiff_data: Vec<TiffData>,
    /// Files named by `tiff_data`.
    pub(super) parts: Vec<Part>,
}

impl Pixels {
    /// Arrangement of pages in the order of planes.
    pub(super) fn declared(&self) -> Declared {
        let [times, channels, z] = self.sizes;
        Declared {
            page_axes: self.axes.clone(),
            z,
            channels,
            times,
            plane: Some(self.plane),
            counts_samples: true,
            ..Declared::one_plane()
        }
    }
}

/// Place of some consecutive planes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct TiffData {
    /// Step, channel and slice of the first plane.
    pub(super) first: [u32; 3],
    /// First page, counted from 0; 0 by default.
    pub(super) ifd: Option<u32>,
    /// Number of planes; by default 1 with an `ifd`, else all pages of the file.
    pub(super) count: Option<u32>,
    /// The file, as an index into the parts; `None` is the file with the text.
    pub(super) part: Option<u32>,
}

/// A file of a set.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub(super) struct Part {
    pub(super) uuid: String,
    pub(super) name: Option<String>,
}

/// Reads OME-XML; `None` for another text.
///
/// # Errors
/// If it cannot be read, or lacks a required part.
pub(super) fn read(text: impl BufRead) -> Result<Option<Description>, Failure> {
    let mut xml = xml::reader(text);
    let (mut walk, mut piece) = (Walk::default(), Vec::new());
    loop {
        next_piece(&mut xml, &mut piece);
        let event = match xml.read_event_into(&mut piece) {
            Ok(event) => event,
            // A text that breaks before the root element is not OME-XML.
            Err(error) if walk.open.is_empty() => match error.into() {
                Failure::Disk(error) => return Err(Failure::Disk(error)),
                Failure::Meaning(_) => return Ok(None),
            },
            Err(error) => return Err(error.into()),
        };
        match event {
            Event::Start(tag) if walk.open.is_empty() && tag.local_name().as_ref() != b"OME" => return Ok(None),
            Event::Start(tag) => walk.enter(&tag)?,
            Event::End(_) => walk.leave()?,
            Event::Text(text) => walk.text(&text)?,
            Event::CData(text) => walk.text(&text)?,
            Event::Eof if walk.open.is_empty() => return Ok(None),
            Event::Eof => return meaning("ends inside an element: it was cut short"),
            // A document's own entities are not expanded: an attribute with one is not well-formed.
            _ => {}
        }
        if walk.open.is_empty() && walk.has_begun {
            return walk.description().map(Some);
        }
    }
}

/// The UUID of the OME-XML itself, from its first tag; `None` if it has none or the text is something else.
///
/// # Errors
/// If the disk cannot read it.
pub(super) fn uuid(text: impl BufRead) -> Result<Option<String>, Failure> {
    let mut xml = xml::reader(text);
    let mut piece = Vec::new();
    loop {
        next_piece(&mut xml, &mut piece);
        match xml.read_event_into(&mut piece).map_err(Failure::from) {
            Ok(Event::Start(tag)) if tag.local_name().as_ref() == b"OME" => {
                return attribute(&tag, "UUID");
            }
            Ok(Event::Decl(_) | Event::Comment(_) | Event::PI(_) | Event::Text(_) | Event::DocType(_)) => {}
            Err(Failure::Disk(error)) => return Err(Failure::Disk(error)),
            Ok(_) | Err(Failure::Meaning(_)) => return Ok(None),
        }
    }
}

/// Elements with a meaning in their place.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Element {
    Root,
    Image,
    Pixels,
    TiffData,
    Uuid,
    Annotations,
    OwnMap,
    OwnValue,
    Since,
    Other,
}

/// State of a walk through OME-XML.
#[derive(Default)]
struct Walk {
    has_begun: bool,
    elements: u32,
    /// Open elements, outermost first.
    open: Vec<Element>,
    uuid: Option<String>,
    elsewhere: Option<OmeSays>,
    images: u32,
    /// Names or numbers of the first image and the last.
    image_names: [String; 2],
    pixels: Option<Pixels>,
    /// Pixels in the XML itself.
    has_binary_data: bool,
    physical_sizes: [Option<(f64, String)>; 3],
    time_step: Option<(f64, String)>,
    /// Times of each step's first plane, and their unit.
    stamps: Vec<(u32, f64)>,
    stamp_unit: String,
    since: String,
    looks: Vec<ChannelLook>,
    samples: Option<u32>,
    splits_axes: bool,
    /// The current `TiffData` and its file.
    data: Option<TiffData>,
    part: Option<Part>,
    known_parts: HashMap<Part, u32>,
}

impl Walk {
    fn enter(&mut self, tag: &BytesStart) -> Result<(), Failure> {
        self.elements += 1;
        if self.elements > MOST_ELEMENTS {
            return meaning(format!("has more than {MOST_ELEMENTS} elements"));
        }
        if self.open.len() >= DEEPEST {
            return meaning(format!("has elements more than {DEEPEST} deep"));
        }
        let name = tag.local_name();
        let element = match (self.open.last(), name.as_ref()) {
            (None, _) => {
                self.has_begun = true;
                self.uuid = attribute(tag, "UUID")?;
                Element::Root
            }
            (Some(Element::Root), b"BinaryOnly") => {
                let Some(metadata_file) = attribute(tag, "MetadataFile")? else {
                    return meaning("is BinaryOnly, but names no MetadataFile");
                };
                self.elsewhere = Some(OmeSays::Elsewhere { metadata_file, uuid: attribute(tag, "UUID")? });
                Element::Other
            }
            (Some(Element::Root), b"Image") => self.image(tag)?,
            (Some(Element::Image), b"Pixels") => {
                self.pixels(tag)?;
                Element::Pixels
            }
            (Some(Element::Pixels), b"TiffData") => {
                self.data = Some(tiff_data(tag)?);
                Element::TiffData
            }
            // Another one is another name of the same file.
            (Some(Element::TiffData), b"UUID") if self.part.is_none() => {
                self.part = Some(Part { uuid: String::new(), name: attribute(tag, "FileName")? });
                Element::Uuid
            }
            (Some(Element::Pixels), b"Channel") => self.channel(tag)?,
            (Some(Element::Pixels), b"Plane") => self.plane(tag)?,
            (Some(Element::Pixels), b"BinData") => {
                self.has_binary_data = true;
                Element::Other
            }
            (Some(Element::Root), b"StructuredAnnotations") => Element::Annotations,
            (Some(Element::Annotations), b"MapAnnotation")
                if attribute(tag, "Namespace")?.as_deref() == Some(OWN_NAMESPACE) =>
            {
                Element::OwnMap
            }
            (Some(Element::OwnMap), b"Value") => Element::OwnValue,
            (Some(Element::OwnValue), b"M") if attribute(tag, "K")?.as_deref() == Some(SINCE_KEY) => {
                self.since.clear();
                Element::Since
            }
            (_, name) => {
                self.splits_axes |= name.starts_with(b"ModuloAlong");
                Element::Other
            }
        };
        self.open.push(element);
        Ok(())
    }

    fn text(&mut self, text: &[u8]) -> Result<(), Failure> {
        if self.open.last() == Some(&Element::Since) && self.since.len() <= LONGEST_NAME {
            self.since += &decoded(text);
        }
        if self.open.last() != Some(&Element::Uuid) {
            return Ok(());
        }
        if let Some(part) = &mut self.part {
            part.uuid += decoded(text).trim();
            if part.uuid.len() > LONGEST_NAME {
                return meaning("has a UUID of more than 1,024 characters");
            }
        }
        Ok(())
    }

    fn leave(&mut self) -> Result<(), Failure> {
        if self.open.pop() != Some(Element::TiffData) {
            return Ok(());
        }
        let Some((mut data, pixels)) = self.data.take().zip(self.pixels.as_mut()) else { return Ok(()) };
        if let Some(part) = self.part.take() {
            let next = self.known_parts.len() as u32;
            data.part = Some(*self.known_parts.entry(part.clone()).or_insert_with(|| {
                pixels.parts.push(part);
                next
            }));
        }
        pixels.tiff_data.push(data);
        if pixels.tiff_data.len() > MOST_ENTRIES || pixels.parts.len() > MOST_PARTS {
            return meaning(format!("names more than {MOST_ENTRIES} places of planes or {MOST_PARTS} files"));
        }
        Ok(())
    }

    /// Only the first image is read.
    fn image(&mut self, tag: &BytesStart) -> Result<Element, Failure> {
        let name = attribute(tag, "Name")?.map(|name| format!("'{}'", name.chars().take(80).collect::<String>()));
        let name = name.unwrap_or_else(|| format!("number {}", self.images));
        self.images = self.images.saturating_add(1);
        self.image_names[usize::from(self.images > 1)] = name;
        Ok(if self.images == 1 { Element::Image } else { Element::Other })
    }

    fn pixels(&mut self, tag: &BytesStart) -> Result<(), Failure> {
        if self.pixels.is_some() {
            return meaning("has two Pixels in one Image");
        }
        let order = attribute(tag, "DimensionOrder")?.unwrap_or_default();
        let axis = |letter| LISTED.into_iter().find(|axis| axis.letter().to_ascii_uppercase() == letter);
        // Fastest first, always starting with x and y.
        let axes: Option<Vec<Axis>> = order.strip_prefix("XY").and_then(|rest| rest.chars().rev().map(axis).collect());
        let axes = axes.filter(|axes| axes.len() == 3 && LISTED.iter().all(|a| axes.contains(a)));
        let Some(axes) = axes else {
            return meaning(format!("has Pixels whose DimensionOrder is '{order}', expected one such as XYZCT"));
        };
        let size = |name| match number::<u32>(tag, name)? {
            Some(size) if size > 0 => Ok(size),
            _ => meaning(format!("has Pixels without a {name} above 0")),
        };
        let plane = [size("SizeX")?, size("SizeY")?];
        let sizes = [size("SizeT")?, size("SizeC")?, size("SizeZ")?];
        self.pixels = Some(Pixels { axes, plane, sizes, ..Pixels::default() });
        let length = |axis| {
            let name = format!("PhysicalSize{axis}");
            let unit = attribute(tag, &format!("{name}Unit"))?.unwrap_or_else(|| "µm".into());
            let size = attribute(tag, &name)?.and_then(|size| size.trim().parse().ok());
            Ok::<_, Failure>(size.filter(|&size| is_length(size)).map(|size| (size, unit)))
        };
        self.physical_sizes = [length('X')?, length('Y')?, length('Z')?];
        let step = attribute(tag, "TimeIncrement")?.and_then(|step| step.trim().parse().ok());
        let unit = attribute(tag, "TimeIncrementUnit")?.unwrap_or_else(|| "s".into());
        self.time_step = step.map(|step| (step, unit));
        Ok(())
    }

    fn channel(&mut self, tag: &BytesStart) -> Result<Element, Failure> {
        let samples = number::<u32>(tag, "SamplesPerPixel")?.unwrap_or(1);
        if *self.samples.get_or_insert(samples) != samples {
            return meaning("has channels of different SamplesPerPixel");
        }
        let name = attribute(tag, "Name")?.map(|name| name.trim().to_owned()).filter(|name| !name.is_empty());
        // Red, green, blue and opacity, a byte each, as one signed number.
        let color = attribute(tag, "Color")?.and_then(|color| color.trim().parse::<i64>().ok()).map(|color| {
            let [red, green, blue, _] = (color as u32).to_be_bytes();
            [red, green, blue]
        });
        if self.looks.len() < MOST_LOOKS {
            // The samples of one channel are a photograph's, whatever its own name and colour.
            match samples {
                1 => self.looks.push(ChannelLook { name, color, window: None, unit: None }),
                _ => self.looks.extend(vec![ChannelLook::default(); samples.min(16) as usize]),
            }
        }
        Ok(Element::Other)
    }

    /// Records the time of a step's first plane.
    fn plane(&mut self, tag: &BytesStart) -> Result<Element, Failure> {
        let index = |name| Ok::<_, Failure>(number::<u32>(tag, name)?.unwrap_or(0));
        if self.stamps.len() < MOST_ENTRIES
            && index("TheZ")? == 0
            && index("TheC")? == 0
            && let Some(step) = number::<u32>(tag, "TheT")?
            && let Some(stamp) = attribute(tag, "DeltaT")?.and_then(|stamp| stamp.trim().parse().ok())
        {
            self.stamps.push((step, stamp));
            self.stamp_unit = attribute(tag, "DeltaTUnit")?.unwrap_or_else(|| "s".into());
        }
        Ok(Element::Other)
    }

    fn description(mut self) -> Result<Description, Failure> {
        let uuid = self.uuid.take();
        if let Some(says) = self.elsewhere {
            return Ok(Description { ome: Some(Ome { uuid, says }), ..Description::default() });
        }
        if self.images > 1 {
            let [first, last] = &self.image_names;
            let problem = format!(
                "its OME-XML describes {} images, {first} to {last}, and a store holds one: write one to a file of its \
                 own (bfconvert -series NUMBER), or pass `axes` zyx to take all pages as one stack",
                self.images
            );
            return Ok(Description::unreadable(problem));
        }
        let Some(pixels) = self.pixels.take() else {
            let note = "The OME-XML description has no Pixels; pages are taken along z.";
            return Ok(Description { notes: vec![Note::warning(note)], ..Description::default() });
        };
        if self.has_binary_data && pixels.tiff_data.is_empty() {
            return meaning(
                "holds the pixels itself (BinData), which is not supported: write it as OME-TIFF (bfconvert)",
            );
        }
        let times = pixels.sizes[0];
        let mut description = Description {
            declared: Some(pixels.declared()),
            channel_looks: std::mem::take(&mut self.looks),
            ..Description::default()
        };
        description.set_physical_sizes(std::mem::take(&mut self.physical_sizes));
        if times == 1 {
            let stamp = self.stamps.iter().find(|(step, _)| *step == 0);
            description.step_time.stamp = stamp.and_then(|(_, stamp)| TimeSpan::of(*stamp, &self.stamp_unit));
        }
        match self.time_step.take() {
            Some((step, unit)) => description.set_increment(step, &unit, times),
            None if times > 1 => self.set_stamps(&mut description, times),
            None => {}
        }
        description.set_since(Some(&self.since));
        if self.splits_axes {
            let note = "The OME-XML description splits an axis once more (Modulo); it is kept as one.";
            description.notes.push(Note::warning(note));
        }
        description.ome = Some(Ome { uuid, says: OmeSays::Pixels(Box::new(pixels)) });
        Ok(description)
    }

    /// Sets the times of each step's first plane, if every step has one.
    fn set_stamps(&mut self, description: &mut Description, times: u32) {
        let mut stamps = std::mem::take(&mut self.stamps);
        stamps.sort_by_key(|(step, _)| *step);
        if stamps.iter().map(|(step, _)| *step).eq(0..times) {
            let stamps = stamps.into_iter().map(|(_, stamp)| stamp).collect();
            description.set_stamps(stamps, &self.stamp_unit, "The description's");
        }
    }
}

fn tiff_data(tag: &BytesStart) -> Result<TiffData, Failure> {
    let first = |name| Ok::<_, Failure>(number(tag, name)?.unwrap_or(0));
    // Its name before 2008; and 0 is no number of planes.
    let count = match number(tag, "PlaneCount")? {
        None => number(tag, "NumPlanes")?,
        count => count,
    };
    Ok(TiffData {
        first: [first("FirstT")?, first("FirstC")?, first("FirstZ")?],
        ifd: number(tag, "IFD")?,
        count: count.filter(|&count| count > 0),
        part: None,
    })
}
