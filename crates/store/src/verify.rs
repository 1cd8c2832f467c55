//! Verification: reads everything and recomputes a store's records of itself.
//!
//! It checks every document against a generated one (`verify/documents.rs`), every page of side data, every shard's
//! index (bricks may share all of their bytes, but not some), and every brick's checksum, length, hash and ranges.
//! Parents' ranges must cover their children's, each level must be the reduction of the finer one, stored aprons must
//! equal the neighbours' voxels, and the root document's statistics must be right. One pass over level 0 checks both
//! pyramids. Verification continues after a problem and reports all of them, but an unreadable brick only once, not for
//! its dependents.
//!
//! Blocks of up to 256 voxels an axis are read with one voxel around (two for aprons of two): each brick is decoded
//! about 3.4 times. A thread holds one block: (256 + 2)^3 voxels, and an eighth to a half of it per pyramid. If memory
//! is short, blocks shrink, down to a brick, and then threads are reduced. Blocks without stored bricks are not
//! examined voxel by voxel.

mod block;
pub(crate) mod documents;
mod source;
#[cfg(test)]
mod tests;

use crate::chunks::Chunks;
use crate::counts::Counts;
use crate::error::{OpenError, ReadError};
use crate::layout::{ShardId, place_at};
use crate::metadata::ChannelStatistics;
use crate::mutex::lock;
use crate::pack::brick::Workspace;
use crate::pack::pool;
use crate::shard::ShardIndex;
use crate::side::{SideArray, level_arrays};
use crate::stats::{ChannelTotals, Measure};
use crate::store::Store;
use block::{Block, BlockCheck, Buffers};
use brickyard_import::{ImportError, is_of_process};
use brickyard_volume::{BrickId, Extent, Level, Pyramid, VoxelBox, with_voxel_type};
use rayon::prelude::*;
pub use source::compare_within;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, AtomicU64, AtomicUsize, Ordering};
use std::sync::{Mutex, OnceLock};

/// A single problem in a store.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VerifyProblem {
    /// The brick at fault, if any.
    pub brick: Option<BrickId>,
    /// The file at fault, or the folder of an array of side data.
    pub path: PathBuf,
    /// The problem: expected and found.
    pub what: String,
}

impl std::fmt::Display for VerifyProblem {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}: ", self.path.display())?;
        if let Some(brick) = self.brick {
            write!(f, "{brick}: ")?;
        }
        f.write_str(&self.what)
    }
}

impl VerifyProblem {
    /// The problem of a file in the words of an error, without the path in front.
    fn of_file(path: PathBuf, error: &impl std::fmt::Display) -> Self {
        let message = error.to_string();
        let what = message.strip_prefix(&format!("{}: ", path.display())).unwrap_or(&message).to_owned();
        Self { brick: None, path, what }
    }
}

/// The outcome of a verification.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct VerifyReport {
    /// Number of bricks checked, stored or not.
    pub bricks: u64,
    /// Number of shard files checked.
    pub shards: u64,
    /// Total bytes of the shard files, according to the side data.
    pub bytes: u64,
    /// All problems: documents, side data and shards, then bricks by time step, channel and level, then statistics.
    pub problems: Vec<VerifyProblem>,
    /// Edits by other programs, which take effect: changed names, colours and windows of channels.
    pub edits: Vec<VerifyProblem>,
    /// Whether verification stopped early at too many problems.
    pub is_cut_short: bool,
}

/// Why a store was not verified.
#[derive(Debug, thiserror::Error)]
pub enum VerifyError {
    /// The store cannot be opened.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The allowed memory is below the minimum for one thread.
    #[error(
        "`memory` {given} MiB is too little: verifying this store needs at least {needed} MiB",
        given = given_bytes >> 20, needed = needed_bytes.div_ceil(1 << 20)
    )]
    Memory {
        /// The least memory for verifying this store, in bytes.
        needed_bytes: u64,
        /// The allowed memory, in bytes.
        given_bytes: u64,
    },
    /// The process lacks permission or resources to read some of the store, which is no store fault.
    #[error("{0}: not verified")]
    Barred(#[source] ReadError),
    /// The store's source could not be read again.
    #[error("{0}: not compared")]
    Source(#[from] ImportError),
    /// The store's voxels could not be read again.
    #[error("{0}: not compared")]
    Read(#[from] ReadError),
    /// The worker threads could not be started.
    #[error("cannot start worker threads: {0}")]
    Threads(String),
}

/// Problems before verification stops: nobody reads more, and a few bytes of metadata can claim any number of missing
/// files.
pub const MOST_PROBLEMS: usize = 10_000;

/// The memory limit of [`verify`], in bytes.
pub const VERIFY_MEMORY_BYTES: u64 = 2 << 30;

/// Verifies a store within [`VERIFY_MEMORY_BYTES`], on the current rayon pool's number of threads, or fewer if memory
/// is short. Calls `progress` with the bytes of voxels checked so far and in total.
///
/// # Errors
/// If the store cannot be opened, the process may not read all of it, the memory is too little for one thread, or no
/// threads can be started. All other faults are in the report.
pub fn verify(path: &Path, progress: impl Fn(u64, u64) + Sync) -> Result<VerifyReport, VerifyError> {
    verify_within(path, VERIFY_MEMORY_BYTES, progress)
}

/// Verifies a store like [`verify`], within `memory_bytes` on top of an open store's memory.
///
/// # Errors
/// As for [`verify`], with `memory_bytes`.
pub fn verify_within(
    path: &Path,
    memory_bytes: u64,
    progress: impl Fn(u64, u64) + Sync,
) -> Result<VerifyReport, VerifyError> {
    verified(path, memory_bytes, &progress)
}

fn verified(path: &Path, memory_bytes: u64, progress: &(dyn Fn(u64, u64) + Sync)) -> Result<VerifyReport, VerifyError> {
    let store = Store::open_own(path)?;
    let second = store.info().downsample.second();
    let second = second.map(|method| store.reduced(method)).transpose()?;
    let views: Vec<Store> = std::iter::once(store).chain(second).collect();
    let (block_edge, threads) = block_edge(&views, memory_bytes, rayon::current_num_threads())?;
    let pool = pool(threads).map_err(VerifyError::Threads)?;
    let verifier = Verifier::new(&views, progress, block_edge);
    let report = pool.install(|| with_voxel_type!(views[0].voxel_type(), T => verifier.run::<T>()))?;
    // Each file of a vanished store would be a problem.
    if !report.problems.is_empty() && views[0].is_replaced() { Err(views[0].replaced().into()) } else { Ok(report) }
}

/// The program, its stacks and allocator, and the most problems kept.
const PROGRAM_BYTES: u64 = (24 << 20) + MOST_PROBLEMS as u64 * 512;

/// The largest blocks that fit, then the most threads.
fn block_edge(views: &[Store], memory_bytes: u64, threads: usize) -> Result<(u32, usize), VerifyError> {
    let store = &views[0];
    let voxel_type = store.voxel_type();
    let fixed = PROGRAM_BYTES
        + views.iter().map(Store::cache_bytes).sum::<u64>()
        + store.channels() as u64 * ChannelTotals::bytes(voxel_type)
        + ChannelTotals::adding_bytes(voxel_type);
    let voxel_bytes = voxel_type.bytes() as u64;
    let extent = store.pyramid().levels()[0].extent.to_array().map(u64::from);
    let per_thread = |edge: u32| {
        let around = 2 * store.apron().map_or(1, |apron| apron.width);
        let volume = |edge: u64| extent.map(|n| n.min(edge)).iter().product::<u64>();
        let coarse = views.len() as u64 * volume(edge as u64) / 2;
        let apron = store.aprons().map_or(0, Chunks::chunk_bytes) as u64;
        // A brick: encoded, shuffled and decoded.
        let brick = 3 * store.core_bytes() as u64 + apron;
        let workspace = Workspace::<u8>::bytes(store.pyramid().edge() as usize, voxel_type.bytes()) as u64;
        let block = (volume((edge + around) as u64) + coarse) * voxel_bytes + brick + workspace;
        // Indexes are checked before blocks.
        block.max(ShardIndex::overlap_bytes(store.layout().shard_slots(Level(0))))
    };
    let edges = [256, 128, 64, 32, 16, 8].into_iter().filter(|&edge| edge >= store.pyramid().edge());
    let least = edges.clone().next_back().unwrap_or(store.pyramid().edge());
    let room = memory_bytes.saturating_sub(fixed);
    let fits = |edge: &u32| threads as u64 * per_thread(*edge) <= room;
    match edges.clone().find(fits) {
        Some(edge) => Ok((edge, threads)),
        None if per_thread(least) <= room => Ok((least, (room / per_thread(least)) as usize)),
        None => Err(VerifyError::Memory { needed_bytes: fixed + per_thread(least), given_bytes: memory_bytes }),
    }
}

struct Verifier<'a> {
    /// The main pyramid, used for level 0, and the second one.
    views: &'a [Store],
    progress: &'a (dyn Fn(u64, u64) + Sync),
    /// Voxels along a block's edge: whole bricks.
    block_edge: u32,
    bricks_done: AtomicU64,
    problems: AtomicUsize,
    /// Why the process may not read some of the store.
    barred: OnceLock<ReadError>,
    /// Whether any level-0 brick was unreadable, leaving the statistics unknown.
    level_0_unread: AtomicBool,
    /// Level-0 statistics, per channel.
    totals: Mutex<Vec<ChannelTotals>>,
    /// Unreadable shards by file; bricks also by id.
    unread: Mutex<BTreeSet<(PathBuf, Option<BrickId>)>>,
}

impl<'a> Verifier<'a> {
    fn new(views: &'a [Store], progress: &'a (dyn Fn(u64, u64) + Sync), block_edge: u32) -> Self {
        let totals = (0..views[0].channels()).map(|_| ChannelTotals::new(views[0].voxel_type())).collect();
        let (unread, barred, level_0_unread, bricks_done, problems) = Default::default();
        let totals = Mutex::new(totals);
        Self { views, progress, block_edge, bricks_done, problems, barred, level_0_unread, totals, unread }
    }

    fn run<T: Measure>(self) -> Result<VerifyReport, VerifyError> {
        let mut report = self.check_shards()?;
        if !self.has_enough() {
            self.check_bricks::<T>(&mut report);
        }
        report.is_cut_short = self.has_enough();
        self.barred.into_inner().map_or(Ok(report), |error| Err(VerifyError::Barred(error)))
    }

    /// Whether to stop, after too many problems or a refused read.
    fn has_enough(&self) -> bool {
        self.problems.load(Ordering::Relaxed) >= MOST_PROBLEMS || self.barred.get().is_some()
    }

    /// Passes on problems until there are enough.
    fn some<P: ParallelIterator<Item = VerifyProblem>>(&self, found: P) -> impl ParallelIterator<Item = VerifyProblem> {
        found.take_any_while(|_| self.problems.fetch_add(1, Ordering::Relaxed) < MOST_PROBLEMS)
    }

    /// Checks the documents, and every shard's file and index.
    fn check_shards(&self) -> Result<VerifyReport, OpenError> {
        let of_documents = documents::check(&self.views[0], self.levels())?;
        let mut report = VerifyReport { bricks: self.brick_count(), ..of_documents };
        for (store, level) in self.levels() {
            report.problems.par_extend(self.some(self.check_pages(store, level)));
            for chunks in store.chunks() {
                let pages = (0..chunks.fingerprint_pages(level)).into_par_iter();
                let (shards, bytes) = (AtomicU64::new(0), AtomicU64::new(0));
                report.problems.par_extend(self.some(pages.filter_map(
                    |page| match chunks.files_of_page(level, page) {
                        Ok((count, length)) => {
                            shards.fetch_add(count, Ordering::Relaxed);
                            bytes.fetch_add(length, Ordering::Relaxed);
                            None
                        }
                        Err(error) => self.unread(error),
                    },
                )));
                report.shards += shards.into_inner();
                report.bytes += bytes.into_inner();
                let shards = (0..chunks.layout().level_shards(level)).into_par_iter();
                let shards = shards.map(|i| chunks.layout().shard_at(level, i));
                report.problems.par_extend(self.some(shards.filter_map(|id| self.check_shard(chunks, id))));
            }
        }
        Ok(report)
    }

    fn check_bricks<T: Measure>(&self, report: &mut VerifyReport) {
        let buffers = || Buffers::<T>::new(self);
        let in_blocks = self.blocks().map_init(buffers, |b, block| self.check_block(b, block));
        let mut found: Vec<VerifyProblem> = self.some(in_blocks.flatten()).collect();
        // Neighbours' reads may report a brick first.
        found.sort_by_key(|problem| problem.brick.map(|id| (id.time, id.channel, id.level, id.index)));
        report.problems.extend(found);
        if !self.has_enough() && !self.level_0_unread.load(Ordering::Relaxed) {
            self.check_statistics(&mut report.problems);
        }
    }

    fn check_shard(&self, chunks: &Chunks, id: ShardId) -> Option<VerifyProblem> {
        let path = chunks.path(id);
        match chunks.shard(id) {
            Ok(None) => {
                let what = "unexpected file: the shard was packed without one (all fill value)".into();
                chunks.has_file(id).then_some(VerifyProblem { brick: None, path, what })
            }
            Ok(Some(shard)) => {
                let brick = |slot| chunks.layout().brick_at(id, slot).map_or("one outside".into(), |id| id.to_string());
                // The index was checked on opening the shard.
                let (a, b) = shard.overlap().ok()??;
                let what = format!("bricks {} and {} overlap partly", brick(a), brick(b));
                Some(VerifyProblem { brick: None, path, what })
            }
            Err(error) => self.unread(error),
        }
    }

    /// Checks the pages of a level's side data, and of its aprons'.
    fn check_pages(&self, store: &Store, level: Level) -> impl ParallelIterator<Item = VerifyProblem> {
        let arrays = level_arrays(store.path(), store.layout(), level, store.voxel_type());
        let of_aprons = store.aprons().map(|aprons| SideArray::fingerprints(store.path(), aprons.layout(), level));
        let arrays: Vec<SideArray> = arrays.into_iter().chain(of_aprons).collect();
        arrays.into_par_iter().flat_map(move |array| {
            let pages = (0..array.page_count()).into_par_iter();
            pages.filter_map(move |i| self.unread(array.read_page(store.folder(), array.page_at(level, i)).err()?))
        })
    }

    /// Converts a new read error to a problem of the undecodable brick or else its shard. `None` for known problems and
    /// refused reads.
    fn unread(&self, error: ReadError) -> Option<VerifyProblem> {
        if matches!(&error, ReadError::Io { error, .. } if is_of_process(error)) {
            // Only the first is reported.
            let _ = self.barred.set(error);
            return None;
        }
        let problem = match error {
            ReadError::CorruptBrick { path, id, error } => {
                VerifyProblem { brick: Some(id), path, what: error.to_string() }
            }
            other => VerifyProblem::of_file(other.path().into(), &other),
        };
        lock(&self.unread).insert((problem.path.clone(), problem.brick)).then_some(problem)
    }

    /// The main pyramid's levels, then the second one's own.
    fn levels(&self) -> impl Iterator<Item = (&'a Store, Level)> {
        let levels = |(i, store): (usize, &'a Store)| {
            (i.min(1)..self.pyramid().levels().len()).map(move |k| (store, Level(k as u8)))
        };
        self.views.iter().enumerate().flat_map(levels)
    }

    /// The pyramids in which a block has a next level.
    fn coarser(&self, block: Block<'a>) -> &'a [Store] {
        match block.level {
            level if level == self.pyramid().coarsest() => &[],
            Level(0) => self.views,
            _ => std::slice::from_ref(block.store),
        }
    }

    /// The grids, common to both pyramids.
    fn pyramid(&self) -> &'a Pyramid {
        self.views[0].pyramid()
    }

    fn brick_count(&self) -> u64 {
        let bricks = |(_, level)| self.pyramid().level(level).bricks.volume();
        let volumes = self.views[0].times() as u64 * self.views[0].channels() as u64;
        volumes * self.levels().map(bricks).sum::<u64>()
    }

    /// All blocks, in order.
    fn blocks(&self) -> impl ParallelIterator<Item = Block<'a>> {
        let edge = self.block_edge;
        let levels: Vec<_> = self.levels().collect();
        let (pyramid, channels) = (self.pyramid(), self.views[0].channels());
        let volumes = 0..self.views[0].times() as usize * channels as usize;
        (0..volumes.len() * levels.len()).into_par_iter().flat_map(move |i| {
            let ((store, level), volume) = (levels[i % levels.len()], (i / levels.len()) as u32);
            let whole = pyramid.level(level).extent.full_box();
            // Blocks are whole bricks.
            let grid = Extent::from_array(whole.max.to_array().map(|n| n.div_ceil(edge)));
            (0..grid.volume()).into_par_iter().map(move |i| {
                let [_, _, z, y, x] = place_at(i, 1, grid);
                let corner = [x, y, z].map(|i| i * edge);
                let core = VoxelBox::new(corner, corner.map(|c| c.saturating_add(edge))).intersect(whole);
                Block { store, time: volume / channels, channel: volume % channels, level, core }
            })
        })
    }

    fn check_block<T: Measure>(&self, buffers: &mut Buffers<T>, block: Block<'a>) -> Vec<VerifyProblem> {
        if self.has_enough() {
            return Vec::new();
        }
        let problems = BlockCheck::new(self, buffers, block).run();
        let bricks = block.bricks().count() as u64;
        let done = self.bricks_done.fetch_add(bricks, Ordering::Relaxed) + bricks;
        let core_bytes = block.store.core_bytes() as u64;
        (self.progress)(done * core_bytes, self.brick_count() * core_bytes);
        problems
    }

    fn check_statistics(&self, problems: &mut Vec<VerifyProblem>) {
        let totals = lock(&self.totals);
        problems.extend(check_counts(&self.views[0], &totals));
        for (c, (totals, stored)) in totals.iter().zip(&self.views[0].info().channels).enumerate() {
            let mut computed = totals.finish();
            // A float's mean depends in its last digits on the order of summation; the window, name, colour and unit are a
            // choice.
            let near = (computed.mean - stored.mean).abs() <= 1e-9 * stored.range[0].abs().max(stored.range[1].abs());
            if near {
                computed.mean = stored.mean;
            }
            computed.window = stored.window;
            (computed.name, computed.color, computed.unit) = (stored.name.clone(), stored.color, stored.unit.clone());
            if computed != *stored {
                let path = self.views[0].path().join("zarr.json");
                let what = format!("attributes.brickyard.channels[{c}]: {}", difference(&computed, stored));
                problems.push(VerifyProblem { brick: None, path, what });
            }
        }
    }

    /// The value marking voxels without data.
    fn nodata<T: Measure>(&self) -> Option<T> {
        self.views[0].info().nodata.map(|nodata| T::from_f64_rounded(nodata as f64))
    }
}

/// Checks the value counts of a store with appended steps.
fn check_counts(store: &Store, totals: &[ChannelTotals]) -> Option<VerifyProblem> {
    let times = store.info().times?;
    let counts = Counts::of(store);
    let problem = |path: PathBuf, what: String| Some(VerifyProblem { brick: None, path, what });
    match counts.read(store, times) {
        Ok(Some(kept)) => {
            let wrong = kept.iter().zip(totals).position(|(kept, counted)| !kept.is_near(counted))?;
            problem(counts.dir(times).join(wrong.to_string()), "the counts differ from the channel's values".into())
        }
        // Another append may have replaced them.
        Ok(None) | Err(_) if store.newer().is_ok_and(|newer| newer.is_some()) => None,
        Ok(None) => problem(counts.dir(times), "missing".into()),
        Err(error) => Some(VerifyProblem::of_file(error.path().into(), &error)),
    }
}

/// The first differing field.
fn difference(expected: &ChannelStatistics, found: &ChannelStatistics) -> String {
    let fields = |s: &ChannelStatistics| serde_json::to_value(s).unwrap_or_default();
    let (expected, found) = (fields(expected), fields(found));
    let differs = expected.as_object().and_then(|e| e.iter().find(|(name, value)| found[name.as_str()] != **value));
    differs
        .map_or_else(String::new, |(name, value)| format!("{name}: expected {value}, found {}", found[name.as_str()]))
}
