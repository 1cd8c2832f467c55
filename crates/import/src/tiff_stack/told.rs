//! Reader of a TIFF file's description, in all forms, and the tags beside it.
//!
//! OME-XML, which may have many megabytes, is read as a stream; other forms are read whole, up to a limit.

use super::description::{Description, nearest};
use super::gdal::{self, Told};
use super::ome;
use super::page::{OpenTiff, PageFormat, said};
use super::refusal::is_damage;
use super::tag_scale::ScaleTags;
use super::xml::Failure;
use super::{hyperstack, imagej, scifio, shaped, stk};
use crate::error::{ImportError, Result};
use crate::note::Note;
use brickyard_volume::ChannelLook;
use std::io::{BufReader, Read};
use tiff::TiffError;
use tiff::decoder::ifd::Value;
use tiff::tags::{ByteOrder, Tag, Type};

/// Most bytes of OME-XML; large plates have tens of megabytes.
pub(super) const LONGEST_DESCRIPTION: u64 = 128 << 20;
/// Most bytes of look-up tables.
const LONGEST_LOOKS: u64 = 16 << 20;
/// GDAL's description of samples.
const GDAL_METADATA: Tag = Tag::Unknown(42112);
/// Most characters of a number.
const LONGEST_NUMBER: usize = 64;
/// Tags of programs with page orders of their own.
const OTHERS: [(u16, &str); 4] = [
    (34362, "Olympus FluoView (tag 34362)"),
    (34412, "Zeiss LSM (tag 34412)"),
    (33471, "Olympus SIS (tag 33471)"),
    (33560, "Olympus SIS (tag 33560)"),
];
/// XML elements of programs that assign channels or planes to pages.
const OTHER_XML: [(&str, &str); 3] = [
    ("<PerkinElmer-QPI-ImageDescription", "PerkinElmer QPI (its XML)"),
    ("<indica", "Indica Labs (its XML)"),
    ("<scn", "Leica SCN (its XML)"),
];
/// Bytes of a description that identify its form.
const START_BYTES: u64 = 256;

impl OpenTiff {
    /// Reads the file's description from the current page, of this format: the order of pages, the calibration of values, and
    /// the size of pixels.
    ///
    /// # Errors
    /// If the disk cannot read it.
    pub(super) fn description(&mut self, format: &PageFormat) -> Result<Description> {
        let tags = self.scale_tags()?;
        let mut description = self.text_description(format, &tags)?.unwrap_or_default();
        let says_nothing = description.declared.is_none() && description.ome.is_none() && description.problem.is_none();
        if says_nothing {
            if let Some(stack) = self.stk()? {
                description = stack;
            } else if let Some(name) = self.other_description()? {
                description.problem = Some(format!(
                    "has pages in the order of {name}, which is not supported: write it as OME-TIFF (bfconvert), or \
                     pass `axes` (with `channels` and `times`) to order its pages"
                ));
            }
        }
        tags.describe(&mut description);
        let nodata = self.gdal_number()?;
        description.nodata_is_nan = nodata.is_some_and(f64::is_nan);
        description.nodata = nodata.filter(|value| !value.is_nan()).map(|value| nearest(value, format.element));
        let gdal = self.gdal_values(format.samples)?;
        match (&description.calibration, &gdal.calibration) {
            (Some(_), Some(_)) => {
                let warning = "GDAL's scale of values is not applied, beside ImageJ's calibration of them.";
                description.notes.push(Note::warning(warning));
            }
            (Some(_), None) => {}
            (None, _) => {
                description.calibration = gdal.calibration;
                description.value_unit = description.value_unit.or(gdal.unit);
            }
        }
        let looks = self.imagej_looks()?;
        if !looks.is_empty() {
            description.channel_looks = looks;
        }
        // Sizes in tags, and in texts that use them, are of stored pixels; OME's are of shown ones.
        if let Some(spacing) = description.spacing.as_mut().filter(|_| description.ome.is_none()) {
            [spacing.x, spacing.y] = format.turn.meant([spacing.x, spacing.y]);
        }
        if format.is_palette {
            let note = "Pixels are indices into a palette of colours: the indices are read, without the colours.";
            description.notes.push(Note::new(note));
        }
        if format.white_is_zero {
            let note = "Small values are meant to be shown bright (white is zero); the values are kept as they are.";
            description.notes.push(Note::new(note));
        }
        if !format.turn.is_none() {
            let note = "Rows and columns are ordered by the file's Orientation.";
            description.notes.push(Note::new(note));
        }
        Ok(description)
    }

    /// The UUID of a file of an OME set, if it has one.
    ///
    /// # Errors
    /// If the disk cannot read it.
    pub(super) fn ome_uuid(&mut self) -> Result<Option<String>> {
        let length = self.decoder.image_ifd().find_entry(Tag::ImageDescription).map_or(0, |entry| entry.count());
        let text = TagText { end: length.min(LONGEST_DESCRIPTION).min(self.stamp.bytes), tiff: self, at: 0 };
        match ome::uuid(BufReader::new(text)) {
            Ok(uuid) => Ok(uuid),
            Err(Failure::Disk(error)) => Err(ImportError::io(&self.path)(error)),
            Err(Failure::Meaning(_)) => Ok(None),
        }
    }

    /// Parses the description's text; `None` for a plain remark.
    fn text_description(&mut self, format: &PageFormat, tags: &ScaleTags) -> Result<Option<Description>> {
        let entry = self.decoder.image_ifd().find_entry(Tag::ImageDescription);
        let is_text = |kind| matches!(kind, Type::ASCII | Type::BYTE | Type::UNDEFINED);
        let Some(length) = entry.filter(|entry| is_text(entry.field_type())).map(|entry| entry.count()) else {
            return Ok(None);
        };
        let (mut image, mut last) = (self.decoder.image_ifd(), [0]);
        said(&self.path, image.find_tag_bytes(Tag::ImageDescription, &mut last, length.saturating_sub(1)))?;
        let start = self.text(START_BYTES.min(length))?;
        let start = start.trim_start_matches('\u{feff}').trim_start();
        if start.starts_with('<') {
            let text = TagText { tiff: self, at: 0, end: length.min(LONGEST_DESCRIPTION) };
            return match ome::read(BufReader::with_capacity(1 << 16, text)) {
                Ok(description) => Ok(description),
                Err(Failure::Disk(error)) => Err(ImportError::io(&self.path)(error)),
                Err(Failure::Meaning(_)) if length > LONGEST_DESCRIPTION => {
                    Ok(Some(too_long("OME-XML", length, LONGEST_DESCRIPTION)))
                }
                Err(Failure::Meaning(problem)) => {
                    let problem = format!("its OME-XML {problem}; pass `axes` zyx to take the pages as they are");
                    Ok(Some(Description::unreadable(problem)))
                }
            };
        }
        let is_imagej = start.starts_with(hyperstack::START);
        let is_scifio = start.starts_with(scifio::START);
        if !is_imagej && !is_scifio && !start.starts_with('{') && !start.starts_with("shape=") {
            return Ok(None);
        }
        let text = self.text(length.min(shaped::LONGEST))?;
        let text = text.trim_end_matches(['\0', ' ', '\n']);
        if length > shaped::LONGEST && (is_imagej || is_scifio || shaped::is_shaped(text)) {
            return Ok(Some(too_long("a description", length, shaped::LONGEST)));
        }
        Ok(match (is_imagej, is_scifio) {
            (true, _) => Some(hyperstack::read(text, tags.resolution, format.samples)),
            (_, true) => Some(scifio::read(text)),
            _ => shaped::is_shaped(text).then(|| shaped::read(text, format, tags)),
        })
    }

    /// The first bytes of the description.
    fn text(&mut self, length: u64) -> Result<String> {
        let mut bytes = Vec::new();
        let read = TagText { tiff: self, at: 0, end: length }.read_to_end(&mut bytes);
        read.map_err(ImportError::io(&self.path))?;
        Ok(match String::from_utf8(bytes) {
            Ok(text) => text,
            // ImageJ writes Latin-1, whose bytes are the first 256 code points.
            Err(error) => error.as_bytes().iter().map(|&b| b as char).collect(),
        })
    }

    pub(super) fn is_metamorph(&mut self) -> bool {
        self.decoder.image_ifd().find_entry(stk::UIC2).is_some()
    }

    /// The description by MetaMorph's tags; `None` if there are none.
    fn stk(&mut self) -> Result<Option<Description>> {
        if !self.is_metamorph() {
            return Ok(None);
        }
        if self.decoder.byte_order() != ByteOrder::LittleEndian {
            let problem = "has tags of a MetaMorph stack (STK), but in another byte order than MetaMorph's; pass `axes` zyx to take its pages";
            return Ok(Some(Description::unreadable(problem.into())));
        }
        let Some(ifd) = self.decoder.ifd_pointer() else { return Ok(None) };
        let bytes = self.stamp.bytes;
        stk::read(self.decoder.inner(), ifd.0, bytes).map_err(ImportError::io(&self.path))
    }

    /// The program of an unsupported description of several pages' order.
    fn other_description(&mut self) -> Result<Option<&'static str>> {
        if !self.has_more_pages() {
            return Ok(None);
        }
        let tags = self.decoder.image_ifd();
        if let Some((_, name)) = OTHERS.iter().find(|(tag, _)| tags.find_entry(Tag::Unknown(*tag)).is_some()) {
            return Ok(Some(name));
        }
        let length = tags.find_entry(Tag::ImageDescription).map_or(0, |entry| entry.count());
        let start = self.text(START_BYTES.min(length).min(self.stamp.bytes))?;
        if let Some((_, name)) = OTHER_XML.iter().find(|(element, _)| start.contains(element)) {
            return Ok(Some(name));
        }
        let mut tags = self.decoder.image_ifd();
        let mut starts = |tag, expected: &[u8]| {
            let mut start = vec![0; expected.len()];
            let is_long = tags.find_entry(tag).is_some_and(|entry| entry.count() >= expected.len() as u64);
            Ok::<_, ImportError>(
                is_long && said(&self.path, tags.find_tag_bytes(tag, &mut start, 0))?.is_some() && start == expected,
            )
        };
        let is_scanimage = starts(Tag::Software, b"SI.")?
            || starts(Tag::ImageDescription, b"state.")?
            || starts(Tag::ImageDescription, b"scanimage.SI")?;
        Ok(is_scanimage.then_some("ScanImage"))
    }

    /// Stored number of pixels without data, in digits, as written by GDAL.
    pub(super) fn gdal_number(&mut self) -> Result<Option<f64>> {
        let mut bytes = [0; LONGEST_NUMBER];
        let mut tags = self.decoder.image_ifd();
        let entry = tags.find_entry(Tag::GdalNodata).filter(|entry| entry.field_type() == Type::ASCII);
        let length = entry.map_or(0, |entry| entry.count()).min(LONGEST_NUMBER as u64) as usize;
        said(&self.path, tags.find_tag_bytes(Tag::GdalNodata, &mut bytes[..length], 0))?;
        let text = std::str::from_utf8(&bytes[..length]).unwrap_or_default();
        Ok(text.split('\0').next().unwrap_or_default().trim().parse().ok())
    }

    /// GDAL's meaning of the current page's numbers.
    pub(super) fn gdal_values(&mut self, samples: u16) -> Result<Told> {
        let mut tags = self.decoder.image_ifd();
        let entry = tags.find_entry(GDAL_METADATA).filter(|entry| entry.field_type() == Type::ASCII);
        let length = entry.map_or(0, |entry| entry.count());
        if length > gdal::LONGEST {
            return Ok(Told::unread("which are too long to be read, are not applied"));
        }
        if length == 0 {
            return Ok(Told::default());
        }
        let mut bytes = vec![0; length.min(self.stamp.bytes) as usize];
        if said(&self.path, tags.find_tag_bytes(GDAL_METADATA, &mut bytes, 0))?.is_none() {
            return Ok(Told::unread("which cannot be read, are not applied"));
        }
        let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
        Told::read(bytes.get(..end).unwrap_or_default(), samples).map_err(ImportError::io(&self.path))
    }

    /// ImageJ's looks of the channels; empty if the file has none.
    fn imagej_looks(&mut self) -> Result<Vec<ChannelLook>> {
        let counts =
            said(&self.path, self.decoder.find_tag_unsigned_vec::<u64>(imagej::BYTE_COUNTS))?.unwrap_or_default();
        let mut tags = self.decoder.image_ifd();
        let length = tags.find_entry(imagej::METADATA).map_or(0, |entry| entry.count());
        let mut bytes = vec![0; length.min(LONGEST_LOOKS).min(self.stamp.bytes) as usize];
        let read = said(&self.path, tags.find_tag_bytes(imagej::METADATA, &mut bytes, 0))?;
        bytes.truncate(read.unwrap_or(0));
        Ok(imagej::channel_looks(&bytes, &counts))
    }

    pub(super) fn scale_tags(&mut self) -> Result<ScaleTags> {
        let mut ratio = |tag| {
            Ok::<_, ImportError>(match said(&self.path, self.decoder.find_tag(tag))? {
                Some(Value::Rational(n, d)) if d > 0 => Some(n as f64 / d as f64),
                _ => None,
            })
        };
        let resolution = ratio(Tag::XResolution)?.zip(ratio(Tag::YResolution)?).map(|(x, y)| [x, y]);
        let mut numbers = |tag| {
            let value = said(&self.path, self.decoder.find_tag(tag))?;
            Ok::<_, ImportError>(value.and_then(|value| value.into_f64_vec().ok()).unwrap_or_default())
        };
        let model_scale = numbers(Tag::ModelPixelScaleTag)?;
        let model_matrix = numbers(Tag::ModelTransformationTag)?;
        let geo_keys =
            said(&self.path, self.decoder.find_tag_unsigned_vec(Tag::GeoKeyDirectoryTag))?.unwrap_or_default();
        let unit = said(&self.path, self.decoder.find_tag_unsigned(Tag::ResolutionUnit))?;
        Ok(ScaleTags { resolution, unit, model_scale, model_matrix, geo_keys })
    }
}

fn too_long(what: &str, bytes: u64, most: u64) -> Description {
    Description::unreadable(format!(
        "has {what} of {bytes} bytes, and at most {most} are read; pass `axes` zyx to take the pages as they are"
    ))
}

/// The description's bytes, read on request.
struct TagText<'a> {
    tiff: &'a mut OpenTiff,
    at: u64,
    end: u64,
}

impl Read for TagText<'_> {
    fn read(&mut self, out: &mut [u8]) -> std::io::Result<usize> {
        let count = (self.end - self.at).min(out.len() as u64) as usize;
        if count == 0 {
            return Ok(0);
        }
        let read = self.tiff.decoder.image_ifd().find_tag_bytes(Tag::ImageDescription, &mut out[..count], self.at);
        match read {
            Ok(Some(_)) => {
                self.at += count as u64;
                Ok(count)
            }
            Ok(None) => Ok(0),
            Err(TiffError::IoError(error)) if !is_damage(&error) => Err(error),
            Err(_) => Ok(0),
        }
    }
}
