//! Guard against panics of the crates that put the window on a display, caused by misbehaving drivers or displays. Such a panic becomes a silent
//! error here. A panic of the window's own code propagates.

use std::any::Any;
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind, resume_unwind, set_hook, take_hook};
use std::sync::Once;

thread_local! {
    /// Whether this thread is in code of other crates.
    static IS_FOREIGN: Cell<bool> = const { Cell::new(false) };
}

/// Runs code of other crates. After a panic its objects must be given up.
///
/// # Errors
/// If it panics: the message.
pub(crate) fn guarded<T>(foreign: impl FnOnce() -> T) -> Result<T, String> {
    quiet();
    let before = IS_FOREIGN.replace(true);
    let done = catch_unwind(AssertUnwindSafe(foreign));
    let is_theirs = IS_FOREIGN.replace(before);
    done.map_err(|panic| if is_theirs { words(&*panic) } else { resume_unwind(panic) })
}

/// Runs the window's own code when called by other crates.
pub(crate) fn own<T>(own: impl FnOnce() -> T) -> T {
    let before = IS_FOREIGN.replace(false);
    let done = own();
    IS_FOREIGN.set(before);
    done
}

/// Silences panics of other crates' code from now on.
fn quiet() {
    static ONCE: Once = Once::new();
    ONCE.call_once(|| {
        let before = take_hook();
        set_hook(Box::new(move |panic| {
            if !IS_FOREIGN.get() {
                before(panic);
            }
        }));
    });
}

/// The message in a panic's payload.
fn words(panic: &(dyn Any + Send)) -> String {
    let text = panic.downcast_ref::<&str>().map(ToString::to_string);
    let text = text.or_else(|| panic.downcast_ref::<String>().cloned()).unwrap_or_else(|| "it says nothing".into());
    text.trim_start_matches("called `Result::unwrap()` on an `Err` value: ").lines().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn panics_of_others_are_errors_and_those_of_the_window_go_on() {
        assert_eq!(guarded(|| 3), Ok(3));
        assert_eq!(guarded(|| panic!("no {}", "display")), Err::<(), _>("no display".into()));
        assert_eq!(guarded(|| own(|| 4) + 1), Ok(5));
        assert_eq!(guarded(|| own(|| guarded(|| panic!("inner")))), Ok(Err::<(), _>("inner".into())));
        let own_fault = catch_unwind(|| guarded(|| own(|| panic!("a fault"))));
        assert_eq!(own_fault.map_err(|panic| words(&*panic)), Err::<Result<(), _>, _>("a fault".into()));
    }
}
