//! Shutdown of reading threads: a short wait, after which threads stuck on an unresponsive disk are abandoned.
//!
//! An abandoned thread keeps its hold on the source until its read returns, and then ends, as its channels are closed.

use std::thread::{Builder, JoinHandle};
use std::time::{Duration, Instant};

/// Longest wait for threads: more than reading and decoding a brick takes.
const PATIENCE: Duration = Duration::from_millis(500);
const PAUSE: Duration = Duration::from_micros(200);

/// Running threads, which stop when their channels close. Dropping this waits for them, at most for [`PATIENCE`]. Fields are dropped in
/// the order of their declaration, so a struct declares this after the channels.
#[derive(Default)]
pub(crate) struct Threads(Vec<JoinHandle<()>>);

impl Threads {
    /// Starts another thread.
    pub(crate) fn start(&mut self, name: String, work: impl FnOnce() + Send + 'static) -> std::io::Result<()> {
        self.0.push(Builder::new().name(name).spawn(work)?);
        Ok(())
    }
}

impl Drop for Threads {
    fn drop(&mut self) {
        leave(self.0.drain(..));
    }
}

/// Waits until threads already asked to stop have ended, at most for [`PATIENCE`].
fn leave(threads: impl IntoIterator<Item = JoinHandle<()>>) {
    let begun = Instant::now();
    for thread in threads {
        while !thread.is_finished() && begun.elapsed() < PATIENCE {
            std::thread::sleep(PAUSE);
        }
        if thread.is_finished() {
            // Its panic has been printed already.
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
        // Far longer than needed, far shorter than for ever.
        assert!(begun.elapsed() < Duration::from_secs(20));
        drop(end);
    }
}
