//! The values of one voxel over time, for the bar of time steps. A thread reads one brick per channel and step: first a few steps from the whole
//! range, then those between. A newer voxel ends the reading of the previous one.

use crate::newest::answering;
use brickyard::probe::probe_voxel;
use brickyard::session::VolumeSource;
use eframe::egui;
use std::sync::mpsc::Sender;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// The values of a volume's voxel, as far as they are read.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct ValueCurve {
    /// Index of the volume among the window's.
    pub(crate) volume: usize,
    /// The voxel, of the finest level.
    pub(crate) voxel: [u32; 3],
    /// All channels' values in stored units, for each time step: NaN for no data, and empty for a step unread or unreadable.
    pub(crate) steps: Vec<Vec<f64>>,
}

impl ValueCurve {
    /// The least and the greatest value; `None` without values.
    pub(crate) fn range(&self) -> Option<(f64, f64)> {
        let values = self.steps.iter().flatten().filter(|value| value.is_finite());
        values.fold(None, |range, value| {
            let (low, high) = range.unwrap_or((*value, *value));
            Some((value.min(low), value.max(high)))
        })
    }

    /// Largest number of channels in a step.
    pub(crate) fn channels(&self) -> usize {
        self.steps.iter().map(Vec::len).max().unwrap_or(0)
    }
}

/// A curve written by one thread and shown by another.
type Shared = Arc<Mutex<ValueCurve>>;

fn locked(curve: &Shared) -> MutexGuard<'_, ValueCurve> {
    // A value is there or not: no write leaves a half-way state.
    curve.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A request to the thread: the curve to write, and its volume.
type Question = (Shared, VolumeSource, egui::Context);

/// Reads the values of one voxel after another over time.
#[derive(Default)]
pub(crate) struct CurveReader {
    thread: Option<Sender<Question>>,
    read: Option<(VolumeSource, Shared)>,
}

impl CurveReader {
    /// Reads another voxel of a volume, given with its index, unless that is being read. The window is repainted as values arrive.
    pub(crate) fn read(&mut self, egui: &egui::Context, index: usize, volume: &VolumeSource, voxel: [u32; 3]) {
        let is_same = |(of, curve): &(VolumeSource, Shared)| {
            let curve = locked(curve);
            Arc::ptr_eq(&of.source, &volume.source) && (curve.volume, curve.voxel) == (index, voxel)
        };
        if self.read.as_ref().is_some_and(is_same) {
            return;
        }
        let steps = vec![Vec::new(); volume.source.times() as usize];
        let curve = Shared::new(Mutex::new(ValueCurve { volume: index, voxel, steps }));
        let question = (curve.clone(), volume.clone(), egui.clone());
        let start = || answering(|(curve, volume, egui): Question| read(&curve, &volume, &egui));
        if self.thread.get_or_insert_with(start).send(question).is_ok() {
            self.read = Some((volume.clone(), curve));
        }
    }

    /// The newest voxel's curve so far; `None` once its volume is not among these.
    pub(crate) fn curve(&mut self, volumes: &[VolumeSource]) -> Option<ValueCurve> {
        let (of, curve) = self.read.as_ref()?;
        let curve = locked(curve).clone();
        let is_there = volumes.get(curve.volume).is_some_and(|volume| Arc::ptr_eq(&of.source, &volume.source));
        if !is_there {
            self.read = None;
        }
        is_there.then_some(curve)
    }
}

/// Reads a curve until nobody shows it any more.
fn read(curve: &Shared, volume: &VolumeSource, egui: &egui::Context) {
    let (voxel, steps) = {
        let curve = locked(curve);
        (curve.voxel, curve.steps.len() as u32)
    };
    for step in coarse_to_fine(steps) {
        if Arc::strong_count(curve) == 1 {
            return;
        }
        let probe = probe_voxel(volume, step, voxel);
        match probe.inspect_err(|error| tracing::debug!("a curve has no value at step {step}: {error}")) {
            Ok(probe) => locked(curve).steps[step as usize] = probe.values,
            Err(_) => continue,
        }
        egui.request_repaint();
    }
}

/// All numbers below `count`, each once, far apart ones first.
fn coarse_to_fine(count: u32) -> impl Iterator<Item = u32> {
    let bits = u32::BITS - count.saturating_sub(1).leading_zeros();
    let reversed = move |number: u32| if bits == 0 { 0 } else { number.reverse_bits() >> (u32::BITS - bits) };
    (0..count.next_power_of_two()).map(reversed).filter(move |number| *number < count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::panels::fixture;
    use std::time::{Duration, Instant};

    #[test]
    fn numbers_come_once_and_far_ones_first() {
        assert_eq!(coarse_to_fine(6).collect::<Vec<_>>(), [0, 4, 2, 1, 5, 3]);
        for count in [1, 2, 3, 100] {
            let mut all: Vec<u32> = coarse_to_fine(count).collect();
            all.sort_unstable();
            assert_eq!(all, (0..count).collect::<Vec<_>>());
        }
    }

    #[test]
    fn the_newest_voxel_is_read_over_all_steps() {
        let (mut reader, volumes) = (CurveReader::default(), fixture::volumes());
        assert_eq!(reader.curve(&volumes), None);
        for x in 0..5 {
            reader.read(&egui::Context::default(), 1, &volumes[1], [x, 0, 0]);
        }
        let expected = ValueCurve { volume: 1, voxel: [4, 0, 0], steps: vec![vec![7.0; 2]; 3] };
        let begun = Instant::now();
        while reader.curve(&volumes).as_ref() != Some(&expected) && begun.elapsed() < Duration::from_secs(60) {
            std::thread::sleep(Duration::from_millis(1));
        }
        assert_eq!(reader.curve(&volumes), Some(expected));
        assert_eq!(reader.curve(&fixture::volumes()), None, "of other volumes");
    }

    #[test]
    fn what_has_no_value_counts_for_nothing() {
        let curve = |steps: &[&[f64]]| ValueCurve {
            steps: steps.iter().map(|s| s.to_vec()).collect(),
            ..ValueCurve::default()
        };
        let some = curve(&[&[], &[3.0, f64::NAN], &[-1.0, 2.0]]);
        assert_eq!((some.range(), some.channels()), (Some((-1.0, 3.0)), 2));
        assert_eq!((curve(&[&[], &[f64::NAN]]).range(), curve(&[]).channels()), (None, 0));
    }
}
