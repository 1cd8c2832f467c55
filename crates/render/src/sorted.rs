//! The `sorted` compositor: cells of draw lists as instanced boxes, back to front, blended one over the other.
//!
//! Layers of one grid are drawn together: their lists are merged by rank into one list of cells, each with a brick of
//! every layer. Where bricks fade in, a cell becomes several boxes, one for each share of the pixels with different
//! bricks.

use crate::buffer_parts::Part;
use crate::buffers::{SharedBuffers, buffer, entry};
use crate::frame::{cell_brick, cell_instance};
use crate::layer::GpuLayer;
use crate::layouts::Layouts;
use crate::march::{Gathering, MarchBindings};
use crate::memory::CELLS_PER_SUBMISSION;
use crate::pool::Pool;
use crate::{Gpu, GpuError};
use brickyard_pager::{DrawCell, DrawList, PixelShare};
use brickyard_shaders::{CellBrick, CellInstance, bindings};
use brickyard_volume::{PixelRect, Pyramid};
use wgpu::BufferUsages;

/// The buffers and bindings, with cells and bricks rewritten for every submission.
#[derive(Debug)]
pub(crate) struct Sorted {
    cells: wgpu::Buffer,
    bricks: wgpu::Buffer,
    pub(crate) bindings: MarchBindings,
}

/// A layer's draw list, its pyramid, and the pool with its bricks.
pub(crate) type Drawn<'a> = (&'a DrawList, &'a Pyramid, &'a Pool);

/// The boxes to draw, back to front, and for each box the bricks of the layers in it.
#[derive(Debug, Default)]
pub(crate) struct Boxes {
    cells: Vec<CellInstance>,
    bricks: Vec<CellBrick>,
}

impl Boxes {
    /// Builds the boxes of one layer, or of several layers drawn together.
    ///
    /// # Errors
    /// If the layers' cells are not those of one cut.
    pub(crate) fn new(layers: &[Drawn<'_>]) -> Result<Self, GpuError> {
        let mut entries: Vec<(usize, &DrawCell)> = Vec::new();
        for (i, (draw, ..)) in layers.iter().enumerate() {
            entries.extend(draw.cells.iter().map(|entry| (i, entry)));
        }
        if layers.len() > 1 {
            // The sort is stable: entries of one layer keep their order.
            entries.sort_by_key(|(_, entry)| entry.rank);
            // Layers have times and channels of their own.
            let is_torn =
                |(_, a): &(usize, &DrawCell), (_, b): &(usize, &DrawCell)| (a.rank == b.rank) != (a.region == b.region);
            if let Some([(_, a), (_, b)]) = entries.array_windows().find(|[a, b]| is_torn(a, b)) {
                let problem = format!("{} at rank {}, {} at rank {}", a.cell, a.rank, b.cell, b.rank);
                return Err(GpuError::Mismatch(format!("the layers' cells are not of one cut: {problem}")));
            }
        }
        let mut boxes = Self::default();
        for cell in entries.chunk_by(|(_, a), (_, b)| a.region == b.region) {
            boxes.push(layers, cell);
        }
        Ok(boxes)
    }

    /// Adds a cell with these entries, once for each share of the pixels in which no layer changes its brick.
    fn push(&mut self, layers: &[Drawn<'_>], entries: &[(usize, &DrawCell)]) {
        let mut from = 0;
        while from < PixelShare::THRESHOLDS {
            let ends = entries.iter().flat_map(|(_, entry)| [entry.pixels.from, entry.pixels.to]);
            let to = ends.filter(|&end| end > from).min().unwrap_or(PixelShare::THRESHOLDS);
            let shown = entries.iter().filter(|(_, entry)| (entry.pixels.from..entry.pixels.to).contains(&from));
            let first = self.bricks.len();
            self.bricks.resize(first + layers.len(), CellBrick::default());
            for (i, entry) in shown {
                let (_, pyramid, pool) = layers[*i];
                self.bricks[first + i] = cell_brick(entry, pyramid, &pool.atlas.plan, pool.apron());
            }
            self.cells.push(cell_instance(&entries[0].1.region, PixelShare { from, to }));
            from = to;
        }
    }
}

impl Sorted {
    pub(crate) fn new(
        gpu: &Gpu,
        layouts: &Layouts,
        shared: &SharedBuffers,
        layers: &[GpuLayer],
        pools: &[Pool],
    ) -> Result<Self, GpuError> {
        let sizes = [("cells", size_of::<CellInstance>()), ("cells' bricks", size_of::<CellBrick>())];
        let sizes = sizes.map(|(label, bytes)| (label, (CELLS_PER_SUBMISSION * bytes) as u64));
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let [cells, bricks] = gpu.allocate("cells", sizes.iter().map(|(_, bytes)| bytes).sum(), |device| {
            sizes.map(|(label, bytes)| buffer(device, label, bytes, usage))
        })?;
        let own = |layer: Option<(&GpuLayer, &Pool)>| {
            let parts = layer.map(|(layer, _)| layer.parts);
            vec![
                entry(bindings::FRAMES, Part::of_any(parts.map(|parts| parts.frame), &shared.frame)),
                entry(bindings::TABLE, Part::of_any(parts.map(|parts| parts.table), &shared.table)),
                entry(bindings::CELLS, cells.as_entire_binding()),
                entry(bindings::CELL_BRICKS, bricks.as_entire_binding()),
            ]
        };
        let bindings = MarchBindings::new(gpu, layouts, shared, layers, pools, own);
        Ok(Self { cells, bricks, bindings })
    }

    /// Draws boxes in chunks, one submission each, so that no watchdog sees a hang. `is_first` clears the target;
    /// otherwise the boxes come in front of its contents.
    ///
    /// # Errors
    /// If the picture is given up, or the device fails.
    pub(crate) fn draw(
        &self,
        gpu: &Gpu,
        gathering: &Gathering<'_>,
        pipeline: &wgpu::RenderPipeline,
        bindings: &wgpu::BindGroup,
        boxes: &Boxes,
        is_first: bool,
    ) -> Result<(), GpuError> {
        let layers = boxes.bricks.len() / boxes.cells.len().max(1);
        let most = CELLS_PER_SUBMISSION / layers.max(1);
        let chunks = boxes.cells.len().div_ceil(most).max(1);
        for chunk in 0..chunks {
            let cells = boxes.cells.chunks(most).nth(chunk).unwrap_or(&[]);
            let bricks = boxes.bricks.chunks(most * layers.max(1)).nth(chunk).unwrap_or(&[]);
            gpu.queue.write_buffer(&self.cells, 0, bytemuck::cast_slice(cells));
            gpu.queue.write_buffer(&self.bricks, 0, bytemuck::cast_slice(bricks));
            let PixelRect { x0, x1, y0, y1 } = gathering.rect;
            gathering.by_rows(gpu, y1 - y0, 1, |band| {
                gathering.draw(gpu, pipeline, bindings, is_first && chunk == 0 && band.is_first, |pass| {
                    pass.set_scissor_rect(x0, band.top, x1 - x0, band.rows);
                    pass.draw(0..14, 0..cells.len() as u32);
                })
            })?;
        }
        Ok(())
    }
}
