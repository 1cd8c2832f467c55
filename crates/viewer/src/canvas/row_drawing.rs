//! A frame drawn in parts on a GPU, so paced that the window never waits long; and a picture to be saved, whose samples are such frames. Costs a
//! frame of the window per part.

use super::made::Made;
use super::row_pace::RowPace;
use crate::device::Device;
use brickyard::session::{Drawn, Frame, Session, SessionError};
use brickyard::volume::{Picture, PixelSamples};
use std::sync::Arc;
use std::time::Duration;

/// A frame drawn in parts. Its session may take no other step meanwhile.
pub(super) struct RowDrawing {
    frame: Frame,
    pub(super) pace: RowPace,
}

impl RowDrawing {
    /// A frame to draw. A `share` of it should suit a part; frames of the window take `between`.
    pub(super) fn new(frame: Frame, share: f64, between: Duration) -> Self {
        let pace = RowPace::new(frame.scene.rows(), share, between);
        Self { frame, pace }
    }

    /// Submits a part, unless the previous one is under way or shaders are compiling. Returns the frame once all of it is submitted, ready to be
    /// [put](Session::draw_to) on textures.
    ///
    /// # Errors
    /// As [`Session::draw_rows`].
    pub(super) fn go_on(&mut self, session: &mut Session, device: &Device) -> Result<Option<&Frame>, SessionError> {
        if let Some(rows) = self.pace.next()
            && session.draw_rows(&self.frame, rows.clone())? != Drawn::Nothing
        {
            self.pace.submitted(&rows, device);
        }
        Ok((self.pace.share() >= 1.0).then_some(&self.frame))
    }
}

/// A picture drawn by a GPU for saving: its samples in turn, each in parts and then copied to the CPU.
pub(super) struct GpuCapture {
    frame: Frame,
    samples: PixelSamples,
    /// Share of a sample fit for one part, and the duration of a frame of the window.
    fitting: f64,
    between: Duration,
    made: Arc<Made>,
    /// The sample being drawn; `None` while on its way to the CPU.
    drawing: Option<RowDrawing>,
}

/// Progress of a picture to be saved.
pub(super) enum CapturePart {
    /// More parts are to come.
    Partly,
    /// The streaming step is drawn; its visible bricks may call for more.
    Step,
    Whole(Picture, Box<Frame>),
}

impl GpuCapture {
    /// The remaining samples of a frame's picture. A `share` of a sample should suit a part; frames of the window take `between`.
    pub(super) fn new(frame: Frame, samples: PixelSamples, made: Arc<Made>, share: f64, between: Duration) -> Self {
        if frame.status.settled {
            made.keep_for(&frame);
        }
        let mut capture = Self { frame, samples, fitting: share, between, made, drawing: None };
        capture.begin_sample();
        capture
    }

    fn begin_sample(&mut self) {
        let frame = match self.frame.status.settled {
            true => self.made.next(&self.frame, self.samples),
            false => self.frame.clone(),
        };
        self.drawing = Some(RowDrawing::new(frame, self.fitting, self.between));
    }

    /// Draws the next part of the picture.
    ///
    /// # Errors
    /// As [`Session::draw_rows`].
    pub(super) fn go_on(&mut self, session: &mut Session, device: &Device) -> Result<CapturePart, SessionError> {
        if let Some(drawing) = &mut self.drawing {
            if drawing.go_on(session, device)?.is_none() {
                return Ok(CapturePart::Partly);
            }
            if !self.frame.status.settled {
                return Ok(CapturePart::Step);
            }
            if session.read_back()? {
                self.fitting = drawing.pace.fitting();
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

    /// The pace of the sample; `None` while it is on its way to the CPU.
    pub(super) fn pace(&self) -> Option<&RowPace> {
        self.drawing.as_ref().map(|drawing| &drawing.pace)
    }

    /// The drawn share of the sample.
    pub(super) fn share_of_sample(&self) -> f64 {
        self.pace().map_or(1.0, RowPace::share)
    }
}
