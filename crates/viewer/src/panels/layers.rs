//! The layers of a scene as a list. A layer is a line with its visibility, name and colour; opened, it shows all its settings. Layers are shown
//! alone, copied, moved and removed here. Only open layers cost more than a few shapes.

mod data;
mod isosurfaces;
mod labels;
pub(crate) mod style;

use crate::panels::transfer_editor::{self, SavedFunction};
use crate::panels::widgets::color;
use brickyard::overlay::layer_name;
use brickyard::session::VolumeSource;
use brickyard::volume::{MAX_VOLUMES, Scene, SceneLayer};
use eframe::egui::collapsing_header::paint_default_icon;
use eframe::egui::{
    Align, Button, Id, Label, Layout, Rect, Response, RichText, Role, Sense, Shape, Stroke, Ui, WidgetInfo, pos2, vec2,
};

/// An action on a whole layer.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Change {
    Solo,
    Duplicate,
    Up,
    Down,
    Remove,
}

/// Shows a scene's layers. `picked` is the label under the pointer; functions to be saved go to `saved`.
pub(crate) fn show(
    ui: &mut Ui,
    scene: &mut Scene,
    volumes: &[VolumeSource],
    picked: Option<i64>,
    saved: &mut Vec<SavedFunction>,
) {
    let key = Id::unique("open layers");
    // Whether each layer is unfolded.
    let mut open: Vec<bool> = ui.data(|data| data.get_temp(key)).unwrap_or_default();
    // A single layer is open from the start.
    open.resize(scene.layers.len(), scene.layers.len() == 1);
    let mut change = None;
    for layer in 0..scene.layers.len() {
        ui.push_id(layer, |ui| {
            let asked = line(ui, scene, volumes, layer, &mut open[layer]);
            change = change.or(asked.map(|asked| (layer, asked)));
            if open[layer] {
                body(ui, scene, volumes, layer, picked, saved);
                ui.separator();
            }
        });
    }
    if let Some((layer, change)) = change {
        rearrange(scene, layer, change, &mut open);
    }
    ui.data_mut(|data| data.insert_temp(key, open));
}

/// Shows a layer's line. Returns the chosen action.
fn line(ui: &mut Ui, scene: &mut Scene, volumes: &[VolumeSource], layer: usize, is_open: &mut bool) -> Option<Change> {
    let name = layer_name(scene, volumes, layer);
    let must_stay = must_stay(scene, layer);
    let mut change = None;
    ui.horizontal(|ui| {
        fold(ui, is_open, &name);
        let is_visible = &mut scene.layers[layer].visible;
        let eye = ui.add_enabled_ui(must_stay.is_none(), |ui| eye(ui, is_visible, &name)).inner;
        eye.on_hover_text("whether the layer is shown").on_disabled_hover_text(must_stay.unwrap_or_default());
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            let menu = ui.menu_button("\u{2026}", |ui| change = menu(ui, scene, layer));
            menu.response.accessible_name(format!("more of {name}")).on_hover_text("copy, move, remove");
            let is_solo = scene.layers[layer].visible && shown(scene) == 1 && scene.layers.len() > 1;
            let solo = ui.add(Button::selectable(is_solo, "S")).accessible_name(format!("{name} alone"));
            if solo.on_hover_text("shows this layer alone; again: all layers").clicked() {
                change = Some(Change::Solo);
            }
            let volume = volumes.get(scene.store(layer));
            swatch(ui, &mut scene.layers[layer], volume, &name);
            ui.with_layout(Layout::left_to_right(Align::Center), |ui| {
                let text = RichText::new(&name);
                let text = if scene.layers[layer].visible { text.strong() } else { text.weak() };
                let label = Label::new(text).truncate().selectable(false).sense(Sense::click());
                if ui.add(label).clicked() {
                    *is_open = !*is_open;
                }
            });
        });
    });
    change
}

/// The reason a visible layer cannot be hidden, if any.
fn must_stay(scene: &Scene, layer: usize) -> Option<&'static str> {
    if scene.parsed_expression().ok().flatten().is_some_and(|expression| expression.volumes().contains(&layer)) {
        return Some("the expression reads this layer");
    }
    let is_last = scene.layers[layer].visible && shown(scene) == 1;
    is_last.then_some("the only visible layer: show another one first")
}

/// Number of visible layers.
fn shown(scene: &Scene) -> usize {
    scene.layers.iter().filter(|layer| layer.visible).count()
}

fn fold(ui: &mut Ui, is_open: &mut bool, name: &str) {
    let (area, response) = ui.allocate_exact_size(vec2(14.0, ui.spacing().interact_size.y), Sense::click());
    if response.clicked() {
        *is_open = !*is_open;
    }
    let label = format!("open {name}");
    response.widget_info(|| WidgetInfo::selected(Role::DisclosureTriangle, ui.is_enabled(), *is_open, &label));
    let icon = response.with_new_rect(Rect::from_center_size(area.center(), vec2(8.0, 8.0)));
    paint_default_icon(ui, if *is_open { 1.0 } else { 0.0 }, &icon);
}

/// Shows an eye, struck out if the layer is hidden.
fn eye(ui: &mut Ui, is_visible: &mut bool, name: &str) -> Response {
    let (area, mut response) = ui.allocate_exact_size(vec2(20.0, ui.spacing().interact_size.y), Sense::click());
    if response.clicked() {
        *is_visible = !*is_visible;
        response.mark_changed();
    }
    response.widget_info(|| WidgetInfo::selected(Role::CheckBox, ui.is_enabled(), *is_visible, name));
    let color = match *is_visible {
        true => ui.style().interact(&response).text_color(),
        false => ui.visuals().weak_text_color(),
    };
    let (middle, stroke) = (area.center(), Stroke::new(1.5, color));
    let lid = |side: f32| {
        (0..=12).map(move |i| {
            let turn = std::f32::consts::PI * i as f32 / 12.0;
            pos2(middle.x - 7.5 * turn.cos(), middle.y - side * 4.5 * turn.sin())
        })
    };
    for side in [1.0, -1.0] {
        ui.painter().add(Shape::line(lid(side).collect(), stroke));
    }
    ui.painter().circle_filled(middle, 2.2, color);
    if !*is_visible {
        ui.painter().line_segment([middle + vec2(-7.0, 5.5), middle + vec2(7.0, -5.5)], stroke);
    }
    if response.has_focus() {
        ui.painter().rect_stroke(area, 2.0, ui.visuals().selection.stroke, eframe::egui::StrokeKind::Inside);
    }
    response
}

/// Shows a layer's colour: its own, or the brightest of its transfer function.
fn swatch(ui: &mut Ui, layer: &mut SceneLayer, volume: Option<&VolumeSource>, name: &str) {
    let function = volume.and_then(|volume| volume.function(layer).ok());
    let last = function.and_then(|function| function.color.last().copied()).unwrap_or([1.0; 4]);
    let mut shown = layer.color.unwrap_or([last[1], last[2], last[3]]);
    let button = color(ui, &mut shown).accessible_name(format!("colour of {name}"));
    let hint = "one colour for the layer, from black over its window; expand the layer for colour maps";
    if button.on_hover_text(hint).changed() {
        layer.color = Some(shown);
    }
}

fn menu(ui: &mut Ui, scene: &Scene, layer: usize) -> Option<Change> {
    let count = scene.layers.len();
    let names = "the expression names layers by position: clear it first";
    let expression = scene.expression.as_ref().map(|_| names);
    let end = |is_end: bool| is_end.then_some("already at the end of the list");
    let full = (count >= MAX_VOLUMES).then_some("a scene has at most 32 layers");
    let entries = [
        ("duplicate", Change::Duplicate, expression.or(full)),
        ("move up", Change::Up, expression.or(end(layer == 0))),
        ("move down", Change::Down, expression.or(end(layer + 1 == count))),
        ("remove", Change::Remove, expression.or((count == 1).then_some("a scene has at least one layer"))),
    ];
    let mut change = None;
    for (name, asked, reason) in entries {
        let entry = ui.add_enabled(reason.is_none(), Button::new(name));
        if entry.on_disabled_hover_text(reason.unwrap_or_default()).clicked() {
            change = Some(asked);
            ui.close();
        }
    }
    change
}

/// Shows a layer's settings.
fn body(
    ui: &mut Ui,
    scene: &mut Scene,
    volumes: &[VolumeSource],
    layer: usize,
    picked: Option<i64>,
    saved: &mut Vec<SavedFunction>,
) {
    let Some(volume) = volumes.get(scene.store(layer)) else {
        ui.label("its volume is missing");
        return;
    };
    if scene.expression.is_some() {
        ui.label(RichText::new("The expression's colours replace the layer's own.").weak());
    } else if volume.source.is_labels() {
        labels::show(ui, &mut scene.layers[layer], volume, picked);
        style::opacity_and_blend(ui, &mut scene.layers[layer]);
    } else {
        style::show(ui, &mut scene.layers[layer], volume);
        style::opacity_and_blend(ui, &mut scene.layers[layer]);
        transfer_editor::show(ui, &mut scene.layers[layer], volume, saved);
        isosurfaces::show(ui, scene, layer, volume);
    }
    data::show(ui, scene, volumes, layer);
}

/// Performs an action. Each layer keeps its own volume, wherever it is moved.
fn rearrange(scene: &mut Scene, layer: usize, change: Change, open: &mut Vec<bool>) {
    let stores: Vec<usize> = (0..scene.layers.len()).map(|layer| scene.store(layer)).collect();
    let mut layers: Vec<_> = scene.layers.drain(..).zip(stores).zip(open.drain(..)).collect();
    match change {
        Change::Solo => {
            let is_solo = layers.iter().enumerate().all(|(i, ((other, _), _))| other.visible == (i == layer));
            layers.iter_mut().enumerate().for_each(|(i, ((other, _), _))| other.visible = is_solo || i == layer);
        }
        Change::Duplicate => layers.insert(layer + 1, layers[layer].clone()),
        Change::Up => layers.swap(layer - 1, layer),
        Change::Down => layers.swap(layer, layer + 1),
        Change::Remove => {
            layers.remove(layer);
            if layers.iter().all(|((other, _), _)| !other.visible) {
                layers.iter_mut().for_each(|((other, _), _)| other.visible = true);
            }
        }
    }
    for (i, ((mut layer, store), is_open)) in layers.into_iter().enumerate() {
        layer.source = (layer.source.is_some() || store != i).then_some(store);
        scene.layers.push(layer);
        open.push(is_open);
    }
}

#[cfg(test)]
mod tests;
