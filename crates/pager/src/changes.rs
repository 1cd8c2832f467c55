//! Times at which bricks last arrived, left or failed, by volume and time step. Earlier findings hold until then.

use crate::goal::{Goal, VolumeBrick};
use rustc_hash::FxHashMap;

/// Times of the last arrival, departure or failure of a brick, by volume and time step.
#[derive(Default)]
pub(crate) struct Changes {
    /// Number of changes so far.
    count: u64,
    /// Number of the last change, by volume and time step.
    last: FxHashMap<(usize, u32), u64>,
}

impl Changes {
    /// Records the arrival, eviction or failure of a brick.
    pub(crate) fn note(&mut self, VolumeBrick { volume, id }: VolumeBrick) {
        self.count += 1;
        self.last.insert((volume, id.time), self.count);
    }

    /// Number of the last change that concerns these goals: another number means another state.
    pub(crate) fn last_of(&self, goals: &[Goal<'_>]) -> u64 {
        let times = goals.iter().map(|goal| goal.cut.view.time).enumerate();
        times.filter_map(|of_volume| self.last.get(&of_volume)).max().copied().unwrap_or_default()
    }

    pub(crate) fn keep(&mut self, is_kept: impl Fn(u32) -> bool) {
        self.last.retain(|(_, time), _| is_kept(*time));
    }
}
