//! Values at one place over time: exact values of all of a volume's channels in one voxel, step by step. Reads one
//! brick for each channel and step.

use crate::session::volume_source::VolumeSource;
use crate::window::probe::{Probe, probe_voxel};
use brickyard_pager::BrickError;
use glam::DVec3;

/// Line colours of channels on white, sRGB, distinct to all eyes (Okabe and Ito's), used cyclically.
pub const LINE_COLORS: [[u8; 3]; 6] =
    [[0, 0, 0], [213, 94, 0], [0, 158, 115], [0, 114, 178], [214, 158, 0], [204, 121, 167]];

/// The values of all channels of a volume in one voxel of the finest level, at several time steps.
#[derive(Clone, Debug, PartialEq)]
pub struct Curve {
    /// The voxel of level 0, `[x, y, z]` from 0.
    pub voxel: [u32; 3],
    /// The voxel's centre in the world of the volume's store.
    pub world: DVec3,
    /// The time steps.
    pub steps: Vec<u32>,
    /// The values of each channel at those steps, in stored units; NaN where there is none.
    pub values: Vec<Vec<f64>>,
}

/// Reads a voxel of level 0 at one or more time steps.
///
/// # Errors
/// If a brick cannot be read.
///
/// # Panics
/// If there is no such voxel or time step, or `steps` is empty.
pub fn curve(volume: &VolumeSource, steps: &[u32], voxel: [u32; 3]) -> Result<Curve, BrickError> {
    let probes: Vec<Probe> =
        steps.iter().map(|step| probe_voxel(volume, *step, voxel)).collect::<Result<_, BrickError>>()?;
    let first = probes.first().expect("a step is asked for");
    let of_channel = |channel: usize| probes.iter().map(|probe| probe.values[channel]).collect();
    let values = (0..first.values.len()).map(of_channel).collect();
    Ok(Curve { voxel, world: first.world, steps: steps.to_vec(), values })
}
