//! A TIFF file's description, by any program: the plane-to-page map, spacing and unit, times, channels, and the meaning of stored
//! numbers.
//!
//! [`hyperstack`](super::hyperstack) (ImageJ), [`ome`](super::ome), [`scifio`](super::scifio), [`shaped`](super::shaped) (tifffile),
//! [`stk`](super::stk) (MetaMorph) and [`tag_scale`](super::tag_scale) fill it. A page order is followed or is a [`Description::problem`]; other unclear parts are
//! dropped, with a note.

use super::calibration::{Calibration, SIGNED_OFFSET};
use super::ome::Pixels;
use super::page::PageFormat;
use super::units::unit_of;
use crate::axes::{Axis, Sizes};
use crate::element::{Element, Scale};
use crate::note::{Note, Setting};
use crate::options::NoData;
use crate::source::SourceInfo;
use crate::spacing::Spacing;
use crate::step_time::{StepTime, TimeSpan, moment_in};
use brickyard_volume::numbers::exact;
use brickyard_volume::{ChannelLook, Extent, TimeAxis, VoxelType, time_unit};

/// Everything a TIFF file declares beside its pixels.
#[derive(Debug, Default, PartialEq)]
pub(super) struct Description {
    pub(super) declared: Option<Declared>,
    /// OME-XML on individual pages and files.
    pub(super) ome: Option<Ome>,
    /// Why the described page order cannot be followed.
    pub(super) problem: Option<String>,
    pub(super) spacing: Option<Spacing>,
    /// Whether to ignore pixels per inch, since the program names a unit whenever they are a scale.
    pub(super) ignores_resolution: bool,
    /// UDUNITS name.
    pub(super) unit: Option<&'static str>,
    pub(super) time: Option<TimeAxis>,
    /// Time of the only step.
    pub(super) step_time: StepTime,
    /// Conversion of stored numbers to values; `None` if they are equal.
    pub(super) calibration: Option<Calibration>,
    /// Unit of the values, if they are calibrated or GDAL names one.
    pub(super) value_unit: Option<String>,
    /// Stored number of pixels without data, from GDAL's tag.
    pub(super) nodata: Option<f64>,
    /// Whether NaN alone means no data.
    pub(super) nodata_is_nan: bool,
    /// Looks of the channels, as far as described.
    pub(super) channel_looks: Vec<ChannelLook>,
    pub(super) notes: Vec<Note>,
}

/// OME-XML beyond a plain order of pages.
#[derive(Debug, PartialEq)]
pub(super) struct Ome {
    pub(super) uuid: Option<String>,
    pub(super) says: OmeSays,
}

#[derive(Debug, PartialEq)]
pub(super) enum OmeSays {
    /// The map of planes to pages of files.
    Pixels(Box<Pixels>),
    /// The metadata are in another file, given by name, and by UUID if known.
    Elsewhere { metadata_file: String, uuid: Option<String> },
}

/// The arrangement of pages declared by a description.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Declared {
    /// Axes from page to page (t, c, z), slowest first.
    pub(super) page_axes: Vec<Axis>,
    pub(super) z: u32,
    pub(super) channels: u32,
    pub(super) times: u32,
    /// Pixels of a plane along x and y, if given.
    pub(super) plane: Option<[u32; 2]>,
    /// Whether all planes may lie behind a single directory, as in ImageJ's stacks over 4 GiB.
    pub(super) in_one_directory: bool,
    /// Whether other pages may be arrays of their own.
    pub(super) of_each_page: bool,
    /// Whether `channels` counts the samples within a page.
    pub(super) counts_samples: bool,
    /// Number of planes, if given separately.
    pub(super) images: Option<u32>,
}

impl Declared {
    pub(super) fn one_plane() -> Self {
        Self {
            page_axes: vec![Axis::T, Axis::C, Axis::Z],
            z: 1,
            channels: 1,
            times: 1,
            plane: None,
            in_one_directory: false,
            of_each_page: false,
            counts_samples: false,
            images: None,
        }
    }

    pub(super) fn planes(&self) -> u64 {
        self.sizes([1, 1]).planes()
    }

    pub(super) fn sizes(&self, [x, y]: [u32; 2]) -> Sizes {
        Sizes { extent: Extent::new(x, y, self.z), channels: self.channels, times: self.times }
    }

    /// Returns the sizes in pages: samples within a page do not count as channels.
    ///
    /// # Errors
    /// If pages of this format contradict the description.
    pub(super) fn page_sizes(&self, format: &PageFormat) -> Result<Sizes, String> {
        let stored = [format.width, format.height];
        if let Some([x, y]) = self.plane.filter(|plane| *plane != stored && *plane != format.shown_size()) {
            return Err(format!(
                "its description has planes of {x}x{y} pixels, but its pages have {}x{}, so it belongs to another \
                 image; pass `axes` zyx to take the pages as they are",
                stored[0], stored[1]
            ));
        }
        let mut sizes = self.sizes(stored);
        if self.counts_samples {
            let samples = format.samples as u32;
            if !sizes.channels.is_multiple_of(samples) {
                return Err(format!("declares {} channels, but each page has {samples} samples", sizes.channels));
            }
            sizes.channels /= samples;
        }
        Ok(sizes)
    }
}

impl Description {
    /// A description with only the reason why it cannot be followed.
    pub(super) fn unreadable(problem: String) -> Self {
        Self { problem: Some(problem), ..Self::default() }
    }

    /// Sets a time axis, if valid for `times` steps.
    pub(super) fn set_time(&mut self, axis: TimeAxis, unit: &str, times: u32) {
        match axis.check(times) {
            Ok(()) => {
                let known = time_unit(unit).map(str::to_owned);
                if known.is_err() {
                    let warning = format!("The unit of time '{unit}' is not known; times are kept without a unit.");
                    self.notes.push(Note::warning(warning).settled_by(Setting::TimeUnit));
                }
                self.time = Some(TimeAxis { unit: known.ok(), ..axis });
            }
            Err(problem) => self.notes.push(
                Note::warning(format!("The description's times are left out: {problem}.")).settled_by(Setting::Times),
            ),
        }
    }

    /// Sets the time from one step to the next: an axis for several steps, else a property of the one.
    pub(super) fn set_increment(&mut self, step: f64, unit: &str, times: u32) {
        match times {
            2.. => self.set_time(TimeAxis { step, ..TimeAxis::default() }, unit, times),
            _ => self.step_time.increment = TimeSpan::of(step, unit),
        }
    }

    /// Sets the times of all steps, if valid. `whose` they are is said in the note, if not.
    pub(super) fn set_stamps(&mut self, stamps: Vec<f64>, unit: &str, whose: &str) {
        let times = stamps.len() as u32;
        match TimeAxis::of_stamps(stamps, None) {
            Ok(axis) => self.set_time(axis, unit, times),
            Err(problem) => self
                .notes
                .push(Note::warning(format!("{whose} times are left out: {problem}.")).settled_by(Setting::Times)),
        }
    }

    /// Sets the moment from which the times count, where there are any.
    pub(super) fn set_since(&mut self, moment: Option<&str>) {
        let moment = moment.and_then(moment_in);
        match (&mut self.time, &mut self.step_time.stamp) {
            (Some(axis), _) => axis.since = moment,
            (None, Some(stamp)) => stamp.since = moment,
            (None, None) => {}
        }
    }

    pub(super) fn set_unit(&mut self, name: Option<&str>) {
        let Some(name) = name else { return };
        match unit_of(name) {
            Some(unit) => self.unit = Some(unit.name),
            None => {
                let warning = format!("The unit '{name}' is not known; lengths are kept without a unit.");
                self.notes.push(Note::warning(warning).settled_by(Setting::Unit));
            }
        }
    }

    /// Sets physical sizes along x, y and z, each with OME's name of its unit, in the unit of x. A missing y is x's.
    pub(super) fn set_physical_sizes(&mut self, sizes: [Option<(f64, String)>; 3]) {
        let [Some((x, unit)), y, z] = sizes else { return };
        self.set_unit(Some(&unit));
        let in_x = |size: Option<(f64, String)>| {
            let (size, own) = size?;
            if own == unit { Some(size) } else { Some(unit_of(&own)?.convert(size, unit_of(&unit)?)) }
        };
        self.spacing = Some(Spacing { x, y: in_x(y).unwrap_or(x), z: in_x(z) });
    }

    /// Returns the scale of stored numbers to values (`None` if they are equal), and a note for the user, if any. In floats, the stored
    /// number for no data becomes NaN: scaled and rounded, others may equal it.
    pub(super) fn scale(&self, format: &PageFormat, nodata: NoData) -> (Option<Scale>, Option<Note>) {
        let PageFormat { element, samples, .. } = *format;
        let (scale, note) = self.calibration.as_ref().map_or((None, None), |c| c.scale(element, samples));
        let [least, greatest] = element.limits();
        let absent = self.nodata.filter(|stored| nodata == NoData::OfFile && (least..=greatest).contains(stored));
        let marked = |scale: Scale| Scale { absent: absent.filter(|_| scale.to == VoxelType::F32), ..scale };
        (scale.map(marked), note)
    }

    /// Adds the unit of values to `info`, unless they are kept as stored, with this warning.
    pub(super) fn place_values(&self, info: &mut SourceInfo, scale: Option<Scale>, note: Option<Note>) {
        let is_kept = scale.is_none() && note.as_ref().is_some_and(Note::is_warning);
        info.notes.extend(note);
        if let Some(unit) = self.value_unit.as_deref().filter(|_| !is_kept) {
            info.set_value_unit(unit, "ImageJ's vunit or GDAL's unit");
        }
    }

    /// The file's no-data value, after scaling stored numbers by `scale`.
    pub(super) fn nodata_value(&self, scale: Option<Scale>) -> Option<f64> {
        self.nodata.map(|stored| scale.map_or(stored, |scale| stored * scale.slope + scale.intercept))
    }

    /// Marks voxels without data in `info`, unless the user does. `scale` converts stored numbers to voxels.
    pub(super) fn mark(&self, info: &mut SourceInfo, scale: Option<Scale>, nodata: NoData) {
        if nodata != NoData::OfFile {
            return;
        }
        let absent = scale.and_then(|scale| scale.absent).filter(|_| info.voxel_type.is_float());
        if let Some(stored) = absent {
            info.knows_nodata = true;
            let stored = exact(stored, false);
            let note = format!(
                "Voxels stored as {stored} hold no data, according to the file (GDAL_NODATA): they become NaN."
            );
            info.notes.push(Note::new(note));
        } else if let Some(value) = self.nodata_value(scale) {
            info.set_nodata(value, "GDAL_NODATA");
        }
        info.knows_nodata |= self.nodata_is_nan;
    }

    /// Adds the spacing, unit, looks and notes of the description to `info`. `scale` converts stored numbers to voxels.
    pub(super) fn place(&self, info: &mut SourceInfo, element: Element, scale: Option<Scale>) {
        if let Some(spacing) = self.spacing {
            spacing.place(self.unit, info);
        }
        info.geometry.unit = self.unit.map(str::to_owned);
        // Times for another number of steps belong elsewhere.
        if self.declared.as_ref().is_some_and(|declared| declared.times == info.times) {
            info.time.clone_from(&self.time);
        }
        // Looks for another number of channels belong elsewhere.
        if self.channel_looks.len() == info.channels as usize {
            info.channel_looks.clone_from(&self.channel_looks);
            for look in &mut info.channel_looks {
                look.window = look.window.and_then(|window| window_of(window, element, scale));
            }
        }
        info.notes.extend(self.notes.iter().cloned());
    }
}

/// ImageJ's display range, which is of stored numbers, in voxels; `None` of signed bytes, which ImageJ shows as unsigned.
fn window_of(range: [f64; 2], element: Element, scale: Option<Scale>) -> Option<[f64; 2]> {
    let offset = match element {
        Element::Voxel(VoxelType::I8) => return None,
        Element::Voxel(VoxelType::I16) => SIGNED_OFFSET,
        _ => 0.0,
    };
    let [from, to] = range.map(|shown| {
        let stored = shown - offset;
        scale.map_or(stored, |scale| stored * scale.slope + scale.intercept)
    });
    Some([from.min(to), from.max(to)])
}

/// A no-data number as held by pixels of this type: for floats the nearest, since programs write the limits of f32 in few digits.
pub(super) fn nearest(value: f64, element: Element) -> f64 {
    let near = match element {
        Element::Voxel(VoxelType::F32) => f64::from(value as f32),
        Element::F16 => half::f16::from_f64(value).to_f64(),
        _ => value,
    };
    if near.is_finite() { near } else { value }
}
