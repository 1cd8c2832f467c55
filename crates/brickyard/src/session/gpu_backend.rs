//! The GPU renderer as a backend.

use crate::session::device::Device;
use crate::session::options::{CompositorChoice, SessionOptions};
use crate::session::renderer::{BackendError, Pictures, Renderer};
use brickyard_pager::{Layer, Upload, VolumeNeeds};
use brickyard_render::{Compiled, Compositor, GpuError, GpuOptions, GpuPreference, GpuRenderer};
use brickyard_volume::{Combination, Picture, PixelRect};
use std::sync::Arc;
use std::time::Instant;

/// Creates the GPU backend for layers and pictures, and returns it with a line of description.
///
/// # Errors
/// If there is no such adapter, or the memory cannot hold a picture and the fewest bricks.
pub(crate) fn open(
    preference: GpuPreference,
    device: &mut Device,
    layers: &[VolumeNeeds],
    &Pictures { size_px, has_expressions: expressions }: &Pictures,
    options: &SessionOptions,
) -> Result<(GpuRenderer, String), BackendError> {
    let compiled = device.take();
    let compares = options.live && options.compositor == CompositorChoice::Auto && device.is_lent();
    let switches = compares && compiled.as_ref().is_some_and(|compiled| device.trial.is_of(compiled.adapter()));
    let compositor = match options.compositor {
        CompositorChoice::Auto if switches => Compositor::Sorted,
        CompositorChoice::Auto => Compositor::default(),
        CompositorChoice::Sorted => Compositor::Sorted,
        CompositorChoice::Raycast => Compositor::Raycast,
        CompositorChoice::Compute => Compositor::Compute,
    };
    let skips_empty = options.skips_empty;
    let gpu = GpuOptions { preference, compositor, switches, skips_empty, expressions, ..GpuOptions::default() };
    let renderer = match compiled {
        Some(compiled) => GpuRenderer::on(compiled, &gpu, layers, options.gpu_memory_bytes, size_px)?,
        None => GpuRenderer::new(&gpu, layers, options.gpu_memory_bytes, size_px)?,
    };
    let line = format!("gpu, {}{}{}", renderer.adapter(), refusal(&renderer), device.trial.outcome());
    Ok((renderer, line))
}

/// Describes memory refused by the device; empty if none was.
fn refusal(renderer: &GpuRenderer) -> String {
    let (asked, got) = (renderer.asked_bytes(), renderer.gpu_bytes());
    let mib = |bytes: u64| bytes as f64 / (1 << 20) as f64;
    match asked > got {
        true => format!(", which refused {:.1} MiB: {:.1} MiB are used", mib(asked), mib(got)),
        false => String::new(),
    }
}

impl Renderer for GpuRenderer {
    fn name(&self) -> &'static str {
        "gpu"
    }

    fn compositor(&self) -> &'static str {
        self.compositor().name()
    }

    fn slots(&self, layer: usize) -> u32 {
        self.slots(layer)
    }

    fn bytes(&self) -> u64 {
        self.gpu_bytes()
    }

    fn asked_bytes(&self) -> u64 {
        self.asked_bytes()
    }

    fn upload(&mut self, layer: usize, upload: &Upload) -> Result<Option<Arc<[u8]>>, BackendError> {
        self.upload(layer, upload.slot, &upload.codes)?;
        Ok(None)
    }

    fn upload_room_bytes(&mut self, layer: usize) -> Option<u64> {
        self.never_waits().then(|| self.upload_room_bytes(layer))
    }

    fn submit_uploads(&mut self) -> Result<(), BackendError> {
        Ok(self.submit_uploads()?)
    }

    fn render(&mut self, layers: &[Layer<'_>], combination: Option<&Combination>) -> Result<Picture, BackendError> {
        Ok(self.render(layers, combination)?)
    }

    fn prepare(&mut self, layers: &[Layer<'_>], combination: Option<&Combination>) {
        self.prepare(layers, combination);
    }

    fn is_prepared(&self, layers: &[Layer<'_>], combination: Option<&Combination>) -> bool {
        self.is_prepared(layers, combination)
    }

    fn visibility(&self, layer: usize) -> Option<&[f32]> {
        self.visibility(layer)
    }

    fn draw_until(&mut self, until: Option<Instant>) {
        self.draw_until(until);
    }

    fn draw_within(&mut self, window: Option<PixelRect>) {
        self.draw_within(window);
    }

    fn keeps_picture(&self) -> bool {
        self.keeps_picture()
    }

    fn renew(&mut self) -> Result<(), BackendError> {
        Ok(self.renew()?)
    }

    fn as_gpu(&mut self) -> Option<&mut GpuRenderer> {
        Some(self)
    }

    fn into_compiled(self: Box<Self>, keeps_picture: bool) -> Option<Result<Compiled, GpuError>> {
        Some((*self).into_compiled(keeps_picture))
    }

    fn destroy_device(&self) {
        self.destroy_device();
    }
}
