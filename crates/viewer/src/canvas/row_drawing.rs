//! A frame that a GPU draws in parts, paced so that the window waits for none of them long; and a picture that is saved, whose samples are such
//! frames. Costs a frame of the window for each part.

use super::made::Made;
use super::row_pace::RowPace;
use crate::device::Device;
use brickyard::session::{Drawn, Frame, Session, SessionError};
use brickyard::volume::{Picture, PixelSamples};
use eframe::egui::Context;
use std::sync::Arc;
use std::time::Duration;

/// A frame that is being drawn in parts. There must be no other step of its session meanwhile.
pub(super) struct RowDrawing {
    frame: Frame,
    pace: RowPace,
}

impl RowDrawing {
    /// A frame of which nothing is drawn yet, a `share` of which is taken to be fit for a part, if frames of the window take so long `between` parts.
    pub(super) fn new(frame: Frame, share: f64, between: Duration) -> Self {
        let pace = RowPace::new(frame.scene.rows(), share, between);
        Self { frame, pace }
    }

    /// Submits a part, unless the one before is under way or shaders are compiled. Returns the frame once all of it is submitted, so that it can be
    /// [put](Session::draw_to) on textures.
    ///
    /// # Errors
    /// As [`Session::draw_rows`].
    pub(super) fn go_on(
        &mut self,
        session: &mut Session,
        device: &Device,
        egui: &Context,
    ) -> Result<Option<&Frame>, SessionError> {
        if let Some(rows) = self.pace.next()
            && session.draw_rows(&self.frame, rows.clone())? != Drawn::Nothing
        {
            self.pace.submitted(&rows, (&device.state.device, &device.state.queue), egui);
        }
        Ok((self.share() >= 1.0).then_some(&self.frame))
    }

    /// The share of the frame that is submitted.
    pub(super) fn share(&self) -> f64 {
        self.pace.share()
    }

    /// The share of it that has turned out to be fit for a part.
    pub(super) fn fitting(&self) -> f64 {
        self.pace.fitting()
    }

    /// Whether a part is under way, after which the window is painted again.
    pub(super) fn is_under_way(&self) -> bool {
        self.pace.is_under_way()
    }

    /// Since when it is drawn.
    pub(super) fn since(&self) -> Duration {
        self.pace.since()
    }
}

/// A picture that a GPU draws to be saved: its samples one after the other, each in parts and then brought to the CPU.
pub(super) struct GpuCapture {
    frame: Frame,
    samples: PixelSamples,
    /// The share of a sample that is fit for a part, and how long frames of the window take between parts.
    fitting: f64,
    between: Duration,
    made: Arc<Made>,
    /// The sample that is being drawn; `None` while it is on its way to the CPU.
    drawing: Option<RowDrawing>,
}

/// Parts of a picture that is to be saved.
pub(super) enum CapturePart {
    /// Some.
    Partly,
    /// All that the step of streaming has; what was seen in it may ask for more.
    Step,
    /// The picture, and its frame.
    Whole(Picture, Box<Frame>),
}

impl GpuCapture {
    /// The samples of a frame's picture still to be drawn, of so many a pixel. A `share` of a sample is taken to be fit for a part, if frames of the window take so
    /// long `between` parts.
    pub(super) fn new(frame: Frame, (samples, made): (PixelSamples, Arc<Made>), share: f64, between: Duration) -> Self {
        if frame.status.settled {
            made.keep_for(&frame);
        }
        let mut capture = Self { frame, samples, fitting: share, between, made, drawing: None };
        capture.begin_sample();
        capture
    }

    fn begin_sample(&mut self) {
        let (done, _) = self.made.drawn();
        let sample = self.samples.samples().nth(done).filter(|_| self.frame.status.settled);
        let frame = match sample.filter(|_| self.samples != PixelSamples::ONE) {
            Some(sample) => self.frame.of_sample(sample),
            None => self.frame.clone(),
        };
        self.drawing = Some(RowDrawing::new(frame, self.fitting, self.between));
    }

    /// Goes on with the picture.
    ///
    /// # Errors
    /// As [`Session::draw_rows`].
    pub(super) fn go_on(
        &mut self,
        session: &mut Session,
        device: &Device,
        egui: &Context,
    ) -> Result<CapturePart, SessionError> {
        if let Some(drawing) = &mut self.drawing {
            if drawing.go_on(session, device, egui)?.is_none() {
                return Ok(CapturePart::Partly);
            }
            if !self.frame.status.settled {
                return Ok(CapturePart::Step);
            }
            if session.read_back()? {
                self.fitting = drawing.fitting();
                self.drawing = None;
            }
            return Ok(CapturePart::Partly);
        }
        let Some(picture) = session.picture()? else { return Ok(CapturePart::Partly) };
        self.made.add(&picture);
        if let Some(picture) = self.made.whole(self.samples) {
            return Ok(CapturePart::Whole(picture, Box::new(self.frame.clone())));
        }
        self.begin_sample();
        Ok(CapturePart::Partly)
    }

    /// The sample that is being drawn, if one is.
    pub(super) fn drawing(&self) -> Option<&RowDrawing> {
        self.drawing.as_ref()
    }

    /// The share of the sample that is drawn.
    pub(super) fn share_of_sample(&self) -> f64 {
        self.drawing.as_ref().map_or(1.0, RowDrawing::share)
    }
}
