//! A session's fit: a backend with slots, and the pagers to fill them, created for the session's scenes. A scene with
//! greater demands (wider aprons, other tables, a larger picture, other layers) gets another fit, which reuses the
//! decoded cores of the last one.
//!
//! Layers with bricks of one slot format share a pool of slots, and a pager, which splits the worst cell of any of them
//! first. Pools get their shares of the budgets once, by their possible use ([`share`]).
//!
//! Creating a fit costs as much as opening a device and compiling shaders, some 100 ms; all slots are filled anew from
//! main memory.

#[cfg(feature = "gpu")]
mod shown;

use crate::session::backend::{self, BackendError, Pictures, Renderer, layer_needs};
use crate::session::device::Device;
use crate::session::options::SessionOptions;
use crate::session::resolve::{ResolvedLayer, ResolvedScene, slot_contents};
use crate::session::session_error::SessionError;
use crate::session::volume_source::VolumeSource;
use brickyard_pager::{
    BrickSource, BudgetRequest, DrawList, KeptCores, Layer, Pager, PagerConfig, PagerError, Planning, Readiness,
    ShownStep, SlotContents, Status, UploadLimits, View, VolumeNeeds, pools, share,
};
use brickyard_volume::{LabelCodes, Needs, Picture, SlotEncoding};
#[cfg(feature = "gpu")]
use shown::Shown;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Upload limits of a live step: about 30 bricks of 64³ 16-bit voxels, in a quarter of a frame at 60 a second.
const LIVE_UPLOADS: UploadLimits = UploadLimits { bytes: 16 << 20, time: Duration::from_millis(4) };

/// Fade-in time of a finer brick: too fast to wait for, slow enough not to catch the eye.
const LIVE_FADE: Duration = Duration::from_millis(200);

/// Targets of live sessions are rounded up to a multiple of this number of pixels, so resizing a window needs another
/// fit now and then, not in every frame.
const LIVE_SIZE_PX: u32 = 256;

/// A scene's demand for slots, tables and targets.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Demand {
    /// The layers, in the order of their places.
    layers: Vec<DemandLayer>,
    /// The pictures' requirements on bricks.
    pub(crate) bricks: Needs,
    /// The greatest picture size, and whether pictures may show expressions.
    pub(crate) pictures: Pictures,
}

impl Demand {
    /// Returns the demand of a scene. In a live session it includes the hidden layers, which keep their coarsest
    /// bricks.
    pub(crate) fn of(scene: &ResolvedScene, is_live: bool) -> Self {
        let mut layers: Vec<_> = DemandLayer::all(scene, is_live).collect();
        layers.sort_unstable_by_key(|layer| layer.place);
        let whole = scene.layers[0].view.rays.whole();
        let room = |px: u32| if is_live { px.div_ceil(LIVE_SIZE_PX) * LIVE_SIZE_PX } else { px };
        Self {
            layers,
            bricks: scene.needs,
            pictures: Pictures { size_px: (room(whole.x1), room(whole.y1)), has_expressions: !scene.is_alone() },
        }
    }

    /// Returns a demand for this one's layers, sufficient for the bricks and pictures of both demands.
    pub(crate) fn grown(&self, before: &Self) -> Self {
        let (own, other) = (&self.pictures, &before.pictures);
        Self {
            layers: self.layers.clone(),
            bricks: self.bricks.union(before.bricks),
            pictures: Pictures {
                size_px: (own.size_px.0.max(other.size_px.0), own.size_px.1.max(other.size_px.1)),
                has_expressions: own.has_expressions || other.has_expressions,
            },
        }
    }
}

/// One layer of a demand.
#[derive(Clone, Debug, PartialEq)]
struct DemandLayer {
    /// The layer's place in scenes.
    place: usize,
    /// The index of the layer's volume in the session.
    volume: usize,
    /// The encoding of the layer's channel in slots: another channel of a 32-bit type has other codes. The mapping from
    /// values in f32 slots to codes is not part of it.
    encoding: SlotEncoding,
    /// The codes of the layer's labels, where these have codes by their look.
    codes: Option<Arc<LabelCodes>>,
}

impl DemandLayer {
    /// The shown layers of a scene, then its hidden ones, if asked for.
    fn all(scene: &ResolvedScene, has_hidden: bool) -> impl Iterator<Item = Self> {
        let shown = scene.layers.iter();
        let shown = shown.map(|own| (own.place, own.volume, &own.frames[0].settings.encoding, &own.codes));
        let hidden = scene.hidden.iter().filter(move |_| has_hidden);
        let hidden = hidden.map(|own| (own.place, own.volume, &own.encoding, &own.codes));
        shown.chain(hidden).map(|(place, volume, encoding, codes)| {
            let (encoding, codes) = (encoding.of_slots(), codes.clone());
            Self { place, volume, encoding, codes }
        })
    }
}

/// A layer with its present draw lists.
struct FitLayer {
    asked: DemandLayer,
    source: Arc<dyn BrickSource>,
    /// A list for each eye of the last step's view.
    draws: Vec<DrawList>,
    /// The cut behind the draw lists: the number of the first layer with this cut.
    cut: u32,
}

/// Layers with common slots, by their numbers, and their pager.
struct Pool {
    layers: Vec<usize>,
    pager: Pager,
    is_settled: bool,
}

/// A backend with the pagers of its pools of slots.
pub(crate) struct Fit {
    pub(crate) demand: Demand,
    layers: Vec<FitLayer>,
    pools: Vec<Pool>,
    pub(crate) backend: Box<dyn Renderer>,
    pub(crate) backend_line: String,
    #[cfg(feature = "gpu")]
    pub(crate) shown: Shown,
}

impl Fit {
    /// Creates a backend on a device, and its pagers. Decoded cores of these volumes are taken from `kept`.
    ///
    /// # Errors
    /// If no backend can be created, it lacks the compositor, or a budget is too small; the message then names the
    /// least sufficient budget.
    pub(crate) fn make(
        volumes: &[VolumeSource],
        demand: Demand,
        options: &SessionOptions,
        device: &mut Device,
        kept: &mut Vec<KeptCores>,
    ) -> Result<Self, SessionError> {
        let sources: Vec<_> = demand.layers.iter().map(|layer| volumes[layer.volume].source.clone()).collect();
        let needs = demand.layers.iter().zip(&sources);
        let needs = needs.map(|(layer, source)| layer_needs(&**source, layer.encoding, demand.bricks, options.live));
        let needs: Vec<VolumeNeeds> = needs.collect();
        let contents = demand.layers.iter().map(|layer| slot_contents(&layer.encoding, layer.codes.as_ref()));
        let contents: Vec<SlotContents> = contents.collect();
        let (backend, backend_line) = backend::open(device, &needs, &demand.pictures, options)?;
        let pools = match pools_of(&needs, &sources, &contents, &*backend, options, kept) {
            Ok(pools) => pools,
            Err(error) => {
                backend::end(backend, device, false);
                return Err(error);
            }
        };
        let layer = |(asked, source)| FitLayer { asked, source, draws: Vec::new(), cut: 0 };
        let layers = demand.layers.iter().cloned().zip(sources).map(layer).collect();
        Ok(Self {
            demand,
            layers,
            pools,
            backend,
            backend_line,
            #[cfg(feature = "gpu")]
            shown: Shown::default(),
        })
    }

    pub(crate) fn suffices(&self, scene: &ResolvedScene, asked: &Demand) -> bool {
        let Demand { bricks, pictures: Pictures { size_px, has_expressions }, .. } = self.demand;
        let of_scene: Vec<_> = DemandLayer::all(scene, true).collect();
        asked.layers.iter().all(|layer| self.layers.iter().any(|own| own.asked == *layer))
            && self.layers.iter().all(|own| of_scene.contains(&own.asked))
            && bricks.satisfy(&asked.bricks)
            && (has_expressions || scene.combination.is_none())
            && size_px.0 >= asked.pictures.size_px.0
            && size_px.1 >= asked.pictures.size_px.1
    }

    /// The slots' encoding for the layer at a place of a volume; `None` if there is no such layer.
    pub(crate) fn slots_of(&self, place: usize, volume: usize) -> Option<SlotEncoding> {
        let is_it = |own: &&FitLayer| (own.asked.place, own.asked.volume) == (place, volume);
        self.layers.iter().find(is_it).map(|own| own.asked.encoding)
    }

    /// Ends the fit: returns the decoded cores, and gives the device back, both for the next fit. With `keeps_picture`,
    /// the device keeps the last shown picture.
    pub(crate) fn into_cores(self, device: &mut Device, keeps_picture: bool) -> Vec<KeptCores> {
        backend::end(self.backend, device, keeps_picture);
        self.pools.into_iter().flat_map(|pool| pool.pager.into_cores()).collect()
    }

    /// Returns a scene's view for each layer of the fit, hidden layers included, at a step of the scene's timeline.
    pub(crate) fn views_at(&self, scene: &ResolvedScene, ShownStep { step, level_bias }: ShownStep) -> Vec<View> {
        let shown = scene.layers.iter().map(|layer| (layer.place, &layer.view));
        let all = shown.chain(scene.hidden.iter().map(|layer| (layer.place, &layer.view)));
        let view = |own: &FitLayer| {
            let (_, view) = all.clone().find(|(place, _)| *place == own.asked.place)?;
            let time = scene.timeline.step_of(own.asked.volume, step);
            Some(View { time, pixel_error: view.pixel_error * level_bias.exp2(), ..view.clone() })
        };
        // Complete for a scene within the fit.
        self.layers.iter().filter_map(view).collect()
    }

    /// Streams one step towards `views`, one for each layer: collects bricks, plans and uploads. `coming` are the next
    /// views, the nearest first. `at` is the time of the step. Returns the joint status of all layers, and the
    /// readiness of each coming view; `None` if there are no layers.
    pub(crate) fn step(
        &mut self,
        views: &[View],
        coming: &[Vec<View>],
        at: Duration,
    ) -> Result<Option<(Status, Vec<Readiness>)>, BackendError> {
        let mut whole: Option<(Status, Vec<Readiness>)> = None;
        #[cfg(feature = "gpu")]
        self.hear()?;
        for pool in &mut self.pools {
            if let Some(room) = self.backend.upload_room_bytes(pool.layers[0]) {
                pool.pager.limit_uploads(room);
            }
            let of_pool = |views: &[View]| pool.layers.iter().map(|&layer| views[layer].clone()).collect::<Vec<_>>();
            pool.pager.expect(coming.iter().map(|views| of_pool(views)).collect());
            let frame = pool.pager.frame(&of_pool(views), at);
            let begun = Instant::now();
            for upload in &frame.uploads {
                let before = self.backend.upload(pool.layers[upload.volume], upload)?;
                before.into_iter().for_each(|before| pool.pager.take_for(upload, before));
            }
            self.backend.submit_uploads()?;
            pool.pager.uploads_took(begun.elapsed());
            for (&layer, drawn) in pool.layers.iter().zip(frame.volumes) {
                let layer = &mut self.layers[layer];
                layer.draws = std::iter::once(drawn.draw).chain(drawn.draw_other_eye).collect();
                layer.cut = pool.layers[drawn.cut] as u32;
            }
            pool.is_settled = frame.status.settled;
            whole = Some(match whole {
                None => (frame.status, frame.coming),
                Some((status, coming)) => {
                    let coming = coming.into_iter().zip(frame.coming).map(|(a, b)| a.and(b)).collect();
                    (status.and(&frame.status), coming)
                }
            });
        }
        if whole.as_ref().is_some_and(|(status, _)| !status.covered) {
            // All layers appear at once: a picture of some would have holes.
            self.layers.iter_mut().for_each(|layer| layer.draws.clear());
        }
        Ok(whole)
    }

    /// Waits for at most `timeout` until a brick arrives.
    pub(crate) fn wait(&mut self, timeout: Duration) {
        if let [pool] = &mut self.pools[..] {
            pool.pager.wait(timeout);
            return;
        }
        // In turn: arrivals in another pool meanwhile are collected soon.
        let patience = (timeout / 16).max(Duration::from_millis(1));
        for pool in self.pools.iter_mut().filter(|pool| !pool.is_settled) {
            if pool.pager.wait(patience) {
                return;
            }
        }
    }

    /// Renders a scene from the bricks in the slots. If `tells`, the pagers receive visibility feedback.
    pub(crate) fn draw(&mut self, scene: &ResolvedScene, tells: bool) -> Result<Picture, BackendError> {
        let Self { layers: own, pools, backend, .. } = self;
        let eyes = scene.eyes();
        let is_told = tells && own.iter().all(|layer| layer.draws.len() == eyes);
        let mut seen: Vec<Option<Vec<f32>>> = vec![is_told.then(Vec::new); own.len()];
        let picture = scene.picture(|eye| {
            let layers = drawn(own, scene, eye);
            let picture = backend.render(&layers, scene.combination.as_ref())?;
            for (i, seen) in seen.iter_mut().enumerate() {
                *seen = seen.take().zip(backend.visibility(i)).map(|(seen, by_eye)| [&seen, by_eye].concat());
            }
            Ok::<_, BackendError>(picture)
        })?;
        for Pool { layers, pager, .. } in pools {
            for (volume, &layer) in layers.iter().enumerate() {
                // A scene that hides layers of the last step yields no feedback on them.
                let cells: usize = own[layer].draws.iter().map(|list| list.cells.len()).sum();
                let told = seen[layer].iter().filter(|seen| seen.len() == cells);
                let drawn = pager.drawn(volume);
                told.zip(&drawn).for_each(|(seen, drawn)| pager.feedback(volume, drawn, seen));
            }
        }
        Ok(picture)
    }

    /// Prepares the drawing of a scene on another thread, for example by compiling shaders.
    pub(crate) fn prepare(&mut self, scene: &ResolvedScene) {
        self.backend.prepare(&drawn(&self.layers, scene, 0), scene.combination.as_ref());
    }

    /// Whether nothing is left to prepare for drawing a scene.
    pub(crate) fn is_prepared(&self, scene: &ResolvedScene) -> bool {
        self.backend.is_prepared(&drawn(&self.layers, scene, 0), scene.combination.as_ref())
    }

    /// Creates a lost device anew. All slots are then empty.
    pub(crate) fn renew(&mut self) -> Result<(), SessionError> {
        self.backend.renew()?;
        for Pool { layers, pager, .. } in &mut self.pools {
            pager.forget_slots(self.backend.slots(layers[0]))?;
        }
        self.layers.iter_mut().for_each(|layer| layer.draws.clear());
        Ok(())
    }

    /// Capacity of all pools in bricks.
    pub(crate) fn slots(&self) -> u64 {
        self.pools.iter().map(|pool| self.backend.slots(pool.layers[0]) as u64).sum()
    }

    pub(crate) fn draw_lists(&self) -> impl Iterator<Item = &DrawList> {
        self.layers.iter().filter_map(|layer| layer.draws.first())
    }

    pub(crate) fn lists_of(&self, place: usize) -> &[DrawList] {
        self.layers.iter().find(|layer| layer.asked.place == place).map_or(&[], |layer| &layer.draws)
    }
}

/// Returns a scene's visible layers with their present draw lists, for one eye.
fn drawn<'a>(layers: &'a [FitLayer], scene: &'a ResolvedScene, eye: usize) -> Vec<Layer<'a>> {
    let layer = |(volume, own): (usize, &'a FitLayer)| {
        let shown: &ResolvedLayer = scene.layers.iter().find(|layer| layer.place == own.asked.place)?;
        let draw = own.draws.get(eye).or(own.draws.first()).unwrap_or(&NOTHING);
        Some(Layer { volume, frame: &shown.frames[eye], pyramid: own.source.pyramid(), draw, cut: own.cut })
    };
    layers.iter().enumerate().filter_map(layer).collect()
}

/// The draw list of a layer before its first step.
static NOTHING: DrawList = DrawList { cells: Vec::new() };

/// Creates the pools of layers with these needs, all within the host budget.
fn pools_of(
    needs: &[VolumeNeeds],
    sources: &[Arc<dyn BrickSource>],
    contents: &[SlotContents],
    backend: &dyn Renderer,
    options: &SessionOptions,
    kept: &mut Vec<KeptCores>,
) -> Result<Vec<Pool>, SessionError> {
    let pool_of = pools(needs);
    let count = pool_of.iter().max().map_or(0, |last| last + 1);
    let members: Vec<Vec<usize>> =
        (0..count).map(|pool| (0..needs.len()).filter(|&layer| pool_of[layer] == pool).collect()).collect();
    let bricks = needs[0].bricks;
    let uploads = UploadLimits { bytes: LIVE_UPLOADS.bytes / count as u64, time: LIVE_UPLOADS.time / count as u32 };
    let config = |layers: &Vec<usize>| PagerConfig {
        slots: backend.slots(layers[0]),
        apron: bricks.apron,
        gradient_layers: bricks.gradient_layers,
        host_bytes: 0,
        contents: layers.iter().map(|&layer| contents[layer].clone()).collect(),
        keeps_decoded: options.keeps_decoded,
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
            let requests =
                members.iter().zip(&configs).map(|(layers, config)| Pager::host_request(&of_pool(layers), config));
            let requests = requests.collect::<Result<Vec<BudgetRequest>, _>>()?;
            share(given, &requests).map_err(|least| PagerError::HostMemory { given, least })?
        }
    };
    let pool = |((layers, config), host_bytes): ((Vec<usize>, PagerConfig), u64)| {
        let pager = Pager::with_cores(&of_pool(&layers), PagerConfig { host_bytes, ..config }, kept)?;
        Ok(Pool { layers, pager, is_settled: false })
    };
    members.into_iter().zip(configs).zip(shares).map(pool).collect()
}
