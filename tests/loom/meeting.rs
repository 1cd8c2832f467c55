//! The window's meeting with a returning session, in every interleaving of their threads.

#![cfg(all(loom, test))]

#[path = "../../crates/viewer/src/canvas/meeting.rs"]
mod meeting;

use loom::sync::Arc;
use loom::sync::atomic::{AtomicBool, Ordering};
use loom::thread::{self, JoinHandle};
use meeting::Meeting;
use std::time::Duration;

/// A returning session, and whether it has woken the window.
fn session(meeting: &Arc<Meeting>) -> (JoinHandle<()>, Arc<AtomicBool>) {
    let is_told = Arc::new(AtomicBool::new(false));
    let (of_thread, meeting) = (is_told.clone(), meeting.clone());
    let thread = thread::spawn(move || {
        if !meeting.arrive() {
            of_thread.store(true, Ordering::Release);
        }
    });
    (thread, is_told)
}

/// Time stands still here: a window never woken waits forever, which the model detects.
#[test]
fn a_window_that_waits_is_woken() {
    loom::model(|| {
        let meeting = Arc::new(Meeting::default());
        let (thread, _) = session(&meeting);
        assert!(meeting.wait(Duration::from_secs(3600)));
        thread.join().unwrap();
        assert!(meeting.is_due());
    });
}

/// Whether it looked before, or waited and gave up.
#[test]
fn a_window_that_does_not_see_the_session_is_told() {
    for waits in [false, true] {
        loom::model(move || {
            let meeting = Arc::new(Meeting::default());
            let (thread, is_told) = session(&meeting);
            let has_seen = if waits { meeting.wait(Duration::ZERO) } else { meeting.is_due() };
            thread.join().unwrap();
            assert!(has_seen || is_told.load(Ordering::Acquire));
        });
    }
}
