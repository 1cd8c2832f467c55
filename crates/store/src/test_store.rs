//! Small test stores, written from a function of (t, c, x, y, z) through the format modules, with levels and statistics
//! computed voxel by voxel. Only the format is shared with the packer.

use crate::codec::{BrickCodec, Codec};
use crate::downsample::Downsample;
use crate::error::OpenError;
use crate::folder::Folder;
use crate::layout::{Layout, ShardId};
use crate::metadata::{ChannelStatistics, Kind, StoreInfo, document_bytes, root_document};
use crate::scratch::Scratch;
use crate::shard::{BrickRange, Fingerprint, encode_index};
use crate::side::{PageFiles, SideArray, array_documents, core_hash, level_arrays};
use crate::stats::{ChannelTotals, Counter, Measure, Tally};
use crate::store::grown;
use crate::version::FORMAT_VERSION;
use brickyard_volume::{
    BrickId, Extent, Geometry, Level, PageId, Pyramid, TimeAxis, Voxel, VoxelBox, VoxelType, with_voxel_type,
};
use glam::DVec3;
use serde_json::Value;
use std::collections::BTreeMap;
use std::path::Path;

pub(crate) struct TestStore {
    pub(crate) extent: [u32; 3],
    pub(crate) spacing: [f64; 3],
    pub(crate) times: u32,
    pub(crate) time: Option<TimeAxis>,
    pub(crate) channels: u32,
    pub(crate) voxel_type: VoxelType,
    pub(crate) codec: Codec,
    pub(crate) edge: u32,
    pub(crate) shard: u32,
    /// Number of time steps in a shard.
    pub(crate) shard_times: u32,
}

/// Side data of a brick; an empty range has crossed ends.
#[derive(Clone, Copy)]
struct Brick {
    core: (f64, f64),
    reach: (f64, f64),
    hash: u128,
}

impl Default for TestStore {
    fn default() -> Self {
        Self {
            extent: [37, 20, 19],
            spacing: [1.0; 3],
            times: 1,
            time: None,
            channels: 1,
            voxel_type: VoxelType::U16,
            codec: Codec::ShuffleZstd(1),
            edge: 8,
            shard: 16,
            shard_times: 1,
        }
    }
}

impl TestStore {
    pub(crate) fn layout(&self) -> Layout {
        let pyramid = Pyramid::new(Extent::from_array(self.extent), self.spacing, self.edge);
        Layout::new(pyramid, self.times, self.channels, self.shard).with_shard_times(self.shard_times)
    }

    pub(crate) fn geometry(&self) -> Geometry {
        let spacing = DVec3::from_array(self.spacing);
        Geometry { spacing, origin: DVec3::new(-3.0, 0.1, 100.0), unit: Some("micrometer".into()), axis_units: None }
    }

    /// All levels of one volume, rounded to the voxel type. A coarse voxel is the mean of the existing finer voxels
    /// under it.
    pub(crate) fn levels(&self, value: impl Fn([u32; 3]) -> f64) -> Vec<Vec<f64>> {
        let layout = self.layout();
        let round = |v: f64| with_voxel_type!(self.voxel_type, T => T::from_f64_rounded(v).to_f64());
        let mut levels: Vec<Vec<f64>> = Vec::new();
        for (k, grid) in layout.pyramid.levels().iter().enumerate() {
            let voxel = |at: [u32; 3]| {
                let Some(finer) = levels.last() else { return round(value(at)) };
                let fine = layout.pyramid.levels()[k - 1];
                let ratio: [u32; 3] = std::array::from_fn(|a| grid.factor[a] / fine.factor[a]);
                let n = fine.extent.to_array();
                let max = std::array::from_fn(|a| ((at[a] + 1) * ratio[a]).min(n[a]));
                let under = voxels(VoxelBox::new(std::array::from_fn(|a| at[a] * ratio[a]), max));
                // An odd extent's last voxel counts twice along its axis, which leaves the mean unchanged.
                let (sum, count) = under
                    .map(|v| finer[fine.extent.linear(v) as usize])
                    .filter(|v| v.is_finite())
                    .fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
                round(if count > 0.0 { sum / count } else { f64::NAN })
            };
            let level = voxels(grid.extent.full_box()).map(voxel).collect();
            levels.push(level);
        }
        levels
    }

    /// Writes the store with voxels `value(t, c, [x, y, z])`.
    pub(crate) fn write(&self, store: &Path, value: impl Fn(u32, u32, [u32; 3]) -> f64) {
        self.write_voxels(store, &value);
    }

    fn write_voxels(&self, store: &Path, value: &dyn Fn(u32, u32, [u32; 3]) -> f64) {
        let layout = self.layout();
        let info = self.info(value);
        let (mut bricks, mut shards) = (BTreeMap::new(), BTreeMap::new());
        let volumes: Vec<(u32, u32)> = (0..self.times).flat_map(|t| (0..self.channels).map(move |c| (t, c))).collect();
        let levels: BTreeMap<_, _> =
            volumes.into_iter().map(|(t, c)| ((t, c), self.levels(|v| value(t, c, v)))).collect();
        for (&(time, channel), levels) in &levels {
            for (k, level) in levels.iter().enumerate() {
                self.add_ranges(&layout, &mut bricks, (time, channel, Level(k as u8)), level);
            }
        }
        let core = |id: BrickId| self.core(&layout, id, &levels[&(id.time, id.channel)][id.level.index()]);
        for (id, brick) in &mut bricks {
            brick.hash = core_hash(&core(*id));
        }
        for shard in layout.levels().flat_map(|level| layout.shards(level)) {
            shards.insert(shard, self.write_shard(store, &layout, shard, core));
        }
        for level in layout.levels() {
            let [ranges, hashes, fingerprints] = level_arrays(store, &layout, level, self.voxel_type);
            let pages =
                |array: &SideArray| (0..array.page_count()).map(|i| array.page_at(level, i)).collect::<Vec<_>>();
            let mut files = Vec::new();
            let mut begun = PageFiles::default();
            for page in pages(&ranges) {
                let [mut of_ranges, mut of_hashes] = [&ranges, &hashes].map(|array| vec![0; array.page_bytes()]);
                for (id, place) in layout.pyramid.bricks_of_page(page) {
                    let Brick { core, reach, hash } = bricks[&id];
                    let voxels = [core, reach].map(|(low, high)| if low <= high { [low, high] } else { [f64::NAN; 2] });
                    let voxels: Vec<u8> = voxels.as_flattened().iter().flat_map(|v| self.bytes_of(*v)).collect();
                    of_ranges[place * voxels.len()..][..voxels.len()].copy_from_slice(&voxels);
                    of_hashes[place * 16..][..16].copy_from_slice(&hash.to_le_bytes());
                }
                files.extend(begun.add(&ranges, page, &of_ranges));
                files.extend(begun.add(&hashes, page, &of_hashes));
            }
            for page in pages(&fingerprints) {
                let mut of_shards = vec![Fingerprint::default(); fingerprints.paging().page_cells()];
                for shard in voxels(fingerprints.paging().cells([page.x, page.y, page.z])) {
                    let [x, y, z] = shard;
                    let id = ShardId { group: page.time, channel: page.channel, level, z, y, x };
                    of_shards[fingerprints.paging().locate(shard).1] = shards[&id];
                }
                files.push(fingerprints.page_file(page, bytemuck::cast_slice(&of_shards)));
            }
            files.iter().for_each(|(path, bytes)| write_file(path, bytes));
        }
        self.write_documents_of(store, &info);
    }

    /// Writes only the documents of a store of zeros, which suffice for opening.
    pub(crate) fn write_documents(&self, store: &Path) {
        let channels =
            with_voxel_type!(self.voxel_type, T => vec![channel_statistics::<T>(&[0.0]); self.channels as usize]);
        self.write_documents_of(store, &self.info_with(channels));
    }

    fn write_documents_of(&self, store: &Path, info: &StoreInfo) {
        let layout = self.layout();
        let of_levels = layout.levels().flat_map(|level| array_documents(store, &layout, level, info));
        let root = (store.join("zarr.json"), root_document(&layout, &self.geometry(), info));
        of_levels.chain([root]).for_each(|(path, document)| write_file(&path, &document_bytes(&document)));
    }

    fn info(&self, value: &dyn Fn(u32, u32, [u32; 3]) -> f64) -> StoreInfo {
        let channel = |c: u32| {
            let volume = |t| self.levels(|v| value(t, c, v)).swap_remove(0);
            let all: Vec<f64> = (0..self.times).flat_map(volume).collect();
            with_voxel_type!(self.voxel_type, T => channel_statistics::<T>(&all))
        };
        self.info_with((0..self.channels).map(channel).collect())
    }

    fn info_with(&self, channels: Vec<ChannelStatistics>) -> StoreInfo {
        StoreInfo {
            name: None,
            version: FORMAT_VERSION,
            edge: self.edge,
            shard: self.shard,
            shard_times: self.shard_times,
            voxel_type: self.voxel_type,
            codec: self.codec,
            downsample: Downsample::Mean.into(),
            kind: Kind::Image,
            image_label: false,
            nodata: None,
            blanked: None,
            aprons: 0,
            spacing: self.spacing,
            axis_units: None,
            calibrated: true,
            orientation: None,
            turned: [false; 3],
            flipped: [false; 3],
            time: self.time.clone(),
            times: None,
            channels,
            source: "test".into(),
            settings_fingerprint: "test".into(),
            complete: true,
        }
    }

    /// Adds the ranges of a level's bricks, from its voxels and the finer bricks' ranges.
    fn add_ranges(
        &self,
        layout: &Layout,
        bricks: &mut BTreeMap<BrickId, Brick>,
        (time, channel, level): (u32, u32, Level),
        voxels_of_level: &[f64],
    ) {
        let grid = *layout.pyramid.level(level);
        let range = |region: VoxelBox| {
            voxels(region)
                .map(|v| voxels_of_level[grid.extent.linear(v) as usize])
                .filter(|v| v.is_finite())
                .fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), v| (a.min(v), b.max(v)))
        };
        for index in voxels(grid.bricks.full_box()).map(brickyard_volume::BrickIndex::from_array) {
            let id = BrickId { time, channel, level, index };
            let core = layout.pyramid.brick_box(level, index);
            let padded = grown(core, 1, grid.extent.full_box());
            let (mut core, mut reach) = (range(core), range(padded));
            for child in layout.pyramid.children(level, index) {
                let child = bricks[&BrickId { level: Level(level.0 - 1), index: child, ..id }];
                core = (core.0.min(child.core.0), core.1.max(child.core.1));
                reach = (reach.0.min(child.reach.0), reach.1.max(child.reach.1));
            }
            bricks.insert(id, Brick { core, reach, hash: 0 });
        }
    }

    /// A brick's core in stored form, from the voxels of its level; padding repeats the last voxel.
    fn core(&self, layout: &Layout, id: BrickId, level: &[f64]) -> Vec<u8> {
        let (extent, edge) = (layout.pyramid.level(id.level).extent, self.edge);
        let (n, corner) = (extent.to_array(), layout.pyramid.brick_box(id.level, id.index).min.to_array());
        let value =
            |v: [u32; 3]| level[extent.linear(std::array::from_fn(|a| (corner[a] + v[a]).min(n[a] - 1))) as usize];
        voxels(Extent::new(edge, edge, edge).full_box()).flat_map(|v| self.bytes_of(value(v))).collect()
    }

    fn write_shard(
        &self,
        store: &Path,
        layout: &Layout,
        shard: ShardId,
        core: impl Fn(BrickId) -> Vec<u8>,
    ) -> Fingerprint {
        let codec = BrickCodec::new(self.codec, self.voxel_type, self.edge);
        let mut file = Vec::new();
        let mut scratch = Scratch::default();
        let range = |slot: usize| {
            let core = core(layout.brick_at(shard, slot)?);
            if core.iter().all(|&b| b == 0) {
                return None;
            }
            let offset = file.len() as u64;
            codec.encode(&mut scratch, &core, &mut file);
            Some(BrickRange { offset, length: file.len() as u64 - offset })
        };
        let ranges: Vec<_> = (0..layout.shard_slots(shard.level)).map(range).collect();
        if file.is_empty() {
            return Fingerprint::default();
        }
        let (index, crc) = encode_index(&ranges);
        file.extend_from_slice(&index);
        write_file(&layout.shard_path(store, shard), &file);
        Fingerprint { file_bytes: file.len() as u64, index_crc: crc.into() }
    }

    /// The bytes of one voxel, little-endian.
    pub(crate) fn bytes_of(&self, value: f64) -> Vec<u8> {
        with_voxel_type!(self.voxel_type, T => bytemuck::bytes_of(&T::from_f64_rounded(value)).to_vec())
    }
}

fn channel_statistics<T: Measure>(values: &[f64]) -> ChannelStatistics {
    let voxels: Vec<T> = values.iter().map(|v| T::from_f64_rounded(*v)).collect();
    let (mut totals, mut counter, mut tally) = (ChannelTotals::new(T::TYPE), Counter::new(T::TYPE), Tally::default());
    T::count(&voxels, &mut counter);
    T::tally(&voxels, &mut tally);
    counter.drain_into(&mut totals);
    totals.add_tally(&tally);
    totals.add_range(T::range(&voxels).to_f64());
    totals.finish()
}

/// All voxels of a box in memory order, as `[x, y, z]`.
pub(crate) fn voxels(region: VoxelBox) -> impl Iterator<Item = [u32; 3]> {
    let (min, max) = (region.min, region.max);
    (min.z..max.z).flat_map(move |z| (min.y..max.y).flat_map(move |y| (min.x..max.x).map(move |x| [x, y, z])))
}

/// The value of a test voxel: structure in every octant, zeros in one corner, no symmetry.
pub(crate) fn bumps(t: u32, c: u32, [x, y, z]: [u32; 3]) -> f64 {
    if x < 16 && y < 16 && z < 16 {
        return 0.0;
    }
    ((x * 7 + y * 3 + z * 11 + t * 50 + c * 90) % 120) as f64
}

pub(crate) fn read_json(path: &Path) -> Result<Value, OpenError> {
    crate::json::read_json(&Folder::open(path.parent().unwrap()).unwrap(), path)
}

/// Edits the decoded bytes of a page of side data.
pub(crate) fn edit_page(array: &SideArray, page: PageId, edit: impl FnOnce(&mut Vec<u8>)) {
    let (slot, _, filled) = array.place_in_file(page);
    let first = page.time - slot as u32;
    let of_file = (first..first + filled as u32).map(|time| PageId { time, ..page });
    let root = Folder::open(Path::new("/")).unwrap();
    let mut pages: Vec<(PageId, Vec<u8>)> = of_file.map(|page| (page, array.read_page(&root, page).unwrap())).collect();
    edit(&mut pages[slot].1);
    let mut begun = PageFiles::default();
    let files = pages.iter().filter_map(|(page, bytes)| begun.add(array, *page, bytes));
    files.for_each(|(path, file)| write_file(&path, &file));
}

fn write_file(path: &Path, bytes: &[u8]) {
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    std::fs::write(path, bytes).unwrap();
}
