//! Scenes resolved for stores and a picture size: each shown layer gets a view, for streaming its bricks, and frames,
//! for drawing. Costs a transfer table for each function without a kept one.

use crate::session::session_error::SessionError;
use crate::session::volume_source::VolumeSource;
use brickyard_pager::{Caps, SlotContents, View};
use brickyard_volume::lattice::MAX_ZONES;
use brickyard_volume::layer::label_codes;
use brickyard_volume::{
    Camera, Clip, Combination, Expression, Filter, FrameSettings, Geometry, KeptSlots, LabelCodes, Lattice, LayerError,
    Level, LevelGrid, LevelPolicy, LightingModel, Mode, Needs, Occupancy, Picture, PixelSample, PixelSamples,
    Placement, Region, Scene, SceneError, SceneLayer, ShownMesh, Slice, SlotEncoding, Standing, StereoLayout,
    StoreCounts, Surface, Timeline, TransferFunction, TransferTable, ViewRays, VolumeFrame, Window,
};
use glam::DVec3;
use std::borrow::Cow;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::Arc;

/// The longest step of a moving view, in steps of the exact frame: longer ones skip features that the eye follows.
pub(crate) const MAX_STEP: f64 = 4.0;

/// A scene resolved for volumes and a picture size, as pagers and renderers need it.
#[derive(Clone, Debug)]
pub struct ResolvedScene {
    /// The shown layers, at least one.
    pub layers: Vec<ResolvedLayer>,
    /// The hidden layers.
    pub hidden: Vec<HiddenLayer>,
    /// The shown time step of the timeline.
    pub time: u32,
    /// The time steps of all layers.
    pub timeline: Timeline,
    /// Samples of each pixel of a settled picture.
    pub pixel_samples: PixelSamples,
    /// How the pictures of two eyes become one; `None` is one eye.
    pub stereo: Option<StereoLayout>,
    /// How a pixel's samples are combined.
    pub mode: Mode,
    /// The shown slice; `None` shows the volumes whole.
    pub slice: Option<Slice>,
    /// The camera in use: the scene's, or by default one in view of all layers.
    pub camera: Camera,
    /// The box around all layers in the world: its least and greatest corner.
    pub world_box: (DVec3, DVec3),
    /// Whether the world is a patient's: x to the right, y to the front, z to the head.
    pub is_anatomical: bool,
    /// The picture's requirements on bricks and their tables.
    pub needs: Needs,
    /// The expression over the layers and its look; `None` shows the layers themselves.
    pub combination: Option<Combination>,
}

/// A shown layer of a resolved scene.
#[derive(Clone, Debug)]
pub struct ResolvedLayer {
    /// The layer's place in the scene.
    pub place: usize,
    /// The place of the layer's store among those resolved for.
    pub volume: usize,
    /// The scene's layer, with its transfer function written out unless an expression replaces it.
    pub style: SceneLayer,
    /// The view for the layer's pager. In stereo it holds both eyes, the left one first.
    pub view: View,
    /// The layer's frames for the renderer, one for each eye, the left one first.
    pub frames: Vec<VolumeFrame>,
    /// The transfer function in use, with the layer's opacity applied.
    pub transfer: TransferFunction,
    /// The codes of the layer's labels, where these are further apart than 16 bits reach.
    pub(crate) codes: Option<Arc<LabelCodes>>,
}

/// A hidden layer of a resolved scene.
#[derive(Clone, Debug)]
pub struct HiddenLayer {
    /// The layer's place in the scene.
    pub place: usize,
    /// The place of the layer's store among those resolved for.
    pub volume: usize,
    /// The encoding of the channel's values as slot codes.
    pub encoding: SlotEncoding,
    /// The codes of the layer's labels, where these are further apart than 16 bits reach.
    pub(crate) codes: Option<Arc<LabelCodes>>,
    /// A view in which the layer is clear: a pager keeps its coarsest bricks for its return.
    pub view: View,
}

impl ResolvedScene {
    /// Returns `scene`, the source of this one, with its open camera and transfer functions filled in.
    pub fn shown(&self, scene: &Scene) -> Scene {
        let mut shown = Scene { camera: Some(self.camera), time: self.time, ..scene.clone() };
        for layer in &self.layers {
            shown.layers[layer.place].clone_from(&layer.style);
        }
        if let (Some(expression), Some(combination)) = (&mut shown.expression, &self.combination) {
            expression.transfer = Some(combination.transfer.clone().into());
        }
        shown
    }

    /// Returns this scene at another time step of its timeline. Each layer shows the step of its volume taken by then.
    pub fn at_step(&self, time: u32) -> Self {
        let mut scene = self.clone();
        scene.set_step(time);
        scene
    }

    fn set_step(&mut self, time: u32) {
        let Self { layers, hidden, timeline, .. } = self;
        layers.iter_mut().for_each(|layer| layer.view.time = timeline.step_of(layer.volume, time));
        hidden.iter_mut().for_each(|layer| layer.view.time = timeline.step_of(layer.volume, time));
        self.time = time;
    }

    /// Number of eyes whose pictures the scene's picture is made of.
    pub fn eyes(&self) -> usize {
        1 + usize::from(self.stereo.is_some())
    }

    /// Rows of the pictures of all eyes.
    pub fn rows(&self) -> u32 {
        self.layers[0].frames.iter().map(|frame| frame.settings.rays.height).sum()
    }

    /// Makes the picture of the scene. `draw` draws an eye's picture, given its number: 0 for the only or left eye, 1
    /// for the right one.
    ///
    /// # Errors
    /// The error of `draw`, if it fails.
    pub fn picture<E>(&self, mut draw: impl FnMut(usize) -> Result<Picture, E>) -> Result<Picture, E> {
        let first = draw(0)?;
        let Some(layout) = self.stereo else { return Ok(first) };
        let second = draw(1)?;
        Ok(layout.compose([&first, &second]))
    }

    /// Makes the picture of the scene as the mean of its pixels' samples. `draw` draws the scene of one sample of all
    /// pixels.
    ///
    /// # Errors
    /// The first error of `draw`.
    pub(crate) fn supersampled<E>(&self, mut draw: impl FnMut(&Self) -> Result<Picture, E>) -> Result<Picture, E> {
        if self.pixel_samples == PixelSamples::ONE {
            return draw(self);
        }
        self.pixel_samples.picture(|sample| draw(&self.of_sample(sample)))
    }

    /// Returns the scene with this single sample of each pixel.
    pub(crate) fn of_sample(&self, PixelSample { offset_px, phase }: PixelSample) -> Self {
        let mut scene = Self { pixel_samples: PixelSamples::ONE, ..self.clone() };
        for ResolvedLayer { view, frames, .. } in &mut scene.layers {
            view.rays = view.rays.moved_by_px(offset_px);
            view.other_eye = view.other_eye.map(|rays| rays.moved_by_px(offset_px));
            for VolumeFrame { settings, .. } in frames {
                settings.rays = settings.rays.moved_by_px(offset_px);
                settings.lattice.phase = phase;
            }
        }
        scene
    }

    /// Returns the scene as seen by one eye: 0 for the left one, 1 for the right one.
    pub(crate) fn of_eye(&self, eye: usize) -> Self {
        let mut scene = Self { stereo: None, ..self.clone() };
        for layer in &mut scene.layers {
            let view = if eye == 0 { layer.view.clone() } else { layer.view.from_other_eye() };
            layer.view = View { other_eye: None, ..view };
            layer.frames = vec![layer.frames.swap_remove(eye)];
        }
        scene.hidden.iter_mut().for_each(|layer| layer.view.other_eye = None);
        scene
    }

    /// Whether the scene is a single plain layer in its own world, without an expression, whose own picture is the
    /// scene's.
    pub fn is_alone(&self) -> bool {
        let in_its_own_world = |layer: &ResolvedLayer| layer.view.placement.is_identity();
        let alone = matches!(&self.layers[..], [layer] if in_its_own_world(layer) && layer.frames[0].is_plain());
        alone && self.combination.is_none()
    }
}

/// The rays of one eye or two.
struct Eyes {
    rays: Vec<ViewRays>,
    layout: Option<StereoLayout>,
}

impl Eyes {
    fn new(scene: &Scene, camera: &Camera, size_px: (u32, u32)) -> Result<Self, SessionError> {
        Ok(match &scene.stereo {
            None => Self { rays: vec![camera.rays(size_px.0, size_px.1)?], layout: None },
            Some(stereo) => Self { rays: stereo.eyes(camera, size_px)?.into(), layout: Some(stereo.layout) },
        })
    }
}

/// Resolves a scene for volumes and a picture size: fills in the camera and transfer functions left open, makes
/// transfer tables, and lays out the lattice.
///
/// # Errors
/// If the scene is invalid ([`Scene::check`]), or its camera is.
pub fn resolve(volumes: &[VolumeSource], scene: &Scene, size_px: (u32, u32)) -> Result<ResolvedScene, SessionError> {
    let table = |_, _, transfer: &TransferFunction, encoding: &_| TransferTable::new(transfer, encoding).into();
    resolve_with(volumes, scene, size_px, table, |_, _| KeptSlots::default())
}

/// Resolves a scene like [`resolve`], with transfer tables from `table`, given a store's place and channel, a transfer
/// function and a code encoding. Existing slots, from `kept` for a layer's place and its store's, stay where possible.
pub(crate) fn resolve_with(
    volumes: &[VolumeSource],
    scene: &Scene,
    size_px: (u32, u32),
    table: impl Fn(usize, u32, &TransferFunction, &SlotEncoding) -> Arc<TransferTable>,
    kept: impl Fn(usize, usize) -> KeptSlots,
) -> Result<ResolvedScene, SessionError> {
    let counts: Vec<StoreCounts> = volumes.iter().map(VolumeSource::counts).collect();
    scene.check(&counts)?;
    let mut shown = shown_layers(volumes, scene)?;
    let combination =
        expression_look(volumes, scene)?.map(|(read, transfer)| Combination::new(read.of_its_own(), transfer));
    if let Some(combination) = &combination {
        let windows: Vec<[f64; 2]> =
            shown.iter().map(|layer| layer.volume.source.channel_range(layer.style.channel).into()).collect();
        shown.iter_mut().enumerate().for_each(|(i, layer)| layer.transfer = combination.of_volume(i, &windows));
    }
    let places: Vec<_> = volumes.iter().map(VolumeSource::place).collect();
    let world_box = scene.world_box(&places)?;
    let camera = scene.camera_for(&places, size_px)?;
    let eyes = Eyes::new(scene, &camera, size_px)?;
    check_reach(volumes, scene, &eyes.rays)?;
    let is_anatomical = scene.is_anatomical(&places);
    let scene = &*with_exact_cuts(scene, &shown)?;
    let lattice = lattice(&shown, scene, &eyes.rays[0]);
    let is_shown = |place: &usize| shown.iter().any(|layer| layer.place == *place);
    let hidden = (0..scene.layers.len()).filter(|place| !is_shown(place));
    let hidden = hidden.map(|place| hidden_layer(place, volumes, scene, &eyes, kept(place, scene.store(place))));
    let hidden = hidden.collect::<Result<_, _>>()?;
    let layers = shown.into_iter().map(|layer| {
        let kept = kept(layer.place, layer.store);
        layer.resolve(scene, &eyes, lattice, &table, kept)
    });
    let mut layers = layers.collect::<Result<Vec<ResolvedLayer>, _>>()?;
    if layers.len() > 1 || combination.is_some() {
        let appearance = joint_appearance(&layers, combination.as_ref());
        layers.iter_mut().for_each(|layer| layer.view.appearance = appearance);
    }
    let mut resolved = ResolvedScene {
        layers,
        hidden,
        time: scene.time,
        timeline: VolumeSource::timeline(volumes, scene),
        pixel_samples: scene.pixel_samples,
        stereo: eyes.layout,
        mode: scene.mode,
        slice: scene.slice,
        camera,
        world_box,
        is_anatomical,
        needs: scene.needs(),
        combination,
    };
    resolved.set_step(scene.time);
    Ok(resolved)
}

/// Checks whether a scene of these volumes can be shown. Creates nothing.
///
/// # Errors
/// If the scene is [impossible](Scene::check), or its own camera is too far away, or shows too small a part.
pub fn check(volumes: &[VolumeSource], scene: &Scene) -> Result<(), SceneError> {
    let counts: Vec<StoreCounts> = volumes.iter().map(VolumeSource::counts).collect();
    scene.check(&counts)?;
    // Faults of the camera itself depend on the picture's size.
    let eyes = scene.camera.and_then(|camera| Eyes::new(scene, &camera, (2, 2)).ok());
    eyes.map_or(Ok(()), |eyes| check_reach(volumes, scene, &eyes.rays))
}

/// Checks whether rays from these eyes reach all shown layers.
fn check_reach(volumes: &[VolumeSource], scene: &Scene, eyes: &[ViewRays]) -> Result<(), SceneError> {
    let layers = scene.shown_layers()?.into_iter().map(|place| {
        let volume = &volumes[scene.store(place)];
        Ok((place, volume, scene.placement(place, &volume.place())?))
    });
    let layers = layers.collect::<Result<Vec<_>, SceneError>>()?;
    let voxel_size = |(_, volume, placement): &(usize, &VolumeSource, Placement)| {
        placement.voxel_size(volume.source.geometry(), volume.extent())
    };
    let step = scene.step * layers.iter().map(voxel_size).fold(f64::INFINITY, f64::min);
    for (layer, volume, placement) in &layers {
        let standing = Standing { geometry: volume.source.geometry(), extent: volume.extent(), placement };
        let checked = eyes.iter().try_for_each(|rays| standing.check(rays, step));
        checked.map_err(|error| SceneError::Layer { layer: *layer, error: error.into() })?;
    }
    Ok(())
}

/// Returns the contents of a layer's slots; `codes` are those of labels with codes by their look.
pub(crate) fn slot_contents(encoding: &SlotEncoding, codes: Option<&Arc<LabelCodes>>) -> SlotContents {
    match (encoding.floats, codes) {
        (Some(floats), _) => SlotContents::Floats(floats),
        (None, Some(codes)) => SlotContents::Labels(codes.clone()),
        (None, None) => SlotContents::Codes,
    }
}

/// Returns the shown layers. Under an expression, their looks are left alone.
fn shown_layers<'a>(volumes: &'a [VolumeSource], scene: &Scene) -> Result<Vec<ShownLayer<'a>>, SceneError> {
    let shown = |place: usize| {
        let (layer, store) = (&*scene.look(place), scene.store(place));
        let volume = &volumes[store];
        let refused = |error| SceneError::Layer { layer: place, error };
        let function = volume.function(layer).map_err(refused)?;
        let codes = label_codes(&function, &volume.encoding(layer.channel)).map_err(refused)?;
        if scene.expression.is_some() && codes.is_some() {
            return Err(refused(LayerError::HashedLabels));
        }
        let window = window_of(&function, layer, scene, volume);
        let transfer = function.scaled(layer.opacity);
        let style = if scene.expression.is_some() { layer.clone() } else { layer.written_out(function) };
        let placement = scene.placement(place, &volume.place())?;
        Ok(ShownLayer { place, store, volume, placement, style, transfer, window, codes })
    };
    scene.shown_layers()?.into_iter().map(shown).collect()
}

/// Returns the window of a layer's look. A look by gradients, equal at all values, gets the window of nearly all
/// values.
fn window_of(function: &TransferFunction, layer: &SceneLayer, scene: &Scene, volume: &VolumeSource) -> Option<Window> {
    let is_by_gradient = function.is_by_gradient();
    let has_gradients = is_by_gradient || scene.lighting.model != LightingModel::None;
    let of_values = || {
        let (low, high) = volume.default_window(layer.channel);
        Window { is_by_gradient, ..Window::of([low, high]) }
    };
    Window::new(function, &layer.isosurfaces, scene.mode).or_else(|| has_gradients.then(of_values))
}

/// Returns the scene's expression, if any, and its look: the scene's, or by default a gray ramp over all possible
/// values.
///
/// # Errors
/// If it cannot be shown.
pub(crate) fn expression_look(
    volumes: &[VolumeSource],
    scene: &Scene,
) -> Result<Option<(Expression, TransferFunction)>, SceneError> {
    let (Some(read), Some(look)) = (scene.parsed_expression()?, &scene.expression) else { return Ok(None) };
    let volume = |place: usize| &volumes[scene.store(place)];
    let windows = scene.layers.iter().enumerate().map(|(i, layer)| volume(i).default_window(layer.channel));
    let subject = volume(read.volumes()[0]).subject_of(read.window(windows));
    let transfer = look.function(&subject).map_err(SceneError::ExpressionTransfer)?;
    Ok(Some((read, transfer)))
}

/// Returns the view of a layer in which it is clear, at any level.
fn clear_view(scene: &Scene, eyes: &Eyes, channel: u32, placement: Placement) -> View {
    View {
        rays: eyes.rays[0],
        other_eye: eyes.rays.get(1).copied(),
        opaque: Some(Occupancy::NONE),
        caps: None,
        filter: scene.sampling.filter,
        level: LevelPolicy::Auto,
        pixel_error: scene.pixel_error,
        time: scene.time,
        channel,
        clip: None,
        placement,
        appearance: 0,
        window: None,
    }
}

fn hidden_layer(
    place: usize,
    volumes: &[VolumeSource],
    scene: &Scene,
    eyes: &Eyes,
    kept: KeptSlots,
) -> Result<HiddenLayer, SceneError> {
    let (layer, volume) = (&*scene.look(place), scene.store(place));
    let source = &volumes[volume];
    let view = clear_view(scene, eyes, layer.channel, scene.placement(place, &source.place())?);
    // As if shown, so the same slots serve when it is. A look that cannot be made is refused then.
    let function = source.function(layer).ok();
    let codes = function.as_ref().and_then(|look| label_codes(look, &source.encoding(layer.channel)).ok().flatten());
    let window = function.and_then(|function| window_of(&function, layer, scene, source));
    let encoding = source.encoding(layer.channel).for_window(window, kept);
    let codes = encoding.is_hashed.then(|| Arc::new(codes.unwrap_or_default()));
    Ok(HiddenLayer { place, volume, encoding, codes, view })
}

/// Hashes everything in a picture of several layers on which the occlusion of bricks by others depends.
fn joint_appearance(layers: &[ResolvedLayer], combination: Option<&Combination>) -> u64 {
    let mut hasher = DefaultHasher::new();
    for ResolvedLayer { volume, view, frames, .. } in layers {
        (volume, view.appearance, view.channel, frames[0].blend).hash(&mut hasher);
        view.placement.rows().as_flattened().iter().for_each(|number| number.to_bits().hash(&mut hasher));
        if let Some(clip) = &view.clip {
            let planes = clip.planes().iter().flat_map(|plane| [plane.point, plane.normal]);
            for point in clip.corners().into_iter().chain(planes) {
                point.to_array().map(f64::to_bits).hash(&mut hasher);
            }
        }
    }
    if let Some(Combination { expression, table, .. }) = combination {
        (expression.text(), table.unit_distance.to_bits()).hash(&mut hasher);
        table.entries.iter().for_each(|entry| entry[3].to_bits().hash(&mut hasher));
    }
    hasher.finish()
}

/// The most bricks of level 0 in a volume drawn at that level because of a cut: those of 512^3 voxels.
const MOST_CUT_BRICKS: u64 = 512;

/// Returns the scene at level 0 if a cut layer is projected by the extremes of coarse voxels, which do not end at cuts,
/// and no layer has many bricks; otherwise as it is.
fn with_exact_cuts<'a>(scene: &'a Scene, shown: &[ShownLayer<'_>]) -> Result<Cow<'a, Scene>, SceneError> {
    let mut is_any_cut = false;
    for layer in shown {
        let [x, y, z] = layer.volume.source.pyramid().level(Level(0)).bricks.to_array().map(u64::from);
        if scene.level != LevelPolicy::Auto || x * y * z > MOST_CUT_BRICKS {
            return Ok(Cow::Borrowed(scene));
        }
        // Each frame is resolved, and in fog no layer keeps extremes.
        if layer.volume.keeps_extremes(scene.mode) {
            is_any_cut |= layer.style.crop.is_some() || scene.world_clip()?.is_some() || scene.slice.is_some();
        }
    }
    Ok(match is_any_cut {
        true => Cow::Owned(Scene { level: LevelPolicy::Locked(0), ..scene.clone() }),
        false => Cow::Borrowed(scene),
    })
}

/// Lays out one lattice for all shown layers: steps of the finest volume's voxel, in zones out to the greatest number
/// of levels. With layers read by [boxes](brickyard_volume::extremes), steps are at most voxels, and zones twice as far
/// away: segments are then at most half a voxel long where the view wants their level, and a whole one past that.
fn lattice(shown: &[ShownLayer<'_>], scene: &Scene, rays: &ViewRays) -> Lattice {
    let finest = shown.iter().map(ShownLayer::voxel_size).fold(f64::INFINITY, f64::min);
    let has_boxes = shown.iter().any(|layer| layer.volume.keeps_extremes(scene.mode));
    let step = match has_boxes {
        true => scene.step.min(1.0) * shown.iter().map(ShownLayer::shortest_step).fold(finest, f64::min),
        false => scene.step * finest,
    };
    let zones = |layer: &ShownLayer<'_>| {
        let coarser = (layer.voxel_size() / finest).log2().floor() as usize;
        layer.volume.source.pyramid().levels().len() + coarser
    };
    let zones = shown.iter().map(zones).max().unwrap_or(1).min(MAX_ZONES);
    match scene.level {
        LevelPolicy::Auto if has_boxes => Lattice::for_view(step, finest, rays, 0.5 * scene.pixel_error, zones),
        LevelPolicy::Auto => Lattice::for_view(step, finest, rays, scene.pixel_error, zones),
        LevelPolicy::Locked(level) => {
            Lattice::uniform(step, (level as usize).min(zones - 1).saturating_sub(has_boxes.into()))
        }
    }
}

/// A visible layer of a scene.
struct ShownLayer<'a> {
    place: usize,
    store: usize,
    volume: &'a VolumeSource,
    placement: Placement,
    style: SceneLayer,
    transfer: TransferFunction,
    codes: Option<LabelCodes>,
    /// The window of its look.
    window: Option<Window>,
}

impl ShownLayer<'_> {
    fn voxel_size(&self) -> f64 {
        self.placement.voxel_size(self.volume.source.geometry(), self.volume.extent())
    }

    /// Returns the greatest length that, doubled from each level to the next, exceeds no level's voxel. Levels of
    /// anisotropic voxels become coarser by less.
    fn shortest_step(&self) -> f64 {
        let geometry = self.volume.source.geometry();
        let levels = self.volume.source.pyramid().levels().iter().enumerate();
        let of_level = |(level, grid): (usize, &LevelGrid)| {
            let (spacing, _) = geometry.level_placement(grid.factor);
            let voxels = Geometry { spacing, ..geometry.clone() };
            self.placement.voxel_size(&voxels, grid.extent) / (1u64 << level) as f64
        };
        levels.map(of_level).fold(f64::INFINITY, f64::min)
    }

    /// Resolves the layer's view and frames, on the common lattice.
    fn resolve(
        self,
        scene: &Scene,
        eyes: &Eyes,
        lattice: Lattice,
        table: impl FnOnce(usize, u32, &TransferFunction, &SlotEncoding) -> Arc<TransferTable>,
        kept: KeptSlots,
    ) -> Result<ResolvedLayer, SceneError> {
        let Self { place, store, volume, placement, style, transfer, window, codes } = self;
        let SceneLayer { channel, crop, opacity, .. } = style;
        let blend = scene.blend(place, volume.source.is_labels());
        let (geometry, rays) = (volume.source.geometry().clone(), eyes.rays[0]);
        let is_nearest = volume.source.is_labels() || scene.sampling.filter == Filter::Nearest;
        let crop = crop.map(|corners| corners.map(|corner| geometry.world_from_voxel(corner)));
        let inside = |clip: Option<Clip>| match is_nearest {
            true => clip.map(|clip| clip.inside_voxels(&geometry, volume.extent(), rays.eye)),
            false => clip,
        };
        let mut clip = Clip::in_volume(scene.world_clip()?.as_ref(), &placement, crop)?;
        match &scene.slice {
            None => clip = inside(clip),
            Some(slice) => {
                let sides = slice.sides(&rays, &geometry, volume.extent(), is_nearest.then_some(&placement));
                // The thinnest slices are clear of faces already.
                let is_clear = slice.is_thinnest(&rays, &geometry, volume.extent());
                let between = |clip| Clip::between(clip, &sides, &placement).map(Some);
                clip = if is_clear { between(inside(clip))? } else { inside(between(clip)?) };
            }
        }
        let (encoding, shown) = match &scene.expression {
            None => (volume.encoding(channel).for_window(window, kept), None),
            Some(_) => {
                let (low, high) = volume.default_window(channel);
                let encoding = volume.encoding(channel).for_values([low, high], kept);
                // Floats have no codes, so none that are clear.
                (encoding, encoding.floats.map(|_| opaque(transfer.unit_distance)))
            }
        };
        let table = table(store, channel, shown.as_ref().unwrap_or(&transfer), &encoding);
        let surfaces = Surface::all(&style.isosurfaces, &transfer, &encoding);
        let meshes = scene.shown_meshes()?;
        let (opaque, inside) = bins_seen(volume, channel, scene.mode, &transfer, &table, &encoding, &surfaces);
        let view = View {
            opaque,
            caps: scene.has_caps().then(|| Caps { bins: inside, lattice: lattice.with_longer_steps(MAX_STEP) }),
            level: match scene.level {
                // The coarsest level of a volume without this one.
                LevelPolicy::Locked(level) => LevelPolicy::Locked(level.min(volume.source.pyramid().coarsest().0)),
                LevelPolicy::Auto => LevelPolicy::Auto,
            },
            clip: clip.clone(),
            appearance: appearance(&table, &encoding, &transfer, scene, &style, &meshes),
            ..clear_view(scene, eyes, channel, placement)
        };
        let settings = FrameSettings {
            rays,
            lattice,
            geometry,
            placement,
            encoding,
            table,
            mode: layer_mode(scene.mode, &encoding),
            surfaces,
            sampling: scene.sampling,
            lighting: scene.lighting.clone(),
            background: scene.background.map(|c| c as f32),
            clip,
            caps: scene.has_caps(),
            meshes,
            keeps_extremes: volume.keeps_extremes(scene.mode),
        };
        // Pixels have the same size for both eyes, and so do their lattices.
        let frame =
            |&rays: &ViewRays| VolumeFrame { settings: FrameSettings { rays, ..settings.clone() }, blend, opacity };
        let frames = eyes.rays.iter().map(frame).collect();
        let codes = codes.map(Arc::new);
        Ok(ResolvedLayer { place, volume: store, style, view, frames, transfer, codes })
    }
}

/// Returns a layer's mode. All projections of labels show the greatest visible one.
fn layer_mode(mode: Mode, encoding: &SlotEncoding) -> Mode {
    if encoding.is_labels && mode.is_projection() { Mode::Mip } else { mode }
}

fn opaque(unit_distance: f64) -> TransferFunction {
    let (color, opacity) = (vec![[0.0, 1.0, 1.0, 1.0]], vec![[0.0, 1.0]]);
    TransferFunction { color, opacity, unit_distance, ..TransferFunction::default() }
}

/// Returns the bins of values of which a visible brick has at least one, `None` for no restriction; and the bins past a
/// surface.
fn bins_seen(
    volume: &VolumeSource,
    channel: u32,
    mode: Mode,
    transfer: &TransferFunction,
    table: &TransferTable,
    encoding: &SlotEncoding,
    surfaces: &[Surface],
) -> (Option<Occupancy>, Occupancy) {
    // Quantisation moves a value by half a code.
    let slack = (table.reach_codes() + 0.5) * encoding.code_width();
    let bins = volume.source.occupancy_bins(channel);
    // A brick crossed by a surface has all bins from one side of it to the other, so its own among them.
    let passed = surfaces.iter().map(|surface| bins.mask(surface.threshold - slack, surface.threshold + slack));
    let fog = match mode {
        Mode::Dvr => Some(bins.opaque(transfer, slack)),
        Mode::Isosurface => Some(Occupancy::NONE),
        _ => None,
    };
    let inside = surfaces.first().map(|first| bins.mask(first.threshold - slack, f64::INFINITY));
    (fog.map(|fog| passed.fold(fog, Occupancy::union)), inside.unwrap_or(Occupancy::NONE))
}

/// Hashes everything in a picture on which the occlusion of bricks by others depends.
fn appearance(
    table: &TransferTable,
    encoding: &SlotEncoding,
    transfer: &TransferFunction,
    scene: &Scene,
    style: &SceneLayer,
    meshes: &[ShownMesh],
) -> u64 {
    let mut hasher = DefaultHasher::new();
    (scene.mode, scene.has_caps()).hash(&mut hasher);
    scene.sampling.hash(&mut hasher);
    for surface in &style.isosurfaces {
        [surface.value, surface.opacity].map(f64::to_bits).hash(&mut hasher);
    }
    table.unit_distance.to_bits().hash(&mut hasher);
    encoding.table_values().map(f64::to_bits).hash(&mut hasher);
    table.entries.iter().for_each(|entry| entry[3].to_bits().hash(&mut hasher));
    transfer.gradient_opacity.as_flattened().iter().for_each(|number| number.to_bits().hash(&mut hasher));
    for Region { shape, value, gradient, color: _, opacity } in &transfer.regions {
        (*shape as u8).hash(&mut hasher);
        [value[0], value[1], gradient[0], gradient[1], *opacity].map(f64::to_bits).hash(&mut hasher);
    }
    if transfer.is_by_gradient() {
        scene.lighting.gradient.hash(&mut hasher);
    }
    // A mesh never changes once read.
    let seen = meshes.iter().map(|shown| (Arc::as_ptr(&shown.mesh), shown.opacity.to_bits()));
    seen.for_each(|mesh| mesh.hash(&mut hasher));
    hasher.finish()
}
