//! The place of an image's level: spacing, origin and units, its orientation in a body, and the times of its steps, from the document's maps.

use super::affine::Affine;
use super::image_axes::{ImageAxis, letters_of};
use super::multiscales::System;
use crate::axes::Axis;
use crate::note::{Note, Setting};
use crate::placement::set_matrix;
use crate::source::SourceInfo;
use crate::step_time::{StepTime, TimeSpan};
use brickyard_volume::units::LengthUnit;
use brickyard_volume::{TimeAxis, time_unit};
use glam::{DAffine3, DMat3, DVec3};

const SPACE: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

/// Terms of a map up to this part of the greatest are rounding.
const ROUNDING: f64 = 1e-9;

/// The document's words on a level.
pub(super) struct Placed<'a> {
    pub(super) axes: &'a [ImageAxis],
    /// Letters of the array's axes, as many, and of the coordinates, which the document has in their order.
    pub(super) letters: &'a [Option<Axis>],
    /// From numbers of voxels to coordinates, and that of the finest level.
    pub(super) map: Option<&'a Affine>,
    pub(super) finest: Option<&'a Affine>,
    pub(super) systems: &'a [System],
}

/// A map of x, y and z, as rows with the offset at their end, and whether other axes take part in it.
struct Spatial {
    map: DAffine3,
    is_mixed: bool,
}

impl Spatial {
    /// The part of a map between axes of these letters. Missing axes stay as they are.
    fn of(map: &Affine, inputs: &[Option<Axis>], outputs: &[Option<Axis>]) -> Self {
        let at = |letters: &[Option<Axis>], axis: Axis| letters.iter().position(|letter| *letter == Some(axis));
        let (columns, rows) = (SPACE.map(|axis| at(inputs, axis)), SPACE.map(|axis| at(outputs, axis)));
        let mut matrix = [[0.0; 3]; 3];
        let mut offset = DVec3::ZERO;
        let mut is_mixed = false;
        for (r, row) in rows.iter().enumerate() {
            let Some(row) = row else {
                matrix[r][r] = 1.0;
                continue;
            };
            for (c, column) in columns.iter().enumerate() {
                matrix[r][c] = column.map_or(0.0, |column| map.factor(*row, column));
            }
            // An axis that the input lacks has one voxel, of any size.
            if columns[r].is_none() && matrix[r] == [0.0; 3] {
                matrix[r][r] = 1.0;
            }
            offset[r] = map.offset(*row);
            is_mixed |= (0..map.inputs()).any(|c| !columns.contains(&Some(c)) && map.factor(*row, c) != 0.0);
        }
        let mut matrix3 = DMat3::from_cols_array_2d(&matrix).transpose();
        if columns[2].is_none() && matrix3.z_axis == DVec3::ZERO {
            matrix3.z_axis = matrix3.x_axis.cross(matrix3.y_axis).normalize_or(DVec3::Z);
        }
        Self { map: DAffine3 { matrix3, translation: offset }, is_mixed }
    }

    /// Factors along x, y, z, where each coordinate follows from its own axis alone.
    fn factors(map: &DAffine3) -> Option<DVec3> {
        let columns = map.matrix3.to_cols_array_2d();
        let greatest = columns.iter().flatten().fold(0.0, |most: f64, number| most.max(number.abs()));
        let is_apart = (0..3).all(|c| (0..3).all(|r| r == c || columns[c][r].abs() <= ROUNDING * greatest));
        is_apart.then(|| DVec3::from_array(std::array::from_fn(|axis| columns[axis][axis])))
    }
}

/// Sets geometry, orientation and times. Returns the times of a single step.
pub(super) fn place(placed: &Placed<'_>, info: &mut SourceInfo) -> StepTime {
    let Some(map) = placed.map else { return StepTime::default() };
    let spatial = Spatial::of(map, placed.letters, placed.letters);
    if spatial.is_mixed {
        let note = "A transformation mixes time or channels with space: that part is left out.";
        info.notes.push(Note::warning(note).settled_by(Setting::Place));
    }
    let has_units = set_units(placed, &spatial.map, info);
    // A scale of 1 without a unit is written by programs that know none.
    let finest = placed.finest.map(|finest| Spatial::of(finest, placed.letters, placed.letters).map.matrix3);
    info.calibrated &= has_units || finest.is_some_and(|finest| finest != DMat3::IDENTITY);
    place_in_body(placed, &(converted(placed, info) * spatial.map), info);
    times(placed, map, info)
}

/// Sets spacing and origin by the map, and the units. Returns whether there is a unit.
fn set_units(placed: &Placed<'_>, map: &DAffine3, info: &mut SourceInfo) -> bool {
    let mut spacing = match Spatial::factors(map) {
        Some(factors) => factors.abs(),
        None => DVec3::from_array(std::array::from_fn(|axis| map.matrix3.col(axis).length())),
    };
    info.calibrated = true;
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        if !(spacing[axis].is_finite() && spacing[axis] > 0.0) {
            let note = format!("The scale along {name} is {}: 1 is taken.", spacing[axis]);
            info.notes.push(Note::warning(note).settled_by(Setting::Spacing));
            spacing[axis] = 1.0;
            info.calibrated = false;
        }
    }
    info.geometry.spacing = spacing;
    info.geometry.origin = map.translation;
    let units = units_of(placed.axes, placed.letters);
    let first = units.iter().flatten().next().cloned();
    let Some(first) = first else { return false };
    let is_told = |at: usize| placed.letters.contains(&Some(SPACE[at]));
    if (0..3).any(|at| is_told(at) && units[at].is_none()) {
        let note = "Some axes of space have no unit: `unit` gives all three.";
        info.notes.push(Note::warning(note).settled_by(Setting::Unit));
    }
    // The document has nothing along axes that it lacks.
    let unit = |at: usize| match &units[at] {
        Some(unit) => unit.clone(),
        None if is_told(at) => String::new(),
        None => first.clone(),
    };
    let units = [0, 1, 2].map(unit);
    info.take_axis_units(units.each_ref().map(String::as_str));
    for at in (0..3).filter(|at| !is_told(*at)) {
        (info.geometry.spacing[at], info.geometry.origin[at]) = (1.0, 0.0);
    }
    true
}

/// Units of x, y and z; a pixel is none.
fn units_of(axes: &[ImageAxis], letters: &[Option<Axis>]) -> [Option<String>; 3] {
    SPACE.map(|axis| {
        let at = letters.iter().position(|letter| *letter == Some(axis))?;
        let unit = axes.get(at)?.unit.as_deref()?.trim();
        let is_none = ["", "pixel", "pixels", "voxel", "voxels", "index"].contains(&unit);
        (!is_none).then(|| unit.to_owned())
    })
}

/// The map from coordinates in the document's units to those in the volume's.
fn converted(placed: &Placed<'_>, info: &SourceInfo) -> DAffine3 {
    let units = units_of(placed.axes, placed.letters);
    let factor = |at: usize| {
        let own = units[at].as_deref().and_then(LengthUnit::of_text)?;
        Some(own.convert(1.0, LengthUnit::named(info.geometry.axis_unit(at)?)?))
    };
    DAffine3::from_scale(DVec3::from_array([0, 1, 2].map(|at| factor(at).unwrap_or(1.0))))
}

/// Signs and axes of a body's right, front and head, by the directions of x, y and z; `None` unless all three are known.
fn body(axes: &[ImageAxis], letters: &[Option<Axis>]) -> Option<DMat3> {
    let column = |axis: Axis| {
        let at = letters.iter().position(|letter| *letter == Some(axis))?;
        Some(match axes.get(at)?.direction.as_deref()? {
            "left-to-right" => DVec3::X,
            "right-to-left" => DVec3::NEG_X,
            "posterior-to-anterior" => DVec3::Y,
            "anterior-to-posterior" => DVec3::NEG_Y,
            "inferior-to-superior" => DVec3::Z,
            "superior-to-inferior" => DVec3::NEG_Z,
            _ => return None,
        })
    };
    let matrix = DMat3::from_cols(column(Axis::X)?, column(Axis::Y)?, column(Axis::Z)?);
    (matrix.determinant().abs() == 1.0).then_some(matrix)
}

/// Sets the orientation: by the directions of the axes, by those of a further system, or where the map turns the volume.
fn place_in_body(placed: &Placed<'_>, map: &DAffine3, info: &mut SourceInfo) {
    let mut notes = Vec::new();
    let is_straight = |map: &DAffine3| Spatial::factors(map).is_some_and(|factors| factors.min_element() >= 0.0);
    let says_direction = placed.axes.iter().any(|axis| axis.direction.is_some());
    let mut left_out = Vec::new();
    let mut turned = None;
    let mut in_body = body(placed.axes, placed.letters).map(|body| DAffine3::from_mat3(body) * *map);
    if in_body.is_none() && says_direction {
        notes.push(Note::warning("The axes' anatomical orientations are left out: they are not those of left, back and head, one for each axis."));
    }
    for system in placed.systems {
        let of_system = system_map(system, placed, info).map(|system_map| system_map * *map);
        let letters = letters_of(&system.axes);
        match (of_system, body(&system.axes, &letters)) {
            (Some(found), Some(body)) if in_body.is_none() => in_body = Some(DAffine3::from_mat3(body) * found),
            (Some(found), None) if turned.is_none() && !is_straight(&found) => turned = Some((found, &system.name)),
            _ => left_out.push(system.name.as_str()),
        }
    }
    let chosen = match (in_body, turned) {
        (Some(found), turned) => {
            left_out.extend(turned.map(|(_, name)| name.as_str()));
            Some(found)
        }
        (None, Some((found, name))) => {
            let note = format!(
                "The image is turned in the coordinate system {name:?}: its axes are taken as right, front and head."
            );
            notes.push(Note::new(note));
            Some(found)
        }
        (None, None) if !is_straight(map) => {
            notes.push(Note::new("The image is turned or mirrored by its transformation: the axes of its coordinates are taken as right, front and head."));
            info.geometry.origin = DVec3::ZERO;
            Some(*map)
        }
        (None, None) => None,
    };
    if !left_out.is_empty() {
        notes.push(Note::new(format!("Further coordinate systems are left out: {}.", left_out.join(", "))));
    }
    if let Some(map) = chosen {
        let columns = map.matrix3.to_cols_array_2d();
        let offset = map.translation.to_array();
        // No negative zeros, which only look like a difference.
        let row = |r: usize| [columns[0][r], columns[1][r], columns[2][r], offset[r]].map(|number| number + 0.0);
        set_matrix([0, 1, 2].map(row), info, &mut notes);
    }
    info.notes.append(&mut notes);
}

/// The map from the image's coordinates to a further system's, in the volume's unit.
fn system_map(system: &System, placed: &Placed<'_>, info: &SourceInfo) -> Option<DAffine3> {
    let (own, letters) = (placed.letters, letters_of(&system.axes));
    let spatial = match system.is_inverse {
        false => Spatial::of(&system.map, own, &letters),
        true => Spatial::of(&system.map, &letters, own),
    };
    let map = if system.is_inverse { spatial.map.inverse() } else { spatial.map };
    // Coordinates are of the document's units on both sides.
    let to_document = converted(placed, info).inverse();
    let units = units_of(&system.axes, &letters);
    let volume = info.geometry.unit.as_deref().and_then(LengthUnit::named);
    let factor = |at: usize| {
        let unit = units[at].as_deref().and_then(LengthUnit::of_text)?;
        Some(unit.convert(1.0, volume?))
    };
    let to_volume = DAffine3::from_scale(DVec3::from_array([0, 1, 2].map(|at| factor(at).unwrap_or(1.0))));
    let map = to_volume * map * to_document;
    (map.is_finite() && !spatial.is_mixed).then_some(map)
}

/// Sets the times of the steps. Returns those of a single step.
fn times(placed: &Placed<'_>, map: &Affine, info: &mut SourceInfo) -> StepTime {
    let at = placed.letters.iter().position(|letter| *letter == Some(Axis::T));
    let Some(at) = at else { return StepTime::default() };
    let (step, start) = (map.factor(at, at), map.offset(at));
    let said = placed.axes.get(at).and_then(|axis| axis.unit.as_deref()).filter(|unit| !unit.trim().is_empty());
    let unit = said.and_then(|unit| time_unit(unit.trim()).ok());
    if let (Some(said), None) = (said, unit) {
        let said: String = said.chars().take(40).collect();
        let note = format!("Times are in {said:?}, which is no known unit: it is left out.");
        info.notes.push(Note::warning(note).settled_by(Setting::TimeUnit));
    }
    // Default values, left by programs without times.
    if unit.is_none() && step == 1.0 && start == 0.0 {
        return StepTime::default();
    }
    if info.times < 2 {
        let span = |number: f64| TimeSpan { number, unit, since: None };
        return StepTime {
            increment: (step > 0.0 && step != 1.0).then(|| span(step)),
            stamp: (start != 0.0).then(|| span(start)),
        };
    }
    let axis = TimeAxis { start, step, unit: unit.map(str::to_owned), ..TimeAxis::default() };
    match axis.check(info.times) {
        Ok(()) => info.time = Some(axis),
        Err(problem) => {
            let note = format!("The image's times are left out: {problem}.");
            info.notes.push(Note::warning(note).settled_by(Setting::Times));
        }
    }
    StepTime::default()
}
