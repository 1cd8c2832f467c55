//! The needs of a pack, computed before it starts.
//!
//! ```text
//! memory = fixed + reading + windows kept in memory + 24 MiB (program, stacks, allocator)
//! fixed  = threads * (buffers(edge) + compressor) + (3 threads + 6) * greatest encoded brick
//!        + side data under way + open shards' indexes + channels' counts (twice for an appended step)
//! open shards = those of a layer of each stage, 24 bytes a brick; if they hold several time steps, all of each stage that hold one step,
//!        over all channels, 24 bytes and a place in a hash table (20 to 40) for each brick of each of their steps; 16 bytes a brick of one shard
//! side data = at most 20 layers of each stage's bricks * (4 voxels + 16 bytes), 16 of its shards * 16 bytes; if shards hold several time
//!        steps, as many steps' pages of all channels, and those of one file while they are joined
//! stages = level 0, and levels k >= 1 of each pyramid
//! reading = the needs of the source's reader                         (one thread reads whole planes, into the window)
//!         = threads * the needs of the source's reader               (sources that read boxes)
//! window of level k = layers_k * min(edge, z_k) * x_k * y_k * voxel bytes
//! layers_k = 1                                                       (k >= 1: packed as soon as it is full)
//! layers_0 = 2 for sources that decode whole planes (one is packed, one filled), none for those that read boxes
//! ```
//!
//! With stored aprons, the second pass has no windows, and needs instead
//!
//! ```text
//! threads * (core + apron + compressor) + the caches of an open store
//!        + a shard's layer of encoded aprons + an open shard's index + shells (at least those of a shard's layer and its neighbours) + 24 MiB
//! ```
//!
//! The greater of both counts. Windows are kept in memory, the smallest first, up to `memory_bytes`; the others are
//! rings of the same size in a scratch file. So `fixed + reading` is the least memory for a pack.

use crate::chunks;
use crate::codec::{BrickCodec, Codec};
use crate::downsample::{Downsample, Reductions};
use crate::layout::{Layout, ShardId, check_shard_bricks, check_size};
use crate::pack::brick::Workspace;
use crate::pack::shards::{finishing_bytes, open_bytes};
use crate::pack::shells::ApronMaker;
use crate::pack::{PackError, PackOptions};
use crate::shard::Fingerprint;
use crate::shard_file::IoMode;
use crate::side::level_files;
use crate::stats::ChannelTotals;
use brickyard_import::{Access, Source, SourceInfo};
use brickyard_volume::units::{axis_unit, free_unit};
use brickyard_volume::{Extent, Level, LevelGrid, PAGE_EDGE_BRICKS, Paging, Pyramid, VoxelType};
use std::ops::Range;

const MIB: u64 = 1 << 20;
const PROGRAM_BYTES: u64 = 24 * MIB;
/// Most channels; their statistics keep the root document below its size limit.
const MAX_CHANNELS: u32 = 4096;
/// Most times of single steps; they take at most a third of a document's size limit.
pub(crate) const MAX_STAMPS: usize = 1 << 19;
/// Exceeds the ratio of any level's voxel size to level 0's.
const MOST_FACTOR: f64 = (1u64 << 33) as f64;
/// A cached shell's table entry, with the allocator's overhead.
const SHELL_ENTRY_BYTES: u64 = 160;

/// Memory and disk space for a pack, and the layout of its store.
#[derive(Clone, Debug, PartialEq)]
pub struct PackPlan {
    /// The layout of the store's main pyramid.
    pub layout: Layout,
    /// The packed time steps.
    pub(crate) steps: Range<u32>,
    /// Most anonymous memory of the pack, in bytes; within the options' limit.
    pub memory_bytes: u64,
    /// Bytes of scratch files in the store's directory during the pack.
    pub scratch_bytes: u64,
    /// Most bytes of the source's scratch files, in a folder of its own, for compressed inputs.
    pub input_scratch_bytes: u64,
    /// Uncompressed bytes of all levels and aprons. The store can hardly become larger.
    pub output_bytes_at_most: u64,
    /// Most files of the store: shards (those of zeros alone have none), side data and documents.
    pub files_at_most: u64,
    /// Uncompressed bytes of all aprons; 0 if none are stored.
    pub(crate) apron_bytes: u64,
    /// Shells cached by the second pass.
    pub(crate) shells: usize,
    /// Level 0, then levels 1 and up of the main pyramid, then those of the second one.
    pub(crate) stages: Vec<Stage>,
}

/// One level of one pyramid.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Stage {
    pub(crate) layout: Layout,
    pub(crate) level: Level,
    /// The finer stage and the reduction; `None` at level 0.
    pub(crate) from: Option<(usize, Downsample)>,
    pub(crate) window: WindowPlan,
}

impl Stage {
    /// The extent and brick grid of the stage's level.
    pub(crate) fn grid(&self) -> &LevelGrid {
        self.layout.pyramid.level(self.level)
    }
}

/// The size of one stage's window, and whether it is kept in memory.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct WindowPlan {
    /// Number of layers of bricks in the window; 0 if there is no window.
    pub(crate) layers: u32,
    pub(crate) bytes: u64,
    pub(crate) in_memory: bool,
}

impl PackPlan {
    /// The stages made from stage `s`, with their reductions.
    pub(crate) fn coarser(&self, s: usize) -> impl Iterator<Item = (usize, Downsample)> {
        let follows =
            move |(i, stage): (usize, &Stage)| stage.from.filter(|(from, _)| *from == s).map(|(_, how)| (i, how));
        self.stages.iter().enumerate().filter_map(follows)
    }

    /// A level's shards for the packed time steps, in order.
    pub(crate) fn shards<'a>(&self, layout: &'a Layout, level: Level) -> impl Iterator<Item = ShardId> + use<'a> {
        let of_group = layout.channels as u64 * layout.shard_grid(level).volume();
        let groups = self.groups();
        let shards = groups.start as u64 * of_group..groups.end as u64 * of_group;
        shards.map(move |i| layout.shard_at(level, i))
    }

    /// Number of shards of all stages, time steps and channels, including aprons'.
    pub(crate) fn shard_count(&self) -> u64 {
        if self.apron_bytes > 0 { 2 * self.core_shard_count() } else { self.core_shard_count() }
    }

    /// Number of shards of cores, over all stages, time steps and channels.
    pub(crate) fn core_shard_count(&self) -> u64 {
        let shards = |stage: &Stage| stage.layout.shard_grid(stage.level).volume();
        let volumes = self.groups().len() as u64 * self.layout.channels as u64;
        volumes * self.stages.iter().map(shards).sum::<u64>()
    }

    /// Number of bricks of all stages, time steps and channels.
    pub(crate) fn brick_count(&self) -> u64 {
        self.volumes() * self.stages.iter().map(|stage| stage.grid().bricks.volume()).sum::<u64>()
    }

    /// Number of voxels of level 0, over all time steps and channels.
    pub(crate) fn input_voxels(&self) -> u64 {
        self.volumes() * self.stages[0].grid().extent.volume()
    }

    /// The groups of packed time steps. The first step begins one.
    fn groups(&self) -> Range<u32> {
        let steps = self.layout.shard_times;
        self.steps.start / steps..self.steps.end.div_ceil(steps)
    }

    fn volumes(&self) -> u64 {
        self.steps.len() as u64 * self.layout.channels as u64
    }
}

/// Number of encoded bricks that may wait to be written.
pub(crate) fn bricks_ahead(threads: usize) -> u64 {
    2 * threads as u64 + 4
}

/// Computes the needs of packing `source` with these options.
///
/// # Errors
/// If options are out of range or contradictory, their memory is too little, or no store can hold the source.
pub fn plan(source: &dyn Source, options: &PackOptions) -> Result<PackPlan, PackError> {
    options.check()?;
    check_input(source.info())?;
    within_memory(Draft::new(source, options)?, source, options)
}

/// Computes the needs of packing `source` as the last steps of a store with the resulting layout.
///
/// # Errors
/// As for [`plan`].
pub(crate) fn plan_last(source: &dyn Source, options: &PackOptions, layout: &Layout) -> Result<PackPlan, PackError> {
    options.check()?;
    check_input(source.info())?;
    if let Err((_, expected)) = check_size(source.info().extent, layout.times, layout.channels) {
        let found = format!("{:?} in {} steps", source.info().extent.to_array(), layout.times);
        return Err(PackError::Unfit { what: "shape is", found, expected, cure: "begin another store" });
    }
    within_memory(Draft::of_last(source, options, layout.clone()), source, options)
}

/// Selects the windows to keep in memory.
fn within_memory(draft: Draft, source: &dyn Source, options: &PackOptions) -> Result<PackPlan, PackError> {
    let needed_bytes = draft.least();
    if needed_bytes > options.memory_bytes {
        let advice = advice(source, options);
        return Err(PackError::Memory { needed_bytes, given_bytes: options.memory_bytes, advice });
    }
    let Draft { mut plan, streaming, aprons } = draft;
    plan.memory_bytes = streaming;
    let mut windows: Vec<&mut WindowPlan> = plan.stages.iter_mut().map(|stage| &mut stage.window).collect();
    windows.sort_by_key(|window| window.bytes);
    for window in windows {
        window.in_memory = plan.memory_bytes + window.bytes <= options.memory_bytes;
        let total = if window.in_memory { &mut plan.memory_bytes } else { &mut plan.scratch_bytes };
        *total += window.bytes;
    }
    if let Some(memory) = aprons {
        let shells = memory.shells_within(options.memory_bytes);
        plan.shells = shells as usize;
        plan.memory_bytes = plan.memory_bytes.max(memory.with(shells));
    }
    Ok(plan)
}

/// Refuses inputs that could be packed but not opened.
pub(crate) fn check_input(info: &SourceInfo) -> Result<(), PackError> {
    let unfit = |what, found: String, expected: &str, cure| {
        Err(PackError::Unfit { what, found, expected: expected.into(), cure })
    };
    if let Err((_, expected)) = check_size(info.extent, info.times, info.channels) {
        let found = format!("{:?} in {} steps and {} channels", info.extent.to_array(), info.times, info.channels);
        return unfit("shape is", found, &expected, "pack a part of it");
    }
    if info.channels > MAX_CHANNELS {
        let expected = format!("at most {MAX_CHANNELS}");
        return unfit("channels are", info.channels.to_string(), &expected, "pack a part of them");
    }
    let (spacing, origin) = (info.geometry.spacing, info.geometry.origin);
    // Every level's placement must be finite and resolve the voxel size.
    let (scale, corner) = (spacing * MOST_FACTOR, origin + spacing * MOST_FACTOR);
    if !(scale.is_finite() && spacing.min_element() >= f64::MIN_POSITIVE) {
        let found = format!("{:?} (x, y, z)", spacing.to_array());
        return unfit("voxel spacing is", found, "positive, finite numbers", "give it with `spacing` X,Y,Z");
    }
    if !corner.is_finite() {
        let found = format!("{:?} (x, y, z)", origin.to_array());
        return unfit("origin is", found, "finite numbers", "give it with `origin` X,Y,Z");
    }
    if let Some(nodata) = info.nodata.filter(|&nodata| !info.voxel_type.holds(nodata)) {
        let expected = format!("a value within {}", info.voxel_type);
        return unfit("value for no data is", nodata.to_string(), &expected, "choose another with `nodata`");
    }
    let units = info.channel_looks.iter().filter_map(|look| look.unit.as_deref());
    if let Some((unit, expected)) = units.filter_map(|unit| Some((unit, free_unit(unit).err()?))).next() {
        return unfit("unit of values is", format!("{unit:?}"), &expected, "give it with `value_unit`");
    }
    let units = info.geometry.axis_units.iter().flatten();
    if let Some((unit, expected)) = units.filter_map(|unit| Some((unit, axis_unit(unit).err()?))).next() {
        return unfit("unit of an axis is", format!("{unit:?}"), &expected, "give it with `unit`");
    }
    let stamps = info.time.as_ref().map_or(0, |axis| axis.stamps.len());
    if stamps > MAX_STAMPS {
        let expected = format!("at most {MAX_STAMPS}");
        return unfit("times of steps are", stamps.to_string(), &expected, "give evenly spaced steps with `time_step`");
    }
    if let Some(Err(problem)) = info.time.as_ref().map(|axis| axis.check(info.times)) {
        let found = format!("{}: {}", problem.field, problem.found);
        return unfit("time axis has", found, &problem.expected, "give another with `time_step` or `time_stamps`");
    }
    if let Some(Err(error)) = info.orientation.map(|orientation| orientation.placement(&info.geometry)) {
        let expected = "a valid one for the voxel spacing";
        return unfit("orientation has", error.to_string(), expected, "correct its header, or give `spacing` X,Y,Z");
    }
    Ok(())
}

/// A plan before windows are placed, with the least memory of its two passes.
struct Draft {
    plan: PackPlan,
    streaming: u64,
    aprons: Option<ApronMemory>,
}

impl Draft {
    fn new(source: &dyn Source, options: &PackOptions) -> Result<Self, PackError> {
        let info = source.info();
        let pyramid = Pyramid::new(info.extent, info.geometry.spacing.to_array(), options.edge);
        let layout = Layout::new(pyramid, info.times, info.channels, options.shard_edge);
        let layout = layout.with_shard_times(options.shard_times);
        check_shard_bricks(&layout).map_err(|(field, expected)| {
            let found = if field == "shard" { options.shard_edge } else { layout.shard_times };
            PackError::Options(format!("`{field}` {found}: expected {expected}"))
        })?;
        // A source with a step's time is meant to have more steps.
        let layout = if info.time.is_some() { layout.with_time() } else { layout };
        Ok(Self::of_last(source, options, layout))
    }

    /// The plan for the last steps of a store with this layout.
    fn of_last(source: &dyn Source, options: &PackOptions, layout: Layout) -> Self {
        let info = source.info();
        let steps = layout.times - info.times..layout.times;
        let stages = stages(&layout, source.access(), info.voxel_type, options.downsample);
        let voxels: u64 = stages.iter().map(|stage| stage.grid().extent.volume()).sum();
        let mut plan = PackPlan {
            layout,
            steps,
            memory_bytes: 0,
            scratch_bytes: 0,
            input_scratch_bytes: source.scratch_bytes(),
            output_bytes_at_most: 0,
            files_at_most: 0,
            apron_bytes: 0,
            shells: 0,
            stages,
        };
        let core_bytes = plan.volumes().saturating_mul(voxels).saturating_mul(info.voxel_type.bytes() as u64);
        let maker = options.apron().map(|apron| ApronMaker { apron, voxel_bytes: info.voxel_type.bytes() });
        plan.apron_bytes = maker.map_or(0, |maker| plan.brick_count().saturating_mul(maker.apron_bytes() as u64));
        plan.output_bytes_at_most = core_bytes.saturating_add(plan.apron_bytes);
        let of_level = |stage: &Stage| level_files(&stage.layout, stage.level, info.voxel_type, plan.apron_bytes > 0);
        let side_files = plan.stages.iter().map(of_level).fold(0, u64::saturating_add);
        // And the root document.
        plan.files_at_most = plan.shard_count().saturating_add(side_files).saturating_add(1);
        let streaming = fixed_bytes(&plan, info.voxel_type, options)
            .saturating_add(reading_bytes(source, options))
            .saturating_add(PROGRAM_BYTES);
        let aprons = maker.map(|maker| ApronMemory::new(&plan, maker, info.voxel_type, options));
        Self { plan, streaming, aprons }
    }

    fn least(&self) -> u64 {
        self.streaming.max(self.aprons.as_ref().map_or(0, ApronMemory::least))
    }
}

/// The nearest fitting options, in words: fewer time steps per shard, fewer threads, or else other bricks.
fn advice(source: &dyn Source, options: &PackOptions) -> String {
    let fits = |options: &PackOptions| {
        let is_enough = |draft: Draft| draft.least() <= options.memory_bytes;
        options.check().is_ok() && Draft::new(source, options).is_ok_and(is_enough)
    };
    let threads = (1..options.threads).rev().map(|threads| PackOptions { threads, ..options.clone() }).find(fits);
    let mut edges: Vec<u32> = (3..=8).map(|n| 1 << n).filter(|&edge| edge != options.edge).collect();
    edges.sort_by_key(|edge| edge.ilog2().abs_diff(options.edge.ilog2()));
    let with_threads = |threads| edges.iter().map(|&edge| PackOptions { edge, threads, ..options.clone() }).find(fits);
    let half = |steps: &u32| Some(steps / 2).filter(|&steps| steps > 0);
    let steps = std::iter::successors(half(&options.shard_times.min(source.info().times)), half)
        .find(|&shard_times| fits(&PackOptions { shard_times, ..options.clone() }))
        .map(|steps| format!(", or put fewer time steps in a shard (`shard_times` {steps})"));
    let others = match (threads, with_threads(options.threads)) {
        (Some(PackOptions { threads, .. }), Some(PackOptions { edge, .. })) => {
            format!(", or use fewer threads (`threads` {threads}) or other bricks (`edge` {edge})")
        }
        (Some(PackOptions { threads, .. }), None) => format!(", or use fewer threads (`threads` {threads})"),
        (None, Some(PackOptions { edge, .. })) => format!(", or use other bricks (`edge` {edge})"),
        (None, None) => with_threads(1).map_or_else(String::new, |PackOptions { edge, .. }| {
            format!(", or use one thread and other bricks (`threads` 1 `edge` {edge})")
        }),
    };
    steps.unwrap_or_default() + &others
}

/// Memory of the pass for aprons.
struct ApronMemory {
    /// Independent of the number of shells.
    fixed: u64,
    shell: u64,
    /// Least shells at a time, and the total of a level.
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
        let most = |of: &dyn Fn(&Stage) -> u64| plan.stages.iter().map(of).max().unwrap_or(0);
        let shard_bytes =
            |stage: &Stage| open_bytes(&stage.layout, stage.level) + finishing_bytes(&stage.layout, stage.level);
        let threads =
            options.threads as u64 * (core + maker.apron_bytes() as u64 + compressor_bytes(core, options.codec));
        let chunks = |stage: &Stage| chunks::cache_bytes(&stage.layout, IoMode::Mmap);
        Self {
            fixed: threads + most(&chunks) + most(&in_layer) * encoded + most(&shard_bytes) + PROGRAM_BYTES,
            shell: maker.shell_bytes() as u64 + SHELL_ENTRY_BYTES,
            least_shells: most(&least_shells),
            most_shells: plan.volumes() * most(&|stage: &Stage| stage.grid().bricks.volume()),
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
        let LevelGrid { extent, bricks, .. } = layout.pyramid.levels()[k];
        let layers = match k {
            0 if access == Access::Box => 0,
            0 => bricks.z.min(2),
            _ => 1,
        };
        let slices = layers as u64 * edge.min(extent.z) as u64;
        let bytes = extent.x as u64 * extent.y as u64 * voxel_type.bytes() as u64 * slices;
        let window = WindowPlan { layers, bytes, in_memory: true };
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
    let voxel_bytes = voxel_type.bytes() as u64;
    let of_stage =
        |stage: &Stage| waiting_bytes(stage, voxel_bytes).saturating_add(held_page_bytes(stage, voxel_bytes));
    let joined = plan.stages.iter().map(|stage| page_file_bytes(stage, voxel_bytes)).max();
    let side_data = plan.stages.iter().map(of_stage).fold(joined.unwrap_or(0), u64::saturating_add);
    let open = |stage: &Stage| open_shards(stage).saturating_mul(open_bytes(&stage.layout, stage.level));
    let finishing = plan.stages.iter().map(|stage| finishing_bytes(&stage.layout, stage.level)).max();
    let indexes = plan.stages.iter().map(open).fold(finishing.unwrap_or(0), u64::saturating_add);
    // Counts with an appended step, and without it.
    let countings = if plan.steps.start > 0 { 2 } else { 1 };
    let channels = countings * plan.layout.channels as u64 * ChannelTotals::bytes(voxel_type)
        + ChannelTotals::adding_bytes(voxel_type);
    (threads * (buffers + compressor) + in_flight + channels).saturating_add(side_data).saturating_add(indexes)
}

/// Shards of a stage open at a time: those of one layer, or with several time steps, all with the current step.
fn open_shards(stage: &Stage) -> u64 {
    let grid = stage.layout.shard_grid(stage.level);
    match stage.layout.shard_times {
        1 => grid.x as u64 * grid.y as u64,
        _ => grid.volume() * stage.layout.channels as u64,
    }
}

/// Memory of an open source, and of the threads reading it.
fn reading_bytes(source: &dyn Source, options: &PackOptions) -> u64 {
    let by_threads = match source.access() {
        Access::Planes => source.reader_bytes(),
        Access::Box => source.reader_bytes().saturating_mul(options.threads as u64),
    };
    source.held_bytes().saturating_add(by_threads)
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

/// Most shells needed for one layer of a shard's bricks: its own and its neighbours'.
pub(crate) fn least_shells(stage: &Stage) -> u64 {
    let (size, grid) = (stage.layout.shard_bricks(stage.level).to_array(), stage.grid().bricks.to_array());
    let across = |a: usize, n: u32| grid[a].min(n + 2) as u64;
    across(0, size[0]) * across(1, size[1]) * across(2, 1)
}

/// Most bytes per encoded page in memory besides its content: path, and overhead of compression, checksum and
/// allocator.
const PAGE_ENTRY_BYTES: u64 = 128;

/// Bytes of a stage's pages waiting for other time steps of their files, at `voxel_bytes` a voxel.
fn held_page_bytes(stage: &Stage, voxel_bytes: u64) -> u64 {
    let Layout { shard_times, channels, .. } = stage.layout;
    if shard_times == 1 {
        return 0;
    }
    let paging = Paging::new(stage.grid().bricks);
    let cells = paging.page_cells() as u64;
    let of_page = cells * (4 * voxel_bytes + size_of::<u128>() as u64) + 2 * PAGE_ENTRY_BYTES;
    (paging.page_grid().volume() * shard_times as u64 * channels as u64).saturating_mul(of_page)
}

/// Bytes of a file with several time steps' pages of a stage.
fn page_file_bytes(stage: &Stage, voxel_bytes: u64) -> u64 {
    let steps = stage.layout.shard_times as u64;
    let cells = Paging::new(stage.grid().bricks).page_cells() as u64;
    let of_page = cells * (4 * voxel_bytes).max(size_of::<u128>() as u64) + PAGE_ENTRY_BYTES;
    if steps == 1 { 0 } else { steps.saturating_mul(of_page) }
}

/// Most layers of bricks waiting for neighbours and children.
const WAITING_LAYERS: u32 = 4;

/// Bytes of a stage's side data under way, at `voxel_bytes` a voxel.
fn waiting_bytes(stage: &Stage, voxel_bytes: u64) -> u64 {
    let (bricks, shards) = (stage.grid().bricks, stage.layout.shard_grid(stage.level));
    let cells = |grid: Extent, layers: u32| grid.x as u64 * grid.y as u64 * grid.z.min(layers) as u64;
    cells(bricks, PAGE_EDGE_BRICKS + WAITING_LAYERS) * (4 * voxel_bytes + size_of::<u128>() as u64)
        + cells(shards, PAGE_EDGE_BRICKS) * size_of::<Fingerprint>() as u64
}
