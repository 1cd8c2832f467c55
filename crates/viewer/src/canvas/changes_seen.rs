//! The changes of the requested scene, and the times until their first pictures.

use super::picture::Shown;
use brickyard::volume::Scene;
use std::time::{Duration, Instant};

/// Time since the last answer after which a change counts as a first one, such as the press at the start of a drag.
const REST: Duration = Duration::from_millis(250);

/// Changes of the scene so far.
#[derive(Default)]
pub(super) struct ChangesSeen {
    /// The number of changes.
    pub(super) count: u64,
    /// The last requested scene.
    last: Option<Scene>,
    /// Time and number of the first change without an answer.
    asked: Option<(Instant, u64)>,
    pub(super) answers: Vec<Answer>,
    /// The time of the last answer.
    answered: Option<Instant>,
}

/// Time from a change of the scene to its first picture.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Answer {
    pub(crate) took: Duration,
    /// Whether the view was at rest before.
    pub(crate) is_first: bool,
}

impl ChangesSeen {
    /// Records the requested scene, with `shown` on display.
    pub(super) fn see(&mut self, scene: &Scene, shown: Option<&Shown>) {
        if self.last.as_ref() == Some(scene) {
            return;
        }
        self.last = Some(scene.clone());
        self.count += 1;
        if shown.is_some_and(|shown| shown.of.scene != *scene) {
            self.asked.get_or_insert((Instant::now(), self.count));
        }
    }

    /// Records a picture requested after this many changes.
    pub(super) fn answer(&mut self, count: u64) {
        if let Some((at, _)) = self.asked.take_if(|(_, asked)| *asked <= count) {
            let is_first = self.answered.is_none_or(|answered| at.saturating_duration_since(answered) > REST);
            self.answers.push(Answer { took: at.elapsed(), is_first });
            self.answered = Some(Instant::now());
        }
    }
}
