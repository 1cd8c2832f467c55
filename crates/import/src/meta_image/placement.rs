//! Placement of an image, as ITK takes it: in a patient of left, back and head, each row of the matrix the direction of an axis.

use super::header::Header;
use crate::error::Result;
use crate::lengths::length_unit;
use crate::note::{Note, Setting};
use crate::placement::set_lps_matrix;
use crate::source::SourceInfo;
use brickyard_volume::TimeAxis;
use glam::DVec3;

/// Fills geometry, orientation and times of `info`; adds notes on what is left out.
pub(super) fn place(header: &Header, info: &mut SourceInfo, notes: &mut Vec<Note>) -> Result<()> {
    let count = header.dimensions()?;
    let told = match header.numbers("ElementSpacing", count)? {
        Some(spacing) => Some(spacing),
        None => header.numbers("ElementSize", count)?,
    };
    info.calibrated = told.as_ref().is_some_and(|spacing| spacing.iter().take(3).all(|n| *n != 0.0));
    if told.is_some() && !info.calibrated {
        notes.push(Note::warning("The header's spacing has a 0: 1 is taken for it.").settled_by(Setting::Spacing));
    }
    let spacing = told.unwrap_or_else(|| vec![1.0; count]);
    let spacing: Vec<f64> = spacing.iter().map(|n| if *n == 0.0 { 1.0 } else { *n }).collect();
    let in_space = |i: usize| if i < count.min(3) { spacing.get(i).copied().unwrap_or(1.0) } else { 1.0 };
    info.geometry.spacing = DVec3::new(in_space(0), in_space(1), in_space(2)).abs();
    set_unit(header, info, notes);
    let matrix = header.numbers_of(&["TransformMatrix", "Rotation", "Orientation"], count * count)?;
    let offset = header.numbers_of(&["Offset", "Position", "Origin"], count)?;
    let is_turned_about = header.numbers("CenterOfRotation", count)?.is_some_and(|at| at.iter().any(|n| *n != 0.0));
    if is_turned_about {
        notes
            .push(Note::warning("The CenterOfRotation is left out, as in ITK: the Offset is the first voxel's place."));
    }
    set_time(&spacing, matrix.as_deref(), offset.as_deref(), info, notes);
    if matrix.is_none() && offset.is_none() && spacing.iter().all(|n| *n > 0.0) {
        return Ok(());
    }
    // A negative spacing turns its axis, as in ITK.
    let cosine = |axis: usize, coordinate: usize| match &matrix {
        Some(rows) if axis.max(coordinate) < count => rows.get(axis * count + coordinate).copied().unwrap_or(0.0),
        _ => f64::from(u8::from(axis == coordinate)),
    };
    let at = |i: usize| {
        if i < count { offset.as_ref().and_then(|offset| offset.get(i)).copied().unwrap_or(0.0) } else { 0.0 }
    };
    let rows = std::array::from_fn(|row| {
        let along = |axis: usize| cosine(axis, row) * in_space(axis);
        [along(0), along(1), along(2), at(row)]
    });
    set_lps_matrix(rows, info, notes);
    note_letters(header, info, notes);
    Ok(())
}

/// Warns of letters against the matrix. They name the sides that the axes come from.
fn note_letters(header: &Header, info: &SourceInfo, notes: &mut Vec<Note>) {
    let (Some(letters), Some(orientation)) = (header.get("AnatomicalOrientation"), info.orientation) else { return };
    let opposite = |letter| {
        "RLLRAPPASIIS".chars().collect::<Vec<_>>().chunks(2).find(|pair| pair[0] == letter).map(|pair| pair[1])
    };
    let expected: Option<String> = orientation.code().chars().map(opposite).collect();
    let is_told = letters.len() == 3 && letters.chars().all(|letter| opposite(letter).is_some());
    if is_told && expected.as_deref() != Some(letters) {
        notes.push(Note::warning(format!(
            "The AnatomicalOrientation {letters} differs from the matrix, which is taken, as in ITK."
        )));
    }
}

fn set_unit(header: &Header, info: &mut SourceInfo, notes: &mut Vec<Note>) {
    let Some(unit) = header.get("DistanceUnits").filter(|unit| !unit.is_empty() && *unit != "?") else { return };
    match length_unit(unit) {
        Some(unit) => info.geometry.unit = Some(unit.to_owned()),
        None => notes.push(
            Note::warning(format!("The DistanceUnits '{unit}' are not known: they are left out."))
                .settled_by(Setting::Unit),
        ),
    }
}

/// Takes the fourth dimension as time, as ITK's users write it; its unit is unknown.
fn set_time(
    spacing: &[f64],
    matrix: Option<&[f64]>,
    offset: Option<&[f64]>,
    info: &mut SourceInfo,
    notes: &mut Vec<Note>,
) {
    let Some(step) = spacing.get(3).copied() else { return };
    notes.push(Note::new("The fourth dimension is read as time steps."));
    let is_mixed =
        |rows: &[f64]| (0..3).any(|i| [i * 4 + 3, 12 + i].iter().any(|at| rows.get(*at).is_some_and(|n| *n != 0.0)));
    if matrix.is_some_and(is_mixed) {
        notes.push(Note::warning("The matrix mixes the fourth dimension with space: that part is left out."));
    }
    let start = offset.and_then(|offset| offset.get(3)).copied().unwrap_or(0.0);
    // Default values, left by programs without times.
    if info.times < 2 || step == 1.0 && start == 0.0 {
        return;
    }
    let axis = TimeAxis { start, step, ..TimeAxis::default() };
    match axis.check(info.times) {
        Ok(()) => info.time = Some(axis),
        Err(problem) => notes
            .push(Note::warning(format!("The header's time axis is left out: {problem}.")).settled_by(Setting::Times)),
    }
}
