//! An open store: documents in memory, side data and shards opened on first use.
//!
//! Opening reads only the documents (and of another program's image a sample), so it takes milliseconds and constant memory at any size of store. The last few
//! shards and pages stay open; `chunks.rs` reads bricks. Reading never writes. All methods are thread-safe.

use crate::arrived::{self, FetchRoom};
use crate::chunks::Chunks;
use crate::codec::BrickCodec;
use crate::downsample::Downsample;
use crate::error::{OpenError, ReadError};
use crate::first_objects;
use crate::folder::Folder;
use crate::foreign::{self, Described, Foreign, Making};
use crate::inside;
use crate::json::{parse_json, read_json};
use crate::layout::{JOURNAL_NAME, Layout, journal_percent};
use crate::metadata::{
    ChannelDisplay, ChannelStatistics, OTHERS_STORE, StoreInfo, check_array, parse_displays, parse_geometry,
    parse_info, parse_label_colors, parse_layout, parse_placement,
};
use crate::ngff::{Ngff, Root};
use crate::pack::image_labels;
use crate::shard_file::IoMode;
use crate::side::{RangePage, SidePages, array_documents};
use crate::time::parse_time;
use brickyard_import::Note;
use brickyard_objects::{at, is_address, traffic};
use brickyard_volume::{
    Apron, BrickId, BrickIndex, Extent, Geometry, LabelColor, Level, Occupancy, OccupancyBins, PageId, Placement,
    Pyramid, TimeAxis, VoxelBox, VoxelType,
};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

/// Most changes of the store during one opening.
const MOST_CHANGES: u32 = 100;

/// An open store: a finished one of brickyard's, or another program's image. One of its pyramids, if it has two.
pub struct Store {
    layout: Layout,
    geometry: Geometry,
    placement: Placement,
    time: Option<TimeAxis>,
    info: StoreInfo,
    /// One per channel.
    displays: Vec<ChannelDisplay>,
    label_colors: Vec<LabelColor>,
    bricks: Bricks,
}

/// The places of a store's bricks.
enum Bricks {
    Own(Box<Own>),
    Foreign(Box<Foreign>),
}

/// The open files of a store of brickyard's.
struct Own {
    ngff: Ngff,
    folder: Arc<Folder>,
    mode: IoMode,
    /// Hash of the root document, to detect changes.
    root_hash: u64,
    sides: SidePages,
    cores: Chunks,
    /// `None` unless aprons are stored.
    aprons: Option<Chunks>,
}

impl Store {
    /// Opens the main pyramid of a store, with memory-mapped shards; or an image of another program's Zarr, where it lies: a folder, or
    /// `FOLDER::PATH` for one of several images in it.
    ///
    /// # Errors
    /// If the store is missing, unfinished, of an unknown version, contradictory or unreadable; or the other program's Zarr has no
    /// image that can be drawn, or several without a choice among them.
    pub fn open(path: impl Into<PathBuf>) -> Result<Self, OpenError> {
        Self::open_with(path, IoMode::default())
    }

    /// Opens the main pyramid of a store, reading shards by `mode`.
    ///
    /// # Errors
    /// As for [`Store::open`].
    pub fn open_with(path: impl Into<PathBuf>, mode: IoMode) -> Result<Self, OpenError> {
        Self::open_at(path.into(), mode, None)
    }

    /// Opens the pyramid reduced by `method`: the main or the second one.
    ///
    /// # Errors
    /// As for [`Store::open`], or if neither pyramid is made by `method`.
    pub fn open_reduced(path: impl Into<PathBuf>, method: Downsample, mode: IoMode) -> Result<Self, OpenError> {
        Self::open_at(path.into(), mode, Some(method))
    }

    /// Opens the pyramid made by `method`, by default the main one.
    fn open_at(path: PathBuf, mode: IoMode, method: Option<Downsample>) -> Result<Self, OpenError> {
        first_objects::look_ahead(&path);
        let foreign = || Self::of_foreign(Foreign::open(&path)?, method);
        if foreign::is_place(&path) {
            return foreign();
        }
        match Self::open_own_at(path.clone(), mode, method) {
            Err(OpenError::Unsupported { advice: OTHERS_STORE, .. }) if foreign::is_foreign(&path) => foreign(),
            // Python writes numbers into documents that JSON lacks, and reads them.
            Err(error) if error.is_of_json() && foreign::is_foreign(&path) => foreign().or(Err(error)),
            own => own,
        }
    }

    /// Opens the main pyramid of a store of brickyard's, which alone can be changed and verified.
    ///
    /// # Errors
    /// As for [`Store::open`], or if the store is another program's.
    pub fn open_own(path: impl Into<PathBuf>) -> Result<Self, OpenError> {
        Self::open_own_at(path.into(), IoMode::default(), None)
    }

    fn open_own_at(path: PathBuf, mode: IoMode, method: Option<Downsample>) -> Result<Self, OpenError> {
        let open = || Self::open_view(&Arc::new(open_folder(&path)?), mode, method);
        let mut opened = open();
        for _ in 0..MOST_CHANGES {
            // If the store is replaced, open its successor.
            let Err(OpenError::Replaced { .. }) = opened else { break };
            opened = open();
        }
        opened.map_err(|error| inside::explained(error, &path))
    }

    /// Opens a pyramid between two changes of the store.
    pub(crate) fn open_view(folder: &Arc<Folder>, mode: IoMode, method: Option<Downsample>) -> Result<Self, OpenError> {
        let mut text = read_root(folder)?;
        for _ in 0..MOST_CHANGES {
            let opened = Self::open_with_root(folder, mode, method, &text);
            if opened.is_ok() {
                return opened;
            }
            // Contradictory documents may straddle a change; each change writes the root document last.
            match read_root(folder) {
                Ok(now) if now != text => text = now,
                _ => return opened,
            }
        }
        Self::open_with_root(folder, mode, method, &text)
    }

    /// Opens the pyramid made by `method` of the same store, even if its folder has moved.
    ///
    /// # Errors
    /// As for [`Store::open_reduced`], or if the store was deleted.
    pub fn reduced(&self, method: Downsample) -> Result<Self, OpenError> {
        match &self.bricks {
            Bricks::Own(own) => Self::open_view(&own.folder, own.mode, Some(method)),
            Bricks::Foreign(foreign) if method == foreign.method() => Self::open(foreign.path()),
            Bricks::Foreign(foreign) => Err(foreign.no_reduction(method)),
        }
    }

    /// Opens a pyramid, given the bytes of the root document.
    pub(crate) fn open_with_root(
        folder: &Arc<Folder>,
        mode: IoMode,
        method: Option<Downsample>,
        text: &[u8],
    ) -> Result<Self, OpenError> {
        let path = folder.path();
        let root_path = path.join("zarr.json");
        let Root { document: root, ngff, .. } = Root::parse(&root_path, text)?;
        let info = parse_info(&root_path, &root)?;
        if !info.complete {
            return Err(OpenError::Incomplete { percent: journal_percent(path).unwrap_or(0), path: path.into() });
        }
        let level_0_path = path.join("0/zarr.json");
        let level_0 = read_json(folder, &level_0_path)?;
        let mut layout = parse_layout(&root_path, &root, &level_0_path, &level_0, &info)?;
        if let Some(asked) = method.filter(|m| *m != info.downsample.main()) {
            if Some(asked) != info.downsample.second() {
                return Err(OpenError::NoReduction { path: path.into(), asked, found: info.downsample });
            }
            layout = layout.of_second(asked);
        }
        let geometry = parse_geometry(&root_path, &root, &layout, &info)?;
        let placement = parse_placement(&root_path, &info, &geometry)?;
        let time = parse_time(&root_path, &root, &layout, info.time.as_ref())?;
        let documents = layout.levels().flat_map(|level| array_documents(path, &layout, level, &info));
        // The other arrays' follow from the root's: at an address they are left to the verification, for a round trip less.
        for (path, expected) in documents.filter(|(path, _)| !folder.is_remote() || *path == level_0_path) {
            check_array(&path, &expected, &read_json(folder, &path)?, info.times.is_some())?;
        }
        if folder.is_remote() {
            folder.look_ahead(&first_objects::paths(path, &layout, &info));
        }
        let aprons = info.apron().map(|apron| {
            let codec = BrickCodec::of_aprons(info.codec, info.voxel_type, apron);
            Chunks::new(folder, layout.of_aprons(), codec, mode)
        });
        let codec = BrickCodec::new(info.codec, info.voxel_type, info.edge);
        let own = Own {
            ngff,
            folder: folder.clone(),
            mode,
            root_hash: hash(text),
            sides: SidePages::new(folder, &layout, info.voxel_type),
            cores: Chunks::new(folder, layout.clone(), codec, mode),
            aprons,
        };
        Ok(Self {
            layout,
            geometry,
            placement,
            time,
            displays: parse_displays(&root, &info),
            label_colors: parse_label_colors(&root),
            info,
            bricks: Bricks::Own(Box::new(own)),
        })
    }

    /// Opens another program's image as a store.
    pub(crate) fn of_foreign(foreign: Foreign, method: Option<Downsample>) -> Result<Self, OpenError> {
        if let Some(method) = method.filter(|method| *method != foreign.method()) {
            return Err(foreign.no_reduction(method));
        }
        let Described { layout, geometry, placement, time, info, displays, label_colors } = foreign.describe()?;
        let bricks = Bricks::Foreign(Box::new(foreign));
        Ok(Self { layout, geometry, placement, time, info, displays, label_colors, bricks })
    }

    /// Reopens the store if time steps were appended since; otherwise `None`. This handle's data never change. If
    /// nothing was written, only the root document is read, without parsing.
    ///
    /// # Errors
    /// As for [`Store::open`], or if the store was moved, deleted or replaced.
    pub fn newer(&self) -> Result<Option<Self>, OpenError> {
        let Bricks::Own(own) = &self.bricks else { return Ok(None) };
        let (folder, mode) = (&own.folder, own.mode);
        if self.is_replaced() {
            return Err(self.replaced());
        }
        let root_path = self.path().join("zarr.json");
        let text = read_root(folder)?;
        if self.was_opened_with(&text) {
            return Ok(None);
        }
        let info = parse_info(&root_path, &parse_json(&root_path, &text)?)?;
        let (ours, found) = (&self.info.settings_fingerprint, &info.settings_fingerprint);
        if ours != found {
            let field = "attributes.brickyard.settings_fingerprint";
            return Err(OpenError::invalid(&root_path, field, format!("{ours}, as when the store was opened"), found));
        }
        if info.times.is_none_or(|times| times <= self.times()) {
            return Ok(None);
        }
        folder.look_again();
        Self::open_view(folder, mode, self.layout().second()).map(Some)
    }

    /// Whether the root document had these bytes on opening.
    pub(crate) fn was_opened_with(&self, text: &[u8]) -> bool {
        hash(text) == self.own().root_hash
    }

    /// Whether the store is an image of another program's Zarr, drawn where it lies: never written to, without side data, and with
    /// statistics of a sample.
    pub fn is_foreign(&self) -> bool {
        matches!(self.bricks, Bricks::Foreign(_))
    }

    /// Voxels of a chunk of another program's image, the smallest piece decoded alone, on a level; `None` on levels made from finer ones,
    /// and in stores of brickyard's.
    pub fn foreign_chunk(&self, level: Level) -> Option<Extent> {
        match &self.bricks {
            Bricks::Own(_) => None,
            Bricks::Foreign(foreign) => foreign.chunk(level),
        }
    }

    /// Remarks on another program's image, one sentence each.
    pub fn notes(&self) -> &[Note] {
        match &self.bricks {
            Bricks::Own(_) => &[],
            Bricks::Foreign(foreign) => foreign.notes(),
        }
    }

    /// Coarse levels of another program's image that are being made for a reader, if any.
    pub fn making(&self) -> Option<Making> {
        match &self.bricks {
            Bricks::Own(_) => None,
            Bricks::Foreign(foreign) => foreign.making(),
        }
    }

    /// Whether time steps can be appended: there is a time axis, with one step per shard.
    pub fn can_grow(&self) -> bool {
        !self.is_foreign() && self.layout().axes()[0] == "t" && self.layout().shard_times == 1
    }

    /// The store's directory; with `::PATH` for one of several images of another program's Zarr.
    pub fn path(&self) -> &Path {
        match &self.bricks {
            Bricks::Own(own) => own.folder.path(),
            Bricks::Foreign(foreign) => foreign.path(),
        }
    }

    /// Whether the store was moved, deleted or replaced. An open store reads only its own files; deleted ones yield
    /// [`ReadError::Replaced`].
    pub fn is_replaced(&self) -> bool {
        matches!(&self.bricks, Bricks::Own(own) if own.folder.is_replaced())
    }

    /// The error for a store gone from its path.
    pub fn replaced(&self) -> OpenError {
        OpenError::Replaced { store: self.path().into() }
    }

    /// The open files.
    ///
    /// # Panics
    /// If the store is another program's: what changes and verifies stores opens [its own](Store::open_own) alone.
    fn own(&self) -> &Own {
        match &self.bricks {
            Bricks::Own(own) => own,
            Bricks::Foreign(foreign) => {
                panic!("{}: another program's store has no side data", foreign.path().display())
            }
        }
    }

    pub(crate) fn folder(&self) -> &Arc<Folder> {
        &self.own().folder
    }

    /// The store's settings and statistics.
    pub fn info(&self) -> &StoreInfo {
        &self.info
    }

    /// The version of OME-Zarr of the store's metadata; `None` of another program's, whatever it is.
    pub fn ngff(&self) -> Option<Ngff> {
        match &self.bricks {
            Bricks::Own(own) => Some(own.ngff),
            Bricks::Foreign(_) => None,
        }
    }

    /// The reduction method of the open pyramid.
    pub fn downsample(&self) -> Downsample {
        self.layout().second().unwrap_or(self.info.downsample.main())
    }

    /// The layout of the open pyramid.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// The levels and their brick grids.
    pub fn pyramid(&self) -> &Pyramid {
        &self.layout().pyramid
    }

    /// Maps the store's own world (spacing and origin) to that of scenes: a patient's right, front and head in
    /// millimetres if the store has an orientation, otherwise the same world.
    pub fn placement(&self) -> &Placement {
        &self.placement
    }

    /// Spacing, origin and unit: the store's own world, along its own axes.
    pub fn geometry(&self) -> &Geometry {
        &self.geometry
    }

    /// Type of a voxel.
    pub fn voxel_type(&self) -> VoxelType {
        self.info.voxel_type
    }

    /// Number of time steps.
    pub fn times(&self) -> u32 {
        self.layout().times
    }

    /// Acquisition times of the steps, if known. From OME's metadata, editable by other tools, unless unevenly spaced.
    pub fn time_axis(&self) -> Option<&TimeAxis> {
        self.time.as_ref()
    }

    /// Number of channels.
    pub fn channels(&self) -> u32 {
        self.layout().channels
    }

    /// Bytes of a brick's core.
    pub fn core_bytes(&self) -> usize {
        (self.pyramid().edge() as usize).pow(3) * self.voxel_type().bytes()
    }

    /// Least and greatest valid value of level 0 over all channels and time steps; (0, 0) if there is none. The type's limits where only
    /// a sample is known.
    pub fn value_range(&self) -> (f64, f64) {
        if let Some(limits) = self.unknown_range() {
            return limits;
        }
        let ranges = self.info.channels.iter().filter(|c| c.count > 0).map(|c| (c.range[0], c.range[1]));
        ranges.reduce(|a, b| (a.0.min(b.0), a.1.max(b.1))).unwrap_or((0.0, 0.0))
    }

    /// Least and greatest valid value of a channel over all time steps; (0, 0) if there is none. The type's limits where only a sample
    /// is known.
    ///
    /// # Panics
    /// If there is no such channel.
    pub fn channel_range(&self, channel: u32) -> (f64, f64) {
        self.unknown_range().unwrap_or(self.info.channels[channel as usize].range.into())
    }

    /// The bounds of values without exact statistics.
    fn unknown_range(&self) -> Option<(f64, f64)> {
        (!self.has_exact_statistics()).then(|| self.voxel_type().limits())
    }

    /// Whether [`StoreInfo::channels`] are of all voxels, not of a sample.
    pub fn has_exact_statistics(&self) -> bool {
        !matches!(&self.bricks, Bricks::Foreign(foreign) if !foreign.is_exact())
    }

    /// Whether any voxel of level 0 is NaN or infinite, or may be.
    pub fn has_non_finite(&self) -> bool {
        let may_be = matches!(&self.bricks, Bricks::Foreign(foreign) if foreign.may_hide_non_finite());
        may_be || self.info.channels.iter().any(|c| c.has_non_finite())
    }

    /// The integer for no data; `None` if undefined or unused.
    pub fn nodata(&self) -> Option<f64> {
        let is_used = !self.has_exact_statistics() || self.info.channels.iter().any(|channel| channel.nodata > 0);
        self.info.nodata.filter(|_| is_used).map(|nodata| nodata as f64)
    }

    /// The values (low, high) of a channel shown as black and white by default.
    ///
    /// # Panics
    /// If there is no such channel.
    pub fn default_window(&self, channel: u32) -> (f64, f64) {
        self.displays[channel as usize].window
    }

    /// Default displays of the channels, from OME's metadata, editable by other tools.
    pub fn channel_displays(&self) -> &[ChannelDisplay] {
        &self.displays
    }

    /// Label colours, sorted by label, from OME's metadata (`image-label`), editable by other tools.
    pub fn label_colors(&self) -> &[LabelColor] {
        &self.label_colors
    }

    /// Names of the labels listed in the store's folder `labels`, of an image.
    ///
    /// # Errors
    /// If the list is unreadable, or no list.
    pub fn label_names(&self) -> Result<Vec<String>, OpenError> {
        match &self.bricks {
            Bricks::Own(_) => image_labels::names(self.path()),
            Bricks::Foreign(foreign) => Ok(foreign.label_names().to_vec()),
        }
    }

    /// Whether a channel may contain this label, judging by its range and histogram.
    ///
    /// # Panics
    /// If there is no such channel.
    pub fn may_have_label(&self, channel: u32, label: i64) -> bool {
        if let Some((low, high)) = self.unknown_range() {
            return (low..=high).contains(&(label as f64));
        }
        let ChannelStatistics { range: [low, high], histogram, .. } = &self.info.channels[channel as usize];
        let label = label as f64;
        // In counts by class, a bin's share may round to zero.
        let is_exact = self.info.voxel_type.bytes() <= 2 || histogram.width <= 1.0;
        let bin = ((label - histogram.low) / histogram.width) as usize;
        let count = histogram.counts.get(bin.min(histogram.counts.len() - 1));
        *low <= label && label <= *high && (!is_exact || count.is_none_or(|&count| count > 0))
    }

    /// The bins of a channel's occupancy masks.
    ///
    /// # Panics
    /// If there is no such channel.
    pub fn occupancy_bins(&self, channel: u32) -> OccupancyBins {
        self.info.channels[channel as usize].bins
    }

    /// Reads the value ranges of a page of bricks, uncached.
    ///
    /// # Errors
    /// If the page is unreadable or damaged.
    ///
    /// # Panics
    /// If the store is [foreign](Store::is_foreign), and has no side data.
    pub fn read_ranges(&self, page: PageId) -> Result<RangePage, ReadError> {
        self.own().sides.read_ranges(page)
    }

    /// Reads the hashes (XXH3-128) of a page's decoded cores; zeros past the grid.
    ///
    /// # Errors
    /// If the page is unreadable or damaged.
    ///
    /// # Panics
    /// If the store is [foreign](Store::is_foreign), and has no side data.
    pub fn read_hashes(&self, page: PageId) -> Result<Vec<u128>, ReadError> {
        self.own().sides.read_hashes(page)
    }

    /// The occupancy of a brick and its descendants, with one voxel around each. Recent pages are cached.
    ///
    /// # Errors
    /// If the brick's page is unreadable or damaged.
    pub fn occupancy(&self, id: BrickId) -> Result<Occupancy, ReadError> {
        let own = match &self.bricks {
            Bricks::Own(own) => own,
            Bricks::Foreign(foreign) => {
                let bins = self.occupancy_bins(id.channel);
                let of_range =
                    |range: Option<(f64, f64)>| range.map_or(Occupancy::NONE, |(low, high)| bins.mask(low, high));
                return Ok(foreign.range_around(id).map_or(Occupancy::ALL, of_range));
            }
        };
        let (page, place) = own.sides.ranges_of(id)?;
        Ok(page.occupancy(place, self.occupancy_bins(id.channel)))
    }

    /// Least and greatest valid value of the brick and its descendants; `None` if there is none.
    ///
    /// # Errors
    /// If the brick's page is unreadable or damaged.
    pub fn minmax(&self, id: BrickId) -> Result<Option<(f64, f64)>, ReadError> {
        let own = match &self.bricks {
            Bricks::Own(own) => own,
            Bricks::Foreign(foreign) => return Ok(foreign.range(id).unwrap_or(Some(self.channel_range(id.channel)))),
        };
        let (page, place) = own.sides.ranges_of(id)?;
        Ok(page.core(place))
    }

    /// Bounds the decoded chunks kept of another program's image; the least that reading needs stay. Brickyard's own stores keep little.
    pub fn keep_at_most(&self, bytes: u64) {
        if let Bricks::Foreign(foreign) = &self.bricks {
            foreign.keep_at_most(bytes);
        }
    }

    /// Most memory of open shards and pages of side data, in bytes, at any size of store. Excludes callers' buffers.
    pub fn cache_bytes(&self) -> u64 {
        match &self.bricks {
            Bricks::Own(own) => self.chunks().map(Chunks::cache_bytes).sum::<u64>() + own.sides.cache_bytes(),
            Bricks::Foreign(foreign) => foreign.cache_bytes(),
        }
    }

    /// Whether the store is at an address.
    pub fn is_remote(&self) -> bool {
        is_address(self.path())
    }

    /// Threads that may fetch bricks ahead of those who read them, whose latencies overlap; none for a store on disk.
    pub fn fetchers(&self) -> u32 {
        match &self.bricks {
            _ if !self.is_remote() => 0,
            Bricks::Own(_) => 16,
            Bricks::Foreign(foreign) => foreign.fetching().bricks as u32,
        }
    }

    /// Time until bricks of a store at an address are here, by the last requests: the shard's index, then its bytes. Zero on disk.
    pub fn latency(&self) -> Duration {
        if self.is_remote() { traffic().request_time * 2 } else { Duration::ZERO }
    }

    /// Fetches the encoded bytes of bricks of a store at an address, and of their aprons, or another program's chunks, for reads that follow soon. Waits
    /// for room on the link, then takes as many bricks as there is room for. Failures are left for the reads to report.
    pub fn fetch(&self, take: &mut dyn FnMut(FetchRoom) -> Vec<BrickId>) {
        let Ok(Some(place)) = at(self.path()) else { return };
        let link = place.objects.link();
        let admission = link.admit();
        let (bricks, bytes) = match &self.bricks {
            Bricks::Own(_) => {
                // Fetched bricks wait within half of the room for them.
                let ahead = (arrived::MOST_BYTES / 2 / link.brick_bytes().max(1)).clamp(8, 256) as usize;
                let ids = take(FetchRoom { bricks: admission.bricks, ahead });
                (ids.len(), self.chunks().map(|chunks| chunks.fetch(&ids)).sum())
            }
            Bricks::Foreign(foreign) => {
                let room = foreign.fetching();
                let ids = take(FetchRoom { bricks: 1, ..room });
                foreign.fetch(&ids);
                (ids.len(), link.answer_bytes() * ids.len() as u64)
            }
        };
        admission.fetched(bytes, bricks);
    }

    /// Whether more bytes are asked for at the store's address than a new plan had better wait for.
    pub fn is_backed_up(&self) -> bool {
        matches!(at(self.path()), Ok(Some(place)) if place.objects.link().is_backed_up())
    }

    /// Requests read-ahead of these bricks and their stored aprons, opening their shards if needed. Shards that fail to
    /// open are reported by the read.
    pub fn advise(&self, ids: &[BrickId]) {
        match &self.bricks {
            Bricks::Own(_) => self.chunks().for_each(|chunks| chunks.advise(ids)),
            Bricks::Foreign(_) => {}
        }
    }

    /// Decodes a brick's core, `edge`^3 little-endian voxels, x fastest, into `out`. Absent bricks are all zero. Voxels
    /// past the level's extent are unspecified.
    ///
    /// # Errors
    /// If the brick's shard is missing, replaced or has a damaged index, the brick is damaged, or side data or a file
    /// cannot be read.
    ///
    /// # Panics
    /// If there is no such brick or `out` is not [`Store::core_bytes`] long.
    pub fn read_core(&self, id: BrickId, out: &mut [u8]) -> Result<(), ReadError> {
        match &self.bricks {
            Bricks::Own(own) => own.cores.read(id, out),
            Bricks::Foreign(foreign) => foreign.read(id, out),
        }
    }

    /// The shape of the stored aprons; `None` if none are stored.
    pub fn apron(&self) -> Option<Apron> {
        self.info.apron()
    }

    /// Decodes a brick's stored apron, little-endian voxels in the order of [`Apron`], into `out`. Absent aprons of a
    /// store with aprons are all zero.
    ///
    /// # Errors
    /// As for [`Store::read_core`], for the apron.
    ///
    /// # Panics
    /// If there is no such brick, the store has no aprons, or `out` is not an apron's length.
    pub fn read_apron(&self, id: BrickId, out: &mut [u8]) -> Result<(), ReadError> {
        self.aprons().expect("aprons are stored").read(id, out)
    }

    /// Total file size of this pyramid's aprons in bytes; 0 if none are stored. Reads all fingerprints.
    ///
    /// # Errors
    /// If a page of fingerprints is unreadable or damaged.
    pub fn apron_file_bytes(&self) -> Result<u64, ReadError> {
        let Some(aprons) = self.aprons() else { return Ok(0) };
        let pages = self
            .layout()
            .levels()
            .flat_map(|level| (0..aprons.fingerprint_pages(level)).map(move |page| (level, page)));
        pages.map(|(level, page)| Ok(aprons.files_of_page(level, page)?.1)).sum()
    }

    /// Encoded bytes of bricks and aprons read since opening, including repeated and damaged ones; decoded bytes of another program's
    /// image.
    pub fn bytes_read(&self) -> u64 {
        match &self.bricks {
            Bricks::Own(_) => self.chunks().map(Chunks::bytes_read).sum(),
            Bricks::Foreign(foreign) => foreign.bytes_read(),
        }
    }

    /// Whether the brick's core is stored. Absent cores are all zero.
    ///
    /// # Errors
    /// If the brick's shard is missing, replaced or has a damaged index, or side data or a file cannot be read.
    ///
    /// # Panics
    /// If there is no such brick, or the store is [foreign](Store::is_foreign).
    pub fn is_stored(&self, id: BrickId) -> Result<bool, ReadError> {
        self.own().cores.is_stored(id)
    }

    /// Reads the voxels of a box of a level, little-endian, x fastest, into `out`.
    ///
    /// # Errors
    /// At the first unreadable brick.
    ///
    /// # Panics
    /// If there is no such time step, channel or level, the box leaves the level, or `out` is not the box's length.
    pub fn read_box(
        &self,
        time: u32,
        channel: u32,
        level: Level,
        region: VoxelBox,
        out: &mut [u8],
    ) -> Result<(), ReadError> {
        let whole = self.pyramid().level(level).extent.full_box();
        assert_eq!(region.intersect(whole), region, "box outside the level");
        assert_eq!(out.len() as u64, region.extent().volume() * self.voxel_type().bytes() as u64);
        let mut core = vec![0; self.core_bytes()];
        for index in bricks_of(region, self.info.edge) {
            let id = BrickId { time, channel, level, index };
            self.read_core(id, &mut core)?;
            self.copy_rows(index, &core, region, out);
        }
        Ok(())
    }

    /// Copies the overlap of a brick's `core` and a box into `out`, which holds the box.
    pub(crate) fn copy_rows(&self, index: BrickIndex, core: &[u8], region: VoxelBox, out: &mut [u8]) {
        let (edge, voxel_bytes) = (self.info.edge, self.voxel_type().bytes());
        let corner = index.to_array().map(|i| i * edge);
        // Saturating: the last brick may reach past the greatest index.
        let brick = VoxelBox::new(corner, corner.map(|c| c.saturating_add(edge)));
        let shared = brick.intersect(region);
        let (min, max) = (shared.min.to_array(), shared.max.to_array());
        let row_bytes = (max[0] - min[0]) as usize * voxel_bytes;
        let core_shape = Extent::new(edge, edge, edge);
        let origin = region.min.to_array();
        for z in min[2]..max[2] {
            for y in min[1]..max[1] {
                let at = [min[0], y, z];
                let from = core_shape.linear(std::array::from_fn(|a| at[a] - corner[a])) as usize * voxel_bytes;
                let to = region.extent().linear(std::array::from_fn(|a| at[a] - origin[a])) as usize * voxel_bytes;
                out[to..to + row_bytes].copy_from_slice(&core[from..from + row_bytes]);
            }
        }
    }

    /// Cores, then aprons if stored.
    pub(crate) fn chunks(&self) -> impl Iterator<Item = &Chunks> {
        std::iter::once(self.cores()).chain(self.aprons())
    }

    pub(crate) fn cores(&self) -> &Chunks {
        &self.own().cores
    }

    pub(crate) fn aprons(&self) -> Option<&Chunks> {
        match &self.bricks {
            Bricks::Own(own) => own.aprons.as_ref(),
            Bricks::Foreign(_) => None,
        }
    }

    pub(crate) fn sides(&self) -> &SidePages {
        &self.own().sides
    }
}

/// Bricks of `edge`^3 voxels overlapping a box, x fastest.
pub(crate) fn bricks_of(region: VoxelBox, edge: u32) -> impl Iterator<Item = BrickIndex> {
    let first = region.min.to_array().map(|v| v / edge);
    let end = region.max.to_array().map(|v| v.div_ceil(edge));
    let empty = region.is_empty();
    (first[2]..end[2])
        .flat_map(move |z| {
            (first[1]..end[1]).flat_map(move |y| (first[0]..end[0]).map(move |x| BrickIndex::new(x, y, z)))
        })
        .filter(move |_| !empty)
}

/// Grows a box by `by` cells on each side, within another.
pub(crate) fn grown(region: VoxelBox, by: u32, within: VoxelBox) -> VoxelBox {
    let min = region.min.to_array().map(|v| v.saturating_sub(by));
    VoxelBox::new(min, region.max.to_array().map(|v| v.saturating_add(by))).intersect(within)
}

fn hash(text: &[u8]) -> u64 {
    xxhash_rust::xxh3::xxh3_64(text)
}

/// Opens a store's folder, or diagnoses the thing in its place.
pub(crate) fn open_folder(store: &Path) -> Result<Folder, OpenError> {
    Folder::open(store).map_err(|error| match error.kind() {
        ErrorKind::NotADirectory if store.exists() => OpenError::NotAStore { path: store.into() },
        _ => OpenError::Io { path: store.into(), error },
    })
}

/// Reads the root document, or diagnoses the thing in its place.
fn read_root(folder: &Folder) -> Result<Vec<u8>, OpenError> {
    let store = folder.path();
    match folder.document(&store.join("zarr.json")) {
        Err(OpenError::Io { error, .. }) if error.kind() == ErrorKind::NotFound => {}
        other => return other,
    }
    // Before the journal, for which an address would be asked once more.
    if folder.has_any(&[store.join(".zgroup"), store.join(".zarray")])? {
        let feature = "a Zarr v2 hierarchy (OME-Zarr 0.4 or older)".into();
        return Err(OpenError::Unsupported { path: store.into(), feature, advice: OTHERS_STORE });
    }
    if folder.has_any(&[store.join(JOURNAL_NAME)])? {
        return Err(OpenError::Incomplete { path: store.into(), percent: journal_percent(store).unwrap_or(0) });
    }
    Err(OpenError::NotAStore { path: store.into() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::codec::Codec;
    use crate::test_store::{TestStore, bumps};
    use serde_json::{Value, json};

    fn written(spec: &TestStore) -> tempfile::TempDir {
        let dir = tempfile::tempdir().unwrap();
        spec.write(dir.path(), bumps);
        dir
    }

    /// Covers all voxels, levels, types, codecs and I/O modes, odd extents, steps and channels.
    #[test]
    fn stores_read_back_bit_for_bit() {
        for voxel_type in VoxelType::ALL {
            for (codec, times, channels, shard_times) in
                [(Codec::default_for(voxel_type), 2, 3, 1), (Codec::None, 1, 1, 1), (Codec::None, 3, 2, 2)]
            {
                let spec = TestStore { voxel_type, codec, times, channels, shard_times, ..TestStore::default() };
                let dir = written(&spec);
                for mode in [IoMode::Mmap, IoMode::Pread] {
                    let store = Store::open_with(dir.path(), mode).unwrap();
                    assert_eq!((store.layout(), store.geometry()), (&spec.layout(), &spec.geometry()));
                    for (t, c) in (0..times).flat_map(|t| (0..channels).map(move |c| (t, c))) {
                        for (k, expected) in spec.levels(|v| bumps(t, c, v)).iter().enumerate() {
                            let expected: Vec<u8> = expected.iter().flat_map(|v| spec.bytes_of(*v)).collect();
                            let level = Level(k as u8);
                            let mut found = vec![1; expected.len()];
                            let whole = store.pyramid().level(level).extent.full_box();
                            store.read_box(t, c, level, whole, &mut found).unwrap();
                            assert!(found == expected, "{voxel_type} {codec} t{t} c{c} level {k}");
                        }
                    }
                }
            }
        }
    }

    /// A shard lost while open affects only its own bricks.
    #[test]
    fn files_that_change_while_open_are_damaged_bricks() {
        let spec = TestStore { codec: Codec::None, ..TestStore::default() };
        let (first, other) = (BrickIndex::new(0, 0, 2), BrickIndex::new(2, 0, 0));
        let id = |index| BrickId { time: 0, channel: 0, level: Level(0), index };
        for mode in [IoMode::Mmap, IoMode::Pread] {
            let dir = written(&spec);
            let store = Store::open_with(dir.path(), mode).unwrap();
            let mut core = vec![0; store.core_bytes()];
            for index in [first, other] {
                store.read_core(id(index), &mut core).unwrap();
            }
            let path = store.layout().shard_path(dir.path(), store.layout().shard_of(id(first)).0);
            let file = std::fs::OpenOptions::new().write(true).open(&path).unwrap();
            std::os::unix::fs::FileExt::write_all_at(&file, &[1, 2, 3], 5).unwrap();
            let found = store.read_core(id(first), &mut core);
            assert!(matches!(&found, Err(ReadError::CorruptBrick { .. })), "{mode:?}: {found:?}");
            for bytes in [100, 0] {
                file.set_len(bytes).unwrap();
                let found = store.read_core(id(first), &mut core);
                let message = found.as_ref().expect_err("most of the brick is gone").to_string();
                assert!(message.contains(path.to_str().unwrap()), "{mode:?}: {message}");
                assert!(
                    matches!(found, Err(ReadError::Rewritten { what: "bytes", found, .. }) if found == bytes)
                        || mode == IoMode::Pread,
                    "{message}"
                );
            }
            std::fs::remove_file(&path).unwrap();
            assert!(store.read_core(id(first), &mut core).is_err(), "{mode:?}");
            store.read_core(id(other), &mut core).unwrap();
        }
    }

    #[test]
    fn boxes_across_bricks_are_cut_right() {
        let spec = TestStore::default();
        let dir = written(&spec);
        let store = Store::open(dir.path()).unwrap();
        let region = VoxelBox::new([5, 7, 8], [37, 9, 17]);
        let expected: Vec<u8> = crate::test_store::voxels(region).flat_map(|v| spec.bytes_of(bumps(0, 0, v))).collect();
        let mut found = vec![0; expected.len()];
        store.read_box(0, 0, Level(0), region, &mut found).unwrap();
        assert!(found == expected);
        store.read_box(0, 0, Level(0), VoxelBox::new([4, 4, 4], [4, 9, 9]), &mut []).unwrap();
    }

    #[test]
    fn empty_bricks_are_not_stored_and_read_as_zero() {
        let dir = written(&TestStore::default());
        let store = Store::open(dir.path()).unwrap();
        let id = |x| BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(x, 0, 0) };
        assert_eq!([0, 1, 2].map(|x| store.is_stored(id(x)).unwrap()), [false, false, true]);
        let mut core = vec![9; store.core_bytes()];
        store.read_core(id(0), &mut core).unwrap();
        assert!(core.iter().all(|&b| b == 0));
        assert_eq!(store.minmax(id(0)).unwrap(), Some((0.0, 0.0)));
        // Its apron reaches into the next brick.
        let zero = store.occupancy_bins(0).mask(0.0, 0.0);
        assert_eq!([0, 1].map(|x| store.occupancy(id(x)).unwrap() == zero), [true, false]);
    }

    #[test]
    fn advice_about_anything_is_harmless() {
        let dir = written(&TestStore::default());
        let store = Store::open(dir.path()).unwrap();
        let id = |x, level| BrickId { time: 0, channel: 0, level: Level(level), index: BrickIndex::new(x, 2, 1) };
        store.advise(&[id(1, 0), id(0, 0), id(4, 0), id(99, 0), id(0, 9), id(1, 0)]);
        std::fs::remove_dir_all(dir.path().join("0/c")).unwrap();
        Store::open(dir.path()).unwrap().advise(&[id(0, 0)]);
    }

    /// Contract: any damaged byte in a shard makes some read fail with a message naming the file.
    #[test]
    fn every_damaged_byte_of_a_shard_is_found() {
        for (voxel_type, codec) in [(VoxelType::U8, Codec::Zstd(1)), (VoxelType::U16, Codec::ShuffleZstd(1))] {
            let spec = TestStore { extent: [29, 8, 8], voxel_type, codec, ..TestStore::default() };
            let dir = written(&spec);
            let path = dir.path().join("0/c/0/0/1");
            let sound = std::fs::read(&path).unwrap();
            for i in 0..sound.len() {
                let mut bad = sound.clone();
                bad[i] ^= 0x10;
                std::fs::write(&path, bad).unwrap();
                let store = Store::open(dir.path()).unwrap();
                let mut voxels = vec![0; 29 * 8 * 8 * voxel_type.bytes()];
                let error = store.read_box(0, 0, Level(0), VoxelBox::new([0; 3], [29, 8, 8]), &mut voxels).unwrap_err();
                assert!(error.to_string().contains("0/c/0/0/1"), "byte {i}: {error}");
            }
            for n in [0, 1, sound.len() / 2, sound.len() - 1] {
                std::fs::write(&path, &sound[..n]).unwrap();
                let store = Store::open(dir.path()).unwrap();
                let id = BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(2, 0, 0) };
                let error = store.read_core(id, &mut vec![0; store.core_bytes()]).unwrap_err();
                assert!(matches!(error, ReadError::Rewritten { .. }), "cut to {n}: {error}");
            }
        }
    }

    /// A replaced store stays readable while its files exist, and is never confused with its successor.
    #[test]
    fn a_store_that_is_replaced_is_never_mixed_with_the_other() {
        let brighter = |t: u32, c: u32, v: [u32; 3]| bumps(t, c, v) + 100.0;
        for mode in [IoMode::Mmap, IoMode::Pread] {
            let parent = tempfile::tempdir().unwrap();
            let [path, old, new] = ["s.zarr", "old.zarr", "new.zarr"].map(|name| parent.path().join(name));
            let spec = TestStore::default();
            for (path, value) in [(&path, bumps as fn(_, _, _) -> f64), (&new, brighter)] {
                std::fs::create_dir(path).unwrap();
                spec.write(path, value);
            }
            let [read, unread] = [0, 1].map(|_| Store::open_with(&path, mode).unwrap());
            let id = BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(2, 1, 1) };
            let core = |store: &Store| {
                let mut core = vec![0; store.core_bytes()];
                store.read_core(id, &mut core).map(|()| core)
            };
            let [before, of_new] = [&path, &new].map(|path| core(&Store::open(path).unwrap()).unwrap());
            assert!(before != of_new && core(&read).unwrap() == before);
            std::fs::rename(&path, &old).unwrap();
            assert!(unread.is_replaced() && core(&unread).unwrap() == before, "moved away");
            std::fs::rename(&new, &path).unwrap();
            let late = unread.reduced(Downsample::Mean).unwrap();
            assert!(core(&late).unwrap() == before && late.minmax(id).unwrap() == read.minmax(id).unwrap());
            let untouched = unread.reduced(Downsample::Mean).unwrap();
            std::fs::remove_dir_all(&old).unwrap();
            let is_replaced = |error: ReadError| {
                assert!(matches!(&error, ReadError::Replaced { store } if *store == path), "{error}")
            };
            is_replaced(core(&untouched).unwrap_err());
            is_replaced(untouched.occupancy(id).err().unwrap());
            is_replaced(untouched.read_hashes(untouched.pyramid().page_of(id).0).err().unwrap());
            let is_gone = |error: OpenError| assert!(matches!(error, OpenError::Replaced { .. }), "{error}");
            is_gone(untouched.reduced(Downsample::Mean).err().unwrap());
            is_gone(untouched.newer().err().unwrap());
            assert!(core(&Store::open_with(&path, mode).unwrap()).unwrap() == of_new);
        }
    }

    #[test]
    fn missing_and_replaced_shards_are_told_apart() {
        let dir = written(&TestStore::default());
        let path = dir.path().join("0/c/1/0/1");
        let id = BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(2, 0, 2) };
        let read = || {
            let store = Store::open(dir.path()).unwrap();
            store.read_core(id, &mut vec![0; store.core_bytes()]).map_err(|e| e.to_string())
        };
        read().unwrap();
        // A sound shard of the same length, but a different one.
        let other = std::fs::read(&path).unwrap();
        let (body, index) = other.split_at(other.len() - crate::shard::index_bytes(8));
        let index = crate::shard::ShardIndex::new(index, other.len() as u64, 8, 1 << 20).unwrap();
        let mut ranges: Vec<_> = (0..8).map(|slot| index.range(slot).unwrap()).collect();
        ranges.reverse();
        std::fs::write(&path, [body, &crate::shard::encode_index(&ranges).0].concat()).unwrap();
        assert!(read().unwrap_err().contains("rewritten"));
        std::fs::remove_file(&path).unwrap();
        let message = read().unwrap_err();
        assert!(message.contains("missing shard") && message.contains("0/c/1/0/1"), "{message}");
    }

    #[test]
    fn what_is_not_a_finished_store_says_what_it_is() {
        let dir = tempfile::tempdir().unwrap();
        let open = |path: &Path| Store::open(path).err().unwrap();
        assert!(matches!(open(dir.path()), OpenError::NotAStore { .. }));
        assert!(matches!(open(&dir.path().join("nowhere")), OpenError::Io { .. }));
        let file = dir.path().join("file");
        std::fs::write(&file, "x").unwrap();
        assert!(matches!(open(&file), OpenError::NotAStore { .. }));
        std::fs::write(dir.path().join(JOURNAL_NAME), "{\"shards\": 4}\nx\n").unwrap();
        assert!(matches!(open(dir.path()), OpenError::Incomplete { percent: 25, .. }));
        std::fs::write(dir.path().join("zarr.json"), "{\"zarr_format\": 3, \"attributes\": {\"ome\": {}}}").unwrap();
        assert!(matches!(open(dir.path()), OpenError::Unsupported { .. }));
        std::fs::write(dir.path().join("zarr.json"), "{").unwrap();
        assert!(matches!(open(dir.path()), OpenError::Invalid { .. }));
    }

    /// Each contradiction in the metadata is refused with a message naming the field.
    #[test]
    fn contradictions_name_their_field() {
        let dir = written(&TestStore { times: 3, shard_times: 2, ..TestStore::default() });
        let cases: [(&str, &str, Value, &str); 23] = [
            ("zarr.json", "/attributes/brickyard/version", json!(3), "version 3"),
            ("zarr.json", "/attributes/brickyard/version", json!(1), "pack it anew"),
            ("zarr.json", "/attributes/brickyard/edge", json!(0), "edge"),
            ("zarr.json", "/attributes/brickyard/edge", json!(16), "datasets"),
            ("zarr.json", "/attributes/brickyard/shard", json!(0), "shard"),
            ("zarr.json", "/attributes/brickyard/shard_times", json!(0), "shard_times: expected 1 to 3"),
            ("zarr.json", "/attributes/brickyard/shard_times", json!(4), "shard_times: expected 1 to 3"),
            ("zarr.json", "/attributes/brickyard/shard_times", json!(1), "chunk_grid"),
            ("zarr.json", "/attributes/brickyard/codec", json!("lzma:3"), "lzma"),
            ("zarr.json", "/attributes/brickyard/codec", json!("zstd:3"), "codecs"),
            ("zarr.json", "/attributes/brickyard/voxel_type", json!("u8"), "data_type"),
            ("zarr.json", "/attributes/brickyard/spacing", json!([1, 1, 0]), "spacing"),
            ("zarr.json", "/attributes/brickyard/spacing", json!([1, 1, 9]), "datasets"),
            ("zarr.json", "/attributes/brickyard/channels", json!([]), "channels"),
            ("zarr.json", "/attributes/brickyard/complete", json!(false), "incomplete"),
            ("zarr.json", "/attributes/ome/multiscales/0/axes/0/name", json!("q"), "axes"),
            (
                "zarr.json",
                "/attributes/ome/multiscales/0/datasets/1/coordinateTransformations/0/scale/3",
                json!(7),
                "datasets[1]",
            ),
            ("0/zarr.json", "/shape/3", json!(-4), "shape"),
            ("0/zarr.json", "/shape", json!([4294967295u32, 4294967295u32, 4294967295u32, 4294967295u32]), "shape"),
            ("0/zarr.json", "/shape/3", json!(4294967295u32), "datasets"),
            ("1/zarr.json", "/shape/3", json!(3), "shape"),
            ("1/.brickyard/ranges/zarr.json", "/shape/4", json!(5), "shape"),
            ("1/.brickyard/hashes/zarr.json", "/data_type", json!("int64"), "data_type"),
        ];
        for (file, pointer, value, named) in cases {
            let path = dir.path().join(file);
            let sound = std::fs::read(&path).unwrap();
            let mut document: Value = serde_json::from_slice(&sound).unwrap();
            *document.pointer_mut(pointer).unwrap() = value.clone();
            std::fs::write(&path, document.to_string()).unwrap();
            let message = Store::open(dir.path()).err().unwrap().to_string();
            assert!(message.contains(named) && message.contains("tmp"), "{pointer}: {message}");
            std::fs::write(&path, sound).unwrap();
        }
    }

    /// Opening reads no side data: damage there shows on access, with the page's name.
    #[test]
    fn damaged_side_data_are_named_when_they_are_read() {
        let dir = written(&TestStore { times: 2, ..TestStore::default() });
        for (file, what) in [("ranges", 7), ("shards", 9)] {
            let path = dir.path().join("0/.brickyard").join(file).join("c/1/0/0/0/0/0");
            let sound = std::fs::read(&path).unwrap();
            let mut bad = sound.clone();
            bad[what] ^= 1;
            let cut = sound[..3].to_vec();
            for (bad, named) in
                [(bad, "checksum"), (cut, "shorter than its checksum"), (vec![0; 1 << 20], "larger than")]
            {
                std::fs::write(&path, bad).unwrap();
                let store = Store::open(dir.path()).unwrap();
                let id = |time| BrickId { time, channel: 0, level: Level(0), index: BrickIndex::new(3, 1, 1) };
                let read = |time| match file {
                    "ranges" => store.occupancy(id(time)).map(drop),
                    _ => store.read_core(id(time), &mut vec![0; store.core_bytes()]),
                };
                read(0).unwrap();
                let message = read(1).unwrap_err().to_string();
                assert!(message.contains(path.to_str().unwrap()) && message.contains(named), "{message}");
            }
            std::fs::write(&path, sound).unwrap();
        }
    }

    /// 134 million bricks, and a million time steps: opening reads only the documents, the only files here.
    #[test]
    fn opening_takes_the_same_memory_whatever_the_size() {
        const CHILD: &str = "BRICKYARD_TEST_OPEN";
        let Some(path) = std::env::var_os(CHILD).map(PathBuf::from) else {
            for (edge, times) in [(32768, 1), (64, 1_000_000)] {
                let dir = tempfile::tempdir().unwrap();
                let spec = TestStore { extent: [edge; 3], times, edge: 64, shard: 512, ..TestStore::default() };
                spec.write_documents(dir.path());
                let name = "store::tests::opening_takes_the_same_memory_whatever_the_size";
                let child = std::process::Command::new(std::env::current_exe().unwrap())
                    .args(["--exact", name, "--nocapture"])
                    .env(CHILD, dir.path())
                    .output();
                let child = child.unwrap();
                assert!(child.status.success(), "{}", String::from_utf8_lossy(&child.stderr));
            }
            return;
        };
        let anonymous_kib = || -> u64 {
            let status = std::fs::read_to_string("/proc/self/status").unwrap();
            let line = status.lines().find(|line| line.starts_with("RssAnon:")).unwrap();
            line.split_whitespace().nth(1).unwrap().parse().unwrap()
        };
        let before = anonymous_kib();
        let store = Store::open(path).unwrap();
        let after = anonymous_kib();
        assert!(after - before < 4 << 10, "{before} KiB before, {after} KiB after");
        // At most 8 MiB of ranges, 4 of indexes, 1 of fingerprints.
        assert!(store.cache_bytes() < 14 << 20);
    }

    /// More shards than stay open at a time, forwards and backwards.
    #[test]
    fn any_number_of_shards_can_be_read() {
        let spec = TestStore {
            extent: [8 * 600, 2, 2],
            shard: 8,
            voxel_type: VoxelType::U8,
            codec: Codec::Zstd(1),
            ..TestStore::default()
        };
        let dir = written(&spec);
        let maps = || std::fs::read_to_string("/proc/self/maps").unwrap().matches(dir.path().to_str().unwrap()).count();
        let store = Store::open(dir.path()).unwrap();
        let mut core = vec![0; store.core_bytes()];
        for x in (0..600).chain((0..600).rev()) {
            let id = BrickId { time: 0, channel: 0, level: Level(0), index: BrickIndex::new(x, 0, 0) };
            store.advise(&[id]);
            store.read_core(id, &mut core).unwrap();
            let expected = spec.bytes_of(bumps(0, 0, [8 * x + 5, 1, 1]));
            assert_eq!(core[5 + 8 + 64..][..1], expected);
        }
        assert!((1..=512).contains(&maps()), "{} maps", maps());
        drop(store);
        assert_eq!(maps(), 0);
    }

    #[test]
    fn keys_of_other_tools_are_left_alone() {
        let dir = written(&TestStore::default());
        let path = dir.path().join("zarr.json");
        let mut document: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        document["attributes"]["brickyard"]["later"] = json!(1);
        document["consolidated_metadata"] = json!(null);
        std::fs::write(&path, document.to_string()).unwrap();
        assert_eq!(Store::open(dir.path()).unwrap().pyramid().level(Level(0)).extent, Extent::new(37, 20, 19));
    }
}
