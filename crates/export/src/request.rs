//! The part of a store to export, and its check against the store.

use crate::error::ExportError;
use crate::ngff::Ngff;
use brickyard_store::Store;
use brickyard_volume::{Level, VoxelBox};

/// The time steps to export.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExportTime {
    /// One step, as an array without a time axis.
    Step(u32),
    /// Consecutive steps, as an array with a time axis.
    Steps {
        /// The first step.
        first: u32,
        /// The end of the range, excluded.
        end: u32,
        /// Distance between exported steps; at least 1.
        stride: u32,
    },
}

impl Default for ExportTime {
    fn default() -> Self {
        Self::Step(0)
    }
}

impl ExportTime {
    /// First step, end (excluded) and stride.
    pub(crate) fn range(self) -> (u32, u32, u32) {
        match self {
            Self::Step(step) => (step, step.saturating_add(1), 1),
            Self::Steps { first, end, stride } => (first, end, stride.max(1)),
        }
    }

    fn last(self) -> Option<u32> {
        let (first, end, stride) = self.range();
        (first < end).then(|| first + (end - 1 - first) / stride * stride)
    }
}

/// The channels to export.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum ExportChannels {
    /// One channel, as an array without an axis of channels.
    One(u32),
    /// These channels, in this order, as an array with an axis of channels.
    Several(Vec<u32>),
    /// All channels, as an array with an axis of channels.
    All,
}

impl Default for ExportChannels {
    fn default() -> Self {
        Self::One(0)
    }
}

impl ExportChannels {
    /// The numbers of the channels, of a store with this many.
    pub(crate) fn numbers(&self, channels: u32) -> Vec<u32> {
        match self {
            Self::One(channel) => vec![*channel],
            Self::Several(channels) => channels.clone(),
            Self::All => (0..channels).collect(),
        }
    }
}

/// Part of a store to export, and policy for an existing file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ExportRequest {
    /// The level to export.
    pub level: Level,
    /// The time steps to export.
    pub time: ExportTime,
    /// The channels to export.
    pub channels: ExportChannels,
    /// The box to export, in the level's voxels; `None` exports the whole level.
    pub region: Option<VoxelBox>,
    /// The version of an OME-Zarr; `None` is the default for this format, and the only choice for others.
    pub ngff: Option<Ngff>,
    /// Whether an existing file may be replaced.
    pub overwrite: bool,
    /// Most anonymous memory for the export, in bytes, including the open store's.
    pub memory_bytes: u64,
}

/// Level 0 of the first step and channel, whole, within 1 GiB.
impl Default for ExportRequest {
    fn default() -> Self {
        let (level, time, channels, region) = Default::default();
        Self { level, time, channels, region, ngff: None, overwrite: false, memory_bytes: 1 << 30 }
    }
}

impl ExportRequest {
    /// The box to export, if the store has all of the request.
    pub(crate) fn checked_region(&self, store: &Store) -> Result<VoxelBox, ExportError> {
        let below = |what, found: u32, count: u32| match found < count {
            true => Ok(()),
            false => {
                Err(ExportError::Outside { what, found: found.to_string(), expected: format!("0 to {}", count - 1) })
            }
        };
        below("level", self.level.0.into(), store.pyramid().levels().len() as u32)?;
        let last = self.time.last().ok_or_else(|| {
            let found = format!("{:?}", self.time);
            ExportError::Outside { what: "time steps", found, expected: "at least one".into() }
        })?;
        below("time step", last, store.times())?;
        let channels = self.channels.numbers(store.channels());
        for (place, channel) in channels.iter().enumerate() {
            below("channel", *channel, store.channels())?;
            if channels[..place].contains(channel) {
                let (found, expected) = (format!("{channel}, named twice,"), "each channel once".into());
                return Err(ExportError::Outside { what: "channel", found, expected });
            }
        }
        if channels.is_empty() {
            let (found, expected) = ("none".into(), "at least one".into());
            return Err(ExportError::Outside { what: "channel", found, expected });
        }
        let whole = store.pyramid().level(self.level).extent.full_box();
        let region = self.region.unwrap_or(whole);
        if region.is_empty() || region.intersect(whole) != region {
            let show = |b: VoxelBox| {
                let (min, max) = (b.min, b.max);
                format!("{}:{},{}:{},{}:{}", min.x, max.x, min.y, max.y, min.z, max.z)
            };
            let expected = format!("a box inside {} of level {}", show(whole), self.level);
            return Err(ExportError::Outside { what: "box", found: show(region), expected });
        }
        Ok(region)
    }
}
