//! The look of a layer's values: its window over the histogram, colours and gamma.

use crate::panels::widgets::{self, Scale, choice, opacity, own_color, problem_color, row, slider};
use crate::panels::{color_map, histogram};
use brickyard::session::VolumeSource;
use brickyard::store::metadata::ChannelStatistics;
use brickyard::volume::transfer::{GAMMAS, shown_window};
use brickyard::volume::{Blend, SceneLayer, TransferChoice};
use eframe::egui::{RichText, Ui};

/// Shows window, colours and gamma of a layer of measurements.
pub(crate) fn show(ui: &mut Ui, layer: &mut SceneLayer, volume: &VolumeSource) {
    window(ui, layer, volume);
    match volume.function(layer) {
        Ok(function) => {
            row(ui, "colours", "the colour map with its opacities", |ui, label| {
                if let Some(chosen) = color_map::menu(ui, layer.transfer.as_ref(), &function, label) {
                    // A tint would hide the new choice.
                    (layer.transfer, layer.color) = (chosen, None);
                }
            });
            row(ui, "tint", "one colour instead of the map: from black to it over the window", |ui, label| {
                let last = function.color.last().map_or([1.0; 3], |point| [point[1], point[2], point[3]]);
                own_color(ui, &mut layer.color, last, label);
            });
        }
        Err(problem) => {
            ui.label(RichText::new(problem.to_string()).color(problem_color(ui.visuals())));
            if ui.button("use gray").on_hover_text("the gray ramp over the window, without a file").clicked() {
                (layer.transfer, layer.window) = (None, None);
            }
        }
    }
    let hint = "exponent of colours and opacities over the window: less than 1 shows more of the lesser values";
    slider(ui, "gamma", hint, &mut layer.gamma, Scale::Log, GAMMAS, "");
}

pub(super) fn opacity_and_blend(ui: &mut Ui, layer: &mut SceneLayer) {
    opacity(ui, "factor of all opacities of the layer, 0 to 1", &mut layer.opacity);
    let blends = [
        (None, "auto", "by mode: in projections and slices channels add and labels lie over; else all mix"),
        (Some(Blend::Mix), "mix", "as a medium in the same place as the others: hides things behind it"),
        (Some(Blend::Add), "add", "as light alone: its colours are added, and it hides nothing (fluorescence)"),
        (Some(Blend::Over), "over", "in projections and slices on top of the others (labels over an image)"),
    ];
    let hint = "blending with other layers in the same place";
    choice(ui, "blend", hint, &mut layer.blend, &blends);
}

/// The effective window: the layer's own, or the span of a function with values of its own.
pub(crate) fn shown(layer: &SceneLayer, volume: &VolumeSource) -> [f64; 2] {
    let subject = volume.subject(layer.channel);
    let own = layer.transfer.as_ref().filter(|choice| !choice.spans_window());
    let span = own.and_then(|choice| Some(choice.function(&subject).ok()?.span()));
    layer.window.unwrap_or_else(|| span.unwrap_or(subject.window).into())
}

/// Shows the histogram, and the window's two values, which stay in order and apart.
fn window(ui: &mut Ui, layer: &mut SceneLayer, volume: &VolumeSource) {
    let shown = shown(layer, volume);
    let [low, high] = shown;
    let is_flat = low >= high;
    let drawn = ui.add_enabled_ui(!is_flat, |ui| {
        let (statistics, unit) = (volume.statistics(layer.channel), volume.value_unit(layer.channel));
        let dragged = statistics.and_then(|channel| histogram::show(ui, &channel.histogram, shown, unit));
        let (least, greatest) = volume.source.channel_range(layer.channel);
        let span = (greatest - least).max(high - low);
        let hint = "the values of the first and the last colour, in stored units";
        let typed = widgets::window(ui, hint, shown, span, ("least value", "greatest value"), unit);
        if let Some(window) = typed.or(dragged).filter(|[low, high]| low < high && (high - low).is_finite()) {
            layer.window = Some(window);
        }
        presets(ui, layer, statistics, (least, greatest));
    });
    drawn.response.on_disabled_hover_text("all points of the transfer function have the same value: no window to set");
}

/// Shows buttons for common windows.
fn presets(ui: &mut Ui, layer: &mut SceneLayer, statistics: Option<&ChannelStatistics>, range: (f64, f64)) {
    row(ui, "", "", |ui, _| {
        ui.spacing_mut().item_spacing.x = 4.0;
        let own = match layer.transfer.as_ref().is_none_or(TransferChoice::spans_window) {
            true => "the window of the file or its metadata",
            false => "the transfer function's own values",
        };
        if ui.small_button("auto").on_hover_text(own).clicked() {
            layer.window = None;
        }
        if ui.small_button("full").on_hover_text("from the least value to the greatest").clicked() {
            layer.window = Some(shown_window(range).into());
        }
        let Some(percentiles) = statistics.map(|channel| channel.percentiles) else { return };
        let hint = "leaves out the least and the greatest thousandth of the voxels";
        if ui.small_button("0.1\u{2013}99.9 %").on_hover_text(hint).clicked() {
            layer.window = Some(shown_window((percentiles.p0_1, percentiles.p99_9)).into());
        }
    });
}
