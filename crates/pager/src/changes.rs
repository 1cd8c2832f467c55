//! The times at which bricks last came, went or failed, by volume and time step: what was found of them before holds until then.

use crate::goal::{Goal, VolumeBrick};
use rustc_hash::FxHashMap;

/// When a brick of a volume's time step last came, went or failed.
#[derive(Default)]
pub(crate) struct Changes {
    /// The number of changes so far.
    count: u64,
    /// Which of them was the last one, by volume and time step.
    last: FxHashMap<(usize, u32), u64>,
}

impl Changes {
    /// Takes note that a brick has come, gone or failed.
    pub(crate) fn note(&mut self, VolumeBrick { volume, id }: VolumeBrick) {
        self.count += 1;
        self.last.insert((volume, id.time), self.count);
    }

    /// The last change of what these goals are about: another number means another state.
    pub(crate) fn last_of(&self, goals: &[Goal<'_>]) -> u64 {
        let times = goals.iter().map(|goal| goal.cut.view.time).enumerate();
        times.filter_map(|of_volume| self.last.get(&of_volume)).max().copied().unwrap_or_default()
    }

    /// Forgets the time steps of which `is_kept` is not true.
    pub(crate) fn keep(&mut self, is_kept: impl Fn(u32) -> bool) {
        self.last.retain(|(_, time), _| is_kept(*time));
    }
}
