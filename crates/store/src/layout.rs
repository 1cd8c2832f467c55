//! Mapping of bricks to files: axes, shard grids, paths, and the places of bricks and shards in the side data.
//! Arithmetic only.
//!
//! ```text
//! STORE/zarr.json                      root group, written last: the completion marker
//! STORE/.brickyard-journal             only while packing
//! STORE/.brickyard-lock                only while packing or appending, and after a killed process
//! STORE/K/zarr.json                    level K
//! STORE/K/c/[t/][c/]z/y/x              its shards (axes t and c only with more than one step or channel, or steps to be appended);
//!                                      t counts groups of time steps, whose bricks share shards
//! STORE/K/.brickyard/{ranges,hashes,shards}/   its side data
//! STORE/0/.brickyard/counts/N/C         counts of the values of channel C in the first N steps, in stores with appended steps
//! STORE/K/.brickyard/aprons/           the aprons of K's bricks, if stored: zarr.json, shards and .brickyard/shards
//! STORE/K/.brickyard/METHOD/           level K >= 1 of a second pyramid, which shares level 0: same contents as K above
//! ```

use crate::data_file::open_file;
use crate::downsample::Downsample;
use brickyard_volume::{BrickId, BrickIndex, Extent, Level, Pyramid};
use std::io::{BufRead, BufReader, Read};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Default limit of voxels along a shard's edge.
pub const DEFAULT_SHARD_EDGE: u32 = 512;

/// Upper limit of voxels along a shard's edge in any store.
pub const MAX_SHARD_EDGE: u32 = 8192;

/// Most bricks in a shard, over all of its time steps: as many as the largest shard has at an edge of 64 voxels a
/// brick. Their index takes 32 MiB.
const MAX_SHARD_BRICKS: u64 = (MAX_SHARD_EDGE as u64 / 64).pow(3);

/// Name of the journal, present in a store directory while a pack is unfinished. Its first line is a JSON object with
/// the total number of `shards`; each further complete line not starting with a blank is a finished shard.
pub const JOURNAL_NAME: &str = ".brickyard-journal";

/// Name of the lock file, present while a process packs into or appends to a store, and after it was killed. It names
/// the process and its machine.
pub const LOCK_NAME: &str = ".brickyard-lock";

/// Name of the side-data folder in a level's folder, ignored by other readers.
pub(crate) const SIDE_NAME: &str = ".brickyard";

/// The folder of an image's labels, each a store.
pub(crate) const LABELS_NAME: &str = "labels";

/// Folder of value counts, in the side data of level 0.
pub(crate) const COUNTS_NAME: &str = "counts";

/// Folder of a level's aprons, in its side data.
const APRONS_NAME: &str = "aprons";

/// An unacceptable setting: field name, and expected values.
pub(crate) type Unfit = (&'static str, String);

/// Checks the edge lengths in voxels, for packing and opening.
pub(crate) fn check_edges(edge: u32, shard: u32) -> Result<(), Unfit> {
    if !(8..=256).contains(&edge) || !edge.is_power_of_two() {
        return Err(("edge", "a power of two from 8 to 256".into()));
    }
    if !shard.is_multiple_of(edge) || !(edge..=MAX_SHARD_EDGE).contains(&shard) {
        return Err(("shard", format!("a multiple of the brick's edge, {edge}, at most {MAX_SHARD_EDGE}")));
    }
    Ok(())
}

/// Checks the total number of voxels, 1 to 2^63 - 1, for packing and opening.
pub(crate) fn check_size(extent: Extent, times: u32, channels: u32) -> Result<(), Unfit> {
    let voxels = extent.checked_volume().and_then(|v| v.checked_mul(times as u64)?.checked_mul(channels as u64));
    match voxels {
        Some(voxels) if (1..=i64::MAX as u64).contains(&voxels) => Ok(()),
        _ => Err(("shape", "at least one voxel, and fewer than 2^63".into())),
    }
}

/// Checks the number of bricks in a shard, whose index is in memory while open, for packing and opening.
pub(crate) fn check_shard_bricks(layout: &Layout) -> Result<(), Unfit> {
    let bricks = layout.shard_bricks(Level(0)).volume();
    if bricks > MAX_SHARD_BRICKS {
        return Err(("shard", format!("an edge of at most {MAX_SHARD_BRICKS} bricks a shard, not {bricks}")));
    }
    if bricks.saturating_mul(layout.shard_times.into()) > MAX_SHARD_BRICKS {
        let most = MAX_SHARD_BRICKS / bricks;
        return Err(("shard_times", format!("at most {most}, as a shard has {bricks} bricks of each time step")));
    }
    Ok(())
}

/// The key of one shard.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct ShardId {
    /// Index of the shard's group of time steps along t, not a time step.
    pub group: u32,
    /// The shard's channel.
    pub channel: u32,
    /// The shard's level.
    pub level: Level,
    /// Index in the level's shard grid along z.
    pub z: u32,
    /// Index in the level's shard grid along y.
    pub y: u32,
    /// Index in the level's shard grid along x.
    pub x: u32,
}

/// Arrangement of a store's bricks or their aprons in shards and files.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// The levels and their brick grids.
    pub pyramid: Pyramid,
    /// Number of time steps, at least 1.
    pub times: u32,
    /// Number of channels, at least 1.
    pub channels: u32,
    /// Time steps per group, sharing shards; from 1 to all. The last group may have fewer.
    pub(crate) shard_times: u32,
    /// Whether there is a time axis even with one step, for appending.
    has_time: bool,
    max_shard_bricks: u32,
    /// The method in folder names of a second pyramid's levels 1 and up.
    second: Option<Downsample>,
    /// Whether the chunks are the bricks' aprons.
    is_aprons: bool,
}

impl Layout {
    /// A layout with shards of one time step and at most `shard_edge` voxels along each axis, but at least one brick.
    pub fn new(pyramid: Pyramid, times: u32, channels: u32, shard_edge: u32) -> Self {
        let max_shard_bricks = (shard_edge / pyramid.edge()).max(1);
        Self {
            pyramid,
            times,
            channels,
            shard_times: 1,
            has_time: times > 1,
            max_shard_bricks,
            second: None,
            is_aprons: false,
        }
    }

    /// This layout with a time axis, even for one step.
    pub fn with_time(self) -> Self {
        Self { has_time: true, ..self }
    }

    /// This layout with `times` time steps.
    pub fn with_times(&self, times: u32) -> Self {
        Self { times, ..self.clone() }
    }

    /// This layout with `steps` time steps per shard, clamped between one and all.
    pub fn with_shard_times(self, steps: u32) -> Self {
        Self { shard_times: steps.clamp(1, self.times.max(1)), ..self }
    }

    /// This layout with levels 1 and up in the folders of a second pyramid, made by `method`.
    pub fn of_second(&self, method: Downsample) -> Self {
        Self { second: Some(method), ..self.clone() }
    }

    /// This layout for the bricks' aprons: the same shards, in folders of their own.
    pub fn of_aprons(&self) -> Self {
        Self { is_aprons: true, ..self.clone() }
    }

    /// The second pyramid's reduction; `None` for the main pyramid.
    pub fn second(&self) -> Option<Downsample> {
        self.second
    }

    /// Axes, slowest first: `t` only with [more than one time step, or steps to come](Layout::with_time), `c` only with
    /// more than one channel, then `z`, `y`, `x`.
    pub fn axes(&self) -> Vec<&'static str> {
        let t = self.has_time.then_some("t");
        let c = (self.channels > 1).then_some("c");
        t.into_iter().chain(c).chain(["z", "y", "x"]).collect()
    }

    /// Arranges values for t, c and `[x, y, z]` in the order of [`Layout::axes`].
    pub fn per_axis<T: Copy>(&self, t: T, c: T, [x, y, z]: [T; 3]) -> Vec<T> {
        let t = self.has_time.then_some(t);
        let c = (self.channels > 1).then_some(c);
        t.into_iter().chain(c).chain([z, y, x]).collect()
    }

    /// Bricks per shard along each axis, for one time step. Shards at the far faces may reach past the brick grid.
    pub fn shard_bricks(&self, level: Level) -> Extent {
        let bricks = self.pyramid.level(level).bricks.to_array();
        Extent::from_array(bricks.map(|n| n.min(self.max_shard_bricks)))
    }

    /// Index entries per shard of a level: one per brick and time step.
    pub fn shard_slots(&self, level: Level) -> usize {
        self.shard_times as usize * self.shard_bricks(level).volume() as usize
    }

    /// Number of groups of time steps, or shards along t.
    pub fn shard_groups(&self) -> u32 {
        self.times.div_ceil(self.shard_times)
    }

    /// The time steps of a group.
    pub fn steps_of(&self, group: u32) -> Range<u32> {
        let first = group.saturating_mul(self.shard_times);
        first.min(self.times)..first.saturating_add(self.shard_times).min(self.times)
    }

    /// Shards of a level along each spatial axis, for one group of time steps and one channel.
    pub fn shard_grid(&self, level: Level) -> Extent {
        let bricks = self.pyramid.level(level).bricks.to_array();
        let shard = self.shard_bricks(level).to_array();
        Extent::from_array(std::array::from_fn(|a| bricks[a].div_ceil(shard[a])))
    }

    /// The shard of a brick, and the brick's entry in its index.
    pub fn shard_of(&self, id: BrickId) -> (ShardId, usize) {
        let shard = self.shard_bricks(id.level);
        let (i, s) = (id.index.to_array(), shard.to_array());
        let [x, y, z] = std::array::from_fn(|a| i[a] / s[a]);
        let (group, step) = (id.time / self.shard_times, id.time % self.shard_times);
        let slot = step as u64 * shard.volume() + shard.linear(std::array::from_fn(|a| i[a] % s[a]));
        (ShardId { group, channel: id.channel, level: id.level, z, y, x }, slot as usize)
    }

    /// The brick of a shard's index entry `slot`; `None` past the grid or the last time step.
    pub fn brick_at(&self, shard: ShardId, slot: usize) -> Option<BrickId> {
        let bricks = self.shard_bricks(shard.level);
        let s = bricks.to_array();
        let (step, slot) = (slot as u64 / bricks.volume(), (slot as u64 % bricks.volume()) as u32);
        let time = shard.group.checked_mul(self.shard_times)?.checked_add(step.try_into().ok()?)?;
        let inner = [slot % s[0], slot / s[0] % s[1], slot / (s[0] * s[1])];
        let corner = [shard.x, shard.y, shard.z];
        let index: [u32; 3] = std::array::from_fn(|a| corner[a] * s[a] + inner[a]);
        let is_there = time < self.times && self.pyramid.level(shard.level).bricks.contains(index);
        is_there.then_some(BrickId {
            time,
            channel: shard.channel,
            level: shard.level,
            index: BrickIndex::from_array(index),
        })
    }

    /// All levels, finest first.
    pub(crate) fn levels(&self) -> impl DoubleEndedIterator<Item = Level> + use<> {
        (0..self.pyramid.levels().len()).map(|k| Level(k as u8))
    }

    /// All shards of a level, row-major in (t, c, z, y, x).
    pub fn shards(&self, level: Level) -> impl Iterator<Item = ShardId> {
        (0..self.level_shards(level)).map(move |i| self.shard_at(level, i))
    }

    /// Number of shards of a level, over all time steps and channels.
    pub fn level_shards(&self, level: Level) -> u64 {
        self.shard_groups() as u64 * self.channels as u64 * self.shard_grid(level).volume()
    }

    /// Shard number `i` of a level, counted row-major in (t, c, z, y, x).
    pub fn shard_at(&self, level: Level, i: u64) -> ShardId {
        let [group, channel, z, y, x] = place_at(i, self.channels, self.shard_grid(level));
        ShardId { group, channel, level, z, y, x }
    }

    /// Number of shards of all levels, time steps and channels.
    pub fn shard_count(&self) -> u64 {
        self.levels().map(|level| self.level_shards(level)).sum()
    }

    /// Path of a level's folder, or of its apron folder, relative to the store.
    pub fn level_path(&self, level: Level) -> String {
        let level = match self.second {
            Some(method) if level > Level(0) => format!("{level}/{SIDE_NAME}/{}", method.name()),
            _ => level.to_string(),
        };
        if self.is_aprons { format!("{level}/{SIDE_NAME}/{APRONS_NAME}") } else { level }
    }

    /// Path of the side-data folder of a level, or of its aprons.
    pub fn side_dir(&self, store: &Path, level: Level) -> PathBuf {
        store.join(self.level_path(level)).join(SIDE_NAME)
    }

    /// The path of a shard's file.
    pub fn shard_path(&self, store: &Path, id: ShardId) -> PathBuf {
        let mut path = store.join(self.level_path(id.level));
        path.push("c");
        path.extend(self.per_axis(id.group, id.channel, [id.x, id.y, id.z]).iter().map(u32::to_string));
        if self.is_aprons {
            // The last axis, over an apron's voxels, has one chunk.
            path.push("0");
        }
        path
    }

    /// Whether the store has the brick `id`.
    pub fn contains(&self, id: BrickId) -> bool {
        id.time < self.times
            && id.channel < self.channels
            && id.level <= self.pyramid.coarsest()
            && self.pyramid.level(id.level).bricks.contains(id.index.to_array())
    }
}

/// `[t, c, z, y, x]` of cell `i`, row-major over time steps or groups, `channels` channels and the cells of `grid`.
pub(crate) fn place_at(i: u64, channels: u32, grid: Extent) -> [u32; 5] {
    let (volume, cell) = (i / grid.volume(), i % grid.volume());
    let (gx, gy, channels) = (grid.x as u64, grid.y as u64, channels as u64);
    [volume / channels, volume % channels, cell / gx / gy, cell / gx % gy, cell % gx].map(|n| n as u32)
}

/// Packed share of an unfinished store by its journal, in percent, 0 to 99; `None` if unreadable.
pub fn journal_percent(store: &Path) -> Option<u8> {
    // Parts of longer lines, from foreign files, would count as lines.
    const LONGEST_LINE: u64 = 16 << 20;
    let mut journal = BufReader::new(open_file(&store.join(JOURNAL_NAME)).ok()?);
    let mut line = Vec::new();
    let mut next = |line: &mut Vec<u8>| {
        line.clear();
        journal.by_ref().take(LONGEST_LINE).read_until(b'\n', line).ok()
    };
    next(&mut line)?;
    let head: serde_json::Value = serde_json::from_slice(&line).ok()?;
    let total = head.get("shards")?.as_u64()?.max(1);
    let mut done: u64 = 0;
    while next(&mut line)? > 0 {
        done += u64::from(line.ends_with(b"\n") && !line.starts_with(b" "));
    }
    Some((done.saturating_mul(100) / total).min(99) as u8)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    fn layout(times: u32, channels: u32) -> Layout {
        Layout::new(Pyramid::new(Extent::new(100, 37, 211), [1.0; 3], 16), times, channels, 64)
    }

    #[test]
    fn bricks_and_shards_map_both_ways() {
        let l = layout(2, 3);
        for level in 0..l.pyramid.levels().len() {
            let level = Level(level as u8);
            let mut seen = HashSet::new();
            let shards: Vec<ShardId> = l.shards(level).collect();
            assert!(shards.is_sorted() && shards.len() as u64 == 6 * l.shard_grid(level).volume());
            for shard in shards {
                for slot in 0..l.shard_bricks(level).volume() as usize {
                    let Some(id) = l.brick_at(shard, slot) else { continue };
                    assert_eq!(l.shard_of(id), (shard, slot));
                    assert!(seen.insert(id));
                }
            }
            assert_eq!(seen.len() as u64, 6 * l.pyramid.level(level).bricks.volume());
        }
    }

    /// Whole groups and a partial last one; step counts past the total count as all.
    #[test]
    fn shards_of_several_time_steps_map_both_ways() {
        for (asked, steps, groups) in [(1, 1, 5), (2, 2, 3), (3, 3, 2), (5, 5, 1), (7, 5, 1), (0, 1, 5)] {
            let l = layout(5, 2).with_shard_times(asked);
            assert_eq!((l.shard_times, l.shard_groups()), (steps, groups));
            let all_steps: Vec<u32> = (0..groups).flat_map(|group| l.steps_of(group)).collect();
            assert_eq!(all_steps, [0, 1, 2, 3, 4]);
            let mut seen = HashSet::new();
            for level in l.levels() {
                assert_eq!(l.level_shards(level), groups as u64 * 2 * l.shard_grid(level).volume());
                for shard in l.shards(level) {
                    for slot in 0..l.shard_slots(level) {
                        let Some(id) = l.brick_at(shard, slot) else { continue };
                        assert_eq!(l.shard_of(id), (shard, slot));
                        assert!(l.steps_of(shard.group).contains(&id.time) && seen.insert(id));
                    }
                }
            }
            assert_eq!(seen.len() as u64, 10 * l.pyramid.brick_count());
        }
    }

    #[test]
    fn shards_of_several_time_steps_have_so_many_bricks_at_most() {
        let of = |steps| {
            let pyramid = Pyramid::new(Extent::new(1024, 1024, 1024), [1.0; 3], 8);
            Layout::new(pyramid, 9, 1, 1024).with_shard_times(steps)
        };
        assert_eq!(check_shard_bricks(&of(1)), Ok(()));
        // Absent bricks have no index entry.
        let in_shards_of = |extent| Layout::new(Pyramid::new(extent, [1.0; 3], 8), 1, 1, 8192);
        assert_eq!(check_shard_bricks(&in_shards_of(Extent::new(1024, 1024, 1024))), Ok(()));
        let (field, expected) = check_shard_bricks(&in_shards_of(Extent::new(1024, 1024, 1025))).unwrap_err();
        assert!(field == "shard" && expected.contains("at most 2097152 bricks a shard, not 2113536"), "{expected}");
        assert!(check_shard_bricks(&of(2)).unwrap_err().1.contains("at most 1, as a shard has 2097152 bricks"));
    }

    #[test]
    fn paths_name_only_the_axes_there_are() {
        let shard = ShardId { group: 1, channel: 2, level: Level(0), z: 3, y: 0, x: 1 };
        let path = |l: Layout, s| l.shard_path(Path::new("a.zarr"), s).to_string_lossy().into_owned();
        assert_eq!(path(layout(2, 3), shard), "a.zarr/0/c/1/2/3/0/1");
        assert_eq!(path(layout(1, 3), ShardId { group: 0, ..shard }), "a.zarr/0/c/2/3/0/1");
        assert_eq!(path(layout(1, 1), ShardId { group: 0, channel: 0, ..shard }), "a.zarr/0/c/3/0/1");
        assert_eq!(path(layout(1, 1).with_time(), ShardId { group: 0, channel: 0, ..shard }), "a.zarr/0/c/0/3/0/1");
    }

    #[test]
    fn a_second_pyramid_shares_level_0_and_nothing_else() {
        let (main, store) = (layout(1, 1), Path::new("a.zarr"));
        let second = main.of_second(Downsample::Max);
        let shard = |level| ShardId { group: 0, channel: 0, level: Level(level), z: 0, y: 0, x: 1 };
        assert_eq!(second.shard_path(store, shard(0)), main.shard_path(store, shard(0)));
        assert_eq!(second.side_dir(store, Level(0)), main.side_dir(store, Level(0)));
        assert_eq!(second.shard_path(store, shard(2)), Path::new("a.zarr/2/.brickyard/max/c/0/0/1"));
        assert_eq!(second.side_dir(store, Level(2)), Path::new("a.zarr/2/.brickyard/max/.brickyard"));
    }

    #[test]
    fn aprons_lie_beside_the_side_data_of_their_bricks() {
        let (main, store) = (layout(2, 1), Path::new("a.zarr"));
        let shard = ShardId { group: 1, channel: 0, level: Level(2), z: 3, y: 0, x: 1 };
        let path = |l: Layout| l.shard_path(store, shard).to_string_lossy().into_owned();
        assert_eq!(path(main.of_aprons()), "a.zarr/2/.brickyard/aprons/c/1/3/0/1/0");
        let second = main.of_second(Downsample::Max).of_aprons();
        assert_eq!(path(second.clone()), "a.zarr/2/.brickyard/max/.brickyard/aprons/c/1/3/0/1/0");
        assert_eq!(second.level_path(Level(0)), main.of_aprons().level_path(Level(0)));
    }

    #[test]
    fn small_levels_have_small_shards() {
        let l = layout(1, 1);
        assert_eq!(l.shard_bricks(Level(0)), Extent::new(4, 3, 4));
        assert_eq!(l.shard_grid(Level(0)), Extent::new(2, 1, 4));
        assert_eq!(l.shard_bricks(l.pyramid.coarsest()), Extent::new(1, 1, 1));
    }

    #[test]
    fn a_journal_tells_how_far_a_pack_came() {
        let dir = tempfile::tempdir().unwrap();
        let percent = |text: &str| {
            std::fs::write(dir.path().join(JOURNAL_NAME), text).unwrap();
            journal_percent(dir.path())
        };
        assert_eq!(percent("{\"shards\": 8}\na\nb\n"), Some(25));
        assert_eq!(percent("{\"shards\": 8}\na\nb\nhalf a li"), Some(25));
        assert_eq!(percent("{\"shards\": 1}\na\n"), Some(99));
        assert_eq!(percent("{\"sha"), None);
    }
}
