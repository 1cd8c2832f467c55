//! An ensemble: several paged volumes in one picture, each with its pager, all through one backend and under one budget.
//!
//! Slots and host memory are shared out once, by what each volume could use ([`share`]). Pictures are
//! waited for: there is no live ensemble. A GPU that is lost is started anew and filled again, as one volume's is.

use crate::backend::{BackendChoice, BackendError, BackendNeeds, CompositorChoice};
use crate::losses::Losses;
use crate::offline::Streamed;
use crate::session::{ResolvedScene, SessionError, SessionOptions, default_transfer, resolve};
use brickyard_pager::{
    BrickSource, DrawList, Layer, Pager, PagerConfig, PagerError, Planning, Status, Upload, VolumeNeeds, Wish, share,
};
use brickyard_render::{GpuEnsemble, GpuError, GpuPreference};
use brickyard_software::{EnsembleOptions, SoftwareEnsemble};
use brickyard_volume::lattice::MAX_ZONES;
use brickyard_volume::{
    Blend, Camera, Clip, Combination, Expression, FrameSettings, Jitter, Lattice, LevelPolicy, LightingModel,
    MAX_VOLUMES, Method, Mode, Picture, Scene, StereoLayout, TransferFunction, VolumeFrame, VolumeLook,
};
use glam::DVec3;
use std::sync::Arc;
use std::time::Duration;

/// A volume of an ensemble, and the value range of its default transfer function.
pub struct Member {
    /// The volume.
    pub source: Arc<dyn BrickSource>,
    /// The range.
    pub default_window: (f64, f64),
}

/// A scene of several volumes, resolved for a picture size.
#[derive(Clone, Debug)]
pub struct ResolvedEnsemble {
    /// Each volume that is shown: its place among all, and its scene as if it were alone.
    pub volumes: Vec<(usize, ResolvedScene)>,
    /// The volumes' frames of the one eye or the left one, then of the right one.
    pub eyes: Vec<Vec<VolumeFrame>>,
    /// How two pictures become one.
    pub layout: Option<StereoLayout>,
    /// The camera in use.
    pub camera: Camera,
    /// What is shown of the volumes together, if that is an expression's value.
    pub combination: Option<Combination>,
}

impl ResolvedEnsemble {
    /// Resolves a scene against volumes.
    ///
    /// # Errors
    /// If the camera, a level, time step, channel, crop or opacity is impossible, or the scene asks for what several volumes do not
    /// have.
    pub fn new(members: &[Member], scene: &Scene, size_px: (u32, u32)) -> Result<Self, SessionError> {
        check(members, scene)?;
        let looks: Vec<VolumeLook> =
            (0..members.len()).map(|i| scene.volumes.get(i).cloned().unwrap_or_default()).collect();
        let all = || members.iter().zip(&looks).enumerate();
        let read = expression(members, &looks, scene)?;
        let is_shown = |i: usize| read.as_ref().map_or(looks[i].visible, |read| read.volumes().contains(&i));
        let shown: Vec<_> = all().filter(|(i, _)| is_shown(*i)).collect();
        let combination = read.map(|read| combination(read, members, scene));
        let camera = scene.camera_for(world_box(all().map(|(_, pair)| pair)), size_px);
        let mut volumes = Vec::new();
        for (i, (member, look)) in shown {
            let mut own = own_scene(member, look, scene, camera);
            own.transfer = combination.as_ref().map(Combination::of_each).or(own.transfer);
            let mut resolved =
                resolve(&*member.source, member.default_window, &own, size_px).map_err(|error| of_volume(i, error))?;
            let placement = look.world_from_volume;
            let clip = Clip::in_volume(resolved.frame.clip.as_ref(), &placement, look.crop);
            let clip = clip.map_err(|error| of_volume(i, SessionError::Scene(format!("crop: {error}"))))?;
            (resolved.view.placement, resolved.view.clip) = (placement, clip.clone());
            let right = resolved.stereo.as_mut().map(|(right, _)| right);
            for frame in std::iter::once(&mut resolved.frame).chain(right) {
                (frame.placement, frame.clip) = (placement, clip.clone());
            }
            volumes.push((i, resolved));
        }
        let Some((_, first)) = volumes.first() else {
            return Err(SessionError::Scene("no volume is visible: there is nothing to show".into()));
        };
        let layout = first.stereo.as_ref().map(|(_, layout)| *layout);
        let lattice = lattice(members, &volumes, scene);
        let blend = |i: usize| looks[i].blend;
        let eye = |frame: &dyn Fn(&ResolvedScene) -> FrameSettings| {
            let frame = |(i, resolved): &(usize, ResolvedScene)| VolumeFrame {
                settings: FrameSettings { lattice, ..frame(resolved) },
                blend: blend(*i),
            };
            volumes.iter().map(frame).collect::<Vec<_>>()
        };
        let mut eyes = vec![eye(&|resolved| resolved.frame.clone())];
        if layout.is_some() {
            eyes.push(eye(&|resolved| resolved.stereo.as_ref().map_or(&resolved.frame, |(right, _)| right).clone()));
        }
        Ok(Self { volumes, eyes, layout, camera, combination })
    }

    /// The picture, whoever draws one eye's: given which eye, from 0, and the frames.
    ///
    /// # Errors
    /// Those of `draw`.
    pub fn picture<E>(&self, mut draw: impl FnMut(usize, &[VolumeFrame]) -> Result<Picture, E>) -> Result<Picture, E> {
        let first = draw(0, &self.eyes[0])?;
        let (Some(layout), Some(right)) = (self.layout, self.eyes.get(1)) else { return Ok(first) };
        let second = draw(1, right)?;
        Ok(layout.compose([&first, &second]))
    }

    /// The transfer functions in use, of the volumes that are shown.
    pub fn transfers(&self) -> impl Iterator<Item = &TransferFunction> {
        self.volumes.iter().map(|(_, resolved)| &resolved.transfer)
    }
}

fn of_volume(i: usize, error: SessionError) -> SessionError {
    match error {
        SessionError::Scene(problem) => SessionError::Scene(format!("volume {i}: {problem}")),
        other => other,
    }
}

/// The scene's expression, if it has one.
fn expression(members: &[Member], looks: &[VolumeLook], scene: &Scene) -> Result<Option<Expression>, SessionError> {
    let Some(text) = &scene.expression else { return Ok(None) };
    let of_expression = |problem: String| SessionError::Scene(format!("expression: {problem}"));
    let expression = Expression::parse(text, members.len()).map_err(|error| of_expression(error.to_string()))?;
    let read = expression.volumes();
    let has_own_look = |look: &VolumeLook| {
        let is_own = look.transfer.is_some() || look.opacity != 1.0 || look.blend != Blend::Mix;
        is_own || !look.isosurfaces.is_empty()
    };
    let problem = if read.is_empty() {
        format!("'{text}' reads no volume: there is nothing to show")
    } else if let Some(i) = read.iter().find(|i| !looks[**i].visible) {
        format!("it reads volume {i}, which is not visible: leave one of both out")
    } else if let Some(i) = looks.iter().position(has_own_look) {
        let problem = "has a look of its own, and the expression's value has the scene's";
        format!("volume {i} {problem}: leave its transfer, opacity, blend and isosurfaces out")
    } else {
        return Ok(Some(expression));
    };
    Err(of_expression(problem))
}

/// An expression and how its values look: as the scene says, or on a gray ramp over all that they can be.
fn combination(expression: Expression, members: &[Member], scene: &Scene) -> Combination {
    let source = &members[expression.volumes()[0]].source;
    let (geometry, extent) = (source.geometry(), source.pyramid().levels()[0].extent);
    let window = expression_window(&expression, members.iter().map(|member| member.default_window));
    let transfer = scene.transfer.clone().unwrap_or_else(|| default_transfer(window, geometry, extent));
    Combination::new(expression.of_its_own(), transfer)
}

/// The values that an expression can have of volumes with values in these windows; zero to one where that has no end.
pub fn expression_window(expression: &Expression, windows: impl Iterator<Item = (f64, f64)>) -> (f64, f64) {
    let windows: Vec<_> = windows.map(|(low, high)| Some([low, high])).collect();
    match expression.range(&windows) {
        Some([low, high]) if low < high && (high - low).is_finite() => (low, high),
        // Shown as a volume of one value is.
        Some([value, _]) if value.is_finite() => (value, value),
        _ => (0.0, 1.0),
    }
}

/// Whether any volume has surfaces.
fn has_surfaces(scene: &Scene) -> bool {
    scene.volumes.iter().any(|look| !look.isosurfaces.is_empty())
}

/// What a volume would be shown by, alone.
fn own_scene(member: &Member, look: &VolumeLook, scene: &Scene, camera: Camera) -> Scene {
    let (pyramid, geometry) = (member.source.pyramid(), member.source.geometry());
    let window = member.default_window;
    let transfer = look.transfer.clone().or_else(|| scene.transfer.clone());
    let transfer = transfer.unwrap_or_else(|| default_transfer(window, geometry, pyramid.levels()[0].extent));
    let level = match scene.level {
        // The coarsest of a volume that does not have it.
        LevelPolicy::Locked(level) => LevelPolicy::Locked(level.min(pyramid.coarsest().0)),
        LevelPolicy::Auto => LevelPolicy::Auto,
    };
    let mut lighting = scene.lighting.clone();
    if lighting.model == LightingModel::None && look.isosurfaces.is_empty() && has_surfaces(scene) {
        // They are for the surfaces of others.
        lighting.lights.clear();
    }
    Scene {
        camera: Some(camera),
        transfer: Some(transfer.scaled(look.opacity)),
        isosurfaces: look.isosurfaces.clone(),
        lighting,
        channel: look.channel.unwrap_or(scene.channel),
        level,
        volumes: Vec::new(),
        expression: None,
        ..scene.clone()
    }
}

/// The box around all volumes where they stand.
pub fn world_box<'a>(members: impl Iterator<Item = (&'a Member, &'a VolumeLook)>) -> (DVec3, DVec3) {
    let of = |(member, look): (&Member, &VolumeLook)| {
        let extent = member.source.pyramid().levels()[0].extent;
        look.world_from_volume.world_box(member.source.geometry().world_box(extent))
    };
    let nowhere = (DVec3::INFINITY, DVec3::NEG_INFINITY);
    members.map(of).fold(nowhere, |(low, high), (a, b)| (low.min(a), high.max(b)))
}

/// One lattice for all: steps of the finest volume's voxel, in zones as far out as any volume has levels.
fn lattice(members: &[Member], volumes: &[(usize, ResolvedScene)], scene: &Scene) -> Lattice {
    let voxel_size = |(i, resolved): &(usize, ResolvedScene)| {
        let source = &members[*i].source;
        resolved.view.placement.voxel_size(source.geometry(), source.pyramid().levels()[0].extent)
    };
    let finest = volumes.iter().map(voxel_size).fold(f64::INFINITY, f64::min);
    let step = scene.step * finest;
    let zones = |volume: &(usize, ResolvedScene)| {
        let coarser = (voxel_size(volume) / finest).log2().floor() as usize;
        members[volume.0].source.pyramid().levels().len() + coarser
    };
    let zones = volumes.iter().map(zones).max().unwrap_or(1).min(MAX_ZONES);
    match scene.level {
        LevelPolicy::Auto => Lattice::for_view(step, finest, &volumes[0].1.frame.rays, scene.pixel_error, zones),
        LevelPolicy::Locked(level) => Lattice::uniform(step, (level as usize).min(zones - 1)),
    }
}

/// What is wrong with the transfer functions, if one of them depends on gradients.
fn by_gradient(scene: &Scene) -> Option<String> {
    let depends = |transfer: &Option<TransferFunction>| transfer.as_ref().is_some_and(TransferFunction::is_by_gradient);
    let problem = "several volumes are classified by value alone: leave its gradient_opacity and regions out";
    match scene.volumes.iter().position(|look| depends(&look.transfer)) {
        Some(i) => Some(format!("volume {i} has a transfer function of value and gradient, and {problem}")),
        None if depends(&scene.transfer) => {
            Some(format!("the transfer function is one of value and gradient, and {problem}"))
        }
        None => None,
    }
}

/// Whether several volumes can be shown so.
fn check(members: &[Member], scene: &Scene) -> Result<(), SessionError> {
    let most_levels = members.iter().map(|member| member.source.pyramid().levels().len()).max().unwrap_or(0);
    let bad_opacity = scene.volumes.iter().position(|look| !(0.0..=1.0).contains(&look.opacity));
    let problem = if members.is_empty() || members.len() > MAX_VOLUMES {
        format!("{} volumes in one picture: expected 1 to {MAX_VOLUMES}", members.len())
    } else if scene.volumes.len() > members.len() {
        format!("the scene says how {} volumes look, and there are {} stores", scene.volumes.len(), members.len())
    } else if let Some(i) = bad_opacity {
        format!("volume {i}: the opacity is {}: expected 0 to 1", scene.volumes[i].opacity)
    } else if scene.mode != Mode::Dvr {
        format!("several volumes are shown with --mode dvr, not {:?}: leave it out", scene.mode)
    } else if scene.sampling.method != Method::Udvr {
        format!("several volumes are sampled with --method udvr, not {:?}: leave it out", scene.sampling.method)
    } else if scene.lighting.model != LightingModel::None && scene.expression.is_some() {
        let problem = "the gradient of an expression's value is no volume's: it is not lit, and the scene asks for";
        format!("{problem} {:?}: leave one of both out", scene.lighting.model)
    } else if scene.sampling.jitter != Jitter::None {
        "several volumes are not jittered: leave --jitter out".into()
    } else if let Some(problem) = by_gradient(scene) {
        problem
    } else if !scene.meshes.is_empty() {
        "meshes stand in one volume: leave --mesh out, or give one store".into()
    } else if !scene.isosurfaces.is_empty() {
        "an isosurface is of one of several volumes: say which, as in --volume 0:isovalue=300".into()
    } else if let LevelPolicy::Locked(level) = scene.level
        && level as usize >= most_levels
    {
        format!("level {level} does not exist: the stores have up to {most_levels}, numbered from 0")
    } else {
        return Ok(());
    };
    Err(SessionError::Scene(problem))
}

/// A renderer of several volumes.
enum EnsembleBackend {
    Gpu(Box<GpuEnsemble>),
    Cpu(SoftwareEnsemble),
}

impl EnsembleBackend {
    fn new(needs: &[VolumeNeeds], options: &SessionOptions) -> Result<(Self, String), BackendError> {
        let (memory_bytes, size, threads) = (options.gpu_memory_bytes, options.max_size_px, options.threads);
        let cpu = |why: &str| -> Result<_, BackendError> {
            let options = EnsembleOptions { memory_bytes, max_picture_px: size.into(), threads };
            let line = format!("cpu, {threads} threads{why}");
            Ok((Self::Cpu(SoftwareEnsemble::new(needs, &options)?), line))
        };
        let gpu = |preference| -> Result<_, BackendError> {
            let renderer = GpuEnsemble::new(preference, needs, memory_bytes, size)?;
            let line = format!("gpu, {}", renderer.adapter());
            Ok((Self::Gpu(Box::new(renderer)), line))
        };
        match options.backend {
            BackendChoice::Cpu => cpu(""),
            BackendChoice::Gpu => gpu(GpuPreference::Any),
            BackendChoice::Auto => match gpu(GpuPreference::Hardware) {
                Err(BackendError::Gpu(GpuError::NoAdapter { .. })) => cpu(" (no hardware GPU)"),
                other => other,
            },
        }
    }

    /// Starts a lost GPU anew, with empty slots.
    fn renew(&mut self) -> Result<(), BackendError> {
        match self {
            Self::Gpu(renderer) => renderer.renew()?,
            Self::Cpu(_) => {}
        }
        Ok(())
    }

    fn slots(&self, volume: usize) -> u32 {
        match self {
            Self::Gpu(renderer) => renderer.slots(volume),
            Self::Cpu(renderer) => renderer.slots(volume),
        }
    }

    fn upload(&mut self, volume: usize, upload: &Upload) -> Result<(), BackendError> {
        match self {
            Self::Gpu(renderer) => renderer.upload(volume, upload.slot, &upload.codes)?,
            Self::Cpu(renderer) => renderer.upload(volume, upload.slot, upload.codes.clone()),
        }
        Ok(())
    }

    fn render(&mut self, layers: &[Layer<'_>], combination: Option<&Combination>) -> Result<Picture, BackendError> {
        Ok(match self {
            Self::Gpu(renderer) => renderer.render(layers, combination)?,
            Self::Cpu(renderer) => renderer.render(layers, combination),
        })
    }
}

/// A volume that is shown.
struct Shown {
    source: Arc<dyn BrickSource>,
    pager: Pager,
    /// For one eye or two.
    draws: Vec<DrawList>,
    is_settled: bool,
}

/// Several volumes, their pagers and a backend, for the volumes that one scene shows.
pub struct Ensemble {
    volumes: Vec<Shown>,
    backend: EnsembleBackend,
    backend_line: String,
    losses: Losses,
}

impl Ensemble {
    /// Joins those of the sources that a scene shows, their pagers and a backend.
    ///
    /// # Errors
    /// If no backend can be made, it has no compositor for several volumes, or a budget is too small; the message says the least that
    /// works.
    pub fn new(members: &[Member], scene: &ResolvedEnsemble, options: &SessionOptions) -> Result<Self, SessionError> {
        let problem = match options.compositor {
            CompositorChoice::Auto | CompositorChoice::Raycast => None,
            CompositorChoice::Sorted => Some("the sorted compositor draws one volume: several are not in one order"),
            CompositorChoice::Compute => Some("the compute compositor draws one volume"),
        };
        if let Some(problem) = problem {
            return Err(SessionError::Scene(format!("{problem}; use --compositor raycast")));
        }
        let sources: Vec<Arc<dyn BrickSource>> =
            scene.volumes.iter().map(|(i, _)| members[*i].source.clone()).collect();
        let needs: Vec<VolumeNeeds> = sources.iter().map(|source| volume_needs(&**source, options)).collect();
        let (backend, backend_line) = EnsembleBackend::new(&needs, options)?;
        let config = |(i, needs): (usize, &VolumeNeeds)| PagerConfig {
            slots: backend.slots(i),
            apron: needs.bricks.apron,
            gradient_layers: needs.bricks.gradient_layers,
            host_bytes: 0,
            // Twice as many as there are threads, in all: some wait while others read.
            workers: (2 * options.threads).div_ceil(sources.len().max(1)).min(options.threads).max(1) as u32,
            planning: Planning::Inline,
            prefetch: false,
            uploads: None,
            fade: None,
        };
        let configs: Vec<PagerConfig> = needs.iter().enumerate().map(config).collect();
        let wishes = sources.iter().zip(&configs).map(|(source, config)| Pager::host_wish(&**source, config));
        let wishes = wishes.collect::<Result<Vec<Wish>, _>>()?;
        let given = options.host_memory_bytes;
        let shares = share(given, &wishes).map_err(|least| PagerError::HostMemory { given, least })?;
        let mut volumes = Vec::new();
        for ((source, config), host_bytes) in sources.into_iter().zip(configs).zip(shares) {
            let pager = Pager::new(source.clone(), PagerConfig { host_bytes, ..config })?;
            volumes.push(Shown { source, pager, draws: Vec::new(), is_settled: false });
        }
        Ok(Self { volumes, backend, backend_line, losses: Losses::default() })
    }

    /// The backend, in words.
    pub fn backend_line(&self) -> &str {
        &self.backend_line
    }

    /// `gpu` or `cpu`.
    pub fn backend_name(&self) -> &'static str {
        match self.backend {
            EnsembleBackend::Gpu(_) => "gpu",
            EnsembleBackend::Cpu(_) => "cpu",
        }
    }

    /// Bricks of all volumes that fit at once.
    pub fn slots(&self) -> u64 {
        (0..self.volumes.len()).map(|i| self.backend.slots(i) as u64).sum()
    }

    /// Loses the device as a driver does: for tests.
    #[doc(hidden)]
    pub fn destroy_device(&self) {
        if let EnsembleBackend::Gpu(renderer) = &self.backend {
            renderer.destroy_device();
        }
    }

    /// Uploads what a step wants, and takes its draw lists.
    fn try_step(&mut self, scene: &ResolvedEnsemble) -> Result<Option<Status>, BackendError> {
        let mut whole: Option<Status> = None;
        for (i, (shown, (_, resolved))) in self.volumes.iter_mut().zip(&scene.volumes).enumerate() {
            let frame = shown.pager.frame(&resolved.view, Duration::ZERO);
            frame.uploads.iter().try_for_each(|upload| self.backend.upload(i, upload))?;
            shown.draws = std::iter::once(frame.draw).chain(frame.draw_other_eye).collect();
            shown.is_settled = frame.status.settled;
            whole = Some(match whole {
                None => frame.status,
                Some(before) => before.and(&frame.status),
            });
        }
        Ok(whole)
    }

    fn try_draw(&mut self, scene: &ResolvedEnsemble) -> Result<Picture, BackendError> {
        let nothing = DrawList::default();
        let Self { volumes, backend, .. } = self;
        scene.picture(|eye, frames| {
            let layer = |(shown, frame): (_, _)| {
                let shown: &Shown = shown;
                Layer { frame, pyramid: shown.source.pyramid(), draw: shown.draws.get(eye).unwrap_or(&nothing) }
            };
            backend.render(&volumes.iter().zip(frames).map(layer).collect::<Vec<_>>(), scene.combination.as_ref())
        })
    }

    /// Makes a lost device anew; its slots are empty. Other errors are the caller's.
    fn recover(&mut self, error: BackendError) -> Result<(), SessionError> {
        self.losses.record(error)?;
        self.backend.renew()?;
        for (i, shown) in self.volumes.iter_mut().enumerate() {
            shown.pager.forget_slots(self.backend.slots(i))?;
            shown.draws.clear();
        }
        Ok(())
    }

    /// Streams a scene again, until it is settled if it was, else until something is drawn everywhere.
    fn refill(&mut self, scene: &ResolvedEnsemble, was_settled: bool) -> Result<(), SessionError> {
        loop {
            let status = self.step(scene)?;
            if status.settled || status.covered && !was_settled {
                return Ok(());
            }
            self.wait(Duration::from_millis(50));
        }
    }
}

fn volume_needs(source: &dyn BrickSource, options: &SessionOptions) -> VolumeNeeds {
    let BackendNeeds { encoding, edge, bricks, levels, max_slots, .. } = BackendNeeds::new(source, options);
    let pyramid = source.pyramid();
    // All of the coarsest level, and one to refine with.
    let roots = pyramid.level(pyramid.coarsest()).bricks.volume();
    let least_slots = u32::try_from(roots + 1).unwrap_or(u32::MAX).min(max_slots);
    VolumeNeeds { encoding, edge, levels, bricks, least_slots, most_slots: max_slots }
}

impl Streamed for Ensemble {
    type Scene = ResolvedEnsemble;

    fn step(&mut self, scene: &ResolvedEnsemble) -> Result<Status, SessionError> {
        let status = loop {
            match self.try_step(scene) {
                Ok(status) => break status,
                Err(error) => self.recover(error)?,
            }
        };
        let status = status.ok_or_else(|| SessionError::Scene("no volume is visible".into()))?;
        match status.error {
            Some(error) => Err(SessionError::Unreadable(error)),
            None => Ok(status),
        }
    }

    fn wait(&mut self, timeout: Duration) {
        // One after the other: what comes for another one meanwhile is taken in soon.
        let patience = (timeout / 16).max(Duration::from_millis(1));
        for shown in self.volumes.iter_mut().filter(|shown| !shown.is_settled) {
            if shown.pager.wait(patience) {
                return;
            }
        }
    }

    fn draw(&mut self, scene: &ResolvedEnsemble) -> Result<Picture, SessionError> {
        loop {
            match self.try_draw(scene) {
                Ok(picture) => {
                    self.losses.picture();
                    return Ok(picture);
                }
                Err(error) => {
                    let was_settled = self.volumes.iter().all(|shown| shown.is_settled);
                    self.recover(error)?;
                    self.refill(scene, was_settled)?;
                }
            }
        }
    }

    fn backend_bytes(&self) -> u64 {
        match &self.backend {
            EnsembleBackend::Gpu(renderer) => renderer.gpu_bytes(),
            EnsembleBackend::Cpu(renderer) => renderer.bytes(),
        }
    }

    fn device_losses(&self) -> u32 {
        self.losses.total()
    }
}
