//! Screenshots: pixels of the whole window, which arrive and are written a frame after their request.

use brickyard::picture_file::{PictureError, write_png};
use brickyard::volume::Picture;
use eframe::egui::{self, ColorImage, ScreenshotCallback, ViewportCommand};
use std::path::PathBuf;
use std::sync::{Arc, Mutex, PoisonError};

/// The window's pixels, and the file for them.
type Screenshot = (PathBuf, Arc<ColorImage>);

/// Requested screenshots.
#[derive(Default)]
pub(crate) struct Screenshots {
    /// The files of those still to arrive.
    awaited: Vec<PathBuf>,
    arrived: Arc<Mutex<Vec<Screenshot>>>,
}

impl Screenshots {
    /// Requests the pixels of the next frame.
    pub(crate) fn take(&mut self, path: PathBuf, egui: &egui::Context) {
        self.awaited.push(path.clone());
        let (arrived, wake) = (self.arrived.clone(), egui.clone());
        let callback = ScreenshotCallback::new(move |image| {
            arrived.lock().unwrap_or_else(PoisonError::into_inner).push((path, image));
            wake.request_repaint();
        });
        egui.send_viewport_cmd(ViewportCommand::Screenshot(callback));
    }

    pub(crate) fn are_awaited(&self) -> bool {
        !self.awaited.is_empty()
    }

    /// Gives up those still to arrive, as their window is gone. Returns their files.
    pub(crate) fn give_up(&mut self) -> Vec<PathBuf> {
        std::mem::take(&mut self.awaited)
    }

    /// Writes those that have arrived. Returns each file with its result.
    pub(crate) fn write(&mut self) -> Vec<(PathBuf, Result<(), PictureError>)> {
        let arrived = std::mem::take(&mut *self.arrived.lock().unwrap_or_else(PoisonError::into_inner));
        let write = |(path, image): Screenshot| {
            let place = self.awaited.iter().position(|awaited| *awaited == path);
            place.map(|place| self.awaited.remove(place));
            let [width, height] = image.size.map(|side| side as u32);
            let rgb = image.pixels.iter().map(|pixel| [pixel.r(), pixel.g(), pixel.b()]).collect();
            let result = write_png(&path, &Picture { width, height, rgb }, &[]);
            (path, result)
        };
        arrived.into_iter().map(write).collect()
    }
}
