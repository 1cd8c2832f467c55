//! The time axis of a volume: the times of its steps, and the step for any moment.

use crate::numbers::significant;
use crate::time_unit::time_symbol;
use serde::{Deserialize, Serialize};

/// Tolerance of evenly spaced stamps, as a part of a step.
const EVEN: f64 = 1e-6;

/// The times of a volume's steps.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct TimeAxis {
    /// The time of step 0.
    pub start: f64,
    /// The interval of evenly spaced steps; positive.
    pub step: f64,
    /// The time of each step, ascending, if not evenly spaced; else empty.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stamps: Vec<f64>,
    /// UDUNITS name of the unit of time (`second`); `None` if unknown.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub unit: Option<String>,
    /// The moment from which the times count (`2000-01-01`), if the file says it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub since: Option<String>,
}

/// Counted steps: step 0 at time 0, each 1 after the last.
impl Default for TimeAxis {
    fn default() -> Self {
        Self { start: 0.0, step: 1.0, stamps: Vec::new(), unit: None, since: None }
    }
}

/// Why a time axis is invalid: the field, its expected contents, and its contents.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{field}: expected {expected}, found {found}")]
pub struct TimeProblem {
    /// The name of the field.
    pub field: &'static str,
    /// The field's expected contents.
    pub expected: String,
    /// The field's contents.
    pub found: String,
}

impl TimeAxis {
    /// Creates the axis of steps at these times: without stamps if they are evenly spaced. Otherwise its step is their median
    /// difference.
    ///
    /// # Errors
    /// If the times are not ascending, or one is not finite.
    pub fn of_stamps(stamps: Vec<f64>, unit: Option<String>) -> Result<Self, TimeProblem> {
        let mut gaps: Vec<f64> = stamps.windows(2).map(|pair| pair[1] - pair[0]).collect();
        gaps.sort_by(f64::total_cmp);
        let step = if gaps.is_empty() { 1.0 } else { gaps[gaps.len() / 2] };
        let axis = Self { start: stamps.first().copied().unwrap_or(0.0), step, stamps, unit, since: None };
        axis.check(axis.stamps.len() as u32)?;
        let (first, last) = (axis.start, axis.stamps.last().copied().unwrap_or(axis.start));
        let mean = if gaps.is_empty() { 1.0 } else { (last - first) / gaps.len() as f64 };
        let even = Self { step: mean, stamps: Vec::new(), ..axis.clone() };
        let is_even = (0..).zip(&axis.stamps).all(|(i, stamp)| (even.at(i) - stamp).abs() <= EVEN * even.step);
        if !is_even {
            return Ok(axis);
        }
        // Prefer the difference of two stamps, without a division's rounding, if both fit.
        let is_same =
            (0..).zip(&axis.stamps).all(|(i, stamp)| (first + step * f64::from(i) - stamp).abs() <= EVEN * step);
        Ok(if is_same { Self { step, ..even } } else { even })
    }

    /// Returns the axis of these `times` steps, at least one, and one more at `stamp`: this very axis if `stamp` continues it evenly.
    ///
    /// # Errors
    /// If `stamp` is not a time after the last step.
    pub fn followed_by(&self, times: u32, stamp: f64) -> Result<Self, TimeProblem> {
        let last = self.at(times.saturating_sub(1));
        if !(stamp.is_finite() && stamp > last) {
            let expected = format!("a time after {last} of step {}", times.saturating_sub(1));
            return Err(TimeProblem { field: "stamp", expected, found: stamp.to_string() });
        }
        if self.stamps.is_empty() && (self.at(times) - stamp).abs() <= EVEN * self.step {
            return Ok(self.clone());
        }
        let stamps = (0..times).map(|step| self.at(step)).chain([stamp]).collect();
        Ok(Self { since: self.since.clone(), ..Self::of_stamps(stamps, self.unit.clone())? })
    }

    /// Checks that the axis fits `times` steps: finite, ascending times.
    ///
    /// # Errors
    /// The first invalid field.
    pub fn check(&self, times: u32) -> Result<(), TimeProblem> {
        let Self { start, step, stamps, .. } = self;
        let last = start + step * f64::from(times.saturating_sub(1));
        let is_descent = |pair: &[f64]| pair[0] >= pair[1];
        let (field, expected, found) = if !(step.is_finite() && *step > 0.0) {
            ("step", "a positive number".into(), step.to_string())
        } else if !start.is_finite() {
            ("start", "a finite number".into(), start.to_string())
        } else if !last.is_finite() {
            ("step", "a step with finite times for all steps".into(), step.to_string())
        } else if !stamps.is_empty() && stamps.len() != times as usize {
            ("stamps", format!("{times}, one for each time step"), stamps.len().to_string())
        } else if let Some(stamp) = stamps.iter().find(|stamp| !stamp.is_finite()) {
            ("stamps", "finite numbers".into(), stamp.to_string())
        } else if let Some(i) = stamps.windows(2).position(is_descent) {
            let found = format!("{} of step {} after {} of step {i}", stamps[i + 1], i + 1, stamps[i]);
            ("stamps", "ascending times".into(), found)
        } else {
            return Ok(());
        };
        Err(TimeProblem { field, expected, found })
    }

    /// Formats a time with the symbol of the unit.
    pub fn in_words(&self, time: f64) -> String {
        // Steps are added up: the last of an f64's 16 digits are rounding.
        let time = significant(time, 14);
        match &self.unit {
            Some(unit) => format!("{time} {}", time_symbol(unit)),
            None => time,
        }
    }

    /// Describes the steps' times, as in `0.5 s apart, from 0 s`.
    pub fn describe(&self) -> String {
        match (self.stamps.first(), self.stamps.last()) {
            (Some(first), Some(last)) => {
                format!("irregular, from {} to {}", self.in_words(*first), self.in_words(*last))
            }
            _ => format!("{} apart, from {}", self.in_words(self.step), self.in_words(self.start)),
        }
    }

    /// The time of a step.
    pub fn at(&self, step: u32) -> f64 {
        self.stamps.get(step as usize).copied().unwrap_or(self.start + self.step * f64::from(step))
    }

    /// The step, of `times` steps, shown at a moment: the last one not after it, or step 0 before all of them. A moment within a
    /// millionth of a step before the next one already shows the next.
    pub fn step_at(&self, time: f64, times: u32) -> u32 {
        let last = times.saturating_sub(1);
        if self.stamps.is_empty() {
            // Saturates, and NaN is step 0.
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

    #[test]
    fn stamps_that_are_even_are_a_step() {
        let even: Vec<f64> = (0..7).map(|i| 0.1 * f64::from(i) + 3.0).collect();
        let axis = TimeAxis::of_stamps(even.clone(), Some("second".into())).unwrap();
        assert!(axis.stamps.is_empty() && axis.start == 3.0, "{axis:?}");
        assert!((0..).zip(&even).all(|(i, stamp)| (axis.at(i) - stamp).abs() < 1e-12));
        let uneven = vec![0.0, 0.5, 0.75, 3.0];
        let axis = TimeAxis::of_stamps(uneven.clone(), None).unwrap();
        assert_eq!((axis.start, axis.step, &axis.stamps), (0.0, 0.5, &uneven));
        let one = TimeAxis::of_stamps(vec![4.0], None).unwrap();
        assert_eq!((one.start, one.step, one.stamps), (4.0, 1.0, vec![]));
    }

    #[test]
    fn an_axis_goes_on_evenly_as_long_as_its_steps_do() {
        let mut axis = TimeAxis {
            start: 1.0,
            step: 0.1,
            since: Some("2000-01-01".into()),
            unit: Some("day".into()),
            stamps: Vec::new(),
        };
        for times in 1..50 {
            assert_eq!(axis.followed_by(times, 1.0 + 0.1 * f64::from(times)), Ok(axis.clone()));
        }
        // The step of a single one is known when the second comes.
        axis = axis.followed_by(1, 1.5).unwrap();
        assert_eq!((axis.step, &axis.stamps[..]), (0.5, &[][..]));
        axis = axis.followed_by(2, 2.25).unwrap();
        assert_eq!((axis.start, &axis.stamps[..], axis.unit.as_deref()), (1.0, &[1.0, 1.5, 2.25][..], Some("day")));
        assert_eq!(axis.since.as_deref(), Some("2000-01-01"));
        assert_eq!(axis.followed_by(3, 9.0).unwrap().stamps, [1.0, 1.5, 2.25, 9.0]);
        for stamp in [2.25, 0.0, f64::NAN, f64::INFINITY] {
            let problem = axis.followed_by(3, stamp).unwrap_err().to_string();
            assert_eq!(problem, format!("stamp: expected a time after 2.25 of step 2, found {stamp}"));
        }
    }

    #[test]
    fn what_is_no_axis_names_its_field() {
        let of = |stamps: &[f64]| TimeAxis::of_stamps(stamps.to_vec(), None).unwrap_err().to_string();
        assert_eq!(of(&[0.0, 2.0, 1.0]), "stamps: expected ascending times, found 1 of step 2 after 2 of step 1");
        assert!(of(&[0.0, 1.0, 1.0, 5.0]).contains("1 of step 2 after 1 of step 1"));
        assert!(of(&[0.0, f64::NAN, 1.0, 2.0, 3.0]).contains("NaN"));
        for (axis, field) in [
            (TimeAxis { step: 0.0, ..TimeAxis::default() }, "step"),
            (TimeAxis { step: f64::NAN, ..TimeAxis::default() }, "step"),
            (TimeAxis { step: 1e308, ..TimeAxis::default() }, "step"),
            (TimeAxis { start: f64::INFINITY, ..TimeAxis::default() }, "start"),
            (TimeAxis { stamps: vec![0.0, 1.0], ..TimeAxis::default() }, "stamps"),
        ] {
            assert_eq!(axis.check(3).unwrap_err().field, field);
        }
        assert_eq!(TimeAxis::default().check(3), Ok(()));
    }

    #[test]
    fn an_axis_is_told_in_words() {
        let axis = TimeAxis { step: 0.5, unit: Some("second".into()), ..TimeAxis::default() };
        assert_eq!(axis.describe(), "0.5 s apart, from 0 s");
        let axis = TimeAxis::of_stamps(vec![-1.0, 0.5, 9.0], Some("day".into())).unwrap();
        assert_eq!(axis.describe(), "irregular, from -1 d to 9 d");
        assert_eq!(TimeAxis::default().describe(), "1 apart, from 0");
        assert_eq!([3.0, 23.0].map(|step| axis.in_words(0.1 * step)), ["0.3 d", "2.3 d"]);
    }
}
