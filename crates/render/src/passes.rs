//! One picture in the making: lists of cells gathered one after the other into the same target, then display colours of it, and
//! the way back to the CPU. Where there are meshes, all of that but the way back once for each slab.

use crate::error::GpuError;
use crate::frame::{TableInUse, frame_uniform};
use crate::gathering::{Gathering, draw_over_all};
use crate::meshes::Layers;
use crate::pipelines::{MarchPipeline, Pipelines, variant_of};
use crate::raycast::Raycast;
use crate::renderer::{GpuRenderer, March};
use crate::targets::{Found, Targets};
use brickyard_pager::{DrawList, Slot};
use brickyard_shaders::{MARK_STEPS, Variant};
use brickyard_volume::{FrameSettings, Picture, Pyramid};
use std::time::Instant;

/// A picture that has been begun: see [`GpuRenderer::passes`].
#[derive(Debug)]
pub struct Passes<'a> {
    pub(crate) renderer: &'a mut GpuRenderer,
    pub(crate) frame: &'a FrameSettings,
    pub(crate) variant: Variant,
    pub(crate) pyramid: &'a Pyramid,
    pub(crate) start: Instant,
    /// Lists drawn so far, and the cells of the last.
    pub(crate) lists: u32,
    pub(crate) cells: usize,
    /// Slabs that are in the picture, and what follows the one being drawn.
    pub(crate) slabs: u32,
    pub(crate) next: Next,
}

/// What follows when all lists have been drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Next {
    /// The picture: there are no meshes.
    Picture,
    /// Perhaps another slab.
    Slab,
    /// The end of the last slab.
    End,
    /// The picture of all slabs.
    All,
}

impl GpuRenderer {
    /// Draws the list and returns the picture.
    ///
    /// # Errors
    /// If the picture is too large, the list or settings do not fit this renderer, or the device fails.
    pub fn render(&mut self, frame: &FrameSettings, pyramid: &Pyramid, draw: &DrawList) -> Result<Picture, GpuError> {
        let mut passes = self.passes(frame, pyramid)?;
        loop {
            passes.draw(draw)?;
            if !passes.next_slab()? {
                return passes.finish();
            }
        }
    }

    /// Begins a picture of several lists, each farther to the front than the last. Between them slots may be filled anew, so
    /// that there is no limit to what a picture shows. Where there are meshes, all lists are drawn once for each
    /// [slab](Passes::next_slab).
    ///
    /// # Errors
    /// If the picture is too large, the settings do not fit this renderer, or the device fails.
    pub fn passes<'a>(&'a mut self, frame: &'a FrameSettings, pyramid: &'a Pyramid) -> Result<Passes<'a>, GpuError> {
        let start = Instant::now();
        self.gpu.check()?;
        self.check(frame, pyramid)?;
        let variant = variant_of(frame);
        self.prepare(&variant, frame)?;
        let room = self.recipe.tables();
        let table = TableInUse { sum_unit: self.sum_unit, mask_at: room.mask_at(), grid_at: room.grid_at() };
        let mut uniform = frame_uniform(frame, pyramid, (&self.atlas, self.recipe.needs.apron), table);
        if let Some(meshes) = self.meshes.as_ref().filter(|_| variant.has_meshes) {
            uniform.mesh_far = meshes.far(frame) as f32;
        }
        self.gpu.queue.write_buffer(&self.shared.frame, 0, bytemuck::bytes_of(&uniform));
        self.entered = None;
        let next = self.first_layer(&variant, frame)?;
        Ok(Passes { renderer: self, frame, variant, pyramid, start, lists: 0, cells: 0, slabs: 0, next })
    }

    /// The first layer of the frame's meshes, and what comes after it.
    fn first_layer(&mut self, variant: &Variant, frame: &FrameSettings) -> Result<Next, GpuError> {
        match (&self.meshes, &mut self.layers) {
            (Some(meshes), Some(layers)) if variant.has_meshes => {
                layers.clear(&self.gpu);
                let may_follow = meshes.peel(&self.gpu, frame, layers)?;
                Ok(if may_follow { Next::Slab } else { Next::End })
            }
            _ => Ok(Next::Picture),
        }
    }
}

impl Passes<'_> {
    /// Fills a slot, as [`GpuRenderer::upload`]. Lists drawn before still show what was there.
    ///
    /// # Errors
    /// As there.
    pub fn upload(&mut self, slot: Slot, codes: &[u8]) -> Result<(), GpuError> {
        self.renderer.upload(slot, codes)
    }

    /// Draws a list before those drawn so far.
    ///
    /// # Errors
    /// If it does not fit the renderer, the device fails, or the compositor takes only one list: `raycast` follows rays from
    /// front to back.
    pub fn draw(&mut self, draw: &DrawList) -> Result<(), GpuError> {
        let renderer = &*self.renderer;
        if let Some(c) = draw.cells.iter().find(|c| c.slot.0 >= renderer.slots()) {
            let problem = format!("{} is drawn from slot {} of {}", c.brick, c.slot.0, renderer.slots());
            return Err(GpuError::Mismatch(problem));
        }
        let (targets, pipelines) = self.target()?;
        let gathering = Gathering {
            shared: &renderer.shared,
            target: &targets.gathered,
            size_px: (targets.width_px, targets.height_px),
            limits: renderer.layers.as_ref().filter(|_| self.variant.has_meshes).map(Layers::limits),
            is_begin: self.slabs == 0,
        };
        let is_first = self.lists == 0;
        let (gpu, bricks) = (&renderer.gpu, (&renderer.atlas.plan, renderer.recipe.needs.apron));
        match (&renderer.march, &pipelines.march) {
            (March::Sorted(sorted), MarchPipeline::Fragment(pipeline)) => {
                sorted.draw(gpu, (&gathering, pipeline), self.pyramid, draw, bricks, is_first);
            }
            (March::Raycast(raycast), pipeline) if is_first => {
                raycast.draw(gpu, (&gathering, pipeline), self.frame, self.pyramid, draw, bricks)?;
            }
            _ => return Err(GpuError::Mismatch("rays are cast through a single list".into())),
        }
        self.lists += 1;
        self.cells = draw.cells.len();
        Ok(())
    }

    /// Takes what has been drawn for the volume between two layers of meshes, the first between the eye and the first layer. Whether
    /// there is more behind: then all lists have to be drawn again. Without meshes there never is.
    ///
    /// # Errors
    /// If the device fails.
    pub fn next_slab(&mut self) -> Result<bool, GpuError> {
        if matches!(self.next, Next::Picture | Next::All) {
            return Ok(false);
        }
        if self.lists == 0 {
            self.draw(&DrawList::default())?;
        }
        let (targets, pipelines) = self.target()?;
        let GpuRenderer { gpu, layers: Some(layers), .. } = &*self.renderer else { return Err(no_target()) };
        layers.compose(gpu, &pipelines.resolve, &self.resolve_bindings(targets));
        if self.next == Next::End {
            self.next = Next::All;
            return Ok(false);
        }
        let GpuRenderer { gpu, meshes: Some(meshes), layers: Some(layers), .. } = &mut *self.renderer else {
            return Err(no_target());
        };
        layers.turn();
        // Where no ray has met anything more, the volume behind the layers found is still to come.
        self.next = if meshes.peel(gpu, self.frame, layers)? { Next::Slab } else { Next::End };
        (self.lists, self.slabs) = (0, self.slabs + 1);
        Ok(true)
    }

    /// The picture; that of no list is the background, and the meshes.
    ///
    /// # Errors
    /// If the device fails, or there are slabs that have not been drawn.
    pub fn finish(mut self) -> Result<Picture, GpuError> {
        if self.next_slab()? {
            return Err(GpuError::Mismatch("the picture has slabs that were not drawn".into()));
        }
        if self.next == Next::Picture && self.lists == 0 {
            self.draw(&DrawList::default())?;
        }
        let marked = self.marked();
        let (targets, pipelines) = self.target()?;
        let GpuRenderer { gpu, shared, meshes, layers, .. } = &*self.renderer;
        let bindings = self.resolve_bindings(targets);
        let show = |pass: &mut wgpu::RenderPass<'_>| match (meshes, layers) {
            (Some(meshes), Some(layers)) if self.variant.has_meshes => meshes.show(pass, layers),
            _ => draw_over_all(pass, &pipelines.resolve, &bindings),
        };
        let copied = shared.resolve(gpu, targets, show, |encoder| {
            if let Some(raycast) = marked {
                raycast.take_marks(encoder, self.cells, targets);
            }
        });
        let count = marked.map_or(0, |_| self.cells);
        let Found { picture, ticks, marks } = targets.read(&self.renderer.gpu, copied, count)?;
        // Bricks are numbered from front to back, cells from back to front.
        let transmittance = |&steps: &u32| steps as f32 / MARK_STEPS as f32;
        let entered = marked.map(|_| marks.iter().rev().map(transmittance).collect());
        let renderer = self.renderer;
        renderer.entered = entered;
        renderer.last_frame_ms = match renderer.shared.timestamps {
            Some(_) => {
                let period_ns = renderer.gpu.queue.get_timestamp_period() as f64;
                ticks[1].wrapping_sub(ticks[0]) as f64 * period_ns * 1e-6
            }
            None => self.start.elapsed().as_secs_f64() * 1e3,
        };
        Ok(picture)
    }

    /// What the picture is drawn into, and with what; both made before.
    fn target(&self) -> Result<(&Targets, &Pipelines), GpuError> {
        match (&self.renderer.targets, &self.renderer.pipelines.get(&self.variant)) {
            (Some(targets), Some(pipelines)) => Ok((targets, pipelines)),
            _ => Err(no_target()),
        }
    }

    /// What makes colours of what has been gathered.
    fn resolve_bindings(&self, targets: &Targets) -> wgpu::BindGroup {
        let GpuRenderer { gpu, shared, layouts, .. } = &*self.renderer;
        shared.resolve_bindings(gpu, &layouts.resolve, targets)
    }

    /// The compositor, if it marks bricks in this frame.
    fn marked(&self) -> Option<&Raycast> {
        let marks = self.variant.gather.occludes() && self.renderer.gpu.report.feedback;
        match &self.renderer.march {
            March::Raycast(raycast) if marks => Some(raycast),
            _ => None,
        }
    }
}

fn no_target() -> GpuError {
    GpuError::Refused("no target".to_string())
}
