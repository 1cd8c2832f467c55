//! DICOM series (CT, MR and the like): one slice per file, or enhanced files with a place for every frame.
//!
//! Opening reads all headers. Slices are sorted by position, never by name or number, and must be one upright, evenly spaced stack of one series,
//! apart from missing ones left blank. Voxels are rescaled values (Hounsfield units of a CT): integers if slopes and intercepts are, else floats.
//! If 16 stored bits and an intercept may not fit in 16 bits, opening decodes all slices once to decide. Reading decodes whole slices on request,
//! in the memory of one slice per thread.

mod decode;
mod frames;
#[cfg(test)]
mod gap_tests;
mod header;
#[cfg(test)]
mod lossy_tests;
mod mosaic;
#[cfg(test)]
mod mosaic_tests;
mod pixels;
mod stack;
#[cfg(test)]
mod tests;
mod unit;
#[cfg(test)]
mod unknown_tests;

use crate::axes::Sizes;
use crate::dicom_files::files_in;
use crate::element::smallest_type;
use crate::error::{ImportError, Result};
use crate::files::{first_bytes, folder_of, name_of};
use crate::note::Note;
use crate::options::{HeldAs, NoData, OpenOptions};
use crate::placement;
use crate::raw::identity;
use crate::source::{Access, Source, SourceInfo};
use brickyard_volume::{ChannelLook, Extent, VoxelBox, VoxelType, counted, with_voxel_type};
use dicom_dictionary_std::{tags, uids};
use frames::Frames;
use glam::DVec3;
use header::Header;
use pixels::Meaning;
use stack::{Names, Slice, kinds};
use std::path::{Path, PathBuf};
use unit::value_unit;

/// Largest frame decoded in search of the smallest voxel type: there is no memory budget yet.
const MOST_LOOKED_AT_BYTES: u64 = 256 << 20;

/// Most bytes of a damaged file searched for the UID of its series.
const MOST_SEARCHED_BYTES: usize = 1 << 20;

/// A DICOM series as a source.
pub(crate) struct DicomSeries {
    info: SourceInfo,
    files: Vec<(Header, Frames)>,
    /// Slices, ascending along z.
    slices: Vec<Slice>,
    /// Index of the slice at each z; `None` where one is missing, whose voxels are all `blank`.
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
        return DicomSeries::new(vec![header], options, notes).map(|s| Box::new(s) as _);
    }
    let mut series = Vec::new();
    let mut unread = Vec::new();
    for other in files_in(folder)?.iter().filter(|other| other.file_name() != path.file_name()) {
        match Header::read(other) {
            Ok(mut other) if is_image(&other) && other.series() == header.series() => {
                other.share_values(&header);
                series.push(other);
            }
            Ok(_) => {}
            Err(error) if is_of_the_file(&error) && !may_be_of(other, &header)? => unread.push(error),
            Err(error) => return Err(error),
        }
    }
    series.push(header);
    let mut notes = vec![Note::new(format!("{} files of the series are read from its folder.", series.len()))];
    if let Some(first) = unread.first() {
        let files = counted(unread.len() as u64, "DICOM file");
        let do_not = if unread.len() == 1 { "does not" } else { "do not" };
        let warning = format!("{files} beside it cannot be read and {do_not} name a series: left out. {first}");
        notes.push(Note::warning(warning));
    }
    DicomSeries::new(series, options, notes).map(|s| Box::new(s) as _)
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
    header.number(tags::NUMBER_OF_FRAMES).is_some_and(|n| n > 1.0) || header.is_mosaic()
}

/// Opens DICOM files of one series. Files without an image are skipped in a folder (`is_folder`), and an error in a list.
pub(crate) fn open_series(paths: &[PathBuf], is_folder: bool, options: &OpenOptions) -> Result<Box<dyn Source>> {
    let mut headers = Vec::new();
    let mut others = Vec::new();
    for path in paths {
        let mut header = Header::read(path)?;
        if is_folder && !is_image(&header) {
            others.push(path);
            continue;
        }
        check_is_image(&header)?;
        headers.last().into_iter().for_each(|last| header.share_values(last));
        headers.push(header);
    }
    let (count, such_as) = (others.len(), others.first().map(|first| first.display()));
    let left_out =
        such_as.map(|first| Note::new(format!("{count} DICOM files without an image, such as {first}, are left out.")));
    let Some(first) = headers.first() else {
        let place = paths.first().and_then(|p| p.parent()).unwrap_or(Path::new("input"));
        return Err(ImportError::invalid(place, format!("{} DICOM files, none of them an image", paths.len())));
    };
    let series = kinds(&headers, |a, b| a.series() == b.series());
    if series.len() > 1 {
        let list: Vec<String> = series.iter().map(|&(first, count)| describe_series(&headers[first], count)).collect();
        let place = first.path.parent().filter(|_| is_folder).unwrap_or(&first.path);
        let problem = format!(
            "{} series are mixed: {}. Name the files of one; a single file stands for the slices of its series",
            series.len(),
            list.join("; ")
        );
        return Err(ImportError::options(place, problem));
    }
    DicomSeries::new(headers, options, left_out.into_iter().collect()).map(|s| Box::new(s) as _)
}

fn is_image(header: &Header) -> bool {
    header.number(tags::ROWS).is_some() || header.pixels.is_some()
}

fn check_is_image(header: &Header) -> Result<()> {
    let problem = "a DICOM file without an image: expected pixel data; name the files of an image series";
    is_image(header).then_some(()).ok_or_else(|| ImportError::invalid(&header.path, problem))
}

fn describe_series(header: &Header, count: usize) -> String {
    let what = header.text(tags::SERIES_DESCRIPTION).map_or(String::new(), |d| format!(" \"{d}\""));
    format!("{}{what} of {count} files, such as {}", header.series(), name_of(&header.path))
}

impl DicomSeries {
    fn new(headers: Vec<Header>, options: &OpenOptions, mut notes: Vec<Note>) -> Result<Self> {
        let mut files = headers
            .into_iter()
            .map(|header| Frames::find(&header).map(|frames| (header, frames)))
            .collect::<Result<Vec<_>, _>>()?;
        check_sizes(&files)?;
        let mut slices = Vec::new();
        for (file, (header, frames)) in files.iter().enumerate() {
            for frame in 0..frames.count() {
                slices.push(find_slice(header, frames, file, frame, options)?);
            }
        }
        let paths: Vec<PathBuf> = files.iter().map(|(header, _)| header.path.clone()).collect();
        let names = Names { paths: &paths, by_frame: files.iter().any(|(_, frames)| frames.count() > 1) };
        let placement = stack::arrange(&mut slices, &names, options)?;
        let mut places = vec![None; placement.levels.last().map_or(0, |level| *level as usize + 1)];
        placement.levels.iter().enumerate().for_each(|(slice, level)| places[*level as usize] = Some(slice));
        let missing = places.iter().filter(|place| place.is_none()).count();
        let [columns, rows] = files[0].1.size();
        let extent = Extent::new(columns, rows, places.len() as u32);
        let sizes = Sizes { extent, channels: 1, times: 1 };
        let Voxels { voxel_type, blank } = voxels_of(&files, &slices, missing > 0, options.held_as)?;
        check_exact(&files, &slices, voxel_type, missing > 0, options)?;
        sizes.checked_bytes(voxel_type.bytes()).map_err(|p| ImportError::invalid(&paths[0], p))?;
        // Padding kept as values makes other voxels from the same files.
        let is_padding_kept = options.nodata != NoData::OfFile && files.iter().any(|(header, _)| header.has_padding());
        let kind = if is_padding_kept { "dicom with padding as values" } else { "dicom" };
        let mut info = SourceInfo { identity: identity(kind, &paths)?, ..SourceInfo::plain(sizes, voxel_type) };
        info.geometry.spacing = placement.spacing;
        info.geometry.unit = Some("millimeter".into());
        info.calibrated = true;
        let look = look_of(&files[0].0);
        // The title of a later step is not its channel's name.
        let name = look.name.filter(|_| options.held_as.is_none());
        info.channel_looks = vec![ChannelLook { name, ..look }];
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
        notes.extend(placement.note);
        notes.extend(notes_on_values(&files, &slices, voxel_type));
        notes.extend(note_on_padding(&files, &slices, options.nodata));
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
        info.notes.push(Note::warning(format!(
            "Slices have values in different units ({first}, {other}): none is kept; `value_unit` gives one."
        )));
    } else if let Some(unit) = first {
        info.set_value_unit(&unit, "RescaleType or Units");
    }
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
    if count > 1 && placed == 0 {
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

fn find_slice(header: &Header, frames: &Frames, file: usize, frame: usize, options: &OpenOptions) -> Result<Slice> {
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
    let mut position = vector(&position);
    if let Some(mosaic) = &frames.mosaic {
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
        meaning: meaning_of(header, frames, frame, options.nodata)?,
    })
}

fn meaning_of(header: &Header, frames: &Frames, frame: usize, nodata: NoData) -> Result<Meaning> {
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
    let slope = first(tags::RESCALE_SLOPE, "RescaleSlope")?;
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
    Ok(Meaning { slope: slope.unwrap_or(1.0), intercept: intercept.unwrap_or(0.0), padding })
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
    if !slices.iter().all(|slice| slice.meaning.is_whole()) {
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
    let possible = voxels(range_of(slices, |slice| Ok(files[slice.file].1.format.limits()))?);
    let is_short = files.iter().all(|(_, frames)| frames.format.width <= 2);
    let is_small = files.iter().all(|(_, frames)| frames.reader_bytes() <= MOST_LOOKED_AT_BYTES);
    if possible.voxel_type.bytes() < 4 || !is_short || !is_small {
        return Ok(possible);
    }
    // Scanners that shift 16 stored bits seldom use them all: decode to avoid doubling the memory.
    range_of(slices, |slice| {
        let (header, frames) = &files[slice.file];
        Ok(frames.read(header, slice.frame)?.range(&frames.format, slice.meaning.padding))
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
    let Some((header, _)) = files.iter().find(|(_, frames)| frames.format.width == 4 && voxel_type.is_float()) else {
        return Ok(());
    };
    let what = match () {
        () if options.are_labels => "a series of 32-bit labels, some of which f32 would merge,",
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
fn range_of(slices: &[Slice], stored: impl Fn(&Slice) -> Result<[i64; 2]>) -> Result<[f64; 2]> {
    let (mut least, mut greatest) = (f64::INFINITY, f64::NEG_INFINITY);
    for slice in slices {
        for value in stored(slice)?.map(|n| slice.meaning.value(n)) {
            least = least.min(value);
            greatest = greatest.max(value);
        }
    }
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
    if voxel_type.is_float() && files.iter().any(|(_, frames)| frames.format.width == 4) {
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

/// Notes padding values outside the pixels' range.
fn note_on_padding(files: &[(Header, Frames)], slices: &[Slice], nodata: NoData) -> Option<Note> {
    let is_left_out = |slice: &&Slice| {
        nodata == NoData::OfFile && slice.meaning.padding.is_none() && files[slice.file].0.has_padding()
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
        for (z, plane) in (region.min.z..).zip(out.chunks_exact_mut(plane_bytes)) {
            let voxel_type = self.info.voxel_type;
            let Some(slice) = self.places[z as usize] else {
                fill(plane, voxel_type, self.blank);
                continue;
            };
            let slice = &self.slices[slice];
            let (header, frames) = &self.files[slice.file];
            let samples = frames.read(header, slice.frame)?;
            let region = frames.in_picture(slice.frame, region);
            samples.deliver(&frames.format, &slice.meaning, voxel_type, region, plane);
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
