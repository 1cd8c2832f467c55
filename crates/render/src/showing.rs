//! Pictures drawn without waiting: shown on a texture of the renderer's own, put on an application's textures, answered
//! later, and read back on request.

use crate::answers::{Answer, Question, Said};
use crate::blit::Target;
use crate::frame_pass::no_target;
use crate::{GpuError, GpuRenderer};
use brickyard_pager::Layer;
use brickyard_shaders::MARK_STEPS;
use brickyard_volume::{Combination, Picture, StereoLayout};
use std::ops::Range;

impl GpuRenderer {
    /// Draws a picture like [`GpuRenderer::render`], but into the renderer's own texture and without waiting. Returns
    /// whether an [`Answer`] with the number `picture` will follow; none does while too many are in flight.
    ///
    /// # Errors
    /// As [`GpuRenderer::render`].
    pub fn show(
        &mut self,
        layers: &[Layer<'_>],
        combination: Option<&Combination>,
        picture: u64,
    ) -> Result<bool, GpuError> {
        self.gpu.clone().scoped(|| Ok(self.all_drawn(layers, combination, None, false)?.end(picture, false)?.is_asked))
    }

    /// Draws some rows of a picture without meshes, beginning with row 0. The last row ends it and returns the result
    /// of [`GpuRenderer::show`]; earlier ones return `None`. Layers, lists and slots must stay unchanged meanwhile.
    ///
    /// # Errors
    /// As [`GpuRenderer::render`].
    pub fn show_rows(
        &mut self,
        layers: &[Layer<'_>],
        combination: Option<&Combination>,
        picture: u64,
        rows: Range<u32>,
    ) -> Result<Option<bool>, GpuError> {
        let is_last = layers.first().is_none_or(|layer| rows.end >= layer.frame.settings.rays.height);
        self.gpu.clone().scoped(|| {
            let mut passes = self.all_drawn(layers, combination, Some(rows), false)?;
            Ok(if is_last { Some(passes.end(picture, false)?.is_asked) } else { None })
        })
    }

    /// Polls the device and takes the answers received so far, oldest first. Cheap enough for every frame.
    ///
    /// # Errors
    /// If the device is lost.
    pub fn answers(&mut self) -> Result<Vec<Answer>, GpuError> {
        self.gpu.clone().scoped(|| {
            self.gpu.look()?;
            let mut heard = std::mem::take(&mut self.heard);
            heard.append(&mut self.hear()?);
            Ok(heard)
        })
    }

    /// Keeps the last shown picture as the left eye's: the next one is the right eye's.
    ///
    /// # Errors
    /// If nothing has been drawn, or the device has no memory for the picture.
    pub fn keep_left(&mut self) -> Result<(), GpuError> {
        let Self { gpu, targets, blit, .. } = self;
        let targets = targets.as_ref().ok_or_else(no_target)?;
        gpu.scoped(|| blit.keep_left(gpu, targets))
    }

    /// Records a pass in an application's encoder that puts the last shown picture, or with `stereo` those of two eyes,
    /// on the application's texture. The pass reads the picture when submitted, which may be one shown meanwhile.
    ///
    /// # Errors
    /// If nothing has been drawn, or the target's format cannot be drawn into.
    pub fn draw_to(
        &mut self,
        stereo: Option<StereoLayout>,
        target: &Target<'_>,
        encoder: &mut wgpu::CommandEncoder,
    ) -> Result<(), GpuError> {
        let Self { gpu, targets, blit, .. } = self;
        let targets = targets.as_ref().ok_or_else(no_target)?;
        gpu.scoped(|| blit.record(gpu, targets, stereo, target, encoder))
    }

    /// Requests the pixels of the last drawn picture for [`GpuRenderer::picture`]. Returns false, and does nothing,
    /// while those of an earlier picture are on their way or if nothing has been drawn.
    ///
    /// # Errors
    /// If the device fails.
    pub fn read_back(&mut self) -> Result<bool, GpuError> {
        self.gpu.clone().scoped(|| {
            let Self { gpu, targets, reading, .. } = self;
            let Some(targets) = targets.as_mut().filter(|_| reading.is_none()) else { return Ok(false) };
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            let rows = 0..targets.height_px;
            let Some(buffer) = targets.copy_back(&mut encoder, rows.clone()) else { return Ok(false) };
            gpu.queue.submit([encoder.finish()]);
            *reading = Some(targets.reading(buffer, rows));
            gpu.check().map(|()| true)
        })
    }

    /// Returns the picture requested by [`GpuRenderer::read_back`]; `None` while on its way, or without a request.
    ///
    /// # Errors
    /// If the device is lost.
    pub fn picture(&mut self) -> Result<Option<Picture>, GpuError> {
        self.gpu.clone().scoped(|| {
            let Self { gpu, targets, reading, .. } = self;
            gpu.look()?;
            if !reading.as_mut().map_or(Ok(false), |reading| reading.mapping.is_there(gpu))? {
                return Ok(None);
            }
            let (Some(targets), Some(reading)) = (targets, reading.take()) else { return Err(no_target()) };
            targets.take(gpu, reading).map(Some)
        })
    }

    /// Ensures a free sheet and read-back buffer for a picture with a waiting caller: if necessary, waits for
    /// everything in flight and drops a picture requested earlier.
    pub(crate) fn make_room(&mut self) -> Result<(), GpuError> {
        if self.answers.is_full() || self.reading.is_some() {
            self.gpu.wait_for_all()?;
            let mut heard = self.hear()?;
            self.heard.append(&mut heard);
        }
        if let (Some(targets), Some(reading)) = (&mut self.targets, self.reading.take()) {
            // Of two requested pictures the later one counts.
            targets.take(&self.gpu, reading)?;
        }
        Ok(())
    }

    /// Takes the answers received so far. Does not poll the device.
    pub(crate) fn hear(&mut self) -> Result<Vec<Answer>, GpuError> {
        let Self { gpu, answers, meshes, layers, .. } = self;
        let said = answers.take_said(gpu)?;
        if let (Some(meshes), Some(last)) = (meshes, said.iter().rfind(|said| said.question.peeled > 0)) {
            meshes.learn(last.question.picture, &last.counts);
        }
        let has_timestamps = self.shared.timestamps.is_some();
        let tick_ms = gpu.queue.get_timestamp_period() as f64 * 1e-6;
        let answer = |Said { question: Question { picture, marked, is_timed, .. }, ticks, marks, .. }: Said| {
            let mut rest = &marks[..];
            let visibility = marked.map(|marked| {
                let mut visibility = vec![Vec::new(); layers.len()];
                for (layer, cells) in marked {
                    let (own, others) = rest.split_at(cells);
                    rest = others;
                    // Bricks are numbered from front to back, cells from back to front.
                    visibility[layer] = own.iter().rev().map(|&steps| steps as f32 / MARK_STEPS as f32).collect();
                }
                visibility
            });
            let gpu_ms = (has_timestamps && is_timed).then(|| ticks[1].wrapping_sub(ticks[0]) as f64 * tick_ms);
            Answer { picture, visibility, gpu_ms }
        };
        Ok(said.into_iter().map(answer).collect())
    }

    /// Whether the last shown picture lacks layers of translucent meshes. Drawn again, it gets more. `None` while
    /// unknown.
    pub fn lacks_layers(&self) -> Option<bool> {
        self.meshes.as_ref().map_or(Some(false), |meshes| meshes.is_short())
    }
}
