//! Shards made again: cores from a source or from the next finer level, aprons from cores.

use super::from_source::Bricks;
use super::survey::{Hashes, of_store};
use crate::chunks::Chunks;
use crate::codec::BrickCodec;
use crate::error::ReadError;
use crate::layout::{Layout, ShardId};
use crate::pack::brick::Workspace;
use crate::pack::cascade::{coarse_box, ratio, shape};
use crate::pack::disk::{Disk, DiskError, temporary};
use crate::pack::ours;
use crate::pack::shards::{Encoded, Finished, ShardWriter};
use crate::scratch::Scratch;
use crate::side::core_hash;
use crate::stats::Measure;
use crate::store::{Store, bricks_of, grown};
use brickyard_import::ImportError;
use brickyard_volume::{BrickId, Extent, Level, VoxelBox};

/// Why a shard was not made again.
pub(super) enum Fault {
    /// A brick of the source is not the store's.
    Unlike(BrickId),
    /// The voxels below, or around, cannot be read, or are not those of the brick.
    Lost(String),
    Source(ImportError),
    Barred(ReadError),
    Disk(DiskError),
}

impl From<DiskError> for Fault {
    fn from(error: DiskError) -> Self {
        Self::Disk(error)
    }
}

impl From<ReadError> for Fault {
    fn from(error: ReadError) -> Self {
        Self::Barred(error)
    }
}

/// A thread's buffers for making bricks.
pub(super) struct Maker<T> {
    pub(super) workspace: Workspace<T>,
    scratch: Scratch,
    /// A core under way, or the bytes of an apron.
    brick: Vec<T>,
}

/// The origin of a shard's voxels.
pub(super) enum Voxels<'a, 'b, T> {
    OfSource(&'a mut Bricks<'b, T>),
    OfFinerLevel,
}

impl<T: Measure> Maker<T> {
    pub(super) fn new(store: &Store) -> Self {
        let nodata = store.info().nodata.map(|nodata| T::from_f64_rounded(nodata as f64));
        let workspace = Workspace::new(store.pyramid().edge() as usize, nodata);
        Self { workspace, scratch: Scratch::default(), brick: Vec::new() }
    }

    /// Writes a shard of cores under its temporary name, not synced. Bricks must have their recorded hashes, where
    /// these are readable.
    pub(super) fn cores(
        &mut self,
        disk: &Disk,
        store: &Store,
        id: ShardId,
        mut from: Voxels<'_, '_, T>,
    ) -> Result<Finished, Fault> {
        let (layout, codec) = (store.layout(), *store.cores().codec());
        let mut hashes = Hashes::default();
        write(disk, store, layout, id, |brick, out| {
            match &mut from {
                Voxels::OfSource(bricks) => {
                    let core = store.pyramid().brick_box(brick.level, brick.index);
                    let around = voxels_of(store, layout, id);
                    bricks.read(&mut self.workspace, brick, core, around).map_err(Fault::Source)?;
                }
                Voxels::OfFinerLevel => self.reduce(store, brick)?,
            }
            let core = store.pyramid().brick_box(brick.level, brick.index);
            let summary = self.workspace.digest(0, shape(core), false);
            let bytes = bytemuck::cast_slice(self.workspace.core(0));
            let hash = core_hash(bytes);
            if hashes.of(store, brick)?.is_some_and(|recorded| recorded != hash) {
                return Err(match from {
                    Voxels::OfSource(_) => Fault::Unlike(brick),
                    Voxels::OfFinerLevel => {
                        Fault::Lost(format!("{brick}: its record is not of the finer level's voxels"))
                    }
                });
            }
            if summary.is_fill {
                return Ok(None);
            }
            codec.encode(&mut self.scratch, bytes, out);
            Ok(Some(hash))
        })
    }

    /// Makes a core of a coarse level in core 0.
    fn reduce(&mut self, store: &Store, id: BrickId) -> Result<(), Fault> {
        let (pyramid, finer) = (store.pyramid(), Level(id.level.0 - 1));
        let edge = pyramid.edge() as usize;
        let factor = ratio(pyramid.level(finer), pyramid.level(id.level));
        let corner = pyramid.brick_box(id.level, id.index).min.to_array();
        let whole = Extent::new(edge as u32, edge as u32, edge as u32);
        self.brick.clear();
        self.brick.resize(edge.pow(3), T::default());
        for index in pyramid.children(id.level, id.index) {
            let child = BrickId { level: finer, index, ..id };
            let read = store.read_core(child, bytemuck::cast_slice_mut(self.workspace.core_mut(0)));
            if of_store(read)?.is_none() {
                return Err(Fault::Lost(format!("{id}: {child} below it cannot be read")));
            }
            let core = pyramid.brick_box(finer, index);
            // Voxels past the extent are padded anew.
            self.workspace.digest(0, shape(core), false);
            self.workspace.reduce(0, shape(core), factor, store.downsample());
            let part = coarse_box(core, factor);
            let width = part.extent().x as usize;
            for (row, from) in rows(part).zip(self.workspace.coarse.chunks_exact(width)) {
                let at = whole.linear(std::array::from_fn(|a| row[a] - corner[a])) as usize;
                self.brick[at..at + width].copy_from_slice(from);
            }
        }
        self.workspace.core_mut(0).copy_from_slice(&self.brick);
        Ok(())
    }

    /// Writes a shard of aprons under its temporary name, not synced.
    pub(super) fn aprons(
        &mut self,
        disk: &Disk,
        store: &Store,
        chunks: &Chunks,
        id: ShardId,
    ) -> Result<Finished, Fault> {
        let Some(apron) = store.apron() else { return Err(Fault::Lost("the store has no aprons".into())) };
        let codec: BrickCodec = *chunks.codec();
        write(disk, store, chunks.layout(), id, |brick, out| {
            let (pyramid, level) = (store.pyramid(), store.pyramid().level(brick.level).extent);
            let core = pyramid.brick_box(brick.level, brick.index);
            let region = grown(core, apron.width, level.full_box());
            let mut voxels = vec![T::default(); region.extent().volume() as usize];
            let read =
                store.read_box(brick.time, brick.channel, brick.level, region, bytemuck::cast_slice_mut(&mut voxels));
            if of_store(read)?.is_none() {
                return Err(Fault::Lost(format!("{brick}: the voxels around it cannot be read")));
            }
            let (corner, origin, last) = (core.min.to_array(), region.min.to_array(), level.to_array().map(|n| n - 1));
            self.brick.clear();
            for at in apron.slabs().into_iter().flat_map(|slab| bricks_of(slab, 1)).map(|at| at.to_array()) {
                let voxel: [u32; 3] =
                    std::array::from_fn(|a| (corner[a] + at[a]).saturating_sub(apron.width).min(last[a]) - origin[a]);
                self.brick.push(voxels[region.extent().linear(voxel) as usize]);
            }
            let bytes: &[u8] = bytemuck::cast_slice(&self.brick);
            if bytes.iter().all(|&byte| byte == 0) {
                return Ok(None);
            }
            codec.encode(&mut self.scratch, bytes, out);
            Ok(Some(core_hash(bytes)))
        })
    }
}

/// Writes a shard's bricks in order. `make` appends a brick's encoded bytes to its buffer and returns the hash of the
/// decoded ones, or nothing for a brick of only fill. Nothing is left of a shard that fails.
fn write(
    disk: &Disk,
    store: &Store,
    layout: &Layout,
    id: ShardId,
    mut make: impl FnMut(BrickId, &mut Vec<u8>) -> Result<Option<u128>, Fault>,
) -> Result<Finished, Fault> {
    let mut writer = ShardWriter::new(disk, store.path(), layout);
    let mut encoded = Vec::new();
    let mut add = |brick| -> Result<Option<Finished>, Fault> {
        encoded.clear();
        let hash = make(brick, &mut encoded)?;
        let stored = hash.map(|hash| Encoded { bytes: &encoded, hash });
        Ok(writer.add(brick, stored, |_| None)?)
    };
    let bricks = (0..layout.shard_slots(id.level)).filter_map(|slot| layout.brick_at(id, slot));
    let mut made = Ok(None);
    for brick in bricks {
        made = add(brick);
        if made.is_err() {
            break;
        }
    }
    match made {
        Ok(Some(finished)) => Ok(finished),
        failed => {
            discard(disk, store, layout, id);
            Err(failed.err().unwrap_or_else(|| Fault::Lost("the shard has no bricks".into())))
        }
    }
}

/// Removes a shard's file under its temporary name. If this fails, the next repair replaces it.
pub(super) fn discard(disk: &Disk, store: &Store, layout: &Layout, id: ShardId) {
    let _ = ours::remove_file(disk, &temporary(&layout.shard_path(store.path(), id)));
}

/// The box of a shard's bricks in its level's grid.
pub(super) fn bricks_in(layout: &Layout, id: ShardId) -> VoxelBox {
    let (size, whole) = (layout.shard_bricks(id.level).to_array(), layout.pyramid.level(id.level).bricks.full_box());
    let first = [id.x * size[0], id.y * size[1], id.z * size[2]];
    VoxelBox::new(first, std::array::from_fn(|a| first[a] + size[a])).intersect(whole)
}

/// The box of a shard's voxels.
fn voxels_of(store: &Store, layout: &Layout, id: ShardId) -> VoxelBox {
    let (bricks, edge) = (bricks_in(layout, id), store.pyramid().edge());
    let [min, max] = [bricks.min, bricks.max].map(|corner| corner.to_array().map(|n| n.saturating_mul(edge)));
    VoxelBox::new(min, max).intersect(store.pyramid().level(id.level).extent.full_box())
}

/// The first voxels of a box's rows.
fn rows(region: VoxelBox) -> impl Iterator<Item = [u32; 3]> {
    (region.min.z..region.max.z).flat_map(move |z| (region.min.y..region.max.y).map(move |y| [region.min.x, y, z]))
}
