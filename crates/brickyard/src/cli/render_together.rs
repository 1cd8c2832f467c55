//! `brickyard render` of several stores in one picture.

use super::failure::Failure;
use super::output::{note_window, report, write};
use super::render_args::RenderArguments;
use super::session_errors::{offline_failure, oracle_failure, session_failure};
use super::views::Views;
use brickyard::backend::CompositorChoice;
use brickyard::ensemble::{Ensemble, Member, ResolvedEnsemble};
use brickyard::offline::{Streamed, render_settled};
use brickyard::oracle::render_reference_together;
use brickyard::stats::{Percentiles, RenderStats};
use brickyard::store::Store;
use brickyard::volume::Scene;
use std::sync::Arc;
use std::time::Instant;

/// Renders the stores together.
///
/// # Errors
/// With the message and exit code for the user.
pub(super) fn run(arguments: &RenderArguments, stores: Vec<Arc<Store>>, started: Instant) -> Result<(), Failure> {
    if arguments.exact {
        return Err(Failure::usage("--exact draws one volume: leave it out, or give one store"));
    }
    let scene = arguments.sampling.of(arguments.scene.scene_of_several(&stores, arguments.size)?);
    let window =
        |(i, store): (usize, &Arc<Store>)| store.default_window(scene.volumes[i].channel.unwrap_or(scene.channel));
    let windows: Vec<(f64, f64)> = stores.iter().enumerate().map(window).collect();
    for (store, look) in stores.iter().zip(&scene.volumes) {
        note_window(store, look.channel.unwrap_or(scene.channel));
    }
    let member = |(store, default_window): (&Arc<Store>, (f64, f64))| Member { source: store.clone(), default_window };
    let members: Vec<Member> = stores.iter().zip(windows).map(member).collect();
    let pictures = Pictures { arguments, members: &members, views: &Views::new(arguments, scene)? };
    let mut stats = RenderStats::default();
    match arguments.compositor() {
        Some(compositor) => pictures.stream(compositor, started, &mut stats)?,
        None => pictures.refer(&stores, started, &mut stats)?,
    }
    arguments.write_stats(&stats)
}

/// What is to be rendered, and where it goes.
struct Pictures<'a> {
    arguments: &'a RenderArguments,
    members: &'a [Member],
    views: &'a Views,
}

impl Pictures<'_> {
    fn resolve(&self, scene: &Scene) -> Result<ResolvedEnsemble, Failure> {
        ResolvedEnsemble::new(self.members, scene, self.arguments.size).map_err(session_failure)
    }

    fn stream(&self, compositor: CompositorChoice, started: Instant, stats: &mut RenderStats) -> Result<(), Failure> {
        let first = self.views.first();
        let options = self.arguments.session_options(compositor, first.needs());
        let first = self.resolve(&first)?;
        let mut ensemble = Ensemble::new(self.members, &first, &options).map_err(session_failure)?;
        (stats.adapter, stats.backend) = (ensemble.backend_line().into(), ensemble.backend_name());
        (stats.compositor, stats.gpu_bytes_asked) = ("raycast", ensemble.backend_bytes());
        let volumes = first.volumes.len();
        eprintln!("backend: {} (raycast), {volumes} volumes, {} slots", stats.adapter, ensemble.slots());
        let mut frame_ms = Vec::new();
        for (scene, output) in self.views.iter() {
            let (resolved, wait) = (self.resolve(&scene)?, self.arguments.max_wait());
            let picture = render_settled(&mut ensemble, &resolved, wait, started, stats, &mut frame_ms);
            write(&output, &picture.map_err(offline_failure)?, &scene, stats)?;
        }
        stats.frame_ms = Percentiles::of(&frame_ms);
        report(stats);
        Ok(())
    }

    fn refer(&self, stores: &[Arc<Store>], started: Instant, stats: &mut RenderStats) -> Result<(), Failure> {
        (stats.adapter, stats.backend, stats.compositor) = ("cpu, f64".into(), "cpu", "reference");
        stats.completeness = 1.0;
        let mut frame_ms = Vec::new();
        for (scene, output) in self.views.iter() {
            let resolved = self.resolve(&scene)?;
            let shown: Vec<&Store> = resolved.volumes.iter().map(|(i, _)| &*stores[*i]).collect();
            let drawing = Instant::now();
            let picture = render_reference_together(&shown, &resolved, self.arguments.host_memory);
            frame_ms.push(drawing.elapsed().as_secs_f64() * 1e3);
            stats.frames += 1;
            write(&output, &picture.map_err(oracle_failure)?, &scene, stats)?;
        }
        stats.settled_ms = started.elapsed().as_secs_f64() * 1e3;
        stats.first_image_ms = stats.settled_ms;
        stats.frame_ms = Percentiles::of(&frame_ms);
        Ok(())
    }
}
