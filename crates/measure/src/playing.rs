//! Measured playback: opens stores, waits for the first view, plays their time steps or jumps among them, and reports the shown steps,
//! their levels and costs.

use crate::flight::FlightError;
use crate::paced_drawing::PacedDrawing;
use crate::processor_time::processor_ms;
use brickyard::backend::Renderer;
use brickyard::memory::ProcessMemory;
use brickyard::pager::{Counters, Playback, Tally};
use brickyard::session::{Frame, ResolvedScene, Session, SessionOptions, VolumeSource};
use brickyard::stats::{ByteCounts, Percentiles, ms};
use brickyard::volume::Scene;
use serde::Serialize;
use std::path::Path;
use std::time::{Duration, Instant};

/// Plan of a playback.
#[derive(Clone, Copy, Debug)]
pub struct PlayPlan<'a> {
    /// The scene; its time step is the first one.
    pub scene: &'a Scene,
    /// Order and rate of steps; `None` jumps in no order, and waits at each step until it is whole.
    pub playback: Option<Playback>,
    /// Steps of the path to play, or jumps.
    pub steps: u32,
    /// Size of the pictures, pixels.
    pub size_px: (u32, u32),
    /// Whether frames are drawn. If not, only streaming is measured: read, decode, assemble, upload, flip.
    pub draws: bool,
    /// Longest frame time; `None` draws all frames exactly.
    pub frame_goal: Option<Duration>,
}

/// Results of a playback.
#[derive(Clone, Debug, Serialize)]
pub struct PlayReport {
    /// Description of the backend, in one line.
    pub adapter: String,
    /// The compositor's name.
    pub compositor: &'static str,
    /// Slots for bricks.
    pub slots: u64,
    /// Duration in seconds.
    pub seconds: f64,
    /// Milliseconds from the beginning until the first step is shown.
    pub start_ms: f64,
    /// Steps shown per second, from the first one on.
    pub steps_per_second: f64,
    /// Shown steps.
    pub shown: u64,
    /// Shown steps that were not whole when due.
    pub late: u64,
    /// Skipped steps.
    pub dropped: u64,
    /// Frames in which some cell had no brick to draw.
    pub uncovered: u32,
    /// Frames in which some brick was of another step than the frame.
    pub mixed: u32,
    /// Drawn frames.
    pub frames: u32,
    /// Mean fraction of an exact frame's work spent on a frame.
    pub quality: f64,
    /// Fractions of the cells at each level when steps were first shown, finest first.
    pub levels: Vec<f64>,
    /// Milliseconds from a jump until the step is shown; zero while playing.
    pub jump_ms: Percentiles,
    /// Milliseconds from a jump until the step is whole; zero while playing.
    pub settle_ms: Percentiles,
    /// Milliseconds of a streaming step on the frame loop's thread: receiving bricks, planning, uploading.
    pub step_ms: Percentiles,
    /// Milliseconds of drawing a frame.
    pub draw_ms: Percentiles,
    /// Processor milliseconds of all threads per shown step.
    pub processor_ms_per_step: f64,
    /// Decoded cores per shown step.
    pub decoded_per_step: f64,
    /// Uploaded bricks per shown step.
    pub uploaded_per_step: f64,
    /// Bricks per shown step neither read nor uploaded, as a slot held the same voxels of another step.
    pub shared_per_step: f64,
    /// Bytes read, decoded and uploaded per shown step.
    pub bytes_per_step: ByteCounts,
    /// Bottleneck of the steps: `drawing`, `processors` (decoding and assembling), `reading`, or `rate` if there is none.
    pub limit: &'static str,
    /// Peak of the backend's accounted bytes.
    pub gpu_bytes_peak: u64,
    /// Peak of the accounted bytes of decoded bricks, staging and scratch.
    pub host_bytes_peak: u64,
    /// Peak anonymous memory of the process, bytes.
    pub anonymous_peak: u64,
}

/// Least time of an undrawn frame: no screen shows more, and each plans anew.
const FRAME_TIME: Duration = Duration::from_millis(2);

/// Longest duration of a playback.
const LONGEST: Duration = Duration::from_secs(600);

/// Opens stores and plays them in one picture.
///
/// # Errors
/// If a store does not open, the session fails, or a step does not come within ten minutes.
pub fn play(stores: &[&Path], plan: &PlayPlan<'_>, options: &SessionOptions) -> Result<PlayReport, FlightError> {
    let open = |store: &&Path| VolumeSource::open(store)?.suited(plan.scene.mode);
    let volumes = stores.iter().map(open).collect::<Result<Vec<_>, _>>()?;
    let mut session = Session::new(volumes, SessionOptions { live: true, ..*options });
    let scene = session.resolve(plan.scene, plan.size_px)?;
    let mut run = Run::new(plan, &mut session);
    run.until(&scene, |frame| frame.status.settled)?;
    run.begin();
    match plan.playback {
        Some(playback) => run.play(&scene, playback)?,
        None => run.jump(&scene)?,
    }
    Ok(run.report(options))
}

/// A playback under measurement.
struct Run<'a> {
    plan: &'a PlayPlan<'a>,
    session: &'a mut Session,
    drawing: PacedDrawing,
    begun: Instant,
    before: Counters,
    last: Counters,
    host_bytes_peak: u64,
    gpu_bytes_peak: u64,
    anonymous_peak: u64,
    /// Step of the last frame.
    shown: u32,
    totals: Totals,
}

/// Sums and lists since the beginning of the measurement.
#[derive(Default)]
struct Totals {
    /// Times of the first and the last shown step.
    flipped: Option<(Instant, Instant)>,
    /// Processor time at the beginning.
    processor_ms: f64,
    flips: u64,
    uncovered: u32,
    mixed: u32,
    quality: f64,
    levels: Vec<u64>,
    jump_ms: Vec<f64>,
    settle_ms: Vec<f64>,
    step_ms: Vec<f64>,
    draw_ms: Vec<f64>,
}

impl<'a> Run<'a> {
    fn new(plan: &'a PlayPlan<'a>, session: &'a mut Session) -> Self {
        Self {
            plan,
            session,
            drawing: PacedDrawing::new(plan.frame_goal),
            begun: Instant::now(),
            before: Counters::default(),
            last: Counters::default(),
            host_bytes_peak: 0,
            gpu_bytes_peak: 0,
            anonymous_peak: 0,
            shown: plan.scene.time,
            totals: Totals::default(),
        }
    }

    /// Begins to measure.
    fn begin(&mut self) {
        (self.begun, self.before) = (Instant::now(), self.last);
        self.totals = Totals { processor_ms: processor_ms(), ..Totals::default() };
    }

    fn play(&mut self, scene: &ResolvedScene, playback: Playback) -> Result<(), FlightError> {
        self.session.play(Some(playback));
        let passed = |tally: Tally| tally.shown + tally.dropped;
        let mut drawn: Option<Frame> = None;
        while passed(self.session.playback_tally()) < u64::from(self.plan.steps) {
            let begun = Instant::now();
            let frame = self.step(scene)?;
            let is_over = self.session.playback().is_none();
            let stands = drawn.as_ref().is_some_and(|drawn| drawn.shows_as_much_as(&frame));
            if !stands {
                self.draw(&frame)?;
                drawn = Some(frame);
            }
            if is_over {
                break;
            }
            self.check_time()?;
            if stands || !self.plan.draws {
                self.session.wait(Duration::from_millis(50));
                std::thread::sleep(FRAME_TIME.saturating_sub(begun.elapsed()));
            }
        }
        self.session.play(None);
        Ok(())
    }

    fn jump(&mut self, scene: &ResolvedScene) -> Result<(), FlightError> {
        let steps = scene.timeline.steps();
        for i in 1..=self.plan.steps {
            // Far from the last one, with earlier steps revisited: the golden ratio of the steps.
            let to = (f64::from(i) * 0.618_033_988_749_895).fract() * f64::from(steps);
            let target = scene.at_step((to as u32).min(steps - 1));
            let begun = Instant::now();
            let mut jump_ms = None;
            let is_shown = |frame: &Frame| frame.scene.time == target.time && frame.status.covered;
            self.until(&target, |frame| {
                if is_shown(frame) && jump_ms.is_none() {
                    jump_ms = Some(ms(begun));
                }
                frame.status.settled
            })?;
            self.totals.jump_ms.extend(jump_ms);
            self.totals.settle_ms.push(ms(begun));
        }
        Ok(())
    }

    /// Streams and draws until a frame satisfies `done`.
    fn until(&mut self, scene: &ResolvedScene, mut done: impl FnMut(&Frame) -> bool) -> Result<(), FlightError> {
        loop {
            let frame = self.step(scene)?;
            // The step before is on the screen already.
            if !self.session.is_seeking() {
                self.draw(&frame)?;
            }
            if done(&frame) {
                return Ok(());
            }
            self.check_time()?;
            if !frame.status.awaits_feedback {
                self.session.wait(Duration::from_millis(50));
            } else if !self.plan.draws {
                // Feedback on visibility is needed once.
                self.session.draw(&frame)?;
            }
        }
    }

    fn check_time(&self) -> Result<(), FlightError> {
        if self.begun.elapsed() > LONGEST { Err(FlightError::NotSettled(LONGEST.as_secs_f64())) } else { Ok(()) }
    }

    fn step(&mut self, scene: &ResolvedScene) -> Result<Frame, FlightError> {
        let begun = Instant::now();
        let frame = self.session.step_resolved(scene)?;
        self.totals.step_ms.push(ms(begun));
        let is_flip = frame.scene.time != self.shown;
        (self.shown, self.last) = (frame.scene.time, frame.status.counters);
        self.totals.uncovered += !frame.status.covered as u32;
        self.host_bytes_peak = frame.status.host_bytes_peak;
        let of_layers = frame.scene.layers.iter().map(|layer| layer.view.time);
        let mut mixed = false;
        for (list, time) in self.session.draw_lists().zip(of_layers) {
            for cell in &list.cells {
                mixed |= cell.brick.time != time;
                let level = cell.brick.level.index();
                if self.totals.levels.len() <= level {
                    self.totals.levels.resize(level + 1, 0);
                }
                self.totals.levels[level] += is_flip as u64;
            }
        }
        self.totals.mixed += mixed as u32;
        if is_flip {
            self.totals.flips += 1;
            let now = Instant::now();
            self.totals.flipped = Some((self.totals.flipped.map_or(now, |(first, _)| first), now));
            self.gpu_bytes_peak = self.gpu_bytes_peak.max(self.session.backend_bytes());
            self.anonymous_peak = self.anonymous_peak.max(ProcessMemory::now().anonymous_bytes);
        }
        Ok(frame)
    }

    fn draw(&mut self, frame: &Frame) -> Result<(), FlightError> {
        if !self.plan.draws {
            return Ok(());
        }
        let begun = Instant::now();
        let quality = self.drawing.draw(self.session, frame)?;
        self.totals.draw_ms.push(ms(begun));
        self.totals.quality += quality.share();
        Ok(())
    }

    fn report(&self, options: &SessionOptions) -> PlayReport {
        let seconds = self.begun.elapsed().as_secs_f64();
        let processor_ms = processor_ms() - self.totals.processor_ms;
        let Tally { late, dropped, .. } = self.session.playback_tally();
        let shown = self.totals.flips;
        let per_step = |total: f64| total / shown.max(1) as f64;
        let grown = |of: fn(&Counters) -> u64| of(&self.last) - of(&self.before);
        let bytes = |of: fn(&Counters) -> u64| per_step(grown(of) as f64) as u64;
        let cells: u64 = self.totals.levels.iter().sum();
        let draw_share = self.totals.draw_ms.iter().sum::<f64>() / (seconds * 1e3);
        let processor_share = processor_ms / (seconds * 1e3 * options.threads.max(1) as f64);
        let asked = self.plan.playback.map_or(f64::INFINITY, |playback| playback.steps_per_second);
        let (first, last) = self.totals.flipped.unwrap_or((self.begun, self.begun));
        let steps_per_second = shown.saturating_sub(1) as f64 / (last - first).as_secs_f64().max(1e-9);
        PlayReport {
            adapter: self.session.backend_line().into(),
            compositor: self.session.backend().map_or("", Renderer::compositor),
            slots: self.session.slots(),
            seconds,
            start_ms: (first - self.begun).as_secs_f64() * 1e3,
            steps_per_second,
            shown,
            late,
            dropped,
            uncovered: self.totals.uncovered,
            mixed: self.totals.mixed,
            frames: self.totals.draw_ms.len() as u32,
            quality: self.totals.quality / self.totals.draw_ms.len().max(1) as f64,
            levels: self.totals.levels.iter().map(|count| *count as f64 / cells.max(1) as f64).collect(),
            jump_ms: Percentiles::of(&self.totals.jump_ms),
            settle_ms: Percentiles::of(&self.totals.settle_ms),
            step_ms: Percentiles::of(&self.totals.step_ms),
            draw_ms: Percentiles::of(&self.totals.draw_ms),
            processor_ms_per_step: per_step(processor_ms),
            decoded_per_step: per_step(grown(|counters| counters.decoded) as f64),
            shared_per_step: per_step(grown(|counters| counters.shared) as f64),
            uploaded_per_step: per_step(grown(|counters| counters.uploaded) as f64),
            bytes_per_step: ByteCounts {
                read: bytes(|counters| counters.bytes_read),
                decoded: bytes(|counters| counters.bytes_decoded),
                uploaded: bytes(|counters| counters.bytes_uploaded),
            },
            limit: match () {
                () if steps_per_second >= 0.95 * asked => "rate",
                () if draw_share > 0.6 => "drawing",
                () if processor_share > 0.7 => "processors",
                () => "reading",
            },
            gpu_bytes_peak: self.gpu_bytes_peak,
            host_bytes_peak: self.host_bytes_peak,
            anonymous_peak: self.anonymous_peak,
        }
    }
}
