//! Why a session cannot open or go on.

use crate::backend::BackendError;
use brickyard_pager::{BrickError, PagerError};
use brickyard_store::OpenError;
use brickyard_volume::camera::CameraError;
use brickyard_volume::{SceneError, StereoError};

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
    #[error("no picture came through before the GPU was lost {times} times: {last}")]
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
    /// The scene is impossible.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The store does not open.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The frame is not the last step's: its bricks may have given their slots to others.
    #[error("the frame was superseded by a later step: draw what the last step returned")]
    Superseded,
    /// Pictures are put on textures of the device that a session draws on.
    #[error("the session does not draw on a device of the application's: make it with `Session::on_gpu`")]
    NoDevice,
    /// Cells of layers that differ in grid, place or voxel size are in no one order from back to front.
    #[error(
        "the sorted compositor has no order for the cells of layers that differ in grid, place or voxel size; raycast and compute have"
    )]
    NoOrder,
}
