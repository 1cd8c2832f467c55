//! The parts common to all compositors: the bindings of every march, and the passes that it submits.

use crate::buffer_parts::{Part, Parts};
use crate::buffers::TIMESTAMP_BYTES;
use crate::buffers::{SharedBuffers, entry};
use crate::layer::GpuLayer;
use crate::layouts::Layouts;
use crate::pace::Pace;
use crate::pipelines::{Pipeline, TEXELS_GROUP};
use crate::pool::Pool;
use crate::{Gpu, GpuError};
use brickyard_shaders::{FrameUniform, WORKGROUP_PX, bindings};
use brickyard_volume::PixelRect;
use wgpu::BindingResource;

impl SharedBuffers {
    /// Creates the bind group of a march through layers of some pools. `own` holds the entries for frames, tables and
    /// the compositor; the pools' textures are added.
    pub(crate) fn bindings(
        &self,
        gpu: &Gpu,
        layout: &wgpu::BindGroupLayout,
        pools: &[Pool],
        own: Vec<wgpu::BindGroupEntry<'_>>,
    ) -> wgpu::BindGroup {
        let sampler = gpu.linear_sampler("atlas");
        let view = |texture: &wgpu::Texture| texture.create_view(&Default::default());
        let atlases: Vec<_> = pools.iter().map(|pool| view(&pool.atlas.texture)).collect();
        let gradients: Vec<_> =
            pools.iter().filter(|_| self.has_gradients).map(|pool| view(pool.gradients())).collect();
        let textures = (bindings::FIRST_ATLAS..).zip(&atlases).chain((bindings::FIRST_GRADIENTS..).zip(&gradients));
        let mut entries = own;
        entries.push(entry(bindings::ATLAS_SAMPLER, BindingResource::Sampler(&sampler)));
        entries.extend(textures.map(|(at, view)| entry(at, BindingResource::TextureView(view))));
        gpu.bind_group("march", layout, &entries)
    }

    /// The bind group of a pass that resolves a layer's gathered samples, or, if there are any, sums of joined layers.
    pub(crate) fn resolve_bindings(
        &self,
        gpu: &Gpu,
        layouts: &Layouts,
        layer: &Parts,
        gathered: &wgpu::TextureView,
        sums: Option<&[wgpu::TextureView; 2]>,
    ) -> wgpu::BindGroup {
        let frames = entry(bindings::FRAMES, layer.frame.of(&self.frame));
        let view = |binding, view| entry(binding, BindingResource::TextureView(view));
        if let Some([mixed, emission]) = sums {
            let entries = [frames, view(bindings::GATHERED, mixed), view(bindings::EMISSION, emission)];
            return gpu.bind_group("joined", &layouts.joined, &entries);
        }
        let table = entry(bindings::TABLE, layer.table.of(&self.table));
        gpu.bind_group("resolve", &layouts.resolve, &[frames, table, view(bindings::GATHERED, gathered)])
    }

    /// Queues the copy of the picture's timestamps, if any, to a buffer.
    pub(crate) fn take_timestamps(&self, encoder: &mut wgpu::CommandEncoder, to: &wgpu::Buffer) {
        if let Some((queries, ticks)) = &self.timestamps {
            encoder.resolve_query_set(queries, 0..2, ticks, 0);
            encoder.copy_buffer_to_buffer(ticks, 0, to, 0, TIMESTAMP_BYTES);
        }
    }

    pub(crate) fn timestamp_writes(
        &self,
        begin: Option<u32>,
        end: Option<u32>,
    ) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
        let (query_set, _) = self.timestamps.as_ref().filter(|_| begin.or(end).is_some())?;
        Some(wgpu::RenderPassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: begin,
            end_of_pass_write_index: end,
        })
    }
}

/// The bind groups of a compositor's marches.
#[derive(Debug)]
pub(crate) struct MarchBindings {
    /// Each layer's own.
    each: Vec<wgpu::BindGroup>,
    /// Through all layers.
    joint: wgpu::BindGroup,
}

impl MarchBindings {
    /// `own` returns the entries for frames, tables and the compositor: of a layer, or of all.
    pub(crate) fn new<'a>(
        gpu: &Gpu,
        layouts: &Layouts,
        shared: &SharedBuffers,
        layers: &[GpuLayer],
        pools: &[Pool],
        own: impl Fn(Option<(&GpuLayer, &Pool)>) -> Vec<wgpu::BindGroupEntry<'a>>,
    ) -> Self {
        let of = |layer: &GpuLayer| {
            let pool = &pools[layer.pool];
            let layout = layouts.march(pool.is_float());
            shared.bindings(gpu, layout, std::slice::from_ref(pool), own(Some((layer, pool))))
        };
        let joint = shared.bindings(gpu, &layouts.joint, pools, own(None));
        Self { each: layers.iter().map(of).collect(), joint }
    }

    /// Returns a layer's bind group, or that of all.
    pub(crate) fn of(&self, layer: Option<usize>) -> &wgpu::BindGroup {
        layer.map_or(&self.joint, |layer| &self.each[layer])
    }
}

/// Draws one triangle over the whole picture.
pub(crate) fn draw_over_all(
    pass: &mut wgpu::RenderPass<'_>,
    pipeline: &wgpu::RenderPipeline,
    bindings: &wgpu::BindGroup,
) {
    pass.set_pipeline(pipeline);
    pass.set_bind_group(0, bindings, &[]);
    pass.draw(0..3, 0..1);
}

/// Pixels per submission of rays: even a slow GPU then takes well under a second, and no watchdog sees a hang.
const PIXELS_PER_SUBMISSION: u32 = 1 << 18;

/// Rows drawn by one submission.
pub(crate) struct Band {
    pub(crate) top: u32,
    pub(crate) rows: u32,
    /// Whether the march begins with these rows.
    pub(crate) is_first: bool,
}

/// Target of a march, and the part of the picture it draws.
pub(crate) struct Gathering<'a> {
    pub(crate) shared: &'a SharedBuffers,
    pub(crate) target: &'a wgpu::TextureView,
    /// The drawn pixels.
    pub(crate) rect: PixelRect,
    /// Whether the first band clears the target.
    pub(crate) clears: bool,
    /// The bind group that limits the march to a slab between meshes; `None` without meshes.
    pub(crate) limits: Option<&'a wgpu::BindGroup>,
    /// Whether this is the picture's first march, where its GPU time begins.
    pub(crate) is_begin: bool,
    /// The march's part of the frames' buffer: the layer's frame, or the first of all layers.
    pub(crate) frame: Part,
    pub(crate) pace: &'a Pace,
    /// Upper bound of a ray's texture reads.
    pub(crate) reads: f64,
}

impl Gathering<'_> {
    /// Casts a ray for each pixel through `layers` layers, some rows of the picture per submission.
    ///
    /// # Errors
    /// If the picture is given up, or the device fails.
    pub(crate) fn cast_rays(
        &self,
        gpu: &Gpu,
        pipeline: &Pipeline,
        bindings: &wgpu::BindGroup,
        layers: u32,
    ) -> Result<(), GpuError> {
        let PixelRect { x0, x1, .. } = self.rect;
        let most = (PIXELS_PER_SUBMISSION / layers / (x1 - x0).max(1)).max(1);
        match pipeline {
            Pipeline::Render(pipeline) => self.by_rows(gpu, most, 1, |band| {
                self.draw(gpu, pipeline, bindings, band.is_first, |pass| {
                    pass.set_scissor_rect(x0, band.top, x1 - x0, band.rows);
                    pass.draw(0..3, 0..1);
                })
            }),
            // Whole workgroups.
            Pipeline::Compute(pipeline) => {
                self.by_rows(gpu, most, WORKGROUP_PX, |band| self.dispatch(gpu, pipeline, bindings, &band))
            }
        }
    }

    /// Submits all rows, in bands of at most `most` and a multiple of `unit`. Unless one submission suffices, begins in
    /// the middle, where rays are long: their pace is safe for all others.
    ///
    /// # Errors
    /// If the picture is given up, or the device fails.
    pub(crate) fn by_rows(
        &self,
        gpu: &Gpu,
        most: u32,
        unit: u32,
        mut submit: impl FnMut(Band) -> wgpu::SubmissionIndex,
    ) -> Result<(), GpuError> {
        let PixelRect { x0, x1, y0: start, y1: end } = self.rect;
        let width = (x1 - x0).max(1);
        let is_whole = u64::from(self.pace.pixels(self.reads)) >= u64::from(width) * u64::from(end - start);
        let middle = if is_whole { start } else { start + (end - start) / 2 / unit * unit };
        let (mut above, mut below) = (middle, middle);
        while above > start || below < end {
            let is_below = below < end;
            let rows = (self.pace.pixels(self.reads) / width).min(most) / unit;
            let rows = (rows.max(1) * unit).min(if is_below { end - below } else { above - start });
            // Rows further down continue a picture already begun.
            let is_first = self.clears && (above, below) == (middle, middle);
            let top = if is_below { below } else { above - rows };
            self.pace.submitted(gpu, submit(Band { top, rows, is_first }), rows * width)?;
            if is_below { below += rows } else { above = top }
        }
        Ok(())
    }

    fn dispatch(
        &self,
        gpu: &Gpu,
        pipeline: &wgpu::ComputePipeline,
        bindings: &wgpu::BindGroup,
        band: &Band,
    ) -> wgpu::SubmissionIndex {
        let at = self.frame.at + std::mem::offset_of!(FrameUniform, first_px) as u64;
        let PixelRect { x0, x1, .. } = self.rect;
        gpu.queue.write_buffer(&self.shared.frame, at, bytemuck::bytes_of(&(x0 | band.top << 16)));
        let entries = [entry(bindings::TEXELS, BindingResource::TextureView(self.target))];
        let texels = gpu.bind_group("texels", &pipeline.get_bind_group_layout(TEXELS_GROUP), &entries);
        gpu.submit(|encoder| {
            let writes = self.shared.timestamp_writes((band.is_first && self.is_begin).then_some(0), None);
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("march"),
                timestamp_writes: writes.map(|w| wgpu::ComputePassTimestampWrites {
                    query_set: w.query_set,
                    beginning_of_pass_write_index: w.beginning_of_pass_write_index,
                    end_of_pass_write_index: w.end_of_pass_write_index,
                }),
            });
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, bindings, &[]);
            if let Some(limits) = self.limits {
                pass.set_bind_group(1, limits, &[]);
            }
            pass.set_bind_group(TEXELS_GROUP, &texels, &[]);
            pass.dispatch_workgroups((x1 - x0).div_ceil(WORKGROUP_PX), band.rows.div_ceil(WORKGROUP_PX), 1);
        })
    }

    /// Submits one pass of a fragment shader into the target. `is_first` clears the target first.
    pub(crate) fn draw(
        &self,
        gpu: &Gpu,
        pipeline: &wgpu::RenderPipeline,
        bindings: &wgpu::BindGroup,
        is_first: bool,
        draw: impl FnOnce(&mut wgpu::RenderPass<'_>),
    ) -> wgpu::SubmissionIndex {
        let load = if is_first { wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT) } else { wgpu::LoadOp::Load };
        gpu.submit(|encoder| {
            let writes = self.shared.timestamp_writes((is_first && self.is_begin).then_some(0), None);
            let mut pass = color_pass(encoder, "march", &[attachment(self.target, load)], writes);
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, bindings, &[]);
            if let Some(limits) = self.limits {
                pass.set_bind_group(1, limits, &[]);
            }
            draw(&mut pass);
        })
    }
}

/// Begins a pass into colours alone.
pub(crate) fn color_pass<'a>(
    encoder: &'a mut wgpu::CommandEncoder,
    label: &str,
    color_attachments: &[Option<wgpu::RenderPassColorAttachment<'_>>],
    timestamp_writes: Option<wgpu::RenderPassTimestampWrites<'_>>,
) -> wgpu::RenderPass<'a> {
    encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
        label: Some(label),
        color_attachments,
        timestamp_writes,
        ..Default::default()
    })
}

pub(crate) fn attachment(
    view: &wgpu::TextureView,
    load: wgpu::LoadOp<wgpu::Color>,
) -> Option<wgpu::RenderPassColorAttachment<'_>> {
    let ops = wgpu::Operations { load, store: wgpu::StoreOp::Store };
    Some(wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops })
}
