//! Drags measured from the press on, wherever the pointer is when egui recognizes them.

use eframe::egui::{Response, Vec2};

/// A widget's drag in this frame; in its first frame, from the press on.
pub(crate) fn drag_by(response: &Response) -> Vec2 {
    match response.drag_started() {
        true => response.total_drag_delta().unwrap_or_default(),
        false => response.drag_delta(),
    }
}
