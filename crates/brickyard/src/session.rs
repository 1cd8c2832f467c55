//! A session: the paged volumes of one picture, shown through one backend. A scene becomes a view for each pager and frames for the
//! renderer; every step moves bricks towards what the views want; a picture can be drawn at any moment.
//!
//! Layers whose bricks fit each other's slots share a pool of them, and a pager, which splits the worst cell of any of them first. Budgets
//! are shared out among pools once, by what each could use ([`share`]).

use crate::backend::{self, BackendError, Renderer, layer_needs};
use crate::losses::Losses;
use crate::options::CompositorChoice;
pub use crate::options::SessionOptions;
use crate::resolve::resolve_with;
pub use crate::resolve::{HiddenLayer, ResolvedLayer, ResolvedScene, resolve};
pub use crate::session_error::SessionError;
use crate::tables::Tables;
pub use crate::volume_source::VolumeSource;
use brickyard_pager::{
    BrickSource, DrawList, Layer, Pager, PagerConfig, PagerError, Planning, Status, UploadLimits, View, VolumeNeeds,
    Wish, pools, share,
};
use brickyard_render::Compositor;
use brickyard_volume::{FrameSettings, Needs, Picture, Scene, SceneError, SlotEncoding, TransferFunction};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// What a live step may upload: about 30 bricks of 64³ 16-bit voxels, in a quarter of a frame at 60 a second.
const LIVE_UPLOADS: UploadLimits = UploadLimits { bytes: 16 << 20, time: Duration::from_millis(4) };

/// How long a finer brick takes to fade in: too fast to wait for, slow enough not to catch the eye.
const LIVE_FADE: Duration = Duration::from_millis(200);

/// A layer, and what of it is drawn now.
struct SessionLayer {
    /// Its place in scenes, and its volume's among the session's.
    place: usize,
    volume: usize,
    source: Arc<dyn BrickSource>,
    /// A list for each eye of the last step's view.
    draws: Vec<DrawList>,
    /// Which cut they are drawn from: the number of the first layer that shares it.
    cut: u32,
}

/// Layers that share slots, by their numbers, and their pager.
struct Pool {
    layers: Vec<usize>,
    pager: Pager,
    is_settled: bool,
}

/// Volumes, the layers that show them, the pagers of their pools of slots, and a backend.
pub struct Session {
    volumes: Vec<VolumeSource>,
    layers: Vec<SessionLayer>,
    pools: Vec<Pool>,
    /// Whether the backend has room for expressions.
    has_expressions: bool,
    /// What bricks have.
    bricks: Needs,
    leaps: bool,
    backend: Box<dyn Renderer>,
    backend_line: String,
    /// The views of the last step, and whether they had settled.
    last: Option<(Vec<View>, bool)>,
    losses: Losses,
    /// One for each volume.
    tables: Vec<Tables>,
    /// When it began, if it is live.
    clock: Option<Instant>,
}

impl Session {
    /// Joins a volume that is shown alone, its pager and a backend.
    ///
    /// # Errors
    /// If no backend can be made or a budget is too small; the message says the least that works.
    pub fn new(volume: VolumeSource, options: &SessionOptions) -> Result<Self, SessionError> {
        Self::make(vec![volume], &[(0, 0)], false, options)
    }

    /// Joins those of the volumes that a scene shows, their pagers and a backend. A live session has those that the scene hides, too: it keeps
    /// their coarsest bricks, and other scenes may show them.
    ///
    /// # Errors
    /// If no backend can be made, it has no compositor for several layers, or a budget is too small; the message says the least that
    /// works.
    pub fn of_scene(
        volumes: Vec<VolumeSource>,
        scene: &ResolvedScene,
        options: &SessionOptions,
    ) -> Result<Self, SessionError> {
        check_order(&volumes, scene, options.compositor == CompositorChoice::Sorted)?;
        let hidden = scene.hidden.iter().filter(|_| options.live).map(|layer| (layer.place, layer.volume));
        let mut layers: Vec<_> = scene.layers.iter().map(|layer| (layer.place, layer.volume)).chain(hidden).collect();
        layers.sort_unstable();
        Self::make(volumes, &layers, !scene.is_alone(), options)
    }

    /// Of layers, each given by its place in scenes and that of its volume.
    fn make(
        volumes: Vec<VolumeSource>,
        layers: &[(usize, usize)],
        has_expressions: bool,
        options: &SessionOptions,
    ) -> Result<Self, SessionError> {
        let sources: Vec<_> = layers.iter().map(|&(_, volume)| volumes[volume].source.clone()).collect();
        let needs: Vec<VolumeNeeds> = sources.iter().map(|source| layer_needs(&**source, options)).collect();
        let (backend, backend_line) = backend::open(&needs, has_expressions, options)?;
        let pools = pools_of(&needs, &sources, &*backend, options)?;
        let tables = |(i, volume): (usize, &VolumeSource)| {
            let of_volume = layers.iter().filter(|&&(_, of)| of == i).count();
            Tables::new(volume.encoding(), options.bricks.is_pre_integrated, of_volume)
        };
        let tables = volumes.iter().enumerate().map(tables).collect();
        let layer = |(&(place, volume), source)| SessionLayer { place, volume, source, draws: Vec::new(), cut: 0 };
        Ok(Self {
            tables,
            layers: layers.iter().zip(sources).map(layer).collect(),
            pools,
            volumes,
            has_expressions,
            bricks: options.bricks,
            leaps: options.leaps,
            backend,
            backend_line,
            last: None,
            losses: Losses::default(),
            clock: options.live.then(Instant::now),
        })
    }

    /// Resolves a scene against the session's volumes.
    ///
    /// # Errors
    /// As [`resolve`]; and if the session was made for another mode or other layers.
    pub fn resolve(&self, scene: &Scene, size_px: (u32, u32)) -> Result<ResolvedScene, SessionError> {
        let needs = scene.needs();
        if !self.bricks.satisfy(&needs) {
            return Err(SessionError::Needs { have: self.bricks.into(), needed: needs.into() });
        }
        let table = |i: usize, transfer: &TransferFunction, _: &SlotEncoding| self.tables[i].table(transfer);
        let mut resolved = resolve_with(&self.volumes, scene, size_px, table)?;
        let has = |layer: &ResolvedLayer| {
            self.layers.iter().any(|own| (own.place, own.volume) == (layer.place, layer.volume))
        };
        let has_room = self.has_expressions || resolved.combination.is_none();
        if !resolved.layers.iter().all(has) || !has_room || self.views(&resolved).is_none() {
            return Err(SessionError::OtherLayers);
        }
        check_order(&self.volumes, &resolved, self.backend.compositor() == Compositor::Sorted.name())?;
        for layer in &mut resolved.layers {
            layer.view.opaque = layer.view.opaque.filter(|_| self.leaps);
        }
        Ok(resolved)
    }

    /// Has threads make what is to be made of a transfer function before it can be shown. Until [`Session::is_prepared`] says that it is
    /// done, scenes with the function before can be drawn as ever; one that is resolved sooner makes it itself, and waits for that.
    pub fn prepare(&self, transfer: &TransferFunction) {
        self.tables.iter().for_each(|tables| tables.prepare(transfer));
    }

    /// Whether a scene with this transfer function resolves at once.
    pub fn is_prepared(&self, transfer: &TransferFunction) -> bool {
        self.tables.iter().all(|tables| tables.is_prepared(transfer))
    }

    /// Has a thread make what drawing this scene would have to make first, such as compiled shaders. Until
    /// [`Session::is_scene_prepared`] says that it is done, the scene before can be drawn as ever; one that is drawn sooner waits.
    pub fn prepare_scene(&mut self, scene: &ResolvedScene) {
        self.backend.prepare(&drawn(&self.layers, scene, 0), scene.combination.as_ref());
    }

    /// Whether this scene is drawn without something to be made first.
    pub fn is_scene_prepared(&self, scene: &ResolvedScene) -> bool {
        self.backend.is_prepared(&drawn(&self.layers, scene, 0), scene.combination.as_ref())
    }

    /// A scene's view of each of the session's layers; `None` if it does not have them all.
    fn views(&self, scene: &ResolvedScene) -> Option<Vec<View>> {
        let view = |own: &SessionLayer| {
            let shown = scene.layers.iter().find(|layer| layer.place == own.place).map(|layer| &layer.view);
            let hidden = || scene.hidden.iter().find(|layer| layer.place == own.place).map(|layer| &layer.view);
            shown.or_else(hidden).cloned()
        };
        self.layers.iter().map(view).collect()
    }

    /// One step of streaming: asks the pagers, performs their uploads, keeps their draw lists. A lost device is made anew.
    ///
    /// # Errors
    /// If there is no device any more, nothing can be drawn at all, or the scene is of other layers.
    pub fn step(&mut self, scene: &ResolvedScene) -> Result<Status, SessionError> {
        self.step_to(self.views(scene).ok_or(SessionError::OtherLayers)?)
    }

    fn step_to(&mut self, views: Vec<View>) -> Result<Status, SessionError> {
        let status = loop {
            match self.try_step(&views) {
                Ok(status) => break status,
                Err(error) => self.recover(error)?,
            }
        };
        let status = status.ok_or(SceneError::NothingVisible)?;
        self.last = Some((views, status.settled));
        match status.error {
            Some(error) => Err(SessionError::Unreadable(error)),
            None => Ok(status),
        }
    }

    /// How far all layers are together, after their uploads.
    fn try_step(&mut self, views: &[View]) -> Result<Option<Status>, BackendError> {
        let at = self.clock.map_or(Duration::ZERO, |began| began.elapsed());
        let mut whole: Option<Status> = None;
        for pool in &mut self.pools {
            let of_pool: Vec<View> = pool.layers.iter().map(|&layer| views[layer].clone()).collect();
            let frame = pool.pager.frame(&of_pool, at);
            let begun = Instant::now();
            let mut uploads = frame.uploads.iter();
            uploads.try_for_each(|upload| self.backend.upload(pool.layers[upload.volume], upload))?;
            pool.pager.uploads_took(begun.elapsed());
            for (&layer, drawn) in pool.layers.iter().zip(frame.volumes) {
                let layer = &mut self.layers[layer];
                layer.draws = std::iter::once(drawn.draw).chain(drawn.draw_other_eye).collect();
                layer.cut = pool.layers[drawn.cut] as u32;
            }
            pool.is_settled = frame.status.settled;
            whole = Some(match whole {
                None => frame.status,
                Some(before) => before.and(&frame.status),
            });
        }
        Ok(whole)
    }

    /// Waits until a brick has arrived, at most this long.
    pub fn wait(&mut self, timeout: Duration) {
        if let [pool] = &mut self.pools[..] {
            pool.pager.wait(timeout);
            return;
        }
        // One after the other: what comes for another one meanwhile is taken in soon.
        let patience = (timeout / 16).max(Duration::from_millis(1));
        for pool in self.pools.iter_mut().filter(|pool| !pool.is_settled) {
            if pool.pager.wait(patience) {
                return;
            }
        }
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
        let Self { layers: own, pools, backend, .. } = self;
        // Hidden bricks stop being wanted. Only while the camera moves: for one picture, finding out what is hidden takes more
        // drawing than reading it, and an edit of the transfer function could bring it out.
        let eyes = 1 + scene.stereo.is_some() as usize;
        let is_told = self.clock.is_some() && own.iter().all(|layer| layer.draws.len() == eyes);
        let mut seen: Vec<Option<Vec<f32>>> = vec![is_told.then(Vec::new); own.len()];
        let picture = scene.picture(|eye| {
            let layers = drawn(own, scene, eye);
            let picture = backend.render(&layers, scene.combination.as_ref())?;
            for (i, seen) in seen.iter_mut().enumerate() {
                *seen = match (seen.take(), backend.visibility(i)) {
                    (Some(seen), Some(by_eye)) => Some([&seen, by_eye].concat()),
                    _ => None,
                };
            }
            Ok::<_, BackendError>(picture)
        })?;
        for Pool { layers, pager, .. } in pools {
            for (volume, &layer) in layers.iter().enumerate() {
                // A scene that hides what the last step showed tells nothing of it.
                let cells: usize = own[layer].draws.iter().map(|list| list.cells.len()).sum();
                let told = seen[layer].iter().filter(|seen| seen.len() == cells);
                told.for_each(|seen| pager.feedback(volume, seen));
            }
        }
        Ok(picture)
    }

    /// Makes a lost device anew; its slots are empty. Other errors are the caller's.
    fn recover(&mut self, error: BackendError) -> Result<(), SessionError> {
        self.losses.record(error)?;
        self.backend.renew()?;
        for Pool { layers, pager, .. } in &mut self.pools {
            pager.forget_slots(self.backend.slots(layers[0]))?;
        }
        self.layers.iter_mut().for_each(|layer| layer.draws.clear());
        Ok(())
    }

    /// Streams the last step's views again, until they are settled if they were, else until something is drawn everywhere.
    fn refill(&mut self) -> Result<(), SessionError> {
        let Some((views, was_settled)) = self.last.clone() else { return Ok(()) };
        loop {
            let status = self.step_to(views.clone())?;
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
    pub fn backend(&self) -> &dyn Renderer {
        &*self.backend
    }

    /// Bricks of all layers that fit at once.
    pub fn slots(&self) -> u64 {
        self.pools.iter().map(|pool| self.backend.slots(pool.layers[0]) as u64).sum()
    }

    /// What is drawn now of each layer, for the one eye or the left one.
    pub fn draw_lists(&self) -> impl Iterator<Item = &DrawList> {
        self.layers.iter().filter_map(|layer| layer.draws.first())
    }
}

/// A scene's layers with their draw lists of now, for one eye. Layers that the scene hides are left out.
fn drawn<'a>(layers: &'a [SessionLayer], scene: &'a ResolvedScene, eye: usize) -> Vec<Layer<'a>> {
    let layer = |(volume, own): (usize, &'a SessionLayer)| {
        let shown = scene.layers.iter().find(|layer| layer.place == own.place)?;
        let draw = own.draws.get(eye).or(own.draws.first()).unwrap_or(&NOTHING);
        Some(Layer { volume, frame: &shown.frames[eye], pyramid: own.source.pyramid(), draw, cut: own.cut })
    };
    layers.iter().enumerate().filter_map(layer).collect()
}

/// The draw list of a layer before its first step.
static NOTHING: DrawList = DrawList { cells: Vec::new() };

/// Cells of unlike grids are in no one order from back to front: their fog and surfaces take rays.
fn check_order(volumes: &[VolumeSource], scene: &ResolvedScene, is_sorted: bool) -> Result<(), SessionError> {
    let first = &scene.layers[0];
    let is_on_its_grid = |layer: &ResolvedLayer| {
        let [pyramid, of_first] = [layer, first].map(|layer| volumes[layer.volume].source.pyramid());
        let [own, other] = [layer, first].map(|layer| &layer.frames[0].settings);
        let slots = |settings: &FrameSettings| (settings.encoding.format, settings.encoding.has_invalid);
        let is_one_place = own.geometry == other.geometry && own.placement == other.placement;
        pyramid == of_first && is_one_place && slots(own) == slots(other)
    };
    let has_one_grid = || scene.layers.iter().all(is_on_its_grid);
    let is_projection = first.frames[0].settings.mode.is_projection();
    if !is_sorted || is_projection || has_one_grid() { Ok(()) } else { Err(SessionError::NoOrder) }
}

/// The pools of layers with these needs, all within the host budget.
fn pools_of(
    needs: &[VolumeNeeds],
    sources: &[Arc<dyn BrickSource>],
    backend: &dyn Renderer,
    options: &SessionOptions,
) -> Result<Vec<Pool>, SessionError> {
    let pool_of = pools(needs);
    let count = pool_of.iter().max().map_or(0, |last| last + 1);
    let members: Vec<Vec<usize>> =
        (0..count).map(|pool| (0..needs.len()).filter(|&layer| pool_of[layer] == pool).collect()).collect();
    let bricks = options.bricks;
    let uploads = UploadLimits { bytes: LIVE_UPLOADS.bytes / count as u64, time: LIVE_UPLOADS.time / count as u32 };
    let config = |layers: &Vec<usize>| PagerConfig {
        slots: backend.slots(layers[0]),
        apron: bricks.apron,
        gradient_layers: bricks.gradient_layers,
        host_bytes: 0,
        // Twice as many as there are threads, in all: some wait while others read.
        workers: (2 * options.threads).div_ceil(needs.len()).min(options.threads).max(1) as u32,
        planning: if options.live { Planning::Thread } else { Planning::Inline },
        prefetch: options.live,
        uploads: options.live.then_some(uploads),
        fade: options.live.then_some(LIVE_FADE),
    };
    let configs: Vec<PagerConfig> = members.iter().map(config).collect();
    let of_pool = |layers: &Vec<usize>| layers.iter().map(|&layer| sources[layer].clone()).collect::<Vec<_>>();
    let given = options.host_memory_bytes.saturating_sub(bricks.meshes.bytes());
    let shares = match count {
        1 => vec![given],
        _ => {
            let wishes =
                members.iter().zip(&configs).map(|(layers, config)| Pager::host_wish(&of_pool(layers), config));
            let wishes = wishes.collect::<Result<Vec<Wish>, _>>()?;
            share(given, &wishes).map_err(|least| PagerError::HostMemory { given, least })?
        }
    };
    let pool = |((layers, config), host_bytes): ((Vec<usize>, PagerConfig), u64)| {
        let pager = Pager::new(&of_pool(&layers), PagerConfig { host_bytes, ..config })?;
        Ok(Pool { layers, pager, is_settled: false })
    };
    members.into_iter().zip(configs).zip(shares).map(pool).collect()
}
