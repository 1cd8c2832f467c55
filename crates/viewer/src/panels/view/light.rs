//! The lighting of fog and surfaces.

use super::World;
use crate::panels::mending::set_light;
use crate::panels::reason;
use crate::panels::widgets::{choice, group, list, menu, vector};
use brickyard::session::VolumeSource;
use brickyard::volume::lighting::MAX_LIGHTS;
use brickyard::volume::{Gradient, LightingModel, Scene};
use eframe::egui::{Button, Ui};

const MODELS: [(LightingModel, &str, &str); 4] = [
    (LightingModel::None, "unlit", "plain colours; surfaces are still lit"),
    (LightingModel::Phong, "Phong", "highlights fall with the angle between the mirrored light and the eye"),
    (LightingModel::BlinnPhong, "Blinn-Phong", "softer highlights, by the half-way vector of light and eye"),
    (LightingModel::Tone, "tone", "from warm where a place faces the light to cool where it is turned away (Gooch)"),
];

const GRADIENTS: [(Gradient, &str, &str); 3] = [
    (Gradient::Central, "central differences", "a voxel to each side: 6 samples"),
    (Gradient::Sobel, "Sobel", "smoother, over 26 neighbours: slower"),
    (Gradient::Stored, "stored", "one gradient for every eight voxels, kept beside the bricks: fast, but softer"),
];

pub(super) fn show(ui: &mut Ui, scene: &mut Scene, volumes: &[VolumeSource], world: &World<'_>) {
    group(ui, "light", "how fog and surfaces are lit, with the direction in which values change as the normal", |ui| {
        let barred = |model| reason(scene, volumes, |scene| set_light(scene, model));
        let hint = "how colours are lit";
        if let Some(model) = menu(ui, "model", hint, scene.lighting.model, &MODELS, barred) {
            set_light(scene, model);
        }
        let hint = "method of finding the direction in which values change";
        choice(ui, "gradient", hint, &mut scene.lighting.gradient, &GRADIENTS);
        lights(ui, scene, volumes, world);
    });
}

fn lights(ui: &mut Ui, scene: &mut Scene, volumes: &[VolumeSource], world: &World<'_>) {
    let eye = scene.camera.map_or(world.high, |camera| camera.eye);
    let has_surfaces = scene.layers.iter().any(|layer| !layer.isosurfaces.is_empty());
    let is_unlit = scene.lighting.model == LightingModel::None && !has_surfaces;
    let barred = match () {
        () if is_unlit => Some("nothing is lit: choose a model first".to_string()),
        () if scene.lighting.lights.len() >= MAX_LIGHTS => Some(format!("a scene has at most {MAX_LIGHTS} lights")),
        () => reason(scene, volumes, |scene| scene.lighting.lights.push(eye)),
    };
    let lights = &mut scene.lighting.lights;
    let is_one_removed = list(ui, lights, |ui, i, light| {
        vector(ui, &format!("light {}", i + 1), "where the light stands, in world units", light, world.size());
        ui.small_button("remove").clicked()
    });
    if is_one_removed {
        return;
    }
    if lights.is_empty() {
        ui.label("One light is at the eye.");
    }
    let add = ui.add_enabled(barred.is_none(), Button::new("add a light"));
    let add = add.on_hover_text("adds a light at the eye's present position");
    if add.on_disabled_hover_text(barred.unwrap_or_default()).clicked() {
        lights.push(eye);
    }
}
