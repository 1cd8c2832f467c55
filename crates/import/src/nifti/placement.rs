//! Placement of a NIfTI volume: spacing from `pixdim`, position from the sform or, without one, the qform; times from `pixdim`
//! and `toffset`.

use super::fields::Fields;
use crate::note::{Note, Setting};
use crate::placement::set_matrix;
use crate::source::SourceInfo;
use brickyard_volume::TimeAxis;
use glam::DVec3;

/// Largest relative difference of spacings in `pixdim` and the affine.
const SPACING_TOLERANCE: f64 = 1e-3;

/// Fills the geometry and orientation of `info` from a header, and adds notes on omissions and contradictions.
pub(super) fn place(header: &Fields, info: &mut SourceInfo, notes: &mut Vec<Note>) {
    let sizes = [1, 2, 3].map(|i| header.pixdim[i].abs());
    let sound = sizes.map(|s| s > 0.0 && s.is_finite());
    let spacing: [f64; 3] = std::array::from_fn(|a| if sound[a] { sizes[a] } else { 1.0 });
    info.geometry.spacing = DVec3::from_array(spacing);
    info.calibrated = sound == [true; 3];
    if !info.calibrated {
        notes.push(
            Note::warning(format!(
                "Voxel sizes {sizes:?} in the header must be positive; 1 is taken for invalid ones."
            ))
            .settled_by(Setting::Spacing),
        );
    }
    info.geometry.unit = match header.xyzt_units & 7 {
        1 => Some("meter".into()),
        2 => Some("millimeter".into()),
        3 => Some("micrometer".into()),
        _ => None,
    };
    let Some(world_from_index) = affine(header, spacing) else { return };
    set_matrix(world_from_index, info, notes);
    let Some(orientation) = info.orientation else { return };
    for a in 0..3 {
        let length = orientation.step(a).length();
        if info.calibrated && (length - spacing[a]).abs() > SPACING_TOLERANCE * spacing[a] {
            let axis = ['x', 'y', 'z'][a];
            notes.push(Note::warning(format!(
                "The header disagrees with itself: voxel size along {axis} is {} by pixdim, {length} by its matrix; \
                 pixdim is taken as the spacing, and pictures use the matrix.",
                spacing[a]
            )));
        }
    }
}

/// Fills the time axis of `info` from a header, with a note if its steps are not of time.
pub(super) fn set_time(header: &Fields, info: &mut SourceInfo, notes: &mut Vec<Note>) {
    if info.times < 2 {
        return;
    }
    let unit = match header.xyzt_units & 56 {
        0 => None,
        8 => Some("second"),
        16 => Some("millisecond"),
        24 => Some("microsecond"),
        _ => {
            let note = "The fourth axis is not time, by the header (xyzt_units): its steps are numbered.";
            notes.push(Note::new(note).settled_by(Setting::Times));
            return;
        }
    };
    let (start, step) = (header.time_start, header.pixdim[4]);
    // Default values, left by programs without times.
    if unit.is_none() && (step == 1.0 || step == 0.0) && start == 0.0 {
        return;
    }
    let axis = TimeAxis { start, step, unit: unit.map(str::to_owned), ..TimeAxis::default() };
    match axis.check(info.times) {
        Ok(()) => info.time = Some(axis),
        Err(problem) => notes
            .push(Note::warning(format!("The header's time axis is left out: {problem}.")).settled_by(Setting::Times)),
    }
}

/// Rows of world-from-index, if the header has them.
fn affine(header: &Fields, spacing: [f64; 3]) -> Option<[[f64; 4]; 3]> {
    if header.sform_code > 0 {
        return Some(header.srow);
    }
    if header.qform_code <= 0 {
        return None;
    }
    let [b, c, d] = header.quaternion;
    let a = (1.0 - (b * b + c * c + d * d)).max(0.0).sqrt();
    // Rounded, or wrong, to more than a rotation: scaled to one, as in the NIfTI library.
    let [b, c, d] = [b, c, d].map(|n| n / (b * b + c * c + d * d).sqrt().max(1.0));
    let rotation = [
        [a * a + b * b - c * c - d * d, 2.0 * (b * c - a * d), 2.0 * (b * d + a * c)],
        [2.0 * (b * c + a * d), a * a + c * c - b * b - d * d, 2.0 * (c * d - a * b)],
        [2.0 * (b * d - a * c), 2.0 * (c * d + a * b), a * a + d * d - c * c - b * b],
    ];
    // pixdim[0] is the sign of the third axis; anything but -1 means 1.
    let sign = if header.pixdim[0] < 0.0 { -1.0 } else { 1.0 };
    let scale = [spacing[0], spacing[1], sign * spacing[2]];
    Some(std::array::from_fn(|r| {
        let row = rotation[r];
        [row[0] * scale[0], row[1] * scale[1], row[2] * scale[2], header.qoffset[r]]
    }))
}
