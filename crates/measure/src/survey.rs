//! A survey of sampling methods: how good their pictures are and how long they take, by the method of Gavrilov, Turlapov and
//! others, "Measuring the quality of volume rendering" (2013).
//!
//! Each way to sample draws one view some times over, each time with other [jitter](brickyard::volume::jitter); [`noise`] makes
//! an error of that. A second figure is the distance from what is taken for the truth: the mean of a series that is
//! pre-integrated at twice the highest rate, or where there is no pre-integration plain at eight times that. The volume is
//! drawn from level 0, on the CPU, and is wholly resident while frames are timed. [`findings`] holds the figures against what
//! the paper found, and [`plot`] draws them as curves.

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

/// How the truth is sampled, and at how many times the highest rate: by what integrates over values, unless the transfer function is
/// one of value and gradient.
const TRUTH: (Method, f64) = (Method::Pdvr, 2.0);
const TRUTH_BY_GRADIENT: (Method, f64) = (Method::Udvr, 8.0);

/// What a survey measures.
pub struct SurveyPlan<'a> {
    /// The scene that is drawn. The survey sets its method, filter, lighting model, jitter, step and level.
    pub scene: &'a Scene,
    /// Size of the pictures, pixels.
    pub size_px: (u32, u32),
    /// The sampling methods to compare.
    pub methods: Vec<Method>,
    /// The numbers of virtual samples per segment to compare, for methods that have some.
    pub virtual_samples: Vec<u8>,
    /// The filters to compare.
    pub filters: Vec<Filter>,
    /// The lighting models to compare.
    pub lightings: Vec<LightingModel>,
    /// The sampling rates to compare, segments per voxel: at least one, all positive.
    pub samples_per_voxel: Vec<f64>,
    /// Number of pictures in a series, at least two.
    pub frames: u32,
    /// How long one series may wait for its bricks.
    pub max_wait: Duration,
}

/// What was found of one way to sample at one rate.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// The sampling method: how ray segments become media.
    pub method: Method,
    /// Number of virtual samples per segment; `None` if the method has none.
    pub virtual_samples: Option<u8>,
    /// The filter: how the field is made of voxels.
    pub filter: Filter,
    /// The lighting model.
    pub lighting: LightingModel,
    /// The sampling rate, segments per voxel.
    pub samples_per_voxel: f64,
    /// Number of pixels that show the volume.
    pub pixels: usize,
    /// Signal-to-noise ratio by the variance of RGB, dB; infinite (`null` in JSON) if no pixel varies.
    pub rgb_db: f64,
    /// Signal-to-noise ratio by the variance of YCbCr, dB; infinite (`null` in JSON) if no pixel varies.
    pub ycbcr_db: f64,
    /// Signal-to-noise ratio by the variance of HSL, dB; infinite (`null` in JSON) if no pixel varies.
    pub hsl_db: f64,
    /// Signal-to-noise ratio against the picture that is taken for the truth, dB.
    pub truth_db: f64,
    /// Share of the pixels whose colour differs noticeably from the truth's, 0 to 1: see [`noise::NOTICED`].
    pub noticed: f64,
    /// Median time of a frame, milliseconds.
    pub frame_ms: f64,
    /// Least processor time of a frame, all threads together, milliseconds. Curves show this time, since other work on
    /// the machine affects it least.
    pub cpu_ms: f64,
}

impl Row {
    /// Whether the row has the default number of virtual samples, or none.
    pub fn is_usual(&self) -> bool {
        self.virtual_samples.is_none_or(|count| count == VIRTUAL_SAMPLES)
    }
}

/// A survey that cannot go on.
#[derive(Debug, thiserror::Error)]
pub enum SurveyError {
    /// A picture could not be drawn.
    #[error(transparent)]
    Picture(#[from] OfflineError),
    /// Not all bricks of level 0 are resident, so pictures of coarser bricks would be measured.
    #[error("{resident} of {wanted} bricks of level 0 are there, and the survey is about level 0")]
    Coarse {
        /// Number of wanted bricks that are resident.
        resident: u64,
        /// Number of bricks that the view wants.
        wanted: u64,
    },
}

impl From<SessionError> for SurveyError {
    fn from(error: SessionError) -> Self {
        Self::Picture(error.into())
    }
}

/// Measures everything that a plan asks for, and calls `found` with each row and its series of pictures. `options` are
/// those of the sessions, which have to draw on the CPU for their times to be meaningful.
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
    /// All ways to sample with a filter.
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

/// A session for one way to sample.
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

    /// Streams, and draws once: nothing of that is measured.
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
