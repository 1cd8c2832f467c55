//! The backend of a session, chosen by its options, on a GPU or on the CPU.

use crate::session::device::Device;
#[cfg(feature = "gpu")]
use crate::session::gpu_backend;
use crate::session::options::SessionOptions;
pub use crate::session::options::{BackendChoice, CompositorChoice};
pub(crate) use crate::session::renderer::Pictures;
pub use crate::session::renderer::{BackendError, Renderer};
use brickyard_pager::{BrickSource, Layer, MOST_COMING, Upload, VolumeNeeds};
#[cfg(feature = "gpu")]
use brickyard_render::{GpuError, GpuPreference};
use brickyard_software::{Painting, SoftwareOptions, SoftwareRenderer};
use brickyard_volume::{Combination, Needs, Picture, PixelRect, SlotEncoding};
use std::sync::Arc;
use std::time::Instant;

impl Renderer for SoftwareRenderer {
    fn name(&self) -> &'static str {
        "cpu"
    }

    fn slots(&self, layer: usize) -> u32 {
        self.slots(layer)
    }

    fn bytes(&self) -> u64 {
        self.bytes()
    }

    fn upload(&mut self, layer: usize, upload: &Upload) -> Result<Option<Arc<[u8]>>, BackendError> {
        Ok(self.upload(layer, upload.slot, upload.codes.clone())?)
    }

    fn render(&mut self, layers: &[Layer<'_>], combination: Option<&Combination>) -> Result<Picture, BackendError> {
        Ok(self.render(layers, combination)?)
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

    fn draw_on(&mut self, painting: Option<Arc<Painting>>) {
        self.draw_on(painting);
    }
}

/// Returns a layer's needs on a renderer. `bricks` are the pictures' requirements on bricks. If `plays`, several time
/// steps are to be resident at once.
pub(crate) fn layer_needs(source: &dyn BrickSource, encoding: SlotEncoding, bricks: Needs, plays: bool) -> VolumeNeeds {
    let pyramid = source.pyramid();
    // All bricks of one channel, and an eighth more so the cut may have them all.
    let steps = if plays { u64::from(source.times()).min(1 + MOST_COMING as u64) } else { 1 };
    let count = pyramid.brick_count();
    let most_slots = u32::try_from((count + count / 8 + 2) * steps).unwrap_or(u32::MAX);
    // All of the coarsest level, and one to refine with.
    let roots = pyramid.level(pyramid.coarsest()).bricks.volume();
    VolumeNeeds {
        encoding,
        edge: pyramid.edge(),
        levels: pyramid.octree_levels(),
        bricks,
        least_slots: u32::try_from(roots + 1).unwrap_or(u32::MAX).min(most_slots),
        most_slots,
    }
}

/// Creates the chosen backend for layers and pictures, and returns it with a line of description. An application's
/// device takes precedence over the options.
///
/// # Errors
/// If the GPU was chosen and there is none, the backend lacks the compositor, or the memory cannot hold a picture and
/// the fewest bricks.
pub(crate) fn open(
    device: &mut Device,
    layers: &[VolumeNeeds],
    pictures: &Pictures,
    options: &SessionOptions,
) -> Result<(Box<dyn Renderer>, String), BackendError> {
    type Opened = Result<(Box<dyn Renderer>, String), BackendError>;
    let cpu = |why: &str| -> Opened {
        Ok((Box::new(software(layers, pictures.size_px, options)?), format!("cpu, {} threads{why}", options.threads)))
    };
    #[cfg(feature = "gpu")]
    let is_lent = device.is_lent();
    #[cfg(feature = "gpu")]
    let mut gpu = |preference| -> Opened {
        let (renderer, line) = gpu_backend::open(preference, device, layers, pictures, options)?;
        Ok((Box::new(renderer), line))
    };
    #[cfg(not(feature = "gpu"))]
    let _ = (device, pictures.has_expressions);
    match options.backend {
        #[cfg(feature = "gpu")]
        _ if is_lent => gpu(GpuPreference::Any),
        BackendChoice::Cpu => cpu(""),
        #[cfg(feature = "gpu")]
        BackendChoice::Gpu => gpu(GpuPreference::Any),
        #[cfg(feature = "gpu")]
        BackendChoice::Auto => match gpu(GpuPreference::Hardware) {
            Err(BackendError::Gpu(GpuError::NoAdapter { .. })) => cpu(" (no hardware GPU)"),
            other => other,
        },
        #[cfg(not(feature = "gpu"))]
        BackendChoice::Gpu => Err(BackendError::NoGpu),
        #[cfg(not(feature = "gpu"))]
        BackendChoice::Auto => cpu(" (built without a GPU backend)"),
    }
}

fn software(
    layers: &[VolumeNeeds],
    max_size_px: (u32, u32),
    options: &SessionOptions,
) -> Result<SoftwareRenderer, BackendError> {
    match options.compositor {
        CompositorChoice::Auto | CompositorChoice::Raycast => {}
        CompositorChoice::Sorted => return Err(BackendError::CpuCompositor("sorted")),
        CompositorChoice::Compute => return Err(BackendError::CpuCompositor("compute")),
    }
    let options = SoftwareOptions {
        memory_bytes: options.cpu_memory_bytes,
        max_picture_px: max_size_px.into(),
        threads: options.threads,
        skips_empty: options.skips_empty,
    };
    Ok(SoftwareRenderer::new(layers, &options)?)
}

/// Ends a backend, and returns its device with everything compiled for it; with `keeps_picture`, also with the last
/// shown picture.
pub(crate) fn end(backend: Box<dyn Renderer>, device: &mut Device, keeps_picture: bool) {
    #[cfg(feature = "gpu")]
    if let Some(compiled) = backend.into_compiled(keeps_picture) {
        device.take_back(compiled);
    }
    #[cfg(not(feature = "gpu"))]
    drop((backend, device, keeps_picture));
}
