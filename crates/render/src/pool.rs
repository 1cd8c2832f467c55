//! A pool: slots of one size and format, holding bricks of several layers side by side, and the uploads into them.
//!
//! Assigning slots to bricks is the pager's business: any layer of a pool may be drawn from any of its slots. Each slot
//! comes with its brick's code ranges for rays: those of its macro-cells on the GPU, and their union here.

use crate::atlas::Atlas;
use crate::buffer_parts::Part;
use crate::buffers::RayBuffers;
use crate::frame::Framed;
use crate::leaf_octree::{Slots, Tree, Visibility, pack_range};
use crate::memory::PoolPlan;
use crate::upload::Uploader;
use crate::{Gpu, GpuError};
use brickyard_pager::{DrawList, Slot, VolumeNeeds};
use brickyard_volume::macrocells::{self, per_axis};
use brickyard_volume::{MacroCells, OpaqueCodes, SlotFormat};

/// A pool of slots of one size and format on the GPU, for bricks of several layers.
#[derive(Debug)]
pub(crate) struct Pool {
    /// The needs of one of its layers: all have such bricks.
    needs: VolumeNeeds,
    plan: PoolPlan,
    pub(crate) atlas: Atlas,
    pub(crate) uploader: Uploader,
    /// The part of the macro-cells' buffer for this pool's slots.
    pub(crate) ranges: Part,
    /// The code range of each slot's brick.
    slot_ranges: Vec<[u16; 2]>,
}

impl Pool {
    pub(crate) fn new(
        gpu: &Gpu,
        needs: VolumeNeeds,
        plan: PoolPlan,
        batch: u64,
        batches: u64,
        ranges: Part,
    ) -> Result<Self, GpuError> {
        let codes = needs.encoding.format;
        let gradients = needs.bricks.gradients(needs.edge);
        Ok(Self {
            needs,
            plan,
            atlas: Atlas::new(gpu, plan.atlas, gpu.report.formats.atlas(codes), gradients)?,
            uploader: Uploader::new(codes, batch, batches),
            ranges,
            slot_ranges: vec![macrocells::NONE; plan.atlas.slots() as usize],
        })
    }

    /// Number of slots, and so of bricks that fit.
    pub(crate) fn slots(&self) -> u32 {
        self.plan.atlas.slots()
    }

    pub(crate) fn is_float(&self) -> bool {
        self.needs.encoding.format == SlotFormat::F32
    }

    /// Width of a brick's apron in its slot, voxels.
    pub(crate) fn apron(&self) -> u32 {
        self.needs.bricks.apron
    }

    /// The texture bound as stored gradients. A pool without gradients binds its atlas instead, which is never read as
    /// gradients.
    pub(crate) fn gradients(&self) -> &wgpu::Texture {
        self.atlas.gradients.as_ref().unwrap_or(&self.atlas.texture)
    }

    /// Puts a padded brick's codes and gradients into a slot and, if rays are cast, its macro-cells into their buffer.
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
            let cells = match plan.skips_empty {
                true => MacroCells::new(codes, encoding.format, encoding.has_invalid, edge as usize, bricks),
                false => MacroCells::of_anything(encoding.format, edge as usize),
            };
            let packed: Vec<u32> = cells.ranges().iter().map(|&range| pack_range(range)).collect();
            let at = self.ranges.at + plan.ranges_bytes(slot.0);
            gpu.queue.write_buffer(&rays.ranges, at, bytemuck::cast_slice(&packed));
            self.slot_ranges[slot.0 as usize] = cells.whole();
        }
        self.uploader.upload(gpu, &self.atlas, slot, codes)
    }

    pub(crate) fn check_list(&self, draw: &DrawList) -> Result<(), GpuError> {
        let Some(cell) = draw.cells.iter().find(|cell| cell.slot.0 >= self.slots()) else { return Ok(()) };
        let problem = format!("{} is drawn from slot {} of {}", cell.brick, cell.slot.0, self.slots());
        Err(GpuError::Mismatch(problem))
    }

    /// Builds the octree over a layer's draw list. `opaque` lists the codes with opacity.
    pub(crate) fn tree(&self, framed: &Framed<'_>, draw: &DrawList, opaque: &OpaqueCodes) -> Tree {
        let macro_cells = per_axis(self.needs.edge as usize).pow(3) as u32;
        let slots = Slots { atlas: &self.plan.atlas, apron: self.apron(), macro_cells, ranges: &self.slot_ranges };
        // The macro-cells of floats are unknown.
        let skips_empty = self.plan.raycast.is_some_and(|plan| plan.skips_empty) && !self.is_float();
        let (mode, has_invalid) = (framed.settings.mode, self.needs.encoding.has_invalid);
        Tree::new(framed.pyramid, draw, &Visibility { mode, has_invalid, opaque, skips_empty }, &slots)
    }
}
