//! Side data during packing: properties of bricks and shards come in as these are made, and go out page by page, so
//! memory is independent of the volume's height, time steps and channels.
//!
//! A brick's ranges are final once its neighbours are packed and its children's ranges are final. So a layer of bricks
//! waits for the next one of its stage, and for the layers below it in the octree; then it is joined to its parents,
//! and kept until all layers of its pages are complete: up to 16, and some four that wait.

use crate::layout::{Layout, ShardId};
use crate::pack::parts::{Parts, directions};
use crate::pack::plan::{PackPlan, Stage};
use crate::shard::Fingerprint;
use crate::side::{PageFile, PageFiles, SideArray, core_hash};
use crate::stats::{Measure, Range};
use brickyard_volume::{BrickId, BrickIndex, Extent, Level, PageId};
use std::collections::VecDeque;
use std::path::Path;

/// The ranges and hashes of all stages' bricks, under way to pages.
pub(crate) struct BrickPages<'a, T> {
    plan: &'a PackPlan,
    stages: Vec<StagePages<T>>,
    files: PageFiles,
    /// The hash of an absent brick.
    fill_hash: u128,
}

/// The pages of one stage.
struct StagePages<T> {
    ranges: SideArray,
    hashes: SideArray,
    bricks: Extent,
    /// First layer still open.
    first: u32,
    /// The open layers with any data.
    waiting: VecDeque<Layer<T>>,
    /// Final layers of the current row of pages.
    finished: Vec<Layer<T>>,
}

/// One layer of bricks, x fastest.
struct Layer<T> {
    core: Vec<Range<T>>,
    /// The ranges of cores with one voxel around each.
    reach: Vec<Range<T>>,
    hashes: Vec<u128>,
    /// Bricks still to come.
    bricks: u64,
    /// Number of open child layers.
    children: u32,
}

impl<'a, T: Measure> BrickPages<'a, T> {
    pub(crate) fn new(plan: &'a PackPlan, store: &Path) -> Self {
        let stage = |Stage { layout, level, .. }: &Stage| StagePages {
            ranges: SideArray::ranges(store, layout, *level, T::TYPE),
            hashes: SideArray::hashes(store, layout, *level),
            bricks: layout.pyramid.level(*level).bricks,
            first: 0,
            waiting: VecDeque::new(),
            finished: Vec::new(),
        };
        let fill = vec![0; (plan.layout.pyramid.edge() as usize).pow(3) * size_of::<T>()];
        let stages = plan.stages.iter().map(stage).collect();
        Self { plan, stages, files: PageFiles::default(), fill_hash: core_hash(&fill) }
    }

    /// Adds the next brick of stage `s`: its ranges by part, and the hash of its core, `None` if all fill. Appends
    /// completed files to `out`.
    pub(crate) fn add(&mut self, s: usize, id: BrickId, parts: &Parts<T>, hash: Option<u128>, out: &mut Vec<PageFile>) {
        let (index, bricks) = (id.index.to_array(), self.stages[s].bricks.to_array());
        let at = (id.index.y * bricks[0] + id.index.x) as usize;
        let hash = hash.unwrap_or(self.fill_hash);
        let layer = self.layer(s, id.index.z);
        layer.core[at] = layer.core[at].join(parts.whole());
        layer.hashes[at] = hash;
        layer.bricks -= 1;
        let is_complete = layer.bricks == 0;
        for d in directions() {
            let neighbour: [_; 3] =
                std::array::from_fn(|a| index[a].checked_add_signed(d[a]).filter(|&i| i < bricks[a]));
            if let [Some(x), Some(y), Some(z)] = neighbour {
                let reach = &mut self.layer(s, z).reach[(y * bricks[0] + x) as usize];
                *reach = reach.join(parts.toward(d));
            }
        }
        if is_complete {
            self.advance(s, (id.time, id.channel), out);
        }
    }

    /// An open layer.
    fn layer(&mut self, s: usize, z: u32) -> &mut Layer<T> {
        let StagePages { bricks, first, .. } = self.stages[s];
        let cells = bricks.x as u64 * bricks.y as u64;
        while first + self.stages[s].waiting.len() as u32 <= z {
            let z = first + self.stages[s].waiting.len() as u32;
            let layer = Layer {
                core: vec![T::EMPTY; cells as usize],
                reach: vec![T::EMPTY; cells as usize],
                hashes: vec![0; cells as usize],
                bricks: cells,
                children: self.child_layers(s, z),
            };
            self.stages[s].waiting.push_back(layer);
        }
        &mut self.stages[s].waiting[(z - first) as usize]
    }

    /// Number of the finer stage's layers with parents in a layer.
    fn child_layers(&self, s: usize, z: u32) -> u32 {
        let stage = &self.plan.stages[s];
        let Some((finer, _)) = stage.from else { return 0 };
        let finer = self.plan.stages[finer].grid();
        let ratio = stage.grid().factor[2] / finer.factor[2];
        ((z + 1) * ratio).min(finer.bricks.z) - z * ratio
    }

    /// Finishes the layers of stage `s` that wait for nothing, then those of coarser stages.
    fn advance(&mut self, s: usize, volume: (u32, u32), out: &mut Vec<PageFile>) {
        loop {
            let stage = &mut self.stages[s];
            let is_last = stage.first + 1 == stage.bricks.z;
            let next_is_there = is_last || stage.waiting.get(1).is_some_and(|next| next.bricks == 0);
            if !next_is_there || stage.waiting.front().is_none_or(|layer| layer.bricks > 0 || layer.children > 0) {
                return;
            }
            let Some(layer) = stage.waiting.pop_front() else { return };
            let z = stage.first;
            stage.first = if is_last { 0 } else { z + 1 };
            let coarser: Vec<usize> = self.plan.coarser(s).map(|(coarser, _)| coarser).collect();
            coarser.iter().for_each(|&coarser| self.join(s, z, &layer, coarser));
            self.stages[s].finish(z, layer, volume, self.plan.stages[s].level, &mut self.files, out);
            coarser.iter().for_each(|&coarser| self.advance(coarser, volume, out));
            if is_last {
                return;
            }
        }
    }

    /// Joins a final layer's ranges to those of its parents.
    fn join(&mut self, s: usize, z: u32, layer: &Layer<T>, coarser: usize) {
        let Stage { layout, level, .. } = &self.plan.stages[s];
        let (width, parents) = (self.stages[s].bricks.x, self.stages[coarser].bricks.x);
        let parent = |x, y| layout.pyramid.parent(*level, BrickIndex::new(x, y, z)).unwrap_or_default();
        let above = self.layer(coarser, parent(0, 0).z);
        above.children -= 1;
        for (i, (&core, &reach)) in layer.core.iter().zip(&layer.reach).enumerate() {
            let parent = parent(i as u32 % width, i as u32 / width);
            let at = (parent.y * parents + parent.x) as usize;
            above.core[at] = above.core[at].join(core);
            above.reach[at] = above.reach[at].join(reach);
        }
    }
}

impl<T: Measure> StagePages<T> {
    /// Keeps a final layer; writes a row of pages once complete.
    fn finish(
        &mut self,
        z: u32,
        layer: Layer<T>,
        (time, channel): (u32, u32),
        level: Level,
        files: &mut PageFiles,
        out: &mut Vec<PageFile>,
    ) {
        self.finished.push(layer);
        let paging = self.ranges.paging();
        let depth = paging.page_extent().z;
        if z + 1 < self.bricks.z && !(z + 1).is_multiple_of(depth) {
            return;
        }
        let grid = paging.page_grid();
        for (y, x) in (0..grid.y).flat_map(|y| (0..grid.x).map(move |x| (y, x))) {
            let page = PageId { time, channel, level, z: z / depth, y, x };
            let (ranges, hashes) = self.page(page);
            out.extend(files.add(&self.ranges, page, &ranges));
            out.extend(files.add(&self.hashes, page, &hashes));
        }
        self.finished.clear();
    }

    /// The content of a page with complete layers.
    fn page(&self, page: PageId) -> (Vec<u8>, Vec<u8>) {
        let paging = self.ranges.paging();
        let (mut ranges, mut hashes) = (vec![0; self.ranges.page_bytes()], vec![0; self.hashes.page_bytes()]);
        let bricks = paging.cells([page.x, page.y, page.z]);
        for (z, layer) in (bricks.min.z..bricks.max.z).zip(&self.finished) {
            for (y, x) in (bricks.min.y..bricks.max.y).flat_map(|y| (bricks.min.x..bricks.max.x).map(move |x| (y, x))) {
                let (at, place) = ((y * self.bricks.x + x) as usize, paging.locate([x, y, z]).1);
                let ends = |range: Range<T>| if range.is_empty() { T::NO_ENDS } else { [range.low, range.high] };
                let [core, reach] = [layer.core[at], layer.reach[at]].map(ends);
                let voxels = [core[0], core[1], reach[0], reach[1]];
                ranges[place * size_of_val(&voxels)..][..size_of_val(&voxels)]
                    .copy_from_slice(bytemuck::cast_slice(&voxels));
                hashes[place * 16..][..16].copy_from_slice(&layer.hashes[at].to_le_bytes());
            }
        }
        (ranges, hashes)
    }
}

/// Fingerprints of the shards of a stage, or of its aprons, under way to pages. They come layer by layer.
pub(crate) struct ShardPages {
    array: SideArray,
    grid: Extent,
    /// The fingerprints of the current row of pages, x fastest.
    row: Vec<Fingerprint>,
    /// The number of them set so far.
    known: usize,
}

impl ShardPages {
    pub(crate) fn new(store: &Path, layout: &Layout, level: Level) -> Self {
        let array = SideArray::fingerprints(store, layout, level);
        Self { array, grid: layout.shard_grid(level), row: Vec::new(), known: 0 }
    }

    /// Adds the fingerprint of a finished shard. Appends completed pages to `out`.
    pub(crate) fn add(&mut self, id: ShardId, fingerprint: Fingerprint, out: &mut Vec<PageFile>) {
        let paging = self.array.paging();
        let depth = paging.page_extent().z;
        let first = id.z / depth * depth;
        let layers = (self.grid.z - first).min(depth);
        let slab = Extent::new(self.grid.x, self.grid.y, layers);
        self.row.resize(slab.volume() as usize, Fingerprint::default());
        self.row[slab.linear([id.x, id.y, id.z - first]) as usize] = fingerprint;
        self.known += 1;
        if self.known < self.row.len() {
            return;
        }
        let grid = paging.page_grid();
        for (y, x) in (0..grid.y).flat_map(|y| (0..grid.x).map(move |x| (y, x))) {
            let page = PageId { time: id.group, channel: id.channel, level: id.level, z: id.z / depth, y, x };
            let mut fingerprints = vec![Fingerprint::default(); paging.page_cells()];
            let cells = paging.cells([x, y, page.z]);
            for shard in crate::store::bricks_of(cells, 1) {
                let at = slab.linear([shard.x, shard.y, shard.z - first]) as usize;
                fingerprints[paging.locate(shard.to_array()).1] = self.row[at];
            }
            out.push(self.array.page_file(page, bytemuck::cast_slice(&fingerprints)));
        }
        self.row.clear();
        self.known = 0;
    }
}
