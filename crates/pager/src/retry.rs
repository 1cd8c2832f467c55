//! Unreadable bricks and their retries.
//!
//! A brick is tried [`TRIES`] times after passing failures, at growing delays, and then given up: it counts as failed. A new
//! view grants one more try, so the tries per view are bounded and every view settles. Lasting failures are not retried. Tries
//! are counted, not timed: offline pictures depend on the number of failed reads, not on their timing.

use crate::source::BrickError;
use brickyard_volume::BrickId;
use rustc_hash::{FxHashMap, FxHashSet};
use std::time::{Duration, Instant};

/// Reads of a brick before it is given up.
pub(crate) const TRIES: usize = 5;

/// Delay in milliseconds before the next try, after each failed one.
const DELAYS_MS: [u64; TRIES] = [20, 80, 320, 1000, 1000];

/// The reason a brick is missing, and the time of the next try.
#[derive(Clone, Debug)]
pub(crate) struct Failure {
    pub(crate) error: BrickError,
    /// Earliest time of the next read; `None` if given up.
    pub(crate) again: Option<Instant>,
}

impl From<BrickError> for Failure {
    fn from(error: BrickError) -> Self {
        Self { error, again: None }
    }
}

/// The unreadable bricks of one source.
#[derive(Default)]
pub(crate) struct Failures {
    bricks: FxHashMap<BrickId, Tried>,
    /// Bricks given up at any time: counted and logged once.
    noted: FxHashSet<BrickId>,
}

struct Tried {
    error: BrickError,
    times: usize,
    last: Instant,
}

impl Tried {
    fn is_given_up(&self) -> bool {
        !self.error.is_passing || self.times >= TRIES
    }

    fn next(&self) -> Instant {
        self.last + Duration::from_millis(DELAYS_MS[self.times.clamp(1, TRIES) - 1])
    }
}

impl Failures {
    /// The failure that bars a brick from being read now; `None` if it may be read.
    pub(crate) fn of(&self, id: BrickId) -> Option<Failure> {
        let tried = self.bricks.get(&id)?;
        let again = (!tried.is_given_up()).then(|| tried.next());
        let is_due = again.is_some_and(|again| again <= Instant::now());
        (!is_due).then(|| Failure { error: tried.error.clone(), again })
    }

    /// Records a failed try. Returns whether the brick is now given up for the first time.
    pub(crate) fn add(&mut self, id: BrickId, error: BrickError) -> bool {
        let times = self.bricks.get(&id).map_or(0, |tried| tried.times) + 1;
        let tried = Tried { error, times, last: Instant::now() };
        let (is_given_up, is_first) = (tried.is_given_up(), times == 1);
        if is_first && !is_given_up {
            tracing::warn!("{}; it is tried again", tried.error);
        }
        self.bricks.insert(id, tried);
        is_given_up && self.noted.insert(id)
    }

    /// Whether one more try failing with this error would be the last.
    pub(crate) fn is_last_try(&self, id: BrickId, error: &BrickError) -> bool {
        !error.is_passing || self.bricks.get(&id).map_or(0, |tried| tried.times) + 1 >= TRIES
    }

    pub(crate) fn remove(&mut self, id: BrickId) {
        self.bricks.remove(&id);
    }

    /// Grants one more try to bricks given up for a passing reason, and returns them.
    pub(crate) fn renew(&mut self) -> Vec<BrickId> {
        let given_up = self.bricks.iter_mut().filter(|(_, tried)| tried.error.is_passing && tried.is_given_up());
        given_up.map(|(&id, tried)| (tried.times = TRIES - 1, id).1).collect()
    }
}
