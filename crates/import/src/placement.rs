//! Placement of a volume in a patient by its header's matrix: kept whole, and also as the origin of an upright volume.

use crate::note::Note;
use crate::source::SourceInfo;
use brickyard_volume::Orientation;

/// Sets the orientation from a matrix of ITK's, DICOM's and Slicer's patient (x to the left, y to the back, z to the head):
/// see [`set_matrix`].
pub(crate) fn set_lps_matrix([x, y, z]: [[f64; 4]; 3], info: &mut SourceInfo, notes: &mut Vec<Note>) {
    set_matrix([x.map(|n| -n), y.map(|n| -n), z], info, notes);
}

/// Sets the orientation of a volume with known spacing from a world-from-voxel-centre matrix (x to the right, y to the front, z to the head),
/// and its origin if the volume is upright. An unusable matrix is left out, with a note.
pub(crate) fn set_matrix(matrix: [[f64; 4]; 3], info: &mut SourceInfo, notes: &mut Vec<Note>) {
    match Orientation::new(matrix) {
        Ok(orientation) => {
            if orientation.is_upright() {
                info.geometry.origin = orientation.first_centre();
            }
            info.orientation = Some(orientation);
        }
        Err(error) => notes.push(Note::warning(format!(
            "The header's matrix gives no valid placement ({error}): the volume is shown along its own axes."
        ))),
    }
}
