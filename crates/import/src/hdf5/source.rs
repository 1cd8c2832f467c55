//! Voxels of chunked datasets: one with all axes, or one for each step and channel.

use super::chunks::{Chunks, Wanted};
use super::file::File;
use crate::axes::{Axis, AxisOrder, Sizes};
use crate::direct::direct;
use crate::element::Decode;
use crate::error::{ImportError, Result};
use crate::losses::Losses;
use crate::mapped::MappedFile;
use crate::options::OpenOptions;
use crate::raw::{ArrayLayout, RawSource};
use crate::source::{Access, Source, SourceInfo};
use crate::step_time::StepTime;
use brickyard_volume::VoxelBox;
use hdf5_reader::cache::ChunkCache;
use std::path::PathBuf;
use std::sync::Arc;

/// Bytes of decoded chunks kept for boxes beside them.
const CACHE_BYTES: u64 = 128 << 20;

/// Most bytes of chunks across a plane for a source read by planes, and their least edge: smaller ones suit boxes.
const MOST_LAYER_BYTES: u64 = 1 << 30;
const PLANE_EDGE: u64 = 128;

/// Slots of the cache, of which bytes are the limit.
const CACHE_SLOTS: usize = 1 << 16;

pub(super) struct ChunkedSource {
    info: SourceInfo,
    path: PathBuf,
    map: Arc<MappedFile>,
    arrays: Vec<Chunks>,
    /// Axes of each array, slowest first.
    axes: Vec<Axis>,
    decode: Decode,
    /// Whether channels are members of an element.
    has_members: bool,
    cache: ChunkCache,
    access: Access,
    step_time: StepTime,
}

impl ChunkedSource {
    /// Sets the time of a single step.
    pub(super) fn at(self, step_time: StepTime) -> Self {
        Self { step_time, ..self }
    }
}

/// A volume about to be opened.
pub(super) struct Opening<'a> {
    pub(super) file: &'a File,
    pub(super) info: SourceInfo,
    pub(super) axes: Vec<Axis>,
    pub(super) decode: Decode,
    pub(super) has_members: bool,
}

impl Opening<'_> {
    /// Opens elements in one piece, mapped.
    pub(super) fn piece(self, start: u64, what: &str, options: &OpenOptions) -> Result<RawSource> {
        let Self { file, info, mut axes, decode, has_members } = self;
        if has_members {
            axes.push(Axis::C);
        }
        let sizes = Sizes { extent: info.extent, channels: info.channels, times: info.times };
        let array = ArrayLayout { sizes, axes: AxisOrder::of(&axes), decode, offset: start };
        let end = array.end_bytes().map_err(|problem| ImportError::invalid(&file.path, problem))?;
        let length = file.map.len() as u64;
        if end > length {
            let problem = format!("cut short: expected at least {end} bytes for {what}, found {length}");
            return Err(ImportError::invalid(&file.path, problem));
        }
        let nodata = info.nodata;
        RawSource::new(MappedFile::open(&file.path)?, array, info)?.with_losses(nodata, options)
    }

    /// Opens chunked elements: those of one array, or of an array for each step and channel.
    pub(super) fn chunks(self, arrays: Vec<Chunks>, options: &OpenOptions) -> Result<ChunkedSource> {
        let Self { file, mut info, axes, mut decode, has_members } = self;
        let fail = |problem: String| damaged(&file.path, &problem);
        decode = direct(decode, info.nodata, options);
        info.voxel_type = decode.voxel_type();
        if let Some(mut losses) = Losses::may_occur(&file.path, decode, info.nodata, options) {
            for array in &arrays {
                let seen = array.each(&file.map, |line| losses.see(line), fail);
                file.map.confirm()?;
                seen?;
            }
            info.notes.push(losses.note());
            decode = losses.decode();
            info.voxel_type = decode.voxel_type();
        }
        let (access, cache_bytes) = arrays.first().map_or((Access::Box, 0), |array| access_of(array, &axes));
        let cache = ChunkCache::new(usize::try_from(cache_bytes).unwrap_or(usize::MAX), CACHE_SLOTS);
        let (path, map) = (file.path.clone(), file.map.clone());
        Ok(ChunkedSource {
            info,
            path,
            map,
            arrays,
            axes,
            decode,
            has_members,
            cache,
            access,
            step_time: StepTime::default(),
        })
    }
}

fn damaged(path: &std::path::Path, problem: &str) -> ImportError {
    ImportError::invalid(path, format!("{problem}; fetch or write the file again"))
}

/// The way to read an array, and the bytes of chunks to keep for it.
fn access_of(array: &Chunks, axes: &[Axis]) -> (Access, u64) {
    let grid = array.grid();
    let place = |axis: Axis| axes.iter().position(|a| *a == axis);
    let plane = [Axis::X, Axis::Y].map(place);
    let is_wide = plane.iter().flatten().all(|a| array.chunk[*a] >= PLANE_EDGE.min(array.shape[*a]));
    let layer: u64 = plane.iter().flatten().map(|a| grid[*a]).product();
    let (layer, chunk) = (layer.saturating_mul(array.chunk_bytes() as u64), array.chunk_bytes() as u64);
    if is_wide && layer <= MOST_LAYER_BYTES {
        return (Access::Planes, layer);
    }
    (
        Access::Box,
        CACHE_BYTES.max(chunk.saturating_mul(2)).min(array.grid().iter().product::<u64>().saturating_mul(chunk)),
    )
}

impl Source for ChunkedSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn access(&self) -> Access {
        self.access
    }

    fn step_time(&self) -> StepTime {
        self.step_time.clone()
    }

    fn reader_bytes(&self) -> u64 {
        // A chunk before and after a filter, and the filter's buffer.
        self.arrays.iter().map(|array| array.chunk_bytes() as u64).max().unwrap_or(0).saturating_mul(3)
    }

    fn held_bytes(&self) -> u64 {
        let chunks: usize = self.arrays.iter().map(|array| array.stored.len()).sum();
        (chunks * size_of::<super::chunks::StoredChunk>()) as u64 + self.cache.capacity_bytes() as u64
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        let extent = region.extent().to_array().map(|n| n as usize);
        let voxel = self.info.voxel_type.bytes();
        let (low, high) = (region.min.to_array(), region.max.to_array());
        let is_split = self.arrays.len() > 1;
        let (mut from, mut to, mut strides) = (Vec::new(), Vec::new(), Vec::new());
        for axis in &self.axes {
            let (range, stride) = match axis {
                Axis::X => ((low[0], high[0]), voxel),
                Axis::Y => ((low[1], high[1]), voxel * extent[0]),
                Axis::Z => ((low[2], high[2]), voxel * extent[0] * extent[1]),
                Axis::C => ((channel, channel + 1), 0),
                Axis::T => ((time, time + 1), 0),
            };
            from.push(range.0.into());
            to.push(range.1.into());
            strides.push(stride);
        }
        let array = if is_split { time as usize * self.info.channels as usize + channel as usize } else { 0 };
        let offset = if self.has_members { channel as usize * self.decode.element.bytes() } else { 0 };
        let wanted = Wanted { from: &from, to: &to, strides: &strides, decode: self.decode, offset };
        let read = self.arrays[array].read(&self.map, &self.cache, &wanted, out);
        // Bytes lost by the file read as zeros, which may look damaged.
        self.map.confirm()?;
        read.map_err(|problem| damaged(&self.path, &problem))
    }
}
