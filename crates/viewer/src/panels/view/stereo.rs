//! Stereo views, with two eyes in the place of one.

use super::World;
use crate::panels::widgets::{auto, group, menu};
use brickyard::volume::{Scene, Stereo, StereoLayout};
use eframe::egui::Ui;

const LAYOUTS: [(Option<StereoLayout>, &str, &str); 5] = [
    (None, "off", "one eye"),
    (Some(StereoLayout::SideBySide), "side by side", "the left eye's picture in the left half"),
    (Some(StereoLayout::TopBottom), "top and bottom", "the left eye's picture in the upper half"),
    (Some(StereoLayout::Anaglyph), "anaglyph", "for red and cyan glasses, red before the left eye"),
    (Some(StereoLayout::Interlaced), "interlaced", "every other row: for screens with polarised rows"),
];

pub(super) fn show(ui: &mut Ui, scene: &mut Scene, world: &World<'_>) {
    group(ui, "stereo", "pictures of two eyes, shown together", |ui| {
        let shown = scene.stereo.map(|stereo| stereo.layout);
        if let Some(layout) = menu(ui, "layout", "arrangement of the two pictures", shown, &LAYOUTS, |_| None) {
            scene.stereo = match (layout, scene.stereo) {
                (Some(layout), Some(stereo)) => Some(Stereo { layout, ..stereo }),
                (layout, _) => layout.map(Stereo::new),
            };
        }
        let distance = scene.camera.map_or(world.size(), |camera| camera.eye.distance(camera.target));
        if let Some(stereo) = &mut scene.stereo {
            let screen = stereo.convergence.unwrap_or(distance);
            let hint = "distance between the eyes; auto is a thirtieth of the distance to the screen";
            auto(ui, "eyes apart", hint, &mut stereo.eye_separation, screen / 30.0, world.unit);
            let hint = "the distance of things that appear at the screen; auto is the distance of the camera's target";
            auto(ui, "screen at", hint, &mut stereo.convergence, distance, world.unit);
        }
    });
}
