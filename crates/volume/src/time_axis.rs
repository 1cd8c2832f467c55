//! The time axis of a volume: when each of its time steps was taken, and which step shows a moment.

use serde::{Deserialize, Serialize};

/// When each time step of a volume was taken.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TimeAxis {
    /// The time of step 0.
    pub start: f64,
    /// The time from one step to the next where all steps are evenly spaced; positive.
    pub step: f64,
    /// The time of each step, ascending, where they are not evenly spaced; empty where they are.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stamps: Vec<f64>,
    /// UDUNITS name of the unit of time (`second`); `None` where nobody gave one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
}

/// Steps that are counted: step 0 at time 0, each 1 after the last.
impl Default for TimeAxis {
    fn default() -> Self {
        Self { start: 0.0, step: 1.0, stamps: Vec::new(), unit: None }
    }
}

impl TimeAxis {
    /// The time of a step.
    pub fn at(&self, step: u32) -> f64 {
        self.stamps.get(step as usize).copied().unwrap_or(self.start + self.step * f64::from(step))
    }

    /// The step, of `times` steps, that shows a moment: the last one that is not after it, or step 0 before all of them. A moment
    /// within a millionth of a step of the next one counts as that.
    pub fn step_at(&self, time: f64, times: u32) -> u32 {
        let last = times.saturating_sub(1);
        if self.stamps.is_empty() {
            // Saturates, and a moment that is none is step 0.
            return (((time - self.start) / self.step + 1e-6).floor() as u32).min(last);
        }
        let is_past = |&stamp: &f64| stamp <= time + 1e-6 * self.step;
        (self.stamps.partition_point(is_past).saturating_sub(1) as u32).min(last)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_step_is_shown_at_its_own_time_and_until_the_next() {
        let even = TimeAxis { start: -0.3, step: 0.1, ..TimeAxis::default() };
        let uneven = TimeAxis { stamps: vec![0.0, 0.5, 0.75, 3.0], step: 0.25, ..TimeAxis::default() };
        for (axis, times) in [(even, 1000), (uneven, 4)] {
            for step in 0..times {
                let time = axis.at(step);
                assert_eq!(axis.step_at(time, times), step);
                assert_eq!(axis.step_at(time + 0.9 * axis.step, times), step, "{step}");
            }
            assert_eq!([f64::NEG_INFINITY, f64::NAN].map(|time| axis.step_at(time, times)), [0, 0]);
            assert_eq!(axis.step_at(f64::INFINITY, times), times - 1);
        }
    }
}
