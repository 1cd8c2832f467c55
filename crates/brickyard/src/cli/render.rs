//! `brickyard render`: settled pictures of a store, as PNG, under fixed budgets.

use super::failure::Failure;
use super::output::may_write;
use super::sampling_args::SamplingArguments;
use super::scene_args::SceneArguments;
use super::session_args::{BackendArgument, threads};
use super::{render_together, store_errors, values};
use brickyard::backend::{BackendError, CompositorChoice};
use brickyard::exact::{ExactPictureError, ExactRenderer};
use brickyard::offline::{OfflineError, render_settled};
use brickyard::oracle::{OracleError, render_reference};
use brickyard::pager::{ExactError, PagerError};
use brickyard::picture_file::write_png;
use brickyard::projection::for_mode;
use brickyard::render::GpuError;
use brickyard::session::{Session, SessionError, SessionOptions, resolve};
use brickyard::software::SoftwareError;
use brickyard::stats::{Percentiles, RenderStats};
use brickyard::store::Store;
use brickyard::volume::{Camera, Needs, Picture, Scene};
use clap::{Args, ValueEnum};
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// `brickyard render STORE... -o out.png`
#[derive(Args)]
pub(crate) struct RenderArguments {
    /// The store; or several, up to 32, in one picture, each where its own world is or where --volume N:matrix=... puts it
    #[arg(required = true)]
    pub(super) stores: Vec<PathBuf>,
    /// Output PNG; several pictures are numbered: out_000.png, ...
    #[arg(short, long, value_name = "out.png")]
    output: PathBuf,
    /// Picture size in pixels
    #[arg(long, value_name = "WxH", default_value = "512x512", value_parser = values::size_px)]
    pub(super) size: (u32, u32),
    #[command(flatten)]
    pub(super) scene: SceneArguments,
    #[command(flatten)]
    pub(super) sampling: SamplingArguments,
    /// Turn the camera once around its target in N pictures
    #[arg(long, value_name = "N", conflicts_with = "path")]
    orbit: Option<u32>,
    /// Cameras of several pictures (JSON list)
    #[arg(long, value_name = "path.json")]
    path: Option<PathBuf>,
    /// Where to render; auto takes a hardware GPU if there is one, else the CPU
    #[arg(long, value_enum, default_value_t = BackendArgument::Auto)]
    backend: BackendArgument,
    /// How to render: sorted composites bricks back to front (GPU only), raycast follows each ray front to back, compute does so by
    /// compute shaders (GPU only); auto is raycast; reference holds whole levels in memory, in f64
    #[arg(long, value_enum, default_value_t = CompositorArgument::Auto)]
    compositor: CompositorArgument,
    /// Draw every brick that the view wants, however few fit at once: in passes, on a GPU (a software one will do)
    #[arg(long)]
    pub(super) exact: bool,
    /// Hard limit of brick slots, tables, targets and staging
    #[arg(long, value_name = "BYTES", default_value = "1GiB", value_parser = values::bytes)]
    gpu_memory: u64,
    /// Hard limit of decoded bricks and scratch
    #[arg(long, value_name = "BYTES", default_value = "2GiB", value_parser = values::bytes)]
    pub(super) host_memory: u64,
    /// Threads for decoding and for the CPU backend [default: all]
    #[arg(short = 'j', long)]
    threads: Option<NonZeroUsize>,
    /// Give up on a picture that has not settled after S seconds
    #[arg(long, value_name = "S", default_value = "600", value_parser = values::positive)]
    max_wait: f64,
    /// Write statistics (JSON)
    #[arg(long, value_name = "stats.json")]
    stats: Option<PathBuf>,
    /// Replace existing pictures
    #[arg(long)]
    overwrite: bool,
}

#[derive(Clone, Copy, PartialEq, ValueEnum)]
enum CompositorArgument {
    Auto,
    Sorted,
    Raycast,
    Compute,
    Reference,
}

/// Runs `render`.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(arguments: RenderArguments) -> Result<(), Failure> {
    let started = Instant::now();
    let stores = arguments.stores.iter().map(|path| store_errors::open(path));
    let mut stores = stores.collect::<Result<Vec<Store>, Failure>>()?;
    if stores.len() > 1 || arguments.scene.is_of_several()? {
        return render_together::run(&arguments, stores.into_iter().map(Arc::new).collect(), started);
    }
    let store = stores.remove(0);
    let scene = arguments.sampling.of(arguments.scene.scene(&store, arguments.size)?);
    let store = for_mode(store, scene.mode).map_err(|error| store_errors::open_failure(&error))?;
    let store = Arc::new(store);
    let scenes = arguments.scenes(scene)?;
    let outputs = arguments.outputs(scenes.len())?;
    let mut stats = RenderStats::default();
    let compositor = arguments.compositor();
    match compositor {
        None if arguments.exact => return Err(exact_failure(ExactPictureError::Way)),
        Some(compositor) if arguments.exact => {
            run_exact(&arguments, compositor, &store, &scenes, &outputs, started, &mut stats)?;
        }
        None => run_reference(&arguments, &store, &scenes, &outputs, started, &mut stats)?,
        Some(compositor) => run_streaming(&arguments, compositor, &store, &scenes, &outputs, started, &mut stats)?,
    }
    arguments.write_stats(&stats)
}

fn run_streaming(
    arguments: &RenderArguments,
    compositor: CompositorChoice,
    store: &Arc<Store>,
    scenes: &[Scene],
    outputs: &[PathBuf],
    started: Instant,
    stats: &mut RenderStats,
) -> Result<(), Failure> {
    let options = arguments.session_options(compositor, scenes[0].needs());
    let window = store.default_window(scenes[0].channel);
    let mut session = Session::new(store.clone(), window, &options).map_err(session_failure)?;
    stats.adapter = session.backend_line().to_string();
    stats.backend = session.backend().name();
    stats.gpu_bytes_asked = session.backend().asked_bytes();
    stats.compositor = session.backend().compositor();
    eprintln!("backend: {} ({}), {} slots", session.backend_line(), stats.compositor, session.backend().slots());
    let mut frame_ms = Vec::new();
    for (scene, output) in scenes.iter().zip(outputs) {
        let resolved = session.resolve(scene, arguments.size).map_err(session_failure)?;
        let picture = render_settled(&mut session, &resolved, arguments.max_wait(), started, stats, &mut frame_ms);
        let picture = picture.map_err(offline_failure)?;
        write(output, &picture, &resolved.shown(scene), stats)?;
    }
    stats.frame_ms = Percentiles::of(&frame_ms);
    stats.level_cells = level_cells(&session, store);
    report(stats);
    Ok(())
}

fn run_exact(
    arguments: &RenderArguments,
    compositor: CompositorChoice,
    store: &Arc<Store>,
    scenes: &[Scene],
    outputs: &[PathBuf],
    started: Instant,
    stats: &mut RenderStats,
) -> Result<(), Failure> {
    let options = arguments.session_options(compositor, scenes[0].needs());
    let mut exact = ExactRenderer::new(store.clone(), &options).map_err(exact_failure)?;
    (stats.adapter, stats.backend) = (exact.backend_line().into(), "gpu");
    stats.compositor = exact.renderer().compositor().name();
    stats.gpu_bytes_asked = exact.renderer().asked_bytes();
    eprintln!("backend: {} ({}), {} slots", stats.adapter, stats.compositor, exact.renderer().slots());
    let mut frame_ms = Vec::new();
    for (scene, output) in scenes.iter().zip(outputs) {
        let window = store.default_window(scene.channel);
        let resolved = resolve(&**store, window, scene, arguments.size).map_err(session_failure)?;
        let begun = Instant::now();
        let picture = exact.render(&resolved, arguments.max_wait(), started, stats).map_err(exact_failure)?;
        frame_ms.push(begun.elapsed().as_secs_f64() * 1e3);
        eprintln!("{} bricks in {} passes", stats.bricks.wanted, stats.passes.unwrap_or(0));
        write(output, &picture, &resolved.shown(scene), stats)?;
    }
    stats.frame_ms = Percentiles::of(&frame_ms);
    report(stats);
    Ok(())
}

impl RenderArguments {
    /// The files of so many pictures, all of which may be written, and the statistics', too.
    pub(super) fn outputs(&self, count: usize) -> Result<Vec<PathBuf>, Failure> {
        let outputs: Vec<PathBuf> = (0..count).map(|i| numbered(&self.output, i, count)).collect();
        for path in outputs.iter().chain(&self.stats) {
            may_write(path, self.overwrite)?;
        }
        match self.stats.as_ref().filter(|path| outputs.contains(path)) {
            Some(path) => {
                Err(Failure::usage(format!("{}: cannot be a picture and hold the statistics", path.display())))
            }
            None => Ok(outputs),
        }
    }

    /// `None` is the reference.
    pub(super) fn compositor(&self) -> Option<CompositorChoice> {
        match self.compositor {
            CompositorArgument::Auto => Some(CompositorChoice::Auto),
            CompositorArgument::Sorted => Some(CompositorChoice::Sorted),
            CompositorArgument::Raycast => Some(CompositorChoice::Raycast),
            CompositorArgument::Compute => Some(CompositorChoice::Compute),
            CompositorArgument::Reference => None,
        }
    }

    pub(super) fn session_options(&self, compositor: CompositorChoice, bricks: Needs) -> SessionOptions {
        SessionOptions {
            backend: self.backend.into(),
            compositor,
            gpu_memory_bytes: self.gpu_memory,
            host_memory_bytes: self.host_memory,
            bricks,
            threads: threads(self.threads),
            max_size_px: self.size,
            leaps: true,
            live: false,
        }
    }

    /// The scenes of all pictures: one, an orbit, or a path's cameras. The one given has a camera.
    pub(super) fn scenes(&self, scene: Scene) -> Result<Vec<Scene>, Failure> {
        let with_camera = |camera: Camera| Scene { camera: Some(camera), ..scene.clone() };
        if let (Some(count), Some(start)) = (self.orbit, scene.camera) {
            if count == 0 {
                return Err(Failure::usage("--orbit 0: expected at least one picture"));
            }
            return Ok((0..count).map(|i| with_camera(start.orbited(360.0 * i as f64 / count as f64))).collect());
        }
        let Some(path) = &self.path else { return Ok(vec![scene]) };
        let bad = |problem: String| Failure::bad_input(format!("{}: {problem}", path.display()));
        let text = std::fs::read_to_string(path).map_err(|error| bad(error.to_string()))?;
        let cameras: Vec<Camera> =
            serde_json::from_str(&text).map_err(|error| bad(format!("not a list of cameras: {error}")))?;
        if cameras.is_empty() {
            return Err(bad("the list of cameras is empty".into()));
        }
        Ok(cameras.into_iter().map(with_camera).collect())
    }

    /// Writes the statistics, where they are asked for.
    pub(super) fn write_stats(&self, stats: &RenderStats) -> Result<(), Failure> {
        let Some(path) = &self.stats else { return Ok(()) };
        let text = serde_json::to_string_pretty(stats).map_err(Failure::failed)?;
        std::fs::write(path, text + "\n").map_err(|error| Failure::failed(format!("{}: {error}", path.display())))
    }

    pub(super) fn max_wait(&self) -> Duration {
        Duration::from_secs_f64(self.max_wait.min(1e9))
    }
}

fn level_cells(session: &Session, store: &Store) -> Vec<usize> {
    let mut counts = vec![0; store.pyramid().levels().len()];
    for cell in &session.draw_list().cells {
        counts[cell.brick.level.index()] += 1;
    }
    counts
}

pub(super) fn report(stats: &RenderStats) {
    if stats.memory_bound {
        let found = match stats.effective_pixel_error {
            Some(error) => format!("{error:.1} px of {:.1} px", stats.pixel_error),
            None => "the eye is inside a coarse brick".into(),
        };
        eprintln!("memory bound: {found}; the picture is complete but coarser than asked for: raise --gpu-memory");
    }
    if stats.bricks.failed > 0 {
        eprintln!(
            "{} bricks could not be read and are drawn from coarser levels; run `brickyard verify` for their names",
            stats.bricks.failed
        );
    }
}

fn run_reference(
    arguments: &RenderArguments,
    store: &Arc<Store>,
    scenes: &[Scene],
    outputs: &[PathBuf],
    started: Instant,
    stats: &mut RenderStats,
) -> Result<(), Failure> {
    (stats.adapter, stats.backend, stats.compositor) = ("cpu, f64".into(), "cpu", "reference");
    stats.completeness = 1.0;
    let mut frame_ms = Vec::new();
    for (scene, output) in scenes.iter().zip(outputs) {
        let window = store.default_window(scene.channel);
        let resolved = resolve(&**store, window, scene, arguments.size).map_err(session_failure)?;
        let drawing = Instant::now();
        let picture = render_reference(store, &resolved, arguments.host_memory).map_err(oracle_failure)?;
        frame_ms.push(drawing.elapsed().as_secs_f64() * 1e3);
        stats.frames += 1;
        write(output, &picture, &resolved.shown(scene), stats)?;
    }
    stats.settled_ms = started.elapsed().as_secs_f64() * 1e3;
    stats.first_image_ms = stats.settled_ms;
    stats.frame_ms = Percentiles::of(&frame_ms);
    Ok(())
}

/// Writes a picture, and into it the scene it is of.
pub(super) fn write(path: &Path, picture: &Picture, shown: &Scene, stats: &RenderStats) -> Result<(), Failure> {
    let notes = [
        ("Software", format!("brickyard {}", env!("CARGO_PKG_VERSION"))),
        ("Scene", serde_json::to_string(shown).map_err(Failure::failed)?),
        (
            "Bricks",
            format!("{} of {} wanted, {} failed", stats.bricks.resident, stats.bricks.wanted, stats.bricks.failed),
        ),
    ];
    write_png(path, picture, &notes).map_err(Failure::failed)
}

fn numbered(path: &Path, index: usize, count: usize) -> PathBuf {
    if count == 1 {
        return path.to_path_buf();
    }
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let extension = path.extension().unwrap_or("png".as_ref()).to_string_lossy();
    path.with_file_name(format!("{stem}_{index:03}.{extension}"))
}

pub(super) fn offline_failure(error: OfflineError) -> Failure {
    match error {
        OfflineError::Session(error) => session_failure(error),
        other => Failure::failed(other),
    }
}

pub(super) fn oracle_failure(error: OracleError) -> Failure {
    match error {
        OracleError::TooLarge { .. } => Failure::usage(error),
        OracleError::Read(error) => store_errors::read_failure(&error),
    }
}

pub(crate) fn session_failure(error: SessionError) -> Failure {
    match error {
        SessionError::Camera(_) | SessionError::Stereo(_) | SessionError::Scene(_) => Failure::usage(error),
        SessionError::Unreadable(_) => Failure::bad_input(error),
        // A budget, a size or a choice that cannot work, whatever this machine has: as `pack` refuses a `--memory`.
        SessionError::Pager(PagerError::HostMemory { .. } | PagerError::Slots { .. })
        | SessionError::Backend(
            BackendError::Gpu(
                GpuError::Budget { .. }
                | GpuError::PictureTooLarge { .. }
                | GpuError::Meshes { .. }
                | GpuError::Textures { .. },
            )
            | BackendError::Cpu(SoftwareError::Budget { .. })
            | BackendError::CpuCompositor(_),
        ) => Failure::usage(error),
        SessionError::Pager(_) | SessionError::Backend(_) | SessionError::LostAgain { .. } => Failure::failed(error),
    }
}

fn exact_failure(error: ExactPictureError) -> Failure {
    match error {
        ExactPictureError::Backend(error) => session_failure(error.into()),
        ExactPictureError::Passes(ExactError::Budget(error)) => session_failure(error.into()),
        ExactPictureError::Way | ExactPictureError::Passes(ExactError::TooManyCells { .. }) => Failure::usage(error),
        ExactPictureError::Passes(ExactError::Unreadable(_)) => Failure::bad_input(error),
        ExactPictureError::TooLong { .. } => Failure::failed(error),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn several_pictures_are_numbered() {
        assert_eq!(numbered(Path::new("a/b.png"), 0, 1), Path::new("a/b.png"));
        assert_eq!(numbered(Path::new("a/b.png"), 7, 20), Path::new("a/b_007.png"));
        assert_eq!(numbered(Path::new("b"), 1, 2), Path::new("b_001.png"));
    }
}
