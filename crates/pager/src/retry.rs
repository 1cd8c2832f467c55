//! Bricks that could not be read, and when they are read again.
//!
//! What fails for a reason that may pass is tried [`TRIES`] times, ever later, and then given up: it counts as failed. A new view
//! gives each of those one more try. So the tries of a view are bounded, whatever comes in between, and a view settles. What
//! fails for a lasting reason is not tried again. Tries are counted, not timed: offline pictures depend on how often a read
//! fails, not on when.

use crate::source::BrickError;
use brickyard_volume::BrickId;
use rustc_hash::{FxHashMap, FxHashSet};
use std::time::{Duration, Instant};

/// How often a brick is read before it is given up.
pub(crate) const TRIES: usize = 5;

/// How many milliseconds after each failed try the next may come.
const DELAYS_MS: [u64; TRIES] = [20, 80, 320, 1000, 1000];

/// Why a brick is not there, and when it may be read again.
#[derive(Clone, Debug)]
pub(crate) struct Failure {
    pub(crate) error: BrickError,
    /// When the brick may be read again; `None` if it has been given up.
    pub(crate) again: Option<Instant>,
}

/// All bricks of one source that could not be read.
#[derive(Default)]
pub(crate) struct Failures {
    bricks: FxHashMap<BrickId, Tried>,
    /// Bricks that were given up at any time: counted and logged once.
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
    /// Why the brick is not to be read now; `None` if it may be read.
    pub(crate) fn of(&self, id: BrickId) -> Option<Failure> {
        let tried = self.bricks.get(&id)?;
        let again = (!tried.is_given_up()).then(|| tried.next());
        let is_due = again.is_some_and(|again| again <= Instant::now());
        (!is_due).then(|| Failure { error: tried.error.clone(), again })
    }

    /// Takes note of a failed try. Returns whether the brick is now given up for the first time.
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

    /// Whether one more try that fails with this error would be the last one.
    pub(crate) fn is_last_try(&self, id: BrickId, error: &BrickError) -> bool {
        !error.is_passing || self.bricks.get(&id).map_or(0, |tried| tried.times) + 1 >= TRIES
    }

    /// Forgets the failures of a brick, which has been read.
    pub(crate) fn remove(&mut self, id: BrickId) {
        self.bricks.remove(&id);
    }

    /// Gives the bricks that were given up for a passing reason one more try. Returns which bricks these are.
    pub(crate) fn renew(&mut self) -> Vec<BrickId> {
        let given_up = self.bricks.iter_mut().filter(|(_, tried)| tried.error.is_passing && tried.is_given_up());
        given_up.map(|(&id, tried)| (tried.times = TRIES - 1, id).1).collect()
    }
}
