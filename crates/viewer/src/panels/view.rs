//! The view of a scene: mode, side, time step, and, in folded groups, all else that is not a layer's own.

mod camera;
mod clipping;
mod expression;
mod light;
mod meshes;
mod sampling;
mod slice;
mod stereo;

use crate::command::Command;
use crate::panels::mending::set_mode;
use crate::panels::reason;
use crate::panels::widgets::{Scale, color, count, group, row, slider};
use brickyard::overlay::{axis_units, unit};
use brickyard::session::VolumeSource;
use brickyard::volume::scene::VolumePlace;
use brickyard::volume::{Mode, Projection, Scene, Viewpoint};
use eframe::egui::{Button, Ui};
use glam::DVec3;

/// The visible world.
struct World<'a> {
    /// Its least and greatest corner.
    low: DVec3,
    high: DVec3,
    is_anatomical: bool,
    /// The unit of its distances; empty if unknown.
    unit: &'a str,
    /// The units of its axes; empty where unknown.
    axis_units: [&'a str; 3],
}

impl<'a> World<'a> {
    fn new(scene: &Scene, volumes: &'a [VolumeSource]) -> Self {
        let places: Vec<VolumePlace> = volumes.iter().map(VolumeSource::place).collect();
        let shown = scene.world_box(&places).ok().filter(|(low, high)| low.is_finite() && high.is_finite());
        let (low, high) = shown.unwrap_or((DVec3::ZERO, DVec3::ONE));
        let is_anatomical = scene.is_anatomical(&places);
        let (unit, axis_units) = (unit(volumes, is_anatomical), axis_units(volumes, is_anatomical));
        Self { low, high, is_anatomical, unit, axis_units }
    }

    fn middle(&self) -> DVec3 {
        0.5 * (self.low + self.high)
    }

    /// Its named sides: a patient's, or the directions of the axes.
    fn sides(&self) -> impl Iterator<Item = (&'static str, Viewpoint)> {
        let is_anatomical = self.is_anatomical;
        Viewpoint::all().filter(move |(_, side)| matches!(side, Viewpoint::Patient(_)) == is_anatomical)
    }

    /// The unit of distances along a direction: an axis's own.
    fn unit_along(&self, direction: DVec3) -> &'a str {
        let axis = (0..3).find(|axis| direction[*axis].abs() > 1.0 - 1e-9);
        axis.map_or(self.unit, |axis| self.axis_units[axis])
    }

    /// Length of its diagonal.
    fn size(&self) -> f64 {
        self.low.distance(self.high)
    }

    /// The least and the greatest height of its corners along a direction.
    fn extent_along(&self, direction: DVec3) -> (f64, f64) {
        let (a, b) = (direction * self.low, direction * self.high);
        (a.min(b).element_sum(), a.max(b).element_sum())
    }
}

/// Shows the position of a plane through `point` on a slider along a direction. Returns its move.
fn moved(ui: &mut Ui, hint: &str, along: DVec3, point: DVec3, world: &World<'_>) -> DVec3 {
    let (least, greatest) = world.extent_along(along);
    let before = along.dot(point);
    let mut at = before;
    slider(ui, "position", hint, &mut at, Scale::Linear, least..=greatest, world.unit_along(along));
    along * (at - before)
}

/// Shows the mode, side and time step of a scene. Camera motion goes to `commands`. During playback only the row below the pictures names the step,
/// as it is shown once they are drawn.
pub(crate) fn show(
    ui: &mut Ui,
    scene: &mut Scene,
    volumes: &[VolumeSource],
    is_playing: bool,
    commands: &mut Vec<Command>,
) {
    let world = World::new(scene, volumes);
    modes(ui, scene, volumes);
    sides(ui, scene, &world, commands);
    time(ui, scene, volumes, is_playing);
}

/// Shows the other settings of the view, in groups.
pub(crate) fn groups(ui: &mut Ui, scene: &mut Scene, volumes: &[VolumeSource]) {
    let world = World::new(scene, volumes);
    slice::show(ui, scene, volumes, &world);
    clipping::show(ui, scene, &world);
    light::show(ui, scene, volumes, &world);
    sampling::show(ui, scene, volumes);
    expression::show(ui, scene, volumes);
    meshes::show(ui, scene);
    stereo::show(ui, scene, &world);
    camera::show(ui, scene, &world);
    background(ui, scene);
}

fn modes(ui: &mut Ui, scene: &mut Scene, volumes: &[VolumeSource]) {
    let mut chosen = None;
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        for mode in Mode::ALL {
            let is_shown = scene.mode == mode;
            let barred = if is_shown { None } else { reason(scene, volumes, |scene| set_mode(scene, volumes, mode)) };
            let button = ui.add_enabled(barred.is_none(), Button::selectable(is_shown, mode.name()));
            let button = button.on_hover_text(mode.meaning());
            if button.on_disabled_hover_text(barred.unwrap_or_default()).clicked() && !is_shown {
                chosen = Some(mode);
            }
        }
    });
    if let Some(mode) = chosen {
        set_mode(scene, volumes, mode);
    }
}

/// Shows the sides to look from, and the choice of parallel rays.
fn sides(ui: &mut Ui, scene: &Scene, world: &World<'_>, commands: &mut Vec<Command>) {
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 4.0;
        ui.label("from").on_hover_text("the side from which the scene is seen");
        for (name, view) in world.sides() {
            if ui.small_button(name).clicked() {
                commands.push(Command::View(view));
            }
        }
        if ui.small_button("fit").on_hover_text("shows everything, from the present direction").clicked() {
            commands.push(Command::Fit);
        }
        let camera = scene.camera.map(|camera| camera.projection);
        let mut is_parallel = matches!(camera, Some(Projection::Orthographic { .. }));
        let hint = "parallel rays: equal lengths look equal, near and far; off: perspective";
        if ui.checkbox(&mut is_parallel, "parallel rays").on_hover_text(hint).changed() {
            commands.push(Command::Parallel(is_parallel));
        }
    });
}

fn time(ui: &mut Ui, scene: &mut Scene, volumes: &[VolumeSource], is_playing: bool) {
    let times = volumes.iter().map(|volume| volume.source.times()).max().unwrap_or(1);
    let hint = format!("the time step of all layers, 0 to {}", times - 1);
    if times > 1 && is_playing {
        row(ui, "time step", &hint, |ui, _| ui.weak("playing"));
    } else if times > 1 {
        count(ui, "time step", &hint, &mut scene.time, 0..=times - 1);
    }
}

fn background(ui: &mut Ui, scene: &mut Scene) {
    group(ui, "background", "the colour behind the volumes", |ui| {
        row(ui, "colour", "the colour behind the volumes", |ui, label| {
            ui.spacing_mut().item_spacing.x = 3.0;
            ui.spacing_mut().button_padding.x = 3.0;
            color(ui, &mut scene.background).labelled_by(label);
            for (name, level) in [("black", 0.0), ("gray", 0.5), ("white", 1.0)] {
                if ui.small_button(name).clicked() {
                    scene.background = [level; 3];
                }
            }
        });
    });
}

#[cfg(test)]
mod tests;
