//! The device of a session's backends, which use it in turn: an application's, or one opened by the first of them.

#[cfg(feature = "gpu")]
use crate::session::trial::Trial;
#[cfg(feature = "gpu")]
use brickyard_render::{Compiled, Gpu, GpuError};

/// The device of a session's backends.
#[derive(Default)]
pub(crate) struct Device {
    #[cfg(feature = "gpu")]
    lent: Option<Gpu>,
    /// The last backend's device and compiled objects.
    #[cfg(feature = "gpu")]
    left: Option<Compiled>,
    /// Which compositor is faster on it.
    #[cfg(feature = "gpu")]
    pub(crate) trial: Trial,
}

impl Device {
    #[cfg(feature = "gpu")]
    pub(crate) fn lent(gpu: Gpu) -> Self {
        Self { lent: Some(gpu), ..Self::default() }
    }

    pub(crate) fn is_lent(&self) -> bool {
        #[cfg(feature = "gpu")]
        return self.lent.is_some();
        #[cfg(not(feature = "gpu"))]
        return false;
    }

    /// Takes the device for the next backend, with everything compiled for it. With `None`, the backend opens its own.
    #[cfg(feature = "gpu")]
    pub(crate) fn take(&mut self) -> Option<Compiled> {
        self.left.take().or_else(|| self.lent.clone().map(Compiled::from))
    }

    /// Keeps a backend's device for the next one.
    #[cfg(feature = "gpu")]
    pub(crate) fn take_back(&mut self, left: Result<Compiled, GpuError>) {
        match left {
            Ok(compiled) => self.left = Some(compiled),
            // The next backend opens another one, or reports the loss.
            Err(error) => tracing::warn!("giving memory back to the GPU: {error}"),
        }
    }
}
