//! A volume as sessions take it: where its bricks come from, and what transfer functions are to know of it.

use crate::session::table_cache::VolumeTables;
use brickyard_pager::{BrickSource, encoding_of};
use brickyard_store::{ChannelDisplay, ChannelStatistics, Downsample, OpenError, Store};
use brickyard_volume::channel::default_color;
use brickyard_volume::layer::label_codes;
use brickyard_volume::scene::VolumePlace;
use brickyard_volume::{
    Extent, LabelCodes, LayerError, Mode, Orientation, Placement, PlacementError, Scene, SceneLayer, SlotEncoding,
    StoreCounts, Subject, TimeAxis, Timeline, TransferFunction, VolumeTime,
};
use std::path::Path;
use std::sync::Arc;

/// A volume as sessions take it: where its bricks come from, and how its channels are shown unless a scene says otherwise.
#[derive(Clone)]
pub struct VolumeSource {
    /// Where the bricks come from.
    pub source: Arc<dyn BrickSource>,
    /// How each channel is shown unless a scene says otherwise: one for each channel.
    displays: Vec<ChannelDisplay>,
    /// Statistics of each channel, where they are known and there is no store that has them.
    statistics: Vec<ChannelStatistics>,
    /// How the volume lies in a patient, if that is known: then it stands there, in millimetres, in the world of scenes.
    orientation: Option<Orientation>,
    /// From the volume's own world to that of scenes.
    placement: Placement,
    /// The store that it is, if it is one.
    store: Option<Arc<Store>>,
    /// What the volume is called, if that is not its store's name.
    name: Option<String>,
    /// When the time steps were taken; `None` if that is not known.
    time_axis: Option<Arc<TimeAxis>>,
    /// See [`VolumeSource::held_bytes`].
    held_bytes: u64,
    /// See [`VolumeSource::stride`].
    stride: [u32; 3],
}

/// The reduction that keeps what a mode projects; `None` if the mode projects no extreme.
fn extreme_of(mode: Mode) -> Option<Downsample> {
    match mode {
        Mode::Mip => Some(Downsample::Max),
        Mode::MinIp => Some(Downsample::Min),
        Mode::Dvr | Mode::Average | Mode::Isosurface => None,
    }
}

impl VolumeSource {
    /// Makes a volume of a program's own bricks. Default transfer functions span the source's range of values.
    pub fn new(source: Arc<dyn BrickSource>) -> Self {
        let channels = source.channels();
        let display = |channel: u32| ChannelDisplay {
            name: None,
            color: default_color(channel as usize, channels as usize),
            window: source.channel_range(channel),
            is_visible: true,
        };
        let displays = (0..channels).map(display).collect();
        let (statistics, placement) = (Vec::new(), Placement::default());
        Self {
            source,
            displays,
            statistics,
            orientation: None,
            placement,
            store: None,
            name: None,
            time_axis: None,
            held_bytes: 0,
            stride: [1; 3],
        }
    }

    /// This volume, whose channels are shown as their statistics say.
    ///
    /// # Panics
    /// If there is not one for each channel.
    pub fn described_by(self, statistics: Vec<ChannelStatistics>) -> Self {
        assert_eq!(statistics.len(), self.source.channels() as usize, "one for each channel");
        Self { displays: ChannelDisplay::of_channels(&statistics), statistics, ..self }
    }

    /// This volume, under another name.
    pub fn named(self, name: impl Into<String>) -> Self {
        Self { name: Some(name.into()), ..self }
    }

    /// This volume, whose time steps were taken at these times.
    pub fn taken_at(self, time_axis: TimeAxis) -> Self {
        Self { time_axis: Some(Arc::new(time_axis)), ..self }
    }

    /// This volume, which takes so much memory itself: see [`VolumeSource::held_bytes`].
    pub fn holding(self, held_bytes: u64) -> Self {
        Self { held_bytes, ..self }
    }

    /// This volume, which has only every n-th voxel of another: see [`VolumeSource::stride`].
    pub fn with_stride(self, stride: [u32; 3]) -> Self {
        Self { stride, ..self }
    }

    /// How many voxels along x, y and z of what the volume stands for each of its own covers: 1, but in a preview.
    pub fn stride(&self) -> [u32; 3] {
        self.stride
    }

    /// This volume, as it lies in a patient.
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

    /// Makes a volume of an open store, with the default windows of the store's channels.
    pub fn of_store(store: &Arc<Store>) -> Self {
        Self {
            source: store.clone(),
            displays: store.channel_displays().to_vec(),
            statistics: Vec::new(),
            orientation: store.info().orientation,
            placement: *store.placement(),
            store: Some(store.clone()),
            name: None,
            time_axis: store.time_axis().cloned().map(Arc::new),
            held_bytes: 0,
            stride: [1; 3],
        }
    }

    /// Opens this volume's pyramid that suits a mode; `None` if this one does.
    ///
    /// The mean of eight voxels hides the greatest of them, so a maximum projection of a coarse level shows too little. A store packed with
    /// `mean,max` has a second pyramid of maxima, in which the projection is right at every level; likewise with `min`. Costs
    /// opening the store once more: milliseconds.
    ///
    /// # Errors
    /// If the other pyramid does not open.
    pub fn for_mode(&self, mode: Mode) -> Result<Option<Self>, OpenError> {
        let Some(store) = &self.store else { return Ok(None) };
        let reductions = store.info().downsample;
        // Labels are not projected by their numbers: which of them are shown counts.
        let extreme =
            extreme_of(mode).filter(|extreme| !self.source.is_labels() && reductions.second() == Some(*extreme));
        let wanted = extreme.unwrap_or(reductions.main());
        if store.downsample() == wanted {
            return Ok(None);
        }
        let store = store.reduced(wanted)?;
        Ok(Some(Self { name: self.name.clone(), ..Self::of_store(&Arc::new(store)) }))
    }

    /// Whether voxels of coarse levels are the extremes that a mode projects, so that the projection loses none at any level.
    pub fn keeps_extremes(&self, mode: Mode) -> bool {
        let made_by = self.store.as_ref().map(|store| store.downsample());
        !self.source.is_labels() && made_by.is_some() && made_by == extreme_of(mode)
    }

    /// Returns this volume with the pyramid that suits a mode.
    ///
    /// # Errors
    /// As [`VolumeSource::for_mode`].
    pub fn suited(self, mode: Mode) -> Result<Self, OpenError> {
        Ok(self.for_mode(mode)?.unwrap_or(self))
    }

    /// How the volume lies in a patient; `None` if that is not known.
    pub fn orientation(&self) -> Option<Orientation> {
        self.orientation
    }

    /// What the volume is called: as it was [named](Self::named), else as its store's folder is; `None` if that is not known.
    pub fn name(&self) -> Option<String> {
        let of_store = || Some(self.store.as_ref()?.path().file_stem()?.to_string_lossy().into_owned());
        self.name.clone().or_else(of_store)
    }

    /// The store that the volume is of; `None` for a program's own bricks.
    pub fn store(&self) -> Option<&Arc<Store>> {
        self.store.as_ref()
    }

    /// The most memory in bytes that the volume itself takes, however many sessions show it: a [`Preview`](crate::window::preview::Preview) keeps its bricks. It is in no session's
    /// budget, so a program that has a limit for everything takes it off once.
    pub fn held_bytes(&self) -> u64 {
        self.held_bytes
    }

    /// How each channel is shown unless a scene says otherwise: one for each channel.
    pub fn displays(&self) -> &[ChannelDisplay] {
        &self.displays
    }

    /// The statistics of a channel; `None` if they are not known.
    pub fn statistics(&self, channel: u32) -> Option<&ChannelStatistics> {
        let all = self.store.as_ref().map_or(&self.statistics, |store| &store.info().channels);
        all.get(channel as usize)
    }

    /// The subject of a channel's transfer function: the place, extent and window that the function is fitted to.
    pub fn subject(&self, channel: u32) -> Subject {
        let is_labels = self.source.is_labels();
        let foreground = self.statistics(channel).and_then(ChannelStatistics::foreground);
        Subject { is_labels, foreground, ..self.subject_of(self.default_window(channel)) }
    }

    /// The subject of a transfer function for values in a window. Its distances are of the world that scenes have; gradients are by the
    /// volume's own.
    pub(crate) fn subject_of(&self, window: (f64, f64)) -> Subject {
        let own = Subject::new(self.source.geometry(), self.extent(), window);
        let placed = self.placement.placed(self.source.geometry());
        Subject { mean_spacing: own.mean_spacing, ..Subject::new(&placed, self.extent(), window) }
    }

    /// The transfer function that a layer's style gives for this volume. Labels that have colours in their store's metadata, and no others by the
    /// style, have those.
    ///
    /// # Errors
    /// As [`SceneLayer::function`].
    pub fn function(&self, layer: &SceneLayer) -> Result<TransferFunction, LayerError> {
        let mut function = layer.function(&self.subject(layer.channel))?;
        let own = self.store.as_ref().map_or(&[][..], |store| store.label_colors());
        if let Some(colors) = function.labels.as_mut().and_then(|look| look.colors.as_mut()).filter(|c| c.is_empty()) {
            colors.extend_from_slice(own);
        }
        Ok(function)
    }

    /// The codes that a function asks of a channel's labels; `None` if they have the codes that all functions share.
    pub(crate) fn label_codes(
        &self,
        channel: u32,
        function: &TransferFunction,
    ) -> Result<Option<LabelCodes>, LayerError> {
        label_codes(function, &self.encoding(channel))
    }

    pub(crate) fn default_window(&self, channel: u32) -> (f64, f64) {
        self.displays.get(channel as usize).map_or_else(|| self.source.channel_range(channel), |display| display.window)
    }

    /// How many levels, time steps and channels the volume has, for [`Scene::check`](brickyard_volume::Scene::check).
    pub fn counts(&self) -> StoreCounts {
        let levels = self.source.pyramid().levels().len();
        let (times, channels) = (self.source.times(), self.source.channels());
        StoreCounts { levels, times, channels, is_labels: self.source.is_labels() }
    }

    /// When the volume's time steps were taken; `None` if that is not known.
    pub fn time_axis(&self) -> Option<&TimeAxis> {
        self.time_axis.as_deref()
    }

    /// The time steps that a scene's layers have together, of these volumes.
    pub fn timeline(volumes: &[Self], scene: &Scene) -> Timeline {
        let time = |volume: &Self| VolumeTime { steps: volume.source.times(), axis: volume.time_axis.clone() };
        Timeline::new(volumes.iter().map(time).collect(), (0..scene.layers.len()).map(|layer| scene.store(layer)))
    }

    /// The voxels of level 0 along x, y, z.
    pub fn extent(&self) -> Extent {
        self.source.pyramid().levels()[0].extent
    }

    /// Where the volume is.
    pub fn place(&self) -> VolumePlace {
        let own_box = self.source.geometry().world_box(self.extent());
        VolumePlace { own_box, placement: self.placement, is_anatomical: self.orientation.is_some() }
    }

    /// The transfer tables of the volume's channels for a session, none of them filled.
    pub(crate) fn tables(&self, is_live: bool) -> VolumeTables {
        VolumeTables::new((0..self.source.channels()).map(|channel| self.encoding(channel)), is_live)
    }

    pub(crate) fn encoding(&self, channel: u32) -> SlotEncoding {
        encoding_of(&*self.source, channel)
    }
}
