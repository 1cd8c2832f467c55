//! ANALYZE 7.5 headers, of which NIfTI's are a later use: the fields that mean something else there, read as SPM and nibabel do.

use super::fields::{Bytes, Fields};
use crate::note::{Note, Setting};
use crate::source::SourceInfo;
use brickyard_volume::Extent;
use glam::DVec3;
use std::path::Path;

/// The orient field: planes of the slices, of which the last three are flipped.
const ORIENTS: [&str; 6] =
    ["transverse", "coronal", "sagittal", "transverse, flipped", "coronal, flipped", "sagittal, flipped"];

/// Fields of an ANALYZE header that NIfTI has no use for.
pub(super) struct Analyze {
    orient: u8,
    /// SPM's voxel at the world's origin, counted from 1.
    origin: [i16; 3],
    /// Unit of voxel sizes; by the format's description millimetres, if empty.
    unit: String,
    /// Whether values are scaled so that the range of stored ones becomes the calibrated one.
    by_range: bool,
}

impl Analyze {
    /// Reads the fields, and puts right those of NIfTI at the same bytes.
    pub(super) fn of(bytes: &Bytes<'_>, fields: &mut Fields) -> Self {
        let unit: Vec<u8> = bytes.at_text(56..60).iter().copied().take_while(|&byte| byte != 0).collect();
        (fields.qform_code, fields.sform_code, fields.time_start, fields.xyzt_units) = (0, 0, 0.0, 0);
        // SPM's own codes of the types that ANALYZE lacks.
        fields.datatype = match fields.datatype {
            130 => 256,
            132 => 512,
            136 => 768,
            code => code,
        };
        Self {
            orient: bytes.at_text(252..253).first().copied().unwrap_or(0),
            origin: [253, 255, 257].map(|at| bytes.i16(at)),
            unit: String::from_utf8_lossy(&unit).trim().to_ascii_lowercase(),
            by_range: set_scale(bytes, fields),
        }
    }

    /// Fills in the unit and origin of a volume with its spacing, and adds notes. No orientation is kept: nothing tells left from right.
    pub(super) fn place(&self, fields: &Fields, header: &Path, info: &mut SourceInfo, notes: &mut Vec<Note>) {
        notes.push(Note::warning("An ANALYZE 7.5 header does not tell left from right: no orientation is kept."));
        info.geometry.unit = match self.unit.as_str() {
            "" | "mm" => Some("millimeter".into()),
            "cm" => Some("centimeter".into()),
            "um" => Some("micrometer".into()),
            unit => {
                notes.push(
                    Note::warning(format!("The unit of voxel sizes, '{unit}', is not known."))
                        .settled_by(Setting::Unit),
                );
                None
            }
        };
        if fields.pixdim[1..4].iter().any(|&size| size < 0.0) {
            notes.push(Note::warning("Voxel sizes below 0, for flipped axes, are taken without their sign."));
        }
        match ORIENTS.get(usize::from(self.orient)) {
            _ if self.orient == 0 => {}
            Some(orient) => {
                notes.push(Note::warning(format!("Slices are {orient}, by the header (orient {}).", self.orient)));
            }
            None => notes.push(Note::warning(format!("The header's orient, {}, has no meaning.", self.orient))),
        }
        if self.by_range {
            notes.push(Note::warning(
                "The scale of values is that of their ranges (glmin, glmax to cal_min, cal_max), as in SPM2 and nibabel.",
            ));
        }
        if header.with_extension("mat").is_file() {
            notes.push(Note::warning("The matrix in SPM's .mat file beside the header is not read."));
        }
        if let Some(first) = self.first_centre(info.extent).filter(|_| info.calibrated) {
            info.geometry.origin = first * info.geometry.spacing;
            notes.push(Note::new("The position is that of SPM's origin."));
        }
    }

    /// Centre of the first voxel, in voxels. An origin far outside the volume is other text in these bytes.
    fn first_centre(&self, extent: Extent) -> Option<DVec3> {
        let sizes = extent.to_array().map(i64::from);
        let is_near = |a: usize| i64::from(self.origin[a]) > -sizes[a] && i64::from(self.origin[a]) < 2 * sizes[a];
        let is_set = self.origin != [0; 3] && (0..3).all(is_near);
        is_set.then(|| DVec3::from_array(self.origin.map(|n| 1.0 - f64::from(n))))
    }
}

/// Sets slope and intercept by SPM2's rule: a slope in the first unused field, with an intercept in the second; without one the ranges of
/// stored and calibrated values, if both are set. Returns whether these were used.
fn set_scale(bytes: &Bytes<'_>, fields: &mut Fields) -> bool {
    if fields.slope.is_finite() && fields.slope != 0.0 {
        if !fields.intercept.is_finite() {
            fields.intercept = 0.0;
        }
        return false;
    }
    let [cal_max, cal_min] = [124, 128].map(|at| bytes.exact_f32(at) as f32);
    let [glmax, glmin] = [140, 144].map(|at| bytes.i32(at));
    let (stored, scaled) = (i64::from(glmax) - i64::from(glmin), f64::from(cal_max - cal_min));
    let slope = scaled / stored as f64;
    if stored == 0 || scaled == 0.0 || !slope.is_finite() {
        (fields.slope, fields.intercept) = (0.0, 0.0);
        return false;
    }
    (fields.slope, fields.intercept) = (slope, f64::from(cal_min) - slope * f64::from(glmin));
    (fields.slope, fields.intercept) != (1.0, 0.0)
}
