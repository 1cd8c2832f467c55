//! A picture that is final, on its way into a file: marks are drawn over it, and it is compressed, beside the window. Costs a thread for each picture.

use crate::canvas::Captured;
use crate::marks;
use brickyard::picture_file::write_shown;
use brickyard::session::VolumeSource;
use eframe::egui;
use std::io;
use std::path::{Path, PathBuf};
use std::thread::JoinHandle;

/// A picture that is being written. Dropping it waits until it is.
pub(crate) struct Saving {
    path: PathBuf,
    thread: Option<JoinHandle<Result<(), String>>>,
}

impl Saving {
    /// Begins to write a picture of some volumes, with marks of so many pixels a point. The window is painted again when that is done.
    ///
    /// # Errors
    /// If there is no thread for it.
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

    /// The file.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// What came of it, once it is over. A panic of its goes on here.
    pub(crate) fn poll(&mut self) -> Option<Result<(), String>> {
        let thread = self.thread.take_if(|thread| thread.is_finished())?;
        Some(thread.join().unwrap_or_else(|panic| std::panic::resume_unwind(panic)))
    }
}

impl Drop for Saving {
    fn drop(&mut self) {
        // A panic has told itself already.
        self.thread.take().into_iter().for_each(|thread| drop(thread.join()));
    }
}
