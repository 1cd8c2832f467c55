//! A layer of a renderer: its pool of slots, its transfer table, and its parts of the shared buffers.
//!
//! Indices within a part count from the part's beginning, as the shaders for one layer expect; the shaders for several
//! layers add the parts' offsets.

use crate::buffer_parts::{Part, Parts};
use crate::buffers::{RayBuffers, SharedBuffers};
use crate::frame::{Framed, TableInUse, frame_uniform};
use crate::pool::Pool;
use crate::transfer_table::{self, Places, TableCapacity};
use crate::variant::voxels_of;
use crate::{Gpu, GpuError};
use brickyard_pager::VolumeNeeds;
use brickyard_shaders::{FirstPlaces, FrameUniform, LayerShader};
use brickyard_volume::{Blend, OpaqueCodes, SlotEncoding, TransferTable};
use std::sync::Arc;
use wgpu::TextureFormat;

/// A layer of a renderer: its needs, pool, and parts of the shared buffers.
#[derive(Debug)]
pub(crate) struct GpuLayer {
    pub(crate) needs: VolumeNeeds,
    /// Index of the layer's pool.
    pub(crate) pool: usize,
    pub(crate) parts: Parts,
    /// Contents of the table part, the unit of its integrals, and the codes with opacity.
    table: Option<(Arc<TransferTable>, Places)>,
    sum_unit: f32,
    pub(crate) opaque: OpaqueCodes,
}

impl GpuLayer {
    pub(crate) fn new(needs: VolumeNeeds, pool: usize, parts: Parts) -> Self {
        let opaque = OpaqueCodes::new(&TransferTable::from_entries(vec![[0.0; 4]; 2], 1.0));
        Self { needs, pool, parts, table: None, sum_unit: 0.0, opaque }
    }

    pub(crate) fn check(&self, framed: &Framed<'_>) -> Result<(), GpuError> {
        let (frame, needs) = (framed.settings, &self.needs);
        if frame.encoding.of_slots() != needs.encoding.of_slots() || framed.pyramid.edge() != needs.edge {
            let [asked, made] = [(frame.encoding, framed.pyramid.edge()), (needs.encoding, needs.edge)]
                .map(|(encoding, edge)| format!("{encoding:?} in bricks of {edge}"));
            return Err(GpuError::Mismatch(format!("frame of {asked}: this renderer was made for {made}")));
        }
        let (asked, given) = (frame.needs(), needs.bricks);
        if !given.satisfy(&asked) {
            return Err(GpuError::Mismatch(format!("a frame of {asked:?}: this renderer's bricks have {given:?}")));
        }
        let (found, per_code) = (frame.table.entries.len(), frame.table.entries_per_code);
        let entries = frame.encoding.span_codes() as usize * per_code + 1;
        if found != entries || found > TransferTable::most_entries(needs.encoding.format) {
            return Err(GpuError::Mismatch(format!("transfer table of {found} entries: expected {entries}")));
        }
        Ok(())
    }

    /// Sends a frame's transfer table to the GPU unless it is already there.
    pub(crate) fn set_table(
        &mut self,
        gpu: &Gpu,
        shared: &SharedBuffers,
        rays: Option<&RayBuffers>,
        wanted: &Arc<TransferTable>,
        holds: Places,
    ) {
        let is_wanted = |table: &Arc<TransferTable>| Arc::ptr_eq(table, wanted) || table == wanted;
        if self.table.as_ref().is_some_and(|(table, held)| *held == holds && is_wanted(table)) {
            return;
        }
        let (words, sum_unit) = transfer_table::words(wanted, self.room(), holds);
        gpu.queue.write_buffer(&shared.table, self.parts.table.at, bytemuck::cast_slice(&words));
        self.sum_unit = sum_unit;
        if let Some(rays) = rays {
            self.opaque = OpaqueCodes::new(wanted);
            let counts = bytemuck::cast_slice(self.opaque.before());
            gpu.queue.write_buffer(&rays.opaque_before, self.parts.counts.at, counts);
        }
        self.table = Some((wanted.clone(), holds));
    }

    fn room(&self) -> TableCapacity {
        TableCapacity::new(self.needs.encoding.format, &self.needs.bricks)
    }

    pub(crate) fn uniform(&self, framed: &Framed<'_>, pool: &Pool, composite: TextureFormat) -> FrameUniform {
        let room = self.room();
        let (mask_at, grid_at) = (room.mask_at(), room.grid_at());
        let counts_per_code = self.opaque.places_per_code().into();
        let table = TableInUse { sum_unit: self.sum_unit, counts_per_code, mask_at, grid_at };
        // Sums of half floats must stay finite.
        let most_depth = if composite == TextureFormat::Rgba32Float { 1e30 } else { 1024.0 };
        frame_uniform(framed, &pool.atlas, pool.apron(), table, most_depth)
    }

    /// Describes this layer for a shader of several layers, with or without an expression over them. `ranges` is the
    /// part with the pool's macro-cells.
    pub(crate) fn shader(&self, framed: &Framed<'_>, ranges: Part, has_expression: bool) -> LayerShader {
        let Parts { table, counts, .. } = self.parts;
        LayerShader {
            pool: self.pool as u32,
            voxels: voxels_of(&framed.settings.encoding),
            is_whole: framed.settings.has_whole_values(),
            adds: framed.blend == Blend::Add,
            has_surfaces: !framed.settings.surfaces.is_empty(),
            has_grid: framed.settings.grid().is_some(),
            first: FirstPlaces {
                range: ranges.first(size_of::<u32>()),
                place: table.first(size_of::<[u32; 2]>()),
                count: counts.first(size_of::<u32>()),
            },
            values: if has_expression { value_bits(&framed.settings.encoding) } else { [0; 2] },
        }
    }
}

/// Returns the value of the transfer table's first entry, and the difference from it to the last entry's, as f32 bits.
pub(crate) fn value_bits(encoding: &SlotEncoding) -> [u32; 2] {
    let [low, high] = encoding.table_values();
    [low, high - low].map(|value| (value as f32).to_bits())
}
