//! A GPU's pictures: those of a moving view are submitted whole; exact and saved ones [in parts](super::row_drawing) if they take longer than a frame
//! of the window. The window's thread makes all submissions.

use super::made::Made;
use super::picture::{Choice, Shown, Wanted};
use super::row_drawing::{CapturePart, GpuCapture, RowDrawing};
use super::row_pace::RowPace;
use super::{Canvas, FrameTimes};
use crate::canvas::drawing::Engine;
use crate::device::Device;
use crate::screen::FORMAT;
use brickyard::render::Target;
use brickyard::session::{Drawn, Frame, SessionError};
use brickyard::volume::{Picture, PixelSamples, Scene};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Pictures in progress, in parts.
#[derive(Default)]
pub(super) struct Parts {
    /// The view's picture.
    pub(super) shown: Option<InRows>,
    /// The picture to be saved.
    pub(super) saved: Option<GpuCapture>,
    /// Share of an exact picture found fit for a part.
    fitting: f64,
}

impl Parts {
    /// Drops both pictures.
    pub(super) fn give_up(&mut self) {
        (self.shown, self.saved) = (None, None);
    }

    /// The pace of the view's picture, or else of the one to be saved.
    pub(super) fn pace(&self) -> Option<&RowPace> {
        self.shown.as_ref().map(InRows::pace).or(self.saved.as_ref().and_then(GpuCapture::pace))
    }
}

/// The view's picture in progress, in parts.
pub(super) enum InRows {
    /// The exact picture of a scene, and the time of its streaming step.
    Show { drawing: RowDrawing, shown: Box<Shown>, step: Duration },
    /// A sample of the shown picture.
    Smooth(RowDrawing),
}

impl InRows {
    pub(super) fn pace(&self) -> &RowPace {
        let (Self::Show { drawing, .. } | Self::Smooth(drawing)) = self;
        &drawing.pace
    }
}

impl Canvas {
    /// Streams a step towards the wanted picture, and draws or starts it.
    ///
    /// # Errors
    /// If it cannot be drawn. The texture stays as it is.
    pub(super) fn show_on_gpu(&mut self, wanted: &Wanted) -> Result<(), SessionError> {
        let Some(engine) = &mut self.engine else { return Ok(()) };
        let Engine { session, control } = &mut **engine;
        let begun = Instant::now();
        let frame = session.step(&wanted.scene, wanted.size_px)?;
        let (step, is_playing) = (begun.elapsed(), session.playback().is_some());
        self.spent.step += step;
        self.pace.stepped = frame.scene.time;
        self.stream = Some((frame.status.clone(), frame.coming.clone()));
        let (wanted, shown) = (wanted.at(&frame), self.shown.as_ref());
        if is_playing && shown.is_some_and(|shown| shown.stands(&wanted, &frame)) {
            self.keep_pace();
            return Ok(());
        }
        let (shown, moved) =
            Choice { control, is_adaptive: self.is_adaptive, is_gradual: false }.next(wanted, frame, shown);
        let share = control.share();
        if !moved && !is_playing && share < 1.0 {
            let drawing = RowDrawing::new(shown.frame.clone(), share, self.between);
            self.parts.shown = Some(InRows::Show { drawing, shown: Box::new(shown), step });
            self.keep_pace();
            return self.draw_rows();
        }
        let begun = Instant::now();
        let drawn = self.draw(&shown.quality.frame(&shown.frame), shown.of.size_px)?;
        if let Some(engine) = &mut self.engine {
            engine.session.gpu_time().into_iter().for_each(|time| engine.control.took(time));
        }
        self.took(FrameTimes { step, draw: begun.elapsed(), ..FrameTimes::default() });
        self.drew(drawn, shown);
        self.keep_pace();
        Ok(())
    }

    /// Draws a frame into the texture of `size_px` pixels, which stays as it is while any place lacks the frame.
    fn draw(&mut self, frame: &Frame, size_px: (u32, u32)) -> Result<Drawn, SessionError> {
        let (Some(screen), Some(engine)) = (&mut self.screen, &mut self.engine) else { return Ok(Drawn::Nothing) };
        let Some(Device { state, .. }) = &self.gpu else { return Ok(Drawn::Nothing) };
        let target = Target { view: screen.sized(size_px), format: FORMAT, area_px: None };
        let mut encoder = state.device.create_command_encoder(&Default::default());
        let is_this = engine.session.draw_to(frame, &target, &mut encoder)?;
        state.queue.submit([encoder.finish()]);
        Ok(match engine.session.shown() {
            _ if is_this => Drawn::Whole,
            Some(shown) if shown.is_copy_of(frame) => Drawn::Partly,
            _ => Drawn::Nothing,
        })
    }

    /// Draws the next part, and shows the picture after the last one.
    ///
    /// # Errors
    /// If the device fails. The texture stays as it is.
    pub(super) fn draw_rows(&mut self) -> Result<(), SessionError> {
        let (Some(engine), Some(device)) = (&mut self.engine, &self.gpu) else { return Ok(()) };
        let Some(mut in_rows) = self.parts.shown.take() else { return Ok(()) };
        let begun = Instant::now();
        let (InRows::Show { drawing, .. } | InRows::Smooth(drawing)) = &mut in_rows;
        let frame = drawing.go_on(&mut engine.session, device)?.cloned();
        self.spent.draw += begun.elapsed();
        let Some(frame) = frame else {
            self.parts.shown = Some(in_rows);
            return Ok(());
        };
        self.parts.fitting = drawing.pace.fitting();
        match in_rows {
            InRows::Smooth(_) => self.add_sample(&frame),
            InRows::Show { drawing, shown, step } => {
                let drawn = self.draw(&frame, shown.of.size_px)?;
                self.took(FrameTimes { step, beside: drawing.pace.since(), ..FrameTimes::default() });
                self.drew(drawn, *shown);
                Ok(())
            }
        }
    }

    /// Draws or starts a sample of the shown picture.
    ///
    /// # Errors
    /// If the device fails. The texture stays as it is.
    pub(super) fn smooth_on_gpu(&mut self, frame: Frame) -> Result<(), SessionError> {
        if self.engine.as_ref().is_some_and(|engine| engine.control.share() < 1.0) {
            self.parts.shown = Some(InRows::Smooth(RowDrawing::new(frame, self.parts.fitting, self.between)));
            return self.draw_rows();
        }
        self.add_sample(&frame)
    }

    /// Draws a sample, if still to be drawn, and adds it to those before.
    fn add_sample(&mut self, frame: &Frame) -> Result<(), SessionError> {
        let Some(Shown { of, samples_left: Some(left), .. }) = &self.shown else { return Ok(()) };
        let (samples, size_px) = (of.scene.pixel_samples, of.size_px);
        let is_first = *left == samples.count();
        let Some(Device { state, .. }) = self.gpu.clone() else { return Ok(()) };
        let (Some(engine), Some(screen)) = (&mut self.engine, &mut self.screen) else { return Ok(()) };
        let begun = Instant::now();
        let target = Target { view: screen.sample(size_px), format: FORMAT, area_px: None };
        let mut encoder = state.device.create_command_encoder(&Default::default());
        let is_drawn = engine.session.draw_to(frame, &target, &mut encoder)?;
        if is_drawn {
            screen.add_sample(&mut encoder, is_first, samples);
        }
        state.queue.submit([encoder.finish()]);
        self.spent.draw += begun.elapsed();
        if is_drawn {
            self.count_sample();
        }
        Ok(())
    }

    /// Draws the next part of a picture to be saved.
    ///
    /// # Errors
    /// If it cannot be drawn.
    pub(super) fn go_on_in_parts(&mut self) -> Result<CapturePart, SessionError> {
        let (Some(engine), Some(device)) = (&mut self.engine, &self.gpu) else { return Ok(CapturePart::Step) };
        let Some(mut capture) = self.parts.saved.take() else { return Ok(CapturePart::Step) };
        let part = capture.go_on(&mut engine.session, device)?;
        if matches!(part, CapturePart::Partly) {
            self.parts.saved = Some(capture);
        }
        Ok(part)
    }

    /// Streams a step towards a picture to be saved, and starts it once its bricks are resident. A stereo picture is drawn at once, and returned.
    ///
    /// # Errors
    /// If it cannot be drawn.
    pub(super) fn step_to_capture(
        &mut self,
        scene: &Scene,
        made: Arc<Made>,
        size_px: (u32, u32),
    ) -> Result<Option<(Picture, Frame)>, SessionError> {
        let Some(engine) = &mut self.engine else { return Ok(None) };
        let session = &mut engine.session;
        // The picture is of its scene's time step.
        session.play(None);
        let frame = session.step(scene, size_px)?;
        if !(frame.status.settled || frame.status.awaits_feedback) {
            return Ok(None);
        }
        let samples = scene.pixel_samples;
        if scene.stereo.is_none() {
            let pixels = |(width, height): (u32, u32)| f64::from(width) * f64::from(height);
            let shown = self.shown.as_ref().map_or(size_px, |shown| shown.of.size_px);
            let share = self.parts.fitting * (pixels(shown) / pixels(size_px)).min(1.0);
            self.parts.saved = Some(GpuCapture::new(frame, samples, made, share, self.between));
            return Ok(None);
        }
        let picture = match samples {
            samples if samples != PixelSamples::ONE && frame.status.settled => {
                samples.picture(|sample| session.draw(&frame.of_sample(sample)))?
            }
            _ => session.draw(&frame)?,
        };
        // Drawing reports visible bricks, so more may be wanted.
        Ok(frame.status.settled.then_some((picture, frame)))
    }
}
