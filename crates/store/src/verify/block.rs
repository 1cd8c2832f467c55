//! The check of one block of bricks: their hashes, ranges, aprons and reductions.

use super::{Verifier, VerifyProblem};
use crate::chunks::Chunks;
use crate::error::ReadError;
use crate::layout::Layout;
use crate::mutex::lock;
use crate::nodata;
use crate::pack::brick::Workspace;
use crate::pack::cascade::{coarse_box, ratio, shape};
use crate::side::core_hash;
use crate::stats::{Measure, Range, Tally, join};
use crate::store::{Store, bricks_of, grown};
use brickyard_volume::{Apron, BrickId, BrickIndex, Extent, Level, PageId, VoxelBox};
use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::atomic::Ordering;

/// Bricks of a level read together.
#[derive(Clone, Copy)]
pub(super) struct Block<'a> {
    pub(super) store: &'a Store,
    pub(super) time: u32,
    pub(super) channel: u32,
    pub(super) level: Level,
    pub(super) core: VoxelBox,
}

impl Block<'_> {
    fn brick(&self, index: BrickIndex) -> BrickId {
        BrickId { time: self.time, channel: self.channel, level: self.level, index }
    }

    pub(super) fn bricks(&self) -> impl Iterator<Item = BrickIndex> + use<> {
        bricks_of(self.core, self.store.pyramid().edge())
    }

    /// The block's voxels, with their surroundings for ranges and aprons.
    fn read_box(&self) -> VoxelBox {
        self.grown(self.core, self.store.apron().map_or(1, |apron| apron.width))
    }

    /// Grows a box by `by` voxels on each side, within the level.
    fn grown(&self, region: VoxelBox, by: u32) -> VoxelBox {
        grown(region, by, self.store.pyramid().level(self.level).extent.full_box())
    }

    /// Voxels of the level per voxel of the next, which must exist.
    fn factor(&self) -> [usize; 3] {
        let level = |k| self.store.pyramid().level(Level(k));
        ratio(level(self.level.0), level(self.level.0 + 1))
    }
}

/// One thread's buffers.
pub(super) struct Buffers<T> {
    workspace: Workspace<T>,
    /// The block with its surroundings.
    fine: Vec<T>,
    /// The block's part of each next level; empty if unreadable.
    coarse: Vec<Vec<T>>,
    brick: Vec<u8>,
    apron: Vec<u8>,
    hashes: HashPage,
}

impl<T: Measure> Buffers<T> {
    pub(super) fn new(verifier: &Verifier) -> Self {
        let store = &verifier.views[0];
        Self {
            workspace: Workspace::new(store.pyramid().edge() as usize, verifier.nodata()),
            fine: Vec::new(),
            coarse: vec![Vec::new(); verifier.views.len()],
            brick: vec![0; store.core_bytes()],
            apron: vec![0; store.aprons().map_or(0, Chunks::chunk_bytes)],
            hashes: HashPage::default(),
        }
    }
}

/// The last page of hashes used; empty at first.
#[derive(Default)]
struct HashPage(Option<(PageId, bool, Vec<u128>)>);

impl HashPage {
    fn stored(&mut self, store: &Store, id: BrickId) -> Result<u128, ReadError> {
        let (page, place) = store.pyramid().page_of(id);
        // Pages of two pyramids have the same ids.
        let is_second = store.layout().second().is_some();
        if let Some((of, second, hashes)) = &self.0
            && (*of, *second) == (page, is_second)
        {
            return Ok(hashes[place]);
        }
        let hashes = store.read_hashes(page)?;
        let stored = hashes[place];
        self.0 = Some((page, is_second, hashes));
        Ok(stored)
    }
}

/// A block under check, and the findings so far.
pub(super) struct BlockCheck<'b, 'a, T> {
    verifier: &'b Verifier<'a>,
    buffers: &'b mut Buffers<T>,
    block: Block<'a>,
    /// Unreadable bricks of the block and around it.
    unread: BTreeSet<BrickIndex>,
    /// The range and the tally of the block's voxels.
    range: Range<T>,
    tally: Tally,
    problems: Vec<VerifyProblem>,
}

impl<'b, 'a, T: Measure> BlockCheck<'b, 'a, T> {
    pub(super) fn new(verifier: &'b Verifier<'a>, buffers: &'b mut Buffers<T>, block: Block<'a>) -> Self {
        let (unread, tally, problems) = Default::default();
        Self { verifier, buffers, block, unread, range: T::EMPTY, tally, problems }
    }

    /// Returns all problems; adds the voxels of level 0 to the channel's totals.
    pub(super) fn run(mut self) -> Vec<VerifyProblem> {
        if self.is_empty() {
            self.check_empty();
        } else {
            self.check_stored();
        }
        if self.block.level == Level(0) {
            let totals = &mut lock(&self.verifier.totals)[self.block.channel as usize];
            self.buffers.workspace.counter.drain_into(totals);
            totals.add_tally(&self.tally);
            totals.add_range(self.range.to_f64());
        }
        self.problems
    }

    fn report(&mut self, error: ReadError) {
        self.problems.extend(self.verifier.unread(error));
    }

    /// Whether nothing is stored in or around the block, or of its part of the next level.
    fn is_empty(&self) -> bool {
        let block = self.block;
        let is_empty = |store: &Store, level, region| {
            bricks_of(region, store.pyramid().edge()).all(|index| {
                let id = BrickId { level, ..block.brick(index) };
                store.chunks().all(|chunks| chunks.is_stored(id).is_ok_and(|stored| !stored))
            })
        };
        let next = |store| is_empty(store, Level(block.level.0 + 1), coarse_box(block.core, block.factor()));
        is_empty(block.store, block.level, block.read_box()) && self.verifier.coarser(block).iter().all(next)
    }

    /// Checks an empty block, without reading.
    fn check_empty(&mut self) {
        let nodata = self.verifier.nodata::<T>();
        self.range = nodata::range(&[T::default()], nodata);
        self.buffers.brick.fill(0);
        let fill = core_hash(&self.buffers.brick);
        for index in self.block.bricks() {
            self.check_ranges(index, self.range, Some(self.range));
            self.check_hash(index, fill);
        }
        let voxels = self.block.core.extent().volume();
        if nodata == Some(T::default()) {
            self.tally.nodata = voxels;
        } else if self.block.level == Level(0) {
            self.buffers.workspace.counter.constant(T::default(), voxels);
        }
    }

    fn check_stored(&mut self) {
        self.read();
        for index in self.block.bricks() {
            if !self.unread.contains(&index) {
                self.check_brick(index);
            }
            if let Some(apron) = self.block.store.apron() {
                self.check_apron(index, apron);
            }
        }
    }

    /// Fills the buffers with the block's voxels, and collects the unreadable bricks.
    fn read(&mut self) {
        let (verifier, block, region) = (self.verifier, self.block, self.block.read_box());
        let pyramid = verifier.pyramid();
        self.buffers.fine.resize(region.extent().volume() as usize, T::default());
        for index in bricks_of(region, pyramid.edge()) {
            match block.store.read_core(block.brick(index), &mut self.buffers.brick) {
                Ok(()) => {
                    let is_own = !block.core.intersect(pyramid.brick_box(block.level, index)).is_empty();
                    if is_own {
                        self.check_hash(index, core_hash(&self.buffers.brick));
                    }
                    let fine = bytemuck::cast_slice_mut(&mut self.buffers.fine);
                    block.store.copy_rows(index, &self.buffers.brick, region, fine);
                }
                Err(error) => {
                    self.unread.insert(index);
                    verifier.level_0_unread.fetch_or(block.level == Level(0), Ordering::Relaxed);
                    self.report(error);
                }
            }
        }
        for (i, store) in verifier.coarser(block).iter().enumerate() {
            let (level, region) = (Level(block.level.0 + 1), coarse_box(block.core, block.factor()));
            let coarse = &mut self.buffers.coarse[i];
            coarse.resize(region.extent().volume() as usize, T::default());
            let bytes = bytemuck::cast_slice_mut(coarse);
            if let Err(error) = store.read_box(block.time, block.channel, level, region, bytes) {
                coarse.clear();
                self.report(error);
            }
        }
    }

    fn check_hash(&mut self, index: BrickIndex, computed: u128) {
        let Block { store, level, .. } = self.block;
        let id = self.block.brick(index);
        match self.buffers.hashes.stored(store, id) {
            Ok(stored) if stored == computed => {}
            Ok(stored) => {
                let what = format!("hashes: expected {computed:032x}, found {stored:032x}");
                let path = store.layout().side_dir(store.path(), level).join("hashes");
                self.problems.push(VerifyProblem { brick: Some(id), path, what });
            }
            Err(error) => self.report(error),
        }
    }

    /// Compares a brick's stored ranges with its voxels and its children's ranges.
    fn check_ranges(&mut self, index: BrickIndex, core: Range<T>, reach: Option<Range<T>>) {
        if let Err(error) = self.compare_ranges(self.block.brick(index), core, reach) {
            self.report(error);
        }
    }

    fn compare_ranges(&mut self, id: BrickId, core: Range<T>, reach: Option<Range<T>>) -> Result<(), ReadError> {
        let store = self.block.store;
        let (page, place) = store.sides().ranges_of(id)?;
        let (mut core, mut reach) = (core.to_f64(), reach.map(Range::to_f64));
        for child in store.pyramid().children(id.level, id.index) {
            let child = BrickId { level: Level(id.level.0 - 1), index: child, ..id };
            let (page, place) = store.sides().ranges_of(child)?;
            core = join(core, page.core(place));
            reach = reach.map(|reach| join(reach, page.reach(place)));
        }
        let checked = [("core", Some(core), page.core(place)), ("core and its surroundings", reach, page.reach(place))];
        for (of, computed, stored) in checked {
            if let Some(computed) = computed.filter(|computed| *computed != stored) {
                let show = |r: Option<(f64, f64)>| r.map_or("none".into(), |(low, high)| format!("{low} to {high}"));
                let path = store.layout().side_dir(store.path(), id.level).join("ranges");
                let what = format!("range of the {of}: expected {}, found {}", show(computed), show(stored));
                self.problems.push(VerifyProblem { brick: Some(id), path, what });
            }
        }
        Ok(())
    }

    /// Checks a brick's ranges, and its part of the next level.
    fn check_brick(&mut self, index: BrickIndex) {
        let (verifier, block, id) = (self.verifier, self.block, self.block.brick(index));
        let (pyramid, fine_box) = (verifier.pyramid(), block.read_box());
        let core = pyramid.brick_box(id.level, index);
        copy_box(&self.buffers.fine, fine_box, core, self.buffers.workspace.core_mut(0));
        self.buffers.workspace.spread(0, shape(core));
        let summary = self.buffers.workspace.digest(0, shape(core), id.level == Level(0));
        self.tally.add(&summary.tally);
        self.range = self.range.join(summary.parts.whole());
        let padded = block.grown(core, 1);
        let reach = self.is_read(padded).then(|| range_of_box(&self.buffers.fine, fine_box, padded, verifier.nodata()));
        self.check_ranges(index, summary.parts.whole(), reach);
        for (store, coarse) in verifier.coarser(block).iter().zip(&self.buffers.coarse).filter(|(_, c)| !c.is_empty()) {
            let factor = block.factor();
            let (region, whole) = (coarse_box(core, factor), coarse_box(block.core, factor));
            self.buffers.workspace.reduce(0, shape(core), factor, store.downsample());
            let wrong = count_differences(&self.buffers.workspace.coarse, region, coarse, whole);
            if wrong > 0 {
                let parent = pyramid.parent(id.level, index).unwrap_or(index);
                let parent = BrickId { level: Level(id.level.0 + 1), index: parent, ..id };
                let (method, count) = (store.downsample().name(), region.extent().volume());
                let what = format!("{wrong} of {count} voxels differ from the {method} of brick {id}");
                let path = shard_path(store, store.layout(), parent);
                self.problems.push(VerifyProblem { brick: Some(parent), path, what });
            }
        }
    }

    /// Whether all bricks of a box were readable.
    fn is_read(&self, region: VoxelBox) -> bool {
        bricks_of(region, self.verifier.pyramid().edge()).all(|index| !self.unread.contains(&index))
    }

    /// Compares a brick's stored apron with the voxels around its core.
    fn check_apron(&mut self, index: BrickIndex, apron: Apron) {
        let (store, id, pyramid) = (self.block.store, self.block.brick(index), self.verifier.pyramid());
        let core = pyramid.brick_box(id.level, index);
        if let Err(error) = store.read_apron(id, &mut self.buffers.apron) {
            return self.report(error);
        }
        if !self.is_read(self.block.grown(core, apron.width)) {
            return;
        }
        let whole = self.block.read_box();
        let (origin, extent) = (whole.min.to_array(), whole.extent());
        let last = pyramid.level(id.level).extent.to_array().map(|n| n - 1);
        let corner = core.min.to_array();
        let is_right = |at: [u32; 3], found: &[u8]| {
            let voxel: [u32; 3] = std::array::from_fn(|a| (corner[a] + at[a]).saturating_sub(apron.width).min(last[a]));
            let voxel = extent.linear(std::array::from_fn(|a| voxel[a] - origin[a])) as usize;
            bytemuck::bytes_of(&self.buffers.fine[voxel]) == found
        };
        let places = apron.slabs().into_iter().flat_map(|slab| bricks_of(slab, 1));
        let found = places.zip(self.buffers.apron.chunks_exact(size_of::<T>()));
        let wrong = found.filter(|(at, voxel)| !is_right(at.to_array(), voxel)).count();
        if wrong > 0 {
            let what = format!("{wrong} of the apron's {} voxels differ from those around the core", apron.voxels());
            let path = shard_path(store, &store.layout().of_aprons(), id);
            self.problems.push(VerifyProblem { brick: Some(id), path, what });
        }
    }
}

fn shard_path(store: &Store, layout: &Layout, id: BrickId) -> PathBuf {
    layout.shard_path(store.path(), layout.shard_of(id).0)
}

/// The rows of `part` in an array of the box `whole`.
fn rows(part: VoxelBox, whole: VoxelBox) -> impl Iterator<Item = std::ops::Range<usize>> {
    let extent: Extent = whole.extent();
    let origin = whole.min.to_array();
    let nx = part.extent().x as usize;
    (part.min.z..part.max.z).flat_map(move |z| {
        (part.min.y..part.max.y).map(move |y| {
            let start = extent.linear([part.min.x - origin[0], y - origin[1], z - origin[2]]) as usize;
            start..start + nx
        })
    })
}

/// The range of `part` in an array of the box `whole`, without `nodata` voxels: computed directly, rather than combined
/// from neighbours as in packing.
fn range_of_box<T: Measure>(array: &[T], whole: VoxelBox, part: VoxelBox, nodata: Option<T>) -> Range<T> {
    rows(part, whole).fold(T::EMPTY, |range, row| range.join(nodata::range(&array[row], nodata)))
}

/// Copies `part` from an array of the box `whole` to the start of `out`, packed.
fn copy_box<T: Copy>(array: &[T], whole: VoxelBox, part: VoxelBox, out: &mut [T]) {
    let nx = part.extent().x as usize;
    for (out, row) in out.chunks_exact_mut(nx).zip(rows(part, whole)) {
        out.copy_from_slice(&array[row]);
    }
}

/// Number of voxels with different bits in packed `expected` and `part` of `array`.
fn count_differences<T: Measure>(expected: &[T], part: VoxelBox, array: &[T], whole: VoxelBox) -> usize {
    let nx = part.extent().x as usize;
    let in_row = |(row, range): (&[T], std::ops::Range<usize>)| {
        let (row, found) = (bytemuck::cast_slice::<T, u8>(row), bytemuck::cast_slice::<T, u8>(&array[range]));
        let voxels = |bytes| <[u8]>::chunks_exact(bytes, size_of::<T>());
        if row == found { 0 } else { voxels(row).zip(voxels(found)).filter(|(a, b)| a != b).count() }
    };
    expected.chunks_exact(nx).zip(rows(part, whole)).map(in_row).sum()
}
