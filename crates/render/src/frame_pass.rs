//! One picture in the making: the layers' cell lists gathered into a target, resolved to display colours, and read back
//! to the CPU. With meshes, gathering and resolving are repeated for each slab.

use crate::GpuError;
use crate::answers::{COUNTS_AT, MARKS_AT, Question};
use crate::buffer_parts::{Part, Parts};
use crate::compositor_parts::{CompositorParts, March};
use crate::frame::Framed;
use crate::gather_plan::{Course, Projected};
use crate::layer::GpuLayer;
use crate::leaf_octree::Tree;
use crate::march::{Gathering, attachment, color_pass, draw_over_all};
use crate::meshes::{Peeled, is_counted};
use crate::pipelines::{Pipeline, Wanted};
use crate::pool::Pool;
use crate::renderer::{GpuRenderer, check_size, rays_of};
use crate::sorted::Boxes;
use crate::targets::{Reading, Targets};
use crate::transfer_table::{self, COMBINED, Places};
use crate::variant::Shader;
use brickyard_pager::{DrawList, Layer, Slot};
use brickyard_shaders::{Seen, Shown};
use brickyard_volume::{Blend, Combination, FrameSettings, Picture, PixelRect, Placement, Pyramid};
use std::ops::Range;
use std::time::Instant;

/// A picture being drawn from several draw lists: see [`GpuRenderer::passes`].
#[derive(Debug)]
pub struct Passes<'a> {
    renderer: &'a mut GpuRenderer,
    framed: Vec<Framed<'a>>,
    course: Course,
    /// The drawn pixels, and whether the picture begins with them.
    rect: PixelRect,
    is_first: bool,
    start: Instant,
    /// Number of the slab's lists drawn so far, and of the cells in each layer's last list.
    lists: u32,
    cells: Vec<usize>,
    /// Number of finished slabs, and the step after the current one.
    slabs: u32,
    next: Next,
    /// Whether to wait for the device where the picture depends on it.
    waits: bool,
}

/// The step after all lists have been drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Next {
    /// The picture: there are no meshes.
    Picture,
    /// Possibly another slab.
    Slab,
    /// The end of the last slab.
    End,
    /// The picture of all slabs.
    All,
}

impl GpuRenderer {
    /// Draws a picture of layers, or of an expression over them, and waits for it. Other layers of the renderer are
    /// left out.
    ///
    /// # Errors
    /// If the picture is too large, layers or lists do not fit this renderer, the compositor is `sorted` and the layers
    /// do not share their cells, or the device fails; also if an expression is combined with isosurfaces, transfer
    /// functions over gradients, another mode than direct volume rendering, or another method than plain sampling.
    pub fn render(&mut self, layers: &[Layer<'_>], combination: Option<&Combination>) -> Result<Picture, GpuError> {
        self.gpu.clone().scoped(|| self.all_drawn(layers, combination, None, true)?.finish())
    }

    /// Begins a picture and draws all its lists, slab by slab; without meshes, `rows` may limit it. `waits`: whether
    /// the caller waits for the picture.
    pub(crate) fn all_drawn<'a>(
        &'a mut self,
        layers: &[Layer<'a>],
        combination: Option<&Combination>,
        rows: Option<Range<u32>>,
        waits: bool,
    ) -> Result<Passes<'a>, GpuError> {
        let draws: Vec<&DrawList> = layers.iter().map(|layer| layer.draw).collect();
        let mut passes = self.begin(layers.iter().map(Framed::of).collect(), combination, waits)?;
        if let Some(rows) = rows {
            passes.is_first = rows.start == 0;
            (passes.rect.y0, passes.rect.y1) = (rows.start, rows.end);
        }
        loop {
            passes.draw_all(&draws)?;
            if !passes.next_slab()? {
                return Ok(passes);
            }
        }
    }

    /// Compiles the pipelines needed to [`GpuRenderer::render`] these layers, on another thread, which may take long;
    /// other pictures can be drawn meanwhile. Requests not begun yet are dropped.
    pub fn prepare(&mut self, layers: &[Layer<'_>], combination: Option<&Combination>) {
        // Impossible pictures report their error when drawn.
        if let Ok(course) = self.course(&layers.iter().map(Framed::of).collect::<Vec<_>>(), combination) {
            self.parts.pipelines.prepare(course.wanted());
        }
    }

    /// Whether all pipelines needed to [`GpuRenderer::render`] these layers are compiled. If not, drawing compiles them
    /// or waits for the compiling thread.
    pub fn is_prepared(&self, layers: &[Layer<'_>], combination: Option<&Combination>) -> bool {
        let course = self.course(&layers.iter().map(Framed::of).collect::<Vec<_>>(), combination);
        course.map_or(true, |course| self.parts.pipelines.are_made(&course.wanted()))
    }

    /// Begins a picture of the renderer's only layer, in its own world, from several draw lists, back to front. Slots
    /// may be refilled between lists, so a picture can show any number of bricks. With meshes, all lists are drawn once
    /// for each [slab](Passes::next_slab).
    ///
    /// # Errors
    /// If the picture is too large, the settings do not fit this renderer, or the device fails.
    pub fn passes<'a>(&'a mut self, frame: &'a FrameSettings, pyramid: &'a Pyramid) -> Result<Passes<'a>, GpuError> {
        if !frame.placement.is_identity() {
            return Err(GpuError::Mismatch("passes are of one volume in its own world".into()));
        }
        let (blend, opacity) = (Blend::Mix, 1.0);
        let only = Framed { number: 0, settings: frame, pyramid, blend, opacity, cut: 0, has_coarse: true };
        self.begin(vec![only], None, true)
    }

    fn begin<'a>(
        &'a mut self,
        framed: Vec<Framed<'a>>,
        combination: Option<&Combination>,
        waits: bool,
    ) -> Result<Passes<'a>, GpuError> {
        let start = Instant::now();
        self.gpu.check()?;
        let course = self.course(&framed, combination)?;
        self.make_ready(&course, framed[0].settings)?;
        self.send(&framed, &course, combination);
        self.gpu.check()?;
        self.visibility = None;
        let next = self.first_peeled(framed[0].settings, waits)?;
        let cells = vec![0; framed.len()];
        let rect = self.window.filter(|_| waits).unwrap_or(framed[0].settings.rays.whole());
        Ok(Passes {
            renderer: self,
            framed,
            course,
            rect,
            is_first: true,
            start,
            lists: 0,
            cells,
            slabs: 0,
            next,
            waits,
        })
    }

    fn course(&self, framed: &[Framed<'_>], combination: Option<&Combination>) -> Result<Course, GpuError> {
        let is_sorted = framed.is_sorted_by(|a, b| a.number < b.number);
        if framed.is_empty() || !is_sorted || framed.iter().any(|framed| framed.number >= self.layers.len()) {
            let numbers: Vec<usize> = framed.iter().map(|framed| framed.number).collect();
            let problem = format!("layers {numbers:?}, in this order, of {}", self.layers.len());
            return Err(GpuError::Mismatch(problem));
        }
        for framed in framed {
            check_size((framed.settings.rays.width, framed.settings.rays.height), self.recipe.max_size_px)?;
            self.layers[framed.number].check(framed)?;
        }
        let first_place = self.combined_part.map(|part| part.first(size_of::<[u32; 2]>()));
        Course::new(&self.layers, &self.pools, framed, combination, first_place, self.compositor())
    }

    fn make_ready(&mut self, course: &Course, frame: &FrameSettings) -> Result<(), GpuError> {
        let compositor = self.compositor();
        let Self { gpu, shared, parts, meshes, peeled, targets, .. } = self;
        let size_px = (frame.rays.width, frame.rays.height);
        let has_meshes = !frame.meshes.is_empty();
        if let Some(meshes) = meshes.as_mut().filter(|_| has_meshes) {
            meshes.set(gpu, frame)?;
            if !peeled.as_ref().is_some_and(|peeled| peeled.suit(size_px)) {
                // As with the targets.
                *peeled = None;
                *peeled = Some(Peeled::new(gpu, meshes, shared, size_px)?);
            }
        }
        course
            .wanted()
            .iter()
            .try_for_each(|wanted| parts.pipelines.need(wanted))
            .map_err(|error| gpu.reason(error))?;
        let (gather, has_sums) = (course.gather(), course.is_joined());
        if !targets.as_ref().is_some_and(|targets| targets.suit(gather, has_sums, size_px)) {
            // The old targets go first: both together would exceed the budget.
            *targets = None;
            *targets = Some(Targets::new(gpu, gather, has_sums, compositor, size_px)?);
        }
        Ok(())
    }

    /// Sends tables and frames, including the meshes' frame: the first layer's, but in the scene's world.
    fn send(&mut self, framed: &[Framed<'_>], course: &Course, combination: Option<&Combination>) {
        let places: Vec<Part> = (0..framed.len()).map(|i| frame_part(&self.layers, framed, course, i)).collect();
        let Self { gpu, shared, parts, other_parts, meshes, layers, pools, combined, combined_part, .. } = self;
        let rays = rays_of(parts, other_parts);
        let composite = gpu.report.formats.composite;
        let settings = framed[0].settings;
        let meshes = meshes.as_ref().filter(|_| !settings.meshes.is_empty());
        let mesh_far = meshes.map_or(0.0, |meshes| meshes.far(settings) as f32);
        let write = |part: Part, layer: &GpuLayer, framed: &Framed<'_>| {
            let mut uniform = layer.uniform(framed, &pools[layer.pool], composite);
            uniform.mesh_far = mesh_far;
            uniform.firsts = layer.shader(framed, pools[layer.pool].ranges, false).numbers();
            gpu.queue.write_buffer(&shared.frame, part.at, bytemuck::bytes_of(&uniform));
        };
        for (framed, part) in framed.iter().zip(places) {
            let layer = &mut layers[framed.number];
            layer.set_table(gpu, shared, rays, &framed.settings.table, Places::of(framed.settings.mode));
            write(part, layer, framed);
        }
        if let Some(meshes) = meshes {
            let in_scene = FrameSettings { placement: Placement::default(), ..settings.clone() };
            write(meshes.frame, &layers[framed[0].number], &Framed { settings: &in_scene, ..framed[0] });
        }
        if let (Some(Combination { table: wanted, .. }), Some(part)) = (combination, combined_part)
            && combined.as_ref() != Some(wanted)
        {
            let places = transfer_table::places(wanted, COMBINED, Places::Media);
            gpu.queue.write_buffer(&shared.table, part.at, bytemuck::cast_slice(&places));
            *combined = Some(wanted.clone());
        }
    }

    /// Peels the first mesh layer and returns the next step.
    fn first_peeled(&mut self, frame: &FrameSettings, waits: bool) -> Result<Next, GpuError> {
        match (&mut self.meshes, &mut self.peeled) {
            (Some(meshes), Some(peeled)) if !frame.meshes.is_empty() => {
                peeled.clear(&self.gpu);
                let may_follow = meshes.peel(&self.gpu, frame, peeled, 0, waits)?;
                Ok(if may_follow { Next::Slab } else { Next::End })
            }
            _ => Ok(Next::Picture),
        }
    }
}

/// A layer's frame in the buffer: those of layers drawn together follow one another from the first.
fn frame_part(layers: &[GpuLayer], framed: &[Framed<'_>], course: &Course, i: usize) -> Part {
    let at = if matches!(course, Course::Joint(_)) { i } else { framed[i].number };
    layers[at].parts.frame
}

impl Passes<'_> {
    /// Fills a slot, like [`GpuRenderer::upload`]. Lists already drawn keep the slot's former contents.
    ///
    /// # Errors
    /// If the codes are not a padded brick, there is no such slot, or the device fails.
    pub fn upload(&mut self, slot: Slot, codes: &[u8]) -> Result<(), GpuError> {
        self.renderer.upload(0, slot, codes)
    }

    /// Draws a list of cells in front of those drawn so far.
    ///
    /// # Errors
    /// If the list does not fit the renderer, the device fails, or it is the second list and the compositor is not
    /// `sorted`: rays go front to back and take a single list.
    pub fn draw(&mut self, draw: &DrawList) -> Result<(), GpuError> {
        self.draw_all(&[draw])
    }

    fn draw_all(&mut self, draws: &[&DrawList]) -> Result<(), GpuError> {
        for (i, draw) in draws.iter().enumerate() {
            self.pool(i).check_list(draw)?;
        }
        match &self.course {
            Course::Single(shader) => self.march(Some(0), shader, draws)?,
            Course::Each(all) => {
                for (i, projected) in all.iter().enumerate() {
                    self.march(Some(projected.layer), &projected.shader, draws)?;
                    self.join(projected, i == 0)?;
                }
            }
            Course::Joint(shader) => self.march(None, shader, draws)?,
        }
        self.lists += 1;
        self.cells = draws.iter().map(|draw| draw.cells.len()).collect();
        Ok(())
    }

    /// Gathers only one layer, or all of them together.
    fn march(&self, only: Option<usize>, shader: &Shader, draws: &[&DrawList]) -> Result<(), GpuError> {
        let GpuRenderer { gpu, shared, parts, .. } = &*self.renderer;
        let is_first = self.lists == 0;
        let marched = only.map_or(0..draws.len(), |i| i..i + 1);
        let layer = only.map(|i| self.framed[i].number);
        let (gathering, pipeline) = (self.gathering(marched.start)?, self.pipeline(shader)?);
        match (&parts.march, pipeline) {
            (March::Sorted(sorted), Pipeline::Render(pipeline)) => {
                let drawn = |i: usize| (draws[i], self.framed[i].pyramid, self.pool(i));
                let boxes = Boxes::new(&marched.map(drawn).collect::<Vec<_>>())?;
                sorted.draw(gpu, &gathering, pipeline, sorted.bindings.of(layer), &boxes, is_first)
            }
            (March::Raycast(raycast), pipeline) if is_first => {
                let trees: Vec<_> = marched.map(|i| self.tree(i, draws[i])).collect();
                raycast.set_trees(gpu, shared, &trees)?;
                gathering.cast_rays(gpu, pipeline, raycast.bindings.of(layer), trees.len() as u32)
            }
            _ => Err(GpuError::Mismatch("rays are cast through a single list".into())),
        }
    }

    /// A layer's octree, and its part of the frames' buffer.
    fn tree(&self, i: usize, draw: &DrawList) -> (Part, Tree) {
        (self.frame_part(i), self.pool(i).tree(&self.framed[i], draw, &self.layer(i).opaque))
    }

    fn pool(&self, i: usize) -> &Pool {
        &self.renderer.pools[self.layer(i).pool]
    }

    fn layer(&self, i: usize) -> &GpuLayer {
        &self.renderer.layers[self.framed[i].number]
    }

    fn frame_part(&self, i: usize) -> Part {
        frame_part(&self.renderer.layers, &self.framed, &self.course, i)
    }

    /// Adds a gathered layer to the sums, or puts it over them; the first layer begins them.
    fn join(&self, projected: &Projected, is_first: bool) -> Result<(), GpuError> {
        let GpuRenderer { gpu, shared, parts: CompositorParts { layouts, .. }, .. } = &*self.renderer;
        let targets = self.targets()?;
        let (seen, shown) = projected.resolved();
        let pipeline = self.resolve(seen, shown)?;
        let Some([mixed, emission]) = &targets.sums else { return Err(no_target()) };
        let parts = &self.layer(projected.layer).parts;
        let bindings = shared.resolve_bindings(gpu, layouts, parts, &targets.gathered, None);
        let is_begin = is_first && self.is_first;
        let load = if is_begin { wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT) } else { wgpu::LoadOp::Load };
        gpu.submit(|encoder| {
            let attachments = [attachment(mixed, load), attachment(emission, load)];
            let mut pass = color_pass(encoder, "join", &attachments, None);
            let PixelRect { x0, x1, y0, y1 } = self.rect;
            pass.set_scissor_rect(x0, y0, x1 - x0, y1 - y0);
            draw_over_all(&mut pass, pipeline, &bindings);
        });
        Ok(())
    }

    /// The target and limits for a march of a layer, or of all from the first on.
    fn gathering(&self, i: usize) -> Result<Gathering<'_>, GpuError> {
        let GpuRenderer { shared, peeled, .. } = &*self.renderer;
        let targets = self.targets()?;
        Ok(Gathering {
            shared,
            target: &targets.gathered,
            rect: self.rect,
            clears: self.is_first,
            limits: peeled.as_ref().filter(|_| self.has_meshes()).map(Peeled::limits),
            is_begin: self.slabs == 0 && i == 0,
            frame: self.frame_part(i),
            pace: &self.renderer.pace,
            reads: self.framed[i..].iter().map(Framed::most_reads).sum(),
        })
    }

    /// Ends a slab: the part of the volume between two layers of meshes, or between the eye and the first layer.
    /// Returns whether another slab follows, for which all lists must be drawn again; never without meshes.
    ///
    /// # Errors
    /// If the device fails.
    pub fn next_slab(&mut self) -> Result<bool, GpuError> {
        if matches!(self.next, Next::Picture | Next::All) {
            return Ok(false);
        }
        self.draw_nothing()?;
        let bindings = self.resolve_bindings()?;
        let GpuRenderer { gpu, peeled: Some(peeled), .. } = &*self.renderer else {
            return Err(no_target());
        };
        peeled.compose(gpu, self.resolve(self.course.seen(), Shown::Slab)?, &bindings);
        if self.next == Next::End {
            self.next = Next::All;
            return Ok(false);
        }
        let GpuRenderer { gpu, meshes: Some(meshes), peeled: Some(peeled), .. } = &mut *self.renderer else {
            return Err(no_target());
        };
        peeled.turn();
        // Where rays met nothing more, the volume behind the found layers is still to come.
        let may_follow = meshes.peel(gpu, self.framed[0].settings, peeled, self.slabs + 1, self.waits)?;
        self.next = if may_follow { Next::Slab } else { Next::End };
        (self.lists, self.slabs) = (0, self.slabs + 1);
        Ok(true)
    }

    /// Finishes the picture and waits for it. If no list was drawn, it shows the background and the meshes.
    ///
    /// # Errors
    /// If the device fails, or slabs have not been drawn.
    pub fn finish(mut self) -> Result<Picture, GpuError> {
        let start = self.start;
        self.renderer.make_room()?;
        let End { submission, reading, is_asked } = self.end(AWAITED, true)?;
        let renderer = self.renderer;
        renderer.gpu.wait(submission)?;
        let (Some(targets), Some(reading)) = (&mut renderer.targets, reading) else { return Err(no_target()) };
        let picture = targets.take(&renderer.gpu, reading)?;
        let mut answers = renderer.hear()?;
        let own = answers.pop_if(|answer| is_asked && answer.picture == AWAITED);
        renderer.last_frame_ms = own.as_ref().and_then(|own| own.gpu_ms).unwrap_or(start.elapsed().as_secs_f64() * 1e3);
        renderer.visibility = own.and_then(|own| own.visibility);
        renderer.heard.append(&mut answers);
        Ok(picture)
    }

    /// Queues the resolve pass, the copy of the picture to the CPU if `wants_pixels`, and the question about the
    /// picture if a sheet is free.
    ///
    /// # Errors
    /// If the device fails, or slabs have not been drawn.
    pub(crate) fn end(&mut self, picture: u64, wants_pixels: bool) -> Result<End, GpuError> {
        if self.next_slab()? {
            return Err(GpuError::Mismatch("the picture has undrawn slabs".into()));
        }
        if self.next == Next::Picture {
            self.draw_nothing()?;
        }
        let mut encoder = self.renderer.gpu.device.create_command_encoder(&Default::default());
        self.resolve_all(&mut encoder)?;
        let (marked, peeled, rect) = (self.marked_cells(), self.peeled(), self.shown_rect());
        let GpuRenderer { gpu, shared, targets: Some(targets), meshes, parts, answers, .. } = &mut *self.renderer
        else {
            return Err(no_target());
        };
        let pixels = if wants_pixels { targets.copy_back(&mut encoder, rect.y0..rect.y1) } else { None };
        let sheet = answers.take_sheet();
        if let Some(sheet) = &sheet {
            shared.take_timestamps(&mut encoder, sheet);
            meshes.iter().for_each(|meshes| meshes.take_counts(&mut encoder, peeled, sheet, COUNTS_AT));
        }
        if let (Some(cells), March::Raycast(raycast)) = (&marked, &parts.march) {
            let cells = cells.iter().map(|(_, cells)| cells).sum();
            raycast.take_marks(&mut encoder, cells, sheet.as_ref(), MARKS_AT);
        }
        let submission = gpu.queue.submit([encoder.finish()]);
        let is_asked = sheet.is_some();
        if let Some(meshes) = meshes.as_mut().filter(|_| peeled > 0) {
            meshes.ask(is_asked.then_some(picture), self.framed[0].settings);
        }
        if let Some(sheet) = sheet {
            // The time between separately drawn rows is not theirs.
            let is_timed = self.is_first;
            answers.ask(Question { picture, marked, peeled, is_timed }, sheet);
        }
        Ok(End { submission, reading: pixels.map(|buffer| targets.reading(buffer, rect.y0..rect.y1)), is_asked })
    }

    /// Queues the pass from the gathered samples, or from all slabs, to display colours.
    fn resolve_all(&self, encoder: &mut wgpu::CommandEncoder) -> Result<(), GpuError> {
        let GpuRenderer { shared, meshes, peeled, .. } = &*self.renderer;
        let (targets, PixelRect { x0, x1, y0, y1 }) = (self.targets()?, self.shown_rect());
        let (pipeline, bindings) = match (meshes, peeled) {
            (Some(meshes), Some(peeled)) if self.has_meshes() => (&meshes.show, peeled.all.clone()),
            _ => (self.resolve(self.course.seen(), Shown::Picture)?, self.resolve_bindings()?),
        };
        let attachment = attachment(&targets.display_view, wgpu::LoadOp::Clear(wgpu::Color::BLACK));
        let mut pass = color_pass(encoder, "resolve", &[attachment], shared.timestamp_writes(None, Some(1)));
        pass.set_scissor_rect(x0, y0, x1 - x0, y1 - y0);
        draw_over_all(&mut pass, pipeline, &bindings);
        Ok(())
    }

    /// The pixels of the finished picture.
    fn shown_rect(&self) -> PixelRect {
        self.renderer.window.filter(|_| self.waits).unwrap_or(self.framed[0].settings.rays.whole())
    }

    /// The picture's layers and the number of marked cells of each, if cells are marked.
    fn marked_cells(&self) -> Option<Vec<(usize, usize)>> {
        let renderer = &*self.renderer;
        let marks = self.course.gather().occludes() && renderer.gpu.report.feedback;
        let is_marked = marks && matches!(renderer.parts.march, March::Raycast(_));
        is_marked.then(|| self.framed.iter().map(|framed| framed.number).zip(self.cells.iter().copied()).collect())
    }

    fn peeled(&self) -> u32 {
        let settings = self.framed[0].settings;
        if self.waits || settings.meshes.is_empty() || !is_counted(settings) { 0 } else { self.slabs + 1 }
    }

    /// Draws empty lists if nothing has been drawn.
    fn draw_nothing(&mut self) -> Result<(), GpuError> {
        let none = DrawList::default();
        let nothing = vec![&none; self.framed.len()];
        if self.lists == 0 { self.draw_all(&nothing) } else { Ok(()) }
    }

    fn has_meshes(&self) -> bool {
        !self.framed[0].settings.meshes.is_empty()
    }

    fn targets(&self) -> Result<&Targets, GpuError> {
        self.renderer.targets.as_ref().ok_or_else(no_target)
    }

    fn pipeline(&self, shader: &Shader) -> Result<&Pipeline, GpuError> {
        self.renderer.parts.pipelines.get(&Wanted::March(shader.clone())).ok_or_else(no_target)
    }

    fn resolve(&self, seen: Seen, shown: Shown) -> Result<&wgpu::RenderPipeline, GpuError> {
        match self.renderer.parts.pipelines.get(&Wanted::Resolve(seen, shown)) {
            Some(Pipeline::Render(pipeline)) => Ok(pipeline),
            _ => Err(no_target()),
        }
    }

    fn resolve_bindings(&self) -> Result<wgpu::BindGroup, GpuError> {
        let GpuRenderer { gpu, shared, parts: CompositorParts { layouts, .. }, .. } = &*self.renderer;
        let (targets, parts) = (self.targets()?, &Parts { frame: self.frame_part(0), ..self.layer(0).parts });
        let sums = targets.sums.as_ref().filter(|_| self.course.is_joined());
        Ok(shared.resolve_bindings(gpu, layouts, parts, &targets.gathered, sums))
    }
}

/// A submitted picture.
pub(crate) struct End {
    submission: wgpu::SubmissionIndex,
    reading: Option<Reading>,
    pub(crate) is_asked: bool,
}

/// The picture number used when the caller waits.
const AWAITED: u64 = u64::MAX;

pub(crate) fn no_target() -> GpuError {
    GpuError::Refused("no target".to_string())
}
