//! How often a GPU's device was lost, and when starting it anew is given up.

use crate::session::renderer::BackendError;
use crate::session::session_error::SessionError;

/// Losses without a picture between them after which making the device anew is given up.
const MAX_IN_A_ROW: u32 = 3;

/// Counts how often the GPU device was lost.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Losses {
    total: u32,
    /// Since the last picture.
    in_a_row: u32,
}

impl Losses {
    /// Counts the loss of a device. The caller makes the device anew then.
    ///
    /// # Errors
    /// If `error` is not the loss of a device, or the device was lost more than three times without a picture in
    /// between.
    pub(crate) fn record(&mut self, error: BackendError) -> Result<(), SessionError> {
        if !error.is_loss() {
            return Err(error.into());
        }
        self.total += 1;
        self.in_a_row += 1;
        if self.in_a_row > MAX_IN_A_ROW {
            return Err(SessionError::LostAgain { times: self.in_a_row, last: error });
        }
        tracing::warn!("{error}; it is started anew");
        Ok(())
    }

    /// Takes note that a picture was drawn, which ends a row of losses.
    pub(crate) fn picture(&mut self) {
        self.in_a_row = 0;
    }

    /// Number of losses so far.
    pub(crate) fn total(&self) -> u32 {
        self.total
    }
}
