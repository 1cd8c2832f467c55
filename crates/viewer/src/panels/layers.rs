//! The layers: whether each is shown, its window, colours, gamma and opacity.

use crate::command::{Command, Look};
use crate::panels::histogram;
use brickyard::session::VolumeSource;
use brickyard::volume::{Mode, Scene, SceneLayer, TransferChoice, TransferFunction};
use eframe::egui::{ComboBox, DragValue, Slider, Ui};

/// Shows the layers of a scene of these volumes.
pub(crate) fn show(ui: &mut Ui, scene: &Scene, volumes: &[VolumeSource], commands: &mut Vec<Command>) {
    for (layer, style) in scene.layers.iter().enumerate() {
        let Some(volume) = volumes.get(scene.store(layer)) else { continue };
        let mut say = |look| commands.push(Command::Layer { layer, look });
        ui.push_id(layer, |ui| {
            ui.horizontal(|ui| {
                let mut is_visible = style.visible;
                if ui.checkbox(&mut is_visible, name(volume, style, layer)).changed() {
                    say(Look::Visible(is_visible));
                }
            });
            ui.add_enabled_ui(style.visible, |ui| {
                if !volume.source.is_labels() {
                    window(ui, volume, style, &mut say);
                    colors(ui, style, &mut say);
                    let mut gamma = style.gamma;
                    if ui.add(Slider::new(&mut gamma, 0.1..=5.0).logarithmic(true).text("gamma")).changed() {
                        say(Look::Gamma(gamma));
                    }
                }
                if let Some(surface) = style.isosurfaces.first().filter(|_| scene.mode == Mode::Isosurface) {
                    let (least, greatest) = volume.source.channel_range(style.channel);
                    let mut value = surface.value;
                    if ui.add(Slider::new(&mut value, least..=greatest).text("isovalue")).changed() {
                        say(Look::Isovalue(value));
                    }
                }
                let mut opacity = style.opacity;
                if ui.add(Slider::new(&mut opacity, 0.0..=1.0).text("opacity")).changed() {
                    say(Look::Opacity(opacity));
                }
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
fn window(ui: &mut Ui, volume: &VolumeSource, style: &SceneLayer, say: &mut impl FnMut(Look)) {
    let shown = style.window.unwrap_or_else(|| volume.subject(style.channel).window.into());
    let (least, greatest) = volume.source.channel_range(style.channel);
    let statistics = volume.store().and_then(|store| store.info().channels.get(style.channel as usize));
    if let Some(window) = statistics.and_then(|channel| histogram::show(ui, &channel.histogram, shown)) {
        say(Look::Window(Some(window)));
    }
    let speed = ((greatest - least) / 500.0).max(f64::MIN_POSITIVE);
    ui.horizontal(|ui| {
        ui.label("window");
        let [mut low, mut high] = shown;
        let is_low = ui.add(DragValue::new(&mut low).speed(speed)).on_hover_text("least value").changed();
        let is_high = ui.add(DragValue::new(&mut high).speed(speed)).on_hover_text("greatest value").changed();
        if (is_low || is_high) && low < high {
            say(Look::Window(Some([low, high])));
        }
        if ui.button("auto").on_hover_text("the store's own window").clicked() {
            say(Look::Window(None));
        }
    });
}

/// The preset of the transfer function.
fn colors(ui: &mut Ui, style: &SceneLayer, say: &mut impl FnMut(Look)) {
    let shown = match &style.transfer {
        None => "gray",
        Some(TransferChoice::Preset(preset)) => &preset.preset,
        Some(TransferChoice::Function(_) | TransferChoice::File(_)) => "of its own",
    };
    ComboBox::from_label("colors").selected_text(shown).show_ui(ui, |ui| {
        for preset in TransferFunction::PRESETS {
            if ui.selectable_label(preset == shown, preset).clicked() {
                say(Look::Colors((preset != "gray").then(|| preset.to_string())));
            }
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard::pager::{BrickError, BrickSource};
    use brickyard::volume::{BrickId, Extent, Geometry, Pyramid, VoxelType};
    use eframe::egui::accesskit::Role;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;
    use std::sync::Arc;

    /// Nothing, of one value.
    struct Constant {
        pyramid: Pyramid,
        geometry: Geometry,
    }

    impl BrickSource for Constant {
        fn pyramid(&self) -> &Pyramid {
            &self.pyramid
        }
        fn geometry(&self) -> &Geometry {
            &self.geometry
        }
        fn voxel_type(&self) -> VoxelType {
            VoxelType::U8
        }
        fn value_range(&self) -> (f64, f64) {
            (0.0, 255.0)
        }
        fn read_core(&self, _: BrickId, out: &mut [u8]) -> Result<(), BrickError> {
            out.fill(7);
            Ok(())
        }
    }

    fn harness<'a>() -> Harness<'a, Vec<Command>> {
        let pyramid = Pyramid::new(Extent::new(8, 8, 8), [1.0; 3], 8);
        let volume = VolumeSource::new(Arc::new(Constant { pyramid, geometry: Geometry::default() }));
        let scene = Scene { layers: vec![SceneLayer::default(); 2], ..Scene::default() };
        let scene = Scene {
            layers: scene.layers.iter().map(|layer| SceneLayer { source: Some(0), ..layer.clone() }).collect(),
            ..scene
        };
        Harness::new_ui_state(move |ui, commands| show(ui, &scene, std::slice::from_ref(&volume), commands), Vec::new())
    }

    /// The commands that a click on something of the second layer gives.
    fn clicked(role: Role, label: &str) -> Vec<Command> {
        let mut harness = harness();
        harness.get_all_by_role_and_label(role, label).last().expect("there is one for each layer").click();
        harness.run();
        harness.state().clone()
    }

    #[test]
    fn every_layer_has_its_own_controls() {
        let second = |look| vec![Command::Layer { layer: 1, look }];
        assert_eq!(clicked(Role::CheckBox, "layer 1"), second(Look::Visible(false)));
        assert_eq!(clicked(Role::Button, "auto"), second(Look::Window(None)));
    }

    #[test]
    fn colours_are_chosen_from_a_list() {
        let mut harness = harness();
        harness.get_all_by_role(Role::ComboBox).last().expect("one for each layer").click();
        harness.run();
        harness.get_by_label("viridis").click();
        harness.run();
        assert_eq!(harness.state(), &[Command::Layer { layer: 1, look: Look::Colors(Some("viridis".into())) }]);
    }
}
