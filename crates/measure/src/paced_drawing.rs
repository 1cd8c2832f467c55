//! Drawing of a measurement's frames at the best quality within a time goal, as in a window with a changing picture.

use brickyard::frame_governor::{Change, Quality, QualityControl};
use brickyard::session::{Frame, Session, SessionError};
use std::time::{Duration, Instant};

/// Drawing of frames that change each time.
pub(crate) struct PacedDrawing {
    /// Longest frame time, streaming included, and the control of quality; `None` draws all frames exactly.
    goal: Option<(Duration, QualityControl)>,
}

impl PacedDrawing {
    pub(crate) fn new(frame_goal: Option<Duration>) -> Self {
        Self { goal: frame_goal.map(|goal| (goal, QualityControl::new(goal))) }
    }

    /// Draws a session's frame. Returns the quality for which there was time.
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
