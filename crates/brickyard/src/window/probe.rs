//! Values at one place: exact values of all of a volume's channels in the voxel of the finest level there. Reads one
//! brick for each channel.

use crate::session::volume_source::VolumeSource;
use brickyard_pager::{BrickError, BrickSource};
use brickyard_volume::{BrickId, BrickIndex, Level, Placement};
use glam::DVec3;
use std::sync::Arc;

/// The values of all channels of a volume in one voxel of the finest level.
#[derive(Clone, Debug, PartialEq)]
pub struct Probe {
    /// The voxel of level 0, `[x, y, z]` from 0.
    pub voxel: [u32; 3],
    /// The voxel's centre in the world of the volume's store.
    pub world: DVec3,
    /// The value of each channel in stored units; NaN where there is none.
    pub values: Vec<f64>,
}

/// Reads a volume at a place of its store's world, in a time step; `None` if the place is outside the volume.
///
/// # Errors
/// If a brick cannot be read.
///
/// # Panics
/// If there is no such time step.
pub fn probe(volume: &VolumeSource, time: u32, world: DVec3) -> Result<Option<Probe>, BrickError> {
    let own = volume.place().placement.volume_from_world(world);
    let voxel = volume.source.geometry().voxel_from_world(own).floor();
    let extent = volume.extent().to_array();
    let is_inside = (0..3).all(|axis| voxel[axis] >= 0.0 && voxel[axis] < f64::from(extent[axis]));
    if !is_inside { Ok(None) } else { probe_voxel(volume, time, voxel.to_array().map(|v| v as u32)).map(Some) }
}

/// Reads a voxel of level 0 in a time step.
///
/// # Errors
/// If a brick cannot be read.
///
/// # Panics
/// If there is no such voxel or time step.
pub fn probe_voxel(volume: &VolumeSource, time: u32, voxel: [u32; 3]) -> Result<Probe, BrickError> {
    probe_voxel_by(volume, time, voxel, |id| read_core(&*volume.source, id))
}

/// Reads the core of a brick, in the volume's own voxel type.
pub(crate) fn read_core(source: &dyn BrickSource, id: BrickId) -> Result<Arc<[u8]>, BrickError> {
    let bytes = (source.pyramid().edge() as usize).pow(3) * source.voxel_type().bytes();
    let mut core: Arc<[u8]> = std::iter::repeat_n(0, bytes).collect();
    // It has one holder, so the copy never happens.
    source.read_core(id, Arc::make_mut(&mut core))?;
    Ok(core)
}

/// Reads a voxel of level 0 in a time step, from cores returned by `read`.
pub(crate) fn probe_voxel_by(
    volume: &VolumeSource,
    time: u32,
    voxel: [u32; 3],
    mut read: impl FnMut(BrickId) -> Result<Arc<[u8]>, BrickError>,
) -> Result<Probe, BrickError> {
    let source = &*volume.source;
    assert!(volume.extent().contains(voxel) && time < source.times(), "no voxel {voxel:?} in step {time}");
    let (edge, voxel_type) = (source.pyramid().edge(), source.voxel_type());
    let index = BrickIndex::from_array(voxel.map(|v| v / edge));
    let [x, y, z] = voxel.map(|v| (v % edge) as usize);
    let place = x + edge as usize * (y + edge as usize * z);
    let mut value = |channel| {
        let core = read(BrickId { time, channel, level: Level(0), index })?;
        let value = voxel_type.read(&core, place);
        Ok(if source.nodata() == Some(value) { f64::NAN } else { value })
    };
    let values = (0..source.channels()).map(&mut value).collect::<Result<_, BrickError>>()?;
    let centre = DVec3::from_array(voxel.map(f64::from)) + 0.5;
    let placement: Placement = volume.place().placement;
    let world = placement.world_from_volume(source.geometry().world_from_voxel(centre));
    Ok(Probe { voxel, world, values })
}
