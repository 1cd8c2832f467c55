//! The streaming pass: layers of bricks, level 0 in z order, each coarser level as soon as its slices are complete.
//!
//! ```text
//! source ──► workers (one brick each) ──► sequence ──► writer ──► shard files ──► settler (rename, journal, sync)
//!               ▲        │ coarse part                   └─► side data ──► pages ──┘
//!               └── coarser windows ◄┘
//! ```
//!
//! A *stage* is one level of one pyramid; level 0 yields a coarse part for the next stage of each.
//!
//! Layers are barriers: a window is written by one layer and read by a later one, never both at once. While a layer of level 0 is
//! packed from its window, a thread reads the planes of the next into another.
//!
//! A panicking thread (usually the source's fault) stops the sequence as it unwinds, so the others end too; its message
//! becomes the reason for stopping.

use crate::codec::BrickCodec;
use crate::error::ReadError;
use crate::kind::Kind;
use crate::layout::ShardId;
use crate::mutex::lock;
use crate::pack::brick::{Summary, Workspace, run_length};
use crate::pack::disk::{Disk, DiskError};
use crate::pack::journal::Journal;
use crate::pack::plan::{PackPlan, Stage, bricks_ahead};
use crate::pack::sequence::Sequence;
use crate::pack::shards::{Encoded, Finished, ShardWriter};
use crate::pack::side_pages::{BrickPages, ShardPages};
use crate::pack::window::Window;
use crate::pack::{PackError, PackOptions, Progress, pool};
use crate::scratch::Scratch;
use crate::shard::Fingerprint;
use crate::side::{PageFile, core_hash};
use crate::stats::{ChannelTotals, Measure, Range, Tally};
use brickyard_import::{Access, ImportError, Source};
use brickyard_volume::{BrickId, BrickIndex, Level, LevelGrid, VoxelBox};
use std::collections::HashMap;
use std::fmt;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Mutex, PoisonError, RwLock, mpsc};

/// Results of a pass besides its files.
pub(crate) struct Passed {
    pub(crate) channels: Vec<ChannelTotals>,
    pub(crate) written_bytes: u64,
}

/// Why a pass stopped.
pub(crate) enum Stop {
    Disk(DiskError),
    Source(ImportError),
    /// The pass cannot read back its own output.
    ReadBack(ReadError),
    Threads(String),
    /// A voxel of labels is between two of them.
    Fraction(Fraction),
    /// The observer of the pack cancelled it.
    Cancelled,
    /// A thread panicked with this message.
    Panic(String),
}

/// A voxel that is no label.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Fraction {
    pub(crate) time: u32,
    pub(crate) channel: u32,
    /// Its place in level 0, `[x, y, z]`.
    pub(crate) place: [u32; 3],
    pub(crate) value: f64,
}

impl fmt::Display for Fraction {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { time, channel, place: [x, y, z], value } = self;
        write!(f, "at {x},{y},{z} (x, y, z) of time step {time}, channel {channel} is {value}")
    }
}

impl From<Fraction> for PackError {
    fn from(fraction: Fraction) -> Self {
        let (found, expected) = (fraction.to_string(), "whole numbers".into());
        Self::Unfit { what: "label", found, expected, cure: "pack it as an image, with `kind` image" }
    }
}

impl Stop {
    pub(crate) fn panic(payload: Box<dyn std::any::Any + Send>) -> Self {
        let words = payload.downcast_ref::<&str>().map(|words| words.to_string());
        Self::Panic(words.or_else(|| payload.downcast_ref::<String>().cloned()).unwrap_or_default())
    }
}

/// The state of a stopped pack, for the message.
pub(crate) struct Reached {
    pub(crate) shards: u64,
    /// Estimate of the bytes still to be written.
    pub(crate) needed_bytes: u64,
}

impl Reached {
    /// The state after turning `done_bytes` of voxels into `written_bytes`, with `left_bytes` of voxels to come.
    pub(crate) fn new(shards: u64, written_bytes: u64, done_bytes: u64, left_bytes: u64) -> Self {
        // By the compression so far, or by half if nothing is known.
        let rate = if written_bytes == 0 { 0.5 } else { written_bytes as f64 / done_bytes.max(1) as f64 };
        Self { shards, needed_bytes: (rate * left_bytes as f64) as u64 + (1 << 20) }
    }
}

/// The end of a stopped pass.
pub(crate) type Stopped = (Stop, Reached);

/// The writer's progress.
#[derive(Default)]
struct Written {
    bytes: u64,
    /// Voxels of level 0.
    voxels: u64,
}

/// Constants of a pass.
pub(crate) struct Pass<'a> {
    pub(crate) source: &'a dyn Source,
    pub(crate) store: &'a Path,
    pub(crate) options: &'a PackOptions,
    pub(crate) plan: &'a PackPlan,
    pub(crate) disk: &'a Disk,
    pub(crate) progress: &'a dyn Progress,
}

/// A brick under way to the writer.
struct Packed<T> {
    stage: usize,
    id: BrickId,
    summary: Summary<T>,
    voxels: u64,
    /// Its first voxel that is no label, if all should be.
    fraction: Option<Fraction>,
    /// The hash of the decoded core; `None` if it is all fill.
    hash: Option<u128>,
    /// `None` if it is all fill, or its shard already exists.
    encoded: Option<Vec<u8>>,
}

/// Work of the settler, in order.
enum Settle {
    /// A stage's shard.
    Shard(usize, Finished),
    /// A page of side data.
    Page(PageFile),
}

/// Most shards and pages waiting for the settler: some 2 MiB.
const MOST_UNSETTLED: usize = 32;

/// One thread's state.
struct Worker<T> {
    workspace: Workspace<T>,
    scratch: Scratch,
}

/// State shared by the workers.
struct Shared<'a, T> {
    pass: &'a Pass<'a>,
    /// The source's no-data value of floats, to become NaN.
    blanked: Option<T>,
    codec: BrickCodec,
    workers: Vec<Mutex<Worker<T>>>,
    sequence: Sequence<Packed<T>>,
    /// Per stage, the shards finished by earlier runs.
    earlier: Vec<HashMap<ShardId, Fingerprint>>,
    /// Buffers of written bricks, for reuse.
    spare: Mutex<Vec<Vec<u8>>>,
    stop: Mutex<Option<Stop>>,
}

impl<T> Shared<'_, T> {
    /// Stops everyone; the first reason counts.
    fn fail(&self, reason: Stop) {
        lock(&self.stop).get_or_insert(reason);
        self.sequence.abort();
    }

    /// Whether the pack was cancelled; if so, stops everyone.
    fn is_cancelled(&self) -> bool {
        let is_cancelled = self.pass.progress.is_cancelled();
        if is_cancelled {
            self.fail(Stop::Cancelled);
        }
        is_cancelled
    }
}

impl Pass<'_> {
    /// Packs all channels of the plan's time steps, and adds their voxels to the totals. On failure, finished shards
    /// stay and are in the journal.
    pub(crate) fn run<T: Measure>(
        &self,
        journal: &mut Journal,
        mut channels: Vec<ChannelTotals>,
    ) -> Result<Passed, Stopped> {
        let threads = self.options.threads;
        let edge = self.options.edge as usize;
        let mut written = Written::default();
        let pool = pool(threads).map_err(|error| (Stop::Threads(error), self.reached(0, &written)))?;
        let earlier = |stage: &Stage| {
            let finished = |shard| Some((shard, journal.finished(&stage.layout, shard)?));
            self.plan.shards(&stage.layout, stage.level).filter_map(finished).collect()
        };
        let (kept, blanked) = no_data(self.source.info().sought_nodata());
        let worker = || Mutex::new(Worker { workspace: Workspace::<T>::new(edge, kept), scratch: Scratch::default() });
        let shared = Shared {
            pass: self,
            blanked,
            codec: BrickCodec::new(self.options.codec, T::TYPE, self.options.edge),
            workers: (0..threads).map(|_| worker()).collect(),
            sequence: Sequence::new(bricks_ahead(threads)),
            earlier: self.plan.stages.iter().map(earlier).collect(),
            spare: Mutex::default(),
            stop: Mutex::default(),
        };
        let earlier_shards = journal.finished_count();
        let (statistics, settled_shards) = std::thread::scope(|scope| {
            let (to_settler, finished) = mpsc::sync_channel(MOST_UNSETTLED);
            let writer = scope.spawn(|| {
                let _stop = shared.sequence.stop_on_panic();
                shared.write(to_settler, &mut written)
            });
            let settler = scope.spawn(|| {
                let _stop = shared.sequence.stop_on_panic();
                shared.settle(finished, journal)
            });
            let streamed = catch_unwind(AssertUnwindSafe(|| shared.stream(&pool, &mut channels)));
            if let Err(stop) = streamed.unwrap_or_else(|panic| Err(Stop::panic(panic))) {
                shared.fail(stop);
            }
            shared.sequence.close();
            let ended = |panic| shared.fail(Stop::panic(panic));
            (writer.join().map_err(ended).ok(), settler.join().map_err(ended).unwrap_or(0))
        });
        if let Some(stop) = shared.stop.into_inner().unwrap_or_else(PoisonError::into_inner) {
            return Err((stop, self.reached(earlier_shards + settled_shards, &written)));
        }
        let Some(statistics) = statistics else { unreachable!("a writer that panics stops the pass") };
        for (channel, seen) in channels.iter_mut().zip(&statistics) {
            channel.add_range(seen.0.to_f64());
            channel.add_tally(&seen.1);
        }
        Ok(Passed { channels, written_bytes: written.bytes })
    }

    fn reached(&self, shards: u64, written: &Written) -> Reached {
        let cores = self.plan.output_bytes_at_most - self.plan.apron_bytes;
        let done = (cores as f64 * written.voxels as f64 / self.plan.input_voxels() as f64) as u64;
        Reached::new(shards, written.bytes, done, self.plan.output_bytes_at_most - done)
    }
}

impl<T: Measure> Shared<'_, T> {
    /// Feeds the workers, volume by volume, layer by layer.
    fn stream(&self, pool: &rayon::ThreadPool, channels: &mut [ChannelTotals]) -> Result<(), Stop> {
        let layout = &self.pass.plan.layout;
        let mut number = 0;
        for time in self.pass.plan.steps.clone() {
            for channel in 0..layout.channels {
                let windows = self.windows().map_err(Stop::Disk)?;
                let ahead = self.window_ahead().map_err(Stop::Disk)?;
                let mut volume = Volume { shared: self, pool, time, channel, windows, ahead, number };
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

    /// A window of each stage.
    fn windows(&self) -> Result<Vec<RwLock<Window>>, DiskError> {
        self.pass.plan.stages.iter().map(|stage| self.window(stage).map(RwLock::new)).collect()
    }

    /// The second window of level 0; `None` if it has no next layer of planes.
    fn window_ahead(&self) -> Result<Option<Window>, DiskError> {
        let stage = &self.pass.plan.stages[0];
        (stage.window.layers > 1).then(|| self.window(stage)).transpose()
    }

    fn window(&self, stage: &Stage) -> Result<Window, DiskError> {
        let store = self.pass.store;
        let scratch = (!stage.window.in_memory).then_some(store);
        let edge = if stage.window.layers == 0 { 0 } else { stage.layout.pyramid.edge() };
        Window::new(stage.grid().extent, size_of::<T>(), edge, scratch)
            .map_err(|error| DiskError { path: store.into(), error })
    }

    /// The writer: shards and statistics in brick order. Returns each channel's range and tally of level 0.
    fn write(&self, to_settler: mpsc::SyncSender<Settle>, written: &mut Written) -> Vec<(Range<T>, Tally)> {
        let Pass { plan, store, disk, progress, .. } = *self.pass;
        let total = plan.input_voxels();
        let mut channels = vec![(T::EMPTY, Tally::default()); plan.layout.channels as usize];
        let mut brick_pages = BrickPages::new(plan, store);
        let shard_pages = |stage: &Stage| ShardPages::new(store, &stage.layout, stage.level);
        let mut shard_pages: Vec<_> = plan.stages.iter().map(shard_pages).collect();
        let mut writers: Vec<_> =
            plan.stages.iter().map(|stage| ShardWriter::new(disk, store, &stage.layout)).collect();
        let mut pages = Vec::new();
        while let Some(brick) = self.sequence.take() {
            let s = brick.stage;
            // The first in this order, whatever the threads'.
            if let Some(fraction) = brick.fraction {
                self.fail(Stop::Fraction(fraction));
                break;
            }
            brick_pages.add(s, brick.id, &brick.summary.parts, brick.hash, &mut pages);
            let done_before = |shard| self.earlier[s].get(&shard).copied();
            let encoded = brick.encoded.as_deref().zip(brick.hash).map(|(bytes, hash)| Encoded { bytes, hash });
            match writers[s].add(brick.id, encoded, done_before) {
                Ok(Some(finished)) => {
                    shard_pages[s].add(finished.id, finished.fingerprint, &mut pages);
                    // The settler is gone only after a failure, which stops the sequence.
                    let _ = to_settler.send(Settle::Shard(s, finished));
                }
                Ok(None) => {}
                Err(error) => self.fail(Stop::Disk(error)),
            }
            pages.drain(..).for_each(|page| drop(to_settler.send(Settle::Page(page))));
            written.bytes = writers.iter().map(|writer| writer.written_bytes).sum();
            if s == 0 {
                let channel = &mut channels[brick.id.channel as usize];
                channel.0 = channel.0.join(brick.summary.parts.whole());
                channel.1.add(&brick.summary.tally);
                written.voxels += brick.voxels;
                progress.advanced(written.voxels, total);
            }
            if let Some(mut buffer) = brick.encoded {
                buffer.clear();
                lock(&self.spare).push(buffer);
            }
        }
        channels
    }

    /// The settler: makes shards and pages durable. Returns the number of shards.
    fn settle(&self, finished: mpsc::Receiver<Settle>, journal: &mut Journal) -> u64 {
        let Pass { plan, disk, .. } = *self.pass;
        let mut settled = 0;
        for next in finished {
            let made = match next {
                Settle::Shard(s, shard) => {
                    journal.settle(&plan.stages[s].layout, &shard).map(|made| settled += made as u64)
                }
                Settle::Page((path, bytes)) => disk.write_early(&path, &bytes),
            };
            if let Err(error) = made {
                self.fail(Stop::Disk(error));
                break;
            }
        }
        if let Err(error) = journal.sync() {
            self.fail(Stop::Disk(error));
        }
        settled
    }
}

/// One time step of one channel under way.
struct Volume<'a, T> {
    shared: &'a Shared<'a, T>,
    pool: &'a rayon::ThreadPool,
    time: u32,
    channel: u32,
    windows: Vec<RwLock<Window>>,
    /// The window into which the planes of the next layer are read.
    ahead: Option<Window>,
    /// The number of the next brick in the sequence.
    number: u64,
}

impl<'a, T: Measure> Volume<'a, T> {
    fn plan(&self) -> &'a PackPlan {
        self.shared.pass.plan
    }

    fn stream(&mut self) -> Result<(), Stop> {
        if self.by_planes() {
            let mut window = self.windows[0].write().unwrap_or_else(PoisonError::into_inner);
            self.read_planes(&mut window, 0).map_err(Stop::Source)?;
        }
        let mut next_layer = vec![0; self.windows.len()];
        while next_layer[0] < self.layers(0) && !self.shared.sequence.is_aborted() {
            self.advance(0, &mut next_layer)?;
        }
        Ok(())
    }

    /// Packs a stage's next layer, then all it enables on coarser stages, whose windows hold no more than needed.
    fn advance(&mut self, s: usize, next_layer: &mut [u32]) -> Result<(), Stop> {
        self.layer(s, next_layer[s])?;
        next_layer[s] += 1;
        for (coarser, _) in self.plan().coarser(s) {
            while next_layer[coarser] < self.layers(coarser)
                && self.filled(coarser) >= self.slices_for(coarser, next_layer[coarser])
            {
                self.advance(coarser, next_layer)?;
            }
        }
        Ok(())
    }

    fn layers(&self, s: usize) -> u32 {
        self.plan().stages[s].grid().bricks.z
    }

    fn by_planes(&self) -> bool {
        self.shared.pass.source.access() == Access::Planes
    }

    fn filled(&self, s: usize) -> u32 {
        self.windows[s].read().unwrap_or_else(PoisonError::into_inner).filled
    }

    /// Number of slices required to pack a layer.
    fn slices_for(&self, s: usize, layer: u32) -> u32 {
        let end = (layer as u64 + 1) * self.plan().layout.pyramid.edge() as u64;
        end.min(self.plan().stages[s].grid().extent.z as u64) as u32
    }

    /// Reads the planes of a layer into a window of level 0.
    fn read_planes(&self, window: &mut Window, layer: u32) -> Result<(), ImportError> {
        let extent = self.shared.pass.source.info().extent;
        for z in layer * self.plan().layout.pyramid.edge()..self.slices_for(0, layer) {
            if self.shared.sequence.is_aborted() || self.shared.is_cancelled() {
                break;
            }
            let region = VoxelBox::new([0, 0, z], [extent.x, extent.y, z + 1]);
            self.shared.pass.source.read_box(self.time, self.channel, region, window.slice_mut(z))?;
        }
        Ok(())
    }

    /// Packs one layer of bricks; meanwhile reads the planes of the next.
    fn layer(&mut self, s: usize, layer: u32) -> Result<(), Stop> {
        let (runs, bricks) = self.runs(s, layer);
        let first_number = self.number;
        self.number += bricks;
        let next = AtomicUsize::new(0);
        let mut ahead = if s == 0 { self.ahead.take() } else { None };
        let this = &*self;
        if s == 0 {
            this.announce(0, layer);
        }
        let work = || {
            this.pool.broadcast(|context| {
                let _stop = this.shared.sequence.stop_on_panic();
                let worker = &mut *lock(&this.shared.workers[context.index()]);
                loop {
                    let i = next.fetch_add(1, Ordering::Relaxed);
                    let Some(run) = runs.get(i) else { break };
                    if !this.run(worker, s, run, first_number) {
                        break;
                    }
                }
            });
        };
        match &mut ahead {
            Some(ahead) if layer + 1 < this.layers(0) => std::thread::scope(|scope| {
                let reader = scope.spawn(|| {
                    let _stop = this.shared.sequence.stop_on_panic();
                    this.read_planes(ahead, layer + 1)
                });
                work();
                reader.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic))
            })
            .map_err(Stop::Source)?,
            _ => work(),
        }
        if let Some(ahead) = ahead {
            let window = self.windows[0].get_mut().unwrap_or_else(PoisonError::into_inner);
            self.ahead = Some(std::mem::replace(window, ahead));
        }
        let fine = self.plan().stages[s].grid();
        for (coarser, _) in self.plan().coarser(s) {
            let grid = self.plan().stages[coarser].grid();
            let made = (layer + 1) * self.plan().layout.pyramid.edge() / (grid.factor[2] / fine.factor[2]);
            self.windows[coarser].write().unwrap_or_else(PoisonError::into_inner).filled = made.min(grid.extent.z);
        }
        Ok(())
    }

    /// A layer's bricks in runs, in order of shards and their indexes; and their number.
    fn runs(&self, s: usize, layer: u32) -> (Vec<Run>, u64) {
        let Stage { layout, level, .. } = &self.plan().stages[s];
        let grid = layout.pyramid.level(*level).bricks;
        let shard = layout.shard_bricks(*level);
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

    /// Announces a row of level-0 bricks, along all of x, to the source.
    fn announce(&self, y: u32, z: u32) {
        let Pass { source, plan, .. } = *self.shared.pass;
        let (extent, edge) = (plan.layout.pyramid.levels()[0].extent, plan.layout.pyramid.edge());
        let [from, to] = [0, 1].map(|n| [y, z].map(|i| i.saturating_add(n).saturating_mul(edge)));
        let row = VoxelBox::new([0, from[0], from[1]], [extent.x, to[0], to[1]]).intersect(extent.full_box());
        if !row.is_empty() {
            source.announce(self.time, self.channel, row);
        }
    }

    /// Packs a run of bricks. Returns `false` once the pass must stop.
    fn run(&self, worker: &mut Worker<T>, s: usize, run: &Run, first_number: u64) -> bool {
        if s == 0 && run.first.x == 0 {
            self.announce(run.first.y + 1, run.first.z);
        }
        let gathered = match self.gather(&mut worker.workspace, s, run) {
            Ok(gathered) => gathered,
            Err(error) => {
                self.shared.fail(Stop::Source(error));
                return false;
            }
        };
        (0..run.count).all(|i| {
            if self.shared.is_cancelled() {
                return false;
            }
            let (index, number) = (run.brick(i), first_number + run.number + i as u64);
            if gathered {
                return self.brick(worker, s, index, i as usize, None, number);
            }
            match self.read(&mut worker.workspace, index) {
                Ok(constant) => self.brick(worker, s, index, 0, constant, number),
                Err(error) => {
                    self.shared.fail(Stop::Source(error));
                    false
                }
            }
        })
    }

    /// Packs core `i` of the workspace as brick `index`, entirely of `constant` if given.
    fn brick(
        &self,
        worker: &mut Worker<T>,
        s: usize,
        index: BrickIndex,
        i: usize,
        constant: Option<T>,
        number: u64,
    ) -> bool {
        let (shared, stage) = (self.shared, &self.plan().stages[s]);
        let id = BrickId { time: self.time, channel: self.channel, level: stage.level, index };
        let core = stage.layout.pyramid.brick_box(id.level, index);
        let workspace = &mut worker.workspace;
        if let Some(blanked) = shared.blanked.filter(|_| s == 0) {
            workspace.blank(i, blanked);
        }
        let summary = match constant {
            Some(value) => workspace.digest_constant(i, shape(core), value),
            None => workspace.digest(i, shape(core), s == 0),
        };
        let found = (s == 0 && shared.pass.options.kind == Kind::Labels).then(|| workspace.fraction(i)).flatten();
        let fraction = found.map(|(at, value)| {
            let first = core.min.to_array();
            let place = std::array::from_fn(|a| first[a] + at[a]);
            Fraction { time: self.time, channel: self.channel, place, value }
        });
        for (coarser, method) in self.plan().coarser(s) {
            let factor = ratio(stage.grid(), self.plan().stages[coarser].grid());
            let region = coarse_box(core, factor);
            let voxels = region.extent().volume() as usize;
            match constant {
                Some(value) => workspace.coarse[..voxels].fill(value),
                None => workspace.reduce(i, shape(core), factor, method),
            }
            let part = bytemuck::cast_slice(&workspace.coarse[..voxels]);
            self.windows[coarser].write().unwrap_or_else(PoisonError::into_inner).write_box(region, part);
        }
        let hash = (!summary.is_fill).then(|| core_hash(bytemuck::cast_slice(workspace.core(i))));
        let is_finished = shared.earlier[s].contains_key(&stage.layout.shard_of(id).0);
        let encoded = (!summary.is_fill && !is_finished).then(|| {
            let mut encoded = lock(&shared.spare).pop().unwrap_or_default();
            shared.codec.encode(&mut worker.scratch, bytemuck::cast_slice(workspace.core(i)), &mut encoded);
            encoded
        });
        let voxels = core.extent().volume();
        shared.sequence.put(number, Packed { stage: s, id, summary, voxels, fraction, hash, encoded })
    }

    /// Copies the cores of a run if they are in memory.
    fn gather(&self, workspace: &mut Workspace<T>, s: usize, run: &Run) -> Result<bool, ImportError> {
        let Stage { layout, level, .. } = &self.plan().stages[s];
        let [first, last] = [0, run.count - 1].map(|i| layout.pyramid.brick_box(*level, run.brick(i)));
        let region = VoxelBox { min: first.min, max: last.max };
        if s > 0 || self.by_planes() {
            let window = self.windows[s].read().unwrap_or_else(PoisonError::into_inner);
            workspace.gather(window.lend(region), shape(region));
            return Ok(true);
        }
        let source = self.shared.pass.source;
        source.lend(self.time, self.channel, region, &mut |lent| workspace.gather(lent, shape(region)))
    }

    /// Reads a brick of level 0 into core 0, unless the source reports it constant.
    fn read(&self, workspace: &mut Workspace<T>, index: BrickIndex) -> Result<Option<T>, ImportError> {
        let Pass { source, plan, .. } = *self.shared.pass;
        let region = plan.layout.pyramid.brick_box(Level(0), index);
        let constant = source.constant_in(self.time, self.channel, region).map(T::from_f64_rounded);
        if let Some(value) = constant.filter(|v| v.is_valid() && self.shared.blanked != Some(*v)) {
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
    /// The number of the first brick within its layer.
    number: u64,
}

impl Run {
    fn brick(&self, i: u32) -> BrickIndex {
        BrickIndex { x: self.first.x + i, ..self.first }
    }
}

/// Splits a no-data value into one kept (integers) and one replaced by NaN (floats).
pub(crate) fn no_data<T: Measure>(nodata: Option<f64>) -> (Option<T>, Option<T>) {
    let nodata = nodata.map(T::from_f64_rounded);
    if T::TYPE.is_float() { (None, nodata) } else { (nodata, None) }
}

pub(crate) fn shape(region: VoxelBox) -> [usize; 3] {
    region.extent().to_array().map(|n| n as usize)
}

/// Fine voxels per coarse voxel along each axis, of two levels.
pub(crate) fn ratio(fine: &LevelGrid, coarse: &LevelGrid) -> [usize; 3] {
    std::array::from_fn(|a| (coarse.factor[a] / fine.factor[a]) as usize)
}

/// The box of a brick's core on the next level.
pub(crate) fn coarse_box(core: VoxelBox, factor: [usize; 3]) -> VoxelBox {
    let (min, max) = (core.min.to_array(), core.max.to_array());
    VoxelBox::new(
        std::array::from_fn(|a| min[a] / factor[a] as u32),
        std::array::from_fn(|a| max[a].div_ceil(factor[a] as u32)),
    )
}

impl From<DiskError> for PackError {
    fn from(DiskError { path, error }: DiskError) -> Self {
        PackError::Io { path, error }
    }
}
