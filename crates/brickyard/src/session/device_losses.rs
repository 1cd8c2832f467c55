//! Losses of a GPU's device: their count, and when to give up.

use crate::session::renderer::BackendError;
use crate::session::session_error::SessionError;

/// Losses in a row, without a picture between them, before giving up.
const MAX_IN_A_ROW: u32 = 3;

/// Counter of lost GPU devices.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Losses {
    pub(crate) total: u32,
    /// Since the last picture.
    in_a_row: u32,
}

impl Losses {
    /// Counts the loss of a device, which the caller then creates anew.
    ///
    /// # Errors
    /// If `error` is not the loss of a device, or more than three losses had no picture in between.
    pub(crate) fn record(&mut self, error: BackendError) -> Result<(), SessionError> {
        if !error.is_loss() {
            return Err(error.into());
        }
        self.total += 1;
        self.in_a_row += 1;
        if self.in_a_row > MAX_IN_A_ROW {
            return Err(SessionError::LostAgain { times: self.in_a_row, last: error });
        }
        tracing::warn!("{error}; the device is opened again");
        Ok(())
    }

    /// Records a drawn picture, which ends a row of losses.
    pub(crate) fn picture(&mut self) {
        self.in_a_row = 0;
    }
}
