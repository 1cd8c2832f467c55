//! DICOM series (CT, MR and the like) as a source.
//!
//! Slices are sorted by position, never by name or number, and must be one evenly spaced stack of one series, apart from missing ones left blank.
//! Several at each position are channels and time steps. Boxes of native frames are read from their files' maps; other frames are decoded whole on
//! request, in the memory of one per thread.

use super::frames::Frames;
use super::header::Header;
use super::maps::Maps;
use super::mosaic::Mosaic;
use super::notes::{note_on_padding, note_on_rest, notes_on_values};
use super::pixels::{Meaning, Samples};
use super::stack::{Names, Placement, Rules, Slice, kinds};
use super::unit::value_unit;
use super::volumes::{Stacked, Volumes, tell_apart};
use super::voxels::{Voxels, check_exact, fill, meaning_of, padding_of_floats, voxels_of};
use super::{dose, floats, nuclear, stack};
use crate::axes::Sizes;
use crate::error::{ImportError, Result};
use crate::labels::SaidKind;
use crate::note::{Note, Setting};
use crate::options::{NoData, OpenOptions};
use crate::placement;
use crate::raw::identity;
use crate::source::{Access, Lent, Source, SourceInfo, Take};
use brickyard_volume::{ChannelLook, Extent, VoxelBox, counted};
use dicom_dictionary_std::tags;
use glam::DVec3;
use std::path::PathBuf;

/// Most stacks listed in a message.
const MOST_LISTED: usize = 40;

/// Largest lent slice: some times that of bricks read together.
const MOST_LENT_BYTES: usize = 1 << 20;

/// A DICOM series as a source.
pub(super) struct DicomSeries {
    info: SourceInfo,
    files: Vec<(Header, Frames)>,
    access: Access,
    /// Maps of files whose frames are native.
    maps: Maps,
    /// Slices, ascending along z.
    slices: Vec<Slice>,
    /// Index of the slice at each z of each channel of each time step; `None` where one is missing, whose voxels are all `blank`.
    places: Vec<Option<usize>>,
    blank: f64,
}

impl DicomSeries {
    /// Opens the slices of a series, or of one stack in it.
    pub(super) fn new(
        headers: Vec<Header>,
        stack: Option<&str>,
        options: &OpenOptions,
        mut notes: Vec<Note>,
    ) -> Result<Self> {
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
        let are_native = files.iter().all(|(_, frames)| frames.are_native());
        let access = if are_native { Access::Box } else { Access::Planes };
        Ok(Self { info, files, access, maps: Maps::new(), slices, places, blank })
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

/// Finds the place of a slice, given by its file's index and its frame.
pub(super) fn find_slice(
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

impl DicomSeries {
    /// The slice at a place; `None` where it is missing.
    fn slice(&self, time: u32, channel: u32, z: u32) -> Option<&Slice> {
        let SourceInfo { extent, channels, times, .. } = self.info;
        let place = place_in(&Sizes { extent, channels, times }, time, channel, z);
        self.places[place].map(|slice| &self.slices[slice])
    }

    /// Fills `out` with the voxels of slice `z` in the x, y rectangle of `region`.
    fn read_slice(&self, time: u32, channel: u32, z: u32, region: VoxelBox, out: &mut [u8]) -> Result<()> {
        let voxel_type = self.info.voxel_type;
        let Some(slice) = self.slice(time, channel, z) else {
            fill(out, voxel_type, self.blank);
            return Ok(());
        };
        let frames = &self.files[slice.file].1;
        let samples = self.samples(slice)?;
        let region = frames.in_picture(slice.frame, region);
        samples.deliver(&frames.format, &slice.meaning, voxel_type, region, out);
        samples.confirm()
    }

    /// The stored numbers of a slice's picture.
    fn samples(&self, slice: &Slice) -> Result<Samples> {
        let (header, frames) = &self.files[slice.file];
        if frames.are_native() {
            return frames.view(self.maps.of(slice.file, header)?, slice.frame);
        }
        frames.read(header, slice.frame)
    }
}

impl Source for DicomSeries {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn access(&self) -> Access {
        self.access
    }

    fn reader_bytes(&self) -> u64 {
        let frame_bytes = self.files.iter().map(|(_, frames)| frames.reader_bytes()).max();
        frame_bytes.unwrap_or(0).max(MOST_LENT_BYTES as u64)
    }

    fn held_bytes(&self) -> u64 {
        let files = self.files.iter().map(|(header, frames)| header.held_bytes() + frames.held_bytes());
        let tables = size_of_val(&self.files[..]) + size_of_val(&self.slices[..]) + size_of_val(&self.places[..]);
        (tables + files.sum::<usize>() + self.info.identity.len()) as u64
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        let plane_bytes = out.len() / region.extent().z as usize;
        let mut planes = (region.min.z..).zip(out.chunks_exact_mut(plane_bytes));
        planes.try_for_each(|(z, plane)| self.read_slice(time, channel, z, region, plane))
    }

    /// Lends slices converted one by one in a buffer, which the processor's caches hold.
    fn lend(&self, time: u32, channel: u32, region: VoxelBox, take: Take<'_>) -> Result<bool, ImportError> {
        let row_bytes = region.extent().x as usize * self.info.voxel_type.bytes();
        let slice_bytes = row_bytes * region.extent().y as usize;
        if slice_bytes > MOST_LENT_BYTES || self.access == Access::Planes {
            return Ok(false);
        }
        let mut slice = vec![0; slice_bytes];
        for (i, z) in (region.min.z..region.max.z).enumerate() {
            self.read_slice(time, channel, z, region, &mut slice)?;
            take(Lent { slices: i..i + 1, bytes: &slice, row_bytes, slice_bytes });
        }
        Ok(true)
    }

    /// Fetches whole frames with the first row of boxes, one file after the other: disks read them so at their best.
    fn announce(&self, time: u32, channel: u32, region: VoxelBox) {
        if region.min.y > 0 {
            return;
        }
        let slices = (region.min.z..region.max.z).filter_map(|z| self.slice(time, channel, z));
        for slice in slices.filter(|slice| self.files[slice.file].1.are_native()) {
            // The box's reading reports what is wrong.
            if let Ok(samples) = self.samples(slice) {
                samples.advise();
            }
        }
    }
}
