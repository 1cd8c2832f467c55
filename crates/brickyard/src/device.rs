//! The device that a session's backends are made on, one after the other: an application's, or one that the first of them has opened.

use crate::backend::Renderer;
#[cfg(feature = "gpu")]
use brickyard_render::{Compiled, Gpu};

/// The device.
#[derive(Default)]
pub(crate) struct Device {
    #[cfg(feature = "gpu")]
    lent: Option<Gpu>,
    /// What the last backend has left.
    #[cfg(feature = "gpu")]
    left: Option<Compiled>,
}

impl Device {
    /// An application's device.
    #[cfg(feature = "gpu")]
    pub(crate) fn lent(gpu: Gpu) -> Self {
        Self { lent: Some(gpu), left: None }
    }

    /// Whether it is an application's.
    pub(crate) fn is_lent(&self) -> bool {
        #[cfg(feature = "gpu")]
        return self.lent.is_some();
        #[cfg(not(feature = "gpu"))]
        return false;
    }

    /// What the next backend is to be made on; none opens a device of its own.
    #[cfg(feature = "gpu")]
    pub(crate) fn take(&mut self) -> Option<Compiled> {
        self.left.take().or_else(|| self.lent.clone().map(Compiled::from))
    }

    /// Takes what a backend leaves.
    pub(crate) fn take_back(&mut self, backend: Box<dyn Renderer>) {
        #[cfg(feature = "gpu")]
        match backend.into_compiled() {
            Some(Ok(compiled)) => self.left = Some(compiled),
            // The next backend opens another one, or says that it is lost.
            Some(Err(error)) => tracing::warn!("giving memory back to the GPU: {error}"),
            None => {}
        }
        #[cfg(not(feature = "gpu"))]
        drop(backend);
    }
}
