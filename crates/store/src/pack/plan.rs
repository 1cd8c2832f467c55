//! What a pack will need, before it starts.
//!
//! ```text
//! memory = fixed + windows kept in memory + 24 MiB (program, stacks, allocator)
//! fixed  = threads * (buffers(edge) + compressor) + (3 threads + 6) * greatest encoded brick
//!        + bricks of all stages * (4 voxels + 40 bytes) + open shards' indexes + channels' counts
//! stages = level 0, and levels k >= 1 of each pyramid
//! window of level k = capacity_k * x_k * y_k * voxel bytes
//! capacity_k = edge                                                  (k >= 1: packed as soon as it is full)
//! capacity_0 = 2 edge for sources that decode whole planes, none for those that read boxes
//! ```
//!
//! Where aprons are stored, the second pass has no windows, and needs instead
//!
//! ```text
//! threads * (core + apron + compressor) + bricks of all stages * (2 voxels + 40 bytes)
//!        + a shard's layer of encoded aprons + shells (at least those of a shard's layer and its neighbours) + 24 MiB
//! ```
//!
//! The greater of both counts. Windows are kept in memory, the smallest first, as far as `memory_bytes` reaches; the others are
//! rings of the same size in a scratch file. So `fixed` is the least memory a pack needs, however large the planes are.

use crate::codec::{BrickCodec, Codec};
use crate::downsample::{Downsample, Reductions};
use crate::layout::Layout;
use crate::pack::brick::Workspace;
use crate::pack::shards::OPEN_BYTES_PER_BRICK;
use crate::pack::shells::ApronMaker;
use crate::pack::{PackError, PackOptions};
use crate::stats::ChannelTotals;
use brickyard_import::{Access, Source};
use brickyard_volume::{Level, LevelGrid, Pyramid, VoxelType};

const MIB: u64 = 1 << 20;
const PROGRAM_BYTES: u64 = 24 * MIB;
/// A kept shell's place in the table of shells, and what the allocator adds.
const SHELL_ENTRY_BYTES: u64 = 160;

/// What a pack needs.
#[derive(Clone, Debug, PartialEq)]
pub struct PackPlan {
    /// The arrangement of the store's main pyramid.
    pub layout: Layout,
    /// Greatest anonymous memory, at most what the options allow.
    pub memory_bytes: u64,
    /// Disk for scratch while packing, in the store's directory.
    pub scratch_bytes: u64,
    /// The store's voxels in all levels, and in aprons, uncompressed: it can hardly come out larger.
    pub output_bytes_at_most: u64,
    /// Of that, those in aprons.
    pub(crate) apron_bytes: u64,
    /// Shells that the second pass keeps in memory.
    pub(crate) shells: usize,
    /// Level 0, then levels 1 and up of the main pyramid, then those of the second: each after the one it follows from.
    pub(crate) stages: Vec<Stage>,
}

/// One level of one pyramid.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Stage {
    /// The arrangement of its pyramid.
    pub(crate) layout: Layout,
    pub(crate) level: Level,
    /// The finer stage that its voxels follow from, and how; none at level 0.
    pub(crate) from: Option<(usize, Downsample)>,
    pub(crate) window: WindowPlan,
}

impl Stage {
    /// Its extent and brick grid.
    pub(crate) fn grid(&self) -> &LevelGrid {
        self.layout.pyramid.level(self.level)
    }
}

/// One stage's window.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct WindowPlan {
    /// Slices; 0 where there is no window.
    pub(crate) capacity: u32,
    pub(crate) bytes: u64,
    pub(crate) in_memory: bool,
}

impl PackPlan {
    /// The stages that follow from stage `s`, and how.
    pub(crate) fn coarser(&self, s: usize) -> impl Iterator<Item = (usize, Downsample)> {
        let follows =
            move |(i, stage): (usize, &Stage)| stage.from.filter(|(from, _)| *from == s).map(|(_, how)| (i, how));
        self.stages.iter().enumerate().filter_map(follows)
    }

    /// Shards of all stages, steps and channels, those of aprons included.
    pub(crate) fn shard_count(&self) -> u64 {
        if self.apron_bytes > 0 { 2 * self.core_shard_count() } else { self.core_shard_count() }
    }

    /// Shards of cores of all stages, steps and channels.
    pub(crate) fn core_shard_count(&self) -> u64 {
        let shards = |stage: &Stage| stage.layout.shard_grid(stage.level).volume();
        self.volumes() * self.stages.iter().map(shards).sum::<u64>()
    }

    /// Bricks of all stages, steps and channels.
    pub(crate) fn brick_count(&self) -> u64 {
        self.volumes() * self.stages.iter().map(|stage| stage.grid().bricks.volume()).sum::<u64>()
    }

    /// Voxels of level 0, all steps and channels.
    pub(crate) fn input_voxels(&self) -> u64 {
        self.volumes() * self.stages[0].grid().extent.volume()
    }

    fn volumes(&self) -> u64 {
        self.layout.times as u64 * self.layout.channels as u64
    }
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
    let stages = stages(&layout, source.access(), info.voxel_type, options.downsample);
    let voxels: u64 = stages.iter().map(|stage| stage.grid().extent.volume()).sum();
    let mut plan = PackPlan {
        layout,
        memory_bytes: 0,
        scratch_bytes: 0,
        output_bytes_at_most: 0,
        apron_bytes: 0,
        shells: 0,
        stages,
    };
    let core_bytes = plan.volumes().saturating_mul(voxels).saturating_mul(info.voxel_type.bytes() as u64);
    let maker = options.apron().map(|apron| ApronMaker { apron, voxel_bytes: info.voxel_type.bytes() });
    plan.apron_bytes = maker.map_or(0, |maker| plan.brick_count().saturating_mul(maker.apron_bytes() as u64));
    plan.output_bytes_at_most = core_bytes.saturating_add(plan.apron_bytes);
    let streaming = fixed_bytes(&plan, info.voxel_type, options) + PROGRAM_BYTES;
    let apron_pass = maker.map(|maker| ApronMemory::new(&plan, maker, info.voxel_type, options));
    let needed_bytes = streaming.max(apron_pass.as_ref().map_or(0, ApronMemory::least));
    if needed_bytes > options.memory_bytes {
        return Err(PackError::Memory { needed_bytes, given_bytes: options.memory_bytes });
    }
    plan.memory_bytes = streaming;
    let mut windows: Vec<&mut WindowPlan> = plan.stages.iter_mut().map(|stage| &mut stage.window).collect();
    windows.sort_by_key(|window| window.bytes);
    for window in windows {
        window.in_memory = plan.memory_bytes + window.bytes <= options.memory_bytes;
        let total = if window.in_memory { &mut plan.memory_bytes } else { &mut plan.scratch_bytes };
        *total += window.bytes;
    }
    if let Some(memory) = apron_pass {
        let shells = memory.shells_within(options.memory_bytes);
        plan.shells = shells as usize;
        plan.memory_bytes = plan.memory_bytes.max(memory.with(shells));
    }
    Ok(plan)
}

/// What the pass for aprons needs.
struct ApronMemory {
    /// Whatever it keeps.
    fixed: u64,
    shell: u64,
    /// Shells that it must keep at a time, and those there are in all of a level.
    least_shells: u64,
    most_shells: u64,
}

impl ApronMemory {
    fn new(plan: &PackPlan, maker: ApronMaker, voxel_type: VoxelType, options: &PackOptions) -> Self {
        let core = BrickCodec::new(options.codec, voxel_type, options.edge).core_bytes() as u64;
        let encoded = BrickCodec::of_aprons(options.codec, voxel_type, maker.apron).encoded_cap();
        let in_layer = |stage: &Stage| {
            let size = stage.layout.shard_bricks(stage.level);
            size.x as u64 * size.y as u64
        };
        let most = |of: fn(&Stage) -> u64| plan.stages.iter().map(of).max().unwrap_or(0);
        let threads =
            options.threads as u64 * (core + maker.apron_bytes() as u64 + compressor_bytes(core, options.codec));
        let bricks = plan.brick_count() * (2 * voxel_type.bytes() as u64 + 40);
        Self {
            fixed: threads + bricks + most(in_layer) * encoded + PROGRAM_BYTES,
            shell: maker.shell_bytes() as u64 + SHELL_ENTRY_BYTES,
            least_shells: most(least_shells),
            most_shells: plan.volumes() * most(|stage| stage.grid().bricks.volume()),
        }
    }

    fn with(&self, shells: u64) -> u64 {
        self.fixed + shells * self.shell
    }

    fn least(&self) -> u64 {
        self.with(self.least_shells)
    }

    fn shells_within(&self, memory_bytes: u64) -> u64 {
        (memory_bytes.saturating_sub(self.fixed) / self.shell).min(self.most_shells)
    }
}

fn stages(layout: &Layout, access: Access, voxel_type: VoxelType, reductions: Reductions) -> Vec<Stage> {
    let edge = layout.pyramid.edge();
    let stage = |layout: &Layout, k: usize, from| {
        let extent = layout.pyramid.levels()[k].extent;
        let capacity = match k {
            0 if access == Access::Box => 0,
            0 => 2 * edge,
            _ => edge,
        };
        let capacity = capacity.min(extent.z);
        let bytes = extent.x as u64 * extent.y as u64 * voxel_type.bytes() as u64 * capacity as u64;
        let window = WindowPlan { capacity, bytes, in_memory: true };
        Stage { layout: layout.clone(), level: Level(k as u8), from, window }
    };
    let mut stages = vec![stage(layout, 0, None)];
    let second = reductions.second().map(|method| (layout.of_second(method), method));
    for (layout, method) in [(layout.clone(), reductions.main())].into_iter().chain(second) {
        for k in 1..layout.pyramid.levels().len() {
            let finer = if k == 1 { 0 } else { stages.len() - 1 };
            stages.push(stage(&layout, k, Some((finer, method))));
        }
    }
    stages
}

fn fixed_bytes(plan: &PackPlan, voxel_type: VoxelType, options: &PackOptions) -> u64 {
    let (threads, edge) = (options.threads as u64, options.edge as usize);
    let codec = BrickCodec::new(options.codec, voxel_type, options.edge);
    let buffers = Workspace::<u8>::bytes(edge, voxel_type.bytes()) as u64;
    let compressor = compressor_bytes(codec.core_bytes() as u64, options.codec);
    let in_flight = (bricks_ahead(options.threads) + threads + 2) * codec.encoded_cap();
    let bricks = plan.brick_count() * (4 * voxel_type.bytes() as u64 + 40);
    let open_shards = |stage: &Stage| {
        let grid = stage.layout.shard_grid(stage.level);
        grid.x as u64 * grid.y as u64 * stage.layout.shard_bricks(stage.level).volume()
    };
    let indexes = plan.stages.iter().map(open_shards).sum::<u64>() * OPEN_BYTES_PER_BRICK as u64;
    let channels =
        plan.layout.channels as u64 * ChannelTotals::bytes(voxel_type) + ChannelTotals::adding_bytes(voxel_type);
    threads * (buffers + compressor) + in_flight + bricks + indexes + channels
}

/// The shuffled core, and Zstandard's tables for inputs of at most 64 MiB by level.
fn compressor_bytes(core_bytes: u64, codec: Codec) -> u64 {
    let tables = match codec {
        Codec::None => 0,
        Codec::Zstd(level) | Codec::ShuffleZstd(level) => match level {
            ..=4 => 3 * MIB,
            5..=9 => 12 * MIB,
            _ => 48 * MIB,
        },
    };
    core_bytes + tables
}

/// The most bricks whose shells a layer of a shard needs at a time.
pub(crate) fn least_shells(stage: &Stage) -> u64 {
    let (size, grid) = (stage.layout.shard_bricks(stage.level).to_array(), stage.grid().bricks.to_array());
    let across = |a: usize, n: u32| grid[a].min(n + 2) as u64;
    across(0, size[0]) * across(1, size[1]) * across(2, 1)
}
