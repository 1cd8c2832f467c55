//! A layer of a renderer: its atlas, its uploads, and its parts of the buffers that all layers share.
//!
//! In its parts everything counts from the part's beginning, so that a layer's bind group shows the shaders of one layer what they know;
//! the shaders of several add where the parts begin.

use crate::adapter::Gpu;
use crate::atlas::Atlas;
use crate::buffers::{RayBuffers, SharedBuffers};
use crate::error::GpuError;
use crate::frame::{Framed, TableInUse, frame_uniform};
use crate::memory::LayerPlan;
use crate::parts::Parts;
use crate::table::{self, Room};
use crate::tree::{GROUP, Slots, Tree, Visibility, pack_range};
use crate::upload::Uploader;
use brickyard_pager::{DrawList, Slot, VolumeNeeds};
use brickyard_shaders::{FirstPlaces, FrameUniform, LayerShader, RayBrick};
use brickyard_volume::macrocells::{self, per_axis};
use brickyard_volume::{Blend, MacroCells, OpaqueCodes, SlotEncoding, TransferTable};
use std::sync::Arc;
use wgpu::TextureFormat;

/// The layer.
#[derive(Debug)]
pub(crate) struct GpuLayer {
    pub(crate) needs: VolumeNeeds,
    pub(crate) plan: LayerPlan,
    pub(crate) atlas: Atlas,
    pub(crate) uploader: Uploader,
    pub(crate) parts: Parts,
    /// The range of codes of each slot's brick.
    slot_ranges: Vec<[u16; 2]>,
    /// What its part of the table buffer holds, the unit of its integrals, and its codes with opacity.
    table: Option<Arc<TransferTable>>,
    sum_unit: f32,
    opaque: OpaqueCodes,
}

impl GpuLayer {
    pub(crate) fn new(
        gpu: &Gpu,
        needs: VolumeNeeds,
        plan: LayerPlan,
        batch: u64,
        parts: Parts,
    ) -> Result<Self, GpuError> {
        let codes = needs.encoding.format;
        let gradients = needs.bricks.gradients(needs.edge);
        Ok(Self {
            needs,
            plan,
            atlas: Atlas::new(gpu, plan.atlas, gpu.report.formats.atlas(codes), gradients)?,
            uploader: Uploader::new(codes, batch),
            parts,
            slot_ranges: vec![macrocells::NONE; plan.atlas.slots() as usize],
            table: None,
            sum_unit: 0.0,
            opaque: OpaqueCodes::new(&TransferTable::from_entries(Vec::new(), 1.0)),
        })
    }

    /// How many bricks fit.
    pub(crate) fn slots(&self) -> u32 {
        self.plan.atlas.slots()
    }

    /// Puts a padded brick's codes into a slot.
    pub(crate) fn upload(
        &mut self,
        gpu: &Gpu,
        rays: Option<&RayBuffers>,
        slot: Slot,
        codes: &[u8],
    ) -> Result<(), GpuError> {
        self.uploader.check(&self.atlas, slot, codes)?;
        if let (Some(rays), Some(plan)) = (rays, &self.plan.raycast) {
            let VolumeNeeds { encoding, edge, bricks, .. } = self.needs;
            let cells = match plan.leaps {
                true => MacroCells::new(codes, encoding.format, encoding.has_invalid, edge as usize, bricks),
                false => MacroCells::of_anything(encoding.format, edge as usize),
            };
            let packed: Vec<u32> = cells.ranges().iter().map(|&range| pack_range(range)).collect();
            let at = self.parts.ranges.at + plan.ranges_bytes(slot.0);
            gpu.queue.write_buffer(&rays.ranges, at, bytemuck::cast_slice(&packed));
            self.slot_ranges[slot.0 as usize] = cells.whole();
        }
        self.uploader.upload(gpu, &self.atlas, slot, codes)
    }

    /// Whether a frame is of this layer.
    pub(crate) fn check(&self, framed: &Framed<'_>) -> Result<(), GpuError> {
        let (frame, needs) = (framed.settings, &self.needs);
        if frame.encoding != needs.encoding || framed.pyramid.edge() != needs.edge {
            return Err(GpuError::Mismatch(format!(
                "frame of {:?} in bricks of {}: this renderer was made for {:?} in bricks of {}",
                frame.encoding,
                framed.pyramid.edge(),
                needs.encoding,
                needs.edge
            )));
        }
        let (asked, given) = (frame.needs(), needs.bricks);
        if !given.satisfy(&asked) {
            return Err(GpuError::Mismatch(format!("a frame of {asked:?}: this renderer's bricks have {given:?}")));
        }
        let (entries, found) = (needs.encoding.format.max_code() as usize + 1, frame.table.entries.len());
        if found != entries {
            return Err(GpuError::Mismatch(format!("transfer table of {found} entries: expected {entries}")));
        }
        Ok(())
    }

    /// Whether a list is of slots that there are.
    pub(crate) fn check_list(&self, draw: &DrawList) -> Result<(), GpuError> {
        match draw.cells.iter().find(|cell| cell.slot.0 >= self.slots()) {
            None => Ok(()),
            Some(cell) => {
                let problem = format!("{} is drawn from slot {} of {}", cell.brick, cell.slot.0, self.slots());
                Err(GpuError::Mismatch(problem))
            }
        }
    }

    /// Sends a frame's table, if it is not there.
    pub(crate) fn set_table(
        &mut self,
        gpu: &Gpu,
        shared: &SharedBuffers,
        rays: Option<&RayBuffers>,
        wanted: &Arc<TransferTable>,
    ) {
        if self.table.as_ref().is_some_and(|table| Arc::ptr_eq(table, wanted) || table == wanted) {
            return;
        }
        let words = table::words(wanted, self.room());
        gpu.queue.write_buffer(&shared.table, self.parts.table.at, bytemuck::cast_slice(&words.words));
        self.sum_unit = words.sum_unit;
        if let Some(rays) = rays {
            self.opaque = OpaqueCodes::new(wanted);
            let counts = bytemuck::cast_slice(self.opaque.before());
            gpu.queue.write_buffer(&rays.opaque_before, self.parts.counts.at, counts);
        }
        self.table = Some(wanted.clone());
    }

    fn room(&self) -> Room {
        Room::new(self.needs.encoding.format, &self.needs.bricks)
    }

    /// A frame's uniform.
    pub(crate) fn uniform(&self, framed: &Framed<'_>, composite: TextureFormat) -> FrameUniform {
        let room = self.room();
        let table = TableInUse { sum_unit: self.sum_unit, mask_at: room.mask_at(), grid_at: room.grid_at() };
        // Sums of half floats have to stay finite.
        let most_depth = if composite == TextureFormat::Rgba32Float { 1e30 } else { 1024.0 };
        frame_uniform(framed, (&self.atlas, self.needs.bricks.apron), table, most_depth)
    }

    /// Sends the octree over a list.
    ///
    /// # Errors
    /// If the list has more cells than there are slots, or its pyramid more levels than this was made for.
    pub(crate) fn set_list(
        &self,
        gpu: &Gpu,
        rays: &RayBuffers,
        framed: &Framed<'_>,
        draw: &DrawList,
    ) -> Result<(), GpuError> {
        let macro_cells = per_axis(self.needs.edge as usize).pow(3) as u32;
        let (atlas, apron) = (&self.atlas.plan, self.needs.bricks.apron);
        let slots = Slots { atlas, apron, macro_cells, ranges: &self.slot_ranges };
        let (mode, has_invalid) = (framed.settings.mode, self.needs.encoding.has_invalid);
        let leaps = self.plan.raycast.is_some_and(|plan| plan.leaps);
        let visibility = Visibility { mode, has_invalid, opaque: &self.opaque, leaps };
        let tree = Tree::new(framed.pyramid, draw, &visibility, &slots);
        let (nodes, bricks): (&[u8], &[u8]) = (bytemuck::cast_slice(&tree.nodes), bytemuck::cast_slice(&tree.bricks));
        let Parts { nodes: nodes_part, bricks: bricks_part, .. } = self.parts;
        if nodes.len() as u64 > nodes_part.bytes || bricks.len() as u64 > bricks_part.bytes {
            return Err(GpuError::Mismatch(format!(
                "draw list of {} entries and {} octree nodes: this renderer was made for {} slots and {} levels",
                tree.bricks.len(),
                tree.nodes.len() / GROUP,
                self.slots(),
                self.needs.levels
            )));
        }
        gpu.queue.write_buffer(&rays.nodes, nodes_part.at, nodes);
        gpu.queue.write_buffer(&rays.bricks, bricks_part.at, bricks);
        Ok(())
    }

    /// What the shader of several layers has to know of it in a frame.
    pub(crate) fn shader(&self, framed: &Framed<'_>) -> LayerShader {
        let Parts { table, nodes, bricks, ranges, counts, marks, .. } = self.parts;
        LayerShader {
            has_invalid: self.needs.encoding.has_invalid,
            adds: framed.blend == Blend::Add,
            has_surfaces: !framed.settings.surfaces.is_empty(),
            has_grid: framed.settings.grid().is_some(),
            first: FirstPlaces {
                node: nodes.first(size_of::<u32>()),
                brick: bricks.first(size_of::<RayBrick>()),
                range: ranges.first(size_of::<u32>()),
                place: table.first(size_of::<[u32; 2]>()),
                count: counts.first(size_of::<u32>()),
                mark: marks.first(size_of::<u32>()),
            },
            values: value_bits(&self.needs.encoding),
        }
    }
}

/// The bits of the value of code 0, and of the difference to that of the last.
pub(crate) fn value_bits(encoding: &SlotEncoding) -> [u32; 2] {
    [encoding.low, encoding.high - encoding.low].map(|value| (value as f32).to_bits())
}
