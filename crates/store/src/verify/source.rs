//! The comparison of a store's level 0 with its source, bit for bit.
//!
//! Boxes of a brick are compared by all threads; of a source that decodes planes, one thread reads as many planes as fit, at most a brick's, and the
//! others compare their parts. A brick of the store is decoded once, or once for each such group of planes. The first difference in the order of
//! reading ends it.

use super::{VerifyError, VerifyProblem};
use crate::pack::cascade::no_data;
use crate::pack::pool;
use crate::stats::Measure;
use crate::store::Store;
use brickyard_import::{Access, Source};
use brickyard_volume::numbers::exact;
use brickyard_volume::{Level, VoxelBox, with_voxel_type};
use rayon::prelude::*;
use std::path::Path;
use std::sync::atomic::{AtomicU64, Ordering};

/// The program, its stacks and allocator.
const PROGRAM_BYTES: u64 = 24 << 20;

/// Compares level 0 of a store packed from `source` with it, within `memory_bytes` on top of the open store's and source's memory, on at most
/// `threads` threads. Returns the first difference, if any. Calls `progress` with the bytes compared so far and in total.
///
/// # Errors
/// If the store or the source cannot be read, or the memory is too little for one thread.
pub fn compare_within(
    path: &Path,
    source: &dyn Source,
    memory_bytes: u64,
    threads: usize,
    progress: impl Fn(u64, u64) + Sync,
) -> Result<Option<VerifyProblem>, VerifyError> {
    let store = Store::open_own(path)?;
    let info = source.info();
    let volume = (store.pyramid().levels()[0].extent, store.times(), store.channels(), store.voxel_type());
    if volume != (info.extent, info.times, info.channels, info.voxel_type) {
        let what = format!("is {} {}, but its source is {} {}", volume.0, volume.3, info.extent, info.voxel_type);
        return Ok(Some(VerifyProblem { brick: None, path: path.into(), what }));
    }
    with_voxel_type!(info.voxel_type, T => {
        let comparison = Comparison::<T>::new(&store, source, memory_bytes, threads, &progress)?;
        comparison.run()
    })
}

struct Comparison<'a, T> {
    store: &'a Store,
    source: &'a dyn Source,
    /// Value of the source's voxels without data that are NaN in the store.
    blanked: Option<T>,
    threads: usize,
    /// Planes read together; 0 for a source read in boxes.
    planes: u32,
    progress: &'a (dyn Fn(u64, u64) + Sync),
    done: AtomicU64,
}

impl<'a, T: Measure> Comparison<'a, T> {
    fn new(
        store: &'a Store,
        source: &'a dyn Source,
        memory_bytes: u64,
        threads: usize,
        progress: &'a (dyn Fn(u64, u64) + Sync),
    ) -> Result<Self, VerifyError> {
        let (info, voxel_bytes) = (source.info(), size_of::<T>() as u64);
        let core_bytes = store.core_bytes() as u64;
        // A box of each, and a brick of the store: encoded, shuffled and decoded.
        let of_thread = match source.access() {
            Access::Box => 5 * core_bytes + source.reader_bytes(),
            Access::Planes => 4 * core_bytes,
        };
        let plane_bytes = u64::from(info.extent.x) * u64::from(info.extent.y) * voxel_bytes;
        let of_planes = |planes: u64| match source.access() {
            Access::Box => 0,
            Access::Planes => planes.saturating_mul(plane_bytes).saturating_add(source.reader_bytes()),
        };
        let fixed = PROGRAM_BYTES + store.cache_bytes();
        let least = fixed.saturating_add(of_planes(1)).saturating_add(of_thread);
        if least > memory_bytes {
            return Err(VerifyError::Memory { needed_bytes: least, given_bytes: memory_bytes });
        }
        let room = memory_bytes - fixed;
        let threads = ((room - of_planes(1)) / of_thread).min(threads.max(1) as u64);
        let left = room - threads * of_thread;
        let edge = u64::from(store.pyramid().edge());
        let planes = (1..=edge).rev().find(|planes| of_planes(*planes) <= left).unwrap_or(1) as u32;
        let planes = if source.access() == Access::Planes { planes } else { 0 };
        let (_, blanked) = no_data(info.sought_nodata());
        let (threads, done) = (threads as usize, AtomicU64::new(0));
        Ok(Self { store, source, blanked, threads, planes, progress, done })
    }

    fn run(&self) -> Result<Option<VerifyProblem>, VerifyError> {
        let pool = pool(self.threads).map_err(VerifyError::Threads)?;
        let info = self.source.info();
        for (time, channel) in (0..info.times).flat_map(|t| (0..info.channels).map(move |c| (t, c))) {
            let found = pool.install(|| match self.planes {
                0 => self.compare_boxes(time, channel),
                planes => self.compare_planes(time, channel, planes),
            })?;
            if found.is_some() {
                return Ok(found);
            }
        }
        Ok(None)
    }

    /// The boxes of bricks within a region, x fastest.
    fn boxes(&self, region: VoxelBox) -> Vec<VoxelBox> {
        let edge = self.store.pyramid().edge();
        let along = |low: u32, high: u32| {
            (low / edge..high.div_ceil(edge)).map(move |i| (low.max(i * edge), high.min((i + 1).saturating_mul(edge))))
        };
        let VoxelBox { min, max } = region;
        let mut boxes = Vec::new();
        for z in along(min.z, max.z) {
            for y in along(min.y, max.y) {
                boxes.extend(along(min.x, max.x).map(|x| VoxelBox::new([x.0, y.0, z.0], [x.1, y.1, z.1])));
            }
        }
        boxes
    }

    fn compare_boxes(&self, time: u32, channel: u32) -> Result<Option<VerifyProblem>, VerifyError> {
        let (extent, edge) = (self.source.info().extent, self.store.pyramid().edge());
        for z in (0..extent.z).step_by(edge as usize) {
            let layer = VoxelBox::new([0, 0, z], [extent.x, extent.y, z.saturating_add(edge).min(extent.z)]);
            let found: Result<Vec<_>, VerifyError> = self
                .boxes(layer)
                .into_par_iter()
                .map_init(Vec::new, |voxels, region| {
                    voxels.resize(region.extent().volume() as usize, T::default());
                    self.source.read_box(time, channel, region, bytemuck::cast_slice_mut(voxels))?;
                    self.compare(time, channel, region, voxels)
                })
                .collect();
            if let Some(problem) = found?.into_iter().flatten().next() {
                return Ok(Some(problem));
            }
        }
        Ok(None)
    }

    fn compare_planes(&self, time: u32, channel: u32, planes: u32) -> Result<Option<VerifyProblem>, VerifyError> {
        let (extent, edge) = (self.source.info().extent, self.store.pyramid().edge());
        let row = extent.x as usize;
        let plane = row * extent.y as usize;
        let (mut voxels, mut z) = (Vec::<T>::new(), 0);
        while z < extent.z {
            // Groups of planes end where bricks do.
            let end = z.saturating_add(planes).min((z / edge + 1).saturating_mul(edge)).min(extent.z);
            voxels.resize(plane * (end - z) as usize, T::default());
            for (z, voxels) in (z..end).zip(voxels.chunks_exact_mut(plane)) {
                let region = VoxelBox::new([0, 0, z], [extent.x, extent.y, z + 1]);
                self.source.read_box(time, channel, region, bytemuck::cast_slice_mut(voxels))?;
            }
            let group = VoxelBox::new([0, 0, z], [extent.x, extent.y, end]);
            let found: Result<Vec<_>, VerifyError> = self
                .boxes(group)
                .into_par_iter()
                .map_init(Vec::new, |part, region| {
                    part.clear();
                    for (z, y) in (region.min.z - z..region.max.z - z)
                        .flat_map(|z| (region.min.y..region.max.y).map(move |y| (z as usize, y as usize)))
                    {
                        let from = z * plane + y * row;
                        part.extend_from_slice(&voxels[from + region.min.x as usize..from + region.max.x as usize]);
                    }
                    self.compare(time, channel, region, part)
                })
                .collect();
            if let Some(problem) = found?.into_iter().flatten().next() {
                return Ok(Some(problem));
            }
            z = end;
        }
        Ok(None)
    }

    /// Compares a box of the store with the source's voxels.
    fn compare(
        &self,
        time: u32,
        channel: u32,
        region: VoxelBox,
        voxels: &[T],
    ) -> Result<Option<VerifyProblem>, VerifyError> {
        let mut stored = vec![T::default(); voxels.len()];
        self.store.read_box(time, channel, Level(0), region, bytemuck::cast_slice_mut(&mut stored))?;
        let bytes = size_of_val(voxels) as u64;
        let info = self.source.info();
        let total = u64::from(info.times) * u64::from(info.channels) * info.extent.volume() * size_of::<T>() as u64;
        (self.progress)(self.done.fetch_add(bytes, Ordering::Relaxed) + bytes, total);
        let invalid = T::from_f64_rounded(f64::NAN);
        let differs = |(found, packed): (&T, &T)| {
            let expected = if self.blanked == Some(*packed) { &invalid } else { packed };
            bytemuck::bytes_of(found) != bytemuck::bytes_of(expected)
        };
        let Some(i) = stored.iter().zip(voxels).position(differs) else { return Ok(None) };
        let [width, height] = [region.extent().x, region.extent().y].map(|n| n as usize);
        let place = [i % width, i / width % height, i / (width * height)];
        let [x, y, z]: [u32; 3] = std::array::from_fn(|axis| region.min.to_array()[axis] + place[axis] as u32);
        let in_words = |value: T| exact(value.to_f64(), T::TYPE.is_float());
        let what = format!(
            "differs from its source, first at voxel {x},{y},{z}, channel {channel}, time step {time}: {} here, {} there",
            in_words(stored[i]),
            in_words(voxels[i])
        );
        Ok(Some(VerifyProblem { brick: None, path: self.store.path().into(), what }))
    }
}
