//! An export under way: the voxels' source and the blocks in which it stores them, and the progress.

use crate::error::ExportError;
use brickyard_import::Source;
use brickyard_volume::VoxelBox;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// Receives the bytes of voxels done and in all; may cancel.
pub(crate) type Progress<'a> = dyn Fn(u64, u64) -> ControlFlow<()> + Sync + 'a;

/// Cubes in which voxels are stored: each is best read once.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Blocks {
    /// Voxels along a cube's edge.
    pub(crate) edge: u32,
    /// Place of the source's first voxel, counted from the corner of a cube.
    pub(crate) first: [u32; 3],
}

/// Voxels `[from, to)` along an axis.
pub(crate) type Span = (u32, u32);

impl Blocks {
    /// A part of an axis of the source, cut at borders of cubes: of every one, or of every n-th where `size` is n edges.
    pub(crate) fn cuts(self, axis: usize, (from, to): Span, size: u32) -> impl Iterator<Item = Span> + Clone {
        let first = self.first[axis];
        let (from, to) = (u64::from(first) + u64::from(from), u64::from(first) + u64::from(to));
        let size = u64::from(size);
        let inside = move |place: u64| (place.clamp(from, to) - u64::from(first)) as u32;
        (from / size..to.div_ceil(size)).map(move |i| (inside(i * size), inside((i + 1) * size)))
    }

    /// Bars of blocks in a box of the source, `width` voxels along x at most, x fastest.
    pub(crate) fn bars(self, region: VoxelBox, width: u32) -> impl Iterator<Item = VoxelBox> {
        let (low, high) = (region.min.to_array(), region.max.to_array());
        let cuts = move |axis: usize, size| self.cuts(axis, (low[axis], high[axis]), size);
        let rows = cuts(2, self.edge).flat_map(move |z| cuts(1, self.edge).map(move |y| (y, z)));
        rows.flat_map(move |(y, z)| cuts(0, width).map(move |x| VoxelBox::new([x.0, y.0, z.0], [x.1, y.1, z.1])))
    }
}

/// An export under way.
pub(crate) struct Job<'a> {
    pub(crate) source: &'a dyn Source,
    pub(crate) blocks: Blocks,
    pub(crate) memory_bytes: u64,
    /// For messages.
    pub(crate) output: &'a Path,
    total_bytes: u64,
    done_bytes: AtomicU64,
    progress: &'a Progress<'a>,
}

impl<'a> Job<'a> {
    /// Counts the bytes of all voxels.
    ///
    /// # Errors
    /// If they are more than a file can have.
    pub(crate) fn new(
        source: &'a dyn Source,
        blocks: Blocks,
        memory_bytes: u64,
        output: &'a Path,
        progress: &'a Progress<'a>,
    ) -> Result<Self, ExportError> {
        let info = source.info();
        let volumes = u128::from(info.channels) * u128::from(info.times);
        let bytes = u128::from(info.extent.volume()) * info.voxel_type.bytes() as u128;
        // Half of what a file's offset can be: headers, and gaps for other arrays, come on top.
        let total_bytes = volumes.checked_mul(bytes).filter(|bytes| *bytes < 1 << 62);
        let total_bytes = total_bytes.ok_or_else(|| {
            ExportError::unfit(output, "the voxels are more than a file can hold; export a box, or a coarser `level`")
        })? as u64;
        Ok(Self { source, blocks, memory_bytes, output, total_bytes, done_bytes: AtomicU64::new(0), progress })
    }

    /// Counts written voxels.
    ///
    /// # Errors
    /// If the export is cancelled.
    pub(crate) fn advance(&self, bytes: u64) -> Result<(), ExportError> {
        self.told(self.done_bytes.fetch_add(bytes, Ordering::Relaxed) + bytes)
    }

    /// Counts voxels as done up to this many bytes.
    ///
    /// # Errors
    /// If the export is cancelled.
    pub(crate) fn reach(&self, bytes: u64) -> Result<(), ExportError> {
        self.told(self.done_bytes.fetch_max(bytes, Ordering::Relaxed).max(bytes))
    }

    /// Bytes of all voxels.
    pub(crate) fn total_bytes(&self) -> u64 {
        self.total_bytes
    }

    fn told(&self, done_bytes: u64) -> Result<(), ExportError> {
        match (self.progress)(done_bytes, self.total_bytes) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(ExportError::Cancelled { path: self.output.into() }),
        }
    }

    /// Bytes of a box's voxels.
    pub(crate) fn bytes_of(&self, region: VoxelBox) -> usize {
        region.extent().volume() as usize * self.source.info().voxel_type.bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_is_cut_at_the_blocks_of_what_it_was_cut_from() {
        let blocks = Blocks { edge: 8, first: [5, 0, u32::MAX - 10] };
        let cuts = |axis, span, size| blocks.cuts(axis, span, size).collect::<Vec<_>>();
        assert_eq!(cuts(0, (0, 20), 8), [(0, 3), (3, 11), (11, 19), (19, 20)]);
        assert_eq!(cuts(0, (4, 11), 8), [(4, 11)]);
        assert_eq!(cuts(0, (0, 20), 16), [(0, 11), (11, 20)]);
        assert_eq!(cuts(1, (0, 16), 8), [(0, 8), (8, 16)]);
        assert_eq!(cuts(2, (0, 10), 8), [(0, 3), (3, 10)]);
        let bars: Vec<VoxelBox> = blocks.bars(VoxelBox::new([0; 3], [4, 9, 3]), 8).collect();
        let corners = [([0, 0, 0], [3, 8, 3]), ([3, 0, 0], [4, 8, 3]), ([0, 8, 0], [3, 9, 3]), ([3, 8, 0], [4, 9, 3])];
        assert_eq!(bars, corners.map(|(low, high)| VoxelBox::new(low, high)));
    }
}
