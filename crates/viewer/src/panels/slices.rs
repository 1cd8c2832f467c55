//! The window of the three slices: their black and white values, independent of the layer's look in the volume's picture.

use crate::panels::layers::style::shown;
use crate::panels::widgets::{self, group, row};
use crate::planes::first_shown;
use crate::state::{Layout, Planes, WindowState};
use brickyard::session::VolumeSource;
use brickyard::volume::Scene;
use eframe::egui::Ui;

/// Windows of computed tomography, in Hounsfield units.
const TOMOGRAPHY: [(&str, [f64; 2]); 4] =
    [("soft tissue", [-160.0, 240.0]), ("brain", [0.0, 80.0]), ("lung", [-1350.0, 150.0]), ("bone", [-500.0, 1300.0])];

/// The black and white values of a scene's slices: their own, or the first visible layer's. `None` if that has labels, or an expression in its place.
pub(crate) fn shown_window(planes: &Planes, scene: &Scene, volumes: &[VolumeSource]) -> Option<[f64; 2]> {
    let layer = first_shown(scene).filter(|_| scene.expression.is_none())?;
    let volume = volumes.get(scene.store(layer)).filter(|volume| !volume.source.is_labels())?;
    Some(planes.window.unwrap_or_else(|| shown(&scene.layers[layer], volume)))
}

/// The unit of that window, if known.
pub(crate) fn window_unit<'a>(scene: &Scene, volumes: &'a [VolumeSource]) -> Option<&'a str> {
    let layer = first_shown(scene)?;
    volumes.get(scene.store(layer))?.value_unit(scene.layers[layer].channel)
}

/// The window after a drag by parts of a picture's height: wider to the right, brighter upwards.
pub(crate) fn dragged([low, high]: [f64; 2], right: f64, down: f64) -> [f64; 2] {
    let width = (high - low) * (2.0 * right).exp();
    let middle = 0.5 * (low + high) + down * (high - low);
    [middle - 0.5 * width, middle + 0.5 * width]
}

/// Shows the window of the slices, disabled without them, so that nothing moves when they come and go.
pub(crate) fn show(ui: &mut Ui, window: &mut WindowState, scene: &Scene, volumes: &[VolumeSource]) {
    group(ui, "three slices", "the values of black and white in the slices beside the volume", |ui| {
        let are_shown = window.layout == Layout::Planes;
        let slices = ui.add_enabled_ui(are_shown, |ui| window_of(ui, &mut window.planes, scene, volumes));
        slices.response.on_disabled_hover_text("three slices are not shown (P)");
    });
}

fn window_of(ui: &mut Ui, planes: &mut Planes, scene: &Scene, volumes: &[VolumeSource]) {
    let Some(window) = shown_window(planes, scene, volumes) else {
        ui.weak("The first visible layer has no window.");
        return;
    };
    let [low, high] = window;
    let hint = "the values of black and white in the slices, of the first visible layer; or drag in a slice with the \
                right button";
    let unit = window_unit(scene, volumes);
    planes.window = widgets::window(ui, hint, window, high - low, (hint, hint), unit).or(planes.window);
    row(ui, "", "", |ui, _| {
        ui.horizontal_wrapped(|ui| {
            ui.spacing_mut().item_spacing.x = 4.0;
            if ui.small_button("as the layer").on_hover_text("the layer's window for slices, too").clicked() {
                planes.window = None;
            }
            for (name, window) in TOMOGRAPHY.into_iter().filter(|_| is_tomography(scene, volumes)) {
                let [low, high] = window;
                if ui.small_button(name).on_hover_text(format!("{low} to {high}")).clicked() {
                    planes.window = Some(window);
                }
            }
        });
    });
}

/// Whether the first visible layer may have Hounsfield units: from about air to above soft tissue.
fn is_tomography(scene: &Scene, volumes: &[VolumeSource]) -> bool {
    let range = first_shown(scene).and_then(|layer| {
        let volume = volumes.get(scene.store(layer))?;
        Some(volume.likely_range(scene.layers[layer].channel))
    });
    range.is_some_and(|(low, high)| (-4096.0..-200.0).contains(&low) && (300.0..70_000.0).contains(&high))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panels::fixture;
    use eframe::egui::accesskit::Role;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

    fn harness<'a>(layout: Layout, scene: Scene) -> Harness<'a, WindowState> {
        let volumes = fixture::volumes();
        let show = move |ui: &mut Ui, window: &mut WindowState| {
            super::show(ui, window, &scene, &volumes);
            ui.label("below");
        };
        let mut harness = Harness::new_ui_state(show, WindowState { layout, ..WindowState::default() });
        harness.get_by_label("three slices").click();
        harness.run();
        harness
    }

    #[test]
    fn nothing_moves_when_slices_come_and_go() {
        let mut harness = harness(Layout::Single, fixture::scene());
        let below = harness.get_by_label("below").rect();
        harness.get_by_label("as the layer").click();
        harness.run();
        harness.state_mut().layout = Layout::Planes;
        harness.run();
        assert_eq!(harness.get_by_label("below").rect(), below);
    }

    #[test]
    fn slices_have_a_window_of_their_own_until_they_follow_the_layer() {
        let mut harness = harness(Layout::Planes, fixture::scene());
        harness.run();
        assert_eq!(harness.state().planes.window, None, "looking changes nothing");
        harness.get_all_by_role(Role::SpinButton).next().expect("black").focus();
        harness.run();
        harness.get_all_by_role(Role::SpinButton).next().expect("black").type_text("40");
        harness.run();
        harness.key_press(eframe::egui::Key::Enter);
        harness.run();
        let [low, high] = harness.state().planes.window.expect("a window");
        assert!(low == 40.0 && high > 40.0, "{low} {high}");
        assert!(harness.query_by_label("brain").is_none(), "values from 0 to 255 are no Hounsfield units");
        harness.get_by_label("as the layer").click();
        harness.run();
        assert_eq!(harness.state().planes.window, None);
    }

    #[test]
    fn labels_have_no_window() {
        let mut scene = fixture::scene();
        scene.layers[..2].iter_mut().for_each(|layer| layer.visible = false);
        assert_eq!(shown_window(&Planes::default(), &scene, &fixture::volumes()), None);
        let planes = Planes { window: Some([0.0, 80.0]), ..Planes::default() };
        assert_eq!(shown_window(&planes, &fixture::scene(), &fixture::volumes()), Some([0.0, 80.0]));
    }

    #[test]
    fn a_window_is_dragged_wider_and_brighter() {
        assert_eq!(dragged([0.0, 100.0], 0.0, -0.1), [-10.0, 90.0]);
        let [low, high] = dragged([0.0, 100.0], 0.5, 0.0);
        assert!((high - low - 100.0 * 1f64.exp()).abs() < 1e-9 && (low + high - 100.0).abs() < 1e-9);
    }
}
