//! Bricks of levels that a foreign image lacks: each is reduced from the next finer level's, which may be made as well. Made bricks are kept in memory, up
//! to a limit, and compressed in the user's cache, for one state of the image's files.
//!
//! A brick `k` levels above the image's own costs up to `8^k` of its bricks: on all processors, unless a thread of a pool asks for it.

use crate::codec::{BrickCodec, Codec};
use crate::downsample::Reduction;
use crate::error::ReadError;
use crate::foreign::Foreign;
use crate::foreign::making::{Making, Progress};
use crate::mutex::lock;
use crate::pack::brick::{fill_up, reduce};
use crate::pack::cascade::{coarse_box, no_data, ratio, shape};
use crate::scratch::Scratch;
use crate::stats::Measure;
use brickyard_volume::{BrickId, BrickIndex, Level, Pyramid, VoxelBox, VoxelType, with_voxel_type};
use lru::LruCache;
use rayon::prelude::*;
use std::num::NonZeroUsize;
use std::sync::{Arc, Mutex};

/// Bytes of made bricks kept in memory.
const KEPT_BYTES: usize = 64 << 20;

/// The made bricks of an image.
pub(crate) struct Made {
    codec: BrickCodec,
    recent: Mutex<LruCache<BrickId, Arc<[u8]>>>,
    /// Held while a brick is made, whose makers use all processors: another thread then finds it, and those beneath, kept.
    turn: Mutex<()>,
    progress: Progress,
    /// Levels made one from another, at most.
    depth: u64,
}

impl Made {
    /// Creates an empty store of a pyramid's made bricks, of which there are `bricks`.
    pub(crate) fn new(pyramid: &Pyramid, voxel_type: VoxelType, bricks: u64) -> Self {
        let codec = BrickCodec::new(Codec::default_for(voxel_type), voxel_type, pyramid.edge());
        let most = (KEPT_BYTES / codec.core_bytes()) as u64;
        let count = NonZeroUsize::new(most.min(bricks) as usize).unwrap_or(NonZeroUsize::MIN);
        let recent = Mutex::new(LruCache::new(count));
        Self {
            codec,
            recent,
            turn: Mutex::new(()),
            progress: Progress::default(),
            depth: pyramid.levels().len() as u64,
        }
    }

    /// Most memory of kept bricks, and of those under way in so many threads: at each level a thread may hold a brick, a finer one and its half.
    pub(crate) fn cache_bytes(&self, threads: u64) -> u64 {
        let core_bytes = self.codec.core_bytes() as u64;
        lock(&self.recent).cap().get() as u64 * core_bytes + threads * self.depth * 5 * core_bytes / 2
    }

    /// The bricks under way, if any.
    pub(crate) fn making(&self) -> Option<Making> {
        self.progress.now()
    }

    /// Fills `out` with the core of a brick, kept or made from the finer level.
    ///
    /// # Errors
    /// If a brick beneath cannot be read.
    pub(crate) fn read(&self, foreign: &Foreign, id: BrickId, out: &mut [u8]) -> Result<(), ReadError> {
        if self.read_recent(id, out) {
            return Ok(());
        }
        // A thread of a pool may wait for nobody whose work its pool does.
        let _turn = rayon::current_thread_index().is_none().then(|| lock(&self.turn));
        if self.read_recent(id, out) {
            return Ok(());
        }
        let _waiting = self.progress.wait_for(foreign.levels.bricks_beneath(id));
        self.read_counted(foreign, id, out)
    }

    /// As [`Made::read`], for a brick whose own ones beneath are waited for already.
    fn read_counted(&self, foreign: &Foreign, id: BrickId, out: &mut [u8]) -> Result<(), ReadError> {
        if self.read_recent(id, out) {
            self.progress.advance(foreign.levels.bricks_beneath(id));
            return Ok(());
        }
        if self.read_kept(foreign, id, out) {
            self.progress.advance(foreign.levels.bricks_beneath(id));
        } else {
            with_voxel_type!(foreign.voxel_type(), T => make::<T, { size_of::<T>() }>(foreign, id, out))?;
            self.keep(foreign, id, out);
        }
        lock(&self.recent).put(id, (&*out).into());
        Ok(())
    }

    fn read_recent(&self, id: BrickId, out: &mut [u8]) -> bool {
        let mut recent = lock(&self.recent);
        let core = recent.get(&id);
        core.inspect(|core| out.copy_from_slice(core)).is_some()
    }

    /// Fills `out` with the core of a finer brick, of the image or made.
    fn read_beneath(&self, foreign: &Foreign, id: BrickId, out: &mut [u8]) -> Result<(), ReadError> {
        match foreign.levels.source(id.level) {
            Some(source) => {
                foreign.cut(source, id, out)?;
                self.progress.advance(1);
                Ok(())
            }
            None => self.read_counted(foreign, id, out),
        }
    }

    /// Fills `out` with a brick of the user's cache; false if there is none.
    fn read_kept(&self, foreign: &Foreign, id: BrickId, out: &mut [u8]) -> bool {
        let state = foreign.cache().is_there().then(|| foreign.state()).flatten();
        let encoded = state.and_then(|state| foreign.cache().read(&name(state, id)));
        encoded.is_some_and(|encoded| Scratch::with(|scratch| self.codec.decode(scratch, &encoded, out)).is_ok())
    }

    fn keep(&self, foreign: &Foreign, id: BrickId, core: &[u8]) {
        let Some(state) = foreign.cache().is_there().then(|| foreign.state()).flatten() else { return };
        let mut encoded = Vec::new();
        Scratch::with(|scratch| self.codec.encode(scratch, core, &mut encoded));
        foreign.cache().forget_states_but(&state_name(state));
        foreign.cache().write(&name(state, id), &encoded);
    }
}

/// A made brick's name in the cache.
fn name(state: u64, BrickId { time, channel, level, index }: BrickId) -> String {
    format!("{}/{}.{time}.{channel}.{}.{}.{}", state_name(state), level.0, index.z, index.y, index.x)
}

/// The folder in the cache for one state of the image's files.
fn state_name(state: u64) -> String {
    format!("{state:016x}")
}

/// A brick's part of the next coarser level: its box, and its voxels.
type Part<T> = (VoxelBox, Vec<T>);

/// Makes a brick's core from those of the next finer level.
fn make<T: Measure, const N: usize>(foreign: &Foreign, id: BrickId, out: &mut [u8]) -> Result<(), ReadError> {
    let pyramid = foreign.pyramid();
    let region = pyramid.brick_box(id.level, id.index);
    let children: Vec<BrickIndex> = pyramid.children(id.level, id.index).collect();
    // A thread of a pool might take up other work of its pool while it waits, and with it a lock that it holds.
    let parts: Vec<Part<T>> = match rayon::current_thread_index() {
        None => children.into_par_iter().map(|index| part(foreign, id, index)).collect::<Result<_, _>>()?,
        Some(_) => children.into_iter().map(|index| part(foreign, id, index)).collect::<Result<_, _>>()?,
    };
    let (edge, first) = (pyramid.edge() as usize, region.min.to_array());
    for (of_child, voxels) in parts {
        let [nx, ny, _] = shape(of_child);
        let at = of_child.min.to_array();
        let at: [usize; 3] = std::array::from_fn(|axis| (at[axis] - first[axis]) as usize);
        for (i, row) in voxels.chunks_exact(nx).enumerate() {
            let place = ((at[2] + i / ny) * edge + at[1] + i % ny) * edge + at[0];
            out[place * size_of::<T>()..][..size_of_val(row)].copy_from_slice(bytemuck::cast_slice(row));
        }
    }
    fill_up(out.as_chunks_mut::<N>().0, edge, shape(region));
    Ok(())
}

/// The part of a coarse brick `id` that the finer brick at `index` makes.
fn part<T: Measure>(foreign: &Foreign, id: BrickId, index: BrickIndex) -> Result<Part<T>, ReadError> {
    let pyramid = foreign.pyramid();
    let finer = Level(id.level.0 - 1);
    let (edge, core) = (pyramid.edge() as usize, pyramid.brick_box(finer, index));
    let mut voxels = vec![T::default(); edge.pow(3)];
    let beneath = BrickId { level: finer, index, ..id };
    foreign.made.read_beneath(foreign, beneath, bytemuck::cast_slice_mut(&mut voxels))?;
    let factor = ratio(pyramid.level(finer), pyramid.level(id.level));
    let region = coarse_box(core, factor);
    let mut coarse = vec![T::default(); region.extent().volume() as usize];
    let reduction = Reduction { method: foreign.method(), edge, shape: shape(core), factor };
    reduce(reduction, &voxels, no_data::<T>(foreign.nodata()).0, &mut coarse);
    Ok((region, coarse))
}
