//! Pictures that nobody waits for: shown on a texture of the renderer's own, put on those of an application, answered about later, and read
//! back when somebody asks for their pixels.

use crate::answers::{Answer, Question, Said};
use crate::blit::Target;
use crate::error::GpuError;
use crate::frame_pass::no_target;
use crate::renderer::GpuRenderer;
use brickyard_pager::Layer;
use brickyard_shaders::MARK_STEPS;
use brickyard_volume::{Combination, Picture, StereoLayout};

impl GpuRenderer {
    /// Draws as [`GpuRenderer::render`], into a texture of the renderer's own, and waits for nothing. What is known of the picture later
    /// comes as an [`Answer`] with this number: false if there will be none, because too many are under way.
    ///
    /// # Errors
    /// As [`GpuRenderer::render`].
    pub fn show(
        &mut self,
        layers: &[Layer<'_>],
        combination: Option<&Combination>,
        picture: u64,
    ) -> Result<bool, GpuError> {
        self.gpu.clone().scoped(|| Ok(self.all_drawn(layers, combination, false)?.end(picture, false)?.is_asked))
    }

    /// What has been said of pictures, the oldest first, and asks the device what it has done meanwhile. Cheap, for every frame.
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

    /// Keeps the picture that was shown last as the left eye's: the next one is the right eye's.
    ///
    /// # Errors
    /// If nothing has been drawn, or the device has no room for it.
    pub fn keep_left(&mut self) -> Result<(), GpuError> {
        let Self { gpu, targets, blit, .. } = self;
        let targets = targets.as_ref().ok_or_else(no_target)?;
        gpu.scoped(|| blit.keep_left(gpu, targets))
    }

    /// Records a pass that puts the picture shown last on an application's texture, or those of two eyes; of the renderer's it reads these
    /// pictures alone. An encoder that is submitted after another picture has been shown puts that one there.
    ///
    /// # Errors
    /// If nothing has been drawn, or nothing can be drawn in such a format.
    pub fn draw_to(
        &mut self,
        stereo: Option<StereoLayout>,
        target: &Target<'_>,
        encoder: &mut wgpu::CommandEncoder,
    ) -> Result<(), GpuError> {
        let Self { gpu, targets, blit, .. } = self;
        let targets = targets.as_ref().ok_or_else(no_target)?;
        gpu.scoped(|| blit.record(gpu, (targets, stereo), target, encoder))
    }

    /// Asks for the pixels of the picture that was drawn last; they come as [`GpuRenderer::picture`]. False while those of an earlier one are
    /// on their way, or if nothing has been drawn.
    ///
    /// # Errors
    /// If the device fails.
    pub fn read_back(&mut self) -> Result<bool, GpuError> {
        self.gpu.clone().scoped(|| {
            let Self { gpu, targets, reading, .. } = self;
            let Some(targets) = targets.as_mut().filter(|_| reading.is_none()) else { return Ok(false) };
            let mut encoder = gpu.device.create_command_encoder(&Default::default());
            let Some(buffer) = targets.copy_back(&mut encoder) else { return Ok(false) };
            gpu.queue.submit([encoder.finish()]);
            *reading = Some(targets.reading(buffer));
            gpu.check().map(|()| true)
        })
    }

    /// The picture that was asked for, once it is there.
    ///
    /// # Errors
    /// If the device is lost.
    pub fn picture(&mut self) -> Result<Option<Picture>, GpuError> {
        self.gpu.clone().scoped(|| {
            let Self { gpu, targets, reading, .. } = self;
            gpu.look()?;
            if !reading.as_mut().map_or(Ok(false), |reading| reading.is_there(gpu))? {
                return Ok(None);
            }
            let (Some(targets), Some(reading)) = (targets, reading.take()) else { return Err(no_target()) };
            targets.take(gpu, reading).map(Some)
        })
    }

    /// Waits for what is under way, where a picture that is waited for has no sheet or no room for its pixels.
    pub(crate) fn make_room(&mut self) -> Result<(), GpuError> {
        if self.answers.is_full() || self.reading.is_some() {
            self.gpu.wait_for_all()?;
            let mut heard = self.hear()?;
            self.heard.append(&mut heard);
        }
        if let (Some(targets), Some(reading)) = (&mut self.targets, self.reading.take()) {
            // Of two pictures that are asked for the later one counts.
            targets.take(&self.gpu, reading)?;
        }
        Ok(())
    }

    /// What has been said since, as far as the device has been looked at.
    pub(crate) fn hear(&mut self) -> Result<Vec<Answer>, GpuError> {
        let Self { gpu, answers, meshes, layers, .. } = self;
        let said = answers.take_said(gpu)?;
        if let (Some(meshes), Some(last)) = (meshes, said.iter().rfind(|said| said.question.peeled > 0)) {
            meshes.learn(last.question.picture, &last.counts);
        }
        let has_timestamps = self.shared.timestamps.is_some();
        let tick_ms = gpu.queue.get_timestamp_period() as f64 * 1e-6;
        let answer = |Said { question: Question { picture, marked, .. }, ticks, marks, .. }: Said| {
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
            let gpu_ms = has_timestamps.then(|| ticks[1].wrapping_sub(ticks[0]) as f64 * tick_ms);
            Answer { picture, visibility, gpu_ms }
        };
        Ok(said.into_iter().map(answer).collect())
    }

    /// Whether the picture shown last lacks layers of meshes, so that it has to be drawn again: then it has more. `None` while that is asked.
    pub fn lacks_layers(&self) -> Option<bool> {
        self.meshes.as_ref().map_or(Some(false), |meshes| meshes.is_short())
    }
}
