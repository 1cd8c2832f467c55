//! The meeting of the window and a session returning from beside it: either the window waits for the session, or the session wakes the window. Costs
//! a lock. `tests/loom` checks every interleaving.

#[cfg(loom)]
use loom::sync::{Condvar, Mutex, MutexGuard};
#[cfg(not(loom))]
use std::sync::{Condvar, Mutex, MutexGuard};

use std::sync::PoisonError;
use std::time::{Duration, Instant};

#[derive(Default)]
pub(crate) struct Meeting {
    end: Mutex<End>,
    arrived: Condvar,
}

#[derive(Default)]
struct End {
    /// Whether the session can be taken home. Its thread may still be ending.
    is_due: bool,
    /// Whether the window is waiting and needs no wake-up.
    is_awaited: bool,
}

impl Meeting {
    /// Records the session's arrival. Returns whether the window is waiting; if not, the caller has to wake it.
    pub(crate) fn arrive(&self) -> bool {
        let is_awaited = {
            let mut end = self.lock();
            end.is_due = true;
            end.is_awaited
        };
        if is_awaited {
            self.arrived.notify_one();
        }
        is_awaited
    }

    pub(crate) fn is_due(&self) -> bool {
        self.lock().is_due
    }

    /// Waits `at_most` for the session. Returns whether it has arrived.
    pub(crate) fn wait(&self, at_most: Duration) -> bool {
        let begun = Instant::now();
        let mut end = self.lock();
        end.is_awaited = true;
        while !end.is_due
            && let Some(left) = at_most.checked_sub(begun.elapsed()).filter(|left| !left.is_zero())
        {
            let woken = self.arrived.wait_timeout(end, left);
            (end, _) = woken.unwrap_or_else(PoisonError::into_inner);
        }
        end.is_awaited = false;
        end.is_due
    }

    fn lock(&self) -> MutexGuard<'_, End> {
        self.end.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
