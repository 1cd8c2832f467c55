//! One interface to all rendering backends: bricks go into the slots of layers, and pictures come out.

use crate::device::Device;
#[cfg(feature = "gpu")]
use crate::gpu_backend;
use crate::options::SessionOptions;
pub use crate::options::{BackendChoice, CompositorChoice};
use brickyard_pager::{BrickSource, Layer, MOST_COMING, Upload, VolumeNeeds};
#[cfg(feature = "gpu")]
use brickyard_render::{Compiled, GpuError, GpuPreference, GpuRenderer};
use brickyard_software::{Painting, SoftwareError, SoftwareOptions, SoftwareRenderer};
use brickyard_volume::{Combination, Needs, Picture, SlotEncoding};
use std::sync::Arc;
use std::time::Instant;

/// Why a backend could not be made, or how it has failed.
#[derive(Debug, thiserror::Error)]
pub enum BackendError {
    /// An error of the GPU backend.
    #[cfg(feature = "gpu")]
    #[error(transparent)]
    Gpu(#[from] GpuError),
    /// The library was built without the GPU backend.
    #[cfg(not(feature = "gpu"))]
    #[error("a GPU was asked for, and this build has no GPU backend (the feature `gpu`)")]
    NoGpu,
    /// An error of the CPU backend.
    #[error(transparent)]
    Cpu(#[from] SoftwareError),
    /// The CPU backend does not have the compositor that was asked for, only `raycast`.
    #[error("the CPU backend has no `{0}` compositor, only `raycast`")]
    CpuCompositor(&'static str),
}

impl BackendError {
    /// Whether the GPU device is lost, so that [`Renderer::renew`] may help.
    pub fn is_loss(&self) -> bool {
        #[cfg(feature = "gpu")]
        return matches!(self, Self::Gpu(GpuError::DeviceLost(_)));
        #[cfg(not(feature = "gpu"))]
        return false;
    }

    /// Whether a picture was given up, since the time was over that was [allowed](Renderer::draw_until).
    pub fn is_too_long(&self) -> bool {
        match self {
            #[cfg(feature = "gpu")]
            Self::Gpu(GpuError::TooLong) => true,
            Self::Cpu(SoftwareError::TooLong) => true,
            _ => false,
        }
    }
}

/// A rendering backend for the layers that it was made for, with the slots that it draws them from.
pub trait Renderer: Send {
    /// The backend's name: `gpu` or `cpu`.
    fn name(&self) -> &'static str;

    /// The compositor's name: `sorted`, `raycast` or `compute`.
    fn compositor(&self) -> &'static str {
        "raycast"
    }

    /// Number of slots in a layer's pool, which all layers of the pool share.
    fn slots(&self, layer: usize) -> u32;

    /// Bytes of everything that is allocated for slots, tables, targets and staging.
    fn bytes(&self) -> u64;

    /// Bytes that [`Renderer::bytes`] would be if the device had not refused some of them.
    fn asked_bytes(&self) -> u64 {
        self.bytes()
    }

    /// Puts a padded brick into a slot of a layer's pool. A backend that keeps the brick's buffer returns the one that it kept for the slot before.
    ///
    /// # Errors
    /// If the device is lost.
    fn upload(&mut self, layer: usize, upload: &Upload) -> Result<Option<Arc<[u8]>>, BackendError>;

    /// Bytes that can be uploaded for a layer without waiting for the device; `None` if uploads may wait.
    fn upload_room_bytes(&mut self, _layer: usize) -> Option<u64> {
        None
    }

    /// Submits what has been uploaded, so that everything drawn from now on shows it.
    ///
    /// # Errors
    /// If the device is lost.
    fn submit_uploads(&mut self) -> Result<(), BackendError> {
        Ok(())
    }

    /// Renders a picture of layers, or of an expression over them. The layers come in the order that the renderer was
    /// made for; some may be left out.
    ///
    /// # Errors
    /// If the device is lost or out of memory.
    fn render(&mut self, layers: &[Layer<'_>], combination: Option<&Combination>) -> Result<Picture, BackendError>;

    /// Prepares [`Renderer::render`] of these layers on another thread, for example by compiling shaders. Other
    /// pictures can be drawn meanwhile. What was asked for before and has not begun is dropped.
    fn prepare(&mut self, _layers: &[Layer<'_>], _combination: Option<&Combination>) {}

    /// Whether [`Renderer::render`] of these layers has nothing left to prepare. A picture that is drawn sooner
    /// prepares itself, or waits for the thread.
    fn is_prepared(&self, _layers: &[Layer<'_>], _combination: Option<&Combination>) -> bool {
        true
    }

    /// For each entry of a layer's draw list in the last picture, in order, the greatest transmittance with which a ray
    /// entered the cell; 0 if no ray did. `None` if that is not known, as for projections and for `sorted`.
    fn visibility(&self, _layer: usize) -> Option<&[f32]> {
        None
    }

    /// Gives up from now on pictures that are not finished at this time; `None` gives none up.
    fn draw_until(&mut self, until: Option<Instant>);

    /// Shows from now on on this painting what of a picture is drawn, and stops if it is abandoned; `None` shows nothing. A backend that draws a
    /// picture in one go does neither.
    fn draw_on(&mut self, _painting: Option<Arc<Painting>>) {}

    /// Whether it still has the picture that the backend before it has shown last.
    fn keeps_picture(&self) -> bool {
        false
    }

    /// Makes a lost GPU device anew, from the choice of the adapter on. All slots are empty then, and there may be
    /// fewer.
    ///
    /// # Errors
    /// If there is no GPU any more, it has too little memory, or the device is an application's.
    fn renew(&mut self) -> Result<(), BackendError> {
        Ok(())
    }

    /// This backend as the GPU renderer; `None` if it is another one.
    #[cfg(feature = "gpu")]
    fn as_gpu(&mut self) -> Option<&mut GpuRenderer> {
        None
    }

    /// Ends the backend, and returns its device with what has been compiled for it, and with the picture that was shown last if
    /// `keeps_picture`. `None` if it has no device.
    #[cfg(feature = "gpu")]
    fn into_compiled(self: Box<Self>, _keeps_picture: bool) -> Option<Result<Compiled, GpuError>> {
        None
    }

    /// Destroys the device, as a driver may: for tests.
    #[doc(hidden)]
    fn destroy_device(&self) {}
}

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

    fn draw_on(&mut self, painting: Option<Arc<Painting>>) {
        self.draw_on(painting);
    }
}

/// Returns what a layer with the bricks of a source needs of a renderer. `bricks` is what pictures need of the bricks. If `plays`, several time steps
/// are to be there at once.
pub(crate) fn layer_needs(source: &dyn BrickSource, encoding: SlotEncoding, bricks: Needs, plays: bool) -> VolumeNeeds {
    let pyramid = source.pyramid();
    // Slots that could ever be filled with one channel, and an eighth more so that the cut may have them all.
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

/// What pictures a backend is made for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pictures {
    /// Size of the largest picture, pixels.
    pub(crate) size_px: (u32, u32),
    /// Whether there may be expressions over the layers.
    pub(crate) has_expressions: bool,
}

/// Makes the chosen backend for layers and pictures, and returns it with a line that describes it. An application's
/// device is used whatever the options choose.
///
/// # Errors
/// If the GPU was asked for and there is none, the backend does not have the compositor, or the memory cannot hold a
/// picture and the fewest bricks.
pub(crate) fn open(
    device: &mut Device,
    layers: &[VolumeNeeds],
    pictures: &Pictures,
    options: &SessionOptions,
) -> Result<(Box<dyn Renderer>, String), BackendError> {
    let cpu = |why: &str| -> Result<(Box<dyn Renderer>, String), BackendError> {
        Ok((Box::new(software(layers, pictures.size_px, options)?), format!("cpu, {} threads{why}", options.threads)))
    };
    #[cfg(feature = "gpu")]
    let (is_lent, mut gpu) =
        (device.is_lent(), |preference| gpu_backend::open(preference, device, layers, pictures, options));
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
