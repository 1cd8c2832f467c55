//! Sessions: volumes shown through one backend, for any number of scenes and frames. A scene becomes a view for each
//! pager and frames for the renderer; every step moves bricks towards the views, and returns a frame to draw.
//!
//! Order of calls: open (reads the metadata), then for each frame [`Session::step`] and [`Session::draw`]; or
//! [`Session::render`], which steps until the picture has settled. The first step creates the backend, some 100 ms; so
//! does a scene with greater demands than all before it (see `fit`). A step of a live session never waits for the disk.
//! Calls come from one thread; the session's own threads decode bricks, plan the cuts of live sessions, compile
//! shaders, make transfer tables and draw on the CPU.

pub mod backend;
pub mod channels;
pub(crate) mod device;
pub(crate) mod device_losses;
pub mod doubtful_extremes;
#[cfg(feature = "gpu")]
pub(crate) mod embedding;
pub mod first_look;
pub(crate) mod fit;
pub(crate) mod frame;
pub mod frame_governor;
#[cfg(feature = "gpu")]
pub(crate) mod gpu_backend;
pub(crate) mod options;
pub(crate) mod player;
pub(crate) mod renderer;
pub(crate) mod resolve;
pub(crate) mod session_error;
pub(crate) mod shown_picture;
pub(crate) mod slot_change;
pub(crate) mod table_cache;
#[cfg(feature = "gpu")]
pub(crate) mod trial;
pub(crate) mod unfinished_rays;
pub mod unlike_sizes;
pub(crate) mod volume_source;

use crate::session::channels::default_layers;
use crate::session::device::Device;
use crate::session::device_losses::Losses;
use crate::session::first_look::set_first_look;
use crate::session::fit::{Demand, Fit};
#[cfg(feature = "gpu")]
pub use crate::session::frame::Drawn;
pub use crate::session::frame::Frame;
use crate::session::frame_governor::drawing_time;
use crate::session::options::CompositorChoice;
pub use crate::session::options::SessionOptions;
pub use crate::session::player::ComingStep;
use crate::session::player::Player;
use crate::session::renderer::{BackendError, Renderer};
use crate::session::resolve::resolve_with;
pub use crate::session::resolve::{HiddenLayer, ResolvedLayer, ResolvedScene, check, resolve};
pub use crate::session::session_error::SessionError;
use crate::session::shown_picture::ShownPicture;
use crate::session::slot_change::{Shot, SlotChange};
use crate::session::table_cache::VolumeTables;
pub use crate::session::volume_source::VolumeSource;
use brickyard_pager::{Counters, DrawList, KeptCores, Playback, Policy, Readiness, ShownStep, Status, Tally, View};
pub use brickyard_software::{KeptTiles, Painting};
use brickyard_volume::{
    FloatSlots, FrameSettings, KeptSlots, Mode, Picture, Scene, SceneError, SlotEncoding, TransferFunction,
};
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Counters of earlier backends and pagers.
#[derive(Clone, Copy, Debug, Default)]
struct Past {
    counters: Counters,
    host_bytes_peak: u64,
}

impl Past {
    fn add_to(&self, status: &mut Status) {
        status.counters = self.counters.and(&status.counters);
        status.host_bytes_peak = self.host_bytes_peak.max(status.host_bytes_peak);
    }
}

/// Shows volumes through one backend, within memory budgets. A session belongs to one thread and lives as long as its
/// volumes are viewed. Scene, picture size and time step may change with every frame.
///
/// ```no_run
/// use brickyard::session::{Session, SessionOptions};
/// use brickyard::volume::Mode;
///
/// let mut session = Session::open("head-ct.zarr", SessionOptions::default())?;
/// let scene = session.default_scene(Mode::Dvr);
/// session.render(&scene, (640, 480))?.save("out.png")?;
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Session {
    volumes: Vec<VolumeSource>,
    pub(crate) options: SessionOptions,
    /// One for each volume.
    tables: Vec<VolumeTables>,
    pub(crate) device: Device,
    /// Decoded cores of a lost device.
    kept: Vec<KeptCores>,
    /// The backend and its pagers; `None` before the first step, and after a failure to create them.
    pub(crate) fit: Option<Fit>,
    /// Counts before the present fit, and as of the last step.
    past: Past,
    counted: Past,
    pub(crate) steps: u64,
    /// The views of the last step, and whether they had settled.
    last: Option<(Vec<View>, bool)>,
    losses: Losses,
    /// Deadline for pictures; `None` is no deadline.
    pub(crate) draw_until: Option<Instant>,
    /// Shows the picture in progress to other threads, if any.
    painting: Option<Arc<Painting>>,
    /// The latest picture; `None` before the first one, and once it is lost.
    pub(crate) shown: Option<ShownPicture>,
    /// Start of a live session; `None` if it is not live.
    clock: Option<Instant>,
    pub(crate) slot_change: SlotChange,
    player: Player,
    /// Smoothed time of a step.
    streaming: Duration,
}

impl Session {
    /// Opens a store as a session. Scenes may show several of its channels.
    ///
    /// # Errors
    /// If there is no store at this path, or it is unfinished or damaged.
    pub fn open(store: impl AsRef<Path>, options: SessionOptions) -> Result<Self, SessionError> {
        Ok(Self::new(vec![VolumeSource::open(store)?], options))
    }

    /// Creates a session of several volumes; scenes refer to them by index. Nothing is read or allocated before the
    /// first step.
    pub fn new(volumes: Vec<VolumeSource>, options: SessionOptions) -> Self {
        Self {
            tables: volumes.iter().map(|volume| volume.tables(options.live)).collect(),
            volumes,
            options,
            device: Device::default(),
            kept: Vec::new(),
            fit: None,
            past: Past::default(),
            counted: Past::default(),
            steps: 0,
            last: None,
            losses: Losses::default(),
            draw_until: None,
            painting: None,
            shown: None,
            clock: options.live.then(Instant::now),
            slot_change: SlotChange::default(),
            player: Player::default(),
            streaming: Duration::ZERO,
        }
    }

    /// Returns a scene of every visible channel of every volume, each in its own window and colour, with its [first
    /// look](crate::session::first_look).
    pub fn default_scene(&self, mode: Mode) -> Scene {
        let mut scene = Scene { mode, layers: default_layers(&self.volumes), ..Scene::default() };
        set_first_look(&mut scene, &self.volumes);
        scene
    }

    /// Checks whether the session's volumes can show a scene. Creates nothing.
    ///
    /// # Errors
    /// If the scene is invalid.
    pub fn check(&self, scene: &Scene) -> Result<(), SceneError> {
        check(&self.volumes, scene)
    }

    /// Resolves a scene for the session's volumes: fills in the camera and transfer functions left open, and makes
    /// missing transfer tables.
    ///
    /// # Errors
    /// The errors of [`resolve`], and an error if the compositor has no order for the scene's layers.
    pub fn resolve(&self, scene: &Scene, size_px: (u32, u32)) -> Result<ResolvedScene, SessionError> {
        self.resolve_for(scene, size_px, KeptSlots::replaceable)
    }

    /// Resolves a scene. `kept` decides whether existing slots of codes or floats may be replaced.
    fn resolve_for(
        &self,
        scene: &Scene,
        size_px: (u32, u32),
        kept: impl Fn(Option<FloatSlots>) -> KeptSlots,
    ) -> Result<ResolvedScene, SessionError> {
        let table = |volume: usize, channel: u32, transfer: &TransferFunction, encoding: &SlotEncoding| {
            self.tables[volume].of(channel).table(transfer, encoding)
        };
        for (i, tables) in self.tables.iter().enumerate() {
            let layers = (0..scene.layers.len()).filter(|&layer| scene.store(layer) == i);
            tables.expect(layers.map(|layer| &scene.layers[layer]), scene);
        }
        let slots = |place, volume| self.fit.as_ref().and_then(|fit| fit.slots_of(place, volume));
        let kept = |place, volume| slots(place, volume).map_or_else(KeptSlots::default, |slots| kept(slots.floats));
        let mut resolved = resolve_with(&self.volumes, scene, size_px, table, kept)?;
        self.check_order(&resolved)?;
        for layer in &mut resolved.layers {
            layer.view.opaque = layer.view.opaque.filter(|_| self.options.skips_empty);
        }
        Ok(resolved)
    }

    /// Refuses scenes without an order for the sorted compositor.
    fn check_order(&self, scene: &ResolvedScene) -> Result<(), SessionError> {
        let is_sorted = self.options.compositor == CompositorChoice::Sorted;
        if !is_sorted || self.has_order(scene) { Ok(()) } else { Err(SessionError::NoOrder) }
    }

    /// Whether the sorted compositor can draw a scene. Fog and surfaces in cells of unlike grids have no common order
    /// from back to front, so they take rays.
    fn has_order(&self, scene: &ResolvedScene) -> bool {
        let first = &scene.layers[0];
        let is_on_its_grid = |layer: &ResolvedLayer| {
            let [pyramid, of_first] = [layer, first].map(|layer| self.volumes[layer.volume].source.pyramid());
            let [own, other] = [layer, first].map(|layer| &layer.frames[0].settings);
            let slots = |settings: &FrameSettings| {
                let SlotEncoding { format, has_invalid, is_labels, .. } = settings.encoding;
                (format, has_invalid, is_labels)
            };
            let is_one_place = own.geometry == other.geometry && own.placement == other.placement;
            pyramid == of_first && is_one_place && slots(own) == slots(other)
        };
        first.frames[0].settings.mode.is_projection() || scene.layers.iter().all(is_on_its_grid)
    }

    /// Creates the backend and the pagers for a scene, unless the present ones suffice. The first step of a scene does
    /// so too; call this to learn the backend earlier.
    ///
    /// # Errors
    /// If no backend can be created, it lacks the compositor, or a budget is too small; the message names the least
    /// sufficient budget.
    pub fn fit(&mut self, scene: &ResolvedScene) -> Result<(), SessionError> {
        let asked = Demand::of(scene, self.options.live);
        if self.fit.as_ref().is_some_and(|fit| fit.suffices(scene, &asked)) {
            return Ok(());
        }
        let before = self.fit.as_ref().map(|fit| fit.demand.clone());
        self.end_fit();
        let Self { volumes, options, device, kept, .. } = self;
        let mut kept = std::mem::take(kept);
        let mut make = |demand| Fit::make(volumes, demand, options, device, &mut kept);
        // An earlier scene may return. If memory is too small for both, this one alone counts.
        let grown = before.map(|before| asked.grown(&before)).filter(|grown| *grown != asked);
        let made = match grown {
            Some(grown) => make(grown).or_else(|_| make(asked)),
            None => make(asked),
        };
        let keeps_picture = made.as_ref().is_ok_and(|fit| fit.backend.keeps_picture());
        self.shown.take_if(|shown| shown.is_on_device() && !keeps_picture);
        self.fit = Some(made?);
        Ok(())
    }

    /// Ends the backend and its pagers. Decoded bricks and the shown picture stay.
    fn end_fit(&mut self) {
        (self.past, self.last) = (self.counted, None);
        #[cfg(feature = "gpu")]
        self.device.trial.forget_pictures();
        self.player.forget();
        if let Some(fit) = self.fit.take() {
            let keeps_picture = self.shown.as_ref().is_some_and(ShownPicture::is_on_device);
            self.kept = fit.into_cores(&mut self.device, keeps_picture);
        }
    }

    /// Continues with backends on another device. Decoded bricks stay.
    #[cfg(feature = "gpu")]
    pub(crate) fn move_to(&mut self, device: Device) {
        self.end_fit();
        self.shown.take_if(|shown| shown.is_on_device());
        self.device = device;
    }

    /// Sets new budgets in bytes: the backend's, whichever it is, and [`SessionOptions::host_memory_bytes`]. The next
    /// step allocates slots within them, and fills these from decoded bricks. Returns whether a budget changed.
    pub fn set_budgets(&mut self, backend_bytes: u64, host_memory_bytes: u64) -> bool {
        let SessionOptions { gpu_memory_bytes, cpu_memory_bytes, host_memory_bytes: host, .. } = self.options;
        if (gpu_memory_bytes, cpu_memory_bytes, host) == (backend_bytes, backend_bytes, host_memory_bytes) {
            return false;
        }
        (self.options.gpu_memory_bytes, self.options.cpu_memory_bytes) = (backend_bytes, backend_bytes);
        self.options.host_memory_bytes = host_memory_bytes;
        self.end_fit();
        true
    }

    /// Replaces the volumes by later states of them, such as stores with more time steps. Playback continues. The next
    /// step fills the slots anew; a live session shows the previous picture until the new one is covered everywhere.
    pub fn set_volumes(&mut self, volumes: Vec<VolumeSource>) {
        self.end_fit();
        self.kept.clear();
        self.tables = volumes.iter().map(|volume| volume.tables(self.options.live)).collect();
        self.volumes = volumes;
    }

    /// Makes the tables of a transfer function on other threads, ahead of showing it. Other scenes can be drawn until
    /// [`Session::is_prepared`] returns `true`. A scene with this function resolved sooner makes them itself, in the
    /// same time.
    pub fn prepare(&self, transfer: &TransferFunction) {
        self.tables.iter().flat_map(VolumeTables::in_use).for_each(|tables| tables.prepare(transfer));
    }

    /// Whether the tables of a transfer function are there, so a scene with it resolves at once.
    pub fn is_prepared(&self, transfer: &TransferFunction) -> bool {
        self.tables.iter().flat_map(VolumeTables::in_use).all(|tables| tables.is_prepared(transfer))
    }

    /// Prepares the drawing of a scene on another thread, for example by compiling shaders. Other scenes can be drawn
    /// until [`Session::is_scene_prepared`] returns `true`; drawing this one sooner waits. Does nothing for a scene
    /// that needs another backend.
    pub fn prepare_scene(&mut self, scene: &ResolvedScene) {
        let asked = Demand::of(scene, self.options.live);
        if let Some(fit) = self.fit.as_mut().filter(|fit| fit.suffices(scene, &asked)) {
            fit.prepare(scene);
        }
    }

    /// Whether nothing is left to prepare for a scene, or nothing can be prepared before its first step.
    pub fn is_scene_prepared(&self, scene: &ResolvedScene) -> bool {
        let asked = Demand::of(scene, self.options.live);
        self.fit.as_ref().is_none_or(|fit| !fit.suffices(scene, &asked) || fit.is_prepared(scene))
    }

    /// Takes one step of streaming towards a picture of a scene: collects arrived bricks, uploads them, and requests
    /// others. The returned frame can be drawn until the next step.
    ///
    /// # Errors
    /// If the scene is invalid, a budget is too small for it, there is no device (any more), or a part of the settled
    /// picture can be drawn from no level at all.
    pub fn step(&mut self, scene: &Scene, size_px: (u32, u32)) -> Result<Frame, SessionError> {
        self.step_coarse(scene, size_px, 0.0)
    }

    /// Like [`Session::step`], with bricks `level_bias` levels coarser than the scene asks for. Suits pictures of fewer
    /// pixels: they look the same, draw several times faster, and wait for fewer bricks. Never reports the view as
    /// settled.
    ///
    /// # Errors
    /// The errors of [`Session::step`].
    pub fn step_coarse(&mut self, scene: &Scene, size_px: (u32, u32), level_bias: f64) -> Result<Frame, SessionError> {
        self.suit(scene)?;
        let shot = Shot { scene: scene.clone(), size_px };
        let is_put_off = self.puts_off_slots(scene);
        let kept = if is_put_off { KeptSlots::fixed } else { KeptSlots::replaceable };
        let resolved = self.resolve_for(scene, size_px, kept)?;
        self.slot_change.begin_step(&shot, is_put_off);
        let mut frame = self.step_biased(&resolved, level_bias)?;
        let is_whole = frame.status.settled || frame.status.awaits_feedback;
        self.slot_change.end_step(shot, is_whole);
        let is_coarse = level_bias > 0.0;
        frame.status.settled &= !is_put_off && !is_coarse;
        frame.status.awaits_feedback &= !is_coarse;
        Ok(frame)
    }

    fn puts_off_slots(&mut self, scene: &Scene) -> bool {
        let is_valid = self.check(scene).is_ok();
        let Self { fit: Some(fit), volumes, clock: Some(clock), slot_change, .. } = self else { return false };
        is_valid && slot_change.is_put_off(fit, volumes, scene, clock.elapsed())
    }

    /// Opens the pyramids for the scene's mode: maxima for maximum projections, where a store has them.
    pub(crate) fn suit(&mut self, scene: &Scene) -> Result<(), SessionError> {
        let mut is_other = false;
        for volume in &mut self.volumes {
            if let Some(suited) = volume.for_mode(scene.mode)? {
                *volume = suited;
                is_other = true;
            }
        }
        if is_other {
            // Its slots hold bricks of another pyramid.
            self.end_fit();
            self.kept.clear();
        }
        Ok(())
    }

    /// Takes a step like [`Session::step`], towards a scene [resolved](Session::resolve) for these volumes. In a live
    /// session the frame's scene is at the shown time step; during playback this is not the requested one.
    ///
    /// # Errors
    /// The errors of [`Session::step`].
    pub fn step_resolved(&mut self, scene: &ResolvedScene) -> Result<Frame, SessionError> {
        self.step_biased(scene, 0.0)
    }

    fn step_biased(&mut self, scene: &ResolvedScene, level_bias: f64) -> Result<Frame, SessionError> {
        self.fit(scene)?;
        self.check_precision(scene)?;
        let begun = Instant::now();
        let (mut shown, next) = match self.clock {
            Some(began) => self.player.turn(scene, began.elapsed()),
            None => (ShownStep { step: scene.time, level_bias: 0.0 }, Vec::new()),
        };
        shown.level_bias += level_bias;
        let at_step = |step: &ShownStep| self.fit.as_ref().map(|fit| fit.views_at(scene, *step)).unwrap_or_default();
        let (views, coming) = (at_step(&shown), next.iter().map(at_step).collect::<Vec<_>>());
        self.steps += 1;
        let (mut status, ready) = self.step_to(views, &coming)?;
        let coming: Vec<_> = next.into_iter().zip(ready).map(|(step, ready)| ComingStep { step, ready }).collect();
        // Before the check: playback continues past an unreadable step.
        self.player.coming.clone_from(&coming);
        check_readable(&status)?;
        status.settled &= !self.player.is_seeking();
        self.streaming = self.streaming.mul_f64(0.8) + begun.elapsed().mul_f64(0.2);
        Ok(Frame { scene: Arc::new(scene.at_step(shown.step)), status, coming, level_bias, step: self.steps })
    }

    /// Refuses an expression whose values the backend would compute imprecisely.
    fn check_precision(&self, scene: &ResolvedScene) -> Result<(), SessionError> {
        let (Some(combination), Some(backend)) = (&scene.combination, self.backend()) else { return Ok(()) };
        let is_single = backend.name() != "cpu";
        let operand = |layer: &ResolvedLayer| {
            let range = self.volumes[layer.volume].source.channel_range(layer.view.channel);
            layer.frames[0].settings.encoding.operand(range, is_single)
        };
        let operands: Vec<_> = scene.layers.iter().map(operand).collect();
        let checked = combination.expression.check_precision(&operands, is_single);
        checked.map_err(|error| SessionError::Precision { backend: if is_single { "a GPU" } else { "the CPU" }, error })
    }

    /// Steps the fit, renewing a lost device.
    fn step_to(&mut self, views: Vec<View>, coming: &[Vec<View>]) -> Result<(Status, Vec<Readiness>), SessionError> {
        let at = self.clock.map_or(Duration::ZERO, |began| began.elapsed());
        let stepped = loop {
            let Some(fit) = &mut self.fit else { return Err(SceneError::NothingVisible.into()) };
            match fit.step(&views, coming, at) {
                Ok(stepped) => break stepped,
                Err(error) => self.recover(error)?,
            }
        };
        let (mut status, ready) = stepped.ok_or(SceneError::NothingVisible)?;
        self.past.add_to(&mut status);
        self.counted = Past { counters: status.counters, host_bytes_peak: status.host_bytes_peak };
        self.last = Some((views, status.settled));
        Ok((status, ready))
    }

    /// Returns the time for drawing within `frame_goal`, after streaming and the caller's own `besides`. If a step rate
    /// is held, frames also keep in step with the time steps.
    pub fn drawing_time(&self, frame_goal: Duration, besides: Duration) -> Duration {
        let held = self.playback().filter(|playback| playback.policy == Policy::HoldRate);
        drawing_time(frame_goal, held.map(|playback| playback.steps_per_second), self.streaming + besides)
    }

    /// Waits for at most `timeout` until a brick arrives or a time step is due. Returns at once before the first step.
    pub fn wait(&mut self, timeout: Duration) {
        let timeout = self.next_due().map_or(timeout, |due| timeout.min(due));
        self.fit.iter_mut().for_each(|fit| fit.wait(timeout));
    }

    /// Plays the time steps of a live session from the shown one on, or changes the playback; `None` stops it. From the
    /// next step of streaming on, frames show the steps that are due. A new time step in the scene is a jump there.
    pub fn play(&mut self, playback: Option<Playback>) {
        self.player.play(playback.filter(|_| self.options.live));
    }

    /// The present playback; `None` while stopped. It ends by itself if set to stop at the last step.
    pub fn playback(&self) -> Option<Playback> {
        self.player.playback()
    }

    /// Whether a jump to a time step is still pending.
    pub fn is_seeking(&self) -> bool {
        self.player.is_seeking()
    }

    /// Counts of time steps shown during playback, and of those late or skipped.
    pub fn playback_tally(&self) -> Tally {
        self.player.tally()
    }

    /// Time until the next time step is due; `None` if none is.
    pub fn next_due(&self) -> Option<Duration> {
        let due = self.player.next_due()?;
        self.clock.map(|began| due.saturating_sub(began.elapsed()))
    }

    /// Renders the last step's frame from the bricks in the slots, with one sample of each pixel, both eyes from the
    /// same bricks. A lost device is created anew, with its slots refilled as far as before. The picture is then the
    /// same, but takes as long as the first one of its view.
    ///
    /// A live session returns the previous picture, in its own size, if [`Session::shows_before`] is true.
    ///
    /// # Errors
    /// If the frame is an earlier step's, there is no device any more, or the device is out of memory.
    pub fn draw(&mut self, frame: &Frame) -> Result<Picture, SessionError> {
        // Feedback makes the pager drop hidden bricks. Only while the camera moves: for one picture, finding the hidden
        // bricks takes more drawing than reading them, and an edit of the transfer function could reveal them.
        let tells = self.options.live;
        if let Some(ShownPicture { pixels: Some(before), .. }) = &self.shown
            && self.shows_before(frame)
        {
            return Ok(before.clone());
        }
        // It is in the target overwritten here.
        self.shown.take_if(|shown| shown.is_on_device());
        loop {
            let Some(fit) = self.fit.as_mut().filter(|_| frame.step == self.steps) else {
                return Err(SessionError::Superseded);
            };
            fit.backend.draw_until(self.draw_until);
            fit.backend.draw_within(frame.scene.layers[0].view.window);
            fit.backend.draw_on(self.painting.clone());
            match fit.draw(&frame.scene, tells) {
                Ok(picture) => {
                    self.losses.picture();
                    if self.options.live && frame.status.covered {
                        self.shown = Some(ShownPicture { frame: frame.clone(), pixels: Some(picture.clone()) });
                    }
                    return Ok(picture);
                }
                Err(error) => self.recover(error)?,
            }
            self.refill()?;
        }
    }

    /// Draws like [`Session::draw`], for an onlooker: on the CPU, other threads can see the picture so far on the
    /// painting, and abandon it there.
    ///
    /// # Errors
    /// The errors of [`Session::draw`], and an error if the picture was abandoned.
    pub fn paint(&mut self, frame: &Frame, painting: &Arc<Painting>) -> Result<Picture, SessionError> {
        self.painting = Some(painting.clone());
        let drawn = self.draw(frame);
        self.painting = None;
        drawn
    }

    /// Whether drawing this frame, the last step's, shows the previous picture instead: while some place of the frame
    /// has no brick yet, as after a change of volumes, layers, budgets or devices, and while a live session fills slots
    /// of another format for a narrower or wider window. Without a previous picture, drawing shows the background
    /// alone.
    pub fn shows_before(&self, frame: &Frame) -> bool {
        let is_held = || self.shown.is_some() && self.slot_change.shows_before();
        frame.step == self.steps && (!frame.status.covered || is_held())
    }

    /// The last drawn frame of a live session, by [`Session::draw`] or [`Session::draw_to`]; `None` before the first
    /// one, and once its picture is lost.
    pub fn shown(&self) -> Option<&Frame> {
        self.shown.as_ref().map(|shown| &shown.frame)
    }

    /// Creates a lost device anew, with empty slots. Returns other errors, and the loss of an application's own device.
    fn recover(&mut self, error: BackendError) -> Result<(), SessionError> {
        if self.device.is_lent() {
            return Err(error.into());
        }
        self.losses.record(error)?;
        self.player.forget();
        self.fit.as_mut().map_or(Ok(()), Fit::renew)
    }

    /// Streams the last step's views again: until settled if they were, otherwise until covered everywhere.
    fn refill(&mut self) -> Result<(), SessionError> {
        let Some((views, was_settled)) = self.last.clone() else { return Ok(()) };
        loop {
            let (status, _) = self.step_to(views.clone(), &[])?;
            check_readable(&status)?;
            if status.settled || status.awaits_feedback || status.covered && !was_settled {
                return Ok(());
            }
            self.wait(Duration::from_millis(50));
        }
    }

    /// Number of losses of the GPU device so far.
    pub fn device_losses(&self) -> u32 {
        self.losses.total
    }

    /// Description of the backend: `gpu, llvmpipe (...)` or `cpu, 2 threads`. Empty before the first step.
    pub fn backend_line(&self) -> &str {
        self.fit.as_ref().map_or("", |fit| &fit.backend_line)
    }

    /// The backend; `None` before the first step.
    pub fn backend(&self) -> Option<&dyn Renderer> {
        self.fit.as_ref().map(|fit| &*fit.backend)
    }

    /// Bytes of the backend's memory: slots, tables, targets and staging; 0 before the first step.
    pub fn backend_bytes(&self) -> u64 {
        self.backend().map_or(0, Renderer::bytes)
    }

    /// The volumes, each with the pyramid for the last step's mode.
    pub fn volumes(&self) -> &[VolumeSource] {
        &self.volumes
    }

    /// Number of slots, the capacity in bricks of all layers; 0 before the first step.
    pub fn slots(&self) -> u64 {
        self.fit.as_ref().map_or(0, Fit::slots)
    }

    /// Returns the present draw list of each layer; in stereo the left eye's.
    pub fn draw_lists(&self) -> impl Iterator<Item = &DrawList> {
        self.fit.iter().flat_map(Fit::draw_lists)
    }

    /// Returns the present draw lists of the layer at this index of the scene, one for each eye.
    pub(crate) fn lists_of(&self, place: usize) -> &[DrawList] {
        self.fit.as_ref().map_or(&[], |fit| fit.lists_of(place))
    }
}

/// Refuses a view with a part that no level can draw.
fn check_readable(status: &Status) -> Result<(), SessionError> {
    status.error.clone().map_or(Ok(()), |error| Err(SessionError::Unreadable(error)))
}
