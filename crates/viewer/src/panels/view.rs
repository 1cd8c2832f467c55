//! What the picture is: mode, light, projection, side, and time step.

use crate::command::{Command, mode_name};
use brickyard::volume::{LightingModel, Mode, Projection, Scene, Viewpoint};
use eframe::egui::{Checkbox, Slider, Ui};

/// Shows how a scene is looked at. `times` is the number of its time steps; `is_anatomical` says whether its world is a patient's.
pub(crate) fn show(ui: &mut Ui, scene: &Scene, (times, is_anatomical): (u32, bool), commands: &mut Vec<Command>) {
    ui.horizontal_wrapped(|ui| {
        for mode in Mode::ALL {
            if ui.selectable_label(scene.mode == mode, mode_name(mode)).clicked() {
                commands.push(Command::Mode(mode));
            }
        }
    });
    let mut is_lit = scene.lighting.model != LightingModel::None;
    let can_be_lit = !scene.mode.is_projection();
    if ui.add_enabled(can_be_lit, Checkbox::new(&mut is_lit, "lit")).changed() {
        commands.push(Command::Lit(is_lit));
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
        let mut time = scene.time;
        if ui.add(Slider::new(&mut time, 0..=times - 1).text("time step")).changed() {
            commands.push(Command::Time(time));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard::volume::{Camera, Side};
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;
    use glam::DVec3;

    /// The commands that a click on something gives.
    fn clicked(label: &str, world: (u32, bool)) -> Vec<Command> {
        let camera = Camera::looking_at_box((DVec3::ZERO, DVec3::ONE));
        let scene = Scene { camera: Some(camera), ..Scene::default() };
        let show = move |ui: &mut Ui, commands: &mut Vec<Command>| super::show(ui, &scene, world, commands);
        let mut harness = Harness::new_ui_state(show, Vec::new());
        harness.get_by_label(label).click();
        harness.run();
        harness.state().clone()
    }

    #[test]
    fn every_button_is_a_command() {
        let world = (1, false);
        for (label, expected) in [
            ("mip", Command::Mode(Mode::Mip)),
            ("lit", Command::Lit(true)),
            ("parallel rays", Command::Parallel(true)),
            ("-x", Command::View(Viewpoint::World(DVec3::NEG_X))),
            ("fit", Command::Fit),
        ] {
            assert_eq!(clicked(label, world), [expected]);
        }
        assert_eq!(clicked("left", (1, true)), [Command::View(Viewpoint::Patient(Side::Left))]);
    }

    #[test]
    fn a_series_has_a_slider() {
        let has_slider = |times| {
            let show = move |ui: &mut Ui| super::show(ui, &Scene::default(), (times, false), &mut Vec::new());
            Harness::new_ui(show).query_all_by_label("time step").next().is_some()
        };
        assert!(has_slider(2) && !has_slider(1));
    }
}
