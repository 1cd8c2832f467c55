//! Dose grids of radiotherapy (RT Dose): one place for all frames, which lie at distances along the normal, and numbers of a unit of their own.

use super::header::Header;
use crate::error::{ImportError, Result};
use dicom_dictionary_std::tags;
use glam::DVec3;

/// Largest difference of two positions that are one, in mm, and of directions.
const TOLERANCE: f64 = 1e-3;

/// Whether a file is a dose grid.
pub(super) fn is_dose(header: &Header) -> bool {
    header.text(tags::MODALITY).is_some_and(|modality| modality == "RTDOSE")
}

/// Whether a file is a dose grid with a distance for each of its frames.
pub(super) fn places(header: &Header, frames: u64) -> bool {
    is_dose(header) && offsets(header).is_some_and(|offsets| offsets.len() as u64 == frames)
}

fn offsets(header: &Header) -> Option<Vec<f64>> {
    header.numbers(0, tags::GRID_FRAME_OFFSET_VECTOR)
}

/// Position of a frame of a dose grid, whose first is at `first`. Distances from the first frame begin with 0; those that begin with its height
/// are heights in the patient.
///
/// # Errors
/// If the distances begin with another number, or heights are not along the normal.
pub(super) fn position(header: &Header, frame: usize, first: DVec3, normal: DVec3) -> Result<DVec3> {
    let Some(offsets) = offsets(header).filter(|_| is_dose(header) && header.placed_frames() == 0) else {
        return Ok(first);
    };
    let (start, offset) = (offsets[0], offsets.get(frame).copied().unwrap_or(0.0));
    if start == 0.0 {
        return Ok(first + normal * offset);
    }
    if (start - first.z).abs() < TOLERANCE && 1.0 - normal.z.abs() < TOLERANCE {
        return Ok(DVec3::new(first.x, first.y, offset));
    }
    let problem = format!(
        "GridFrameOffsetVector begins with {start}, expected 0, or {} of an axial grid (ImagePositionPatient): the places \
         of its frames are not known; write the file again",
        first.z
    );
    Err(ImportError::invalid(&header.path, problem))
}

/// Value of the number 1 in a dose grid; `None` in other files.
///
/// # Errors
/// If a dose grid has none.
pub(super) fn scale(header: &Header) -> Result<Option<f64>> {
    if !is_dose(header) {
        return Ok(None);
    }
    let scale = header.numbers(0, tags::DOSE_GRID_SCALING).and_then(|numbers| numbers.first().copied());
    let problem = "DoseGridScaling is missing: the meaning of its values is not known; write the file again";
    scale.map(Some).ok_or_else(|| ImportError::invalid(&header.path, problem))
}
