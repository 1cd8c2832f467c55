//! Several volumes in one picture on a GPU: a ray per pixel through the octrees of all their draw lists.
//!
//! Every volume has an atlas of its own, for bricks of one volume need not be as large as those of another; all else lies in buffers
//! that volumes share, one after the other. Where each begins is fixed with the budget, and part of the shader, which is made for
//! just these volumes: it holds each volume's code with each volume's numbers, and no loop over volumes.

use crate::adapter::{AdapterReport, Gpu, GpuPreference};
use crate::atlas::{Atlas, AtlasPlan, slot_bytes};
use crate::compositor::Compositor;
use crate::error::GpuError;
use crate::frame::{TableInUse, frame_uniform};
use crate::gathering::{Gathering, SharedBuffers, buffer, draw_over_all, entry, sampler};
use crate::memory::{MIN_SLOTS, RaycastPlan, picture_bytes};
use crate::pipelines::{Layouts, Pipelines, gradient_of, light_of};
use crate::renderer::check_size;
use crate::table::{self, Room};
use crate::targets::Targets;
use crate::tree::{GROUP, Slots, Tree, Visibility, pack_range};
use crate::upload::{MAX_BATCH, Uploader, staging_bytes};
use brickyard_pager::{Layer, Slot, VolumeNeeds, Wish, share};
use brickyard_shaders::{
    ExpressionShader, FIRST_ATLAS, FIRST_GRADIENTS, FrameUniform, Gather, LEAF, Light, NO_RANGES, RayBrick,
    VolumeShader,
};
use brickyard_volume::macrocells::{self, per_axis};
use brickyard_volume::{
    Blend, Combination, Filter, Jitter, MacroCells, Method, Mode, OpaqueCodes, Picture, SlotEncoding, SlotFormat,
    TransferTable, surface,
};
use std::collections::HashMap;
use std::sync::Arc;
use wgpu::{BindingResource, BufferUsages};

/// Atlases of several volumes, and the shaders that draw from them.
#[derive(Debug)]
pub struct GpuEnsemble {
    gpu: Gpu,
    volumes: Vec<Volume>,
    shared: SharedBuffers,
    nodes: wgpu::Buffer,
    bricks: wgpu::Buffer,
    ranges: wgpu::Buffer,
    opaque_before: wgpu::Buffer,
    layouts: Layouts,
    bindings: wgpu::BindGroup,
    /// Made at first use.
    pipelines: HashMap<(Vec<VolumeShader>, Option<ExpressionShader>), Pipelines>,
    /// Where an expression's media begin in the transfer tables, and what is there.
    combined_place: u32,
    combined: Option<TransferTable>,
    targets: Targets,
    recipe: Recipe,
    bytes: u64,
}

/// What it is made from, besides what the volumes need.
#[derive(Clone, Copy, Debug)]
struct Recipe {
    preference: GpuPreference,
    budget_bytes: u64,
    max_size_px: (u32, u32),
}

#[derive(Debug)]
struct Volume {
    needs: VolumeNeeds,
    plan: RaycastPlan,
    atlas: Atlas,
    uploader: Uploader,
    slot_ranges: Vec<[u16; 2]>,
    /// What the table buffer holds, and of it the codes with opacity.
    table: Option<(Arc<TransferTable>, Blend)>,
    opaque: OpaqueCodes,
    first: Firsts,
}

/// Where a volume begins in the shared buffers: a node's word, a brick, a macro-cell, a place of the table, a count.
#[derive(Clone, Copy, Debug, Default)]
struct Firsts {
    node: u32,
    brick: u32,
    range: u32,
    place: u32,
    count: u32,
}

/// The codes of an expression's table.
const COMBINED: SlotFormat = SlotFormat::U16;

/// The bits of the value of code 0, and of the difference to that of the last.
fn value_bits(encoding: &SlotEncoding) -> [u32; 2] {
    [encoding.low, encoding.high - encoding.low].map(|value| (value as f32).to_bits())
}

/// Whether there are gradients beside a volume's bricks.
fn has_gradients(needs: &VolumeNeeds) -> bool {
    needs.bricks.gradient_layers > 0
}

/// How a budget is spent.
struct Plan {
    atlases: Vec<AtlasPlan>,
    raycasts: Vec<RaycastPlan>,
    batch: u64,
    bytes: u64,
}

impl GpuEnsemble {
    /// Shares `gpu_memory_bytes` out among the volumes, for pictures up to `max_size_px` (width, height). Where the device refuses
    /// an allocation, half of that is tried, again and again.
    ///
    /// # Errors
    /// If there is no such adapter, its shaders see too few textures, or the budget or the device do not have the least that the volumes
    /// need.
    pub fn new(
        preference: GpuPreference,
        volumes: &[VolumeNeeds],
        gpu_memory_bytes: u64,
        max_size_px: (u32, u32),
    ) -> Result<Self, GpuError> {
        Self::make(Recipe { preference, budget_bytes: gpu_memory_bytes, max_size_px }, volumes)
    }

    fn make(recipe: Recipe, volumes: &[VolumeNeeds]) -> Result<Self, GpuError> {
        let Recipe { preference, mut budget_bytes, max_size_px } = recipe;
        loop {
            let gpu = Gpu::open(preference, u64::MAX)?;
            let limit = gpu.device.limits().max_sampled_textures_per_shader_stage;
            let needed: usize = volumes.iter().map(|needs| if has_gradients(needs) { 2 } else { 1 }).sum();
            if needed > limit as usize {
                return Err(GpuError::Textures { volumes: volumes.len(), needed, limit });
            }
            check_size(max_size_px, (gpu.report.max_texture_2d, gpu.report.max_texture_2d))?;
            let plan = Plan::new(&gpu, volumes, budget_bytes, max_size_px)?;
            match Self::allocate(gpu, volumes, plan, recipe) {
                Err(error @ (GpuError::OutOfMemory { .. } | GpuError::DeviceLost(_))) => {
                    budget_bytes /= 2;
                    tracing::warn!("{error}: trying with {budget_bytes} bytes");
                }
                other => return other,
            }
        }
    }

    fn allocate(gpu: Gpu, needs: &[VolumeNeeds], plan: Plan, recipe: Recipe) -> Result<Self, GpuError> {
        let (mut end, mut volumes, mut table_bytes) = (Firsts::default(), Vec::new(), 0);
        for ((needs, atlas), raycast) in needs.iter().zip(plan.atlases).zip(plan.raycasts) {
            let (codes, slots) = (needs.encoding.format, atlas.slots());
            let first = end;
            end.node += (raycast.nodes_bytes(slots) / size_of::<u32>() as u64) as u32;
            end.brick += (raycast.bricks_bytes(slots) / size_of::<RayBrick>() as u64) as u32;
            end.range += (raycast.ranges_bytes(slots) / size_of::<u32>() as u64) as u32;
            end.place += table::last_place(codes) + 1;
            end.count += codes.max_code() + 2;
            table_bytes += Room::of_places(codes).bytes();
            let none = TransferTable::from_entries(Vec::new(), 1.0);
            volumes.push(Volume {
                needs: *needs,
                plan: raycast,
                atlas: Atlas::new(&gpu, atlas, gpu.report.formats.atlas(codes), needs.bricks.gradients(needs.edge))?,
                uploader: Uploader::new(codes, plan.batch),
                slot_ranges: vec![macrocells::NONE; slots as usize],
                table: None,
                opaque: OpaqueCodes::new(&none),
                first,
            });
        }
        let shared = SharedBuffers::new(&gpu, volumes.len() as u64, table_bytes + Room::of_places(COMBINED).bytes())?;
        let word = size_of::<u32>() as u64;
        let sizes = [
            ("octrees", end.node as u64 * word),
            ("bricks", end.brick as u64 * size_of::<RayBrick>() as u64),
            ("macro-cells", end.range as u64 * word),
            ("opaque entries", end.count as u64 * word),
        ];
        let usage = BufferUsages::STORAGE | BufferUsages::COPY_DST;
        let make = |device: &wgpu::Device| sizes.map(|(label, bytes)| buffer(device, label, bytes, usage));
        let total = sizes.iter().map(|(_, bytes)| bytes).sum();
        let [nodes, bricks, ranges, opaque_before] = gpu.allocate("the octrees and the macro-cells", total, make)?;
        let layouts = Layouts::together(&gpu, volumes.len(), needs.iter().any(has_gradients));
        let (sampler, views) =
            (sampler(&gpu), volumes.iter().map(|v| v.atlas.texture.create_view(&Default::default())));
        let views: Vec<wgpu::TextureView> = views.collect();
        let mut entries = vec![
            entry(0, shared.frame.as_entire_binding()),
            entry(1, bricks.as_entire_binding()),
            entry(3, BindingResource::Sampler(&sampler)),
            entry(4, shared.table.as_entire_binding()),
            entry(6, nodes.as_entire_binding()),
            entry(7, ranges.as_entire_binding()),
            entry(8, opaque_before.as_entire_binding()),
        ];
        let gradients =
            volumes.iter().filter_map(|volume| Some(volume.atlas.gradients.as_ref()?.create_view(&Default::default())));
        let gradients: Vec<wgpu::TextureView> = gradients.collect();
        let textures = (FIRST_ATLAS..).zip(&views).chain((FIRST_GRADIENTS..).zip(&gradients));
        entries.extend(textures.map(|(at, view)| entry(at, BindingResource::TextureView(view))));
        let descriptor = wgpu::BindGroupDescriptor { label: Some("march"), layout: &layouts.march, entries: &entries };
        let bindings = gpu.device.create_bind_group(&descriptor);
        let targets = Targets::new(&gpu, Gather::Composite, Compositor::Raycast, recipe.max_size_px, 0)?;
        gpu.check()?;
        Ok(Self {
            volumes,
            shared,
            nodes,
            bricks,
            ranges,
            opaque_before,
            layouts,
            bindings,
            pipelines: HashMap::new(),
            combined_place: end.place,
            combined: None,
            targets,
            recipe,
            bytes: plan.bytes,
            gpu,
        })
    }

    /// Starts anew with empty slots, as [`crate::GpuRenderer::renew`].
    ///
    /// # Errors
    /// As [`GpuEnsemble::new`]; the renderer stays lost then.
    pub fn renew(&mut self) -> Result<(), GpuError> {
        // What the old device still holds must not stand beside the new one's.
        self.gpu.destroy();
        let needs: Vec<VolumeNeeds> = self.volumes.iter().map(|volume| volume.needs).collect();
        *self = Self::make(self.recipe, &needs)?;
        Ok(())
    }

    /// Loses the device as a driver does, at a moment of its own choice: for tests.
    #[doc(hidden)]
    pub fn destroy_device(&self) {
        self.gpu.device.destroy();
    }

    /// How many bricks of a volume fit.
    pub fn slots(&self, volume: usize) -> u32 {
        self.volumes[volume].atlas.plan.slots()
    }

    /// Everything this renderer may hold on the GPU at once.
    pub fn gpu_bytes(&self) -> u64 {
        self.bytes
    }

    /// The adapter in use.
    pub fn adapter(&self) -> &AdapterReport {
        &self.gpu.report
    }

    /// Puts a volume's padded brick into one of its slots, as [`crate::GpuRenderer::upload`].
    ///
    /// # Errors
    /// As there.
    pub fn upload(&mut self, volume: usize, slot: Slot, codes: &[u8]) -> Result<(), GpuError> {
        let Volume { needs, plan, atlas, uploader, slot_ranges, first, .. } = &mut self.volumes[volume];
        uploader.check(atlas, slot, codes)?;
        let VolumeNeeds { encoding, edge, bricks, .. } = *needs;
        let cells = MacroCells::new(codes, encoding.format, encoding.has_invalid, edge as usize, bricks);
        let packed: Vec<u32> = cells.ranges().iter().map(|&range| pack_range(range)).collect();
        let at = first.range as u64 * size_of::<u32>() as u64 + plan.ranges_bytes(slot.0);
        self.gpu.queue.write_buffer(&self.ranges, at, bytemuck::cast_slice(&packed));
        slot_ranges[slot.0 as usize] = cells.whole();
        uploader.upload(&self.gpu, atlas, slot, codes)
    }

    /// Draws the layers together, one for each volume; or an expression over them.
    ///
    /// # Errors
    /// If the picture is too large, layers do not fit the volumes or ask for what several volumes do not have (another mode, another
    /// method, an expression that is lit or has surfaces), or the device fails.
    pub fn render(&mut self, layers: &[Layer<'_>], combination: Option<&Combination>) -> Result<Picture, GpuError> {
        self.gpu.check()?;
        if layers.len() != self.volumes.len() {
            let problem = format!("{} layers of {} volumes", layers.len(), self.volumes.len());
            return Err(GpuError::Mismatch(problem));
        }
        for (i, layer) in layers.iter().enumerate() {
            self.volumes[i].check(layer, combination.is_some())?;
            self.write_frame(i, layer);
            self.write_table(i, layer);
            self.write_tree(i, layer)?;
        }
        let expression = combination.map(|combination| self.write_combination(combination));
        let rays = &layers[0].frame.settings.rays;
        let size = (rays.width, rays.height);
        check_size(size, self.recipe.max_size_px)?;
        let Self { gpu, volumes, shared, layouts, bindings, pipelines, targets, .. } = self;
        if (targets.width_px, targets.height_px) != size {
            *targets = Targets::new(gpu, Gather::Composite, Compositor::Raycast, size, 0)?;
        }
        let shaders: Vec<VolumeShader> =
            layers.iter().zip(&*volumes).map(|(layer, volume)| volume.shader(layer)).collect();
        let make = |(shaders, expression): &(Vec<_>, Option<_>)| {
            Pipelines::together(gpu, layouts, shaders, expression.as_ref())
        };
        let pipelines = pipelines.entry((shaders, expression)).or_insert_with_key(make);
        gpu.check()?;
        let gathering = Gathering { shared, target: &targets.gathered, size_px: size, limits: None, is_begin: true };
        gathering.cast_rays(gpu, &pipelines.march, bindings, volumes.len() as u32);
        let bindings = shared.resolve_bindings(gpu, &layouts.resolve, targets);
        let copied = shared.resolve(gpu, targets, |pass| draw_over_all(pass, &pipelines.resolve, &bindings), |_| {});
        Ok(targets.read(gpu, copied, 0)?.picture)
    }

    fn write_frame(&self, volume: usize, layer: &Layer<'_>) {
        let Volume { atlas, needs, .. } = &self.volumes[volume];
        let bricks = (atlas, needs.bricks.apron);
        let uniform = frame_uniform(&layer.frame.settings, layer.pyramid, bricks, TableInUse::default());
        let at = volume * size_of::<FrameUniform>();
        self.gpu.queue.write_buffer(&self.shared.frame, at as u64, bytemuck::bytes_of(&uniform));
    }

    fn write_table(&mut self, volume: usize, layer: &Layer<'_>) {
        let Volume { needs, table, opaque, first, .. } = &mut self.volumes[volume];
        let (wanted, blend) = (&layer.frame.settings.table, layer.frame.blend);
        if table.as_ref().is_some_and(|(table, of)| table == wanted && *of == blend) {
            return;
        }
        let places = table::places(wanted, needs.encoding.format, blend);
        let at = first.place as u64 * size_of::<[u32; 2]>() as u64;
        self.gpu.queue.write_buffer(&self.shared.table, at, bytemuck::cast_slice(&places));
        *opaque = OpaqueCodes::new(wanted);
        let at = first.count as u64 * size_of::<u32>() as u64;
        self.gpu.queue.write_buffer(&self.opaque_before, at, bytemuck::cast_slice(opaque.before()));
        *table = Some((wanted.clone(), blend));
    }

    /// Puts an expression's media into the tables, if they are not there.
    fn write_combination(&mut self, combination: &Combination) -> ExpressionShader {
        let Combination { expression, table: wanted, encoding, .. } = combination;
        if self.combined.as_ref() != Some(wanted) {
            let places = table::places(wanted, COMBINED, Blend::Mix);
            let at = self.combined_place as u64 * size_of::<[u32; 2]>() as u64;
            self.gpu.queue.write_buffer(&self.shared.table, at, bytemuck::cast_slice(&places));
            self.combined = Some(wanted.clone());
        }
        ExpressionShader {
            wgsl: expression.wgsl(self.volumes.len()),
            first_place: self.combined_place,
            last_place: table::last_place(COMBINED),
            values: value_bits(encoding),
        }
    }

    fn write_tree(&self, volume: usize, layer: &Layer<'_>) -> Result<(), GpuError> {
        let Volume { plan, first, atlas, .. } = &self.volumes[volume];
        let Tree { nodes, bricks } = self.volumes[volume].tree(layer);
        let slots = atlas.plan.slots();
        let (nodes, bricks): (&[u8], &[u8]) = (bytemuck::cast_slice(&nodes), bytemuck::cast_slice(&bricks));
        if nodes.len() as u64 > plan.nodes_bytes(slots) || bricks.len() as u64 > plan.bricks_bytes(slots) {
            return Err(GpuError::Mismatch(format!(
                "a draw list of {} cells for {slots} slots",
                layer.draw.cells.len()
            )));
        }
        let at = [first.node as usize * size_of::<u32>(), first.brick as usize * size_of::<RayBrick>()];
        self.gpu.queue.write_buffer(&self.nodes, at[0] as u64, nodes);
        self.gpu.queue.write_buffer(&self.bricks, at[1] as u64, bricks);
        Ok(())
    }
}

impl Volume {
    fn check(&self, layer: &Layer<'_>, is_combined: bool) -> Result<(), GpuError> {
        let settings = &layer.frame.settings;
        let is_plain = settings.mode == Mode::Dvr
            && settings.meshes.is_empty()
            && settings.sampling.method == Method::Udvr
            && settings.sampling.jitter == Jitter::None
            && settings.grid().is_none();
        let fits = settings.encoding == self.needs.encoding
            && layer.pyramid.edge() == self.needs.edge
            && self.needs.bricks.satisfy(&settings.needs())
            && settings.table.entries.len() == self.needs.encoding.format.max_code() as usize + 1;
        let slots = self.atlas.plan.slots();
        let problem = if !is_plain {
            "several volumes are sampled plainly, and classified by value alone"
        } else if is_combined && (layer.frame.is_lit() || !settings.surfaces.is_empty()) {
            "what an expression makes has no gradient"
        } else if !fits {
            "a frame of another volume than the renderer was made for"
        } else if layer.draw.cells.iter().any(|cell| cell.slot.0 >= slots) {
            "a draw list with slots that are not there"
        } else {
            return Ok(());
        };
        Err(GpuError::Mismatch(problem.into()))
    }

    fn shader(&self, layer: &Layer<'_>) -> VolumeShader {
        let (settings, is_lit) = (&layer.frame.settings, layer.frame.is_lit());
        let (lighting, has_surfaces) = (&settings.lighting, !settings.surfaces.is_empty());
        VolumeShader {
            has_invalid: self.needs.encoding.has_invalid,
            is_cubic: layer.frame.settings.sampling.filter == Filter::Tricubic,
            adds: layer.frame.blend == Blend::Add,
            light: if is_lit { light_of(lighting) } else { Light::Unlit },
            gradient: gradient_of(lighting, is_lit || has_surfaces),
            surfaces: has_surfaces.then(|| light_of(&surface::lighting(lighting))),
            first_node: self.first.node,
            first_place: self.first.place,
            first_count: self.first.count,
            values: value_bits(&self.needs.encoding),
        }
    }

    /// The octree over a list, with positions in the shared buffers.
    fn tree(&self, layer: &Layer<'_>) -> Tree {
        let (mode, has_invalid) = (Mode::Dvr, self.needs.encoding.has_invalid);
        let visibility = Visibility { mode, has_invalid, opaque: &self.opaque, leaps: true };
        let macro_cells = per_axis(self.needs.edge as usize).pow(3) as u32;
        let (atlas, apron, ranges) = (&self.atlas.plan, self.needs.bricks.apron, &self.slot_ranges[..]);
        let mut tree = Tree::new(layer.pyramid, layer.draw, &visibility, &Slots { atlas, apron, macro_cells, ranges });
        for word in &mut tree.nodes {
            *word += match *word {
                // Nothing is drawn there.
                LEAF => 0,
                leaf if leaf & LEAF != 0 => self.first.brick,
                _ => self.first.node / GROUP as u32,
            };
        }
        for brick in tree.bricks.iter_mut().filter(|brick| brick.first_range != NO_RANGES) {
            brick.first_range += self.first.range;
        }
        tree
    }
}

impl Plan {
    fn new(gpu: &Gpu, volumes: &[VolumeNeeds], budget_bytes: u64, max_size_px: (u32, u32)) -> Result<Self, GpuError> {
        let formats = &gpu.report.formats;
        let max_binding_bytes = gpu.device.limits().max_storage_buffer_binding_size / volumes.len() as u64;
        let raycast = |needs: &VolumeNeeds| RaycastPlan::new(needs.edge, needs.levels, needs.encoding.format, true);
        let raycasts: Vec<RaycastPlan> = volumes.iter().map(raycast).collect();
        let slot_edge = |needs: &VolumeNeeds| needs.edge + 2 * needs.bricks.apron;
        let format = |needs: &VolumeNeeds| formats.atlas(needs.encoding.format);
        let gradients = |needs: &VolumeNeeds| needs.bricks.gradients(needs.edge);
        let slot_bytes = |needs: &VolumeNeeds| slot_bytes(slot_edge(needs), format(needs), gradients(needs));
        let (mut small, mut staging) =
            (picture_bytes(formats, max_size_px) + Room::of_places(COMBINED).bytes_staged(), 0);
        for (needs, plan) in volumes.iter().zip(&raycasts) {
            let codes = needs.encoding.format;
            small += Room::of_places(codes).bytes_staged() + plan.fixed_bytes() + size_of::<FrameUniform>() as u64;
            staging += staging_bytes(slot_edge(needs), format(needs), gradients(needs)) + plan.ranges_bytes(1);
        }
        // As for one volume: two batches are under way at once, together at most an eighth of the budget.
        let batch = (budget_bytes / 16 / staging).clamp(1, MAX_BATCH);
        let fixed_bytes = small + 2 * batch * staging;
        let wish = |(needs, plan): (&VolumeNeeds, &RaycastPlan)| {
            let most = (needs.most_slots as u64).min(plan.max_slots(max_binding_bytes));
            let least = (needs.least_slots.max(MIN_SLOTS) as u64).min(needs.most_slots as u64);
            Wish { bytes: slot_bytes(needs) + plan.bytes_per_slot(), least, most }
        };
        let wishes: Vec<Wish> = volumes.iter().zip(&raycasts).map(wish).collect();
        let too_little = |least_bytes: u64| GpuError::Budget {
            given_bytes: budget_bytes,
            least_bytes,
            width_px: max_size_px.0,
            height_px: max_size_px.1,
            slot_edge: volumes.iter().map(slot_edge).max().unwrap_or(0),
        };
        let shares = share(budget_bytes.saturating_sub(fixed_bytes), &wishes);
        let shares = shares.map_err(|least| too_little(small + 2 * staging + least))?;
        let (mut atlases, mut bytes) = (Vec::new(), fixed_bytes);
        for ((needs, wish), slots) in volumes.iter().zip(&wishes).zip(shares) {
            let (each, max_edge) = (slot_bytes(needs), gpu.report.max_texture_3d);
            let most = slots.min(u32::MAX as u64) as u32;
            let atlas = AtlasPlan::new(slot_edge(needs), each, slots * each, max_edge, most);
            let atlas = atlas.filter(|atlas| atlas.slots() as u64 >= wish.least);
            let atlas =
                atlas.ok_or_else(|| too_little(fixed_bytes + wishes.iter().map(|w| w.least * w.bytes).sum::<u64>()))?;
            bytes += atlas.slots() as u64 * wish.bytes;
            atlases.push(atlas);
        }
        Ok(Self { atlases, raycasts, batch, bytes })
    }
}
