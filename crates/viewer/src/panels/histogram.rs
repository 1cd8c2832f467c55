//! A channel's histogram, with a window dragged by its ends, or whole by its middle. Counts are on a logarithmic scale, or a linear one chosen by a
//! right click. The editor of transfer functions shares its axis and bars.

use crate::drag::drag_by;
use brickyard::store::Histogram;
use brickyard::volume::numbers::within_span;
use brickyard::volume::units::with_unit;
use eframe::egui::{Color32, CursorIcon, Id, Rect, Response, Sense, Stroke, Ui, pos2, vec2};

const HEIGHT: f32 = 54.0;

/// Grasping radius of the window's ends, in points.
const REACH: f32 = 8.0;

/// The window handle being dragged.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Handle {
    Low,
    High,
    Whole,
}

/// Shows a histogram and the window over it. Returns the dragged window, the least value first.
pub(crate) fn show(ui: &mut Ui, histogram: &Histogram, window: [f64; 2], unit: Option<&str>) -> Option<[f64; 2]> {
    let width = ui.available_width();
    let (area, response) = ui.allocate_exact_size(vec2(width, HEIGHT), Sense::click_and_drag());
    let axis = Axis::new(histogram, window, area);
    draw(ui, &axis, histogram, window);
    let at = response.hover_pos().map(|pointer| grasped(window.map(|value| axis.x(value)), pointer.x));
    let response = match at {
        Some(Handle::Whole) => response.on_hover_cursor(CursorIcon::Grab),
        Some(_) => response.on_hover_cursor(CursorIcon::ResizeHorizontal),
        None => response,
    };
    let hint = "drag an end of the window, or all of it by its middle";
    let response = hovered(response, &axis, histogram, unit, hint);
    scale_menu(&response);
    let held: Id = response.id.with("held");
    if let Some(pointer) = response.interact_pointer_pos().filter(|_| response.drag_started()) {
        // The pointer may have left the place of the press by now.
        let from = ui.input(|input| input.pointer.press_origin()).unwrap_or(pointer);
        let handle = grasped(window.map(|value| axis.x(value)), from.x);
        ui.data_mut(|data| data.insert_temp(held, handle));
    }
    let by = f64::from(drag_by(&response).x) / axis.points_per_value();
    let handle = ui.data(|data| data.get_temp(held))?;
    (response.dragged() && by != 0.0).then(|| dragged(window, handle, by, histogram.width / 16.0))
}

/// The values along a width on the screen.
#[derive(Clone, Copy)]
pub(crate) struct Axis {
    least: f64,
    greatest: f64,
    pub(crate) area: Rect,
}

impl Axis {
    /// The axis over all values of the histogram and the window.
    fn new(histogram: &Histogram, [low, high]: [f64; 2], area: Rect) -> Self {
        let end = histogram.low + histogram.width * histogram.counts.len() as f64;
        Self::over([histogram.low.min(low), end.max(high)], area)
    }

    pub(crate) fn over([least, greatest]: [f64; 2], area: Rect) -> Self {
        Self { least, greatest, area }
    }

    /// Width in values.
    pub(crate) fn span(&self) -> f64 {
        (self.greatest - self.least).max(f64::MIN_POSITIVE)
    }

    pub(crate) fn ends(&self) -> [f64; 2] {
        [self.least, self.greatest]
    }

    pub(crate) fn points_per_value(&self) -> f64 {
        f64::from(self.area.width()) / self.span()
    }

    pub(crate) fn x(&self, value: f64) -> f32 {
        self.area.left() + ((value - self.least) * self.points_per_value()) as f32
    }

    pub(crate) fn value(&self, x: f32) -> f64 {
        self.least + f64::from(x - self.area.left()) / self.points_per_value()
    }
}

/// The handle grasped by a pointer: the nearer end of the window if within reach or outside, else all of it.
fn grasped([low, high]: [f32; 2], at: f32) -> Handle {
    let (to_low, to_high) = ((at - low).abs(), (at - high).abs());
    let is_inside = low < at && at < high && to_low.min(to_high) > REACH.min(0.25 * (high - low));
    match is_inside {
        true => Handle::Whole,
        false if to_low <= to_high => Handle::Low,
        false => Handle::High,
    }
}

/// The window after dragging a handle by a difference of values. Its ends stay `least` apart.
fn dragged([low, high]: [f64; 2], handle: Handle, by: f64, least: f64) -> [f64; 2] {
    match handle {
        Handle::Low => [(low + by).min(high - least), high],
        Handle::High => [low, (high + by).max(low + least)],
        Handle::Whole => [low + by, high + by],
    }
}

/// Shows the value under the pointer with its bin's voxel count, above the hint.
pub(crate) fn hovered(
    response: Response,
    axis: &Axis,
    histogram: &Histogram,
    unit: Option<&str>,
    hint: &str,
) -> Response {
    let Some(pointer) = response.hover_pos() else { return response };
    let value = axis.value(pointer.x);
    let bin = ((value - histogram.low) / histogram.width).floor();
    let count = if bin >= 0.0 { histogram.counts.get(bin as usize).copied().unwrap_or(0) } else { 0 };
    let value = with_unit(&within_span(value, axis.span()), unit);
    let text = format!("{value}: {} voxels near it\n{hint}", grouped(count));
    response.on_hover_text_at_pointer(text)
}

/// A count with grouped thousands.
fn grouped(count: u64) -> String {
    let digits = count.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push('\u{2009}');
        }
        text.push(digit);
    }
    text
}

fn is_linear(ui: &Ui) -> bool {
    ui.data(|data| data.get_temp(scale_id())).unwrap_or(false)
}

fn scale_id() -> Id {
    Id::unique("histograms are linear")
}

/// Offers the scales on a right click.
fn scale_menu(response: &Response) {
    response.context_menu(|ui| {
        let mut is_linear = is_linear(ui);
        ui.label("voxel counts");
        let log = ui.radio_value(&mut is_linear, false, "logarithmic").on_hover_text("shows rare values, too");
        let linear = ui.radio_value(&mut is_linear, true, "linear").on_hover_text("twice as high is twice as many");
        if log.changed() || linear.changed() {
            ui.data_mut(|data| data.insert_temp(scale_id(), is_linear));
            ui.close();
        }
    });
}

/// Draws the bars of the counts, each in the colour of its least value.
pub(crate) fn bars(ui: &Ui, axis: &Axis, histogram: &Histogram, color: impl Fn(f64) -> Color32) {
    let (painter, area) = (ui.painter_at(axis.area), axis.area);
    let scaled: fn(u64) -> f64 = if is_linear(ui) { |count| count as f64 } else { |count| (count as f64).ln_1p() };
    let most = histogram.counts.iter().map(|&count| scaled(count)).fold(f64::MIN_POSITIVE, f64::max);
    for (bin, &count) in histogram.counts.iter().enumerate().filter(|(_, count)| **count > 0) {
        let from = histogram.low + bin as f64 * histogram.width;
        let (x0, x1) = (axis.x(from), axis.x(from + histogram.width));
        if x1 < area.left() || area.right() < x0 {
            continue;
        }
        let top = area.bottom() - (scaled(count) / most) as f32 * (area.height() - 4.0);
        painter.rect_filled(Rect::from_min_max(pos2(x0, top), pos2(x1.max(x0 + 1.0), area.bottom())), 0.0, color(from));
    }
}

fn draw(ui: &Ui, axis: &Axis, histogram: &Histogram, window: [f64; 2]) {
    let (painter, area, visuals) = (ui.painter_at(axis.area), axis.area, ui.visuals());
    painter.rect_filled(area, 2.0, visuals.extreme_bg_color);
    let [low, high] = window;
    let is_shown = |from: f64| from < high && low < from + histogram.width;
    let (shown, other) =
        (visuals.selection.bg_fill, visuals.extreme_bg_color.lerp_to_gamma(visuals.weak_text_color(), 0.6));
    bars(ui, axis, histogram, |from| if is_shown(from) { shown } else { other });
    // A line at the very edge would be cut in half.
    for x in window.map(|value| axis.x(value).clamp(area.left() + 1.0, area.right() - 1.0)) {
        painter.vline(x, area.y_range(), Stroke::new(2.0, visuals.strong_text_color()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use egui_kittest::Harness;
    use egui_kittest::kittest::Queryable;

    #[test]
    fn ends_are_taken_hold_of_near_them_and_the_whole_in_the_middle() {
        for (at, expected) in [
            (0.0, Handle::Low),
            (105.0, Handle::Low),
            (150.0, Handle::Whole),
            (195.0, Handle::High),
            (400.0, Handle::High),
        ] {
            assert_eq!(grasped([100.0, 200.0], at), expected, "{at}");
        }
        // A narrow window can be moved, too.
        assert_eq!(grasped([100.0, 108.0], 104.0), Handle::Whole);
    }

    #[test]
    fn the_window_keeps_its_order() {
        assert_eq!(dragged([2.0, 5.0], Handle::Low, 9.0, 0.5), [4.5, 5.0]);
        assert_eq!(dragged([2.0, 5.0], Handle::High, -9.0, 0.5), [2.0, 2.5]);
        assert_eq!(dragged([2.0, 5.0], Handle::Whole, -9.0, 0.5), [-7.0, -4.0]);
    }

    fn harness<'a>() -> Harness<'a, [f64; 2]> {
        let histogram = Histogram { low: 0.0, width: 1.0, counts: (0..256).map(|bin| bin * 5000).collect() };
        let show = move |ui: &mut Ui, window: &mut [f64; 2]| {
            *window = show(ui, &histogram, *window, Some("HU")).unwrap_or(*window);
        };
        Harness::builder().with_size(vec2(272.0, 200.0)).build_ui_state(show, [64.0, 128.0])
    }

    #[test]
    fn a_drag_moves_the_window() {
        let mut harness = harness();
        // From the middle of the window to the right.
        harness.drag_at(pos2(104.0, 30.0));
        harness.run();
        harness.hover_at(pos2(124.0, 30.0));
        harness.run();
        harness.drop_at(pos2(124.0, 30.0));
        harness.run();
        let [low, high] = *harness.state();
        assert!((high - low - 64.0).abs() < 1e-9 && (70.0..100.0).contains(&low), "{low} {high}");
    }

    #[test]
    fn the_value_under_the_pointer_is_said() {
        let mut harness = harness();
        harness.hover_at(pos2(136.0, 30.0));
        harness.run_steps(60);
        assert!(harness.query_all_by_label_contains("128 HU: 640\u{2009}000 voxels near it").next().is_some());
    }

    #[test]
    fn counts_become_linear() {
        let mut harness = harness();
        let press = |harness: &mut Harness<'_, [f64; 2]>| {
            for pressed in [true, false] {
                let (pos, button) = (pos2(20.0, 30.0), eframe::egui::PointerButton::Secondary);
                let modifiers = eframe::egui::Modifiers::NONE;
                harness.event(eframe::egui::Event::PointerButton { pos, button, pressed, modifiers });
            }
        };
        harness.hover_at(pos2(20.0, 30.0));
        press(&mut harness);
        harness.run();
        harness.get_by_label("linear").click();
        harness.run();
        assert!(harness.ctx.data(|data| data.get_temp::<bool>(scale_id())).unwrap());
        assert_eq!(*harness.state(), [64.0, 128.0]);
    }

    #[test]
    fn an_axis_goes_both_ways() {
        let axis = Axis::over([-5.0, 15.0], Rect::from_min_max(pos2(10.0, 0.0), pos2(110.0, 9.0)));
        assert_eq!((axis.x(-5.0), axis.x(5.0), axis.value(110.0)), (10.0, 60.0, 15.0));
    }
}
