//! `brickyard render`: settled pictures of stores, as PNG or a movie, under fixed budgets.

use super::advice::advised;
use super::destination::Destination;
use super::failure::{ExitKind, Failure};
use super::output::{damage, note_window, report, write_json};
use super::render_args::RenderArguments;
use super::say::say;
use super::session_errors::{offline_failure, oracle_failure, session_failure};
use super::views::Views;
use super::{remarks, store_errors};
use brickyard::backend::{BackendChoice, BackendError, CompositorChoice};
use brickyard::doubtful_extremes::DoubtfulExtremes;
use brickyard::exact::{ExactPictureError, ExactRenderer};
use brickyard::lettering::letter_sides;
use brickyard::offline::render_settled;
use brickyard::oracle::render_reference_within;
use brickyard::overlay::{Overlays, color_bar};
use brickyard::pager::ExactError;
use brickyard::render::GpuError;
use brickyard::session::{ResolvedScene, Session, SessionOptions, VolumeSource, resolve};
use brickyard::stats::{Percentiles, RenderStats, ms};
use brickyard::store::Store;
use brickyard::tiles::render_exact;
use brickyard::volume::{Picture, Scene, counted};
use std::cell::Cell;
use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Instant;

/// Runs `render`.
///
/// # Errors
/// With the message and exit code for the user.
pub(crate) fn run(arguments: RenderArguments) -> Result<(), Failure> {
    let started = Instant::now();
    let volumes = store_errors::open_volumes(&arguments.stores)?;
    let mut scene = arguments.scene.scene(&volumes, arguments.size)?;
    arguments.scene.set_first_look(&mut scene, &volumes);
    let mut scene = arguments.sampling.of(scene);
    scene.pixel_samples = arguments.aa.unwrap_or(scene.pixel_samples);
    let volumes = volumes.into_iter().map(|volume| volume.suited(scene.mode));
    let volumes = volumes.collect::<Result<Vec<VolumeSource>, _>>();
    let volumes = volumes.map_err(|error| store_errors::open_failure(&error))?;
    let stores: Vec<Arc<Store>> = volumes.iter().filter_map(VolumeSource::store).cloned().collect();
    let shown = scene.layers.iter().enumerate().filter(|(_, layer)| layer.visible);
    let windows: BTreeSet<_> = shown.map(|(i, layer)| (scene.store(i), layer.channel)).collect();
    windows.into_iter().for_each(|(store, channel)| note_window(stores.get(store), channel));
    if let Some(missing) = remarks::of_missing_isovalue(&scene, &volumes) {
        return Err(Failure::usage(missing));
    }
    for remark in remarks::of_scene(&scene, &volumes) {
        say!("note: {remark}");
    }
    let overlays = arguments.overlays();
    overlays.check(&scene, arguments.size).map_err(Failure::usage)?;
    if overlays.color_bar && color_bar::bars(&scene, &volumes).is_empty() {
        say!("note: no colour bar: labels, and surfaces with a given colour, have none");
    }
    let views = Views::new(&arguments, scene, &volumes)?;
    let destination = Destination::new(&arguments, views.count())?;
    let mut pictures = Pictures {
        arguments: &arguments,
        overlays,
        stores,
        volumes,
        views,
        destination,
        started,
        stats: RenderStats::default(),
        has_told_of_extremes: Cell::new(false),
    };
    match arguments.compositor {
        None if arguments.exact => {
            return Err(Failure::usage("the reference compositor is always exact: leave --exact out"));
        }
        Some(compositor) if arguments.exact => pictures.exact(compositor)?,
        None => pictures.reference()?,
        Some(compositor) => pictures.stream(compositor)?,
    }
    let Pictures { destination, stats, .. } = pictures;
    destination.finish()?;
    arguments.stats.as_ref().map_or(Ok(()), |path| write_json(path, &stats))?;
    match damage(&stats).filter(|_| arguments.strict) {
        // The bricks are reported already.
        Some(_) => {
            Err(Failure::new(ExitKind::VerificationFailed, "--strict: some bricks of the pictures could not be read"))
        }
        None => Ok(()),
    }
}

/// The pictures of one run: their volumes, views, destination and statistics.
struct Pictures<'a> {
    arguments: &'a RenderArguments,
    overlays: Overlays,
    stores: Vec<Arc<Store>>,
    volumes: Vec<VolumeSource>,
    views: Views,
    destination: Destination,
    started: Instant,
    stats: RenderStats,
    /// Whether the remark on lost extremes is printed: once for all pictures.
    has_told_of_extremes: Cell<bool>,
}

impl Pictures<'_> {
    fn resolve(&self, scene: &Scene) -> Result<ResolvedScene, Failure> {
        resolve(&self.volumes, scene, self.arguments.size).map_err(session_failure)
    }

    /// Refuses a picture with unreadable bricks if their store is gone: coarser ones would stand in for a whole store.
    fn refuse_replaced(&self, stats: &RenderStats) -> Result<(), Failure> {
        let replaced = damage(stats).and_then(|_| self.stores.iter().find(|store| store.is_replaced()));
        replaced.map_or(Ok(()), |store| Err(store_errors::open_failure(&store.replaced())))
    }

    /// Prints once the remarks on lost extremes and on cut-away values in projections.
    fn tell_of_extremes(&self, scene: &ResolvedScene, found: &DoubtfulExtremes) {
        let remarks = remarks::of_extremes(scene, found, &self.volumes);
        if !remarks.is_empty() && !self.has_told_of_extremes.replace(true) {
            remarks.iter().for_each(|remark| say!("note: {remark}"));
        }
    }

    /// Draws every view and writes its picture. `draw` receives a scene, the statistics so far and the list of frame
    /// times.
    fn draw(
        &mut self,
        mut draw: impl FnMut(&Self, &Scene, &mut RenderStats, &mut Vec<f64>) -> Result<(ResolvedScene, Picture), Failure>,
    ) -> Result<(), Failure> {
        let (mut stats, mut frame_ms) = (std::mem::take(&mut self.stats), Vec::new());
        let mut is_told = false;
        for i in 0..self.views.count() {
            let scene = self.views.scene(i)?;
            let (resolved, mut picture) = draw(self, &scene, &mut stats, &mut frame_ms)?;
            self.refuse_replaced(&stats)?;
            if !is_told && let Some(remark) = remarks::of_unfinished(&stats.adapter, &resolved, &self.volumes) {
                is_told = true;
                say!("warning: {remark}");
            }
            if let Some(remark) = remarks::of_empty(&picture, scene.background, &resolved, &self.volumes) {
                say!("note: {remark}");
            }
            if scene.slice.is_some()
                && resolved.is_anatomical
                && resolved.stereo.is_none()
                && !self.arguments.no_letters
            {
                letter_sides(&mut picture, &resolved.camera).map_err(Failure::failed)?;
            }
            let shown = resolved.shown(&scene);
            self.overlays.draw(&mut picture, &shown, &self.volumes).map_err(Failure::failed)?;
            self.destination.write(i, &picture, &shown, &stats)?;
        }
        stats.frame_ms = Percentiles::of(&frame_ms);
        report(&stats);
        self.stats = stats;
        Ok(())
    }

    fn stream(&mut self, compositor: CompositorChoice) -> Result<(), Failure> {
        let mut session = self.session(self.arguments.session_options(compositor, self.views.count()))?;
        self.draw(|run, scene, stats, frame_ms| {
            let resolved = session.resolve(scene, run.arguments.size).map_err(session_failure)?;
            let max_wait = run.arguments.max_wait();
            let picture = render_settled(&mut session, &resolved, max_wait, run.started, stats, frame_ms);
            let picture = picture.map_err(offline_failure)?;
            run.tell_of_extremes(&resolved, &session.doubtful_extremes(&resolved));
            Ok((resolved, picture))
        })?;
        self.stats.level_cells = level_cells(&session, &self.volumes);
        Ok(())
    }

    /// Creates a session for the first view, and prints its backend.
    fn session(&mut self, options: SessionOptions) -> Result<Session, Failure> {
        let mut session = Session::new(self.volumes.clone(), options);
        let first = session.resolve(&self.views.scene(0)?, self.arguments.size).map_err(session_failure)?;
        session.fit(&first).map_err(session_failure)?;
        let stats = &mut self.stats;
        stats.describe(&session);
        let layers = match first.layers.len() {
            1 => String::new(),
            count => format!(" {count} layers,"),
        };
        say!("backend: {} ({}),{layers} {} slots", stats.adapter, stats.compositor, session.slots());
        Ok(session)
    }

    /// Draws in passes if one volume is drawn by a GPU and the flags permit; otherwise in tiles.
    fn exact(&mut self, compositor: CompositorChoice) -> Result<(), Failure> {
        let options = self.arguments.session_options(compositor, self.views.count());
        let first = self.resolve(&self.views.scene(0)?)?;
        let takes_passes = matches!(compositor, CompositorChoice::Auto | CompositorChoice::Sorted);
        if !first.is_alone() || options.backend == BackendChoice::Cpu || !takes_passes {
            return self.in_tiles(options);
        }
        let source = self.volumes[first.layers[0].volume].source.clone();
        let encoding = first.layers[0].frames[0].settings.encoding;
        match ExactRenderer::new(source, encoding, first.needs, self.arguments.size, &options) {
            Ok(exact) => self.in_passes(exact),
            Err(ExactPictureError::Backend(BackendError::Gpu(GpuError::NoAdapter { .. })))
                if options.backend == BackendChoice::Auto && compositor == CompositorChoice::Auto =>
            {
                self.in_tiles(options)
            }
            Err(error) => Err(exact_failure(error)),
        }
    }

    fn in_tiles(&mut self, options: SessionOptions) -> Result<(), Failure> {
        let mut session = self.session(options)?;
        self.draw(|run, scene, stats, frame_ms| {
            let resolved = session.resolve(scene, run.arguments.size).map_err(session_failure)?;
            let begun = Instant::now();
            let picture = render_exact(&mut session, &resolved, run.arguments.max_wait(), run.started, stats);
            let picture = picture.map_err(offline_failure)?;
            frame_ms.push(ms(begun));
            say!("drawn in {}", counted(stats.tiles.unwrap_or(0) as u64, "tile"));
            run.tell_of_extremes(&resolved, &resolved.doubtful_extremes(&run.volumes));
            Ok((resolved, picture))
        })
    }

    fn in_passes(&mut self, mut exact: ExactRenderer) -> Result<(), Failure> {
        let stats = &mut self.stats;
        (stats.adapter, stats.backend) = (exact.backend_line().into(), "gpu");
        stats.compositor = exact.renderer().compositor().name();
        stats.gpu_bytes_asked = exact.renderer().asked_bytes();
        say!("backend: {} ({}), {} slots", stats.adapter, stats.compositor, exact.renderer().slots(0));
        self.draw(|run, scene, stats, frame_ms| {
            let resolved = run.resolve(scene)?;
            let begun = Instant::now();
            let picture =
                exact.render(&resolved, run.arguments.max_wait(), run.started, stats).map_err(exact_failure)?;
            frame_ms.push(ms(begun));
            let passes = match stats.passes.unwrap_or(0) {
                1 => "1 pass".to_string(),
                n => format!("{n} passes"),
            };
            say!("{} in {passes}", counted(stats.bricks.wanted, "brick"));
            run.tell_of_extremes(&resolved, &resolved.doubtful_extremes(&run.volumes));
            Ok((resolved, picture))
        })
    }

    fn reference(&mut self) -> Result<(), Failure> {
        let stats = &mut self.stats;
        (stats.adapter, stats.backend, stats.compositor) = ("cpu, f64".into(), "cpu", "reference");
        stats.completeness = 1.0;
        self.draw(|run, scene, stats, frame_ms| {
            let resolved = run.resolve(scene)?;
            let stores: Vec<&Store> = run.stores.iter().map(|store| &**store).collect();
            let begun = Instant::now();
            let (memory, max_wait) = (run.arguments.limits.host_memory, run.arguments.max_wait());
            let picture = render_reference_within(&stores, &resolved, memory, max_wait).map_err(oracle_failure)?;
            frame_ms.push(ms(begun));
            stats.frames += 1;
            run.tell_of_extremes(&resolved, &resolved.doubtful_extremes(&run.volumes));
            Ok((resolved, picture))
        })?;
        self.stats.settled_ms = ms(self.started);
        self.stats.first_image_ms = self.stats.settled_ms;
        Ok(())
    }
}

/// Counts the cells drawn at each level, of all layers.
fn level_cells(session: &Session, volumes: &[VolumeSource]) -> Vec<usize> {
    let levels = volumes.iter().map(|volume| volume.source.pyramid().levels().len()).max();
    let mut counts = vec![0; levels.unwrap_or(0)];
    for cell in session.draw_lists().flat_map(|list| &list.cells) {
        counts[cell.brick.level.index()] += 1;
    }
    counts
}

fn exact_failure(error: ExactPictureError) -> Failure {
    match error {
        ExactPictureError::Backend(error) => session_failure(error.into()),
        ExactPictureError::Passes(ExactError::Budget(error)) => session_failure(error.into()),
        ExactPictureError::Way
        | ExactPictureError::Mixed
        | ExactPictureError::Passes(ExactError::TooManyCells { .. }) => Failure::usage(advised(&error)),
        ExactPictureError::Passes(ExactError::Unreadable(_)) => Failure::bad_input(error),
        ExactPictureError::TooLong { .. } => Failure::failed(advised(&error)),
    }
}
