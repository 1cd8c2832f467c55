//! The steps of a scene of several volumes, taken from the volume with the most steps. The steps' times determine the shown steps of the other
//! volumes.

use crate::time_axis::TimeAxis;
use crate::time_unit::time_unit_s;
use std::sync::Arc;

/// The steps of a volume for a timeline.
#[derive(Clone, Debug, PartialEq)]
pub struct VolumeTime {
    /// The number of the volume's steps; at least 1.
    pub steps: u32,
    /// Their times; `None` if unknown.
    pub axis: Option<Arc<TimeAxis>>,
}

/// The steps of a scene of volumes, and each volume's own step at each of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Timeline {
    volumes: Vec<VolumeTime>,
    /// The index of the volume with the scene's steps.
    leader: usize,
}

impl Timeline {
    /// Creates the timeline of the `shown` volumes, by index: its steps are those of the one with the most, the first of several.
    pub fn new(volumes: Vec<VolumeTime>, shown: impl IntoIterator<Item = usize>) -> Self {
        let steps = |volume: usize| volumes.get(volume).map_or(0, |time| time.steps);
        let longer = |a: usize, b: usize| if steps(b) > steps(a) { b } else { a };
        let leader = shown.into_iter().reduce(longer).unwrap_or(0);
        Self { volumes, leader }
    }

    /// The number of steps.
    pub fn steps(&self) -> u32 {
        self.volumes.get(self.leader).map_or(1, |time| time.steps)
    }

    /// The times of the steps; `None` if unknown.
    pub fn axis(&self) -> Option<&TimeAxis> {
        self.volumes.get(self.leader)?.axis.as_deref()
    }

    /// A volume's step at a step of the timeline: its last one taken by then. With unknown times or incomparable units, the step of the same
    /// number, or the last one.
    pub fn step_of(&self, volume: usize, step: u32) -> u32 {
        let Some(time) = self.volumes.get(volume).filter(|_| volume != self.leader) else { return step };
        let moment = self.axis().zip(time.axis.as_deref()).and_then(|(own, other)| {
            let factor = factor(own.unit.as_deref(), other.unit.as_deref())?;
            Some(other.step_at(own.at(step) * factor, time.steps))
        });
        moment.unwrap_or(step.min(time.steps - 1))
    }
}

/// The factor from times in one unit to times in another.
fn factor(from: Option<&str>, to: Option<&str>) -> Option<f64> {
    if from == to {
        return Some(1.0);
    }
    Some(time_unit_s(from?)? / time_unit_s(to?)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn time(steps: u32, start: f64, step: f64, unit: Option<&str>) -> VolumeTime {
        let axis = TimeAxis { start, step, unit: unit.map(str::to_owned), ..TimeAxis::default() };
        VolumeTime { steps, axis: Some(Arc::new(axis)) }
    }

    fn steps_of(timeline: &Timeline, volume: usize) -> Vec<u32> {
        (0..timeline.steps()).map(|step| timeline.step_of(volume, step)).collect()
    }

    #[test]
    fn volumes_are_matched_by_the_time_at_which_they_were_taken() {
        let volumes = vec![
            time(3, 1.0, 2.0, Some("second")),
            time(8, 0.0, 1.0, Some("second")),
            time(4, 0.0, 2000.0, Some("millisecond")),
        ];
        let timeline = Timeline::new(volumes, [0, 1, 2]);
        assert_eq!((timeline.steps(), timeline.axis().unwrap().step), (8, 1.0));
        assert_eq!(steps_of(&timeline, 1), [0, 1, 2, 3, 4, 5, 6, 7]);
        assert_eq!(steps_of(&timeline, 0), [0, 0, 0, 1, 1, 2, 2, 2]);
        assert_eq!(steps_of(&timeline, 2), [0, 0, 1, 1, 2, 2, 3, 3]);
        let irregular = TimeAxis::of_stamps(vec![0.5, 0.75, 6.0], Some("second".into())).unwrap();
        let volumes = vec![time(8, 0.0, 1.0, Some("second")), VolumeTime { steps: 3, axis: Some(Arc::new(irregular)) }];
        assert_eq!(steps_of(&Timeline::new(volumes, [0, 1]), 1), [0, 1, 1, 1, 1, 1, 2, 2]);
    }

    #[test]
    fn volumes_whose_times_cannot_be_compared_are_matched_by_number() {
        let unknown = VolumeTime { steps: 3, axis: None };
        let others = [time(3, 0.0, 9.0, None), time(3, 0.0, 9.0, Some("fortnight")), unknown];
        let volumes = [vec![time(5, 0.0, 1.0, Some("second"))], others.to_vec()].concat();
        let timeline = Timeline::new(volumes, 0..4);
        for volume in 1..4 {
            assert_eq!(steps_of(&timeline, volume), [0, 1, 2, 2, 2]);
        }
    }

    #[test]
    fn only_volumes_that_are_shown_have_a_say() {
        let volumes = vec![time(9, 0.0, 1.0, None), time(2, 0.0, 1.0, None)];
        assert_eq!(Timeline::new(volumes.clone(), [1]).steps(), 2);
        assert_eq!(Timeline::new(volumes, [1, 0]).steps(), 9);
        assert_eq!(Timeline::new(Vec::new(), []).steps(), 1);
    }
}
