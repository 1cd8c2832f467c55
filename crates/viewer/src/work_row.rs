//! A row about work in the background: the task and its file, the progress, and a button to stop it.

use brickyard::overlay::short_name;
use eframe::egui::{Label, ProgressBar, Ui};
use std::path::Path;

/// Most characters of a name.
const LONGEST: usize = 32;

/// Shows progress in bytes of a file. Returns whether to stop the work.
pub(crate) fn show(ui: &mut Ui, what: &str, path: &Path, (done, total): (u64, u64), can_stop: bool) -> bool {
    let share = if total == 0 { 0.0 } else { done as f32 / total as f32 };
    row(ui, share, format!("{what} {}: {} of {} MiB", name(path), done >> 20, total.div_ceil(1 << 20)), can_stop)
}

/// Shows progress as a share of a file. Returns whether to stop the work.
pub(crate) fn show_share(ui: &mut Ui, what: &str, path: &Path, share: f64) -> bool {
    row(ui, share as f32, format!("{what} {}: {:.0} %", name(path), 100.0 * share), true)
}

/// Shows the wait for a file's store, packed by another program. Returns whether to stop waiting.
pub(crate) fn show_waiting(ui: &mut Ui, path: &Path) -> bool {
    ui.horizontal(|ui| {
        let is_stopped = ui.button("Stop").clicked();
        ui.add(Label::new(format!("another program is packing {}", name(path))).truncate());
        is_stopped
    })
    .inner
}

pub(crate) fn show_writing(ui: &mut Ui, path: &Path) {
    ui.label(format!("writing {}", name(path)));
}

fn name(path: &Path) -> String {
    short_name(&path.file_name().unwrap_or(path.as_os_str()).to_string_lossy(), LONGEST)
}

fn row(ui: &mut Ui, share: f32, text: String, can_stop: bool) -> bool {
    ui.horizontal(|ui| {
        let is_stopped = can_stop && ui.button("Stop").clicked();
        ui.add(ProgressBar::new(share).text(text));
        is_stopped
    })
    .inner
}
