//! Sources with replaced descriptions.

use crate::error::ImportError;
use crate::source::{Access, Source, SourceInfo, Take};
use crate::step_time::StepTime;
use brickyard_volume::VoxelBox;
use std::ops::Deref;

/// A source under another description, possibly with renumbered time steps. Voxels are unchanged.
pub struct Described<S> {
    /// The new description.
    pub info: SourceInfo,
    /// The source itself: boxed, or borrowed.
    pub source: S,
    /// The new number of the source's first time step.
    pub first: u32,
}

impl<S: Deref<Target: Source> + Send + Sync> Source for Described<S> {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn access(&self) -> Access {
        self.source.access()
    }

    fn step_time(&self) -> StepTime {
        self.source.step_time()
    }

    fn reader_bytes(&self) -> u64 {
        self.source.reader_bytes()
    }

    fn held_bytes(&self) -> u64 {
        self.source.held_bytes()
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.source.read_box(time - self.first, channel, region, out)
    }

    fn scratch_bytes(&self) -> u64 {
        self.source.scratch_bytes()
    }

    fn lend(&self, time: u32, channel: u32, region: VoxelBox, take: Take<'_>) -> Result<bool, ImportError> {
        self.source.lend(time - self.first, channel, region, take)
    }

    fn announce(&self, time: u32, channel: u32, region: VoxelBox) {
        self.source.announce(time - self.first, channel, region);
    }

    fn constant_in(&self, time: u32, channel: u32, region: VoxelBox) -> Option<f64> {
        self.source.constant_in(time - self.first, channel, region)
    }
}
