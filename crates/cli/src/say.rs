//! Messages on standard error, apart from results; none when quiet. Messages without a reader are dropped.

use std::fmt::Arguments;
use std::io::Write;
use std::sync::atomic::{AtomicBool, Ordering};

static IS_QUIET: AtomicBool = AtomicBool::new(false);

/// Suppresses all later messages except errors.
pub(crate) fn be_quiet() {
    IS_QUIET.store(true, Ordering::Relaxed);
}

/// Whether only errors are printed.
pub(crate) fn is_quiet() -> bool {
    IS_QUIET.load(Ordering::Relaxed)
}

/// Prints a message about the work, unless quiet.
pub(crate) fn line(text: Arguments<'_>) {
    if !is_quiet() {
        error(text);
    }
}

pub(crate) fn error(text: Arguments<'_>) {
    // A closed pipe is no reason to end the work.
    let _ = writeln!(std::io::stderr(), "{text}");
}

/// Prints a message about the work, unless quiet; like `eprintln!`.
macro_rules! say {
    ($($part:tt)*) => { $crate::say::line(format_args!($($part)*)) };
}
pub(crate) use say;
