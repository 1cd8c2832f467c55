//! Drags from the place of the press on, wherever the pointer is by the time that egui calls them drags.

use eframe::egui::{Response, Vec2};

/// How far a widget is dragged in this frame: in a drag's first frame, from the press on.
pub(crate) fn drag_by(response: &Response) -> Vec2 {
    match response.drag_started() {
        true => response.total_drag_delta().unwrap_or_default(),
        false => response.drag_delta(),
    }
}
