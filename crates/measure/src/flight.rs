//! Measured flight: opens a store, waits for the first view, flies a scenario frame by frame at full speed, and reports
//! the costs. Every frame is checked against the budgets and for completeness.

use crate::paced_drawing::PacedDrawing;
use crate::scenario::{Scenario, Setting};
use brickyard::backend::Renderer;
use brickyard::memory::ProcessMemory;
use brickyard::pager::Status;
use brickyard::session::{Frame, ResolvedScene, Session, SessionError, SessionOptions, VolumeSource};
use brickyard::stats::{BrickCounts, ByteCounts, Percentiles, ms};
use brickyard::store::OpenError;
use brickyard::volume::Scene;
use serde::Serialize;
use std::path::Path;
use std::time::{Duration, Instant};

/// Results of a flight.
#[derive(Clone, Debug, Serialize)]
pub struct FlightReport {
    /// The flown scenario.
    pub scenario: Scenario,
    /// Description of the backend, in one line.
    pub adapter: String,
    /// The compositor's name: `sorted`, `raycast` or `compute`.
    pub compositor: &'static str,
    /// Slots for bricks.
    pub slots: u64,
    /// Milliseconds from the start to a session ready for frames.
    pub open_ms: f64,
    /// Milliseconds from the start until the first complete picture was drawn.
    pub first_picture_ms: f64,
    /// Milliseconds from the start until nothing was missing from the first view.
    pub settled_ms: f64,
    /// Frames of the flight.
    pub frames: u32,
    /// Milliseconds of a frame: receiving bricks, planning, uploading, drawing.
    pub frame_ms: Percentiles,
    /// Milliseconds of a frame before drawing: receiving bricks, planning, uploading.
    pub step_ms: Percentiles,
    /// Mean fraction of an exact frame's work (pixels over step length) spent on a frame; 1 if all were exact.
    pub quality: f64,
    /// Milliseconds from the last frame until nothing was missing and any frame goal's exact picture was drawn.
    pub settle_after_ms: f64,
    /// Frames in which some cell had no brick at all to draw.
    pub uncovered_frames: u32,
    /// Frames after which the accounted memory exceeded a budget.
    pub frames_over_budget: u32,
    /// Mean fraction of the screen drawn at the view's level, 0 to 1.
    pub completeness: f64,
    /// Bricks: uploads during the flight, without the first view, and all other counts at its end.
    pub bricks: BrickCounts,
    /// Uploads during the flight of bricks not yet wanted by any view.
    pub uploaded_ahead: u64,
    /// Cores decoded during the flight. Stored aprons count in [`Self::bytes`] alone.
    pub bricks_decoded: u64,
    /// Bytes read, decoded and uploaded during the flight.
    pub bytes: ByteCounts,
    /// Peak of the backend's accounted bytes.
    pub gpu_bytes_peak: u64,
    /// Peak of the accounted bytes of decoded bricks, staging and scratch.
    pub host_bytes_peak: u64,
    /// Peak anonymous memory of the process, checked in every step, bytes.
    pub anonymous_peak: u64,
}

/// Error of a flight.
#[derive(Debug, thiserror::Error)]
pub enum FlightError {
    /// The store does not open.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The session failed.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// A view did not settle within this number of seconds.
    #[error("the view has not settled after {0:.0} s")]
    NotSettled(f64),
}

/// Plan of a flight.
#[derive(Clone, Copy, Debug)]
pub struct FlightPlan<'a> {
    /// The scenario to fly.
    pub scenario: Scenario,
    /// Scene of the first frame. Its camera and transfer functions may be left open.
    pub scene: &'a Scene,
    /// Frames of the flight.
    pub frames: u32,
    /// Size of the pictures, pixels.
    pub size_px: (u32, u32),
    /// Seed of [`Scenario::Random`].
    pub seed: u64,
    /// Longest frame time, kept by lowering quality while the camera moves. `None` draws all frames exactly.
    pub frame_goal: Option<Duration>,
}

/// Longest time for a view to settle.
const LONGEST: Duration = Duration::from_secs(600);

/// Opens stores, and flies a scenario over all of them in one picture.
///
/// # Errors
/// If a store does not open, the session fails, or a view does not settle within ten minutes.
pub fn fly(stores: &[&Path], plan: &FlightPlan<'_>, options: &SessionOptions) -> Result<FlightReport, FlightError> {
    let started = Instant::now();
    let open = |store: &&Path| VolumeSource::open(store)?.suited(plan.scene.mode);
    let volumes = stores.iter().map(open).collect::<Result<Vec<_>, _>>()?;
    let mut session = Session::new(volumes.clone(), *options);
    let first = session.resolve(plan.scene, plan.size_px)?;
    session.fit(&first)?;
    let open_ms = ms(started);
    let voxel_size = |volume: &VolumeSource| volume.source.geometry().voxel_size(volume.extent());
    let setting = Setting {
        scene: first.shown(plan.scene),
        camera: first.camera,
        world_box: first.world_box,
        voxel_size: volumes.iter().map(voxel_size).fold(f64::INFINITY, f64::min),
        seed: plan.seed,
    };
    let mut watch = Watch::new(session, options, plan.frame_goal);
    let mut frame = watch.step(&first)?;
    frame = watch.wait(frame, |status| status.covered)?;
    // Until then nothing counts as uncovered.
    watch.uncovered = 0;
    watch.drawing.draw(&mut watch.session, &frame)?;
    let first_picture_ms = ms(started);
    frame = watch.settle(frame)?;
    let settled_ms = ms(started);
    let before = frame.status.counters;
    let (mut frame_ms, mut step_ms, mut completeness, mut quality) = (Vec::new(), Vec::new(), 0.0, 0.0);
    for number in 1..=plan.frames {
        let scene = watch.session.resolve(&setting.at(plan.scenario, number, plan.frames), plan.size_px)?;
        let begun = Instant::now();
        frame = watch.step(&scene)?;
        step_ms.push(ms(begun));
        quality += watch.drawing.draw(&mut watch.session, &frame)?.share() / plan.frames as f64;
        frame_ms.push(ms(begun));
        completeness += frame.status.completeness / plan.frames as f64;
    }
    let landed = Instant::now();
    let counters = frame.status.counters;
    frame = watch.settle(frame)?;
    let Watch { mut session, uncovered, over_budget, gpu_bytes_peak, anonymous_peak, .. } = watch;
    if plan.frame_goal.is_some() {
        session.draw(&frame)?;
    }
    let status = frame.status;
    Ok(FlightReport {
        scenario: plan.scenario,
        adapter: session.backend_line().into(),
        compositor: session.backend().map_or("", Renderer::compositor),
        slots: session.slots(),
        open_ms,
        first_picture_ms,
        settled_ms,
        frames: plan.frames,
        frame_ms: Percentiles::of(&frame_ms),
        step_ms: Percentiles::of(&step_ms),
        quality,
        settle_after_ms: ms(landed),
        uncovered_frames: uncovered,
        frames_over_budget: over_budget,
        completeness,
        bricks: BrickCounts {
            wanted: status.wanted as u64,
            resident: status.resident as u64,
            uploaded: counters.uploaded - before.uploaded,
            reuploaded: counters.reuploaded - before.reuploaded,
            failed: status.failed as u64,
            unreadable: status.counters.failed,
        },
        uploaded_ahead: counters.uploaded_ahead - before.uploaded_ahead,
        bricks_decoded: counters.decoded - before.decoded,
        bytes: ByteCounts {
            read: counters.bytes_read - before.bytes_read,
            decoded: counters.bytes_decoded - before.bytes_decoded,
            uploaded: counters.bytes_uploaded - before.bytes_uploaded,
        },
        gpu_bytes_peak,
        host_bytes_peak: status.host_bytes_peak,
        anonymous_peak,
    })
}

/// A session, with checks and peaks over all of its frames.
struct Watch<'a> {
    session: Session,
    options: &'a SessionOptions,
    drawing: PacedDrawing,
    uncovered: u32,
    over_budget: u32,
    gpu_bytes_peak: u64,
    anonymous_peak: u64,
}

impl<'a> Watch<'a> {
    fn new(session: Session, options: &'a SessionOptions, frame_goal: Option<Duration>) -> Self {
        let drawing = PacedDrawing::new(frame_goal);
        Self { session, options, drawing, uncovered: 0, over_budget: 0, gpu_bytes_peak: 0, anonymous_peak: 0 }
    }

    fn step(&mut self, scene: &ResolvedScene) -> Result<Frame, SessionError> {
        let frame = self.session.step_resolved(scene)?;
        let (status, gpu_bytes) = (&frame.status, self.session.backend_bytes());
        self.uncovered += !status.covered as u32;
        let is_cpu = self.session.backend().is_some_and(|backend| backend.name() == "cpu");
        let backend_bytes = if is_cpu { self.options.cpu_memory_bytes } else { self.options.gpu_memory_bytes };
        let over = gpu_bytes > backend_bytes || status.host_bytes > self.options.host_memory_bytes;
        self.over_budget += over as u32;
        self.gpu_bytes_peak = self.gpu_bytes_peak.max(gpu_bytes);
        self.anonymous_peak = self.anonymous_peak.max(ProcessMemory::now().anonymous_bytes);
        Ok(frame)
    }

    fn settle(&mut self, frame: Frame) -> Result<Frame, FlightError> {
        self.wait(frame, |status| status.settled)
    }

    fn wait(&mut self, mut frame: Frame, done: impl Fn(&Status) -> bool) -> Result<Frame, FlightError> {
        let begun = Instant::now();
        while !done(&frame.status) {
            if begun.elapsed() > LONGEST {
                return Err(FlightError::NotSettled(LONGEST.as_secs_f64()));
            }
            if frame.status.awaits_feedback {
                self.session.draw(&frame)?;
            } else {
                self.session.wait(Duration::from_millis(50));
            }
            frame = self.step(&frame.scene)?;
        }
        Ok(frame)
    }
}

/// Makes the kernel forget a store's pages, so the next flight reads from the disk. Pages mapped by another process
/// stay.
///
/// # Errors
/// If the store's files cannot be listed or opened.
#[cfg(unix)]
pub fn forget_pages(store: &Path) -> std::io::Result<()> {
    for entry in std::fs::read_dir(store)? {
        let path = entry?.path();
        if path.is_dir() {
            forget_pages(&path)?;
        } else {
            let file = std::fs::File::open(&path)?;
            // Pages not yet on the disk cannot be forgotten.
            file.sync_data()?;
            rustix::fs::fadvise(&file, 0, None, rustix::fs::Advice::DontNeed)?;
        }
    }
    Ok(())
}
