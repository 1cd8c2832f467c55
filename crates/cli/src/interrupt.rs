//! Ctrl-C: long work stops in good order and says how to go on; asked once more, the process ends at once. Nothing is lost by that either: what
//! has its final name is whole at any moment.

use super::failure::{ExitKind, Failure};
use signal_hook::consts::SIGINT;
use signal_hook::flag;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether the user has asked the work to stop.
#[derive(Clone, Debug)]
pub(crate) struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Watches for Ctrl-C from now on, which by itself ends the process.
    ///
    /// # Errors
    /// If the system does not let it.
    pub(crate) fn watch() -> Result<Self, Failure> {
        let is_asked = Arc::new(AtomicBool::new(false));
        // The first registered is asked first, and so lets the first Ctrl-C pass.
        flag::register_conditional_shutdown(SIGINT, ExitKind::Interrupted as i32, is_asked.clone())
            .and_then(|_| flag::register(SIGINT, is_asked.clone()))
            .map_err(Failure::failed)?;
        Ok(Self(is_asked))
    }

    /// Whether the work is to stop. Quick.
    pub(crate) fn is_asked(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Whether the work is to go on, as a flow of control.
    pub(crate) fn flow(&self) -> ControlFlow<()> {
        if self.is_asked() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}
