//! The part of an input to take: a box of voxels, channels and time steps, all of which it has. Found once, from the description;
//! costs no voxel.

use crate::choice::StepChoice;
use crate::error::{ImportError, Result};
use crate::options::OpenOptions;
use crate::source::SourceInfo;
use brickyard_volume::{VoxelBox, counted};
use std::path::Path;

/// The voxels, channels and steps of an input to take, all of which it has.
#[derive(Clone)]
pub(crate) struct Part {
    pub(crate) region: VoxelBox,
    pub(crate) channels: Vec<u32>,
    pub(crate) first_step: u32,
    pub(crate) stride: u32,
    pub(crate) steps: u32,
}

impl Part {
    /// Finds the part that the options name.
    ///
    /// # Errors
    /// If the input has no such voxels, channels or steps, or a channel is named twice.
    pub(crate) fn of(info: &SourceInfo, options: &OpenOptions, path: &Path) -> Result<Self> {
        let refuse = |problem: String| ImportError::options(path, problem);
        let whole = info.extent.full_box();
        let region = options.roi.unwrap_or(whole);
        if region.is_empty() || whole.intersect(region) != region {
            let (low, high) = (region.min.to_array(), region.max.to_array());
            let ends: Vec<String> = low.iter().zip(high).map(|(low, high)| format!("{low}:{high}")).collect();
            let [x, y, z] = info.extent.to_array();
            let problem = format!("`roi` {}: expected a box within 0:{x},0:{y},0:{z}, the input", ends.join(","));
            return Err(refuse(problem));
        }
        let mut channels = Vec::new();
        for choice in &options.take_channel {
            let place = choice.place(info).map_err(|problem| refuse(format!("`take_channel` {choice}: {problem}")))?;
            if channels.contains(&place) {
                return Err(refuse(format!("`take_channel` {choice}: channel {place} is named twice; name it once")));
            }
            channels.push(place);
        }
        if channels.is_empty() {
            channels = (0..info.channels).collect();
        }
        let StepChoice { first, end, stride } =
            options.take_time.unwrap_or(StepChoice { first: 0, end: None, stride: 1 });
        let end = end.unwrap_or(info.times);
        if stride == 0 || first >= end || end > info.times {
            let steps = counted(info.times.into(), "time step");
            let choice = options.take_time.map_or(String::new(), |choice| choice.to_string());
            return Err(refuse(format!("`take_time` {choice}: the input has {steps}, numbered from 0")));
        }
        Ok(Self { region, channels, first_step: first, stride, steps: (end - first).div_ceil(stride) })
    }

    /// The input's step for a step of the part.
    pub(crate) fn step(&self, step: u32) -> u32 {
        self.first_step + step * self.stride
    }
}
