//! A box of a source. Voxels, and their places in the world, are the other source's; a box costs what it costs there, and is lent
//! where the other source lends.

use crate::error::{ImportError, Result};
use crate::source::{Source, SourceInfo, Take};
use brickyard_volume::{PlacementError, VoxelBox};
use glam::DVec3;

/// A source of the voxels in a box of another one.
pub(crate) struct Cropped {
    source: Box<dyn Source>,
    info: SourceInfo,
    /// The first voxel, in the other source.
    first: [u32; 3],
}

impl Cropped {
    /// Takes a box, which lies in the source.
    ///
    /// # Errors
    /// If the source's orientation cannot be used so far from its first voxel.
    pub(crate) fn new(source: Box<dyn Source>, region: VoxelBox) -> Result<Self, PlacementError> {
        let mut info = source.info().clone();
        let (low, high) = (region.min.to_array(), region.max.to_array());
        info.extent = region.extent();
        info.reorient(DVec3::ONE, DVec3::from_array(low.map(f64::from)))?;
        info.identity = format!("{}, voxels {low:?} to {high:?}", info.identity);
        Ok(Self { source, info, first: low })
    }

    fn in_other(&self, region: VoxelBox) -> VoxelBox {
        let moved = |corner: [u32; 3]| std::array::from_fn(|axis| corner[axis] + self.first[axis]);
        VoxelBox::new(moved(region.min.to_array()), moved(region.max.to_array()))
    }
}

impl Source for Cropped {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn beneath(&self) -> Option<&dyn Source> {
        Some(&*self.source)
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        self.source.read_box(time, channel, self.in_other(region), out)
    }

    fn lend(&self, time: u32, channel: u32, region: VoxelBox, take: Take<'_>) -> Result<bool, ImportError> {
        self.source.lend(time, channel, self.in_other(region), take)
    }

    fn announce(&self, time: u32, channel: u32, region: VoxelBox) {
        self.source.announce(time, channel, self.in_other(region));
    }

    fn constant_in(&self, time: u32, channel: u32, region: VoxelBox) -> Option<f64> {
        self.source.constant_in(time, channel, self.in_other(region))
    }
}
