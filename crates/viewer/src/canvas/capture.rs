//! Pictures to be saved: requested, drawn in turn while the view rests, and handed over once final. A changing view comes first: an interrupted
//! picture keeps its samples, and on the CPU its tiles.

use super::made::Made;
use super::row_drawing::{CapturePart, GpuCapture};
use super::{Canvas, Change, LOOK};
use crate::marks::Over;
use brickyard::session::{Frame, Painting, Session, SessionError};
use brickyard::stats::RenderStats;
use brickyard::volume::{Picture, Scene};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

/// A picture to be saved.
pub(super) struct Capture {
    scene: Scene,
    /// `None` is the view's size at the start of drawing.
    size_px: Option<(u32, u32)>,
    path: PathBuf,
    over: Over,
    asked: Instant,
    made: Arc<Made>,
    /// The final picture, not yet asked for.
    drawn: Option<(Picture, Frame)>,
}

/// Draws the rest of a picture whose frame has all its bricks.
pub(super) fn go_on(
    session: &mut Session,
    frame: &Frame,
    scene: &Scene,
    made: &Made,
    painting: &Arc<Painting>,
) -> Result<Picture, SessionError> {
    let samples = scene.pixel_samples;
    made.keep_for(frame);
    loop {
        if let Some(picture) = made.whole(samples) {
            return Ok(picture);
        }
        let (_, tiles) = made.drawn();
        // Two eyes have two pictures.
        painting.go_on_with(scene.stereo.is_none().then_some(tiles));
        made.add(&session.paint(&made.next(frame, samples), painting)?);
    }
}

/// A final picture to save, with its frame.
pub(crate) struct Captured {
    pub(crate) path: PathBuf,
    pub(crate) picture: Picture,
    /// The scene with every choice made.
    pub(crate) scene: Scene,
    pub(crate) stats: RenderStats,
    pub(crate) over: Over,
}

impl Canvas {
    /// Requests a picture of a scene; `None` is the shown size.
    pub(crate) fn capture(&mut self, scene: Scene, size_px: Option<(u32, u32)>, path: PathBuf, over: Over) {
        let (asked, made) = (Instant::now(), Arc::default());
        self.captures.push_back(Capture { scene, size_px, path, over, asked, made, drawn: None });
    }

    /// Whether a requested picture is still to come.
    pub(crate) fn is_capturing(&self) -> bool {
        !self.captures.is_empty()
    }

    /// Whether a requested picture is being drawn.
    pub(crate) fn saves(&self) -> bool {
        self.is_capturing() && !self.gives_way
    }

    /// Restarts all pictures after a change of volumes.
    pub(super) fn forget_captures(&mut self) {
        self.captures.iter_mut().for_each(|capture| (capture.made, capture.drawn) = (Arc::default(), None));
    }

    /// Keeps the final picture of the first request until it is asked for.
    pub(super) fn keep_capture(&mut self, picture: Picture, frame: Frame) {
        if let Some(capture) = self.captures.front_mut() {
            capture.drawn = Some((picture, frame));
        }
    }

    /// Continues the first requested picture while the view rests, and returns it once final.
    ///
    /// # Errors
    /// If it cannot be drawn; it is given up then, unless another device may draw it.
    pub(crate) fn captured(&mut self, size_px: (u32, u32)) -> Result<Option<Captured>, SessionError> {
        let Some(capture) = self.captures.front_mut().filter(|_| !self.gives_way) else { return Ok(None) };
        let size_px = *capture.size_px.get_or_insert(size_px);
        let scene = capture.scene.clone();
        self.parts.shown = None;
        let drawn = self.arrive().and_then(|()| self.go_on_with_capture(&scene, size_px));
        // The session's slots belong to another picture now.
        self.shown.iter_mut().for_each(|shown| shown.samples_left = None);
        let is_over = match &drawn {
            Ok(drawn) => drawn.is_some(),
            Err(_) => !self.is_lost(),
        };
        let Some(Capture { scene, path, over, .. }) = self.captures.pop_front_if(|_| is_over) else {
            return drawn.map(|_| None);
        };
        self.tell(Change::Play(self.pace.playback));
        let Some((picture, frame)) = drawn? else { return Ok(None) };
        let mut stats = RenderStats::default();
        stats.record(&frame.status, self.memory_bytes().0);
        Ok(Some(Captured { path, picture, scene: frame.scene.shown(&scene), stats, over }))
    }

    fn go_on_with_capture(
        &mut self,
        scene: &Scene,
        size_px: (u32, u32),
    ) -> Result<Option<(Picture, Frame)>, SessionError> {
        let Some(capture) = self.captures.front_mut() else { return Ok(None) };
        if let Some(drawn) = capture.drawn.take() {
            return Ok(Some(drawn));
        }
        let made = capture.made.clone();
        if self.gpu.is_none() {
            return self.capture_beside(scene.clone(), made, size_px).map(|()| None);
        }
        match self.go_on_in_parts()? {
            CapturePart::Step => self.step_to_capture(scene, made, size_px),
            CapturePart::Partly => Ok(None),
            CapturePart::Whole(picture, frame) => Ok(Some((picture, *frame))),
        }
    }

    /// The first requested picture's file and drawn share, 0 to 1, once it takes long; `None` without one.
    pub(crate) fn capturing(&self) -> Option<(&Path, f64)> {
        let capture = self.captures.front().filter(|capture| capture.asked.elapsed() > LOOK)?;
        let (samples, tiles) = capture.made.drawn();
        let of_sample = self.parts.saved.as_ref().map(GpuCapture::share_of_sample);
        let of_sample = of_sample.unwrap_or_else(|| capture.size_px.map_or(0.0, |size_px| tiles.share(size_px)));
        Some((&capture.path, (samples as f64 + of_sample) / capture.scene.pixel_samples.count() as f64))
    }

    /// Gives up the first requested picture.
    pub(crate) fn give_up_capture(&mut self) -> Option<PathBuf> {
        let capture = self.captures.pop_front()?;
        self.tell(Change::Play(self.pace.playback));
        Some(capture.path)
    }
}
