//! Pieces of one grid as one source. A box costs its own bytes, once more where it meets several pieces.

use super::grid::Part;
use crate::boxes::{inside, without};
use crate::error::ImportError;
use crate::raw::RawSource;
use crate::source::{Lent, Source, SourceInfo, Take};
use crate::step_time::StepTime;
use brickyard_volume::{Extent, VoxelBox};

/// Most boxes left uncovered while pieces are counted.
const MOST_BOXES: usize = 4096;

/// A file's array, in one piece or several, which may overlap.
pub(super) struct Pieces {
    pub(super) info: SourceInfo,
    pub(super) pieces: Vec<(VoxelBox, RawSource)>,
    pub(super) step_time: StepTime,
}

/// The box of a part in the whole.
pub(super) fn box_of(part: Part) -> VoxelBox {
    let [first, extent] = [part.first, part.extent.to_array()];
    VoxelBox::new(first, std::array::from_fn(|axis| first[axis].saturating_add(extent[axis])))
}

/// Whether boxes cover a grid of this extent; also not, if they are too many or too scattered to be sure.
pub(super) fn cover(extent: Extent, boxes: impl Iterator<Item = VoxelBox>) -> bool {
    let mut left = vec![extent.full_box()];
    for piece in boxes {
        left = left.into_iter().flat_map(|whole| without(whole, piece)).collect();
        if left.len() > MOST_BOXES {
            return false;
        }
    }
    left.is_empty()
}

impl Pieces {
    /// The piece that holds a whole box.
    fn holder(&self, region: VoxelBox) -> Option<&(VoxelBox, RawSource)> {
        self.pieces.iter().find(|(piece, _)| piece.intersect(region) == region)
    }
}

impl Source for Pieces {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn scratch_bytes(&self) -> u64 {
        self.pieces.iter().map(|(_, source)| source.scratch_bytes()).sum()
    }

    fn step_time(&self) -> StepTime {
        self.step_time.clone()
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        if let Some((piece, source)) = self.holder(region) {
            return source.read_box(time, channel, inside(*piece, region), out);
        }
        let voxel_bytes = self.info.voxel_type.bytes();
        let mut part = Vec::new();
        for (piece, source) in &self.pieces {
            let shared = piece.intersect(region);
            if shared.is_empty() {
                continue;
            }
            part.resize(shared.extent().volume() as usize * voxel_bytes, 0);
            source.read_box(time, channel, inside(*piece, shared), &mut part)?;
            paste(&part, shared, out, region, voxel_bytes);
        }
        Ok(())
    }

    fn lend(&self, time: u32, channel: u32, region: VoxelBox, take: Take<'_>) -> Result<bool, ImportError> {
        match self.holder(region) {
            Some((piece, source)) => {
                source.lend(time, channel, inside(*piece, region), &mut |lent: Lent<'_>| take(lent))
            }
            None => Ok(false),
        }
    }

    fn announce(&self, time: u32, channel: u32, region: VoxelBox) {
        for (piece, source) in &self.pieces {
            let shared = piece.intersect(region);
            if !shared.is_empty() {
                source.announce(time, channel, inside(*piece, shared));
            }
        }
    }
}

/// Copies a part's rows to their places in a region.
fn paste(part: &[u8], shared: VoxelBox, out: &mut [u8], region: VoxelBox, voxel_bytes: usize) {
    let size = shared.extent();
    let row_bytes = size.x as usize * voxel_bytes;
    let whole = region.extent();
    let at = inside(region, shared).min;
    for (row, bytes) in part.chunks_exact(row_bytes).enumerate() {
        let [y, z] = [row % size.y as usize + at.y as usize, row / size.y as usize + at.z as usize];
        let start = ((z * whole.y as usize + y) * whole.x as usize + at.x as usize) * voxel_bytes;
        out[start..start + row_bytes].copy_from_slice(bytes);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_between_pieces_are_seen() {
        let extent = Extent::new(4, 3, 2);
        let whole = extent.full_box();
        let [left, right] = [VoxelBox::new([0, 0, 0], [2, 3, 2]), VoxelBox::new([1, 0, 0], [4, 3, 2])];
        let cases: [(&[VoxelBox], bool); 5] = [
            (&[whole], true),
            (&[left, right], true),
            (&[right], false),
            (&[], false),
            (&[left, VoxelBox::new([2, 0, 0], [4, 3, 1]), VoxelBox::new([2, 0, 1], [4, 2, 2])], false),
        ];
        for (boxes, expected) in cases {
            assert_eq!(cover(extent, boxes.iter().copied()), expected, "{boxes:?}");
        }
    }
}
