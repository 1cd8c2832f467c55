//! A VTK image's grid: points, cells, and their places in the world.

use super::arrays::Of;
use crate::error::{ImportError, Result};
use crate::note::{Note, Setting};
use crate::placement::set_matrix;
use crate::source::SourceInfo;
use brickyard_volume::Extent;
use glam::DVec3;
use std::path::Path;

/// Directions up to this off the axes are rounding.
const UPRIGHT: f64 = 1e-12;

/// First and last point along x, y and z; neither sizes nor order are checked.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Points(pub(super) [i64; 6]);

/// A box of points or cells, counted from the grid's first one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Part {
    pub(super) first: [u32; 3],
    pub(super) extent: Extent,
}

impl Points {
    pub(super) fn first(self) -> [i64; 3] {
        let [x, _, y, _, z, _] = self.0;
        [x, y, z]
    }

    /// Numbers of points along each axis.
    pub(super) fn counts(self, path: &Path) -> Result<[u32; 3]> {
        let [x0, x1, y0, y1, z0, z1] = self.0;
        let count = |first: i64, last: i64| last.checked_sub(first)?.checked_add(1).and_then(|n| u32::try_from(n).ok());
        let counts = [count(x0, x1), count(y0, y1), count(z0, z1)];
        match counts {
            [Some(x @ 1..), Some(y @ 1..), Some(z @ 1..)] => Ok([x, y, z]),
            _ => {
                let problem = format!("an extent of {:?} has no points, or more than 2^32 along an axis", self.0);
                Err(ImportError::invalid(path, problem))
            }
        }
    }

    /// The part of `whole` with these points, or their cells.
    pub(super) fn within(self, whole: Self, of: Of, path: &Path) -> Result<Part> {
        let (counts, all) = (self.counts(path)?, whole.counts(path)?);
        let mut first = [0; 3];
        if of == Of::Cells && (0..3).any(|axis| counts[axis] == 1 && all[axis] > 1) {
            let problem = format!("a piece of {:?} has one layer of points, and so no cells; write it whole", self.0);
            return Err(ImportError::invalid(path, problem));
        }
        for axis in 0..3 {
            let offset = self.first()[axis].checked_sub(whole.first()[axis]).and_then(|n| u32::try_from(n).ok());
            let last = offset.and_then(|n| n.checked_add(counts[axis]));
            match (offset, last) {
                (Some(offset), Some(last)) if last <= all[axis] => first[axis] = offset,
                _ => {
                    let problem = format!("a piece of {:?} leaves the whole extent {:?}", self.0, whole.0);
                    return Err(ImportError::invalid(path, problem));
                }
            }
        }
        Ok(Part { first, extent: Extent::from_array(sizes_of(counts, of)) })
    }
}

/// Numbers of points or cells on a grid with these points. An axis of one point has one layer of cells.
pub(super) fn sizes_of(points: [u32; 3], of: Of) -> [u32; 3] {
    match of {
        Of::Points => points,
        Of::Cells => points.map(|n| n.saturating_sub(1).max(1)),
    }
}

/// Placement of a grid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Grid {
    pub(super) points: Points,
    pub(super) spacing: Option<[f64; 3]>,
    /// The world's place of point (0, 0, 0), which need not be part of the grid.
    pub(super) origin: [f64; 3],
    /// Rows of a matrix whose columns are the directions of the axes.
    pub(super) direction: [f64; 9],
}

pub(super) const UPRIGHT_DIRECTION: [f64; 9] = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0];

impl Grid {
    /// Fills geometry, calibration and orientation of `info`, with notes.
    pub(super) fn place(&self, of: Of, path: &Path, info: &mut SourceInfo) -> Result<()> {
        let counts = self.points.counts(path)?;
        let said = self.spacing.unwrap_or([1.0; 3]);
        let sound = said.map(|step| step != 0.0 && step.is_finite());
        let signed: [f64; 3] = std::array::from_fn(|axis| if sound[axis] { said[axis] } else { 1.0 });
        // Writers of single slices leave their thickness at 0.
        info.calibrated = self.spacing.is_some() && (0..3).all(|axis| sound[axis] || counts[axis] == 1);
        if sound != [true; 3] {
            info.notes.push(
                Note::warning(format!(
                    "The file's spacing {said:?} is no distance between points; 1 is taken for invalid ones."
                ))
                .settled_by(Setting::Spacing),
            );
        }
        if self.origin.iter().chain(&self.direction).any(|number| !number.is_finite()) {
            let problem = "has an origin or a direction of infinite numbers; write the file again";
            return Err(ImportError::invalid(path, problem));
        }
        info.geometry.spacing = DVec3::from_array(signed.map(f64::abs));
        let first: [f64; 3] = std::array::from_fn(|axis| {
            // A cell is placed by its centre.
            let half = if of == Of::Cells && counts[axis] > 1 { 0.5 } else { 0.0 };
            (self.points.first()[axis] as f64 + half) * signed[axis]
        });
        let row = |r: usize| -> [f64; 3] { std::array::from_fn(|column| self.direction[3 * r + column]) };
        let matrix: [[f64; 4]; 3] = std::array::from_fn(|r| {
            let [x, y, z] = row(r);
            let at = self.origin[r] + x * first[0] + y * first[1] + z * first[2];
            [x * signed[0], y * signed[1], z * signed[2], at]
        });
        let is_upright = self.direction.iter().zip(UPRIGHT_DIRECTION).all(|(a, b)| (a - b).abs() <= UPRIGHT);
        if is_upright && signed.iter().all(|step| *step > 0.0) {
            // VTK's world is nobody's body: an upright grid needs no orientation.
            info.geometry.origin = DVec3::from_array(matrix.map(|[.., at]| at));
            return Ok(());
        }
        info.notes.push(Note::new(
            "The grid is turned or mirrored (Direction): its world's axes are taken as right, front and head.",
        ));
        let mut notes = Vec::new();
        set_matrix(matrix, info, &mut notes);
        info.notes.extend(notes);
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::axes::Sizes;
    use brickyard_volume::VoxelType;

    fn placed(grid: Grid, of: Of) -> SourceInfo {
        let sizes = Sizes { extent: Extent::new(1, 1, 1), channels: 1, times: 1 };
        let mut info = SourceInfo::plain(sizes, VoxelType::U8);
        grid.place(of, Path::new("a"), &mut info).unwrap();
        info
    }

    const GRID: Grid = Grid {
        points: Points([1, 3, 2, 3, -1, 0]),
        spacing: Some([2.0, 3.0, 4.0]),
        origin: [10.0, 20.0, 30.0],
        direction: UPRIGHT_DIRECTION,
    };

    #[test]
    fn starts_shift_the_origin_and_cells_lie_half_a_voxel_further() {
        let info = placed(GRID, Of::Points);
        assert_eq!((info.geometry.origin, info.calibrated), (DVec3::new(12.0, 26.0, 26.0), true));
        assert_eq!((info.geometry.spacing, info.orientation), (DVec3::new(2.0, 3.0, 4.0), None));
        assert_eq!(placed(GRID, Of::Cells).geometry.origin, DVec3::new(13.0, 27.5, 28.0));
        let flat = Grid { points: Points([0, 3, 0, 3, 5, 5]), spacing: Some([1.0, 1.0, 0.0]), ..GRID };
        let info = placed(flat, Of::Cells);
        assert_eq!((info.geometry.origin, info.calibrated), (DVec3::new(10.5, 20.5, 35.0), true));
        assert!(!placed(Grid { spacing: None, ..GRID }, Of::Points).calibrated);
        assert!(!placed(Grid { spacing: Some([0.0, 1.0, 1.0]), ..GRID }, Of::Points).calibrated);
    }

    /// By VTK's own words, the first point of this grid lies at (4, 22, 26), and the next along x at (4, 24, 26).
    #[test]
    fn columns_of_the_direction_are_the_axes() {
        let turned = Grid { direction: [0.0, -1.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0], ..GRID };
        let orientation = placed(turned, Of::Points).orientation.unwrap();
        assert_eq!(orientation.first_centre(), DVec3::new(4.0, 22.0, 26.0));
        assert_eq!(orientation.step(0), DVec3::new(0.0, 2.0, 0.0));
        let mirrored = placed(Grid { spacing: Some([-2.0, 3.0, 4.0]), ..GRID }, Of::Points);
        assert_eq!(mirrored.geometry.spacing, DVec3::new(2.0, 3.0, 4.0));
        let orientation = mirrored.orientation.unwrap();
        assert_eq!(orientation.first_centre(), DVec3::new(8.0, 26.0, 26.0));
        assert_eq!(orientation.step(0), DVec3::new(-2.0, 0.0, 0.0));
    }

    #[test]
    fn extents_are_counted_without_overflow() {
        let path = Path::new("a");
        for bad in [[0, -1, 0, 0, 0, 0], [i64::MIN, i64::MAX, 0, 0, 0, 0], [0, 1 << 40, 0, 0, 0, 0]] {
            assert!(Points(bad).counts(path).is_err());
            assert!(GRID.points.within(Points(bad), Of::Points, path).is_err());
        }
        let part = Points([2, 3, 3, 3, 0, 0]).within(GRID.points, Of::Points, path).unwrap();
        assert_eq!((part.first, part.extent), ([1, 1, 1], Extent::new(2, 1, 1)));
        assert!(Points([2, 4, 3, 3, 0, 0]).within(GRID.points, Of::Points, path).is_err());
        assert!(Points([0, 3, 3, 3, 0, 0]).within(GRID.points, Of::Points, path).is_err());
    }
}
