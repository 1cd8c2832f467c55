//! Images of VTK: its XML format (`.vti`), legacy files of structured points (`.vtk`), and ParaView's collections of them
//! over time (`.pvd`).
//!
//! A header is read tag by tag or keyword by keyword. Arrays that lie in the file as they are are mapped (see `raw`); those
//! in words, in base64 or compressed are decoded into scratch space first (see `body`), which costs one pass over them.

mod arrays;
mod grid;
mod legacy;
mod pieces;
mod pvd;
mod stream;
mod tags;
#[cfg(test)]
mod tests;
mod xml;

use crate::axes::{Axis, AxisOrder, Sizes};
use crate::body::{self, Body};
use crate::data_files::check_file;
use crate::direct::is_plain;
use crate::element::{Decode, Element, Endian};
use crate::error::{ImportError, Result};
use crate::files::first_bytes;
use crate::format::Format;
use crate::losses::Losses;
use crate::mapped::MappedFile;
use crate::note::Note;
use crate::options::OpenOptions;
use crate::raw::{ArrayLayout, RawSource, identity};
use crate::series::{Series, StepFile};
use crate::source::{Access, Source, SourceInfo};
use crate::stamp::Stamp;
use crate::step_time::{StepTime, TimeSpan};
use arrays::{Array, Place};
use brickyard_volume::{Extent, VoxelBox};
use grid::{Grid, Part};
use pieces::Pieces;
use std::cell::Cell;
use std::io::Read;
use std::path::Path;

/// Bytes in which the first tag of an XML file begins.
const LOOKED_AT: usize = 1024;

/// The format of a file of VTK, by its first bytes: an image or a collection. Other data sets count as images, and are
/// refused by their names when they are opened.
pub(crate) fn format_of(path: &Path) -> Result<Option<Format>> {
    let start = first_bytes(path, LOOKED_AT)?;
    if start.starts_with(legacy::MAGIC) {
        return Ok(Some(Format::Vtk));
    }
    let text = start.strip_prefix(b"\xef\xbb\xbf").unwrap_or(&start).trim_ascii_start();
    let at = if text.starts_with(b"<") { text.windows(8).position(|word| word == b"<VTKFile") } else { None };
    let tag = at.and_then(|at| text.get(at..)).map(|tag| tag.split(|byte| *byte == b'>').next().unwrap_or_default());
    let is_collection = |tag: &[u8]| [&b"\"Collection\""[..], b"'Collection'"].iter().any(|word| contains(tag, word));
    Ok(tag.map(|tag| if is_collection(tag) { Format::Pvd } else { Format::Vtk }))
}

fn contains(text: &[u8], word: &[u8]) -> bool {
    text.windows(word.len()).any(|part| part == word)
}

/// Opens a `.vti` or `.vtk` file.
pub(crate) fn open(path: &Path, options: &OpenOptions) -> Result<Box<dyn Source>> {
    Ok(Box::new(Found::read(path, options)?.open(options)?))
}

/// Examines a file without keeping it open. Arrays are not decoded if their headers confirm their sizes, and no value has
/// to be checked.
pub(crate) fn check(path: &Path, options: &OpenOptions) -> Result<StepFile> {
    let found = Found::read(path, options)?;
    match found.unopened(options)? {
        Some(file) => Ok(file),
        None => Ok(StepFile::of(&found.open(options)?)),
    }
}

/// Opens the files of a collection as time steps, at its times.
pub(crate) fn open_collection(path: &Path, options: &OpenOptions) -> Result<Box<dyn Source>> {
    let steps = pvd::read(path)?;
    if options.is_step && steps.len() > 1 {
        let problem = format!("a collection of {} time steps as one of several: pack it by itself", steps.len());
        return Err(ImportError::options(path, problem));
    }
    let paths: Vec<_> = steps.iter().map(|step| step.path.clone()).collect();
    for file in &paths {
        check_file(path, file)?;
        if format_of(file)? == Some(Format::Pvd) {
            return Err(ImportError::unsupported_but(file, "a collection within a collection", "name its files"));
        }
    }
    // A file may stand for several steps, so they are counted.
    let place = Cell::new(0);
    let check = |path: &Path| {
        let mut file = check(path, options)?;
        let time = steps.get(place.replace(place.get() + 1)).and_then(|step| step.time);
        file.step_time = StepTime { stamp: time.and_then(|time| TimeSpan::of(time, "")), increment: None };
        Ok(file)
    };
    let again = OpenOptions { is_looked_at: true, ..options.clone() };
    let open = move |path: &Path| open(path, &again);
    let series = Series::new(&paths, options, check, Box::new(open))?;
    Ok(Box::new(series))
}

/// A file's array, described but not opened.
struct Found<'a> {
    path: &'a Path,
    stamp: Stamp,
    info: SourceInfo,
    pieces: Vec<Piece>,
    step_time: StepTime,
}

/// A piece of the array.
struct Piece {
    region: VoxelBox,
    layout: ArrayLayout,
    place: Place,
}

/// A chosen array: the same in every piece.
struct Chosen {
    array: Array,
    notes: Vec<Note>,
    grid: Grid,
    parts: Vec<(Part, Place)>,
    endian: Endian,
    time: Option<Array>,
}

impl<'a> Found<'a> {
    fn read(path: &'a Path, options: &OpenOptions) -> Result<Self> {
        let stamp = Stamp::of(path)?;
        let start = first_bytes(path, legacy::MAGIC.len())?;
        let variable = options.variable.as_deref();
        let is_legacy = start.starts_with(legacy::MAGIC);
        let chosen = if is_legacy { of_legacy(path, variable)? } else { of_xml(path, variable)? };
        let element = element_of(&chosen.array, path)?;
        let counts = grid::sizes_of(chosen.grid.points.counts(path)?, chosen.array.of);
        let endian = chosen.endian;
        let layout_of = |extent: Extent, place: &Place| ArrayLayout {
            sizes: Sizes { extent, channels: chosen.array.components, times: 1 },
            // Components lie side by side.
            axes: AxisOrder::of(&[Axis::Z, Axis::Y, Axis::X, Axis::C]),
            decode: Decode { element, endian: if is_words(place) { Endian::Little } else { endian }, scale: None },
            offset: 0,
        };
        let whole = layout_of(Extent::from_array(counts), &Place::Plain(0));
        whole.body_bytes().map_err(|problem| ImportError::invalid(path, problem))?;
        let mut info = SourceInfo { channel_looks: chosen.array.looks(), notes: chosen.notes, ..whole.info() };
        info.identity = identity(&format!("vtk {:?} {}", chosen.array.of, chosen.array.name), &[path])?;
        chosen.grid.place(chosen.array.of, path, &mut info)?;
        let mut pieces = Vec::with_capacity(chosen.parts.len());
        for (part, place) in chosen.parts {
            let layout = layout_of(part.extent, &place);
            pieces.push(Piece { region: pieces::box_of(part), place: located(place, &layout, path)?, layout });
        }
        if !pieces::cover(info.extent, pieces.iter().map(|piece| piece.region)) {
            let problem =
                "its pieces leave points of the whole extent out, or are too scattered; write it in one piece";
            return Err(ImportError::invalid(path, problem));
        }
        let stamp_of = |array: &Array| time_of(array, endian, path).and_then(|time| TimeSpan::of(time, ""));
        let step_time = StepTime { stamp: chosen.time.as_ref().and_then(stamp_of), increment: None };
        Ok(Self { path, stamp, info, pieces, step_time })
    }

    /// Opens each piece, decoded if need be.
    fn open(self, options: &OpenOptions) -> Result<Pieces> {
        let Self { path, stamp, mut info, pieces, step_time } = self;
        let mut opened: Vec<(VoxelBox, RawSource)> = Vec::with_capacity(pieces.len());
        let is_one = pieces.len() == 1;
        for piece in pieces {
            let source = piece.open(path, options)?;
            let own = source.info();
            if let Some((_, first)) = opened.first().filter(|(_, first)| first.info().voxel_type != own.voxel_type) {
                let (one, two) = (first.info().voxel_type, own.voxel_type);
                let problem = format!("labels of one piece need {one}, those of another {two}: write it in one piece");
                return Err(ImportError::options(path, problem));
            }
            info.voxel_type = own.voxel_type;
            for note in &own.notes {
                if is_one || !info.notes.contains(note) {
                    info.notes.push(note.clone());
                }
            }
            opened.push((piece.region, source));
        }
        stamp.check(path)?;
        Ok(Pieces { info, pieces: opened, step_time })
    }

    /// The description of a file whose arrays need not be decoded to be sure of it.
    fn unopened(&self, options: &OpenOptions) -> Result<Option<StepFile>> {
        let is_sure = |piece: &Piece| {
            let decode = piece.layout.decode;
            let is_lossless = Losses::may_occur(self.path, decode, None, options).is_none();
            is_lossless && is_plain(decode, options) && matches!(piece.place, Place::Headed { .. })
        };
        if !self.pieces.iter().all(is_sure) {
            return Ok(None);
        }
        let (mut info, mut scratch_bytes) = (self.info.clone(), 0);
        for piece in &self.pieces {
            let bytes = piece.layout.body_bytes().map_err(|problem| ImportError::invalid(self.path, problem))?;
            let note = body::unpacked_note(bytes);
            if !info.notes.contains(&note) {
                info.notes.push(note);
            }
            scratch_bytes += bytes;
        }
        self.stamp.check(self.path)?;
        let (access, step_time) = (Access::Box, self.step_time.clone());
        Ok(Some(StepFile { info, access, reader_bytes: 0, held_bytes: 0, scratch_bytes, step_time }))
    }
}

impl Piece {
    fn open(&self, path: &Path, options: &OpenOptions) -> Result<RawSource> {
        let (layout, info) = (self.layout.clone(), self.layout.info());
        let bytes = layout.body_bytes().map_err(|problem| ImportError::invalid(path, problem))?;
        let stream = match self.place {
            Place::Plain(offset) => {
                // Other arrays follow this one, so nothing is said of bytes after it.
                return RawSource::new(MappedFile::open(path)?, ArrayLayout { offset, ..layout }, info)?
                    .with_losses(None, options);
            }
            place => stream_of(place, layout.decode.element, bytes, path)?,
        };
        let coded_bytes = std::fs::metadata(path).map_err(ImportError::io(path))?.len();
        Body::Coded { path: path.to_owned(), coded_bytes, stream }.source(layout, info, options)
    }
}

fn is_words(place: &Place) -> bool {
    matches!(place, Place::Words { .. })
}

fn element_of(array: &Array, path: &Path) -> Result<Element> {
    array.element.ok_or_else(|| {
        let feature = format!("the type {} of the array {}", array.kind, array.name);
        let advice = "integers of 8 to 64 bits and floats of 32 and 64 are read; write it as one of these, or choose \
                      another array with `variable`";
        ImportError::unsupported_but(path, feature, advice)
    })
}

/// Decoded bytes of an array that does not lie in the file as it is.
fn stream_of(place: Place, element: Element, bytes: u64, path: &Path) -> Result<Box<dyn Read>> {
    let stream = match place {
        Place::Headed { at, coding } => stream::headed(path, at, coding, bytes),
        Place::Words { at, style } => stream::words(path, at, element, bytes / element.bytes() as u64, style),
        Place::Plain(at) => stream::plain(path, at, bytes),
    };
    stream.map_err(|error| coded_error(error, path))
}

fn coded_error(error: std::io::Error, path: &Path) -> ImportError {
    use std::io::ErrorKind::{InvalidData, UnexpectedEof};
    match error.kind() {
        UnexpectedEof => ImportError::invalid(path, "cut short: ends before the array; fetch the file again"),
        InvalidData => ImportError::invalid(path, format!("{error}; write the file again")),
        _ => ImportError::io(path)(error),
    }
}

/// Confirms a header's sizes, and the place of an array behind a header but otherwise as it is.
fn located(place: Place, layout: &ArrayLayout, path: &Path) -> Result<Place> {
    let bytes = layout.body_bytes().map_err(|problem| ImportError::invalid(path, problem))?;
    let (element, found) = (layout.decode.element, Stamp::of(path)?.bytes);
    let place = match place {
        Place::Headed { at, coding } => {
            stream_of(place, element, bytes, path)?;
            match (coding.is_base64, coding.compressor) {
                (false, None) => Place::Plain(at.saturating_add(coding.size_bytes as u64)),
                _ => place,
            }
        }
        place => place,
    };
    match place {
        Place::Plain(at) if at.saturating_add(bytes) > found => {
            let (expected, missing) = (at.saturating_add(bytes), at.saturating_add(bytes) - found);
            let problem = format!(
                "cut short: its array of {bytes} bytes starts at byte {at}: expected {expected} bytes, found {found} \
                 ({missing} missing)"
            );
            Err(ImportError::invalid(path, problem))
        }
        place => Ok(place),
    }
}

fn of_legacy(path: &Path, variable: Option<&str>) -> Result<Chosen> {
    let legacy::Legacy { grid, arrays, time } = legacy::read(path)?;
    let (array, notes) = arrays::choose(&arrays, variable, path)?;
    let part = grid.points.within(grid.points, array.of, path)?;
    let parts = vec![(part, place_in(array, path)?)];
    Ok(Chosen { array: array.clone(), notes, grid, parts, endian: Endian::Big, time })
}

fn of_xml(path: &Path, variable: Option<&str>) -> Result<Chosen> {
    let xml::Image { grid, pieces, is_big, time } = xml::read(path)?;
    let Some(first) = pieces.first() else {
        return Err(ImportError::invalid(path, "has no <Piece>; write the file again"));
    };
    let (array, notes) = arrays::choose(&first.arrays, variable, path)?;
    let mut parts = Vec::with_capacity(pieces.len());
    for piece in &pieces {
        let is_same = |other: &&Array| {
            (&other.name, other.of, other.element, other.components)
                == (&array.name, array.of, array.element, array.components)
        };
        let Some(own) = piece.arrays.iter().find(is_same) else {
            let problem = format!("the array {} is not in all pieces, or not in one type; write it whole", array.name);
            return Err(ImportError::invalid(path, problem));
        };
        // Single points between cells hold none, however many cells they are said to have.
        parts.push((piece.points.within(grid.points, array.of, path)?, place_in(own, path)?));
    }
    let endian = if is_big { Endian::Big } else { Endian::Little };
    Ok(Chosen { array: array.clone(), notes, grid, parts, endian, time })
}

fn place_in(array: &Array, path: &Path) -> Result<Place> {
    let unsupported = |feature: &String| {
        let advice = "write the file with zlib, LZ4 or without compression";
        ImportError::unsupported_but(path, feature.clone(), advice)
    };
    array.place.as_ref().copied().map_err(unsupported)
}

/// The one number of a field; `None` if it cannot be read.
fn time_of(array: &Array, endian: Endian, path: &Path) -> Option<f64> {
    let (element, place) = (array.element?, *array.place.as_ref().ok()?);
    let mut bytes = [0; 8];
    let number = bytes.get_mut(..element.bytes())?;
    stream_of(place, element, number.len() as u64, path).ok()?.read_exact(number).ok()?;
    let is_big = endian == Endian::Big && !is_words(&place);
    if is_big {
        number.reverse();
    }
    Some(match element {
        Element::F64 => f64::from_le_bytes(bytes),
        Element::I64 => i64::from_le_bytes(bytes) as f64,
        Element::U64 => u64::from_le_bytes(bytes) as f64,
        Element::Voxel(voxel_type) => voxel_type.read(&bytes, 0),
        Element::F16 => return None,
    })
}
