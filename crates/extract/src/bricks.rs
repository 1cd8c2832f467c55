//! Voxels of one level, step and channel, read brick by brick; the last decoded bricks are kept.
//!
//! Threads wait for one another only at a brick that both need.

use crate::points::Points;
use brickyard_store::{ReadError, Store};
use brickyard_volume::{BrickId, BrickIndex, Level, Voxel, VoxelBox};
use lru::LruCache;
use std::num::NonZeroUsize;
use std::sync::{Arc, Mutex, PoisonError};

/// A brick's core, once decoded.
type Slot = Arc<Mutex<Option<Arc<Vec<u8>>>>>;

/// A reader of voxels.
pub(crate) struct Bricks<'a> {
    store: &'a Store,
    part: Part,
    kept: Mutex<LruCache<BrickIndex, Slot>>,
}

/// The part of a store to be read.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Part {
    pub(crate) level: Level,
    pub(crate) time: u32,
    pub(crate) channel: u32,
    /// Everything outside of it counts as absent.
    pub(crate) region: VoxelBox,
}

impl<'a> Bricks<'a> {
    /// A reader keeping this many bricks.
    pub(crate) fn new(store: &'a Store, part: Part, kept: usize) -> Self {
        let kept = Mutex::new(LruCache::new(NonZeroUsize::new(kept).unwrap_or(NonZeroUsize::MIN)));
        Self { store, part, kept }
    }

    pub(crate) fn store(&self) -> &'a Store {
        self.store
    }

    pub(crate) fn region(&self) -> VoxelBox {
        self.part.region
    }

    /// The bricks that overlap a box.
    pub(crate) fn of_box(&self, region: VoxelBox) -> impl Iterator<Item = BrickId> {
        let edge = self.store.pyramid().edge();
        let (min, max) = (region.min.to_array().map(|v| v / edge), region.max.to_array().map(|v| v.div_ceil(edge)));
        (min[2]..max[2]).flat_map(move |z| {
            (min[1]..max[1]).flat_map(move |y| (min[0]..max[0]).map(move |x| self.id(BrickIndex::new(x, y, z))))
        })
    }

    fn id(&self, index: BrickIndex) -> BrickId {
        BrickId { time: self.part.time, channel: self.part.channel, level: self.part.level, index }
    }

    /// Reads the covered voxels.
    ///
    /// # Errors
    /// At the first unreadable brick.
    pub(crate) fn fill<T: Voxel>(&self, points: &mut Points<T>) -> Result<(), ReadError> {
        let Some(covered) = points.covered_box() else { return Ok(()) };
        let edge = self.store.pyramid().edge();
        for id in self.of_box(covered) {
            let core = self.core(id)?;
            let corner = id.index.to_array().map(|i| i * edge);
            // Saturating: the last brick may reach past the greatest index.
            let brick = VoxelBox::new(corner, corner.map(|c| c.saturating_add(edge)));
            let shared = brick.intersect(covered);
            let count = (shared.max.x - shared.min.x) as usize;
            let edge = edge as usize;
            for z in shared.min.z..shared.max.z {
                for y in shared.min.y..shared.max.y {
                    let from = [shared.min.x - corner[0], y - corner[1], z - corner[2]].map(|v| v as usize);
                    let from = (from[2] * edge + from[1]) * edge + from[0];
                    let within = |a: usize, voxel: u32| (i64::from(voxel) - points.corner[a]) as usize;
                    let to = points.row(within(1, y), within(2, z)) + within(0, shared.min.x);
                    let bytes = &core[from * size_of::<T>()..(from + count) * size_of::<T>()];
                    bytemuck::cast_slice_mut(&mut points.values[to..to + count]).copy_from_slice(bytes);
                }
            }
        }
        Ok(())
    }

    /// A decoded brick.
    fn core(&self, id: BrickId) -> Result<Arc<Vec<u8>>, ReadError> {
        let slot = {
            let mut kept = self.kept.lock().unwrap_or_else(PoisonError::into_inner);
            kept.get_or_insert(id.index, Slot::default).clone()
        };
        let mut slot = slot.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(core) = &*slot {
            return Ok(core.clone());
        }
        let mut core = vec![0; self.store.core_bytes()];
        self.store.read_core(id, &mut core)?;
        Ok(slot.insert(Arc::new(core)).clone())
    }

    /// Least and greatest valid value of a brick; `None` if there is none.
    ///
    /// # Errors
    /// If the brick's page is unreadable.
    pub(crate) fn range(&self, id: BrickId) -> Result<Option<(f64, f64)>, ReadError> {
        self.store.minmax(id)
    }
}
