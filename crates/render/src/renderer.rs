//! The GPU renderer: slots on the GPU, a compositor that gathers their samples, and the picture read back.
//!
//! A frame writes one uniform block, what the compositor needs to know of its cells and, when it changed, the transfer table;
//! gathers; resolves to display colours; waits, and copies the picture out. Slots, targets and buffers all live inside the
//! budget given at the start. Everything happens on the thread that calls.

use crate::adapter::{AdapterReport, Gpu, GpuPreference};
use crate::atlas::Atlas;
use crate::error::GpuError;
use crate::frame::frame_uniform;
use crate::gathering::{Gathering, SharedBuffers, attachment, entry};
use crate::memory::{MemoryNeeds, MemoryPlan, RaycastPlan, TIMESTAMP_BYTES};
use crate::pipelines::{Layouts, Pipelines, gather_of};
use crate::raycast::Raycast;
use crate::sorted::Sorted;
use crate::targets::Targets;
use crate::upload::Uploader;
use brickyard_pager::{DrawList, Slot};
use brickyard_shaders::Gather;
use brickyard_volume::{FrameSettings, Picture, Pyramid, SlotEncoding, TransferTable};
use std::time::Instant;
use wgpu::BindingResource;

/// How the samples of a frame are gathered. Both take the same samples and make the same picture.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Compositor {
    /// Cells as boxes, back to front, blended.
    Sorted,
    /// A ray per pixel, front to back, with early termination and leaps over what shows nothing.
    #[default]
    Raycast,
}

impl Compositor {
    /// `sorted` or `raycast`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Sorted => "sorted",
            Self::Raycast => "raycast",
        }
    }
}

/// How the GPU backend is set up.
#[derive(Clone, Copy, Debug)]
pub struct GpuOptions {
    /// Which adapters may be used.
    pub preference: GpuPreference,
    /// How frames are gathered.
    pub compositor: Compositor,
    /// Levels of the pyramid, at most: how deep an octree is made room for.
    pub levels: u32,
    /// No more slots than this, whatever the budget: the number of bricks there are. A slot costs its bytes from the start.
    pub max_slots: u32,
}

impl Default for GpuOptions {
    fn default() -> Self {
        Self { preference: GpuPreference::Any, compositor: Compositor::default(), levels: 16, max_slots: u32::MAX }
    }
}

/// The GPU backend: an atlas of slots and a compositor that draws from them.
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
    shared: SharedBuffers,
    layouts: Layouts,
    march: March,
    /// By [`Gather`], made at first use.
    pipelines: [Option<Pipelines>; 3],
    targets: Option<Targets>,
    /// What the table buffer holds.
    table: Option<TransferTable>,
    last_frame_ms: f64,
}

/// A compositor and what it keeps.
#[derive(Debug)]
enum March {
    Sorted(Sorted),
    Raycast(Raycast),
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
        let raycast = match options.compositor {
            Compositor::Sorted => None,
            Compositor::Raycast => Some(RaycastPlan::new(edge, options.levels, encoding.format)),
        };
        let memory = MemoryPlan::new(&MemoryNeeds {
            formats: gpu.report.formats,
            codes: encoding.format,
            slot_edge: edge + 2 * apron,
            budget_bytes: gpu_memory_bytes,
            max_size_px,
            max_texture_3d: gpu.report.max_texture_3d,
            max_slots: options.max_slots,
            max_binding_bytes: gpu.device.limits().max_storage_buffer_binding_size,
            raycast,
        })?;
        let atlas = Atlas::new(&gpu, memory.atlas, gpu.report.formats.atlas(encoding.format))?;
        let shared = SharedBuffers::new(&gpu, (encoding.format.max_code() as u64 + 1) * 16)?;
        let layouts = Layouts::new(&gpu, options.compositor);
        let march = match raycast {
            None => March::Sorted(Sorted::new(&gpu, &layouts.march, &shared, &atlas)?),
            Some(plan) => March::Raycast(Raycast::new(&gpu, &layouts.march, &shared, &atlas, plan)?),
        };
        gpu.check()?;
        Ok(Self {
            encoding,
            edge,
            apron,
            max_size_px,
            memory,
            atlas,
            uploader: Uploader::new(encoding.format, memory.batch),
            shared,
            layouts,
            march,
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

    /// How it gathers.
    pub fn compositor(&self) -> Compositor {
        match self.march {
            March::Sorted(_) => Compositor::Sorted,
            March::Raycast(_) => Compositor::Raycast,
        }
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
        self.uploader.check(&self.atlas, slot, codes)?;
        if let March::Raycast(raycast) = &mut self.march {
            raycast.upload(&self.gpu, slot, codes, &self.encoding, self.apron);
        }
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
        self.gpu.queue.write_buffer(&self.shared.frame, 0, bytemuck::bytes_of(&uniform));
        let (Some(targets), Some(pipelines)) = (&self.targets, &self.pipelines[gather as usize]) else {
            return Err(GpuError::Refused("no target".to_string()));
        };
        let gathering = Gathering {
            shared: &self.shared,
            target: &targets.gathered,
            pipeline: &pipelines.march,
            size_px: (targets.width_px, targets.height_px),
        };
        let bricks = (&self.atlas.plan, self.apron);
        match &self.march {
            March::Sorted(sorted) => sorted.draw(&self.gpu, &gathering, pyramid, draw, bricks),
            March::Raycast(raycast) => raycast.draw(&self.gpu, &gathering, frame, pyramid, draw, bricks)?,
        }
        let copied = self.resolve(targets, pipelines);
        let (picture, ticks) = targets.read(&self.gpu, copied)?;
        self.last_frame_ms = match self.shared.timestamps {
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
        let (gpu, layouts, compositor) = (&self.gpu, &self.layouts, self.compositor());
        self.pipelines[gather as usize]
            .get_or_insert_with(|| Pipelines::new(gpu, layouts, compositor, gather, self.encoding.has_invalid));
        let (width, height) = (frame.rays.width, frame.rays.height);
        if !matches!(&self.targets, Some(t) if (t.gather, t.width_px, t.height_px) == (gather, width, height)) {
            // The old ones go first: both together would pass the budget.
            self.targets = None;
            self.targets = Some(Targets::new(gpu, gather, width, height)?);
        }
        if self.table.as_ref() != Some(&frame.table) {
            self.gpu.queue.write_buffer(&self.shared.table, 0, bytemuck::cast_slice(&frame.table.entries));
            if let March::Raycast(raycast) = &mut self.march {
                raycast.set_table(&self.gpu, &frame.table);
            }
            self.table = Some(frame.table.clone());
        }
        self.gpu.check()
    }

    /// The last submission: display colours, read-back copy, timestamps.
    fn resolve(&self, targets: &Targets, pipelines: &Pipelines) -> wgpu::SubmissionIndex {
        let bindings = self.gpu.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("resolve"),
            layout: &self.layouts.resolve,
            entries: &[
                entry(0, self.shared.frame.as_entire_binding()),
                entry(4, self.shared.table.as_entire_binding()),
                entry(5, BindingResource::TextureView(&targets.gathered)),
            ],
        });
        let mut encoder = self.gpu.device.create_command_encoder(&Default::default());
        {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("resolve"),
                color_attachments: &[attachment(&targets.display_view, wgpu::LoadOp::Clear(wgpu::Color::BLACK))],
                timestamp_writes: self.shared.timestamp_writes(None, Some(1)),
                ..Default::default()
            });
            pass.set_pipeline(&pipelines.resolve);
            pass.set_bind_group(0, &bindings, &[]);
            pass.draw(0..3, 0..1);
        }
        targets.copy_back(&mut encoder);
        if let Some((queries, ticks)) = &self.shared.timestamps {
            encoder.resolve_query_set(queries, 0..2, ticks, 0);
            encoder.copy_buffer_to_buffer(ticks, 0, &targets.read_back, targets.timestamps_offset(), TIMESTAMP_BYTES);
        }
        self.gpu.queue.submit([encoder.finish()])
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
