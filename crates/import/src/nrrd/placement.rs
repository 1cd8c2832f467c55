//! Placement of an array: by directions and origin in a space, or axis by axis by spacings, or by the ends of the axes; and the times of its steps.

use super::header::Header;
use super::kinds::Axes;
use crate::error::Result;
use crate::note::{Note, Setting};
use crate::placement::set_matrix;
use crate::source::SourceInfo;
use brickyard_volume::units::LengthUnit;
use brickyard_volume::{TimeAxis, time_unit};
use glam::DVec3;

/// A named space.
struct Space {
    /// Number of coordinates, that of time included.
    dimension: usize,
    /// Signs that turn a patient's coordinates to the right, the front and the head; `None` for a space of another kind.
    to_right_front_head: Option<[f64; 3]>,
}

impl Space {
    fn named(name: &str) -> Option<Self> {
        let lower = name.to_lowercase();
        let (place, has_time) = match lower.strip_suffix("-time") {
            Some(place) => (place, true),
            None => match &*lower {
                "rast" => ("ras", true),
                "last" => ("las", true),
                "lpst" => ("lps", true),
                other => (other, false),
            },
        };
        let (dimension, signs) = match place {
            "right-anterior-superior" | "ras" => (3, Some([1.0, 1.0, 1.0])),
            "left-anterior-superior" | "las" => (3, Some([-1.0, 1.0, 1.0])),
            "left-posterior-superior" | "lps" => (3, Some([-1.0, -1.0, 1.0])),
            "scanner-xyz" | "3d-right-handed" | "3d-left-handed" => (3, None),
            "right-up" | "right-down" if !has_time => (2, None),
            _ => return None,
        };
        Some(Self { dimension: dimension + usize::from(has_time), to_right_front_head: signs })
    }

    fn of(header: &Header) -> Result<Option<Self>> {
        let dimension = header.get("spacedimension");
        let dimension = dimension.map(|n| n.parse::<usize>().ok().filter(|n| (1..=4).contains(n)));
        let dimension = dimension.map(|n| n.ok_or_else(|| header.not_valid("spacedimension"))).transpose()?;
        let Some(name) = header.get("space") else {
            return Ok(dimension.map(|dimension| Self { dimension, to_right_front_head: None }));
        };
        let advice = "give its axes with `space: left-posterior-superior` or `space dimension`";
        let space = Self::named(name).ok_or_else(|| header.unsupported(format!("space {name}"), advice))?;
        if dimension.is_some_and(|n| n != space.dimension) {
            return Err(header.not_valid("spacedimension"));
        }
        Ok(Some(space))
    }
}

/// Fills geometry, orientation and times of `info`; adds notes on what is left out.
pub(super) fn place(header: &Header, axes: &Axes, info: &mut SourceInfo, notes: &mut Vec<Note>) -> Result<()> {
    let space = Space::of(header)?;
    let directions = header.vectors("spacedirections")?;
    match (directions, space) {
        (Some(directions), Some(space)) => place_in_space(header, axes, &directions, &space, info, notes)?,
        (Some(_), None) => {
            return Err(header.invalid("has space directions, but neither 'space' nor 'space dimension'"));
        }
        (None, space) => {
            if space.is_some() && header.get("spaceorigin").is_some() {
                let note = "The space origin is left out: without space directions it places nothing.";
                notes.push(Note::warning(note).settled_by(Setting::Origin));
            }
            place_by_axes(header, axes, info, notes)?;
            set_time(header, axes, info, notes)?;
        }
    }
    if info.channels > 1 && header.get("measurementframe").is_some() {
        notes.push(Note::warning("The measurement frame is left out: components are as stored."));
    }
    Ok(())
}

/// Three axes in space, the missing ones made up.
struct Frame {
    steps: [DVec3; 3],
    origin: DVec3,
    /// Lengths of the header's own steps.
    spacing: [f64; 3],
}

fn place_in_space(
    header: &Header,
    axes: &Axes,
    directions: &[Option<Vec<f64>>],
    space: &Space,
    info: &mut SourceInfo,
    notes: &mut Vec<Note>,
) -> Result<()> {
    if directions.iter().flatten().any(|vector| vector.len() != space.dimension) {
        return Err(header.not_valid("spacedirections"));
    }
    let origin = origin_of(header, space, notes)?;
    let has_time = space.dimension == 4;
    let step = |axis: usize| directions.get(axis).and_then(Option::as_deref);
    let lengths = Lengths::of(header, space.dimension.min(3))?;
    let in_space = axes.space.iter().filter_map(|axis| Some(lengths.in_first(vector(step(*axis)?))));
    let in_space: Vec<DVec3> = in_space.collect();
    let frame = Frame::of(&in_space, lengths.in_first(vector(&origin)), space.dimension);
    info.geometry.spacing = DVec3::from_array(frame.spacing);
    info.calibrated = in_space.iter().all(|step| step.is_finite() && step.length() > 0.0);
    if !info.calibrated {
        info.geometry.spacing = DVec3::ONE;
        notes.push(Note::warning("The space directions give no spacing: 1 is taken.").settled_by(Setting::Spacing));
    }
    set_unit(&lengths, info, notes);
    let signs = space.to_right_front_head.unwrap_or([1.0; 3]);
    let rows = std::array::from_fn(|row| {
        let along = |column: usize| frame.steps[column].to_array()[row];
        let numbers = [along(0), along(1), along(2), frame.origin.to_array()[row]];
        // No negative zeros, which only look like a difference.
        numbers.map(|n| n * signs[row] + 0.0)
    });
    set_matrix(rows, info, notes);
    if space.to_right_front_head.is_none() {
        forget_patient(info, notes);
    }
    let Some(time) = axes.time else { return Ok(()) };
    match step(time).filter(|_| has_time) {
        Some(vector) => set_time_of_space(axes, directions, vector, origin.get(3).copied(), info, notes),
        None => set_time(header, axes, info, notes)?,
    }
    Ok(())
}

impl Frame {
    /// Completes the steps of fewer than three axes with steps of 1 across them.
    fn of(steps: &[DVec3], origin: DVec3, dimension: usize) -> Self {
        let x = steps.first().copied().unwrap_or(DVec3::X);
        let y = steps.get(1).copied().unwrap_or_else(|| match dimension {
            1 => DVec3::Y,
            _ => x.try_normalize().map_or(DVec3::Y, |x| x.any_orthonormal_vector()),
        });
        let z = steps.get(2).copied().unwrap_or_else(|| match dimension {
            1 | 2 => DVec3::Z,
            _ => x.cross(y).try_normalize().unwrap_or(DVec3::Z),
        });
        let steps = [x, y, z];
        Self { steps, origin, spacing: steps.map(DVec3::length) }
    }
}

/// The first three coordinates, missing ones 0.
fn vector(numbers: &[f64]) -> DVec3 {
    let at = |i: usize| numbers.get(i).copied().unwrap_or(0.0);
    DVec3::new(at(0), at(1), at(2))
}

fn origin_of(header: &Header, space: &Space, notes: &mut Vec<Note>) -> Result<Vec<f64>> {
    let Some(vectors) = header.vectors("spaceorigin")? else { return Ok(vec![0.0; space.dimension]) };
    let [origin] = &vectors[..] else { return Err(header.not_valid("spaceorigin")) };
    match origin {
        Some(origin) if origin.len() != space.dimension => Err(header.not_valid("spaceorigin")),
        Some(origin) if origin.iter().all(|n| n.is_finite()) => Ok(origin.clone()),
        _ => {
            notes.push(Note::warning("The space origin is unknown: 0 is taken.").settled_by(Setting::Origin));
            Ok(vec![0.0; space.dimension])
        }
    }
}

/// Leaves a space that is no patient's to origin and spacing where these say all; elsewhere its matrix is kept, as its letters cannot be.
fn forget_patient(info: &mut SourceInfo, notes: &mut Vec<Note>) {
    let Some(orientation) = info.orientation else { return };
    if orientation.is_upright() {
        info.orientation = None;
        return;
    }
    let note = "The space is none of a patient's: the directions are kept, but right, front and head mean only its x, y \
                and z.";
    notes.push(Note::warning(note));
}

/// Spacing and origin from `spacings`, `axis mins` and `axis maxs`.
fn place_by_axes(header: &Header, axes: &Axes, info: &mut SourceInfo, notes: &mut Vec<Note>) -> Result<()> {
    let samples = Samples::of(header)?;
    let extent = info.extent.to_array();
    let (mut spacing, mut origin, mut known) = ([1.0; 3], [0.0; 3], true);
    for (place, axis) in axes.space.iter().enumerate() {
        let step = samples.step(*axis, extent[place]);
        known &= step.is_some_and(|step| step > 0.0);
        let Some(step) = step.filter(|step| *step != 0.0) else { continue };
        if step < 0.0 {
            let note = format!("The step along axis {axis} is {step}, which must be positive: 1 is taken.");
            notes.push(Note::warning(note).settled_by(Setting::Spacing));
            continue;
        }
        (spacing[place], origin[place]) = (step, samples.start(*axis, step).unwrap_or(0.0));
    }
    info.geometry.spacing = DVec3::from_array(spacing);
    info.geometry.origin = DVec3::from_array(origin);
    info.calibrated = known;
    let Some(units) = header.quoted("units")? else { return Ok(()) };
    let told = axes.space.iter().map(|axis| units.get(*axis).map_or("", String::as_str));
    let told: Vec<&str> = told.map(|unit| if unit == "???" { "" } else { unit }).collect();
    let Some(first) = told.iter().find(|unit| !unit.is_empty()) else { return Ok(()) };
    if told.contains(&"") {
        notes.push(Note::warning("Some axes of space have no unit: `unit` gives all three.").settled_by(Setting::Unit));
    }
    // The file has nothing along made-up axes.
    info.take_axis_units(std::array::from_fn(|place| *told.get(place).unwrap_or(first)));
    info.geometry.spacing = std::array::from_fn::<f64, 3, _>(|place| match place < told.len() {
        true => info.geometry.spacing[place],
        false => 1.0,
    })
    .into();
    Ok(())
}

/// Positions of samples along each axis.
struct Samples {
    spacings: Option<Vec<f64>>,
    mins: Option<Vec<f64>>,
    maxs: Option<Vec<f64>>,
    are_nodes: Vec<bool>,
}

impl Samples {
    fn of(header: &Header) -> Result<Self> {
        let words = header.words("centerings")?.unwrap_or_default();
        let are_nodes = words.iter().map(|word| word.eq_ignore_ascii_case("node")).collect();
        let [spacings, mins, maxs] =
            [header.numbers("spacings")?, header.numbers("axismins")?, header.numbers("axismaxs")?];
        Ok(Self { spacings, mins, maxs, are_nodes })
    }

    /// Samples are cells unless told otherwise, as in teem.
    fn are_nodes(&self, axis: usize) -> bool {
        self.are_nodes.get(axis).copied().unwrap_or(false)
    }

    /// The distance of neighbours; `None` if it is unknown.
    fn step(&self, axis: usize, count: u32) -> Option<f64> {
        let at = |numbers: &Option<Vec<f64>>| numbers.as_ref()?.get(axis).copied().filter(|n| n.is_finite());
        if let Some(step) = at(&self.spacings) {
            return Some(step);
        }
        let length = at(&self.maxs)? - at(&self.mins)?;
        let step = if self.are_nodes(axis) { length / (f64::from(count) - 1.0) } else { length / f64::from(count) };
        Some(step).filter(|step| step.is_finite())
    }

    /// The place of the first sample.
    fn start(&self, axis: usize, step: f64) -> Option<f64> {
        let min = self.mins.as_ref()?.get(axis).copied().filter(|n| n.is_finite())?;
        Some(if self.are_nodes(axis) { min } else { min + step / 2.0 })
    }
}

/// Units along the axes of a space.
struct Lengths {
    units: Vec<String>,
    /// Units of length, if all are.
    lengths: Option<Vec<LengthUnit>>,
}

impl Lengths {
    fn of(header: &Header, dimension: usize) -> Result<Self> {
        let mut units = header.quoted("spaceunits")?.unwrap_or_default();
        units.truncate(dimension);
        let lengths = units.iter().map(|unit| LengthUnit::of_text(unit)).collect::<Option<Vec<_>>>();
        let lengths = lengths.filter(|lengths| lengths.len() == dimension);
        Ok(Self { units, lengths })
    }

    /// A vector, or a place, with all coordinates in the first one's unit.
    fn in_first(&self, vector: DVec3) -> DVec3 {
        let Some(lengths) = &self.lengths else { return vector };
        let mut converted = vector;
        for (axis, unit) in lengths.iter().enumerate() {
            converted[axis] = unit.convert(vector[axis], lengths[0]);
        }
        converted
    }
}

/// Takes the unit of a space, whose axes are not the volume's: other units than of length are left out.
fn set_unit(space: &Lengths, info: &mut SourceInfo, notes: &mut Vec<Note>) {
    if let Some(first) = space.lengths.as_ref().and_then(|lengths| lengths.first()) {
        info.geometry.unit = Some(first.name.to_owned());
        return;
    }
    let is_told = |unit: &&String| !unit.is_empty() && *unit != "???";
    let Some(first) = space.units.iter().find(is_told) else { return };
    if space.units.iter().all(|unit| unit == first) {
        let note = format!("The unit '{first}' is not known as one of length: it is left out.");
        return notes.push(Note::warning(note).settled_by(Setting::Unit));
    }
    info.calibrated = false;
    let note = format!("The axes have different units ({}): give spacing and unit yourself.", space.units.join(", "));
    notes.push(Note::warning(note).settled_by(Setting::Spacing));
}

/// The time axis from the fourth coordinate of a space.
fn set_time_of_space(
    axes: &Axes,
    directions: &[Option<Vec<f64>>],
    step: &[f64],
    start: Option<f64>,
    info: &mut SourceInfo,
    notes: &mut Vec<Note>,
) {
    let in_time = |axis: &usize| directions.get(*axis).and_then(Option::as_ref).and_then(|d| d.get(3)).copied();
    let is_apart = step.iter().take(3).all(|n| *n == 0.0) && axes.space.iter().all(|a| in_time(a) == Some(0.0));
    if !is_apart {
        notes.push(
            Note::warning("The time axis is left out: it is not at right angles to space.").settled_by(Setting::Times),
        );
        return;
    }
    let step = step.get(3).copied().unwrap_or_default();
    take_time(TimeAxis { start: start.unwrap_or(0.0), step, ..TimeAxis::default() }, info, notes);
}

/// The time axis from the fields of its own axis.
fn set_time(header: &Header, axes: &Axes, info: &mut SourceInfo, notes: &mut Vec<Note>) -> Result<()> {
    let Some(axis) = axes.time else { return Ok(()) };
    let units = header.quoted("units")?.unwrap_or_default();
    let unit = units.get(axis).filter(|unit| !unit.is_empty() && *unit != "???");
    let samples = Samples::of(header)?;
    let Some(step) = samples.step(axis, info.times) else { return Ok(()) };
    let known = unit.and_then(|unit| time_unit(unit).ok());
    if let (Some(unit), None) = (unit, known) {
        notes.push(
            Note::warning(format!("The unit '{unit}' is not known as one of time: steps are numbered."))
                .settled_by(Setting::Times),
        );
        return Ok(());
    }
    let start = samples.start(axis, step).unwrap_or(0.0);
    let (unit, since) = (known.map(str::to_owned), header.since.clone());
    take_time(TimeAxis { start, step, unit, since, ..TimeAxis::default() }, info, notes);
    Ok(())
}

fn take_time(axis: TimeAxis, info: &mut SourceInfo, notes: &mut Vec<Note>) {
    if info.times < 2 {
        return;
    }
    match axis.check(info.times) {
        Ok(()) => info.time = Some(axis),
        Err(problem) => notes
            .push(Note::warning(format!("The header's time axis is left out: {problem}.")).settled_by(Setting::Times)),
    }
}
