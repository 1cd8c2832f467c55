//! Pictures that are saved: asked for, drawn one after the other while the texture stays as it is, and handed over once they are final.

use super::beside::Task;
use super::row_drawing::{CapturePart, GpuCapture};
use super::{Canvas, Change, LOOK};
use crate::marks::Over;
use brickyard::session::{Frame, SessionError};
use brickyard::stats::RenderStats;
use brickyard::volume::{Picture, Scene};
use eframe::egui;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// A picture that is to be written once it is final.
pub(super) struct Capture {
    scene: Scene,
    /// `None` is the size in which the picture is shown.
    size_px: Option<(u32, u32)>,
    path: PathBuf,
    over: Over,
    asked: Instant,
}

/// A picture that is final, with all that is known of it.
pub(crate) struct Captured {
    /// The file that it is for.
    pub(crate) path: PathBuf,
    /// Its pixels.
    pub(crate) picture: Picture,
    /// Its scene, in which nothing is left open.
    pub(crate) scene: Scene,
    /// How many bricks it has.
    pub(crate) stats: RenderStats,
    /// The marks that are to be drawn over the picture.
    pub(crate) over: Over,
}

impl Canvas {
    /// Asks for a picture of a scene, which is drawn as soon as it is final. `None` is the size in which the picture is shown.
    pub(crate) fn capture(&mut self, scene: Scene, size_px: Option<(u32, u32)>, (path, over): (PathBuf, Over)) {
        self.captures.push_back(Capture { scene, size_px, path, over, asked: Instant::now() });
    }

    /// Whether a picture that was asked for has not come yet.
    pub(crate) fn is_capturing(&self) -> bool {
        !self.captures.is_empty()
    }

    /// Goes on with the picture that was asked for first, while the texture stays as it is, and returns it once it is final.
    ///
    /// # Errors
    /// If it cannot be drawn; it is given up then, unless another device may draw it.
    pub(crate) fn captured(
        &mut self,
        size_px: (u32, u32),
        egui: &egui::Context,
    ) -> Result<Option<Captured>, SessionError> {
        let Some(capture) = self.captures.front() else { return Ok(None) };
        let (scene, size_px) = (capture.scene.clone(), capture.size_px.unwrap_or(size_px));
        self.in_rows = None;
        let drawn = match self.arrive() {
            Ok(None) => self.go_on_with_capture(&scene, size_px, egui),
            drawn => drawn,
        };
        // The session's slots are those of another picture now.
        self.shown.iter_mut().for_each(|shown| shown.samples_left = None);
        let is_over = match &drawn {
            Ok(drawn) => drawn.is_some(),
            Err(_) => !self.is_lost(),
        };
        let Some(Capture { scene, path, over, .. }) = self.captures.pop_front_if(|_| is_over) else {
            return drawn.map(|_| None);
        };
        self.change(Change::Play(self.playback));
        let Some((picture, frame)) = drawn? else { return Ok(None) };
        let mut stats = RenderStats::default();
        stats.record(&frame.status, self.memory_bytes().0);
        Ok(Some(Captured { path, picture, scene: frame.scene.shown(&scene), stats, over }))
    }

    fn go_on_with_capture(
        &mut self,
        scene: &Scene,
        size_px: (u32, u32),
        egui: &egui::Context,
    ) -> Result<Option<(Picture, Frame)>, SessionError> {
        if self.gpu.is_none() {
            return self.capture_beside(scene.clone(), size_px, egui).map(|()| None);
        }
        match self.go_on_in_parts(egui)? {
            CapturePart::Step => self.step_to_capture(scene, size_px),
            CapturePart::Partly => Ok(None),
            CapturePart::Whole(picture, frame) => Ok(Some((picture, *frame))),
        }
    }

    /// For which file the picture is that was asked for first, and how much of it is drawn, 0 to 1, once that has taken a while; `None` if none
    /// was asked for.
    pub(crate) fn capturing(&self) -> Option<(&Path, f64)> {
        let capture = self.captures.front().filter(|capture| capture.asked.elapsed() > LOOK)?;
        let beside = self.drawing.as_ref().filter(|(_, task)| matches!(task, Task::Capture));
        let on_gpu = self.gpu_capture.as_ref().map(GpuCapture::share);
        Some((&capture.path, on_gpu.or(beside.map(|(drawing, _)| drawing.progress())).unwrap_or_default()))
    }

    /// Gives up the picture that was asked for first.
    pub(crate) fn give_up_capture(&mut self) -> Option<PathBuf> {
        let capture = self.captures.pop_front()?;
        self.change(Change::Play(self.playback));
        Some(capture.path)
    }
}
