//! Quality control for moving cameras: how many pixels and steps a frame may take to meet a time goal, and when to draw
//! at all.
//!
//! The model: a frame's time is proportional to its work, pixels over step length. The controller keeps one number, the
//! share of the exact frame's work that fits the goal, corrected after every frame. The share is spent on pixels first,
//! down to half as many along an axis, and then on pixels and steps: long steps cut opaque surfaces to terraces and
//! save little there, since rays end at the surface (`docs/performance.md` has the pictures' errors). When the camera
//! rests, the next frame is exact, preceded by one of a sixteenth of its work if it takes long and somebody watches; it
//! is drawn again as bricks arrive, and then not until something changes. The first picture is the fastest possible:
//! the scene is unknown, and somebody waits. Pure: it neither measures nor draws.

use crate::session::frame::Frame;
use crate::session::resolve::MAX_STEP;
use brickyard_volume::FrameSettings;
use std::sync::Arc;
use std::time::Duration;

/// The quality of a frame: its resolution and its step length, relative to the exact frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quality {
    /// Share of the exact frame's pixels along an axis, above 0 and at most 1.
    pub scale: f64,
    /// Length of a step in steps of the exact frame, 1 or more.
    pub step: f64,
}

impl Quality {
    /// The quality of the exact frame: every pixel, every step.
    pub const EXACT: Self = Self { scale: 1.0, step: 1.0 };

    /// Spends a share of the exact frame's work: on pixels alone down to [`HALF_SCALE`], then equally on fewer pixels
    /// and longer steps.
    fn of_share(share: f64) -> Self {
        let below = (share / (HALF_SCALE * HALF_SCALE)).min(1.0);
        let step = below.powf(-0.5).clamp(1.0, MAX_STEP);
        Self { scale: (share * step).sqrt().clamp(MIN_SCALE, 1.0), step }
    }

    /// Returns the quality of the next picture at rest, for onlookers of a slow exact one: a sixteenth of the work
    /// after a much coarser picture, otherwise exact.
    fn refined(self) -> Self {
        if self.share() < REFINED_FROM { Self::of_share(REFINED_SHARE) } else { Self::EXACT }
    }

    /// Levels by which bricks may be coarser while a voxel stays as large beside this quality's pixels as beside the
    /// exact frame's.
    fn level_bias(self) -> f64 {
        self.scale.recip().log2().floor()
    }

    /// Returns this quality's share of the exact frame's work, above 0 and at most 1.
    pub fn share(self) -> f64 {
        self.scale * self.scale / self.step
    }

    /// Returns this quality for bricks `level_bias` levels coarser: with steps of at least one of their voxels.
    pub fn with_coarse_bricks(self, level_bias: f64) -> Self {
        Self { step: self.step.max(level_bias.exp2()), ..self }
    }

    /// Returns the settings of a frame of this quality: the same view as the exact frame, with fewer pixels (to be
    /// stretched over the window) and longer steps. Bricks are still streamed for the exact frame.
    pub fn settings(self, exact: &FrameSettings) -> FrameSettings {
        let mut frame = exact.clone();
        let pixels = |exact: u32| ((exact as f64 * self.scale).round() as u32).max(1);
        (frame.rays.width, frame.rays.height) = (pixels(exact.rays.width), pixels(exact.rays.height));
        frame.lattice = exact.lattice.with_longer_steps(self.step);
        frame
    }

    /// Returns a session's frame at this quality, for drawing in place of the exact one.
    pub fn frame(self, exact: &Frame) -> Frame {
        let mut drawn = exact.clone();
        for frame in Arc::make_mut(&mut drawn.scene).layers.iter_mut().flat_map(|layer| &mut layer.frames) {
            frame.settings = self.settings(&frame.settings);
        }
        drawn
    }
}

/// The least share of the pixels along an axis with the exact frame's steps.
const HALF_SCALE: f64 = 0.5;
/// The least share of the pixels along an axis: a twelfth is still enough to steer by.
const MIN_SCALE: f64 = 1.0 / 12.0;
/// Work of the intermediate picture, as a share of the exact one's, and the share below which a picture is coarse
/// enough to need it.
const REFINED_SHARE: f64 = 1.0 / 16.0;
const REFINED_FROM: f64 = 0.4 * REFINED_SHARE;

/// Weight of a frame's measured time: a greater one makes the picture flicker between qualities, a smaller one lags
/// behind.
const TRUST: f64 = 0.5;
/// Differences below a tenth are not worth a change of resolution.
const DEAD_BAND: f64 = 0.1;

/// Returns the drawing time within a frame of `goal`, after `besides` for everything else. During playback, frames
/// slightly shorter than a whole number of time steps show the same number of steps each. At least half of the frame is
/// left for drawing.
pub(crate) fn drawing_time(goal: Duration, steps_per_second: Option<f64>, besides: Duration) -> Duration {
    let in_step = |rate: f64| {
        let steps = (goal.as_secs_f64() * rate).floor().max(1.0);
        goal.as_secs_f64().min(IN_STEP * steps / rate)
    };
    let frame = steps_per_second.map_or(goal, |rate| Duration::from_secs_f64(in_step(rate)));
    frame.saturating_sub(besides).max(frame / 2)
}

/// Share of the available time for frames in step with playback: frame times vary by a tenth.
const IN_STEP: f64 = 0.9;

/// Changes since the last frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Change {
    /// Whether the camera, the transfer function or the mode has changed since the last frame.
    pub moved: bool,
    /// Whether bricks have arrived since the last frame, or are fading in.
    pub refined: bool,
}

/// Chooses the quality of every frame, to meet a time goal while the camera moves.
#[derive(Clone, Debug)]
pub struct QualityControl {
    goal_ms: f64,
    /// The share of the exact frame's work that fits the goal.
    share: f64,
    /// The quality of the last frame; `None` before the first.
    last: Option<Quality>,
}

impl QualityControl {
    /// Creates a control for frames of at most `goal` while the camera moves.
    pub fn new(goal: Duration) -> Self {
        Self { goal_ms: goal.as_secs_f64() * 1e3, share: MIN_SHARE, last: None }
    }

    /// Sets the time goal of later frames. Measurements of the scene still count; a change of less than a tenth has no
    /// effect.
    pub fn set_goal(&mut self, goal: Duration) {
        let goal_ms = goal.as_secs_f64() * 1e3;
        let change = goal_ms / self.goal_ms;
        if (change - 1.0).abs() > DEAD_BAND {
            self.goal_ms = goal_ms;
            self.share = (self.share * change).clamp(MIN_SHARE, 1.0);
        }
    }

    /// The share of the exact frame's work that fits the goal, above 0 and at most 1.
    pub fn share(&self) -> f64 {
        self.share
    }

    /// Levels by which the bricks of a moving view's next frame may be coarser: see
    /// [`Session::step_coarse`](crate::Session::step_coarse).
    pub fn level_bias(&self) -> f64 {
        Quality::of_share(self.share).level_bias()
    }

    /// Returns the quality of the next frame; `None` if the last one is still valid.
    pub fn next(&mut self, change: Change) -> Option<Quality> {
        let stands = self.last == Some(Quality::EXACT) && !change.refined;
        let quality = match change.moved {
            true => Quality::of_share(self.share),
            false if stands => return None,
            false => Quality::EXACT,
        };
        self.last = Some(quality);
        Some(quality)
    }

    /// Returns the quality of a resting view's next frame, after the shown one.
    pub fn refine(&mut self, shown: Quality) -> Quality {
        let quality = shown.refined();
        self.last = Some(quality);
        quality
    }

    /// Records the drawing time of the last frame. Exact frames count too: they show the cost of the whole work.
    pub fn took(&mut self, time: Duration) {
        let Some(last) = self.last else { return };
        let ms = (time.as_secs_f64() * 1e3).max(1e-3);
        let fits = (last.share() * self.goal_ms / ms).min(1.0);
        let is_close = (fits / self.share - 1.0).abs() <= DEAD_BAND;
        if is_close && fits == 1.0 {
            self.share = 1.0;
        } else if !is_close {
            self.share = (self.share.powf(1.0 - TRUST) * fits.powf(TRUST)).clamp(MIN_SHARE, 1.0);
        }
    }
}

/// The share of work of the least quality.
const MIN_SHARE: f64 = MIN_SCALE * MIN_SCALE / MAX_STEP;

#[cfg(test)]
mod tests {
    use super::*;
    use brickyard_volume::{
        Camera, Geometry, Lattice, Lighting, Mode, Placement, Projection, Sampling, SlotEncoding, TransferFunction,
        TransferTable, VoxelType,
    };
    use glam::DVec3;

    const MOVING: Change = Change { moved: true, refined: false };
    const RESTING: Change = Change { moved: false, refined: false };

    fn ms(ms: f64) -> Duration {
        Duration::from_secs_f64(ms / 1e3)
    }

    /// Returns frame times of a flight over scenes with exact frames of this length, plus 5 ms at any quality.
    fn fly(control: &mut QualityControl, exact_ms: impl Fn(usize) -> f64, frames: usize) -> Vec<(Quality, f64)> {
        let frame = |i| {
            let quality = control.next(MOVING).expect("a moving camera needs frames");
            let took = 5.0 + exact_ms(i) * quality.share();
            control.took(ms(took));
            (quality, took)
        };
        (0..frames).map(frame).collect()
    }

    #[test]
    fn what_fits_is_exact() {
        let mut control = QualityControl::new(ms(100.0));
        let flight = fly(&mut control, |_| 90.0, 50);
        assert_eq!(flight[0].0.share(), MIN_SHARE, "the first picture is the fastest");
        assert!(flight[10..].iter().all(|(quality, _)| *quality == Quality::EXACT), "{flight:?}");
    }

    #[test]
    fn slow_scenes_reach_the_goal_and_stay_there() {
        for exact_ms in [150.0, 400.0, 2000.0] {
            let mut control = QualityControl::new(ms(50.0));
            let flight = fly(&mut control, |_| exact_ms, 60);
            for (quality, took) in &flight[8..] {
                assert!((0.7..1.2).contains(&(took / 50.0)), "{exact_ms}: {took} ms with {quality:?}");
            }
            // Settled: no flicker.
            assert!(flight[30..].iter().all(|(quality, _)| *quality == flight[30].0), "{exact_ms}");
        }
    }

    #[test]
    fn it_follows_scenes_that_change() {
        let mut control = QualityControl::new(ms(50.0));
        // Fast, then slow, then fast.
        let flight = fly(&mut control, |i| if (20..40).contains(&i) { 800.0 } else { 30.0 }, 60);
        assert!(flight[10..20].iter().all(|(quality, _)| *quality == Quality::EXACT));
        assert!(flight[30..40].iter().all(|(_, took)| *took < 60.0));
        assert_eq!(flight[59].0, Quality::EXACT);
    }

    #[test]
    fn a_coarser_frame_is_of_the_same_view() {
        let projection = Projection::Perspective { fov_y_deg: 40.0 };
        let camera = Camera { eye: DVec3::ZERO, target: DVec3::X, up: DVec3::Z, projection };
        let rays = camera.rays(200, 101).expect("a camera");
        let encoding = SlotEncoding::new(VoxelType::U8, (0.0, 1.0), false);
        let transfer = TransferFunction::preset("gray", (0.0, 255.0), 1.0).expect("a preset");
        let exact = FrameSettings {
            rays,
            lattice: Lattice::for_view(0.1, 0.1, &rays, 1.0, 5),
            geometry: Geometry::default(),
            placement: Placement::default(),
            encoding,
            table: TransferTable::new(&transfer, &encoding).into(),
            mode: Mode::Dvr,
            surfaces: Vec::new(),
            sampling: Sampling::default(),
            lighting: Lighting::default(),
            background: [0.0; 3],
            clip: None,
            meshes: Vec::new(),
            caps: false,
            keeps_extremes: false,
        };
        let coarse = Quality { scale: 0.5, step: 3.0 }.settings(&exact);
        assert_eq!((coarse.rays.width, coarse.rays.height), (100, 51));
        assert_eq!((coarse.rays.right, coarse.rays.up), (exact.rays.right, exact.rays.up));
        assert_eq!(coarse.lattice.step, exact.lattice.step * 3.0);
        assert_eq!(Quality::EXACT.settings(&exact).lattice, exact.lattice);
    }

    #[test]
    fn coarse_frames_have_coarse_bricks() {
        for (scale, levels) in [(1.0, 0.0), (0.6, 0.0), (0.5, 1.0), (0.26, 1.0), (0.25, 2.0), (0.125, 3.0)] {
            assert_eq!(Quality { scale, step: 1.0 }.level_bias(), levels, "{scale}");
        }
        assert_eq!(QualityControl::new(ms(50.0)).level_bias(), 3.0, "the first picture is the fastest");
    }

    #[test]
    fn there_is_a_least_quality() {
        let mut control = QualityControl::new(ms(1.0));
        let (quality, _) = fly(&mut control, |_| 1e6, 50)[49];
        assert_eq!(quality, Quality { scale: MIN_SCALE, step: MAX_STEP });
        assert!((quality.share() - MIN_SHARE).abs() < 1e-12);
    }

    #[test]
    fn another_goal_is_met_at_once() {
        let mut control = QualityControl::new(ms(50.0));
        fly(&mut control, |_| 500.0, 20);
        for goal in [30.0, 31.0, 80.0] {
            control.set_goal(ms(goal));
            let (_, took) = fly(&mut control, |_| 500.0, 1)[0];
            assert!((0.7..1.2).contains(&(took / goal)), "{goal}: {took}");
        }
    }

    #[test]
    fn frames_keep_in_step_with_what_is_played() {
        let time =
            |goal, period: Option<f64>| drawing_time(ms(goal), period.map(|ms| 1e3 / ms), ms(4.0)).as_secs_f64() * 1e3;
        let is_near = |a: f64, b: f64| (a - b).abs() < 1e-3;
        assert!(is_near(time(50.0, None), 46.0) && is_near(time(50.0, Some(100.0)), 46.0));
        assert!(is_near(time(50.0, Some(40.0)), 32.0) && is_near(time(37.0, Some(40.0)), 32.0));
        assert!(is_near(time(50.0, Some(20.0)), 32.0), "each frame shows a second step");
        assert!(is_near(time(50.0, Some(5.0)), 41.0));
        assert!(is_near(time(6.0, None), 3.0), "half of a frame is drawing");
        // Periods without end, and without length.
        assert!(is_near(time(50.0, Some(1e303)), 46.0) && is_near(time(50.0, Some(1e-297)), 41.0));
    }

    #[test]
    fn slow_pictures_are_refined_in_between() {
        for (exact_ms, qualities) in [(100.0, 1), (900.0, 1), (3e3, 2), (4e4, 2)] {
            let mut control = QualityControl::new(ms(50.0));
            let mut shown = fly(&mut control, |_| exact_ms, 40)[39].0;
            let (mut count, mut work) = (0, 0.0);
            while shown != Quality::EXACT {
                let finer = control.refine(shown);
                assert!(finer.share() > 2.0 * shown.share() || finer == Quality::EXACT);
                (shown, count, work) = (finer, count + 1, work + finer.share());
            }
            assert_eq!(count, qualities, "{exact_ms}");
            assert!(work <= 1.07, "{exact_ms}: {work} of the exact picture's work");
        }
    }

    #[test]
    fn a_resting_camera_gets_the_exact_frame_once() {
        let mut control = QualityControl::new(ms(50.0));
        fly(&mut control, |_| 500.0, 20);
        assert_ne!(control.next(MOVING), Some(Quality::EXACT));
        assert_eq!(control.next(RESTING), Some(Quality::EXACT));
        control.took(ms(505.0));
        assert_eq!(control.next(RESTING), None, "nothing is drawn where nothing changes");
        assert_eq!(control.next(Change { moved: false, refined: true }), Some(Quality::EXACT));
        assert_eq!(control.next(RESTING), None);
        // The measurements of moving frames still count.
        let quality = control.next(MOVING).expect("a frame");
        assert!((5.0 + 500.0 * quality.share()) / 50.0 < 1.2, "{quality:?}");
    }
}
