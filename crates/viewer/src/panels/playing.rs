//! The row of time steps below the pictures: play or stop, the bar of steps with the current and the ready ones, and the playback settings. The curve
//! of a voxel's values lies over the bar, if requested.

use crate::panels::widgets::{Choices, Scale, slider, switch};
use crate::play::{Play, RATES};
use crate::value_curve::ValueCurve;
use brickyard::curve::LINE_COLORS;
use brickyard::pager::{Ending, Policy};
use brickyard::session::ComingStep;
use brickyard::volume::Timeline;
use brickyard::volume::numbers::within_span;
use brickyard::volume::units::with_unit;
use eframe::egui::containers::menu::{MenuButton, MenuConfig};
use eframe::egui::{
    Align, Color32, Layout, Painter, PopupCloseBehavior, Pos2, Rect, Response, Sense, Ui, WidgetInfo, pos2, vec2,
};
use std::fmt::Write;

/// Height of the row without and with a curve, and width of a step's text, in points.
const HEIGHT: f32 = 22.0;
const CURVE_HEIGHT: f32 = 72.0;
const WORDS_WIDTH: f32 = 230.0;

const ENDINGS: Choices<'_, Ending> = &[
    (Ending::Loop, "loop", "the first step follows the last"),
    (Ending::Bounce, "bounce", "to and fro"),
    (Ending::Stop, "stop at the end", "stops at the last step"),
];

const POLICIES: Choices<'_, Policy> = &[
    (Policy::HoldRate, "hold the rate", "every step on time, as coarse as necessary"),
    (Policy::HoldQuality, "hold the quality", "only complete steps; late ones are dropped"),
    (Policy::EveryStep, "every step", "every step, complete, however long it takes"),
];

/// The row's data.
pub(crate) struct Steps<'a> {
    pub(crate) timeline: &'a Timeline,
    /// The visible picture's step, for the text; `None` before the first. It may lag behind the requested step.
    pub(crate) seen: Option<u32>,
    pub(crate) coming: &'a [ComingStep],
    pub(crate) curve: Option<&'a ValueCurve>,
    /// Unit of the curve's values, if all channels have one; else empty.
    pub(crate) unit: &'a str,
}

/// Reserves room for the row, to be [shown](show) once the pictures are drawn, so that it names their step.
pub(crate) fn room(ui: &mut Ui, play: &Play) -> Rect {
    ui.allocate_exact_size(vec2(ui.available_width(), height(play)), Sense::hover()).0
}

fn height(play: &Play) -> f32 {
    if play.curve { CURVE_HEIGHT } else { HEIGHT }
}

/// Shows the row of a timeline of several steps, and edits the requested step and the playback.
pub(crate) fn show(ui: &mut Ui, time: &mut u32, play: &mut Play, steps: &Steps<'_>) {
    let height = height(play);
    ui.allocate_ui_with_layout(vec2(ui.available_width(), height), Layout::left_to_right(Align::Center), |ui| {
        let (name, hint) =
            if play.on { ("stop", "stands still (Space)") } else { ("play", "plays the time steps (Space)") };
        if ui.button(name).on_hover_text(hint).clicked() {
            play.on = !play.on;
        }
        let stays = MenuConfig::new().close_behavior(PopupCloseBehavior::CloseOnClickOutside);
        let (button, _) = MenuButton::new("how").config(stays).ui(ui, |ui| how(ui, play));
        button.on_hover_text("rate, order, and policy if the rate cannot be held");
        ui.with_layout(Layout::right_to_left(Align::Center), |ui| {
            let words = |ui: &mut Ui| ui.label(words(steps.seen.unwrap_or(*time), steps));
            ui.allocate_ui_with_layout(vec2(WORDS_WIDTH, height), Layout::left_to_right(Align::Center), words);
            bar(ui, time, height - 6.0, steps);
        });
    });
}

fn how(ui: &mut Ui, play: &mut Play) {
    ui.set_width(240.0);
    slider(ui, "rate", "time steps a second", &mut play.steps_per_second, Scale::Log, RATES, "/s");
    switch(ui, "backward", "from later steps to earlier ones", &mut play.backward);
    ui.separator();
    for (ending, name, hint) in ENDINGS {
        ui.radio_value(&mut play.ending, *ending, *name).on_hover_text(*hint);
    }
    ui.separator();
    for (policy, name, hint) in POLICIES {
        ui.radio_value(&mut play.policy, *policy, *name).on_hover_text(*hint);
    }
    ui.separator();
    let hint = "values of the voxel under the pointer at all steps; during playback, of the last such voxel";
    switch(ui, "curve", hint, &mut play.curve);
}

/// A step's text: its number and the last one (as in napari), its time, and the values of a curve.
fn words(time: u32, steps: &Steps<'_>) -> String {
    let mut words = format!("step {time} / {}", steps.timeline.steps() - 1);
    // Writing to a string cannot fail.
    let _ = steps.timeline.axis().map(|axis| write!(words, ", {}", axis.in_words(axis.at(time))));
    let Some(curve) = steps.curve else { return words };
    let [x, y, z] = curve.voxel;
    let _ = write!(words, "\nvoxel {x}, {y}, {z}");
    let Some((low, high)) = curve.range() else { return words };
    let values = curve.steps.get(steps.timeline.step_of(curve.volume, time) as usize);
    for (i, value) in values.into_iter().flatten().enumerate() {
        let before = if i == 0 { ": " } else { ", " };
        let _ = match value.is_nan() {
            true => write!(words, "{before}no data"),
            false => write!(words, "{before}{}", within_span(*value, high - low)),
        };
    }
    let unit = Some(steps.unit).filter(|unit| !unit.is_empty());
    let high_in_unit = with_unit(&within_span(high, high - low), unit);
    let _ = write!(words, "\n{} to {high_in_unit} over time", within_span(low, high - low));
    words
}

/// Shows a bar of all steps: the shown one, the coming ones that are ready, and a curve over them. A drag jumps.
fn bar(ui: &mut Ui, time: &mut u32, height: f32, steps: &Steps<'_>) -> Response {
    let (area, mut response) = ui.allocate_exact_size(vec2(ui.available_width(), height), Sense::click_and_drag());
    let count = steps.timeline.steps();
    if let Some(place) = response.interact_pointer_pos() {
        let part = (place.x - area.left()) / area.width().max(1.0);
        let step = ((part.clamp(0.0, 1.0) * count as f32) as u32).min(count - 1);
        if step != *time {
            *time = step;
            response.mark_changed();
        }
    }
    let of_step = |step: u32| {
        let at = |step: u32| area.left() + area.width() * step as f32 / count as f32;
        // Wide enough to be visible.
        Rect::from_min_max(pos2(at(step), area.top()), pos2(at(step + 1).max(at(step) + 2.0), area.bottom()))
    };
    let visuals = ui.visuals();
    let (whole, part) = (visuals.selection.bg_fill, visuals.selection.bg_fill.gamma_multiply(0.4));
    let painter = ui.painter();
    painter.rect_filled(area, 2.0, visuals.extreme_bg_color);
    for ComingStep { step, ready } in steps.coming.iter().filter(|coming| coming.ready.is_covered) {
        painter.rect_filled(of_step(step.step), 0.0, if ready.is_whole { whole } else { part });
    }
    painter.rect_filled(of_step(*time), 0.0, if visuals.dark_mode { Color32::WHITE } else { Color32::BLACK });
    draw_curve(&painter.with_clip_rect(area), visuals.text_color(), area.shrink2(vec2(0.0, 3.0)), steps);
    let value = f64::from(*time);
    response.widget_info(|| WidgetInfo {
        value: Some(value),
        ..WidgetInfo::labeled(eframe::egui::Role::Slider, true, "time steps")
    });
    response.on_hover_text("drag to jump; coming steps are marked as they get ready")
}

/// Draws a line for each channel of a curve, the first in the text colour. Lines break at steps without a value.
fn draw_curve(painter: &Painter, first: Color32, area: Rect, steps: &Steps<'_>) {
    let Some((curve, (low, high))) = steps.curve.and_then(|curve| Some((curve, curve.range()?))) else { return };
    let count = steps.timeline.steps();
    let place = |step: u32, value: f64| -> Pos2 {
        // A constant curve lies in the middle.
        let part = if high > low { (value - low) / (high - low) } else { 0.5 };
        let x = area.left() + area.width() * (step as f32 + 0.5) / count as f32;
        pos2(x, area.bottom() - area.height() * part as f32)
    };
    for channel in 0..curve.channels() {
        let [r, g, b] = LINE_COLORS[channel % LINE_COLORS.len()];
        let color = if channel == 0 { first } else { Color32::from_rgb(r, g, b) };
        let values = (0..count).filter_map(|step| {
            // Unread steps are skipped.
            let values = curve.steps.get(steps.timeline.step_of(curve.volume, step) as usize)?;
            Some((step, *values.get(channel)?))
        });
        let values: Vec<(u32, f64)> = values.collect();
        for run in values.split(|(_, value)| !value.is_finite()).filter(|run| !run.is_empty()) {
            let mut points: Vec<Pos2> = run.iter().map(|(step, value)| place(*step, *value)).collect();
            // A single value is a line too.
            points.extend(points.first().filter(|_| run.len() == 1).map(|point| *point + vec2(1.5, 0.0)));
            painter.line(points, (1.5, color));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard::pager::{Readiness, ShownStep};
    use brickyard::volume::{TimeAxis, VolumeTime};
    use eframe::egui::accesskit::Role;
    use eframe::egui::{Event, Modifiers, PointerButton};
    use egui_kittest::Harness;
    use egui_kittest::kittest::{NodeT, Queryable};
    use std::sync::Arc;

    fn harness<'a>() -> Harness<'a, (u32, Play)> {
        let axis = TimeAxis { step: 0.5, unit: Some("second".into()), ..TimeAxis::default() };
        let timeline = Timeline::new(vec![VolumeTime { steps: 100, axis: Some(Arc::new(axis)) }], [0]);
        let step = ShownStep { step: 8, level_bias: 0.0 };
        let ready = Readiness { is_whole: true, is_covered: true, ..Readiness::default() };
        let coming = [ComingStep { step, ready }];
        let curve = ValueCurve {
            volume: 0,
            voxel: [3, 4, 5],
            steps: (0..100).map(|step| vec![f64::from(step * step)]).collect(),
        };
        let show = move |ui: &mut Ui, (time, play): &mut (u32, Play)| {
            let curve = Some(&curve).filter(|_| play.curve);
            show(ui, time, play, &Steps { timeline: &timeline, seen: None, coming: &coming, curve, unit: "K" });
        };
        Harness::builder().with_size(vec2(700.0, 300.0)).build_ui_state(show, (7, Play::default()))
    }

    #[test]
    fn looking_changes_nothing_and_says_which_step_it_is() {
        let mut harness = harness();
        harness.run();
        assert_eq!(*harness.state(), (7, Play::default()));
        assert!(harness.query_by_label("step 7 / 99, 3.5 s").is_some());
    }

    #[test]
    fn it_plays_and_stops() {
        let mut harness = harness();
        harness.get_by_label("play").click();
        harness.run();
        assert!(harness.state().1.on);
        harness.get_by_label("stop").click();
        harness.run();
        assert!(!harness.state().1.on);
    }

    #[test]
    fn a_click_on_the_bar_jumps_there() {
        let mut harness = harness();
        let bounds = harness.get_by_role_and_label(Role::Slider, "time steps").accesskit_node().raw_bounds().unwrap();
        for (part, step) in [(0.505, 50), (0.0, 0), (0.999, 99)] {
            let x = bounds.x0 + part * (bounds.x1 - bounds.x0);
            let pos = pos2(x as f32, ((bounds.y0 + bounds.y1) / 2.0) as f32);
            for pressed in [true, false] {
                let (button, modifiers) = (PointerButton::Primary, Modifiers::NONE);
                harness.input_mut().events.push(Event::PointerMoved(pos));
                harness.input_mut().events.push(Event::PointerButton { pos, button, pressed, modifiers });
                harness.run();
            }
            assert_eq!(harness.state().0, step);
        }
    }

    #[test]
    fn how_it_plays_is_chosen() {
        let mut harness = harness();
        harness.get_by_label("how").click();
        harness.run();
        harness.get_by_label("backward").click();
        harness.run();
        for choice in ["bounce", "every step", "curve"] {
            harness.get_by_label(choice).click();
            harness.run();
        }
        let play = harness.state().1;
        assert_eq!((play.backward, play.ending, play.policy), (true, Ending::Bounce, Policy::EveryStep));
        assert!(play.curve && harness.query_by_label_contains("voxel 3, 4, 5: 49\n0 to 9801 K over time").is_some());
    }
}
