//! The parts that layers have of the buffers that they share.

use crate::memory::{LayerPlan, PART_BYTES};
use crate::table::{COMBINED, Room};
use brickyard_pager::VolumeNeeds;
use brickyard_shaders::FrameUniform;

/// Bytes of a shared buffer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Part {
    pub(crate) at: u64,
    pub(crate) bytes: u64,
}

impl Part {
    /// The next so many bytes after `end`, which becomes the end of all that.
    fn next(end: &mut u64, bytes: u64) -> Self {
        let at = end.next_multiple_of(PART_BYTES);
        *end = at + bytes;
        Self { at, bytes }
    }

    /// The part of a buffer as a binding.
    pub(crate) fn of<'a>(&self, buffer: &'a wgpu::Buffer) -> wgpu::BindingResource<'a> {
        let size = std::num::NonZeroU64::new(self.bytes);
        wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset: self.at, size })
    }

    /// The number of the first of things of so many bytes.
    pub(crate) fn first(&self, size: usize) -> u32 {
        (self.at / size as u64) as u32
    }
}

/// A layer's parts of shared buffers.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Parts {
    pub(crate) frame: Part,
    pub(crate) table: Part,
    pub(crate) nodes: Part,
    pub(crate) bricks: Part,
    pub(crate) ranges: Part,
    pub(crate) counts: Part,
    pub(crate) marks: Part,
}

/// Where the shared buffers end.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Ends {
    pub(crate) frames: u64,
    pub(crate) table: u64,
    pub(crate) nodes: u64,
    pub(crate) bricks: u64,
    pub(crate) ranges: u64,
    pub(crate) counts: u64,
    pub(crate) marks: u64,
}

impl Ends {
    /// The next layer's parts.
    pub(crate) fn layer(&mut self, needs: &VolumeNeeds, plan: &LayerPlan) -> Parts {
        let slots = plan.atlas.slots();
        let [nodes, bricks, ranges, counts, marks] = match &plan.raycast {
            None => [0; 5],
            Some(plan) => [
                plan.nodes_bytes(slots),
                plan.bricks_bytes(slots),
                plan.ranges_bytes(slots),
                plan.opaque_bytes,
                plan.marks_bytes(slots),
            ],
        };
        Parts {
            frame: self.frame(),
            table: Part::next(&mut self.table, Room::new(needs.encoding.format, &needs.bricks).bytes()),
            nodes: Part::next(&mut self.nodes, nodes),
            bricks: Part::next(&mut self.bricks, bricks),
            ranges: Part::next(&mut self.ranges, ranges),
            counts: Part::next(&mut self.counts, counts),
            marks: Part::next(&mut self.marks, marks),
        }
    }

    /// The next frame: they follow each other without gaps, for shaders that see all.
    pub(crate) fn frame(&mut self) -> Part {
        let (at, bytes) = (self.frames, size_of::<FrameUniform>() as u64);
        self.frames += bytes;
        Part { at, bytes }
    }

    /// The places of an expression's values, behind all layers' tables.
    pub(crate) fn combined(&mut self) -> Part {
        Part::next(&mut self.table, Room::of_places(COMBINED).bytes())
    }
}
