//! Progress of levels under way, counted in bricks of the image's own levels: those beneath the made bricks asked for, and those read since.

use crate::mutex::lock;
use std::sync::Mutex;
use std::time::{Duration, Instant};

/// Progress before an estimate, and time, of the smallest part of the work that lets the rest be told.
const TELLING_SHARE: f64 = 0.02;
const TELLING_TIME: Duration = Duration::from_millis(500);

/// Coarse levels under way.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Making {
    /// Bricks of the image's own levels read so far.
    pub done: u64,
    /// Bricks of the image's own levels to be read.
    pub total: u64,
    /// Time since the first was asked for.
    pub elapsed: Duration,
}

impl Making {
    /// Time left by the rate so far; `None` before it can be told.
    pub fn left(&self) -> Option<Duration> {
        let share = self.done as f64 / self.total.max(1) as f64;
        let can_tell = share >= TELLING_SHARE && self.elapsed >= TELLING_TIME;
        can_tell.then(|| self.elapsed.mul_f64(((1.0 - share) / share).max(0.0)))
    }
}

impl std::fmt::Display for Making {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let percent = 100 * self.done / self.total.max(1);
        write!(f, "making coarse levels: {percent} % of {} bricks read", self.total)?;
        match self.left().map(|left| left.as_secs_f64().ceil() as u64) {
            Some(seconds @ 0..120) => write!(f, ", about {seconds} s left"),
            Some(seconds) => write!(f, ", about {} min left", seconds.div_ceil(60)),
            None => Ok(()),
        }
    }
}

/// The made bricks being read by all threads.
#[derive(Default)]
pub(super) struct Progress(Mutex<Option<Work>>);

struct Work {
    /// Threads that wait for a made brick.
    waiting: usize,
    done: u64,
    total: u64,
    begun: Instant,
}

/// A thread's wait for a made brick, until dropped.
pub(super) struct Waiting<'a>(&'a Progress);

impl Progress {
    /// Adds a made brick above so many bricks.
    pub(super) fn wait_for(&self, bricks: u64) -> Waiting<'_> {
        let mut work = lock(&self.0);
        let work = work.get_or_insert_with(|| Work { waiting: 0, done: 0, total: 0, begun: Instant::now() });
        work.waiting += 1;
        work.total += bricks;
        Waiting(self)
    }

    /// Counts bricks as read.
    pub(super) fn advance(&self, bricks: u64) {
        if let Some(work) = &mut *lock(&self.0) {
            work.done += bricks;
        }
    }

    /// The work under way, if any.
    pub(super) fn now(&self) -> Option<Making> {
        let work = lock(&self.0);
        work.as_ref().map(|work| Making {
            done: work.done.min(work.total),
            total: work.total,
            elapsed: work.begun.elapsed(),
        })
    }
}

impl Drop for Waiting<'_> {
    fn drop(&mut self) {
        let mut work = lock(&self.0.0);
        let is_last = work.as_mut().is_none_or(|work| {
            work.waiting -= 1;
            work.waiting == 0
        });
        if is_last {
            *work = None;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn work_counts_until_the_last_wait_ends() {
        let progress = Progress::default();
        assert_eq!(progress.now(), None);
        let first = progress.wait_for(64);
        progress.advance(16);
        let second = progress.wait_for(8);
        progress.advance(8);
        drop(first);
        let now = progress.now().unwrap();
        assert_eq!((now.done, now.total), (24, 72));
        drop(second);
        assert_eq!(progress.now(), None);
    }

    #[test]
    fn the_time_left_follows_from_the_rate() {
        let making = |done, seconds| Making { done, total: 512, elapsed: Duration::from_secs_f64(seconds) };
        assert_eq!(making(128, 2.0).left(), Some(Duration::from_secs(6)));
        assert_eq!((making(1, 2.0).left(), making(128, 0.1).left()), (None, None));
        assert_eq!(making(1, 2.0).to_string(), "making coarse levels: 0 % of 512 bricks read");
        assert_eq!(making(128, 2.0).to_string(), "making coarse levels: 25 % of 512 bricks read, about 6 s left");
        let long = "making coarse levels: 25 % of 512 bricks read, about 5 min left";
        assert_eq!(making(128, 100.0).to_string(), long);
    }
}
