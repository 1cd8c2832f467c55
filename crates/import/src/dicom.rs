//! DICOM series (CT, MR and the like): one slice per file, or enhanced files with a place for every frame.
//!
//! Opening reads all headers. Slices are sorted by position, never by name or number, and must be one evenly spaced stack of one series,
//! apart from missing ones left blank. Several at each position are channels and time steps. Voxels are rescaled values (Hounsfield units of a
//! CT): integers if slopes and intercepts are, else floats. If 16 stored bits and an intercept may not fit in 16 bits, opening decodes all slices
//! once to decide. Reading decodes whole slices on request, in the memory of one slice per thread.

mod attributes;
mod choice;
mod decode;
mod decode_bits;
mod dose;
#[cfg(test)]
mod dose_tests;
mod elements;
mod floats;
#[cfg(test)]
mod floats_tests;
mod fragments;
mod frames;
#[cfg(test)]
mod gap_tests;
mod header;
mod jpeg_lossless;
#[cfg(test)]
mod jpeg_lossless_tests;
#[cfg(test)]
mod lossy_tests;
mod mosaic;
#[cfg(test)]
mod mosaic_tests;
mod nuclear;
#[cfg(test)]
mod nuclear_tests;
mod pixels;
mod segmentation;
#[cfg(test)]
mod segmentation_tests;
mod stack;
#[cfg(test)]
mod tests;
mod unit;
#[cfg(test)]
mod unknown_tests;
mod volumes;
#[cfg(test)]
mod volumes_tests;
mod wanted;

use crate::axes::Sizes;
use crate::batches::{self, MOST_THREADS};
use crate::dicom_files::files_in;
use crate::element::smallest_type;
use crate::error::{ImportError, Result};
use crate::files::{first_bytes, folder_of, name_of};
use crate::labels::SaidKind;
use crate::note::{Note, Setting};
use crate::options::{HeldAs, NoData, OpenOptions};
use crate::placement;
use crate::raw::identity;
use crate::source::{Access, Source, SourceInfo};
use brickyard_volume::{ChannelLook, Extent, VoxelBox, VoxelType, counted, with_voxel_type};
use choice::{Chosen, choose};
use dicom_dictionary_std::{tags, uids};
use frames::Frames;
use glam::DVec3;
use header::Header;
use mosaic::Mosaic;
use pixels::Meaning;
use segmentation::{Segmentation, is_segmentation};
use stack::{Names, Placement, Rules, Slice, kinds};
use std::path::{Path, PathBuf};
use unit::value_unit;
use volumes::{Stacked, Volumes, tell_apart};

/// Most memory for frames decoded in search of the smallest voxel type: there is no memory budget yet.
const MOST_LOOKED_AT_BYTES: u64 = 256 << 20;

/// Most stacks listed in a message.
const MOST_LISTED: usize = 40;

/// Most bytes of a damaged file searched for the UID of its series.
const MOST_SEARCHED_BYTES: usize = 1 << 20;

/// A DICOM series as a source.
pub(crate) struct DicomSeries {
    info: SourceInfo,
    files: Vec<(Header, Frames)>,
    /// Slices, ascending along z.
    slices: Vec<Slice>,
    /// Index of the slice at each z of each channel of each time step; `None` where one is missing, whose voxels are all `blank`.
    places: Vec<Option<usize>>,
    blank: f64,
}

/// Opens a DICOM file. A single slice is joined by the rest of its series in the folder, as in most programs.
pub(crate) fn open_file(path: &Path, options: &OpenOptions) -> Result<Box<dyn Source>> {
    let header = Header::read(path)?;
    check_is_image(&header)?;
    let folder = folder_of(path);
    if stands_alone(&header) {
        let notes = if options.is_step { Vec::new() } else { others_of_series(&header, folder) };
        return open_chosen(vec![header], false, options, notes);
    }
    let mut series = Vec::new();
    let mut unread = Vec::new();
    let mut others = files_in(folder)?;
    others.retain(|other| other.file_name() != path.file_name());
    batches::each(
        &others,
        MOST_THREADS,
        |path| Header::read(path),
        |path, other| {
            match other {
                Ok(mut other) if is_image(&other) && other.series() == header.series() => {
                    other.share_values(&header);
                    series.push(other);
                }
                Ok(_) => {}
                Err(error) if is_of_the_file(&error) && !may_be_of(path, &header)? => unread.push(error),
                Err(error) => return Err(error),
            }
            Ok(())
        },
    )?;
    series.push(header);
    let mut notes = vec![Note::new(format!("{} files of the series are read from its folder.", series.len()))];
    if let Some(first) = unread.first() {
        let files = counted(unread.len() as u64, "DICOM file");
        let do_not = if unread.len() == 1 { "does not" } else { "do not" };
        let warning = format!("{files} beside it cannot be read and {do_not} name a series: left out. {first}");
        notes.push(Note::warning(warning));
    }
    open_chosen(series, true, options, notes)
}

/// Opens the files of one series among these, chosen by the options' `variable`. Localizers are left out of a whole folder or series
/// (`is_folder`).
fn open_chosen(
    headers: Vec<Header>,
    is_folder: bool,
    options: &OpenOptions,
    mut notes: Vec<Note>,
) -> Result<Box<dyn Source>> {
    let Chosen { mut headers, part, notes: others } = choose(headers, is_folder, options.variable.as_deref())?;
    notes.extend(others);
    let count = headers.len();
    let Some(at) = headers.iter().position(is_segmentation) else {
        return Ok(Box::new(DicomSeries::new(headers, part.as_deref(), options, notes)?));
    };
    if count > 1 {
        let (path, files) = (&headers[at].path, counted(count as u64, "file"));
        let problem = format!("is a segmentation in a series of {files}: each is a volume of its own; name one file");
        return Err(ImportError::options(path, problem));
    }
    Ok(Box::new(Segmentation::open(headers.swap_remove(at), part.as_deref(), options, notes)?))
}

/// Notes the other files of a multi-frame file's series in the same folder, if any can be read.
fn others_of_series(header: &Header, folder: &Path) -> Vec<Note> {
    let is_other = |path: &&PathBuf| path.file_name() != header.path.file_name();
    let is_of_it = |path: &&PathBuf| Header::read(path).is_ok_and(|it| is_image(&it) && it.series() == header.series());
    // Unreadable neighbours do not matter.
    let beside = files_in(folder).unwrap_or_default();
    let others = beside.iter().filter(is_other).filter(is_of_it).count() as u64;
    let files = counted(others, "file");
    let note = format!(
        "{files} more of its series in the folder, left out: name the files, or the folder, to read all frames."
    );
    if others > 0 { vec![Note::warning(note)] } else { Vec::new() }
}

fn is_of_the_file(error: &ImportError) -> bool {
    matches!(error, ImportError::Invalid { .. } | ImportError::Unsupported { .. })
}

/// Whether a file with an unreadable header may be of the same series: its first bytes contain the series' UID or are deflated, or there is no
/// UID.
fn may_be_of(path: &Path, header: &Header) -> Result<bool> {
    let Some(series) = header.text(tags::SERIES_INSTANCE_UID) else { return Ok(true) };
    let start = first_bytes(path, MOST_SEARCHED_BYTES)?;
    // A longer UID starting with this one differs.
    let goes_on = |byte: Option<&u8>| byte.is_some_and(|byte| byte.is_ascii_digit() || *byte == b'.');
    let has = |uid: &str| {
        let mut places = start.windows(uid.len()).enumerate().filter(|(_, bytes)| *bytes == uid.as_bytes());
        places.any(|(at, _)| !goes_on(start.get(at + uid.len())))
    };
    Ok(series.is_empty() || has(&series) || has(uids::DEFLATED_EXPLICIT_VR_LITTLE_ENDIAN))
}

/// Returns the series represented by a file, with the other slices in its folder; `None` for a file of several frames.
pub(crate) fn series_of(path: &Path) -> Result<Option<String>> {
    let header = Header::read(path)?;
    Ok((!stands_alone(&header)).then(|| header.series()))
}

/// Whether a file holds more than one slice of its series.
fn stands_alone(header: &Header) -> bool {
    header.number(tags::NUMBER_OF_FRAMES).is_some_and(|n| n > 1.0) || header.is_mosaic() || is_segmentation(header)
}

/// Opens DICOM files of one series. Files without an image are skipped in a folder (`is_folder`), and an error in a list.
pub(crate) fn open_series(paths: &[PathBuf], is_folder: bool, options: &OpenOptions) -> Result<Box<dyn Source>> {
    let mut headers: Vec<Header> = Vec::new();
    let mut others = Vec::new();
    batches::each(
        paths,
        MOST_THREADS,
        |path| Header::read(path),
        |path, header| {
            let mut header = header?;
            if is_folder && !is_image(&header) {
                others.push(path.clone());
                return Ok(());
            }
            check_is_image(&header)?;
            headers.last().into_iter().for_each(|last| header.share_values(last));
            headers.push(header);
            Ok(())
        },
    )?;
    let (count, such_as) = (others.len(), others.first().map(|first| first.display()));
    let left_out = such_as.map(|first| {
        let files = counted(count as u64, "DICOM file");
        Note::new(format!("{files} without an image left out, such as {first}."))
    });
    if headers.is_empty() {
        let place = paths.first().and_then(|p| p.parent()).unwrap_or(Path::new("input"));
        let files = counted(paths.len() as u64, "DICOM file");
        let advice = folder_in(place).map_or(String::new(), |inner| {
            format!("; the folders in it, such as {inner}, are not looked into: pass the one of a series")
        });
        return Err(ImportError::invalid(place, format!("{files}, none with an image{advice}")));
    }
    open_chosen(headers, is_folder, options, left_out.into_iter().collect())
}

/// The first name of a folder's folders, such as those to which a DICOMDIR points.
fn folder_in(folder: &Path) -> Option<String> {
    let inner = std::fs::read_dir(folder).ok()?.flatten().filter(|entry| entry.path().is_dir());
    inner.map(|entry| entry.file_name().to_string_lossy().into_owned()).min()
}

fn is_image(header: &Header) -> bool {
    header.number(tags::ROWS).is_some() || header.pixels.is_some()
}

fn check_is_image(header: &Header) -> Result<()> {
    let problem = "a DICOM file without an image, such as a report or a DICOMDIR; pass the folder or the files of an image series";
    is_image(header).then_some(()).ok_or_else(|| ImportError::invalid(&header.path, problem))
}

impl DicomSeries {
    /// Opens the slices of a series, or of one stack in it.
    fn new(headers: Vec<Header>, stack: Option<&str>, options: &OpenOptions, mut notes: Vec<Note>) -> Result<Self> {
        let mut files = headers
            .into_iter()
            .map(|header| Frames::find(&header).map(|frames| (header, frames)))
            .collect::<Result<Vec<_>, _>>()?;
        check_sizes(&files)?;
        let mut slices = Vec::new();
        for (file, (header, frames)) in files.iter().enumerate() {
            for frame in 0..frames.count() {
                let meaning = meaning_of(header, frames, frame, options.nodata)?;
                slices.push(Slice { meaning, ..find_slice(header, frames.mosaic.as_ref(), [file, frame], options)? });
            }
        }
        let paths: Vec<PathBuf> = files.iter().map(|(header, _)| header.path.clone()).collect();
        let names = Names { paths: &paths, by_frame: files.iter().any(|(_, frames)| frames.count() > 1) };
        let placement = place_stack(&mut slices, &files, &names, stack, options)?;
        let stacked = Stacked { slices: &slices, levels: &placement.levels, files: &files, names: &names };
        let volumes = tell_apart(&stacked, options.gaps)?;
        let [columns, rows] = files[0].1.size();
        let depth = placement.levels.last().map_or(0, |level| level + 1);
        let channels = volumes.channels.len().max(1) as u32;
        let sizes = Sizes { extent: Extent::new(columns, rows, depth), channels, times: volumes.times };
        sizes.checked_bytes(1).map_err(|p| ImportError::invalid(&paths[0], p))?;
        let mut places = vec![None; channels as usize * volumes.times as usize * depth as usize];
        for (slice, (cell, level)) in volumes.cells.iter().zip(&placement.levels).enumerate() {
            places[place_in(&sizes, cell.time, cell.channel, *level)] = Some(slice);
        }
        let missing = places.iter().filter(|place| place.is_none()).count();
        let Voxels { voxel_type, blank } = voxels_of(&files, &slices, missing > 0, options.adopted())?;
        check_exact(&files, &slices, voxel_type, missing > 0, options)?;
        notes.extend(floats::losses(&files, &slices, options)?);
        notes.extend(floats::note_on_padding(&slices));
        sizes.checked_bytes(voxel_type.bytes()).map_err(|p| ImportError::invalid(&paths[0], p))?;
        // Padding kept as values makes other voxels from the same files.
        let is_padding_kept = options.nodata != NoData::OfFile && files.iter().any(|(header, _)| header.has_padding());
        let kind = if is_padding_kept { "dicom with padding as values" } else { "dicom" };
        let kind = stack.map_or(kind.to_owned(), |stack| format!("{kind}, stack {stack}"));
        let mut info = SourceInfo { identity: identity(&kind, &paths)?, ..SourceInfo::plain(sizes, voxel_type) };
        info.geometry.spacing = placement.spacing;
        info.geometry.unit = Some("millimeter".into());
        info.calibrated = true;
        info.kind = SaidKind::Image("the kind of DICOM file, an image");
        info.channel_looks = looks_of(&volumes, &slices, &files, options);
        info.time = volumes.time;
        let padding = slices[0].meaning.nodata(voxel_type).or_else(|| padding_of_floats(&slices, voxel_type));
        info.knows_nodata = options.nodata == NoData::OfFile;
        info.nodata = padding.or((missing > 0 && !voxel_type.is_float()).then_some(blank));
        if info.nodata.is_some() && missing > 0 && options.nodata != NoData::OfFile {
            let problem = "`nodata` with `gaps`: missing slices get a no-data value of their own; give one of the two";
            return Err(ImportError::options(&paths[0], problem));
        }
        if let Some(mosaic) = files.iter().find_map(|(_, frames)| frames.mosaic) {
            let slices = counted(mosaic.slices.into(), "slice");
            notes.push(Note::new(format!("A mosaic: {slices} side by side in one picture.")));
        }
        if missing > 0 {
            let are = if missing == 1 { "is" } else { "are" };
            let (missing, all) = (counted(missing as u64, "slice"), places.len());
            let mark = info.nodata.filter(|_| !voxel_type.is_float());
            let mark = mark.map_or(String::new(), |value| format!(", marked by the value {value}"));
            notes.push(Note::warning(format!("{missing} of {all} {are} missing; their places hold no data{mark}.")));
        }
        notes.extend(volumes.notes);
        notes.extend(placement.notes);
        notes.extend(notes_on_values(&files, &slices, voxel_type));
        notes.extend(note_on_padding(&files, &slices, options.nodata));
        notes.extend(note_on_rest(&files));
        placement::set_matrix(placement.matrix, &mut info, &mut notes);
        info.notes = notes;
        set_unit(&files, &slices, &mut info);
        files.iter_mut().for_each(|(header, _)| header.forget_values());
        Ok(Self { info, files, slices, places, blank })
    }
}

/// Takes the unit of values where all slices have one.
fn set_unit(files: &[(Header, Frames)], slices: &[Slice], info: &mut SourceInfo) {
    let mut units = slices.iter().map(|slice| value_unit(&files[slice.file].0, slice.frame));
    let first = units.next().flatten();
    if let Some(other) = units.find(|unit| *unit != first) {
        let [first, other] = [first, other].map(|unit| unit.unwrap_or_else(|| "no unit".into()));
        let note =
            format!("Slices have values in different units ({first}, {other}): none is kept; `value_unit` gives one.");
        info.notes.push(Note::warning(note).settled_by(Setting::ValueUnit));
    } else if let Some(unit) = first {
        info.set_value_unit(&unit, "RescaleType or Units");
    }
}

/// Index of a slice's place among those of all volumes.
fn place_in(sizes: &Sizes, time: u32, channel: u32, z: u32) -> usize {
    let volume = time as usize * sizes.channels as usize + channel as usize;
    volume * sizes.extent.z as usize + z as usize
}

/// Places the slices of one stack, and drops the others. Without a name of it, several stacks must be one volume.
fn place_stack(
    slices: &mut Vec<Slice>,
    files: &[(Header, Frames)],
    names: &Names,
    stack: Option<&str>,
    options: &OpenOptions,
) -> Result<Placement> {
    let rules = Rules::of(options);
    let stack_of = |slice: &Slice| files[slice.file].0.written(slice.frame, tags::STACK_ID);
    let stacks = kinds(slices, |a, b| stack_of(a) == stack_of(b));
    let list = || {
        let described = |(first, count): &(usize, usize)| {
            let id = stack_of(&slices[*first]).unwrap_or_else(|| "(none)".into());
            format!("{id} of {}", counted(*count as u64, "frame"))
        };
        stacks.iter().take(MOST_LISTED).map(described).collect::<Vec<_>>().join(", ")
    };
    let path = &files[slices[0].file].0.path;
    if let Some(stack) = stack {
        if !slices.iter().any(|slice| stack_of(slice).as_deref() == Some(stack)) {
            let problem =
                format!("`variable` '{stack}' names no stack (StackID) or series of it: its stacks are {}", list());
            return Err(ImportError::options(path, problem));
        }
        slices.retain(|slice| stack_of(slice).as_deref() == Some(stack));
    } else if stacks.len() > 1 {
        let mut all = slices.clone();
        let placed = stack::arrange(&mut all, names, rules);
        let is_volume = |placement: &Placement| placement.levels.windows(2).all(|pair| pair[0] < pair[1]);
        if let Some(placement) = placed.ok().filter(is_volume) {
            *slices = all;
            return Ok(placement);
        }
        let problem =
            format!("{} stacks are in one series (StackID): {}. Choose one by `variable`", stacks.len(), list());
        return Err(ImportError::options(path, problem));
    }
    stack::arrange(slices, names, rules)
}

/// The channels' looks: of a single one, the series' description; each with the window of its first file.
fn looks_of(
    volumes: &Volumes,
    slices: &[Slice],
    files: &[(Header, Frames)],
    options: &OpenOptions,
) -> Vec<ChannelLook> {
    if volumes.channels.is_empty() {
        let look = look_of(&files[0].0);
        // The title of a later step is not its channel's name.
        let name = look.name.filter(|_| options.adopted().is_none());
        return vec![ChannelLook { name, ..look }];
    }
    let look = |(channel, name): (u32, &String)| {
        let first = volumes.cells.iter().position(|cell| cell.channel == channel).unwrap_or(0);
        let name = Some(name.clone()).filter(|name| name.is_ascii());
        ChannelLook { name, ..look_of(&files[slices[first].file].0) }
    };
    (0..).zip(&volumes.channels).map(look).collect()
}

/// The channel's look: the series' description, and the window of the first file.
fn look_of(header: &Header) -> ChannelLook {
    let first = |tag| header.numbers(0, tag).map(|numbers| numbers[0]);
    let window = first(tags::WINDOW_CENTER).zip(first(tags::WINDOW_WIDTH)).filter(|(_, width)| *width > 0.0);
    let name = header.text(tags::SERIES_DESCRIPTION).filter(|name| !name.is_empty() && name.is_ascii());
    ChannelLook {
        name,
        color: None,
        window: window.map(|(center, width)| [center - width / 2.0, center + width / 2.0]),
        unit: None,
    }
}

/// Checks that all pictures have one size.
fn check_sizes(files: &[(Header, Frames)]) -> Result<()> {
    let size = |(_, frames): &(Header, Frames)| frames.size();
    if let [(most, many), (other, few), ..] = kinds(files, |a, b| size(a) == size(b))[..] {
        let ([x, y], [most_x, most_y]) = (size(&files[other]), size(&files[most]));
        let such_as = files[most].0.path.display();
        let problem = format!(
            "is {x} x {y} pixels, as {few} files are; {many} are {most_x} x {most_y}, such as {such_as}. Name the \
             files of one size"
        );
        return Err(ImportError::invalid(&files[other].0.path, problem));
    }
    Ok(())
}

/// Checks that each frame of a file has a place.
fn check_frames(header: &Header, count: u64) -> Result<()> {
    let placed = header.placed_frames() as u64;
    if count > 1 && nuclear::is_nuclear(header) {
        return nuclear::check(header, count);
    }
    if count > 1 && placed == 0 && !dose::places(header, count) {
        let feature =
            format!("a file of {count} frames without a place for each (no PerFrameFunctionalGroupsSequence)");
        let advice = "export the frames to TIFF or .npy, and pack these with `spacing`";
        return Err(ImportError::unsupported_but(&header.path, feature, advice));
    }
    if placed > 0 && placed != count {
        let problem =
            format!("declares {}, but gives positions for {placed}; write the file again", counted(count, "frame"));
        return Err(ImportError::invalid(&header.path, problem));
    }
    Ok(())
}

/// Finds the place of a slice, given by its file's index and its frame.
fn find_slice(
    header: &Header,
    mosaic: Option<&Mosaic>,
    [file, frame]: [usize; 2],
    options: &OpenOptions,
) -> Result<Slice> {
    let need = |tag, name: &str, count: usize, help: &str| {
        let found = header.numbers(frame, tag);
        found.clone().filter(|numbers| numbers.len() == count).ok_or_else(|| {
            let written =
                || header.written(frame, tag).map(|text| format!("'{}'", text.chars().take(80).collect::<String>()));
            let found = found.map(|numbers| format!("{numbers:?}")).or_else(written).unwrap_or_else(|| "none".into());
            let place = if header.placed_frames() > 0 { format!("frame {}: ", frame + 1) } else { String::new() };
            let problem = format!("{place}expected {count} numbers of {name} {tag}, found {found}; {help}");
            ImportError::invalid(&header.path, problem)
        })
    };
    let unplaced =
        "without it the slice has no position: export the series to TIFF or .npy, and pack that with `spacing`";
    let position = need(tags::IMAGE_POSITION_PATIENT, "ImagePositionPatient", 3, unplaced)?;
    let directions = need(tags::IMAGE_ORIENTATION_PATIENT, "ImageOrientationPatient", 6, unplaced)?;
    let vector = |n: &[f64]| DVec3::new(n[0], n[1], n[2]);
    let pixel_mm = match options.spacing {
        Some(spacing) => [spacing.x, spacing.y],
        None => {
            let help = "pass `spacing` X,Y,Z";
            let [along_column, along_row] = need(tags::PIXEL_SPACING, "PixelSpacing", 2, help)?[..] else {
                return Err(ImportError::invalid(&header.path, help));
            };
            if !(along_column > 0.0 && along_row > 0.0) {
                let problem = format!("PixelSpacing is {along_column} x {along_row}, expected numbers above 0; {help}");
                return Err(ImportError::invalid(&header.path, problem));
            }
            [along_row, along_column]
        }
    };
    let roundings = header.roundings(frame, tags::IMAGE_POSITION_PATIENT);
    let steps = [(tags::SPACING_BETWEEN_SLICES, "SpacingBetweenSlices"), (tags::SLICE_THICKNESS, "SliceThickness")];
    let [along_row, along_column] = [vector(&directions), vector(&directions[3..])];
    let normal = along_row.cross(along_column).normalize_or_zero();
    let position = dose::position(header, frame, vector(&position), normal)?;
    let mut position = nuclear::position(header, frame, position, normal)?;
    if let Some(mosaic) = mosaic {
        let help = "a mosaic has one place for all its slices; pass `spacing` X,Y,Z";
        let step_mm = match options.spacing {
            Some(spacing) => spacing.z,
            None => need(tags::SPACING_BETWEEN_SLICES, "SpacingBetweenSlices", 1, help)?[0],
        };
        if step_mm <= 0.0 || step_mm.is_nan() {
            let problem = format!("SpacingBetweenSlices is {step_mm}, expected a number above 0; {help}");
            return Err(ImportError::invalid(&header.path, problem));
        }
        let step = [along_row * pixel_mm[0], along_column * pixel_mm[1]];
        position = mosaic.position(&header.path, frame as u32, position, step, step_mm)?;
    }
    Ok(Slice {
        file,
        frame,
        position,
        along_row,
        along_column,
        pixel_mm,
        rounding: if let [x, y, z] = roundings[..] { DVec3::new(x, y, z) } else { DVec3::ZERO },
        step_mm: steps.into_iter().find_map(|(tag, name)| {
            let mm = header.numbers(frame, tag)?[0];
            (mm > 0.0).then_some((mm, name))
        }),
        meaning: Meaning::PLAIN,
    })
}

fn meaning_of(header: &Header, frames: &Frames, frame: usize, nodata: NoData) -> Result<Meaning> {
    if frames.format.is_float {
        return floats::meaning_of(header, frames, frame, nodata);
    }
    let first = |tag, name: &str| match (header.numbers(frame, tag), header.written(frame, tag)) {
        (Some(numbers), _) => Ok(Some(numbers[0])),
        (None, Some(text)) => {
            let problem = format!(
                "{name} is '{text}', expected a finite number: the meaning of its values is not known; write the file \
                 again"
            );
            Err(ImportError::invalid(&header.path, problem))
        }
        (None, None) => Ok(None),
    };
    let slope =
        dose::scale(header)?.map_or_else(|| first(tags::RESCALE_SLOPE, "RescaleSlope"), |scale| Ok(Some(scale)))?;
    let intercept = first(tags::RESCALE_INTERCEPT, "RescaleIntercept")?;
    if header.has_value_table && slope.is_none() {
        return Err(ImportError::unsupported(&header.path, "a table of values (ModalityLUTSequence)"));
    }
    if slope == Some(0.0) {
        let problem = "RescaleSlope is 0: all voxels would have the same value; expected another slope, or none";
        return Err(ImportError::invalid(&header.path, problem));
    }
    // Some writers store it as unsigned, whatever the pixels are.
    let wrap = |n: f64| frames.format.wrapped(n as i64);
    let padding = header.number(tags::PIXEL_PADDING_VALUE).filter(|_| nodata == NoData::OfFile).and_then(|value| {
        let limit = header.number(tags::PIXEL_PADDING_RANGE_LIMIT).unwrap_or(value);
        let [a, b] = [wrap(value), wrap(limit)];
        let [least, greatest] = frames.format.limits();
        let stored = [a.min(b).max(least), a.max(b).min(greatest)];
        (stored[0] <= stored[1]).then_some(stored)
    });
    let (slope, intercept) = (slope.unwrap_or(1.0), intercept.unwrap_or(0.0));
    Ok(Meaning { slope, intercept, padding, float_padding: None })
}

/// The first padding value, which is NaN in float voxels, for comparison with later steps.
fn padding_of_floats(slices: &[Slice], voxel_type: VoxelType) -> Option<f64> {
    let meaning = slices.iter().map(|slice| slice.meaning).find(|meaning| meaning.padding.is_some())?;
    let [least, _] = meaning.padding.filter(|_| voxel_type.is_float())?;
    // Turns -0 into 0.
    Some(f64::from(meaning.value(least) as f32) + 0.0)
}

/// Voxel type, and the value of missing slices.
struct Voxels {
    voxel_type: VoxelType,
    blank: f64,
}

/// Chooses the smallest type for every value, plus an unused one if slices are missing; floats if values are not integers.
fn voxels_of(
    files: &[(Header, Frames)],
    slices: &[Slice],
    are_missing: bool,
    held_as: Option<HeldAs>,
) -> Result<Voxels> {
    let floats = Voxels { voxel_type: VoxelType::F32, blank: f64::NAN };
    let are_floats = files.iter().any(|(_, frames)| frames.format.is_float);
    if are_floats || !slices.iter().all(|slice| slice.meaning.is_whole()) {
        return Ok(floats);
    }
    // One integer marks padding in all slices; if it would be a value in some, padding is NaN.
    let first = slices[0].meaning;
    let is_padded = slices.iter().any(|slice| slice.meaning.padding.is_some());
    if is_padded && slices.iter().any(|slice| slice.meaning != first) {
        return Ok(floats);
    }
    let voxels = |[least, greatest]: [f64; 2]| {
        // Padding has a value already.
        let blank = first.padding.map_or(least - 1.0, |[padding, _]| first.value(padding));
        // As in the steps before, unless a voxel has that value here.
        let theirs = held_as.and_then(|held| held.nodata).filter(|value| !(least..=greatest).contains(value));
        let blank = if is_padded { blank } else { theirs.unwrap_or(blank) };
        let (least, greatest) = if are_missing { (least.min(blank), greatest.max(blank)) } else { (least, greatest) };
        let holds = |voxel_type: &VoxelType| voxel_type.holds(least) && voxel_type.holds(greatest);
        let theirs = held_as.map(|held| held.voxel_type).filter(|voxel_type| !voxel_type.is_float());
        let voxel_type = theirs.filter(holds).unwrap_or_else(|| smallest_type(least, greatest));
        if voxel_type.is_float() { Voxels { voxel_type, ..floats } } else { Voxels { voxel_type, blank } }
    };
    let possible = voxels(range_of(slices, 1, |slice| Ok(files[slice.file].1.format.limits()))?);
    let is_short = files.iter().all(|(_, frames)| frames.format.width <= 2);
    let frame_bytes = files.iter().map(|(_, frames)| frames.reader_bytes()).max().unwrap_or(0).max(1);
    if possible.voxel_type.bytes() < 4 || !is_short || frame_bytes > MOST_LOOKED_AT_BYTES {
        return Ok(possible);
    }
    // Scanners that shift 16 stored bits seldom use them all: decode to avoid doubling the memory.
    let most_threads = (MOST_LOOKED_AT_BYTES / frame_bytes).min(MOST_THREADS as u64) as usize;
    range_of(slices, most_threads, |slice| {
        let (header, frames) = &files[slice.file];
        let samples = frames.read(header, slice.frame)?;
        let range = samples.range(&frames.format, slice.meaning.padding);
        samples.confirm().map(|()| range)
    })
    .map(voxels)
}

/// Refuses 32-bit numbers needlessly changed as floats: labels, those beside missing slices, and those scaled only by whole numbers.
fn check_exact(
    files: &[(Header, Frames)],
    slices: &[Slice],
    voxel_type: VoxelType,
    are_missing: bool,
    options: &OpenOptions,
) -> Result<()> {
    let is_long = |frames: &Frames| frames.format.width == 4 && !frames.format.is_float;
    let Some((header, _)) = files.iter().find(|(_, frames)| is_long(frames) && voxel_type.is_float()) else {
        return Ok(());
    };
    let what = match () {
        () if options.are_labels == Some(true) => "a series of 32-bit labels, some of which f32 would merge,",
        () if are_missing => "a 32-bit series with missing slices, which would become f32,",
        () if !options.allow_lossy && slices.iter().all(|slice| slice.meaning.is_whole()) => {
            let problem = "no integer type holds all 32-bit numbers of this series and its padding, and f32 rounds to \
                           24 bits; pass `allow_lossy` to accept rounding";
            return Err(ImportError::options(&header.path, problem));
        }
        () => return Ok(()),
    };
    Err(ImportError::unsupported(&header.path, what))
}

/// Least and greatest of the rescaled ends of each slice's stored range.
fn range_of(
    slices: &[Slice],
    most_threads: usize,
    stored: impl Fn(&Slice) -> Result<[i64; 2]> + Sync,
) -> Result<[f64; 2]> {
    let (mut least, mut greatest) = (f64::INFINITY, f64::NEG_INFINITY);
    batches::each(slices, most_threads, stored, |slice, range| {
        for value in range?.map(|n| slice.meaning.value(n)) {
            least = least.min(value);
            greatest = greatest.max(value);
        }
        Ok::<_, ImportError>(())
    })?;
    Ok([least, greatest])
}

fn notes_on_values(files: &[(Header, Frames)], slices: &[Slice], voxel_type: VoxelType) -> Vec<Note> {
    let mut notes = Vec::new();
    let first = slices[0].meaning;
    let Meaning { slope, intercept, .. } = first;
    if slices.iter().any(|slice| (slice.meaning.slope, slice.meaning.intercept) != (slope, intercept)) {
        let note = format!("Values are scaled and shifted by each slice's own numbers, and held as {voxel_type}.");
        notes.push(Note::new(note));
    } else if (slope, intercept) != (1.0, 0.0) {
        notes.push(Note::new(format!(
            "Values are scaled by {slope} and shifted by {intercept}, as the header says, and held as {voxel_type}."
        )));
    }
    let is_stored = slices.iter().all(|slice| (slice.meaning.slope, slice.meaning.intercept) == (1.0, 0.0));
    if is_stored && files.iter().any(|(header, _)| header.has_real_world) {
        notes.push(Note::warning("Values are as stored: the header's real-world values of them are not applied."));
    }
    let is_long = |frames: &Frames| frames.format.width == 4 && !frames.format.is_float;
    if voxel_type.is_float() && files.iter().any(|(_, frames)| is_long(frames)) {
        notes.push(Note::warning("32-bit numbers are rounded to the 24 bits of f32."));
    }
    if let Some([least, greatest]) = slices.iter().find_map(|slice| slice.meaning.padding) {
        let what = match first.nodata(voxel_type) {
            Some(value) => format!("become {value}, which means no data"),
            None if voxel_type.is_float() => "become NaN".into(),
            None => "do not occur".into(),
        };
        let others =
            slices.iter().filter_map(|slice| slice.meaning.padding).any(|padding| padding != [least, greatest]);
        let others = if others { " (other values in some slices)" } else { "" };
        let note = format!("Stored values {least} to {greatest}{others} are padding: they {what}.");
        notes.push(Note::new(note));
    }
    let inverted = |(header, _): &(Header, Frames)| {
        header.text(tags::PHOTOMETRIC_INTERPRETATION).is_some_and(|text| text == "MONOCHROME1")
    };
    if files.iter().any(inverted) {
        notes.push(Note::new(
            "Small values are meant to be shown bright (MONOCHROME1); the values are kept as they are.",
        ));
    }
    notes
}

/// Notes bytes after the pixels, besides one that makes their number even.
fn note_on_rest(files: &[(Header, Frames)]) -> Option<Note> {
    let mut others = files.iter().filter(|(_, frames)| frames.spare_bytes > 1);
    let (header, frames) = others.next()?;
    let (bytes, name) = (frames.spare_bytes, name_of(&header.path));
    let others = match others.count() as u64 {
        0 => String::new(),
        count => format!(", and those of {} more", counted(count, "file")),
    };
    Some(Note::warning(format!(
        "{bytes} bytes after the pixels of {name}{others} are left out: NumberOfFrames, or the size of pictures, may say too little."
    )))
}

/// Notes padding values outside the pixels' range.
fn note_on_padding(files: &[(Header, Frames)], slices: &[Slice], nodata: NoData) -> Option<Note> {
    let is_left_out = |slice: &&Slice| {
        let (header, frames) = &files[slice.file];
        let is_integer = !frames.format.is_float && slice.meaning.padding.is_none();
        nodata == NoData::OfFile && is_integer && header.has_padding()
    };
    let slice = slices.iter().find(is_left_out)?;
    let (header, frames) = &files[slice.file];
    let value = header.number(tags::PIXEL_PADDING_VALUE)?;
    let [least, greatest] = frames.format.limits();
    let name = name_of(&header.path);
    Some(Note::warning(format!(
        "The padding value {value} of {name} is outside of its pixels' range, {least} to {greatest}: no voxel is left \
         out."
    )))
}

impl Source for DicomSeries {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn access(&self) -> Access {
        Access::Planes
    }

    fn reader_bytes(&self) -> u64 {
        self.files.iter().map(|(_, frames)| frames.reader_bytes()).max().unwrap_or(0)
    }

    fn held_bytes(&self) -> u64 {
        let files = self.files.iter().map(|(header, frames)| header.held_bytes() + frames.held_bytes());
        let tables = size_of_val(&self.files[..]) + size_of_val(&self.slices[..]) + size_of_val(&self.places[..]);
        (tables + files.sum::<usize>() + self.info.identity.len()) as u64
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        let plane_bytes = out.len() / region.extent().z as usize;
        let SourceInfo { extent, channels, times, .. } = self.info;
        let sizes = Sizes { extent, channels, times };
        for (z, plane) in (region.min.z..).zip(out.chunks_exact_mut(plane_bytes)) {
            let voxel_type = self.info.voxel_type;
            let Some(slice) = self.places[place_in(&sizes, time, channel, z)] else {
                fill(plane, voxel_type, self.blank);
                continue;
            };
            let slice = &self.slices[slice];
            let (header, frames) = &self.files[slice.file];
            let samples = frames.read(header, slice.frame)?;
            let region = frames.in_picture(slice.frame, region);
            samples.deliver(&frames.format, &slice.meaning, voxel_type, region, plane);
            samples.confirm()?;
        }
        Ok(())
    }
}

fn fill(plane: &mut [u8], voxel_type: VoxelType, value: f64) {
    with_voxel_type!(voxel_type, T => {
        let (voxels, _) = plane.as_chunks_mut::<{ size_of::<T>() }>();
        voxels.fill((value as T).to_le_bytes());
    });
}
