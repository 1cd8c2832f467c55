//! TIFF stacks on the `tiff` crate: multi-page files and BigTIFF, strips and tiles in every compression it decodes,
//! lists of single-plane files, and what ImageJ and OME-XML say of the order of pages and the meaning of values.
//!
//! Opening walks all directories once: planes must agree, and their data must lie inside the file. Reading decodes only
//! the strips or tiles that a box meets; since those mostly span a plane's width, callers do best to ask for each plane
//! once. Each thread that reads has a decoder of its own, kept for the next call. ImageJ's stacks with a single
//! directory (over 4 GiB) are plain arrays and go through [`RawSource`].

mod calibration;
mod description;
mod imagej;
mod lzw;
mod page;
#[cfg(test)]
mod tests;

use crate::axes::{Axis, AxisOrder, Sizes};
use crate::element::{Decode, Endian};
use crate::error::ImportError;
use crate::losses::Losses;
use crate::mapped::MappedFile;
use crate::options::{NoData, OpenOptions};
use crate::raw::{ArrayLayout, RawSource, identity};
use crate::source::{Access, Source, SourceInfo};
use crate::stamp::Stamp;
use brickyard_volume::{ChannelLook, VoxelBox};
use description::{Declared, Description};
use page::{OpenTiff, PageFormat};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// A stack of planes in TIFF files as a source; strips and tiles are decoded when they are asked for.
pub(crate) struct TiffStack {
    info: SourceInfo,
    format: PageFormat,
    /// How the library's samples, which are in this machine's byte order, become voxels.
    decode: Decode,
    files: Vec<TiffFile>,
    /// Pages per file: either one file has all, or each has one.
    pages_per_file: u32,
    order: PageOrder,
    /// Memory for the largest strip or tile.
    reader_bytes: u64,
}

struct TiffFile {
    path: PathBuf,
    /// The file's stamp when its pages were checked.
    stamp: Stamp,
    /// Decoders at rest: as many as threads have read at once.
    decoders: Mutex<Vec<OpenTiff>>,
}

/// Which page holds which plane.
struct PageOrder {
    /// Page axes (of t, c, z), slowest first.
    axes: Vec<Axis>,
    /// Sizes in pages: samples within a page are not counted as channels.
    sizes: Sizes,
}

impl PageOrder {
    fn page(&self, time: u32, page_channel: u32, z: u32) -> u64 {
        self.axes.iter().fold(0, |page, &axis| {
            let i = match axis {
                Axis::T => time,
                Axis::C => page_channel,
                _ => z,
            };
            page * self.sizes.of(axis) as u64 + i as u64
        })
    }
}

/// Whether a TIFF file has more than one page.
pub(crate) fn is_multi_page(path: &Path) -> Result<bool, ImportError> {
    OpenTiff::open(path).map(|tiff| tiff.has_more_pages())
}

/// Opens one TIFF file, of one page or several.
pub(crate) fn open_file(path: &Path, options: &OpenOptions) -> Result<Box<dyn Source>, ImportError> {
    let mut tiff = OpenTiff::open(path)?;
    let format = tiff.format()?;
    let description = tiff.description()?;
    if let [first, .., last] = &description.images[..]
        && options.axes.is_none()
    {
        let problem = format!(
            "its OME-XML tells of {} images, {first} to {last}, and a store holds one: write one to a file of its own (bfconvert -series \
             NUMBER), or pass `axes` zyx to take all pages as one stack",
            description.images.len()
        );
        return Err(ImportError::options(path, problem));
    }
    if let Some(declared) = &description.declared
        && options.axes.is_none()
        && declared.in_one_directory
        && !tiff.has_more_pages()
        && declared.planes() > 1
    {
        return open_contiguous(path, &mut tiff, &format, declared, &description, options);
    }
    tiff.check_data(path, 1)?;
    let mut pages = 1u32;
    let mut reader_bytes = tiff.reader_bytes(&format)?;
    while tiff.has_more_pages() {
        tiff.next_page(pages + 1)?;
        pages += 1;
        let other = tiff.format()?;
        if other != format {
            return Err(ImportError::invalid(path, format!("page {pages} is {other}, but page 1 is {format}")));
        }
        tiff.check_data(path, pages)?;
        reader_bytes = reader_bytes.max(tiff.reader_bytes(&format)?);
    }
    let order = arrange(path, pages, options, description.declared.as_ref(), &format)?;
    let files = vec![TiffFile { path: path.to_owned(), stamp: tiff.stamp, decoders: Mutex::new(vec![tiff]) }];
    let stack = TiffStack::new(files, pages, format, order, &description, options)?;
    Ok(Box::new(TiffStack { reader_bytes, ..stack }))
}

/// Opens single-page files as planes, in the order given.
pub(crate) fn open_planes(paths: &[PathBuf], options: &OpenOptions) -> Result<Box<dyn Source>, ImportError> {
    let mut first: Option<(PageFormat, Description)> = None;
    let mut files = Vec::with_capacity(paths.len());
    let mut reader_bytes = 0;
    for path in paths {
        let mut tiff = OpenTiff::open(path)?;
        let format = tiff.format()?;
        tiff.check_data(path, 1)?;
        reader_bytes = tiff.reader_bytes(&format)?.max(reader_bytes);
        files.push(TiffFile { path: path.clone(), stamp: tiff.stamp, decoders: Mutex::default() });
        let description = tiff.description()?;
        match &first {
            Some((_, expected)) if description.calibration != expected.calibration => {
                let problem = format!(
                    "its values are calibrated (ImageJ's c0, c1, cf) in another way than those of {}; calibrate all alike",
                    paths[0].display()
                );
                return Err(ImportError::invalid(path, problem));
            }
            Some((_, expected)) if description.nodata != expected.nodata && options.nodata == NoData::OfFile => {
                let value = |nodata: Option<f64>| nodata.map_or("no value".into(), |value| value.to_string());
                let problem = format!(
                    "says with {} that pixels hold no data (GDAL_NODATA), but {} with {}; give one for all with `nodata`",
                    value(description.nodata),
                    paths[0].display(),
                    value(expected.nodata)
                );
                return Err(ImportError::options(path, problem));
            }
            Some((expected, _)) if format != *expected => {
                let problem = format!("is {format}, but {} is {expected}", paths[0].display());
                return Err(ImportError::invalid(path, problem));
            }
            Some(_) => {}
            None => first = Some((format, description)),
        }
    }
    let Some((format, mut description)) = first else {
        return Err(ImportError::options(Path::new(""), "no TIFF file given"));
    };
    // What a single plane's file says of a stack's shape is about the stack it was cut from.
    description.declared = None;
    let order = arrange(&paths[0], paths.len() as u32, options, None, &format)?;
    let stack = TiffStack::new(files, 1, format, order, &description, options)?;
    Ok(Box::new(TiffStack { reader_bytes, ..stack }))
}

/// ImageJ's form for stacks past 4 GiB: one directory, then all planes without a gap.
fn open_contiguous(
    path: &Path,
    tiff: &mut OpenTiff,
    format: &PageFormat,
    declared: &Declared,
    description: &Description,
    options: &OpenOptions,
) -> Result<Box<dyn Source>, ImportError> {
    let (scale, note) = description.scale(format.element, format.samples);
    let (offset, endian) = tiff.contiguous_start(path, format)?;
    let array = ArrayLayout {
        sizes: declared.sizes(format.width, format.height),
        axes: AxisOrder::of(&[&declared.page_axes[..], &[Axis::Y, Axis::X]].concat()),
        decode: Decode { element: format.element, endian, scale },
        offset,
    };
    let expected = array.body_bytes().map_err(|p| ImportError::invalid(path, p))?.saturating_add(offset);
    let file = MappedFile::open(path)?;
    let found = file.len() as u64;
    if found < expected {
        let problem = format!(
            "its description declares {} planes of {format}, so at least {expected} bytes are expected; found {found} ({} missing); \
             pass `axes` zyx to take only the page it has",
            declared.planes(),
            expected - found
        );
        return Err(ImportError::invalid(path, problem));
    }
    let mut info = SourceInfo { identity: identity("tiff contiguous", &[path])?, ..array.info() };
    description.place(&mut info);
    description.mark(&mut info, scale, options.nodata);
    info.notes.extend(note);
    Ok(Box::new(RawSource::new(file, array, info)?.with_losses(options.allow_lossy)?))
}

/// Finds the order of pages: by the caller's axes, else as declared, else all along z.
fn arrange(
    path: &Path,
    pages: u32,
    options: &OpenOptions,
    declared: Option<&Declared>,
    format: &PageFormat,
) -> Result<PageOrder, ImportError> {
    if let Some(axes) = &options.axes {
        let (page_axes, sizes) = arrange_as_told(axes, pages, options).map_err(|p| ImportError::options(path, p))?;
        return Ok(PageOrder { axes: page_axes, sizes: sizes_of_plane(sizes, format) });
    }
    let Some(declared) = declared else {
        let sizes = Sizes::from_ordered(&[Axis::Z], &[pages]);
        return Ok(PageOrder { axes: vec![Axis::Z], sizes: sizes_of_plane(sizes, format) });
    };
    let sizes = declared.page_sizes(format.samples).ok_or_else(|| {
        let problem = format!("declares {} channels, but each page has {} samples", declared.channels, format.samples);
        ImportError::invalid(path, problem)
    })?;
    let planes = sizes.extent.z as u64 * sizes.channels as u64 * sizes.times as u64;
    if planes != pages as u64 {
        let problem = format!(
            "its description declares {planes} planes ({} along z, {} channels, {} time steps), but it holds {pages} pages; \
             pass `axes` zyx to take the pages as they are",
            sizes.extent.z, sizes.channels, sizes.times
        );
        return Err(ImportError::invalid(path, problem));
    }
    Ok(PageOrder { axes: declared.page_axes.clone(), sizes: sizes_of_plane(sizes, format) })
}

/// Page axes and sizes by the caller's axes: the one size that was not given follows from the number of pages.
fn arrange_as_told(axes: &AxisOrder, pages: u32, options: &OpenOptions) -> Result<(Vec<Axis>, Sizes), String> {
    let [page_axes @ .., Axis::Y, Axis::X] = axes.axes() else {
        return Err(format!("axes '{axes}' do not end in yx, the order within a TIFF page"));
    };
    let given = |axis| match axis {
        Axis::T => options.times,
        Axis::C => options.channels,
        _ => None,
    };
    let known: u64 = page_axes.iter().filter_map(|&a| given(a)).map(u64::from).product();
    let unknown: Vec<Axis> = page_axes.iter().copied().filter(|&a| given(a).is_none()).collect();
    let rest = (pages as u64).checked_div(known).unwrap_or(0) as u32;
    let fits = rest as u64 * known == pages as u64;
    match unknown[..] {
        [] if known == pages as u64 => {}
        [_] if fits => {}
        [] | [_] => return Err(format!("{pages} pages do not divide into axes '{axes}' of the given sizes")),
        _ => {
            return Err(format!(
                "axes '{axes}' leave several sizes open for {pages} pages; give `channels` and `times` as well"
            ));
        }
    }
    let sizes: Vec<u32> = page_axes.iter().map(|&a| given(a).unwrap_or(rest)).collect();
    Ok((page_axes.to_vec(), Sizes::from_ordered(page_axes, &sizes)))
}

fn sizes_of_plane(mut sizes: Sizes, format: &PageFormat) -> Sizes {
    sizes.extent.x = format.width;
    sizes.extent.y = format.height;
    sizes
}

/// How the channels of photographs look: red, green and blue over all values of the type; what follows them says how opaque a pixel is, and is
/// black.
fn photograph(info: &SourceInfo, samples: u16) -> Vec<ChannelLook> {
    let whole = (!info.voxel_type.is_float()).then(|| info.voxel_type.limits());
    let parts = [("red", [255, 0, 0]), ("green", [0, 255, 0]), ("blue", [0, 0, 255]), ("opacity", [0; 3])];
    let look = |channel: u32| {
        let (name, color) = parts[(channel as usize % samples as usize).min(3)];
        ChannelLook { name: Some(name.into()), color: Some(color), window: whole.map(Into::into) }
    };
    (0..info.channels).map(look).collect()
}

impl TiffStack {
    fn new(
        files: Vec<TiffFile>,
        pages_per_file: u32,
        format: PageFormat,
        order: PageOrder,
        description: &Description,
        options: &OpenOptions,
    ) -> Result<Self, ImportError> {
        let path = &files[0].path;
        let (scale, note) = description.scale(format.element, format.samples);
        let decode = Decode { element: format.element, endian: Endian::native(), scale };
        let sizes = Sizes { channels: order.sizes.channels.saturating_mul(format.samples as u32), ..order.sizes };
        sizes.checked_bytes(format.element.bytes()).map_err(|p| ImportError::invalid(path, p))?;
        let paths: Vec<&Path> = files.iter().map(|f| f.path.as_path()).collect();
        let mut info = SourceInfo {
            identity: identity(&format!("tiff {:?}", order.axes), &paths)?,
            ..SourceInfo::plain(sizes, decode.voxel_type())
        };
        description.place(&mut info);
        description.mark(&mut info, scale, options.nodata);
        info.notes.extend(note);
        if format.is_rgb {
            info.channel_looks = photograph(&info, format.samples);
        }
        if format.samples > 1 {
            info.notes.push(format!("Each page holds {} samples a pixel; they are read as channels.", format.samples));
        }
        let mut stack = Self { info, format, decode, files, pages_per_file, order, reader_bytes: 0 };
        stack.count_losses(options.allow_lossy)?;
        Ok(stack)
    }

    /// Counts what voxels lose, in all pages; an error if something is lost that must not be.
    fn count_losses(&mut self, allowed: bool) -> Result<(), ImportError> {
        let mut census: Option<Losses> = None;
        for (i, file) in (0..).zip(&self.files) {
            match &mut census {
                Some(losses) => losses.next_file(&file.path),
                none => *none = Losses::may_occur(&file.path, self.decode, allowed),
            }
            let Some(losses) = &mut census else { return Ok(()) };
            for page in 0..self.pages_per_file {
                let page = i * self.pages_per_file as u64 + page as u64;
                self.with_page(page, |tiff| tiff.each_chunk(&self.format, |samples| losses.see(samples)))?;
            }
        }
        let note = census.map(|losses| losses.note());
        self.info.notes.extend(note);
        Ok(())
    }

    /// Runs `f` on a decoder of the page's file that stands at the page.
    fn with_page(
        &self,
        page: u64,
        f: impl FnOnce(&mut OpenTiff) -> Result<(), ImportError>,
    ) -> Result<(), ImportError> {
        let file = &self.files[(page / self.pages_per_file as u64) as usize];
        let page = (page % self.pages_per_file as u64) as u32;
        // A poisoned lock holds decoders all the same: nothing is changed while it is held but the list.
        let rest = || file.decoders.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
        let idle = rest().pop();
        let read = || {
            let mut tiff = idle.map_or_else(|| OpenTiff::open(&file.path), Ok)?;
            tiff.seek(page)?;
            if tiff.format()? != self.format {
                let problem = format!("page {} is of another kind than when the file was opened", page + 1);
                return Err(ImportError::invalid(&file.path, problem));
            }
            f(&mut tiff)?;
            Ok(tiff)
        };
        let tiff = read();
        // What was read, an error too, is of the file whose pages were checked, or of none.
        file.stamp.check(&file.path)?;
        let tiff = tiff?;
        // With one page per file there may be more files than a process may hold open.
        if self.pages_per_file > 1 {
            rest().push(tiff.rest());
        }
        Ok(())
    }
}

impl Source for TiffStack {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn access(&self) -> Access {
        Access::Planes
    }

    fn reader_bytes(&self) -> u64 {
        self.reader_bytes
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        let samples = self.format.samples as u32;
        let plane_bytes = out.len() / region.extent().z as usize;
        for (z, plane) in (region.min.z..).zip(out.chunks_exact_mut(plane_bytes)) {
            let page = self.order.page(time, channel / samples, z);
            self.with_page(page, |tiff| {
                tiff.read_rectangle(&self.format, channel % samples, self.decode, region, plane)
            })?;
        }
        Ok(())
    }
}
