//! The GPU renderer: pools of slots, layers drawn from them, a compositor gathering their samples, and picture
//! read-back.
//!
//! A frame (see `frame_pass`) writes each layer's settings, its cells in the compositor's form and, when changed, its
//! transfer table; gathers; resolves to display colours; waits, and copies the picture out. Slots, targets and buffers
//! all stay within the budget given at the start. Everything runs on the calling thread, except for compiling pipelines
//! ahead.

use crate::adapter::{AdapterReport, GpuPreference};
use crate::answers::{Answer, Answers};
use crate::blit::{Blit, LastPicture};
use crate::buffer_parts::{Ends, Part};
use crate::buffers::{RayBuffers, SharedBuffers};
use crate::compositor_parts::{Common, CompositorParts};
use crate::layer::GpuLayer;
use crate::memory::{MemoryNeeds, MemoryPlan, PoolPlan};
use crate::meshes::{Meshes, Peeled};
use crate::pace::Pace;
use crate::pipeline_cache::Pipelines;
use crate::pool::Pool;
use crate::targets::{Reading, Targets};
use crate::{Compositor, Gpu, GpuError};
use brickyard_pager::{Slot, VolumeNeeds, pools};
use brickyard_shaders::Gather;
use brickyard_volume::{MAX_VOLUMES, PixelRect, TransferTable};
use std::time::Instant;

/// Set-up of the GPU backend.
#[derive(Clone, Copy, Debug)]
pub struct GpuOptions {
    /// Which adapters may be used.
    pub preference: GpuPreference,
    /// The compositor, which gathers the samples of frames.
    pub compositor: Compositor,
    /// Whether the renderer can also draw by the other one of `sorted` and `raycast`, from the same
    /// slots: see [`GpuRenderer::set_compositor`].
    pub switches: bool,
    /// Whether rays skip empty space. Without skipping, pictures are the same but take longer.
    pub skips_empty: bool,
    /// Whether to allow expressions over the layers: their table takes a mebibyte.
    pub expressions: bool,
    /// Allocations above this many bytes are refused as if by the device: for tests.
    #[doc(hidden)]
    pub refuse_above_bytes: u64,
}

impl Default for GpuOptions {
    fn default() -> Self {
        let (preference, compositor) = Default::default();
        Self {
            preference,
            compositor,
            switches: false,
            skips_empty: true,
            expressions: true,
            refuse_above_bytes: u64::MAX,
        }
    }
}

/// A GPU renderer: atlases with the bricks of layers, and a compositor drawing from them.
#[derive(Debug)]
pub struct GpuRenderer {
    pub(crate) gpu: Gpu,
    pub(crate) recipe: Recipe,
    memory: MemoryPlan,
    asked_bytes: u64,
    pub(crate) layers: Vec<GpuLayer>,
    pub(crate) pools: Vec<Pool>,
    pub(crate) shared: SharedBuffers,
    /// The compositor in use, and the other one if the renderer switches.
    pub(crate) parts: CompositorParts,
    pub(crate) other_parts: Option<CompositorParts>,
    pub(crate) targets: Option<Targets>,
    /// Whether the targets came from another renderer, with its last shown picture.
    keeps_picture: bool,
    pub(crate) pace: Pace,
    /// The drawn part of pictures that are waited for; `None` for all of it.
    pub(crate) window: Option<PixelRect>,
    /// The meshes' buffers and pipelines; `None` without meshes.
    pub(crate) meshes: Option<Meshes>,
    /// The additional targets of pictures with meshes; `None` without.
    pub(crate) peeled: Option<Peeled>,
    pub(crate) blit: Blit,
    pub(crate) answers: Answers,
    /// Answers about shown pictures, received while waiting for another picture.
    pub(crate) heard: Vec<Answer>,
    /// The requested picture on its way to the CPU.
    pub(crate) reading: Option<Reading>,
    /// The expression's part of the tables' buffer; `None` without room for expressions.
    pub(crate) combined_part: Option<Part>,
    /// The expression's transfer table on the GPU, if any yet.
    pub(crate) combined: Option<TransferTable>,
    /// For each layer the greatest transmittance with which rays entered the last frame's cells; `None` if unknown.
    pub(crate) visibility: Option<Vec<Vec<f32>>>,
    pub(crate) last_frame_ms: f64,
}

/// A device with its compiled pipelines, for reuse by the next renderer.
#[derive(Debug)]
pub struct Compiled {
    gpu: Gpu,
    /// The pipelines compiled for each compositor.
    pipelines: Vec<Pipelines>,
    picture: Option<LastPicture>,
}

impl Compiled {
    /// The device's adapter.
    pub fn adapter(&self) -> &AdapterReport {
        &self.gpu.report
    }
}

impl From<Gpu> for Compiled {
    fn from(gpu: Gpu) -> Self {
        Self { gpu, pipelines: Vec::new(), picture: None }
    }
}

/// A renderer's parameters, used again after the loss of its device.
#[derive(Clone, Debug)]
pub(crate) struct Recipe {
    options: GpuOptions,
    layers: Vec<VolumeNeeds>,
    budget_bytes: u64,
    pub(crate) max_size_px: (u32, u32),
}

impl Recipe {
    fn new(
        options: &GpuOptions,
        layers: &[VolumeNeeds],
        budget_bytes: u64,
        max_size_px: (u32, u32),
    ) -> Result<Self, GpuError> {
        let is_alike = |needs: &VolumeNeeds| needs.bricks.meshes == layers[0].bricks.meshes;
        if layers.is_empty() || layers.len() > MAX_VOLUMES || !layers.iter().all(is_alike) {
            let problem = format!("{} layers: expected 1 to {MAX_VOLUMES}, of one scene", layers.len());
            return Err(GpuError::Mismatch(problem));
        }
        if options.switches && options.compositor == Compositor::Compute {
            return Err(GpuError::Mismatch("`compute` has no other compositor to switch to".into()));
        }
        Ok(Self { options: *options, layers: layers.to_vec(), budget_bytes, max_size_px })
    }

    /// Plans the budget on this device. `most_slots` limits each pool's slots; empty sets no limit.
    fn plan(&self, gpu: &Gpu, most_slots: &[u32]) -> Result<MemoryPlan, GpuError> {
        let limit = gpu.report.max_texture_2d;
        check_size(self.max_size_px, (limit, limit))?;
        self.check_textures(gpu)?;
        if !self.layers.iter().all(|layer| gpu.report.formats.tells_apart(&layer.encoding)) {
            return Err(GpuError::Labels);
        }
        MemoryPlan::new(&MemoryNeeds {
            formats: gpu.report.formats,
            layers: &self.layers,
            most_slots,
            budget_bytes: self.budget_bytes,
            max_size_px: self.max_size_px,
            max_texture_3d: gpu.report.max_texture_3d,
            max_binding_bytes: gpu.device.limits().max_storage_buffer_binding_size,
            casts_rays: self.has(|compositor| compositor != Compositor::Sorted).then_some(self.options.skips_empty),
            draws_boxes: self.has(|compositor| compositor == Compositor::Sorted),
            has_expressions: self.options.expressions,
            has_two_eyes: gpu.is_lent,
            // Without waiting, more is in flight.
            batches: if gpu.is_lent { 4 } else { 2 },
        })
    }

    /// Checks that a shader sees enough textures: atlases and gradients of all pools, and those that limit slabs.
    fn check_textures(&self, gpu: &Gpu) -> Result<(), GpuError> {
        let limit = gpu.device.limits().max_sampled_textures_per_shader_stage;
        let each = if self.has_gradients() { 2 } else { 1 };
        let pools = pools(&self.layers).iter().max().map_or(0, |last| last + 1);
        let needed = each * pools + if self.layers[0].bricks.meshes.is_none() { 0 } else { 3 };
        if needed > limit as usize {
            return Err(GpuError::Textures { volumes: self.layers.len(), needed, limit });
        }
        Ok(())
    }

    /// Whether one of the renderer's compositors is of a kind.
    fn has(&self, is_of_kind: impl Fn(Compositor) -> bool) -> bool {
        let GpuOptions { compositor, switches, .. } = self.options;
        is_of_kind(compositor) || switches && compositor.other().is_some_and(is_of_kind)
    }

    fn has_gradients(&self) -> bool {
        self.layers.iter().any(|layer| layer.bricks.gradient_layers > 0)
    }
}

impl GpuRenderer {
    /// Creates a renderer for `layers` and pictures of up to `max_size_px` (width, height) within `gpu_memory_bytes`.
    /// Slots get the memory left over by targets and tables. Layers whose bricks fit each other's slots share a
    /// [pool](brickyard_pager::pools) of slots; several pools share the memory.
    ///
    /// If the device has less memory and refuses an allocation, the number of slots is halved until all fits, down to
    /// the least that works: see [`GpuRenderer::asked_bytes`].
    ///
    /// # Errors
    /// If there is no such adapter, its shaders see too few textures, there are no layers, too many or layers for
    /// different meshes, a picture of that size is too large, the budget cannot hold a picture and the fewest bricks,
    /// or the device refuses even those.
    pub fn new(
        options: &GpuOptions,
        layers: &[VolumeNeeds],
        gpu_memory_bytes: u64,
        max_size_px: (u32, u32),
    ) -> Result<Self, GpuError> {
        Self::make(Recipe::new(options, layers, gpu_memory_bytes, max_size_px)?, None)
    }

    /// Creates a renderer on a device, like [`GpuRenderer::new`], reusing the pipelines compiled for the device.
    ///
    /// # Errors
    /// As [`GpuRenderer::new`].
    pub fn on(
        compiled: impl Into<Compiled>,
        options: &GpuOptions,
        layers: &[VolumeNeeds],
        gpu_memory_bytes: u64,
        max_size_px: (u32, u32),
    ) -> Result<Self, GpuError> {
        let (recipe, compiled) = (Recipe::new(options, layers, gpu_memory_bytes, max_size_px)?, compiled.into());
        compiled.gpu.clone().scoped(|| Self::make(recipe, Some(compiled)))
    }

    fn make(recipe: Recipe, mut compiled: Option<Compiled>) -> Result<Self, GpuError> {
        let lent = compiled.as_ref().map(|compiled| compiled.gpu.clone()).filter(|gpu| gpu.is_lent);
        let mut asked_bytes = None;
        let mut most = Vec::new();
        loop {
            let open = || Gpu::open(recipe.options.preference, recipe.options.refuse_above_bytes);
            let compiled = match compiled.take() {
                Some(compiled) => compiled,
                None => lent.clone().map_or_else(open, Ok)?.into(),
            };
            let memory = recipe.plan(&compiled.gpu, &most)?;
            let asked_bytes = *asked_bytes.get_or_insert(memory.bytes());
            let slots: Vec<u32> = memory.pools.iter().map(|plan| plan.atlas.slots()).collect();
            let halved = |plan: &PoolPlan| (plan.atlas.slots() / 2).max(plan.least as u32);
            let fewer: Vec<u32> = memory.pools.iter().map(halved).collect();
            match Self::allocate(compiled, recipe.clone(), memory, asked_bytes) {
                // A lost application's device is the application's to recreate.
                Err(error @ GpuError::DeviceLost(_)) if lent.is_some() => return Err(error),
                // Some drivers lose the device over impossible requests.
                Err(error @ (GpuError::OutOfMemory { .. } | GpuError::DeviceLost(_))) if fewer != slots => {
                    most = fewer;
                    tracing::warn!("{error}: trying with {most:?} bricks instead of {slots:?}");
                }
                other => return other,
            }
        }
    }

    fn allocate(
        Compiled { gpu, mut pipelines, picture }: Compiled,
        recipe: Recipe,
        memory: MemoryPlan,
        asked_bytes: u64,
    ) -> Result<Self, GpuError> {
        let mut ends = Ends::default();
        let made = recipe.layers.iter().zip(&memory.pool_of);
        let layers: Vec<GpuLayer> =
            made.map(|(&needs, &pool)| GpuLayer::new(needs, pool, ends.layer(&needs))).collect();
        let (of_meshes, compositor) = (ends.frame(), recipe.options.compositor);
        let combined_part = recipe.options.expressions.then(|| ends.combined());
        let mut pools: Vec<Pool> = Vec::new();
        for layer in &layers {
            if let Some(&plan) = memory.pools.get(pools.len()).filter(|_| layer.pool == pools.len()) {
                pools.push(Pool::new(&gpu, layer.needs, plan, memory.batch, memory.batches, ends.ranges(&plan))?);
            }
        }
        let shared = SharedBuffers::new(&gpu, ends.frames, ends.table, recipe.has_gradients())?;
        // The largest ones ever needed: a frame is too late to find out that they do not fit.
        let [_, _, marks_bytes] = memory.list_bytes();
        let has_sums = layers.len() > 1;
        let last = picture.filter(|last| last.targets.fit(recipe.max_size_px));
        let keeps_picture = last.is_some();
        let LastPicture { targets, blit, reading } = match last {
            Some(last) => last,
            None => LastPicture {
                targets: Targets::new(&gpu, Gather::Composite, has_sums, compositor, recipe.max_size_px)?,
                blit: Blit::new(&gpu),
                reading: None,
            },
        };
        let answers = Answers::new(&gpu, marks_bytes)?;
        let room = recipe.layers[0].bricks.meshes;
        let meshes = (!room.is_none()).then(|| Meshes::new(&gpu, &shared, of_meshes, room)).transpose()?;
        let peeled =
            meshes.as_ref().map(|meshes| Peeled::new(&gpu, meshes, &shared, recipe.max_size_px)).transpose()?;
        gpu.check()?;
        let mut parts_of = |compositor| {
            let common = Common {
                shared: &shared,
                layers: &layers,
                pools: &pools,
                ends: &ends,
                memory: &memory,
                has_gradients: recipe.has_gradients(),
                meshes: meshes.as_ref().map(|meshes| meshes.layouts.clone()),
            };
            CompositorParts::new(&gpu, compositor, common, &mut pipelines)
        };
        let parts = parts_of(compositor)?;
        let other = compositor.other().filter(|_| recipe.options.switches);
        let other_parts = other.map(parts_of).transpose()?;
        Ok(Self {
            recipe,
            memory,
            asked_bytes,
            layers,
            pools,
            shared,
            parts,
            other_parts,
            targets: Some(targets),
            keeps_picture,
            pace: Pace::new(),
            window: None,
            meshes,
            peeled,
            blit,
            answers,
            heard: Vec::new(),
            reading,
            combined_part,
            combined: None,
            visibility: None,
            last_frame_ms: 0.0,
            gpu,
        })
    }

    /// Recreates the renderer after the loss of its device, starting with the choice of adapter. All slots are then
    /// empty, possibly fewer.
    ///
    /// # Errors
    /// As [`GpuRenderer::new`], and if the device is an application's. The renderer stays lost then.
    pub fn renew(&mut self) -> Result<(), GpuError> {
        if self.gpu.is_lent {
            return Err(self.gpu.lost(&"the application must create it anew"));
        }
        // The old device's memory must be freed before the new one's is allocated.
        self.gpu.destroy();
        *self = Self::make(self.recipe.clone(), None)?;
        Ok(())
    }

    /// Frees the renderer's memory on the device, waits for it, and returns it with its compiled pipelines for another
    /// renderer. With `keeps_picture`, the other renderer shows the last picture until it draws one of its own, unless
    /// it is made for smaller pictures.
    ///
    /// # Errors
    /// If the device is lost.
    pub fn into_compiled(self, keeps_picture: bool) -> Result<Compiled, GpuError> {
        // All other parts are dropped here.
        let kept = |Self { gpu, parts, other_parts, targets, blit, reading, .. }: Self| {
            // The next renderer may have no room for sums.
            let targets = targets.filter(|_| keeps_picture).map(Targets::without_sums);
            let pipelines = std::iter::once(parts).chain(other_parts).map(|parts| parts.pipelines).collect();
            (gpu, pipelines, targets.map(|targets| LastPicture { targets, blit, reading }))
        };
        let (gpu, pipelines, picture) = kept(self);
        gpu.wait_for_all()?;
        Ok(Compiled { gpu, pipelines, picture })
    }

    /// Sets a deadline: from now on, pictures unfinished at this time are given up with [`GpuError::TooLong`]; `None`
    /// gives none up. Submissions are then only as large as the device draws in a moment.
    pub fn draw_until(&mut self, until: Option<Instant>) {
        if self.pace.until != until {
            self.pace.restart(until);
        }
    }

    /// Draws from now on only these pixels of rendered pictures; others may have any colour. `None` draws all.
    pub fn draw_within(&mut self, window: Option<PixelRect>) {
        self.window = window;
    }

    /// Whether the renderer shows the last picture of its predecessor on the device until it draws one of its own.
    pub fn keeps_picture(&self) -> bool {
        self.keeps_picture
    }

    /// Destroys the device, as a driver may at any moment: for tests.
    #[doc(hidden)]
    pub fn destroy_device(&self) {
        self.gpu.device.destroy();
    }

    /// Whether the renderer's device is an application's. [Shown](GpuRenderer::show) pictures then never wait for it.
    pub fn never_waits(&self) -> bool {
        self.gpu.is_lent
    }

    /// The device to draw on.
    pub fn gpu(&self) -> &Gpu {
        &self.gpu
    }

    /// Number of slots in a layer's pool, and so of bricks that fit.
    ///
    /// # Panics
    /// If there is no such layer.
    pub fn slots(&self, layer: usize) -> u32 {
        self.pools[self.layers[layer].pool].slots()
    }

    /// Most bytes of this renderer on the GPU at once: atlases, targets, tables, staging, read-back.
    pub fn gpu_bytes(&self) -> u64 {
        self.memory.bytes()
    }

    /// The value of [`GpuRenderer::gpu_bytes`], had the device refused nothing.
    pub fn asked_bytes(&self) -> u64 {
        self.asked_bytes
    }

    /// Bytes of codes and gradients uploaded into slots so far.
    pub fn uploaded_bytes(&self) -> u64 {
        self.pools.iter().map(|pool| pool.uploader.bytes).sum()
    }

    /// Duration of the last rendered frame, milliseconds: on the GPU if the device has timestamps, else from call to
    /// picture.
    pub fn last_frame_ms(&self) -> f64 {
        self.last_frame_ms
    }

    /// The compositor, which gathers the samples of frames.
    pub fn compositor(&self) -> Compositor {
        self.parts.compositor
    }

    /// Whether the renderer can draw by `sorted` and by `raycast`.
    pub fn switches(&self) -> bool {
        self.other_parts.is_some()
    }

    /// Draws later frames by this compositor. Returns whether the renderer has it.
    pub fn set_compositor(&mut self, compositor: Compositor) -> bool {
        let Self { parts, other_parts, .. } = self;
        if let Some(other) = other_parts.as_mut().filter(|other| other.compositor == compositor) {
            std::mem::swap(parts, other);
        }
        parts.compositor == compositor
    }

    /// The adapter in use.
    pub fn adapter(&self) -> &AdapterReport {
        &self.gpu.report
    }

    /// Puts a padded brick into a slot of a layer's pool: its codes (little-endian, x fastest), then its gradients. Any
    /// layer of the pool may be drawn from the slot. Returns before the brick is on the GPU; later frames see it.
    ///
    /// # Errors
    /// If the codes are not a padded brick of the layer, there is no such slot, or the device fails.
    ///
    /// # Panics
    /// If there is no such layer.
    pub fn upload(&mut self, layer: usize, slot: Slot, codes: &[u8]) -> Result<(), GpuError> {
        let Self { gpu, layers, pools, parts, other_parts, .. } = self;
        gpu.scoped(|| pools[layers[layer].pool].upload(gpu, rays_of(parts, other_parts), slot, codes))
    }

    /// Submits pending uploads, so that drawing submitted from now on never reads a slot's former contents.
    ///
    /// # Errors
    /// If the device fails.
    pub fn submit_uploads(&mut self) -> Result<(), GpuError> {
        let Self { gpu, pools, .. } = self;
        gpu.scoped(|| pools.iter_mut().try_for_each(|pool| pool.uploader.submit(gpu)))
    }

    /// Returns the bytes of codes that fit into a layer's pool without waiting for the device, as of its last
    /// [poll](GpuRenderer::answers).
    ///
    /// # Panics
    /// If there is no such layer.
    pub fn upload_room_bytes(&mut self, layer: usize) -> u64 {
        let pool = &mut self.pools[self.layers[layer].pool];
        pool.uploader.room_bytes(&pool.atlas)
    }

    /// For each entry of a layer's draw list in the last rendered frame, in order, the greatest transmittance with
    /// which a ray entered the cell, rounded up to a multiple of 1/255. It is 0 if no ray did, because rays ended
    /// before or have no sample there. `None` for projections, where nothing hides anything, for `sorted`, and if the
    /// device's shaders cannot report it.
    pub fn visibility(&self, layer: usize) -> Option<&[f32]> {
        Some(self.visibility.as_ref()?.get(layer)?)
    }
}

/// The buffers for rays; `None` if neither compositor casts any.
pub(crate) fn rays_of<'a>(
    parts: &'a CompositorParts,
    other_parts: &'a Option<CompositorParts>,
) -> Option<&'a RayBuffers> {
    parts.rays().or_else(|| other_parts.as_ref()?.rays())
}

pub(crate) fn check_size(
    (width_px, height_px): (u32, u32),
    (limit_width_px, limit_height_px): (u32, u32),
) -> Result<(), GpuError> {
    if width_px > limit_width_px || height_px > limit_height_px {
        return Err(GpuError::PictureTooLarge { width_px, height_px, limit_width_px, limit_height_px });
    }
    Ok(())
}
