//! Cores of level 0, read from a source as packing reads them.
//!
//! Each brick is read alone from a source that reads boxes. A source that decodes planes decodes those of a layer of
//! bricks once for a shard, and the shard's part of them is kept: at most a shard's width and height, and a brick's
//! depth.

use super::survey::{Hashes, of_file, recorded};
use crate::error::ReadError;
use crate::metadata::StoreInfo;
use crate::pack::brick::Workspace;
use crate::pack::cascade::{no_data, shape};
use crate::side::core_hash;
use crate::stats::Measure;
use crate::store::{Store, bricks_of, grown};
use brickyard_import::{Access, ImportError, Source, SourceInfo};
use brickyard_volume::{BrickId, Level, VoxelBox};

/// Reader of a store's source.
pub(super) struct Bricks<'a, T> {
    source: &'a dyn Source,
    /// Value of the source's voxels without data that are NaN in the store.
    blanked: Option<T>,
    plane: Vec<T>,
    /// The last planes read, within a shard.
    slab: Vec<T>,
    of_slab: Option<(u32, u32, VoxelBox)>,
}

/// Bytes of a reader's buffers and of the source, for a store whose shards have at most this many voxels along an edge.
pub(super) fn reading_bytes(source: &dyn Source, store: &Store) -> u64 {
    let (info, voxel_bytes) = (source.info(), store.voxel_type().bytes() as u64);
    let [x, y, _] = info.extent.to_array().map(u64::from);
    let shard = u64::from(store.info().shard);
    let planes = match source.access() {
        Access::Box => 0,
        Access::Planes => (x * y)
            .saturating_add(x.min(shard) * y.min(shard) * u64::from(store.info().edge))
            .saturating_mul(voxel_bytes),
    };
    planes.saturating_add(source.reader_bytes()).saturating_add(source.held_bytes())
}

/// The first difference between a source's volume and a store's, in words.
pub(super) fn difference(source: &SourceInfo, store: &Store) -> Option<String> {
    let extent = store.pyramid().levels()[0].extent;
    let found = [
        ("shape (x, y, z)", source.extent.to_string(), extent.to_string()),
        ("voxel type", source.voxel_type.to_string(), store.voxel_type().to_string()),
        ("number of channels", source.channels.to_string(), store.channels().to_string()),
        ("number of time steps", source.times.to_string(), store.times().to_string()),
    ];
    let (what, theirs, ours) = found.into_iter().find(|(_, theirs, ours)| theirs != ours)?;
    Some(format!("its {what} is {theirs}, and the store's {ours}"))
}

impl<'a, T: Measure> Bricks<'a, T> {
    pub(super) fn new(source: &'a dyn Source, info: &StoreInfo) -> Self {
        let stored = info.nodata.map(|nodata| nodata as f64).or(info.blanked);
        // As of appended steps: the store's value counts, unless the source marks voxels itself.
        let described = SourceInfo { nodata: stored, ..source.info().clone() };
        let (_, blanked) = no_data(described.sought_nodata());
        Self { source, blanked, plane: Vec::new(), slab: Vec::new(), of_slab: None }
    }

    /// Reads a brick's core into core 0. `around` is the box of its shard.
    pub(super) fn read(
        &mut self,
        workspace: &mut Workspace<T>,
        id: BrickId,
        core: VoxelBox,
        around: VoxelBox,
    ) -> Result<(), ImportError> {
        let voxels = core.extent().volume() as usize;
        match self.source.access() {
            Access::Box => {
                let packed = &mut workspace.core_mut(0)[..voxels];
                self.source.read_box(id.time, id.channel, core, bytemuck::cast_slice_mut(packed))?;
            }
            Access::Planes => {
                let VoxelBox { min, max } = around;
                let layer = VoxelBox::new([min.x, min.y, core.min.z], [max.x, max.y, core.max.z]);
                self.fill(id, layer)?;
                let width = core.extent().x as usize;
                let packed = workspace.core_mut(0)[..voxels].chunks_exact_mut(width);
                for (out, start) in packed.zip(rows(core, layer)) {
                    out.copy_from_slice(&self.slab[start..start + width]);
                }
            }
        }
        workspace.spread(0, shape(core));
        if let Some(blanked) = self.blanked {
            workspace.blank(0, blanked);
        }
        Ok(())
    }

    /// Reads the planes of a layer of bricks, unless they are at hand.
    fn fill(&mut self, id: BrickId, layer: VoxelBox) -> Result<(), ImportError> {
        if self.of_slab == Some((id.time, id.channel, layer)) {
            return Ok(());
        }
        self.of_slab = None;
        let extent = self.source.info().extent;
        self.plane.resize(extent.x as usize * extent.y as usize, T::default());
        self.slab.clear();
        let width = layer.extent().x as usize;
        for z in layer.min.z..layer.max.z {
            let plane = VoxelBox::new([0, 0, z], [extent.x, extent.y, z + 1]);
            self.source.read_box(id.time, id.channel, plane, bytemuck::cast_slice_mut(&mut self.plane))?;
            let part = VoxelBox::new([layer.min.x, layer.min.y, z], [layer.max.x, layer.max.y, z + 1]);
            rows(part, plane).for_each(|start| self.slab.extend_from_slice(&self.plane[start..start + width]));
        }
        self.of_slab = Some((id.time, id.channel, layer));
        Ok(())
    }
}

/// The starts of the rows of `part` in an array of the box `whole`.
fn rows(part: VoxelBox, whole: VoxelBox) -> impl Iterator<Item = usize> {
    let (extent, origin) = (whole.extent(), whole.min.to_array());
    (part.min.z..part.max.z).flat_map(move |z| {
        (part.min.y..part.max.y)
            .map(move |y| extent.linear([part.min.x - origin[0], y - origin[1], z - origin[2]]) as usize)
    })
}

/// Sound, stored bricks of level 0 in and around a box of bricks, nearest first by layers, at most `most`.
pub(super) fn sound_bricks(store: &Store, like: BrickId, around: VoxelBox, most: usize) -> Vec<BrickId> {
    let whole = store.pyramid().level(Level(0)).bricks.full_box();
    let (mut core, mut hashes) = (vec![0; store.core_bytes()], Hashes::default());
    let mut is_sound = |id: &BrickId| {
        let is_read = is_stored(store, *id, &mut core).unwrap_or(false);
        is_read && hashes.of(store, *id).is_ok_and(|hash| hash.is_none_or(|hash| hash == core_hash(&core)))
    };
    // First those of the damaged shard itself, then of its neighbours, then any.
    let regions = [around, grown(around, 1, whole), whole];
    let mut found: Vec<BrickId> = Vec::new();
    for region in regions {
        for index in bricks_of(region, 1) {
            let id = BrickId { level: Level(0), index, ..like };
            if found.len() < most && !found.contains(&id) && is_sound(&id) {
                found.push(id);
            }
        }
        if !found.is_empty() {
            break;
        }
    }
    found
}

/// Reads a core if it is stored, even if the record of its shard is lost. Returns whether it was read.
pub(super) fn is_stored(store: &Store, id: BrickId, out: &mut [u8]) -> Result<bool, ReadError> {
    let chunks = store.cores();
    let (shard_id, slot) = chunks.layout().shard_of(id);
    let known =
        recorded(chunks, shard_id)?.map_or_else(|| of_file(store, chunks, shard_id), |known| Ok(Some(known)))?;
    let Some(fingerprint) = known.filter(|known| known.has_file()) else { return Ok(false) };
    let shard = chunks.open_as(shard_id, fingerprint)?;
    chunks.read_in(&shard, slot, id, out)?;
    Ok(shard.range(slot).is_ok_and(|range| range.is_some()))
}
