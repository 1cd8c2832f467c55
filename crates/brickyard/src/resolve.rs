//! Scenes resolved for volumes and a picture size: each layer that is shown gets the view that its bricks are streamed for, and the
//! frames that are drawn. Costs a transfer table for each function of which none is kept.

use crate::expression::{combination, expression};
use crate::scene_check::{check_layer, check_volumes};
use crate::session_error::SessionError;
use crate::volume_source::VolumeSource;
use brickyard_pager::View;
use brickyard_volume::lattice::MAX_ZONES;
use brickyard_volume::{
    Camera, Clip, Combination, Expression, FrameSettings, Lattice, LevelPolicy, LightingModel, Mode, Occupancy,
    Picture, Region, Scene, ShownMesh, SlotEncoding, StereoLayout, Surface, TransferFunction, TransferTable, ViewRays,
    VolumeFrame, VolumeLook,
};
use glam::DVec3;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::sync::Arc;

/// A scene resolved for volumes and a picture size: what pagers and renderers need.
#[derive(Clone, Debug)]
pub struct ResolvedScene {
    /// The layers that are shown, at least one.
    pub layers: Vec<ResolvedLayer>,
    /// How the pictures of two eyes become one; `None` is one eye.
    pub stereo: Option<StereoLayout>,
    /// The camera in use.
    pub camera: Camera,
    /// The expression over the layers whose values are shown, and how they look; `None` shows the layers themselves.
    pub combination: Option<Combination>,
}

/// A layer of a resolved scene.
#[derive(Clone, Debug)]
pub struct ResolvedLayer {
    /// Its volume's place among all that the scene was resolved for.
    pub volume: usize,
    /// What its pager streams for. In stereo that is what both eyes see, the left one first.
    pub view: View,
    /// The layer's frames, which renderers draw: one for each eye, the left one's first.
    pub frames: Vec<VolumeFrame>,
    /// The transfer function in use.
    pub transfer: TransferFunction,
}

impl ResolvedScene {
    /// The scene that it is of, with what was left to be found.
    pub fn shown(&self, scene: &Scene) -> Scene {
        let transfer = match &self.layers[..] {
            [layer] if scene.volumes.is_empty() && scene.expression.is_none() => Some(layer.transfer.clone()),
            _ => scene.transfer.clone(),
        };
        Scene { camera: Some(self.camera), transfer, ..scene.clone() }
    }

    /// The picture of the scene, whoever draws an eye's, given its number.
    ///
    /// # Errors
    /// If `draw` fails, its error.
    pub fn picture<E>(&self, mut draw: impl FnMut(usize) -> Result<Picture, E>) -> Result<Picture, E> {
        let first = draw(0)?;
        let Some(layout) = self.stereo else { return Ok(first) };
        let second = draw(1)?;
        Ok(layout.compose([&first, &second]))
    }

    /// The scene as one of its eyes sees it, by itself.
    pub(crate) fn of_eye(&self, eye: usize) -> Self {
        let mut scene = Self { stereo: None, ..self.clone() };
        for layer in &mut scene.layers {
            let view = if eye == 0 { layer.view.clone() } else { layer.view.from_other_eye() };
            layer.view = View { other_eye: None, ..view };
            layer.frames = vec![layer.frames.swap_remove(eye)];
        }
        scene
    }

    /// Whether it is a single layer in its own world, of which the picture shows what the layer shows by itself.
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

/// Resolves a scene against volumes: default camera and transfer functions, tables, lattice, opaque bins.
///
/// # Errors
/// If the camera, a level, time step, channel, isovalue, crop or opacity is impossible, or the scene asks for what several volumes do
/// not have.
pub fn resolve(volumes: &[VolumeSource], scene: &Scene, size_px: (u32, u32)) -> Result<ResolvedScene, SessionError> {
    let table = |_, transfer: &TransferFunction, encoding: &_| TransferTable::new(transfer, encoding).into();
    resolve_with(volumes, scene, size_px, table)
}

/// Resolves a scene with the tables of whoever has some, given a volume's place, a function and how codes stand for values.
pub(crate) fn resolve_with(
    volumes: &[VolumeSource],
    scene: &Scene,
    size_px: (u32, u32),
    table: impl Fn(usize, &TransferFunction, &SlotEncoding) -> Arc<TransferTable>,
) -> Result<ResolvedScene, SessionError> {
    check_volumes(volumes, scene)?;
    let mut looks = scene.volumes.clone();
    looks.resize(volumes.len(), VolumeLook::default());
    let visible: Vec<usize> = (0..volumes.len()).filter(|&i| looks[i].visible).collect();
    let read = expression(volumes, &looks, scene)?;
    let shown = read.as_ref().map_or(visible, Expression::volumes);
    if shown.is_empty() {
        return Err(SessionError::Scene("no volume is visible: there is nothing to show".into()));
    }
    let combination = read.map(|read| combination(read, volumes, scene));
    let is_named = volumes.len() > 1 || !scene.volumes.is_empty();
    let named = |i: usize, error| if is_named { of_volume(i, error) } else { error };
    let has_surfaces = shown.iter().any(|&i| !looks[i].isosurfaces.is_empty());
    let windows: Vec<[f64; 2]> = shown.iter().map(|&i| volumes[i].source.value_range().into()).collect();
    let own = |(place, &i): (usize, &usize)| {
        let mut own = own_scene(&volumes[i], &looks[i], scene, volumes.len());
        own.transfer = combination.as_ref().map(|read| read.of_volume(place, &windows)).or(own.transfer);
        check_layer(&*volumes[i].source, &own, has_surfaces).map_err(|error| named(i, error)).map(|()| own)
    };
    let scenes = shown.iter().enumerate().map(own).collect::<Result<Vec<Scene>, _>>()?;
    let camera = scene.camera_for(world_box(volumes, &looks), size_px);
    let eyes = Eyes::new(scene, &camera, size_px)?;
    let lattice = lattice(volumes, &looks, &shown, scene, &eyes.rays[0]);
    let layer = |(&i, own): (&usize, &Scene)| {
        let table = |transfer: &_, encoding: &_| table(i, transfer, encoding);
        layer(i, &volumes[i], &looks[i], own, &eyes, lattice, table).map_err(|error| named(i, error))
    };
    let mut layers = shown.iter().zip(&scenes).map(layer).collect::<Result<Vec<ResolvedLayer>, _>>()?;
    if layers.len() > 1 || combination.is_some() {
        let appearance = joint_appearance(&layers, combination.as_ref());
        layers.iter_mut().for_each(|layer| layer.view.appearance = appearance);
    }
    Ok(ResolvedScene { layers, stereo: eyes.layout, camera, combination })
}

/// A number of all in a picture of several layers that decides which bricks of one hide those of another.
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

fn of_volume(i: usize, error: SessionError) -> SessionError {
    match error {
        SessionError::Scene(problem) => SessionError::Scene(format!("volume {i}: {problem}")),
        other => other,
    }
}

/// The scene that a volume would have alone.
fn own_scene(volume: &VolumeSource, look: &VolumeLook, scene: &Scene, volumes: usize) -> Scene {
    let transfer = look.transfer.as_ref().or(scene.transfer.as_ref());
    let transfer = transfer.cloned().unwrap_or_else(|| volume.default_transfer());
    let level = match scene.level {
        // The coarsest of a volume that does not have it.
        LevelPolicy::Locked(level) if volumes > 1 => {
            LevelPolicy::Locked(level.min(volume.source.pyramid().coarsest().0))
        }
        level => level,
    };
    let isosurfaces = if look.isosurfaces.is_empty() { &scene.isosurfaces } else { &look.isosurfaces };
    let mut lighting = scene.lighting.clone();
    let has_surfaces = scene.volumes.iter().any(|look| !look.isosurfaces.is_empty());
    if lighting.model == LightingModel::None && isosurfaces.is_empty() && has_surfaces {
        // The lights are for the surfaces of others.
        lighting.lights.clear();
    }
    Scene {
        transfer: Some(transfer.scaled(look.opacity)),
        isosurfaces: isosurfaces.clone(),
        lighting,
        channel: look.channel.unwrap_or(scene.channel),
        level,
        volumes: Vec::new(),
        expression: None,
        ..scene.clone()
    }
}

/// The box around all volumes where they stand.
fn world_box(volumes: &[VolumeSource], looks: &[VolumeLook]) -> (DVec3, DVec3) {
    let nowhere = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    let boxes = volumes.iter().zip(looks).map(|(volume, look)| look.world_from_volume.world_box(volume.world_box()));
    boxes.fold(nowhere, |(low, high), (a, b)| (low.min(a), high.max(b)))
}

/// One lattice for all that are shown: steps of the finest volume's voxel, in zones as far out as any volume has levels.
fn lattice(volumes: &[VolumeSource], looks: &[VolumeLook], shown: &[usize], scene: &Scene, rays: &ViewRays) -> Lattice {
    let voxel_size = |i: usize| {
        let VolumeSource { source, .. } = &volumes[i];
        looks[i].world_from_volume.voxel_size(source.geometry(), volumes[i].extent())
    };
    let finest = shown.iter().map(|&i| voxel_size(i)).fold(f64::INFINITY, f64::min);
    let step = scene.step * finest;
    let zones = |&i: &usize| {
        let coarser = (voxel_size(i) / finest).log2().floor() as usize;
        volumes[i].source.pyramid().levels().len() + coarser
    };
    let zones = shown.iter().map(zones).max().unwrap_or(1).min(MAX_ZONES);
    match scene.level {
        LevelPolicy::Auto => Lattice::for_view(step, finest, rays, scene.pixel_error, zones),
        LevelPolicy::Locked(level) => Lattice::uniform(step, (level as usize).min(zones - 1)),
    }
}

/// The volume at a place among all, shown by the scene that it would have alone, but for its place, its crop and the lattice of all.
fn layer(
    place: usize,
    volume: &VolumeSource,
    look: &VolumeLook,
    scene: &Scene,
    eyes: &Eyes,
    lattice: Lattice,
    table: impl FnOnce(&TransferFunction, &SlotEncoding) -> Arc<TransferTable>,
) -> Result<ResolvedLayer, SessionError> {
    let (geometry, rays) = (volume.source.geometry().clone(), eyes.rays[0]);
    let clip = scene.clip_for(&rays, &geometry, volume.extent());
    let clip = clip.map_err(|error| SessionError::Scene(error.to_string()))?;
    let placement = look.world_from_volume;
    let clip = Clip::in_volume(clip.as_ref(), &placement, look.crop);
    let clip = clip.map_err(|error| SessionError::Scene(format!("crop: {error}")))?;
    let encoding = volume.encoding();
    let transfer = scene.transfer.clone().unwrap_or_else(|| volume.default_transfer());
    let table = table(&transfer, &encoding);
    let surfaces = Surface::all(&scene.isosurfaces, &transfer, &encoding);
    let opaque = opaque_bins(volume, scene, &transfer, &table, &surfaces);
    let meshes = scene.shown_meshes().map_err(|error| SessionError::Scene(error.to_string()))?;
    let view = View {
        rays,
        other_eye: eyes.rays.get(1).copied(),
        opaque,
        filter: scene.sampling.filter,
        level: scene.level,
        pixel_error: scene.pixel_error,
        time: scene.time,
        channel: scene.channel,
        clip: clip.clone(),
        placement,
        appearance: appearance(&table, &transfer, scene, &meshes),
        window: None,
    };
    let settings = FrameSettings {
        rays,
        lattice,
        geometry,
        placement,
        encoding,
        table,
        mode: scene.mode,
        surfaces,
        sampling: scene.sampling,
        lighting: scene.lighting.clone(),
        background: scene.background.map(|c| c as f32),
        clip,
        meshes,
    };
    // Pixels are as large for one eye as for the other, so both have the same lattice.
    let VolumeLook { blend, opacity, .. } = *look;
    let frame = |&rays: &ViewRays| VolumeFrame { settings: FrameSettings { rays, ..settings.clone() }, blend, opacity };
    Ok(ResolvedLayer { volume: place, view, frames: eyes.rays.iter().map(frame).collect(), transfer })
}

/// The bins of values of which a brick must have one to show anything; `None` where all may.
fn opaque_bins(
    volume: &VolumeSource,
    scene: &Scene,
    transfer: &TransferFunction,
    table: &TransferTable,
    surfaces: &[Surface],
) -> Option<Occupancy> {
    // Quantisation moves a value by half a code.
    let slack = (table.reach_codes() + 0.5) * volume.encoding().code_width();
    let bins = volume.source.occupancy_bins(scene.channel);
    // A brick that a surface passes has all bins from one side of it to the other, so its own among them.
    let passed = surfaces.iter().map(|surface| bins.mask(surface.threshold - slack, surface.threshold + slack));
    let fog = match scene.mode {
        Mode::Dvr => Some(bins.opaque(transfer, slack)),
        Mode::Isosurface => Some(Occupancy::NONE),
        Mode::Mip | Mode::MinIp | Mode::Average => None,
    };
    fog.map(|fog| passed.fold(fog, Occupancy::union))
}

/// A number of all in a picture that decides which bricks hide others.
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
