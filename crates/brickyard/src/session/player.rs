//! A live session's player: it turns the clock of time steps once a step of streaming, and says which step is shown and which come next.
//!
//! The scene says which step is asked for. Another one than before is a jump; the step that was shown stays until something of the new one can
//! be drawn in every place, so no picture has a hole. What comes next is streamed ahead for all layers; how far it is, the pagers tell.
//! All layers, pools and eyes have their step from here, so they change together.

use crate::session::resolve::ResolvedScene;
use brickyard_pager::{Clock, Playback, Readiness, ShownStep, Tally};
use std::time::Duration;

/// A time step that comes next, and how far it is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ComingStep {
    /// The time step, and how much coarser it may be.
    pub step: ShownStep,
    /// How far the step's bricks are.
    pub ready: Readiness,
}

/// Which step a live session shows, and which it streams ahead.
#[derive(Default)]
pub(crate) struct Player {
    /// The clock, and the number of steps that it has; `None` before the first step of streaming.
    clock: Option<(Clock, u32)>,
    /// How steps are to follow one another from the next step of streaming on; `None` for no change.
    change: Option<Option<Playback>>,
    /// The step that the last scene asked for.
    asked: u32,
    /// What came next at the last step of streaming.
    coming: Vec<ComingStep>,
}

impl Player {
    /// Turns the clock to the time `at`, for a scene. Returns the step that is shown, and those that come next, the nearest first.
    pub(crate) fn turn(&mut self, scene: &ResolvedScene, at: Duration) -> (ShownStep, Vec<ShownStep>) {
        let steps = scene.timeline.steps();
        let playback = self.playback();
        let kept = self.clock.take().filter(|(_, before)| *before <= steps);
        let mut clock = match kept {
            Some((clock, _)) => clock,
            None => {
                self.asked = scene.time;
                self.change = Some(playback);
                Clock::new(scene.time, steps)
            }
        };
        clock.grow(steps, at);
        if let Some(change) = self.change.take() {
            clock.play(change, at);
        }
        if scene.time != self.asked {
            clock.seek(scene.time);
            self.asked = scene.time;
        }
        let known = |step: ShownStep| self.coming.iter().find(|known| known.step == step).map(|known| known.ready);
        let ready: Vec<Readiness> = clock.coming().map(|step| known(step).unwrap_or_default()).collect();
        clock.tick(at, &ready);
        let turned = (clock.shown(), clock.coming().collect());
        self.clock = Some((clock, steps));
        turned
    }

    /// Takes note of how far the steps are that come next.
    pub(crate) fn note(&mut self, coming: Vec<ComingStep>) {
        self.coming = coming;
    }

    /// Forgets how far steps are: the slots have lost their bricks.
    pub(crate) fn forget(&mut self) {
        self.coming.clear();
    }

    /// Changes how steps follow one another, from the next step of streaming on.
    pub(crate) fn play(&mut self, playback: Option<Playback>) {
        self.change = Some(playback);
    }

    /// How steps follow one another; `None` while they do not.
    pub(crate) fn playback(&self) -> Option<Playback> {
        self.change.unwrap_or_else(|| self.clock.as_ref().and_then(|(clock, _)| clock.playback()))
    }

    /// Whether a step that was jumped to is not shown yet.
    pub(crate) fn is_seeking(&self) -> bool {
        self.clock.as_ref().is_some_and(|(clock, _)| clock.is_seeking())
    }

    /// What has been shown while playing.
    pub(crate) fn tally(&self) -> Tally {
        self.clock.as_ref().map_or_else(Tally::default, |(clock, _)| clock.tally())
    }

    /// When the next step is due; `None` if none is.
    pub(crate) fn next_due(&self) -> Option<Duration> {
        self.clock.as_ref().and_then(|(clock, _)| clock.next_due())
    }
}
