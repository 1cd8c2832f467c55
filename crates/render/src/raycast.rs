//! The `raycast` and `compute` compositors: one ray per pixel, front to back through an octree over each draw list,
//! with early ray termination and empty-space skipping: of leaves without a brick, of bricks, and of macro-cells inside
//! bricks.
//!
//! In direct volume rendering rays leave marks: how much light was left when they entered a brick, the most of all
//! rays. The marks come back with the picture and reveal which bricks nobody could see.
//!
//! Macro-cells' code ranges go to the GPU with their brick. Two look-ups in a table of counts decide whether a range is
//! visible under the frame's table, so an edit of the transfer function sends 4 bytes per entry and no brick.

use crate::buffer_parts::{Ends, Part};
use crate::buffers::{RayBuffers, SharedBuffers, buffer, entry};
use crate::layer::GpuLayer;
use crate::layouts::Layouts;
use crate::leaf_octree::{GROUP, Tree};
use crate::march::MarchBindings;
use crate::memory::{MemoryPlan, RaycastPlan};
use crate::pool::Pool;
use crate::{Gpu, GpuError};
use brickyard_shaders::{FrameUniform, RayBrick, bindings};
use brickyard_volume::macrocells;
use wgpu::BufferUsages;

/// Buffers and bindings of the compositors `raycast` and `compute`.
#[derive(Debug)]
pub(crate) struct Raycast {
    pub(crate) buffers: RayBuffers,
    pub(crate) bindings: MarchBindings,
}

impl Raycast {
    pub(crate) fn new(
        gpu: &Gpu,
        layouts: &Layouts,
        shared: &SharedBuffers,
        layers: &[GpuLayer],
        pools: &[Pool],
        ends: &Ends,
        memory: &MemoryPlan,
    ) -> Result<Self, GpuError> {
        let [nodes, bricks, marks] = memory.list_bytes();
        let sizes = [
            ("octrees", nodes),
            ("bricks", bricks),
            ("macro-cells", ends.ranges),
            ("opaque entries", ends.counts),
            ("marks", marks),
        ];
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let make = |device: &wgpu::Device| sizes.map(|(label, bytes)| buffer(device, label, bytes, usage));
        let total = sizes.iter().map(|(_, bytes)| bytes).sum();
        let [nodes, bricks, ranges, opaque_before, marks] =
            gpu.allocate("the octrees and the macro-cells", total, make)?;
        let buffers = RayBuffers { nodes, bricks, ranges, opaque_before, marks };
        let own = |layer: Option<(&GpuLayer, &Pool)>| buffers.entries(gpu, shared, layer);
        let bindings = MarchBindings::new(gpu, layouts, shared, layers, pools, own);
        Ok(Self { buffers, bindings })
    }

    /// Sends octrees over draw lists to the GPU, one behind the other, and writes each one's start into its frame.
    ///
    /// # Errors
    /// If the draw lists or octrees exceed the renderer's room.
    pub(crate) fn set_trees(&self, gpu: &Gpu, shared: &SharedBuffers, trees: &[(Part, Tree)]) -> Result<(), GpuError> {
        let (mut nodes, mut bricks): (Vec<u32>, Vec<RayBrick>) = Default::default();
        for (frame, tree) in trees {
            let list_at = [nodes.len() as u32, bricks.len() as u32];
            let at = frame.at + std::mem::offset_of!(FrameUniform, list_at) as u64;
            gpu.queue.write_buffer(&shared.frame, at, bytemuck::bytes_of(&list_at));
            nodes.extend(&tree.nodes);
            bricks.extend(&tree.bricks);
        }
        let room = [&self.buffers.nodes, &self.buffers.bricks].map(|buffer| buffer.size() as usize);
        if size_of_val(&nodes[..]) > room[0] || size_of_val(&bricks[..]) > room[1] {
            let asked = format!("draw lists of {} entries and {} octree nodes", bricks.len(), nodes.len());
            let (bricks, nodes) = (room[1] / size_of::<RayBrick>(), room[0] / size_of::<u32>());
            let problem = format!("{asked}: this renderer's slots and levels leave room for {bricks} and {nodes}");
            return Err(GpuError::Mismatch(problem));
        }
        gpu.queue.write_buffer(&self.buffers.nodes, 0, bytemuck::cast_slice(&nodes));
        gpu.queue.write_buffer(&self.buffers.bricks, 0, bytemuck::cast_slice(&bricks));
        Ok(())
    }

    /// Queues the copy of the first `count` marks to a buffer, from a byte on, and then the clearing of all marks.
    pub(crate) fn take_marks(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        count: usize,
        to: Option<&wgpu::Buffer>,
        at: u64,
    ) {
        if let Some(buffer) = to.filter(|_| count > 0) {
            let bytes = (count * size_of::<u32>()) as u64;
            encoder.copy_buffer_to_buffer(&self.buffers.marks, 0, buffer, at, bytes);
        }
        encoder.clear_buffer(&self.buffers.marks, 0, None);
    }
}

impl RayBuffers {
    /// The bind group entries of rays through one layer, or through all.
    fn entries<'a>(
        &'a self,
        gpu: &Gpu,
        shared: &'a SharedBuffers,
        layer: Option<(&GpuLayer, &Pool)>,
    ) -> Vec<wgpu::BindGroupEntry<'a>> {
        let (parts, ranges) = (layer.map(|(layer, _)| layer.parts), layer.map(|(_, pool)| pool.ranges));
        let mut entries = vec![
            entry(bindings::FRAMES, Part::of_any(parts.map(|parts| parts.frame), &shared.frame)),
            entry(bindings::TABLE, Part::of_any(parts.map(|parts| parts.table), &shared.table)),
            entry(bindings::BRICKS, self.bricks.as_entire_binding()),
            entry(bindings::NODES, self.nodes.as_entire_binding()),
            entry(bindings::RANGES, Part::of_any(ranges, &self.ranges)),
            entry(bindings::OPAQUE_BEFORE, Part::of_any(parts.map(|parts| parts.counts), &self.opaque_before)),
        ];
        if gpu.report.feedback {
            entries.push(entry(bindings::MARKS, self.marks.as_entire_binding()));
        }
        entries
    }
}

impl RaycastPlan {
    /// Groups of nodes for this many slots: at worst each wanted cell of a cut has a path of its own down from its
    /// layer's root.
    fn groups(&self, slots: u32) -> u64 {
        self.layers as u64 + slots as u64 * (self.levels as u64).saturating_sub(1)
    }

    /// Most entries of draw lists. A cut wants fewer cells than there are slots; but the siblings left over by its
    /// splits are drawn too, when the camera has turned towards them and the next cut is not there yet.
    fn entries(&self, slots: u32) -> u64 {
        self.groups(slots) * GROUP as u64
    }

    pub(crate) fn marks_bytes(&self, slots: u32) -> u64 {
        self.entries(slots) * size_of::<u32>() as u64
    }

    pub(crate) fn nodes_bytes(&self, slots: u32) -> u64 {
        self.groups(slots) * (GROUP * size_of::<u32>()) as u64
    }

    pub(crate) fn bricks_bytes(&self, slots: u32) -> u64 {
        self.entries(slots) * size_of::<RayBrick>() as u64
    }

    pub(crate) fn ranges_bytes(&self, slots: u32) -> u64 {
        (slots as usize * macrocells::bytes(self.edge as usize)) as u64
    }
}
