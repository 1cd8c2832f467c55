//! `brickyard render`: settled pictures of a store, as PNG, under fixed budgets.

use super::failure::Failure;
use super::output::{note_window, report, write};
use super::render_args::RenderArguments;
use super::session_errors::{offline_failure, oracle_failure, session_failure};
use super::values::counted;
use super::views::Views;
use super::{render_together, store_errors};
use brickyard::backend::CompositorChoice;
use brickyard::exact::{ExactPictureError, ExactRenderer};
use brickyard::offline::render_settled;
use brickyard::oracle::render_reference;
use brickyard::pager::ExactError;
use brickyard::projection::for_mode;
use brickyard::session::{Session, resolve};
use brickyard::stats::{Percentiles, RenderStats};
use brickyard::store::Store;
use std::sync::Arc;
use std::time::Instant;

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
    note_window(&store, scene.channel);
    let views = Views::new(&arguments, scene)?;
    let mut stats = RenderStats::default();
    let compositor = arguments.compositor();
    match compositor {
        None if arguments.exact => return Err(exact_failure(ExactPictureError::Way)),
        Some(compositor) if arguments.exact => {
            run_exact(&arguments, compositor, &store, &views, started, &mut stats)?;
        }
        None => run_reference(&arguments, &store, &views, started, &mut stats)?,
        Some(compositor) => run_streaming(&arguments, compositor, &store, &views, started, &mut stats)?,
    }
    arguments.write_stats(&stats)
}

fn run_streaming(
    arguments: &RenderArguments,
    compositor: CompositorChoice,
    store: &Arc<Store>,
    views: &Views,
    started: Instant,
    stats: &mut RenderStats,
) -> Result<(), Failure> {
    let first = views.first();
    let options = arguments.session_options(compositor, first.needs());
    let window = store.default_window(first.channel);
    let mut session = Session::new(store.clone(), window, &options).map_err(session_failure)?;
    stats.adapter = session.backend_line().to_string();
    stats.backend = session.backend().name();
    stats.gpu_bytes_asked = session.backend().asked_bytes();
    stats.compositor = session.backend().compositor();
    eprintln!("backend: {} ({}), {} slots", session.backend_line(), stats.compositor, session.backend().slots());
    let mut frame_ms = Vec::new();
    for (scene, output) in views.iter() {
        let resolved = session.resolve(&scene, arguments.size).map_err(session_failure)?;
        let picture = render_settled(&mut session, &resolved, arguments.max_wait(), started, stats, &mut frame_ms);
        let picture = picture.map_err(offline_failure)?;
        write(&output, &picture, &resolved.shown(&scene), stats)?;
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
    views: &Views,
    started: Instant,
    stats: &mut RenderStats,
) -> Result<(), Failure> {
    let options = arguments.session_options(compositor, views.first().needs());
    let mut exact = ExactRenderer::new(store.clone(), &options).map_err(exact_failure)?;
    (stats.adapter, stats.backend) = (exact.backend_line().into(), "gpu");
    stats.compositor = exact.renderer().compositor().name();
    stats.gpu_bytes_asked = exact.renderer().asked_bytes();
    eprintln!("backend: {} ({}), {} slots", stats.adapter, stats.compositor, exact.renderer().slots());
    let mut frame_ms = Vec::new();
    for (scene, output) in views.iter() {
        let window = store.default_window(scene.channel);
        let resolved = resolve(&**store, window, &scene, arguments.size).map_err(session_failure)?;
        let begun = Instant::now();
        let picture = exact.render(&resolved, arguments.max_wait(), started, stats).map_err(exact_failure)?;
        frame_ms.push(begun.elapsed().as_secs_f64() * 1e3);
        let passes = match stats.passes.unwrap_or(0) {
            1 => "1 pass".to_string(),
            n => format!("{n} passes"),
        };
        eprintln!("{} in {passes}", counted(stats.bricks.wanted, "brick"));
        write(&output, &picture, &resolved.shown(&scene), stats)?;
    }
    stats.frame_ms = Percentiles::of(&frame_ms);
    report(stats);
    Ok(())
}

fn level_cells(session: &Session, store: &Store) -> Vec<usize> {
    let mut counts = vec![0; store.pyramid().levels().len()];
    for cell in &session.draw_list().cells {
        counts[cell.brick.level.index()] += 1;
    }
    counts
}

fn run_reference(
    arguments: &RenderArguments,
    store: &Arc<Store>,
    views: &Views,
    started: Instant,
    stats: &mut RenderStats,
) -> Result<(), Failure> {
    (stats.adapter, stats.backend, stats.compositor) = ("cpu, f64".into(), "cpu", "reference");
    stats.completeness = 1.0;
    let mut frame_ms = Vec::new();
    for (scene, output) in views.iter() {
        let window = store.default_window(scene.channel);
        let resolved = resolve(&**store, window, &scene, arguments.size).map_err(session_failure)?;
        let drawing = Instant::now();
        let picture = render_reference(store, &resolved, arguments.host_memory).map_err(oracle_failure)?;
        frame_ms.push(drawing.elapsed().as_secs_f64() * 1e3);
        stats.frames += 1;
        write(&output, &picture, &resolved.shown(&scene), stats)?;
    }
    stats.settled_ms = started.elapsed().as_secs_f64() * 1e3;
    stats.first_image_ms = stats.settled_ms;
    stats.frame_ms = Percentiles::of(&frame_ms);
    Ok(())
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
