//! A session: volumes shown through one backend, for as many scenes and frames as one likes. A scene becomes a view for each pager and frames
//! for the renderer; every step moves bricks towards what the views want, and what a step returned can be drawn.
//!
//! Order of calls: open (the metadata is read), then for each frame [`Session::step`] and [`Session::draw`]; or [`Session::render`], which
//! steps until nothing more comes. The first step makes the backend, some 100 ms; so does a scene that asks for more than those before it
//! (see `fit`). A step of a live session never waits for
//! the disk. Calls come from one thread; threads of the session's own decode bricks, plan the cuts of live sessions, compile shaders, make
//! transfer tables and draw on the CPU.

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

/// What was counted before the backend and its pagers were last made anew.
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

/// Shows volumes through one backend, within memory budgets. A session is used by one thread, and lives as long as the
/// volumes are looked at. Scenes, sizes of pictures and time steps may change with every frame.
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
    /// What was decoded for a device that is lost.
    kept: Vec<KeptCores>,
    /// The backend and its pagers; `None` before the first step, and after a step that could not make them.
    pub(crate) fit: Option<Fit>,
    /// What was counted before it was made, and with the last step.
    past: Past,
    counted: Past,
    /// Number of steps so far.
    pub(crate) steps: u64,
    /// The views of the last step, and whether they had settled.
    last: Option<(Vec<View>, bool)>,
    losses: Losses,
    /// When pictures are given up; `None` never.
    pub(crate) draw_until: Option<Instant>,
    /// Where the picture is seen while it is drawn; `None` nowhere.
    painting: Option<Arc<Painting>>,
    /// The picture that was shown last; `None` before the first one, and where it is lost.
    pub(crate) shown: Option<ShownPicture>,
    /// When it began, if it is live.
    clock: Option<Instant>,
    /// A live session's change of what slots hold.
    pub(crate) slot_change: SlotChange,
    /// Which time step a live session shows.
    player: Player,
    /// Smoothed time that a step takes.
    streaming: Duration,
}

impl Session {
    /// Opens a store and makes a session of it. Scenes may show several of its channels.
    ///
    /// # Errors
    /// If there is no store at this path, or it is unfinished or damaged.
    pub fn open(store: impl AsRef<Path>, options: SessionOptions) -> Result<Self, SessionError> {
        Ok(Self::new(vec![VolumeSource::open(store)?], options))
    }

    /// Makes a session of several volumes. Scenes name them by their index in `volumes`. Nothing is read or made before
    /// the first step.
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

    /// The scene that shows every visible channel of every volume in a mode, each in its own window and colour, as it is [shown first](crate::session::first_look).
    pub fn default_scene(&self, mode: Mode) -> Scene {
        let mut scene = Scene { mode, layers: default_layers(&self.volumes), ..Scene::default() };
        set_first_look(&mut scene, &self.volumes);
        scene
    }

    /// Whether a scene can be shown of the session's volumes. Nothing is made for it.
    ///
    /// # Errors
    /// If not: what is wrong with the scene.
    pub fn check(&self, scene: &Scene) -> Result<(), SceneError> {
        check(&self.volumes, scene)
    }

    /// Resolves a scene for the session's volumes: fills in the camera and transfer functions that are left open, and
    /// makes transfer tables that are not kept.
    ///
    /// # Errors
    /// As [`resolve`]; and if the compositor has no order for the scene's layers.
    pub fn resolve(&self, scene: &Scene, size_px: (u32, u32)) -> Result<ResolvedScene, SessionError> {
        self.resolve_for(scene, size_px, KeptSlots::replaceable)
    }

    /// Resolves a scene. `kept` says whether slots that there are, and hold codes or floats, may be replaced.
    fn resolve_for(
        &self,
        scene: &Scene,
        size_px: (u32, u32),
        kept: impl Fn(Option<FloatSlots>) -> KeptSlots,
    ) -> Result<ResolvedScene, SessionError> {
        let table = |(volume, channel): (usize, u32), transfer: &TransferFunction, encoding: &SlotEncoding| {
            self.tables[volume].of(channel).table(transfer, encoding)
        };
        for (i, tables) in self.tables.iter().enumerate() {
            let layers = (0..scene.layers.len()).filter(|&layer| scene.store(layer) == i);
            tables.expect(layers.map(|layer| &scene.layers[layer]), scene);
        }
        let slots = |place, volume| self.fit.as_ref().and_then(|fit| fit.slots_of(place, volume));
        let kept = |place, volume| slots(place, volume).map_or_else(KeptSlots::default, |slots| kept(slots.floats));
        let mut resolved = resolve_with(&self.volumes, scene, size_px, (table, kept))?;
        self.check_order(&resolved)?;
        for layer in &mut resolved.layers {
            layer.view.opaque = layer.view.opaque.filter(|_| self.options.skips_empty);
        }
        Ok(resolved)
    }

    /// Cells of unlike grids are in no one order from back to front: their fog and surfaces take rays.
    fn check_order(&self, scene: &ResolvedScene) -> Result<(), SessionError> {
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
        let has_one_grid = || scene.layers.iter().all(is_on_its_grid);
        let is_projection = first.frames[0].settings.mode.is_projection();
        let is_sorted = self.options.compositor == CompositorChoice::Sorted;
        if !is_sorted || is_projection || has_one_grid() { Ok(()) } else { Err(SessionError::NoOrder) }
    }

    /// Makes the backend and the pagers for a scene, unless those there are suffice. The first step of a scene does
    /// this by itself; call it to know the backend before that.
    ///
    /// # Errors
    /// If no backend can be made, it does not have the compositor, or a budget is too small; the message says the least that works.
    pub fn fit(&mut self, scene: &ResolvedScene) -> Result<(), SessionError> {
        let asked = Demand::of(scene, self.options.live);
        if self.fit.as_ref().is_some_and(|fit| fit.suffices(scene, &asked)) {
            return Ok(());
        }
        let before = self.fit.as_ref().map(|fit| fit.demand.clone());
        self.end_fit();
        let Self { volumes, options, device, kept, .. } = self;
        let mut kept = std::mem::take(kept);
        let mut make = |demand| Fit::make(volumes, demand, options, (&mut *device, &mut kept));
        // A scene before may come back. Where there is too little memory for both, this one alone counts.
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

    /// Ends the backend and its pagers. What is decoded stays, and so does the picture that is shown.
    fn end_fit(&mut self) {
        (self.past, self.last) = (self.counted, None);
        self.player.forget();
        if let Some(fit) = self.fit.take() {
            let keeps_picture = self.shown.as_ref().is_some_and(ShownPicture::is_on_device);
            self.kept = fit.into_cores(&mut self.device, keeps_picture);
        }
    }

    /// Goes on with backends on another device. What is decoded stays.
    #[cfg(feature = "gpu")]
    pub(crate) fn move_to(&mut self, device: Device) {
        self.end_fit();
        self.shown.take_if(|shown| shown.is_on_device());
        self.device = device;
    }

    /// Goes on with other budgets, in bytes: of the backend, whichever it is, and [`SessionOptions::host_memory_bytes`]. The next step makes slots
    /// within them, and fills these from what is decoded. Returns whether that changes anything.
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

    /// Goes on with volumes in the place of those that there are: later states of them, such as stores with more time steps. What is played goes on. The next step
    /// fills the slots anew; a live session shows the picture before until something of them is there in every place.
    pub fn set_volumes(&mut self, volumes: Vec<VolumeSource>) {
        self.end_fit();
        self.kept.clear();
        self.tables = volumes.iter().map(|volume| volume.tables(self.options.live)).collect();
        self.volumes = volumes;
    }

    /// Makes the tables of a transfer function on other threads, before the function is shown. Other scenes can be
    /// drawn meanwhile; [`Session::is_prepared`] says when the tables are there. A scene with this function that is
    /// resolved sooner makes them itself, and takes as long.
    pub fn prepare(&self, transfer: &TransferFunction) {
        self.tables.iter().flat_map(VolumeTables::in_use).for_each(|tables| tables.prepare(transfer));
    }

    /// Whether the tables of a transfer function are there, so that a scene with it resolves at once.
    pub fn is_prepared(&self, transfer: &TransferFunction) -> bool {
        self.tables.iter().flat_map(VolumeTables::in_use).all(|tables| tables.is_prepared(transfer))
    }

    /// Prepares drawing a scene on another thread, for example by compiling shaders. Other scenes can be drawn
    /// meanwhile; [`Session::is_scene_prepared`] says when it is done. If the scene is drawn sooner, drawing waits.
    /// Nothing is prepared for a scene that takes another backend than the one in use.
    pub fn prepare_scene(&mut self, scene: &ResolvedScene) {
        let asked = Demand::of(scene, self.options.live);
        if let Some(fit) = self.fit.as_mut().filter(|fit| fit.suffices(scene, &asked)) {
            fit.prepare(scene);
        }
    }

    /// Whether there is nothing left to prepare for a scene, or nothing can be prepared before its first step.
    pub fn is_scene_prepared(&self, scene: &ResolvedScene) -> bool {
        let asked = Demand::of(scene, self.options.live);
        self.fit.as_ref().is_none_or(|fit| !fit.suffices(scene, &asked) || fit.is_prepared(scene))
    }

    /// Takes one step of streaming towards a picture of a scene: takes in the bricks that have come, uploads them, and
    /// asks for others. The frame that it returns can be drawn until the next step.
    ///
    /// # Errors
    /// If the scene is invalid, a budget is too small for it, there is no device (any more), or a part of the settled
    /// picture can be drawn from no level at all.
    pub fn step(&mut self, scene: &Scene, size_px: (u32, u32)) -> Result<Frame, SessionError> {
        self.step_coarse(scene, size_px, 0.0)
    }

    /// Takes a step as [`Session::step`] does, towards bricks that are so many levels coarser than the scene asks for: for a frame with fewer pixels, which looks the
    /// same with them, is drawn several times faster, and lacks few bricks. Its view has never settled: [`Session::step`] goes on towards that.
    ///
    /// # Errors
    /// As [`Session::step`].
    pub fn step_coarse(&mut self, scene: &Scene, size_px: (u32, u32), level_bias: f64) -> Result<Frame, SessionError> {
        self.suit(scene)?;
        let shot = Shot { scene: scene.clone(), size_px };
        let is_put_off = self.puts_off_slots(scene);
        let resolved = match is_put_off {
            true => self.resolve_for(scene, size_px, KeptSlots::fixed),
            false => self.resolve(scene, size_px),
        }?;
        self.slot_change.begin_step(&shot, is_put_off);
        let mut frame = self.step_biased(&resolved, level_bias)?;
        let is_whole = frame.status.settled || frame.status.awaits_feedback;
        self.slot_change.end_step(shot, is_whole);
        let is_coarse = level_bias > 0.0;
        frame.status.settled &= !is_put_off && !is_coarse;
        frame.status.awaits_feedback &= !is_coarse;
        Ok(frame)
    }

    /// Whether a change of what slots hold is put off in a step towards a scene.
    fn puts_off_slots(&mut self, scene: &Scene) -> bool {
        let is_valid = self.check(scene).is_ok();
        let Self { fit: Some(fit), volumes, clock: Some(clock), slot_change, .. } = self else { return false };
        is_valid && slot_change.is_put_off(fit, volumes, scene, clock.elapsed())
    }

    /// Opens the pyramids that suit the scene's mode: maxima for maximum projections, where a store has them.
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

    /// Takes a step as [`Session::step`] does, towards a scene that has been [resolved](Session::resolve) for these
    /// volumes. In a live session the frame's scene is at the time step that is shown, which while it plays is not the one that is asked for.
    ///
    /// # Errors
    /// As [`Session::step`].
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
        // Also where the step that is shown cannot be read: what plays goes on to the next.
        self.player.note(coming.clone());
        check_readable(&status)?;
        status.settled &= !self.player.is_seeking();
        self.streaming = self.streaming.mul_f64(0.8) + begun.elapsed().mul_f64(0.2);
        Ok(Frame { scene: Arc::new(scene.at_step(shown.step)), status, coming, level_bias, step: self.steps })
    }

    /// Refuses an expression that the backend would work out to other values.
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

    /// A lost device is made anew.
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

    /// Returns how long drawing a frame may take, so that frames take no longer than `frame_goal`, with streaming and what the caller does `besides`; and so that
    /// frames keep in step with time steps whose rate is to be held.
    pub fn drawing_time(&self, frame_goal: Duration, besides: Duration) -> Duration {
        let held = self.playback().filter(|playback| playback.policy == Policy::HoldRate);
        drawing_time(frame_goal, held.map(|playback| playback.steps_per_second), self.streaming + besides)
    }

    /// Waits until a brick has arrived or a time step is due, at most for `timeout`. Returns at once before the first step.
    pub fn wait(&mut self, timeout: Duration) {
        let timeout = self.next_due().map_or(timeout, |due| timeout.min(due));
        self.fit.iter_mut().for_each(|fit| fit.wait(timeout));
    }

    /// Plays the time steps of a live session from the one that is shown on, or changes how they are played; `None` stands still. From the next
    /// step of streaming on, frames show the steps that are due. A scene that asks for another step than the last one did is a jump
    /// there.
    pub fn play(&mut self, playback: Option<Playback>) {
        self.player.play(playback.filter(|_| self.options.live));
    }

    /// How time steps follow one another; `None` while they do not. A playback that is to stop at the last step ends there by itself.
    pub fn playback(&self) -> Option<Playback> {
        self.player.playback()
    }

    /// Whether a time step that was jumped to is not shown yet.
    pub fn is_seeking(&self) -> bool {
        self.player.is_seeking()
    }

    /// How many time steps have been shown while playing, and how many were late or passed over.
    pub fn playback_tally(&self) -> Tally {
        self.player.tally()
    }

    /// How long it is until the next time step is due; `None` if none is.
    pub fn next_due(&self) -> Option<Duration> {
        let due = self.player.next_due()?;
        self.clock.map(|began| due.saturating_sub(began.elapsed()))
    }

    /// Renders the last step's frame from the bricks in the slots, with one sample of each pixel, both eyes from the same bricks. If the device turns
    /// out to be lost, it is made anew and its slots are filled as far as before. The picture is the same then, but
    /// takes as long as the first one of its view.
    ///
    /// A live session returns the picture that it drew before, in the size that this one had, where [`Session::shows_before`] says so.
    ///
    /// # Errors
    /// If the frame is an earlier step's, there is no device any more, or the device is out of memory.
    pub fn draw(&mut self, frame: &Frame) -> Result<Picture, SessionError> {
        // Hidden bricks stop being wanted. Only while the camera moves: for one picture, finding out what is hidden takes more
        // drawing than reading it, and an edit of the transfer function could bring it out.
        let tells = self.options.live;
        if let Some(before) = self.shown.as_ref().and_then(ShownPicture::pixels).filter(|_| self.shows_before(frame)) {
            return Ok(before.clone());
        }
        // It is drawn where frames are shown, too.
        self.shown.take_if(|shown| shown.is_on_device());
        loop {
            let Some(fit) = self.fit.as_mut().filter(|_| frame.step == self.steps) else {
                return Err(SessionError::Superseded);
            };
            fit.backend.draw_until(self.draw_until);
            fit.backend.draw_on(self.painting.clone());
            match fit.draw(&frame.scene, tells) {
                Ok(picture) => {
                    self.losses.picture();
                    if self.options.live && frame.status.covered {
                        self.shown = Some(ShownPicture::of_pixels(frame.clone(), picture.clone()));
                    }
                    return Ok(picture);
                }
                Err(error) => self.recover(error)?,
            }
            self.refill()?;
        }
    }

    /// Draws as [`Session::draw`] does, for who looks on: on the CPU, what is drawn so far can be seen on the painting, from other threads too, and the
    /// picture can be abandoned there.
    ///
    /// # Errors
    /// As [`Session::draw`], and if the picture was abandoned.
    pub fn paint(&mut self, frame: &Frame, painting: &Arc<Painting>) -> Result<Picture, SessionError> {
        self.painting = Some(painting.clone());
        let drawn = self.draw(frame);
        self.painting = None;
        drawn
    }

    /// Whether drawing this frame, the last step's, shows the picture before in its place: while nothing of the frame is there yet in some place, as after a
    /// change of volumes, layers, budgets or devices, and while a live session fills slots of another format for a look with a narrower or wider window.
    /// If there is no picture before, drawing shows the background alone.
    pub fn shows_before(&self, frame: &Frame) -> bool {
        let is_held = || self.shown.is_some() && self.slot_change.shows_before();
        frame.step == self.steps && (!frame.status.covered || is_held())
    }

    /// The frame whose picture was drawn last in a live session, by [`Session::draw`] or [`Session::draw_to`]; `None` before the first one, and where
    /// that picture is lost.
    pub fn shown(&self) -> Option<&Frame> {
        self.shown.as_ref().map(ShownPicture::frame)
    }

    /// Makes a lost device anew; its slots are empty. Other errors are the caller's, and so is the loss of an application's device.
    fn recover(&mut self, error: BackendError) -> Result<(), SessionError> {
        if self.device.is_lent() {
            return Err(error.into());
        }
        self.losses.record(error)?;
        self.player.forget();
        self.fit.as_mut().map_or(Ok(()), Fit::renew)
    }

    /// Streams the last step's views again, until they are settled if they were, else until something is drawn everywhere.
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

    /// Number of times that the GPU's device was lost so far.
    pub fn device_losses(&self) -> u32 {
        self.losses.total()
    }

    /// A line that describes the backend: `gpu, llvmpipe (...)` or `cpu, 2 threads`. Empty before the first step.
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

    /// The volumes, each with the pyramid that suits the last step's mode.
    pub fn volumes(&self) -> &[VolumeSource] {
        &self.volumes
    }

    /// Number of slots, which is how many bricks of all layers fit at once; 0 before the first step.
    pub fn slots(&self) -> u64 {
        self.fit.as_ref().map_or(0, Fit::slots)
    }

    /// Returns the present draw list of each layer; in stereo the left eye's.
    pub fn draw_lists(&self) -> impl Iterator<Item = &DrawList> {
        self.fit.iter().flat_map(Fit::draw_lists)
    }

    /// Returns the present draw lists of the layer with this index in the scene, one for each eye.
    pub(crate) fn lists_of(&self, place: usize) -> &[DrawList] {
        self.fit.as_ref().map_or(&[], |fit| fit.lists_of(place))
    }
}

/// Refuses a view of which a part can be drawn from no level.
fn check_readable(status: &Status) -> Result<(), SessionError> {
    status.error.clone().map_or(Ok(()), |error| Err(SessionError::Unreadable(error)))
}
