//! Segmentations: frames of labels, placed one by one, each for a slice of one segment (bits, or fractions) or of all (a label map).
//!
//! Bits and label maps are one volume of the segments' numbers, 0 outside of them and in slices without a frame; fractions are a channel for each
//! segment. Opening reads bits once, plane by plane, to refuse segments that overlap; reading decodes the frames of a plane, one by one.

use super::decode_bits::Bits;
use super::frames::Frames;
use super::header::Header;
use super::pixels::{Meaning, PixelFormat};
use super::series::find_slice;
use super::stack;
use super::stack::{Names, Placement, Rules, Slice};
use crate::axes::Sizes;
use crate::element::smallest_type;
use crate::error::{ImportError, Result};
use crate::labels::SaidKind;
use crate::note::Note;
use crate::options::{Gaps, OpenOptions};
use crate::placement;
use crate::raw::identity;
use crate::source::{Access, Source, SourceInfo};
use brickyard_volume::{ChannelLook, Extent, VoxelBox, VoxelType, counted, with_voxel_type};
use dicom_dictionary_std::{tags, uids};
use std::collections::BTreeMap;

/// Highest number of a segment.
const MOST_SEGMENTS: f64 = 65535.0;
/// Most segments named in a message.
const MOST_NAMED: usize = 20;

/// Form of a segmentation's numbers.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Form {
    /// Bits: a voxel belongs to a frame's segment, or not.
    Binary,
    /// Parts of this number.
    Fractional { whole: f64 },
    /// Segments' numbers.
    LabelMap,
}

/// A segment's number and name.
#[derive(Clone, Debug, PartialEq)]
struct Segment {
    number: u32,
    name: String,
}

/// A frame on a plane.
#[derive(Clone, Copy, Debug)]
struct Layer {
    frame: usize,
    /// Number of its segment; 0 in a label map.
    segment: u32,
}

enum Stored {
    Bits(Bits),
    Frames(Frames),
}

/// A segmentation as a source.
pub(super) struct Segmentation {
    info: SourceInfo,
    header: Header,
    stored: Stored,
    form: Form,
    /// Frames of each plane along z.
    planes: BTreeMap<u32, Vec<Layer>>,
    /// Segment of each channel, of fractions.
    channels: Vec<u32>,
}

/// Whether a file is a segmentation.
pub(super) fn is_segmentation(header: &Header) -> bool {
    let known = [uids::SEGMENTATION_STORAGE, uids::LABEL_MAP_SEGMENTATION_STORAGE];
    header.text(tags::SOP_CLASS_UID).is_some_and(|class| known.contains(&class.as_str()))
}

impl Segmentation {
    /// Opens a segmentation, or one segment of it by its number or name.
    pub(super) fn open(
        mut header: Header,
        segment: Option<&str>,
        options: &OpenOptions,
        mut notes: Vec<Note>,
    ) -> Result<Self> {
        let form = form_of(&header)?;
        let path = header.path.clone();
        if options.are_labels == Some(true) && matches!(form, Form::Fractional { .. }) {
            let problem = "holds fractions of segments, which are no labels: pack it as an image";
            return Err(ImportError::options(&path, problem));
        }
        if options.gaps != Gaps::Refuse {
            let problem = "`gaps` is for images: slices without a frame of a segmentation hold label 0; leave it out";
            return Err(ImportError::options(&path, problem));
        }
        let stored = match form {
            Form::Binary => Stored::Bits(Bits::find(&header)?),
            _ => Stored::Frames(Frames::find(&header)?),
        };
        if matches!(&stored, Stored::Frames(frames) if frames.format.is_float) {
            let advice = "write it again with whole numbers";
            return Err(ImportError::unsupported_but(&path, "a segmentation of floating-point pixels", advice));
        }
        let (count, [columns, rows]) = match &stored {
            Stored::Bits(bits) => (bits.count(), bits.size()),
            Stored::Frames(frames) => (frames.count(), frames.size()),
        };
        let all = segments_of(&header)?;
        let kept = choose(&header, &all, segment, form)?;
        let layers = layers_of(&header, count, form, &all)?;
        let (planes, placement) = planes_of(&header, layers, options)?;
        let top = planes.last_key_value().map_or(0, |(z, _)| *z);
        let channels: Vec<u32> = match form {
            Form::Fractional { .. } => kept.iter().map(|segment| segment.number).collect(),
            _ => Vec::new(),
        };
        let sizes =
            Sizes { extent: Extent::new(columns, rows, top + 1), channels: channels.len().max(1) as u32, times: 1 };
        let voxel_type = voxel_type_of(form, &kept, &stored, options);
        sizes.checked_bytes(voxel_type.bytes()).map_err(|p| ImportError::invalid(&path, p))?;
        let kind = format!("dicom segmentation {}", segment.unwrap_or("of all segments"));
        let mut info = SourceInfo {
            identity: identity(&kind, std::slice::from_ref(&path))?,
            ..SourceInfo::plain(sizes, voxel_type)
        };
        info.geometry.spacing = placement.spacing;
        info.geometry.unit = Some("millimeter".into());
        info.calibrated = true;
        info.kind = match form {
            Form::Fractional { .. } => SaidKind::Image("the kind of segmentation, fractions"),
            Form::Binary | Form::LabelMap => SaidKind::Labels("the kind of DICOM file, a segmentation"),
        };
        info.channel_looks = kept
            .iter()
            .filter(|segment| channels.contains(&segment.number))
            .map(|segment| ChannelLook { name: Some(segment.name.clone()), ..ChannelLook::default() })
            .collect();
        let mut source = Self { info, header: Header::default(), stored, form, planes, channels };
        let frameless = u64::from(top + 1) - source.planes.len() as u64;
        notes.push(note_on_segments(form, &kept));
        if frameless > 0 {
            notes.push(Note::new(format!("{} without a frame hold 0.", counted(frameless, "slice"))));
        }
        if let Some(value) = header.number(tags::PIXEL_PADDING_VALUE).filter(|value| *value != 0.0) {
            notes.push(Note::warning(format!(
                "Label {value} is the background (PixelPaddingValue), and kept as a label."
            )));
        }
        notes.extend(placement.notes);
        placement::set_matrix(placement.matrix, &mut source.info, &mut notes);
        source.info.notes = notes;
        header.forget_values();
        source.header = header;
        source.keep(&kept);
        if form == Form::Binary && !options.is_looked_at {
            source.check_apart(&all)?;
        }
        Ok(source)
    }

    /// Leaves out the frames of other segments.
    fn keep(&mut self, kept: &[Segment]) {
        if self.form == Form::LabelMap {
            return;
        }
        let is_kept = |layer: &Layer| kept.iter().any(|segment| segment.number == layer.segment);
        self.planes.values_mut().for_each(|layers| layers.retain(is_kept));
    }

    /// Checks that no voxel has two segments.
    fn check_apart(&self, all: &[Segment]) -> Result<()> {
        let Stored::Bits(bits) = &self.stored else { return Ok(()) };
        for layers in self.planes.values().filter(|layers| layers.len() > 1) {
            let mut before: Vec<u8> = Vec::new();
            for (i, layer) in layers.iter().enumerate() {
                let frame = bits.read(&self.header, layer.frame)?;
                if before.iter().zip(&frame).any(|(a, b)| a & b != 0) {
                    return Err(self.overlap(&layers[..=i], all));
                }
                match before.is_empty() {
                    true => before = frame,
                    false => before.iter_mut().zip(&frame).for_each(|(a, b)| *a |= b),
                }
            }
        }
        Ok(())
    }

    fn overlap(&self, layers: &[Layer], all: &[Segment]) -> ImportError {
        let named =
            |number: u32| all.iter().find(|segment| segment.number == number).map(described).unwrap_or_default();
        let last = layers.last().map_or(0, |layer| layer.segment);
        let before = layers.iter().take(MOST_NAMED).filter(|layer| layer.segment != last);
        let before: Vec<String> = before.map(|layer| named(layer.segment)).collect();
        let frame = layers.last().map_or(0, |layer| layer.frame) + 1;
        let problem = format!(
            "segment {} overlaps others ({}), in frame {frame}: a voxel has one label; choose a segment by `variable` \
             (its number or name), each to a volume of its own",
            named(last),
            before.join(", ")
        );
        ImportError::options(&self.header.path, problem)
    }

    /// Adds a frame to a plane.
    fn add(&self, layer: Layer, region: VoxelBox, plane: &mut [u8]) -> Result<()> {
        let voxel_type = self.info.voxel_type;
        match &self.stored {
            Stored::Bits(bits) => {
                let frame = bits.read(&self.header, layer.frame)?;
                with_voxel_type!(voxel_type, T => {
                    let (voxels, _) = plane.as_chunks_mut::<{ size_of::<T>() }>();
                    let label = (layer.segment as T).to_le_bytes();
                    bits.each_set(&frame, region, |at| voxels[at] = label);
                });
            }
            Stored::Frames(frames) => {
                let slope = if let Form::Fractional { whole } = self.form { whole.recip() } else { 1.0 };
                let samples = frames.read(&self.header, layer.frame)?;
                let meaning = Meaning { slope, ..Meaning::PLAIN };
                samples.deliver(&frames.format, &meaning, voxel_type, region, plane);
                samples.confirm()?;
            }
        }
        Ok(())
    }
}

fn form_of(header: &Header) -> Result<Form> {
    let written = header.text(tags::SEGMENTATION_TYPE).unwrap_or_default();
    match written.as_str() {
        "BINARY" => Ok(Form::Binary),
        "LABELMAP" => Ok(Form::LabelMap),
        "FRACTIONAL" => {
            let whole = header.number(tags::MAXIMUM_FRACTIONAL_VALUE).filter(|whole| *whole > 0.0);
            let problem = "MaximumFractionalValue is missing or not above 0: its fractions are parts of it; write the \
                           file again";
            let whole = whole.ok_or_else(|| ImportError::invalid(&header.path, problem))?;
            Ok(Form::Fractional { whole })
        }
        other => {
            let problem =
                format!("SegmentationType is '{other}', expected BINARY, FRACTIONAL or LABELMAP; write the file again");
            Err(ImportError::invalid(&header.path, problem))
        }
    }
}

/// The segments of a file, by number.
fn segments_of(header: &Header) -> Result<Vec<Segment>> {
    let numbers = header.listed(tags::SEGMENT_SEQUENCE, tags::SEGMENT_NUMBER);
    let names = header.listed(tags::SEGMENT_SEQUENCE, tags::SEGMENT_LABEL);
    let mut segments = Vec::new();
    for (number, name) in numbers.iter().zip(names) {
        let text = number.clone().unwrap_or_default();
        let number = text.parse::<f64>().ok().filter(|n| n.fract() == 0.0 && (0.0..=MOST_SEGMENTS).contains(n));
        let Some(number) = number.map(|n| n as u32) else {
            let problem =
                format!("SegmentNumber is '{text}', expected a whole number up to 65535; write the file again");
            return Err(ImportError::invalid(&header.path, problem));
        };
        if segments.iter().any(|other: &Segment| other.number == number) {
            let problem = format!("has two segments of number {number}; write the file again");
            return Err(ImportError::invalid(&header.path, problem));
        }
        segments.push(Segment { number, name: name.filter(|name| name.is_ascii()).unwrap_or_default() });
    }
    segments.sort_by_key(|segment| segment.number);
    Ok(segments)
}

/// The segments kept: all, or one by its number or name.
fn choose(header: &Header, all: &[Segment], name: Option<&str>, form: Form) -> Result<Vec<Segment>> {
    let Some(name) = name else {
        return Ok(all.to_vec());
    };
    if form == Form::LabelMap {
        let problem = format!("`variable` '{name}': the segments of a label map are one volume; leave it out");
        return Err(ImportError::options(&header.path, problem));
    }
    let is_named = |segment: &&Segment| segment.number.to_string() == name || segment.name == name;
    let found: Vec<Segment> = all.iter().filter(is_named).cloned().collect();
    if found.len() == 1 {
        return Ok(found);
    }
    let list: Vec<String> = all.iter().take(MOST_NAMED).map(described).collect();
    let problem = format!(
        "`variable` '{name}': {} have this number or name; the file's are {}",
        counted(found.len() as u64, "segment"),
        list.join(", ")
    );
    Err(ImportError::options(&header.path, problem))
}

fn described(segment: &Segment) -> String {
    let Segment { number, name } = segment;
    if name.is_empty() { number.to_string() } else { format!("{number} \"{name}\"") }
}

/// The segment of each frame.
fn layers_of(header: &Header, count: usize, form: Form, all: &[Segment]) -> Result<Vec<Layer>> {
    let refuse = |frame: usize, problem: String| {
        ImportError::invalid(&header.path, format!("frame {}: {problem}; write the file again", frame + 1))
    };
    (0..count)
        .map(|frame| {
            if form == Form::LabelMap {
                return Ok(Layer { frame, segment: 0 });
            }
            let number = header.numbers(frame, tags::REFERENCED_SEGMENT_NUMBER).and_then(|n| n.first().copied());
            let number = number.ok_or_else(|| refuse(frame, "it has no ReferencedSegmentNumber".into()))?;
            let segment = all.iter().find(|segment| f64::from(segment.number) == number && segment.number > 0);
            let problem = || format!("it is of segment {number}, which SegmentSequence does not list");
            segment.map(|segment| Layer { frame, segment: segment.number }).ok_or_else(|| refuse(frame, problem()))
        })
        .collect()
}

/// Places the frames: those of each plane along z.
fn planes_of(
    header: &Header,
    layers: Vec<Layer>,
    options: &OpenOptions,
) -> Result<(BTreeMap<u32, Vec<Layer>>, Placement)> {
    let places = layers.iter().map(|layer| find_slice(header, None, [0, layer.frame], options));
    let mut slices: Vec<Slice> = places.collect::<Result<_>>()?;
    let paths = std::slice::from_ref(&header.path);
    let names = Names { paths, by_frame: true };
    // Frames without a voxel of their segment are left out by writers: the distance of slices must be written.
    let spacing_mm = header.numbers(0, tags::SPACING_BETWEEN_SLICES).map(|n| n[0]).filter(|mm| *mm > 0.0);
    let rules = match spacing_mm {
        Some(mm) => Rules { sparse_mm: Some(mm), ..Rules::of(options) },
        None => Rules::of(options),
    };
    let placement = stack::arrange(&mut slices, &names, rules)?;
    let mut planes: BTreeMap<u32, Vec<Layer>> = BTreeMap::new();
    for (slice, level) in slices.iter().zip(&placement.levels) {
        let layer = layers[slice.frame];
        let plane = planes.entry(*level).or_default();
        if plane.iter().any(|other| other.segment == layer.segment) {
            let what = "shows the same segment at the same position as another frame: segmentations of several times";
            return Err(ImportError::unsupported_but(
                &header.path,
                format!("frame {}, which {what}", slice.frame + 1),
                "write a file for each time",
            ));
        }
        plane.push(layer);
    }
    Ok((planes, placement))
}

fn voxel_type_of(form: Form, kept: &[Segment], stored: &Stored, options: &OpenOptions) -> VoxelType {
    let greatest = match (form, stored) {
        (Form::Fractional { .. }, _) => return VoxelType::F32,
        (Form::LabelMap, Stored::Frames(Frames { format: PixelFormat { width, .. }, .. })) => {
            (1u64 << (8 * width).min(32)) as f64 - 1.0
        }
        _ => kept.iter().map(|segment| f64::from(segment.number)).fold(0.0, f64::max),
    };
    let theirs =
        options.adopted().map(|held| held.voxel_type).filter(|theirs| !theirs.is_float() && theirs.holds(greatest));
    theirs.unwrap_or_else(|| smallest_type(0.0, greatest))
}

fn note_on_segments(form: Form, kept: &[Segment]) -> Note {
    let mut list: Vec<String> = kept.iter().take(MOST_NAMED).map(described).collect();
    if kept.len() > MOST_NAMED {
        list.push(format!("and {} more", kept.len() - MOST_NAMED));
    }
    let list = list.join(", ");
    Note::new(match form {
        Form::Fractional { whole } => {
            format!("Fractions of segments, from 0 to 1 (stored up to {whole}), a channel for each: {list}.")
        }
        _ => format!("Voxels are labels, the numbers of segments, which the store does not name: {list}."),
    })
}

impl Source for Segmentation {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn access(&self) -> Access {
        Access::Planes
    }

    fn reader_bytes(&self) -> u64 {
        match &self.stored {
            Stored::Bits(bits) => bits.reader_bytes(),
            Stored::Frames(frames) => frames.reader_bytes(),
        }
    }

    fn held_bytes(&self) -> u64 {
        let frames = match &self.stored {
            Stored::Bits(_) => 0,
            Stored::Frames(frames) => frames.held_bytes(),
        };
        let layers: usize = self.planes.values().map(|layers| size_of_val(&layers[..]) + 64).sum();
        (frames + layers + self.header.held_bytes() + self.info.identity.len()) as u64
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        out.fill(0);
        let plane_bytes = out.len() / region.extent().z as usize;
        let wanted = self.channels.get(channel as usize);
        for (z, plane) in (region.min.z..).zip(out.chunks_exact_mut(plane_bytes)) {
            for layer in self.planes.get(&z).into_iter().flatten() {
                if wanted.is_none_or(|segment| *segment == layer.segment) {
                    self.add(*layer, region, plane)?;
                }
            }
        }
        Ok(())
    }
}
