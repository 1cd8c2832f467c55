//! Header of one DICOM file: the few elements needed by a volume, from the data set and from the functional groups of an enhanced multi-frame file,
//! and the start of the pixel data.
//!
//! Other values are skipped, so the cost depends on the header, not on the file's size. Lengths are checked against the file before use.

use super::elements::{Element, Elements, ITEM};
use super::wanted::{DETECTOR, LISTS, MACROS, NEEDED, WANTED};
use crate::dicom_files::first_group_at;
use crate::error::{ImportError, Result};
use crate::mapped::MappedFile;
use crate::stamp::Stamp;
use dicom_core::dictionary::{DataDictionary, DataDictionaryEntry};
use dicom_core::header::DataElementHeader;
use dicom_core::{PrimitiveValue, Tag, VR};
use dicom_dictionary_std::{StandardDataDictionary, tags, uids};
use dicom_transfer_syntax_registry::{TransferSyntaxIndex, TransferSyntaxRegistry};
use flate2::read::DeflateDecoder;
use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Bytes of a deflated data set inflated first in search of its header; if too few, four times as many, up to [`MOST_INFLATED_HEADER`].
const FIRST_INFLATED: u64 = 1 << 20;
const MOST_INFLATED_HEADER: u64 = 64 << 20;

/// UID of the transfer syntax *Explicit VR Big Endian*, retired but still found in files.
pub(super) const EXPLICIT_BIG_ENDIAN: &str = "1.2.840.10008.1.2.2";

/// Longest value kept, also of a private element: Siemens' own header has some 10 kB. Longer ones count as missing.
const LONGEST_VALUE: u32 = 1 << 14;
const LONGEST_PRIVATE: u32 = 1 << 17;
/// Creators of Siemens' private elements.
const CSA_HEADER: &str = "SIEMENS CSA HEADER";
const MR_HEADER: &str = "SIEMENS MR HEADER";
/// Number of slices of a mosaic, among the elements of [`MR_HEADER`].
const MOSAIC_SLICES: Tag = Tag(0x0019, 0x100a);

/// Values by element; those common to the slices of a series are held once.
type Values = BTreeMap<Tag, Arc<PrimitiveValue>>;

/// Header of one DICOM file.
#[derive(Default)]
pub(super) struct Header {
    pub(super) path: PathBuf,
    /// The file's stamp when the header was read.
    stamp: Option<Stamp>,
    /// Start of the data set in the file, and its inflated size if it is deflated.
    body: u64,
    pub(super) inflated_bytes: u64,
    /// UID of the transfer syntax.
    pub(super) syntax: String,
    top: Values,
    shared: Values,
    frames: Vec<Values>,
    /// Items of each sequence of [`LISTS`].
    lists: [Vec<Values>; LISTS.len()],
    /// Whether the file maps stored values by a table (Modality LUT) in place of slope and intercept.
    pub(super) has_value_table: bool,
    /// Whether the file gives real-world values of stored ones, which are for measuring.
    pub(super) has_real_world: bool,
    /// Element with the pixels; `None` in a file without an image.
    pub(super) pixels: Option<PixelElement>,
}

/// The element with the pixels.
#[derive(Clone, Copy, Debug)]
pub(super) struct PixelElement {
    pub(super) tag: Tag,
    pub(super) vr: VR,
    /// Length of the value in bytes; `None` if the pixel data are encapsulated.
    pub(super) length: Option<u64>,
    /// First byte of the value: in the file, or in the inflated data set if the file is deflated.
    pub(super) offset: u64,
}

impl Header {
    /// Whether the file declares some stored numbers padding.
    pub(super) fn has_padding(&self) -> bool {
        const PADDING: [Tag; 3] =
            [tags::PIXEL_PADDING_VALUE, tags::FLOAT_PIXEL_PADDING_VALUE, tags::DOUBLE_FLOAT_PIXEL_PADDING_VALUE];
        PADDING.into_iter().any(|tag| self.number(tag).is_some())
    }

    /// Reads the header of a file, up to its pixel data.
    pub(super) fn read(path: &Path) -> Result<Self> {
        let file = MappedFile::open(path)?;
        let header = Self::parse(path, &file).map(|header| Self { stamp: file.stamp, ..header });
        // Even damage found counts only if the file is unchanged.
        file.confirm()?;
        header
    }

    fn parse(path: &Path, map: &[u8]) -> Result<Self> {
        let not_dicom = || ImportError::invalid(path, "not a DICOM file: expected the letters DICM at byte 128");
        let (syntax, body) = read_meta(path, map, first_group_at(map).ok_or_else(not_dicom)?)?;
        let mut header = Self { path: path.to_owned(), body: body as u64, syntax, ..Self::default() };
        if header.is_deflated() {
            header.read_deflated(map.get(body..).unwrap_or(&[]))?;
        } else {
            header.read_data_set(map, body)?;
        }
        header.place_by_detector();
        Ok(header)
    }

    /// Takes the place of the only detector for that of the image, if this has none (nuclear medicine).
    fn place_by_detector(&mut self) {
        let list = LISTS.iter().position(|(listed, _)| *listed == tags::DETECTOR_INFORMATION_SEQUENCE);
        if let Some([detector]) = list.map(|i| &self.lists[i][..]) {
            for tag in DETECTOR {
                if let (Some(value), None) = (detector.get(&tag), self.top.get(&tag)) {
                    self.top.insert(tag, value.clone());
                }
            }
        }
    }

    /// Reads the header of a deflated data set, holding no more than it needs; the rest is only counted.
    fn read_deflated(&mut self, deflated: &[u8]) -> Result<()> {
        let path = self.path.clone();
        let mut inflater = DeflateDecoder::new(deflated);
        let mut start = Vec::new();
        let mut most = FIRST_INFLATED;
        loop {
            let more = most - start.len() as u64;
            let read = inflater.by_ref().take(more).read_to_end(&mut start);
            read.map_err(|error| not_inflated(&path, start.len() as u64, &error))?;
            let is_whole = (start.len() as u64) < most;
            self.forget_values();
            (self.has_value_table, self.pixels) = (false, None);
            match self.read_data_set(&start, 0) {
                found if is_whole => break found?,
                Ok(()) if self.pixels.is_some() => break,
                _ if most >= MOST_INFLATED_HEADER => {
                    let problem = format!("expected pixel data within {} MiB inflated, found none", most >> 20);
                    return Err(ImportError::invalid(&path, problem));
                }
                _ => most *= 4,
            }
        }
        let held = start.len() as u64;
        let rest = std::io::copy(&mut inflater, &mut std::io::sink());
        self.inflated_bytes = held + rest.map_err(|error| not_inflated(&path, held, &error))?;
        Ok(())
    }

    /// Checks that the file is unchanged since its header was read. Call it after reading, before trusting the bytes.
    pub(super) fn confirm(&self) -> Result<()> {
        self.stamp.map_or(Ok(()), |stamp| stamp.check(&self.path))
    }

    /// Maps the file, unchanged since its header was read.
    pub(super) fn map(&self) -> Result<MappedFile> {
        let file = MappedFile::open(&self.path);
        // The bytes, or an error, count only if these are the file's of which the header tells.
        self.confirm()?;
        file
    }

    /// Shares the memory of values equal to another header's.
    pub(super) fn share_values(&mut self, other: &Self) {
        for (tag, value) in &mut self.top {
            if let Some(same) = other.top.get(tag).filter(|same| *same == value) {
                *value = same.clone();
            }
        }
    }

    /// Drops all values, which reading pixels does not need.
    pub(super) fn forget_values(&mut self) {
        (self.top, self.shared, self.frames) = (Values::new(), Values::new(), Vec::new());
        self.lists = Default::default();
    }

    /// Bytes held by the header, besides itself, without its values.
    pub(super) fn held_bytes(&self) -> usize {
        self.path.as_os_str().len() + self.syntax.len()
    }

    /// Inflates a deflated data set and returns `length` bytes from byte `first` on. Earlier bytes are not kept in memory.
    pub(super) fn read_inflated(&self, first: u64, length: u64) -> Result<Vec<u8>> {
        let mut file = File::open(&self.path).map_err(ImportError::io(&self.path))?;
        file.seek(SeekFrom::Start(self.body)).map_err(ImportError::io(&self.path))?;
        let mut inflater = DeflateDecoder::new(file);
        let mut bytes = vec![0; length as usize];
        let skipped = std::io::copy(&mut inflater.by_ref().take(first), &mut std::io::sink());
        let read = skipped.and_then(|_| inflater.read_exact(&mut bytes));
        read.map_err(|error| not_inflated(&self.path, first, &error))?;
        Ok(bytes)
    }

    pub(super) fn is_deflated(&self) -> bool {
        self.syntax == uids::DEFLATED_EXPLICIT_VR_LITTLE_ENDIAN
    }

    /// Name and UID of the transfer syntax, for messages.
    pub(super) fn syntax_name(&self) -> String {
        let name = TransferSyntaxRegistry.get(&self.syntax).map_or("unknown", |s| s.name());
        format!("{name} ({})", self.syntax)
    }

    pub(super) fn series(&self) -> String {
        self.text(tags::SERIES_INSTANCE_UID).unwrap_or_else(|| "(none)".into())
    }

    /// Number of frames with a functional group of their own, which gives their position.
    pub(super) fn placed_frames(&self) -> usize {
        self.frames.len()
    }

    /// Returns the numbers of an element: the value for a frame (counted from 0), else for all frames, else for the whole file. `None` if it is
    /// missing or not a list of finite numbers.
    pub(super) fn numbers(&self, frame: usize, tag: Tag) -> Option<Vec<f64>> {
        let numbers = self.value(frame, tag)?.to_multi_float64().ok()?;
        (!numbers.is_empty() && numbers.iter().all(|n| n.is_finite())).then_some(numbers)
    }

    /// Returns half a unit in the last decimal place of each number of an element, or 0 for a number without decimals. Empty if the element is
    /// missing or not text.
    pub(super) fn roundings(&self, frame: usize, tag: Tag) -> Vec<f64> {
        match self.value(frame, tag) {
            Some(value @ (PrimitiveValue::Strs(_) | PrimitiveValue::Str(_))) => {
                value.to_multi_str().iter().map(|text| rounding_of(text)).collect()
            }
            _ => Vec::new(),
        }
    }

    /// Returns an element's value for a frame (counted from 0) as text without padding; `None` if it is missing or empty.
    pub(super) fn written(&self, frame: usize, tag: Tag) -> Option<String> {
        self.value(frame, tag).map(trimmed).filter(|text| !text.is_empty())
    }

    /// An element of a frame (counted from 0), else of all frames, else of the whole file.
    fn value(&self, frame: usize, tag: Tag) -> Option<&PrimitiveValue> {
        let places = [self.frames.get(frame), Some(&self.shared), Some(&self.top)];
        places.into_iter().flatten().find_map(|values| values.get(&tag)).map(|value| &**value)
    }

    /// Returns the first number of an element of the whole file; `None` if it is missing or not a finite number.
    pub(super) fn number(&self, tag: Tag) -> Option<f64> {
        self.top.get(&tag)?.to_float64().ok().filter(|n| n.is_finite())
    }

    pub(super) fn text(&self, tag: Tag) -> Option<String> {
        self.top.get(&tag).map(|value| trimmed(value))
    }

    /// An element's text in each item of a sequence of [`LISTS`]; `None` where it is missing.
    pub(super) fn listed(&self, sequence: Tag, tag: Tag) -> Vec<Option<String>> {
        let list = LISTS.iter().position(|(listed, _)| *listed == sequence).map_or(&[][..], |i| &self.lists[i]);
        list.iter().map(|item| item.get(&tag).map(|value| trimmed(value))).collect()
    }

    /// Collects the needed elements up to the pixel data.
    fn read_data_set(&mut self, bytes: &[u8], start: usize) -> Result<()> {
        // Unknown syntaxes are refused when their pixels are needed; headers are explicit little endian in all but the two oldest.
        let known = [uids::IMPLICIT_VR_LITTLE_ENDIAN, EXPLICIT_BIG_ENDIAN];
        let named = known.into_iter().find(|s| *s == self.syntax).unwrap_or(uids::EXPLICIT_VR_LITTLE_ENDIAN);
        let syntax = written_in(bytes, start, named);
        let path = self.path.clone();
        let mut elements = Elements::new(&path, bytes, start, syntax)?;
        while let Some(element) = elements.next()? {
            match element {
                Element::Sequence(parents, tag) => self.enter(parents, tag),
                Element::Pixels { tag, vr, length } => {
                    self.pixels = Some(PixelElement { tag, vr, length, offset: elements.into_position() });
                    break;
                }
                Element::Value(parents, header) => {
                    let header = as_known(header);
                    let tag = header.tag;
                    if header.vr == VR::SQ {
                        self.enter_unread(parents, tag)?;
                    }
                    let is_short = header.len.0 <= LONGEST_VALUE;
                    let is_listed = |(list, wanted): &(Tag, &[Tag])| parents == [*list] && wanted.contains(&tag);
                    let is_kept = WANTED.contains(&tag) || LISTS.iter().any(is_listed);
                    let is_wanted = is_short && is_kept || self.is_of_mosaic(&header);
                    match self.values_at(parents).filter(|_| is_wanted) {
                        Some(values) => values.insert(tag, Arc::new(elements.read(&header)?)).map_or((), drop),
                        None => elements.skip(&header)?,
                    }
                }
            }
        }
        Ok(())
    }

    /// Whether the file is a localizer (scout, topogram): a picture for planning the series.
    pub(super) fn is_localizer(&self) -> bool {
        self.text(tags::IMAGE_TYPE).is_some_and(|kinds| kinds.split('\\').any(|kind| kind.trim() == "LOCALIZER"))
    }

    /// Whether the file is a mosaic: the slices of a volume side by side in one picture.
    pub(super) fn is_mosaic(&self) -> bool {
        self.text(tags::IMAGE_TYPE).is_some_and(|kinds| kinds.split('\\').any(|kind| kind.trim() == "MOSAIC"))
    }

    /// Whether an element describes the layout of a mosaic. These come after the one that declares a mosaic.
    fn is_of_mosaic(&self, header: &DataElementHeader) -> bool {
        let Tag(group, element) = header.tag;
        let is_one = match group {
            0x0019 => element == MOSAIC_SLICES.1 || element == 0x0010,
            0x0029 => (0x0010..=0x00ff).contains(&element) || (element >= 0x1000 && element & 0xff == 0x10),
            _ => false,
        };
        is_one && header.len.0 <= LONGEST_PRIVATE && self.is_mosaic()
    }

    /// Siemens' own header of the image.
    pub(super) fn csa(&self) -> Option<&[u8]> {
        let block = (0x10..=0xff).find(|block| self.is_creator(Tag(0x0029, *block), CSA_HEADER))?;
        match &**self.top.get(&Tag(0x0029, (block << 8) | 0x10))? {
            PrimitiveValue::U8(bytes) => Some(&bytes[..]),
            _ => None,
        }
    }

    /// Whether an element reserves a block of private elements for this creator.
    fn is_creator(&self, tag: Tag, creator: &str) -> bool {
        let found = match self.top.get(&tag).map(|value| &**value) {
            // In files without representations.
            Some(PrimitiveValue::U8(bytes)) => String::from_utf8_lossy(bytes),
            Some(value) => value.to_str(),
            None => return false,
        };
        found.trim_matches(['\0', ' ']) == creator
    }

    /// Number of slices of a mosaic, stored beside Siemens' own header.
    pub(super) fn private_mosaic_slices(&self) -> Option<u32> {
        let value =
            self.top.get(&MOSAIC_SLICES).filter(|_| self.is_creator(Tag(MOSAIC_SLICES.0, 0x0010), MR_HEADER))?;
        match &**value {
            PrimitiveValue::U8(bytes) => bytes.first_chunk().map(|bytes| u16::from_le_bytes(*bytes).into()),
            value => value.to_int().ok(),
        }
    }

    /// Records the start of a sequence or an item.
    fn enter(&mut self, parents: &[Tag], tag: Tag) {
        self.has_real_world |= tag == tags::REAL_WORLD_VALUE_MAPPING_SEQUENCE;
        match (parents, tag) {
            ([], tags::MODALITY_LUT_SEQUENCE) => self.has_value_table = true,
            ([tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE], ITEM) => self.frames.push(Values::new()),
            ([list], ITEM) => {
                if let Some(i) = LISTS.iter().position(|(listed, _)| listed == list) {
                    self.lists[i].push(Values::new());
                }
            }
            _ => {}
        }
    }

    /// Records a sequence of unknown representation, whose items are not read; an error if it would describe frames.
    fn enter_unread(&mut self, parents: &[Tag], tag: Tag) -> Result<()> {
        const GROUPS: [Tag; 2] = [tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE, tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE];
        let is_needed = match parents {
            [] => GROUPS.contains(&tag) || tag == tags::SEGMENT_SEQUENCE,
            [group] => GROUPS.contains(group) && NEEDED.contains(&tag),
            _ => false,
        };
        if is_needed {
            let feature = format!("a description of frames in a sequence of unknown representation (UN), {tag},");
            return Err(ImportError::unsupported_but(&self.path, feature, "write it again, as dcmconv +uc does"));
        }
        self.enter(parents, tag);
        Ok(())
    }

    /// Destination of values nested in these sequences; `None` if they are not needed.
    fn values_at(&mut self, parents: &[Tag]) -> Option<&mut Values> {
        match parents {
            [] => Some(&mut self.top),
            [tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE, inner] if MACROS.contains(inner) => Some(&mut self.shared),
            [tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE, inner] if MACROS.contains(inner) => self.frames.last_mut(),
            // The only element wanted from deeper within.
            [group, tags::MR_DIFFUSION_SEQUENCE, tags::DIFFUSION_GRADIENT_DIRECTION_SEQUENCE] => match *group {
                tags::SHARED_FUNCTIONAL_GROUPS_SEQUENCE => Some(&mut self.shared),
                tags::PER_FRAME_FUNCTIONAL_GROUPS_SEQUENCE => self.frames.last_mut(),
                _ => None,
            },
            [list] => {
                let i = LISTS.iter().position(|(listed, _)| listed == list)?;
                self.lists[i].last_mut()
            }
            _ => None,
        }
    }
}

/// Replaces an unknown representation (UN), as written by systems passing on foreign elements, with the standard's.
fn as_known(header: DataElementHeader) -> DataElementHeader {
    let entry = StandardDataDictionary.by_tag(header.tag).filter(|_| header.vr == VR::UN);
    DataElementHeader { vr: entry.map_or(header.vr, |entry| entry.vr().relaxed()), ..header }
}

/// Text without its padding.
fn trimmed(value: &PrimitiveValue) -> String {
    value.to_str().trim_matches(['\0', ' ']).to_owned()
}

/// Half a unit in the last decimal place of a number as written; 0 without decimals.
fn rounding_of(text: &str) -> f64 {
    let lower = text.trim_matches(['\0', ' ']).to_ascii_lowercase();
    let (mantissa, exponent) = lower.split_once('e').unwrap_or((&lower, "0"));
    let decimals = mantissa.split_once('.').map_or(0, |(_, decimals)| decimals.len() as i32);
    let places = decimals - exponent.trim_start_matches('+').parse::<i32>().unwrap_or(0).clamp(-99, 99);
    if places > 0 { 0.5 * 0.1f64.powi(places) } else { 0.0 }
}

/// The actual syntax of a data set's header: some writers name explicit VR and omit it, or the reverse. Only explicit VR has two letters in an
/// element's fifth and sixth byte, where a length would be in the thousands.
fn written_in<'a>(bytes: &[u8], start: usize, named: &'a str) -> &'a str {
    let Some(&[a, b]) = bytes.get(start + 4..start + 6) else { return named };
    match (named, VR::from_binary([a, b]).is_some()) {
        (uids::EXPLICIT_VR_LITTLE_ENDIAN, false) if !(a.is_ascii_uppercase() && b.is_ascii_uppercase()) => {
            uids::IMPLICIT_VR_LITTLE_ENDIAN
        }
        (uids::IMPLICIT_VR_LITTLE_ENDIAN, true) => uids::EXPLICIT_VR_LITTLE_ENDIAN,
        _ => named,
    }
}

/// The transfer syntax named by the file's first group, and the start of the data set. Without that group, the first element decides.
fn read_meta(path: &Path, bytes: &[u8], at: usize) -> Result<(String, usize)> {
    if bytes.get(at..at + 2) != Some(&[2, 0]) && at == 0 {
        return Ok((written_in(bytes, at, uids::IMPLICIT_VR_LITTLE_ENDIAN).to_owned(), at));
    }
    let mut elements = Elements::new(path, bytes, at, uids::EXPLICIT_VR_LITTLE_ENDIAN)?;
    let mut syntax = None;
    while bytes.get(elements.position..elements.position + 2) == Some(&[2, 0]) {
        match elements.next()? {
            Some(Element::Value(_, header)) if header.tag == tags::TRANSFER_SYNTAX_UID => {
                syntax = Some(trimmed(&elements.read(&header)?));
            }
            Some(Element::Value(_, header)) => elements.skip(&header)?,
            _ => break,
        }
    }
    let missing =
        || ImportError::invalid(path, "its first group has no TransferSyntaxUID (0002,0010); write the file again");
    Ok((syntax.ok_or_else(missing)?, elements.position))
}

fn not_inflated(path: &Path, before: u64, error: &std::io::Error) -> ImportError {
    let problem = format!("deflated data cut short or damaged after {before} bytes: {error}; fetch the file again");
    ImportError::invalid(path, problem)
}
