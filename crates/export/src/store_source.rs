//! A level of a store as a [`Source`]: its voxels, and its place, times and looks as a reader would tell them. Costs a description; a read costs
//! the bricks of its box.

use brickyard_import::{ImportError, SaidKind, Source, SourceInfo};
use brickyard_store::{ChannelDisplay, Kind, Store};
use brickyard_volume::{ChannelLook, Geometry, Level, PlacementError, VoxelBox, channel};
use glam::DVec3;
use std::sync::Arc;

/// A level of an open store.
pub struct StoreSource {
    store: Arc<Store>,
    level: Level,
    info: SourceInfo,
}

impl StoreSource {
    /// Describes a level.
    ///
    /// # Errors
    /// If the store's orientation cannot be used for voxels as large as the level's.
    ///
    /// # Panics
    /// If the store has no such level.
    pub fn new(store: Arc<Store>, level: Level) -> Result<Self, PlacementError> {
        let grid = *store.pyramid().level(level);
        let (spacing, origin) = store.geometry().level_placement(grid.factor);
        // A level's first voxel is centred among the finer ones that it covers.
        let factor = DVec3::from_array(grid.factor.map(f64::from));
        let first = (factor - 1.0) * 0.5;
        let stored = store.info();
        let orientation = stored.orientation.map(|orientation| orientation.strided(factor, first)).transpose()?;
        let info = SourceInfo {
            extent: grid.extent,
            channels: store.channels(),
            times: store.times(),
            time: store.time_axis().cloned(),
            voxel_type: store.voxel_type(),
            geometry: Geometry { spacing, origin, ..store.geometry().clone() },
            calibrated: stored.calibrated,
            says_origin: false,
            turned: stored.turned,
            flip: Some(stored.flipped),
            orientation,
            channel_looks: looks(&store),
            nodata: store.nodata(),
            knows_nodata: store.voxel_type().is_float(),
            kind: kind_of(&store),
            identity: format!("level {level} of {}", store.path().display()),
            notes: Vec::new(),
        };
        Ok(Self { store, level, info })
    }
}

fn kind_of(store: &Store) -> SaidKind {
    match store.info().kind {
        Kind::Labels => SaidKind::Labels("the store"),
        Kind::Image => SaidKind::Image("the store"),
    }
}

/// Looks as given by the packed source or edited since, but for windows: a store has one of each channel.
fn looks(store: &Store) -> Vec<ChannelLook> {
    let (displays, channels) = (store.channel_displays(), &store.info().channels);
    let usual = ChannelDisplay::of_channels(channels);
    let look = |i: usize| {
        let (display, packed, usual) = (&displays[i], &channels[i], &usual[i]);
        let is_given = packed.color.is_some() || display.color != channel::default_color(i, channels.len());
        ChannelLook {
            name: display.name.clone().filter(|name| packed.name.is_some() || usual.name.as_ref() != Some(name)),
            color: is_given.then_some(display.color),
            window: Some(<[f64; 2]>::from(display.window)).filter(|[low, high]| low < high),
            unit: display.unit.clone(),
        }
    };
    (0..channels.len()).map(look).collect()
}

impl Source for StoreSource {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    /// An encoded, a shuffled and a decoded brick.
    fn reader_bytes(&self) -> u64 {
        3 * self.store.core_bytes() as u64
    }

    fn held_bytes(&self) -> u64 {
        self.store.cache_bytes()
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        let read = self.store.read_box(time, channel, self.level, region, out);
        read.map_err(|error| ImportError::Other(Box::new(error)))
    }
}
