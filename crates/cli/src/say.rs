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
    let _ = writeln!(std::io::stderr(), "{}", without_controls(&text.to_string()));
}

/// A text with escapes for control characters: names from files may hold any, and a terminal would obey them.
fn without_controls(text: &str) -> String {
    let mut shown = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '\n' | '\t' => shown.push(c),
            c if c.is_control() => shown.extend(c.escape_default()),
            c => shown.push(c),
        }
    }
    shown
}

/// Prints a message about the work, unless quiet; like `eprintln!`.
macro_rules! say {
    ($($part:tt)*) => { $crate::say::line(format_args!($($part)*)) };
}
pub(crate) use say;

#[cfg(test)]
mod tests {
    #[test]
    fn control_characters_do_not_reach_the_terminal() {
        assert_eq!(super::without_controls("a\u{1b}[2J\0\u{9b}1mé\n\tb"), "a\\u{1b}[2J\\u{0}\\u{9b}1mé\n\tb");
    }
}
