//! Survey of sampling methods: picture quality and drawing time, by the method of Gavrilov, Turlapov and others, "Measuring the
//! quality of volume rendering" (2013).
//!
//! Each combination of settings draws one view several times, with different [jitter](brickyard::volume::jitter), from which
//! [`noise`] derives an error. A second figure is the distance from a reference, the "truth": the mean of a series pre-integrated at
//! twice the highest rate, or without pre-integration plain at eight times that rate. The volume is drawn from level 0, on the CPU,
//! and wholly resident while frames are timed. [`findings`] compares the figures with the paper's, and [`plot`] draws them as
//! curves.

pub mod findings;
pub mod noise;
pub mod plot;

use crate::processor_time::processor_ms;
use brickyard::offline::{OfflineError, render_settled};
use brickyard::session::{ResolvedScene, Session, SessionError, SessionOptions, VolumeSource};
use brickyard::stats::{Percentiles, RenderStats, ms};
use brickyard::volume::sampling::VIRTUAL_SAMPLES;
use brickyard::volume::{Filter, Jitter, LevelPolicy, LightingModel, Method, Picture, Sampling, Scene};
use noise::{ColorSpace, Series, Truth};
use serde::Serialize;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Method of the truth, and its multiple of the highest rate: pre-integrated, unless the transfer function is one of value and
/// gradient.
const TRUTH: (Method, f64) = (Method::Pdvr, 2.0);
const TRUTH_BY_GRADIENT: (Method, f64) = (Method::Udvr, 8.0);

/// Plan of a survey.
pub struct SurveyPlan<'a> {
    /// The scene. The survey sets its method, filter, lighting model, jitter, step and level.
    pub scene: &'a Scene,
    /// Size of the pictures, pixels.
    pub size_px: (u32, u32),
    /// Compared sampling methods.
    pub methods: Vec<Method>,
    /// Compared numbers of virtual samples per segment, where the method has any.
    pub virtual_samples: Vec<u8>,
    /// Compared filters.
    pub filters: Vec<Filter>,
    /// Compared lighting models.
    pub lightings: Vec<LightingModel>,
    /// Compared sampling rates, segments per voxel: at least one, all positive.
    pub samples_per_voxel: Vec<f64>,
    /// Pictures in a series, at least two.
    pub frames: u32,
    /// Longest wait of one series for its bricks.
    pub max_wait: Duration,
}

/// Results of one combination at one rate.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Sampling method: how ray segments become media.
    pub method: Method,
    /// Virtual samples per segment; `None` for methods without.
    pub virtual_samples: Option<u8>,
    /// Interpolation filter.
    pub filter: Filter,
    /// Lighting model.
    pub lighting: LightingModel,
    /// Sampling rate, segments per voxel.
    pub samples_per_voxel: f64,
    /// Pixels that show the volume.
    pub pixels: usize,
    /// Signal-to-noise ratio by the variance of RGB, dB; infinite (`null` in JSON) if no pixel varies.
    pub rgb_db: f64,
    /// The same by the variance of YCbCr.
    pub ycbcr_db: f64,
    /// The same by the variance of HSL.
    pub hsl_db: f64,
    /// Signal-to-noise ratio against the truth, dB.
    pub truth_db: f64,
    /// Fraction of pixels with a noticeable colour difference from the truth, 0 to 1: see [`noise::NOTICED`].
    pub noticed: f64,
    /// Median frame time, milliseconds.
    pub frame_ms: f64,
    /// Least processor time of a frame over all threads, milliseconds: the figure for curves, least affected by other work on the
    /// machine.
    pub cpu_ms: f64,
}

impl Row {
    /// Whether the row has the default number of virtual samples, or none.
    pub fn is_usual(&self) -> bool {
        self.virtual_samples.is_none_or(|count| count == VIRTUAL_SAMPLES)
    }
}

/// Items without repetition, in the order of their first appearance.
fn distinct<T: PartialEq>(items: impl Iterator<Item = T>) -> Vec<T> {
    let mut found = Vec::new();
    for item in items {
        if !found.contains(&item) {
            found.push(item);
        }
    }
    found
}

/// Error that ends a survey.
#[derive(Debug, thiserror::Error)]
pub enum SurveyError {
    /// A picture could not be drawn.
    #[error(transparent)]
    Picture(#[from] OfflineError),
    /// Not all bricks of level 0 are resident, so coarser ones would be measured.
    #[error("{resident} of {wanted} bricks of level 0 are there, and the survey is about level 0")]
    Coarse {
        /// Resident ones among the wanted bricks.
        resident: u64,
        /// Wanted bricks of the view.
        wanted: u64,
    },
}

impl From<SessionError> for SurveyError {
    fn from(error: SessionError) -> Self {
        Self::Picture(error.into())
    }
}

/// Measures a whole plan, and calls `found` with each row and its series. `options` are those of the sessions, which must draw on
/// the CPU for meaningful times.
///
/// # Errors
/// If a picture cannot be drawn from level 0, or `found` fails.
pub fn survey<E: From<SurveyError>>(
    volume: &VolumeSource,
    plan: &SurveyPlan<'_>,
    options: &SessionOptions,
    mut found: impl FnMut(Row, &Series) -> Result<(), E>,
) -> Result<(), E> {
    let highest = plan.samples_per_voxel.iter().copied().fold(0.0, f64::max);
    let (method, times) = if plan.scene.is_by_gradient() { TRUTH_BY_GRADIENT } else { TRUTH };
    for &lighting in &plan.lightings {
        for &filter in &plan.filters {
            let stage = |sampling| Stage::new(volume, plan, options, sampling, lighting);
            let truth = Sampling { method, filter, ..Sampling::default() };
            let truth = stage(truth)?.shoot(highest * times)?.series.mean();
            for sampling in plan.samplings(filter) {
                let mut stage = stage(sampling)?;
                for &rate in &plan.samples_per_voxel {
                    let shots = stage.shoot(rate)?;
                    found(shots.row(sampling, lighting, rate, &truth), &shots.series)?;
                }
            }
        }
    }
    Ok(())
}

impl SurveyPlan<'_> {
    /// All sampling settings with a filter.
    fn samplings(&self, filter: Filter) -> Vec<Sampling> {
        let mut all = Vec::new();
        for &method in &self.methods {
            let counts = if method.has_virtual_samples() { &self.virtual_samples[..] } else { &[VIRTUAL_SAMPLES] };
            let with = |&virtual_samples| Sampling { method, virtual_samples, filter, ..Sampling::default() };
            all.extend(counts.iter().map(with));
        }
        all
    }
}

/// Session for one sampling setting.
struct Stage<'a> {
    plan: &'a SurveyPlan<'a>,
    scene: Scene,
    session: Session,
}

/// A series with its times, milliseconds.
struct Shots {
    series: Series,
    frame_ms: Vec<f64>,
    cpu_ms: Vec<f64>,
}

impl<'a> Stage<'a> {
    fn new(
        volume: &VolumeSource,
        plan: &'a SurveyPlan<'a>,
        options: &SessionOptions,
        sampling: Sampling,
        lighting: LightingModel,
    ) -> Result<Self, SurveyError> {
        let mut scene = Scene { level: LevelPolicy::Locked(0), ..plan.scene.clone() };
        scene.sampling = sampling;
        scene.lighting.model = lighting;
        if lighting == LightingModel::None {
            scene.lighting.lights.clear();
        }
        Ok(Self { plan, session: Session::new(vec![volume.clone()], *options), scene })
    }

    fn shoot(&mut self, rate: f64) -> Result<Shots, SurveyError> {
        self.scene.step = 1.0 / rate;
        let resolved = self.session.resolve(&self.scene, self.plan.size_px)?;
        self.settle(&resolved)?;
        let mut frame = self.session.step_resolved(&resolved)?;
        let (mut pictures, mut frame_ms, mut cpu_ms) = (Vec::new(), Vec::new(), Vec::new());
        for seed in 0..self.plan.frames {
            let drawn = Arc::make_mut(&mut frame.scene).layers.iter_mut().flat_map(|layer| &mut layer.frames);
            drawn.for_each(|drawn| drawn.settings.sampling.jitter = Jitter::White(seed));
            let (begun, cpu_begun) = (Instant::now(), processor_ms());
            pictures.push(self.session.draw(&frame)?);
            frame_ms.push(ms(begun));
            cpu_ms.push(processor_ms() - cpu_begun);
        }
        let background = Picture::quantise(resolved.layers[0].frames[0].settings.background);
        Ok(Shots { series: Series::new(pictures, background), frame_ms, cpu_ms })
    }

    /// Streams, and draws once, unmeasured.
    fn settle(&mut self, resolved: &ResolvedScene) -> Result<(), SurveyError> {
        let mut stats = RenderStats::default();
        render_settled(&mut self.session, resolved, self.plan.max_wait, Instant::now(), &mut stats, &mut Vec::new())?;
        match stats.bricks {
            bricks if bricks.resident < bricks.wanted || stats.memory_bound || bricks.failed > 0 => {
                Err(SurveyError::Coarse { resident: bricks.resident, wanted: bricks.wanted })
            }
            _ => Ok(()),
        }
    }
}

impl Shots {
    fn row(&self, sampling: Sampling, lighting: LightingModel, rate: f64, truth: &Truth) -> Row {
        let Self { series, frame_ms, cpu_ms } = self;
        let Sampling { method, virtual_samples, filter, .. } = sampling;
        Row {
            method,
            virtual_samples: method.has_virtual_samples().then_some(virtual_samples),
            filter,
            lighting,
            samples_per_voxel: rate,
            pixels: series.shown(),
            rgb_db: series.psnr_db(ColorSpace::Rgb),
            ycbcr_db: series.psnr_db(ColorSpace::YCbCr),
            hsl_db: series.psnr_db(ColorSpace::Hsl),
            truth_db: series.psnr_against_db(truth),
            noticed: series.noticed(truth),
            frame_ms: Percentiles::of(frame_ms).p50,
            cpu_ms: cpu_ms.iter().copied().fold(f64::INFINITY, f64::min),
        }
    }
}
