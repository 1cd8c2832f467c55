//! The kind `flow`: a winding, rising plume with turbulence carried inside it, nothing around it.

use super::centre;
use super::turbulence::Turbulence;
use brickyard_volume::{Extent, VoxelBox};
use std::f64::consts::TAU;

/// Rise of the turbulence in one time step, in heights of the volume.
const RISE: f64 = 1.0 / 64.0;

/// Shift of the plume's rim per unit of turbulence, and the turbulence of the greatest shift.
const RIM: f64 = 0.45;
const MOST_TURBULENCE: f64 = 2.0;

pub(super) fn rows(
    noise: &Turbulence,
    time: u32,
    extent: Extent,
    region: VoxelBox,
) -> impl FnMut(u32, u32, &mut [f32]) {
    // Phase of the winding, in turns, and the way of the turbulence.
    let phase = RISE * time as f64;
    let mut noise = noise.rows(extent, region, [0.0, 0.0, phase]);
    // Position of the box's voxels along x in the unit interval.
    let places: Vec<f32> = (region.min.x..region.max.x).map(|i| centre(i, extent.x) as f32).collect();
    move |y, z, units| {
        let (y_place, height) = (centre(y, extent.y), centre(z, extent.z));
        let turn = TAU * (1.2 * height - phase);
        let sway = 0.04 + 0.14 * height;
        let (axis_x, axis_y) = (0.5 + sway * turn.cos(), 0.5 + sway * turn.sin());
        let width = 0.06 + 0.22 * height;
        let across = (y_place - axis_y) / width;
        units.fill(0.0);
        // Half of the plume along x under the greatest shift of its rim.
        let half = (1.0 + RIM * MOST_TURBULENCE - across * across).max(0.0).sqrt() * width;
        let plume = places.partition_point(|x| (*x as f64) < axis_x - half)
            ..places.partition_point(|x| (*x as f64) <= axis_x + half);
        if plume.is_empty() {
            return;
        }
        noise.row(y, z, plume.clone(), units);
        let (axis, narrow, across) = (axis_x as f32, (1.0 / width) as f32, (across * across) as f32);
        let thin = (235.0 - 90.0 * height) as f32;
        for (u, x) in units[plume.clone()].iter_mut().zip(&places[plume]) {
            let t = u.clamp(-MOST_TURBULENCE as f32, MOST_TURBULENCE as f32);
            let d = (x - axis) * narrow;
            let inside = (1.0 - (d * d + across) + RIM as f32 * t).clamp(0.0, 1.0);
            *u = thin * inside * (0.75 + 0.25 * t).max(0.0);
        }
    }
}
