//! Every n-th voxel of a source: a small copy of a large volume, made without reading all of it. Only the needed rows are read of sources with box
//! access, and only the needed planes of sources that decode planes.

use crate::error::{ImportError, Result};
use crate::source::{Access, Source, SourceInfo};
use brickyard_volume::{Extent, PlacementError, VoxelBox};
use glam::DVec3;
use std::sync::Arc;

/// A source of every n-th voxel of another one, along each axis. Voxels keep their values, and their centres their positions in the world. The first
/// one is in the middle of the first n, so the bounding boxes agree, to half a voxel of the other source.
pub struct Strided {
    source: Arc<dyn Source>,
    info: SourceInfo,
    stride: [u32; 3],
    /// The first voxel, in the other source.
    first: [u32; 3],
}

impl Strided {
    /// Takes every n-th voxel along each axis of the source, with the least n that leaves at most `most` voxels.
    ///
    /// # Errors
    /// If the source's orientation cannot be used with voxels so large.
    ///
    /// # Panics
    /// If `most` is zero.
    pub fn new(source: Arc<dyn Source>, most: u32) -> Result<Self, PlacementError> {
        let whole = source.info();
        let stride = whole.extent.to_array().map(|n| n.div_ceil(most));
        let first = stride.map(|stride| (stride - 1) / 2);
        let mut info = whole.clone();
        info.extent = Extent::from_array(std::array::from_fn(|axis| {
            (whole.extent.to_array()[axis] - first[axis]).div_ceil(stride[axis])
        }));
        let [by, from] = [stride, first].map(|axes| DVec3::from_array(axes.map(f64::from)));
        info.geometry.origin += from * info.geometry.spacing;
        info.geometry.spacing *= by;
        info.orientation = whole.orientation.map(|orientation| orientation.strided(by, from)).transpose()?;
        info.identity = format!("{}, every {stride:?}", whole.identity);
        Ok(Self { source, info, stride, first })
    }

    /// The other source's voxels per voxel of this one, along x, y, z.
    pub fn stride(&self) -> [u32; 3] {
        self.stride
    }

    /// The other source.
    pub fn whole(&self) -> &Arc<dyn Source> {
        &self.source
    }

    /// The other source's box from the first voxel of a box to its last.
    fn box_of_whole(&self, region: VoxelBox) -> VoxelBox {
        let (min, max) = (region.min.to_array(), region.max.to_array());
        let voxel = |axis: usize, at: u32| at * self.stride[axis] + self.first[axis];
        VoxelBox::new(
            std::array::from_fn(|axis| voxel(axis, min[axis])),
            std::array::from_fn(|axis| voxel(axis, max[axis] - 1) + 1),
        )
    }

    fn pick(&self, row: &[u8], out: &mut [u8]) {
        match self.info.voxel_type.bytes() {
            1 => pick_each::<1>(row, self.stride[0], out),
            2 => pick_each::<2>(row, self.stride[0], out),
            _ => pick_each::<4>(row, self.stride[0], out),
        }
    }

    /// Reads a plane, a box one voxel thick.
    fn read_plane(&self, time: u32, channel: u32, plane: VoxelBox, out: &mut [u8]) -> Result<()> {
        let bytes = self.info.voxel_type.bytes();
        let whole = self.box_of_whole(plane);
        let own_row_bytes = plane.extent().x as usize * bytes;
        let row_bytes = whole.extent().x as usize * bytes;
        let is_lent = self.source.lend(time, channel, whole, &mut |lent| {
            for (y, row) in out.chunks_exact_mut(own_row_bytes).enumerate() {
                let from = y * self.stride[1] as usize * lent.row_bytes;
                self.pick(&lent.bytes[from..from + row_bytes], row);
            }
        })?;
        if is_lent {
            return Ok(());
        }
        let rows = out.chunks_exact_mut(own_row_bytes);
        if self.source.access() == Access::Planes {
            let mut voxels = vec![0; whole.extent().volume() as usize * bytes];
            self.source.read_box(time, channel, whole, &mut voxels)?;
            let wanted = voxels.chunks_exact(row_bytes).step_by(self.stride[1] as usize);
            wanted.zip(rows).for_each(|(voxels, row)| self.pick(voxels, row));
            return Ok(());
        }
        let mut voxels = vec![0; row_bytes];
        for (y, row) in (whole.min.y..whole.max.y).step_by(self.stride[1] as usize).zip(rows) {
            let (min, max) = ([whole.min.x, y, whole.min.z], [whole.max.x, y + 1, whole.max.z]);
            self.source.read_box(time, channel, VoxelBox::new(min, max), &mut voxels)?;
            self.pick(&voxels, row);
        }
        Ok(())
    }
}

impl Source for Strided {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn beneath(&self) -> Option<&dyn Source> {
        Some(&*self.source)
    }

    fn reader_bytes(&self) -> u64 {
        let Extent { x, y, .. } = self.source.info().extent;
        let rows = if self.access() == Access::Planes { y } else { 1 };
        let buffer = u64::from(x) * u64::from(rows) * self.info.voxel_type.bytes() as u64;
        self.source.reader_bytes().saturating_add(buffer)
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        let plane_bytes = out.len() / region.extent().z as usize;
        for (z, out) in (region.min.z..region.max.z).zip(out.chunks_exact_mut(plane_bytes)) {
            let mut plane = region;
            (plane.min.z, plane.max.z) = (z, z + 1);
            self.read_plane(time, channel, plane, out)?;
        }
        Ok(())
    }
}

/// Copies the first of every `stride` voxels, each of `BYTES` bytes.
fn pick_each<const BYTES: usize>(row: &[u8], stride: u32, out: &mut [u8]) {
    let (voxels, _) = row.as_chunks::<BYTES>();
    let (out, _) = out.as_chunks_mut::<BYTES>();
    voxels.iter().step_by(stride as usize).zip(out).for_each(|(voxel, out)| *out = *voxel);
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::open::open;
    use crate::options::OpenOptions;
    use crate::testing::{Field, temp_file};
    use brickyard_volume::{Orientation, VoxelType};

    /// A source without lending, to force reads.
    struct Unlent(Arc<dyn Source>, Access);

    impl Source for Unlent {
        fn info(&self) -> &SourceInfo {
            self.0.info()
        }
        fn access(&self) -> Access {
            self.1
        }
        fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
            assert!(region.extent().z == 1, "more than a plane is read at once");
            self.0.read_box(time, channel, region, out)
        }
    }

    fn voxel(source: &dyn Source, time: u32, channel: u32, at: [u32; 3]) -> Vec<u8> {
        let mut out = vec![0; source.info().voxel_type.bytes()];
        source.read_box(time, channel, VoxelBox::new(at, at.map(|i| i + 1)), &mut out).unwrap();
        out
    }

    #[test]
    fn every_voxel_is_the_other_source_s_at_its_place() {
        for voxel_type in [VoxelType::U8, VoxelType::I16, VoxelType::F32] {
            let field = Field { sizes: [11, 8, 5, 2, 2], voxel_type };
            let (_folder, path) = temp_file("a.raw", &field.bytes("tczyx", false));
            let options = OpenOptions {
                shape: Some(Extent::new(11, 8, 5)),
                voxel_type: Some(voxel_type.into()),
                channels: Some(2),
                times: Some(2),
                spacing: Some(DVec3::new(0.5, 1.0, 3.0)),
                origin: Some(DVec3::new(-4.0, 0.0, 7.0)),
                ..OpenOptions::default()
            };
            let lent: Arc<dyn Source> = Arc::from(open(&[path], &options).unwrap());
            for whole in [
                lent.clone(),
                Arc::new(Unlent(lent.clone(), Access::Box)),
                Arc::new(Unlent(lent.clone(), Access::Planes)),
            ] {
                let strided = Strided::new(whole.clone(), 4).unwrap();
                let info = strided.info();
                assert_eq!((strided.stride(), info.extent.to_array()), ([3, 2, 2], [4, 4, 3]));
                for (time, channel) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                    let full = info.extent.full_box();
                    let mut all = vec![0; full.extent().volume() as usize * voxel_type.bytes()];
                    strided.read_box(time, channel, full, &mut all).unwrap();
                    for (i, found) in all.chunks_exact(voxel_type.bytes()).enumerate() {
                        let at = [i % 4, i / 4 % 4, i / 16].map(|i| i as u32);
                        let centre = DVec3::from_array(at.map(|i| f64::from(i) + 0.5));
                        let there = whole.info().geometry.voxel_from_world(info.geometry.world_from_voxel(centre));
                        // A voxel's centre, not a place between two.
                        let place = there - 0.5;
                        assert!((place - place.round()).length() < 1e-12, "{there}");
                        let place = place.round().to_array().map(|at| at as u32);
                        assert_eq!(found, voxel(&*whole, time, channel, place), "{at:?}");
                        assert_eq!(found, voxel(&strided, time, channel, at), "{at:?} alone");
                    }
                }
            }
        }
    }

    #[test]
    fn small_volumes_are_whole_and_boxes_are_kept_to_half_a_voxel() {
        let field = Field { sizes: [9, 12, 7, 1, 1], voxel_type: VoxelType::U8 };
        let (_folder, path) = temp_file("a.raw", &field.bytes("zyx", false));
        let options = OpenOptions {
            shape: Some(Extent::new(9, 12, 7)),
            voxel_type: Some(VoxelType::U8.into()),
            spacing: Some(DVec3::new(2.0, 1.0, 1.0)),
            ..OpenOptions::default()
        };
        let whole: Arc<dyn Source> = Arc::from(open(&[path], &options).unwrap());
        let same = Strided::new(whole.clone(), 12).unwrap();
        assert_eq!((same.stride(), &same.info().geometry), ([1; 3], &whole.info().geometry));
        let (low, high) = whole.info().geometry.world_box(whole.info().extent);
        // Thirds of 9 and 12 come out even.
        let thirds = Strided::new(whole.clone(), 4).unwrap();
        assert_eq!(thirds.stride(), [3, 3, 2]);
        let (third_low, third_high) = thirds.info().geometry.world_box(thirds.info().extent);
        assert_eq!((third_low.truncate(), third_high.truncate()), (low.truncate(), high.truncate()));
        assert_eq!(third_low.z, low.z - 0.5);
    }

    #[test]
    fn an_oriented_volume_stays_in_its_place() {
        let rows = [[0.0, -0.5, 0.1, 20.0], [0.4, 0.0, 0.0, -7.0], [0.0, 0.0, 2.0, 3.0]];
        let orientation = Orientation::new(rows).unwrap();
        let strided = orientation.strided(DVec3::new(3.0, 2.0, 5.0), DVec3::new(1.0, 0.0, 2.0)).unwrap();
        for index in [[0.0; 3], [1.0, 0.0, 0.0], [4.0, 2.0, 3.0]].map(DVec3::from_array) {
            let at = |orientation: &Orientation, index: DVec3| {
                (0..3).fold(orientation.first_centre(), |sum, axis| sum + orientation.step(axis) * index[axis])
            };
            let place = index * DVec3::new(3.0, 2.0, 5.0) + DVec3::new(1.0, 0.0, 2.0);
            assert!((at(&strided, index) - at(&orientation, place)).length() < 1e-12);
        }
    }
}
