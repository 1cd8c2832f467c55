//! Clipping of all volumes: by a box, by planes, and the caps on isosurfaces they open.

use super::{World, moved};
use crate::panels::widgets::{group, list, range, row, switch, vector};
use brickyard::volume::{ClipPlane, MAX_CLIP_PLANES, Scene};
use eframe::egui::{Button, Ui};
use glam::DVec3;

const FULL: &str = "a scene has at most 6 clip planes";

pub(super) fn show(ui: &mut Ui, scene: &mut Scene, world: &World<'_>) {
    group(ui, "clip box", "shows (and reads) only the inside of a box", |ui| clip_box(ui, &mut scene.clip, world));
    group(ui, "clip planes", "cut away everything on the outer side of planes", |ui| {
        planes(ui, &mut scene.clip_planes, world);
    });
    if scene.layers.iter().any(|layer| !layer.isosurfaces.is_empty()) {
        group(ui, "caps", "close isosurfaces opened by clip box, planes and crops", |ui| {
            let mut is_on = scene.has_caps();
            let hint = "caps in the colour of the innermost surface; by default in mode isosurface, but not in fog";
            if switch(ui, "caps", hint, &mut is_on).changed() {
                scene.caps = Some(is_on);
            }
        });
    }
}

fn clip_box(ui: &mut Ui, clip: &mut Option<[DVec3; 2]>, world: &World<'_>) {
    let mut is_on = clip.is_some();
    let unit = if world.unit.is_empty() { "world units" } else { world.unit };
    if switch(ui, "clip", &format!("a box in the world, in {unit}"), &mut is_on).changed() {
        *clip = is_on.then_some([world.low, world.high]);
    }
    let Some([low, high]) = clip else { return };
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let whole = world.low[axis]..=world.high[axis];
        let least = 1e-3 * (world.high[axis] - world.low[axis]);
        let ends = [&mut low.as_mut()[axis], &mut high.as_mut()[axis]];
        range(ui, &format!("{name} ({unit})"), "the visible range", ends, whole, least);
    }
    if ui.small_button("reset").on_hover_text("the box around everything").clicked() {
        *clip = Some([world.low, world.high]);
    }
}

fn planes(ui: &mut Ui, planes: &mut Vec<ClipPlane>, world: &World<'_>) {
    adding(ui, planes, world);
    list(ui, planes, |ui, i, plane| {
        let is_removed = row(ui, &format!("plane {}", i + 1), "shows the side its normal points to", |ui, _| {
            if ui.small_button("flip").on_hover_text("shows the other side").clicked() {
                plane.normal = -plane.normal;
            }
            ui.small_button("remove").clicked()
        });
        plane.point += moved(ui, "along the normal", plane.normal.normalize_or_zero(), plane.point, world);
        let before = plane.normal;
        vector(ui, "normal", "towards the visible side; of any length", &mut plane.normal, 2.0);
        if plane.normalized().is_err() {
            plane.normal = before;
        }
        vector(ui, "through", "a point of the plane, in world units", &mut plane.point, world.size());
        ui.add_space(4.0);
        is_removed
    });
}

/// Shows the planes to add, by the side that stays. These buttons are above the present planes, and keep their place.
fn adding(ui: &mut Ui, planes: &mut Vec<ClipPlane>, world: &World<'_>) {
    let can_add = planes.len() < MAX_CLIP_PLANES;
    ui.horizontal_wrapped(|ui| {
        ui.spacing_mut().item_spacing.x = 3.0;
        ui.label("add").on_hover_text("a plane across the middle; the named side stays");
        for (name, side) in world.sides() {
            let add = ui.add_enabled(can_add, Button::new(name).small()).on_disabled_hover_text(FULL);
            if let Some((normal, _)) = side.direction(world.is_anatomical).filter(|_| add.clicked()) {
                planes.push(ClipPlane { point: world.middle(), normal });
            }
        }
    });
}
