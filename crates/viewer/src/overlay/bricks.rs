//! The edges of the drawn bricks, in a colour for each level: the wanted bricks, and their stand-ins.

use crate::overlay::Lens;
use brickyard::overlay::box_axes::edges;
use brickyard::pager::DrawList;
use brickyard::session::VolumeSource;
use brickyard::volume::Scene;
use eframe::egui::{Color32, Stroke};
use glam::DVec3;

/// Most outlined bricks: more would be a blur.
const MOST: usize = 3000;

/// The colour of a level, the finest first.
pub(crate) fn level_color(level: u8) -> Color32 {
    let colors = [[90, 220, 120], [90, 190, 240], [240, 200, 80], [240, 130, 80], [230, 90, 150], [170, 120, 240]];
    let [r, g, b] = colors[usize::from(level).min(colors.len() - 1)];
    Color32::from_rgb(r, g, b)
}

/// Draws the edges of a scene's drawn cells, in the colours of their bricks' levels.
pub(crate) fn show(lens: &Lens, scene: &Scene, volumes: &[VolumeSource], lists: &[&DrawList]) {
    // The lists of a session's layers begin with the first; its bricks are enough to see.
    let Some(list) = lists.first() else { return };
    let Some(volume) = volumes.get(scene.store(0)) else { return };
    let Ok(placement) = scene.placement(0, &volume.place()) else { return };
    let world = |voxel: DVec3| placement.world_from_volume(volume.source.geometry().world_from_voxel(voxel));
    for cell in list.cells.iter().take(MOST) {
        let corners = [cell.region.min, cell.region.max];
        let [low, high] = corners.map(|corner| DVec3::from_array(corner.to_array().map(f64::from)));
        let stroke = Stroke::new(1.0, level_color(cell.brick.level.0).gamma_multiply(0.6));
        for [from, to] in edges((low, high)) {
            lens.line(world(from), world(to), stroke);
        }
    }
}
