//! Small stores, and descriptions, for tests.

use crate::ngff::Ngff;
use crate::volume::Volume;
use brickyard_import::{ImportError, Source, SourceInfo};
use brickyard_store::{Kind, PackOptions, Reductions, Store, pack};
use brickyard_volume::{Extent, Voxel, VoxelBox, VoxelType, with_voxel_type};
use std::path::Path;
use std::sync::Arc;

/// A description of one plain volume.
pub(crate) fn info() -> SourceInfo {
    let plain = SourceInfo::of_volume(Extent::new(37, 20, 19), VoxelType::U16);
    SourceInfo { identity: "a function".into(), ..plain }
}

pub(crate) fn volume(info: &SourceInfo) -> Volume<'_> {
    let (has_channel_axis, has_time_axis) = (false, false);
    Volume {
        info,
        name: None,
        is_labels: false,
        segments: &[],
        ngff: Ngff::default(),
        has_channel_axis,
        has_time_axis,
        output: Path::new("out"),
    }
}

/// The value of a voxel: another in every place, step and channel, within a byte.
pub(crate) fn value(time: u32, channel: u32, [x, y, z]: [u32; 3]) -> f64 {
    f64::from((x + 3 * y + 7 * z + 31 * time + 61 * channel) % 120)
}

/// Bytes of a value.
pub(crate) fn bytes_of(voxel_type: VoxelType, value: f64) -> Vec<u8> {
    with_voxel_type!(voxel_type, T => bytemuck::bytes_of(&T::from_f64_rounded(value)).to_vec())
}

/// Voxels of a function.
pub(crate) struct Function<F> {
    pub(crate) info: SourceInfo,
    pub(crate) value: F,
}

impl<F: Fn(u32, u32, [u32; 3]) -> f64 + Send + Sync> Source for Function<F> {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        let voxels = out.chunks_exact_mut(self.info.voxel_type.bytes());
        for (voxel, at) in voxels.zip(region.voxels()) {
            voxel.copy_from_slice(&bytes_of(self.info.voxel_type, (self.value)(time, channel, at)));
        }
        Ok(())
    }
}

/// A store of bricks of 8 voxels along an edge.
pub(crate) struct TestStore {
    pub(crate) folder: tempfile::TempDir,
    pub(crate) store: Arc<Store>,
}

impl TestStore {
    /// Packs voxels of [`value`] under a description.
    pub(crate) fn of(info: SourceInfo) -> Self {
        Self::of_kind(info, Kind::Image)
    }

    pub(crate) fn of_kind(info: SourceInfo, kind: Kind) -> Self {
        Self::of_source(Function { info, value }, kind)
    }

    pub(crate) fn of_source(source: impl Source, kind: Kind) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("s.zarr");
        pack_source_at(&path, &source, kind);
        Self { store: Arc::new(Store::open(&path).unwrap()), folder }
    }
}

/// Packs voxels of [`value`] into a store at a path.
pub(crate) fn pack_at(path: &Path, info: SourceInfo, kind: Kind) {
    pack_source_at(path, &Function { info, value }, kind);
}

fn pack_source_at(path: &Path, source: &dyn Source, kind: Kind) {
    let downsample = Reductions::default_for(kind);
    let plain = PackOptions::new(source.info().voxel_type);
    let options = PackOptions { edge: 8, shard_edge: 16, threads: 2, kind, downsample, ..plain };
    pack(source, path, &options, &()).unwrap();
}
