//! The index of a foreign image: exact statistics of its channels, and the least and greatest value of each brick and its descendants. It is kept in the
//! user's cache for one state of the image's files, and makes opening quick, empty bricks known and 32-bit voxels fit 16-bit codes, as in a packed store.
//!
//! Making it reads every brick of every level once, and those beneath made levels twice; the bricks made on the way are kept as well. It takes 24 bytes a
//! brick in memory, of 96 MiB at most.

use crate::error::{OpenError, ReadError};
use crate::foreign::Foreign;
use crate::metadata::ChannelStatistics;
use crate::pack::brick::Workspace;
use crate::pack::cascade::{no_data, shape};
use crate::stats::{ChannelTotals, Counter, Measure, Tally, join};
use brickyard_volume::{BrickId, BrickIndex, Extent, Level, Pyramid, VoxelBox, with_voxel_type};
use rayon::prelude::*;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// The index's name in the image's cache folder.
const NAME: &str = "index";

/// Most bytes of ranges, which open stores hold.
const MOST_BYTES: u64 = 96 << 20;

/// Bricks measured by one thread before the next report.
const BATCH: u64 = 16;

/// Least and greatest valid value; `None` if there is none.
type Range = Option<(f64, f64)>;

/// Why another program's image cannot be indexed.
#[derive(Debug, thiserror::Error)]
pub enum ImageIndexError {
    /// The image does not open.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// There are too many bricks.
    #[error("{path}: an index of {bricks} bricks is too large to be held; 'brickyard pack' makes a store of any size")]
    TooLarge {
        /// The image.
        path: PathBuf,
        /// Bricks of all levels, time steps and channels.
        bricks: u64,
    },
    /// Nothing can be kept for the image.
    #[error("{path}: its index cannot be kept: {problem}")]
    NotKept {
        /// The image.
        path: PathBuf,
        /// The problem, with the remedy.
        problem: &'static str,
    },
    /// A brick cannot be read.
    #[error(transparent)]
    Read(#[from] ReadError),
    /// The caller stopped the work.
    #[error("{path}: cancelled; nothing was kept but bricks of made levels")]
    Cancelled {
        /// The image.
        path: PathBuf,
    },
}

/// Statistics and ranges of all bricks.
pub(crate) struct Index {
    pub(crate) channels: Vec<ChannelStatistics>,
    /// Bricks of one time step and channel, and of the levels before each.
    bricks: u64,
    starts: Vec<u64>,
    /// By time step, channel, level and brick.
    ranges: Vec<Range>,
}

/// Makes and keeps the index of another program's image, with its made bricks. `progress` is called with the bricks done and all of them. Returns the
/// bricks, and the bytes of the index.
///
/// # Errors
/// If there is no such image, it has too many bricks, one cannot be read, nothing can be kept, or `progress` breaks.
pub(crate) fn index(
    path: &Path,
    progress: impl Fn(u64, u64) -> ControlFlow<()>,
) -> Result<(u64, u64), ImageIndexError> {
    let foreign = Foreign::open(path)?;
    let kept = |problem| ImageIndexError::NotKept { path: path.into(), problem };
    let unknown =
        "it has more than 200,000 files, or files whose times cannot be read; 'brickyard pack' makes a store of it";
    let state = foreign.state().ok_or_else(|| kept(unknown))?;
    let room =
        Index::brick_count(&foreign).saturating_mul(16).saturating_add(u64::from(foreign.source().channels) << 14);
    // All states, also the present one: an index is the way on where anything kept is in doubt.
    foreign.cache().forget_states_but("");
    if !foreign.cache().reserve(room) {
        return Err(kept("there is no room in the cache, or no folder for it; BRICKYARD_CACHE names one"));
    }
    let made = with_voxel_type!(foreign.voxel_type(), T => make::<T>(&foreign, &progress))?;
    let bytes = made.to_bytes(state);
    let report = (made.ranges.len() as u64, bytes.len() as u64);
    if foreign.state_now() != Some(state) {
        return Err(kept("the image was written to meanwhile; start over"));
    }
    match foreign.cache().write_reserved(NAME, &bytes) {
        true => Ok(report),
        false => Err(kept("its folder in the cache cannot be written to; BRICKYARD_CACHE names another")),
    }
}

/// Measures all bricks.
pub(super) fn make<T: Measure>(
    foreign: &Foreign,
    progress: &(dyn Fn(u64, u64) -> ControlFlow<()> + '_),
) -> Result<Index, ImageIndexError> {
    let info = foreign.source();
    let mut index = Index::empty(foreign.pyramid());
    let all = Index::brick_count(foreign);
    if all.saturating_mul(size_of::<Range>() as u64) > MOST_BYTES {
        return Err(ImageIndexError::TooLarge { path: foreign.path().into(), bricks: all });
    }
    let mut totals: Vec<ChannelTotals> = (0..info.channels).map(|_| ChannelTotals::new(T::TYPE)).collect();
    for (time, channel) in (0..info.times).flat_map(|time| (0..info.channels).map(move |channel| (time, channel))) {
        for level in 0..foreign.pyramid().levels().len() {
            let grid = foreign.pyramid().levels()[level].bricks;
            let first = index.ranges.len() as u64;
            for start in (0..grid.volume()).step_by((BATCH as usize) * rayon::current_num_threads()) {
                if progress(first + start, all).is_break() {
                    return Err(ImageIndexError::Cancelled { path: foreign.path().into() });
                }
                let end = grid.volume().min(start + BATCH * rayon::current_num_threads() as u64);
                let batches: Vec<u64> = (start..end).step_by(BATCH as usize).collect();
                let measured = batches.into_par_iter().map(|from| {
                    let bricks = (from..end.min(from + BATCH)).map(|i| BrickId {
                        time,
                        channel,
                        level: Level(level as u8),
                        index: nth(grid, i),
                    });
                    measure::<T>(foreign, bricks)
                });
                for (ranges, mut counter, tallies) in measured.collect::<Result<Vec<_>, ReadError>>()? {
                    index.ranges.extend(ranges);
                    if level == 0 {
                        counter.drain_into(&mut totals[channel as usize]);
                        tallies.iter().for_each(|tally| totals[channel as usize].add_tally(tally));
                    }
                }
            }
            index.take_children(foreign.pyramid(), time, channel, Level(level as u8), info.channels);
        }
        let first = index.of_volume(time, channel, info.channels);
        let whole = index.ranges[first..].iter().copied().fold(None, join);
        totals[channel as usize].add_range(whole);
    }
    index.channels = totals.iter().map(ChannelTotals::finish).collect();
    Ok(index)
}

/// Ranges of bricks, and the counts and sums of those of level 0.
fn measure<T: Measure>(
    foreign: &Foreign,
    bricks: impl Iterator<Item = BrickId>,
) -> Result<(Vec<Range>, Counter, Vec<Tally>), ReadError> {
    let (pyramid, edge) = (foreign.pyramid(), foreign.pyramid().edge() as usize);
    let mut workspace = Workspace::<T>::new(edge, no_data::<T>(foreign.nodata()).0);
    let (mut ranges, mut tallies) = (Vec::new(), Vec::new());
    for id in bricks {
        foreign.read(id, bytemuck::cast_slice_mut(workspace.core_mut(0)))?;
        let shape = shape(pyramid.brick_box(id.level, id.index));
        let summary = workspace.digest(0, shape, id.level == Level(0));
        ranges.push(summary.parts.whole().to_f64());
        tallies.push(summary.tally);
    }
    Ok((ranges, workspace.counter, tallies))
}

/// Brick number `i` of a grid, x fastest.
fn nth(grid: Extent, i: u64) -> BrickIndex {
    let (x, y) = (u64::from(grid.x), u64::from(grid.y));
    BrickIndex::from_array([i % x, i / x % y, i / (x * y)].map(|at| at as u32))
}

impl Index {
    fn empty(pyramid: &Pyramid) -> Self {
        let mut bricks = 0;
        let starts = pyramid.levels().iter().map(|level| {
            bricks += level.bricks.volume();
            bricks - level.bricks.volume()
        });
        let starts = starts.collect();
        Self { channels: Vec::new(), bricks, starts, ranges: Vec::new() }
    }

    /// Bricks of all levels, time steps and channels of an image.
    fn brick_count(foreign: &Foreign) -> u64 {
        let info = foreign.source();
        foreign.pyramid().brick_count() * u64::from(info.times) * u64::from(info.channels)
    }

    /// The place of a volume's first range.
    fn of_volume(&self, time: u32, channel: u32, channels: u32) -> usize {
        ((u64::from(time) * u64::from(channels) + u64::from(channel)) * self.bricks) as usize
    }

    fn place(&self, pyramid: &Pyramid, id: BrickId, channels: u32) -> usize {
        let within = self.starts[id.level.index()] + pyramid.level(id.level).bricks.linear(id.index.to_array());
        self.of_volume(id.time, id.channel, channels) + within as usize
    }

    /// Joins the ranges of a level's bricks with those of the finer bricks in them.
    fn take_children(&mut self, pyramid: &Pyramid, time: u32, channel: u32, level: Level, channels: u32) {
        let Some(finer) = level.0.checked_sub(1).map(Level) else { return };
        let grid = pyramid.level(level).bricks;
        for i in 0..grid.volume() {
            let id = BrickId { time, channel, level, index: nth(grid, i) };
            let of_child = |index| self.ranges[self.place(pyramid, BrickId { level: finer, index, ..id }, channels)];
            let place = self.place(pyramid, id, channels);
            self.ranges[place] = pyramid.children(level, id.index).map(of_child).fold(self.ranges[place], join);
        }
    }

    /// The range of a brick and its descendants.
    pub(crate) fn core(&self, pyramid: &Pyramid, id: BrickId) -> Range {
        self.ranges[self.place(pyramid, id, self.channels.len() as u32)]
    }

    /// The range of a brick, its descendants and the bricks around it.
    pub(crate) fn around(&self, pyramid: &Pyramid, id: BrickId) -> Range {
        let grid = pyramid.level(id.level).bricks.to_array();
        let at = id.index.to_array();
        let near =
            VoxelBox::new(at.map(|i| i.saturating_sub(1)), std::array::from_fn(|axis| (at[axis] + 2).min(grid[axis])));
        let places = near.voxels().map(BrickIndex::from_array);
        places.map(|index| self.core(pyramid, BrickId { index, ..id })).fold(None, join)
    }

    /// Bytes held.
    pub(crate) fn bytes(&self) -> u64 {
        (self.ranges.len() * size_of::<Range>()) as u64
    }

    /// State of the files, length of the statistics, these as JSON, and two numbers for each range, NaN without a value.
    fn to_bytes(&self, state: u64) -> Vec<u8> {
        let statistics = serde_json::to_vec(&self.channels).unwrap_or_default();
        let mut bytes = [&state.to_le_bytes()[..], &(statistics.len() as u64).to_le_bytes(), &statistics].concat();
        for range in &self.ranges {
            let (low, high) = range.unwrap_or((f64::NAN, f64::NAN));
            bytes.extend([low, high].iter().flat_map(|end| end.to_le_bytes()));
        }
        bytes
    }

    /// The kept index of an image; `None` if there is none for the present state of its files.
    pub(crate) fn kept(foreign: &Foreign) -> Option<Self> {
        let bytes = foreign.cache().read(NAME)?;
        let (state, rest) = bytes.split_first_chunk::<8>()?;
        let (length, rest) = rest.split_first_chunk::<8>()?;
        let (statistics, ranges) = rest.split_at_checked(u64::from_le_bytes(*length).try_into().ok()?)?;
        let channels: Vec<ChannelStatistics> = serde_json::from_slice(statistics).ok()?;
        let ranges = ranges.as_chunks::<16>().0.iter().map(|ends| {
            let end = |at: usize| f64::from_le_bytes(std::array::from_fn(|i| ends[at + i]));
            Some((end(0), end(8))).filter(|(low, high)| low <= high)
        });
        let index = Self { channels, ranges: ranges.collect(), ..Self::empty(foreign.pyramid()) };
        let info = foreign.source();
        let is_whole =
            index.ranges.len() as u64 == Self::brick_count(foreign) && index.channels.len() == info.channels as usize;
        // Last, as it looks at all files.
        (is_whole && foreign.state() == Some(u64::from_le_bytes(*state))).then_some(index)
    }
}
