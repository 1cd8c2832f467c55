//! The slices of one layer of a level's bricks, in memory or, if memory is short, in a mapped scratch file, and so in
//! reclaimable page cache.

use brickyard_import::Lent;
use brickyard_import::temporary::unnamed_in;
use brickyard_volume::{Extent, VoxelBox};
use memmap2::MmapMut;
use rustix::fs::{FallocateFlags, fallocate};
use std::fs::File;
use std::io::{self, Write};
use std::path::Path;

pub(crate) struct Window {
    bytes: MmapMut,
    voxel_bytes: usize,
    /// Extent of the level; its layers pass through the window one after another.
    extent: Extent,
    /// Slices of a layer.
    edge: u32,
    /// Number of the level's slices written so far, from the first.
    pub(crate) filled: u32,
}

impl Window {
    /// Creates a window of layers of up to `edge` slices in memory, or in an unnamed file in the directory `scratch`, if given.
    ///
    /// # Errors
    /// If the disk has no room for the scratch file, or the system refuses the memory.
    pub(crate) fn new(extent: Extent, voxel_bytes: usize, edge: u32, scratch: Option<&Path>) -> io::Result<Self> {
        let slices = edge.min(extent.z) as usize;
        let bytes = slices * extent.x as usize * extent.y as usize * voxel_bytes;
        let bytes = match scratch {
            None => MmapMut::map_anon(bytes)?,
            Some(dir) => {
                let mut file = unnamed_in(dir)?;
                reserve(&mut file, bytes as u64)?;
                // SAFETY: the file has no name, so no one else can truncate or write it; its blocks are allocated, so
                // no write through the map can run out of disk.
                unsafe { MmapMut::map_mut(&file)? }
            }
        };
        Ok(Self { bytes, voxel_bytes, extent, edge, filled: 0 })
    }

    fn row(&self, x: u32, y: u32, z: u32) -> usize {
        let slice = (z % self.edge) as usize;
        ((slice * self.extent.y as usize + y as usize) * self.extent.x as usize + x as usize) * self.voxel_bytes
    }

    /// The voxels of a box, in place. Its slices are of the layer written last.
    pub(crate) fn lend(&self, region: VoxelBox) -> Lent<'_> {
        let slice_bytes = self.extent.x as usize * self.extent.y as usize * self.voxel_bytes;
        let start = self.row(region.min.x, region.min.y, region.min.z);
        let row_bytes = self.extent.x as usize * self.voxel_bytes;
        Lent { slices: 0..region.extent().z as usize, bytes: &self.bytes[start..], row_bytes, slice_bytes }
    }

    /// The voxels of a slice, to be written.
    pub(crate) fn slice_mut(&mut self, z: u32) -> &mut [u8] {
        let start = self.row(0, 0, z);
        let end = start + self.extent.x as usize * self.extent.y as usize * self.voxel_bytes;
        &mut self.bytes[start..end]
    }

    /// Copies a box of packed voxels into the window.
    pub(crate) fn write_box(&mut self, region: VoxelBox, voxels: &[u8]) {
        let row_bytes = region.extent().x as usize * self.voxel_bytes;
        let mut rows = voxels.chunks_exact(row_bytes);
        for z in region.min.z..region.max.z {
            for y in region.min.y..region.max.y {
                let start = self.row(region.min.x, y, z);
                if let Some(row) = rows.next() {
                    self.bytes[start..start + row_bytes].copy_from_slice(row);
                }
            }
        }
    }
}

/// Allocates the file's blocks now: on a full disk, a map over holes would end in SIGBUS.
fn reserve(file: &mut File, bytes: u64) -> io::Result<()> {
    match fallocate(&*file, FallocateFlags::empty(), 0, bytes) {
        Err(rustix::io::Errno::OPNOTSUPP) => {
            let zeros = vec![0; 1 << 20];
            let mut left = bytes;
            while left > 0 {
                let n = left.min(zeros.len() as u64);
                file.write_all(&zeros[..n as usize])?;
                left -= n;
            }
            Ok(())
        }
        other => Ok(other?),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn windows_keep_a_layer_wherever_they_live() {
        let dir = tempfile::tempdir().unwrap();
        for scratch in [None, Some(dir.path())] {
            let mut window = Window::new(Extent::new(4, 3, 9), 2, 3, scratch).unwrap();
            for z in 0..9u32 {
                let slice: Vec<u8> = (0..24).map(|i| i + z as u8 * 24).collect();
                window.write_box(VoxelBox::new([0, 0, z], [4, 3, z + 1]), &slice);
                let first = z / 3 * 3;
                let lent = window.lend(VoxelBox::new([1, 2, first], [3, 3, z + 1]));
                for slice in first..=z {
                    let found = &lent.bytes[(slice - first) as usize * lent.slice_bytes..][..4];
                    let expected: Vec<u8> = (18..22).map(|i| i + slice as u8 * 24).collect();
                    assert_eq!(found, expected);
                }
            }
        }
        // Scratch files have no name.
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
    }
}
