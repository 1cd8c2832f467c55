//! A time step that comes next: which of its bricks are there, and which it lacks.
//!
//! Finding that out takes a look-up for each node of the step's cuts, in every frame for all steps that come. So it is kept, until a brick of the step
//! comes, goes or fails: [`Changes`] counts that. Cost: some 64 bytes for each brick that a step wants.

use crate::changes::Changes;
use crate::cut::Cut;
use crate::goal::{Goal, VolumeBrick};
use crate::status::Readiness;

/// What is known of a time step that comes next.
pub(crate) struct StepAhead {
    /// What this is known of: the step's cuts, and the last change of their bricks.
    cuts: Vec<Cut>,
    last_change: u64,
    /// The bricks that the step would be drawn with now.
    pub(crate) there: Vec<VolumeBrick>,
    /// The bricks that the step lacks, in the order in which they are to be read.
    pub(crate) lacking: Vec<VolumeBrick>,
    pub(crate) readiness: Readiness,
}

impl StepAhead {
    /// Takes note of what a step has, and lacks, after the last of these changes.
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

    /// Whether these goals are the ones that this is known of, and nothing has changed since.
    pub(crate) fn is_of(&self, goals: &[Goal<'_>], changes: &Changes) -> bool {
        let of_bricks = |cut: &Cut| (cut.view.time, cut.view.channel, cut.member);
        let is_same =
            |(own, goal): (&Cut, &Goal<'_>)| own.shares_tree_with(goal.cut) && of_bricks(own) == of_bricks(goal.cut);
        self.cuts.len() == goals.len()
            && self.cuts.iter().zip(goals).all(is_same)
            && self.last_change == changes.last_of(goals)
    }
}
