//! Chunk files of Zarr 2 from the bricks of a store: the same cubes of voxels, each through zlib into a file of its own. Bricks without a value but zero
//! have none. All threads work on rows of bricks; each holds a few bricks.

use crate::error::ExportError;
use crate::job::Job;
use brickyard_store::Store;
use brickyard_volume::{BrickId, BrickIndex, Level};
use flate2::Compression;
use flate2::write::ZlibEncoder;
use rayon::prelude::*;
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Level of zlib; higher ones take several times as long for a few percent.
pub(super) const ZLIB_LEVEL: u32 = 1;
/// The program, its stacks and its allocator.
const PROGRAM_BYTES: u64 = 24 << 20;
/// State of zlib, and small buffers.
const ZLIB_BYTES: u64 = 1 << 20;

/// Number of threads: as many as the memory holds besides both stores.
pub(super) fn threads(job: &Job, packed: &Store, most: usize) -> usize {
    let fixed = PROGRAM_BYTES + job.source.held_bytes() + packed.cache_bytes();
    // Its brick, encoded and shuffled; the decoded one; and twice the compressed one while its buffer grows.
    let thread = 6 * packed.core_bytes() as u64 + ZLIB_BYTES;
    let fitting = job.memory_bytes.saturating_sub(fixed) / thread;
    (fitting as usize).clamp(1, most.max(1))
}

/// Writes the chunk files of all levels, coarse ones first, in folders by level. Runs on the current threads.
///
/// # Errors
/// If a brick cannot be read, a file cannot be written, or the export is cancelled.
pub(super) fn write_chunk_files(job: &Job, packed: &Store, folder: &Path) -> Result<(), ExportError> {
    let layout = packed.layout();
    let done = AtomicU64::new(0);
    for k in (0..packed.pyramid().levels().len()).rev() {
        let level = Level(k as u8);
        let bricks = packed.pyramid().level(level).bricks;
        let volumes = (0..layout.times).flat_map(|time| (0..layout.channels).map(move |channel| (time, channel)));
        let rows = volumes.flat_map(|(time, channel)| {
            (0..bricks.z).flat_map(move |z| (0..bricks.y).map(move |y| Row { time, channel, level, z, y }))
        });
        std::fs::create_dir_all(folder.join(level.to_string())).map_err(ExportError::io(job.output))?;
        let writer = || RowWriter::new(job, packed, folder, &done);
        rows.par_bridge().try_for_each_init(writer, |writer, row| writer.write(&row))?;
    }
    Ok(())
}

/// Bricks of a level along x.
struct Row {
    time: u32,
    channel: u32,
    level: Level,
    z: u32,
    y: u32,
}

/// A thread's buffers.
struct RowWriter<'a> {
    job: &'a Job<'a>,
    packed: &'a Store,
    folder: &'a Path,
    /// Bytes of the exported voxels in all rows so far.
    done: &'a AtomicU64,
    core: Vec<u8>,
    zlib: ZlibEncoder<Vec<u8>>,
    /// The buffer of the last chunk.
    spare: Vec<u8>,
}

impl<'a> RowWriter<'a> {
    fn new(job: &'a Job, packed: &'a Store, folder: &'a Path, done: &'a AtomicU64) -> Self {
        let zlib = ZlibEncoder::new(Vec::new(), Compression::new(ZLIB_LEVEL));
        Self { job, packed, folder, done, core: vec![0; packed.core_bytes()], zlib, spare: Vec::new() }
    }

    fn write(&mut self, row: &Row) -> Result<(), ExportError> {
        let &Row { time, channel, level, z, y } = row;
        let io = ExportError::io(self.job.output);
        let layout = self.packed.layout();
        let mut has_folder = false;
        for x in 0..self.packed.pyramid().level(level).bricks.x {
            let id = BrickId { time, channel, level, index: BrickIndex::from_array([x, y, z]) };
            if !self.packed.is_stored(id)? {
                continue;
            }
            let mut path = self.folder.join(level.to_string());
            path.extend(layout.per_axis(time, channel, [x, y, z]).iter().map(u32::to_string));
            if !has_folder {
                path.parent().map_or(Ok(()), std::fs::create_dir_all).map_err(&io)?;
                has_folder = true;
            }
            self.packed.read_core(id, &mut self.core)?;
            self.write_chunk(path).map_err(&io)?;
        }
        self.count(row)
    }

    fn write_chunk(&mut self, path: PathBuf) -> std::io::Result<()> {
        self.zlib.write_all(&self.core)?;
        let mut next = std::mem::take(&mut self.spare);
        next.clear();
        self.spare = self.zlib.reset(next)?;
        File::create_new(path)?.write_all(&self.spare)
    }

    /// Counts the finest level's voxels as the second half of the work.
    fn count(&self, row: &Row) -> Result<(), ExportError> {
        let grid = self.packed.pyramid().level(row.level);
        let edge = self.packed.pyramid().edge();
        let along = |brick: u32, size: u32| u64::from((size - brick * edge).min(edge));
        let voxels = u64::from(grid.extent.x) * along(row.y, grid.extent.y) * along(row.z, grid.extent.z);
        let bytes = match row.level {
            Level(0) => voxels * self.packed.voxel_type().bytes() as u64,
            _ => 0,
        };
        let done = self.done.fetch_add(bytes, Ordering::Relaxed) + bytes;
        self.job.reach((self.job.total_bytes() + done) / 2)
    }
}
