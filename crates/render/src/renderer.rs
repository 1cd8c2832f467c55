//! The `sorted` compositor: the draw list as instanced boxes, back to front, and the picture read back.
//!
//! A frame writes one uniform block, 64 bytes per cell and, when it changed, the transfer table; draws the cells in chunks,
//! one submission each; resolves to display colours; waits, and copies the picture out. Slots, targets and buffers all live
//! inside the budget given at the start. Everything happens on the thread that calls.

use crate::adapter::{AdapterReport, Gpu, GpuPreference};
use crate::atlas::Atlas;
use crate::error::GpuError;
use crate::frame::{cell_instance, frame_uniform};
use crate::memory::{CELLS_PER_SUBMISSION, MemoryNeeds, MemoryPlan, TIMESTAMP_BYTES};
use crate::pipelines::{Layouts, Pipelines, gather_of};
use crate::targets::Targets;
use crate::upload::Uploader;
use brickyard_pager::{DrawCell, DrawList, Slot};
use brickyard_shaders::{CellInstance, FrameUniform, Gather};
use brickyard_volume::{FrameSettings, Picture, Pyramid, SlotEncoding, TransferTable};
use std::time::Instant;
use wgpu::{BindingResource, BufferUsages};

/// How the GPU backend is set up.
#[derive(Clone, Copy, Debug)]
pub struct GpuOptions {
    /// Which adapters may be used.
    pub preference: GpuPreference,
    /// No more slots than this, whatever the budget: the number of bricks there are. A slot costs its bytes from the start.
    pub max_slots: u32,
}

impl Default for GpuOptions {
    fn default() -> Self {
        Self { preference: GpuPreference::Any, max_slots: u32::MAX }
    }
}

/// The GPU backend: an atlas of slots and the compositor that draws from them.
#[derive(Debug)]
pub struct GpuRenderer {
    gpu: Gpu,
    encoding: SlotEncoding,
    edge: u32,
    apron: u32,
    max_size_px: (u32, u32),
    memory: MemoryPlan,
    atlas: Atlas,
    uploader: Uploader,
    buffers: Buffers,
    layouts: Layouts,
    sorted_bindings: wgpu::BindGroup,
    /// By [`Gather`], made at first use.
    pipelines: [Option<Pipelines>; 3],
    targets: Option<Targets>,
    /// What the table buffer holds.
    table: Option<TransferTable>,
    last_frame_ms: f64,
}

#[derive(Debug)]
struct Buffers {
    frame: wgpu::Buffer,
    cells: wgpu::Buffer,
    table: wgpu::Buffer,
    /// Query set and the buffer it resolves to, where the adapter has timestamps.
    timestamps: Option<(wgpu::QuerySet, wgpu::Buffer)>,
}

impl Buffers {
    fn new(gpu: &Gpu, table_bytes: u64) -> Result<Self, GpuError> {
        let cells_bytes = (CELLS_PER_SUBMISSION * size_of::<CellInstance>()) as u64;
        gpu.allocate("tables and cells", table_bytes + cells_bytes, |device| {
            let buffer = |label, size, usage| {
                let descriptor = wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false };
                device.create_buffer(&descriptor)
            };
            let frame_bytes = size_of::<FrameUniform>() as u64;
            let timestamps = gpu.report.timestamps.then(|| {
                let descriptor = wgpu::QuerySetDescriptor { label: None, ty: wgpu::QueryType::Timestamp, count: 2 };
                let usage = BufferUsages::QUERY_RESOLVE | BufferUsages::COPY_SRC;
                (device.create_query_set(&descriptor), buffer("timestamps", TIMESTAMP_BYTES, usage))
            });
            Self {
                frame: buffer("frame", frame_bytes, BufferUsages::UNIFORM | BufferUsages::COPY_DST),
                cells: buffer("cells", cells_bytes, BufferUsages::STORAGE | BufferUsages::COPY_DST),
                table: buffer("transfer table", table_bytes, BufferUsages::STORAGE | BufferUsages::COPY_DST),
                timestamps,
            }
        })
    }
}

impl GpuRenderer {
    /// A renderer for bricks of `edge`^3 voxels with `apron` voxels around them and pictures up to `max_size_px` (width,
    /// height), that allocates at most `gpu_memory_bytes`.
    ///
    /// # Errors
    /// If there is no such adapter, the budget cannot hold a picture and two bricks, or the driver has less than the budget.
    pub fn new(
        options: &GpuOptions,
        encoding: SlotEncoding,
        edge: u32,
        apron: u32,
        gpu_memory_bytes: u64,
        max_size_px: (u32, u32),
    ) -> Result<Self, GpuError> {
        let gpu = Gpu::open(options.preference)?;
        let limit = gpu.report.max_texture_2d;
        check_size(max_size_px, (limit, limit))?;
        let memory = MemoryPlan::new(&MemoryNeeds {
            formats: gpu.report.formats,
            codes: encoding.format,
            slot_edge: edge + 2 * apron,
            budget_bytes: gpu_memory_bytes,
            max_size_px,
            max_texture_3d: gpu.report.max_texture_3d,
            max_slots: options.max_slots,
        })?;
        let atlas = Atlas::new(&gpu, memory.atlas, gpu.report.formats.atlas(encoding.format))?;
        let buffers = Buffers::new(&gpu, (encoding.format.max_code() as u64 + 1) * 16)?;
        let layouts = Layouts::new(&gpu);
        let sorted_bindings = sorted_bindings(&gpu, &layouts, &buffers, &atlas);
        gpu.check()?;
        Ok(Self {
            encoding,
            edge,
            apron,
            max_size_px,
            memory,
            atlas,
            uploader: Uploader::new(encoding.format, memory.batch),
            buffers,
            layouts,
            sorted_bindings,
            pipelines: [None, None, None],
            targets: None,
            table: None,
            last_frame_ms: 0.0,
            gpu,
        })
    }

    /// How many bricks fit.
    pub fn slots(&self) -> u32 {
        self.atlas.plan.slots()
    }

    /// Everything this renderer may hold on the GPU at once: atlas, targets, tables, staging, read-back.
    pub fn gpu_bytes(&self) -> u64 {
        self.memory.bytes()
    }

    /// Bytes of slot codes uploaded so far.
    pub fn uploaded_bytes(&self) -> u64 {
        self.uploader.bytes
    }

    /// Milliseconds of the last frame: on the GPU where it has timestamps, else from call to picture.
    pub fn last_frame_ms(&self) -> f64 {
        self.last_frame_ms
    }

    /// The adapter in use.
    pub fn adapter(&self) -> &AdapterReport {
        &self.gpu.report
    }

    /// Puts a padded brick's codes (little-endian, x fastest) into a slot. Returns before they are there; later frames see
    /// them.
    ///
    /// # Errors
    /// If the codes are not a padded brick, there is no such slot, or the device fails.
    pub fn upload(&mut self, slot: Slot, codes: &[u8]) -> Result<(), GpuError> {
        self.uploader.upload(&self.gpu, &self.atlas, slot, codes)
    }

    /// Draws the list and returns the picture.
    ///
    /// # Errors
    /// If the picture is too large, the list or settings do not fit this renderer, or the device fails.
    pub fn render(&mut self, frame: &FrameSettings, pyramid: &Pyramid, draw: &DrawList) -> Result<Picture, GpuError> {
        let start = Instant::now();
        self.gpu.check()?;
        self.check(frame, pyramid, draw)?;
        let gather = gather_of(frame.mode);
        self.prepare(gather, frame)?;
        let uniform = frame_uniform(frame, pyramid, &self.atlas.plan);
        self.gpu.queue.write_buffer(&self.buffers.frame, 0, bytemuck::bytes_of(&uniform));
        let (Some(targets), Some(pipelines)) = (&self.targets, &self.pipelines[gather as usize]) else {
            return Err(GpuError::Refused("no target".to_string()));
        };

        let chunks = draw.cells.len().div_ceil(CELLS_PER_SUBMISSION).max(1);
        for chunk in 0..chunks {
            let cells = draw.cells.chunks(CELLS_PER_SUBMISSION).nth(chunk).unwrap_or(&[]);
            self.draw_cells(targets, pipelines, pyramid, cells, chunk == 0);
        }
        let copied = self.resolve(targets, pipelines);
        let (picture, ticks) = targets.read(&self.gpu, copied)?;
        self.last_frame_ms = match self.buffers.timestamps {
            Some(_) => ticks[1].wrapping_sub(ticks[0]) as f64 * self.gpu.queue.get_timestamp_period() as f64 * 1e-6,
            None => start.elapsed().as_secs_f64() * 1e3,
        };
        Ok(picture)
    }

    fn check(&self, frame: &FrameSettings, pyramid: &Pyramid, draw: &DrawList) -> Result<(), GpuError> {
        check_size((frame.rays.width, frame.rays.height), self.max_size_px)?;
        if frame.encoding != self.encoding || pyramid.edge() != self.edge {
            return Err(GpuError::Mismatch(format!(
                "frame of {:?} in bricks of {}: this renderer was made for {:?} in bricks of {}",
                frame.encoding,
                pyramid.edge(),
                self.encoding,
                self.edge
            )));
        }
        let entries = self.encoding.format.max_code() as usize + 1;
        if frame.table.entries.len() != entries {
            let found = frame.table.entries.len();
            return Err(GpuError::Mismatch(format!("transfer table of {found} entries: expected {entries}")));
        }
        match draw.cells.iter().find(|c| c.slot.0 >= self.slots()) {
            Some(c) => {
                Err(GpuError::Mismatch(format!("{} is drawn from slot {} of {}", c.brick, c.slot.0, self.slots())))
            }
            None => Ok(()),
        }
    }

    /// Pipelines, targets and table for this frame.
    fn prepare(&mut self, gather: Gather, frame: &FrameSettings) -> Result<(), GpuError> {
        let (gpu, layouts) = (&self.gpu, &self.layouts);
        self.pipelines[gather as usize]
            .get_or_insert_with(|| Pipelines::new(gpu, layouts, gather, self.encoding.has_invalid));
        let (width, height) = (frame.rays.width, frame.rays.height);
        if !matches!(&self.targets, Some(t) if (t.gather, t.width_px, t.height_px) == (gather, width, height)) {
            // The old ones go first: both together would pass the budget.
            self.targets = None;
            self.targets = Some(Targets::new(gpu, gather, width, height)?);
        }
        if self.table.as_ref() != Some(&frame.table) {
            self.gpu.queue.write_buffer(&self.buffers.table, 0, bytemuck::cast_slice(&frame.table.entries));
            self.table = Some(frame.table.clone());
        }
        self.gpu.check()
    }

    /// One submission of the march; the first clears the target.
    fn draw_cells(
        &self,
        targets: &Targets,
        pipelines: &Pipelines,
        pyramid: &Pyramid,
        cells: &[DrawCell],
        is_first: bool,
    ) {
        let plan = &self.atlas.plan;
        let instances: Vec<_> = cells.iter().map(|c| cell_instance(c, pyramid, plan, self.apron)).collect();
        self.gpu.queue.write_buffer(&self.buffers.cells, 0, bytemuck::cast_slice(&instances));
        let load = if is_first { wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT) } else { wgpu::LoadOp::Load };
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("march"),
                color_attachments: &[attachment(&targets.gathered, load)],
                timestamp_writes: self.timestamp_writes(is_first.then_some(0), None),
                ..Default::default()
            });
            pass.set_pipeline(&pipelines.sorted);
            pass.set_bind_group(0, &self.sorted_bindings, &[]);
            pass.draw(0..14, 0..instances.len() as u32);
        }
        self.gpu.queue.submit([encoder.finish()]);
    }

    /// The last submission: display colours, read-back copy, timestamps.
    fn resolve(&self, targets: &Targets, pipelines: &Pipelines) -> wgpu::SubmissionIndex {
        let bindings = self.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("resolve"),
            layout: &self.layouts.resolve,
            entries: &[
                entry(0, self.buffers.frame.as_entire_binding()),
                entry(4, self.buffers.table.as_entire_binding()),
                entry(5, BindingResource::TextureView(&targets.gathered)),
            ],
        });
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("resolve"),
                color_attachments: &[attachment(&targets.display_view, wgpu::LoadOp::Clear(wgpu::Color::BLACK))],
                timestamp_writes: self.timestamp_writes(None, Some(1)),
                ..Default::default()
            });
            pass.set_pipeline(&pipelines.resolve);
            pass.set_bind_group(0, &bindings, &[]);
            pass.draw(0..3, 0..1);
        }
        targets.copy_back(&mut encoder);
        if let Some((queries, ticks)) = &self.buffers.timestamps {
            encoder.resolve_query_set(queries, 0..2, ticks, 0);
            encoder.copy_buffer_to_buffer(ticks, 0, &targets.read_back, targets.timestamps_offset(), TIMESTAMP_BYTES);
        }
        self.gpu.queue.submit([encoder.finish()])
    }

    fn timestamp_writes(&self, begin: Option<u32>, end: Option<u32>) -> Option<wgpu::RenderPassTimestampWrites<'_>> {
        let (query_set, _) = self.buffers.timestamps.as_ref().filter(|_| begin.or(end).is_some())?;
        Some(wgpu::RenderPassTimestampWrites {
            query_set,
            beginning_of_pass_write_index: begin,
            end_of_pass_write_index: end,
        })
    }
}

fn check_size(size: (u32, u32), limit: (u32, u32)) -> Result<(), GpuError> {
    if size.0 > limit.0 || size.1 > limit.1 {
        return Err(GpuError::PictureTooLarge {
            width_px: size.0,
            height_px: size.1,
            limit_width_px: limit.0,
            limit_height_px: limit.1,
        });
    }
    Ok(())
}

fn attachment(
    view: &wgpu::TextureView,
    load: wgpu::LoadOp<wgpu::Color>,
) -> Option<wgpu::RenderPassColorAttachment<'_>> {
    let ops = wgpu::Operations { load, store: wgpu::StoreOp::Store };
    Some(wgpu::RenderPassColorAttachment { view, depth_slice: None, resolve_target: None, ops })
}

fn entry(binding: u32, resource: BindingResource<'_>) -> wgpu::BindGroupEntry<'_> {
    wgpu::BindGroupEntry { binding, resource }
}

fn sorted_bindings(gpu: &Gpu, layouts: &Layouts, buffers: &Buffers, atlas: &Atlas) -> wgpu::BindGroup {
    let sampler = gpu.device.create_sampler(&wgpu::SamplerDescriptor {
        label: Some("atlas"),
        mag_filter: wgpu::FilterMode::Linear,
        min_filter: wgpu::FilterMode::Linear,
        ..Default::default()
    });
    let view = atlas.texture.create_view(&Default::default());
    gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
        label: Some("sorted"),
        layout: &layouts.sorted,
        entries: &[
            entry(0, buffers.frame.as_entire_binding()),
            entry(1, buffers.cells.as_entire_binding()),
            entry(2, BindingResource::TextureView(&view)),
            entry(3, BindingResource::Sampler(&sampler)),
            entry(4, buffers.table.as_entire_binding()),
        ],
    })
}
