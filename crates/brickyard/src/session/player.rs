//! The player of a live session: it advances the clock of time steps once per step of streaming, and chooses the shown
//! and the coming steps.
//!
//! The scene holds the requested step. A change of it is a jump; the shown step stays until the new one covers every
//! place, so no picture has a hole. Coming steps are streamed ahead for all layers; the pagers report their readiness.
//! All layers, pools and eyes take their step from here, so they change together.

use crate::session::resolve::ResolvedScene;
use brickyard_pager::{Clock, Playback, Readiness, ShownStep, Tally};
use std::time::Duration;

/// A coming time step, and its readiness.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ComingStep {
    /// The time step, and how much coarser it may be.
    pub step: ShownStep,
    /// Readiness of the step's bricks.
    pub ready: Readiness,
}

/// Chooses the shown step of a live session, and the steps streamed ahead.
#[derive(Default)]
pub(crate) struct Player {
    /// The clock, and its number of steps; `None` before the first step of streaming.
    clock: Option<(Clock, u32)>,
    /// The playback from the next step of streaming on; `None` for no change.
    change: Option<Option<Playback>>,
    /// The last scene's step.
    asked: u32,
    /// The coming steps at the last step of streaming.
    pub(crate) coming: Vec<ComingStep>,
}

impl Player {
    /// Advances the clock to the time `at`, for a scene. Returns the shown step and the coming ones, the nearest first.
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

    /// Forgets the readiness of steps, after the slots have lost their bricks.
    pub(crate) fn forget(&mut self) {
        self.coming.clear();
    }

    pub(crate) fn play(&mut self, playback: Option<Playback>) {
        self.change = Some(playback);
    }

    pub(crate) fn playback(&self) -> Option<Playback> {
        self.change.unwrap_or_else(|| self.clock.as_ref().and_then(|(clock, _)| clock.playback()))
    }

    pub(crate) fn is_seeking(&self) -> bool {
        self.clock.as_ref().is_some_and(|(clock, _)| clock.is_seeking())
    }

    pub(crate) fn tally(&self) -> Tally {
        self.clock.as_ref().map_or_else(Tally::default, |(clock, _)| clock.tally())
    }

    pub(crate) fn next_due(&self) -> Option<Duration> {
        self.clock.as_ref().and_then(|(clock, _)| clock.next_due())
    }
}
