//! One file per time step, as one source.

use crate::error::ImportError;
use crate::source::{Access, Lent, Source, SourceInfo};
use brickyard_volume::{VoxelBox, counted};
use std::path::PathBuf;

/// A time series: sources of one time step each that agree in extent, voxel type, channels and spacing.
pub(crate) struct Series {
    info: SourceInfo,
    steps: Vec<Box<dyn Source>>,
}

impl Series {
    /// Joins sources of one time step each. `paths` are their files, for messages.
    ///
    /// # Errors
    /// If a source has several time steps or differs from the first.
    pub(crate) fn new(paths: &[PathBuf], steps: Vec<Box<dyn Source>>) -> Result<Self, ImportError> {
        let mut info = steps[0].info().clone();
        info.times = steps.len() as u32;
        info.identity.clear();
        info.notes.clear();
        for (path, step) in paths.iter().zip(&steps) {
            let (first, step) = (steps[0].info(), step.info());
            if step.times != 1 {
                let problem =
                    format!("{} files given, one per time step, but this one holds {}", paths.len(), step.times);
                return Err(ImportError::options(path, problem));
            }
            let describe = |i: &SourceInfo| {
                let channels = counted(i.channels.into(), "channel");
                format!("{} {} with {channels}, spacing {}", i.extent, i.voxel_type, i.geometry.spacing)
            };
            if describe(step) != describe(first) {
                let problem = format!("is {}, but {} is {}", describe(step), paths[0].display(), describe(first));
                return Err(ImportError::invalid(path, problem));
            }
            if step.nodata != first.nodata {
                let value = |info: &SourceInfo| info.nodata.map_or("no value".into(), |value| value.to_string());
                let problem = format!(
                    "says with {} that voxels hold no data, but {} with {}; give one for all with `nodata`",
                    value(step),
                    paths[0].display(),
                    value(first)
                );
                return Err(ImportError::options(path, problem));
            }
            let lies_there = match (&step.orientation, &first.orientation) {
                (Some(own), Some(other)) => own.agrees(other, step.extent),
                (own, other) => own == other,
            };
            if !lies_there {
                let problem = format!(
                    "lies otherwise in the patient than {}: register the steps to one place, or pack each by itself",
                    paths[0].display()
                );
                return Err(ImportError::invalid(path, problem));
            }
            info.identity += &step.identity;
            info.identity += "\n";
            for note in &step.notes {
                if !info.notes.contains(note) {
                    info.notes.push(note.clone());
                }
            }
        }
        Ok(Self { info, steps })
    }
}

impl Source for Series {
    fn info(&self) -> &SourceInfo {
        &self.info
    }

    fn access(&self) -> Access {
        self.steps[0].access()
    }

    fn reader_bytes(&self) -> u64 {
        self.steps.iter().map(|step| step.reader_bytes()).max().unwrap_or(0)
    }

    fn read_box(&self, time: u32, channel: u32, region: VoxelBox, out: &mut [u8]) -> Result<(), ImportError> {
        self.info.check_box(time, channel, region, out);
        self.steps[time as usize].read_box(0, channel, region, out)
    }

    fn lend(&self, time: u32, channel: u32, region: VoxelBox) -> Option<Lent<'_>> {
        self.steps[time as usize].lend(0, channel, region)
    }

    fn announce(&self, time: u32, channel: u32, region: VoxelBox) {
        self.steps[time as usize].announce(0, channel, region);
    }
}
