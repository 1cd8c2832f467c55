//! The picture in the window: a live session draws the scene into a texture, on the window's own device or [beside the window](crate::drawing) on the CPU, at the
//! quality that the hand's pace allows. At rest it is drawn once more, exactly, and then sample by sample until it is smooth, and then not again. A picture on the
//! CPU that nobody waits for any more is abandoned. Costs one step for each frame of the window, and on a GPU at most one drawing.

use crate::device::Device;
use crate::drawing::{Drawing, Home, Known};
use crate::marks::Over;
use crate::row_drawing::{self, GpuCapture, RowDrawing};
use crate::screen::{FORMAT, Screen};
use brickyard::backend::BackendChoice;
use brickyard::doubtful_extremes::DoubtfulExtremes;
use brickyard::frame_governor::{Change, Quality, QualityControl};
use brickyard::pager::{DrawList, Playback, Status};
use brickyard::render::{Gpu, Target};
use brickyard::session::{
    ComingStep, Drawn, Frame, Painting, ResolvedScene, Session, SessionError, SessionOptions, VolumeSource, check,
};
use brickyard::stats::RenderStats;
use brickyard::volume::{Picture, PixelSamples, Scene, SceneError};
use eframe::egui::{self, Painter, Rect};
use eframe::egui_wgpu::RenderState;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Nothing is seen where nothing is drawn yet.
const NO_PICTURE: Picture = Picture { width: 0, height: 0, rgb: Vec::new() };

/// How many frames' times are kept.
const FRAMES: usize = 240;

/// How long a picture of a moving view may be drawn that is not of the view any more.
const LATE: Duration = Duration::from_millis(150);

/// How often what is drawn of a picture is shown.
const LOOK: Duration = Duration::from_millis(150);

/// How often the window looks whether bricks have come.
pub(crate) const STREAMING_STEP: Duration = Duration::from_millis(8);

/// How soon, and how often later, the window shows how far pictures are that are drawn beside it. Each frame of the window takes time from them: a picture
/// of 0.2 s is drawn without one.
const DRAWING_STEPS: [Duration; 2] = [Duration::from_millis(200), Duration::from_millis(500)];

/// A session and the texture that shows its picture.
pub(crate) struct Canvas {
    /// The session while it is at home; `None` while it draws beside the window.
    session: Option<Box<Session>>,
    /// What it draws there.
    drawing: Option<(Drawing, Task)>,
    /// What it draws in parts on a GPU, and the picture that it draws there to be saved.
    in_rows: Option<InRows>,
    gpu_capture: Option<GpuCapture>,
    /// The share of an exact picture that was fit for a part of one, and how long frames of the window take between parts.
    fitting: f64,
    between: Duration,
    /// The session's options.
    options: SessionOptions,
    /// The last picture from the CPU, and when it, or a part of the next one, was shown.
    picture: Option<Picture>,
    looked: Option<Instant>,
    /// Where the picture is seen; `None` as long as the window has no device.
    screen: Option<Screen>,
    /// The window's device, if the session draws there and not on the CPU.
    gpu: Option<Device>,
    control: QualityControl,
    /// Whether the picture is drawn coarser while the view moves.
    pub(crate) is_adaptive: bool,
    /// How time steps are played, as the session was told.
    playback: Option<Playback>,
    pace: Pace,
    shown: Option<Shown>,
    /// How far the last step of streaming was, and which time steps come next; `None` before the first one.
    stream: Option<(Status, Vec<ComingStep>)>,
    /// What the last frames took, oldest first.
    times: VecDeque<FrameTimes>,
    /// What they took since that was last asked.
    spent: FrameTimes,
    /// When the scene was changed of which there is no picture yet, and the scene that was shown then; and how long others took.
    asked: Option<(Instant, Box<Scene>)>,
    answers: Vec<Duration>,
    captures: VecDeque<Capture>,
}

/// What a frame took.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FrameTimes {
    /// Streaming: taking in bricks, planning, uploading.
    pub(crate) step: Duration,
    /// Recording what a GPU draws.
    pub(crate) draw: Duration,
    /// Drawing beside the window, on the CPU or in parts on a GPU.
    pub(crate) beside: Duration,
}

impl FrameTimes {
    /// What drawing took, wherever.
    pub(crate) fn drawing(&self) -> Duration {
        self.draw + self.beside
    }

    /// What both took.
    pub(crate) fn and(self, other: Self) -> Self {
        Self { step: self.step + other.step, draw: self.draw + other.draw, beside: self.beside + other.beside }
    }
}

/// Which time step a session is at, and is asked for: as it was with the picture that is shown. A session that draws is ahead of that.
#[derive(Default)]
struct Pace {
    is_playing: bool,
    is_seeking: bool,
    /// The step of the session's last frame, and the one that it was asked for.
    stepped: u32,
    asked: u32,
    /// Whether another one is asked for.
    is_jump: bool,
}

/// What a session draws beside the window.
enum Task {
    /// The picture of a scene, or one that is coarser.
    Show { shown: Box<Shown>, step: Duration },
    /// A sample of the pixels of the picture that is shown.
    Smooth,
    /// The picture that was asked for first, with its frame.
    Capture(Box<Frame>),
}

/// A picture that is to be written once it is final.
struct Capture {
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

/// A picture in the making that a GPU draws in parts.
enum InRows {
    /// The exact picture of a scene; and what its step of streaming took.
    Show { drawing: RowDrawing, shown: Box<Shown>, step: Duration },
    /// A sample of the pixels of the picture that is shown.
    Smooth(RowDrawing),
}

/// What the texture shows.
struct Shown {
    scene: Scene,
    size_px: (u32, u32),
    frame: Frame,
    quality: Quality,
    /// How many of its pixels' samples are still to be drawn; 0 if the picture is as it will stay. `None` before it has all bricks and every pixel.
    samples_left: Option<usize>,
}

impl Canvas {
    /// Makes a session of volumes, on the window's device unless there is none, the options say the CPU, or leave the choice and the device is a software one.
    ///
    /// # Errors
    /// If the device lacks what the engine needs.
    pub(crate) fn new(
        volumes: Vec<VolumeSource>,
        options: &SessionOptions,
        device: Option<&Device>,
    ) -> Result<Self, SessionError> {
        let options = SessionOptions { live: true, ..*options };
        let gpu_device = device.filter(|device| draws_volumes(device, &options));
        let on_cpu = SessionOptions { backend: BackendChoice::Cpu, ..options };
        let (session, options) = match gpu_device {
            Some(device) => (Session::on_gpu(volumes, options, gpu(device)?), options),
            None => (Session::new(volumes, on_cpu), on_cpu),
        };
        Ok(Self {
            session: Some(Box::new(session)),
            drawing: None,
            in_rows: None,
            gpu_capture: None,
            fitting: 0.0,
            between: Duration::ZERO,
            options,
            picture: None,
            looked: None,
            screen: device.map(|device| Screen::new(&device.state)),
            gpu: gpu_device.cloned(),
            control: QualityControl::new(Duration::from_millis(50)),
            is_adaptive: true,
            playback: None,
            pace: Pace::default(),
            shown: None,
            stream: None,
            times: VecDeque::new(),
            spent: FrameTimes::default(),
            asked: None,
            answers: Vec::new(),
            captures: VecDeque::new(),
        })
    }

    /// Goes on with another device of the window's. Pictures that were asked for are still to come. What is decoded stays unless the CPU takes the place of a
    /// GPU, or the other way round.
    ///
    /// # Errors
    /// If the device lacks what the engine needs.
    pub(crate) fn set_device(&mut self, options: &SessionOptions, device: &Device) -> Result<(), SessionError> {
        match (&mut self.gpu, draws_volumes(device, options)) {
            (None, false) => {}
            (Some(known), true) => {
                *known = device.clone();
                self.home().set_gpu(gpu(device)?);
            }
            _ => {
                let captures = std::mem::take(&mut self.captures);
                *self = Self { captures, ..Self::new(self.volumes().to_vec(), options, Some(device))? };
            }
        }
        (self.screen, self.shown, self.in_rows, self.gpu_capture) =
            (Some(Screen::new(&device.state)), None, None, None);
        Ok(())
    }

    /// Begins anew with other volumes. The picture before is seen until there is one of them.
    ///
    /// # Errors
    /// If the device lacks what the engine needs.
    pub(crate) fn begin_anew(
        &mut self,
        volumes: Vec<VolumeSource>,
        options: &SessionOptions,
        device: Option<&Device>,
    ) -> Result<(), SessionError> {
        let anew = Self::new(volumes, options, device)?;
        let before = std::mem::replace(self, anew);
        self.screen = before.screen;
        Ok(())
    }

    /// Goes on with later states of the volumes.
    pub(crate) fn set_volumes(&mut self, volumes: Vec<VolumeSource>) {
        self.home().set_volumes(volumes);
        self.shown.iter_mut().for_each(|shown| shown.samples_left = None);
    }

    /// Whether the device is lost on which the picture is drawn.
    fn is_lost(&self) -> bool {
        self.gpu.as_ref().is_some_and(|device| device.lost().is_some())
    }

    /// Whether the CPU draws the picture.
    pub(crate) fn draws_on_cpu(&self) -> bool {
        self.gpu.is_none()
    }

    /// Sets how long a frame of the window may take while the picture changes, `between` of it for the window itself.
    pub(crate) fn set_frame_goal(&mut self, goal: Duration, between: Duration) {
        self.between = between;
        // A GPU's own work for a picture is part of the time between frames.
        let between = if self.gpu.is_some() { Duration::ZERO } else { between };
        if let Some(session) = &self.session {
            self.control.set_goal(session.drawing_time(goal, between));
        }
    }

    /// Goes on within other limits of memory, in bytes: of slots, tables and targets, and of decoded bricks.
    pub(crate) fn set_budgets(&mut self, backend_bytes: u64, host_memory_bytes: u64) {
        let SessionOptions { gpu_memory_bytes, cpu_memory_bytes, host_memory_bytes: host, .. } = self.options;
        if (gpu_memory_bytes, cpu_memory_bytes, host) == (backend_bytes, backend_bytes, host_memory_bytes) {
            return;
        }
        (self.options.gpu_memory_bytes, self.options.cpu_memory_bytes) = (backend_bytes, backend_bytes);
        self.options.host_memory_bytes = host_memory_bytes;
        if self.home().set_budgets(backend_bytes, host_memory_bytes) {
            self.shown.iter_mut().for_each(|shown| shown.samples_left = None);
        }
    }

    /// Asks for a picture of a scene, which is drawn as soon as it is final. `None` is the size in which the picture is shown.
    pub(crate) fn capture(&mut self, scene: Scene, size_px: Option<(u32, u32)>, (path, over): (PathBuf, Over)) {
        self.captures.push_back(Capture { scene, size_px, path, over, asked: Instant::now() });
    }

    /// Whether a picture that was asked for has not come yet.
    pub(crate) fn is_capturing(&self) -> bool {
        !self.captures.is_empty()
    }

    /// Streams a step towards the picture that was asked for first, while the texture stays as it is, and returns the picture once it is final.
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
        let drawn = match self.drawing.take_if(|(drawing, _)| drawing.is_over()) {
            Some((drawing, task)) => self.arrive(drawing, task),
            None => match self.go_on_with_capture(egui) {
                Ok(None) => self.step_to_capture(&scene, size_px, egui),
                Ok(Some(drawn)) => Ok(drawn),
                Err(error) => Err(error),
            },
        };
        // The session's slots are those of another picture now.
        self.shown.iter_mut().for_each(|shown| shown.samples_left = None);
        if drawn.is_err() && !self.is_lost() {
            self.captures.pop_front();
        }
        let Some((picture, frame)) = drawn? else { return Ok(None) };
        let Some(Capture { scene, path, over, .. }) = self.captures.pop_front() else { return Ok(None) };
        let playback = self.playback;
        let session = self.home();
        session.play(playback);
        let mut stats = RenderStats::default();
        stats.record(&frame.status, session.backend_bytes());
        Ok(Some(Captured { path, picture, scene: frame.scene.shown(&scene), stats, over }))
    }

    /// Goes on with a picture that a GPU draws to be saved; `None` if there is none, or if it takes another step of streaming.
    fn go_on_with_capture(&mut self, egui: &egui::Context) -> Result<Option<Option<(Picture, Frame)>>, SessionError> {
        let (Some(mut capture), Some(session), Some(device)) = (self.gpu_capture.take(), &mut self.session, &self.gpu)
        else {
            return Ok(None);
        };
        Ok(match capture.go_on(session, device, egui)? {
            row_drawing::Captured::Step => None,
            row_drawing::Captured::Whole(picture, frame) => Some(Some((picture, *frame))),
            row_drawing::Captured::Partly => {
                self.gpu_capture = Some(capture);
                Some(None)
            }
        })
    }

    /// Streams a step towards a picture that was asked for. Returns the picture, and its frame, if a GPU has drawn it at once; else it is begun.
    fn step_to_capture(
        &mut self,
        scene: &Scene,
        size_px: (u32, u32),
        egui: &egui::Context,
    ) -> Result<Option<(Picture, Frame)>, SessionError> {
        match &self.drawing {
            Some((_, Task::Capture(_))) => return Ok(None),
            Some((drawing, _)) => drawing.abandon(),
            None => {}
        }
        let is_on_gpu = self.gpu.is_some();
        let session = self.home();
        // The picture is of the step that its scene says.
        session.play(None);
        let frame = session.step(scene, size_px)?;
        if !(frame.status.settled || frame.status.awaits_feedback) {
            return Ok(None);
        }
        let (drawn, samples) = (frame.clone(), scene.pixel_samples);
        if is_on_gpu && scene.stereo.is_none() {
            let pixels = |(width, height): (u32, u32)| f64::from(width) * f64::from(height);
            let shown = self.shown.as_ref().map_or(size_px, |shown| shown.size_px);
            let share = self.fitting * (pixels(shown) / pixels(size_px)).min(1.0);
            self.gpu_capture = Some(GpuCapture::new(frame, samples, share, self.between));
            return Ok(None);
        }
        let draw = move |session: &mut Session, painting: &Arc<Painting>| {
            // Drawing tells what was seen, after which more may be wanted.
            let picture = session.paint(&drawn, painting)?;
            match (drawn.status.settled, samples) {
                (false, _) => Ok(None),
                (true, PixelSamples::ONE) => Ok(Some(picture)),
                _ => samples.picture(|sample| session.paint(&drawn.of_sample(sample), painting)).map(Some),
            }
        };
        let eyes = 1 + u32::from(scene.stereo.is_some());
        let samples = if samples == PixelSamples::ONE { 0 } else { samples.count() as u32 };
        let painting = Painting::over(NO_PICTURE, size_px, eyes * (1 + samples));
        if is_on_gpu {
            return Ok(draw(session, &Arc::new(painting))?.map(|picture| (picture, frame)));
        }
        self.leave(Task::Capture(Box::new(frame)), painting, egui, draw)?;
        Ok(None)
    }

    /// For which file the picture is that was asked for first, and how much of it is drawn, 0 to 1, once that has taken a while; `None` if none
    /// was asked for.
    pub(crate) fn capturing(&self) -> Option<(&Path, f64)> {
        let capture = self.captures.front().filter(|capture| capture.asked.elapsed() > LOOK)?;
        let drawing = self.drawing.as_ref().filter(|(_, task)| matches!(task, Task::Capture(_)));
        let on_gpu = self.gpu_capture.as_ref().map(GpuCapture::share);
        Some((&capture.path, on_gpu.or(drawing.map(|(drawing, _)| drawing.progress())).unwrap_or_default()))
    }

    /// Gives up the picture that was asked for first.
    pub(crate) fn give_up_capture(&mut self) -> Option<PathBuf> {
        let playback = self.playback;
        let capture = self.captures.pop_front()?;
        self.home().play(playback);
        Some(capture.path)
    }

    /// Brings the texture nearer to a scene's picture of a size: streams a step, and draws unless what is shown still stands.
    ///
    /// # Errors
    /// If the scene cannot be drawn, or the device fails. The texture keeps what it shows.
    pub(crate) fn show(
        &mut self,
        scene: &Scene,
        size_px: (u32, u32),
        egui: &egui::Context,
    ) -> Result<(), SessionError> {
        if let Some(shown) = self.shown.as_ref().filter(|shown| self.asked.is_none() && shown.scene != *scene) {
            self.asked = Some((Instant::now(), Box::new(shown.scene.clone())));
        }
        // The scene follows the picture that has been seen, not the one that arrives now.
        let is_known = scene.time == self.pace.asked || Some(scene.time) == self.step_seen();
        if let Some((drawing, task)) = self.drawing.take_if(|(drawing, _)| drawing.is_over()) {
            self.arrive(drawing, task)?;
        }
        self.pace.is_jump |= self.pace.is_playing && !is_known;
        // What is played is asked for step by step: by the step of the picture that is shown, which the session may have left.
        let paced = Scene { time: self.pace.stepped, ..scene.clone() };
        let (asked, is_paced) = (scene.time, self.pace.is_playing && !self.pace.is_jump);
        let scene = if is_paced { &paced } else { scene };
        let is_same = |shown: &Shown| shown.scene == *scene && shown.size_px == size_px;
        if self.drawing.is_some() {
            self.look_on(scene, size_px);
            return Ok(());
        }
        let goes_on = |in_rows: &InRows| match in_rows {
            InRows::Show { shown, .. } => is_same(shown),
            InRows::Smooth(_) => self.shown.as_ref().is_some_and(is_same),
        };
        if self.in_rows.as_ref().is_some_and(goes_on) && !self.is_playing() {
            return self.draw_rows(egui);
        }
        self.in_rows = None;
        if let Some(shown) = self.shown.as_ref().filter(|shown| is_same(shown) && !self.is_playing()) {
            match shown.samples_left {
                Some(0) => return Ok(()),
                Some(_) => return self.smooth(egui),
                None => {}
            }
        }
        let begun = Instant::now();
        let session = self.home();
        let frame = session.step(scene, size_px)?;
        let (step, is_playing) = (begun.elapsed(), session.playback().is_some());
        self.spent.step += step;
        (self.pace.asked, self.pace.stepped) = (asked, frame.scene.time);
        let scene = &Scene { time: if is_paced { frame.scene.time } else { scene.time }, ..scene.clone() };
        let is_same = |shown: &Shown| shown.scene == *scene && shown.size_px == size_px;
        if let Some(shown) = self.shown.as_mut().filter(|shown| is_same(shown) && is_playing)
            && shown.frame.shows_as_much_as(&frame)
        {
            // Until the next step is due, the picture is as good as it gets.
            self.stream = Some((frame.status, frame.coming));
            self.keep_pace();
            return Ok(());
        }
        // What still streams is drawn as a moving view is: the exact picture comes once, when all is there.
        let moved = !(self.shown.as_ref().is_some_and(is_same) && frame.status.settled);
        let quality = self.control.next(Change { moved, refined: true }).unwrap_or(Quality::EXACT);
        let quality = if self.is_adaptive { quality } else { Quality::EXACT };
        self.stream = Some((frame.status.clone(), frame.coming.clone()));
        let share = self.control.share();
        if self.gpu.is_some() && !moved && !is_playing && share < 1.0 {
            let drawing = RowDrawing::new(frame.clone(), share, self.between);
            let shown = Shown { scene: scene.clone(), size_px, frame, quality, samples_left: None };
            self.in_rows = Some(InRows::Show { drawing, shown: Box::new(shown), step });
            self.keep_pace();
            return self.draw_rows(egui);
        }
        if self.gpu.is_some() {
            let begun = Instant::now();
            let drawn = self.draw(&quality.frame(&frame), size_px)?;
            let gpu_time = self.session.as_ref().and_then(|session| session.gpu_time());
            gpu_time.into_iter().for_each(|time| self.control.took(time));
            let times = FrameTimes { step, draw: begun.elapsed(), ..FrameTimes::default() };
            self.took(times);
            self.drew(drawn, Shown { scene: scene.clone(), size_px, frame, quality, samples_left: None });
            self.keep_pace();
            return Ok(());
        }
        if self.screen.is_none() || self.home().shows_before(&frame) {
            self.shown.iter_mut().for_each(|shown| shown.samples_left = None);
            self.keep_pace();
            return Ok(());
        }
        let drawn = quality.frame(&frame);
        let under = match &self.picture {
            // One eye's picture is not what is seen of two.
            Some(picture) if quality == Quality::EXACT && scene.stereo.is_none() => picture.clone(),
            _ => NO_PICTURE,
        };
        let painting = Painting::over(under, size_px, 1 + u32::from(scene.stereo.is_some()));
        let shown = Shown { scene: scene.clone(), size_px, frame, quality, samples_left: None };
        let task = Task::Show { shown: Box::new(shown), step };
        self.leave(task, painting, egui, move |session, painting| session.paint(&drawn, painting).map(Some))
    }

    /// Draws a part of what is drawn in parts, and shows it once all of it is drawn.
    fn draw_rows(&mut self, egui: &egui::Context) -> Result<(), SessionError> {
        let (Some(mut in_rows), Some(session), Some(device)) = (self.in_rows.take(), &mut self.session, &self.gpu)
        else {
            return Ok(());
        };
        let begun = Instant::now();
        let (InRows::Show { drawing, .. } | InRows::Smooth(drawing)) = &mut in_rows;
        let frame = drawing.go_on(session, device, egui)?.cloned();
        self.spent.draw += begun.elapsed();
        let Some(frame) = frame else {
            self.in_rows = Some(in_rows);
            return Ok(());
        };
        self.fitting = drawing.fitting();
        match in_rows {
            InRows::Smooth(_) => self.add_sample(&frame),
            InRows::Show { drawing, shown, step } => {
                let drawn = self.draw(&frame, shown.size_px)?;
                self.took(FrameTimes { step, beside: drawing.since(), ..FrameTimes::default() });
                self.drew(drawn, *shown);
                Ok(())
            }
        }
    }

    /// While the session draws: abandons what is not of this scene, unless it is there soon, and shows what is drawn of it so far.
    fn look_on(&mut self, scene: &Scene, size_px: (u32, u32)) {
        let Some((drawing, task)) = &self.drawing else { return };
        let (is_of_it, is_brief) = match task {
            Task::Show { shown, .. } => {
                let is_brief = shown.quality != Quality::EXACT && drawing.since() < LATE;
                (shown.scene == *scene && shown.size_px == size_px, is_brief)
            }
            Task::Smooth => {
                let shown = self.shown.as_ref();
                (shown.is_some_and(|shown| shown.scene == *scene && shown.size_px == size_px), false)
            }
            Task::Capture(_) => (false, false),
        };
        if !is_of_it {
            if !is_brief {
                drawing.abandon();
            }
            return;
        }
        // Over a picture of the same scene and time step alone.
        let Task::Show { shown: drawn, .. } = task else { return };
        let is_under = |shown: &&Shown| {
            let is_same_step = shown.frame.scene.time == drawn.frame.scene.time;
            shown.scene == *scene && shown.size_px == size_px && is_same_step && drawn.quality == Quality::EXACT
        };
        let is_due = drawing.since() > LOOK && self.looked.is_none_or(|looked| looked.elapsed() > LOOK);
        if is_due && self.shown.as_ref().is_some_and(|shown| is_under(&shown)) {
            let so_far = drawing.so_far();
            if !so_far.rgb.is_empty() {
                self.screen.iter_mut().for_each(|screen| screen.put(&so_far, (so_far.width, so_far.height) != size_px));
            }
            self.looked = Some(Instant::now());
        }
    }

    /// Sends the session to draw beside the window.
    fn leave(
        &mut self,
        task: Task,
        painting: Painting,
        egui: &egui::Context,
        draw: impl FnOnce(&mut Session, &Arc<Painting>) -> Result<Option<Picture>, SessionError> + Send + 'static,
    ) -> Result<(), SessionError> {
        let Some(session) = self.session.take() else { return Ok(()) };
        let known = Known::of(&session, self.shown.as_ref().map(|shown| &*shown.frame.scene));
        let volumes = known.volumes.clone();
        match Drawing::begin(session, known, painting, egui.clone(), draw) {
            Ok(drawing) => {
                self.drawing = Some((drawing, task));
                Ok(())
            }
            Err(error) => {
                self.session = Some(Box::new(Session::new(volumes, self.options)));
                Err(SessionError::NoThread(error))
            }
        }
    }

    /// Takes the session home, and with it what it has drawn. Returns a picture that was asked for.
    fn arrive(&mut self, drawing: Drawing, task: Task) -> Result<Option<(Picture, Frame)>, SessionError> {
        let is_abandoned = drawing.is_abandoned();
        let Some(Home { session, drawn, took }) = drawing.end() else { return Ok(None) };
        self.session = Some(session);
        self.looked = None;
        self.keep_pace();
        // One that was abandoned is no error; one that is whole all the same is not of what is asked for now.
        let picture = match drawn {
            _ if is_abandoned => return Ok(None),
            drawn => drawn?,
        };
        let (Some(picture), Some(screen)) = (picture, &mut self.screen) else { return Ok(None) };
        match task {
            Task::Capture(frame) => return Ok(Some((picture, *frame))),
            Task::Smooth => {
                let Some(Shown { scene, samples_left: Some(left), .. }) = &mut self.shown else { return Ok(None) };
                screen.add(&picture, *left == scene.pixel_samples.count());
                *left = left.saturating_sub(1);
                if *left == 0 {
                    screen.show_mean();
                }
                self.spent.beside += took;
            }
            Task::Show { shown, step } => {
                self.control.took(took);
                screen.put(&picture, (picture.width, picture.height) != shown.size_px);
                self.picture = Some(picture);
                self.took(FrameTimes { step, beside: took, ..FrameTimes::default() });
                self.drew(Drawn::Whole, *shown);
            }
        }
        Ok(None)
    }

    /// Takes note of what a picture took; its step of streaming is counted already.
    fn took(&mut self, times: FrameTimes) {
        if self.times.len() == FRAMES {
            self.times.pop_front();
        }
        self.times.push_back(times);
        self.spent = self.spent.and(FrameTimes { step: Duration::ZERO, ..times });
    }

    /// Takes note of a picture.
    fn drew(&mut self, drawn: Drawn, shown: Shown) {
        if drawn == Drawn::Nothing {
            self.shown.iter_mut().for_each(|shown| shown.samples_left = None);
            return;
        }
        let Shown { scene, frame, quality, .. } = &shown;
        if !frame.status.covered {
            // It never happens; tests of the window look for it.
            tracing::error!("a picture has a hole");
        }
        if let Some((at, _)) = self.asked.take_if(|(_, before)| **before != *scene) {
            self.answers.push(at.elapsed());
        }
        let is_exact = drawn == Drawn::Whole && frame.status.settled && *quality == Quality::EXACT;
        let samples_left = is_exact.then(|| match scene.pixel_samples {
            PixelSamples::ONE => 0,
            more => more.count(),
        });
        self.shown = Some(Shown { samples_left, ..shown });
    }

    /// The session, which is called home and abandons what it draws.
    fn home(&mut self) -> &mut Session {
        (self.in_rows, self.gpu_capture) = (None, None);
        let mut volumes = Vec::new();
        if let Some((drawing, task)) = self.drawing.take() {
            drawing.abandon();
            volumes.clone_from(&drawing.known.volumes);
            // Nothing comes of what was abandoned.
            let _ = self.arrive(drawing, task);
        }
        let options = self.options;
        self.session.get_or_insert_with(|| Box::new(Session::new(volumes, options)))
    }

    /// Draws the next sample of the picture's pixels. When all are drawn, the texture shows their mean.
    ///
    /// # Errors
    /// If the device fails. The texture keeps what it shows.
    fn smooth(&mut self, egui: &egui::Context) -> Result<(), SessionError> {
        let Some(Shown { scene, frame, size_px, samples_left: Some(left), .. }) = &self.shown else { return Ok(()) };
        let (samples, size_px) = (scene.pixel_samples, *size_px);
        let Some(sample) = samples.samples().nth(samples.count() - *left) else { return Ok(()) };
        let frame = frame.of_sample(sample);
        if self.gpu.is_none() {
            let painting = Painting::over(NO_PICTURE, size_px, 1 + u32::from(scene.stereo.is_some()));
            return self.leave(Task::Smooth, painting, egui, move |session, painting| {
                session.paint(&frame, painting).map(Some)
            });
        }
        if self.control.share() < 1.0 {
            self.in_rows = Some(InRows::Smooth(RowDrawing::new(frame, self.fitting, self.between)));
            return self.draw_rows(egui);
        }
        self.add_sample(&frame)
    }

    /// Draws a sample of the picture's pixels on a GPU, unless that is done, and adds it to those before.
    fn add_sample(&mut self, frame: &Frame) -> Result<(), SessionError> {
        let Some(Shown { scene, size_px, samples_left: Some(left), .. }) = &self.shown else { return Ok(()) };
        let (samples, size_px, is_first) = (scene.pixel_samples, *size_px, *left == scene.pixel_samples.count());
        let Some(Device { state, .. }) = self.gpu.clone() else { return Ok(()) };
        let (Some(session), Some(screen)) = (&mut self.session, &mut self.screen) else { return Ok(()) };
        let begun = Instant::now();
        let target = Target { view: screen.sample(size_px), format: FORMAT, area_px: None };
        let mut encoder = state.device.create_command_encoder(&Default::default());
        let is_drawn = session.draw_to(frame, &target, &mut encoder)?;
        if is_drawn {
            screen.add_sample(&mut encoder, is_first, samples);
        }
        state.queue.submit([encoder.finish()]);
        self.spent.draw += begun.elapsed();
        if let Some(Shown { samples_left: Some(left), .. }) = self.shown.as_mut().filter(|_| is_drawn) {
            *left -= 1;
            if *left == 0 {
                screen.show_mean();
            }
        }
        Ok(())
    }

    /// Plays time steps from the one that is shown on, or in another way; `None` stands still.
    pub(crate) fn play(&mut self, playback: Option<Playback>) {
        if self.playback != playback {
            self.playback = playback;
            self.home().play(playback);
            self.keep_pace();
            self.shown.iter_mut().for_each(|shown| shown.samples_left = None);
        }
    }

    /// Whether time steps are played: not any more once the last one is shown of a playback that stops there.
    pub(crate) fn is_playing(&self) -> bool {
        self.pace.is_playing
    }

    /// Takes note of the time step at which the session is that has come home, or stays.
    fn keep_pace(&mut self) {
        if let Some(session) = &self.session {
            (self.pace.is_playing, self.pace.is_seeking) = (session.playback().is_some(), session.is_seeking());
            self.pace.is_jump = false;
        }
    }

    /// The time step that is shown; `None` before the first picture, and while another one is sought.
    pub(crate) fn step_shown(&self) -> Option<u32> {
        let is_sought = self.pace.is_seeking || self.pace.is_jump;
        self.shown.as_ref().filter(|_| !is_sought).map(|shown| shown.frame.scene.time)
    }

    /// The time step of the picture that is seen; `None` before the first one.
    pub(crate) fn step_seen(&self) -> Option<u32> {
        self.shown.as_ref().map(|shown| shown.frame.scene.time)
    }

    /// The time steps that come next.
    pub(crate) fn coming(&self) -> &[ComingStep] {
        self.stream.as_ref().map_or(&[], |(_, coming)| coming)
    }

    /// Draws a frame on the GPU into the texture, which has `size_px` pixels. While there is nothing of the frame in some place, the texture stays as it is.
    fn draw(&mut self, frame: &Frame, size_px: (u32, u32)) -> Result<Drawn, SessionError> {
        let (Some(screen), Some(session)) = (&mut self.screen, &mut self.session) else { return Ok(Drawn::Nothing) };
        let Some(Device { state, .. }) = &self.gpu else { return Ok(Drawn::Nothing) };
        let target = Target { view: screen.sized(size_px), format: FORMAT, area_px: None };
        let mut encoder = state.device.create_command_encoder(&Default::default());
        let is_this = session.draw_to(frame, &target, &mut encoder)?;
        state.queue.submit([encoder.finish()]);
        Ok(match session.shown() {
            _ if is_this => Drawn::Whole,
            Some(shown) if shown.is_copy_of(frame) => Drawn::Partly,
            _ => Drawn::Nothing,
        })
    }

    /// What is known of the session, wherever it is.
    fn known<'a, T: Default>(&'a self, at_home: impl FnOnce(&'a Session) -> T, away: impl FnOnce(&'a Known) -> T) -> T {
        match (&self.session, &self.drawing) {
            (Some(session), _) => at_home(session),
            (None, Some((drawing, _))) => away(&drawing.known),
            (None, None) => T::default(),
        }
    }

    /// The volumes that are shown.
    fn volumes(&self) -> &[VolumeSource] {
        self.known(Session::volumes, |known| &known.volumes)
    }

    /// How much is drawn of the picture at which the session works, 0 to 1, once that has taken a while; `None` if it does not.
    pub(crate) fn progress(&self) -> Option<f64> {
        if let Some(InRows::Show { drawing, .. } | InRows::Smooth(drawing)) = &self.in_rows {
            return (drawing.since() > LOOK).then(|| drawing.share());
        }
        let (drawing, _) = self.drawing.as_ref().filter(|(drawing, _)| drawing.since() > LOOK)?;
        Some(drawing.progress())
    }

    /// How long it is until the window should look how far the picture is, which is not final. It hears of those that are drawn beside it, or in parts.
    pub(crate) fn look_after(&self) -> Duration {
        let [soonest, latest] = DRAWING_STEPS;
        let in_rows = match &self.in_rows {
            Some(InRows::Show { drawing, .. } | InRows::Smooth(drawing)) => Some(drawing),
            None => None,
        };
        let in_parts = in_rows.or(self.gpu_capture.as_ref().and_then(GpuCapture::drawing));
        let in_parts = in_parts.filter(|drawing| drawing.is_under_way()).map(RowDrawing::since);
        let since = self.drawing.as_ref().map(|(drawing, _)| drawing.since()).or(in_parts);
        since.map_or(STREAMING_STEP, |since| since.clamp(soonest, latest))
    }

    /// Puts the picture over a part of the window; nothing before the first one.
    pub(crate) fn paint(&self, painter: &Painter, area: Rect) {
        self.screen.iter().for_each(|screen| screen.paint(painter, area));
    }

    /// Whether the picture is as it will stay until the scene changes.
    pub(crate) fn is_final(&self) -> bool {
        self.drawing.is_none() && self.shown.as_ref().is_some_and(|shown| shown.samples_left == Some(0))
    }

    /// How far the view is; `None` before the first step.
    pub(crate) fn status(&self) -> Option<&Status> {
        self.stream.as_ref().map(|(status, _)| status)
    }

    /// The share of the exact picture's work that was done for the one that is shown.
    pub(crate) fn quality(&self) -> f64 {
        self.shown.as_ref().map_or(0.0, |shown| shown.quality.share())
    }

    /// The scene that is shown, with nothing left open, and its volumes; `None` before the first picture.
    pub(crate) fn resolved(&self) -> (Option<&Arc<ResolvedScene>>, &[VolumeSource]) {
        (self.shown.as_ref().map(|shown| &shown.frame.scene), self.volumes())
    }

    /// Layers of the picture with doubtful extremes; none before the first picture.
    pub(crate) fn doubtful_extremes(&self) -> DoubtfulExtremes {
        let shown = self.shown.as_ref();
        let at_home = |session: &Session| {
            shown.map_or_else(Default::default, |shown| session.doubtful_extremes(&shown.frame.scene))
        };
        self.known(at_home, |known| known.doubtful.clone())
    }

    /// A line that says where the picture is drawn.
    pub(crate) fn backend_line(&self) -> &str {
        self.known(Session::backend_line, |known| &known.backend_line)
    }

    /// Bytes of the backend's memory, and of host memory, in use.
    pub(crate) fn memory_bytes(&self) -> (u64, u64) {
        (
            self.known(Session::backend_bytes, |known| known.backend_bytes),
            self.status().map_or(0, |status| status.host_bytes),
        )
    }

    /// Whether a scene can be shown.
    ///
    /// # Errors
    /// If not: the reason.
    pub(crate) fn check(&self, scene: &Scene) -> Result<(), SceneError> {
        check(self.volumes(), scene)
    }

    /// What the last frames took, oldest first.
    pub(crate) fn times(&self) -> &VecDeque<FrameTimes> {
        &self.times
    }

    /// What frames took since this was last asked.
    pub(crate) fn take_spent(&mut self) -> FrameTimes {
        std::mem::take(&mut self.spent)
    }

    /// How long it was from changes of the scene to the first pictures of them since this was last asked.
    pub(crate) fn take_answers(&mut self) -> Vec<Duration> {
        std::mem::take(&mut self.answers)
    }

    /// The draw list of each layer, for which pictures are drawn now.
    pub(crate) fn draw_lists(&self) -> Vec<&DrawList> {
        self.known(|session| session.draw_lists().collect(), |known| known.draw_lists.iter().collect())
    }

    /// Number of bricks that slots hold at most.
    pub(crate) fn slots(&self) -> u64 {
        self.known(Session::slots, |known| known.slots)
    }
}

/// Whether the window's device draws volumes, too, and not the CPU.
fn draws_volumes(device: &Device, options: &SessionOptions) -> bool {
    match options.backend {
        BackendChoice::Cpu => false,
        BackendChoice::Auto => !device.is_software(),
        BackendChoice::Gpu => true,
    }
}

/// The window's device, as sessions take it.
fn gpu(device: &Device) -> Result<Gpu, SessionError> {
    let RenderState { adapter, device, queue, .. } = &device.state;
    let gpu = Gpu::from_device(adapter, device.clone(), queue.clone());
    Ok(gpu.map_err(brickyard::backend::BackendError::from)?)
}
