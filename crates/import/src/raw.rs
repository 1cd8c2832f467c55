//! Uncompressed arrays in files: headerless raw files, and the engine for every format whose body is a plain array (`.npy`,
//! NIfTI, ImageJ's single-directory TIFF).
//!
//! Files are memory-mapped; a box is copied line by line along the array's fastest axis, in any order of its axes, and is valid
//! only if the file is still unchanged afterwards. Cost of a box: its own bytes, once; nothing where they are lent in place.
//! Announced boxes are passed to the kernel plane by plane, since plain faulting reads a cold file several times slower.

use crate::axes::{Axis, AxisOrder, Sizes};
use crate::element::{Decode, Element, Endian};
use crate::error::{ImportError, Result};
use crate::losses::Losses;
use crate::mapped::MappedFile;
use crate::options::OpenOptions;
use crate::source::{Lent, Source, SourceInfo, Take};
use crate::step_time::StepTime;
use brickyard_volume::{Extent, VoxelBox, VoxelType};
use std::path::Path;

/// Bytes checked for losses at a time: whole numbers of every type.
const LOSSES_AT_ONCE: usize = 1 << 20;

/// Layout of a headerless file.
#[derive(Clone, Debug, PartialEq)]
pub struct RawLayout {
    /// Number of voxels along x, y, z of one volume.
    pub extent: Extent,
    /// Type of a stored voxel.
    pub voxel_type: VoxelType,
    /// Byte order of a stored voxel.
    pub endian: Endian,
    /// Bytes before the first voxel of the file.
    pub offset: u64,
    /// Number of channels.
    pub channels: u32,
    /// Number of time steps.
    pub times: u32,
    /// Order of the axes, slowest first.
    pub axes: AxisOrder,
}

impl RawLayout {
    /// Describes a single little-endian volume, x fastest, from the start of the file.
    pub fn new(extent: Extent, voxel_type: VoxelType) -> Self {
        let (endian, axes) = (Endian::Little, AxisOrder::default());
        Self { extent, voxel_type, endian, offset: 0, channels: 1, times: 1, axes }
    }
}

/// A source of uncompressed voxels in one memory-mapped file.
pub struct RawSource {
    info: SourceInfo,
    file: MappedFile,
    array: ArrayLayout,
    step_time: StepTime,
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

    /// Bytes between neighbours along an axis. Only for layouts with valid [`ArrayLayout::body_bytes`].
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
    /// If the file is missing or unreadable, or differs in size from the layout: the message then lists the shapes that would
    /// fit.
    pub fn open(path: &Path, layout: &RawLayout) -> Result<Self, ImportError> {
        let array = ArrayLayout {
            sizes: Sizes { extent: layout.extent, channels: layout.channels, times: layout.times },
            axes: layout.axes.clone(),
            decode: Decode { element: Element::Voxel(layout.voxel_type), endian: layout.endian, scale: None },
            offset: layout.offset,
        };
        let body = array.body_bytes().map_err(|problem| ImportError::options(path, problem))?;
        check_letters(path, &array)?;
        let file = MappedFile::open(path)?;
        let found = file.len() as u64;
        if found.checked_sub(layout.offset) != Some(body) {
            return Err(ImportError::invalid(path, misfit(layout, body, found)));
        }
        let info = SourceInfo { identity: identity(&format!("raw {layout:?}"), &[path])?, ..array.info() };
        Self::new(file, array, info)
    }

    /// Creates a source of an array in a mapped file.
    ///
    /// # Errors
    /// If the file is shorter than the array's layout.
    pub(crate) fn new(file: MappedFile, array: ArrayLayout, info: SourceInfo) -> Result<Self> {
        // Whatever the reader checked, every later slice must lie inside the map.
        let needed = array.body_bytes().ok().and_then(|body| body.checked_add(array.offset));
        if needed.is_none_or(|needed| needed > file.len() as u64) {
            let problem = format!("shrank to {} bytes while it was opened", file.len());
            return Err(ImportError::invalid(&file.path, problem));
        }
        Ok(Self { info, file, array, step_time: StepTime::default() })
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
        let path = &self.file.path;
        let Some(mut losses) = Losses::may_occur(path, self.array.decode, nodata, options) else { return Ok(self) };
        let body = self.array.body_bytes().map_err(|problem| ImportError::invalid(path, problem))?;
        let numbers = &self.file[self.array.offset as usize..][..body as usize];
        for part in numbers.chunks(LOSSES_AT_ONCE) {
            let seen = losses.see(part);
            // Missing parts of the file read as zeros.
            self.file.confirm()?;
            seen?;
        }
        self.info.notes.push(losses.note());
        let decode = losses.decode();
        self.array.decode = decode;
        self.info.voxel_type = decode.voxel_type();
        Ok(self)
    }

    /// A box's start in the file, and its copy loops.
    fn copy_of(&self, time: u32, channel: u32, region: VoxelBox) -> (usize, BoxCopy) {
        let array = &self.array;
        let strides = [Axis::X, Axis::Y, Axis::Z].map(|a| array.stride(a));
        let lo = region.min.to_array();
        let start = array.offset
            + time as u64 * array.stride(Axis::T)
            + channel as u64 * array.stride(Axis::C)
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
        let [x, row_bytes, slice_bytes] = [Axis::X, Axis::Y, Axis::Z].map(|a| self.array.stride(a) as usize);
        if !self.array.decode.is_copy() || x != self.info.voxel_type.bytes() {
            return Ok(false);
        }
        let (start, _) = self.copy_of(time, channel, region);
        take(Lent { bytes: &self.file[start..], row_bytes, slice_bytes });
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

/// Describes a mismatch of a file's size and its layout, and the shapes that would fit.
fn misfit(layout: &RawLayout, body: u64, found: u64) -> String {
    let RawLayout { extent, voxel_type, offset, channels, times, .. } = *layout;
    let expected = body as u128 + offset as u128;
    let surplus = (found as u128).saturating_sub(expected);
    let difference = match surplus {
        0 => format!("{} too few", expected - found as u128),
        _ => format!("{surplus} too many"),
    };
    let mut what = format!("{extent} {voxel_type}");
    for (n, name) in [(channels, "channels"), (times, "time steps")] {
        if n > 1 {
            what += &format!(" with {n} {name}");
        }
    }
    if offset > 0 {
        what += &format!(" after {offset} bytes");
    }
    let mut message = format!("expected {expected} bytes for {what}, found {found} ({difference})");
    let fits = fitting_shapes(layout, found);
    if !fits.is_empty() {
        message += &format!("; would fit: {}", fits.join("; "));
    }
    if surplus > 0 {
        let header = surplus + offset as u128;
        message += &format!("; if the file starts with a header of {header} bytes, pass `offset` {header}");
    }
    message
}

/// Shapes and types near the given ones that a file of `found` bytes would hold exactly.
fn fitting_shapes(layout: &RawLayout, found: u64) -> Vec<String> {
    let Some(body) = found.checked_sub(layout.offset).filter(|&n| n > 0) else { return Vec::new() };
    let Extent { x, y, z } = layout.extent;
    let sets = layout.channels as u64 * layout.times as u64;
    let mut fits = Vec::new();
    let voxels = layout.extent.volume() as u128 * sets as u128;
    let types: Vec<&str> = VoxelType::ALL
        .into_iter()
        .filter(|t| *t != layout.voxel_type && voxels * t.bytes() as u128 == body as u128)
        .map(VoxelType::name)
        .collect();
    if !types.is_empty() {
        fits.push(format!("{} {}", layout.extent, types.join(" or ")));
    }
    let plane = x as u128 * y as u128 * sets as u128 * layout.voxel_type.bytes() as u128;
    if (body as u128).is_multiple_of(plane) && body as u128 / plane <= u32::MAX as u128 {
        fits.push(format!("{x},{y},{} {}", body as u128 / plane, layout.voxel_type));
    }
    let volume = plane * z as u128;
    if (body as u128).is_multiple_of(volume) && body as u128 > volume && layout.channels == 1 {
        fits.push(format!("{} {} with {} time steps", layout.extent, layout.voxel_type, body as u128 / volume));
    }
    for (bytes, names) in [(1, "u8"), (2, "u16 or i16"), (4, "f32, u32 or i32")] {
        let edge = ((body / bytes) as f64).cbrt().round() as u64;
        if edge > 0 && edge.checked_pow(3).and_then(|n| n.checked_mul(bytes)) == Some(body) {
            fits.push(format!("{edge},{edge},{edge} {names}"));
        }
    }
    fits
}

/// Returns an identity of input files: `prefix` for the way they are read, then each file's absolute path, size and modification
/// time.
pub(crate) fn identity(prefix: &str, paths: &[impl AsRef<Path>]) -> Result<String> {
    let mut identity = prefix.to_owned();
    for path in paths {
        let path = path.as_ref();
        let data = std::fs::metadata(path).map_err(ImportError::io(path))?;
        let absolute = std::path::absolute(path).map_err(ImportError::io(path))?;
        let modified = data.modified().ok().and_then(|t| t.duration_since(std::time::UNIX_EPOCH).ok());
        let nanos = modified.map_or(0, |d| d.as_nanos());
        identity += &format!("; {} {} bytes {nanos} ns", absolute.display(), data.len());
    }
    Ok(identity)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Field, assert_boxes, temp_file};

    fn layout(field: Field, axes: &str, endian: Endian) -> RawLayout {
        let [x, y, z, channels, times] = field.sizes;
        RawLayout {
            endian,
            channels,
            times,
            axes: axes.parse().unwrap(),
            ..RawLayout::new(Extent::new(x, y, z), field.voxel_type)
        }
    }

    #[test]
    fn every_type_and_byte_order_gives_the_bytes_written() {
        for voxel_type in VoxelType::ALL {
            for endian in [Endian::Little, Endian::Big] {
                let field = Field { sizes: [13, 7, 5, 1, 1], voxel_type };
                let (_folder, path) = temp_file("a b.raw", &field.bytes("zyx", endian == Endian::Big));
                let source = RawSource::open(&path, &layout(field, "zyx", endian)).unwrap();
                assert_boxes(&source, field);
                let is_lent = source.lend(0, 0, source.info().extent.full_box(), &mut |_| ()).unwrap();
                assert_eq!(is_lent, endian == Endian::Little || voxel_type.bytes() == 1);
            }
        }
    }

    #[test]
    fn any_order_of_axes_is_unravelled() {
        let field = Field { sizes: [7, 5, 6, 2, 3], voxel_type: VoxelType::U16 };
        for axes in ["tczyx", "xyzct", "ctzyx", "tzcyx", "zyxct", "ytxcz"] {
            let (_folder, path) = temp_file("a.raw", &field.bytes(axes, false));
            assert_boxes(&RawSource::open(&path, &layout(field, axes, Endian::Little)).unwrap(), field);
        }
    }

    #[test]
    fn offset_skips_a_header() {
        let field = Field { sizes: [4, 3, 2, 1, 1], voxel_type: VoxelType::I32 };
        let (_folder, path) = temp_file("a.raw", &[vec![9; 17], field.bytes("zyx", false)].concat());
        let layout = RawLayout { offset: 17, ..layout(field, "zyx", Endian::Little) };
        assert_boxes(&RawSource::open(&path, &layout).unwrap(), field);
    }

    fn refusal(bytes: usize, layout: &RawLayout) -> String {
        let (_folder, path) = temp_file("a.raw", &vec![0; bytes]);
        RawSource::open(&path, layout).err().unwrap().to_string()
    }

    #[test]
    fn a_size_that_does_not_fit_says_what_would() {
        let layout = |x, y, z, t| RawLayout::new(Extent::new(x, y, z), t);
        let message = refusal(16 * 16 * 16, &layout(16, 16, 8, VoxelType::U8));
        for part in
            ["expected 2048 bytes", "found 4096", "2048 too many", "16,16,16 u8", "16,16,8 u16 or i16", "2 time steps"]
        {
            assert!(message.contains(part), "{part}: {message}");
        }
        let message = refusal(1000, &layout(16, 16, 8, VoxelType::U8));
        assert!(message.contains("1048 too few") && message.contains("10,10,10 u8"), "{message}");
        assert!(!message.contains("`offset`"), "{message}");
        let message = refusal(2048 + 352, &layout(16, 16, 8, VoxelType::U8));
        assert!(message.contains("352 too many") && message.contains("`offset` 352"), "{message}");
        assert!(refusal(0, &layout(16, 16, 8, VoxelType::U8)).contains("2048 too few"));
        let offset = RawLayout { offset: 100, ..layout(4, 4, 4, VoxelType::U8) };
        assert!(refusal(64, &offset).contains("expected 164 bytes"));
    }

    #[test]
    fn impossible_shapes_are_refused() {
        assert!(refusal(8, &RawLayout::new(Extent::new(4, 0, 2), VoxelType::U8)).contains("axis of size 0"));
        let huge = Extent::new(u32::MAX, u32::MAX, u32::MAX);
        assert!(refusal(8, &RawLayout::new(huge, VoxelType::U8)).contains("2^63"));
        let two = RawLayout { channels: 2, ..RawLayout::new(Extent::new(2, 2, 1), VoxelType::U8) };
        assert!(refusal(8, &RawLayout { axes: "zyx".parse().unwrap(), ..two }).contains("no 'c'"));
        let missing =
            RawSource::open(Path::new("/nowhere/at all.raw"), &RawLayout::new(Extent::new(1, 1, 1), VoxelType::U8));
        assert!(matches!(missing, Err(ImportError::Io { .. })));
    }

    #[test]
    fn identity_follows_file_and_layout() {
        let (_folder, path) = temp_file("a.raw", &[1; 8]);
        let of =
            |extent| RawSource::open(&path, &RawLayout::new(extent, VoxelType::U8)).unwrap().info().identity.clone();
        let before = of(Extent::new(2, 2, 2));
        assert_eq!(before, of(Extent::new(2, 2, 2)));
        assert_ne!(before, of(Extent::new(8, 1, 1)));
        let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
        file.set_modified(std::time::UNIX_EPOCH + std::time::Duration::from_secs(1)).unwrap();
        assert_ne!(before, of(Extent::new(2, 2, 2)));
    }

    /// Checks that all reads of a source now fail, lent and copied.
    fn all_is_refused(source: &RawSource, what: &str) {
        let full = source.info().extent.full_box();
        let mut out = vec![0; full.extent().volume() as usize * source.info().voxel_type.bytes()];
        let message = source.read_box(0, 0, full, &mut out).unwrap_err().to_string();
        assert!(message.contains("changed while it was read") && message.contains(what), "{message}");
        let mut sum = 0;
        let lent = source.lend(0, 0, full, &mut |lent| sum = lent.bytes.iter().map(|&b| u64::from(b)).sum());
        assert!(lent.is_err(), "{what}: {sum}");
    }

    #[test]
    fn a_file_that_changes_while_it_is_mapped_is_an_error_and_not_zeros() {
        let bytes = vec![7; 64 * 64 * 16];
        let layout = RawLayout::new(Extent::new(64, 64, 16), VoxelType::U8);
        let write = |path: &Path| std::fs::OpenOptions::new().write(true).open(path).unwrap();
        // Cut short by whole pages, which faults, and within the last page, which does not.
        for left in [0, 100, bytes.len() as u64 - 1] {
            let (_folder, path) = temp_file("a.raw", &bytes);
            let source = RawSource::open(&path, &layout).unwrap();
            write(&path).set_len(left).unwrap();
            all_is_refused(&source, &format!("found {left}"));
        }
        let (_folder, path) = temp_file("a.raw", &bytes);
        let source = RawSource::open(&path, &layout).unwrap();
        write(&path).set_modified(std::time::UNIX_EPOCH).unwrap();
        all_is_refused(&source, "written to or replaced");
        let (folder, path) = temp_file("a.raw", &bytes);
        let source = RawSource::open(&path, &layout).unwrap();
        let other = folder.path().join("b.raw");
        std::fs::write(&other, &bytes[1..]).unwrap();
        std::fs::rename(other, &path).unwrap();
        all_is_refused(&source, "found 65535");
    }
}
