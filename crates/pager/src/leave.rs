//! How threads end that read: they are waited for while they are about to, and left where a disk does not answer.
//!
//! A thread that is left goes on with what it holds of the source until its read comes back, then ends: its channels are closed.

use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// How long threads are waited for: a brick is read and decoded in less.
const PATIENCE: Duration = Duration::from_millis(500);
const PAUSE: Duration = Duration::from_micros(200);

/// Waits until threads have ended, which have been told to, or have been waited for long enough.
pub(crate) fn leave(threads: impl IntoIterator<Item = JoinHandle<()>>) {
    let begun = Instant::now();
    for thread in threads {
        while !thread.is_finished() && begun.elapsed() < PATIENCE {
            std::thread::sleep(PAUSE);
        }
        if thread.is_finished() {
            // Its own panic has been printed; there is nothing to add.
            let _ = thread.join();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    #[test]
    fn threads_that_end_are_waited_for_and_others_are_left() {
        let (end, ended) = channel::<()>();
        let (done, is_done) = channel();
        let stuck = std::thread::spawn(move || {
            let _ = ended.recv();
        });
        let slow = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(50));
            done.send(()).unwrap();
        });
        let begun = Instant::now();
        leave([slow, stuck]);
        assert!(is_done.try_recv().is_ok(), "the slow one has ended");
        // Far more than it takes, far less than for ever.
        assert!(begun.elapsed() < Duration::from_secs(20));
        drop(end);
    }
}
