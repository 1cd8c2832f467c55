//! How often a GPU's device was lost, and when starting it anew is given up.

use crate::backend::BackendError;
use crate::session_error::SessionError;

/// Losses without a picture between them after which making the device anew is given up.
const MAX_IN_A_ROW: u32 = 3;

/// Losses so far.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Losses {
    total: u32,
    /// Since the last picture.
    in_a_row: u32,
}

impl Losses {
    /// Takes note of a lost device, which is to be made anew then.
    ///
    /// # Errors
    /// If it is something else that is wrong, or it was lost too often.
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

    /// Takes note of a picture.
    pub(crate) fn picture(&mut self) {
        self.in_a_row = 0;
    }

    /// All of them.
    pub(crate) fn total(&self) -> u32 {
        self.total
    }
}
