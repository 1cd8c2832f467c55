//! The flags for sampling. `quality` has none of them: it compares sampling methods itself.

use super::named::Named;
use super::{heading, values};
use brickyard::volume::{Filter, Jitter, LevelPolicy, LightingModel, Method, Scene};
use clap::Args;

/// Flags for sampling. They override the scene file.
#[derive(Args, Clone, Debug)]
pub(crate) struct SamplingArguments {
    /// How `--mode dvr` samples and classifies a step of a ray [default: udvr]
    #[arg(help_heading = heading::SAMPLING, long, value_parser = METHODS)]
    method: Option<Method>,
    /// Interpolation between voxels [default: trilinear]
    #[arg(help_heading = heading::SAMPLING, long, value_parser = FILTERS)]
    filter: Option<Filter>,
    /// Where rays are sampled: all at the same distances, or each shifted by a random number (white, or white:SEED) or
    /// by a mask (blue, also without a value) [default: none]
    #[arg(help_heading = heading::SAMPLING, long, value_name = "none|white|blue", num_args = 0..=1, default_missing_value = "blue", value_parser = values::jitter)]
    jitter: Option<Jitter>,
    /// How `--mode dvr` is lit [default: phong in `render` and `view`, unless a scene file sets it; none in `bench`]
    #[arg(help_heading = heading::LOOK, long, value_parser = LIGHTINGS)]
    lighting: Option<LightingModel>,
    /// Sampling step in units of the finest voxel size, 0.005 to 16 [default: 1]
    #[arg(help_heading = heading::SAMPLING, long, value_parser = values::step)]
    step: Option<f64>,
    /// Level: auto, or a number (0 is the finest) [default: auto]
    #[arg(help_heading = heading::SAMPLING, long, value_parser = level)]
    level: Option<LevelPolicy>,
    /// Pixels a voxel may cover before a finer level is used [default: 1]
    #[arg(help_heading = heading::SAMPLING, long, value_parser = values::positive)]
    pixel_error: Option<f64>,
}

pub(crate) const METHODS: Named<Method> = Named(&[
    ("udvr", Method::Udvr, "One sample in the middle"),
    ("pdvr", Method::Pdvr, "Pre-integrated between the ends"),
    ("lvs", Method::Lvs, "Three virtual samples on a line between the ends"),
    ("cvs", Method::Cvs, "Three virtual samples on a cubic curve"),
    ("asm", Method::Asm, "One to eight samples, by the difference of the ends"),
    ("plvs", Method::Plvs, "As lvs, pre-integrated"),
    ("pcvs", Method::Pcvs, "As cvs, pre-integrated"),
]);

pub(crate) const FILTERS: Named<Filter> = Named(&[
    ("nearest", Filter::Nearest, "The value of the surrounding voxel: voxels as they are"),
    ("trilinear", Filter::Trilinear, "Linear between 8 voxels"),
    ("tricubic", Filter::Tricubic, "Cubic B-spline of 64 voxels: smooth, but blurs"),
]);

pub(crate) const LIGHTINGS: Named<LightingModel> = Named(&[
    ("none", LightingModel::None, "Colours as they are"),
    ("phong", LightingModel::Phong, "Phong's reflection"),
    ("blinn-phong", LightingModel::BlinnPhong, "Blinn's"),
    ("tone", LightingModel::Tone, "From cool to warm with the angle to the light"),
]);

fn level(text: &str) -> Result<LevelPolicy, String> {
    match text {
        "auto" => Ok(LevelPolicy::Auto),
        _ => text.parse().map(LevelPolicy::Locked).map_err(|_| format!("'{text}': expected auto or a level number")),
    }
}

impl SamplingArguments {
    pub(crate) fn of(&self, mut scene: Scene) -> Scene {
        scene.sampling.method = self.method.unwrap_or(scene.sampling.method);
        scene.sampling.filter = self.filter.unwrap_or(scene.sampling.filter);
        scene.sampling.jitter = self.jitter.unwrap_or(scene.sampling.jitter);
        scene.lighting.model = self.lighting.unwrap_or(scene.lighting.model);
        scene.step = self.step.unwrap_or(scene.step);
        scene.level = self.level.unwrap_or(scene.level);
        scene.pixel_error = self.pixel_error.unwrap_or(scene.pixel_error);
        scene
    }
}
