//! The picture in the window: a live session draws the scene into a texture, on the window's own device or on the CPU, at the quality that the hand's
//! pace allows. At rest it is drawn once more, exactly, and then sample by sample until it is smooth, and then not again. Costs one step and at most one drawing for each frame of the window.

use crate::device::Device;
use crate::marks::Over;
use crate::screen::{FORMAT, Screen};
use brickyard::backend::BackendChoice;
use brickyard::doubtful_extremes::DoubtfulExtremes;
use brickyard::frame_governor::{Change, Quality, QualityControl};
use brickyard::pager::{DrawList, Playback, Status};
use brickyard::render::{Gpu, Target};
use brickyard::session::{ComingStep, Frame, ResolvedScene, Session, SessionError, SessionOptions, VolumeSource};
use brickyard::stats::RenderStats;
use brickyard::volume::{Picture, PixelSamples, Scene, SceneError};
use eframe::egui::{Painter, Rect};
use eframe::egui_wgpu::RenderState;
use std::collections::VecDeque;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// How many frames' times are kept.
const FRAMES: usize = 240;

/// A session and the texture that shows its picture.
pub(crate) struct Canvas {
    session: Session,
    /// Where the picture is seen; `None` as long as the window has no device.
    screen: Option<Screen>,
    /// The window's device, if the session draws there and not on the CPU.
    gpu: Option<Device>,
    control: QualityControl,
    /// Whether the picture is drawn coarser while the view moves.
    pub(crate) is_adaptive: bool,
    /// How time steps are played, as the session was told.
    playback: Option<Playback>,
    shown: Option<Shown>,
    /// How far the last step of streaming was, and which time steps come next; `None` before the first one.
    progress: Option<(Status, Vec<ComingStep>)>,
    /// What the last frames took, oldest first.
    times: VecDeque<FrameTimes>,
    /// What they took since that was last asked.
    spent: FrameTimes,
    captures: VecDeque<Capture>,
}

/// What a frame took.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct FrameTimes {
    /// Streaming: taking in bricks, planning, uploading.
    pub(crate) step: Duration,
    /// Drawing on the CPU, or recording what a GPU draws.
    pub(crate) draw: Duration,
}

/// A picture that is to be written once it is final.
struct Capture {
    scene: Scene,
    /// `None` is the size in which the picture is shown.
    size_px: Option<(u32, u32)>,
    path: PathBuf,
    over: Over,
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

/// What has come of drawing a frame.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Drawn {
    /// The texture shows the picture before.
    Before,
    /// It shows this frame, perhaps without some layers of meshes.
    Partly,
    /// It shows all of this frame.
    Whole,
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
        let session = match gpu_device {
            Some(device) => Session::on_gpu(volumes, options, gpu(device)?),
            None => Session::new(volumes, SessionOptions { backend: BackendChoice::Cpu, ..options }),
        };
        Ok(Self {
            session,
            screen: device.map(|device| Screen::new(&device.state)),
            gpu: gpu_device.cloned(),
            control: QualityControl::new(Duration::from_millis(50)),
            is_adaptive: true,
            playback: None,
            shown: None,
            progress: None,
            times: VecDeque::new(),
            spent: FrameTimes::default(),
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
                self.session.set_gpu(gpu(device)?);
                *known = device.clone();
            }
            _ => {
                let captures = std::mem::take(&mut self.captures);
                *self = Self { captures, ..Self::new(self.session.volumes().to_vec(), options, Some(device))? };
            }
        }
        (self.screen, self.shown) = (Some(Screen::new(&device.state)), None);
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
        self.session.set_volumes(volumes);
        self.shown.iter_mut().for_each(|shown| shown.samples_left = None);
    }

    /// Whether the device is lost on which the picture is drawn.
    fn is_lost(&self) -> bool {
        self.gpu.as_ref().is_some_and(|device| device.lost().is_some())
    }

    /// Sets how long a frame of the window may take while the picture changes, `between` of it for the window itself.
    pub(crate) fn set_frame_goal(&mut self, goal: Duration, between: Duration) {
        // A GPU's own work for a picture is part of the time between frames.
        let between = if self.gpu.is_some() { Duration::ZERO } else { between };
        self.control.set_goal(self.session.drawing_time(goal, between));
    }

    /// Goes on within other limits of memory, in bytes.
    pub(crate) fn set_budgets(&mut self, gpu_memory_bytes: u64, host_memory_bytes: u64) {
        if self.session.set_budgets(gpu_memory_bytes, host_memory_bytes) {
            self.shown.iter_mut().for_each(|shown| shown.samples_left = None);
        }
    }

    /// Asks for a picture of a scene, which is drawn as soon as it is final. `None` is the size in which the picture is shown.
    pub(crate) fn capture(&mut self, scene: Scene, size_px: Option<(u32, u32)>, (path, over): (PathBuf, Over)) {
        self.captures.push_back(Capture { scene, size_px, path, over });
    }

    /// Whether a picture that was asked for has not come yet.
    pub(crate) fn is_capturing(&self) -> bool {
        !self.captures.is_empty()
    }

    /// Streams a step towards the picture that was asked for first, while the texture stays as it is, and returns the picture once it is final.
    ///
    /// # Errors
    /// If it cannot be drawn; it is given up then, unless another device may draw it.
    pub(crate) fn captured(&mut self, size_px: (u32, u32)) -> Result<Option<Captured>, SessionError> {
        let Some(capture) = self.captures.front() else { return Ok(None) };
        // The picture is of the step that its scene says.
        self.session.play(None);
        let drawn = draw_if_final(&mut self.session, &capture.scene, capture.size_px.unwrap_or(size_px));
        // The session's slots are those of another picture now.
        self.shown.iter_mut().for_each(|shown| shown.samples_left = None);
        if drawn.is_err() && !self.is_lost() {
            self.captures.pop_front();
        }
        let Some((picture, frame)) = drawn? else { return Ok(None) };
        let Some(Capture { scene, path, over, .. }) = self.captures.pop_front() else { return Ok(None) };
        self.session.play(self.playback);
        let mut stats = RenderStats::default();
        stats.record(&frame.status, self.session.backend_bytes());
        Ok(Some(Captured { path, picture, scene: frame.scene.shown(&scene), stats, over }))
    }

    /// Brings the texture nearer to a scene's picture of a size: streams a step, and draws unless what is shown still stands.
    ///
    /// # Errors
    /// If the scene cannot be drawn, or the device fails. The texture keeps what it shows.
    pub(crate) fn show(&mut self, scene: &Scene, size_px: (u32, u32)) -> Result<(), SessionError> {
        let is_same = |shown: &Shown| shown.scene == *scene && shown.size_px == size_px;
        if let Some(shown) = self.shown.as_ref().filter(|shown| is_same(shown) && !self.is_playing()) {
            match shown.samples_left {
                Some(0) => return Ok(()),
                Some(_) => return self.smooth(),
                None => {}
            }
        }
        let begun = Instant::now();
        let frame = self.session.step(scene, size_px)?;
        let step = begun.elapsed();
        if let Some(shown) = self.shown.as_mut().filter(|shown| is_same(shown) && self.session.playback().is_some())
            && shown.frame.shows_as_much_as(&frame)
        {
            // Until the next step is due, the picture is as good as it gets.
            self.progress = Some((frame.status, frame.coming));
            self.spent.step += step;
            return Ok(());
        }
        // What still streams is drawn as a moving view is: the exact picture comes once, when all is there.
        let moved = !(self.shown.as_ref().is_some_and(is_same) && frame.status.settled);
        let quality = self.control.next(Change { moved, refined: true }).unwrap_or(Quality::EXACT);
        let quality = if self.is_adaptive { quality } else { Quality::EXACT };
        let begun = Instant::now();
        let drawn = self.draw(&quality.frame(&frame), size_px)?;
        if self.times.len() == FRAMES {
            self.times.pop_front();
        }
        let times = FrameTimes { step, draw: begun.elapsed() };
        self.times.push_back(times);
        self.spent = FrameTimes { step: self.spent.step + times.step, draw: self.spent.draw + times.draw };
        self.progress = Some((frame.status.clone(), frame.coming.clone()));
        if drawn == Drawn::Before {
            self.shown.iter_mut().for_each(|shown| shown.samples_left = None);
            return Ok(());
        }
        if !frame.status.covered {
            // It never happens; tests of the window look for it.
            tracing::error!("a picture has a hole");
        }
        let is_exact = drawn == Drawn::Whole && frame.status.settled && quality == Quality::EXACT;
        let samples_left = is_exact.then(|| match scene.pixel_samples {
            PixelSamples::ONE => 0,
            more => more.count(),
        });
        self.shown = Some(Shown { scene: scene.clone(), size_px, frame, quality, samples_left });
        Ok(())
    }

    /// Draws the next sample of the picture's pixels. When all are drawn, the texture shows their mean.
    ///
    /// # Errors
    /// If the device fails. The texture keeps what it shows.
    fn smooth(&mut self) -> Result<(), SessionError> {
        let (Some(Shown { scene, frame, size_px, samples_left: Some(left), .. }), Some(screen)) =
            (&mut self.shown, &mut self.screen)
        else {
            return Ok(());
        };
        let samples = scene.pixel_samples;
        let Some(sample) = samples.samples().nth(samples.count() - *left) else { return Ok(()) };
        let (frame, is_first) = (frame.of_sample(sample), *left == samples.count());
        let begun = Instant::now();
        let is_drawn = match &self.gpu {
            None => {
                screen.add(&self.session.draw(&frame)?, is_first);
                true
            }
            Some(Device { state, .. }) => {
                let target = Target { view: screen.sample(*size_px), format: FORMAT, area_px: None };
                let mut encoder = state.device.create_command_encoder(&Default::default());
                let is_this = self.session.draw_to(&frame, &target, &mut encoder)?;
                if is_this {
                    screen.add_sample(&mut encoder, is_first, samples);
                }
                state.queue.submit([encoder.finish()]);
                is_this
            }
        };
        self.spent.draw += begun.elapsed();
        if is_drawn {
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
            self.session.play(playback);
            self.shown.iter_mut().for_each(|shown| shown.samples_left = None);
        }
    }

    /// Whether time steps are played: not any more once the last one is shown of a playback that stops there.
    pub(crate) fn is_playing(&self) -> bool {
        self.session.playback().is_some()
    }

    /// The time step that is shown; `None` before the first picture, and while another one is sought.
    pub(crate) fn step_shown(&self) -> Option<u32> {
        self.shown.as_ref().filter(|_| !self.session.is_seeking()).map(|shown| shown.frame.scene.time)
    }

    /// The time step of the picture that is seen; `None` before the first one.
    pub(crate) fn step_seen(&self) -> Option<u32> {
        self.shown.as_ref().map(|shown| shown.frame.scene.time)
    }

    /// The time steps that come next.
    pub(crate) fn coming(&self) -> &[ComingStep] {
        self.progress.as_ref().map_or(&[], |(_, coming)| coming)
    }

    /// Draws a frame into the texture, which has `size_px` pixels on a GPU. While there is nothing of the frame in some place, the texture stays as it is.
    fn draw(&mut self, frame: &Frame, size_px: (u32, u32)) -> Result<Drawn, SessionError> {
        let Some(screen) = &mut self.screen else { return Ok(Drawn::Before) };
        let Some(Device { state, .. }) = &self.gpu else {
            if self.session.shows_before(frame) {
                return Ok(Drawn::Before);
            }
            let begun = Instant::now();
            let picture = self.session.draw(frame)?;
            self.control.took(begun.elapsed());
            screen.put(&picture, (picture.width, picture.height) != size_px);
            return Ok(Drawn::Whole);
        };
        let target = Target { view: screen.sized(size_px), format: FORMAT, area_px: None };
        let mut encoder = state.device.create_command_encoder(&Default::default());
        let is_this = self.session.draw_to(frame, &target, &mut encoder)?;
        state.queue.submit([encoder.finish()]);
        self.session.gpu_time().into_iter().for_each(|time| self.control.took(time));
        Ok(match self.session.shown() {
            _ if is_this => Drawn::Whole,
            Some(shown) if shown.is_copy_of(frame) => Drawn::Partly,
            _ => Drawn::Before,
        })
    }

    /// Puts the picture over a part of the window; nothing before the first one.
    pub(crate) fn paint(&self, painter: &Painter, area: Rect) {
        self.screen.iter().for_each(|screen| screen.paint(painter, area));
    }

    /// Whether the picture is as it will stay until the scene changes.
    pub(crate) fn is_final(&self) -> bool {
        self.shown.as_ref().is_some_and(|shown| shown.samples_left == Some(0))
    }

    /// How far the view is; `None` before the first step.
    pub(crate) fn status(&self) -> Option<&Status> {
        self.progress.as_ref().map(|(status, _)| status)
    }

    /// The share of the exact picture's work that was done for the one that is shown.
    pub(crate) fn quality(&self) -> f64 {
        self.shown.as_ref().map_or(0.0, |shown| shown.quality.share())
    }

    /// The scene that is shown, with nothing left open, and its volumes; `None` before the first picture.
    pub(crate) fn resolved(&self) -> (Option<&Arc<ResolvedScene>>, &[VolumeSource]) {
        (self.shown.as_ref().map(|shown| &shown.frame.scene), self.session.volumes())
    }

    /// Layers of the picture with doubtful extremes; none before the first picture.
    pub(crate) fn doubtful_extremes(&self) -> DoubtfulExtremes {
        let shown = self.shown.as_ref();
        shown.map_or_else(Default::default, |shown| self.session.doubtful_extremes(&shown.frame.scene))
    }

    /// A line that says where the picture is drawn.
    pub(crate) fn backend_line(&self) -> &str {
        self.session.backend_line()
    }

    /// Bytes of the backend's memory, and of host memory, in use.
    pub(crate) fn memory_bytes(&self) -> (u64, u64) {
        (self.session.backend_bytes(), self.status().map_or(0, |status| status.host_bytes))
    }

    /// Whether a scene can be shown.
    ///
    /// # Errors
    /// If not: the reason.
    pub(crate) fn check(&self, scene: &Scene) -> Result<(), SceneError> {
        self.session.check(scene)
    }

    /// What the last frames took, oldest first.
    pub(crate) fn times(&self) -> &VecDeque<FrameTimes> {
        &self.times
    }

    /// What frames took since this was last asked.
    pub(crate) fn take_spent(&mut self) -> FrameTimes {
        std::mem::take(&mut self.spent)
    }

    /// The draw list of each layer, for which pictures are drawn now.
    pub(crate) fn draw_lists(&self) -> impl Iterator<Item = &DrawList> {
        self.session.draw_lists()
    }

    /// Number of bricks that slots hold at most.
    pub(crate) fn slots(&self) -> u64 {
        self.session.slots()
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

/// Streams a step towards a scene's picture; returns the picture, and its frame, if it is final.
fn draw_if_final(
    session: &mut Session,
    scene: &Scene,
    size_px: (u32, u32),
) -> Result<Option<(Picture, Frame)>, SessionError> {
    let frame = session.step(scene, size_px)?;
    let is_whole = frame.status.settled || frame.status.awaits_feedback;
    if !is_whole {
        return Ok(None);
    }
    // Drawing tells what was seen, after which more may be wanted.
    let picture = session.draw(&frame)?;
    if !frame.status.settled {
        return Ok(None);
    }
    let picture = match scene.pixel_samples {
        PixelSamples::ONE => picture,
        samples => samples.picture(|sample| session.draw(&frame.of_sample(sample)))?,
    };
    Ok(Some((picture, frame)))
}
