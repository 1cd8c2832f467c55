//! Value counts over all steps of a store. Stores with appended steps keep them, so statistics with one more step are
//! exact without reading other steps.
//!
//! `STORE/0/.brickyard/counts/N/C` covers the first N steps of channel C: the contents of [`ChannelTotals`], as 64-bit
//! little-endian words in one Zstandard frame, then its crc32c. The files of N + 1 steps exist before the root document
//! counts them, and those of N steps are deleted afterwards.

use crate::error::ReadError;
use crate::layout::{COUNTS_NAME, Layout};
use crate::mutex::lock;
use crate::pack::brick::Workspace;
use crate::pack::cascade::shape;
use crate::pack::disk::{Disk, DiskError};
use crate::pack::ours;
use crate::side_file::{checked, encode};
use crate::stats::{ChannelTotals, Measure, Range, Tally};
use crate::store::{Store, bricks_of};
use crate::value_counts::MOST_CLASSES;
use brickyard_volume::{BrickId, BrickIndex, Level, VoxelType};
use rayon::prelude::*;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// The first word of a file.
const VERSION: u64 = 1;

/// Most words of a file: its version, some totals, and two words per class of values.
const MOST_WORDS: usize = 16 + 2 * MOST_CLASSES;

/// Bricks counted by one thread before merging into the channel's counts.
const BRICKS_AT_A_TIME: usize = 16;

/// Most bricks whose sums await their turn: few in tests, to cover several rounds.
const MOST_BRICKS_IN_MEMORY: usize = if cfg!(test) { 3 } else { 1 << 14 };

/// The folder of a store's counts.
pub(crate) struct Counts {
    dir: PathBuf,
}

impl Counts {
    pub(crate) fn of(store: &Store) -> Self {
        Self::in_folder(store.layout(), store.path())
    }

    /// The counts of a store with this layout in a folder.
    pub(crate) fn in_folder(layout: &Layout, folder: &Path) -> Self {
        Self { dir: layout.side_dir(folder, Level(0)).join(COUNTS_NAME) }
    }

    /// The folder with the counts of the first `times` steps.
    pub(crate) fn dir(&self, times: u32) -> PathBuf {
        self.dir.join(times.to_string())
    }

    fn path(&self, times: u32, channel: usize) -> PathBuf {
        self.dir(times).join(channel.to_string())
    }

    /// Writes each channel's counts of the first `times` steps, durable after the next sync of the store.
    pub(crate) fn write(&self, disk: &Disk, times: u32, channels: &[ChannelTotals]) -> Result<(), DiskError> {
        for (channel, totals) in channels.iter().enumerate() {
            let mut words = vec![VERSION];
            totals.to_words(&mut words);
            let bytes: Vec<u8> = words.iter().flat_map(|word| word.to_le_bytes()).collect();
            disk.write_early(&self.path(times, channel), &encode(&bytes))?;
        }
        Ok(())
    }

    pub(crate) fn folder(&self) -> &Path {
        &self.dir
    }

    /// The remedy for damaged counts.
    pub(crate) fn cure(&self) -> String {
        format!("delete {} to have all steps counted anew", self.dir.display())
    }

    /// Reads the counts of the first `times` steps, if the store has any.
    pub(crate) fn read(&self, store: &Store, times: u32) -> Result<Option<Vec<ChannelTotals>>, ReadError> {
        let (dir, folder) = (self.dir(times), store.folder());
        match folder.file(&dir) {
            Err(error) if error.kind() == ErrorKind::NotFound && !folder.is_replaced() => return Ok(None),
            Err(error) => return Err(folder.unreadable(&dir, error)),
            Ok(_) => {}
        }
        let read = |channel| {
            let path = self.path(times, channel);
            let most = zstd::zstd_safe::compress_bound(MOST_WORDS * 8) as u64 + 4;
            let file = folder.read(&path, most).map_err(|error| folder.unreadable(&path, error))?;
            let corrupt = |what| ReadError::CorruptPage { path, what: format!("{what}; {}", self.cure()) };
            decode(&file, store.voxel_type()).map_err(corrupt)
        };
        (0..store.channels() as usize).map(read).collect::<Result<_, _>>().map(Some)
    }

    /// Deletes all counts except those of the first `times` steps.
    pub(crate) fn keep_only(&self, disk: &Disk, times: u32) -> Result<(), DiskError> {
        let io = |error| DiskError { path: self.dir.clone(), error };
        let entries = match std::fs::read_dir(&self.dir) {
            Ok(entries) => entries,
            Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
            Err(error) => return Err(io(error)),
        };
        let kept = self.dir(times);
        for entry in entries {
            let entry = entry.map_err(io)?;
            let is_ours = ours::is_number(&entry.file_name().to_string_lossy());
            if is_ours && entry.path() != kept && entry.file_type().map_err(io)?.is_dir() {
                ours::remove_chunks(disk, &entry.path())?;
            }
        }
        Ok(())
    }
}

/// Decodes a file's totals; fails with a description of the fault.
fn decode(file: &[u8], voxel_type: VoxelType) -> Result<ChannelTotals, String> {
    let bytes = zstd::bulk::decompress(checked(file)?, MOST_WORDS * 8).map_err(|error| error.to_string())?;
    let (words, rest) = bytes.as_chunks::<8>();
    let mut words = words.iter().map(|word| u64::from_le_bytes(*word));
    let version = words.next();
    if version != Some(VERSION) {
        return Err(format!("version of counts: expected {VERSION}, found {version:?}"));
    }
    let totals =
        ChannelTotals::from_words(voxel_type, &mut words).filter(|_| rest.is_empty() && words.next().is_none());
    totals.ok_or_else(|| format!("it holds no counts of {voxel_type} voxels"))
}

/// Counts all level-0 voxels of a store, for the first append to a packed one.
pub(crate) fn count_store<T: Measure>(store: &Store) -> Result<Vec<ChannelTotals>, ReadError> {
    let mut channels = Vec::new();
    for channel in 0..store.channels() {
        let mut totals = ChannelTotals::new(T::TYPE);
        for time in 0..store.times() {
            count_volume::<T>(store, time, channel, &mut totals)?;
        }
        channels.push(totals);
    }
    Ok(channels)
}

/// Adds all level-0 voxels of one step of a channel to its totals.
fn count_volume<T: Measure>(
    store: &Store,
    time: u32,
    channel: u32,
    totals: &mut ChannelTotals,
) -> Result<(), ReadError> {
    let edge = store.pyramid().edge() as usize;
    let nodata = store.info().nodata.map(|nodata| T::from_f64_rounded(nodata as f64));
    let bricks = store.pyramid().level(Level(0)).bricks;
    let mut indices = bricks_of(bricks.full_box(), 1);
    let shared = Mutex::new(&mut *totals);
    let of_brick = |workspace: &mut Workspace<T>, index| {
        let id = BrickId { time, channel, level: Level(0), index };
        store.read_core(id, bytemuck::cast_slice_mut(workspace.core_mut(0)))?;
        let summary = workspace.digest(0, shape(store.pyramid().brick_box(Level(0), index)), true);
        Ok((summary.parts.whole(), summary.tally))
    };
    let of_some = |workspace: &mut Workspace<T>, indices: &[BrickIndex]| {
        let found = indices.iter().map(|&index| of_brick(workspace, index)).collect::<Result<Vec<_>, ReadError>>()?;
        workspace.counter.drain_into(&mut lock(&shared));
        Ok(found)
    };
    loop {
        let some: Vec<BrickIndex> = indices.by_ref().take(MOST_BRICKS_IN_MEMORY).collect();
        if some.is_empty() {
            break;
        }
        let found: Vec<Vec<(Range<T>, Tally)>> = some
            .par_chunks(BRICKS_AT_A_TIME)
            .map_init(|| Workspace::new(edge, nodata), of_some)
            .collect::<Result<_, ReadError>>()?;
        // In brick order, so rounding is independent of threads.
        let mut totals = lock(&shared);
        for (range, tally) in found.iter().flatten() {
            totals.add_range(range.to_f64());
            totals.add_tally(tally);
        }
    }
    Ok(())
}
