//! The common interface of all rendering backends: bricks go into the slots of layers, and pictures come out.

use brickyard_pager::{Layer, Upload};
#[cfg(feature = "gpu")]
use brickyard_render::{Compiled, GpuError, GpuRenderer};
use brickyard_software::{Painting, SoftwareError};
use brickyard_volume::{Combination, Picture, PixelRect};
use std::sync::Arc;
use std::time::Instant;

/// The failure of a backend, on creation or later.
#[derive(Debug, thiserror::Error)]
pub enum BackendError {
    /// An error of the GPU backend.
    #[cfg(feature = "gpu")]
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The library was built without the GPU backend.
    #[cfg(not(feature = "gpu"))]
    #[error("this build has no GPU backend (the feature `gpu`): choose the CPU")]
    NoGpu,
    /// An error of the CPU backend.
    #[error(transparent)]
    Cpu(#[from] SoftwareError),
    /// The CPU backend has only `raycast`, not the chosen compositor.
    #[error("the CPU backend has no `{0}` compositor, only `raycast`")]
    CpuCompositor(&'static str),
}

impl BackendError {
    /// Whether the GPU device is lost, so [`Renderer::renew`] may help.
    pub fn is_loss(&self) -> bool {
        #[cfg(feature = "gpu")]
        return matches!(self, Self::Gpu(GpuError::DeviceLost(_)));
        #[cfg(not(feature = "gpu"))]
        return false;
    }

    /// Whether a picture was abandoned at its [deadline](Renderer::draw_until).
    pub fn is_too_long(&self) -> bool {
        match self {
            #[cfg(feature = "gpu")]
            Self::Gpu(GpuError::TooLong) => true,
            Self::Cpu(SoftwareError::TooLong) => true,
            _ => false,
        }
    }
}

/// A rendering backend for a fixed list of layers, with their slots.
pub trait Renderer: Send {
    /// The backend's name: `gpu` or `cpu`.
    fn name(&self) -> &'static str;

    /// The compositor's name: `sorted`, `raycast` or `compute`.
    fn compositor(&self) -> &'static str {
        "raycast"
    }

    /// Number of slots in a layer's pool, common to all layers of the pool.
    fn slots(&self, layer: usize) -> u32;

    /// Bytes allocated for slots, tables, targets and staging.
    fn bytes(&self) -> u64;

    /// [`Renderer::bytes`], including any bytes refused by the device.
    fn asked_bytes(&self) -> u64 {
        self.bytes()
    }

    /// Puts a padded brick into a slot of a layer's pool. A backend that keeps the brick's buffer returns the slot's
    /// previous one.
    ///
    /// # Errors
    /// If the device is lost.
    fn upload(&mut self, layer: usize, upload: &Upload) -> Result<Option<Arc<[u8]>>, BackendError>;

    /// Bytes that can be uploaded for a layer without waiting for the device; `None` if uploads may wait.
    fn upload_room_bytes(&mut self, _layer: usize) -> Option<u64> {
        None
    }

    /// Submits the uploads, so all later drawing shows them.
    ///
    /// # Errors
    /// If the device is lost.
    fn submit_uploads(&mut self) -> Result<(), BackendError> {
        Ok(())
    }

    /// Renders a picture of layers, or of an expression over them. The layers keep the order of the renderer's
    /// creation; some may be left out.
    ///
    /// # Errors
    /// If the device is lost or out of memory.
    fn render(&mut self, layers: &[Layer<'_>], combination: Option<&Combination>) -> Result<Picture, BackendError>;

    /// Prepares [`Renderer::render`] of these layers on another thread, for example by compiling shaders. Other
    /// pictures can be drawn meanwhile. Drops earlier requests that have not begun.
    fn prepare(&mut self, _layers: &[Layer<'_>], _combination: Option<&Combination>) {}

    /// Whether [`Renderer::render`] of these layers has nothing left to prepare. Rendering sooner prepares by itself,
    /// or waits for the thread.
    fn is_prepared(&self, _layers: &[Layer<'_>], _combination: Option<&Combination>) -> bool {
        true
    }

    /// For each entry of a layer's draw list in the last picture, in order, the greatest transmittance of a ray on
    /// entering the cell; 0 if no ray did. `None` if unknown, as for projections and for `sorted`.
    fn visibility(&self, _layer: usize) -> Option<&[f32]> {
        None
    }

    /// Abandons later pictures that are not finished at this time; `None` abandons none.
    fn draw_until(&mut self, until: Option<Instant>);

    /// Draws only these pixels of later pictures; others may have any colour. `None` draws all.
    fn draw_within(&mut self, window: Option<PixelRect>);

    /// Shows later pictures in progress on this painting, and stops if it is abandoned; `None` shows nothing. A backend
    /// that draws a picture in one go does neither.
    fn draw_on(&mut self, _painting: Option<Arc<Painting>>) {}

    /// Whether it still has the last picture of the previous backend.
    fn keeps_picture(&self) -> bool {
        false
    }

    /// Creates a lost GPU device anew, from the choice of the adapter on. All slots are then empty, and there may be
    /// fewer.
    ///
    /// # Errors
    /// If there is no GPU any more, it has too little memory, or the device is an application's.
    fn renew(&mut self) -> Result<(), BackendError> {
        Ok(())
    }

    /// This backend as the GPU renderer; `None` for another one.
    #[cfg(feature = "gpu")]
    fn as_gpu(&mut self) -> Option<&mut GpuRenderer> {
        None
    }

    /// Ends the backend, and returns its device with everything compiled for it, and with the last shown picture if
    /// `keeps_picture`. `None` if it has no device.
    #[cfg(feature = "gpu")]
    fn into_compiled(self: Box<Self>, _keeps_picture: bool) -> Option<Result<Compiled, GpuError>> {
        None
    }

    /// Destroys the device, as a driver may: for tests.
    #[doc(hidden)]
    fn destroy_device(&self) {}
}

/// Limits of a backend's pictures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pictures {
    /// Size of the largest picture, pixels.
    pub(crate) size_px: (u32, u32),
    /// Whether there may be expressions over the layers.
    pub(crate) has_expressions: bool,
}
