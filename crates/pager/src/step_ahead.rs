//! A coming time step: its present and missing bricks.
//!
//! Finding them takes a look-up per node of the step's cuts, every frame. The result is therefore kept until a brick of the step
//! arrives, leaves or fails, as counted by [`Changes`]. Costs some 64 bytes per wanted brick.

use crate::changes::Changes;
use crate::cut::Cut;
use crate::goal::{Goal, VolumeBrick};
use crate::status::Readiness;

/// Progress of a coming time step.
pub(crate) struct StepAhead {
    /// Validity of this state: the step's cuts, and the last change of their bricks.
    cuts: Vec<Cut>,
    last_change: u64,
    /// Bricks with which the step would be drawn now.
    pub(crate) there: Vec<VolumeBrick>,
    /// Missing bricks of the step, in the order of reading.
    pub(crate) lacking: Vec<VolumeBrick>,
    pub(crate) readiness: Readiness,
}

impl StepAhead {
    pub(crate) fn new(
        goals: &[Goal<'_>],
        changes: &Changes,
        there: Vec<VolumeBrick>,
        lacking: Vec<VolumeBrick>,
        is_drawn_everywhere: bool,
    ) -> Self {
        let is_whole = lacking.is_empty();
        let readiness = Readiness {
            wanted: goals.iter().map(|goal| goal.cut.wanted()).sum(),
            is_planned: true,
            missing: lacking.len(),
            is_covered: is_drawn_everywhere || is_whole,
            is_whole,
        };
        let cuts = goals.iter().map(|goal| goal.cut.clone()).collect();
        Self { cuts, last_change: changes.last_of(goals), there, lacking, readiness }
    }

    /// Whether this is the present state of these goals.
    pub(crate) fn is_of(&self, goals: &[Goal<'_>], changes: &Changes) -> bool {
        let of_bricks = |cut: &Cut| (cut.view.time, cut.view.channel, cut.member);
        let is_same =
            |(own, goal): (&Cut, &Goal<'_>)| own.shares_tree_with(goal.cut) && of_bricks(own) == of_bricks(goal.cut);
        self.cuts.len() == goals.len()
            && self.cuts.iter().zip(goals).all(is_same)
            && self.last_change == changes.last_of(goals)
    }
}
