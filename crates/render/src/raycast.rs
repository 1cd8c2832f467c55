//! The `raycast` and `compute` compositors: one ray per pixel, front to back through an octree over the draw list, ending where nothing
//! behind can be seen and leaping over what shows nothing: leaves without a brick, bricks, and macro-cells inside bricks.
//!
//! In direct volume rendering rays leave marks: how much light was left when they entered a brick, the most of all rays. They
//! come back with the picture, and say which bricks nobody could see.
//!
//! Macro-cells' ranges of codes go to the GPU when their brick does. What a range means under the frame's table is found by
//! two look-ups in a table of counts, so that an edit of the transfer function sends 4 bytes per entry and no brick.

use crate::adapter::Gpu;
use crate::atlas::{Atlas, AtlasPlan};
use crate::error::GpuError;
use crate::gathering::{Gathering, SharedBuffers, buffer, entry};
use crate::memory::RaycastPlan;
use crate::pipelines::MarchPipeline;
use crate::targets::Targets;
use crate::tree::{GROUP, Slots, Tree, Visibility, pack_range};
use brickyard_pager::{DrawList, Slot};
use brickyard_shaders::RayBrick;
use brickyard_volume::macrocells::{self, per_axis};
use brickyard_volume::{FrameSettings, MacroCells, Needs, OpaqueCodes, Pyramid, SlotEncoding, TransferTable};
use wgpu::BufferUsages;

/// Its buffers and bindings, and the range of codes of each slot's brick.
#[derive(Debug)]
pub(crate) struct Raycast {
    plan: RaycastPlan,
    nodes: wgpu::Buffer,
    bricks: wgpu::Buffer,
    ranges: wgpu::Buffer,
    opaque_before: wgpu::Buffer,
    /// By brick, how it was entered; all zero between frames.
    marks: wgpu::Buffer,
    bindings: wgpu::BindGroup,
    slot_ranges: Vec<[u16; 2]>,
    /// Of the frame's table.
    opaque: OpaqueCodes,
}

impl Raycast {
    pub(crate) fn new(
        gpu: &Gpu,
        layout: &wgpu::BindGroupLayout,
        shared: &SharedBuffers,
        atlas: &Atlas,
        plan: RaycastPlan,
    ) -> Result<Self, GpuError> {
        let slots = atlas.plan.slots();
        let buffers = [
            ("octree", plan.nodes_bytes(slots)),
            ("bricks", plan.bricks_bytes(slots)),
            ("macro-cells", plan.ranges_bytes(slots)),
            ("opaque entries", plan.opaque_bytes),
            ("marks", plan.marks_bytes(slots)),
        ];
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST | BufferUsages::COPY_SRC;
        let make = |device: &wgpu::Device| buffers.map(|(label, bytes)| buffer(device, label, bytes, usage));
        let total = buffers.iter().map(|(_, bytes)| bytes).sum();
        let [nodes, bricks, ranges, opaque_before, marks] =
            gpu.allocate("the octree and the macro-cells", total, make)?;
        let mut own = vec![
            entry(1, bricks.as_entire_binding()),
            entry(6, nodes.as_entire_binding()),
            entry(7, ranges.as_entire_binding()),
            entry(8, opaque_before.as_entire_binding()),
        ];
        if gpu.report.feedback {
            own.push(entry(9, marks.as_entire_binding()));
        }
        let bindings = shared.bindings(gpu, layout, atlas, &own);
        let slot_ranges = vec![macrocells::NONE; slots as usize];
        let opaque = OpaqueCodes::new(&TransferTable::from_entries(Vec::new(), 1.0));
        Ok(Self { plan, nodes, bricks, ranges, opaque_before, marks, bindings, slot_ranges, opaque })
    }

    /// Takes note of what a brick that goes into a slot holds.
    pub(crate) fn upload(&mut self, gpu: &Gpu, Slot(slot): Slot, codes: &[u8], encoding: &SlotEncoding, needs: Needs) {
        let edge = self.plan.edge as usize;
        let cells = match self.plan.leaps {
            true => MacroCells::new(codes, encoding.format, encoding.has_invalid, edge, needs),
            false => MacroCells::of_anything(encoding.format, edge),
        };
        let packed: Vec<u32> = cells.ranges().iter().map(|&range| pack_range(range)).collect();
        gpu.queue.write_buffer(&self.ranges, self.plan.ranges_bytes(slot), bytemuck::cast_slice(&packed));
        self.slot_ranges[slot as usize] = cells.whole();
    }

    /// Takes note of a new table.
    pub(crate) fn set_table(&mut self, gpu: &Gpu, table: &TransferTable) {
        self.opaque = OpaqueCodes::new(table);
        gpu.queue.write_buffer(&self.opaque_before, 0, bytemuck::cast_slice(self.opaque.before()));
    }

    /// Draws the list, some rows of the picture per submission.
    ///
    /// # Errors
    /// If the list has more cells than there are slots, or its pyramid more levels than this was made for.
    pub(crate) fn draw(
        &self,
        gpu: &Gpu,
        (gathering, pipeline): (&Gathering<'_>, &MarchPipeline),
        frame: &FrameSettings,
        pyramid: &Pyramid,
        draw: &DrawList,
        (atlas, apron): (&AtlasPlan, u32),
    ) -> Result<(), GpuError> {
        let macro_cells = per_axis(self.plan.edge as usize).pow(3) as u32;
        let slots = Slots { atlas, apron, macro_cells, ranges: &self.slot_ranges };
        let (mode, has_invalid) = (frame.mode, frame.encoding.has_invalid);
        let visibility = Visibility { mode, has_invalid, opaque: &self.opaque, leaps: self.plan.leaps };
        let tree = Tree::new(pyramid, draw, &visibility, &slots);
        let (nodes, bricks): (&[u8], &[u8]) = (bytemuck::cast_slice(&tree.nodes), bytemuck::cast_slice(&tree.bricks));
        if nodes.len() as u64 > self.nodes.size() || bricks.len() as u64 > self.bricks.size() {
            return Err(GpuError::Mismatch(format!(
                "draw list of {} entries and {} octree nodes: this renderer was made for {} slots and {} levels",
                tree.bricks.len(),
                tree.nodes.len() / GROUP,
                atlas.slots(),
                self.plan.levels
            )));
        }
        gpu.queue.write_buffer(&self.nodes, 0, nodes);
        gpu.queue.write_buffer(&self.bricks, 0, bricks);
        gathering.cast_rays(gpu, pipeline, &self.bindings, 1);
        Ok(())
    }
}

impl Raycast {
    /// Queues the copy of the first `count` marks, and the end of all.
    pub(crate) fn take_marks(&self, encoder: &mut wgpu::CommandEncoder, count: usize, to: &Targets) {
        if count > 0 {
            let bytes = (count * size_of::<u32>()) as u64;
            encoder.copy_buffer_to_buffer(&self.marks, 0, &to.read_back, to.marks_offset(), bytes);
        }
        encoder.clear_buffer(&self.marks, 0, None);
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
