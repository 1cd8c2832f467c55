//! A final picture on its way into a file: marks are drawn over it and it is compressed, beside the window. Costs a thread per picture.

use crate::canvas::Captured;
use crate::marks;
use brickyard::picture_file::write_shown;
use brickyard::session::VolumeSource;
use eframe::egui;
use std::io;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;

/// A picture being written. Dropping it waits for the end.
pub(crate) struct Saving {
    path: PathBuf,
    thread: Option<JoinHandle<Result<(), String>>>,
}

impl Saving {
    /// Starts writing a picture, with marks at `pixels_per_point`. The window is repainted at the end.
    ///
    /// # Errors
    /// If no thread can be started.
    pub(crate) fn begin(
        captured: Captured,
        volumes: Vec<VolumeSource>,
        pixels_per_point: f32,
        egui: egui::Context,
    ) -> io::Result<Self> {
        let path = captured.path.clone();
        let write = move || {
            let Captured { path, mut picture, scene, stats, over } = captured;
            marks::draw(&mut picture, &scene, &volumes, &over, pixels_per_point);
            let written = write_shown(&path, &picture, &scene, &stats).map_err(|error| error.to_string());
            egui.request_repaint();
            written
        };
        let thread = std::thread::Builder::new().name("saving".into()).spawn(write)?;
        Ok(Self { path, thread: Some(thread) })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// The result, once it is over. A panic of the thread continues here.
    pub(crate) fn poll(&mut self) -> Option<Result<(), String>> {
        let thread = self.thread.take_if(|thread| thread.is_finished())?;
        Some(thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    }
}

impl Drop for Saving {
    fn drop(&mut self) {
        // A panic has been reported already.
        self.thread.take().into_iter().for_each(|thread| drop(thread.join()));
    }
}
