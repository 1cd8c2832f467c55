//! Entry point for inputs: opens the reader of their format, joins files, and applies the user's overrides.

use crate::batches::{self, MOST_THREADS};
use crate::channels::{Channels, NamedArray};
use crate::component::Component;
use crate::described::Described;
use crate::doubles::{check_folders, check_named_once, check_pairs, check_series};
use crate::element::Endian;
use crate::error::{ImportError, Result};
use crate::file_order::{FileList, in_natural_order};
use crate::folder::files_of;
use crate::format::Format;
use crate::format_of::{READ, format_of};
use crate::grids::{Grid, GridList, Grids};
use crate::mirrored::{Mirrored, axes_in_words};
use crate::note::Note;
use crate::options::{FileOrder, Gaps, NoData, OpenOptions};
use crate::pattern;
use crate::pipe;
use crate::raw::{RawLayout, RawSource};
use crate::series::{Series, StepFile};
use crate::source::{Source, SourceInfo};
use crate::taken::take;
use crate::time::override_time;
use crate::variable::{check_inputs, split_variable};
use crate::{
    bov, dicom, envi, grids, hdf5, meta_image, mrc, netcdf, nifti, npy, npz, nrrd, pictures, raw_text, tiff_stack, vtk,
    zarr,
};
use brickyard_volume::counted;
use std::collections::HashSet;
use std::path::{Path, PathBuf};

/// Advice for duplicated files in a list.
const AS_NAMED: &str = ", or pass `order` given to take the files as they are named";

/// Opens an input: a file, a list of files, a folder of files of one format, or a pattern of file names, with `*` and `?` or with one number
/// as `%04d`. Several files are one time step each or, for pictures and single-page TIFF files, one plane each, in the order [`OpenOptions::order`]. DICOM
/// files must be of one series, and are sorted by the positions in their headers.
///
/// # Errors
/// If the input cannot be read. The message names the file, the reason and the helpful option of [`OpenOptions`], in backticks.
pub fn open(inputs: &[PathBuf], options: &OpenOptions) -> Result<Box<dyn Source>, ImportError> {
    // A component is one of the values as they are.
    let to_voxel_type = options.to_voxel_type.filter(|_| options.component.is_none());
    let held_as = options.held_as.filter(|_| options.to_voxel_type == to_voxel_type);
    let whole = OpenOptions { to_voxel_type, held_as, ..options.clone() };
    let source = match options.channel_arrays.is_empty() {
        true => open_input(inputs, &whole)?,
        false => Box::new(Channels::new(open_arrays(inputs, &whole)?, options)?),
    };
    let path = inputs.first().map_or(Path::new("input"), PathBuf::as_path);
    let source = match &options.component {
        None => source,
        Some(component) => Box::new(Component::new(source, component, path, &whole)?),
    };
    Ok(told(take(source, options, path)?, options))
}

/// Opens several arrays, to become the channels of one volume.
fn open_arrays(inputs: &[PathBuf], options: &OpenOptions) -> Result<Vec<NamedArray>> {
    let arrays = &options.channel_arrays;
    check_inputs(inputs, arrays)?;
    let mut parts = Vec::with_capacity(arrays.len());
    for array in arrays {
        let (inputs, alone) = array.opening(inputs, options);
        let path = inputs.first().cloned().unwrap_or_default();
        parts.push(NamedArray { name: array.name.clone(), path, source: open_input(&inputs, &alone)? });
    }
    Ok(parts)
}

/// Opens one array, or a list of grids.
fn open_input(inputs: &[PathBuf], options: &OpenOptions) -> Result<Box<dyn Source>> {
    match inputs {
        [list] if options.shape.is_none() && grids::is_list(list)? => open_grids(list, options),
        _ => open_volume(inputs, options),
    }
}

/// Opens the grids of a list as one volume.
fn open_grids(path: &Path, options: &OpenOptions) -> Result<Box<dyn Source>> {
    check_used(Format::Grids, path, options)?;
    let list = GridList::read(path)?;
    let mut all = Vec::with_capacity(list.entries.len());
    for entry in &list.entries {
        let source = open_volume(std::slice::from_ref(&entry.input), &list.options(entry, options)?)?;
        all.push(Grid::new(&list, entry, source)?);
    }
    let source = Grids::new(&list, all, options)?;
    list.check()?;
    overridden(Box::new(source), None, path, options)
}

/// Opens one array: of one file, or of several as steps or planes.
fn open_volume(inputs: &[PathBuf], options: &OpenOptions) -> Result<Box<dyn Source>> {
    let (inputs, options) = &split_variable(inputs, options)?;
    if let [stream] = &inputs[..]
        && pipe::is_pipe(stream)
    {
        return open_pipe(stream, options);
    }
    let Named { paths, is_folder: folder, is_unordered: unordered } = paths_of(inputs, options)?;
    // The given order is that of the steps, not of the files in a folder that forms one step.
    let order = options.order.filter(|order| *order != FileOrder::Given || !options.is_step);
    let format = format_of(&paths[0], options)?;
    batches::each(
        &paths[1..],
        MOST_THREADS,
        |path| format_of(path, options),
        |path, found| match found? == format {
            true => Ok(()),
            false => Err(ImportError::options(path, format!("is of another format than {}", paths[0].display()))),
        },
    )?;
    check_used(format, &paths[0], options)?;
    match (format, order) {
        (Format::Dicom, _) => check_named_once(&paths, "")?,
        (_, Some(FileOrder::Given)) => {}
        _ if unordered => check_named_once(&paths, ", or name all files and pass `order` given")?,
        _ => check_named_once(&paths, AS_NAMED)?,
    }
    if format == Format::Nifti {
        check_pairs(&paths)?;
    }
    let is_told = options.axes.is_some() || order.is_some();
    let is_set = format == Format::Tiff && paths.len() > 1 && !is_told && tiff_stack::is_whole_set(&paths)?;
    let (paths, order_note) = match format {
        Format::Dicom if order.is_some() && !options.is_step => {
            let problem = "`order`: DICOM slices are ordered by their positions; leave it out";
            return Err(ImportError::options(&paths[0], problem));
        }
        Format::Dicom => (in_natural_order(&paths), None),
        _ if is_set => {
            let note = format!("The {} files are one set: the OME-XML places their planes.", paths.len());
            (in_natural_order(&paths)[..1].to_vec(), Some(note))
        }
        _ if unordered || paths.len() > 1 => {
            let are_planes = match format {
                Format::Picture(_) => true,
                Format::Tiff => !tiff_stack::has_several_planes(&paths[0], options)?,
                _ => false,
            };
            let list = match unordered {
                true => FileList::of_folder(&inputs[0], &paths, order, are_planes)?,
                false => FileList::of_list(&paths, order, are_planes)?,
            };
            (list.paths, Some(list.note))
        }
        _ => (paths, None),
    };
    let source = match (format, &paths[..]) {
        (Format::Dicom, paths) if folder || paths.len() > 1 => dicom::open_series(paths, folder, options)?,
        (Format::Tiff, [_, _, ..]) => open_tiffs(&paths, options)?,
        (Format::Picture(kind), paths) => pictures::open(paths, kind, options)?,
        (Format::Tiff, [path]) if is_set => tiff_stack::open_file(path, options, true)?,
        (_, [path]) => open_one(path, format, options)?,
        _ => open_steps(&paths, format, options)?,
    };
    overridden(source, order_note, &paths[0], options)
}

/// The files that inputs name.
struct Named {
    paths: Vec<PathBuf>,
    is_folder: bool,
    /// Whether nobody has put them in order.
    is_unordered: bool,
}

/// Finds the files of a folder, a pattern or a list.
fn paths_of(inputs: &[PathBuf], options: &OpenOptions) -> Result<Named> {
    let named = |paths, is_folder, is_unordered| Named { paths, is_folder, is_unordered };
    Ok(match inputs {
        [] => return Err(ImportError::options(Path::new("input"), "none given")),
        [folder] if folder.is_dir() && !zarr::is_zarr(folder) => named(files_of(folder, options, READ)?, true, true),
        [one] => match pattern::expand(one)? {
            Some(files) => named(files, false, true),
            None => named(vec![one.clone()], false, false),
        },
        files => named(files.to_vec(), false, false),
    })
}

/// Opens a stream of raw voxels.
fn open_pipe(stream: &Path, options: &OpenOptions) -> Result<Box<dyn Source>> {
    check_used(Format::Raw, stream, options)?;
    let problem = "a stream does not describe its voxels; pass `shape` X,Y,Z and `voxel_type`";
    let layout = RawLayout::of(options).ok_or_else(|| ImportError::options(stream, problem))?;
    let source = pipe::open(stream, &layout, options)?.with_losses(None, options)?;
    overridden(Box::new(source), None, stream, options)
}

/// A source under the user's description, where there is one.
fn overridden(
    source: Box<dyn Source>,
    order_note: Option<String>,
    path: &Path,
    options: &OpenOptions,
) -> Result<Box<dyn Source>> {
    let source = turned_as_before(source, path, options)?;
    let mut info = source.info().clone();
    info.notes.extend(order_note.map(Note::new));
    redescribe(&mut info, options, path)?;
    override_nodata(&mut info, path, options.nodata)?;
    info.notes.retain(|note| !options.settle(note));
    Ok(Box::new(Described { info, source, first: 0 }))
}

/// A source with the note on its files' word, where that counts, and every other note once.
fn told(source: Box<dyn Source>, options: &OpenOptions) -> Box<dyn Source> {
    let mut info = source.info().clone();
    info.notes.extend(info.kind.note().filter(|_| options.are_labels.is_none()));
    let mut seen = HashSet::new();
    info.notes.retain(|note| seen.insert(note.to_string()) || note.changed() > 0);
    Box::new(Described { info, source, first: 0 })
}

/// Turns voxels without a place of their own as those of the steps before, from which they take it: voxels of one number in their files lie
/// in one place, as in channels joined.
///
/// # Errors
/// If the caller gives them a place: in which order they are meant is not known.
fn turned_as_before(source: Box<dyn Source>, path: &Path, options: &OpenOptions) -> Result<Box<dyn Source>> {
    let turned = options.held_as.map_or([false; 3], |held| held.turned);
    let own = source.info();
    if own.turned == turned || own.has_place() {
        return Ok(source);
    }
    // By the caller's word, the file runs as the store does.
    if options.flip == Some([false; 3]) {
        let info = SourceInfo { turned, ..own.clone() };
        return Ok(Box::new(Described { info, source, first: 0 }));
    }
    let axes = axes_in_words(turned);
    if options.spacing.is_some() || options.origin.is_some() {
        let problem = format!(
            "its voxels come in the file's order, but those of the steps before turned round along {axes}, as their coordinates \
             descend: leave the place to the store, without `spacing` and `origin`"
        );
        return Err(ImportError::options(path, problem));
    }
    let mut info = SourceInfo { turned, ..own.clone() };
    info.notes.push(Note::new(format!(
        "The voxels have no place of their own: they take that of the steps before, and are turned round along {axes} as those are; \
         `flip` none takes them in the order of the store."
    )));
    Ok(Box::new(Described { info, source: Mirrored::turned(source, turned), first: 0 }))
}

/// Replaces spacing, origin, units and times of a description by the caller's, as far as given: once, as lengths in several units are converted. Errors
/// name `path`.
///
/// # Errors
/// If one of them cannot be, or does not fit the description.
pub fn redescribe(info: &mut SourceInfo, options: &OpenOptions, path: &Path) -> Result<(), ImportError> {
    options.override_place(info, path)?;
    options.override_units(info, path)?;
    override_time(info, path, options)
}

/// Checks that a folder can be opened: it holds files of one format. Costs a read of the first bytes of each file.
///
/// # Errors
/// As for [`open`], if it cannot.
pub fn check_folder(folder: &Path) -> Result<(), ImportError> {
    if zarr::is_zarr(folder) {
        return Ok(());
    }
    files_of(folder, &OpenOptions::default(), READ).map(|_| ())
}

/// Puts files and folders of one time step each in order, as [`open`] does with a list; returns them, and a sentence about the order. Open
/// each with the same options and [`OpenOptions::is_step`].
///
/// # Errors
/// If a file is named twice, or the numbers in the names have gaps or count more than steps, unless the caller sets an order. In any order: if
/// two files are one image or of one series, or a file lies in a listed folder.
pub fn order_steps(paths: &[PathBuf], options: &OpenOptions) -> Result<(Vec<PathBuf>, String), ImportError> {
    if options.order != Some(FileOrder::Given) {
        check_named_once(paths, AS_NAMED)?;
    }
    check_folders(paths)?;
    // Unreadable files are reported on opening.
    let is_of = |path: &&PathBuf, format| path.is_file() && format_of(path, options).is_ok_and(|of| of == format);
    check_pairs(paths.iter().filter(|path| is_of(path, Format::Nifti)))?;
    check_series(paths.iter().filter(|path| is_of(path, Format::Dicom)))?;
    let FileList { paths, note } = FileList::of_list(paths, options.order, false)?;
    Ok((paths, note))
}

fn open_one(path: &Path, format: Format, options: &OpenOptions) -> Result<Box<dyn Source>> {
    Ok(match format {
        Format::Raw => Box::new(open_raw(path, options)?),
        Format::RawText => Box::new(raw_text::open(path, options)?),
        Format::Npy => Box::new(npy::open(path, options)?),
        Format::Npz => Box::new(npz::open(path, options)?),
        Format::Mrc => Box::new(mrc::open(path, options)?),
        Format::Envi => Box::new(envi::open(path, options)?),
        Format::Bov => Box::new(bov::open(path, options)?),
        Format::Nifti => Box::new(nifti::open(path, options)?),
        Format::Nrrd => Box::new(nrrd::open(path, options)?),
        Format::MetaImage => Box::new(meta_image::open(path, options)?),
        Format::Vtk => vtk::open(path, options)?,
        Format::Pvd => vtk::open_collection(path, options)?,
        Format::Tiff => tiff_stack::open_file(path, options, !options.is_step)?,
        Format::Picture(kind) => pictures::open(&[path.to_owned()], kind, options)?,
        Format::Dicom => dicom::open_file(path, options)?,
        Format::Hdf5 => hdf5::open(path, options)?,
        Format::NetCdf => netcdf::open(path, options)?,
        Format::Bdv => hdf5::open_spim_data(path, options)?,
        Format::Zarr => zarr::open(path, options)?,
        Format::Grids => return Err(grids::nested(path)),
    })
}

fn open_steps(paths: &[PathBuf], format: Format, options: &OpenOptions) -> Result<Box<dyn Source>> {
    let check = |path: &Path| match format {
        Format::Nifti => nifti::check(path, options),
        Format::Vtk => vtk::check(path, options),
        _ => open_step(path, format, options).map(|source| StepFile::of(&*source)),
    };
    let again = OpenOptions { is_looked_at: true, ..options.clone() };
    let open = move |path: &Path| open_step(path, format, &again);
    Ok(Box::new(Series::new(paths, options, check, Box::new(open))?))
}

/// Opens one file of several, without other files it names.
fn open_step(path: &Path, format: Format, options: &OpenOptions) -> Result<Box<dyn Source>> {
    match format {
        Format::Tiff => tiff_stack::open_file(path, options, false),
        _ => open_one(path, format, options),
    }
}

fn open_raw(path: &Path, options: &OpenOptions) -> Result<RawSource> {
    let Some(layout) = RawLayout::of(options) else {
        let bytes = std::fs::metadata(path).map_err(ImportError::io(path))?.len();
        let bytes = counted(bytes, "byte");
        let problem =
            format!("a raw file of {bytes} does not describe its voxels; pass `shape` X,Y,Z and `voxel_type`");
        return Err(ImportError::options(path, problem));
    };
    RawSource::mapped(path, &layout)?.with_losses(None, options)
}

/// Opens several TIFF files: planes if each has one page, time steps if each has more.
fn open_tiffs(paths: &[PathBuf], options: &OpenOptions) -> Result<Box<dyn Source>> {
    let are_stacks = tiff_stack::has_several_planes(&paths[0], options)?;
    for path in &paths[1..] {
        if tiff_stack::has_several_planes(path, options)? != are_stacks {
            let count = |many| if many { "several planes" } else { "one plane" };
            let problem = format!("has {}, but {} has {}", count(!are_stacks), paths[0].display(), count(are_stacks));
            return Err(ImportError::invalid(path, problem));
        }
    }
    if !are_stacks {
        return tiff_stack::open_planes(paths, options);
    }
    open_steps(paths, Format::Tiff, options)
}

/// Refuses options without effect on the format: their caller expects other voxels.
fn check_used(format: Format, path: &Path, options: &OpenOptions) -> Result<()> {
    let has_planes = matches!(format, Format::Tiff | Format::Picture(_));
    let has_axes = has_planes
        || matches!(format, Format::Raw | Format::Npy | Format::Npz | Format::Hdf5 | Format::NetCdf | Format::Zarr);
    let counts_axes = format == Format::Raw || has_planes && options.axes.is_some();
    let of_axes = if has_planes { "raw files, and of TIFF and pictures with `axes`" } else { "raw files" };
    let (raw, is_raw) = ("raw files, with `shape`", format == Format::Raw);
    let said = [
        ("voxel_type", options.voxel_type.is_some(), is_raw, raw),
        ("endian", options.endian != Endian::default(), is_raw, raw),
        ("offset", options.offset.is_some(), is_raw, raw),
        ("step_bytes", options.step_bytes.is_some(), is_raw, raw),
        ("channel_bytes", options.channel_bytes.is_some(), is_raw, raw),
        ("channels", options.channels.is_some(), counts_axes, of_axes),
        ("times", options.times.is_some(), counts_axes, of_axes),
        ("axes", options.axes.is_some(), has_axes, "raw files, .npy, .npz, HDF5, NetCDF, Zarr, TIFF and pictures"),
        (
            "variable",
            options.variable.is_some(),
            matches!(
                format,
                Format::Bdv
                    | Format::Dicom
                    | Format::Grids
                    | Format::Hdf5
                    | Format::NetCdf
                    | Format::Npz
                    | Format::Vtk
                    | Format::Pvd
                    | Format::Zarr
            ),
            "files of several arrays (HDF5, NetCDF, .npz, VTK, Zarr) and DICOM series",
        ),
        ("gaps", options.gaps != Gaps::default(), matches!(format, Format::Dicom | Format::Grids), "DICOM series"),
    ];
    let Some((name, _, _, of)) = said.into_iter().find(|(_, is_said, is_used, _)| *is_said && !is_used) else {
        return Ok(());
    };
    let file = match format {
        Format::Dicom => "DICOM".into(),
        format => format!("a {} file", format.name()),
    };
    let way_on = if name == "voxel_type" { "leave it out, or convert with `to_voxel_type`" } else { "leave it out" };
    let problem = format!("`{name}` is for {of}, not for {file}; {way_on}");
    Err(ImportError::options(path, problem))
}

/// Replaces the file's no-data value with the user's.
fn override_nodata(info: &mut SourceInfo, path: &Path, nodata: NoData) -> Result<()> {
    let voxel_type = info.voxel_type;
    let (low, high) = voxel_type.limits();
    let value = match nodata {
        NoData::OfFile => return Ok(()),
        NoData::None => None,
        NoData::Value(value) if !voxel_type.holds(info.narrowed(value)) => {
            let (kind, [low, high]) = match voxel_type.is_float() {
                true => ("numbers", [low, high].map(|limit| format!("{limit:e}"))),
                false => ("whole numbers", [low, high].map(|limit| limit.to_string())),
            };
            let problem =
                format!("`nodata` {value}: voxels are {voxel_type}, expected one of the {kind} from {low} to {high}");
            return Err(ImportError::options(path, problem));
        }
        NoData::Value(value) if voxel_type.is_float() && value != 0.0 && value as f32 == 0.0 => {
            let problem = format!("`nodata` {value:e}: voxels are f32, in which it is 0");
            return Err(ImportError::options(path, problem));
        }
        // The least float may have been given in fewer digits.
        NoData::Value(value) => Some(value.clamp(low, high)),
    };
    (info.nodata, info.knows_nodata) = (value, false);
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::testing::{Field, assert_boxes, temp_file};
    use brickyard_volume::Extent;
    use brickyard_volume::VoxelType;
    use glam::DVec3;
    use proptest::prelude::*;

    fn raw_options(field: Field) -> OpenOptions {
        let [x, y, z, c, t] = field.sizes;
        OpenOptions {
            shape: Some(Extent::new(x, y, z)),
            voxel_type: Some(field.voxel_type.into()),
            channels: Some(c),
            times: Some(t),
            ..OpenOptions::default()
        }
    }

    fn refusal(path: &Path, options: &OpenOptions) -> String {
        open(&[path.to_owned()], options).err().unwrap().to_string()
    }

    /// A dangling link stands for any file that cannot be examined.
    #[test]
    fn a_slice_that_cannot_be_looked_at_is_not_left_out() {
        let folder = tempfile::tempdir().unwrap();
        std::os::unix::fs::symlink("nowhere", folder.path().join("p_2.tif")).unwrap();
        assert!(refusal(folder.path(), &OpenOptions::default()).contains("p_2.tif: No such file"));
        assert!(crate::dicom_files::files_in(folder.path()).unwrap_err().to_string().contains("p_2.tif: No such file"));
    }

    #[test]
    fn a_raw_file_in_one_piece_or_one_per_step() {
        let field = Field { sizes: [7, 5, 4, 2, 3], voxel_type: VoxelType::U16 };
        let bytes = field.bytes("tczyx", false);
        let (folder, path) = temp_file("all.dat", &bytes);
        assert_boxes(&*open(&[path], &raw_options(field)).unwrap(), field);
        let paths: Vec<PathBuf> = (8..11).map(|i| folder.path().join(format!("s{i}.raw"))).collect();
        for (path, step) in paths.iter().zip(bytes.chunks(bytes.len() / 3)) {
            std::fs::write(path, step).unwrap();
        }
        // As a shell sorts them: s10, s8, s9.
        let shuffled = [paths[2].clone(), paths[0].clone(), paths[1].clone()];
        let options = OpenOptions { times: None, ..raw_options(field) };
        let source = open(&shuffled, &options).unwrap();
        assert_boxes(&*source, field);
        assert!(source.info().notes[0].contains("from s8.raw to s10.raw"));
        let message =
            open(&shuffled, &raw_options(Field { sizes: [7, 5, 2, 2, 2], ..field })).err().unwrap().to_string();
        assert!(message.contains("one per time step"), "{message}");
    }

    /// Bytes of a `.npy` file of zeros.
    fn npy(element: &str, shape: &str, bytes: usize) -> Vec<u8> {
        let header = format!("{{'descr': '{element}', 'fortran_order': False, 'shape': {shape}, }}");
        [b"\x93NUMPY\x01\x00", &(header.len() as u16).to_le_bytes()[..], header.as_bytes(), &vec![0; bytes]].concat()
    }

    #[test]
    fn options_that_a_format_has_no_use_for_are_refused() {
        let (_folder, path) = temp_file("a.npy", &npy("<f4", "(2, 3, 4)", 96));
        let plain = OpenOptions::default();
        assert!(open(std::slice::from_ref(&path), &plain).is_ok());
        let useless = [
            ("voxel_type", OpenOptions { voxel_type: Some(VoxelType::F32.into()), ..plain.clone() }),
            ("endian", OpenOptions { endian: Endian::Big, ..plain.clone() }),
            ("offset", OpenOptions { offset: Some(0), ..plain.clone() }),
            ("step_bytes", OpenOptions { step_bytes: Some(9), ..plain.clone() }),
            ("channel_bytes", OpenOptions { channel_bytes: Some(9), ..plain.clone() }),
            ("channels", OpenOptions { channels: Some(2), ..plain.clone() }),
            ("times", OpenOptions { times: Some(2), ..plain.clone() }),
            ("gaps", OpenOptions { gaps: Gaps::Blank, ..plain.clone() }),
        ];
        for (name, options) in useless {
            let message = refusal(&path, &options);
            assert!(message.contains(&format!("`{name}` is for ")), "{message}");
        }
        let tiny = OpenOptions { nodata: NoData::Value(1e-300), ..plain.clone() };
        assert!(refusal(&path, &tiny).contains("in which it is 0"));
        let least = OpenOptions { nodata: NoData::Value(-3.40282347e38), ..plain.clone() };
        assert_eq!(open(std::slice::from_ref(&path), &least).unwrap().info().nodata, Some(f64::from(f32::MIN)));
        assert!(refusal(&path, &OpenOptions { nodata: NoData::Value(-3.5e38), ..plain }).contains("expected one"));
    }

    #[test]
    fn steps_that_disagree_name_the_odd_one() {
        let (folder, first) = temp_file("a1.npy", &npy("|u1", "(2, 3, 4)", 24));
        let second = folder.path().join("a2.npy");
        std::fs::write(&second, npy("|u1", "(2, 4, 3)", 24)).unwrap();
        let message = open(&[first, second], &OpenOptions::default()).err().unwrap().to_string();
        assert!(message.contains("a2.npy: is 3,4,2 u8") && message.contains("4,3,2 u8"), "{message}");
    }

    #[test]
    fn the_user_knows_better_than_the_file() {
        let field = Field { sizes: [2, 2, 2, 1, 1], voxel_type: VoxelType::U8 };
        let (_folder, path) = temp_file("a.raw", &field.bytes("zyx", false));
        let plain = open(std::slice::from_ref(&path), &raw_options(field)).unwrap();
        assert!(!plain.info().calibrated);
        let told = OpenOptions {
            spacing: Some(DVec3::new(0.5, 0.5, 2.0)),
            origin: Some(DVec3::new(-1.0, 0.0, 3.0)),
            unit: Some("micrometer".into()),
            ..raw_options(field)
        };
        let source = open(std::slice::from_ref(&path), &told).unwrap();
        let geometry = &source.info().geometry;
        assert!(source.info().calibrated);
        assert_eq!((geometry.spacing, geometry.origin), (told.spacing.unwrap(), told.origin.unwrap()));
        assert_eq!(geometry.unit, told.unit);
        let units = |unit: &str| OpenOptions { unit: Some(unit.into()), ..told.clone() };
        let geometry = open(std::slice::from_ref(&path), &units("um,um,mm")).unwrap().info().geometry.clone();
        assert_eq!((geometry.spacing.z, geometry.origin.z, geometry.unit), (2000.0, 3000.0, told.unit.clone()));
        let geometry = open(std::slice::from_ref(&path), &units("degree,degree,hPa")).unwrap().info().geometry.clone();
        let kept = Some(["degree", "degree", "hPa"].map(String::from));
        assert_eq!((geometry.spacing, geometry.unit, geometry.axis_units), (told.spacing.unwrap(), None, kept));
        for bad in ["", "mm,mm", "a,b,c,d", "mm,,mm", "m\u{1b}m"] {
            assert!(refusal(&path, &units(bad)).contains("`unit`"), "{bad}");
        }
        for spacing in [DVec3::ZERO, DVec3::new(1.0, -1.0, 1.0), DVec3::NAN] {
            let bad = OpenOptions { spacing: Some(spacing), ..raw_options(field) };
            assert!(refusal(&path, &bad).contains("above 0"));
        }
    }

    #[test]
    fn values_have_the_users_unit_which_labels_cannot_have() {
        let field = Field { sizes: [2, 2, 2, 2, 1], voxel_type: VoxelType::U8 };
        let (_folder, path) = temp_file("a.raw", &field.bytes("czyx", false));
        let told = |unit: &str| OpenOptions { value_unit: Some(unit.into()), ..raw_options(field) };
        let source = open(std::slice::from_ref(&path), &told(" kg/m\u{b3}")).unwrap();
        let units: Vec<_> = source.info().channel_looks.iter().map(|look| look.unit.as_deref()).collect();
        assert_eq!(units, [Some("kg/m\u{b3}"); 2]);
        for bad in ["", "a\nb", &"x".repeat(65)] {
            assert!(refusal(&path, &told(bad)).contains("`value_unit`"), "{bad:?}");
        }
        assert!(refusal(&path, &OpenOptions { are_labels: Some(true), ..told("K") }).contains("labels have no unit"));
    }

    /// Lengths of a series are converted once, not once for its files and once for the whole.
    #[test]
    fn units_of_axes_are_converted_once_in_a_series() {
        let field = Field { sizes: [2, 2, 2, 1, 1], voxel_type: VoxelType::U8 };
        let (folder, first) = temp_file("a1.raw", &field.bytes("zyx", false));
        let second = folder.path().join("a2.raw");
        std::fs::write(&second, field.bytes("zyx", false)).unwrap();
        let options = OpenOptions { unit: Some("um,um,mm".into()), ..raw_options(field) };
        let source = open(&[first, second], &options).unwrap();
        assert_eq!(source.info().geometry.spacing, DVec3::new(1.0, 1.0, 1000.0));
    }

    #[test]
    fn what_is_missing_or_unknown_is_said() {
        let none = OpenOptions::default();
        let (folder, path) = temp_file("a.raw", &[0; 64]);
        let message = refusal(&path, &none);
        assert!(
            message.contains("64 bytes") && message.contains("`shape`") && message.contains("`voxel_type`"),
            "{message}"
        );
        let (_other, path) = temp_file("a.xyz", b"what is this");
        let message = refusal(&path, &none);
        assert!(message.contains(".npy") && message.contains("NIfTI") && message.contains("TIFF"), "{message}");
        assert!(matches!(open(&[folder.path().join("no.nii")], &none), Err(ImportError::Io { .. })));
        assert!(open(&[], &none).is_err());
    }

    proptest! {
        #![proptest_config(crate::testing::cases(300))]

        /// Damage leads to an error or wrong voxels, never to a panic.
        #[test]
        fn damaged_headers_do_not_panic(
            damage in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
            nifti in any::<bool>(),
        ) {
            let header = "{'descr': '<u2', 'fortran_order': False, 'shape': (2, 3, 4), }";
            let (name, mut bytes) = if nifti {
                let mut bytes = vec![0; 352 + 48];
                bytes[..4].copy_from_slice(&348i32.to_le_bytes());
                bytes[40..48].copy_from_slice(&[3, 0, 4, 0, 3, 0, 2, 0]);
                bytes[70..74].copy_from_slice(&[0, 2, 16, 0]);
                bytes[344..348].copy_from_slice(b"n+1\0");
                ("a.nii", bytes)
            } else {
                let length = [header.len() as u8, 0];
                ("a.npy", [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), &[7; 48]].concat())
            };
            for (place, value) in damage {
                let place = place.index(bytes.len().min(352));
                bytes[place] = value;
            }
            let (_folder, path) = temp_file(name, &bytes);
            let told = OpenOptions { allow_lossy: true, ..OpenOptions::default() };
            if let Ok(source) = open(&[path], &told) {
                let full = source.info().extent.full_box();
                let mut out = vec![0; full.extent().volume() as usize * source.info().voxel_type.bytes()];
                source.read_box(0, 0, full, &mut out).unwrap();
            }
        }
    }
}
