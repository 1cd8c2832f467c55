//! Screenshots: pixels of the whole window, which arrive and are written a frame after their request.

use brickyard::picture_file::{PictureError, write_png};
use brickyard::volume::Picture;
use eframe::egui::{self, ColorImage, ScreenshotCallback, ViewportCommand};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};

/// Requested screenshots.
pub(crate) struct Screenshots {
    /// The files of those still to arrive.
    awaited: Vec<PathBuf>,
    sender: Sender<Screenshot>,
    receiver: Receiver<Screenshot>,
}

/// The window's pixels, and the file for them.
struct Screenshot {
    path: PathBuf,
    image: Arc<ColorImage>,
}

impl Screenshots {
    pub(crate) fn new() -> Self {
        let (sender, receiver) = channel();
        Self { awaited: Vec::new(), sender, receiver }
    }

    /// Requests the pixels of the next frame.
    pub(crate) fn take(&mut self, path: PathBuf, egui: &egui::Context) {
        self.awaited.push(path.clone());
        let (sender, wake) = (self.sender.clone(), egui.clone());
        let callback = ScreenshotCallback::new(move |image| {
            // Without a receiver the window is gone.
            let _ = sender.send(Screenshot { path, image });
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
        let mut written = Vec::new();
        while let Ok(Screenshot { path, image }) = self.receiver.try_recv() {
            let place = self.awaited.iter().position(|awaited| *awaited == path);
            place.map(|place| self.awaited.remove(place));
            let [width, height] = image.size.map(|side| side as u32);
            let rgb = image.pixels.iter().map(|pixel| [pixel.r(), pixel.g(), pixel.b()]).collect();
            let result = write_png(&path, &Picture { width, height, rgb }, &[]);
            written.push((path, result));
        }
        written
    }
}
