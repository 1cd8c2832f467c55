//! The layers: whether each is shown, its window, colours, gamma and opacity.

use crate::panels::histogram;
use brickyard::session::VolumeSource;
use brickyard::volume::{Mode, Scene, SceneLayer, TransferChoice, TransferFunction};
use eframe::egui::{ComboBox, DragValue, Slider, Ui};

/// Shows the layers of a scene of these volumes, and edits them.
pub(crate) fn show(ui: &mut Ui, scene: &mut Scene, volumes: &[VolumeSource]) {
    let mode = scene.mode;
    for layer in 0..scene.layers.len() {
        let Some(volume) = volumes.get(scene.store(layer)) else { continue };
        let style = &mut scene.layers[layer];
        ui.push_id(layer, |ui| {
            let name = name(volume, style, layer);
            ui.checkbox(&mut style.visible, name);
            ui.add_enabled_ui(style.visible, |ui| {
                if !volume.source.is_labels() {
                    window(ui, volume, style);
                    colors(ui, style);
                    ui.add(Slider::new(&mut style.gamma, 0.1..=5.0).logarithmic(true).text("gamma"));
                }
                if let Some(surface) = style.isosurfaces.first_mut().filter(|_| mode == Mode::Isosurface) {
                    let (least, greatest) = volume.source.channel_range(style.channel);
                    ui.add(Slider::new(&mut surface.value, least..=greatest).text("isovalue"));
                }
                ui.add(Slider::new(&mut style.opacity, 0.0..=1.0).text("opacity"));
            });
            ui.separator();
        });
    }
}

/// The name of a layer: its channel's, else its store's.
fn name(volume: &VolumeSource, style: &SceneLayer, layer: usize) -> String {
    let store = volume.store();
    let channel = store.and_then(|store| store.channel_displays().get(style.channel as usize));
    let channel = channel.and_then(|display| display.name.clone()).filter(|name| !name.is_empty());
    let file = store.and_then(|store| store.path().file_stem());
    channel.or_else(|| Some(file?.to_string_lossy().into_owned())).unwrap_or_else(|| format!("layer {layer}"))
}

/// The histogram, and the window's two values. They stay in order, and apart.
fn window(ui: &mut Ui, volume: &VolumeSource, style: &mut SceneLayer) {
    let shown = style.window.unwrap_or_else(|| volume.subject(style.channel).window.into());
    let (least, greatest) = volume.source.channel_range(style.channel);
    let statistics = volume.store().and_then(|store| store.info().channels.get(style.channel as usize));
    if let Some(window) = statistics.and_then(|channel| histogram::show(ui, &channel.histogram, shown)) {
        style.window = Some(window);
    }
    let speed = ((greatest - least) / 500.0).max(f64::MIN_POSITIVE);
    ui.horizontal(|ui| {
        ui.label("window");
        let [mut low, mut high] = shown;
        let is_low = ui.add(DragValue::new(&mut low).speed(speed)).on_hover_text("least value").changed();
        let is_high = ui.add(DragValue::new(&mut high).speed(speed)).on_hover_text("greatest value").changed();
        if (is_low || is_high) && low < high {
            style.window = Some([low, high]);
        }
        if ui.button("auto").on_hover_text("the store's own window").clicked() {
            style.window = None;
        }
    });
}

/// The preset of the transfer function.
fn colors(ui: &mut Ui, style: &mut SceneLayer) {
    let shown = match &style.transfer {
        None => "gray".to_string(),
        Some(TransferChoice::Preset(preset)) => preset.preset.clone(),
        Some(TransferChoice::Function(_) | TransferChoice::File(_)) => "of its own".to_string(),
    };
    ComboBox::from_label("colors").selected_text(&shown).show_ui(ui, |ui| {
        for preset in TransferFunction::PRESETS {
            if ui.selectable_label(preset == shown, preset).clicked() {
                style.transfer = (preset != "gray").then(|| TransferChoice::preset(preset));
            }
        }
    });
}
