//! Drawing the frames of a measurement as well as a time goal lets them be drawn, as a window does while its picture changes.

use brickyard::frame_governor::{Change, Quality, QualityControl};
use brickyard::session::{Frame, Session, SessionError};
use std::time::{Duration, Instant};

/// Draws frames whose picture changes each time.
pub(crate) struct PacedDrawing {
    /// How long a frame may take, streaming included, and what is known of the scene; `None` draws all frames exactly.
    goal: Option<(Duration, QualityControl)>,
}

impl PacedDrawing {
    pub(crate) fn new(frame_goal: Option<Duration>) -> Self {
        Self { goal: frame_goal.map(|goal| (goal, QualityControl::new(goal))) }
    }

    /// Draws a session's frame. Returns the quality that there was time for.
    ///
    /// # Errors
    /// As [`Session::draw`].
    pub(crate) fn draw(&mut self, session: &mut Session, frame: &Frame) -> Result<Quality, SessionError> {
        const CHANGED: Change = Change { moved: true, refined: true };
        let Some((frame_goal, control)) = &mut self.goal else {
            session.draw(frame)?;
            return Ok(Quality::EXACT);
        };
        control.set_goal(session.drawing_time(*frame_goal, Duration::ZERO));
        let quality = control.next(CHANGED).unwrap_or(Quality::EXACT);
        let begun = Instant::now();
        session.draw(&quality.frame(frame))?;
        control.took(begun.elapsed());
        Ok(quality)
    }
}
