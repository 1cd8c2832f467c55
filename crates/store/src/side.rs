//! Side data: properties of bricks and shards, available without reading any, as Zarr arrays in each level's folder.
//!
//! | array | type | shape | contents per brick (`shards`: per shard) |
//! | --- | --- | --- | --- |
//! | `ranges` | the voxels' | t, c, z, y, x, 4 | least and greatest valid value of the core, then with one voxel around it; NaN if none |
//! | `hashes` | uint64 | t, c, z, y, x, 2 | lower and upper half of the XXH3-128 of the decoded core |
//! | `shards` | uint64 | t, c, z, y, x, 2 | [`Fingerprint`]: length and index checksum; zeros if there is no file |
//!
//! A brick's ranges include its descendants'. Each level's `aprons` array, if stored, has a `shards` of its own.
//!
//! If shards hold several time steps, `t` of `shards` counts groups of them, as in the shards' paths, and a group's
//! pages of `ranges` and `hashes` are in one file, itself a shard.
//!
//! All axes are always present. A chunk is a *page*: one time step, one channel, 16³ bricks (or shards); bytes, zstd,
//! crc32c. So a store opens without reading any, a page is read on first access to its box, and new time steps leave
//! old pages unchanged. A page of ranges takes 16 KiB to 64 KiB in memory.

use crate::error::ReadError;
use crate::folder::Folder;
use crate::layout::{Layout, place_at};
use crate::metadata::{StoreInfo, array_document, bytes_codec, sharding_codecs, voxel_documents};
use crate::mutex::lock;
use crate::shard::Fingerprint;
use crate::side_file;
use brickyard_volume::{BrickId, Extent, Level, Occupancy, OccupancyBins, PageId, Paging, VoxelType};
use lru::LruCache;
use serde_json::{Value, json};
use std::collections::HashMap;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex};

/// One array of a level's side data.
pub(crate) struct SideArray {
    dir: PathBuf,
    data_type: &'static str,
    element_bytes: usize,
    /// Number of time steps, or of groups of them.
    times: u32,
    /// Steps whose pages share a file.
    file_times: u32,
    channels: u32,
    grid: Extent,
    /// Elements per cell of the grid.
    values: u32,
}

impl SideArray {
    pub(crate) fn ranges(store: &Path, layout: &Layout, level: Level, voxel_type: VoxelType) -> Self {
        let (data_type, element_bytes) = (voxel_type.zarr_name(), voxel_type.bytes());
        Self { data_type, element_bytes, values: 4, ..Self::of_bricks(store, layout, level, "ranges") }
    }

    pub(crate) fn hashes(store: &Path, layout: &Layout, level: Level) -> Self {
        Self::of_bricks(store, layout, level, "hashes")
    }

    /// The fingerprints of a level's shards, or of its aprons' shards, in a store.
    pub(crate) fn fingerprints(store: &Path, layout: &Layout, level: Level) -> Self {
        let (times, grid) = (layout.shard_groups(), layout.shard_grid(level));
        Self { times, file_times: 1, grid, ..Self::of_bricks(store, layout, level, "shards") }
    }

    /// Two 64-bit words for each brick and time step, as of hashes; other arrays change what differs.
    fn of_bricks(store: &Path, layout: &Layout, level: Level, name: &str) -> Self {
        Self {
            dir: layout.side_dir(store, level).join(name),
            data_type: "uint64",
            element_bytes: 8,
            times: layout.times,
            file_times: layout.shard_times,
            channels: layout.channels,
            grid: layout.pyramid.level(level).bricks,
            values: 2,
        }
    }

    /// The division of the array's cells into pages.
    pub(crate) fn paging(&self) -> Paging {
        Paging::new(self.grid)
    }

    pub(crate) fn page_bytes(&self) -> usize {
        self.paging().page_cells() * self.values as usize * self.element_bytes
    }

    pub(crate) fn page_path(&self, PageId { time, channel, z, y, x, .. }: PageId) -> PathBuf {
        self.dir.join(format!("c/{}/{channel}/{z}/{y}/{x}/0", time / self.file_times))
    }

    /// A page's place in its file, the number of places, and of those in use: the last file may have fewer steps.
    pub(crate) fn place_in_file(&self, PageId { time, .. }: PageId) -> (usize, usize, usize) {
        let first = time / self.file_times * self.file_times;
        let filled = self.file_times.min(self.times - first);
        ((time - first) as usize, self.file_times as usize, filled as usize)
    }

    /// Steps whose pages share a file.
    pub(crate) fn steps_per_file(&self) -> u32 {
        self.file_times
    }

    /// The file for a page stored alone: path, and encoded `bytes`.
    pub(crate) fn page_file(&self, page: PageId, bytes: &[u8]) -> PageFile {
        debug_assert!(bytes.len() == self.page_bytes() && self.file_times == 1);
        (self.page_path(page), side_file::encode(bytes))
    }

    pub(crate) fn read_page(&self, folder: &Folder, page: PageId) -> Result<Vec<u8>, ReadError> {
        let (slot, slots, _) = self.place_in_file(page);
        side_file::read(folder, &self.page_path(page), slot, slots, self.page_bytes())
    }

    /// Reads a page of fingerprints.
    pub(crate) fn read_fingerprints(&self, folder: &Folder, page: PageId) -> Result<Vec<Fingerprint>, ReadError> {
        let bytes = self.read_page(folder, page)?;
        Ok(bytes.chunks_exact(size_of::<Fingerprint>()).map(bytemuck::pod_read_unaligned).collect())
    }

    /// Number of pages, over all time steps (or groups) and channels.
    pub(crate) fn page_count(&self) -> u64 {
        self.times as u64 * self.channels as u64 * self.paging().page_grid().volume()
    }

    /// Number of files for the pages.
    pub(crate) fn file_count(&self) -> u64 {
        let groups = u64::from(self.times.div_ceil(self.file_times));
        groups * u64::from(self.channels) * self.paging().page_grid().volume()
    }

    /// The id of page `i` of `level`, counted row-major in (t, c, z, y, x).
    pub(crate) fn page_at(&self, level: Level, i: u64) -> PageId {
        let [time, channel, z, y, x] = place_at(i, self.channels, self.paging().page_grid());
        PageId { time, channel, level, z, y, x }
    }

    fn document(&self) -> Value {
        let (grid, page) = (self.grid, self.paging().page_extent());
        let shape = [self.times, self.channels, grid.z, grid.y, grid.x, self.values];
        let chunk = |steps| [steps, 1, page.z, page.y, page.x, self.values];
        let codecs = json!([
            bytes_codec(self.element_bytes),
            { "name": "zstd", "configuration": { "level": 1, "checksum": false } },
            { "name": "crc32c" },
        ]);
        match self.file_times {
            1 => array_document(&shape, &chunk(1), self.data_type, codecs),
            steps => array_document(&shape, &chunk(steps), self.data_type, sharding_codecs(&chunk(1), codecs)),
        }
    }
}

/// A file of side data: path and content.
pub(crate) type PageFile = (PathBuf, Vec<u8>);

/// Incomplete files for the pages of several time steps, with the pages so far.
#[derive(Default)]
pub(crate) struct PageFiles {
    begun: HashMap<PathBuf, BegunFile>,
}

/// A file with missing pages.
struct BegunFile {
    /// The encoded pages, by place in the file.
    pages: Vec<Option<Vec<u8>>>,
    /// Number of missing pages.
    left: usize,
}

impl PageFiles {
    /// Adds a page, once. Returns the page's file when complete.
    pub(crate) fn add(&mut self, array: &SideArray, page: PageId, bytes: &[u8]) -> Option<PageFile> {
        let (slot, slots, filled) = array.place_in_file(page);
        if slots == 1 {
            return Some(array.page_file(page, bytes));
        }
        let path = array.page_path(page);
        let new = || BegunFile { pages: vec![None; slots], left: filled };
        let file = self.begun.entry(path.clone()).or_insert_with(new);
        file.pages[slot] = Some(side_file::encode(bytes));
        file.left -= 1;
        if file.left > 0 {
            return None;
        }
        let BegunFile { pages, .. } = self.begun.remove(&path)?;
        Some((path, side_file::join(&pages)))
    }
}

/// The side arrays of a level's cores in the order of writing: ranges, hashes, fingerprints.
pub(crate) fn level_arrays(store: &Path, layout: &Layout, level: Level, voxel_type: VoxelType) -> [SideArray; 3] {
    [
        SideArray::ranges(store, layout, level, voxel_type),
        SideArray::hashes(store, layout, level),
        SideArray::fingerprints(store, layout, level),
    ]
}

/// Most files of a level's side data, and of its aprons' if `has_aprons`, with their documents and those of the voxels.
pub(crate) fn level_files(layout: &Layout, level: Level, voxel_type: VoxelType, has_aprons: bool) -> u64 {
    let nowhere = Path::new("");
    let aprons = has_aprons.then(|| SideArray::fingerprints(nowhere, &layout.of_aprons(), level));
    let arrays = level_arrays(nowhere, layout, level, voxel_type).into_iter().chain(aprons);
    let of_voxels = if has_aprons { 2 } else { 1 };
    of_voxels + arrays.map(|array| array.file_count().saturating_add(1)).fold(0, u64::saturating_add)
}

/// The documents of a level's side data, and of its aprons' if there are any, with their paths.
pub(crate) fn side_documents(store: &Path, layout: &Layout, level: Level, info: &StoreInfo) -> Vec<(PathBuf, Value)> {
    let aprons = info.apron().map(|_| SideArray::fingerprints(store, &layout.of_aprons(), level));
    let arrays = level_arrays(store, layout, level, info.voxel_type).into_iter().chain(aprons);
    arrays.map(|array| (array.dir.join("zarr.json"), array.document())).collect()
}

/// The documents of all arrays of a level of one pyramid, with their paths: voxels, then side data.
pub(crate) fn array_documents(store: &Path, layout: &Layout, level: Level, info: &StoreInfo) -> Vec<(PathBuf, Value)> {
    [voxel_documents(store, layout, level, info), side_documents(store, layout, level, info)].concat()
}

/// The value ranges of the bricks of one page.
#[derive(Clone, Debug, PartialEq)]
pub struct RangePage {
    voxel_type: VoxelType,
    /// Four little-endian voxels per brick, including those past the grid.
    bytes: Vec<u8>,
}

impl RangePage {
    /// Least and greatest valid value of the brick at `place` and its descendants, if any.
    pub fn core(&self, place: usize) -> Option<(f64, f64)> {
        self.pair(place, 0)
    }

    /// Least and greatest valid value of the brick at `place` and its descendants, with one voxel around each, if any.
    pub fn reach(&self, place: usize) -> Option<(f64, f64)> {
        self.pair(place, 2)
    }

    /// The occupancy of the brick at `place` and its descendants, with one voxel around each, in its channel's bins.
    pub fn occupancy(&self, place: usize, bins: OccupancyBins) -> Occupancy {
        self.reach(place).map_or(Occupancy::NONE, |(low, high)| bins.mask(low, high))
    }

    fn pair(&self, place: usize, first: usize) -> Option<(f64, f64)> {
        let [low, high] = [0, 1].map(|i| self.voxel_type.read(&self.bytes, 4 * place + first + i));
        (low <= high).then_some((low, high))
    }
}

/// Reader of one pyramid's side data, with an LRU cache of range pages.
pub(crate) struct SidePages {
    folder: Arc<Folder>,
    layout: Layout,
    voxel_type: VoxelType,
    ranges: Mutex<LruCache<PageId, Arc<RangePage>>>,
}

/// Bytes of range pages cached by [`SidePages`].
const KEPT_BYTES: usize = 8 << 20;

impl SidePages {
    pub(crate) fn new(folder: &Arc<Folder>, layout: &Layout, voxel_type: VoxelType) -> Self {
        let page_bytes = SideArray::ranges(folder.path(), layout, Level(0), voxel_type).page_bytes();
        let kept = NonZeroUsize::new(KEPT_BYTES / page_bytes).unwrap_or(NonZeroUsize::MIN);
        Self { folder: folder.clone(), layout: layout.clone(), voxel_type, ranges: Mutex::new(LruCache::new(kept)) }
    }

    /// Most memory taken by cached pages, in bytes.
    pub(crate) fn cache_bytes(&self) -> u64 {
        let arrays = self
            .layout
            .levels()
            .map(|level| SideArray::ranges(self.folder.path(), &self.layout, level, self.voxel_type));
        let all: u64 = arrays.map(|array| array.page_count().saturating_mul(array.page_bytes() as u64)).sum();
        all.min(KEPT_BYTES as u64)
    }

    /// Reads a page of ranges, uncached.
    pub(crate) fn read_ranges(&self, page: PageId) -> Result<RangePage, ReadError> {
        let array = SideArray::ranges(self.folder.path(), &self.layout, page.level, self.voxel_type);
        Ok(RangePage { voxel_type: self.voxel_type, bytes: array.read_page(&self.folder, page)? })
    }

    /// The cached page with a brick's ranges, and the brick's place in it.
    pub(crate) fn ranges_of(&self, id: BrickId) -> Result<(Arc<RangePage>, usize), ReadError> {
        let (page, place) = self.layout.pyramid.page_of(id);
        if let Some(kept) = lock(&self.ranges).get(&page) {
            return Ok((kept.clone(), place));
        }
        let read = Arc::new(self.read_ranges(page)?);
        lock(&self.ranges).put(page, read.clone());
        Ok((read, place))
    }

    /// Reads a page of hashes: one per brick, and zeros past the grid.
    pub(crate) fn read_hashes(&self, page: PageId) -> Result<Vec<u128>, ReadError> {
        let array = SideArray::hashes(self.folder.path(), &self.layout, page.level);
        let bytes = array.read_page(&self.folder, page)?;
        Ok(bytes.as_chunks().0.iter().map(|hash| u128::from_le_bytes(*hash)).collect())
    }
}

/// The hash (XXH3-128) of a brick's decoded core, padding included.
pub(crate) fn core_hash(core: &[u8]) -> u128 {
    xxhash_rust::xxh3::xxh3_128(core)
}
