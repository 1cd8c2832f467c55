//! Some channels and time steps of a source, under new numbers. Voxels are unchanged, and cost what they cost in the other source.

use crate::error::{ImportError, Result};
use crate::part::Part;
use crate::source::{Source, SourceInfo, Take};
use brickyard_volume::{TimeAxis, TimeProblem, VoxelBox};

/// A source of some channels and steps of another one, with their looks and times.
pub(crate) struct Picked {
    source: Box<dyn Source>,
    info: SourceInfo,
    part: Part,
}

impl Picked {
    /// Takes the part's channels and steps; its box is left to others.
    ///
    /// # Errors
    /// If the steps' times make no axis: they are too far apart for numbers.
    pub(crate) fn new(source: Box<dyn Source>, part: Part) -> Result<Self, TimeProblem> {
        let mut info = source.info().clone();
        info.channels = part.channels.len() as u32;
        info.times = part.steps;
        if !info.channel_looks.is_empty() {
            let look = |channel: &u32| info.channel_looks.get(*channel as usize).cloned().unwrap_or_default();
            info.channel_looks = part.channels.iter().map(look).collect();
        }
        info.time = info.time.map(|axis| picked_times(&axis, &part)).transpose()?;
        let Part { channels, first_step, stride, steps, .. } = &part;
        info.identity =
            format!("{}, channels {channels:?}, {steps} steps from {first_step} by {stride}", info.identity);
        Ok(Self { source, info, part })
    }

    fn channel(&self, channel: u32) -> u32 {
        self.part.channels[channel as usize]
    }
}

/// The times of the part's steps.
fn picked_times(axis: &TimeAxis, part: &Part) -> Result<TimeAxis, TimeProblem> {
    if !axis.stamps.is_empty() {
        let stamps = (0..part.steps).map(|step| axis.at(part.step(step))).collect();
        return Ok(TimeAxis { since: axis.since.clone(), ..TimeAxis::of_stamps(stamps, axis.unit.clone())? });
    }
    let start = axis.at(part.first_step);
    let picked = TimeAxis { start, step: axis.step * f64::from(part.stride), ..axis.clone() };
    picked.check(part.steps).map(|()| picked)
}

impl Source for Picked {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn beneath(&self) -> Option<&dyn Source> {
        Some(&*self.source)
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        self.source.read_box(self.part.step(time), self.channel(channel), region, out)
    }

    fn lend(&self, time: u32, channel: u32, region: VoxelBox, take: Take<'_>) -> Result<bool, ImportError> {
        self.source.lend(self.part.step(time), self.channel(channel), region, take)
    }

    fn announce(&self, time: u32, channel: u32, region: VoxelBox) {
        self.source.announce(self.part.step(time), self.channel(channel), region);
    }

    fn constant_in(&self, time: u32, channel: u32, region: VoxelBox) -> Option<f64> {
        self.source.constant_in(self.part.step(time), self.channel(channel), region)
    }
}
