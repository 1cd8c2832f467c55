//! Drags measured from the press on, wherever the pointer is by the time egui recognizes them.

use eframe::egui::{Response, Vec2};

/// Distance of a widget's drag in this frame; in its first frame, from the press on.
pub(crate) fn drag_by(response: &Response) -> Vec2 {
    match response.drag_started() {
        true => response.total_drag_delta().unwrap_or_default(),
        false => response.drag_delta(),
    }
}
