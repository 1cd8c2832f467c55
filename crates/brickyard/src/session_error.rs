//! Why a session cannot open or go on.

use crate::backend::BackendError;
use brickyard_pager::{BrickError, PagerError};
use brickyard_volume::StereoError;
use brickyard_volume::camera::CameraError;

/// Why a session cannot open or go on.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// No backend, too little memory for it, or a lost device.
    #[error(transparent)]
    Backend(#[from] BackendError),
    /// A budget too small for one brick.
    #[error(transparent)]
    Pager(#[from] PagerError),
    /// Part of the view can be drawn from no level at all.
    #[error("nothing can stand in for a part of the picture: {0}")]
    Unreadable(BrickError),
    /// The device goes as often as it is made anew.
    #[error("no picture came through before the GPU was lost {times} times: {last}; try --backend cpu")]
    LostAgain {
        /// How many times in a row.
        times: u32,
        /// The last loss.
        last: BackendError,
    },
    /// The camera makes no picture.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The camera makes no stereo picture.
    #[error(transparent)]
    Stereo(#[from] StereoError),
    /// The scene asks for what the store does not have.
    #[error("{0}")]
    Scene(String),
}
