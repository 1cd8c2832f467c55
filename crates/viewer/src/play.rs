//! Playback settings, in a window's document and for its sessions.

use brickyard::pager::{Ending, Playback, Policy};
use serde::{Deserialize, Serialize};

/// Settings of playback in a window.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub(crate) struct Play {
    pub(crate) on: bool,
    pub(crate) steps_per_second: f64,
    /// Whether it starts by running backwards.
    pub(crate) backward: bool,
    #[serde(with = "EndingWords")]
    pub(crate) ending: Ending,
    #[serde(with = "PolicyWords")]
    pub(crate) policy: Policy,
    /// Whether the voxel's values under the pointer are drawn over the bar of steps.
    pub(crate) curve: bool,
}

/// The words of a document for the behaviour after the last step.
#[derive(Serialize, Deserialize)]
#[serde(remote = "Ending", rename_all = "lowercase")]
enum EndingWords {
    /// Stop.
    Stop,
    /// Go to the first step.
    Loop,
    /// Turn around: to and fro.
    Bounce,
}

/// The words of a document for the behaviour where the rate cannot be held.
#[derive(Serialize, Deserialize)]
#[serde(remote = "Policy", rename_all = "kebab-case")]
enum PolicyWords {
    /// Lower the level.
    HoldRate,
    /// Skip steps.
    HoldQuality,
    /// Take more time.
    EveryStep,
}

/// Possible rates, in steps per second.
pub(crate) const RATES: std::ops::RangeInclusive<f64> = 0.1..=1000.0;

impl Default for Play {
    fn default() -> Self {
        let (ending, policy) = (Ending::Loop, Policy::HoldRate);
        Self { on: false, steps_per_second: 10.0, backward: false, ending, policy, curve: false }
    }
}

impl Play {
    /// The playback for sessions; `None` while nothing plays.
    pub(crate) fn playback(&self) -> Option<Playback> {
        // A document may hold any number.
        let rate = if self.steps_per_second.is_nan() { *RATES.start() } else { self.steps_per_second };
        let playback = Playback {
            steps_per_second: rate.clamp(*RATES.start(), *RATES.end()),
            is_backward: self.backward,
            ending: self.ending,
            policy: self.policy,
        };
        self.on.then_some(playback)
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Arbitrary settings.
    pub(crate) fn play() -> impl Strategy<Value = Play> {
        let endings = prop::sample::select(vec![Ending::Stop, Ending::Loop, Ending::Bounce]);
        let policies = prop::sample::select(vec![Policy::HoldRate, Policy::HoldQuality, Policy::EveryStep]);
        (any::<[bool; 3]>(), 0.1..1000.0, endings, policies).prop_map(
            |([on, backward, curve], steps_per_second, ending, policy)| Play {
                on,
                steps_per_second,
                backward,
                ending,
                policy,
                curve,
            },
        )
    }

    #[test]
    fn rates_of_documents_are_brought_into_their_range() {
        for (written, rate) in [(f64::NAN, 0.1), (-1.0, 0.1), (0.0, 0.1), (24.0, 24.0), (1e300, 1000.0)] {
            let play = Play { on: true, steps_per_second: written, ..Play::default() };
            assert_eq!(play.playback().map(|playback| playback.steps_per_second), Some(rate));
        }
        assert_eq!(Play::default().playback(), None);
    }
}
