//! Turns at making something: of threads that want the same at once, one makes it, and the others wait and find it.

use crate::mutex::lock;
use std::collections::HashSet;
use std::hash::Hash;
use std::sync::{Condvar, Mutex, PoisonError};

/// The keys taken now, one thread for each.
pub(crate) struct Turns<K> {
    taken: Mutex<HashSet<K>>,
    freed: Condvar,
}

/// A turn, which ends when dropped.
pub(crate) struct Turn<'a, K: Copy + Eq + Hash> {
    turns: &'a Turns<K>,
    key: K,
}

impl<K> Default for Turns<K> {
    fn default() -> Self {
        Self { taken: Mutex::default(), freed: Condvar::new() }
    }
}

impl<K: Copy + Eq + Hash> Turns<K> {
    /// Takes the turn of a key, after a wait for whoever has it.
    pub(crate) fn take(&self, key: K) -> Turn<'_, K> {
        let taken = self.freed.wait_while(lock(&self.taken), |taken| taken.contains(&key));
        taken.unwrap_or_else(PoisonError::into_inner).insert(key);
        Turn { turns: self, key }
    }
}

impl<K: Copy + Eq + Hash> Drop for Turn<'_, K> {
    fn drop(&mut self) {
        lock(&self.turns.taken).remove(&self.key);
        self.turns.freed.notify_all();
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::atomic::{AtomicU32, Ordering};

    #[test]
    fn one_thread_has_a_turn_and_other_keys_do_not_wait() {
        let (turns, inside) = (Turns::default(), AtomicU32::new(0));
        std::thread::scope(|scope| {
            for _ in 0..8 {
                scope.spawn(|| {
                    let _turn = turns.take(1);
                    assert_eq!(inside.fetch_add(1, Ordering::SeqCst), 0);
                    drop(turns.take(2));
                    inside.fetch_sub(1, Ordering::SeqCst);
                });
            }
        });
        assert!(lock(&turns.taken).is_empty());
    }
}
