//! A matrix that places a volume: as spacing and origin where it is upright, else kept beside them.

use crate::source::SourceInfo;
use glam::DVec3;

/// Terms off the diagonal up to this part of the voxel size are noise of f32 arithmetic.
const DIAGONAL_TOLERANCE: f64 = 1e-4;

/// A column of a matrix of rows.
pub(crate) fn column(matrix: &[[f64; 4]; 3], a: usize) -> DVec3 {
    DVec3::new(matrix[0][a], matrix[1][a], matrix[2][a])
}

/// Fills origin or orientation of a volume whose spacing is set, from world-from-voxel-centre of a world of x to the right,
/// y to the front, z to the head.
pub(crate) fn set_matrix(matrix: [[f64; 4]; 3], info: &mut SourceInfo, notes: &mut Vec<String>) {
    let is_positive_diagonal = (0..3).all(|a| {
        let c = column(&matrix, a).to_array();
        c[a] > 0.0 && (0..3).all(|r| r == a || c[r].abs() <= DIAGONAL_TOLERANCE * c[a])
    });
    if is_positive_diagonal {
        info.geometry.origin = column(&matrix, 3);
    } else {
        info.orientation = Some(matrix);
        notes.push("The volume is rotated or mirrored against its world: the matrix is kept as metadata, and the volume is shown along its own axes.".into());
    }
}
