//! Placement of an MRC volume: spacing from cell and intervals, position from the origin or the first indices.

use super::header::Fields;
use crate::note::{Note, Setting};
use crate::placement::set_matrix;
use crate::source::SourceInfo;
use glam::{DMat3, DVec3};

/// Greatest difference of an angle to a right one, in degrees, written in an f32.
const RIGHT_TOLERANCE: f64 = 1e-3;
/// Greatest difference of two positions that are one, in voxels.
const PLACE_TOLERANCE: f64 = 0.01;

/// Fills the geometry of `info` from a header, and adds notes on omissions and contradictions.
pub(super) fn place(fields: &Fields, info: &mut SourceInfo, notes: &mut Vec<Note>) {
    if fields.is_image_stack() && info.extent.z > 1 {
        notes.push(Note::new("A stack of images, by the header (ISPG 0): they are the slices along z."));
    }
    if fields.is_skewed {
        notes.push(Note::warning("The header's skew transformation (LSKFLG 1) is not applied."));
    }
    let step = |a: usize| if fields.intervals[a] > 0 { fields.cell[a] / f64::from(fields.intervals[a]) } else { 0.0 };
    let mut steps = [0, 1, 2].map(step);
    // Cameras leave the depth of a single image out.
    if info.extent.z == 1 && fields.cell[2] == 0.0 {
        steps[2] = steps[0];
        if steps[2] > 0.0 {
            notes.push(
                Note::new("The single section has no depth in the header: the width of a column is taken.")
                    .settled_by(Setting::Spacing),
            );
        }
    }
    if !steps.iter().all(|&step| step > 0.0 && step.is_finite()) {
        if fields.cell != [0.0; 3] {
            let (cell, intervals) = (fields.cell, fields.intervals);
            let problem = format!("The cell, {cell:?} angstroms in {intervals:?} intervals, gives no voxel size.");
            notes.push(Note::warning(problem).settled_by(Setting::Spacing));
        }
        if fields.origin != [0.0; 3] || fields.starts != [0; 3] {
            notes.push(
                Note::new("Without a voxel size, the header's position is left out.").settled_by(Setting::Origin),
            );
        }
        return;
    }
    info.calibrated = true;
    info.geometry.spacing = DVec3::from_array(steps);
    info.geometry.unit = Some("angstrom".into());
    let edges = edges(fields.angles).unwrap_or_else(|| {
        let angles = fields.angles;
        notes.push(Note::warning(format!("No cell has the angles {angles:?} degrees: right angles are taken.")));
        DMat3::IDENTITY
    });
    let voxel = edges * DMat3::from_diagonal(info.geometry.spacing);
    let origin = origin(fields, voxel, notes);
    if edges == DMat3::IDENTITY {
        info.geometry.origin = origin;
        return;
    }
    let [x, y, z] = [voxel.x_axis, voxel.y_axis, voxel.z_axis];
    set_matrix(std::array::from_fn(|r| [x[r], y[r], z[r], origin[r]]), info, notes);
    notes.push(Note::warning(format!(
        "The cell's angles are {:?} degrees: the volume is sheared by a matrix, whose axes are not a patient's, and \
         the spacing is along the cell's edges.",
        fields.angles
    )));
}

/// Directions of the cell's edges: x along the first, y in the plane of two. Angles of 0 are not set.
fn edges(angles: [f64; 3]) -> Option<DMat3> {
    let is_right = |angle: f64| (angle - 90.0).abs() < RIGHT_TOLERANCE;
    if angles == [0.0; 3] || angles.iter().all(|&angle| is_right(angle)) {
        return Some(DMat3::IDENTITY);
    }
    if !angles.iter().all(|&angle| angle > 0.0 && angle < 180.0) {
        return None;
    }
    let [alpha, beta, gamma] = angles.map(|angle| if is_right(angle) { 0.0 } else { angle.to_radians().cos() });
    let sine = (1.0 - gamma * gamma).sqrt();
    let across = (alpha - beta * gamma) / sine;
    let up = 1.0 - beta * beta - across * across;
    (up > 0.0).then(|| DMat3::from_cols(DVec3::X, DVec3::new(gamma, sine, 0.0), DVec3::new(beta, across, up.sqrt())))
}

/// Centre of the first voxel: the origin unless it is zero, else the first indices. Of files with both, newer ones mean the origin;
/// many leave it zero (so ChimeraX, too).
fn origin(fields: &Fields, steps: DMat3, notes: &mut Vec<Note>) -> DVec3 {
    let axes = fields.axes().unwrap_or([0, 1, 2]);
    let mut starts = [0.0; 3];
    for (axis, start) in axes.into_iter().zip(fields.starts) {
        starts[axis] = f64::from(start);
    }
    let (origin, by_start) = (DVec3::from_array(fields.origin), steps * DVec3::from_array(starts));
    if !origin.is_finite() {
        notes.push(
            Note::warning(format!("ORIGIN is {:?}, which is no position: it is left out.", fields.origin))
                .settled_by(Setting::Origin),
        );
        return by_start;
    }
    if origin == DVec3::ZERO {
        return by_start;
    }
    if starts != [0.0; 3] && (steps.inverse() * (origin - by_start)).abs().max_element() > PLACE_TOLERANCE {
        notes.push(Note::warning(format!(
            "The header has two positions of the first voxel: ORIGIN {origin}, which is taken, and {by_start} by NXSTART, \
             NYSTART, NZSTART."
        )).settled_by(Setting::Origin));
    }
    if fields.has_imod_origin() {
        notes.push(
            Note::warning(
                "The origin may have the opposite sign: IMOD wrote it, without the flag of the standard's sign.",
            )
            .settled_by(Setting::Origin),
        );
    }
    origin
}
