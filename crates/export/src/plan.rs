//! A file to be written: made by a format from a description, before any voxel is read.

use crate::facts::{Fact, lost};
use crate::ngff::Ngff;
use crate::volume::Volume;
use std::io::{self, Write};

/// Writes the bytes before the voxels.
pub(crate) type Head = Box<dyn Fn(&mut dyn Write) -> io::Result<()> + Send + Sync>;

/// Voxels in a file as they are: planes of rows, x fastest, each plane without gaps.
pub(crate) struct Layout {
    pub(crate) head: Head,
    /// Bytes before the first plane.
    pub(crate) start: u64,
    /// Bytes from one plane to the next along z, from channel to channel, and from step to step.
    pub(crate) plane_bytes: u64,
    pub(crate) channel_bytes: u64,
    pub(crate) step_bytes: u64,
    /// Bytes elsewhere among and behind the voxels, with their places.
    pub(crate) others: Vec<(u64, Vec<u8>)>,
}

impl Layout {
    /// A header, then planes, channels and steps in this order, slowest last.
    pub(crate) fn after(head: Vec<u8>, volume: &Volume) -> Self {
        let (plane_bytes, channel_bytes) = (volume.plane_bytes(), volume.bytes());
        let step_bytes = channel_bytes.saturating_mul(volume.info.channels.into());
        let start = head.len() as u64;
        let head: Head = Box::new(move |out: &mut dyn Write| out.write_all(&head));
        Self { head, start, plane_bytes, channel_bytes, step_bytes, others: Vec::new() }
    }

    /// The place of a channel of a step.
    pub(crate) fn place(&self, time: u32, channel: u32) -> u64 {
        self.start + u64::from(time) * self.step_bytes + u64::from(channel) * self.channel_bytes
    }
}

/// Form of the voxels.
pub(crate) enum Body {
    /// As they are.
    Flat(Layout),
    /// These bytes, then channels of steps of planes, through gzip.
    Gzip(Vec<u8>),
    /// A picture for each plane, in a folder.
    Pictures,
    /// A file for each step, in a folder.
    Series,
    /// Levels in chunks, in a folder of this version.
    Zarr(Ngff),
}

/// A file to be written.
pub(crate) struct Plan {
    pub(crate) body: Body,
    /// A text in a file of its own.
    pub(crate) text: Option<Vec<u8>>,
    /// Sentences for the user.
    pub(crate) notes: Vec<String>,
}

impl Plan {
    /// A plan with a note on the facts which are not kept. `format` is the note's subject.
    pub(crate) fn new(volume: &Volume, format: &str, kept: &[Fact], body: Body) -> Self {
        Self { body, text: None, notes: lost(volume, format, kept).into_iter().collect() }
    }

    /// The plan with more sentences.
    pub(crate) fn noted(mut self, notes: impl IntoIterator<Item = String>) -> Self {
        self.notes.extend(notes);
        self
    }
}
