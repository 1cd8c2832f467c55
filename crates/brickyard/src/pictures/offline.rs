//! Pictures without a window: each waits for its view to settle, so written pictures are final.

use crate::files::picture_file::{PictureError, write_shown};
use crate::session::{Frame, ResolvedScene, Session, SessionError};
use crate::stats::{Fetched, Percentiles, RenderStats, ms};
use brickyard_pager::Status;
use brickyard_volume::{Picture, Scene};
use std::path::Path;
use std::time::{Duration, Instant};

/// Errors in rendering a settled picture.
#[derive(Debug, thiserror::Error)]
pub enum OfflineError {
    /// The session failed.
    #[error(transparent)]
    Session(#[from] SessionError),
    /// Not even the bricks behind one pixel fit at once.
    #[error("the bricks of the pixel in column {x} of row {y} do not fit at once: there are {slots} slots")]
    Pixel {
        /// Column of the pixel, from 0.
        x: u32,
        /// Row of the pixel, from 0.
        y: u32,
        /// Number of slots, the capacity in bricks.
        slots: u64,
    },
    /// The view has settled, but the picture was not drawn in time.
    #[error("the picture is not drawn after {waited_s:.1} s")]
    NotDrawn {
        /// Seconds waited.
        waited_s: f64,
    },
    /// The view has not settled in time.
    #[error("the picture has not settled after {waited_s:.1} s: {resident} of {wanted} bricks are resident")]
    NotSettled {
        /// Seconds waited.
        waited_s: f64,
        /// Number of wanted bricks in slots.
        resident: usize,
        /// Number of wanted bricks.
        wanted: usize,
    },
}

/// A settled picture, with its scene and statistics.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// The picture.
    pub picture: Picture,
    /// The picture's scene, with its open camera and transfer functions filled in.
    pub shown: Scene,
    /// Statistics, including whether the picture is as fine as the scene wants: see [`RenderStats::memory_bound`] and
    /// [`RenderStats::completeness`].
    pub stats: RenderStats,
}

impl Rendered {
    /// Writes the picture as a PNG file, with its scene in a text chunk.
    ///
    /// # Errors
    /// If the file cannot be written; an earlier file at `path` then stays.
    pub fn save(&self, path: impl AsRef<Path>) -> Result<(), PictureError> {
        write_shown(path.as_ref(), &self.picture, &self.shown, &self.stats)
    }
}

/// Longest time for a picture to settle.
const LONGEST: Duration = Duration::from_secs(600);

impl Session {
    /// Renders a scene once its view has settled. Only bricks beyond the memory budget and unreadable ones are then
    /// missing, as counted in [`Rendered::stats`].
    ///
    /// # Errors
    /// If a step fails, or the view has not settled after ten minutes.
    pub fn render(&mut self, scene: &Scene, size_px: (u32, u32)) -> Result<Rendered, OfflineError> {
        let (started, mut stats, mut frame_ms) = (Instant::now(), RenderStats::default(), Vec::new());
        self.suit(scene)?;
        let resolved = self.resolve(scene, size_px)?;
        let picture = render_settled(self, &resolved, LONGEST, started, &mut stats, &mut frame_ms)?;
        stats.describe(self);
        stats.frame_ms = Percentiles::of(&frame_ms);
        Ok(Rendered { picture, shown: resolved.shown(scene), stats })
    }
}

/// Interval of checking the time while waiting for a brick.
pub(crate) const POLL: Duration = Duration::from_millis(50);

/// Streams until the view of a scene has settled, then draws it, for each of its pixels' samples. Adds to `stats`, and
/// to `frame_ms` the total milliseconds of drawing. `started` is the start of the whole run.
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
    let mut drawn_ms = 0.0;
    let picture = within(session, max_wait, |session, begun| {
        scene.supersampled(|sample| {
            let frame = settle(session, sample, begun, max_wait, started, stats)?;
            let drawing = Instant::now();
            let picture = session.draw(&frame)?;
            drawn_ms += ms(drawing);
            stats.record(&frame.status, session.backend_bytes());
            Ok(picture)
        })
    })?;
    frame_ms.push(drawn_ms);
    if stats.frames == 0 {
        stats.settled_ms = ms(started);
    }
    stats.frames += 1;
    stats.device_losses = session.device_losses();
    Ok(picture)
}

/// Makes a picture by `make`, given the start time, and abandons the drawing after `max_wait`.
pub(crate) fn within(
    session: &mut Session,
    max_wait: Duration,
    make: impl FnOnce(&mut Session, Instant) -> Result<Picture, OfflineError>,
) -> Result<Picture, OfflineError> {
    let begun = Instant::now();
    session.draw_until = begun.checked_add(max_wait);
    let made = make(session, begun);
    session.draw_until = None;
    made.map_err(|error| match error {
        OfflineError::Session(SessionError::Backend(error)) if error.is_too_long() => {
            OfflineError::NotDrawn { waited_s: begun.elapsed().as_secs_f64() }
        }
        error => error,
    })
}

/// Streams until the view of a scene has settled. The first complete frame is drawn, too.
fn settle(
    session: &mut Session,
    scene: &ResolvedScene,
    begun: Instant,
    max_wait: Duration,
    started: Instant,
    stats: &mut RenderStats,
) -> Result<Frame, OfflineError> {
    loop {
        let frame = session.step_resolved(scene)?;
        let status = &frame.status;
        stats.record(status, session.backend_bytes());
        if stats.first_image_ms == 0.0 && status.covered {
            stats.first_image_fetched = Fetched::now();
            let drawing = Instant::now();
            session.draw(&frame)?;
            (stats.first_image_ms, stats.first_draw_ms) = (ms(started), ms(drawing));
        }
        if status.settled {
            return Ok(frame);
        }
        give_up_after(begun, max_wait, status)?;
        if status.awaits_feedback {
            session.draw(&frame)?;
        } else {
            session.wait(POLL);
        }
    }
}

pub(crate) fn give_up_after(begun: Instant, max_wait: Duration, status: &Status) -> Result<(), OfflineError> {
    let waited = begun.elapsed();
    if waited <= max_wait {
        return Ok(());
    }
    Err(OfflineError::NotSettled { waited_s: waited.as_secs_f64(), resident: status.resident, wanted: status.wanted })
}
