//! A source with its voxels in reverse order along some axes.
//!
//! A volume without an orientation is mirrored: spacing and origin stay, and the object turns into its mirror image in the same place.
//! A volume with an orientation is only stored in another order: its matrix is changed with it, so that every voxel keeps its place in
//! the patient, and left stays left. ITK's `FlipImageFilter` does the same. A box is read as in the other source, once, and turned in place.

use crate::error::{ImportError, Result};
use crate::source::{Source, SourceInfo, Take};
use brickyard_volume::{PlacementError, VoxelBox};
use glam::DVec3;

/// A source of another one's voxels, in reverse order along some axes.
pub(crate) struct Mirrored {
    source: Box<dyn Source>,
    info: SourceInfo,
    /// Whether x, y, z are reversed.
    flip: [bool; 3],
}

impl Mirrored {
    /// Reverses these axes.
    ///
    /// # Errors
    /// If the source's orientation cannot be used from its other end.
    pub(crate) fn new(source: Box<dyn Source>, flip: [bool; 3]) -> Result<Self, PlacementError> {
        let mut info = source.info().clone();
        if info.orientation.is_some() {
            let last = info.extent.to_array().map(|n| f64::from(n) - 1.0);
            let sign = flip.map(|flip| if flip { -1.0 } else { 1.0 });
            let first = std::array::from_fn(|axis| if flip[axis] { last[axis] } else { 0.0 });
            info.reorient(DVec3::from_array(sign), DVec3::from_array(first))?;
        }
        info.identity = format!("{}, flip {flip:?}", info.identity);
        info.flip = Some(flip);
        Ok(Self { source, info, flip })
    }

    /// Reverses these axes of a source whose description is that of the result already.
    pub(crate) fn turned(source: Box<dyn Source>, flip: [bool; 3]) -> Box<dyn Source> {
        if flip == [false; 3] { source } else { Box::new(Self { info: source.info().clone(), source, flip }) }
    }

    fn in_other(&self, region: VoxelBox) -> VoxelBox {
        let (size, low, high) = (self.info.extent.to_array(), region.min.to_array(), region.max.to_array());
        let ends = |axis: usize, end: u32, other: u32| if self.flip[axis] { size[axis] - other } else { end };
        VoxelBox::new(
            std::array::from_fn(|axis| ends(axis, low[axis], high[axis])),
            std::array::from_fn(|axis| ends(axis, high[axis], low[axis])),
        )
    }
}

impl Source for Mirrored {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn beneath(&self) -> Option<&dyn Source> {
        Some(&*self.source)
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        self.source.read_box(time, channel, self.in_other(region), out)?;
        let (extent, bytes) = (region.extent(), self.info.voxel_type.bytes());
        let row_bytes = extent.x as usize * bytes;
        let [x, y, z] = self.flip;
        if x {
            out.chunks_exact_mut(row_bytes).for_each(|row| match bytes {
                1 => row.reverse(),
                2 => row.as_chunks_mut::<2>().0.reverse(),
                _ => row.as_chunks_mut::<4>().0.reverse(),
            });
        }
        if y {
            out.chunks_exact_mut(row_bytes * extent.y as usize).for_each(|slice| reverse(slice, row_bytes));
        }
        if z {
            reverse(out, row_bytes * extent.y as usize);
        }
        Ok(())
    }

    fn lend(&self, time: u32, channel: u32, region: VoxelBox, take: Take<'_>) -> Result<bool, ImportError> {
        // A box of one voxel along the reversed axes lies as in the source.
        let extent = region.extent().to_array();
        match (0..3).all(|axis| !self.flip[axis] || extent[axis] == 1) {
            true => self.source.lend(time, channel, self.in_other(region), take),
            false => Ok(false),
        }
    }

    fn announce(&self, time: u32, channel: u32, region: VoxelBox) {
        self.source.announce(time, channel, self.in_other(region));
    }

    fn constant_in(&self, time: u32, channel: u32, region: VoxelBox) -> Option<f64> {
        self.source.constant_in(time, channel, self.in_other(region))
    }
}

/// Letters of the axes that are reversed, as `flip` takes them.
pub fn axes_in_words(flip: [bool; 3]) -> String {
    let letters = ["x", "y", "z"].into_iter().zip(flip).filter(|(_, is_reversed)| *is_reversed);
    letters.map(|(letter, _)| letter).collect::<Vec<_>>().join(",")
}

/// Reverses the order of pieces of `piece_bytes` bytes.
fn reverse(bytes: &mut [u8], piece_bytes: usize) {
    let mut rest = bytes;
    while rest.len() >= 2 * piece_bytes {
        let (first, others) = rest.split_at_mut(piece_bytes);
        let (between, last) = others.split_at_mut(others.len() - piece_bytes);
        first.swap_with_slice(last);
        rest = between;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::open::open;
    use crate::options::OpenOptions;
    use crate::testing::{Field, temp_file};
    use brickyard_volume::Extent;
    use brickyard_volume::VoxelType;
    use proptest::prelude::*;

    proptest! {
        /// Each voxel of a mirrored box is the source's voxel from the other end.
        #[test]
        fn boxes_are_counted_from_the_other_end(
            along in prop::array::uniform3(any::<bool>()),
            voxel_type in prop::sample::select(&VoxelType::ALL[..]),
            ends in prop::array::uniform3((0u32..5, 1u32..5)),
        ) {
            let field = Field { sizes: [7, 6, 5, 1, 1], voxel_type };
            let (_folder, path) = temp_file("a.raw", &field.bytes("zyx", false));
            let options = OpenOptions {
                shape: Some(Extent::new(7, 6, 5)), voxel_type: Some(voxel_type.into()), ..OpenOptions::default()
            };
            let plain = open(std::slice::from_ref(&path), &options).unwrap();
            let turned = Mirrored::turned(open(&[path], &options).unwrap(), along);
            let sizes = [7, 6, 5];
            let low: [u32; 3] = std::array::from_fn(|a| ends[a].0);
            let high = std::array::from_fn(|a| (ends[a].0 + ends[a].1).min(sizes[a]));
            let region = VoxelBox::new(low, high);
            let extent = region.extent();
            let bytes = voxel_type.bytes();
            let mut found = vec![0; extent.volume() as usize * bytes];
            turned.read_box(0, 0, region, &mut found).unwrap();
            let mut at = 0;
            for z in low[2]..high[2] {
                for y in low[1]..high[1] {
                    for x in low[0]..high[0] {
                        let place = [x, y, z];
                        let from = std::array::from_fn(|a| if along[a] { sizes[a] - 1 - place[a] } else { place[a] });
                        let mut voxel = vec![0; bytes];
                        plain.read_box(0, 0, VoxelBox::new(from, from.map(|n| n + 1)), &mut voxel).unwrap();
                        prop_assert_eq!(&found[at..at + bytes], &voxel[..]);
                        at += bytes;
                    }
                }
            }
        }
    }
}
