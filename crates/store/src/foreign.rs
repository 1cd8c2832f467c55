//! Another program's image, drawn where it lies: bricks cut from the boxes of its own levels; of levels it lacks, made from the next finer ones.
//!
//! Opening reads documents and a sample of the voxels, for a window to begin with ([`sample`]). Nothing is written into the image. A brick of
//! one of its levels costs its chunks (the reader keeps the last ones); a made brick costs up to eight finer bricks, and is kept.

mod cache;
mod fingerprint;
mod index;
mod levels;
mod made;
mod making;
mod sample;
#[cfg(test)]
mod tests;

use crate::arrived::FetchRoom;
use crate::codec::Codec;
use crate::downsample::{Downsample, Reductions};
use crate::error::{OpenError, ReadError};
use crate::folder::Folder;
use crate::json::read_json;
use crate::kind::Kind;
use crate::layout::{JOURNAL_NAME, Layout};
use crate::metadata::{ChannelDisplay, ChannelStatistics, FORMAT_VERSION, StoreInfo};
use crate::pack::brick::{fill_up, spread};
use crate::pack::plan::check_input;
use brickyard_import::zarr::{open_image, zarr_folder};
use brickyard_import::{Image, Note, Source, SourceInfo};
use brickyard_objects::is_address;
use brickyard_volume::{
    BrickId, DEFAULT_BRICK_EDGE, Extent, Geometry, LabelColor, Level, Placement, Pyramid, TimeAxis, VoxelBox,
    VoxelType, with_voxel_type,
};
use cache::Cache;
pub use cache::{KeptImages, MOST_KEPT_BYTES, clear_images, kept_images};
pub(crate) use fingerprint::of_all as state_of_files;
pub use index::ImageIndexError;
use index::Index;
pub(crate) use index::index;
use levels::Levels;
use made::Made;
pub use making::Making;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, OnceLock};
use std::time::SystemTime;

/// Version of everything in the cache: changes with the kernels that make levels, and with the index.
const CACHE_VERSION: u32 = 1;

/// Most bytes of a chunk: one must fit in memory several times.
const MOST_CHUNK_BYTES: u64 = 1 << 30;

/// An image of another program, open.
pub(crate) struct Foreign {
    path: PathBuf,
    image: Image,
    levels: Levels,
    method: Downsample,
    made: Made,
    cache: Cache,
    /// Before the first byte was read.
    opened: SystemTime,
    /// The state of the files of all levels used; looked at when first asked for.
    state: OnceLock<Option<u64>>,
    /// Statistics of each channel: the index's, or else a sample's.
    statistics: Vec<ChannelStatistics>,
    is_exact: bool,
    index: Option<Index>,
    notes: Vec<Note>,
    bytes_read: AtomicU64,
}

/// A foreign image in the terms of a store.
pub(crate) struct Described {
    pub(crate) layout: Layout,
    pub(crate) geometry: Geometry,
    pub(crate) placement: Placement,
    pub(crate) time: Option<TimeAxis>,
    pub(crate) info: StoreInfo,
    pub(crate) displays: Vec<ChannelDisplay>,
    pub(crate) label_colors: Vec<LabelColor>,
}

/// Whether a path is `FOLDER::PATH`, a place in a Zarr.
pub(crate) fn is_place(path: &Path) -> bool {
    folder_of_place(path).is_some()
}

/// The folder of a path `FOLDER::PATH`; `None` for other paths.
pub(crate) fn folder_of_place(path: &Path) -> Option<PathBuf> {
    zarr_folder(path).filter(|folder| folder != path)
}

/// Whether a folder's root document is of a store of brickyard's, finished or not.
pub(crate) fn is_own(folder: &Path) -> bool {
    let root = Folder::open(folder).ok().and_then(|opened| read_json(&opened, &folder.join("zarr.json")).ok());
    root.is_some_and(|root| !root["attributes"]["brickyard"].is_null())
}

/// Whether a path is another program's Zarr, or `FOLDER::PATH` for a place in one; brickyard's own stores, finished or not, are not.
pub fn is_foreign(path: &Path) -> bool {
    let Some(folder) = zarr_folder(path).filter(|folder| !folder.join(JOURNAL_NAME).exists()) else { return false };
    folder != path || !is_own(&folder) && !crate::inside::is_inside(&folder)
}

impl Foreign {
    /// Opens an image and takes a sample of it.
    ///
    /// # Errors
    /// If there is no image, several without a choice, one that no store can describe, or no chunk of the sample can be read.
    pub(crate) fn open(path: &Path) -> Result<Self, OpenError> {
        let opened = SystemTime::now();
        Self::of(path, open_image(path)?, opened)
    }

    /// Describes an image, opened from `path`, and takes a sample of it.
    fn of(path: &Path, image: Image, opened: SystemTime) -> Result<Self, OpenError> {
        let info = image.levels[0].source.info();
        let chunk_bytes = |chunk: Extent| chunk.volume().saturating_mul(info.voxel_type.bytes() as u64);
        if let Some(chunk) = image.levels.iter().filter_map(|level| level.source.piece()).max_by_key(|c| c.volume())
            && chunk_bytes(chunk) > MOST_CHUNK_BYTES
        {
            let what = format!(
                "chunks of {chunk} voxels are too large to be read where they lie; 'brickyard pack' reads each once"
            );
            return Err(OpenError::Unfit { path: path.into(), what });
        }
        check_input(info).map_err(|error| OpenError::Unfit { path: path.into(), what: error.to_string() })?;
        let kind = Kind::said_by(info);
        let method = Reductions::default_for(kind).main();
        let levels = Levels::of(&image.levels, DEFAULT_BRICK_EDGE);
        let bricks = levels.made_bricks().saturating_mul(u64::from(info.times) * u64::from(info.channels));
        let made = Made::new(levels.pyramid(), info.voxel_type, bricks);
        let notes = [&info.notes[..], &levels.notes(&image.levels)].concat();
        let mut foreign = Self {
            path: path.into(),
            cache: Cache::of(&format!("{CACHE_VERSION} {} {DEFAULT_BRICK_EDGE} {}", method.name(), info.identity)),
            opened,
            state: OnceLock::new(),
            image,
            levels,
            method,
            made,
            statistics: Vec::new(),
            is_exact: true,
            index: None,
            notes,
            bytes_read: AtomicU64::new(0),
        };
        foreign.learn()?;
        Ok(foreign)
    }

    /// Takes the statistics of the kept index, or else of a sample.
    fn learn(&mut self) -> Result<(), OpenError> {
        self.index = Index::kept(self);
        self.statistics = match &self.index {
            Some(index) => index.channels.clone(),
            None => {
                let sample = sample::of(&self.image.levels)?;
                self.is_exact = sample.is_whole;
                sample.channels
            }
        };
        let looks = &self.image.levels[0].source.info().channel_looks;
        self.statistics.iter_mut().zip(looks).for_each(|(channel, look)| channel.take_look(look));
        Ok(())
    }

    /// The image in the terms of a store.
    ///
    /// # Errors
    /// If its orientation does not fit its spacing.
    pub(crate) fn describe(&self) -> Result<Described, OpenError> {
        let source = self.source();
        let pyramid = self.levels.pyramid().clone();
        let layout = Layout::new(pyramid, source.times, source.channels, DEFAULT_BRICK_EDGE);
        let info = self.info(source);
        let unfit = |error: brickyard_volume::PlacementError| OpenError::Unfit {
            path: self.path.clone(),
            what: error.to_string(),
        };
        let placement = info.orientation.map(|orientation| orientation.placement(&source.geometry)).transpose();
        let mut displays = ChannelDisplay::of_channels(&info.channels);
        for channel in &self.image.presentation.hidden_channels {
            displays[*channel as usize].is_visible = false;
        }
        Ok(Described {
            layout,
            geometry: source.geometry.clone(),
            placement: placement.map_err(unfit)?.unwrap_or_default(),
            time: source.time.clone(),
            info,
            displays,
            label_colors: self.image.presentation.label_colors.clone(),
        })
    }

    fn info(&self, source: &SourceInfo) -> StoreInfo {
        let is_float = source.voxel_type.is_float();
        StoreInfo {
            version: FORMAT_VERSION,
            name: self.image.presentation.name.clone(),
            edge: DEFAULT_BRICK_EDGE,
            shard: DEFAULT_BRICK_EDGE,
            shard_times: 1,
            voxel_type: source.voxel_type,
            codec: Codec::None,
            downsample: self.method.into(),
            kind: Kind::said_by(source),
            image_label: source.kind.are_labels(),
            nodata: source.nodata.filter(|_| !is_float).map(|nodata| nodata as i64),
            blanked: source.nodata.filter(|_| is_float),
            aprons: 0,
            spacing: source.geometry.spacing.to_array(),
            axis_units: source.geometry.axis_units.clone(),
            calibrated: source.calibrated,
            orientation: source.orientation,
            turned: source.turned,
            flipped: source.flip.unwrap_or_default(),
            time: source.time.clone(),
            times: None,
            channels: self.statistics.clone(),
            source: source.identity.clone(),
            settings_fingerprint: source.identity.clone(),
            complete: true,
        }
    }

    /// The image's folder in the user's cache.
    pub(crate) fn cache(&self) -> &Cache {
        &self.cache
    }

    /// The state of the files of all levels used, when first asked for; `None` if it cannot be told.
    pub(crate) fn state(&self) -> Option<u64> {
        *self.state.get_or_init(|| self.state_now())
    }

    /// The present state of these files.
    fn state_now(&self) -> Option<u64> {
        let used = self.image.levels.iter().filter(|level| self.levels.uses(&level.source));
        let mut states = used.map(|level| fingerprint::of(&level.folder, self.opened));
        states.try_fold(0, |all: u64, one| Some(all.rotate_left(7) ^ one?))
    }

    /// Least and greatest valid value of a brick, its descendants and the bricks around it, if the image is indexed.
    pub(crate) fn range_around(&self, id: BrickId) -> Option<Option<(f64, f64)>> {
        self.index.as_ref().map(|index| index.around(self.pyramid(), id))
    }

    /// Least and greatest valid value of a brick and its descendants, if the image is indexed.
    pub(crate) fn range(&self, id: BrickId) -> Option<Option<(f64, f64)>> {
        self.index.as_ref().map(|index| index.core(self.pyramid(), id))
    }

    pub(crate) fn pyramid(&self) -> &Pyramid {
        self.levels.pyramid()
    }

    pub(crate) fn voxel_type(&self) -> VoxelType {
        self.source().voxel_type
    }

    /// The value of voxels without data, as the image has it.
    pub(crate) fn nodata(&self) -> Option<f64> {
        self.source().sought_nodata()
    }

    fn source(&self) -> &SourceInfo {
        self.image.levels[0].source.info()
    }

    /// The path given on opening.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// The reduction behind levels made here.
    pub(crate) fn method(&self) -> Downsample {
        self.method
    }

    /// Voxels of a chunk of a level, the smallest piece decoded alone; `None` if the level is made.
    pub(crate) fn chunk(&self, level: Level) -> Option<Extent> {
        self.levels.source(level)?.piece()
    }

    pub(crate) fn notes(&self) -> &[Note] {
        &self.notes
    }

    pub(crate) fn label_names(&self) -> &[String] {
        &self.image.presentation.label_names
    }

    /// Whether any voxel may be NaN or infinite that the statistics, of the finest level, do not count.
    pub(crate) fn may_hide_non_finite(&self) -> bool {
        self.voxel_type().is_float() && (!self.is_exact || self.image.levels.len() > 1)
    }

    /// Whether the statistics are of all voxels.
    pub(crate) fn is_exact(&self) -> bool {
        self.is_exact
    }

    /// Made bricks under way, if any.
    pub(crate) fn making(&self) -> Option<Making> {
        self.made.making()
    }

    /// Decoded bytes of the image read so far for bricks.
    pub(crate) fn bytes_read(&self) -> u64 {
        self.bytes_read.load(Ordering::Relaxed)
    }

    /// Bounds the decoded chunks kept of all levels together.
    pub(crate) fn keep_at_most(&self, bytes: u64) {
        self.image.levels[0].source.keep_at_most(bytes);
    }

    /// Most memory of the readers and of made bricks, with as many threads as processors.
    pub(crate) fn cache_bytes(&self) -> u64 {
        let threads = std::thread::available_parallelism().map_or(1, |n| n.get()) as u64;
        let used = || self.image.levels.iter().map(|level| &level.source).filter(|source| self.levels.uses(source));
        // All levels share one bound.
        let held = used().map(|source| source.held_bytes()).max().unwrap_or(0);
        // A thread reads one level at a time.
        let reading = used().map(|source| source.reader_bytes()).max().unwrap_or(0);
        let fetching = if is_address(&self.path) { self.fetching().bricks as u64 } else { 0 };
        held + (threads + fetching) * reading
            + self.made.cache_bytes(threads)
            + self.index.as_ref().map_or(0, Index::bytes)
    }

    /// The error for a pyramid by another method.
    pub(crate) fn no_reduction(&self, asked: Downsample) -> OpenError {
        OpenError::NoReduction { path: self.path.clone(), asked, found: self.method.into() }
    }

    /// Bricks that may be fetched at a time, and how many ahead, so that a quarter of the chunks kept are under way or wait to be used.
    pub(crate) fn fetching(&self) -> FetchRoom {
        const MOST_AT_ONCE: u64 = 16;
        const MOST_AHEAD: u64 = 256;
        let used = self.image.levels.iter().map(|level| &level.source).filter(|source| self.levels.uses(source));
        let bricks = used.map(|source| {
            let brick = DEFAULT_BRICK_EDGE;
            let chunk = source.piece().map_or([brick; 3], |piece| piece.to_array());
            let chunks_per_brick: u64 = chunk.iter().map(|n| u64::from(brick.div_ceil((*n).max(1)))).product();
            source.held_bytes() / 4 / source.reader_bytes().max(1) / chunks_per_brick
        });
        let bricks = bricks.min().unwrap_or(1).max(1);
        FetchRoom { bricks: bricks.min(MOST_AT_ONCE) as usize, ahead: bricks.min(MOST_AHEAD) as usize }
    }

    /// Reads bricks' chunks, to be kept decoded for reads that follow soon. Failures are left for these to report.
    pub(crate) fn fetch(&self, ids: &[BrickId]) {
        for id in ids {
            let Some(source) = self.levels.source(id.level) else { continue };
            if let Err(error) = source.fetch_box(id.time, id.channel, self.region(source, *id)) {
                tracing::debug!(%error, "not fetched ahead");
            }
        }
    }

    /// Fills `out` with a brick's core; voxels past the level's end repeat the last ones.
    ///
    /// # Errors
    /// If a chunk of the image cannot be read or decoded.
    ///
    /// # Panics
    /// If there is no such brick, or `out` is not a core's length.
    pub(crate) fn read(&self, id: BrickId, out: &mut [u8]) -> Result<(), ReadError> {
        match self.levels.source(id.level) {
            Some(source) => self.cut(source, id, out),
            None => self.made.read(self, id, out),
        }
    }

    /// Cuts a brick from a level of the image.
    fn cut(&self, source: &Arc<dyn Source>, id: BrickId, out: &mut [u8]) -> Result<(), ReadError> {
        let region = self.region(source, id);
        let voxel_bytes = source.info().voxel_type.bytes();
        let shape = region.extent().to_array().map(|n| n as usize);
        let (edge, bytes) = (DEFAULT_BRICK_EDGE as usize, shape.iter().product::<usize>() * voxel_bytes);
        assert_eq!(out.len(), edge.pow(3) * voxel_bytes, "not a core's length");
        let read = source.read_box(id.time, id.channel, region, &mut out[..bytes]);
        read.map_err(|error| ReadError::Source { path: self.path.clone(), error })?;
        self.bytes_read.fetch_add(bytes as u64, Ordering::Relaxed);
        if let Some(nodata) = source.info().sought_nodata().filter(|_| source.info().voxel_type.is_float()) {
            blank(&mut out[..bytes], nodata as f32);
        }
        with_voxel_type!(self.voxel_type(), T => {
            let core = out.as_chunks_mut::<{ size_of::<T>() }>().0;
            spread(core, edge, shape);
            fill_up(core, edge, shape);
        });
        Ok(())
    }

    /// The box of a brick in its level's own array, which may end a voxel before the pyramid's level.
    fn region(&self, source: &Arc<dyn Source>, id: BrickId) -> VoxelBox {
        let brick = self.levels.pyramid().brick_box(id.level, id.index);
        let last = source.info().extent.to_array();
        let min = std::array::from_fn(|a| brick.min.to_array()[a].min(last[a] - 1));
        let max = std::array::from_fn(|a| brick.max.to_array()[a].min(last[a]));
        VoxelBox::new(min, max)
    }
}

/// Turns floats that mark missing data into NaN.
fn blank(voxels: &mut [u8], nodata: f32) {
    for voxel in voxels.as_chunks_mut::<4>().0 {
        if f32::from_le_bytes(*voxel) == nodata {
            *voxel = f32::NAN.to_le_bytes();
        }
    }
}
