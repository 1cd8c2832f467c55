//! Times in files of one time step each, and the time axis of their series. Costs a few numbers per file.

use crate::note::Note;
use brickyard_volume::{TimeAxis, time_unit};

/// Times in a file of one time step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct StepTime {
    /// Time from one step to the next.
    pub increment: Option<TimeSpan>,
    /// Time of this step.
    pub stamp: Option<TimeSpan>,
}

/// A time in a unit.
#[derive(Clone, Debug, PartialEq)]
pub struct TimeSpan {
    /// Number of units; finite.
    pub number: f64,
    /// UDUNITS name of the unit; `None` if unknown.
    pub unit: Option<&'static str>,
}

impl TimeSpan {
    /// Creates a span from a file's number and name of the unit, in any spelling. `None` unless the number is finite.
    pub(crate) fn of(number: f64, unit: &str) -> Option<Self> {
        number.is_finite().then(|| Self { number, unit: time_unit(unit).ok() })
    }
}

impl StepTime {
    /// Time axis of steps in order: by their increment if common to all, else by their stamps if all have one and these ascend. Warns if they do not
    /// ascend.
    pub(crate) fn axis(steps: &[Self]) -> (Option<TimeAxis>, Option<Note>) {
        let increment = steps.first().and_then(|first| first.increment.as_ref()).filter(|it| it.number > 0.0);
        if let Some(TimeSpan { number, unit }) =
            increment.filter(|it| steps.iter().all(|s| s.increment.as_ref() == Some(it)))
        {
            let axis = TimeAxis { step: *number, unit: unit.map(str::to_owned), ..TimeAxis::default() };
            return (Some(axis), None);
        }
        let stamps: Option<Vec<&TimeSpan>> = steps.iter().map(|step| step.stamp.as_ref()).collect();
        let Some(stamps) = stamps.filter(|stamps| stamps.windows(2).all(|pair| pair[0].unit == pair[1].unit)) else {
            return (None, None);
        };
        // Each file may count from its own beginning.
        if stamps.len() < 2 || stamps.windows(2).all(|pair| pair[0].number == pair[1].number) {
            return (None, None);
        }
        match TimeAxis::of_stamps(stamps.iter().map(|stamp| stamp.number).collect(), stamps[0].unit.map(str::to_owned))
        {
            Ok(axis) => (Some(axis), None),
            Err(problem) => (None, Some(Note::warning(format!("The files' own times are left out: {problem}.")))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn increments_that_agree_count_then_stamps_that_ascend() {
        let step = |increment: Option<f64>, stamp: Option<f64>| StepTime {
            increment: increment.and_then(|number| TimeSpan::of(number, "ms")),
            stamp: stamp.and_then(|number| TimeSpan::of(number, "s")),
        };
        let axis = |steps: &[StepTime]| StepTime::axis(steps).0.map(|axis| (axis.step, axis.stamps, axis.unit));
        let in_unit = |unit: &str| Some(unit.to_string());
        assert_eq!(
            axis(&[step(Some(40.0), Some(3.0)), step(Some(40.0), None)]),
            Some((40.0, vec![], in_unit("millisecond")))
        );
        let unlike = [step(Some(40.0), Some(1.0)), step(Some(50.0), Some(3.0)), step(None, Some(9.0))];
        assert_eq!(axis(&unlike), Some((6.0, vec![1.0, 3.0, 9.0], in_unit("second"))));
        for none in
            [[step(None, None), step(None, Some(1.0))], [step(Some(0.0), Some(0.0)), step(Some(0.0), Some(0.0))]]
        {
            assert_eq!(StepTime::axis(&none), (None, None));
        }
        let (none, note) = StepTime::axis(&[step(None, Some(2.0)), step(None, Some(1.0))]);
        assert!(none.is_none() && note.is_some_and(|note| note.is_warning() && note.contains("are left out")));
    }
}
