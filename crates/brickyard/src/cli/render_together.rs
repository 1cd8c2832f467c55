//! `brickyard render` of several stores in one picture.

use super::failure::Failure;
use super::output::{report, write};
use super::render_args::RenderArguments;
use super::session_errors::{offline_failure, oracle_failure, session_failure};
use brickyard::backend::CompositorChoice;
use brickyard::ensemble::{Ensemble, Member, ResolvedEnsemble};
use brickyard::offline::{Streamed, render_settled};
use brickyard::oracle::render_reference_together;
use brickyard::stats::{Percentiles, RenderStats};
use brickyard::store::Store;
use brickyard::volume::Scene;
use std::path::PathBuf;
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
    let member = |(store, default_window): (&Arc<Store>, (f64, f64))| Member { source: store.clone(), default_window };
    let members: Vec<Member> = stores.iter().zip(windows).map(member).collect();
    let scenes = arguments.scenes(scene)?;
    let resolve = |scene: &Scene| ResolvedEnsemble::new(&members, scene, arguments.size).map_err(session_failure);
    let resolved = scenes.iter().map(resolve).collect::<Result<Vec<_>, _>>()?;
    let outputs = arguments.outputs(scenes.len())?;
    let mut stats = RenderStats::default();
    let pictures = Pictures { arguments, scenes: &scenes, resolved: &resolved, outputs: &outputs };
    match arguments.compositor() {
        Some(compositor) => pictures.stream(&members, compositor, started, &mut stats)?,
        None => pictures.refer(&stores, started, &mut stats)?,
    }
    arguments.write_stats(&stats)
}

/// What is to be rendered, and where it goes.
struct Pictures<'a> {
    arguments: &'a RenderArguments,
    scenes: &'a [Scene],
    resolved: &'a [ResolvedEnsemble],
    outputs: &'a [PathBuf],
}

impl Pictures<'_> {
    fn stream(
        &self,
        members: &[Member],
        compositor: CompositorChoice,
        started: Instant,
        stats: &mut RenderStats,
    ) -> Result<(), Failure> {
        let options = self.arguments.session_options(compositor, self.scenes[0].needs());
        let mut ensemble = Ensemble::new(members, &self.resolved[0], &options).map_err(session_failure)?;
        (stats.adapter, stats.backend) = (ensemble.backend_line().into(), ensemble.backend_name());
        (stats.compositor, stats.gpu_bytes_asked) = ("raycast", ensemble.backend_bytes());
        let volumes = self.resolved[0].volumes.len();
        eprintln!("backend: {} (raycast), {volumes} volumes, {} slots", stats.adapter, ensemble.slots());
        let mut frame_ms = Vec::new();
        for ((scene, resolved), output) in self.scenes.iter().zip(self.resolved).zip(self.outputs) {
            let wait = self.arguments.max_wait();
            let picture = render_settled(&mut ensemble, resolved, wait, started, stats, &mut frame_ms);
            write(output, &picture.map_err(offline_failure)?, scene, stats)?;
        }
        stats.frame_ms = Percentiles::of(&frame_ms);
        report(stats);
        Ok(())
    }

    fn refer(&self, stores: &[Arc<Store>], started: Instant, stats: &mut RenderStats) -> Result<(), Failure> {
        (stats.adapter, stats.backend, stats.compositor) = ("cpu, f64".into(), "cpu", "reference");
        stats.completeness = 1.0;
        let mut frame_ms = Vec::new();
        for ((scene, resolved), output) in self.scenes.iter().zip(self.resolved).zip(self.outputs) {
            let shown: Vec<&Store> = resolved.volumes.iter().map(|(i, _)| &*stores[*i]).collect();
            let drawing = Instant::now();
            let picture = render_reference_together(&shown, resolved, self.arguments.host_memory);
            frame_ms.push(drawing.elapsed().as_secs_f64() * 1e3);
            stats.frames += 1;
            write(output, &picture.map_err(oracle_failure)?, scene, stats)?;
        }
        stats.settled_ms = started.elapsed().as_secs_f64() * 1e3;
        stats.first_image_ms = stats.settled_ms;
        stats.frame_ms = Percentiles::of(&frame_ms);
        Ok(())
    }
}
