//! What the command says besides its results: lines on standard error, unless it was told to be quiet. Where nobody listens, they are left unsaid.

use std::fmt::Arguments;
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};

static IS_QUIET: AtomicBool = AtomicBool::new(false);

/// Says nothing from here on, but for errors.
pub(crate) fn be_quiet() {
    IS_QUIET.store(true, Ordering::Relaxed);
}

/// Whether nothing is to be said but errors.
pub(crate) fn is_quiet() -> bool {
    IS_QUIET.load(Ordering::Relaxed)
}

/// Says a line about the work, unless it is to be quiet.
pub(crate) fn line(text: Arguments<'_>) {
    if !is_quiet() {
        error(text);
    }
}

/// Says a line that is no less than an error.
pub(crate) fn error(text: Arguments<'_>) {
    // A closed pipe is no reason to end the work.
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Says a line about the work, unless the command is to be quiet: as `eprintln!`.
macro_rules! say {
    ($($part:tt)*) => { $crate::say::line(format_args!($($part)*)) };
}
pub(crate) use say;
