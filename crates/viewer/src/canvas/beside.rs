//! The CPU's pictures, drawn [beside the window](super::drawing): requested, watched, abandoned when outdated, and taken in.

use super::capture;
use super::drawing::{Begun, Done, Drawing, Engine, Home, News, Stage};
use super::made::Made;
use super::picture::{Choice, Shown, Wanted};
use super::{Canvas, Change, FrameTimes, LOOK, STREAMING_STEP};
use brickyard::frame_governor::{Quality, QualityControl};
use brickyard::pager::Status;
use brickyard::session::{Drawn, Frame, Painting, Session, SessionError};
use brickyard::volume::{Picture, Scene};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Longest time for a coarse picture of an outdated view: during a drag, none would finish within a frame.
const LATE: Duration = Duration::from_millis(600);

/// Longest wait for the few bricks of a moving view.
const FOR_COARSE_BRICKS: Duration = Duration::from_millis(30);

/// The work of a session away from home.
pub(super) enum Task {
    /// The wanted picture, or a coarser one.
    Show(Box<Wanted>),
    /// A sample of the shown picture's pixels.
    Smooth,
    /// The first requested picture.
    Capture,
}

/// A request for the picture of a scene.
struct Order {
    wanted: Wanted,
    /// The shown picture, and its pixels, visible until covered by the next one.
    shown: Option<Shown>,
    under: Option<Arc<Picture>>,
    /// Longest frame, and the window's own part of it.
    goal: (Duration, Duration),
    is_adaptive: bool,
}

impl Order {
    /// Streams until a better picture than the shown one is possible, and draws it.
    fn run(self, Engine { session, control }: &mut Engine, stage: &Stage) -> Result<Done, SessionError> {
        let (goal, between) = self.goal;
        loop {
            control.set_goal(session.drawing_time(goal, between));
            let begun = Instant::now();
            let frame = self.step(session, control)?;
            let step = begun.elapsed();
            let wanted = self.wanted.at(&frame);
            let is_playing = session.playback().is_some();
            let is_streaming = !(frame.status.settled || frame.status.awaits_feedback);
            let before = self.shown.as_ref().filter(|shown| shown.is_of(&wanted));
            let stands = before.is_some_and(|before| match is_playing {
                true => before.stands(&wanted, &frame),
                false => is_streaming && before.suffices(control.share()),
            });
            if stage.painting.is_abandoned() || stands || session.shows_before(&frame) {
                stage.tell(session, &frame, None);
                if stage.painting.is_abandoned() {
                    return Ok(Done::Nothing);
                }
                session.wait(STREAMING_STEP);
                continue;
            }
            let choice = Choice { control, is_adaptive: self.is_adaptive, is_gradual: true };
            let (shown, _) = choice.next(wanted, frame, self.shown.as_ref());
            // A picture drawn only to find its bricks never replaces a better one.
            let is_worse = before.is_some_and(|before| before.quality.share() > shown.quality.share());
            let begun = Instant::now();
            let news = Begun { quality: shown.quality, is_of_motion: before.is_none(), at: begun };
            stage.tell(session, &shown.frame, (is_playing || !is_worse).then_some(news));
            if let Some(under) = self.under.as_ref().filter(|_| shown.quality == Quality::EXACT) {
                stage.painting.lay_under(Picture::clone(under));
            }
            let picture = session.paint(&shown.quality.frame(&shown.frame), &stage.painting)?;
            if is_worse && !is_playing {
                continue;
            }
            let beside = begun.elapsed();
            control.took(beside);
            let times = FrameTimes { step, beside, ..FrameTimes::default() };
            return Ok(Done::Picture { picture, shown: Box::new(shown), times });
        }
    }

    /// Takes a streaming step. For a moving or new view it aims at bricks as coarse as the pixels, and waits a little for them.
    fn step(&self, session: &mut Session, control: &QualityControl) -> Result<Frame, SessionError> {
        let Wanted { scene, size_px, .. } = &self.wanted;
        let moves = self.shown.as_ref().is_none_or(|shown| !shown.is_of(&self.wanted));
        let is_coarse = self.is_adaptive && moves && session.playback().is_none();
        let level_bias = if is_coarse { control.level_bias() } else { 0.0 };
        let begun = Instant::now();
        loop {
            let frame = session.step_coarse(scene, *size_px, level_bias)?;
            let Status { resident, wanted, pixel_error, .. } = frame.status;
            let is_there = resident == wanted && pixel_error == scene.pixel_error * level_bias.exp2();
            if level_bias == 0.0 || is_there || begun.elapsed() > FOR_COARSE_BRICKS {
                return Ok(frame);
            }
            session.wait(FOR_COARSE_BRICKS);
        }
    }
}

/// Streams until a scene's picture is final, and draws its rest.
fn capture(
    session: &mut Session,
    scene: &Scene,
    made: &Made,
    size_px: (u32, u32),
    painting: &Arc<Painting>,
) -> Result<Done, SessionError> {
    // The picture is of its scene's time step.
    session.play(None);
    loop {
        let frame = session.step(scene, size_px)?;
        if painting.is_abandoned() {
            return Ok(Done::Nothing);
        }
        match (frame.status.settled, frame.status.awaits_feedback) {
            (false, false) => {
                session.wait(STREAMING_STEP);
            }
            (false, true) => {
                // Drawing reports visible bricks, so more may be wanted.
                session.paint(&frame, painting)?;
            }
            (true, _) => {
                let picture = capture::go_on(session, &frame, scene, made, painting)?;
                return Ok(Done::Capture(picture, Box::new(frame)));
            }
        }
    }
}

fn eyes(scene: &Scene) -> u32 {
    1 + u32::from(scene.stereo.is_some())
}

impl Canvas {
    /// Sends the session towards the wanted picture.
    ///
    /// # Errors
    /// If no thread can be started.
    pub(super) fn show_beside(&mut self, wanted: Wanted) -> Result<(), SessionError> {
        let order = Order {
            wanted: wanted.clone(),
            shown: self.shown.clone(),
            // One eye's picture is no part of a stereo view.
            under: self.picture.clone().filter(|_| eyes(&wanted.scene) == 1),
            goal: (self.goal, self.between),
            is_adaptive: self.is_adaptive,
        };
        let painting = Painting::new(wanted.size_px, eyes(&wanted.scene));
        self.leave(Task::Show(Box::new(wanted)), painting, |engine, stage| order.run(engine, stage))
    }

    /// Sends the session to draw a sample of the shown picture.
    ///
    /// # Errors
    /// If no thread can be started.
    pub(super) fn smooth_beside(&mut self, frame: Frame, size_px: (u32, u32)) -> Result<(), SessionError> {
        let painting = Painting::new(size_px, frame.scene.eyes() as u32);
        self.leave(Task::Smooth, painting, move |engine, stage| {
            let begun = Instant::now();
            let picture = engine.session.paint(&frame, &stage.painting)?;
            Ok(Done::Sample(picture, begun.elapsed()))
        })
    }

    /// Sends the session, once home, to draw a picture for saving.
    ///
    /// # Errors
    /// If no thread can be started.
    pub(super) fn capture_beside(
        &mut self,
        scene: Scene,
        made: Arc<Made>,
        size_px: (u32, u32),
    ) -> Result<(), SessionError> {
        match &self.drawing {
            Some((_, Task::Capture)) => return Ok(()),
            Some((drawing, _)) => {
                drawing.painting().abandon();
                return Ok(());
            }
            None => {}
        }
        let painting = Painting::new(size_px, eyes(&scene));
        self.leave(Task::Capture, painting, move |engine, stage| {
            capture(&mut engine.session, &scene, &made, size_px, &stage.painting)
        })
    }

    /// Sends the session beside the window, with all pending changes.
    fn leave(
        &mut self,
        task: Task,
        painting: Painting,
        draw: impl FnOnce(&mut Engine, &Stage) -> Result<Done, SessionError> + Send + 'static,
    ) -> Result<(), SessionError> {
        let Some(screen) = &self.screen else { return Ok(()) };
        let Some(engine) = self.engine.take() else { return Ok(()) };
        let changes = std::mem::take(&mut self.changes);
        let draw = |engine: &mut Engine, stage: &Stage| {
            changes.into_iter().for_each(|change| change.apply(&mut engine.session));
            draw(engine, stage)
        };
        match Drawing::begin(engine, painting, screen.device.egui.clone(), draw) {
            Ok(drawing) => {
                self.drawing = Some((drawing, task));
                Ok(())
            }
            Err(error) => {
                let session = Session::new(self.known.volumes.clone(), self.options);
                let control = QualityControl::new(self.goal);
                self.engine = Some(Box::new(Engine { session, control }));
                self.changes = vec![Change::Play(self.pace.playback)];
                Err(SessionError::NoThread(error))
            }
        }
    }

    /// Takes in the session's report, and the session itself, if due, with its picture.
    ///
    /// # Errors
    /// If it could not be drawn.
    pub(super) fn arrive(&mut self) -> Result<(), SessionError> {
        // The last report precedes the end.
        let is_over = self.drawing.as_ref().is_some_and(|(drawing, _)| drawing.is_over());
        self.hear();
        let Some((drawing, task)) = self.drawing.take_if(|_| is_over) else { return Ok(()) };
        let is_abandoned = drawing.painting().is_abandoned();
        let Some(Home { engine, done }) = drawing.end() else { return Ok(()) };
        (self.engine, self.looked) = (Some(engine), None);
        if !matches!(task, Task::Capture) {
            self.keep_pace();
        }
        // An abandoned picture is no error; a finished one is outdated all the same.
        let done = if is_abandoned { Ok(Done::Nothing) } else { done };
        if !matches!((&task, &done), (Task::Smooth, _) | (_, Ok(Done::Picture { .. }))) {
            // The session's slots no longer hold the picture's bricks.
            self.shown
                .iter_mut()
                .filter(|shown| shown.samples_left != Some(0))
                .for_each(|shown| shown.samples_left = None);
        }
        let done = done?;
        let Some(screen) = &mut self.screen else { return Ok(()) };
        match done {
            Done::Nothing => {}
            Done::Capture(picture, frame) => self.keep_capture(picture, *frame),
            Done::Sample(picture, took) => {
                let Some(Shown { of, samples_left: Some(left), .. }) = &self.shown else { return Ok(()) };
                screen.add(&picture, *left == of.scene.pixel_samples.count());
                self.count_sample();
                self.spent.beside += took;
            }
            Done::Picture { picture, shown, times } => {
                screen.put(&picture, (picture.width, picture.height) != shown.of.size_px);
                self.picture = Some(Arc::new(picture));
                self.took(times);
                self.drew(Drawn::Whole, *shown);
            }
        }
        Ok(())
    }

    /// Takes in the session's last report.
    fn hear(&mut self) {
        let Some((drawing, task)) = &mut self.drawing else { return };
        let Some(News { mut known, frame, .. }) = drawing.hear() else { return };
        if let Task::Show(wanted) = task {
            **wanted = wanted.at(&frame);
        }
        // Volumes not yet passed on stay the requested ones.
        if self.changes.iter().any(|change| matches!(change, Change::Volumes(_))) {
            known.volumes = std::mem::take(&mut self.known.volumes);
        }
        if frame.level_bias > 0.0 {
            // A moving view is coarse for a moment.
            known.doubtful = std::mem::take(&mut self.known.doubtful);
        }
        self.known = known;
        self.pace.stepped = frame.scene.time;
        self.stream = Some((frame.status, frame.coming));
    }

    /// While the session is away: abandons unwanted work, unless nearly done, and shows the picture so far.
    pub(super) fn look_on(&mut self, wanted: &Wanted) {
        let Some((drawing, task)) = &self.drawing else { return };
        let shown = self.shown.as_ref().filter(|shown| shown.is_of(wanted));
        let (is_wanted, is_brief) = match (task, drawing.begun()) {
            // A moving view is drawn coarse; the first step decides whether it moves.
            (Task::Show(of), None) => (of.is_as(wanted), drawing.is_in_first_step()),
            (Task::Show(of), Some(Begun { quality, is_of_motion, at })) => {
                (of.is_as(wanted), is_of_motion && quality != Quality::EXACT && at.elapsed() < LATE)
            }
            (Task::Smooth, _) => (shown.is_some(), false),
            (Task::Capture, _) => (false, false),
        };
        if !is_wanted {
            if !is_brief {
                drawing.painting().abandon();
            }
            return;
        }
        let Some(begun) = drawing.begun().filter(|begun| begun.quality == Quality::EXACT) else { return };
        let is_due = begun.at.elapsed() > LOOK && self.looked.is_none_or(|looked| looked.elapsed() > LOOK);
        // Only over a picture of the same scene and time step.
        if is_due && shown.is_some_and(|shown| shown.frame.scene.time == self.pace.stepped) {
            let so_far = drawing.painting().so_far();
            if !so_far.rgb.is_empty() {
                let is_stretched = (so_far.width, so_far.height) != wanted.size_px;
                self.screen.iter_mut().for_each(|screen| screen.put(&so_far, is_stretched));
            }
            self.looked = Some(Instant::now());
        }
    }
}
