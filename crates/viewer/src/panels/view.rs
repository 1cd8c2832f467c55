//! How the scene is looked at: mode, light, rays, sides, and the time step.

use crate::command::{Command, mode_name};
use brickyard::session::VolumeSource;
use brickyard::volume::{LightingModel, Mode, Projection, Scene, Viewpoint};
use eframe::egui::{Checkbox, Slider, Ui};

/// Shows how a scene of these volumes is looked at, and edits it.
pub(crate) fn show(ui: &mut Ui, scene: &mut Scene, volumes: &[VolumeSource], commands: &mut Vec<Command>) {
    let times = volumes.iter().map(|volume| volume.source.times()).max().unwrap_or(1);
    let places: Vec<_> = volumes.iter().map(VolumeSource::place).collect();
    let is_anatomical = scene.is_anatomical(&places);
    ui.horizontal_wrapped(|ui| {
        for mode in Mode::ALL {
            ui.selectable_value(&mut scene.mode, mode, mode_name(mode));
        }
    });
    let mut is_lit = scene.lighting.model != LightingModel::None;
    if ui.add_enabled(!scene.mode.is_projection(), Checkbox::new(&mut is_lit, "lit")).changed() {
        scene.lighting.model = if is_lit { LightingModel::BlinnPhong } else { LightingModel::None };
    }
    let camera = scene.camera.map(|camera| camera.projection);
    let mut is_parallel = matches!(camera, Some(Projection::Orthographic { .. }));
    if ui.checkbox(&mut is_parallel, "parallel rays").changed() {
        commands.push(Command::Parallel(is_parallel));
    }
    ui.horizontal_wrapped(|ui| {
        ui.label("from");
        for (name, view) in Viewpoint::all() {
            if matches!(view, Viewpoint::Patient(_)) == is_anatomical && ui.button(name).clicked() {
                commands.push(Command::View(view));
            }
        }
        if ui.button("fit").clicked() {
            commands.push(Command::Fit);
        }
    });
    if times > 1 {
        ui.add(Slider::new(&mut scene.time, 0..=times - 1).text("time step"));
    }
}
