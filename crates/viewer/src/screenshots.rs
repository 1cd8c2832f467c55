//! Screenshots: pixels of the whole window, which come a frame after they were asked for and are written then.

use brickyard::picture_file::{PictureError, write_png};
use brickyard::volume::Picture;
use eframe::egui::{self, ColorImage, ScreenshotCallback, ViewportCommand};
use std::path::PathBuf;
use std::sync::Arc;
use std::sync::mpsc::{Receiver, Sender, channel};

/// Screenshots that have been asked for.
pub(crate) struct Screenshots {
    /// The files of those that have not come yet.
    awaited: Vec<PathBuf>,
    sender: Sender<Screenshot>,
    receiver: Receiver<Screenshot>,
}

/// The window's pixels, and the file that they are for.
struct Screenshot {
    path: PathBuf,
    image: Arc<ColorImage>,
}

impl Screenshots {
    pub(crate) fn new() -> Self {
        let (sender, receiver) = channel();
        Self { awaited: Vec::new(), sender, receiver }
    }

    /// Asks for the pixels of the next frame.
    pub(crate) fn take(&mut self, path: PathBuf, egui: &egui::Context) {
        self.awaited.push(path.clone());
        let (sender, wake) = (self.sender.clone(), egui.clone());
        let callback = ScreenshotCallback::new(move |image| {
            // Where nobody waits any more, the window is gone.
            let _ = sender.send(Screenshot { path, image });
            wake.request_repaint();
        });
        egui.send_viewport_cmd(ViewportCommand::Screenshot(callback));
    }

    /// Whether some have not come yet.
    pub(crate) fn are_awaited(&self) -> bool {
        !self.awaited.is_empty()
    }

    /// Gives up those that have not come, as their window is gone. Returns their files.
    pub(crate) fn give_up(&mut self) -> Vec<PathBuf> {
        std::mem::take(&mut self.awaited)
    }

    /// Writes those that have come. Returns their files, and what came of each.
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
