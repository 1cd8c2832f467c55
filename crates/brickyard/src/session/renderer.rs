//! One interface to all rendering backends: bricks go into the slots of layers, and pictures come out.

use brickyard_pager::{Layer, Upload};
#[cfg(feature = "gpu")]
use brickyard_render::{Compiled, GpuError, GpuRenderer};
use brickyard_software::{Painting, SoftwareError};
use brickyard_volume::{Combination, Picture};
use std::sync::Arc;
use std::time::Instant;

/// Why a backend could not be made, or how it has failed.
#[derive(Debug, thiserror::Error)]
pub enum BackendError {
    /// An error of the GPU backend.
    #[cfg(feature = "gpu")]
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The library was built without the GPU backend.
    #[cfg(not(feature = "gpu"))]
    #[error("a GPU was asked for, and this build has no GPU backend (the feature `gpu`)")]
    NoGpu,
    /// An error of the CPU backend.
    #[error(transparent)]
    Cpu(#[from] SoftwareError),
    /// The CPU backend does not have the compositor that was asked for, only `raycast`.
    #[error("the CPU backend has no `{0}` compositor, only `raycast`")]
    CpuCompositor(&'static str),
}

impl BackendError {
    /// Whether the GPU device is lost, so that [`Renderer::renew`] may help.
    pub fn is_loss(&self) -> bool {
        #[cfg(feature = "gpu")]
        return matches!(self, Self::Gpu(GpuError::DeviceLost(_)));
        #[cfg(not(feature = "gpu"))]
        return false;
    }

    /// Whether a picture was given up, since the time was over that was [allowed](Renderer::draw_until).
    pub fn is_too_long(&self) -> bool {
        match self {
            #[cfg(feature = "gpu")]
            Self::Gpu(GpuError::TooLong) => true,
            Self::Cpu(SoftwareError::TooLong) => true,
            _ => false,
        }
    }
}

/// A rendering backend for the layers that it was made for, with the slots that it draws them from.
pub trait Renderer: Send {
    /// The backend's name: `gpu` or `cpu`.
    fn name(&self) -> &'static str;

    /// The compositor's name: `sorted`, `raycast` or `compute`.
    fn compositor(&self) -> &'static str {
        "raycast"
    }

    /// Number of slots in a layer's pool, which all layers of the pool share.
    fn slots(&self, layer: usize) -> u32;

    /// Bytes of everything that is allocated for slots, tables, targets and staging.
    fn bytes(&self) -> u64;

    /// Bytes that [`Renderer::bytes`] would be if the device had not refused some of them.
    fn asked_bytes(&self) -> u64 {
        self.bytes()
    }

    /// Puts a padded brick into a slot of a layer's pool. A backend that keeps the brick's buffer returns the one that it kept for the slot before.
    ///
    /// # Errors
    /// If the device is lost.
    fn upload(&mut self, layer: usize, upload: &Upload) -> Result<Option<Arc<[u8]>>, BackendError>;

    /// Bytes that can be uploaded for a layer without waiting for the device; `None` if uploads may wait.
    fn upload_room_bytes(&mut self, _layer: usize) -> Option<u64> {
        None
    }

    /// Submits what has been uploaded, so that everything drawn from now on shows it.
    ///
    /// # Errors
    /// If the device is lost.
    fn submit_uploads(&mut self) -> Result<(), BackendError> {
        Ok(())
    }

    /// Renders a picture of layers, or of an expression over them. The layers come in the order that the renderer was
    /// made for; some may be left out.
    ///
    /// # Errors
    /// If the device is lost or out of memory.
    fn render(&mut self, layers: &[Layer<'_>], combination: Option<&Combination>) -> Result<Picture, BackendError>;

    /// Prepares [`Renderer::render`] of these layers on another thread, for example by compiling shaders. Other
    /// pictures can be drawn meanwhile. What was asked for before and has not begun is dropped.
    fn prepare(&mut self, _layers: &[Layer<'_>], _combination: Option<&Combination>) {}

    /// Whether [`Renderer::render`] of these layers has nothing left to prepare. A picture that is drawn sooner
    /// prepares itself, or waits for the thread.
    fn is_prepared(&self, _layers: &[Layer<'_>], _combination: Option<&Combination>) -> bool {
        true
    }

    /// For each entry of a layer's draw list in the last picture, in order, the greatest transmittance with which a ray
    /// entered the cell; 0 if no ray did. `None` if that is not known, as for projections and for `sorted`.
    fn visibility(&self, _layer: usize) -> Option<&[f32]> {
        None
    }

    /// Gives up from now on pictures that are not finished at this time; `None` gives none up.
    fn draw_until(&mut self, until: Option<Instant>);

    /// Shows from now on on this painting what of a picture is drawn, and stops if it is abandoned; `None` shows nothing. A backend that draws a
    /// picture in one go does neither.
    fn draw_on(&mut self, _painting: Option<Arc<Painting>>) {}

    /// Whether it still has the picture that the backend before it has shown last.
    fn keeps_picture(&self) -> bool {
        false
    }

    /// Makes a lost GPU device anew, from the choice of the adapter on. All slots are empty then, and there may be
    /// fewer.
    ///
    /// # Errors
    /// If there is no GPU any more, it has too little memory, or the device is an application's.
    fn renew(&mut self) -> Result<(), BackendError> {
        Ok(())
    }

    /// This backend as the GPU renderer; `None` if it is another one.
    #[cfg(feature = "gpu")]
    fn as_gpu(&mut self) -> Option<&mut GpuRenderer> {
        None
    }

    /// Ends the backend, and returns its device with what has been compiled for it, and with the picture that was shown last if
    /// `keeps_picture`. `None` if it has no device.
    #[cfg(feature = "gpu")]
    fn into_compiled(self: Box<Self>, _keeps_picture: bool) -> Option<Result<Compiled, GpuError>> {
        None
    }

    /// Destroys the device, as a driver may: for tests.
    #[doc(hidden)]
    fn destroy_device(&self) {}
}

/// What pictures a backend is made for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pictures {
    /// Size of the largest picture, pixels.
    pub(crate) size_px: (u32, u32),
    /// Whether there may be expressions over the layers.
    pub(crate) has_expressions: bool,
}
