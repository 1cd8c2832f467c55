//! Ordered hand-over of results from many workers to one consumer, by number, so output is independent of threads; a
//! worker far ahead waits, so memory is bounded.

use crate::mutex::lock;
use std::collections::BTreeMap;
use std::sync::{Condvar, Mutex, PoisonError};

pub(crate) struct Sequence<T> {
    state: Mutex<State<T>>,
    changed: Condvar,
    /// Greatest distance of a waiting item past the next number.
    ahead: u64,
}

struct State<T> {
    waiting: BTreeMap<u64, T>,
    next: u64,
    end: End,
}

#[derive(Clone, Copy, PartialEq)]
enum End {
    No,
    /// No items will follow the waiting ones.
    Closed,
    /// A failure: everyone stops.
    Aborted,
}

impl<T> Sequence<T> {
    pub(crate) fn new(ahead: u64) -> Self {
        let state = State { waiting: BTreeMap::new(), next: 0, end: End::No };
        Self { state: Mutex::new(state), changed: Condvar::new(), ahead }
    }

    /// Delivers item `number`; waits while it is too far ahead. Returns `false` once the sequence is aborted.
    pub(crate) fn put(&self, number: u64, item: T) -> bool {
        let state = lock(&self.state);
        let too_far = |s: &mut State<T>| s.end != End::Aborted && number > s.next + self.ahead;
        let mut state = self.changed.wait_while(state, too_far).unwrap_or_else(PoisonError::into_inner);
        if state.end == End::Aborted {
            return false;
        }
        state.waiting.insert(number, item);
        if number == state.next {
            self.changed.notify_all();
        }
        true
    }

    /// Waits for the next item and takes it; `None` at the end, or once the sequence is aborted.
    pub(crate) fn take(&self) -> Option<T> {
        let state = lock(&self.state);
        let missing = |s: &mut State<T>| match s.end {
            End::No => !s.waiting.contains_key(&s.next),
            End::Closed | End::Aborted => false,
        };
        let mut state = self.changed.wait_while(state, missing).unwrap_or_else(PoisonError::into_inner);
        if state.end == End::Aborted {
            return None;
        }
        let next = state.next;
        let item = state.waiting.remove(&next)?;
        state.next += 1;
        self.changed.notify_all();
        Some(item)
    }

    /// Ends the sequence: no more items will follow.
    pub(crate) fn close(&self) {
        self.end(End::Closed);
    }

    /// Aborts the sequence, stopping everyone who puts or takes an item, or waits to.
    pub(crate) fn abort(&self) {
        self.end(End::Aborted);
    }

    /// Returns a guard that aborts the sequence if its thread unwinds. Others would wait forever for that thread's
    /// items.
    pub(crate) fn stop_on_panic(&self) -> impl Drop {
        StopOnPanic(self)
    }

    pub(crate) fn is_aborted(&self) -> bool {
        lock(&self.state).end == End::Aborted
    }

    fn end(&self, end: End) {
        let mut state = lock(&self.state);
        if state.end != End::Aborted {
            state.end = end;
        }
        self.changed.notify_all();
    }
}

struct StopOnPanic<'a, T>(&'a Sequence<T>);

impl<T> Drop for StopOnPanic<'_, T> {
    fn drop(&mut self) {
        if std::thread::panicking() {
            self.0.abort();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn items_come_in_order_and_only_so_far_ahead() {
        let sequence = Sequence::new(2);
        let most_waiting = std::thread::scope(|scope| {
            for worker in 0..3u64 {
                let sequence = &sequence;
                scope.spawn(move || (0..100).for_each(|i| assert!(sequence.put(i * 3 + worker, i * 3 + worker))));
            }
            let mut most = 0;
            for expected in 0..300 {
                assert_eq!(sequence.take(), Some(expected));
                most = most.max(lock(&sequence.state).waiting.len());
            }
            most
        });
        assert!(most_waiting <= 3, "{most_waiting}");
        sequence.close();
        assert_eq!(sequence.take(), None);
    }

    #[test]
    fn aborting_wakes_everyone() {
        let sequence = Sequence::new(0);
        std::thread::scope(|scope| {
            let ahead = scope.spawn(|| sequence.put(5, ()));
            let taker = scope.spawn(|| sequence.take());
            std::thread::sleep(std::time::Duration::from_millis(5));
            sequence.abort();
            assert!(!ahead.join().unwrap());
            assert_eq!(taker.join().unwrap(), None);
        });
    }
}
