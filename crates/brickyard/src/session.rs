//! A session: one paged volume shown through one backend. A scene becomes a view for the pager and settings for the
//! renderer; every step moves bricks towards what the view wants; a picture can be drawn at any moment.

use crate::backend::{Backend, BackendChoice, BackendError, BackendNeeds, CompositorChoice};
use brickyard_pager::{BrickError, BrickSource, DrawList, Pager, PagerConfig, PagerError, Status, View};
use brickyard_volume::camera::CameraError;
use brickyard_volume::{
    Camera, Extent, FrameSettings, Lattice, LevelPolicy, Mode, Picture, Scene, SlotEncoding, TransferFunction,
    TransferTable,
};
use std::sync::Arc;
use std::time::Duration;

/// Voxels copied around a brick: enough for trilinear samples.
const APRON: u32 = 1;

/// What a session may use.
#[derive(Clone, Copy, Debug)]
pub struct SessionOptions {
    /// Which backend.
    pub backend: BackendChoice,
    /// Which compositor.
    pub compositor: CompositorChoice,
    /// Hard limit of the backend's memory, bytes.
    pub gpu_memory_bytes: u64,
    /// Hard limit of decoded bricks, staging and scratch, bytes.
    pub host_memory_bytes: u64,
    /// Decode workers, and threads of the CPU backend.
    pub threads: usize,
    /// The largest picture to be rendered, pixels.
    pub max_size_px: (u32, u32),
}

/// Why a session cannot open or go on.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// No backend, too little memory for it, or a lost device.
    #[error(transparent)]
    Backend(#[from] BackendError),
    /// A budget too small for one brick.
    #[error(transparent)]
    Pager(#[from] PagerError),
    /// Part of the view can be drawn from no level at all.
    #[error("nothing can stand in for a part of the picture: {0}")]
    Unreadable(BrickError),
    /// The camera makes no picture.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The scene asks for what the store does not have.
    #[error("{0}")]
    Scene(String),
}

/// A scene resolved for a picture size: what the pager and the renderer need.
#[derive(Clone, Debug)]
pub struct ResolvedScene {
    /// For the pager.
    pub view: View,
    /// For the renderer.
    pub frame: FrameSettings,
    /// The transfer function in use.
    pub transfer: TransferFunction,
    /// The camera in use.
    pub camera: Camera,
}

/// One volume, its pager and a backend.
pub struct Session {
    source: Arc<dyn BrickSource>,
    default_window: (f64, f64),
    pager: Pager,
    backend: Backend,
    backend_line: String,
    draw: DrawList,
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
        let encoding = encoding_of(&*source);
        let needs = BackendNeeds {
            encoding,
            edge: source.pyramid().edge(),
            apron: APRON,
            compositor: options.compositor,
            levels: source.pyramid().levels().len() as u32,
            gpu_memory_bytes: options.gpu_memory_bytes,
            max_size_px: options.max_size_px,
            max_slots: max_slots(&*source),
            threads: options.threads,
        };
        let (backend, backend_line) = Backend::new(options.backend, &needs)?;
        let config = PagerConfig {
            slots: backend.slots(),
            apron: APRON,
            host_bytes: options.host_memory_bytes,
            workers: options.threads as u32,
            upload_bytes_per_frame: None,
        };
        let pager = Pager::new(source.clone(), config)?;
        Ok(Self { source, default_window, pager, backend, backend_line, draw: DrawList::default() })
    }

    /// Resolves a scene against this volume.
    ///
    /// # Errors
    /// If the camera, level, time step or channel is impossible.
    pub fn resolve(&self, scene: &Scene, (width, height): (u32, u32)) -> Result<ResolvedScene, SessionError> {
        resolve(&*self.source, self.default_window, scene, (width, height))
    }

    /// One step of streaming: asks the pager, performs its uploads, keeps its draw list.
    ///
    /// # Errors
    /// If the device is lost or nothing can be drawn at all.
    pub fn step(&mut self, view: &View) -> Result<Status, SessionError> {
        let frame = self.pager.frame(view);
        for upload in &frame.uploads {
            self.backend.upload(upload)?;
        }
        self.draw = frame.draw;
        match frame.status.error {
            Some(error) => Err(SessionError::Unreadable(error)),
            None => Ok(frame.status),
        }
    }

    /// Waits until a brick has arrived, at most this long.
    pub fn wait(&mut self, timeout: Duration) {
        self.pager.wait(timeout);
    }

    /// Renders what is resident now.
    ///
    /// # Errors
    /// If the device is lost or out of memory.
    pub fn draw(&mut self, frame: &FrameSettings) -> Result<Picture, SessionError> {
        Ok(self.backend.render(frame, self.source.pyramid(), &self.draw)?)
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
/// If the camera, level, time step or channel is impossible.
pub fn resolve(
    source: &dyn BrickSource,
    default_window: (f64, f64),
    scene: &Scene,
    (width, height): (u32, u32),
) -> Result<ResolvedScene, SessionError> {
    let pyramid = source.pyramid();
    let levels = pyramid.levels();
    let extent = levels[0].extent;
    check_scene(source, scene, levels.len())?;
    let geometry = source.geometry().clone();
    let camera = scene.camera.unwrap_or_else(|| Camera::looking_at_box(geometry.world_box(extent)));
    let rays = camera.rays(width, height)?;
    let voxel_size = geometry.voxel_size(extent);
    let step = scene.step * voxel_size;
    let lattice = match scene.level {
        LevelPolicy::Auto => Lattice::for_view(step, voxel_size, &rays, scene.pixel_error, levels.len()),
        LevelPolicy::Locked(level) => Lattice::uniform(step, level as usize),
    };
    let encoding = encoding_of(source);
    let transfer = scene.transfer.clone().unwrap_or_else(|| default_transfer(default_window, &geometry, extent));
    let table = TransferTable::new(&transfer, &encoding);
    // A table entry reaches one code to each side, and quantisation moves a value by half a code.
    let slack = 1.5 * encoding.code_width();
    let opaque = (scene.mode == Mode::Dvr).then(|| source.occupancy_bins().opaque(&transfer, slack));
    let background = scene.background.map(|c| c as f32);
    Ok(ResolvedScene {
        view: View {
            rays,
            opaque,
            level: scene.level,
            pixel_error: scene.pixel_error,
            time: scene.time,
            channel: scene.channel,
        },
        frame: FrameSettings { rays, lattice, geometry, encoding, table, mode: scene.mode, background },
        transfer,
        camera,
    })
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
    if let Some(transfer) = &scene.transfer {
        transfer.validate().map_err(|error| SessionError::Scene(format!("transfer function: {error}")))?;
    }
    Ok(())
}

fn encoding_of(source: &dyn BrickSource) -> SlotEncoding {
    SlotEncoding::new(source.voxel_type(), source.value_range(), source.has_non_finite())
}

/// Slots that could ever be filled at one time step and channel, and a tenth more so that the cut may have them all.
fn max_slots(source: &dyn BrickSource) -> u32 {
    let bricks = source.pyramid().brick_count();
    u32::try_from(bricks + bricks / 8 + 2).unwrap_or(u32::MAX)
}

/// The world distance over which window presets collect their opacity: a hundredth of the volume's longest side.
pub fn preset_unit_distance(geometry: &brickyard_volume::Geometry, extent: Extent) -> f64 {
    let (low, high) = geometry.world_box(extent);
    (high - low).max_element() / 100.0
}

fn default_transfer(window: (f64, f64), geometry: &brickyard_volume::Geometry, extent: Extent) -> TransferFunction {
    let unit_distance = preset_unit_distance(geometry, extent);
    TransferFunction::preset("gray", window, unit_distance).expect("'gray' is a preset")
}
