//! The flags that say how a picture is sampled. `quality` has none of them: ways to sample are what it compares.

use super::heading;
use super::values;
use brickyard::volume::{Filter, Jitter, LevelPolicy, LightingModel, Method, Scene};
use clap::{Args, ValueEnum};

/// Flags that say how a picture is sampled. They override the scene file.
#[derive(Args, Clone, Debug)]
pub(crate) struct SamplingArguments {
    /// How `--mode dvr` samples and classifies a step of a ray [default: udvr]
    #[arg(help_heading = heading::SAMPLING, long, value_enum)]
    method: Option<MethodArgument>,
    /// How the field is made of voxels [default: trilinear]
    #[arg(help_heading = heading::SAMPLING, long, value_enum)]
    filter: Option<FilterArgument>,
    /// Where rays are sampled: all at the same distances, or each moved by a random number (white, or white:SEED) or by a mask
    /// (blue, also without a value) [default: none]
    #[arg(help_heading = heading::SAMPLING, long, value_name = "none|white|blue", num_args = 0..=1, default_missing_value = "blue", value_parser = values::jitter)]
    jitter: Option<Jitter>,
    /// How `--mode dvr` is lit [default: phong in `render` and `view`, unless a scene file says otherwise; none in `bench`]
    #[arg(help_heading = heading::LOOK, long, value_enum)]
    lighting: Option<LightingArgument>,
    /// Sampling step in units of the finest voxel size, 0.005 to 16 [default: 1]
    #[arg(help_heading = heading::SAMPLING, long, value_parser = values::step)]
    step: Option<f64>,
    /// Level: auto, or a number (0 is the finest) [default: auto]
    #[arg(help_heading = heading::SAMPLING, long, value_parser = level)]
    level: Option<LevelPolicy>,
    /// Pixels that a voxel may cover before a finer level is wanted [default: 1]
    #[arg(help_heading = heading::SAMPLING, long, value_parser = values::positive)]
    pixel_error: Option<f64>,
}

/// [`Method`] on the command line.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum MethodArgument {
    /// One sample in the middle
    Udvr,
    /// Pre-integrated between the ends
    Pdvr,
    /// Three virtual samples on a line between the ends
    Lvs,
    /// Three virtual samples on a cubic curve
    Cvs,
    /// One to eight samples, as the ends differ
    Asm,
    /// As lvs, pre-integrated
    Plvs,
    /// As cvs, pre-integrated
    Pcvs,
}

impl From<MethodArgument> for Method {
    fn from(method: MethodArgument) -> Self {
        match method {
            MethodArgument::Udvr => Self::Udvr,
            MethodArgument::Pdvr => Self::Pdvr,
            MethodArgument::Lvs => Self::Lvs,
            MethodArgument::Cvs => Self::Cvs,
            MethodArgument::Asm => Self::Asm,
            MethodArgument::Plvs => Self::Plvs,
            MethodArgument::Pcvs => Self::Pcvs,
        }
    }
}

/// [`Filter`] on the command line.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum FilterArgument {
    /// The value of the voxel that a place is in: voxels as they are
    Nearest,
    /// Linear between 8 voxels
    Trilinear,
    /// Cubic B-spline of 64 voxels: smooth, and blurs
    Tricubic,
}

impl From<FilterArgument> for Filter {
    fn from(filter: FilterArgument) -> Self {
        match filter {
            FilterArgument::Nearest => Self::Nearest,
            FilterArgument::Trilinear => Self::Trilinear,
            FilterArgument::Tricubic => Self::Tricubic,
        }
    }
}

/// [`LightingModel`] on the command line.
#[derive(Clone, Copy, Debug, ValueEnum)]
pub(crate) enum LightingArgument {
    /// Colours as they are
    None,
    /// Phong's reflection
    Phong,
    /// Blinn's
    BlinnPhong,
    /// From cool to warm as a place turns to the light
    Tone,
}

impl From<LightingArgument> for LightingModel {
    fn from(model: LightingArgument) -> Self {
        match model {
            LightingArgument::None => Self::None,
            LightingArgument::Phong => Self::Phong,
            LightingArgument::BlinnPhong => Self::BlinnPhong,
            LightingArgument::Tone => Self::Tone,
        }
    }
}

fn level(text: &str) -> Result<LevelPolicy, String> {
    match text {
        "auto" => Ok(LevelPolicy::Auto),
        _ => text.parse().map(LevelPolicy::Locked).map_err(|_| format!("'{text}': expected auto or a level number")),
    }
}

impl SamplingArguments {
    /// The scene, sampled as the flags say.
    pub(crate) fn of(&self, mut scene: Scene) -> Scene {
        scene.sampling.method = self.method.map_or(scene.sampling.method, Method::from);
        scene.sampling.filter = self.filter.map_or(scene.sampling.filter, Filter::from);
        scene.sampling.jitter = self.jitter.unwrap_or(scene.sampling.jitter);
        scene.lighting.model = self.lighting.map_or(scene.lighting.model, LightingModel::from);
        scene.step = self.step.unwrap_or(scene.step);
        scene.level = self.level.unwrap_or(scene.level);
        scene.pixel_error = self.pixel_error.unwrap_or(scene.pixel_error);
        scene
    }
}
