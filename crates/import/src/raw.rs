//! Arrays that lie uncompressed in files: headerless raw files, and the engine under every format whose body is a
//! plain array (`.npy`, NIfTI, ImageJ's single-directory TIFF).
//!
//! The files are memory-mapped; a box is copied line by line along the array's fastest axis, whatever the order of
//! its axes. Cost of a box: its own bytes, once; nothing where they are lent as they lie in the file. The kernel is told of
//! announced boxes plane by plane, since plain faulting reads a cold file several times slower.

use crate::axes::{Axis, AxisOrder, Sizes};
use crate::element::{Decode, Element, Endian};
use crate::error::ImportError;
use crate::losses::Losses;
use crate::source::{Lent, Source, SourceInfo};
use brickyard_volume::{Extent, VoxelBox, VoxelType};
use memmap2::Mmap;
use std::fs::File;
use std::path::Path;

/// Bytes looked at in one go for what they lose: whole numbers of every type.
const LOSSES_AT_ONCE: usize = 1 << 20;

/// What a headerless file holds.
#[derive(Clone, Debug, PartialEq)]
pub struct RawLayout {
    /// Voxels of one volume.
    pub extent: Extent,
    /// Type of a stored voxel.
    pub voxel_type: VoxelType,
    /// Byte order of a stored voxel.
    pub endian: Endian,
    /// Bytes before the first voxel of every file.
    pub offset: u64,
    /// Number of channels.
    pub channels: u32,
    /// Number of time steps.
    pub times: u32,
    /// Order of the axes, slowest first.
    pub axes: AxisOrder,
}

impl RawLayout {
    /// A single little-endian volume, x fastest, from the start of the file.
    pub fn new(extent: Extent, voxel_type: VoxelType) -> Self {
        let (endian, axes) = (Endian::Little, AxisOrder::default());
        Self { extent, voxel_type, endian, offset: 0, channels: 1, times: 1, axes }
    }
}

/// A source whose voxels lie uncompressed in one memory-mapped file.
pub struct RawSource {
    info: SourceInfo,
    map: Mmap,
    array: ArrayLayout,
}

/// Where the voxels of an array lie in its file.
#[derive(Clone, Debug)]
pub(crate) struct ArrayLayout {
    pub(crate) sizes: Sizes,
    pub(crate) axes: AxisOrder,
    pub(crate) decode: Decode,
    /// Bytes before the first voxel.
    pub(crate) offset: u64,
}

impl ArrayLayout {
    /// Bytes of the array, offset not included.
    pub(crate) fn body_bytes(&self) -> Result<u64, String> {
        self.sizes.checked_bytes(self.decode.element.bytes())
    }

    /// A description with sizes and type, and nothing known of its place in the world.
    pub(crate) fn info(&self) -> SourceInfo {
        SourceInfo::plain(self.sizes, self.decode.voxel_type())
    }

    /// Bytes between neighbours along an axis. Only for layouts whose [`ArrayLayout::body_bytes`] exist.
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
    /// If the file is missing or unreadable, or its size is not exactly what the layout implies: the message then
    /// lists the shapes that would fit.
    pub fn open(path: &Path, layout: &RawLayout) -> Result<Self, ImportError> {
        let array = ArrayLayout {
            sizes: Sizes { extent: layout.extent, channels: layout.channels, times: layout.times },
            axes: layout.axes.clone(),
            decode: Decode { element: Element::Voxel(layout.voxel_type), endian: layout.endian, scale: None },
            offset: layout.offset,
        };
        let body = array.body_bytes().map_err(|problem| ImportError::options(path, problem))?;
        check_letters(path, &array)?;
        let file = File::open(path).map_err(ImportError::io(path))?;
        let found = file.metadata().map_err(ImportError::io(path))?.len();
        if found.checked_sub(layout.offset) != Some(body) {
            return Err(ImportError::invalid(path, misfit(layout, body, found)));
        }
        let info = SourceInfo { identity: identity(&format!("raw {layout:?}"), &[path])?, ..array.info() };
        Self::map(path, &file, array, info)
    }

    /// Maps a file whose size the reader of its format has checked.
    pub(crate) fn map(path: &Path, file: &File, array: ArrayLayout, info: SourceInfo) -> Result<Self, ImportError> {
        // SAFETY: the map is read-only and never handed out; reading it is undefined only if another process
        // truncates the file meanwhile, which ends this process with SIGBUS, as for every program that maps its input.
        let map = unsafe { Mmap::map(file) }.map_err(ImportError::io(path))?;
        // Whatever the reader checked, every later slice must lie inside the map.
        let needed = array.body_bytes().ok().and_then(|body| body.checked_add(array.offset));
        if needed.is_none_or(|needed| needed > map.len() as u64) {
            return Err(ImportError::invalid(path, format!("shrank to {} bytes while it was opened", map.len())));
        }
        Ok(Self { info, map, array })
    }

    /// Counts what its voxels lose, over the whole array; an error if something is lost that must not be.
    pub(crate) fn count_losses(&mut self, path: &Path, allowed: bool) -> Result<(), ImportError> {
        let Some(mut losses) = Losses::may_occur(path, self.array.decode, allowed) else { return Ok(()) };
        let body = self.array.body_bytes().map_err(|problem| ImportError::invalid(path, problem))?;
        let numbers = &self.map[self.array.offset as usize..][..body as usize];
        numbers.chunks(LOSSES_AT_ONCE).try_for_each(|part| losses.see(part))?;
        self.info.notes.push(losses.note());
        Ok(())
    }

    /// Where a box begins in the file, and how it is copied.
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
        copy.run(&self.map[start..], out);
        Ok(())
    }

    fn lend(&self, time: u32, channel: u32, region: VoxelBox) -> Option<Lent<'_>> {
        let [x, y, z] = [Axis::X, Axis::Y, Axis::Z].map(|a| self.array.stride(a) as usize);
        let as_it_is = self.array.decode.is_copy() && x == self.info.voxel_type.bytes();
        let (start, _) = self.copy_of(time, channel, region);
        as_it_is.then(|| Lent { bytes: &self.map[start..], row_bytes: y, slice_bytes: z })
    }

    fn announce(&self, time: u32, channel: u32, region: VoxelBox) {
        let (start, copy) = self.copy_of(time, channel, region);
        copy.advise(&self.map, start);
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

    /// Announces what will be read, one range per outermost step, where the box uses a good part of that range.
    #[cfg(unix)]
    fn advise(&self, map: &Mmap, start: usize) {
        let line = (self.counts[0] - 1) * self.src[0] + self.decode.element.bytes();
        if line.saturating_mul(8) < self.src[1] && self.counts[1] > 1 {
            return;
        }
        let range = (self.counts[1] - 1) * self.src[1] + line;
        for k in 0..self.counts[2] {
            // Advice is a hint: where the system refuses it, the copy reads all the same, only slower.
            let _ = map.advise_range(memmap2::Advice::WillNeed, start + k * self.src[2], range);
        }
    }

    #[cfg(not(unix))]
    fn advise(&self, _map: &Mmap, _start: usize) {}
}

/// Every axis of more than one element needs a letter.
fn check_letters(path: &Path, array: &ArrayLayout) -> Result<(), ImportError> {
    for (axis, letter) in [(Axis::Z, 'z'), (Axis::C, 'c'), (Axis::T, 't')] {
        let size = array.sizes.of(axis);
        if size > 1 && !array.axes.axes().contains(&axis) {
            let problem = format!("axes '{}' have no '{letter}', but {size} along {letter} were given", array.axes);
            return Err(ImportError::options(path, problem));
        }
    }
    Ok(())
}

/// Says how the size of a file disagrees with its layout, and what would fit.
fn misfit(layout: &RawLayout, body: u64, found: u64) -> String {
    let RawLayout { extent, voxel_type, offset, channels, times, .. } = *layout;
    let expected = body as u128 + offset as u128;
    let difference = match found as u128 {
        f if f > expected => format!("{} too many", f - expected),
        f => format!("{} too few", expected - f),
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
    if found as u128 > expected {
        let surplus = found as u128 - expected;
        message += &format!(
            "; if the file starts with a header of {surplus} bytes, pass --offset {}",
            surplus + offset as u128
        );
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

/// What identifies input files: a prefix for how they are read, then each one's absolute name, size and time.
pub(crate) fn identity(prefix: &str, paths: &[impl AsRef<Path>]) -> Result<String, ImportError> {
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
                let lent = source.lend(0, 0, source.info().extent.full_box());
                assert_eq!(lent.is_some(), endian == Endian::Little || voxel_type.bytes() == 1);
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
        assert!(!message.contains("--offset"), "{message}");
        let message = refusal(2048 + 352, &layout(16, 16, 8, VoxelType::U8));
        assert!(message.contains("352 too many") && message.contains("--offset 352"), "{message}");
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
}
