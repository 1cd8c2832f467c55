//! What a pack will need, before it starts.
//!
//! ```text
//! memory = fixed + windows kept in memory + 24 MiB (program, stacks, allocator)
//! fixed  = threads * (buffers(edge) + compressor) + (3 threads + 6) * greatest encoded brick
//!        + bricks of all levels * (4 voxels + 40 bytes) + open shards' indexes + channels * 512 KiB
//! window of level k = capacity_k * x_k * y_k * voxel bytes
//! capacity_k = edge                                                  (k >= 1: packed as soon as it is full)
//! capacity_0 = 2 edge for sources that decode whole planes, none for those that read boxes
//! ```
//!
//! Windows are kept in memory, the coarsest first, as far as `memory_bytes` reaches; the others are rings of the same size
//! in a scratch file. So `fixed` is the least memory a pack needs, however large the planes are.

use crate::codec::{BrickCodec, Codec};
use crate::layout::Layout;
use crate::pack::brick::Workspace;
use crate::pack::shards::OPEN_BYTES_PER_BRICK;
use crate::pack::{PackError, PackOptions};
use brickyard_import::{Access, Source};
use brickyard_volume::{Level, Pyramid, VoxelType};

const MIB: u64 = 1 << 20;
const PROGRAM_BYTES: u64 = 24 * MIB;

/// What a pack needs.
#[derive(Clone, Debug, PartialEq)]
pub struct PackPlan {
    /// The arrangement of the store.
    pub layout: Layout,
    /// Greatest anonymous memory, at most what the options allow.
    pub memory_bytes: u64,
    /// Disk for scratch while packing, in the store's directory.
    pub scratch_bytes: u64,
    /// The store's voxels in all levels, uncompressed: it can hardly come out larger.
    pub output_bytes_at_most: u64,
    /// Per level, what its window holds and whether it is kept in memory.
    pub(crate) windows: Vec<WindowPlan>,
}

/// One level's window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct WindowPlan {
    /// Slices; 0 where there is no window.
    pub(crate) capacity: u32,
    pub(crate) bytes: u64,
    pub(crate) in_memory: bool,
}

/// How many encoded bricks may wait for their turn to be written.
pub(crate) fn bricks_ahead(threads: usize) -> u64 {
    2 * threads as u64 + 4
}

/// What packing `source` with these options needs.
///
/// # Errors
/// If the options contradict each other or allow too little memory.
pub fn plan(source: &dyn Source, options: &PackOptions) -> Result<PackPlan, PackError> {
    options.check()?;
    let info = source.info();
    let pyramid = Pyramid::new(info.extent, info.geometry.spacing.to_array(), options.edge);
    let layout = Layout::new(pyramid, info.times, info.channels, options.shard_edge);
    let mut windows = windows(&layout.pyramid, source.access(), info.voxel_type);
    let needed_bytes = fixed_bytes(&layout, info.voxel_type, options) + PROGRAM_BYTES;
    if needed_bytes > options.memory_bytes {
        return Err(PackError::Memory { needed_bytes, given_bytes: options.memory_bytes });
    }
    let mut memory_bytes = needed_bytes;
    for window in windows.iter_mut().rev() {
        window.in_memory = memory_bytes + window.bytes <= options.memory_bytes;
        memory_bytes += if window.in_memory { window.bytes } else { 0 };
    }
    let volumes = info.times as u64 * info.channels as u64;
    let voxels: u64 = layout.pyramid.levels().iter().map(|l| l.extent.volume()).sum();
    Ok(PackPlan {
        memory_bytes,
        scratch_bytes: windows.iter().filter(|w| !w.in_memory).map(|w| w.bytes).sum(),
        output_bytes_at_most: volumes.saturating_mul(voxels).saturating_mul(info.voxel_type.bytes() as u64),
        layout,
        windows,
    })
}

fn windows(pyramid: &Pyramid, access: Access, voxel_type: VoxelType) -> Vec<WindowPlan> {
    let edge = pyramid.edge();
    let window = |k: usize| {
        let level = pyramid.levels()[k];
        let capacity = match k {
            0 if access == Access::Box => 0,
            0 => 2 * edge,
            _ => edge,
        };
        let capacity = capacity.min(level.extent.z);
        let slice = level.extent.x as u64 * level.extent.y as u64 * voxel_type.bytes() as u64;
        WindowPlan { capacity, bytes: slice * capacity as u64, in_memory: true }
    };
    (0..pyramid.levels().len()).map(window).collect()
}

fn fixed_bytes(layout: &Layout, voxel_type: VoxelType, options: &PackOptions) -> u64 {
    let (threads, edge) = (options.threads as u64, options.edge as usize);
    let codec = BrickCodec::new(options.codec, voxel_type, options.edge);
    let buffers = Workspace::<u8>::bytes(edge, voxel_type.bytes()) as u64;
    // The shuffled core, and Zstandard's tables for inputs of at most 64 MiB by level.
    let compressor = codec.core_bytes() as u64
        + match options.codec {
            Codec::None => 0,
            Codec::Zstd(level) | Codec::ShuffleZstd(level) => match level {
                ..=4 => 3 * MIB,
                5..=9 => 12 * MIB,
                _ => 48 * MIB,
            },
        };
    let in_flight = (bricks_ahead(options.threads) + threads + 2) * codec.encoded_cap();
    let volumes = layout.times as u64 * layout.channels as u64;
    let bricks = volumes * layout.pyramid.brick_count() * (4 * voxel_type.bytes() as u64 + 40);
    let open_shards: u64 = (0..layout.pyramid.levels().len())
        .map(|k| {
            let grid = layout.shard_grid(Level(k as u8));
            grid.x as u64 * grid.y as u64 * layout.shard_bricks(Level(k as u8)).volume()
        })
        .sum();
    let channels = layout.channels as u64 * (MIB / 2);
    threads * (buffers + compressor) + in_flight + bricks + open_shards * OPEN_BYTES_PER_BRICK as u64 + channels
}
