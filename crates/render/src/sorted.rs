//! The `sorted` compositor: the draw list as instanced boxes, back to front, blended one over the other.

use crate::adapter::Gpu;
use crate::buffers::{SharedBuffers, buffer, entry};
use crate::error::GpuError;
use crate::frame::cell_instance;
use crate::gathering::Gathering;
use crate::layer::GpuLayer;
use crate::memory::CELLS_PER_SUBMISSION;
use crate::pipelines::Layouts;
use crate::pool::Pool;
use brickyard_pager::DrawList;
use brickyard_shaders::{CellInstance, bindings};
use brickyard_volume::Pyramid;
use wgpu::BufferUsages;

/// Its buffer of cells, written anew for every submission, and each layer's bindings.
#[derive(Debug)]
pub(crate) struct Sorted {
    cells: wgpu::Buffer,
    bindings: Vec<wgpu::BindGroup>,
}

impl Sorted {
    pub(crate) fn new(
        gpu: &Gpu,
        layouts: &Layouts,
        shared: &SharedBuffers,
        (layers, pools): (&[GpuLayer], &[Pool]),
    ) -> Result<Self, GpuError> {
        let bytes = (CELLS_PER_SUBMISSION * size_of::<CellInstance>()) as u64;
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let cells = gpu.allocate("cells", bytes, |device| buffer(device, "cells", bytes, usage))?;
        let of = |layer: &GpuLayer| {
            let own = vec![
                entry(bindings::FRAMES, layer.parts.frame.of(&shared.frame)),
                entry(bindings::TABLE, layer.parts.table.of(&shared.table)),
                entry(bindings::CELLS, cells.as_entire_binding()),
            ];
            shared.bindings(gpu, &layouts.march, std::slice::from_ref(&pools[layer.pool]), own)
        };
        let bindings = layers.iter().map(of).collect();
        Ok(Self { cells, bindings })
    }

    /// Draws a layer's cells in chunks, one submission each: short enough that no watchdog sees one as a hang. The
    /// first list of a picture clears the target; the others come before what is there.
    pub(crate) fn draw(
        &self,
        gpu: &Gpu,
        (gathering, pipeline): (&Gathering<'_>, &wgpu::RenderPipeline),
        (i, pool): (usize, &Pool),
        pyramid: &Pyramid,
        draw: &DrawList,
        is_first: bool,
    ) {
        let (plan, apron) = (&pool.atlas.plan, pool.apron());
        let chunks = draw.cells.len().div_ceil(CELLS_PER_SUBMISSION).max(1);
        for chunk in 0..chunks {
            let cells = draw.cells.chunks(CELLS_PER_SUBMISSION).nth(chunk).unwrap_or(&[]);
            let instances: Vec<_> = cells.iter().map(|c| cell_instance(c, pyramid, plan, apron)).collect();
            gpu.queue.write_buffer(&self.cells, 0, bytemuck::cast_slice(&instances));
            gathering.draw(gpu, pipeline, &self.bindings[i], is_first && chunk == 0, |pass| {
                pass.draw(0..14, 0..instances.len() as u32)
            });
        }
    }
}
