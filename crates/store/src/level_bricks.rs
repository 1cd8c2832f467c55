//! Bricks of all levels of an in-memory volume, made by the packing kernels: a volume shown before packing has the
//! levels, statistics and windows of its store. Costs some nanoseconds a voxel.

use crate::downsample::Downsample;
use crate::metadata::ChannelStatistics;
use crate::pack::brick::Workspace;
use crate::pack::cascade::{coarse_box, no_data, ratio, shape};
use crate::stats::{ChannelTotals, Measure};
use crate::store::bricks_of;
use brickyard_volume::{BrickIndex, Extent, Level, LevelGrid, Pyramid, VoxelBox, VoxelType, with_voxel_type};

/// The decoded bricks of all levels of one volume: one channel at one time step.
pub struct LevelBricks {
    edge: u32,
    voxel_bytes: usize,
    /// Finest first.
    levels: Vec<Bricks>,
}

/// The cores of one level, in the order of their indices.
struct Bricks {
    grid: Extent,
    cores: Vec<u8>,
}

impl LevelBricks {
    /// Makes a volume's bricks and level-0 statistics. `voxels` is the whole level, little-endian, x fastest. Floats
    /// equal to `nodata` become NaN; such integers are left out of coarser levels and statistics.
    ///
    /// # Panics
    /// If `voxels` differs in number from the pyramid's level 0, or its brick edge is not a power of two from 8 to 256.
    pub fn make(
        pyramid: &Pyramid,
        voxel_type: VoxelType,
        method: Downsample,
        nodata: Option<f64>,
        voxels: &[u8],
    ) -> (Self, ChannelStatistics) {
        let voxel_bytes = voxel_type.bytes();
        assert_eq!(voxels.len() as u64, pyramid.levels()[0].extent.volume() * voxel_bytes as u64, "not level 0");
        let core_bytes = (pyramid.edge() as usize).pow(3) * voxel_bytes;
        let bricks = |level: &LevelGrid| Bricks {
            grid: level.bricks,
            cores: vec![0; level.bricks.volume() as usize * core_bytes],
        };
        let mut made =
            Self { edge: pyramid.edge(), voxel_bytes, levels: pyramid.levels().iter().map(bricks).collect() };
        made.spread(pyramid, voxels);
        let statistics = with_voxel_type!(voxel_type, T => made.reduce::<T>(pyramid, method, nodata));
        (made, statistics)
    }

    /// Bytes of a volume's bricks.
    pub fn bytes(pyramid: &Pyramid, voxel_type: VoxelType) -> u64 {
        pyramid.brick_count() * u64::from(pyramid.edge()).pow(3) * voxel_type.bytes() as u64
    }

    /// The core of a brick: `edge`^3 little-endian voxels, x fastest. The last voxels repeat past the level's end.
    ///
    /// # Panics
    /// If there is no such brick.
    pub fn core(&self, level: Level, index: BrickIndex) -> &[u8] {
        &self.levels[level.index()].cores[self.place(level, index)]
    }

    fn core_mut(&mut self, level: Level, index: BrickIndex) -> &mut [u8] {
        let place = self.place(level, index);
        &mut self.levels[level.index()].cores[place]
    }

    /// The bytes of a core among its level's.
    fn place(&self, level: Level, index: BrickIndex) -> std::ops::Range<usize> {
        let core_bytes = (self.edge as usize).pow(3) * self.voxel_bytes;
        let start = self.levels[level.index()].grid.linear(index.to_array()) as usize * core_bytes;
        start..start + core_bytes
    }

    /// Copies the voxels of level 0 into its bricks.
    fn spread(&mut self, pyramid: &Pyramid, voxels: &[u8]) {
        let extent = pyramid.levels()[0].extent;
        for index in bricks_of(extent.full_box(), self.edge) {
            let region = pyramid.brick_box(Level(0), index);
            let row_bytes = region.extent().x as usize * self.voxel_bytes;
            for (y, z) in rows(region) {
                let from = extent.linear([region.min.x, y, z]) as usize * self.voxel_bytes;
                self.write_row(Level(0), [region.min.x, y, z], &voxels[from..from + row_bytes]);
            }
        }
    }

    /// Writes a row of voxels, within one brick, starting at a place of a level.
    fn write_row(&mut self, level: Level, place: [u32; 3], row: &[u8]) {
        let edge = self.edge;
        let index = BrickIndex::from_array(place.map(|at| at / edge));
        let within = Extent::new(edge, edge, edge).linear(place.map(|at| at % edge)) as usize * self.voxel_bytes;
        self.core_mut(level, index)[within..within + row.len()].copy_from_slice(row);
    }

    /// Completes each level's bricks and derives the next level from them.
    fn reduce<T: Measure>(&mut self, pyramid: &Pyramid, method: Downsample, nodata: Option<f64>) -> ChannelStatistics {
        let (kept, blanked) = no_data::<T>(nodata);
        let mut workspace = Workspace::<T>::new(self.edge as usize, kept);
        let mut totals = ChannelTotals::new(T::TYPE);
        for (k, grid) in pyramid.levels().iter().enumerate() {
            let (level, is_finest) = (Level(k as u8), k == 0);
            for index in bricks_of(grid.extent.full_box(), self.edge) {
                let core = pyramid.brick_box(level, index);
                bytemuck::cast_slice_mut(workspace.core_mut(0)).copy_from_slice(self.core(level, index));
                if let Some(blanked) = blanked.filter(|_| is_finest) {
                    workspace.blank(0, blanked);
                }
                let summary = workspace.digest(0, shape(core), is_finest);
                self.core_mut(level, index).copy_from_slice(bytemuck::cast_slice(workspace.core(0)));
                if is_finest {
                    totals.add_range(summary.parts.whole().to_f64());
                    totals.add_tally(&summary.tally);
                }
                let Some(coarser) = pyramid.levels().get(k + 1) else { continue };
                let factor = ratio(grid, coarser);
                workspace.reduce(0, shape(core), factor, method);
                let region = coarse_box(core, factor);
                let row_voxels = region.extent().x as usize;
                for ((y, z), row) in rows(region).zip(workspace.coarse.chunks_exact(row_voxels)) {
                    self.write_row(Level(level.0 + 1), [region.min.x, y, z], bytemuck::cast_slice(row));
                }
            }
        }
        workspace.counter.drain_into(&mut totals);
        totals.finish()
    }
}

/// The rows of a box along x, as (y, z).
fn rows(region: VoxelBox) -> impl Iterator<Item = (u32, u32)> {
    (region.min.z..region.max.z).flat_map(move |z| (region.min.y..region.max.y).map(move |y| (y, z)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::metadata::Kind;
    use crate::pack::{PackOptions, pack};
    use crate::store::Store;
    use brickyard_import::{ImportError, Source, SourceInfo};
    use brickyard_volume::{BrickId, Geometry};

    /// A volume in memory.
    struct Voxels {
        info: SourceInfo,
        bytes: Vec<u8>,
    }

    impl Source for Voxels {
        fn info(&self) -> &SourceInfo {
            &self.info
        }

        fn read_box(&self, _: u32, _: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
            let bytes = self.info.voxel_type.bytes();
            let row_bytes = region.extent().x as usize * bytes;
            for ((y, z), row) in rows(region).zip(out.chunks_exact_mut(row_bytes)) {
                let from = self.info.extent.linear([region.min.x, y, z]) as usize * bytes;
                row.copy_from_slice(&self.bytes[from..from + row_bytes]);
            }
            Ok(())
        }
    }

    /// Hashed values from 0 to 127, exact in every type, some equal to `nodata`.
    fn voxels(voxel_type: VoxelType, extent: Extent, nodata: Option<f64>) -> Voxels {
        let value = |i: u64| (i.wrapping_mul(0x9e37_79b9_7f4a_7c15) >> 57) as f64;
        let bytes = with_voxel_type!(voxel_type, T => {
            (0..extent.volume()).flat_map(|i| (value(i) as T).to_le_bytes()).collect()
        });
        let info = SourceInfo {
            geometry: Geometry { spacing: glam::DVec3::new(1.0, 1.0, 1.7), ..Geometry::default() },
            calibrated: true,
            nodata,
            identity: "voxels".into(),
            ..SourceInfo::of_volume(extent, voxel_type)
        };
        Voxels { info, bytes }
    }

    #[test]
    fn levels_and_statistics_are_those_of_a_packed_store() {
        let extent = Extent::new(37, 16, 23);
        for voxel_type in VoxelType::ALL {
            for (nodata, method) in [(None, Downsample::Mean), (Some(3.0), Downsample::Mean), (None, Downsample::Mode)]
            {
                let source = voxels(voxel_type, extent, nodata);
                let kind = if method == Downsample::Mode { Kind::Labels } else { Kind::Image };
                let options = PackOptions {
                    edge: 8,
                    shard_edge: 16,
                    threads: 1,
                    downsample: method.into(),
                    kind,
                    ..PackOptions::new(voxel_type)
                };
                let folder = tempfile::tempdir().unwrap();
                let path = folder.path().join("s.zarr");
                pack(&source, &path, &options, &()).unwrap();
                let store = Store::open(&path).unwrap();
                let (bricks, statistics) =
                    LevelBricks::make(store.pyramid(), voxel_type, method, nodata, &source.bytes);
                // Sums of floats are rounded in brick order, which differs in shards.
                let mean = store.info().channels[0].mean;
                assert!((statistics.mean - mean).abs() < 1e-9, "{voxel_type}: {} and {mean}", statistics.mean);
                assert_eq!(ChannelStatistics { mean, ..statistics }, store.info().channels[0], "{voxel_type}");
                let mut core = vec![0; store.core_bytes()];
                let mut total = 0;
                for (k, grid) in store.pyramid().levels().iter().enumerate() {
                    let level = Level(k as u8);
                    for index in bricks_of(grid.extent.full_box(), 8) {
                        store.read_core(BrickId { time: 0, channel: 0, level, index }, &mut core).unwrap();
                        assert!(bricks.core(level, index) == core, "{voxel_type} {method:?} level {k} {index:?}");
                        total += core.len() as u64;
                    }
                }
                assert_eq!(LevelBricks::bytes(store.pyramid(), voxel_type), total);
            }
        }
    }
}
