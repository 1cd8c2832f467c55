//! A level of a store as a source, with its place, times and looks as a reader would tell them. Costs a description.

use brickyard_import::{SaidKind, SourceInfo};
use brickyard_store::{ChannelDisplay, Kind, LevelSource, Store};
use brickyard_volume::{ChannelLook, Geometry, Level, PlacementError, channel};
use glam::DVec3;
use std::sync::Arc;

/// A level of an open store as a source.
///
/// # Errors
/// If the store's orientation cannot be used for voxels as large as the level's.
///
/// # Panics
/// If the store has no such level.
pub(crate) fn store_source(store: Arc<Store>, level: Level) -> Result<LevelSource, PlacementError> {
    let grid = *store.pyramid().level(level);
    let (spacing, origin) = store.geometry().level_placement(grid.factor);
    // A level's first voxel is centred among the finer ones that it covers.
    let factor = DVec3::from_array(grid.factor.map(f64::from));
    let first = (factor - 1.0) * 0.5;
    let stored = store.info();
    let orientation = stored.orientation.map(|orientation| orientation.strided(factor, first)).transpose()?;
    let info = SourceInfo {
        channels: store.channels(),
        times: store.times(),
        time: store.time_axis().cloned(),
        geometry: Geometry { spacing, origin, ..store.geometry().clone() },
        calibrated: stored.calibrated,
        turned: stored.turned,
        flip: Some(stored.flipped),
        orientation,
        channel_looks: looks(&store),
        nodata: store.nodata(),
        knows_nodata: store.voxel_type().is_float(),
        kind: kind_of(&store),
        identity: format!("level {level} of {}", store.path().display()),
        ..SourceInfo::of_volume(grid.extent, store.voxel_type())
    };
    Ok(LevelSource::new(store, level, info))
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
