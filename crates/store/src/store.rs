//! An open store: documents in memory, side data and shards opened on first use.
//!
//! Opening reads only the documents (and of another program's image a sample), so it takes milliseconds and constant memory at any size of store. The last few
//! shards and pages stay open; `chunks.rs` reads bricks. Reading never writes. All methods are thread-safe.

mod ahead;

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
use brickyard_objects::is_address;
use brickyard_volume::{
    Apron, BrickId, BrickIndex, Extent, Geometry, LabelColor, Level, Occupancy, OccupancyBins, PageId, Placement,
    Pyramid, TimeAxis, VoxelBox, VoxelType,
};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::Arc;

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
mod tests;
