//! Ctrl-C: long work stops in good order and prints how to continue; a second Ctrl-C ends the process at once. Nothing
//! is lost by that either: every file with its final name is complete at any moment.

use super::failure::{ExitKind, Failure};
use signal_hook::consts::SIGINT;
use signal_hook::flag;
use std::ops::ControlFlow;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Whether the user has requested a stop.
#[derive(Clone, Debug)]
pub(crate) struct Interrupt(Arc<AtomicBool>);

impl Interrupt {
    /// Watches for Ctrl-C from now on, which otherwise ends the process.
    ///
    /// # Errors
    /// If the system refuses.
    pub(crate) fn watch() -> Result<Self, Failure> {
        let is_asked = Arc::new(AtomicBool::new(false));
        // The first registered is called first, and so lets the first Ctrl-C pass.
        flag::register_conditional_shutdown(SIGINT, ExitKind::Interrupted as i32, is_asked.clone())
            .and_then(|_| flag::register(SIGINT, is_asked.clone()))
            .map_err(Failure::failed)?;
        Ok(Self(is_asked))
    }

    pub(crate) fn is_asked(&self) -> bool {
        self.0.load(Ordering::Relaxed)
    }

    /// Ends the process if a stop is requested, in work with nothing to put in order.
    pub(crate) fn end_if_asked(&self) {
        if self.is_asked() {
            std::process::exit(ExitKind::Interrupted as i32);
        }
    }

    /// Whether to continue, as a control flow.
    pub(crate) fn flow(&self) -> ControlFlow<()> {
        if self.is_asked() { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}
