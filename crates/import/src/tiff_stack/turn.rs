//! Orientation of stored pages (TIFF's Orientation): rows from below, columns from the right, rows as columns. Planes are read as
//! shown; a turn costs one more copy of each.

use brickyard_volume::VoxelBox;

/// Turn from a stored page to the shown one.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Turn {
    /// Stored rows are columns.
    transposed: bool,
    /// The first column is at the right.
    flip_x: bool,
    /// The first row is below.
    flip_y: bool,
}

impl Turn {
    /// The turn for a value of Orientation, from 1 to 8; `None` for others.
    pub(super) fn of_orientation(value: u16) -> Option<Self> {
        let turn = |transposed, flip_x, flip_y| Some(Self { transposed, flip_x, flip_y });
        match value {
            1 => turn(false, false, false),
            2 => turn(false, true, false),
            3 => turn(false, true, true),
            4 => turn(false, false, true),
            5 => turn(true, false, false),
            6 => turn(true, true, false),
            7 => turn(true, true, true),
            8 => turn(true, false, true),
            _ => None,
        }
    }

    /// Whether pages are stored as shown.
    pub(super) fn is_none(self) -> bool {
        self == Self::default()
    }

    /// Converts values along the stored x and y to the shown ones.
    pub(super) fn meant<T>(self, [x, y]: [T; 2]) -> [T; 2] {
        if self.transposed { [y, x] } else { [x, y] }
    }

    /// A page's region as stored. `size` is the page's own along x and y.
    pub(super) fn stored(self, region: VoxelBox, size: [u32; 2]) -> VoxelBox {
        let along = |flip: bool, axis: usize, low: u32, high: u32| {
            if flip { [size[axis] - high, size[axis] - low] } else { [low, high] }
        };
        let x = along(self.flip_x, 0, region.min.x, region.max.x);
        let y = along(self.flip_y, 1, region.min.y, region.max.y);
        let [x, y] = self.meant([x, y]);
        VoxelBox::new([x[0], y[0], region.min.z], [x[1], y[1], region.max.z])
    }

    /// Turns stored voxels of `voxel` bytes each. `size` is the turned size along x and y.
    pub(super) fn turn(self, stored: &[u8], size: [u32; 2], voxel: usize, out: &mut [u8]) {
        let [columns, rows] = size.map(|n| n as usize);
        let [stored_columns, _] = self.meant([columns, rows]);
        for (i, to) in out.chunks_exact_mut(voxel).enumerate() {
            let (x, y) = (i % columns, i / columns);
            let x = if self.flip_x { columns - 1 - x } else { x };
            let y = if self.flip_y { rows - 1 - y } else { y };
            let [column, row] = self.meant([x, y]);
            let from = (row * stored_columns + column) * voxel;
            to.copy_from_slice(&stored[from..from + voxel]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The corners where the standard puts the first row and the first column.
    #[test]
    fn the_first_pixel_goes_where_the_standard_puts_it() {
        // Stored: 3 columns, 2 rows.
        let stored = [1, 2, 3, 4, 5, 6];
        for (orientation, size, expected) in [
            (1, [3, 2], [1, 2, 3, 4, 5, 6]),
            (2, [3, 2], [3, 2, 1, 6, 5, 4]),
            (3, [3, 2], [6, 5, 4, 3, 2, 1]),
            (4, [3, 2], [4, 5, 6, 1, 2, 3]),
            (5, [2, 3], [1, 4, 2, 5, 3, 6]),
            (6, [2, 3], [4, 1, 5, 2, 6, 3]),
            (7, [2, 3], [6, 3, 5, 2, 4, 1]),
            (8, [2, 3], [3, 6, 2, 5, 1, 4]),
        ] {
            let turn = Turn::of_orientation(orientation).unwrap();
            assert_eq!(turn.meant([3, 2]), size, "{orientation}");
            let mut out = [0; 6];
            turn.turn(&stored, size, 1, &mut out);
            assert_eq!(out, expected, "{orientation}");
            // One pixel at a time.
            for i in 0..6u32 {
                let [x, y] = [i % size[0], i / size[0]];
                let place = turn.stored(VoxelBox::new([x, y, 4], [x + 1, y + 1, 5]), size);
                assert_eq!(place.extent().volume(), 1);
                let at = (place.min.y * 3 + place.min.x) as usize;
                assert_eq!(stored[at], expected[i as usize], "{orientation} {x} {y}");
            }
        }
        assert_eq!([0, 9].map(Turn::of_orientation), [None, None]);
        assert!(Turn::of_orientation(1).is_some_and(Turn::is_none));
    }
}
