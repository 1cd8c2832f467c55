//! TIFF stack opening: finds the files and pages, and checks that they agree. Walks all directories once.

use super::arrange::arrange;
use super::description::{Declared, Description, OmeSays};
use super::ome_opening::{Opening, open_companion};
use super::ome_set::is_companion;
use super::page::{OpenTiff, PageFormat};
use super::thumbnails::Thumbnails;
use super::walk::{open_pages, refuse_problem};
use super::{Parts, TiffFile, TiffStack};
use crate::axes::{Axis, AxisOrder};
use crate::element::Decode;
use crate::error::{ImportError, Result};
use crate::mapped::MappedFile;
use crate::note::Note;
use crate::options::{NoData, OpenOptions};
use crate::raw::{ArrayLayout, RawSource, identity};
use crate::source::{Source, SourceInfo};
use crate::spacing;
use brickyard_volume::counted;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// Whether a TIFF file has more than one plane: several pages, apart from smaller copies and masks of others; or a stack behind a single
/// directory, unless `axes` describe the pages.
pub(crate) fn has_several_planes(path: &Path, options: &OpenOptions) -> Result<bool> {
    if is_companion(path)? {
        return Ok(true);
    }
    let mut tiff = OpenTiff::open(path)?;
    // The user's axes cover all pages.
    if options.axes.is_some() {
        return Ok(tiff.has_more_pages());
    }
    if !tiff.has_more_pages() {
        return holds_stack(&mut tiff);
    }
    // Smaller copies of the first page do not make it a stack.
    let (mut pages, first, mut thumbnails) = (1, tiff.format()?, Thumbnails::default());
    while tiff.has_more_pages() {
        pages += 1;
        tiff.next_page()?;
        let is_copy =
            tiff.is_copy_or_mask()? || tiff.small_size(&first)?.is_some_and(|size| thumbnails.add(size, pages) == 1);
        if !is_copy {
            return Ok(true);
        }
    }
    Ok(false)
}

/// Whether all, or most, planes of a described stack follow the data of the file's only directory. A page cut out of such a stack may have its
/// description, but not the planes.
fn holds_stack(tiff: &mut OpenTiff) -> Result<bool> {
    let format = tiff.format()?;
    let description = tiff.description(&format)?;
    let Some(declared) = description.declared.filter(|declared| declared.in_one_directory && declared.planes() > 1)
    else {
        return Ok(false);
    };
    if tiff.is_metamorph() {
        return Ok(true);
    }
    let Ok((start, _)) = tiff.contiguous_start(&format) else { return Ok(false) };
    let plane_bytes =
        u64::from(format.width) * u64::from(format.height) * (format.element.bytes() * format.samples as usize) as u64;
    // A truncated stack has more than half, and more than a plane: the missing part is reported on opening.
    let least = plane_bytes.saturating_mul(declared.planes().max(3)) / 2;
    // The directory lies before all planes, or behind them.
    let directory = tiff.decoder.ifd_pointer().map(|pointer| pointer.0).filter(|directory| *directory > start);
    let end = directory.unwrap_or(tiff.stamp.bytes);
    Ok(least.saturating_add(start) <= end)
}

/// Opens one TIFF file, of one page or several, with the rest of its OME set if it is in one; or the companion of such files. `is_alone`: it is
/// the only input.
pub(crate) fn open_file(path: &Path, options: &OpenOptions, is_alone: bool) -> Result<Box<dyn Source>> {
    if is_companion(path)? {
        return open_companion(path, options, is_alone);
    }
    let mut tiff = OpenTiff::open(path)?;
    let format = tiff.format()?;
    let mut description = tiff.description(&format)?;
    if options.axes.is_none() {
        refuse_problem(path, &description)?;
        if let Some(ome) = description.ome.take() {
            let opening = Opening { path, format, options, is_alone };
            return opening.ome(tiff, ome, description);
        }
        if let Some(declared) = &description.declared
            && declared.in_one_directory
            && declared.planes() > 1
            && !tiff.has_more_pages()
        {
            return open_contiguous(path, &mut tiff, &format, declared, &description, options);
        }
    }
    open_pages(tiff, format, &description, options)
}

/// Opens single-page files as planes, in the given order.
pub(crate) fn open_planes(paths: &[PathBuf], options: &OpenOptions) -> Result<Box<dyn Source>> {
    let mut first: Option<(PageFormat, Description)> = None;
    let mut files = Vec::with_capacity(paths.len());
    let (mut reader_bytes, mut with_copies) = (0, 0);
    for path in paths {
        let mut tiff = OpenTiff::open(path)?;
        with_copies += u64::from(tiff.has_more_pages());
        let format = tiff.format()?;
        tiff.check_data(1)?;
        reader_bytes = tiff.reader_bytes(&format)?.max(reader_bytes);
        let description = tiff.description(&format)?;
        if options.axes.is_none() && options.order.is_none() {
            check_is_no_part(path, &description)?;
        }
        files.push(TiffFile { path: path.clone(), stamp: tiff.stamp, pages: 1 });
        let Some((expected_format, expected)) = &first else {
            first = Some((format, description));
            continue;
        };
        let [own, other] = [&description, expected].map(|of| (of.spacing, of.unit));
        spacing::check_alike(path, own, &paths[0], other, options)?;
        let first_path = paths[0].display();
        let values = |of: &Description| (of.calibration.clone(), of.value_unit.clone());
        if values(&description) != values(expected) {
            let problem = format!(
                "its values are calibrated (ImageJ's c0, c1, cf, vunit; GDAL's scale, offset, unit) unlike those of \
                 {first_path}; calibrate all alike"
            );
            return Err(ImportError::invalid(path, problem));
        }
        if description.nodata != expected.nodata && options.nodata == NoData::OfFile {
            let [own, other] = [description.nodata, expected.nodata]
                .map(|nodata| nodata.map_or("no value".into(), |value| value.to_string()));
            let problem = format!(
                "marks pixels without data with {own} (GDAL_NODATA), but {first_path} with {other}; give one value for \
                 all with `nodata`"
            );
            return Err(ImportError::options(path, problem));
        }
        if format != *expected_format {
            let problem = format!("is {format}, but {first_path} is {expected_format}");
            return Err(ImportError::invalid(path, problem));
        }
    }
    let Some((format, mut description)) = first else {
        return Err(ImportError::options(Path::new(""), "no TIFF file given"));
    };
    if with_copies > 0 {
        let note =
            format!("Pages with smaller copies or masks of others are left out, in {}.", counted(with_copies, "file"));
        description.notes.push(Note::new(note));
    }
    // A stack's shape in a single plane's file is that of the stack it was cut from.
    description.declared = None;
    let (map, note) = arrange(&paths[0], 1, paths.len() as u32, options, None, &format)?;
    description.notes.extend(note);
    let parts = Parts { files, format, map, reader_bytes, idle: Mutex::default() };
    Ok(Box::new(TiffStack::new(parts, &description, options)?))
}

/// Refuses a file whose OME-XML names a set of files: its place in the set may not follow from its name.
fn check_is_no_part(path: &Path, description: &Description) -> Result<()> {
    let is_part = description.ome.as_ref().is_some_and(|ome| match &ome.says {
        OmeSays::Pixels(pixels) => pixels.parts.len() > 1,
        OmeSays::Elsewhere { .. } => true,
    });
    let problem = "is one of a set of files in its OME-XML, but the given files are not the set: name all files of the \
                   set, or one, or pass `axes` zyx to take the page of each file as a slice";
    if is_part { Err(ImportError::invalid(path, problem)) } else { Ok(()) }
}

/// Opens the form of ImageJ past 4 GiB, of tifffile on request, and of MetaMorph: one directory, then all planes without a gap.
fn open_contiguous(
    path: &Path,
    tiff: &mut OpenTiff,
    format: &PageFormat,
    declared: &Declared,
    description: &Description,
    options: &OpenOptions,
) -> Result<Box<dyn Source>> {
    if let Some(images) = declared.images.filter(|images| u64::from(*images) != declared.planes()) {
        let problem = format!(
            "its description has {images} images, but its channels, slices and frames make {}; pass `axes` zyx to take \
             only the page in its directory",
            declared.planes()
        );
        return Err(ImportError::invalid(path, problem));
    }
    let (scale, note) = description.scale(format, options.nodata);
    let (offset, endian) = tiff.contiguous_start(format)?;
    let mut sizes = declared.sizes([format.width, format.height]);
    let within = match (format.samples, format.planar) {
        (1, _) => &[Axis::Y, Axis::X][..],
        (samples, planar) if declared.channels == 1 => {
            sizes.channels = samples.into();
            if planar { &[Axis::C, Axis::Y, Axis::X] } else { &[Axis::Y, Axis::X, Axis::C] }
        }
        _ => return Err(ImportError::unsupported(path, "a stack in one directory of coloured channels")),
    };
    let page_axes = declared.page_axes.iter().copied().filter(|axis| format.samples == 1 || *axis != Axis::C);
    let array = ArrayLayout {
        sizes,
        axes: AxisOrder::of(&page_axes.chain(within.iter().copied()).collect::<Vec<_>>()),
        decode: Decode { element: format.element, endian, scale },
        offset,
    };
    let expected = array.body_bytes().map_err(|p| ImportError::invalid(path, p))?.saturating_add(offset);
    let file = MappedFile::open(path)?;
    let found = file.len() as u64;
    if found < expected {
        let (planes, missing) = (declared.planes(), expected - found);
        let problem = format!(
            "its description declares {planes} planes of {format}, so at least {expected} bytes are expected; found \
             {found} ({missing} missing); pass `axes` zyx to take its one page"
        );
        return Err(ImportError::invalid(path, problem));
    }
    let mut info = SourceInfo { identity: identity("tiff contiguous", &[path])?, ..array.info() };
    description.place(&mut info, format.element, scale);
    description.place_values(&mut info, scale, note);
    let source = RawSource::new(file, array, info)?.with_losses(description.nodata_value(scale), options)?;
    Ok(Box::new(source.described(|info| description.mark(info, scale, options.nodata))))
}
