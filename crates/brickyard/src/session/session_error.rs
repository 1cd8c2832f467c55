//! Errors of a session.

use crate::session::renderer::BackendError;
use brickyard_pager::{BrickError, PagerError};
use brickyard_store::OpenError;
use brickyard_volume::camera::CameraError;
use brickyard_volume::{PrecisionError, SceneError, StereoError};

/// The error of a session that cannot open or continue.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// There is no backend, too little memory for it, or its device was lost.
    #[error(transparent)]
    Backend(#[from] BackendError),
    /// A budget is too small for the fewest bricks, or aprons or gradients do not fit the bricks.
    #[error(transparent)]
    Pager(#[from] PagerError),
    /// Part of the view can be drawn from no level at all.
    #[error("a part of the picture cannot be read at any level: {0}")]
    Unreadable(BrickError),
    /// The device was lost repeatedly, without a picture in between.
    #[error("the GPU was lost {times} times before a picture was finished: {last}")]
    LostAgain {
        /// Number of losses in a row.
        times: u32,
        /// The last loss.
        last: BackendError,
    },
    /// The camera is invalid.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// The stereo settings are invalid, or do not fit the size of the picture.
    #[error(transparent)]
    Stereo(#[from] StereoError),
    /// The scene is invalid.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The store does not open.
    #[error(transparent)]
    Open(#[from] OpenError),
    /// The backend's numbers have too few bits for the scene's expression.
    #[error("the expression needs more precision than {backend} has: {error}")]
    Precision {
        /// The backend's name.
        backend: &'static str,
        /// The indistinguishable values.
        error: PrecisionError,
    },
    /// The frame is not the last step's: its bricks may have lost their slots to others.
    #[error("the frame was superseded by a later step: draw the frame of the last step")]
    Superseded,
    /// The session does not draw on an application's device, so it cannot draw on the application's textures.
    #[error("the session does not draw on the application's device: make it with `Session::on_gpu`")]
    NoDevice,
    /// The operating system provided no thread to draw on.
    #[error("cannot start a thread to draw on: {0}")]
    NoThread(#[source] std::io::Error),
    /// The compositor is `sorted`, and the layers differ in grid, place or voxel size: their cells have no common order
    /// from back to front.
    #[error(
        "the sorted compositor cannot order the cells of layers of different grids, places or voxel sizes; raycast and \
         compute can"
    )]
    NoOrder,
}
