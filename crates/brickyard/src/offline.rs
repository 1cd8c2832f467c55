//! Pictures without a window: every one waits until the view has settled, so what is written is final.

use crate::session::{ResolvedScene, Session, SessionError};
use crate::stats::{RenderStats, ms};
use brickyard_pager::Status;
use brickyard_volume::Picture;
use std::time::{Duration, Instant};

/// A settled picture could not be made.
#[derive(Debug, thiserror::Error)]
pub enum OfflineError {
    /// The session failed.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// The time allowed was not enough.
    #[error(
        "the picture has not settled after {waited_s:.1} s: {resident} of {wanted} bricks are there; give it more time with --max-wait"
    )]
    NotSettled {
        /// Seconds waited.
        waited_s: f64,
        /// Bricks there.
        resident: usize,
        /// Bricks wanted.
        wanted: usize,
    },
}

/// What is streamed until it has settled.
pub trait Streamed {
    /// What is to be seen.
    type Scene;

    /// One step of streaming.
    ///
    /// # Errors
    /// If there is no device any more or nothing can be drawn at all.
    fn step(&mut self, scene: &Self::Scene) -> Result<Status, SessionError>;

    /// Waits until a brick has arrived, at most this long.
    fn wait(&mut self, timeout: Duration);

    /// Renders what is there now of the last step's scene.
    ///
    /// # Errors
    /// If there is no device any more, or it is out of memory.
    fn draw(&mut self, scene: &Self::Scene) -> Result<Picture, SessionError>;

    /// Everything the backend has allocated.
    fn backend_bytes(&self) -> u64;

    /// How many times the GPU's device was lost and made anew.
    fn device_losses(&self) -> u32;
}

impl Streamed for Session {
    type Scene = ResolvedScene;

    fn step(&mut self, scene: &ResolvedScene) -> Result<Status, SessionError> {
        Session::step(self, &scene.view)
    }

    fn wait(&mut self, timeout: Duration) {
        Session::wait(self, timeout);
    }

    fn draw(&mut self, scene: &ResolvedScene) -> Result<Picture, SessionError> {
        Session::draw(self, scene)
    }

    fn backend_bytes(&self) -> u64 {
        self.backend().bytes()
    }

    fn device_losses(&self) -> u32 {
        Session::device_losses(self)
    }
}

/// How long to wait for a brick before looking again whether time is up.
const POLL: Duration = Duration::from_millis(50);

/// Streams until the view has settled, then draws it. Adds to `stats`; `started` is when the whole run began.
///
/// # Errors
/// If the session fails, or `max_wait` passes first.
pub fn render_settled<S: Streamed>(
    session: &mut S,
    scene: &S::Scene,
    max_wait: Duration,
    started: Instant,
    stats: &mut RenderStats,
    frame_ms: &mut Vec<f64>,
) -> Result<Picture, OfflineError> {
    let begun = Instant::now();
    let status = loop {
        let status = session.step(scene)?;
        stats.record(&status, session.backend_bytes());
        if stats.first_image_ms == 0.0 && status.covered {
            session.draw(scene)?;
            stats.first_image_ms = ms(started);
        }
        if status.settled {
            break status;
        }
        give_up_after(begun, max_wait, &status)?;
        if status.awaits_feedback {
            session.draw(scene)?;
        } else {
            session.wait(POLL);
        }
    };
    let drawing = Instant::now();
    let picture = session.draw(scene)?;
    frame_ms.push(ms(drawing));
    if stats.frames == 0 {
        stats.settled_ms = ms(started);
    }
    stats.frames += 1;
    stats.device_losses = session.device_losses();
    stats.record(&status, session.backend_bytes());
    Ok(picture)
}

fn give_up_after(begun: Instant, max_wait: Duration, status: &Status) -> Result<(), OfflineError> {
    let waited = begun.elapsed();
    if waited <= max_wait {
        return Ok(());
    }
    Err(OfflineError::NotSettled { waited_s: waited.as_secs_f64(), resident: status.resident, wanted: status.wanted })
}
