//! A session: one paged volume shown through one backend. A scene becomes a view for the pager and settings for the
//! renderer; every step moves bricks towards what the view wants; a picture can be drawn at any moment.

use crate::backend::{Backend, BackendError, BackendNeeds};
use crate::losses::Losses;
pub use crate::options::SessionOptions;
pub use crate::session_error::SessionError;
use crate::tables::Tables;
use brickyard_pager::{BrickSource, DrawList, Pager, PagerConfig, Planning, Status, UploadLimits, View};
use brickyard_volume::lighting::MAX_LIGHTS;
use brickyard_volume::sampling::MOST_VIRTUAL_SAMPLES;
use brickyard_volume::surface::MAX_SURFACES;
use brickyard_volume::{
    Camera, Extent, FrameSettings, Isosurface, Lattice, LevelPolicy, Lighting, LightingModel, Method, Mode, Needs,
    Occupancy, Picture, Placement, Region, Scene, ShownMesh, SlotEncoding, StereoLayout, Subject, Surface,
    TransferFunction, TransferTable,
};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What a live step may upload: about 30 bricks of 64³ 16-bit voxels, in a quarter of a frame at 60 a second.
const LIVE_UPLOADS: UploadLimits = UploadLimits { bytes: 16 << 20, time: Duration::from_millis(4) };

/// How long a finer brick takes to fade in: too fast to wait for, slow enough not to catch the eye.
const LIVE_FADE: Duration = Duration::from_millis(200);

/// A scene resolved for a picture size: what the pager and the renderer need.
#[derive(Clone, Debug)]
pub struct ResolvedScene {
    /// For the pager.
    pub view: View,
    /// For the renderer: the left eye's in stereo.
    pub frame: FrameSettings,
    /// The right eye's frame, and how the two pictures become one. The view is that of both eyes, the left one first.
    pub stereo: Option<(FrameSettings, StereoLayout)>,
    /// The transfer function in use.
    pub transfer: TransferFunction,
    /// The camera in use.
    pub camera: Camera,
}

impl ResolvedScene {
    /// The scene that it is of, with what was left to be found.
    pub fn shown(&self, scene: &Scene) -> Scene {
        Scene { camera: Some(self.camera), transfer: Some(self.transfer.clone()), ..scene.clone() }
    }

    /// The picture of the scene, whoever draws its frames: given the view from the eye that a frame is for, so that the order
    /// of drawing is right.
    ///
    /// # Errors
    /// Those of `draw`.
    pub fn picture<E>(&self, mut draw: impl FnMut(&View, &FrameSettings) -> Result<Picture, E>) -> Result<Picture, E> {
        let first = draw(&self.view, &self.frame)?;
        let Some((frame, layout)) = &self.stereo else { return Ok(first) };
        let second = draw(&self.view.from_other_eye(), frame)?;
        Ok(layout.compose([&first, &second]))
    }
}

/// One volume, its pager and a backend.
pub struct Session {
    source: Arc<dyn BrickSource>,
    /// What its bricks have.
    bricks: Needs,
    leaps: bool,
    default_window: (f64, f64),
    pager: Pager,
    backend: Backend,
    backend_line: String,
    draw: DrawList,
    /// The same for the other eye of the last step's view, if it has one.
    draw_other_eye: Option<DrawList>,
    /// The view of the last step, and whether it had settled.
    shown: Option<(View, bool)>,
    losses: Losses,
    tables: Tables,
    /// When it began, if it is live.
    clock: Option<Instant>,
}

impl Session {
    /// Joins a source, a pager and a backend. `default_window` is the value range of the default transfer function.
    ///
    /// # Errors
    /// If no backend can be made or a budget is too small; the message says the least that works.
    pub fn new(
        source: Arc<dyn BrickSource>,
        default_window: (f64, f64),
        options: &SessionOptions,
    ) -> Result<Self, SessionError> {
        let needs = BackendNeeds::new(&*source, options);
        let (backend, backend_line) = Backend::new(options.backend, &needs)?;
        let config = PagerConfig {
            slots: backend.slots(),
            apron: needs.bricks.apron,
            gradient_layers: needs.bricks.gradient_layers,
            host_bytes: options.host_memory_bytes.saturating_sub(needs.bricks.meshes.bytes()),
            workers: options.threads as u32,
            planning: if options.live { Planning::Thread } else { Planning::Inline },
            prefetch: options.live,
            uploads: options.live.then_some(LIVE_UPLOADS),
            fade: options.live.then_some(LIVE_FADE),
        };
        let pager = Pager::new(source.clone(), config)?;
        let clock = options.live.then(Instant::now);
        let (draw, draw_other_eye, shown, losses) = Default::default();
        let bricks = needs.bricks;
        let tables = Tables::new(needs.encoding, bricks.is_pre_integrated);
        Ok(Self {
            tables,
            source,
            bricks,
            leaps: options.leaps,
            default_window,
            pager,
            backend,
            backend_line,
            draw,
            draw_other_eye,
            shown,
            losses,
            clock,
        })
    }

    /// Resolves a scene against this volume.
    ///
    /// # Errors
    /// If the camera, level, time step, channel or isovalue is impossible, or the session was made for another mode.
    pub fn resolve(&self, scene: &Scene, (width, height): (u32, u32)) -> Result<ResolvedScene, SessionError> {
        let needs = scene.needs();
        if !self.bricks.satisfy(&needs) {
            let problem = format!("the session's bricks have {:?}, and the scene needs {needs:?}", self.bricks);
            return Err(SessionError::Scene(problem + ": make it with SessionOptions::bricks set to that"));
        }
        let table = |transfer: &TransferFunction, _: &SlotEncoding| self.tables.table(transfer);
        let mut resolved = resolve_with(&*self.source, self.default_window, scene, (width, height), table)?;
        resolved.view.opaque = resolved.view.opaque.filter(|_| self.leaps);
        Ok(resolved)
    }

    /// Has a thread make what is to be made of a transfer function before it can be shown. Until [`Session::is_prepared`] says that it is
    /// done, scenes with the function before can be drawn as ever; one that is resolved sooner makes it itself, and waits for that.
    pub fn prepare(&self, transfer: &TransferFunction) {
        self.tables.prepare(transfer);
    }

    /// Whether a scene with this transfer function resolves at once.
    pub fn is_prepared(&self, transfer: &TransferFunction) -> bool {
        self.tables.is_prepared(transfer)
    }

    /// One step of streaming: asks the pager, performs its uploads, keeps its draw list. A lost device is made anew.
    ///
    /// # Errors
    /// If there is no device any more or nothing can be drawn at all.
    pub fn step(&mut self, view: &View) -> Result<Status, SessionError> {
        let frame = loop {
            let at = self.clock.map_or(Duration::ZERO, |began| began.elapsed());
            let frame = self.pager.frame(view, at);
            let begun = Instant::now();
            match frame.uploads.iter().try_for_each(|upload| self.backend.upload(upload)) {
                Ok(()) => {
                    self.pager.uploads_took(begun.elapsed());
                    break frame;
                }
                Err(error) => self.recover(error)?,
            }
        };
        (self.draw, self.draw_other_eye) = (frame.draw, frame.draw_other_eye);
        self.shown = Some((view.clone(), frame.status.settled));
        match frame.status.error {
            Some(error) => Err(SessionError::Unreadable(error)),
            None => Ok(frame.status),
        }
    }

    /// Waits until a brick has arrived, at most this long.
    pub fn wait(&mut self, timeout: Duration) {
        self.pager.wait(timeout);
    }

    /// Renders what is resident now of the last step's scene, both eyes of it from the same bricks. Where the device turns out to
    /// be lost, it is made anew and filled as far as it was before: the picture is the same, but takes as long as the first one
    /// of its view.
    ///
    /// # Errors
    /// If there is no device any more, or it is out of memory.
    pub fn draw(&mut self, scene: &ResolvedScene) -> Result<Picture, SessionError> {
        loop {
            match self.try_draw(scene) {
                Ok(picture) => {
                    self.losses.picture();
                    return Ok(picture);
                }
                Err(error) => self.recover(error)?,
            }
            self.refill()?;
        }
    }

    fn try_draw(&mut self, scene: &ResolvedScene) -> Result<Picture, BackendError> {
        let Self { source, pager, backend, draw, draw_other_eye, .. } = self;
        // Hidden bricks stop being wanted. Only while the camera moves: for one picture, finding out what is hidden takes more
        // drawing than reading it, and an edit of the transfer function could bring it out.
        let is_of_step = scene.stereo.is_some() == draw_other_eye.is_some();
        let mut seen = (self.clock.is_some() && is_of_step).then(Vec::new);
        let mut lists = std::iter::once(&*draw).chain(&*draw_other_eye);
        let picture = scene.picture(|_, frame| {
            let picture = backend.render(frame, source.pyramid(), lists.next().unwrap_or(draw))?;
            seen = match (seen.take(), backend.visibility()) {
                (Some(seen), Some(by_eye)) => Some([&seen, by_eye].concat()),
                _ => None,
            };
            Ok::<_, BackendError>(picture)
        })?;
        if let Some(seen) = seen {
            pager.feedback(&seen);
        }
        Ok(picture)
    }

    /// Makes a lost device anew; its slots are empty. Other errors are the caller's.
    fn recover(&mut self, error: BackendError) -> Result<(), SessionError> {
        self.losses.record(error)?;
        self.backend.renew()?;
        self.pager.forget_slots(self.backend.slots())?;
        (self.draw, self.draw_other_eye) = Default::default();
        Ok(())
    }

    /// Streams the last step's view again, until it is settled if it was, else until something is drawn everywhere.
    fn refill(&mut self) -> Result<(), SessionError> {
        let Some((view, was_settled)) = self.shown.clone() else { return Ok(()) };
        loop {
            let status = self.step(&view)?;
            if status.settled || status.awaits_feedback || status.covered && !was_settled {
                return Ok(());
            }
            self.wait(Duration::from_millis(50));
        }
    }

    /// How many times the GPU's device was lost and made anew.
    pub fn device_losses(&self) -> u32 {
        self.losses.total()
    }

    /// The backend, in words: `gpu, llvmpipe (...)` or `cpu, 2 threads`.
    pub fn backend_line(&self) -> &str {
        &self.backend_line
    }

    /// The backend.
    pub fn backend(&self) -> &Backend {
        &self.backend
    }

    /// What is drawn now.
    pub fn draw_list(&self) -> &DrawList {
        &self.draw
    }
}

/// Resolves a scene against a volume: default camera and transfer function, table, lattice, opaque bins.
///
/// # Errors
/// If the camera, level, time step, channel or isovalue is impossible.
pub fn resolve(
    source: &dyn BrickSource,
    default_window: (f64, f64),
    scene: &Scene,
    size_px: (u32, u32),
) -> Result<ResolvedScene, SessionError> {
    let table = |transfer: &TransferFunction, encoding: &SlotEncoding| TransferTable::new(transfer, encoding).into();
    resolve_with(source, default_window, scene, size_px, table)
}

/// The same with tables from wherever they come.
fn resolve_with(
    source: &dyn BrickSource,
    default_window: (f64, f64),
    scene: &Scene,
    (width, height): (u32, u32),
    table: impl FnOnce(&TransferFunction, &SlotEncoding) -> Arc<TransferTable>,
) -> Result<ResolvedScene, SessionError> {
    let pyramid = source.pyramid();
    let levels = pyramid.levels();
    let extent = levels[0].extent;
    check_scene(source, scene, levels.len())?;
    let geometry = source.geometry().clone();
    let camera = scene.camera_for(geometry.world_box(extent), (width, height));
    let (rays, other_eye) = match &scene.stereo {
        None => (camera.rays(width, height)?, None),
        Some(stereo) => {
            let [left, right] = stereo.eyes(&camera, (width, height))?;
            (left, Some((right, stereo.layout)))
        }
    };
    let clip = scene.clip_for(&rays, &geometry, extent).map_err(|error| SessionError::Scene(error.to_string()))?;
    let voxel_size = geometry.voxel_size(extent);
    let step = scene.step * voxel_size;
    let lattice = match scene.level {
        LevelPolicy::Auto => Lattice::for_view(step, voxel_size, &rays, scene.pixel_error, levels.len()),
        LevelPolicy::Locked(level) => Lattice::uniform(step, level as usize),
    };
    let encoding = encoding_of(source);
    let transfer = scene.transfer.clone().unwrap_or_else(|| default_transfer(default_window, &geometry, extent));
    let table = table(&transfer, &encoding);
    // Quantisation moves a value by half a code.
    let slack = (table.reach_codes() + 0.5) * encoding.code_width();
    let bins = source.occupancy_bins(scene.channel);
    // A brick that a surface passes has all bins from one side of it to the other, so its own among them.
    let surfaces = Surface::all(&scene.isosurfaces, &transfer, &encoding);
    let passed = surfaces.iter().map(|surface| bins.mask(surface.threshold - slack, surface.threshold + slack));
    let fog = match scene.mode {
        Mode::Dvr => Some(bins.opaque(&transfer, slack)),
        Mode::Isosurface => Some(Occupancy::NONE),
        Mode::Mip | Mode::MinIp | Mode::Average => None,
    };
    let opaque = fog.map(|fog| passed.fold(fog, Occupancy::union));
    let background = scene.background.map(|c| c as f32);
    let meshes = scene.shown_meshes().map_err(|error| SessionError::Scene(error.to_string()))?;
    let appearance = appearance(&table, &transfer, scene, &meshes);
    let frame = FrameSettings {
        rays,
        lattice,
        geometry,
        placement: Placement::default(),
        encoding,
        table,
        mode: scene.mode,
        surfaces,
        sampling: scene.sampling,
        lighting: scene.lighting.clone(),
        background,
        clip: clip.clone(),
        meshes,
    };
    Ok(ResolvedScene {
        view: View {
            rays,
            other_eye: other_eye.map(|(rays, _)| rays),
            opaque,
            filter: scene.sampling.filter,
            level: scene.level,
            pixel_error: scene.pixel_error,
            time: scene.time,
            channel: scene.channel,
            clip: clip.clone(),
            placement: Placement::default(),
            appearance,
        },
        // Pixels are as large for one eye as for the other, so both have the same lattice.
        stereo: other_eye.map(|(rays, layout)| (FrameSettings { rays, ..frame.clone() }, layout)),
        frame,
        transfer,
        camera,
    })
}

/// What of a picture decides which bricks hide others.
fn appearance(table: &TransferTable, transfer: &TransferFunction, scene: &Scene, meshes: &[ShownMesh]) -> u64 {
    let mut hasher = DefaultHasher::new();
    scene.mode.hash(&mut hasher);
    scene.sampling.hash(&mut hasher);
    for surface in &scene.isosurfaces {
        [surface.value, surface.opacity].map(f64::to_bits).hash(&mut hasher);
    }
    table.unit_distance.to_bits().hash(&mut hasher);
    table.entries.iter().for_each(|entry| entry[3].to_bits().hash(&mut hasher));
    transfer.gradient_opacity.as_flattened().iter().for_each(|number| number.to_bits().hash(&mut hasher));
    for Region { shape, value, gradient, color: _, opacity } in &transfer.regions {
        (*shape as u8).hash(&mut hasher);
        [value[0], value[1], gradient[0], gradient[1], *opacity].map(f64::to_bits).hash(&mut hasher);
    }
    if transfer.is_by_gradient() {
        scene.lighting.gradient.hash(&mut hasher);
    }
    // A mesh that has been read is never changed.
    let seen = meshes.iter().map(|shown| (Arc::as_ptr(&shown.mesh), shown.opacity.to_bits()));
    seen.for_each(|mesh| mesh.hash(&mut hasher));
    hasher.finish()
}

fn check_scene(source: &dyn BrickSource, scene: &Scene, levels: usize) -> Result<(), SessionError> {
    let past = |what: &str, asked: u64, count: u64| {
        let problem = format!("{what} {asked} does not exist: the store has {count}, numbered from 0");
        if asked < count { Ok(()) } else { Err(SessionError::Scene(problem)) }
    };
    if let LevelPolicy::Locked(level) = scene.level {
        past("level", level as u64, levels as u64)?;
    }
    past("time step", scene.time as u64, source.times() as u64)?;
    past("channel", scene.channel as u64, source.channels() as u64)?;
    for (name, value) in [("step", scene.step), ("pixel error", scene.pixel_error)] {
        if !(value.is_finite() && value > 0.0) {
            return Err(SessionError::Scene(format!("the {name} is {value}: expected a positive number")));
        }
    }
    check_look(scene)?;
    check_surfaces(scene)?;
    if scene.expression.is_some() {
        let problem = "an expression is over the volumes of an ensemble: show it with `brickyard render`";
        return Err(SessionError::Scene(problem.into()));
    }
    scene.check_slice().map_err(|error| SessionError::Scene(error.to_string()))?;
    if let Some(transfer) = &scene.transfer {
        transfer.validate().map_err(|error| SessionError::Scene(format!("transfer function: {error}")))?;
    }
    Ok(())
}

fn check_surfaces(scene: &Scene) -> Result<(), SessionError> {
    let surfaces = &scene.isosurfaces;
    let has_two_of = |surface: &Isosurface| surfaces.iter().filter(|other| other.value == surface.value).count() > 1;
    let problem = if scene.mode == Mode::Isosurface && surfaces.is_empty() {
        "an isosurface needs the value whose surface it is: give --isovalue, in stored units".to_string()
    } else if surfaces.is_empty() {
        return Ok(());
    } else if !matches!(scene.mode, Mode::Dvr | Mode::Isosurface) {
        let value = surfaces[0].value;
        format!("the isovalue {value} is for --mode isosurface, or dvr: leave it out, or use one of those")
    } else if surfaces.len() > MAX_SURFACES {
        format!("{} isosurfaces: expected at most {MAX_SURFACES}", surfaces.len())
    } else if let Some(surface) = surfaces.iter().find(|surface| !surface.value.is_finite()) {
        format!("the isovalue is {}: expected a finite number", surface.value)
    } else if let Some(surface) = surfaces.iter().find(|surface| !(0.0..=1.0).contains(&surface.opacity)) {
        let Isosurface { value, opacity, .. } = surface;
        format!("the isosurface at {value} has an opacity of {opacity}: expected a number from 0 to 1")
    } else if let Some(surface) = surfaces.iter().find(|surface| has_two_of(surface)) {
        format!("two isosurfaces have the value {}: leave one out", surface.value)
    } else {
        return Ok(());
    };
    Err(SessionError::Scene(problem))
}

/// Checks method and lighting.
fn check_look(scene: &Scene) -> Result<(), SessionError> {
    let Lighting { model, lights, .. } = &scene.lighting;
    let is_dvr = scene.mode == Mode::Dvr;
    let problem = if scene.sampling.method != Method::Udvr && !is_dvr {
        format!(
            "the sampling method {:?} is for direct volume rendering: leave it out, or use --mode dvr",
            scene.sampling.method
        )
    } else if *model != LightingModel::None && !is_dvr && scene.mode != Mode::Isosurface {
        format!(
            "the lighting {model:?} is for direct volume rendering and isosurfaces: leave it out, or use --mode dvr"
        )
    } else if !(1..=MOST_VIRTUAL_SAMPLES).contains(&scene.sampling.virtual_samples) {
        format!("{} virtual samples: expected 1 to {MOST_VIRTUAL_SAMPLES}", scene.sampling.virtual_samples)
    } else if is_dvr && !scene.takes(scene.sampling.method) {
        format!(
            "the sampling method {:?} integrates over values, and the transfer function is one of value and gradient: use --method \
             udvr, lvs, cvs or asm",
            scene.sampling.method
        )
    } else if lights.len() > MAX_LIGHTS {
        format!("{} lights: expected at most {MAX_LIGHTS}", lights.len())
    } else if let Some(light) = lights.iter().find(|light| !light.is_finite()) {
        format!("a light stands at {light}: expected finite numbers")
    } else if *model == LightingModel::None && !lights.is_empty() && scene.isosurfaces.is_empty() {
        "a light without lighting: leave it out, or add --lighting blinn-phong".to_string()
    } else {
        return Ok(());
    };
    Err(SessionError::Scene(problem))
}

fn encoding_of(source: &dyn BrickSource) -> SlotEncoding {
    SlotEncoding::new(source.voxel_type(), source.value_range(), source.has_non_finite())
}

/// The window that is shown: the one given, or where that is a single value, one about it. So a volume of one value has the
/// middle of the colours and of the opacity, instead of being black.
pub fn shown_window((low, high): (f64, f64)) -> (f64, f64) {
    if low < high {
        return (low, high);
    }
    let reach = low.abs().max(1.0) / 2.0;
    (low - reach, low + reach)
}

/// What a volume is to a transfer function. The presets' distance is a hundredth of its longest side.
pub fn subject(geometry: &brickyard_volume::Geometry, extent: Extent, window: (f64, f64)) -> Subject {
    let (low, high) = geometry.world_box(extent);
    let size = high - low;
    Subject {
        window: shown_window(window),
        unit_distance: size.max_element() / 100.0,
        cell_length: size.length() / (extent.volume() as f64).cbrt(),
        mean_spacing: geometry.spacing.element_sum() / 3.0,
    }
}

pub(crate) fn default_transfer(
    window: (f64, f64),
    geometry: &brickyard_volume::Geometry,
    extent: Extent,
) -> TransferFunction {
    let subject = subject(geometry, extent, window);
    TransferFunction::preset("gray", subject.window, subject.unit_distance).expect("'gray' is a preset")
}
