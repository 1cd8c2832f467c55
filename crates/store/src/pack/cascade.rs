//! The streaming pass: layers of bricks, level 0 in z order, each coarser level's as soon as its slices are there.
//!
//! ```text
//! source ──► workers (one brick each) ──► sequence ──► writer ──► shard files ──► settler (sync, rename, journal)
//!               ▲        │ coarse part                   └─► statistics
//!               └── windows[k + 1] ◄┘
//! ```
//!
//! Layers are barriers: a window is written by one layer and read by a later one, never both at once.

use crate::codec::{BrickCodec, Scratch};
use crate::layout::Layout;
use crate::metadata::ChannelStatistics;
use crate::pack::brick::{Cut, Summary, Workspace, run_length};
use crate::pack::disk::{Disk, DiskError};
use crate::pack::journal::Journal;
use crate::pack::parts::directions;
use crate::pack::plan::{PackPlan, WindowPlan, bricks_ahead};
use crate::pack::sequence::Sequence;
use crate::pack::shards::{Finished, ShardWriter, settle};
use crate::pack::window::Window;
use crate::pack::{PackError, PackOptions, Progress};
use crate::shard::Fingerprint;
use crate::side::SideData;
use crate::stats::{ChannelTotals, Measure, Range, Tally, occupancy_bins};
use brickyard_import::{Access, ImportError, Source};
use brickyard_volume::{BrickId, BrickIndex, Level, LevelGrid, Occupancy, OccupancyBins, VoxelBox};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError, RwLock, mpsc};

/// What a whole pass leaves besides the shards.
pub(crate) struct Passed {
    pub(crate) sides: Vec<SideData>,
    pub(crate) channels: Vec<ChannelStatistics>,
    pub(crate) bins: OccupancyBins,
    pub(crate) written_bytes: u64,
}

/// What stopped a pass.
pub(crate) enum Stop {
    Disk(DiskError),
    Source(ImportError),
    Threads(String),
}

/// How far a pass came: for messages when it stops.
#[derive(Default)]
pub(crate) struct Reached {
    pub(crate) shards: u64,
    pub(crate) written_bytes: u64,
    /// Level-0 voxels written.
    pub(crate) voxels: u64,
}

/// Everything about a pass that does not change while it runs.
pub(crate) struct Pass<'a> {
    pub(crate) source: &'a dyn Source,
    pub(crate) store: &'a Path,
    pub(crate) options: &'a PackOptions,
    pub(crate) plan: &'a PackPlan,
    pub(crate) disk: &'a Disk,
    pub(crate) progress: &'a dyn Progress,
}

/// A brick on its way to the writer.
struct Packed<T> {
    id: BrickId,
    summary: Summary<T>,
    voxels: u64,
    /// `None` if it is all fill, or its shard is there already.
    encoded: Option<Vec<u8>>,
}

/// One thread's state.
struct Worker<T> {
    workspace: Workspace<T>,
    scratch: Scratch,
}

/// What the workers share.
struct Shared<'a, T> {
    pass: &'a Pass<'a>,
    codec: BrickCodec,
    workers: Vec<Mutex<Worker<T>>>,
    sequence: Sequence<Packed<T>>,
    finished_before: &'a (dyn Fn(BrickId) -> Option<Fingerprint> + Sync),
    /// Buffers of written bricks, to be used again.
    spare: Mutex<Vec<Vec<u8>>>,
    stop: Mutex<Option<Stop>>,
}

fn lock<T>(mutex: &Mutex<T>) -> std::sync::MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl<T> Shared<'_, T> {
    /// Stops everyone; the first reason counts.
    fn fail(&self, reason: Stop) {
        lock(&self.stop).get_or_insert(reason);
        self.sequence.abort();
    }
}

impl Pass<'_> {
    /// Packs all volumes. On failure what is finished stays, noted in the journal.
    pub(crate) fn run<T: Measure>(&self, journal: &mut Journal) -> Result<Passed, (Stop, Reached)> {
        let layout = &self.plan.layout;
        let threads = self.options.threads;
        let edge = self.options.edge as usize;
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
        let pool = pool.map_err(|e| (Stop::Threads(e.to_string()), Reached::default()))?;
        let earlier: std::collections::HashMap<_, _> = (0..layout.pyramid.levels().len())
            .flat_map(|k| layout.shards(Level(k as u8)))
            .filter_map(|shard| Some((shard, journal.finished(layout, shard)?)))
            .collect();
        let finished_before = |id: BrickId| earlier.get(&layout.shard_of(id).0).copied();
        let worker = || Mutex::new(Worker { workspace: Workspace::<T>::new(edge), scratch: Scratch::default() });
        let shared = Shared {
            pass: self,
            codec: BrickCodec::new(self.options.codec, T::TYPE, self.options.edge),
            workers: (0..threads).map(|_| worker()).collect(),
            sequence: Sequence::new(bricks_ahead(threads)),
            finished_before: &finished_before,
            spare: Mutex::default(),
            stop: Mutex::default(),
        };
        let mut reached = Reached { shards: journal.finished_count(), ..Reached::default() };
        let mut channels: Vec<_> = (0..layout.channels).map(|_| ChannelTotals::new(T::TYPE)).collect();
        let statistics = std::thread::scope(|scope| {
            let (to_settler, finished) = mpsc::channel();
            let writer = scope.spawn(|| shared.write(to_settler, &mut reached));
            let settler = scope.spawn(|| shared.settle(finished, journal));
            if let Err(stop) = shared.stream(&pool, &mut channels) {
                shared.fail(stop);
            }
            shared.sequence.close();
            let statistics = writer.join();
            let settled = settler.join();
            statistics.and_then(|s| settled.map(|shards| (s, shards)))
        });
        let (statistics, settled_shards) = statistics.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
        if let Some(stop) = shared.stop.into_inner().unwrap_or_else(PoisonError::into_inner) {
            reached.shards += settled_shards;
            return Err((stop, reached));
        }
        let bins = occupancy_bins(T::TYPE, channels_with_ranges(&mut channels, &statistics));
        let sides = statistics.finish(self.plan, bins);
        let channels = channels.iter().map(ChannelTotals::finish).collect();
        Ok(Passed { sides, channels, bins, written_bytes: reached.written_bytes })
    }
}

/// Puts what only the writer saw, in order, into the channels.
fn channels_with_ranges<'a, T: Measure>(
    channels: &'a mut [ChannelTotals],
    statistics: &Statistics<T>,
) -> &'a [ChannelTotals] {
    for (channel, seen) in channels.iter_mut().zip(&statistics.channels) {
        channel.add_range(seen.0.to_f64());
        channel.add_tally(&seen.1);
    }
    channels
}

impl<T: Measure> Shared<'_, T> {
    /// Feeds the workers, volume by volume, layer by layer.
    fn stream(&self, pool: &rayon::ThreadPool, channels: &mut [ChannelTotals]) -> Result<(), Stop> {
        let layout = &self.pass.plan.layout;
        let mut number = 0;
        for time in 0..layout.times {
            for channel in 0..layout.channels {
                let windows = self.windows().map_err(Stop::Disk)?;
                let mut volume = Volume { shared: self, pool, time, channel, windows, number };
                volume.stream()?;
                number = volume.number;
                for worker in &self.workers {
                    lock(worker).workspace.counter.drain_into(&mut channels[channel as usize]);
                }
                if self.sequence.is_aborted() {
                    return Ok(());
                }
            }
        }
        Ok(())
    }

    fn windows(&self) -> Result<Vec<RwLock<Window>>, DiskError> {
        let Pass { plan, store, .. } = *self.pass;
        let levels = plan.layout.pyramid.levels().iter();
        let window = |(level, window): (&LevelGrid, &WindowPlan)| {
            let scratch = (!window.in_memory).then_some(store);
            Window::new(level.extent, size_of::<T>(), window.capacity, scratch)
                .map(RwLock::new)
                .map_err(|error| DiskError { path: store.into(), error })
        };
        levels.zip(&plan.windows).map(window).collect()
    }

    /// The writer: shards and statistics, brick by brick in order.
    fn write(&self, to_settler: mpsc::Sender<Finished>, reached: &mut Reached) -> Statistics<T> {
        let Pass { plan, store, disk, progress, .. } = *self.pass;
        let layout = &plan.layout;
        let volumes = layout.times as u64 * layout.channels as u64;
        let total = volumes * layout.pyramid.levels()[0].extent.volume();
        let mut statistics = Statistics::new(plan);
        let mut shards = ShardWriter::new(disk, store, layout);
        while let Some(brick) = self.sequence.take() {
            statistics.add(layout, &brick);
            let done_before = |_| (self.finished_before)(brick.id);
            match shards.add(brick.id, brick.encoded.as_deref(), done_before) {
                Ok(Some(finished)) => {
                    statistics.sides[brick.id.level.index()].shards[layout.shard_place(finished.id)] =
                        finished.fingerprint;
                    // The settler is gone only after it failed, which stops the sequence.
                    let _ = to_settler.send(finished);
                }
                Ok(None) => {}
                Err(error) => self.fail(Stop::Disk(error)),
            }
            reached.written_bytes = shards.written_bytes;
            if brick.id.level == Level(0) {
                reached.voxels += brick.voxels;
                progress.advanced(reached.voxels, total);
            }
            if let Some(mut buffer) = brick.encoded {
                buffer.clear();
                lock(&self.spare).push(buffer);
            }
        }
        statistics
    }

    /// The settler: makes shards last. Returns how many.
    fn settle(&self, finished: mpsc::Receiver<Finished>, journal: &mut Journal) -> u64 {
        let Pass { plan, store, disk, .. } = *self.pass;
        let mut settled = 0;
        for shard in finished {
            match settle(disk, store, &plan.layout, journal, &shard) {
                Ok(made) => settled += made as u64,
                Err(error) => {
                    self.fail(Stop::Disk(error));
                    break;
                }
            }
        }
        settled
    }
}

/// One time step of one channel on its way.
struct Volume<'a, T> {
    shared: &'a Shared<'a, T>,
    pool: &'a rayon::ThreadPool,
    time: u32,
    channel: u32,
    windows: Vec<RwLock<Window>>,
    /// Of the next brick in the sequence.
    number: u64,
}

impl<T: Measure> Volume<'_, T> {
    fn stream(&mut self) -> Result<(), Stop> {
        if self.by_planes() {
            self.read_planes(self.slices_for(0, 0)).map_err(Stop::Source)?;
        }
        let mut next_layer = vec![0; self.windows.len()];
        while next_layer[0] < self.layers(0) && !self.shared.sequence.is_aborted() {
            self.advance(0, &mut next_layer)?;
        }
        Ok(())
    }

    /// Packs a level's next layer, and then all that it makes possible on coarser levels: at once, since their windows
    /// hold no more than they need.
    fn advance(&mut self, k: usize, next_layer: &mut [u32]) -> Result<(), Stop> {
        self.layer(k, next_layer[k])?;
        next_layer[k] += 1;
        let coarser = k + 1;
        while coarser < next_layer.len()
            && next_layer[coarser] < self.layers(coarser)
            && self.filled(coarser) >= self.slices_for(coarser, next_layer[coarser])
        {
            self.advance(coarser, next_layer)?;
        }
        Ok(())
    }

    /// Layers of bricks of a level.
    fn layers(&self, k: usize) -> u32 {
        self.shared.pass.plan.layout.pyramid.levels()[k].bricks.z
    }

    fn by_planes(&self) -> bool {
        self.shared.pass.source.access() == Access::Planes
    }

    fn filled(&self, k: usize) -> u32 {
        self.windows[k].read().unwrap_or_else(PoisonError::into_inner).filled
    }

    /// Slices that must have been made before a layer can be packed.
    fn slices_for(&self, k: usize, layer: u32) -> u32 {
        let pyramid = &self.shared.pass.plan.layout.pyramid;
        let end = (layer as u64 + 1) * pyramid.edge() as u64;
        end.min(pyramid.levels()[k].extent.z as u64) as u32
    }

    /// Decodes the source's planes up to `end` into level 0's window.
    fn read_planes(&self, end: u32) -> Result<(), ImportError> {
        let extent = self.shared.pass.source.info().extent;
        let first = self.filled(0);
        let mut plane = vec![0; if first < end { extent.x as usize * extent.y as usize * size_of::<T>() } else { 0 }];
        for z in first..end {
            if self.shared.sequence.is_aborted() {
                break;
            }
            let region = VoxelBox::new([0, 0, z], [extent.x, extent.y, z + 1]);
            self.shared.pass.source.read_box(self.time, self.channel, region, &mut plane)?;
            let mut window = self.windows[0].write().unwrap_or_else(PoisonError::into_inner);
            window.write_box(region, &plane);
            window.filled = z + 1;
        }
        Ok(())
    }

    /// Packs one layer of bricks; meanwhile reads the planes of the next.
    fn layer(&mut self, k: usize, layer: u32) -> Result<(), Stop> {
        let (runs, bricks) = self.runs(k, layer);
        let first_number = self.number;
        self.number += bricks;
        let next = AtomicUsize::new(0);
        let this = &*self;
        if k == 0 {
            this.announce(0, layer);
        }
        let work = || {
            this.pool.broadcast(|context| {
                let worker = &mut *lock(&this.shared.workers[context.index()]);
                loop {
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    let Some(run) = runs.get(i) else { break };
                    if !this.run(worker, k, run, first_number) {
                        break;
                    }
                }
            });
        };
        if k == 0 && this.by_planes() {
            let end = this.slices_for(0, layer + 1);
            std::thread::scope(|scope| {
                let reader = scope.spawn(|| this.read_planes(end));
                work();
                reader.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            })
            .map_err(Stop::Source)?;
        } else {
            work();
        }
        if let Some(coarse) = self.windows.get(k + 1) {
            let pyramid = &self.shared.pass.plan.layout.pyramid;
            let (fine, level) = (pyramid.levels()[k], pyramid.levels()[k + 1]);
            let made = (layer + 1) * pyramid.edge() / (level.factor[2] / fine.factor[2]);
            coarse.write().unwrap_or_else(PoisonError::into_inner).filled = made.min(level.extent.z);
        }
        Ok(())
    }

    /// A layer's bricks, shard by shard, each shard's in the order of its index; in runs, and how many.
    fn runs(&self, k: usize, layer: u32) -> (Vec<Run>, u64) {
        let layout = &self.shared.pass.plan.layout;
        let grid = layout.pyramid.levels()[k].bricks;
        let shard = layout.shard_bricks(Level(k as u8));
        let longest = run_length(layout.pyramid.edge() as usize, size_of::<T>());
        let (mut runs, mut number) = (Vec::new(), 0);
        for shard_y in (0..grid.y).step_by(shard.y as usize) {
            for shard_x in (0..grid.x).step_by(shard.x as usize) {
                let end_x = (shard_x + shard.x).min(grid.x);
                for y in shard_y..(shard_y + shard.y).min(grid.y) {
                    for x in (shard_x..end_x).step_by(longest) {
                        let count = (end_x - x).min(longest as u32);
                        runs.push(Run { first: BrickIndex::new(x, y, layer), count, number });
                        number += count as u64;
                    }
                }
            }
        }
        (runs, number)
    }

    /// Tells the source that a row of level-0 bricks, all along x, will be read.
    fn announce(&self, y: u32, z: u32) {
        let Pass { source, plan, .. } = *self.shared.pass;
        let (extent, edge) = (plan.layout.pyramid.levels()[0].extent, plan.layout.pyramid.edge());
        let [from, to] = [0, 1].map(|n| [y, z].map(|i| i.saturating_add(n).saturating_mul(edge)));
        let row = VoxelBox::new([0, from[0], from[1]], [extent.x, to[0], to[1]]).intersect(extent.full_box());
        if !row.is_empty() {
            source.announce(self.time, self.channel, row);
        }
    }

    /// Packs a run of bricks. False once the pass is to stop.
    fn run(&self, worker: &mut Worker<T>, k: usize, run: &Run, first_number: u64) -> bool {
        if k == 0 && run.first.x == 0 {
            self.announce(run.first.y + 1, run.first.z);
        }
        let gathered = self.gather(&mut worker.workspace, k, run);
        (0..run.count).all(|i| {
            let (index, number) = (run.brick(i), first_number + run.number + i as u64);
            if gathered {
                return self.brick(worker, k, index, i as usize, None, number);
            }
            match self.read(&mut worker.workspace, index) {
                Ok(constant) => self.brick(worker, k, index, 0, constant, number),
                Err(error) => {
                    self.shared.fail(Stop::Source(error));
                    false
                }
            }
        })
    }

    /// Packs core `i` of the workspace, which is brick `index`; every voxel of it is `constant`, if given.
    fn brick(
        &self,
        worker: &mut Worker<T>,
        k: usize,
        index: BrickIndex,
        i: usize,
        constant: Option<T>,
        number: u64,
    ) -> bool {
        let shared = self.shared;
        let Pass { options, plan, .. } = *shared.pass;
        let pyramid = &plan.layout.pyramid;
        let id = BrickId { time: self.time, channel: self.channel, level: Level(k as u8), index };
        let core = pyramid.brick_box(id.level, index);
        let coarser = pyramid.levels().get(k + 1);
        let fine = pyramid.level(id.level).factor;
        let factor = coarser.map(|c| std::array::from_fn(|a| (c.factor[a] / fine[a]) as usize));
        let cut = Cut { shape: shape(core), factor };
        let workspace = &mut worker.workspace;
        let summary = match constant {
            Some(value) => workspace.digest_constant(i, &cut, value),
            None => workspace.digest(i, &cut, options.downsample, k == 0),
        };
        if let Some(factor) = factor {
            let region = coarse_box(core, factor);
            let coarse = bytemuck::cast_slice(&workspace.coarse[..region.extent().volume() as usize]);
            self.windows[k + 1].write().unwrap_or_else(PoisonError::into_inner).write_box(region, coarse);
        }
        let encoded = (!summary.is_fill && (shared.finished_before)(id).is_none()).then(|| {
            let mut encoded = lock(&shared.spare).pop().unwrap_or_default();
            shared.codec.encode(&mut worker.scratch, bytemuck::cast_slice(workspace.core(i)), &mut encoded);
            encoded
        });
        shared.sequence.put(number, Packed { id, summary, voxels: cut.voxels() as u64, encoded })
    }

    /// Fetches the cores of a run from where they lie in memory, if they do.
    fn gather(&self, workspace: &mut Workspace<T>, k: usize, run: &Run) -> bool {
        let pyramid = &self.shared.pass.plan.layout.pyramid;
        let [first, last] = [0, run.count - 1].map(|i| pyramid.brick_box(Level(k as u8), run.brick(i)));
        let region = VoxelBox { min: first.min, max: last.max };
        if k > 0 || self.by_planes() {
            let window = self.windows[k].read().unwrap_or_else(PoisonError::into_inner);
            workspace.gather(window.lend(region), shape(region));
            return true;
        }
        let lent = self.shared.pass.source.lend(self.time, self.channel, region);
        lent.map(|lent| workspace.gather(lent, shape(region))).is_some()
    }

    /// Reads a brick of level 0 to core 0, unless the source knows that it is constant.
    fn read(&self, workspace: &mut Workspace<T>, index: BrickIndex) -> Result<Option<T>, ImportError> {
        let Pass { source, plan, .. } = *self.shared.pass;
        let region = plan.layout.pyramid.brick_box(Level(0), index);
        let constant = source.constant_in(self.time, self.channel, region).map(T::from_f64_rounded);
        if let Some(value) = constant.filter(|v| v.is_valid()) {
            return Ok(Some(value));
        }
        let packed = &mut workspace.core_mut(0)[..region.extent().volume() as usize];
        source.read_box(self.time, self.channel, region, bytemuck::cast_slice_mut(packed))?;
        workspace.spread(0, shape(region));
        Ok(None)
    }
}

/// Bricks side by side along x.
struct Run {
    first: BrickIndex,
    count: u32,
    /// Of the first one, in its layer.
    number: u64,
}

impl Run {
    fn brick(&self, i: u32) -> BrickIndex {
        BrickIndex { x: self.first.x + i, ..self.first }
    }
}

fn shape(region: VoxelBox) -> [usize; 3] {
    region.extent().to_array().map(|n| n as usize)
}

/// What a brick's core becomes on the next level.
fn coarse_box(core: VoxelBox, factor: [usize; 3]) -> VoxelBox {
    let (min, max) = (core.min.to_array(), core.max.to_array());
    VoxelBox::new(
        std::array::from_fn(|a| min[a] / factor[a] as u32),
        std::array::from_fn(|a| max[a].div_ceil(factor[a] as u32)),
    )
}

/// What the writer collects.
struct Statistics<T> {
    sides: Vec<SideData>,
    /// Per level and brick, the range of the brick and one voxel around it.
    reach: Vec<Vec<Range<T>>>,
    core: Vec<Vec<Range<T>>>,
    /// Per channel, of level 0.
    channels: Vec<(Range<T>, Tally)>,
}

impl<T: Measure> Statistics<T> {
    fn new(plan: &PackPlan) -> Self {
        let layout = &plan.layout;
        let levels = || (0..layout.pyramid.levels().len()).map(|k| Level(k as u8));
        let sides: Vec<_> = levels().map(|level| SideData::new(layout, level, T::TYPE)).collect();
        let empty: Vec<_> = sides.iter().map(|side| vec![T::EMPTY; side.occupancy.len()]).collect();
        let channels = vec![(T::EMPTY, Default::default()); layout.channels as usize];
        Self { sides, reach: empty.clone(), core: empty, channels }
    }

    fn add(&mut self, layout: &Layout, brick: &Packed<T>) {
        let k = brick.id.level.index();
        let whole = brick.summary.parts.whole();
        self.core[k][layout.brick_place(brick.id)] = whole;
        let (index, bricks) = (brick.id.index.to_array(), layout.pyramid.levels()[k].bricks.to_array());
        for d in directions() {
            let neighbour: [_; 3] =
                std::array::from_fn(|a| index[a].checked_add_signed(d[a]).filter(|&i| i < bricks[a]));
            if let [Some(x), Some(y), Some(z)] = neighbour {
                let neighbour = BrickId { index: BrickIndex::new(x, y, z), ..brick.id };
                let reach = &mut self.reach[k][layout.brick_place(neighbour)];
                *reach = reach.join(brick.summary.parts.toward(d));
            }
        }
        if k == 0 {
            let channel = &mut self.channels[brick.id.channel as usize];
            channel.0 = channel.0.join(whole);
            channel.1.add(&brick.summary.tally);
        }
    }

    /// The side data: parents' ranges cover their children's; ranges become masks.
    fn finish(mut self, plan: &PackPlan, bins: OccupancyBins) -> Vec<SideData> {
        let layout = &plan.layout;
        for k in 0..self.sides.len() {
            self.cover_children(layout, Level(k as u8));
            for place in 0..self.reach[k].len() {
                let mask = self.reach[k][place].to_f64().map_or(Occupancy::NONE, |(low, high)| bins.mask(low, high));
                self.sides[k].occupancy[place] = mask;
                let core = self.core[k][place];
                let [low, high] = if core.is_empty() { [T::INVALID; 2] } else { [core.low, core.high] };
                let bytes = self.sides[k].minmax_bytes_mut(place);
                let (first, second) = bytes.split_at_mut(size_of::<T>());
                first.copy_from_slice(bytemuck::bytes_of(&low));
                second.copy_from_slice(bytemuck::bytes_of(&high));
            }
        }
        self.sides
    }

    fn cover_children(&mut self, layout: &Layout, level: Level) {
        if level == Level(0) {
            return;
        }
        let k = level.index();
        let grid = layout.pyramid.level(level).bricks;
        for (time, channel) in (0..layout.times).flat_map(|t| (0..layout.channels).map(move |c| (t, c))) {
            for i in 0..grid.volume() {
                let (x, y) = (i % grid.x as u64, i / grid.x as u64 % grid.y as u64);
                let index = BrickIndex::new(x as u32, y as u32, (i / grid.x as u64 / grid.y as u64) as u32);
                let place = layout.brick_place(BrickId { time, channel, level, index });
                for child in layout.pyramid.children(level, index) {
                    let child = BrickId { time, channel, level: Level(level.0 - 1), index: child };
                    let child = layout.brick_place(child);
                    self.reach[k][place] = self.reach[k][place].join(self.reach[k - 1][child]);
                    self.core[k][place] = self.core[k][place].join(self.core[k - 1][child]);
                }
            }
        }
    }
}

impl From<DiskError> for PackError {
    fn from(DiskError { path, error }: DiskError) -> Self {
        PackError::Io { path, error }
    }
}
