//! The data of a layer, and their place: volume, channel, crop and placement.

use crate::panels::reason;
use crate::panels::widgets::{choice, group, menu, range, row, switch, typed, vector};
use brickyard::session::VolumeSource;
use brickyard::volume::numbers::significant;
use brickyard::volume::{Placement, Scene, SceneLayer};
use eframe::egui::{Label, Ui};
use glam::DVec3;

const HINT: &str = "volume, channel, visible part and placement of the layer";

pub(crate) fn show(ui: &mut Ui, scene: &mut Scene, volumes: &[VolumeSource], layer: usize) {
    group(ui, "data", HINT, |ui| {
        source(ui, scene, volumes, layer);
        let Some(volume) = volumes.get(scene.store(layer)) else { return };
        channel(ui, scene, volume, layer);
        voxels(ui, volume);
        crop(ui, &mut scene.layers[layer], volume);
        placement(ui, &mut scene.layers[layer], volume);
    });
}

fn source(ui: &mut Ui, scene: &mut Scene, volumes: &[VolumeSource], layer: usize) {
    let name = |(i, volume): (usize, &VolumeSource)| volume.name().unwrap_or_else(|| format!("volume {i}"));
    let names: Vec<String> = volumes.iter().enumerate().map(name).collect();
    let choices: Vec<_> = names.iter().enumerate().map(|(i, name)| (i, &**name, "")).collect();
    let barred = |store| reason(scene, volumes, |scene| show_store(scene, volumes, layer, store));
    let chosen = menu(ui, "volume", "the layer's volume", scene.store(layer), &choices, barred);
    if let Some(store) = chosen {
        show_store(scene, volumes, layer, store);
    }
}

/// Switches to another volume. Between labels and measurements, only the common part of the look stays.
fn show_store(scene: &mut Scene, volumes: &[VolumeSource], layer: usize, store: usize) {
    let are_labels = |store: usize| volumes.get(store).is_some_and(|volume| volume.source.is_labels());
    let is_alike = are_labels(scene.store(layer)) == are_labels(store);
    let SceneLayer { world_from_volume, opacity, blend, visible, .. } = scene.layers[layer].clone();
    let style = &mut scene.layers[layer];
    if !is_alike {
        *style = SceneLayer { world_from_volume, opacity, blend, visible, ..SceneLayer::default() };
    }
    // Settings of one volume's voxels do not hold for another's.
    (style.source, style.channel, style.crop) = (Some(store), 0, None);
}

/// Shows the store's voxel size.
fn voxels(ui: &mut Ui, volume: &VolumeSource) {
    let geometry = volume.source.geometry();
    let stride = volume.stride().map(f64::from);
    let size = geometry.spacing / DVec3::from_array(stride);
    let [x, y, z] = size.to_array().map(|length| significant(length, 4));
    let unit = geometry.units_in_words();
    let text = format!("{x} x {y} x {z} {}", unit.as_deref().unwrap_or("(no unit)"));
    let hint =
        "from the file, set when it was opened (Open..., missing from the file), or edited (File, Edit metadata...)";
    row(ui, "voxel size", hint, |ui, _| ui.add(Label::new(text).truncate()).on_hover_text(hint));
}

fn channel(ui: &mut Ui, scene: &mut Scene, volume: &VolumeSource, layer: usize) {
    let displays = volume.displays();
    let name = |channel: u32| match displays.get(channel as usize).and_then(|display| display.name.as_deref()) {
        Some(name) if !name.is_empty() => format!("{channel}: {name}"),
        _ => channel.to_string(),
    };
    let names: Vec<String> = (0..volume.source.channels()).map(name).collect();
    let choices: Vec<_> = (0..).zip(&names).map(|(channel, name)| (channel, &**name, "")).collect();
    choice(ui, "channel", "the channel of the layer's volume, from 0", &mut scene.layers[layer].channel, &choices);
}

/// Edits the visible box, in voxels.
fn crop(ui: &mut Ui, layer: &mut SceneLayer, volume: &VolumeSource) {
    let extent = DVec3::from_array(volume.source.pyramid().levels()[0].extent.to_array().map(f64::from));
    let mut is_on = layer.crop.is_some();
    let hint = "shows (and reads) only a box of the volume; in voxels of its finest level";
    if switch(ui, "crop", hint, &mut is_on).changed() {
        layer.crop = is_on.then_some([DVec3::ZERO, extent]);
    }
    let Some([low, high]) = &mut layer.crop else { return };
    for (axis, name) in ["x", "y", "z"].into_iter().enumerate() {
        let ends = [&mut low.as_mut()[axis], &mut high.as_mut()[axis]];
        range(ui, &format!("   {name}"), "first and last voxel along the axis", ends, 0.0..=extent[axis], 1.0);
    }
}

/// Edits the map from the volume's own world to the scene's: its translation, and the whole matrix.
fn placement(ui: &mut Ui, layer: &mut SceneLayer, volume: &VolumeSource) {
    let (low, high) = volume.place().own_box;
    let placement = &mut layer.world_from_volume;
    let mut rows = placement.rows();
    let mut moved = DVec3::from_array(rows.map(|row| row[3]));
    let hint = "offset of the layer from its store's own place, in world units";
    vector(ui, "moved by", hint, &mut moved, (high - low).length());
    (0..3).for_each(|axis| rows[axis][3] = moved[axis]);
    if rows != placement.rows()
        && let Ok(new) = Placement::from_rows(&rows)
    {
        *placement = new;
    }
    let hint = "from the volume's own world to the scene's, row by row, as from registration programs";
    row(ui, "matrix", hint, |ui, _| {
        if ui.small_button("reset").on_hover_text("back to the store's own place").clicked() {
            *placement = Placement::default();
        }
    });
    let read = |text: &str| Placement::from_text(text).map_err(|error| error.to_string());
    typed(ui, "placement", "12 or 16 numbers, row by row", 3, placement, matrix, read);
}

/// A matrix as text, one row per line.
fn matrix(placement: &Placement) -> String {
    let line = |row: &[f64; 4]| row.map(|number| number.to_string()).join(" ");
    placement.rows().each_ref().map(line).join("\n")
}
