//! Labels with the boxes of their voxels, found by runs: equal neighbours along x are one box.

use crate::labels::label_of;
use crate::space::VoxelBox;
use crate::voxel_type::Voxel;
use std::collections::BTreeMap;

/// Boxes of voxels by label.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct LabelBoxes(pub BTreeMap<i64, VoxelBox>);

impl LabelBoxes {
    /// Adds a box of a label's voxels.
    pub fn add(&mut self, label: i64, region: VoxelBox) {
        self.0.entry(label).and_modify(|found| *found = found.hull(region)).or_insert(region);
    }

    /// Adds all boxes of another part.
    pub fn join(&mut self, more: Self) {
        more.0.into_iter().for_each(|(label, region)| self.add(label, region));
    }

    /// Adds the voxels of a box, x fastest, row by row until there are more than `most` labels. Fractions and NaN are none.
    ///
    /// # Panics
    /// If the box is empty.
    pub fn add_voxels<T: Voxel>(&mut self, region: VoxelBox, voxels: &[T], most: usize) {
        let VoxelBox { min, max } = region;
        let places = (min.z..max.z).flat_map(|z| (min.y..max.y).map(move |y| (y, z)));
        for ((y, z), row) in places.zip(voxels.chunks_exact(region.extent().x as usize)) {
            if self.0.len() > most {
                return;
            }
            let mut x = min.x;
            for run in row.chunk_by(|a, b| a == b) {
                let end = x + run.len() as u32;
                if let Some(label) = label_of(run[0].to_f64()) {
                    self.add(label, VoxelBox::new([x, y, z], [end, y + 1, z + 1]));
                }
                x = end;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_of_voxels_have_boxes() {
        let region = VoxelBox::new([4, 2, 1], [7, 4, 2]);
        let mut found = LabelBoxes::default();
        found.add(5, VoxelBox::new([9, 3, 0], [10, 4, 1]));
        found.add_voxels(region, &[5i16, 5, -3, 0, 5, 5], 9);
        let expected = [
            (-3, VoxelBox::new([6, 2, 1], [7, 3, 2])),
            (0, VoxelBox::new([4, 3, 1], [5, 4, 2])),
            (5, VoxelBox::new([4, 2, 0], [10, 4, 2])),
        ];
        assert_eq!(found.0, BTreeMap::from(expected));
        let mut joined = LabelBoxes::default();
        joined.add(-3, VoxelBox::new([0, 0, 8], [1, 1, 9]));
        joined.join(found);
        assert_eq!(joined.0[&-3], VoxelBox::new([0, 0, 1], [7, 3, 9]));
        assert_eq!(joined.0.len(), 3);
    }

    #[test]
    fn fractions_are_no_labels_and_many_labels_end_the_search() {
        let region = VoxelBox::new([0; 3], [2, 3, 1]);
        let mut found = LabelBoxes::default();
        found.add_voxels(region, &[1.5f32, f32::NAN, f32::INFINITY, -0.0, 7.0, 8.0], 1);
        assert_eq!(found.0.keys().collect::<Vec<_>>(), [&0, &7, &8]);
        let mut few = LabelBoxes::default();
        few.add_voxels(region, &[1u8, 2, 3, 4, 5, 6], 1);
        assert_eq!(few.0.keys().collect::<Vec<_>>(), [&1, &2]);
    }
}
