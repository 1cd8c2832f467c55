//! The window's picture: a live session draws the scene into a texture, on the window's device or [beside the window](drawing) on the CPU, as
//! coarsely as a moving view demands. At rest it draws the exact picture, smooths it sample by sample, and stops. Costs a streaming step per picture;
//! on a GPU one per frame of the window.

mod beside;
mod capture;
mod changes_seen;
mod drawing;
mod made;
mod meeting;
mod on_gpu;
mod picture;
mod row_drawing;
mod row_pace;

pub(crate) use capture::Captured;
pub(crate) use changes_seen::Answer;

use crate::device::Device;
use crate::screen::Screen;
use beside::Task;
use brickyard::backend::BackendChoice;
use brickyard::doubtful_extremes::DoubtfulExtremes;
use brickyard::frame_governor::{Quality, QualityControl};
use brickyard::pager::{DrawList, Playback, Status};
use brickyard::render::Gpu;
use brickyard::session::{
    ComingStep, Drawn, ResolvedScene, Session, SessionError, SessionOptions, VolumeSource, check,
};
use brickyard::volume::{Camera, Picture, PixelSamples, Scene, SceneError};
use capture::Capture;
use changes_seen::ChangesSeen;
use drawing::{Drawing, Engine, Known};
use eframe::egui::{Painter, Rect};
use eframe::egui_wgpu::RenderState;
use on_gpu::{InRows, Parts};
use picture::{Shown, Wanted};
use row_pace::RowPace;
use std::collections::VecDeque;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Number of frames with recorded times.
const FRAMES: usize = 240;

/// Longest wait for an abandoned session.
const GIVING_UP: Duration = Duration::from_millis(12);

/// Longest wait for a moving view's picture, in frame goals: painting in between doubles the time of both.
const PATIENCE: f64 = 1.5;

/// Interval between looks at a picture in progress.
const LOOK: Duration = Duration::from_millis(150);

/// Interval of checks for new bricks, by the window or a session beside it.
pub(crate) const STREAMING_STEP: Duration = Duration::from_millis(8);

/// Delays of the first and of later progress updates for pictures beside the window. Each costs them a frame: a picture of 0.2 s gets none.
const DRAWING_STEPS: [Duration; 2] = [Duration::from_millis(200), Duration::from_millis(500)];

/// A session, and the texture with its picture.
pub(crate) struct Canvas {
    /// The session at home, as always on a GPU; `None` while away on the CPU.
    engine: Option<Box<Engine>>,
    /// The session's work while away, and its last report.
    drawing: Option<(Drawing, Task)>,
    known: Known,
    changes: Vec<Change>,
    parts: Parts,
    /// Longest frame during changes, and the duration of one without drawing.
    goal: Duration,
    between: Duration,
    options: SessionOptions,
    /// The CPU's last picture, and when it, or a part of the next one, was shown.
    picture: Option<Arc<Picture>>,
    looked: Option<Instant>,
    /// The visible texture; `None` until the window has a device.
    screen: Option<Screen>,
    /// The window's device, if the session draws on it.
    gpu: Option<Device>,
    /// Whether moving views are drawn coarser.
    pub(crate) is_adaptive: bool,
    /// Whether a frame waits slightly beyond its goal for a moving view's picture: both use the same cores.
    pub(crate) is_patient: bool,
    pace: Pace,
    shown: Option<Shown>,
    /// Status of the last streaming step, and coming time steps; `None` before the first.
    stream: Option<(Status, Vec<ComingStep>)>,
    /// Times of the last frames, oldest first.
    pub(crate) times: VecDeque<FrameTimes>,
    /// Time spent since it was last taken.
    pub(crate) spent: FrameTimes,
    changes_seen: ChangesSeen,
    captures: VecDeque<Capture>,
    /// Whether saved pictures wait for a resting view; and its failed picture, for which they do not.
    gives_way: bool,
    failed: Option<Wanted>,
}

/// A change, applied while the session is home.
enum Change {
    /// Another playback; `None` stands still.
    Play(Option<Playback>),
    /// Later states of the volumes.
    Volumes(Vec<VolumeSource>),
    /// Other memory limits, in bytes.
    Budgets { backend_bytes: u64, host_memory_bytes: u64 },
}

impl Change {
    fn apply(self, session: &mut Session) {
        match self {
            Self::Play(playback) => session.play(playback),
            Self::Volumes(volumes) => session.set_volumes(volumes),
            Self::Budgets { backend_bytes, host_memory_bytes } => {
                session.set_budgets(backend_bytes, host_memory_bytes);
            }
        }
    }
}

/// Times of a frame's parts.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FrameTimes {
    /// Streaming: receiving bricks, planning, uploading.
    pub(crate) step: Duration,
    /// Recording a GPU's commands.
    pub(crate) draw: Duration,
    /// Drawing on the CPU, or in parts on a GPU.
    pub(crate) beside: Duration,
    /// Waiting for a picture beside the window.
    pub(crate) waited: Duration,
}

impl FrameTimes {
    pub(crate) fn drawing(&self) -> Duration {
        self.draw + self.beside
    }

    /// The sum of both.
    pub(crate) fn and(self, other: Self) -> Self {
        Self {
            step: self.step + other.step,
            draw: self.draw + other.draw,
            beside: self.beside + other.beside,
            waited: self.waited + other.waited,
        }
    }
}

/// The session's playback, and its current and requested time step, as of the shown picture; a drawing session is ahead.
#[derive(Default)]
struct Pace {
    playback: Option<Playback>,
    is_playing: bool,
    is_seeking: bool,
    /// The step of the session's last frame, and the requested one.
    stepped: u32,
    asked: u32,
    /// Whether another step is requested.
    is_jump: bool,
}

impl Canvas {
    /// Creates a session: on the window's device, unless there is none, the options choose the CPU, or they leave the choice and the device is a
    /// software one.
    ///
    /// # Errors
    /// If the device is unfit for the engine.
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
        let goal = Duration::from_millis(50);
        Ok(Self {
            known: Known::of(&session, None),
            engine: Some(Box::new(Engine { session, control: QualityControl::new(goal) })),
            drawing: None,
            changes: Vec::new(),
            parts: Parts::default(),
            goal,
            between: Duration::ZERO,
            options,
            picture: None,
            looked: None,
            screen: device.map(Screen::new),
            gpu: gpu_device.cloned(),
            is_adaptive: true,
            is_patient: false,
            pace: Pace::default(),
            shown: None,
            stream: None,
            times: VecDeque::new(),
            spent: FrameTimes::default(),
            changes_seen: ChangesSeen::default(),
            captures: VecDeque::new(),
            gives_way: true,
            failed: None,
        })
    }

    /// Moves to another device. Requested pictures are still to come. Decoded bricks stay, unless the CPU replaces a GPU or the reverse.
    ///
    /// # Errors
    /// If the device is unfit for the engine.
    pub(crate) fn set_device(&mut self, options: &SessionOptions, device: &Device) -> Result<(), SessionError> {
        match (&mut self.gpu, draws_volumes(device, options)) {
            (None, false) => {}
            (Some(known), true) => {
                *known = device.clone();
                if let Some(engine) = &mut self.engine {
                    engine.session.set_gpu(gpu(device)?);
                }
            }
            _ => {
                let captures = std::mem::take(&mut self.captures);
                *self = Self { captures, ..Self::new(self.volumes().to_vec(), options, Some(device))? };
            }
        }
        self.forget_captures();
        (self.screen, self.shown) = (Some(Screen::new(device)), None);
        self.parts.give_up();
        Ok(())
    }

    /// Starts over with other volumes. The old picture stays until there is a new one.
    ///
    /// # Errors
    /// If the device is unfit for the engine.
    pub(crate) fn begin_anew(
        &mut self,
        volumes: Vec<VolumeSource>,
        options: &SessionOptions,
        device: Option<&Device>,
    ) -> Result<(), SessionError> {
        let anew = Self::new(volumes, options, device)?;
        let before = std::mem::replace(self, anew);
        self.screen = before.screen;
        // Freeing gigabytes of bricks takes as long as several frames.
        let engine = before.engine;
        let given_back = std::thread::Builder::new().name("giving back".into()).spawn(move || drop(engine));
        if let Err(error) = given_back {
            tracing::debug!("memory was given back on the window's thread: {error}");
        }
        Ok(())
    }

    /// Switches to later states of the volumes.
    pub(crate) fn set_volumes(&mut self, volumes: Vec<VolumeSource>) {
        self.known.volumes.clone_from(&volumes);
        self.tell(Change::Volumes(volumes));
    }

    /// Applies a change: at once on a GPU, else when the session next leaves. Abandons the picture in progress.
    fn tell(&mut self, change: Change) {
        self.parts.give_up();
        if matches!(change, Change::Volumes(_)) {
            self.forget_captures();
        }
        self.shown.iter_mut().for_each(|shown| shown.samples_left = None);
        match &mut self.engine {
            Some(engine) if self.gpu.is_some() => change.apply(&mut engine.session),
            _ => self.changes.push(change),
        }
        self.drawing.iter().for_each(|(drawing, _)| drawing.painting().abandon());
        self.keep_pace();
    }

    fn is_lost(&self) -> bool {
        self.gpu.as_ref().is_some_and(|device| device.lost().is_some())
    }

    /// Whether the last requested picture failed, and an earlier one is shown.
    pub(crate) fn is_failing(&self) -> bool {
        self.failed.is_some()
    }

    pub(crate) fn draws_on_cpu(&self) -> bool {
        self.gpu.is_none()
    }

    /// Sets the longest frame during changes, `between` of it the window's own work.
    pub(crate) fn set_frame_goal(&mut self, goal: Duration, between: Duration) {
        (self.goal, self.between) = (goal, between);
        if let Some(Engine { session, control }) = self.engine.as_deref_mut().filter(|_| self.gpu.is_some()) {
            // A GPU's own work on a picture is part of the time between frames.
            control.set_goal(session.drawing_time(goal, Duration::ZERO));
        }
    }

    /// Sets memory limits in bytes: for slots, tables and targets, and for decoded bricks.
    pub(crate) fn set_budgets(&mut self, backend_bytes: u64, host_memory_bytes: u64) {
        let SessionOptions { gpu_memory_bytes, cpu_memory_bytes, host_memory_bytes: host, .. } = self.options;
        if (gpu_memory_bytes, cpu_memory_bytes, host) == (backend_bytes, backend_bytes, host_memory_bytes) {
            return;
        }
        (self.options.gpu_memory_bytes, self.options.cpu_memory_bytes) = (backend_bytes, backend_bytes);
        self.options.host_memory_bytes = host_memory_bytes;
        self.tell(Change::Budgets { backend_bytes, host_memory_bytes });
    }

    /// Brings the texture closer to the scene's picture, unless the shown one still stands, or pictures are being saved and the view rests.
    ///
    /// # Errors
    /// If the scene cannot be drawn, or the device fails. The texture stays as it is.
    pub(crate) fn show(&mut self, scene: &Scene, size_px: (u32, u32)) -> Result<(), SessionError> {
        let wanted = Wanted { scene: scene.clone(), size_px, is_paced: false, change: self.changes_seen.count };
        let is_exact =
            |shown: &Shown| shown.is_of(&wanted) && shown.quality == Quality::EXACT && shown.frame.status.settled;
        let is_exact = self.shown.as_ref().is_some_and(is_exact);
        if is_exact {
            self.failed = None;
        }
        let rests = self.is_playing() || is_exact || self.failed.as_ref().is_some_and(|failed| failed.is_as(&wanted));
        let gives_way = !(self.is_capturing() && rests);
        let gave_way = std::mem::replace(&mut self.gives_way, gives_way);
        if !self.gives_way {
            return Ok(());
        }
        if !gave_way && self.is_capturing() {
            // It stood still for the picture.
            self.tell(Change::Play(self.pace.playback));
        }
        let shown = self.bring_on(scene, size_px);
        if shown.is_err() {
            self.failed = Some(wanted);
        }
        shown
    }

    fn bring_on(&mut self, scene: &Scene, size_px: (u32, u32)) -> Result<(), SessionError> {
        self.changes_seen.see(scene, self.shown.as_ref());
        // The scene follows the picture seen so far, not the one arriving now.
        let is_known = scene.time == self.pace.asked || Some(scene.time) == self.step_seen();
        self.arrive()?;
        self.pace.is_jump |= self.pace.is_playing && !is_known;
        // Playback requests the shown picture's step, which the session may have left already.
        let is_paced = self.pace.is_playing && !self.pace.is_jump;
        let time = if is_paced { self.pace.stepped } else { scene.time };
        let wanted =
            Wanted { scene: Scene { time, ..scene.clone() }, size_px, is_paced, change: self.changes_seen.count };
        if self.drawing.is_some() {
            self.look_on(&wanted);
            // A frame of the window may take as long as the next picture.
            let is_abandoned = self.drawing.as_ref().is_some_and(|(drawing, _)| drawing.painting().is_abandoned());
            if !(is_abandoned && self.wait(GIVING_UP)) {
                return Ok(());
            }
            self.arrive()?;
        }
        let is_shown = !self.is_playing() && self.shown.as_ref().is_some_and(|shown| shown.is_of(&wanted));
        let goes_on = match &self.parts.shown {
            Some(InRows::Show { shown, .. }) => !self.is_playing() && shown.is_of(&wanted),
            Some(InRows::Smooth(_)) => is_shown,
            None => false,
        };
        if goes_on {
            return self.draw_rows();
        }
        self.parts.shown = None;
        match self.shown.as_ref().filter(|_| is_shown).and_then(|shown| shown.samples_left) {
            Some(0) => return Ok(()),
            Some(_) => return self.smooth(),
            None => {}
        }
        self.pace.asked = scene.time;
        match (&self.gpu, &self.screen) {
            (Some(_), _) => self.show_on_gpu(&wanted),
            (None, Some(_)) => {
                let moves = self.shown.as_ref().is_some_and(|shown| !shown.is_of(&wanted));
                self.show_beside(wanted)?;
                if moves && self.is_patient && !self.is_playing() && self.wait(self.goal.mul_f64(PATIENCE)) {
                    self.arrive()?;
                }
                Ok(())
            }
            (None, None) => Ok(()),
        }
    }

    /// Waits `at_most` for the session. Returns whether it can be taken home.
    fn wait(&mut self, at_most: Duration) -> bool {
        let begun = Instant::now();
        let is_over = self.drawing.as_ref().is_some_and(|(drawing, _)| drawing.wait(at_most));
        self.spent.waited += begun.elapsed();
        is_over
    }

    /// Records a picture's times; its streaming step is counted already, or was beside the window.
    fn took(&mut self, times: FrameTimes) {
        keep_last(&mut self.times, FRAMES, times);
        self.spent = self.spent.and(FrameTimes { step: Duration::ZERO, ..times });
    }

    /// Records a picture as shown.
    fn drew(&mut self, drawn: Drawn, shown: Shown) {
        if drawn == Drawn::Nothing {
            self.shown.iter_mut().for_each(|shown| shown.samples_left = None);
            return;
        }
        let Shown { of, frame, quality, .. } = &shown;
        if !frame.status.covered {
            // This never happens; tests of the window search the log for it.
            tracing::error!("a picture has a hole");
        }
        self.failed = None;
        self.changes_seen.answer(of.change);
        let is_exact = drawn == Drawn::Whole && frame.status.settled && *quality == Quality::EXACT;
        let samples_left = is_exact.then(|| match of.scene.pixel_samples {
            PixelSamples::ONE => 0,
            more => more.count(),
        });
        self.shown = Some(Shown { samples_left, ..shown });
    }

    /// Draws the next sample. After the last one the texture shows their mean.
    ///
    /// # Errors
    /// If the device fails. The texture stays as it is.
    fn smooth(&mut self) -> Result<(), SessionError> {
        let Some(Shown { of, frame, samples_left: Some(left), .. }) = &self.shown else { return Ok(()) };
        let samples = of.scene.pixel_samples;
        let Some(sample) = samples.samples().nth(samples.count() - *left) else { return Ok(()) };
        let (frame, size_px) = (frame.of_sample(sample), of.size_px);
        match self.gpu {
            Some(_) => self.smooth_on_gpu(frame),
            None => self.smooth_beside(frame, size_px),
        }
    }

    /// Counts a sample added to the shown picture. After the last one their mean is visible.
    fn count_sample(&mut self) {
        if let (Some(Shown { samples_left: Some(left), .. }), Some(screen)) = (&mut self.shown, &mut self.screen) {
            *left = left.saturating_sub(1);
            if *left == 0 {
                screen.show_mean();
            }
        }
    }

    /// Plays time steps from the shown one on; `None` stands still.
    pub(crate) fn play(&mut self, playback: Option<Playback>) {
        if self.pace.playback != playback {
            self.pace.playback = playback;
            self.tell(Change::Play(playback));
        }
    }

    /// Whether time steps are playing, up to the last if the playback stops there.
    pub(crate) fn is_playing(&self) -> bool {
        self.pace.is_playing
    }

    /// Records whether the session plays or seeks, once it is home without pending changes.
    fn keep_pace(&mut self) {
        if let Some(Engine { session, .. }) = self.engine.as_deref() {
            (self.pace.is_playing, self.pace.is_seeking) = (session.playback().is_some(), session.is_seeking());
            self.pace.is_jump = false;
        }
        let played = self.changes.iter().rev().find_map(|change| match change {
            Change::Play(playback) => Some(playback.is_some()),
            _ => None,
        });
        self.pace.is_playing = played.unwrap_or(self.pace.is_playing);
    }

    /// The shown time step; `None` before the first picture and during a seek.
    pub(crate) fn step_shown(&self) -> Option<u32> {
        let is_sought = self.pace.is_seeking || self.pace.is_jump;
        self.shown.as_ref().filter(|_| !is_sought).map(|shown| shown.frame.scene.time)
    }

    /// The visible picture's time step, if any.
    pub(crate) fn step_seen(&self) -> Option<u32> {
        self.shown.as_ref().map(|shown| shown.frame.scene.time)
    }

    pub(crate) fn coming(&self) -> &[ComingStep] {
        self.stream.as_ref().map_or(&[], |(_, coming)| coming)
    }

    /// A property of the session on a GPU, or as last reported from the CPU.
    fn known<'a, T>(&'a self, at_home: impl FnOnce(&'a Session) -> T, told: impl FnOnce(&'a Known) -> T) -> T {
        match self.engine.as_deref().filter(|_| self.gpu.is_some()) {
            Some(engine) => at_home(&engine.session),
            None => told(&self.known),
        }
    }

    fn volumes(&self) -> &[VolumeSource] {
        self.known(Session::volumes, |known| &known.volumes)
    }

    /// The drawn share of the picture in progress, 0 to 1, once it takes long; `None` without one.
    pub(crate) fn progress(&self) -> Option<f64> {
        if let Some(pace) = self.parts.shown.as_ref().map(InRows::pace) {
            return (pace.since() > LOOK).then(|| pace.share());
        }
        let (drawing, task) = self.drawing.as_ref()?;
        let since = match task {
            Task::Show(_) => drawing.begun().map(|begun| begun.at.elapsed()),
            Task::Smooth => Some(drawing.since()),
            // Saved pictures have their own progress row.
            Task::Capture => None,
        };
        since.filter(|since| *since > LOOK).map(|_| drawing.painting().progress())
    }

    /// Delay until the next check on an unfinished picture. Pictures beside the window or in parts report their end.
    pub(crate) fn look_after(&self) -> Duration {
        let [soonest, latest] = DRAWING_STEPS;
        let in_parts = self.parts.pace().filter(|pace| pace.is_under_way()).map(RowPace::since);
        let since = self.drawing.as_ref().map(|(drawing, _)| drawing.since()).or(in_parts);
        since.map_or(STREAMING_STEP, |since| since.clamp(soonest, latest))
    }

    /// Puts the picture, if any, over a part of the window.
    pub(crate) fn paint(&self, painter: &Painter, area: Rect) {
        self.screen.iter().for_each(|screen| screen.paint(painter, area));
    }

    /// Whether the picture is complete until the scene changes.
    pub(crate) fn is_final(&self) -> bool {
        self.drawing.is_none() && self.shown.as_ref().is_some_and(|shown| shown.samples_left == Some(0))
    }

    /// Status of the view; `None` before the first step.
    pub(crate) fn status(&self) -> Option<&Status> {
        self.stream.as_ref().map(|(status, _)| status)
    }

    /// Work done for the shown picture, as a share of the exact one's.
    pub(crate) fn quality(&self) -> f64 {
        self.shown.as_ref().map_or(0.0, |shown| shown.quality.share())
    }

    /// The shown scene with every choice made, and its volumes; `None` before the first picture.
    pub(crate) fn resolved(&self) -> (Option<&Arc<ResolvedScene>>, &[VolumeSource]) {
        (self.shown.as_ref().map(|shown| &shown.frame.scene), self.volumes())
    }

    /// The shown picture's camera, if any.
    pub(crate) fn camera(&self) -> Option<Camera> {
        self.shown.as_ref().map(|shown| shown.frame.scene.camera)
    }

    /// Layers of the shown picture with doubtful extremes.
    pub(crate) fn doubtful_extremes(&self) -> DoubtfulExtremes {
        let shown = self.shown.as_ref();
        let at_home = |session: &Session| match shown.map(|shown| &shown.frame) {
            Some(frame) if frame.level_bias == 0.0 => session.doubtful_extremes(&frame.scene),
            Some(_) => self.known.doubtful.clone(),
            None => DoubtfulExtremes::default(),
        };
        self.known(at_home, |known| known.doubtful.clone())
    }

    /// The name of the drawing device.
    pub(crate) fn backend_line(&self) -> &str {
        self.known(Session::backend_line, |known| &known.backend_line)
    }

    /// Backend and host memory in use, in bytes.
    pub(crate) fn memory_bytes(&self) -> (u64, u64) {
        let host_bytes = self.status().map_or(0, |status| status.host_bytes);
        (self.known(Session::backend_bytes, |known| known.backend_bytes), host_bytes)
    }

    /// Checks whether a scene can be shown.
    ///
    /// # Errors
    /// If not: the reason.
    pub(crate) fn check(&self, scene: &Scene) -> Result<(), SceneError> {
        check(self.volumes(), scene)
    }

    /// Takes the answers since the last call.
    pub(crate) fn take_answers(&mut self) -> Vec<Answer> {
        std::mem::take(&mut self.changes_seen.answers)
    }

    /// The current draw list of each layer.
    pub(crate) fn draw_lists(&self) -> Vec<&DrawList> {
        self.known(|session| session.draw_lists().collect(), |known| known.draw_lists.iter().collect())
    }

    /// Number of bricks with room in slots.
    pub(crate) fn slots(&self) -> u64 {
        self.known(Session::slots, |known| known.slots)
    }
}

/// Appends an item to the last ones, of which `most` are kept.
pub(crate) fn keep_last<T>(items: &mut VecDeque<T>, most: usize, item: T) {
    if items.len() == most {
        items.pop_front();
    }
    items.push_back(item);
}

fn draws_volumes(device: &Device, options: &SessionOptions) -> bool {
    match options.backend {
        BackendChoice::Cpu => false,
        BackendChoice::Auto => !device.is_software(),
        BackendChoice::Gpu => true,
    }
}

fn gpu(device: &Device) -> Result<Gpu, SessionError> {
    let RenderState { adapter, device, queue, .. } = &device.state;
    let gpu = Gpu::from_device(adapter, device.clone(), queue.clone());
    Ok(gpu.map_err(brickyard::backend::BackendError::from)?)
}
