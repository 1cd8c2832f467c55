//! The `raycast` and `compute` compositors: one ray per pixel, front to back through an octree over each draw list, ending where nothing
//! behind can be seen and leaping over what shows nothing: leaves without a brick, bricks, and macro-cells inside bricks.
//!
//! In direct volume rendering rays leave marks: how much light was left when they entered a brick, the most of all rays. They
//! come back with the picture, and say which bricks nobody could see.
//!
//! Macro-cells' ranges of codes go to the GPU when their brick does. What a range means under the frame's table is found by
//! two look-ups in a table of counts, so that an edit of the transfer function sends 4 bytes per entry and no brick.

use crate::adapter::Gpu;
use crate::buffers::{RayBuffers, SharedBuffers, buffer, entry};
use crate::error::GpuError;
use crate::layer::GpuLayer;
use crate::memory::RaycastPlan;
use crate::parts::{Ends, Part, Parts};
use crate::pipelines::Layouts;
use crate::targets::Targets;
use crate::tree::GROUP;
use brickyard_shaders::{RayBrick, bindings};
use brickyard_volume::macrocells;
use wgpu::BufferUsages;

/// Its buffers and bindings.
#[derive(Debug)]
pub(crate) struct Raycast {
    pub(crate) buffers: RayBuffers,
    /// Of each layer by itself.
    pub(crate) bindings: Vec<wgpu::BindGroup>,
    /// Of all of them.
    pub(crate) joint: wgpu::BindGroup,
}

impl Raycast {
    pub(crate) fn new(
        gpu: &Gpu,
        layouts: &Layouts,
        shared: &SharedBuffers,
        layers: &[GpuLayer],
        ends: &Ends,
    ) -> Result<Self, GpuError> {
        let sizes = [
            ("octrees", ends.nodes),
            ("bricks", ends.bricks),
            ("macro-cells", ends.ranges),
            ("opaque entries", ends.counts),
            ("marks", ends.marks),
        ];
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let make = |device: &wgpu::Device| sizes.map(|(label, bytes)| buffer(device, label, bytes, usage));
        let total = sizes.iter().map(|(_, bytes)| bytes).sum();
        let [nodes, bricks, ranges, opaque_before, marks] =
            gpu.allocate("the octrees and the macro-cells", total, make)?;
        let buffers = RayBuffers { nodes, bricks, ranges, opaque_before, marks };
        let of = |layer: &GpuLayer| {
            let own = buffers.entries(gpu, shared, Some(&layer.parts));
            shared.bindings(gpu, &layouts.march, std::slice::from_ref(layer), own)
        };
        let own = layers.iter().map(of).collect();
        let joint = shared.bindings(gpu, &layouts.joint, layers, buffers.entries(gpu, shared, None));
        Ok(Self { buffers, bindings: own, joint })
    }

    /// Queues the copy of the first so many marks of each layer, one layer's behind the other's, and the end of all.
    pub(crate) fn take_marks(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        layers: &[GpuLayer],
        counts: &[usize],
        to: &Targets,
    ) {
        let mut at = to.marks_offset();
        for (layer, count) in layers.iter().zip(counts).filter(|(_, count)| **count > 0) {
            let bytes = (count * size_of::<u32>()) as u64;
            encoder.copy_buffer_to_buffer(&self.buffers.marks, layer.parts.marks.at, &to.read_back, at, bytes);
            at += bytes;
        }
        encoder.clear_buffer(&self.buffers.marks, 0, None);
    }
}

impl RayBuffers {
    /// A layer's parts of all that rays see, or all of it.
    fn entries<'a>(
        &'a self,
        gpu: &Gpu,
        shared: &'a SharedBuffers,
        parts: Option<&Parts>,
    ) -> Vec<wgpu::BindGroupEntry<'a>> {
        let of = |buffer: &'a wgpu::Buffer, part: Option<Part>| {
            part.map_or_else(|| buffer.as_entire_binding(), |part| part.of(buffer))
        };
        let mut entries = vec![
            entry(bindings::FRAMES, of(&shared.frame, parts.map(|parts| parts.frame))),
            entry(bindings::TABLE, of(&shared.table, parts.map(|parts| parts.table))),
            entry(bindings::BRICKS, of(&self.bricks, parts.map(|parts| parts.bricks))),
            entry(bindings::NODES, of(&self.nodes, parts.map(|parts| parts.nodes))),
            entry(bindings::RANGES, of(&self.ranges, parts.map(|parts| parts.ranges))),
            entry(bindings::OPAQUE_BEFORE, of(&self.opaque_before, parts.map(|parts| parts.counts))),
        ];
        if gpu.report.feedback {
            entries.push(entry(bindings::MARKS, of(&self.marks, parts.map(|parts| parts.marks))));
        }
        entries
    }
}

impl RaycastPlan {
    /// Groups of nodes for this many slots: at worst each cell that a cut wants has a way of its own down from the root.
    fn groups(&self, slots: u32) -> u64 {
        1 + slots as u64 * (self.levels as u64).saturating_sub(1)
    }

    /// Entries that a draw list can have. A cut wants fewer cells than there are slots; but the siblings that its splits leave
    /// over are drawn too when the camera has turned towards them and the next cut is not there yet.
    fn entries(&self, slots: u32) -> u64 {
        self.groups(slots) * GROUP as u64
    }

    /// What the list's marks take.
    pub(crate) fn marks_bytes(&self, slots: u32) -> u64 {
        self.entries(slots) * size_of::<u32>() as u64
    }

    /// What the octree's nodes take.
    pub(crate) fn nodes_bytes(&self, slots: u32) -> u64 {
        self.groups(slots) * (GROUP * size_of::<u32>()) as u64
    }

    /// What the list's bricks take.
    pub(crate) fn bricks_bytes(&self, slots: u32) -> u64 {
        self.entries(slots) * size_of::<RayBrick>() as u64
    }

    /// What the macro-cells of this many slots take.
    pub(crate) fn ranges_bytes(&self, slots: u32) -> u64 {
        (slots as usize * macrocells::bytes(self.edge as usize)) as u64
    }
}
