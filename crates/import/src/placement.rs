//! A header's matrix that says how a volume lies in a patient: kept whole, and as an origin, too, where the volume is upright.

use crate::note::Note;
use crate::source::SourceInfo;
use brickyard_volume::Orientation;

/// Fills the orientation of a volume whose spacing is set, from world-from-voxel-centre of a world of x to the right, y to the front, z to the
/// head; and the origin, where spacing and origin say the same. A matrix that cannot be used is left out, with a note.
pub(crate) fn set_matrix(matrix: [[f64; 4]; 3], info: &mut SourceInfo, notes: &mut Vec<Note>) {
    match Orientation::new(matrix) {
        Ok(orientation) => {
            if orientation.is_upright() {
                info.geometry.origin = orientation.first_centre();
            }
            info.orientation = Some(orientation);
        }
        Err(error) => notes.push(Note::warning(format!(
            "The header's matrix says nothing of where the volume lies ({error}): the volume is shown along its own axes."
        ))),
    }
}
