//! Rays that Mesa's llvmpipe may leave unfinished: it silently ends all loops of a shader's run after 65,535 rounds in
//! all (`LP_MAX_TGSI_LOOP_ITERATIONS`). GPUs have no such bound. Judged by the greatest possible rounds of a ray,
//! mostly far above its actual ones.

use crate::session::resolve::{ResolvedLayer, ResolvedScene};
use crate::session::volume_source::VolumeSource;
use brickyard_volume::{FrameSettings, Gradient, LightingModel, box_corners};

/// Rounds after which llvmpipe ends the loops of a shader's run.
const MOST_ROUNDS: usize = 65_535;

/// Rounds of the loop for a Sobel gradient.
const SOBEL_ROUNDS: usize = 27;

/// Rounds of the loops that search a ray's crossing of a surface.
const SEARCH_ROUNDS: usize = 18;

impl ResolvedScene {
    /// Whether llvmpipe may leave rays of this scene unfinished. `volumes` are those of the resolved scene. Costs a
    /// walk along one ray of each layer: a millisecond.
    pub fn may_be_unfinished(&self, volumes: &[VolumeSource]) -> bool {
        let rounds = |layer: &ResolvedLayer| most_samples(layer, volumes) * rounds_of_sample(&layer.frames[0].settings);
        self.layers.iter().map(rounds).sum::<usize>() > MOST_ROUNDS
    }
}

/// Returns the most samples of a ray in a layer: along the longest diagonal, as near to the eye as it may lie.
fn most_samples(layer: &ResolvedLayer, volumes: &[VolumeSource]) -> usize {
    let settings = &layer.frames[0].settings;
    let extent = volumes[layer.volume].source.pyramid().levels()[0].extent;
    let corners = box_corners(settings.geometry.world_box(extent));
    let corners = corners.map(|corner| settings.placement.world_from_volume(corner));
    let longest = (0..4).map(|i| corners[i].distance(corners[7 - i])).fold(0.0, f64::max);
    let farthest = corners.iter().map(|corner| corner.distance(settings.rays.eye)).fold(0.0, f64::max);
    settings.lattice.segments(farthest - longest, farthest).count()
}

/// Returns the most loop rounds for a sample, and for the way to it from the previous one.
fn rounds_of_sample(settings: &FrameSettings) -> usize {
    let is_composed = !settings.mode.is_projection();
    let is_lit = is_composed && settings.lighting.model != LightingModel::None;
    let has_gradient = is_lit || settings.grid().is_some();
    let gradient = if has_gradient && settings.lighting.gradient == Gradient::Sobel { SOBEL_ROUNDS } else { 0 };
    let lights = if is_lit { settings.lighting.lights.len().max(1) } else { 0 };
    let search = if is_composed && !settings.surfaces.is_empty() { SEARCH_ROUNDS } else { 0 };
    let parts = if is_composed { settings.sampling.parts(f64::INFINITY) } else { 1 };
    // Its own round, and that of a macro-cell.
    2 + search + parts * (1 + gradient + lights)
}
