//! Uncompressed arrays in files: headerless raw files, and the engine for every format whose body is a plain array (`.npy`,
//! NIfTI, ImageJ's single-directory TIFF).
//!
//! Files are memory-mapped; a box is copied line by line along the array's fastest axis, in any order of its axes, and is valid
//! only if the file is still unchanged afterwards. Cost of a box: its own bytes, once; nothing where they are lent in place.
//! Announced boxes are passed to the kernel plane by plane, since plain faulting reads a cold file several times slower.

mod misfit;
mod spread;
#[cfg(test)]
mod tests;

use crate::axes::{Axis, AxisOrder, Sizes};
use crate::direct::direct;
use crate::element::{Decode, Element, Endian};
use crate::error::{ImportError, Result};
use crate::losses::Losses;
use crate::mapped::MappedFile;
use crate::note::Note;
use crate::options::OpenOptions;
use crate::source::{Lent, Source, SourceInfo, Take};
use crate::step_time::StepTime;
use brickyard_objects::at;
use brickyard_volume::{Extent, VoxelBox, are, counted};
use misfit::Misfit;
use spread::Spread;
use std::path::Path;

/// Bytes checked for losses at a time: whole numbers of every type.
const LOSSES_AT_ONCE: usize = 1 << 20;

/// Layout of a headerless file.
#[derive(Clone, Debug, PartialEq)]
pub struct RawLayout {
    /// Number of voxels along x, y, z of one volume.
    pub extent: Extent,
    /// Type of a stored number.
    pub element: Element,
    /// Byte order of a stored voxel.
    pub endian: Endian,
    /// Bytes before the first voxel of the file.
    pub offset: u64,
    /// Whether bytes after the last voxel are ignored, with a note, instead of an error.
    pub may_trail: bool,
    /// Bytes from a time step to the next, where they lie apart.
    pub step_bytes: Option<u64>,
    /// Bytes from a channel to the next, where they lie apart.
    pub channel_bytes: Option<u64>,
    /// Number of channels.
    pub channels: u32,
    /// Number of time steps.
    pub times: u32,
    /// Order of the axes, slowest first.
    pub axes: AxisOrder,
}

impl RawLayout {
    /// Describes a single little-endian volume, x fastest, from the start of the file.
    pub fn new(extent: Extent, element: impl Into<Element>) -> Self {
        let (endian, axes) = (Endian::Little, AxisOrder::default());
        let (may_trail, step_bytes, channel_bytes) = (false, None, None);
        Self {
            extent,
            element: element.into(),
            endian,
            offset: 0,
            may_trail,
            step_bytes,
            channel_bytes,
            channels: 1,
            times: 1,
            axes,
        }
    }

    /// The layout that options describe; `None` without shape or type.
    pub(crate) fn of(options: &OpenOptions) -> Option<Self> {
        Some(Self {
            endian: options.endian,
            offset: options.offset.unwrap_or(0),
            may_trail: options.offset.is_some(),
            step_bytes: options.step_bytes,
            channel_bytes: options.channel_bytes,
            channels: options.channels.unwrap_or(1),
            times: options.times.unwrap_or(1),
            axes: options.axes.clone().unwrap_or_default(),
            ..Self::new(options.shape?, options.voxel_type?)
        })
    }

    fn array(&self) -> ArrayLayout {
        ArrayLayout {
            sizes: Sizes { extent: self.extent, channels: self.channels, times: self.times },
            axes: self.axes.clone(),
            decode: Decode { element: self.element, endian: self.endian, scale: None },
            offset: self.offset,
        }
    }

    /// The bytes up to the last voxel's end, checked.
    ///
    /// # Errors
    /// If the layout contradicts itself. `path` is for the message.
    pub(crate) fn end_bytes(&self, path: &Path) -> Result<u64> {
        let array = self.array();
        check_letters(path, &array)?;
        let spread = Spread::of(self, &array).map_err(|problem| ImportError::options(path, problem))?;
        let end = spread.bytes.checked_add(self.offset).filter(|end| *end <= i64::MAX as u64);
        end.ok_or_else(|| ImportError::options(path, format!("`offset` {}: no file is so long", self.offset)))
    }
}

/// A source of uncompressed voxels in one memory-mapped file.
pub struct RawSource {
    info: SourceInfo,
    file: MappedFile,
    array: ArrayLayout,
    /// Bytes between neighbours along each axis, in the order of [`Axis`].
    strides: [u64; 5],
    step_time: StepTime,
}

/// Runs of numbers without a gap.
struct Runs {
    /// Number of runs and bytes from one to the next, along each axis outside of them, slowest first.
    outer: Vec<(u64, u64)>,
    /// Bytes of a run.
    bytes: u64,
}

/// Layout of an array's voxels in its file.
#[derive(Clone, Debug)]
pub(crate) struct ArrayLayout {
    pub(crate) sizes: Sizes,
    pub(crate) axes: AxisOrder,
    pub(crate) decode: Decode,
    /// Bytes before the first voxel.
    pub(crate) offset: u64,
}

impl ArrayLayout {
    /// Returns the array's bytes, without the offset, or the reason why they cannot be counted.
    pub(crate) fn body_bytes(&self) -> Result<u64, String> {
        self.sizes.checked_bytes(self.decode.element.bytes())
    }

    /// Returns the bytes up to the array's end, offset included, or the reason why they cannot be counted.
    pub(crate) fn end_bytes(&self) -> Result<u64, String> {
        Ok(self.body_bytes()?.saturating_add(self.offset))
    }

    /// Creates a description with the array's sizes and voxel type, and a default geometry.
    pub(crate) fn info(&self) -> SourceInfo {
        SourceInfo::plain(self.sizes, self.decode.voxel_type())
    }

    /// Bytes between neighbours along each axis. Only for layouts with valid [`ArrayLayout::body_bytes`].
    fn strides(&self) -> [u64; 5] {
        [Axis::T, Axis::C, Axis::Z, Axis::Y, Axis::X].map(|axis| self.stride(axis))
    }

    fn stride(&self, axis: Axis) -> u64 {
        let axes = self.axes.axes();
        // An axis without a letter has one element: any stride will do.
        let place = axes.iter().position(|&a| a == axis).map_or(axes.len(), |p| p + 1);
        axes[place..].iter().fold(self.decode.element.bytes() as u64, |n, &a| n * self.sizes.of(a) as u64)
    }
}

impl RawSource {
    /// Opens a headerless file.
    ///
    /// # Errors
    /// If the file is missing or unreadable, differs in size from the layout (the message then lists the shapes that would
    /// fit), or has 64-bit numbers that its voxels cannot hold.
    pub fn open(path: &Path, layout: &RawLayout) -> Result<Self, ImportError> {
        Self::mapped(path, layout)?.with_losses(None, &OpenOptions::default())
    }

    /// Opens a headerless file, whose losses are not counted yet.
    pub(crate) fn mapped(path: &Path, layout: &RawLayout) -> Result<Self> {
        let end = layout.end_bytes(path)?;
        let file = MappedFile::open(path)?;
        let (found, array) = (file.len() as u64, layout.array());
        let spread = Spread::of(layout, &array).map_err(|problem| ImportError::options(path, problem))?;
        let trailing = found.checked_sub(end).filter(|&n| n == 0 || layout.may_trail || n == spread.gap_bytes);
        let Some(trailing) = trailing else {
            return Err(ImportError::invalid(path, Misfit { layout, end, found }.message()));
        };
        let mut info = SourceInfo { identity: identity(&format!("raw {layout:?}"), &[path])?, ..array.info() };
        info.notes.extend(trailing_note(trailing, end, spread.gap_bytes));
        Ok(Self { info, file, strides: spread.strides(&array), array, step_time: StepTime::default() })
    }

    /// Creates a source of a headerless stream, held in a scratch file up to its last voxel. Its losses are not counted yet.
    ///
    /// # Errors
    /// If the scratch file is shorter.
    pub(crate) fn of_stream(file: MappedFile, layout: &RawLayout, identity: String) -> Result<Self> {
        let (end, array) = (layout.end_bytes(&file.path)?, layout.array());
        if (file.len() as u64) < end {
            return Err(ImportError::invalid(&file.path, Misfit { layout, end, found: file.len() as u64 }.message()));
        }
        let spread = Spread::of(layout, &array).map_err(|problem| ImportError::options(&file.path, problem))?;
        let info = SourceInfo { identity, ..array.info() };
        Ok(Self { info, file, strides: spread.strides(&array), array, step_time: StepTime::default() })
    }

    /// Creates a source of an array in a mapped file.
    ///
    /// # Errors
    /// If the file is shorter than the array's layout.
    pub(crate) fn new(file: MappedFile, array: ArrayLayout, info: SourceInfo) -> Result<Self> {
        // Whatever the reader checked, every later slice must lie inside the map.
        let needed = array.body_bytes().ok().and_then(|body| body.checked_add(array.offset));
        if needed.is_none_or(|needed| needed > file.len() as u64) {
            let problem = format!("shrank to {} while it was opened", counted(file.len() as u64, "byte"));
            return Err(ImportError::invalid(&file.path, problem));
        }
        Ok(Self { info, file, strides: array.strides(), array, step_time: StepTime::default() })
    }

    /// Creates a source of an array whose slowest axis counts records of a file, each `record_bytes` after the one before.
    ///
    /// # Errors
    /// If the file is shorter than the last record's part of the array, or records overlap.
    pub(crate) fn of_records(
        file: MappedFile,
        array: ArrayLayout,
        info: SourceInfo,
        record_bytes: u64,
    ) -> Result<Self> {
        let damaged = |problem: &str| ImportError::invalid(&file.path, format!("damaged: {problem}"));
        let slowest = array.axes.axes().first().copied().ok_or_else(|| damaged("records of no axes"))?;
        let records = u64::from(array.sizes.of(slowest)).max(1);
        let body = array.body_bytes().map_err(|problem| damaged(&problem))?;
        let before_last = (records - 1).checked_mul(record_bytes);
        let end = before_last.and_then(|n| n.checked_add(body / records)?.checked_add(array.offset));
        if record_bytes < body / records || end.is_none_or(|end| end > file.len() as u64) {
            return Err(damaged("its records reach beyond one another or the file's end; fetch the file again"));
        }
        let mut strides = array.strides();
        strides[slowest as usize] = record_bytes;
        Ok(Self { info, file, strides, array, step_time: StepTime::default() })
    }

    fn stride(&self, axis: Axis) -> u64 {
        self.strides[axis as usize]
    }

    /// Sets the times stored with the array.
    pub(crate) fn at(mut self, step_time: StepTime) -> Self {
        self.step_time = step_time;
        self
    }

    /// Completes the description where it depends on the voxel type left by [`RawSource::with_losses`].
    pub(crate) fn described(mut self, describe: impl FnOnce(&mut SourceInfo)) -> Self {
        describe(&mut self.info);
        self
    }

    /// Reads the whole array, counts the values that do not fit its voxels, and adds a note. Arrays without possible losses are
    /// not read. `nodata` is the file's no-data value.
    ///
    /// # Errors
    /// If a forbidden loss occurs, or the file cannot be read.
    pub(crate) fn with_losses(mut self, nodata: Option<f64>, options: &OpenOptions) -> Result<Self> {
        self.array.decode = direct(self.array.decode, nodata, options);
        self.info.voxel_type = self.array.decode.voxel_type();
        let path = &self.file.path;
        let Some(mut losses) = Losses::may_occur(path, self.array.decode, nodata, options) else { return Ok(self) };
        let Runs { outer, bytes } = self.runs();
        let count: u64 = outer.iter().map(|(size, _)| size).product();
        for run in 0..count {
            let mut rest = run;
            let start = outer.iter().rev().fold(self.array.offset, |start, (size, stride)| {
                let place = rest % size;
                rest /= size;
                start + place * stride
            });
            let numbers = &self.file[start as usize..][..bytes as usize];
            for part in numbers.chunks(LOSSES_AT_ONCE) {
                let seen = losses.see(part);
                // Missing parts of the file read as zeros.
                self.file.confirm()?;
                seen?;
            }
        }
        self.info.notes.push(losses.note());
        let decode = losses.decode();
        self.array.decode = decode;
        self.info.voxel_type = decode.voxel_type();
        Ok(self)
    }

    /// The longest runs without a gap: records, steps or channels may lie apart.
    fn runs(&self) -> Runs {
        let axes = self.array.axes.axes();
        let size = |axis: Axis| u64::from(self.array.sizes.of(axis));
        let (mut bytes, mut inner) = (self.array.decode.element.bytes() as u64, axes.len());
        while let Some(&axis) = axes[..inner].last().filter(|axis| size(**axis) == 1 || self.stride(**axis) == bytes) {
            bytes *= size(axis);
            inner -= 1;
        }
        Runs { outer: axes[..inner].iter().map(|&axis| (size(axis), self.stride(axis))).collect(), bytes }
    }

    /// A box's start in the file, and its copy loops.
    fn copy_of(&self, time: u32, channel: u32, region: VoxelBox) -> (usize, BoxCopy) {
        let array = &self.array;
        let strides = [Axis::X, Axis::Y, Axis::Z].map(|a| self.stride(a));
        let lo = region.min.to_array();
        let start = array.offset
            + time as u64 * self.stride(Axis::T)
            + channel as u64 * self.stride(Axis::C)
            + (0..3).map(|a| lo[a] as u64 * strides[a]).sum::<u64>();
        (start as usize, BoxCopy::new(array.decode, region.extent(), strides))
    }
}

impl Source for RawSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        let (start, copy) = self.copy_of(time, channel, region);
        copy.run(&self.file[start..], out);
        self.file.confirm()
    }

    fn scratch_bytes(&self) -> u64 {
        self.file.scratch_bytes()
    }

    fn step_time(&self) -> StepTime {
        self.step_time.clone()
    }

    fn lend(&self, time: u32, channel: u32, region: VoxelBox, take: Take<'_>) -> Result<bool, ImportError> {
        let [x, row_bytes, slice_bytes] = [Axis::X, Axis::Y, Axis::Z].map(|a| self.stride(a) as usize);
        if !self.array.decode.is_copy() || x != self.info.voxel_type.bytes() {
            return Ok(false);
        }
        let (start, _) = self.copy_of(time, channel, region);
        take(Lent { slices: 0..region.extent().z as usize, bytes: &self.file[start..], row_bytes, slice_bytes });
        self.file.confirm().map(|()| true)
    }

    fn announce(&self, time: u32, channel: u32, region: VoxelBox) {
        let (start, copy) = self.copy_of(time, channel, region);
        copy.advise(&self.file, start);
    }
}

/// The copy of one box: three nested loops, the innermost along the file's fastest axis.
struct BoxCopy {
    decode: Decode,
    /// Counts, strides in the file and strides in the box, innermost loop first.
    counts: [usize; 3],
    src: [usize; 3],
    dst: [usize; 3],
}

impl BoxCopy {
    fn new(decode: Decode, extent: Extent, strides: [u64; 3]) -> Self {
        let voxel = decode.voxel_type().bytes();
        let [x, y, _] = extent.to_array().map(|n| n as usize);
        let to = [voxel, voxel * x, voxel * x * y];
        // The fastest axis of the file inside, then the fastest of the box, so that both stay in cache.
        let mut order = [0, 1, 2];
        order.sort_by_key(|&a| strides[a]);
        if order[0] != 0 {
            order = [order[0], 0, 3 - order[0]];
        }
        let counts = extent.to_array().map(|n| n as usize);
        Self {
            decode,
            counts: order.map(|a| counts[a]),
            src: order.map(|a| strides[a] as usize),
            dst: order.map(|a| to[a]),
        }
    }

    fn run(&self, src: &[u8], out: &mut [u8]) {
        for k in 0..self.counts[2] {
            for j in 0..self.counts[1] {
                let from = k * self.src[2] + j * self.src[1];
                let to = k * self.dst[2] + j * self.dst[1];
                self.decode.line(&src[from..], self.src[0], &mut out[to..], self.dst[0], self.counts[0]);
            }
        }
    }

    /// Announces the bytes about to be read, one range per outermost step, if the box uses a good part of that range.
    fn advise(&self, file: &MappedFile, start: usize) {
        let line = (self.counts[0] - 1) * self.src[0] + self.decode.element.bytes();
        if line.saturating_mul(8) < self.src[1] && self.counts[1] > 1 {
            return;
        }
        let range = (self.counts[1] - 1) * self.src[1] + line;
        for k in 0..self.counts[2] {
            let start = start + k * self.src[2];
            file.advise(start..start + range);
        }
    }
}

/// Checks that every axis of more than one element has a letter.
fn check_letters(path: &Path, array: &ArrayLayout) -> Result<()> {
    for axis in [Axis::Z, Axis::C, Axis::T] {
        let (size, letter) = (array.sizes.of(axis), axis.letter());
        if size > 1 && !array.axes.axes().contains(&axis) {
            let problem =
                format!("axes '{}' have no '{letter}', but a size of {size} along {letter} was given", array.axes);
            return Err(ImportError::options(path, problem));
        }
    }
    Ok(())
}

/// Returns an identity of input files: `prefix` for the way they are read, then each file's absolute path, size and modification
/// time.
pub(crate) fn identity(prefix: &str, paths: &[impl AsRef<Path>]) -> Result<String> {
    let mut identity = prefix.to_owned();
    for path in paths {
        let path = path.as_ref();
        if let Some(place) = at(path).map_err(ImportError::io(path))? {
            let document = place.document(u64::MAX).map_err(ImportError::io(path))?;
            let tag = document.and_then(|document| document.version.tag.clone()).unwrap_or_default();
            identity += &format!("; {} {tag}", path.display());
            continue;
        }
        let data = std::fs::metadata(path).map_err(ImportError::io(path))?;
        let absolute = std::path::absolute(path).map_err(ImportError::io(path))?;
        let modified = data.modified().ok().and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok());
        let nanos = modified.map_or(0, |d| d.as_nanos());
        identity += &format!("; {} {} bytes {nanos} ns", absolute.display(), data.len());
    }
    Ok(identity)
}

/// A note about the bytes after the last voxel. Those between steps or channels may end the file, too.
fn trailing_note(trailing: u64, end: u64, gap: u64) -> Option<Note> {
    let (bytes, are) = (counted(trailing, "byte"), are(trailing));
    match trailing {
        0 => None,
        n if n <= gap => Some(Note::new(format!("{bytes} after the last voxels {are} ignored."))),
        _ => {
            let text = format!("{bytes} after the voxels {are} ignored; more voxels there have `offset` {end}.");
            Some(Note::warning(text))
        }
    }
}
