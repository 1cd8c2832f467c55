//! The camera in numbers.

use super::World;
use crate::panels::widgets::{group, number, row, vector};
use brickyard::volume::{Projection, Scene};
use eframe::egui::Ui;

pub(super) fn show(ui: &mut Ui, scene: &mut Scene, world: &World<'_>) {
    group(ui, "camera", "position and direction of the camera, in numbers", |ui| {
        let Some(before) = scene.camera else {
            ui.label("It looks at everything.");
            return;
        };
        let mut camera = before;
        vector(ui, "eye", "position of the camera, in world units", &mut camera.eye, world.size());
        vector(ui, "target", "the point it looks at, in world units", &mut camera.target, world.size());
        vector(ui, "up", "the direction upwards in the picture, of any length", &mut camera.up, 2.0);
        match &mut camera.projection {
            Projection::Perspective { fov_y_deg } => {
                row(ui, "angle", "from the picture's lower edge to its upper one", |ui, label| {
                    number(ui, fov_y_deg, 0.1..=170.0, 90.0, 58.0, "\u{b0}").labelled_by(label);
                });
            }
            Projection::Orthographic { height } => {
                let least = f64::MIN_POSITIVE;
                row(ui, "height", "the height of the picture in the world", |ui, label| {
                    number(ui, height, least..=f64::INFINITY, world.size(), 58.0, world.unit).labelled_by(label);
                });
            }
        }
        // A camera in its own target, or looking along its up direction, has no picture.
        if camera.rays(1, 1).is_ok() {
            scene.camera = Some(camera);
        }
    });
}
