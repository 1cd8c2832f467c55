//! The device that a session's backends are made on, one after the other: an application's, or one that the first of them has opened.

#[cfg(feature = "gpu")]
use brickyard_render::{Compiled, Gpu, GpuError};

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

    /// Keeps what a backend has left for the next one.
    #[cfg(feature = "gpu")]
    pub(crate) fn take_back(&mut self, left: Result<Compiled, GpuError>) {
        match left {
            Ok(compiled) => self.left = Some(compiled),
            // The next backend opens another one, or says that it is lost.
            Err(error) => tracing::warn!("giving memory back to the GPU: {error}"),
        }
    }
}
