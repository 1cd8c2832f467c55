//! Diagnostics: frame times, drawn bricks per level, bytes read and uploaded, and memory in use.

use crate::canvas::{Canvas, FrameTimes};
use crate::overlay::bricks::level_color;
use crate::state::WindowState;
use crate::views::Views;
use brickyard::stats::Percentiles;
use brickyard::volume::numbers::significant;
use eframe::egui::{Color32, Grid, ProgressBar, Sense, Ui, pos2, vec2};

/// Height of the plot of frame times, in points and in milliseconds.
const PLOT: (f32, f32) = (48.0, 100.0);

pub(crate) fn show(ui: &mut Ui, views: &Views, window: &WindowState) {
    frames(ui, &views.main);
    ui.separator();
    levels(ui, &views.main);
    ui.separator();
    bricks(ui, &views.main);
    ui.separator();
    memory(ui, views, window);
}

/// Shows the last frames' times, and their percentiles.
fn frames(ui: &mut Ui, canvas: &Canvas) {
    let times = &canvas.times;
    let (area, _) = ui.allocate_exact_size(vec2(ui.available_width(), PLOT.0), Sense::hover());
    let painter = ui.painter_at(area);
    painter.rect_filled(area, 2.0, ui.visuals().extreme_bg_color);
    let bar = area.width() / 240.0;
    let height = |ms: f32| (ms / PLOT.1).min(1.0) * area.height();
    for (i, times) in times.iter().enumerate() {
        let x = area.left() + i as f32 * bar;
        let [stepped, drawn] = [times.step, times.drawing()].map(|time| height(1e3 * time.as_secs_f32()));
        let rect = |from: f32, to: f32| {
            eframe::egui::Rect::from_min_max(pos2(x, area.bottom() - to), pos2(x + bar, area.bottom() - from))
        };
        painter.rect_filled(rect(0.0, stepped), 0.0, Color32::from_rgb(240, 160, 60));
        painter.rect_filled(rect(stepped, stepped + drawn), 0.0, Color32::from_rgb(90, 150, 230));
    }
    let ms = |of: fn(&FrameTimes) -> f64| Percentiles::of(&times.iter().map(of).collect::<Vec<_>>());
    let (step, draw) = (ms(|t| 1e3 * t.step.as_secs_f64()), ms(|t| 1e3 * t.drawing().as_secs_f64()));
    Grid::new("frame times").num_columns(4).show(ui, |ui| {
        ["ms a frame", "median", "95 %", "99 %"].into_iter().for_each(|text| drop(ui.weak(text)));
        ui.end_row();
        for (name, color, Percentiles { p50, p95, p99 }) in
            [("streaming", Color32::from_rgb(240, 160, 60), step), ("drawing", Color32::from_rgb(90, 150, 230), draw)]
        {
            ui.colored_label(color, name);
            [p50, p95, p99].into_iter().for_each(|ms| drop(ui.label(format!("{ms:.1}"))));
            ui.end_row();
        }
    });
}

/// Shows the number of drawn bricks per level.
fn levels(ui: &mut Ui, canvas: &Canvas) {
    let mut counts = [0usize; 32];
    for cell in canvas.draw_lists().into_iter().flat_map(|list| &list.cells) {
        counts[usize::from(cell.brick.level.0).min(31)] += 1;
    }
    let all: usize = counts.iter().sum();
    ui.label(format!("{all} bricks are drawn"));
    for (level, &count) in counts.iter().enumerate().filter(|(_, count)| **count > 0) {
        let share = count as f32 / all.max(1) as f32;
        let bar = ProgressBar::new(share).fill(level_color(level as u8)).text(format!("level {level}: {count}"));
        ui.add(bar);
    }
}

/// Shows the wanted, resident and failed bricks, and their cost.
fn bricks(ui: &mut Ui, canvas: &Canvas) {
    let Some(status) = canvas.status() else { return };
    let counters = &status.counters;
    let mib = |bytes: u64| format!("{:.1} MiB", bytes as f64 / f64::from(1 << 20));
    let error = match status.effective_error_px.is_finite() {
        true => format!("{} of {} px", significant(status.effective_error_px, 3), status.pixel_error),
        false => format!("unbounded (the eye is inside), {} px wanted", status.pixel_error),
    };
    let rows = [
        ("wanted, resident, failed", format!("{}, {}, {}", status.wanted, status.resident, status.failed)),
        ("picture at its level", format!("{:.1} %", 100.0 * status.completeness)),
        ("largest voxel", error),
        ("slots", canvas.slots().to_string()),
        ("read, decoded", format!("{}, {}", mib(counters.bytes_read), mib(counters.bytes_decoded))),
        ("uploaded", format!("{}: {} bricks", mib(counters.bytes_uploaded), counters.uploaded)),
        ("uploaded again, ahead", format!("{}, {}", counters.reuploaded, counters.uploaded_ahead)),
        ("shared with another step", format!("{} bricks", counters.shared)),
        ("could not be read", counters.failed.to_string()),
    ];
    Grid::new("bricks").num_columns(2).show(ui, |ui| {
        for (name, value) in rows {
            ui.weak(name);
            ui.label(value);
            ui.end_row();
        }
    });
}

fn memory(ui: &mut Ui, views: &Views, window: &WindowState) {
    let (used, limits) = (views.memory_bytes(), views.budgets_bytes(window));
    let mib = |bytes: u64| bytes as f64 / f64::from(1 << 20);
    for (name, used, limit) in [("slots", used.0, limits.0), ("bricks", used.1, limits.1)] {
        let text = format!("{name}: {:.0} of {:.0} MiB", mib(used), mib(limit));
        ui.add(ProgressBar::new((used as f64 / limit.max(1) as f64) as f32).text(text));
    }
}
