//! The GPU renderer: slots on the GPU, a compositor that gathers their samples, and the picture read back.
//!
//! A frame (see `passes`) writes one block of settings, what the compositor needs to know of its cells and, when it changed, the
//! transfer table; gathers; resolves to display colours; waits, and copies the picture out. Slots, targets and buffers all live inside the
//! budget given at the start. Everything happens on the thread that calls.

use crate::adapter::{AdapterReport, Gpu, GpuPreference};
use crate::atlas::Atlas;
use crate::compositor::Compositor;
use crate::error::GpuError;
use crate::gathering::SharedBuffers;
use crate::memory::{MIN_SLOTS, MemoryNeeds, MemoryPlan, RaycastPlan};
use crate::meshes::{Layers, Meshes};
use crate::pipelines::{Layouts, Pipelines};
use crate::raycast::Raycast;
use crate::sorted::Sorted;
use crate::table::{self, Room};
use crate::targets::Targets;
use crate::upload::Uploader;
use brickyard_pager::Slot;
use brickyard_shaders::{Gather, Variant};
use brickyard_volume::{FrameSettings, Needs, Pyramid, SlotEncoding, TransferTable};
use std::collections::HashMap;
use std::sync::Arc;

/// How the GPU backend is set up.
#[derive(Clone, Copy, Debug)]
pub struct GpuOptions {
    /// Which adapters may be used.
    pub preference: GpuPreference,
    /// How frames are gathered.
    pub compositor: Compositor,
    /// Whether rays of `raycast` leap over what shows nothing; without, pictures are the same and take longer.
    pub leaps: bool,
    /// Levels of the pyramid, at most: how deep an octree is made room for.
    pub levels: u32,
    /// No more slots than this, whatever the budget: the number of bricks there are. A slot costs its bytes from the start.
    pub max_slots: u32,
    /// Allocations above this are refused as if by the device: for tests.
    #[doc(hidden)]
    pub refuse_above_bytes: u64,
}

impl Default for GpuOptions {
    fn default() -> Self {
        let (preference, compositor) = Default::default();
        Self { preference, compositor, leaps: true, levels: 16, max_slots: u32::MAX, refuse_above_bytes: u64::MAX }
    }
}

/// The GPU backend: an atlas of slots and a compositor that draws from them.
#[derive(Debug)]
pub struct GpuRenderer {
    pub(crate) gpu: Gpu,
    pub(crate) recipe: Recipe,
    memory: MemoryPlan,
    asked_bytes: u64,
    pub(crate) atlas: Atlas,
    uploader: Uploader,
    pub(crate) shared: SharedBuffers,
    pub(crate) layouts: Layouts,
    pub(crate) march: March,
    /// Made at first use.
    pub(crate) pipelines: HashMap<Variant, Pipelines>,
    pub(crate) targets: Option<Targets>,
    /// Where pictures may have some, and what those are drawn into besides.
    pub(crate) meshes: Option<Meshes>,
    pub(crate) layers: Option<Layers>,
    /// Room for marks in the targets.
    marks_bytes: u64,
    /// What the table buffer holds.
    table: Option<Arc<TransferTable>>,
    /// See [`table::Words`].
    pub(crate) sum_unit: f32,
    /// How the last frame's cells were entered.
    pub(crate) entered: Option<Vec<f32>>,
    pub(crate) last_frame_ms: f64,
}

/// What a renderer is made from, again after every loss of the device.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Recipe {
    options: GpuOptions,
    encoding: SlotEncoding,
    edge: u32,
    pub(crate) needs: Needs,
    budget_bytes: u64,
    max_size_px: (u32, u32),
}

impl Recipe {
    fn raycast(&self) -> Option<RaycastPlan> {
        let levels = self.options.levels;
        (self.options.compositor != Compositor::Sorted)
            .then(|| RaycastPlan::new(self.edge, levels, self.encoding.format, self.options.leaps))
    }

    pub(crate) fn tables(&self) -> Room {
        Room::new(self.encoding.format, &self.needs)
    }

    /// How the budget is spent on this device.
    fn plan(&self, gpu: &Gpu, max_slots: u32) -> Result<MemoryPlan, GpuError> {
        let limit = gpu.report.max_texture_2d;
        check_size(self.max_size_px, (limit, limit))?;
        MemoryPlan::new(&MemoryNeeds {
            formats: gpu.report.formats,
            tables: self.tables(),
            slot_edge: self.edge + 2 * self.needs.apron,
            gradients: self.needs.gradients(self.edge),
            budget_bytes: self.budget_bytes,
            max_size_px: self.max_size_px,
            max_texture_3d: gpu.report.max_texture_3d,
            max_slots,
            max_binding_bytes: gpu.device.limits().max_storage_buffer_binding_size,
            raycast: self.raycast(),
            meshes: self.needs.meshes,
        })
    }
}

/// A compositor and what it keeps.
#[derive(Debug)]
pub(crate) enum March {
    Sorted(Sorted),
    Raycast(Raycast),
}

impl GpuRenderer {
    /// A renderer for bricks of `edge`^3 voxels and what pictures need around them, and pictures up to `max_size_px` (width,
    /// height), that allocates at most `gpu_memory_bytes`.
    ///
    /// The device may have less than the budget. Where it refuses an allocation there are half as many slots, again and
    /// again, down to the least that works: see [`GpuRenderer::asked_bytes`].
    ///
    /// # Errors
    /// If there is no such adapter, the budget cannot hold a picture and two bricks, or the device refuses even those.
    pub fn new(
        options: &GpuOptions,
        encoding: SlotEncoding,
        edge: u32,
        needs: Needs,
        gpu_memory_bytes: u64,
        max_size_px: (u32, u32),
    ) -> Result<Self, GpuError> {
        let budget_bytes = gpu_memory_bytes;
        Self::make(Recipe { options: *options, encoding, edge, needs, budget_bytes, max_size_px })
    }

    fn make(recipe: Recipe) -> Result<Self, GpuError> {
        let (mut asked_bytes, mut max_slots) = (None, recipe.options.max_slots);
        loop {
            let gpu = Gpu::open(recipe.options.preference, recipe.options.refuse_above_bytes)?;
            let memory = recipe.plan(&gpu, max_slots)?;
            let asked_bytes = *asked_bytes.get_or_insert(memory.bytes());
            let slots = memory.atlas.slots();
            match Self::allocate(gpu, recipe, memory, asked_bytes) {
                // Some drivers lose the device over what they cannot give.
                Err(error @ (GpuError::OutOfMemory { .. } | GpuError::DeviceLost(_))) if slots > MIN_SLOTS => {
                    max_slots = (slots / 2).max(MIN_SLOTS);
                    tracing::warn!("{error}: trying with {max_slots} bricks instead of {slots}");
                }
                other => return other,
            }
        }
    }

    fn allocate(gpu: Gpu, recipe: Recipe, memory: MemoryPlan, asked_bytes: u64) -> Result<Self, GpuError> {
        let codes = recipe.encoding.format;
        let gradients = recipe.needs.gradients(recipe.edge);
        let atlas = Atlas::new(&gpu, memory.atlas, gpu.report.formats.atlas(codes), gradients)?;
        let shared = SharedBuffers::new(&gpu, 1, recipe.tables().bytes())?;
        let layouts = Layouts::new(&gpu, recipe.options.compositor, gradients.layers > 0);
        let march = match recipe.raycast() {
            None => March::Sorted(Sorted::new(&gpu, &layouts.march, &shared, &atlas)?),
            Some(plan) => March::Raycast(Raycast::new(&gpu, &layouts.march, &shared, &atlas, plan)?),
        };
        // The largest there will be: a frame is no time to find out that there is no room for them.
        let marks_bytes = recipe.raycast().map_or(0, |plan| plan.marks_bytes(atlas.plan.slots()));
        let compositor = recipe.options.compositor;
        let targets = Some(Targets::new(&gpu, Gather::Composite, compositor, recipe.max_size_px, marks_bytes)?);
        let room = recipe.needs.meshes;
        let meshes = (!room.is_none()).then(|| Meshes::new(&gpu, &shared, room)).transpose()?;
        let layers =
            meshes.as_ref().map(|meshes| Layers::new(&gpu, meshes, &shared, recipe.max_size_px)).transpose()?;
        gpu.check()?;
        Ok(Self {
            recipe,
            memory,
            asked_bytes,
            atlas,
            uploader: Uploader::new(codes, memory.batch),
            shared,
            layouts,
            march,
            pipelines: Default::default(),
            targets,
            meshes,
            layers,
            marks_bytes,
            table: None,
            sum_unit: 0.0,
            entered: None,
            last_frame_ms: 0.0,
            gpu,
        })
    }

    /// Starts anew, from the choice of the adapter on, with empty slots: what is left to do when the device is lost. There may
    /// be fewer slots than before.
    ///
    /// # Errors
    /// As [`GpuRenderer::new`]; the renderer stays lost then.
    pub fn renew(&mut self) -> Result<(), GpuError> {
        // What the old device still holds must not stand beside the new one's.
        self.gpu.destroy();
        *self = Self::make(self.recipe)?;
        Ok(())
    }

    /// Loses the device as a driver does, at a moment of its own choice: for tests.
    #[doc(hidden)]
    pub fn destroy_device(&self) {
        self.gpu.device.destroy();
    }

    /// How many bricks fit.
    pub fn slots(&self) -> u32 {
        self.atlas.plan.slots()
    }

    /// Everything this renderer may hold on the GPU at once: atlas, targets, tables, staging, read-back.
    pub fn gpu_bytes(&self) -> u64 {
        self.memory.bytes()
    }

    /// What [`GpuRenderer::gpu_bytes`] would be, had the device not refused some of it.
    pub fn asked_bytes(&self) -> u64 {
        self.asked_bytes
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
        self.recipe.options.compositor
    }

    /// The adapter in use.
    pub fn adapter(&self) -> &AdapterReport {
        &self.gpu.report
    }

    /// Puts a padded brick's codes (little-endian, x fastest), and its gradients behind them, into a slot. Returns before they are
    /// there; later frames see them.
    ///
    /// # Errors
    /// If the codes are not a padded brick, there is no such slot, or the device fails.
    pub fn upload(&mut self, slot: Slot, codes: &[u8]) -> Result<(), GpuError> {
        self.uploader.check(&self.atlas, slot, codes)?;
        if let March::Raycast(raycast) = &mut self.march {
            raycast.upload(&self.gpu, slot, codes, &self.recipe.encoding, self.recipe.needs);
        }
        self.uploader.upload(&self.gpu, &self.atlas, slot, codes)
    }

    /// For each entry of the last list drawn, in its order, the greatest transmittance with which a ray entered it, rounded up
    /// to a multiple of 1/255; 0 if none did, because rays ended before or none has a sample there. `None` of projections,
    /// in which nothing hides anything, of `sorted`, and of devices whose shaders cannot say.
    pub fn visibility(&self) -> Option<&[f32]> {
        self.entered.as_deref()
    }

    pub(crate) fn check(&self, frame: &FrameSettings, pyramid: &Pyramid) -> Result<(), GpuError> {
        check_size((frame.rays.width, frame.rays.height), self.recipe.max_size_px)?;
        if frame.encoding != self.recipe.encoding || pyramid.edge() != self.recipe.edge {
            return Err(GpuError::Mismatch(format!(
                "frame of {:?} in bricks of {}: this renderer was made for {:?} in bricks of {}",
                frame.encoding,
                pyramid.edge(),
                self.recipe.encoding,
                self.recipe.edge
            )));
        }
        if !frame.placement.is_identity() {
            return Err(GpuError::Mismatch("one volume is drawn in its own world".into()));
        }
        let (asked, given) = (frame.needs(), self.recipe.needs);
        if !given.satisfy(&asked) {
            return Err(GpuError::Mismatch(format!("a frame of {asked:?}: this renderer's bricks have {given:?}")));
        }
        let entries = self.recipe.encoding.format.max_code() as usize + 1;
        if frame.table.entries.len() != entries {
            let found = frame.table.entries.len();
            return Err(GpuError::Mismatch(format!("transfer table of {found} entries: expected {entries}")));
        }
        Ok(())
    }

    /// Pipelines, targets and table for this frame.
    pub(crate) fn prepare(&mut self, variant: &Variant, frame: &FrameSettings) -> Result<(), GpuError> {
        let (gpu, layouts, compositor, gather) = (&self.gpu, &self.layouts, self.compositor(), variant.gather);
        let size_px = (frame.rays.width, frame.rays.height);
        if let Some(meshes) = self.meshes.as_mut().filter(|_| variant.has_meshes) {
            meshes.set(gpu, frame)?;
            if !self.layers.as_ref().is_some_and(|layers| layers.suit(size_px)) {
                // As with the targets.
                self.layers = None;
                self.layers = Some(Layers::new(gpu, meshes, &self.shared, size_px)?);
            }
        }
        let of_meshes = self.meshes.as_ref().filter(|_| variant.has_meshes).map(Meshes::layouts);
        let make = || Pipelines::new(gpu, layouts, of_meshes.as_ref(), compositor, variant);
        self.pipelines.entry(*variant).or_insert_with(make);
        let (width, height) = (frame.rays.width, frame.rays.height);
        if !matches!(&self.targets, Some(t) if (t.gather, t.width_px, t.height_px) == (gather, width, height)) {
            // The old ones go first: both together would pass the budget.
            self.targets = None;
            self.targets = Some(Targets::new(gpu, gather, compositor, (width, height), self.marks_bytes)?);
        }
        let is_there = |table: &Arc<TransferTable>| Arc::ptr_eq(table, &frame.table) || *table == frame.table;
        if !self.table.as_ref().is_some_and(is_there) {
            let words = table::words(&frame.table, self.recipe.tables());
            self.gpu.queue.write_buffer(&self.shared.table, 0, bytemuck::cast_slice(&words.words));
            self.sum_unit = words.sum_unit;
            if let March::Raycast(raycast) = &mut self.march {
                raycast.set_table(&self.gpu, &frame.table);
            }
            self.table = Some(frame.table.clone());
        }
        self.gpu.check()
    }
}

pub(crate) fn check_size(size: (u32, u32), limit: (u32, u32)) -> Result<(), GpuError> {
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
