//! Each layer's parts of the shared buffers.

use crate::memory::{PART_BYTES, PoolPlan, opaque_bytes};
use crate::transfer_table::{COMBINED, TableCapacity};
use brickyard_pager::VolumeNeeds;
use brickyard_shaders::FrameUniform;

/// First byte and length of a part of a shared buffer.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Part {
    pub(crate) at: u64,
    pub(crate) bytes: u64,
}

impl Part {
    /// Takes the next `bytes` bytes after `end`, aligned for binding, and moves `end` behind them.
    fn next(end: &mut u64, bytes: u64) -> Self {
        let at = end.next_multiple_of(PART_BYTES);
        *end = at + bytes;
        Self { at, bytes }
    }

    pub(crate) fn of<'a>(&self, buffer: &'a wgpu::Buffer) -> wgpu::BindingResource<'a> {
        let size = std::num::NonZeroU64::new(self.bytes);
        wgpu::BindingResource::Buffer(wgpu::BufferBinding { buffer, offset: self.at, size })
    }

    /// A part of a buffer, or all of it.
    pub(crate) fn of_any(part: Option<Self>, buffer: &wgpu::Buffer) -> wgpu::BindingResource<'_> {
        part.map_or_else(|| buffer.as_entire_binding(), |part| part.of(buffer))
    }

    /// The index of the part's first item, for items of `size` bytes.
    pub(crate) fn first(&self, size: usize) -> u32 {
        (self.at / size as u64) as u32
    }
}

/// A layer's parts of the shared buffers.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Parts {
    pub(crate) frame: Part,
    pub(crate) table: Part,
    pub(crate) counts: Part,
}

/// Ends of the shared buffers so far, in bytes; new parts are taken behind them.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Ends {
    pub(crate) frames: u64,
    pub(crate) table: u64,
    pub(crate) ranges: u64,
    pub(crate) counts: u64,
}

impl Ends {
    pub(crate) fn layer(&mut self, needs: &VolumeNeeds) -> Parts {
        let codes = needs.encoding.format;
        Parts {
            frame: self.frame(),
            table: Part::next(&mut self.table, TableCapacity::new(codes, &needs.bricks).bytes()),
            counts: Part::next(&mut self.counts, opaque_bytes(codes)),
        }
    }

    /// Takes the next pool's part, for its macro-cells' code ranges.
    pub(crate) fn ranges(&mut self, plan: &PoolPlan) -> Part {
        let bytes = plan.raycast.map_or(0, |raycast| raycast.ranges_bytes(plan.atlas.slots()));
        Part::next(&mut self.ranges, bytes)
    }

    /// Takes the next frame's part. Frames follow each other without gaps, for shaders that see all of them.
    pub(crate) fn frame(&mut self) -> Part {
        let (at, bytes) = (self.frames, size_of::<FrameUniform>() as u64);
        self.frames += bytes;
        Part { at, bytes }
    }

    /// Takes an expression's part of the tables, behind those of all layers.
    pub(crate) fn combined(&mut self) -> Part {
        Part::next(&mut self.table, TableCapacity::of_places(COMBINED).bytes())
    }
}
