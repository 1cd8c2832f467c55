//! The meshes beside the volumes, as a list.

use crate::panels::widgets::{group, list, opacity, own_color, row};
use brickyard::volume::mesh::PLAIN_COLOR;
use brickyard::volume::{MeshLook, Scene};
use eframe::egui::{RichText, Ui};

pub(super) fn show(ui: &mut Ui, scene: &mut Scene) {
    group(ui, "meshes", "surfaces of triangles from files, in the scene's world", |ui| {
        if scene.meshes.is_empty() {
            ui.label(RichText::new("There are none: add some with File, Add...").weak());
        }
        let is_projection = scene.mode.is_projection();
        list(ui, &mut scene.meshes, |ui, _, mesh| one(ui, mesh, is_projection));
    });
}

/// Shows a mesh. Returns whether to remove it.
fn one(ui: &mut Ui, mesh: &mut MeshLook, is_projection: bool) -> bool {
    let name = mesh.path.file_name().unwrap_or(mesh.path.as_os_str()).to_string_lossy().into_owned();
    let mut is_visible = mesh.opacity > 0.0;
    if ui.checkbox(&mut is_visible, name).on_hover_text(mesh.path.display().to_string()).changed() {
        mesh.opacity = f64::from(u8::from(is_visible));
    }
    let shown = ui.add_enabled_ui(!is_projection, |ui| {
        opacity(ui, "0 is invisible, 1 hides things behind it", &mut mesh.opacity);
    });
    shown.response.on_disabled_hover_text("a projection has no depth: choose mode dvr or isosurface");
    row(ui, "colour", "its own colour, or the file's", |ui, label| {
        own_color(ui, &mut mesh.color, PLAIN_COLOR, label);
        ui.checkbox(&mut mesh.lit, "lit").on_hover_text("lit from the eye; off: the plain colour");
        ui.small_button("remove").clicked()
    })
}
