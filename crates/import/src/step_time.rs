//! Times in files of one time step each, and the time axis of their series. Costs a few numbers per file.

use crate::note::Note;
use brickyard_volume::{TimeAxis, time_unit};

/// Most bytes of the moment from which times count.
const LONGEST_MOMENT: usize = 64;

/// Whether a text can name the moment from which times count: it is short, and has one line.
pub(crate) fn is_moment(text: &str) -> bool {
    text.len() <= LONGEST_MOMENT && !text.chars().any(char::is_control)
}

/// The moment in a field of its own; `None` unless the field has a text that can be one.
pub(crate) fn moment_in(field: &str) -> Option<String> {
    Some(field.trim()).filter(|text| !text.is_empty() && is_moment(text)).map(str::to_owned)
}

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
    /// The moment from which it counts, as [`TimeAxis::since`].
    pub since: Option<String>,
}

impl TimeSpan {
    /// Creates a span from a file's number and name of the unit, in any spelling. `None` unless the number is finite.
    pub(crate) fn of(number: f64, unit: &str) -> Option<Self> {
        number.is_finite().then(|| Self { number, unit: time_unit(unit).ok(), since: None })
    }

    /// Whether two times are in one unit, and count from one moment, as far as their files say it.
    fn counts_as(&self, other: &Self) -> bool {
        (self.unit, &self.since) == (other.unit, &other.since)
    }

    /// The time with its unit and moment, as in `4.5 hour since 2026-01-01`.
    pub fn in_words(&self) -> String {
        let unit = self.unit.map_or(String::new(), |unit| format!(" {unit}"));
        let since = self.since.as_ref().map_or(String::new(), |since| format!(" since {since}"));
        format!("{}{unit}{since}", self.number)
    }

    /// A remark on a step that is taken at this time.
    pub fn taken(&self) -> Note {
        Note::new(format!("The step's time is the file's, {}.", self.in_words()))
    }

    /// A time axis that begins at this time.
    pub fn axis(&self) -> TimeAxis {
        let unit = self.unit.map(str::to_owned);
        TimeAxis { start: self.number, unit, since: self.since.clone(), ..TimeAxis::default() }
    }

    /// Whether the time may be compared with those of an axis: both are in one known unit, and count from one moment.
    pub fn is_on(&self, axis: &TimeAxis) -> bool {
        self.unit.is_some() && self.unit == axis.unit.as_deref() && self.since == axis.since
    }
}

impl StepTime {
    /// A remark on the time of an input of one step, packed without it. A time in no known unit may be a mere number.
    pub fn left_out(&self) -> Option<Note> {
        let stamp = self.stamp.as_ref().filter(|stamp| stamp.unit.is_some() || stamp.since.is_some())?;
        Some(Note::new(format!(
            "The time of the only step, {}, is left out: `time_step` or `time_stamps` gives a series its times.",
            stamp.in_words()
        )))
    }

    /// Time axis of steps in order: by their increment if common to all, else by their stamps if all have one and these ascend. Warns if they do not
    /// ascend.
    pub(crate) fn axis(steps: &[Self]) -> (Option<TimeAxis>, Option<Note>) {
        let increment = steps.first().and_then(|first| first.increment.as_ref()).filter(|it| it.number > 0.0);
        if let Some(TimeSpan { number, unit, .. }) =
            increment.filter(|it| steps.iter().all(|s| s.increment.as_ref() == Some(it)))
        {
            let axis = TimeAxis { step: *number, unit: unit.map(str::to_owned), ..TimeAxis::default() };
            return (Some(axis), None);
        }
        let stamps: Option<Vec<&TimeSpan>> = steps.iter().map(|step| step.stamp.as_ref()).collect();
        let Some(stamps) = stamps.filter(|stamps| stamps.len() > 1) else { return (None, None) };
        if let Some(pair) = stamps.windows(2).find(|pair| !pair[0].counts_as(pair[1])) {
            let [one, other] = [pair[0], pair[1]].map(TimeSpan::in_words);
            let note = format!(
                "The files' own times are left out: {one} and {other} cannot be compared; `time_step` or `time_stamps` gives them."
            );
            return (None, Some(Note::warning(note)));
        }
        // Each file may count from its own beginning, unless it says from which moment.
        let is_of_all = |pair: &[&TimeSpan]| pair[0].number == pair[1].number && pair[0].since.is_none();
        if stamps.windows(2).all(is_of_all) {
            return (None, None);
        }
        match TimeAxis::of_stamps(stamps.iter().map(|stamp| stamp.number).collect(), stamps[0].unit.map(str::to_owned))
        {
            Ok(axis) => (Some(TimeAxis { since: stamps[0].since.clone(), ..axis }), None),
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
        let since = |number, moment: &str| StepTime {
            stamp: TimeSpan::of(number, "h").map(|stamp| TimeSpan { since: Some(moment.into()), ..stamp }),
            increment: None,
        };
        let (found, _) = StepTime::axis(&[since(1.0, "2000-01-01"), since(7.0, "2000-01-01")]);
        assert_eq!(found.map(|axis| (axis.start, axis.step, axis.since)), Some((1.0, 6.0, Some("2000-01-01".into()))));
        for (number, moment, words) in [
            (7.0, "2000-01-02", "1 hour since 2000-01-01 and 7 hour since 2000-01-02 cannot be compared"),
            (1.0, "2000-01-01", "are left out: step: expected a positive number, found 0"),
        ] {
            let (none, note) = StepTime::axis(&[since(1.0, "2000-01-01"), since(number, moment)]);
            assert!(none.is_none() && note.as_ref().is_some_and(|note| note.contains(words)), "{note:?}");
        }
        for none in
            [[step(None, None), step(None, Some(1.0))], [step(Some(0.0), Some(0.0)), step(Some(0.0), Some(0.0))]]
        {
            assert_eq!(StepTime::axis(&none), (None, None));
        }
        let (none, note) = StepTime::axis(&[step(None, Some(2.0)), step(None, Some(1.0))]);
        assert!(none.is_none() && note.is_some_and(|note| note.is_warning() && note.contains("are left out")));
    }
}
