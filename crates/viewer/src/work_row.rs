//! A line about work in the background: what is done to which file, how far that is, and a button to stop it.

use eframe::egui::{ProgressBar, Ui};
use std::path::Path;

/// Shows how many bytes of how many are done of a file. Returns whether the work is to stop.
pub(crate) fn show(ui: &mut Ui, (what, path): (&str, &Path), (done, total): (u64, u64), can_stop: bool) -> bool {
    let name = path.file_name().unwrap_or(path.as_os_str()).to_string_lossy();
    ui.horizontal(|ui| {
        let is_stopped = can_stop && ui.button("Stop").clicked();
        let share = if total == 0 { 0.0 } else { done as f32 / total as f32 };
        let text = format!("{what} {name}: {} of {} MiB", done >> 20, total.div_ceil(1 << 20));
        ui.add(ProgressBar::new(share).text(text));
        is_stopped
    })
    .inner
}
