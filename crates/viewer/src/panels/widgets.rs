//! The controls of panels: labelled rows, numbers with just their significant digits, colours, explained choices, and text applied once it parses.
//! Showing them never changes a value, so a scene without input stays as it is.

use brickyard::volume::numbers::within_span;
use brickyard::volume::units::name_in_unit;
use eframe::egui::{
    Align, CollapsingHeader, Color32, ComboBox, DragValue, Id, Label, Layout, RangeSlider, Response, RichText,
    ScrollArea, Slider, SliderClamping, TextEdit, Ui, UiBuilder, Visuals, vec2,
};
use glam::DVec3;
use std::ops::RangeInclusive;

/// Width of the column of labels, in points.
const LABEL_WIDTH: f32 = 74.0;

/// Width of a number beside a slider, in points.
const NUMBER_WIDTH: f32 = 52.0;

/// Least useful width of a rail, in points.
const LEAST_RAIL: f32 = 24.0;

/// Room left by a panel for its scroll bar, in points.
const SCROLL_BAR_WIDTH: f32 = 12.0;

/// All numbers, as a range.
pub(crate) const ANY: RangeInclusive<f64> = f64::NEG_INFINITY..=f64::INFINITY;

/// Shows a panel's content from top to bottom, in exactly the panel's room. Any excess is clipped: egui would widen the panel by it, in every frame
/// again for content that fills the width.
pub(crate) fn within(ui: &mut Ui, content: impl FnOnce(&mut Ui)) {
    let area = ui.available_rect_before_wrap();
    let mut inside = ui.new_child(UiBuilder::new().max_rect(area));
    inside.shrink_clip_rect(area);
    ScrollArea::vertical().auto_shrink(false).show(&mut inside, |ui| {
        // The bar comes and goes, and covers no control.
        ui.set_max_width(ui.available_width() - SCROLL_BAR_WIDTH);
        content(ui);
    });
    ui.advance_cursor_after_rect(area);
}

/// Shows a line of controls behind a label. `content` takes the label's id, for naming them.
pub(crate) fn row<R>(ui: &mut Ui, label: &str, hint: &str, content: impl FnOnce(&mut Ui, Id) -> R) -> R {
    ui.horizontal(|ui| {
        let size = vec2(LABEL_WIDTH, ui.spacing().interact_size.y);
        let label = ui.allocate_ui_with_layout(size, Layout::left_to_right(Align::Center), |ui| {
            ui.set_min_width(LABEL_WIDTH);
            ui.add(Label::new(label).truncate()).on_hover_text(hint)
        });
        content(ui, label.inner.id)
    })
    .inner
}

/// Shows controls under a heading, folded until clicked.
pub(crate) fn group(ui: &mut Ui, name: &str, hint: &str, content: impl FnOnce(&mut Ui)) {
    let folded = CollapsingHeader::new(name).id_salt(name).show_unindented(ui, content);
    folded.header_response.on_hover_text(hint);
}

/// Width of a number field with room for each of these values, in points, and at least `least`. It takes no more than that: a row wider than its
/// panel would widen the panel.
fn width_of(ui: &Ui, values: &[f64], span: f64, unit: &str, least: f32) -> f32 {
    let font = ui.style().drag_value_text_style.resolve(ui.style());
    let written =
        values.iter().filter(|value| value.is_finite()).map(|value| format!("{} {unit}", within_span(*value, span)));
    let width = |text: String| {
        let galley = ui.painter().layout_no_wrap(text.trim_end().to_string(), font.clone(), Color32::WHITE);
        galley.size().x
    };
    let longest = written.map(width).fold(0.0, f32::max);
    least.max((longest + 2.0 * ui.spacing().button_padding.x).ceil())
}

/// The accessor of egui's number widgets: the value changes by deliberate input only, not by rounding for display or clamping to the range of typed
/// numbers.
fn access<'a>(value: &'a mut f64, range: RangeInclusive<f64>, span: f64) -> impl FnMut(Option<f64>) -> f64 + 'a {
    move |new| {
        let shown = within_span(*value, span).parse::<f64>().unwrap_or(*value);
        let is_as_shown = |new: f64| new == shown.max(*range.start()).min(*range.end());
        if let Some(new) = new.filter(|new| new.is_finite() && !is_as_shown(*new)) {
            *value = new;
        }
        *value
    }
}

/// Shows a number to drag or type. `span` is the relevant range of values, `unit` the suffix.
pub(crate) fn number(
    ui: &mut Ui,
    value: &mut f64,
    range: RangeInclusive<f64>,
    span: f64,
    width: f32,
    unit: &str,
) -> Response {
    let suffix = if unit.is_empty() { String::new() } else { format!(" {unit}") };
    let number = DragValue::from_get_set(access(value, range.clone(), span))
        .speed((span.min(range.end() - range.start()) / 500.0).max(f64::MIN_POSITIVE))
        .range(range)
        .clamp_existing_to_range(false)
        .max_decimals(15)
        .custom_formatter(|value, _| within_span(value, span))
        .clip_text(true)
        .min_size(vec2(width, ui.spacing().interact_size.y))
        .suffix(suffix);
    ui.add(number)
}

/// A unit of values, if it is short enough to stand behind a number in a panel.
pub(crate) fn suffix(unit: Option<&str>) -> &str {
    const MOST_CHARS: usize = 5;
    unit.filter(|unit| unit.chars().count() <= MOST_CHARS).unwrap_or_default()
}

/// The scale of a slider.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Scale {
    /// Equal distances are equal differences.
    Linear,
    /// Equal distances are equal factors.
    Log,
}

/// Shows a slider in a row of its own, with its number.
pub(crate) fn slider(
    ui: &mut Ui,
    label: &str,
    hint: &str,
    value: &mut f64,
    scale: Scale,
    range: RangeInclusive<f64>,
    unit: &str,
) -> Response {
    let is_logarithmic = scale == Scale::Log;
    let span = if is_logarithmic { value.abs() } else { range.end() - range.start() };
    row(ui, label, hint, |ui, label| {
        let width = width_of(ui, &[*range.start(), *range.end(), *value], span, unit, NUMBER_WIDTH);
        ui.spacing_mut().slider_width = (ui.available_width() - width - ui.spacing().item_spacing.x).max(LEAST_RAIL);
        let rail = Slider::from_get_set(range.clone(), access(value, range.clone(), span))
            .clamping(SliderClamping::Edits)
            .logarithmic(is_logarithmic)
            .smallest_positive(1e-3)
            .show_value(false);
        let rail = ui.add(rail).labelled_by(label).on_hover_text(hint);
        rail | number(ui, value, range, span, width, unit).labelled_by(label)
    })
}

/// Shows an opacity, 0 to 1, on a slider.
pub(crate) fn opacity(ui: &mut Ui, hint: &str, value: &mut f64) {
    slider(ui, "opacity", hint, value, Scale::Linear, 0.0..=1.0, "");
}

/// Shows the two values of a window side by side, with a hint on each. Returns the edited ones, if they are in order.
pub(crate) fn window(
    ui: &mut Ui,
    hint: &str,
    shown: [f64; 2],
    span: f64,
    (least, greatest): (&str, &str),
    unit: Option<&str>,
) -> Option<[f64; 2]> {
    let [least, greatest] = [least, greatest].map(|hint| name_in_unit(hint, unit));
    let suffix = suffix(unit);
    row(ui, "window", hint, |ui, label| {
        let width = 0.5 * (ui.available_width() - ui.spacing().item_spacing.x);
        let mut typed = shown;
        number(ui, &mut typed[0], ANY, span, width, suffix).labelled_by(label).on_hover_text(least);
        number(ui, &mut typed[1], ANY, span, width, suffix).labelled_by(label).on_hover_text(greatest);
        (typed != shown && typed[0] < typed[1]).then_some(typed)
    })
}

/// Shows the three numbers of a point or a direction: side by side if short, else below each other.
pub(crate) fn vector(ui: &mut Ui, label: &str, hint: &str, value: &mut DVec3, span: f64) {
    let is_long = value.to_array().iter().any(|part| within_span(*part, span).len() > 6);
    let parts = |ui: &mut Ui, label: Id, axes: &[usize], value: &mut DVec3| {
        ui.spacing_mut().button_padding.x = 2.0;
        let gaps = ui.spacing().item_spacing.x * (axes.len() - 1) as f32;
        let width = (ui.available_width() - gaps) / axes.len() as f32;
        for &axis in axes {
            let part = number(ui, &mut value.as_mut()[axis], ANY, span, width, "");
            part.labelled_by(label).on_hover_text(["x", "y", "z"][axis]);
        }
    };
    if is_long {
        let mut first = None;
        for (axis, name) in [label, "   y", "   z"].into_iter().enumerate() {
            row(ui, name, hint, |ui, own| parts(ui, *first.get_or_insert(own), &[axis], value));
        }
    } else {
        row(ui, label, hint, |ui, label| parts(ui, label, &[0, 1, 2], value));
    }
}

/// Shows a whole number on a slider in a row of its own.
pub(crate) fn count(ui: &mut Ui, label: &str, hint: &str, value: &mut u32, range: RangeInclusive<u32>) -> Response {
    row(ui, label, hint, |ui, label| {
        ui.spacing_mut().slider_width =
            (ui.available_width() - NUMBER_WIDTH - ui.spacing().item_spacing.x).max(LEAST_RAIL);
        let rail = Slider::new(value, range.clone()).clamping(SliderClamping::Edits).show_value(false);
        let rail = ui.add(rail).labelled_by(label).on_hover_text(hint);
        let mut typed = f64::from(*value);
        let whole = f64::from(*range.start())..=f64::from(*range.end());
        // With so wide a span no decimals are shown.
        let number = number(ui, &mut typed, whole, 1e4, NUMBER_WIDTH, "").labelled_by(label);
        if typed != f64::from(*value) {
            *value = typed.round() as u32;
        }
        rail | number
    })
}

pub(crate) fn switch(ui: &mut Ui, label: &str, hint: &str, is_on: &mut bool) -> Response {
    row(ui, label, hint, |ui, label| ui.checkbox(is_on, "").labelled_by(label).on_hover_text(hint))
}

/// Shows a value that may be left to the engine: a switch `auto`, and a number if off.
pub(crate) fn auto(ui: &mut Ui, label: &str, hint: &str, value: &mut Option<f64>, own: f64, unit: &str) {
    row(ui, label, hint, |ui, label| {
        let mut is_auto = value.is_none();
        if ui.checkbox(&mut is_auto, "auto").changed() {
            *value = if is_auto { None } else { Some(own) };
        }
        if let Some(value) = value {
            let least = f64::MIN_POSITIVE;
            number(ui, value, least..=f64::INFINITY, own, NUMBER_WIDTH, unit).labelled_by(label);
        }
    });
}

/// A choice among a few, each with its value, name and meaning.
pub(crate) type Choices<'a, T> = &'a [(T, &'a str, &'a str)];

/// Shows a menu of choices. A choice with a reason from `barred` is disabled and shows it. Returns the chosen value.
pub(crate) fn menu<T: Copy + PartialEq>(
    ui: &mut Ui,
    label: &str,
    hint: &str,
    shown: T,
    all: Choices<'_, T>,
    barred: impl Fn(T) -> Option<String>,
) -> Option<T> {
    row(ui, label, hint, |ui, label| {
        let mut chosen = None;
        let name = all.iter().find(|(value, ..)| *value == shown).map_or("", |(_, name, _)| *name);
        let list = |ui: &mut Ui| {
            for (value, name, hint) in all {
                let reason = barred(*value).filter(|_| *value != shown);
                let entry = ui.add_enabled_ui(reason.is_none(), |ui| ui.selectable_label(*value == shown, *name)).inner;
                let entry = entry.on_hover_text(*hint).on_disabled_hover_text(reason.unwrap_or_default());
                if entry.clicked() {
                    chosen = Some(*value);
                }
            }
        };
        let width = ui.available_width();
        let menu = ComboBox::from_id_salt(label).width(width).selected_text(name).truncate().show_ui(ui, list);
        menu.response.labelled_by(label).on_hover_text(hint);
        chosen.filter(|chosen| *chosen != shown)
    })
}

/// Shows a menu of choices for a value, and sets the chosen one.
pub(crate) fn choice<T: Copy + PartialEq>(ui: &mut Ui, label: &str, hint: &str, value: &mut T, all: Choices<'_, T>) {
    *value = menu(ui, label, hint, *value, all, |_| None).unwrap_or(*value);
}

/// Shows the items of a list below each other, by `show`, which returns whether to remove its item. Returns whether one was removed.
pub(crate) fn list<T>(ui: &mut Ui, items: &mut Vec<T>, mut show: impl FnMut(&mut Ui, usize, &mut T) -> bool) -> bool {
    let before = items.len();
    let mut i = 0..;
    items.retain_mut(|item| i.next().is_none_or(|i| !ui.push_id(i, |ui| show(ui, i, item)).inner));
    items.len() < before
}

/// Shows a colour, edited by a click.
pub(crate) fn color(ui: &mut Ui, color: &mut [f64; 3]) -> Response {
    let mut bytes = color.map(|part| (part * 255.0).round() as u8);
    let swatch = |ui: &mut Ui| {
        ui.spacing_mut().interact_size.x = 28.0;
        ui.color_edit_button_srgb(&mut bytes)
    };
    let button = ui.scope(swatch).inner;
    if button.changed() {
        *color = bytes.map(|part| f64::from(part) / 255.0);
    }
    button
}

/// Shows a colour that may replace a derived one: the swatch shows the effective colour, and a cross removes the replacement.
pub(crate) fn own_color(ui: &mut Ui, own: &mut Option<[f64; 3]>, seen: [f64; 3], label: Id) {
    let mut shown = own.unwrap_or(seen);
    if color(ui, &mut shown).labelled_by(label).changed() {
        *own = Some(shown);
    }
    if own.is_some() && ui.small_button("x").on_hover_text("no colour of its own").clicked() {
        *own = None;
    }
}

pub(crate) fn color32(color: [f64; 3]) -> Color32 {
    let [r, g, b] = color.map(|part| (part * 255.0).round() as u8);
    Color32::from_rgb(r, g, b)
}

pub(crate) fn problem_color(visuals: &Visuals) -> Color32 {
    if visuals.dark_mode { Color32::from_rgb(240, 140, 90) } else { Color32::from_rgb(170, 60, 10) }
}

/// The typed text, and the text of the original value.
#[derive(Clone)]
struct Draft {
    basis: String,
    text: String,
}

/// Shows a value typed as text. It is applied once it parses; until then the text stays, with the error below. Returns whether the value changed.
pub(crate) fn typed<T: PartialEq>(
    ui: &mut Ui,
    name: &str,
    hint: &str,
    rows: usize,
    value: &mut T,
    words: impl Fn(&T) -> String,
    read: impl FnOnce(&str) -> Result<T, String>,
) -> bool {
    let key = ui.scope_id().with(name);
    let basis = words(value);
    let known = ui.data(|data| data.get_temp::<Draft>(key)).filter(|draft| draft.basis == basis);
    let mut text = known.map_or_else(|| basis.clone(), |draft| draft.text);
    let field = if rows > 1 { TextEdit::multiline(&mut text) } else { TextEdit::singleline(&mut text) };
    let field = field.desired_rows(rows).desired_width(f32::INFINITY).hint_text(hint);
    let response = ui.add(field).accessible_name(name);
    let parsed = (text != basis).then(|| read(&text));
    let mut has_changed = false;
    let basis = match parsed {
        Some(Ok(new)) if response.changed() && new != *value => {
            *value = new;
            has_changed = true;
            words(value)
        }
        Some(Err(problem)) => {
            let color = problem_color(ui.visuals());
            ui.label(RichText::new(problem).monospace().small().color(color));
            basis
        }
        _ => basis,
    };
    ui.data_mut(|data| data.insert_temp(key, Draft { basis, text }));
    has_changed
}

/// Shows a range of values in a row of its own: its ends on a rail, and as numbers, at least `least` apart.
pub(crate) fn range(
    ui: &mut Ui,
    label: &str,
    hint: &str,
    [low, high]: [&mut f64; 2],
    whole: RangeInclusive<f64>,
    least: f64,
) {
    let (first, last) = (*whole.start(), *whole.end());
    let span = last - first;
    row(ui, label, hint, |ui, label| {
        let end = width_of(ui, &[first, last, *low, *high], span, "", NUMBER_WIDTH - 8.0);
        number(ui, low, first..=(*high - least).max(first), span, end, "").labelled_by(label);
        let left = ui.available_width() - end - ui.spacing().item_spacing.x;
        // Long numbers leave no room for the rail.
        if left >= LEAST_RAIL {
            ui.spacing_mut().slider_width = left;
            let (mut to_low, mut to_high) = (*low, *high);
            let rail = RangeSlider::new(&mut to_low, &mut to_high, whole)
                .clamping(SliderClamping::Edits)
                .min_separation(least)
                .show_value(false);
            if ui.add(rail).labelled_by(label).on_hover_text(hint).changed() {
                (*low, *high) = (to_low, to_high);
            }
        }
        number(ui, high, (*low + least).min(last)..=last, span, end, "").labelled_by(label);
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::Key;
    use eframe::egui::accesskit::Role;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

    #[test]
    fn a_number_that_is_only_visited_stays_what_it_is() {
        let value = 1.0 / 3.0;
        let show = |ui: &mut Ui, value: &mut f64| {
            number(ui, value, 0.0..=0.2, 1.0, 50.0, "mm").accessible_name("length");
        };
        let mut harness = Harness::new_ui_state(show, value);
        harness.get_by_role(Role::SpinButton).focus();
        harness.run();
        harness.key_press(Key::Enter);
        harness.run();
        assert_eq!(*harness.state(), value, "neither rounded nor brought into its range");
    }

    #[test]
    fn a_number_is_typed() {
        let show = |ui: &mut Ui, value: &mut f64| {
            number(ui, value, 0.0..=9.0, 1.0, 50.0, "").accessible_name("length");
        };
        let mut harness = Harness::new_ui_state(show, 1.0);
        for (typed, expected) in [("2.34567", 2.345_67), ("x", 2.345_67), ("12", 9.0)] {
            harness.get_by_role(Role::SpinButton).focus();
            harness.run();
            harness.get_by_role(Role::SpinButton).type_text(typed);
            harness.run();
            harness.key_press(Key::Enter);
            harness.run();
            assert_eq!(*harness.state(), expected, "{typed}");
        }
    }

    #[test]
    fn text_is_applied_once_it_can_be_read() {
        let show = |ui: &mut Ui, value: &mut u32| {
            let read = |text: &str| text.parse::<u32>().map_err(|error| error.to_string());
            typed(ui, "count", "a number", 1, value, u32::to_string, read);
        };
        let mut harness = Harness::new_ui_state(show, 7);
        harness.get_by_label("count").focus();
        harness.run();
        harness.get_by_label("count").type_text("x");
        harness.run();
        assert_eq!(*harness.state(), 7);
        assert!(harness.query_by_label_contains("invalid digit").is_some());
        harness.key_press(Key::Backspace);
        harness.run();
        harness.get_by_label("count").type_text("1");
        harness.run();
        assert_eq!(*harness.state(), 71);
        assert!(harness.query_by_label_contains("invalid digit").is_none());
    }

    #[test]
    fn the_ends_of_a_range_stay_apart() {
        let show = |ui: &mut Ui, [low, high]: &mut [f64; 2]| range(ui, "x", "", [low, high], 0.0..=100.0, 1.0);
        let mut harness = Harness::new_ui_state(show, [20.0, 80.0]);
        let low = harness.get_all_by_role(Role::SpinButton).next().expect("the least value");
        low.focus();
        harness.run();
        harness.get_all_by_role(Role::SpinButton).next().expect("the least value").type_text("95");
        harness.run();
        harness.key_press(Key::Enter);
        harness.run();
        assert_eq!(*harness.state(), [79.0, 80.0]);
    }
}
