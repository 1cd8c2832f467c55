//! A channel's histogram, its counts on a logarithmic scale, with a window that is dragged on it: by one of its ends, or whole by its middle.

use brickyard::store::Histogram;
use eframe::egui::{Color32, Id, Rect, Sense, Stroke, Ui, pos2, vec2};

const HEIGHT: f32 = 54.0;

/// How near to an end of the window the pointer must be to take hold of it, in points.
const REACH: f32 = 8.0;

/// What of a window a hand has hold of.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Handle {
    Low,
    High,
    Whole,
}

/// Shows a histogram and the window over it. Returns the window that the hand drags it to, the least value first.
pub(crate) fn show(ui: &mut Ui, histogram: &Histogram, [low, high]: [f64; 2]) -> Option<[f64; 2]> {
    let width = ui.available_width();
    let (area, response) = ui.allocate_exact_size(vec2(width, HEIGHT), Sense::click_and_drag());
    let response = response.on_hover_text("drag an end of the window, or all of it by its middle");
    let axis = Axis::new(histogram, [low, high], area);
    draw(ui, &axis, histogram, [low, high]);
    let held: Id = response.id.with("held");
    if let Some(pointer) = response.interact_pointer_pos().filter(|_| response.drag_started()) {
        // Where the button went down, the pointer may have left by now.
        let from = ui.input(|input| input.pointer.press_origin()).unwrap_or(pointer);
        let handle = grasped([low, high].map(|value| axis.x(value)), from.x);
        ui.data_mut(|data| data.insert_temp(held, handle));
    }
    let by = f64::from(response.drag_delta().x) / axis.points_per_value();
    let handle = ui.data(|data| data.get_temp(held))?;
    (response.dragged() && by != 0.0).then(|| dragged([low, high], handle, by, histogram.width / 16.0))
}

/// The values along a histogram's width.
struct Axis {
    least: f64,
    greatest: f64,
    area: Rect,
}

impl Axis {
    /// All values that the histogram or the window has.
    fn new(histogram: &Histogram, [low, high]: [f64; 2], area: Rect) -> Self {
        let end = histogram.low + histogram.width * histogram.counts.len() as f64;
        Self { least: histogram.low.min(low), greatest: end.max(high), area }
    }

    fn points_per_value(&self) -> f64 {
        f64::from(self.area.width()) / (self.greatest - self.least).max(f64::MIN_POSITIVE)
    }

    fn x(&self, value: f64) -> f32 {
        self.area.left() + ((value - self.least) * self.points_per_value()) as f32
    }
}

/// What a pointer takes hold of: the nearer end of the window if it is within reach or outside, else all of it.
fn grasped([low, high]: [f32; 2], at: f32) -> Handle {
    let (to_low, to_high) = ((at - low).abs(), (at - high).abs());
    let is_inside = low < at && at < high && to_low.min(to_high) > REACH.min(0.25 * (high - low));
    match is_inside {
        true => Handle::Whole,
        false if to_low <= to_high => Handle::Low,
        false => Handle::High,
    }
}

/// The window once what is held of it has been dragged by a difference of values. Its ends stay `least` apart.
fn dragged([low, high]: [f64; 2], handle: Handle, by: f64, least: f64) -> [f64; 2] {
    match handle {
        Handle::Low => [(low + by).min(high - least), high],
        Handle::High => [low, (high + by).max(low + least)],
        Handle::Whole => [low + by, high + by],
    }
}

fn draw(ui: &Ui, axis: &Axis, histogram: &Histogram, window: [f64; 2]) {
    let (painter, area) = (ui.painter_at(axis.area), axis.area);
    let visuals = ui.visuals();
    painter.rect_filled(area, 2.0, visuals.extreme_bg_color);
    let most = histogram.counts.iter().copied().max().unwrap_or(0) as f64;
    let [left, right] = window.map(|value| axis.x(value));
    for (bin, &count) in histogram.counts.iter().enumerate() {
        let from = histogram.low + bin as f64 * histogram.width;
        let (x0, x1) = (axis.x(from), axis.x(from + histogram.width));
        let part = (count as f64).ln_1p() / most.ln_1p().max(f64::MIN_POSITIVE);
        let top = area.bottom() - part as f32 * (HEIGHT - 4.0);
        let is_shown = x0 < right && left < x1;
        let color = if is_shown { visuals.selection.bg_fill } else { Color32::GRAY };
        painter.rect_filled(Rect::from_min_max(pos2(x0, top), pos2(x1.max(x0 + 1.0), area.bottom())), 0.0, color);
    }
    for x in [left, right] {
        painter.vline(x, area.y_range(), Stroke::new(2.0, visuals.strong_text_color()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::{Event, Modifiers, PointerButton};
    use egui_kittest::Harness;

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

    #[test]
    fn a_drag_moves_the_window() {
        let histogram = Histogram { low: 0.0, width: 1.0, counts: vec![3; 256] };
        let show = move |ui: &mut Ui, window: &mut [f64; 2]| {
            *window = show(ui, &histogram, *window).unwrap_or(*window);
        };
        let mut harness = Harness::builder().with_size(vec2(272.0, 80.0)).build_ui_state(show, [64.0, 128.0]);
        let press = |pos, pressed| Event::PointerButton {
            pos,
            button: PointerButton::Primary,
            pressed,
            modifiers: Modifiers::NONE,
        };
        // From the middle of the window to the right.
        harness.event(Event::PointerMoved(pos2(104.0, 30.0)));
        harness.event(press(pos2(104.0, 30.0), true));
        harness.run();
        harness.event(Event::PointerMoved(pos2(124.0, 30.0)));
        harness.run();
        harness.event(press(pos2(124.0, 30.0), false));
        harness.run();
        let [low, high] = *harness.state();
        assert!((high - low - 64.0).abs() < 1e-9 && (70.0..100.0).contains(&low), "{low} {high}");
    }
}
