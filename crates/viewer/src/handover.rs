//! A window handed over from one device to the next: its place on the display, and egui's memory.

use crate::title;
use eframe::egui::{self, Memory, ViewportBuilder};
use std::path::PathBuf;

/// A window between two devices.
pub(crate) struct Handover {
    /// The reason for the loss.
    pub(crate) reason: String,
    /// Open panels and scroll positions.
    pub(crate) memory: Memory,
    pub(crate) viewport: ViewportBuilder,
}

impl Handover {
    /// The handover of a window of these paths, as it stands on the display.
    pub(crate) fn of(reason: String, egui: &egui::Context, paths: &[PathBuf]) -> Self {
        let mut viewport = viewport(paths);
        egui.input(|input| {
            let now = input.viewport();
            viewport.inner_size = now.inner_rect.map(|area| area.size());
            viewport.position = now.outer_rect.map(|area| area.min);
            (viewport.maximized, viewport.fullscreen) = (now.maximized, now.fullscreen);
        });
        Self { reason, memory: egui.memory(Memory::clone), viewport }
    }
}

/// A window of these paths, anywhere on the display.
pub(crate) fn viewport(paths: &[PathBuf]) -> ViewportBuilder {
    ViewportBuilder::default().with_title(title(paths)).with_app_id("brickyard")
}
