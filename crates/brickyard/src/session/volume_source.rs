//! Volumes of a session: a source of bricks, with the metadata for default transfer functions and placement.

use crate::session::table_cache::VolumeTables;
use brickyard_pager::{BrickSource, encoding_of};
use brickyard_store::{ChannelDisplay, ChannelStatistics, Downsample, OpenError, Store};
use brickyard_volume::channel::default_color;
use brickyard_volume::scene::VolumePlace;
use brickyard_volume::{
    Extent, Extreme, LayerError, Mode, Orientation, Placement, PlacementError, Scene, SceneLayer, SlotEncoding,
    StoreCounts, Subject, TimeAxis, Timeline, TransferFunction, VolumeTime,
};
use std::path::Path;
use std::sync::Arc;

/// A volume of a session: the source of its bricks, and the default display of its channels.
#[derive(Clone)]
pub struct VolumeSource {
    /// The source of the bricks.
    pub source: Arc<dyn BrickSource>,
    /// The default display of each channel.
    displays: Vec<ChannelDisplay>,
    /// Statistics of each channel, where known without a store.
    statistics: Vec<ChannelStatistics>,
    /// The volume's orientation in a patient, if known; it then lies there, in millimetres, in the world of scenes.
    orientation: Option<Orientation>,
    /// From the volume's own world to the world of scenes.
    placement: Placement,
    store: Option<Arc<Store>>,
    /// The volume's name, if other than its store's.
    name: Option<String>,
    /// Times of the time steps; `None` if unknown.
    time_axis: Option<Arc<TimeAxis>>,
    /// See [`VolumeSource::held_bytes`].
    held_bytes: u64,
    /// See [`VolumeSource::stride`].
    stride: [u32; 3],
}

/// Returns the reduction that keeps the extremes projected by a mode; `None` if the mode projects none.
fn extreme_of(mode: Mode) -> Option<Downsample> {
    mode.extreme().map(|extreme| match extreme {
        Extreme::Greatest => Downsample::Max,
        Extreme::Least => Downsample::Min,
    })
}

impl VolumeSource {
    /// Creates a volume of a program's own bricks. Default transfer functions span the source's range of values.
    pub fn new(source: Arc<dyn BrickSource>) -> Self {
        let channels = source.channels();
        let display = |channel: u32| ChannelDisplay {
            name: None,
            color: default_color(channel as usize, channels as usize),
            window: source.channel_range(channel),
            is_visible: true,
            unit: None,
        };
        Self {
            displays: (0..channels).map(display).collect(),
            source,
            statistics: Vec::new(),
            orientation: None,
            placement: Placement::default(),
            store: None,
            name: None,
            time_axis: None,
            held_bytes: 0,
            stride: [1; 3],
        }
    }

    /// Sets the channels' default displays from their statistics.
    ///
    /// # Panics
    /// If there is not one for each channel.
    pub fn described_by(self, statistics: Vec<ChannelStatistics>) -> Self {
        assert_eq!(statistics.len(), self.source.channels() as usize, "one for each channel");
        Self { displays: ChannelDisplay::of_channels(&statistics), statistics, ..self }
    }

    /// Renames this volume.
    pub fn named(self, name: impl Into<String>) -> Self {
        Self { name: Some(name.into()), ..self }
    }

    /// Sets the times of the time steps.
    pub fn taken_at(self, time_axis: TimeAxis) -> Self {
        Self { time_axis: Some(Arc::new(time_axis)), ..self }
    }

    /// Sets the volume's own memory: see [`VolumeSource::held_bytes`].
    pub fn holding(self, held_bytes: u64) -> Self {
        Self { held_bytes, ..self }
    }

    /// Marks this volume as every n-th voxel of another: see [`VolumeSource::stride`].
    pub fn with_stride(self, stride: [u32; 3]) -> Self {
        Self { stride, ..self }
    }

    /// Voxels of the original along x, y and z for each voxel of this volume: 1, except in a preview.
    pub fn stride(&self) -> [u32; 3] {
        self.stride
    }

    /// Places this volume in a patient.
    ///
    /// # Errors
    /// If the orientation does not fit the volume's spacing.
    pub fn oriented(self, orientation: Orientation) -> Result<Self, PlacementError> {
        let placement = orientation.placement(self.source.geometry())?;
        Ok(Self { orientation: Some(orientation), placement, ..self })
    }

    /// Opens the store in a folder as a volume.
    ///
    /// # Errors
    /// If the store does not open.
    pub fn open(store: impl AsRef<Path>) -> Result<Self, OpenError> {
        Ok(Self::of_store(&Arc::new(Store::open(store.as_ref())?)))
    }

    /// Creates a volume from an open store, with the default windows of the store's channels.
    pub fn of_store(store: &Arc<Store>) -> Self {
        Self {
            displays: store.channel_displays().to_vec(),
            orientation: store.info().orientation,
            placement: *store.placement(),
            store: Some(store.clone()),
            time_axis: store.time_axis().cloned().map(Arc::new),
            ..Self::new(store.clone())
        }
    }

    /// Opens this volume's pyramid for a mode; `None` if this one suits.
    ///
    /// The mean of eight voxels hides the greatest of them, so a maximum projection of a coarse level shows too little.
    /// A store packed with `mean,max` has a second pyramid of maxima, in which the projection is right at every level;
    /// likewise with `min`. Costs opening the store once more: milliseconds.
    ///
    /// # Errors
    /// If the other pyramid does not open.
    pub fn for_mode(&self, mode: Mode) -> Result<Option<Self>, OpenError> {
        let Some(store) = &self.store else { return Ok(None) };
        let reductions = store.info().downsample;
        // Labels are not projected by number, only by visibility.
        let extreme =
            extreme_of(mode).filter(|extreme| !self.source.is_labels() && reductions.second() == Some(*extreme));
        let wanted = extreme.unwrap_or(reductions.main());
        if store.downsample() == wanted {
            return Ok(None);
        }
        let store = store.reduced(wanted)?;
        Ok(Some(Self { name: self.name.clone(), ..Self::of_store(&Arc::new(store)) }))
    }

    /// Whether coarse voxels are the extremes projected by a mode, so the projection loses none at any level.
    pub fn keeps_extremes(&self, mode: Mode) -> bool {
        let made_by = self.store.as_ref().map(|store| store.downsample());
        !self.source.is_labels() && made_by.is_some() && made_by == extreme_of(mode)
    }

    /// Returns this volume with the pyramid for a mode.
    ///
    /// # Errors
    /// The errors of [`VolumeSource::for_mode`].
    pub fn suited(self, mode: Mode) -> Result<Self, OpenError> {
        Ok(self.for_mode(mode)?.unwrap_or(self))
    }

    /// The volume's orientation in a patient; `None` if unknown.
    pub fn orientation(&self) -> Option<Orientation> {
        self.orientation
    }

    /// The volume's [given name](Self::named), or else the name of its store's folder; `None` if unknown.
    pub fn name(&self) -> Option<String> {
        let of_store = || Some(self.store.as_ref()?.path().file_stem()?.to_string_lossy().into_owned());
        self.name.clone().or_else(of_store)
    }

    /// The volume's store; `None` for a program's own bricks.
    pub fn store(&self) -> Option<&Arc<Store>> {
        self.store.as_ref()
    }

    /// Upper bound of the volume's own memory in bytes, however many sessions show it: a
    /// [`Preview`](crate::window::preview::Preview) keeps its bricks. It is outside all sessions' budgets, so a program
    /// with an overall limit subtracts it once.
    pub fn held_bytes(&self) -> u64 {
        self.held_bytes
    }

    /// The default display of each channel.
    pub fn displays(&self) -> &[ChannelDisplay] {
        &self.displays
    }

    /// The unit of a channel's values; `None` if unknown, and for labels.
    pub fn value_unit(&self, channel: u32) -> Option<&str> {
        let display = self.displays.get(channel as usize).filter(|_| !self.source.is_labels())?;
        display.unit.as_deref()
    }

    /// The unit of all channels' values; `None` if unknown, or if they have different ones.
    pub fn common_unit(&self) -> Option<&str> {
        let first = self.value_unit(0)?;
        (1..self.source.channels()).all(|channel| self.value_unit(channel) == Some(first)).then_some(first)
    }

    /// The statistics of a channel; `None` if unknown.
    pub fn statistics(&self, channel: u32) -> Option<&ChannelStatistics> {
        let all = self.store.as_ref().map_or(&self.statistics, |store| &store.info().channels);
        all.get(channel as usize)
    }

    /// Least and greatest value of a channel, as far as they are known: by its statistics, be it of a sample, or else the source's bounds.
    pub fn likely_range(&self, channel: u32) -> (f64, f64) {
        self.statistics(channel).map_or_else(|| self.source.channel_range(channel), |found| found.range.into())
    }

    /// The subject of a channel's transfer function: the place, extent and window to fit the function to.
    pub fn subject(&self, channel: u32) -> Subject {
        let is_labels = self.source.is_labels();
        let foreground = self.statistics(channel).and_then(ChannelStatistics::foreground);
        Subject { is_labels, foreground, ..self.subject_of(self.default_window(channel)) }
    }

    /// The subject of a transfer function for values in a window. Distances are in the world of scenes, gradients in
    /// the volume's own.
    pub(crate) fn subject_of(&self, window: (f64, f64)) -> Subject {
        let own = Subject::new(self.source.geometry(), self.extent(), window);
        let placed = self.placement.placed(self.source.geometry());
        Subject { mean_spacing: own.mean_spacing, ..Subject::new(&placed, self.extent(), window) }
    }

    /// Returns the transfer function of a layer's style for this volume. Labels without colours of the style take those
    /// in their store's metadata.
    ///
    /// # Errors
    /// The errors of [`SceneLayer::function`].
    pub fn function(&self, layer: &SceneLayer) -> Result<TransferFunction, LayerError> {
        let mut function = layer.function(&self.subject(layer.channel))?;
        let own = self.store.as_ref().map_or(&[][..], |store| store.label_colors());
        if let Some(colors) = function.labels.as_mut().and_then(|look| look.colors.as_mut()).filter(|c| c.is_empty()) {
            colors.extend_from_slice(own);
        }
        Ok(function)
    }

    pub(crate) fn default_window(&self, channel: u32) -> (f64, f64) {
        self.displays.get(channel as usize).map_or_else(|| self.source.channel_range(channel), |display| display.window)
    }

    /// Counts of the volume's levels, time steps and channels, for [`Scene::check`](brickyard_volume::Scene::check).
    pub fn counts(&self) -> StoreCounts {
        let levels = self.source.pyramid().levels().len();
        let (times, channels) = (self.source.times(), self.source.channels());
        StoreCounts { levels, times, channels, is_labels: self.source.is_labels() }
    }

    /// Times of the volume's time steps; `None` if unknown.
    pub fn time_axis(&self) -> Option<&TimeAxis> {
        self.time_axis.as_deref()
    }

    /// Returns the common time steps of a scene's layers in these volumes.
    pub fn timeline(volumes: &[Self], scene: &Scene) -> Timeline {
        let time = |volume: &Self| VolumeTime { steps: volume.source.times(), axis: volume.time_axis.clone() };
        Timeline::new(volumes.iter().map(time).collect(), (0..scene.layers.len()).map(|layer| scene.store(layer)))
    }

    /// The voxels of level 0 along x, y, z.
    pub fn extent(&self) -> Extent {
        self.source.pyramid().levels()[0].extent
    }

    /// The volume's place in the world of scenes.
    pub fn place(&self) -> VolumePlace {
        let own_box = self.source.geometry().world_box(self.extent());
        VolumePlace { own_box, placement: self.placement, is_anatomical: self.orientation.is_some() }
    }

    /// Creates empty transfer tables of the volume's channels for a session.
    pub(crate) fn tables(&self, is_live: bool) -> VolumeTables {
        VolumeTables::new((0..self.source.channels()).map(|channel| self.encoding(channel)), is_live)
    }

    pub(crate) fn encoding(&self, channel: u32) -> SlotEncoding {
        encoding_of(&*self.source, channel)
    }
}
