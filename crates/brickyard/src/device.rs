//! The device that a session's backends are made on, one after the other: an application's, or one that the first of them has opened.

use crate::backend::Renderer;
#[cfg(feature = "gpu")]
use brickyard_render::{Compiled, Gpu};

/// The device on which a session makes its backends: an application's, or one that the first backend has opened.
#[derive(Default)]
pub(crate) struct Device {
    #[cfg(feature = "gpu")]
    lent: Option<Gpu>,
    /// What the last backend has left.
    #[cfg(feature = "gpu")]
    left: Option<Compiled>,
}

impl Device {
    /// Takes an application's device.
    #[cfg(feature = "gpu")]
    pub(crate) fn lent(gpu: Gpu) -> Self {
        Self { lent: Some(gpu), left: None }
    }

    /// Whether the device is an application's.
    pub(crate) fn is_lent(&self) -> bool {
        #[cfg(feature = "gpu")]
        return self.lent.is_some();
        #[cfg(not(feature = "gpu"))]
        return false;
    }

    /// Takes the device for the next backend, with what has been compiled for it. `None` means that the backend opens a
    /// device of its own.
    #[cfg(feature = "gpu")]
    pub(crate) fn take(&mut self) -> Option<Compiled> {
        self.left.take().or_else(|| self.lent.clone().map(Compiled::from))
    }

    /// Ends a backend, and keeps its device for the next one with what has been compiled for it; with the picture that was shown last, too,
    /// if `keeps_picture`.
    pub(crate) fn take_back(&mut self, backend: Box<dyn Renderer>, keeps_picture: bool) {
        #[cfg(feature = "gpu")]
        match backend.into_compiled(keeps_picture) {
            Some(Ok(compiled)) => self.left = Some(compiled),
            // The next backend opens another one, or says that it is lost.
            Some(Err(error)) => tracing::warn!("giving memory back to the GPU: {error}"),
            None => {}
        }
        #[cfg(not(feature = "gpu"))]
        drop((backend, keeps_picture));
    }
}
