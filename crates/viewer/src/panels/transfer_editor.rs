//! The editor of a layer's transfer function: opacity as a curve over the histogram, colours as a strip below. Points are dragged, added by a double
//! click, and removed by a right click. The first edit of a preset writes it out as the layer's own function of the same look. Costs a copy of the
//! function's points per frame while open.

mod plot;
mod points;
mod strip;

use crate::panels::layers::style;
use crate::panels::widgets::{ANY, color, group, number, problem_color, row, suffix};
use brickyard::session::VolumeSource;
use brickyard::text_file::read_text;
use brickyard::volume::transfer::file;
use brickyard::volume::units::name_in_unit;
use brickyard::volume::{SceneLayer, TransferChoice, TransferFile, TransferFunction};
use eframe::egui::{Button, Id, Key, Modifiers, PointerButton, Pos2, Response, RichText, TextEdit, Ui, Vec2};
use plot::Counts;
use points::{add_point, move_point, remove_point, simplified};
use std::path::{Path, PathBuf};
use std::sync::Arc;

const HINT: &str = "opacity and colour of each value";

/// Most colour points edited directly; a longer table is reduced to a few of the same look.
const FEW_COLORS: usize = 24;

/// Largest change of colours in that reduction.
const TOLERANCE: f64 = 1.5 / 255.0;

/// Fewest points of opacity: one alone would make the function flat.
const FEWEST: usize = 2;

/// A transfer function to be saved, and its file, as JSON for scenes and the editor to read.
pub(crate) type SavedFunction = (PathBuf, TransferFunction);

/// A point of one of the function's lists.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Point {
    Opacity(usize),
    Color(usize),
}

/// The editor's state between frames.
#[derive(Clone)]
struct State {
    selected: Option<Point>,
    /// Whether the window fills the width.
    is_zoomed: bool,
    path: String,
    /// The remarks or the error of the last loaded file.
    message: Result<String, String>,
}

impl Default for State {
    fn default() -> Self {
        Self { selected: None, is_zoomed: false, path: "transfer.json".into(), message: Ok(String::new()) }
    }
}

/// Shows the transfer function of a layer of measurements. Functions to be saved go to `saved`.
pub(crate) fn show(ui: &mut Ui, layer: &mut SceneLayer, volume: &VolumeSource, saved: &mut Vec<SavedFunction>) {
    let channel = volume.statistics(layer.channel);
    let histogram = channel.map(|channel| &channel.histogram);
    let counts = Counts { histogram, unit: volume.value_unit(layer.channel) };
    group(ui, "transfer function", HINT, |ui| edit(ui, layer, volume, counts, saved));
}

fn edit(
    ui: &mut Ui,
    layer: &mut SceneLayer,
    volume: &VolumeSource,
    counts: Counts<'_>,
    saved: &mut Vec<SavedFunction>,
) {
    let key: Id = ui.scope_id().with("editor");
    let mut state: State = ui.data(|data| data.get_temp(key)).unwrap_or_default();
    if let Ok(before) = volume.function(layer) {
        let mut function = before.clone();
        let ends = ends(layer, volume, &before, state.is_zoomed);
        plot::show(ui, &mut function, counts, ends, &mut state.selected);
        let mut colors = few(&function.color);
        let shown = colors.clone();
        strip::show(ui, &function, &mut colors, ends, &mut state.selected);
        selected(ui, &mut function, &mut colors, Span { ends, unit: counts.unit }, &mut state.selected);
        if colors != shown {
            function.color = colors;
        }
        extras(ui, &mut function, volume, &mut state);
        if function != before {
            *layer = layer.written_out(function);
        }
    }
    files(ui, layer, volume, &mut state, saved);
    ui.data_mut(|data| data.insert_temp(key, state));
}

/// The values at both ends of the width: the window, or the full range of the volume and the function.
fn ends(layer: &SceneLayer, volume: &VolumeSource, function: &TransferFunction, is_zoomed: bool) -> [f64; 2] {
    let [low, high] = style::shown(layer, volume);
    if is_zoomed && low < high {
        return [low, high];
    }
    let (least, greatest) = volume.source.channel_range(layer.channel);
    let (first, last) = function.span();
    let (least, greatest) = (least.min(first), greatest.max(last));
    if least < greatest { [least, greatest] } else { [least - 0.5, least + 0.5] }
}

/// Least distance between points: about a point of the screen.
fn least([low, high]: [f64; 2]) -> f64 {
    (high - low) / 400.0
}

/// The edited values, and their unit if it is known.
#[derive(Clone, Copy)]
struct Span<'a> {
    ends: [f64; 2],
    unit: Option<&'a str>,
}

/// The editable colour points.
fn few(colors: &[[f64; 4]]) -> Vec<[f64; 4]> {
    if colors.len() > FEW_COLORS { simplified(colors, TOLERANCE) } else { colors.to_vec() }
}

fn selected(
    ui: &mut Ui,
    function: &mut TransferFunction,
    colors: &mut Vec<[f64; 4]>,
    span: Span<'_>,
    selected: &mut Option<Point>,
) {
    row(ui, "point", "the clicked point: its value, and its opacity or colour", |ui, label| {
        let gone = match *selected {
            Some(Point::Opacity(i)) if i < function.opacity.len() => {
                value(ui, label, &mut function.opacity, i, span);
                let alpha = &mut function.opacity[i][1];
                number(ui, alpha, 0.0..=1.0, 1.0, 48.0, "").labelled_by(label).on_hover_text("opacity, 0 to 1");
                is_removed(ui, &mut function.opacity, i, FEWEST)
            }
            Some(Point::Color(i)) if i < colors.len() => {
                value(ui, label, colors, i, span);
                let [_, r, g, b] = colors[i];
                let mut shown = [r, g, b];
                if color(ui, &mut shown).labelled_by(label).changed() {
                    colors[i][1..].copy_from_slice(&shown);
                }
                is_removed(ui, colors, i, 1)
            }
            _ => {
                ui.label(RichText::new("click one").weak());
                false
            }
        };
        if gone {
            *selected = None;
        }
    });
}

/// Shows the value of a point of a list.
fn value<const N: usize>(ui: &mut Ui, label: Id, points: &mut [[f64; N]], index: usize, span: Span<'_>) {
    let Span { ends, unit } = span;
    let mut value = points[index][0];
    let field = number(ui, &mut value, ANY, ends[1] - ends[0], 58.0, suffix(unit)).labelled_by(label);
    if field.on_hover_text(name_in_unit("value", unit)).changed() {
        move_point(points, index, value, [f64::NEG_INFINITY, f64::INFINITY], least(ends));
    }
}

/// Shows the button to remove a point of a list. Returns whether it is removed.
fn is_removed<const N: usize>(ui: &mut Ui, points: &mut Vec<[f64; N]>, index: usize, fewest: usize) -> bool {
    let button = ui.add_enabled(points.len() > fewest, Button::new("remove").small());
    let button = button.on_disabled_hover_text("the function needs its last points");
    button.clicked() && remove_point(points, index, fewest)
}

/// Shows a function's settings besides its curve.
fn extras(ui: &mut Ui, function: &mut TransferFunction, volume: &VolumeSource, state: &mut State) {
    let unit = brickyard::overlay::unit(std::slice::from_ref(volume), volume.place().is_anatomical);
    let hint = "the world distance over which the opacity accumulates: a longer one makes everything more transparent";
    row(ui, "per length", hint, |ui, label| {
        let span = function.unit_distance;
        let range = f64::MIN_POSITIVE..=f64::INFINITY;
        number(ui, &mut function.unit_distance, range, span, 58.0, unit).labelled_by(label);
        let zoom = ui.selectable_label(state.is_zoomed, "zoom");
        if zoom.on_hover_text("the window fills the width").clicked() {
            state.is_zoomed = !state.is_zoomed;
        }
    });
    if !function.is_by_gradient() {
        return;
    }
    ui.horizontal_wrapped(|ui| {
        let (factors, regions) = (function.gradient_opacity.len(), function.regions.len());
        let text = format!("Also depends on the gradient: {factors} points and {regions} regions.");
        ui.label(RichText::new(text).weak());
        if ui.small_button("leave out").on_hover_text("removes the dependence on the gradient").clicked() {
            function.gradient_opacity.clear();
            function.regions.clear();
        }
    });
}

fn files(
    ui: &mut Ui,
    layer: &mut SceneLayer,
    volume: &VolumeSource,
    state: &mut State,
    saved: &mut Vec<SavedFunction>,
) {
    let hint =
        "path of a file in brickyard's own JSON, or of ParaView's colour maps, or of 3D Slicer's volume properties";
    row(ui, "file", hint, |ui, label| {
        ui.add(TextEdit::singleline(&mut state.path).desired_width(f32::INFINITY)).labelled_by(label);
    });
    row(ui, "", "", |ui, _| {
        let has_path = !state.path.trim().is_empty();
        let path = PathBuf::from(state.path.trim());
        if ui.add_enabled(has_path, Button::new("load").small()).on_hover_text("loads the file's function").clicked() {
            state.message = load(layer, volume, &path);
            state.selected = None;
        }
        let save = ui.add_enabled(has_path, Button::new("save").small()).on_hover_text("writes the function");
        if let Some(function) = save.clicked().then(|| volume.function(layer).ok()).flatten() {
            saved.push((path, function));
        }
        if ui.small_button("reset").on_hover_text("the gray ramp over the window").clicked() {
            (layer.transfer, layer.window, state.selected) = (None, None, None);
        }
    });
    match &state.message {
        Ok(remarks) if remarks.is_empty() => {}
        Ok(remarks) => drop(ui.label(RichText::new(remarks).weak())),
        Err(problem) => drop(ui.label(RichText::new(problem).color(problem_color(ui.visuals())))),
    }
}

/// Gives a layer the function of a file. Returns remarks, if any, one per line.
fn load(layer: &mut SceneLayer, volume: &VolumeSource, path: &Path) -> Result<String, String> {
    let text = read_text(path).map_err(|error| error.to_string())?;
    let read = file::read(&text, None, &volume.subject(layer.channel));
    let imported = read.map_err(|error| format!("{}: {error}", path.display()))?;
    let function = Some(Arc::new(imported.transfer));
    layer.transfer = Some(TransferChoice::File(TransferFile { path: path.into(), name: None, function }));
    (layer.window, layer.color) = (None, None);
    Ok(imported.remarks.join("\n"))
}

/// The dragged point of a list, of this kind, and the place it goes to. A drag selects the point `near` the press, given with its offset from there.
fn dragged(
    ui: &Ui,
    response: &Response,
    (selected, kind): (&mut Option<Point>, fn(usize) -> Point),
    near: impl Fn(Pos2) -> Option<(usize, Vec2)>,
) -> Option<(usize, Pos2)> {
    let key = response.id.with("held");
    let pointer = response.interact_pointer_pos()?;
    if response.drag_started_by(PointerButton::Primary) {
        let held = near(ui.input(|input| input.pointer.press_origin()).unwrap_or(pointer));
        ui.data_mut(|data| data.insert_temp(key, held));
        if let Some((i, _)) = held {
            *selected = Some(kind(i));
            response.request_focus();
        }
    }
    let held = ui.data(|data| data.get_temp::<Option<(usize, Vec2)>>(key)).flatten();
    held.filter(|_| response.dragged()).map(|(i, off)| (i, pointer + off))
}

/// Keyboard changes to the selected point's value, in multiples of `step`, and to its opacity; and whether it is removed.
fn keys(ui: &Ui, response: &Response, step: f64) -> ([f64; 2], bool) {
    if !response.has_focus() {
        return ([0.0; 2], false);
    }
    let filter = eframe::egui::EventFilter { horizontal_arrows: true, vertical_arrows: true, ..Default::default() };
    ui.memory_mut(|memory| memory.set_focus_lock_filter(response.id, filter));
    ui.input_mut(|input| {
        let mut pressed = |key| input.count_and_consume_key(Modifiers::NONE, key) as f64;
        let right = pressed(Key::ArrowRight) - pressed(Key::ArrowLeft);
        let up = pressed(Key::ArrowUp) - pressed(Key::ArrowDown);
        let is_removed = pressed(Key::Delete) + pressed(Key::Backspace) > 0.0;
        ([right * step, 0.01 * up], is_removed)
    })
}

#[cfg(test)]
mod tests;
