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
    /// Not even the bricks behind one pixel fit at once.
    #[error(
        "the bricks that the pixel in column {x} of row {y} wants do not fit at once, {slots} in all: allow more --gpu-memory, or draw \
         one volume in passes: --backend gpu --compositor sorted"
    )]
    Pixel {
        /// Its column.
        x: u32,
        /// Its row.
        y: u32,
        /// How many fit.
        slots: u64,
    },
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

/// How long to wait for a brick before looking again whether time is up.
pub(crate) const POLL: Duration = Duration::from_millis(50);

/// Streams until the view has settled, then draws it. Adds to `stats`; `started` is when the whole run began.
///
/// # Errors
/// If the session fails, or `max_wait` passes first.
pub fn render_settled(
    session: &mut Session,
    scene: &ResolvedScene,
    max_wait: Duration,
    started: Instant,
    stats: &mut RenderStats,
    frame_ms: &mut Vec<f64>,
) -> Result<Picture, OfflineError> {
    let begun = Instant::now();
    let status = loop {
        let status = session.step(scene)?;
        stats.record(&status, session.backend().bytes());
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
    stats.record(&status, session.backend().bytes());
    Ok(picture)
}

pub(crate) fn give_up_after(begun: Instant, max_wait: Duration, status: &Status) -> Result<(), OfflineError> {
    let waited = begun.elapsed();
    if waited <= max_wait {
        return Ok(());
    }
    Err(OfflineError::NotSettled { waited_s: waited.as_secs_f64(), resident: status.resident, wanted: status.wanted })
}
